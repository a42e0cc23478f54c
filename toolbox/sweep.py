"""A scene thousands of times: over grids, lists and random designs, on all cores or a cluster, with nothing lost when it is interrupted.

    found = sweep(plant, {"bit.weight": weights, "top.reference": speeds}, duration=120.0, controller=law, measures=("severity",))
    found["severity"]          array of shape (len(weights), len(speeds))

Everything is checked and compiled once; then only numbers change. Measures are read off the runs in machine code (`toolbox.tally`), so that no
trajectory is built; a function of the trajectory is taken too, and costs a thousand times more. Many runs without sampled laws step side by side in the
lanes of a vector (`toolbox.batch.pays_in_lanes`), several times as many in a second. Laws in machine code run in threads, for the event loop
releases the interpreter; laws in Python run in processes.
"""

from __future__ import annotations

import concurrent.futures
import concurrent.futures.process
import dataclasses
import hashlib
import json
import math
import multiprocessing
import os
import pickle
import time as clock
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toolbox import tally
from toolbox.batch import FEWEST_LANES, Call, Outcome, Task, finished, numbers_of_run, pays_in_lanes, single, slots
from toolbox.closed_loop import Held
from toolbox.elements import FrictionLaw, finite_array, is_finite_number
from toolbox.errors import SceneError, SimulationError, suggest
from toolbox.files import replaced
from toolbox.hybrid import HybridSystem
from toolbox.inputs import Table
from toolbox.knob import Knob
from toolbox.onset import judged_contact, judged_speed
from toolbox.parts import Component, checked, fields_of, is_nested, law_of, numbers_of, rebuilt, structure_of
from toolbox.simulate import Run, carry_out, checked_run
from toolbox.tally import Measure
from toolbox.trajectory import Trajectory
from toolbox.work_arrays import place_start

if TYPE_CHECKING:
    from toolbox.scene import Scene

WORK = 0.5
"""Seconds of work in one chunk, about."""

START = 5.0
"""Seconds of work below which processes for laws in Python are not worth starting."""


# -------------------------------------------------------------------------------------------------------------------------------- what is varied
@dataclass(frozen=True)
class Variations:
    """Values of several numbers, one row per run: `grid`, `listed`, `uniform`, `latin_hypercube` or `sobol` make them.

    points: shape (runs, names);  shape: of the results, the lengths of the axes for a grid, else (runs,);  axes: values along each axis of a grid.
    """

    names: tuple[str, ...]
    points: np.ndarray
    shape: tuple[int, ...]
    axes: tuple[np.ndarray, ...] = ()


def grid(axes: Mapping[str, Any]) -> Variations:
    """Every combination of the values of all names; the first name varies slowest. Raises SceneError for values that are no rows of numbers."""
    values = []
    for name, row in axes.items():
        array = finite_array(row)
        if array is None or array.ndim != 1 or not array.size:
            raise SceneError(f"Argument `{name}` must be a row of finite numbers, but it is {row!r}.")
        values.append(array)
    if not values:
        raise SceneError("Argument `vary` must name at least one number, but it is empty.")
    mesh = np.meshgrid(*values, indexing="ij")
    return Variations(tuple(axes), np.stack([each.ravel() for each in mesh], axis=1), mesh[0].shape, tuple(values))


def listed(rows: Any) -> Variations:
    """One run per row: a sequence of {name: value}, all with the same names, or a table with named columns (pandas)."""
    if hasattr(rows, "to_dict") and hasattr(rows, "columns"):
        rows = rows.to_dict("records")
    rows = list(rows)
    if not rows or not all(isinstance(row, Mapping) and row.keys() == rows[0].keys() and row for row in rows):
        raise SceneError("Argument `vary` must be rows that all give numbers to the same names, but it is not.")
    names = tuple(rows[0])
    points = finite_array([[row[name] for name in names] for row in rows])
    if points is None or points.ndim != 2:
        raise SceneError("Argument `vary` must hold finite numbers only, but it does not.")
    return Variations(names, points, (len(rows),))


def uniform(bounds: Mapping[str, tuple[float, float]], runs: int, seed: int = 0) -> Variations:
    """Independent uniform random numbers between the bounds of each name."""
    return _scaled(bounds, runs, np.random.default_rng(seed).random((_count(runs), len(bounds))))


