"""Arguments of `simulate` and of its results that cannot be meant, and failed runs: typed errors that name what is wrong."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from controllers import PI
from models import BitRock, BlockOnBelt, BlocksOnBelt, Coulomb, wells
from tests.plants import BELT, RIG
from tests.refusals import each_of, refusals
from toolbox import Budget, SceneError, SimulationError, compose, simulate, time
from toolbox.authoring import time_left
from toolbox.errors import BudgetError, ZenoError
from toolbox.inputs import ramp, sine, step
from toolbox.modelling.inputs import sweep
from toolbox.simulation import EventExact, TimeStepping

NO_NUMBERS = [math.nan, math.inf, -math.inf, "1", "abc", None, True, [1.0], {}, 1j, 10**400, object()]


def named(value):
    return "1e400" if isinstance(value, int) and not isinstance(value, bool) and value > 1e300 else type(value).__name__ + repr(value)[:12]


@pytest.mark.parametrize("good", [[0.0], [1.0], [0.0, 1.0], (0.1, 0.2), np.linspace(0, 1, 3), range(2), [0, 1]], ids=named)
def test_output_times_may_be_any_increasing_sequence(good):
    run = simulate(BELT, 1.0, output_times=good)
    np.testing.assert_array_equal(run.time, list(good))


def test_output_times_are_copied():
    grid = np.linspace(0, 1, 5)
    run = simulate(BELT, 1.0, output_times=grid)
    grid[:] = 7.0
    np.testing.assert_array_equal(run.time, np.linspace(0, 1, 5))
    assert run.error_estimate < 1e-5


# --- start


def test_a_start_may_name_a_state_an_entry_a_signal_or_fill_a_vector():
    for start, expected in (
        ({"chain.speed": (3.0, 2.0)}, (3.0, 2.0)),
        ({"chain.speed": 4.0}, (4.0, 4.0)),
        ({"chain.speed.1": 2.0}, (0.0, 2.0)),
        ({"bit.speed": 2.0, "top.speed": 3.0}, (3.0, 2.0)),
        ({"chain.speed": 4.0, "bit.speed": 0.0}, (4.0, 0.0)),
        ({"bit.speed": 0.0, "chain.speed": 4.0}, (4.0, 0.0)),  # what is said of an entry holds, in whatever order
    ):
        np.testing.assert_array_equal(simulate(RIG, 1.0, start=start).at(0.0)["chain.speed"], expected)


# --- inputs


@pytest.mark.parametrize(
    "bad",
    [math.nan, math.inf, "1", None, True, [1.0], {}, 1j, 10**400, object(), lambda t: t, np.array([1.0, 2.0]), ((0.0, 1.0),), (1.0, 2.0, 3.0), ca.SX.sym("a"),
     ca.vertcat(time, time), ca.DM(math.nan), ca.SX(math.nan), ca.MX.sym("m")],
    ids=named,
)  # fmt: skip
def test_a_bad_input_is_refused_by_name(bad):
    with pytest.raises(SceneError, match=r"block\.force"):
        simulate(BELT, 1.0, inputs={"block.force": bad})


@pytest.mark.parametrize(
    "table",
    [((0.0, 1.0), (0.0,)), ((), ()), ((1.0, 0.0), (0.0, 1.0)), ((0.0, math.nan), (0.0, 1.0)), ((0.0, 1.0), (0.0, math.inf)), (("a", "b"), (0.0, 1.0)),
     ((0.0, 1.0), None), (([0.0], [1.0]), (0.0, 1.0)), ((0.0, 1.0), (0.0, 1j)), (5.0, 5.0)],
    ids=named,
)  # fmt: skip
def test_a_bad_table_is_refused_by_name(table):
    with pytest.raises(SceneError, match=r"block\.force"):
        simulate(BELT, 1.0, inputs={"block.force": table})


@pytest.mark.parametrize(
    "make",
    [lambda: sine(0.0, math.nan, 1.0), lambda: sine(0.0, "1 N", "1 N"), lambda: sine(0.0, 1.0, None), lambda: sine(True, 1.0, 1.0),
     lambda: sweep(0.0, 1.0, 0.1, 1.0, 0.0), lambda: sweep(0.0, 1.0, 0.1, 1.0, -1.0), lambda: sweep(0.0, 1.0, math.inf, 1.0, 1.0),
     lambda: step(0.0, math.nan, 1.0), lambda: step(0.0, 1.0, "now"), lambda: ramp(0.0, 1.0, 2.0, 1.0), lambda: ramp(0.0, None, 0.0, 1.0)],
)  # fmt: skip
def test_a_bad_shape_is_refused(make):
    with pytest.raises(SceneError):
        make()


def test_a_signal_may_be_overridden_in_time_or_by_its_constant_but_not_both():
    with pytest.raises(SceneError, match=r"bit\.weight.*both"):
        simulate(RIG, 1.0, inputs={"bit.weight": 1e4}, parameters={"bit.weight": 2e4})
    once = simulate(RIG, 10.0, inputs={"bit.weight": 5e4, "top.torque": 9e3})
    other = simulate(RIG, 10.0, parameters={"bit.weight": 5e4, "top.torque": 9e3})
    assert [e.time for e in once.events] == pytest.approx([e.time for e in other.events], rel=1e-9)


def test_numbers_tables_shapes_and_expressions_of_one_function_give_one_answer():
    # 0.3 as a number, a table, a shape and an expression; a ramp as a table, a shape and an expression
    runs = [
        simulate(BELT, 20.0, inputs={"block.force": value}, accuracy=1e-9)
        for value in (0.3, ((0.0,), (0.3,)), sine(0.3, 0.0, 1.0), 0.3 + 0 * time)
    ]
    for run in runs[1:]:
        assert [e.time for e in run.events] == pytest.approx([e.time for e in runs[0].events], abs=1e-7)
    values = (((0.0, 20.0), (0.0, 0.4)), ramp(0.0, 0.4, 0.0, 20.0), 0.02 * time)
    runs = [simulate(BELT, 20.0, inputs={"block.force": value}, accuracy=1e-9) for value in values]
    for run in runs[1:]:
        assert [e.time for e in run.events] == pytest.approx([e.time for e in runs[0].events], abs=1e-7)
    grid = np.linspace(0, 20, 41)
    for run in runs:
        np.testing.assert_allclose(run.at(grid)["block.force"], 0.02 * grid, atol=1e-14)


def test_a_shape_is_its_formula():
    grid = np.linspace(0, 10, 201)
    run = simulate(BELT, 10.0, inputs={"block.force": sine(0.1, 0.2, 0.7, 0.3)})
    np.testing.assert_allclose(run.at(grid)["block.force"], 0.1 + 0.2 * np.sin(2 * np.pi * 0.7 * grid + 0.3), atol=1e-13)
    run = simulate(BELT, 10.0, inputs={"block.force": sweep(0.1, 0.2, 0.5, 2.0, 10.0)})
    # phase 2 pi (f0 t + (f1 - f0) t^2 / (2 T)): its rate is the frequency, 0.5 Hz at the start and 2 Hz at the end
    np.testing.assert_allclose(run.at(grid)["block.force"], 0.1 + 0.2 * np.sin(2 * np.pi * (0.5 + 1.5 * grid / 20) * grid), atol=1e-12)


def test_a_table_holds_its_ends_and_jumps_to_the_right_at_repeated_times():
    table = ((1.0, 2.0, 2.0, 2.0, 3.0), (0.1, 0.2, 9.0, -0.3, 0.0))
    run = simulate(BELT, 4.0, inputs={"block.force": table})
    times = [0.0, 1.0, 1.5, 2.0 - 1e-9, 2.0, 2.5, 3.0, 4.0]
    np.testing.assert_allclose(run.at(times)["block.force"], [0.1, 0.1, 0.15, 0.2, -0.3, -0.15, 0.0, 0.0], atol=1e-8)


def test_a_table_may_begin_before_the_run_and_end_after_it():
    run = simulate(BELT, 4.0, inputs={"block.force": ((-10.0, 10.0), (-0.5, 0.5))})
    np.testing.assert_allclose(run.at([0.0, 2.0, 4.0])["block.force"], [0.0, 0.1, 0.2], atol=1e-15)


def test_a_table_of_very_many_nodes_is_followed():
    nodes = np.linspace(0, 1.0, 20_000)
    run = simulate(BELT, 1e-3, inputs={"block.force": (nodes, 0.1 * np.sin(nodes))})
    assert run.at(1e-3)["block.force"] == pytest.approx(0.1 * np.sin(1e-3), abs=1e-9)


@pytest.mark.parametrize("name", ["start", "inputs", "parameters"])
def test_an_empty_mapping_is_none(name):
    assert simulate(BELT, 5.0, **{name: {}}).events == simulate(BELT, 5.0).events


def test_arguments_are_left_as_they_were_given():
    start, inputs, parameters = {"block.speed": 0.1}, {"block.force": ([0.0, 1.0], [0.0, 0.1])}, {"block.mass": 2.0}
    simulate(BELT, 1.0, start=start, inputs=inputs, parameters=parameters)
    assert (start, inputs, parameters) == ({"block.speed": 0.1}, {"block.force": ([0.0, 1.0], [0.0, 0.1])}, {"block.mass": 2.0})


# --- results


test_wrong_uses_are_refused_in_these_words = refusals(
    *each_of(lambda bad: simulate(BELT, bad), "duration", [*NO_NUMBERS, -1.0, -1e-300]),
    *each_of(lambda bad: simulate(BELT, 1.0, accuracy=bad), "accuracy", [*(each for each in NO_NUMBERS if each is not None), 0.0, -1e-6, 1e-14, 0.11,
     1.0]),
    *each_of(lambda bad: simulate(BELT, 1.0, method=bad), "method", ["Event", "rk45", 5, True]),
    *each_of(lambda bad: simulate(bad, 1.0), "plant", [None, 5, "block", BlockOnBelt(), BlockOnBelt, [BELT], compose]),
    *each_of(lambda bad: simulate(BELT, 1.0, output_times=bad), "output_times", [[], [0.5, 0.5], [0.5, 0.2], [-0.1, 0.5], [0.5, 1.1], [math.nan],
     [0.1, math.nan], [math.inf], "abc", ["a"], [None], [[0.1, 0.2], [0.3, 0.4]], {}, [1j], [True, False], 10**400, object()]),
    *[(lambda bad=bad: simulate(BELT, 1.0, output_times=bad), word) for bad, word in [([0.5, 0.2], "0.5 s is followed by 0.2 s"),
     ([-0.1, 1], "begin at -0.1 s"), ([0.4, 1.2], "end at 1.2 s"), ([], "shape")]],
    *each_of(lambda bad: simulate(BELT, 1.0, start={"block.speed": bad}), r"block\.speed", [math.nan, math.inf, "1", "abc", None, True, [1.0, 2.0],
     {}, 1j, 10**400, object(), ca.SX.sym("a")]),
    *each_of(lambda bad: simulate(RIG, 1.0, start={"chain.speed": bad}), r"chain\.speed", [(1.0,), (1.0, 2.0, 3.0), ((1.0, 2.0),), (1.0, math.nan),
     "ab"]),
    *[(lambda wrong=wrong: simulate(BELT, 1.0, start={wrong: 1.0}), f"{wrong}.*{right}") for wrong, right in [("block.sped", "block.speed"),
     ("block.velocity", "block"), ("speed", "block.speed"), ("chain", "block")]],
    *[(lambda name=name: simulate(BELT if name.startswith("belt") else RIG, 1.0, start={name: 1.0}), name) for name in ["belt.force", "belt.slip",
     "top.load", "bit.torque", "bit.weight", "top.torque", "chain.inertia"]],
    *each_of(lambda value: simulate(RIG, 1.0, inputs={"bit.weight": value}), r"bit\.weight", [-1.0, ((0.0, 1.0), (1.0, -1.0)), sine(0.0, 1.0, 1.0),
     step(1.0, -1.0, 0.5), ramp(1.0, -1.0, 0.0, 1.0)]),
    *[(lambda wrong=wrong: simulate(BELT, 1.0, inputs={wrong: 1.0}), f"{wrong}.*{right}") for wrong, right in [("block.forse", "block.force"),
     ("force", "block.force"), ("block.forces", "block.force")]],
    *[(lambda name=name: simulate(RIG, 1.0, inputs={name: 1.0}), f"{name}.*gives") for name in ["bit.speed", "bit.torque", "top.load",
     "chain.speed"]],
    *[(lambda bad=bad, name=name: simulate(BELT, 1.0, **{name: bad}), name) for bad in [5, "abc", ["block.speed"], 1.5, [("block.speed", 1.0, 2.0)]]
     for name in ["start", "inputs", "parameters"]],
    # a key that is no name is refused
    *[(lambda key=key, name=name: simulate(BELT, 1.0, **{name: {key: 1.0}}), "") for key in [5, None, ("block", "speed")]
     for name in ["start", "inputs", "parameters"]],
    *each_of(lambda ask: ask(), r"block\.sped.*block\.speed", (lambda: simulate(BELT, 1.0)["block.sped"],
     lambda: simulate(BELT, 1.0).at(0.5)["block.sped"], lambda: simulate(BELT, 1.0).unit("block.sped"))),
    (lambda: simulate(BELT, 1.0).time_in("bel", "stick"), "bel.*belt"),
    (lambda: simulate(BELT, 1.0).time_in("belt", "stik"), "stik.*stick"),
    *each_of(lambda bad: simulate(BELT, 1.0).at(bad), "time", [-1e-9, 1.0000001, math.nan, math.inf, "a", None, [0.5, math.nan], [-1.0, 0.5],
     object()]),
)  # fmt: skip


def test_a_result_may_be_asked_at_no_time_at_one_and_at_many_in_any_order():
    run = simulate(BELT, 10.0)
    assert run.at([])["block.speed"].shape == (0,)
    assert isinstance(run.at(3.0)["block.speed"], float)
    times = np.array([7.0, 3.0, 3.0, 9.9, 0.0])
    np.testing.assert_array_equal(run.at(times)["block.speed"], [run.at(float(t))["block.speed"] for t in times])


def test_a_vector_signal_has_one_row_per_time():
    run = simulate(compose(wells.NAVARRO_LOPEZ_4, BitRock()), 5.0, inputs={"top.torque": 1e4}, output_times=[0.0, 2.0, 5.0])
    assert run["chain.speed"].shape == (3, 4)
    assert run["chain.twist"].shape == (3, 3)
    assert run.at(1.0)["chain.speed"].shape == (4,)
    np.testing.assert_array_equal(run["chain.speed.3"], run["bit.speed"])
    with pytest.raises(SceneError, match=r"chain\.speed\.4"):
        run["chain.speed.4"]


def test_every_signal_of_a_result_has_values_and_a_unit():
    run = simulate(RIG, 20.0, controller=PI())
    for name in run.names:
        assert name in run
        assert run.unit(name)
        assert np.isfinite(run[name]).all()
        assert len(run[name]) == run.time.size


# --- failed runs


def blow_up():
    """v' = +v^2 by a force that no friction can hold: a spring of negative stiffness is not allowed, an input that explodes is."""
    return simulate(BELT, 2.0, start={"block.speed": 0.2}, inputs={"block.force": 0.01 / (1 - time)})


