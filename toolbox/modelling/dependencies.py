"""Which parts of a plant the requested measures depend on, and what the others cost.

A measure reads signals or the mode of an element. What those depend on follows from the sparsity of the Jacobian of the closed loop: a state from its
derivative, the mode of an element from its guards, a held signal from the law that computes it. A part that owns nothing on these paths can be
left out of the scene without changing any of the measures.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from toolbox.arguments import count_of
from toolbox.errors import SceneError
from toolbox.files.printing import columns
from toolbox.modelling.components import numbers_of
from toolbox.modelling.hybrid_system import HybridSystem


@dataclass(frozen=True)
class Dependency:
    """A component with the number of its states and elements, and the metrics that depend on it. A component without such metrics can be
    removed from the plant."""

    part: str
    states: int
    elements: int
    metrics: tuple[str, ...]


@dataclass(frozen=True)
class Dependencies:
    """The metrics that need each part of a plant; `print` shows the table.

    Attributes
    ----------
    parts
        One `Dependency` for each part, in the order of the plant.
    idle
        Share of the operations of the right-hand side and the guards that no measure needs, from 0 to 1.
    """

    parts: tuple[Dependency, ...]
    idle: float

    @property
    def unused(self) -> tuple[Dependency, ...]:
        """Parts that no measure depends on."""
        return tuple(dependency for dependency in self.parts if not dependency.metrics)

    @property
    def warning(self) -> str:
        """A sentence about the parts on which no metric depends; empty if every part is needed."""
        if not self.unused:
            return ""
        parts = ", ".join(f"{dependency.part} ({dependency.states} states, {dependency.elements} elements)" for dependency in self.unused)
        return f"No measure depends on {parts}: leaving out what nobody looks at would save {100 * self.idle:.0f} % of the operations."

    def __str__(self) -> str:
        rows = [
            (
                each.part,
                f"{each.states} states",
                f"{each.elements} elements",
                ", ".join(each.metrics) or "no measure depends on it",
            )
            for each in self.parts
        ]
        return "\n".join([*columns(rows, (0, 3), ""), *filter(None, [self.warning])])


def dependencies_of(system: HybridSystem, metrics: Mapping[str, Sequence[str]], count: int | None = None) -> Dependencies:
    """What the first `count` parts of a plant (all) are needed for.

    measures: {measure: names of the signals and elements that it reads}. Raises SceneError for a name that the plant does not have.
    """
    if not isinstance(metrics, Mapping) or any(isinstance(names, str) for names in metrics.values()):
        raise SceneError(f"Argument `metrics` must map the names of measures to lists of signals and elements, but it is {metrics!r}.")
    graph = _Graph(system)
    of_parts = np.cumsum([0, *(len(numbers_of(part)) for part in system.parts)])
    owners = {name: graph.places(name) for name in system.owners}
    chosen: list[set[str]] = [set() for _ in system.parts]
    every: set[int] = set()
    for measure, names in metrics.items():
        seen, used = graph.needed(names)
        every |= seen
        for name, owner in system.owners.items():
            if owners[name] & seen:
                chosen[owner].add(measure)
        for k in _columns(used, system.p):
            owner = int(np.searchsorted(of_parts, k, "right")) - 1
            if owner < len(chosen):  # behind them stand defaults of signals
                chosen[owner].add(measure)
    total, spent = _operations(graph.expressions), _operations([graph.expressions[k] for k in sorted(every)])
    parts = []
    for i, part in enumerate(system.parts[:count]):
        own = [name for name, owner in system.owners.items() if owner == i]
        states = sum(system.states[name][1] or 1 for name in own if name in system.states)
        read_by = tuple(measure for measure in metrics if measure in chosen[i])
        parts.append(Dependency(type(part).__name__, states, sum(name in graph.elements for name in own), read_by))
    return Dependencies(tuple(parts), 1.0 - spent / total if total else 0.0)


class _Graph:
    """What each state, element, and memory or output of a sampled law is computed from: entries of the four, numbered in that order."""

    def __init__(self, system: HybridSystem):
        self.system, form = system, system.switched_equations
        self.elements = [element.name for element in system.elements]
        self.nodes = ca.vertcat(system.x, system.m, *(update.memory for update in system.updates), system.held)
        guards = [ca.vertcat(form.guards[2 * i], form.guards[2 * i + 1]) for i in range(len(self.elements))]
        following = [update.following for update in system.updates if update.memory.numel()]
        of_laws = [
            entry for each in (*following, *(update.outputs for update in system.updates)) for entry in ca.vertsplit(ca.densify(each))
        ]
        self.expressions = [
            system.substitute_forces(each) for each in (*(form.field[j] for j in range(system.x.numel())), *guards, *of_laws)
        ]
        self.depends = [_columns(expression, self.nodes) for expression in self.expressions]

    def places(self, name: str) -> set[int]:
        """The entries of an element or a state."""
        if name in self.elements:
            return {self.system.x.numel() + self.elements.index(name)}
        start, size, _ = self.system.states[name]
        return set(range(start, start + count_of(size)))

    def needed(self, names: Sequence[str]) -> tuple[set[int], ca.SX]:
        """(entries that elements and signals are computed from, the expressions of all of them)."""
        system, read = self.system, ca.SX(0, 1)
        seen = {place for name in names if name in self.elements for place in self.places(name)}
        for name in (name for name in names if name not in self.elements):
            system.signal_unit(name)
            read = ca.vertcat(read, system.substitute_forces(system.expression(name)))
        seen |= _columns(read, self.nodes)
        waiting = list(seen)
        while waiting:
            following = self.depends[waiting.pop()] - seen
            seen |= following
            waiting += following
        return seen, ca.vertcat(read, *[self.expressions[k] for k in sorted(seen)])


def _columns(expression: ca.SX, symbols: ca.SX) -> set[int]:
    """Indices of the symbols that an expression depends on."""
    if not expression.numel() or not symbols.numel():
        return set()
    return {int(j) for j in ca.jacobian_sparsity(ca.densify(expression), symbols).get_triplet()[1]}


def _operations(expressions: Sequence[ca.SX]) -> int:
    """Number of instructions of all expressions together."""
    if not expressions:
        return 0
    together = ca.vertcat(*expressions)
    return int(ca.Function("count", ca.symvar(together), [together]).n_nodes())
