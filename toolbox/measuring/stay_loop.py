"""The compiled loop over the events of a run for stays and switches, which the lanes share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from toolbox.compilation.numba_cache import cached


class Events(NamedTuple):
    """Recorded events: time, element, and modes before and after."""

    time: np.ndarray
    element: np.ndarray
    modes: np.ndarray


class StayCounts(NamedTuple):
    """Stays and switches, to which is added.

    asked: rows (element, mode, begin, end of the window), one per measure;  since: begin of the current stay of each element;  spent, number, latest,
    switches: seconds, stays, end of the last stay, and switches, one per measure.
    """

    asked: np.ndarray
    since: np.ndarray
    spent: np.ndarray
    number: np.ndarray
    latest: np.ndarray
    switches: np.ndarray


@cached(forceinline=True)
def note_end(i, was, t, switched, since, asked, spent, number, latest, switches):
    """Add a stay of element i in mode `was`, which ends at t, by a switch or with the run."""
    for q in range(asked.shape[0]):
        if asked[q, 0] != i:
            continue
        if switched and asked[q, 2] <= t <= asked[q, 3]:
            switches[q] += 1
        first, last = max(since[i], asked[q, 2]), min(t, asked[q, 3])
        if was == asked[q, 1] and first < last:
            spent[q] += last - first
            if latest[q] != first:  # a stay that is left and taken up at one instant is one
                number[q] += 1
            latest[q] = last
    since[i] = t


@cached
def read_events(events, count, finished, end, m, stays):
    """Stays and switches from `count` recorded events, added to what `stays` holds; when `finished`, the last stays end at `end` in the modes m."""
    asked, since = stays.asked, stays.since
    for e in range(count):
        note_end(
            events.element[e],
            events.modes[e, 0],
            events.time[e],
            True,
            since,
            asked,
            stays.spent,
            stays.number,
            stays.latest,
            stays.switches,
        )
    for i in range(since.size if finished else 0):
        note_end(i, np.int8(m[i]), end, False, since, asked, stays.spent, stays.number, stays.latest, stays.switches)