def latin_hypercube(bounds: Mapping[str, tuple[float, float]], runs: int, seed: int = 0) -> Variations:
    """A Latin hypercube (scipy.stats.qmc): each of `runs` equal parts of each range is met once."""
    from scipy.stats import qmc

    return _scaled(bounds, runs, qmc.LatinHypercube(max(len(bounds), 1), rng=seed).random(_count(runs)))


def sobol(bounds: Mapping[str, tuple[float, float]], runs: int, seed: int = 0) -> Variations:
    """A scrambled Sobol sequence (scipy.stats.qmc); its balance needs a power of two as number of runs."""
    from scipy.stats import qmc

    if _count(runs) & (runs - 1):
        raise SceneError(f"Argument `runs` must be a power of two for a Sobol sequence, but it is {runs}.")
    return _scaled(bounds, runs, qmc.Sobol(max(len(bounds), 1), rng=seed).random(runs))


def _count(runs: int) -> int:
    if isinstance(runs, bool) or not isinstance(runs, int) or runs < 1:
        raise SceneError(f"Argument `runs` must be an integer >= 1, but it is {runs!r}.")
    return runs


def _scaled(bounds: Mapping[str, tuple[float, float]], runs: int, unit: np.ndarray) -> Variations:
    if not bounds:
        raise SceneError("Argument `bounds` must name at least one number, but it is empty.")
    for name, pair in bounds.items():
        if not (isinstance(pair, (tuple, list)) and len(pair) == 2 and all(map(is_finite_number, pair)) and pair[0] < pair[1]):
            raise SceneError(f"Argument `{name}` must be bounds (low, high) with low < high, but it is {pair!r}.")
    low, high = np.array(list(bounds.values()), float).T
    return Variations(tuple(bounds), low + (high - low) * unit, (runs,))


def _variations(vary: Any) -> Variations:
    if isinstance(vary, Variations):
        return vary
    if isinstance(vary, Mapping):
        return grid(vary)
    if isinstance(vary, str) or not isinstance(vary, Iterable):
        raise SceneError(f"Argument `vary` must map names to values, or be rows or `Variations`, but it is {vary!r}.")
    return listed(vary)


