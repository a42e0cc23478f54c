"""Mechanisms beside references that share no code with the toolbox, and beside closed forms: levers, groups of frictions, stops, clutches, given motions."""

import math
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from models import Coulomb, GaussianStribeck, OverrunningDrive, TwoWay, ValveSpool, Viscous
from studies.benchmarks import mechanisms
from studies.benchmarks.mechanism_reference import Clutch, Friction, Reference, Stop
from tests.mechanisms import BrakedShaft
from toolbox import (
    Component,
    DryFriction,
    Equations,
    Quantity,
    SceneError,
    SimulationError,
    UnilateralContact,
    closed_loop,
    compose,
    quantity,
    simulate,
    state,
    sweep,
    time,
)
from toolbox.inputs import sine
from toolbox.measuring import metrics
from toolbox.modelling import OneWayClutch, Relay

METHODS = pytest.mark.parametrize("method", ["event", "taylor", "explicit", "stiff"])


def part(equations):
    """A plant of one part with these equations."""

    @dataclass(frozen=True)
    class Part(Component):
        def equations(self, signal):
            return equations(signal)

    return compose(Part())


def near(run, right, *names):
    """Whether the ends of signals are right to 1e-7 of their largest values."""
    for name, value in zip(names, right, strict=True):
        assert run[name][-1] == pytest.approx(value, abs=2e-7 * max(np.abs(run[name]).max(), abs(value)))


def times(run, element, mode):
    return [event.time for event in run.events if event.element == element and event.after == mode]


@METHODS
def test_a_bearing_and_a_brake_on_one_shaft_are_one_friction_of_both_bounds(method):
    right = Reference(
        [1.0], lambda t, q, v: np.array([4 * math.sin(0.7 * t)]),
        [Friction("bearing", [1.0], 2.0, lambda s: 1 + math.exp(-((s / 0.5) ** 2))), Friction("brake", [1.0], 0.8, lambda s: 0.6)], [0.0], [3.0], 20.0,
    )  # fmt: skip
    loop = closed_loop(compose(BrakedShaft()), start={"shaft.speed": 3.0}, inputs={"drive.torque": sine(0.0, 4.0, 0.7 / (2 * math.pi))})
    run = simulate(loop, 20.0, method=method)
    near(run, [right.q[0], right.v[0]], "shaft.angle", "shaft.speed")
    leaves = (2 * math.pi + math.asin(0.7)) / 0.7
    for element in ("bearing", "brake"):
        rests = [t for t, name, what in right.events if name == element and what == "stops" and 9 < t < 10]
        assert times(run, element, "stick") == pytest.approx(rests, abs=1e-6)
        assert times(run, element, "slip+")[0] == pytest.approx(leaves, abs=1e-6)
    at = run.at(10.0)  # at rest the shares follow the bounds
    assert at["bearing.force"] / at["brake.force"] == pytest.approx(2.0 / 0.8)
    assert at.modes["brake"] == "stick" and run.time_in("brake", "stick") == pytest.approx(run.time_in("bearing", "stick"))


@pytest.mark.parametrize("first", [True, False])
@pytest.mark.parametrize("ratio", [2.0, -2.0])
def test_a_brake_behind_a_gear_holds_by_its_ratio_whichever_is_declared_first(first, ratio):
    """w' = 2 - 1 - |c| 0.3 t while it slides: at rest at 2 / (0.6) = 10/3 s under a press that grows as t, having turned t^2/2 - 0.1 t^3."""

    def equations(signal):
        angle, speed = state("shaft.angle", "rad"), state("shaft.speed", "rad/s")
        bearing, brake = DryFriction("bearing", speed, Coulomb(1.0, 1.0)), DryFriction("brake", ratio * speed, Coulomb(0.4, 0.3), time)
        pull = 2.0 + bearing.force + ratio * brake.force
        return Equations(flow={angle: speed, speed: pull}, elements=[bearing, brake] if first else [brake, bearing])

    run = simulate(part(equations), 10.0)
    assert times(run, "brake", "stick") == pytest.approx([10 / 3], rel=1e-9)
    assert run["shaft.angle"][-1] == pytest.approx((10 / 3) ** 2 / 2 - 0.1 * (10 / 3) ** 3, rel=1e-9)
    assert run.at(3.0).modes["brake"] == ("slip+" if ratio > 0 else "slip-")
    assert run.at(3.0)["brake.force"] == pytest.approx(-math.copysign(0.9, ratio))


def test_each_bound_of_a_group_must_stay_above_zero():
    def equations(signal):
        speed = state("shaft.speed", "rad/s")
        bearing, brake = DryFriction("bearing", speed, Coulomb(1.0, 1.0)), DryFriction("brake", speed, Coulomb(0.4, 0.3), 1 - time)
        return Equations(flow={speed: 2.0 + bearing.force + brake.force}, elements=[bearing, brake])

    with pytest.raises(SimulationError, match=r"bound of `brake` must be >= 0, but it falls below 0 at t = 1 s"):
        simulate(part(equations), 2.0)


