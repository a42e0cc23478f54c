"""Ideal sliding modes as set-valued relays: Filippov's equivalent control, reaching times, and the limits that lead there."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

from controllers import IdealSlidingMode, SlidingMode
from models import BitRock, TorsionalChain, wells
from tests.refusals import refusals
from toolbox import Component, Controller, Equations, SceneError, SimulationError, compose, quantity, simulate, state, time
from toolbox.errors import ZenoError
from toolbox.modelling import Relay


@dataclass(frozen=True)
class Switched(Component):
    """v' = d + u, u = -bound sgn(v)."""

    bound: float = quantity(1.0, "m/s2", "bound of the relay", at_least=0)

    def equations(self, signal):
        v = state("mass.speed", "m/s")
        relay = Relay("relay", v, self.bound, surface_unit="m/s", force_unit="m/s2")
        return Equations(flow={v: signal("mass.push", "m/s2", default=0.0) + relay.force}, elements=[relay])


@dataclass(frozen=True)
class Plane(Component):
    """x'' = a x + b x' + d + u with u = -bound sgn(x' + lam x)."""

    spring: float = quantity(2.0, "1/s2", "a")
    damping: float = quantity(0.5, "1/s", "b")
    slope: float = quantity(1.5, "1/s", "lam")
    bound: float = quantity(20.0, "m/s2", "bound of the relay", at_least=0)

    def equations(self, signal):
        x, v = state("plane.x", "m"), state("plane.v", "m/s")
        relay = Relay("relay", v + self.slope * x, self.bound, surface_unit="m/s", force_unit="m/s2")
        push = signal("plane.push", "m/s2", default=0.0)
        return Equations(flow={x: v, v: self.spring * x + self.damping * v + push + relay.force}, elements=[relay])


# --- reaching and holding


@pytest.mark.parametrize("start", [0.7, -0.7])
def test_the_surface_is_reached_after_its_distance_over_the_bound_and_never_left(start):
    run = simulate(compose(Switched()), 2.0, start={"mass.speed": start}, accuracy=1e-10)
    assert [(e.before, e.after) for e in run.events] == [("slip+" if start > 0 else "slip-", "stick")]
    assert run.events[0].time == pytest.approx(0.7, rel=1e-10)
    late = run.at(np.linspace(run.events[0].time, 2.0, 100))
    assert np.all(late["mass.speed"] == 0.0)
    assert np.all(late["relay.force"] == 0.0)


def test_the_force_in_sliding_is_minus_the_disturbance_as_long_as_it_can_be():
    # d = 1.5 sin t exceeds the bound 1 between arcsin(2/3) and pi - ...: there the surface is left, v' = d - 1
    run = simulate(compose(Switched()), 2 * math.pi, inputs={"mass.push": 1.5 * ca.sin(time)}, accuracy=1e-10)
    leave = math.asin(2 / 3)
    assert [(e.before, e.after) for e in run.events][:2] == [("stick", "slip+"), ("slip+", "stick")]
    assert run.events[0].time == pytest.approx(leave, abs=1e-9)
    sliding = run.at(np.linspace(0, leave * 0.999, 50))
    np.testing.assert_allclose(sliding["relay.force"], -1.5 * np.sin(sliding.time), atol=1e-14)
    assert np.all(sliding["mass.speed"] == 0.0)
    t = 2.0
    assert run.at(t)["mass.speed"] == pytest.approx(1.5 * (math.cos(leave) - math.cos(t)) - (t - leave), abs=1e-8)


def test_without_a_bound_there_is_no_sliding():
    run = simulate(compose(Switched(bound=0.0)), 5.0, start={"mass.speed": -1.0}, inputs={"mass.push": 1.0}, accuracy=1e-9)
    assert run.time_in("relay", "stick") == 0.0
    assert run.at(5.0)["mass.speed"] == pytest.approx(4.0, rel=1e-9)


def test_equivalent_control_is_filippovs_convex_combination():
    # u_eq = -(c b)^-1 c (A x + d): on x' = -lam x it is -(a x + b x' + d + lam x')
    run = simulate(compose(Plane()), 6.0, start={"plane.x": 1.0}, inputs={"plane.push": 0.7 * ca.cos(3 * time)}, accuracy=1e-10)
    (reached,) = [event for event in run.events if event.after == "stick"]
    late = run.at(np.linspace(reached.time, 6.0, 200))
    x, v = late["plane.x"], late["plane.v"]
    np.testing.assert_allclose(late["relay.force"], -(2.0 * x + 0.5 * v + 0.7 * np.cos(3 * late.time) + 1.5 * v), atol=1e-12)
    # and the convex combination: u_eq = alpha (-U) + (1 - alpha) U with s' = 0
    rate = 2.0 * x + 0.5 * v + 0.7 * np.cos(3 * late.time) + 1.5 * v
    plus, minus = rate - 20.0, rate + 20.0
    alpha = minus / (minus - plus)
    assert np.all((alpha > 0) & (alpha < 1))
    np.testing.assert_allclose(late["relay.force"], alpha * -20.0 + (1 - alpha) * 20.0, atol=1e-12)


