"""Both branches of a machine over one parameter as a result: verdicts, borders, margin to a working point, report, picture and table."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.arguments import BoolArray, FloatArray, is_finite_number
from toolbox.errors import SceneError
from toolbox.files.printing import Rows, Told, shown
from toolbox.files.results import HeadedRows, Result
from toolbox.files.tables import heading
from toolbox.files.unit_systems import Reading, reading
from toolbox.measuring.judge import SMOOTH, STANDS, STICKS, SWINGS, Judged
from toolbox.measuring.verdict import growth_in_words
from toolbox.steady_states.hopf import HopfPoint


@dataclass(frozen=True)
class Border:
    """A border between two verdicts.

    Attributes
    ----------
    value, tolerance
        The border lies at `value` +- `tolerance`. For a border by runs the tolerance is one and a half of the last interval, because each step of the
        parameter shakes the machine by as much again.
    safe
        "above" or "below": the side with stable running, without stick-slip, or without standstill.
    confirmed
        Whether the growth of smooth running, the followed cycle, or runs at a hundredth of the accuracy gave the same verdicts on both sides.
    beyond
        Regime of the run that left a border of stick-slip; empty for other borders.
    followed
        How the growth of smooth running is known ("poles", "matrices", "differences", "twin runs"), or how the followed cycle or steady state ends there
        ("fold", "period doubling", ..., "break-away"); empty for a border by runs alone.
    """

    value: float
    tolerance: float
    safe: str
    confirmed: bool
    beyond: str = ""
    followed: str = ""

    def margin(self, at: float) -> float:
        """Distance of a working point to the border in parts of the border, positive on the safe side."""
        distance = at - self.value if self.safe == "above" else self.value - at
        return distance / abs(self.value) if self.value else math.copysign(math.inf, distance)


@dataclass(frozen=True)
class Coexisting:
    """A stick-slip cycle that exists beside others at the same value.

    Attributes
    ----------
    value
        The value at which several were seen.
    period
        Time from stick to stick, in the mean of a round [s].
    severity
        Half of the range of the judged signal, in parts of its mean.
    begun
        What it was begun from.
    low, high
        Where it lives; the edges of the range where it goes on beyond.
    """

    value: float
    period: float
    severity: float
    begun: str
    low: float
    high: float


@dataclass(frozen=True)
class Reached:
    """How many runs from one kind of start end in stick-slip.

    Attributes
    ----------
    start
        The start in words.
    reached, runs
        Runs that end in stick-slip, and all runs.
    smallest
        The smallest kick that leads into stick-slip, as a multiple of the speed of the contact in smooth running; nan for other starts.
    """

    start: str
    reached: int
    runs: int
    smallest: float = math.nan

    def __str__(self) -> str:
        smallest = "" if math.isnan(self.smallest) else f", the smallest of {self.smallest:.2g} times"
        return f"{self.start} ({self.reached} of {self.runs} runs{smallest})"


@dataclass(frozen=True)
class Onset(Told, Result):
    """Regimes of a machine over a parameter, on both branches: `print(onset)` prints the report, `onset.plot()` draws the picture.

    Attributes
    ----------
    title
        What was looked at.
    parameter, unit
        Name and unit of the parameter.
    element, signal, signal_unit
        The contact and the speed that were judged, and its unit.
    values
        Values of the parameter, shape (n,).
    smooth, sticking
        What runs come to at each value (`toolbox.measuring.judge.Judged`), from disturbed smooth running, and from inside stick-slip or standstill.
    steady
        The judged speed in smooth running at each value, shape (n,), stable or not; nan where there is none.
    cycle_runs
        ((value, what a run comes to), ...) of the other runs inside stick-slip that the search for its end made, in order.
    hopf
        Hopf points of the linear system, exact; of a sampled loop those of the loop as it runs.
    losses
        Borders of smooth running, of the law as it runs.
    ends, stalls
        Borders of existing stick-slip: those beyond which the machine keeps turning, and those beyond which it stands for good.
    breakaways
        Borders of standstill.
    coexisting
        The stick-slip cycles at the value at which the most of them live side by side, the nearest one to the working point; empty where nowhere two were seen.
    reached
        How many runs from each kind of start end in stick-slip at the working point, if that is bistable.
    cycling, standing
        Whether stick-slip lasts, and whether standstill lasts, at each value.
    at
        The working point.
    period
        Period of the least damped motion [s].
    duration, accuracy, perturbation
        Longest time for which a run is carried on until its regime is decided [s], its accuracy, and the disturbance of smooth running.
    runs
        Number of runs.
    undecided
        Values at which a run was carried on to the end of that time and could not be told.
    situation
        The situation that the verdict holds for, in one line.
    notes
        What was not done, or not confirmed.
    display_units
        {unit: unit that was typed}: the units in which report and figure answer.
    """

    title: str
    parameter: str
    unit: str
    element: str
    signal: str
    values: FloatArray
    smooth: tuple[Judged, ...]
    sticking: tuple[Judged, ...]
    hopf: tuple[HopfPoint, ...]
    losses: tuple[Border, ...]
    ends: tuple[Border, ...]
    stalls: tuple[Border, ...]
    breakaways: tuple[Border, ...]
    cycling: BoolArray
    standing: BoolArray
    at: float
    period: float
    duration: float
    accuracy: float
    perturbation: float
    runs: int
    cycle_runs: tuple[tuple[float, Judged], ...] = ()
    signal_unit: str = "1"
    steady: FloatArray = field(default_factory=lambda: np.empty(0))
    coexisting: tuple[Coexisting, ...] = ()
    reached: tuple[Reached, ...] = ()
    undecided: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()
    situation: str = ""
    display_units: Mapping[str, str] = field(default_factory=dict)

    @property
    def loss(self) -> float:
        """Parameter value at which smooth running is lost. Of several values, the nearest to the operating point; nan if none is in the
        range."""
        return self._nearest(self.losses)

    @property
    def end(self) -> float:
        """Parameter value at which stick-slip ends and the machine keeps turning. Of several values, the nearest to the operating point;
        nan if none is in the range."""
        return self._nearest(self.ends)

    @property
    def stall(self) -> float:
        """Parameter value at which existing stick-slip ends in a standstill. Of several values, the nearest to the operating point; nan if
        none is in the range."""
        return self._nearest(self.stalls)

    @property
    def breakaway(self) -> float:
        """Parameter value at which a standstill breaks away. Of several values, the nearest to the operating point; nan if none is in the
        range."""
        return self._nearest(self.breakaways)

    @property
    def borders(self) -> list[tuple[str, Border]]:
        """All borders with their names, as the report lists them."""
        return [(name, border) for name, borders in self._named for border in borders]

    @property
    def _named(self) -> tuple[tuple[str, tuple[Border, ...]], ...]:
        rows = [("smooth running is lost", self.losses), ("existing stick-slip ends", self.ends)]
        rows += [("existing stick-slip stalls", self.stalls)] if self.stalls else []
        rows += [("standstill breaks away", self.breakaways)] if self.breakaways else []
        return tuple(rows)

    def _nearest(self, borders: Sequence[Border]) -> float:
        return min((border.value for border in borders), key=lambda value: abs(value - self.at), default=math.nan)

    @property
    def bistable(self) -> list[tuple[float, float]]:
        """(low, high) of the bands in which smooth running is stable and stick-slip, once begun, stays."""
        cuts = {border.value for _, border in self.borders}
        edges = sorted({float(self.values[0]), float(self.values[-1]), *cuts})
        bands: list[tuple[float, float]] = []
        for low, high in itertools.pairwise(edges):
            if {"smooth", "stick-slip"} <= set(self.regimes((low + high) / 2)):
                if bands and bands[-1][1] == low:
                    low = bands.pop()[0]
                bands.append((low, high))
        return bands

    def regimes(self, value: float) -> tuple[str, ...]:
        """Return which of "smooth", "stick-slip" and "standstill" last at a value of the parameter, once begun. Raises SceneError outside of the range."""
        near = self._near(value)
        lasting = {
            "smooth": self._side(self.losses, value, self.smooth[near].regime == SMOOTH),
            "stick-slip": not self._side((*self.ends, *self.stalls), value, not self.cycling[near]),
            "standstill": not self._side(self.breakaways, value, not self.standing[near]),
        }
        return tuple(name for name, there in lasting.items() if there)

    def _near(self, value: float) -> int:
        """The nearest value that was simulated with the fewest borders between."""
        if not is_finite_number(value) or not self.values[0] <= value <= self.values[-1]:
            raise SceneError(
                f"Argument `value` must be between {self.values[0]:g} and {self.values[-1]:g} {self.unit}, but it is {value!r}."
            )
        cuts = [border.value for _, border in self.borders]
        apart = [sum(min(v, value) < cut <= max(v, value) for cut in cuts) for v in self.values]
        return min(range(self.values.size), key=lambda i: (apart[i], abs(self.values[i] - value)))

    @staticmethod
    def _side(borders: Sequence[Border], value: float, otherwise: bool) -> bool:
        """Whether a value is on the safe side of the border nearest to it; `otherwise` where there is none."""
        if not borders:
            return otherwise
        nearest = min(borders, key=lambda border: abs(border.value - value))
        return (value > nearest.value) == (nearest.safe == "above")

    def verdict(self, value: float) -> str:
        """Return what the machine does at a value of the parameter within the range.

        - "free": smooth whatever was before.
        - "bistable": smooth until disturbed, then stick-slip.
        - "smooth or stuck": smooth until it is stopped for good.
        - "stick-slip" and "stuck": what the least disturbance of smooth running leads to, or what remains without any smooth running.
        - "swing": the disturbance grows without stick.
        - "not decided", "none", "failed": no run could tell, there is no smooth running, a run fails.

        Raises SceneError outside of the range.
        """
        lasting, near = self.regimes(value), self._near(value)
        if "smooth" in lasting:
            return "bistable" if "stick-slip" in lasting else "smooth or stuck" if "standstill" in lasting else "free"
        if "stick-slip" in lasting or "standstill" in lasting:
            return "stick-slip" if "stick-slip" in lasting else "stuck"
        return "swing" if self.smooth[near].regime == SWINGS else self.smooth[near].regime

    @property
    def advice(self) -> str:
        """The working point in one sentence, with its margins to both borders."""
        factor, unit = self._read
        point = f"{self.at * factor:.6g} {unit}"
        if not self.values[0] <= self.at <= self.values[-1]:
            return f"The working point {point} is outside of the range."
        words = {
            "free": "is free: a disturbance dies, and stick-slip that has begun ends.",
            "bistable": f"is bistable: a small disturbance of smooth running dies, and stick-slip exists beside it.{self._reach}",
            "smooth or stuck": "is smooth until it is stopped, and standstill never ends by itself; stick-slip that has begun ends.",
            "stick-slip": "sticks and slips: the least disturbance grows into it.",
            "swing": "swings without stick: the least disturbance grows, and stick-slip that has begun turns into it.",
            "stuck": "comes to rest for good, and does not break away.",
        }
        verdict = self.verdict(self.at)
        margins = []
        names = ("loss of smooth running", "end of stick-slip", "stall of stick-slip", "break-away")
        for name, borders in zip(names, (self.losses, self.ends, self.stalls, self.breakaways), strict=True):
            if borders:
                border = min(borders, key=lambda border: abs(border.value - self.at))
                if abs(border.value) <= border.tolerance:
                    continue  # it may be 0, and what is far from it in parts of it is no margin
                margins.append(f"{100 * border.margin(self.at):+.1f} % to the {name}")
        also = (
            " Standstill lasts as well, once the machine is stopped."
            if verdict == "bistable" and "standstill" in self.regimes(self.at)
            else ""
        )
        return f"The working point {point} {words.get(verdict, f'has no steady running ({verdict}).')}{also}" + (
            f" Margin {', '.join(margins[:-1])}{' and ' if margins[1:] else ''}{margins[-1]}." if margins else ""
        )

    @property
    def _reach(self) -> str:
        """From which starts the stick-slip at the working point is reached, in words; empty if that was not looked at."""
        if not self.reached:
            return ""
        into = [str(each) for each in self.reached if each.reached]
        out = [str(each) for each in self.reached if not each.reached]
        near = self.cycling[self._near(self.at)] and self.sticking[self._near(self.at)]
        period = f" (period {near.interval:.3g} s)" if near and near.regime == STICKS else ""
        words = f" Once the loop is in this stick-slip{period} it stays there."
        words += f" It is reached from {', '.join(into)}." if into else ""
        return words + (f" It is not reached from {', '.join(out)}." if out else "")

    def _told(self) -> list[str | Rows]:
        read = self._read
        span = f"{self.parameter} from {self.values[0] * read.factor:.6g} to {self.values[-1] * read.factor:.6g}{read.tail}"
        return [
            f"Onset of stick-slip: {self.title}",
            f"{span}, judged by `{self.element}` and `{self.signal}`",
            *([self.situation] if self.situation else []),
            "",
            Rows(
                [(name, value + read.tail, note) for name, value, note in self._border_rows()],
                (0, 2),
                headings=("border", self.parameter, ""),
            ),
            "",
            self.advice,
            "",
            *self._side_by_side,
            Rows(self._value_rows(), ()),
            "",
            f"Checked: {self.runs} runs at accuracy {self.accuracy:g}, each carried on until what comes back tells, for {self.duration:.4g} s at most "
            f"({self.duration / self.period:.0f} periods of {self.period:.3g} s); smooth running disturbed by {self.perturbation:g} of the slip; both sides of "
            "each border by runs again at a hundredth of the accuracy; cycles and standstill followed to their ends where they can be.",
            *(f"Note: {note}" for note in self._noted),
        ]

    __repr__ = Told.__str__

    @property
    def _noted(self) -> list[str]:
        """The notes, and where runs could not be told."""
        read = self._read
        values = ", ".join(f"{value * read.factor:.5g}" for value in dict.fromkeys(self.undecided))
        return [*self.notes, *([f"Not decided within {self.duration:.4g} s: {values}{read.tail}."] if values else [])]

    @property
    def _side_by_side(self) -> list[str]:
        """The cycles that live side by side, what each began from and where it ends, and an empty line; nothing where there are none."""
        if not self.coexisting:
            return []
        factor, unit = self._read.factor, self._read.tail
        rows = [
            f"  a stick every {each.period:.3g} s, severity {each.severity:.3g}, from {each.low * factor:.5g} to {each.high * factor:.5g}{unit}; "
            f"begun from {each.begun}"
            for each in self.coexisting
        ]
        last = ""
        for border in self.ends[:1]:
            order = sorted(self.coexisting, key=lambda each: each.high if border.safe == "above" else -each.low)
            last = f" That of {order[0].period:.3g} s ends first, that of {order[-1].period:.3g} s lives longest."
        head = f"At {self.coexisting[0].value * factor:.5g}{unit} {len(rows)} stick-slip cycles live side by side.{last}"
        return [head, *rows, ""]

    @property
    def _read(self) -> Reading:
        """How values of the parameter are read."""
        return reading(self.unit, self.display_units)

    def _border_rows(self) -> list[tuple[str, str, str]]:
        """(name, value, how it is known) of the Hopf points, the borders and the bistable bands."""
        factor = self._read.factor
        rows = [
            (
                f"Hopf point, {p.kind} loss",
                f"{p.value * factor:.6g}",
                f"period {p.period:.3g} s, stable {p.stable}, residual {p.residual:.0e}",
            )
            for p in self.hopf
        ]
        for name, borders in self._named:
            rows += [(name, f"{b.value * factor:.6g}", f"+- {b.tolerance * factor:.2g}, safe {b.safe}" + self._how(b)) for b in borders]
            if not borders:
                rows.append((name, "-", self._nowhere(name)))
        return rows + [
            ("bistable", f"{low * factor:.6g} .. {high * factor:.6g}", "smooth only until disturbed") for low, high in self.bistable
        ]

    def _value_rows(self) -> list[tuple[str, ...]]:
        """Headings, and verdicts at each value."""
        place = heading(self.parameter, self._read.unit)
        cells: list[tuple[str, ...]] = [
            (place, "from smooth running", "severity", "a disturbance", "from stick-slip", "severity", "longest stick", "standstill")
        ]
        for value, a, b, stands in zip(self.values, self.smooth, self.sticking, self.standing, strict=True):
            longest = "for good" if b.regime == STANDS else f"{b.longest:.3g} s" if b.longest else "-"
            number = f"{value * self._read.factor:.5g}"
            cells.append(
                (
                    number,
                    a.regime,
                    shown(a.severity),
                    growth_in_words(a.rate),
                    b.regime,
                    shown(b.severity),
                    longest,
                    "lasts" if stands else "-",
                )
            )
        return cells

    @staticmethod
    def _how(border: Border) -> str:
        """How a border is known, for the report."""
        if border.followed:
            return f", {'by' if border.followed in GROWTHS else 'followed to its'} {border.followed}"
        return "" if border.confirmed else ", NOT confirmed by finer runs"

    def _nowhere(self, name: str) -> str:
        if name.startswith("smooth"):
            everywhere = {judged.regime for judged in self.smooth} == {SMOOTH}
            return (
                "nowhere in the range: smooth running is stable in all of it"
                if everywhere
                else "smooth running is stable nowhere in the range"
            )
        if self.stalls:
            return "nowhere in the range"
        return "nowhere in the range: stick-slip lasts in all of it" if self.cycling.all() else "no stick-slip was found in the range"

    def plot(self, ax: Any = None) -> Any:
        """Draw the bifurcation diagram, speeds of smooth running and of stick-slip, with the borders; see `toolbox.onsets.figures.onset_diagram`."""
        from toolbox.onsets.figures import onset_diagram

        return onset_diagram(self, ax=ax)

    def check_loaded(self) -> None:
        """Raise ValueError where the values of both branches are not as many."""
        if len({len(each) for each in (self.values, self.smooth, self.sticking, self.cycling, self.standing)}) != 1:
            raise ValueError("its branches do not have as many values")

    def _table(self) -> HeadedRows:
        """One row per value: what both branches come to, whether standstill lasts, and the speed of smooth running."""
        rows = []
        steady = self.steady if self.steady.size else np.full(len(self.values), np.nan)
        for value, level, stands, *branches in zip(self.values, steady, self.standing, self.smooth, self.sticking, strict=True):
            cells = [getattr(judged, name) for judged in branches for name in COLUMNS]
            rows.append([float(value), *cells, "lasts" if stands else "", float(level)])
        headings = [
            f"{self.parameter} [{self.unit}]",
            *(f"{branch} {name}" for branch in ("smooth", "sticking") for name in COLUMNS),
            "standstill",
            f"smooth running [{self.signal_unit}]",
        ]
        return headings, rows

    def save_borders(self, path: str | Path) -> Path:
        """Write a csv file with a row per border, whole or not at all. The rows hold the Hopf points and all borders, with tolerance, safe
        side, the regime beyond, and how the border was followed."""
        from toolbox.files import tables

        rows: list[list[object]] = [["Hopf point", point.value, 0.0, point.stable, "", "exact", "yes"] for point in self.hopf]
        for name, border in self.borders:
            rows.append(
                [name, border.value, border.tolerance, border.safe, border.beyond, border.followed, "yes" if border.confirmed else "no"]
            )
        headings = ["border", f"{self.parameter} [{self.unit}]", "tolerance", "safe", "beyond", "followed", "confirmed"]
        return tables.write(path, headings, rows)


COLUMNS = ("regime", "severity", "sticks", "longest", "rate", "lowest", "highest")

GROWTHS = ("poles", "matrices", "differences", "twin runs")
"""Ways in which the growth of smooth running is known."""
