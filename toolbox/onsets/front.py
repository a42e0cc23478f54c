"""Stick-slip of a severity map carried on from point to point, until it ends between neighbours whatever it is begun with.

One start that dies proves nothing: near the end of stick-slip few starts lead into its cycle, and a string of several inertias keeps the cycle where a bit
that is stopped at once breaks free for good. So the state of a cycle that is there is led to the neighbours where none was found, in small steps; where
it lasts, it is led on from there. The edges of the grid at which it is lost are then halved, each time from the state of the cycle at the last point that
keeps it, with runs several times as long as those of the map, because close to its end a cycle takes long to die.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.errors import SimulationError
from toolbox.measuring import measure
from toolbox.onsets.borders import Edges
from toolbox.onsets.inside import FINEST, outward
from toolbox.onsets.map_loop import NONE, SMOOTH, STICK_SLIP, STUCK, SWING, MapLoop
from toolbox.simulation.carry_out import carry_out
from toolbox.simulation.run import Run
from toolbox.simulation.run_state import RunState
from toolbox.simulation.trajectory import Trajectory
from toolbox.sweeps.batch import Task, single
from toolbox.sweeps.designs import Variations
from toolbox.sweeps.variants import varied_numbers

STEPS = 8
"""Steps in which the machine is led from a point to its neighbour, with a little more than two of its cycles at each."""

LONGER = 5.0
"""Durations of a run of the map after which a cycle near its end counts as alive."""

ROUNDS = 4
"""How often a swing that still grows is looked at again."""

GROWN, LONGEST = 5.0, 100.0
"""Time constants of a disturbance that grows after which it is looked at, and the most durations that this may be."""


@dataclass
class Point:
    """A run at a point of the map: severity, part of the time in stick, verdict; where it ended, and how long its cycle takes [s]."""

    severity: float
    ratio: float
    verdict: int
    last: RunState
    cycle: float


@dataclass
class Front:
    """The alive points of a map with the state of their cycle; `runs` counts the runs that it took, and `bar` shows their progress."""

    loop: MapLoop
    points: np.ndarray
    shape: tuple[int, int]
    known: dict[int, Point] = field(default_factory=dict)
    runs: int = 0
    bar: Any = None

    # -------------------------------------------------------------------------------------------------------------------------------------- one run
    def _judged_point(self, run: Trajectory) -> Point:
        """The verdict on the last part of a run, as long as what the map judges."""
        loop = self.loop
        length = loop.run.duration - loop.after
        after = run.end - length
        sticks = measure.stick_intervals(run, loop.element, after)
        ratio = sum(b - a for a, b in sticks) / length
        lasts = bool(sticks) and sticks[-1][1] > run.end - 0.25 * length and ratio > max(10 * loop.run.accuracy, 1e-9)
        spans = [measure.extent(run, loop.signal, a, b) for a, b in ((after, after + length / 2), (after + length / 2, run.end))]
        early, late = (span.maximum - span.minimum for span in spans)
        floor = 10 * loop.run.accuracy * max(abs(spans[1].maximum), abs(spans[1].minimum))
        verdict = (STUCK if ratio > 1 - 1e-9 else STICK_SLIP) if lasts else SWING if late > max(floor, 0.95 * early) else SMOOTH
        rounds = np.diff([a for a, _ in sticks])
        cycle = float(np.median(rounds)) if len(rounds) else length / 10
        return Point(measure.severity(run, loop.signal, after), ratio, verdict, run.last, cycle)

    def _carried(self, run: Run, duration: float) -> Point | None:
        self.runs += 1
        if self.bar is not None:
            self.bar.update()
        try:
            return self._judged_point(carry_out(run_of(run, max(duration, self.loop.run.duration))))
        except SimulationError:
            return None

    def _at(self, place: np.ndarray, point: Point) -> Run:
        """The run at a place of the plane from where another one ended."""
        numbers, _ = varied_numbers(self.loop.run, Variations(self.loop.names, place[None, :], (1,)))
        return dataclasses.replace(single(Task(self.loop.run, numbers, ()), 0), start=point.last)

    def led(self, point: Point, begin: np.ndarray, end: np.ndarray, longer: float = LONGER) -> Point | None:
        """What the machine does after it was led along the line from one place to another; None where a run fails."""
        here = point
        for k in range(1, STEPS):
            run = run_of(self._at(begin + (end - begin) * k / STEPS, here), 2.3 * point.cycle)
            try:
                trajectory = carry_out(run)
            except SimulationError:
                return None
            here = Point(0.0, 0.0, NONE, trajectory.last, point.cycle)
        return self._carried(self._at(end, here), longer * self.loop.run.duration)

    # ------------------------------------------------------------------------------------------------------------------------------------ all points
    def neighbours(self, k: int) -> list[int]:
        """The points next to a point of the grid along its rows and columns."""
        i, j = divmod(k, self.shape[1])
        return [
            (i + a) * self.shape[1] + j + b
            for a, b in ((-1, 0), (1, 0), (0, -1), (0, 1))
            if 0 <= i + a < self.shape[0] and 0 <= j + b < self.shape[1]
        ]

    def _entered(self, verdict: np.ndarray) -> None:
        """Look for stick-slip outside of the map, beyond the middle of each side where none is known, and lead it onto the side."""
        places = self.points.reshape(*self.shape, 2)
        rows, columns = self.shape
        sides = [(0, columns // 2, 0, -1.0), (rows - 1, columns // 2, 0, 1.0), (rows // 2, 0, 1, -1.0), (rows // 2, columns - 1, 1, 1.0)]
        for i, j, axis, sign in sides:
            k = i * columns + j
            if verdict[k] in (STICK_SLIP, NONE):
                continue
            edge, width = places[i, j], float(np.ptp(places[..., axis]))
            for value in outward(float(edge[axis]), sign, width):
                beyond = edge.copy()
                beyond[axis] = value
                task, _, broken = self.loop.task(beyond[None, :], np.array([True]))
                found = None if broken else self._carried(single(task, 0), self.loop.run.duration)
                if found is not None and found.verdict == STICK_SLIP:
                    reached = self._brought(found, beyond, edge)
                    if reached is not None:
                        verdict[k], self.known[k] = STICK_SLIP, reached
                    break

    def _brought(self, point: Point, begin: np.ndarray, end: np.ndarray) -> Point | None:
        """The cycle led from one place to another in steps that are halved where it is lost; None where it does not reach it."""
        part, size = 0.0, 0.25
        while part < 1.0 and size >= FINEST:
            following = min(part + size, 1.0)
            found = self.led(point, begin + part * (end - begin), begin + following * (end - begin), 1.0 if following < 1.0 else LONGER)
            if found is not None and found.verdict == STICK_SLIP:
                part, point = following, found
            else:
                size /= 2
        return point if part >= 1.0 else None

    def spread(self, verdict: np.ndarray) -> dict[int, Point]:
        """Points whose verdict changes: alive ones next to dead ones are looked at for longer, and what stays alive is led to the dead.

        `verdict` holds that of all points on the inside branch and is changed in place.
        """
        task, _, _ = self.loop.task(self.points, np.ones(len(self.points), bool))
        self._entered(verdict)
        changed = dict(self.known)
        waiting = [
            int(k)
            for k in np.flatnonzero(verdict == STICK_SLIP)
            if any(verdict[n] not in (STICK_SLIP, NONE) for n in self.neighbours(int(k)))
        ]
        while waiting:
            k = waiting.pop()
            if verdict[k] != STICK_SLIP:
                continue
            if k not in self.known:
                found = self._carried(single(task, k), LONGER * self.loop.run.duration)
                if found is None or found.verdict != STICK_SLIP:
                    verdict[k] = NONE if found is None else found.verdict
                    changed |= {} if found is None else {k: found}
                    # what was taken for alive is dead: its neighbours have a border now, and one of them may reach it
                    waiting += [n for n in self.neighbours(k) if verdict[n] == STICK_SLIP]
                    continue
                self.known[k] = found
            for n in self.neighbours(k):
                if verdict[n] in (STICK_SLIP, NONE):
                    continue
                reached = self.led(self.known[k], self.points[k], self.points[n])
                if reached is not None and reached.verdict == STICK_SLIP:
                    verdict[n] = STICK_SLIP
                    self.known[n] = changed[n] = reached
                    waiting.append(n)
        return changed

    def halved(self, edges: Edges, times: int) -> np.ndarray:
        """Where stick-slip ends on every edge of the grid across its border, from the side where it lasts (`high`)."""
        places = []
        for low, high in zip(edges.low, edges.high, strict=True):
            here = self.known[int(np.argmin(np.abs(self.points - high).sum(axis=1)))]
            dead, alive = low, high
            for _ in range(times):
                middle = (dead + alive) / 2
                found = self.led(here, alive, middle)
                if found is not None and found.verdict == STICK_SLIP:
                    alive, here = middle, found
                else:
                    dead = middle
            places.append((dead + alive) / 2)
        return np.array(places).reshape(-1, 2)

    def settled(self, growing: Iterable[int]) -> dict[int, Point]:
        """Smooth running that is lost where its run ended before the disturbance had grown: looked at for longer, until it sticks or its swing stays."""
        task, _, _ = self.loop.task(self.points, np.zeros(len(self.points), bool))
        changed = {}
        rates = np.abs(np.nan_to_num(self.loop.growth(self.points)))
        for k in map(int, growing):
            duration = self.loop.run.duration * min(max(LONGER, GROWN / (rates[k] * self.loop.run.duration + 1e-300)), LONGEST)
            found, before = self._carried(single(task, k), duration), 0.0
            for _ in range(ROUNDS):
                if found is None or found.verdict in (STICK_SLIP, STUCK) or abs(found.severity - before) <= 0.02 * found.severity:
                    break
                before = found.severity
                found = self._carried(self._at(self.points[k], found), duration)
            if found is not None:
                found.verdict = max(found.verdict, SWING)
                changed[k] = found
        return changed


def run_of(run: Run, duration: float) -> Run:
    """The run with another duration."""
    return dataclasses.replace(run, duration=duration, output_times=None, longest_step=duration / 256)
