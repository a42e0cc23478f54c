"""Laws of dry friction with the memory of a bristle, for any contact, beside the set-valued laws.

A bristle bends before it slides, so it has no rest: where the set-valued contact stands still, a bristle swings on its stiffness, and it may creep under an
alternating load below the break-away force. In exchange it has the small motion before sliding that machines of precision show. |v| is a kink, on which
steps end; there are no modes. In the limit of a stiff bristle the motion becomes that of the set-valued contact. The force is that of a bristle times the
normal load, as in the models of tyres (C. Canudas de Wit, P. Tsiotras, 1999), so that it holds for loads that change and vanish; in two slip directions the
deflection is a column (E. Velenis, P. Tsiotras, C. Canudas de Wit, 2002). State of a contact `pad`: `pad.deflection` z, [m] or [rad].
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from models.friction import Coulomb, Exponential
from toolbox import FrictionLaw, Quantity, SceneError, quantity


class Bristle(FrictionLaw):
    """A law whose memory is a bristle that yields at the friction of steady sliding: F = -N (s0 z + s1 z' + s2 v), z' = v - s0 |v| z / g(|v|)."""

    stiffness: Quantity
    steady: FrictionLaw  # at which it yields
    damping, viscous = 0.0, 0.0

    def memory(self, directions):
        return {"deflection": ("m", (0.0,) * directions)}

    def sliding(self, speed):
        return self.steady.sliding(speed) + self.viscous * speed

    def breakaway(self):
        return self.steady.breakaway()

    def evolution(self, slip, speed, load, memory):
        z = memory["deflection"]
        rate = slip - self.stiffness * speed * z / self.steady.sliding(speed)
        return self.stiffness * z + self.damping * rate + self.viscous * slip, {"deflection": rate}

    def energies(self, slip, speed, load, memory):
        z, rate = memory["deflection"], self.evolution(slip, speed, load, memory)[1]["deflection"]
        sliding = self.stiffness**2 * speed * ca.sumsqr(z) / self.steady.sliding(speed)
        losses = {"sliding": sliding, "bending": self.damping * ca.dot(rate, slip), "viscous": self.viscous * speed**2}
        return self.stiffness * ca.sumsqr(z) / 2, {name: power for name, power in losses.items() if not ca.SX(power).is_zero()}

    def check(self):
        if self.steady.memory(1) or self.steady.break_speeds():
            raise SceneError(f"Argument `steady` must be a law without memory and without jumps, but it is {self.steady!r}.")
        if not float(self.steady.breakaway()) > 0:
            raise SceneError(f"Argument `steady` must have a static friction > 0, at which bristles yield, but it is {self.steady!r}.")


@dataclass(frozen=True)
class Dahl(Bristle):
    """Dahl's friction: a spring that yields, F = -N s z, z' = v - |v| s z / mu, v the slip.

    From rest the force depends on the distance d alone: |F| = mu N (1 - exp(-s d / mu)). It has no break-away force above mu N, so there is no stick-slip.
    Range: any speed. Source: P. R. Dahl (1968), with the exponent 1. Defaults: chosen.

    Examples
    --------
    >>> from models import Dahl
    >>> law = Dahl()
    >>> print([round(float(law.sliding(speed)), 3) for speed in (0.1, 1.0, 10.0)])
    [1.0, 1.0, 1.0]
    """

    stiffness: Quantity = quantity(
        100.0, "1/m", "stiffness s of the bristles before sliding, per unit of load (1/rad for rotation)", above=0
    )
    kinetic: Quantity = quantity(1.0, "1", "coefficient mu of sliding friction", above=0)

    @property
    def steady(self):
        return Coulomb(self.kinetic, self.kinetic)


@dataclass(frozen=True)
class LuGre(Bristle):
    """LuGre friction: a bristle that yields at the Stribeck curve g(|v|) = mu(|v|) of the law `steady`, v the slip.

        F = -N (s0 z + s1 z' + s2 v),   z' = v - s0 |v| z / g(|v|)

    Sliding steadily, |F| = N (g(|v|) + s2 |v|). |s0 z| never exceeds the static coefficient once it is below. Its losses, a quadratic form in z and v, are
    never negative while |v| <= 4 g(|v|) (s1 + s2) / s1^2; beyond, a constant s1 can give back more than it took. Pulled slowly it breaks away near the static
    bound; the faster the pull, the lower the peak. Source: C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, IEEE Trans. Automatic Control 40 (1995)
    419-425. Defaults: chosen, of the size of Leine's block.

    Examples
    --------
    >>> from models import LuGre
    >>> law = LuGre()
    >>> print([round(float(law.sliding(speed)), 3) for speed in (0.1, 1.0, 10.0)])
    [0.896, 0.62, 0.6]
    """

    stiffness: Quantity = quantity(
        100.0, "1/m", "stiffness s0 of the bristles before sliding, per unit of load (1/rad for rotation)", above=0
    )
    damping: Quantity = quantity(10.0, "s/m", "damping s1 of the bristles, per unit of load (s/rad for rotation)", at_least=0)
    viscous: Quantity = quantity(0.0, "s/m", "viscous drag s2, per unit of load (s/rad for rotation)", at_least=0)
    steady: FrictionLaw = Exponential(static=1.0, kinetic=0.6, decay=3.0)


@dataclass(frozen=True)
class Dankowicz(Bristle):
    """Asperities that bend by at most a reach z_m: F = -N mu(|v|) z / z_m, z' = v - |v| z / z_m, v the slip, mu the law `steady`.

    How far they are bent depends on the distance d alone, from rest z = z_m (1 - exp(-d / z_m)); how hard they pull depends on the present speed. After a few
    z_m of sliding one way, |F| = N mu(|v|). The model stores no energy: pulling back bent asperities costs as much as they gave, so that it drives the contact
    while z and v differ in sign. A reconstruction after H. Dankowicz, ZAMM 79 (1999) 399-409, with a law in place of the separation of the surfaces that the
    source couples to the slip. Defaults: chosen.

    Examples
    --------
    >>> from models import Dankowicz
    >>> law = Dankowicz()
    >>> print([round(float(law.sliding(speed)), 3) for speed in (0.1, 1.0, 10.0)])
    [1.0, 1.0, 1.0]
    """

    reach: Quantity = quantity(0.01, "m", "largest deflection z_m (rad for rotation)", above=0)
    steady: FrictionLaw = Coulomb(static=1.0, kinetic=1.0)

    def evolution(self, slip, speed, load, memory):
        z = memory["deflection"]
        return self.steady.sliding(speed) * z / self.reach, {"deflection": slip - speed * z / self.reach}

    energies = FrictionLaw.energies
