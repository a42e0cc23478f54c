"""The commands over the depth of a well: a scene whose string is made from a table knows it at every depth, and others are refused."""

import ctypes
import json
import shutil
import subprocess

import numpy as np
import pytest

from toolbox import Scene, SceneError
from toolbox.commands.command_line import main
from toolbox.drilling import Schedule, Windows

WELL = "studies/scenes/deepening_well.toml"


def test_the_string_of_a_scene_ends_at_the_depth_that_is_asked_for(root, tmp_path):
    declared, same, deep = (Scene.load(root / WELL, depth=depth).parts[0] for depth in (None, 2000.0, "4 km"))
    assert declared == same and declared.depth[-1] == pytest.approx(2000.0) and deep.depth[-1] == pytest.approx(4000.0)

    def softness(part):
        return sum(1.0 / k for k in part.stiffness)

    # what is below the drill pipe stays, so that the string is softer by the rigidity of the pipe alone
    shorter = Scene.load(root / WELL, depth=1000.0).parts[0]
    assert softness(deep) - softness(declared) == pytest.approx(2.0 * (softness(declared) - softness(shorter)), rel=1e-6)
    with pytest.raises(SceneError, match=r"`end_depth` must be > 200 m, but it is 150"):
        Scene.load(root / WELL, depth=150.0)
    Scene.load(root / WELL).save(tmp_path / "in_si.toml")
    with pytest.raises(SceneError, match=r"is known at one depth only, because none of its parts \(DrillString, BitRock\)"):
        Scene.load(tmp_path / "in_si.toml", depth=1000.0)


def test_the_schedule_is_that_of_the_verb_with_c_for_the_drive_and_the_report_reads_it(root, tmp_path, capsys):
    out = tmp_path / "gains"
    asked = ["schedule", str(root / WELL), "--controller", "soft torque", "--depths", "2 km", "2500m", "--duration", "20 s"]
    assert main([*asked, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    found = Schedule.load(out / "schedule.npz")
    assert str(found) in printed and found.depths == (2000.0, 2500.0) and [each.depth for each in found.checked] == [2000.0, 2250.0, 2500.0]
    law = Scene.load(root / WELL, depth=2500.0)["soft torque"].designed_controllers[0]
    assert found.gains_at(2500.0)["softtorque.integral"] == pytest.approx(law.integral, rel=1e-12)
    assert {each.name for each in out.iterdir()} == {
        "origin.json", "scene.toml", "drive.c", "drive.h", "drive_depth.c", *(f"schedule.{end}" for end in ("txt", "csv", "npz", "png")),
    }  # fmt: skip
    if shutil.which("cc"):
        subprocess.run(
            [
                "cc",
                "-shared",
                "-fPIC",
                *(str(out / name) for name in ("drive.c", "drive_depth.c")),
                "-lm",
                "-o",
                str(tmp_path / "drive.so"),
            ],
            check=True,
        )
        gains = np.zeros(64)
        ctypes.CDLL(str(tmp_path / "drive.so")).drive_gains_at(ctypes.c_double(2250.0), gains.ctypes.data_as(ctypes.c_void_p))
        assert found.gains_at(2250.0)["softtorque.integral"] in gains
    assert main(["report", str(out), "--page", str(tmp_path / "page.html")]) == 0
    assert "Gains over depth" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_a_continuous_law_has_a_schedule_without_c(root, tmp_path, capsys):
    out = tmp_path / "gains"
    asked = ["schedule", str(root / WELL), "--controller", "stiff PI", "--depths", "2000", "2500", "--duration", "5 s"]
    assert main([*asked, "--out", str(out)]) == 0
    assert "There is no C of a continuous law" in capsys.readouterr().out
    assert main([*asked, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["depths"] == [2000.0, 2500.0] and len(told["checked"]) == 3
    assert not (out / "drive.c").exists() and (out / "schedule.csv").is_file()


def test_the_windows_are_those_of_the_verb_and_the_report_reads_them(root, tmp_path, capsys):
    out = tmp_path / "windows"
    over = ["--range", "top.reference=60 rpm:140 rpm", "--range", "bit.weight=60 kN:100 kN"]
    asked = ["windows", str(root / WELL), "--controller", "stiff PI", "--depths", "2km", *over, "--along", "80 kN", "--shape", "5x3"]
    assert main([*asked, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    found = Windows.load(out / "windows.npz")
    assert (
        str(found) in printed
        and found.depths == (2000.0,)
        and found.second_values.tolist() == [80_000.0]
        and (found.smooth_from <= found.free_from).all()
    )
    assert {each.name for each in out.iterdir()} == {
        "origin.json",
        "scene.toml",
        "2000m",  # its map, and what each run came to, with which windows go on
        *(f"windows.{end}" for end in ("txt", "csv", "npz", "png")),
    }
    runs, text = out / "2000m" / "runs.jsonl", (out / "windows.txt").read_text(encoding="utf-8")
    lines = runs.read_text(encoding="utf-8").splitlines(keepends=True)
    runs.write_text("".join(lines[:-4]), encoding="utf-8")  # as an interrupt leaves it
    assert main([*asked, "--out", str(out)]) == 0
    again = runs.read_text(encoding="utf-8").splitlines(keepends=True)
    assert again[: len(lines) - 4] == lines[:-4] and len(again) == len(lines)
    assert (out / "windows.txt").read_text(encoding="utf-8") == text
    assert main(["report", str(out), "--page", str(tmp_path / "page.html")]) == 0
    assert "Windows over depth" in (tmp_path / "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("command", ["schedule", "windows"])
def test_a_number_of_the_law_that_the_scene_gives_as_an_input_is_refused_by_its_name(root, tmp_path, capsys, command):
    shutil.copy((root / WELL).with_suffix(".csv"), tmp_path)
    (tmp_path / "given.toml").write_text((root / WELL).read_text() + '\n[inputs]\n"top.reference" = "110 rpm"\n')
    axes = ["--range", "top.reference=90 rpm:150 rpm", "--range", "bit.weight=60 kN:100 kN"] if command == "windows" else []
    assert main([command, str(tmp_path / "given.toml"), "--depths", "1km", "2km", *axes]) == 2
    assert "Argument `top.reference` must be a number of the law itself" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["studies/scenes/jansen_2.toml", "--depths", "1km", "2km"],
            "known at one depth only, because none of its parts (wells.JANSEN_2, BitRock)",
        ),
        ([WELL, "--depths", "1km"], "`--depths` must hold at least two rising depths"),
        ([WELL, "--depths", "100m", "2km"], "`end_depth` must be > 200 m"),
        ([WELL, "--depths", "1km", "2km", "--start", "takeover:stif PI"], "did you mean `stiff PI`"),
        ([WELL, "--depths", "1km", "2 kN"], "`depths.1` must be in m, but `2 kN` is in kN"),
        ([WELL, "--depths", "1km", "2km", "--duration", "0"], "`--duration` must be > 0 s"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(root, arguments, words, capsys):
    assert main(["schedule", str(root / arguments[0]), *arguments[1:]]) == 2
    told = capsys.readouterr().err
    assert words in told and told.count("\n") == 1
