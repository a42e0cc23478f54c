"""Steady states of a machine: all that are found at given numbers, and one followed while a number varies."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np

from toolbox.arguments import mapping
from toolbox.errors import NoSteadyState, SceneError
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.numbers import Number
from toolbox.modelling.start import place_starts
from toolbox.modelling.steady_point import Equilibrium, mode_numbers
from toolbox.steady_states.linear import (
    _free,
    _frictionless,
    _modes_at,
    holding_elements,
    input_values,
    residual_functions,
    steady_state,
)
from toolbox.steady_states.zeros import contradictory

MANY_MODES = 81
"""Combinations of modes above which `equilibria` tries only those in which all contacts do the same."""

ENDLESS = 1e12
"""Size of a state, in SI units, that no machine reaches at rest."""


@takes_loop
def equilibria(loop: ClosedLoop) -> list[Equilibrium]:
    """Find steady states in all modes of the contacts, from several guesses.

    Each guess is the state that the plant would have without friction, scaled by 1, 1/2, ... 1/64 and 0. So a friction
    law that falls with speed gives the steady states of low speed, too, and not only the steady state of the highest
    speed. All combinations of modes are tried up to 81 combinations. If there are more, only combinations with the same
    mode for every contact are tried. A contact that may rest anywhere in a range is represented by one state of the
    range. The search does not prove that no other steady state exists.

    Parameters
    ----------
    loop
        A loop with constant inputs, or a plant. Controllers take part in their continuous form.

    Returns
    -------
    list of Equilibrium
        The steady states that were found, with slip before stick. The list may be empty.

    Raises
    ------
    SceneError
        If the argument is neither a loop nor a plant, or if an input varies in time. An empty list is not an error.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, equilibria
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), inputs={"top.torque": "12 kN m"})
    >>> for rest in equilibria(loop):
    ...     print(rest.modes["bit"], f"{rest['bit.speed']:.2f} rad/s")
    slip+ 9.38 rad/s
    slip+ 0.02 rad/s
    stick 0.00 rad/s
    """
    plant, inputs = loop.continuous_loop.system, loop.constant_inputs("a steady state")
    contacts = [element for element in plant.elements if element.law is not None]
    holding = [element.name for element in contacts]
    words = [(legend[1], legend.get(-1, legend[1]), legend[0]) for legend in (element.mode_names for element in contacts)]
    combinations = list(zip(*words, strict=True)) if 3 ** len(holding) > MANY_MODES else list(dict.fromkeys(itertools.product(*words)))
    smooth = _frictionless(_free(plant), plant, input_values(plant, inputs))
    found: list[Equilibrium] = []
    for combination in combinations:
        for factor in (1.0, 0.5, 0.25, 0.125, 1 / 16, 1 / 32, 1 / 64, 0.0):
            guess = state_values(plant, factor * smooth)
            try:
                point = steady_state(plant, inputs, guess, dict(zip(holding, combination, strict=True)), loop.display_units)
            except SceneError:
                continue
            if not any(_same(point, other) for other in found):
                found.append(point)
            if "stick" in combination:  # one of a continuum
                break
    return sorted(found, key=lambda point: list(point.modes.values()).count("stick"))


def _same(a: Equilibrium, b: Equilibrium) -> bool:
    size = np.maximum(np.abs(a.states), np.abs(b.states)).max(initial=0.0)
    return bool(np.abs(a.states - b.states).max(initial=0.0) <= 1e-6 * size) and a.modes == b.modes


def state_values(plant: HybridSystem, x: np.ndarray) -> dict[str, Any]:
    """A state vector as {name: value} for `start`."""
    return {name: float(x[first]) if size is None else x[first : first + size] for name, (first, size, _) in plant.states.items()}


def flow_slopes(point: Equilibrium) -> np.ndarray:
    """df/dx over all states at a steady state, in its modes."""
    plant = point.plant
    return np.array(residual_functions(plant)[1](0.0, point.states, point.inputs, plant.values, mode_numbers(plant, point.modes))[0])


class EquilibriumBranch:
    """Steady states of a closed loop over a free parameter. Each is found once, from its neighbour if it is not found without a guess."""

    def __init__(
        self,
        closed: HybridSystem,
        free: Number,
        inputs: Mapping[str, float],
        mode: Mapping[str, str] | None,
        guess: Mapping[str, Any] | None = None,
    ):
        self.closed, self.free, self.inputs, self.mode = closed, free, inputs, mode
        self.guess: np.ndarray | None = None
        if guess:
            self.guess = closed.begin.copy()
            place_starts(closed, self.guess, mapping("guess", guess))
        self.known: dict[float, Equilibrium | None] = {}
        self.alone: set[float] = set()
        self.reason = ""

    def __call__(self, value: float) -> Equilibrium | None:
        """The steady state at a value of the free parameter; None where none is found (`reason` then says why)."""
        if value not in self.known or (value in self.alone and any(self.known.values())):
            self.alone.discard(value)
            if not any(self.known.values()):
                self.alone.add(value)  # to be tried again once a neighbour is known
            self.known[value] = None if self._contradicts(value) else self._found(value, None) or self._approached(value)
            if self.known[value] is not None:
                self.alone.discard(value)
        return self.known[value]

    def _contradicts(self, value: float) -> bool:
        """Whether the linear equations of the machine contradict the modes asked, as an integral of the speed does that of a contact in stick."""
        if not self.mode:
            return False
        plant, inputs = self.free.varied(self.closed, self.inputs, value)
        u, begin = input_values(plant, inputs), plant.begin
        residual, slopes = residual_functions(plant)
        asked = np.array([element.name in self.mode for element in plant.elements])
        m = _modes_at(plant, begin, u, self.mode, resting=True)
        kept = np.append(np.ones(begin.size, bool), (m == 0.0) & holding_elements(plant) & asked)

        def equations(x: np.ndarray, m: np.ndarray = m) -> np.ndarray:
            return np.concatenate([np.ravel(rows) for rows in residual(0.0, x, u, plant.values, m)])[kept]

        def jacobian(x: np.ndarray) -> np.ndarray:
            return np.vstack(slopes(0.0, x, u, plant.values, m))[kept]

        for place in (begin, begin + 1.0):  # rows in which a mode acts that is not asked may be otherwise
            for other in (-1.0, 0.0, 1.0):
                same = equations(place, np.where(asked, m, other)) == equations(place)
                kept[kept] = same
        if not contradictory(equations, jacobian, begin):
            return False
        self.reason = f"the equations contradict {', '.join(f'`{name}` in {mode}' for name, mode in self.mode.items())}"
        return True

    def _found(self, value: float, start: np.ndarray | None) -> Equilibrium | None:
        begin = None if start is None else state_values(self.closed, start)
        try:
            plant, inputs = self.free.varied(self.closed, self.inputs, value)
            return steady_state(plant, inputs, begin, self.mode)
        except NoSteadyState as error:
            self.reason = str(error)
            return None

    def _approached(self, value: float) -> Equilibrium | None:
        """From the nearest known steady state in ever smaller steps, or by letting the machine relax where none is known."""
        known = [(abs(v - value), v, point) for v, point in self.known.items() if point is not None]
        if not known:
            found = self._found(value, self.guess) if self.guess is not None else None
            return found or self._found(value, self._relaxed(value))
        _, near, point = min(known, key=lambda entry: entry[0])
        for steps in (1, 4, 16, 64):
            reached: Equilibrium | None = point
            for k in range(1, steps + 1):
                reached = self._found(near + (value - near) * k / steps, reached.states) if reached is not None else None
            if reached is not None:
                return reached
        return None

    def _relaxed(self, value: float) -> np.ndarray:
        """Where implicit Euler steps of growing length lead from rest with all contacts in slip: limits and layers of a law do not stop them."""
        plant, inputs = self.free.varied(self.closed, self.inputs, value)
        u = input_values(plant, inputs)
        residual, slopes = residual_functions(plant)
        x = plant.begin.copy()
        m = _modes_at(plant, x, u, self.mode, resting=True)
        a = np.array(slopes(0.0, x, u, plant.values, m)[0])
        step = 0.1 / max(float(np.abs(np.linalg.eigvals(a)).max(initial=0.0)), 1e-9) if np.isfinite(a).all() else 1e-3
        for _ in range(300):
            flow, a = np.array(residual(0.0, x, u, plant.values, m)[0]).ravel(), np.array(slopes(0.0, x, u, plant.values, m)[0])
            if not (np.isfinite(flow).all() and np.isfinite(a).all()):
                break
            try:
                x = x + np.linalg.solve(np.eye(x.size) / step - a, flow)
            except np.linalg.LinAlgError:
                x = x + np.linalg.lstsq(np.eye(x.size) / step - a, flow, rcond=None)[0]
            step *= 1.08
        # a motion that goes on for ever, as an angle does, leads so far that round-off would hide any flow
        return x if np.abs(x).max(initial=0.0) < ENDLESS else plant.begin

    def edge(self, there: float, gone: float) -> float:
        """Return the last value with a steady state, on the way from a value with a steady state to a value without, to 1e-7 of the way."""
        point = self(there)
        assert point is not None
        for _ in range(24):
            middle = 0.5 * (there + gone)
            found = self._found(middle, point.states)
            if found is None:
                gone = middle
            else:
                there, point = middle, found
                self.known[middle] = found
        return there

    def growths(self, value: float) -> np.ndarray | None:
        """Real parts of all pairs of poles at a value [1/s], largest first; None without a steady state."""
        point = self(value)
        if point is None:
            return None
        poles = np.linalg.eigvals(flow_slopes(point))
        return np.sort(poles[poles.imag > 1e-9 * np.abs(poles).max(initial=0.0)].real)[::-1]
