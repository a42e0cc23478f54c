"""A scene thousands of times: over grids, lists and random designs, on all cores or a cluster, with nothing lost when it is interrupted.

    found = sweep(plant, {"bit.weight": weights, "top.reference": speeds}, duration=120.0, controller=law, measures=("severity",))
    found["severity"]          array of shape (len(weights), len(speeds))

Everything is checked and compiled once; then only numbers change. Measures are read off the runs in machine code (`toolbox.measuring.measures`), so that no
trajectory is built; a function of the trajectory is taken too, and costs a thousand times more. Many runs of laws in machine code step side by side in the
lanes of a vector (`toolbox.sweeps.batch.pays_in_lanes`), several times as many in a second. Laws in machine code run in threads, for the event loop
releases the interpreter; laws in Python run in processes.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox.arguments import is_finite_number
from toolbox.errors import SceneError, suggest
from toolbox.files.units import NumberOrText, in_si
from toolbox.measuring.measures import STANDARD, Measure
from toolbox.modelling.components import law_of
from toolbox.modelling.free_parameter import FreeParameter
from toolbox.modelling.hybrid_system import HybridSystem, checked_plant
from toolbox.scenes.judged import judged_contact, judged_speed
from toolbox.simulation.methods import Method
from toolbox.simulation.request import Request
from toolbox.simulation.run import UNHURRIED, Budget, Run
from toolbox.sweeps.batch import Call, Task
from toolbox.sweeps.designs import Variations, grid, latin_hypercube, listed, sobol, uniform, variations_of
from toolbox.sweeps.executors import evaluated
from toolbox.sweeps.results import Sweep
from toolbox.sweeps.store import Store
from toolbox.sweeps.variants import run_fingerprint, shared_run, start_states, varied_held, varied_numbers

if TYPE_CHECKING:
    from toolbox.scenes.scene import Scene

__all__ = ["Sweep", "Variations", "grid", "latin_hypercube", "listed", "sobol", "sweep", "uniform"]


def named_measures(given: Any, run: Run, scene: Scene | None) -> dict[str, Measure | Call]:
    """{name: measure} from names, a mapping, or None; raises SceneError for what is none."""
    if given is None:
        given = ("severity", "stuck_ratio")
    if isinstance(given, str):
        given = (given,)
    if not isinstance(given, Mapping):
        if not isinstance(given, Sequence) or not all(isinstance(name, str) for name in given):
            raise SceneError(f"Argument `measures` must be names, or map names to measures, but it is {given!r}.")
        given = {name: name for name in given}
    if not given:
        raise SceneError("Argument `measures` must hold at least one measure, but it is empty.")
    found: dict[str, Measure | Call] = {}
    closed = run.system
    for name, value in given.items():
        if isinstance(value, str):
            if value not in STANDARD:
                raise SceneError(f"There is no measure `{value}`: {suggest(value, STANDARD)}")
            element = judged_contact(closed, scene.element if scene else None, "measures")
            value = STANDARD[value](
                scene.signal if scene else judged_speed(closed, element),
                element,
                scene.after if scene else run.start.time + run.duration / 2,
            )
        if isinstance(value, Measure):
            value.check(closed, run.end)
        elif not callable(value):
            raise SceneError(
                f"Argument `{name}` must be a measure of `toolbox.measuring.measures` or a function of the run, but it is {value!r}."
            )
        found[str(name)] = value
    return found


def sweep(
    machine: HybridSystem | Scene,
    vary: Any,
    duration: NumberOrText | None = None,
    *others: Any,
    controller: Any = None,
    sample_time: NumberOrText | None = None,
    start: Any = None,
    inputs: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    measures: Any = None,
    method: Method | str = "event",
    accuracy: float | None = None,
    budget: Budget = UNHURRIED,
    executor: concurrent.futures.Executor | None = None,
    out: str | Path | None = None,
) -> Sweep:
    """Simulate a machine once for every variation of some numbers, and measure every run.

    Whether the stiff method pays is decided once, on the middle variation. All runs see the same measurement noise.

    Parameters
    ----------
    machine
        A plant, or a scene.
    vary
        What varies: {name: values} for a grid, or rows of {name: value}, in SI or text with units; a pandas table; or one of the designs `latin_hypercube`,
        `sobol` and `uniform` of this module. A name is an input (held constant), a parameter of the plant, or a numeric field of the law, as designed on the
        declared plant (`pi.integral`). What varies wins over `inputs` and `parameters`.
    duration, sample_time, inputs, parameters, method, accuracy
        As in `simulate`.
    controller
        As in `simulate`; of a scene, the label of a case (the first one by default).
    start
        As in `simulate`, or a function {name: value of what varies} -> {state: value}.
    measures
        Names of `toolbox.measuring.measures.STANDARD`, or {name: a measure of that module, or any function of the trajectory}. By default severity and
        stuck ratio of the only contact in the second half of the run, or what the scene judges.
    budget
        What one run may spend, as in `simulate`.
    executor
        Any `concurrent.futures.Executor`, such as that of a Dask client (`client.get_executor()`). By default one thread per core, or one process per core
        where a law is Python and the work is worth it.
    out
        A folder that becomes a zarr store of the results as they come (`toolbox.sweeps.store`; needs the extra `batch`). The same call after an interruption
        continues where it was, `xarray.open_zarr` shows what is there, and `Sweep.load` reads the finished sweep.

    Returns
    -------
    Sweep
        One array per measure; a run that fails is in its `errors`.

    Raises
    ------
    SceneError
        If a name is unknown, a value is out of bounds, a sample time is varied, or `out` holds anything but this sweep.
    OSError
        If the disk is full.
    ImportError
        If `out` is given without the extra `batch`.
    """
    from toolbox.scenes.scene import Scene

    if others or is_finite_number(machine):
        raise SceneError(
            "`sweep` varies the numbers of a machine, `sweep(machine, {name: values}, duration)`, and its other arguments are named; "
            "the swept sine of an input is `toolbox.inputs.sweep`."
        )
    scene, title = None, ""
    if isinstance(machine, Scene):
        scene = machine
        case = scene.case(controller) if controller is not None else scene.cases[0]
        given = scene.arguments(case)
        inputs, parameters = {**given["inputs"], **(inputs or {})}, {**given["parameters"], **(parameters or {})}
        start = given["start"] if start is None else start
        accuracy = scene.accuracy if accuracy is None else accuracy
        duration = scene.duration if duration is None else duration
        plant, law, title = scene.plant(), case.controller, case.label
    else:
        plant, law = checked_plant(machine, "machine"), controller
    duration = in_si(duration, "s", "duration")
    variations = variations_of(_in_si(vary, plant, law, sample_time, inputs))
    if not is_finite_number(duration) or not duration > 0:
        raise SceneError(f"Argument `duration` must be a finite number > 0 s, but it is {duration!r}.")
    begin = start if callable(start) else None
    run = shared_run(
        plant, variations, float(duration), start=None if begin else start, inputs=inputs, parameters=parameters, controller=law, sample_time=sample_time,
        method=method, accuracy=1e-6 if accuracy is None else accuracy, budget=budget,
    )  # fmt: skip
    chosen = named_measures(measures, run, scene)
    taken = next((name for name in chosen if name in {"run", "status", "error", *variations.names} or "/" in name), None)
    if taken is not None:
        raise SceneError(f"Argument `measures` must use names that are free, without a slash, but one is `{taken}`.")
    numbers, broken = varied_numbers(run, variations)
    starts = None if begin is None else start_states(run, variations, begin)
    task = Task(run, numbers, tuple(chosen.values()), starts, held=varied_held(run, variations))
    units = tuple(FreeParameter.of(run.system, name).unit for name in variations.names)
    sheet = Sweep(
        title=title or ", ".join(type(law_of(part)).__name__ for part in run.system.parts),
        names=variations.names,
        units=units,
        points=variations.points,
        shape=variations.shape,
        axes=variations.axes,
        measures={},
        measure_units={name: measure.unit(run.system) if isinstance(measure, Measure) else "1" for name, measure in chosen.items()},
        duration=run.duration,
        accuracy=run.accuracy,
        asked={**run.asked, **{unit: variations.asked.get(name, unit) for name, unit in zip(variations.names, units, strict=True)}},
    )
    store = None if out is None else Store(out, sheet, run_fingerprint(task, variations, tuple(chosen)))
    values, errors, seconds = evaluated(task, broken, executor, store)
    found = {name: values[:, k].reshape(variations.shape) for k, name in enumerate(chosen)}
    return dataclasses.replace(sheet, measures=found, errors=errors, seconds=seconds)


def _in_si(vary: Any, plant: HybridSystem, law: Any, sample_time: Any, inputs: Mapping[str, Any] | None) -> Any:
    """What varies, with text in the unit of its input or parameter as numbers; all else is left to `variations_of`."""
    rows = (
        [vary]
        if isinstance(vary, Mapping)
        else vary
        if isinstance(vary, (list, tuple)) and all(isinstance(row, Mapping) for row in vary)
        else []
    )
    typed = {
        name
        for row in rows
        for name, given in row.items()
        if any(isinstance(v, str) for v in (given if isinstance(given, (list, tuple)) else [given]))
    }
    if not typed:
        return vary
    closed = Request(plant, 1.0, controller=law, sample_time=sample_time).checked().system
    units = {name: FreeParameter.of(closed, name).unit for name in typed}
    made = [{name: in_si(given, units[name], name) if name in typed else given for name, given in row.items()} for row in rows]
    return made[0] if isinstance(vary, Mapping) else made