# ----------------------------------------------------------------------------------------------------------------------------------- the result
@dataclass(frozen=True)
class Sweep:
    """What a sweep found: `found["severity"]`, an array of its shape; nan where a run failed, and why in `errors`.

    names, units: what was varied;  points: shape (runs, names);  shape, axes: as of `Variations`;  measures: {name: array of shape `shape`};
    measure_units: their units;  errors: {index of the run: why it failed};  seconds: wall time, of the runs that were not there already.
    """

    title: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    points: np.ndarray
    shape: tuple[int, ...]
    axes: tuple[np.ndarray, ...]
    measures: dict[str, np.ndarray]
    measure_units: dict[str, str]
    errors: dict[int, str] = field(default_factory=dict)
    duration: float = 0.0
    accuracy: float = 1e-6
    seconds: float = 0.0

    def __getitem__(self, name: str) -> np.ndarray:
        if name in self.measures:
            return self.measures[name]
        if name in self.names:
            return self.points[:, self.names.index(name)].reshape(self.shape)
        raise SceneError(f"There is no measure `{name}`: {suggest(name, [*self.measures, *self.names])}")

    @property
    def runs(self) -> int:
        """How many."""
        return len(self.points)

    def __str__(self) -> str:
        rate = f" in {self.seconds:.3g} s" if self.seconds else ""
        lines = [f"Sweep of {self.title}: {self.runs} runs of {self.duration:g} s at accuracy {self.accuracy:g}{rate}"]
        kind = " x ".join(str(length) for length in self.shape) + " grid" if self.axes else "list"
        lines.append(f"  over ({kind})")
        width = max(len(name) for name in (*self.names, *self.measures))
        for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            lines.append(
                f"    {name:<{width}}  {self.points[:, k].min():>11.5g} .. {self.points[:, k].max():<11.5g} {'' if unit == '1' else unit}".rstrip()
            )
        lines.append("  found")
        for name, values in self.measures.items():
            flat, unit = values.ravel(), self.measure_units[name]
            known = np.flatnonzero(np.isfinite(flat))
            if not known.size:
                lines.append(f"    {name:<{width}}  no finite value")
                continue
            low, high = known[np.argmin(flat[known])], known[np.argmax(flat[known])]
            rest = f", {flat.size - known.size} not finite" if known.size < flat.size else ""
            shown = "" if unit == "1" else unit
            lines.append(
                f"    {name:<{width}}  {flat[low]:>11.5g} .. {flat[high]:<11.5g} {shown:<8} median {np.median(flat[known]):.5g}; "
                f"largest at {self._place(int(high))}{rest}"
            )
        if self.errors:
            lines.append(f"  {len(self.errors)} of {self.runs} runs failed")
            for index, text in list(self.errors.items())[:5]:
                lines.append(f"    {self._place(index)}: {text}")
            if len(self.errors) > 5:
                lines.append(f"    ... and {len(self.errors) - 5} more in `errors`")
        return "\n".join(lines)

    __repr__ = __str__

    def _place(self, index: int) -> str:
        return ", ".join(f"{name} {value:.5g}" for name, value in zip(self.names, self.points[index], strict=True))

    def to_xarray(self) -> Any:
        """An xarray Dataset with axes as coordinates, units as attributes; needs the extra `batch`."""
        try:
            import xarray
        except ImportError:
            raise ImportError("`to_xarray` needs xarray: pip install 'stickslip-toolbox[batch]'.") from None
        if self.axes:
            dims = self.names
            coordinates = {n: (n, axis, {"units": u}) for n, axis, u in zip(self.names, self.axes, self.units, strict=True)}
        else:
            dims = ("run",)
            coordinates = {n: ("run", self.points[:, k], {"units": u}) for k, (n, u) in enumerate(zip(self.names, self.units, strict=True))}
        data = {name: (dims, values, {"units": self.measure_units[name]}) for name, values in self.measures.items()}
        return xarray.Dataset(data, coordinates, {"sweep": json.dumps(self._notes())})

    def _notes(self) -> dict[str, Any]:
        return {
            "title": self.title, "names": self.names, "units": self.units, "measure_units": self.measure_units, "grid": bool(self.axes),
            "errors": {str(i): text for i, text in self.errors.items()}, "duration": self.duration, "accuracy": self.accuracy, "seconds": self.seconds,
        }  # fmt: skip

    def save(self, path: str | Path) -> Path:
        """Write to `path`, whole or not at all: a folder of zarr where it ends with .zarr (needs the extra `batch`), else npz without pickle.

        Keys of the npz: `sweep` (JSON: names, units, errors), `points`, `axis.<name>` for a grid, and one array per measure. A path that ends with .csv
        gets a table for other programs, one row per run in SI units with its error, which `load` does not read.
        """
        path = Path(path)
        if path.suffix == ".csv":
            self._write_table(path)
            return path
        if path.suffix == ".zarr":
            import shutil
            import tempfile

            shelter = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}."))
            try:
                self.to_xarray().to_zarr(shelter / "new", consolidated=False)
                if path.exists():
                    shutil.rmtree(path)
                os.replace(shelter / "new", path)
            finally:
                shutil.rmtree(shelter, ignore_errors=True)
            return path
        arrays: dict[str, np.ndarray] = {"sweep": np.array(json.dumps(self._notes())), "points": self.points}
        arrays |= {f"axis.{name}": axis for name, axis in zip(self.names, self.axes, strict=False)}
        arrays |= {f"measure.{name}": values for name, values in self.measures.items()}
        with replaced(path) as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
        return path

    def _write_table(self, path: Path) -> None:
        import csv
        import io

        text = io.StringIO()
        table = csv.writer(text, lineterminator="\n")
        units = [*self.units, *self.measure_units.values()]
        table.writerow([*(f"{name} [{unit}]" for name, unit in zip((*self.names, *self.measures), units, strict=True)), "error"])
        columns = [values.ravel() for values in self.measures.values()]
        for i, point in enumerate(self.points):
            values = [*point.tolist(), *(float(column[i]) for column in columns)]
            table.writerow([*("" if value != value else value for value in values), self.errors.get(i, "")])
        with replaced(path) as file:
            file.write(text.getvalue().encode())

    @staticmethod
    def load(path: str | Path) -> Sweep:
        """What `save` wrote, or the folder that a finished sweep left with `out=`. Raises SceneError for anything else."""
        path = Path(path)
        if (path / RESULT).is_file():
            path = path / RESULT
        try:
            if path.suffix == ".zarr":
                import xarray

                with xarray.open_zarr(path, consolidated=False) as data:
                    notes = json.loads(data.attrs["sweep"])
                    axes = tuple(data[name].values for name in notes["names"])
                    measures = {name: data[name].values for name in notes["measure_units"]}
                points = grid(dict(zip(notes["names"], axes, strict=True))).points if notes["grid"] else np.stack(axes, axis=1)
                axes = axes if notes["grid"] else ()
            else:
                with np.load(path, allow_pickle=False) as data:
                    notes = json.loads(str(data["sweep"]))
                    points = data["points"]
                    axes = tuple(data[f"axis.{name}"] for name in notes["names"]) if notes["grid"] else ()
                    measures = {name: data[f"measure.{name}"] for name in notes["measure_units"]}
        except (OSError, KeyError, ValueError) as error:
            raise SceneError(f"There is no sweep in `{path}`: {error}") from None
        return Sweep(
            title=notes["title"], names=tuple(notes["names"]), units=tuple(notes["units"]), points=points,
            shape=tuple(axis.size for axis in axes) or (len(points),), axes=axes, measures=measures, measure_units=notes["measure_units"],
            errors={int(i): text for i, text in notes["errors"].items()}, duration=notes["duration"], accuracy=notes["accuracy"],
            seconds=notes["seconds"],
        )  # fmt: skip


