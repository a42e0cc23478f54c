"""Sweeps: the same numbers as one run at a time, whatever varies and wherever it runs, and nothing lost."""

from __future__ import annotations

import dataclasses
import errno
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from threading import Barrier

import numpy as np
import pytest

from controllers import PI, StiffPI
from models import BitRock, BlockOnBelt, Exponential, LuGre, TorsionalChain, WhirlingCollar, wells
from tests.dropping import Dropping
from tests.mechanisms import Oscillator
from tests.plants import RIG
from tests.together import together
from toolbox import (
    Budget,
    Component,
    Equations,
    Sampled,
    Scene,
    SceneError,
    closed_loop,
    compose,
    measure,
    quantity,
    simulate,
    state,
    sweep,
)
from toolbox.errors import BudgetError
from toolbox.measuring import metrics
from toolbox.modelling.inputs import sine
from toolbox.simulation import EventExact
from toolbox.sweeps import Sweep, latin_hypercube, sobol, store, uniform
from toolbox.sweeps import chunks as columns
from toolbox.sweeps import executors as workers

SCENES = Path(__file__).parents[2] / "studies" / "scenes"


@dataclass(frozen=True)
class Growth(Component):
    """x' = a x^2, so that x = 1/(1/x_0 - a t)."""

    rate: float = quantity(1.0, "1/s", "rate a", at_least=0)

    def equations(self, signal):
        x = state("growth.size", "1")
        return Equations(flow={x: self.rate * x**2})


def test_measures_of_a_harmonic_motion_are_those_on_paper():
    w, after, until = np.array([1.0, 2.0, 7.3]), 3.21, 9.87
    found = sweep(closed_loop(compose(Oscillator()), start={"mass.position": 1.0}), {"mass.frequency": w}, duration=10.0, accuracy=1e-10, metrics={
            "mean": metrics.mean("mass.position", after, until), "high": metrics.maximum("mass.square"), "low": metrics.minimum("mass.position"),
            "square": metrics.mean("mass.square", after, until), "end": metrics.final("mass.speed"),
        })  # fmt: skip
    span = until - after
    np.testing.assert_allclose(found["mean"], (np.sin(w * until) - np.sin(w * after)) / (w * span), atol=1e-8)
    np.testing.assert_allclose(found["square"], 0.5 + (np.sin(2 * w * until) - np.sin(2 * w * after)) / (4 * w * span), atol=1e-8)
    np.testing.assert_allclose(found["high"], 1.0, atol=1e-8)
    np.testing.assert_allclose(found["low"], -1.0, atol=1e-8)
    np.testing.assert_allclose(found["end"], -w * np.sin(10 * w), atol=1e-7)


def rubbing():
    flywheel = TorsionalChain(inertia=(1e9, 1e9), stiffness=(0.0,), damping=(0.0,), collar_index=-1)
    return compose(flywheel, WhirlingCollar(weight=1e5, wall_stiffness=1e7))


CASES = {
    "smooth string": (RIG, "bit.weight", (40e3, 60e3), 40.0, {"controller": PI(reference=14.0)}, "bit.speed", "bit", "stick"),
    "stick-slip": (RIG, "bit.weight", (90e3, 97e3), 60.0, {"controller": StiffPI()}, "bit.speed", "bit", "stick"),
    "sampled": (RIG, "stiffpi.integral", (1e3, 2e3), 60.0, {"controller": Sampled(StiffPI(), 0.01, 0.02)}, "top.torque", "bit", "stick"),
    "stiff": (RIG, "bit.weight", (90e3, 97e3), 60.0, {"controller": StiffPI(), "method": "stiff"}, "bit.speed", "bit", "stick"),
    "belt": (compose(BlockOnBelt()), "block.mass", (0.7, 1.3), 60.0, {}, "block.position", "belt", "stick"),
    "forced": (
        compose(BlockOnBelt()),
        "block.mass",
        (0.7, 1.3),
        60.0,
        {"inputs": {"block.force": sine(0.0, 0.3, 0.2)}},
        "block.speed",
        "belt",
        "stick",
    ),
    "wall": (
        rubbing(),
        "collar.eccentricity",
        (0.010, 0.014),
        0.6,
        {"start": {"chain.speed": (24.0, 24.0)}},
        "collar.radius",
        "wall",
        "closed",
    ),
}


