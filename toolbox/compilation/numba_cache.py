"""Compiled loops, and what is kept of them on disk, which can never be the machine code of an earlier text.

The cache of numba knows the file of a function, not those whose functions it calls, whose constants it uses and whose tuples it takes. `cached` keeps
the machine code under a number of everything that enters it: the byte code of the function and of all that it calls, however deep and in whatever file;
the values of the constants that these read; the fields of the named tuples that it is given; the options of compiling; the versions of numba, llvmlite,
LLVM and numpy. Nothing has to be declared, so that nothing can be forgotten, and an edited comment compiles nothing anew. A file of the cache carries
its checksum and its name carries that number, so that a damaged file, or one that another process is just writing, is no more than a file that is not there.

Small functions for compiled loops alone are `inlined`: they are a part of each loop and not cached by themselves. Nor are they given what Python would
call them through: for a function of fifty arrays that takes longer to compile than the function. Without it, without machine code of their own
(`toolbox.compilation.loop_parts`) and without counting references, the event loop compiles in a third of the time.
"""

from __future__ import annotations

import contextlib
import dis
import hashlib
import pickle
import sys
from collections.abc import Callable, Iterator
from functools import cache, cached_property
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import llvmlite
import llvmlite.binding
import numba
import numpy as np
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

from toolbox.compilation.kept_code import cache_directory, keep, kept, trusted
from toolbox.compilation.loop_parts import PartCompiler
from toolbox.errors import check_version

check_version("numba")

VERSIONED = {"numba", "llvmlite", "numpy"}
"""Packages whose code enters the number of a function by their version alone, as that of Python does."""

OPTIONS = ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK", "CPU_NAME", "CPU_FEATURES")
"""Settings of numba, of the environment, that change machine code."""


def inlined(function: Any = None, **options: Any) -> Any:
    """A function for compiled loops alone, which becomes a part of each of them; else as `called`."""
    return called(function, forceinline=True, **options)


def called(function: Any = None, **options: Any) -> Any:
    """A function for compiled loops alone that they call: for what is seldom needed, and would only make a loop longer.

    It takes its arrays on loan, without counting references, and makes none, unless it says `_nrt=True`.  options: of `numba.njit`.
    """
    if function is None:
        return lambda given: called(given, **options)
    alone = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "pipeline_class": PartCompiler, "_nrt": False}
    return numba.njit(**{"nogil": True, "error_model": "numpy", **alone, **options})(function)


def cached(function: Any = None, **options: Any) -> Any:
    """Compile a function with numba once per machine, and anew when anything changes that it calls or reads.

    Parameters
    ----------
    function
        The function; without it a decorator is returned.
    options
        Options of `numba.njit`. By default the function runs without the interpreter's lock, and a division by zero gives infinity. With `_nrt=False` it
        takes its arrays on loan, without counting references: it is compiled and called faster, and can make no arrays.
    """
    if function is None:
        return lambda given: cached(given, **options)
    made = numba.njit(**{"nogil": True, "error_model": "numpy", **options})(function)
    if not isinstance(made, FunctionType):  # else numba is told not to compile
        made._cache = MachineCode(made)
    return made


KEPT = 4
"""Texts of one function whose machine code is kept, the last ones used: several installations share a machine."""


