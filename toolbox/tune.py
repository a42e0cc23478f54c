"""Tuning: the numbers of a control law that make an objective small on one scene or on the worst of several.

    minimise over q in a box:   over_s f(run of scene s under the law with numbers q)

Why no gradients: sticking ends or does not, so that objectives of stick-slip have cliffs and plateaus; a search that compares values passes them. One
objective: differential evolution (R. Storn, K. Price, J. Global Optimization 11 (1997) 341-359, as in scipy) from a Sobol population that holds the
given law, then Nelder-Mead from the best point. Several: half of the points are a Sobol sample of the whole box; from the best of them along each
direction of weights Nelder-Mead makes max_j w_j f_j + sum_j f_j / 1000 small, the f_j counted between best and worst of the front so far, which also
reaches fronts that are not convex; all points that no other point beats are the front. Numbers whose range is positive and spans a decade or more are
searched by their logarithm. A run that fails, or whose objective does not exist, is infinitely bad and recorded.

A law with other numbers is the same compiled machine code: one evaluation costs the runs of the scenes and nothing else.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from toolbox import measure
from toolbox.closed_loop import Controller, Sampled
from toolbox.elements import is_finite_number
from toolbox.errors import SceneError, SimulationError, suggest
from toolbox.journal import Journal, fingerprint
from toolbox.parts import _fields, _nested, bounds_broken
from toolbox.scene import Case, Scene
from toolbox.study import MEASURES, measured
from toolbox.trajectory import Trajectory

Objective = str | Callable[[Trajectory], float]
_BY_FUNCTION: Mapping[Any, str] = {measure.severity: "severity", measure.settling: "settling", measure.overshoot: "overshoot"}
_UNITS = {"stuck": "s", "severity": "1", "settling": "s", "overshoot": "1"}
_WORST = 1e100
"""What the optimisers see in place of infinity, so that their differences are numbers."""


# ----------------------------------------------------------------------------------------------------------------------------------- the result
@dataclass(frozen=True)
class Free:
    """A free number: field of the law, unit, range, whether its logarithm is searched, and its value in the given law (None: left to `design`)."""

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
        """The number at a place between 0 and 1 of the range, rounded to six digits: what is printed is what was simulated."""
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
    """One point of the search: numbers in the order of the free fields; values[scene][objective], inf where there is none; why runs failed ("" for none)."""

    numbers: tuple[float | None, ...]
    values: tuple[tuple[float, ...], ...]
    failures: tuple[str, ...]

    @property
    def failed(self) -> bool:
        """Whether a run of any scene could not be finished."""
        return any(self.failures)


@dataclass(frozen=True)
class Tuned:
    """What a tuning found; `print` it for the report.

    free: the numbers that were free;  objectives, units: what was made small;  scenes: their labels;  over: what counts of the scenes;  before: the
    law as it was given;  trials: every point tried, `before` first;  simulated: runs that this call had to simulate, the others came from the journal.
    """

    title: str
    free: tuple[Free, ...]
    objectives: tuple[str, ...]
    units: tuple[str, ...]
    scenes: tuple[str, ...]
    over: Callable[[Sequence[float]], float]
    trials: tuple[Trial, ...]
    seed: int
    simulated: int
    controller: Controller | Sampled = field(repr=False)

    @property
    def before(self) -> Trial:
        """The law as it was given."""
        return self.trials[0]

    def counted(self, trial: Trial) -> tuple[float, ...]:
        """What counts of a trial: every objective over the scenes."""
        return _counted(trial, self.over)

    @property
    def front(self) -> tuple[Trial, ...]:
        """The trials that no other trial beats in every objective, by the first objective; empty where nothing could be simulated."""
        points = [(self.counted(trial), trial) for trial in self.trials]
        kept = [points[i] for i in _front(np.array([values for values, _ in points]))]
        return tuple(trial for _, trial in sorted(kept, key=lambda pair: pair[0]))

    @property
    def best(self) -> Trial:
        """The trial with the smallest objective. Raises SceneError where no trial succeeded.

        Of a front, the one nearest to its ideal corner, the axes counted from its best to its worst; where some are no worse than the given law in any
        objective, one of these.
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
    def law(self) -> Any:
        """The best law, ready for `simulate(..., controller=law)`: with its period, delay and sensors where it is sampled."""
        return self.law_of(self.best)

    def law_of(self, trial: Trial) -> Any:
        """The law of any trial, such as another member of the front."""
        return _with_numbers(self.controller, self.free, trial.numbers)

    def applied(self, scene: Scene, label: str) -> Scene:
        """A scene whose case of that label stands twice: as given, and with the best numbers as "<label>, tuned", next to it."""
        cases = []
        for case in scene.cases:
            cases.append(case)
            if case.label == scene.case(label).label:
                law = _with_numbers(case.law, self.free, self.best.numbers)
                cases.append(dataclasses.replace(case, label=f"{case.label}, tuned", law=law))
        return dataclasses.replace(scene, cases=tuple(cases))

    def __str__(self) -> str:
        tried = len(self.trials)
        failed = sum(trial.failed for trial in self.trials)
        several = len(self.scenes) > 1
        lines = [
            f"Tuning of {self.title}: {_count(len(self.free), 'free number')}, {_count(len(self.objectives), 'objective')}"
            + (f", {_over_words(self.over)} of {len(self.scenes)} scenes counts" if several else "")
            + f"; {tried} points, {tried * len(self.scenes)} runs, seed {self.seed}",
            *([f"{failed} of the points have a run that could not be finished: infinitely bad."] if failed else []),
        ]
        if not self.front:
            return "\n".join([*lines, "Nothing was found: no point has finite objectives."])
        best = self.best
        rows = [["", "given", "tuned", "range"]]
        for free, number in zip(self.free, best.numbers, strict=True):
            words = f"{free.low:g} .. {free.high:g}{', log' if free.logarithmic else ''}"
            rows.append([_labelled(free.name, free.unit), _plain(free.given), _plain(number), words])
        rows.append([])
        for j, (name, unit) in enumerate(zip(self.objectives, self.units, strict=True)):
            old, new = self.counted(self.before)[j], self.counted(best)[j]
            rows.append([_labelled(name, unit), _short(old), _short(new), _gain(old, new)])
            if several:
                rows += [
                    [f"  {label}", _short(before[j]), _short(after[j]), _gain(before[j], after[j])]
                    for label, before, after in zip(self.scenes, self.before.values, best.values, strict=True)
                ]
        lines += ["", *_table(rows)]
        if best is self.before:
            lines += ["", "Nothing that was tried is better than the law as given."]
        for free, number in zip(self.free, best.numbers, strict=True):
            if number is not None and min(free.place(number), 1 - free.place(number)) < 0.01:
                lines += ["", f"`{free.name}` is at the end of its range: a wider one may hold a better law."]
        if len(self.objectives) > 1:
            lines += ["", f"Front of {_count(len(self.front), 'point')} ({_TUNED} the one above):", *_table(self._front_rows(best))]
        return "\n".join(lines)

    def _front_rows(self, best: Trial) -> list[list[str]]:
        front = list(self.front)
        if len(front) > 15:  # spread over the front, with its ends and the best
            chosen = {0, len(front) - 1, front.index(best)} | {round(i * (len(front) - 1) / 12) for i in range(13)}
            front = [front[i] for i in sorted(chosen)]
        names = [_labelled(name, unit) for name, unit in zip(self.objectives, self.units, strict=True)]
        rows = [["", *names, *(_labelled(each.name, each.unit) for each in self.free)]]
        for trial in front:
            rows.append([_TUNED if trial is best else "", *map(_short, self.counted(trial)), *map(_plain, trial.numbers)])
        return rows

    def plot(self, ax: Any = None) -> Any:
        """The front, or the best so far over the number of trials; see `toolbox.diagram.tuning_diagram`."""
        from toolbox.diagram import tuning_diagram

        return tuning_diagram(self, ax=ax)

    def save(self, path: str | Path) -> Path:
        """Write one row per trial as csv, whole or not at all: numbers, objectives over the scenes and in each, membership of the front, failures."""
        import csv
        import io

        from toolbox.files import replaced

        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        named = [_labelled(name, unit) for name, unit in zip(self.objectives, self.units, strict=True)]
        each = [f"{label}: {name}" for label in self.scenes for name in named] if len(self.scenes) > 1 else []
        table.writerow([*(_labelled(free.name, free.unit) for free in self.free), *named, *each, "front", "failure"])
        front = self.front
        for trial in self.trials:
            scenes = [value for row in trial.values for value in row] if each else []
            numbers = ["" if number is None else number for number in trial.numbers]
            failure = "; ".join(words for words in trial.failures if words)
            table.writerow([*numbers, *self.counted(trial), *scenes, int(any(trial is member for member in front)), failure])
        with replaced(Path(path)) as file:
            file.write(text.getvalue().encode())
        return Path(path)


