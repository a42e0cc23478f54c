"""A friction law that falls below zero at some speed is refused, with the speed; one that stays above is not."""

from dataclasses import dataclass

import casadi as ca
import pytest

import models
from models import BlockOnBelt, CubicStribeck, LuGre
from tests.refusals import refusals
from toolbox import FrictionLaw, Quantity, SceneError, compose, quantity, simulate


@dataclass(frozen=True)
class Falling(FrictionLaw):
    """mu(v) = 1 - v / speed, which is zero at `speed`."""

    speed: Quantity = quantity(2.5, "m/s", "speed at which nothing is left", above=0)

    def sliding(self, speed):
        return 1 - speed / self.speed

    def breakaway(self):
        return ca.SX(1)


@dataclass(frozen=True)
class Ended(Falling):
    """The same, which ends at zero."""

    def sliding(self, speed):
        return ca.fmax(0, super().sliding(speed))


@dataclass(frozen=True)
class Dropping(FrictionLaw):
    """A law that jumps from 0.4 to a value that its user meant as a drop."""

    beyond: Quantity = quantity(-0.1, "1", "friction beyond 3 m/s")

    def sliding(self, speed, beyond):
        return 0.4 + (self.beyond - 0.4) * beyond

    def break_speeds(self):
        return (3.0,)

    def breakaway(self):
        return ca.SX(0.4)


def test_a_law_that_falls_below_zero_is_refused_with_the_speed_and_the_field_that_holds_it():
    words = r"Field `friction` of BlockOnBelt: The friction law Falling must not fall below zero.* beyond a slip speed of 2\.5 it does, and is -399 "
    with pytest.raises(SceneError, match=words):
        compose(BlockOnBelt(friction=Falling()))
    with pytest.raises(SceneError, match=r"Dropping must not fall below zero.* beyond a slip speed of 3 it does, and is -0\.1 "):
        compose(BlockOnBelt(friction=Dropping()))
    compose(BlockOnBelt(friction=Dropping(0.1)))


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda: compose(BlockOnBelt(friction=Dropping(0.1))).with_parameters({"belt.friction.beyond": -0.2}), "must not fall below zero"),
    (lambda: simulate(compose(BlockOnBelt(friction=Dropping(0.1))), 1.0, parameters={"belt.friction.beyond": -0.2}), "must not fall below zero"),
    (lambda: compose(BlockOnBelt(friction=LuGre(steady=Falling()))), r"Field `steady` of LuGre: The friction law Falling must not"),
)  # fmt: skip


def test_laws_that_stay_above_zero_are_accepted():
    compose(BlockOnBelt(friction=Ended()))
    compose(BlockOnBelt(friction=CubicStribeck(static=0.3, minimum=0.0)))  # touches it
    laws = [kind for kind in vars(models).values() if isinstance(kind, type) and issubclass(kind, FrictionLaw)]
    for name in dir(models):
        kind = getattr(models, name)
        if isinstance(kind, type) and issubclass(kind, FrictionLaw) and kind is not FrictionLaw and kind not in laws:
            laws.append(kind)
    assert len(laws) > 10
    for kind in laws:
        compose(BlockOnBelt(friction=kind()))
