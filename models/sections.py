"""Sections of a drill string: pipes of one size in a row, with their material, from a table."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from models.pipe_sizes import inner_diameter
from toolbox import SceneError
from toolbox.authoring import Column, NumberOrText, Renamed, Table, in_si, is_finite_number, number, read_table, suggest


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
class ToolJoint(Renamed):
    """Tool joints of a drill pipe: the thicker ends (box and pin) by which two joints of pipe are screwed together.

    Parameters
    ----------
    outer, inner
        Diameters [m], or text with units.
    length
        Length of box and pin together [m].
    every
        Length of a joint of pipe from shoulder to shoulder [m], which is the distance between two tool joints.

    Raises
    ------
    SceneError
        If a number is not positive and finite, the inner diameter is not below the outer diameter, or the length is not
        below the distance.

    Examples
    --------
    >>> from models import Section, ToolJoint
    >>> joint = ToolJoint(outer="6.625 in", inner="3.5 in", length="21 in", every="30 ft")
    >>> pipe = Section(length="1000 m", outer="5 in", inner="4.276 in", tool_joint=joint)
    >>> print(f"{joint.length_fraction:.3f} of the length, contact radius {pipe.contact_radius * 1e3:.1f} mm")
    0.058 of the length, contact radius 84.1 mm
    """

    outer: NumberOrText
    inner: NumberOrText
    length: NumberOrText
    every: NumberOrText = 9.6

    def __post_init__(self) -> None:
        _in_si(self, ("outer", "inner", "length", "every"))
        for larger, smaller in (("outer", "inner"), ("every", "length")):
            number(smaller, getattr(self, smaller), "m", above=0, below=number(larger, getattr(self, larger), "m", above=0))

    @property
    def length_fraction(self) -> float:
        """Fraction of the string length that consists of tool joints [1]."""
        return self.length / self.every


@dataclass(frozen=True)
class Section(Renamed):
    """Section of a drill string: pipe of one size, optionally with tool joints.

    Textbook values of a circular tube:

        A = pi (OD^2 - ID^2) / 4,   J = pi (OD^4 - ID^4) / 32,   c = sqrt(G / rho),   zeta = J sqrt(G rho)

    A is the cross-sectional area [m2], J the polar second moment of area [m4], c the speed of torsional waves [m/s], and
    zeta their impedance [N m s/rad], torque divided by speed of rotation. OD and ID are outer and inner diameter [m], G is
    the shear modulus [Pa] and rho the density [kg/m3]. With tool joints, which are a fraction q of the length, A,
    inertia and torsional compliance are averages, for waves much longer than a joint of pipe. Only the tool joints
    touch the borehole.

        A = (1 - q) A_pipe + q A_joint,   rho J = rho ((1 - q) J_pipe + q J_joint),   1 / G J = ((1 - q) / J_pipe + q / J_joint) / G

    Parameters
    ----------
    length, outer, inner
        Length, outer and inner diameter of the pipe [m], or text with units. The inner diameter of an API drill pipe is
        `inner_diameter("5 in", "19.5 lb/ft")`.
    density, shear_modulus
        Density [kg/m3] and shear modulus G [Pa] of the material.
    mass_per_length
        Mass per length in air [kg/m] with upsets and tool joints, as in catalogues ("adjusted weight"), or text such as
        "23.5 lb/ft" or "23.5 ppf". By default it follows from the diameters. If the given mass is larger than the mass
        that follows from the diameters, the difference is assumed to rotate at the same radius of gyration.
    tool_joint
        Tool joints of the section, a `ToolJoint`. By default None: a pipe without tool joints.

    Raises
    ------
    SceneError
        If a number is not positive and finite (the inner diameter may be 0), or the inner diameter is not below the
        outer diameter.

    Examples
    --------
    >>> from models import Section
    >>> pipe = Section(length="30 ft", outer="5 in", inner="4.276 in")
    >>> print(f"{pipe.length:.3f} m, outer diameter {pipe.outer * 1e3:.0f} mm")
    9.144 m, outer diameter 127 mm
    """

    length: NumberOrText
    outer: NumberOrText
    inner: NumberOrText
    density: NumberOrText = MATERIALS["steel"].density
    shear_modulus: NumberOrText = MATERIALS["steel"].shear_modulus
    mass_per_length: NumberOrText | None = None
    tool_joint: ToolJoint | None = None

    def __post_init__(self) -> None:
        _in_si(self, UNITS)
        fault = _fault(vars(self))
        if fault:
            raise SceneError(f"Argument `{fault[0]}` of Section: {fault[1]}")
        if not isinstance(self.tool_joint, ToolJoint | None):
            raise SceneError(f"Argument `tool_joint` of Section: it must be a ToolJoint, but it is {self.tool_joint!r}.")

    @property
    def area(self) -> float:
        """Cross-sectional area of the metal [m2], the mean along the section."""
        pipe = math.pi * (self.outer**2 - self.inner**2) / 4
        joint = self.tool_joint
        return (
            pipe
            if joint is None
            else (1 - joint.length_fraction) * pipe + joint.length_fraction * math.pi * (joint.outer**2 - joint.inner**2) / 4
        )

    @property
    def polar_moment(self) -> float:
        """Polar second moment of area J of the pipe between its tool joints [m4]."""
        return _polar_moment(self)

    @property
    def inertia_per_length(self) -> float:
        """Rotational inertia per length, rho J [kg m]."""
        joint, inertia = self.tool_joint, self.density * self.polar_moment
        if joint is not None:
            inertia = (1 - joint.length_fraction) * inertia + joint.length_fraction * self.density * _polar_moment(joint)
        return inertia if self.mass_per_length is None else inertia * self.mass_per_length / (self.density * self.area)

    @property
    def torsional_rigidity(self) -> float:
        """Torsional rigidity G J [N m2]."""
        joint, pipe = self.tool_joint, self.shear_modulus * self.polar_moment
        return (
            pipe
            if joint is None
            else 1 / ((1 - joint.length_fraction) / pipe + joint.length_fraction / (self.shear_modulus * _polar_moment(joint)))
        )

    @property
    def wave_speed(self) -> float:
        """Speed of torsional waves, c [m/s]."""
        return math.sqrt(self.torsional_rigidity / self.inertia_per_length)

    @property
    def impedance(self) -> float:
        """Torsional wave impedance zeta, torque divided by speed of rotation [N m s/rad]."""
        return math.sqrt(self.torsional_rigidity * self.inertia_per_length)

    @property
    def contact_radius(self) -> float:
        """Radius that touches the borehole [m]: the radius of the tool joints if the section has tool joints, else of the pipe."""
        return (self.outer if self.tool_joint is None else max(self.outer, self.tool_joint.outer)) / 2

    def weight(self, mud_density: float = 0.0) -> float:
        """Return the weight per length (rho - rho_mud) g A [N/m] with mud inside and outside of the pipe.

        rho is the density of the pipe, A its cross-sectional area and g = 9.80665 m/s2.

        Parameters
        ----------
        mud_density
            Density of the mud rho_mud [kg/m3], by default 0 (no mud).
        """
        metal = self.area if self.mass_per_length is None else self.mass_per_length / self.density
        return (self.density - mud_density) * 9.80665 * metal


def _polar_moment(tube: Section | ToolJoint) -> float:
    return math.pi * (tube.outer**4 - tube.inner**4) / 32


UNITS = {"length": "m", "outer": "m", "inner": "m", "density": "kg/m3", "shear_modulus": "Pa", "mass_per_length": "kg/m"}


def _in_si(tube: Section | ToolJoint, names: Iterable[str]) -> None:
    """Set fields that were given as text to their numbers in SI."""
    for name in names:
        object.__setattr__(tube, name, in_si(getattr(tube, name), UNITS.get(name, "m"), name))


def _fault(values: Mapping[str, Any]) -> tuple[str, str] | None:
    """(field, what it must be) of the first mistake in the fields of a section."""
    for name, unit in UNITS.items():
        value: Any = values.get(name)
        if name == "mass_per_length" and value is None:
            continue
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
    Column("ID", "m", ("inner diameter",), required=False, blank=True),
    Column("nominal weight", "kg/m", required=False, blank=True),
    Column("weight", "kg/m", ("adjusted weight",), required=False, blank=True),
    Column("tool joint OD", "m", required=False, blank=True),
    Column("tool joint ID", "m", required=False, blank=True),
    Column("tool joint length", "m", required=False, blank=True),
    Column("joint length", "m", required=False, blank=True),
    Column("material", None, required=False),
    Column("density", "kg/m3", required=False),
    Column("shear modulus", "Pa", required=False),
    Column("name", None, required=False),
)
"""What a table of sections may have; either `length`, or `from` and `to`; either `material`, or `density` and `shear modulus`; `ID` or `nominal weight`."""

_COLUMN_OF = {"outer": "OD", "inner": "ID", "shear_modulus": "shear modulus", "mass_per_length": "weight"}


JOINT_COLUMNS = {"outer": "tool joint OD", "inner": "tool joint ID", "length": "tool joint length", "every": "joint length"}
"""{field of a tool joint: its column}; who gives one gives all."""


def read_sections(path: str | Path) -> tuple[Section, ...]:
    r"""Read the sections of a drill string from a CSV or TOML table, top first.

    Columns:

    - `length [m]`; or `from [m]` and `to [m]`, measured depths without gaps.
    - `OD [m]` and `ID [m]`. An API drill pipe may have `nominal weight [lb/ft]` instead of `ID`.
    - `material`, a name of MATERIALS; or `density [kg/m3]` and `shear modulus [Pa]`.
    - `name` (optional).
    - `weight [lb/ft]` (optional): weight in air of pipe with upsets and tool joints.
    - `tool joint OD [in]`, `tool joint ID [in]`, `tool joint length [in]` and `joint length [ft]` (optional).

    Cells of `weight` and of the four columns of tool joints may be empty. Other units are possible, and the order of
    columns is free.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    tuple of Section
        The sections.

    Raises
    ------
    SceneError
        If the table cannot be read; the message names file, row and column.

    Examples
    --------
    >>> from pathlib import Path
    >>> from models import read_sections
    >>> path = Path("string.csv")
    >>> _ = path.write_text("length [m],OD [in],ID [in],material\n3500,5,4.276,steel\n200,6.75,2.8125,steel\n")
    >>> for section in read_sections(path):
    ...     print(f"{section.length:.0f} m, outer diameter {section.outer * 1e3:.1f} mm")
    3500 m, outer diameter 127.0 mm
    200 m, outer diameter 171.4 mm
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
        values = {
            "length": length,
            "outer": row["OD"],
            "inner": _inner(table, i, row),
            "mass_per_length": row.get("weight"),
        } | material._asdict()
        fault = _fault(values)
        if fault:
            raise table.error(i, length_column if fault[0] == "length" else _COLUMN_OF.get(fault[0], fault[0]), fault[1])
        sections.append(Section(**values, tool_joint=_tool_joint(table, i, row)))
    return tuple(sections)


