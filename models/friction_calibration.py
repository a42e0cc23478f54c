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
from toolbox.authoring import Column, NumberOrText, Result, Table, columns, html_table, number, read_table, reading

COLUMNS = (
    Column("depth", "m", also=("bit depth", "MD")),
    Column("picking up", "N", also=("pick-up", "pick up", "PU"), required=False, blank=True),
    Column("slacking off", "N", also=("slack-off", "slack off", "SO"), required=False, blank=True),
    Column("rotating off bottom", "N", also=("rotating", "ROT"), required=False, blank=True),
    Column("torque off bottom", "N m", also=("torque", "TQ"), required=False, blank=True),
)
"""Columns of a table of measurements: depth of the bit, hook loads, and the torque of the top drive while the string turns off bottom."""

TORQUE = "torque off bottom"
"""Name of the measurement that is a torque; the others are hook loads."""

MOTIONS = {"picking up": (-1.0, 0.0), "slacking off": (1.0, 0.0), "rotating off bottom": (0.0, 1.0), TORQUE: (0.0, 1.0)}
"""{name of a measurement: (speed along the hole, speed of rotation)}."""

ERRORS = {"N": 0.01, "N m": 0.05}
"""Standard deviation of a measurement, as a fraction of the largest of its unit: it weights hook loads against torques, and cancels in the widths."""

SMALLEST = 1e-4
"""Smallest sensitivity of the measurements to a number, or to a sum of numbers, as a fraction of the largest, at which they determine it."""

ALIKE = 0.95
"""Correlation of two numbers above which the measurements hardly tell them apart."""

STEP = 30.0
"""Longest step over depth [m]: of the steps of fourth order of `torque_drag`, six times as long."""

TITLE = "Friction factors from measured hook load and torque"
"""Title of the printed result."""

