"""Sticks of a contact: their begin and end, which of them count, and their fraction of the time; the only place that defines a stick.

A run records the mode of each contact, and its switches as located events. A stick is a stay in the mode "stick" that `lasts`; compiled loops ask the same
function. Sticks up to `shortest_stick` are round-off: `is_stick` and `lasting` leave them out. A contact that sticks in practically all of a time `stands`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from toolbox.files.units import NumberOrText
from toolbox.simulation.recorded import Recorded
from toolbox.simulation.samples import window

STICK = "stick"
"""Mode of a contact that sticks."""

SHORTEST = 1e-6
"""Time in stick, as a fraction of the time that is judged, up to which it is round-off: the contact touched zero speed and did not stick."""

STANDING = 0.999
"""Fraction of a time in stick from which on a contact stands in all of it."""


# --------------------------------------------------------------------------------------------------------------------------- begin, end and time
def lasts(begin, end):
    """Return whether a stay in a mode counts, by its begin and end in the window [s]. Compiled loops ask this function, too."""
    return begin < end


def joined(stays: Iterable[Sequence[float]]) -> list[tuple[float, float]]:
    """Return stays (begin, end) in order, with those joined that touch: a release that is taken back at once does not part two sticks."""
    found: list[tuple[float, float]] = []
    for begin, end in stays:
        if found and begin <= found[-1][1]:
            found[-1] = (found[-1][0], end)
        else:
            found.append((begin, end))
    return found


def stick_intervals(
    run: Recorded, element: str, after: NumberOrText = 0.0, until: NumberOrText | None = None, *, mode: str = STICK
) -> list[tuple[float, float]]:
    """Return begin and end [s] of every stick phase of a contact in a window.

    Begin and end are located events, not recorded samples. Phases that reach over an end of the window are cut there.

    Parameters
    ----------
    run
        The run.
    element
        Name of the contact, such as "bit".
    after, until
        Begin and end of the window [s]. By default the whole run.
    mode
        The mode whose phases are returned, by default "stick". Another example is "closed" for a wall.

    Returns
    -------
    list of (float, float)
        Begin and end [s] of every phase, in order.

    Raises
    ------
    SceneError
        If the element is unknown or has no such mode, or the window lies outside the run.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, measure, simulate
    >>> run = simulate(compose(BlockOnBelt()), "60 s")
    >>> for begin, end in measure.stick_intervals(run, "belt", after=20.0, until=50.0):
    ...     print(f"{begin:.2f} s to {end:.2f} s")
    21.44 s to 29.14 s
    33.44 s to 41.14 s
    45.44 s to 50.00 s
    """
    first, last = window(run, after, until)
    cut = ((max(begin, first), min(end, last)) for begin, end in run._stays_in(element, mode))
    return joined(stay for stay in cut if lasts(*stay))


def stick_time(run: Recorded, element: str, after: NumberOrText = 0.0, until: NumberOrText | None = None, *, mode: str = STICK) -> float:
    """Return the time that a contact spends in stick [s]; the arguments are those of `stick_intervals`."""
    return run.time_in(element, mode, *window(run, after, until))


def stuck_ratio(run: Recorded, element: str, after: NumberOrText = 0.0, until: NumberOrText | None = None) -> float:
    """Measure the fraction of the time during which a contact sticks, from 0 to 1.

    Parameters
    ----------
    run
        The run.
    element
        Name of the contact, such as "bit".
    after, until
        Begin and end of the window [s]. By default the whole run.

    Returns
    -------
    float
        Time in stick divided by the length of the window [1].

    Raises
    ------
    SceneError
        If the element is unknown or never sticks by its kind, or the window lies outside the run.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, measure, simulate
    >>> run = simulate(compose(BlockOnBelt()), "60 s")
    >>> print(f"{measure.stuck_ratio(run, 'belt', after=20.0):.3f}")
    0.642
    """
    begin, end = window(run, after, until)
    return stick_time(run, element, begin, end) / (end - begin)


def releases(run: Recorded, element: str, after: NumberOrText = 0.0, until: NumberOrText | None = None) -> list[float]:
    """Return the times [s] at which a contact is released from stick, in order; the arguments are those of `stick_intervals`."""
    begin, end = window(run, after, until)
    return [last for _, last in stick_intervals(run, element, begin, end) if last < end]


# ------------------------------------------------------------------------------------------------------------------------------------ thresholds
def shortest_stick(whole: float, accuracy: float = 0.0) -> float:
    """Return the time in stick [s] of a whole time up to which a contact only touches zero speed; a run resolves no less than ten times its accuracy."""
    return max(10 * accuracy, SHORTEST) * whole


def is_stick(stuck: Any, whole: float = 1.0) -> Any:
    """Return whether a contact sticks, by the time it spends in stick. Arrays are answered element by element.

    Parameters
    ----------
    stuck
        Time in stick [s], or a fraction of the whole.
    whole
        The time that is judged [s], such as a window; 1 for a fraction.
    """
    return stuck > shortest_stick(whole)


def lasting(sticks: Iterable[tuple[float, float]], whole: float) -> list[tuple[float, float]]:
    """Return the sticks (begin, end) that are longer than round-off of a whole time [s]."""
    return [(begin, end) for begin, end in sticks if is_stick(end - begin, whole)]


def stands(share: Any) -> Any:
    """Return whether a contact stands in a time: whether it sticks in practically all of it.

    Parameters
    ----------
    share
        Share of the time in which the contact sticks [1], a number or an array.

    Returns
    -------
    bool or np.ndarray
        True from a share of 0.999 on, element by element.

    Examples
    --------
    >>> from toolbox.authoring import stands
    >>> print(f"{stands(1.0):d} of the first, {stands(0.4):d} of the second")
    1 of the first, 0 of the second
    """
    return share >= STANDING
