"""Runs in the lanes of a vector, against runs one by one and closed forms."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from controllers import PI, IdealSlidingMode
from models import BitRock, BlockOnBelt, BlocksOnBelt, Coulomb, DiscBrake, HystereticBitRock, StepFriction, TorsionalChain, TwoDisks, wells
from studies.benchmarks.cases import cases
from tests.fading_brake import FadingBrake
from tests.mechanisms import Ball, Hertz, Oscillator, Swing
from tests.plants import BELT
from tests.together import together
from toolbox import Sampled, SceneError, closed_loop, compose, simulate
from toolbox.compilation import taylor
from toolbox.compilation.work_layout import INCONSISTENT, NO_SERIES, UNDERFLOW
from toolbox.inputs import sine
from toolbox.lanes.lanes import Lanes
from toolbox.measuring import metrics
from toolbox.measuring.measure import extent
from toolbox.modelling.start import place_start
from toolbox.simulation import TaylorSeries  # fmt: skip
from toolbox.simulation.methods import Explicit
from toolbox.simulation.request import Request
from toolbox.sweeps.batch import Task, finished

RANDOM = np.random.default_rng(5)


@pytest.fixture(scope="module", autouse=True)
def driver():
    """The driver of the lanes, compiled once per machine outside the time of any test."""
    batch(compose(BlockOnBelt()), 0.0)


def spread(low, high, count):
    return RANDOM.uniform(low, high, count)


def batch(plant, duration, parameters=None, count=1, start=None, *, metrics=(), most_events=0, threads=1, width=None, **arguments):
    """Scenarios of a plant in lanes: `parameters` are {name: one number per scenario}."""
    loop, rest = together(plant, start=start, **arguments)
    run = Request(loop, duration, **rest).checked()
    values = np.tile(run.system.values, (count, 1))
    for name, column in (parameters or {}).items():
        values[:, run.system._parameter(name).offset] = column
    first = np.zeros(run.system.x.numel())
    for name, value in (start or {}).items():
        place_start(run.system, first, name, value)
    starts = np.tile(first, (count, 1))
    return Lanes(run, metrics, width).run(values, starts, most_events=most_events, threads=threads)


CHAIN = TorsionalChain(
    inertia=(900.0, 300.0, 200.0, 400.0), stiffness=(2000.0, 1500.0, 1200.0), damping=(40.0, 30.0, 30.0), top_drag=300.0,
    friction=Coulomb(static=1.0, kinetic=0.8), friction_load=(1500.0, 300.0, 250.0, 900.0),
)  # fmt: skip
RIG = compose(wells.JANSEN_2, BitRock(weight=97_000.0))
# plant, duration, the parameters that vary with their ranges, other arguments
PLANTS = {
    "block on belt": (compose(BlockOnBelt()), 60.0, {"block.mass": (0.5, 2.0), "block.belt_speed": (0.05, 0.4)}, {}),
    "law that drops": (compose(BlockOnBelt(friction=StepFriction(drop_speed=0.1))), 30.0, {"block.mass": (0.5, 2.0)}, {}),
    "two blocks": (compose(BlocksOnBelt()), 30.0, {}, {"start": {"blocks.position": (0.5, 0.1)}}),
    "five equal blocks, which stick and slip at one instant": (
        compose(BlocksOnBelt(mass=(1.0,) * 5, stiffness=(1.0,) * 5, damping=(0.0,) * 5, tie=(0.5,) * 4, load=(1.0,) * 5)),
        30.0,
        {"blocks.belt_speed": (0.1, 0.3)},
        {},
    ),
    "five blocks": (
        compose(BlocksOnBelt(mass=(1.0, 1.2, 0.9, 1.1, 1.05), stiffness=(1.0,) * 5, damping=(0.0,) * 5, tie=(0.5,) * 4, load=(1.0,) * 5)),
        30.0,
        {"blocks.belt_speed": (0.1, 0.3)},
        {},
    ),
    "drill string with a drive": (RIG, 60.0, {"bit.weight": (5e4, 1.5e5), "pi.reference": (4.0, 16.0)}, {"controller": PI()}),
    "drive with torque limits": (RIG, 40.0, {"bit.weight": (5e4, 1e5)}, {"controller": PI(lowest_torque=0.0, highest_torque=12_000.0)}),
    "sliding mode": (RIG, 20.0, {"bit.weight": (5e4, 1e5)}, {"controller": IdealSlidingMode(reference=12.0)}),
    "rock with memory": (
        compose(wells.JANSEN_2, HystereticBitRock()),
        30.0,
        {"bit.weight": (5e4, 1e5)},
        {"inputs": {"top.torque": 9000.0}},
    ),
    "torque from a table": (
        RIG,
        40.0,
        {"bit.weight": (5e4, 1e5)},
        {"inputs": {"top.torque": ([0.0, 9.0, 9.0, 20.0], [0.0, 12e3, 9e3, 14e3])}},
    ),
    "friction at every inertia": (
        compose(CHAIN),
        30.0,
        {"chain.friction_load.1": (200.0, 500.0)},
        {"inputs": {"top.torque": sine(2e3, 3e3, 0.2)}},
    ),
    "two-disk stop": (compose(TwoDisks()), 0.3, {}, {"start": {"disks.rotor_speed": 2.0}}),
    "disc brake": (compose(DiscBrake()), 1.0, {"disc.force": (500.0, 1500.0)}, {"start": {"disc.speed": 2.0}}),
    "bouncing ball": (compose(Ball(restitution=0.7)), 2.0, {"ball.restitution": (0.3, 0.8)}, {"start": {"ball.height": 1.0}}),
}


METHODS = pytest.mark.parametrize("method", ["explicit", "taylor"])
MOSTLY_SERIES = pytest.mark.parametrize("method", [pytest.param("explicit", marks=pytest.mark.slow), "taylor"])
"""Both methods, the one that sweeps seldom take only in the slow suite: each of many plants compiles for each."""


@MOSTLY_SERIES
@pytest.mark.parametrize("name", PLANTS)
def test_lanes_switch_as_the_scalar_loop_does_and_end_where_it_ends(name, method):
    plant, duration, ranges, arguments = PLANTS[name]
    count = 21  # not a multiple of any width
    parameters = {key: spread(*bounds, count) for key, bounds in ranges.items()}
    sticks = [element.name for element in plant.elements if element.mode_names.get(0) == "stick"]
    asked = [metrics.time_in(name) for name in sticks]
    found = batch(plant, duration, parameters, count, metrics=asked, most_events=2000, method=method, **arguments)
    assert (found.statuses == 0).all()
    for s in (0, 7, 15, 16, 20):
        own = {key: column[s] for key, column in parameters.items()}
        law = arguments.get("controller")
        changed = dict(arguments)
        if law is not None and "pi.reference" in own:
            changed["controller"] = PI(reference=own.pop("pi.reference"))
        run = simulate(plant, duration, parameters=own, method="explicit", **changed)
        names = [element.name for element in run.program.system.elements]
        legends = {element.name: {word: mode for mode, word in element.mode_names.items()} for element in run.program.system.elements}
        assert found.switches[s] == len(run.events)
        events = range(len(run.events))
        assert [names[found.event_elements[s, e]] for e in events] == [event.element for event in run.events]
        assert [found.event_modes[s, e] for e in events] == [legends[event.element][event.after] for event in run.events]
        np.testing.assert_allclose(found.event_times[s, : len(run.events)], [event.time for event in run.events], atol=1e-6 * duration)
        size = np.abs(run.states).max(axis=0)
        np.testing.assert_allclose(found.states[s], run.at(duration).states[0], atol=1e-5 * size.max())
        for i, element in enumerate(sticks):
            assert found.values[s, i] == pytest.approx(run.time_in(element, "stick"), abs=1e-5 * duration)


def test_a_guard_that_only_comes_near_zero_needs_no_step_of_the_scalar_loop_where_signals_are_measured():
    plant, duration, ranges, arguments = PLANTS["disc brake"]
    forces = {name: np.linspace(*bounds, 20) for name, bounds in ranges.items()}
    asked = (metrics.minimum("pad.speed"), metrics.maximum("pad.speed"))
    usual = batch(plant, duration, forces, 20, most_events=500, **arguments)
    found = batch(plant, duration, forces, 20, metrics=asked, most_events=500, **arguments)
    assert usual.alone.mean() > 2.0
    assert found.alone.mean() < 0.1
    np.testing.assert_array_equal(found.event_elements, usual.event_elements)
    np.testing.assert_array_equal(found.event_modes, usual.event_modes)
    np.testing.assert_allclose(found.event_times, usual.event_times, atol=1e-9)


@METHODS
def test_the_instant_of_a_release_is_as_near_to_the_closed_form_as_the_accuracy_asks(method):
    frequency = np.linspace(0.36, 0.5, 33)
    for accuracy, most in ((1e-6, 1e-10), (1e-9, 1e-12)):
        found = batch(compose(FadingBrake()), 3.0, {"mass.frequency": frequency}, 33, most_events=4, method=method, accuracy=accuracy)
        # the bound is met where 2 cos(w t) = 1; it is looked for to 1e-5 of the accuracy
        np.testing.assert_allclose(found.event_times[:, 0], math.pi / (3 * frequency), rtol=most)


@pytest.mark.parametrize("width", [4, 8, 16])
@METHODS
def test_oscillators_of_very_different_speeds_share_a_block_and_follow_their_cosines(width, method):
    frequency = 10.0 ** np.linspace(-1, 2, 19)
    start = {"mass.position": 1.0}
    found = batch(compose(Oscillator()), 10.0, {"mass.frequency": frequency}, 19, start, width=width, accuracy=1e-8, method=method)
    np.testing.assert_allclose(found.states[:, 0], np.cos(frequency * 10.0), atol=1e-7)
    assert found.steps.max() > 30 * found.steps.min()


@METHODS
@pytest.mark.parametrize("count", [1, 3, 16, 17])
def test_any_number_of_scenarios_gives_each_the_same_answer(count, method):
    plant, duration, _, arguments = PLANTS["drill string with a drive"]
    weights = np.linspace(5e4, 1.5e5, 17)
    whole = batch(plant, duration, {"bit.weight": weights}, 17, method=method, **arguments)
    part = batch(plant, duration, {"bit.weight": weights[:count]}, count, method=method, **arguments)
    np.testing.assert_array_equal(part.states, whole.states[:count])
    np.testing.assert_array_equal(part.switches, whole.switches[:count])


@METHODS
def test_threads_and_widths_change_nothing_that_counts(method):
    plant, duration, _, arguments = PLANTS["drill string with a drive"]
    arguments = {**arguments, "method": method}
    parameters = {"bit.weight": np.linspace(5e4, 1.5e5, 1100)}
    one = batch(plant, duration, parameters, 1100, **arguments)
    two = batch(plant, duration, parameters, 1100, threads=2, **arguments)
    np.testing.assert_array_equal(one.states, two.states)
    narrow = batch(plant, duration, {"bit.weight": parameters["bit.weight"][::50]}, 22, width=4, **arguments)
    np.testing.assert_array_equal(narrow.switches, one.switches[::50])
    np.testing.assert_allclose(narrow.states, one.states[::50], rtol=1e-5, atol=1e-5)


def test_no_scenarios_and_no_duration_are_answered_at_once():
    assert batch(BELT, 10.0, count=0).states.shape == (0, 2)
    found = batch(BELT, 0.0, count=5, start={"block.position": 0.3})
    np.testing.assert_array_equal(found.states, [[0.3, 0.0]] * 5)
    assert (found.statuses == 0).all() and (found.steps == 0).all()


@METHODS
def test_a_scenario_without_an_answer_leaves_its_neighbours_alone(method):
    plant, duration, _, arguments = PLANTS["drill string with a drive"]
    arguments = {**arguments, "method": method}
    weights = np.linspace(5e4, 1.5e5, 20)
    sound = batch(plant, duration, {"bit.weight": weights}, 20, **arguments)
    weights[[3, 11]] = math.nan
    found = batch(plant, duration, {"bit.weight": weights}, 20, **arguments)
    assert set(found.statuses[[3, 11]].tolist()) <= {INCONSISTENT, UNDERFLOW, NO_SERIES}
    others = np.delete(np.arange(20), [3, 11])
    assert (found.statuses[others] == 0).all()
    np.testing.assert_array_equal(found.states[others], sound.states[others])


@METHODS
def test_a_force_at_the_bound_exactly_where_its_table_turns_releases_in_lanes_only_what_it_releases_alone(method):
    plant = compose(BlockOnBelt(stiffness=0.0, belt_speed=0.0, friction=Coulomb(0.5, 0.5), load=10.0))
    loads = np.tile([10.0, 10.1, 9.9], 6)
    for last, released in ((5.0, 9.9), (0.0, 9.9), (5.01, 10.0)):
        table = ([0.0, 2.0, 4.0], [0.0, 5.0, last])
        found = batch(plant, 5.0, {"block.load": loads}, len(loads), inputs={"block.force": table}, most_events=4, method=method)
        assert np.array_equal(np.isfinite(found.event_times[:, 0]), loads <= released)
        for load, first in zip(loads, found.event_times[:, 0], strict=True):
            assert load > released or first == pytest.approx(load / 5.0, rel=1e-12)


def test_stick_is_measured_in_the_window_asked():
    run = simulate(RIG, 60.0, controller=PI(), method="explicit")
    asked = (metrics.time_in("bit", 21.5), metrics.last_stay("bit"))
    found = batch(RIG, 60.0, count=1, controller=PI(), metrics=asked)
    assert found.values[0, 0] == pytest.approx(run.time_in("bit", "stick", after=21.5), abs=1e-5)
    assert found.values[0, 0] > 1.0
    last = [event.time for event in run.events if event.before == "stick"][-1]
    ends = run.modes["bit"][-1] == "stick"
    assert found.values[0, 1] == pytest.approx(60.0 if ends else last, abs=1e-5)
    turning = {"chain.speed": (8.0, 8.0), "chain.twist": 20.0}
    assert np.isnan(batch(RIG, 1.0, count=1, start=turning, controller=PI(), metrics=asked[1:]).values[0, 0])


MEASURED = {
    "drill string with a drive": ("bit.speed", "bit.torque", "top.torque"),
    "friction at every inertia": ("top.speed", "bit.speed"),
    "torque from a table": ("bit.speed", "top.torque"),
    "disc brake": ("pad.speed", "brake.torque"),
    "bouncing ball": ("ball.height", "ball.speed"),
}


@MOSTLY_SERIES
@pytest.mark.parametrize("name", MEASURED)
def test_extrema_and_means_have_the_accuracy_of_a_run_and_not_of_its_nodes(name, method):
    plant, duration, ranges, arguments = PLANTS[name]
    parameters = {key: np.linspace(*bounds, 5) for key, bounds in ranges.items() if key != "pi.reference"}
    after = 0.37 * duration
    words = (metrics.minimum, metrics.maximum, metrics.mean)
    asked = [word(signal, after) for signal in MEASURED[name] for word in words]
    found = batch(plant, duration, parameters, 5, metrics=asked, method=method, **arguments)
    for s in range(5):
        run = simulate(plant, duration, parameters={key: column[s] for key, column in parameters.items()}, method="explicit", **arguments)
        for q, signal in enumerate(MEASURED[name]):
            expected = extent(run, signal, after)
            size = 1e-5 * max(abs(expected.minimum), abs(expected.maximum))
            for i, value in enumerate((expected.minimum, expected.maximum, expected.mean)):
                assert found.values[s, 3 * q + i] == pytest.approx(value, abs=size)


@METHODS
def test_a_slip_shorter_than_a_step_is_not_lost_before_another_contact_switches(method):
    # ten contacts that hold each other: pairs of switches 0.02 s apart, inside steps that end on the event of a neighbour
    case = cases()["all"]
    load = np.random.default_rng(1).uniform(0.8, 1.2, (400, 10)) * case.loop.plant.parameter("chain.friction_load")
    parameters = {f"chain.friction_load.{i}": load[:, i] for i in range(10)}
    usual, tight = (batch(case.loop, case.duration, parameters, 400, accuracy=accuracy, method=method) for accuracy in (1e-6, 1e-8))
    np.testing.assert_array_equal(usual.switches, tight.switches)
    assert usual.switches.mean() > 150


@METHODS
def test_an_oscillator_is_measured_exactly_on_steps_much_longer_than_its_samples(method):
    # x = cos w t from the time 1: the mean is (sin 10 w - sin w) / 9 w, the extrema are 1 and -1
    frequency = np.linspace(2.0, 9.0, 17)
    found = batch(
        compose(Oscillator()),
        10.0,
        {"mass.frequency": frequency},
        17,
        {"mass.position": 1.0},
        metrics=[word("mass.position", 1.0) for word in (metrics.minimum, metrics.maximum, metrics.mean)],
        accuracy=1e-8,
        method=method,
    )
    np.testing.assert_allclose(found.values[:, 1], 1.0, atol=1e-7)
    np.testing.assert_allclose(found.values[:, 0], -1.0, atol=1e-7)
    np.testing.assert_allclose(found.values[:, 2], (np.sin(10.0 * frequency) - np.sin(frequency)) / (9.0 * frequency), atol=1e-7)


def test_what_lanes_do_not_carry_is_refused_by_name():
    with pytest.raises(SceneError, match="Python"):
        batch(RIG, 1.0, controller=lambda t, y: 0.0, sample_time=0.01)
    run = Request(closed_loop(RIG), 1.0).checked()
    with pytest.raises(SceneError, match="`starts`"):
        Lanes(run).run(run.system.values[None], np.zeros((2, 3)))
    with pytest.raises(SceneError, match="scalar"):
        batch(RIG, 1.0, metrics=[metrics.mean("chain.speed")])
    with pytest.raises(SceneError, match="`parameters`"):
        Lanes(run).run(run.system.values[None, :-1], np.zeros((1, 3)))


# ------------------------------------------------------------------------------------------------------------------------------------ Taylor series
def test_guards_that_dip_within_long_steps_of_series_are_found_in_every_lane_as_far_as_they_dip():
    # x = sin t is above a height h for pi - 2 arcsin h of every period: at 1 - 1e-7 for 9e-4 of a step of about one
    high = np.array([0.99, 0.9999, 1.0 - 1e-7, 1.0 + 1e-6] * 5)
    start = {"swing.x": 0.0, "swing.v": 1.0}
    found = batch(
        compose(Swing()), 20 * math.pi + 1.0, {"swing.high": high}, 20, start, most_events=40, method=TaylorSeries(24), accuracy=1e-9
    )
    assert found.steps.max() < 200
    assert (found.switches == np.where(high < 1.0, 20, 0)).all()
    for h, times in zip(high, found.event_times, strict=True):
        if h < 1.0:
            expected = np.sort(np.add.outer(2 * math.pi * np.arange(10), [math.asin(h), math.pi - math.asin(h)]).ravel())
            np.testing.assert_allclose(times[:20], expected, atol=1e-8 / math.sqrt(1.0 - h))


@pytest.mark.parametrize("order", [8, 16])
def test_the_error_of_series_in_lanes_falls_with_the_accuracy(order):
    frequency = np.linspace(0.5, 8.0, 12)
    errors = []
    for accuracy in (1e-4, 1e-6, 1e-8, 1e-10):
        found = batch(
            compose(Oscillator()),
            20.0,
            {"mass.frequency": frequency},
            12,
            {"mass.position": 1.0},
            accuracy=accuracy,
            method=TaylorSeries(order),
        )
        errors.append(np.abs(found.states[:, 0] - np.cos(frequency * 20.0)).max())
        assert errors[-1] < 10 * accuracy
    assert errors[3] < 1e-4 * errors[0]


def test_series_in_lanes_agree_with_explicit_lanes_far_below_the_accuracy_of_either():
    plant, duration, _, arguments = PLANTS["drill string with a drive"]
    weights = {"bit.weight": np.linspace(5e4, 1.5e5, 40)}
    series, pairs = (
        batch(plant, duration, weights, 40, most_events=60, method=m, accuracy=1e-9, **arguments) for m in ("taylor", "explicit")
    )
    np.testing.assert_array_equal(series.switches, pairs.switches)
    np.testing.assert_array_equal(series.event_modes, pairs.event_modes)
    np.testing.assert_allclose(series.event_times, pairs.event_times, atol=1e-7)
    assert 1.5 * series.steps.sum() < pairs.steps.sum()
    assert series.alone.sum() == 0


def test_a_scenario_whose_series_ends_stops_there_and_a_sweep_runs_it_by_other_formulas():
    stiffness, start = np.linspace(50.0, 80.0, 3), {"ball.depth": -0.5}
    assert (batch(compose(Hertz()), 5.0, {"ball.stiffness": stiffness}, 3, start, method="taylor").statuses == NO_SERIES).all()
    run = Request(closed_loop(compose(Hertz()), start=start), 5.0, method="taylor").checked()
    asked = (metrics.final("ball.depth"), metrics.maximum("ball.speed"))
    task = Task(run, np.column_stack([stiffness]), asked, lanes=True)
    together = finished(task)
    exact = simulate(compose(Hertz()), 5.0, start=start, method="explicit", accuracy=1e-9)
    assert not together.errors
    assert together.values[0, 0] == pytest.approx(exact["ball.depth"][-1], abs=1e-5)
    assert together.values[0, 1] == pytest.approx(extent(exact, "ball.speed").maximum, abs=1e-5)


def test_where_series_would_be_too_long_and_between_samples_lanes_step_explicitly_and_say_so_of_the_former(monkeypatch):
    monkeypatch.setattr(taylor, "MOST", 10)
    run = Request(closed_loop(compose(Oscillator()), start={"mass.position": 0.5}), 3.0, method=TaylorSeries(11)).checked()
    lanes = Lanes(run)
    assert "would be too long" in lanes.why
    found = lanes.run(run.system.values[None], np.array([[0.5, 0.0]]))
    np.testing.assert_allclose(found.states, [[0.5 * math.cos(3.0), -0.5 * math.sin(3.0)]], atol=1e-6)
    monkeypatch.undo()
    sampled = Request(closed_loop(RIG, Sampled(PI(), 0.01)), 1.0, method="taylor").checked()
    assert Lanes(sampled).program.formulas.name == Lanes(dataclasses.replace(sampled, method=Explicit())).program.formulas.name
    assert not Lanes(sampled).why
    assert Lanes(Request(closed_loop(RIG), 1.0, method="taylor").checked()).program.formulas.name == "taylor16"