MOST_ROWS = 40
"""Most rows of the printed table of measurements."""


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
        Half widths of the 95 % intervals of the factors [1]. nan for a factor that is not determined, and for all factors
        if there are as many unknown numbers as measurements.
    hook_weight
        Weight of hook and block in the measured hook loads [N]. nan if the measurements do not determine it.
    hook_weight_half_width
        Half width of its 95 % interval [N]. 0 if the weight was given.
    correlation
        Correlations of the errors of the factors, and of the weight of hook and block as the last number. Shape (n + 1,
        n + 1) for n factors. nan for a number that was given or that no measurement changes with.
    rows
        Measurements as (depth of the bit [m], name of the measurement, measured value, computed value) in SI.
    display_units
        {SI unit: unit in which the input was given}.

    Examples
    --------
    >>> from models import Section, Survey, calibrate_friction
    >>> pipe = Section(length="2000 m", outer="5 in", inner="4.276 in")
    >>> survey = Survey(depth=(0.0, 800.0, 1400.0, 2000.0), inclination=(0.0, 0.0, 1.0, 1.0), azimuth=(0.0, 0.0, 0.0, 0.0))
    >>> measured = {"depth": ["1400 m", "1700 m", "2000 m"], "picking up": ["361 kN", "420 kN", "488 kN"]}
    >>> found = calibrate_friction([pipe], survey, measured, hook_weight=0.0)
    >>> print(f"{found.factors[0]:.2f} +- {found.half_widths[0]:.2f}")
    0.25 +- 0.01
    """

    depths: tuple[float, ...]
    factors: tuple[float, ...]
    half_widths: tuple[float, ...]
    hook_weight: float
    hook_weight_half_width: float
    correlation: np.ndarray
    rows: tuple[tuple[float, str, float, float], ...]
    display_units: Mapping[str, str] = field(default_factory=dict)

    @property
    def friction(self) -> list[tuple[float, float]]:
        """Pairs (measured depth [m], factor), as `torque_drag` takes them. Raises SceneError if a factor is not determined."""
        missing = [f"`{self._names()[i]}`" for i, factor in enumerate(self.factors) if math.isnan(factor)]
        if missing:
            raise SceneError(
                f"The measurements must determine every friction factor, but not {', '.join(missing)}. {' '.join(self._notes())}"
            )
        return list(zip(self.depths, self.factors, strict=True))

    def _units(self) -> tuple[Any, Any, Any]:
        units = {"N": "kN", "N m": "kN m", **self.display_units}
        return reading("m", units), reading("N", units), reading("N m", units)

    def _names(self) -> list[str]:
        """Names of the factors and of the weight of hook and block."""
        length = self._units()[0]
        tops = (0.0, *self.depths[:-1])
        spans = (f"{a * length.factor:.5g} to {b * length.factor:.5g} {length.unit}" for a, b in zip(tops, self.depths, strict=True))
        return [*(f"friction factor, {each}" for each in spans), "weight of hook and block"]

    def _notes(self) -> list[str]:
        """Sentences on the numbers that the measurements do not determine, or hardly tell apart."""
        notes, names, length = [], self._names(), self._units()[0]
        values = np.array([*self.factors, self.hook_weight])
        changing = ~np.isnan(np.diag(self.correlation))
        for i in np.flatnonzero(np.isnan(values) & ~changing):
            above = (0.0, *self.depths)[i] * length.factor
            notes.append(
                f"No measurement changes with `{names[i]}`: measure with the bit below {above:.5g} {length.unit}, where it touches the borehole."
            )
        alike = [f"`{names[i]}`" for i in np.flatnonzero(np.isnan(values) & changing)]
        if alike:
            notes.append(
                f"The measurements do not tell {' and '.join(alike)} apart: measure with the bit at other depths, or give fewer unknown numbers."
            )
        for i, j in zip(*np.triu_indices(values.size, 1), strict=True):
            if abs(self.correlation[i, j]) > ALIKE and not math.isnan(values[i] + values[j]):
                notes.append(
                    f"The measurements hardly tell `{names[i]}` and `{names[j]}` apart (correlation {self.correlation[i, j]:.2f}): their intervals are wide."
                )
        if np.isnan([*self.half_widths, self.hook_weight_half_width])[~np.isnan(values)].any():
            notes.append("There are as many unknown numbers as measurements: the intervals are not known.")
        return notes

    def _answer(self) -> tuple[list[tuple[str, ...]], list[str]]:
        """(rows of the table of friction factors with its headings first, sentences below it)."""
        length, force, _ = self._units()
        rows: list[tuple[str, ...]] = [(f"from [{length.unit}]", f"to [{length.unit}]", "friction factor", "95 % interval")]
        tops = (0.0, *self.depths[:-1])
        for top, end, factor, width in zip(tops, self.depths, self.factors, self.half_widths, strict=True):
            ends = f"{top * length.factor:.5g}", f"{end * length.factor:.5g}"
            value = "not determined" if math.isnan(factor) else f"{factor:.3f}"
            rows.append((*ends, value, "" if math.isnan(width) else f"{max(factor - width, 0.0):.3f} .. {factor + width:.3f}"))
        spread = self.hook_weight_half_width * force.factor
        weight = f"{self.hook_weight * force.factor:.4g}{'' if math.isnan(spread) or not spread else f' +- {spread:.2g}'} {force.unit}"
        hook = "not determined" if math.isnan(self.hook_weight) else weight + (", as given" if spread == 0.0 else "")
        return rows, [
            f"Weight of hook and block: {hook}.",
            f"Root mean square of measured less computed: {self._misfits()}.",
            *self._notes(),
        ]

    def __str__(self) -> str:
        length, force, torque = self._units()
        rows, notes = self._answer()
        table: list[tuple[str, ...]] = [(f"bit at [{length.unit}]", "measurement", "measured", "computed", "unit")]
        for depth, name, measured, computed in self.rows[:MOST_ROWS]:
            shown = torque if name == TORQUE else force
            table.append(
                (f"{depth * length.factor:.5g}", name, f"{measured * shown.factor:.4g}", f"{computed * shown.factor:.4g}", shown.unit)
            )
        more = len(self.rows) - MOST_ROWS
        lines = [TITLE, *columns(rows, left=()), *(f"  {each}" for each in notes), "", *columns(table, left=(1, 4))]
        return "\n".join([*lines, f"  {more} more measurements are in the table that `to_csv` writes."] if more > 0 else lines)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        (heads, *rows), notes = self._answer()
        return html_table(TITLE, heads, rows, notes)

    def _misfits(self) -> str:
        """Root mean squares of the differences, of hook loads and of torques."""
        found = []
        for kind, shown in zip(("hook load", "torque"), self._units()[1:], strict=True):
            own = [row[2] - row[3] for row in self.rows if (row[1] == TORQUE) == (kind == "torque")]
            if own:
                found.append(f"{kind} {float(np.sqrt(np.mean(np.square(own)))) * shown.factor:.3g} {shown.unit}")
        return ", ".join(found)

    def _table(self) -> tuple[Sequence[str], Sequence[Sequence[Any]]]:
        """One row per measurement, in SI."""
        return ["bit depth [m]", "measurement", "measured", "computed", "unit"], [
            [*row, "N m" if row[1] == TORQUE else "N"] for row in self.rows
        ]

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
                ax = axes[1 if name == TORQUE else 0]
                ax.plot(computed, depth, label=f"{name}, computed", **look)
                ax.plot(measured, depth, marker, color=look["color"], markerfacecolor="none", label=f"{name}, measured")
            shallow, deep = axes[0].get_ylim()
            axes[0].set_ylim(deep, shallow)
            for top, end, factor, width in zip((0.0, *self.depths[:-1]), self.depths, self.factors, self.half_widths, strict=True):
                for ax in axes:
                    ax.axhline(end, color="0.6", linewidth=0.7, linestyle=(0, (1, 2)), zorder=0)
                value = "not determined" if math.isnan(factor) else f"{factor:.2f}{'' if math.isnan(width) else f' ± {width:.2f}'}"
                if top < deep and end > shallow:
                    place = 0.5 * (max(top, shallow) + min(end, deep))
                    side = "right" if place < 0.5 * (shallow + deep) else "left"  # the torque grows with depth: beside its curve
                    across = axes[1].get_yaxis_transform()
                    x = {"left": 0.02, "right": 1.0}[side]
                    axes[1].annotate(
                        f"friction factor\n{value}", (x, place), xycoords=across, ha=side, va="center", fontsize=8.0, color="0.3"
                    )
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
    depths: Sequence[NumberOrText] | None = None,
    *,
    mud_density: Annotated[NumberOrText, "kg/m3"] = 0.0,
    hook_weight: NumberOrText | None = None,
    display_units: Mapping[str, str] | None = None,
) -> FrictionCalibration:
    """Find the friction factors of a borehole from measured hook loads and torques.

    The factors are those with which `torque_drag` comes closest to the measurements, by least squares. A hook load counts
    with an error of 1 % of the largest hook load, a torque with an error of 5 % of the largest torque. While the bit is
    higher than the end of the string, the first section is shorter. The intervals take the errors of the measurements as
    independent of each other. They do not contain an error of the weight of the string or of the survey.

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
        The last depth must reach the deepest bit depth. By default None: one factor for the whole borehole.
    mud_density
        Density of the mud for buoyancy [kg/m3], by default 0.
    hook_weight
        Weight of hook and block that the hook loads contain [N]. By default None: it is found, too.
    display_units
        {SI unit: unit in which tables and figures show it}. By default None: kN, kN m and m.

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
    >>> measured = {"depth": ["1400 m", "1700 m", "2000 m"], "picking up": ["361 kN", "420 kN", "488 kN"]}
    >>> found = calibrate_friction([pipe], survey, measured, hook_weight=0.0)
    >>> print(f"{found.factors[0]:.2f}")
    0.25
    """
    from scipy.optimize import least_squares

    pipes = sections_of(sections)
    readings = _readings(measurements)
    deepest = max(depth for depth, _, _ in readings)
    hole = hole_of(survey, deepest)
    whole = max(deepest, sum(section.length for section in pipes))
    ends = FrictionFactors.of("depths", [(depth, 0.0) for depth in ([whole] if depths is None else depths)], deepest).depths
    mud = number("mud_density", mud_density, "kg/m3", at_least=0, at_most=min(section.density for section in pipes))
    given = None if hook_weight is None else number("hook_weight", hook_weight, "N", at_least=0)
    strings = {depth: _string_to(depth, pipes, hole, mud, ends) for depth, _, _ in readings}
    values = np.array([value for _, _, value in readings])
    of_torque = np.array([name == TORQUE for _, name, _ in readings])
    sizes = np.ones(values.size)
    for own, error in ((of_torque, ERRORS["N m"]), (~of_torque, ERRORS["N"])):
        sizes[own] = error * np.abs(values[own]).max(initial=0.0) or 1.0
    unknown = np.array([True] * len(ends) + [given is None and not of_torque.all()])

    def computed(numbers: np.ndarray) -> np.ndarray:
        profile = FrictionFactors(ends, tuple(numbers[:-1].tolist()))
        at_the_top = {
            (depth, motion): strings[depth].at_the_top(profile, *motion)
            for depth, motion in dict.fromkeys((depth, MOTIONS[name]) for depth, name, _ in readings)
        }
        pairs = (at_the_top[depth, MOTIONS[name]] for depth, name, _ in readings)
        return np.array([torque if turned else load + numbers[-1] for (load, torque), turned in zip(pairs, of_torque, strict=True)])

    scale = np.array([1.0] * len(ends) + [np.abs(values[~of_torque]).max(initial=0.0) or 1.0])
    begin = np.array([0.25] * len(ends) + [given or 0.0])
    slope = np.column_stack([(computed(begin + 1e-3 * scale * each) - computed(begin)) / sizes / 1e-3 for each in np.eye(begin.size)])
    strengths = np.linalg.norm(slope, axis=0) * unknown
    free = strengths > SMALLEST * strengths.max()
    if len(readings) < free.sum():
        raise SceneError(
            f"Argument `measurements` must hold at least as many values as there are unknown numbers, {free.sum()}, but it holds {len(readings)}."
        )

    def filled(chosen: np.ndarray, base: np.ndarray = begin) -> np.ndarray:
        whole = base.copy()
        whole[free] = chosen * scale[free]
        return whole

    found = least_squares(
        lambda chosen: (computed(filled(chosen)) - values) / sizes, (begin / scale)[free], bounds=(0.0, np.inf), x_scale="jac"
    )
    determined, widths, correlation = _spread(found.jac, found.fun)
    missing = np.where(unknown, np.nan, begin)
    numbers, half_widths = filled(np.where(determined, found.x, np.nan), missing), filled(widths, np.where(unknown, np.nan, 0.0))
    correlations = np.full((begin.size, begin.size), np.nan)
    correlations[np.ix_(free, free)] = correlation
    rows = tuple((*reading, value) for reading, value in zip(readings, computed(filled(found.x)).tolist(), strict=True))
    return FrictionCalibration(
        ends,
        tuple(numbers[:-1].tolist()),
        tuple(half_widths[:-1].tolist()),
        float(numbers[-1]),
        float(half_widths[-1]),
        correlations,
        rows,
        dict(display_units or {}),
    )


def _spread(slope: np.ndarray, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Spread of the numbers of a least-squares fit: (whether each is determined, half width of its 95 % interval, correlations).

    slope: of the residuals by the numbers, shape (residuals, numbers). A half width is nan if the number is not determined, or if no
    residual is left to tell the noise.
    """
    from scipy.stats import t

    lengths = np.linalg.norm(slope, axis=0)
    _, strengths, directions = np.linalg.svd(slope / lengths, full_matrices=False)
    weak = strengths < SMALLEST * strengths[0]
    determined = (np.abs(directions[weak]) < SMALLEST).all(axis=0)
    covariance = (directions.T / np.maximum(strengths, SMALLEST * strengths[0]) ** 2) @ directions
    deviations = np.sqrt(np.diag(covariance))
    left = residuals.size - slope.shape[1]
    noise = t.ppf(0.975, left) * math.sqrt(float(residuals @ residuals) / left) if left else math.nan
    return determined, np.where(determined, noise * deviations / lengths, np.nan), covariance / np.outer(deviations, deviations)


