"""Numbers that exported C refuses, read off the checks that Python makes of the same parts.

The `check` methods of parts and controllers run once, on numbers that note what they are compared with. Each comparison has come out so that the numbers are
accepted, and must come out so for others: that is a bound, or a relation of two numbers. A number that enters a comparison by way of arithmetic must stay as it
is.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.export.c_language import c_number
from toolbox.modelling.components import checked, numbers_of, rebuilt

LARGEST = float(np.finfo(float).max)

OPPOSITE = {"gt": "le", "ge": "lt", "lt": "ge", "le": "gt", "eq": "ne", "ne": "eq"}
MIRRORED = {"gt": "lt", "ge": "le", "lt": "gt", "le": "ge", "eq": "eq", "ne": "ne"}
SIGNS = {"gt": ">", "ge": ">=", "eq": "==", "ne": "!="}

Note = Callable[["Watched", str, Any], None]


class Watched(float):
    """A number that records the numbers with which it is compared. places: indices of the numbers from which it is computed; a single index
    if it is the number itself."""

    places: tuple[int, ...]
    itself: bool
    note: Note

    @classmethod
    def made(cls, value: float, places: tuple[int, ...], itself: bool, note: Note) -> Watched:
        """A number that tells `note(number, comparison that holds, other)`."""
        found = cls(value)
        found.places, found.itself, found.note = places, itself, note
        return found

    def __bool__(self) -> bool:
        return bool(self != 0.0)

    __hash__ = float.__hash__


def _comparing(word: str) -> Callable[[Watched, Any], Any]:
    holds = getattr(float, f"__{word}__")

    def compare(self: Watched, other: Any) -> Any:
        found = holds(self, other)
        if found is not NotImplemented:
            self.note(self, word if found else OPPOSITE[word], other)
        return found

    return compare


def _computing(word: str) -> Callable[..., Any]:
    computes = getattr(float, f"__{word}__")

    def compute(self: Watched, *others: Any) -> Any:
        found = computes(self, *others)
        if found is NotImplemented:
            return found
        places = {*self.places, *(place for other in others if isinstance(other, Watched) for place in other.places)}
        return Watched.made(found, tuple(sorted(places)), False, self.note)

    return compute


for _word in OPPOSITE:
    setattr(Watched, f"__{_word}__", _comparing(_word))
for _word in ("add", "radd", "sub", "rsub", "mul", "rmul", "truediv", "rtruediv", "pow", "rpow", "neg", "abs"):
    setattr(Watched, f"__{_word}__", _computing(_word))


def closed_bounds(declared: Mapping[str, Any]) -> tuple[float, float]:
    """Return the least and the largest allowed number, both finite, from the bounds of a `quantity`. An open bound is replaced by the next
    number inside."""
    words = {word: float(declared[word]) for word in ("at_least", "above", "below", "at_most") if declared.get(word) is not None}
    low = max(words.get("at_least", -LARGEST), float(np.nextafter(words.get("above", -np.inf), np.inf)))
    high = min(words.get("at_most", LARGEST), float(np.nextafter(words.get("below", np.inf), -np.inf)))
    return low, high


@dataclass
class Refusals:
    """Conditions on numbers: bounds of each, and relations (number, comparison, other number or None, constant in place of the other)."""

    least: list[float]
    most: list[float]
    relations: list[tuple[int, str, int | None, float]] = field(default_factory=list)

    def allow(self, values: Sequence[float]) -> bool:
        """Whether these numbers are allowed together."""
        inside = all(low <= value <= high for low, value, high in zip(self.least, values, self.most, strict=True))
        return inside and all(getattr(operator, how)(values[i], other if j is None else values[j]) for i, how, j, other in self.relations)

    def of(self, places: Sequence[int]) -> Refusals | None:
        """Return only the relations of some of the numbers; None if there are none."""
        found = [each for each in self.relations if each[0] in places or each[2] in places]
        return Refusals([-LARGEST] * len(self.least), [LARGEST] * len(self.most), found) if found else None

    def bound(self, place: int, how: str, other: float) -> None:
        """Note that a number must be so, against another that does not change."""
        if how in ("gt", "ge", "eq"):
            self.least[place] = max(self.least[place], float(np.nextafter(other, np.inf)) if how == "gt" else other)
        if how in ("lt", "le", "eq"):
            self.most[place] = min(self.most[place], float(np.nextafter(other, -np.inf)) if how == "lt" else other)
        if how == "ne" and self.least[place] <= other <= self.most[place]:
            self._related(place, how, None, other)

    def compared(self, place: int, how: str, other: int) -> None:
        """Record that a number must be in this relation to another number that may change."""
        if how in ("lt", "le"):
            place, how, other = other, MIRRORED[how], place
        self._related(place, how, other, 0.0)

    def _related(self, *relation: Any) -> None:
        if relation not in self.relations:
            self.relations.append(relation)

    def text(self, name: str, scope: str = "static ") -> str:
        """The tables in C, and NAME_allowed, which is 0 for numbers that are refused."""
        many = len(self.least)
        if not many:
            return f"{scope}int {name}_allowed(const double *numbers) {{\n  (void)numbers;\n  return 1;\n}}"
        lines = [
            *(
                f"static const double {name}_{word}[{many}] = {{{', '.join(map(c_number, column))}}};"
                for word, column in (("least", self.least), ("most", self.most))
            ),
            "",
            f"{scope}int {name}_allowed(const double *numbers) {{",
            "  int i;",
            f"  for (i = 0; i < {many}; ++i) {{",
            f"    if (!(numbers[i] >= {name}_least[i] && numbers[i] <= {name}_most[i])) return 0;",
            "  }",
        ]
        for i, how, j, value in self.relations:
            lines.append(f"  if (!(numbers[{i}] {SIGNS[how]} {c_number(value) if j is None else f'numbers[{j}]'})) return 0;")
        return "\n".join([*lines, "  return 1;", "}"])


def refusals_of(bounds: Sequence[tuple[float, float]], parts: Sequence[Any], places: Mapping[int, int]) -> Refusals:
    """What the checks of parts refuse.

    Parameters
    ----------
    bounds
        (least, most) of every number that may change, as it is declared.
    parts
        The parts, with numbers that they accept.
    places
        {place among the numbers of all parts: place among `bounds`} of those that may change.
    """
    found = Refusals([low for low, _ in bounds], [high for _, high in bounds])
    values: list[Watched] = []

    def note(number: Watched, how: str, other: Any) -> None:
        both = [each for each in (number, other) if isinstance(each, Watched)]
        changing = [[places[place] for place in each.places if place in places] for each in both]
        if not all(each.itself for each in both):  # by way of arithmetic
            for place in {place for each in both for place in each.places if place in places}:
                found.bound(places[place], "eq", float(values[place]))
        elif len(both) == 1:
            for place in changing[0]:
                found.bound(place, how, float(other))
        elif changing[0] and changing[1]:
            found.compared(changing[0][0], how, changing[1][0])
        elif changing[0]:
            found.bound(changing[0][0], how, float(other))
        elif changing[1]:
            found.bound(changing[1][0], MIRRORED[how], float(number))

    numbers = [value for part in parts for value in numbers_of(part)]
    values += [Watched.made(float(value), (place,), True, note) for place, value in enumerate(numbers)]
    offset = 0
    for part in parts:
        checked(rebuilt(part, values, offset, number=lambda value: value), opposing=False)
        offset += len(numbers_of(part))
    return found
