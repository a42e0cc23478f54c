"""Answers for the controllers of one plant: printed as three tables, drawn, saved and loaded."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from toolbox.errors import SceneError
from toolbox.files.printing import Rows, Told, shown
from toolbox.files.results import HeadedRows, Result
from toolbox.files.unit_systems import reading

RAMP = 30.0
"""Duration of the ramp of the set-point of a start from rest [s]."""

STARTS = ("takeover", "step", "ramp", "connection")
"""Starts whose lowest set-points are searched."""

HEADS = {
    "takeover": "takes over stick-slip", "step": "from rest, step", "ramp": f"from rest, ramp {RAMP:g} s", "connection": "after a connection",
}  # fmt: skip
"""Heads of the columns of each start."""


@dataclass(frozen=True)
class Counted:
    """Runs from one kind of start.

    held: how many come to smooth running;  runs: how many there are;  why: what the first other one does, and if there is no stick-slip to start from.
    """

    held: int
    runs: int
    why: str = ""

    @property
    def passed(self) -> bool:
        """Whether every run comes to smooth running."""
        return self.held == self.runs

    def __str__(self) -> str:
        if self.passed:
            return self.why or (f"holds, {self.held} of {self.runs}" if self.runs else "-")
        return f"fails, {self.runs - self.held} of {self.runs}"


@dataclass(frozen=True)
class ControllerAnswer:
    """The answers for one controller.

    Attributes
    ----------
    starts
        {start: runs at the set-point of the scene}: `takeover`, `step`, `ramp` and `connection`.
    errors
        Takeovers on plants with one number wrong at a time.
    own_period
        Period of the loop's own stick-slip at that set-point [s]; nan if none was found.
    lowest
        {start: lowest set-point from which on every one that was tried holds}; nan if none does.
    own_end
        Set-point at which the loop's own stick-slip ends; nan if it has none in the range, inf if it lasts to its end.
    top_peak, bit_peak, torque_peak
        Largest speed of drive and contact, and largest command, of the takeovers; nan for what the plant does not have.
    torque_limit
        Limit of the command that the controller knows; nan if it knows none.
    """

    starts: Mapping[str, Counted]
    errors: Counted
    own_period: float
    lowest: Mapping[str, float] = field(default_factory=dict)
    own_end: float = math.nan
    top_peak: float = math.nan
    bit_peak: float = math.nan
    torque_peak: float = math.nan
    torque_limit: float = math.nan


@dataclass(frozen=True)
class Answers(Told, Result):
    """Answers for the controllers of one plant, the result of `answers`. `print(found)` shows them, `found["soft
    torque"]` holds the answers of one controller.

    Attributes
    ----------
    title
        The plant.
    initial_controller
        The controller whose stick-slip the judged controllers take over.
    parameter, unit, nominal_value
        The set-point that is varied, its unit, and its value in the scene.
    bounds, step
        Range of set-points in which the lowest set-point was searched, and distance of neighbouring set-points. nan
        without a search.
    results
        {label of a controller: its answers}.
    failed
        {label of a controller: reason why it has no answers}.
    situation
        The situation for which the verdicts hold, in one line.
    display_units
        {SI unit: unit that was typed}.

    Examples
    --------
    >>> from controllers import SoftTorque, StiffPI
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose
    >>> from toolbox.drilling import answers
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> loop = closed_loop(rig, Sampled(SoftTorque(reference="9 rad/s", lowest_torque=0.0), "10 ms", delay="30 ms"))
    >>> found = answers({"soft torque": loop}, StiffPI(), phases=2)
    >>> print(found.nominal_value, found.unit, *found.results)
    9.0 rad/s soft torque
    """

    title: str
    initial_controller: str
    parameter: str
    unit: str
    nominal_value: float
    bounds: tuple[float, float]
    step: float
    results: dict[str, ControllerAnswer]
    failed: dict[str, str]
    situation: str
    display_units: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, label: str) -> ControllerAnswer:
        """The answers for a controller, by its label."""
        if label not in self.results:
            raise SceneError(f"There is no controller `{label}` in this result: it has {', '.join(self.results) or 'none'}.")
        return self.results[label]

    @property
    def verdict_rows(self) -> list[tuple[str, ...]]:
        """Return the table of verdicts at the set-point of the scene, as text."""
        lines: list[tuple[str, ...]] = [("controller", *HEADS.values(), "takes over, one number off", "own stick-slip")]
        for label, each in self.results.items():
            own = "none found" if math.isnan(each.own_period) else f"yes, period {each.own_period:.3g} s"
            lines.append((label, *(str(each.starts[name]) for name in HEADS), str(each.errors), own))
        return lines

    @property
    def lowest_rows(self) -> list[tuple[str, ...]]:
        """Return the table of lowest set-points, as text."""
        read = reading(self.unit, self.display_units)
        lines: list[tuple[str, ...]] = [("controller", *HEADS.values(), "no stick-slip of its own")]
        for label, each in self.results.items():
            values = [each.lowest.get(name, math.nan) for name in HEADS]
            own = (
                "in all of the range"
                if math.isnan(each.own_end)
                else "none"
                if math.isinf(each.own_end)
                else f"{each.own_end * read.factor:.4g}"
            )
            lower = ["<= " if value == self.bounds[0] else "" for value in values]
            told = ["none" if math.isnan(v) else f"{sign}{v * read.factor:.4g}" for sign, v in zip(lower, values, strict=True)]
            lines.append((label, *("-" if name not in each.lowest else text for name, text in zip(HEADS, told, strict=True)), own))
        return lines

    @property
    def price_rows(self) -> list[tuple[str, ...]]:
        """Return the table of the costs of the takeover, as text."""
        speed, torque = reading("rad/s", self.display_units), reading("N m", self.display_units)
        lines: list[tuple[str, ...]] = [
            ("controller", f"top peak [{speed.unit}]", f"bit peak [{speed.unit}]", f"torque peak [{torque.unit}]", "of its limit")
        ]
        for label, each in self.results.items():
            share = 100.0 * each.torque_peak / each.torque_limit
            peaks = (each.top_peak * speed.factor, each.bit_peak * speed.factor, each.torque_peak * torque.factor)
            lines.append(
                (label, *(shown(peak, ".4g") for peak in peaks), shown(share, ".3g", " %") if math.isfinite(share) else "no limit")
            )
        return lines

    @property
    def sentences(self) -> list[str]:
        """Return the answers in one sentence for each controller."""
        read = reading(self.unit, self.display_units)
        point, told = f"{self.nominal_value * read.factor:.4g}{read.tail}", []
        for label, each in self.results.items():
            held = [HEADS[name] for name, count in each.starts.items() if count.passed and count.runs and not count.why]
            lost = [HEADS[name] for name, count in each.starts.items() if count.runs and not count.passed]
            words = f"{label} at {point}: "
            words += (
                f"smooth in every run ({', '.join(held)})"
                if held and not lost
                else f"keeps sticking ({', '.join(lost)})"
                if lost
                else "not judged"
            )
            words += f"; smooth in every run of the others ({', '.join(held)})" if held and lost else ""
            words += (
                "."
                if math.isnan(each.own_period)
                else f"; a stick-slip of its own exists beside, with a period of {each.own_period:.3g} s."
            )
            told.append(words)
        return told

    def _told(self) -> list[str | Rows]:
        read = reading(self.unit, self.display_units)
        point = f"{self.nominal_value * read.factor:.4g}{read.tail}"
        lines: list[str | Rows] = [
            f"Stick-slip of {self.title} at {self.parameter} = {point}, taken over from {self.initial_controller}", f"  {self.situation}", *self.sentences, "",
            f"Verdicts at {point}: how many runs come to smooth running (holds), or do not (fails)", Rows(self.verdict_rows, tuple(range(7))),
        ]  # fmt: skip
        if any(each.lowest for each in self.results.values()):
            low, high, step = (f"{value * read.factor:.4g}" for value in (*self.bounds, self.step))
            lines += [
                "",
                f"Lowest set-point [{read.unit}] ({low} to {high}, steps of {step}): from it on every set-point that was tried holds",
            ]
            lines.append(Rows(self.lowest_rows))
        lines += ["", f"Cost of the takeover at {point}", Rows(self.price_rows)]
        return [*lines, *(f"{label}: {why}" for label, why in self.failed.items())]

    __repr__ = Told.__str__

    def _table(self) -> HeadedRows:
        """One row per controller, in SI units."""
        peaks = ["own_period", "own_end", "top_peak", "bit_peak", "torque_peak", "torque_limit"]
        headings = [
            "controller",
            *(f"{name} {word}" for name in (*STARTS, "errors") for word in ("held", "runs")),
            *(f"lowest {name}" for name in STARTS),
            *peaks,
        ]
        rows: list[list[Any]] = []
        for label, each in self.results.items():
            counts = [value for count in (*(each.starts[name] for name in STARTS), each.errors) for value in (count.held, count.runs)]
            rows.append([label, *counts, *(each.lowest.get(name, math.nan) for name in STARTS), *(getattr(each, name) for name in peaks)])
        return headings, rows

    def plot(self, ax: Any = None) -> Any:
        """Draw the lowest set-points of every controller from each start. Without a search, draw the numbers of successful runs. Return the axes.

        Parameters
        ----------
        ax
            Axes to draw into. By default a new figure.
        """
        from toolbox.drilling.figures import answer_diagram, verdict_diagram

        if math.isnan(self.bounds[0]):
            counted = [(label, [*(each.starts[name] for name in HEADS), each.errors]) for label, each in self.results.items()]
            return verdict_diagram(
                [*HEADS.values(), "one number off"], [(label, [(c.held, c.runs) for c in row]) for label, row in counted], ax
            )
        read = reading(self.unit, self.display_units)
        rows = [
            (label, {HEADS[name]: value * read.factor for name, value in each.lowest.items()}, each.own_end * read.factor)
            for label, each in self.results.items()
        ]
        return answer_diagram(rows, self.nominal_value * read.factor, tuple(end * read.factor for end in self.bounds), read.unit, ax)