def test_a_failed_run_carries_what_there_is_so_far():
    with pytest.raises(SimulationError) as caught:
        blow_up()
    run = caught.value.run
    assert 0.9 < run.time[-1] <= 1.0
    assert run.at(0.3)["block.position"] == pytest.approx(0.06, rel=1e-9)
    assert run.time_in("belt", "stick") > 0.3
    assert "BlockOnBelt" in str(run)


def test_a_failed_run_is_not_asked_beyond_its_end():
    with pytest.raises(SimulationError) as caught:
        blow_up()
    with pytest.raises(SceneError, match="time"):
        caught.value.run.at(1.5)


def test_a_failed_run_counts_only_the_time_it_lived():
    with pytest.raises(SimulationError) as caught:
        blow_up()
    run = caught.value.run
    assert sum(run.time_in("belt", mode) for mode in ("stick", "slip+", "slip-")) == pytest.approx(run.time[-1], rel=1e-9)


@pytest.mark.parametrize("grid", [None, np.linspace(0, 300, 11)], ids=["steps", "grid"])
@pytest.mark.parametrize("budget", [Budget(steps=1000), Budget(seconds=0.05), Budget(events=100)], ids=["steps", "seconds", "events"])
def test_a_run_that_uses_up_its_budget_says_how_far_it_came(budget, grid):
    # 20 000 rad/s for 300 s, two reversals in every period
    fast = compose(BlockOnBelt(belt_speed=0.0, stiffness=4e8, load=1e-3, friction=Coulomb(static=1.0, kinetic=1.0)))
    with pytest.raises(BudgetError, match=r"1000 steps.*t = |0\.\d+ s and.*t = |its 100 events.*t = .*`belt`") as caught:
        simulate(fast, 300.0, start={"block.position": 1.0}, output_times=grid, method=EventExact(budget=budget))
    run = caught.value.run
    assert run.steps[0] + run.steps[1] <= budget.steps + 5 and len(run.events) <= budget.events
    assert 0 < run.end < 300.0 and run.wall_time < 1.0
    assert (
        simulate(fast, 1e-4, start={"block.position": 1.0}, method=EventExact(budget=budget)).end == 1e-4
    )  # within its budget it is a run like any other


