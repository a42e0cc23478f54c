"""Proportional-integral control of the deceleration of a disc brake."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from controllers.brake_law import BrakeLaw, last_force
from toolbox import Quantity, Update, quantity


@dataclass(frozen=True, kw_only=True)
class BrakePI(BrakeLaw):
    """PI control of the deceleration with feedforward of the planned force.

        N = N_p [1 + (proportional e + integral int e dt) / deceleration],   e = deceleration - T / I

    The plan of the stop and the limits of the command are described in the base class `controllers.brake_law.BrakeLaw`.

    N_p is the planned force of one pad, T the measured brake torque and I the inertia. T / I is the deceleration of the
    disc, so the integral of e equals w - w_p, the disc speed minus the planned speed. The disc speed is measured and
    the planned speed is computed, so the integral does not drift.

    The brake torque follows the command within one sample. The error of one sample therefore acts on the next one, and
    the loop converges only if `proportional` is below 1.

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
