"""Names of the ways in which a periodic motion begins or ceases to stick somewhere: the sliding bifurcations of Filippov systems.

What the theory of Filippov systems calls sliding, motion within a switching surface, is the mode "stick" of a contact (or a relay in its sliding
mode). Of a periodic motion one segment appears there at a bifurcation, of zero length, and the modes of its neighbours say which it is:

    grazing-sliding     a stick between two slips the same way:        the slip speed touches zero
    crossing-sliding    a stick between slips both ways:               a reversal where the bound just no longer lets it pass
    adding-sliding      a slip between two sticks:                     the force of a stick touches its bound
    switching-sliding   a slip between the other slip and a stick:     a stick that begins at its bound, so that it is first overrun

Source: M. di Bernardo, C. J. Budd, A. R. Champneys, P. Kowalczyk, Piecewise-smooth Dynamical Systems, Springer 2008, chapter 8. They take the
static bound to be the kinetic force; with a higher one the segments appear with a length, and the names are those of the mode sequence.
"""

from __future__ import annotations

import itertools

import numpy as np

from toolbox.simulation.trajectory import Trajectory

Segment = tuple[int, float]
"""A mode and how long it lasts [s]."""


def sliding_kind(one: Trajectory, other: Trajectory) -> str | None:
    """Which sliding bifurcation lies between two runs over a period, by the modes of the only contact or relay whose modes differ.

    None where modes differ in another way: a contact that opens, a switch, two contacts at once, or more than two segments that appear together.
    """
    kinds = set()
    for i, element in enumerate(one.program.system.elements):
        pair = [segments(run, i) for run in (one, other)]
        if _alike(*([mode for mode, _ in each] for each in pair)):
            continue
        if not element.slides:
            return None
        kinds.add(_inserted(*sorted(pair, key=len)))
    return kinds.pop() if len(kinds) == 1 else None


def segments(run: Trajectory, element: int) -> list[Segment]:
    """Modes of an element over one period with their durations [s]; the last and first are merged if equal, because the run is periodic."""
    mode = run.mode[:, element]
    begins = np.concatenate([[0], np.flatnonzero(np.diff(mode)) + 1])
    times = np.append(run.time[begins], run.end)
    return _merged([(int(mode[k]), float(length)) for k, length in zip(begins, np.diff(times), strict=True)])


def _merged(found: list[Segment]) -> list[Segment]:
    """Neighbours of one mode, around the circle, as one segment."""
    merged: list[Segment] = []
    for mode, length in found:
        if merged and merged[-1][0] == mode:
            merged[-1] = (mode, merged[-1][1] + length)
        else:
            merged.append((mode, length))
    if len(merged) > 1 and merged[0][0] == merged[-1][0]:
        mode, length = merged.pop()
        merged[0] = (mode, merged[0][1] + length)
    return merged


def _alike(one: list[int], other: list[int]) -> bool:
    """Whether two sequences are the same around a circle."""
    return len(one) == len(other) and any(one[i:] + one[:i] == other for i in range(len(one)))


def _inserted(fewer: list[Segment], more: list[Segment]) -> str | None:
    """The kind of the one segment, or of the two at once that a symmetric motion has, without which the longer sequence is the shorter one.

    Where several fit, those that last the shortest: they have just appeared.
    """
    wanted = [mode for mode, _ in fewer]
    fitting = []
    for count in (1, 2):
        for gone in itertools.combinations(range(len(more)), count):
            left = _merged([segment for k, segment in enumerate(more) if k not in gone])
            if left and _alike([mode for mode, _ in left], wanted):
                fitting.append((sum(more[k][1] for k in gone), [_kind(more, k) for k in gone]))
    _, kinds = min(fitting, key=lambda each: each[0], default=(0.0, [None]))
    return kinds[0] if len(set(kinds)) == 1 else None


def _kind(around: list[Segment], k: int) -> str | None:
    before, mode, after = around[k - 1][0], around[k][0], around[(k + 1) % len(around)][0]
    if mode == 0:
        return "grazing-sliding" if before == after else "crossing-sliding"
    if before == after == 0:
        return "adding-sliding"
    return "switching-sliding" if (before, after) == (-mode, 0) else None
