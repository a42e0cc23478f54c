"""`--law` and `--hold`: a scene under another law, and under other inputs, than its own, by every command that looks at its cases."""

from __future__ import annotations

import csv
import math
from argparse import Namespace
from pathlib import Path

import pytest

from toolbox.commands.command_line import main
from toolbox.commands.terminal import otherwise
from toolbox.errors import SceneError
from toolbox.scenes.scene import Scene

SCENES = Path(__file__).parents[2] / "studies" / "scenes"
BRAKE = str(SCENES / "brake_stop.toml")


def asked(name, law=None, hold=()):
    return otherwise(Scene.load(SCENES / f"{name}.toml"), Namespace(law=law, hold=hold))


def test_a_study_of_a_stop_under_a_law_that_holds_the_speed_judges_steady_running(tmp_path, capsys):
    assert main(["study", BRAKE, "--law", "HeldSpeed", "--out", str(tmp_path)]) == 0
    (row,) = csv.DictReader((tmp_path / "table.csv").read_text().splitlines())
    assert (row["controller"], row["verdict"]) == ("HeldSpeed", "stick-slip")  # it groans at 1 rad/s
    assert Scene.load(tmp_path / "scene.toml").standstill_speed is None


def test_the_law_runs_at_the_set_point_of_the_scene():
    (case,) = asked("navarro_lopez_4", "SoftTorque").cases
    assert case.law.reference == pytest.approx(45 * math.pi / 30)  # its own is 95 rpm


def test_what_is_asked_is_what_a_scene_with_the_law_and_the_input_says(tmp_path):
    own = tmp_path / "held.toml"
    text = Path(BRAKE).read_text().replace('standstill_speed = "0.1 rad/s"\n', "")
    own.write_text(text + '[inputs]\n"brake.force" = "1.2 kN"\n[[controllers]]\nlabel = "HeldSpeed"\nlaw = "HeldSpeed"\n')
    found, written = asked("brake_stop", "HeldSpeed", ["brake.force=1.2 kN"]), Scene.load(own)
    assert found == written and found.display_units == written.display_units  # in the unit that was typed


def test_an_input_that_only_a_later_law_asks_for_may_be_held():
    assert asked("navarro_lopez_4").cases[0].law is None
    held = asked("navarro_lopez_4", hold=["top.reference=120 rpm"])
    assert held.inputs["top.reference"] == pytest.approx(4 * math.pi) and held.display_units["rad/s"] == "rpm"


@pytest.mark.parametrize("law", ["BrakePI", "BrakeMPC"])
def test_a_law_that_is_sampled_only_is_refused_with_where_its_sample_time_is_said(law):
    with pytest.raises(SceneError, match=f"Law `{law}` has no continuous form: name it in the scene, under .*, with its `sample_time`"):
        asked("brake_stop", law)


@pytest.mark.parametrize("law", ["StiffPI", "SoftTorque", "ZTorque", "SlidingMode", "IdealSlidingMode", "ActiveDamping", "LQR"])
def test_laws_with_a_continuous_form_run(law):
    assert asked("jansen_2", law).labels == [law]


def test_a_body_with_many_contacts_has_no_law_of_its_own(capsys):
    assert main(["simulate", str(SCENES / "elastic_face.toml"), "--law", "HeldSpeed"]) == 2
    assert "Argument --law must be left out" in capsys.readouterr().err
    assert main(["simulate", str(SCENES / "elastic_face.toml"), "--hold", "a=1"]) == 2
    assert "Argument --hold must be left out" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["study", "simulate", "onset", "sweep", "map", "chance", "basin", "margins"])
def test_a_law_that_does_not_exist_is_told_by_every_command(command, tmp_path, capsys):
    words = {
        "onset": ["--range", "disc.reference=2:4"],
        "sweep": ["--range", "disc.reference=2:4:2"],
        "map": ["--range", "disc.reference=2:4", "--range", "brake.force=1:2"],
        "chance": ["--range", "disc.reference=2:4:2"],
        "basin": ["--range", "disc.speed=2:4"],
    }
    assert main([command, BRAKE, "--law", "HeldSped", *words.get(command, []), "--out", str(tmp_path / "out")]) == 2
    assert "did you mean `HeldSpeed`" in capsys.readouterr().err
