"""Mechanisms through every verb: runs, lanes, C, an FMU and a stepper end alike, and derivatives and fits follow them."""

import math
import shutil
import sys

import numpy as np
import pytest

from models import (
    BacklashDrive,
    BandBrake,
    Coulomb,
    CrankSlider,
    GaussianStribeck,
    GearStage,
    OverrunningDrive,
    ScotchYoke,
    ShoeBrake,
    TwoWay,
    ValveSpool,
    Viscous,
)
from studies.benchmarks.machines_in_c import COMPILER, CompiledMachine
from tests.mechanisms import TWO_WAY, BrakedShaft, LaggedRelay, RubbedArm, Stack, TwoRelays, Wagons
from toolbox import (
    SceneError,
    closed_loop,
    compose,
    export_c,
    export_fmu,
    fit,
    limit_cycle,
    linearise,
    sensitivity,
    simulate,
    stepper,
    sweep,
)
from toolbox.errors import GrazingError
from toolbox.inputs import sine
from toolbox.measuring import metrics
from toolbox.simulation import TimeStepping
from toolbox.sweeps import grid
from toolbox.sweeps.batch import Task, finished, runs_in_lanes
from toolbox.sweeps.variants import shared_run, varied_numbers

DURATION, TIGHT = 6.0, 1e-10
LOOPS = {
    "bearing and brake": closed_loop(compose(BrakedShaft()), inputs={"drive.torque": sine(0.0, 4.0, 0.2)}),
    "one-way clutch": closed_loop(compose(OverrunningDrive()), inputs={"driver.torque": sine(0.5, 1.5, 0.25)}),
    "spool": closed_loop(compose(ValveSpool()), inputs={"spool.force": sine(0.0, 12.0, 1.4)}),
    "spool with a lip seal": closed_loop(compose(ValveSpool(friction=TWO_WAY)), inputs={"spool.force": sine(0.0, 12.0, 1.4)}),
    "viscous friction": closed_loop(
        compose(
            BrakedShaft(
                bearing=Viscous(GaussianStribeck(2.0, 1.0, 0.5), 0.4), brake=TwoWay(Viscous(Coulomb(0.4, 0.3), 0.2), Coulomb(0.5, 0.2))
            )
        ),
        inputs={"drive.torque": sine(0.0, 4.0, 0.2)},
    ),
    "ring of frictions": closed_loop(compose(Stack()), inputs={"drive.torque": sine(0.4, 4.0, 0.3)}),
    "prescribed motion": closed_loop(compose(RubbedArm()), inputs={"drive.torque": sine(0.0, 1.0, 1 / math.pi)}),
    "yoke": closed_loop(compose(ScotchYoke(damping=0.2)), start={"crank.speed": 1.3}, inputs={"crank.torque": sine(0.0, 1.0, 0.3)}),
    "crank": closed_loop(compose(CrankSlider(damping=0.05)), start={"crank.angle": 1.0}, inputs={"crank.torque": sine(0.0, 2.0, 2.0)}),
    "two shoes": closed_loop(
        compose(ShoeBrake()), start={"drum.speed": 3.0}, inputs={"drum.torque": sine(0.0, 20.0, 0.2), "drum.press": 100.0}
    ),
    "band": closed_loop(
        compose(BandBrake()), start={"drum.speed": 1.0}, inputs={"drum.torque": sine(0.0, 400.0, 0.35), "drum.pull": 200.0}
    ),
    "backlash": closed_loop(compose(BacklashDrive()), inputs={"driver.force": sine(0.0, 4.0, 0.32)}),
    "gear stage": closed_loop(compose(GearStage()), inputs={"input.torque": sine(0.0, 10.0, 1.0)}),
    "wagons": closed_loop(compose(Wagons()), inputs={"drive.torque": sine(1.0, 3.5, 0.2)}),
    "relay through lags": closed_loop(compose(LaggedRelay()), start={"lags.x": (1.0, 0.0, 0.0)}),
    "two relays": closed_loop(compose(TwoRelays()), start={"pair.x": (1.0, 1.0)}, inputs={"drive.torque": sine(0.0, 0.3, 0.5)}),
}
SPEEDS = {
    "yoke": "crank.speed", "crank": "crank.speed", "two shoes": "drum.speed", "band": "drum.speed", "backlash": "driver.speed",
    "gear stage": "input.speed", "one-way clutch": "driver.speed", "spool": "spool.speed", "spool with a lip seal": "spool.speed",
}  # fmt: skip
"""Signals that are compared, `shaft.speed` for all others."""
IN_LANES = {"bearing and brake", "crank", "two shoes", "band", "viscous friction", "ring of frictions", "yoke", "gear stage", "two relays"}
"""Machines whose events are settled in vector lanes; all others run alone in a sweep."""
each = pytest.mark.parametrize("name", LOOPS)
smooth = pytest.mark.parametrize("name", [name for name in LOOPS if "spool" not in name])
compiled = pytest.mark.skipif(COMPILER is None or sys.platform != "linux", reason="a machine in C is compiled with `cc`, which is not here")