class MachineCode(_Cache):
    """What is kept on disk of one cached function, for all installations on a machine: a file for every text and signature."""

    def __init__(self, dispatcher: Any):
        self._dispatcher = dispatcher
        self._base = f"{dispatcher.py_func.__module__}.{dispatcher.py_func.__qualname__}".replace("<", "").replace(">", "")
        self._base += f".{sys.implementation.cache_tag}"
        self._enabled = True

    @property
    def cache_path(self) -> str:
        """The folder."""
        return str(_folder())

    def enable(self) -> None:
        """Keep code and take what is kept."""
        self._enabled = True

    def disable(self) -> None:
        """Neither keep code nor take it."""
        self._enabled = False

    def known(self) -> bool:
        """Whether this machine has machine code of the function as it is, for some signature."""
        return bool(self._files(self._stamp)) and trusted(_folder())

    @cached_property
    def _stamp(self) -> str:
        """The number of the text, which is fixed from the first time that code is asked for."""
        return stamp(self._dispatcher)[:16]

    def _files(self, stamped: str = "*") -> list[Path]:
        """Files of the function, of all its texts or of one."""
        return list(_folder().glob(f"{self._base}.{stamped}.*.code"))

    def _path(self, signature: Any, codegen: Any) -> Path:
        fields = [(kind.instance_class.__qualname__, kind.instance_class._fields) for kind in signature if hasattr(kind, "instance_class")]
        key = hashlib.sha256(repr((signature, fields, codegen.magic_tuple())).encode()).hexdigest()
        return _folder() / f"{self._base}.{self._stamp}.{key[:16]}.code"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The machine code that is kept for a signature, or None.

        Numba's own cache gets ready to compile first, which takes a quarter of a second that a loop which is kept does not need; where there is none, numba
        does so when it begins to compile.
        """
        if not self._enabled:
            return None
        code = kept(self._path(sig, target_context.codegen()))
        if code is None:
            return None
        rtsys.initialize(target_context)
        return CompileResult._rebuild(target_context, *pickle.loads(code))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code of a signature."""
        if not self._enabled or data.library.has_dynamic_globals:
            return
        if keep(self._path(sig, data.codegen), dumps(data._reduce())):
            with contextlib.suppress(OSError):
                self._make_room()

    def _make_room(self) -> None:
        texts: dict[str, float] = {}
        files = [(path, path.name.rsplit(".", 2)[0], path.stat().st_mtime) for path in self._files()]
        for _, text, used in files:
            texts[text] = max(used, texts.get(text, 0.0))
        last = sorted(texts, key=texts.__getitem__)[-KEPT:]
        for path, text, _ in files:
            if text not in last:
                path.unlink(missing_ok=True)

    def flush(self) -> None:
        """Forget what is kept."""
        for path in self._files():
            path.unlink(missing_ok=True)


def _folder() -> Path:
    return cache_directory() / "loops"


def known(function: Any) -> bool:
    """Whether a cached function needs no compiling here."""
    if getattr(function, "signatures", True):
        return True
    return isinstance(function._cache, MachineCode) and function._cache.known()


def stamp(function: Any) -> str:
    """A number, in hexadecimal digits, of everything that enters the machine code of a function of numba."""
    found = hashlib.sha256(repr(_versions()).encode())
    for text in sorted(f"{name} {digest}" for name, digest in ((_name(each), _digest(each)) for each in followed(function))):
        found.update(text.encode() + b"\n")
    return found.hexdigest()


def followed(function: Any) -> list[Any]:
    """The function itself and all that it calls, however deep: Python functions, functions of numba, and its intrinsics."""
    found: dict[int, Any] = {}
    waiting = [function]
    while waiting:
        each = waiting.pop()
        if id(each) not in found:
            found[id(each)] = each
            waiting += [value for _, value in read_outside(_plain(each)) if _plain(value) is not None]
    return list(found.values())


def _versions() -> tuple[Any, ...]:
    settings = [str(getattr(numba.config, name, None)) for name in OPTIONS]
    return sys.version, numba.__version__, llvmlite.__version__, llvmlite.binding.llvm_version_info, np.__version__, settings


def _plain(thing: Any) -> FunctionType | None:
    """The Python function behind a function of numba, an intrinsic or itself; None for anything else, and for what stands in a versioned package."""
    found = getattr(thing, "py_func", None) or getattr(thing, "_defn", None) or thing
    return found if isinstance(found, FunctionType) and not _versioned(found.__module__) else None


def _versioned(module: str | None) -> bool:
    top = (module or "builtins").partition(".")[0]
    return top in VERSIONED or top in sys.stdlib_module_names


def _name(thing: Any) -> str:
    plain = _plain(thing)
    assert plain is not None
    return f"{plain.__module__}.{plain.__qualname__}"


