"""The simulation that repeats verdicts on drawn wells: it agrees with the event loop, does not depend on its step, and its comparison tells every mistake."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from studies.questions import one_answer as study

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="the C is compiled with `cc`, which is not here")


@pytest.mark.parametrize("situation", study.SITUATIONS)
def test_both_sides_of_a_border_are_told_alike_with_a_finer_step_too(situation):
    one = study.well(14, 0)
    border, above = study.border_of(one.loop, situation)
    assert above and 2.0 < border < 8.0
    for value, free in ((border + study.STEP, True), (border - study.STEP, False)):
        assert study.said(one.loop, situation, value) == free
        assert (study.in_c(one, situation, value) == study.FREE) == (study.in_c(one, situation, value, step=1e-3) == study.FREE) == free


@pytest.mark.parametrize("number", range(12))
def test_a_controller_has_the_gains_that_the_toolbox_designs(number):
    one = study.well(number, 3)
    (law,) = one.loop.designed_controllers
    law = getattr(law, "law", law)
    if one.kind == "Z-torque":
        found = [law.impedance, law.integral, law.inertia, law.filter_time, law.back_calculation]
        np.testing.assert_allclose(one.drive[2:7], found, rtol=1e-12)
    else:
        np.testing.assert_allclose(one.drive[2:4], [law.proportional, law.integral], rtol=1e-12)


FREE, STICKS, UNDECIDED = 1, 2, 0


@pytest.mark.parametrize(
    ("sides", "told"),
    [
        ([FREE, STICKS], "within 0.1 rad/s"), ([STICKS, STICKS], "said free but sticks"), ([FREE, FREE], "said sticks but free"),
        ([STICKS, FREE], "said free but sticks"), ([UNDECIDED, STICKS], "undecided"),
    ],
)  # fmt: skip
def test_a_border_that_does_not_stand_is_told_by_the_kind_of_the_mistake(sides, told):
    found = {"border": 5.0, "sides": sides, "again": 9.0, "verdicts": [[4.0, True, STICKS], [6.0, None, FREE], [7.0, False, FREE]]}
    assert list(study.told_of(found)) == [
        ("border", told), ("above", "said free but sticks"), ("verdict", "said free but sticks"), ("verdict", "undecided"),
        ("verdict", "said sticks but free"),
    ]  # fmt: skip


def test_a_call_goes_on_from_its_folder(tmp_path, capsys, monkeypatch):
    asked = ["--count", "1", "--first", "3", "--situations", "rest", "--out", str(tmp_path)]
    study.main(asked)
    printed = capsys.readouterr().out
    assert "rest    verdict  same                        3" in printed
    monkeypatch.setattr(study, "examined", None)  # nothing is examined again
    study.main(asked)
    assert capsys.readouterr().out == printed
