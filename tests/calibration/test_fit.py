"""Calibration: numbers behind data are found within their intervals, intervals mean what they say, and what cannot be told apart is refused."""

import csv
import dataclasses
import math
import re
import shlex
import tomllib

import numpy as np
import pytest
from scipy import stats
from scipy.io import savemat

from controllers import PI
from models import BitRock, BlockOnBelt, Coulomb, Exponential, Hyperbolic, StepFriction, wells
from studies.questions.synthetic import COLUMNS, FOLDER, NOISE, TRUTH, recording, true_rig, write
from tests.dropping import Dropping
from toolbox import Sampled, Scene, SceneError, closed_loop, compose, fit, measure, simulate
from toolbox.calibration import MeasuredContact, Recording
from toolbox.commands.command_line import main

FREE = list(TRUTH)
RIG = compose(wells.JANSEN_2, BitRock())
SPEEDS = {name: heading for name, heading in COLUMNS.items() if name != "bit.torque"}


def inside(found, truth):
    return [found.interval(name)[0] <= value <= found.interval(name)[1] for name, value in truth.items()]


# ------------------------------------------------------------------------------------------------------------------------------------ the truth
def test_a_simulation_fitted_to_speeds_finds_the_bit_law_behind_them_within_its_intervals():
    found = fit(RIG, FOLDER / "rig.csv", FREE, columns=SPEEDS, starts=1)
    assert all(inside(found, TRUTH))
    assert (found.standard_errors < 0.01 * found.values).all()  # and the intervals are of use
    left = {residual.signal: residual.rms for residual in found.residuals}
    assert left == pytest.approx({name: NOISE[name] for name in left}, rel=0.1)
    assert found.white and not found.at_bounds
    assert found.plant.parameter("bit.friction.decay") == found["bit.friction.decay"]


def test_without_noise_the_numbers_are_found_to_the_accuracy_of_the_simulation():
    signals = recording(noise=0.0, duration=16.0)
    del signals["bit.torque"]
    found = fit(RIG, signals, FREE, starts=1)
    assert [found[name] for name in FREE] == pytest.approx(list(TRUTH.values()), rel=1e-7)


@pytest.mark.parametrize("static", [0.9, 1.0])
def test_a_table_with_rows_at_its_switches_gives_the_numbers_back_from_which_it_was_made(tmp_path, static):
    # friction jumps there: a row on the wrong side of a switch, by 1e-9 s, must not weigh as much as all the others
    path = simulate(compose(BlockOnBelt(friction=Coulomb(static=1.0, kinetic=0.6))), 40.0).to_csv(tmp_path / "run.csv")
    found = fit(
        compose(BlockOnBelt(friction=Coulomb(static=static, kinetic=0.6 * static))), path, ("belt.friction.static", "belt.friction.kinetic"),
        {"belt.friction.static": (0.8, 1.3), "belt.friction.kinetic": (0.3, 0.79)}, starts=1,
    )  # fmt: skip
    assert found.values == pytest.approx([1.0, 0.6], rel=1e-7)


def test_the_law_of_a_contact_is_found_from_its_measured_loop_without_simulation():
    found = fit(RIG, FOLDER / "rig.csv", FREE, columns=COLUMNS, contact="bit")
    assert all(inside(found, TRUTH))
    assert found.residuals[0].rms == pytest.approx(NOISE["bit.torque"], rel=0.1)
    assert found.white


def test_intervals_of_95_percent_hold_the_truth_in_about_95_of_100_recordings():
    hits = np.array([inside(fit(true_rig(), recording(seed, duration=20.0), FREE, contact="bit", starts=1), TRUTH) for seed in range(60)])
    # binomial: fewer than 51 hits of 60 have a chance of 1 in 700
    assert (hits.sum(axis=0) >= 51).all() and hits.sum() < hits.size, hits.sum(axis=0)


@pytest.mark.parametrize(("truth", "ends"), [(0.05, 0.05), (-0.1, 0.0)])
def test_a_fit_to_a_loop_ends_where_friction_would_drive_the_machine_beyond_the_speeds_that_were_measured(truth, ends):
    belt = compose(BlockOnBelt(belt_speed=0.0, friction=Dropping()))
    speed = np.linspace(0.1, 1.0, 80)
    data = {"time": np.arange(80.0), "block.speed": speed, "belt.force": -Dropping(beyond=truth).sliding(speed)}  # above zero there in both
    found = fit(belt, data, "belt.friction.beyond", contact="belt")
    assert found["belt.friction.beyond"] == pytest.approx(ends, abs=1e-3)
    assert found.plant.parameter("belt.friction.beyond") == found["belt.friction.beyond"]
    assert ("must not fall below zero" in str(found)) == (truth < 0.0)


