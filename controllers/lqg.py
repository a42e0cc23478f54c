"""LQG: optimal state feedback on the estimates of a Kalman filter that takes the torque of the rock for an unknown disturbance."""

from __future__ import annotations

from dataclasses import dataclass

from controllers.lqr import LQR
from controllers.observers import Kalman
from controllers.on_estimates import StringObserverController
from toolbox import Quantity, quantity


@dataclass(frozen=True)
class LQG(LQR):
    """LQG control of the top drive: the state feedback of `LQR` on states that a Kalman filter estimates from the top speed.

    `design` returns `StringObserverController(LQR, Kalman)`. The estimates are recorded as `estimate.bit.speed`,
    `estimate.bit.torque` and so on. `delay_samples` is the delay of the commands on their way to the drive, in samples.

    Without rock and torque limits the poles of the loop are the poles of the regulator and the poles of the filter
    (separation principle). With a rock the separation is not exact: the regulator is designed on the string with the
    rock, but the filter only on the string, with the bit torque as a random walk.

    Examples
    --------
    >>> from controllers import LQG
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), LQG(reference="60 rpm")))
    Closed loop: TorsionalChain, BitRock
      LQG, continuous: law LQR (reference 60 rpm, top_speed_scale 19.1 rpm, bit_speed_scale 19.1 rpm, angle_scale 8 rad,
        torque_scale 3000 N m, tracking_time 5 s), observer Kalman (speed_noise 0.09549 rpm, period 0.01 s,
        torque_process_noise 2000 N m s^-0.5, drive_process_noise 50 N m s^0.5)
    """

    @property
    def measured_signals(self) -> tuple[str, ...]:  # type: ignore[override]
        """Name of the measured signal: the top speed."""
        return ("top.speed",)

    delay_samples: int = 0
    speed_noise: Quantity = quantity(0.01, "rad/s", "standard deviation of the measured top speed", above=0)
    period: Quantity = quantity(0.01, "s", "sample time of the measurement noise", above=0)
    torque_process_noise: Quantity = quantity(
        2000.0, "N m s^-0.5", "standard deviation of the change of the bit torque in one second", above=0
    )
    drive_process_noise: Quantity = quantity(50.0, "N m s^0.5", "intensity of the white noise of the drive torque", at_least=0)

    def design(self, plant):
        """Return the controller that consists of the regulator and the Kalman filter, both designed on the plant.

        Parameters
        ----------
        plant
            The plant on which the controller is designed.
        """
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
        return StringObserverController(regulator, observer, delay_samples=self.delay_samples).design(plant)
