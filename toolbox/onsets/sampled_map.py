"""The map of a sampled loop over a few sample times: its smooth running, and how a small disturbance of it grows."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray, count_of
from toolbox.modelling.clocks import Clock
from toolbox.onsets.motions import Growth, Smooth, in_phase, least_damped, slip_rows
from toolbox.simulation.run import Run
from toolbox.simulation.run_state import RunState
from toolbox.steady_states.sampled_matrix import common_period

ROUNDS = 5
"""Common periods of all sample times over which the map goes."""

KICK = 1e-3
"""Part of the states by which smooth running is disturbed to see how far each entry of a point moves then."""

STEP = 0.02
"""Differences, in parts of what each entry moves by then; half of it once more."""

CORRECTIONS, ANEW = 24, 3
"""Steps of the search for smooth running, at most, and how often it takes derivatives anew."""

AGREES = 1e-3
"""What the growth of two differences may be apart, in parts of its frequency, to count."""

NEUTRAL = 1e-9
"""Change of a motion over the map below which differences are too small for what brings it back, as the switching of a law."""

EXACT = 1e-12
"""Accuracy of the runs of a map."""

NOISE = 1e-13
"""What two such runs may differ by that begin alike, as a fraction of each entry: a hundred times what was measured against exact matrices."""


def section(clocks: list[Clock]) -> tuple[float, float]:
    """(phase, common period) of all sample times: a phase in the middle of the longest time without a sample or a late output."""
    whole, counts = common_period([clock.period for clock in clocks])
    marks = {0.0}
    for clock, count in zip(clocks, counts, strict=True):
        for k in range(count):
            marks |= {k * clock.period / whole % 1.0, (k * clock.period + clock.delay) / whole % 1.0}
    edges = np.array([*sorted(marks), 1.0 + min(marks)])
    widest = int(np.argmax(np.diff(edges)))
    return whole * (0.5 * (edges[widest] + edges[widest + 1]) % 1.0), whole


class SampledMap:
    """The map of a sampled loop over a few sample times, between instants at which no sample is taken and none arrives.

    Its points hold the entries of the states, of the memory and of the signals held, then the outputs on their way, then what Python laws tell.
    """

    def __init__(self, run: Run, begin: RunState):
        phase, common = section(run.clocks)
        self.run, self.span = run, ROUNDS * common
        late = max(clock.delay for clock in run.clocks)
        until = phase + common * math.ceil((late + 2 * common) / common)
        self.state = self._again(begin, until - begin.time).last
        self.places = np.concatenate([np.arange(first, first + count_of(size)) for _, first, size in self.state.layout]).astype(int)
        self.told = all(law is None or isinstance(law, np.ndarray) for law in self.state.controllers)
        n = self.state.states.size
        rows = slip_rows(run.system, self.state.states, run.system.values)
        self.rows = np.hstack([rows, np.zeros((len(rows), self.point(self.state).size - n))])

    def _again(self, state: RunState, duration: float) -> Any:
        return self.run.again(start=state, duration=duration, accuracy=EXACT, output_times=None, longest_step=max(duration, self.span) / 16)

    def point(self, state: RunState) -> FloatArray:
        """A state as a point."""
        laws = [law for law in state.controllers if isinstance(law, np.ndarray)]
        return np.concatenate([state.values[self.places], *[rows.ravel() for rows in state.waiting], *laws])

    def state_at(self, point: FloatArray) -> RunState:
        """The state of a point."""
        values, place = self.state.values, self.places.size
        values[self.places] = point[:place]
        waiting, laws = [], []
        for rows in self.state.waiting:
            waiting.append(point[place : place + rows.size].reshape(rows.shape))
            place += rows.size
        for law in self.state.controllers:
            laws.append(None if law is None else point[place : place + law.size])
            place += 0 if law is None else law.size
        return dataclasses.replace(self.state.at_values(values), waiting=tuple(waiting), controllers=tuple(laws))

    def __call__(self, point: FloatArray) -> FloatArray:
        return self.point(self._again(self.state_at(point), self.span).last)

    def sizes(self, point: FloatArray) -> FloatArray:
        """Return the displacement of each entry of a point after a disturbance of the states by KICK. An entry that does not move gets KICK
        times its value, or KICK if the value is zero."""
        n = self.state.states.size
        moved, still = point.copy(), point
        moved[:n] *= 1.0 + KICK
        size = np.abs(moved - still)
        for _ in range(6):
            moved, still = self(moved), self(still)
            size = np.maximum(size, np.abs(moved - still))
        own = KICK * np.where(np.abs(point) > 1e-9, np.abs(point), 1.0)
        return np.where(size > 1e-9 * own, size, own)

    def slopes(self, point: FloatArray, end: FloatArray, steps: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the map at a point, which goes to `end`, by differences upwards and downwards."""
        up, down = (np.empty((point.size, point.size)) for _ in range(2))
        for i, step in enumerate(steps):
            for sign, matrix in ((1.0, up), (-1.0, down)):
                moved = point.copy()
                moved[i] += sign * step
                matrix[:, i] = sign * (self(moved) - end) / step
        return up, down

    def smooth(self, known: FloatArray | None = None) -> Smooth | None:
        """Smooth running next to the state, by Newton's method on the map, and its growth; None where differences do not agree or nothing is found.

        known: derivatives nearby, with which the search begins; they are taken anew where it does not come on, and at its end.
        """
        point, last, here = self.point(self.state), math.inf, False
        if not self.told or not np.isfinite(point).all():
            return None
        size, matrix, taken = self.sizes(point), known, 0
        for _ in range(CORRECTIONS):
            end = self(point)
            if matrix is None or matrix.shape != (point.size, point.size):
                if taken == ANEW:
                    return None
                taken += 1
                up, down = self.slopes(point, end, STEP * size)
                matrix, here, last = (up + down) / 2, True, math.inf
            if not np.isfinite(matrix).all():
                return None
            scaled = matrix * size / size[:, None]
            step = np.linalg.lstsq(scaled - np.eye(size.size), (point - end) / size, rcond=1e-9)[0]
            largest = float(np.abs(step).max(initial=0.0))
            if largest <= (1e-7 if here else 1e-9):  # of a disturbance that is small itself
                break
            if largest > 0.3 * last:
                matrix = None
                continue
            point, last, here = point + size * step, largest, False
        else:
            return None
        if not here:
            up, down = self.slopes(point, end, STEP * size)
        self.matrix = (up + down) / 2
        if not np.isfinite(self.matrix).all():
            return None
        others = [self._grown(each * size / size[:, None]) for each in (self.matrix, up, down)]
        exponent, motion, row = others[0]
        finer = self._along(point, end, motion * size, row / size)
        if not (finer.all() and finer.sum()):  # what a small step along the motion does is lost within one period
            return None
        apart = [*(each[0] for each in others), *np.log(finer) / self.span]
        if abs(exponent) * self.span < NEUTRAL:
            return None
        along = complex(np.log(finer.mean()) / self.span)  # exact where entries of the matrix are rough, as under a law that switches
        if any(abs(each - along) > AGREES * max(abs(exponent), 1e-2 / self.span) for each in apart):
            return None
        spread = abs(apart[0] - along)  # of two sizes of the steps
        noise = NOISE * np.abs(row / size) @ np.abs(point) / (STEP / 2) / self.span  # of the runs
        values = np.zeros(self.state.values.size)
        values[self.places] = in_phase(motion * size, self.rows)[: self.places.size]
        return Smooth(self.state_at(point), Growth.of(along, "differences", spread + noise), values)

    def _along(self, point: FloatArray, end: FloatArray, motion: np.ndarray, row: np.ndarray) -> np.ndarray:
        """The multiplier of a motion, by differences of half the step along it, upwards and downwards; row: its left eigenvector."""
        found = np.zeros(2, complex)
        for part, unit in ((motion.real, 1.0), (motion.imag, 1j)):
            for i, step in enumerate((STEP / 2, -STEP / 2) if part.any() else ()):
                found[i] += unit * (row @ (self(point + step * part) - end)) / step
        return found

    def _grown(self, scaled: FloatArray) -> tuple[complex, np.ndarray, np.ndarray]:
        """The exponent of the least damped motion of a matrix of the map, the motion, and the left eigenvector by which it is read from a point."""
        multipliers, motions = np.linalg.eig(scaled)
        exponents = np.log(np.where(multipliers == 0.0, 1e-300, multipliers).astype(complex)) / self.span
        best = least_damped(exponents, motions, self.rows)
        motion = motions[:, best] / np.abs(motions[:, best]).max()
        lefts, rows = np.linalg.eig(scaled.T)
        row = rows[:, int(np.argmin(np.abs(lefts - multipliers[best])))]
        return complex(exponents[best]), motion, row / (row @ motion)
