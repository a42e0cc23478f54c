"""Sliding-mode control of the deceleration of a disc brake, robust to its friction.

    s = e + lam int e dt,  e = w - w_p;    N = I [deceleration + lam e + eta sat(s / width)] / (2 r mu),    mu = T / (2 r N) as measured

so that s' = -eta sat(s / width) whatever the friction is, as fast as the torque T is measured.

What it does to the pad: where the torque is held constant in spite of the falling friction, the pad sees a constant force and swings freely,
m v' = F - k x - c v: its motion is the zero dynamics of the loop, and they are stable with the damping of the caliper alone. Hence no groan,
without a measurement of the pad. That takes an actuator faster than the pad. Behind a slow one the same law drives the groan that it would end;
then `filter_time` must be long against the period of the pad, the friction is learned slowly, and only a `margin` helps against groan.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from controllers.brake_law import BrakeLaw, last_force
from toolbox import Quantity, Update, quantity, state


@dataclass(frozen=True, kw_only=True)
class BrakeSlidingMode(BrakeLaw):
    """Sliding-mode control of the disc speed with a boundary layer, robust to the friction of the pads.

        s = e + lam int e dt,  e = w - w_p;    N = I [deceleration + lam e + eta sat(s / width)] / (2 r mu),    mu = T / (2 r N)

    The plan of the stop and the limits of the command are described in the base class `controllers.brake_law.BrakeLaw`.

    w is the disc speed, w_p the planned speed, T the measured brake torque and N the force of one pad. lam, eta and
    width are the fields `surface_gain`, `reaching_rate` and `boundary_layer`. The coefficient of friction mu is
    measured: it is limited to 0.5 to 2 times the expected `friction` and averaged over `filter_time`. With
    `filter_time` 0 it is the value of the last sample.

    sat(x) is x, limited to -1 to 1. I is the inertia of the disc and r the effective radius, both read from the plant.
    `deceleration` is the planned deceleration. If width is smaller than eta times the sample time, eta times the sample
    time is used in its place. This is the implicit discretisation of the sign function: the force does not chatter.

    Examples
    --------
    >>> from controllers import BrakeSlidingMode
    >>> from models import DiscBrake
    >>> from toolbox import compose, measure, simulate
    >>> law = BrakeSlidingMode(deceleration=2.5)
    >>> run = simulate(compose(DiscBrake(force=0.0)), "6 s", start={"disc.speed": 6.0}, controller=law, sample_time="1 ms")
    >>> print(f"{measure.standstill(run, 'disc.speed', speed=0.1):.2f} s")
    2.36 s
    """

    measured_signals: ClassVar[tuple[str, ...]] = ("disc.speed", "brake.torque")

    surface_gain: Quantity = quantity(2.0, "1/s", "weight lam of the integral in the surface", at_least=0)
    reaching_rate: Quantity = quantity(1.0, "rad/s2", "reaching rate eta", above=0)
    boundary_layer: Quantity = quantity(0.1, "rad/s", "half-width of the boundary layer", above=0)
    filter_time: Quantity = quantity(0.0, "s", "time over which the friction is averaged", at_least=0)

    def sampled(self, signal, period):
        speed, torque, last = signal("disc.speed", "rad/s"), signal("brake.torque", "N m"), last_force()
        plan, planned = self.planned(speed, period)
        doubt, angle = state("brake.friction_error", "1"), state("brake.excess_angle", "rad")
        seen = torque / (2.0 * self.radius * ca.fmax(last, self.lowest_force)) - self.friction
        seen = ca.fmin(ca.fmax(seen, -0.5 * self.friction), self.friction)
        learned = ca.if_else(last > 0.0, doubt + period / (period + self.filter_time) * (seen - doubt), 0.0)
        error = speed - plan
        sign = ca.fmin(ca.fmax((error + self.surface_gain * angle) / ca.fmax(self.boundary_layer, self.reaching_rate * period), -1.0), 1.0)
        wanted = self.force_for(self.deceleration + self.surface_gain * error + self.reaching_rate * sign, self.friction + learned)
        command = self.limited(wanted, speed, period, last)
        memory = {**planned, last: command, doubt: learned, angle: angle + period * error}
        return Update(memory=memory, outputs={"brake.force": (command, "N")})
