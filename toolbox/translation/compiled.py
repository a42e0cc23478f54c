"""Compiled loops: functions in a part of Python that is nearly C, translated into the text of LLVM and from there into machine code.

The machine code is for the plain processor of its kind, not for the one at hand, so that it gives the same bits on all of them. It is kept under a number of
everything that enters it (`toolbox.compilation.stamps`): the functions, all that they call and read, the translator, and the version of LLVM. An installed
package can hold it as well (`toolbox.translation.shipped`), under a number of the text of LLVM itself.

A loop takes named tuples of arrays as they stand: its machine code reads where their data are from the arrays of numpy themselves, which is laid down for
every program in C that uses them.
"""

from __future__ import annotations

import ctypes
import hashlib
import itertools
import platform
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.compilation.emitter import COMPILING, linked, object_code
from toolbox.compilation.kept_code import cache_directory, keep, kept
from toolbox.compilation.stamps import stamp_of
from toolbox.translation.kinds import Array, Arrays, Value, known

HEADER = object.__basicsize__
"""Bytes of what begins every object of Python; behind it an array of numpy has the address of its data, its dimensions, their sizes and their strides."""

DATA, SIZES = HEADER, HEADER + 16
ITEMS = tuple.__basicsize__

_IN_C: dict[Any, Any] = {"f": ctypes.c_double, "i": ctypes.c_int64, "u": ctypes.c_uint64, "b": ctypes.c_bool}


class Compiled:
    """A function as machine code.

    Parameters
    ----------
    py_func
        The function. What it calls stands in files of the toolbox.
    arguments
        Its arguments: "f", "i" or "u" for a real number and for a whole one with and without sign; None and True for a condition that is known; and for the
        named tuple of arrays its kinds, {field: (dtype, number of dimensions)}. A function of tuples is given them alone, and gives a whole number.
    gives
        What it gives, as of an argument.
    """

    def __init__(self, py_func: Any, *arguments: Any, gives: str = "i"):
        self.py_func, self.arguments, self.gives = py_func, arguments, gives
        self.__doc__, self.__module__ = py_func.__doc__, py_func.__module__
        self.tuples: list[Mapping[str, tuple[str, int]]] = [each for each in arguments if isinstance(each, Mapping)]
        self._dtypes = [np.dtype(dtype) for kinds in self.tuples for dtype, _ in kinds.values()]
        self._dimensions = [dimensions for kinds in self.tuples for _, dimensions in kinds.values()]

    def __call__(self, *given: Any) -> Any:
        """Run it. Raises TypeError for arrays that are not as was said of them."""
        if not self.tuples:
            return self._entry(*[float(each) if kind == "f" else int(each) for each, kind in zip(given, self.arguments, strict=True)])
        self._check(given)
        return self._entry(*map(id, given))

    def bound(self, *given: Any) -> Callable[[], Any]:
        """Return a function that runs it on these arrays, checked here once: a call checks them anew, which takes longer than a run of some microseconds.

        The tuples live on in it; their arrays must keep their sizes and types. Raises TypeError as a call does.
        """
        self._check(given)
        entry, places = self._entry, tuple(map(id, given))

        def run(given: Any = given) -> Any:
            return entry(*places)

        return run

    def _check(self, given: Sequence[Any]) -> None:
        arrays = given[0] if len(given) == 1 else [each for work in given for each in work]
        fits = [each.dtype for each in arrays] == self._dtypes and [each.ndim for each in arrays] == self._dimensions
        if not (fits and all([each.flags.c_contiguous for each in arrays])):  # noqa: C419 (a generator is slower)
            raise TypeError(f"Function `{self.py_func.__qualname__}` must be given arrays {self.tuples} in one piece each.")

    def known(self) -> bool:
        """Whether it needs no compiling here."""
        return "_library" in self.__dict__ or self._kept() is not None or self._shipped() is not None

    def ready(self) -> None:
        """Compile it, unless it is."""
        self._entry  # noqa: B018 (what is asked for is made)

    @cached_property
    def address(self) -> int:
        """Address of the machine code that takes a table for each tuple: of each array its address, then its sizes."""
        return int(self._library["on_table"])

    @cached_property
    def _entry(self) -> Callable[..., Any]:
        if self.tuples:
            _check_layout()
            return ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * len(self.tuples))(self._library["run"])
        return ctypes.CFUNCTYPE(*[_IN_C[kind] for kind in (self.gives, *self.arguments)])(self._library["run"])

    @cached_property
    def _library(self) -> Any:
        with COMPILING:
            image = self._kept()
            if image is None:
                image = self._shipped() or object_code(self.text, plain_processor())
                keep(self._path, image)
            return linked(f"{self._name}-{self._stamp}", image, ["run", "on_table"] if self.tuples else ["run"])

    @property
    def _name(self) -> str:
        return f"{self.py_func.__module__}.{self.py_func.__qualname__}"

    @cached_property
    def _stamp(self) -> str:
        return stamp_of(self.py_func, _translator(), repr(self.arguments), machine())[:24]

    @property
    def _path(self) -> Path:
        return cache_directory() / "loops" / f"{self._name}.{self._stamp}.o"

    def _kept(self) -> bytes | None:
        return kept(self._path)

    def _shipped(self) -> bytes | None:
        """The object code that the package holds, of the same text for the same machine; None where there is none."""
        if not SHIPPED.is_dir():  # as in a source tree
            return None
        try:
            content = (SHIPPED / self.shipped_name).read_bytes()
        except OSError:
            return None
        return content[32:] if hashlib.sha256(content[32:]).digest() == content[:32] else None

    @property
    def shipped_name(self) -> str:
        """The name of the file of its object code in a package: of its text and of what makes code of it."""
        return hashlib.sha256(f"{machine()}\n{self.text}".encode()).hexdigest()[:32] + ".o"

    @cached_property
    def text(self) -> str:
        """The module as text of LLVM."""
        from toolbox.translation.llvm_language import LlvmTranslation, type_of

        tuples = [{name: Array(dtype, (None,) * dimensions) for name, (dtype, dimensions) in kinds.items()} for kinds in self.tuples]
        kinds = [Arrays(f"w{k}" if k else "w") for k in range(len(tuples))]
        made = LlvmTranslation(dict(zip(kinds, tuples, strict=True)), {}, {})
        waiting = iter(kinds)
        values = [Value("", next(waiting)) if isinstance(each, Mapping) else _argument(each) for each in self.arguments]
        main = made.written(self.py_func, values)
        result = type_of(main.returns)
        if main.returns not in (self.gives, "none", None):
            raise TypeError(f"Function `{self.py_func.__qualname__}` must give `{self.gives}`, but it gives `{main.returns}`.")
        given = [f"{type_of(value.kind)} %given{i}" for i, value in enumerate(values) if value.kind not in ("none", "b")]
        handed = [
            "i1 true" if value.kind == "b" else f"{type_of(value.kind)} %given{i}" for i, value in enumerate(values) if value.kind != "none"
        ]
        direct = [
            f"define {type_of(self.gives)} @{'on_table' if self.tuples else 'run'}({', '.join(given)}) nounwind noinline {{",
            f"  {'' if result == 'void' else '%done = '}call {result} @{main.name}({', '.join(handed)})",
            f"  ret {type_of(self.gives)} {'0' if result == 'void' else '%done'}",
            "}",
        ]
        head = [*sorted(made.declared), *made.globals, *(function.text for function in made.order), *direct]
        return "\n".join([*head, *(self._reader() if self.tuples else []), METADATA])

    def _reader(self) -> list[str]:
        """What takes tuples of arrays of numpy and calls the loop with the tables of them."""
        given, tables = (", ".join(f"ptr %{word}{k}" for k in range(len(self.tuples))) for word in ("tuple", "table"))
        lines = [f"define i64 @run({given}) nounwind {{"]
        for k, kinds in enumerate(self.tuples):
            lines += [f"  %table{k} = alloca [{sum(1 + dimensions for _, dimensions in kinds.values())} x i64], align 64"]
        items = [(k, j, place) for k, kinds in enumerate(self.tuples) for j, place in enumerate(_places(kinds))]
        for q, ((k, j, place), dimensions) in enumerate(zip(items, self._dimensions, strict=True)):
            lines += [
                f"  %item{q}.at = getelementptr i8, ptr %tuple{k}, i64 {ITEMS + 8 * j}",
                f"  %item{q} = load ptr, ptr %item{q}.at",
                f"  %data{q}.at = getelementptr i8, ptr %item{q}, i64 {DATA}",
                f"  %sizes{q}.at = getelementptr i8, ptr %item{q}, i64 {SIZES}",
                f"  %sizes{q} = load ptr, ptr %sizes{q}.at",
            ]
            sources = [f"%data{q}.at", *(f"%size{q}.{k}.at" for k in range(dimensions))]
            lines += [f"  %size{q}.{k}.at = getelementptr i64, ptr %sizes{q}, i64 {k}" for k in range(dimensions)]
            for d, source in enumerate(sources):
                lines += [
                    f"  %entry{q}.{d} = load i64, ptr {source}",
                    f"  %entry{q}.{d}.at = getelementptr i64, ptr %table{k}, i64 {place + d}",
                    f"  store i64 %entry{q}.{d}, ptr %entry{q}.{d}.at",
                ]
        return [*lines, f"  %done = call i64 @on_table({tables})", "  ret i64 %done", "}"]


