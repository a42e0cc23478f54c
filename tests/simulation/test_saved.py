"""A run read back from its file is the run at its recorded times, and says what it cannot do."""

import dataclasses
import math
import pickle
import re

import numpy as np
import pytest

from controllers import LQG, PI
from models import BitRock, BlockOnBelt, Coulomb, StepFriction, wells
from tests.plants import RIG
from tests.simulation.test_contacts import Ball
from toolbox import Budget, SceneError, Trajectory, closed_loop, compose, energy_audit, fit, measure, simulate
from toolbox.errors import BudgetError
from toolbox.simulation import EventExact, Smoothing, saved_run
from toolbox.simulation.samples import SignalFunction
from toolbox.simulation.saved_run import interpolated, points

NUMBERS = {"reference": 8.0, "lowest_torque": 0.0, "highest_torque": 20_000.0}
RUNS = {
    "sampled drive": (RIG, 30.0, {"controller": PI(reference=9.0), "sample_time": 0.01}),
    "no contact": (compose(wells.JANSEN_2), 5.0, {"inputs": {"top.torque": 1e4}}),
    "no switch": (compose(BlockOnBelt(belt_speed=0.0)), 3.0, {"output_times": [0.0, 1.0, 2.0]}),
    "a break of the law": (
        compose(BlockOnBelt(friction=StepFriction(static=1.0, kinetic=0.5, drop_speed=0.3))),
        20.0,
        {"start": {"block.position": 1.0}},
    ),
    "bounces": (compose(Ball(stiffness=1e4, damping=20.0)), 3.0, {"start": {"ball.height": 1.0}}),
    "smoothed": (compose(BlockOnBelt()), 10.0, {"method": Smoothing(1e-2)}),
    "signals of several entries": (RIG, 10.0, {"controller": LQG(**NUMBERS), "sample_time": 0.01}),
}


@pytest.mark.parametrize("case", RUNS)
def test_a_run_read_back_has_its_records_modes_events_and_units(case, tmp_path):
    plant, duration, arguments = RUNS[case]
    run = simulate(plant, duration, **arguments)
    back = Trajectory.load(run.save(tmp_path / "run.npz"))
    np.testing.assert_array_equal(back.time, run.time)
    assert back.names == run.names and back.end == run.end and back.events == run.events
    for name in run.names:
        np.testing.assert_array_equal(back[name], run[name])
        assert back.unit(name) == run.unit(name)
    for element, words in run.modes.items():
        np.testing.assert_array_equal(back.modes[element], words)
        assert back.intervals(element) == run.intervals(element)
        assert all(back.time_in(element, word, after=1.0) == run.time_in(element, word, after=1.0) for word in set(words))


@pytest.mark.parametrize("case", RUNS)
def test_a_run_read_back_answers_at_any_time_as_the_run_itself(case, tmp_path):
    plant, duration, arguments = RUNS[case]
    run = simulate(plant, duration, **arguments)
    back = Trajectory.load(run.save(tmp_path / "run.npz"))
    nodes = run.every_step.time
    times = np.sort(np.concatenate([nodes, np.linspace(0.0, run.end, 1003), 0.3 * nodes[:-1] + 0.7 * nodes[1:]]))
    exact, read = run.at(times), back.at(times)
    for name in run.names:
        size = np.abs(exact[name]).max() or 1.0
        np.testing.assert_allclose(read[name], exact[name], rtol=0, atol=1e-10 * size)  # whatever the accuracy: it is the same run
    for element, words in exact.modes.items():
        np.testing.assert_array_equal(read.modes[element], words)
    name = next(name for name in run.names if run[name].ndim == 1)
    assert isinstance(back.at(1.0)[name], float) and back.at(1.0)[name] == back.at([1.0])[name][0]


@pytest.mark.parametrize(("accuracy", "most"), [(1e-6, 1e-10), (1e-9, 5e-12)])
def test_the_file_of_a_finer_run_is_finer_too(accuracy, most, tmp_path):
    plant, _, arguments = RUNS["sampled drive"]
    run = simulate(plant, 10.0, accuracy=accuracy, **arguments)
    back = Trajectory.load(run.save(tmp_path / "run.npz"))
    times = np.sort(np.concatenate([np.linspace(0.0, 10.0, 1003), 0.3 * run.every_step.time[:-1] + 0.7 * run.every_step.time[1:]]))
    exact, read = run.at(times), back.at(times)
    assert all(np.abs(read[name] - exact[name]).max() <= most * np.abs(exact[name]).max() for name in run.names)


