"""Numbers read off thousands of runs as they go: extrema, means, severity, stick time and events, without a trajectory in Python.

    s, s' = s_t + s_x f, s'' = s'_t + s'_x f      of every signal, compiled, at the nodes of a run

Between two nodes a signal is the quintic with these values at both ends. Where it differs from the cubic with the values and slopes alone by more than ten
times the accuracy of the run, the step is divided, by stepping from its left node to the middle as `run.at` does; the quintic is then better than the
accuracy by orders. Means are integrals of these quintics, extrema their peaks, stays in a mode are cut at located events. Nodes are read as the
event loop fills its buffer, so that a long run needs no more memory than a short one.

Why not the nodes alone: see `toolbox.measure`, with which these numbers agree to the accuracy of the run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from toolbox.arguments import is_finite_number, number
from toolbox.compilation import work_layout
from toolbox.compilation.notices import announced
from toolbox.compilation.program import Program
from toolbox.errors import SceneError, suggest
from toolbox.measuring.quintics import _compiled, _tolerance
from toolbox.measuring.severity import SEVERITIES, Extent, severity_of
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.simulation.samples import window
from toolbox.simulation.trajectory import Trajectory


# ---------------------------------------------------------------------------------------------------------------------------- what is measured
@dataclass(frozen=True)
class Measure:
    """One number per run, made by the functions of this module: `kind` of a signal or an element `of`, between `after` and `until` [s] (the end).

    mode: whose stays count, for an element;  definition, reference: of a severity, as in `measure.severity`.
    """

    kind: str
    of: str
    after: float = 0.0
    until: float | None = None
    mode: str = "stick"
    definition: str = "half-range"
    reference: float | None = None

    def unit(self, system: HybridSystem) -> str:
        """Unit of the number."""
        if self.kind in ("severity", "ratio", "stays", "events"):
            return "1"
        return "s" if self.kind in ("time", "last") else system.unit(self.of)

    def check(self, system: HybridSystem, duration: float) -> None:
        """Raise SceneError unless the signal or element exists, the window lies in the run, and the definition is known."""
        number("after", self.after, "s", at_least=0, below=duration)
        if self.until is not None:
            number("until", self.until, "s", above=self.after, at_most=duration)
        if self.kind in _OF_SIGNALS:
            system.signal_unit(self.of)
            if (system.rows(self.of) is None and system.expression(self.of).numel() != 1) or (system.rows(self.of) or (0, None))[
                1
            ] is not None:
                raise SceneError(f"Argument `signal` must be a scalar, but `{self.of}` has several entries: name one, e.g. `{self.of}.0`.")
            if self.definition not in SEVERITIES:
                raise SceneError(f"There is no definition of severity `{self.definition}`: {suggest(self.definition, SEVERITIES)}")
            if (self.definition == "reference") != (is_finite_number(self.reference) and self.reference != 0):
                raise SceneError(
                    f'Argument `reference` must be a set-point other than 0 with definition "reference" alone, but it is {self.reference!r}.'
                )
            return
        elements = {element.name: element for element in system.elements}
        if self.of not in elements:
            raise system.no_element(self.of)
        if self.kind != "events" and self.mode not in elements[self.of].legend.values():
            raise SceneError(f"There is no mode `{self.mode}` of `{self.of}`: {suggest(self.mode, elements[self.of].legend.values())}")

    def of_run(self, run: Trajectory) -> float:
        """The number of a trajectory that is there, by `toolbox.measure`."""
        from toolbox.measuring import measure

        span = (self.after, self.until)
        if self.kind == "final":
            return float(run.at(run.end)[self.of])
        if self.kind in ("minimum", "maximum", "mean"):
            return getattr(measure.extent(run, self.of, *span), self.kind)
        if self.kind == "severity":
            return measure.severity(run, self.of, self.after, self.definition, until=self.until, reference=self.reference)
        begin, end = window(run, *span)
        if self.kind == "events":
            return sum(event.element == self.of and begin <= event.time <= end for event in run.events)
        spent = run.time_in(self.of, self.mode, begin, end)
        if self.kind in ("time", "ratio"):
            return spent if self.kind == "time" else spent / (end - begin)
        stays: list[tuple[float, float]] = []
        for first, last, mode in run.intervals(self.of):
            first, last = max(first, begin), min(last, end)
            if mode == self.mode and first < last:
                stays = [*stays[:-1], (stays[-1][0], last)] if stays and stays[-1][1] == first else [*stays, (first, last)]
        return len(stays) if self.kind == "stays" else stays[-1][1] if stays else math.nan


_OF_SIGNALS = ("minimum", "maximum", "mean", "severity", "final")


def minimum(signal: str, after: float = 0.0, until: float | None = None) -> Measure:
    """Smallest value of a scalar signal in the window, in its unit."""
    return Measure("minimum", signal, after, until)


def maximum(signal: str, after: float = 0.0, until: float | None = None) -> Measure:
    """Largest value of a scalar signal in the window, in its unit."""
    return Measure("maximum", signal, after, until)


def mean(signal: str, after: float = 0.0, until: float | None = None) -> Measure:
    """Mean over time of a scalar signal in the window, in its unit."""
    return Measure("mean", signal, after, until)


def severity(
    signal: str = "bit.speed",
    after: float = 0.0,
    definition: str = "half-range",
    *,
    until: float | None = None,
    reference: float | None = None,
) -> Measure:
    """Severity of stick-slip [1] as `measure.severity` defines it."""
    return Measure("severity", signal, after, until, definition=definition, reference=reference)


def final(signal: str) -> Measure:
    """Value of a scalar signal at the end of the run, in its unit."""
    return Measure("final", signal)


def time_in(element: str, mode: str = "stick", after: float = 0.0, until: float | None = None) -> Measure:
    """Seconds of the window that an element spends in a mode."""
    return Measure("time", element, after, until, mode)


def stuck_ratio(element: str, after: float = 0.0, until: float | None = None) -> Measure:
    """Part of the window that an element spends in stick, 0 to 1."""
    return Measure("ratio", element, after, until)


def stays(element: str, mode: str = "stick", after: float = 0.0, until: float | None = None) -> Measure:
    """How many stays in a mode overlap the window: stick phases, or contacts with a wall."""
    return Measure("stays", element, after, until, mode)


def last_stay(element: str, mode: str = "stick", after: float = 0.0, until: float | None = None) -> Measure:
    """When the last stay in a mode ends [s], cut to the window; nan where there is none."""
    return Measure("last", element, after, until, mode)


def events(element: str, after: float = 0.0, until: float | None = None) -> Measure:
    """Number of switches of an element in the window."""
    return Measure("events", element, after, until)


STANDARD: Mapping[str, Callable[[str, str, float], Measure]] = {
    "severity": lambda signal, element, after: severity(signal, after),
    "minimum": lambda signal, element, after: minimum(signal, after),
    "maximum": lambda signal, element, after: maximum(signal, after),
    "mean": lambda signal, element, after: mean(signal, after),
    "final": lambda signal, element, after: final(signal),
    "stuck": lambda signal, element, after: time_in(element, "stick", after),
    "stuck_ratio": lambda signal, element, after: stuck_ratio(element, after),
    "sticks": lambda signal, element, after: stays(element, "stick", after),
    "last_stick": lambda signal, element, after: last_stay(element),
    "events": lambda signal, element, after: events(element),
}
"""Measures by name, of the judged signal and element from the judged time on; `last_stick` and `events` of the whole run."""


# --------------------------------------------------------------------------------------------------------------------------- where they are read
class Layout:
    """Where measures of one program are read: `signals` in `windows` (begin, end), and `asked` stays and switches (element, mode, begin, end).

    Behind the signals come the bounds of friction that vary in time, smallest and largest over the run: negative ones are refused. `count` of both.
    """

    def __init__(self, program: Program, measures: Sequence[Measure], duration: float):
        self.program, self.measures, self.duration = program, tuple(measures), duration
        spans = [(float(m.after), duration if m.until is None else float(m.until)) for m in self.measures]
        of_signals = [(m, span) for m, span in zip(self.measures, spans, strict=True) if m.kind in _OF_SIGNALS]
        self.signals = tuple(dict.fromkeys(m.of for m, _ in of_signals))
        windows = list(dict.fromkeys(span for _, span in of_signals))
        varying = program.varying if measures else []
        if varying and (0.0, duration) not in windows:
            windows.append((0.0, duration))
        self.windows = np.array(windows, float).reshape(-1, 2)
        self.places = [
            (self.signals.index(m.of), windows.index(span)) if m.kind in _OF_SIGNALS else None
            for m, span in zip(self.measures, spans, strict=True)
        ]
        self.whole = windows.index((0.0, duration)) if varying else 0
        names = [element.name for element in program.system.elements]
        self.rows = [-1] * len(self.measures)
        asked: list[tuple[float, ...]] = []
        for q, (m, span) in enumerate(zip(self.measures, spans, strict=True)):
            if m.kind not in _OF_SIGNALS:
                i = names.index(m.of)
                words = program.system.elements[i].legend
                self.rows[q] = len(asked)
                asked.append((i, next((number for number, word in words.items() if word == m.mode), -9), *span))
        self.asked = np.array(asked, float).reshape(-1, 4)
        self.count = len(self.signals) + len(varying)

    def values(self, found: Readings) -> np.ndarray:
        """The measures, shape (..., measures)."""
        return (
            np.stack([self._value(q, m, found) for q, m in enumerate(self.measures)], axis=-1)
            if self.measures
            else np.zeros((*found.ends.shape[:-1], 0))
        )

    def _value(self, q: int, m: Measure, found: Readings) -> Any:
        place = self.places[q]
        if place is not None:
            if m.kind == "final":
                return found.ends[..., place[0]]
            low, high = found.lowest[..., place[0], place[1]], found.highest[..., place[0], place[1]]
            if m.kind in ("minimum", "maximum"):
                return low if m.kind == "minimum" else high
            begin, end = self.windows[place[1]]
            average = np.minimum(np.maximum(found.integral[..., place[0], place[1]] / (end - begin), low), high)
            if m.kind == "mean":
                return average
            extents = zip(low.ravel().tolist(), high.ravel().tolist(), average.ravel().tolist(), strict=True)
            ratios = [severity_of(Extent(*extent, math.nan, math.nan), m.definition, m.reference) for extent in extents]
            return np.array(ratios).reshape(low.shape)
        row = self.rows[q]
        if m.kind == "ratio":
            return found.spent[..., row] / (self.asked[row, 3] - self.asked[row, 2])
        return {"time": found.spent, "stays": found.number, "last": found.latest, "events": found.switches}[m.kind][..., row]

    def negative(self, found: Readings) -> np.ndarray:
        """Which of the bounds that vary in time were negative, shape (..., bounds)."""
        if self.count == len(self.signals):
            return np.zeros((*found.ends.shape[:-1], 0), bool)
        low, high = (each[..., len(self.signals) :, self.whole] for each in (found.lowest, found.highest))
        return low < -1e-9 * np.maximum(np.abs(low), np.abs(high))

    def broken_bound(self, found: Readings) -> str | None:
        """What is wrong with a bound of friction that was negative during a run; None where none was."""
        for k in np.flatnonzero(self.negative(found)):
            name, low = self.program.system.elements[self.program.varying[k]].name, found.lowest[len(self.signals) + k, self.whole]
            return f"The bound of `{name}` must be >= 0, but it is {low:.6g} during the run: is its load negative?"
        return None


@dataclass(frozen=True)
class Readings:
    """What was read of a run, or of several along leading axes.

    lowest, highest, integral: of every signal in every window, shape (..., count, windows);  ends: of every signal, shape (..., count);  spent, number,
    latest, switches: seconds, stays, end of the last stay [s] and events, shape (..., asked).
    """

    lowest: np.ndarray
    highest: np.ndarray
    integral: np.ndarray
    ends: np.ndarray
    spent: np.ndarray
    number: np.ndarray
    latest: np.ndarray
    switches: np.ndarray

    @staticmethod
    def of(layout: Layout, runs: tuple[int, ...] = ()) -> Readings:
        """Empty readings, to be filled: minima at +inf, maxima at -inf, sums at 0."""
        extents, asked = (*runs, layout.count, len(layout.windows)), (*runs, len(layout.asked))
        return Readings(
            lowest=np.full(extents, np.inf), highest=np.full(extents, -np.inf), integral=np.zeros(extents), ends=np.zeros(extents[:-1]),
            spent=np.zeros(asked), number=np.zeros(asked), latest=np.full(asked, np.nan), switches=np.zeros(asked),
        )  # fmt: skip


# ---------------------------------------------------------------------------------------------------------------------------------- one by one
class RunningMeasures:
    """Reads the measures of runs of one program, one run after the other: `begin()`, `read(work)` whenever the event loop returns, `values()`.

    One for each thread.
    """

    def __init__(self, program: Program, measures: Sequence[Measure], duration: float, accuracy: float):
        from toolbox.measuring import measuring_loop

        announced("reader of measures", measuring_loop.read_nodes, measuring_loop.read_events)
        self.loops, self.program = measuring_loop, program
        self.layout = Layout(program, measures, duration)
        count = self.layout.count
        by_window = (len(self.layout.windows), count)  # what the reader of nodes fills a row at a time
        self.found = replace(
            Readings.of(self.layout), lowest=np.empty(by_window).T, highest=np.empty(by_window).T, integral=np.empty(by_window).T
        )
        field, step, project, *_, series = program.kernel.addresses
        addresses = np.array(
            [field, step, project, _compiled(program, self.layout.signals, program.varying) if count else 0, series], np.int64
        )
        kernel = program.kernel
        self.reader = measuring_loop.Reader(
            addresses,
            kernel.states,
            kernel.elements,
            kernel.guards,
            kernel.slopes,
            count,
            np.empty(program.p_size),
            program.first_held,
            _tolerance(accuracy),
        )
        when = np.empty(by_window)
        self.extremes = measuring_loop.Extremes(self.found.lowest.T, self.found.highest.T, when, when, self.found.integral.T)
        self.size = np.zeros(count)
        self.since = np.zeros(kernel.elements)
        found = self.found
        self.stays = measuring_loop.StayCounts(self.layout.asked, self.since, found.spent, found.number, found.latest, found.switches)

    def begin(self) -> None:
        """Reset all accumulators before the next run."""
        found = self.found
        for array in (self.size, found.ends, found.integral, self.since, found.spent, found.number, found.switches):
            array[:] = 0.0
        found.lowest[:], found.highest[:], found.latest[:] = np.inf, -np.inf, np.nan

    def read(self, work: Any, finished: bool) -> None:
        """Read the nodes and events that the loop has recorded, and make room for more."""
        ints, layout, loops = work.ints, self.layout, self.loops
        if layout.count:
            self.reader.p[:] = work.p
            nodes = loops.Nodes(work.rec_t, work.rec_x, work.rec_m, work.rec_p)
            loops.read_nodes(self.reader, nodes, ints[work_layout.RECORDS], layout.windows, self.size, self.extremes, self.found.ends)
        r = ints[work_layout.RECORDS] - 1
        if r > 0:
            for array in (work.rec_t, work.rec_x, work.rec_m, work.rec_p):
                array[0] = array[r]
            ints[work_layout.RECORDS] = 1
        if len(layout.asked):
            events, end = loops.Events(work.ev_t, work.ev_i, work.ev_m), work.reals[work_layout.TIME]
            loops.read_events(events, ints[work_layout.EVENTS], finished, end, work.m, self.stays)
        ints[work_layout.EVENTS] = 0

    def values(self) -> np.ndarray:
        """The measures of the finished run, shape (measures,)."""
        return self.layout.values(self.found)

    @property
    def broken_bound(self) -> str | None:
        """What is wrong with a bound of friction that was negative during the run; None where none was."""
        return self.layout.broken_bound(self.found)
