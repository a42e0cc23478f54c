"""Effect of each number of a well on hook load and torque of its drill string, drawn as a tornado chart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from models.friction_factors import FrictionFactors
from models.sections import Section, sections_of
from models.survey import Survey, hole_of
from models.torque_and_drag import TorqueDragOperations, torque_drag_operations
from toolbox.authoring import NumberOrText, Result, columns, html_table, number, reading

TITLE = "Effect of each number on hook load and torque"
"""Title of the printed result."""

STEEL = "weight of the string"
"""Name of the weight of the string in air among the numbers that are changed."""

FAINT = 1e-9
"""Change of a quantity, as a fraction of it, below which a number has no bar."""


@dataclass(frozen=True)
class TorqueDragEffects(Result):
    """Effect of each number of a well on hook load and torque, the result of `torque_drag_effects`.

    `plot()` draws a tornado chart: the number with the largest effect is at the top.

    Attributes
    ----------
    change
        Change of each number, as a fraction of its value.
    numbers
        Names of the numbers.
    quantities
        {quantity: its value with the numbers as given}, hook loads in N and torque in N m.
    low, high
        Change of each quantity if a number is lower or higher by `change`. Shape (numbers, quantities).
    display_units
        {SI unit: unit in which the input was given}.

    Examples
    --------
    >>> from models import Section, Survey, torque_drag_effects
    >>> pipe = Section(length="2000 m", outer="5 in", inner="4.276 in")
    >>> survey = Survey(depth=(0.0, 800.0, 1400.0, 2000.0), inclination=(0.0, 0.0, 1.0, 1.0), azimuth=(0.0, 0.0, 0.0, 0.0))
    >>> found = torque_drag_effects([pipe], survey, 0.25, mud_density="1200 kg/m3")
    >>> print(found.numbers[0], f"{found.high[0][0] / 1e3:+.1f} kN while picking up")
    friction factor +6.2 kN while picking up
    """

    change: float
    numbers: tuple[str, ...]
    quantities: Mapping[str, float]
    low: np.ndarray
    high: np.ndarray
    display_units: Mapping[str, str] = field(default_factory=dict)

    def _order(self) -> np.ndarray:
        """Indices of the numbers, the number with the largest effect first: the largest change as a fraction of its quantity."""
        largest = np.maximum(np.abs(self.low), np.abs(self.high)) / np.maximum(np.abs([*self.quantities.values()]), 1e-300)
        return np.argsort(-largest.max(axis=1), kind="stable")

    def _readings(self) -> list[Any]:
        units = {"N": "kN", "N m": "kN m", **self.display_units}
        return [reading("N m" if name.startswith("torque") else "N", units) for name in self.quantities]

    def _rows(self) -> tuple[str, list[tuple[str, ...]]]:
        """(sentence on the cells, rows of the table with its headings first)."""
        shown = self._readings()
        rows: list[tuple[str, ...]] = [("number", *(f"{name} [{each.unit}]" for name, each in zip(self.quantities, shown, strict=True)))]
        rows.append(("as given", *(f"{value * each.factor:.4g}" for value, each in zip(self.quantities.values(), shown, strict=True))))
        for k in self._order():
            cells = (f"{a * each.factor:+.3g}, {b * each.factor:+.3g}" for a, b, each in zip(self.low[k], self.high[k], shown, strict=True))
            rows.append((self.numbers[k], *cells))
        return (
            f"Each cell: the change if the number alone is {100 * self.change:.3g} % lower, and if it is {100 * self.change:.3g} % higher.",
            rows,
        )

    def __str__(self) -> str:
        note, rows = self._rows()
        return "\n".join([TITLE, f"  {note}", *columns(rows)])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        note, (heads, *rows) = self._rows()
        return html_table(TITLE, heads, rows, [note])

    def _table(self) -> tuple[Sequence[str], Sequence[Sequence[Any]]]:
        """One row per number and quantity, in SI."""
        names = list(self.quantities)
        rows = [
            [number, names[q], float(self.low[k, q]), float(self.high[k, q])]
            for k, number in enumerate(self.numbers)
            for q in range(len(names))
        ]
        return ["number", "quantity", "change if lower", "change if higher"], rows

    def plot(self) -> Any:
        """Draw the tornado chart, with one panel per quantity and the same order of the numbers in all panels, and return the axes."""
        from toolbox.authoring import line_styles, name_axis, panels, paper

        with paper(**{"axes.titlesize": 9.0}):
            order = self._order()[::-1]
            axes = panels(len(self.quantities), 1.5 + 0.27 * order.size, sharey=True)
            dark, light = (look["color"] for look in line_styles(2))
            for q, (ax, (name, value)) in enumerate(zip(axes, self.quantities.items(), strict=True)):
                for changes, label, color in ((self.low, "lower", light), (self.high, "higher", dark)):
                    own = changes[order, q]
                    places = np.flatnonzero(np.abs(own) > FAINT * abs(value))
                    ax.barh(places, own[places], left=value, color=color, height=0.6, label=f"number {100 * self.change:.3g} % {label}")
                ax.axvline(value, color="0.3", linewidth=0.8)
                ax.margins(x=0.08)
                ax.locator_params(axis="x", nbins=4)
                kind, _, operation = name.partition(", ")
                ax.set_title(operation)
                name_axis(ax.xaxis, kind, "N m" if kind == "torque" else "N", self.display_units)
            axes[0].set_yticks(np.arange(order.size), [self.numbers[k] for k in order])
            handles, labels = axes[0].get_legend_handles_labels()
            axes[0].figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
        return axes


def torque_drag_effects(
    sections: Path | str | Sequence[Section],
    survey: Path | str | Survey,
    friction: float | Sequence[Sequence[NumberOrText]],
    *,
    change: float = 0.1,
    mud_density: Annotated[NumberOrText, "kg/m3"] = 0.0,
    weight_on_bit: Annotated[NumberOrText, "N"] = 0.0,
    bit_torque: Annotated[NumberOrText, "N m"] = 0.0,
    display_units: Mapping[str, str] | None = None,
) -> TorqueDragEffects:
    """Compute how much each number of a well changes hook load and torque.

    Each number is changed by itself, to a lower and to a higher value: the friction factor of each part of the borehole,
    mud density, weight on bit, torque on bit, and the weight of the string in air. Numbers that are 0 are left out.

    Parameters
    ----------
    sections
        Sections of the string, top first, or the path of a table that `read_sections` reads.
    survey
        Survey of the borehole, or the path of a table that `read_survey` reads.
    friction
        Friction factor between string and borehole [1], or pairs (depth, factor) from the top, as for `torque_drag`.
    change
        Change of each number, as a fraction of its value, by default 0.1. Above 0 and below 1.
    mud_density
        Density of the mud for buoyancy [kg/m3], by default 0.
    weight_on_bit
        Weight on bit on bottom [N], by default 0.
    bit_torque
        Torque on bit on bottom [N m], by default 0.
    display_units
        {SI unit: unit in which tables and figures show it}. By default None: kN, kN m and m.

    Returns
    -------
    TorqueDragEffects
        For each number, the changes of the hook load while picking up and while slacking off [N], and of the torque at
        the top while rotating on bottom [N m] (off bottom if neither a weight nor a torque on bit is given). `plot()`
        draws a tornado chart.

    Raises
    ------
    SceneError
        If a table is bad or an argument is out of range.

    Examples
    --------
    >>> from models import Section, Survey, torque_drag_effects
    >>> pipe = Section(length="2000 m", outer="5 in", inner="4.276 in")
    >>> survey = Survey(depth=(0.0, 800.0, 1400.0, 2000.0), inclination=(0.0, 0.0, 1.0, 1.0), azimuth=(0.0, 0.0, 0.0, 0.0))
    >>> found = torque_drag_effects([pipe], survey, 0.25, change=0.2)
    >>> print(len(found.numbers), "numbers")
    2 numbers
    """
    change = number("change", change, above=0, below=1)
    pipes = sections_of(sections)
    length = sum(section.length for section in pipes)
    hole, profile = hole_of(survey, length), FrictionFactors.of("friction", friction, length)
    numbers = {
        "mud density": number("mud_density", mud_density, "kg/m3", at_least=0, at_most=min(section.density for section in pipes)),
        "weight on bit": number("weight_on_bit", weight_on_bit, "N", at_least=0),
        "torque on bit": number("bit_torque", bit_torque, "N m", at_least=0),
    }
    depth, above, factors = reading("m", display_units), 0.0, []
    for end in profile.depths:
        factors.append(f"friction factor, {above * depth.factor:.4g} to {min(end, length) * depth.factor:.4g} {depth.unit}")
        above = end
    if len(factors) == 1:
        factors = ["friction factor"]

    def found(changed: str, factor: float) -> np.ndarray:
        own = {name: value * (factor if name == changed else 1.0) for name, value in numbers.items()}
        friction = [
            (end, mu * (factor if name == changed else 1.0)) for end, mu, name in zip(profile.depths, profile.factors, factors, strict=True)
        ]
        steel = [_heavier(each, factor) for each in pipes] if changed == STEEL else pipes
        mud, load, rock = own.values()
        return _quantities(torque_drag_operations(steel, hole, friction, mud_density=mud, weight_on_bit=load, bit_torque=rock))

    names = [
        *(name for name, mu in zip(factors, profile.factors, strict=True) if mu),
        *(name for name, value in numbers.items() if value),
        STEEL,
    ]
    given = found("", 1.0)
    low, high = (np.array([found(name, 1.0 + sign * change) - given for name in names]) for sign in (-1.0, 1.0))
    turning = "torque, rotating on bottom" if numbers["weight on bit"] or numbers["torque on bit"] else "torque, rotating off bottom"
    quantities = dict(zip(("hook load, picking up", "hook load, slacking off", turning), given.tolist(), strict=True))
    return TorqueDragEffects(change, tuple(names), quantities, low, high, dict(display_units or {}))


def _heavier(section: Section, factor: float) -> Section:
    """The same section of a steel of another density."""
    mass = section.mass_per_length
    return replace(section, density=section.density * factor, mass_per_length=None if mass is None else mass * factor)


def _quantities(found: TorqueDragOperations) -> np.ndarray:
    """Hook load while picking up and slacking off [N], and torque while rotating on bottom, or off bottom if nothing acts on the bit [N m]."""
    turning = next(iter(found.operations.values()))
    return np.array([found["picking up"].tension[0], found["slacking off"].tension[0], turning.torque[0]])
