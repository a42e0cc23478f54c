"""All ways to a border agree: exact ones, runs of an hour, and runs that were cut."""

from __future__ import annotations

import math

import pytest

from studies.questions import agreement as study

WELLS = list(study.drawn(12, 1))


def check(case, held):
    found = study.row(case)
    assert found["by runs"] < 1e-3 and found["cut"] < 1e-9 and found["held"] <= held
    for way in ("exact", "follow"):
        assert math.isnan(found[way]) or found[way] < 1e-6
    return found


@pytest.mark.parametrize("number", [0, 5], ids=["PI, continuous", "super-twisting"])
def test_borders_of_the_rig_agree_by_all_ways(number):
    found = check(study.LAWS[number], 0.005)
    assert math.isnan(found["follow"]) == (number == 5) == math.isnan(found["exact"])


@pytest.mark.slow
@pytest.mark.parametrize(("number", "held"), [(8, 0.02), (9, 0.01)], ids=["Python", "linear MPC"])
def test_borders_of_laws_in_python_agree(number, held):
    assert math.isnan(check(study.LAWS[number], held)["exact"])


@pytest.mark.slow
@pytest.mark.parametrize("number", [3, 9, 11], ids=["three cycles", "a corner", "friction along the string"])
def test_borders_of_wells_drawn_at_random_agree(number):
    """Well 3 has three stick-slip cycles; that of well 9 ends where its stick shrinks to nothing, and steps of the set-point shake it off long before."""
    check(WELLS[number], 0.005)