def test_a_signal_that_changes_in_no_step_is_kept_once_a_step(tmp_path):
    run = simulate(RIG, 5.0, controller=LQG(**NUMBERS), sample_time=0.01)
    path = run.save(tmp_path / "run.npz")
    with np.load(path) as arrays:
        points = int(arrays["step.degree"].astype(int).sum() + arrays["step.degree"].size)
        lengths = {name: len(arrays[f"step.{name}"]) for name in ("bit.speed", "top.torque", "estimate.bit.speed", "bit.weight")}
    nodes = run.every_step.time.size
    assert lengths == {"bit.speed": points, "top.torque": nodes, "estimate.bit.speed": nodes, "bit.weight": nodes} and points > 3 * nodes
    back, times = Trajectory.load(path), np.linspace(0.0, 5.0, 1003)
    np.testing.assert_array_equal(back.at(times)["estimate.bit.speed"], run.at(times)["estimate.bit.speed"])


def test_polynomials_are_checked_against_a_finer_run_of_points():
    # of a signal that no low degree follows the degree is high, of one that stands still it is 1
    values = np.sin(3.0 * points(16))[None]
    for degree in (4, 8):
        at = np.linspace(0.0, 1.0, 101)
        found = interpolated(np.repeat(np.sin(3.0 * points(degree))[None], 101, axis=0), at)
        # of degree n the error is at most 2 (3/4)^(n+1) / (n+1)! of the bound of the derivative
        assert np.abs(found - np.sin(3.0 * at)).max() <= 2 * 0.75 ** (degree + 1) / math.factorial(degree + 1)
    assert interpolated(values, np.array([1.0]))[0] == values[0, -1]


def test_a_run_read_back_measures_like_the_run(tmp_path):
    run = simulate(RIG, 60.0, controller=PI(reference=9.0), sample_time=0.01)
    back = Trajectory.load(run.save(tmp_path / "run.npz"))
    for each in (measure.stick_intervals, measure.cycles, measure.stuck_ratio):
        assert each(back, "bit", 10.0) == each(run, "bit", 10.0)
    mine, theirs = measure.extent(back, "bit.speed", 10.0), measure.extent(run, "bit.speed", 10.0)
    # where it stands the bit has its minimum at many times, so that times are not compared
    assert dataclasses.astuple(mine)[:3] == pytest.approx(dataclasses.astuple(theirs)[:3], rel=1e-5, abs=1e-6 * theirs.maximum)
    assert measure.severity(back, after=10.0) == pytest.approx(measure.severity(run, after=10.0), rel=1e-5)
    assert measure.mean_square(back, "bit.speed", 9.0) == pytest.approx(measure.mean_square(run, "bit.speed", 9.0), rel=1e-5)
    assert measure.overshoot(back, "top.speed", 9.0) == pytest.approx(measure.overshoot(run, "top.speed", 9.0), rel=1e-4)
    assert measure.settling(back, "top.speed", 9.0, 0.9) == pytest.approx(measure.settling(run, "top.speed", 9.0, 0.9), abs=1e-4)


def test_impacts_and_standstill_are_measured_on_a_run_read_back(tmp_path):
    plant, duration, arguments = RUNS["bounces"]
    run = simulate(plant, duration, **arguments)
    back = Trajectory.load(run.save(tmp_path / "run.npz"))
    element = run.program.system.elements[0].name
    found, exact = measure.contact(back, element), measure.contact(run, element)
    assert found.impacts == exact.impacts >= 3
    assert dataclasses.astuple(found) == pytest.approx(dataclasses.astuple(exact), rel=1e-5)
    assert measure.contact(back, element, after=1.0).impacts == measure.contact(run, element, after=1.0).impacts < found.impacts
    with pytest.raises(SceneError, match="There is no unilateral contact `ball`"):
        measure.contact(back, "ball")
    stop = simulate(compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(1.0, 0.6))), 20.0, start={"block.speed": 2.0})
    again = Trajectory.load(stop.save(tmp_path / "stop.npz"))
    assert measure.standstill(again, "block.speed") == pytest.approx(measure.standstill(stop, "block.speed"), rel=1e-5)


