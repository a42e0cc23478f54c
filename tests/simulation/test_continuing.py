"""Bodies that come to rest, and runs that go on: closed forms for every kind of element, wherever the run is cut."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import pytest

from models import Coulomb
from tests.mechanisms import Ball
from toolbox import (
    Component,
    Controller,
    DryFriction,
    Equations,
    Sampled,
    UnilateralContact,
    Update,
    closed_loop,
    compose,
    quantity,
    simulate,
    state,
    stepper,
)
from toolbox.modelling import Hysteresis, Relay

METHODS = ("event", "taylor", "explicit", "stiff")
METHOD = pytest.mark.parametrize("method", METHODS)


# --- rest


@METHOD
@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.9, 0.995])
def test_a_ball_rests_after_the_sum_of_its_flights_however_long_the_run(restitution, method):
    # t = sqrt(2 h / g) (1 + 2 e + 2 e^2 + ...)
    rest = math.sqrt(2.0 / 9.81) * (1.0 + restitution) / (1.0 - restitution)
    plant = compose(Ball(restitution, gravity=9.81))
    for duration in (1.5 * rest, 60.0 + rest, 1e3, 1e6, 1e9):
        run = simulate(plant, duration, start={"ball.height": 1.0}, method=method)
        assert run.events[-1].after == "closed"
        assert run.events[-1].time == pytest.approx(rest, rel=1e-5)
        assert sum(event.after == "closed" for event in run.events) == 1
        assert abs(run["ball.height"][-1]) < 1e-10


@METHOD
@pytest.mark.parametrize(("length", "time", "mass"), [(1e-6, 1.0, 1.0), (1e6, 1e-6, 1e6), (1.0, 1e6, 1e-6), (1e-6, 1e-6, 1e-6)])
def test_the_rest_scales_with_the_units_of_length_time_and_mass(length, time, mass, method):
    plant = compose(Ball(gravity=9.81 * length / time**2, mass=mass))
    rest = math.sqrt(2.0 / 9.81) * 3.0 * time
    for duration in (2.0 * rest, 1e6 * rest):
        run = simulate(plant, duration, start={"ball.height": length}, method=method)
        assert run.events[-1].after == "closed"
        assert run.events[-1].time == pytest.approx(rest, rel=1e-5)
        after = simulate(plant, rest, start=run.last, method=method)
        assert not after.events
        assert abs(after["ball.height"][-1]) < 1e-10 * length


# --- going on from a contact at rest


@METHOD
def test_a_ball_at_rest_is_lifted_when_the_push_reaches_its_weight_wherever_the_run_is_cut(method):
    # push = 5 N/s t: it leaves at t* = m g / 5, and then m x'' = 5 (t - t*)
    plant, leaves = compose(Ball(gravity=9.81)), 9.81 / 5.0
    arguments = {"inputs": {"ball.push": ([0.0, 10.0], [0.0, 50.0])}, "method": method}
    starts = [{"ball.height": 0.0}, {"ball.height": 1e-3}]  # the second bounces until 0.04 s
    for start in starts:
        for cut in (0.5, 1.0, leaves, np.nextafter(leaves, 0.0), 2.5):
            first = simulate(plant, cut, start=start, **arguments)
            told = first.last.as_told(json.loads(json.dumps(first.last.told())))
            for last in (first.last, told):
                second = simulate(plant, 4.0 - cut, start=last, **arguments)
                lifted = [event.time for event in (*first.events, *second.events) if event.before == "closed"]
                assert lifted == pytest.approx([leaves], abs=1e-6)
                assert second["ball.height"][-1] == pytest.approx(5.0 * (4.0 - leaves) ** 3 / 6.0, rel=1e-5)


def test_start_values_on_the_floor_rest_there_in_the_stepper_too():
    machine = stepper(closed_loop(compose(Ball(gravity=9.81)), start={"ball.height": 0.0}), 0.1, inputs="ball.push", outputs="ball.height")
    assert [float(machine.step(5.0)[0]) for _ in range(20)] == [0.0] * 20
    assert not machine.events
    height = float(machine.step(19.81)[0])  # more than its weight by 10 N for a step
    assert height == pytest.approx(10.0 * 0.1**2 / 2.0, rel=1e-9)


# --- a switch exactly at the cut


@dataclass(frozen=True)
class Pulled(Component):
    """A block on dry ground under a pull, in one or two directions; kinetic friction is half the static bound."""

    directions: int = 1
    static: float = quantity(1.0, "1", above=0)

    def equations(self, signal):
        v = state("block.speed", "m/s", 2 if self.directions == 2 else None)
        rub = DryFriction("element", v, Coulomb(self.static, 0.5 * self.static), 1.0)
        pull = signal("block.pull", "N", default=0.0)
        return Equations({v: (ca.vertcat(0.6 * pull, 0.8 * pull) if self.directions == 2 else pull) + rub.force}, elements=[rub])


@dataclass(frozen=True)
class Led(Component):
    """x' = u, |u| <= 2: from x = 1 m a relay reaches x = 0 after 0.5 s and slides there."""

    def equations(self, signal):
        x = state("led.position", "m")
        relay = Relay("element", x, 2.0)
        return Equations({x: relay.force}, elements=[relay])


