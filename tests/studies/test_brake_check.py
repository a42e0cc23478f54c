"""The simulation in C that confirms the brake table: the table of the documentation stands in it."""

from __future__ import annotations

import re
import shutil

import pytest

from studies.questions import brake_check as study

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="the plant is compiled with `cc`, which is not here")


def cells(root, label):
    """The three distances of a row of the table: friction 20 % lower, nominal, 20 % higher."""
    text = (root / "docs" / "concepts" / "brakes_and_dither.md").read_text(encoding="utf-8")
    line = next(line for line in text.splitlines() if line.startswith(label + "  "))
    return [float(each) for each in re.search(r"(\d+\.\d+) / (\d+\.\d+) / (\d+\.\d+)", line).groups()]


@pytest.mark.parametrize("label", [pytest.param(row, marks=pytest.mark.slow if row == "MPC" else ()) for row in study.ROWS])
def test_twelve_distances_of_the_table_are_those_of_a_simulation_in_c(root, label):
    for factor, told in zip((0.8, 1.0, 1.2), cells(root, label), strict=True):
        assert study.distance(label, factor) == pytest.approx(told, abs=0.1)
