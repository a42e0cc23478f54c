"""From inside: stick-slip and standstill, each found where it exists and carried on to the values where it ends.

Stick-slip is a cycle, standstill a steady state; one may last where the other has ended, so each is carried on by itself. A cycle is looked for at every value
of the range and, because near its border few starts lead into it, outside of the range on both sides as well; from there it is led into the range in
steps so small that it is not shaken off. So neither the range asked nor one start decides whether it is seen. Standstill is the steady state with the
judged contact stuck, where there is one; otherwise what a run ends in.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from toolbox.errors import SceneError
from toolbox.measuring.judge import FAILED, NONE, NOT_DECIDED, SMOOTH, STANDS, STICKS, SWINGS, Judged
from toolbox.modelling.steady_point import Equilibrium
from toolbox.onsets.growth import begun_at, slip_rows
from toolbox.onsets.report import Border
from toolbox.onsets.search import OnsetSearch
from toolbox.robustness.steady_loop import at_set_points
from toolbox.simulation.run_state import RunState
from toolbox.steady_states.equilibria import EquilibriumBranch, flow_slopes

OUTWARD = (0.01, 0.03, 0.06, 0.1, 0.15, 0.25, 0.4, 0.6, 0.8)
"""How far beyond the edge of a range stick-slip is looked for: towards zero by these parts of the edge, away from it to 1/(1 - part) times the edge."""

BEYOND = 1.5
"""Swing of a mode from which stick-slip may start, in parts of what brings the slip of the contact to zero."""

DAMPED = 0.3
"""Damping ratio from which on a mode does not swing enough to begin stick-slip."""

FINEST = 1 / 64
"""The smallest step, in parts of the way, in which stick-slip is led into the range."""

ROUNDS = 6
"""How often all values are looked at again where the search for a border has found stick-slip that was not seen before."""

RANK = (NONE, FAILED, SMOOTH, SWINGS, NOT_DECIDED, STANDS, STICKS)
"""Regimes, the more of a stick-slip the later."""


@dataclass
class Inside:
    """Stick-slip and standstill of one search.

    Attributes
    ----------
    rest
        Steady states with the judged contact stuck; None where a law has no continuous form.
    cycling, standing
        {value: where a run ended} in stick-slip, and in standstill.
    found
        {value: what the runs there came to, of them the one that is most of a stick-slip}.
    became
        {value: what stick-slip that was led there turned into}.
    outer
        Values outside of the range with stick-slip.
    rounds
        {value: (what it began from, verdict, where the run ended)} of all runs that came to stick-slip.
    begun
        (value, beginning) of all that were tried.
    """

    search: OnsetSearch
    rest: EquilibriumBranch | None
    cycling: dict[float, RunState] = field(default_factory=dict)
    standing: dict[float, RunState] = field(default_factory=dict)
    found: dict[float, Judged] = field(default_factory=dict)
    became: dict[float, str] = field(default_factory=dict)
    outer: list[float] = field(default_factory=list)
    rounds: dict[float, list[tuple[str, Judged, RunState]]] = field(default_factory=dict)
    begun: set[tuple[float, str]] = field(default_factory=set)

    @staticmethod
    def of(search: OnsetSearch) -> Inside:
        """Nothing found yet, but what smooth running that was lost has led to."""
        old = search.branch.followed
        rest = old and EquilibriumBranch(old.closed, old.free, old.inputs, {**(old.mode or {}), search.element: "stick"})
        ends = {word: {value: end for value, (regime, end) in search.led.items() if regime == word} for word in (STICKS, STANDS)}
        return Inside(search, rest, ends[STICKS], ends[STANDS])

    # ------------------------------------------------------------------------------------------------------------------------------- beginnings
    def starts(self, value: float) -> Iterator[tuple[str, RunState]]:
        """(what it is, state) from which stick-slip may start: smooth running with the contact stopped, rest, smooth running in which each mode swings."""
        search, smooth = self.search, self.search.branch(value)
        stopped = search.stopped(value)
        if stopped is not None:
            yield "a stopped contact", stopped
        yield "rest", search.base.start
        if smooth is None:
            return
        with contextlib.suppress(SceneError):
            point = at_set_points(search.at(value).loop)
            names = [each.name for each in point.plant.elements]
            row = slip_rows(point.plant, point.states, point.plant.values)[names.index(search.element)]
            exponents, motions = np.linalg.eig(flow_slopes(point))
            for exponent, motion in zip(exponents, motions.T, strict=True):
                damped = -exponent.real > DAMPED * abs(exponent)
                if exponent.imag <= 0.0 or damped or not abs(row @ motion) > 1e-6 * (np.abs(row) @ np.abs(motion)):
                    continue
                moved = np.real(motion * BEYOND * abs(search.steady(value, smooth)[0]) / (row @ motion))
                places = {name: slice(first, first + (size or 1)) for name, (first, size, _) in point.plant.states.items()}
                states = {name: np.atleast_1d(smooth.state[name]) - moved[place] for name, place in places.items()}
                yield f"the swing of {2 * math.pi / exponent.imag:.3g} s", smooth.state.with_values(states)

    def standstill(self, value: float) -> RunState | None:
        """The steady state with the contact stuck, where there is one that stays."""
        if value not in self.standing:
            point = self._stuck_state(value)
            if point is None:
                return None
            judged, end = self.search.run(value, begun_at(self.search.at(value), point))
            if judged.regime == STANDS and end is not None:
                self.standing[value] = end
        return self.standing.get(value)

    def _stuck_state(self, value: float) -> Equilibrium | None:
        try:
            return self.rest(value) if self.rest is not None else None
        except SceneError:  # the number itself is refused there
            return None

    # ---------------------------------------------------------------------------------------------------------------------------------- stick-slip
    def tried(self, value: float, begin: RunState, finer: float = 1.0, begun: str = "stick-slip carried on") -> Judged:
        """A run from a beginning, with where it ends kept by what it ends in; begun: what it begins from."""
        judged, end = self.search.run(value, begin, finer=finer)
        if end is not None and judged.regime == STICKS:
            self.cycling[value] = end
            self.rounds.setdefault(value, []).append((begun, judged, end))
        elif end is not None and judged.regime == STANDS:
            self.standing.setdefault(value, end)
        if value not in self.found or worse(judged, self.found[value]):
            self.found[value] = judged
        return judged

    def seek(self, value: float) -> RunState | None:
        """Stick-slip at a value from all beginnings, until one leads into it."""
        for begun, begin in () if value in self.cycling else self._untried(value):
            if self.tried(value, begin, begun=begun).regime == STICKS:
                break
        return self.cycling.get(value)

    def begun_from_all(self, value: float) -> None:
        """Begin stick-slip at a value from all beginnings; the cycle that is carried on stays the one that was known."""
        known = self.cycling.get(value)
        for begun, begin in self._untried(value):
            self.tried(value, begin, begun=begun)
        if known is not None:
            self.cycling[value] = known

    def _untried(self, value: float) -> Iterator[tuple[str, RunState]]:
        """The beginnings at a value that were not tried yet."""
        for begun, begin in self.starts(value):
            if (value, begun) not in self.begun:
                self.begun.add((value, begun))
                yield begun, begin

    def outside(self, edge: float, sign: float, width: float) -> None:
        """Stick-slip outside of an edge of the range, led up to the edge; sign: the way out."""
        for value in outward(edge, sign, width):
            try:
                end = self.seek(value)
            except SceneError:  # the number itself is refused there
                return
            if end is not None:
                self.outer.append(value)
                self.led(value, edge)
                return

    def led(self, origin: float, goal: float) -> bool:
        """Whether stick-slip at one value reaches another, in steps that are halved where it is lost; where it comes to is kept."""
        part, size = 0.0, 0.25
        here = origin
        while part < 1.0 and size >= FINEST:
            following = origin + (goal - origin) * min(part + size, 1.0)
            begin = self.search.walked(self.cycling[here], here, following)
            if self.tried(following, begin).regime == STICKS:
                part, here = min(part + size, 1.0), following
            else:
                size /= 2
        return part >= 1.0

    def sweep(self, values: Sequence[float]) -> list[Judged]:
        """Verdicts from inside stick-slip at all values: from beginnings at each, and carried on upwards and downwards from value to value."""
        for value in values:
            if value not in self.found:
                self.seek(value)
                self.found.setdefault(value, Judged(NONE))
        for row in (sorted({*values, *self.outer}), sorted({*values, *self.outer}, reverse=True)):
            carried: list[RunState] = []
            for before, value in itertools.pairwise(row):
                carried = [*([self.cycling[before]] if before in self.cycling else []), *carried[:1]]
                if value not in self.cycling:
                    for begin in carried:
                        if self.tried(value, self.search.walked(begin, before, value)).regime == STICKS:
                            break
        for value in values:
            if value in self.cycling and self.found[value].regime != STICKS:
                self.found[value] = self.search.run(value, self.cycling[value])[0]
            self.standstill(value)
        return [self.found[value] for value in values]

    def is_free(self, value: float, origin: float, finer: float = 1.0) -> bool:
        """Whether stick-slip, led on from where it was found, ends at a value."""
        if origin not in self.cycling:  # a finer run has shown that there is none
            origin = min(self.cycling, key=lambda each: abs(each - value), default=math.nan)
        if math.isnan(origin):
            return True
        judged = self.tried(value, self.search.walked(self.cycling[origin], origin, value), finer)
        free = judged.regime not in (STICKS, NOT_DECIDED)
        self.became[value] = judged.regime
        if free and value == origin:  # what a coarser run took for a cycle is none
            del self.cycling[value]
            self.found[value] = judged
        return free

    # ---------------------------------------------------------------------------------------------------------------------------------- standstill
    def is_moving(self, value: float, origin: float, finer: float = 1.0) -> bool:
        """Whether standstill, carried on from where it was found, ends at a value."""
        if finer == 1.0 and self.standstill(value) is not None:
            return False
        judged, end = self.search.run(value, self.search.walked(self.standing[origin], origin, value), finer=finer)
        if judged.regime == STANDS and end is not None:
            self.standing[value] = end
        return judged.regime != STANDS

    def ends(self, values: Sequence[float], tolerance: float) -> list[Border]:
        """The borders of stick-slip, each with what the cycle turns into beyond it."""
        for _ in range(ROUNDS):
            self.sweep(values)
            there = [value in self.cycling for value in values]
            borders = self.search.borders(values, [not each for each in there], self.is_free, tolerance)
            if there == [value in self.cycling for value in values]:
                break  # else the search for a border found stick-slip that the sweep had lost, or took it for a transient
        return [dataclasses.replace(border, beyond=self._beyond(border)) for border in borders]

    def _beyond(self, border: Border) -> str:
        """The verdict next to a border of stick-slip, on the side without it."""
        sign = 1.0 if border.safe == "above" else -1.0
        safe = [value for value, word in self.became.items() if word not in (STICKS, NOT_DECIDED) and sign * (value - border.value) > 0]
        return self.became[min(safe, key=lambda value: abs(value - border.value))] if safe else ""

    def breakaways(self, values: Sequence[float], tolerance: float) -> list[Border]:
        """The borders of standstill: exact where it is a steady state up to there, else by runs."""
        there = [value in self.standing for value in values]
        borders = []
        for border in self.search.borders(values, [not each for each in there], self.is_moving, tolerance):
            sign = 1.0 if border.safe == "above" else -1.0
            inner, outer = border.value - sign * border.tolerance, border.value + sign * border.tolerance
            known = [self._stuck_state(inner), self._stuck_state(outer)]
            if self.rest is not None and known[0] is not None and known[1] is None:
                edge = self.rest.edge(inner, outer)
                border = Border(
                    edge, max(1e-6 * abs(outer - inner), 1e-12 * abs(edge)), border.safe, border.confirmed, followed="break-away"
                )
            borders.append(border)
        return borders


def outward(edge: float, sign: float, width: float) -> list[float]:
    """Values beyond an edge of a range of that width, the nearest first; none changes its sign. sign: the way out."""
    if edge * sign < 0:
        return [edge * (1 - part) for part in OUTWARD]
    return [edge + sign * max(abs(edge) * part / (1 - part), part * width) for part in OUTWARD]


def worse(judged: Judged, other: Judged) -> bool:
    """Whether a verdict is more of a stick-slip than another."""
    return RANK.index(judged.regime) > RANK.index(other.regime)
