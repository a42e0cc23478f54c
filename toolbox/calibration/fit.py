"""Calibration: parameters of a machine from measured signals, with what is known about them and what is not.

    minimise over q   sum_k sum_i ((y_k(t_i; q) - y_k,i) / s_k)^2

y_k: measured outputs, s_k: their noise. Without a given noise the fit is done twice, the second time with the rms residual of the first, so that signals of
different units weigh what they are worth. The covariance of the estimates is (J^T J)^-1 times the residual variance, J = dy/dq exact; intervals hold where the
model is right and residuals are white, which is why whiteness is reported beside them.

Why a fit can be refused: numbers that only enter as a product, or that the data never touch, have no estimates, and the best-looking result would be
one point of a line of equally good ones. The singular values of J show that, and the error names the numbers along the line.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.arguments import mapping, number, whole
from toolbox.calibration.recording import Recording
from toolbox.calibration.residuals import MeasuredLoop, Simulated, residuals
from toolbox.calibration.resting import resting
from toolbox.calibration.results import Fit
from toolbox.calibration.trust import residual_of, sampling_error
from toolbox.errors import SceneError, SimulationError, suggest
from toolbox.files.unit_systems import asked_units
from toolbox.files.units import NumberOrText, in_si
from toolbox.messages import progress_bar
from toolbox.modelling.closed_loop import ClosedLoop, closed_loop, takes_loop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import names as names_of
from toolbox.modelling.numbers import Number
from toolbox.simulation.request import Request

SINGULAR = 1e-6
"""Ratio of singular values, columns of the Jacobian scaled to length one, below which numbers cannot be told apart."""

MUTE = 1e-9
"""Change of the residuals, in parts of the signals, below which a number has no influence: for a change by its own size."""


DRAWS = 10
"""Starts that are drawn for every one that is wanted, because some contradict themselves or cannot be simulated."""


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
    misfit: Any
    if contact is not None:
        alone = loop.bare
        plant = alone.closed.plant
        numbers = [_parameter(alone, name) for name in names]
        misfit = MeasuredLoop(alone, Recording.of(data, plant, columns), numbers, contact, still)
    else:
        bare = dataclasses.replace(loop, inputs={})  # what drives an input of the plant in closed loop is an output of the loop
        recording = Recording.of(data, bare.system, columns)
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
    found = LeastSquares(misfit, names, units, first, lowest, highest, noise, starts, seed, confidence).fit()
    typed = [in_si(bounds[name], unit, name) for name, unit in zip(names, units, strict=True) if name in bounds]
    return dataclasses.replace(found, asked={**loop.asked, **asked_units(typed)})


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


def _product(tall: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """tall @ ways, without the threads of @, which wait for each other for longer than so thin a product takes."""
    return np.einsum("ni,ij->nj", tall, ways)


@dataclass
class LeastSquares:
    """Least squares from several starts, and what the Jacobian at the end says."""

    misfit: Any
    names: tuple[str, ...]
    units: tuple[str, ...]
    first: np.ndarray
    low: np.ndarray
    high: np.ndarray
    noise: Mapping[str, float] | None
    starts: int
    seed: int
    confidence: float

    def fit(self) -> Fit:
        from scipy.stats import t as student

        misfit = self.misfit
        sizes = {name: float(np.std(values)) or 1.0 for name, values in misfit.measured.items()}
        scales = self._given_noise(sizes)
        trial = misfit.trial()
        found = self._from_all_starts(trial, scales)
        best = min(found, key=lambda each: each.cost)
        agreeing = int(sum(each.cost <= best.cost * (1 + 1e-3) + 1e-12 for each in found))
        values = best.x if trial is misfit else self._descend(best.x, scales, [misfit]).x
        if self.noise is None and len(misfit.outputs) > 1:  # the weight of one alone changes nothing
            left = self._left(values)
            scales = {name: max(float(np.sqrt(np.mean(left[name] ** 2))), 1e-9 * sizes[name]) for name in left}
            values = self._descend(values, scales, [misfit]).x
        size = self._size(values)
        jacobian, left = self._weighed(misfit.slopes(values, size), scales), self._left(values)
        rest = resting(misfit, values, size, jacobian, self._weighed(left, scales), self.low, self.high)
        ways = rest.directions
        if rest.why:
            values = self._along(rest.values, ways, scales) if rest.together else rest.values
            size = self._size(values)
            jacobian, left = self._weighed(misfit.slopes(values, size), scales), self._left(values)
        weights = np.concatenate([np.full(left[name].size, scales[name] / sizes[name]) for name in left])
        per_part = _product(jacobian * weights[:, None], size[:, None] * ways)
        heard = np.sqrt((per_part**2).mean(axis=0)) >= MUTE if rest.why else np.ones(ways.shape[1], bool)
        labels = [" = ".join(name for name, part in zip(self.names, way, strict=True) if part) for way in ways.T[heard]]
        condition = self._identifiable(labels, per_part[:, heard])
        ways, mute = ways[:, heard], np.asarray(ways[:, ~heard].any(axis=1))
        jacobian = _product(jacobian, ways)
        n, k = jacobian.shape
        if n <= k:
            raise SceneError(f"The data must hold more values than there are free numbers, but they hold {n} for {k}.")
        sum_of_squares = sum(float(((left[name] / scales[name]) ** 2).sum()) for name in left)
        covariance = ways @ np.linalg.inv(np.einsum("ni,nj->ij", jacobian, jacobian)) @ ways.T * sum_of_squares / (n - k)
        covariance[mute, mute] = math.inf
        factor = float(student.ppf(0.5 + self.confidence / 2, n - k))
        span = np.where(np.isfinite(self.high - self.low), self.high - self.low, self._size(values))
        edge = np.minimum(values - self.low, self.high - values) < 1e-6 * span
        recording, count = misfit.recording, sum(values.size for values in misfit.measured.values())
        measured = f"{count} measured values over {recording.time[-1]:g} s ({recording.source}), {misfit.how}"
        return Fit(
            self.names, self.units, values, np.sqrt(np.diag(covariance)), covariance, self.confidence, factor,
            tuple(residual_of(name, misfit.plant.unit(name), left[name], misfit.measured[name]) for name in misfit.outputs), condition,
            tuple(name for i, name in enumerate(self.names) if edge[i] or i in rest.why), agreeing, len(found), measured,
            misfit.exact, misfit.panels(left), misfit,
            {self.names[i]: words for i, words in rest.why.items()}, tuple(name for name, silent in zip(self.names, mute.tolist(), strict=True) if silent),
            ways @ sampling_error(misfit, values, jacobian, scales),
        )  # fmt: skip

    def _along(self, values: np.ndarray, ways: np.ndarray, scales: Mapping[str, float]) -> np.ndarray:
        """Where least squares end in these directions, in which numbers that rest on each other move as one."""
        from scipy.optimize import least_squares

        size = self._size(values)
        length = np.array([size[way != 0].max() for way in ways.T])
        low = np.array([np.max((self.low - values)[way != 0]) for way in ways.T]) / length
        high = np.array([np.min((self.high - values)[way != 0]) for way in ways.T]) / length

        def slopes(z: np.ndarray) -> np.ndarray:
            return self._weighed(self.misfit.slopes(values + ways @ (z * length), size), scales) @ ways * length

        found = least_squares(
            lambda z: residuals(self.misfit, values + ways @ (z * length), scales), np.zeros(ways.shape[1]), slopes,
            bounds=(np.minimum(low, -1e-15), np.maximum(high, 1e-15)), xtol=1e-10, ftol=1e-12, gtol=1e-12, max_nfev=100,
        )  # fmt: skip
        return values + ways @ (found.x * length)

    def _from_all_starts(self, trial: Any, scales: Mapping[str, float]) -> list[Any]:
        """What every start comes to that can be simulated; raises the first error where none can."""
        found: list[Any] = []
        reason: Exception | None = None
        evaluations = itertools.count(1)
        with progress_bar(self.starts, "fit", unit="start") as bar:
            for begin in self._begins():
                if len(found) == self.starts:
                    break
                try:
                    found.append(
                        self._descend(begin, scales, trial.horizons(), lambda: bar.set_postfix_str(f"{next(evaluations)} evaluations"))
                    )
                    bar.update()
                except (SceneError, SimulationError) as error:  # numbers that contradict each other, or cannot be simulated
                    reason = reason or error
        if not found:
            raise reason or SimulationError("No start of the fit could be simulated.")
        return found

    def _weighed(self, found: Mapping[str, np.ndarray], scales: Mapping[str, float]) -> np.ndarray:
        """All signals in a row, in parts of their noise."""
        return np.concatenate([found[name] / scales[name] for name in self.misfit.outputs])

    def _given_noise(self, sizes: Mapping[str, float]) -> dict[str, float]:
        if self.noise is None:
            return dict(sizes)
        return {name: number(f"noise.{name}", self.noise.get(name), above=0) for name in self.misfit.outputs}

    def _size(self, values: np.ndarray) -> np.ndarray:
        """What a number is measured by: its value, or the declared one, or the width of its bounds where both are zero."""
        width = np.where(np.isfinite(self.high - self.low), self.high - self.low, 1.0)
        size = np.maximum(np.abs(values), np.abs(self.first))
        return np.where(size > 0, size, width)

    def _begins(self) -> list[np.ndarray]:
        from scipy.stats import qmc

        size = self._size(self.first)
        around = (self.first - 0.5 * size, self.first + size)  # half and twice
        low = np.where(np.isfinite(self.high - self.low), self.low, np.maximum(around[0], self.low))
        high = np.where(np.isfinite(self.high - self.low), self.high, np.minimum(around[1], self.high))
        inside = np.clip(self.first, self.low + 1e-6 * (high - low), self.high - 1e-6 * (high - low))
        drawn = qmc.LatinHypercube(len(self.names), rng=self.seed).random(DRAWS * (self.starts - 1))
        return [inside, *(low + drawn * (high - low))]

    def _descend(
        self, begin: np.ndarray, scales: Mapping[str, float], horizons: Sequence[Any], tell: Callable[[], object] = lambda: None
    ) -> Any:
        """Where least squares end from some numbers, over longer and longer parts of the data; tell: called after each evaluation of the model."""
        from scipy.optimize import least_squares

        size = self._size(self.first)
        values = begin
        for misfit in horizons:
            misfit.model(values)  # raises the error that says why these numbers cannot be simulated

            def slopes(q: np.ndarray, misfit: Any = misfit) -> np.ndarray:
                found = misfit.slopes(q * size, self._size(q * size))
                return np.concatenate([found[name] * (size / scales[name]) for name in misfit.outputs])

            def left(q: np.ndarray, misfit: Any = misfit) -> np.ndarray:
                tell()
                return residuals(misfit, q * size, scales)

            whole = misfit is self.misfit
            given: dict[str, Any] = {"fun": left, "jac": slopes, "x0": values / size}
            given |= {
                "x_scale": "jac",
                "xtol": 1e-10 if whole else 1e-4,
                "ftol": 1e-12 if whole else 1e-4,
                "gtol": 1e-12,
                "max_nfev": 100 if whole else 30,
            }
            found: Any = self._unbounded(given, size) if isinstance(misfit, MeasuredLoop) else None
            found = found or least_squares(**given, bounds=(self.low / size, self.high / size))
            values = found.x * size
        found.x = values
        return found

    def _unbounded(self, given: Mapping[str, Any], size: np.ndarray) -> Any:
        """Where the method of Levenberg and Marquardt ends, which takes a third of the time for long data; None where a bound is or comes near."""
        from scipy.optimize import least_squares

        edge = 1e-3 * size
        with contextlib.suppress(SceneError, SimulationError):
            if np.all(given["x0"] * size > self.low + edge) and np.all(given["x0"] * size < self.high - edge):
                found = least_squares(**given, method="lm")
                if found.success and np.all(found.x * size > self.low + edge) and np.all(found.x * size < self.high - edge):
                    return found
        return None

    def _left(self, values: np.ndarray) -> dict[str, np.ndarray]:
        model = self.misfit.model(values)
        return {name: model[name] - self.misfit.measured[name] for name in self.misfit.outputs}

    def _identifiable(self, names: Sequence[str], per_part: np.ndarray) -> float:
        """Condition of the scaled Jacobian; raises SceneError where it is singular, and names what is to blame."""
        length = np.sqrt((per_part**2).mean(axis=0))
        mute = [name for name, size in zip(names, length, strict=True) if size < MUTE]
        if mute:
            words = " and ".join(f"`{name}`" for name in mute)
            raise SceneError(
                f"Argument `free` must hold numbers that the data depend on, but {words} changes none of the measured signals."
            )
        square, directions = np.linalg.eigh(np.einsum("ni,nj->ij", per_part, per_part) / (length[:, None] * length * len(per_part)))
        singular = np.sqrt(np.maximum(square, 0.0))
        if singular[0] < SINGULAR * singular[-1]:
            direction = directions[:, 0] / length
            direction /= np.abs(direction).max()
            involved = [(name, part) for name, part in zip(names, direction, strict=True) if abs(part) > 0.05]
            words = " and ".join(f"`{name}`" for name, _ in involved)
            changes = ", ".join(f"{100 * part:+.3g} % of `{name}`" for name, part in involved)
            raise SceneError(
                f"Argument `free` must hold numbers that the data can tell apart, but {words} cannot be: changes in the ratio {changes} "
                f"leave every residual as it is (singular values {singular[0]:.1e} : {singular[-1]:.1e}). Fix all of them but one."
            )
        return float(singular[-1] / singular[0])
