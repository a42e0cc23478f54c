# %% [markdown]
# # Calibrating a friction law
#
# **Question.** What does a recording of a stick-slipping rig say about the friction at its bit, how sure can one be, and which numbers does
# it not say?
#
# **Theory.** Least squares: the numbers $q$ that make $\sum_i ((y(t_i; q) - y_i)/s)^2$ smallest. With the exact Jacobian $J = \partial
# y/\partial q$ their covariance is $(J^\top J)^{-1} s^2$, which gives confidence intervals, and its singular values show what the data
# cannot tell apart. Two ways lead to $y$: the law itself at the measured bit speed, where bit speed *and* torque are measured; or a
# simulation driven by the measured inputs, which needs no downhole torque.
#
# The data here are **synthetic** (`studies/questions/synthetic.py`): a simulation of a published string with a bit law of known numbers and seeded
# noise, so that the answer can be checked. Nothing was measured on a machine.

# %%
from pathlib import Path

import matplotlib.pyplot as plt

import studies.questions.synthetic as synthetic
from models import BitRock, wells
from toolbox import SceneError, compose, fit, plot
from toolbox.calibration import Recording

data = Path(synthetic.FOLDER) / "rig.csv"
print("\n".join(data.read_text().splitlines()[:4]))
rig = compose(wells.JANSEN_2, BitRock())  # the numbers of the book: mu_s 0.8, mu_c 0.5, decay 0.9
laws = ["bit.friction.static", "bit.friction.kinetic", "bit.friction.decay"]
recorded = Recording.of(data, rig, synthetic.COLUMNS)

# %% [markdown]
# ## From the loop
#
# Torque over slip, sample by sample. In stick friction is whatever the string asks for, so those samples say nothing about the law and are
# left out.

# %%
loop = fit(rig, recorded, laws, contact="bit")
print(loop)
axes = loop.plot()

# %% [markdown]
# ## By simulation
#
# Downhole torque is rarely measured. The speeds of table and bit alone determine the law far better, because every cycle depends on it: the
# intervals are twenty to three hundred times narrower, as long as the rest of the model is right.

# %%
speeds = {name: heading for name, heading in synthetic.COLUMNS.items() if name != "bit.torque"}
simulated = fit(rig, data, laws, columns=speeds, starts=2)
print(simulated)
axes = simulated.plot()

# %%
with plt.rc_context(plot.PAPER):
    figure, panels = plt.subplots(1, 3, figsize=(plot.WIDTH, 1.9), layout="constrained")
    for panel, name in zip(panels, laws, strict=True):
        for place, found in enumerate((loop, simulated)):
            low, high = found.interval(name)
            panel.plot([low, high], [place, place], **{**plot.LINES[place], "linewidth": 3.0})
            panel.plot(found[name], place, "o", color=plot.LINES[place]["color"])
        panel.axvline(synthetic.TRUTH[name], color="black", linewidth=0.8)
        panel.set(
            xlabel=name.rpartition(".")[2],
            yticks=(0, 1),
            yticklabels=("loop", "simulation") if panel is panels[0] else ("", ""),
            ylim=(-0.6, 1.6),
        )

# %% [markdown]
# ## What the data do not say
#
# Weight and radius of the bit enter only as a product. A fit of both would return one point of a line of equally good ones, so it is
# refused, by name. (Here the weight is taken out of the recording, for it could not be free otherwise.)

# %%
without_weight = Recording(recorded.time, {name: values for name, values in recorded.signals.items() if name != "bit.weight"}, "rig.csv")
try:
    fit(rig, without_weight, ["bit.weight", "bit.radius"], contact="bit")
    refusal = ""
except SceneError as error:
    refusal = str(error)
print(refusal)

# %% [markdown]
# **Answer.** Both ways find the three numbers of the law within their 95 % intervals. The loop gives them to a few percent or better, the
# simulation to a tenth of a percent or better from speeds alone, and a pair of numbers that only enters as a product is refused.

# %%
answer = {
    "loop": loop,
    "simulated": simulated,
    "truth": synthetic.TRUTH,
    "refusal": refusal,
}
