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

SAME = 1e-9
"""Instants that are this close, as a fraction of the shortest period, are one."""


def common_period(periods: Sequence[float]) -> tuple[float, list[int]]:
    """Return the time in which all periods come round [s], and how many of each it holds."""
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
    n, h, z = point.n, point.h, point.z
    periods, delays = [period for period, _ in point.clocks], [delay for _, delay in point.clocks]
    span, counts = common_period(periods)
    if 2 * sum(counts) > MOST_INSTANTS:
        raise NoDerivative(f"the sample times {sorted(set(periods))} s have no common period of less than {MOST_INSTANTS} instants")
    near = SAME * min(periods)
    own = [np.flatnonzero(point.owner == c) for c in range(len(periods))]
    waiting = [math.floor((delay + near) / period) for period, delay in zip(periods, delays, strict=True)]
    parts = [delay - count * period for period, delay, count in zip(periods, delays, waiting, strict=True)]  # of a period
    size = n + h + z + sum(count * places.size for count, places in zip(waiting, own, strict=True))
    start = np.eye(size)
    x, held, memory = start[:n], start[n : n + h].copy(), start[n + h : n + h + z].copy()
    queues: list[list[FloatArray]] = []
    place = n + h + z
    for count, places in zip(waiting, own, strict=True):
        queues.append([start[place + k * places.size : place + (k + 1) * places.size] for k in range(count)])
        place += count * places.size
    samples = [(k * period, 0, c) for c, period in enumerate(periods) for k in range(counts[c])]
    arrivals = [(k * period + (part if part > near else 0.0), 1, c)
                for c, (period, part) in enumerate(zip(periods, parts, strict=True)) for k in range(counts[c])]  # fmt: skip
    instants = _together(sorted([*samples, *arrivals]), near)
    drift, force = slope[:n, :n], slope[:n, n : n + h]
    steps: dict[float, tuple[FloatArray, FloatArray]] = {}
    for (at, due), following in zip(instants, [*[each[0] for each in instants[1:]], span], strict=True):
        taken = {c for kind, c in due if kind == 0}
        answers = slope[n:, :n] @ x + slope[n:, n : n + h] @ held + slope[n:, n + h :] @ memory if taken else None
        for c in sorted(taken):
            assert answers is not None
            queues[c].append(answers[own[c]])
            memory[point.memory_of[c]] = answers[h:][point.memory_of[c]]
        for c in sorted({c for kind, c in due if kind == 1}):
            held[own[c]] = queues[c].pop(0)
        length = following - at
        key = round(length / near)
        if key not in steps:
            steps[key] = zero_order_hold(drift, force, length)
        x = steps[key][0] @ x + steps[key][1] @ held
    return np.vstack([x, held, memory, *(each for queue in queues for each in queue)]), span


def _together(instants: Sequence[tuple[float, int, int]], near: float) -> list[tuple[float, list[tuple[int, int]]]]:
    """Instants with what is due at each of them: those that round-off keeps apart are one."""
    found: list[tuple[float, list[tuple[int, int]]]] = []
    for at, kind, c in instants:
        if found and at - found[-1][0] <= near:
            found[-1][1].append((kind, c))
        else:
            found.append((at, [(kind, c)]))
    return found
