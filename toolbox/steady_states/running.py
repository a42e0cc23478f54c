"""Steady running that is asked for by what it does, such as a speed, instead of by what drives it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import mapping, number
from toolbox.errors import SceneError
from toolbox.files.unit_systems import asked_units
from toolbox.files.units import NumberOrText
from toolbox.modelling.clamps import opened
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import names
from toolbox.modelling.numeric import NumericFunction
from toolbox.modelling.steady_point import Equilibrium, closed_signal, function_of
from toolbox.modelling.two_directions import check_one_direction
from toolbox.steady_states.equilibria import state_values
from toolbox.steady_states.linear import input_values, steady_state
from toolbox.steady_states.zeros import past_limits


@takes_loop
def running(loop: ClosedLoop, at: Mapping[str, NumberOrText], actuated_signals: str | Sequence[str]) -> Equilibrium:
    """Find the steady state with given values of some signals and every contact sliding forwards, and the inputs that keep it there.

    Parameters
    ----------
    loop
        A plant, or a loop of laws in their continuous form.
    at
        Values {signal: value} in SI or text with a unit, such as {"top.speed": "95 rpm"}.
    actuated_signals
        The inputs that are sought, as many as there are signals, such as "top.torque".

    Returns
    -------
    Equilibrium
        The steady state; its `inputs` hold those that were found.

    Raises
    ------
    SceneError
        If there is no such state, or a name is unknown.
    """
    loop = loop.unsampled()
    plant, inputs = loop.system, loop.constant_inputs("a steady state")
    check_one_direction(plant.elements, "`running`", "give its inputs and a `guess` to `equilibrium`")
    driven = names(actuated_signals)
    wanted = {name: number(name, value, plant.signal_unit(name)) for name, value in mapping("at", at).items()}
    for name in driven:
        plant.input(name)
    if len(driven) != len(wanted):
        raise SceneError(f"Argument `at` must give a number for {len(driven)} signal(s), as many as `drives` has, but it is {at!r}.")
    u = input_values(plant, {name: value for name, value in inputs.items() if name not in driven})
    columns = [list(plant.inputs).index(name) for name in driven]
    target = np.array(list(wanted.values()), float)
    n = plant.x.numel()

    def expressions() -> list[ca.SX]:
        values = ca.vertcat(plant.switched_equations.field, *[closed_signal(plant, name) for name in wanted])
        return [values, ca.jacobian(values, plant.x), ca.jacobian(values, plant.u)]

    function = function_of(plant, ("running", *wanted), expressions)
    m, begin = np.ones(len(plant.elements)), np.concatenate([plant.begin, u[columns]])
    zero = np.concatenate([np.zeros(n), target])

    def solved(q: np.ndarray) -> np.ndarray:
        """The states and the driven inputs by Newton's method, from a guess of both."""
        for _ in range(50):
            u[columns] = q[n:]
            value, of_x, of_u = (np.array(each) for each in function(0.0, q[:n], u, plant.values, m))
            residual = value.ravel() - zero
            slope = np.hstack([of_x, of_u[:, columns]])
            scale = np.abs(slope).max(axis=0)
            scale[scale == 0.0] = 1.0
            with np.errstate(all="ignore"):
                rows = np.abs(slope / scale).max(axis=1)
                matrix, right = slope / scale / rows[:, None], -residual / rows
            if not (np.isfinite(matrix).all() and np.isfinite(right).all()):
                break
            step = np.linalg.lstsq(matrix, right, rcond=1e-13)[0] / scale
            q = q + step
            if np.abs(step * scale).max() <= 1e-13 * np.abs(q * scale).max():
                break
        return q

    asked = ", ".join(f"{name} = {value:g} {plant.signal_unit(name)}" for name, value in wanted.items())

    def checked(q: np.ndarray) -> Equilibrium:
        """The steady state near a solution; raises SceneError if there is none, or if it is another one."""
        u[columns] = q[n:]
        found = dict(zip(plant.inputs, u.tolist(), strict=True))
        try:
            point = steady_state(plant, found, state_values(plant, q[:n]))
        except SceneError as error:
            raise SceneError(f"There is no steady running at {asked}: {error}") from None
        reached = np.array([point[name] for name in wanted])
        if not (np.abs(reached - target) <= 1e-6 * np.maximum(np.abs(target), np.abs(reached))).all():
            raise SceneError(f"There is no steady running at {asked} that `{'`, `'.join(driven)}` can keep.")
        return dataclasses.replace(point, display_units={**loop.display_units, **asked_units(wanted)})

    try:
        return checked(solved(begin))
    except SceneError:
        past = _past_limits(plant, wanted, target, columns, u, begin)
        if past is None:
            raise
        return checked(solved(past))


