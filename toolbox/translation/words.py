"""The words of the loops that are translated: what stands in their text for what Python has no word for, and the marks of their functions.

None of them does anything in Python: the functions that they stand in are translated (`toolbox.translation.compiled`).
"""

from __future__ import annotations

from typing import Any


def call(address: Any, t: Any, h: Any, x: Any, k: Any, p: Any, m: Any, y: Any) -> None:
    """Call void f(double, double, x, k, p, m, y) at a raw address; the arrays are passed by their data pointers, and hold real numbers."""
    raise TypeError("Only a compiled loop can call machine code.")


def call_code(address: Any, *arrays: Any) -> None:
    """Call void f(arrays ...) at a raw address; the arrays are passed by their data pointers, and any array may be changed."""
    raise TypeError("Only a compiled loop can call machine code.")


def call_loop(address: Any, w: Any) -> int:
    """Call another compiled loop at its `Compiled.address` with a tuple of arrays, and return its result."""
    raise TypeError("Only a compiled loop can call another one.")