@pytest.mark.parametrize("grid", [None, np.linspace(0, 60, 301)], ids=["steps", "grid"])
@pytest.mark.parametrize("method", [EventExact(), TimeStepping(0.01)], ids=["event", "time-stepping"])
def test_a_run_may_spend_exactly_its_events_and_ends_where_the_next_is_due(method, grid):
    whole = simulate(BELT, 60.0, output_times=grid, method=method)
    total = len(whole.events)
    assert total > 6
    assert simulate(BELT, 60.0, output_times=grid, method=replace(method, budget=Budget(events=total))).events == whole.events
    for most in (1, 5, total - 1):
        with pytest.raises(BudgetError, match=rf"used its {most} events and reached t = .*`belt`") as caught:
            simulate(BELT, 60.0, output_times=grid, method=replace(method, budget=Budget(events=most)))
        run, after = caught.value.run, whole.events[most]
        assert run.events == whole.events[:most]
        assert run.end == after.time and run.at(run.end).modes["belt"] == after.before
        assert run.time_in("belt", "stick") == pytest.approx(whole.time_in("belt", "stick", until=after.time), rel=1e-12)


def test_events_of_one_instant_are_within_a_budget_together_or_not_at_all():
    # two blocks that nothing ties break away from one belt at the same time
    twins = compose(BlocksOnBelt(mass=(1.0, 1.0), tie=(0.0,)))
    whole = simulate(twins, 20.0)
    assert [e.time for e in whole.events[2:4]] == [whole.events[2].time] * 2
    for most, kept in ((2, 2), (3, 2), (4, 4)):
        with pytest.raises(BudgetError) as caught:
            simulate(twins, 20.0, method=EventExact(budget=Budget(events=most)))
        assert caught.value.run.events == whole.events[:kept]


