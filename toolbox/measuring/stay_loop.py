"""The compiled loop over the events of a run for stays and switches, which the lanes share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from toolbox.measuring.sticks import lasts
from toolbox.translation.compiled import Compiled


class Stays(NamedTuple):
    """Recorded events, and the arrays of stays and switches to which the loop adds them.

    ints: (number of events, whether the run has ended);  end: its end, in an array;  time, element, modes: of each event, with the modes before and after;
    m: modes at the end;  asked: rows (element, mode, begin, end of the window), one per measure;  since: begin of the current stay of each element;  spent,
    number, latest, switches: seconds, stays, end of the last stay, and switches, one per measure.
    """

    ints: np.ndarray
    end: np.ndarray
    time: np.ndarray
    element: np.ndarray
    modes: np.ndarray
    m: np.ndarray
    asked: np.ndarray
    since: np.ndarray
    spent: np.ndarray
    number: np.ndarray
    latest: np.ndarray
    switches: np.ndarray


KINDS: dict[str, tuple[str, int]] = dict.fromkeys(Stays._fields, ("float64", 1)) | {
    "ints": ("int64", 1), "element": ("int32", 1), "modes": ("int8", 2), "asked": ("float64", 2),
}  # fmt: skip


def note_end(given, i, was, t, switched, since, spent, number, latest, switches):
    """Add a stay of element i in mode `was`, which ends at t, by a switch or with the run; given: holds what is `asked`."""
    for q in range(given.asked.shape[0]):
        if given.asked[q, 0] != i:
            continue
        if switched and given.asked[q, 2] <= t <= given.asked[q, 3]:
            switches[q] += 1
        first, last = max(since[i], given.asked[q, 2]), min(t, given.asked[q, 3])
        if was == given.asked[q, 1] and lasts(first, last):
            spent[q] += last - first
            if latest[q] != first:  # a stay that is left and taken up at one instant is one
                number[q] += 1
            latest[q] = last
    since[i] = t


def _read_events(w):
    """Stays and switches from the recorded events, added to what `w` holds; where the run has ended, the last stays end with it."""
    for e in range(w.ints[0]):
        note_end(w, w.element[e], w.modes[e, 0], w.time[e], True, w.since, w.spent, w.number, w.latest, w.switches)
    for i in range(w.since.size if w.ints[1] != 0 else 0):
        note_end(w, i, np.int8(w.m[i]), w.end[0], False, w.since, w.spent, w.number, w.latest, w.switches)


read_events = Compiled(_read_events, KINDS)
