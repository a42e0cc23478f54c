"""The worst case of a closed loop: the machine itself, with model errors, from phases of a stick-slip that exists, and with the noise of several seeds.

Margins speak about a line at one point. What an engineer has to promise is another thing: a law that is switched on while the bit sticks and slips ends
that, on a machine that is not the declared one, whatever the phase and whatever the noise. Every error is tried alone, then the corners, each from every
start with every seed; the runs that differ by numbers alone step side by side (`sweep`).
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from toolbox.arguments import mapping, number, numbers, short
from toolbox.errors import SceneError, SimulationError, suggest
from toolbox.files.printing import Rows, Told, shown
from toolbox.files.results import HeadedRows, Result
from toolbox.files.units import NumberOrText
from toolbox.measuring.judge import CALM, STANDS, STICKS, told_growth
from toolbox.measuring.metrics import Metric, maximum, mean, minimum, stuck_ratio
from toolbox.messages import sign_of_life
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.closing import all_described
from toolbox.modelling.laws import Sampled
from toolbox.modelling.numbers import put_all
from toolbox.onsets.coming_to import Settled
from toolbox.onsets.takeover import reference_of, taken_over
from toolbox.robustness.starts import Found, SmoothRunning, Start, Starts, start_of
from toolbox.scenes.judged import judged_contact, judged_measures, judged_speed
from toolbox.scenes.situation import Situation
from toolbox.simulation.simulate import simulate
from toolbox.sweeps.sweep import sweep

DELAY = "delay"
"""The name by which the delay of sampled laws is varied."""


@dataclass(frozen=True)
class Outcome:
    """One run, and what came of it in the judged window.

    Attributes
    ----------
    error
        The model error in words; "nominal" where there is none.
    start, seed
        Index of the start, and seed of the noise.
    stuck
        Part of the window that the contact sticks [1].
    mean_error
        Error of the mean speed, as a part of its target [1].
    ripple
        Half the range of the command by its mean, the largest of any command [1].
    rate
        Rate at which a small disturbance of smooth running grows on this machine [1/s]; nan where it is not known.
    failure
        Why the run could not be finished, or what it comes to in spite of a calm window; empty where neither is so.
    excess
        The largest of these by what is allowed, infinite for a run that sticks, grows or fails; at most 1 is a success.
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
        lines: list[tuple[str, ...]] = [("error", "failed", "start", "seed", "stuck", "mean error", "ripple", "a disturbance", *self._more)]
        for error, worst in self.by_error.items():
            own = [outcome for outcome in self.outcomes if outcome.error == error]
            failed = sum(outcome.excess > 1.0 for outcome in own)
            numbers = [percent(each) for each in (worst.stuck, worst.mean_error, worst.ripple)]
            numbers += [told_growth(worst.rate), *(f"{value:.4g}" for value in worst.more.values())]
            lines.append((error, f"{failed} of {len(own)}", str(worst.start), str(worst.seed), *numbers))
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
        headings = ["error", "start", "seed", "stuck", "mean error", "ripple", "rate [1/s]", "failure", "excess", *self._more]
        return headings, [[*list(vars(outcome).values())[:-1], *outcome.more.values()] for outcome in self.outcomes]

    def plot(self, axes: Any = None) -> Any:
        """Draw stick time and ripple of every run by its error (`toolbox.robustness.figures.worst_case_diagram`), and return both axes."""
        from toolbox.robustness.figures import worst_case_diagram

        rows = [(o.error, o.stuck, o.ripple, o.excess <= 1.0) for o in self.outcomes]
        return worst_case_diagram(rows, axes=axes)


