"""How a loop is closed: laws designed on the declared plant become its parts, each with its clock."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from toolbox.arguments import count_of
from toolbox.errors import SceneError, suggest
from toolbox.modelling.clocks import Clock
from toolbox.modelling.components import Component, checked, numbers_of, structure_of
from toolbox.modelling.composition import NEEDED, assembled, numbered
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.law_in_python import LawInPython, holds_python
from toolbox.modelling.laws import Controller, Sampled, as_held_part, callable_law, check_sampled, designed, law_word, names


class Closed(NamedTuple):
    """A plant with its laws as parts.

    Attributes
    ----------
    system
        The closed system, with the numbers of the plant and of the laws.
    plant
        The plant alone with the same numbers.
    clocks
        Clocks of the sampled laws in order.
    callables
        The laws in Python.
    seeds
        Seeds of the noise of the sampled laws.
    """

    system: HybridSystem
    plant: HybridSystem
    clocks: list[Clock]
    callables: list[Any]
    seeds: list[int]


def laws_of(given: Any, period: float | None) -> tuple[Any, ...]:
    """Control laws in order, each `Sampled` or continuous; raises SceneError where the sample time is none, or belongs to no law."""
    everything = tuple(given) if isinstance(given, (list, tuple)) else () if given is None else (given,)
    if period is not None and not everything:
        raise SceneError("Argument `sample_time` must come with a control law, but there is none.")
    if period is not None and everything and all(isinstance(each, Sampled) and each.period != period for each in everything):
        raise SceneError(
            f"Argument `sample_time` must be left out where every controller is Sampled, with a period of its own, but it is {period!r}."
        )
    return tuple(each if isinstance(each, Sampled) or period is None else Sampled(each, period) for each in everything)


def designed_laws(declared: HybridSystem, laws: Sequence[Any]) -> list[Any]:
    """Return the laws in order, designed on the declared plant, without their clocks."""
    inner = [given.law if isinstance(given, Sampled) else given for given in laws]
    made = [designed(law, declared) if isinstance(law, Controller) else law for law in inner]
    return [LawInPython(law, declared) if holds_python(law) else law for law in made]


def closed_system(declared: HybridSystem, plant: HybridSystem, laws: Sequence[Any], made: Sequence[Any]) -> Closed:
    """A plant with laws as its parts; made: the laws as they are designed on the declared plant."""
    parts: list[Component] = []
    clocks: list[Clock] = []
    callables: list[Any] = []
    seeds: list[int] = []
    for given, law in zip(laws, made, strict=True):
        sampled = given.with_sensor_units(declared.signal_unit) if isinstance(given, Sampled) else None
        if sampled is not None:
            sampled.check()
            clocks.append(sampled.clock)
            seeds.append(sampled.seed)
        if sampled is None and isinstance(given, Controller) and not isinstance(law, Controller):
            raise SceneError(f"{type(given).__name__} has no continuous form: give `sample_time`.")
        parts.append(_part(law, sampled, declared, law_word(getattr(given, "law", given) if isinstance(given, Sampled) else given)))
        if not isinstance(law, Controller):
            callables.append(law)
    if not parts:
        return Closed(plant, plant, [], [], [])
    closed = _assembled(plant, parts)
    words = {
        name.partition(".")[0] for name in (*plant.signals, *plant.inputs)
    }  # under another first word, a law writes down what is its own
    for law in made:
        for name in names(law.actuated_signals) if isinstance(law, Controller) else ():
            driven = declared.redirected_signals.get(name, name)
            if driven not in closed.cache[NEEDED] and driven.partition(".")[0] in words:
                raise SceneError(f"{kind_of(law)} drives `{driven}`, which no part of the machine needs: {suggest(driven, plant.inputs)}")
    return Closed(closed, plant, clocks, callables, seeds)


def _part(law: Any, sampled: Sampled | None, declared: HybridSystem, word: str) -> Component:
    """The part of the closed system that stands for a designed law; word: the first of the names of one in Python."""
    dt = getattr(law, "dt", None)
    if sampled is not None and dt is not None and abs(sampled.period - dt) > 1e-9 * dt:
        raise SceneError(f"Argument `sample_time` must be {dt:g} s, for which the law was designed, but it is {sampled.period:g} s.")
    if isinstance(law, Controller):
        structure_of(law)  # the kinds of its fields, before `checked` compares their values
        checked(law)
        if sampled is not None:
            check_sampled(law, float(sampled.period))
        return law if sampled is None else as_held_part(sampled, law)
    if type(law).__module__.partition(".")[0] == "control":
        raise SceneError(
            "Argument `controller` must be a law, but it is a system of python-control: give "
            "`from_control(system, measured_signals=..., actuated_signals=..., reference=...)`."
        )
    if callable(law) and not isinstance(law, type):
        if sampled is None:
            raise SceneError("A callable controller must come with `sample_time`, but there is none.")
        return callable_law(dataclasses.replace(sampled, law=law), declared, word)
    shown = f"the class {law.__name__}: give one of it, `{law.__name__}(...)`" if isinstance(law, type) else f"{law!r}"
    raise SceneError(f"Argument `controller` must be a Controller, Sampled or a callable, but it is {shown}.")


def _assembled(plant: HybridSystem, parts: Sequence[Component]) -> HybridSystem:
    """The closed system of a plant and laws as parts, with their numbers; its structure is made once."""

    def structure() -> tuple[HybridSystem, np.ndarray, int]:
        closed = assembled((*plant.parts, *parts))
        by_name = {p.name: p.offset for p in plant.parameters.values()}
        places: list[tuple[int, int]] = []
        for entry in closed.parameters.values():
            if entry.name in by_name:
                size = count_of(entry.size)
                places += zip(range(by_name[entry.name], by_name[entry.name] + size), range(entry.offset, entry.offset + size), strict=True)
        return closed, np.array(places, np.int64).reshape(-1, 2), sum(len(numbers_of(part)) for part in plant.parts)

    shared, places_of, first = plant.once(("closed", tuple(structure_of(part) for part in parts)), structure)
    closed = numbered(shared, (*plant.parts, *parts), len(plant.parts), first)
    closed.values[places_of[:, 1]] = plant.values[places_of[:, 0]]
    return closed


def kind_of(law: Any) -> str:
    """Return the name of a Python function, or else of the class. A sampled law has the name of the law inside."""
    law = law.law if isinstance(law, Sampled) else law
    return getattr(law, "__name__", type(law).__name__)


def described(given: Any) -> str:
    """A law and how it runs, in words."""
    name = kind_of(given)
    if not isinstance(given, Sampled):
        return f"{name}, continuous"
    words = f"{name}, sampled every {_time(given.period)}" + (f" with a delay of {_time(given.delay)}" if given.delay else "")
    words += f", late by up to {_time(given.jitter)}" if given.jitter else ""
    return words + (f", {100.0 * given.missed_samples:.3g} % missed" if given.missed_samples else "")


def all_described(laws: Sequence[Any]) -> str:
    """The laws of a loop and how they run, in words."""
    return "; ".join(map(described, laws)) or "the machine without a law"


def _time(value: float) -> str:
    return f"{value:.3g} s" if value >= 1.0 else f"{1e3 * value:.3g} ms"
