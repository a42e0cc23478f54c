"""Borders in a plane of two numbers: the edges of a grid across which a verdict changes, halved until the border is known to a part of a cell.

Only edges on the border are halved, so that a border known to an eighth of a cell costs three verdicts per edge and not 64 times the grid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


def border(
    axes: tuple[np.ndarray, np.ndarray], decide: Callable[[np.ndarray], np.ndarray], halvings: int = 3
) -> tuple[np.ndarray, np.ndarray]:
    """(where, segments): verdicts on the grid of both axes, shape (n, m), and the border of the region where they are true, shape (k, 2, 2).

    decide: points, shape (k, 2) -> whether each is in the region, all that are asked at once: a sweep, or any closed form.  halvings: of every edge across
    the border. Segments end on edges of the grid, in the order (segment, end, coordinate).
    """
    mesh = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    where = np.asarray(decide(mesh.reshape(-1, 2)), bool).reshape(mesh.shape[:2])
    edges = edges_of(axes, where, np.ones(where.shape, bool))
    return where, edges.segments(edges.halved(lambda points, _: np.asarray(decide(points), bool), halvings))


@dataclass(frozen=True)
class Edges:
    """Edges of a grid across which a verdict changes: ends with the one and the other verdict, shape (k, 2); owner: which border each belongs to.

    cells: for every cell of the grid that a border passes, the pairs of its edges (rows) that belong together.
    """

    low: np.ndarray
    high: np.ndarray
    owner: np.ndarray
    cells: np.ndarray

    @staticmethod
    def joined(several: list[Edges]) -> Edges:
        owner = np.concatenate([np.full(len(each.low), k) for k, each in enumerate(several)])
        return Edges(np.concatenate([e.low for e in several]), np.concatenate([e.high for e in several]), owner, np.empty((0, 2), int))

    def halved(self, decide: Callable[[np.ndarray, np.ndarray], np.ndarray], times: int) -> np.ndarray:
        """Where the verdict changes on every edge, all edges at once; decide: (points, owners) -> whether the verdict is that of `high`."""
        low, high = self.low.copy(), self.high.copy()
        for _ in range(times if len(low) else 0):
            middle = 0.5 * (low + high)
            there = decide(middle, self.owner)
            high[there], low[~there] = middle[there], middle[~there]
        return 0.5 * (low + high)

    def segments(self, places: np.ndarray) -> np.ndarray:
        """Straight pieces of the border, shape (k, 2, 2), through its places on the edges of each cell."""
        return places[self.cells] if len(self.cells) else np.empty((0, 2, 2))


def edges_of(axes: tuple[np.ndarray, ...], where: np.ndarray, known: np.ndarray) -> Edges:
    """The edges between neighbours of which one is in `where` and the other not, both known."""
    x, y = axes
    number: dict[tuple[str, int, int], int] = {}
    low: list[tuple[float, float]] = []
    high: list[tuple[float, float]] = []
    for kind, di, dj in (("x", 1, 0), ("y", 0, 1)):
        for i in range(x.size - di):
            for j in range(y.size - dj):
                a, b = (i, j), (i + di, j + dj)
                if where[a] != where[b] and known[a] and known[b]:
                    number[kind, i, j] = len(low)
                    ends = [(x[a[0]], y[a[1]]), (x[b[0]], y[b[1]])]
                    low.append(ends[int(where[a])])
                    high.append(ends[int(where[b])])
    cells = []
    for i in range(x.size - 1):
        for j in range(y.size - 1):
            around = [number.get(key) for key in (("x", i, j), ("y", i + 1, j), ("x", i, j + 1), ("y", i, j))]
            crossed = [edge for edge in around if edge is not None]
            if len(crossed) == 2:
                cells.append(crossed)
            elif len(crossed) == 4:  # a saddle: two pieces around two opposite corners
                cells += [[around[0], around[1]], [around[2], around[3]]]  # type: ignore[list-item]
    return Edges(
        np.array(low, float).reshape(-1, 2),
        np.array(high, float).reshape(-1, 2),
        np.zeros(len(low), int),
        np.array(cells, int).reshape(-1, 2),
    )
