"""Taylor series in the event loop: the same switches as with explicit steps, no dip missed, and honest words where there are no series."""

import pickle
import threading
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

from controllers import PI
from models import BitRock, BlockOnBelt, Coulomb, Exponential, Hyperbolic, TorsionalChain, TwoDisks, wells
from tests.mechanisms import Hertz, Swing
from toolbox import Component, DryFriction, Equations, SceneError, compose, measure, sensitivity, simulate, state, time
from toolbox.compilation.runge_kutta import DOP853
from toolbox.inputs import sine
from toolbox.simulation import TaylorSeries

ROCK = BitRock(weight=97_000.0)
MACHINES = {
    "block on belt": (compose(BlockOnBelt()), 60.0, {}),
    "shaken block, exponential law": (
        compose(BlockOnBelt(friction=Exponential(static=1.0, kinetic=0.4, decay=8.0), damping=0.1)), 40.0, {"inputs": {"block.force": sine(0.2, 0.6, 0.4)}}),
    "drill string with PI": (compose(wells.JANSEN_2, ROCK, PI(proportional=4000.0, integral=1500.0, reference=8.0)), 60.0, {}),
    "drill string with limits": (
        compose(wells.JANSEN_2, ROCK, PI(proportional=4000.0, integral=1500.0, reference=8.0, lowest_torque=0.0, highest_torque=12_000.0)), 60.0, {}),
    "drill string under a sampled law": (
        compose(wells.JANSEN_2, ROCK), 20.0, {"controller": PI(proportional=4000.0, integral=1500.0, reference=8.0), "sample_time": 0.02}),
    "two disks": (compose(TwoDisks()), 2.0, {"start": {"disks.rotor_speed": 2.0}}),
    "five inertias, friction on all": (
        compose(TorsionalChain(inertia=(900.0, 120.0, 100.0, 110.0, 374.0), stiffness=(1800.0,) * 4, damping=(60.0,) * 4, top_drag=400.0,
                               friction=Coulomb(static=1.0, kinetic=0.9), friction_load=(2000.0, 300.0, 280.0, 320.0, 4000.0))),
        30.0, {"inputs": {"top.torque": sine(6000.0, 6000.0, 0.15)}}),
}  # fmt: skip


def switches(run):
    return [(event.element, event.before, event.after) for event in run.events]


@pytest.mark.parametrize("name", MACHINES)
def test_the_accuracy_asked_is_kept_with_the_switches_of_explicit_steps(name):
    plant, duration, arguments = MACHINES[name]
    exact = simulate(plant, duration, accuracy=1e-10, method="explicit", **arguments)
    assert len(exact.events) >= 4
    for accuracy in (1e-4, 1e-6, 1e-8):
        run = simulate(plant, duration, accuracy=accuracy, method="taylor", **arguments)
        assert run.program.formulas.series
        assert switches(run) == switches(exact), accuracy
        assert run.difference(exact) < 10 * accuracy
        np.testing.assert_allclose([e.time for e in run.events], [e.time for e in exact.events], atol=100 * accuracy)


@pytest.mark.parametrize("order", [8, 12, 16, 24])
def test_the_error_falls_with_the_accuracy_at_every_order(order):
    """The free oscillator x = cos t over twenty periods, against its closed form."""

    plant = compose(Swing())
    errors = []
    for accuracy in (1e-4, 1e-7, 1e-10):
        run = simulate(plant, 40 * np.pi, method=TaylorSeries(order), accuracy=accuracy, start={"swing.x": 1.0})
        times = np.linspace(0.0, 40 * np.pi, 333)
        errors.append(np.abs(run.at(times)["swing.x"] - np.cos(times)).max())
    assert all(error < 10 * accuracy for error, accuracy in zip(errors, (1e-4, 1e-7, 1e-10), strict=True))
    assert errors[2] < 1e-2 * errors[0]