def test_kinetic_friction_from_a_loop_is_the_mean_force_and_its_interval_that_of_a_mean():
    belt = compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=0.5, kinetic=0.5)))
    random = np.random.default_rng(3)
    force = -0.4 + 0.05 * random.standard_normal(80)
    data = {"time": np.arange(80.0), "block.speed": np.linspace(1.0, 2.0, 80), "belt.force": force}
    found = fit(belt, data, "belt.friction.kinetic", contact="belt")
    deviation = force.std(ddof=1) / math.sqrt(80)
    assert found["belt.friction.kinetic"] == pytest.approx(-force.mean(), rel=1e-8)
    low, high = found.interval("belt.friction.kinetic")
    assert (high - low) / 2 == pytest.approx(stats.t.ppf(0.975, 79) * deviation, rel=1e-6)


def test_a_fit_shows_in_a_notebook_the_rows_that_it_prints_below_its_confidence():
    belt = compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=0.5, kinetic=0.5)))
    force = -0.4 + 0.05 * np.random.default_rng(3).standard_normal(80)
    data = {"time": np.arange(80.0), "block.speed": np.linspace(1.0, 2.0, 80), "belt.force": force}
    found = fit(belt, data, "belt.friction.kinetic", contact="belt", confidence=0.9)
    cells = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row) for row in re.findall(r"<tr>.*?</tr>", found._repr_html_(), re.DOTALL)]
    assert cells[0][:4] == ["name", "estimate", "interval of 90 %", "unit"]
    printed = next(line for line in str(found).splitlines() if line.strip().startswith("belt.friction.kinetic"))
    assert re.split(r" {2,}", printed.strip()) == [cell for cell in cells[1] if cell]


def test_the_force_at_break_away_is_the_static_bound_of_a_law_that_jumps():
    belt = compose(BlockOnBelt(friction=Coulomb(static=1.0, kinetic=0.6)))
    time = np.arange(0.0, 40.0, 0.01)
    run = simulate(belt, 40.0, start={"block.speed": 0.2}, output_times=time)
    random = np.random.default_rng(1)
    data = {name: run[name] + 0.01 * random.standard_normal(time.size) for name in ("block.speed", "belt.force")}
    guess = belt.with_parameters({"belt.friction.static": 1.5, "belt.friction.kinetic": 0.4})
    found = fit(
        guess,
        {"time": time, **data},
        ["belt.friction.static", "belt.friction.kinetic"],
        contact=MeasuredContact("belt", standstill_speed=0.05),
    )
    assert all(inside(found, {"belt.friction.static": 1.0, "belt.friction.kinetic": 0.6}))
    assert found.misfit.released.sum() == sum(event.before == "stick" for event in run.events)


def test_start_values_constant_inputs_and_single_entries_can_be_free():
    time = np.linspace(0.0, 12.0, 300)
    run = simulate(
        RIG, 12.0, start={"bit.speed": 6.0}, inputs={"top.torque": 9000.0}, parameters={"chain.inertia": (2122.0, 400.0)}, output_times=time
    )
    data = {"time": time, "bit.speed": run["bit.speed"], "top.speed": run["top.speed"]}
    found = fit(
        closed_loop(RIG, inputs={"top.torque": 10_000.0}, start={"bit.speed": 5.0}),
        data,
        ["bit.speed", "top.torque", "chain.inertia.1"],
        {"top.torque": (8e3, 11e3)},
    )
    assert [found["bit.speed"], found["top.torque"], found["chain.inertia.1"]] == pytest.approx([6.0, 9000.0, 400.0], rel=1e-6)
    assert found.parameters == {"chain.inertia.1": found["chain.inertia.1"]}


