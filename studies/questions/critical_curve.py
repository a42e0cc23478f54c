"""Where does stick-slip end in a plane of two parameters? The edge is followed and bisected, whatever decides."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from toolbox import SceneError


def critical_curve(
    decide: Callable[[float, float], float], along: Sequence[float], between: tuple[float, float], tolerance: float = 1e-4
) -> np.ndarray:
    """y at which `decide(x, y)` changes sign, for every x in `along`; nan where it does not change between the bounds. Shape (len(along),).

    decide: > 0 with stick-slip, <= 0 without; any two numbers of any machine.  between: bounds of y, both > 0.  tolerance: of log y. The edge is followed:
    each search starts around the last one and widens, then scipy bisects. Raises SceneError for bounds that are not 0 < low < high.
    """
    from scipy.optimize import bisect

    low, high = between
    if not 0 < low < high:
        raise SceneError(f"Argument `between` must be two numbers with 0 < low < high, but it is {between!r}.")
    curve = np.full(len(along), math.nan)
    last: float | None = None
    for i, x in enumerate(along):

        def sign(log_y: float, x: float = x) -> float:
            return 1.0 if decide(x, math.exp(log_y)) > 0 else -1.0

        bracket = _bracket(sign, math.log(low), math.log(high), last)
        if bracket is None:
            continue
        last = bisect(sign, *bracket, xtol=tolerance)
        curve[i] = math.exp(last)
    return curve


def _bracket(sign: Callable[[float], float], low: float, high: float, last: float | None) -> tuple[float, float] | None:
    """Two places between low and high where the sign differs, near `last` if there is one."""
    width = (high - low) / 16 if last is not None else high - low
    while True:
        a, b = (max(low, last - width), min(high, last + width)) if last is not None else (low, high)
        if sign(a) != sign(b):
            return a, b
        if (a, b) == (low, high):
            return None
        width *= 4