def inertia(loop):
    return next(name for name in loop.plant.parameters if name.endswith(("inertia", "mass")))


def speed(name):
    return SPEEDS.get(name, "shaft.speed")


@pytest.fixture(scope="module")
def right():
    """{name: the speed at the end of an exact run}."""
    return {name: simulate(loop, DURATION, accuracy=TIGHT)[speed(name)][-1] for name, loop in LOOPS.items()}


@each
@pytest.mark.parametrize("method", ["event", "explicit", "taylor", "stiff"])
def test_all_methods_that_locate_events_agree(right, name, method):
    run = simulate(LOOPS[name], DURATION, method=method, accuracy=TIGHT)
    assert len(run.events) >= 2
    assert run[speed(name)][-1] == pytest.approx(right[name], abs=1e-8)


@each
def test_time_stepping_comes_as_near_as_its_step(right, name):
    run = simulate(LOOPS[name], DURATION, method=TimeStepping(step=2.5e-4))
    assert run[speed(name)][-1] == pytest.approx(right[name], abs=1e-3)


def lanes(loop, values, measured):
    """The task of runs in vector lanes: a sweep of so few would take them one after the other."""
    variations = grid({inertia(loop): values})
    run = shared_run(loop, variations, DURATION, accuracy=TIGHT, method="explicit")
    return Task(run, varied_numbers(run, variations)[0], measured, lanes=True)


@each
def test_lanes_end_where_single_runs_end(name):
    loop = LOOPS[name]
    number = inertia(loop)
    values = [part * loop.plant.parameter(number) for part in (0.7, 1.0, 1.3)]
    found = sweep(loop, {number: values}, DURATION, metrics={"end": metrics.final(speed(name))}, accuracy=TIGHT)
    single = [simulate(loop.replace(parameters={number: value}), DURATION, accuracy=TIGHT)[speed(name)][-1] for value in values]
    np.testing.assert_allclose(found["end"], single, rtol=0, atol=1e-8)
    task = lanes(loop, values, (metrics.final(speed(name)),))
    assert runs_in_lanes(task) == (name in IN_LANES)
    if name in IN_LANES:
        side_by_side = finished(task)
        assert side_by_side.errors == {}
        np.testing.assert_allclose(side_by_side.values[:, 0], single, rtol=0, atol=1e-8)


@compiled
@each
def test_a_machine_in_c_ends_where_simulate_ends(tmp_path, right, name):
    machine = CompiledMachine(export_c(LOOPS[name], tmp_path / "machine", part="loop", duration=DURATION, accuracy=TIGHT)[0])
    machine.run(DURATION)
    assert machine.output(speed(name)) == pytest.approx(right[name], abs=1e-8)


@pytest.mark.skipif(shutil.which("cc") is None or sys.platform != "linux", reason="an FMU is compiled with `cc`, which is not here")
@each
def test_an_fmu_in_fmpy_ends_where_simulate_ends(tmp_path, right, name):
    fmpy = pytest.importorskip("fmpy", reason="FMUs are loaded with fmpy, which is not here")
    path = export_fmu(LOOPS[name], tmp_path / "machine.fmu", part="loop", duration=DURATION, accuracy=TIGHT)
    found = fmpy.simulate_fmu(str(path), stop_time=DURATION, output_interval=DURATION / 4, output=[speed(name)])
    assert found[speed(name)][-1] == pytest.approx(right[name], abs=1e-8)


