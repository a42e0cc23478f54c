"""The command `stickslip onset`: both borders for every controller of a scene, from file to report, figure and tables."""

import csv
import math
import re

import pytest

from models import oscillators
from toolbox.commands.command_line import main
from toolbox.commands.terminal import Ended
from toolbox.errors import UnusualValue
from toolbox.files.units import _WARNED as GIVEN  # only to begin anew
from toolbox.onsets.results import Onset

RIG = """
title = "Two inertias"
duration = "60 s"
reference = "95 rpm"
[[plant]]
part = "wells.JANSEN_2"
[[plant]]
part = "BitRock"
[[controllers]]
label = "constant torque"
inputs = { "top.torque" = "12 kN m" }
[[controllers]]
label = "stiff PI"
law = "StiffPI"
[[controllers]]
label = "soft torque"
law = "SoftTorque"
"""


@pytest.fixture
def rig(tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text(RIG)
    return str(path)


RANGE = ["--range", "top.reference=20 rpm:150 rpm", "--values", "4", "--tolerance", "1 rpm"]


@pytest.mark.slow
def test_a_scene_gives_both_borders_of_every_controller_that_has_the_parameter(rig, tmp_path, capsys):
    out = tmp_path / "borders"
    assert main(["onset", rig, *RANGE, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    for word in ("Hopf point", "existing stick-slip ends", "Margin", "Checked", "bistable", "constant torque failed", "from stick-slip"):
        assert word in printed
    tables = {f"{stem}_{table}" for stem in ("02_stiff_pi", "03_soft_torque") for table in ("onset.csv", "borders.csv", "onset.npz")}
    assert {path.name for path in out.iterdir()} == {"onset.png", "onset.txt", "scene.toml", "origin.json", *tables}
    assert (out / "onset.txt").read_text() in printed
    assert (out / "onset.png").read_bytes().startswith(b"\x89PNG")
    with (out / "02_stiff_pi_onset.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    speeds = [float(row["top.reference [rad/s]"]) for row in rows]
    assert speeds[0] == pytest.approx(20 * math.pi / 30) and speeds[-1] == pytest.approx(150 * math.pi / 30)
    assert rows[0]["smooth regime"] == "sticks and slips" and rows[-1]["sticking regime"] == "smooth"
    with (out / "02_stiff_pi_borders.csv").open(newline="") as file:
        borders = {row["border"]: row for row in csv.DictReader(file)}
    assert set(borders) == {"Hopf point", "smooth running is lost", "existing stick-slip ends"}
    assert borders["existing stick-slip ends"]["safe"] == "above" and borders["existing stick-slip ends"]["beyond"] == "smooth"
    assert float(borders["Hopf point"]["top.reference [rad/s]"]) == pytest.approx(4.3458, abs=1e-3)
    kept = Onset.load(out / "02_stiff_pi_onset.npz")
    assert kept.end == float(borders["existing stick-slip ends"]["top.reference [rad/s]"])
    # a second search takes the place of the first, and files of the user stay
    (out / "mine.txt").write_text("keep")
    assert main(["onset", rig, *RANGE, "--controller", "soft torque", "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {
        "onset.png",
        "onset.txt",
        "01_soft_torque_onset.csv",
        "01_soft_torque_borders.csv",
        "01_soft_torque_onset.npz",
        "scene.toml",
        "origin.json",
        "mine.txt",
    }


def test_the_printed_hopf_speed_is_that_of_the_closed_form(root, capsys):
    scene = root / "studies" / "scenes" / "veraszto_stepan.toml"
    assert main(["onset", str(scene), "--range", "block.belt_speed=0.1:400 mm/s", "--values", "3", "--tolerance", "0.02"]) == 0
    hopf = 1e-3 * float(re.search(r"Hopf point, hard loss +([0-9.]+) mm/s", capsys.readouterr().out)[1])  # answered as it was asked
    assert hopf == pytest.approx(oscillators.hopf_speed(oscillators.VERASZTO_STEPAN), rel=1e-5)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (["--range", "top.refrence=20 rpm:150 rpm"], "top.reference"),
        (["--range", "top.reference=200 rpm:150 rpm"], "LOW < HIGH"),
        (["--range", "top.reference=20 kN:150 rpm"], "--range"),
        (["--range", "top.reference=20 rpm:fast"], "--range"),
        (["--values", "1"], "values"),
        (["--controller", "softer"], "soft torque"),
    ],
)
def test_a_mistake_is_one_line_and_exit_code_2(rig, capsys, change, word):
    assert main(["onset", rig, *RANGE, "--controller", "stiff PI", *change]) == 2
    text = capsys.readouterr().err
    assert word in text and text.count("\n") == 1


def test_an_unknown_name_is_looked_for_under_every_controller(rig, capsys):
    # the law that comes first in the scene has no reference
    assert main(["onset", rig, "--range", "top.refrence=3:14"]) == 2
    assert "did you mean `top.reference`" in capsys.readouterr().err


def test_a_range_of_bare_numbers_that_was_meant_in_rpm_is_told(rig, capsys):
    GIVEN.clear()
    range_of_a_driller = ["--range", "top.reference=30:130", "--values", "3", "--controller", "stiff PI"]
    with pytest.warns(UnusualValue, match=r"`top.reference` is 130 rad/s, which is 1.24e\+03 rpm; .*Did you mean `130 rpm` = 13.6 rad/s"):
        assert main(["onset", rig, *range_of_a_driller]) == 0
    assert "top.reference from 30 to 130 rad/s" in capsys.readouterr().out


def test_where_no_controller_has_a_steady_state_the_exit_code_is_1(rig, capsys):
    # backwards torques below the bound turn nothing: there is no slipping steady state
    arguments = ["--range", "top.torque=100:200", "--controller", "constant torque", "--values", "3"]
    assert main(["onset", rig, *arguments]) == 1
    assert "no steady running" in capsys.readouterr().out


def test_an_interrupted_search_keeps_the_controllers_that_have_ended(rig, tmp_path, capsys, monkeypatch):
    """What has been simulated stays in the folder until all is written; another search there is refused, and nothing is lost."""
    out, call = (
        tmp_path / "borders",
        ["onset", rig, "--range", "top.reference=130 rpm:150 rpm", "--values", "3", "--out", str(tmp_path / "borders")],
    )

    def interrupted(each, label, own=Ended.__call__):
        own(each, label)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Ended, "__call__", interrupted)
        assert main(call) == 130
    told = capsys.readouterr().err
    assert re.search(r"stiff PI: 1 of 2 controllers ended after \d+ s, about \d+ s left\n", told) and "goes on" in told
    (kept,) = out.iterdir()
    assert kept.name == "02_stiff_pi_onset.jsonl"
    first = kept.read_bytes()
    assert main([*call, "--values", "4"]) == 2
    assert "Argument `--out` must come from a search with the same arguments" in capsys.readouterr().err and kept.read_bytes() == first
    assert main(call) == 0
    assert "soft torque: 2 of 2 controllers ended" in capsys.readouterr().err
    assert not list(out.glob("*.jsonl")) and (out / "03_soft_torque_onset.npz").exists()