def test_motion_on_the_surface_is_that_of_the_surface_whatever_the_plant():
    for spring, damping in ((2.0, 0.5), (-3.0, 1.0), (0.0, -2.0)):
        run = simulate(compose(Plane(spring=spring, damping=damping)), 6.0, start={"plane.x": 1.0}, accuracy=1e-10)
        reached = run.events[-1].time
        x = run.at(reached)["plane.x"]
        times = np.linspace(reached, 6.0, 100)
        np.testing.assert_allclose(run.at(times)["plane.x"], x * np.exp(-1.5 * (times - reached)), rtol=1e-8)


def test_the_surface_is_zero_to_round_off_and_there_is_no_chatter():
    run = simulate(compose(Plane()), 60.0, start={"plane.x": 1.0}, inputs={"plane.push": 5.0 * ca.sin(3 * time)})
    assert len(run.events) <= 3
    sliding = run.modes["relay"] == "stick"
    surface = run["plane.v"] + 1.5 * run["plane.x"]
    assert np.abs(surface[sliding]).max() <= 4 * np.finfo(float).eps * np.abs(run["plane.x"]).max()


def test_a_surface_that_moves_with_time_is_followed():
    # s = x - sin t: in sliding x = sin t and u = cos t
    @dataclass(frozen=True)
    class Tracker(Component):
        def equations(self, signal):
            x = state("tracker.x", "m")
            relay = Relay("relay", x - ca.sin(time), 3.0)
            return Equations(flow={x: relay.force}, elements=[relay])

    run = simulate(compose(Tracker()), 10.0, start={"tracker.x": 2.0}, accuracy=1e-10)
    reached = run.events[0].time
    assert reached == pytest.approx(2 - 3 * reached - math.sin(reached) + reached, abs=1e-9)  # 2 - 3 t = sin t
    times = np.linspace(reached, 10, 100)
    np.testing.assert_allclose(run.at(times)["tracker.x"], np.sin(times), atol=1e-14)
    np.testing.assert_allclose(run.at(times)["relay.force"], np.cos(times), atol=1e-13)


# --- two relays


@dataclass(frozen=True)
class Spiral(Component):
    """s1' = u1 + k u2, s2' = u2 - k u1, u = -sgn s: straight lines that spiral into the origin for k > 1."""

    twist: float = quantity(2.0, "1", "k")

    def equations(self, signal):
        a, b = state("spiral.a", "1"), state("spiral.b", "1")
        first, second = Relay("first", a, 1.0), Relay("second", b, 1.0)
        return Equations(
            flow={a: first.force + self.twist * second.force, b: second.force - self.twist * first.force}, elements=[first, second]
        )


def test_two_relays_that_spiral_into_the_origin_slide_there_or_end_in_an_error_that_names_them():
    # from (0, 1): each quarter turn takes 1 / (k + 1) of the distance and leaves (k - 1) / (k + 1) = 1/3 of it: infinitely many
    # switches until t = 1/3 (1 + 1/3 + 1/9 + ...) = 1/2. Both may slide on from there, with no force at all
    plant = compose(Spiral())
    try:
        run = simulate(plant, 2.0, start={"spiral.b": 1.0}, accuracy=1e-10)
    except ZenoError as error:
        assert "`first`" in str(error) or "`second`" in str(error)
        assert "t = 0.5 s" in str(error)
        run = error.run
    else:
        assert run.at(2.0)["spiral.a"] == run.at(2.0)["spiral.b"] == 0.0
        assert run.modes["first"][-1] == run.modes["second"][-1] == "stick"
    times = np.unique([event.time for event in run.events])
    np.testing.assert_allclose(times[:12], [0.5 * (1 - 3.0**-k) for k in range(1, 13)], atol=1e-9)
    assert len(run.events) < 300


