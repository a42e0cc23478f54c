"""Closing the loop: a plant with its controllers as parts."""

from __future__ import annotations

import copy
import dataclasses
from typing import Any

import numpy as np

from toolbox.errors import SceneError
from toolbox.modelling.components import Component, checked, numbers_of, structure_of
from toolbox.modelling.composition import assembled
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Controller, Sampled, as_held_part, callable_law, designed


def closed_loop(
    declared: HybridSystem, plant: HybridSystem, controller: Any, sample_time: float | None
) -> tuple[HybridSystem, list[tuple[float, float]], list[Any], list[int]]:
    """The plant with its controllers as parts, the (period, delay) of the sampled ones in order, the Python callables, and the seeds."""
    if controller is None:
        return plant, [], [], []
    parts: list[Component] = []
    clocks: list[tuple[float, float]] = []
    laws: list[Any] = []
    seeds: list[int] = []
    everything = controller if isinstance(controller, (list, tuple)) else (controller,)
    if sample_time is not None and everything and all(isinstance(given, Sampled) and given.period != sample_time for given in everything):
        raise SceneError(
            f"Argument `sample_time` must be left out where every controller is Sampled, with a period of its own, but it is {sample_time!r}."
        )
    for given in everything:
        sampled = given
        if not isinstance(given, Sampled):
            sampled = Sampled(given, sample_time) if sample_time is not None else None
        law = given.law if isinstance(given, Sampled) else given
        if sampled is not None:
            sampled = sampled.measured_by(declared.signal_unit)
            sampled.check()
        if isinstance(law, Controller):
            law = designed(law, declared)
        if isinstance(law, Controller):
            structure_of(law)  # the kinds of its fields, before `checked` compares their values
            checked(law)
            if sampled is not None and law.dt is not None and abs(sampled.period - law.dt) > 1e-9 * law.dt:
                raise SceneError(
                    f"Argument `sample_time` must be {law.dt:g} s, for which the law was designed, but it is {sampled.period:g} s."
                )
            parts.append(law if sampled is None else as_held_part(sampled, law))
        elif type(law).__module__.partition(".")[0] == "control":
            raise SceneError(
                "Argument `controller` must be a law, but it is a system of python-control: give "
                "`from_control(system, measures=..., drives=..., reference=...)`."
            )
        elif callable(law) and not isinstance(law, type):
            if sampled is None:
                raise SceneError("A callable controller must come with `sample_time`, but there is none.")
            parts.append(callable_law(dataclasses.replace(sampled, law=law), declared))
            laws.append(law)
        else:
            shown = f"the class {law.__name__}: give one of it, `{law.__name__}(...)`" if isinstance(law, type) else f"{law!r}"
            raise SceneError(f"Argument `controller` must be a Controller, Sampled or a callable, but it is {shown}.")
        if sampled is not None:
            clocks.append((float(sampled.period), float(sampled.delay)))
            seeds.append(sampled.seed)
    key = ("closed", tuple(structure_of(part) for part in parts))
    found = plant.cache.get(key)
    if found is None:
        closed = assembled((*plant.parts, *parts))
        by_name = {p.name: p.offset for p in plant.parameters.values()}
        places: list[tuple[int, int]] = []
        for entry in closed.parameters.values():
            if entry.name in by_name:
                size = entry.size or 1
                places += zip(range(by_name[entry.name], by_name[entry.name] + size), range(entry.offset, entry.offset + size), strict=True)
        first = sum(len(numbers_of(part)) for part in plant.parts)
        found = plant.cache[key] = (closed, np.array(places, np.int64).reshape(-1, 2), first)
    shared, places_of, first = found
    closed = copy.copy(shared)
    closed.parts = (*plant.parts, *parts)
    closed.values = shared.values.copy()
    closed.values[places_of[:, 1]] = plant.values[places_of[:, 0]]
    numbers = [value for part in parts for value in numbers_of(part)]
    closed.values[first : first + len(numbers)] = numbers
    for entry in closed.parameters.values():
        if first <= entry.offset < first + len(numbers):
            size = entry.size or 1
            entry.check(tuple(closed.values[entry.offset : entry.offset + size].tolist()))
    return closed, clocks, laws, seeds
