"""The words of the loops that are translated: what stands in their text for what Python has no word for, and the marks of their functions.

None of them does anything in Python: the functions that they stand in are translated (`toolbox.translation.compiled`).
"""

from __future__ import annotations

from typing import Any, TypeVar

Function = TypeVar("Function")

PARTS = "part_of_a_loop"
"""The attribute of a function that is a part of loops: how numba takes it in where one of its loops needs it, too."""


def inlined(function: Function) -> Function:
    """A function that becomes a part of each loop that calls it."""
    setattr(function, PARTS, "inlined")
    return function


def called(function: Function) -> Function:
    """A function that loops call: for what is seldom needed, and would only make a loop longer."""
    setattr(function, PARTS, "called")
    return function


def call(address: Any, t: Any, h: Any, x: Any, k: Any, p: Any, m: Any, y: Any) -> None:
    """Call void f(double, double, x, k, p, m, y) at a raw address; the arrays are passed by their data pointers."""
    raise TypeError("Only a compiled loop can call machine code.")


def lent(arrays: Any) -> Any:
    """The arrays for functions that become a part of the loop: of use to numba alone (`toolbox.compilation.calls`)."""
    return arrays


def owned(arrays: Any) -> Any:
    """Lent arrays for a function that is called: of use to numba alone (`toolbox.compilation.calls`)."""
    return arrays
