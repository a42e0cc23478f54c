"""Where event-driven simulation goes wrong: grazing, hidden crossings, lost loads, overflow, extreme sizes, and long runs."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.optimize import brentq

import toolbox
from controllers import PI
from models import BitRock, BlockOnBelt, Coulomb, Exponential, Hyperbolic, TorsionalChain, wells
from tests.plants import BELT, RIG
from toolbox import Budget, Component, DryFriction, Equations, FrictionLaw, SceneError, SimulationError, compose, quantity, state, time
from toolbox.inputs import sine
from toolbox.simulation.methods import method_of


def simulate(*arguments, method="event", **more):
    """A run of this file that needs a million steps has been trapped, whatever it answers."""
    return toolbox.simulate(*arguments, method=replace(method_of(method), budget=Budget(steps=1_000_000)), **more)


@dataclass(frozen=True)
class Slider(Component):
    """m v' = u + F on a ground that moves with speed g(t), load N(t): everything that can change does."""

    mass: float = quantity(1.0, "kg", "mass", above=0)
    friction: FrictionLaw = Coulomb(static=1.0, kinetic=0.8)

    def equations(self, signal):
        x, v = state("slider.position", "m"), state("slider.speed", "m/s")
        force, load = signal("slider.force", "N", default=0.0), signal("slider.load", "N", default=1.0)
        ground = signal("slider.ground", "m/s", default=0.0)
        pad = DryFriction("pad", v - ground, self.friction, load)
        return Equations(flow={x: v, v: (force + pad.force) / self.mass}, elements=[pad])


def switches(run):
    return [(event.before, event.after) for event in run.events]


def times_of(run):
    return np.array([event.time for event in run.events])


def is_consistent(run, element, static, kinetic=None):
    """Stick: slip 0 and |F| <= static; slip: F against it, up to what an event is located to (1e-5 of the accuracy)."""
    slip, force, mode = run[f"{element}.slip"], run[f"{element}.force"], run.modes[element]
    stuck = mode == "stick"
    assert np.all(slip[stuck] == 0.0)
    assert np.all(np.abs(force[stuck]) <= static * (1 + 1e-9))
    sign = np.where(mode == "slip+", 1.0, -1.0)[~stuck]
    assert np.all(sign * slip[~stuck] >= -1.1 * max(1e-5 * run.accuracy, 1e-13) * np.abs(slip).max(initial=0.0) - 1e-15)
    if kinetic is not None:
        np.testing.assert_allclose(force[~stuck], -sign * kinetic, rtol=1e-12)


# --- two crossings inside one step

ACCURACIES = pytest.mark.parametrize("accuracy", [1e-2, 1e-3, 1e-6, 1e-9])


@ACCURACIES
@pytest.mark.parametrize("peak", [1.001, 1.01, 1.3])
def test_no_peak_of_a_force_is_missed_by_a_block_that_sticks_for_long(accuracy, peak):
    # while it sticks nothing moves, so steps could be as long as the run; the force exceeds the bound in every half-wave
    frequency, cycles = 0.1, 10
    plant = compose(Slider(friction=Coulomb(static=1.0, kinetic=0.9)))
    run = simulate(plant, cycles / frequency, inputs={"slider.force": sine(0.0, peak, frequency)}, accuracy=accuracy)
    released = [event for event in run.events if event.before == "stick"]
    assert len(released) == 2 * cycles
    first = math.asin(1 / peak) / (2 * math.pi * frequency)
    assert released[0].time == pytest.approx(first, abs=max(1e-7, 100 * accuracy * first))
    assert [event.after for event in released] == ["slip+", "slip-"] * cycles


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12])
@pytest.mark.parametrize(("kinetic", "frequency", "cycles", "peak"), [(0.99, 1.0, 100, 1.05), (1.0, 7.3, 50, 1.3), (0.99, 7.3, 50, 1.001)])
def test_no_half_wave_of_a_long_train_is_missed(kinetic, frequency, cycles, peak, accuracy):
    # a method of high order integrates a whole period of a sine in one step, and well; the guard has to be seen all the same
    plant = compose(Slider(friction=Coulomb(static=1.0, kinetic=kinetic)))
    run = simulate(plant, cycles / frequency, inputs={"slider.force": sine(0.0, peak, frequency)}, accuracy=accuracy)
    released = [event for event in run.events if event.before == "stick"]
    assert [event.after for event in released] == ["slip+", "slip-"] * cycles
    first = (np.arange(2 * cycles) / 2 + math.asin(1 / peak) / (2 * math.pi)) / frequency
    np.testing.assert_allclose([event.time for event in released], first, atol=1e-2 / frequency)


@pytest.mark.parametrize("frequency", [0.9772, 1.1828, 1.6819, 2.6349])
def test_a_block_carried_and_shaken_has_the_same_events_at_every_accuracy(frequency):
    # 1 - 0.98 is a small drop of friction: between releases the block sticks for about a period of the force
    plant = compose(BlockOnBelt(stiffness=0.05, belt_speed=0.1, friction=Coulomb(static=1.0, kinetic=0.98)))
    runs = [simulate(plant, 60.0, inputs={"block.force": sine(0.0, 0.91, frequency)}, accuracy=a) for a in (1e-6, 1e-8, 1e-9, 1e-10, 1e-12)]
    assert len({len(run.events) for run in runs}) == 1
    for run in runs:
        np.testing.assert_allclose(times_of(run), times_of(runs[-1]), atol=1e-2)


@ACCURACIES
def test_no_coincidence_of_two_sines_is_missed(accuracy):
    # 0.5 (sin a t + sin b t) exceeds 0.95 only now and then; every crossing is found on a fine grid, without simulation
    a, b, bound = 2.0, 2.3, 0.95
    force = lambda t, sin: 0.5 * (sin(a * t) + sin(b * t))  # noqa: E731
    grid = np.linspace(0, 100, 200_001)
    above = np.abs(force(grid, np.sin)) > bound
    first = grid[np.flatnonzero(np.diff(above.astype(int)) == 1)]
    plant = compose(Slider(friction=Coulomb(static=bound, kinetic=bound)))
    run = simulate(plant, 100.0, inputs={"slider.force": force(time, ca.sin)}, accuracy=accuracy)
    released = [event.time for event in run.events if event.before == "stick"]
    assert len(released) == len(first) > 10
    np.testing.assert_allclose(released, first, atol=1e-3 + 10 * accuracy)


@pytest.mark.parametrize("accuracy", [1e-6, 1e-9])
def test_a_pulse_of_an_expression_inside_a_long_stick_is_not_missed(accuracy):
    # shorter ones, which no step sees, belong into a table, whose nodes are break points
    plant = compose(Slider(friction=Coulomb(static=1.0, kinetic=0.9)))
    run = simulate(plant, 100.0, inputs={"slider.force": 1.5 * ca.exp(-(((time - 37.3) / 2) ** 2))}, accuracy=accuracy)
    assert switches(run)[0] == ("stick", "slip+")
    assert run.events[0].time == pytest.approx(37.3 - 2 * math.sqrt(math.log(1.5)), abs=1e-6)


