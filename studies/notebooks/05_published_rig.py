# %% [markdown]
# # Torsional stick-slip of a published rig
#
# **Question.** The four-inertia rig of Navarro-Lopez and Cortes at 97.3 kN on bit and 45 rpm: what does its bit do under a constant torque,
# and which drive frees it?
#
# **Theory.** Top drive, pipe, collars and bit are a chain of inertias and springs, $J_i \dot\omega_i = \ldots$, with the torque of the rock
# on the last one, $T = W R_b\,[\mu_c + (\mu_s - \mu_c)\,e^{-\gamma|\omega|}]\,\mathrm{sgn}\,\omega$. Its fall with speed acts as negative
# damping. A drive can only damp what arrives at the top: one that holds the speed reflects every wave and damps nothing, one whose
# impedance is that of the string swallows them. Source: Navarro-Lopez and Cortes, J. Sound Vib. 307 (2007) 152-171,
# doi:10.1016/j.jsv.2007.06.037.

# %%
from pathlib import Path

import matplotlib.pyplot as plt

import toolbox
from toolbox import Scene, plot
from toolbox.onsets import verdicts
from toolbox.scenes.verdict_table import table

scene = Scene.load(Path(toolbox.__file__).parents[1] / "studies" / "scenes" / "navarro_lopez_4.toml")
judged = {label: verdicts.verdict_row(scene, label) for label in scene.labels}
print(table(scene, [row for row, _ in judged.values()]))

# %% [markdown]
# The last column of such a table is the time of this machine. Open loop first: the bit sticks in every cycle and then runs at more than
# twice the set-point.

# %%
runs = {label: run for label, (_, run) in judged.items()}
shown = ("constant torque", "stiff PI", "soft torque")
axes = plot.comparison({label: runs[label] for label in shown}, "bit.speed", "bit", until=150.0)

# %%
with plt.rc_context(plot.PAPER):
    figure, panels = plt.subplots(1, 2, figsize=(plot.WIDTH, 3.0), layout="constrained", sharex=True, sharey=True)
    for panel, label in zip(panels, ("constant torque", "soft torque"), strict=True):
        plot.phase_plane(runs[label], "chain.twist.2", "bit.speed", "bit", ax=panel)
        panel.set_title(label, loc="left", fontsize=9.0)

# %% [markdown]
# **Answer.** Under a constant torque the bit is stuck for 43 of the last 100 s; the stiff PI, which is how drives are delivered, helps
# little. Soft torque winds the string up once, breaks the bit free and holds it, continuous or at 100 Hz, and so does the sliding mode. The
# price is an overshoot of the bit speed when it breaks free, and it is the highest under the sliding mode.

# %%
answer = {label: row.stuck for label, (row, _) in judged.items()}
overshoot = {label: row.overshoot for label, (row, _) in judged.items()}
print("\n".join(f"{label:24} stuck {stuck:5.1f} s of the last 100 s" for label, stuck in answer.items()))
