"""Z-torque: a drive without inertia and with the impedance of the string."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from controllers.bumpless import acting, begun, over
from controllers.string_model import lumped_string
from controllers.torque_limits import TorqueLimits
from toolbox import Equations, Quantity, Update, quantity, state
from toolbox.authoring import number
from toolbox.modelling import OptionalQuantity


@dataclass(frozen=True)
class ZTorque(TorqueLimits):
    """Speed control that compensates the inertia of the drive and leaves the string its own impedance at the top.

        u = P e + I z + J_c (w - f) / T_f,   f' = (w - f) / T_f,   z' = e,   e = reference - top speed

    (w - f) / T_f is the filtered acceleration. Below sqrt(zeta / (J T_f)) the drive then shows the string Z = P (and I / i om below I / P), instead of a P that
    an inertia hides. With P = zeta = I_p sqrt(G rho) a wave is not reflected, |r| = |P - zeta| / (P + zeta). All of the inertia cannot be compensated through a
    filter: J_c = J (1 - sqrt(zeta T_f / J))^2 leaves drive and filter a double real pole at -sqrt(zeta / (J T_f)).

    `design` reads what is not given from a lumped chain: zeta = sqrt(k J_b) (k all springs in series, J_b all below the drive), P = zeta less the drag of the
    drive, I = zeta sqrt(k / J_b) / 5. Where torque limits are known, z is led back by (command - wanted) / zeta. The filter is one Euler step a sample, which
    swings ever more where the period is above 2 T_f: such sample times are refused. Sampled, f begins at the measured speed and z
    where the law gives the torque that acts (`controllers.bumpless`), both at 0 where none acts.

    Source: the matching of U. J. F. Aarsnes, F. Di Meglio, R. J. Shor, J. Sound Vib. 424 (2018); J_c and I are choices of this file.

    Examples
    --------
    >>> from controllers import ZTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), ZTorque(reference="60 rpm")))
    Closed loop: TorsionalChain, BitRock
      ZTorque, continuous: impedance 0 N m s/rad, integral 94.6 N m/rad, inertia 1719 kg m2, filter_time 0.05 s, back_calculation 420.6 N m
        s/rad, reference 60 rpm
    """

    impedance: OptionalQuantity = quantity(None, "N m s/rad", "gain P", at_least=0)
    integral: OptionalQuantity = quantity(None, "N m/rad", "gain I", at_least=0)
    inertia: OptionalQuantity = quantity(None, "kg m2", "inertia J_c that is compensated", at_least=0, typical_range=(1e-3, math.inf))
    filter_time: Quantity = quantity(0.05, "s", "time constant T_f of the acceleration's filter", above=0)
    back_calculation: Quantity = quantity(500.0, "N m s/rad", "torque per rate by which z is led back where the command is cut", above=0)
    reference: Quantity = quantity(8.0, "rad/s", "set-point of the top-drive speed", typical_range=(0.05, 40.0))

    @classmethod
    def for_string(cls, string_impedance: float, inertia: float, filter_time: float = 0.05, **others: Any) -> ZTorque:
        """The law for a string of impedance zeta [N m s/rad] (see `controllers.impedance`) on a drive of that inertia [kg m2]; I = 0 unless given."""
        numbers: dict[str, Any] = {
            "impedance": string_impedance,
            "inertia": compensated(inertia, string_impedance, filter_time),
            "filter_time": filter_time,
            "integral": 0.0,
            "back_calculation": string_impedance,
        }
        return cls(**(numbers | others))

    def design(self, plant):
        """Return the controller with missing numbers taken from the chain of the plant."""
        if None not in (self.impedance, self.integral, self.inertia):
            return self
        string = lumped_string(plant, "ZTorque", "`impedance`, `integral` and `inertia`")
        zeta = string.impedance
        numbers = {
            "impedance": max(zeta - string.drag, 0.0),
            "integral": zeta * string.frequency / 5,
            "inertia": compensated(string.drive, max(zeta, string.drag), self.filter_time),
        }
        return replace(self, back_calculation=zeta, **{name: value for name, value in numbers.items() if getattr(self, name) is None})

    def check_period(self, period):
        """Raise SceneError where the filter of the acceleration would swing ever more."""
        number("sample_time", period, "s", at_most=2.0 * self.filter_time)

    def continuous(self, signal):
        f, z = state("ztorque.speed", "rad/s"), state("ztorque.angle", "rad")
        error, wanted, acceleration = self._wanted(signal, f, z)
        command, _ = self.limited(wanted)
        rate = self.led_back(error, wanted, command, self.back_calculation)
        return Equations(flow={f: acceleration, z: rate}, outputs={"top.torque": (command, "N m")})

    def sampled(self, signal, period):
        f, z = state("ztorque.speed", "rad/s"), state("ztorque.angle", "rad")
        error, wanted, acceleration = self._wanted(signal, f, z)
        command, memory = self.limited(wanted, period)
        rate = self.led_back(error, wanted, command, self.back_calculation, period * self.integral)
        update = Update({f: f + period * acceleration, z: z + period * rate, **memory}, {"top.torque": (command, "N m")})
        starts = {f: signal("top.speed", "rad/s"), z: over(acting(signal) - self.impedance * error, self.integral)}
        return begun(update, signal, "ztorque", starts)

    def _wanted(self, signal, f, z):
        speed = signal("top.speed", "rad/s")
        error = signal("top.reference", "rad/s", default=self.reference) - speed
        acceleration = (speed - f) / self.filter_time
        return error, self.impedance * error + self.integral * z + self.inertia * acceleration, acceleration


def compensated(inertia: float, impedance: float, filter_time: float) -> float:
    """The inertia [kg m2] whose compensation leaves J s + Z - J_c s / (T_f s + 1) a double zero: J_c = J (1 - sqrt(Z T_f / J))^2, Z T_f <= J."""
    return inertia * float(1.0 - np.sqrt(min(impedance * filter_time / inertia, 1.0))) ** 2
