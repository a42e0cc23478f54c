"""A body without play between two rigid stops: one of them carries what pushes it, and the load passes from one to the other."""

from __future__ import annotations

import dataclasses
import math

import casadi as ca
import numpy as np
import pytest

from tests.lanes.test_lanes import batch
from toolbox import Component, Equations, SimulationError, UnilateralContact, compose, quantity, simulate, state, time
from toolbox.simulation import Explicit, Implicit, TaylorSeries, TimeStepping

METHODS = [Explicit(), TaylorSeries(), Implicit()]


def named(method):
    return type(method).__name__


@dataclasses.dataclass(frozen=True)
class Slot(Component):
    """A body between two stops, which move by `amplitude` sin(2 t) together."""

    mass: float = quantity(1.0, "kg", "mass of the body", above=0)
    play: float = quantity(0.0, "m", "play", at_least=0)
    restitution: float = quantity(0.0, "1", "restitution of both stops", at_least=0)
    amplitude: float = quantity(0.0, "m", "motion of the stops")

    def equations(self, signal):
        x, v = state("body.place", "m"), state("body.speed", "m/s")
        push = signal("body.push", "N", default=1.0)
        stops, speed = self.amplitude * ca.sin(2 * time), 2 * self.amplitude * ca.cos(2 * time)
        left = UnilateralContact("left", stops - x - self.play / 2, speed - v, restitution=self.restitution)
        right = UnilateralContact("right", x - stops - self.play / 2, v - speed, restitution=self.restitution)
        return Equations(flow={x: v, v: (push + left.force - right.force) / self.mass}, elements=[left, right])


@pytest.mark.parametrize("method", [*METHODS, TimeStepping(step=1e-2)], ids=named)
@pytest.mark.parametrize("push", [1.0, -2.0])
def test_a_body_without_play_stays_and_the_stop_that_it_is_pushed_at_carries_the_push(method, push):
    run = simulate(compose(Slot()), 1.0, inputs={"body.push": push}, method=method)
    # a stop that stands against another yields by 1e-13 of its force, which only fixed steps add up
    assert np.abs(run["body.place"]).max() <= (1e-14 if isinstance(method, TimeStepping) else 0.0) and not run["body.speed"].any()
    assert run["right.force"][-1] - run["left.force"][-1] == pytest.approx(push, rel=1e-12)
    assert min(run["right.force"][-1], run["left.force"][-1]) == 0.0


@pytest.mark.parametrize("scale", [1.0, 1e-6, 1e6])
@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize("method", METHODS, ids=named)
def test_a_push_that_turns_passes_from_one_stop_to_the_other_when_it_is_zero(method, restitution, scale):
    """The push is cos(t / scale) on a body of mass scale: to the right until pi / 2, to the left until 3 pi / 2."""
    plant = compose(Slot(mass=scale, restitution=restitution))
    run = simulate(plant, 10.0 * scale, inputs={"body.push": ca.cos(time / scale)}, method=method)
    assert not run["body.place"].any()
    closes = [(event.time / scale, event.element) for event in run.events if event.after == "closed"]
    assert [element for _, element in closes] == ["left", "right", "left"]
    np.testing.assert_allclose([moment for moment, _ in closes], [math.pi / 2, 3 * math.pi / 2, 5 * math.pi / 2], rtol=1e-8)
    assert run["left.force"][-1] == pytest.approx(-math.cos(10.0), rel=1e-6)