def test_a_rig_under_a_sampled_drive_is_fitted_with_exact_slopes_and_one_under_a_python_law_by_differences():
    def proportional(t, y):
        return 9000.0 + 3000.0 * (8.0 - y[0])

    time = np.linspace(0.0, 15.0, 200)
    for law, exact in ((PI(reference=8.0, proportional=3000.0, integral=1000.0), True), (proportional, False)):
        sampled = Sampled(law, 0.1)
        run = simulate(true_rig(), 15.0, controller=sampled, output_times=time)
        data = {"time": time, "top.speed": run["top.speed"], "top.torque": run["top.torque"]}  # the torque is an output of the loop
        found = fit(closed_loop(RIG, sampled, parameters={**TRUTH, "bit.friction.kinetic": 0.5}), data, "bit.friction.kinetic", starts=1)
        assert found["bit.friction.kinetic"] == pytest.approx(0.46, rel=1e-5)
        assert found.misfit.exact == exact and ("by differences" in str(found)) != exact


# ------------------------------------------------------------------------------------------------------------------------------ what is refused
@pytest.mark.parametrize("contact", [None, "bit"])
def test_weight_and_radius_enter_only_as_a_product_and_are_refused_together(contact):
    signals = recording(noise=1.0, duration=12.0)
    del signals["bit.weight"]
    if contact is None:
        del signals["bit.torque"]
    with pytest.raises(SceneError, match="tell apart, but `bit.weight` and `bit.radius` cannot be") as error:
        fit(RIG, signals, ["bit.friction.decay", "bit.weight", "bit.radius"], contact=contact, starts=1)
    assert "decay" not in str(error.value)
    alone = fit(RIG, signals, ["bit.weight"], contact=contact, starts=1)
    assert alone.standard_errors[0] > 0


def test_a_number_that_the_data_do_not_depend_on_is_refused_by_name():
    signals = recording(duration=3.0)  # the bit has not moved yet
    del signals["bit.torque"]
    with pytest.raises(SceneError, match="`bit.friction.kinetic` changes none of the measured signals"):
        fit(RIG, signals, ["chain.stiffness.0", "bit.friction.kinetic"], starts=1)


def test_a_law_of_the_wrong_form_leaves_residuals_with_structure_and_the_right_one_does_not():
    signals = recording()
    for law, white in ((Exponential(), True), (Hyperbolic(static=0.7, decay=0.05), False)):
        rig = compose(wells.JANSEN_2, BitRock(friction=law))
        names = [name for name in rig.parameters if name.startswith("bit.friction.")]
        found = fit(rig, signals, names, contact="bit")
        assert found.white is white, str(found)
        assert ("NOT white" in str(found)) is not white


def test_an_estimate_at_its_bound_is_told():
    found = fit(RIG, recording(), FREE, {"bit.friction.kinetic": (0.5, 0.6)}, contact="bit")
    assert found.at_bounds == ("bit.friction.kinetic",)
    assert "`bit.friction.kinetic` ended at its bound" in str(found)


def test_a_break_of_a_law_is_located_by_the_measured_slip():
    rig = compose(wells.JANSEN_2, BitRock(friction=StepFriction()))
    speed = np.linspace(0.5, 3.0, 60)
    torque = 90e3 * 0.155575 * np.where(speed >= 1.5, 0.2, 0.31)
    found = fit(
        closed_loop(rig, parameters={"bit.weight": 90e3}),
        {"time": np.arange(60.0), "bit.speed": speed, "bit.torque": torque},
        ["bit.friction.static", "bit.friction.kinetic"],
        contact="bit",
    )
    assert [found["bit.friction.static"], found["bit.friction.kinetic"]] == pytest.approx([0.31, 0.2], rel=1e-9)


GOOD = {"time": [0.0, 1.0, 2.0, 3.0], "bit.speed": [1.0, 2.0, 2.5, 2.0], "bit.torque": [8e3, 7.5e3, 7.4e3, 7.6e3]}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"bit.speed": [1.0, math.nan, 2.0, math.inf]}, "`bit.speed`, must hold at least three values, but 2 of 4 samples are none"),
        ({"time": [2.0, 1.0, 1.0, 1.0]}, "must increase, but only 1 of 4 do"),
        ({"bit.speed": [1.0, 2.0]}, "`bit.speed` has 2 samples and the time 4"),
        ({"bit.sped": [1.0] * 4}, "unknown column `bit.sped`: did you mean `bit.speed`"),
        ({"chain.speed": [1.0] * 4}, "choose one, e.g. `chain.speed.0`"),
        ({"bit.torque": ["a"] * 4}, "must be one row of numbers"),
    ],
)
def test_bad_data_are_refused_by_column_and_sample(change, words):
    with pytest.raises(SceneError) as error:
        fit(RIG, {**GOOD, **change}, FREE, contact="bit")
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"free": "bit.friction.statik"}, "There is no parameter `bit.friction.statik`: did you mean `bit.friction.static`"),
        ({"free": []}, "must name at least one number"),
        ({"free": "chain.inertia"}, "such as `chain.inertia.0`"),
        ({"ranges": {"bit.friction.static": (1.0, 0.5)}}, "with low < high"),
        ({"ranges": {"bit.radius": (0.1, 0.5)}}, "`bit.radius`, which is not free"),
        ({"starts": 0}, "`starts` must be an integer >= 1"),
        ({"confidence": 95}, "`confidence` must be > 0 and < 1"),
        ({"contact": "bti"}, "There is no contact with dry friction `bti`"),
        ({"noise": {"bit.speed": -1.0}}, "`noise.bit.torque` must be a finite number > 0"),
        ({"columns": {"bit.speed": "bit.speed", "bit.torque": "torque"}}, "must have `torque`"),
    ],
)
def test_bad_arguments_are_refused_in_words(arguments, words):
    with pytest.raises(SceneError) as error:
        fit(RIG, GOOD, **{"free": "bit.friction.static", "contact": "bit", **arguments})
    assert words in str(error.value)