@METHODS
def test_a_spool_with_seal_friction_between_stops_moves_as_gauss_says(method):
    right = Reference(
        [0.2], lambda t, q, v: np.array([12 * math.sin(9 * t) - 30 * q[0]]),
        [Friction("seal", [1.0], 2.0, lambda s: 1.2), Stop("upper", [1.0], 0.3, lambda t: 0.1), Stop("lower", [-1.0], 0.3, lambda t: 0.1)],
        [0.02], [0.0], 1.0,
    )  # fmt: skip
    loop = closed_loop(compose(ValveSpool()), start={"spool.position": 0.02}, inputs={"spool.force": sine(0.0, 12.0, 9 / (2 * math.pi))})
    run = simulate(loop, 1.0, method=method)
    near(run, [right.q[0], right.v[0]], "spool.position", "spool.speed")
    assert times(run, "seal", "slip+")[0] == pytest.approx(math.asin((2.0 + 30 * 0.02) / 12) / 9, abs=1e-7)
    strikes = [t for t, name, what in right.events if name == "upper" and what == "strikes"][:3]
    assert [e.time for e in run.events if e.element == "upper"][:3] == pytest.approx(strikes, abs=1e-6)


@METHODS
def test_backlash_with_friction_on_both_sides_moves_as_gauss_says(method):
    def equations(signal):
        x, v, y, u = state("a.x", "m"), state("a.v", "m/s"), state("b.x", "m"), state("b.v", "m/s")
        near_side, far_side = DryFriction("near", v, Coulomb(0.5, 0.4)), DryFriction("far", u, Coulomb(0.8, 0.6))
        push = UnilateralContact("push", x - y - 0.05, v - u, restitution=0.4)
        pull = UnilateralContact("pull", y - x - 0.05, u - v, restitution=0.4)
        given = 4 * ca.sin(2 * time) + near_side.force - push.force + pull.force
        flow = {x: v, v: given, y: u, u: (far_side.force + push.force - pull.force) / 2}
        return Equations(flow=flow, elements=[near_side, far_side, push, pull])

    right = Reference(
        [1.0, 2.0], lambda t, q, v: np.array([4 * math.sin(2 * t), 0.0]),
        [Friction("near", [1.0, 0.0], 0.5, lambda s: 0.4), Friction("far", [0.0, 1.0], 0.8, lambda s: 0.6),
         Stop("push", [1.0, -1.0], 0.4, lambda t: 0.05), Stop("pull", [-1.0, 1.0], 0.4, lambda t: 0.05)], [0.0, 0.0], [0.0, 0.0], 3.0,
    )  # fmt: skip
    run = simulate(part(equations), 3.0, method=method)
    near(run, [*right.q, *right.v], "a.x", "b.x", "a.v", "b.v")
    assert run.events[0].time == pytest.approx(math.asin(0.125) / 2, abs=1e-7)


@METHODS
def test_a_one_way_clutch_locks_drives_and_overruns(method):
    right = Reference(
        [1.0, 2.0],
        lambda t, q, v: np.array([0.5 + 1.5 * math.sin(t), -0.3 * v[1]]),
        [Clutch("clutch", [1.0, -1.0])],
        [0.0, 0.0],
        [0.0, 0.0],
        20.0,
    )
    loop = closed_loop(compose(OverrunningDrive()), inputs={"driver.torque": sine(0.5, 1.5, 1 / (2 * math.pi))})
    run = simulate(loop, 20.0, method=method)
    near(run, right.v, "driver.speed", "driven.speed")
    assert times(run, "clutch", "locked") == pytest.approx([t for t, _, what in right.events if what == "strikes"], abs=1e-6)
    assert times(run, "clutch", "free") == pytest.approx([t for t, _, what in right.events if what == "free"], abs=1e-6)
    assert run["clutch.force"].min() >= -1e-6 and run["clutch.slip"].max() <= 1e-9


def test_a_driving_side_that_starts_faster_than_the_driven_one_is_refused():
    loop = closed_loop(compose(OverrunningDrive()), start={"driver.speed": 1.0})
    with pytest.raises(SimulationError, match=r"slip of the one-way clutch `clutch` must be <= 0 rad/s at the start, but it is 1"):
        simulate(loop, 1.0)


