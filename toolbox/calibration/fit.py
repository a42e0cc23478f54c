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
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from toolbox.arguments import mapping, number
from toolbox.calibration.holds import EVIDENCE, STRUCTURED, evidence, fitted_evidence
from toolbox.calibration.least_squares import LeastSquares
from toolbox.calibration.locating import located
from toolbox.calibration.measured_loop import MeasuredLoop
from toolbox.calibration.memory_loop import MemoryLoop
from toolbox.calibration.recording import Recording, jumps
from toolbox.calibration.residuals import Simulated
from toolbox.calibration.results import Fit
from toolbox.calibration.shifts import shift_number, shifts_of
from toolbox.calibration.windows import MeasuredContact, Search, Together, Window, shared, windows_of
from toolbox.errors import SceneError, suggest
from toolbox.files.unit_systems import asked_units
from toolbox.files.units import NumberOrText, in_si
from toolbox.modelling.closed_loop import ClosedLoop, closed_loop, takes_loop
from toolbox.modelling.laws import names as names_of
from toolbox.modelling.number_kinds import PARAMETER
from toolbox.modelling.numbers import Number
from toolbox.simulation.request import Request


@takes_loop
def fit(
    loop: ClosedLoop,
    data: Any,
    free: str | Sequence[str],
    ranges: Mapping[str, tuple[NumberOrText, NumberOrText]] | None = None,
    *,
    columns: Mapping[str, str] | None = None,
    contact: str | MeasuredContact | None = None,
    window: tuple[NumberOrText, NumberOrText] | Window | Sequence[Window | tuple[NumberOrText, NumberOrText]] | None = None,
    noise: Mapping[str, float] | None = None,
    starts: int | Search = 4,
    confidence: float = 0.95,
    zero_order_hold: str | Sequence[str] | None = None,
) -> Fit:
    """Estimate parameters of a machine, with confidence intervals, from measured signals.

    Measured signals that are inputs of the plant drive the simulation. All other measured signals are compared with the
    simulation by nonlinear least squares.

    A simulation that sticks and slips for many cycles has many local optima. Therefore give a window of a few cycles,
    and ranges.

    Source: G. A. F. Seber, C. J. Wild, Nonlinear Regression, Wiley 1989.

    Parameters
    ----------
    loop
        A loop, or a plant. Measured inputs replace the inputs of the loop.
    data
        The measurement: the path of a log file, a mapping {column: samples}, a pandas table, a run, or a `Recording`.
    columns
        {signal: column of the log}, such as {"bit.speed": "RPM [rpm]"}. By default columns have the names of signals.
    free
        Names of the unknowns, which are estimated. The first search begins at their values in the loop, and at zero
        shift. A name is one of these:

        - a parameter (`bit.friction.static`), a constant input (`top.torque`) or a start value (`bit.speed`,
          `chain.twist.0`) of the loop;
        - a time shift, by which a channel was recorded too late: `bit.speed.shift` for one signal, or `bit.shift` for
          all measured signals of `bit` that are no inputs.
    ranges
        {unknown: (low, high)}, in which its value is searched. By default the bounds of the parameter in its part. For
        a shift by default 5 s or a tenth of the data. Samples that are closer than the largest shift to the ends of the
        data are not compared.
    contact
        Name of a contact, or a `MeasuredContact` with the speed above which the contact counts as slipping. The friction
        law of this contact is then fitted directly to measured force and measured slip, without simulation. By default
        None: the whole loop is simulated.

        The slip must be measured well, because its noise is not modelled. A friction law with memory, such as bristles,
        has internal states. Their differential equations are solved for the measured slip, given as its speed or its
        distance. The start value of an internal state, such as `belt.deflection`, may be among the unknowns in `free`.
    window
        Part of the data that is used: times (begin, end) [s], or a `Window`. Or a list of such parts, which are fitted
        together. By default all data. An unknown has the same value in all parts, unless a `Window` names it in `own`:
        it then has a separate value in this window.
    noise
        {measured signal: standard deviation of its noise, in SI}. By default the noise is estimated from the residuals.
    starts
        Number of searches from different start values, by default 4. Or a `Search` with seed, treatment of outliers,
        and accuracy of the runs.
    confidence
        Confidence level of the intervals, by default 0.95.
    zero_order_hold
        Names of measured inputs that keep the value of a sample until the next one (zero-order hold), such as the
        commands of a digital drive; () for none. All other inputs are interpolated linearly. By default the data
        decide: an input is held if the outputs support this with odds of at least 150 to 1.

    Returns
    -------
    Fit
        Estimates, intervals and residuals.

    Raises
    ------
    SceneError
        If a name is unknown, the data are bad, or the data do not determine the unknowns; the message names them.
    SimulationError
        If no start can be simulated.

    Examples
    --------
    >>> import numpy as np
    >>> from models import BitRock, wells
    >>> from toolbox import compose, fit, simulate
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> time = np.linspace(0.0, 30.0, 601)
    >>> run = simulate(rig, 30.0, inputs={"top.torque": "12 kN m"}, parameters={"bit.friction.kinetic": 0.45}, output_times=time)
    >>> torque = run["bit.torque"] + np.random.default_rng(1).normal(0.0, 20.0, time.size)
    >>> log = {"time": time, "bit.speed": run["bit.speed"], "bit.torque": torque}
    >>> found = fit(rig, log, ["bit.friction.kinetic", "bit.friction.decay"], contact="bit")
    >>> for name, value in zip(found.names, found.values):
    ...     print(f"{name} = {value:.2f}")
    bit.friction.kinetic = 0.45
    bit.friction.decay = 0.90
    """
    ranges = mapping("ranges", ranges)
    noise = None if noise is None else mapping("noise", noise)
    names = names_of(free)
    if not names or len(set(names)) < len(names):
        raise SceneError(f"Argument `free` must name at least one number, and each once, but it is {names!r}.")
    confidence = number("confidence", confidence, above=0, below=1)
    search = starts if isinstance(starts, Search) else Search(starts)
    on = MeasuredContact(contact) if isinstance(contact, str) else contact
    windows = windows_of(window)
    called = shared(names, windows) or [names]
    make: Any = _Simulating(loop, names, search.accuracy) if on is None else _AlongLoop(loop.without_controllers, names, on)
    recording = Recording.of(data, make.plant, columns)
    recording = recording if zero_order_hold is None else recording.holding(zero_order_hold)
    words = sorted({*names, *itertools.chain(*called)})
    for name in ranges:
        if name not in words:
            raise SceneError(f"Argument `ranges` has `{name}`, which is not free: {suggest(name, words)}")

    def misfit_of(recording: Recording) -> tuple[Any, np.ndarray, np.ndarray]:
        """The misfit of a recording, and the bounds of its numbers."""
        parts, begins = _parts(recording, windows)
        known = [
            _from_start(make.numbers(part), window) for part, window in zip(parts, windows or list[Window | None]([None]), strict=True)
        ]
        limits = [_bounds(numbers, own, ranges) for numbers, own in zip(known, called, strict=True)]
        each = [make.misfit(part, numbers, *ends) for part, numbers, ends in zip(parts, known, limits, strict=True)]
        misfit = each[0] if called == [names] else Together(each, called, begins)
        ends = {name: pair for own, limit in zip(called, limits, strict=True) for name, *pair in zip(own, *limit, strict=True)}
        lowest, highest = np.array([ends[number.name] for number in misfit.numbers]).T
        return misfit, lowest, highest

    def squares(misfit: Any, lowest: np.ndarray, highest: np.ndarray, first: np.ndarray, starts: int) -> LeastSquares:
        numbers = misfit.numbers
        labels, units = tuple(number.name for number in numbers), tuple(number.unit for number in numbers)
        return LeastSquares(
            misfit, labels, units, first, lowest, highest, noise, search.robust, starts, search.seed, confidence, search.growing
        )

    def searched(*given: Any) -> Fit:
        return squares(*given).fit()

    misfit, lowest, highest = misfit_of(recording)
    found = searched(misfit, lowest, highest, np.array([number.value for number in misfit.numbers]), search.starts)
    undecided = [name for name in recording.signals if name in make.plant.inputs] if on is None and recording.held is None else []
    best, other, chosen, first = EVIDENCE, (misfit, lowest, highest), tuple[str, ...](), found.values
    drawn = [recording.holding(these) for these in dict.fromkeys([tuple(undecided), *((name,) for name in undecided)]) if these]
    jumping = [name for name in undecided if jumps(recording.signals[name][np.isfinite(recording.signals[name])]).any()]
    drawings = [*drawn, *([recording.stepping(jumping)] if jumping else [])]
    for drawing in drawings:
        tried = misfit_of(drawing)
        gain = evidence(found, tried[0])
        if gain > best:
            best, other, chosen = gain, tried, drawing.held or drawing.stepped
    if not chosen and undecided and search.fits_held and max(each.correlation for each in found.residuals) > STRUCTURED:
        for drawing in drawings[:1] + drawings[len(drawn) :]:
            tried = misfit_of(drawing)
            for begin, starts in ((found.values, 1), (np.array([number.value for number in tried[0].numbers]), search.starts)):
                tied = squares(*tried, begin, starts).near()
                if (gain := fitted_evidence(found, tried[0], tied)) > best:
                    best, other, chosen, first = gain, tried, drawing.held or drawing.stepped, tied
    known = {name: dict.fromkeys(getattr(recording, name) or (), math.inf) for name in ("held", "stepped")} if on is None else {}
    if chosen:
        again = searched(*other, first, 1)  # the search from other starts is done
        found = dataclasses.replace(again, agreeing_starts=found.agreeing_starts, starts=found.starts)
        known = {"stepped" if recording_of(other[0]).stepped else "held": dict.fromkeys(chosen, best)}
    found = dataclasses.replace(found, held=known.get("held", {}), stepped=known.get("stepped", {}))
    typed = [in_si(ranges[name], unit, name) for name, unit in zip(found.names, found.units, strict=True) if name in ranges]
    return dataclasses.replace(found, display_units={**loop.display_units, **asked_units(typed)})