@pytest.mark.parametrize("accuracy", [1e-4, 1e-6, 1e-9])
@pytest.mark.parametrize("case", CASES)
def test_measures_in_machine_code_agree_with_those_of_the_trajectory(case, accuracy):
    plant, name, values, duration, arguments, signal, element, mode = CASES[case]
    after, until = 0.3141 * duration, 0.8765 * duration
    loop, rest = together(plant, **arguments)
    found = sweep(
        loop, {name: values}, duration=duration, accuracy=accuracy, **rest,
        metrics={
            "minimum": metrics.minimum(signal, after, until), "maximum": metrics.maximum(signal, after, until), "mean": metrics.mean(signal, after, until),
            "severity": metrics.severity(signal, after, until=until), "final": metrics.final(signal),
            "time": metrics.time_in(element, after, until, mode=mode), "stays": metrics.stays(element, after, until, mode=mode),
            "last": metrics.last_stay(element, mode=mode), "events": metrics.events(element),
        },
    )  # fmt: skip
    assert not found.failures
    for i, value in enumerate(values):
        varied = {"inputs": {**arguments.get("inputs", {}), name: value}} if name in plant.inputs else {"parameters": {name: value}}
        if name.startswith("pi."):
            law = StiffPI(integral=value)
            varied = {"controller": Sampled(law, 0.01, 0.02)}
        run = simulate(plant, duration, accuracy=accuracy, **{**arguments, **varied})
        expected = measure.extent(run, signal, after, until)
        size = max(abs(expected.minimum), abs(expected.maximum))
        for word in ("minimum", "maximum", "mean"):
            assert found[word][i] == pytest.approx(getattr(expected, word), abs=accuracy * size)
        assert found["severity"][i] == pytest.approx(measure.severity(run, signal, after, until=until), rel=10 * accuracy, nan_ok=True)
        assert found["final"][i] == pytest.approx(run[signal][-1], abs=accuracy * size)
        assert found["time"][i] == pytest.approx(run.time_in(element, mode, after, until), abs=accuracy * duration)
        stays = [(a, b) for a, b, word in run.intervals(element) if word == mode]
        assert found["events"][i] == sum(event.element == element for event in run.events)
        if mode == "stick":
            assert found["stays"][i] == len(measure.stick_intervals(run, element, after, until))
        assert found["last"][i] == pytest.approx(stays[-1][1] if stays else math.nan, abs=accuracy * duration, nan_ok=True)


def test_node_values_alone_would_miss_the_peak():
    run = simulate(RIG, 60.0, controller=StiffPI())
    found = sweep(
        closed_loop(RIG, StiffPI()), {"bit.weight": [97_347.0]}, duration=60.0, metrics={"peak": metrics.maximum("bit.speed", 30.0)}
    )
    peak = measure.extent(run, "bit.speed", 30.0).maximum
    assert found["peak"][0] == pytest.approx(peak, rel=1e-6)
    assert peak - run["bit.speed"][run.time >= 30.0].max() > 1e-4 * peak


def test_functions_of_the_trajectory_and_laws_in_python_see_the_same_runs():
    class Brake:
        measured_signals, actuated_signals = "top.speed", "top.torque"

        def __call__(self, t, y):
            return 1e4 * (8.0 - y[0])

    weights = [60e3, 97e3]
    asked = {
        "called": lambda run: measure.severity(run, after=10.0),
        "read": metrics.severity("bit.speed", 10.0),
        "steps": lambda run: run.steps[0],
    }
    loop = closed_loop(RIG, Sampled(Brake(), 0.05))
    found = sweep(loop, {"bit.weight": weights}, duration=20.0, executor=ThreadPoolExecutor(2), metrics=asked)
    for i, weight in enumerate(weights):
        run = simulate(RIG, 20.0, controller=Sampled(Brake(), 0.05), inputs={"bit.weight": weight})
        assert found["called"][i] == found["read"][i] == measure.severity(run, after=10.0)
        assert found["steps"][i] == run.steps[0]


def test_what_is_no_executor_is_refused():
    with pytest.raises(SceneError, match="Argument `executor` must be a concurrent.futures.Executor, .* but it is 2"):
        sweep(growing(), {"growth.rate": [0.1]}, executor=2, **GROWING)


@pytest.mark.parametrize("told", [None, "2"])
def test_processes_have_one_thread_of_linear_algebra_unless_told_otherwise(told):
    given = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"} | (
        {"OPENBLAS_NUM_THREADS": told} if told else {}
    )
    asked = "import os; from toolbox.sweeps.executors import Workers\nwith Workers(1) as w: print(w.submit(os.getenv, 'OPENBLAS_NUM_THREADS').result())"
    said = subprocess.run([sys.executable, "-c", asked], env=given, capture_output=True, text=True, check=True).stdout
    assert said.strip() == (told or "1")


@pytest.mark.slow
def test_laws_in_python_run_in_processes():
    here = sweep(closed_loop(RIG, Sampled(Gentle(), 0.05)), {"bit.weight": [60e3, 97e3]}, duration=5.0, metrics=("mean", "stuck"))
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        there = sweep(
            closed_loop(RIG, Sampled(Gentle(), 0.05)), {"bit.weight": [60e3, 97e3]}, duration=5.0, metrics=("mean", "stuck"), executor=pool
        )

        class Local(Gentle):
            pass

        with pytest.raises(SceneError, match="must be importable"):
            sweep(closed_loop(RIG, Sampled(Local(), 0.05)), {"bit.weight": [60e3, 97e3]}, duration=5.0, executor=pool)
    assert not there.failures
    np.testing.assert_array_equal(there["mean"], here["mean"])


class Gentle:
    """u = 8000 (8 - y)."""

    measured_signals, actuated_signals = "top.speed", "top.torque"

    def __call__(self, t, y):
        return 8e3 * (8.0 - y[0])


def test_a_run_that_fails_is_recorded_and_the_others_are_not_touched():
    rates = [0.25, 0.5, 3.0, 0.0]
    found = sweep(
        closed_loop(compose(Growth()), start={"growth.size": 1.0}),
        {"growth.rate": rates},
        duration=1.0,
        accuracy=1e-10,
        metrics={"x": metrics.final("growth.size")},
    )
    assert list(found.failures) == [2]
    assert "growth.size" in found.failures[2]
    assert math.isnan(found["x"][2])
    assert "1 of 4 runs failed" in str(found)
    np.testing.assert_allclose(found["x"][[0, 1, 3]], [1 / 0.75, 2.0, 1.0], rtol=1e-8)


