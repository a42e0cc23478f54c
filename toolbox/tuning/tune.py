"""Tuning: the numbers of a control law that make an objective small on one scene or on the worst of several.

    minimise over q in a box:   over_s f(run of scene s under the law with numbers q)

Why no gradients: sticking ends or does not, so that objectives of stick-slip have cliffs and plateaus; a search that compares values passes them. One
objective: differential evolution (R. Storn, K. Price, J. Global Optimization 11 (1997) 341-359, as in scipy) from a Sobol population that holds the
given law, then Nelder-Mead from the best point. Several: half of the points are a Sobol sample of the whole box; from the best
of them along each direction of weights Nelder-Mead makes max_j w_j f_j + sum_j f_j / 1000 small, the f_j counted between best and worst of the front so
far, which also reaches fronts that are not convex; all points that no other point beats are the front. Numbers whose range is positive and spans a decade
or more are searched by their logarithm. A run that fails, or whose objective does not exist, is infinitely bad and recorded.

A law with other numbers is the same compiled machine code: one evaluation costs the runs of the scenes and nothing else.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.arguments import is_finite_number, whole
from toolbox.errors import SceneError
from toolbox.files.journal import Journal, fingerprint
from toolbox.files.unit_systems import asked_in
from toolbox.files.units import NumberOrText, TypedNumber, in_si
from toolbox.measuring.metrics import metrics_of
from toolbox.messages import progress_bar
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.components import law_of, numbers_of
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Controller, Sampled
from toolbox.modelling.numbers import law_with_numbers
from toolbox.robustness.starts import Start
from toolbox.scenes.cases import Case
from toolbox.scenes.judged import judged_measures
from toolbox.scenes.scene import Scene
from toolbox.scenes.situation import Situation, start_in_words
from toolbox.sweeps.executors import check_executor
from toolbox.tuning.results import Free, Tuned, plain_number, with_numbers
from toolbox.tuning.search import Spent, TuningSearch, is_result, smallest, spread
from toolbox.vocabulary import new_names_only


@new_names_only
def tune(
    scene: Scene | HybridSystem | Sequence[Scene | HybridSystem] | Mapping[str, Scene | HybridSystem],
    controller: str | Controller | Sampled,
    objective: Any,
    ranges: Mapping[str, tuple[NumberOrText, NumberOrText]],
    *,
    duration: NumberOrText | None = None,
    starts: Start | None = None,
    aggregate: Callable[[Sequence[float]], float] = max,
    runs: int = 200,
    seed: int = 0,
    checkpoint: str | Path | None = None,
    executor: concurrent.futures.Executor | None = None,
) -> Tuned:
    """Find the numbers of a controller within `ranges` that minimise one objective, or the Pareto front of several objectives.

    The same arguments give the same result with any executor. If the controller of a point cannot be designed, or a run
    of the point fails, its objective counts as infinite.

    Parameters
    ----------
    scene
        One scene, several, or {label: scene}: the controller is judged on all of them. A plant may replace a scene and
        counts as `Scene.of(plant, duration)`: it starts from rest and is judged in the second half of the run.
    controller
        A `Controller` (continuous), a `Sampled`, or the label of a case that every scene has. With a label the
        controller of each scene keeps its own set-point, sample time and sensors.
    objective
        The objective that is minimised: the name of a metric ("stuck" [s], "severity", "settling" [s], "overshoot" or
        "peak"), which is computed for the contact, the signal and the times of the scene. Or a function run -> float. A
        sequence or {label: objective} asks for a Pareto front.
    ranges
        {number of the controller: (low, high)}, in SI or text with units. The names are the names of numbers of the
        loop, such as "pi.proportional", "softtorque.detuning" or "lqr.gain.0". If only the design uses the number, the
        controller is designed again. Any other number is changed where it acts.
    duration
        Length of the runs [s], or text with a unit, needed if `scene` is a plant. By default None: a scene has its own
        duration.
    starts
        Start of the runs, as in `worst_case`, such as `TakenOver(StiffPI(), phases=2)`. The start is found for every
        point, and of several runs the largest value of an objective counts. By default None: each scene has its own
        start, which is rest if it gives no values.
    aggregate
        Function that combines the values of several scenes: `max` (default) for the worst case, `statistics.fmean` for
        the mean.
    runs
        Largest number of points that are tried, by default 200. Each point needs one run per scene.
    seed
        Seed of the random numbers of the search, by default 0.
    checkpoint
        Path of a file that keeps every point, by default None. The same call after an interruption continues from this
        file and gives the same result. A call with a larger number `runs` uses the points of an earlier call with fewer runs.
    executor
        Any `concurrent.futures.Executor` of processes, such as the executor of a Dask client. It simulates in parallel
        all scenes of a point, and all points that the search can name before their results are known. By default one
        run follows the other in this process.

    Returns
    -------
    Tuned
        All points that were tried, the best point or the front, and the tuned controller.

    Raises
    ------
    SceneError
        If the arguments cannot be tuned, a controller or objective cannot be evaluated or cannot be sent to an
        executor, or the checkpoint belongs to other arguments.

    Examples
    --------
    >>> from controllers import PI
    >>> from models import BitRock, wells
    >>> from toolbox import compose, tune
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="60 kN"))
    >>> drive = PI(proportional=400.0, integral=100.0, reference="120 rpm")
    >>> found = tune(rig, drive, "severity", {"pi.proportional": (100.0, 2000.0)}, duration="60 s", runs=10)
    >>> print(len(found.trials), "points, severity", f"{found.best.values[0][0]:.2f}")
    10 points, severity 0.02
    """
    asked = _scenes(scene, controller, in_si(duration, "s", "duration"))
    scenes = {label: _with_case(each, controller) for label, each in asked.items()}
    chosen = controller if isinstance(controller, str) else "tuned"
    cases = [each.case(chosen) for each in scenes.values()]
    loops = {label: each[chosen] for label, each in scenes.items()}
    free = _shared(loops, ranges)
    objectives = metrics_of(objective, "objective")
    judged = [judged_measures(objectives, loops[label], 0.0, each.duration, "objective") for label, each in scenes.items()]
    if not callable(aggregate):
        raise SceneError(f"Argument `aggregate` must be a function such as `max`, but it is {aggregate!r}.")
    whole("runs", runs, 10)
    whole("seed", seed, 0)
    check_executor(executor)
    kept = None
    if checkpoint is not None:
        kept = Journal(
            checkpoint,
            {
                "scene": fingerprint(asked),
                "controller": fingerprint([case.controller for case in cases]),
                "objective": repr({name: repr(each) if each.looks_at else fingerprint(each.function) for name, each in objectives.items()}),
                "ranges": repr([(each.name, each.low, each.high) for each in free]),
                "seed": str(seed),
            }
            | ({} if starts is None else {"starts": fingerprint(starts)}),
            lambda result: is_result(result, len(scenes), len(objectives)),
        )
    search = TuningSearch(list(scenes.values()), chosen, free, objectives, aggregate, runs, kept, executor, starts)
    with progress_bar(runs, "tuning", bar_format="{desc} |{bar:30}| {n_fmt}/{total_fmt} points, {elapsed}") as search.bar:
        search.given()
        with contextlib.suppress(Spent):
            smallest(search, seed) if len(objectives) == 1 else spread(search, seed)
    law = cases[0].law
    label = f"{type(law).__name__} `{controller}`" if isinstance(controller, str) else type(law).__name__
    loop = loops[next(iter(loops))]
    units = [each.unit_in(loop.system) for each in judged[0].values()]
    return Tuned(
        label,
        free,
        tuple(objectives),
        tuple(units),
        tuple(scenes),
        aggregate,
        tuple(search.trials.values()),
        seed,
        search.simulated,
        loop,
        {**scenes[next(iter(scenes))].display_units, **{each.unit: asked_in((each.low, each.high), each.unit) for each in reversed(free)}},
        _situation(scenes, loops, starts),
    )


def _situation(scenes: Mapping[str, Scene], loops: Mapping[str, ClosedLoop], starts: Start | None) -> str:
    """The situation of the objectives, in one line: that of the first scene, and how many there are."""
    label = next(iter(scenes))
    plants = "the plant of the scene" if len(scenes) == 1 else f"the plants of {len(scenes)} scenes"
    first = scenes[label]
    lasts = f"{first.duration:g} s, judged from {first.after:g} s on"
    begun = start_in_words(loops[label]) if starts is None else starts.words
    return str(Situation.of(loops[label], begun, lasts, plants=plants, design="controller designed anew for each point"))


def _scenes(given: Any, controller: Any, duration: float | None) -> dict[str, Scene]:
    if isinstance(given, (Scene, HybridSystem)):
        given = [given]
    several = list(given.values()) if isinstance(given, Mapping) else list(given) if isinstance(given, Sequence) else [given]
    if any(isinstance(each, HybridSystem) for each in several):
        if isinstance(controller, str):
            raise SceneError(
                f"Argument `controller` must be a law where a plant is tuned for, not the label of a case, but it is {controller!r}."
            )
        several = [_scene(each, controller, duration) if isinstance(each, HybridSystem) else each for each in several]
        given = dict(zip(given, several, strict=True)) if isinstance(given, Mapping) else several
    elif duration is not None:
        raise SceneError(f"Argument `duration` must be left out for scenes, which have their own, but it is {duration!r}.")
    if not isinstance(given, Mapping):
        if not isinstance(given, Sequence) or not all(isinstance(each, Scene) for each in given):
            raise SceneError(f"Argument `scene` must be a Scene, a plant made by `compose`, or several, but it is {given!r}.")
        titles = [each.title for each in given]
        given = {
            title if titles.count(title) == 1 else f"{title} ({i})": each
            for i, (title, each) in enumerate(zip(titles, given, strict=True), 1)
        }
    if not given or not all(isinstance(label, str) and isinstance(each, Scene) for label, each in given.items()):
        raise SceneError(f"Argument `scene` must hold at least one Scene by its label, but it is {given!r}.")
    return dict(given)


def _scene(plant: HybridSystem, controller: Any, duration: Any) -> Scene:
    """The scene of a plant; where nothing sticks, its first scalar signal stands for the judged one."""
    scalar = None if plant.elements else next((name for name, (value, _) in plant.signals.items() if value.numel() == 1), None)
    return Scene.of(plant, duration, {"tuned": controller}, signal=scalar)


def _with_case(scene: Scene, controller: Any) -> Scene:
    """The scene of the one case whose law is tuned."""
    if isinstance(controller, str):
        case = scene.case(controller)
    elif isinstance(controller, (Controller, Sampled)):
        case = Case.of("tuned", controller)
    else:
        raise SceneError(f"Argument `controller` must be the label of a case, a Controller, or Sampled with one, but it is {controller!r}.")
    scene = dataclasses.replace(scene, cases=(case,))
    scene.check()
    return scene


def _free(loop: ClosedLoop, bounds: Any) -> tuple[Free, ...]:
    """The free numbers of the law of a loop, checked."""
    if not isinstance(bounds, Mapping) or not bounds:
        raise SceneError(f"Argument `ranges` must map numbers of the law to (low, high), but it is {bounds!r}.")
    if not loop.controllers:
        raise SceneError("Argument `controller` must name a case with a law, but it has none.")
    first, law = sum(len(numbers_of(part)) for part in loop.plant.parts), loop.designed_controllers[0]
    own = range(first, first + (len(numbers_of(law)) if isinstance(law, Controller) else 0))
    free = []
    for name, pair in bounds.items():
        number = loop.number(name)
        if not number.is_design and not (number.is_parameter and loop.system._parameter(number.name).offset in own):
            why = number.kind.why_no_tuning or "it is none of them"
            how = "give `loop.at(name, value)` for each value" if number.kind.why_no_sweep else "vary it by `sweep`"
            raise SceneError(f"Argument `ranges` must hold gains of the controller that is tuned, not `{name}`, because {why}: {how}.")
        if number.name in loop.parameters:
            raise SceneError(f"Argument `ranges` must not hold `{name}`, because `parameters` of the scene says what it is.")
        ends = number.in_si(f"bounds.{name}", pair)
        if not isinstance(ends, Sequence) or len(ends) != 2 or not all(map(is_finite_number, ends)) or not ends[0] < ends[1]:
            raise SceneError(f"Argument `ranges` of `{name}` must be (low, high) in {number.unit} with low < high, but it is {pair!r}.")
        for end in ends:
            number.check(end)
        low, high = (end if isinstance(end, TypedNumber) else float(end) for end in ends)
        free.append(Free(number.name, number.unit, low, high, number.value))
    return tuple(free)


def _shared(scenes: Mapping[str, ClosedLoop], bounds: Any) -> tuple[Free, ...]:
    """The free numbers of the loops of all scenes. Raises SceneError where they are declared differently, or one law cannot say them for all."""
    label, loop = next(iter(scenes.items()))
    free = list(_free(loop, bounds))
    for other, here in scenes.items():
        for i, (mine, its) in enumerate(zip(free, _free(here, bounds), strict=True)):
            if mine.given is None or mine.given == its.given:
                continue
            if here.controllers != loop.controllers:
                words = f"{plain_number(mine.given)} in `{label}` and {plain_number(its.given)} in `{other}`"
                raise SceneError(f"Argument `controller` must start from the same `{mine.name}` in every scene, but it is {words}.")
            free[i] = dataclasses.replace(mine, given=None)
        if here.controllers == loop.controllers and _at_low_ends(here, free) != _at_low_ends(loop, free):
            raise SceneError(
                "Argument `ranges` must hold numbers that the law declares where it is designed otherwise in each scene, as "
                f"{type(law_of(loop.controllers[0])).__name__} is, but it holds {', '.join(f'`{each.name}`' for each in free)}."
            )
    return tuple(free)


def _at_low_ends(loop: ClosedLoop, free: Sequence[Free]) -> Any:
    """The law with all its free numbers at their low ends; None where there is none."""
    try:
        return law_with_numbers(with_numbers(loop, free, [each.low for each in free]))
    except (SceneError, np.linalg.LinAlgError):
        return None
