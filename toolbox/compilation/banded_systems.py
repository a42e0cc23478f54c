"""Systems of equations of chains in machine code: the unknowns that no other holds are eliminated at once, a band of few diagonals is left for a loop.

Of a chain of inertias, twists depend on their two neighbours alone; without them the speeds are left, each of which depends on the next. What is
eliminated first is written in expressions, which become loops over equal rows (`toolbox.compilation.rolled`); the band is factored and solved in natural
order and without pivoting by functions of its half width b that have loops over its rows. A row holds 2 b + 1 numbers, the diagonal in the middle, later
its inverse; b rows of zeros stand before the first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from toolbox.compilation.loop_text import LoopText

WIDEST = 6
"""Half width up to which a band is one."""

FILL = 6
"""Entries that the elimination of an unknown may add among the others."""


@dataclass(frozen=True)
class Banded:
    """A matrix D - J whose unknowns `apart` depend on none of themselves, and whose `others` are left in a band of this half width.

    values: what a step computes: the pivots of those apart, their inverses, the entries beside and above them, and the band with its zeros;  reduced:
    Function (values, right side) -> right side of the others;  completed: Function (values, right side, the others) -> solution.
    """

    apart: list[int]
    others: list[int]
    width: int
    values: ca.SX
    reduced: ca.Function
    completed: ca.Function

    @property
    def band(self) -> int:
        """Place among the values where the rows of the band begin."""
        return self.values.numel() - len(self.others) * (2 * self.width + 1)


class Split(NamedTuple):
    """Unknowns that are eliminated first, none of which depends on another, and the others in their order, which leaves a band of this half width."""

    apart: list[int]
    others: list[int]
    width: int


def split(pattern: ca.Sparsity) -> Split | None:
    """How the unknowns of a matrix of this pattern are eliminated; None where what is left is no narrow band."""
    apart, others = _apart(pattern)
    if not others:
        return None
    ones = ca.DM(pattern, 1)
    left = (ones[others, others] + ca.mtimes(ones[others, apart], ones[apart, others]) + ca.DM.eye(len(others))).sparsity()
    order, width = _band_order(left)
    return Split(apart, [others[k] for k in order], width) if width <= WIDEST else None


def banded(jacobian: ca.SX, diagonal: ca.SX, parts: Split) -> Banded:
    """The matrix D - J with a diagonal D, as its pattern is split."""
    apart, others, width = parts
    n, s, m, row = jacobian.shape[0], len(apart), len(others), 2 * width + 1
    matrix = diagonal * ca.SX.eye(n) - jacobian
    pivots = ca.diag(matrix[apart, apart]) if s else ca.SX(0, 1)
    inverse = 1 / pivots
    beside, above = matrix[others, apart], matrix[apart, others]
    left = matrix[others, others]
    if s:
        above = ca.sparsify(ca.mtimes(ca.diag(inverse), above))
        left = ca.sparsify(left - ca.mtimes(beside, above))
    rows, columns = (np.array(part, int) for part in left.sparsity().get_triplet())
    places = row * (width + rows) + columns - rows + width
    order = np.argsort(places)
    band = ca.SX(
        ca.Sparsity.triplet(row * (width + m), 1, places[order].tolist(), [0] * rows.size),
        ca.reshape(left.nz[order.tolist()], order.size, 1),
    )
    values = ca.vertcat(pivots, inverse, *(ca.reshape(part.nz[:], part.nnz(), 1) for part in (beside, above)), ca.densify(band))

    symbols, right, found = ca.SX.sym("values", values.numel()), ca.SX.sym("right", n), ca.SX.sym("others", m)
    ends = np.cumsum([s, s, beside.nnz(), above.nnz()])
    first = symbols[s : 2 * s] * right[apart]
    reduced, solution = right[others], ca.SX(n, 1)
    solution[others] = found
    if s:
        reduced -= ca.mtimes(ca.SX(beside.sparsity(), symbols[ends[1] : ends[2]]), first)
        solution[apart] = first - ca.mtimes(ca.SX(above.sparsity(), symbols[ends[2] : ends[3]]), found)
    return Banded(
        apart, others, width, values,
        ca.Function("reduced", [symbols, right], [ca.densify(reduced)]),
        ca.Function("completed", [symbols, right, found], [ca.densify(solution)]),
    )  # fmt: skip


def _apart(pattern: ca.Sparsity) -> tuple[list[int], list[int]]:
    """Unknowns of which none depends on another and whose elimination adds few entries, and the others."""
    n = pattern.size1()
    rows: list[set[int]] = [set() for _ in range(n)]
    columns: list[set[int]] = [set() for _ in range(n)]
    for i, j in zip(*pattern.get_triplet(), strict=True):
        if i != j:
            rows[i].add(j)
            columns[j].add(i)
    taken: set[int] = set()
    for k in sorted(range(n), key=lambda k: len(rows[k]) * len(columns[k])):
        if len(rows[k]) * len(columns[k]) <= FILL and not taken & (rows[k] | columns[k]):
            taken.add(k)
    return sorted(taken), [k for k in range(n) if k not in taken]


def _band_order(pattern: ca.Sparsity) -> tuple[list[int], int]:
    """An order of the unknowns in which entries lie near the diagonal, their own or that of Cuthill and McKee; and how near."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    n = pattern.size1()
    i, j = (np.array(part, int) for part in pattern.get_triplet())
    turned = reverse_cuthill_mckee(coo_array((np.ones(i.size), (i, j)), shape=(n, n)).tocsr(), symmetric_mode=False)

    def width(order: np.ndarray) -> int:
        place = np.argsort(order)
        return int(np.abs(place[i] - place[j]).max(initial=0))

    best = min((np.arange(n), np.asarray(turned, int)), key=width)
    return best.tolist(), width(best)


