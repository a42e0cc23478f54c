"""The verdict: one value, decided in one place from which amount on a contact sticks."""

import ast
from pathlib import Path

import numpy as np
import pytest

from toolbox.measuring.judge import STANDS, STICKS, Judged
from toolbox.measuring.sticks import SHORTEST, is_stick, stands
from toolbox.measuring.verdict import FREE, STICK_SLIP, SWING, Verdict, of_judged, of_quarters, of_sticks
from toolbox.scenes.verdict_table import _time_stuck

ROOT = Path(__file__).parents[2]

HOME = "toolbox/measuring/sticks.py"
"""The file that defines a stick: its begin and end, its time, and from which time in stick on a contact sticks."""

STATES = ("modelling", "stepping", "translation", "lanes", "contacts", "compilation", "simulation")
"""Rooms in which `sticks` is the mode of a contact at an instant, and no verdict on a run."""

TIMES = ("time_in", "stuck_ratio", "stays", "longest_stay")
"""Functions that give a time or a number of sticks."""


def is_of_stick(node: ast.AST) -> bool:
    """Whether an expression is a time or a number of sticks: a call of one of `TIMES`, or a name, an attribute or a key with `stuck` in it."""
    if isinstance(node, ast.Call):
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        return name in TIMES
    word = getattr(node, "id", None) or getattr(node, "attr", None)
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
        word = node.slice.value
    return isinstance(word, str) and "stuck" in word and not word.isupper()


def is_threshold(node: ast.AST) -> bool:
    """Whether an expression is a number, or a constant by its name."""
    return (isinstance(node, ast.Constant) and isinstance(node.value, (int, float))) or (isinstance(node, ast.Name) and node.id.isupper())


def thresholds(path: Path) -> list[int]:
    """Lines of a file on which a time or a number of sticks is compared with a threshold."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            if any(map(is_of_stick, sides)) and any(map(is_threshold, sides)):
                found.append(node.lineno)
    return found


def test_from_which_time_in_stick_on_a_contact_sticks_is_decided_in_one_place():
    """The rule: outside of `HOME`, no comparison has a time or a number of sticks on one side and a number or a constant on the other."""
    places = []
    for path in [each for room in ("toolbox", "models", "controllers") for each in sorted((ROOT / room).rglob("*.py"))]:
        name = path.relative_to(ROOT).as_posix()
        if name != HOME and name.split("/")[1] not in STATES:
            places += [f"{name}:{line}" for line in thresholds(path)]
    assert places == []


def sticks_of_its_own(text: str) -> list[int]:
    """Lines that read the time in stick of a run, or compare a mode before an event with "stick"."""
    found = []
    for node in ast.walk(ast.parse(text)):
        call = isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "time_in"
        release = isinstance(node, ast.Compare) and getattr(node.left, "attr", "") == "before"
        sides = node.args if call else node.comparators if release else []
        found += [node.lineno] if any(isinstance(each, ast.Constant) and each.value == "stick" for each in sides) else []
    return found


def test_begin_end_and_time_of_sticks_are_measured_in_one_place():
    places = []
    for path in [each for room in ("toolbox", "models", "controllers") for each in sorted((ROOT / room).rglob("*.py"))]:
        places += [f"{path.relative_to(ROOT)}:{line}" for line in sticks_of_its_own(path.read_text(encoding="utf-8"))]
    assert places == []
    assert sticks_of_its_own('run.time_in("bit", "stick", after=1.0)\n[e.time for e in run.events if e.before == "stick"]') == [1, 2]


def test_the_rule_finds_a_threshold(tmp_path):
    """The open twin: the rule names each form that stood in the project before."""
    forms = (
        'numbers["stuck"] > 0.0',
        'run.time_in("bit", "stick") == 0.0',
        "stuck >= ALL",
        "found.stuck_ratio > 0.1",
        "if stuck < 1: pass",
    )
    for text in forms:
        path = tmp_path / "other.py"
        path.write_text(text)
        assert thresholds(path) == [1], text


def test_a_touch_of_zero_speed_is_no_stick():
    assert not is_stick(0.0) and not is_stick(SHORTEST * 60.0, 60.0) and is_stick(1e-3, 60.0)
    assert is_stick(np.array([0.0, 0.2])).tolist() == [False, True]
    assert stands(1.0) and not stands(0.9)


@pytest.mark.parametrize("regime", [STICKS, STANDS])
def test_no_stick_slip_is_shown_with_no_time_in_stick(regime):
    """A run that the judge carries on into stick-slip did not stick in the time that is looked at: its word says so."""
    assert of_judged(Judged(regime, sticks=1), 0).endswith("later") and not of_judged(Judged(regime, sticks=1), 2).endswith("later")
    assert _time_stuck(0.001) == "0.001 s" and _time_stuck(0.0) == "0.00 s" and _time_stuck(12.0) == "12.00 s"
    assert of_sticks([(1.0, 1.001), (2.0, 2.001)], 0.0, 4.0) == "stick-slip"


def test_a_verdict_has_a_regime_a_tone_a_failure_and_a_reason():
    found = of_judged(Judged(STICKS, sticks=1, interval=2.0), 3)
    assert (found, found.regime, found.tone, found.failed, found.stick_slip) == ("stick-slip", STICKS, "bad", True, True)
    assert found.reason == "the same stick comes back every 2 s" and found.because("other").reason == "other"
    assert SWING.failed and not SWING.stick_slip and not FREE.failed and isinstance(STICK_SLIP, Verdict)


def test_a_run_that_ends_in_its_only_stick_has_not_recovered():
    assert of_sticks([(29.0, 30.0)], 10.0, 30.0).failed and not of_sticks([(12.0, 13.0)], 10.0, 30.0).failed


def test_quarters_tell_only_clear_runs():
    same = {
        "sticks_0": 3,
        "sticks_1": 3,
        "stuck_0": 4.0,
        "stuck_1": 4.0,
        "severity_0": 1.5,
        "severity_1": 1.5,
        "mean_0": 5.0,
        "mean_1": 5.0,
    }
    falls = same | {"sticks_0": 0, "sticks_1": 0, "stuck_0": 0.0, "stuck_1": 0.0, "severity_0": 0.4, "severity_1": 0.1}
    rows = [same, falls, same | {"stuck_0": 10.0, "stuck_1": 10.0}, falls | {"severity_1": 0.39}, same | {"stuck_1": 1.0}]
    found = of_quarters({name: np.array([float(row[name]) for row in rows]) for name in same}, 10.0, 1e-6)
    assert [each.tolist() for each in found] == [[0, 1, 0, 0, 0], [1, 0, 0, 0, 0], [0, 0, 1, 0, 0]]
