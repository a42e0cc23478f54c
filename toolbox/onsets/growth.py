"""How fast a small disturbance of smooth running grows, for every law.

- A loop that acts continuously: the poles of its equations at the steady state.
- A sampled loop whose controllers have slopes: the multipliers of its exact matrix over the period of all sample times (`sampled_matrix`),
  in the states, the memory of the controllers, the signals held and the outputs on their way.
- A sampled controller without a slope, as one in Python: the same by differences of short runs of the machine as it runs. They count where two sizes of the
  differences, and both of their sides, agree.
- Where they do not, as under a law that switches or whose slope is infinite, or where a Python law does not tell its memory: two runs from both sides of
  smooth running, and the growth of what is between them.

What does not act back on the machine, such as the angle of a free shaft or the filter of a watchdog, has no part in it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Generic, TypeVar

import numpy as np

from toolbox.arguments import FloatArray, count_of
from toolbox.errors import SceneError, SimulationError
from toolbox.halving import zero
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.numbers import Number
from toolbox.modelling.steady_point import Equilibrium
from toolbox.onsets.exact_growth import exact_run, exact_smooth
from toolbox.onsets.motions import Growth, Smooth, in_phase, least_damped, moved, slip_rows, swing_period, swings
from toolbox.onsets.sampled_map import SampledMap
from toolbox.onsets.twins import twin_growth
from toolbox.simulation.run import Run
from toolbox.simulation.run_state import RunState
from toolbox.steady_states.equilibria import flow_slopes
from toolbox.steady_states.linear_loop import NoDerivative
from toolbox.steady_states.running import at_set_points

Place = TypeVar("Place", float, complex)
"""Where the free numbers of a loop are: the value of one number, or a point of the plane of two (`toolbox.onsets.map_loop`)."""

NEARBY = (0.0, 1e-4, -1e-4, 1e-3, -1e-3)
"""Parts of a value by which it is moved where its growth is not known, on the way to where growth is zero."""

HALVINGS = 8
"""How often the way to a place at which the growth is not known is halved, to come between there and where growth is zero."""

TRIED = 3
"""Places at which the map of a sampled loop must fail to have derivatives, and have them nowhere, before it is left for twin runs at once."""

EXACT_SENSORS = {".sensors.noise": 0.0, ".sensors.resolution": 1e-18}
"""Numbers with which sensors read what there is: steps of an encoder so fine that they round nothing."""


def check_autonomous(loop: ClosedLoop, word: str) -> None:
    """Raise SceneError if time itself enters an equation. word: the clause of the message that says for which purpose the machine must not
    change in time."""
    if loop.depends_on_time:
        raise SceneError(
            f"Argument `loop` must not depend on time itself for {word}, but time enters the equations of its plant or of a law."
        )


class SmoothBranch(Generic[Place]):
    """Smooth running of a closed loop over its free numbers, each place once: its state, and how a small disturbance grows.

    Measurement noise and the steps of encoders are left out. numbers: what the free numbers are at a place;  followed: the steady states of the continuous
    forms of the laws; None where a law has none.
    """

    def __init__(
        self, base: Run, numbers: Callable[[Place], Sequence[tuple[Number, float]]], followed: Callable[[Place], Equilibrium | None] | None
    ):
        known = base.system.parameters
        silent = {
            name: np.full(count_of(known[name].size), value) for end, value in EXACT_SENSORS.items() for name in known if name.endswith(end)
        }
        self.run = dataclasses.replace(base, system=base.system.with_parameters(silent)) if silent else base
        self.numbers: Callable[[Place], Sequence[tuple[Number, float]]] = numbers
        self.followed: Callable[[Place], Equilibrium | None] | None = followed
        self.known: dict[Place, Smooth | None] = {}
        self.exact = exact_run(self.run) if self.run.system.updates else None
        self.slopes: FloatArray | None = None
        self.rough = 0

    def at(self, value: Place) -> Run:
        """The run with the free numbers at a place."""
        return with_numbers(self.run, self.numbers(value))

    def __call__(self, value: Place) -> Smooth | None:
        """Smooth running at a place; None where none is known."""
        if value not in self.known:
            self.known[value] = self._sampled(value) if self.run.system.updates else self._continuous(value)
        return self.known[value]

    def rate(self, value: Place) -> float:
        """Rate at which a small disturbance grows [1/s]; nan without smooth running."""
        found = self(value)
        return math.nan if found is None else found.growth.rate

    def rate_near(self, value: Place) -> float:
        """Return the rate at which a small disturbance grows at a place [1/s]. If the rate is not known there, the rate at a near place is
        returned; nan if no rate is known."""
        return next((rate for part in NEARBY if math.isfinite(rate := self.rate(value * (1.0 + part)))), math.nan)

    def bracket(self, a: Place, b: Place) -> tuple[Place, Place]:
        """Return two places on the line between two places with known growth of different signs. SimulationError is raised if no such pair
        is found."""
        for _ in range(HALVINGS):
            rates = self.rate(a), self.rate(b)
            if rates[0] * rates[1] < 0:
                return a, b
            rate = self.rate(middle := (a + b) / 2)
            if math.isnan(rates[0]) == math.isnan(rates[1]):
                break
            if math.isnan(rates[0]) == (math.isnan(rate) or rate * np.nansum(rates) < 0):
                a = middle
            else:
                b = middle
        raise SimulationError("The growth of smooth running is not known on both sides of its border.")

    def loss(self, one: float, other: float, precision: float | None = None) -> float:
        """Return the value at which the rate of growth is zero, between two values with rates of different signs, by default to 1e-10.
        SimulationError is raised if the rate is not known on the way."""

        def rate(value: float) -> float:
            if math.isnan(found := self.rate_near(value)):
                near = ", ".join(f"`{number.name}` = {each:g} {number.unit}" for number, each in self.numbers(value))
                raise SimulationError(f"The growth of smooth running is not known at {near}.")
            return found

        return zero(rate, one, other, precision or 1e-10 * max(abs(one), abs(other)), 1e-10)

    def width(self, value: float, one: float, other: float, precision: float) -> float:
        """How far on either side of a border its place may be, given how far the growth may be from the true one; at most up to `one` and `other`.

        Within it the growth, as it is known, is so near zero that its sign is not sure.
        """

        def sure(at: float) -> bool:
            found = self(at)
            return found is not None and abs(found.growth.rate) > found.growth.error

        widest = precision
        for end in (one, other):
            way, rate, here = abs(end - value), self.rate(end), self(value)
            error = math.inf if here is None else here.growth.error
            part = max(precision, 2.0 * error * way / abs(rate)) if rate and math.isfinite(rate * error) else way
            while part < way and not sure(value + math.copysign(part, end - value)):
                part *= 2.0
            widest = max(widest, min(part, way))
        return widest

    def _continuous(self, value: Place) -> Smooth | None:
        point = None if self.followed is None else self.followed(value)
        if point is None:
            return None
        exponents, motions = np.linalg.eig(flow_slopes(point))
        rows = slip_rows(point.plant, point.states, point.plant.values)
        stuck = rows[[point.modes.get(each.name) == "stick" for each in point.plant.elements]]
        off = np.abs(stuck @ motions) > 1e-6 * (np.abs(stuck) @ np.abs(motions))
        exponents, motions = (
            exponents[~off.any(axis=0)],
            motions[:, ~off.any(axis=0)],
        )  # what leaves a stick or a sliding surface is no motion of it
        best = least_damped(exponents.astype(complex), motions, rows)
        state = self.run.start.at_values(point.states)
        return Smooth(state, Growth.of(complex(exponents[best]), "poles"), in_phase(motions[:, best], rows))

    def _sampled(self, value: Place) -> Smooth | None:
        found = self._by_matrices(value)
        return self.by_runs(value) if found is None else found

    def _by_matrices(self, value: Place) -> Smooth | None:
        """Smooth running from the exact matrix of the sampled loop; None where a controller has no slope, or none is found."""
        if self.exact is None:
            return None
        run, target = with_numbers(self.exact, self.numbers(value)), self.at(value)
        for begin in self._beginnings(run, value):
            try:
                found = exact_smooth(run, begin, target)
            except NoDerivative:
                return None
            if found is not None:
                return found
        return None

    def by_runs(self, value: Place) -> Smooth | None:
        run, nearest = self.at(value), None
        for begin in self._beginnings(run, value):
            nearest = nearest or begin
            if self.rough == TRIED or not all(clock.regular for clock in run.clocks):  # no map brings such a loop round
                break
            with contextlib.suppress(SimulationError):
                searched = SampledMap(run, begin)
                found = searched.smooth(self.slopes)
                if found is not None:
                    self.slopes = searched.matrix
                    return found
        if nearest is None:
            return None
        if self.slopes is None:
            self.rough = min(self.rough + 1, TRIED)
        growth = twin_growth(run, nearest, self.shaken(run, nearest), self.swing(value)) or Growth(math.nan, math.inf, "runs")
        return Smooth(nearest, growth, np.concatenate([nearest.states, np.zeros(nearest.values.size - nearest.states.size)]))

    def shaken(self, run: Run, state: RunState) -> FloatArray:
        """Return a disturbance of the states along every swing of the plant. Each swing shows at the contacts with the size of their slips;
        the sum shows with ten times this size at most."""
        away = state.states.copy()
        with contextlib.suppress(SceneError):
            point = at_set_points(run.loop)
            for row in slip_rows(point.plant, point.states, point.plant.values):
                for _, motion in swings(point, row):
                    away += moved(state, point.plant, abs(row @ point.states) * motion).states - state.states
        rows = slip_rows(run.system, state.states, run.system.values)
        return away / max(0.1 * float(np.max(np.abs(rows @ away) / (np.abs(rows @ state.states) + 1e-300), initial=0.0)), 1.0)

    def swing(self, value: Place) -> float:
        """Period of the least damped swing [s], of the continuous form of the loop, else of the plant at the set-points; nan where neither runs steadily."""
        point = None if self.followed is None else self.followed(value)
        with contextlib.suppress(SceneError):
            return swing_period(point or at_set_points(self.at(value).loop))
        return math.nan

    def _beginnings(self, run: Run, value: Place) -> Iterator[RunState]:
        """States near smooth running: of the continuous forms, of the plant at the set-points, and of the nearest value that is known."""
        points: list[Callable[[], Equilibrium | None]] = [lambda: None if self.followed is None else self.followed(value)]
        points.append(lambda: at_set_points(run.loop))
        for find in points:
            with contextlib.suppress(SceneError):
                point = find()
                if point is not None:
                    yield begun_at(run, point)
        near = [other for other, smooth in self.known.items() if smooth is not None and smooth.growth.way in ("matrices", "differences")]
        if near:
            yield self.known[min(near, key=lambda other: abs(other - value))].state  # type: ignore[union-attr]


def begun_at(run: Run, point: Equilibrium) -> RunState:
    """Return the initial state of a run at a steady state. States of sampled controllers become their memory, and their commands are
    held."""
    names = [*run.system.states, *(name for update in run.system.updates for name in (*update.places, *update.names))]
    known = {name: point[name] for name in names if point.plant.has_signal(name)}
    return RunState.begun(run.system, run.plant, run.clocks).with_values(known)


def with_numbers(run: Run, numbers: Sequence[tuple[Number, float]]) -> Run:
    """The run with other values of some numbers."""
    for number, value in numbers:
        run = run.at(number, value)
    return run
