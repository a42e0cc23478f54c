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

from toolbox.arguments import is_finite_number, refuse, whole
from toolbox.errors import SceneError, suggest
from toolbox.files.unit_systems import asked_in
from toolbox.files.units import NumberOrText, TypedNumber, in_si
from toolbox.measuring import measure
from toolbox.messages import progress_bar
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.components import fields_of, is_nested, numbers_of
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Controller, Sampled
from toolbox.scenes.cases import Case
from toolbox.scenes.scene import Scene
from toolbox.scenes.verdicts import MEASURES
from toolbox.sweeps.executors import check_executor
from toolbox.tuning.journal import Journal, fingerprint
from toolbox.tuning.results import Free, Tuned, plain_number
from toolbox.tuning.search import Objective, Spent, TuningSearch, is_result, smallest, spread

_BY_FUNCTION: Mapping[Any, str] = {measure.severity: "severity", measure.settling: "settling", measure.overshoot: "overshoot"}
_UNITS = {"stuck": "s", "severity": "1", "settling": "s", "overshoot": "1"}


def tune(
    scene: Scene | HybridSystem | Sequence[Scene | HybridSystem] | Mapping[str, Scene | HybridSystem],
    controller: str | Controller | Sampled,
    objective: Objective | Sequence[Objective] | Mapping[str, Objective],
    bounds: Mapping[str, tuple[NumberOrText, NumberOrText]],
    *,
    duration: NumberOrText | None = None,
    over: Callable[[Sequence[float]], float] = max,
    runs: int = 200,
    seed: int = 0,
    journal: str | Path | None = None,
    progress: bool = True,
    executor: concurrent.futures.Executor | None = None,
) -> Tuned:
    """Find the numbers of a law within `bounds` that make one objective smallest, or the Pareto front of several.

    The module says how the search works. The same arguments give the same result, whatever the executor. A point whose law cannot be designed, or whose run
    fails, is recorded as infinitely bad.

    Parameters
    ----------
    scene
        One scene, several, or {label: scene}: the law must do well on all of them. A plant may stand for a scene, which is then `Scene.of(plant, duration)`:
        it starts from rest and is judged in the second half.
    controller
        Label of a case that every scene has (each keeps its own set-point, period and sensors), a `Controller` (continuous) or `Sampled`.
    objective
        What is made small: a column of the verdict ("stuck" [s], "severity", "settling" [s], "overshoot", "peak"; `measure.severity` is the same as
        "severity"), judged as the scene says, or a function run -> float. A sequence or {label: objective} asks for a front.
    bounds
        {number of the law: (low, high)}, in SI or text with units, by its name among the numbers of the loop: "pi.proportional", "softtorque.detuning",
        "lqr.gain.0". The law is designed anew at every point.
    duration
        Length of the runs of plants [s].
    over
        How the values of several scenes become one: `max` for the worst case, `statistics.fmean` for the mean.
    runs
        Largest number of points that are tried, one run per scene each.
    seed
        Seed of the search.
    journal
        File that keeps every point: a tuning that was killed continues where it was when it is called again, and gives the same result. With larger `runs` a
        longer tuning uses the points of a shorter one.
    progress
        Show a bar on stderr where that is a terminal.
    executor
        Any `concurrent.futures.Executor` of processes, such as that of a Dask client. It simulates all scenes of a point side by side, and all points that
        the search knows in advance; without it one run follows the other in this process.

    Returns
    -------
    Tuned
        All points that were tried, the best one or the front, and the tuned law.

    Raises
    ------
    SceneError
        If the arguments cannot be tuned, a law or objective cannot be evaluated as given or cannot travel to an executor, or the journal belongs to other
        arguments.
    """
    asked = _scenes(scene, controller, in_si(duration, "s", "duration"))
    scenes = {label: _with_case(each, controller) for label, each in asked.items()}
    chosen = controller if isinstance(controller, str) else "tuned"
    cases = [each.case(chosen) for each in scenes.values()]
    loops = [each[chosen] for each in scenes.values()]
    free = _free(loops[0], bounds)
    for label, loop in zip(scenes, loops, strict=True):
        for first, here in zip(free, _free(loop, bounds), strict=True):
            if here.given != first.given:
                words = f"{plain_number(first.given)} in `{next(iter(scenes))}` and {plain_number(here.given)} in `{label}`"
                raise SceneError(f"Argument `controller` must start from the same `{here.name}` in every scene, but it is {words}.")
    objectives = _objectives(objective, list(scenes.values()))
    if not callable(over):
        raise SceneError(f"Argument `over` must be a function such as `max`, but it is {over!r}.")
    whole("runs", runs, 10)
    whole("seed", seed, 0)
    check_executor(executor)
    kept = None
    if journal is not None:
        kept = Journal(
            journal,
            {
                "scene": fingerprint(asked),
                "controller": fingerprint([case.controller for case in cases]),
                "objective": repr({name: fingerprint(each) for name, each in objectives.items()}),
                "bounds": repr([(each.name, each.low, each.high) for each in free]),
                "seed": str(seed),
            },
            lambda result: is_result(result, len(scenes), len(objectives)),
        )
    search = TuningSearch(list(scenes.values()), chosen, free, objectives, over, runs, kept, executor)
    with _bar(runs, progress) as search.bar:
        search.given()
        with contextlib.suppress(Spent):
            smallest(search, seed) if len(objectives) == 1 else spread(search, seed)
    law = cases[0].law
    label = f"{type(law).__name__} `{controller}`" if isinstance(controller, str) else type(law).__name__
    told = scenes[next(iter(scenes))]
    units = [told.plant().unit(told.effort) if each == "peak" else _UNITS.get(str(each), "") for each in objectives.values()]
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
        {**told.asked, **{each.unit: asked_in((each.low, each.high), each.unit) for each in reversed(free)}},
    )


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


