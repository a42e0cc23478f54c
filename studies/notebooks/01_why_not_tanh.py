# %% [markdown]
# # Why not tanh?
#
# **Question.** Dry friction is often written as a steep but smooth curve, $T = T_s \tanh(\omega/\varepsilon)$. What does a drill bit do
# under it that a real bit does not?
#
# **Theory.** A contact at rest carries whatever torque keeps it at rest, up to the static bound $T_s$. The smooth curve has no rest: under
# a load $L < T_s$ it creeps for ever, at $\omega = \varepsilon\,\mathrm{artanh}(L/T_s)$ as long as friction has not fallen yet. Where
# friction falls with speed, the curve $\tanh(\omega/\varepsilon)\,\mu(\omega)$ also has its peak below $\mu_s$, so that the model breaks
# free at a torque at which the real bit stands: a controller that was designed on it parks the bit and believes that it has left. Smaller
# $\varepsilon$ mends both and makes the equations stiff.

# %%
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
from casadi import exp, fabs, tanh
from scipy.optimize import brentq, minimize_scalar

from models import BitRock, wells
from toolbox import Component, Equations, compose, plot, quantity, simulate
from toolbox.inputs import ramp

rock = BitRock()
law, load = rock.friction, rock.weight * rock.radius
static = load * law.static
print(f"static torque of the bit: {static:.0f} N m")

# %% [markdown]
# The same rock with the smooth curve in place of the set-valued contact: `epsilon` is its width.


# %%
@dataclass(frozen=True)
class TanhRock(Component):
    """Rock torque W R_b mu(|w|) tanh(w / epsilon), without a contact."""

    epsilon: float = quantity(0.1, "rad/s", "width", above=0)

    def equations(self, signal):
        speed = signal("bit.speed", "rad/s")
        shape = tanh(speed / self.epsilon)
        mu = law.kinetic + (law.static - law.kinetic) * exp(-law.decay * fabs(speed))
        return Equations(outputs={"bit.torque": (load * mu * shape, "N m")})


def peak(epsilon):
    """Largest torque of the smooth curve, in parts of the static torque."""

    def torque(w):
        return np.tanh(w / epsilon) * (law.kinetic + (law.static - law.kinetic) * np.exp(-law.decay * w)) / law.static

    return -minimize_scalar(lambda w: -torque(w), bounds=(0.0, 10 * epsilon + 1), method="bounded", options={"xatol": 1e-10}).fun


widths = np.array([0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 0.5])
peaks = np.array([peak(e) for e in widths])
for e, part in zip(widths, peaks, strict=True):
    print(f"width {e:5.3f} rad/s: breaks away at {100 * part:5.1f} % of the static torque")

# %% [markdown]
# ## Creep
#
# The torque at the top rises to 80 % of the static torque and stays there. The real bit stands; the smooth one turns.

# %%
exact, smooth = compose(wells.JANSEN_2, rock), compose(wells.JANSEN_2, TanhRock())
hold = ramp(0.0, 0.8 * static, 0.0, 40.0)
stand = simulate(exact, 160.0, inputs={"top.torque": hold})
creeping = {e: simulate(smooth, 160.0, inputs={"top.torque": hold}, parameters={"bit.epsilon": e}) for e in (0.3, 0.1, 0.01, 0.001)}
for e, run in creeping.items():
    at_end = run.at(160.0)["bit.speed"]
    print(f"width {e:5.3f} rad/s: {60 * np.degrees(at_end):8.1f} degrees a minute, {sum(run.steps):6d} steps ({run.run.method.text})")
print(f"set-valued:          {np.degrees(60 * stand.at(160.0)['bit.speed']):8.1f} degrees a minute, {sum(stand.steps):6d} steps")

# %% [markdown]
# ## The stiction trap
#
# At 95 % of the static torque the curve of width 0.1 rad/s has been overcome, and the model sticks and slips at high speed. The machine
# stands.

# %%
push = ramp(0.0, 0.95 * static, 0.0, 40.0)
parked = simulate(exact, 100.0, inputs={"top.torque": push})
believed = simulate(smooth, 100.0, inputs={"top.torque": push}, parameters={"bit.epsilon": 0.1})
grid = np.linspace(0.0, 100.0, 10_001)
print(f"fastest: model {believed.at(grid)['bit.speed'].max():.2f} rad/s, machine {parked.at(grid)['bit.speed'].max():.2f} rad/s")

