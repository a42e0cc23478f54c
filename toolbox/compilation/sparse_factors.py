"""Elimination of a sparse matrix, written out on its pattern in an order of minimum degree and without search for pivots."""

from __future__ import annotations

import casadi as ca
import numpy as np


def factors(jacobian: ca.SX, diagonal: ca.SX, extra: int = 0) -> tuple[ca.SX, ca.Function, ca.SX]:
    """Triangular factors of `D - jacobian` as a column, the Function (factors, right side) -> solution that uses them, and the least pivot.

    D holds `diagonal` in its rows but the last `extra`, which are algebraic: their right side is zero and their unknowns are left out. The elimination is
    written out on the sparsity pattern in an order of minimum degree and without pivoting: of a chain, twists go first and speeds remain
    tridiagonal, so that there is no fill. The algebraic rows have no part in the least pivot.
    """
    size = jacobian.shape[0]
    n = size - extra
    place = [0] * size
    order = list(_both_ways(jacobian.sparsity()).amd())
    for k, i in enumerate(order):
        place[i] = k
    rows: list[dict[int, ca.SX]] = [{} for _ in range(size)]
    for k, (i, j) in enumerate(zip(*jacobian.sparsity().get_triplet(), strict=True)):
        rows[place[i]][place[j]] = -jacobian.nz[k]
    for i in range(n):
        row = rows[place[i]]
        row[place[i]] = row.get(place[i], 0) + diagonal

    values: list[ca.SX] = []
    symbols: list[ca.SX] = []

    def kept(value: ca.SX) -> ca.SX:
        values.append(value)
        symbols.append(ca.SX.sym("lu"))
        return symbols[-1]

    right = ca.SX.sym("right", n)
    reduced = [right[i] if i < n else ca.SX(0) for i in order]
    below: list[set[int]] = [set() for _ in range(size)]
    for i, row in enumerate(rows):
        for j in row:
            if j < i:
                below[j].add(i)
    places = []
    for k in range(size):
        inverse = 1 / rows[k][k]
        places.append(len(values))
        kept(inverse)
        for i in sorted(below[k]):
            factor = rows[i].pop(k) * inverse
            reduced[i] = reduced[i] - kept(factor) * reduced[k]
            for j, entry in rows[k].items():
                if j > k:
                    if j not in rows[i] and j < i:
                        below[j].add(i)
                    rows[i][j] = rows[i].get(j, 0) - factor * entry
    solution: list[ca.SX] = [ca.SX(0)] * size
    for i in reversed(range(size)):
        # scaled rows leave one operation between neighbours of a chain, which wait for each other
        known = sum((kept(entry * values[places[i]]) * solution[j] for j, entry in sorted(rows[i].items()) if j > i), ca.SX(0))
        solution[i] = reduced[i] * symbols[places[i]] - known
    answer = ca.vertcat(*[solution[place[i]] for i in range(n)])
    least = diagonal
    for k, i in enumerate(order):
        if i < n:
            least = ca.fmin(least, rows[k][k])
    return ca.vertcat(*values), ca.Function("solve", [ca.vertcat(*symbols), right], [answer]), least


def elimination(jacobian: ca.Sparsity) -> tuple[int, int]:
    """Operations at most of the factors of a matrix of this pattern in `factors`, and of a solution with them, from the pattern alone.

    With l_k entries below the diagonal in column k of the symbolic factor: sum 1 + l_k + 2 l_k^2, and 2 (2 sum l_k + n). They grow as n for a chain and as
    n^3 where everything depends on everything.
    """
    upper, _ = _both_ways(jacobian).ldl(True)
    entries = np.bincount(np.array(upper.row(), int), minlength=upper.size1())
    return int((1 + entries + 2 * entries**2).sum()), int(2 * (2 * entries.sum() + entries.size))


def _both_ways(pattern: ca.Sparsity) -> ca.Sparsity:
    """The pattern with its transpose and the diagonal."""
    ones = ca.DM(pattern, 1)
    return (ones + ones.T + ca.DM.eye(pattern.size1())).sparsity()
