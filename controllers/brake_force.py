"""A brake without feedback."""

from __future__ import annotations

from dataclasses import dataclass

from controllers.brake_law import BrakeLaw, last_force
from toolbox import Update


@dataclass(frozen=True, kw_only=True)
class BrakeForce(BrakeLaw):
    """The constant force of the plan, N = N_p: the comparison against which the other brake laws are judged. With a `margin` it is eased towards standstill.

    Eased, the wheel slows down from w_e = ln(N_p / (margin N_0)) / q on as w' = -(2 mu r margin N_0 / I) exp(q w), and the rest of the stop takes (1 - exp(-q
    w_e)) I / (2 mu r margin N_0 q) instead of w_e I / (2 mu r N_p).
    """

    def sampled(self, signal, period):
        speed, last = signal("disc.speed", "rad/s"), last_force()
        command = self.limited(self.force_for(self.deceleration), speed, period, last)
        return Update(memory={last: command}, outputs={"brake.force": (command, "N")})