def _readings(given: Path | str | Mapping[str, Sequence[NumberOrText | None]]) -> list[tuple[float, str, float]]:
    """Cells of measurements that are not empty, as (depth of the bit [m], name of the measurement, value in SI)."""
    rows: Sequence[Mapping[str, Any]] = _rows(given) if isinstance(given, Mapping) else _table_rows(read_table(given, COLUMNS))
    readings = [(float(row["depth"]), name, float(row[name])) for row in rows for name in MOTIONS if row.get(name) is not None]
    if not readings:
        names = ", ".join(f"`{name}`" for name in MOTIONS)
        raise SceneError(f"Argument `measurements` must hold at least one value of {names}, but it holds none.")
    return readings


def _rows(given: Mapping[str, Sequence[NumberOrText | None]]) -> list[dict[str, Any]]:
    """Rows of measurements that are given as columns, in SI."""
    known = {column.name: column for column in COLUMNS}
    if any(name not in known for name in given) or "depth" not in given:
        names = ", ".join(f"`{name}`" for name in known)
        raise SceneError(
            f"Argument `measurements` must have `depth` and other columns of {names}, but it has {', '.join(map(str, given))}."
        )
    lists = [isinstance(values, Sequence | np.ndarray) and not isinstance(values, str) for values in given.values()]
    lengths = {len(values) for values in given.values()} if all(lists) else set()
    if len(lengths) != 1:
        raise SceneError(f"Argument `measurements` must have columns that are lists of one length, but it is {given!r}.")
    limits: dict[str, dict[str, Any]] = {name: {"at_least": 0} for name in MOTIONS} | {"depth": {"above": 0}}
    return [
        {
            name: None
            if values[i] is None and name != "depth"
            else number(f"measurements.{name}.{i}", values[i], known[name].unit or "", **limits[name])
            for name, values in given.items()
        }
        for i in range(lengths.pop())
    ]


def _table_rows(table: Table) -> Sequence[Mapping[str, Any]]:
    """Rows of a table of measurements. Raises SceneError for a negative number, with its row and column."""
    for i, row in enumerate(table):
        if row["depth"] <= 0.0:
            raise table.error(i, "depth", f"it must be > 0 m, but it is {row['depth']:g} m.")
        for name in MOTIONS:
            if row.get(name, 0.0) < 0.0:
                raise table.error(i, name, f"it must be >= 0, but it is {row[name]:g}.")
    return table.rows


def _string_to(depth: float, pipes: Sequence[Section], hole: Survey, mud: float, breaks: Sequence[float]) -> LoadedString:
    """The string while its bit is at a depth: sections at the top are shorter, or not in the hole yet."""
    kept: list[Section] = []
    left = depth
    for section in reversed(pipes):
        if left > 0.0:
            kept.insert(0, replace(section, length=min(section.length, left)))
            left -= section.length
    if left > 1e-9 * depth:
        kept[0] = replace(kept[0], length=kept[0].length + left)  # as deep as no table of the string says: more of the first section
    return LoadedString(kept, hole, mud, breaks, STEP)
