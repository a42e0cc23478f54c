"""What a tuning found: the points it tried, the front among them, the law that came out, and the report that says so."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.errors import SceneError
from toolbox.files.printing import Rows, Told
from toolbox.files.results import LEFT_OUT, HeadedRows, Result
from toolbox.files.tables import heading
from toolbox.files.unit_systems import reading
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.laws import Controller, Sampled
from toolbox.modelling.numbers import law_with_numbers
from toolbox.scenes.scene import Scene


@dataclass(frozen=True)
class Free:
    """A free number: its name among the numbers of the loop, unit, range, whether its logarithm is searched, and its given value (None: left to `design`)."""

    name: str
    unit: str
    low: float
    high: float
    given: float | None

    @property
    def logarithmic(self) -> bool:
        """Whether the range is positive and spans a decade or more."""
        return self.low > 0 and self.high >= 10 * self.low

    def number(self, place: float) -> float:
        """Return the number at a place between 0 and 1 of the range, rounded to six digits. The printed number is therefore the simulated
        number."""
        place = min(max(place, 0.0), 1.0)
        value = self.low * (self.high / self.low) ** place if self.logarithmic else self.low + (self.high - self.low) * place
        return min(max(float(f"{value:.6g}"), self.low), self.high)

    def place(self, number: float) -> float:
        """The place of a number in the range, 0 to 1 inside."""
        if self.logarithmic:
            return math.log(number / self.low) / math.log(self.high / self.low) if number > 0 else -math.inf
        return (number - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class Trial:
    """One point of the search.

    Attributes
    ----------
    numbers
        The numbers, in the order of the free fields.
    values
        values[scene][objective]; inf where there is none.
    failures
        Why runs failed, "" for those that did not.
    """

    numbers: tuple[float | None, ...]
    values: tuple[tuple[float, ...], ...]
    failures: tuple[str, ...]

    @property
    def failed(self) -> bool:
        """Whether a run of any scene could not be finished."""
        return any(self.failures)


@dataclass(frozen=True)
class Tuned(Told, Result):
    """Result of `tune`: all points that were tried, and the best controller. `print` shows the report.

    Attributes
    ----------
    title
        Title of the tuning.
    free
        The numbers of the controller that were tuned, with their ranges.
    objectives, units
        Objectives that were minimised, and their units.
    scenes
        Labels of the scenes.
    aggregate
        Function that combines the values of several scenes.
    trials
        Every point that was tried, a `Trial` each. The first is the controller as given.
    seed
        Seed of the search.
    loop
        The loop of the first scene, with the controller as given. None after loading: `dataclasses.replace(found,
        loop=loop)` then gives access to its controllers.
    simulated_runs
        Number of runs that this call simulated. The outcomes of all other runs came from the checkpoint.
    display_units
        {SI unit: unit that was typed}: the units of report and figure.
    situation
        The situation for which the objectives hold, in one line.

    Examples
    --------
    >>> from controllers import PI
    >>> from models import BitRock, wells
    >>> from toolbox import compose, tune
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="60 kN"))
    >>> drive = PI(proportional=400.0, integral=100.0, reference="120 rpm")
    >>> found = tune(rig, drive, "severity", {"pi.proportional": (100.0, 2000.0)}, duration="30 s", runs=10)
    >>> print(f"severity {found.before.values[0][0]:.2f} before, {found.best.values[0][0]:.2f} after {len(found.trials)} trials")
    severity 0.20 before, 0.11 after 9 trials
    """

    title: str
    free: tuple[Free, ...]
    objectives: tuple[str, ...]
    units: tuple[str, ...]
    scenes: tuple[str, ...]
    aggregate: Callable[[Sequence[float]], float]
    trials: tuple[Trial, ...]
    seed: int
    simulated_runs: int
    loop: ClosedLoop = field(repr=False, metadata=LEFT_OUT)
    display_units: Mapping[str, str] = field(default_factory=dict)
    situation: str = ""

    @property
    def before(self) -> Trial:
        """Trial of the controller as it was given to `tune`."""
        return self.trials[0]

    def counted(self, trial: Trial) -> tuple[float, ...]:
        """Return the objectives of a trial, each combined over the scenes by `aggregate`, in the order of `objectives`.

        Parameters
        ----------
        trial
            The trial, an entry of `trials`.
        """
        return counted_over(trial, self.aggregate)

    @property
    def front(self) -> tuple[Trial, ...]:
        """Pareto front: the trials that no other trial dominates, sorted by the first objective. Empty if no trial could be simulated."""
        points = [(self.counted(trial), trial) for trial in self.trials]
        kept = [points[i] for i in front_of(np.array([values for values, _ in points]))]
        return tuple(trial for _, trial in sorted(kept, key=lambda pair: pair[0]))

    @property
    def best(self) -> Trial:
        """Trial with the smallest objective.

        For a Pareto front it is the trial nearest to the ideal corner, with each axis scaled from the best to the worst
        value. If some trials are at least as good as the given controller in every objective, only these trials are
        considered. Raises SceneError if no trial succeeded.
        """
        front = self.front
        if not front:
            reasons = [words for trial in self.trials for words in trial.failures if words]
            why = f": {reasons[0]}" if reasons else ", and every objective is infinite or not a number"
            raise SceneError(f"The tuning found nothing: all {len(self.trials)} trials failed{why}")
        values = np.array([self.counted(trial) for trial in front])
        low, size = values.min(axis=0), np.ptp(values, axis=0)
        distance = np.linalg.norm((values - low) / np.where(size > 0, size, 1.0), axis=1)
        better = (values <= self.counted(self.before)).all(axis=1) & np.array([trial is not self.before for trial in front])
        return front[int(np.argmin(np.where(better, distance, np.inf) if better.any() else distance))]

    @property
    def law(self) -> Controller | Sampled:
        """The best controller, for `simulate(..., controller=found.law)`. A sampled controller has its sample time, delay and sensors."""
        return self.law_of(self.best)

    def law_of(self, trial: Trial) -> Controller | Sampled:
        """Return the controller of a trial, such as a trial of the Pareto front. Raises SceneError after loading, because a file holds no loop.

        Parameters
        ----------
        trial
            The trial, an entry of `trials`.
        """
        return law_with_numbers(with_numbers(self._machine, self.free, trial.numbers))

    @property
    def controller(self) -> Controller | Sampled:
        """Controller as it was given to `tune`."""
        return self._machine.controllers[0]

    @property
    def _machine(self) -> ClosedLoop:
        """The loop; raises SceneError where there is none."""
        if self.loop is None:
            raise SceneError(
                "This result was read from a file, which does not hold its loop: `dataclasses.replace(found, loop=loop)` has its laws."
            )
        return self.loop

    def applied(self, scene: Scene, label: str) -> Scene:
        """Return a scene with an additional case "<label>, tuned": a copy of the case `label` with the best numbers.

        Parameters
        ----------
        scene
            The scene.
        label
            Label of the case whose controller gets the best numbers.
        """
        cases = []
        for case in scene.cases:
            cases.append(case)
            if case.label == scene.case(label).label:
                law: Any = law_with_numbers(with_numbers(scene[label], self.free, self.best.numbers))
                law = law.law if isinstance(law, Sampled) else law
                cases.append(dataclasses.replace(case, label=f"{case.label}, tuned", law=law))
        return dataclasses.replace(scene, cases=tuple(cases))

    def _told(self) -> list[str | Rows]:
        tried = len(self.trials)
        failed = sum(trial.failed for trial in self.trials)
        over = f", {_over_words(self.aggregate)} of {len(self.scenes)} scenes counts" if len(self.scenes) > 1 else ""
        counts = f"{_count(len(self.free), 'free number')}, {_count(len(self.objectives), 'objective')}"
        told: list[str | Rows] = [
            f"Tuning of {self.title}: {counts}{over}; {tried} points, {tried * len(self.scenes)} runs, seed {self.seed}",
            *([self.situation] if self.situation else []),
            *([f"{failed} of the points have a run that could not be finished: infinitely bad."] if failed else []),
        ]
        if not self.front:
            return [*told, NOTHING]
        best = self.best
        numbers, values = self._changed_rows(best)
        told += ["", Rows([["", "given", "tuned", "range"], *numbers, [], *values], indent="")]
        told += [line for remark in self._remarks(best) for line in ("", remark)]
        if len(self.objectives) > 1:
            told += ["", f"Front of {_count(len(self.front), 'point')} ({_TUNED} the one above):", Rows(self._front_rows(best), indent="")]
        return told

    __repr__ = Told.__str__

    def _changed_rows(self, best: Trial) -> tuple[list[list[str]], list[list[str]]]:
        """(name, given, tuned, range) of the free numbers, and (name, given, tuned, change) of the objectives."""
        numbers = []
        for free, number in zip(self.free, best.numbers, strict=True):
            factor, unit = reading(free.unit, self.display_units)
            words = f"{free.low * factor:.6g} .. {free.high * factor:.6g}{', log' if free.logarithmic else ''}"
            numbers.append([heading(free.name, unit), plain_number(free.given, factor), plain_number(number, factor), words])
        values = []
        for j, (name, unit) in enumerate(zip(self.objectives, self.units, strict=True)):
            factor, unit = reading(unit, self.display_units)
            old, new = factor * self.counted(self.before)[j], factor * self.counted(best)[j]
            values.append([heading(name, unit), _short(old), _short(new), _gain(old, new)])
            if len(self.scenes) > 1:
                values += [
                    [f"  {label}", _short(factor * before[j]), _short(factor * after[j]), _gain(before[j], after[j])]
                    for label, before, after in zip(self.scenes, self.before.values, best.values, strict=True)
                ]
        return numbers, values

    def _remarks(self, best: Trial) -> list[str]:
        remarks = ["Nothing that was tried is better than the law as given."] if best is self.before else []
        for free, number in zip(self.free, best.numbers, strict=True):
            if number is not None and min(free.place(number), 1 - free.place(number)) < 0.01:
                remarks.append(f"`{free.name}` is at the end of its range: a wider one may hold a better law.")
        return remarks

    def _front_rows(self, best: Trial) -> list[list[str]]:
        front = list(self.front)
        if len(front) > 15:  # spread over the front, with its ends and the best
            chosen = {0, len(front) - 1, front.index(best)} | {round(i * (len(front) - 1) / 12) for i in range(13)}
            front = [front[i] for i in sorted(chosen)]
        goals, own = (
            [reading(unit, self.display_units) for unit in self.units],
            [reading(each.unit, self.display_units) for each in self.free],
        )
        names = [heading(name, each.unit) for name, each in zip(self.objectives, goals, strict=True)]
        rows = [["", *names, *(heading(free.name, each.unit) for free, each in zip(self.free, own, strict=True))]]
        for trial in front:
            found = [_short(value * each.factor) for value, each in zip(self.counted(trial), goals, strict=True)]
            numbers = [plain_number(number, each.factor) for number, each in zip(trial.numbers, own, strict=True)]
            rows.append([_TUNED if trial is best else "", *found, *numbers])
        return rows

    def plot(self, ax: Any = None) -> Any:
        """Draw the Pareto front or, for one objective, the best value over the number of trials (`toolbox.tuning.figures.tuning_diagram`).

        Parameters
        ----------
        ax
            Matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.figures.style import reading_of  # here, because matplotlib is slow to import
        from toolbox.tuning.figures import tuning_diagram

        tried = np.array([self.counted(trial) for trial in self.trials])
        front = np.array([self.counted(trial) for trial in self.front]).reshape(-1, len(self.objectives))
        sizes = np.abs(front).max(axis=0, initial=0.0)
        read = [reading_of(unit, float(size), self.display_units) for unit, size in zip(self.units, sizes, strict=True)]
        names = [heading(name, shown) for name, (_, shown) in zip(self.objectives, read, strict=True)]
        factors = np.array([factor for factor, _ in read])
        best = factors * self.counted(self.best) if len(front) else None
        return tuning_diagram(names, factors * tried, factors * front, factors * self.counted(self.before), best, ax)

    def _table(self) -> HeadedRows:
        """One row per trial: numbers, objectives over the scenes and in each, membership of the front, failures."""
        named = [heading(name, unit) for name, unit in zip(self.objectives, self.units, strict=True)]
        each = [f"{label}: {name}" for label in self.scenes for name in named] if len(self.scenes) > 1 else []
        front, rows = self.front, []
        for trial in self.trials:
            scenes = [value for row in trial.values for value in row] if each else []
            failure = "; ".join(words for words in trial.failures if words)
            rows.append([*trial.numbers, *self.counted(trial), *scenes, int(any(trial is member for member in front)), failure])
        return [*(heading(free.name, free.unit) for free in self.free), *named, *each, "front", "failure"], rows


