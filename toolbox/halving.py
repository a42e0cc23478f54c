"""The border at which something begins to hold."""

from __future__ import annotations

from collections.abc import Callable


def halved(holds: Callable[[float], bool], low: float, high: float, relative: float, absolute: float = 0.0) -> tuple[float, float]:
    """Halve an interval, at whose high end something holds and at whose low end it does not, until its width is a tolerance.

    Returns (low, high). relative: tolerance in parts of `high`;  absolute: what is added to it.
    """
    while high - low > relative * high + absolute:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return low, high