# ---------------------------------------------------------------------------------------------------------------------------------- the measures
STANDARD: Mapping[str, Callable[[str, str, float], Measure]] = {
    "severity": lambda signal, element, after: tally.severity(signal, after),
    "minimum": lambda signal, element, after: tally.minimum(signal, after),
    "maximum": lambda signal, element, after: tally.maximum(signal, after),
    "mean": lambda signal, element, after: tally.mean(signal, after),
    "final": lambda signal, element, after: tally.final(signal),
    "stuck": lambda signal, element, after: tally.time_in(element, "stick", after),
    "stuck_ratio": lambda signal, element, after: tally.stuck_ratio(element, after),
    "sticks": lambda signal, element, after: tally.stays(element, "stick", after),
    "last_stick": lambda signal, element, after: tally.last_stay(element),
    "events": lambda signal, element, after: tally.events(element),
}
"""Measures by name, of the judged signal and element from the judged time on; `last_stick` and `events` of the whole run."""


def named_measures(given: Any, closed: HybridSystem, duration: float, scene: Scene | None) -> dict[str, Measure | Call]:
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
    for name, value in given.items():
        if isinstance(value, str):
            if value not in STANDARD:
                raise SceneError(f"There is no measure `{value}`: {suggest(value, STANDARD)}")
            element = judged_contact(closed, scene.element if scene else None)
            value = STANDARD[value](
                scene.signal if scene else judged_speed(closed, element), element, scene.after if scene else duration / 2
            )
        if isinstance(value, Measure):
            value.check(closed, duration)
        elif not callable(value):
            raise SceneError(f"Argument `{name}` must be a measure of `toolbox.tally` or a function of the run, but it is {value!r}.")
        found[str(name)] = value
    return found


