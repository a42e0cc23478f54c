"""Friction factors of a borehole from the hook loads and the torque that a rig has measured on the way down."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from models.friction_factors import FrictionFactors
from models.sections import Section, sections_of
from models.survey import Survey, hole_of
from models.torque_and_drag import LoadedString
from toolbox import SceneError
from toolbox.authoring import Column, NumberOrText, Result, columns, number, read_table, reading

COLUMNS = (
    Column("depth", "m", also=("bit depth", "MD")),
    Column("picking up", "N", also=("pick-up", "pick up", "PU"), required=False, blank=True),
    Column("slacking off", "N", also=("slack-off", "slack off", "SO"), required=False, blank=True),
    Column("rotating off bottom", "N", also=("rotating", "ROT"), required=False, blank=True),
    Column("torque off bottom", "N m", also=("torque", "TQ"), required=False, blank=True),
)
"""Columns of a table of measurements: depth of the bit, hook loads, and the torque of the top drive while the string turns off bottom."""

MOTIONS = {"picking up": (-1.0, 0.0), "slacking off": (1.0, 0.0), "rotating off bottom": (0.0, 1.0), "torque off bottom": (0.0, 1.0)}
"""{what is measured: (speed along the hole, speed of rotation)}."""

ERRORS = {"N": 0.01, "N m": 0.05}
"""Standard deviation of a measurement, as a fraction of the largest of its unit: it weights hook loads against torques, and cancels in the widths."""

TOLD = 1e-4
"""Change of all readings with a factor, as a fraction of that with the other numbers, below which the readings do not tell the factor."""


@dataclass(frozen=True)
class FrictionCalibration(Result):
    """Friction factors that `calibrate_friction` has found, with 95 % intervals.

    `plot()` draws measured and computed hook load and torque over the depth of the bit. `friction` can be given to
    `torque_drag` and `torque_drag_operations`.

    Attributes
    ----------
    depths
        Measured depths at which the factors end [m], top first.
    factors
        Friction factors [1]. nan for a factor that the measurements do not determine.
    half_widths
        Half widths of the 95 % intervals of the factors [1]. nan if there are as many unknown numbers as measurements.
    hook_weight
        Weight of hook and block in the measured hook loads [N].
    hook_weight_half_width
        Half width of its 95 % interval [N]. 0 if the weight was given.
    rows
        Measurements as (depth of the bit [m], name of the measurement, measured value, computed value) in SI.
    display_units
        {SI unit: unit in which the input was given}.

    Examples
    --------
    >>> from models import Section, Survey, calibrate_friction
    >>> pipe = Section(length="2000 m", outer="5 in", inner="4.276 in")
    >>> survey = Survey(depth=(0.0, 800.0, 1400.0, 2000.0), inclination=(0.0, 0.0, 1.0, 1.0), azimuth=(0.0, 0.0, 0.0, 0.0))
    >>> measured = {"depth": ["1400 m", "1700 m", "2000 m"], "picking up": ["407 kN", "453 kN", "489 kN"]}
    >>> found = calibrate_friction([pipe], survey, measured, ["2000 m"], hook_weight=0.0)
    >>> print(f"{found.factors[0]:.2f} +- {found.half_widths[0]:.2f}")
    0.25 +- 0.05
    """

    depths: tuple[float, ...]
    factors: tuple[float, ...]
    half_widths: tuple[float, ...]
    hook_weight: float
    hook_weight_half_width: float
    rows: tuple[tuple[float, str, float, float], ...]
    display_units: Mapping[str, str] = field(default_factory=dict)

    @property
    def friction(self) -> list[tuple[float, float]]:
        """Pairs (measured depth [m], factor), as `torque_drag` takes them. Raises SceneError if a factor is not determined."""
        missing = [f"{depth:g} m" for depth, factor in zip(self.depths, self.factors, strict=True) if math.isnan(factor)]
        if missing:
            raise SceneError(f"The measurements do not determine the friction factor down to {', '.join(missing)}.")
        return list(zip(self.depths, self.factors, strict=True))

    def _units(self) -> tuple[Any, Any, Any]:
        units = {"N": "kN", "N m": "kN m", **self.display_units}
        return reading("m", units), reading("N", units), reading("N m", units)

    def __str__(self) -> str:
        length, force, torque = self._units()
        rows: list[tuple[str, ...]] = [(f"from [{length.unit}]", f"to [{length.unit}]", "friction factor", "95 % interval")]
        notes, above = [], 0.0
        for depth, factor, width in zip(self.depths, self.factors, self.half_widths, strict=True):
            ends = f"{above * length.factor:.5g}", f"{depth * length.factor:.5g}"
            if math.isnan(factor):
                rows.append((*ends, "not determined", ""))
                notes.append(
                    f"No measurement changes with the factor from {ends[0]} to {ends[1]} {length.unit}: measure with the bit below {ends[0]} {length.unit}."
                )
            else:
                known = math.isfinite(width)
                rows.append((*ends, f"{factor:.3f}", f"{max(factor - width, 0.0):.3f} .. {factor + width:.3f}" if known else "not known"))
            above = depth
        weight = f"{self.hook_weight * force.factor:.4g}"
        if self.hook_weight_half_width == 0.0:
            told = f"Weight of hook and block {weight} {force.unit}, as given."
        elif math.isfinite(self.hook_weight_half_width):
            told = f"Weight of hook and block {weight} +- {self.hook_weight_half_width * force.factor:.2g} {force.unit}."
        else:
            told = f"Weight of hook and block {weight} {force.unit}."
        if not math.isfinite(self.hook_weight_half_width) or any(
            math.isnan(width) and not math.isnan(factor) for factor, width in zip(self.factors, self.half_widths, strict=True)
        ):
            notes.append("There are as many unknown numbers as measurements: the intervals are not known.")
        table: list[tuple[str, ...]] = [(f"bit at [{length.unit}]", "measurement", "measured", "computed", "unit")]
        for depth, name, measured, computed in self.rows:
            shown = torque if name == "torque off bottom" else force
            numbers = (f"{each * shown.factor:.4g}" for each in (measured, computed))
            table.append((f"{depth * length.factor:.5g}", name, *numbers, shown.unit))
        lines = [
            "Friction factors from measured hook load and torque",
            *columns(rows, left=()),
            f"  {told}",
            *(f"  {each}" for each in notes),
        ]
        return "\n".join([*lines, "", *columns(table, left=(1, 4))])

    __repr__ = __str__

    def _table(self) -> tuple[Sequence[str], Sequence[Sequence[Any]]]:
        """One row per measurement, in SI."""
        return ["bit depth [m]", "measurement", "measured", "computed"], [list(row) for row in self.rows]

    def plot(self) -> Any:
        """Draw measured and computed hook load and torque over the depth of the bit, and return the two axes."""
        from toolbox.authoring import line_styles, name_axis, panels, paper

        with paper():
            axes = panels(2, 4.0, sharey=True)
            looks = line_styles(len(MOTIONS))
            for (name, look), marker in zip(zip(MOTIONS, looks, strict=True), "^vos", strict=True):
                own = sorted(row for row in self.rows if row[1] == name)
                if not own:
                    continue
                depth, measured, computed = (np.array([row[i] for row in own]) for i in (0, 2, 3))
                ax = axes[1 if name == "torque off bottom" else 0]
                ax.plot(computed, depth, label=f"{name}, computed", **look)
                ax.plot(measured, depth, marker, color=look["color"], markerfacecolor="none", label=f"{name}, measured")
            for end in self.depths[:-1]:
                for ax in axes:
                    ax.axhline(end, color="0.6", linewidth=0.7, linestyle=(0, (1, 2)), zorder=0)
            axes[0].invert_yaxis()
            name_axis(axes[0].yaxis, "measured depth of the bit", "m", self.display_units)
            name_axis(axes[0].xaxis, "hook load", "N", self.display_units)
            name_axis(axes[1].xaxis, "torque at the top", "N m", self.display_units)
            found = [each for ax in axes for each in zip(*ax.get_legend_handles_labels(), strict=True)]
            axes[0].figure.legend(*zip(*found, strict=True), loc="outside lower center", ncols=2, frameon=False)
        return axes


def calibrate_friction(
    sections: Path | str | Sequence[Section],
    survey: Path | str | Survey,
    measurements: Path | str | Mapping[str, Sequence[NumberOrText | None]],
    depths: Sequence[NumberOrText],
    *,
    mud_density: Annotated[NumberOrText, "kg/m3"] = 0.0,
    hook_weight: NumberOrText | None = None,
    display_units: Mapping[str, str] | None = None,
) -> FrictionCalibration:
    """Find the friction factors of a borehole from measured hook loads and torques.

    The factors are those with which `torque_drag` comes closest to the measurements, by least squares. A hook load counts
    with an error of 1 % of the largest hook load, a torque with an error of 5 % of the largest torque. While the bit is
    higher than the end of the string, the first section is shorter.

    Parameters
    ----------
    sections
        Sections of the string, top first, or the path of a table that `read_sections` reads.
    survey
        Survey of the borehole, or the path of a table that `read_survey` reads.
    measurements
        Path of a CSV or TOML table, or {column: values}. Columns: `depth` of the bit [m], hook loads `picking up`,
        `slacking off` and `rotating off bottom` [N], and `torque off bottom` [N m]. A cell may be empty, or None.
    depths
        Measured depths at which the friction factors end [m], for example the casing shoe and the bottom of the well.
        The last depth must reach the deepest bit depth.
    mud_density
        Density of the mud for buoyancy [kg/m3].
    hook_weight
        Weight of hook and block that the hook loads contain [N]. By default it is found, too.
    display_units
        {SI unit: unit in which tables show it}.

    Returns
    -------
    FrictionCalibration
        The factors with 95 % intervals, the weight of hook and block, and measured beside computed values. `plot()`
        draws them.

    Raises
    ------
    SceneError
        If a table is bad, an argument is out of range, or there are fewer measurements than unknown numbers.

    Examples
    --------
    >>> from models import Section, Survey, calibrate_friction
    >>> pipe = Section(length="2000 m", outer="5 in", inner="4.276 in")
    >>> survey = Survey(depth=(0.0, 800.0, 1400.0, 2000.0), inclination=(0.0, 0.0, 1.0, 1.0), azimuth=(0.0, 0.0, 0.0, 0.0))
    >>> measured = {"depth": ["1400 m", "1700 m", "2000 m"], "picking up": ["407 kN", "453 kN", "489 kN"]}
    >>> found = calibrate_friction([pipe], survey, measured, ["2000 m"], hook_weight=0.0)
    >>> print(f"{found.factors[0]:.2f}")
    0.25
    """
    from scipy.optimize import least_squares

    pipes = sections_of(sections)
    readings = _readings(measurements)
    deepest = max(depth for depth, _, _ in readings)
    hole = hole_of(survey, deepest)
    ends = FrictionFactors.of("depths", [(depth, 0.0) for depth in depths], deepest).depths
    mud = number("mud_density", mud_density, "kg/m3", at_least=0, at_most=min(section.density for section in pipes))
    given = None if hook_weight is None else number("hook_weight", hook_weight, "N", at_least=0)
    strings = {depth: _string_to(depth, pipes, hole, mud, ends) for depth, _, _ in readings}
    values = np.array([value for _, _, value in readings])
    of_torque = np.array([name == "torque off bottom" for _, name, _ in readings])
    sizes = np.where(
        of_torque, *(ERRORS[unit] * np.abs(values[own]).max(initial=1e-300) for unit, own in (("N m", of_torque), ("N", ~of_torque)))
    )
    heavy = given is None and not of_torque.all()

    def computed(numbers: np.ndarray) -> np.ndarray:
        factors, weight = numbers[: len(ends)], numbers[len(ends)] if heavy else given or 0.0
        profile = FrictionFactors(ends, tuple(factors.tolist()))
        known: dict[tuple[float, tuple[float, float]], tuple[float, float]] = {}
        for depth, name, _ in readings:
            if (depth, MOTIONS[name]) not in known:
                known[depth, MOTIONS[name]] = strings[depth].at_the_top(profile, *MOTIONS[name])
        pairs = [known[depth, MOTIONS[name]] for depth, name, _ in readings]
        return np.array([pair[1] if turned else pair[0] + weight for pair, turned in zip(pairs, of_torque, strict=True)])

    scale = np.array([1.0] * len(ends) + [np.abs(values[~of_torque]).max()] * heavy)
    begin = np.array([0.25] * len(ends) + [0.0] * heavy)
    slope = np.column_stack([(computed(begin + 1e-3 * scale * each) - computed(begin)) / sizes / 1e-3 for each in np.eye(begin.size)])
    strengths = np.linalg.norm(slope, axis=0)
    told = strengths > TOLD * strengths.max()
    if len(readings) < told.sum():
        raise SceneError(
            f"Argument `measurements` must hold at least as many values as there are unknown numbers, {told.sum()}, but it holds {len(readings)}."
        )

    def off(free: np.ndarray) -> np.ndarray:
        return (computed(_filled(begin, told, free * scale[told])) - values) / sizes

    found = least_squares(off, (begin / scale)[told], bounds=(0.0, np.inf), x_scale="jac")
    numbers = _filled(begin, told, found.x * scale[told])
    widths = _filled(np.full(begin.size, np.nan), told, _half_widths(found.jac, found.fun) * scale[told])
    factors = np.where(told, numbers, np.nan)[: len(ends)]
    rows = tuple((*reading, value) for reading, value in zip(readings, computed(numbers).tolist(), strict=True))
    weight, width = (float(numbers[-1]), float(widths[-1])) if heavy else (given or 0.0, 0.0)
    return FrictionCalibration(
        ends, tuple(factors.tolist()), tuple(widths[: len(ends)].tolist()), weight, width, rows, dict(display_units or {})
    )


def _filled(whole: np.ndarray, chosen: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A copy of an array with other values at chosen places."""
    filled = whole.copy()
    filled[chosen] = values
    return filled


