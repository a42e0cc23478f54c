"""Kinds and numbers of the C into which the loops are translated (`toolbox.export.translation`)."""

from __future__ import annotations

import ast
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

C_TYPES = {"f": "double", "i": "int64_t", "u": "uint64_t", "b": "int"}
STORED = {
    "float64": ("f", "double"),
    "int64": ("i", "int64_t"),
    "uint64": ("u", "uint64_t"),
    "bool": ("b", "uint8_t"),
    "int8": ("i", "int8_t"),
    "int32": ("i", "int32_t"),
}
"""{dtype: (kind of its numbers, type that is stored)}."""

HELPERS = {
    "min_f": "static double min_f(double a, double b) { return b < a ? b : a; }",
    "max_f": "static double max_f(double a, double b) { return b > a ? b : a; }",
    "min_i": "static int64_t min_i(int64_t a, int64_t b) { return b < a ? b : a; }",
    "max_i": "static int64_t max_i(int64_t a, int64_t b) { return b > a ? b : a; }",
    "square": "static double square(double a) { return a * a; }",
    "floor_div": "static int64_t floor_div(int64_t a, int64_t b) { return a / b - (a % b != 0 && (a < 0) != (b < 0)); }",
    "floor_mod": "static int64_t floor_mod(int64_t a, int64_t b) { return a - b * (a / b - (a % b != 0 && (a < 0) != (b < 0))); }",
    "bits_of": "static int64_t bits_of(double a) { int64_t b; memcpy(&b, &a, sizeof b); return b; }",
    "number_of": "static double number_of(int64_t a) { double b; memcpy(&b, &a, sizeof b); return b; }",
}
OPERATORS = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.BitAnd: "&", ast.BitOr: "|", ast.BitXor: "^", ast.LShift: "<<", ast.RShift: ">>",
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip
FUNCTIONS = {math.sqrt: "sqrt", math.log: "log", math.cos: "cos", math.copysign: "copysign"}
CASTS = {float: "f", np.float64: "f", np.int64: "i", np.uint64: "u"}
RESERVED = {
    *FUNCTIONS.values(),
    *HELPERS,
    "floor",
    "pow",
    "fabs",
    "isfinite",
    "memcpy",
    "double",
    "float",
    "int",
    "long",
    "short",
    "signed",
    "unsigned",
    "register",
    "auto",
    "static",
    "struct",
    "union",
    "const",
    "default",
    "switch",
    "case",
    "do",
}


class NotTranslatable(Exception):
    """The loop has grown by something that the translator does not know."""


@dataclass(frozen=True)
class Array:
    """The kind of an array: stored dtype and sizes, of a pointer None."""

    dtype: str
    shape: tuple[int | None, ...]


Kind = Any  # "f", "i", "u", "b", "none", an Array, a tuple of kinds, or "w"
_UNKNOWN = object()


@dataclass(frozen=True)
class Value:
    """An expression in C: its text, kind, and value where it is known."""

    text: str
    kind: Kind
    known: Any = _UNKNOWN

    @property
    def is_known(self) -> bool:
        """Whether its value is known."""
        return self.known is not _UNKNOWN


def known(value: Any) -> Value:
    """A number as an expression in C."""
    if value is None:
        return Value("0", "none", None)
    if isinstance(value, (bool, np.bool_)):
        return Value(str(int(value)), "b", bool(value))
    if isinstance(value, np.uint64):
        return Value(f"UINT64_C({int(value)})", "u", value)
    if isinstance(value, (int, np.integer)):
        text = str(int(value)) if abs(int(value)) < 2**31 else f"INT64_C({int(value)})"
        return Value(f"({text})" if value < 0 else text, "i", int(value))
    value = float(value)
    text = "NAN" if math.isnan(value) else ("-" if value < 0 else "") + "INFINITY" if math.isinf(value) else repr(value)
    return Value(f"({text})" if text[0] == "-" else text, "f", value)


def c_word(name: str) -> str:
    """The name of a variable in C."""
    return f"{name}_" if name in RESERVED else name


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
