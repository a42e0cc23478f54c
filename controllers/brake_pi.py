"""Proportional-integral control of the deceleration of a disc brake."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from controllers.brake_law import BrakeLaw, last_force
from toolbox import Quantity, Update, quantity


@dataclass(frozen=True, kw_only=True)
class BrakePI(BrakeLaw):
    """PI on the deceleration, the plan fed forward: N = N_p [1 + (proportional e + integral int e dt) / deceleration], e = deceleration - T / I.

    The deceleration is read from the brake torque T; its integral is the speed in excess of the plan, w - w_p, which is measured and does not drift. The
    torque answers within the sample: with e of one sample acting on the next, `proportional` must stay below 1 for the loop to converge.

    Examples
    --------
    >>> from controllers import BrakePI
    >>> from models import DiscBrake
    >>> from toolbox import compose, measure, simulate
    >>> run = simulate(compose(DiscBrake(force=0.0)), "6 s", start={"disc.speed": 6.0}, controller=BrakePI(deceleration=2.5), sample_time="1 ms")
    >>> print(f"{measure.standstill(run, 'disc.speed', speed=0.1):.2f} s")
    2.35 s
    """

    measured_signals: ClassVar[tuple[str, ...]] = ("disc.speed", "brake.torque")

    proportional: Quantity = quantity(0.5, "1", "gain on the deceleration", at_least=0)
    integral: Quantity = quantity(4.0, "1/s", "gain on its integral, the speed", at_least=0)

    def sampled(self, signal, period):
        speed, torque, last = signal("disc.speed", "rad/s"), signal("brake.torque", "N m"), last_force()
        plan, planned = self.planned(speed, period)
        error = self.deceleration - torque / self.inertia
        wanted = self.force_for(self.deceleration + self.proportional * error + self.integral * (speed - plan))
        command = self.limited(wanted, speed, period, last)
        return Update(memory={**planned, last: command}, outputs={"brake.force": (command, "N")})
