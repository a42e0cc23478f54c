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
    """Speed control that compensates the inertia of the drive, so that the drive has the impedance of the string.

        u = P e + I z + J_c (w - f) / T_f,   f' = (w - f) / T_f,   z' = e,   e = reference - top speed

    u is the torque of the drive, w the top speed and (w - f) / T_f its filtered acceleration. P, I, J_c and T_f are the
    fields `impedance`, `integral`, `inertia` and `filter_time`.

    Below the frequency sqrt(zeta / (J T_f)) the impedance of the drive is then P, and below I / P it is I / (i om). om is
    the frequency [rad/s], i the imaginary unit, J the inertia of the drive [kg m2], and zeta the wave impedance of the
    string [N m s/rad]. Without compensation the inertia J would dominate.

    For a uniform pipe zeta = I_p sqrt(G rho), with the polar second moment of area I_p [m4], the shear modulus G [Pa] and
    the density rho [kg/m3]. The drive reflects the fraction |P - zeta| / (P + zeta) of the amplitude of a wave, so that
    no wave is reflected if P = zeta.

    The inertia cannot be compensated completely through a filter. J_c = J (1 - sqrt(zeta T_f / J))^2 gives drive and
    filter a double real pole at -sqrt(zeta / (J T_f)).

    `design` takes missing numbers from a lumped chain:

    - zeta = sqrt(k J_b), with the stiffness k of all springs in series and the inertia J_b below the drive;
    - P = max(zeta - D, 0), with the viscous drag D of the drive [N m s/rad], the field `top_drag` of the chain;
    - I = zeta sqrt(k / J_b) / 5;
    - J_c by the formula above, with max(zeta, D) in place of zeta, and J_c = 0 if zeta T_f > J.

    Torque limits: if they are given, z has anti-windup by back-calculation, with the term (command - wanted) /
    `back_calculation`. `design` sets `back_calculation` to zeta. wanted is the torque u before the limits, command the
    torque after the limits.

    Sampled form: the filter makes one Euler step per sample. This filter would be unstable for sample times above 2
    T_f, so such sample times raise an error. f begins at the measured speed, and z is initialised so that the first
    command equals the present torque (bumpless start, `controllers.bumpless`). If no torque acts before the start, f
    and z begin at 0.

    Source: U. J. F. Aarsnes, F. Di Meglio, R. J. Shor, J. Sound Vib. 424 (2018) (impedance matching).

    J_c and I are choices of this toolbox.

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
    back_calculation: Quantity = quantity(500.0, "N m s/rad", "gain of the anti-windup of z, torque per rate", above=0)
    reference: Quantity = quantity(8.0, "rad/s", "set-point of the top-drive speed", typical_range=(0.05, 40.0))

    @classmethod
    def for_string(cls, string_impedance: float, inertia: float, filter_time: float = 0.05, **others: Any) -> ZTorque:
        """Return the controller for a distributed string.

        Parameters
        ----------
        string_impedance
            Wave impedance zeta of the string [N m s/rad], which `pipe_impedance` computes.
        inertia
            Inertia J of the drive [kg m2].
        filter_time
            Time constant T_f of the filter of the acceleration [s], by default 0.05.
        others
            Other fields of `ZTorque` as keyword arguments. `integral` is 0 unless given here.

        Returns
        -------
        ZTorque
            The controller.
        """
        numbers: dict[str, Any] = {
            "impedance": string_impedance,
            "inertia": compensated(inertia, string_impedance, filter_time),
            "filter_time": filter_time,
            "integral": 0.0,
            "back_calculation": string_impedance,
        }
        return cls(**(numbers | others))

    def design(self, plant):
        """Return a copy of the controller in which the fields `impedance`, `integral` and `inertia` that are None have values from
        the chain of the plant, and `back_calculation` is the impedance of the string.

        If none of the three fields is None, the method returns this controller unchanged.

        Parameters
        ----------
        plant
            The plant on which the controller is designed.
        """
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
        """Raise SceneError if the sample time is above 2 `filter_time`: the filter of the acceleration would be unstable.

        Parameters
        ----------
        period
            Sample time [s].
        """
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
