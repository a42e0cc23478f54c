"""Calibration: parameters of a machine from measured signals, with what is known about them and what is not.

    minimise over q   sum_k sum_i ((y_k(t_i; q) - y_k,i) / s_k)^2

y_k: measured outputs, s_k: their noise. Without a given noise the fit is done twice, the second time with the rms residual of the first, so that signals of
different units weigh what they are worth. The covariance of the estimates is (J^T J)^-1 times the residual variance, J = dy/dq exact; intervals hold where the
model is right and residuals are white, which is why whiteness is reported beside them.

Why a fit can be refused: numbers that only enter as a product, or that the data never touch, have no estimates, and the best-looking result would be
one point of a line of equally good ones. The singular values of J show that, and the error names the numbers along the line.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from toolbox.arguments import mapping, number, whole
from toolbox.calibration.least_squares import LeastSquares
from toolbox.calibration.recording import Recording
from toolbox.calibration.residuals import MeasuredLoop, Simulated
from toolbox.calibration.results import Fit
from toolbox.errors import SceneError, suggest
from toolbox.files.unit_systems import asked_units
from toolbox.files.units import NumberOrText, in_si
from toolbox.modelling.closed_loop import ClosedLoop, closed_loop, takes_loop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import names as names_of
from toolbox.modelling.numbers import Number
from toolbox.simulation.request import Request


@takes_loop
def fit(
    loop: ClosedLoop,
    data: Any,
    free: str | Sequence[str],
    bounds: Mapping[str, tuple[NumberOrText, NumberOrText]] | None = None,
    *,
    columns: Mapping[str, str] | None = None,
    contact: str | None = None,
    still: float | None = None,
    noise: Mapping[str, float] | None = None,
    window: tuple[NumberOrText, NumberOrText] | None = None,
    robust: float | None = 5.0,
    starts: int = 4,
    seed: int = 0,
    confidence: float = 0.95,
    accuracy: float = 1e-8,
) -> Fit:
    """Estimate parameters of a machine, with confidence intervals, from measured signals.

    Signals that are inputs of the plant drive the simulation, linear between samples; all others are compared with it by nonlinear least squares. A
    simulation that sticks and slips for many cycles has many poor optima: give a window of a few cycles, and bounds. Source: G. A. F. Seber, C. J. Wild,
    Nonlinear Regression, Wiley 1989.

    Parameters
    ----------
    loop
        A loop, or a plant; what of its inputs is measured takes the place of what they are.
    data, columns
        What was measured, and which of its columns are which signals; see `Recording.of`.
    free
        Names of what is estimated, any numbers of the loop: parameters (`bit.friction.static`), constant inputs (`top.torque`), start values (`bit.speed`,
        `chain.twist.0`) and the others. Each search begins at their values in the loop.
    bounds
        Bounds {name: (low, high)}; by default those that the part declares.
    contact
        Fit the friction law of this contact directly to measured force at measured slip, without simulation. The slip must be measured well: its own noise is
        not modelled.
    still
        Slip speeds up to this count as stick (with `contact`); by default a hundredth of the largest.
    noise
        Standard deviations {signal: value}; estimated if not given.
    window
        Times (begin, end) [s] of the data that are used; all by default.
    robust
        Samples that are farther from the fitted model than so many deviations (by the median, which they do not move) are left out and told, as long as
        they are at most a twentieth of a signal: a few with the wrong sign would move an estimate by many of its intervals. None keeps all.
    starts, seed
        Number of searches, and seed of their starts: the first begins at the declared values, the others between the bounds, or between half and twice the
        value.
    confidence
        Confidence level of the intervals.
    accuracy
        Accuracy of the runs, as in `simulate`.

    Returns
    -------
    Fit
        Estimates, intervals and residuals.

    Raises
    ------
    SceneError
        If a name is unknown, the data are bad, or they cannot tell numbers apart or do not depend on them; the message names these.
    SimulationError
        If no start can be simulated.
    """
    bounds = mapping("bounds", bounds)
    noise = None if noise is None else mapping("noise", noise)
    whole("seed", seed, 0)
    names = names_of(free)
    if not names or len(set(names)) < len(names):
        raise SceneError(f"Argument `free` must name at least one number, and each once, but it is {names!r}.")
    confidence, starts = number("confidence", confidence, above=0, below=1), whole("starts", starts, 1)
    still = None if still is None else number("still", still, above=0)
    robust = None if robust is None else number("robust", robust, above=1)
    misfit: Any
    if contact is not None:
        alone = loop.bare
        plant = alone.closed.plant
        numbers = [_parameter(alone, name) for name in names]
        misfit = MeasuredLoop(alone, _read(data, plant, columns, window), numbers, contact, still)
    else:
        bare = dataclasses.replace(loop, inputs={})  # what drives an input of the plant in closed loop is an output of the loop
        recording = _read(data, bare.system, columns, window)
        driving = _driving(recording, bare.system)
        driven = closed_loop(loop, inputs=driving)
        Request(driven, float(recording.time[-1]), accuracy=accuracy).checked()
        misfit = Simulated(driven, recording, [_free(driven, recording, name) for name in names], accuracy)
        if not misfit.outputs:
            raise SceneError(
                "The data must hold an output to be compared with, but all their signals are inputs: " + ", ".join(recording.signals) + "."
            )
    first, units = np.array([number.value for number in misfit.numbers]), tuple(number.unit for number in misfit.numbers)
    lowest, highest = _bounds(misfit.numbers, bounds)
    found = LeastSquares(misfit, names, units, first, lowest, highest, noise, robust, starts, seed, confidence).fit()
    typed = [in_si(bounds[name], unit, name) for name, unit in zip(names, units, strict=True) if name in bounds]
    return dataclasses.replace(found, asked={**loop.asked, **asked_units(typed)})


def _read(data: Any, plant: HybridSystem, columns: Mapping[str, str] | None, window: tuple[NumberOrText, NumberOrText] | None) -> Recording:
    """The recording, or its window."""
    recording = Recording.of(data, plant, columns)
    if window is None:
        return recording
    if not isinstance(window, (tuple, list)) or len(window) != 2:
        raise SceneError(f"Argument `window` must be two times (begin, end), but it is {window!r}.")
    return recording.between(*window)


def _driving(recording: Recording, plant: HybridSystem) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """{input: (times, values)} of what was measured; raises SceneError where a gap in it would have to be bridged."""
    measured = [name for name in recording.signals if name in plant.inputs]
    if not measured:
        return {}
    stretches = recording.windows(measured)
    if len(stretches) != 1:
        found = ", ".join(f"{begin:.6g} .. {end:.6g} s" for begin, end in stretches[:8])
        raise SceneError(
            f"The data must hold what drives the machine, {' and '.join(f'`{name}`' for name in measured)}, without gaps, but it is there in "
            f"{len(stretches)} stretches: choose among the windows {found}."
        )
    good = {name: np.isfinite(recording.signals[name]) for name in measured}
    return {name: (recording.time[good[name]], recording.signals[name][good[name]]) for name in measured}


def _parameter(loop: ClosedLoop, name: str) -> Number:
    """A parameter of the plant by name; raises SceneError for any other name."""
    entry = loop.plant._parameter(name)
    if entry.size is not None:
        raise SceneError(f"Argument `free` must hold single numbers, such as `{name}.0`, but `{name}` has {entry.size} entries.")
    value = float(loop.closed.plant.values[entry.offset])
    return Number(name, entry.unit, "parameter", value, entry.meaning, entry.bounds)


def _free(loop: ClosedLoop, recording: Recording, name: str) -> Number:
    """A number of the loop that is neither measured nor varies in time, or the start value of a measured state; raises SceneError for any other."""
    number = loop.number(name)
    if name in recording.signals and name not in loop.inputs and number.kind != "start":
        raise SceneError(f"Argument `free` must not hold `{name}`, because it is measured.")
    if not math.isfinite(number.value):
        raise SceneError(f"Argument `free` must hold constant inputs, but `{name}` varies in time or is measured.")
    return number


def _bounds(numbers: Sequence[Number], bounds: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """(low, high) of every free number: as given, or as its part declares."""
    names = [number.name for number in numbers]
    for name in bounds:
        if name not in names:
            raise SceneError(f"Argument `bounds` has `{name}`, which is not free: {suggest(name, names)}")
    low, high = np.full(len(names), -np.inf), np.full(len(names), np.inf)
    for i, each in enumerate(numbers):
        if each.name in bounds:
            low[i], high[i] = each.between(bounds[each.name], f"bounds.{each.name}")
        elif each.bounds:
            lowest = [value for value in (each.bounds["at_least"], each.bounds["above"]) if value is not None]
            low[i] = max(lowest, default=-np.inf)
            high[i] = np.inf if each.bounds["at_most"] is None else each.bounds["at_most"]
            if each.bounds["above"] is not None and each.bounds["above"] == low[i]:
                low[i] += 1e-12 * max(abs(each.value), 1e-300)
    return low, high