def numbers_of_law(loop: ClosedLoop) -> dict[str, tuple[float | None, Mapping[str, Any]]]:
    """{name: (value, what its field declares)} of every number of the law of a loop, and of those that `design` would fill in.

    A number that acts in the loop has its name there, such as `pi.integral` of a `StiffPI`; one that only the design knows that of the class.
    """
    if not loop.laws:
        raise SceneError("Argument `controller` must name a case with a law, but it has none.")
    law = loop.laws[0].law if isinstance(loop.laws[0], Sampled) else loop.laws[0]
    first = sum(len(numbers_of(part)) for part in loop.plant.parts)
    acting = next((name.partition(".")[0] for name, entry in loop.system.parameters.items() if entry.offset == first), "")
    known = getattr(law, "name", None) or type(law).__name__.lower()
    return {f"{acting if loop.system.has_parameter(f'{acting}.{path}') else known}.{path}": entry for path, entry in _numbers(law, "")}


def unit_of(loop: ClosedLoop, name: str) -> str:
    """Unit of a number of the law of a loop; raises SceneError where there is no such number, or it belongs to the machine."""
    fields = numbers_of_law(loop)
    if name in fields:
        return str(fields[name][1].get("unit", "1"))
    full = next((each for each in fields if each.partition(".")[2] == name), None)
    if full is not None:
        raise SceneError(f"There is no number `{name}`: a number of a law has its name before it, `{full}`.")
    if name in loop.numbers():
        raise SceneError(f"Argument `bounds` must hold numbers of the law that is tuned, but `{name}` is none: vary it by `sweep`.")
    raise SceneError(f"There is no number `{name}` in this law: {suggest(name, fields)}")


def _free(loop: ClosedLoop, bounds: Any) -> tuple[Free, ...]:
    """The free numbers of the law of a loop, checked."""
    if not isinstance(bounds, Mapping) or not bounds:
        raise SceneError(f"Argument `bounds` must map numbers of the law to (low, high), but it is {bounds!r}.")
    fields = numbers_of_law(loop)
    free = []
    for name, pair in bounds.items():
        unit = unit_of(loop, str(name))
        given, spec = fields[name]
        pair = in_si(pair, unit, f"bounds.{name}")
        if not isinstance(pair, Sequence) or len(pair) != 2 or not all(map(is_finite_number, pair)) or not pair[0] < pair[1]:
            raise SceneError(f"Argument `bounds` of `{name}` must be (low, high) in {unit} with low < high, but it is {pair!r}.")
        for number in pair:
            refuse(f"Argument `bounds` of `{name}`", number, unit, spec)
        low, high = (end if isinstance(end, TypedNumber) else float(end) for end in pair)
        free.append(Free(str(name), unit, low, high, None if given is None else float(given)))
    return tuple(free)


def _numbers(law: Any, path: str) -> list[tuple[str, tuple[float | None, Mapping[str, Any]]]]:
    """(dotted name, (value, what its field declares)) of every number of a law, and of those that `design` would fill in."""
    found: list[tuple[str, tuple[float | None, Mapping[str, Any]]]] = []
    for declared in fields_of(type(law)):
        value, name = getattr(law, declared.name), f"{path}{declared.name}"
        if is_nested(value):
            found += _numbers(value, f"{name}.")
        elif declared.numeric and isinstance(value, tuple):
            found += [(f"{name}.{i}", (number, declared.spec.metadata)) for i, number in enumerate(value)]
        elif declared.numeric and not declared.tuples:
            found.append((name, (value, declared.spec.metadata)))
    return found


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
            if each == "stuck":
                _ = [scene.contact for scene in scenes]  # raises where nothing sticks
            if each in ("settling", "overshoot") and without is not None:
                raise SceneError(
                    f"Argument `objective` must not be {each} where a scene has no `reference`, but `{without.title}` has none."
                )
        elif not callable(each):
            raise SceneError(f"Argument `objective` must be a measure or a function of a run, but it is {each!r}.")
        found[str(name)] = each
    return found


def _bar(runs: int, progress: bool) -> Any:
    form = "{desc} |{bar:30}| {n_fmt}/{total_fmt} points, {elapsed}"
    return progress_bar(runs, "tuning", bar_format=form, wanted=progress)
