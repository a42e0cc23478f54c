"""Dates and times of day as rigs write them, and the order of day, month and year that a column settles, or that its heading declares."""

from __future__ import annotations

import contextlib
import datetime
import re
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from toolbox.errors import SceneError

DAY = 86_400.0

MONTHS = {
    "jan": 1, "feb": 2, "fév": 2, "fev": 2, "mar": 3, "mär": 3, "mrz": 3, "apr": 4, "avr": 4, "abr": 4, "may": 5, "mai": 5, "jun": 6, "juin": 6, "jul": 7,
    "juil": 7, "aug": 8, "aoû": 8, "aou": 8, "ago": 8, "sep": 9, "set": 9, "oct": 10, "okt": 10, "out": 10, "nov": 11, "dec": 12, "dez": 12, "des": 12,
    "déc": 12, "dic": 12,
}  # fmt: skip
"""{how the name of a month begins, in small letters: its number}."""

UNDERSTOOD = (
    "2024-12-31 23:59:59.5, 2024/12/31 23:59:59, 31/12/2024 23:59:59, 31/12/2024-23:59:59, 31.12.2024 23:59:59, 12/31/2024 11:59:59 PM, "
    "31-Dec-2024 23:59:59, 31-Dec-24, Dec 31 2024 23:59:59, 20241231 235959, 23:59:59"
)
"""Forms of a time that are read, as messages list them."""

ORDERS = ("day-month-year", "month-day-year", "year-month-day")
"""Orders in which a date of two or three numbers may be written."""

_CLOCK = r"(?P<hour>\d{1,2}):(?P<minute>[0-5]\d)(?::(?P<second>[0-6]\d(?:[.,]\d+|:\d{3})?))?\s*(?P<half>[ap]\.?m\.?(?![a-z]))?"
_ZONE = r"\s*(?P<zone>Z|UTC|GMT|[+-]\d{2}:?\d{2}|[+-]\d{2}(?!\d))?"
_MONTH = rf"(?P<month>(?:{'|'.join(sorted(MONTHS, key=len, reverse=True))})[^\W\d_]*)\.?"
_DATES = (
    r"(?P<y>\d{4})(?P<mark>[-/.])(?P<m>\d{1,2})(?P=mark)(?P<d>\d{1,2})",
    r"(?P<one>\d{1,2})(?P<mark>[-/.])(?P<two>\d{1,2})(?P=mark)(?P<three>\d{4}|\d{2})(?!\d)",
    rf"(?P<d>\d{{1,2}})(?:[-/ ]|\.\s?)?{_MONTH}[-/ ,]{{0,2}}(?P<y>\d{{4}}|\d{{2}})(?!\d)",
    rf"{_MONTH}[-/ ]?(?P<d>\d{{1,2}})(?:st|nd|rd|th)?[-/ ,]{{1,2}}(?P<y>\d{{4}})",
    rf"(?P<y>\d{{4}})[-/ ]{_MONTH}[-/ ](?P<d>\d{{1,2}})",
)
_WEEKDAY = r"(?:(?:mon|tue|wed|thu|fri|sat|sun)[a-z]*\.?,?\s+)?"
_MOMENTS = [
    re.compile(form, re.IGNORECASE)
    for date in _DATES
    for form in (rf"{_WEEKDAY}{date}(?:(?:[ T_,-]+|:){_CLOCK}{_ZONE})?", rf"{_CLOCK}[ ,]+{_WEEKDAY}{date}")
] + [re.compile(rf"{_WEEKDAY}{_MONTH}\s+(?P<d>\d{{1,2}})\s+{_CLOCK}{_ZONE}\s+(?P<y>\d{{4}})", re.IGNORECASE)]
_TIME_OF_DAY = re.compile(_CLOCK, re.IGNORECASE)
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d{1,3})?")
_DECLARED = re.compile(r"(?:y{4}|yy|y{1}|m{1,3}|d{1,2}|h{1,2}|s{1,2}|[-/.: _t,]|\.?f+|am/pm|am|tt|z)+", re.IGNORECASE)
_WORDS = ("datetime", "date", "time", "date time", "date/time", "date-time", "iso", "iso8601", "iso 8601", "timestamp", "utc", "date&time")


class _Moment(NamedTuple):
    """One cell: the numbers of its date (None for a time of day), whose order is known or open, its seconds of the day, and seconds of its zone."""

    date: tuple[int, ...] | None
    known: bool
    mark: str
    clock: float | None
    zone: float | None


