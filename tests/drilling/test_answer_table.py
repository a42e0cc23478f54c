"""The table of answers: its verdicts are those of single runs, and one situation has one verdict whoever is asked."""

from __future__ import annotations

import math

import numpy as np
import pytest

from controllers import SoftTorque, StiffPI
from models import BitRock, wells
from studies.questions.one_answer import well
from toolbox import Sampled, SceneError, closed_loop, compose, onset, simulate, worst_case
from toolbox.commands.command_line import main
from toolbox.drilling import Answers, answers
from toolbox.drilling.answer_table import Question
from toolbox.robustness import TakenOver

LIMITS = {"lowest_torque": 0.0, "highest_torque": 20e3}


@pytest.fixture(scope="module")
def loop():
    rig = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
    return closed_loop(rig, Sampled(SoftTorque(**LIMITS), "10 ms", delay="30 ms"), inputs={"top.reference": 7.0})


ASKED = {"phases": 2, "duration": 100.0, "title": "rig"}
SEARCHED = ASKED | {"bounds": (6.0, 9.0), "step": 0.5}


@pytest.fixture(scope="module")
def found(loop):
    return answers({"soft torque": loop}, StiffPI(), **ASKED)


@pytest.fixture(scope="module")
def searched(loop):
    return answers({"soft torque": loop}, StiffPI(), **SEARCHED)


def sticks(loop, after=400.0, duration=600.0):
    """Whether a loop sticks in the last 200 s of 600 s; a disturbance of its smooth running dies in 9 s."""
    return simulate(loop, duration).time_in("bit", "stick", after=after) > 0.0


def test_the_verdicts_are_those_of_long_runs(loop, found):
    own = found["soft torque"]
    starts = TakenOver(StiffPI(), 2).on(loop).values
    assert own.starts["takeover"].held == sum(not sticks(loop.replace(start=start)) for start in starts)
    assert own.starts["step"].passed == (not sticks(loop))
    ramp = loop.replace(inputs={"top.reference": ((0.0, 30.0), (0.14, 7.0))})
    assert own.starts["ramp"].passed == (not sticks(ramp))
    assert own.own_period == pytest.approx(7.3, abs=0.3)
    assert own.starts["connection"].runs == 3 and own.errors.runs == 4


def test_a_controller_that_makes_stick_slip_of_its_own_fails_if_the_initial_one_has_none_to_end():
    """At 13 rad/s the stiff drive is smooth; a soft torque that acts 500 ms late is not, a prompt one is."""
    rig = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
    loops = {delay: closed_loop(rig, Sampled(SoftTorque(reference=13.0, **LIMITS), "10 ms", delay=delay)) for delay in ("30 ms", "500 ms")}
    found = answers(loops, StiffPI(), phases=2, duration=100.0, uncertainty={})
    prompt, late = (found[delay].starts["takeover"] for delay in loops)
    assert prompt.passed and str(prompt) == "no stick-slip to end"
    assert not late.passed and str(late) == "fails, 1 of 1" and late.why.startswith("no stick-slip to end; ")
    for delay, loop in loops.items():
        assert worst_case(loop, 100.0, starts=TakenOver(StiffPI(), 2)).survives == found[delay].starts["takeover"].passed


def test_a_set_point_at_which_a_start_fails_again_far_above_is_found():
    """From rest this well holds from 9.0 to 11.4 rad/s, fails from 11.5 to 13.8, and holds above (`python -m studies one_answer`, well 28)."""
    question = Question(well(28, 0).loop, "top.reference", StiffPI(), 2, 200.0)
    assert question.counted("step", 10.0).passed and not question.counted("step", 12.0).passed
    assert question.lowest_from("step", 9.0, 15.0, 0.5) == 14.0


@pytest.mark.slow
def test_the_lowest_set_points_hold_and_the_ones_below_fail(loop, searched):
    own = searched["soft torque"]
    takeover = own.lowest["takeover"]
    assert 7.0 < takeover <= 8.5
    for speed, holds in ((takeover, True), (takeover - 0.5, False)):
        at = loop.at("top.reference", speed)
        assert worst_case(at, 200.0, starts=TakenOver(StiffPI(), 2)).survives == holds
    borders = onset(loop, "top.reference", (6.0, 9.0), num_values=9)
    assert own.own_end == pytest.approx(borders.end) and takeover <= own.own_end + 0.5


def test_the_text_names_every_start_and_the_situation(found, tmp_path):
    text = str(found)
    for words in (
        "takes over stick-slip",
        "from rest, step",
        "ramp 30 s",
        "after a connection",
        "one number off",
        "own stick-slip",
        "Holds for:",
    ):
        assert words in text
    assert "keeps sticking" in text and "its own exists beside" in text
    found.save(tmp_path / "answers.npz")
    again = Answers.load(tmp_path / "answers.npz")
    assert str(again) == text and again["soft torque"].lowest == found["soft torque"].lowest


@pytest.mark.slow
def test_the_lowest_set_points_are_printed_and_drawn(searched):
    assert "Lowest set-point [rad/s] (6 to 9, steps of 0.5)" in str(searched)
    assert searched.plot().get_xlabel().startswith("lowest set-point")


def test_a_search_goes_on_from_its_checkpoint(loop, found, tmp_path, monkeypatch):
    asked = ASKED | {"checkpoint": tmp_path / "known.jsonl"}
    assert str(answers({"soft torque": loop}, StiffPI(), **asked)) == str(found)
    monkeypatch.setattr("toolbox.drilling.answer_table.simulate", None)  # nothing is run again
    assert str(answers({"soft torque": loop}, StiffPI(), **asked)) == str(found)
    with pytest.raises(SceneError, match="phases"):
        answers({"soft torque": loop}, StiffPI(), **(asked | {"phases": 3}))


def test_a_controller_that_cannot_be_asked_does_not_lose_the_others(loop):
    broken = closed_loop(loop.plant, inputs={"top.torque": 9_000.0})  # without a set-point
    found = answers({"good": loop, "broken": broken}, StiffPI(), phases=1, duration=60.0)
    assert "good" in found.results and {*found.results, *found.failed} == {"good", "broken"}
    assert math.isnan(found["good"].own_end) and np.isfinite(found["good"].torque_peak)


def test_mistakes_are_told(loop):
    with pytest.raises(SceneError, match="at least one label"):
        answers({}, StiffPI())
    with pytest.raises(SceneError, match="no controller `hard`"):
        _ = Answers("", "", "", "", 0.0, (0.0, 1.0), 1.0, {}, {}, "")["hard"]


def test_the_command_searches_the_set_point_alone(root, capsys):
    scene = str(root / "studies/scenes/jansen_2.toml")
    assert main(["answer", scene, "--range", "bit.weight=60 kN:90 kN"]) == 2
    assert "the set-point `top.reference`, but it gives that of `bit.weight`" in capsys.readouterr().err
