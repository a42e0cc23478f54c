"""Polynomials in lanes: their values, their signs on [0, 1], and where they first fall through zero there.

A polynomial lies between its control points, its coefficients in Bernstein's basis, and has no more zeros than these have changes of sign (G. Farin,
Curves and Surfaces for CAGD, 5th ed. 2002, chapter 5). So where the control points are positive nothing happens, and where they fall through zero once,
the polynomial does so once, near to where their polygon does. Only where they change sign more often is it looked at piece by piece, as
`toolbox.stepping.series_steps` does.

Of a series of high order the control points of the first terms are enough: with |c_k| s^k <= |c_k| s^m for k > m, the others move only the last point of
degree m.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from toolbox.compilation.vector_emitter import VectorBody
from toolbox.lanes.searches import crossing, hermite_minimum
from toolbox.lanes.vectors import Slot, Truth, Value, constant, repeat_while_any, smallest, when_any
from toolbox.stepping.series_steps import SHORTEST

FEW, MANY = 4, 8
"""Degrees of control points that show that most polynomials stay positive, and of those that show where one falls."""

CLOSE = 1e-5
"""Last move of Newton's method, in parts of the place: the next would be its square."""


def value_and_slope(c: Sequence[Value], s: Value) -> tuple[Value, Value]:
    """Value and slope at s of the polynomial with these coefficients."""
    value = slope = c[-1]
    for k in range(len(c) - 2, -1, -1):
        value = value * s + c[k]
        if k:
            slope = slope * s + value
    return value, slope


def value_at(c: Sequence[Value], s: Value) -> Value:
    """Value at s of the polynomial with these coefficients."""
    value = c[-1]
    for k in range(len(c) - 2, -1, -1):
        value = value * s + c[k]
    return value


