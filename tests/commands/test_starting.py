"""The option `--start`: each text is the start that Python has under another name."""

import argparse
from pathlib import Path

import pytest

from toolbox import Scene, SceneError
from toolbox.commands.command_line import main
from toolbox.commands.starting import start_given
from toolbox.drilling import AfterConnection
from toolbox.robustness import FromRest, OwnStickSlip, SmoothRunning, TakenOver

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


def test_margins_take_a_start_beside_uncertainty_only(capsys):
    assert main(["margins", str(RIG), "--start", "own"]) == 2
    assert "`--start` must stand beside `--uncertainty`" in capsys.readouterr().err


def test_the_former_option_of_schedule_is_refused_with_the_new_one(capsys):
    with pytest.raises(SystemExit):
        main(["schedule", str(RIG), "--depths", "1km", "2km", "--initial-controller", "stiff PI"])
    assert "is now `--start`" in capsys.readouterr().err