@pytest.mark.parametrize(("high", "passes"), [(0.99, True), (0.9999, True), (1.0 - 1e-7, True), (1.0 + 1e-6, False)])
def test_a_guard_that_dips_within_a_long_step_is_found(high, passes):
    """x = cos t stays above 1 - 1e-7 for 9e-4 of a step of one, once in every period, and 1 + 1e-6 is never reached."""
    run = simulate(
        compose(Swing(high=high)),
        20 * np.pi + 1.0,
        method=TaylorSeries(24),
        accuracy=1e-9,
        start={"swing.x": 0.0, "swing.v": 1.0},
    )
    times = np.array([event.time for event in run.events])
    if not passes:
        assert not times.size
        return
    width = np.arccos(high)
    peaks = np.pi / 2 + 2 * np.pi * np.arange(10)
    assert np.diff(run.time).max() > 0.4  # most steps are far longer than the time above
    np.testing.assert_allclose(times, np.column_stack([peaks - width, peaks + width]).ravel(), atol=1e-6 * max(1.0, 1e-3 / width))


def test_a_friction_peak_that_no_coefficient_shows_is_seen_where_the_slip_turns():
    """A law that falls within 1/78 m/s: at a slip of 1 m/s it is below 1e-33 of its peak, and the slip returns to zero within a step or two."""
    law = Exponential(static=1.2149351637069161, kinetic=0.4, decay=77.85210497218921)
    plant = compose(BlockOnBelt(mass=0.28187878649834974, stiffness=84.69516082353003, belt_speed=1.0, friction=law))
    start = {"block.position": 0.4450538366047736}
    arguments = {"start": start, "inputs": {"block.force": sine(0.1, 0.9, 0.7)}}
    exact = simulate(plant, 20.0, accuracy=1e-9, method="explicit", **arguments)
    run = simulate(plant, 20.0, accuracy=1e-6, method="taylor", **arguments)
    assert len(exact.events) > 10
    assert switches(run) == switches(exact)
    assert run.difference(exact) < 1e-5
    assert sum(run.steps) < sum(exact.steps)


def test_states_between_nodes_come_from_the_coefficients():
    plant, duration, arguments = MACHINES["drill string with PI"]
    run = simulate(plant, duration, method="taylor", accuracy=1e-9, **arguments)
    exact = simulate(plant, duration, method="explicit", accuracy=1e-11, **arguments)
    times = np.sort(np.random.default_rng(1).uniform(0.0, duration, 400))
    mine, theirs = run.at(times).states, exact.at(times).states
    assert (np.abs(mine - theirs).max(axis=0) < 1e-8 * np.abs(theirs).max(axis=0)).all()
    given = simulate(plant, duration, method="taylor", accuracy=1e-9, output_times=times, **arguments)
    np.testing.assert_array_equal(given.states, mine)
    np.testing.assert_array_equal(run.at(run.time).states[-1], run.states[-1])
    found, expected = (measure.extent(one, "bit.speed") for one in (run, exact))
    assert (found.maximum, found.mean) == pytest.approx((expected.maximum, expected.mean), rel=1e-8)


