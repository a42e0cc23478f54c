"""How fast a small disturbance of smooth running grows, for every law.

- A loop that acts continuously: the poles of its equations at the steady state.
- A sampled loop: the multipliers of its map over a few sample times, in the states, the memory of the laws, the signals held and the outputs on their way.
  Its derivatives are differences of short runs of the machine as it runs; they count where two sizes of the differences, and both of their sides, agree.
- Where they do not, as under a law that switches or whose slope is infinite, or where a Python law does not tell its memory: two runs from both sides of
  smooth running, and the growth of what is between them.

What does not act back on the machine, such as the angle of a free shaft or the filter of a watchdog, has no part in it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Generic, TypeVar

import casadi as ca
import numpy as np

from toolbox.arguments import FloatArray
from toolbox.errors import SceneError, SimulationError
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.numbers import Number
from toolbox.modelling.steady_point import Equilibrium, function_of
from toolbox.robustness.steady_loop import at_set_points
from toolbox.simulation.run import Run
from toolbox.simulation.run_state import RunState
from toolbox.steady_states.equilibria import flow_slopes

Place = TypeVar("Place", float, complex)
"""Where the free numbers of a loop are: the value of one number, or a point of the plane of two (`toolbox.onsets.map_loop`)."""

ROUNDS = 5
"""Common periods of all sample times over which the map goes."""

KICK = 1e-3
"""Part of the states by which smooth running is disturbed to see how far each entry of a point moves then."""

STEP = 0.02
"""Differences, in parts of what each entry moves by then; half of it once more."""

CORRECTIONS = 24
"""Steps of the search for smooth running, at most."""

AGREES = 1e-3
"""What the growth of two differences may be apart, in parts of its frequency, to count."""

NEARBY = (0.0, 1e-4, -1e-4, 1e-3, -1e-3)
"""Parts of a value by which it is moved where its growth is not known, on the way to where growth is zero."""

HALVINGS = 8
"""How often the way to a place at which the growth is not known is halved, to come between there and where growth is zero."""

NEUTRAL = 1e-9
"""Change of a motion over the map below which differences are too small for what brings it back, as the switching of a law."""

ALIKE = 0.1
"""What the damping of two swings may differ by, in its parts, to be alike."""

VISIBLE = 1e-8
"""Part of a motion that must show in the slips of the contacts for it to act back on the machine."""

EXACT = 1e-12
"""Accuracy of the runs of a map."""

EXACT_SENSORS = {".sensors.noise": 0.0, ".sensors.resolution": 1e-18}
"""Numbers with which sensors read what there is: steps of an encoder so fine that they round nothing."""

KICKS = ((1e-4, 1e-3), (1e-5, 1e-4), (1e-6, 1e-5))
"""Parts of the slip by which two pairs of twin runs begin apart, which must agree; the first lie above the chatter of most laws."""

TWIN_SWINGS, LONGEST_TWIN, SAMPLES = 2, 40, 32
"""Swings of a piece of twin runs, the most pieces, and the instants in a swing at which they are compared."""


@dataclass(frozen=True)
class Growth:
    """How a small disturbance of smooth running goes on: as exp(rate t), in swings of a period.

    Attributes
    ----------
    rate
        Rate of the least damped motion [1/s], > 0 where it grows.
    period
        Period of its swing [s]; inf where it does not swing.
    way
        How it is known: "poles", "differences" or "twin runs"; "runs" where none of them tells and the rate is nan, so that only runs can.
    """

    rate: float
    period: float
    way: str

    @staticmethod
    def of(exponent: complex, way: str) -> Growth:
        """The growth of a motion that goes as exp(exponent t)."""
        return Growth(float(exponent.real), 2 * math.pi / abs(exponent.imag) if exponent.imag else math.inf, way)

    @property
    def time(self) -> float:
        """Time in which a disturbance becomes e times as large, or as small [s]."""
        return 1.0 / abs(self.rate) if self.rate else math.inf

    def __str__(self) -> str:
        return f"{'grows' if self.rate > 0 else 'dies'} with {self.time:.3g} s, by {self.way}"


@dataclass(frozen=True)
class Smooth:
    """Smooth running at one value: its state, how a disturbance grows, and the direction in which it does, in the entries of `RunState.values`.

    The direction is at the phase at which a contact moves most.
    """

    state: RunState
    growth: Growth
    direction: FloatArray


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
            name: np.full(known[name].size or 1, value) for end, value in EXACT_SENSORS.items() for name in known if name.endswith(end)
        }
        self.run = dataclasses.replace(base, system=base.system.with_parameters(silent)) if silent else base
        self.numbers: Callable[[Place], Sequence[tuple[Number, float]]] = numbers
        self.followed: Callable[[Place], Equilibrium | None] | None = followed
        self.known: dict[Place, Smooth | None] = {}
        self.slopes: FloatArray | None = None

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
        """Rate at which a small disturbance grows at a place, else next to it where it is known there [1/s]; nan where it is not."""
        return next((rate for part in NEARBY if math.isfinite(rate := self.rate(value * (1.0 + part)))), math.nan)

    def bracket(self, a: Place, b: Place) -> tuple[Place, Place]:
        """Places on the straight way between two at which the growth is known and has different signs; raises SimulationError where there are none nearby."""
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
        """Where the rate is zero, between values at which its signs differ, by default to 1e-10; raises SimulationError where none is known on the way."""
        from scipy.optimize import brentq

        def rate(value: float) -> float:
            if math.isnan(found := self.rate_near(value)):
                near = ", ".join(f"`{number.name}` = {each:g} {number.unit}" for number, each in self.numbers(value))
                raise SimulationError(f"The growth of smooth running is not known at {near}.")
            return found

        return float(brentq(rate, one, other, xtol=precision or 1e-10 * max(abs(one), abs(other)), rtol=1e-10))

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
        run, nearest = self.at(value), None
        for begin in self._beginnings(run, value):
            nearest = nearest or begin
            with contextlib.suppress(SimulationError):
                searched = SampledMap(run, begin)
                found = searched.smooth(self.slopes)
                if found is not None:
                    self.slopes = searched.matrix
                    return found
        if nearest is None:
            return None
        growth = twin_growth(run, nearest, self.swing(value)) or Growth(math.nan, math.inf, "runs")
        return Smooth(nearest, growth, np.concatenate([nearest.states, np.zeros(nearest.values.size - nearest.states.size)]))

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
        near = [other for other, smooth in self.known.items() if smooth is not None and smooth.growth.way == "differences"]
        if near:
            yield self.known[min(near, key=lambda other: abs(other - value))].state  # type: ignore[union-attr]


def begun_at(run: Run, point: Equilibrium) -> RunState:
    """The beginning of a run at a steady state: states of sampled laws become their memory, and what they drive is held."""
    names = [*run.system.states, *(name for update in run.system.updates for name in (*update.places, *update.names))]
    known = {name: point[name] for name in names if point.plant.has_signal(name)}
    return RunState.begun(run.system, run.plant, run.clocks).with_values(known)


def swing_period(rest: Equilibrium) -> float:
    """Period of the least damped swing of a steady state [s], or the time constant of its slowest motion where nothing swings.

    Of several that are damped alike, as all are where drag is spread along a string, it is the slowest.
    """
    poles = np.linalg.eigvals(flow_slopes(rest))
    poles = poles[np.abs(poles) > 1e-9 * np.abs(poles).max(initial=0.0)]
    swinging = poles[poles.imag > 1e-6 * np.abs(poles)]
    if swinging.size:
        least = float(swinging.real.max())
        return float(2 * math.pi / swinging.imag[swinging.real >= least - ALIKE * abs(least)].min())
    return float(2 * math.pi / np.abs(poles).min(initial=1.0)) if poles.size else 1.0


def with_numbers(run: Run, numbers: Sequence[tuple[Number, float]]) -> Run:
    """The run with other values of some numbers."""
    for number, value in numbers:
        run = run.at(number, value)
    return run


def slip_rows(system: HybridSystem, states: FloatArray, values: FloatArray) -> FloatArray:
    """Derivatives of the slips of all contacts by the states, shape (elements, states)."""
    function = function_of(system, ("slip_rows",), lambda: [ca.jacobian(system.switching.slip, system.x)])
    return np.array(function(0.0, states, np.zeros(len(system.inputs)), values, np.ones(len(system.elements))))


def least_damped(exponents: np.ndarray, motions: np.ndarray, rows: np.ndarray) -> int:
    """Which motion (columns) grows fastest, of those that show in the slips of the contacts; of a pair the one with the positive frequency."""
    seen = np.abs(rows @ motions).max(axis=0, initial=0.0) > VISIBLE * np.abs(motions).max(axis=0)
    chosen = np.flatnonzero(seen) if seen.any() else np.arange(exponents.size)
    return int(max(chosen, key=lambda k: (round(float(exponents[k].real), 12), float(exponents[k].imag))))


def in_phase(motion: np.ndarray, rows: FloatArray) -> FloatArray:
    """The real direction of a motion at the phase at which the contact (rows) that it moves most is moved most."""
    moved = rows @ motion
    most = moved[np.argmax(np.abs(moved))] if moved.size else 0.0
    return np.real(motion / most * abs(most)) if most else np.real(motion)


def section(clocks: list[tuple[float, float]]) -> tuple[float, float]:
    """(phase, common period) of all sample times: a phase in the middle of the longest time without a sample or a late output."""
    periods = [Fraction(period).limit_denominator(10**9) for period, _ in clocks]
    common = periods[0]
    for each in periods[1:]:
        a, b = common.numerator * each.denominator, each.numerator * common.denominator
        common = Fraction(math.lcm(a, b), common.denominator * each.denominator)
    whole = float(common)
    marks = {0.0}
    for (period, delay), exact in zip(clocks, periods, strict=True):
        for k in range(int(common / exact)):
            marks |= {k * period / whole % 1.0, (k * period + delay) / whole % 1.0}
    edges = np.array([*sorted(marks), 1.0 + min(marks)])
    widest = int(np.argmax(np.diff(edges)))
    return whole * (0.5 * (edges[widest] + edges[widest + 1]) % 1.0), whole


class SampledMap:
    """The map of a sampled loop over a few sample times, between instants at which no sample is taken and none arrives.

    Its points hold the entries of the states, of the memory and of the signals held, then the outputs on their way, then what Python laws tell.
    """

    def __init__(self, run: Run, begin: RunState):
        phase, common = section(run.clocks)
        self.run, self.span = run, ROUNDS * common
        late = max(delay for _, delay in run.clocks)
        until = phase + common * math.ceil((late + 2 * common) / common)
        self.state = self._again(begin, until - begin.time).last
        self.places = np.concatenate([np.arange(first, first + (size or 1)) for _, first, size in self.state.layout]).astype(int)
        self.told = all(law is None or isinstance(law, np.ndarray) for law in self.state.laws)
        n = self.state.states.size
        rows = slip_rows(run.system, self.state.states, run.system.values)
        self.rows = np.hstack([rows, np.zeros((len(rows), self.point(self.state).size - n))])

    def _again(self, state: RunState, duration: float) -> Any:
        return self.run.again(start=state, duration=duration, accuracy=EXACT, output_times=None, longest_step=max(duration, self.span) / 16)

    def point(self, state: RunState) -> FloatArray:
        """A state as a point."""
        laws = [law for law in state.laws if isinstance(law, np.ndarray)]
        return np.concatenate([state.values[self.places], *[rows.ravel() for rows in state.waiting], *laws])

    def state_at(self, point: FloatArray) -> RunState:
        """The state of a point."""
        values, place = self.state.values, self.places.size
        values[self.places] = point[:place]
        waiting, laws = [], []
        for rows in self.state.waiting:
            waiting.append(point[place : place + rows.size].reshape(rows.shape))
            place += rows.size
        for law in self.state.laws:
            laws.append(None if law is None else point[place : place + law.size])
            place += 0 if law is None else law.size
        return dataclasses.replace(self.state.at_values(values), waiting=tuple(waiting), laws=tuple(laws))

    def __call__(self, point: FloatArray) -> FloatArray:
        return self.point(self._again(self.state_at(point), self.span).last)

    def sizes(self, point: FloatArray) -> FloatArray:
        """How far each entry of a point moves where the states are disturbed by KICK; for what does not move, KICK of its value or of 1."""
        n = self.state.states.size
        moved, still = point.copy(), point
        moved[:n] *= 1.0 + KICK
        size = np.abs(moved - still)
        for _ in range(6):
            moved, still = self(moved), self(still)
            size = np.maximum(size, np.abs(moved - still))
        own = KICK * np.where(np.abs(point) > 1e-9, np.abs(point), 1.0)
        return np.where(size > 1e-9 * own, size, own)

    def slopes(self, point: FloatArray, end: FloatArray, steps: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the map at a point, which goes to `end`, by differences upwards and downwards."""
        up, down = (np.empty((point.size, point.size)) for _ in range(2))
        for i, step in enumerate(steps):
            for sign, matrix in ((1.0, up), (-1.0, down)):
                moved = point.copy()
                moved[i] += sign * step
                matrix[:, i] = sign * (self(moved) - end) / step
        return up, down

    def smooth(self, known: FloatArray | None = None) -> Smooth | None:
        """Smooth running next to the state, by Newton's method on the map, and its growth; None where differences do not agree or nothing is found.

        known: derivatives nearby, with which the search begins; they are taken anew where it does not come on, and at its end.
        """
        point, last, here = self.point(self.state), math.inf, False
        if not self.told or not np.isfinite(point).all():
            return None
        size, matrix = self.sizes(point), known
        for _ in range(CORRECTIONS):
            end = self(point)
            if matrix is None or matrix.shape != (point.size, point.size):
                up, down = self.slopes(point, end, STEP * size)
                matrix, here, last = (up + down) / 2, True, math.inf
            if not np.isfinite(matrix).all():
                return None
            scaled = matrix * size / size[:, None]
            step = np.linalg.lstsq(scaled - np.eye(size.size), (point - end) / size, rcond=1e-9)[0]
            largest = float(np.abs(step).max(initial=0.0))
            if largest <= (1e-7 if here else 1e-9):  # of a disturbance that is small itself
                break
            if largest > 0.3 * last:
                matrix = None
                continue
            point, last, here = point + size * step, largest, False
        else:
            return None
        if not here:
            up, down = self.slopes(point, end, STEP * size)
        self.matrix = (up + down) / 2
        if not np.isfinite(self.matrix).all():
            return None
        others = [self._grown(each * size / size[:, None]) for each in (self.matrix, up, down)]
        exponent, motion, row = others[0]
        finer = self._along(point, end, motion * size, row / size)
        apart = [*(each[0] for each in others), *np.log(finer) / self.span]
        if abs(exponent) * self.span < NEUTRAL:
            return None
        if any(abs(each - exponent) > AGREES * max(abs(exponent), 1e-2 / self.span) for each in apart):
            return None
        values = np.zeros(self.state.values.size)
        values[self.places] = in_phase(motion * size, self.rows)[: self.places.size]
        return Smooth(self.state_at(point), Growth.of(exponent, "differences"), values)

    def _along(self, point: FloatArray, end: FloatArray, motion: np.ndarray, row: np.ndarray) -> np.ndarray:
        """The multiplier of a motion, by differences of half the step along it, upwards and downwards; row: its left eigenvector."""
        found = np.zeros(2, complex)
        for part, unit in ((motion.real, 1.0), (motion.imag, 1j)):
            for i, step in enumerate((STEP / 2, -STEP / 2) if part.any() else ()):
                found[i] += unit * (row @ (self(point + step * part) - end)) / step
        return found

    def _grown(self, scaled: FloatArray) -> tuple[complex, np.ndarray, np.ndarray]:
        """The exponent of the least damped motion of a matrix of the map, the motion, and the left eigenvector by which it is read from a point."""
        multipliers, motions = np.linalg.eig(scaled)
        exponents = np.log(np.where(multipliers == 0.0, 1e-300, multipliers).astype(complex)) / self.span
        best = least_damped(exponents, motions, self.rows)
        motion = motions[:, best] / np.abs(motions[:, best]).max()
        lefts, rows = np.linalg.eig(scaled.T)
        row = rows[:, int(np.argmin(np.abs(lefts - multipliers[best])))]
        return complex(exponents[best]), motion, row / (row @ motion)