_TUNED = "*"


def _counted(trial: Trial, over: Callable[[Sequence[float]], float]) -> tuple[float, ...]:
    columns = zip(*trial.values, strict=True)
    return tuple(float(over(list(column))) if all(map(math.isfinite, column)) else math.inf for column in columns)


def _front(values: np.ndarray) -> list[int]:
    """Rows that are finite and that no other row beats: smaller or equal in all, smaller in one; of equal rows the first."""
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


def _labelled(name: str, unit: str) -> str:
    return name if unit in ("", "1") else f"{name} [{unit}]"


def _count(number: int, word: str) -> str:
    return f"{number} {word}{'' if number == 1 else 's'}"


def _plain(number: float | None) -> str:
    return "by design" if number is None else f"{number:.6g}"


def _short(value: float) -> str:
    return "none" if not math.isfinite(value) else f"{value:.4g}"


def _gain(old: float, new: float) -> str:
    return f"{100 * (new / old - 1):+.0f} %" if math.isfinite(old) and math.isfinite(new) and old > 0 else ""


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[i]) for row in rows if i < len(row)) for i in range(max(map(len, rows)))]
    return [
        "  ".join(cell.ljust(w) if i == 0 else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=False))).rstrip()
        for row in rows
    ]


# ------------------------------------------------------------------------------------------------------------------------------------- the verb
def tune(
    scene: Scene | Sequence[Scene] | Mapping[str, Scene],
    controller: str | Controller | Sampled,
    objective: Objective | Sequence[Objective] | Mapping[str, Objective],
    bounds: Mapping[str, tuple[float, float]],
    *,
    over: Callable[[Sequence[float]], float] = max,
    runs: int = 200,
    seed: int = 0,
    journal: str | Path | None = None,
    progress: bool = True,
) -> Tuned:
    """The numbers of a law within `bounds` that make one objective smallest, or the front of several; the module says how it searches.

    scene: one, several, or {label: scene}: the law must do well on all of them.  controller: label of a case that every scene has (each keeps its own
    set-point, period and sensors), a Controller (continuous) or Sampled.  objective: a column of the verdict ("stuck" [s], "severity", "settling" [s],
    "overshoot", "peak"; `measure.severity` is the same as "severity"), judged as the scene says, or a function run -> float to be made small; a sequence
    or {label: objective} for a front.  bounds: {numeric field of the law: (low, high)} in SI; a dot leads into nested laws ("law.detuning") and tuples
    ("gain.0").  over: what counts of the scenes' values, `max` for the worst case, `statistics.fmean` for the mean.  runs: most points tried, one
    run per scene each.  journal: file that keeps every point, so that a killed tuning called again goes on where it was and gives the same result; with
    larger `runs` a longer tuning uses the points of a shorter one.  progress: a bar on stderr where that is a terminal.

    The same arguments give the same result. Raises SceneError for arguments that cannot be tuned, a law or objective that cannot be evaluated as
    given, and a journal of other arguments. A later point whose law cannot be designed or whose run fails is recorded as infinitely bad.
    """
    scenes = _scenes(scene)
    cases = [_case(each, controller) for each in scenes.values()]
    free = _free(cases[0], bounds)
    for label, case in zip(scenes, cases, strict=True):
        for first, here in zip(free, _free(case, bounds), strict=True):
            if here.given != first.given:
                words = f"{_plain(first.given)} in `{next(iter(scenes))}` and {_plain(here.given)} in `{label}`"
                raise SceneError(f"Argument `controller` must start from the same `{here.name}` in every scene, but it is {words}.")
    objectives = _objectives(objective, list(scenes.values()))
    if not callable(over):
        raise SceneError(f"Argument `over` must be a function such as `max`, but it is {over!r}.")
    if isinstance(runs, bool) or not isinstance(runs, int) or runs < 10:
        raise SceneError(f"Argument `runs` must be an integer >= 10, but it is {runs!r}.")
    if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
        raise SceneError(f"Argument `seed` must be an integer >= 0, but it is {seed!r}.")
    kept = None
    if journal is not None:
        kept = Journal(
            journal,
            {
                "scene": fingerprint(scenes),
                "controller": fingerprint([case.controller for case in cases]),
                "objective": repr({name: fingerprint(each) for name, each in objectives.items()}),
                "bounds": repr([(each.name, each.low, each.high) for each in free]),
                "seed": str(seed),
            },
        )
    search = _Search(list(scenes.values()), cases, free, objectives, over, runs, kept)
    with _bar(runs, progress) as search.bar:
        search.given()
        with contextlib.suppress(_Spent):
            _smallest(search, seed) if len(objectives) == 1 else _spread(search, seed)
    law = cases[0].law
    label = f"{type(law).__name__} `{controller}`" if isinstance(controller, str) else type(law).__name__
    effort = scenes[next(iter(scenes))]
    units = [effort.plant().unit(effort.effort) if each == "peak" else _UNITS.get(str(each), "") for each in objectives.values()]
    return Tuned(
        label,
        free,
        tuple(objectives),
        tuple(units),
        tuple(scenes),
        over,
        tuple(search.trials.values()),
        seed,
        search.simulated,
        cases[0].controller,
    )


