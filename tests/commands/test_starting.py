"""The option `--start`: each text is the start that Python has under another name."""

import argparse
from pathlib import Path

import pytest

from toolbox import Scene, SceneError
from toolbox.commands import figures
from toolbox.commands.command_line import main
from toolbox.commands.starting import begun, start_given
from toolbox.drilling import AfterConnection
from toolbox.reports.folders import of_folder
from toolbox.robustness import FromRest, OwnStickSlip, SmoothRunning, TakenOver
from toolbox.simulation.trajectory import Trajectory

RIG = Path(__file__).parents[2] / "studies" / "scenes" / "jansen_2.toml"


@pytest.fixture(scope="module")
def scene():
    return Scene.load(RIG)


def test_each_text_is_a_start(scene):
    stiff = scene["stiff PI"].controllers[0]
    texts = {
        "smooth": SmoothRunning(), "rest": FromRest(), "rest:30s": FromRest(30.0), "own": OwnStickSlip(), "own:2": OwnStickSlip(2),
        "takeover:stiff PI": TakenOver(stiff, 8), "takeover:stiff PI:3": TakenOver(stiff, 3), "connection": AfterConnection(),
    }  # fmt: skip
    assert {text: start_given(argparse.Namespace(start=text), scene) for text in texts} == texts
    assert start_given(argparse.Namespace(start=None), scene) is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("smoth", "did you mean `smooth`"), ("takeover", "it is one of"), ("takeover:stif PI", "did you mean `stiff PI`"),
        ("own:two", "must end in a number of instants"), ("rest:30kN", "`ramp` must be in s"), ("own:0", "must be an integer >= 1"),
    ],
)  # fmt: skip
def test_a_text_that_is_none_is_refused_with_the_nearest(scene, text, words):
    with pytest.raises(SceneError, match=words):
        start_given(argparse.Namespace(start=text), scene)


def test_a_single_run_begins_where_python_begins_it(scene, tmp_path):
    given = ["--controller", "soft torque", "--start", "takeover:stiff PI", "--duration", "90", "--out", str(tmp_path / "run")]
    assert main(["simulate", str(RIG), *given]) == 0
    run = Trajectory.load(tmp_path / "run" / "01_soft_torque.npz")
    (start,) = TakenOver(scene["stiff PI"].controllers[0], 1).on(scene["soft torque"]).values
    for name in ("chain.twist", "chain.speed"):
        assert run[name][0] == pytest.approx(start[name], rel=1e-9)
    assert run["top.torque"][0] > 5000.0  # it takes over the torque, and does not begin at none
    assert "started from 1 phase(s) of the stick-slip under StiffPI" in (tmp_path / "run" / "simulate.txt").read_text()


def test_a_study_has_a_row_for_each_run_of_a_start_and_its_report_says_where_they_began(tmp_path, monkeypatch, capsys):
    for name in ("draw", "draw_comparison"):
        monkeypatch.setattr(figures, name, lambda *_: None)
    head, *cases = RIG.read_text().split("[[controllers]]")
    path = tmp_path / "two.toml"
    path.write_text("[[controllers]]".join([head, *(each for each in cases if "stiff PI" in each or "soft torque" in each)]))
    assert main(["study", str(path), "--start", "own:2", "--out", str(tmp_path / "study")]) == 0
    printed = capsys.readouterr().out
    rows = (tmp_path / "study" / "table.csv").read_text().splitlines()[1:]
    assert [row.split(",stick-slip,")[0].strip('"') for row in rows] == [f"stiff PI, start {k} of 2" for k in (1, 2)]
    assert "soft torque not run: no stick-slip of its own was found" in printed
    assert "started from 2 phase(s) of the loop's own stick-slip" in printed
    (section,) = of_folder(tmp_path / "study")
    assert "started from 2 phase(s) of the loop&#x27;s own stick-slip" in section.answer
    assert "started from 2 phase(s) of the loop's own stick-slip" in section.findings.situation


def test_the_times_of_a_scene_count_from_the_last_change_of_an_input_of_the_start(scene):
    (loop,), refused = (list(found.values()) for found in begun(scene, ["soft torque"], FromRest(30.0)))
    assert not refused and (loop.duration, loop.after) == (scene.duration + 30.0, scene.after + 30.0)
    loops, _ = begun(scene, ["soft torque"], AfterConnection())
    assert [each.duration - scene.duration for each in loops.values()] == [130.0, 140.0, 180.0]
    assert list(loops) == [f"soft torque, start {k} of 3" for k in (1, 2, 3)]


def test_an_onset_of_a_machine_whose_numbers_are_known_takes_no_start(capsys):
    assert main(["onset", str(RIG), "--range", "top.reference=3:9", "--start", "rest"]) == 2
    assert "`--start` must stand beside `--uncertainty`" in capsys.readouterr().err


def test_margins_take_a_start_beside_uncertainty_only(capsys):
    assert main(["margins", str(RIG), "--start", "own"]) == 2
    assert "`--start` must stand beside `--uncertainty`" in capsys.readouterr().err


def test_the_former_option_of_schedule_is_refused_with_the_new_one(capsys):
    with pytest.raises(SystemExit):
        main(["schedule", str(RIG), "--depths", "1km", "2km", "--initial-controller", "stiff PI"])
    assert "is now `--start`" in capsys.readouterr().err