def test_a_budget_is_of_positive_numbers():
    for wrong in (Budget(steps=0), Budget(seconds=float("nan")), Budget(events=-1)):
        with pytest.raises(SceneError, match=r"Argument `budget\.\w+` must be a number > 0, but it is"):
            simulate(BELT, 1.0, method=EventExact(budget=wrong))
    for wrong in (Budget(steps=1.5), Budget(steps=np.inf), Budget(events=0.5), Budget(events=np.float64(2.5))):  # type: ignore[arg-type]
        with pytest.raises(SceneError, match=r"Argument `budget\.(steps|events)` must be a whole number > 0, but it is"):
            simulate(BELT, 1.0, method=EventExact(budget=wrong))
    for right in (Budget(steps=np.int64(1000), events=np.inf), Budget(events=np.int32(100)), Budget(events=1e6)):
        assert simulate(BELT, 1.0, method=EventExact(budget=right)).end == 1.0
    with pytest.raises(SceneError, match=r"`budget` must be a Budget, such as Budget\(seconds=60\), but it is 60"):
        simulate(BELT, 1.0, method=EventExact(budget=60))


def test_a_law_in_python_is_stopped_by_the_clock_too():
    with pytest.raises(BudgetError, match=r"0\.\d+ s and reached") as caught:
        simulate(RIG, 1e4, controller=lambda t, y: 9000.0, sample_time=0.01, method=EventExact(budget=Budget(seconds=0.1)))
    assert caught.value.run.end > 0.0