def least_text() -> str:
    """A function of the least of `least` and n numbers."""
    text = LoopText()
    low = _number(text, "%least")
    with text.loop("0", "%n") as k:
        text.store(_lesser(text, text.load(low), text.load(text.at("%a", k))), low)
    return text.function("least", "i64 %n, ptr %a, double %least", text.load(low))


def factor_text(width: int) -> str:
    """The function that factors a band of n rows in place and gives the least of `least` and the pivots."""
    text, row = LoopText(), 2 * width + 1
    low = _number(text, "%least")
    with text.loop("0", "%n") as i:
        here = text.at("%a", text.value(f"mul i64 {i}, {row}"))
        entries = [text.load(text.at(here, str(c))) for c in range(row)]
        for d in range(width, 0, -1):
            before = text.at(here, str(-d * row))
            factor = text.value(f"fmul double {entries[width - d]}, {text.load(text.at(before, str(width)))}")
            text.store(factor, text.at(here, str(width - d)))
            for c in range(1, width + 1):
                product = text.value(f"fmul contract double {factor}, {text.load(text.at(before, str(width + c)))}")
                entries[width - d + c] = text.value(f"fsub contract double {entries[width - d + c]}, {product}")
        text.store(_lesser(text, text.load(low), entries[width]), low)
        text.store(text.value(f"fdiv double 1.0, {entries[width]}"), text.at(here, str(width)))
        for c in range(1, width + 1):
            text.store(entries[width + c], text.at(here, str(width + c)))
    with text.loop("0", "%n") as i:  # scaled rows leave one operation between neighbours, which wait for each other
        here = text.at("%a", text.value(f"mul i64 {i}, {row}"))
        inverse = text.load(text.at(here, str(width)))
        for c in range(1, width + 1):
            place = text.at(here, str(width + c))
            text.store(text.value(f"fmul double {text.load(place)}, {inverse}"), place)
    return text.function("band_factor", "i64 %n, ptr %a, double %least", text.load(low))


def solve_text(width: int) -> str:
    """The function that solves with the factors in place: n right sides, with `width` places before and behind them for what is zero."""
    text, row = LoopText(), 2 * width + 1
    for first, end in (("0", str(width)), (text.value(f"add i64 %n, {width}"), text.value(f"add i64 %n, {2 * width}"))):
        with text.loop(first, end) as i:
            text.store("0.0", text.at("%b", i))
    for down in (False, True):
        near = [_number(text, "0.0") for _ in range(width)]  # the solution at the last rows, in registers
        with text.loop("0", "%n", down) as i:
            here = text.at("%a", text.value(f"mul i64 {i}, {row}"))
            place = text.at("%b", text.value(f"add i64 {i}, {width}"))
            value = text.load(place)
            if down:
                value = text.value(f"fmul double {value}, {text.load(text.at(here, str(width)))}")
            known = [text.load(each) for each in near]
            for d in range(width, 0, -1):
                entry = text.load(text.at(here, str(width + d if down else width - d)))
                value = text.value(f"fsub contract double {value}, {text.value(f'fmul contract double {entry}, {known[d - 1]}')}")
            for each, new in zip(near, [value, *known], strict=False):
                text.store(new, each)
            text.store(value, place)
    return text.function("band_solve", "i64 %n, ptr %a, ptr %b")


def _number(text: LoopText, value: str) -> str:
    """A variable."""
    text.lines.insert(1, f"  %n{next(text.numbers)} = alloca double, align 8")
    name = text.lines[1].split()[0]
    text.store(value, name)
    return name


def _lesser(text: LoopText, a: str, b: str) -> str:
    """The lesser of two numbers, b where they do not compare."""
    return text.value(f"select i1 {text.value(f'fcmp olt double {a}, {b}')}, double {a}, double {b}")
