"""stickslip simulate: one case or all, with the error of each, as report, data and figure, whole or not at all."""

import csv
import math
import sys

import numpy as np
import pytest

from tests.commands.test_command_line import one_line
from toolbox import Scene
from toolbox.calibration import Recording
from toolbox.commands import figures
from toolbox.commands.command_line import main
from toolbox.errors import ZenoError

BELT = """
title = "Block on a belt"
duration = 20
[[plant]]
part = "BlockOnBelt"
belt_speed = 0.2
[[controllers]]
label = "slow belt"
[[controllers]]
label = "pushed"
inputs = { "block.force" = 0.1 }
"""
STEMS = ("01_slow_belt", "02_pushed")
FILES = {"simulate.txt", "scene.toml", "origin.json", *(stem + tail for stem in STEMS for tail in (".npz", ".csv", ".png"))}


@pytest.fixture
def no_figures(monkeypatch):
    monkeypatch.setattr(figures, "draw_found", lambda found, title, path: path.touch())


def columns(path):
    with path.open(newline="") as file:
        headings, *rows = csv.reader(file)
    return dict(zip(headings, np.array(rows, float).T, strict=True))


def test_every_case_is_printed_with_its_measured_error_and_nothing_is_written_without_out(belt, tmp_path, capsys):
    assert main(["simulate", str(belt)]) == 0
    printed = capsys.readouterr().out
    scene = Scene.load(belt)
    for label in scene.labels:
        assert f"\n{label}\nTrajectory of BlockOnBelt" in printed
        assert f"error {scene.run(label).error_estimate:.1e}" in printed
    assert [path.name for path in tmp_path.iterdir()] == ["belt.toml"]