def test_a_law_that_plans_too_long_ends_with_the_seconds_of_its_run():
    """A sample without end ends where the law asks how much time is left; outside a run there is no end of it."""
    plant, asked = compose(wells.JANSEN_2, BitRock()), []

    def planned(t, y):
        while t > 0.05:
            asked.append(time_left())
        return 9000.0

    with pytest.raises(BudgetError, match=r"s and reached t = 0\.06 s") as caught:
        simulate(plant, 10.0, controller=planned, sample_time=0.01, method=EventExact(budget=Budget(seconds=0.2)))
    assert caught.value.run.end == 0.06 and len(caught.value.run.controllers) == 1
    assert 0.0 < min(asked) <= max(asked) <= 0.2 and sorted(asked, reverse=True) == asked
    assert time_left() == math.inf


def test_the_budget_of_a_run_holds_for_runs_within_its_laws():

    def nested(t, y):
        def endless(t, y):
            while True:
                time_left()

        simulate(RIG, 1.0, controller=endless, sample_time=0.1)

    with pytest.raises(BudgetError, match=r"of 10 s"):
        simulate(RIG, 10.0, controller=nested, sample_time=0.01, method=EventExact(budget=Budget(seconds=0.1)))


def test_a_run_stopped_by_its_budget_is_as_good_as_far_as_it_goes():
    """Stick phases of Leine's block before it was stopped are those of a run that was not."""
    with pytest.raises(BudgetError) as caught:
        simulate(BELT, 1e5, output_times=np.arange(1e5), method=EventExact(budget=Budget(steps=2000)))
    run, whole = caught.value.run, simulate(BELT, caught.value.run.end)
    assert run.at(run.end)["block.position"] == pytest.approx(whole.at(run.end)["block.position"], abs=1e-6)
    assert run.time_in("belt", "stick") == pytest.approx(whole.time_in("belt", "stick"), abs=1e-5)
    assert 0 < run.error_estimate < 1e-5


