"""The numbers of a closed loop as controls: in units that people read, with a range for a slider, and those that matter most first."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from toolbox.arguments import count_of
from toolbox.files.unit_systems import Reading, reading_of
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.inputs import Table
from toolbox.modelling.numbers import Number
from toolbox.modelling.start import row_of, started

FIRST = 8
"""Controls that are shown before anybody searches."""

REACH = 2.5
"""How far a slider goes, in parts of the declared value."""

SIZES = {"rad/s": 10.0, "rad": 1.0, "m/s": 1.0, "m": 0.1, "N": 1e3, "N m": 1e3, "s": 1.0}
"""{unit: end of the slider of a number that is declared as zero}."""

OPERATING = ("N", "rad/s", "m/s", "N m")
"""Units of what is turned while a machine runs."""


@dataclass(frozen=True)
class Control:
    """One number as the page shows it.

    Attributes
    ----------
    number
        The number, with its declared value.
    part
        "input", or the name of its part.
    of_law
        Whether it belongs to a law.
    read
        The unit in which it is read, and the factor that takes SI there.
    low, high
        Range of its slider, in the unit in which it is read.
    rank
        The smaller, the earlier it stands.
    """

    number: Number
    part: str
    of_law: bool
    read: Reading
    low: float
    high: float
    rank: int

    def told(self) -> dict[str, Any]:
        """What the page is told of it."""
        number = self.number
        ends = {word: value for word, value in number.bounds.items() if word in ("at_least", "above", "at_most") and value is not None}
        factor, unit = self.read
        words = {"at_least": "at least", "above": "above", "at_most": "at most"}
        bounds = ", ".join(f"{words[word]} {end * factor:.4g}" for word, end in ends.items())
        return {
            "name": number.name, "kind": str(number.kind), "part": self.part, "law": self.of_law, "meaning": number.meaning, "unit": unit, "factor": factor,
            "low": self.low, "high": self.high, "step": step_of(self.low, self.high), "bounds": bounds, "first": self.rank < FIRST,
        }  # fmt: skip


def controls_of(loop: ClosedLoop, display_units: Mapping[str, str]) -> list[Control]:
    """Return every number of a declared loop as a control, the most important first. A state with a signal name appears under this name.

    asked: {unit: unit in which numbers of it are read}.
    """
    numbers = loop.variable_numbers()
    hidden = _told_twice(loop)
    set_points = any(number.is_input and name.endswith(".reference") for name, number in numbers.items())
    ranked = sorted(
        (_held(loop, number) for name, number in numbers.items() if name not in hidden),
        key=lambda number: _weight(loop, number, set_points),
    )
    found = []
    for rank, number in enumerate(ranked):
        of_law = number.kind.of_controller and not loop.plant.has_parameter(number.name)
        low, high = span(number)
        read = reading_of(number.unit, max(abs(low), abs(high)), display_units)
        first = rank if number.kind.sets_up else rank + FIRST
        part = number.name.partition(".")[0]
        found.append(Control(number, part, of_law, read, *_round(low * read.factor, high * read.factor), first))
    return found


def _held(loop: ClosedLoop, number: Number) -> Number:
    """An input that varies in time with the value that it has at last, where it is a table; any other number as it is."""
    given = loop.input_values.get(number.name) if number.is_input else None
    return dataclasses.replace(number, value=float(given.values[-1])) if isinstance(given, Table) else number


def span(number: Number) -> tuple[float, float]:
    """The range of a slider in SI: from near zero to some times the declared value, within the bounds."""
    value, bounds = number.value, number.bounds
    at_least, above, at_most = (bounds.get(word) for word in ("at_least", "above", "at_most"))
    floor = at_least if at_least is not None else above
    size = abs(value) if math.isfinite(value) else 0.0
    if size == 0.0:
        usual = number.usual
        size = (
            math.sqrt(usual[0] * usual[1])
            if usual is not None and usual[0] > 0 and math.isfinite(usual[1])
            else SIZES.get(number.unit, 1.0)
        )
        low, high = (0.0 if floor is not None else -size), size
    else:
        low, high = (0.0, REACH * size) if value > 0 else (-REACH * size, 0.0)
    if above is not None and low <= above:
        low = above + size / 20
    if at_least is not None:
        low = max(low, at_least)
    return (low, high) if at_most is None else (min(low, at_most), min(high, at_most))


def step_of(low: float, high: float) -> float:
    """The step of a slider: a round number, some two hundred of them in its range."""
    return 10.0 ** math.floor(math.log10((high - low) / 100)) if high > low else 1.0


def _round(low: float, high: float) -> tuple[float, float]:
    """A range that ends at whole steps."""
    step = step_of(low, high)
    return round(math.ceil(low / step - 1e-9) * step, 12), round(math.floor(high / step + 1e-9) * step, 12)


def _weight(loop: ClosedLoop, number: Number, set_points: bool) -> tuple[int, str]:
    """What sorts numbers: inputs, gains of laws, what is turned while the machine runs, friction, the others, start values."""
    of_law = not number.is_input and not loop.plant.has_parameter(number.name)
    operating = number.unit in OPERATING
    if not number.kind.sets_up:
        return 8, number.name
    if number.overridden is not None or (of_law and set_points and number.name.endswith(".reference")):
        return 7, number.name
    if number.is_input or number.is_shape:
        return (0 if operating and number.value != 0.0 else 3), number.name
    if of_law:
        return (1 if not number.is_clock else 2), number.name
    if ".friction." in number.name:
        return 3, number.name
    return (2 if operating else 4), number.name


def _told_twice(loop: ClosedLoop) -> set[str]:
    """Entries of states that a signal names, too."""
    system = loop.system
    rows = {row_of(system, name): name for name in started(system)}  # states first, then signals that name them, too
    hidden = set()
    for name, (first, size, _) in system.states.items():
        for i in range(count_of(size)):
            entry = name if size is None else f"{name}.{i}"
            if rows.get(first + i, entry) != entry:
                hidden.add(entry)
    return hidden