def test_the_same_bits_alone_in_threads_and_after_travelling():
    plant, duration, arguments = MACHINES["five inertias, friction on all"]
    alone = simulate(plant, duration, method="taylor", **arguments)
    found = [None] * 4

    def again(k):
        found[k] = simulate(plant, duration, method="taylor", **arguments).states

    threads = [threading.Thread(target=again, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for states in found:
        np.testing.assert_array_equal(states, alone.states)
    travelled = pickle.loads(pickle.dumps(alone))
    times = np.linspace(0.0, duration, 77)
    np.testing.assert_array_equal(travelled.at(times).states, alone.at(times).states)
    np.testing.assert_array_equal(travelled.states, alone.states)


def test_a_paused_run_goes_on_with_the_same_bits():
    from toolbox import Budget

    plant, duration, arguments = MACHINES["shaken block, exponential law"]
    whole = simulate(plant, duration, method="taylor", **arguments)
    paused = simulate(plant, duration, method=TaylorSeries(budget=Budget(seconds=1e3)), **arguments)  # looks at the clock every few steps
    np.testing.assert_array_equal(whole.states, paused.states)
    np.testing.assert_array_equal(whole.time, paused.time)


def test_where_a_series_ends_explicit_steps_take_over_and_say_so():
    start = {"ball.depth": -0.5}
    run = simulate(compose(Hertz()), 5.0, method="taylor", start=start)
    assert "no Taylor series at t = " in run.why
    assert run.difference(simulate(compose(Hertz()), 5.0, method="explicit", start=start, accuracy=1e-9)) < 1e-5


def test_a_plant_whose_series_would_be_too_long_is_stepped_by_explicit_formulas(caplog):
    n = 60
    chain = TorsionalChain(inertia=(100.0,) * n, stiffness=(1e4,) * (n - 1), damping=(100.0,) * (n - 1), top_drag=400.0,
                           friction=Hyperbolic(static=1.0, decay=1.0), friction_load=(100.0,) * n)  # fmt: skip
    run = simulate(compose(chain), 0.1, method="taylor", inputs={"top.torque": 1e4})
    assert run.program.formulas is DOP853
    assert run.why == "explicit steps: the Taylor series of the plant would be too long"
    assert [record.getMessage() for record in caplog.records if record.levelname == "WARNING"] == [
        f"method='taylor' was not taken: {run.why}"
    ]


def test_a_plant_without_series_says_so_once_and_a_choice_of_the_toolbox_in_the_run_alone(caplog):
    arguments = {"inputs": {"block.force": ca.fmin(time, 0.05)}}
    run = simulate(compose(BlockOnBelt()), 0.1, method="taylor", **arguments)
    assert run.why == "explicit steps: an operation of the plant has no Taylor series"
    assert [record.getMessage() for record in caplog.records if record.levelname == "WARNING"] == [
        f"method='taylor' was not taken: {run.why}"
    ]
    caplog.clear()
    chosen = simulate(compose(BlockOnBelt()), 0.1, **arguments)
    assert "no Taylor series" in chosen.why
    assert not [record for record in caplog.records if record.levelname == "WARNING"]


@dataclass(frozen=True)
class Kinked(Component):
    """x'' = -|x'| x' - x + dry friction from rest: the argument of the kink is zero at the start and at every turn."""

    def equations(self, signal):
        x, v = state("mass.position", "m"), state("mass.speed", "m/s")
        rub = DryFriction("rub", slip=v, law=Coulomb(static=0.01, kinetic=0.01))
        return Equations(flow={x: v, v: -3.0 * ca.fabs(v) * v - x + 0.5 * ca.fmin(x, 0.2) + rub.force}, elements=[rub])


def test_kinks_are_passed_on_the_right_side():
    plant, start = compose(Kinked()), {"mass.position": 1.5}
    exact = simulate(plant, 20.0, accuracy=1e-11, method="explicit", start=start)
    run = simulate(plant, 20.0, accuracy=1e-8, method="taylor", start=start)
    assert len(exact.events) >= 2
    assert switches(run) == switches(exact)
    assert run.difference(exact) < 1e-7


def test_an_order_that_is_none_is_refused():
    for order in (3, 40, 12.5, True, "16"):
        with pytest.raises(SceneError, match="Argument `order` must be an integer >= 6 and <= 30"):
            simulate(MACHINES["block on belt"][0], 1.0, method=TaylorSeries(order))


def test_the_choice_takes_series_but_not_between_samples():
    plant, duration, arguments = MACHINES["block on belt"]
    run = simulate(plant, duration, **arguments)
    np.testing.assert_array_equal(run.states, simulate(plant, duration, method="taylor", **arguments).states)
    sampled, duration, arguments = MACHINES["drill string under a sampled law"]
    run = simulate(sampled, duration, **arguments)
    assert run.program.formulas.explicit
    np.testing.assert_array_equal(run.states, simulate(sampled, duration, method="explicit", **arguments).states)


def test_derivatives_of_a_run_by_series_are_those_of_explicit_steps():
    plant = MACHINES["block on belt"][0]
    found, expected = (sensitivity(simulate(plant, 20.0, method=m), to=["belt.friction.static"]) for m in ("taylor", "explicit"))
    np.testing.assert_array_equal(found["block.position"], expected["block.position"])
    assert np.abs(found.end("block.position")).max() > 0.0


@dataclass(frozen=True)
class Unmoved(Component):
    """An oscillator, and a mode beside it that nothing couples to it."""

    def equations(self, signal):
        x, v = state("slider.position", "m"), state("slider.speed", "m/s")
        y, w = state("mode.position", "m"), state("mode.speed", "m/s")
        return Equations(flow={x: v, v: -x, y: w, w: -y})


def test_a_mode_that_nothing_moves_is_left_out_of_the_error_and_a_small_motion_is_not():
    for size, least, most in ((2e-11, 0.0, 1e-6), (2e-9, 0.3, 0.4)):
        one, other = (
            simulate(compose(Unmoved()), 10.0, start={"slider.position": 1.0, "mode.position": times * size}) for times in (1.0, 1.5)
        )
        assert least <= one.difference(other) <= most