def _argument(given: Any) -> Value:
    return known(None) if given is None else Value("", "b" if given is True else given)


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

SHIPPED = Path(__file__).with_name("objects")
"""Where an installed package has the machine code of its loops, if it has it."""


def plain_processor() -> tuple[str, str]:
    """(name, features) of the plain processor of the kind at hand."""
    return ("x86-64" if platform.machine().lower() in ("x86_64", "amd64") else "generic"), ""


@cache
def machine() -> str:
    """What machine code of one text depends on."""
    import llvmlite
    import llvmlite.binding as llvm

    versions = f"{llvmlite.__version__} {llvm.llvm_version_info} {llvm.get_default_triple()} {plain_processor()} {sys.platform}"
    return f"{versions} {ITEMS} {DATA} {SIZES}"


@cache
def _translator() -> str:
    """A number of the text of the translator itself."""
    found = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        found.update(path.read_bytes())
    return found.hexdigest()


@cache
def _check_layout() -> None:
    """Raise RuntimeError where arrays of numpy are not laid out as this file says."""
    tried = (np.zeros((3, 5)), np.zeros(7))
    for array, item in zip(tried, (ctypes.c_void_p * 2).from_address(id(tried) + ITEMS), strict=True):
        data = ctypes.c_void_p.from_address(item + DATA).value
        sizes = (ctypes.c_int64 * array.ndim).from_address(ctypes.c_void_p.from_address(item + SIZES).value or 0)
        if item != id(array) or data != array.ctypes.data or tuple(sizes) != array.shape:
            raise RuntimeError(f"Arrays of numpy {np.__version__} are laid out otherwise than the compiled loops know.")
