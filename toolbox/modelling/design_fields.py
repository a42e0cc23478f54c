"""Fields of declared controllers that their design alone knows, and controllers with other values of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

import casadi as ca

from toolbox.arguments import count_of
from toolbox.modelling.components import fields_of, first_word, is_nested
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Controller, Sampled

DECLARED = "design"
"""Second word of a declared number that only the design knows, while another number of its name acts in the law of another class that the design made."""

Loop = Any
"""A `ClosedLoop`, which is made of numbers and therefore stands above this file."""


def acts(loop: Loop, name: str, if_given: bool = False) -> bool:
    """Whether a parameter of the closed system enters its motion, or the default of an input that is not given; if_given: or of any input."""
    system = loop.system
    free = [each.default for name, each in system.inputs.items() if if_given or name not in loop.input_values]
    entry = system._parameter(name)
    symbol = system.p[entry.offset : entry.offset + count_of(entry.size)]

    return bool(ca.depends_on(motion_of(system), symbol) or (free and ca.depends_on(ca.vertcat(*free), symbol)))


def motion_of(system: HybridSystem) -> ca.SX:
    """Return all expressions that determine the motion of a system: its flow, and the expressions of its elements and of its sampled
    laws."""

    def motion() -> ca.SX:
        of_elements = [getattr(element, kind) for element in system.elements for kind in element.expression_fields]
        of_laws = [each for update in system.updates for each in (update.following, update.outputs)]
        return ca.vertcat(system.flow, *(ca.vec(ca.SX(each)) for each in (*of_elements, *of_laws)))

    return ca.SX(system.once("motion", motion))


def controller_word(loop: Loop, index: int) -> str:
    """The first word of the names of all numbers of a controller of a loop."""
    return first_word(loop.system.parts[len(loop.system.parts) - len(loop.controllers) + index])


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
    fields: dict[str, tuple[Mapping[str, Any], float]] = {}
    for path, (spec, value, remade) in _collected(law, loop.designed_controllers[index], ""):
        name = f"{controller_word(loop, index)}{path}"
        if not (loop.system.has_parameter(name) and acts(loop, name, remade)):
            fields[name] = (spec, value)
        elif remade:
            fields[f"{controller_word(loop, index)}.{DECLARED}{path}"] = (spec, value)
    return fields


def designed_law(loop: Loop, name: str) -> int | None:
    """Which law of a loop a field of that name belongs to that its design alone knows; None for none."""
    return next((index for index in range(len(loop.controllers)) if name in design_fields(loop, index)), None)


def _collected(node: Any, made: Any, path: str) -> Iterator[tuple[str, tuple[Mapping[str, Any], float, bool]]]:
    """(path, (declaration, value, whether the design made a law of another class)) of every number that a declared law holds."""
    remade = type(node) is not type(made)
    for each in fields_of(type(node)):
        value, here = getattr(node, each.name), f"{path}.{each.name}"
        if is_nested(value):
            yield from _collected(value, getattr(made, each.name, None), here)
        elif each.numeric and isinstance(value, tuple):
            yield from ((f"{here}.{i}", (each.spec.metadata, number, remade)) for i, number in enumerate(value))
        elif each.numeric and isinstance(value, (int, float)):
            yield here, (each.spec.metadata, value, remade)


def redesigned(loop: Loop, name: str, value: float) -> Loop:
    """The loop with one field of a declared law changed, which is designed anew."""
    index = designed_law(loop, name)
    assert index is not None
    given = loop.controllers[index]
    path = name.removeprefix(f"{controller_word(loop, index)}.").removeprefix(f"{DECLARED}.").split(".")
    law = with_field(given.law if isinstance(given, Sampled) else given, path, value)
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
