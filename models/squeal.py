"""Squeal by mode coupling: constant friction alone makes a pad unstable where it couples two modes of nearly one frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca

from models.friction import Coulomb
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, quantity, state
from toolbox.authoring import entries
from toolbox.modelling import Quantities


@dataclass(frozen=True)
class SquealingPad(Component):
    """Pad on two inclined springs, pressed on a disc: the minimal model of squeal (Hoffmann, Fischer, Allgaier, Ostermeyer 2002).

        m x'' + c x' + k_xx x + k_xy y = F ;   m y'' + c y' + k_xy x + k_yy y = 0 ;   F dry friction against x' - v_disc, load P + k_c y

    x is along the disc and y into it, both from the pressed state at rest without friction; k_xx = sum k_i cos^2 a_i, k_xy = sum k_i sin a_i cos a_i, k_yy =
    k_c + sum k_i sin^2 a_i. F follows the normal force, so sliding turns k_xy of the first line into k_xy - mu k_c: the stiffness is no longer symmetric, and
    beyond `flutter_friction` two modes of one frequency take energy from the disc. The growth ends in stick where damping is enough, as in the defaults, else
    in loss of contact.

    - Gives the signals `pad.position` x, `pad.approach` y [m], `pad.speed`, `pad.approach_speed` [m/s], `pad.normal_force` P + k_c y [N].
    - Contact: `pad`.

    Range: loss of contact is not modelled; a run whose normal force falls below 0 is refused, so keep the preload above k_c |y|. Defaults: the dimensionless
    pad with k_xx = k_yy = 2, k_xy = 1, flutter from mu = 3/4, with damping, preload and speed chosen.

    Examples
    --------
    >>> from models import SquealingPad
    >>> from toolbox import compose
    >>> print(compose(SquealingPad()))
    HybridSystem(SquealingPad): 4 states (pad.position, pad.approach, pad.speed, pad.approach_speed); contacts: pad; inputs: none
    """

    mass: Quantity = quantity(1.0, "kg", "mass of the pad", above=0)
    damping: Quantity = quantity(0.15, "N s/m", "viscous damping c along and across", at_least=0)
    stiffness: Quantities = quantity(
        (2 / 3 * (2 - math.sqrt(3)), 2 / 3 * (2 + math.sqrt(3))), "N/m", "stiffness of the springs", at_least=0
    )
    angle: Quantities = quantity((math.radians(150), math.radians(30)), "rad", "inclination of the springs to the disc")
    contact_stiffness: Quantity = quantity(4 / 3, "N/m", "stiffness k_c of the contact", at_least=0)
    preload: Quantity = quantity(10.0, "N", "normal force P at rest", at_least=0)
    disc_speed: Quantity = quantity(0.5, "m/s", "speed of the disc under the pad")
    friction: FrictionLaw = Coulomb(static=0.9, kinetic=0.9)

    def check(self):
        entries("pad.angle", self.angle, len(self.stiffness), ", one per spring")

    def equations(self, signal):
        x, y = state("pad.position", "m"), state("pad.approach", "m")
        v, w = state("pad.speed", "m/s"), state("pad.approach_speed", "m/s")
        k_xx, k_xy, k_yy = self._stiffness()
        normal = self.preload + self.contact_stiffness * y
        pad = DryFriction("pad", v - self.disc_speed, self.friction, normal)
        return Equations(
            flow={
                x: v,
                y: w,
                v: (pad.force - self.damping * v - k_xx * x - k_xy * y) / self.mass,
                w: (-self.damping * w - k_xy * x - k_yy * y) / self.mass,
            },
            gives={"pad.normal_force": (normal, "N")},
            elements=[pad],
            stored=self.mass * (v**2 + w**2) / 2 + (k_xx * x**2 + 2 * k_xy * x * y + k_yy * y**2) / 2,
            losses={"friction": -pad.force * (v - self.disc_speed), "damping": self.damping * (v**2 + w**2)},
            supplies={"disc drive": pad.force * self.disc_speed},
        )

    def flutter_friction(self) -> float:
        """The coefficient of friction at which sliding steadily becomes unstable by flutter; inf where no friction in this direction does it.

            mu = [(k_xx - k_yy)^2 + 4 k_xy^2 + 2 (c^2 / m) (k_xx + k_yy)] / (4 |k_xy| k_c)

        For constant friction, where the frequencies meet; the damping, equal in both directions, raises it.
        """
        k_xx, k_xy, k_yy = self._stiffness()
        coupling = float(k_xy) * math.copysign(1.0, self.disc_speed)
        if self.disc_speed == 0 or self.contact_stiffness == 0 or coupling <= 1e-12 * (k_xx + k_yy):  # cos 90 deg is not quite 0
            return math.inf
        numerator = (k_xx - k_yy) ** 2 + 4 * k_xy**2 + 2 * self.damping**2 / self.mass * (k_xx + k_yy)
        return float(numerator / (4 * coupling * self.contact_stiffness))

    def _stiffness(self):
        """k_xx, k_xy, k_yy of springs and contact, of numbers or symbols."""
        springs = [(k, ca.cos(a), ca.sin(a)) for k, a in zip(self.stiffness, self.angle, strict=True)]
        k_xx = sum(k * cos * cos for k, cos, _ in springs)
        k_xy = sum(k * cos * sin for k, cos, sin in springs)
        return k_xx, k_xy, self.contact_stiffness + sum(k * sin * sin for k, _, sin in springs)