def test_numbers_that_contradict_each_other_fail_alone():
    diameters = [0.15, 0.18, 0.22]
    vary = {"collar.outer_diameter": diameters, "collar.hole_diameter": [0.20, 0.23]}
    loop = closed_loop(rubbing(), start={"chain.speed": (24.0, 24.0)})
    found = sweep(loop, vary, duration=0.05, metrics={"r": metrics.maximum("collar.radius")})
    assert list(found.failures) == [4]
    assert "must increase" in found.failures[4]
    assert np.isfinite(found["r"].ravel()[[0, 1, 2, 3, 5]]).all()


@pytest.mark.parametrize("drop", [[0.2, 0.1, -0.4, 0.0], [-0.4, -0.4]], ids=["some", "all"])
def test_rows_whose_friction_would_drive_the_machine_fail_alone(drop):
    plant = compose(BlockOnBelt(friction=LuGre(steady=Dropping()), name="block"))
    found = sweep(
        plant, {"belt.friction.steady.beyond": drop, "block.stiffness": [1.0, 2.0]}, 0.5, metrics={"x": metrics.final("block.position")}
    )
    below = [2 * i + k for i, value in enumerate(drop) if value < 0 for k in (0, 1)]
    assert list(found.failures) == below
    assert all(
        "Dropping must not fall below zero, where it would drive the machine, but beyond a slip speed of 1 " in found.failures[i]
        for i in below
    )
    assert np.isnan(found["x"].ravel()[below]).all() and np.isfinite(np.delete(found["x"].ravel(), below)).all()


def test_the_middle_row_may_contradict_itself():
    plant = compose(BlockOnBelt(friction=Exponential()))
    found = sweep(plant, {"belt.friction.static": [0.9, 0.3, 1.0]}, 0.5, metrics={"x": metrics.final("block.position")})
    assert list(found.failures) == [1] and "static" in found.failures[1]


def test_designs_fill_their_bounds():
    bounds = {"bit.weight": (50e3, 110e3), "pi.reference": (3.0, 14.0)}
    for design in (uniform(bounds, 64), latin_hypercube(bounds, 64), sobol(bounds, 64)):
        unit = (design.points - [50e3, 3.0]) / [60e3, 11.0]
        assert design.points.shape == (64, 2)
        assert (unit >= 0).all() and (unit < 1).all()
    cells = np.floor(64 * (latin_hypercube(bounds, 64, seed=3).points[:, 0] - 50e3) / 60e3)
    assert sorted(cells) == list(range(64))  # one in each
    quarters = np.floor(8 * (sobol(bounds, 64).points[:, 1] - 3.0) / 11.0)
    assert np.bincount(quarters.astype(int)).tolist() == [8] * 8
    np.testing.assert_array_equal(uniform(bounds, 5, seed=7).points, uniform(bounds, 5, seed=7).points)


@pytest.mark.parametrize("design", [uniform, latin_hypercube, sobol])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (({}, 4), "Argument `ranges` must map at least one name"),
        (("bit.weight", 4), "Argument `ranges` must map at least one name"),
        (({"a": (2.0, 1.0)}, 4), "Argument `a` must be two finite numbers .low, high. with low < high"),
        (({"a": (1.0, math.nan)}, 4), "Argument `a` must be two finite numbers .low, high. with low < high"),
        (({"a": (1.0, 2.0)}, 0), "Argument `runs` must be an integer >= 1, but it is 0"),
        (({"a": (1.0, 2.0)}, 4.0), "Argument `runs` must be an integer >= 1, but it is 4.0"),
        (({"a": (1.0, 2.0)}, 4, -1), "Argument `seed` must be an integer >= 0, but it is -1"),
    ],
)
def test_designs_that_make_no_sense_are_refused(design, arguments, message):
    with pytest.raises(SceneError, match=message):
        design(*arguments)


def test_rows_and_grids_give_the_same_runs():
    asked = {"severity": metrics.severity("bit.speed", 10.0)}
    over = sweep(closed_loop(RIG, StiffPI()), {"bit.weight": [60e3, 97e3], "stiffpi.reference": [5.0, 9.0]}, duration=20.0, metrics=asked)
    rows = [{"bit.weight": w, "stiffpi.reference": r} for w in (60e3, 97e3) for r in (5.0, 9.0)]
    alone = sweep(closed_loop(RIG, StiffPI()), rows, duration=20.0, metrics=asked)
    pandas = pytest.importorskip("pandas")
    table = sweep(closed_loop(RIG, StiffPI()), pandas.DataFrame(rows), duration=20.0, metrics=asked)
    np.testing.assert_array_equal(over["severity"].ravel(), alone["severity"])
    np.testing.assert_array_equal(table["severity"], alone["severity"])
    assert over["severity"].shape == (2, 2)
    assert over["bit.weight"][1, 0] == 97e3


