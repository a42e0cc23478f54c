"""Sweeps in lanes: the numbers of runs one after the other, the same failures in the same words, and nothing that depends on neighbours."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.special import j0

from controllers import PI, StiffPI
from models import BlockOnBelt, DiscBrake
from tests.fading_brake import FadingBrake
from tests.lanes.test_lanes_sample import CHAIN
from tests.mechanisms import Oscillator
from tests.plants import RIG
from tests.sweeps.test_sweep import Growth
from tests.together import together
from toolbox import Sampled, closed_loop, compose, measure, simulate, sweep
from toolbox.lanes.lanes import Lanes
from toolbox.measuring import metrics
from toolbox.modelling.inputs import sine
from toolbox.sweeps import Sweep, batch, store, uniform
from toolbox.sweeps.batch import FEWEST_LANES, Task, finished, pays_in_lanes
from toolbox.sweeps.variants import shared_run, varied_numbers

TORQUE = ([0.0, 9.0, 9.0, 20.0], [0.0, 12e3, 9e3, 14e3])
# plant, what varies, duration, other arguments, signals, the contact judged
PLANTS = {
    "drill string": (
        RIG, {"bit.weight": (9e4, 1.1e5), "pi.reference": (6.0, 12.0)}, 60.0, {"controller": PI()}, ("bit.speed", "top.torque"), "bit",
    ),
    "belt": (compose(BlockOnBelt()), {"block.mass": (0.7, 1.3)}, 40.0, {}, ("block.position", "block.speed"), "belt"),
    "forced belt": (
        compose(BlockOnBelt()), {"block.belt_speed": (0.2, 0.3)}, 30.0, {"inputs": {"block.force": sine(0.0, 0.1, 0.2)}}, ("block.speed",), "belt",
    ),
    "table": (RIG, {"bit.weight": (5e4, 9e4)}, 40.0, {"inputs": {"top.torque": TORQUE}}, ("bit.speed",), "bit"),
    "friction on all": (
        compose(CHAIN), {"chain.friction_load.1": (200.0, 500.0)}, 30.0, {"inputs": {"top.torque": sine(2e3, 3e3, 0.2)}}, ("bit.speed",), "chain.2",
    ),
    "brake": (
        compose(DiscBrake()), {"disc.force": (800.0, 1200.0)}, 0.5, {"start": {"disc.speed": 2.0}}, ("pad.speed", "brake.torque"), "pad",
    ),
}  # fmt: skip


def task_of(name, accuracy, runs, seed=1, method="explicit"):
    plant, ranges, duration, arguments, signals, element = PLANTS[name]
    element = element if element in {e.name for e in plant.elements} else plant.elements[0].name
    after, until = 0.3141 * duration, 0.8765 * duration
    asked = []
    for signal in signals:
        for window in ((after, until), (0.0, duration / 8)):
            asked += [metrics.minimum(signal, *window), metrics.maximum(signal, *window), metrics.mean(signal, *window)]
        asked += [metrics.final(signal), metrics.severity(signal, after, until=until)]
    asked += [metrics.time_in(element, after, until), metrics.stuck_ratio(element, after), metrics.last_stay(element)]
    asked += [metrics.stays(element, after, until), metrics.events(element)]
    variations = uniform(ranges, runs, seed)
    loop, rest = together(plant, **arguments)
    run = shared_run(loop, variations, duration, method=method, accuracy=accuracy, **rest)
    return Task(run, varied_numbers(run, variations)[0], tuple(asked))


METHODS = pytest.mark.parametrize("method", ["explicit", "taylor"])


@METHODS
@pytest.mark.parametrize("name", PLANTS)
def test_all_measures_are_those_of_runs_one_after_the_other(name, method):
    accuracy, duration = 1e-8, PLANTS[name][2]
    task = task_of(name, accuracy, 24, method=method)
    found = finished(dataclasses.replace(task, lanes=True))
    expected = finished(task_of(name, accuracy / 100, 24))
    assert not found.errors and not expected.errors
    values = dict(zip(task.metrics, expected.values.T, strict=True))
    for q, asked in enumerate(task.metrics):
        if asked.name in ("sticks", "events"):
            np.testing.assert_array_equal(found.values[:, q], values[asked])
            continue
        size = {"stuck": duration, "last_stick": duration, "stuck_ratio": 1.0}.get(asked.name)
        if size is None:
            extremes = [np.abs(column) for m, column in values.items() if m.of == asked.of and m.name in ("minimum", "maximum")]
            size = np.max(extremes, axis=0)
        if asked.name == "severity":  # swing over twice the mean: an error of the mean counts more the smaller it is
            average = np.abs(values[metrics.mean(asked.of, asked.after, asked.until)])
            size = np.maximum(1.0, values[asked]) * size / average
        assert np.array_equal(np.isnan(found.values[:, q]), np.isnan(values[asked]))
        # the accuracy asked is kept within ten
        assert np.nanmax(np.abs(found.values[:, q] - values[asked]) / size, initial=0.0) <= 10 * accuracy, asked


@METHODS
@pytest.mark.parametrize("name", PLANTS)
def test_neighbours_change_nothing_to_the_last_bit(name, method):
    task = dataclasses.replace(task_of(name, 1e-6, 130, method=method), lanes=True)
    whole = finished(task)
    for cut in (slice(0, 1), slice(1, 18), slice(50, 130)):
        np.testing.assert_array_equal(finished(task.part(cut)).values, whole.values[cut])


def test_a_sweep_that_was_interrupted_ends_with_the_same_bits(tmp_path, monkeypatch):
    monkeypatch.setattr(batch, "LANES_WORK", 0.0)
    loop, arguments = closed_loop(RIG, StiffPI()), {"duration": 30.0, "metrics": ("severity", "stuck_ratio", "events")}
    weights = {"bit.weight": np.linspace(50e3, 110e3, 700)}
    whole = sweep(loop, weights, **arguments)
    pytest.importorskip("zarr")
    monkeypatch.setattr(store, "ROWS", 150)
    sweep(loop, weights, checkpoint=tmp_path / "found", **arguments)
    written = sorted((tmp_path / "found" / "status" / "c").iterdir())
    assert len(written) > 2
    for path in (written[0], written[-1]):
        path.unlink()
    found = sweep(loop, weights, checkpoint=tmp_path / "found", **arguments)
    for name in arguments["metrics"]:
        np.testing.assert_array_equal(found[name], whole[name])
        np.testing.assert_array_equal(Sweep.load(tmp_path / "found")[name], whole[name])


def test_a_failed_run_fails_in_the_words_of_a_run_alone(monkeypatch):
    rates = np.linspace(0.0, 0.9, FEWEST_LANES + 7)
    rates[[5, 60]] = 3.0
    given = {"duration": 1.0, "accuracy": 1e-10, "metrics": {"x": metrics.final("growth.size")}}
    loop = closed_loop(compose(Growth()), start={"growth.size": 1.0})
    alone = sweep(loop, {"growth.rate": rates}, **given)
    monkeypatch.setattr(batch, "LANES_WORK", 0.0)
    found = sweep(loop, {"growth.rate": rates}, **given)
    assert list(found.failures) == [5, 60]
    assert found.failures == alone.failures
    sound = np.delete(np.arange(rates.size), [5, 60])
    np.testing.assert_allclose(found["x"][sound], 1.0 / (1.0 - rates[sound]), rtol=1e-8)
    assert np.isnan(found["x"][[5, 60]]).all()


def test_a_bound_that_turns_negative_is_reported_and_one_that_does_not_is_not(monkeypatch):
    monkeypatch.setattr(batch, "LANES_WORK", 0.0)
    frequency = np.linspace(0.1, 1.0, FEWEST_LANES)
    found = sweep(compose(FadingBrake()), {"mass.frequency": frequency}, duration=3.0, metrics={"v": metrics.final("mass.speed")})
    assert sorted(found.failures) == np.flatnonzero(frequency * 3.0 > math.pi / 2).tolist()
    assert all("The bound of `brake` must be >= 0" in text for text in found.failures.values())


def test_a_signal_that_turns_faster_than_the_steps_is_measured_alone(monkeypatch):
    # mean of cos(k cos t) over whole turns is J_0(k)
    monkeypatch.setattr(batch, "LANES_WORK", 0.0)
    waves = np.linspace(20.0, 40.0, FEWEST_LANES)
    asked = {"mean": metrics.mean("mass.wave"), "low": metrics.minimum("mass.wave"), "high": metrics.maximum("mass.wave")}
    given = {"duration": 2 * math.pi, "start": {"mass.position": 1.0}, "accuracy": 1e-7}
    variations = {"mass.waves": waves}
    loop, rest = together(compose(Oscillator()), **given)
    found = sweep(loop, variations, metrics=asked, **rest)
    np.testing.assert_allclose(found["mean"], j0(waves), atol=1e-5)
    np.testing.assert_allclose(found["low"], -1.0, atol=1e-6)
    np.testing.assert_allclose(found["high"], 1.0, atol=1e-6)
    run = shared_run(loop, uniform({"mass.waves": (20.0, 40.0)}, 8), method="explicit", **rest)
    starts = np.tile([1.0, 0.0], (8, 1))
    numbers = np.tile(run.system.values, (8, 1))
    assert Lanes(run, tuple(asked.values())).run(numbers, starts).doubtful.all()
    assert not Lanes(run, (metrics.mean("mass.position"),)).run(numbers, starts).doubtful.any()


def test_lanes_are_taken_for_many_runs_of_what_they_carry():
    def pays(plant, runs, steps=1_000_000, **arguments):
        loop, rest = together(plant, **{"method": "explicit", **arguments})
        run = shared_run(loop, uniform({"bit.weight": (5e4, 1e5)}, runs), 10.0, **rest)
        return pays_in_lanes(Task(run, np.zeros((runs, 1)), (metrics.mean("bit.speed"),)), steps)

    assert pays(RIG, FEWEST_LANES)
    assert not pays(RIG, FEWEST_LANES - 1)
    assert not pays(RIG, FEWEST_LANES, steps=1)
    assert not pays(RIG, FEWEST_LANES, method="stiff")
    assert pays(RIG, FEWEST_LANES, controller=Sampled(StiffPI(), 0.01))
    assert not pays(RIG, FEWEST_LANES, controller=Sampled(lambda t, y: 0.0, 0.01))


def test_an_input_may_vary_as_well_as_a_parameter():
    weights = {"bit.weight": (9e4, 1e5)}
    task = Task(
        shared_run(closed_loop(RIG, StiffPI()), uniform(weights, 2), 30.0),
        np.zeros((0, 0)),
        (metrics.severity("bit.speed", 10.0),),
        lanes=True,
    )
    found = finished(dataclasses.replace(task, numbers=varied_numbers(task.run, uniform(weights, 2))[0]))
    for weight, severity in zip(uniform(weights, 2).points[:, 0], found.values[:, 0], strict=True):
        run = simulate(RIG, 30.0, controller=StiffPI(), inputs={"bit.weight": weight}, method="explicit")
        assert severity == pytest.approx(measure.severity(run, after=10.0), rel=1e-5)