_OVER = {"max": "worst", "fmean": "mean"}


def _scenes(given: Any) -> dict[str, Scene]:
    if isinstance(given, Scene):
        given = [given]
    if not isinstance(given, Mapping):
        if not isinstance(given, Sequence) or not all(isinstance(each, Scene) for each in given):
            raise SceneError(f"Argument `scene` must be a Scene or several, but it is {given!r}.")
        titles = [each.title for each in given]
        given = {
            title if titles.count(title) == 1 else f"{title} ({i})": each
            for i, (title, each) in enumerate(zip(titles, given, strict=True), 1)
        }
    if not given or not all(isinstance(label, str) and isinstance(each, Scene) for label, each in given.items()):
        raise SceneError(f"Argument `scene` must hold at least one Scene by its label, but it is {given!r}.")
    return dict(given)


def _case(scene: Scene, controller: Any) -> Case:
    if isinstance(controller, str):
        case = scene.case(controller)
    elif isinstance(controller, Sampled) and isinstance(controller.law, Controller):
        c = controller
        case = Case("tuned", c.law, c.period, c.delay, noise=c.noise, resolution=c.resolution, seed=c.seed)  # type: ignore[arg-type]
    elif isinstance(controller, Controller):
        case = Case("tuned", controller)
    else:
        raise SceneError(f"Argument `controller` must be the label of a case, a Controller, or Sampled with one, but it is {controller!r}.")
    dataclasses.replace(scene, cases=(case,)).check()
    return case