def test_what_is_saved_comes_back(tmp_path):
    found = sweep(closed_loop(RIG, StiffPI()), {"bit.weight": [60e3, 97e3], "stiffpi.reference": [5.0, 9.0, 12.0]}, duration=10.0)
    for name in ("found.npz", "found.zarr"):
        if name.endswith("zarr"):
            pytest.importorskip("zarr")
        back = Sweep.load(found.save(tmp_path / name))
        assert str(back) == str(dataclasses.replace(found, seconds=0.0))  # what it took is of the machine, not of the file
        np.testing.assert_array_equal(back["severity"], found["severity"])
        np.testing.assert_array_equal(back.points, found.points)
    xarray = pytest.importorskip("xarray")
    data = found.to_xarray()
    assert isinstance(data, xarray.Dataset)
    assert data["severity"].dims == ("bit.weight", "stiffpi.reference")
    assert data["bit.weight"].attrs["units"] == "N"
    assert float(data["severity"].sel({"bit.weight": 97e3, "stiffpi.reference": 12.0})) == found["severity"][1, 2]
    pytest.importorskip("pandas")
    frame = found.to_pandas()
    assert frame.attrs["units"] == {"bit.weight": "N", "stiffpi.reference": "rad/s", **found.metric_units}
    for values in frame.to_dict("records"):
        place = {name: values[name] for name in ("bit.weight", "stiffpi.reference")}
        assert float(data["severity"].sel(place)) == values["severity"] and values["error"] == ""
    assert len(frame) == found.runs
    with pytest.raises(TypeError, match=r"A Sweep is not one array: take a measure, such as `found\['severity'\]`"):
        np.asarray(found)
    (tmp_path / "text.npz").write_text("nothing")
    with pytest.raises(SceneError, match="File `.*text.npz` must be a file written by `Sweep.save`"):
        Sweep.load(tmp_path / "text.npz")


@pytest.mark.parametrize("grid", [True, False])
def test_a_file_of_an_earlier_version_comes_back(grid, tmp_path):
    masses = {"block.mass": [1.0, 2.0]} if grid else [{"block.mass": 1.0}, {"block.mass": 2.0}]
    found = dataclasses.replace(sweep(compose(BlockOnBelt()), masses, duration=5.0), seconds=0.0, failures={1: "it failed"})
    told = {name: getattr(found, name) for name in ("title", "names", "units", "duration", "accuracy")}
    told |= {"grid": grid, "measure_units": found.metric_units, "errors": {"1": "it failed"}}
    arrays = {"points": found.points} | {f"axis.{name}": axis for name, axis in zip(found.names, found.axes, strict=False)}
    arrays |= {f"measure.{name}": values for name, values in found.metrics.items()}
    np.savez_compressed(tmp_path / "sweep.npz", sweep=np.array(json.dumps(told)), **arrays)
    back = Sweep.load(tmp_path / "sweep.npz")
    assert str(back) == str(dataclasses.replace(found, display_units={})) and back.shape == found.shape and back.failures == found.failures
    for name in found.metrics:
        np.testing.assert_array_equal(back[name], found[name])
    told["errors"] = {"2": "it failed"}
    np.savez_compressed(tmp_path / "sweep.npz", sweep=np.array(json.dumps(told)), **arrays)
    with pytest.raises(SceneError, match="sweep.npz` must be .*: it has an error of a run that it does not have"):
        Sweep.load(tmp_path / "sweep.npz")


KILLED = """
import numpy as np
from controllers import StiffPI
from models import BitRock, wells
from toolbox import Sampled, closed_loop, compose, sweep
if __name__ == "__main__":
    plant = compose(wells.JANSEN_2, BitRock())
    loop = closed_loop(plant, Sampled(StiffPI(), 0.01))
    sweep(loop, {"bit.weight": np.linspace(50e3, 110e3, 500)}, duration=60.0, checkpoint="OUT")
"""


@pytest.mark.slow
def test_a_sweep_that_is_killed_goes_on_where_it_was(tmp_path, monkeypatch):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    folder = tmp_path / "found"
    root = Path(__file__).parents[2]
    process = subprocess.Popen([sys.executable, "-c", KILLED.replace("OUT", str(folder))], cwd=root)
    deadline = time.monotonic() + 90.0
    while not (folder / "status" / "c" / "0").is_file() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    process.kill()
    process.wait()
    with xarray.open_zarr(folder) as half:
        done = half["status"].values == 1
        assert 0 < done.sum() < 500
        before = half["severity"].values
        assert np.isfinite(half["stuck_ratio"].values[done]).all() and np.isnan(before[~done]).all()
        assert half["severity"].dims == ("bit.weight",)
    with pytest.raises(SceneError, match=f"{500 - done.sum()} of 500 runs wait: the same call of `sweep` goes on"):
        Sweep.load(folder)
    weights = {"bit.weight": np.linspace(50e3, 110e3, 500)}
    plant, law = compose(wells.JANSEN_2, BitRock()), Sampled(StiffPI(), 0.01)
    made = counted_runs(monkeypatch)
    found = sweep(closed_loop(plant, law), weights, duration=60.0, checkpoint=folder)
    assert sum(made) == 500 - done.sum()  # what was there is kept
    np.testing.assert_array_equal(found["severity"][done], before[done])
    whole = sweep(closed_loop(plant, law), weights, duration=60.0)
    for name in ("severity", "stuck_ratio"):
        np.testing.assert_array_equal(found[name], whole[name])
        np.testing.assert_array_equal(Sweep.load(folder)[name], whole[name])
    for word, other in (
        ("duration", {"duration": 59.0}),
        ("accuracy", {"accuracy": 1e-5}),
        ("metrics", {"metrics": "mean"}),
        ("controller", {"controller": Sampled(StiffPI(), 0.02)}),
        ("budget", {"method": EventExact(budget=Budget(events=1e6))}),
    ):
        with pytest.raises(SceneError, match=f"other .*`{word}`"):
            loop, rest = together(plant, **{"duration": 60.0, "controller": law, "checkpoint": folder, **other})
            sweep(loop, weights, **rest)
    with pytest.raises(SceneError, match="other `vary`"):
        sweep(closed_loop(plant, law), {"bit.weight": np.linspace(50e3, 111e3, 500)}, duration=60.0, checkpoint=folder)