@ACCURACIES
@pytest.mark.parametrize("width", [1.0, 1e-3, 1e-6])
def test_no_short_pulse_of_a_table_is_missed(accuracy, width):
    # triangle of height 1.5: above the bound 1 in the middle third; nodes are break points
    plant = compose(Slider(friction=Coulomb(static=1.0, kinetic=1.0)))
    table = ((0.0, 50.0, 50.0 + width, 50.0 + 2 * width), (0.0, 0.0, 1.5, 0.0))
    run = simulate(plant, 100.0, inputs={"slider.force": table}, accuracy=accuracy)
    assert switches(run) == [("stick", "slip+"), ("slip+", "stick")]
    assert run.events[0].time == pytest.approx(50.0 + width * 2 / 3, abs=1e-9 * width + 1e-13 * 50)
    # v peaks where the force falls below 1 again, at 4/3 w, with v = (0.5 w / 3); it stops where the areas are equal:
    # 0.25 w / 3 * ... : integral of (f - 1) from 2/3 to 4/3 is 1/2 * 2/3 * 1/2 = 1/6 w; then f - 1 = -1.5 s, and from 2 w on -1
    stop = brentq(lambda s: 1 / 6 - (0.75 * min(s, 2 / 3) ** 2 + max(s - 2 / 3, 0.0)), 0, 5)
    assert run.events[1].time == pytest.approx(50.0 + width * (4 / 3 + stop), abs=max(10 * accuracy * width, 1e-12 * 50))


@ACCURACIES
def test_two_reversals_inside_one_step_of_slip_are_not_missed(accuracy):
    # v = 1 - a t + b t^2 with a dip to -0.001: without friction to speak of, the slip crosses zero twice within 0.09 s of a 40 s parabola
    depth, a = 1e-3, 0.1
    b = a * a / (4 * (1 + depth))
    plant = compose(Slider(friction=Coulomb(static=0.0, kinetic=0.0)))
    run = simulate(plant, 40.0, start={"slider.speed": 1.0}, inputs={"slider.force": ((0.0, 40.0), (-a, -a + 80 * b))}, accuracy=accuracy)
    expected = (a + np.array([-1, 1]) * math.sqrt(a * a - 4 * b)) / (2 * b)
    assert switches(run) == [("slip+", "slip-"), ("slip-", "slip+")]
    # a root of a parabola moves by the error of v over its slope
    np.testing.assert_allclose(times_of(run), expected, atol=max(1e-9, 10 * accuracy / math.sqrt(a * a - 4 * b)))


# --- grazing

EPSILONS = [-1e-3, -1e-6, -1e-9, -1e-12, 0.0, 1e-12, 1e-10, 1e-9, 1e-8, 1e-6, 1e-4, 1e-3]


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-10])
@pytest.mark.parametrize("epsilon", EPSILONS)
def test_a_force_that_grazes_the_bound_neither_freezes_the_block_nor_fires_for_ever(epsilon, accuracy):
    # u = (1 + eps) sin(w t) against static = kinetic = 1: the peak at t = 1 has zero slope; then a pulse that must release it for certain
    w, peak = math.pi / 2, 1 + epsilon
    plant = compose(Slider(friction=Coulomb(static=1.0, kinetic=1.0)))
    force = peak * ca.sin(w * time)
    run = simulate(plant, 2.0, inputs={"slider.force": force}, accuracy=accuracy)
    is_consistent(run, "pad", 1.0, 1.0)
    assert run.modes["pad"][-1] == "stick"
    assert run.at(2.0)["slider.speed"] == 0.0
    if epsilon <= 1e-12:
        assert abs(run.at(2.0)["slider.position"]) < 1e-15
        assert run.time_in("pad", "stick") > 1.9
        return
    begin = math.asin(1 / peak) / w
    speed = lambda t: peak / w * (math.cos(w * begin) - math.cos(w * t)) - (t - begin)  # noqa: E731
    end = brentq(speed, 2 - begin, 2 - begin + 3 * (1 - begin))  # still fast at the downward crossing of the bound, at rest soon after
    way = quad(speed, begin, end, epsabs=1e-18)[0]
    assert run.at(2.0)["slider.position"] == pytest.approx(way, rel=max(1e-2, 20 * accuracy), abs=1e-14)
    if epsilon >= 1e-6:
        assert switches(run) == [("stick", "slip+"), ("slip+", "stick")]
        # at the bound the slope of the force is w sqrt(2 eps): the error of the guard is divided by it
        np.testing.assert_allclose(times_of(run), [begin, end], atol=max(1e-9, accuracy * 100) / math.sqrt(epsilon))


@pytest.mark.parametrize("epsilon", EPSILONS)
def test_after_grazing_the_bound_the_next_real_push_still_frees_the_block(epsilon):
    plant = compose(Slider(friction=Coulomb(static=1.0, kinetic=1.0)))
    push = (1 + epsilon) * ca.sin(math.pi / 2 * time) + 0.5 * ca.fmax(time - 4.5, 0)
    run = simulate(plant, 6.0, inputs={"slider.force": push}, accuracy=1e-8)
    free = brentq(lambda t: (1 + epsilon) * math.sin(math.pi / 2 * t) + 0.5 * (t - 4.5) - 1, 4.6, 5.0)
    assert any(event.before == "stick" and abs(event.time - free) < 1e-6 for event in run.events)
    assert run.at(6.0)["slider.speed"] > 0.1


@pytest.mark.parametrize("epsilon", [1e-3, 1e-6, 1e-9, 1e-12])
def test_with_a_lower_kinetic_friction_the_least_excess_frees_the_block_for_good(epsilon):
    # static 1, kinetic 0.5: once over the bound (beyond its tolerance of 1e-9) the block is gone; below it stays
    plant = compose(Slider(friction=Coulomb(static=1.0, kinetic=0.5)))
    run = simulate(plant, 1.5, inputs={"slider.force": (1 + epsilon) * ca.sin(math.pi / 2 * time)}, accuracy=1e-8)
    if epsilon > 1e-9:
        assert switches(run) == [("stick", "slip+")]
        assert abs(run.events[0].time - 1) < 2 * math.sqrt(2 * epsilon)
    held = simulate(plant, 1.5, inputs={"slider.force": (1 - epsilon) * ca.sin(math.pi / 2 * time)}, accuracy=1e-8)
    assert switches(held) == []


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("kinetic", [1.0, 1 - 1e-6, 0.9])
def test_a_ramp_of_force_starts_a_block_from_rest(kinetic, accuracy):
    # u = 0.3 t: released at t = 1 / 0.3; then v = (1 - kinetic) s + 0.15 s^2
    plant = compose(Slider(friction=Coulomb(static=1.0, kinetic=kinetic)))
    run = simulate(plant, 10.0, inputs={"slider.force": ((0.0, 10.0), (0.0, 3.0))}, accuracy=accuracy)
    assert switches(run) == [("stick", "slip+")]
    assert run.events[0].time == pytest.approx(1 / 0.3, rel=1e-9)
    s = 10 - 1 / 0.3
    assert run.at(10.0)["slider.speed"] == pytest.approx((1 - kinetic) * s + 0.15 * s * s, rel=10 * accuracy)
    assert sum(run.steps) < 1000


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_slow_force_may_hold_a_stuck_string_for_long_at_no_cost(accuracy):
    run = simulate(
        compose(wells.JANSEN_2, BitRock(weight=60_000.0)), 200.0, inputs={"top.torque": ((0.0, 250.0), (0.0, 7000.0))}, accuracy=accuracy
    )
    assert run.time_in("bit", "stick") == 200.0
    assert sum(run.steps) < 20_000


