"""Compiled loops: functions in a part of Python that is nearly C, translated into the text of LLVM and from there into machine code.

The machine code is for the plain processor of its kind, not for the one at hand, so that it gives the same bits on all of them. It is kept under a number of
everything that enters it (`toolbox.compilation.stamps`): the functions, all that they call and read, the translator, and the version of LLVM. An installed
package can hold it as well (`toolbox.translation.shipped`), under a number of the text of LLVM itself.

A loop takes named tuples of arrays as they stand: its machine code reads what they are, and where their data are, from the arrays of numpy themselves, which
is laid down for every program in C that uses them.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import itertools
import platform
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.compilation.emitter import COMPILING, linked, object_code
from toolbox.compilation.stamps import stamp_of
from toolbox.files.kept_code import cache_directory, keep, kept
from toolbox.translation.kinds import Array, Arrays, Value, known

HEADER = object.__basicsize__
"""Bytes of what begins every object of Python, with its type at their end; behind it an array of numpy has what the next lines say."""

TYPE, DATA, DIMENSIONS, SIZES, DTYPE, FLAGS = HEADER - 8, HEADER, HEADER + 8, HEADER + 16, HEADER + 40, HEADER + 48
ORDER, NUMBER = HEADER + 10, HEADER + 12
"""Of a type of numbers: the order of its bytes, and which one it is."""

ITEMS = tuple.__basicsize__
UNFIT = -(2**63)
"""What a loop gives where its arrays are not of the kinds that were said."""

KEPT = 8
"""Texts of the functions of one name whose machine code is kept, the last ones used: several installations share a machine."""

_ARRAY = id(np.ndarray)

_IN_C: dict[Any, Any] = {"f": ctypes.c_double, "i": ctypes.c_int64, "u": ctypes.c_uint64, "b": ctypes.c_bool}


class Compiled:
    """Python function that is compiled to machine code at its first call.

    Parameters
    ----------
    py_func
        The function. All functions that it calls must be in files of the toolbox.
    arguments
        Kind of each argument of the function: "f", "i" or "u" for a real number, an integer or an unsigned integer;
        None or True for a condition that is known when the function is compiled; {field: (dtype, number of dimensions)}
        for a named tuple of arrays. A function of named tuples takes only named tuples and returns an integer.
    gives
        Kind of the result of the function, as for an argument, by default "i".
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
        done = self._entry(_ARRAY, *map(id, given)) if all([isinstance(each, tuple) for each in given]) else UNFIT  # noqa: C419 (a generator is slower)
        if done == UNFIT:
            views = self._viewed(given)  # which live as long as the call
            done = self._entry(_ARRAY, *map(id, views))
        return done

    def bound(self, *given: Any) -> Callable[[], int]:
        """Return a function without arguments that calls the machine code on these arrays, for an object that owns the arrays permanently.

        The arrays are checked once here, and not in every call. Raises TypeError if an array does not fit.
        """
        views = self._viewed(given)
        tables = [np.array([entry for array in work for entry in (array.ctypes.data, *array.shape)], np.int64) for work in views]
        entry = ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * len(tables))(self.address)
        run = partial(entry, *[table.ctypes.data for table in tables])
        run.kept = self, views, tables  # type: ignore[attr-defined]  # which live as long as the call
        return run

    def _viewed(self, given: Sequence[Any]) -> list[tuple[Any, ...]]:
        """Plain arrays of the kinds that were said on the memory of others, such as those of a file; raises TypeError where they cannot be that."""
        plain = all(isinstance(each, np.ndarray) and each.flags.c_contiguous for work in given for each in work)
        wanted = [[(np.dtype(dtype), dimensions) for dtype, dimensions in kinds.values()] for kinds in self.tuples]
        if not (plain and [[(each.dtype, each.ndim) for each in work] for work in given] == wanted):
            raise TypeError(f"Function `{self.py_func.__qualname__}` must be given arrays {self.tuples} in one piece each.")
        views = [[np.asarray(each).view(dtype) for each, (dtype, _) in zip(*pair, strict=True)] for pair in zip(given, wanted, strict=True)]
        return [tuple(each) for each in views]

    def known(self) -> bool:
        """Return whether the machine code exists already, so that a call need not compile it."""
        return "_library" in self.__dict__ or self._kept() is not None or self._shipped() is not None

    def ready(self) -> None:
        """Compile the function, if its machine code does not exist already."""
        self._entry  # noqa: B018 (what is asked for is made)

    @cached_property
    def address(self) -> int:
        """Address of the machine code. The machine code takes one table for each named tuple, which holds for each array its address and its sizes."""
        return int(self._library["on_table"])

    @cached_property
    def _entry(self) -> Callable[..., Any]:
        if self.tuples:
            _check_layout()
            return ctypes.CFUNCTYPE(ctypes.c_int64, *[ctypes.c_void_p] * (1 + len(self.tuples)))(self._library["run"])
        return ctypes.CFUNCTYPE(*[_IN_C[kind] for kind in (self.gives, *self.arguments)])(self._library["run"])

    @cached_property
    def _library(self) -> Any:
        with COMPILING:
            image = self._kept()
            if image is None:
                image = self._shipped() or object_code(self.text, plain_processor())
                if keep(self._path, image):
                    self._make_room()
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

    def _make_room(self) -> None:
        """Forget all but the last `KEPT` texts."""
        with contextlib.suppress(OSError):
            for path in sorted(self._path.parent.glob(f"{self._name}.*.o"), key=lambda path: path.stat().st_mtime)[:-KEPT]:
                path.unlink()

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
        """File name of the object code of this function in an installed package. The name depends on `text` and on the compiler."""
        return hashlib.sha256(f"{machine()}\n{self.text}".encode()).hexdigest()[:32] + ".o"

    @cached_property
    def text(self) -> str:
        """The function as text of an LLVM module."""
        from toolbox.translation.llvm_language import LlvmTranslation, type_of

        tuples = [{name: Array(dtype, (None,) * dimensions) for name, (dtype, dimensions) in kinds.items()} for kinds in self.tuples]
        kinds = [Arrays(f"w{k}" if k else "w") for k in range(len(tuples))]
        made = LlvmTranslation(dict(zip(kinds, tuples, strict=True)), {}, {})
        waiting = iter(kinds)
        short = {None: known(None), True: Value("", "b")}
        values = [Value("", next(waiting)) if isinstance(each, Mapping) else short.get(each) or Value("", each) for each in self.arguments]
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
        """What takes the type of arrays and tuples of them, looks whether they are as was said, and calls the loop with the tables of them."""
        given, tables = (", ".join(f"ptr %{word}{k}" for k in range(len(self.tuples))) for word in ("tuple", "table"))
        lines = [f"define i64 @run(ptr %array, {given}) nounwind {{"]
        for k, kinds in enumerate(self.tuples):
            lines += [f"  %table{k} = alloca [{sum(1 + dimensions for _, dimensions in kinds.values())} x i64], align 64"]
        items = [(k, j, place) for k, kinds in enumerate(self.tuples) for j, place in enumerate(_places(kinds))]
        read = _Reader(lines)
        for k, kinds in enumerate(self.tuples):
            read.expect(read.entry(f"%tuple{k}", HEADER, "i64"), "i64", len(kinds))
        read.settle()
        arrays = [read.entry(f"%tuple{k}", ITEMS + 8 * j) for k, j, _ in items]
        for array in arrays:
            read.expect(read.entry(array, TYPE), "ptr", "%array")
        read.settle()
        for array, dtype, dimensions in zip(arrays, self._dtypes, self._dimensions, strict=True):
            read.expect(read.entry(array, DIMENSIONS, "i32"), "i32", dimensions)
            number = read.entry(array, DTYPE)
            read.expect(read.entry(number, NUMBER, "i32"), "i32", dtype.num)
            read.expect(read.entry(number, ORDER, "i8"), "i8", ord(dtype.byteorder))
            read.expect(read.new(f"and i32 {read.entry(array, FLAGS, 'i32')}, 1"), "i32", 1)  # in one piece
        read.settle()
        for array, (k, _, place), dimensions in zip(arrays, items, self._dimensions, strict=True):
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
        """What stands so many bytes behind a place."""
        return self.new(f"load {kind}, ptr {self.new(f'getelementptr i8, ptr {pointer}, i64 {offset}')}")

    def expect(self, value: str, kind: str, wanted: int | str) -> None:
        """Look whether a value is the wanted one."""
        self.fits = self.new(f"and i1 {self.fits}, {self.new(f'icmp eq {kind} {value}, {wanted}')}")

    def settle(self) -> None:
        """Go on only where all was as expected: what follows is read from objects that are known by then."""
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
    return f"{versions} {HEADER} {ITEMS}"


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
    tried: tuple[np.ndarray, ...] = (np.zeros((3, 5)), np.zeros(7, np.int8), np.zeros((4, 4))[:, 1:])
    for array, item in zip(tried, (ctypes.c_void_p * 3).from_address(id(tried) + ITEMS), strict=True):
        data, sizes, dtype = (ctypes.c_void_p.from_address(item + at).value or 0 for at in (DATA, SIZES, DTYPE))
        dimensions, flags = (ctypes.c_int32.from_address(item + at).value for at in (DIMENSIONS, FLAGS))
        found = (item, data, dimensions, flags & 1, ctypes.c_void_p.from_address(item + TYPE).value)
        if found != (id(array), array.ctypes.data, array.ndim, array.flags.c_contiguous, _ARRAY) or (
            tuple((ctypes.c_int64 * array.ndim).from_address(sizes)) != array.shape
            or ctypes.c_int32.from_address(dtype + NUMBER).value != array.dtype.num
            or ctypes.c_char.from_address(dtype + ORDER).value.decode() != array.dtype.byteorder
        ):
            raise RuntimeError(f"Arrays of numpy {np.__version__} are laid out otherwise than the compiled loops know.")
