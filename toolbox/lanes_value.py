"""Vectors of doubles and of truth values under construction, with the operators of arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from toolbox.emit_vector import VectorBody


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
        return Value(self.body, self.body.value(f"fneg {self.body.type} {self.name}"))

    def __abs__(self) -> Value:
        return Value(self.body, self.body.intrinsic("fabs", self.name))

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


class Truth:
    """A vector of truth values under construction."""

    def __init__(self, body: VectorBody, name: str) -> None:
        self.body, self.name = body, name

    def __and__(self, other: Truth) -> Truth:
        return Truth(self.body, self.body.both(self.name, other.name))

    def __or__(self, other: Truth) -> Truth:
        return Truth(self.body, self.body.either(self.name, other.name))

    def __invert__(self) -> Truth:
        ones = f"<{', '.join(['i1 true'] * self.body.width)}>"
        return Truth(self.body, self.body.value(f"xor {self.body.truths} {self.name}, {ones}"))

    def choose(self, yes: Any, no: Any) -> Value:
        """`yes` in the lanes where it is true, `no` elsewhere."""
        names = [v.name if isinstance(v, Value) else self.body.number(v) for v in (yes, no)]
        return Value(self.body, self.body.select(self.name, *names))


def largest(a: Value, b: Any) -> Value:
    """The larger of two vectors; `b` where one is NaN."""
    return (a > b).choose(a, b)


def smallest(a: Value, b: Any) -> Value:
    """The smaller of two vectors; `b` where one is NaN."""
    return (a < b).choose(a, b)


def where_any(condition: Truth, compute: Callable[[], Truth]) -> Truth:
    """`compute()` where the condition holds in any lane, else false, which it must be where the condition is false."""
    body = condition.body
    found = Truth(body, "")

    def inner() -> None:
        found.name = compute().name

    here, last = when_any(condition, inner)
    return Truth(body, body.value(f"phi {body.truths} [ {found.name}, %{last} ], [ zeroinitializer, %{here} ]"))


def when_any(condition: Truth, write: Callable[[], None]) -> tuple[str, str]:
    """Write instructions that are skipped where the condition holds in no lane; returns the labels before them and of their end."""
    body = condition.body
    here, there, label = f"b{body.count}", f"c{body.count}", f"d{body.count}"
    body.intrinsics.add(f"declare i1 @llvm.vector.reduce.or.v{body.width}i1({body.truths})")
    anywhere = body.value(f"call i1 @llvm.vector.reduce.or.v{body.width}i1({body.truths} {condition.name})")
    body.lines += [f"  br label %{here}", f"{here}:", f"  br i1 {anywhere}, label %{there}, label %{label}", f"{there}:"]
    write()
    last = next(line[:-1] for line in reversed(body.lines) if line.endswith(":"))
    body.lines += [f"  br label %{label}", f"{label}:"]
    return here, last
