"""The chance of stick-slip where numbers of the machine are known as distributions only.

Each draw is a machine, which is run from where its loop begins. Most runs are decided in lanes, by what the judge of all verdicts looks at: the same sticks
in the third and in the last quarter of the run, or no stick and a swing that falls. What lies between, near a border, is run longer, and what is not clear
then is carried on by that judge itself.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from toolbox.arguments import FloatArray, number, short, whole
from toolbox.errors import SceneError, SimulationError
from toolbox.files.journal import Journal, fingerprint
from toolbox.files.unit_systems import asked_units
from toolbox.files.units import NumberOrText
from toolbox.measuring.judge import Judged
from toolbox.measuring.verdict import of_judged, of_quarters, quarters
from toolbox.messages import progress_bar
from toolbox.modelling.closed_loop import ClosedLoop, as_loop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.numbers import put_all
from toolbox.onsets.coming_to import LONGEST, Settled, comes_to
from toolbox.onsets.map_loop import NONE, SMOOTH, STICK_SLIP, STUCK, VERDICTS
from toolbox.probability.distributions import Draws, drawn, known_as
from toolbox.probability.results import Chance
from toolbox.robustness.starts import OwnStickSlip, Start, TakenOver
from toolbox.scenes.judged import judged_contact, judged_speed
from toolbox.scenes.situation import Situation, start_in_words
from toolbox.simulation.simulate import simulate
from toolbox.steady_states.steady_loop import smooth_start
from toolbox.sweeps.designs import Variations, grid
from toolbox.sweeps.executors import Manner, evaluated, probed
from toolbox.sweeps.store import journal_in
from toolbox.sweeps.sweep import task_of
from toolbox.sweeps.variants import start_memories, start_states
from toolbox.vocabulary import new_names_only

BLOCK = 16_384
"""Runs of a block, about: what an interruption may lose."""

SWINGS = 40
"""Swings of the machine that a run lasts where nobody says, after its inputs have come to rest."""

QUARTER = 3
"""Swings that a quarter of a run must hold at least, so that its sticks can be counted."""

LONGER = (3.0, 10.0)
"""Runs that are not clear are run so many times as long before the judge is asked."""


@new_names_only
def chance(
    loop: ClosedLoop | HybridSystem | Mapping[str, ClosedLoop],
    ranges: Mapping[str, Any],
    uncertainty: Mapping[str, Any] | Draws,
    *,
    draws: int = 200,
    duration: NumberOrText | None = None,
    starts: Start | Callable[[Mapping[str, float]], Mapping[str, Any]] | None = None,
    accuracy: float = 1e-4,
    confidence: float = 0.95,
    seed: int = 0,
    checkpoint: str | Path | None = None,
) -> Chance:
    """Estimate the probability of stick-slip over one or two numbers, for each controller, if other numbers are uncertain and known as distributions.

    All points and all controllers see the same draws, so that controllers can be compared draw by draw. A run begins
    at the start of its loop, for example from rest with a bit that sticks. Standstill counts as stick-slip.

    Parameters
    ----------
    loop
        A loop, a plant, or {label: loop}.
    ranges
        {name: values} of one or two numbers, in SI or text with units. The method `lowest` of the result takes the
        first number as the set-point.
    uncertainty
        {name: distribution} of independent numbers, each `Normal`, `Uniform`, `LogNormal`, or text such as "97 kN +-
        8 kN" with the standard deviation of a normal distribution. Or `Draws` of numbers that are known together.
    draws
        Number of draws, the same at every point, by default 200. 72 draws are the least with which 95 % can be shown by
        two-sided bounds of 95 %.
    duration
        Length of a run [s], or text with a unit. By default forty periods of the oscillation of the machine in the
        middle of the ranges, counted from the time at which its inputs are constant.
    starts
        Start of the runs, as in `worst_case`: `FromRest()`, `SmoothRunning()`, `OwnStickSlip()` or
        `TakenOver(initial_controller)`, found on each drawn plant. With several phases, each draw has one of them, and a
        plant without such a stick-slip begins at smooth running. Or a function {name: value} -> {state: start value}.
        By default the start of the loop, which is rest if it gives no values.
    accuracy
        Target for the global error of the runs, between 1e-13 and 0.1, by default 0.0001. The page "Probability" of the
        documentation shows how the accuracy changes cost and result.
    confidence
        Confidence level of the bounds of Clopper and Pearson, by default 0.95.
    seed
        Seed of the random numbers, by default 0.
    checkpoint
        Folder that keeps the results block by block. The same call after an interruption continues from this folder. By
        default None: nothing is stored.

    Returns
    -------
    Chance
        Probabilities with bounds, expected severities and lowest set-points. `print`, `plot` and `save` them.

    Raises
    ------
    SceneError
        If a name is unknown, is both varied and uncertain, or is out of bounds; if a run is too short to count
        sticks; if `checkpoint` holds another search.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.probability import chance
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock()), SoftTorque())
    >>> found = chance(loop, {"top.reference": ["60 rpm", "90 rpm"]}, {"bit.weight": "60 kN +- 10 kN"}, draws=100)
    >>> print({label: chances.round(2).tolist() for label, chances in found.chances.items()})
    {'as it is': [0.0, 0.0]}
    """
    loops = labelled(loop)
    if not isinstance(ranges, Mapping) or not 1 <= len(ranges) <= 2:
        raise SceneError(f"Argument `ranges` must map one or two names to values, but it is {short(ranges)}.")
    whole("draws", draws, 1)
    confidence = number("confidence", confidence, above=0, below=1)
    accuracy = number("accuracy", accuracy, above=0)
    first = next(iter(loops.values()))
    typed = {first.number(name).name: first.number(name).in_si(name, list(values)) for name, values in ranges.items()}
    points = grid(typed)
    known = drawn(first, uncertainty, draws, seed)
    twice = next((name for name in points.names if name in known.names), None)
    if twice is not None:
        raise SceneError(f"Argument `uncertainty` must not name what is varied, but `{twice}` is in `ranges`, too.")
    searches = {
        label: Search(begun(each, starts), points, known, duration, start_of_draws(each, starts, known), accuracy)
        for label, each in loops.items()
    }
    longest = max(each.duration for each in searches.values())
    total = len(searches) * len(points.points) * draws
    outcomes, severities, judged = {}, {}, {}
    with progress_bar(total, "chance") as bar:
        for k, (label, search) in enumerate(searches.items()):
            search.duration = longest  # the same for all laws
            search.begun = fingerprint(starts) if isinstance(starts, Start) else ""
            journal = None if checkpoint is None else search.journal(Path(checkpoint), k)
            found = search.found(bar, journal)
            outcomes[label], severities[label] = (each.reshape(*points.shape, draws) for each in found)
            judged[label] = search.judged
    names = [first.number(name) for name in points.names]
    lasts = f"{longest:.4g} s, carried on until the regime is decided"
    situation = Situation.of(
        first, begun_in_words(first, starts), lasts, plants=f"{draws} plants with drawn numbers at each point", cases=loops
    )
    return Chance(
        title=first.title, labels=tuple(loops), names=points.names, units=tuple(each.unit for each in names), axes=points.axes,
        uncertainty=known_as(uncertainty, known.names, draws),
        outcomes=outcomes, severities=severities, duration=longest, accuracy=accuracy, confidence=confidence, judged_runs=judged,
        display_units=asked_units(typed), situation=str(situation),
    )  # fmt: skip


def labelled(loop: Any) -> dict[str, ClosedLoop]:
    """{label: loop} of a loop, a plant or such a mapping; raises SceneError for anything else."""
    loops = dict(loop) if isinstance(loop, Mapping) else {"as it is": as_loop(loop)}
    if not loops or not all(isinstance(each, ClosedLoop) for each in loops.values()):
        raise SceneError(f"Argument `loop` must be a loop, a plant or a mapping of labels to loops, but it is {short(loop)}.")
    return loops


def begun(loop: ClosedLoop, starts: Any) -> ClosedLoop:
    """The loop without start values of its own, where a start gives all of them."""
    return loop.replace(start={}) if isinstance(starts, Start) else loop


def begun_in_words(loop: ClosedLoop, starts: Any) -> str:
    """The start of runs of drawn plants, in words."""
    if not isinstance(starts, Start):
        return start_in_words(loop) if starts is None else "a start of its own for each draw"
    return starts.words + (", smooth running of a plant that has none" if isinstance(starts, (OwnStickSlip, TakenOver)) else "")


def start_of_draws(loop: ClosedLoop, starts: Any, known: Variations) -> Callable[[Mapping[str, float]], Mapping[str, Any]] | None:
    """The function {name: value} -> start values of a start; what is no start is returned as it is."""
    if not isinstance(starts, Start):
        return cast("Callable[[Mapping[str, float]], Mapping[str, Any]] | None", starts)
    draw_of = {tuple(row): k for k, row in enumerate(known.points.tolist())}

    @functools.cache
    def begin(numbers: tuple[tuple[str, float], ...]) -> Mapping[str, Any]:
        values = dict(numbers)
        plant = put_all(loop, values)
        found = starts.on(plant)
        if any(found.inputs):
            raise SceneError(f"Argument `starts` must be a start with constant inputs, but it is {starts.words}.")
        if found.note or not found.values:
            return smooth_start(plant)
        return found.values[draw_of[tuple(values[name] for name in known.names)] % len(found.values)]

    return lambda numbers: begin(tuple(numbers.items()))


class Search:
    """The runs of one loop at all points with all draws."""

    def __init__(self, loop: ClosedLoop, points: Variations, known: Variations, duration: Any, start: Any, accuracy: float):
        self.loop, self.start, self.accuracy, self.judged = loop, start, accuracy, 0
        self.begun = ""  # the start that was asked for, as a search that was stopped knows it
        self.manner: Manner | None = None  # of the first runs, for all
        self.names = (*points.names, *known.names)
        self.points, self.known = points.points, known.points
        self.element = judged_contact(loop)
        self.signal = judged_speed(loop, self.element)
        middle = put_all(loop, dict(zip(points.names, self.points[len(self.points) // 2].tolist(), strict=True)))
        settled = Settled.of(middle, self.element, self.signal, 0.0, accuracy)
        own = start is None and all(loop.number(name).is_start for name in self.names)
        self.swing = math.nan if settled is None else settled.runs.period
        if duration is None:
            if settled is None:
                raise SceneError(
                    "Argument `duration` must be given, because the machine has no steady running that tells its scale of time."
                )
            duration = settled.begin + SWINGS * self.swing
        self.duration = number("duration", duration, "s", above=0)
        self.begin = 0.0 if settled is None else settled.begin
        self.alike = settled if own and settled is not None and settled.begin == 0.0 else None
        quarter = (self.duration - self.begin) / 4
        if not math.isnan(self.swing) and quarter < QUARTER * self.swing:
            raise SceneError(
                f"Argument `duration` must be at least {self.begin + 4 * QUARTER * self.swing:.4g} s, so that sticks can be counted, "
                f"but it is {self.duration:.4g} s."
            )

    def journal(self, folder: Path, k: int) -> Journal:
        """What is known of this loop in a folder; k: place of the loop among all."""
        design = Variations(self.names, self._rows(0, 1), (len(self.known),))
        more: dict[str, Any] = {"points": [self.points.tolist()], "uncertainty": [self.names, self.known.tolist()]}
        more |= {"starts": [self.begun]} if self.begun else {}
        return journal_in(folder, f"chance_{k + 1:02d}.jsonl", self.loop, design, self.duration, self.accuracy, **more)

    def _rows(self, begin: int, end: int) -> FloatArray:
        """All draws at the points from one to another."""
        at = self.points[begin:end]
        return np.hstack([np.repeat(at, len(self.known), axis=0), np.tile(self.known, (len(at), 1))])

    def found(self, bar: Any, journal: Journal | None = None) -> tuple[np.ndarray, np.ndarray]:
        """(outcomes, severities) of all runs, block by block."""
        size = max(1, BLOCK // len(self.known))
        outcomes, severities = [], []
        for begin in range(0, len(self.points), size):
            rows = self._rows(begin, begin + size)
            kept = None if journal is None else journal.known.get((begin,))
            if kept is None:
                found, severity, judged = self.block(rows)
                kept = [found.tolist(), [each if math.isfinite(each) else None for each in severity.tolist()], judged]
                if journal is not None:
                    journal.add((begin,), kept)
            outcomes.append(np.array(kept[0], np.int8))
            severities.append(np.array(kept[1], float))  # None is nan
            self.judged += kept[2]
            bar.update(len(rows))
        return np.concatenate(outcomes), np.concatenate(severities)

    def block(self, rows: FloatArray) -> tuple[np.ndarray, np.ndarray, int]:
        """(outcomes, severities, number of runs that the judge carried on) of some runs."""
        outcomes, told, failed = self._decided(rows, self.duration)
        still = np.flatnonzero((outcomes == NONE) & ~failed)
        for times in LONGER if still.size else ():
            outcomes[still], told[still], _ = self._decided(rows[still], self.begin + times * (self.duration - self.begin))
            still = still[outcomes[still] == NONE]
            if not still.size:
                break
        for i in still.tolist():
            outcomes[i], told[i] = self.judge(rows[i])
        return outcomes, told, still.size

    def _decided(self, rows: FloatArray, duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(outcomes, those that are not clear not known; severities; which runs failed) of runs of a duration."""
        asked = quarters(self.element, self.signal, self.begin, duration)
        quarter = (duration - self.begin) / 4
        design = Variations(self.names, rows, (len(rows),))
        task, broken, _ = task_of(self.loop, design, duration, start=self.start, metrics=asked, accuracy=self.accuracy)
        self.manner = self.manner or probed(task)
        found = dict(zip(asked, evaluated(task, broken, manner=self.manner)[0].T, strict=True))
        outcomes = np.full(len(rows), NONE, np.int8)
        falls, sticks, stands = of_quarters(found, quarter, self.accuracy)
        outcomes[falls], outcomes[sticks], outcomes[stands] = SMOOTH, STICK_SLIP, STUCK
        return outcomes, np.where(stands, math.inf, found["severity_1"]), np.isnan(found["sticks_0"])

    def judge(self, row: FloatArray) -> tuple[int, float]:
        """(outcome, severity) of one run by the judge, carried on until it is decided."""
        try:
            judged = self._from_run(row) if self.alike is None else self._from_start(self.alike, row)
        except SimulationError:
            return NONE, math.nan
        return (NONE, math.nan) if judged is None else (VERDICTS.get(of_judged(judged, 1).regime, NONE), judged.severity)

    def _from_start(self, alike: Settled, row: FloatArray) -> Judged | None:
        """What the one machine comes to from another start."""
        base, one = alike.runs.base, Variations(self.names, row[None], (1,))
        begin = {"states": start_states(base, one, None), "memory": start_memories(base, one)}
        given: dict[str, Any] = {name: each[0] for name, each in begin.items() if each is not None}
        return alike.of_start(dataclasses.replace(base.start, **given), LONGEST + self.duration / self.swing)

    def _from_run(self, row: FloatArray) -> Judged | None:
        """What a machine with its own numbers comes to."""
        numbers = dict(zip(self.names, row.tolist(), strict=True))
        loop = put_all(self.loop, numbers)
        if self.start is not None:
            loop = loop.replace(start={**loop.start, **self.start(numbers)})
        run = simulate(loop, self.duration, accuracy=self.accuracy)
        return comes_to(run, self.element, self.signal, self.begin + (self.duration - self.begin) / 2)
