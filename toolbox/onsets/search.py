"""The borders of an onset: where the regimes of neighbours differ, the way between them is halved.

Smooth running needs no run where its growth is known: it is lost where the growth changes its sign. Where it grows, a run from a small disturbance tells
what it becomes (`toolbox.onsets.carried`). How stick-slip and standstill are found and carried on is told in `toolbox.onsets.inside`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from toolbox.errors import SimulationError
from toolbox.measuring.judge import SMOOTH
from toolbox.modelling.numbers import Number
from toolbox.onsets.carried import STEPS, JudgedRuns
from toolbox.onsets.results import Border
from toolbox.steady_states.equilibria import EquilibriumBranch

FINER = 0.01
"""Part of the accuracy at which both sides of a border are judged again."""

WIDENINGS = 6
"""How often a border is widened where finer runs judge its sides otherwise."""


def _halved(test: Callable[..., bool], good: float, bad: float, tolerance: float, **how: float) -> tuple[float, float]:
    """The way from a value where a test holds to one where it does not, halved to the tolerance: (good, bad)."""
    while 1.5 * abs(good - bad) > tolerance:
        middle = (good + bad) / 2
        if test(middle, bad, **how):
            good = middle
        else:
            bad = middle
    return good, bad


def _carried(test: Callable[..., bool], good: float, bad: float, tolerance: float) -> tuple[float, float]:
    """The same for what is carried on from `bad`, and what large steps shake off: it is led on from the border found in steps as small as the last interval."""
    outer = good
    while True:
        good, bad = _halved(test, good, bad, tolerance)
        reached, size = bad, STEPS * (good - bad)
        while abs(reached + size - bad) < abs(outer - bad) and not test(reached + size, reached):
            reached, size = reached + size, 2 * size
        if reached == bad:
            return good, bad
        good, bad = min(reached + size, outer, key=lambda value: abs(value - reached)), reached


@dataclass(kw_only=True)
class OnsetSearch(JudgedRuns[float]):
    """Runs of one closed loop over one number, with the borders between their regimes; followed: the steady states of its continuous form."""

    free: Number
    followed: EquilibriumBranch | None

    def losses(self, values: Sequence[float], tolerance: float) -> list[Border]:
        """Return the borders of smooth running: the places at which its growth changes sign. If the growth is not known, the border is
        searched between neighbours with and without smooth running."""
        safe = [self._is_smooth(value, value) for value in values]
        found = []
        for (a, safe_a), (b, safe_b) in itertools.pairwise(zip(values, safe, strict=True)):
            if safe_a == safe_b:
                continue
            try:
                found.append(self._where_growth_is_zero(a, b, tolerance))
            except SimulationError:
                found += self.borders((a, b), (safe_a, safe_b), self._is_smooth, tolerance)
        return found

    def _where_growth_is_zero(self, a: float, b: float, tolerance: float) -> Border:
        """The border of smooth running between two values; raises SimulationError where its growth is not known on both sides."""
        a, b = self.branch.bracket(a, b)
        smooth = self.branch(a)
        way = smooth.growth.way if smooth is not None else ""
        precision = 1e-9 * max(abs(a), abs(b)) if way != "twin runs" else tolerance / 10
        value = self.branch.loss(a, b, precision)
        width = precision if way == "poles" else self.branch.width(value, a, b, precision)
        return Border(value, width, "above" if self.branch.rate(b) < 0 else "below", True, followed=way)

    def _is_smooth(self, value: float, origin: float, finer: float = 1.0) -> bool:
        return not self.branch.rate(value) > 0 and self.smooth(value, finer).regime == SMOOTH  # what grows needs no run to be unsafe

    # ---------------------------------------------------------------------------------------------------------------------------------- borders
    def borders(self, values: Sequence[float], safe: Sequence[bool], test: Callable[..., bool], tolerance: float) -> list[Border]:
        """The borders between neighbours of different verdict, halved to the tolerance, then judged again at a hundredth of the accuracy.

        What is judged otherwise there, since the border moves with the accuracy, is passed by ever longer steps, so that the border lies between what is sure;
        what is then between them is halved by runs at that accuracy. What a sampled law does is also led on from the border in small steps.
        """
        found: list[Border] = []
        alone = bool(self.base.system.updates)  # a sampled law has no cycle that could be followed from near the border to where it ends
        for (a, safe_a), (b, safe_b) in itertools.pairwise(zip(values, safe, strict=True)):
            if safe_a == safe_b:
                continue
            good, bad = outer_good, outer_bad = (a, b) if safe_a else (b, a)
            good, bad = (_carried if alone else _halved)(test, good, bad, tolerance)
            confirmed = False
            for _ in range(WIDENINGS):
                wrong = next((each for each in (good, bad) if test(each, bad, finer=FINER) != (each == good)), None)
                confirmed = wrong is None
                if wrong in (None, outer_good, outer_bad):
                    break
                step = 2 * (bad - good)
                if wrong == good:
                    good = good - step if abs(good - step - bad) < abs(outer_good - bad) else outer_good
                else:
                    bad = bad + step if abs(bad + step - good) < abs(outer_bad - good) else outer_bad
            if confirmed and alone:  # where it was widened
                good, bad = _halved(test, good, bad, tolerance, finer=FINER)
            found.append(Border((good + bad) / 2, 1.5 * abs(good - bad), "above" if good > bad else "below", confirmed))
        return found
