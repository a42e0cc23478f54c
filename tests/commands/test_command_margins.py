"""The command `stickslip margins`: the numbers of the verbs, in files and on the terminal."""

import pytest

from toolbox import Scene, margins
from toolbox.commands.command_line import main
from toolbox.robustness import Margins, SmallestError

JANSEN = "studies/scenes/jansen_2.toml"


def test_margins_and_the_smallest_error_are_those_of_the_verbs(root, tmp_path, capsys):
    out = tmp_path / "robust"
    asked = ["margins", str(root / JANSEN), "--controller", "softer PI, 100 Hz"]
    assert main([*asked, "--uncertainty", "top.reference=60 rpm:100 rpm", "--duration", "80", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    loop = Scene.load(root / JANSEN)["softer PI, 100 Hz"]
    assert Margins.load(out / "03_softer_pi_100_hz_margins.npz").loop_margins == margins(loop).loop_margins
    error = SmallestError.load(out / "03_softer_pi_100_hz_error.npz")
    assert str(error) in printed and error.size < 1.0 and 60 < error.parameters[0].value(error.error[0]) * 9.5493 < 95
    assert {each.name for each in out.iterdir()} == {
        "margins.txt", "scene.toml", "origin.json", *(f"03_softer_pi_100_hz_{what}.{end}" for what in ("margins", "error") for end in ("npz", "csv", "png")),
    }  # fmt: skip
    assert main(["report", str(out), "--page", str(tmp_path / "page.html")]) == 0
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "softer PI, 100 Hz, margins" in page and "softer PI, 100 Hz, smallest error that breaks it" in page


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--uncertainty", "bit.weight"], "`--uncertainty` must be NAME=20% or NAME=LOW:HIGH, but it is `bit.weight`"),
        (["--uncertainty", "bit.weight=20%", "--uncertainty", "bit.weight=10%"], "`--uncertainty` must name every number once"),
        (["--uncertainty", "bit.wight=20%"], "did you mean `bit.weight`"),
        (["--uncertainty", "bit.weight=120%"], "`--uncertainty`"),
        (["--duration", "3 s"], "`--duration` must stand beside `--uncertainty`"),
        (["--controller", "constant torque"], "must contain a controller"),
        (["--hold", "bit.weight"], "`--hold` must be NAME=VALUE"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(root, arguments, words, capsys):
    assert main(["margins", str(root / JANSEN), *arguments]) == 2
    told = capsys.readouterr().err
    assert words in told and told.count("\n") == 1


def test_a_scene_without_a_law_has_no_margins_and_one_with_moving_inputs_has_them_where_these_are_held(root, capsys):
    assert main(["margins", str(root / "studies/scenes/block_on_belt.toml")]) == 2
    assert "`SCENE.toml` must have a controller" in capsys.readouterr().err
    asked = ["margins", str(root / "studies/scenes/navarro_lopez_4.toml"), "--controller", "soft torque"]
    assert main(asked) == 2
    assert "must be a number for a linear loop" in capsys.readouterr().err
    assert main([*asked, "--hold", "top.reference=120 rpm"]) == 0
    assert "at top.reference = 120 rpm" in capsys.readouterr().out
