"""What a recording tells, and what it does with samples that are none."""

import tomllib

import numpy as np
import pytest

from models import BitRock, BlockOnBelt, Coulomb, Joint, wells
from studies.questions import synthetic
from toolbox import SceneError, compose, fit, simulate
from toolbox.calibration import Recording

BELT = compose(BlockOnBelt(friction=Coulomb(static=1.0, kinetic=0.6)))
RIG = compose(wells.JANSEN_2, BitRock())


def sines(step=0.1, end=40.0):
    time = np.arange(0.0, end, step)
    return {"time": time, "block.speed": np.sin(0.7 * time) + 0.3 * np.sin(2.3 * time), "block.position": np.cos(0.7 * time)}


@pytest.mark.parametrize("step", [0.02, 0.05, 0.1, 0.2])
@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.parametrize("machine", ["belt", "rig"])
def test_a_machine_that_sticks_and_slips_has_no_flaws(machine, step, noise):
    # the twin of the dirty logs: jumps of friction, phases at rest and peaks of slip are data
    plant, inputs = (BELT, {}) if machine == "belt" else (RIG, {"top.torque": 10_500.0})
    time = np.arange(0.0, 60.0, step)
    run = simulate(plant, 60.0, inputs=inputs, output_times=time)
    random = np.random.default_rng(5)
    names = ("block.speed", "belt.force") if machine == "belt" else ("bit.speed", "bit.torque", "top.speed")
    data = {name: run[name] + noise * np.ptp(run[name]) * random.standard_normal(time.size) for name in names}
    found = Recording.of({"time": time, **data}, plant)
    assert found.flaws == (), str(found)
    assert "time: increases, no gaps" in str(found)


def test_a_gap_is_no_straight_line_and_windows_are_what_lies_between():
    data = {name: np.delete(values, np.arange(100, 130)) for name, values in sines().items()}
    found = Recording.of(data, BELT)
    assert found.found("time") == {"gap": 1}
    assert np.array(found.windows()) == pytest.approx(np.array([(0.0, 9.9), (13.0, 39.9)]))
    even = found.resampled(0.05)
    inside = (even.time > 9.92) & (even.time < 12.98)
    assert np.isnan(even.signals["block.speed"][inside]).all() and np.isfinite(even.signals["block.speed"][~inside]).all()
    assert even.signals["block.position"][1] == pytest.approx(np.cos(0.7 * np.array([0.0, 0.1])).mean())


def test_a_gap_in_what_drives_the_machine_is_refused_with_the_windows_without_one():
    data = {name: np.delete(values, np.arange(100, 130)) for name, values in sines().items()}
    data["block.force"] = data.pop("block.position")
    with pytest.raises(
        SceneError, match=r"without gaps, but it is there in 2 stretches: choose among the windows 0 .. 9.9 s, 13 .. 39.9 s"
    ):
        fit(BELT, data, "block.mass", starts=1)


def test_windows_without_a_gap_inside_of_a_window_are_told_in_the_times_of_the_log():
    data = {name: np.delete(values, np.arange(200, 230)) for name, values in sines().items()}
    data["block.force"] = data.pop("block.position")
    with pytest.raises(SceneError, match=r"choose among the windows 10 .. 19.9 s, 23 .. 30 s\.$"):
        fit(BELT, data, "block.mass", starts=1, window=(10.0, 30.0))
    fit(BELT, data, "block.mass", starts=1, window=(10.0, 19.9))  # what was told works


def test_a_log_whose_time_has_a_name_of_its_own_is_read_and_one_without_says_what_to_name():
    data = {"Date/Time": [f"2024-03-07T10:00:{k:02d}" for k in range(20)], "Umdrehung [rpm]": np.sin(np.arange(20.0))}
    found = Recording.of(data, RIG, {"bit.speed": "Umdrehung"})
    assert found.time[-1] == 19.0
    data["Stempel"] = data.pop("Date/Time")
    with pytest.raises(
        SceneError, match=r"`columns` must say which column is `time`, because no column of .* is called so: `Umdrehung`, `Stempel`\."
    ):
        Recording.of(data, RIG, {"bit.speed": "Umdrehung"})