def unit_of(law: Any, name: str) -> str:
    """Unit of a number of a law; raises SceneError where there is no such number."""
    fields = dict(_numbers(law))
    if name not in fields:
        raise SceneError(f"There is no number `{name}` in {type(law).__name__}: {suggest(name, fields)}")
    return str(fields[name][1].get("unit", "1"))


def _free(case: Case, bounds: Any) -> tuple[Free, ...]:
    """The free numbers of the law of a case, checked."""
    if not isinstance(bounds, Mapping) or not bounds:
        raise SceneError(f"Argument `bounds` must map fields of the law to (low, high), but it is {bounds!r}.")
    fields = dict(_numbers(case.law))
    free = []
    for name, pair in bounds.items():
        unit = unit_of(case.law, str(name))
        given, spec = fields[name]
        if not isinstance(pair, Sequence) or len(pair) != 2 or not all(map(is_finite_number, pair)) or not pair[0] < pair[1]:
            raise SceneError(f"Argument `bounds` of `{name}` must be (low, high) in {unit} with low < high, but it is {pair!r}.")
        for number in pair:
            broken = bounds_broken(number, spec)
            if broken:
                raise SceneError(f"Argument `bounds` of `{name}` must be {broken} {unit}, but it holds {number!r}.")
        free.append(Free(str(name), unit, float(pair[0]), float(pair[1]), None if given is None else float(given)))
    return tuple(free)