def counted_runs(monkeypatch):
    """How many runs every chunk has that is done from now on."""
    made = []
    alone = workers.finished
    monkeypatch.setattr(workers, "finished", lambda task: (made.append(len(task.numbers)), alone(task))[1])
    return made


GROWING = {"duration": 1.0, "accuracy": 1e-7, "metrics": {"x": metrics.final("growth.size")}}


def growing(plant=None):
    """Growth from 1."""
    return closed_loop(plant or compose(Growth()), start={"growth.size": 1.0})


def test_what_is_on_disk_is_what_was_found_failures_and_all(tmp_path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    rates = {"growth.rate": [0.25, 3.0, 0.5]}
    found = sweep(growing(), rates, checkpoint=tmp_path / "found.zarr", **GROWING)
    with xarray.open_zarr(tmp_path / "found.zarr") as data:
        np.testing.assert_array_equal(data["status"], [1, 2, 1])
        assert [bool(text) for text in data["error"].values] == [False, True, False]
        assert str(data["error"].values[1]) == found.failures[1]
        xarray.testing.assert_equal(data[["x"]], found.to_xarray()[["x"]])
        assert data["error"].values.tolist() == found.to_xarray()["error"].values.tolist()
    assert Sweep.load(tmp_path / "found.zarr").failures == found.failures
    found.save(tmp_path / "saved.zarr")
    assert Sweep.load(tmp_path / "saved.zarr").failures == found.failures
    np.testing.assert_array_equal(Sweep.load(tmp_path / "saved.zarr")["x"], found["x"])


def test_a_full_disk_loses_nothing_that_was_there(tmp_path, monkeypatch):
    pytest.importorskip("zarr")
    monkeypatch.setattr(store, "ROWS", 10)
    monkeypatch.setattr(workers, "PAUSE", 0.0)
    rates, plant = {"growth.rate": np.linspace(0.0, 0.9, 50)}, compose(Growth())
    real, taken = os.fsync, []

    def fsync(handle):
        if len(taken) > 24:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken.append(handle)
        real(handle)

    with monkeypatch.context() as full:
        full.setattr(os, "fsync", fsync)
        with pytest.raises(OSError, match="No space left on device; what was written before is kept, and the same call goes on from there"):
            sweep(growing(plant), rates, checkpoint=tmp_path / "found", **GROWING)
    made = counted_runs(monkeypatch)
    found = sweep(growing(plant), rates, checkpoint=tmp_path / "found", **GROWING)
    assert 0 < sum(made) < 50
    np.testing.assert_allclose(found["x"], 1.0 / (1.0 - rates["growth.rate"]), rtol=1e-6)
    assert not list((tmp_path / "found").rglob(".*"))


def test_a_damaged_store_is_refused_and_says_how_to_mend_it(tmp_path, monkeypatch):
    pytest.importorskip("zarr")
    monkeypatch.setattr(store, "ROWS", 10)
    rates, plant, folder = {"growth.rate": np.linspace(0.0, 0.9, 50)}, compose(Growth()), tmp_path / "found"
    whole = sweep(growing(plant), rates, checkpoint=folder, **GROWING)

    def altered(content):
        return content[:-5] + bytes([content[-5] ^ 1]) + content[-4:]

    def cut(content):
        return content[:-3]

    for name, harm in (("x", altered), ("x", cut), ("x", None), ("status", altered)):
        file = folder / name / "c" / "2"
        content = file.read_bytes()
        file.unlink() if harm is None else file.write_bytes(harm(content))
        for look in (lambda: sweep(growing(plant), rates, checkpoint=folder, **GROWING), lambda: Sweep.load(folder)):
            with pytest.raises(SceneError, match="missing: delete" if harm is None else "damaged: delete") as refused:
                look()
            assert "status/c/2" in str(refused.value) and "the runs 20 to 29" in str(refused.value)
        (folder / "status" / "c" / "2").unlink()  # as it says
        with monkeypatch.context() as watched:
            made = counted_runs(watched)
            again = sweep(growing(plant), rates, checkpoint=folder, **GROWING)
        assert sum(made) == 10
        np.testing.assert_array_equal(again["x"], whole["x"])
    (folder / "zarr.json").write_text("nothing")
    with pytest.raises(SceneError, match="There is no sweep in .*, or it is damaged"):
        sweep(growing(plant), rates, checkpoint=folder, **GROWING)


def test_an_interrupt_keeps_what_is_done_and_says_how_to_go_on(tmp_path, monkeypatch):
    pytest.importorskip("zarr")
    rates, plant = {"growth.rate": np.linspace(0.0, 0.9, 40)}, compose(Growth())
    alone, made = workers.finished, []

    def interrupted(task):
        made.append(task.first)
        if len(made) == 5:  # two look at one run first
            raise KeyboardInterrupt
        return alone(task)

    with monkeypatch.context() as key, pytest.raises(KeyboardInterrupt) as stopped:
        key.setattr(workers, "finished", interrupted)
        sweep(growing(plant), rates, executor=ThreadPoolExecutor(1), checkpoint=tmp_path / "found", **GROWING)
    done = int(re.match(r"(\d+) of 40 runs are in `.*found`; the same call goes on from there", stopped.value.__notes__[0])[1])
    assert 0 < done < 40
    made = counted_runs(monkeypatch)
    found = sweep(growing(plant), rates, checkpoint=tmp_path / "found", **GROWING)
    assert sum(made) == 40 - done
    np.testing.assert_allclose(found["x"], 1.0 / (1.0 - rates["growth.rate"]), rtol=1e-6)


def test_without_zarr_a_sweep_on_disk_names_what_is_missing(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(ImportError, match=r"pip install -e '\.\[batch\]'"):
        sweep(growing(), {"growth.rate": [0.1]}, checkpoint=tmp_path / "found", **GROWING)
    assert not (tmp_path / "found").exists()


@pytest.mark.parametrize("shape", [(1,), (7,), (100,), (4, 25), (3, 1, 11), (2, 3, 4, 5), (1, 1, 9), (50, 1)])
@pytest.mark.parametrize("rows", [1, 2, 6, 10, 30, 1000])
def test_chunks_are_blocks_of_neighbours(shape, rows):
    block = columns.chunk_shape(shape, rows)
    assert math.prod(block) <= rows
    ranges = list(columns.chunk_ranges(shape, block))
    assert [first for first, _ in ranges] == [0, *(last for _, last in ranges[:-1])] and ranges[-1][1] == math.prod(shape)
    index = np.arange(math.prod(shape)).reshape(shape)
    for first, last in ranges:
        corner = np.unravel_index(first, shape)
        np.testing.assert_array_equal(
            index[tuple(slice(i, i + n) for i, n in zip(corner, block, strict=True))].ravel(), np.arange(first, last)
        )


def test_a_swept_sine_is_asked_for_where_it_is():
    words = r"`sweep` varies the numbers of a machine.*the swept sine of an input is `toolbox\.inputs\.sweep`"
    for wrong in ((0.0, 1e3, 0.1, 2.0, 10.0), (RIG, {"bit.weight": [9e4]}, 1.0, StiffPI())):
        with pytest.raises(SceneError, match=words):
            sweep(*wrong)
    with pytest.raises(SceneError, match=r"`top\.torque` must be .* a shape .*: the swept sine is `toolbox\.inputs\.sweep`"):
        simulate(RIG, 1.0, inputs={"top.torque": sweep})
    placed, named = (
        sweep(closed_loop(RIG, StiffPI()), {"bit.weight": [60e3]}, *a, **k) for a, k in (((1.0,), {}), ((), {"duration": 1.0}))
    )
    np.testing.assert_array_equal(placed["severity"], named["severity"])  # the duration may stand third, as it stands second in `simulate`


def test_the_budget_of_a_run_counts_all_its_events(monkeypatch):
    # a block on a belt sticks and slips once a period: two events, of which the loop hands over a buffer at a time
    plant, budget = compose(BlockOnBelt()), Budget(events=1000)
    found = sweep(
        plant, {"block.mass": [0.9, 1.1]}, duration=1e5, method=EventExact(budget=budget), metrics={"events": metrics.events("belt")}
    )
    for i, mass in enumerate((0.9, 1.1)):
        with pytest.raises(BudgetError) as alone:
            simulate(plant, 1e5, parameters={"block.mass": mass}, method=EventExact(budget=budget))
        assert re.match(r"The run used its 1000 events and reached", found.failures[i]) and len(alone.value.run.events) == 1000
        assert found.failures[i] == str(alone.value)
    exact = len(simulate(plant, 200.0).events)
    for most, errors in ((exact, 0), (exact - 1, 1)):
        assert (
            len(
                sweep(
                    plant, {"block.mass": [1.0]}, duration=200.0, method=EventExact(budget=Budget(events=most)), metrics=("events",)
                ).failures
            )
            == errors
        )


def test_a_folder_with_other_files_is_not_written_to(tmp_path):
    (tmp_path / "letter.txt").write_text("mine")
    with pytest.raises(SceneError, match="Argument `checkpoint` must be an empty or new folder"):
        sweep(closed_loop(RIG, StiffPI()), {"bit.weight": [60e3]}, duration=1.0, checkpoint=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["letter.txt"]


@dataclass(frozen=True)
class Killing(Gentle):
    """The same torque; the process in which it is called first, if it is none of these, is killed."""

    mark: str
    spared: tuple[int, ...]

    def __call__(self, t, y):
        if os.getpid() not in self.spared:
            try:
                open(self.mark, "x").close()
            except FileExistsError:
                pass
            else:
                os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))
        return super().__call__(t, y)


@pytest.mark.slow
def test_a_dask_cluster_of_which_a_worker_is_killed_gives_the_same_numbers(tmp_path):
    import distributed  # of the extra `dev`

    def found(spared, executor=None):
        loop = closed_loop(RIG, Sampled(Killing(str(tmp_path / "killed"), spared), 0.05))
        return sweep(loop, {"bit.weight": np.linspace(50e3, 110e3, 12)}, duration=30.0, metrics=("severity", "mean"), executor=executor)

    here = found((os.getpid(),), ThreadPoolExecutor(1))
    assert not (tmp_path / "killed").exists()
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        before = set(client.run(os.getpid).values())
        there = found((os.getpid(),), client.get_executor())
        client.wait_for_workers(2)
        after = set(client.run(os.getpid).values())
    assert (tmp_path / "killed").exists() and len(before - after) == 1
    for name in ("severity", "mean"):
        np.testing.assert_array_equal(there[name], here[name])
    assert not there.failures


def test_a_scene_brings_its_controller_its_window_and_its_inputs():
    scene = Scene.load(SCENES / "jansen_2.toml")
    found = sweep(scene["stiff PI"], {"bit.weight": [60e3, 97_347.0]}, metrics=("severity", "stuck"))
    run = scene.run("stiff PI")
    assert found["severity"][1] == pytest.approx(measure.severity(run, scene.signal, scene.after), rel=1e-6)
    assert found["stuck"][1] == pytest.approx(run.time_in("bit", "stick", scene.after), abs=1e-4)
    assert found.duration == 120.0


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ({"bit.wait": [1.0]}, "There is no number `bit.wait` in this loop: did you mean `bit.weight`"),
        ({"bit.weight": [1e3, -1.0]}, r"Argument `bit.weight` must be >= 0 N, but it is -1.0"),
        ({"bit.weight": [1e3, math.nan]}, "Argument `bit.weight` must be a list of finite numbers"),
        ({"bit.weight": 3.0}, "Argument `bit.weight` must be a list of finite numbers"),
        ({"chain.inertia": [1.0]}, "`chain.inertia` must be one number, but it has 2 entries: name one"),
        ({"stiffpi.period": [0.01, 0.02]}, "`stiffpi.period` is named `stiffpi.sample_time` now"),
        ({}, "must name at least one number"),
        ([{"bit.weight": 1.0}, {"bit.radius": 1.0}], "must be rows that all give numbers to the same names"),
        (3, "Argument `ranges` must map names to values"),
    ],
)
def test_variations_that_make_no_sense_are_refused_by_name(vary, message):
    with pytest.raises(SceneError, match=message):
        sweep(closed_loop(RIG, Sampled(StiffPI(), 0.01)), vary, duration=1.0)