# --- events at awkward instants


def test_an_event_on_an_output_time_is_given_after_the_event():
    # constant deceleration 0.8 from v = 0.8 stops at exactly t = 1; the force 0 then holds it
    plant = compose(Slider())
    for times in ([1.0], [0.5, 1.0, 2.0], np.linspace(0, 2, 9)):
        run = simulate(plant, 2.0, start={"slider.speed": 0.8}, output_times=times, accuracy=1e-9)
        assert switches(run) == [("slip+", "stick")]
        assert run.events[0].time == pytest.approx(1.0, rel=1e-9)
        np.testing.assert_array_equal(run.time, times)
        at_one = int(np.searchsorted(run.time, 1.0))
        assert abs(run["slider.speed"][at_one]) < 1e-8


def test_output_exactly_at_a_located_event_is_its_right_hand_limit():
    events = simulate(BELT, 30.0, accuracy=1e-8).events
    instants = [event.time for event in events]
    run = simulate(BELT, 30.0, accuracy=1e-8, output_times=instants)
    assert [(e.time, e.after) for e in run.events] == [(e.time, e.after) for e in events]
    assert list(run.modes["belt"]) == [event.after for event in events]
    assert [run.at(t)["belt.force"] for t in instants] == pytest.approx(list(run["belt.force"]), rel=1e-12)


def test_an_event_on_the_end_of_the_run_is_found_or_not_but_nothing_breaks():
    for end in (1.0, 1.0 - 1e-15, 1.0 + 2e-15, 1.0 - 1e-12, 1.0 + 1e-12):
        run = simulate(compose(Slider()), end, start={"slider.speed": 0.8}, accuracy=1e-9)
        assert run.time[-1] == end
        assert abs(run.at(end)["slider.speed"]) < 1e-8
        assert len(run.events) <= 1
        assert sum(run.time_in("pad", mode) for mode in ("stick", "slip+", "slip-")) == pytest.approx(end, rel=1e-15)


def test_a_block_at_its_bound_at_the_start_slips_at_once_when_the_force_rises():
    plant = compose(Slider(friction=Coulomb(static=1.0, kinetic=0.5)))
    run = simulate(plant, 1.0, inputs={"slider.force": 1.0 + 0.1 * time}, accuracy=1e-9)
    assert run.time_in("pad", "slip+") == pytest.approx(1.0, abs=1e-8)
    assert run.at(1.0)["slider.speed"] == pytest.approx(0.5 + 0.05, abs=1e-8)
    held = simulate(plant, 1.0, inputs={"slider.force": 1.0 - 0.1 * time}, accuracy=1e-9)
    assert held.time_in("pad", "stick") == 1.0


def test_a_jump_of_force_at_the_start_counts_from_the_start():
    run = simulate(compose(Slider()), 1.0, inputs={"slider.force": ((0.0, 0.0), (0.0, 1.8))}, accuracy=1e-9)
    assert run.at(1.0)["slider.speed"] == pytest.approx(1.0, rel=1e-9)
    assert run.time_in("pad", "stick") == 0.0


def test_jumps_of_force_start_and_stop_a_block_where_they_happen():
    table = ((1.0, 1.0, 2.0, 2.0, 5.0, 5.0), (0.0, 1.8, 1.8, 0.0, 0.0, -1.8))
    run = simulate(compose(Slider()), 6.0, inputs={"slider.force": table}, accuracy=1e-9)
    # v rises to 1 in [1, 2], falls with 0.8 until 3.25, backwards from 5
    assert switches(run) == [("stick", "slip+"), ("slip+", "stick"), ("stick", "slip-")]
    np.testing.assert_allclose(times_of(run), [1.0, 3.25, 5.0], rtol=1e-9)
    assert run.events[0].time == 1.0 and run.events[2].time == 5.0  # exactly where the table jumps
    assert run.at(2.0)["slider.speed"] == pytest.approx(1.0, rel=1e-9)
    assert run.at(6.0)["slider.position"] == pytest.approx(0.5 + 1 / 1.6 - 0.5, rel=1e-8)


@pytest.mark.parametrize("gap", [1e-9, 1e-12, 1e-14, 3e-16, 0.0])
def test_a_pair_of_events_closer_than_can_be_resolved_does_no_harm(gap):
    table = ((1.0, 1.0, 1.0 + gap, 1.0 + gap), (0.0, 1.8, 1.8, 0.0))
    run = simulate(compose(Slider()), 3.0, inputs={"slider.force": table}, accuracy=1e-9)
    assert run.modes["pad"][-1] == "stick"
    assert run.at(3.0)["slider.position"] == pytest.approx(0.0, abs=2 * gap)
    assert len(run.events) <= 2


def test_thousands_of_jumps_of_a_table_are_each_met():
    n = 3000
    edges = np.repeat(np.arange(1, n), 2) * 0.01
    values = np.repeat(np.where(np.arange(n) % 2, 1.8, -1.8), 2)[1:-1]
    run = simulate(
        compose(Slider(friction=Coulomb(static=0.8, kinetic=0.8))), n * 0.01, inputs={"slider.force": (edges, values)}, accuracy=1e-6
    )
    # odd symmetric square wave of force: from the first push on, v returns to 0 at the end of every second piece or soon after its jump
    assert len(run.events) >= n - 1
    assert np.abs(run["slider.speed"]).max() <= 0.01 * 1.0 * (1 + 1e-6)


# --- times


