"""Kinds of numbers of a closed loop: how each is put into a loop and into a run, and which verbs can vary it, or why not.

A verb asks the kind (`number.kind.has_slope`, `number.kind.borders`, ...) and never compares its word.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from toolbox.arguments import refuse
from toolbox.errors import SceneError
from toolbox.former_names import FORMER_FIRST_WORDS
from toolbox.modelling import inputs as shapes
from toolbox.modelling.clocks import Clock
from toolbox.modelling.components import numbers_of
from toolbox.modelling.design_fields import controller_word, redesigned
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Controller, Sampled, ZeroOrderHold, check_sampled
from toolbox.modelling.start import row_of

Loop = Any
"""A `ClosedLoop`, which is made of numbers and therefore stands above this file."""


@dataclass(frozen=True)
class NumberKind:
    """One kind of number.

    Attributes
    ----------
    word
        Its name, as tables show it.
    has_slope
        Whether the equations of a loop have a slope by it, so that steady running and cycles are continued in it and runs are differentiated.
    borders
        Whether steady running, or the borders of regimes, depend on it, so that `onset` and `severity_map` vary it.
    poles
        Whether the exact matrix of a sampled loop depends on it, so that poles and Hopf points of a sampled loop follow it.
    of_controller
        Whether it may belong to a controller.
    redesigns
        Whether another value makes another controller, so that it is put before numbers where they act.
    sets_up
        Whether it is one of the numbers that describe the loop, rather than its start or a node of a table.
    why
        Why a verb that needs slopes cannot vary it; empty if it can.
    why_no_sweep
        Why one sweep cannot vary it; empty if it can.
    why_no_tuning
        Why `tune` cannot vary it, although it belongs to the controller.
    meaning
        Meaning of every number of the kind; empty if each has its own.
    bounds
        Bounds of every number of the kind; empty if each has its own.
    """

    is_input: ClassVar[bool] = False
    is_parameter: ClassVar[bool] = False
    is_design: ClassVar[bool] = False
    is_clock: ClassVar[bool] = False
    is_shape: ClassVar[bool] = False
    is_node: ClassVar[bool] = False
    is_start: ClassVar[bool] = False
    is_shift: ClassVar[bool] = False

    word: str
    has_slope: bool = False
    borders: bool = False
    poles: bool = False
    of_controller: bool = False
    redesigns: bool = False
    sets_up: bool = True
    why: str = ""
    why_no_sweep: str = ""
    why_no_tuning: str = ""
    meaning: str = ""
    bounds: Mapping[str, float | None] = field(default_factory=dict, hash=False)

    def __str__(self) -> str:
        return self.word

    def __format__(self, how: str) -> str:
        return format(self.word, how)

    def put(self, loop: Loop, name: str, value: float) -> Loop:
        """The loop with another value of the number of that name."""
        raise NotImplementedError

    def check(self, loop: Loop, name: str, values: Iterable[float]) -> None:
        """Raise SceneError if the loop cannot use a value, although the value is within the bounds of the number."""

    def varied(self, system: HybridSystem, inputs: Mapping[str, Any], name: str, value: float) -> tuple[HybridSystem, dict[str, Any]]:
        """Return a closed system and its inputs with another value. Both are unchanged if the number does not enter the equations."""
        return system, dict(inputs)

    def in_run(self, run: Any, loop: Loop, name: str, value: float) -> dict[str, Any]:
        """The fields of a run that change with the number; loop: the loop with the new value."""
        system, inputs = self.varied(run.system, run.inputs, name, value)
        return {"system": system, "inputs": inputs}


class InputKind(NumberKind):
    """An input that is held constant."""

    is_input = True

    def put(self, loop: Loop, name: str, value: float) -> Loop:
        kept = {each: given for each, given in loop.parameters.items() if each != name}
        return loop.replace(inputs={**loop.inputs, name: value}, parameters=kept)

    def varied(self, system: HybridSystem, inputs: Mapping[str, Any], name: str, value: float) -> tuple[HybridSystem, dict[str, Any]]:
        return system, {**inputs, name: value}

    def in_run(self, run: Any, loop: Loop, name: str, value: float) -> dict[str, Any]:
        return {**super().in_run(run, loop, name, value), "kinds": tuple(sorted({**dict(run.kinds), name: "number"}.items()))}


class ParameterKind(NumberKind):
    """A number of a part, a controller or its sensors, in the place that the equations read."""

    is_parameter = True

    def put(self, loop: Loop, name: str, value: float) -> Loop:
        kept = {each: given for each, given in loop.inputs.items() if each != name}
        return loop.replace(parameters={**loop.parameters, name: value}, inputs=kept)

    def varied(self, system: HybridSystem, inputs: Mapping[str, Any], name: str, value: float) -> tuple[HybridSystem, dict[str, Any]]:
        if not self.has_slope and not system.has_parameter(name):  # the continuous form of a loop has no sensors
            return system, dict(inputs)
        return system.with_parameters({name: value}), dict(inputs)

    def in_run(self, run: Any, loop: Loop, name: str, value: float) -> dict[str, Any]:
        own = run.plant.has_parameter(name)
        return {**super().in_run(run, loop, name, value), **({"plant": run.plant.with_parameters({name: value})} if own else {})}


class DesignKind(NumberKind):
    """A field of a controller that only its design knows."""

    is_design = True

    def put(self, loop: Loop, name: str, value: float) -> Loop:
        return redesigned(loop, name, value)


class ShapeKind(NumberKind):
    """A number of the shape that an input has."""

    is_shape = True

    def put(self, loop: Loop, name: str, value: float) -> Loop:
        head, _ = in_input(name, loop.input_values)
        return loop.replace(inputs={**loop.inputs, head: self.varied(loop.system, loop.input_values, name, value)[1][head]})

    def varied(self, system: HybridSystem, inputs: Mapping[str, Any], name: str, value: float) -> tuple[HybridSystem, dict[str, Any]]:
        head, key = in_input(name, inputs)
        return system, {**inputs, head: reshaped(inputs[head], key, value)}


class NodeKind(ShapeKind):
    """A time or a value of the table that an input has."""

    is_shape = False
    is_node = True


@dataclass(frozen=True)
class ClockKind(NumberKind):
    """A number of the clock of a controller.

    Attributes
    ----------
    last_word
        Last word of its name.
    unit
        Its unit.
    attribute
        Its field of `Sampled` and of `Clock`.
    """

    is_clock = True

    last_word: str = "sample_time"
    unit: str = "s"
    attribute: str = "period"

    @property
    def column(self) -> int:
        """Column of the number in an array of clocks."""
        return Clock._fields.index(self.attribute)

    @property
    def enters_update(self) -> bool:
        """Whether it is a parameter of the update of a controller, too, as the sample time is."""
        return self.attribute == "period"

    def put(self, loop: Loop, name: str, value: float) -> Loop:
        index = sampled_owner(loop, name)
        changed = dataclasses.replace(loop.controllers[index], **{self.attribute: value})
        return loop.with_controllers((*loop.controllers[:index], changed, *loop.controllers[index + 1 :]))

    def check(self, loop: Loop, name: str, values: Iterable[float]) -> None:
        """Raise SceneError if the controller cannot use a value."""
        index = sampled_owner(loop, name)
        law, dt = loop.designed_controllers[index], getattr(loop.designed_controllers[index], "dt", None)
        for value in values:
            refuse(f"Argument `{name}`", value, self.unit, self.bounds)
            dataclasses.replace(loop.controllers[index], **{self.attribute: value}).check()
            if self.enters_update and dt is not None and abs(value - dt) > 1e-9 * dt:
                raise SceneError(f"Argument `{name}` must be {dt:g} s, for which the controller was designed, but it is {value:g} s.")
            if self.enters_update and isinstance(law, Controller):
                check_sampled(law, float(value))

    def in_run(self, run: Any, loop: Loop, name: str, value: float) -> dict[str, Any]:
        clocks = [law.clock for law in loop.controllers if isinstance(law, Sampled)]
        system, path = run.system, clock_path(loop, sampled_owner(loop, name))
        if self.enters_update and path is not None:
            system = system.with_parameters({path: value})
        return {"system": system, "clocks": clocks, "start": run.start.on_clocks(clocks)}


class StartKind(NumberKind):
    """Start value of a state, or of an entry of the memory of a sampled controller."""

    is_start = True

    def put(self, loop: Loop, name: str, value: float) -> Loop:
        row = row_of(loop.system, name)  # other names of the same state give way
        kept = {each: given for each, given in loop.start.items() if row is None or row_of(loop.system, each) != row}
        return loop.replace(start={**kept, name: value})


class ShiftKind(NumberKind):
    """How much later a channel of a recording was written than it was; of a fit alone."""

    is_shift = True


INPUT = InputKind("input", has_slope=True, borders=True, poles=True)
PARAMETER = ParameterKind("parameter", has_slope=True, borders=True, poles=True, of_controller=True)
DESIGN = DesignKind(
    "design", of_controller=True, redesigns=True,
    why="only the design of a controller uses it, so the equations of the loop have no derivative by it: vary a gain that the design gives",
)  # fmt: skip
SHAPE = ShapeKind("shape", why="it shapes an input in time, and steady running has constant inputs")
NODE = NodeKind(
    "node", sets_up=False, why="it is a number of a table in time, by which no derivative is computed: use `loop.at(name, value)` for each value",
    why_no_sweep="is a table, which is the same in all runs; simulate `loop.at(name, value)` for each value",
)  # fmt: skip
HARDWARE = "it belongs to the hardware of the controller, and a search would end at a bound of its range"
"""Why `tune` does not vary clocks and sensors."""

SAMPLE_TIME = ClockKind(
    "sample time", borders=True, poles=True, of_controller=True, redesigns=True, why_no_tuning=HARDWARE, meaning="sample time", bounds={"above": 0.0},
    why="it is a sample time, by which a run has no derivative, because a new value moves all samples: use `loop.at(name, value)` for each value",
)  # fmt: skip
DELAY = ClockKind(
    "delay", last_word="delay", attribute="delay", borders=True, poles=True, of_controller=True, redesigns=True, why_no_tuning=HARDWARE,
    meaning="time from a sample until its outputs take effect", bounds={"at_least": 0.0},
    why="it is a delay, by which a run has no derivative, because a new value moves all outputs in time: use `loop.at(name, value)` for each value",
)  # fmt: skip
JITTER = ClockKind(
    "jitter", last_word="jitter", attribute="jitter", of_controller=True, redesigns=True, why_no_tuning=HARDWARE,
    meaning="largest lateness of a sample", bounds={"at_least": 0.0},
    why="it is jitter, with which a loop has no poles and a run has no derivatives: vary it with `sweep`",
)  # fmt: skip
MISSED = ClockKind(
    "missed samples", last_word="missed_samples", unit="1", attribute="missed_samples", of_controller=True, redesigns=True,
    why_no_tuning=HARDWARE, meaning="probability that a sample is missed", bounds={"at_least": 0.0, "below": 1.0},
    why="it is a probability of missed samples, with which a loop has no poles and a run has no derivatives: vary it with `sweep`",
)  # fmt: skip
NOISE = ParameterKind(
    "noise", borders=True, of_controller=True, why_no_tuning=HARDWARE,
    why="it is the noise of a sensor, which has no influence on smooth running and cycles, because they are computed without noise: vary it with `sweep`",
)  # fmt: skip
RESOLUTION = ParameterKind(
    "resolution", borders=True, of_controller=True, why_no_tuning=HARDWARE,
    why="it is the step of an encoder, by which the equations of the loop have no derivative, because the measured value jumps",
)  # fmt: skip
START = StartKind(
    "start", sets_up=False, why="it is a start value, which has no influence on steady running and cycles: vary it with `sweep`"
)
SHIFT = ShiftKind("shift", why="it is the time shift of a recorded channel, which only `fit` can estimate")

SENSOR_KINDS = {"noise": NOISE, "resolution": RESOLUTION}
"""{last field of a parameter of `Sensors`: its kind}."""


def in_input(name: str, inputs: Iterable[str]) -> tuple[str, str]:
    """(input, name of the number in its shape or table), for the number of a shape."""
    head = max((each for each in inputs if name.startswith(f"{each}.")), key=len)
    return head, name[len(head) + 1 :]


def reshaped(value: Any, key: str, number: float) -> Any:
    """An input with one number of its shape changed."""
    if value.shape:
        return getattr(shapes, value.shape)(**{**value.numbers, key: number})
    word, _, place = key.partition(".")
    rows = {"times": value.times.copy(), "values": value.values.copy()}
    rows[word][int(place)] = number
    return shapes.Table.of(key, rows["times"], rows["values"])


# ------------------------------------------------------------------------------------------------------------------- clocks of sampled controllers
CLOCK_KINDS = {kind.last_word: kind for kind in (SAMPLE_TIME, DELAY, JITTER, MISSED)}
"""{last word of a name: kind}."""


def clock_path(loop: Loop, index: int) -> str | None:
    """The parameter of the closed system that is the sample time of a controller; None for one in Python, which has none."""
    parts, first = loop.system.parts, len(loop.system.parts) - len(loop.controllers)
    if not isinstance(parts[first + index], ZeroOrderHold):
        return None
    last = sum(len(numbers_of(part)) for part in parts[: first + index + 1]) - 1
    return next(name for name, entry in loop.system.parameters.items() if entry.offset == last)


def clock_prefixes(loop: Loop) -> dict[str, int]:
    """{first word of the names of the sample time and delay of a sampled controller: its place among the controllers of the loop}."""
    known = loop.__dict__.get("clock_prefixes")
    if known is None:
        known = {}
        for index, law in enumerate(loop.controllers):
            if isinstance(law, Sampled):
                known.setdefault(controller_word(loop, index), index)
        loop.__dict__["clock_prefixes"] = known
    return known


def sampled_owner(loop: Loop, name: str) -> int:
    """The place of the controller whose sample time or delay a name is."""
    return clock_prefixes(loop)[name.rpartition(".")[0]]


def clock_value(loop: Loop, name: str) -> tuple[ClockKind, float] | None:
    """(kind, value) of the number of a clock of that name; None for any other name."""
    head, _, word = name.rpartition(".")
    if word not in CLOCK_KINDS or head not in (prefixes := clock_prefixes(loop)):
        return None
    kind = CLOCK_KINDS[word]
    return kind, float(getattr(loop.controllers[prefixes[head]], kind.attribute))


def former_name(loop: Loop, name: str) -> str | None:
    """The name now of a number that had another name; None for a name that never was one.

    Numbers of one controller began with several words: its class, the class of the controller that its design made, and the words of its memory.
    """
    if not loop.controllers or name in (known := loop.variable_numbers()):
        return None
    head, _, rest = name.partition(".")
    rest = "sample_time" if rest == "period" else rest
    for index in range(len(loop.controllers)):
        word = controller_word(loop, index)
        if head in _former_words(loop, index) | {word}:
            now = next((each for each in (f"{word}.{rest}", f"{word}.{head}.{rest}", f"{word}.law.{rest}") if each in known), None)
            if now is not None:
                return now
    return None


def _former_words(loop: Loop, index: int) -> set[str]:
    """First words that names of numbers of a controller had."""
    given, words = loop.controllers[index], set(FORMER_FIRST_WORDS)
    laws = [given.law if isinstance(given, Sampled) else given, loop.designed_controllers[index]]
    for law in laws:
        if isinstance(law, Controller):
            words |= {kind.__name__.lower() for kind in type(law).__mro__}
            laws += [getattr(law, each.name) for each in dataclasses.fields(law)]
    return words


def noise_or_resolution(name: str) -> NumberKind:
    """The kind of a parameter by its name: noise and resolution of sensors are kinds of their own."""
    head, _, _ = name.partition(".sensors.")
    word = name[len(head) + len(".sensors.") :].partition(".")[0]
    return SENSOR_KINDS.get(word, PARAMETER)
