"""What numba keeps on disk of the compiled loops, and when it is made anew.

Numba's cache sees edits of the file of a function, not of those whose functions it calls. A loop that calls functions of another file is made by a
function of the `checksum` of that file, which so enters the key of its cache; its own small functions are not cached by themselves.

Nor are they given what Python would call them through: for a function of fifty arrays that takes longer to compile than the function. Without it the
event loop compiles in two thirds of the time.
"""

from __future__ import annotations

import zlib
from pathlib import Path
from types import ModuleType
from typing import Any


def inlined(function: Any) -> Any:
    """A function for compiled loops alone, which becomes a part of each of them."""
    from numba import njit

    return njit(nogil=True, error_model="numpy", forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)(function)


def checksum(*modules: ModuleType) -> int:
    """A number >= 0 of the texts of the files of some modules."""
    found = 0
    for module in modules:
        assert module.__file__ is not None
        found = zlib.crc32(Path(module.__file__).read_bytes(), found)
    return found & 0x7FFFFFFF
