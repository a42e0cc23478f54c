"""Cells of a log as numbers, epochs and units: decimal commas, thousands, and the spellings of the field."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from toolbox.errors import SceneError
from toolbox.files.units import parse
from toolbox.logs.dates import digits_of, is_format

SPELLINGS = {
    "s": "s", "second": "s", "seconds": "s", "sek": "s", "msec": "ms", "minutes": "min", "m/hr": "m/h", "mts/hr": "m/h",
    "c/min": "rpm", "r/min": "rpm", "tr/min": "rpm", "cpm": "rpm", "revs/min": "rpm", "об/мин": "rpm", "c/s": "rev/s", "r/s": "rev/s",
    "dega/s": "deg/s", "dega/min": "deg/min", "rada/s": "rad/s", "dega": "deg",
    "kdan": "10 kN", "klb": "klbf", "klbs": "klbf", "klbsf": "klbf", "kkgf": "1000 kgf", "kkg": "1000 kgf", "mt": "t", "metricton": "t", "metrictons": "t",
    "metrictonne": "t", "metrictonnes": "t", "tnf": "t", "tonneforce": "t", "тс": "t", "shortton": "2 klbf", "shorttons": "2 klbf", "ustons": "2 klbf",
    "uston": "2 klbf", "longton": "2.24 klbf", "longtons": "2.24 klbf", "ukton": "2.24 klbf", "uktons": "2.24 klbf",
    "ftlb": "lbf ft", "ftlbs": "lbf ft", "ftlbf": "lbf ft", "lbft": "lbf ft", "lbsft": "lbf ft", "lbfft": "lbf ft", "kftlb": "klbf ft", "kftlbs": "klbf ft",
    "kftlbf": "klbf ft", "klbft": "klbf ft", "klbsft": "klbf ft", "klbfft": "klbf ft", "mkgf": "kgf m", "kgfm": "kgf m", "kgm": "kgf m", "tfm": "1000 kgf m",
    "tm": "1000 kgf m", "nm": "N m", "knm": "kN m", "danm": "10 N m", "kdanm": "10 kN m",
}  # fmt: skip
"""{spelling in small letters without blanks, points and lines: unit, or number and unit, as the toolbox writes it} of logs; tried where a unit does not fit as
it is typed elsewhere."""

KINDS = ("1", "s", "rad", "rad/s", "m", "m/s", "N", "N m", "Pa", "kg", "K", "W", "V", "A", "Hz", "m3/s", "kg/m3", "rad/s2", "m/s2")
"""Units of what a column may hold: whatever fits to one of them is a unit."""

EPOCHS = ((1e8, 5e9, 1.0), (1e11, 5e12, 1e-3), (1e14, 5e15, 1e-6), (1e17, 5e18, 1e-9))
"""(from, to, seconds) of numbers that count seconds, milliseconds, microseconds or nanoseconds since 1970."""

QUANTITIES = {
    "A": "current", "V": "voltage", "N": "force", "N m": "torque", "Pa": "pressure", "W": "power", "s": "time", "m": "length", "m/s": "speed",
    "m/s2": "acceleration", "rad": "angle", "rad/s": "angular speed", "rad/s2": "angular acceleration", "Hz": "frequency", "kg": "mass", "K": "temperature",
    "m3/s": "flow rate", "kg/m3": "density", "N/m": "stiffness", "N s/m": "viscous friction", "kg m2": "inertia",
}  # fmt: skip
"""{unit: the quantity that it measures}, for messages on a column that measures another quantity than its signal."""

UNITLESS = (
    "unitless",
    "euc",
    "none",
    "n/a",
    "na",
    "nil",
    "dimensionless",
    "count",
    "counts",
    "spm",
    "stk/min",
    "strokes/min",
    "gapi",
    "api",
    "us/ft",
    "ohm.m",
)
"""Words in small letters that stand in a row of units for columns without one, or for channels that no plant has."""

_SIZED = re.compile(r"\s*(\d+)\s*([^\d\s/^*-].*)")
"""A unit with a number before it, such as 1000 lbf."""

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d{1,3})?")


def factor(unit: str, wanted: str, name: str) -> float:
    """Return how many of the wanted unit one of a log's is.

    Raises
    ------
    SceneError
        If the unit is unknown, has several sizes as `ton` has, or measures something else.
    """
    try:
        return parse(unit if _SIZED.match(unit) else f"1 {unit}", wanted, name)
    except SceneError:
        sized = _SIZED.fullmatch(unit)
        size, bare = ("1", unit) if sized is None else (sized[1], sized[2])
        usual = SPELLINGS.get(re.sub(r"[\s._*·-]", "", bare).lower())
        with contextlib.suppress(SceneError):
            if usual is not None:
                return float(size) * parse(usual if usual[0].isdigit() else f"1 {usual}", wanted, name)
        raise


def quantity_of(unit: str) -> str:
    """Return the quantity that a unit measures, such as "current" for "mA". Empty for an unknown unit, and for a unit whose quantity has no
    name here."""
    for of_quantity, quantity in QUANTITIES.items():
        with contextlib.suppress(SceneError):
            factor(unit, of_quantity, "unit")
            return quantity
    return ""


def is_unit(text: str) -> bool:
    """Return whether text between brackets is a unit or the format of a date, and not a word of the name."""
    text = text.strip()
    if text in ("", "-", "1", "%") or text.lower() in UNITLESS or re.fullmatch(r"(?i)(?:k|kilo)?tons?f?", text):
        return True
    if is_format(text) or digits_of(text) is not None:
        return True
    for wanted in KINDS:
        with contextlib.suppress(SceneError):
            factor(text, wanted, "unit")
            return True
    return False


def decimal_mark(columns: Sequence[Sequence[str]]) -> str | None:
    """Return the decimal mark of a log, found in the cells of its columns: "." or ",". None if the commas may also be thousands separators.

    A point in another column tells nothing about `100,368`: recorders write some columns with a decimal comma and others with a point.
    """
    of_column = [
        [cell for cell in cells if "," in cell and re.fullmatch(r"[+-]?[\d.,' \u00a0\u202f]+(?:[eE][+-]?\d+)?", cell)] for cells in columns
    ]
    commas = [cell for found in of_column for cell in found]
    if not commas:
        return "."
    if any("." in cell and cell.rindex(".") > cell.rindex(",") for cell in commas) or any(cell.count(",") > 1 for cell in commas):
        return "."
    if any("." in cell or not re.fullmatch(r"[+-]?[1-9]\d{0,2},\d{3}", cell) for cell in commas):
        return ","
    for found, cells in zip(of_column, columns, strict=True):
        if found and len({cell for cell in cells if re.fullmatch(r"[+-]?\d+\.\d+", cell)}) > 1:
            return "."  # others of the column have a point; a single one may be the number that means no value
    return None


def plain_number(cell: Any, mark: str = ".") -> float:
    """The number in a cell, nan for anything else."""
    if isinstance(cell, (int, float, np.number)) and not isinstance(cell, bool):
        return float(cell)
    text = str(cell).strip()
    if text[:1] in ("'", '"') and text[:1] == text[-1:]:  # a quote alone is damage
        text = text[1:-1].strip()
    text = text.replace("\u00a0", "").replace("\u202f", "").replace("\u2212", "-")
    if mark == ",":
        text = text.replace(".", "").replace(",", ".") if "," in text or re.fullmatch(r"[+-]?[1-9]\d{0,2}(\.\d{3})+", text) else text
    elif "," in text and re.fullmatch(r"[+-]?\d{1,3}(,\d{3})+(\.\d*)?", text):
        text = text.replace(",", "")
    if re.fullmatch(r"[+-]?\d{1,3}([ ']\d{3})+(\.\d*)?", text):
        text = text.replace(" ", "").replace("'", "")
    return float(text.replace("d", "e").replace("D", "E")) if _NUMBER.fullmatch(text) else np.nan


def epoch(numbers: np.ndarray) -> float | None:
    """Return the seconds of a count if numbers count from 1970; None for other numbers."""
    finite = numbers[np.isfinite(numbers)]
    middle = float(np.median(finite)) if finite.size else 0.0
    return next((size for low, high, size in EPOCHS if low < middle < high), None)