def test_two_independent_relays_slide_on_the_intersection_of_their_surfaces():
    run = simulate(compose(Spiral(twist=0.0)), 3.0, start={"spiral.a": 2.0, "spiral.b": -1.0}, accuracy=1e-10)
    assert [(event.element, event.after) for event in run.events] == [("second", "stick"), ("first", "stick")]
    np.testing.assert_allclose([event.time for event in run.events], [1.0, 2.0], rtol=1e-10)


# --- on the drill string

RIG = compose(wells.JANSEN_2, BitRock(weight=60_000.0))
REFERENCE = 8.0


def test_the_surface_of_the_drive_is_reached_after_its_distance_over_the_reaching_rate():
    # s' = -eta sgn s whatever the rock does; from rest s = -Om
    run = simulate(RIG, 20.0, controller=IdealSlidingMode(reference=REFERENCE, reaching_rate=2.0), accuracy=1e-10)
    first = next(event for event in run.events if event.element == "idealslidingmode")
    assert (first.before, first.after) == ("slip-", "stick")
    assert first.time == pytest.approx(REFERENCE / 2.0, rel=1e-9)
    before = run.at(np.linspace(0, 3.9, 40))
    np.testing.assert_allclose(before["idealslidingmode.surface"], -REFERENCE + 2.0 * before.time, atol=1e-8)


def test_on_the_surface_s_is_zero_to_round_off_through_every_switch_of_the_bit():
    run = simulate(RIG, 60.0, controller=IdealSlidingMode(reference=3.0), accuracy=1e-9)
    bit = [event for event in run.events if event.element == "bit"]
    assert len(bit) >= 2  # the rock is felt
    late = run.time > 3.0 / 2.0 + 1e-9
    assert np.all(run.modes["idealslidingmode"][late] == "stick")
    size = np.abs(run["top.speed"]).max() + 0.4 * np.abs(run["idealslidingmode.angle"]).max() + 3.0
    assert np.abs(run["idealslidingmode.surface"][late]).max() < 8 * np.finfo(float).eps * size
    assert len([event for event in run.events if event.element == "idealslidingmode"]) == 1


def test_in_sliding_the_force_of_the_relay_is_what_the_equivalent_control_lacks():
    # the law knows the plant exactly, so it lacks nothing; with a drag off by 100 N m s/rad it lacks 100 w_r
    exact = simulate(RIG, 30.0, controller=IdealSlidingMode(reference=REFERENCE), accuracy=1e-9)
    late = exact.at(np.linspace(6, 30, 50))
    assert np.abs(late["idealslidingmode.force"]).max() < 1e-8 * np.abs(late["top.torque"]).max()
    wrong = simulate(RIG, 30.0, controller=IdealSlidingMode(reference=REFERENCE, drag=325.0, inertia=2122.0), accuracy=1e-9)
    late = wrong.at(np.linspace(6, 30, 50))
    np.testing.assert_allclose(late["idealslidingmode.force"], 100.0 * late["top.speed"], rtol=1e-9)


def test_a_boundary_layer_tends_to_the_ideal_form_with_its_width():
    ideal = simulate(RIG, 12.0, controller=IdealSlidingMode(reference=REFERENCE, drag=300.0, inertia=2122.0), accuracy=1e-9)
    times = np.linspace(5, 12, 100)
    distances = []
    for width in (0.2, 0.05, 0.0125):
        run = simulate(
            RIG, 12.0, controller=SlidingMode(reference=REFERENCE, boundary_layer=width, drag=300.0, inertia=2122.0), accuracy=1e-9
        )
        distances.append(np.abs(run.at(times)["top.speed"] - ideal.at(times)["top.speed"]).max())
    ratios = np.array(distances[:-1]) / distances[1:]
    np.testing.assert_allclose(ratios, 4.0, rtol=0.15)


def test_inside_the_boundary_layer_s_settles_where_the_missing_torque_is_balanced():
    # J_r s' = missing - J_r eta s / width, missing = -(125 N m s/rad) w_r
    run = simulate(RIG, 60.0, controller=SlidingMode(reference=REFERENCE, drag=300.0, inertia=2122.0), accuracy=1e-9)
    end = run.at(60.0)
    assert end["slidingmode.surface"] == pytest.approx(-125.0 * end["top.speed"] * 0.05 / (2122.0 * 2.0), rel=1e-3)