# %%
with plt.rc_context(plot.PAPER):
    figure, (left, right) = plt.subplots(1, 2, figsize=(plot.WIDTH, 2.8), layout="constrained")
    w = np.linspace(0.0, 1.5, 600)
    mu = law.kinetic + (law.static - law.kinetic) * np.exp(-law.decay * w)
    left.plot(np.append(0.0, w), load * np.append(0.0, mu) / 1e3, label="set-valued", **plot.LINES[0])
    for e, style in zip((0.03, 0.1, 0.3), plot.LINES[1:], strict=False):
        left.plot(w, load * mu * np.tanh(w / e) / 1e3, label=f"width {e:g} rad/s", **style)
    left.axhline(0.95 * static / 1e3, color="0.6", linewidth=0.8)
    left.set(xlabel="bit speed [rad/s]", ylabel="torque [kN m]", xlim=(-0.02, 1.5), ylim=(0, None))
    left.legend(frameon=False)
    right.semilogx(widths, 100 * peaks, "o-", markersize=4, **{k: v for k, v in plot.LINES[0].items() if k != "linestyle"})
    right.set(xlabel="width [rad/s]", ylabel="break-away torque [% of static]", ylim=(None, 101))

# %%
with plt.rc_context(plot.PAPER):
    figure, (left, right) = plt.subplots(1, 2, figsize=(plot.WIDTH, 2.8), layout="constrained")
    times = np.linspace(0.0, 160.0, 1600)
    for (e, run), style in zip(list(creeping.items())[:3], plot.LINES[1:], strict=False):
        turned = np.degrees(np.cumsum(run.at(times)["bit.speed"]) * times[1])
        left.plot(times, turned / 360, label=f"width {e:g} rad/s", **style)
    left.plot(times, 0 * times, label="set-valued", **plot.LINES[0])
    left.set(xlabel="time [s]", ylabel="turns of the bit [1]", ylim=(-0.05, None))
    left.set_yscale("asinh", linear_width=1.0)
    left.set_yticks([0.0, 0.5, 1.0, 2.0, 5.0, 10.0], ["0", "0.5", "1", "2", "5", "10"])
    left.legend(frameon=False, loc="upper left")
    left.set_title("80 % of the static torque", loc="left", fontsize=9.0)
    right.plot(grid, believed.at(grid)["bit.speed"], label="model, width 0.1 rad/s", **plot.LINES[2])
    right.plot(grid, parked.at(grid)["bit.speed"], label="machine", **plot.LINES[0])
    right.set(xlabel="time [s]", ylabel="bit speed [rad/s]", ylim=(None, 20))
    right.legend(frameon=False, loc="upper left")
    right.set_title("95 % of the static torque", loc="left", fontsize=9.0)

# %% [markdown]
# **Answer.** A width of 0.1 rad/s loses 9 % of the break-away torque, and under 80 % of it the bit creeps where the real one stands, at the
# speed that theory gives. At 95 % of the static torque the model runs and the machine stands. The set-valued contact stands in both cases,
# with exactly zero speed.


# %%
def at_rest(w, epsilon=0.01):
    """Torque of rock and drags at a creep speed, less the load."""
    mu = law.kinetic + (law.static - law.kinetic) * np.exp(-law.decay * w)
    return load * mu * np.tanh(w / epsilon) + (425.0 + 50.0) * w - 0.8 * static


answer = {
    "peak at 0.1 rad/s": peak(0.1),
    "peak at 0.01 rad/s": peak(0.01),
    "creep": creeping[0.01].at(160.0)["bit.speed"],
    "creep by theory": brentq(at_rest, 0.0, 0.03, xtol=1e-15),
    "creep by artanh": 0.01 * np.arctanh(0.8),
    "speed of the set-valued bit": max(stand.at(160.0)["bit.speed"], parked.at(100.0)["bit.speed"]),
    "turns that the model believes": np.ptp(np.cumsum(believed.at(grid)["bit.speed"]) * grid[1]) / (2 * np.pi),
    "steps at 0.001 rad/s over exact": sum(creeping[0.001].steps) / sum(stand.steps),
}
print("\n".join(f"{name:34} {value:.4g}" for name, value in answer.items()))
