"""Reads measures of thousands of runs as they go: extrema, means, severity, stick time and events, without a trajectory in Python.

    s, s' = s_t + s_x f, s'' = s'_t + s'_x f      of every signal, compiled, at the nodes of a run

Between two nodes a signal is the quintic with these values at both ends. Where it differs from the cubic with the values and slopes alone by more than ten
times the accuracy of the run, the step is divided, by stepping from its left node to the middle as `run.at` does; the quintic is then better than the
accuracy by orders. Means are integrals of these quintics, extrema their peaks, stays in a mode are cut at located events. Nodes are read as the
event loop fills its buffer, so that a long run needs no more memory than a short one.

Why not the nodes alone: see `toolbox.measure`, with which these numbers agree to the accuracy of the run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from toolbox.compilation import work_layout
from toolbox.compilation.notices import announced
from toolbox.compilation.program import Program
from toolbox.measuring.metrics import Metric
from toolbox.measuring.quintics import _compiled, _tolerance
from toolbox.measuring.severity import Extent, severity_of
from toolbox.measuring.stay_loop import Stays, read_events

OF_SIGNALS = ("lowest", "highest", "mean", "severity", "peak", "ends")
"""What is read of a signal, in the words of `Measure.compiled`; all else is read of an element."""


class Layout:
    """Where measures of one program are read: `signals` in `windows` (begin, end), and `asked` stays and switches (element, mode, begin, end).

    Behind the signals come the bounds of friction that vary without a guard, smallest and largest over the run: negative ones are refused. `count` of both.
    """

    def __init__(self, program: Program, metrics: Sequence[Metric], duration: float):
        self.program, self.metrics, self.duration = program, tuple(metrics), duration
        spans = [(float(m.after or 0.0), duration if m.until is None else float(m.until)) for m in self.metrics]
        of_signals = [(m, span) for m, span in zip(self.metrics, spans, strict=True) if m.compiled in OF_SIGNALS]
        self.signals = tuple(dict.fromkeys(m.of for m, _ in of_signals))
        windows = list(dict.fromkeys(span for _, span in of_signals))
        bounds = program.unguarded if metrics else []
        if bounds and (0.0, duration) not in windows:
            windows.append((0.0, duration))
        self.windows = np.array(windows, float).reshape(-1, 2)
        self.places = [
            (self.signals.index(m.of), windows.index(span)) if m.compiled in OF_SIGNALS else None
            for m, span in zip(self.metrics, spans, strict=True)
        ]
        self.whole = windows.index((0.0, duration)) if bounds else 0
        self.rows = [-1] * len(self.metrics)
        asked: list[tuple[float, ...]] = []
        for q, (m, span) in enumerate(zip(self.metrics, spans, strict=True)):
            if m.compiled not in OF_SIGNALS:
                i, words = program.system.element_modes(m.of)
                self.rows[q] = len(asked)
                asked.append((i, next((number for number, word in words.items() if word == m.mode), -9), *span))
        self.asked = np.array(asked, float).reshape(-1, 4)
        self.count = len(self.signals) + len(bounds)

    def values(self, found: Readings) -> np.ndarray:
        """The measures, shape (..., measures)."""
        return (
            np.stack([self._value(q, m, found) for q, m in enumerate(self.metrics)], axis=-1)
            if self.metrics
            else np.zeros((*found.ends.shape[:-1], 0))
        )

    def _value(self, q: int, m: Metric, found: Readings) -> Any:
        place = self.places[q]
        if place is None:
            spent, row = found.spent[..., self.rows[q]], self.asked[self.rows[q]]
            return spent / (row[3] - row[2]) if m.compiled == "ratio" else getattr(found, m.compiled)[..., self.rows[q]]
        if m.compiled == "ends":
            return found.ends[..., place[0]]
        low, high = found.lowest[..., place[0], place[1]], found.highest[..., place[0], place[1]]
        if m.compiled in ("lowest", "highest"):
            return low if m.compiled == "lowest" else high
        if m.compiled == "peak":
            return np.maximum(np.abs(low), np.abs(high))
        begin, end = self.windows[place[1]]
        average = np.minimum(np.maximum(found.integral[..., place[0], place[1]] / (end - begin), low), high)
        if m.compiled == "mean":
            return average
        extents = zip(low.ravel().tolist(), high.ravel().tolist(), average.ravel().tolist(), strict=True)
        ratios = [severity_of(Extent(*extent, math.nan, math.nan), **dict(m.settings)) for extent in extents]
        return np.array(ratios).reshape(low.shape)

    def negative(self, found: Readings) -> np.ndarray:
        """Which of the bounds that vary without a guard were negative, shape (..., bounds)."""
        if self.count == len(self.signals):
            return np.zeros((*found.ends.shape[:-1], 0), bool)
        low, high = (each[..., len(self.signals) :, self.whole] for each in (found.lowest, found.highest))
        return low < -1e-9 * np.maximum(np.abs(low), np.abs(high))

    def broken_bound(self, found: Readings) -> str | None:
        """Return a message about a bound of friction that was negative during a run; None if there was none."""
        for k in np.flatnonzero(self.negative(found)):
            element = self.program.system.elements[self.program.unguarded[k]]
            return element.negative_bound(f"is {found.lowest[len(self.signals) + k, self.whole]:.6g} during the run")
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
_NO_NODES = np.empty((0, 1))


class RunningMeasures:
    """Reads the measures of runs of one program, one run after the other: `begin()`, `read(work)` whenever the event loop returns, `values()`.

    One for each thread.
    """

    def __init__(self, program: Program, metrics: Sequence[Metric], duration: float, accuracy: float):
        from toolbox.measuring import measuring_loop

        self.program, self.layout = program, Layout(program, metrics, duration)
        announced("reader of measures", measuring_loop.read_nodes)
        if len(self.layout.asked):
            announced("reader of stays", read_events)
        count = self.layout.count
        by_window = (len(self.layout.windows), count)  # what the reader of nodes fills a row at a time
        self.found = replace(
            Readings.of(self.layout), lowest=np.empty(by_window).T, highest=np.empty(by_window).T, integral=np.empty(by_window).T
        )
        when, found = np.empty(by_window), self.found
        outputs = _compiled(program, self.layout.signals, program.unguarded) if count else 0
        self.reading = measuring_loop.reading(
            program, outputs, count, _tolerance(accuracy), np.empty(program.p_size), windows=self.layout.windows, lowest=found.lowest.T, ends=found.ends,
            highest=found.highest.T, when_lowest=when, when_highest=when, integral=found.integral.T, time=_NO_NODES[:, 0], state=_NO_NODES, held=_NO_NODES,
            mode=_NO_NODES.astype(np.int8),
        )  # fmt: skip
        self.size, self.since = self.reading.size, np.zeros(program.kernel.elements)

    def begin(self) -> None:
        """Reset all accumulators before the next run."""
        found = self.found
        for array in (self.size, found.ends, found.integral, self.since, found.spent, found.number, found.switches):
            array[:] = 0.0
        found.lowest[:], found.highest[:], found.latest[:] = np.inf, -np.inf, np.nan

    def read(self, work: Any, finished: bool) -> None:
        """Read the nodes and events that the loop has recorded, and make room for more."""
        from toolbox.measuring.measuring_loop import read_nodes

        ints, layout = work.ints, self.layout
        if layout.count:
            self.reading.p[:], self.reading.ints[work_layout.RECORDS] = work.p, ints[work_layout.RECORDS]
            read_nodes(self.reading._replace(time=work.rec_t, state=work.rec_x, mode=work.rec_m, held=work.rec_p))
        r = ints[work_layout.RECORDS] - 1
        if r > 0:
            for array in (work.rec_t, work.rec_x, work.rec_m, work.rec_p):
                array[0] = array[r]
            ints[work_layout.RECORDS] = 1
        if len(layout.asked):
            found, counted = self.found, np.array([ints[work_layout.EVENTS], finished])
            end = work.reals[work_layout.TIME : work_layout.TIME + 1]
            stays = Stays(
                counted,
                end,
                work.ev_t,
                work.ev_i,
                work.ev_m,
                work.m,
                layout.asked,
                self.since,
                found.spent,
                found.number,
                found.latest,
                found.switches,
            )
            read_events(stays)
        ints[work_layout.EVENTS] = 0

    def values(self) -> np.ndarray:
        """The measures of the finished run, shape (measures,)."""
        return self.layout.values(self.found)

    @property
    def broken_bound(self) -> str | None:
        """Message about a bound of friction that was negative during a run; None if there was none."""
        return self.layout.broken_bound(self.found)
