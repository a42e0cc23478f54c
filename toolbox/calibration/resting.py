"""Estimates that rest on another number: kinetic friction that the data want above the static one, which no part allows.

A part declares bounds of single numbers, which a search can be given, and refuses numbers that contradict each other, which it cannot: it ends somewhere
before them. Whether it would go on is told by the slope of the misfit there, and by the part, which is asked for the numbers beyond.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.errors import SceneError
from toolbox.halving import halved

REACHED = 2.0**-40
"""Part of the way to its own optimum to which it is found where a number rests: to its last digits."""

NEAR = 0.05
"""A number rests where it can go less than this part of the way to its own optimum."""


@dataclass(frozen=True)
class Resting:
    """Numbers that rest on others. why: {place among the free numbers: what their part says of the numbers beyond};  values: where they rest;
    together: places of numbers that rest on each other, and can only move as one."""

    why: dict[int, str]
    values: np.ndarray
    together: tuple[int, ...]

    @property
    def directions(self) -> np.ndarray:
        """Columns: how the numbers can move, those that rest on each other as one; shape (k, k')."""
        size = self.values.size
        columns = [np.isin(np.arange(size), self.together).astype(float)] if self.together else []
        columns += [np.eye(size)[i] for i in range(size) if i not in self.together]
        return np.stack(columns, axis=1)


def resting(
    misfit: Any, values: np.ndarray, size: np.ndarray, jacobian: np.ndarray, left: np.ndarray, low: np.ndarray, high: np.ndarray
) -> Resting:
    """Which of the numbers at the end of a search rest on others, and where. jacobian, left: slopes and residuals there, in parts of the noise."""
    gradient = np.einsum("ni,n->i", jacobian, left)
    curvature = (jacobian**2).sum(axis=0)
    why: dict[int, str] = {}
    for i in range(values.size):
        if curvature[i] == 0.0:
            continue
        step = -gradient[i] / curvature[i]
        step = np.clip(values[i] + step, low[i], high[i]) - values[i]
        if abs(step) < 1e-6 * size[i]:
            continue
        move = np.zeros(values.size)
        move[i] = step
        words = _refused(misfit, values + move)
        if words is None:
            continue
        part = _reach(misfit, values, move)
        if part < NEAR:
            values = values + part * move
            why[i] = words
    together: tuple[int, ...] = ()
    if len(why) > 1:
        shift = np.isin(np.arange(values.size), list(why)) * 1e-3 * float(np.min(size[list(why)]))
        if _refused(misfit, values + shift) is None and _refused(misfit, values - shift) is None:
            together = tuple(why)
            level = values.copy()
            level[list(why)] = values[list(why)].mean()
            values = level if _refused(misfit, level) is None else values
    return Resting(why, values, together)


def _refused(misfit: Any, values: np.ndarray) -> str | None:
    """What a part says of numbers that contradict each other; None where it says nothing."""
    try:
        misfit.allowed(values)
    except SceneError as error:
        return str(error)
    return None


def _reach(misfit: Any, values: np.ndarray, move: np.ndarray) -> float:
    """The largest part of a move that is allowed, where the whole is not."""
    return halved(lambda part: _refused(misfit, values + part * move) is not None, 0.0, 1.0, 0.0, REACHED)[0]
