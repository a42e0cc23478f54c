"""Directions of a run between its events: machine code that carries them by the steps and stages of the run (`toolbox.orbits.variational`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from toolbox.translation.compiled import Compiled
from toolbox.translation.words import call


class Tableau(NamedTuple):
    """How a step is taken: coefficients a, b, c of the pair, and the compiled function of the field.

    The function at `address` gives the field and the nonzeros (rows, columns) of its derivatives with respect to states and parameters.
    """

    address: int
    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    rows: np.ndarray
    columns: np.ndarray


(FIRST, LAST, ADDRESS, FIRST_PARAMETER, FIRST_HELD, INTS) = range(6)
"""Indices into `Transport.ints`: the nodes from and to which directions are carried, the address of a tableau, the first direction of a parameter, and where
held parameters stand in p."""


class Transport(NamedTuple):
    """Directions that are carried over recorded steps.

    ints: see above;  a, b, c, rows, columns: as in `Tableau`;  time, state, mode, held: recorded steps with whole states;  p: parameters, in which those held
    are put;  tangent: the directions (n, k), carried in place;  kept: those at every node (nodes, n, k), or empty;
    slopes, turns, x, s, y, m: space for a step.
    """

    ints: np.ndarray
    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    time: np.ndarray
    state: np.ndarray
    mode: np.ndarray
    held: np.ndarray
    p: np.ndarray
    tangent: np.ndarray
    kept: np.ndarray
    slopes: np.ndarray
    turns: np.ndarray
    x: np.ndarray
    s: np.ndarray
    y: np.ndarray
    m: np.ndarray

    @staticmethod
    def of(
        tableau: Tableau, time: np.ndarray, whole: np.ndarray, mode: np.ndarray, held: np.ndarray, p: np.ndarray, first_held: int, own: int
    ) -> Transport:
        """Nothing carried yet over recorded steps of whole states; own: the first direction of a parameter."""
        n, stages, none = whole.shape[1], tableau.b.size, np.empty((0, 0))
        ints = np.zeros(INTS, np.int64)
        ints[[ADDRESS, FIRST_PARAMETER, FIRST_HELD]] = tableau.address, own, first_held
        time, whole, mode, held = (np.ascontiguousarray(each) for each in (time, whole, mode, held))
        return Transport(
            ints, tableau.a, tableau.b, tableau.c, tableau.rows, tableau.columns, time, whole, mode, held, p, none, np.empty((0, 0, 0)),
            np.empty((stages, n)), np.empty((stages, n, 0)), np.empty(n), none, np.empty(n + tableau.rows.size + 1), np.empty(mode.shape[1] + 1),
        )  # fmt: skip

    def carrying(self, tangent: np.ndarray) -> Transport:
        """The same with these directions to be carried."""
        directions = tangent.shape[1]
        if directions == self.s.shape[1]:
            return self._replace(tangent=tangent)
        return self._replace(tangent=tangent, s=np.empty(tangent.shape), turns=np.empty((*self.slopes.shape, directions)))

    def over(self, first: int, last: int) -> None:
        """Carry the directions from one node to another."""
        self.ints[FIRST], self.ints[LAST] = first, last
        transport(self)


KINDS: dict[str, tuple[str, int]] = dict.fromkeys(Transport._fields, ("float64", 2)) | {
    **dict.fromkeys(("ints", "rows", "columns"), ("int64", 1)),
    **dict.fromkeys(("b", "c", "time", "p", "x", "y", "m"), ("float64", 1)),
    **dict.fromkeys(("kept", "turns"), ("float64", 3)),
}


def _transport(w):  # noqa: C901 (a compiled loop)
    """Carry `tangent` in place over the recorded steps, and fill `kept` unless it is empty.

    The parameter of column n + j of the derivatives has the direction FIRST_PARAMETER + j.
    """
    n, directions = w.x.size, w.s.shape[1]
    stages = w.b.size
    for k in range(w.ints[FIRST], w.ints[LAST]):
        h = w.time[k + 1] - w.time[k]
        if h > 0.0:
            for i in range(w.mode.shape[1]):
                w.m[i] = w.mode[k, i]
            for i in range(w.held.shape[1]):
                w.p[w.ints[FIRST_HELD] + i] = w.held[k, i]
            for stage in range(stages):
                for i in range(n):
                    w.x[i] = w.state[k, i]
                    for d in range(directions):
                        w.s[i, d] = w.tangent[i, d]
                for q in range(stage):
                    factor = h * w.a[stage, q]
                    if factor != 0.0:
                        for i in range(n):
                            w.x[i] += factor * w.slopes[q, i]
                            for d in range(directions):
                                w.s[i, d] += factor * w.turns[q, i, d]
                call(w.ints[ADDRESS], w.time[k] + w.c[stage] * h, h, w.x, w.x, w.p, w.m, w.y)
                for i in range(n):
                    w.slopes[stage, i] = w.y[i]
                    for d in range(directions):
                        w.turns[stage, i, d] = 0.0
                for z in range(w.rows.size):
                    entry, row, column = w.y[n + z], w.rows[z], w.columns[z]
                    if column < n:
                        for d in range(directions):
                            w.turns[stage, row, d] += entry * w.s[column, d]
                    else:
                        w.turns[stage, row, w.ints[FIRST_PARAMETER] + column - n] += entry
            for q in range(stages):
                factor = h * w.b[q]
                if factor != 0.0:
                    for i in range(n):
                        for d in range(directions):
                            w.tangent[i, d] += factor * w.turns[q, i, d]
        if w.kept.shape[0] > 0:
            for i in range(n):
                for d in range(directions):
                    w.kept[k + 1, i, d] = w.tangent[i, d]


transport = Compiled(_transport, KINDS)
"""Directions carried over recorded steps, as machine code."""