def test_switch_times_converge_with_the_accuracy():
    # z = (F_s - F_k) w_n / (k v) = 2; start just caught, so that every switch is known
    static, kinetic, speed = 1.0, 0.6, 0.2
    plant = compose(BlockOnBelt(belt_speed=speed, friction=Coulomb(static=static, kinetic=kinetic)))
    z = (static - kinetic) / speed
    slip, stick = 2 * (math.pi - math.atan(z)), 2 * z
    expected = np.cumsum([stick, slip] * 10)
    errors = []
    accuracies = [1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12]
    for accuracy in accuracies:
        run = simulate(plant, expected[-1] + 1, start={"block.position": 2 * kinetic - static, "block.speed": speed}, accuracy=accuracy)
        errors.append(np.abs(times_of(run)[:20] - expected).max())
    # x = F_s / k is met at the belt's speed 0.2, so an error of x times five; ten cycles and the factor of ten of the design
    assert np.all(np.array(errors) <= 10 * 5 * np.array(accuracies) + 1e-12 * expected[-1])
    assert errors[-1] < 1e-4 * errors[0]


def test_times_in_the_modes_add_up_to_the_run():
    run = simulate(compose(BlockOnBelt()), 100.0)
    assert sum(run.time_in("belt", mode) for mode in ("stick", "slip+", "slip-")) == pytest.approx(100.0, rel=1e-14)
    assert sum(run.time_in("belt", mode, after=33.0, until=71.0) for mode in ("stick", "slip+", "slip-")) == pytest.approx(38.0, rel=1e-14)


@pytest.mark.parametrize("grid", [[0.0, 1.0, 2.0], [50.0], np.linspace(0, 100, 11), np.linspace(0, 99.9, 1000)], ids=len)
def test_output_times_change_neither_the_events_nor_the_times_in_the_modes(grid):
    plain = simulate(compose(BlockOnBelt()), 100.0)
    run = simulate(compose(BlockOnBelt()), 100.0, output_times=grid)
    assert run.events == plain.events
    for mode in ("stick", "slip+", "slip-"):
        assert run.time_in("belt", mode) == plain.time_in("belt", mode)


def test_any_instant_is_as_accurate_as_an_output_time():
    grid = np.sort(np.random.default_rng(0).uniform(0, 40, 300))
    law = PI()
    dense = simulate(RIG, 40.0, controller=law)
    given = simulate(RIG, 40.0, controller=law, output_times=grid)
    at = dense.at(grid)
    for name in ("bit.speed", "top.speed", "bit.torque", "top.torque"):
        np.testing.assert_allclose(at[name], given[name], rtol=1e-11, atol=1e-11 * np.abs(given[name]).max())
    better = simulate(RIG, 40.0, controller=law, accuracy=1e-10).at(grid)
    np.testing.assert_allclose(at["bit.speed"], better["bit.speed"], atol=1e-5 * better["bit.speed"].max())
    np.testing.assert_array_equal(at.mode, given.mode)


def test_slip_is_exactly_zero_wherever_a_stuck_run_is_looked_at():
    rig = compose(wells.NAVARRO_LOPEZ_4, BitRock(weight=97_347.0))
    grid = np.linspace(0, 60, 2001)
    run = simulate(rig, 60.0, controller=PI(reference=5.0), output_times=grid)
    for samples in (run, run.every_step, run.at(grid + 0.0), run.at(np.linspace(0.01, 59.99, 777))):
        stuck = samples.mode[:, 0] == 0
        assert stuck.any() and not stuck.all()
        assert np.all(samples["bit.speed"][stuck] == 0.0)


# --- laws beyond their guards, and steep ones


@pytest.mark.parametrize("decay", [1e4, 1e6])
@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9])
def test_an_exponential_law_of_steep_decay_tends_to_coulomb_friction(decay, accuracy):
    static, kinetic, speed = 1.0, 0.6, 0.2
    plant = compose(BlockOnBelt(belt_speed=speed, friction=Exponential(static=static, kinetic=kinetic, decay=decay)))
    run = simulate(plant, 100.0, accuracy=accuracy)
    z = (static - kinetic) / speed
    period = 2 * math.pi * (1 + (z - math.atan(z)) / math.pi)
    left = np.array([event.time for event in run.events if event.before == "stick"])
    assert len(left) >= 8
    # near the release friction has to fall from static to kinetic over a slip speed of 1 / decay, starting at rest: a delay of
    # about sqrt(2 m / (k v decay)) = sqrt(10 / decay)
    np.testing.assert_allclose(np.diff(left)[1:], period, atol=5 * math.sqrt(10 / decay) + 100 * accuracy)
    is_consistent(run, "belt", static)


@pytest.mark.parametrize("decay", [1e3, 1e4, 1e6])
def test_a_hyperbolic_law_has_a_pole_just_beyond_its_guard_and_no_step_falls_into_it(decay):
    # 1 / (1 + decay s) is negative for s < -1 / decay, and infinite in between
    plant = compose(BlockOnBelt(friction=Hyperbolic(static=1.0, decay=decay)))
    start = {"block.position": -0.9, "block.speed": 0.2}
    coarse, fine = (simulate(plant, 60.0, start=start, accuracy=accuracy) for accuracy in (1e-5, 1e-10))
    for run in (coarse, fine):
        is_consistent(run, "belt", 1.0)
        assert np.all(np.abs(run["belt.force"]) <= 1 + 1e-9 + 1e-5 * run.accuracy * decay)  # at an event, and what it is located to
    assert len(coarse.events) == len(fine.events) >= 8
    np.testing.assert_allclose(times_of(coarse), times_of(fine), atol=1e-3)


@pytest.mark.parametrize("ratio", [10.0, 100.0])
def test_a_static_friction_far_above_the_kinetic_one_gives_the_closed_form(ratio):
    kinetic, speed = 0.1, 0.2
    static = ratio * kinetic
    z = (static - kinetic) / speed
    plant = compose(BlockOnBelt(belt_speed=speed, friction=Coulomb(static=static, kinetic=kinetic)))
    period = 2 * math.pi * (1 + (z - math.atan(z)) / math.pi)
    # caught at 2 F_k - F_s, where the spring pushes back with almost the static force: |k x| < F_s by 2 F_k
    run = simulate(plant, 6.2 * period, start={"block.position": 2 * kinetic - static, "block.speed": speed}, accuracy=1e-10)
    left = np.array([event.time for event in run.events if event.before == "stick"])
    np.testing.assert_allclose(np.diff(left), period, rtol=1e-8)
    assert len(left) == 6


# --- loads


def test_without_load_a_block_never_sticks_and_feels_no_force():
    plant = compose(BlockOnBelt(load=0.0))
    run = simulate(plant, 50.0, start={"block.position": 1.0}, accuracy=1e-9)
    assert run.time_in("belt", "stick") == 0.0
    assert np.all(run["belt.force"] == 0.0)
    np.testing.assert_allclose(run["block.position"], np.cos(run.time), atol=1e-7)
    # also where its speed meets that of the belt at rest
    run = simulate(plant, 50.0, start={"block.speed": 0.2}, accuracy=1e-9)
    assert run.time_in("belt", "stick") == 0.0
    np.testing.assert_allclose(run["block.speed"], 0.2 * np.cos(run.time), atol=1e-8)