@pytest.mark.parametrize(
    ("metrics", "message"),
    [
        ("severety", "There is no measure `severety`: did you mean `severity`"),
        ({"a": metrics.maximum("bit.sped")}, "There is no signal `bit.sped`"),
        ({"a": metrics.maximum("chain.speed")}, "must be a scalar, but `chain.speed` has several entries"),
        ({"a": metrics.mean("bit.speed", 2.0)}, "Argument `after` must be >= 0 and < "),
        ({"a": metrics.stays("bot")}, "There is no element `bot`: did you mean `bit`"),
        ({"a": metrics.stays("bit", mode="stuck")}, "There is no mode `stuck` of `bit`: did you mean `stick`"),
        ({"a": 3}, "`metrics` must hold names of measures, measures or functions of a run"),
        ({}, "must hold at least one measure"),
        ({"error": "mean"}, "must use names that are free, without a slash, but one is `error`"),
        ({"bit.weight": "mean"}, "must use names that are free, without a slash, but one is `bit.weight`"),
    ],
)
def test_measures_that_make_no_sense_are_refused_by_name(metrics, message):
    with pytest.raises(SceneError, match=message):
        sweep(closed_loop(RIG, StiffPI()), {"bit.weight": [1e3]}, duration=1.0, metrics=metrics)


