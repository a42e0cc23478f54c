"""LQG: optimal state feedback on the estimates of a Kalman filter that takes the torque of the rock for an unknown disturbance."""

from __future__ import annotations

from dataclasses import dataclass

from controllers.lqr import LQR
from controllers.observers import Kalman
from controllers.on_estimates import OnEstimates
from toolbox import Quantity, quantity


@dataclass(frozen=True)
class LQG(LQR):
    """`LQR` on the states that `Kalman` estimates from the top speed alone.

    `design` returns `OnEstimates(LQR, Kalman)`: estimates are recorded as `estimate.bit.speed`, `estimate.bit.torque` and so on. `late` is the number of
    samples by which commands reach the drive later. Without rock and limits the poles are those of the regulator and those of the filter (separation). With a
    rock the filter knows less than the regulator was designed on, and the tests say how much of that remains.

    Examples
    --------
    >>> from controllers import LQG
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), LQG(reference="60 rpm")))
    Closed loop: TorsionalChain, BitRock
      LQG, continuous: reference 60 rpm, top_size 19.1 rpm, bit_size 19.1 rpm, angle_size 8 rad, torque_size 3000 N m, tracking 5 s
    """

    @property
    def measured_signals(self) -> tuple[str, ...]:  # type: ignore[override]
        """The top speed."""
        return ("top.speed",)

    delay_samples: int = 0
    speed_noise: Quantity = quantity(0.01, "rad/s", "standard deviation of the measured top speed", above=0)
    period: Quantity = quantity(0.01, "s", "sample time of that noise", above=0)
    torque_process_noise: Quantity = quantity(2000.0, "N m s^-0.5", "wandering of the bit torque in a second", above=0)
    drive_process_noise: Quantity = quantity(50.0, "N m s^0.5", "white noise of the drive's torque", at_least=0)

    def design(self, plant):
        """The regulator and the filter for the plant."""
        regulator = LQR(
            reference=self.reference, top_speed_scale=self.top_speed_scale, bit_speed_scale=self.bit_speed_scale, angle_scale=self.angle_scale,
            torque_scale=self.torque_scale, tracking_time=self.tracking_time, states=self.states, units=self.units, gain=self.gain,
            operating_point=self.operating_point, operating_point_slope=self.operating_point_slope, name=self.name, **self.limits,
        )  # fmt: skip
        observer = Kalman(
            speed_noise=self.speed_noise,
            period=self.period,
            torque_process_noise=self.torque_process_noise,
            drive_process_noise=self.drive_process_noise,
        )
        return OnEstimates(regulator, observer, delay_samples=self.delay_samples).design(plant)
