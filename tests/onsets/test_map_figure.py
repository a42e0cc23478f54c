"""The picture of a severity map: what is shaded is what its borders enclose, and its legend says what each region means."""

from __future__ import annotations

import matplotlib
import numpy as np
import pytest
from matplotlib.collections import QuadMesh

from toolbox.onsets import SeverityMap
from toolbox.onsets.borders import border
from toolbox.onsets.figures import _words
from toolbox.onsets.map_loop import NONE, SMOOTH, STICK_SLIP, STUCK, SWING
from toolbox.onsets.regions import MEANINGS, outlines
from toolbox.onsets.severity_map import MapSide

AXES = (np.linspace(3.0, 14.0, 12), np.linspace(50e3, 110e3, 9))


def area(polygons):
    return sum(0.5 * abs(np.dot(p[:, 0], np.roll(p[:, 1], 1)) - np.dot(p[:, 1], np.roll(p[:, 0], 1))) for p in polygons)


def below(slope, at):
    """Whether points lie left of the straight line x = at + slope (y - 80 kN)."""
    return lambda points: points[:, 0] < at + slope * (points[:, 1] - 80e3)


def made(stuck=False):
    """A map with the straight borders of a rig: smooth running is lost left of the first line, and stick-slip ends at the second."""
    lost, lost_border = border(AXES, below(1.5e-5, 4.2), 40)
    lasts, lasts_border = border(AXES, below(9e-5, 10.0), 40)
    smooth = MapSide(np.where(lost, 1.5, 1e-4), np.where(lost, 0.3, 0.0), np.where(lost, STICK_SLIP, SMOOTH))
    sticking = MapSide(np.where(lasts, 1.2, 1e-4), np.where(lasts, 0.3, 0.0), np.where(lasts, STICK_SLIP, SMOOTH))
    if stuck:
        for side in (smooth, sticking):
            side.verdict[0, :2], side.verdict[0, 2:4], side.verdict[0, 4:6] = NONE, STUCK, SWING
            side.severity[0, :2] = np.nan
    borders = {"smooth": lost_border, "sticking": lasts_border}
    return SeverityMap("rig", ("top.reference", "bit.weight"), ("rad/s", "N"), AXES, "bit", "bit.speed", smooth, sticking, np.where(lost, 1.0, -1.0), borders,
                       100.0, 1e-6, 0.125, 200)  # fmt: skip


def test_outlines_fill_a_region_exactly_up_to_its_border():
    where, segments = border(AXES, below(9e-5, 10.0), 40)
    # a trapezium: from the left edge to the line, which is at 7.3 below and at 12.7 above
    assert area(outlines(AXES, where, segments)) == pytest.approx(60e3 * (10.0 - 3.0), rel=1e-9)
    # the other side fills the rest
    assert area(outlines(AXES, ~where, segments)) == pytest.approx(60e3 * (14.0 - 10.0), rel=1e-9)


def test_opposite_corners_of_a_cell_are_two_pieces_as_the_border_goes():
    axes = (np.array([0.0, 1.0]), np.array([0.0, 1.0]))
    for where in (np.array([[True, False], [False, True]]), np.array([[False, True], [True, False]])):
        pieces = outlines(axes, where, np.empty((0, 2, 2)))
        assert [len(piece) for piece in pieces] == [3, 3] and area(pieces) == pytest.approx(2 * 0.125)
    assert outlines(axes, np.zeros((2, 2), bool), np.empty((0, 2, 2))) == []
    (whole,) = outlines(axes, np.ones((2, 2), bool), np.empty((0, 2, 2)))
    assert area([whole]) == 1.0
    for i in range(4):  # one corner in, and one corner out
        where = np.arange(4).reshape(2, 2) == i
        assert area(outlines(axes, where, np.empty((0, 2, 2)))) == pytest.approx(0.125)
        assert area(outlines(axes, ~where, np.empty((0, 2, 2)))) == pytest.approx(0.875)


def test_no_place_outside_of_the_border_is_shaded_and_every_place_inside_is():
    found = made()
    axes = found.plot()
    rng = np.random.default_rng(1)
    places = np.column_stack([rng.uniform(3.0, 14.0, 2000), rng.uniform(50.0, 110.0, 2000)])
    for ax, inside in zip(axes, (below(1.5e-5, 4.2), below(9e-5, 10.0)), strict=True):
        meshes = [each for each in ax.collections if isinstance(each, QuadMesh)]
        paths = [mesh.get_clip_path().get_fully_transformed_path() for mesh in meshes]
        shaded = np.any([path.contains_points(ax.transData.transform(places)) for path in paths], axis=0)
        np.testing.assert_array_equal(shaded, inside(places * [1.0, 1e3]))
    axes[0].figure.canvas.draw()


def test_a_region_without_stick_lies_on_top_of_the_severity_in_the_colour_of_the_legend():
    found = made(stuck=True)
    ax = found.plot()[0]
    meshes = [each for each in ax.collections if isinstance(each, QuadMesh)]
    patches = {matplotlib.colors.to_hex(patch.get_facecolor()): patch for patch in ax.patches}
    legend = {patch.get_label().partition(":")[0]: patch for patch in ax.figure.legends[0].get_patches()}
    for region in ("stuck", "swing", "none"):
        drawn = patches[matplotlib.colors.to_hex(legend[region].get_facecolor())]
        assert all(drawn.get_zorder() > mesh.get_zorder() for mesh in meshes)
        i, j = np.argwhere(found.regions[region])[0]
        assert drawn.get_path().contains_point((found.axes[0][i] + 1e-6, found.axes[1][j] / 1e3 + 1e-6))


@pytest.mark.parametrize("stuck", [False, True])
def test_the_legend_says_what_each_region_that_there_is_means(stuck, tmp_path):
    found = made(stuck)
    axes = found.plot()
    (legend,) = axes[0].figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    names = [name for name, where in found.regions.items() if where.any()]
    assert {"free", "bistable", "stick-slip"} < set(names) if stuck else set(names) == {"free", "bistable", "stick-slip"}
    assert words[: len(names)] == [f"{'smooth' if name == 'free' else name}: {MEANINGS[name]}" for name in names]
    assert words[len(names) :] == ["smooth running is lost", "stick-slip ends"]
    assert [ax.get_xlabel() for ax in axes] == ["top reference [rad/s]"] * 2 and axes[0].get_ylabel() == "bit weight [kN]"
    axes[0].figure.savefig(tmp_path / "map.png")


def test_names_of_regions_stand_within_them_also_where_a_coarse_map_has_them_at_its_edge_only():
    from matplotlib.figure import Figure

    grid = (np.array([60.0, 95.0, 130.0]), np.array([60.0, 85.0, 110.0]))
    free = np.array([[False, False, False], [True, False, False], [True, True, False]])
    ax = Figure().add_subplot()
    _words(ax, grid, {"free": free, "bistable": ~free}, np.array([np.nan, np.nan]))
    places = {each.get_text(): each for each in ax.texts}
    for word, where in (("smooth", free), ("bistable", ~free)):
        x, y = places[word].get_position()
        assert where[list(grid[0]).index(x), list(grid[1]).index(y)]
    assert (places["smooth"].get_ha(), places["smooth"].get_va()) != ("center", "center")  # letters do not cross the axes
