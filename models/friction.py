"""Static laws of dry friction: coefficient per unit of load against slip speed.

Every law gives `sliding(|v|)` and the static bound `breakaway()`; the load (a normal force, a weight times a radius, or 1 where the law
is a force itself) belongs to the contact. `decay` has the inverse unit of the slip speed: s/m or s/rad.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import casadi as ca

from toolbox import FrictionLaw, Quantity, SceneError, quantity
from toolbox.modelling import Quantities


class _Static(FrictionLaw):
    """A law whose bound at rest is its coefficient `static`."""

    static: Quantity

    def breakaway(self):
        return self.static


class _Falling(_Static):
    """A law that falls from its static coefficient to a lower one, the field that `_lowest` names."""

    _lowest: ClassVar[str] = "kinetic"

    def check(self):
        least = getattr(self, self._lowest)
        if least > self.static:
            raise SceneError(f"Argument `{self._lowest}` must be <= the static coefficient {self.static:g}, but it is {least!r}.")


@dataclass(frozen=True)
class Coulomb(_Falling):
    """Coulomb friction: constant kinetic friction mu(v) = kinetic, and |F| <= static at rest.

    Range of validity: any speed.

    Source: textbook.

    Examples
    --------
    >>> from models import Coulomb
    >>> law = Coulomb()
    >>> print([round(float(law.sliding(speed)), 3) for speed in (0.1, 1.0, 10.0)])
    [0.3, 0.3, 0.3]
    """

    static: Quantity = quantity(0.5, "1", "static coefficient", at_least=0)
    kinetic: Quantity = quantity(0.3, "1", "kinetic coefficient", at_least=0)

    def sliding(self, speed):
        return self.kinetic


@dataclass(frozen=True)
class Exponential(_Falling):
    """Friction that decays exponentially with the slip speed v: mu(v) = kinetic + (static - kinetic) exp(-decay |v|).

    Special cases:

    - The bit law of Navarro-Lopez and Cortes (2007): static 0.8, kinetic 0.5, decay = gamma / v_f = 0.9 s/rad.
    - The law of Larsson and Farhang (2016) for two disks: decay = alpha.

    Range of validity: decay >= 0. With decay 0 the friction is constant (`static`). With a very large decay it drops to
    `kinetic` at a very low speed.

    Examples
    --------
    >>> from models import Exponential
    >>> law = Exponential()
    >>> print([round(float(law.sliding(speed)), 3) for speed in (0.1, 1.0, 10.0)])
    [0.774, 0.622, 0.5]
    """

    static: Quantity = quantity(0.8, "1", "static coefficient", at_least=0, source="Navarro-Lopez and Cortes (2007)")
    kinetic: Quantity = quantity(0.5, "1", "kinetic coefficient at high speed", at_least=0, source="Navarro-Lopez and Cortes (2007)")
    decay: Quantity = quantity(
        0.9, "s/rad", "decay with slip speed (s/m for translation)", at_least=0, source="Navarro-Lopez and Cortes (2007)"
    )

    def sliding(self, speed):
        return self.kinetic + (self.static - self.kinetic) * ca.exp(-self.decay * speed)


@dataclass(frozen=True)
class SmoothStepFriction(_Falling):
    """Friction that falls smoothly around one speed: mu(v) = kinetic + (static - kinetic) exp(-(|v| / transition_speed)^4).

    This law is a smooth substitute for `StepFriction`, which drops from static to kinetic at one speed, as for a
    rotating drill string. 94 % of the drop lie between 0.42 and 1.37 times `transition_speed`.

    Defaults: `static` 0.3, `kinetic` 0.195 (0.65 times `static`) and `transition_speed` 1.5 rad/s.

    Source: U. J. F. Aarsnes, R. J. Shor (2018), with the default values for a law that jumps at 1.5 rad/s.

    Examples
    --------
    >>> from models import SmoothStepFriction
    >>> law = SmoothStepFriction()
    >>> print([round(float(law.sliding(speed)), 3) for speed in (0.1, 1.0, 10.0)])
    [0.3, 0.281, 0.195]
    """

    static: Quantity = quantity(
        0.3, "1", "static coefficient, and coefficient below the drop", at_least=0, source="Aarsnes and Shor (2018)"
    )
    kinetic: Quantity = quantity(0.195, "1", "kinetic coefficient beyond the drop", at_least=0, source="Aarsnes and Shor (2018)")
    transition_speed: Quantity = quantity(
        1.5, "rad/s", "slip speed of the drop (m/s for translation)", above=0, source="Aarsnes and Shor (2018)"
    )

    def sliding(self, speed):
        square = (speed / self.transition_speed) ** 2
        return self.kinetic + (self.static - self.kinetic) * ca.exp(-(square**2))


@dataclass(frozen=True)
class StepFriction(_Falling):
    """Friction that drops at one slip speed: mu = static up to this speed, kinetic above it.

    The drop is a break of the friction law and is located as an event. `SmoothStepFriction` is a smooth
    substitute without a jump.

    Source: U. J. F. Aarsnes, R. J. Shor (2018), with the default values: `static` 0.3, `kinetic` 0.195 (0.65 times
    `static`) and `drop_speed` 1.5 rad/s.

    Examples
    --------
    >>> from models import BlockOnBelt, StepFriction
    >>> from toolbox import compose, measure, simulate
    >>> run = simulate(compose(BlockOnBelt(friction=StepFriction(drop_speed=0.1))), "60 s")
    >>> print(f"the block sticks for {measure.stuck_ratio(run, 'belt'):.0%} of the time")
    the block sticks for 25% of the time
    """

    static: Quantity = quantity(
        0.3, "1", "static coefficient, and coefficient below the drop", at_least=0, source="Aarsnes and Shor (2018)"
    )
    kinetic: Quantity = quantity(0.195, "1", "kinetic coefficient beyond the drop", at_least=0, source="Aarsnes and Shor (2018)")
    drop_speed: Quantity = quantity(1.5, "rad/s", "slip speed of the drop (m/s for translation)", above=0, source="Aarsnes and Shor (2018)")

    def sliding(self, speed, beyond):
        return self.static - (self.static - self.kinetic) * beyond

    def break_speeds(self):
        return (self.drop_speed,)


@dataclass(frozen=True)
class GaussianStribeck(_Falling):
    """Stribeck friction as used in control engineering: mu(v) = kinetic + (static - kinetic) exp(-(v / stribeck_speed)^2).

    v is the slip speed. The slope is zero at rest and steepest at stribeck_speed / sqrt(2), where mu' = -sqrt(2 / e)
    (static - kinetic) / stribeck_speed. Model viscous friction in the moving part (`drag` of a `BlockOnBelt`).

    Range of validity: any speed.

    Source: B. Armstrong-Helouvry, P. Dupont, C. Canudas de Wit, Automatica 30 (1994) 1083-1138.

    Examples
    --------
    >>> from models import GaussianStribeck
    >>> law = GaussianStribeck()
    >>> print([round(float(law.sliding(speed)), 3) for speed in (0.1, 1.0, 10.0)])
    [1.184, 1.0, 1.0]
    """

    static: Quantity = quantity(1.5, "1", "static coefficient", at_least=0)
    kinetic: Quantity = quantity(1.0, "1", "kinetic coefficient at high speed", at_least=0)
    stribeck_speed: Quantity = quantity(0.1, "m/s", "Stribeck speed v_s (rad/s for rotation)", above=0)

    def sliding(self, speed):
        return self.kinetic + (self.static - self.kinetic) * ca.exp(-((speed / self.stribeck_speed) ** 2))


@dataclass(frozen=True)
class RationalStribeck(_Falling):
    """Friction that falls as a hyperbola and rises again: mu(v) = kinetic + (static - kinetic) / (1 + decay |v|) + quadratic_rise v^2.

    U. Galvanetto and S. R. Bishop write this law, relative to the static friction, as (1 - delta) / (1 + gamma |v|) +
    delta + eta v^2. `Hyperbolic` is the special case kinetic = quadratic_rise = 0.

    Range of validity: any speed.

    Source: K. Popp, P. Stelter, Phil. Trans. R. Soc. Lond. A 332 (1990) 89-105 (blocks on a belt).

    Examples
    --------
    >>> from models import RationalStribeck
    >>> law = RationalStribeck()
    >>> print([round(float(law.sliding(speed)), 3) for speed in (0.1, 1.0, 10.0)])
    [0.331, 0.175, 0.11]
    """

    static: Quantity = quantity(0.4, "1", "static coefficient", at_least=0)
    kinetic: Quantity = quantity(0.1, "1", "level to which the hyperbola falls", at_least=0)
    decay: Quantity = quantity(3.0, "s/m", "decay with slip speed (s/rad for rotation)", at_least=0)
    quadratic_rise: Quantity = quantity(0.0, "s2/m2", "rise with the square of slip speed (s2/rad2 for rotation)", at_least=0)

    def sliding(self, speed):
        return self.kinetic + (self.static - self.kinetic) / (1 + self.decay * speed) + self.quadratic_rise * speed**2


@dataclass(frozen=True)
class Tabulated(_Static):
    """Measured friction as a table: coefficients at slip speeds, linearly interpolated, constant above the last speed.

    The first speed is 0. Its coefficient holds at the beginning of slip and is at most `static`, the bound at rest.
    Every speed of the table is a kink, which is located like an event, so a table does not reduce the accuracy of a
    run.

    Range of validity: tables from a few to some dozens of rows. The default values are examples without a source.

    Examples
    --------
    >>> from models import Tabulated
    >>> law = Tabulated()
    >>> print([round(float(law.sliding(speed)), 3) for speed in (0.1, 1.0, 10.0)])
    [0.3, 0.217, 0.25]
    """

    speeds: Quantities = quantity((0.0, 0.1, 0.5, 2.0), "m/s", "slip speeds, from 0 upwards (rad/s for rotation)", at_least=0)
    coefficients: Quantities = quantity((0.4, 0.3, 0.2, 0.25), "1", "kinetic coefficients at these speeds", at_least=0)
    static: Quantity = quantity(0.4, "1", "static coefficient", at_least=0)

    def sliding(self, speed):
        v, mu = self.speeds, self.coefficients
        slopes = [(b - a) / (w - u) for (u, w), (a, b) in zip(pairwise(v), pairwise(mu), strict=True)]
        turns = [(after - before) * ca.fmax(0, speed - u) for u, (before, after) in zip(v[1:], pairwise([*slopes, 0]), strict=True)]
        return mu[0] + slopes[0] * speed + sum(turns)

    def check(self):
        if len(self.speeds) < 2 or len(self.speeds) != len(self.coefficients):
            raise SceneError(
                f"Argument `speeds` must have as many entries as `coefficients`, 2 or more, but they have {len(self.speeds)} and {len(self.coefficients)}."
            )
        if self.speeds[0] != 0.0 or any(not u < w for u, w in pairwise(self.speeds)):
            raise SceneError(f"Argument `speeds` must begin at 0 and increase, but it is {self.speeds!r}.")
        if self.coefficients[0] > self.static:
            raise SceneError(
                f"Argument `coefficients` must begin with at most the static coefficient {self.static:g}, but it begins with {self.coefficients[0]!r}."
            )


@dataclass(frozen=True)
class Hyperbolic(_Static):
    """Friction that falls as a hyperbola with the slip speed v: mu(v) = static / (1 + decay |v|).

    Leine et al. (1998) use static = 1 N and decay = 3 s/m. With these values the law is a force, and the load of the
    contact is 1.

    Source: R. I. Leine, D. H. van Campen, A. de Kraker, L. van den Steen, Nonlinear Dynamics 16 (1998) 41-54,
    doi:10.1023/A:1008289604683.

    Examples
    --------
    >>> from models import Hyperbolic
    >>> law = Hyperbolic()
    >>> print([round(float(law.sliding(speed)), 3) for speed in (0.1, 1.0, 10.0)])
    [0.769, 0.25, 0.032]
    """

    static: Quantity = quantity(1.0, "N", "static bound", at_least=0, source="Leine et al. (1998)")
    decay: Quantity = quantity(3.0, "s/m", "decay with slip speed", at_least=0, source="Leine et al. (1998)")

    def sliding(self, speed):
        return self.static / (1 + self.decay * speed)


@dataclass(frozen=True)
class CubicStribeck(_Falling):
    """Cubic Stribeck friction with a minimum: mu(v) = static - 1.5 (static - minimum) [|v|/v_m - (|v|/v_m)^3 / 3].

    v is the slip speed and v_m the field `minimum_speed` [m/s]. The minimum is mu(v_m) = minimum. Above the speed v_m
    friction rises again.

    Source: J. J. Thomsen, A. Fidlin, Int. J. Non-Linear Mechanics 38 (2003) 389-403, doi:10.1016/S0020-7462(01)00073-7.

    Examples
    --------
    >>> from models import CubicStribeck
    >>> law = CubicStribeck()
    >>> print([round(float(law.sliding(speed)), 3) for speed in (0.1, 0.5, 1.0)])
    [0.356, 0.25, 0.55]
    """

    static: Quantity = quantity(0.4, "1", "static coefficient", at_least=0)
    minimum: Quantity = quantity(0.25, "1", "smallest kinetic coefficient", at_least=0)
    _lowest: ClassVar[str] = "minimum"
    minimum_speed: Quantity = quantity(0.5, "m/s", "slip speed v_m of the minimum", above=0)

    def sliding(self, speed):
        ratio = speed / self.minimum_speed
        return self.static - 1.5 * (self.static - self.minimum) * (ratio - ratio**3 / 3)


@dataclass(frozen=True)
class Viscous(FrictionLaw):
    """Friction law with an additional viscous term: mu(v) = dry(v) + viscous |v|.

    The law `dry` gives the friction at rest and its change with speed. The viscous term is added during slip only.
    `viscous` is the viscous coefficient per unit of load: for a contact with load 1 its unit is N m s/rad or N s/m. For
    a drag that does not depend on the load, give the body a damper instead of this law.

    Range of validity: viscous >= 0.

    Source: textbook (Stribeck curve).

    Examples
    --------
    >>> from models import Viscous
    >>> law = Viscous()
    >>> print([round(float(law.sliding(speed)), 3) for speed in (0.1, 1.0, 10.0)])
    [0.31, 0.4, 1.3]
    """

    dry: FrictionLaw = Coulomb()
    viscous: Quantity = quantity(0.1, "s/m", "viscous coefficient (s/rad for rotation)", at_least=0)

    def sliding(self, speed, *beyond):
        return self.dry.sliding(speed, *beyond) + self.viscous * speed

    def break_speeds(self):
        return self.dry.break_speeds()

    def breakaway(self):
        return self.dry.breakaway()

    def reverse(self):
        back = self.dry.reverse()
        return self if back is self.dry else Viscous(back, self.viscous)

    def check(self):
        _without_memory(self.dry, "dry")


@dataclass(frozen=True)
class TwoWay(FrictionLaw):
    """Friction with two laws, `forward` for slip > 0 and `backward` for slip < 0, such as a lip seal, a brush, a worm
    gear or a leading brake shoe.

    At rest the force may have any value from -mu_f N to mu_b N, with the static coefficients mu_f and mu_b of the two
    laws and the load N.

    Source: textbook.

    Examples
    --------
    >>> from models import TwoWay
    >>> law = TwoWay()
    >>> print([round(float(law.sliding(speed)), 3) for speed in (0.1, 1.0, 10.0)])
    [0.3, 0.3, 0.3]
    """

    forward: FrictionLaw = Coulomb()
    backward: FrictionLaw = Coulomb(0.3, 0.2)

    def sliding(self, speed, *beyond):
        return self.forward.sliding(speed, *beyond)

    def break_speeds(self):
        return self.forward.break_speeds()

    def breakaway(self):
        return self.forward.breakaway()

    def reverse(self):
        return self.backward

    def check(self):
        _without_memory(self.forward, "forward")
        _without_memory(self.backward, "backward")


def _without_memory(law, field):
    """Raise SceneError for a law with memory, which is no function of the slip speed."""
    if law.memory(1):
        raise SceneError(f"Argument `{field}` must be a law without memory, but {type(law).__name__} has one.")
