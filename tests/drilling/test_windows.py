"""The window of a well at its depths, against the borders that `onset` finds and the criterion of the pole at the border."""

from __future__ import annotations

import csv
import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import brentq

from controllers import PI, SoftTorque
from models import BitRock, wells
from toolbox import Sampled, SceneError, closed_loop, compose, margins, onset
from toolbox.drilling import windows
from toolbox.onsets.map_loop import NONE
from toolbox.steady_states.steady_loop import linear_loop

OVER = {"top.reference": ("30 rpm", "140 rpm"), "bit.weight": ("60 kN", "110 kN")}
LAW = PI(4_000.0, 1_500.0, reference="110 rpm")


def well(depth):
    """A string of two inertias whose stiffness falls with its length."""
    return compose(dataclasses.replace(wells.JANSEN_2, stiffness=(473.0 * 2000.0 / depth,)), BitRock(weight="90 kN"))


@pytest.fixture(scope="module")
def found():
    return windows(well, ("1 km", 2000.0), LAW, OVER, second_values=("70 kN", "90 kN"), shape=(9, 5))


@pytest.mark.slow
def test_the_window_of_a_depth_is_between_the_borders_that_onset_finds(found):
    for i, depth in enumerate((1000.0, 2000.0)):
        for j, weight in enumerate((70e3, 90e3)):
            one = onset(closed_loop(well(depth), LAW).at("bit.weight", weight), "top.reference", OVER["top.reference"], num_values=7)
            assert found.free_from[i, j] == pytest.approx(one.end, rel=0.02)
            assert found.smooth_from[i, j] == pytest.approx(one.loss, rel=0.02) and found.smooth_from[i, j] < found.free_from[i, j]
    assert (found.free_from[1] != found.free_from[0]).all()  # depth counts


def test_margins_are_those_of_the_working_point(found):
    point = 110 * math.pi / 30
    for i, depth in enumerate(found.depths):
        assert found.operating_points[i] == pytest.approx([point, 90e3])
        np.testing.assert_allclose(
            found.onset_margins[i], [(point - found.smooth_from[i, 1]) / point, (point - found.free_from[i, 1]) / point]
        )
        loop = closed_loop(well(depth), LAW)
        assert found.disk_margin[i] == margins(loop, by_simulation=False).disk_margin
        for part, stable in ((1.01, True), (0.97, False)):
            assert margins(loop.at("top.reference", float(found.smooth_from[i, 1]) * part), by_simulation=False).stable is stable


def test_a_range_that_is_free_and_one_without_a_window_are_told():
    quiet = windows(well, [2000.0], SoftTorque(reference=13.0), {**OVER, "top.reference": (12.0, 14.0)}, second_values=(7e4,), shape=(3, 3))
    assert quiet.free_from[0, 0] == quiet.smooth_from[0, 0] == -math.inf and (quiet.onset_margins == math.inf).all() and "all" in str(quiet)
    wild = windows(
        well, [2000.0], dataclasses.replace(LAW, reference=2.4), {**OVER, "top.reference": (2.0, 2.6)}, second_values=(1e5,), shape=(3, 3)
    )
    assert wild.free_from[0, 0] == wild.smooth_from[0, 0] == math.inf and (wild.onset_margins == -math.inf).all() and "none" in str(wild)


def test_the_table_the_file_and_the_picture_hold_the_same(found, tmp_path):
    rows = list(csv.DictReader(found.to_csv(tmp_path / "windows.csv").read_text().splitlines()))
    assert [float(row["depth [m]"]) for row in rows] == [1000.0, 1000.0, 2000.0, 2000.0]
    np.testing.assert_allclose([float(row["free from top.reference [rad/s]"]) for row in rows], found.free_from.ravel())
    text = str(found)
    assert "top.reference [rpm]" in text and "depth [km]" in text and f"{found.free_from[0, 1] * 30 / math.pi:.4g}" in text
    assert [found.first_low, found.first_high] == pytest.approx([math.pi, 140 * math.pi / 30]) and "between 30 and 140 rpm" in text
    axes = found.plot()
    assert len(axes) == 2 and axes[1].lines[1].get_xdata() == pytest.approx(found.free_from[1] * 30 / math.pi)
    assert [each.axes[0].size for each in found.severity_maps] == [9, 9]


def test_the_legend_fits_on_a_figure_as_wide_as_the_text_of_a_page(found):
    plt = pytest.importorskip("matplotlib.pyplot")
    figure, axes = plt.subplots(1, 2, figsize=(6.3, 3.0), layout="constrained")
    found.plot(axes)
    figure.canvas.draw()
    (legend,) = figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    assert words == ["free", "smooth only undisturbed", "smooth running is lost", "stick-slip ends", "working point"]
    box = legend.get_window_extent()
    assert 0.0 <= box.x0 < box.x1 <= figure.bbox.width


def test_a_point_of_the_map_that_nothing_decides_does_not_hide_the_border_beside_it():
    """At 4 rad/s a swing grows with a time constant of an hour, so that no run tells where it ends; its poles tell that smooth running is lost."""
    law, rig = Sampled(PI(reference=8.0), 0.01, 0.03), compose(wells.JANSEN_2, BitRock(weight=97_347.0))
    over = {"top.reference": (3.0, 5.0), "bit.weight": (60e3, 138e3)}
    found = windows(lambda depth: rig, [2000.0], law, over, second_values=[99e3], shape=(3, 3))
    loop = closed_loop(rig, law).at("bit.weight", 99e3)

    def grows(reference):
        poles = np.abs(linear_loop(loop.at("top.reference", reference)).poles())
        return np.log(np.max(poles[np.abs(poles - 1.0) > 1e-9]))

    assert found.severity_maps[0].smooth.verdict[1, 1] == NONE and found.severity_maps[0].growth[1, 1] > 0.0
    assert found.smooth_from[0, 0] == pytest.approx(
        brentq(grows, 3.0, 5.0), abs=0.1 * found.severity_maps[0].resolution
    )  # of a cell of 1 rad/s


def test_mistakes_are_told():
    with pytest.raises(SceneError, match="at least one depth"):
        windows(well, [], LAW, OVER)
    with pytest.raises(SceneError, match="`second_values` must be"):
        windows(well, [2000.0], SoftTorque(reference=13.0), {**OVER, "top.reference": (12.0, 14.0)}, second_values=("7 kN",), shape=(2, 2))
    with pytest.raises(SceneError, match="or a loop without laws, but at 2000 m"):
        windows(lambda depth: closed_loop(well(depth), LAW), [2000.0], LAW, OVER)