# ------------------------------------------------------------------------------------------------------------------------------------- the verb
def sweep(
    machine: HybridSystem | Scene,
    vary: Any,
    *,
    duration: float | None = None,
    controller: Any = None,
    sample_time: float | None = None,
    start: Any = None,
    inputs: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    measures: Any = None,
    method: str = "event",
    accuracy: float | None = None,
    executor: concurrent.futures.Executor | None = None,
    out: str | Path | None = None,
) -> Sweep:
    """Simulate a machine once for every variation of some numbers, and measure every run.

    machine: a plant, or a scene whose controller is named by `controller` (its first one without).  vary: {name: values} for a grid, rows of {name: value}
    (also a pandas table), or `latin_hypercube`, `sobol`, `uniform` of this module. A name is an input (held constant), a parameter of the plant, or a numeric
    field of the law, as designed on the declared plant (`pi.integral`); what is varied wins over `inputs` and `parameters`.  measures: names of
    `STANDARD`, or {name: a measure of `toolbox.tally`, or any function of the trajectory}; severity and stuck ratio of the first contact in the second half
    of the run without, or what the scene judges.  duration, controller, sample_time, start, inputs, parameters, method, accuracy: as in `simulate`;
    whether the stiff method pays is decided once, on the middle variation. `start` may also be a function {name: value of what is varied} -> {state: value}.
    All runs see the same measurement noise.

    executor: any `concurrent.futures.Executor`, such as that of a Dask client (`client.get_executor()`); without, one thread per core, or one process
    per core where a law is Python and the work is worth it.  out: a folder to which finished chunks are written; the same call after an
    interruption goes on where it was.

    Returns a Sweep; a run that fails is in its `errors`. Raises SceneError for unknown names, values out of bounds, a sample time as a variation, and
    an `out` that holds the sweep of other arguments.
    """
    from toolbox.scene import Scene

    variations = _variations(vary)
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
        if not isinstance(machine, HybridSystem):
            raise SceneError(f"Argument `machine` must be a plant made by `compose` or a Scene, but it is a {type(machine).__name__}.")
        plant, law = machine, controller
    if not is_finite_number(duration) or not duration > 0:  # type: ignore[operator]
        raise SceneError(f"Argument `duration` must be a finite number > 0 s, but it is {duration!r}.")
    begin = start if callable(start) else None
    run = varied_run(
        plant, variations, float(duration), start=None if begin else start, inputs=inputs, parameters=parameters, controller=law, sample_time=sample_time,  # type: ignore[arg-type]
        method=method, accuracy=1e-6 if accuracy is None else accuracy,
    )  # fmt: skip
    chosen = named_measures(measures, run.system, run.duration, scene)
    numbers, broken = varied_numbers(run, variations)
    starts = None if begin is None else _starts(run, variations, begin)
    task = Task(run, numbers, tuple(chosen.values()), starts, held=_stand_ins(run, variations))
    values, errors, seconds = evaluated(task, broken, executor, out, run_fingerprint(task, variations, tuple(chosen)))
    result = Sweep(
        title=title or ", ".join(type(law_of(part)).__name__ for part in run.system.parts),
        names=variations.names,
        units=tuple(Knob.of(run.system, name).unit for name in variations.names),
        points=variations.points,
        shape=variations.shape,
        axes=variations.axes,
        measures={name: values[:, k].reshape(variations.shape) for k, name in enumerate(chosen)},
        measure_units={name: measure.unit(run.system) if isinstance(measure, Measure) else "1" for name, measure in chosen.items()},
        errors=errors,
        duration=run.duration,
        accuracy=run.accuracy,
        seconds=seconds,
    )
    if out is not None:
        result.save(Path(out) / RESULT)
    return result


