# %% [markdown]
# # Friction in mechanisms
#
# **Question.** Several frictions and stops hold one motion: a crank with a lever that vanishes, plates that rub on each other and on the ground, a freewheel.
# At which force does such a mechanism give way, and where does it come to rest?
#
# **Theory.** At rest nothing decides how the contacts share a force, but the motion does not need to know it. Bodies rest while for every way to move, with
# slips $u_k$ of the contacts,
#
# $$ \Big|\sum_k u_k F_k\Big| \le \sum_k |u_k|\, F_{s,k}. $$
#
# Two plates with the bounds $S_1$ and $S_2$ on the ground and $S_{12}$ between them have three ways to move: either plate alone, or both together. Pushed at
# the first, they give way at $S_1 + \min(S_{12}, S_2)$. A scotch yoke of inertia $J$, whose pin at the radius $r$ has the friction $F$, loses
# $F\,|r\,\mathrm d\sin\varphi|$ on its way: from $\omega_0$ it rests where $J\omega_0^2/2$ is used up, if the lever $r\cos\varphi$ is not zero there.

# %%
import math
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np

from models import Coulomb, OverrunningDrive, ScotchYoke
from toolbox import Component, DryFriction, Equations, Quantity, closed_loop, compose, plot, quantity, simulate, state
from toolbox.inputs import sine

yoke = simulate(closed_loop(compose(ScotchYoke()), start={"crank.speed": 1.3}), 40.0)
# 1.3^2 / 2 = 0.1 (8 + 0.45): four half turns of the pin, and 0.45 of its radius
rest = 4 * math.pi + math.asin(0.45)
print(f"the yoke rests at {yoke['crank.angle'][-1]:.9f} rad, theory {rest:.9f} rad")

# %%
axes = plot.traces(yoke, "crank.angle", "crank.speed")

# %% [markdown]
# Two plates, of which the first is pushed by a force that grows with 1 N/s, for many frictions between them.


# %%
@dataclass(frozen=True)
class Plates(Component):
    """Two plates on the ground that rub on each other."""

    first: Quantity = quantity(1.0, "N", "friction of the first plate on the ground", at_least=0)
    second: Quantity = quantity(0.6, "N", "friction of the second plate on the ground", at_least=0)
    between: Quantity = quantity(0.3, "N", "friction between the plates", at_least=0)

    def equations(self, signal):
        push = signal("plates.push", "N", default=0.0)
        v, u = state("first.speed", "m/s"), state("second.speed", "m/s")
        ground, other, between = (
            DryFriction(name, slip, Coulomb(bound, bound))
            for name, slip, bound in (("ground", v, self.first), ("other", u, self.second), ("between", v - u, self.between))
        )
        return Equations(flow={v: push + ground.force + between.force, u: other.force - between.force}, elements=[ground, other, between])


bounds, gives_way = np.linspace(0.05, 1.2, 24), []
for bound in bounds:
    run = simulate(closed_loop(compose(Plates(between=float(bound))), inputs={"plates.push": ([0.0, 3.0], [0.0, 3.0])}), 3.0)
    gives_way.append(run.events[0].time)
theory = 1.0 + np.minimum(bounds, 0.6)
print(f"largest error of the force at which the plates give way: {np.abs(np.array(gives_way) - theory).max():.1e} N")

# %%
with plt.rc_context(plot.PAPER):
    figure, ax = plt.subplots(figsize=(0.6 * plot.WIDTH, 2.8), layout="constrained")
    ax.plot(bounds, theory, label=r"$S_1 + \min(S_{12}, S_2)$", **plot.LINES[0])
    ax.plot(bounds, gives_way, "o", markersize=4, color=plot.LINES[1]["color"], label="simulated")
    ax.set(xlabel=r"friction between the plates $S_{12}$ [N]", ylabel="force at which they give way [N]")
    ax.legend(frameon=False)

# %% [markdown]
# A one-way clutch drives a shaft by a torque that swings: locked while it drives, free while the driven shaft is faster.

# %%
drive = simulate(closed_loop(compose(OverrunningDrive()), inputs={"driver.torque": sine(0.5, 1.5, 1 / (2 * math.pi))}), 20.0)
locked = drive.time_in("clutch", "locked") / 20.0
print(f"locked for {100 * locked:.1f} % of the time; least torque of the clutch {drive['clutch.force'].min():.1e} N m")

# %%
axes = plot.traces(drive, "driver.speed", "driven.speed", "clutch.force")

# %% [markdown]
# **Answer.** The plates give way at the least force of their ways to move: up to 0.6 N between them the first one goes alone, beyond that both go together, and
# more friction between them changes nothing. The yoke rests at the angle of the energy balance, never at a dead centre. The freewheel never pulls back.

# %%
answer = {
    "rest": float(yoke["crank.angle"][-1]),
    "rest by theory": rest,
    "error of the force": float(np.abs(np.array(gives_way) - theory).max()),
    "least torque of the clutch": float(drive["clutch.force"].min()),
    "locked": float(locked),
}
print("\n".join(f"{name:28} {value:.9g}" for name, value in answer.items()))