def recording_of(misfit: Any) -> Recording:
    """The recording of a misfit, of several windows that of the first one."""
    found: Recording = misfit.each[0].recording if isinstance(misfit, Together) else misfit.recording
    return found


def _from_start(numbers: list[Number], window: Window | None) -> list[Number]:
    """The free numbers of a window, with the start values at which its search begins."""
    given = {} if window is None else window.start
    return [dataclasses.replace(number, value=given[number.name]) if number.name in given else number for number in numbers]


def simulated(loop: ClosedLoop, data: Any, columns: Mapping[str, str] | None, window: Any, accuracy: float) -> Any:
    """The misfit by simulation without free numbers, of one window or several."""
    make, windows = _Simulating(loop, (), accuracy), windows_of(window)
    recording = Recording.of(data, make.plant, columns)
    parts, begins = _parts(recording, windows)
    nothing = np.zeros(0)
    each = [make.misfit(part, [], nothing, nothing) for part in parts]
    return each[0] if len(each) < 2 else Together(each, [()] * len(each), begins)


def _parts(recording: Recording, windows: Sequence[Window]) -> tuple[list[Recording], list[float]]:
    """The recording window by window, each on a clock of its own, and the times of the log at which these clocks begin; all of it without windows."""
    parts = [recording.between(each.begin, each.end) for each in windows] or [recording]
    return parts, [float(recording.time[recording.time >= each.begin][0]) for each in windows]


