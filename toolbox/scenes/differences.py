"""What differs between two runs, in their measures, or between two scenes, in their keys."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from toolbox.arguments import short
from toolbox.errors import SceneError, suggest
from toolbox.files.printing import Rows, Told
from toolbox.files.unit_systems import reading
from toolbox.files.units import NumberOrText, TypedNumber, in_si
from toolbox.measuring import metrics as listed
from toolbox.measuring.metrics import Metric
from toolbox.measuring.sticks import STICK
from toolbox.scenes.judged import judged_in
from toolbox.scenes.scene import Scene
from toolbox.simulation.recorded import Recorded
from toolbox.vocabulary import new_names_only

SPEEDS = ("rad/s", "m/s")

ROUNDING = 1e-12
"""Part of a number below which a difference is one of its last digits."""


class Difference(NamedTuple):
    """A metric of two runs, or a key of two scenes, with both values. A value is None if the run or scene does not have it."""

    name: str
    unit: str
    first: Any
    second: Any

    @property
    def change(self) -> float | None:
        """The second number minus the first; None if either is not a number."""
        return float(self.second - self.first) if all(isinstance(value, (int, float)) for value in (self.first, self.second)) else None

    @property
    def differs(self) -> bool:
        """Whether the numbers differ by more than their last digits."""
        return self.change is None or not abs(self.change) <= ROUNDING * max(abs(self.first), abs(self.second))


@dataclass(frozen=True)
class Differences(Told):
    """Result of `compare`: `print(found)` shows the table, `found["bit.speed, severity"]` is one row.

    Attributes
    ----------
    title
        Title of the comparison.
    labels
        Names of the first and of the second run or scene.
    rows
        For two runs one row per metric, for two scenes one row per key whose values differ. Each row holds both values
        in SI.
    display_units
        {SI unit: unit that was typed}: the units of the table. If the two runs differ, the units of the first run.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compare, compose, simulate
    >>> plant = compose(BlockOnBelt())
    >>> runs = [simulate(plant, "60 s", parameters={"block.mass": mass}) for mass in (1.0, 1.2)]
    >>> row = compare(*runs, after="20 s")["belt, longest stick"]
    >>> print(f"{row.first:.2f} s and {row.second:.2f} s")
    7.71 s and 7.65 s
    """

    title: str
    labels: tuple[str, str]
    rows: tuple[Difference, ...]
    display_units: Mapping[str, str] = field(default_factory=dict)

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
            factor, unit = reading(row.unit, self.display_units)
            first, second = (value * factor if isinstance(value, float) else value for value in row[2:])
            change = "" if row.change is None else f"{row.change * factor:+.4g}" if row.differs else "0"
            cells.append((row.name, word(first), word(second), change, "" if unit == "1" else unit))
        return cells

    def _told(self) -> list[str | Rows]:
        if not self.rows:
            return [f"{self.title}: no difference"]
        return [self.title, Rows([("", *self.labels, "difference", ""), *self._cells()], (0, 4))]

    __repr__ = Told.__str__


@new_names_only
def compare(
    first: Any,
    second: Any,
    *,
    signals: Sequence[str] | None = None,
    metrics: Any = (),
    after: NumberOrText = 0.0,
    until: NumberOrText | None = None,
    labels: tuple[str, str] = ("first", "second"),
) -> Differences:
    """Compare two runs by their metrics, or two scenes by the values of their keys.

    For runs, the table contains

    - for each contact, the fraction of the time in stick, the number of stick phases and the longest stick phase;
    - for each signal, minimum, maximum and time mean, and for speeds the severity;
    - the metrics of the argument `metrics`.

    A run may be the result of `simulate` or read from a file.

    Parameters
    ----------
    first, second
        Two runs, or two scenes.
    signals
        Scalar signals of the runs. By default the main signals of the first and of the second run, if both runs have
        them.
    metrics
        Further metrics, by default none: a name such as "severity" (a key of `toolbox.measuring.metrics.METRICS`), a
        function of the run, or several as a sequence or {name: metric}. A metric by its name is computed for the
        contact `element` and the speed `signal` of the loop of each run. A run from a file has no loop: the metric is
        computed for its only contact and the speed of this contact.
    after, until
        Begin and end of the window [s]. By default from the start to the end of the shorter run.
    labels
        Names of the two runs or scenes in the table, by default "first" and "second".

    Returns
    -------
    Differences
        All metrics of both runs, or the keys whose values differ.

    Raises
    ------
    SceneError
        If one argument is a run and the other a scene, a signal is unknown, has different units in the two runs or is a
        vector, or the window lies outside a run.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compare, compose, simulate
    >>> rig = compose(wells.JANSEN_2, BitRock())
    >>> low, high = (simulate(rig, "60 s", inputs={"top.torque": torque}) for torque in ("11 kN m", "12 kN m"))
    >>> print(compare(low, high, signals=["bit.speed"], after="30 s", labels=("11 kN m", "12 kN m")))
    Measures from 30 to 60 s
                                       11 kN m   12 kN m  difference
      bit, part of the time in stick  0.342145  0.271915    -0.07023
      bit, stick phases                      5         6          +1
      bit, longest stick               2.05326   1.37243     -0.6808  s
      bit.speed, minimum                    -0         0           0  rad/s
      bit.speed, maximum               15.5489   18.7769      +3.228  rad/s
      bit.speed, mean                  5.85027   7.53688      +1.687  rad/s
      bit.speed, severity              1.32891   1.24567    -0.08324
    """
    if isinstance(first, Scene) and isinstance(second, Scene):
        return Differences(
            "Keys that differ, in SI where no unit stands", labels, _keys(first, second), {**second.display_units, **first.display_units}
        )
    for word, run in (("first", first), ("second", second)):
        if not isinstance(run, Recorded):
            raise SceneError(f"Argument `{word}` must be a run or a scene, and both of the same kind, but it is {short(run)}.")
    after, until = in_si(after, "s", "after"), in_si(until, "s", "until")
    if signals is None:
        shown = dict.fromkeys([*first.main_signals, *second.main_signals])
        signals = [name for name in shown if name in first and name in second and first.unit(name) == second.unit(name)]
    last = min(first.end, second.end) if until is None else until
    pairs = [
        (each.heading, each, each)
        for each in (*_of_contacts(first, second, after, last), *_of_signals(first, second, signals, after, last))
    ]
    if metrics:
        one, other = (judged_in(metrics, run, after, last) for run in (first, second))
        pairs += [(name, one[name], other[name]) for name in one]
    rows = [Difference(name, one.unit_in(first), one.read(first), other.read(second)) for name, one, other in pairs]
    if not rows:
        raise SceneError("Argument `second` must have an element or a signal that `first` has, too, but it has none.")
    return Differences(f"Measures from {after:g} to {last:g} s", labels, tuple(rows), {**second.display_units, **first.display_units})


def _keys(first: Scene, second: Scene) -> tuple[Difference, ...]:
    """The keys of two scenes that differ."""
    one, other = dict(first.settings()), dict(second.settings())
    pairs = ((name, one.get(name), other.get(name)) for name in {**one, **other})
    return tuple(Difference(name, _typed_unit(*pair), *pair) for name, *pair in pairs if pair[0] != pair[1])


def _of_contacts(first: Recorded, second: Recorded, after: float, last: float) -> Iterator[Metric]:
    """How each element that sticks in both runs does so."""
    for element, words in first._legends.items():
        if STICK in words.values() and STICK in second._legends.get(element, {}).values():
            yield from (each(element, after, last) for each in (listed.stuck_ratio, listed.stays, listed.longest_stay))


def _of_signals(first: Recorded, second: Recorded, signals: Sequence[str], after: float, last: float) -> Iterator[Metric]:
    """Extrema and mean of each signal, of a constant one its mean, and the severity of speeds; raises SceneError where the units differ."""
    for name in signals:
        unit = first.unit(name)
        if second.unit(name) != unit:
            raise SceneError(f"Argument `signals` must name signals of one unit, but `{name}` is in {unit} and in {second.unit(name)}.")
        ranges = [(listed.minimum(name, after, last).read(run), listed.maximum(name, after, last).read(run)) for run in (first, second)]
        if all(high - low <= ROUNDING * max(abs(low), abs(high)) for low, high in ranges):
            yield listed.mean(name, after, last)
            continue
        for each in (listed.minimum, listed.maximum, listed.mean, *([listed.severity] if unit in SPEEDS else [])):
            yield each(name, after, last)


def _typed_unit(*values: Any) -> str:
    """The unit of the first value that was typed with one; that of a plain number where none was."""
    return next((value.unit for value in values if isinstance(value, TypedNumber)), "1")
