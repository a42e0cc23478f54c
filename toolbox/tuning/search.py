"""The search of a tuning: points of the unit cube, each simulated once or taken from a journal; `toolbox.tune` says how it goes and why."""

from __future__ import annotations

import concurrent.futures
import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from toolbox.arguments import is_finite_number
from toolbox.errors import SceneError, SimulationError
from toolbox.files.journal import Journal
from toolbox.measuring.metrics import Metric
from toolbox.robustness.starts import Found, Start
from toolbox.scenes.judged import judged_measures
from toolbox.scenes.scene import Scene
from toolbox.simulation.simulate import simulate
from toolbox.sweeps.executors import travelling
from toolbox.tuning.results import Free, Trial, counted_over, front_of, with_numbers

WORST = 1e100
"""What the optimisers see in place of infinity, so that their differences are numbers."""


class Spent(Exception):
    """All points that the search may try have been tried."""


def trial_objectives(
    scene: Scene,
    numbers: tuple[float | None, ...],
    label: str,
    free: tuple[Free, ...],
    objectives: tuple[Metric, ...],
    strict: bool,
    starts: Start | None,
) -> tuple[tuple[float, ...], str]:
    """The objectives of one scene under a law with other numbers, the worst of all its starts, and why it failed.

    strict: let what is wrong with the law itself be raised.
    """
    refused = () if strict else (SceneError, np.linalg.LinAlgError)
    try:
        loop = with_numbers(scene[label], free, numbers)
        found = Found([loop.start]) if starts is None else starts.on(loop)
        rows = []
        for begun in found.loops(loop):
            run = simulate(begun)
            asked = judged_measures(dict(enumerate(objectives)), run.run.loop, run.begin, run.end, "objective")
            rows.append([each.read(run) for each in asked.values()])
        if not rows:
            return (math.inf,) * len(objectives), found.note
        values = np.max(rows, axis=0).tolist()
    except (SimulationError, *refused) as error:
        return (math.inf,) * len(objectives), f"{type(error).__name__}: {error}"
    return tuple(value if math.isfinite(value) else math.inf for value in values), ""


def is_result(kept: Any, scenes: int, objectives: int) -> bool:
    """Return whether an entry of a journal is the result of a point: a row of objectives and a reason of failure for each scene."""
    rows, failures = (kept.get("values"), kept.get("failures")) if isinstance(kept, dict) else (None, None)
    if not isinstance(rows, list) or not isinstance(failures, list) or not len(rows) == len(failures) == scenes:
        return False
    whole = all(
        isinstance(row, list) and len(row) == objectives and all(value is None or is_finite_number(value) for value in row) for row in rows
    )
    return whole and all(isinstance(text, str) for text in failures)


class TuningSearch:
    """Points of the unit cube as trials: simulated once, here or by an executor, or taken from the journal."""

    def __init__(
        self, scenes: list[Scene], label: str, free: tuple[Free, ...], objectives: dict[str, Metric], over: Any, runs: int, journal: Journal | None,
        executor: concurrent.futures.Executor | None = None, starts: Start | None = None,
    ):  # fmt: skip
        self.scenes, self.label, self.free, self.objectives = scenes, label, free, objectives
        self.over, self.runs, self.journal, self.executor, self.starts = over, runs, journal, executor, starts
        self.trials: dict[tuple[float | None, ...], Trial] = {}
        self.simulated = 0
        self.bar: Any = None

    def given(self) -> Trial:
        """Return the trial of the given law. Its errors are raised, for the user."""
        return self.tried([tuple(each.given for each in self.free)], strict=True)[0]

    @property
    def start(self) -> np.ndarray | None:
        """Place of the given law in the cube; None if the law is outside of the cube or leaves a number to `design`."""
        if any(each.given is None for each in self.free):
            return None
        z = np.array([each.place(each.given) for each in self.free])  # type: ignore[arg-type]
        return z if (z >= 0).all() and (z <= 1).all() else None

    def __call__(self, places: np.ndarray) -> np.ndarray:
        """The objectives at places, shape (places, objectives). Raises Spent where no more may be tried."""
        points = [tuple(each.number(float(place)) for each, place in zip(self.free, z, strict=True)) for z in places]
        return np.minimum([counted_over(trial, self.over) for trial in self.tried(points)], WORST)

    def tried(self, points: Sequence[tuple[float | None, ...]], strict: bool = False) -> list[Trial]:
        """Return the trials of points, in their order. New points are simulated together if there is an executor. Spent is raised after the
        last allowed trial."""
        known = self.journal.known if self.journal is not None else {}
        fresh = list(dict.fromkeys(numbers for numbers in points if numbers not in self.trials))[: self.runs - len(self.trials)]
        found = self._evaluated([numbers for numbers in fresh if numbers not in known], strict)
        for numbers in fresh:
            kept = known.get(numbers)
            if kept is not None:
                values = tuple(tuple(math.inf if value is None else value for value in row) for row in kept["values"])
                trial = Trial(numbers, values, tuple(kept["failures"]))
            else:
                each = next(found)
                trial = Trial(numbers, tuple(values for values, _ in each), tuple(words for _, words in each))
                self.simulated += len(each)
                if self.journal is not None:
                    rows = [[value if math.isfinite(value) else None for value in row] for row in trial.values]
                    self.journal.add(numbers, {"values": rows, "failures": trial.failures})
            self.trials[numbers] = trial
            self.bar.update(1)
        if any(numbers not in self.trials for numbers in points):
            raise Spent
        return [self.trials[numbers] for numbers in points]

    def _evaluated(self, points: list[tuple[float | None, ...]], strict: bool) -> Iterator[tuple[tuple[tuple[float, ...], str], ...]]:
        """What `trial_objectives` says of every point in every scene, one point after the other."""
        objectives = tuple(self.objectives.values())
        find = partial(trial_objectives, label=self.label, free=self.free, objectives=objectives, strict=strict, starts=self.starts)
        pairs = self.scenes * len(points), [numbers for numbers in points for _ in self.scenes]
        if self.executor is None:
            yield from zip(*[map(find, *pairs)] * len(self.scenes), strict=True)
            return
        with travelling(self.scenes, find):  # what waits is cancelled where the search ends early
            yield from zip(*[self.executor.map(find, *pairs)] * len(self.scenes), strict=True)