def test_a_load_that_vanishes_at_once_and_comes_back_lets_the_block_go_in_between():
    # u = 0.5 < static 1 holds; load 0 in [1, 2]: v = 0.5 (t - 1); then -0.3 until 2 + 0.5 / 0.3
    table = ((1.0, 1.0, 2.0, 2.0), (1.0, 0.0, 0.0, 1.0))
    run = simulate(compose(Slider()), 6.0, inputs={"slider.load": table, "slider.force": 0.5}, accuracy=1e-10)
    assert switches(run) == [("stick", "slip+"), ("slip+", "stick")]
    np.testing.assert_allclose(times_of(run), [1.0, 2 + 0.5 / 0.3], rtol=1e-9)
    assert run.at(2.0)["slider.speed"] == pytest.approx(0.5, rel=1e-9)
    assert run.at(6.0)["slider.speed"] == 0.0
    inside = run.at(np.linspace(1.0, 1.999, 20))["pad.force"]
    np.testing.assert_array_equal(np.abs(inside), 0.0)


def test_a_load_that_fades_and_returns_releases_where_the_bound_meets_the_force():
    # load 1 - (t - 1) to 0 at 2, back to 1 at 3; static: load = 0.5 at t = 1.5. Then v' = 0.5 - 0.8 N
    table = ((1.0, 2.0, 3.0), (1.0, 0.0, 1.0))
    run = simulate(compose(Slider()), 8.0, inputs={"slider.load": table, "slider.force": 0.5}, accuracy=1e-11)
    down = 0.5 * 0.5 - 0.8 * 0.125  # integral over [1.5, 2]
    up = 0.5 * 1.0 - 0.8 * 0.5  # over [2, 3]
    assert switches(run) == [("stick", "slip+"), ("slip+", "stick")]
    np.testing.assert_allclose(times_of(run), [1.5, 3 + (down + up) / 0.3], rtol=1e-9)


def test_a_block_at_rest_without_any_force_survives_the_loss_of_its_load():
    table = ((1.0, 2.0, 3.0, 4.0, 4.0, 5.0, 5.0), (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0))
    run = simulate(compose(Slider()), 7.0, inputs={"slider.load": table, "slider.force": ((6.0, 6.0), (0.0, 1.8))}, accuracy=1e-8)
    assert np.all(run["slider.speed"][run.time <= 6.0] == 0.0)
    assert run.at(7.0)["slider.speed"] == pytest.approx(1.0, rel=1e-7)


def test_weight_on_bit_may_be_lifted_and_set_down_again():
    table = ((20.0, 20.0, 40.0, 40.0), (97_347.0, 0.0, 0.0, 97_347.0))
    run = simulate(RIG, 60.0, inputs={"bit.weight": table}, controller=PI(), accuracy=1e-8)
    assert run.time_in("bit", "stick", after=20.0, until=40.0) == 0.0
    assert np.all(run.at(np.linspace(20, 39.99, 100))["bit.torque"] == 0.0)
    assert np.abs(run.at(45.0)["bit.torque"]) > 1000.0


# --- a ground that moves


def test_a_block_rides_on_a_ground_that_accelerates_gently_and_slips_where_it_does_not():
    # ground speed 0.5 t until 2, then 2 t ...: m a = 0.5 < static 1 rides; a = 2 slips with kinetic 0.8
    table = ((0.0, 2.0, 4.0), (0.0, 1.0, 5.0))
    run = simulate(compose(Slider()), 12.0, inputs={"slider.ground": table}, accuracy=1e-10)
    assert run.at(1.7)["slider.speed"] == pytest.approx(0.85, rel=1e-14)
    assert run.at(1.7)["pad.force"] == pytest.approx(0.5, rel=1e-12)
    # at 2 it begins to slip back: v = 1 + 0.8 (t - 2) until the ground's 5 is reached at t = 7
    assert switches(run) == [("stick", "slip-"), ("slip-", "stick")]
    np.testing.assert_allclose(times_of(run), [2.0, 7.0], rtol=1e-9)
    assert run.at(12.0)["slider.speed"] == pytest.approx(5.0, rel=1e-12)
    assert run.at(9.0)["pad.slip"] == 0.0


def test_a_ground_that_jumps_leaves_the_block_behind():
    table = ((1.0, 1.0), (0.0, 2.0))
    run = simulate(compose(Slider()), 6.0, inputs={"slider.ground": table}, accuracy=1e-10)
    assert switches(run) == [("stick", "slip-"), ("slip-", "stick")]
    np.testing.assert_allclose(times_of(run), [1.0, 1 + 2 / 0.8], rtol=1e-9)


def test_a_shaken_ground_carries_the_block_up_to_the_acceleration_that_friction_can_give():
    for amplitude, rides in ((0.99, True), (1.01, False)):
        run = simulate(compose(Slider()), 12.0, inputs={"slider.ground": -amplitude * ca.cos(time) + amplitude}, accuracy=1e-9)
        assert (run.time_in("pad", "stick") == 12.0) is rides
        if rides:
            np.testing.assert_allclose(run["slider.speed"], amplitude * (1 - np.cos(run.time)), atol=1e-12)
            assert np.all(run["pad.slip"] == 0.0)


# --- several things at one instant


def test_jumps_of_two_inputs_at_one_instant_are_one_jump():
    # force 0.5 -> 1.8 and load 1 -> 3 together: friction can hold before and after, so it holds; one after the other it would not
    plant = compose(Slider())
    for shift in (0.0, 0.1, 1 / 3):
        at = 1.0 + shift
        inputs = {"slider.force": ((at, at), (0.5, 1.8)), "slider.load": ((at, at), (1.0, 3.0))}
        run = simulate(plant, 3.0, inputs=inputs)
        assert run.events == []
        assert run.at(2.0)["pad.force"] == -1.8


def test_a_force_and_a_ground_may_turn_at_the_instant_of_a_stop():
    # v = 0.8 stops at t = 1 by friction 0.8; there the force rises to 2 within no time, or the ground starts to run at 0.5 t
    plant = compose(Slider())
    run = simulate(plant, 2.0, start={"slider.speed": 0.8}, inputs={"slider.force": ((1.0, 1.0), (0.0, 2.0))}, accuracy=1e-9)
    assert run.at(2.0)["slider.speed"] == pytest.approx(1.2, rel=1e-8)
    run = simulate(plant, 2.0, start={"slider.speed": 0.8}, inputs={"slider.ground": ((1.0, 2.0), (0.0, 0.5))}, accuracy=1e-9)
    assert run.at(2.0)["slider.speed"] == pytest.approx(0.5, rel=1e-8)
    assert run.modes["pad"][-1] == "stick"


# --- sizes


