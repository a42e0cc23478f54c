"""What a user forgets in a part, a friction law or a control law of his own is told where it stands, and has no silent effect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from controllers import NormalDither
from models import BlockOnBelt
from tests.plants import RIG
from toolbox import (
    Component,
    Controller,
    Equations,
    FrictionLaw,
    Sampled,
    SceneError,
    Update,
    closed_loop,
    compose,
    quantity,
    simulate,
    state,
)


@dataclass(frozen=True)
class Drive(Controller):
    """A damper; `gives` and `form` say what is wrong with it."""

    measured_signals, actuated_signals = ("top.speed",), ("top.torque",)
    gain: float = quantity(500.0, "N m s/rad", "gain")
    gives: str = "top.torque"

    def outputs(self, signal):
        return {self.gives: (self.gain * (8.0 - signal("top.speed", "rad/s")), "N m")} if self.gives else {}

    def continuous(self, signal):
        return Equations(outputs=self.outputs(signal))

    def sampled(self, signal, period):
        return Update({}, self.outputs(signal))


@dataclass(frozen=True)
class Mistyped(Drive):
    actuated_signals = ("top.torqe",)
    gives: str = "top.torqe"


@dataclass(frozen=True)
class NoUpdate(Drive):
    def sampled(self, signal, period):
        return self.continuous(signal)


@dataclass(frozen=True)
class MemoryByName(Drive):
    def sampled(self, signal, period):
        return Update({"twist": 0.0}, self.outputs(signal))


@dataclass(frozen=True)
class Deciding(Drive):
    def sampled(self, signal, period):
        return Update({}, {"top.torque": (self.gain if signal("top.speed", "rad/s") < 8.0 else 0.0, "N m")})


@dataclass(frozen=True)
class Forgetful(Drive):
    def design(self, plant):
        pass


@pytest.mark.parametrize("period", [None, 0.01], ids=["continuous", "sampled"])
@pytest.mark.parametrize(
    ("law", "words"),
    [
        (
            Drive(gives="top.torqe"),
            "Drive must give `top.torque`, which it declares in `actuated_signals`, but `{form}` gives only `top.torqe`",
        ),
        (Drive(gives=""), "Drive must give `top.torque`, which it declares in `actuated_signals`, but `{form}` gives nothing"),
        (Mistyped(), "Mistyped drives `top.torqe`, which no part of the machine needs: did you mean `top.torque`"),
        (NormalDither(load="bit.wight", mean=5e4), "NormalDither drives `bit.wight`, which no part of the machine needs"),
        (Forgetful(), "`Forgetful.design` must return a control law, but it returned None"),
    ],
    ids=lambda value: type(value).__name__ if isinstance(value, Controller) else "",
)
def test_a_law_without_effect_is_refused(law, words, period):
    assert simulate(RIG, 0.1, controller=Drive(), sample_time=period)["top.torque"][0] == 4000.0
    with pytest.raises(SceneError, match=words.format(form="sampled" if period else "continuous")):
        closed_loop(RIG, law, sample_time=period).variable_numbers()


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (NoUpdate(), "`NoUpdate.sampled` must return Update, but it returned Equations"),
        (Deciding(), "The equations of Deciding decide in Python"),
        (MemoryByName(), "The memory of MemoryByName must map states made with .* but a key is 'twist'"),
    ],
)
def test_what_is_no_update_is_refused(law, words):
    with pytest.raises(SceneError, match=words):
        closed_loop(RIG, Sampled(law, 0.01)).variable_numbers()


def test_a_law_may_drive_what_another_law_needs():
    @dataclass(frozen=True)
    class Inner(Drive):
        def outputs(self, signal):
            return {"top.torque": (self.gain * (signal("top.reference", "rad/s", default=8.0) - signal("top.speed", "rad/s")), "N m")}

    @dataclass(frozen=True)
    class Outer(Controller):
        measured_signals, actuated_signals = (), ("top.reference",)

        def continuous(self, signal):
            return Equations(outputs={"top.reference": (3.0, "rad/s")})

    assert simulate(RIG, 0.1, controller=[Outer(), Inner()])["top.torque"][0] == 1500.0


class Slides(FrictionLaw):
    def sliding(self, speed):
        return 0.3


class SlidesIntoNothing(Slides):
    def sliding(self, speed):
        pass


class Holds(FrictionLaw):
    def breakaway(self):
        return 0.3


class Whole(Holds, Slides):
    pass


def test_what_a_friction_law_lacks_is_named():
    assert simulate(compose(BlockOnBelt(friction=Whole())), 20.0).events
    for law, words in (
        (Slides(), "The friction law Slides must have a method `breakaway`"),
        (Holds(), "The friction law Holds must have a method `sliding`"),
        (SlidesIntoNothing(), "SlidesIntoNothing must return one expression from `sliding`, but it returned None"),
    ):
        with pytest.raises(SceneError, match=words):
            compose(BlockOnBelt(friction=law))


def test_what_a_part_lacks_is_named():
    @dataclass(frozen=True)
    class Nothing(Component):
        pass

    @dataclass(frozen=True)
    class WithoutUnit(Component):
        def equations(self, signal):
            x = state("part.x", "m")
            return Equations(flow={x: -x}, outputs={"part.twice": 2 * x})

    with pytest.raises(SceneError, match="Nothing must have a method `equations"):
        compose(Nothing())
    with pytest.raises(SceneError, match="The signal `part.twice` that WithoutUnit gives must be \\(expression, unit\\)"):
        compose(WithoutUnit())


def test_an_array_of_no_dimension_is_a_number():
    assert simulate(RIG, 1.0, inputs={"top.torque": np.array(1e3)})["top.torque"][-1] == 1e3