def _half_widths(slope: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Half widths of 95 % intervals of a least-squares fit; nan where no measurement is left to tell the noise."""
    from scipy.stats import t

    left = off.size - slope.shape[1]
    if left == 0:
        return np.full(slope.shape[1], np.nan)
    covariance = np.linalg.pinv(slope.T @ slope) * float(off @ off) / left
    return np.asarray(t.ppf(0.975, left) * np.sqrt(np.diag(covariance)))


def _readings(given: Path | str | Mapping[str, Sequence[NumberOrText | None]]) -> list[tuple[float, str, float]]:
    """(depth of the bit [m], what is measured, value in SI) of all cells that are not empty."""
    if isinstance(given, Mapping):
        known = {column.name: column for column in COLUMNS}
        wrong = next((name for name in given if name not in known), None)
        if wrong is not None or "depth" not in given:
            names = ", ".join(f"`{name}`" for name in known)
            raise SceneError(
                f"Argument `measurements` must have `depth` and other columns of {names}, but it has {', '.join(map(str, given))}."
            )
        lengths = {len(values) for values in given.values()}
        if len(lengths) > 1:
            raise SceneError(f"Argument `measurements` must have columns of one length, but they have {sorted(lengths)} values.")
        rows: Sequence[Mapping[str, Any]] = [
            {
                name: None if values[i] is None else number(f"measurements.{name}.{i}", values[i], known[name].unit)
                for name, values in given.items()
            }
            for i in range(lengths.pop())
        ]
    else:
        rows = read_table(given, COLUMNS).rows
    for i, row in enumerate(rows):
        number(f"measurements.depth.{i}", row["depth"], "m", above=0)
    found = [(float(row["depth"]), name, float(row[name])) for row in rows for name in MOTIONS if row.get(name) is not None]
    if not found:
        raise SceneError(
            f"Argument `measurements` must hold at least one value of {', '.join(f'`{name}`' for name in MOTIONS)}, but it holds none."
        )
    return found


def _string_to(depth: float, pipes: Sequence[Section], hole: Survey, mud: float, breaks: Sequence[float]) -> LoadedString:
    """The string while its bit is at a depth: sections at the top are shorter, or not in the hole yet."""
    left, kept = depth, []
    for section in reversed(pipes):
        if left > 0.0:
            kept.insert(0, replace(section, length=min(section.length, left)))
            left -= section.length
    if left > 1e-9 * depth:
        kept[0] = replace(kept[0], length=kept[0].length + left)  # as deep as no table of the string says: more of the first section
    return LoadedString(kept, hole, mud, breaks)
