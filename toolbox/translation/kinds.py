"""Kinds and values of the loops that are translated (`toolbox.translation.translation`)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

STORED = {"float64": "f", "int64": "i", "uint64": "u", "bool": "b", "int8": "i", "int32": "i"}
"""{dtype: kind of its numbers}."""

CASTS = {float: "f", np.float64: "f", np.int64: "i", np.uint64: "u"}
FUNCTIONS = {math.sqrt: "sqrt", math.exp: "exp", math.log: "log", math.cos: "cos", math.copysign: "copysign"}


class NotTranslatable(Exception):
    """The loop has grown by something that the translator does not know."""


@dataclass(frozen=True)
class Array:
    """The kind of an array: stored dtype and sizes; a size that is not known is None."""

    dtype: str
    shape: tuple[int | None, ...]


@dataclass(frozen=True)
class Arrays:
    """The kind of a named tuple of arrays, by the name of the tuple."""

    name: str


WORK = Arrays("w")
"""The arrays of a loop that has one tuple of them."""

Kind = Any  # "f", "i", "u", "b", "none", an Array, Arrays, or a tuple of kinds
_UNKNOWN = object()


@dataclass(frozen=True)
class Value:
    """An expression in the target language: its text, its kind, and its value if the value is known.

    field, owner: of an array the field of a tuple that it is, and the variable that is the tuple.
    """

    text: str
    kind: Kind
    known: Any = _UNKNOWN
    field: str = ""
    owner: str = ""

    @property
    def is_known(self) -> bool:
        """Whether its value is known."""
        return self.known is not _UNKNOWN


def known(value: Any) -> Value:
    """A number that is known, whose text each language writes for itself."""
    if value is None:
        return Value("", "none", None)
    if isinstance(value, (bool, np.bool_)):
        return Value("", "b", bool(value))
    if isinstance(value, np.uint64):
        return Value("", "u", value)
    if isinstance(value, (int, np.integer)):
        return Value("", "i", int(value))
    return Value("", "f", float(value))


def joined(one: Kind, other: Kind) -> Kind:
    """The kind that holds values of both."""
    if one is None or one == other:
        return other
    if other is None:
        return one
    if isinstance(one, tuple) and isinstance(other, tuple) and len(one) == len(other):
        return tuple(joined(a, b) for a, b in zip(one, other, strict=True))
    if isinstance(one, Array) and isinstance(other, Array) and one.dtype == other.dtype:
        return Array(one.dtype, tuple(None for _ in one.shape))
    for kinds, wide in (({"i", "f"}, "f"), ({"b", "i"}, "i"), ({"b", "f"}, "f")):
        if {one, other} == kinds:
            return wide
    raise NotTranslatable(f"a variable is {one} and {other}")
