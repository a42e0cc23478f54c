"""Super-twisting: second-order sliding with a continuous torque, on a tracking surface or on one that makes the drive an impedance.

    u = u_eq - J_r (k_1 |s|^(1/2) sgn(s) - v),   v' = -k_2 sgn(s),   k_1 = 1.5 L^(1/2),  k_2 = 1.1 L

takes s and s' to zero in finite time against a disturbance whose rate is below L [rad/s3]. Gains and law: A. Levant, Int. J. Control 58 (1993) 1247-1263.

Why sampled only: the continuous law switches infinitely often in finite time before it rests, which no event location follows to its end.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import casadi as ca
import numpy as np

from controllers.bumpless import acting
from controllers.sliding_mode import SlidingSurface
from toolbox import Quantity, SceneError, Update, quantity, state
from toolbox.modelling import OptionalQuantity


@dataclass(frozen=True)
class SuperTwisting(SlidingSurface):
    """Super-twisting control of the top drive: second-order sliding mode with a continuous torque.

        s = (w_r - Om) + lam int (w_r - Om) dt + lam int (w_r - w_b) dt
        u = u_eq - J_r (1.5 L^(1/2) |s|^(1/2) sgn(s) - v),   v' = -1.1 L sgn(s)

    u is the torque of the drive, w_r the top speed, w_b the bit speed and Om the set-point. u_eq = c_r w_r + tau - J_r
    lam [(w_r - Om) + (w_r - w_b)] is the torque that keeps s constant, with the drag c_r of the drive and the torque
    tau of the string on the drive. J_r is the inertia of the drive, lam the field `surface_gain`, and L the field
    `disturbance_rate`: the controller rejects disturbances of the acceleration whose rate of change is below L. The
    field `reaching_rate` is not used.

    If torque limits are given, the integral of the surface takes up the torque that the drive cannot give
    (anti-windup). The controller runs sampled only.

    Source: A. Levant, Int. J. Control 58 (1993) 1247-1263 (gains and form).

    Examples
    --------
    >>> from controllers import SuperTwisting
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), Sampled(SuperTwisting(reference="60 rpm"), "10 ms")))
    Closed loop: TorsionalChain, BitRock
      SuperTwisting, sampled every 10 ms: reference 60 rpm, surface_gain 0.2 1/s, reaching_rate 2 rad/s2, inertia 2122 kg
        m2, drag 425 N m s/rad, disturbance_rate 4 rad/s3
    """

    disturbance_rate: Quantity = quantity(
        4.0, "rad/s3", "bound L on the rate of the acceleration missing in the equivalent control", above=0
    )

    def sampled(self, signal, period):
        angle, v = state("slidingmode.angle", "rad"), state("slidingmode.acceleration", "rad/s2")
        signal, sent = self.ahead(signal, period)
        rate, s, equivalent = self.terms(signal, angle)
        sign = ca.sign(s)
        k1, k2 = 1.5 * ca.sqrt(self.disturbance_rate), 1.1 * self.disturbance_rate
        wanted = equivalent - self.inertia * (k1 * ca.sqrt(ca.fabs(s)) * sign - v)
        command, memory = self.limited(wanted, period)
        update = Update(
            memory={angle: angle + period * self.taken_up(rate, wanted, command), v: v - period * k2 * sign, **sent(command), **memory},
            outputs={"top.torque": (command, "N m"), "slidingmode.surface": (s, "rad/s")},
        )
        starts = {angle: self.angle_at(signal, 0.0), v: (acting(signal) - equivalent) / self.inertia}
        return self.started(update, signal, starts)


@dataclass(frozen=True)
class ImpedanceSuperTwisting(SuperTwisting):
    """Super-twisting control that makes the drive an impedance Z without inertia, like a matched end of the string.

        s = (w_r - Om) + surface_gain int (w_r - Om) dt + tau / Z,   u_eq = c_r w_r + tau - J_r surface_gain (w_r - Om)

    w_r is the top speed, Om the set-point and tau the torque of the string on the drive. On the surface s = 0 the
    string torque obeys tau = -Z (w_r - Om) - surface_gain Z int (w_r - Om) dt. The rate of change of tau, divided by Z,
    acts as the disturbance of the control. J_r and c_r are inertia and drag of the drive.

    - `impedance` Z is by default sqrt(k J_b) of the chain: k is the stiffness of all springs in series and J_b the
      inertia below the drive.
    - `surface_gain` is the rate at which the set-point is reached again after a disturbance.

    The torque u = u_eq - J_r (1.5 L^(1/2) |s|^(1/2) sgn(s) - v), v' = -1.1 L sgn(s), with L the field
    `disturbance_rate`. The controller does not measure the bit speed.

    Examples
    --------
    >>> from controllers import ImpedanceSuperTwisting
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), Sampled(ImpedanceSuperTwisting(reference="60 rpm"), "10 ms")))
    Closed loop: TorsionalChain, BitRock
      ImpedanceSuperTwisting, sampled every 10 ms: reference 60 rpm, surface_gain 0.2 1/s, reaching_rate 2 rad/s2, inertia
        2122 kg m2, drag 425 N m s/rad, disturbance_rate 4 rad/s3, impedance 420.6 N m s/rad
    """

    measured_signals: ClassVar[tuple[str, ...]] = ("top.speed", "top.load")

    impedance: OptionalQuantity = quantity(None, "N m s/rad", "impedance Z", above=0)

    def design(self, plant):
        """Return a copy of the controller in which the fields `inertia`, `drag` and `impedance` that are None have values from the chain.

        Parameters
        ----------
        plant
            The plant on which the controller is designed.
        """
        law = super().design(plant)
        if law.impedance is not None:
            return law
        try:
            inertia, stiffness = plant.parameter("chain.inertia"), plant.parameter("chain.stiffness")
        except SceneError as error:
            raise SceneError(f"ImpedanceSuperTwisting needs `impedance`: {error}") from None
        return replace(law, impedance=float(np.sqrt(np.sum(inertia[1:]) / np.sum(1.0 / stiffness))))

    def terms(self, signal, angle):
        """Return the rate of the integral term, the surface s, and the equivalent control.

        Parameters
        ----------
        signal
            Function that returns the expression of a signal.
        angle
            Integral of the speed error [rad].

        Returns
        -------
        rate, surface, equivalent
            Casadi expressions [rad/s], [rad/s] and [N m].
        """
        top, load = signal("top.speed", "rad/s"), signal("top.load", "N m")
        error = top - signal("top.reference", "rad/s", default=self.reference)
        return (
            error,
            error + self.surface_gain * angle + load / self.impedance,
            self.drag * top + load - self.inertia * self.surface_gain * error,
        )
