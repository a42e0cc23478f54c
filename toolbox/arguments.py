"""Arguments of the verbs: each is returned as it is used, or refused by a SceneError that names it and says what it must be."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from toolbox.errors import SceneError
from toolbox.modelling.elements import is_finite_number


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
