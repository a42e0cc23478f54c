"""Units in which reports, tables and figures answer: those that the question was typed in, or a chosen system. Numbers in Python stay SI, and so do those in
files whose headings say no other unit (`typed`).

A number that was typed remembers its unit (`toolbox.files.units.TypedNumber`). Verbs collect these units, `asked_units`, and hand them to their result as
`asked`; `reading` decides for all reports and figures: a chosen system first, because it is chosen by who reads, then the unit asked in, then SI.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from contextvars import ContextVar
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from toolbox.errors import SceneError
from toolbox.files.units import TypedNumber, parse

SYSTEMS: dict[str, dict[str, str]] = {
    "si": {},
    "metric": {
        "rad": "rev", "rad/s": "rpm", "rad/s2": "rpm/s", "N": "kN", "N/s": "kN/s", "N m": "kN m", "N m/s": "kN m/s", "N m/rad": "kN m/rad",
        "N m s/rad": "kN m s/rad", "N/m": "kN/m", "N s/m": "kN s/m", "Pa": "bar", "W": "kW", "J": "kJ",
    },
    "oilfield": {
        "rad": "rev", "rad/s": "rpm", "rad/s2": "rpm/s", "N": "klbf", "N/s": "klbf/s", "N m": "klbf ft", "N m/s": "klbf ft/s", "N m/rad": "klbf ft/rad",
        "N m s/rad": "klbf ft s/rad", "N/m": "klbf/ft", "N s/m": "klbf s/ft", "m": "ft", "m/s": "ft/s", "m/s2": "ft/s2", "kg": "lb", "kg m2": "lb ft2",
        "kg/m3": "lb/gal", "Pa": "psi", "W": "hp", "J": "lbf ft",
    },
}  # fmt: skip
"""{system: {unit of the toolbox: unit of an answer}}; a unit that is not there stays. Text in these units is understood where quantities are typed."""

_SYSTEM: ContextVar[str | None] = ContextVar("units", default=None)

SIZED = frozenset(("1", "s", "m"))
"""Units that a field of a part is typed in as it suits its own size: a bit of 8.5 in hangs on 2 km of pipe, and is sampled every 10 ms."""


class use_units:
    """Choose the units of reports, tables and figures: `with use_units("oilfield"): print(found)`, or
    `use_units("metric")` for the rest of the program.

    If no system is chosen, results are shown in the units in which the input was given, such as "95 rpm" or "10 kN m",
    and otherwise in SI. The choice changes only what is shown. Numbers returned to Python, matplotlib axes and files
    stay in SI.

    Parameters
    ----------
    system
        "si", "metric" (rpm, kN, kN m, bar) or "oilfield" (rpm, klbf, klbf ft, ft, psi).

    Raises
    ------
    SceneError
        If there is no such system.

    Examples
    --------
    >>> import toolbox
    >>> from models import BitRock, wells
    >>> from toolbox import compose, equilibrium, closed_loop
    >>> rest = equilibrium(closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), inputs={"top.torque": 12e3}))
    >>> with toolbox.use_units("oilfield"):
    ...     print("klbf" in str(rest))
    True
    """

    def __init__(self, system: str):
        if not isinstance(system, str) or system not in SYSTEMS:
            raise SceneError(f"There is no system of units `{system}`: known are {', '.join(f'`{each}`' for each in SYSTEMS)}.")
        self._before = _SYSTEM.set(system)

    def __enter__(self) -> use_units:
        return self

    def __exit__(self, *_: Any) -> None:
        _SYSTEM.reset(self._before)


def chosen() -> str | None:
    """Return the chosen system of units; None if answers use the units of their questions."""
    return _SYSTEM.get()


class Reading(NamedTuple):
    """Unit of shown numbers, and the factor from SI to this unit."""

    factor: float
    unit: str

    @property
    def tail(self) -> str:
        """The unit with a space before it; nothing for a plain number."""
        return "" if self.unit == "1" else f" {self.unit}"


def reading(unit: str, display_units: Mapping[str, str] | None = None) -> Reading:
    """Return factor and unit in which numbers of an SI unit are shown.

    The unit is the unit of the system that was chosen by `toolbox.use_units`. If no system was chosen, it is the unit
    in which values were typed, or the SI unit.

    Parameters
    ----------
    unit
        The SI unit, such as "rad/s".
    display_units
        {SI unit: unit in which values were typed}. By default None: SI.

    Returns
    -------
    Reading
        The factor and the unit.

    Examples
    --------
    >>> from toolbox.authoring import reading
    >>> factor, shown = reading("rad/s", {"rad/s": "rpm"})
    >>> print(f"{10.0 * factor:.1f} {shown}")
    95.5 rpm
    """
    chosen = _SYSTEM.get()
    other = (display_units or {}).get(unit) if chosen is None else SYSTEMS[chosen].get(unit)
    return Reading(1.0, unit) if other in (None, unit) else Reading(1.0 / _size(other, unit), other)


def typed(values: Any, unit: str, display_units: Mapping[str, str]) -> tuple[Any, str]:
    """Numbers in SI in the unit in which they were typed, for a file, and that unit; the chosen system is of no account.

    A number in another unit is rounded to 15 digits, so that 13 bar stay 13 bar.
    """
    other = display_units.get(unit)
    if other in (None, unit):
        return values, unit
    size = _size(other, unit)
    return np.vectorize(lambda value: float(f"{value / size:.15g}"), otypes=[float])(values), other


def reading_of(unit: str, size: float, display_units: Mapping[str, str] | None = None) -> Reading:
    """Return the factor and the unit in which numbers of this size are best read. The unit is chosen by `reading`; large numbers in SI are
    in thousands, such as kN m."""
    factor, shown = reading(unit, display_units)
    large = (
        (shown == unit or shown != (display_units or {}).get(unit))
        and size * factor >= 1e4
        and shown.partition(" ")[0].partition("/")[0] in ("N", "Pa", "W", "J")
    )
    return Reading(factor / 1e3, f"k{shown}") if large else Reading(factor, shown)


def asked_units(*given: Any, fields: Iterable[Any] = ()) -> dict[str, str]:
    """{unit: unit that was typed} of the numbers in arguments of a question; of two that were typed in different units the first counts.

    Reports tell times in seconds, however long a run was asked for. fields: parts and laws, whose typed fields count after all arguments, but for those
    in the units `SIZED`.
    """
    found: dict[str, str] = {}
    for number in _typed(given):
        if number.unit != "s":
            found.setdefault(number.unit, number.display_units)
    for number in _typed(tuple(fields)):
        if number.unit not in SIZED:
            found.setdefault(number.unit, number.display_units)
    return found


def asked_in(given: Any, unit: str) -> str:
    """Return the unit in which a range or a row of numbers was typed, or `unit` if all numbers are plain."""
    return next((number.display_units for number in _typed(given)), unit)


def _typed(given: Any) -> Iterator[TypedNumber]:
    """The numbers that were typed, in arguments, and in the fields of parts and laws."""
    if isinstance(given, TypedNumber):
        yield given
    elif isinstance(given, Mapping):
        yield from _typed(tuple(given.values()))
    elif isinstance(given, (tuple, list)):
        for each in given:
            yield from _typed(each)
    elif dataclasses.is_dataclass(given) and not isinstance(given, type):
        for field in dataclasses.fields(given):
            yield from _typed(getattr(given, field.name, None))


@cache
def _size(other: str, unit: str) -> float:
    return parse(f"1 {other}", unit)