@pytest.mark.parametrize("exponent", [-40, -20, 20, 40])
@pytest.mark.parametrize("unit", ["force", "length", "time"])
def test_the_motion_does_not_depend_on_the_units_it_is_written_in(unit, exponent):
    # in the unit of force: m, c, k, N all scale; of length: x, v, 1 / decay and forces; of time: v, m, c, decay
    s = 2.0**exponent
    force, length, second = (s if unit == kind else 1.0 for kind in ("force", "length", "time"))

    def run(force, length, second):
        plant = compose(
            BlockOnBelt(
                mass=1.0 * force / length * second**2, stiffness=1.0 * force / length, damping=0.01 * force / length * second,
                belt_speed=0.2 * length / second, load=force, friction=Hyperbolic(static=1.0, decay=3.0 / (length / second)),
            )
        )  # fmt: skip
        return simulate(plant, 50.0 * second, accuracy=1e-8)

    plain, scaled = run(1.0, 1.0, 1.0), run(force, length, second)
    assert switches(scaled) == switches(plain)
    np.testing.assert_allclose(times_of(scaled) / second, times_of(plain), rtol=1e-7)


@dataclass(frozen=True)
class Pair(Component):
    """Two oscillators that do not know each other, of very different size and the same unit, each with friction of its own."""

    size: float = quantity(1.0, "N", "what the second is worth", above=0)
    rate: float = quantity(1.0, "1/s", "frequency of the second", above=0)

    def equations(self, signal):
        x, v = state("pair.x", "m"), state("pair.v", "m/s")
        y, w = state("pair.y", "m"), state("pair.w", "m/s")
        first = DryFriction("first", v, Coulomb(static=0.01, kinetic=0.01))
        second = DryFriction("second", w, Coulomb(static=0.01, kinetic=0.01), self.size)
        return Equations(flow={x: v, v: -x + first.force, y: w, w: -(self.rate**2) * y + second.force}, elements=[first, second])


@pytest.mark.parametrize("size", [1e9, 1.0, 1e-9])
def test_a_state_a_billion_times_smaller_than_another_is_as_accurate_in_its_own_size(size):
    rate = 3.0
    run = simulate(compose(Pair(size=size, rate=rate)), 20.0, start={"pair.x": 1.0, "pair.y": size}, accuracy=1e-6)
    # between turning points y = (-1)^n (A_n - q) cos + q ...: compare at the turning points, exactly (-1)^n (1 - 2 n q), q = 0.01 / 9
    turns = [event.time for event in run.events if event.element == "second"][:18]
    n = np.arange(1, len(turns) + 1)
    np.testing.assert_allclose(turns, n * math.pi / rate, rtol=1e-5)
    np.testing.assert_allclose(run.at(turns)["pair.y"] / size, (-1.0) ** n * (1 - 2 * n * 0.01 / rate**2), atol=1e-5)
    assert run.error_estimate < 1e-5


def test_a_large_position_does_not_hide_a_small_slip():
    # 1e9 m down the road a slip of 1e-6 m/s is still a slip: it stops after v m / F_k
    plant = compose(Slider(friction=Coulomb(static=1e-6, kinetic=1e-6)))
    run = simulate(plant, 2.0, start={"slider.position": 1e9, "slider.speed": 1e-7}, accuracy=1e-8)
    assert switches(run) == [("slip+", "stick")]
    assert run.events[0].time == pytest.approx(0.1, rel=1e-6)


@pytest.mark.parametrize("ratio", [1e3, 1e6])
@pytest.mark.parametrize("accuracy", [1e-3, 1e-6, 1e-9])
def test_a_stiff_string_is_accurate_between_its_steps_too(ratio, accuracy):
    # stiff and damped: an explicit method runs at its stability limit, where interpolants oscillate; steps from nodes must not
    chain = TorsionalChain(inertia=(1.0, 1.0, 1.0), stiffness=(1.0, ratio), damping=(0.1, 0.5 * math.sqrt(ratio)))
    duration = 20.0 / math.sqrt(ratio) * 10
    run = simulate(compose(chain), duration, inputs={"top.torque": 1.0}, accuracy=accuracy)
    a = np.zeros((5, 5))
    a[0, [2, 3]] = 1, -1
    a[1, [3, 4]] = 1, -1
    for i, (k, c) in enumerate(((1.0, 0.1), (ratio, 0.5 * math.sqrt(ratio)))):
        row = np.zeros(5)
        row[[i, 2 + i, 3 + i]] = k, c, -c
        a[2 + i] -= row
        a[3 + i] += row
    extended = np.zeros((6, 6))
    extended[:5, :5], extended[2, 5] = a, 1.0
    times = np.linspace(0.01, 1, 80) * duration
    exact = np.array([(expm(extended * t) @ [0, 0, 0, 0, 0, 1.0])[:5] for t in times])
    mine = np.hstack([run.at(times)["chain.twist"], run.at(times)["chain.speed"]])
    size = np.abs(exact).max(axis=0)
    assert np.max(np.abs(mine - exact) / size) < 10 * accuracy


def test_a_reference_speed_near_zero_only_makes_the_stick_long():
    # t_stick = 2 z / w_n with z = (F_s - F_k) w_n / (k v): 8e5 s of stick, then a slip of about a second
    speed, static, kinetic = 1e-6, 1.0, 0.6
    plant = compose(BlockOnBelt(belt_speed=speed, friction=Coulomb(static=static, kinetic=kinetic)))
    z = (static - kinetic) / speed
    start = {"block.position": 2 * kinetic - static, "block.speed": speed}
    run = simulate(plant, 3.5 * 2 * z, start=start, accuracy=1e-9)
    assert switches(run)[:4] == [("stick", "slip-"), ("slip-", "stick")] * 2
    slip = [end - begin for begin, end, mode in run.intervals("belt") if mode == "slip-"]
    stick = [end - begin for begin, end, mode in run.intervals("belt")[:-1] if mode == "stick"]
    np.testing.assert_allclose(slip, 2 * (math.pi - math.atan(z)), rtol=1e-6)
    np.testing.assert_allclose(stick, 2 * z, rtol=1e-9)
    assert sum(run.steps) < 10_000


# --- ends of the ranges


def test_a_run_of_no_time_is_its_start():
    run = simulate(compose(BlockOnBelt()), 0.0, start={"block.position": 0.3})
    assert run.time[-1] == 0.0
    assert run.at(0.0)["block.position"] == 0.3
    assert run.events == []
    assert run.time_in("belt", "stick") == 0.0
    given = simulate(compose(BlockOnBelt()), 0.0, output_times=[0.0])
    assert list(given.time) == [0.0]
    assert run.error_estimate == 0.0
    assert "BlockOnBelt" in str(run)