@pytest.mark.parametrize("method", METHODS, ids=named)
def test_stops_that_move_take_the_body_along_and_push_it_with_its_inertia(method):
    """x = .1 sin 2t, so that right - left = push - x'' = .3 cos t + .4 sin 2t = cos t (.3 + .8 sin t): it turns at pi / 2, and where sin t = -3/8."""
    run = simulate(
        compose(Slot(amplitude=0.1)),
        10.0,
        start={"body.speed": 0.2},
        inputs={"body.push": 0.3 * ca.cos(time)},
        method=method,
        accuracy=1e-8,
    )
    assert np.abs(run["body.place"] - 0.1 * np.sin(2 * run.time)).max() < 1e-7
    assert run["right.force"][-1] - run["left.force"][-1] == pytest.approx(0.3 * math.cos(10.0) + 0.4 * math.sin(20.0), abs=1e-7)
    turns = [
        math.pi / 2,
        math.pi + math.asin(3 / 8),
        3 * math.pi / 2,
        2 * math.pi - math.asin(3 / 8),
        5 * math.pi / 2,
        3 * math.pi + math.asin(3 / 8),
    ]
    np.testing.assert_allclose([event.time for event in run.events if event.after == "closed"], turns, atol=1e-6)


def test_with_play_the_body_crosses_it_under_the_push():
    """The push cos t takes it off the stop at pi / 2. From rest x'' = cos t takes it back by t - pi / 2 + cos t, which is the play when it arrives."""
    play = 0.1
    run = simulate(compose(Slot(play=play)), 4.0, start={"body.place": play / 2}, inputs={"body.push": ca.cos(time)}, accuracy=1e-10)
    leaves, arrives = (event.time for event in run.events)
    assert leaves == pytest.approx(math.pi / 2, abs=1e-8)
    assert (arrives - math.pi / 2) + math.cos(arrives) == pytest.approx(play, abs=1e-8)


@dataclasses.dataclass(frozen=True)
class Cradle(Component):
    """Three balls of 1 kg in a row."""

    def equations(self, signal):
        x, v = state("balls.place", "m", 3), state("balls.speed", "m/s", 3)
        first, second = (UnilateralContact(f"contact.{i}", x[i] - x[i + 1], v[i] - v[i + 1], restitution=1.0) for i in range(2))
        return Equations(flow={x: v, v: ca.vertcat(-first.force, first.force - second.force, second.force)}, elements=[first, second])


@pytest.mark.parametrize(("gap", "speeds"), [(0.0, (-1 / 3, 2 / 3, 2 / 3)), (1e-13, (0.0, 0.0, 1.0))])
@pytest.mark.parametrize("method", METHODS, ids=named)
def test_balls_that_touch_are_struck_together_and_those_with_a_gap_one_after_the_other(method, gap, speeds):
    """Together: v2 = v3 = v, v1 + 2 v = 1 and v - v1 = 1.  One after the other equal balls exchange their speeds. Both keep momentum and energy."""
    run = simulate(compose(Cradle()), 2.0, start={"balls.place": (-1.0, 0.0, gap), "balls.speed": (1.0, 0.0, 0.0)}, method=method)
    np.testing.assert_allclose(run["balls.speed"][-1], speeds, atol=1e-12)
    assert sum(speeds) == pytest.approx(1.0) and sum(v * v for v in speeds) == pytest.approx(1.0)


def test_lanes_hold_a_body_without_play_too():
    found = batch(compose(Slot()), 3.0, {"body.mass": np.array([0.5, 1.0, 2.0])}, 3, inputs={"body.push": ca.cos(time)})
    assert not found.statuses.any() and not found.states.any() and (found.switches == 2).all()


@dataclasses.dataclass(frozen=True)
class Row(Component):
    """Two bodies in a row between two stops without play, of which one grows heavier as it moves: three contacts hold two motions."""

    def equations(self, signal):
        x, v, y, u = state("a.place", "m"), state("a.speed", "m/s"), state("b.place", "m"), state("b.speed", "m/s")
        left, between, right = (
            UnilateralContact(name, closure, rate, restitution=0.0)
            for name, closure, rate in (("left", -x, -v), ("between", x - y, v - u), ("right", y, u))
        )
        return Equations(
            flow={x: v, v: left.force - between.force, y: u, u: (between.force - right.force + 1.0) / (1 + y**2)},
            elements=[left, between, right],
        )


def test_no_run_ends_in_a_number_that_is_not_finite_without_an_error():
    try:
        run = simulate(compose(Row()), 1.0)
    except SimulationError as failed:
        assert failed.run is not None
    else:
        assert np.isfinite(run.states).all()