def _past_limits(
    plant: HybridSystem, wanted: Mapping[str, float], target: np.ndarray, columns: list[int], u: np.ndarray, begin: np.ndarray
) -> np.ndarray | None:
    """Where states and driven inputs keep the wanted signals, by way of the plant without its limits; None for a plant without limits."""

    def functions() -> tuple[NumericFunction, NumericFunction] | None:
        values = [plant.switched_equations.field, *[closed_signal(plant, name) for name in wanted]]
        rows, shares, held_back = opened(values, ca.vertcat(plant.x, plant.u))
        if not shares.numel():
            return None
        value = ca.vertcat(*rows)
        arguments = [plant.t, plant.x, plant.u, plant.p, plant.m, shares]
        results = [value, ca.jacobian(value, plant.x), ca.jacobian(value, plant.u)]
        made = [NumericFunction(ca.Function("limits", arguments, [ca.densify(each) for each in those])) for those in (results, [held_back])]
        return made[0], made[1]

    made = plant.once(("open limits of running", *wanted), functions)
    if made is None:
        return None
    n, m = plant.x.numel(), np.ones(len(plant.elements))
    zero = np.concatenate([np.zeros(n), target])

    def of(function: NumericFunction, q: np.ndarray, share: np.ndarray) -> Any:
        inputs = u.copy()
        inputs[columns] = q[n:]
        return function(0.0, q[:n], inputs, plant.values, m, share)

    def equations(q: np.ndarray, share: np.ndarray) -> np.ndarray:
        return np.array(of(made[0], q, share)[0]).ravel() - zero

    def slopes(q: np.ndarray, share: np.ndarray) -> np.ndarray:
        _, of_x, of_u = (np.array(each) for each in of(made[0], q, share))
        return np.hstack([of_x, of_u[:, columns]])

    def held_back(q: np.ndarray, share: np.ndarray) -> np.ndarray:
        return np.array(of(made[1], q, share)).ravel()

    return past_limits(equations, slopes, held_back, made[1].function.numel_out(0), begin, "lm")


def at_set_points(loop: ClosedLoop) -> Equilibrium:
    """Return steady running of a plant at the set-points of its laws, which are inputs of the closed loop. SceneError is raised if there is
    none.

    `top.reference` is that of the signal `top.speed`, `weight.reference` that of an input `bit.weight` that a law drives.
    """
    plant, system, inputs = loop.plant, loop.system, loop.constant_inputs("steady running")
    wanted = {}
    values = dict(zip(system.inputs, input_values(system, inputs).tolist(), strict=True))
    for name, value in values.items():
        part, _, kind = name.rpartition(".")
        if kind == "reference" and plant.has_signal(f"{part}.speed"):
            wanted[f"{part}.speed"] = value
    driven = {name: f"{name.rpartition('.')[2]}.reference" for name in plant.inputs if name not in system.inputs}
    drives = tuple(name for name, reference in driven.items() if reference not in values)
    known = {name: value for name, value in inputs.items() if name in plant.inputs}
    # a law that drives the weight keeps it where it is asked
    known |= {name: values[reference] for name, reference in driven.items() if reference in values}
    return running(dataclasses.replace(loop.without_controllers, inputs=known), wanted, drives)
