"""Text of LLVM functions with counted loops, for the few that are written by hand."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from contextlib import contextmanager


class LoopText:
    """Text of one function with counted loops."""

    def __init__(self) -> None:
        self.lines = ["entry:"]
        self.block = "entry"
        self.numbers = itertools.count()

    def value(self, text: str) -> str:
        name = f"%v{next(self.numbers)}"
        self.lines.append(f"  {name} = {text}")
        return name

    def start(self, label: str) -> None:
        """Begin a block of instructions."""
        self.lines.append(f"{label}:")
        self.block = label

    def go(self, label: str) -> None:
        self.lines.append(f"  br label %{label}")

    @contextmanager
    def loop(self, first: str, end: str, down: bool = False) -> Iterator[str]:
        """Run with a counter from first to end - 1, or down from end - 1 to first."""
        q = f"l{next(self.numbers)}"
        before = self.block
        self.go(f"{q}_test")
        self.lines.append(f"{q}_test:")
        self.lines.append(f"  %{q} = phi i64 [{end if down else first}, %{before}], [%{q}_next, %{q}_end]")
        self.lines.append(f"  %{q}_more = icmp {'sgt' if down else 'slt'} i64 %{q}, {first if down else end}")
        self.lines.append(f"  br i1 %{q}_more, label %{q}_body, label %{q}_done")
        self.start(f"{q}_body")
        yield self.value(f"sub i64 %{q}, 1") if down else f"%{q}"
        self.go(f"{q}_end")
        self.lines.append(f"{q}_end:")
        self.lines.append(f"  %{q}_next = {'sub' if down else 'add'} i64 %{q}, 1")
        self.go(f"{q}_test")
        self.start(f"{q}_done")

    def at(self, pointer: str, index: str) -> str:
        return self.value(f"getelementptr double, ptr {pointer}, i64 {index}")

    def load(self, place: str, kind: str = "double") -> str:
        return self.value(f"load {kind}, ptr {place}, align 8")

    def store(self, value: str, place: str, kind: str = "double") -> None:
        self.lines.append(f"  store {kind} {value}, ptr {place}, align 8")

    def function(self, name: str, arguments: str, result: str = "") -> str:
        """Return the text of the function. `result` names the number that the function returns, if any."""
        kind, end = ("double", f"  ret double {result}") if result else ("void", "  ret void")
        return "\n".join([f"define internal {kind} @{name}({arguments}) nounwind {{", *self.lines, end, "}"])
