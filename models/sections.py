"""Sections of a drill string: pipes of one size in a row, with their material, from a table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from toolbox import SceneError
from toolbox.authoring import Column, Table, is_finite_number, read_table, suggest


class Material(NamedTuple):
    """Density rho [kg/m3] and shear modulus G [Pa]."""

    density: float
    shear_modulus: float


MATERIALS = {
    "steel": Material(7850.0, 79.3e9),
    "aluminium": Material(2780.0, 27.0e9),
    "titanium": Material(4430.0, 44.0e9),
}
"""Materials by name, with textbook values; a table may give `density` and `shear modulus` instead."""


@dataclass(frozen=True)
class Section:
    """A run of pipe of one size; diameters, SI units. Textbook values of a circular tube:

        A = pi (OD^2 - ID^2) / 4,   J = pi (OD^4 - ID^4) / 32,   c = sqrt(G / rho),   zeta = J sqrt(G rho)

    Raises SceneError where a number is no positive finite number (the inner diameter may be 0) or the inner diameter is not below the outer one.
    """

    length: float
    outer: float
    inner: float
    density: float = MATERIALS["steel"].density
    shear_modulus: float = MATERIALS["steel"].shear_modulus

    def __post_init__(self) -> None:
        fault = _fault(vars(self))
        if fault:
            raise SceneError(f"Argument `{fault[0]}` of Section: {fault[1]}")

    @property
    def area(self) -> float:
        """Area of the metal [m2]."""
        return math.pi * (self.outer**2 - self.inner**2) / 4

    @property
    def polar_moment(self) -> float:
        """Polar second moment J of the metal [m4]."""
        return math.pi * (self.outer**4 - self.inner**4) / 32

    @property
    def inertia(self) -> float:
        """Inertia per length, rho J [kg m]."""
        return self.density * self.polar_moment

    @property
    def rigidity(self) -> float:
        """Torsional rigidity G J [N m2]."""
        return self.shear_modulus * self.polar_moment

    @property
    def wave_speed(self) -> float:
        """Speed of torsional waves c [m/s]."""
        return math.sqrt(self.shear_modulus / self.density)

    @property
    def impedance(self) -> float:
        """Torsional impedance zeta = torque / speed of a wave [N m s/rad]."""
        return self.polar_moment * math.sqrt(self.shear_modulus * self.density)

    def weight(self, mud_density: float = 0.0) -> float:
        """Weight per length in mud of that density inside and outside, (rho - rho_mud) g A [N/m]; g = 9.80665 m/s2."""
        return (self.density - mud_density) * 9.80665 * self.area


def _fault(values: Mapping[str, Any]) -> tuple[str, str] | None:
    """(field, what it must be) of the first mistake in the fields of a section."""
    for name, unit in (("length", "m"), ("outer", "m"), ("inner", "m"), ("density", "kg/m3"), ("shear_modulus", "Pa")):
        value = values[name]
        if not is_finite_number(value):
            return name, f"it must be a finite number, but it is {value!r}."
        if name == "inner" and value < 0:
            return name, f"it must be >= 0 m, but it is {value:g} m."
        if name == "inner" and value >= values["outer"]:
            return name, f"it must be smaller than the outer diameter {values['outer']:g} m, but it is {value:g} m."
        if name != "inner" and value <= 0:
            return name, f"it must be > 0 {unit}, but it is {value:g} {unit}."
    return None


COLUMNS = (
    Column("length", "m", required=False),
    Column("from", "m", required=False),
    Column("to", "m", required=False),
    Column("OD", "m", ("outer diameter",)),
    Column("ID", "m", ("inner diameter",)),
    Column("material", None, required=False),
    Column("density", "kg/m3", required=False),
    Column("shear modulus", "Pa", required=False),
    Column("name", None, required=False),
)
"""What a table of sections may have; either `length`, or `from` and `to`; either `material`, or `density` and `shear modulus`."""

_COLUMN_OF = {"outer": "OD", "inner": "ID", "shear_modulus": "shear modulus"}


def read_sections(path: str | Path) -> tuple[Section, ...]:
    """Read the sections of a string from a CSV or TOML table, top first.

    Columns are `length [m]`, or `from [m]` and `to [m]` (measured depths, without gaps); `OD [m]`, `ID [m]`; `material` (a name of MATERIALS), or `density
    [kg/m3]` and `shear modulus [Pa]`; and optionally `name`. Units may differ, and the order is free. Raises SceneError naming file, row and column.
    """
    table = read_table(path, COLUMNS)
    sections: list[Section] = []
    bottom = 0.0
    for i, row in enumerate(table):
        _one_of(table, i, row, "length", ("from", "to"))
        _one_of(table, i, row, "material", ("density", "shear modulus"))
        length_column = "length" if "length" in row else "to"
        if "from" in row:
            if abs(row["from"] - bottom) > 1e-6:
                kind = "a gap" if row["from"] > bottom else "an overlap"
                raise table.error(i, "from", f"it must be {bottom:g} m, where the row before ends, but it is {row['from']:g} m: {kind}.")
            bottom = row["to"]
        length = row["length"] if "length" in row else row["to"] - row["from"]
        if "material" in row:
            if row["material"] not in MATERIALS:
                raise table.error(i, "material", f"there is no material `{row['material']}`: {suggest(row['material'], MATERIALS)}")
            material = MATERIALS[row["material"]]
        else:
            material = Material(row["density"], row["shear modulus"])
        values = {"length": length, "outer": row["OD"], "inner": row["ID"]} | material._asdict()
        fault = _fault(values)
        if fault:
            raise table.error(i, length_column if fault[0] == "length" else _COLUMN_OF.get(fault[0], fault[0]), fault[1])
        sections.append(Section(**values))
    return tuple(sections)


def _one_of(table: Table, i: int, row: Mapping[str, Any], first: str, pair: tuple[str, str]) -> None:
    """A row must have one column, or instead of it a pair of columns."""
    count = sum(name in row for name in pair)
    if (first in row) != (count == 0) or count == 1:
        raise table.error(i, first, f"a row must have either `{first}` or `{pair[0]}` and `{pair[1]}`.")
