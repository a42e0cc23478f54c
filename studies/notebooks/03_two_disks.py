# %% [markdown]
# # Two disks coming to rest
#
# **Question.** A heavy rotor is braked by an elastically held stator. What happens in the last second, and where does it not happen?
#
# **Theory.** Under a rotor driven at speed $\Omega$ an undamped stator repeats a cycle: with $\omega_n = \sqrt{k/I_2}$ and $z = (T_s -
# T_k)\,\omega_n/(k\Omega)$ its period is $T/T_n = 1 + (z - \arctan z)/\pi$. In a stop $\Omega$ falls, so $z$ grows: the period begins near
# that of the stator and gets longer. It ends because the rotor has no longer the energy to wind the stator up; the last whole cycle then
# swings with both inertias, and its length follows from their ratio and the drop of friction. A damped stator is caught again only above a
# critical drop: a curve in the plane of two parameters. The model is a reconstruction after Larsson and Farhang (2016), of whose paper only
# the abstract is known here: "starts near 1x, ends near 3x".

# %%
import math

import matplotlib.pyplot as plt
import numpy as np

from models import TwoDisks
from studies.questions.critical_curve import critical_curve
from studies.questions.disks import critical_drop, draw_stops, driven, driven_cycle, stop_of
from toolbox import plot

stops = {speed: stop_of(TwoDisks(), speed) for speed in (1.0, 2.0, 3.0)}
stop = stops[2.0]
print(stop)
print(f"error of the run: {stop.run.error_estimate:.0e}")

# %%
figure = draw_stops(stops)

# %% [markdown]
# The critical curve of a driven rotor: how large must the drop of friction be for the damped stator to be caught again? Every point is a
# bisection of runs; the line is the closed form.

# %%
ratios = np.linspace(0.02, 0.4, 7)
computed = critical_curve(lambda zeta, z: driven(2000.0, 2 * zeta * math.sqrt(2000.0 * 0.02), z), ratios, (0.01, 10.0))
theory = np.array([critical_drop(zeta) for zeta in ratios])
for row in zip(ratios, computed, theory, strict=True):
    print("damping ratio {:.3f}: critical drop {:.5f}, theory {:.5f}".format(*row))

# %%
with plt.rc_context(plot.PAPER):
    figure, (left, right) = plt.subplots(1, 2, figsize=(plot.WIDTH, 2.8), layout="constrained")
    z = np.linspace(0.0, 12.0, 200)
    left.plot(z, [driven_cycle(each)[2] for each in z], **plot.LINES[0])
    left.set(xlabel=r"drop of friction $z$ [1]", ylabel=r"period / $T_n$ [1]", ylim=(0.8, None))
    fine = np.linspace(ratios[0], ratios[-1], 100)
    right.fill_between(fine, [critical_drop(zeta) for zeta in fine], 8.0, color=plot.BAND, zorder=0)
    right.plot(fine, [critical_drop(zeta) for zeta in fine], label="theory", **plot.LINES[0])
    right.plot(ratios, computed, "o", markerfacecolor="white", color="black", markersize=4, label="bisection of runs")
    right.set(xlabel="damping ratio of the stator [1]", ylabel=r"critical drop $z$ [1]", ylim=(0, 8))
    right.text(0.15, 6.5, "stick-slip")
    right.legend(frameon=False, loc="lower right")

# %% [markdown]
# **Answer.** From 2 rad/s the first cycle lasts 1.06 times the period of the stator and the last whole one 2.92 times: "from 1 to 3". The
# end is a property of the set and of the start: from 3 rad/s the last cycle is longer than 4. The computed critical curve agrees with
# theory to the tolerance of the bisection.

# %%
answer = {
    "from 3 rad/s": stops[3.0].termination,
    "onset": stop.onset,
    "termination": stop.termination,
    "error of the curve": float(np.abs(computed / theory - 1).max()),
}
print("\n".join(f"{name:20} {value:.4g}" for name, value in answer.items()))