def test_the_errors_are_a_family_a_caller_can_catch():
    assert issubclass(SceneError, ValueError)
    assert issubclass(SimulationError, RuntimeError)
    assert issubclass(ZenoError, SimulationError) and issubclass(BudgetError, SimulationError)
    assert not issubclass(SimulationError, SceneError)


def test_an_input_that_is_nan_at_some_time_ends_the_run_there():
    # log(1 - t) is finite until t = 1 and NaN from then on
    with pytest.raises(SimulationError) as caught:
        simulate(BELT, 2.0, inputs={"block.force": 0.01 * ca.log(1 - time)})
    assert caught.value.run.time[-1] <= 1.0 + 1e-9
    assert np.isfinite(caught.value.run.states).all()


def test_an_input_that_is_nan_from_the_start_is_refused_at_once():
    with pytest.raises((SceneError, SimulationError)) as caught:
        simulate(BELT, 2.0, inputs={"block.force": ca.sqrt(time - 1)})
    assert caught.value is not None


@pytest.mark.parametrize("start", [1e150, 1e200, 1e300])
def test_a_start_so_large_that_numbers_overflow_ends_in_a_typed_error_or_in_a_finite_answer(start):
    try:
        run = simulate(BELT, 1.0, start={"block.position": start})
    except SimulationError:
        return
    assert np.isfinite(run.states).all()


def test_a_run_after_a_failed_one_is_not_affected():
    before = simulate(BELT, 20.0).events
    with pytest.raises(SimulationError):
        blow_up()
    assert simulate(BELT, 20.0).events == before


def test_the_same_run_twice_is_the_same_to_the_last_bit():
    for settings in ({}, {"accuracy": 1e-10}, {"output_times": np.linspace(0, 30, 100)}):
        first, second = (simulate(BELT, 30.0, **settings) for _ in range(2))
        np.testing.assert_array_equal(first.states, second.states)
        assert first.events == second.events


@pytest.mark.parametrize("sample_time", [None, 0.1])
def test_a_number_of_the_law_is_a_parameter_of_its_loop_alone(sample_time):
    changed = simulate(RIG, 1.0, controller=PI(), sample_time=sample_time, parameters={"pi.integral": 3.0})
    written = simulate(RIG, 1.0, controller=PI(integral=3.0), sample_time=sample_time)
    np.testing.assert_array_equal(changed.states, written.states)
    with pytest.raises(SceneError, match=r"There is no parameter `pi\.integral`"):
        simulate(RIG, 1.0, parameters={"pi.integral": 3.0})
    with pytest.raises(SceneError, match=r"There is no parameter `pi\.integra`"):
        simulate(RIG, 1.0, controller=PI(), sample_time=sample_time, parameters={"pi.integra": 3.0})
