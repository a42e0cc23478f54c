"""Borders of machines that are drawn: against one border halved by hand, order statistics, and what makes no sense."""

import math

import numpy as np
import pytest

from controllers import SoftTorque, StiffPI
from models import BitRock, wells
from toolbox import SceneError, closed_loop, compose, hopf_points
from toolbox.probability import UncertainOnset, Uniform, chance, uncertain_onset

RIG = compose(wells.JANSEN_2, BitRock(weight=97e3))
BETWEEN = (3.0, 16.0)
KNOWN = {"bit.weight": "97 kN +- 5 kN", "bit.friction.static": Uniform(0.7, 0.8)}


@pytest.fixture(scope="module")
def found():
    laws = {"stiff PI": closed_loop(RIG, StiffPI()), "soft torque": closed_loop(RIG, SoftTorque())}
    return uncertain_onset(laws, "top.reference", ("3 rad/s", 16.0), KNOWN, draws=80, num_values=7, tolerance=0.25)


def test_a_machine_is_free_at_its_border_and_sticks_below_it(found):
    loop, border = closed_loop(RIG, StiffPI()), found.onset_values["stiff PI"]
    inside = np.flatnonzero(np.isfinite(border))[:3]
    for k in inside.tolist():
        each = loop
        for name, value in zip(found.names, found.points[k].tolist(), strict=True):
            each = each.at(name, value)
        near = [border[k] - found.tolerance, border[k]]
        told = chance(each, {"top.reference": near}, {"chain.bit_drag": "50 +- 0.001"}, draws=1).chances["as it is"]
        assert told.tolist() == [1.0, 0.0]
        assert found.smooth_running_limits["stiff PI"][k] == pytest.approx(hopf_points(each, "top.reference", BETWEEN)[-1].value, rel=1e-6)


def test_the_lowest_set_point_is_passed_by_as_few_machines_as_the_bound_allows(found):
    lowest = found.lowest(0.9)
    for label, borders in found.onset_values.items():
        assert (
            (borders > lowest[label]).sum() <= 2 < (borders >= lowest[label]).sum()
        )  # of 80 draws two: the bound is 0.0874, with three 0.1057
    assert lowest["soft torque"] < lowest["stiff PI"]


def test_what_moves_the_border_is_told(found):
    moved = found.moved_by("stiff PI")
    assert list(moved) == ["bit.friction.static", "bit.weight"] and moved["bit.friction.static"] > 0.8


def test_borders_print_draw_and_go_to_a_file(found, tmp_path):
    again = UncertainOnset.load(found.save(tmp_path / "found.npz"))
    assert str(again) == str(found) and "free with 95 % from [rad/s]" in str(found)
    assert len(found.save(tmp_path / "found.csv").read_text().splitlines()) == 81
    assert found.plot().get_xlabel() == "top reference [rad/s]"


def test_a_machine_that_is_free_everywhere_or_nowhere_is_told():
    loop = closed_loop(RIG, StiffPI())
    free = uncertain_onset(loop, "top.reference", (25.0, 30.0), KNOWN, draws=4, num_values=3)
    assert (free.onset_values["as it is"] == -math.inf).all() and "below" in str(free) and "by fewer than 72 draws" in str(free)
    never = uncertain_onset(loop, "top.reference", (3.0, 4.0), KNOWN, draws=4, num_values=3)
    assert (never.onset_values["as it is"] == math.inf).all() and "none" in str(never)


def test_what_makes_no_sense_is_refused(found):
    loop = closed_loop(RIG, StiffPI())
    with pytest.raises(SceneError, match="takes at least 72 draws"):
        uncertain_onset(loop, "top.reference", (25.0, 30.0), KNOWN, draws=2, num_values=3).lowest()
    with pytest.raises(SceneError, match="must not name what is varied"):
        uncertain_onset(loop, "bit.weight", (70e3, 90e3), KNOWN)
