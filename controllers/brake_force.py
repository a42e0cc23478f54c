"""A brake without feedback."""

from __future__ import annotations

from dataclasses import dataclass

from controllers.brake_law import BrakeLaw, last_force
from toolbox import Update


@dataclass(frozen=True, kw_only=True)
class BrakeForce(BrakeLaw):
    """Brake controller with the constant force of the plan, N = N_p: the baseline for the other brake controllers.

    The plan of the stop and the limits of the command are described in the base class `controllers.brake_law.BrakeLaw`.

    With a `margin` the force is reduced before standstill, so that it stays below `margin` times the force above which
    the pad groans. The border of groan is N_0 exp(q w) at the disc speed w. The reduction begins at the speed w_e, and
    the disc then slows down as

        w' = -(2 mu r margin N_0 / I) exp(q w),   w_e = ln(N_p / (margin N_0)) / q

    mu is `friction`, r the effective radius and I the inertia of the disc. N_0 is the border of groan at standstill and
    q its growth with the disc speed (`groan_border`).

    From w_e to standstill the disc takes the time (1 - exp(-q w_e)) I / (2 mu r margin N_0 q). Without the margin the
    disc takes w_e I / (2 mu r N_p) from w_e to standstill.

    Examples
    --------
    >>> from controllers import BrakeForce
    >>> from models import DiscBrake
    >>> from toolbox import compose, measure, simulate
    >>> run = simulate(compose(DiscBrake(force=0.0)), "6 s", start={"disc.speed": 6.0}, controller=BrakeForce(deceleration=2.5), sample_time="1 ms")
    >>> print(f"{measure.standstill(run, 'disc.speed', speed=0.1):.2f} s")
    2.55 s
    """

    def sampled(self, signal, period):
        speed, last = signal("disc.speed", "rad/s"), last_force()
        command = self.limited(self.force_for(self.deceleration), speed, period, last)
        return Update(memory={last: command}, outputs={"brake.force": (command, "N")})
