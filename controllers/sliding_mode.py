"""Sliding-mode control of a drill string with an integral surface.

    s = (w_r - Om) + lam int (w_r - Om) dt + lam int (w_r - w_b) dt,   u = u_eq - J_r eta sgn(s)
    u_eq = c_r w_r + tau - J_r lam [(w_r - Om) + (w_r - w_b)],         so that  s' = -eta sgn(s)

tau is the torque of the string on the top drive. On s = 0 the speeds obey the surface whatever the friction at the bit does. Source of the surface: E. M.
Navarro-Lopez, D. Cortes, IEEE Int. Conf. Control Applications 2007 (sliding-mode control of a multi-DOF oilwell drillstring).

Why an ideal form: a boundary layer trades the chatter of sgn for a small offset, and sampling brings the chatter back; the ideal form, a set-valued
relay with true sliding, is the limit both are measured against.

What the surface means: int (w_r - w_b) dt is the twist of a two-inertia string, so that on s = 0 the drive gives way by lam / k times the torque of the string:
it shows the impedance k / lam, and one number sets both this and the rate lam at which the set-point is won back. `ImpedanceSuperTwisting` parts the two.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import casadi as ca

from controllers.bumpless import acting, begun, over
from controllers.torque_limits import TorqueLimits
from toolbox import Equations, Quantity, SceneError, Update, quantity, state
from toolbox.authoring import number, whole
from toolbox.modelling import OptionalQuantity, Relay

MOST_LATE = 100
"""Samples by which a command may be late."""


@dataclass(frozen=True)
class SlidingSurface(TorqueLimits):
    """Base class of the sliding-mode controllers of the top drive: the surface, the equivalent control and their numbers.

    The inertia J_r and the viscous drag c_r of the top drive are read from the plant (`chain.inertia`,
    `chain.top_drag`) if they are not given.

    - Torque limits: if they are given, the term (wanted - command) / (J_r lam) is added to the rate of the integral. s
      then moves as if the torque had been applied (anti-windup).
    - Start: in the sampled form the integral is initialised so that the first command equals the present torque
      (bumpless start, `controllers.bumpless`). It begins at 0 if there is no present torque.
    - `delay_samples`: number of samples by which commands reach the drive later (sampled only). The controller then
      uses the predicted top speed at the arrival of its command, from J_r w' = u - c_r w - tau with the delayed
      commands and the present torque tau of the string. With an observer that predicts by itself (delay compensation)
      it must stay 0.
    """

    measured_signals: ClassVar[tuple[str, ...]] = ("top.speed", "bit.speed", "top.load")

    reference: Quantity = quantity(8.0, "rad/s", "set-point of the speed", typical_range=(0.05, 40.0))
    surface_gain: Quantity = quantity(0.2, "1/s", "weight lam of the integrals in the surface", at_least=0)
    reaching_rate: Quantity = quantity(2.0, "rad/s2", "reaching rate eta", above=0)
    inertia: OptionalQuantity = quantity(None, "kg m2", "inertia J_r of the top drive", above=0, typical_range=(1e-3, math.inf))
    drag: OptionalQuantity = quantity(None, "N m s/rad", "viscous drag c_r on the top drive", at_least=0)
    delay_samples: int = 0

    def check(self):
        super().check()
        whole("delay_samples", self.delay_samples, 0, MOST_LATE)
        if self.limits_known:
            number("surface_gain", self.surface_gain, "1/s", above=0)

    def design(self, plant):
        """Return the law with inertia and drag of the top drive from the plant, unless they are given."""
        try:
            inertia = self.inertia if self.inertia is not None else float(plant.parameter("chain.inertia")[0])
            drag = self.drag if self.drag is not None else plant.parameter("chain.top_drag")
        except SceneError:
            raise SceneError(
                f"{type(self).__name__} needs `inertia` and `drag` of the top drive: give both, or a plant with a `TorsionalChain`."
            ) from None
        return replace(self, inertia=inertia, drag=drag)

    def terms(self, signal, angle):
        """Rate of the integral term, the surface s, and the equivalent control."""
        top, bit, load = signal("top.speed", "rad/s"), signal("bit.speed", "rad/s"), signal("top.load", "N m")
        error = top - signal("top.reference", "rad/s", default=self.reference)
        rate = error + (top - bit)
        equivalent = self.drag * top + load - self.inertia * self.surface_gain * rate
        return rate, error + self.surface_gain * angle, equivalent

    def ahead(self, signal, period, unknown=0.0):
        """Return (signal, memory): measurements with the top speed at the arrival of the command of this sample, and a function that makes
        the memory of a command.

        unknown: acceleration of the top [rad/s2] that the model lacks.
        """
        line = [state(f"slidingmode.waiting{k}", "N m") for k in range(self.delay_samples)]
        drag, load = self.drag, signal("top.load", "N m")
        speed = signal("top.speed", "rad/s")
        for torque in line:
            middle = speed + period / 2 * ((torque - drag * speed - load) / self.inertia + unknown)
            speed = speed + period * ((torque - drag * middle - load) / self.inertia + unknown)

        def arriving(name, unit, default=None):
            return speed if name == "top.speed" else signal(name, unit, default)

        return arriving, lambda command: dict(zip(line, [*line[1:], command], strict=True)) if line else {}

    def started(self, update, signal, starts):
        """The update, begun at these values of its memory and with the torque that acts on its way."""
        waiting = {memory: acting(signal) for memory in update.memory if memory.label.startswith("slidingmode.waiting")}
        return begun(update, signal, "slidingmode", {**starts, **waiting})

    def angle_at(self, signal, surface):
        """Return the integral for a given value of s."""
        return over(surface - self.terms(signal, 0.0)[1], self.surface_gain)

    def lacking(self, signal):
        """Return the excess of the equivalent control over the acting torque, as a fraction of J_r eta, limited to -1 .. 1."""
        return ca.fmin(ca.fmax((self.terms(signal, 0.0)[2] - acting(signal)) / (self.inertia * self.reaching_rate), -1), 1)

    def taken_up(self, rate, wanted, command):
        """Return the rate of the integral, corrected by the part of the command that the drive cannot give."""
        return rate if command is wanted else rate + (wanted - command) / (self.inertia * self.surface_gain)


@dataclass(frozen=True)
class SlidingMode(SlidingSurface):
    """Sliding-mode control of the top drive with a boundary layer: sgn(s) becomes s / boundary_layer for |s| < boundary_layer.

        s = (w_r - Om) + lam int (w_r - Om) dt + lam int (w_r - w_b) dt,   u = u_eq - J_r eta sgn(s)
        u_eq = c_r w_r + tau - J_r lam [(w_r - Om) + (w_r - w_b)],         so that  s' = -eta sgn(s)

    - u is the torque of the drive, w_r the top speed, w_b the bit speed, Om the set-point, and tau the torque of the
      string on the drive.
    - lam is the field `surface_gain`, eta the field `reaching_rate`.
    - The inertia J_r and the drag c_r of the drive are read from the plant, if they are not given.

    The controller runs continuously or sampled.

    Examples
    --------
    >>> from controllers import SlidingMode
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SlidingMode(reference="60 rpm")))
    Closed loop: TorsionalChain, BitRock
      SlidingMode, continuous: reference 60 rpm, surface_gain 0.2 1/s, reaching_rate 2 rad/s2, inertia 2122 kg m2, drag
        425 N m s/rad, boundary_layer 0.4775 rpm
    """

    boundary_layer: Quantity = quantity(0.05, "rad/s", "half-width of the boundary layer", above=0)

    def continuous(self, signal):
        angle = state("slidingmode.angle", "rad")
        rate, s, wanted = self._wanted(signal, angle)
        command, _ = self.limited(wanted)
        return Equations(
            flow={angle: self.taken_up(rate, wanted, command)},
            outputs={"top.torque": (command, "N m"), "slidingmode.surface": (s, "rad/s")},
        )

    def sampled(self, signal, period):
        angle = state("slidingmode.angle", "rad")
        signal, sent = self.ahead(signal, period)
        rate, s, wanted = self._wanted(signal, angle)
        command, memory = self.limited(wanted, period)
        update = Update(
            memory={angle: angle + period * self.taken_up(rate, wanted, command), **sent(command), **memory},
            outputs={"top.torque": (command, "N m"), "slidingmode.surface": (s, "rad/s")},
        )
        return self.started(update, signal, {angle: self.angle_at(signal, self.boundary_layer * self.lacking(signal))})

    def _wanted(self, signal, angle):
        rate, s, equivalent = self.terms(signal, angle)
        saturated = ca.fmin(ca.fmax(s / self.boundary_layer, -1), 1)
        return rate, s, equivalent - self.inertia * self.reaching_rate * saturated


@dataclass(frozen=True)
class IdealSlidingMode(SlidingSurface):
    """Ideal sliding-mode control of the top drive: the sign function is a set-valued relay, so that s = 0 to round-off, without chatter.

        u = u_eq - J_r eta sgn(s),   s = (w_r - Om) + lam int (w_r - Om) dt + lam int (w_r - w_b) dt

    u is the torque of the drive, w_r the top speed, w_b the bit speed and Om the set-point. J_r is the inertia of the
    drive, lam the field `surface_gain`, and eta the field `reaching_rate`. u_eq = c_r w_r + tau - J_r lam [(w_r - Om) +
    (w_r - w_b)] is the torque that keeps s constant, with the drag c_r of the drive and the torque tau of the string on
    the drive.

    The relay is the contact `slidingmode`. In its mode "stick" the surface s = 0 has been reached. The force of the
    contact is then the torque that must be added to u_eq to stay on the surface.

    The controller runs continuously only, and without torque limits.

    Examples
    --------
    >>> from controllers import IdealSlidingMode
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> print(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), IdealSlidingMode(reference="60 rpm")))
    Closed loop: TorsionalChain, BitRock
      IdealSlidingMode, continuous: reference 60 rpm, surface_gain 0.2 1/s, reaching_rate 2 rad/s2, inertia 2122 kg m2,
        drag 425 N m s/rad
    """

    def continuous(self, signal):
        angle = state("slidingmode.angle", "rad")
        rate, s, equivalent = self.terms(signal, angle)
        if self.limits_known:
            raise SceneError("IdealSlidingMode acts without torque limits: leave them out, or use SlidingMode.")
        relay = Relay("slidingmode", s, self.inertia * self.reaching_rate, surface_unit="rad/s", force_unit="N m")
        return Equations(
            flow={angle: rate},
            outputs={"top.torque": (equivalent + relay.force, "N m"), "slidingmode.surface": (s, "rad/s")},
            elements=[relay],
        )