@each
def test_a_stepper_ends_where_simulate_ends(right, name):
    machine = stepper(LOOPS[name], DURATION / 10, outputs=(speed(name),), duration=DURATION, accuracy=TIGHT)
    machine.reset()
    seen, events = [], []
    for _ in range(10):
        seen.append(machine.step()[0])
        events += machine.events
    if "spool" not in name and name != "backlash":  # of bounces that come ever faster the number depends on the steps
        assert sorted(event[1:] for event in events) == sorted(
            tuple(event)[1:] for event in simulate(LOOPS[name], DURATION, accuracy=TIGHT).events
        )
    assert seen[-1] == pytest.approx(right[name], abs=1e-8)


@smooth
def test_sensitivities_are_differences_of_runs(name):
    loop = LOOPS[name]
    number = inertia(loop)
    value = loop.plant.parameter(number)
    ends = [
        simulate(loop.replace(parameters={number: value * part}), DURATION, accuracy=1e-12)[speed(name)][-1]
        for part in (1 - 1e-6, 1 + 1e-6)
    ]
    exact = sensitivity(simulate(loop, DURATION, accuracy=1e-11), number)[speed(name)][-1]
    assert float(np.ravel(exact)[0]) == pytest.approx((ends[1] - ends[0]) / (2e-6 * value), rel=1e-5)


@pytest.mark.parametrize("name", [name for name in LOOPS if "spool" in name])
def test_bounces_without_number_have_no_derivative_and_say_so(name):
    run = simulate(LOOPS[name], DURATION, accuracy=1e-11)
    with pytest.raises(GrazingError, match="guard of `(upper|seal)` only touches zero"):
        sensitivity(run, inertia(LOOPS[name]))


@smooth
def test_limit_cycles_close(name):
    if name == "wagons":  # they come to rest and meet at the same instant
        with pytest.raises(GrazingError, match="buffer"):
            limit_cycle(LOOPS[name], 60.0)
        return
    if name == "prescribed motion":
        with pytest.raises(SceneError, match="`period` must be given for a driven machine that depends on time by itself"):
            limit_cycle(LOOPS[name], 60.0)
    cycle = limit_cycle(LOOPS[name], 60.0, period=math.pi if name == "prescribed motion" else None)
    again = simulate(LOOPS[name], 41 * cycle.period, accuracy=1e-11)
    last, before, earlier = (again.at(k * cycle.period)[speed(name)] for k in (41, 40, 39))
    slowest = np.abs(cycle.multipliers).max(initial=0.0)
    if cycle.stable and slowest > 0.6:  # round by round the motion comes nearer by the largest multiplier
        assert (last - before) / (before - earlier) == pytest.approx(slowest, rel=1e-2)
    else:
        assert last == pytest.approx(before, abs=1e-6)


@each
def test_an_inertia_is_found_again_by_a_fit(name):
    loop = LOOPS[name]
    number = inertia(loop)
    value = loop.plant.parameter(number)
    times = np.linspace(0.0, 2.0, 600 if name == "crank" else 150)  # its torque turns fast
    seen = simulate(loop, 2.0, accuracy=TIGHT).at(times)
    noise = 1e-4 * np.random.default_rng(1).normal(size=times.size)
    log = {"time": times, speed(name): seen[speed(name)] + noise} | {word: seen[word] for word in loop.inputs}
    found = fit(loop.replace(parameters={number: 1.1 * value}), log, number, {number: (0.5 * value, 2 * value)}, starts=1)
    assert float(found.values[0]) == pytest.approx(value, rel=5e-3)


@pytest.mark.parametrize("name", [name for name, loop in LOOPS.items() if loop.inputs])
def test_linear_systems_and_onsets_ask_for_a_torque_that_stands_still(name):
    loop = LOOPS[name]
    with pytest.raises(
        SceneError, match=rf"`{next(iter(loop.inputs))}` must be a number for a linear system, but the loop varies it in time"
    ):
        linearise(loop)


def test_a_shaft_that_turns_steadily_has_both_frictions_in_its_slope():
    """J w' = T - bearing(w) - brake: the slope of the sum is that of the bearing, -2 (2 - 1) w / v^2 exp(-(w/v)^2), against the speed."""
    speed, v = 0.4, 0.5
    torque = 1.0 + np.exp(-((speed / v) ** 2)) + 0.6
    loop = closed_loop(compose(BrakedShaft()), inputs={"drive.torque": torque})
    found = linearise(loop, at={"shaft.speed": speed}, mode={"bearing": "slip+"})
    growth = 2 * speed / v**2 * np.exp(-((speed / v) ** 2))
    assert np.linalg.eigvals(found.A).real.max() == pytest.approx(growth, rel=1e-9)
