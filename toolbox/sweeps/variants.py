"""Builds the runs of a sweep: one shared `Run`, and per run its parameter values, its start state and the digest by which a store recognises the sweep."""

from __future__ import annotations

import copy
import functools
import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import count_of, within
from toolbox.errors import SceneError
from toolbox.modelling.clocks import Clock
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.components import Component, Slot, checked, fields_of, is_nested, numbers_of, rebuilt, structure_of, symbolic_copy
from toolbox.modelling.design_fields import designed_law
from toolbox.modelling.elements import FrictionLaw
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.input_kinds import extremes
from toolbox.modelling.inputs import Table
from toolbox.modelling.laws import Controller, Sampled
from toolbox.modelling.number_kinds import ClockKind, clock_path, sampled_owner
from toolbox.modelling.numbers import Number, is_remembered
from toolbox.modelling.opposing import driving_of
from toolbox.modelling.start import place_starts
from toolbox.modelling.well_posed import check_rings, has_rings
from toolbox.simulation.request import Request
from toolbox.simulation.run import Run
from toolbox.simulation.run_state import held_defaults
from toolbox.sweeps.batch import Numbers, Task, numbers_of_run, slots
from toolbox.sweeps.designs import Variations


def shared_run(loop: ClosedLoop, variations: Variations, duration: float, **arguments: Any) -> Run:
    """Return the run shared by all variations, with varied inputs as numbers. SceneError is raised as by `simulate`."""
    if len(set(variations.names)) < len(variations.names):
        raise SceneError("Argument `ranges` must name every number once.")
    kept = [{name: v for name, v in given.items() if name not in variations.names} for given in (loop.inputs, loop.parameters)]
    loop = loop.replace(inputs=kept[0], parameters=kept[1])
    middle = variations.points[len(variations.points) // 2].tolist()
    numbers = [loop.number(name) for name in variations.names]
    return Request(
        loop.replace(inputs={**loop.inputs, **{each.name: v for each, v in zip(numbers, middle, strict=True) if each.is_input}}),
        duration,
        **arguments,
    ).checked()


def varied_numbers(run: Run, variations: Variations) -> tuple[Numbers, dict[int, str]]:
    """The numbers of every run but its start values, in the layout of a `Task`, and {run: why its numbers contradict each other}.

    Raises SceneError for a value out of its bounds, and for the nodes of a table.
    """
    loop, system = run.loop, run.system
    numbers = [loop.varied_number(name) for name in variations.names]
    for k, (number, column) in enumerate(zip(numbers, variations.points.T, strict=True)):
        _check_values(loop, number, np.unique(variations.axes[k] if variations.axes else column))
    acting = [k for k, number in enumerate(numbers) if not (number.is_design or number.is_start or number.is_clock)]
    places, points = slots(run, [numbers[k] for k in acting]), variations.points[:, acting]
    offset, touched = 0, []
    for part in system.parts:
        size = len(numbers_of(part))
        own = [k for k, place in zip(acting, places, strict=True) if offset <= place < offset + size]
        if own and _has_check(part):
            touched.append((part, offset))
        offset += size
    for k, number in enumerate(numbers):  # the sample time enters the update of a controller, too
        path = (
            clock_path(loop, sampled_owner(loop, number.name)) if isinstance(number.kind, ClockKind) and number.kind.enters_update else None
        )
        if path is not None:
            places, points = [*places, system._parameter(path).offset], np.column_stack([points, variations.points[:, k]])
    broken: dict[int, str] = {}
    gains, gained = _designs(loop, numbers, variations.points, broken)
    left = [j for j, place in enumerate(gains) if place not in places]  # a gain that is varied itself stays as it is given
    places, points = [*places, *(gains[j] for j in left)], np.hstack([points, gained[:, left]])
    found = Numbers(numbers_of_run(run), places, points)
    for part, first in touched:
        columns = [j for j, place in enumerate(places) if first <= place < first + len(numbers_of(part))]
        for i, words in _contradictions(part, found.same.copy(), first, [places[j] for j in columns], points[:, columns]):
            broken.setdefault(i, words)
    for i, words in _unfit(loop.assembly.plant, found.same, places, points):
        broken.setdefault(i, words)
    return found, broken


def _unfit(plant: HybridSystem, same: np.ndarray, places: Sequence[int], points: np.ndarray) -> Iterator[tuple[int, str]]:
    """(run, why) where numbers of a plant whose frictions form a ring are none with which it can be followed."""
    size = plant.values.size
    columns = [j for j, place in enumerate(places) if place < size]
    if not columns or not has_rings(plant):
        return
    rows, which = np.unique(points[:, columns], axis=0, return_inverse=True)
    for k, row in enumerate(rows):
        other = copy.copy(plant)
        other.values = same[:size].copy()
        other.values[[places[j] for j in columns]] = row
        try:
            check_rings(other)
        except SceneError as error:
            for i in np.flatnonzero(which.ravel() == k).tolist():
                yield i, str(error)


def _contradictions(part: Any, row: np.ndarray, first: int, places: Sequence[int], points: np.ndarray) -> Iterator[tuple[int, str]]:
    """(run, why) where numbers of a part, other ones at some places in each run, contradict each other. row: all numbers, which is written over."""
    rows, which = np.unique(points, axis=0, return_inverse=True)
    passes, drives = passing(part, row, first, places), driving(part, row, first, places)(rows)
    for k, values in enumerate(rows):
        if not drives[k] and passes(values.tolist()):
            continue
        row[list(places)] = values
        try:
            checked(rebuilt(part, row, first))
        except SceneError as error:
            for i in np.flatnonzero(which.ravel() == k).tolist():
                yield i, str(error)


def _check_values(loop: ClosedLoop, number: Number, values: np.ndarray) -> None:
    """Raise SceneError where a number must not have one of the values, or cannot be varied within one sweep."""
    if number.is_input or number.is_parameter:
        entry = loop.system.parameters.get(number.name) if number.is_input else loop.system._parameter(number.name)
        if entry is not None:
            entry.check(values)
    elif number.kind.why_no_sweep:
        name, _ = number.in_input(loop.input_values)
        raise SceneError(f"Argument `{number.name}` must not be varied in a sweep: `{name}` {number.kind.why_no_sweep}.")
    elif number.is_shape:
        name, _ = number.in_input(loop.input_values)
        for value in values.tolist():
            shape = number.put(loop, value).inputs[name]
            if name in loop.system.parameters:
                loop.system.parameters[name].check(np.array(extremes(shape)))
    elif number.is_clock:
        number.kind.check(loop, number.name, values)
    elif number.is_design:
        for value in values.tolist():
            number.check(value)


def _designs(loop: ClosedLoop, numbers: Sequence[Number], points: np.ndarray, broken: dict[int, str]) -> tuple[list[int], np.ndarray]:
    """(places, numbers there, shape (runs, places)) of the laws designed anew for every distinct combination of what only their design knows.

    What cannot be designed is noted in `broken`. Raises SceneError where a design gives a law of another structure.
    """
    places: list[int] = []
    columns = [np.zeros((len(points), 0))]
    structure = [structure_of(part) for part in loop.system.parts]
    found = {k: designed_law(loop, number.name) for k, number in enumerate(numbers) if number.is_design}
    of = {k: index for k, index in found.items() if index is not None}
    for law in dict.fromkeys(of.values()):
        own = [k for k, index in of.items() if index == law]
        if not isinstance(loop.designed_controllers[law], Controller):
            raise SceneError(
                f"Argument `{numbers[own[0]].name}` must not be varied in a sweep: the design of this controller is a Python "
                "callable, which is the same in all runs; simulate `loop.at(name, value)` for each value."
            )
        rows, which = np.unique(points[:, own], axis=0, return_inverse=True)
        gains = np.tile(loop.system.values, (len(rows), 1))
        for i, row in enumerate(rows.tolist()):
            try:
                system = functools.reduce(lambda made, k: made.at(numbers[own[k]].name, row[k]), range(len(own)), loop).system
            except SceneError as error:
                broken |= {j: str(error) for j in np.flatnonzero(which.ravel() == i).tolist()}
                continue
            if [structure_of(part) for part in system.parts] != structure:
                raise SceneError(
                    f"Argument `{numbers[own[0]].name}` must not be varied in a sweep: it changes the structure of the law that is designed."
                )
            gains[i] = system.values
        changed = np.flatnonzero((gains != loop.system.values).any(axis=0)).tolist()
        places += changed
        columns.append(gains[which.ravel()][:, changed])
    return places, np.hstack(columns)


def start_states(run: Run, variations: Variations, begin: Callable[[Mapping[str, float]], Mapping[str, Any]] | None) -> np.ndarray | None:
    """Return the start states of every run, shape (runs, states), from a function of the varied numbers and from varied start values. None
    if all runs start alike."""
    own = _started(run, variations, in_laws=False)
    if begin is None and not own:
        return None
    starts = np.tile(run.start.states, (len(variations.points), 1))
    if begin is not None:
        for x, point in zip(starts, variations.points.tolist(), strict=True):
            given = begin(dict(zip(variations.names, point, strict=True)))
            place_starts(run.system, x, {name: value for name, value in given.items() if not _is_kept(run, name)})
    columns = dict(zip(variations.names, variations.points.T[:, None], strict=True))
    place_starts(run.system, starts.T, {name: columns[name] for name in own})
    return starts


def _is_kept(run: Run, name: str) -> bool:
    """Whether a start value is one that a sampled controller remembers, or a signal that it holds."""
    return is_remembered(run.system, name) or any(name in update.names for update in run.system.updates)


def with_kept(
    run: Run,
    variations: Variations,
    begin: Callable[[Mapping[str, float]], Mapping[str, Any]] | None,
    memories: np.ndarray | None,
    held: np.ndarray | None,
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return the memories and held signals of every run, after a function of the varied numbers has set some of them."""
    if begin is None:
        return memories, held
    rows = [begin(dict(zip(variations.names, point, strict=True))) for point in variations.points.tolist()]
    kept = [{name: value for name, value in row.items() if _is_kept(run, name)} for row in rows]
    if not any(kept):
        return memories, held
    memories = np.tile(run.start.memory, (len(rows), 1)) if memories is None else memories
    held = np.tile(run.start.held, (len(rows), 1)) if held is None else held
    states = [replace(run.start, memory=m, held=h).with_values(row) for m, h, row in zip(memories, held, kept, strict=True)]
    return np.array([each.memory for each in states]), np.array([each.held for each in states])


def start_memories(run: Run, variations: Variations) -> np.ndarray | None:
    """Return the memory of the sampled laws at the start of every run, shape (runs, memory). None if all runs start alike."""
    own = _started(run, variations, in_laws=True)
    if not own:
        return None
    rows = ({name: row[variations.names.index(name)] for name in own} for row in variations.points.tolist())
    return np.array([run.start.with_values(row).memory for row in rows])


def _started(run: Run, variations: Variations, in_laws: bool) -> list[str]:
    """Names of the start values that vary: of what sampled laws remember, or of the others."""
    return [name for name in variations.names if run.loop.number(name).is_start and is_remembered(run.system, name) == in_laws]


def _has_check(part: Any) -> bool:
    """Whether the fields of a part, or of its laws, can contradict each other; of friction laws they always can, as they must oppose slip."""
    if isinstance(part, FrictionLaw) or (isinstance(part, Component) and type(part).check is not Component.check):
        return True
    return any(is_nested(value) and _has_check(value) for value in (getattr(part, f.name) for f in fields_of(type(part))))


def driving(part: Any, row: np.ndarray, first: int, places: Sequence[int]) -> Callable[[np.ndarray], np.ndarray]:
    """A function that says of rows of numbers at some places, shape (n, k), whether the friction of a law in a part is below zero at some speed, shape (n,).

    row: all numbers, of which those of the part begin at `first`.
    """
    slots: list[Slot] = []
    whole = symbolic_copy(part, "", slots)
    symbols = ca.vertcat(*(slot.symbol for slot in slots))
    free, known = [place - first for place in places], row[first : first + symbols.numel()].copy()
    owners = [slot.owner for slot in slots for _ in range(count_of(slot.size))]
    laws = [driving_of(law, symbols) for law in _friction_laws(whole) if any(owners[i] is law for i in free)]

    def drives(rows: np.ndarray) -> np.ndarray:
        numbers = np.tile(known, (len(rows), 1))
        numbers[:, free] = rows
        return functools.reduce(np.logical_or, (law(numbers) for law in laws), np.zeros(len(rows), bool))

    return drives


def _friction_laws(node: Any) -> Iterator[FrictionLaw]:
    """The friction laws in a part."""
    if isinstance(node, FrictionLaw):
        yield node
    for each in fields_of(type(node)):
        if is_nested(value := getattr(node, each.name)):
            yield from _friction_laws(value)


def passing(part: Any, row: np.ndarray, first: int, places: Sequence[int]) -> Callable[[Sequence[float]], bool]:
    """Whether a part with other numbers at some places passes its checks; it is changed in place, because making it anew takes ten times as long."""
    nodes: list[Any] = []
    slots: list[tuple[int, Any, int | None]] = []

    def walk(node: Any) -> None:
        mine = len(nodes)
        nodes.append(node)
        for each in fields_of(type(node)):
            value = getattr(node, each.name)
            if is_nested(value):
                walk(value)
            elif each.numeric and value is not None:
                slots.extend((mine, each, k) for k in (range(len(value)) if isinstance(value, tuple) else (None,)))

    walk(rebuilt(part, row, first))
    chosen = [slots[place - first] for place in places]
    same = [True] * len(nodes)
    for place, (mine, each, _) in enumerate(slots, first):
        if place not in places:
            same[mine] &= within(row[place], each.spec.metadata)

    def passes(values: Sequence[float]) -> bool:
        inside = [*same]
        for value, (mine, each, k) in zip(values, chosen, strict=True):
            inside[mine] &= within(value, each.spec.metadata)
            if k is not None:
                whole = list(getattr(nodes[mine], each.name))
                whole[k] = value
                object.__setattr__(nodes[mine], each.name, tuple(whole))
            else:
                object.__setattr__(nodes[mine], each.name, value)
        try:
            for node, known in zip(nodes, inside, strict=True):
                if known:  # where a number is not within bounds, the parameter table complains about it
                    node.check()
        except SceneError:
            return False
        return True

    return passes


def varied_clocks(run: Run, variations: Variations) -> np.ndarray | None:
    """The clocks of the sampled controllers of every run, shape (runs, controllers, fields of `Clock`); None where all have the same."""
    loop = run.loop
    numbers = [(loop.number(name), column) for name, column in zip(variations.names, variations.points.T, strict=True)]
    varied = [(number.kind, number.name, column) for number, column in numbers if isinstance(number.kind, ClockKind)]
    if not varied:
        return None
    sampled = [k for k, law in enumerate(loop.controllers) if isinstance(law, Sampled)]
    found = np.tile(np.array(run.clocks, float), (len(variations.points), 1, 1))
    for kind, name, column in varied:
        found[:, sampled.index(sampled_owner(loop, name)), kind.column] = column
    return found


def varied_held(run: Run, variations: Variations) -> np.ndarray | None:
    """Return the values of the commands of delayed laws before the first output arrives, if these values vary; else None."""
    plant = run.plant
    names = [name for name in variations.names if name not in run.system.inputs and plant.has_parameter(name)]
    varied = varied_clocks(run, variations)
    clocks = [run.clocks] if varied is None else [[Clock(*row) for row in rows] for rows in varied.tolist()]
    late = any(clock.delay > 0.0 for own in clocks for clock in own)
    if run.start.carried or not late or (not names and varied is None):
        return None
    values = np.repeat(plant.values[:, None], len(variations.points), axis=1)
    for name, column in zip(variations.names, variations.points.T, strict=True):
        if name in names:
            values[plant._parameter(name).offset] = column
    declared = held_defaults(run.system, plant, run.clocks, plant.values)
    if varied is None:
        held = held_defaults(run.system, plant, run.clocks, values)
    else:
        held = np.array([held_defaults(run.system, plant, own, column) for own, column in zip(clocks, values.T, strict=True)])
    return np.where(run.start.held == declared, held, run.start.held)  # what the loop gives as a start value stays


def run_fingerprint(task: Task, variations: Variations, names: Sequence[str]) -> dict[str, str]:
    """Return the definition of a sweep, argument by argument, as digests. Functions are represented by their names, because their text
    cannot be compared."""
    metrics = [(measure, _name(measure.function)) for measure in task.metrics]
    arrays = [array for array in (task.starts, task.memories, task.held, task.clocks) if array is not None]
    return fingerprints(
        task.run,
        variations.names,
        vary=[variations.names, variations.shape, hashlib.sha256(variations.points.tobytes()).hexdigest()],
        starts=[hashlib.sha256(a.tobytes()).hexdigest() for a in arrays],
        metrics=[str(list(zip(names, metrics, strict=True)))],
        duration=[task.run.duration],
    )


def fingerprints(run: Run, varied: Sequence[str], **more: Any) -> dict[str, str]:
    """Return the definition of a run without its varied inputs, and of further arguments, argument by argument, as digests."""
    content = {
        "machine": [_plain(structure_of(part)) for part in run.system.parts] + [run.system.values.tolist()],
        "controller": [_name(law) for law in run.controllers]
        + [[each[:2] if each.regular else tuple(each) for each in run.clocks], run.seeds],
        "inputs": [(k, _number(v)) for k, v in sorted(run.inputs.items()) if k not in varied],
        "start": [str([(word, np.asarray(array).tolist()) for word in BEGIN for array in _arrays(getattr(run.start, word))])],
        "accuracy": [run.accuracy],
        "method": [str(run.method)],
        "budget": [run.budget],
        **more,
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