def varied_run(plant: HybridSystem, variations: Variations, duration: float, **arguments: Any) -> Run:
    """The run that all variations share, with what is varied as inputs given as numbers. Raises SceneError as `simulate` does."""
    arguments["inputs"] = {name: v for name, v in (arguments.get("inputs") or {}).items() if name not in variations.names}
    arguments["parameters"] = {name: v for name, v in (arguments.get("parameters") or {}).items() if name not in variations.names}
    if len(set(variations.names)) < len(variations.names):
        raise SceneError("Argument `vary` must name every number once.")
    closed = checked_run(plant, duration, **arguments).system
    knobs = [Knob.of(closed, name) for name in variations.names]
    middle = variations.points[len(variations.points) // 2].tolist()
    arguments["inputs"] |= {knob.name: value for knob, value in zip(knobs, middle, strict=True) if knob.is_input}
    return checked_run(plant, duration, **arguments)


def varied_numbers(run: Run, variations: Variations) -> tuple[np.ndarray, dict[int, str]]:
    """The numbers of every run, shape (runs, first_held), and {run: why its numbers contradict each other}.

    Raises SceneError for a value out of its bounds, and for the sample time of a law.
    """
    system = run.system
    offset, touched = 0, []
    places = slots(run, variations.names)
    knobs = [Knob.of(system, name) for name in variations.names]
    for part in system.parts:
        size = len(numbers_of(part))
        own = [k for k, place in zip(knobs, places, strict=True) if not k.is_input and offset <= place < offset + size]
        if isinstance(part, Held) and any(place == offset + size - 1 for k, place in zip(knobs, places, strict=True) if not k.is_input):
            raise SceneError(f"Argument `{own[-1].name}` must not be varied: a sample time is structure; make one sweep for each.")
        if own and _has_check(part):
            touched.append((part, offset))
        offset += size
    for k, (knob, column) in enumerate(zip(knobs, variations.points.T, strict=True)):
        entry = system.parameters.get(knob.name) if knob.is_input else system._parameter(knob.name)
        if entry is not None:
            entry.check(np.unique(variations.axes[k] if variations.axes else column))
    numbers = np.repeat(numbers_of_run(run)[None, :], len(variations.points), axis=0)
    numbers[:, places] = variations.points
    broken: dict[int, str] = {}
    for part, first in touched:
        for i, row in enumerate(numbers):
            try:
                checked(rebuilt(part, row, first))
            except SceneError as error:
                broken.setdefault(i, str(error))
    return numbers, broken


def _starts(run: Run, variations: Variations, begin: Callable[[Mapping[str, float]], Mapping[str, Any]]) -> np.ndarray:
    """Start states of every run, shape (runs, states), from a function of what is varied."""
    starts = np.zeros((len(variations.points), run.system.x.numel()))
    for x, point in zip(starts, variations.points.tolist(), strict=True):
        for name, value in begin(dict(zip(variations.names, point, strict=True))).items():
            place_start(run.system, x, name, value)
    return starts


def _has_check(part: Any) -> bool:
    """Whether the fields of a part, or of its laws, can contradict each other."""
    if isinstance(part, Component) and type(part).check is not Component.check:
        return True
    if isinstance(part, FrictionLaw) and type(part).check is not FrictionLaw.check:
        return True
    return any(is_nested(value) and _has_check(value) for value in (getattr(part, f.name) for f in fields_of(type(part))))


def _stand_ins(run: Run, variations: Variations) -> np.ndarray | None:
    """What the signals of late laws have until the first output arrives, where it varies; else None."""
    plant, updates = run.plant, run.system.updates
    names = [name for name in variations.names if name not in run.system.inputs and _owned(plant, name)]
    if not names or not any(delay > 0 for _, delay in run.clocks):
        return None
    held = np.zeros((len(variations.points), run.system.held.numel()))
    for i, point in enumerate(variations.points):
        values = plant.values.copy()
        for name, value in zip(variations.names, point, strict=True):
            if name in names:
                values[plant._parameter(name).offset] = value
        defaults = dict(zip(plant.inputs, np.array(plant.input_defaults(values)).ravel(), strict=True))
        for update, (_, delay) in zip(updates, run.clocks, strict=True):
            if delay > 0:
                held[i, update.first_held : update.first_held + len(update.names)] = [defaults.get(name, 0.0) for name in update.names]
    return held


def _owned(plant: HybridSystem, name: str) -> bool:
    try:
        plant._parameter(name)
    except SceneError:
        return False
    return True


# ----------------------------------------------------------------------------------------------------------------------------- chunks and workers
RESULT, MANIFEST = "sweep.npz", "sweep.json"


def evaluated(
    task: Task,
    broken: Mapping[int, str],
    executor: concurrent.futures.Executor | None = None,
    out: str | Path | None = None,
    fingerprint: Mapping[str, str] | None = None,
    label: str = "sweep",
) -> tuple[np.ndarray, dict[int, str], float]:
    """(measures of all runs, errors, seconds) of a task cut into chunks; `broken` runs are not tried.

    out, fingerprint: a folder for finished chunks, and what it must have been made of to be continued.
    """
    began = clock.perf_counter()
    total = len(task.numbers)
    values = np.full((total, len(task.measures)), np.nan)
    errors = dict(broken)
    chunks: list[tuple[int, int]] | None = None
    cost = math.inf
    done: dict[tuple[int, int], tuple[np.ndarray, dict[int, str]]] = {}
    folder = Path(out) if out is not None else None
    method, lanes = task.run.method, False
    if folder is not None:
        chunks, method, lanes, done = _resumed(folder, fingerprint or {}, method)
    if chunks is None:
        method, lanes, cost = _probed(task)
        workers = os.cpu_count() or 1
        size = max(1, min(int(WORK / cost) if cost > 0 else total, -(-total // (4 * workers))))
        size = min(max(size, FEWEST_LANES), total) if lanes else size
        chunks = [(first, min(first + size, total)) for first in range(0, total, size)]
        if folder is not None:
            _begun(folder, fingerprint or {}, method, lanes, chunks)
    task = dataclasses.replace(task, run=dataclasses.replace(task.run, method=method), lanes=lanes)
    for (first, last), (rows, failed) in done.items():
        values[first:last] = rows
        errors |= failed
    left = [chunk for chunk in chunks if chunk not in done]
    if not left:
        return values, errors, 0.0

    def take(outcome: Outcome) -> None:
        last = outcome.first + len(outcome.values)
        for i in range(outcome.first, last):
            if i in broken:
                outcome.values[i - outcome.first] = np.nan
                outcome.errors[i] = broken[i]
        values[outcome.first : last] = outcome.values
        errors.update(outcome.errors)
        if folder is not None:
            _written(folder, outcome)

    own = executor is None
    pool = executor or _pool(task, cost * total)
    from tqdm import tqdm

    waiting: list[concurrent.futures.Future[Outcome]] = []
    try:
        with tqdm(
            total=total, initial=total - sum(b - a for a, b in left), unit="run", desc=label, delay=1.0, leave=False, disable=None
        ) as bar:
            waiting = [pool.submit(finished, task.part(slice(*chunk))) for chunk in left]
            for future in concurrent.futures.as_completed(waiting):
                outcome = future.result()
                take(outcome)
                bar.update(len(outcome.values))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        if "pickle" not in str(error):
            raise
        raise SceneError(f"Laws and measures that travel to other processes must be importable, but one is not: {error}") from None
    except concurrent.futures.process.BrokenProcessPool:
        raise SceneError(
            'Laws and measures in Python must come from a module or a script whose own work stands under `if __name__ == "__main__":`, because '
            "they travel to other processes; or give an `executor` of threads."
        ) from None
    finally:
        for future in waiting:
            future.cancel()
        if own:
            pool.shutdown(wait=True, cancel_futures=True)
    return values, dict(sorted(errors.items())), clock.perf_counter() - began


def _pool(task: Task, seconds: float) -> concurrent.futures.Executor:
    """Threads for laws in machine code; processes for laws in Python, or one thread where that is done before processes have started."""
    workers = os.cpu_count() or 1
    if not task.run.laws or seconds < START:
        return concurrent.futures.ThreadPoolExecutor(1 if task.run.laws else workers)
    return concurrent.futures.ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))


def _probed(task: Task) -> tuple[str, bool, float]:
    """The method that the middle run asks for, whether runs like it pay in lanes, and the seconds that it takes alone."""
    middle = len(task.numbers) // 2
    method = task.run.method
    if method == "event":
        method = "explicit"
        if not task.run.laws:
            found: Trajectory | None
            try:
                found = carry_out(single(task, middle))
            except SimulationError as failure:
                found = failure.run
            if found is not None and found.run.method == "stiff":
                method = "stiff"
    alone = dataclasses.replace(task, run=dataclasses.replace(task.run, method=method)).part(slice(middle, middle + 1))
    steps = finished(alone).steps  # compiles
    return method, pays_in_lanes(dataclasses.replace(task, run=alone.run), steps), finished(alone).seconds


def folder_of(path: Path) -> None:
    """Make a folder with its parents; raises SceneError where that cannot be."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SceneError(f"Argument `out` must be a folder that can be written, but `{path}` cannot: {error.strerror}.") from None


def _begun(folder: Path, fingerprint: Mapping[str, str], method: str, lanes: bool, chunks: Sequence[tuple[int, int]]) -> None:
    folder_of(folder)
    with replaced(folder / MANIFEST) as file:
        file.write(json.dumps({"arguments": dict(fingerprint), "method": method, "lanes": lanes, "chunks": chunks}).encode())


def _resumed(
    folder: Path, fingerprint: Mapping[str, str], method: str
) -> tuple[list[tuple[int, int]] | None, str, bool, dict[tuple[int, int], tuple[np.ndarray, dict[int, str]]]]:
    """(chunks, method, whether in lanes, finished ones) of a sweep that was begun in this folder; (None, ...) where none was."""
    if not (folder / MANIFEST).is_file():
        if folder.exists() and (not folder.is_dir() or any(not path.name.startswith(f".{MANIFEST}.") for path in folder.iterdir())):
            raise SceneError(f"Argument `out` must be an empty or new folder, or that of a sweep to be continued, but `{folder}` is not.")
        return None, method, False, {}
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        before, chunks = manifest["arguments"], [(int(a), int(b)) for a, b in manifest["chunks"]]
        method, lanes = manifest["method"], bool(manifest["lanes"])
    except (OSError, ValueError, KeyError, TypeError):
        raise SceneError(f"Argument `out` must be the folder of a sweep, but `{folder / MANIFEST}` is damaged.") from None
    other = [word for word in fingerprint if before.get(word) != fingerprint[word]]
    if other:
        raise SceneError(
            f"Argument `out` must be a new folder, or that of the same sweep, but `{folder}` holds one with other {', '.join(f'`{word}`' for word in other)}."
        )
    done = {}
    for chunk in chunks:
        path = _path(folder, chunk[0])
        if path.is_file():
            with np.load(path, allow_pickle=False) as data:
                errors = {int(i): text for i, text in json.loads(str(data["errors"])).items()}
                done[chunk] = (data["values"], errors)
    for path in folder.glob(".runs_*"):  # what was being written when the sweep was killed
        path.unlink(missing_ok=True)
    return chunks, method, lanes, done


def _path(folder: Path, first: int) -> Path:
    return folder / f"runs_{first:08d}.npz"


def _written(folder: Path, outcome: Outcome) -> None:
    with replaced(_path(folder, outcome.first)) as file:
        np.savez(file, values=outcome.values, errors=np.array(json.dumps({str(i): text for i, text in outcome.errors.items()})))


def run_fingerprint(task: Task, variations: Variations, names: Sequence[str]) -> dict[str, str]:
    """What a sweep is made of, argument by argument, as digests; functions by their names, because their text cannot be compared."""
    run = task.run
    measures = [measure if isinstance(measure, Measure) else _name(measure) for measure in task.measures]
    arrays = [array for array in (task.starts, task.memories, task.held) if array is not None]
    content = {
        "machine": [_plain(structure_of(part)) for part in run.system.parts] + [run.system.values.tolist()],
        "controller": [_name(law) for law in run.laws] + [run.clocks, run.seeds],
        "vary": [variations.names, variations.shape, hashlib.sha256(variations.points.tobytes()).hexdigest()],
        "inputs": [(k, _number(v)) for k, v in sorted(run.inputs.items()) if k not in variations.names],
        "start": [
            str({k: np.asarray(v).tolist() for k, v in sorted(run.start.items())}),
            *(hashlib.sha256(a.tobytes()).hexdigest() for a in arrays),
        ],
        "measures": [str(list(zip(names, measures, strict=True)))],
        "duration": [run.duration],
        "accuracy": [run.accuracy],
        "method": [run.method],
    }
    return {word: hashlib.sha256(repr(value).encode()).hexdigest()[:16] for word, value in content.items()}


def _number(value: Any) -> Any:
    """An input as text that tells it from every other."""
    return ("table", value.times.tolist(), value.values.tolist()) if isinstance(value, Table) else str(value)


def _name(thing: Any) -> str:
    kind = thing if hasattr(thing, "__qualname__") else type(thing)
    return f"{kind.__module__}.{kind.__qualname__}"


def _plain(key: Any) -> Any:
    """A structure with its classes by name, equal in every process."""
    if isinstance(key, tuple):
        return tuple(map(_plain, key))
    return _name(key) if isinstance(key, type) else key if isinstance(key, (str, int, float, bool, type(None))) else _name(key)
