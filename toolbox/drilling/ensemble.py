"""Beside the rig: bit speed, torque at the bit, severity and margin from what is measured at the surface, each with its uncertainty, by an ensemble of strings.

Every member is a string with rock of its own: inertias, stiffness and strength of the rock differ as they are known, and each sticks and slips exactly, by the
hybrid prediction of the plant (`toolbox.prediction`). A sample of the top speed draws all members to it by their covariance, states and numbers alike, so that
the ensemble learns the machine while it filters. Source: G. Evensen (1994), doi:10.1029/94JC00572; the square root without drawn measurements: J. S. Whitaker,
T. M. Hamill (2002), doi:10.1175/1520-0493(2002)130<1913:EDAWPO>2.0.CO;2.

Why numbers wander: an ensemble that has learned is narrow, and a narrow one that is wrong learns no more. The spread of each number goes back to what was
known of it within minutes. A spring that gets stiffer keeps its torque, so that a number that wanders is no kick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from toolbox.arguments import FloatArray, count_of, number, whole
from toolbox.errors import SceneError
from toolbox.modelling.closed_loop import ClosedLoop, closed_loop
from toolbox.modelling.components import check_fields
from toolbox.modelling.elements import Quantity, quantity
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.prediction.rollout import Rollout
from toolbox.prediction.rollout_loop import MOTION_KINDS, advance_interval
from toolbox.steady_states.hopf import hopf_points
from toolbox.translation.compiled import Compiled
from toolbox.vocabulary import Renamed

LONGEST = 0.02
"""Longest step of the prediction [s]; a longer time between samples is taken in several."""

OUTLIER = 5.0
"""A top speed beyond this many standard deviations is taken to be so noisy that it lies at this many: from there on, the farther off it is, the less it moves
(at ten standard deviations as much as at two and a half), so that an outlier moves little, and an ensemble that went astray comes back."""

ASTRAY = 4.0
"""Mean square of the errors over some fifty samples, in parts of what is expected, beyond which the ensemble is taken to have gone astray and is widened."""

MOST = 0.6
"""Largest logarithm of a number of a member over the declared one."""

SEEN, ROWS = 1.25, 50
"""Periods of the string over which severity is taken, and instants in them."""

HARDER = np.linspace(0.4, 2.0, 9)
"""Loads on the bit, in parts of the declared one, at which the border is computed."""


@dataclass(frozen=True)
class Knowledge(Renamed):
    """Prior knowledge about machine and measurement, for `estimate` and `EnsembleFilter`. Numbers of the machine are
    log-normal around the nominal numbers.

    The same values are used during stick-slip and during smooth running. Give the real noise of your measurement.

    Examples
    --------
    >>> from toolbox.drilling import Knowledge
    >>> print(f"{100 * Knowledge(rock_strength=0.1).rock_strength:.0f} % uncertainty of the rock strength")
    10 % uncertainty of the rock strength
    """

    speed_noise: Quantity = quantity(0.01, "rad/s", "standard deviation of the measured top speed", above=0)
    torque_noise: Quantity = quantity(20.0, "N m", "standard deviation of the measured torque at each step", at_least=0)
    inertia: Quantity = quantity(0.034, "1", "deviation of the logarithm of the inertias of drive and string", at_least=0)
    stiffness: Quantity = quantity(0.034, "1", "deviation of the logarithm of the stiffness", at_least=0)
    rock_strength: Quantity = quantity(0.045, "1", "deviation of the logarithm of the strength of the rock", at_least=0)
    load_variation: Quantity = quantity(0.004, "1", "deviation of what weight and rock vary in a second, in parts of them", at_least=0)
    parameter_correlation_time: Quantity = quantity(
        200.0, "s", "time in which the spread of the numbers of the string goes back to what was known", above=0
    )
    rock_correlation_time: Quantity = quantity(60.0, "s", "time in which the strength of the rock changes", above=0)

    def check(self) -> None:
        """Raise SceneError if nothing about the rock is uncertain. All members of the ensemble would then be identical,
        and a measurement would not change them.
        """
        if self.rock_strength == 0 and self.load_variation == 0:
            raise SceneError(
                "Argument `rock_strength` must be above 0 where `load_variation` is 0, because members that are alike learn nothing, but it is 0."
            )


@dataclass(frozen=True)
class Estimate(Renamed):
    """Estimates at a sample, the result of `EnsembleFilter.step`: pairs (mean, standard deviation) in SI, and two probabilities.

    Attributes
    ----------
    top_speed, bit_speed
        Speeds [rad/s].
    bit_torque
        Torque on bit [N m], also of a bit at rest.
    rock_strength
        Strength of the rock as a multiple of the declared strength [1].
    severity
        Severity of stick-slip in the last 1.25 periods of the string [1].
    onset_margin
        Mean bit speed over the last 1.25 periods of the string, minus the speed below which smooth running is lost
        [rad/s]. nan if the loop has no controller.
    probability_stuck
        Fraction of the members whose bit sticks at this sample.
    probability_stick_slip
        Fraction of the members whose bit has stuck within the last 1.25 periods of the string.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.drilling import EnsembleFilter
    >>> estimate = EnsembleFilter(compose(wells.JANSEN_2, BitRock(weight="97 kN")), members=16).step(0.1, torque=11e3, speed=10.0)
    >>> print(f"bit speed {estimate.bit_speed[0]:.1f} rad/s, probability of sticking {estimate.probability_stuck:.2f}")
    bit speed 10.0 rad/s, probability of sticking 0.00
    """

    top_speed: tuple[float, float]
    bit_speed: tuple[float, float]
    bit_torque: tuple[float, float]
    rock_strength: tuple[float, float]
    severity: tuple[float, float]
    onset_margin: tuple[float, float]
    probability_stuck: float
    probability_stick_slip: float


def check_string(plant: HybridSystem) -> None:
    """Raise SceneError if a plant has no top drive or no bit."""
    for name in ("top.torque", "top.speed", "bit.speed", "bit.torque"):
        if not plant.has_signal(name) and name not in plant.inputs:
            raise SceneError(f"Argument `loop` must be a drill string with a rock, but it has no `{name}`.")


class EnsembleFilter:
    """Ensemble Kalman filter that estimates the motion of the bit from the surface measurements. Call `step` at every
    sample, in real time or along a log.

    Parameters
    ----------
    loop
        A loop, or a plant: a drill string with a chain of inertias and a rock. For a loop with a controller that
        follows `top.reference`, the speed below which smooth running is lost is computed, too.
    knowledge
        Prior knowledge about machine and measurement. By default `Knowledge()`.
    members
        Number of simulated strings, >= 8.
    seed
        Seed of the random numbers.

    Raises
    ------
    SceneError
        If the plant is no drill string with a chain of inertias and a rock.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.drilling import EnsembleFilter
    >>> ensemble = EnsembleFilter(compose(wells.JANSEN_2, BitRock(weight="97 kN")), members=16)
    >>> for speed in (10.0, 10.1, 10.1):
    ...     estimate = ensemble.step(0.1, torque=11e3, speed=speed)
    >>> print(f"top speed {estimate.top_speed[0]:.1f} rad/s")
    top speed 10.1 rad/s
    """

    def __init__(self, loop: ClosedLoop | HybridSystem, knowledge: Knowledge | None = None, *, members: int = 64, seed: int = 0):
        self.knowledge = Knowledge() if knowledge is None else knowledge
        check_fields(self.knowledge)
        self.members, self.seed = whole("members", members, 8), whole("seed", seed, 0)
        given = loop if isinstance(loop, ClosedLoop) else closed_loop(loop)
        plant = given.plant
        self._places(plant)
        drives = ("top.torque", *(["bit.weight"] if "bit.weight" in plant.inputs else []))
        self.rollout = Rollout(plant, drives, LONGEST, 1)
        self.plant, self.weight = plant, float(plant.parameter("bit.weight"))
        stiffness = 1.0 / float(np.sum(1.0 / np.atleast_1d(plant.parameter("chain.stiffness"))))
        below = float(np.sum(np.atleast_1d(plant.parameter("chain.inertia"))[1:]))
        self.stiffness, self.period = stiffness, 2.0 * math.pi * math.sqrt(below / stiffness)
        self.border, self.no_border = _border(given)
        self.pace: Pace | None = None
        self.reset()

    def _places(self, plant: HybridSystem) -> None:
        """Rows of the states and places of the numbers that differ between members."""
        check_string(plant)
        try:
            inertia, stiffness, twist = (plant._parameter(f"chain.{name}") for name in ("inertia", "stiffness", "stiffness"))
            plant.parameter("bit.weight")
        except SceneError as error:
            raise SceneError(f"Argument `loop` must be a drill string with a chain of inertias and a rock: {error}") from None
        first, count = inertia.offset, count_of(inertia.size)
        springs = count_of(twist.size)
        self.numbers = np.array([*range(first, first + count), *range(stiffness.offset, stiffness.offset + springs)])
        self.kinds = np.repeat([0, 1, 2], [1, count - 1, springs])  # which of the logarithms of a member each of these numbers follows

        def row(name: str) -> int:
            slope = np.array(ca.DM(ca.jacobian(plant.expression(name), plant.x))).ravel()
            return int(np.argmax(np.abs(slope)))

        self.top, self.bit = row("top.speed"), row("bit.speed")
        begin, end = plant.state_index("chain.twist")[0], plant.state_index("chain.twist")[1]  # type: ignore[index]
        self.twists = slice(begin, begin + count_of(end))
        self.contact = next(i for i, element in enumerate(plant.elements) if element.name == "bit")
        slopes = [ca.jacobian(plant.flow[self.bit], each) for each in (plant.x, plant.F[self.contact])]
        at = ca.Function("slopes", [plant.x, plant.u, plant.p, plant.m, plant.t, plant.F], [ca.densify(each) for each in slopes])
        zeros = [np.zeros(each.numel()) for each in (plant.x, plant.u)]
        along, across = at(*zeros, plant.values, np.zeros(plant.m.numel()), 0.0, np.zeros(plant.F.numel()))
        self.holding = np.array(along).ravel() / float(across)  # torque that holds a bit in stick is this row times the states

    def reset(self) -> None:
        """Forget all measurements."""
        n, known = self.members, self.knowledge
        self.count = 0
        self.rng = self._stream()
        self.deviations = np.array([known.inertia, known.inertia, known.stiffness, known.rock_strength])
        self.logs = self.deviations * self.rng.standard_normal((n, 4))
        self.load, self.surprise, self.time = np.zeros(n), 1.0, 0.0
        self.states: FloatArray | None = None
        self.now = self.weight
        self.table = np.tile(self.rollout.numbers, (n, 1))
        self.ring, self.filled, self.since = np.zeros((ROWS, n)), 0, 0.0

    def _stream(self) -> np.random.Generator:
        """The random numbers of a sample, which its place and the seed decide, so that a filter goes on from its memory with the same ones."""
        return np.random.Generator(np.random.Philox(key=self.seed, counter=[0, 0, 0, self.count]))

    def get_memory(self) -> FloatArray:
        """Return the memory that determines the next estimates, as one array of floats."""
        states = np.zeros((self.members, self.rollout.n)) if self.states is None else self.states
        single = (self.count, self.time, self.surprise, self.since, self.filled, self.now, self.states is not None)
        return np.concatenate([single, *(each.ravel() for each in (states, self.logs, self.load, self.ring))])

    def set_memory(self, values: FloatArray) -> None:
        """Restore a memory that `get_memory` returned.

        Parameters
        ----------
        values
            The array that `get_memory` returned.
        """
        n = self.members
        count, self.time, self.surprise, self.since, filled, self.now, begun = values[:7].tolist()
        self.count, self.filled = int(count), int(filled)
        ends = np.cumsum([n * self.rollout.n, 4 * n, n])
        states, logs, load, ring = (each.copy() for each in np.split(values[7:], ends))
        self.states = states.reshape(n, -1) if begun else None
        self.logs, self.load, self.ring = logs.reshape(n, 4), load, ring.reshape(ROWS, n)

    def step(self, duration: float, torque: float, speed: float, weight: float | None = None) -> Estimate:
        """Predict the ensemble to the next sample, and correct it by the measurements of this sample.

        Parameters
        ----------
        duration
            Time since the last sample [s]. It has no effect at the first sample.
        torque
            Torque of the drive over this time [N m]: the mean of the measurements at both ends, or the command that was
            held. nan if it is not known: the prediction then uses the torque that the string carries.
        speed
            Measured top speed [rad/s]. nan if it was not measured.
        weight
            Measured weight on bit [N]. If it is None (default) or nan, the last known value is used. Before the first
            known value, the weight of the plant is used.

        Returns
        -------
        Estimate
            The present estimates.
        """
        if weight is not None and math.isfinite(weight):
            self.now = max(weight, 0.0)
        self.count += 1
        self.rng = self._stream()
        if self.states is None:
            turning = speed if math.isfinite(speed) else 0.0
            carried = 0.0 if abs(turning) < 1e-9 else float(self.sliding(np.abs([turning]))[0])
            self._begin(torque if math.isfinite(torque) else carried, turning)
        elif number("duration", duration, "s", at_least=0) > 0:
            pieces = max(1, math.ceil(duration / LONGEST - 1e-9))
            for _ in range(pieces):
                self._predict(duration / pieces, torque)
        if math.isfinite(speed):
            self._correct(speed)
        return self._told()

    def forgotten(self) -> Estimate:
        """Forget the oscillation of the bit after a long gap without measurements, and return the remaining estimate."""
        self.filled, self.since = 0, 0.0
        return self._told()

    def _begin(self, torque: float, speed: float) -> None:
        n = self.members
        self.states = np.zeros((n, self.rollout.n))
        rows = [name for name, (_, size, unit) in self.plant.states.items() for _ in range(count_of(size)) if name == "chain.speed"]
        first = self.plant.state_index("chain.speed")[0]  # type: ignore[index]
        self.states[:, first : first + len(rows)] = speed
        self.states[:, self.bit] += 0.5 * self.rng.standard_normal(n) * (speed > 0.0)
        stiffness = self.rollout.numbers[self.numbers[self.kinds == 2]]
        carried = min(0.7 * torque, float(self.sliding(np.zeros(1))[0]))  # the drive takes its part, and the rock gives way
        self.states[:, self.twists] = carried / stiffness * (1.0 + 0.15 * self.rng.standard_normal((n, 1)))

    def _predict(self, duration: float, torque: float) -> None:
        known, n, draw = self.knowledge, self.members, self.rng.standard_normal
        assert self.states is not None  # begun at the first sample
        pace = self._pace(duration)
        factors = np.exp(self.logs)
        self.table[:, self.numbers] = self.rollout.numbers[self.numbers] * factors[:, self.kinds]
        kept = pace.load_kept
        self.load = kept * self.load + known.load_variation * math.sqrt(1.0 - kept * kept) * draw(n)
        self.table[:, self.plant.values.size + self.contact] = factors[:, 3] * (1.0 + self.load)
        if math.isfinite(torque):
            push = torque + known.torque_noise * draw(n)
        else:  # a torque that nobody knows is about what the string carries
            push = self.states[:, self.twists.start] * self.table[:, self.numbers[self.kinds == 2][0]] * (1.0 + 0.2 * draw(n))
        if len(self.rollout.actuated_signals) == 1:
            self.table[:, self.plant.values.size + self.contact] *= self.now / self.weight
        driven = np.full((n, len(self.rollout.actuated_signals)), self.now)
        driven[:, 0] = push
        if self.rollout.slip is None:
            modes = np.stack([self.rollout.modes(each) for each in self.states])
        else:
            rows, offset = self.rollout.slip
            modes = np.sign(self.states @ rows.T + offset)
        advance_all(pace.motion, Members(self.table, driven, self.states, modes))
        self.time += duration
        before = self.logs[:, 2].copy()
        self.logs = pace.kept * self.logs + pace.drawn * draw((n, 4))
        self.states[:, self.twists] *= np.exp(before - self.logs[:, 2])[:, None]
        self.since += duration
        if self.since >= SEEN * self.period / ROWS:
            self.ring[self.filled % ROWS] = self.states[:, self.bit]
            self.filled, self.since = self.filled + 1, 0.0

    def _pace(self, duration: float) -> Pace:
        """What a step of this duration does alike each time."""
        if self.pace is None or self.pace.duration != duration:
            known = self.knowledge
            ways = np.array([known.parameter_correlation_time] * 3 + [known.rock_correlation_time])
            kept = np.exp(-duration / ways)
            motion = self.rollout.motion(np.zeros(self.rollout.n), np.zeros((1, len(self.rollout.actuated_signals))), duration)
            self.pace = Pace(duration, motion, math.exp(-duration), kept, self.deviations * np.sqrt(1.0 - kept**2))
        return self.pace

    def _correct(self, speed: float) -> None:
        assert self.states is not None
        all_of = np.concatenate([self.states, self.logs, self.load[:, None]], axis=1)
        mean = all_of.mean(axis=0)
        apart = all_of - mean
        seen = apart[:, self.top]
        spread, noise, error = float(seen @ seen) / (self.members - 1), self.knowledge.speed_noise**2, speed - mean[self.top]
        square = error**2 / (spread + noise)
        self.surprise += 0.02 * (min(square, OUTLIER**2) - self.surprise)
        if square > OUTLIER**2:
            noise = (error / OUTLIER) ** 2 - spread
        gain = seen @ apart / ((self.members - 1) * (spread + noise))
        moved = all_of + error * gain - np.outer(seen, gain / (1.0 + math.sqrt(noise / (spread + noise))))
        n = self.rollout.n
        self.states, self.logs, self.load = np.ascontiguousarray(moved[:, :n]), np.clip(moved[:, n : n + 4], -MOST, MOST), moved[:, n + 4]
        if self.surprise > ASTRAY:
            self.logs += 0.5 * self.deviations * self.rng.standard_normal(self.logs.shape)
            self.states[:, self.bit] *= 1.0 + 0.1 * self.rng.standard_normal(self.members)
            self.surprise = 1.0
        np.maximum(self.states[:, self.bit], 0.0, out=self.states[:, self.bit])

    def _told(self) -> Estimate:
        assert self.states is not None
        bit = self.states[:, self.bit]
        strength = np.exp(self.logs[:, 3]) * (1.0 + self.load)
        held = self.holding * self.states
        carried = held.sum(axis=1) + held[:, self.twists].sum(axis=1) * (np.exp(self.logs[:, 2]) - 1.0)
        sliding = strength * self.now / self.weight * self.sliding(np.abs(bit))
        stuck = bit == 0.0
        severity = margin = (math.nan, math.nan)
        sticking = math.nan
        if self.filled >= ROWS:
            high, low, mean = self.ring.max(axis=0), self.ring.min(axis=0), self.ring.mean(axis=0)
            severity = _pair((high - low) / (2.0 * np.maximum(mean, 1e-6)))
            sticking = float((low <= 0.0).mean())
            if self.border is not None:
                margin = _pair(mean - np.interp(strength * self.now / self.weight, HARDER, self.border))
        return Estimate(
            _pair(self.states[:, self.top]),
            _pair(bit),
            _pair(np.where(stuck, carried, sliding)),
            _pair(strength),
            severity,
            margin,
            float(stuck.mean()),
            sticking,
        )

    def sliding(self, speed: FloatArray) -> FloatArray:
        """Return the torque of the declared rock [N m] at speeds >= 0 [rad/s].

        Parameters
        ----------
        speed
            Speeds of the bit [rad/s], >= 0.
        """
        if not hasattr(self, "_curve"):
            element, plant = self.plant.elements[self.contact], self.plant
            row = np.zeros(self.rollout.n)
            row[self.bit] = 1.0
            function = ca.Function("rock", [plant.x, plant.u, plant.p, plant.m, plant.t], [element.kinetic])
            grid = np.append(0.0, np.geomspace(1e-3, 100.0, 400))
            states = row[:, None] * np.maximum(grid, 1e-9)[None, :]
            inputs, modes = plant.input_defaults(plant.values), np.ones(len(plant.elements))
            self._curve = grid, np.array(function(states, inputs, plant.values, modes, 0.0)).ravel()
        found: FloatArray = np.interp(speed, *self._curve)
        return found


def _pair(values: Any) -> tuple[float, float]:
    return float(values.mean()), float(values.std())


def _border(loop: ClosedLoop) -> tuple[FloatArray | None, str]:
    """(highest set-point at which smooth running is lost, at each of the loads `HARDER`; "") or, where it is not known, (None, why)."""
    if "top.reference" not in loop.variable_numbers():
        return None, "the loop has no set-point `top.reference`"
    if loop.is_sampled:
        return None, "the law is sampled, and the border is that of a law in its continuous form"
    borders = []
    for part in HARDER.tolist():
        try:
            weight = loop.number("bit.weight").value
            found = hopf_points(loop.at("bit.weight", part * weight), "top.reference", (0.2, 40.0), num_values=25)
        except SceneError as error:
            return None, str(error).rstrip(".")
        borders.append(max((point.value for point in found), default=0.0))
    return np.array(borders), ""


class Pace(NamedTuple):
    """Arrays of a step of one duration, which most steps of a log share."""

    duration: float
    motion: Any
    load_kept: float
    kept: FloatArray
    drawn: FloatArray


class Members(NamedTuple):
    """A row for each member: its numbers, its inputs, its states and its modes. The states are moved in place."""

    table: np.ndarray
    driven: np.ndarray
    states: np.ndarray
    modes: np.ndarray


def _advance_all(w, given):
    """Move each member over one interval, with numbers, inputs and modes of its own."""
    for i in range(given.states.shape[0]):
        for j in range(w.columns.size):
            w.U[0, j] = given.driven[i, j]
        for j in range(w.x.size):
            w.X[0, j] = given.states[i, j]
        for j in range(w.M.shape[1]):
            w.M[0, j] = given.modes[i, j]
        advance_interval(w, given.table[i], 0)
        for j in range(w.x.size):
            given.states[i, j] = w.X[1, j]


advance_all = Compiled(_advance_all, MOTION_KINDS, dict.fromkeys(Members._fields, ("float64", 2)))
"""One step of an ensemble, as machine code."""
