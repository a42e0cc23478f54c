"""The border at which something begins to hold."""

from __future__ import annotations

from collections.abc import Callable


def halved(holds: Callable[[float], bool], low: float, high: float, relative: float, absolute: float = 0.0) -> tuple[float, float]:
    """Halve an interval, at whose high end something holds and at whose low end it does not, until its width is a tolerance.

    Parameters
    ----------
    holds
        Whether it holds at a value.
    low, high
        The ends of the interval.
    relative, absolute
        The tolerance is relative * high + absolute.

    Returns
    -------
    tuple
        (low, high) of the last interval.
    """
    while high - low > relative * high + absolute:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return low, high