@pytest.mark.parametrize("case", ["sampled drive", "bounces", "smoothed", "no switch"])
def test_a_run_read_back_plots_the_same_curves(case, tmp_path):
    plant, duration, arguments = RUNS[case]
    run = simulate(plant, duration, **arguments)
    back = Trajectory.load(run.save(tmp_path / "run.npz"))
    for drawn, read in zip(run.plot(), back.plot(), strict=True):
        assert (drawn.get_ylabel(), len(drawn.patches), len(drawn.collections)) == (
            read.get_ylabel(),
            len(read.patches),
            len(read.collections),
        )
        for line, other in zip(drawn.get_lines(), read.get_lines(), strict=True):
            assert line.get_label() == other.get_label()
            np.testing.assert_array_equal(line.get_xdata(), other.get_xdata())
            np.testing.assert_allclose(line.get_ydata(), other.get_ydata(), rtol=0, atol=1e-5 * (np.abs(line.get_ydata()).max() or 1.0))


def test_a_run_read_back_goes_to_pandas_and_csv_like_the_run(tmp_path):
    pandas = pytest.importorskip("pandas")
    run = simulate(RIG, 5.0)
    back = Trajectory.load(run.save(tmp_path / "run.npz"))
    pandas.testing.assert_frame_equal(back.to_pandas(), run.to_pandas())
    assert back.to_csv(tmp_path / "back.csv").read_text() == run.to_csv(tmp_path / "run.csv").read_text()


def test_a_data_frame_and_a_data_set_have_the_units_of_every_signal_and_agree(tmp_path):
    pytest.importorskip("pandas")
    pytest.importorskip("xarray")
    run = simulate(RIG, 5.0)
    frame, data = run.to_pandas(), run.to_xarray()
    for name in run.names:
        assert data[name].attrs["units"] == run.unit(name)
        np.testing.assert_array_equal(data[name].values, run[name])
        columns = [name] if run[name].ndim == 1 else [f"{name}.{i}" for i in range(run[name].shape[1])]
        assert {frame.attrs["units"][each] for each in columns} == {run.unit(name)}
        np.testing.assert_array_equal(frame[columns].to_numpy().reshape(run[name].shape), run[name])
    for name, words in run.modes.items():
        assert data[f"{name}.mode"].values.tolist() == frame[f"{name}.mode"].tolist() == words.tolist()
    assert any(run[name].ndim == 2 for name in run.names)  # a vector is among them
    assert data["time"].attrs["units"] == frame.attrs["units"]["time"] == "s"
    np.testing.assert_array_equal(data["time"].values, run.time)
    back = Trajectory.load(run.save(tmp_path / "run.npz"))
    assert back.to_xarray().identical(data) and back.to_pandas().attrs == frame.attrs


def test_a_run_is_no_array_and_says_what_to_take_instead(tmp_path):
    run = simulate(RIG, 5.0)
    for each in (run, Trajectory.load(run.save(tmp_path / "run.npz"))):
        for make in (np.asarray, np.array, np.mean, lambda whole: np.add(whole, 1.0), lambda whole: np.asarray(whole, dtype=object)):
            with pytest.raises(
                TypeError, match="is not one array: take a signal, such as .*, or all of them, `run.to_pandas\\(\\)`"
            ) as caught:
                make(each)
            assert np.asarray(eval(re.search("such as `(.*?)`", str(caught.value))[1], {"run": each})).shape == each.time.shape


def test_a_run_read_back_keeps_the_error_that_was_asked(tmp_path):
    run = simulate(RIG, 5.0)
    error = run.error_estimate
    back = Trajectory.load(run.save(tmp_path / "run.npz"))
    assert back.error_estimate == error and f"error {error:.1e}" in str(back)
    assert str(back).splitlines()[0] == str(run).splitlines()[0]


