"""From inside: stick-slip and standstill, each found where it exists and carried on to the values where it ends.

Stick-slip is a cycle, standstill a steady state; one may last where the other has ended, so each is carried on by itself. A cycle is looked for at every value
of the range and, because near its border few starts lead into it, outside of the range on both sides as well; from there it is led into the range in
steps so small that it is not shaken off. So neither the range asked nor one start decides whether it is seen. Standstill is the steady state with the
judged contact stuck, where there is one; otherwise what a run ends in.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from toolbox.errors import SceneError
from toolbox.measuring.judge import NONE, NOT_DECIDED, STANDS, STICKS, Judged
from toolbox.modelling.steady_point import Equilibrium
from toolbox.onsets.carried import Carried
from toolbox.onsets.growth import begun_at
from toolbox.onsets.reach import HELD, held_starts
from toolbox.onsets.results import Border
from toolbox.onsets.search import OnsetSearch
from toolbox.simulation.run_state import RunState
from toolbox.steady_states.equilibria import EquilibriumBranch

OUTWARD = (0.01, 0.03, 0.06, 0.1, 0.15, 0.25, 0.4, 0.6, 0.8)
"""How far beyond the edge of a range stick-slip is looked for: towards zero by these parts of the edge, away from it to 1/(1 - part) times the edge."""

ROUNDS = 6
"""How often all values are looked at again where the search for a border has found stick-slip that was not seen before."""


@dataclass(kw_only=True)
class Inside(Carried[float]):
    """Stick-slip and standstill of one search, over one number.

    Attributes
    ----------
    rest
        Steady states with the judged contact stuck; None where a law has no continuous form.
    became
        {value: what stick-slip that was led there turned into}.
    held
        Values at which the controllers took over the stick-slip under constant commands.
    remembered
        Where stick-slip ended that lives on where it is led in smaller steps; None where there is none.
    """

    search: OnsetSearch
    rest: EquilibriumBranch | None
    became: dict[float, str] = field(default_factory=dict)
    remembered: float | None = None
    held: set[float] = field(default_factory=set)

    @staticmethod
    def of(search: OnsetSearch) -> Inside:
        """Return the search from inside, before any run of its own. The search starts with the stick-slip and standstill to which lost
        smooth running has led."""
        old = search.followed
        rest = old and EquilibriumBranch(old.closed, old.free, old.inputs, {**(old.mode or {}), search.element: "stick"})
        ends = {word: {value: end for value, (regime, end) in search.led.items() if regime == word} for word in (STICKS, STANDS)}
        return Inside(search=search, rest=rest, cycling=ends[STICKS], standing=ends[STANDS])

    def standstill(self, value: float) -> RunState | None:
        """Return the steady state with the contact stuck. None if there is no such state, or if it does not last."""
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
            if value not in self.cycling and value not in self.held:
                self.held.add(value)
                for begin in held_starts(self.search, value):
                    if self.tried(value, begin, begun=HELD).regime == STICKS:
                        break
            if value in self.cycling and self.found[value].regime != STICKS:
                self.found[value] = self.search.run(value, self.cycling[value])[0]
            self.standstill(value)
        return [self.found[value] for value in values]

    def is_free(self, value: float, origin: float, finer: float = 1.0) -> bool:
        """Return whether stick-slip that is carried on from its origin ends at a value."""
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
        """Return whether standstill that is carried on from its origin ends at a value."""
        if finer == 1.0 and self.standstill(value) is not None:
            return False
        judged, end = self.search.run(value, self.search.walked(self.standing[origin], origin, value), finer=finer)
        if judged.regime == STANDS and end is not None:
            self.standing[value] = end
        return judged.regime != STANDS

    def ends(self, values: Sequence[float], tolerance: float) -> list[Border]:
        """Return the borders of stick-slip, each with the regime beyond the border."""
        for _ in range(ROUNDS):
            self.sweep(values)
            there = [value in self.cycling for value in values]
            borders = self.search.borders(values, [not each for each in there], self.is_free, tolerance)
            if self.search.base.system.updates:
                borders = [self._outlasted(border, values, tolerance) for border in borders]
            if there == [value in self.cycling for value in values]:
                break  # else the search for a border found stick-slip that the sweep had lost, or took it for a transient
        if self.remembered is not None:
            where = f"{self.remembered:.6g} {self.search.free.unit}"
            self.search.notes.append(
                f"Where stick-slip ends depends on what the law remembers: led in large steps it may end at {where} already."
            )
        return [dataclasses.replace(border, beyond=self._beyond(border)) for border in borders]

    def _outlasted(self, border: Border, values: Sequence[float], tolerance: float) -> Border:
        """A border of stick-slip under a sampled law, or the one further out to which stick-slip from a value before it lives in small steps.

        What such a law remembers may be lost in large steps, as that it has given up to lift its set-point, and with it the stick-slip.
        """
        sign = 1.0 if border.safe == "above" else -1.0
        before = sorted((v for v in values if v in self.cycling and sign * (border.value - v) > 0), key=lambda v: -sign * v)
        free = min((v for v in values if v not in self.cycling and sign * (v - border.value) > 0), key=lambda v: sign * v, default=None)
        if free is None:
            return border
        beyond = border.value + 2.0 * sign * border.tolerance
        for origin in before[:2]:  # the nearest may be on its way out
            if self.led(origin, beyond):
                self.led(beyond, free)
                reached = max((v for v in self.cycling if sign * (free - v) >= 0), key=lambda v: sign * v)
                self.remembered = border.value
                return border if reached == free else self.search.borders((reached, free), (False, True), self.is_free, tolerance)[0]
        return border

    def _beyond(self, border: Border) -> str:
        """The verdict next to a border of stick-slip, on the side without it."""
        sign = 1.0 if border.safe == "above" else -1.0
        safe = [value for value, word in self.became.items() if word not in (STICKS, NOT_DECIDED) and sign * (value - border.value) > 0]
        return self.became[min(safe, key=lambda value: abs(value - border.value))] if safe else ""

    def breakaways(self, values: Sequence[float], tolerance: float) -> list[Border]:
        """Return the borders of standstill. A border is exact if standstill is a steady state up to the border, and is found by runs
        otherwise."""
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