def test_the_folder_has_report_figure_and_data_that_agree_with_the_run(belt, tmp_path):
    out = tmp_path / "out"
    assert main(["simulate", str(belt), "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == FILES
    run = Scene.load(belt).run("slow belt")
    table = columns(out / "01_slow_belt.csv")
    times = table["time [s]"]
    assert (np.diff(times) > 0).all() and times[0] == 0.0 and times[-1] == 20.0
    assert table["block.position [m]"].max() == pytest.approx(run.at(times)["block.position"].max(), rel=1e-12)
    assert set(times) == set(run.time)
    with np.load(out / "01_slow_belt.npz", allow_pickle=False) as data:
        assert np.array_equal(data["time"], run.time)
        assert np.array_equal(data["block.speed"], run["block.speed"])
    assert (out / "01_slow_belt.png").read_bytes().startswith(b"\x89PNG")
    assert (out / "simulate.txt").read_text().startswith("Simulation of Block on a belt\n\nslow belt\nTrajectory")


def test_the_table_of_a_run_is_a_recording_that_can_be_read_again(belt, tmp_path, no_figures):
    out = tmp_path / "out"
    assert main(["simulate", str(belt), "--controller", "slow belt", "--out", str(out)]) == 0
    scene = Scene.load(belt)
    recorded = Recording.of(out / "01_slow_belt.csv", scene.plant(), {name: name for name in ("time", "block.position", "block.speed")})
    assert np.array_equal(recorded.signals["block.position"], scene.run("slow belt").at(recorded.time)["block.position"])


@pytest.mark.parametrize("method", ["event", "explicit", "stiff", "time-stepping", "smoothed"])
def test_method_duration_and_accuracy_are_those_of_the_command(belt, tmp_path, capsys, no_figures, method):
    out, given = tmp_path / "out", ["--method", method, "--accuracy", "1e-2", "--duration", "8"]
    assert main(["simulate", str(belt), "--controller", "slow belt", *given, "--out", str(out)]) == 0
    assert "8 s in" in capsys.readouterr().out
    exact = Scene.load(belt).run("slow belt")
    table = columns(out / "01_slow_belt.csv")
    assert table["time [s]"][-1] == 8.0
    size = np.abs(exact["block.position"]).max()
    assert table["block.position [m]"][-1] == pytest.approx(exact.at(8.0)["block.position"], abs=1e-2 * size)


def test_one_case_by_its_label_and_the_next_simulation_takes_the_place_of_the_one_before(belt, tmp_path, capsys, no_figures):
    out = tmp_path / "out"
    assert main(["simulate", str(belt), "--out", str(out)]) == 0
    (out / "notes.md").write_text("mine")
    assert main(["simulate", str(belt), "--controller", "pushed", "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {
        "notes.md",
        "origin.json",
        "simulate.txt",
        "scene.toml",
        "01_pushed.npz",
        "01_pushed.csv",
        "01_pushed.png",
    }
    capsys.readouterr()
    assert main(["simulate", str(belt), "--controller", "pusht"]) == 2
    assert "did you mean `pushed`" in one_line(capsys)


@pytest.mark.parametrize("name", ["simulate.txt", "01_slow_belt.csv"])
def test_a_file_that_no_simulation_wrote_is_not_overwritten(belt, tmp_path, capsys, name):
    out = tmp_path / "out"
    out.mkdir()
    (out / name).write_text("mine")
    assert main(["simulate", str(belt), "--out", str(out)]) == 2
    assert "must not hide your own files" in one_line(capsys)
    assert [(path.name, path.read_text()) for path in out.iterdir()] == [(name, "mine")]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (["--duration", "-1"], "`--duration` must be >= 0 s"),
        (["--duration", "nan"], "`--duration` must be a finite number"),
        (["--accuracy", "1"], "`--accuracy` must be >= 1e-13 and <= 0.1"),
        (["--accuracy", "0"], "`--accuracy` must be >= 1e-13 and <= 0.1"),
    ],
)
def test_a_wrong_number_is_one_line_and_exit_code_2_and_nothing_is_written(belt, tmp_path, capsys, given, words):
    assert main(["simulate", str(belt), *given, "--out", str(tmp_path / "out")]) == 2
    assert words in one_line(capsys)
    assert not (tmp_path / "out").exists()


def test_an_unknown_method_prints_the_usage(belt, capsys):
    with pytest.raises(SystemExit) as caught:
        main(["simulate", str(belt), "--method", "euler"])
    assert caught.value.code == 2
    assert "time-stepping" in capsys.readouterr().err


def test_a_case_that_fails_is_reported_and_does_not_stop_the_others_and_when_all_fail_the_exit_code_is_1(
    belt, tmp_path, capsys, no_figures, monkeypatch
):
    module = sys.modules["toolbox.simulation.simulate"]  # as an attribute of the package the verb hides it
    simulate, out = module.simulate, tmp_path / "out"

    def failing(loop, **arguments):
        if not loop.inputs:
            raise ZenoError("Element `belt` switches without end at t = 3 s.")
        return simulate(loop, **arguments)

    monkeypatch.setattr(module, "simulate", failing)
    assert main(["simulate", str(belt), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "slow belt\nfailed: Element `belt` switches without end" in printed and "\npushed\nTrajectory" in printed
    assert {path.name for path in out.iterdir()} == {
        "simulate.txt",
        "scene.toml",
        "origin.json",
        "02_pushed.npz",
        "02_pushed.csv",
        "02_pushed.png",
    }
    assert main(["simulate", str(belt), "--controller", "slow belt"]) == 1


def test_an_interrupted_simulation_leaves_nothing_behind(belt, tmp_path, capsys, monkeypatch):
    def interrupted(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(figures, "draw_found", interrupted)
    assert main(["simulate", str(belt), "--out", str(tmp_path / "out")]) == 130
    assert "nothing was written" in one_line(capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["belt.toml"]


def test_a_vector_state_has_one_column_per_entry_and_a_number_without_unit_no_brackets(root, tmp_path):
    scene = Scene.load(root / "studies" / "scenes" / "jansen_2.toml")
    run = scene.run("soft torque")
    table = columns(run.to_csv(tmp_path / "run.csv"))
    assert np.array_equal(table["chain.speed.1 [rad/s]"], table["bit.speed [rad/s]"])
    assert math.isfinite(table["top.torque [N m]"].max())
    assert {heading.partition(" ")[0] for heading in table} >= {name for name in run.names if run[name].ndim == 1}


@pytest.mark.usefixtures("no_figures")
def test_the_scene_of_a_run_that_ends_before_its_verdict_begins_can_be_read_again(belt, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where the report is written
    for duration, name in (("4", "short"), ("0", "none")):
        out = tmp_path / name
        assert main(["simulate", str(belt), "--duration", duration, "--out", str(out), "--quiet"]) == 0
        assert main(["report", str(out)]) == 0
    assert Scene.load(tmp_path / "short" / "scene.toml").duration == 4.0 and not (tmp_path / "none" / "scene.toml").exists()