def _one_of(table: Table, i: int, row: Mapping[str, Any], first: str, pair: tuple[str, str]) -> None:
    """A row must have one column, or instead of it a pair of columns."""
    count = sum(name in row for name in pair)
    if (first in row) != (count == 0) or count == 1:
        raise table.error(i, first, f"a row must have either `{first}` or `{pair[0]}` and `{pair[1]}`.")


def _inner(table: Table, i: int, row: Mapping[str, Any]) -> float:
    """The inner diameter of a row, as it is given or by the nominal weight."""
    if ("ID" in row) == ("nominal weight" in row):
        raise table.error(i, "ID", "a row must have either `ID` or `nominal weight`.")
    if "ID" in row:
        return float(row["ID"])
    try:
        return inner_diameter(row["OD"], row["nominal weight"])
    except SceneError as error:
        raise table.error(i, "nominal weight", str(error)) from None


def _tool_joint(table: Table, i: int, row: Mapping[str, Any]) -> ToolJoint | None:
    """The tool joints of a row; None where it has no column of them."""
    given = {field: row[column] for field, column in JOINT_COLUMNS.items() if column in row}
    missing = next((column for field, column in JOINT_COLUMNS.items() if given and field not in given), None)
    if missing:
        raise table.error(i, missing, f"a row with a tool joint must have {', '.join(f'`{each}`' for each in JOINT_COLUMNS.values())}.")
    try:
        return ToolJoint(**given) if given else None
    except SceneError as error:
        raise table.error(i, "tool joint OD", str(error)) from None


def sections_of(given: Path | str | Sequence[Section]) -> tuple[Section, ...]:
    """Sections that are given as values or by their table. Raises SceneError for anything else."""
    if isinstance(given, (str, Path)):
        return read_sections(given)
    sections = tuple(section for section in given if isinstance(section, Section)) if isinstance(given, Sequence) else ()
    if not sections or len(sections) < len(given):
        raise SceneError(f"Argument `sections` must be the path of a table or Sections, top first, but it is {given!r}.")
    return sections
