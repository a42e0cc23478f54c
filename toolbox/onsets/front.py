"""Stick-slip of a severity map: looked for at every point of the grid, then carried on from point to point until it ends between neighbours.

One start that dies proves nothing: near the end of stick-slip few starts lead into its cycle, and a string of several inertias keeps the cycle where a bit
that is stopped at once breaks free for good. So the state of a cycle that is there is led to the neighbours where none was found, in small steps; where
it lasts, it is led on from there. Where several cycles live side by side, the one at the far end of a row is led through it by itself, since it may outlive the
others. The edges of the grid at which it is lost are then halved, each time from the state of the cycle at the last place that
keeps it.
"""

from __future__ import annotations

import concurrent.futures
import itertools
import os
from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from toolbox.measuring.judge import NONE, NOT_DECIDED, SMOOTH, STICKS, Judged
from toolbox.messages import progress_bar
from toolbox.onsets.borders import Edges
from toolbox.onsets.carried import RANK, STOPPED, Carried, Job
from toolbox.onsets.inside import outward
from toolbox.onsets.map_loop import Plane
from toolbox.simulation.run_state import RunState


@dataclass(kw_only=True)
class Front(Carried[complex]):
    """Both branches of a map at the places of its grid, row by row; executor: does the runs from the points of the grid."""

    plane: Plane
    places: list[complex]
    shape: tuple[int, int]
    executor: concurrent.futures.Executor | None = None

    # ------------------------------------------------------------------------------------------------------------------------------------- the grid
    def smooth(self) -> list[Judged]:
        """What the least disturbance of smooth running comes to at every point."""
        judged: dict[complex, Judged] = {}
        jobs: dict[complex, Job] = {}
        with progress_bar(len(self.places), "map, smooth running") as bar:
            for place in self.places:
                found = self.search.branch(place)
                bar.update()
                if found is not None and not found.growth.rate < 0:
                    jobs[place] = self.search.job(place, self.search.disturbed(place, found), silent=True)
                else:
                    judged[place] = Judged(NONE) if found is None else Judged(SMOOTH, 0.0, rate=found.growth.rate)
        for place, (verdict, end) in zip(jobs, self._done(list(jobs.values()), "map, its loss"), strict=True):
            judged[place] = verdict
            self.search.keep_led(place, verdict, end)
            self.keep(place, verdict, end, "smooth running that was lost")
        return [judged[place] for place in self.places]

    def stopped(self) -> None:
        """Begin stick-slip by a sudden stop of the judged contact, at every point without stick-slip."""
        jobs: dict[complex, Job] = {}
        for place in self.places:
            begin = None if place in self.cycling else self.search.stopped(place)
            if begin is not None:
                jobs[place] = self.search.job(place, begin)
            elif place not in self.cycling:
                self.keep(place, Judged(NONE), None, STOPPED)
        for place, (verdict, end) in zip(jobs, self._done(list(jobs.values()), "map"), strict=True):
            self.begun.add((place, STOPPED))
            self.keep(place, verdict, end, STOPPED)

    def _done(self, jobs: Sequence[Job], label: str) -> Iterator[tuple[Judged, RunState | None]]:
        """Do jobs, the first one by itself, so that what is compiled is compiled once; what the journal knows is not done again."""
        numbers = range(self.search.runs + 1, self.search.runs + 1 + len(jobs))
        self.search.runs += len(jobs)
        known = {number: found for number in numbers if (found := self.search.kept(number)) is not None}
        waiting = [job for number, job in zip(numbers, jobs, strict=True) if number not in known]
        own = None if self.executor is not None else concurrent.futures.ThreadPoolExecutor(os.cpu_count())
        try:
            with progress_bar(len(jobs), label, done=len(known)) as bar:
                done = itertools.chain(map(Job.__call__, waiting[:1]), (self.executor or own).map(Job.__call__, waiting[1:]))  # type: ignore[union-attr]
                for number in numbers:
                    if number not in known:
                        bar.update()
                    yield known[number] if number in known else self.search.keeping(number, next(done))
        finally:
            if own is not None:
                own.shutdown(cancel_futures=True)

    # ------------------------------------------------------------------------------------------------------------------------------ from point to point
    def neighbours(self, k: int) -> list[int]:
        """The points next to a point of the grid along its rows and columns."""
        i, j = divmod(k, self.shape[1])
        return [
            (i + a) * self.shape[1] + j + b
            for a, b in ((-1, 0), (1, 0), (0, -1), (0, 1))
            if 0 <= i + a < self.shape[0] and 0 <= j + b < self.shape[1]
        ]

    def entered(self) -> None:
        """Look for stick-slip outside of the map, beyond the middle of each side without stick-slip, and lead it to the side."""
        rows, columns = self.shape
        sides = [(0, columns // 2, 0, -1.0), (rows - 1, columns // 2, 0, 1.0), (rows // 2, 0, 1, -1.0), (rows // 2, columns - 1, 1, 1.0)]
        for i, j, axis, sign in sides:
            edge = self.places[i * columns + j]
            if edge in self.cycling or self.search.branch(edge) is None:
                continue
            point, (low, high) = self.plane.point(edge), self.plane.ranges[axis]
            beyond = [[*point[:axis], value, *point[axis + 1 :]] for value in outward(point[axis], sign, high - low)]
            self.outside(edge, map(self.plane.at, beyond))

    def spread(self, known: Container[complex] = ()) -> None:
        """Lead stick-slip from each point with a cycle to the neighbours of the point, as far as it lasts. known: points whose stick-slip
        was led before."""
        waiting = [k for k, place in enumerate(self.places) if place in self.cycling and place not in known]
        while waiting:
            k = waiting.pop()
            for n in self.neighbours(k):
                here, there = self.places[k], self.places[n]
                if there in self.cycling or self.found[there].regime == NONE:
                    continue
                if self.tried(there, self.search.walked(self.cycling[here], here, there)).regime == STICKS:
                    waiting.append(n)

    def passed(self) -> None:
        """Lead the cycle at the far end of each row of stick-slip through the row, over the first number. The cycle is led on if it
        outlives the cycle at the end of the row.

        Several cycles may live side by side, of which a point keeps the first that was found.
        """
        columns, known = self.shape[1], set(self.cycling)
        for j, order in itertools.product(range(columns), (1, -1)):
            line = [place for place in self.places[j::columns][::order] if self.found[place].regime != NONE]
            alive = [place in self.cycling for place in line]
            for last, (here, there) in enumerate(itertools.pairwise(alive)):
                if here and not there:
                    first = last
                    while first > 0 and alive[first - 1]:
                        first -= 1
                    self._outliving(line[first : last + 1], line[last + 1 :])
        self.spread(known)

    def _outliving(self, row: Sequence[complex], beyond: Sequence[complex]) -> None:
        """Lead the cycle at the first place of a row to its last one, and where it is still there then, on over the places beyond."""
        state = self.cycling[row[0]]
        for here, there in itertools.pairwise(row):
            judged, end = self.search.run(there, self.search.walked(state, here, there))
            if judged.regime != STICKS or end is None:
                return
            state = end
        known, self.cycling[row[-1]] = self.cycling[row[-1]], state
        for k, (here, there) in enumerate(itertools.pairwise([row[-1], *beyond])):
            if there in self.cycling or self.tried(there, self.search.walked(self.cycling[here], here, there)).regime != STICKS:
                self.cycling[row[-1]] = state if k else known
                return

    def halved(self, edges: Edges, times: int, prepared: Callable[[Sequence[complex]], None]) -> np.ndarray:
        """Return the end of stick-slip on every edge across its border. Each edge is searched from `high`, the side with stick-slip.

        prepared: called with the places that are looked at next.
        """
        here = [self.plane.place(point) for point in edges.high]

        def lasts(points: np.ndarray) -> np.ndarray:
            places = [self.plane.place(point) for point in points]
            prepared(places)
            regimes = []
            for k, there in enumerate(places):
                regimes.append(self._kept_on(here[k], there))
                here[k] = there if regimes[-1] == STICKS else here[k]
            return np.isin(regimes, (STICKS, NOT_DECIDED))

        return edges.halved(lasts, times)

    def _kept_on(self, here: complex, there: complex) -> str:
        """What the cycle of a place comes to at another, and where it is lost a contact that is stopped there.

        Near grazing at low damping a cycle has hardly more speed than it needs to stick again: the steps in which it is led shake it off, a stop does not.
        """
        led = self.tried(there, self.search.walked(self.cycling[here], here, there)).regime
        begin = None if led in (STICKS, NOT_DECIDED) else self.search.stopped(there)
        return led if begin is None else max(led, self.tried(there, begin, begun=STOPPED).regime, key=RANK.index)
