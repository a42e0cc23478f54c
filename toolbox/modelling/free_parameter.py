"""What is varied, and in which machine: an input or a parameter by name, and a plant with its laws in their continuous form."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.errors import SceneError, suggest
from toolbox.modelling.elements import is_finite_number
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Controller, Sampled
from toolbox.simulation.simulate import checked_run


def continuous_loop(
    plant: HybridSystem,
    controller: Any = None,
    *,
    inputs: Mapping[str, float] | None = None,
    parameters: Mapping[str, Any] | None = None,
) -> HybridSystem:
    """The plant with its controllers as parts, each in its continuous form, also where it will run sampled.

    controller, parameters: as in `simulate`; a law is designed on the declared plant. Raises SceneError for a law without a continuous form, such
    as a Python callable.
    """
    laws = []
    for given in [] if controller is None else controller if isinstance(controller, (list, tuple)) else [controller]:
        law = given.law if isinstance(given, Sampled) else given
        if not isinstance(law, Controller):
            raise SceneError(f"Argument `controller` must be a Controller with a continuous form, but it is {law!r}.")
        laws.append(law)
    return checked_run(plant, 0.0, inputs=inputs, parameters=parameters, controller=laws or None).system


def check_unsampled(controller: Any) -> None:
    """Raise SceneError for a law with a sample time or a delay, of which its continuous form knows nothing."""
    for given in controller if isinstance(controller, (list, tuple)) else [controller]:
        if isinstance(given, Sampled):
            raise SceneError(
                "Argument `controller` must hold laws in their continuous form, but it holds a sampled one, whose sample time and delay would be left out: "
                "give the law itself for the limit of fast sampling; `onset` runs it as it is."
            )


@dataclass(frozen=True)
class Knob:
    """A number of a plant that is varied: an input, or a parameter of the plant or its law."""

    name: str
    unit: str
    is_input: bool

    @staticmethod
    def of(plant: HybridSystem, name: str) -> Knob:
        """The knob of that name; raises SceneError where there is neither such an input nor such a parameter, or it is a vector."""
        if isinstance(name, str) and name in plant.inputs:
            return Knob(name, plant.inputs[name].unit, True)
        try:
            entry = plant._parameter(name)
        except SceneError:
            raise SceneError(f"There is no parameter or input `{name}`: {suggest(str(name), [*plant.parameters, *plant.inputs])}") from None
        if entry.size is not None:
            raise SceneError(f"Argument `parameter` must be one number, but `{name}` has {entry.size} entries: name one, e.g. `{name}.0`.")
        return Knob(name, entry.unit, False)

    def declared(self, plant: HybridSystem, inputs: Mapping[str, float]) -> float:
        """Its value as declared, or as given among the inputs."""
        if not self.is_input:
            return float(plant.parameter(self.name))
        if self.name in inputs:
            return float(inputs[self.name])
        return float(np.array(plant.input_defaults(plant.values)).ravel()[list(plant.inputs).index(self.name)])

    def arguments(self, value: float, inputs: Mapping[str, float]) -> dict[str, Any]:
        """`inputs` and `parameters` of `equilibrium` with the knob at a value."""
        if self.is_input:
            return {"inputs": {**inputs, self.name: value}, "parameters": None}
        return {"inputs": dict(inputs), "parameters": {self.name: value}}


def checked_range(between: Any) -> tuple[float, float]:
    """(low, high) of a range; raises SceneError unless it is two finite numbers in that order."""
    try:
        low, high = between
    except (TypeError, ValueError):
        low, high = None, None
    if not is_finite_number(low) or not is_finite_number(high) or not low < high:
        raise SceneError(f"Argument `between` must be two finite numbers (low, high) with low < high, but it is {between!r}.")
    return float(low), float(high)
