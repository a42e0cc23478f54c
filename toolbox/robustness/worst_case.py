"""The worst case of a closed loop: the machine itself, with model errors, from phases of a stick-slip that exists, and with the noise of several seeds.

Margins speak about a line at one point. What an engineer has to promise is another thing: a law that is switched on while the bit sticks and slips ends
that, on a machine that is not the declared one, whatever the phase and whatever the noise. Every error is tried alone, then the corners, each from every
start with every seed; the runs that differ by numbers alone step side by side (`sweep`).
"""

from __future__ import annotations

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
from toolbox.files.units import NumberOrText
from toolbox.measuring.judge import CALM
from toolbox.measuring.metrics import Metric, maximum, mean, minimum, stuck_ratio
from toolbox.measuring.sticks import is_stick
from toolbox.measuring.verdict import (
    FREE,
    NO_STICK,
    RUN_FAILED,
    STICK_SLIP,
    STICKS_IN_WINDOW,
    STUCK,
    Verdict,
    growing,
    of_quarters,
    quarters,
)
from toolbox.messages import sign_of_life
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.closing import all_described
from toolbox.modelling.laws import Sampled
from toolbox.modelling.numbers import put_all
from toolbox.onsets.coming_to import LONGEST, Settled, last_change, of_run
from toolbox.onsets.takeover import reference_of
from toolbox.robustness.outcomes import Outcome, WorstCase
from toolbox.robustness.starts import Found, GivenStarts, SmoothRunning, Start, Starts, start_of
from toolbox.scenes.judged import judged_contact, judged_measures, judged_speed
from toolbox.scenes.situation import Situation
from toolbox.simulation.request import accuracy_of
from toolbox.simulation.simulate import simulate
from toolbox.sweeps.sweep import sweep

DELAY = "delay"
"""The name by which the delay of sampled laws is varied."""

