"""Records of chains of many states, which would fill the memory: of the steps between events only every second, third ... stays.

A step is told by its begin and its end. So the ends of all steps are kept, and what is between two nodes is found by the same steps again, as exactly as where
every step is a node.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from toolbox.compilation import work_layout

MOST = 2**28
"""Size of the states recorded [bytes] from which on not every step is."""

WIDE = 100
"""States beyond which a node takes so much more memory than the end of a step."""

ROWS = 256
"""Nodes that are moved together."""


class ThinRecords:
    """The records of a run under way.

    Attributes
    ----------
    every
        How many steps go to a node, between events.
    stay
        The time of a node that stays, because from there on the steps are others.
    """

    def __init__(self) -> None:
        self.every, self.stay, self._old = 1, math.nan, 0
        self._passed: list[np.ndarray] = []

    def told(self, run: Any) -> Any:
        """The trajectory so far with the ends of the steps that are no nodes."""
        if self._passed:
            passed = np.sort(np.concatenate(self._passed))
            run.passed = passed[passed < run.end]
        return run

    def thinned(self, work: Any) -> bool:
        """Whether there is room again in arrays of records that are full, because nodes have been left out.

        Those on both sides of an event stay, and those from which on something else is held.
        """
        if work.rec_x.shape[1] < WIDE or work.rec_x.nbytes < MOST:
            return False
        rows = int(work.ints[work_layout.RECORDS])
        if not self._passed:
            self.every = 2
        first = self._leave_out(work, self._old, rows, self.every)
        while first > rows // 2 and self.every < rows:
            self.every *= 2
            first = self._leave_out(work, 0, first, 2)
        self._old = first
        work.ints[work_layout.RECORDS] = first
        return first <= 3 * rows // 4

    def _leave_out(self, work: Any, first: int, rows: int, every: int) -> int:
        """Leave out nodes from the row `first` on; returns how many rows there are then."""
        time = work.rec_t[:rows]
        stays = np.zeros(rows, bool)
        stays[:first] = stays[-1] = stays[0] = True
        stays |= time == self.stay
        twice = time[1:] == time[:-1]
        stays[:-1] |= twice
        stays[1:] |= twice
        for array in (work.rec_m, work.rec_p):
            stays[1:] |= (array[1:rows] != array[: rows - 1]).any(axis=1)
        stays[np.flatnonzero(~stays)[every - 1 :: every]] = True
        self._passed.append(time[~stays])
        kept = np.flatnonzero(stays)
        for array in (work.rec_t, work.rec_x, work.rec_m, work.rec_p):
            for begin in range(0, kept.size, ROWS):  # each goes to a row that has been moved already
                array[begin : begin + ROWS][: kept.size - begin] = array[kept[begin : begin + ROWS]]
        return int(kept.size)
