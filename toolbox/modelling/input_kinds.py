"""How the inputs of a loop are given: as numbers, tables, shapes or expressions of time, which is structure, and their checked values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import is_finite_number, short
from toolbox.errors import SceneError
from toolbox.files.units import TypedNumber, in_si
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.inputs import Shape, Table, Typed


@dataclass(frozen=True, eq=False)
class ExpressionKey:
    """A casadi expression as a key of a dictionary. Two keys are equal if their expressions are."""

    expression: ca.SX

    def __hash__(self) -> int:
        return hash((self.expression.shape, self.expression.nnz(), self.expression.n_dep() if self.expression.is_scalar() else 0))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ExpressionKey) and bool(ca.is_equal(self.expression, other.expression, 100))


def input_kinds(system: HybridSystem, inputs: Mapping[str, Any]) -> tuple[tuple[tuple[str, Any], ...], dict[str, Any], dict[str, Any]]:
    """How each input is given (number, table, shape with its size, expression), which is structure; the checked values; and these as they were typed."""
    kinds: list[tuple[str, Any]] = []
    typed: dict[str, Any] = {}
    values: dict[str, Any] = {}
    for name, value in inputs.items():
        unit = system.input(name).unit
        if isinstance(value, str):
            value = in_si(value, unit, name)
        elif isinstance(value, Typed):
            value = value.made(name, unit)
        elif isinstance(value, np.ndarray) and value.ndim == 0:
            value = value.item()
        elif isinstance(value, (tuple, list, np.ndarray)) and len(value) == 2:
            times, numbers = (
                in_si(row, of, f"{name}.{word}") for row, of, word in zip(value, ("s", unit), ("times", "values"), strict=True)
            )
            value = Table.of(name, times, numbers)
            value = replace(value, typed=tuple(number for number in numbers if isinstance(number, TypedNumber)))
        typed[name] = value
        if isinstance(value, Table):
            kinds.append((name, "table"))
        elif isinstance(value, Shape):
            kinds.append((name, (value.kind, len(value.coefficients))))
        elif isinstance(value, ca.SX):
            strangers = [str(s) for s in ca.symvar(value) if not ca.is_equal(s, system.t)]
            if strangers or value.numel() != 1 or (value.is_constant() and not is_finite_number(float(value))):
                raise SceneError(f"Argument `{name}` must be a scalar expression of `toolbox.time`, but it is {value}.")
            kinds.append((name, ExpressionKey(value)))
        elif is_finite_number(value):
            kinds.append((name, "number"))
            value = float(value)
        else:
            raise SceneError(
                f"Argument `{name}` must be a finite number, (times, values), a shape or an expression of time, but it is {short(value)}{_hint(value)}."
            )
        if name in system.parameters:
            system.parameters[name].check(np.array(extremes(value)))
        values[name] = value
    return tuple(sorted(kinds, key=lambda pair: pair[0])), values, typed


def _hint(value: Any) -> str:
    """What to write in place of an input that cannot be taken."""
    if getattr(value, "__name__", "") == "sweep":
        return ": the swept sine is `toolbox.inputs.sweep`"
    if isinstance(value, (tuple, list, np.ndarray)):
        return ": values need their times, `(times, values)`"
    return ": write a formula of the symbol `toolbox.time`, such as `1e4 + 500 * casadi.sin(3 * time)`" if callable(value) else ""


def extremes(value: Any) -> tuple[float, ...]:
    """Smallest and largest value of an input; none for a formula of time."""
    if isinstance(value, Table):
        return float(value.values.min()), float(value.values.max())
    return value.range() if isinstance(value, Shape) else () if isinstance(value, ca.SX) else (value,)
