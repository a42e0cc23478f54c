"""The outcomes of the worst case of a closed loop: printed, compared, tabled and drawn."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from toolbox.errors import SceneError
from toolbox.files.printing import Rows, Told, shown
from toolbox.files.results import HeadedRows, Result
from toolbox.measuring.verdict import growth_in_words


@dataclass(frozen=True)
class Outcome:
    """A run, and its result in the judged window.

    Attributes
    ----------
    error
        The model error in words; "nominal" where there is none.
    start, seed
        Index of the start, and seed of the noise.
    stuck
        Share of the window in which the contact sticks [1].
    mean_error
        Error of the mean speed, as a part of its target [1].
    ripple
        Half the range of the command by its mean, the largest of any command [1].
    rate
        Rate at which a small disturbance of smooth running grows on this machine [1/s]; nan where it is not known.
    failure
        Why the run could not be finished, or its verdict if that is a failure; empty for other runs.
    excess
        The largest of these by what is allowed, infinite for a run that sticks, grows or fails; at most 1 is a success.
    verdict
        The verdict on the run, as a study of the same run says it (`toolbox.measuring.verdict`).
    more
        {name: value} of further measures.
    """

    error: str
    start: int
    seed: int
    stuck: float
    mean_error: float
    ripple: float
    rate: float
    failure: str
    excess: float
    verdict: str = ""
    more: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class WorstCase(Told, Result):
    """Outcomes of the runs of a loop with model errors, starts and seeds, the result of `worst_case`.

    `print(found)` shows the worst outcome of each error, `found.worst` is the worst outcome of all runs.

    Attributes
    ----------
    title
        The controllers and how they run.
    run_conditions
        Start of the runs, the judged contact, and time from which runs are judged.
    outcomes
        One `Outcome` per run.
    seconds
        Computing time of the runs [s].
    situation
        The situation for which the verdict holds, in one line.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose, worst_case
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="60 kN")), Sampled(SoftTorque(reference="120 rpm"), "10 ms"))
    >>> print(len(worst_case(loop, "60 s", uncertainty={"bit.weight": "10 %"}).outcomes), "runs")
    3 runs
    """

    title: str
    run_conditions: str
    outcomes: tuple[Outcome, ...]
    seconds: float = field(default=0.0, compare=False)
    situation: str = ""

    @property
    def _more(self) -> list[str]:
        """The names of further measures."""
        return list(self.outcomes[0].more) if self.outcomes else []

    @property
    def worst(self) -> Outcome:
        """The outcome with the largest excess over the allowed values. Raises SceneError if no plant has the stick-slip
        from which runs were to start.
        """
        if not self.outcomes:
            raise SceneError(f"There is no worst outcome, because there was no run: {self.run_conditions}.")
        return max(self.outcomes, key=_badness)

    @property
    def survives(self) -> bool:
        """Whether every run is a success."""
        return all(outcome.excess <= 1.0 for outcome in self.outcomes)

    @property
    def by_error(self) -> dict[str, Outcome]:
        """{name of the error: worst outcome over starts and seeds}, in the order of the trials."""
        found: dict[str, Outcome] = {}
        for outcome in self.outcomes:
            known = found.get(outcome.error)
            found[outcome.error] = outcome if known is None else max(known, outcome, key=_badness)
        return found

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The table as text: the worst outcome of each error, and how many of its runs fail."""
        lines: list[tuple[str, ...]] = [
            ("error", "failed", "verdict", "start", "seed", "stuck", "mean error", "ripple", "a disturbance", *self._more)
        ]
        for error, worst in self.by_error.items():
            own = [outcome for outcome in self.outcomes if outcome.error == error]
            failed = sum(outcome.excess > 1.0 for outcome in own)
            numbers = [percent(each) for each in (worst.stuck, worst.mean_error, worst.ripple)]
            numbers += [growth_in_words(worst.rate), *(f"{value:.4g}" for value in worst.more.values())]
            lines.append((error, f"{failed} of {len(own)}", worst.verdict, str(worst.start), str(worst.seed), *numbers))
        return lines

    def _told(self) -> list[str | Rows]:
        failed = sum(outcome.excess > 1.0 for outcome in self.outcomes)
        if not self.outcomes:
            return [
                f"Worst case of {self.title}: no run, because there is no stick-slip to start from",
                f"  {self.situation or self.run_conditions}",
            ]
        verdict = "every run succeeds" if not failed else f"{failed} of {len(self.outcomes)} runs fail, the worst with {self.worst.error}"
        return [
            f"Worst case of {self.title}: {verdict}",
            f"  {self.situation or self.run_conditions}",
            Rows(self.rows),
        ]

    def _table(self) -> HeadedRows:
        """One row per run."""
        headings = ["error", "start", "seed", "stuck", "mean error", "ripple", "rate [1/s]", "failure", "excess", "verdict", *self._more]
        return headings, [[*list(vars(outcome).values())[:-1], *outcome.more.values()] for outcome in self.outcomes]

    def plot(self, axes: Any = None) -> Any:
        """Draw stick time and ripple of every run by its error (`toolbox.robustness.figures.worst_case_diagram`), and return both axes.

        Parameters
        ----------
        axes
            Two matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.robustness.figures import worst_case_diagram

        rows = [(o.error, o.stuck, o.ripple, o.excess <= 1.0) for o in self.outcomes]
        return worst_case_diagram(rows, axes=axes)


def _badness(outcome: Outcome) -> tuple[bool, float, float, float]:
    """By what outcomes are compared: runs that fail, then the time stuck, then the excess."""
    stuck = 0.0 if math.isnan(outcome.stuck) else outcome.stuck
    finite = outcome.excess if math.isfinite(outcome.excess) else 0.0
    return bool(outcome.failure), stuck, finite, outcome.ripple if math.isfinite(outcome.ripple) else 0.0


def percent(value: float) -> str:
    """A part in per cent as a report says it."""
    return shown(100.0 * value, ".2g", " %")