_TUNED = "*"
NOTHING = "Nothing was found: no point has finite objectives."


def counted_over(trial: Trial, over: Callable[[Sequence[float]], float]) -> tuple[float, ...]:
    """Return every objective of a trial over its scenes; inf if a scene has no value of the objective."""
    each = zip(*trial.values, strict=True)
    return tuple(float(over(list(values))) if all(map(math.isfinite, values)) else math.inf for values in each)


def front_of(values: np.ndarray) -> list[int]:
    """Pareto front: indices of finite rows that no other row dominates; of equal rows the first."""
    kept = []
    for i, row in enumerate(values):
        if np.isfinite(row).all():
            beaten = (values <= row).all(axis=1) & (values < row).any(axis=1)
            same = (values[:i] == row).all(axis=1)
            if not beaten.any() and not same.any():
                kept.append(i)
    return kept


def _over_words(over: Any) -> str:
    name = getattr(over, "__name__", str(over))
    return f"the {_OVER[name]}" if name in _OVER else f"`{name}`"


def _count(number: int, word: str) -> str:
    return f"{number} {word}{'' if number == 1 else 's'}"


def plain_number(number: float | None, factor: float = 1.0) -> str:
    """A number in six digits, times a factor; None is left to the design of the law."""
    return "by design" if number is None else f"{number * factor:.6g}"


def _short(value: float) -> str:
    return "none" if not math.isfinite(value) else f"{value:.4g}"


def _gain(old: float, new: float) -> str:
    return f"{100 * (new / old - 1):+.0f} %" if math.isfinite(old) and math.isfinite(new) and old > 0 else ""


def with_numbers(loop: ClosedLoop, free: Sequence[Free], numbers: Sequence[float | None]) -> ClosedLoop:
    """The loop with its free numbers changed; None leaves a number as it is."""
    changed = ((each.name, number) for each, number in zip(free, numbers, strict=True) if number is not None)
    return functools.reduce(lambda made, number: made.at(*number), changed, loop)


_OVER = {"max": "worst", "fmean": "mean"}