def is_format(unit: str | None) -> bool:
    """Return whether the text in place of a unit names dates or times, such as `datetime`, `hh:mm:ss` or `DD/MM/YYYY`."""
    text = "" if unit is None else unit.strip().lower()
    letters = re.sub("[^a-z]", "", text)
    return text in _WORDS or (len(letters) > 3 and _DECLARED.fullmatch(text) is not None and ("h" in letters or "y" in letters))


def digits_of(unit: str | None) -> str | None:
    """Return the declared format of times that are written as digits alone, such as `HHMMSS` or `YYYYMMDDHHMMSS`; None for any other text."""
    text = "" if unit is None else re.sub("[ _]", "", unit.strip().lower())
    return text if re.fullmatch(r"(?:(?:yyyy|yy)mmdd|ddmm(?:yyyy|yy))?hhmm(?:ss)?", text) else None


def are_clock_digits(cells: Sequence[str]) -> bool:
    """Return whether digits that count as seconds are rather times of day as HHMMSS: at least ten over more than a minute, and no pair is 60 or more."""
    parts = [re.fullmatch(r"(\d\d[0-5]\d)[0-5]\d", cell) for cell in cells]
    return len(cells) >= 10 and all(parts) and len({part[1] for part in parts if part}) > 1


def is_time(cell: Any) -> bool:
    """Return whether a cell is a date or a time of day."""
    return isinstance(cell, (datetime.datetime, datetime.date, datetime.time, np.datetime64)) or _moment(str(cell).strip()) is not None


def has_clock(cell: Any) -> bool:
    """Return whether a cell is a time of day without a date."""
    return isinstance(cell, datetime.time) or _TIME_OF_DAY.fullmatch(str(cell).strip()) is not None


def has_date(cell: Any) -> bool:
    """Return whether a cell is a date without a time of day."""
    if isinstance(cell, datetime.datetime):
        return cell.time() == datetime.time()
    if isinstance(cell, datetime.date):
        return True
    found = _moment(str(cell).strip())
    return found is not None and found.date is not None and found.clock is None


def seconds_of(cells: Sequence[Any], where: str, declared: str | None = None) -> tuple[np.ndarray, str]:
    """Return times [s] of dates or times of day, and a note on how they were read.

    Parameters
    ----------
    cells
        Text, or dates of Python or numpy, shape (n,).
    where
        The column, as an error names it.
    declared
        Format that heading or caller declare, such as `DD/MM/YYYY` or `HHMMSS`.

    Returns
    -------
    times
        Seconds since 1970, or since midnight for times of day, shape (n,); nan for a cell without a time.
    note
        How they were read.

    Raises
    ------
    SceneError
        If neither the declared format nor the column settles the order of day, month and year, or some times have a zone and others have none.
    """
    shown = [(cell if isinstance(cell, str) else _text(cell)).strip() for cell in cells]
    if (
        (digits := digits_of(declared)) is not None
        and (numbers := [text for text in shown if text])
        and all(_NUMBER.fullmatch(text) for text in numbers)
    ):
        return _past_midnight(*_of_digits(shown, digits, where), "y" in digits)
    found = [_moment(text) for text in shown]
    moments = [moment for moment in found if moment is not None]
    zones = {moment.zone is not None for moment in moments if moment.clock is not None and moment.date is not None}
    if len(zones) > 1:
        raise SceneError(f"{where} must have times all with a zone or all without, but some have one: write all in UTC.")
    clock = np.array([np.nan if moment is None else (moment.clock or 0.0) - (moment.zone or 0.0) for moment in found])
    if all(moment.date is None for moment in moments):
        return _past_midnight(clock, "time of day", False)
    dates = {moment.date for moment in moments if moment.date is not None and not moment.known}
    order, note = "", ""
    if dates:
        marks = {moment.mark for moment in moments if moment.date is not None and not moment.known}
        order, note = _order_of(found, clock, dates, marks, where, declared, shown)
    days = np.array([_day(moment, order) for moment in found])
    return DAY * days + clock, ("dates with a zone" if zones == {True} else "dates without a zone") + note


