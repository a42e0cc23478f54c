"""Polynomials in lanes: their values, their bounds, and their first fall through zero, as `toolbox.simulation.series_steps` looks for it."""

from __future__ import annotations

from collections.abc import Sequence

from toolbox.compilation.vector_emitter import VectorBody
from toolbox.lanes.searches import crossing
from toolbox.lanes.vectors import Slot, Truth, Value, constant, repeat_while_any, smallest, when_any
from toolbox.simulation.series_steps import SHORTEST


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


def bend(c: Sequence[Value], s: Value) -> Value:
    """The most by which the cubic with values and slopes at 0 and s can be off between them."""
    total = constant(s.body, 0.0)
    for k in range(len(c) - 1, 3, -1):
        total = total * s + abs(c[k]) * (k * (k - 1.0) * (k - 2.0) * (k - 3.0) / 384.0)
    square = s * s
    return total * (square * square)


def least(c: Sequence[Value], s: Value) -> tuple[Value, Value]:
    """A bound below the polynomial between 0 and s, and its value at s."""
    value, slope = value_and_slope(c, s)
    third = s * (1.0 / 3.0)
    low = smallest(smallest(c[0], c[0] + c[1] * third), smallest(value, value - slope * third))
    return low - bend(c, s), value


class Falls:
    """The search for first falls through zero on [0, 1] of polynomials of a degree, in a function of its own: its loops are there once.

    A lane that is looked at begins above zero, or leaves zero upwards.
    """

    def __init__(self, body: VectorBody, degree: int) -> None:
        self.body, self.degree = body, degree
        self.room = f"%room{body.count}"
        body.count += 1
        body.lines.insert(0, f"  {self.room} = alloca [{(degree + 3) * body.width} x double], align 64")
        written = _search(body.width, degree)
        text = [f"define internal void @first_fall_{degree}(ptr noalias %c) noinline nounwind {{", "entry:", *written.lines, "  ret void", "}"]
        body.functions[f"first fall {degree}"] = "\n".join(text)
        body.declarations |= written.declarations

    def first(self, c: Sequence[Value], where: Truth, length: Value) -> Value:
        """The first zero in the lanes where it is true, 2 where there is none; length: of the piece that is looked at first."""
        for i, value in enumerate([*c, where.choose(1.0, 0.0), length]):
            self.body.store(value.name, self.room, i)
        self.body.lines.append(f"  call void @first_fall_{self.degree}(ptr {self.room})")
        return Value(self.body, self.body.load(self.room, self.degree + 1))


def _search(width: int, degree: int) -> VectorBody:
    """Coefficients, then whether a lane is looked at, then the length of its first piece stand in %c; the zero takes the place of the second."""
    body = VectorBody(width)

    def given(i: int) -> Value:
        return Value(body, body.load("%c", i))

    c = [given(k) for k in range(degree + 1)]
    zero, one = constant(body, 0.0), constant(body, 1.0)
    doubt = bend(c, one)
    left, right, a, da = Slot(zero), Slot(one), Slot(c[0]), Slot(c[1])
    looks, length, found = Slot(given(degree + 1)), Slot(given(degree + 2)), Slot(zero)

    def look() -> Truth:
        on, size, begin = looks.get().differs(0.0), length.get(), left.get()
        end = smallest(begin + size, 1.0)
        b, db = value_and_slope(c, end)
        width = end - begin
        square, third = width * width, width * (1.0 / 3.0)
        off, short = doubt * (square * square), size <= SHORTEST
        below = b <= 0.0
        falls = on & below & (short | (off <= 1e-3 * (a.get() - b)))
        clear = on & ~below & (short | (smallest(a.get() + da.get() * third, b - db * third) > off))
        right.set(falls.choose(end, right.get()))
        found.set(falls.choose(1.0, found.get()))
        for slot, new in ((left, end), (a, b), (da, db)):
            slot.set(clear.choose(new, slot.get()))
        length.set(size * clear.choose(2.0, 0.5))
        goes_on = on & ~falls & ~(clear & (end >= 1.0))
        looks.set(goes_on.choose(1.0, 0.0))
        return goes_on

    repeat_while_any(body, look)
    falls = found.get().differs(0.0)
    place = Slot(constant(body, 2.0))

    def zero_of() -> None:
        low, high = Slot(left.get()), Slot(right.get())
        width = high.get() - low.get()
        b, db = value_and_slope(c, high.get())
        place.set(low.get() + crossing(a.get(), b, da.get(), db, width) * width)
        tries = Slot(zero)

        def improve() -> Truth:
            s = place.get()
            value, slope = value_and_slope(c, s)
            above = value > 0.0
            low.set(above.choose(s, low.get()))
            high.set(above.choose(high.get(), s))
            following = s - value / slope
            inside = (following >= low.get()) & (following <= high.get())
            following = inside.choose(following, 0.5 * (low.get() + high.get()))
            goes_on = falls & (abs(following - s) > 1e-9 * high.get()) & (tries.get() < 60.0)
            tries.set(tries.get() + 1.0)
            place.set(following)
            return goes_on

        repeat_while_any(body, improve)

    when_any(falls, zero_of)
    body.store(falls.choose(place.get(), 2.0).name, "%c", degree + 1)
    return body
