"""Vectors of doubles and of truth values under construction, with the operators of arithmetic."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, overload

import casadi as ca

from toolbox.compilation.emitter import inline
from toolbox.compilation.vector_emitter import VectorBody


class Value:
    """A vector of doubles under construction, with the operators of arithmetic."""

    def __init__(self, body: VectorBody, name: str) -> None:
        self.body, self.name = body, name

    def _of(self, other: Any) -> str:
        return other.name if isinstance(other, Value) else self.body.number(other)

    def __add__(self, other: Any) -> Value:
        return Value(self.body, self.body.add(self.name, self._of(other)))

    def __sub__(self, other: Any) -> Value:
        return Value(self.body, self.body.sub(self.name, self._of(other)))

    def __rsub__(self, other: Any) -> Value:
        return Value(self.body, self.body.sub(self._of(other), self.name))

    def __mul__(self, other: Any) -> Value:
        return Value(self.body, self.body.mul(self.name, self._of(other)))

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: Any) -> Value:
        return Value(self.body, self.body.div(self.name, self._of(other)))

    def __rtruediv__(self, other: Any) -> Value:
        return Value(self.body, self.body.div(self._of(other), self.name))

    def __neg__(self) -> Value:
        return Value(self.body, self.body.negative(self.name))

    def __abs__(self) -> Value:
        return Value(self.body, self.body.intrinsic("fabs", self.name))

    def root(self) -> Value:
        """Square root."""
        return Value(self.body, self.body.intrinsic("sqrt", self.name))

    def _compare(self, how: str, other: Any) -> Truth:
        return Truth(self.body, self.body.compare(how, self.name, self._of(other)))

    def __lt__(self, other: Any) -> Truth:
        return self._compare("olt", other)

    def __le__(self, other: Any) -> Truth:
        return self._compare("ole", other)

    def __gt__(self, other: Any) -> Truth:
        return self._compare("ogt", other)

    def __ge__(self, other: Any) -> Truth:
        return self._compare("oge", other)

    def differs(self, other: Any) -> Truth:
        return self._compare("une", other)


class Row:
    """Rows of an item of a block, a vector each. A row is loaded when it is used."""

    def __init__(self, body: VectorBody, pointer: str, first: int, length: int) -> None:
        self.body, self.pointer, self.places = body, pointer, range(first, first + length)

    def _load(self, place: int) -> Value:
        return Value(self.body, self.body.load(self.pointer, place))

    @overload
    def __getitem__(self, i: int) -> Value: ...
    @overload
    def __getitem__(self, i: slice) -> list[Value]: ...
    def __getitem__(self, i: int | slice) -> Value | list[Value]:
        return [self._load(place) for place in self.places[i]] if isinstance(i, slice) else self._load(self.places[i])

    def __iter__(self) -> Iterator[Value]:
        return map(self._load, self.places)

    def __len__(self) -> int:
        return len(self.places)


MANY_ROWS = 250
"""Rows of a block above which most of what is loaded early would wait on the stack."""


class Rows:
    """All rows of a block by name: a vector for a number of the lane, a `Row` for several (`lengths`).

    What is loaded is kept until its last use, on the stack where there is too much of it; from other `Rows` of a large block it is loaded anew.
    """

    def __init__(self, body: VectorBody, first: dict[str, int], lengths: dict[str, int | None]) -> None:
        self.body, self.first, self.lengths = body, first, lengths
        many = sum(length or 1 for length in lengths.values()) > MANY_ROWS
        self.pointer = body.renewed("%lanes") if many else "%lanes"

    def __getitem__(self, name: str) -> Any:
        length = self.lengths[name]
        row = Row(self.body, self.pointer, self.first[name], 1 if length is None else length)
        return row[0] if length is None else row


class Truth:
    """A vector of truth values under construction."""

    def __init__(self, body: VectorBody, name: str) -> None:
        self.body, self.name = body, name

    def __and__(self, other: Truth) -> Truth:
        return Truth(self.body, self.body.both(self.name, other.name))

    def __or__(self, other: Truth) -> Truth:
        return Truth(self.body, self.body.either(self.name, other.name))

    def __invert__(self) -> Truth:
        return Truth(self.body, self.body.opposite(self.name))

    def choose(self, yes: Any, no: Any) -> Value:
        """Return `yes` in the lanes that are true, and `no` in the others."""
        names = [v.name if isinstance(v, Value) else self.body.number(v) for v in (yes, no)]
        return Value(self.body, self.body.select(self.name, *names))


def constant(body: VectorBody, number: float) -> Value:
    """A number in every lane."""
    return Value(body, body.number(number))


def called(function: ca.Function, *arguments: Value | Iterable[Value]) -> list[Value]:
    """What a function gives, of a vector or a column of vectors for each argument."""
    columns = [[given] if isinstance(given, Value) else list(given) for given in arguments]
    body = columns[0][0].body
    return [Value(body, name) for name in inline(body, function, [[value.name for value in column] for column in columns])[0]]


def largest(a: Value, b: Any) -> Value:
    """Return the larger of two vectors; `b` if either is NaN."""
    return (a > b).choose(a, b)


def smallest(a: Value, b: Any) -> Value:
    """Return the smaller of two vectors; `b` if either is NaN."""
    return (a < b).choose(a, b)


def where_any(condition: Truth, compute: Callable[[], tuple[Truth, ...]]) -> tuple[Truth, ...]:
    """Return `compute()` if the condition holds in any lane, else false. In lanes without the condition, `compute()` must be false."""
    body = condition.body
    found: list[Truth] = []
    here, there = when_any(condition, lambda: found.extend(compute()))
    return tuple(Truth(body, body.from_block(truth.name, there, here)) for truth in found)


def when_any(condition: Truth, write: Callable[[], None]) -> tuple[str, str]:
    """Emit a branch around the instructions, taken if no lane meets the condition. Returns the labels of the two predecessor blocks."""
    body = condition.body
    here, there, last, label = (f"{letter}{body.count}" for letter in "bced")
    anywhere = body.in_any(condition.name)
    body.block(here)
    body.branch(anywhere, there, label, there)
    write()
    body.block(last)
    body.block(label)
    return here, last


class Slot:
    """A vector that branches and loops change: a place in memory, which the optimiser turns into registers."""

    def __init__(self, first: Value) -> None:
        self.body, self.place = first.body, first.body.place("slot")
        self.set(first)

    def get(self) -> Value:
        """What is there."""
        return Value(self.body, self.body.load(self.place, 0))

    def set(self, value: Value) -> None:
        """Write a vector."""
        self.body.store(value.name, self.place, 0)


def repeat_while_any(body: VectorBody, write: Callable[[], Truth]) -> None:
    """Write a loop over the instructions of `write`. The loop repeats as long as the truth value that `write` returns holds in any lane."""
    label = f"loop{body.count}"
    body.count += 1
    body.block(label)
    condition = write()
    again = body.in_any(condition.name)
    body.branch(again, label, f"end_{label}", f"end_{label}")