def test_a_ratchet_holds_a_load_and_lets_the_drum_be_wound():
    """A drum that a load pulls back with 2 N m: it stands while the crank gives less, and turns by the rest while it gives more."""

    def equations(signal):
        speed = state("drum.speed", "rad/s")
        pawl = OneWayClutch("pawl", -speed)
        return Equations(flow={speed: 3.0 * ca.sin(time) - 2.0 + pawl.force}, elements=[pawl])

    run = simulate(part(equations), 6.0)
    begins = math.asin(2 / 3)
    ends = brentq(lambda t: 3 * (math.cos(begins) - math.cos(t)) - 2 * (t - begins), 2.0, 5.0)
    assert times(run, "pawl", "free") == pytest.approx([begins], abs=1e-8)
    assert times(run, "pawl", "locked") == pytest.approx([ends], abs=1e-7)
    assert run.at(5.0)["pawl.force"] == pytest.approx(2 - 3 * math.sin(5.0), abs=1e-9)


def test_an_impact_passes_through_a_clutch_that_it_locks():
    """Two shafts of 1 and 2 kg m2; the driving one overruns, the driven one strikes a stop without restitution and stands: the clutch stops both."""

    def equations(signal):
        place, speed, other = state("b.place", "rad"), state("b.speed", "rad/s"), state("a.speed", "rad/s")
        clutch = OneWayClutch("clutch", other - speed)
        stop = UnilateralContact("stop", place - 1.0, speed, restitution=0.0)
        return Equations(flow={place: speed, speed: (clutch.force - stop.force) / 2, other: -clutch.force}, elements=[clutch, stop])

    loop = closed_loop(part(equations), start={"b.speed": 2.0, "a.speed": 1.0})
    run = simulate(loop, 1.0)
    assert run.at(0.4)["a.speed"] == 1.0
    assert run["a.speed"][-1] == 0.0 and run["b.speed"][-1] == 0.0
    assert [e.time for e in run.events if e.element == "stop"] == pytest.approx([0.5])


@METHODS
def test_friction_on_a_prescribed_motion_does_the_work_of_its_law(method):
    def equations(signal):
        work = state("rub.work", "J")
        slip = 0.3 * ca.cos(2 * time) + 0.1
        rub = DryFriction("surface", slip, GaussianStribeck(3.0, 2.0, 0.05))
        return Equations(flow={work: -rub.force * slip}, elements=[rub])

    run = simulate(part(equations), 10.0, method=method)
    turns = sorted(0.5 * (sign * math.acos(-1 / 3) + 2 * math.pi * k) for k in range(5) for sign in (1, -1))
    turns = [t for t in turns if 0 < t < 10]
    assert [e.time for e in run.events] == pytest.approx(turns, abs=1e-8)

    def power(t):
        v = 0.3 * math.cos(2 * t) + 0.1
        return abs(v) * (2 + math.exp(-((v / 0.05) ** 2)))

    ends = [0.0, *turns, 10.0]
    work = sum(quad(power, a, b, epsabs=1e-12, epsrel=1e-12, limit=200)[0] for a, b in pairwise(ends))
    assert run["rub.work"][-1] == pytest.approx(work, rel=1e-7)


def test_a_prescribed_motion_that_stands_still_leaves_the_force_open_and_the_run_says_so():
    def equations(signal):
        work = state("rub.work", "J")
        slip = ca.fmax(0.0, ca.cos(time))
        rub = DryFriction("surface", slip, Coulomb(1.0, 1.0))
        return Equations(flow={work: -rub.force * slip}, elements=[rub])

    with pytest.raises(SimulationError, match=r"slip of `surface` is prescribed and stands still from t = 1.5707963"):
        simulate(part(equations), 3.0)


@METHODS
@pytest.mark.parametrize(("start", "rest"), [((1.0, 1.0), 0.5), ((0.3, -0.7), 0.25)])
def test_relays_that_switch_ever_faster_come_to_rest_together(method, start, rest):
    """x' = 2 (r1 - 26 r2), y' = 2 (26 r1 + r2): |x| + |y| falls by 4 each second while neither slides, so that both are zero at rest."""

    def equations(signal):
        x = state("f.x", "1", 2)
        first, second = Relay("first", x[0], 1.0), Relay("second", x[1], 1.0)
        return Equations(
            flow={x: 2 * ca.vertcat(first.force - 26 * second.force, 26 * first.force + second.force)}, elements=[first, second]
        )

    run = simulate(closed_loop(part(equations), start={"f.x": start}), 1.0, method=method)
    assert run.events[-1].time == pytest.approx(rest, abs=1e-6)
    np.testing.assert_array_equal(run["f.x"][-1], 0.0)
    assert {run.modes[name][-1] for name in ("first", "second")} == {"stick"}


