"""What is varied, and in which machine: an input or a parameter by name, and a plant with its laws in their continuous form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.arguments import checked_range
from toolbox.errors import SceneError, suggest
from toolbox.files.units import in_si
from toolbox.modelling.hybrid_system import HybridSystem


@dataclass(frozen=True)
class FreeParameter:
    """A number of a plant that is varied: an input, or a parameter of the plant or its law."""

    name: str
    unit: str
    is_input: bool

    @staticmethod
    def of(plant: HybridSystem, name: str) -> FreeParameter:
        """The free parameter of that name; raises SceneError where there is neither such an input nor such a parameter, or it is a vector."""
        if isinstance(name, str) and name in plant.inputs:
            return FreeParameter(name, plant.inputs[name].unit, True)
        try:
            entry = plant._parameter(name)
        except SceneError:
            hint = suggest(str(name), [*plant.parameters, *plant.inputs])
            if str(name).endswith(".reference") and not any(each.endswith(".reference") for each in (*plant.parameters, *plant.inputs)):
                hint = "a set-point belongs to a control law, and there is none: give it as `controller`."
            raise SceneError(f"There is no parameter or input `{name}`: {hint}") from None
        if entry.size is not None:
            raise SceneError(f"Argument `parameter` must be one number, but `{name}` has {entry.size} entries: name one, e.g. `{name}.0`.")
        return FreeParameter(name, entry.unit, False)

    def declared(self, plant: HybridSystem, inputs: Mapping[str, float]) -> float:
        """Its value as declared, or as given among the inputs."""
        if not self.is_input:
            return float(plant.parameter(self.name))
        if self.name in inputs:
            return float(in_si(inputs[self.name], self.unit, self.name))
        return float(np.array(plant.input_defaults(plant.values)).ravel()[list(plant.inputs).index(self.name)])

    def typed(self, word: str, given: Any) -> Any:
        """What an argument of it holds, with text as numbers in its unit."""
        return in_si(given, self.unit, word)

    def between(self, given: Any) -> tuple[float, float]:
        """A range of it, numbers in SI or text with units. Raises SceneError unless it is (low, high) in that order."""
        return checked_range(in_si(given, self.unit, "between"))

    def arguments(self, value: float, inputs: Mapping[str, float]) -> dict[str, Any]:
        """`inputs` and `parameters` of `equilibrium` with the free parameter at a value."""
        if self.is_input:
            return {"inputs": {**inputs, self.name: value}, "parameters": None}
        return {"inputs": dict(inputs), "parameters": {self.name: value}}
