"""The closed loop behind a severity map: its two numbers as places of a plane, and the steady states of its continuous form at many of them at once."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray, number
from toolbox.errors import NoSteadyState, SceneError
from toolbox.files.units import NumberOrText
from toolbox.measuring import judge
from toolbox.measuring.judge import BUDGET
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.numbers import Number
from toolbox.modelling.steady_point import Equilibrium, mode_numbers
from toolbox.modelling.two_directions import check_one_direction
from toolbox.onsets.borders import coordinates
from toolbox.onsets.carried import JudgedRuns
from toolbox.onsets.growth import SmoothBranch, check_autonomous
from toolbox.scenes.judged import judged_contact, judged_speed
from toolbox.simulation.request import Request, accuracy_of
from toolbox.steady_states.equilibria import state_values
from toolbox.steady_states.linear import holding_elements, open_limits, residual_functions, steady_state
from toolbox.steady_states.zeros import vanishes

SMOOTH, SWING, STICK_SLIP, STUCK, NONE = 0, 1, 2, 3, -1
VERDICTS = {judge.SMOOTH: SMOOTH, judge.SWINGS: SWING, judge.STICKS: STICK_SLIP, judge.STANDS: STUCK}
"""Numbers of the regimes of the judge; `NONE` is that of all others: no steady running, a run that failed, or one that nothing has decided."""

PERTURBATION = 1e-3
"""Disturbance of smooth running, as a part of the steady slip."""

TANGENT = 1e-5
"""Part of the way to the next places by which the slope of the steady states along it is told."""

MIDDLE = 0.5 + 0.5j
"""The place in the middle of a map."""


@dataclass(frozen=True)
class Plane:
    """The plane of two numbers. A place in it is a complex number: the first one, in parts of its range, is the real part, the second the imaginary part.

    Coordinates are the numbers themselves, or the logarithms of those that are spaced by it.
    """

    numbers: tuple[Number, Number]
    ranges: tuple[tuple[float, float], tuple[float, float]]
    logarithmic: tuple[bool, bool] = (False, False)

    @staticmethod
    def of(loop: ClosedLoop, over: Mapping[str, tuple[NumberOrText, NumberOrText]], logarithmic: Sequence[str] = ()) -> Plane:
        """The plane over two numbers of a loop. Raises SceneError for names and ranges that make none."""
        if not isinstance(over, Mapping) or len(over) != 2:
            raise SceneError(f"Argument `ranges` must map two names to (low, high), but it is {over!r}.")
        first, second = (loop.differentiable_number(name, "severity_map", lambda number: number.kind.borders) for name in over)
        ranges = tuple(each.span(ends, each.name) for each, ends in zip((first, second), over.values(), strict=True))
        for each, ends in zip((first, second), ranges, strict=True):
            for end in ends:
                each.check(end)
        if isinstance(logarithmic, str) or not set(logarithmic) <= {*over, first.name, second.name}:
            raise SceneError(f"Argument `logarithmic` must list names of `ranges`, but it is {logarithmic!r}.")
        spaced = [name in logarithmic or each.name in logarithmic for name, each in zip(over, (first, second), strict=True)]
        for each, (low, _), by_logarithm in zip((first, second), ranges, spaced, strict=True):
            if by_logarithm and not low > 0.0:
                raise SceneError(f"Argument `{each.name}` must be > 0 {each.unit} to be spaced by its logarithm, but it begins at {low:g}.")
        return Plane((first, second), (ranges[0], ranges[1]), (spaced[0], spaced[1]))

    @property
    def names(self) -> tuple[str, str]:
        """Names of the two numbers."""
        return self.numbers[0].name, self.numbers[1].name

    @cached_property
    def ends(self) -> FloatArray:
        """Coordinates of both ends, shape (number, end)."""
        return coordinates(np.array(self.ranges).T, self.logarithmic).T

    def place(self, point: Sequence[float] | FloatArray) -> complex:
        """The place of two coordinates."""
        parts = [float((value - low) / (high - low)) for value, (low, high) in zip(point, self.ends, strict=True)]
        return complex(*parts)

    def at(self, values: Sequence[float]) -> complex:
        """The place of two values in SI."""
        return self.place(coordinates(np.asarray(values, float), self.logarithmic))

    def point(self, place: complex) -> list[float]:
        """The two values of a place, in SI."""
        parts = zip((place.real, place.imag), self.ends, strict=True)
        found = [float(low + part * (high - low)) for part, (low, high) in parts]
        return [math.exp(value) if spaced else value for value, spaced in zip(found, self.logarithmic, strict=True)]

    def in_si(self, points: FloatArray) -> FloatArray:
        """The values of coordinates, shape (..., 2), in SI; those of both ends are the ends of the ranges exactly."""
        found = np.array(points, float)
        for k in np.flatnonzero(self.logarithmic):
            given = found[..., k]
            ends = [given == end for end in self.ends[k]]
            found[..., k] = np.select(ends, self.ranges[k], np.exp(given))
        return found

    def values(self, place: complex) -> list[tuple[Number, float]]:
        """The numbers with their values at a place."""
        return list(zip(self.numbers, self.point(place), strict=True))


@dataclass
class SteadyPlane:
    """The steady states of a closed loop at places of a plane, in which contacts slide the way they do in the middle; each place once."""

    closed: HybridSystem
    inputs: dict[str, float]
    plane: Plane
    middle: Equilibrium
    known: dict[complex, Equilibrium | None] = field(default_factory=dict)

    def __call__(self, place: complex) -> Equilibrium | None:
        """The steady state at a place; None where none is found."""
        self.learn([place])
        return self.known[place]

    def _numbers(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters and inputs at all points, one column each."""
        values = np.repeat(self.closed.values[:, None], len(points), axis=1)
        for free, column in zip(self.plane.numbers, points.T, strict=True):
            if not free.is_input and self.closed.has_parameter(free.name):  # the continuous form has no sample time
                values[self.closed._parameter(free.name).offset] = column
        u = np.array(self.closed.input_defaults(values)).reshape(-1, len(points))
        names = list(self.closed.inputs)
        for name, value in self.inputs.items():
            u[names.index(name)] = value
        for free, column in zip(self.plane.numbers, points.T, strict=True):
            if free.is_input:
                u[names.index(free.name)] = column
        return values, u

    def learn(self, places: Sequence[complex]) -> None:
        """Find the steady states at all places at once that are not known yet: Newton's method, from the middle of the map to each of them in steps."""
        new = [place for place in dict.fromkeys(places) if place not in self.known]
        if not new:
            return
        points, middle = np.array([self.plane.point(place) for place in new]), np.array(self.plane.point(MIDDLE))
        residual, slopes = residual_functions(self.closed)
        modes = mode_numbers(self.closed, self.middle.modes)
        size, n = len(points), self.middle.states.size
        sticking = (modes == 0.0) & holding_elements(self.closed)
        m = np.repeat(modes[:, None], size, axis=1)
        x = np.repeat(self.middle.states[:, None], size, axis=1)
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
            here = self._numbers(middle + before * (points - middle))
            values, u = self._numbers(middle + (before + TANGENT * (part - before)) * (points - middle))
            x = x + moved(x, values, u, here) / TANGENT
            values, u = self._numbers(middle + part * (points - middle))
            for _ in range(12 if part == 1.0 else 4):
                step = moved(x, values, u, (values, u))
                x = x + step
                if not (np.abs(step).max(axis=0) > 1e-13 * np.abs(x).max(axis=0)).any():  # nan where there is none
                    break
            before = part
        scale = np.abs(x).max(axis=0) + 1e-300
        flow, slips = (np.array(v) for v in residual(0.0, x, u, values, m))
        of_flow = np.array(slopes(0.0, x, u, values, m)[0]).reshape(-1, size, n).transpose(1, 0, 2)
        sliding = np.array([e.law is not None for e in self.closed.elements]) & (modes != 0.0)
        found = (
            np.isfinite(x).all(axis=0)
            & (np.abs(step).max(axis=0) <= 1e-8 * scale)
            & (slips[sliding] * modes[sliding, None] > 0).all(axis=0)
        )
        for k in np.flatnonzero(found).tolist():  # behind a limit a step is zero, too
            found[k] = vanishes(flow[:, k], np.abs(of_flow[k]) @ np.abs(x[:, k]) + 1e-300, of_flow[k], n)
        for k, place in enumerate(new):
            plant = copy.copy(self.closed)
            plant.values = values[:, k].copy()
            point = Equilibrium(plant, x[:, k].copy(), u[:, k].copy(), self.middle.modes)
            self.known[place] = point if found[k] else self._past_limits(point)

    def _past_limits(self, missed: Equilibrium) -> Equilibrium | None:
        """The steady state by the search that passes limits, behind which Newton's method has no slope; None for a plant without limits."""
        if open_limits(missed.plant) is None:
            return None
        try:
            inputs = dict(zip(missed.plant.inputs, missed.inputs.tolist(), strict=True))
            return steady_state(missed.plant, inputs, state_values(self.closed, self.middle.states), missed.modes)
        except NoSteadyState:
            return None


