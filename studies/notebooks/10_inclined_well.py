# %% [markdown]
# # Off-bottom stick-slip of an inclined well
#
# **Question.** The bit is off bottom, no rock is cut, and the string still sticks and slips. Where does it come from, and what ends it?
#
# **Theory.** In an inclined hole the string lies on the wall: Coulomb friction per length $F_c = \mu \sin(inc)\,\rho g A\,r_o$ acts along
# it, at rest anything up to that, and it drops to $f_{rat} F_c$ beyond a slip speed of $\omega_c = 1.5$ rad/s. The torque that turns the
# whole string from rest is $\int F_c\,dx$; the torque lost when all of it runs is $(1 - f_{rat})$ of it, which is the negative damping.
# Each element of the lumped string has its own contact with its own mode. Source: U. J. F. Aarsnes, R. J. Shor (2018).

# %%
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import toolbox
from models import wells
from toolbox import Scene, compose, plot, simulate
from toolbox.inputs import ramp

string = wells.AARSNES_SHOR
bit = f"chain.{string.friction_at[-1]}"
breakaway = sum(string.friction_load) * string.friction.static
print(
    f"{len(string.inertia)} inertias, {len(string.friction_load)} contacts; break-off torque by the closed form {breakaway / 1e3:.2f} kN m"
)
slow = simulate(compose(string), 400.0, inputs={"top.torque": ramp(0.0, 1.1 * breakaway, 0.0, 400.0)})
last = min(event.time for event in slow.events if event.before == "stick" and event.element == bit)
print(f"the lowest contact lets go at {slow.at(last)['top.torque'] / 1e3:.2f} kN m")

# %%
scene = Scene.load(Path(toolbox.__file__).parents[1] / "studies" / "scenes" / "aarsnes_shor.toml")
runs = {label: scene.run(label) for label in scene.labels}
stuck = {label: run.time_in(bit, "stick", after=15.0) for label, run in runs.items()}
for label, seconds in stuck.items():
    print(f"{label:32} stuck {seconds:5.2f} of the last 15 s, {len(runs[label].events):4d} switches")
axes = plot.comparison(runs, "bit.speed", bit)

# %% [markdown]
# Speed along the string over time, dark where it stands: under the published PI, waves of rest run from the bit upward. The drive near the
# wave impedance of the pipe swallows them.

# %%
with plt.rc_context(plot.PAPER):
    figure, panels = plt.subplots(1, 2, figsize=(plot.WIDTH, 3.2), layout="constrained", sharey=True)
    times = np.linspace(0.0, 30.0, 900)
    depth = np.array(string.depth)
    for panel, label in zip(panels, ("published PI", "PI of 4 pipe impedances"), strict=True):
        speed = 30 / np.pi * runs[label].at(times)["chain.speed"]  # rpm
        image = panel.pcolormesh(times, depth, speed.T, cmap="gray", vmin=0.0, vmax=140.0, shading="nearest", rasterized=True)
        panel.set(xlabel="time [s]", ylim=(depth[-1], 0.0))
        panel.set_title(label, loc="left", fontsize=9.0)
    panels[0].set_ylabel("measured depth [m]")
    figure.colorbar(image, ax=panels, label="speed [rpm]", pad=0.01)

# %% [markdown]
# **Answer.** Friction along the string is enough: at 60 rpm under the published PI the end of the string sticks and slips, off bottom. A
# drive of four pipe impedances frees it; one that is matched to a lumped string does not. A slow rise of torque turns the whole string at
# the break-off torque of the closed form.

# %%
answer = {"stuck": stuck, "break-off torque": breakaway, "break-off torque simulated": slow.at(last)["top.torque"]}
