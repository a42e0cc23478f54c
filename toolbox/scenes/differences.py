"""What differs between two runs, in their measures, or between two scenes, in their keys."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from toolbox.arguments import short
from toolbox.errors import SceneError, suggest
from toolbox.files.printing import columns, table
from toolbox.files.unit_systems import reading
from toolbox.files.units import NumberOrText, TypedNumber, in_si
from toolbox.measuring.measure import extent, stick_intervals
from toolbox.measuring.severity import severity_of
from toolbox.scenes.scene import Scene
from toolbox.simulation.recorded import Recorded

SPEEDS = ("rad/s", "m/s")


class Difference(NamedTuple):
    """A measure of two runs, or a key of two scenes, with the value that each of them has; None where it has none."""

    name: str
    unit: str
    first: Any
    second: Any

    @property
    def change(self) -> float | None:
        """The second number less the first; None where one of them is no number."""
        return float(self.second - self.first) if all(isinstance(value, (int, float)) for value in (self.first, self.second)) else None


@dataclass(frozen=True)
class Differences:
    """What `compare` found: `print(found)`, `found["bit.speed, severity"]`.

    Attributes
    ----------
    title
        What was compared.
    labels
        Names of the first and the second.
    rows
        For two runs every measure, for two scenes the keys whose values differ, each with both values in SI.
    asked
        {unit: unit that was typed}: the units in which the table answers, those of the first run before those of the second.
    """

    title: str
    labels: tuple[str, str]
    rows: tuple[Difference, ...]
    asked: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Difference:
        for row in self.rows:
            if row.name == name:
                return row
        raise SceneError(f"There is no `{name}` in the comparison: {suggest(name, [row.name for row in self.rows])}")

    def _cells(self) -> list[tuple[str, str, str, str, str]]:
        def word(value: Any) -> str:
            return (
                "-" if value is None else f"{value:.6g}" if isinstance(value, float) else value if isinstance(value, str) else short(value)
            )

        cells = []
        for row in self.rows:
            factor, unit = reading(row.unit, self.asked)
            first, second = (value * factor if isinstance(value, float) else value for value in row[2:])
            change = "" if row.change is None else f"{row.change * factor:+.4g}"
            cells.append((row.name, word(first), word(second), change, "" if unit == "1" else unit))
        return cells

    def __str__(self) -> str:
        if not self.rows:
            return f"{self.title}: no difference"
        rows = [("", *self.labels, "difference", ""), *self._cells()]
        return "\n".join([self.title, *columns(rows, (0, 4))])

    __repr__ = __str__

    def _repr_html_(self) -> str:
        return table(self.title, ("", *self.labels, "difference", "unit"), self._cells())


def compare(
    first: Any,
    second: Any,
    *,
    signals: Sequence[str] | None = None,
    after: NumberOrText = 0.0,
    until: NumberOrText | None = None,
    labels: tuple[str, str] = ("first", "second"),
) -> Differences:
    """Compare two runs by their measures, or two scenes by their keys.

    Of runs, these are the part of the time that each element sticks, the number of its stick phases and the longest of them, then the extrema and the time
    mean of signals, and the severity of speeds. Runs may be fresh or read from a file.

    Parameters
    ----------
    first, second
        Two runs, or two scenes.
    signals
        Scalar signals of the runs; by default those that a plot of either shows and that both have.
    after, until
        Window of the runs [s]; by default from the start to the end of the shorter one.
    labels
        What the two are called in the table.

    Returns
    -------
    Differences
        All measures of both runs, or the keys whose values differ.

    Raises
    ------
    SceneError
        If one is a run and the other a scene, a signal is unknown, of another unit or a vector, or the window lies outside of a run.
    """
    if isinstance(first, Scene) and isinstance(second, Scene):
        one, other = dict(first.keys()), dict(second.keys())
        pairs = ((name, one.get(name), other.get(name)) for name in {**one, **other})
        differing = tuple(Difference(name, _typed_unit(*pair), *pair) for name, *pair in pairs if pair[0] != pair[1])
        return Differences("Keys that differ, in SI where no unit stands", labels, differing, {**second.asked, **first.asked})
    for word, run in (("first", first), ("second", second)):
        if not isinstance(run, Recorded):
            raise SceneError(f"Argument `{word}` must be a run or a scene, and both of the same kind, but it is {short(run)}.")
    after, until = in_si(after, "s", "after"), in_si(until, "s", "until")
    if signals is None:
        shown = dict.fromkeys([*first.main_signals, *second.main_signals])
        signals = [name for name in shown if name in first and name in second and first.unit(name) == second.unit(name)]
    last = min(first.end, second.end) if until is None else until
    rows = [*_sticks(first, second, after, last), *(row for name in signals for row in _extents(first, second, name, after, last))]
    if not rows:
        raise SceneError("Argument `second` must have an element or a signal that `first` has, too, but it has none.")
    return Differences(f"Measures from {after:g} to {last:g} s", labels, tuple(rows), {**second.asked, **first.asked})


def _sticks(first: Recorded, second: Recorded, after: float, last: float) -> Iterator[Difference]:
    """What differs in the sticking of each element that both have."""
    for element, words in first._legends.items():
        if "stick" in words.values() and "stick" in second._legends.get(element, {}).values():
            stays = [stick_intervals(run, element, after, last) for run in (first, second)]
            lengths = [[end - begin for begin, end in each] for each in stays]
            yield Difference(f"{element}, part of the time in stick", "1", *(sum(each) / (last - after) for each in lengths))
            yield Difference(f"{element}, stick phases", "1", *map(len, lengths))
            yield Difference(f"{element}, longest stick", "s", *(max(each, default=0.0) for each in lengths))


def _extents(first: Recorded, second: Recorded, name: str, after: float, last: float) -> Iterator[Difference]:
    """What differs in a signal."""
    unit = first.unit(name)
    if second.unit(name) != unit:
        raise SceneError(f"Argument `signals` must name signals of one unit, but `{name}` is in {unit} and in {second.unit(name)}.")
    found = [extent(run, name, after, last) for run in (first, second)]
    for word in ("minimum", "maximum", "mean"):
        yield Difference(f"{name}, {word}", unit, *(getattr(each, word) for each in found))
    if unit in SPEEDS:
        yield Difference(f"{name}, severity", "1", *map(severity_of, found))


def _typed_unit(*values: Any) -> str:
    """The unit of the first value that was typed with one; that of a plain number where none was."""
    return next((value.unit for value in values if isinstance(value, TypedNumber)), "1")