def _sample(search: TuningSearch, size: int, seed: int) -> np.ndarray:
    """Places of a scrambled Sobol sequence; the first is that of the given law where it has one."""
    from scipy.stats import qmc

    z = qmc.Sobol(len(search.free), scramble=True, seed=seed).random_base2(max(size - 1, 1).bit_length())[:size]
    if search.start is not None:
        z[0] = search.start
    return z


def smallest(search: TuningSearch, seed: int) -> None:
    """Minimise a single objective by differential evolution, then by Nelder-Mead with the remaining runs."""
    from scipy.optimize import differential_evolution

    n = len(search.free)
    share = round(0.7 * search.runs)
    size = max(5, min(1 << (8 * n - 1).bit_length(), share // 3))
    population = _sample(search, size, seed)
    search((population - 0.5) + 0.5)  # all at once; rounded as scipy does before it asks for them one by one
    differential_evolution(  # a better member counts at once: to wait for its generation would suit an executor, but finds less in as many points
        lambda z: float(search(z[None])[0, 0]), [(0.0, 1.0)] * n, init=population, maxiter=max(share // size - 1, 1), seed=seed, polish=False,
        tol=-1.0, callback=_gathered,
    )  # fmt: skip
    _polished(search, lambda values: values[..., 0], search.runs)


def _gathered(intermediate_result: Any) -> None:
    """End the evolution where its whole population is as good as its best member; one that only fails is no such thing."""
    values = intermediate_result.population_energies
    if values.max() < WORST and np.ptp(values) <= 1e-4 * abs(float(values.mean())):
        raise StopIteration


def spread(search: TuningSearch, seed: int) -> None:
    """Several objectives: a sample of the whole box, then one polish for each direction of weights."""
    search(_sample(search, max(search.runs // 2 - 1, 5), seed))
    values = np.array([counted_over(trial, search.over) for trial in search.trials.values()])
    front = values[front_of(values)]
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


def _polished(search: TuningSearch, scalar: Callable[[np.ndarray], Any], until: int) -> None:
    """Nelder-Mead from the best trial so far, until so many trials have been made."""
    from scipy.optimize import minimize

    inside = [trial for trial in search.trials.values() if None not in trial.numbers and _inside(search.free, trial)]
    values = np.minimum([counted_over(trial, search.over) for trial in inside], WORST)
    best = inside[int(np.argmin(scalar(values)))]
    if not np.isfinite(counted_over(best, search.over)).all():
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
        return float(scalar(search(point[None])[0]))

    search(simplex)
    with contextlib.suppress(StopIteration):
        minimize(
            counted, z, method="Nelder-Mead", bounds=[(0.0, 1.0)] * len(z),
            options={"initial_simplex": simplex, "xatol": 1e-4, "fatol": math.inf, "maxfev": 4 * room},
        )  # fmt: skip


def _inside(free: Sequence[Free], trial: Trial) -> bool:
    return all(number is not None and each.low <= number <= each.high for each, number in zip(free, trial.numbers, strict=True))
