"""Arguments of the verbs: each is returned as it is used, or refused by a SceneError that names it and says what it must be."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from toolbox.errors import SceneError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    FloatArray = NDArray[np.float64]
    BoolArray = NDArray[np.bool_]
else:
    FloatArray = BoolArray = np.ndarray
    """What results hold: arrays of floats and of truths, as a type checker sees them."""


def mapping(word: str, given: Any) -> dict[str, Any]:
    """A mapping of names to values as a dictionary, empty for None."""
    if given is not None and not (isinstance(given, Mapping) and all(isinstance(name, str) for name in given)):
        raise SceneError(f"Argument `{word}` must map names to values, but it is {given!r}.")
    return dict(given or {})


def number(word: str, given: Any) -> float:
    """A finite number."""
    if not is_finite_number(given):
        raise SceneError(f"Argument `{word}` must be a finite number, but it is {given!r}.")
    return float(given)


def numbers(word: str, given: Any) -> list[float]:
    """A row of finite numbers."""
    listed: list[Any] = list(given) if isinstance(given, Iterable) and not isinstance(given, (str, bytes, Mapping)) else [None]
    if not all(is_finite_number(value) for value in listed):
        raise SceneError(f"Argument `{word}` must be finite numbers, but it is {given!r}.")
    return [float(value) for value in listed]


def whole(word: str, given: Any, at_least: int) -> int:
    """An integer with a lower bound."""
    if isinstance(given, (bool, np.bool_)) or not isinstance(given, (int, np.integer)) or given < at_least:
        raise SceneError(f"Argument `{word}` must be an integer >= {at_least}, but it is {given!r}.")
    return int(given)


def is_finite_number(value: Any) -> bool:
    """True for a finite real number that is not a bool."""
    if isinstance(value, (bool, np.bool_, str, bytes)):
        return False
    try:
        return math.isfinite(value)
    except (TypeError, ValueError, OverflowError, NotImplementedError, RuntimeError):
        return False


def finite_array(value: Any) -> np.ndarray | None:
    """Numbers as a float array, or None where they are not finite real numbers."""
    try:
        raw = np.asarray(value)
        if raw.dtype.kind not in "iuf":
            return None
        array = np.array(raw, float)
    except (TypeError, ValueError, OverflowError, NotImplementedError, RuntimeError):
        return None
    return array if np.isfinite(array).all() else None


def checked_range(between: Any, word: str = "between") -> tuple[float, float]:
    """(low, high) of a range; raises SceneError unless it is two finite numbers in that order."""
    try:
        low, high = between
    except (TypeError, ValueError):
        low, high = None, None
    if not is_finite_number(low) or not is_finite_number(high) or not low < high:
        raise SceneError(f"Argument `{word}` must be two finite numbers (low, high) with low < high, but it is {between!r}.")
    return float(low), float(high)


def short(value: Any) -> str:
    """A value as it stands in an error message, cut where it is long."""
    text = repr(value)
    return text if len(text) < 60 else text[:56] + " ..."
