"""Units in which reports, tables and figures answer: SI, metric field units or US oilfield units. Numbers in Python and in files stay SI."""

from __future__ import annotations

from contextvars import ContextVar
from functools import cache
from typing import Any, NamedTuple

from toolbox.errors import SceneError, suggest
from toolbox.files.units import parse

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

_SYSTEM: ContextVar[str] = ContextVar("units", default="si")


class units:
    """Choose the units in which reports, tables and figures answer: `with units("oilfield"): print(found)`, or `units("metric")` from here on.

    Only what is read changes: numbers that Python gets, axes as matplotlib knows them, and files stay SI.

    Parameters
    ----------
    system
        "si", "metric" (rpm, kN, kN m, bar) or "oilfield" (rpm, klbf, klbf ft, ft, psi).

    Raises
    ------
    SceneError
        If there is no such system.
    """

    def __init__(self, system: str):
        if not isinstance(system, str) or system not in SYSTEMS:
            raise SceneError(f"There is no system of units `{system}`: {suggest(str(system), SYSTEMS)}")
        self._before = _SYSTEM.set(system)

    def __enter__(self) -> units:
        return self

    def __exit__(self, *_: Any) -> None:
        _SYSTEM.reset(self._before)


class Reading(NamedTuple):
    """The unit in which numbers are read, and the factor that takes them there."""

    factor: float
    unit: str

    @property
    def tail(self) -> str:
        """The unit with a space before it; nothing for a plain number."""
        return "" if self.unit == "1" else f" {self.unit}"


def reading(unit: str) -> Reading:
    """How numbers in a unit of the toolbox are read in the chosen system."""
    other = SYSTEMS[_SYSTEM.get()].get(unit)
    return Reading(1.0, unit) if other is None else Reading(1.0 / _size(other, unit), other)


@cache
def _size(other: str, unit: str) -> float:
    return parse(f"1 {other}", unit)
