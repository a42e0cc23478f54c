"""Where a run starts: values of states by name, put into the state vector."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import finite_array
from toolbox.errors import SceneError, suggest
from toolbox.files.units import in_si
from toolbox.modelling.hybrid_system import HybridSystem


def place_starts(system: HybridSystem, x: np.ndarray, start: Mapping[str, Any]) -> None:
    """Write start values; an entry that is named beside its vector wins, in whatever order they are given.

    Raises SceneError as `place_start` does, and where two names of one state, such as `bit.speed` and `chain.speed.1`, say different values.
    """
    named: dict[int, str] = {}
    for name in sorted(start, key=lambda name: not _is_vector(system, name)):
        before = x.copy()
        place = place_start(system, x, name, start[name])
        if _is_vector(system, name):
            continue
        other = named.setdefault(place.start, name)
        if other != name and not np.array_equal(x[place], before[place]):
            raise SceneError(
                f"Arguments `{other}` and `{name}` must agree as start values of one state, but they are {start[other]!r} and {start[name]!r}."
            )


def _is_vector(system: HybridSystem, name: str) -> bool:
    rows = system.rows(name)
    return rows is not None and rows[1] is not None


def started(system: HybridSystem) -> list[str]:
    """Names that a start value can be given to: states, and signals that are states."""
    known = list(system.states)
    for name, (expression, _) in system.signals.items():
        if (
            expression.numel() == 1
            and expression.is_symbolic()
            and np.count_nonzero(np.array(ca.DM(ca.jacobian(system.x, expression)))) == 1
        ):
            known.append(name)
    return known


def place_start(system: HybridSystem, x: np.ndarray, name: str, value: Any) -> slice:
    """Write a start value: of a state, of one entry of a vector state (`chain.speed.0`), or of a signal that is a state (`bit.speed`); returns its places."""
    target: Any = None
    rows = system.rows(name)
    if rows is not None:
        target = slice(rows[0], rows[0] + (rows[1] or 1))
    elif name in system.signals:
        expression = system.signals[name][0]
        if expression.numel() == 1 and expression.is_symbolic():
            place = np.flatnonzero(np.array(ca.DM(ca.jacobian(system.x, expression))))
            if place.size == 1:
                target = slice(place[0], place[0] + 1)
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