def _past_midnight(times: np.ndarray, words: str, dated: bool) -> tuple[np.ndarray, str]:
    """Times of day that go on past midnight, in either direction of the table."""
    if dated:
        return times, words
    good = np.flatnonzero(np.isfinite(times))
    steps = np.diff(times[good])
    upward = not steps.size or float(np.median(steps)) >= 0.0
    over = np.flatnonzero(steps < -DAY / 2 if upward else steps > DAY / 2)
    times = times.copy()
    for k in over.tolist():
        times[good[k + 1] :] += DAY if upward else -DAY
    return times, words + (f", past midnight {over.size} time(s)" if over.size else "")


def _of_digits(shown: Sequence[str], digits: str, where: str) -> tuple[np.ndarray, str]:
    """Times in digits alone by their declared format; leading zeros may be missing."""
    places = {letter: digits.index(letter) for letter in "ydhs" if letter in digits}
    width = {letter: digits.count(letter) for letter in "ydhs" if letter in digits}
    minute = places["h"] + 2

    def read(text: str) -> float:
        if not text:
            return np.nan
        whole, _, part = text.partition(".")
        whole = whole.zfill(len(digits))
        second = float(whole[places["s"] : places["s"] + 2] + "." + (part or "0")) if "s" in places else 0.0
        if not whole.isdecimal() or len(whole) != len(digits) or int(whole[minute : minute + 2]) > 59 or second >= 61:
            raise ValueError
        clock = 3600.0 * int(whole[places["h"] : minute]) + 60.0 * int(whole[minute : minute + 2]) + second
        if "y" not in places:
            return clock
        year, day = (int(whole[places[letter] : places[letter] + width[letter]]) for letter in "yd")
        month = int(whole[digits.index("mm") : digits.index("mm") + 2])
        return DAY * _ordinal(year + (2000 if width["y"] == 2 else 0), month, day) + clock

    times = np.empty(len(shown))
    for k, text in enumerate(shown):
        try:
            times[k] = read(text)
        except ValueError:
            raise SceneError(f"{where} must hold times as {digits.upper()}, as was declared, but it holds `{text}`.") from None
    return times, f"{digits.upper()}, as declared"


def _order_of(
    found: Sequence[_Moment | None],
    clock: np.ndarray,
    dates: set[Any],
    marks: set[str],
    where: str,
    declared: str | None,
    shown: Sequence[str],
) -> tuple[str, str]:
    """(order of the numbers of dates such as 03/04/2024, words about it). Raises SceneError where nothing settles it."""
    short = any(date[2] < 100 for date in dates)
    orders = list(ORDERS if short else ORDERS[:2])
    if (said := _declared_order(declared)) is not None:
        orders = [said]
    example = next(text for text, moment in zip(shown, found, strict=True) if moment is not None and moment.date in dates)
    days = {order: {date: _day(_Moment(date, False, "", None, None), order) for date in dates} for order in orders}
    valid = [order for order in orders if not np.isnan(list(days[order].values())).any()]
    if not valid:
        what = f"dates as {declared}, as was declared" if said is not None else "dates whose day, month and year stand in one order"
        strange = next(
            (text for text, m in zip(shown, found, strict=True) if m is not None and m.date in dates and np.isnan(days[orders[0]][m.date])),
            example,
        )
        raise SceneError(f"{where} must hold {what}, but no order fits all, `{strange}` among them: write them as 2024-12-31.")
    if said is not None or len(valid) == 1:
        return valid[0], ""
    if "." in marks and len(marks) == 1 and not short and ORDERS[0] in valid:
        return ORDERS[0], ""  # with points the day stands first everywhere
    times = {order: DAY * np.array([_day(moment, order) for moment in found]) + clock for order in valid}
    steps = {order: np.diff(values[np.isfinite(values)]) for order, values in times.items()}
    first = steps[valid[0]]
    if all(np.array_equal(first, each) for each in steps.values()):
        return valid[0], f"; day and month of `{example}` may be either, which changes no time between rows"
    near = [order for order in valid if np.abs(steps[order]).max(initial=0.0) <= DAY]
    ordered = near or [order for order in valid if (steps[order] >= 0).all() or (steps[order] <= 0).all()]
    if len(ordered) == 1:
        return ordered[0], ""
    raise SceneError(
        f"{where} must have dates whose day and month can be told apart, but `{example}` may be either: say which by a format in place of a unit where you say "
        "which column is `time`, such as `Time [DD/MM/YYYY]` or `Time [MM/DD/YYYY]` (in Python `columns`, on the command line --column), "
        "or write them as 2024-12-31."
    )