def test_a_loop_needs_the_slip_and_the_force_of_its_contact():
    with pytest.raises(SceneError, match="must hold `bit.speed`, which the friction of `bit` depends on"):
        fit(RIG, {name: GOOD[name] for name in ("time", "bit.torque")}, FREE, contact="bit")
    with pytest.raises(SceneError, match="exactly one signal with the force of `bit`, such as .*`bit.torque`"):
        fit(RIG, {name: GOOD[name] for name in ("time", "bit.speed")}, FREE, contact="bit")
    with pytest.raises(SceneError, match="an output to be compared with"):
        fit(RIG, {"time": GOOD["time"], "top.torque": [1.0] * 4}, FREE)


# --------------------------------------------------------------------------------------------------------------------------------------- reading
def test_tables_mat_files_and_mappings_hold_the_same_recording(tmp_path):
    signals = recording(duration=2.0)
    write(tmp_path / "rig.csv")
    savemat(tmp_path / "rig.mat", {"t": signals["time"], "rpm": signals["bit.speed"][:, None] * 30 / math.pi, "note": "text"})
    of_table = Recording.of(tmp_path / "rig.csv", RIG, {"time": "time", "bit.speed": "downhole speed"})
    of_mat = Recording.of(tmp_path / "rig.mat", RIG, {"time": "t", "bit.speed": "rpm [rpm]"})
    of_mapping = Recording.of({"time": signals["time"] + 7.0, "bit.speed": signals["bit.speed"]}, RIG)
    assert list(of_table.signals) == list(of_mat.signals) == ["bit.speed"]
    assert of_mat.signals["bit.speed"] == pytest.approx(of_mapping.signals["bit.speed"], rel=1e-12)
    assert of_table.between(0.0, 2.0).signals["bit.speed"][-3:] != pytest.approx(np.zeros(3))
    assert of_mapping.time == pytest.approx(signals["time"], abs=1e-12)


def test_files_that_cannot_be_read_say_why(tmp_path):
    new = tmp_path / "new.mat"
    new.write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    (tmp_path / "bad.mat").write_bytes(b"nothing of the kind")
    (tmp_path / "rig.csv").write_text("time [s],bit.speed\n0,1\n1,2\n2,3\n")
    for name, words in (
        ("new.mat", "read as one of version 7.3"),
        ("bad.mat", "must be a MAT file"),
        ("bda.mat", "did you mean `bad.mat`"),
        ("rig.csv", "must name its unit, such as `bit.speed .rad/s.`"),
        ("none.csv", "There is no file"),
    ):
        with pytest.raises(SceneError, match=words):
            fit(RIG, tmp_path / name, FREE)


def test_a_figure_shows_traces_or_the_loop():
    signals = recording(duration=8.0)
    loop = fit(RIG, signals, "bit.friction.kinetic", contact="bit", starts=1)
    top, bottom = loop.plot()[:, 0]
    assert top.get_ylabel() == "bit torque [kN m]" and bottom.get_xlabel() == "slip of bit [rad/s]"
    del signals["bit.torque"]
    found = fit(RIG, signals, "bit.friction.static", starts=1)
    traces = found.plot()
    assert traces.shape == (2, 2) and traces[1, 0].get_xlabel() == "time [s]"
    sticks = measure.stick_intervals(simulate(found.loop, signals["time"][-1]), "bit")
    bands = [patch.get_extents().transformed(ax.transData.inverted()).intervalx for ax in traces[0] for patch in ax.patches]
    assert len(bands) == 2 * len(sticks) > 0
    assert bands[0] == pytest.approx(sticks[0], abs=0.05)


