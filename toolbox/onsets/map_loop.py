"""The closed loop behind a severity map: its steady states and their growth at all points at once, and the runs that both branches begin with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.arguments import number
from toolbox.errors import SceneError
from toolbox.files.unit_systems import asked_in
from toolbox.files.units import NumberOrText
from toolbox.measuring import measures
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.elements import check_one_direction
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.numbers import Number
from toolbox.modelling.steady_point import closed_signal, function_of, mode_numbers
from toolbox.scenes.judged import judged_contact, judged_speed
from toolbox.simulation.request import Request
from toolbox.simulation.run import Run
from toolbox.steady_states.linear import holding_elements, residual_functions, state_labels, steady_state
from toolbox.sweeps.batch import Numbers, Task
from toolbox.sweeps.designs import Variations
from toolbox.sweeps.executors import evaluated
from toolbox.sweeps.results import Sweep
from toolbox.sweeps.store import Store
from toolbox.sweeps.variants import run_fingerprint, varied_numbers

SMOOTH, SWING, STICK_SLIP, STUCK, NONE = 0, 1, 2, 3, -1
VERDICTS = {SMOOTH: "smooth", SWING: "swing", STICK_SLIP: "stick-slip", STUCK: "stuck", NONE: "none"}
"""Verdicts: the disturbance dies; it grows or lasts without stick; stick phases come back until the end; rest for good; no steady state, or failed."""

SLOWED = 0.01
"""Part of its slip that the judged contact loses at once on the smooth branch, where a disturbance grows."""

TANGENT = 1e-5
"""Part of the way to the next points by which the slope of the steady states along it is told."""

FAINT = 1e-4
"""The same where it dies: so little that the unstable cycle near a hard loss of stability is not met."""


def _judged_time(loop: ClosedLoop, duration: NumberOrText | None, after: NumberOrText | None) -> tuple[float, float]:
    """Begin and end of what is judged [s]; raises SceneError where there is no time between them."""
    end = number("duration", (loop.duration or 120.0) if duration is None else duration, "s", above=0)
    if after is None:
        return (loop.after if loop.after is not None and loop.after < end else end / 2), float(end)
    return float(number("after", after, "s", above=0, below=end)), float(end)


@dataclass
class MapLoop:
    """The closed loop of a map: as it runs, and in its continuous form with its steady states."""

    title: str
    numbers: tuple[Number, Number]
    ranges: tuple[tuple[float, float], ...]
    run: Run
    closed: HybridSystem
    element: str
    signal: str
    after: float
    inputs: dict[str, float]
    modes: np.ndarray
    middle: np.ndarray
    rest: np.ndarray
    notes: list[str]
    asked: dict[str, str]

    @staticmethod
    def of(
        loop: ClosedLoop,
        over: Mapping[str, tuple[NumberOrText, NumberOrText]],
        duration: NumberOrText | None,
        after: NumberOrText | None,
        mode: Mapping[str, str] | None,
        guess: Mapping[str, Any] | None,
    ) -> MapLoop:
        """The loop with what is asked of it. Raises SceneError for what no map can be made of."""
        begin, end = _judged_time(loop, duration, after)
        if not isinstance(over, Mapping) or len(over) != 2:
            raise SceneError(f"Argument `over` must map two names to (low, high), but it is {over!r}.")
        continuous = loop.continuous
        free = [continuous.acting(name, "severity_map") for name in over]
        ranges = tuple(number.between(ends, number.name) for number, ends in zip(free, over.values(), strict=True))
        middle = np.array([sum(ends) / 2 for ends in ranges])
        for each, value in zip(free, middle.tolist(), strict=True):
            continuous, loop = each.put(continuous, value), each.put(loop, value)
        closed, inputs = continuous.system, continuous.constant_inputs("a steady state")
        check_one_direction(closed.elements, "A map", "judge runs of it, by `sweep`")
        rest = steady_state(closed, inputs, guess, mode)
        contact = judged_contact(continuous)
        m = mode_numbers(closed, rest.modes)
        if m[[e.name for e in closed.elements].index(contact)] == 0.0:
            raise SceneError(f"The contact `{contact}` must slip in the steady state in the middle of the map, but it sticks.")
        speed = judged_speed(continuous, contact)
        notes = []
        if loop.sampled:
            notes.append("the linear border is that of the continuous form of the law; the others are of the law as it runs, sampled")
        return MapLoop(
            title=loop.title,
            numbers=(free[0], free[1]),
            ranges=ranges,
            run=Request(loop, end, accuracy=loop.accuracy or 1e-6).checked(),
            closed=closed,
            element=contact,
            signal=speed,
            after=begin,
            inputs=inputs,
            modes=m,
            middle=middle,
            rest=rest.states,
            notes=notes,
            asked={
                number.unit: asked_in(number.in_si(name, over[name]), number.unit)
                for name, number in reversed([*zip(over, free, strict=True)])
            },
        )

    @property
    def names(self) -> tuple[str, str]:
        """Names of the two numbers."""
        return self.numbers[0].name, self.numbers[1].name

    @property
    def units(self) -> tuple[str, str]:
        """Their units."""
        return self.numbers[0].unit, self.numbers[1].unit

    def _numbers(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters and inputs of the continuous form at all points, one column each."""
        values = np.repeat(self.closed.values[:, None], len(points), axis=1)
        for free, column in zip(self.numbers, points.T, strict=True):
            if not free.is_input:
                values[self.closed._parameter(free.name).offset] = column
        u = np.array(self.closed.input_defaults(values)).reshape(-1, len(points))
        names = list(self.closed.inputs)
        for name, value in self.inputs.items():
            u[names.index(name)] = value
        for free, column in zip(self.numbers, points.T, strict=True):
            if free.is_input:
                u[names.index(free.name)] = column
        return values, u

    def steady(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States of steady running at all points, shape (n, points), and where it was found: Newton's method, for all points at once.

        From the middle of the map to each point in steps; contacts must slide the way they do in the middle.
        """
        residual, slopes = residual_functions(self.closed)
        size, n = len(points), self.rest.size
        sticking = (self.modes == 0.0) & holding_elements(self.closed)
        m = np.repeat(self.modes[:, None], size, axis=1)
        x = np.repeat(self.rest[:, None], size, axis=1)
        step = np.zeros_like(x)

        def moved(x: np.ndarray, values: np.ndarray, u: np.ndarray, at: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
            """Newton's step at parameters and inputs, with the slopes at others."""
            flow, slip = (np.array(v) for v in residual(0.0, x, u, values, m))
            of_flow, of_slip = (np.array(v).reshape(-1, size, n).transpose(1, 0, 2) for v in slopes(0.0, x, at[1], at[0], m))
            rows = np.concatenate([flow, slip[sticking]]).T[:, :, None]
            matrix = np.concatenate([of_flow, of_slip[:, sticking]], axis=1)
            good = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(rows).all(axis=(1, 2))
            step = np.full_like(x, np.nan)
            step[:, good] = -(np.linalg.pinv(matrix[good], rcond=1e-13) @ rows[good])[:, :, 0].T
            return step

        before = 0.0
        for part in (0.2, 0.4, 0.6, 0.8, 1.0):
            # along the tangent first: a guess that saturates a drive or its layer has slopes that lead nowhere
            here = self._numbers(self.middle + before * (points - self.middle))
            values, u = self._numbers(self.middle + (before + TANGENT * (part - before)) * (points - self.middle))
            x = x + moved(x, values, u, here) / TANGENT
            values, u = self._numbers(self.middle + part * (points - self.middle))
            for _ in range(12 if part == 1.0 else 4):
                step = moved(x, values, u, (values, u))
                x = x + step
                if not (np.abs(step).max(axis=0) > 1e-13 * np.abs(x).max(axis=0)).any():  # nan where there is none
                    break
            before = part
        scale = np.abs(x).max(axis=0) + 1e-300
        slips = np.array(residual(0.0, x, u, values, m)[1])
        sliding = np.array([e.law is not None for e in self.closed.elements]) & (self.modes != 0.0)
        found = np.isfinite(x).all(axis=0) & (np.abs(step).max(axis=0) <= 1e-8 * scale) & (slips[sliding] * m[sliding] > 0).all(axis=0)
        return np.where(found, x, self.rest[:, None]), found

    def growth(self, points: np.ndarray) -> np.ndarray:
        """Largest real part of the poles of steady running at all points [1/s], but for those at zero; nan without steady running."""
        x, found = self.steady(points)
        values, u = self._numbers(points)
        _, slopes = residual_functions(self.closed)
        a = np.array(slopes(0.0, x, u, values, np.repeat(self.modes[:, None], len(points), axis=1))[0])
        poles = np.linalg.eigvals(a.reshape(x.shape[0], len(points), x.shape[0]).transpose(1, 0, 2))
        size = np.abs(poles).max(axis=1, keepdims=True)
        real = np.where(np.abs(poles) > 1e-9 * size, poles.real, -np.inf).max(axis=1)
        return np.where(found, real, np.nan)

    @property
    def sampled(self) -> bool:
        """Whether a law is sampled, so that the growth of the continuous form is not that of the loop as it runs."""
        return bool(self.run.system.updates)

    def task(self, points: np.ndarray, stopped: np.ndarray, measures: tuple[Any, ...] = ()) -> tuple[Task, Variations, dict[int, str]]:
        """The runs from all points, what varies in them, and which are broken; stopped: on which branch each is. Smooth running is judged without noise."""
        variations = Variations(self.names, points, (len(points),))
        shared, broken = varied_numbers(self.run, variations)
        numbers: np.ndarray | Numbers = shared
        noises = [entry for name, entry in self.run.system.parameters.items() if name.endswith(".sensors.noise")]
        if noises:
            numbers = written = np.array(shared)
            for entry in noises:
                written[~stopped, entry.offset : entry.offset + (entry.size or 1)] = 0.0
        x, found = self.steady(points)
        values, u = self._numbers(points)
        broken = {**broken, **{int(i): "There is no steady running." for i in np.flatnonzero(~found)}}
        with np.errstate(invalid="ignore"):
            lost = np.where(stopped, 1.0, FAINT if not self.sampled else SLOWED)
            if not self.sampled:
                lost = np.where(~stopped & (self.growth(points) > 0), SLOWED, lost)
        return Task(self.run, numbers, measures, *self._begins(x, u, values, lost)), variations, broken

    def verdicts(
        self, points: np.ndarray, stopped: np.ndarray, executor: Any, path: Path | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[int, str]]:
        """(severity, part of the time in stick, verdict) of a run from every point, and failures; stopped: on which branch each is.

        Whether a disturbance of smooth running grows is told by the poles. Of a sampled law it is told by the run: from the third quarter of the judged
        time to the last, when all but the least damped motion have died.
        """
        end, middle = self.run.duration, (self.after + self.run.duration) / 2
        asked = {
            "severity": measures.severity(self.signal, self.after), "stuck_ratio": measures.stuck_ratio(self.element, self.after),
            "late_stuck_ratio": measures.stuck_ratio(self.element, end - 0.25 * (end - self.after)),
            "early_minimum": measures.minimum(self.signal, self.after, middle),
            "early_maximum": measures.maximum(self.signal, self.after, middle), "minimum": measures.minimum(self.signal, middle),
            "maximum": measures.maximum(self.signal, middle),
        }  # fmt: skip
        task, variations, broken = self.task(points, stopped, tuple(asked.values()))
        store = None
        if path is not None:
            sheet = Sweep(
                self.title, self.names, self.units, points, variations.shape, (), {}, {name: each.unit_in(self.run.system) for name, each in
                asked.items()}, duration=end, accuracy=self.run.accuracy,
            )  # fmt: skip
            store = Store(path, sheet, run_fingerprint(task, variations, tuple(asked)))
        result, errors, _ = evaluated(task, broken, executor, store, label="map")
        severity, ratio, late, low0, high0, low, high = result.T
        with np.errstate(invalid="ignore"):
            sticks = (late > 0) & (ratio > max(10 * self.run.accuracy, 1e-9))
            floor = 10 * self.run.accuracy * np.maximum(np.abs(high), np.abs(low))
            grows = (high - low > high0 - low0) & (high - low > floor)
            if not self.sampled:
                grows = np.where(stopped, grows, self.growth(points) > 0)
        verdict = np.where(sticks, np.where(ratio > 1 - 1e-9, STUCK, STICK_SLIP), np.where(grows, SWING, SMOOTH))
        return severity, ratio, np.where(np.isfinite(low), verdict, NONE), errors

    def _begins(self, x: np.ndarray, u: np.ndarray, values: np.ndarray, lost: np.ndarray) -> tuple[Any, Any, Any]:
        """(starts, memories, held signals) of runs from steady states whose judged contact loses a part of its slip at once."""
        closed, system, size = self.closed, self.run.system, x.shape[1]
        m = np.repeat(self.modes[:, None], size, axis=1)
        stuck = m.copy()
        stuck[[e.name for e in closed.elements].index(self.element)] = 0.0
        halt = closed.function("projected", closed.switching.projected, "stopped")
        at_rest = np.array(halt(0.0, x, u, values, stuck)).reshape(x.shape)
        begin = x + lost * (at_rest - x)
        labels = [name for name, _ in state_labels(closed)]
        starts = np.stack([begin[labels.index(name)] for name, _ in state_labels(system)], axis=1)
        if not system.updates:
            return starts, None, None
        memories, held = [], np.zeros((size, system.held.numel()))
        for update in system.updates:
            for i in range(update.memory.numel()):
                name = update.memory[i].name()
                if name not in labels:
                    note = f"the memory {name} of a sampled law is no state of its continuous form, and begins at zero"
                    self.notes += [note] if note not in self.notes else []
                memories.append(x[labels.index(name)] if name in labels else np.zeros(size))
            memories += [np.zeros(size)] * len(update.channels)
            for i, name in enumerate(update.names):
                function = function_of(closed, ("signal", name), lambda name=name: [closed_signal(closed, name)])  # type: ignore[misc]
                held[:, update.first_held + i] = np.array(function(0.0, x, u, values, m)).ravel()
        return starts, np.stack(memories, axis=1) if memories else np.zeros((size, 0)), held