def steady_plane(loop: ClosedLoop, plane: Plane, mode: Mapping[str, str] | None, guess: Mapping[str, Any] | None) -> SteadyPlane | None:
    """The steady states of the continuous form of a loop; None for a sampled loop with a law that has none, or that does not run steadily in it.

    Raises SceneError as `equilibrium` does.
    """
    try:
        continuous = loop.continuous_loop
        for each, value in plane.values(MIDDLE):
            continuous = each.put(continuous, value) if each.kind.has_slope else continuous
        inputs = continuous.constant_inputs("a steady state")
        middle = steady_state(continuous.system, inputs, guess, mode)
    except SceneError:
        if not loop.is_sampled:
            raise
        return None
    contact = judged_contact(continuous)
    if middle.modes[contact] == "stick":
        raise SceneError(f"The contact `{contact}` must slip in the steady state in the middle of the map, but it sticks.")
    return SteadyPlane(continuous.system, inputs, plane, middle, {MIDDLE: middle})


def map_runs(
    loop: ClosedLoop, plane: Plane, steady: SteadyPlane | None, places: Sequence[complex], duration: NumberOrText | None
) -> JudgedRuns[complex]:
    """The judged runs of a loop over a plane, with the scale of time of all places. Raises SceneError where the loop runs smoothly nowhere."""
    duration = None if duration is None else number("duration", duration, "s", above=0)
    loop.constant_inputs("a map")
    check_autonomous(loop, "a map")
    check_one_direction(loop.system.elements, "A map", "judge runs of it, by `sweep`")
    contact = judged_contact(loop)
    for each, value in plane.values(MIDDLE):
        loop = each.put(loop, value)
    base = Request(loop, 0.0, accuracy=accuracy_of(loop)).checked()
    branch = SmoothBranch[complex](base, plane.values, steady)
    if steady is not None:
        steady.learn(places)
    swings = np.array([branch.swing(place) for place in places])
    if not np.isfinite(swings).any():
        raise NoSteadyState(
            f"There is no steady running over `{plane.names[0]}` and `{plane.names[1]}`, of continuous forms of the laws or at their set-points."
        )
    period = float(np.nanmedian(swings))
    return JudgedRuns(
        base=base, branch=branch, element=contact, signal=judged_speed(loop, contact), perturbation=PERTURBATION, period=period,
        budget=BUDGET if duration is None else float(duration) / period,
    )  # fmt: skip
