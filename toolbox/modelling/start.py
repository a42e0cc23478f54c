"""Where a run starts: values of states by name, put into the state vector."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import count_of, finite_array
from toolbox.errors import SceneError, suggest
from toolbox.files.units import in_si
from toolbox.modelling.hybrid_system import HybridSystem


def place_starts(system: HybridSystem, x: np.ndarray, start: Mapping[str, Any]) -> None:
    """Write start values; an entry that is named beside its vector wins, in whatever order they are given.

    Raises SceneError as `place_start` does, and where two names of one state, such as `bit.speed` and `chain.speed.1`, say different values.
    """
    named: dict[int, str] = {}
    for name in sorted(start, key=lambda name: not is_vector(system, name)):
        before = x.copy()
        place = place_start(system, x, name, start[name])
        if is_vector(system, name):
            continue
        other = named.setdefault(place.start, name)
        if other != name and not np.array_equal(x[place], before[place]):
            raise SceneError(
                f"Arguments `{other}` and `{name}` must agree as start values of one state, but they are {start[other]!r} and {start[name]!r}."
            )


def is_vector(system: HybridSystem, name: str) -> bool:
    """Return whether a name belongs to a vector state."""
    rows = system.state_index(name)
    return rows is not None and rows[1] is not None


def places_of(system: HybridSystem, name: str) -> slice | None:
    """The rows of x of a state, of an entry of a vector state, or of a signal that is a state; None for any other name."""
    rows = system.state_index(name)
    if rows is not None:
        return slice(rows[0], rows[0] + count_of(rows[1]))
    expression = system.signals[name][0] if name in system.signals else ca.SX(0, 1)
    if expression.numel() != 1 or not expression.is_symbolic():
        return None
    places = np.flatnonzero(np.array(ca.DM(ca.jacobian(system.x, expression))))
    return slice(int(places[0]), int(places[0]) + 1) if places.size == 1 else None


def row_of(system: HybridSystem, name: str) -> int | None:
    """The row of a scalar state, of an entry of a vector state, or of a signal that is a state; None for any other name."""
    places = None if is_vector(system, name) else places_of(system, name)
    return None if places is None else places.start


def started(system: HybridSystem) -> list[str]:
    """Names that a start value can be given to: states, and signals that are states."""
    return [*system.states, *(name for name in system.signals if name not in system.states and places_of(system, name) is not None)]


def place_start(system: HybridSystem, x: np.ndarray, name: str, value: Any) -> slice:
    """Write a start value: of a state, of one entry of a vector state (`chain.speed.0`), or of a signal that is a state (`bit.speed`); returns its places."""
    target = places_of(system, name)
    if target is None:
        if name in system.signals:
            raise SceneError(f"Argument `{name}` must be a state to be given a start value, but it is computed from states.")
        raise SceneError(f"There is no state `{name}`: {suggest(name, started(system))}")
    array = finite_array(in_si(value, system.unit(name), name))
    if array is None:
        raise SceneError(f"Argument `{name}` must be finite numbers, but it is {value!r}.")
    if array.ndim and array.shape != x[target].shape:
        raise SceneError(f"Argument `{name}` must have shape {x[target].shape}, but it has {array.shape}.")
    x[target] = array
    return target