# --------------------------------------------------------------------------------------------------------------------------------------- command
def test_the_command_fits_a_scene_and_writes_report_table_figure_and_calibrated_scene(root, tmp_path, capsys):
    scene, out = root / "studies" / "scenes" / "jansen_2.toml", tmp_path / "fitted"
    columns = [word for name, heading in COLUMNS.items() for word in ("--column", f"{name}={heading}")]
    free = [word for name in FREE for word in (("--range", f"{name}=0.1:1") if "kinetic" in name else ("--free", name))]
    command = ["fit", str(scene), str(FOLDER / "rig.csv"), *free, *columns, "--contact", "bit", "--out", str(out)]
    assert main(command) == 0
    printed = capsys.readouterr().out
    assert "bit.friction.static" in printed and (out / "fit.txt").read_text() in printed
    assert {path.name for path in out.iterdir()} == {"fit.txt", "fit.csv", "fit.npz", "fit.png", "scene.toml", "origin.json"}
    with (out / "fit.csv").open(newline="") as file:
        rows = {row["name"]: row for row in csv.DictReader(file)}
    assert all(float(rows[name]["low"]) <= value <= float(rows[name]["high"]) for name, value in TRUTH.items())
    calibrated = Scene.load(out / "scene.toml")
    assert calibrated.plant().parameter("bit.friction.static") == pytest.approx(float(rows["bit.friction.static"]["estimate"]), rel=1e-12)
    assert dataclasses.replace(calibrated, parts=()).cases == dataclasses.replace(Scene.load(scene), parts=()).cases
    assert tomllib.loads((out / "scene.toml").read_text())["title"]
    assert main([*command, "--shift", "bit.torque=0"]) == 0  # a second fit takes the place of the first; a plain number is in seconds


def test_the_command_says_what_is_wrong(root, capsys):
    scene, data = str(root / "studies" / "scenes" / "jansen_2.toml"), str(FOLDER / "rig.csv")
    for words, complaint in (
        (["--range", "bit.friction.statik=0:1"], "did you mean `bit.friction.static`"),
        (["--free", "bit.friction.static=0:1"], "write `--range 'bit.friction.static=0:1'`"),
        ([], "`--free` must be given, or `--range`"),
        (["--range", "bit.friction.static=0"], "`--range` must be NAME=LOW:HIGH"),
        (["--range", "bit.weight=80 kg:90 kN"], "must be in N"),
        (["--free", "bit.weight", "--column", "bit.speed"], "SIGNAL=HEADING"),
        (["--free", "bit.weight"], "unknown column `drive torque"),
    ):
        assert main(["fit", scene, data, *words]) == 2
        assert complaint in capsys.readouterr().err


def test_the_example_of_the_help_reads_the_shipped_data(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(FOLDER.parents[1])
    with pytest.raises(SystemExit):
        main(["fit", "--help"])
    words = shlex.split(" ".join(capsys.readouterr().out.split()).partition("example: stickslip ")[2])
    assert main([*words[:-1], str(tmp_path / "fitted"), "--starts", "1"]) == 0
    assert "bit.friction.static" in capsys.readouterr().out


@pytest.mark.filterwarnings("error")
def test_the_figure_of_many_signals_has_room_for_all(tmp_path):
    run = simulate(compose(BlockOnBelt()), 8.0, output_times=np.linspace(0, 8, 100))
    axes = fit(compose(BlockOnBelt(mass=1.1)), run, "block.mass", {"block.mass": (0.8, 1.6)}, starts=1).plot()
    assert axes.shape == (2, 4) and {ax.get_ylabel().split(" [")[0] for ax in axes[1]} == {"residual"}
    assert all(ax.xaxis.get_tick_params()["labelbottom"] for ax in axes[1, 2:])  # the lowest of both columns have numbers
    figure = axes[0, 0].figure
    figure.savefig(tmp_path / "fit.png")  # a layout without room would warn
    whole, drawn = figure.bbox, figure.get_tightbbox(figure.canvas.get_renderer()).transformed(figure.dpi_scale_trans)
    assert drawn.x0 >= whole.x0 and drawn.x1 <= whole.x1 and drawn.y0 >= whole.y0 and drawn.y1 <= whole.y1