def twin_growth(run: Run, state: RunState, swing: float) -> Growth | None:
    """The growth of what is between two runs that begin on both sides of smooth running; None where two sizes of it never agree.

    It counts once it stays the same from piece to piece and what is between the runs is in proportion to how far apart they began: it is neither the chatter of
    a law nor so large that it grows otherwise.

    swing: about the period of the slowest swing of the machine [s].
    """
    rows = slip_rows(run.system, state.states, run.system.values)
    rows = rows / (np.abs(rows) @ np.abs(state.states) + 1e-300)[:, None]
    for kicks in KICKS:
        twins = [
            Twins(run, [dataclasses.replace(state, states=state.states * (1.0 + sign * kick)) for sign in (1.0, -1.0)], rows)
            for kick in kicks
        ]
        found: list[complex] = []
        try:
            for _ in range(LONGEST_TWIN):
                exponents, sizes = zip(*[each.on(swing) for each in twins], strict=True)
                near = max(AGREES * 2 * math.pi / swing, 0.05 * abs(exponents[0].real))
                linear = abs(sizes[1] * kicks[0] / (sizes[0] * kicks[1]) - 1.0) < 0.1
                if not linear or sizes[1] > 0.1 or abs(exponents[0].real - exponents[1].real) > near:
                    break
                found.append(exponents[0])
                if len(found) > 2 and np.ptp([each.real for each in found[-3:]]) < max(
                    0.05 * AGREES * 2 * math.pi / swing, 1e-3 * abs(found[-1].real)
                ):
                    break
        except SimulationError:
            return None
        if len(found) > 1 and abs(found[-1].real - found[-2].real) < max(AGREES * 2 * math.pi / swing, 0.1 * abs(found[-1].real)):
            return Growth.of(found[-1], "twin runs")
    return None