def _numbers(law: Any, path: str = "") -> list[tuple[str, tuple[float | None, Mapping[str, Any]]]]:
    """(dotted name, (value, what its field declares)) of every number of a law, and of those that `design` would fill in."""
    if law is None:
        raise SceneError("Argument `controller` must name a case with a law, but it has none.")
    found: list[tuple[str, tuple[float | None, Mapping[str, Any]]]] = []
    for declared in _fields(type(law)):
        value, name = getattr(law, declared.name), f"{path}{declared.name}"
        if _nested(value):
            found += _numbers(value, f"{name}.")
        elif declared.numeric and isinstance(value, tuple):
            found += [(f"{name}.{i}", (number, declared.spec.metadata)) for i, number in enumerate(value)]
        elif declared.numeric and not declared.tuples:
            found.append((name, (value, declared.spec.metadata)))
    return found


def _with_numbers(law: Any, free: Sequence[Free], numbers: Sequence[float | None]) -> Any:
    """The law with its free numbers replaced; None leaves a number as it is."""
    if isinstance(law, Sampled):
        return dataclasses.replace(law, law=_with_numbers(law.law, free, numbers))
    for each, number in zip(free, numbers, strict=True):
        if number is not None:
            law = _replaced(law, each.name.split("."), number)
    return law


def _replaced(node: Any, path: Sequence[str], number: float) -> Any:
    if not path:
        return number
    if isinstance(node, tuple):
        place = int(path[0])
        return (*node[:place], _replaced(node[place], path[1:], number), *node[place + 1 :])
    return dataclasses.replace(node, **{path[0]: _replaced(getattr(node, path[0]), path[1:], number)})


def _objectives(given: Any, scenes: Sequence[Scene]) -> dict[str, Objective]:
    if isinstance(given, str) or callable(given):
        given = [given]
    if not isinstance(given, Mapping):
        if not isinstance(given, Sequence):
            raise SceneError(f"Argument `objective` must be a measure, a function of a run, or several, but it is {given!r}.")
        names = [_BY_FUNCTION.get(each, getattr(each, "__name__", str(each))) if callable(each) else str(each) for each in given]
        if len(set(names)) < len(names):
            raise SceneError(
                f"Argument `objective` must hold every objective once, or name them in a mapping, but it holds {', '.join(names)}."
            )
        given = dict(zip(names, given, strict=True))
    if not given:
        raise SceneError("Argument `objective` must hold at least one objective, but it is empty.")
    found: dict[str, Objective] = {}
    for name, each in given.items():
        each = _BY_FUNCTION.get(each, each) if callable(each) else each
        if isinstance(each, str):
            if each not in MEASURES:
                raise SceneError(f"There is no objective `{each}`: {suggest(each, MEASURES)}")
            without = next((scene for scene in scenes if not scene.reference), None)
            if each in ("settling", "overshoot") and without is not None:
                raise SceneError(
                    f"Argument `objective` must not be {each} where a scene has no `reference`, but `{without.title}` has none."
                )
        elif not callable(each):
            raise SceneError(f"Argument `objective` must be a measure or a function of a run, but it is {each!r}.")
        found[str(name)] = each
    return found


