"""The module of a compiled loop in the text of LLVM: its functions, and what reads the arrays of numpy that they are given (`toolbox.translation.compiled`)."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from toolbox.translation.array_layout import DATA, DIMENSIONS, DTYPE, FLAGS, HEADER, ITEMS, NUMBER, ORDER, SIZES, TYPE, UNFIT
from toolbox.translation.kinds import Array, Arrays, Value, known
from toolbox.translation.llvm_language import LlvmTranslation, type_of


def module_text(function: Any, arguments: Sequence[Any], gives: str) -> str:
    """The module of a function with arguments of these kinds and a result of that kind, as `Compiled` takes them."""
    given_tuples = [each for each in arguments if isinstance(each, Mapping)]
    tuples = [{name: Array(dtype, (None,) * dimensions) for name, (dtype, dimensions) in kinds.items()} for kinds in given_tuples]
    kinds = [Arrays(f"w{k}" if k else "w") for k in range(len(tuples))]
    made = LlvmTranslation(dict(zip(kinds, tuples, strict=True)), {}, {})
    waiting = iter(kinds)
    short = {None: known(None), True: Value("", "b")}
    values = [Value("", next(waiting)) if isinstance(each, Mapping) else short.get(each) or Value("", each) for each in arguments]
    main = made.written(function, values)
    result = type_of(main.returns)
    if main.returns not in (gives, "none", None):
        raise TypeError(f"Function `{function.__qualname__}` must give `{gives}`, but it gives `{main.returns}`.")
    given = [f"{type_of(value.kind)} %given{i}" for i, value in enumerate(values) if value.kind not in ("none", "b")]
    handed = [
        "i1 true" if value.kind == "b" else f"{type_of(value.kind)} %given{i}" for i, value in enumerate(values) if value.kind != "none"
    ]
    direct = [
        f"define {type_of(gives)} @{'on_table' if given_tuples else 'run'}({', '.join(given)}) nounwind noinline {{",
        f"  {'' if result == 'void' else '%done = '}call {result} @{main.name}({', '.join(handed)})",
        f"  ret {type_of(gives)} {'0' if result == 'void' else '%done'}",
        "}",
    ]
    head = [*sorted(made.declared), *made.globals, *(each.text for each in made.order), *direct]
    return "\n".join([*head, *(_reader(given_tuples) if given_tuples else []), METADATA])


def _reader(tuples: Sequence[Mapping[str, tuple[str, int]]]) -> list[str]:
    """What takes the type of arrays and tuples of them, looks whether they are as was said, and calls the loop with the tables of them."""
    given, tables = (", ".join(f"ptr %{word}{k}" for k in range(len(tuples))) for word in ("tuple", "table"))
    lines = [f"define i64 @run(ptr %array, {given}) nounwind {{"]
    for k, kinds in enumerate(tuples):
        lines += [f"  %table{k} = alloca [{sum(1 + dimensions for _, dimensions in kinds.values())} x i64], align 64"]
    dtypes = [np.dtype(dtype) for kinds in tuples for dtype, _ in kinds.values()]
    every = [dimensions for kinds in tuples for _, dimensions in kinds.values()]
    items = [(k, j, place) for k, kinds in enumerate(tuples) for j, place in enumerate(_places(kinds))]
    read = _Reader(lines)
    for k, kinds in enumerate(tuples):
        read.expect(read.entry(f"%tuple{k}", HEADER, "i64"), "i64", len(kinds))
    read.settle()
    arrays = [read.entry(f"%tuple{k}", ITEMS + 8 * j) for k, j, _ in items]
    for array in arrays:
        read.expect(read.entry(array, TYPE), "ptr", "%array")
    read.settle()
    for array, dtype, dimensions in zip(arrays, dtypes, every, strict=True):
        read.expect(read.entry(array, DIMENSIONS, "i32"), "i32", dimensions)
        number = read.entry(array, DTYPE)
        read.expect(read.entry(number, NUMBER, "i32"), "i32", dtype.num)
        read.expect(read.entry(number, ORDER, "i8"), "i8", ord(dtype.byteorder))
        read.expect(read.new(f"and i32 {read.entry(array, FLAGS, 'i32')}, 1"), "i32", 1)  # in one piece
    read.settle()
    for array, (k, _, place), dimensions in zip(arrays, items, every, strict=True):
        sizes = read.entry(array, SIZES)
        for d, value in enumerate([read.entry(array, DATA, "i64"), *(read.entry(sizes, 8 * i, "i64") for i in range(dimensions))]):
            lines += [f"  store i64 {value}, ptr {read.new(f'getelementptr i64, ptr %table{k}, i64 {place + d}')}"]
    return [*lines, f"  %done = call i64 @on_table({tables})", "  ret i64 %done", "unfit:", f"  ret i64 {UNFIT}", "}"]


class _Reader:
    """Writes what reads objects of Python and looks whether they are as expected."""

    def __init__(self, lines: list[str]):
        self.lines, self.count, self.fits = lines, 0, "true"

    def new(self, text: str) -> str:
        """Write an instruction and return the name of its result."""
        self.count += 1
        self.lines.append(f"  %r{self.count} = {text}")
        return f"%r{self.count}"

    def entry(self, pointer: str, offset: int, kind: str = "ptr") -> str:
        """Read the value at an offset of so many bytes from a pointer."""
        return self.new(f"load {kind}, ptr {self.new(f'getelementptr i8, ptr {pointer}, i64 {offset}')}")

    def expect(self, value: str, kind: str, wanted: int | str) -> None:
        """Look whether a value is the wanted one."""
        self.fits = self.new(f"and i1 {self.fits}, {self.new(f'icmp eq {kind} {value}, {wanted}')}")

    def settle(self) -> None:
        """Branch to the unfit exit unless all tests so far hold. The code behind may read the objects that the tests have checked."""
        self.lines += [f"  br i1 {self.fits}, label %known{self.count}, label %unfit", f"known{self.count}:"]
        self.fits = "true"


def _places(kinds: Mapping[str, tuple[str, int]]) -> Iterator[int]:
    """The place of every array in the table of a tuple."""
    return itertools.accumulate((1 + dimensions for _, dimensions in list(kinds.values())[:-1]), initial=0)


METADATA = """!0 = !{}
!1 = !{!"arrays"}
!2 = !{!"double", !1, i64 0}
!3 = !{!"i64", !1, i64 0}
!4 = !{!2, !2, i64 0}
!5 = !{!3, !3, i64 0}
!6 = !{!8, !8, i64 0}
!7 = !{!9, !9, i64 0}
!8 = !{!"i32", !1, i64 0}
!9 = !{!"i8", !1, i64 0}
"""
"""Arrays of different types share no memory."""