def powers(h: Value, most: int) -> list[Value]:
    """h^0 to h^most."""
    found = [constant(h.body, 1.0), h]
    for k in range(2, most + 1):
        found.append(found[k // 2] * found[k - k // 2])
    return found[: most + 1]


def control_points(c: Sequence[Value], degree: int) -> tuple[list[Value], Value]:
    """Control points of the first terms on [0, 1], and by how much the other terms move the last of them at most."""
    degree = min(degree, len(c) - 1)
    points = [value * (1.0 / math.comb(degree, k)) for k, value in enumerate(c[: degree + 1])]
    for first in range(1, degree + 1):
        for i in range(degree, first - 1, -1):
            points[i] = points[i] + points[i - 1]
    return points, total([abs(value) for value in c[degree + 1 :]] or [constant(c[0].body, 0.0)])


def scaled(c: Sequence[Value], power: Sequence[Value]) -> list[Value]:
    """Coefficients of the polynomial on a step whose powers these are, as one on [0, 1]."""
    return [c[0], *(value * factor for value, factor in zip(c[1:], power[1:], strict=True))]


def total(values: Sequence[Value]) -> Value:
    """Sum of vectors in pairs, so that few of them wait for each other."""
    values = list(values)
    while len(values) > 1:
        pairs = [a + b for a, b in zip(values[::2], values[1::2], strict=False)]
        values = pairs + values[2 * len(pairs) :]
    return values[0]


def stays_positive(c: Sequence[Value]) -> Truth:
    """Where a polynomial is positive on [0, 1], as far as a few control points show it."""
    points, rest = control_points(c, FEW)
    low = points[-1] - rest
    for point in points[:-1]:
        low = smallest(point, low)
    return low > 0.0


class Falls:
    """The search for first falls through zero on [0, 1] of polynomials of a degree.

    A lane that is looked at begins above zero, or leaves zero upwards. What is iterated is a function of its own, so that its loops are there once.
    """

    def __init__(self, body: VectorBody, degree: int) -> None:
        self.body, self.degree, self.name = body, degree, f"first_fall_{degree}"
        self.room = body.place("room", degree + 3)
        body.keep_function(self.name, _search(body.width, degree))

    def first(self, c: Sequence[Value], where: Truth, length: Value) -> Value:
        """Return the first zero in the lanes with `where` true, and 2 in lanes without a zero. length: length of the first piece to search
        if several zeros are possible."""
        for i, value in enumerate([*c, where.choose(1.0, 0.0), length]):
            self.body.store(value.name, self.room, i)
        self.body.call_on(self.name, self.room)
        return Value(self.body, self.body.load(self.room, self.degree + 1))


def _search(width: int, degree: int) -> VectorBody:
    """In %c stand coefficients, which lanes are looked at, and the length of a first piece; the zero takes the second place."""
    body = VectorBody(width)
    c = [Value(body, body.load("%c", k)) for k in range(degree + 1)]
    where, length = Value(body, body.load("%c", degree + 1)).differs(0.0), Value(body, body.load("%c", degree + 2))
    points, rest = control_points(c, MANY)
    above = [*(point > 0.0 for point in points[:-1]), points[-1] > rest]
    last = above[-1] | (points[-1] <= -rest)
    single, several = where & ~where, where & ~last
    before, after, left = points[0], points[0], constant(body, 0.0)
    for k in range(1, len(points)):
        down = where & above[k - 1] & ~above[k]
        several |= single & above[k]
        before, after, left = (down.choose(a, b) for a, b in ((points[k - 1], before), (points[k], after), (float(k - 1), left)))
        single |= down
    several |= single & ~above[0]
    found = Slot((single & ~several).choose(1.0, 0.0))
    place = Slot((left + before / (before - after)) * (1.0 / (len(points) - 1)))
    low, high = Slot(constant(body, 0.0)), Slot(constant(body, 1.0))
    when_any(several, lambda: _piece_by_piece(c, several, length, found, (low, high, place)))
    fallen = found.get().differs(0.0)
    when_any(fallen, lambda: _improved(c, fallen, (low, high, place)))
    body.store(fallen.choose(place.get(), 2.0).name, "%c", degree + 1)
    return body


def _piece_by_piece(c: list[Value], looks: Truth, first: Value, found: Slot, where: tuple[Slot, Slot, Slot]) -> None:
    """Write the search for the first piece in which the polynomial becomes negative, in pieces so short that a cubic shows it. where: its ends, and a guess."""
    body = looks.body
    low, high, place = where
    doubt = constant(body, 0.0)
    for k in range(4, len(c)):
        doubt = doubt + abs(c[k]) * (k * (k - 1.0) * (k - 2.0) * (k - 3.0) / 384.0)
    begin, a, da, length = Slot(constant(body, 0.0)), Slot(c[0]), Slot(c[1]), Slot(first)
    left = Slot(looks.choose(1.0, 0.0))

    def look() -> Truth:
        on, size, start = left.get().differs(0.0), length.get(), begin.get()
        end = smallest(start + size, 1.0)
        b, db = value_and_slope(c, end)
        width = end - start
        square, third = width * width, width * (1.0 / 3.0)
        off, short = doubt * (square * square), size <= SHORTEST
        below = b <= 0.0
        falls = on & below & (short | (off <= 1e-3 * (a.get() - b)))
        clear = on & ~below & (short | (smallest(a.get() + da.get() * third, b - db * third) > off))
        found.set(falls.choose(1.0, found.get()))
        for slot, new in ((low, start), (high, end), (place, start + crossing(a.get(), b, da.get(), db, width) * width)):
            slot.set(falls.choose(new, slot.get()))
        for slot, new in ((begin, end), (a, b), (da, db)):
            slot.set(clear.choose(new, slot.get()))
        length.set(size * clear.choose(2.0, 0.5))
        goes_on = on & ~falls & ~(clear & (end >= 1.0))
        left.set(goes_on.choose(1.0, 0.0))
        return goes_on

    repeat_while_any(body, look)


def _improved(c: list[Value], falls: Truth, where: tuple[Slot, Slot, Slot]) -> None:
    """Write Newton's method in a shrinking bracket for the zero of a polynomial that is positive at its low end and not at its high one."""
    low, high, place = where
    left = Slot(falls.choose(60.0, 0.0))  # moves, none where the zero is found: what others still do must change nothing there

    def improve() -> Truth:
        s, on = place.get(), left.get() > 0.0
        value, slope = value_and_slope(c, s)
        above = value > 0.0
        low.set(above.choose(s, low.get()))
        high.set(above.choose(high.get(), s))
        following = s - value / slope
        inside = (following >= low.get()) & (following <= high.get())
        following = inside.choose(following, 0.5 * (low.get() + high.get()))
        left.set((on & (abs(following - s) > CLOSE * high.get())).choose(left.get() - 1.0, 0.0))
        place.set(on.choose(following, s))
        return left.get() > 0.0

    repeat_while_any(falls.body, improve)


def turn(c: Sequence[Value], ends: tuple[Value, Value]) -> Value:
    """Return the approximate place of the minimum on [0, 1] of a polynomial that falls at first and rises at the end. ends: value and slope
    at the end."""
    place, _ = hermite_minimum(c[0], c[1], *ends)
    slope, bend = value_and_slope([value * float(k) for k, value in enumerate(c)][1:], place)
    better = place - slope / bend
    return ((better > 0.01) & (better < 0.99)).choose(better, place)
