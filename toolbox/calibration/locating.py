"""Where the shift in time between the force and the slip of a measured loop is."""

from __future__ import annotations

import math

import numpy as np

from toolbox.calibration.measured_loop import MeasuredLoop
from toolbox.errors import SceneError, SimulationError

TRIED = 41
"""Shifts that are tried, at most, between bounds."""


def located(misfit: MeasuredLoop, low: np.ndarray, high: np.ndarray) -> MeasuredLoop:
    """The misfit of a loop with the samples that slip on the clock of the force.

    Which samples slip depends on the shift itself. So the shift is first looked for among even steps, with a robust fit of the other numbers at each, and more
    closely around the best of them. Raises SceneError for several shifts, which a loop does not tell apart.
    """
    from scipy.optimize import least_squares

    if len(misfit.shifts) > 1:
        raise SceneError(
            "Argument `free` must hold one shift at most where a contact is fitted: a loop tells only that of the force against the slip."
        )
    (shift,) = misfit.shifts
    others = [i for i in range(len(misfit.names)) if i != shift.place]
    first = np.clip([number.value for number in misfit.numbers], low, high)
    interval = misfit.recording.interval

    def at(late: float) -> tuple[float, np.ndarray]:
        """How far the law is from the data at a shift, and the numbers there."""
        values = first.copy()
        values[shift.place] = late
        few = misfit.begun(values).trial()
        measured = few.measured[few.output]

        def left(q: np.ndarray) -> np.ndarray:
            values[others] = q
            away: np.ndarray = few.model(values)[few.output] - measured
            return away

        if others:
            size, spread = np.maximum(np.abs(first[others]), 1e-9), float(np.std(measured)) or 1.0
            inside = (low[others], high[others])
            values[others] = least_squares(left, first[others], bounds=inside, x_scale=size, max_nfev=20, loss="soft_l1", f_scale=spread).x
        return float(np.mean(np.abs(left(values[others])))), values

    def tried(steps: np.ndarray) -> tuple[float, np.ndarray]:
        found = []
        for late in steps.tolist():
            try:
                found.append(at(late))
            except (SceneError, SimulationError):  # of numbers that contradict each other, and of too few samples
                found.append((math.inf, first))
        return min(found, key=lambda each: each[0])

    width = max((shift.high - shift.low) / (TRIED - 1), min(interval, 0.5 * (shift.high - shift.low)))
    best, values = tried(np.arange(shift.low, shift.high + 0.5 * width, width))
    while width > 0.5 * interval and math.isfinite(best):
        middle, width = values[shift.place], width / 4
        best, values = tried(np.clip(middle + width * np.arange(-4, 5), shift.low, shift.high))
    return misfit.begun(values)