@pytest.mark.parametrize("accuracy", [1e-13, 1e-2, 1e-1])
def test_the_ends_of_the_range_of_accuracies_work(accuracy):
    static, kinetic, speed = 1.0, 0.6, 0.2
    plant = compose(BlockOnBelt(belt_speed=speed, friction=Coulomb(static=static, kinetic=kinetic)))
    z = (static - kinetic) / speed
    period = 2 * math.pi * (1 + (z - math.atan(z)) / math.pi)
    run = simulate(plant, 5.2 * period, start={"block.position": 2 * kinetic - static, "block.speed": speed}, accuracy=accuracy)
    left = np.array([event.time for event in run.events if event.before == "stick"])
    assert len(left) == 5
    np.testing.assert_allclose(left, 2 * z + period * np.arange(5), atol=5 * 10 * accuracy + 1e-11 * run.duration)


def test_the_error_of_the_most_accurate_run_is_not_reported_as_zero():
    run = simulate(compose(BlockOnBelt()), 30.0, accuracy=1e-13)
    assert 0.0 < run.error_estimate < 1e-10


def test_the_error_is_within_ten_times_the_accuracy_asked():
    for accuracy in (1e-2, 1e-4, 1e-6, 1e-8, 1e-10):
        run = simulate(compose(BlockOnBelt()), 100.0, accuracy=accuracy)
        assert 0.0 < run.error_estimate < 10 * accuracy


def test_the_error_reported_is_the_error_made():
    # Coulomb friction, start at rest at 1: at 4.5 pi the block has turned four times
    plant = compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=0.02, kinetic=0.02)))
    run = simulate(plant, 4.5 * math.pi, start={"block.position": 1.0}, accuracy=1e-4)
    times = np.linspace(4 * math.pi, 4.5 * math.pi, 50)
    exact = (1 - 8 * 0.02 - 0.02) * np.cos(times) + 0.02
    made = np.abs(run.at(times)["block.position"] - exact).max()
    assert made <= 1.1 * run.error_estimate + 1e-12


@pytest.mark.skipif(sys.platform != "linux", reason="reads the peak of memory from /proc")
def test_ten_thousand_seconds_on_a_grid_stay_below_300_megabytes():
    script = """
import sys
import numpy as np
from controllers import PI
from models import BitRock, wells
from toolbox import compose, simulate
n = int(sys.argv[1])
run = simulate(compose(wells.JANSEN_2, BitRock()), float(n), controller=PI(), output_times=np.linspace(0, n, 10 * n + 1))
assert run.time.size == 10 * n + 1 and run["bit.speed"].size == 10 * n + 1
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))  # getrusage counts the parent of a new process too
print(len(run.events), int(peak.split()[1]) / 1024)
"""
    # the first process compiles, if anything is left to be compiled: that takes memory of its own, once per machine
    for seconds in ("1", "10000"):
        done = subprocess.run([sys.executable, "-c", script, seconds], capture_output=True, text=True, timeout=50, check=True)
    events, megabytes = done.stdout.split()
    assert int(events) > 1000
    assert float(megabytes) < 300


def test_events_of_a_long_run_keep_their_period():
    # a limit cycle for 1e4 s: every release starts from the same state, so the last period is the first one
    run = simulate(compose(BlockOnBelt()), 10_000.0, accuracy=1e-9)
    left = np.array([event.time for event in run.events if event.before == "stick"])
    assert len(left) > 800
    np.testing.assert_allclose(np.diff(left), np.diff(left)[0], rtol=1e-7)


# --- events without end, and no modes at all


FAST = BlockOnBelt(stiffness=1e20, belt_speed=0.0, load=1e20, friction=Coulomb(static=1e-2, kinetic=1e-2))
"""A block that turns every pi 1e-10 s, and loses 0.02 m of its amplitude each time."""


def test_turning_points_at_the_beginning_of_a_run_are_told_apart_however_long_it_is():
    run = simulate(compose(FAST), 1e4, start={"block.position": 1.005})
    # stops at the first turning point within 0.01 m of zero: 1.005 - 0.02 k
    assert [event.after for event in run.events][-1] == "stick" and run.events[-1].time == pytest.approx(50 * math.pi * 1e-10, rel=1e-6)
    assert run["block.position"][-1] == pytest.approx(0.005, abs=1e-6)


def test_events_closer_than_a_run_resolves_end_in_an_error_that_names_the_element_and_the_time():
    # set off after 1e4 s, where double precision resolves 1e-12 s
    with pytest.raises(SimulationError, match=r"t = 10000.* s, where times are 1.8e-12 s apart") as caught:
        simulate(compose(FAST), 2e4, inputs={"block.attachment": ([0.0, 1e4, 1e4, 2e4], [0.0, 0.0, 1e20, 1e20])})
    assert caught.value.run.end == pytest.approx(1e4)
    assert caught.value.run.at(0.0)["block.position"] == 0.0


RATE = 100.0
PILE = ca.sin(RATE * ca.log(1 - time))
"""A force whose reversals pile up at t = 1; from v(0) = RATE / (1 + RATE^2) those of the speed of a unit mass do too."""


def test_reversals_that_pile_up_end_in_a_typed_error_near_their_limit():
    plant = compose(Slider(friction=Coulomb(static=0.0, kinetic=0.0)))
    with pytest.raises(SimulationError, match=r"t = (1|0\.99)") as caught:
        simulate(plant, 2.0, start={"slider.speed": RATE / (1 + RATE**2)}, inputs={"slider.force": PILE}, accuracy=1e-6)
    assert caught.value.run.time[-1] == pytest.approx(1.0, abs=1e-6)
    assert len(caught.value.run.events) > 50


def test_kinks_that_pile_up_in_a_flow_without_contacts_end_in_a_typed_error():
    class Rough(Component):
        def equations(self, signal):
            z = state("rough.z", "1")
            return Equations(flow={z: ca.fabs(PILE)})

    with pytest.raises(SimulationError):
        simulate(compose(Rough()), 2.0)


@dataclass(frozen=True)
class Backward(FrictionLaw):
    """Kinetic friction above the static bound, which no set of modes can satisfy in between."""

    def sliding(self, speed):
        return ca.SX(1.0)

    def breakaway(self):
        return ca.SX(0.5)


def test_forces_that_no_mode_can_balance_end_in_a_typed_error_with_the_run_so_far():
    plant = compose(Slider(friction=Backward()))
    with pytest.raises(SimulationError, match="pad") as caught:
        simulate(plant, 2.0, inputs={"slider.force": ((0.0, 2.0), (0.0, 1.5))})
    assert caught.value.run.time[-1] == pytest.approx(0.5 / 0.75, abs=1e-6)


