"""Numbers of laws and inputs as text, in the units of a question."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from toolbox.files.unit_systems import reading
from toolbox.files.units import is_finite_number
from toolbox.modelling.components import fields_of, is_nested
from toolbox.modelling.inputs import UNITS, Shape, Table
from toolbox.modelling.laws import Controller


def numbers_of(law: Controller, display_units: Mapping[str, str]) -> str:
    """The numbers of a law, and of the laws and observers inside of it, each under its name."""
    words = []
    for each in fields_of(type(law)):
        value = getattr(law, each.name)
        if each.numeric and value is not None and not isinstance(value, tuple):
            words.append(f"{each.name} {_with_unit(value, each.spec.metadata.get('unit', '1'), display_units, 4)}")
        elif is_nested(value):
            words.append(f"{each.name} {type(value).__name__} ({numbers_of(value, display_units)})")
    return ", ".join(words) or "no numbers"


def given_as(value: Any, unit: str, display_units: Mapping[str, str]) -> str | None:
    """Return the text of a number, or of a shape in time with its numbers; None for any other value."""
    if is_finite_number(value):
        return _with_unit(value, unit, display_units, 6)
    if isinstance(value, (Table, Shape)) and value.shape:
        told = (f"{key} {_with_unit(each, UNITS[value.shape][key] or unit, display_units, 6)}" for key, each in value.numbers.items())
        return f"{value.shape} ({', '.join(told)})"
    return None


def _with_unit(value: float, unit: str, display_units: Mapping[str, str], digits: int) -> str:
    read = reading(unit, display_units)
    told = f"{value * read.factor:.{digits}g}"
    plain = "e+" in told and abs(value * read.factor) < 1e7  # 20000 N/s in place of 2e+04 N/s
    return (f"{value * read.factor:.0f}" if plain else told) + read.tail
