"""The command `stickslip tune`: from scenes to a report, a figure and scenes with the tuned law, whole or not at all."""

import csv

import pytest

from toolbox.commands.command_line import main
from toolbox.scenes.scene import Scene
from toolbox.tuning import search

RIG = """
title = "Two inertias, {weight} kN"
duration = "60 s"
reference = "95 rpm"
[[plant]]
part = "wells.JANSEN_2"
[[plant]]
part = "BitRock"
weight = "{weight} kN"
[[controllers]]
label = "constant torque"
inputs = {{ "top.torque" = "12 kN m" }}
[[controllers]]
label = "stiff PI"
law = "StiffPI"
"""


@pytest.fixture
def rigs(tmp_path):
    paths = [tmp_path / f"rig_{weight}.toml" for weight in (90, 100)]
    for path, weight in zip(paths, (90, 100), strict=True):
        path.write_text(RIG.format(weight=weight))
    return [str(path) for path in paths]


FREE = [
    "--controller",
    "stiff PI",
    "--range",
    "stiffpi.proportional=500:50e3",
    "--range",
    "stiffpi.integral=0.05:20 kN m/rad",
    "--objective",
    "severity",
]


def test_two_scenes_become_a_report_a_figure_the_points_and_scenes_with_the_tuned_law(rigs, tmp_path, capsys):
    out = tmp_path / "tuned"
    assert main(["tune", *rigs, *FREE, "--runs", "20", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    for word in ("StiffPI `stiff PI`", "worst of 2 scenes", "stiffpi.integral [kN m/rad]", "0.05 .. 20", "severity", "Two inertias, 90 kN"):
        assert word in printed
    assert {path.name for path in out.iterdir()} == {
        "tune.txt",
        "origin.json",
        "tune.png",
        "tune.npz",
        "trials.csv",
        "scene.toml",
        "tuned_rig_90.toml",
        "tuned_rig_100.toml",
    }
    assert (out / "tune.txt").read_text() in printed and (out / "tune.png").read_bytes().startswith(b"\x89PNG")
    with (out / "trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert float(rows[0]["stiffpi.proportional [N m s/rad]"]) == 2e4 and len(rows) <= 20
    best = min(rows, key=lambda row: float(row["severity"]))
    for weight in (90, 100):
        tuned = Scene.load(out / f"tuned_rig_{weight}.toml")
        assert tuned.labels == ["constant torque", "stiff PI", "stiff PI, tuned"]
        law = tuned.case("stiff PI, tuned").law
        assert (law.proportional, law.integral) == (
            float(best["stiffpi.proportional [N m s/rad]"]),
            float(best["stiffpi.integral [N m/rad]"]),
        )
        assert tuned.run("stiff PI").time_in("bit", "stick", after=30.0) > 1.0  # as given
        assert tuned.run("stiff PI, tuned").time_in("bit", "stick", after=30.0) == 0.0
    assert (out / "scene.toml").read_bytes() == (out / "tuned_rig_90.toml").read_bytes()  # of the first scene
    (out / "mine.txt").write_text("keep")
    assert main(["tune", rigs[0], *FREE, "--objective", "settling", "--runs", "20", "--out", str(out)]) == 0
    assert "Front of" in capsys.readouterr().out
    assert {path.name for path in out.iterdir()} == {
        "tune.txt", "origin.json", "tune.png", "tune.npz", "trials.csv", "scene.toml", "tuned_rig_90.toml", "mine.txt",
    }  # fmt: skip


def test_an_interrupted_tuning_says_how_to_go_on_and_does(rigs, tmp_path, capsys, monkeypatch):
    arguments = ["tune", rigs[0], *FREE, "--runs", "20", "--checkpoint", str(tmp_path / "points"), "--out", str(tmp_path / "out")]
    simulated, calls = search.simulate, []

    def killing(loop):
        calls.append(loop)
        if len(calls) == 9:
            raise KeyboardInterrupt
        return simulated(loop)

    monkeypatch.setattr(search, "simulate", killing)
    assert main(arguments) == 130
    assert "goes on from" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert main(arguments) == 0
    tried = (tmp_path / "out" / "trials.csv").read_text().count("\n") - 1
    assert len(calls) == tried + 1  # the point at which it was interrupted, twice
    assert main(["tune", rigs[1], *arguments[2:]]) == 2
    assert "same arguments" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (["--controller", "stiff"], "stiff PI"),
        (["--controller", "constant torque"], "has none"),
        (["--range", "stiffpi.proportonal=1:2"], "did you mean `stiffpi.proportional`"),
        (["--range", "stiffpi.proportional"], "NAME=LOW:HIGH"),
        (["--range", "stiffpi.proportional=3:4"], "twice"),
        (["--range", "stiffpi.highest_torque=1:2 rpm"], "highest_torque"),
        (["--range", "stiffpi.reference=2:1"], "low < high"),
        (["--objective", "severty"], "severity"),
        (["--runs", "2"], "runs"),
        (["--processes", "0"], "processes"),
    ],
)
def test_a_mistake_is_one_line_and_exit_code_2_and_leaves_no_folder(rigs, tmp_path, capsys, change, word):
    assert main(["tune", *rigs, *FREE, *change, "--out", str(tmp_path / "out")]) == 2
    text = capsys.readouterr().err
    assert word in text and text.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_two_processes_find_what_one_finds(rigs, tmp_path):
    tuned = []
    for processes in ("1", "2"):
        out = tmp_path / processes
        assert main(["tune", *rigs, *FREE, "--objective", "stuck", "--runs", "10", "--processes", processes, "--out", str(out)]) == 0
        tuned.append((out / "trials.csv").read_text())
    assert tuned[0] == tuned[1]


def test_where_no_point_has_an_objective_the_exit_code_is_1(rigs, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = [
        "--controller",
        "stiff PI",
        "--range",
        "stiffpi.proportional=20e3:21e3",
        "--objective",
        "settling",
        "--runs",
        "10",
        "--out",
        str(out),
    ]
    assert main(["tune", rigs[0], *arguments]) == 1  # no gain there lets it settle
    printed = capsys.readouterr()
    assert "Nothing was found" in printed.out and "found nothing" in printed.err
    assert {path.name for path in out.iterdir()} == {"tune.txt", "origin.json", "tune.npz", "trials.csv", "scene.toml"}


def test_the_help_shows_an_example(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["tune", "--help"])
    assert ended.value.code == 0
    printed = " ".join(capsys.readouterr().out.split())
    for word in ("example: stickslip tune", "--range NAME=LOW:HIGH", "--checkpoint FILE", "--aggregate {worst,mean}"):
        assert word in printed