def test_a_relay_through_lags_needs_the_explicit_word():
    """x''' + 3 x'' + 2 x' = -sgn(x) has a cycle of amplitude and period that the harmonic balance sees; without the word it is refused."""

    def equations(signal, **word):
        x = state("r.x", "1", 3)
        relay = Relay("relay", x[0], 1.0, **word)
        return Equations(flow={x: ca.vertcat(x[1], x[2], -3 * x[1] - 2 * x[2] + relay.force)}, elements=[relay])

    with pytest.raises(SceneError, match="higher_degree=True"):
        part(equations)
    run = simulate(closed_loop(part(lambda signal: equations(signal, higher_degree=True)), start={"r.x": (1.0, 0.0, 0.0)}), 60.0)
    assert len(run.events) > 20 and {e.after for e in run.events} == {"slip+", "slip-"}


@METHODS
def test_wagons_that_touch_break_away_when_the_push_reaches_all_their_bounds(method):
    """m v' = t - 3 kinetic from t = 3 static on: after another second v = (3.5 - 2.4) / 3."""

    def equations(signal):
        x, v = state("w.x", "m", 3), state("w.v", "m/s", 3)
        rubs = [DryFriction(f"wheel{i}", v[i], Coulomb(1.0, 0.8)) for i in range(3)]
        buffers = [UnilateralContact(f"buffer{i}", x[i] - x[i + 1], v[i] - v[i + 1], restitution=0.0) for i in range(2)]
        forces = [
            time + rubs[0].force - buffers[0].force,
            rubs[1].force + buffers[0].force - buffers[1].force,
            rubs[2].force + buffers[1].force,
        ]
        return Equations(flow={x: v, v: ca.vertcat(*forces)}, elements=[*rubs, *buffers])

    run = simulate(part(equations), 4.0, method=method)
    assert [e.time for e in run.events] == pytest.approx([3.0] * 3, abs=3e-7)
    np.testing.assert_allclose(run["w.v"][-1], (3.5 - 2.4) / 3, rtol=3e-7)


@METHODS
def test_two_balls_between_two_walls_exchange_what_they_have(method):
    def equations(signal):
        x, v, y, u = state("a.x", "m"), state("a.v", "m/s"), state("b.x", "m"), state("b.v", "m/s")
        left, right = UnilateralContact("left", -1 - x, -v, restitution=1.0), UnilateralContact("right", y - 1, u, restitution=1.0)
        balls = UnilateralContact("balls", x - y, v - u, restitution=1.0)
        return Equations(flow={x: v, v: left.force - balls.force, y: u, u: balls.force - right.force}, elements=[left, balls, right])

    run = simulate(closed_loop(part(equations), start={"a.x": -0.5, "b.x": 0.5, "a.v": 1.0}), 7.3, method=method)
    assert [e.time for e in run.events] == pytest.approx([1.0, 1.5, 2.0, 3.5, 5.0, 5.5, 6.0])
    assert (run["a.x"][-1], run["b.x"][-1], run["a.v"][-1], run["b.v"][-1]) == pytest.approx((-0.8, 0.5, -1.0, 0.0), abs=1e-9)


@METHODS
@pytest.mark.parametrize("accuracy", [1e-3, 1e-4, 1e-6, 1e-10])
@pytest.mark.parametrize(("stroke", "rate", "drift", "laps"), [(0.2, 1.0, 0.03, 2), (0.4, 1.1, 0.1, 4)])
def test_a_pusher_leaves_a_block_that_its_rail_stops_and_finds_it_again(method, accuracy, stroke, rate, drift, laps):
    """The block goes with the pusher, w = stroke (1 - cos rate t) + drift t, while that goes forward, and stays where it turned."""

    def w(t):
        return stroke * (1 - math.cos(rate * t)) + drift * t

    def equations(signal):
        x, v = state("a.x", "m"), state("a.v", "m/s")
        place, pace = stroke * (1 - ca.cos(rate * time)) + drift * time, stroke * rate * ca.sin(rate * time) + drift
        pusher, rail = UnilateralContact("pusher", place - x, pace - v, restitution=0.0), DryFriction("rail", v, Coulomb(1.0, 0.8))
        return Equations(flow={x: v, v: pusher.force + rail.force}, elements=[pusher, rail])

    lap = 2 * math.pi / rate
    stops = (math.pi + math.asin(drift / (stroke * rate))) / rate
    turns = lap - (stops - lap / 2)  # the pusher turns round behind the block, and is before it a lap later
    hit = brentq(lambda t: w(t) - w(stops), turns, stops + lap)
    run = simulate(closed_loop(part(equations), start={"a.v": drift}), stops + (laps - 0.6) * lap, method=method, accuracy=accuracy)
    assert times(run, "rail", "stick") == pytest.approx([stops + k * lap for k in range(laps)], abs=1e-6)
    assert times(run, "pusher", "closed") == pytest.approx([hit + k * lap for k in range(laps - 1)], abs=1e-6)
    assert run["a.x"][-1] == pytest.approx(w(stops + (laps - 1) * lap), rel=1e-7)


