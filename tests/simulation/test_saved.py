"""A run read back from its file is the run at its recorded times, and says what it cannot do."""

import dataclasses
import pickle

import numpy as np
import pytest

from controllers import PI
from models import BitRock, BlockOnBelt, Coulomb, Drop, wells
from tests.simulation.test_contacts import Ball
from toolbox import Budget, BudgetError, SceneError, Smoothing, Trajectory, compose, fit, simulate

RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
RUNS = {
    "sampled drive": (RIG, 30.0, {"controller": PI(reference=9.0), "sample_time": 0.01}),
    "no switch": (compose(BlockOnBelt(belt_speed=0.0)), 3.0, {"output_times": [0.0, 1.0, 2.0]}),
    "a break of the law": (compose(BlockOnBelt(friction=Drop(static=1.0, kinetic=0.5, speed=0.3))), 20.0, {"start": {"block.position": 1.0}}),
    "bounces": (compose(Ball(stiffness=1e4, damping=20.0)), 3.0, {"start": {"ball.height": 1.0}}),
    "smoothed": (compose(BlockOnBelt()), 10.0, {"method": Smoothing(1e-2)}),
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


def test_a_run_that_failed_is_read_back_as_far_as_it_came(tmp_path):
    with pytest.raises(BudgetError) as caught:
        simulate(compose(BlockOnBelt()), 100.0, budget=Budget(events=3), output_times=[0.0, 99.0])
    run = caught.value.run
    back = Trajectory.load(run.save(tmp_path / "run.npz"))
    assert (back.end, len(back.events)) == (run.end, 3)
    assert back.time_in("belt", "stick") == run.time_in("belt", "stick") > 0.0


def test_what_a_file_does_not_hold_is_refused_by_name(tmp_path):
    run = simulate(RIG, 5.0)
    back = Trajectory.load(run.save(tmp_path / "run.npz"))
    for wish in (lambda: back.at(1.0), lambda: back.error):
        with pytest.raises(SceneError, match=r"has its records only: `(at|error)` needs the plant.*`pickle` the run"):
            wish()
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
        found = fit(compose(guess), data, "block.mass", {"block.mass": (0.8, 1.6)}, columns=columns, start={"block.position": 0.5}, starts=1)
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
