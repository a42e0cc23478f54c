"""Compiled loops, and what is kept of them on disk, which can never be the machine code of an earlier text.

The cache of numba knows the file of a function, not those whose functions it calls, whose constants it uses and whose tuples it takes. `cached` keeps
the machine code under a number of everything that enters it: the byte code of the function and of all that it calls, however deep and in whatever file;
the values of the constants that these read; the fields of the named tuples that it is given; the options of compiling; the versions of numba, llvmlite,
LLVM and numpy. Nothing has to be declared, so that nothing can be forgotten, and an edited comment compiles nothing anew. A file of the cache carries
its checksum and its name carries that number, so that a damaged file, or one that another process is just writing, is no more than a file that is not there.
"""

from __future__ import annotations

import contextlib
import hashlib
import pickle
import sys
from functools import cached_property
from pathlib import Path
from types import FunctionType
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
from toolbox.compilation.stamps import stamp_of
from toolbox.errors import check_version

check_version("numba")

OPTIONS = ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK", "CPU_NAME", "CPU_FEATURES")
"""Settings of numba, of the environment, that change machine code."""


def cached(function: Any = None, **options: Any) -> Any:
    """Compile a function with numba once per machine, and anew when anything changes that it calls or reads.

    Parameters
    ----------
    function
        The function; without it a decorator is returned.
    options
        Options of `numba.njit`. By default the function runs without the interpreter's lock, and a division by zero gives infinity.
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
    return stamp_of(function, *_versions())


def _versions() -> tuple[Any, ...]:
    settings = [str(getattr(numba.config, name, None)) for name in OPTIONS]
    return sys.version, numba.__version__, llvmlite.__version__, llvmlite.binding.llvm_version_info, np.__version__, settings