def _digest(thing: Any) -> str:
    """A number of one function: its code, what its constants are and which functions it calls, but not of those."""
    plain = _plain(thing)
    assert plain is not None
    found = hashlib.sha256(repr(sorted(getattr(thing, "targetoptions", {}).items())).encode())
    _add_code(found.update, plain.__code__, plain.__doc__)
    for name, value in read_outside(plain):
        found.update(f"{name} = {_text(value, name, plain)}\n".encode())
    return found.hexdigest()


def _add_code(update: Callable[[bytes], None], code: CodeType, words: str | None = None) -> None:
    """Add the byte code of a function and of those inside it, without file, line numbers and the words that describe it."""
    update(code.co_code + getattr(code, "co_exceptiontable", b""))
    update(repr((code.co_names, code.co_varnames, code.co_freevars, code.co_argcount, code.co_kwonlyargcount, code.co_flags)).encode())
    constants = code.co_consts[1:] if words is not None and code.co_consts[:1] == (words,) else code.co_consts
    for constant in constants:
        if isinstance(constant, CodeType):
            _add_code(update, constant)
        else:
            update(f"{repr(sorted(constant, key=repr)) if isinstance(constant, frozenset) else repr(constant)};".encode())


def read_outside(plain: FunctionType | None) -> Iterator[tuple[str, Any]]:
    """(name, value) of whatever a function reads from outside: globals, also of modules that it names, what it encloses, defaults; containers opened."""
    if plain is None:
        return
    names = _names(plain.__code__)
    waiting = [(name, plain.__globals__[name]) for name in names if name in plain.__globals__]
    waiting += [(name, sys.modules[name]) for name in names if name in sys.modules and name in _imported(plain.__code__)]
    waiting += [(name, cell.cell_contents) for name, cell in zip(plain.__code__.co_freevars, plain.__closure__ or (), strict=True)]
    waiting += [(f"default {k}", value) for k, value in enumerate(plain.__defaults__ or ())]
    waiting += [(f"default {name}", value) for name, value in sorted((plain.__kwdefaults__ or {}).items())]
    while waiting:
        name, value = waiting.pop(0)
        if isinstance(value, ModuleType):
            if not _versioned(value.__name__):
                waiting += [(f"{name}.{word}", vars(value)[word]) for word in names if word in vars(value)]
        elif isinstance(value, (tuple, list)):
            yield f"{name}.length", len(value)
            waiting += [(f"{name}.{k}", entry) for k, entry in enumerate(value)]
        else:
            yield name, value


def _names(code: CodeType) -> list[str]:
    """Names that a function and those inside it use, of globals and attributes."""
    inner = [name for constant in code.co_consts if isinstance(constant, CodeType) for name in _names(constant)]
    return sorted({*code.co_names, *inner})


@cache
def _imported(code: CodeType) -> frozenset[str]:
    """Modules that a function and those inside it import."""
    here = {each.argval for each in dis.get_instructions(code) if each.opname == "IMPORT_NAME"}
    return frozenset(here.union(*[_imported(constant) for constant in code.co_consts if isinstance(constant, CodeType)]))


def _text(value: Any, name: str, user: FunctionType) -> str:
    """A value as text that another value does not have."""
    if _plain(value) is not None:
        return f"function {_name(value)}"
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}"
    if isinstance(value, type):
        return f"class {value.__module__}.{value.__qualname__} {getattr(value, '_fields', '')}"
    if isinstance(value, (int, float, complex, str, bytes, type(None), np.generic)):
        return f"{type(value).__name__} {value!r}"
    if type(value).__module__.partition(".")[0] in VERSIONED:  # types and functions of numba; their text may hold an address
        return f"{type(value).__qualname__} {getattr(value, '__name__', '') or getattr(value, 'name', '')}"
    if callable(value) and _versioned(getattr(value, "__module__", None)):  # functions of Python itself
        return f"function {value.__module__}.{value.__qualname__}"
    raise TypeError(f"Function `{user.__qualname__}` must read constants and functions only, but `{name}` holds a {type(value).__name__}.")
