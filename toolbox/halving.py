"""Where something begins to hold, and where a function is zero, inside an interval that is made smaller."""

from __future__ import annotations

from collections.abc import Callable, Iterable

ROUND_OFF = 4 * 2.0**-52
"""Relative width below which an interval is not made smaller."""


def halved(holds: Callable[[float], bool], low: float, high: float, relative: float, absolute: float = 0.0) -> tuple[float, float]:
    """Halve an interval until its width is below a tolerance. A condition must hold at the high end of the interval and fail at the low end.

    Parameters
    ----------
    holds
        Function that returns whether the condition holds at a value.
    low, high
        The ends of the interval.
    relative, absolute
        The tolerance is relative * high + absolute. By default absolute is 0.

    Returns
    -------
    float, float
        Low and high end of the last interval.

    Examples
    --------
    >>> from toolbox.authoring import halved
    >>> low, high = halved(lambda speed: speed**2 >= 2.0, 1.0, 2.0, relative=1e-6)
    >>> print(f"{high:.4f}")
    1.4142
    """
    return divided(lambda values: [holds(value) for value in values], low, high, 2, relative, absolute)


def divided(
    hold: Callable[[list[float]], Iterable[bool]], low: float, high: float, parts: int, relative: float, absolute: float = 0.0
) -> tuple[float, float]:
    """Divide an interval like `halved`, but into several parts per step, with all inner points asked in one call. Useful if many values
    side by side cost no more than a single value.

    Parameters
    ----------
    hold
        Whether it holds at each of some values; where it holds at several, the border below the lowest of them is found.
    low, high, relative, absolute
        As of `halved`.
    parts
        Number of parts of each interval, 2 or more.

    Returns
    -------
    tuple
        (low, high) of the last interval.
    """
    while high - low > relative * high + absolute:
        inner = [low + (high - low) * k / parts for k in range(1, parts)]
        first = next((k for k, holds in enumerate(hold(inner)) if holds), parts - 1)
        ends = [low, *inner, high]
        low, high = ends[first], ends[first + 1]
    return low, high


def zero(function: Callable[[float], float], low: float, high: float, absolute: float, relative: float = ROUND_OFF) -> float:
    """Find a zero of a function between two values with opposite signs of the function.

    Each step takes the inverse parabola through the last three points where that is sure to help, else the middle, after T. R. Chandrupatla, Advances in
    Engineering Software 28, 1997, 145-149. `scipy.optimize.brentq` finds the same in about as many steps, but its import
    takes longer than most searches that need no more of scipy.

    Parameters
    ----------
    function
        The function; where it jumps across zero, the place of the jump is found.
    low, high
        The ends of the interval, in any order.
    absolute, relative
        The last interval is no wider than absolute + relative * |value|.

    Returns
    -------
    float
        The end of the last interval at which the function is smaller.

    Raises
    ------
    ValueError
        If the signs at the ends do not differ, or the function is nan on the way.
    """
    a, b = low, high
    f_a, f_b = function(a), function(b)
    if not f_a * f_b <= 0.0:
        raise ValueError(f"The signs of the function must differ at both ends, but it is {f_a:g} at {low:g} and {f_b:g} at {high:g}.")
    part = 0.5
    while True:
        value, best = (a, f_a) if abs(f_a) < abs(f_b) else (b, f_b)
        least = 0.5 * (absolute + max(relative, ROUND_OFF) * abs(value))
        if best == 0.0 or abs(b - a) <= 2.0 * least:
            return value
        at_least = least / abs(b - a)
        at = a + min(max(part, at_least), 1.0 - at_least) * (b - a)
        f_at = function(at)
        if f_at != f_at:
            raise ValueError(f"The function is nan at {at:g}.")
        if (f_at > 0.0) == (f_a > 0.0):
            c, f_c = a, f_a
        else:
            b, f_b, c, f_c = a, f_a, b, f_b
        a, f_a = at, f_at
        share, height = (a - b) / (c - b), (f_a - f_b) / (f_c - f_b)
        part = 0.5
        if height**2 < share and (1.0 - height) ** 2 < 1.0 - share:
            part = f_a / (f_b - f_a) * f_c / (f_b - f_c) + (c - a) / (b - a) * f_a / (f_c - f_a) * f_b / (f_c - f_b)
