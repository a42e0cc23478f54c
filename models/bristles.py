"""Dynamic laws of dry friction with one bristle state, for comparison with the set-valued contact.

Each is tied to a `Block` in place of a contact. A bristle bends before it slides, so it has no rest: where the set-valued contact stands still, a
bristle swings on its stiffness, and it may creep under an alternating load below the break-away force. In exchange it has the small motion before
sliding that machines of precision show. |v| is a kink, on which steps end; there are no modes. In the limit of a stiff bristle the motion
becomes that of the set-valued contact.

Signals of all: needs `block.speed` [m/s]; gives `bristle.deflection` z [m], `bristle.slip` v [m/s], the speed of the block on the belt, and
`block.attachment` F [N], the friction on the block.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from models.friction import Coulomb, Exponential
from toolbox import Component, Equations, FrictionLaw, Quantity, quantity, state


@dataclass(frozen=True)
class Dahl(Component):
    """Dahl's friction: a spring that yields, F = -s z, z' = v - |v| s z / F_k, v the slip.

    From rest the force depends on the distance d alone: |F| = F_k (1 - exp(-s d / F_k)). It has no break-away force above F_k, so there is no stick-slip.
    Signals: see `models/bristles.py`. Range: any speed. Source: P. R. Dahl (1968), with the exponent 1. Defaults: chosen.
    """

    stiffness: Quantity = quantity(100.0, "N/m", "stiffness s of the bristles before sliding", above=0)
    kinetic: Quantity = quantity(1.0, "N", "force F_k of sliding friction", above=0)
    belt_speed: Quantity = quantity(0.0, "m/s", "speed of the belt")

    def equations(self, signal):
        z = state("bristle.deflection", "m")
        v = signal("block.speed", "m/s") - self.belt_speed
        sliding = ca.fabs(v) * self.stiffness * z / self.kinetic
        force = -self.stiffness * z
        return Equations(
            flow={z: v - sliding},
            gives={"block.attachment": (force, "N"), "bristle.slip": (v, "m/s")},
            stored=self.stiffness * z**2 / 2,
            losses={"sliding": self.stiffness * z * sliding},
            supplies={"belt drive": force * self.belt_speed, "block": -force * (v + self.belt_speed)},
        )


@dataclass(frozen=True)
class LuGre(Component):
    """LuGre friction: a bristle that yields at the Stribeck force g(|v|) = N mu(|v|), v the slip.

        F = -(s0 z + s1 z' + s2 v),   z' = v - s0 |v| z / g(|v|)

    Sliding steadily, |F| = g(|v|) + s2 |v|. |s0 z| never exceeds the static force once it is below. Its losses, a quadratic form in z and v, are
    never negative while |v| <= 4 g(|v|) (s1 + s2) / s1^2; beyond, a constant s1 can give back more than it took. Signals: see
    `models/bristles.py`. Source: C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky (1995). Defaults: chosen, of the size of Leine's block.
    """

    stiffness: Quantity = quantity(100.0, "N/m", "stiffness s0 of the bristles before sliding", above=0)
    damping: Quantity = quantity(10.0, "N s/m", "damping s1 of the bristles", at_least=0)
    viscous: Quantity = quantity(0.0, "N s/m", "viscous drag s2", at_least=0)
    load: Quantity = quantity(1.0, "N", "normal load N; 1 where the law is a force", above=0)
    belt_speed: Quantity = quantity(0.0, "m/s", "speed of the belt")
    friction: FrictionLaw = Exponential(static=1.0, kinetic=0.6, decay=3.0)

    def equations(self, signal):
        z = state("bristle.deflection", "m")
        v = signal("block.speed", "m/s") - self.belt_speed
        speed = ca.fabs(v)
        sliding = self.stiffness * speed * z / (self.load * self.friction.sliding(speed))
        rate = v - sliding
        force = -(self.stiffness * z + self.damping * rate + self.viscous * v)
        return Equations(
            flow={z: rate},
            gives={"block.attachment": (force, "N"), "bristle.slip": (v, "m/s")},
            stored=self.stiffness * z**2 / 2,
            losses={"sliding": self.stiffness * z * sliding, "bending": self.damping * rate * v, "viscous": self.viscous * v**2},
            supplies={"belt drive": force * self.belt_speed, "block": -force * (v + self.belt_speed)},
        )


@dataclass(frozen=True)
class Dankowicz(Component):
    """Asperities that bend by at most a reach z_m: F = -N mu(|v|) z / z_m, z' = v - |v| z / z_m, v the slip.

    How far they are bent depends on the distance d alone, from rest z = z_m (1 - exp(-d / z_m)); how hard they pull depends on the present speed. After a few
    z_m of sliding one way, |F| = N mu(|v|). The model stores no energy: pulling back bent asperities costs as much as they gave, so that it drives the block
    while z and v differ in sign. Signals: see `models/bristles.py`. A reconstruction after H. Dankowicz, ZAMM 79 (1999) 399-409, with a law in place of the
    separation of the surfaces that the source couples to the slip. Defaults: chosen.
    """

    reach: Quantity = quantity(0.01, "m", "largest deflection z_m", above=0)
    load: Quantity = quantity(1.0, "N", "normal load N; 1 where the law is a force", at_least=0)
    belt_speed: Quantity = quantity(0.0, "m/s", "speed of the belt")
    friction: FrictionLaw = Coulomb(static=1.0, kinetic=1.0)

    def equations(self, signal):
        z = state("bristle.deflection", "m")
        v = signal("block.speed", "m/s") - self.belt_speed
        force = -self.load * self.friction.sliding(ca.fabs(v)) * z / self.reach
        return Equations(
            flow={z: v - ca.fabs(v) * z / self.reach},
            gives={"block.attachment": (force, "N"), "bristle.slip": (v, "m/s")},
            losses={"friction": -force * v},
            supplies={"belt drive": force * self.belt_speed, "block": -force * (v + self.belt_speed)},
        )
