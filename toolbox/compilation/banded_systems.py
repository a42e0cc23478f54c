"""Systems of equations of chains in machine code: the unknowns that no other holds are eliminated at once, a band of few diagonals is left for a loop.

Of a chain of inertias, twists depend on their two neighbours alone; without them the speeds are left, each of which depends on the next. What is
eliminated first is written in expressions, which become loops over equal rows (`toolbox.compilation.rolled`); the band is factored and solved without
pivoting by functions of its half width b that have loops over its rows. A row holds 2 b + 1 numbers, the diagonal in the middle, later its inverse.

Every row waits for its neighbour, four times as long as its operations take. So rows are eliminated from both ends at once, and the solution comes back
from the middle where they meet: two rows wait side by side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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

    values: what a step computes: the pivots of those apart, their inverses, the entries beside and above them, and the band;  reduced:
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
        """Index of the first value of the band."""
        return self.values.numel() - len(self.others) * (2 * self.width + 1)


class Split(NamedTuple):
    """Unknowns that are eliminated first, independent of each other, and the other unknowns in an order that leaves a band of half width
    `width`."""

    apart: list[int]
    others: list[int]
    width: int


def split(pattern: ca.Sparsity) -> Split | None:
    """Return the order of elimination for a matrix of this pattern. None if elimination leaves no narrow band."""
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
    places = row * rows + columns - rows + width
    order = np.argsort(places)
    band = ca.SX(
        ca.Sparsity.triplet(row * m, 1, places[order].tolist(), [0] * rows.size),
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


def factor_text(width: int, rows: int) -> str:
    """The function that factors a band in place and gives the least of `least` and the pivots."""
    text, middle = LoopText(), _middle(width, rows)
    low = _number(text, "%least")
    # of the rows eliminated last, in registers: the inverse of the pivot and the entries towards the middle
    near = {side: [[_number(text, "0.0") for _ in range(width + 1)] for _ in range(width)] for side in (1, -1)}

    def finished(entries: dict[int, str], here: str, towards: Sequence[int]) -> tuple[str, ...]:
        """Store the results of a row with its entries scaled. In a solution, neighbours wait for each other, and the scaling leaves a
        single operation between them."""
        text.store(_lesser(text, text.load(low), entries[0]), low)
        inverse = text.value(f"fdiv double 1.0, {entries[0]}")
        text.store(inverse, text.at(here, str(width)))
        for c in towards:
            text.store(text.value(f"fmul double {entries[c]}, {inverse}"), text.at(here, str(width + c)))
        return inverse, *(entries[c] for c in towards)

    def without(entries: dict[int, str], here: str, c: int, inverse: str, others: Mapping[int, str]) -> None:
        """Eliminate the entry c columns off the diagonal by a row with the inverse of its pivot and `others` in columns relative to the same."""
        factor = text.value(f"fmul double {entries[c]}, {inverse}")
        text.store(factor, text.at(here, str(width + c)))
        for place, other in others.items():
            product = text.value(f"fmul contract double {factor}, {other}")
            entries[place] = text.value(f"fsub contract double {entries[place]}, {product}")

    with text.loop("0", str(middle[0])) as k:
        for side in (1, -1):
            here = _row(text, k, side, width, rows)
            entries = {c: text.load(text.at(here, str(width + c))) for c in range(-width, width + 1)}
            known = [[text.load(each) for each in row] for row in near[side]]
            for d in range(width, 0, -1):
                inverse, *others = known[d - 1]
                without(entries, here, -side * d, inverse, {side * (c - d): other for c, other in enumerate(others, 1)})
            new = finished(entries, here, [side * c for c in range(1, width + 1)])
            for row, values in zip(near[side], [new, *known], strict=False):
                for each, value in zip(row, values, strict=True):
                    text.store(value, each)
    done: dict[int, tuple[str, dict[int, str]]] = {}
    for side, first in ((1, middle[0] - 1), (-1, middle[-1] + 1)):
        for d, row in enumerate(near[side]):
            inverse, *others = [text.load(each) for each in row]
            done[first - side * d] = inverse, {first + side * (c - d): other for c, other in enumerate(others, 1)}
    for i in middle:
        here = text.at("%a", str(i * (2 * width + 1)))
        entries = {c: text.load(text.at(here, str(width + c))) for c in range(-width, width + 1)}
        for j in [*range(i + width, middle[-1], -1), *range(i - width, i)]:
            inverse, beside = done[j]
            without(entries, here, j - i, inverse, {place - i: other for place, other in beside.items()})
        towards = [j for j in range(i + 1, i + width + 1) if j in middle]
        inverse, *others = finished(entries, here, [j - i for j in towards])
        done[i] = inverse, dict(zip(towards, others, strict=True))
    return text.function("band_factor", "ptr %a, double %least", text.load(low))


def solve_text(width: int, rows: int) -> str:
    """The function that solves with the factors in place."""
    text, middle = LoopText(), _middle(width, rows)
    near = {side: [_number(text, "0.0") for _ in range(width)] for side in (1, -1)}  # the solution at the last rows, in registers

    def less(value: str, factors: Sequence[str], known: Sequence[str]) -> str:
        for factor, other in zip(factors, known, strict=True):
            value = text.value(f"fsub contract double {value}, {text.value(f'fmul contract double {factor}, {other}')}")
        return value

    def advance(k: str, side: int, towards: int) -> None:
        here, place = _row(text, k, side, width, rows), text.at("%b", _mirrored(text, k, side, rows))
        value = text.load(place)
        if towards > 0:
            value = text.value(f"fmul double {value}, {text.load(text.at(here, str(width)))}")
        known = [text.load(each) for each in near[side]]
        factors = [text.load(text.at(here, str(width + towards * side * d))) for d in range(width, 0, -1)]
        value = less(value, factors, known[::-1])
        for each, new in zip(near[side], [value, *known], strict=False):
            text.store(new, each)
        text.store(value, place)

    with text.loop("0", str(middle[0])) as k:
        for side in (1, -1):
            advance(k, side, -1)
    found: dict[int, str] = {}
    for side, first in ((1, middle[0] - 1), (-1, middle[-1] + 1)):
        found |= {first - side * d: text.load(each) for d, each in enumerate(near[side])}

    def entry(i: int, j: int) -> str:
        return text.load(text.at("%a", str(i * (2 * width + 1) + width + j - i)))

    for i in middle:
        others = [*range(i + width, middle[-1], -1), *range(i - width, i)]
        found[i] = less(text.load(text.at("%b", str(i))), [entry(i, j) for j in others], [found[j] for j in others])
    for i in reversed(middle):
        others = [j for j in range(i + width, i, -1) if j in middle]
        value = text.value(f"fmul double {found[i]}, {entry(i, i)}")
        found[i] = less(value, [entry(i, j) for j in others], [found[j] for j in others])
        text.store(found[i], text.at("%b", str(i)))
    for side, first in ((1, middle[0]), (-1, middle[-1])):
        for d, each in enumerate(near[side]):
            text.store(found[first + side * d], each)
    with text.loop("0", str(middle[0]), down=True) as k:
        for side in (1, -1):
            advance(k, side, 1)
    return text.function("band_solve", "ptr %a, ptr %b")


def _middle(width: int, rows: int) -> range:
    """The rows where the elimination from the first row on and that from the last row back meet: as many as the half width, or one more."""
    before = (rows - width) // 2
    return range(before, rows - before)


def _mirrored(text: LoopText, i: str, side: int, rows: int) -> str:
    """The row i, counted from the end for the side -1."""
    return i if side > 0 else text.value(f"sub i64 {rows - 1}, {i}")


def _row(text: LoopText, i: str, side: int, width: int, rows: int) -> str:
    """Where the row i of a band stands, counted from the end for the side -1."""
    return text.at("%a", text.value(f"mul i64 {_mirrored(text, i, side, rows)}, {2 * width + 1}"))


def _number(text: LoopText, value: str) -> str:
    """A variable."""
    text.lines.insert(1, f"  %n{next(text.numbers)} = alloca double, align 8")
    name = text.lines[1].split()[0]
    text.store(value, name)
    return name


def _lesser(text: LoopText, a: str, b: str) -> str:
    """The lesser of two numbers, b where they do not compare."""
    return text.value(f"select i1 {text.value(f'fcmp olt double {a}, {b}')}, double {a}, double {b}")