def test_a_sampled_switch_chatters_with_its_period_where_the_ideal_one_rests():
    # every sample switches the drive by the full bound, so between two samples its speed changes by eta period
    ideal = simulate(RIG, 60.0, controller=IdealSlidingMode(reference=REFERENCE, reaching_rate=2.0))
    for period in (0.04, 0.01):
        samples = np.arange(55.0, 60.0, period)
        run = simulate(RIG, 60.0, controller=SlidingMode(reference=REFERENCE, reaching_rate=2.0, boundary_layer=1e-4), sample_time=period)
        assert np.abs(np.diff(run.at(samples)["top.speed"])).max() == pytest.approx(2.0 * period, rel=0.2)
        assert np.abs(np.diff(ideal.at(samples)["top.speed"])).max() < 0.2 * 2.0 * period


def test_without_control_the_same_bit_sticks_and_with_the_sliding_mode_it_does_not():
    open_loop = simulate(RIG, 120.0, inputs={"top.torque": 425.0 * 3.0 + 50.0 * 3.0 + 60_000.0 * 0.155575 * 0.52})
    assert open_loop.time_in("bit", "stick", after=60.0) > 1.0
    closed = simulate(RIG, 120.0, controller=IdealSlidingMode(reference=REFERENCE))
    assert closed.time_in("bit", "stick", after=60.0) == 0.0


def test_the_law_reads_the_top_drive_of_the_plant_it_is_designed_for():
    chain = TorsionalChain(inertia=(500.0, 300.0), top_drag=77.0)
    law = IdealSlidingMode().design(compose(chain, BitRock()))
    assert (law.inertia, law.drag) == (500.0, 77.0)


# --- what is refused


def relay_plant(make):
    @dataclass(frozen=True)
    class Bad(Component):
        def equations(self, signal):
            x, v = state("bad.x", "m"), state("bad.v", "m/s")
            flow, relay = make(x, v)
            return Equations(flow=dict(zip((x, v), flow, strict=True)), elements=[relay])

    return Bad()


def with_relay(surface, flow):
    def make(x, v):
        relay = Relay("switch", surface(x, v), 1.0)
        return flow(x, v, relay.force), relay

    return make


@pytest.mark.parametrize(
    ("surface", "flow"),
    [
        (lambda x, v: x, lambda x, v, u: (v, u)),  # relative degree two
        (lambda x, v: v, lambda x, v, u: (v, -u)),  # wrong sign
        (lambda x, v: x + 0 * v, lambda x, v, u: (v, u)),  # a structural zero
        (lambda x, v: x - v, lambda x, v, u: (v, u)),  # falling with the force
        (lambda x, v: ca.SX(1.0), lambda x, v, u: (v, u)),  # no surface at all
    ],
    ids=["degree two", "wrong sign", "zero", "falling", "constant"],
)
def test_a_relay_without_relative_degree_one_is_refused(surface, flow):
    with pytest.raises(SceneError, match="switch"):
        compose(relay_plant(with_relay(surface, flow)))


def test_a_relay_whose_gain_vanishes_on_its_surface_ends_in_a_typed_error():
    # super-twisting written with a relay, s' = |s|^(1/2) u + w, w' = u / 2, switches infinitely often in finite time: the gain is zero where it should slide
    def make(x, v):
        relay = Relay("switch", x, 1.0)
        return (ca.sqrt(ca.fabs(x)) * relay.force + v, 0.5 * relay.force), relay

    with pytest.raises((SceneError, SimulationError)):
        simulate(compose(relay_plant(make)), 5.0, start={"bad.x": 1.0, "bad.v": 0.3})


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda: simulate(compose(Switched()), 1.0, controller=IdealSlidingMode()), "inertia"),
    (lambda: compose(Switched(bound=-1.0)), "bound"),
    (lambda: simulate(RIG, 1.0, controller=IdealSlidingMode(), sample_time=0.01), "sample_time"),
)  # fmt: skip


def test_a_sign_in_a_flow_is_refused_with_the_advice_to_declare_a_relay():
    class Naive(Component):
        def equations(self, signal):
            v = state("naive.v", "m/s")
            return Equations(flow={v: -ca.sign(v)})

    with pytest.raises(SceneError, match="Relay"):
        simulate(compose(Naive()), 1.0)


def test_a_sign_in_a_continuous_controller_is_refused_too():
    @dataclass(frozen=True)
    class Bang(Controller):
        measured_signals = ("top.speed",)
        actuated_signals = ("top.torque",)

        def continuous(self, signal):
            return Equations(outputs={"top.torque": (1e4 * ca.sign(8.0 - signal("top.speed", "rad/s")), "N m")})

    with pytest.raises(SceneError, match="Relay"):
        simulate(RIG, 1.0, controller=Bang())
