"""Poles and Hopf points of sampled loops, from the exact matrix of the loop over the period of its samples.

z = exp(s T),   |z| = 1 at the border of stability;   a pair of poles z = exp(+-i w T) with 0 < w T < pi is a Hopf point
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray
from toolbox.errors import NoSteadyState, SceneError
from toolbox.halving import zero
from toolbox.modelling.clocks import check_regular
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.numbers import Number
from toolbox.modelling.steady_point import Equilibrium
from toolbox.simulation.run_state import RunState
from toolbox.steady_states.linear import input_values
from toolbox.steady_states.linear_loop import NoDerivative, checked_smooth
from toolbox.steady_states.sampled_matrix import matrix_over_period
from toolbox.steady_states.steady_loop import STANDS, SampledPoint, smooth_points, without_sensor_errors

REAL = 1e-9
"""Imaginary part of a pole, as a fraction of its size, below which it is real."""


def check_slopes(loop: ClosedLoop) -> None:
    """Raise SceneError if a controller is a Python callable, which has no slope, or if samples are late or missed."""
    check_regular(loop.assembly.clocks, "for a loop to have poles")
    if loop.assembly.callables:
        raise SceneError(
            "Argument `loop` must hold controllers with slopes, but a Python callable has neither a slope nor a continuous form: `onset` judges its runs."
        )


def refuse_modes(mode: Mapping[str, str] | None, verb: str) -> None:
    """Raise SceneError for modes of contacts, which steady running of a sampled loop does not take."""
    if mode:
        raise SceneError(
            f"Argument `mode` must be left out for `{verb}` of a sampled loop, whose contacts all slide, but it is {dict(mode)!r}."
        )


class SampledBranch:
    """Steady running of a sampled loop over one number, each value once: its exact matrix.

    Raises SceneError for a loop whose controllers have no slope.
    """

    def __init__(self, loop: ClosedLoop, free: Number, guess: Mapping[str, Any] | None = None):
        self.loop, self.free, self.guess = without_sensor_errors(loop), free, dict(guess or {})
        check_slopes(loop)
        if loop.depends_on_time:
            raise SceneError("Argument `loop` must not depend on time itself for steady running, but time enters the equations.")
        self.known: dict[float, tuple[SampledPoint, ClosedLoop, FloatArray, FloatArray, float] | None] = {}
        self.reason = "none is found there"

    def __call__(self, value: float) -> tuple[SampledPoint, ClosedLoop, FloatArray, FloatArray, float] | None:
        """(unknowns, loop, their values, matrix, its period [s]) of steady running at a value; None where none is found."""
        if value not in self.known:
            self.known[value] = None
            with contextlib.suppress(SceneError):
                self.known[value] = self._found(value)
        return self.known[value]

    def again(self, value: float) -> None:
        """Search a value without a result once more, because its neighbours may be known now."""
        if self.known.get(value, 0) is None:
            del self.known[value]
            self(value)

    def _found(self, value: float) -> tuple[SampledPoint, ClosedLoop, FloatArray, FloatArray, float] | None:
        loop = self.free.put(self.loop, value)
        point = SampledPoint(loop.system, loop.assembly.plant, loop.assembly.clocks, loop.constant_inputs("steady running"))
        for guess in self._guesses(point, loop, value):
            try:
                q = point.solved(guess)
                if q is None or any(
                    element.law is not None and mode * slip <= STANDS
                    for element, mode, slip in zip(loop.system.elements, point.m, point.slips(q), strict=True)
                ):
                    continue
                slope = point.slope(q)
                checked_smooth(point.value, slope, q)
                matrix, period = matrix_over_period(point, slope)
            except NoDerivative as why:
                self.reason = f"{why} at {self.free.name} = {value:g} {self.free.unit}"
                continue
            return point, loop, q, matrix, period
        return None

    def _guesses(self, point: SampledPoint, loop: ClosedLoop, value: float) -> Iterator[FloatArray]:
        near = [other for other, found in self.known.items() if found is not None]
        for other in sorted(near, key=lambda other: abs(other - value))[:1]:
            known = self.known[other]
            assert known is not None
            point.m = known[0].m
            yield known[2]
        if self.guess and point.placed(self.guess, {}, {}):
            yield point.with_outputs(self.guess, {})
        for steady in smooth_points(loop, self.guess):
            states = {name: steady[name] for name in loop.plant.states}
            memory = {name: steady[name] for update in point.system.updates for name in update.places if name in steady.plant.states}
            if point.placed(states, memory, {}):
                yield point.with_outputs(states, memory)
                yield point.begun(states, {point.names[j]: steady[point.names[j]] for j in point.driven})
        start = RunState.begun(loop.system, loop.assembly.plant, loop.assembly.clocks, loop.start)
        if point.placed({name: start[name] for name in loop.plant.states}, {}, {}):
            yield point.with_outputs({name: start[name] for name in loop.plant.states}, {})

    def poles(self, value: float) -> np.ndarray | None:
        """Poles z over the period of the samples; None without steady running."""
        found = self(value)
        return None if found is None else np.linalg.eigvals(found[3]).astype(complex)

    def swings(self, value: float) -> np.ndarray | None:
        """Return log(z) / period of all pairs of poles [1/s] with positive frequency, the fastest growing first; None without steady
        running."""
        found, poles = self(value), self.poles(value)
        if found is None or poles is None:
            return None
        pairs = poles[poles.imag > REAL * np.abs(poles)]
        exponents = np.log(pairs) / found[4]
        return exponents[np.argsort(-exponents.real)]

    def hopf_values(self, low: float, high: float, values: int) -> list[tuple[float, complex, str]]:
        """Return (value, exponent, side on which the pair is damped) of all Hopf points in a range, in order.

        Raises NoSteadyState where there is no steady running in it.
        """
        grid = np.linspace(low, high, values).tolist()
        for value in grid:
            self(value)
        for value in reversed(grid):
            self.again(value)
        if not any(found is not None for found in self.known.values()):
            raise NoSteadyState(
                f"There is no steady running for `{self.free.name}` from {low:g} to {high:g} {self.free.unit}: {self.reason}"
            )
        found = []
        for a, b in itertools.pairwise(grid):
            left, right = self.swings(a), self.swings(b)
            if left is None or right is None:
                continue
            counts = [int((side.real > 0.0).sum()) for side in (left, right)]
            for k in range(min(counts), max(counts)):
                value = self._crossing(k, a, b)
                if value is not None:
                    swings = self.swings(value)
                    assert swings is not None
                    found.append((value, complex(swings[k]), "below" if counts[0] < counts[1] else "above"))
        return sorted(found)

    def _crossing(self, k: int, a: float, b: float) -> float | None:
        """Where the k-th pair crosses the unit circle between a and b; None where the pair ends there."""

        def growth(value: float) -> float:
            swings = self.swings(value)
            return math.nan if swings is None else float(swings[k].real) if k < swings.size else -1.0

        try:
            value = zero(growth, a, b, 1e-14 * max(abs(a), abs(b)))
        except ValueError:  # nan where there is no steady running
            return None
        swings = self.swings(value)  # where a pair meets on the real axis it ends, with a jump of its real part
        return value if swings is not None and k < swings.size and abs(swings[k].real) < 1e-4 * (abs(growth(a)) + abs(growth(b))) else None

    def equilibrium(self, value: float) -> Equilibrium:
        """Steady running of the plant at a value, under the commands that its controllers hold there."""
        found = self(value)
        assert found is not None
        point, loop, q, _, _ = found
        plant, at = loop.assembly.plant, point.start(loop.assembly.plant, q, kick=0.0)
        states = np.concatenate([np.atleast_1d(at[name]) for name in plant.states])
        given = {**{n: v for n, v in loop.input_values.items() if n in plant.inputs}, **{n: float(at[n]) for n in plant.inputs if n in at}}
        words = {e.name: e.mode_names[round(float(mode))] for e, mode in zip(loop.system.elements, point.m, strict=True)}
        return Equilibrium(plant, states, input_values(plant, given), words)