def test_the_command_sweeps_a_scene_and_goes_on_where_it_was(tmp_path, capsys, caplog, monkeypatch):
    from toolbox.commands.command_line import main

    pytest.importorskip("zarr")
    command = ["sweep", str(SCENES / "jansen_2.toml"), "--range", "bit.weight=60kN:97.347kN:2", "--range", "top.reference=80 rpm:95 rpm:2"]
    command += ["--controller", "stiff PI", "--metric", "severity", "--metric", "sticks", "--out", str(tmp_path / "out")]
    assert main(command) == 0
    printed = capsys.readouterr().out
    assert re.search(r"bit.weight +60 +97\.347 +kN", printed)
    folder = tmp_path / "out" / "01_stiff_pi"
    found = Sweep.load(folder / "sweep.zarr")
    run = Scene.load(SCENES / "jansen_2.toml").run("stiff PI")
    assert found["severity"][1, 1] == pytest.approx(measure.severity(run, "bit.speed", 60.0), rel=1e-6)
    assert (folder / "sweep.csv").read_text().startswith("bit.weight [N],top.reference [rad/s],severity [1],sticks [1],error\n")
    made = counted_runs(monkeypatch)
    assert main(command) == 0
    assert not made  # all of it is there already
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main([*command[:-1], str(tmp_path / "plain")]) == 0
    assert "pip install -e '.[batch]'" in caplog.text
    np.testing.assert_array_equal(Sweep.load(tmp_path / "plain" / "01_stiff_pi" / "sweep.npz")["severity"], found["severity"])


def test_the_command_takes_designs_and_tables(tmp_path, capsys):
    from toolbox.commands.command_line import main

    pytest.importorskip("zarr")
    command = ["sweep", str(SCENES / "jansen_2.toml"), "--controller", "stiff PI", "--metric", "mean"]
    (tmp_path / "rows.csv").write_text("bit.weight [kN],top.reference [rpm]\n50,80\n90,95\n")
    bounds = {"bit.weight": (50e3, 90e3)}
    cases = {
        "random": uniform(bounds, 3, 7), "latin-hypercube": latin_hypercube(bounds, 3, 7), "sobol": sobol(bounds, 4, 7), "rows": None,
    }  # fmt: skip
    for name, design in cases.items():
        given = ["--rows", str(tmp_path / "rows.csv")]
        if design is not None:
            given = ["--range", "bit.weight=50kN:90kN", "--sampling", name, "--runs", str(len(design.points)), "--seed", "7"]
        assert main([*command, *given, "--out", str(tmp_path / name)]) == 0
        found = Sweep.load(tmp_path / name / "01_stiff_pi" / "sweep.zarr")
        assert not found.failures
        expected = design.points if design is not None else [[50e3, 80 * math.pi / 30], [90e3, 95 * math.pi / 30]]
        np.testing.assert_allclose(found.points, expected, rtol=1e-12)
    for given, message in (
        (["--range", "bit.weight=2:3"], "must be NAME=LOW:HIGH:N"),
        (["--range", "bit.weight=2:3:4", "--sampling", "sobol", "--runs", "4"], "must be NAME=LOW:HIGH, but"),
        (["--range", "bit.weight=3:2:4"], "`bit.weight` must be a range LOW:HIGH with LOW < HIGH"),
        (["--range", "bit.weight=1 m:2 m:3"], "Argument `bit.weight` must be in N"),
        (["--range", "bit.weight=1:2:3", "--range", "bit.weight=1:2:3"], "must name every number once"),
        (["--range", "bit.weight=1:2:3", "--runs", "4"], "`--runs` must come with a `--sampling`"),
        (["--range", "bit.weight=1:2", "--sampling", "sobol"], "`--sampling` must come with `--runs`"),
        (["--range", "bit.weight=1:2", "--sampling", "random", "--runs", "4", "--seed", "-1"], "`--seed` must be an integer >= 0"),
        ([], "`--range` must be given, or `--rows`"),
    ):
        assert main([*command, *given, "--out", str(tmp_path / "none")]) == 2
        assert message in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


