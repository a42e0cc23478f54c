"""Proportional-integral control of the top-drive speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from controllers.bumpless import acting, begun, over
from controllers.torque_limits import TorqueLimits
from toolbox import Equations, Quantity, Update, quantity, state
from toolbox.authoring import number


@dataclass(frozen=True)
class PI(TorqueLimits):
    """PI control of the top-drive speed: u = proportional e + integral int e dt, e = reference - top speed.

    u is the torque of the drive and z the integral of the error e. The field `reference` is the default of the signal
    `top.reference` [rad/s], the set-point. The controller is continuous or sampled. The sampled form is

        u_k = proportional e_k + integral z_k,   z_(k+1) = z_k + period e_k

    Torque limits: if they are given, z has anti-windup by back-calculation with the time constant proportional /
    integral, or the sample time if the sample time is longer:

        z' = e + (command - wanted) / max(proportional, period integral)

    wanted is the torque u before the limits, command the torque after the limits.

    Start: in the sampled form z is initialised so that the first command equals the present torque (bumpless start,
    `controllers.bumpless`). If no torque acts before the start, z begins at 0.

    Examples
    --------
    >>> from controllers import PI
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), PI(reference="60 rpm")))
    Closed loop: TorsionalChain, BitRock
      PI, continuous: proportional 4000 N m s/rad, integral 1500 N m/rad, reference 60 rpm
    """

    proportional: Quantity = quantity(4000.0, "N m s/rad", "proportional gain", at_least=0)
    integral: Quantity = quantity(1500.0, "N m/rad", "integral gain", at_least=0)
    reference: Quantity = quantity(8.0, "rad/s", "set-point of the top-drive speed", typical_range=(0.05, 40.0))

    @classmethod
    def placed(cls, inertia: float, frequency: float, damping: float = 0.7, **others: Any) -> PI:
        """Return the controller that gives the drive alone, an inertia without a string, the poles of s^2 + 2 damping
        om s + om^2.

            proportional = 2 damping om J,     integral = om^2 J

        A viscous drag of the drive has the same effect as `proportional`. If the drag is not negligible, subtract it
        from `proportional`.

        Source: textbook (K. J. Åström, T. Hägglund, Advanced PID Control, ISA 2006).

        Parameters
        ----------
        inertia
            Inertia J [kg m2].
        frequency
            Natural frequency om [rad/s].
        damping
            Damping ratio [1], by default 0.7.
        others
            Other fields of `PI` as keyword arguments, such as `reference="60 rpm"`.

        Returns
        -------
        PI
            The controller.
        """
        return cls(proportional=2.0 * damping * frequency * inertia, integral=frequency**2 * inertia, **others)

    def check(self):
        super().check()
        if self.limits_known:
            number("proportional", self.proportional, "N m s/rad", above=0)

    def continuous(self, signal):
        angle = state("pi.angle", "rad")
        error = signal("top.reference", "rad/s", default=self.reference) - signal("top.speed", "rad/s")
        wanted = self.proportional * error + self.integral * angle
        command, _ = self.limited(wanted)
        return Equations(flow={angle: self.led_back(error, wanted, command, self.proportional)}, outputs={"top.torque": (command, "N m")})

    def sampled(self, signal, period):
        angle = state("pi.angle", "rad")
        error = signal("top.reference", "rad/s", default=self.reference) - signal("top.speed", "rad/s")
        wanted = self.proportional * error + self.integral * angle
        command, memory = self.limited(wanted, period)
        rate = self.led_back(error, wanted, command, self.proportional, period * self.integral)
        update = Update(memory={angle: angle + period * rate, **memory}, outputs={"top.torque": (command, "N m")})
        return begun(update, signal, "pi", {angle: over(acting(signal) - self.proportional * error, self.integral)})


@dataclass(frozen=True)
class StiffPI(PI):
    """PI control of the top-drive speed with the high gains of common drives. The drive holds its speed and reflects torsional waves.

    The gains are chosen for a drill string of two inertias with a rotary table of 2122 kg m2. With these gains the
    string typically sticks and slips.

    Examples
    --------
    >>> from controllers import StiffPI
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), StiffPI(reference="60 rpm")))
    Closed loop: TorsionalChain, BitRock
      StiffPI, continuous: proportional 20000 N m s/rad, integral 2000 N m/rad, reference 60 rpm
    """

    proportional: Quantity = quantity(2e4, "N m s/rad", "proportional gain", at_least=0)
    integral: Quantity = quantity(2e3, "N m/rad", "integral gain", at_least=0)
