"""Static laws of dry friction: coefficient per unit of load against slip speed.

Every law gives `sliding(|v|)` and the static bound `breakaway()`; the load (a normal force, a weight times a radius, or 1 where the law
is a force itself) belongs to the contact. `decay` has the inverse unit of the slip speed: s/m or s/rad.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from toolbox import FrictionLaw, SceneError, quantity


@dataclass(frozen=True)
class Coulomb(FrictionLaw):
    """Constant kinetic friction below a static bound: mu(v) = kinetic, |F| <= static at rest.

    Range: any speed. Source: textbook.
    """

    static: float = quantity(0.5, "1", "static coefficient", at_least=0)
    kinetic: float = quantity(0.3, "1", "kinetic coefficient", at_least=0)

    def sliding(self, speed):
        return self.kinetic

    def breakaway(self):
        return self.static

    def check(self):
        _static_first(self.static, self.kinetic)


@dataclass(frozen=True)
class Exponential(FrictionLaw):
    """Friction that decays with speed: mu(v) = kinetic + (static - kinetic) exp(-decay |v|).

    The bit law of Navarro-Lopez and Cortes (2007) is this with static 0.8, kinetic 0.5, decay = gamma / v_f = 0.9 s/rad; the law of Larsson
    and Farhang (2016) for two disks has decay = alpha. Range: decay >= 0, from constant friction to a jump.
    """

    static: float = quantity(0.8, "1", "static coefficient", at_least=0)
    kinetic: float = quantity(0.5, "1", "kinetic coefficient at high speed", at_least=0)
    decay: float = quantity(0.9, "s/rad", "decay with slip speed (s/m for translation)", at_least=0)

    def sliding(self, speed):
        return self.kinetic + (self.static - self.kinetic) * ca.exp(-self.decay * speed)

    def breakaway(self):
        return self.static

    def check(self):
        _static_first(self.static, self.kinetic)


@dataclass(frozen=True)
class Transition(FrictionLaw):
    """Friction that falls about one speed: mu(v) = kinetic + (static - kinetic) exp(-(|v| / speed)^4).

    A smooth stand-in for the law of a rotating drill string that drops from static to kinetic at a speed w_c: 94 % of the drop lie between 0.42 and
    1.37 times `speed`. Defaults: mu 0.3, ratio 0.65, w_c = 1.5 rad/s of U. J. F. Aarsnes and R. J. Shor (2018), whose law jumps there.
    """

    static: float = quantity(0.3, "1", "static coefficient, and that below the drop", at_least=0)
    kinetic: float = quantity(0.195, "1", "kinetic coefficient beyond the drop", at_least=0)
    speed: float = quantity(1.5, "rad/s", "slip speed of the drop (m/s for translation)", above=0)

    def sliding(self, speed):
        square = (speed / self.speed) ** 2
        return self.kinetic + (self.static - self.kinetic) * ca.exp(-(square**2))

    def breakaway(self):
        return self.static

    def check(self):
        _static_first(self.static, self.kinetic)


@dataclass(frozen=True)
class Drop(FrictionLaw):
    """Friction that drops at one slip speed: mu = static up to it, kinetic beyond.

    The drop is a break of the law, located as an event; `Transition` is its smooth counterpart. Source: U. J. F. Aarsnes, R. J. Shor (2018),
    with static 0.3, kinetic 0.65 of it and 1.5 rad/s.
    """

    static: float = quantity(0.3, "1", "static coefficient, and that below the drop", at_least=0)
    kinetic: float = quantity(0.195, "1", "kinetic coefficient beyond the drop", at_least=0)
    speed: float = quantity(1.5, "rad/s", "slip speed of the drop (m/s for translation)", above=0)

    def sliding(self, speed, beyond):
        return self.static - (self.static - self.kinetic) * beyond

    def breakaway(self):
        return self.static

    def breaks(self):
        return (self.speed,)

    def check(self):
        _static_first(self.static, self.kinetic)


@dataclass(frozen=True)
class Hyperbolic(FrictionLaw):
    """Friction that falls as a hyperbola: F(v) = static / (1 + decay |v|).

    Leine et al. (1998) use static = 1 N, decay = 3 s/m: the load is then 1. Source: R. I. Leine, D. H. van Campen, A. de Kraker, L. van
    den Steen, Nonlinear Dynamics 16 (1998) 41-54, doi:10.1023/A:1008289604683.
    """

    static: float = quantity(1.0, "N", "static bound", at_least=0)
    decay: float = quantity(3.0, "s/m", "decay with slip speed", at_least=0)

    def sliding(self, speed):
        return self.static / (1 + self.decay * speed)

    def breakaway(self):
        return self.static


@dataclass(frozen=True)
class CubicStribeck(FrictionLaw):
    """Cubic Stribeck law with a minimum: mu(v) = static - 1.5 (static - minimum) [|v|/v_m - (|v|/v_m)^3 / 3].

    mu(v_m) = minimum; beyond v_m friction rises again. Source: J. J. Thomsen, A. Fidlin, Int. J. Non-Linear Mechanics 38 (2003) 389-403,
    doi:10.1016/S0020-7462(01)00073-7.
    """

    static: float = quantity(0.4, "1", "static coefficient", at_least=0)
    minimum: float = quantity(0.25, "1", "smallest kinetic coefficient", at_least=0)
    minimum_speed: float = quantity(0.5, "m/s", "slip speed v_m of the minimum", above=0)

    def sliding(self, speed):
        ratio = speed / self.minimum_speed
        return self.static - 1.5 * (self.static - self.minimum) * (ratio - ratio**3 / 3)

    def breakaway(self):
        return self.static

    def check(self):
        _static_first(self.static, self.minimum)


def _static_first(static: float, kinetic: float) -> None:
    if kinetic > static:
        raise SceneError(f"Argument `kinetic` must be <= the static coefficient {static:g}, but it is {kinetic!r}.")
