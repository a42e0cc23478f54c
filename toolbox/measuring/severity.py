"""The severity of stick-slip, from the extent of a speed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from toolbox.arguments import is_finite_number
from toolbox.errors import SceneError, suggest


# ------------------------------------------------------------------------------------------------------------------- extrema, mean and severity
@dataclass(frozen=True)
class Extent:
    """Smallest and largest value of a signal, when it takes them [s], and its mean over time; values in the unit of the signal."""

    minimum: float
    maximum: float
    mean: float
    time_of_minimum: float
    time_of_maximum: float


def check_definition(definition: Any, reference: Any) -> None:
    """Raise SceneError for an unknown definition of severity, and for a set-point that it lacks or does not need."""
    if not isinstance(definition, str) or definition not in SEVERITIES:
        raise SceneError(f"There is no definition of severity `{definition}`: {suggest(definition, SEVERITIES)}")
    if definition == "reference":
        if not is_finite_number(reference) or reference == 0:
            raise SceneError(f"Argument `reference` must be a finite set-point other than 0, but it is {reference!r}.")
    elif reference is not None:
        raise SceneError(f'Argument `reference` must come with definition "reference", but the definition is "{definition}".')


def severity_of(found: Extent, definition: str = "half-range", reference: float | None = None) -> float:
    """The severity that an extent amounts to, by the definitions of `severity`."""
    swing, divisor = SEVERITIES[definition](found, abs(reference or 0.0))
    if divisor <= 1e-14 * swing:  # zero, or the round-off of a mean that is
        return math.inf if swing else math.nan
    return swing / divisor


SEVERITIES: Mapping[str, Callable[[Extent, float], tuple[float, float]]] = {
    "half-range": lambda e, reference: (e.maximum - e.minimum, 2.0 * abs(e.mean)),
    "range": lambda e, reference: (e.maximum - e.minimum, abs(e.mean)),
    "peak": lambda e, reference: (max(abs(e.maximum), abs(e.minimum)) - abs(e.mean), abs(e.mean)),
    "reference": lambda e, reference: (e.maximum - e.minimum, 2.0 * reference),
}
"""Definitions of severity by name: (extent, set-point) -> (swing, what it is divided by)."""
