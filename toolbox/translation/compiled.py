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
import platform
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.compilation.emitter import COMPILING, compiler, linked, object_code
from toolbox.compilation.kept_code import cache_directory, keep, kept
from toolbox.compilation.stamps import stamp_of
from toolbox.translation.array_layout import ARRAY, HEADER, ITEMS, UNFIT, check_layout

KEPT = 8
"""Texts of the functions of one name whose machine code is kept, the last ones used: several installations share a machine."""

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

    Examples
    --------
    >>> from toolbox.authoring import Compiled
    >>> from toolbox.stepping.noise import uniform
    >>> random_number = Compiled(uniform, "u", "i", gives="f")
    >>> print(f"{random_number(7, 0):.4f}")
    0.3898
    """

    def __init__(self, py_func: Any, *arguments: Any, gives: str = "i"):
        self.py_func, self.arguments, self.gives = py_func, arguments, gives
        self.__doc__, self.__module__ = py_func.__doc__, py_func.__module__
        self.tuples: list[Mapping[str, tuple[str, int]]] = [each for each in arguments if isinstance(each, Mapping)]

    def __call__(self, *given: Any) -> Any:
        """Run it. Raises TypeError for arrays that are not as was said of them."""
        if not self.tuples:
            return self._entry(*[float(each) if kind == "f" else int(each) for each, kind in zip(given, self.arguments, strict=True)])
        done = self._entry(ARRAY, *map(id, given)) if all([isinstance(each, tuple) for each in given]) else UNFIT  # noqa: C419 (a generator is slower)
        if done == UNFIT:
            views = self._viewed(given)  # which live as long as the call
            done = self._entry(ARRAY, *map(id, views))
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
            check_layout()
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
        from toolbox.translation.llvm_module import module_text

        return module_text(self.py_func, self.arguments, self.gives)


SHIPPED = Path(__file__).with_name("objects")
"""Where an installed package has the machine code of its loops, if it has it."""


def plain_processor() -> tuple[str, str]:
    """(name, features) of the plain processor of the kind at hand."""
    return ("x86-64" if platform.machine().lower() in ("x86_64", "amd64") else "generic"), ""


@cache
def machine() -> str:
    """Return a text with everything but the source that determines the machine code: compiler, processor, platform and array layout."""
    return f"{compiler()} {plain_processor()} {sys.platform} {HEADER} {ITEMS}"


@cache
def _translator() -> str:
    """A number of the text of the translator itself."""
    found = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        found.update(path.read_bytes())
    return found.hexdigest()