def test_a_run_is_saved_with_the_signals_that_are_asked_for(tmp_path):
    run = simulate(RIG, 10.0, controller=PI(reference=9.0))
    part = Trajectory.load(run.save(tmp_path / "part.npz", ["bit.speed", "top.torque"]))
    times = np.linspace(0.0, 10.0, 301)
    assert part.names == ["bit.speed", "top.torque"] and part.events == run.events and part.intervals("bit") == run.intervals("bit")
    for name in part.names:
        np.testing.assert_allclose(part.at(times)[name], run.at(times)[name], atol=1e-9 * np.abs(run[name]).max())
    assert set(part.main_signals) <= set(part.names)
    with pytest.raises(SceneError, match=r"bit\.sped"):
        run.save(tmp_path / "none.npz", ["bit.sped"])
    assert not (tmp_path / "none.npz").exists()


def test_a_run_that_failed_is_read_back_as_far_as_it_came(tmp_path):
    with pytest.raises(BudgetError) as caught:
        simulate(compose(BlockOnBelt()), 100.0, method=EventExact(budget=Budget(events=3)), output_times=[0.0, 99.0])
    run = caught.value.run
    back = Trajectory.load(run.save(tmp_path / "run.npz"))
    assert (back.end, len(back.events)) == (run.end, 3)
    assert back.time_in("belt", "stick") == run.time_in("belt", "stick") > 0.0


def test_what_a_file_does_not_hold_is_refused_by_name(tmp_path):
    run = simulate(RIG, 5.0)
    back = Trajectory.load(run.save(tmp_path / "run.npz"))
    with pytest.raises(
        SceneError, match=r"does not say its error: `error_estimate` needs the plant; ask it before `save`, or `pickle` the run"
    ):
        back.error_estimate  # noqa: B018
    with pytest.raises(SceneError, match=r"cannot be carried on: `last` needs the plant"):
        back.last  # noqa: B018
    with pytest.raises(SceneError, match=r"Argument `run` must be a trajectory with its plant"):
        energy_audit(back)
    with pytest.raises(SceneError, match=r"Argument `time` must be a number or a row of numbers between 0 and 5 s, but it is 6.0"):
        back.at(6.0)
    with pytest.raises(SceneError, match=r"There is no signal `chain.speed.2`"):
        back.at(1.0)["chain.speed.2"]
    with pytest.raises(SceneError, match=r"There is no signal `bit.sped`: did you mean `bit.speed`"):
        back["bit.sped"]
    with pytest.raises(SceneError, match="There is no element `bot`"):
        back.modes["bot"]
    assert pickle.loads(pickle.dumps(run)).at(1.0)["bit.speed"] == run.at(1.0)["bit.speed"]


def test_a_file_that_holds_no_run_is_refused(tmp_path):
    (tmp_path / "letter.npz").write_text("mine")
    np.savez(tmp_path / "other.npz", time=np.zeros(3))
    for name in ("letter.npz", "other.npz"):
        with pytest.raises(SceneError, match=rf"File `.*{name}` must be a run written by `Trajectory.save`"):
            Trajectory.load(tmp_path / name)
    with pytest.raises(SceneError, match=r"There is no file `.*othr.npz`: did you mean `other.npz`"):
        Trajectory.load(tmp_path / "othr.npz")


@pytest.mark.parametrize("through", [lambda run, path: run, lambda run, path: Trajectory.load(run.save(path))], ids=["run", "file"])
def test_a_run_is_data_to_fit(through, tmp_path):
    truth, guess = (BlockOnBelt(mass=m, friction=Coulomb(static=1.0, kinetic=0.6)) for m in (1.3, 1.0))
    run = simulate(compose(truth), 12.0, start={"block.position": 0.5}, output_times=np.linspace(0, 12, 200), accuracy=1e-10)
    data = through(run, tmp_path / "run.npz")
    for columns in ({"block.position": "block.position"}, {"block.speed": "block.speed [m/s]"}):
        found = fit(
            closed_loop(compose(guess), start={"block.position": 0.5}),
            data,
            "block.mass",
            {"block.mass": (0.8, 1.6)},
            columns=columns,
            starts=1,
        )
        assert found["block.mass"] == pytest.approx(1.3, rel=1e-6)
    with pytest.raises(SceneError, match=r"must have `position`, but it is not there: did you mean `block.position`"):
        fit(compose(guess), data, "block.mass", columns={"block.position": "position"})


