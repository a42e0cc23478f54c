"""A loop thousands of times: over grids, lists and random designs, on all cores or a cluster, with nothing lost when it is interrupted.

    found = sweep(closed_loop(rig, law), {"bit.weight": weights, "top.reference": speeds}, 120.0, metrics=("severity",))
    found["severity"]          array of shape (len(weights), len(speeds))

Everything is checked and compiled once; then only numbers change. Measures are read off the runs in machine code (`toolbox.measuring.readings`), so that no
trajectory is built; those without such a form, and functions of a run, cost a thousand times more. Many runs of laws in machine code step side by side in the
lanes of a vector (`toolbox.sweeps.batch.pays_in_lanes`), several times as many in a second. Laws in machine code run in threads, for the event loop
releases the interpreter; laws in Python run in processes.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from toolbox.arguments import is_finite_number, number
from toolbox.errors import SceneError
from toolbox.files.units import NumberOrText, in_si
from toolbox.measuring.metrics import Metric
from toolbox.modelling.closed_loop import ClosedLoop, as_loop, refuse_former
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.scenes.judged import judged_measures
from toolbox.simulation.methods import Method
from toolbox.simulation.request import accuracy_of
from toolbox.sweeps.batch import Task
from toolbox.sweeps.designs import Variations, variations_of
from toolbox.sweeps.executors import evaluated
from toolbox.sweeps.results import Sweep
from toolbox.sweeps.store import Store
from toolbox.sweeps.variants import (
    run_fingerprint,
    shared_run,
    start_memories,
    start_states,
    varied_clocks,
    varied_held,
    varied_numbers,
    with_kept,
)


def sweep(
    loop: ClosedLoop | HybridSystem,
    ranges: Any,
    duration: NumberOrText | None = None,
    *former_positional: Any,
    start: Callable[[Mapping[str, float]], Mapping[str, Any]] | None = None,
    metrics: Any = ("severity", "stuck_ratio"),
    method: Method | str = "event",
    accuracy: float | None = None,
    executor: concurrent.futures.Executor | None = None,
    checkpoint: str | Path | None = None,
    **former_names: Any,
) -> Sweep:
    """Simulate a loop once for every combination of given values of some of its numbers, and measure every run.

    - All runs see the same measurement noise.
    - If a number is used only by the design of a controller, the controller is designed again for every value. All
      other numbers are changed where they act, and designed gains stay.
    - The kind of steps, implicit for a stiff plant and otherwise explicit, is chosen once for all runs: by the run in
      the middle of the list of runs.

    Parameters
    ----------
    loop
        A loop, or a plant.
    ranges
        {name: values} for a grid, or a list of {name: value}, one for each run, in SI or text with units. Or a pandas
        table, or one of the designs of experiments `latin_hypercube`, `sobol` and `uniform` of `toolbox.sweeps`. A name
        is a parameter, an input or a start value of the loop (the keys of `loop.variable_numbers()`), but no sample
        time and no number of a table. An input that is varied is constant during a run.
    duration
        Length of a run [s], or text with a unit. By default the duration of the scene, for a loop from a scene.
    start
        A function that gets the values {name: value} of a run and returns its start values {state, memory of a sampled
        controller, or held command: start value}. These start values override the start values of the loop. By default
        None: all runs start with the start values of the loop.
    metrics
        A name such as "severity" (a key of `toolbox.measuring.metrics.METRICS`), a metric of this module, a function of
        the run, or several as a sequence or {name: metric}. By default "severity" and "stuck_ratio". Metrics are
        computed for the contact `element` and the speed `signal` of the loop, from the time `after` of the loop on, or
        in the second half of the run if the loop has no `after`. The metrics "settling" and "overshoot" and functions
        are computed run after run, which takes longer than the metrics that are computed in machine code.
    method
        A method or its name: "event" (default), "taylor", "explicit", "stiff", "time-stepping" or "smoothed".
        `simulate` describes them. The `budget` of a method limits the cost of each single run.
    accuracy
        Target for the global error, between 1e-13 and 0.1. By default the accuracy of the scene, else 1e-6.
    executor
        Any `concurrent.futures.Executor`, such as the executor of a Dask client (`client.get_executor()`). By default
        one thread per core. If a controller is written in Python, one process per core if this saves time.
    checkpoint
        Path of a folder in which every result is stored as soon as it is computed, by default None. The folder is a
        zarr store (`toolbox.sweeps.store`; needs the extra `batch`). After an interruption the same call continues the
        sweep. `xarray.open_zarr` shows the results so far, and `Sweep.load` reads the finished sweep.

    Returns
    -------
    Sweep
        One array per metric. A run that fails is listed in its `failures`.

    Raises
    ------
    SceneError
        If a name is unknown, a value is out of bounds, a sample time or an entry of a table is varied, or `checkpoint`
        belongs to a different sweep.
    OSError
        If the disk is full.
    ImportError
        If `checkpoint` is given without the extra `batch`.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, sweep
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm"))
    >>> found = sweep(loop, {"top.reference": ["60 rpm", "80 rpm", "100 rpm"]}, "120 s", metrics=["severity", "stuck"])
    >>> print(found["severity"].round(2), found["stuck"].round(1))
    [0. 0. 0.] [0. 0. 0.]
    """
    if former_positional or is_finite_number(loop):
        raise SceneError(
            "`sweep` varies the numbers of a machine, `sweep(loop, {name: values}, duration)`, and its other arguments are named; "
            "the swept sine of an input is `toolbox.inputs.sweep`."
        )
    if "budget" in former_names:
        raise SceneError("`sweep` takes the budget of a run as an option of its method: write `sweep(..., method=EventExact(budget=...))`.")
    refuse_former("sweep", loop, former_names)
    loop = as_loop(loop)
    if start is not None and not callable(start):
        raise SceneError(
            "Argument `start` must be a function of what varies; start values belong to the loop: `closed_loop(plant, start=...)`."
        )
    if duration is None and loop.duration is None:
        raise SceneError('Argument `duration` must be given for a loop that does not come from a scene, such as "60 s".')
    duration = number("duration", loop.duration if duration is None else duration, "s", above=0)
    variations = variations_of(_in_si(ranges, loop))
    full = {name: loop.number(name).name for name in variations.names}
    asked = {full[name]: unit for name, unit in variations.display_units.items()}
    variations = dataclasses.replace(variations, names=tuple(full.values()), display_units=asked)
    accuracy = accuracy_of(loop, accuracy)
    task, broken, chosen = task_of(loop, variations, float(duration), start=start, metrics=metrics, method=method, accuracy=accuracy)
    run = task.run
    taken = next((name for name in chosen if name in {"run", "status", "error", *variations.names} or "/" in name), None)
    if taken is not None:
        raise SceneError(f"Argument `metrics` must use names that are free, without a slash, but one is `{taken}`.")
    units = tuple(run.loop.number(name).unit for name in variations.names)
    sheet = Sweep(
        title=loop.title,
        names=variations.names,
        units=units,
        points=variations.points,
        shape=variations.shape,
        axes=variations.axes,
        metrics={},
        metric_units={name: measure.unit_in(run.system) for name, measure in chosen.items()},
        duration=run.duration,
        accuracy=run.accuracy,
        display_units={
            **run.display_units,
            **{unit: variations.display_units.get(name, unit) for name, unit in zip(variations.names, units, strict=True)},
        },
    )
    store = None if checkpoint is None else Store(checkpoint, sheet, run_fingerprint(task, variations, tuple(chosen)))
    values, errors, seconds = evaluated(task, broken, executor, store)
    found = {name: values[:, k].reshape(variations.shape) for k, name in enumerate(chosen)}
    return dataclasses.replace(sheet, metrics=found, failures=errors, seconds=seconds)


def task_of(
    loop: ClosedLoop,
    variations: Variations,
    duration: float,
    *,
    start: Callable[[Mapping[str, float]], Mapping[str, Any]] | None,
    metrics: Any,
    method: Method | str = "event",
    accuracy: float,
) -> tuple[Task, dict[int, str], dict[str, Metric]]:
    """Return the runs of a sweep, the reasons of runs with contradictory numbers, and the metrics of each run. The arguments are those of
    `sweep`."""
    run = shared_run(loop, variations, duration, method=method, accuracy=accuracy)
    chosen = judged_measures(metrics, run.loop, run.start.time, run.end)
    numbers, broken = varied_numbers(run, variations)
    states = start_states(run, variations, start)
    memories, held = with_kept(run, variations, start, start_memories(run, variations), varied_held(run, variations))
    return Task(run, numbers, tuple(chosen.values()), states, memories, held, clocks=varied_clocks(run, variations)), broken, chosen


def _in_si(vary: Any, loop: ClosedLoop) -> Any:
    """What varies, with text in the unit of its number as numbers; all else is left to `variations_of`."""
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
    units = {name: loop.number(name).unit for name in typed}
    made = [{name: in_si(given, units[name], name) if name in typed else given for name, given in row.items()} for row in rows]
    return made[0] if isinstance(vary, Mapping) else made
