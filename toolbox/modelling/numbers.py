"""Every number of a closed loop that can be varied: one name for each, known to every verb.

    input        a signal that nobody gives, held constant                       top.torque, top.reference
    parameter    a number of a part or of a law, where it acts                   bit.weight, chain.inertia.0, softtorque.proportional
    design       a field of a law that only its design knows                     softtorque.detuning
    shape        a number of the shape that an input has                         top.torque.amplitude
    node         a time or a value of the table that an input has                top.torque.values.2
    sample time  the sample time of a controller                                 softtorque.sample_time
    delay        the time from a sample until its outputs take effect            softtorque.delay
    jitter       the largest lateness of a sample                                softtorque.jitter
    missed       the probability that a sample is missed                         softtorque.missed_samples
    noise        the standard deviation of the noise of a sensor                 softtorque.sensors.noise.0
    resolution   the step of an encoder                                          softtorque.sensors.resolution.0
    start        the start value of a state, or of what a sampled law remembers  bit.speed, softtorque.angle

An input and a parameter of one name are one number: the input, whose default the parameter is.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import checked_range, count_of, refuse
from toolbox.errors import SceneError
from toolbox.files.units import NumberOrText, TypedNumber, in_si, warn_unusual
from toolbox.modelling import inputs as shapes
from toolbox.modelling import number_kinds as kinds
from toolbox.modelling.components import fields_of, numbers_of, rebuilt
from toolbox.modelling.design_fields import acts, as_sampled, design_fields, designed_law, with_field
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Sampled
from toolbox.modelling.number_kinds import NumberKind
from toolbox.modelling.start import place_starts, places_of, row_of, started

Loop = Any
"""A `ClosedLoop`, which is made of numbers and therefore stands above this file."""


@dataclass(frozen=True)
class Number:
    """One number of a closed loop.

    Attributes
    ----------
    name
        Its name, by which every verb knows it.
    unit
        Its unit in SI.
    kind
        Its kind, which says how it is put into a run and what can vary it (`toolbox.modelling.number_kinds`).
    value
        Its value in the loop, in SI; NaN for an input that varies in time.
    meaning
        What it is, as its part declares it.
    bounds
        {"at_least", "above", "at_most": bound or None}.
    typical_range
        (low, high) between which every sound number lies; None where nothing is said.
    overridden
        The input, given or driven by a law, that takes the place of this number, so that it has no effect; None for none.
    """

    name: str
    unit: str
    kind: NumberKind
    value: float
    meaning: str = ""
    bounds: Mapping[str, float | None] = field(default_factory=dict)
    usual: tuple[float, float] | None = None
    overridden: str | None = None

    @property
    def is_input(self) -> bool:
        """Whether it is an input that is held constant."""
        return self.kind.is_input

    @property
    def is_parameter(self) -> bool:
        """True for a number of a part, a controller or its sensors, in the place that the equations read."""
        return self.kind.is_parameter

    @property
    def is_design(self) -> bool:
        """Whether only the design of a controller knows it."""
        return self.kind.is_design

    @property
    def is_clock(self) -> bool:
        """Whether it belongs to the clock of a controller: its sample time, delay, jitter or missed samples."""
        return self.kind.is_clock

    @property
    def is_shape(self) -> bool:
        """Whether it is a number of the shape of an input."""
        return self.kind.is_shape

    @property
    def is_node(self) -> bool:
        """Whether it is a time or a value of the table of an input."""
        return self.kind.is_node

    @property
    def is_start(self) -> bool:
        """Whether it is a start value."""
        return self.kind.is_start

    @property
    def is_shift(self) -> bool:
        """Whether it is the shift of a channel of a recording."""
        return self.kind.is_shift

    def in_si(self, word: str, given: Any) -> Any:
        """Return a given value with text converted to a number in the unit of this number. word: argument that an error names."""
        return in_si(given, self.unit, word)

    def between(self, given: Any, word: str = "bounds") -> tuple[float, float]:
        """A range of it, numbers in SI or text with units. Raises SceneError unless it is (low, high) in that order."""
        return checked_range(given, word, self.unit)

    def span(self, given: Any, word: str = "bounds") -> tuple[float, float]:
        """Return the range of variation, like `between`. The warning `UnusualValue` is given if the far end, typed without a unit, is not
        usual: another unit may be meant."""
        low, high = self.between(given, word)
        far = high if abs(high) >= abs(low) else low
        if self.usual is not None and not any(isinstance(end, (str, TypedNumber)) for end in given):
            warn_unusual(far, float(far), self.unit, self.usual, self.name)
        return low, high

    def check(self, value: Any) -> None:
        """Raise SceneError unless a value is finite and within the bounds."""
        refuse(f"Argument `{self.name}`", value, self.unit, self.bounds)

    def varied(self, system: HybridSystem, inputs: Mapping[str, Any], value: float) -> tuple[HybridSystem, dict[str, Any]]:
        """Return a closed system and its inputs with this value. Both are unchanged if the number, such as a start value, does not enter
        the equations."""
        return self.kind.varied(system, inputs, self.name, value)

    def put(self, loop: Loop, value: NumberOrText) -> Loop:
        """Return the loop with this value. SceneError is raised if the value is out of bounds."""
        value = self.in_si(self.name, value)
        self.check(value)
        return self.kind.put(loop, self.name, value)

    def in_input(self, inputs: Iterable[str]) -> tuple[str, str]:
        """(input, name of the number in its shape or table), for the number of a shape."""
        return kinds.in_input(self.name, inputs)


def numbers_in(loop: Loop) -> dict[str, Number]:
    """Every number of a loop by name: inputs, parameters of parts and laws, design fields, shapes, start values."""
    system = loop.system
    names = [*system.inputs]
    for name, entry in system.parameters.items():
        names += [name] if entry.size is None else [f"{name}.{i}" for i in range(entry.size)]
    names += [name for i in range(len(loop.controllers)) for name in design_fields(loop, i)]
    names += [f"{prefix}.{word}" for prefix in kinds.clock_prefixes(loop) for word in kinds.CLOCK_KINDS]
    for name, value in loop.input_values.items():
        names += [f"{name}.{key}" for key in _shape_numbers(value)]
    sizes = {name: system.states[name][1] if name in system.states else None for name in started(system)}
    for name, size in (sizes | remembered(system)).items():
        names += [name] if size is None else [f"{name}.{i}" for i in range(size)]
    found = {name: number_of(loop, name) for name in dict.fromkeys(names)}
    return {name: number for name, number in found.items() if number is not None}


def put_all(loop: Loop, values: Mapping[str, NumberOrText]) -> Loop:
    """Return a loop with other values of several numbers. The values are set, and errors raised, as by `loop.at`.

    Parameters are put together, because what a part demands of two of them, such as a static friction above the kinetic one, may not hold in between.
    """
    numbers = {name: loop.number(name) for name in values}
    together = {each.name: each.in_si(each.name, values[name]) for name, each in numbers.items() if each.is_parameter}
    for each in numbers.values():
        if each.name in together:
            each.check(together[each.name])
    if together:
        kept = {name: given for name, given in loop.inputs.items() if name not in together}
        loop = loop.replace(parameters={**loop.parameters, **together}, inputs=kept)
    for name, each in numbers.items():
        if each.name not in together:
            loop = loop.at(name, values[name])
    return loop


def number_of(loop: Loop, name: str) -> Number | None:
    """The number of that name, or None."""
    system = loop.system
    if not isinstance(name, str):
        return None
    if name in system.inputs:
        entry = system.parameters.get(name)
        usual = _usual(system, name) if entry is not None else _usual_default(system, system.inputs[name].default)
        return Number(name, system.inputs[name].unit, kinds.INPUT, _input_value(loop, name), entry.meaning if entry is not None else "",
                      entry.bounds if entry is not None else {}, usual)  # fmt: skip
    design = designed_law(loop, name)
    if design is not None:
        spec, value = design_fields(loop, design)[name]
        return Number(name, spec.get("unit", "1"), kinds.DESIGN, float(value), spec.get("meaning", ""), _bounds(spec), spec.get("usual"))
    clock = kinds.clock_value(loop, name)
    if clock is not None:
        clock_kind, value = clock
        return Number(name, clock_kind.unit, clock_kind, value, clock_kind.meaning, clock_kind.bounds)
    if system.has_parameter(name):
        entry = system._parameter(name)
        if entry.size is not None:
            return None
        kind, value = kinds.noise_or_resolution(name), float(system.parameter(name))
        return Number(name, entry.unit, kind, value, entry.meaning, entry.bounds, _usual(system, name), overridden(loop, name))
    for given, value in loop.input_values.items():
        key = name[len(given) + 1 :]
        if name.startswith(f"{given}.") and key in _shape_numbers(value):
            unit = shapes.UNITS.get(value.shape, {}).get(key, "s" if key.startswith("times.") else "")
            kind = kinds.NODE if isinstance(value, shapes.Table) else kinds.SHAPE
            return Number(name, unit or system.inputs[given].unit, kind, float(_shape_numbers(value)[key]))
    if row_of(system, name) is not None:
        x = system.begin.copy()
        place_starts(system, x, {each: given for each, given in loop.start.items() if places_of(system, each) is not None})
        return Number(name, system.signal_unit(name), kinds.START, float(x[row_of(system, name)]))
    sizes, (head, _, place) = remembered(system), name.rpartition(".")
    if is_remembered(system, name) and sizes.get(name) is None:
        owner = name if name in sizes else head
        whole = np.broadcast_to(loop.start.get(owner, 0.0), count_of(sizes[owner]))
        value = loop.start.get(name, whole[0 if name in sizes else int(place)])
        return Number(name, system.signal_unit(owner), kinds.START, float(value))
    return None


def remembered(system: HybridSystem) -> dict[str, int | None]:
    """Return {name in the memory of a sampled law: number of entries}. The number is None for a scalar."""
    return {name: size for update in system.updates for name, (_, size) in update.places.items()}


def overridden(loop: Loop, name: str) -> str | None:
    """The input that takes the place of a parameter, which is its default and acts nowhere else, as it is given or as a law drives it; None for none."""
    system, plant = loop.system, loop.plant
    if not system.has_parameter(name):
        return None
    defaults = {each: (system, system.inputs[each].default) for each in loop.input_values if each in system.inputs}
    late = any(clock.delay > 0.0 for clock in loop.assembly.clocks)  # a late law leaves the default until its first output
    if plant.has_parameter(name) and not late:
        defaults |= {each: (plant, entry.default) for each, entry in plant.inputs.items() if each not in system.inputs}
    for each, (owner, default) in defaults.items():
        if owner.has_parameter(name) and ca.depends_on(default, owner.p[owner._parameter(name).offset]):
            return None if acts(loop, name) else each
    return None


def _input_value(loop: Loop, name: str) -> float:
    if name in loop.input_values:
        value = loop.input_values[name]
        return value if isinstance(value, float) else float("nan")
    system = loop.system
    return float(np.array(system.input_defaults(system.values)).ravel()[list(system.inputs).index(name)])


def _usual(system: HybridSystem, name: str) -> tuple[float, float] | None:
    entry = system.parameters.get(name) or system.parameters.get(name.rpartition(".")[0])
    return entry.bounds.get("usual") if entry is not None else None  # type: ignore[return-value]


def _usual_default(system: HybridSystem, default: ca.SX) -> tuple[float, float] | None:
    """What is usual for the parameter that an input is where nobody gives it."""
    if not ca.SX(default).is_symbolic():
        return None
    same = (name for name, entry in system.parameters.items() if ca.is_equal(default, system.p[entry.offset], 0))
    return next((_usual(system, name) for name in same), None)


def _bounds(spec: Mapping[str, Any]) -> dict[str, float | None]:
    return {word: spec.get(word) for word in ("at_least", "above", "at_most")}


# ------------------------------------------------------------------------------------------------------------------------------- shapes of inputs
def _shape_numbers(value: Any) -> dict[str, float]:
    """{name of a number of an input's shape, or of a node of its table: its value}."""
    if isinstance(value, (shapes.Table, shapes.Shape)) and value.shape:
        return dict(value.numbers)
    if isinstance(value, shapes.Table):
        rows = (("times", value.times), ("values", value.values))
        return {f"{word}.{i}": float(number) for word, row in rows for i, number in enumerate(row)}
    return {}


# ------------------------------------------------------------------------------------------------------------------------------- fields of a design
def memory_places(system: HybridSystem, name: str) -> slice | None:
    """Where something that a sampled law remembers, or an entry of it, stands among the memory of all laws; None for any other name."""
    (head, _, tail), begin = name.rpartition("."), 0
    for update in system.updates:
        for owner, (first, size) in update.places.items():
            if owner == name:
                return slice(begin + first, begin + first + count_of(size))
            if owner == head and tail.isdigit() and int(tail) < (size or 0):
                return slice(begin + first + int(tail), begin + first + int(tail) + 1)
        begin += update.memory.numel()
    return None


def is_remembered(system: HybridSystem, name: str) -> bool:
    """Return whether a name belongs to the memory of a sampled law, or to an entry of this memory."""
    return memory_places(system, name) is not None


def law_with_numbers(loop: Loop) -> Any:
    """Return the first law of a loop for use in another loop. The fields of the law hold the numbers that `at` changed.

    As declared, where its design leaves these numbers as they are and makes of them what acts in the loop; else as it is designed.
    """
    given = loop.controllers[0]
    law = given.law if isinstance(given, Sampled) else given
    plant = {name: value for name, value in loop.parameters.items() if loop.plant.has_parameter(name)}
    own = {name: value for name, value in loop.parameters.items() if name not in plant}
    paths = {name: name.split(".")[1:] for name in own}
    if not own:
        return given
    system = loop.system
    if all(_declared(law, path) for path in paths.values()):
        written = as_sampled(given, functools.reduce(lambda node, name: with_field(node, paths[name], own[name]), own, law))
        with contextlib.suppress(SceneError, np.linalg.LinAlgError):
            if np.array_equal(loop.replace(controllers=(written, *loop.controllers[1:]), parameters=plant).system.values, system.values):
                return written
    return as_sampled(given, rebuilt(loop.designed_controllers[0], system.values, sum(len(numbers_of(part)) for part in loop.plant.parts)))


def _declared(node: Any, path: list[str]) -> bool:
    """Whether a law declares a number under a path of fields and places."""
    head, *tail = path
    if isinstance(node, tuple):
        return head.isdigit() and int(head) < len(node)
    return any(each.name == head for each in fields_of(type(node))) and (not tail or _declared(getattr(node, head), tail))
