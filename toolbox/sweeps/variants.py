"""Builds the runs of a sweep: one shared `Run`, and per run its parameter values, its start state and the digest by which a store recognises the sweep."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from toolbox.arguments import mapping
from toolbox.errors import SceneError
from toolbox.measuring.measures import Measure
from toolbox.modelling.components import Component, checked, fields_of, is_nested, numbers_of, rebuilt, structure_of
from toolbox.modelling.elements import FrictionLaw
from toolbox.modelling.free_parameter import FreeParameter
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.inputs import Table
from toolbox.modelling.laws import Held
from toolbox.modelling.start import place_starts
from toolbox.simulation.request import Request
from toolbox.simulation.run import Run
from toolbox.simulation.run_state import held_defaults
from toolbox.sweeps.batch import Numbers, Task, numbers_of_run, slots
from toolbox.sweeps.designs import Variations


def shared_run(plant: HybridSystem, variations: Variations, duration: float, **arguments: Any) -> Run:
    """The run that all variations share, with what is varied as inputs given as numbers. Raises SceneError as `simulate` does."""
    arguments["inputs"] = {name: v for name, v in mapping("inputs", arguments.get("inputs")).items() if name not in variations.names}
    arguments["parameters"] = {
        name: v for name, v in mapping("parameters", arguments.get("parameters")).items() if name not in variations.names
    }
    if len(set(variations.names)) < len(variations.names):
        raise SceneError("Argument `vary` must name every number once.")
    closed = Request(plant, duration, **arguments).checked().system
    free_parameters = [FreeParameter.of(closed, name) for name in variations.names]
    middle = variations.points[len(variations.points) // 2].tolist()
    arguments["inputs"] |= {free.name: value for free, value in zip(free_parameters, middle, strict=True) if free.is_input}
    return Request(plant, duration, **arguments).checked()


def varied_numbers(run: Run, variations: Variations) -> tuple[Numbers, dict[int, str]]:
    """The numbers of every run, in the layout of a `Task`, and {run: why its numbers contradict each other}.

    Raises SceneError for a value out of its bounds, and for the sample time of a law.
    """
    system = run.system
    offset, touched = 0, []
    places = slots(run, variations.names)
    free_parameters = [FreeParameter.of(system, name) for name in variations.names]
    for part in system.parts:
        size = len(numbers_of(part))
        own = [k for k, place in zip(free_parameters, places, strict=True) if not k.is_input and offset <= place < offset + size]
        if isinstance(part, Held) and any(
            place == offset + size - 1 for k, place in zip(free_parameters, places, strict=True) if not k.is_input
        ):
            raise SceneError(f"Argument `{own[-1].name}` must not be varied: a sample time is structure; make one sweep for each.")
        if own and _has_check(part):
            touched.append((part, offset))
        offset += size
    for k, (free, column) in enumerate(zip(free_parameters, variations.points.T, strict=True)):
        entry = system.parameters.get(free.name) if free.is_input else system._parameter(free.name)
        if entry is not None:
            entry.check(np.unique(variations.axes[k] if variations.axes else column))
    numbers = Numbers(numbers_of_run(run), places, variations.points)
    broken: dict[int, str] = {}
    for part, first in touched:
        own_columns = [j for j, place in enumerate(places) if first <= place < first + len(numbers_of(part))]
        rows, which = np.unique(variations.points[:, own_columns], axis=0, return_inverse=True)
        row = numbers.same.copy()
        for k, values in enumerate(rows):
            row[[places[j] for j in own_columns]] = values
            try:
                checked(rebuilt(part, row, first))
            except SceneError as error:
                for i in np.flatnonzero(which.ravel() == k).tolist():
                    broken.setdefault(i, str(error))
    return numbers, broken


def start_states(run: Run, variations: Variations, begin: Callable[[Mapping[str, float]], Mapping[str, Any]]) -> np.ndarray:
    """Start states of every run, shape (runs, states), from a function of what is varied."""
    starts = np.zeros((len(variations.points), run.system.x.numel()))
    for x, point in zip(starts, variations.points.tolist(), strict=True):
        place_starts(run.system, x, begin(dict(zip(variations.names, point, strict=True))))
    return starts


def _has_check(part: Any) -> bool:
    """Whether the fields of a part, or of its laws, can contradict each other."""
    if isinstance(part, Component) and type(part).check is not Component.check:
        return True
    if isinstance(part, FrictionLaw) and type(part).check is not FrictionLaw.check:
        return True
    return any(is_nested(value) and _has_check(value) for value in (getattr(part, f.name) for f in fields_of(type(part))))


def varied_held(run: Run, variations: Variations) -> np.ndarray | None:
    """What the signals of late laws have until the first output arrives, where it varies; else None."""
    plant = run.plant
    names = [name for name in variations.names if name not in run.system.inputs and _owned(plant, name)]
    if not names or run.start.carried or not any(delay > 0 for _, delay in run.clocks):
        return None
    values = np.repeat(plant.values[:, None], len(variations.points), axis=1)
    for name, column in zip(variations.names, variations.points.T, strict=True):
        if name in names:
            values[plant._parameter(name).offset] = column
    return held_defaults(run.system, plant, run.clocks, values)


def _owned(plant: HybridSystem, name: str) -> bool:
    try:
        plant._parameter(name)
    except SceneError:
        return False
    return True


def run_fingerprint(task: Task, variations: Variations, names: Sequence[str]) -> dict[str, str]:
    """What a sweep is made of, argument by argument, as digests; functions by their names, because their text cannot be compared."""
    run = task.run
    measures = [measure if isinstance(measure, Measure) else _name(measure) for measure in task.measures]
    arrays = [array for array in (task.starts, task.memories, task.held) if array is not None]
    content = {
        "machine": [_plain(structure_of(part)) for part in run.system.parts] + [run.system.values.tolist()],
        "controller": [_name(law) for law in run.laws] + [run.clocks, run.seeds],
        "vary": [variations.names, variations.shape, hashlib.sha256(variations.points.tobytes()).hexdigest()],
        "inputs": [(k, _number(v)) for k, v in sorted(run.inputs.items()) if k not in variations.names],
        "start": [
            str([(word, np.asarray(array).tolist()) for word in BEGIN for array in _arrays(getattr(run.start, word))]),
            *(hashlib.sha256(a.tobytes()).hexdigest() for a in arrays),
        ],
        "measures": [str(list(zip(names, measures, strict=True)))],
        "duration": [run.duration],
        "accuracy": [run.accuracy],
        "method": [str(run.method)],
        "budget": [run.budget],
    }
    return {word: hashlib.sha256(repr(value).encode()).hexdigest()[:16] for word, value in content.items()}


BEGIN = ("time", "states", "memory", "held", "taken", "applied", "waiting")
"""What of the state in which the runs begin tells one sweep from another."""


def _arrays(value: Any) -> tuple[Any, ...]:
    return value if isinstance(value, tuple) else (value,)


def _number(value: Any) -> Any:
    """An input as text that tells it from every other."""
    return ("table", value.times.tolist(), value.values.tolist()) if isinstance(value, Table) else str(value)


def _name(thing: Any) -> str:
    kind = thing if hasattr(thing, "__qualname__") else type(thing)
    return f"{kind.__module__}.{kind.__qualname__}"


def _plain(key: Any) -> Any:
    """A structure with its classes by name, equal in every process."""
    if isinstance(key, tuple):
        return tuple(map(_plain, key))
    return _name(key) if isinstance(key, type) else key if isinstance(key, (str, int, float, bool, type(None))) else _name(key)
