"""Stick-slip cycles that live side by side: a string may stick and slip in each of its modes, and what begins it decides in which.

At every value stick-slip is begun from a stopped contact, from rest, and from the swing of each mode of the plant, so large that the contact sticks. Where
rounds differ, each of them is carried on to where it ends or turns into another: to the next value at which a run came to such a round, else in small steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from toolbox.measuring.judge import STICKS, Judged
from toolbox.onsets.inside import Inside
from toolbox.onsets.results import Coexisting
from toolbox.simulation.run_state import RunState

UNLIKE = 0.1
"""Part by which the time of a stick or the severity of two rounds differs where they are different cycles."""

FIRST, LONGEST, LAST = 1 / 32, 1 / 8, 1 / 4096
"""Steps, in parts of the range, with which a cycle is carried on: the first, the longest, and the one at which its end is found."""


def coexisting(inside: Inside, values: Sequence[float], at: float) -> tuple[Coexisting, ...]:
    """Return the cycles at the value with most cycles. Of several such values the nearest to the operating point is taken. Empty if no
    value has two cycles."""
    most: list[tuple[str, Judged, RunState]] = []
    where = math.nan
    for value in sorted(values, key=lambda value: abs(value - at)):
        inside.begun_from_all(value)
        found: list[tuple[str, Judged, RunState]] = []
        for begun, judged, end in inside.rounds.get(value, ()):
            if not any(_alike(judged, other) for _, other, _ in found):
                found.append((begun, judged, end))
        if len(found) > max(len(most), 1):
            most, where = found, value
    return tuple(
        Coexisting(
            where,
            _period(judged),
            judged.severity,
            begun,
            *(_carried(inside, where, goal, LONGEST * (values[-1] - values[0]), judged, end) for goal in (values[0], values[-1])),
        )
        for begun, judged, end in most
    )


def _period(judged: Judged) -> float:
    return judged.interval / judged.sticks


def _alike(one: Judged, other: Judged) -> bool:
    """Whether two rounds are of the same cycle."""
    pairs = ((_period(one), _period(other)), (one.severity, other.severity))
    return all(abs(a - b) <= UNLIKE * max(a, b) for a, b in pairs)


def _seen(inside: Inside, here: float, goal: float, most: float, judged: Judged) -> tuple[float, Judged, RunState] | None:
    """The farthest value on the way to another, no farther than `most`, at which a run came to the same round: with the verdict and where the run ended."""
    sign, most = math.copysign(1.0, goal - here), min(most * (1.0 + 1e-9), abs(goal - here))
    there = [value for value in inside.rounds if 0.0 < sign * (value - here) <= most]
    found = [(value, other, end) for value in there for _, other, end in inside.rounds[value] if _alike(other, judged)]
    return max(found, key=lambda each: sign * each[0], default=None)


def _carried(inside: Inside, origin: float, goal: float, most: float, judged: Judged, state: RunState) -> float:
    """How far towards another value a cycle lives on, in steps that are halved where it ends or turns into another.

    most: how far away a value may lie at which the same round was seen.
    """
    here, part, size = origin, 0.0, FIRST
    while part < 1.0 and size >= LAST:
        seen = _seen(inside, here, goal, most, judged)
        if seen is not None:
            here, judged, state = seen
            part = (here - origin) / (goal - origin)
            continue
        following = origin + (goal - origin) * min(part + size, 1.0)
        found, end = inside.search.run(following, inside.search.walked(state, here, following))
        if found.regime == STICKS and end is not None and _alike(found, judged):
            part, here, judged, state, size = min(part + size, 1.0), following, found, end, min(2 * size, LONGEST)
            inside.cycling.setdefault(here, end)
        else:
            size /= 2
    return here
