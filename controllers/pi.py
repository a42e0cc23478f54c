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
    """PI speed control: u = proportional e + integral int e dt, e = reference - top speed.

    Continuous, or sampled with u_k = proportional e_k + integral z_k, z_(k+1) = z_k + period e_k. The field `reference` is the default of
    the signal `top.reference` [rad/s]. Where torque limits are known, the integral is led back with the time proportional / integral, or within one period
    where that is longer: z' = e + (command - wanted) / max(proportional, period integral). Sampled, z begins where the law gives the torque that acts
    (`controllers.bumpless`), at 0 where none does.

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
        """Return the law that gives an inertia alone the poles of s^2 + 2 damping om s + om^2.

            proportional = 2 damping om J,     integral = om^2 J

        A drag of the drive adds to `proportional`: subtract it where it matters. Source: textbook (K. J. Åström, T. Hägglund, Advanced PID Control, ISA 2006).

        Parameters
        ----------
        inertia
            Inertia J [kg m2].
        frequency
            Natural frequency om [rad/s].
        damping
            Damping ratio [1].
        others
            Other fields of the law, such as `reference`.
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
    """PI speed control as stiff as drives are delivered: it holds the top speed and reflects torsional waves.

    The gains are chosen for a two-inertia rig (table of 2122 kg m2); they are the usual starting point that shows stick-slip.

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