def _bar(runs: int, progress: bool) -> Any:
    from tqdm import tqdm

    form = "{desc} |{bar:30}| {n_fmt}/{total_fmt} points, {elapsed}"
    return tqdm(total=runs, delay=1.0, leave=False, disable=None if progress else True, desc="tuning", bar_format=form)


# ----------------------------------------------------------------------------------------------------------------------------------- the search
class _Spent(Exception):
    """All points that the search may try have been tried."""


class _Search:
    """Points of the unit cube as trials: simulated once, or taken from the journal."""

    def __init__(
        self, scenes: list[Scene], cases: list[Case], free: tuple[Free, ...], objectives: dict[str, Objective], over: Any, runs: int, journal: Journal | None
    ):  # fmt: skip
        self.scenes, self.cases, self.free, self.objectives = scenes, cases, free, objectives
        self.over, self.runs, self.journal = over, runs, journal
        self.trials: dict[tuple[float | None, ...], Trial] = {}
        self.simulated = 0
        self.bar: Any = None

    def given(self) -> Trial:
        """The law as it is; what is wrong with it is the user's to know."""
        return self.trial(tuple(each.given for each in self.free), strict=True)

    @property
    def start(self) -> np.ndarray | None:
        """The place of the given law in the cube; None where it is outside or leaves a number to `design`."""
        if any(each.given is None for each in self.free):
            return None
        z = np.array([each.place(each.given) for each in self.free])  # type: ignore[arg-type]
        return z if (z >= 0).all() and (z <= 1).all() else None

    def __call__(self, z: np.ndarray) -> np.ndarray:
        """The objectives at a place. Raises _Spent where no more may be tried."""
        trial = self.trial(tuple(each.number(float(place)) for each, place in zip(self.free, z, strict=True)))
        return np.minimum(_counted(trial, self.over), _WORST)

    def trial(self, numbers: tuple[float | None, ...], strict: bool = False) -> Trial:
        known = self.trials.get(numbers)
        if known is not None:
            return known
        if len(self.trials) >= self.runs:
            raise _Spent
        kept = self.journal.known.get(numbers) if self.journal is not None else None
        if kept is not None:
            values = tuple(tuple(math.inf if value is None else value for value in row) for row in kept["values"])
            trial = Trial(numbers, values, tuple(kept["failures"]))
        else:
            found = [self.evaluated(scene, case, numbers, strict) for scene, case in zip(self.scenes, self.cases, strict=True)]
            trial = Trial(numbers, tuple(values for values, _ in found), tuple(words for _, words in found))
            self.simulated += len(found)
            if self.journal is not None:
                rows = [[value if math.isfinite(value) else None for value in row] for row in trial.values]
                self.journal.add(numbers, {"values": rows, "failures": trial.failures})
        self.trials[numbers] = trial
        self.bar.update(1)
        return trial

    def evaluated(self, scene: Scene, case: Case, numbers: tuple[float | None, ...], strict: bool) -> tuple[tuple[float, ...], str]:
        """The objectives of one scene, and why it failed."""
        refused = () if strict else (SceneError, np.linalg.LinAlgError)
        try:
            run = scene.run(dataclasses.replace(case, law=_with_numbers(case.law, self.free, numbers)))
            values = [float(measured(scene, run, each) if isinstance(each, str) else each(run)) for each in self.objectives.values()]
        except (SimulationError, *refused) as error:
            return (math.inf,) * len(self.objectives), f"{type(error).__name__}: {error}"
        return tuple(value if math.isfinite(value) else math.inf for value in values), ""


