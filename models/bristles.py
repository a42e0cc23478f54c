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
    """Dahl friction: a spring that yields, F = -N s z, z' = v - |v| s z / mu.

    F is the friction force [N], v the slip speed [m/s], z the deflection of the spring [m], and N the load of the
    contact [N]. s is the field `stiffness` [1/m], per unit of load, and mu the field `kinetic` [1]. From rest the force
    depends only on the distance d: |F| = mu N (1 - exp(-s d / mu)). The break-away force is not higher than the kinetic
    friction mu N, so this friction law does not cause stick-slip.

    Range of validity: any speed.

    Source: P. R. Dahl (1968), with the exponent 1.

    The default values are examples without a source.

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
    """LuGre friction: a bristle (spring) whose force is limited to the Stribeck curve g(|v|), the coefficient of
    friction of the law `steady`.

        F = -N (s0 z + s1 z' + s2 v),   z' = v - s0 |v| z / g(|v|)

    F is the friction force [N], v the slip speed [m/s], z the deflection of the bristle [m] and N the load of the
    contact [N]. s0, s1 and s2 are the fields `stiffness` [1/m], `damping` [s/m] and `viscous` [s/m], per unit of load
    (1/rad and s/rad for rotation).

    - At steady sliding |F| = N (g(|v|) + s2 |v|).
    - |s0 z| never exceeds the static coefficient if its start value is below the static coefficient.
    - The dissipated power is a quadratic form in z and v. It is never negative while |v| <= 4 g(|v|) (s1 + s2) / s1^2.
      Above this speed the bristle can return more energy than it has taken, because s1 is constant.
    - Under a slow pull the break-away force is close to the static bound. The faster the force rises, the lower is the
      break-away force.

    The default values are examples of the size of the block of Leine et al. (`BlockOnBelt`).

    Source: C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, IEEE Trans. Automatic Control 40 (1995) 419-425.

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
    """Dankowicz friction, of asperities (peaks of rough surfaces) that bend by at most z_m: F = -N mu(|v|) z / z_m, z'
    = v - |v| z / z_m.

    F is the friction force [N], v the slip speed [m/s], z the bending of the asperities [m], and N the load of the
    contact [N]. z_m is the field `presliding_displacement` [m] and mu the friction law `steady`.

    - The bending depends only on the distance d [m] that the surfaces have slipped, not on the speed. From rest in one
      direction it is z = z_m (1 - exp(-d / z_m)).
    - The force depends on the bending and on the present speed. After sliding by a few z_m in one direction, |F| = N
      mu(|v|).
    - The model stores no energy. When the motion reverses, z and v have opposite signs for a short distance, and the
      contact then drives the motion.

    This law is a reconstruction. In the source the separation of the surfaces is coupled to the slip. Here the friction
    law `steady` replaces this coupling. The default values are examples without a source.

    Source: H. Dankowicz, ZAMM 79 (1999) 399-409.

    Examples
    --------
    >>> from models import Dankowicz
    >>> law = Dankowicz()
    >>> print([round(float(law.sliding(speed)), 3) for speed in (0.1, 1.0, 10.0)])
    [1.0, 1.0, 1.0]
    """

    presliding_displacement: Quantity = quantity(0.01, "m", "largest deflection z_m (rad for rotation)", above=0)
    steady: FrictionLaw = Coulomb(static=1.0, kinetic=1.0)

    def evolution(self, slip, speed, load, memory):
        z = memory["deflection"]
        return self.steady.sliding(speed) * z / self.presliding_displacement, {
            "deflection": slip - speed * z / self.presliding_displacement
        }

    energies = FrictionLaw.energies
