"""Cells of a log as numbers, times and units: decimal commas, thousands, dates, clocks, epochs, and the spellings of the field."""

from __future__ import annotations

import contextlib
import datetime
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from toolbox.errors import SceneError
from toolbox.files.units import parse

SPELLINGS = {
    "s": "s", "second": "s", "seconds": "s", "sek": "s", "msec": "ms", "minutes": "min", "kdan": "10 kN", "c/min": "rpm", "r/min": "rpm", "k-lb": "klbf",
    "k-lbs": "klbf", "1000lb": "klbf", "1000lbf": "klbf", "1000ft.lbf": "klbf ft", "1000ftlbf": "klbf ft", "ton": "t", "tons": "t", "mkgf": "kgf m",
    "kgf.m": "kgf m", "m/hr": "m/h", "kn.m": "kN m", "kn-m": "kN m", "n.m": "N m", "nm": "N m",
}  # fmt: skip
"""{spelling in small letters without spaces: unit as the toolbox writes it} of logs; tried where a unit does not fit as it is typed elsewhere."""

KINDS = ("1", "s", "rad", "rad/s", "m", "m/s", "N", "N m", "Pa", "kg", "K", "W", "V", "A", "Hz", "m3/s", "kg/m3", "rad/s2", "m/s2")
"""Units of what a column may hold: whatever fits to one of them is a unit."""

EPOCHS = ((1e8, 5e9, 1.0), (1e11, 5e12, 1e-3), (1e14, 5e15, 1e-6), (1e17, 5e18, 1e-9))
"""(from, to, seconds) of numbers that count seconds, milliseconds, microseconds or nanoseconds since 1970."""

DAY = 86_400.0

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d{1,3})?")
_CLOCK = re.compile(r"(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,]\d+)?))?\s*([ap]m)?", re.IGNORECASE)
_DATE = re.compile(r"(\d{1,2})([/.-])(\d{1,2})\2(\d{4}|\d{2})(?:[ T]+(.*))?")


def factor(unit: str, wanted: str, name: str) -> float:
    """How many of the wanted unit one of a log's is; raises SceneError where it is unknown or measures something else."""
    try:
        return parse(f"1 {unit}", wanted, name)
    except SceneError:
        usual = SPELLINGS.get("".join(unit.split()).lower().replace("·", "."))
        with contextlib.suppress(SceneError):
            if usual is not None:
                return parse(usual if usual[0].isdigit() else f"1 {usual}", wanted, name)
        raise


def is_unit(text: str) -> bool:
    """Whether text between brackets is a unit, and not a word of the name."""
    text = text.strip()
    if text in ("", "-", "1", "%"):
        return True
    for wanted in KINDS:
        with contextlib.suppress(SceneError):
            factor(text, wanted, "unit")
            return True
    return False


def decimal_mark(cells: Sequence[str]) -> str | None:
    """The decimal mark of a log by its cells: "." or ","; None where commas may part thousands as well as decimals."""
    commas = [cell for cell in cells if "," in cell and re.fullmatch(r"[+-]?[\d.,' \u00a0\u202f]+(?:[eE][+-]?\d+)?", cell)]
    if not commas:
        return "."
    if any("." in cell and cell.rindex(".") > cell.rindex(",") for cell in commas) or any(cell.count(",") > 1 for cell in commas):
        return "."
    if any("." in cell or not re.fullmatch(r"[+-]?[1-9]\d{0,2},\d{3}", cell) for cell in commas):
        return ","
    if any("." in cell and re.fullmatch(r"[+-]?\d+\.\d+", cell) for cell in cells):
        return "."  # others have a point
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


def is_time(cell: Any) -> bool:
    """Whether a cell is a date or a time of day."""
    if isinstance(cell, (datetime.datetime, datetime.date, datetime.time, np.datetime64)):
        return True
    text = str(cell).strip()
    if _CLOCK.fullmatch(text) or _DATE.fullmatch(text):
        return True
    if not re.match(r"\d{4}-?\d{2}-?\d{2}", text) or _NUMBER.fullmatch(text):
        return False
    with contextlib.suppress(ValueError):
        datetime.datetime.fromisoformat(text.replace(",", "."))
        return True
    return False


