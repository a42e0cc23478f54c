"""Borders in a plane of two numbers: the edges of a grid across which a verdict changes, halved until the border is known to a part of a cell.

Only edges on the border are halved, so that a border known to an eighth of a cell costs three verdicts per edge and not 64 times the grid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numpy as np


def border(
    axes: tuple[np.ndarray, np.ndarray], decide: Callable[[np.ndarray], np.ndarray], halvings: int = 3
) -> tuple[np.ndarray, np.ndarray]:
    """Return the verdicts on the grid of both axes, shape (n, m), and the border of the region in which `decide` is true, shape (k, 2, 2).

    decide: points, shape (k, 2) -> whether each is in the region, all that are asked at once: a sweep, or any closed form.  halvings: of every edge across
    the border. Segments end on edges of the grid, in the order (segment, end, coordinate).
    """
    mesh = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    where = np.asarray(decide(mesh.reshape(-1, 2)), bool).reshape(mesh.shape[:2])
    edges = edges_of(axes, where, np.ones(where.shape, bool))
    return where, edges.segments(edges.halved(lambda points: np.asarray(decide(points), bool), halvings))


def coordinates(values: np.ndarray, logarithmic: tuple[bool, bool]) -> np.ndarray:
    """Points of a plane in the coordinates in which a grid is even, shape (..., 2): the logarithm of a number that is spaced by it."""
    return np.stack([np.log(values[..., k]) if logarithmic[k] else values[..., k] for k in range(2)], axis=-1)


def lines_of(segments: np.ndarray) -> list[np.ndarray]:
    """The lines that segments in order make, shape (points, 2) each, so that dashes run through."""
    starts = np.flatnonzero((segments[1:, 0] != segments[:-1, 1]).any(axis=1)) + 1
    return [np.vstack([line[:1, 0], line[:, 1]]) for line in np.split(segments, starts)] if len(segments) else []


@dataclass(frozen=True)
class Edges:
    """Edges of a grid across which a verdict changes: ends with the one and the other verdict, both of shape (k, 2).

    cells: for every cell of the grid that a border passes, the pairs of its edges (rows) that belong together, in order along each line.
    """

    low: np.ndarray
    high: np.ndarray
    cells: np.ndarray

    def halved(self, decide: Callable[[np.ndarray], np.ndarray], times: int) -> np.ndarray:
        """Halve all edges at once and return the places at which the verdict changes. `decide` takes points and returns True for the
        verdict of `high`."""
        low, high = self.low.copy(), self.high.copy()
        for _ in range(times if len(low) else 0):
            middle = 0.5 * (low + high)
            there = decide(middle)
            high[there], low[~there] = middle[there], middle[~there]
        return 0.5 * (low + high)

    def errors(self, part: float | np.ndarray) -> np.ndarray:
        """Half the width of what is left of every edge, shape (k, 2), if that is this part of the edge; 0 across the edge."""
        return 0.5 * np.reshape(part, (-1, 1)) * np.abs(self.high - self.low)

    def roots(self, values: Callable[[np.ndarray], np.ndarray], precision: float) -> np.ndarray:
        """Return the place on every edge at which the function changes sign, as a fraction of the edge from `low`. All edges are searched
        at once. nan if the function has no change of sign on the edge, or is not known.

        False position as in the Illinois method, and the middle where three of its steps have not halved what is between both signs.

        values: points -> the function there.  precision: in parts of an edge.
        """
        ends = np.tile([0.0, 1.0], (len(self.low), 1))
        at = np.stack([values(points) for points in (self.low, self.high)], axis=1) if len(self.low) else np.empty((0, 2))
        found, left = np.full(len(self.low), np.nan), np.flatnonzero(at[:, 0] * at[:, 1] < 0)
        moved, widths = np.full(len(self.low), -1), [np.full(len(self.low), np.inf)] * 3
        while left.size:
            (a, b), (at_a, at_b) = ends[left].T, at[left].T
            slow = (b - a) > 0.5 * widths[-3][left]
            part = np.where(slow, 0.5 * (a + b), (a * at_b - b * at_a) / (at_b - at_a))
            there = values(self.low[left] + part[:, None] * (self.high[left] - self.low[left]))
            side = (there * at_b > 0).astype(int)
            again = left[moved[left] == side], 1 - side[moved[left] == side]
            at[again] *= 0.5
            ends[left, side], at[left, side], moved[left], found[left] = part, there, side, np.where(np.isnan(there), np.nan, part)
            widths.append(ends[:, 1] - ends[:, 0])
            left = left[(widths[-1][left] > precision) & (there != 0.0) & ~np.isnan(there)]
        return found

    def segments(self, places: np.ndarray) -> np.ndarray:
        """Straight pieces of the border, shape (k, 2, 2), through its places on the edges of each cell, in order along each line."""
        return places[self.cells] if len(self.cells) else np.empty((0, 2, 2))


def edges_of(axes: tuple[np.ndarray, ...], where: np.ndarray, known: np.ndarray) -> Edges:
    """Return the edges between two neighbours with different values of `where`. The verdict of both must be known.

    In a cell with two opposite corners in the region, the border goes around each of them: the region does not pass through its middle.
    """
    from contourpy import contour_generator

    # a contour at half height between 0 and 1 passes through the middle of every edge on the border, and so names the edge
    heights = np.ma.masked_array(where.astype(float), ~known)
    lines = cast("list[np.ndarray]", contour_generator(z=heights, corner_mask=True).lines(0.5))
    if not lines:
        return Edges(np.empty((0, 2)), np.empty((0, 2)), np.empty((0, 2), int))
    middles = np.concatenate([np.stack([line[:-1, ::-1], line[1:, ::-1]], axis=1) for line in lines])  # (segment, end, (row, column))
    on_edge = (middles % 1.0 == 0.0).any(axis=2).all(axis=1)  # beside an unknown corner a contour cuts across the cell
    middles = middles[on_edge]
    along = middles[..., 0] % 1.0 == 0.0  # False for an edge between rows: those come first
    edges, cells = np.unique(np.column_stack([along.ravel(), middles.reshape(-1, 2)]), axis=0, return_inverse=True)
    begin, end = (side(edges[:, 1:]).astype(int) for side in (np.floor, np.ceil))
    outside = np.where(where[tuple(begin.T)][:, None], end, begin)
    places = np.stack([axes[k][np.stack([outside, begin + end - outside])[..., k]] for k in range(2)], axis=-1)
    return Edges(places[0], places[1], cells.reshape(-1, 2))