@sign_of_life("worst_case is at work")
@takes_loop
def worst_case(
    loop: ClosedLoop,
    duration: NumberOrText,
    *,
    uncertainty: Mapping[str, float | str | Sequence[float | str]] | None = None,
    corners: Sequence[Mapping[str, float | str]] = (),
    starts: Start | Starts | None = None,
    seeds: Sequence[int] = (0,),
    after: NumberOrText | None = None,
    mean_within: float = 0.02,
    ripple_within: float = 0.05,
    metrics: Any = (),
) -> WorstCase:
    """Test a closed loop with model errors: run it with every error, from every start and with every seed of its noise.

    A run succeeds if, from `after` on,

    - the contact never sticks,
    - the mean speed is within `mean_within` of its target,
    - no command deviates by more than `ripple_within` of its mean, and
    - smooth running is stable on the machine of this run: a small disturbance must not grow, however slowly. A run that
      still oscillates at its end is continued until its regime can be decided.

    Inputs that vary in time count with their last value. If an input never becomes constant, only the time from `after`
    on decides.

    Parameters
    ----------
    loop
        A loop. Controllers are designed on the nominal plant, and errors of parameters do not change their design. The
        target of the mean speed is the `reference` of the loop.
    duration
        Length of a run [s].
    uncertainty
        {number of the loop: factor, or several factors}. Each factor is tried alone. "20 %" means 0.8 and 1.2, "+20 %"
        means 1.2 alone. "delay" is the delay of the sampled controllers.
    corners
        Mappings {number of the loop: factor}. Each mapping is tried with all its errors at once. A percentage needs its
        sign here: "+20 %".
    starts
        Starts of the runs:

        - `SmoothRunning()` (default), which needs constant inputs.
        - `TakenOver(initial_controller)`: from the stick-slip of another controller on each machine.
        - `OwnStickSlip()`: from the stick-slip of the loop itself.
        - Start values {state or held command: value} of each run, such as `cycle_phases` returns.
    seeds
        Seeds of the noise of `Sampled`, used if it has noise.
    after
        Time from which on a run is judged [s]. By default the last 30 % of the run.
    mean_within, ripple_within
        Allowed error of the mean speed as a fraction of its target [1], and allowed ripple of a command to either side
        as a fraction of its mean [1].
    metrics
        Further metrics of every run from `after` on: names of `toolbox.measuring.metrics.METRICS`, functions of the
        run, or {name: metric}.

    Returns
    -------
    WorstCase
        The outcome of every run.

    Raises
    ------
    SceneError
        If a name is unknown, or a number is not finite or out of range.

    Examples
    --------
    >>> from controllers import SoftTorque, StiffPI
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose, worst_case
    >>> from toolbox.robustness import TakenOver
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), Sampled(SoftTorque(reference="95 rpm"), "10 ms", delay="30 ms"))
    >>> found = worst_case(loop, "150 s", uncertainty={"bit.weight": "10 %"}, starts=TakenOver(StiffPI(), phases=2))
    >>> print(found.survives)
    True
    """
    trials = Trials.of(loop, duration, starts=starts, seeds=seeds, after=after, allowed=(mean_within, ripple_within), metrics=metrics)
    return trials.of_cases(cases_of(uncertainty, corners))