class _Simulating:
    """Makes the misfits of windows by simulation."""

    def __init__(self, loop: ClosedLoop, names: Sequence[str], accuracy: float):
        self.loop, self.names, self.accuracy = loop, names, accuracy
        self.plant = dataclasses.replace(
            loop, inputs={}
        ).system  # what drives an input of the plant in closed loop is an output of the loop

    def _driven(self, recording: Recording) -> ClosedLoop:
        driven = closed_loop(self.loop, inputs=recording.driving(self.plant))
        Request(driven, float(recording.time[-1]), accuracy=self.accuracy).checked()
        return driven

    def numbers(self, recording: Recording) -> list[Number]:
        """The free numbers as they are in a window."""
        driven = self._driven(recording)
        for name in self.names:  # tables of what was measured have very many numbers, which are no answer to a wrong name
            if shift_number(driven, recording, name) is None:
                self.loop.number(name)
        return [shift_number(driven, recording, name) or _free(driven, recording, name) for name in self.names]

    def misfit(self, recording: Recording, numbers: list[Number], low: np.ndarray, high: np.ndarray) -> Simulated:
        """The misfit of a window. Raises SceneError where nothing is left to be compared."""
        found = Simulated(self._driven(recording), recording, numbers, self.accuracy, shifts_of(self.loop, numbers, recording, low, high))
        if not found.outputs:
            raise SceneError(
                "The data must hold an output to be compared with, but all their signals are inputs: " + ", ".join(recording.signals) + "."
            )
        if short := next((name for name in found.outputs if found.time[name].size < 3), None):
            raise SceneError(f"The data must hold more of `{short}` than shifts reach from both ends: give closer bounds of the shift.")
        return found


