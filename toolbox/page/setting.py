"""What one looks at: a law, changed numbers, and perhaps a disturbance, as a closed loop, a scene, or lines of Python."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.errors import SceneError
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.inputs import Shape, Table
from toolbox.modelling.numbers import law_with_numbers
from toolbox.scenes.cases import Case, Waveform
from toolbox.scenes.scene import Scene
from toolbox.simulation.request import accuracy_of

LONGEST = 100
"""Characters of a name or a value that the page may send."""

MOST = 1000
"""Numbers that may be changed at once."""

HARDER = 1.5
"""By how much a disturbance raises what it changes."""

LASTING = 2.0
"""How long a disturbance lasts at most [s]."""

KINDS = ("", "rock", "bump")


@dataclass(frozen=True)
class Setting:
    """A law by its label, {number: value in SI, or text with a unit}, and the kind of the disturbance: "rock", "bump", or none."""

    label: str
    changes: Mapping[str, float | str] = field(default_factory=dict)
    disturbance: str = ""

    @staticmethod
    def of(told: Any, labels: Mapping[str, Any]) -> Setting:
        """The setting that a page sends. Raises SceneError for anything else."""
        if not isinstance(told, dict):
            raise SceneError("A setting must be an object, but it is none.")
        label, changes, disturbance = told.get("label"), told.get("changes", {}), told.get("disturbance", "")
        if not isinstance(label, str) or label not in labels:
            raise SceneError("A setting must name one of the laws that there are.")
        if not isinstance(changes, dict) or len(changes) > MOST:
            raise SceneError(f"Argument `changes` must be an object of at most {MOST} numbers.")
        for name, value in changes.items():
            sound = isinstance(value, str) or (isinstance(value, (int, float)) and not isinstance(value, bool))
            if not sound or len(name) > LONGEST or len(str(value)) > LONGEST:
                raise SceneError("Argument `changes` must map names to numbers, or to text with a unit.")
        if disturbance not in KINDS:
            raise SceneError("Argument `disturbance` must be `rock`, `bump` or empty.")
        return Setting(label, changes, disturbance)

    @property
    def key(self) -> str:
        """What tells it from other settings."""
        return json.dumps([self.label, sorted(self.changes.items()), self.disturbance])

    def loop(self, base: ClosedLoop, redone: Mapping[str, bool] | None = None) -> tuple[ClosedLoop, list[str]]:
        """The loop, and the names of changed numbers that the law does not have. Raises SceneError for values out of bounds.

        redone: {number of the loop: whether it makes another controller}, where that is known.
        """
        known = {name: number.kind.redesigns for name, number in base.variable_numbers().items()} if redone is None else redone
        loop, without = base, []
        for name in sorted(self.changes, key=lambda name: not known.get(name)):  # before what acts in a controller is changed
            if name in known:
                loop = loop.at(name, self.changes[name])
            else:
                without.append(name)
        return (disturbed(loop, self.disturbance) if self.disturbance else loop), without


def disturbed(loop: ClosedLoop, kind: str) -> ClosedLoop:
    """Return the loop with some numbers raised by half for a moment. SceneError is raised if the loop has no number of this kind."""
    begin, end = moment(loop)
    inputs, parameters = dict(loop.inputs), dict(loop.parameters)
    for name in disturbing(loop, kind):
        value = loop.number(name).value
        inputs[name] = ((0.0, begin, begin, end, end), (value, value, HARDER * value, HARDER * value, value))
        parameters.pop(name, None)
    return loop.replace(inputs=inputs, parameters=parameters)


def moment(loop: ClosedLoop) -> tuple[float, float]:
    """When a disturbance begins and ends [s]."""
    assert loop.duration is not None and loop.after is not None
    return loop.after, loop.after + min(LASTING, (loop.duration - loop.after) / 4)


def disturbing(loop: ClosedLoop, kind: str) -> list[str]:
    """Return the names of the numbers that a disturbance changes: the friction of the judged contact, or the load. SceneError is raised if
    there are none."""
    found = []
    if kind == "rock" and loop.element is not None:
        found = [f"{loop.element}.friction.{word}" for word in ("static", "kinetic")]
        found = [name for name in found if loop.plant.has_parameter(name) and loop.number(name).overridden is None]
    elif kind == "bump":
        numbers = loop.variable_numbers()
        free = [name for name, each in numbers.items() if each.is_input and np.isfinite(each.value) and each.value != 0.0]
        for units in (("N m",), ("N",)):
            found = found or [name for name in free if numbers[name].unit in units][:1]
    if not found:
        what = "the judged contact has no coefficients of friction" if kind == "rock" else "no torque and no load is an input of this loop"
        raise SceneError(f"There is nothing to disturb: {what}.")
    return found


def scene_of(setting: Setting, loop: ClosedLoop, scene: Scene | None) -> Scene:
    """Return the scene of a law with its changed numbers. SceneError is raised for a law in Python, and for a loop with several laws."""
    if len(loop.controllers) > 1:
        raise SceneError(f"A scene has one law in each case, but this loop has {len(loop.controllers)}.")
    own = {name: value for name, value in loop.parameters.items() if loop.plant.has_parameter(name)}
    case = Case.of(setting.label or "no controller", law_with_numbers(loop) if loop.controllers else None)
    inputs = {name: _data(name, value) for name, value in loop.input_values.items()}
    reference = None if loop.signal is None else loop.target(loop.signal)
    if scene is not None:
        found = dataclasses.replace(scene, cases=(case,), inputs=inputs, parameters=own, start=dict(loop.start), reference=reference)
        found.check()
        return found
    assert loop.duration is not None
    return Scene.of(
        loop.plant, loop.duration, {case.label: case.controller}, title=loop.title, element=loop.element, signal=loop.signal, effort=loop.effort,
        after=loop.after, reference=reference, inputs=inputs, parameters=own, start=dict(loop.start), accuracy=accuracy_of(loop),
    )  # fmt: skip


def _data(name: str, value: Any) -> float | Waveform:
    """An input as a scene holds it."""
    if isinstance(value, (Table, Shape)) and value.shape:
        return Waveform(value.shape, dict(value.numbers))
    if isinstance(value, Table):
        return Waveform("table", {"times": tuple(value.times.tolist()), "values": tuple(value.values.tolist())})
    if not isinstance(value, float):
        raise SceneError(
            f"Argument `{name}` must be a number, a table or a shape to be written into a scene, but it is an expression of time."
        )
    return value


def python_of(setting: Setting, base: ClosedLoop, path: str | None) -> str:
    """Lines of Python that run the same setting; path: the file of the scene, None for a loop that the reader has."""
    loop, without = dataclasses.replace(setting, disturbance="").loop(base)
    struck = disturbing(loop, setting.disturbance) if setting.disturbance else []
    names = ["closed_loop", "simulate"] if struck else ["simulate"]
    lines = [f"from toolbox import {', '.join(['Scene', *names] if path else names)}", ""]
    lines.append(f"loop = Scene.load({path!r})[{setting.label!r}]" if path else "# loop: the one that was given to `explore`")
    known = base.variable_numbers()
    changed = [name for name in setting.changes if name not in (*without, *struck)]
    for name in sorted(changed, key=lambda name: not known[name].kind.redesigns):
        lines.append(f"loop = loop.at({name!r}, {setting.changes[name]!r})")
    if struck:
        begin, end = moment(loop)
        times = (0.0, begin, begin, end, end)
        entries = []
        for name in struck:
            value = loop.number(name).value
            entries.append(f"{name!r}: ({times}, {(value, value, HARDER * value, HARDER * value, value)})")
        lines.append(f"loop = closed_loop(loop, inputs={{{', '.join(entries)}}})")
    duration = "" if path else f", {loop.duration!r}"
    return "\n".join([*lines, f"run = simulate(loop{duration})", "print(run)", "run.plot()", ""])