def _declared_order(declared: str | None) -> str | None:
    """The order of day, month and year that a format such as `DD/MM/YYYY` declares."""
    if not is_format(declared):
        return None
    date = re.split("[ t]?h", str(declared).lower())[0] if str(declared).lower().startswith(("y", "d", "m")) else str(declared).lower()
    places = [(date.find(letter), name) for letter, name in (("d", "day"), ("m", "month"), ("y", "year"))]
    if any(place < 0 for place, _ in places):
        return None
    order = "-".join(name for _, name in sorted(places))
    return order if order in ORDERS else None


def _text(cell: Any) -> str:
    if isinstance(cell, np.datetime64):
        return "" if np.isnat(cell) else str(cell.astype("datetime64[us]"))
    if isinstance(cell, (datetime.datetime, datetime.date, datetime.time)) and cell == cell:
        return cell.isoformat()
    return "" if cell is None or cell != cell else str(cell)


def _moment(text: str) -> _Moment | None:
    """The time in a text, or None."""
    if ":" in text[1:3] and (match := _TIME_OF_DAY.fullmatch(text)) is not None:
        return _Moment(None, True, "", _clock(match), None)
    if not text or (":" not in text and _NUMBER.fullmatch(text)):
        return None
    for form in _MOMENTS:
        if (match := form.fullmatch(text)) is not None:
            break
    else:
        return _of_iso(text)
    parts = match.groupdict()
    clock = None if parts["hour"] is None else _clock(match)
    zone = _zone(parts["zone"]) if parts.get("zone") else None
    if parts.get("one") is not None:
        return _Moment((int(parts["one"]), int(parts["two"]), int(parts["three"])), False, parts["mark"], clock, zone)
    month = int(parts["m"]) if parts.get("m") else _month(parts["month"])
    year = int(parts["y"]) + (2000 if len(parts["y"]) == 2 else 0)
    if np.isnan(_ordinal(year, month, int(parts["d"]))):
        return None
    return _Moment((year, month, int(parts["d"])), True, "", clock, zone)


def _of_iso(text: str) -> _Moment | None:
    """The time in one of the forms of ISO 8601 beside those of the table above: digits without marks, and weeks."""
    if not re.match(r"\d{4}-?(?:\d{2}-?\d{2}|W\d{2})", text):
        return None
    with contextlib.suppress(ValueError):
        moment = datetime.datetime.fromisoformat(re.sub(r"([.,]\d{6})\d+", r"\1", text.replace(",", ".")).replace(" UTC", "Z"))
        clock = 3600.0 * moment.hour + 60.0 * moment.minute + moment.second + 1e-6 * moment.microsecond
        offset = moment.utcoffset()
        zone = None if offset is None else offset.total_seconds()
        return _Moment((moment.year, moment.month, moment.day), True, "", clock if len(text) > 10 else None, zone)
    return None


def _month(name: str) -> int:
    begins = [word for word in MONTHS if name.lower().startswith(word)]
    return MONTHS[max(begins, key=len)]


def _zone(text: str) -> float:
    if not text.startswith(("+", "-")):
        return 0.0
    digits = text[1:].replace(":", "").ljust(4, "0")
    return (-1.0 if text[0] == "-" else 1.0) * (3600.0 * int(digits[:2]) + 60.0 * int(digits[2:]))


def _clock(match: Any) -> float:
    hour, minute, second, half = match.group("hour", "minute", "second", "half")
    if half:
        hour = int(hour) % 12 + 12 * (half[0] in "pP")
    return 3600.0 * int(hour) + 60.0 * int(minute) + float((second or "0").replace(",", ".").replace(":", "."))


def _day(moment: _Moment | None, order: str) -> float:
    """Days since 1970 of the date of a cell; nan where it has none."""
    if moment is None or moment.date is None:
        return np.nan
    if moment.known:
        return _ordinal(*moment.date)
    numbers = dict(zip(order.split("-"), moment.date, strict=True))
    return _ordinal(numbers["year"] + (2000 if numbers["year"] < 100 else 0), numbers["month"], numbers["day"])


@lru_cache(maxsize=1000)
def _ordinal(year: int, month: int, day: int) -> float:
    """Days from 1970 to a date; nan for none that exists."""
    try:
        return float(datetime.date(year, month, day).toordinal() - 719_163)
    except ValueError:
        return np.nan