class _AlongLoop:
    """Makes the misfits of windows from the measured loop of a contact."""

    def __init__(self, loop: ClosedLoop, names: Sequence[str], on: MeasuredContact):
        self.loop, self.names, self.on = loop, names, on
        self.plant = loop.assembly.plant
        self.remembers = on.name in self.plant.modeless

    def numbers(self, recording: Recording) -> list[Number]:
        """The free numbers."""
        return [shift_number(self.loop, recording, name) or self._number(name) for name in self.names]

    def _number(self, name: str) -> Number:
        return self.loop.number(name) if self.remembers and self.plant.state_index(name) is not None else _parameter(self.loop, name)

    def misfit(self, recording: Recording, numbers: list[Number], low: np.ndarray, high: np.ndarray) -> Any:
        """The misfit of a window."""
        shifts = shifts_of(self.loop, numbers, recording, low, high)
        if self.remembers:
            first = np.clip([number.value for number in numbers], low, high)
            return MemoryLoop(self.loop, recording, numbers, self.on.name, shifts).resolved(first)
        made = MeasuredLoop(self.loop, recording, numbers, self.on.name, self.on.standstill_speed, shifts)
        return located(made, low, high) if shifts else made


def _parameter(loop: ClosedLoop, name: str) -> Number:
    """A parameter of the plant by name; raises SceneError for any other name."""
    entry = loop.plant._parameter(name)
    if entry.size is not None:
        raise SceneError(f"Argument `free` must hold single numbers, such as `{name}.0`, but `{name}` has {entry.size} entries.")
    value = float(loop.assembly.plant.values[entry.offset])
    return Number(name, entry.unit, PARAMETER, value, entry.meaning, entry.bounds)


def _free(loop: ClosedLoop, recording: Recording, name: str) -> Number:
    """A number of the loop that is neither measured nor varies in time, or the start value of a measured state; raises SceneError for any other."""
    number = loop.number(name)
    if name in recording.signals and name not in loop.inputs and not number.is_start:
        raise SceneError(f"Argument `free` must not hold `{name}`, because it is measured.")
    if not math.isfinite(number.value):
        raise SceneError(f"Argument `free` must hold constant inputs, but `{name}` varies in time or is measured.")
    return number


def _bounds(numbers: Sequence[Number], called: Sequence[str], bounds: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """(low, high) of every free number: as given under the name that it has in the fit, or that it has in the loop, or as its part declares."""
    low, high = np.full(len(numbers), -np.inf), np.full(len(numbers), np.inf)
    for i, (each, name) in enumerate(zip(numbers, called, strict=True)):
        given = name if name in bounds else each.name
        if given in bounds:
            low[i], high[i] = each.between(bounds[given], f"bounds.{given}")
        elif each.bounds:
            lowest = [value for value in (each.bounds["at_least"], each.bounds["above"]) if value is not None]
            low[i] = max(lowest, default=-np.inf)
            high[i] = np.inf if each.bounds["at_most"] is None else each.bounds["at_most"]
            if each.bounds["above"] is not None and each.bounds["above"] == low[i]:
                low[i] += 1e-12 * max(abs(each.value), 1e-300)
    return low, high
