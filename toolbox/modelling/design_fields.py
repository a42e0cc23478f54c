"""Fields of declared controllers that their design alone knows, and controllers with other values of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import casadi as ca

from toolbox.arguments import count_of
from toolbox.modelling.components import fields_of, is_nested
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Controller, Sampled

Loop = Any
"""A `ClosedLoop`, which is made of numbers and therefore stands above this file."""


def acts(loop: Loop, name: str) -> bool:
    """Whether a parameter of the closed system enters its motion, or the default of an input that is not given."""
    system = loop.system
    entry, more = system._parameter(name), [each.default for name, each in system.inputs.items() if name not in loop.input_values]
    symbol = system.p[entry.offset : entry.offset + count_of(entry.size)]

    return bool(ca.depends_on(motion_of(system), symbol) or (more and ca.depends_on(ca.vertcat(*more), symbol)))


def motion_of(system: HybridSystem) -> ca.SX:
    """Return all expressions that determine the motion of a system: its flow, and the expressions of its elements and of its sampled
    laws."""

    def motion() -> ca.SX:
        of_elements = [getattr(element, kind) for element in system.elements for kind in element.expression_fields]
        of_laws = [each for update in system.updates for each in (update.following, update.outputs)]
        return ca.vertcat(system.flow, *(ca.vec(ca.SX(each)) for each in (*of_elements, *of_laws)))

    return ca.SX(system.once("motion", motion))


def design_fields(loop: Loop, index: int) -> dict[str, tuple[Mapping[str, Any], float]]:
    """{name: (declaration, value)} of the fields of a declared law that its design alone knows, because they act nowhere in the closed system."""
    known = loop.__dict__.setdefault("design_fields", {})  # asked for by every number that is looked for
    if index not in known:
        known[index] = _found_design_fields(loop, index)
    return known[index]


def _found_design_fields(loop: Loop, index: int) -> dict[str, tuple[Mapping[str, Any], float]]:
    given = loop.controllers[index]
    law = given.law if isinstance(given, Sampled) else given
    if not isinstance(law, Controller) or type(law).design is Controller.design:
        return {}
    prefix = law.name or type(law).__name__.lower()
    fields: dict[str, tuple[Mapping[str, Any], float]] = {}
    _collect(law, f"{prefix}.", fields)
    system = loop.system
    return {name: entry for name, entry in fields.items() if not (system.has_parameter(name) and acts(loop, name))}


def designed_law(loop: Loop, name: str) -> int | None:
    """Which law of a loop a field of that name belongs to that its design alone knows; None for none."""
    return next((index for index in range(len(loop.controllers)) if name in design_fields(loop, index)), None)


def _collect(node: Any, path: str, found: dict[str, tuple[Mapping[str, Any], float]]) -> None:
    for each in fields_of(type(node)):
        value = getattr(node, each.name)
        if is_nested(value):
            _collect(value, f"{path}{each.name}.", found)
        elif each.numeric and isinstance(value, tuple):
            found |= {f"{path}{each.name}.{i}": (each.spec.metadata, number) for i, number in enumerate(value)}
        elif each.numeric and isinstance(value, (int, float)):
            found[f"{path}{each.name}"] = (each.spec.metadata, value)


def redesigned(loop: Loop, name: str, value: float) -> Loop:
    """The loop with one field of a declared law changed, which is designed anew."""
    index = designed_law(loop, name)
    assert index is not None
    given = loop.controllers[index]
    law = with_field(given.law if isinstance(given, Sampled) else given, name.split(".")[1:], value)
    return loop.replace(controllers=(*loop.controllers[:index], as_sampled(given, law), *loop.controllers[index + 1 :]))


def as_sampled(given: Any, law: Any) -> Any:
    """A law as another one is sampled."""
    return dataclasses.replace(given, law=law) if isinstance(given, Sampled) else law


def with_field(node: Any, path: list[str], value: float) -> Any:
    """A controller, or a tuple in it, with another value at a path of fields and places."""
    if not path:
        return value
    head, *tail = path
    if isinstance(node, tuple):
        place = int(head)
        return (*node[:place], with_field(node[place], tail, value), *node[place + 1 :])
    return dataclasses.replace(node, **{head: with_field(getattr(node, head), tail, value)})