@dataclass(frozen=True)
class Trials:
    """How a loop is run and judged on machines that differ from the declared one by factors of its numbers.

    window: time from which on a run is judged [s];  start: where runs start, found on each machine;  given: start values in place of that;  target: of the
    mean speed;  allowed: (error of the mean, ripple);  measures: more;  known: the judges of machines by the words of their errors;  begun: their starts.
    """

    loop: ClosedLoop
    duration: float
    window: float
    start: Start | None
    given: Starts
    seeds: Sequence[int]
    target: float
    allowed: tuple[float, float]
    metrics: Any = ()
    known: dict[str, Settled | None] = field(default_factory=dict, compare=False)
    begun: dict[str, Found] = field(default_factory=dict, compare=False)

    @classmethod
    def of(
        cls,
        loop: ClosedLoop,
        duration: NumberOrText,
        *,
        starts: Start | Starts | None,
        after: NumberOrText | None,
        seeds: Sequence[int] = (0,),
        allowed: tuple[float, float] = (0.02, 0.05),
        metrics: Any = (),
    ) -> Trials:
        """Trials as `worst_case` and its neighbours are asked for them; raises SceneError for an argument that is none."""
        duration = number("duration", duration, "s", above=0)
        window = 0.7 * duration if after is None else number("after", after, "s")
        noisy = any(isinstance(law, Sampled) and law.noise for law in loop.controllers)
        start = start_of(starts)
        given: Starts = [] if start is not None else list(starts)  # type: ignore[arg-type]
        aim = reference_of(loop, judged_speed(loop, judged_contact(loop)))
        wanted = math.nan if aim is None else aim
        return cls(loop, duration, window, start, given, seeds if noisy else (0,), wanted, allowed, metrics)

    @cached_property
    def contact(self) -> str:
        """The contact whose sticks count."""
        return judged_contact(self.loop)

    @cached_property
    def speed(self) -> str:
        """The signal whose mean is judged."""
        return judged_speed(self.loop, self.contact)

    @cached_property
    def actuated_signals(self) -> list[str]:
        """The commands of the laws."""
        return [name for name in self.loop.plant.inputs if name not in self.loop.system.inputs]

    @property
    def way(self) -> str:
        """From where the runs begin, which contact is judged, and when, in words."""
        return f"runs of {self.duration:g} s from {self._begins}; `{self.contact}` judged from {self.window:g} s on{self._notes}"

    @property
    def _begins(self) -> str:
        """From where the runs start, in words."""
        return f"{len(self.given)} given start(s)" if self.start is None else self.start.words

    @property
    def _notes(self) -> str:
        """On which machines there is no stick-slip to start from, and why."""
        notes: dict[str, list[str]] = {}
        for error, found in self.begun.items():
            if found.note:
                notes.setdefault(found.note, []).append(error)
        return "".join(f"; {note} ({', '.join(errors)})" for note, errors in notes.items())

    def machine(self, factors: Mapping[str, float], seed: int = 0) -> ClosedLoop:
        """The loop with factors of its numbers, and with a seed of its noise."""
        loop = self.loop.with_controllers(as_run(law, factors.get(DELAY, 1.0), seed) for law in self.loop.controllers)
        return put_all(loop, {name: factor * declared_value(self.loop, name) for name, factor in factors.items() if name != DELAY})

    def settled(self, error: str, machine: ClosedLoop) -> Settled | None:
        """The judge of the machine of an error, which is made once, whatever the start and the seed; None where it can say nothing."""
        if error not in self.known:
            self.known[error] = Settled.of(machine, self.contact, self.speed, self.window)
        return self.known[error]

    def situation(self, plants: str) -> Situation:
        """The situation of the verdicts on some plants."""
        lasts = f"{self.duration:g} s, `{self.contact}` judged from {self.window:g} s on{self._notes}"
        return Situation.of(self.loop, self._begins, lasts, plants=plants)

    def starts(self, error: str, factors: Mapping[str, float]) -> Starts:
        """The start values of the runs of an error: smooth running is that of the nominal plant, stick-slip that of the machine itself."""
        if self.start is None:
            return [taken_over(self.loop, start) for start in self.given]
        shared = isinstance(self.start, SmoothRunning)
        key = "nominal" if shared else error
        if key not in self.begun:
            self.begun[key] = self.start.on(self.loop if shared else self.machine(factors))
        return self.begun[key].values

    def of_cases(self, cases: Mapping[str, Mapping[str, float]]) -> WorstCase:
        """The outcome of every start and seed in every case {error in words: {number of the loop: factor}}."""
        loop = self.loop
        names = sorted({name for case in cases.values() for name in case if name != DELAY})
        names = names or [next(entry.name for entry in loop.plant.parameters.values() if entry.size is None)]  # a sweep varies something
        declared = {name: declared_value(loop, name) for name in names}
        more = judged_measures(self.metrics, loop, 0.0, self.duration, after=self.window) if self.metrics else {}
        asked = self._read | {f"further {name}": each for name, each in more.items()}
        found: list[Outcome] = []
        seconds = 0.0
        delays = sorted({case.get(DELAY, 1.0) for case in cases.values()})
        begins = {label: self.starts(label, case) for label, case in cases.items()}
        for late, seed, k in itertools.product(delays, self.seeds, range(max(map(len, begins.values())))):
            own = {label: case for label, case in cases.items() if case.get(DELAY, 1.0) == late and k < len(begins[label])}
            if not own:
                continue
            rows = [{name: value * case.get(name, 1.0) for name, value in declared.items()} for case in own.values()]
            by_row = {tuple(row.values()): begins[label][k] for row, label in zip(rows, own, strict=True)}
            varied = self.machine({DELAY: late}, seed)
            done = sweep(varied, rows, self.duration, start=lambda row, known=by_row: known[tuple(row.values())], metrics=asked)  # type: ignore[misc]
            seconds += done.seconds
            for i, label in enumerate(own):
                numbers = {name: float(done[name][i]) for name in asked}
                outcome = self._outcome((label, k, seed), numbers, done.failures.get(i, ""))
                if outcome.excess <= 1.0:
                    swing = (numbers["highest"] - numbers["lowest"]) / 2 / abs(numbers["mean"])
                    outcome = self._lasting(outcome, put_all(varied, rows[i]).replace(start=begins[label][k]), swing)
                found.append(dataclasses.replace(outcome, more={name: numbers[f"further {name}"] for name in more}))
        order = {label: i for i, label in enumerate(cases)}
        found.sort(key=lambda outcome: (order[outcome.error], outcome.start, outcome.seed))
        plants = "the nominal plant" if list(cases) == ["nominal"] else f"the nominal plant and {len(cases) - 1} with errors"
        return WorstCase(all_described(loop.controllers), self.way, tuple(found), seconds, str(self.situation(plants)))

    @cached_property
    def _read(self) -> dict[str, Metric]:
        """{name: measure} of what a run is judged by."""
        of_speed = {"mean": mean, "lowest": minimum, "highest": maximum}
        of_drives = {"low": minimum, "high": maximum, "mean": mean}
        found = {"stuck": stuck_ratio(self.contact, self.window)} | {word: of(self.speed, self.window) for word, of in of_speed.items()}
        return found | {f"{word} {name}": of(name, self.window) for name in self.actuated_signals for word, of in of_drives.items()}

    def _outcome(self, run: tuple[str, int, int], numbers: Mapping[str, float], failure: str) -> Outcome:
        """What came of a run, and by how much it is beyond what is allowed; run: its error, start and seed."""
        if failure:
            return Outcome(*run, math.nan, math.nan, math.nan, math.nan, str(failure), math.inf)
        error, ripple = numbers["mean"] / self.target - 1.0, 0.0
        for name in self.actuated_signals:
            swing, middle = (numbers[f"high {name}"] - numbers[f"low {name}"]) / 2, abs(numbers[f"mean {name}"])
            ripple = max(ripple, swing / middle if middle > 0.0 else math.inf if swing > 0.0 else 0.0)
        off = 0.0 if math.isnan(error) else abs(error)
        excess = math.inf if numbers["stuck"] > 0.0 else max(off / self.allowed[0], ripple / self.allowed[1])
        return Outcome(*run, numbers["stuck"], error, ripple, math.nan, "", excess)

    def _lasting(self, outcome: Outcome, machine: ClosedLoop, swing: float) -> Outcome:
        """An outcome whose window is calm, with what it comes to; swing: of the speed in the window, in parts of its mean."""
        settled = self.settled(outcome.error, machine)
        if settled is None:
            return outcome
        rate = settled.rate
        comes_to = told_growth(rate) if rate > 0.0 else ""
        if not rate > 0.0 and not (rate < 0.0 and swing < CALM):
            own = Settled.of(machine, self.contact, self.speed, self.window, known=settled.runs.branch)
            with contextlib.suppress(SimulationError):
                judged = own and own.judged(simulate(machine, self.duration))
                comes_to = judged.regime if judged and judged.regime in (STICKS, STANDS) else ""
        return dataclasses.replace(outcome, rate=rate, failure=comes_to, excess=math.inf if comes_to else outcome.excess)