@dataclass(frozen=True)
class Filled(Component):
    """A level that rises by 1 m/s to 0.7 m, where its inflow is shut."""

    def equations(self, signal):
        x = state("tank.level", "m")
        switch = Hysteresis("element", x, 0.0, 0.7, signal_unit="m")
        return Equations({x: 1.0 - switch.output}, elements=[switch])


@dataclass(frozen=True)
class Thrown(Component):
    """A body that flies with 1 m/s against a wall 1 m away, a spring of (2 pi)^2 N/m that it leaves after half a second, or a rigid one without restitution."""

    rigid: bool = False

    def equations(self, signal):
        x, v = state("body.position", "m"), state("body.speed", "m/s")
        how = {"restitution": 0.0} if self.rigid else {"stiffness": 4.0 * math.pi**2}
        wall = UnilateralContact("element", x - 1.0, v, **how)
        return Equations({x: v, v: -wall.force}, elements=[wall])


@dataclass(frozen=True)
class Stairs(Controller):
    """u_k = 0.3 k: the fourth sample after the first one is above 1 N."""

    measured_signals = ()
    actuated_signals = ("block.pull",)

    def sampled(self, signal, period):
        count = state("stairs.count", "1")
        return Update(memory={count: count + 1}, outputs={"block.pull": (0.3 * count, "N")})


RAMP = {"inputs": {"block.pull": ([0.0, 10.0], [0.0, 20.0])}}  # 2 N/s
KINDS = {
    "friction": (Pulled(), RAMP, [0.5]),
    "friction in two directions": (Pulled(directions=2), RAMP, [0.5]),
    "friction at a jump": (Pulled(), {"inputs": {"block.pull": ([0.0, 0.5, 0.5, 2.0], [0.0, 0.0, 2.0, 2.0])}}, [0.5]),
    "friction that ends": (Pulled(), {"start": {"block.speed": 0.25}}, [0.5]),
    "friction at a sample": (Pulled(), {"controller": Sampled(Stairs(), 0.125)}, [0.5]),
    "friction at a late sample": (Pulled(), {"controller": Sampled(Stairs(), 0.1, delay=0.15)}, [0.55]),
    "relay": (Led(), {"start": {"led.position": 1.0}}, [0.5]),
    "hysteresis": (Filled(), {}, [0.7]),
    "elastic wall": (Thrown(), {"start": {"body.speed": 1.0}}, [1.0, 1.5]),
    "rigid wall": (Thrown(rigid=True), {"start": {"body.speed": 1.0}}, [1.0]),
}


@METHOD
@pytest.mark.parametrize("kind", KINDS)
def test_a_switch_at_the_cut_is_listed_once_by_the_pieces_together(kind, method):
    part, arguments, right = KINDS[kind]
    plant = compose(part)
    whole = simulate(plant, 2.0, method=method, **arguments)
    located = [event.time for event in whole.events]
    assert located == pytest.approx(right, abs=1e-6)
    for instant in {*located, *right}:
        for cut in (instant, np.nextafter(instant, 0.0), np.nextafter(instant, 9.0), instant * (1 + 1e-10), instant * (1 - 1e-10)):
            first = simulate(plant, float(cut), method=method, **arguments)
            second = simulate(plant, 2.0 - float(cut), method=method, **(arguments | {"start": first.last}))
            both = [*first.events, *second.events]
            assert [(event.before, event.after) for event in both] == [(event.before, event.after) for event in whole.events]
            assert [event.time for event in both] == pytest.approx(right, abs=1e-6)
            np.testing.assert_allclose(second.last.states, whole.last.states, atol=1e-5)
            np.testing.assert_array_equal(second.last.modes, whole.last.modes)


def test_a_contact_that_a_changed_number_tears_loose_at_the_cut_is_listed_there():
    # 0.8 N are held by a static bound of 1 N, not by one of 0.6 N with 0.3 N while sliding
    arguments = {"inputs": {"block.pull": 0.8}}
    first = simulate(compose(Pulled()), 1.0, **arguments)
    second = simulate(compose(Pulled()), 1.0, start=first.last, parameters={"block.static": 0.6}, **arguments)
    assert [(event.time, event.before, event.after) for event in second.events] == [(1.0, "stick", "slip+")]
    assert second["block.speed"][-1] == pytest.approx(0.5, rel=1e-9)
    assert not simulate(compose(Pulled()), 1.0, start=first.last, **arguments).events


# --- an impact beside friction in two directions


@METHOD
def test_an_impact_of_another_body_leaves_a_slide_in_two_directions_as_it_is(method):
    # the block slides straight along its second axis, or backwards along the first, and stops at u / 0.5 whatever the ball does
    plant = compose(Ball(gravity=9.81), replace(Pulled(directions=2)))
    for speed in ((0.0, 0.7), (-0.7, 0.0), (-0.42, 0.56)):
        run = simulate(plant, 3.0, start={"ball.height": 1.0, "block.speed": speed}, method=method)
        own = [(event.before, event.after) for event in run.events if event.element == "element"]
        assert own == [("slip", "stick")]
        assert [event.time for event in run.events if event.element == "element"] == pytest.approx([1.4], abs=1e-5)
