"""The regions of a severity map: what each means for who runs the machine, and their outlines."""

from __future__ import annotations

import itertools

import numpy as np

MEANINGS = {
    "free": "run here: a disturbance dies, and stick-slip that has begun ends",
    "bistable": "smooth only if started so: once disturbed, stick-slip for ever",
    "smooth or stuck": "smooth until it is stopped, then at rest for good",
    "stick-slip": "do not run here: the least disturbance grows into it",
    "swing": "the least disturbance grows, without stick",
    "stuck": "the least disturbance brings it to rest for good",
    "none": "no steady running, a run that failed, or one that nothing decided",
}
"""{name of a region: what the machine does in it}."""


def outlines(axes: tuple[np.ndarray, np.ndarray], where: np.ndarray, segments: np.ndarray) -> list[np.ndarray]:
    """Return polygons that fill the region up to its border. `where` is true inside. A cell of the grid has one or two polygons, shape
    (corners, 2) each.

    `axes` are the values of both numbers, and `segments` those of the border, shape (k, 2, 2), whose ends lie on edges of the grid. An edge between a point
    inside and a point outside that the border does not cross is cut in its middle. In a cell with two opposite corners inside, each of them has a polygon of
    its own, as the border goes.
    """
    crossings = {edge: place for place in segments.reshape(-1, 2) if (edge := _edge(axes, place)) is not None}
    polygons = []
    for i, j in itertools.product(range(axes[0].size - 1), range(axes[1].size - 1)):
        corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        inside = [bool(where[corner]) for corner in corners]
        if not any(inside):
            continue
        walk: list[np.ndarray] = []
        pieces = [walk]
        for k, corner in enumerate(corners):
            following = (k + 1) % 4
            point = np.array([axes[0][corner[0]], axes[1][corner[1]]])
            if inside[k]:
                walk.append(point)
            if inside[k] != inside[following]:
                after = np.array([axes[0][corners[following][0]], axes[1][corners[following][1]]])
                edge = min(corner, corners[following]), max(corner, corners[following])
                walk.append(crossings.get(edge, 0.5 * (point + after)))
                if inside[k]:  # the region is left: what comes is another piece, or the rest of the first
                    walk = []
                    pieces.append(walk)
        if len(pieces) > 1 and inside[0]:
            pieces[0] = pieces.pop() + pieces[0]
        polygons += [np.array(piece) for piece in pieces if len(piece) > 2]
    return polygons


def _edge(axes: tuple[np.ndarray, np.ndarray], place: np.ndarray) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """The edge of the grid on which a place lies, as its two points; None where it lies on none."""
    on = [np.flatnonzero(axis == value) for axis, value in zip(axes, place, strict=True)]
    if on[0].size == on[1].size:  # a corner, or inside of a cell
        return None
    along = 0 if on[1].size else 1
    k = int(np.searchsorted(axes[along], place[along])) - 1
    if not 0 <= k < axes[along].size - 1:
        return None
    fixed = int(on[1 - along][0])
    first, second = ((k, fixed), (k + 1, fixed)) if along == 0 else ((fixed, k), (fixed, k + 1))
    return first, second
