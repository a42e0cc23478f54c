"""A law that declares its `measured_signals` reads nothing else; set-points, which have a default, and what it drives need not be there."""

from dataclasses import dataclass

import pytest

from tests.plants import RIG
from toolbox import Controller, Equations, Quantity, Sampled, SceneError, Update, closed_loop, quantity, simulate
from toolbox.modelling import Takeover


@dataclass(frozen=True)
class OnTheBit(Controller):
    """A drive that reads more than it says: the speed of the bit."""

    measured_signals, actuated_signals = ("top.speed",), ("top.torque",)

    gain: Quantity = quantity(500.0, "N m s/rad", "gain of the bit's speed")

    def _torque(self, signal):
        wanted = signal("top.reference", "rad/s", default=10.0)
        return 2000.0 * (wanted - signal("top.speed", "rad/s")) - self.gain * signal("bit.speed", "rad/s")

    def continuous(self, signal):
        return Equations(outputs={"top.torque": (self._torque(signal), "N m")})

    def sampled(self, signal, period):
        return Update({}, {"top.torque": (self._torque(signal) + 0.0 * signal("top.torque", "N m"), "N m")})


@dataclass(frozen=True)
class Honest(OnTheBit):
    """The same law, which says so."""

    measured_signals = ("top.speed", "bit.speed")


WORDS = r"OnTheBit must declare `bit\.speed` in `measured_signals`, as `{}` reads it, but it declares `top\.speed`"


def test_a_continuous_law_that_reads_more_than_it_declares_is_refused_with_the_signal():
    with pytest.raises(SceneError, match=WORDS.format("continuous")):
        simulate(closed_loop(RIG, OnTheBit()), 1.0)
    assert simulate(closed_loop(RIG, Honest()), 1.0).end == 1.0


def test_a_sampled_law_is_asked_the_same_and_one_that_is_held_by_another_too():
    with pytest.raises(SceneError, match=WORDS.format("sampled")):
        simulate(closed_loop(RIG, Sampled(OnTheBit(), 0.01)), 1.0)
    words = r"Takeover must declare `bit\.speed` in `measured_signals`"
    with pytest.raises(SceneError, match=words):
        simulate(closed_loop(RIG, Sampled(Takeover(OnTheBit(), OnTheBit(), 0.5), 0.01)), 1.0)
    run = simulate(closed_loop(RIG, Sampled(Takeover(Honest(), Honest(), 0.5), 0.01)), 1.0)
    assert run.end == 1.0


@dataclass(frozen=True)
class Undeclared(OnTheBit):
    """The same law, which does not say what it measures."""

    measured_signals = ()


def test_a_law_that_declares_nothing_may_read_any_signal_alone_and_inside_of_another():
    alone = simulate(closed_loop(RIG, Undeclared()), 1.0)
    assert alone["bit.speed"][-1] == simulate(closed_loop(RIG, Honest()), 1.0)["bit.speed"][-1]
    run = simulate(closed_loop(RIG, Sampled(Takeover(Honest(), Undeclared(), 0.5), 0.01)), 1.0)
    assert run.end == 1.0