def test_a_motion_that_blows_up_in_finite_time_ends_in_an_error_that_names_the_state():
    class Blast(Component):
        def equations(self, signal):
            z = state("blast.z", "1")
            return Equations(flow={z: z**2})

    with pytest.raises(SimulationError, match=r"blast\.z|step size") as caught:
        simulate(compose(Blast()), 2.0, start={"blast.z": 1.0})
    run = caught.value.run
    assert run.time[-1] == pytest.approx(1.0, abs=1e-6)  # z = 1 / (1 - t)
    assert run.at(0.5)["blast.z"] == pytest.approx(2.0, rel=1e-5)


# --- kinks and jumps


def test_a_kink_of_the_flow_costs_no_accuracy():
    # x' = |cos t|: integral of |cos| over ten half-waves is 20
    class Rectified(Component):
        def equations(self, signal):
            z = state("rectified.z", "1")
            return Equations(flow={z: ca.fabs(ca.cos(time))})

    run = simulate(compose(Rectified()), 10 * math.pi, accuracy=1e-10)
    assert run.at(10 * math.pi)["rectified.z"] == pytest.approx(20.0, rel=1e-9)
    assert sum(run.steps) < 500


def test_a_saturated_spring_switches_sides_where_its_argument_does():
    # x'' = -max(x, 0): half an oscillation, then straight flight
    class OneSided(Component):
        def equations(self, signal):
            x, v = state("spring.x", "m"), state("spring.v", "m/s")
            return Equations(flow={x: v, v: -ca.fmax(x, 0)})

    run = simulate(compose(OneSided()), 10.0, start={"spring.v": 1.0}, accuracy=1e-10)
    assert run.at(2.0)["spring.x"] == pytest.approx(math.sin(2.0), abs=1e-9)
    assert run.at(10.0)["spring.x"] == pytest.approx(-(10.0 - math.pi), abs=1e-8)


JUMPS = {
    "sign": ca.sign, "floor": ca.floor, "ceil": ca.ceil, "<": lambda a: a < 0.3, "<=": lambda a: a <= 0.3, "==": lambda a: ca.eq(a, 0.3),
    "!=": lambda a: ca.ne(a, 0.3), "if_else": lambda a: ca.if_else(a > 0.3, 1, 2), "fmod": lambda a: ca.fmod(a, 0.7),
    "remainder": lambda a: ca.remainder(a, 0.7), "copysign": lambda a: ca.copysign(1, a),
}  # fmt: skip


@pytest.mark.parametrize("kind", JUMPS)
@pytest.mark.parametrize("place", ["flow", "load", "slip", "input", "ground"])
def test_a_jump_hidden_in_an_expression_is_refused_wherever_it_stands(place, kind):
    # steps across a jump are neither accurate nor end on it: it has to be a declared element, or a table
    jump = JUMPS[kind]

    class Jumpy(Component):
        def equations(self, signal):
            v = state("jumpy.v", "m/s")
            load = 2 + jump(time) if place == "load" else 1.0
            ground = jump(time) if place == "slip" else signal("jumpy.ground", "m/s", default=0.0)
            pad = DryFriction("pad", v - ground, Coulomb(static=1.0, kinetic=0.8), load)
            push = jump(v + time) if place == "flow" else signal("jumpy.force", "N", default=0.0)
            return Equations(flow={v: push + pad.force}, elements=[pad])

    inputs = {"input": {"jumpy.force": jump(time)}, "ground": {"jumpy.ground": jump(time)}}.get(place)
    with pytest.raises(SceneError, match="jump"):
        simulate(compose(Jumpy()), 2.0, inputs=inputs)


def test_a_rim_speed_that_is_a_parameter_times_a_state_is_exactly_zero_in_stick():
    # slip = r w with the parameter r: zero slip means w = 0, which double precision can say
    @dataclass(frozen=True)
    class Rim(Component):
        radius: float = quantity(0.1555, "m", "radius")

        def equations(self, signal):
            w = state("rim.speed", "rad/s")
            torque = signal("rim.torque", "N m", default=0.0)
            pad = DryFriction("rim", self.radius * w, Coulomb(static=1.0, kinetic=0.8))
            return Equations(flow={w: (torque + self.radius * pad.force) / 0.37}, elements=[pad])

    run = simulate(compose(Rim()), 20.0, start={"rim.speed": 1.2345}, inputs={"rim.torque": 0.1 * ca.sin(3 * time)})
    stuck = run.modes["rim"] == "stick"
    assert stuck.any()
    assert np.all(run["rim.slip"][stuck] == 0.0)
    assert np.all(run["rim.speed"][stuck] == 0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("load", [7.0, 9.81, 10.0])
def test_a_force_that_reaches_the_bound_exactly_at_a_node_releases_only_if_it_goes_on_rising(load, sign):
    """|F| <= static holds at the node itself; whether the contact lets go is decided by what the table does behind it."""
    plant = compose(BlockOnBelt(stiffness=0.0, belt_speed=0.0, friction=Coulomb(0.5, 0.5), load=load))
    bound = sign * 0.5 * load

    def events(*forces):
        return [(event.time, event.after) for event in simulate(plant, 5.0, inputs={"block.force": ([0.0, 2.0, 4.0], forces)}).events]

    assert events(0.0, bound, bound) == []
    assert events(0.0, bound, 0.0) == []
    slides = "slip+" if sign > 0.0 else "slip-"
    assert events(0.0, bound, 1.001 * bound) == [(2.0, slides)]


@dataclass(frozen=True)
class CarriedPendulum(Component):
    """Pendulum in a bearing with dry friction on a shaft that turns evenly: carried along it moves without a trace of error, while sin a rises and falls."""

    gravity: float = quantity(10.0, "N m", "weight times lever")

    def equations(self, signal):
        a, w = state("pendulum.angle", "rad"), state("pendulum.speed", "rad/s")
        bearing = DryFriction("bearing", w - 0.5, Coulomb(static=5.0, kinetic=3.0), slip_unit="rad/s", force_unit="N m")
        return Equations(flow={a: w, w: bearing.force - self.gravity * ca.sin(a)}, elements=[bearing])


@pytest.mark.parametrize("method", ["explicit", "stiff"])
@pytest.mark.parametrize("accuracy", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("start", [{"pendulum.angle": 1.0}, {"pendulum.angle": -0.3, "pendulum.speed": 0.5}])
def test_a_stuck_contact_lets_go_where_a_load_that_is_nonlinear_in_the_state_reaches_its_bound(start, accuracy, method):
    run = simulate(compose(CarriedPendulum()), 30.0, start=start, accuracy=accuracy, method=method)
    sticks = [(a, b) for a, b, mode in run.intervals("bearing") if mode == "stick" and b < run.end]
    assert len(sticks) >= 10
    for a, b in sticks:
        begin, end = run.at(a)["pendulum.angle"], run.at(b)["pendulum.angle"]
        # |10 sin a| = 5 is reached next where a = asin(1/2), or half a turn on
        assert end == pytest.approx(begin + (np.pi / 6 - begin) % np.pi, abs=10 * accuracy)
    assert run.error_estimate < 10 * accuracy