def test_headings_that_differ_by_capitals_alone_are_two_columns():
    time = np.linspace(0.0, 1.0, 50)
    data = {"t [s]": time, "T [N m]": np.sin(time), "n [rad/s]": np.cos(time), "speed [rad/s]": time, "SPEED [rad/s]": time}
    columns = {"time": "t", "joint.torque": "T", "joint.speed": "n"}
    for torque in ("T", "T [N m]"):
        read = Recording.of(data, compose(Joint()), {**columns, "joint.torque": torque})
        assert np.array_equal(read.signals["joint.torque"], np.sin(time)) and read.time[-1] == 1.0
    assert Recording.of(data, compose(Joint()), {**columns, "joint.speed": "N"}).signals["joint.speed"][-1] == np.cos(1.0)
    with pytest.raises(SceneError, match="must have `T`, but it is not there"):  # the time is no torque
        Recording.of({name: data[name] for name in ("t [s]", "n [rad/s]")}, compose(Joint()), columns)
    with pytest.raises(SceneError, match="differ from it by capitals alone"):
        Recording.of(data, compose(Joint()), {**columns, "joint.speed": "Speed"})


def test_samples_denser_than_asked_become_their_means():
    data = sines(0.01)
    found = Recording.of(data, BELT).resampled("0.1 s")
    assert found.signals["block.speed"][5] == pytest.approx(data["block.speed"][45:55].mean(), abs=0.02)


def test_the_shift_of_a_clock_is_found_between_samples_and_removed():
    data = sines()
    late = 0.73
    data["block.position"] = np.sin(0.7 * (data["time"] - late)) + 0.3 * np.sin(2.3 * (data["time"] - late))
    found = Recording.of(data, BELT)
    shift = found.shift("block.position", "block.speed")
    assert shift == pytest.approx(late, abs=0.01)
    moved = found.shifted({"block.position": shift})
    good = np.isfinite(moved.signals["block.position"])
    assert good.sum() == pytest.approx(393, abs=2)
    assert np.abs(moved.signals["block.position"] - moved.signals["block.speed"])[good].max() < 0.02
    noise = np.random.default_rng(1).standard_normal(data["time"].size)
    with pytest.raises(SceneError, match="must change together"):
        Recording.of({**data, "block.position": noise}, BELT).shift("block.position", "block.speed")


def test_a_table_of_pandas_over_dates_in_local_time_is_read(tmp_path):
    pandas = pytest.importorskip("pandas")
    data = sines()
    index = pandas.date_range("2024-03-31 01:59:50", periods=data["time"].size, freq="100ms", tz="UTC").tz_convert("Europe/Oslo")
    table = pandas.DataFrame({"v [mm/s]": 1000.0 * data["block.speed"]}, index=index)
    found = Recording.of(table, BELT, {"block.speed": "v"})
    assert found.signals["block.speed"] == pytest.approx(data["block.speed"], abs=1e-12)
    assert found.time == pytest.approx(data["time"], abs=1e-6)  # the hour that summer takes is none


def test_a_flaw_that_is_data_can_be_kept():
    data = sines()
    data["block.speed"] = np.minimum(data["block.speed"], 0.8)
    assert Recording.of(data, BELT).found("block.speed")["clipped"] > 3
    assert Recording.of(data, BELT, accepted_flaws=["clipped"]).flaws == ()
    with pytest.raises(SceneError, match="did you mean `clipped`"):
        Recording.of(data, BELT, accepted_flaws=["cliped"])


def test_a_picture_shows_what_was_left_out_and_draws_no_line_over_a_gap(tmp_path):
    data = {name: np.delete(values, np.arange(100, 130)) for name, values in sines().items()}
    data["block.speed"][50] = -999.25
    axes = Recording.of(data, BELT).plot()
    assert axes.shape == (2,) and axes[-1].get_xlabel() == "time [s]"
    line = axes[0].lines[0]
    assert np.isnan(line.get_ydata()[[50, 99]]).all()
    assert axes[0].lines[1].get_label() == "left out"


def test_the_dirty_log_that_is_shipped_tells_its_dirt_and_gives_the_numbers_behind_it():
    found = Recording.of(synthetic.FOLDER / "dirty_rig.csv", RIG, synthetic.COLUMNS)
    truth = tomllib.loads((synthetic.FOLDER / "dirty_rig.toml").read_text())
    rows = np.delete(np.arange(1001), np.arange(*truth["dirt"]["gap"]))
    for kind, name, word in (("null", "bit.weight", "null"), ("dropped", "top.torque", "drop-out"), ("reversed", "bit.speed", "reversed")):
        assert rows[np.isnan(found.signals[name])].tolist() == truth["dirt"][kind]
        assert found.found(name) == {word: 4}
    assert found.found("time") == {"gap": 1}
    law = fit(RIG, found.shifted({"bit.speed": 0.4, "bit.torque": 0.4}), list(truth["numbers"]), contact="bit", starts=1)
    assert law.values == pytest.approx(list(truth["numbers"].values()), rel=0.05)  # the drift, which nobody took out, is 2 % of the torque