def test_signals_of_a_law_that_the_plant_does_not_know_are_left_out_of_a_fit():
    # the torque of the law drives the plant alone, linear between samples; what the law remembers is no signal of the plant
    run = simulate(RIG, 6.0, controller=PI(reference=9.0), output_times=np.linspace(0, 6, 601))
    assert "pi.angle" in run
    softer = compose(dataclasses.replace(wells.JANSEN_2, stiffness=(440.0,)), BitRock())
    found = fit(softer, run, "chain.stiffness.0", {"chain.stiffness.0": (400.0, 550.0)}, starts=1)
    assert found["chain.stiffness.0"] == pytest.approx(473.0, rel=1e-4)
    with pytest.raises(SceneError, match="`bit.weight` varies in time or is measured"):  # it is in the run, like any input
        fit(RIG, run, "bit.weight")


def test_a_file_of_an_older_version_opens_with_straight_lines_between_its_records(tmp_path):
    run = simulate(compose(BlockOnBelt()), 20.0)
    with np.load(run.save(tmp_path / "new.npz")) as new:
        added = ("contacts", "main", "report", "error", "accuracy")
        kept = {name: new[name] for name in new.files if not name.startswith(("step.", "limit.", "approach.")) and name not in added}
    np.savez_compressed(tmp_path / "old.npz", **kept)
    old = Trajectory.load(tmp_path / "old.npz")
    assert old.at(run.time[5])["block.position"] == run["block.position"][5]
    middle = 0.5 * (run.time[5] + run.time[6])
    assert old.at(middle)["block.position"] == pytest.approx(0.5 * (run["block.position"][5] + run["block.position"][6]))
    assert old.events == run.events and old.time_in("belt", "stick") == pytest.approx(run.time_in("belt", "stick"))
    assert old.contacts == ["belt"] and old.main_signals == ["block.speed"]
    assert "saved by an older version: straight lines" in str(old)
    old.plot()


def test_signals_that_are_computed_together_are_those_that_are_computed_one_by_one():
    for plant, duration, arguments in RUNS.values():
        run = simulate(plant, duration, **arguments)
        for samples in (run, run.at(np.linspace(0.0, run.end, 131))):  # whole blocks, and what is left over
            together = samples.columns(run.names)
            assert list(together) == run.names
            for name in run.names:
                np.testing.assert_array_equal(together[name], samples[name])
    with pytest.raises(SceneError, match=r"There is no signal `bit.sped`: did you mean `bit.speed`"):
        simulate(RIG, 1.0).columns(["bit.speed", "bit.sped"])


def test_the_file_of_a_long_run_is_as_long_as_its_arrays(tmp_path):
    path = simulate(RIG, 60.0, controller=PI(reference=9.0)).save(tmp_path / "run.npz")
    with np.load(path) as arrays:
        assert path.stat().st_size <= 1.2 * sum(arrays[name].nbytes for name in arrays.files)


def test_a_run_that_takes_long_to_save_says_once_how_far_it_is(tmp_path, monkeypatch, caplog):
    caplog.set_level("INFO", logger="stickslip")
    run = simulate(RIG, 120.0, controller=PI(reference=9.0), sample_time=0.01)
    run.save(tmp_path / "run.npz")
    assert not caplog.messages
    monkeypatch.setattr(saved_run, "SILENT", 0.0)
    run.save(tmp_path / "run.npz")
    assert caplog.messages == [f"saving {run.time.size} steps: {saved_run.CHUNK} are done after 0 s ..."]


class WatchedBuffer:
    """A buffer of casadi that keeps which arguments were placed."""

    def __init__(self, buffer, placed):
        self.buffer, self.placed = buffer, placed

    def set_arg(self, i, memory):
        self.placed.add(i)
        self.buffer.set_arg(i, memory)

    def set_res(self, i, memory):
        self.buffer.set_res(i, memory)


def test_an_array_without_columns_is_given_no_place_in_memory(monkeypatch):
    """A piece of such an array begins beyond it, in memory of others: casadi then reports corruption, or not, by where that lies."""
    placed = set()
    buffer_of = SignalFunction._buffer

    def watched(self, size):
        buffer, evaluate = buffer_of(self, size)
        return WatchedBuffer(buffer, placed), evaluate

    monkeypatch.setattr(SignalFunction, "_buffer", watched)
    run = simulate(RIG, 20.0, controller=PI(9.0))
    assert run["bit.speed"].size == run.time.size > 8
    assert run.held.shape[1] == 0 and placed == {0, 1, 2, 4}  # time, states, numbers and mode, not the held signals
