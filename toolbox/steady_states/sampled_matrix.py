"""The exact matrix of a sampled loop about steady running, over the time in which all its sample times come round.

    x' = A x + B h between two instants;   (z, w) = update(x, h, z) at each sample of a controller;   h = w when its delay has passed

All samples of one instant read the held signals from before it; the outputs that arrive at that instant follow. Each piece between two instants is that
of the matrix exponential, so that delays by parts of a period and several sample times are exact.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from toolbox.arguments import FloatArray
from toolbox.steady_states.linear_loop import NoDerivative, zero_order_hold

if TYPE_CHECKING:
    from toolbox.steady_states.steady_loop import SampledPoint

MOST_INSTANTS = 2000
"""Samples and arrivals within the common period beyond which there is no matrix: sample times that have no common period to speak of."""

SAMPLE, ARRIVAL = 0, 1
"""What is due at an instant, in this order."""

SAME = 1e-9
"""Instants that are this close, as a fraction of the shortest period, are one."""


def common_period(periods: Sequence[float]) -> tuple[float, list[int]]:
    """Return the common period of all periods [s], and the number of times that each fits into it."""
    exact = [Fraction(period).limit_denominator(10**9) for period in periods]
    if len(set(periods)) == 1:  # whatever number it is
        return float(periods[0]), [1] * len(periods)
    common = exact[0]
    for each in exact[1:]:
        a, b = common.numerator * each.denominator, each.numerator * common.denominator
        common = Fraction(math.lcm(a, b), common.denominator * each.denominator)
    return float(common), [int(common / each) for each in exact]


def matrix_over_period(point: SampledPoint, slope: FloatArray) -> tuple[FloatArray, float]:
    """Return the matrix of the closed loop over the common period of all sample times, and that period [s].

    The state is (x, held signals, memory, outputs on their way), from just before the samples that all controllers take together.

    Raises
    ------
    NoDerivative
        If the sample times have no common period of a sensible length.
    """
    periods = [clock.period for clock in point.clocks]
    span, counts = common_period(periods)
    if 2 * sum(counts) > MOST_INSTANTS:
        raise NoDerivative(f"the sample times {sorted(set(periods))} s have no common period of less than {MOST_INSTANTS} instants")
    near = SAME * min(periods)
    waiting = [math.floor((clock.delay + near) / clock.period) for clock in point.clocks]
    late = [clock.delay - count * clock.period for clock, count in zip(point.clocks, waiting, strict=True)]  # by parts of a period
    due = []
    for c, (period, part) in enumerate(zip(periods, late, strict=True)):
        for k in range(counts[c]):
            due += [(k * period, SAMPLE, c), (k * period + (part if part > near else 0.0), ARRIVAL, c)]
    rows = Rows(point, slope, waiting)
    instants = _together(sorted(due), near)
    for (at, what), following in zip(instants, [*(each[0] for each in instants[1:]), span], strict=True):
        rows.sample([c for kind, c in what if kind == SAMPLE])
        rows.arrive([c for kind, c in what if kind == ARRIVAL])
        rows.flow(following - at)
    return rows.matrix, span


class Rows:
    """States, held signals, memory and delayed outputs, as rows over their values at the beginning of the period. waiting: number of
    delayed outputs of each controller then."""

    def __init__(self, point: SampledPoint, slope: FloatArray, waiting: Sequence[int]):
        n, h, z = point.n, point.h, point.z
        self.point, self.slope = point, slope
        self.own = [np.flatnonzero(point.owner == c) for c in range(len(point.clocks))]
        sizes = [n, h, z, *(places.size for count, places in zip(waiting, self.own, strict=True) for _ in range(count))]
        pieces = np.split(np.eye(sum(sizes)), np.cumsum(sizes)[:-1])
        self.states, self.held, self.memory = pieces[:3]
        self.queues = [[pieces.pop(3) for _ in range(count)] for count in waiting]
        self.pieces: dict[float, tuple[FloatArray, FloatArray]] = {}

    def sample(self, controllers: Sequence[int]) -> None:
        """The samples of one instant, which read the signals held before it."""
        if not controllers:
            return
        of_states, of_held, of_memory = np.split(self.slope[self.point.n :], [self.point.n, self.point.n + self.point.h], axis=1)
        answers = of_states @ self.states + of_held @ self.held + of_memory @ self.memory
        for c in controllers:
            self.queues[c].append(answers[self.own[c]])
            self.memory[self.point.memory_of[c]] = answers[self.point.h :][self.point.memory_of[c]]

    def arrive(self, controllers: Sequence[int]) -> None:
        """The arrival of the oldest outputs of controllers."""
        for c in controllers:
            self.held[self.own[c]] = self.queues[c].pop(0)

    def flow(self, length: float) -> None:
        """The motion between two instants."""
        if length not in self.pieces:
            n, h = self.point.n, self.point.h
            self.pieces[length] = zero_order_hold(self.slope[:n, :n], self.slope[:n, n : n + h], length)
        of_states, of_held = self.pieces[length]
        self.states = of_states @ self.states + of_held @ self.held

    @property
    def matrix(self) -> FloatArray:
        """All rows, one below the other."""
        return np.vstack([self.states, self.held, self.memory, *(each for queue in self.queues for each in queue)])


def _together(instants: Sequence[tuple[float, int, int]], near: float) -> list[tuple[float, list[tuple[int, int]]]]:
    """Instants with what is due at each of them: those that round-off keeps apart are one."""
    found: list[tuple[float, list[tuple[int, int]]]] = []
    for at, kind, c in instants:
        if found and at - found[-1][0] <= near:
            found[-1][1].append((kind, c))
        else:
            found.append((at, [(kind, c)]))
    return found