def _sample(search: _Search, size: int, seed: int) -> np.ndarray:
    """Places of a scrambled Sobol sequence; the first is that of the given law where it has one."""
    from scipy.stats import qmc

    z = qmc.Sobol(len(search.free), scramble=True, seed=seed).random_base2(max(size - 1, 1).bit_length())[:size]
    if search.start is not None:
        z[0] = search.start
    return z


def _smallest(search: _Search, seed: int) -> None:
    """One objective: differential evolution, then Nelder-Mead with what is left."""
    from scipy.optimize import differential_evolution

    n = len(search.free)
    share = round(0.7 * search.runs)
    size = max(5, min(1 << (8 * n - 1).bit_length(), share // 3))
    differential_evolution(
        lambda z: float(search(z)[0]), [(0.0, 1.0)] * n, init=_sample(search, size, seed), maxiter=max(share // size - 1, 1), seed=seed, polish=False,
        tol=-1.0, callback=_gathered,
    )  # fmt: skip
    _polished(search, lambda values: values[..., 0], search.runs)


def _gathered(intermediate_result: Any) -> None:
    """End the evolution where its whole population is as good as its best member; one that only fails is no such thing."""
    values = intermediate_result.population_energies
    if values.max() < _WORST and np.ptp(values) <= 1e-4 * abs(float(values.mean())):
        raise StopIteration


def _spread(search: _Search, seed: int) -> None:
    """Several objectives: a sample of the whole box, then one polish for each direction of weights."""
    for z in _sample(search, max(search.runs // 2 - 1, 5), seed):
        search(z)
    values = np.array([_counted(trial, search.over) for trial in search.trials.values()])
    front = values[_front(values)]
    if not front.size:
        return
    ideal, size = front.min(axis=0), np.ptp(front, axis=0)
    size = np.where(size > 0, size, np.maximum(np.abs(ideal), 1.0))
    directions = _directions(len(search.objectives), (search.runs - len(search.trials)) // (10 * (len(search.free) + 1)))
    for i, weights in enumerate(directions):

        def scalar(values: np.ndarray, weights: np.ndarray = weights) -> np.ndarray:
            counted = (values - ideal) / size
            return (weights * counted).max(axis=-1) + 1e-3 * counted.sum(axis=-1)

        left = search.runs - len(search.trials)
        _polished(search, scalar, len(search.trials) + left // (len(directions) - i))


def _directions(objectives: int, most: int) -> np.ndarray:
    """Weights spread evenly over the simplex, at least its corners."""
    import itertools

    parts = 1
    while math.comb(parts + objectives, objectives - 1) <= min(most, 15):
        parts += 1
    lattice = [w for w in itertools.product(range(parts + 1), repeat=objectives) if sum(w) == parts]
    return np.array(lattice, float) / parts


def _polished(search: _Search, scalar: Callable[[np.ndarray], Any], until: int) -> None:
    """Nelder-Mead from the best trial so far, until so many trials have been made."""
    from scipy.optimize import minimize

    inside = [trial for trial in search.trials.values() if None not in trial.numbers and _inside(search.free, trial)]
    values = np.minimum([_counted(trial, search.over) for trial in inside], _WORST)
    best = inside[int(np.argmin(scalar(values)))]
    if not np.isfinite(_counted(best, search.over)).all():
        return
    z = np.array([each.place(number) for each, number in zip(search.free, best.numbers, strict=True)])  # type: ignore[arg-type]
    step = np.where(z > 0.5, -0.06, 0.06)
    simplex = np.vstack([z, z + np.diag(step)])
    room = until - len(search.trials)
    if room < len(z) + 2:
        return

    def counted(point: np.ndarray) -> float:
        if len(search.trials) >= until:
            raise StopIteration
        return float(scalar(search(point)))

    with contextlib.suppress(StopIteration):
        minimize(
            counted, z, method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(z),
            options={"initial_simplex": simplex, "xatol": 1e-4, "fatol": math.inf, "maxfev": 4 * room},
        )  # fmt: skip


def _inside(free: Sequence[Free], trial: Trial) -> bool:
    return all(number is not None and each.low <= number <= each.high for each, number in zip(free, trial.numbers, strict=True))