def cases_of(errors: Any, corners: Any) -> dict[str, dict[str, float]]:
    """{error in words: {name: factor}}, the nominal plant first. Raises SceneError for factors that are no numbers > 0."""
    found: dict[str, dict[str, float]] = {"nominal": {}}
    rows = [{name: factor} for name, given in mapping("uncertainty", errors).items() for factor in _factors(name, given)]
    rows += [{name: _factor(name, factor) for name, factor in mapping("corners", corner).items()} for corner in corners]
    for row in rows:
        found[", ".join(f"{name} {100.0 * (factor - 1.0):+.3g} %" for name, factor in row.items())] = row
    return found


def _factors(name: str, given: Any) -> list[float]:
    """Return the factors of a number: "20 %" is 20 % to either side, as on the command line, "+20 %" and "-20 %" are one side, and 0.8 is a factor."""
    found: list[float] = []
    for each in given if isinstance(given, (list, tuple, np.ndarray)) else [given]:
        if isinstance(each, str) and each.strip().endswith("%"):
            text = each.strip().replace("+-", "±", 1)
            share = number(name, text.lstrip("±"), above=-1)
            sides = (share,) if text[0] in "+-" else (-share, share)
            found += numbers(name, [1.0 + side for side in sides], above=0)
        else:
            found += numbers(name, np.ravel(each), above=0)
    return found


def _factor(name: str, given: Any) -> float:
    """Return the one factor of a number in a corner; raises SceneError for a share that may be to either side."""
    found = _factors(name, given)
    if len(found) != 1:
        raise SceneError(f"Argument `{name}` must be one factor in `corners`, such as 1.2 or `+20 %`, but it is {short(given)}.")
    return found[0]


def declared_value(loop: ClosedLoop, name: str) -> float:
    """The value of a number of the loop; raises SceneError for a start value, and for an input that varies in time."""
    number = loop.varied_number(name)
    if number.is_start:
        raise SceneError(f"Argument `uncertainty` must not hold `{name}`, because it is a start value: give `starts`.")
    if math.isnan(number.value):
        raise SceneError(f"Argument `uncertainty` must name numbers, but `{name}` varies in time: name a number of it.")
    return number.value


def as_run(law: Any, late: float, seed: int) -> Any:
    """A law with a factor of its delay and a seed of its noise."""
    if not isinstance(law, Sampled):
        if late != 1.0:
            raise SceneError(
                f"Argument `uncertainty` must not hold `{DELAY}` for a law that acts continuously: {suggest(DELAY, ('sample_time',))}"
            )
        return law
    return dataclasses.replace(law, delay=law.delay * late, seed=seed)


def _badness(outcome: Outcome) -> tuple[bool, float, float, float]:
    """By what outcomes are compared: runs that fail, then the time stuck, then the excess."""
    stuck = 0.0 if math.isnan(outcome.stuck) else outcome.stuck
    finite = outcome.excess if math.isfinite(outcome.excess) else 0.0
    return bool(outcome.failure), stuck, finite, outcome.ripple if math.isfinite(outcome.ripple) else 0.0


def percent(value: float) -> str:
    """A part in per cent as a report says it."""
    return shown(100.0 * value, ".2g", " %")