@METHODS
def test_a_law_of_its_own_each_way_breaks_away_at_each_bound(method):
    """m v' = A sin t + F: forwards at A sin t = 1 with 0.8 + 0.1 v, backwards at 3 with 2."""

    def equations(signal):
        x, v = state("b.x", "m"), state("b.v", "m/s")
        rub = DryFriction("rub", v, TwoWay(Viscous(Coulomb(1.0, 0.8), 0.1), Coulomb(3.0, 2.0)))
        return Equations(flow={x: v, v: 4 * ca.sin(time) + rub.force}, elements=[rub])

    right = Reference(
        [1.0], lambda t, q, v: np.array([4 * math.sin(t)]),
        [Friction("rub", [1.0], 1.0, lambda s: 0.8 + 0.1 * s, static_back=3.0, kinetic_back=lambda s: 2.0)], [0.0], [0.0], 8.0,
    )  # fmt: skip
    run = simulate(part(equations), 8.0, method=method)
    assert run.events[0].time == pytest.approx(math.asin(0.25), abs=1e-8)
    near(run, [right.q[0], right.v[0]], "b.x", "b.v")
    assert run.at(4.6)["rub.force"] == pytest.approx(2.0)


def test_friction_that_follows_the_transmitted_load_adds_to_what_no_load_causes():
    """A block on a spring, k x, with friction 0.2 + 0.1 |k x|: from x0 it turns at x1 = (x0 (1 - 0.1) - 2 0.2 / ...), by the energy of one swing."""

    def equations(signal):
        x, v = state("b.x", "m"), state("b.v", "m/s")
        idle, loaded = DryFriction("idle", v, Coulomb(0.2, 0.2)), DryFriction("loaded", v, Coulomb(0.1, 0.1), ca.fabs(x))
        return Equations(flow={x: v, v: -x + idle.force + loaded.force}, elements=[idle, loaded])

    run = simulate(closed_loop(part(equations), start={"b.x": 3.0}), 5.0)
    # 0.5 (x0^2 - x1^2) = 0.2 (x0 + x1) + 0.05 (x0^2 + x1^2) with x1 on the other side
    turn = brentq(lambda x1: 0.5 * (9 - x1 * x1) - 0.2 * (3 + x1) - 0.05 * (9 + x1 * x1), 0.0, 3.0)
    first = next(e.time for e in run.events if e.element == "idle")
    assert run.at(first)["b.x"] == pytest.approx(-turn, rel=1e-7)


def refused(*words):
    return pytest.raises(SceneError, match="".join(f"(?=.*{word})" for word in words))


def test_a_load_that_reads_a_share_is_refused_by_name_with_the_remedy():
    def equations(signal):
        x, v, y, u = state("a.x", "m"), state("a.v", "m/s"), state("b.y", "m"), state("b.u", "m/s")
        rail, stop = DryFriction("rail", v, Coulomb(1.0, 1.0)), UnilateralContact("stop", x, v, restitution=0.0)
        side = DryFriction("side", u, Coulomb(0.5, 0.5), stop.force)
        return Equations(flow={x: v, v: rail.force - stop.force + 2.0, y: u, u: side.force + 0.8}, elements=[rail, stop, side])

    with refused("load of `side`", "`stop`", "`rail`", "not unique", "stiffness"):
        part(equations)


def test_a_load_that_reads_one_friction_of_a_group_is_refused_and_one_that_reads_their_sum_is_not():
    def equations(signal, both):
        v, u = state("a.v", "m/s"), state("b.u", "m/s")
        first, second = DryFriction("first", v, Coulomb(1.0, 1.0)), DryFriction("second", v, Coulomb(0.5, 0.5))
        pressed = DryFriction("pressed", u, Coulomb(0.1, 0.1), 5.0 + first.force + (second.force if both else 0.0))
        return Equations(flow={v: first.force + second.force + 1.2, u: pressed.force + 1.0}, elements=[first, second, pressed])

    with refused("load of `pressed`", "`first`, `second`", "sum"):
        part(lambda signal: equations(signal, False))
    run = simulate(part(lambda signal: equations(signal, True)), 1.0)
    assert run["b.u"][-1] == pytest.approx(1.0 - 0.1 * (5.0 - 1.2))


def test_a_ring_of_frictions_is_refused_with_the_remedy():
    def equations(signal):
        v, u = state("a.v", "m/s"), state("b.u", "m/s")
        ground, other, between = (DryFriction(n, s, Coulomb(1.5, 1.0)) for n, s in (("ground", v), ("other", u), ("between", v - u)))
        return Equations(flow={v: time + ground.force + between.force, u: other.force - between.force}, elements=[ground, other, between])

    with refused("`ground`, `other`, `between`", "ring", "not unique"):
        part(equations)


