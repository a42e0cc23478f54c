"""Compiled loops: functions in a part of Python that is nearly C, translated into the text of LLVM and from there into machine code.

The machine code is for the plain processor of its kind, not for the one at hand, so that it gives the same bits on all of them. It is kept under a number of
everything that enters it (`toolbox.compilation.stamps`): the functions, all that they call and read, the translator, and the version of LLVM. An installed
package can hold it as well (`toolbox.translation.shipped`), under a number of the text of LLVM itself.

A loop takes a named tuple of arrays as it stands: its machine code reads where their data are from the arrays of numpy themselves, which is laid down for
every program in C that uses them.
"""

from __future__ import annotations

import ctypes
import hashlib
import platform
import sys
from collections.abc import Callable, Mapping
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.compilation.emitter import COMPILING, linked, object_code
from toolbox.compilation.kept_code import cache_directory, keep, kept
from toolbox.compilation.stamps import stamp_of
from toolbox.translation.kinds import Array, Value, known

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
        named tuple of arrays its kinds, {field: (dtype, number of dimensions)}. Such a function takes the tuple alone.
    gives
        What it gives, as of an argument.
    """

    def __init__(self, py_func: Any, *arguments: Any, gives: str = "i"):
        self.py_func, self.arguments, self.gives = py_func, arguments, gives
        self.__doc__, self.__module__ = py_func.__doc__, py_func.__module__
        self.kinds: Mapping[str, tuple[str, int]] = next((each for each in arguments if isinstance(each, Mapping)), {})
        self._dtypes = [np.dtype(dtype) for dtype, _ in self.kinds.values()]
        self._dimensions = [dimensions for _, dimensions in self.kinds.values()]

    def __call__(self, *given: Any) -> Any:
        """Run it. Raises TypeError for arrays that are not as was said of them."""
        if not self.kinds:
            return self._entry(*[float(each) if kind == "f" else int(each) for each, kind in zip(given, self.arguments, strict=True)])
        (work,) = given
        self._check(work)
        return self._entry(id(work))

    def bound(self, work: Any) -> Callable[[], Any]:
        """Return a function that runs it on these arrays, checked here once: a call checks them anew, which takes longer than a run of some microseconds.

        The tuple lives on in it; its arrays must keep their sizes and types. Raises TypeError as a call does.
        """
        self._check(work)
        entry = self._entry

        def run(work: Any = work, place: int = id(work)) -> Any:
            return entry(place)

        return run

    def _check(self, work: Any) -> None:
        fits = [each.dtype for each in work] == self._dtypes and [each.ndim for each in work] == self._dimensions
        if not (fits and all([each.flags.c_contiguous for each in work])):  # noqa: C419 (a generator is slower)
            raise TypeError(f"Function `{self.py_func.__qualname__}` must be given arrays {dict(self.kinds)} in one piece each.")

    def known(self) -> bool:
        """Whether it needs no compiling here."""
        return "_library" in self.__dict__ or self._kept() is not None or self._shipped() is not None

    def ready(self) -> None:
        """Compile it, unless it is."""
        self._entry  # noqa: B018 (what is asked for is made)

    @cached_property
    def address(self) -> int:
        """Address of the machine code that takes a table of the arrays: of each its address, then its sizes."""
        return int(self._library["on_table"])

    @cached_property
    def _entry(self) -> Callable[..., Any]:
        if self.kinds:
            _check_layout()
            return ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_void_p)(self._library["run"])
        return ctypes.CFUNCTYPE(*[_IN_C[kind] for kind in (self.gives, *self.arguments)])(self._library["run"])

    @cached_property
    def _library(self) -> Any:
        with COMPILING:
            image = self._kept()
            if image is None:
                image = self._shipped() or object_code(self.text, plain_processor())
                keep(self._path, image)
            return linked(f"{self._name}-{self._stamp}", image, ["run", "on_table"] if self.kinds else ["run"])

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
        from toolbox.translation.llvm_language import METADATA, LlvmTranslation, type_of

        work = {name: Array(dtype, (None,) * dimensions) for name, (dtype, dimensions) in self.kinds.items()}
        made = LlvmTranslation(work, {}, {})
        values = [self._argument(each) for each in self.arguments]
        main = made.written(self.py_func, values)
        result = type_of(main.returns)
        if main.returns not in (self.gives, "none", None):
            raise TypeError(f"Function `{self.py_func.__qualname__}` must give `{self.gives}`, but it gives `{main.returns}`.")
        given = [f"{type_of(value.kind)} %given{i}" for i, value in enumerate(values) if value.kind not in ("none", "b")]
        handed = [
            "i1 true" if value.kind == "b" else f"{type_of(value.kind)} %given{i}" for i, value in enumerate(values) if value.kind != "none"
        ]
        direct = [
            f"define {type_of(self.gives)} @{'on_table' if self.kinds else 'run'}({', '.join(given)}) nounwind noinline {{",
            f"  {'' if result == 'void' else '%done = '}call {result} @{main.name}({', '.join(handed)})",
            f"  ret {type_of(self.gives)} {'0' if result == 'void' else '%done'}",
            "}",
        ]
        head = [*sorted(made.declared), *made.globals, *(function.text for function in made.order), *direct]
        return "\n".join([*head, *(self._reader() if self.kinds else []), METADATA])

    def _argument(self, given: Any) -> Value:
        if isinstance(given, Mapping):
            return Value("w", "w")
        return known(None) if given is None else Value("", "b" if given is True else given)

    def _reader(self) -> list[str]:
        """What takes a tuple of arrays of numpy and calls the loop with the table of them."""
        entries = sum(1 + dimensions for dimensions in self._dimensions)
        lines = ["define i64 @run(ptr %tuple) nounwind {", f"  %table = alloca [{entries} x i64], align 64"]
        place = 0
        for q, dimensions in enumerate(self._dimensions):
            lines += [
                f"  %item{q}.at = getelementptr i8, ptr %tuple, i64 {ITEMS + 8 * q}",
                f"  %item{q} = load ptr, ptr %item{q}.at",
                f"  %data{q}.at = getelementptr i8, ptr %item{q}, i64 {DATA}",
                f"  %sizes{q}.at = getelementptr i8, ptr %item{q}, i64 {SIZES}",
                f"  %sizes{q} = load ptr, ptr %sizes{q}.at",
            ]
            sources = [f"%data{q}.at", *(f"%size{q}.{k}.at" for k in range(dimensions))]
            lines += [f"  %size{q}.{k}.at = getelementptr i64, ptr %sizes{q}, i64 {k}" for k in range(dimensions)]
            for source in sources:
                lines += [
                    f"  %entry{place} = load i64, ptr {source}",
                    f"  %entry{place}.at = getelementptr i64, ptr %table, i64 {place}",
                    f"  store i64 %entry{place}, ptr %entry{place}.at",
                ]
                place += 1
        return [*lines, "  %done = call i64 @on_table(ptr %table)", "  ret i64 %done", "}"]


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
