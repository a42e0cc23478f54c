"""The collector of garbage, which waits while equations and code of a long chain are made."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Iterator


@contextlib.contextmanager
def uncollected() -> Iterator[None]:
    """Nothing is looked through for cycles meanwhile.

    Millions of small objects are made here and few of them are dropped, but the collector looks through all of them again and again: of 1000 inertias that all
    rub this was a seventh of the time to compile, of 3000 a fifth.
    """
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()