def test_slips_that_one_value_of_a_ratio_makes_the_same_are_refused_with_what_to_change():
    @dataclass(frozen=True)
    class Rolling(Component):
        radius: Quantity = quantity(0.3, "m", "radius of the second wheel")

        def equations(self, signal):
            v, w = state("cart.v", "m/s"), state("wheel.w", "rad/s")
            first, second = (
                DryFriction("first", v - 0.3 * w, Coulomb(1.0, 0.8)),
                DryFriction("second", v - self.radius * w, Coulomb(0.5, 0.4)),
            )
            return Equations(
                flow={v: 1.0 + first.force + second.force, w: -0.3 * first.force - self.radius * second.force}, elements=[first, second]
            )

    with refused("`first`, `second`", "these values of the parameters", "gear ratio", "bristle"):
        compose(Rolling())
    assert simulate(compose(Rolling(radius=0.31)), 1.0)["cart.v"][-1] > 0


def ring(bounds, kinetic=1.0, n=2, pull=lambda: ca.vertcat(time, 0.0), mass=1.0):
    """Bodies on the ground, each of which rubs on every other, too: bounds of the ground, then of the pairs; kinetic: part of each in slip."""

    def equations(signal):
        x, v = state("w.x", "m", n), state("w.v", "m/s", n)
        slips = [*(v[i] for i in range(n)), *(v[i] - v[j] for i in range(n) for j in range(i))]
        rubs = [DryFriction(f"rub{i}", slip, Coulomb(b, kinetic * b)) for i, (slip, b) in enumerate(zip(slips, bounds, strict=True))]
        acting = ca.jacobian(ca.vertcat(*slips), v).T @ ca.vertcat(*[rub.force for rub in rubs])
        return Equations(flow={x: v, v: (pull() + acting) / mass}, elements=rubs)

    return equations


@METHODS
@pytest.mark.parametrize(("bounds", "breaks", "both"), [((1.0, 1.0, 0.5), 1.5, False), ((1.0, 0.3, 0.5), 1.3, True)])
def test_a_ring_gives_way_where_the_weakest_of_its_motions_does(method, bounds, breaks, both):
    """One body alone goes at ground + pair, both together at the sum of the grounds, whichever is less; then v' = t - breaks over the mass that goes."""
    run = simulate(part(ring(bounds)), 2.0, method=method)
    moving = {"rub0", "rub1"} if both else {"rub0", "rub2"}
    assert {e.element for e in run.events[:2]} == moving and len(run.events) >= 2
    assert [e.time for e in run.events[:2]] == pytest.approx([breaks] * 2, abs=1e-8)
    end = run.events[2].time if len(run.events) > 2 else 2.0
    assert run.at(end)["w.v"].ravel()[0] == pytest.approx((end - breaks) ** 2 / (4 if both else 2), rel=1e-7)