SETTLED = 7.0
"""Time constants of smooth running after which its error and ripple are told, of a run that comes to it late: a disturbance is a thousandth by then."""


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
    """Test a closed loop with errors of its model: simulate every error, from every start and with every seed of the
    noise.

    A run succeeds if, from `after` on,

    - the judged contact never sticks: the contact that `closed_loop(..., element=...)` names, by default the only
      contact of the plant with dry friction,
    - the mean of the judged speed is within `mean_within` of its target: the signal that `closed_loop(..., signal=...)`
      names, by default the speed of the contact, such as `bit.speed`,
    - no command of a controller deviates by more than `ripple_within` of its mean, and
    - smooth running is stable on the machine of this run: a small disturbance must not grow, however slowly. A run that
      still oscillates at its end is continued until its regime can be decided.

    If an input varies in time, the stability of smooth running is checked with the last value of this input. If an
    input never becomes constant, the stability is not checked: the run from `after` on decides alone.

    Parameters
    ----------
    loop
        A loop. Controllers are designed on the nominal plant, and errors of parameters do not change their design. The
        target of the mean speed is the `reference` of the loop.
    duration
        Length of a run [s].
    uncertainty
        {name: factor, or several factors}, by default none. A name is a parameter of the plant, an input or a number of
        a controller, such as "bit.weight". The factor multiplies its value. Each factor is tried alone. "20 %" means
        0.8 and 1.2, "+20 %" means 1.2 alone. "delay" is the delay of the sampled controllers.
    corners
        Combinations of errors, each a mapping {name: factor} whose errors act all at once, by default none. Names are
        the same as in `uncertainty`. A percentage needs its sign here: "+20 %".
    starts
        Starts of the runs:

        - `SmoothRunning()` (default), which needs constant inputs.
        - `FromRest(ramp)`: from rest, set-point in one step or by a ramp.
        - `TakenOver(initial_controller)`: from the stick-slip of another controller on each machine.
        - `OwnStickSlip()`: from the stick-slip of the loop itself.
        - `AfterConnection()` of `toolbox.drilling`: the weight is taken off and put on again.
        - A list of mappings {name: start value}, in SI, such as `cycle_phases` returns. Each mapping is the start of one
          run. A name is a state of the plant or of a controller, or the command of a sampled controller, such as
          `top.torque`. The start value of a command is the value that the controller holds before its first sample.
    seeds
        Seeds of the measurement noise, by default 0 alone. They have an effect only if a `Sampled` controller has
        noise.
    after
        Time from which on a run is judged [s]. By default the last 30 % of the run.
    mean_within, ripple_within
        Allowed error of the mean speed as a fraction of its target [1], by default 0.02, and allowed deviation of a
        command from its mean, as a fraction of the mean [1], by default 0.05.
    metrics
        Further metrics of every run from `after` on, by default none: names such as "severity" (keys of
        `toolbox.measuring.metrics.METRICS`), functions of the run, or {name: metric}.

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

    window: time from which on a run is judged [s];  start: where runs start, found on each machine;  target: of the mean speed;  allowed: (error of the mean,
    ripple);  measures: more;  known: the judges of machines by the words of their errors;  begun: their starts. Both times count from the last change of an
    input that belongs to the start.
    """

    loop: ClosedLoop
    duration: float
    window: float
    start: Start
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
        aim = reference_of(loop, judged_speed(loop, judged_contact(loop)))
        wanted = math.nan if aim is None else aim
        return cls(loop, duration, window, start, seeds if noisy else (0,), wanted, allowed, metrics)

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
        """Sentence on the starts of the runs, the judged contact, and the judged time."""
        return f"runs of {self.duration:g} s from {self.start.words}; `{self.contact}` judged from {self.window:g} s on{self._notes}"

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
        """Return the judge of the machine with an error. The judge is made once for all starts and seeds; None if the machine cannot be
        judged."""
        if error not in self.known:
            self.known[error] = Settled.of(machine, self.contact, self.speed, self.window)
        return self.known[error]

    def situation(self, plants: str) -> Situation:
        """The situation of the verdicts on some plants."""
        lasts = f"{self.duration:g} s, `{self.contact}` judged from {self.window:g} s on{self._notes}"
        return Situation.of(self.loop, self.start.words, lasts, plants=plants)

    def starts(self, error: str, factors: Mapping[str, float]) -> Found:
        """Where the runs of an error begin: smooth running and given values are those of the nominal plant, all else is of the machine itself."""
        shared = isinstance(self.start, (SmoothRunning, GivenStarts))
        key = "nominal" if shared else error
        if key not in self.begun:
            self.begun[key] = self.start.on(self.loop if shared else self.machine(factors))
        return self.begun[key]

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
        for late, seed, k in itertools.product(delays, self.seeds, range(max(len(each.values) for each in begins.values()))):
            own = {label: case for label, case in cases.items() if case.get(DELAY, 1.0) == late and k < len(begins[label].values)}
            alone = [label for label in own if begins[label].inputs]  # whose inputs differ as well: one after the other
            for label in alone:
                machine = begins[label].loops(self.machine(own.pop(label), seed))[k]
                found.append(self._alone((label, k, seed), machine, more))
            if not own:
                continue
            rows = [{name: value * case.get(name, 1.0) for name, value in declared.items()} for case in own.values()]
            by_row = {tuple(row.values()): begins[label].values[k] for row, label in zip(rows, own, strict=True)}
            varied = self.machine({DELAY: late}, seed).replace(start={})
            done = sweep(varied, rows, self.duration, start=lambda row, known=by_row: known[tuple(row.values())], metrics=asked)  # type: ignore[misc]
            seconds += done.seconds
            for i, label in enumerate(own):
                numbers = {name: float(done[name][i]) for name in asked}
                machine = put_all(varied, rows[i]).replace(start=begins[label].values[k])
                outcome = self._outcome((label, k, seed), numbers, done.failures.get(i, ""), machine)
                found.append(dataclasses.replace(outcome, more={name: numbers[f"further {name}"] for name in more}))
        order = {label: i for i, label in enumerate(cases)}
        found.sort(key=lambda outcome: (order[outcome.error], outcome.start, outcome.seed))
        plants = "the nominal plant" if list(cases) == ["nominal"] else f"the nominal plant and {len(cases) - 1} with errors"
        return WorstCase(all_described(loop.controllers), self.way, tuple(found), seconds, str(self.situation(plants)))

    def _alone(self, run: tuple[str, int, int], machine: ClosedLoop, more: Mapping[str, Metric]) -> Outcome:
        """The outcome of a run whose inputs change on the way, judged when they are constant; run: its error, start and seed."""
        begun = last_change(machine)
        own = dataclasses.replace(self, duration=begun + self.duration, window=begun + self.window)
        further = {name: dataclasses.replace(each, after=own.window) for name, each in more.items()}
        try:
            done = simulate(machine, own.duration)
        except SimulationError as error:
            return own._outcome(run, {}, str(error), machine)
        outcome = own._outcome(run, {name: each.read(done) for name, each in own._read.items()}, "", machine)
        return dataclasses.replace(outcome, more={name: each.read(done) for name, each in further.items()})

    @cached_property
    def _read(self) -> dict[str, Metric]:
        """{name: measure} of what a run is judged by."""
        of_speed = {"mean": mean, "lowest": minimum, "highest": maximum}
        of_drives = {"low": minimum, "high": maximum, "mean": mean}
        found = {"stuck": stuck_ratio(self.contact, self.window)} | {word: of(self.speed, self.window) for word, of in of_speed.items()}
        found |= {f"{word} {name}": of(name, self.window) for name in self.actuated_signals for word, of in of_drives.items()}
        if 2.0 * self.window > self.duration:  # the window is the third and the last quarter of a time within the run
            found |= quarters(self.contact, self.speed, 2.0 * self.window - self.duration, self.duration)
        return found

    def _outcome(self, run: tuple[str, int, int], numbers: Mapping[str, float], failure: str, machine: ClosedLoop) -> Outcome:
        """What came of a run, and by how much it is beyond what is allowed; run: its error, start and seed;  machine: its loop, with its start.

        Clear stick-slip is told by the window, smooth running by a window that is calm where small disturbances die. All else is carried on by the judge.
        """
        if failure:
            return Outcome(*run, math.nan, math.nan, math.nan, math.nan, str(failure), math.inf, RUN_FAILED)
        found = Outcome(*run, numbers["stuck"], *self._sizes(numbers), math.nan, "", 0.0, FREE)
        if "sticks_0" in numbers:
            seen = {name: np.array([value]) for name, value in numbers.items()}
            _, slips, stands = of_quarters(seen, (self.duration - self.window) / 2, accuracy_of(self.loop))
            if slips[0] or stands[0]:
                return self._judged_as(found, STICK_SLIP if slips[0] else STUCK)
        settled = self.settled(found.error, machine)
        if settled is None:
            return self._judged_as(found, STICKS_IN_WINDOW if is_stick(found.stuck) else NO_STICK)
        found = dataclasses.replace(found, rate=settled.rate)
        swing = (numbers["highest"] - numbers["lowest"]) / 2 / abs(numbers["mean"]) if numbers["mean"] else math.inf
        calm = not is_stick(found.stuck) and swing < CALM
        if settled.rate > 0.0 and not is_stick(found.stuck):
            return self._judged_as(found, growing(settled.rate, "smooth running is not stable"))
        if calm and settled.rate < 0.0:
            return self._judged_as(found, FREE)
        return self._carried_on(found, machine, settled)

    def _carried_on(self, found: Outcome, machine: ClosedLoop, settled: Settled) -> Outcome:
        """An outcome that the window does not tell, by the judge; of a run that comes to smooth running, error and ripple are those that it has there."""
        own = Settled.of(machine, self.contact, self.speed, self.window, known=settled.runs.branch)
        try:
            run = simulate(machine, self.duration)
            verdict, judged = of_run(run, self.contact, self.window, None if own is None else own.judged(run))
            if judged is None and is_stick(found.stuck) and not verdict.failed:
                verdict = STICKS_IN_WINDOW
            if not verdict.failed and judged is not None and self._excess(found) > 1.0:
                longest = LONGEST * settled.runs.period
                still = min(SETTLED / abs(settled.rate), longest) if settled.rate < 0.0 else longest
                last = simulate(machine, still + self.duration - self.window, start=run.last)
                asked = {name: dataclasses.replace(each, after=last.begin + still) for name, each in self._sized.items()}
                error, ripple = self._sizes({name: each.read(last) for name, each in asked.items()})
                found = dataclasses.replace(found, mean_error=error, ripple=ripple)
        except SimulationError as error_of_run:
            return dataclasses.replace(found, failure=str(error_of_run), excess=math.inf, verdict=RUN_FAILED)
        return self._judged_as(found, verdict)

    @property
    def _sized(self) -> dict[str, Metric]:
        """The measures of error and ripple."""
        return {name: each for name, each in self._read.items() if name == "mean" or name.partition(" ")[2] in self.actuated_signals}

    def _sizes(self, numbers: Mapping[str, float]) -> tuple[float, float]:
        """(error of the mean speed, ripple) as fractions of their means."""
        error, ripple = numbers["mean"] / self.target - 1.0, 0.0
        for name in self.actuated_signals:
            swing, middle = (numbers[f"high {name}"] - numbers[f"low {name}"]) / 2, abs(numbers[f"mean {name}"])
            ripple = max(ripple, swing / middle if middle > 0.0 else math.inf if swing > 0.0 else 0.0)
        return error, ripple

    def _excess(self, found: Outcome) -> float:
        """The larger of error and ripple by what is allowed."""
        off = 0.0 if math.isnan(found.mean_error) else abs(found.mean_error)
        return max(off / self.allowed[0], found.ripple / self.allowed[1])

    def _judged_as(self, found: Outcome, verdict: Verdict) -> Outcome:
        """An outcome with its verdict."""
        lost = verdict.failed
        return dataclasses.replace(
            found, verdict=verdict, failure=verdict.word if lost else "", excess=math.inf if lost else self._excess(found)
        )


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
