"""A run: what is simulated, checked and resolved, so that it can be run again with another accuracy, method or output times."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.modelling.clocks import Clock
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.numbers import Number
from toolbox.simulation.budget import Budget
from toolbox.simulation.methods import Method, method_of
from toolbox.simulation.run_state import RunState


@dataclass(frozen=True)
class Run:
    """What is simulated, checked and resolved.

    Attributes
    ----------
    plant, system
        The plant, and the closed system that it makes with its laws.
    duration
        Length of the run [s].
    start
        The state in which it begins.
    inputs, kinds
        Values of the inputs, and how each of them is given, which is structure.
    clocks
        Clock of each sampled law.
    controllers
        Python callables among the laws.
    accuracy
        Target for the global error.
    output_times
        Times at which the run is recorded [s]; None for every step.
    longest_step
        Longest step that may be taken [s].
    seeds
        Seed of the noise of each sampled law.
    method
        How the run is stepped, with its options.
    budget
        What the run may spend.
    solver
        Function that carries the run out and returns a Trajectory.
    loop
        The loop that is run, which knows the units in which it was typed.
    """

    plant: HybridSystem
    system: HybridSystem
    duration: float
    start: RunState
    inputs: dict[str, Any]
    kinds: tuple[tuple[str, Any], ...]
    clocks: list[Clock]
    controllers: list[Any]
    accuracy: float
    output_times: np.ndarray | None
    longest_step: float
    seeds: list[int]
    method: Method
    budget: Budget
    solver: Callable[[Run], Any]
    loop: ClosedLoop

    @property
    def display_units(self) -> Mapping[str, str]:
        """{unit: unit typed in the question}. Reports and figures use the typed units."""
        return self.loop.display_units

    @property
    def end(self) -> float:
        """Time of the end of the run [s]."""
        return self.start.time + self.duration

    def at(self, number: Number, value: float) -> Run:
        """Return the same run with another value of an input, of a number of its shape, of a parameter in the equations, or of a sample
        time or delay.

        Raises SceneError for a value out of its bounds.
        """
        loop = number.put(self.loop, value)
        return dataclasses.replace(self, loop=loop, **number.kind.in_run(self, loop, number.name, value))

    def again(self, **changes: Any) -> Any:
        """The trajectory of the same run with some of its fields changed, for example another accuracy."""
        if "method" in changes:
            changes["method"] = method_of(changes["method"])
        if "start" in changes:
            changes["start"] = changes["start"].on_clocks(changes.get("clocks", self.clocks))
        return self.solver(dataclasses.replace(self, **changes) if changes else self)