@METHODS
@pytest.mark.parametrize(("n", "seed"), [(2, 1), (3, 2), (4, 3)])
def test_rings_that_share_frictions_move_as_gauss_says(method, n, seed):
    """Every body rubs on the ground and on every other one: six frictions hold three bodies, ten hold four."""
    random = np.random.default_rng(seed)
    bounds = random.uniform(0.1, 1.5, n * (n + 1) // 2)
    mean, size, pace, phase = random.uniform([[-0.5], [0.5], [0.5], [0.0]], [[0.5], [4.0], [3.0], [6.0]], (4, n))
    rows = [*np.eye(n), *(np.eye(n)[i] - np.eye(n)[j] for i in range(n) for j in range(i))]
    right = Reference(
        np.full(n, 1.5), lambda t, q, v: mean + size * np.sin(pace * t + phase),
        [Friction(f"rub{i}", row, b, lambda s, b=b: b) for i, (row, b) in enumerate(zip(rows, bounds, strict=True))], np.zeros(n), np.zeros(n), 4.0,
    )  # fmt: skip
    run = simulate(
        part(ring(bounds, n=n, pull=lambda: ca.DM(mean) + ca.DM(size) * ca.sin(ca.DM(pace) * time + phase), mass=1.5)), 4.0, method=method
    )
    scale = np.maximum(right.largest, 1e-2)
    np.testing.assert_allclose(
        np.concatenate([run["w.x"][-1], run["w.v"][-1]]) / scale, np.concatenate([right.q, right.v]) / scale, atol=1e-7
    )
    assert any(right.v) and len(run.events) > 5


def test_only_a_ring_whose_friction_falls_is_refused_and_the_one_that_falls_is_named():
    with refused("`rub0`, `rub1`, `rub2`", "ring", "static friction of `rub0` is above its kinetic", "not unique", "bristle"):
        part(ring((1.0, 1.0, 0.5), kinetic=0.9))
    simulate(part(ring((1.0, 1.0, 0.5))), 0.1)


@dataclass(frozen=True)
class Plates(Component):
    """Two plates on the ground that rub on each other, the friction of the first with its own numbers: a ring."""

    static: Quantity = quantity(0.8, "N", "static friction of the first plate", at_least=0)
    kinetic: Quantity = quantity(0.8, "N", "kinetic friction of the first plate", at_least=0)

    def equations(self, signal):
        v, u = state("shaft.speed", "m/s"), state("plate.speed", "m/s")
        laws = (Coulomb(self.static, self.kinetic), Coulomb(1.5, 1.5), Coulomb(1.1, 1.1))
        first, second, between = (
            DryFriction(*named, law) for named, law in zip((("first", v), ("second", u), ("between", v - u)), laws, strict=True)
        )
        flow = {v: 3.0 + first.force + between.force, u: second.force - between.force}
        return Equations(flow=flow, elements=[first, second, between])


def test_a_ring_is_asked_again_where_its_numbers_change():
    """The first plate slides at 3 - 0.8 - 1.1 N on 1 kg, the other one stays: 1.1 N on it are less than its bound of 1.5 N."""
    plant = compose(Plates())
    loop = closed_loop(plant)
    what = ("ring", "static friction of `first` is above its kinetic", "not unique")
    for change in (
        lambda: plant.with_parameters({"shaft.kinetic": 0.5}),
        lambda: simulate(plant, 1.0, parameters={"shaft.kinetic": 0.5}),
        lambda: simulate(loop.at("shaft.static", 0.9), 1.0),
        lambda: loop.replace(inputs={"shaft.kinetic": sine(0.5, 0.1, 1.0)}).input_kinds,
    ):
        with refused(*what):
            change()
    found = sweep(loop, {"shaft.kinetic": np.array([0.8, 0.5])}, 1.0, metrics={"speed": metrics.final("shaft.speed")})
    assert found["speed"][0] == pytest.approx(3.0 - 0.8 - 1.1)
    assert list(found.failures) == [1] and all(word in found.failures[1] for word in what)
    both = plant.with_parameters({"shaft.static": 0.5, "shaft.kinetic": 0.5})
    assert simulate(both, 1.0)["shaft.speed"][-1] == pytest.approx(3.0 - 0.5 - 1.1)


@METHODS
def test_a_body_that_can_rest_if_its_neighbour_leaves_rests(method):
    """A wagon pulled by 1.3 N leaves another one, pulled by 0.8 N the same way: both going on together would agree with the forces, too."""

    def equations(signal):
        x, v = state("w.x", "m", 2), state("w.v", "m/s", 2)
        first, second = DryFriction("first", v[0], Coulomb(1.0, 0.9)), DryFriction("second", v[1], Coulomb(1.0, 0.5))
        buffer = UnilateralContact("buffer", x[0] - x[1], v[0] - v[1], restitution=0.0)
        return Equations(
            flow={x: v, v: ca.vertcat(-1.3 + first.force - buffer.force, (-0.8 + second.force + buffer.force) / 0.5)},
            elements=[first, second, buffer],
        )

    run = simulate(part(equations), 1.0, method=method)
    assert run.time_in("second", "stick") == pytest.approx(1.0)
    np.testing.assert_allclose(run["w.x"][-1], [-0.5 * (1.3 - 0.9), 0.0], atol=1e-9)


@METHODS
@pytest.mark.parametrize("accuracy", [1e-6, 1e-9])
@pytest.mark.parametrize("mass", [0.8, 1.3])
def test_a_ratchet_with_friction_lets_go_where_the_pull_reaches_the_bound(method, accuracy, mass):
    """m v' = 2.7 sin t - 0.4 from asin(0.4 / 2.7) on, forwards only: the clutch holds what pulls back, and friction the rest."""

    def equations(signal):
        speed = state("drum.speed", "rad/s")
        pawl, rub = OneWayClutch("pawl", -speed), DryFriction("rub", speed, Coulomb(0.4, 0.4))
        return Equations(flow={speed: (2.7 * ca.sin(time - 1.0) + pawl.force + rub.force) / mass}, elements=[rub, pawl])

    run = simulate(part(equations), 2.0, method=method, accuracy=accuracy)
    begins = 1.0 + math.asin(0.4 / 2.7)
    assert times(run, "rub", "slip+") == pytest.approx([begins], abs=1e-8)
    assert run["drum.speed"][-1] == pytest.approx((2.7 * (math.cos(begins - 1.0) - math.cos(1.0)) - 0.4 * (2.0 - begins)) / mass, rel=1e-7)


def _tied():
    """Random bodies that a clutch ties together: (masses, bounds, ratio, push)."""
    random = np.random.default_rng(1)
    for _ in range(40):
        bounds, ratio = random.uniform(0.1, 1.0, 2), float(random.choice([1.0, 2.0, 0.5]))
        masses = (random.uniform(0.3, 3.0), random.uniform(0.3, 3.0))
        yield masses, bounds, ratio, (bounds[0] + bounds[1] / ratio) / random.uniform(0.5, 0.97)


@METHODS
@pytest.mark.parametrize(("masses", "bounds", "ratio", "push"), [tied for k, tied in enumerate(_tied()) if k in (2, 13, 17, 31, 35, 39)])
def test_bodies_that_a_locked_clutch_ties_together_break_away_together(method, masses, bounds, ratio, push):
    """With the clutch locked x' = i y': M y'' = i (a sin t - b) - c, M = i^2 m + n, from where the push is both bounds on.

    The clutch drives while c + n y'' > 0, that is until the pull has fallen to c (1 - M / n) at most.
    """

    def equations(signal):
        x, y, v, u = state("x", "m"), state("y", "m"), state("v", "m/s"), state("u", "m/s")
        clutch = OneWayClutch("clutch", v - ratio * u, slip_unit="m/s", force_unit="N")
        first, second = (DryFriction(name, slip, Coulomb(b, b)) for name, slip, b in (("first", v, bounds[0]), ("second", u, bounds[1])))
        pull = (push * ca.sin(time) + first.force - clutch.force) / masses[0]
        return Equations(flow={x: v, y: u, v: pull, u: (second.force + ratio * clutch.force) / masses[1]}, elements=[first, second, clutch])

    inertia, bound, whole = ratio**2 * masses[0] + masses[1], ratio * bounds[0] + bounds[1], ratio * push
    leaves = math.asin(bound / whole)

    def speed(t):
        return (whole * (math.cos(leaves) - math.cos(t)) - bound * (t - leaves)) / inertia

    least = (bound - inertia * bounds[1] / masses[1]) / whole
    end = min(math.pi - math.asin(least) if least > -1 else 4.0, brentq(speed, math.pi - leaves, 6.0)) - 0.02
    moved = (
        whole * (math.cos(leaves) * (end - leaves) - math.sin(end) + math.sin(leaves)) / inertia - bound * (end - leaves) ** 2 / 2 / inertia
    )
    run = simulate(part(equations), end, method=method)
    assert run["y"][-1] == pytest.approx(moved, rel=1e-7)
    assert run["u"][-1] == pytest.approx(speed(end), abs=1e-7 * np.abs(run["u"]).max())
    for element in ("first", "second"):
        assert times(run, element, "slip+")[-1] == pytest.approx(leaves, abs=1e-7)
        assert run.at(end).modes[element] == "slip+"


@METHODS
@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9])
def test_a_body_that_comes_to_rest_against_one_at_rest_holds_with_its_static_friction(method, accuracy):
    """The wagon b leans on a, and both rest. It is pulled away by p = t / 2 - 1: it stays until p = 0.9 at 3.8 s, then v' = p - 0.5.

    Both move at w' = -(0.4 + 0.5 + 1 - t / 2) / 2 until they rest, 1 - 0.95 t + t^2 / 8 = 0.
    """

    def equations(signal):
        a, b, v, u = state("a.x", "m"), state("b.x", "m"), state("a.v", "m/s"), state("b.v", "m/s")
        touch = UnilateralContact("touch", a - b, v - u, restitution=0.0)
        first, second = DryFriction("first", v, Coulomb(5.0, 0.4)), DryFriction("second", u, Coulomb(0.9, 0.5))
        return Equations(
            flow={a: v, b: u, v: first.force - touch.force, u: time / 2 - 1 + second.force + touch.force}, elements=[first, second, touch]
        )

    run = simulate(closed_loop(part(equations), start={"a.v": 1.0, "b.v": 1.0}), 5.0, method=method, accuracy=accuracy)
    rest = (0.95 - math.sqrt(0.95**2 - 0.5)) / 0.25
    for element in ("first", "second"):
        assert times(run, element, "stick") == pytest.approx([rest], abs=1e-7)
    assert times(run, "second", "slip+") == pytest.approx([3.8], abs=1e-7)
    assert run["b.v"][-1] == pytest.approx((5.0**2 - 3.8**2) / 4 - 1.5 * 1.2, abs=1e-7)


@pytest.mark.parametrize(("seed", "number"), [(7011, 61), (7012, 131), (555, 83), (20611129, 441), (20611129, 423)])
def test_drawn_mechanisms_whose_contacts_hold_each_other_move_as_gauss_says(seed, number):
    """A stop ties a body to one at rest, an impact locks a clutch, a clutch ties two frictions, bounces end at rest, a row is held: by all methods."""
    assert list(mechanisms.examine(seed, number)) == [("right", "")]
