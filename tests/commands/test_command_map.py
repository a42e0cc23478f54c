"""`stickslip map` of brakes: one command for every scene, and what is left with friction that is off."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from toolbox.commands.command_line import main
from toolbox.commands.sweep import _left_of
from toolbox.errors import NoSteadyState
from toolbox.onsets.severity_map import SeverityMap

SCENES = Path(__file__).parents[2] / "studies" / "scenes"
GROAN = ["--law", "HeldSpeed", "--range", "disc.reference=0.2:5", "--range", "brake.force=0.2kN:3kN", "--shape", "4x3"]


@pytest.mark.parametrize(("scene", "more"), [("brake_stop", []), ("creep_groan", []), ("brake_laws", ["--hold", "pad.attachment=0"])])
def test_groan_of_every_brake_scene_is_mapped_by_one_command(scene, more, tmp_path, capsys):
    assert main(["map", str(SCENES / f"{scene}.toml"), *GROAN, *more, "--out", str(tmp_path)]) == 0
    assert "smooth running is lost" in capsys.readouterr().out
    found = SeverityMap.load(tmp_path / "01_heldspeed" / "map.npz")
    free = found.regions["free"]
    assert free[-1, 0] and not free[0, -1]  # fast and light is free, slow and hard is not


def test_friction_that_is_off_leaves_what_is_free_on_every_machine(tmp_path, capsys):
    off = ["--uncertainty", "pad.friction.static,pad.friction.kinetic=20%"]
    assert main(["map", str(SCENES / "brake_stop.toml"), *GROAN, *off, "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    free = [
        SeverityMap.load(tmp_path / name / "map.npz").regions["free"]
        for name in ("01_heldspeed", "01_heldspeed_less20", "01_heldspeed_more20")
    ]
    told = [line.strip() for line in text.partition("Share of the map that is free")[2].splitlines() if line.endswith("%")]
    lines = dict(line.rsplit("  ", 1) for line in told)
    shares = {words.strip(): float(share.split()[0]) for words, share in lines.items()}
    assert shares["nominal"] == pytest.approx(100 * free[0].mean(), abs=0.05)
    assert shares["on all of them"] == pytest.approx(100 * np.logical_and.reduce(free).mean(), abs=0.05)
    assert free[1].sum() >= free[0].sum() >= free[2].sum()


@pytest.mark.parametrize(
    ("more", "word"),
    [
        (["--uncertainty", "pad.friction.static"], "NAME[,NAME...]=PART"),
        (["--uncertainty", "pad.friction.static=200%"], "--uncertainty` must be > 0 and < 1"),
        (["--uncertainty", "pad.frictoin.static=20%"], "pad.friction.static"),
        (["--hold", "pad.attachment"], "must be NAME=VALUE"),
        (["--law", "HeldSped"], "did you mean `HeldSpeed`"),
    ],
)
def test_mistakes_of_a_map_of_groan_are_told(more, word, tmp_path, capsys):
    assert main(["map", str(SCENES / "brake_stop.toml"), *GROAN, *more, "--out", str(tmp_path)]) != 0
    assert word in capsys.readouterr().err


def test_a_folder_that_cannot_be_written_is_told_before_a_controller_that_has_none_of_the_numbers(tmp_path, capsys):
    call = [
        "map",
        str(SCENES / "jansen_2.toml"),
        "--range",
        "top.reference=3:14",
        "--range",
        "bit.weight=50kN:110kN",
        "--shape",
        "2x2",
        "--out",
    ]
    (tmp_path / "file").write_text("")
    assert main([*call, str(tmp_path / "file" / "out")]) == 2  # the first controller is a constant torque, without a set-point
    assert "`--out` must be a folder that can be written" in capsys.readouterr().err
    assert main([*call, str(tmp_path / "out"), "--controller", "constant torque"]) == 2
    assert "no number `top.reference`" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_an_input_that_varies_in_time_is_refused_with_the_option_that_holds_it(tmp_path, capsys):
    assert main(["map", str(SCENES / "brake_laws.toml"), *GROAN, "--out", str(tmp_path / "groan")]) == 2
    assert "`--hold pad.attachment=VALUE`" in capsys.readouterr().err and not (tmp_path / "groan").exists()


def without_steady_state(*arguments, **options):
    raise NoSteadyState("There is no steady state.")


def test_a_map_that_finds_nothing_names_no_folder_and_leaves_none(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("toolbox.onsets.severity_map.severity_map", without_steady_state)
    assert main(["map", str(SCENES / "brake_stop.toml"), *GROAN, "--out", str(tmp_path / "groan")]) == 1
    out = capsys.readouterr().out
    assert "There is no steady state." in out
    assert "are in" not in out and not (tmp_path / "groan").exists()


@pytest.mark.parametrize(
    ("command", "search", "more"),
    [("onset", "toolbox.onsets.onset.onset", ["--range", "bit.weight=50kN:110kN"]), ("margins", "toolbox.robustness.margins.margins", [])],
)
def test_a_command_that_finds_nothing_names_only_the_files_that_it_writes(command, search, more, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(search, without_steady_state)
    call = [command, str(SCENES / "jansen_2.toml"), *more, "--controller", "stiff PI", "--out", str(tmp_path / "out")]
    assert main(call) == 1
    assert f"The report is in {tmp_path / 'out'}" in capsys.readouterr().out
    assert not [path for path in (tmp_path / "out").iterdir() if path.suffix in (".png", ".csv", ".npz")]


def test_many_numbers_that_are_off_make_no_wide_table():
    names = [f"pad.friction.coefficients.{i}" for i in range(12)]
    free = {"": np.array([True, True]), "-20 %": np.array([True, False]), "+20 %": np.array([False, True])}
    text = _left_of({words: SimpleNamespace(regions={"free": where}) for words, where in free.items()}, names)
    assert max(map(len, text.splitlines())) <= 100
    assert [line.split() for line in text.splitlines()[1:5]] == [
        ["nominal", "100.0", "%"], ["-20", "%", "50.0", "%"], ["+20", "%", "50.0", "%"], ["on", "all", "of", "them", "0.0", "%"],
    ]  # fmt: skip
    assert text.replace("\n", " ").endswith("Off together: " + ", ".join(names))