@dataclass
class Twins:
    """Two runs that began near one another; rows: slips of the contacts, in parts of their size, from the states."""

    run: Run
    ends: list[RunState]
    rows: FloatArray

    def on(self, swing: float) -> tuple[complex, float]:
        """Carry both on by a few swings: (exponent of what is between them, its largest size)."""
        duration = TWIN_SWINGS * swing
        both = [
            self.run.again(start=end, duration=duration, accuracy=EXACT, output_times=None, longest_step=swing / 16) for end in self.ends
        ]
        self.ends = [each.last for each in both]
        times = np.linspace(both[0].begin, both[0].end, SAMPLES * TWIN_SWINGS + 1)
        apart = (both[0].at(times).states - both[1].at(times).states) @ self.rows.T
        return _exponent(apart, swing / SAMPLES), float(np.abs(apart).max())


def _exponent(rows: FloatArray, step: float) -> complex:
    """The exponent of the two slowest motions in samples of signals (rows), by the linear map of rank two from each to a later one that fits best."""
    late = SAMPLES // 4
    columns = np.hstack([rows[k : len(rows) - 2 * late + k] for k in (0, late, 2 * late)])
    now, following = columns[:-late].T, columns[late:].T
    u, s, v = np.linalg.svd(now, full_matrices=False)
    kept = max(1, min(2, int((s > 1e-10 * s[0]).sum())))
    multipliers = np.linalg.eigvals(u[:, :kept].T @ following @ v[:kept].T / s[:kept])
    return complex(np.log(max(multipliers.astype(complex), key=lambda each: (abs(each), each.imag))) / (late * step))
