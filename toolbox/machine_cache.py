"""What numba keeps on disk of the compiled loops: when it is made anew, and what is said while it is.

Numba's cache sees edits of the file of a function, not of those whose functions it calls. A loop that calls functions of another file is made by a
function of the `checksum` of that file, which so enters the key of its cache; its own small functions are not cached by themselves.
"""

from __future__ import annotations

import sys
import zlib
from pathlib import Path
from types import ModuleType
from typing import Any


def checksum(*modules: ModuleType) -> int:
    """A number >= 0 of the texts of the files of some modules."""
    found = 0
    for module in modules:
        assert module.__file__ is not None
        found = zlib.crc32(Path(module.__file__).read_bytes(), found)
    return found & 0x7FFFFFFF


_ANNOUNCED: list[Any] = []


def announce(function: Any, name: str) -> bool:
    """Say on stderr that this machine has to compile a loop before it is used for the first time; returns whether this is its first use in this process."""
    if function in _ANNOUNCED:
        return False
    _ANNOUNCED.append(function)
    try:
        target = function.targetctx.codegen().magic_tuple()
        known = any(target in key for key in function._cache._cache_file._load_index())
    except AttributeError:  # another version of numba keeps its index elsewhere
        known = True
    if not known:
        print(f"stickslip: compiling the {name}, once per machine (up to a minute) ...", file=sys.stderr, flush=True)
    return True