def test_runs_may_begin_each_in_its_own_state():
    w = np.array([1.0, 2.0, 3.0])
    found = sweep(
        compose(Oscillator()), {"mass.frequency": w}, duration=2.0, start=lambda row: {"mass.speed": row["mass.frequency"]}, accuracy=1e-10,
        metrics={"end": metrics.final("mass.position"), "called": lambda run: run["mass.position"][-1]},
    )  # fmt: skip
    np.testing.assert_allclose(found["end"], np.sin(2 * w), atol=1e-8)
    np.testing.assert_array_equal(found["called"], found["end"])


def test_threads_that_need_the_same_code_at_once_share_it():
    from toolbox.compilation.emitter import Body, compiled, function_text

    for k in range(3):
        body = Body()
        body.store(f"0x{k:016X}", "%y", 0)
        text = function_text("fresh", body)
        gate = Barrier(8)

        def load(text=text, gate=gate):
            gate.wait()
            return compiled(text, ["fresh"], 1)["fresh"]

        with ThreadPoolExecutor(8) as pool:
            addresses = {future.result() for future in [pool.submit(load) for _ in range(8)]}
        assert len(addresses) == 1  # two would mean that the code of one is freed while its owner still calls it


# --- stiff plants


@pytest.mark.slow
def test_a_sweep_finds_out_once_that_its_plant_is_stiff_and_steps_all_runs_so(monkeypatch):
    n = 100  # a pipe cut into n elements
    inertia = (2122.0 + 374.0 / n, *(374.0 / n,) * (n - 2), 374.0 + 374.0 / n)
    pipe = TorsionalChain(inertia=inertia, stiffness=(473.0 * n,) * (n - 1), damping=(23.2 * n,) * (n - 1), top_drag=425.0, bit_drag=50.0)
    asked = []
    alone = workers.carry_out
    monkeypatch.setattr(workers, "carry_out", lambda run: (asked.append(run), alone(run))[1])
    axes, arguments = {"bit.weight": np.array([85e3, 91e3, 97e3])}, {"accuracy": 1e-4, "metrics": ("severity",)}
    stiff, soft = (closed_loop(plant, inputs={"top.torque": 10_000.0}) for plant in (compose(pipe, BitRock()), RIG))
    found = {method: sweep(stiff, axes, duration=60.0, method=method, **arguments) for method in ("event", "stiff", "explicit")}
    assert len(asked) == 1
    np.testing.assert_array_equal(found["event"]["severity"], found["stiff"]["severity"])
    assert (found["event"]["severity"] != found["explicit"]["severity"]).all()
    np.testing.assert_allclose(found["event"]["severity"], found["explicit"]["severity"], rtol=1e-3)
    mild = {method: sweep(soft, axes, duration=20.0, method=method, **arguments)["severity"] for method in ("event", "explicit")}
    np.testing.assert_array_equal(mild["event"], mild["explicit"])


def test_a_number_goes_by_the_end_of_its_name_where_no_other_ends_so():
    loop = closed_loop(RIG, StiffPI())
    found = sweep(loop, {"proportional": [2e4, 3e4], "weight": ["60 kN"]}, 5.0, metrics="maximum")
    assert found.names == ("stiffpi.proportional", "bit.weight") and found.display_units["N"] == "kN"
    whole = sweep(loop, {"stiffpi.proportional": [2e4, 3e4], "bit.weight": [60e3]}, 5.0, metrics="maximum")
    np.testing.assert_array_equal(found["maximum"], whole["maximum"])
    assert loop.at("proportional", 3e4) == loop.at("stiffpi.proportional", 3e4)
    with pytest.raises(SceneError, match="`reference` must name one number, but `top.reference`, `stiffpi.reference` end so"):
        loop.number("reference")


@pytest.mark.parametrize("name", ["bit.weight", "chain.inertia.1", "pi.proportional", "top.reference", "bit.speed"])
def test_a_run_that_is_read_holds_the_loop_with_its_own_number(name):
    loop = closed_loop(RIG, PI(reference=8.0))
    values = [0.9 * loop.number(name).value + 0.1, 1.1 * loop.number(name).value + 0.2]
    found = sweep(loop, {name: values}, 1.0, metrics={"own": lambda run: run.run.loop.number(name).value})
    np.testing.assert_allclose(found["own"], values, rtol=1e-15)
