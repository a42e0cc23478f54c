# %% [markdown]
# # From a raw log to a set-point
#
# **Question.** All that there is of a rig is a log, with gaps, nulls and a clock that is late. At which set-point is this rig free of stick-slip
# with 95 %?
#
# **Theory.** Bayes: what is known of the numbers of a machine after a measurement $y$ is $p(q \mid y) \propto p(y \mid q)\, p(q)$, here with
# independent normal errors of the means in windows of half a second. The evidence $\int p(y \mid q)\, p(q)\, dq$ compares laws of friction, and so
# does the density that each gives to windows that it has not seen. Draws of the posterior are machines: each has a border of its own, above which
# it is free, and the chance of being free is counted with bounds of Clopper and Pearson.
#
# The log is **synthetic** (`studies/questions/synthetic.py`): a simulation of a published string with a bit law of known numbers, and the dirt of
# the field, so that the answer can be checked. Nothing was measured on a machine.

# %%
import math
from pathlib import Path

import numpy as np

import studies.questions.synthetic as synthetic
from controllers import SoftTorque, StiffPI
from models import BitRock, Coulomb, Exponential, GaussianStribeck, wells
from toolbox import closed_loop, compose
from toolbox.calibration import Recording
from toolbox.probability import LogNormal, Uniform, compare_models, from_recording, predict, uncertain_onset

path = Path(synthetic.FOLDER) / "dirty_rig.csv"
print("\n".join(path.read_text().splitlines()[:5]))
rig = compose(wells.JANSEN_2, BitRock(friction=Exponential()))
log = Recording.of(path, rig, synthetic.COLUMNS)
print(log)
np.ravel(log.plot())[0].figure.set_dpi(80)

# %% [markdown]
# ## What of it can be used
#
# Samples that are no data were marked, and nothing is bridged by itself. Torque and weight drive the string. They change slowly, so that three or
# four samples that are missing in a row (0.16 s) may be replaced by a line, and that is said: `hole=4`. The gap of 2.4 s is not bridged. What is
# left is the time before it, which begins at rest.
#
# Only the top speed is compared. What was measured downhole has a clock of its own, which is checked below.

# %%
print(log.windows(["top.torque", "bit.weight"], max_gap=4))
before = log.between(0.0, 19.96)
laws = {
    "exponential": Exponential(),
    "Gaussian": GaussianStribeck(static=0.8, kinetic=0.5, stribeck_speed=1.3),
    "constant": Coulomb(static=0.8, kinetic=0.5),
}
models, data, read = {}, {}, {}
for label, law in laws.items():
    models[label], data, read = from_recording(
        compose(wells.JANSEN_2, BitRock(friction=law)), before, {"top.speed": "0.05 rad/s"}, "0.5 s", max_gap=4
    )
left_out = {name: data.pop(name) for name in list(data)[2::4]}
print(f"{len(data)} windows are used, {len(left_out)} are left out")

# %% [markdown]
# ## Three laws of friction
#
# The priors are wide: what one would say of a rock that nobody has seen.

# %%
shared = {"bit.friction.static": Uniform(0.5, 1.0), "bit.friction.kinetic": Uniform(0.3, 0.5)}
priors = {
    "exponential": {**shared, "bit.friction.decay": LogNormal(0.9, 0.5)},
    "Gaussian": {**shared, "bit.friction.stribeck_speed": LogNormal(1.25, 0.5)},
    "constant": shared,
}
compared = compare_models(models, data, priors, 19.96, left_out=left_out, metrics=read, draws=96)
print(compared)
known = compared.posteriors["exponential"]
print(known)
axes = known.plot()

# %% [markdown]
# A constant coefficient is out. Two laws that fall, one as an exponential, the other as a Gaussian curve, cannot be told apart from the surface:
# their evidence is the same, and so is what they predict. Whoever takes one of them because it is usual says more than the log does. The chances
# below are asked of both.
#
# ## What the draws predict downhole
#
# No downhole channel was used. Bands of the draws for bit speed and torque at the bit, beside what was measured there, show what is wrong with it:
# it is late.

# %%
shown = predict(models["exponential"], known.drawn, {"bit.speed": 0.04, "bit.torque": 200.0}, recording=before)
print(shown)
axes = shown.plot()
beside = Recording(before.time, {"measured": before.signals["bit.speed"], "predicted": shown.median["bit.speed"]}, path.name)
late = beside.shift("measured", "predicted")
print(f"the downhole clock is {late:.3f} s late")
shifted = before.shifted({"bit.speed": late, "bit.torque": late})
again = predict(models["exponential"], known.drawn, {"bit.speed": 0.04, "bit.torque": 200.0}, recording=shifted)
print(again)

# %% [markdown]
# With the clock put right the bands of 95 % cover 95 % of the samples of the bit speed and 94 % of the torque, which the posterior has never seen.
# Where the downhole channels are to be used, too, this is the time to do it.
#
# ## The set-point
#
# Each draw of the posteriors is a machine. Started from rest under a drive, it sticks and slips below a border of its own and is free above. The
# weight sways in the log, and the next stand may bring another one: it is taken as 95 kN with a deviation of 4 kN.

# %%
drives = {"stiff PI": StiffPI(), "soft torque": SoftTorque()}
free, lowest = {}, {}
for label in ("exponential", "Gaussian"):
    machine = compose(wells.JANSEN_2, BitRock(friction=laws[label]))
    loops = {drive: closed_loop(machine, law) for drive, law in drives.items()}
    uncertain = compared.posteriors[label].drawn.also({"bit.weight": "95 kN +- 4 kN"})
    free[label] = uncertain_onset(loops, "top.reference", ("40 rpm", "160 rpm"), uncertain, draws=100)
    lowest[label] = {drive: value * 30 / math.pi for drive, value in free[label].lowest(0.95).items()}
    print(free[label], "\n")
axes = free["exponential"].plot()

# %% [markdown]
# The truth is known here: the same border of the machine behind the data, at every weight that was drawn.

# %%
true = BitRock(friction=Exponential(**{name.rpartition(".")[2]: value for name, value in synthetic.TRUTH.items()}))
loops = {drive: closed_loop(compose(wells.JANSEN_2, true), law) for drive, law in drives.items()}
truth = uncertain_onset(loops, "top.reference", ("40 rpm", "160 rpm"), {"bit.weight": "95 kN +- 4 kN"}, draws=100)
print(truth)

# %% [markdown]
# **Answer.** With 95 % this rig is free of stick-slip from 61 rpm on under soft torque if its friction falls as an exponential, and from 63 rpm if it
# falls as a Gaussian curve: the log does not say which, and soft torque hardly asks. A stiff PI needs 120 or 133 rpm. On the machine behind the log
# the answers are 60 and 115 rpm: what 20 s of a log do not tell costs 1 to 3 rpm under soft torque, and 5 to 18 rpm under the stiff drive.

# %%
answer = {
    "flaws": {name: log.found(name) for name in log.signals},
    "probabilities": compared.probabilities,
    "known": known,
    "truth": synthetic.TRUTH,
    "late": late,
    "cover": {"before": shown.coverage["bit.speed"], "after": again.coverage["bit.speed"]},
    "lowest": lowest,
    "lowest of the truth": {drive: value * 30 / math.pi for drive, value in truth.lowest(0.95).items()},
}
