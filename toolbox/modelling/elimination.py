"""Linear systems of expressions, solved without pivoting: written out where they are small or sparse, one call where they are large and dense.

The matrices are those of forces that hold each other: rows of sliding elements are unit rows and the block of sticking ones is a Delassus matrix, so the
pivots are positive. Written out, a dense system of n takes 2/3 n^3 operations wherever it is used, in the field, the guards and their derivatives. A call
is one node of the expressions, which casadi evaluates and differentiates like any other; machine code has a loop for it
(`toolbox.compilation.dense_systems`).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

LARGE = 10
"""Unknowns that depend on each other, from which they are solved in a call."""

DENSE = 0.25
"""Operations of the elimination, in parts of those of a full matrix, from which it counts as dense."""


def masked_solve(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Solve `matrix * y = right` by elimination in natural order and without pivoting.

    Unknowns that do not depend on each other are solved apart. A diagonal matrix costs one division a row and a tridiagonal one eliminates without fill.
    """
    solution = ca.SX(ca.densify(right))
    rest = []
    for group in coupled_groups(matrix.sparsity()):
        if len(group) >= LARGE and _is_dense(matrix[group, group].sparsity()):
            solution[group] = dense_solver(len(group))(ca.densify(matrix[group, group]), ca.densify(right[group]))
        else:
            rest += group
    rest.sort()
    if len(rest) < matrix.shape[0]:
        matrix, right = matrix[rest, rest], right[rest]
    if rest:
        solution[rest] = _eliminated(matrix, right)
    return solution


def coupled_groups(pattern: ca.Sparsity) -> list[list[int]]:
    """Return the unknowns in groups. The unknowns of a group depend on each other, directly or through others."""
    both = (ca.DM(pattern, 1) + ca.DM(pattern, 1).T + ca.DM.eye(pattern.size1())).sparsity()
    _, order, ends = both.scc()
    return [sorted(order[a:b]) for a, b in itertools.pairwise(ends)]


def _is_dense(pattern: ca.Sparsity) -> bool:
    """Whether the elimination of this pattern, with its fill, takes about as much as that of a full matrix."""
    n = pattern.size1()
    both = (ca.DM(pattern, 1) + ca.DM(pattern, 1).T + ca.DM.eye(n)).sparsity()
    entries = np.bincount(np.array(both.ldl(False)[0].row(), int), minlength=n)
    return float((entries**2).sum()) >= DENSE * n**3 / 3


def _eliminated(matrix: ca.SX, right: ca.SX) -> ca.SX:
    n = matrix.shape[0]
    rows = _rows(matrix)
    values = [right[i] for i in range(n)]
    below: list[list[int]] = [[] for _ in range(n)]
    for i, row in enumerate(rows):
        for j in row:
            if j < i:
                below[j].append(i)
    for k in range(n):
        for i in sorted(set(below[k])):
            factor = rows[i].pop(k) / rows[k][k]
            for j, entry in rows[k].items():
                if j > k:
                    if j not in rows[i] and j < i:
                        below[j].append(i)
                    rows[i][j] = rows[i].get(j, 0) - factor * entry
            values[i] = values[i] - factor * values[k]
    solution: list[ca.SX] = [ca.SX(0)] * n
    for i in reversed(range(n)):
        known = sum((entry * solution[j] for j, entry in rows[i].items() if j > i), ca.SX(0))
        solution[i] = (values[i] - known) / rows[i][i]
    return ca.vertcat(*solution) if n else ca.SX(0, 1)


def _rows(matrix: ca.SX) -> list[dict[int, ca.SX]]:
    rows: list[dict[int, ca.SX]] = [{} for _ in range(matrix.shape[0])]
    for k, (i, j) in enumerate(zip(*matrix.sparsity().get_triplet(), strict=True)):
        rows[i][j] = matrix.nz[k]
    return rows


def dependent_rows(matrix: np.ndarray) -> list[int]:
    """Return the rows of a matrix that are linearly dependent; empty if the matrix can be solved. The diagonal must hold ones."""
    values, vectors = np.linalg.eig(matrix)
    weakest = int(np.argmin(np.abs(values)))
    share = np.abs(vectors[:, weakest])
    return [i for i in range(len(matrix)) if share[i] > 1e-6 * share.max()] if abs(values[weakest]) < 1e-12 else []


def must_be_independent(titles: Sequence[str]) -> str:
    """Return the message of the error for elements with dependent slips."""
    return (
        f"The slips of {', '.join(titles)} must be independent, but one follows from the others: nothing decides how they share the force."
    )


_NAME = "dense_solve_"


@lru_cache
def dense_solver(n: int) -> ca.Function:
    """Return a casadi Function (full matrix, right side) -> solution of n equations. The function is never inlined: it remains a call in
    other expressions."""
    given, right = ca.SX.sym("matrix", n, n), ca.SX.sym("right", n)
    matrix, values = ca.SX(given), ca.SX(right)
    for k in range(n - 1):
        below = list(range(k + 1, n))
        factors = matrix[below, k] / matrix[k, k]
        matrix[below, below] -= factors @ matrix[k, below]
        values[below] -= factors * values[k]
    for k in reversed(range(n)):
        values[k] = values[k] / matrix[k, k]
        above = list(range(k))
        values[above] -= matrix[above, k] * values[k]
    return ca.Function(f"{_NAME}{n}", [given, right], [values], {"never_inline": True})


def size_solved(name: str) -> tuple[int, bool]:
    """(n, whether it is the derivative) of a call by the name of its function: a `dense_solver` or its derivative in one direction; 0 for any other."""
    head, _, size = name.rpartition(_NAME)
    return (int(size), bool(head)) if head in ("", "fwd1_") and size.isdigit() else (0, False)


def calls(function: ca.Function, operations: Sequence[int] | None = None) -> dict[int, ca.Function]:
    """Return {index of the instruction: called function} of an SX function. operations: operations of its instructions, if the caller has
    them."""
    if operations is None:
        operations = [function.instruction_id(k) for k in range(function.n_instructions())]
    if ca.OP_CALL not in operations:
        return {}
    nodes = function.instructions_sx()
    return {k: nodes[k].which_function() for k, operation in enumerate(operations) if operation == ca.OP_CALL}


def called_with(function: ca.Function, values: Sequence[ca.SX]) -> list[ca.SX]:
    """Return the nonzeros of the results of a function. `values` holds the nonzeros of all arguments, one argument after the other."""
    given = iter(values)
    arguments = [
        ca.SX(function.sparsity_in(i), ca.vertcat(*[next(given) for _ in range(function.nnz_in(i))])) for i in range(function.n_in())
    ]
    return [result.nz[k] for result in function.call(arguments) for k in range(result.nnz())]
