"""A steady state of a plant, and its functions evaluated there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import FloatArray
from toolbox.errors import SceneError
from toolbox.files.printing import Printed, columns
from toolbox.files.unit_systems import reading
from toolbox.modelling.elements import Element
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.numeric import NumericFunction


def _code(element: Element, word: str) -> float:
    """The number of a mode; raises SceneError for a word that is not in the element's legend."""
    codes = {known: float(code) for code, known in element.mode_names.items()}
    if word not in codes:
        *others, last = codes
        raise SceneError(f"Argument `mode` must be {', '.join(others)} or {last} for `{element.name}`, but it is {word!r}.")
    return codes[word]


@dataclass(frozen=True)
class Equilibrium(Printed):
    """A steady state of a plant: `rest["bit.speed"]` reads a signal, `print(rest)` shows all.

    Attributes
    ----------
    plant
        The plant with the parameters that the state was found for.
    states
        States x, shape (n,).
    inputs
        Inputs u, shape (n_u,).
    modes
        {element: mode}.
    display_units
        {unit: unit that was typed}: the units in which `print` answers.
    """

    plant: HybridSystem
    states: FloatArray
    inputs: FloatArray
    modes: Mapping[str, str]
    display_units: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> float | Any:
        """A signal, input or entry of a vector state in SI: a float, or an array for a vector state. Raises SceneError for an unknown name."""
        rows = self.plant.state_index(name)
        if rows is not None:
            first, size, _ = rows
            return float(self.states[first]) if size is None else np.array(self.states[first : first + size])
        function = function_of(self.plant, ("signal", name), lambda: [closed_signal(self.plant, name)])
        value = np.array(function(0.0, self.states, self.inputs, self.plant.values, mode_numbers(self.plant, self.modes))).ravel()
        return float(value[0]) if value.size == 1 else value

    def __contains__(self, name: object) -> bool:
        return self.plant.has_signal(name)

    def __str__(self) -> str:
        title = "Steady state" + (": " + ", ".join(f"{name} in {mode}" for name, mode in self.modes.items()) if self.modes else "")
        rows = []
        units = {name: unit for name, (_, unit) in self.plant.signals.items()} | {i.name: i.unit for i in self.plant.inputs.values()}
        for name, unit in units.items():
            factor, unit = reading(unit, self.display_units)
            value = self[name] * factor
            shown = f"{value:.6g}" if isinstance(value, float) else "[" + ", ".join(f"{entry:.6g}" for entry in value) + "]"
            rows.append((name, shown, unit))
        return "\n".join([title, *columns(rows, range(3))])


def function_of(plant: HybridSystem, key: tuple[str, ...], make: Callable[[], list[ca.SX]]) -> NumericFunction:
    """Function (t, x, u, p, m) -> the expressions that `make` gives, kept for all plants of this structure."""
    symbols = [plant.t, plant.x, plant.u, plant.p, plant.m]
    return plant.once(
        ("linear", *key), lambda: NumericFunction(ca.Function(key[0], symbols, [ca.densify(expression) for expression in make()]))
    )


def closed_signal(plant: HybridSystem, name: str) -> ca.SX:
    """A signal as an expression of t, x, u, p and m."""
    return plant.substitute_forces(ca.densify(ca.SX(plant.expression(name))))


def mode_numbers(plant: HybridSystem, modes: Mapping[str, str]) -> np.ndarray:
    """Modes of all elements as the numbers of their legends, shape (elements,)."""
    return np.array([_code(element, modes[element.name]) for element in plant.elements])