def seconds_of(cells: Sequence[Any], where: str) -> tuple[np.ndarray, str]:
    """(times [s], what they were in words) of dates, times of day or epochs; nan where a cell has none.

    Where days and months are both at most 12, as in 03/04/2024, they are read so that no row is more than a day after the one before it.

    Raises SceneError where day and month cannot be told apart so, or some have a zone and others none.
    """
    shown = [cell if isinstance(cell, str) else _text(cell) for cell in cells]
    first_is_day = _first_is_day(shown, where)
    found = np.array([_seconds(text.strip(), first_is_day) for text in shown])
    zones = {bool(re.search(r"(?:Z|[+-]\d{2}:?\d{2})$", text.strip())) for text in shown if ":" in text}
    if len(zones) > 1:
        raise SceneError(f"{where} must have times all with a zone or all without, but some have one: write all in UTC.")
    if all(_CLOCK.fullmatch(text.strip()) for text in shown if text.strip()):
        back = np.flatnonzero(np.diff(found) < -DAY / 2)  # midnight
        for k in back:
            found[k + 1 :] += DAY
        return found, "time of day" + (f", past midnight {back.size} time(s)" if back.size else "")
    return found, "dates with a zone" if zones == {True} else "dates without a zone"


def _first_is_day(shown: Sequence[str], where: str) -> bool:
    """Whether dates as 03/04/2024 have the day first; with points or lines they have. Raises SceneError where nothing tells it."""
    dates = [match for text in shown if (match := _DATE.fullmatch(text.strip()))]
    if not any(match[2] == "/" for match in dates):
        return True
    day, month = (max(int(match[place]) for match in dates) > 12 for place in (1, 3))
    if day or month:
        return not month
    steps = [_longest_step(shown, first) for first in (True, False)]
    if min(steps) > DAY:
        raise SceneError(
            f"{where} must have dates whose day and month can be told apart, but `{dates[0][0]}` may be either: write them as 2024-12-31."
        )
    return steps[0] <= steps[1]


def _longest_step(shown: Sequence[str], first_is_day: bool) -> float:
    """Longest time [s] between rows that follow each other, where dates are read with the day, or the month, first."""
    found = np.array([_seconds(text.strip(), first_is_day) for text in shown])
    return float(np.abs(np.diff(found[np.isfinite(found)])).max(initial=0.0))


def _text(cell: Any) -> str:
    if isinstance(cell, np.datetime64):
        return "" if np.isnat(cell) else str(cell.astype("datetime64[us]"))
    if isinstance(cell, (datetime.datetime, datetime.date, datetime.time)) and cell == cell:
        return cell.isoformat()
    return "" if cell is None or cell != cell else str(cell)


def _clock(text: str) -> float:
    match = _CLOCK.fullmatch(text.strip())
    if match is None:
        return np.nan
    hour = int(match[1]) % 12 + 12 * (match[4].lower() == "pm") if match[4] else int(match[1])
    return 3600.0 * hour + 60.0 * int(match[2]) + float((match[3] or "0").replace(",", "."))


def _seconds(text: str, first_is_day: bool) -> float:
    if _CLOCK.fullmatch(text):
        return _clock(text)
    match = _DATE.fullmatch(text)
    if match is not None:
        day, month = (int(match[1]), int(match[3])) if first_is_day else (int(match[3]), int(match[1]))
        year = int(match[4]) + (2000 if len(match[4]) == 2 else 0)
        try:
            midnight = datetime.datetime(year, month, day, tzinfo=datetime.UTC).timestamp()
        except ValueError:
            return np.nan
        return midnight + (_clock(match[5]) if match[5] else 0.0)
    text = re.sub(r"([.,]\d{6})\d+", r"\1", text.replace(",", ".")).replace(" UTC", "Z")
    try:
        moment = datetime.datetime.fromisoformat(text)
    except ValueError:
        return np.nan
    return (moment if moment.tzinfo else moment.replace(tzinfo=datetime.UTC)).timestamp()


def epoch(numbers: np.ndarray) -> float | None:
    """Seconds of one count, where numbers count from 1970; None for others."""
    finite = numbers[np.isfinite(numbers)]
    middle = float(np.median(finite)) if finite.size else 0.0
    return next((size for low, high, size in EPOCHS if low < middle < high), None)
