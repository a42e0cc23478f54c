"""Maps of stick-slip over two numbers: how severe it is, from smooth running and from inside stick-slip, with the borders between.

At every point of a grid two runs begin at the steady state: one with the judged contact slowed by a hundredth, one with it stopped at once, as by a stuck
bit. The first asks whether smooth running survives a disturbance, the second whether stick-slip that has begun goes on. Where the answer changes between
neighbours, the edge between them is halved until the border is known to a part of a cell. The third border, that of the linearised
machine, is where the largest real part of its poles changes sign.

Why both branches: a machine in the band between their borders runs smoothly until something disturbs it, and then sticks and slips for ever.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import json
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from toolbox.errors import SceneError, suggest
from toolbox.files.archives import arrays, understood
from toolbox.files.atomic import replaced
from toolbox.measuring import measures as tally
from toolbox.modelling.components import law_of
from toolbox.modelling.elements import is_finite_number
from toolbox.modelling.free_parameter import Knob, continuous_loop
from toolbox.modelling.hybrid_system import HybridSystem, checked_plant
from toolbox.modelling.laws import Sampled
from toolbox.onsets.borders import Edges, edges_of
from toolbox.onsets.onset import judged_contact, judged_speed
from toolbox.simulation.simulate import Run
from toolbox.steady_states.linear import (
    closed_signal,
    equilibrium,
    function_of,
    holding_elements,
    input_values,
    mode_numbers,
    residual_functions,
    state_labels,
)
from toolbox.sweeps.batch import Task
from toolbox.sweeps.designs import Variations, grid
from toolbox.sweeps.executors import evaluated
from toolbox.sweeps.results import Sweep
from toolbox.sweeps.store import Store, folder_of
from toolbox.sweeps.variants import run_fingerprint, varied_numbers, varied_run

if TYPE_CHECKING:
    from toolbox.scenes.scene import Scene

SMOOTH, SWING, STICK_SLIP, STUCK, NONE = 0, 1, 2, 3, -1
VERDICTS = {SMOOTH: "smooth", SWING: "swing", STICK_SLIP: "stick-slip", STUCK: "stuck", NONE: "none"}
"""Verdicts of a run: the disturbance dies; it grows or lasts without stick; stick phases come back until the end; rest for good; no steady state, or
failed."""

SLOWED = 0.01
"""Part of its slip that the judged contact loses at once on the smooth branch."""

LINEAR_HALVINGS = 40


@dataclass(frozen=True)
class Branch:
    """One branch of a map, arrays of the shape of the map: severity of the judged signal, part of the time in stick, verdict (a key of `VERDICTS`)."""

    severity: np.ndarray
    stuck_ratio: np.ndarray
    verdict: np.ndarray


@dataclass(frozen=True)
class SeverityMap:
    """A map over two numbers: `print(found)`, `found.plot()`, `found.smooth.severity`.

    names, units, axes: what is varied, along the rows and columns of all arrays;  smooth, sticking: both branches;  growth: largest real part of the poles of
    steady running [1/s], nan without one;  borders: {"linear", "smooth", "sticking": segments, shape (k, 2, 2): segment, end, (first, second number)};
    resolution: of the simulated borders, in parts of a cell;  errors: {(branch, i, j): why a run failed};  runs, seconds: what it took.
    """

    title: str
    names: tuple[str, str]
    units: tuple[str, str]
    axes: tuple[np.ndarray, np.ndarray]
    element: str
    signal: str
    smooth: Branch
    sticking: Branch
    growth: np.ndarray
    borders: dict[str, np.ndarray]
    duration: float
    after: float
    accuracy: float
    resolution: float
    runs: int
    seconds: float = 0.0
    errors: dict[tuple[str, int, int], str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def regions(self) -> dict[str, np.ndarray]:
        """{"free", "bistable", "stick-slip", "swing", "none": where, a boolean array}: what the machine does, both branches taken together."""
        sticks = np.isin(self.sticking.verdict, (STICK_SLIP, STUCK))
        calm, none = self.smooth.verdict == SMOOTH, (self.smooth.verdict == NONE) | (self.sticking.verdict == NONE)
        return {
            "free": calm & ~sticks & ~none, "bistable": calm & sticks, "stick-slip": ~calm & (sticks | (self.smooth.verdict >= STICK_SLIP)) & ~none,
            "swing": (self.smooth.verdict == SWING) & ~sticks & ~none, "none": none,
        }  # fmt: skip

    def __str__(self) -> str:
        size = self.smooth.verdict.size
        lines = [
            f"Severity map of {self.title}: `{self.signal}`, contact `{self.element}`",
            *(
                f"  {name} from {axis[0]:g} to {axis[-1]:g} {'' if unit == '1' else unit}".rstrip() + f", {axis.size} values"
                for name, unit, axis in zip(self.names, self.units, self.axes, strict=True)
            ),
            f"  {self.runs} runs of {self.duration:g} s, judged from {self.after:g} s, at accuracy {self.accuracy:g}, in {self.seconds:.3g} s",
            "",
            "  share of the map",
        ]
        words = {
            "free": "a disturbance dies, and stick-slip that has begun ends",
            "bistable": "smooth until disturbed, then stick-slip for ever",
            "stick-slip": "the least disturbance grows into it",
            "swing": "the least disturbance grows, without stick",
            "none": "no steady running, or a run that failed",
        }
        lines += [
            f"    {name:<11}{100 * where.sum() / size:5.1f} %   {words[name]}"
            for name, where in self.regions.items()
            if where.any() or name == "free"
        ]
        lines += ["", f"  border                         {self.names[0]:>30}   {self.names[1]:>30}"]
        titles = {"linear": "poles on the imaginary axis", "smooth": "smooth running is lost", "sticking": "existing stick-slip ends"}
        for name, segments in self.borders.items():
            if not len(segments):
                lines.append(f"    {titles[name]:<28} not in the map")
                continue
            ranges = [f"{segments[..., k].min():.5g} .. {segments[..., k].max():.5g} {self.units[k]}" for k in range(2)]
            lines.append(f"    {titles[name]:<28} {ranges[0]:>29}   {ranges[1]:>30}")
        lines += [f"  note: {note}" for note in self.notes]
        if self.errors:
            lines.append(f"  {len(self.errors)} runs failed")
            for (branch, i, j), text in list(self.errors.items())[:3]:
                lines.append(f"    {branch}, {self.axes[0][i]:.5g}, {self.axes[1][j]:.5g}: {text}")
        return "\n".join(lines)

    __repr__ = __str__

    def border(self, name: str, along: float) -> np.ndarray:
        """Where a border crosses a value of the second number: values of the first one, in increasing order.

        name: "linear", "smooth" or "sticking". Raises SceneError for another name.
        """
        if name not in self.borders:
            raise SceneError(f"There is no border `{name}`: {suggest(name, self.borders)}")
        (x0, y0), (x1, y1) = (self.borders[name][:, k].T for k in range(2))
        crossing = ((y0 - along) * (y1 - along) <= 0) & (y0 != y1)
        with np.errstate(divide="ignore", invalid="ignore"):
            x = x0 + (along - y0) / (y1 - y0) * (x1 - x0)
        return np.unique(x[crossing])

    def plot(self, axes: Any = None) -> Any:
        """Both branches side by side with all borders; see `toolbox.onsets.figures.severity_panels`."""
        from toolbox.onsets.figures import severity_panels

        return severity_panels(self, axes)

    def save(self, path: str | Path) -> Path:
        """Write everything to an npz file without pickle, whole or not at all.

        Keys: `map` (JSON: names, units, errors and numbers), `axis.0`, `axis.1` in SI, `smooth.severity`, ..., `growth`, `border.linear`, ...
        """
        notes = {
            name: getattr(self, name)
            for name in (
                "title",
                "names",
                "units",
                "element",
                "signal",
                "duration",
                "after",
                "accuracy",
                "resolution",
                "runs",
                "seconds",
                "notes",
            )
        }
        notes["errors"] = [[*key, text] for key, text in self.errors.items()]
        written: dict[str, np.ndarray] = {"map": np.array(json.dumps(notes)), "growth": self.growth}
        written |= {f"axis.{k}": axis for k, axis in enumerate(self.axes)}
        for branch in ("smooth", "sticking"):
            written |= {f"{branch}.{name}": value for name, value in vars(getattr(self, branch)).items()}
        written |= {f"border.{name}": segments for name, segments in self.borders.items()}
        with replaced(Path(path)) as file:
            np.savez_compressed(file, **written)  # type: ignore[arg-type]
        return Path(path)

    @staticmethod
    def load(path: str | Path) -> SeverityMap:
        """What `save` wrote. Raises SceneError for anything else."""
        what = "a severity map written by `SeverityMap.save`"
        with understood(Path(path), what):
            data = arrays(Path(path), what)
            notes = json.loads(str(data["map"]))
            branches = {
                branch: Branch(**{each.name: data[f"{branch}.{each.name}"] for each in dataclasses.fields(Branch)})
                for branch in ("smooth", "sticking")
            }
            borders = {name: data[f"border.{name}"] for name in ("linear", "smooth", "sticking")}
            errors = {(branch, i, j): text for branch, i, j, text in notes.pop("errors")}
            for name in ("names", "units", "notes"):
                notes[name] = tuple(notes[name])
            return SeverityMap(axes=(data["axis.0"], data["axis.1"]), growth=data["growth"], borders=borders, errors=errors, **{**branches, **notes})


def severity_map(
    machine: HybridSystem | Scene,
    over: Mapping[str, tuple[float, float]],
    *,
    shape: tuple[int, int] = (50, 50),
    duration: float | None = None,
    after: float | None = None,
    controller: Any = None,
    sample_time: float | None = None,
    inputs: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    mode: Mapping[str, str] | None = None,
    guess: Mapping[str, Any] | None = None,
    element: str | None = None,
    signal: str | None = None,
    accuracy: float | None = None,
    halvings: int = 3,
    executor: concurrent.futures.Executor | None = None,
    out: str | Path | None = None,
) -> SeverityMap:
    """Severity of stick-slip over two inputs or parameters, from smooth running and from inside stick-slip, with the linear and both simulated borders.

    machine: a plant, or a scene whose controller is named by `controller` (its first one without).  over: {name: (low, high)}, two of them; the first gives
    the rows of all arrays.  shape: of the grid.  duration, after: of a run, and from when on it is judged [s]; those of the scene, or 120 s and half of it.
    controller, sample_time, inputs, parameters: as in `simulate`, inputs as numbers; a sampled law also needs its continuous form, for the
    steady state.  mode, guess: of the steady state in the middle of the map, as in `onset`.  element, signal: the contact and the speed to judge.
    halvings: how often an edge across a border is halved.  executor, out: as in `sweep`; an interrupted map goes on where it was.

    Stick-slip means stick phases that come back until the last quarter of the judged time. A cycle that takes longer than the run to die counts as
    alive: compare with a longer `duration` near the end of stick-slip. Raises SceneError for unknown names and ranges that are none, and where there is no
    steady running in the middle of the map.
    """
    began = clock.perf_counter()
    loop = _Loop.of(machine, over, duration, after, controller, sample_time, inputs, parameters, mode, guess, element, signal, accuracy)
    if not isinstance(shape, Sequence) or len(shape) != 2 or not all(isinstance(n, int) and n >= 2 for n in shape):
        raise SceneError(f"Argument `shape` must be two integers >= 2, but it is {shape!r}.")
    if isinstance(halvings, bool) or not isinstance(halvings, int) or not 0 <= halvings <= 20:
        raise SceneError(f"Argument `halvings` must be an integer from 0 to 20, but it is {halvings!r}.")
    axes = tuple(np.linspace(*over[name], n) for name, n in zip(loop.names, shape, strict=True))
    points = grid(dict(zip(loop.names, axes, strict=True))).points
    stages = iter(range(1000))
    count = 0
    failures: dict[int, str] = {}

    def judged(points: np.ndarray, stopped: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        nonlocal count, failures
        path = None if out is None else Path(out) / f"stage_{next(stages):02d}.zarr"
        severity, ratio, verdict, failures = loop.judged(points, stopped, executor, path)
        count += len(points)
        return severity, ratio, verdict

    if out is not None:
        folder_of(Path(out))
    both = np.repeat([False, True], len(points))
    columns = judged(np.vstack([points, points]), both)
    first = failures
    branches = [Branch(*(column[part].reshape(shape) for column in columns)) for part in (slice(0, len(points)), slice(len(points), None))]
    growth = loop.growth(points).reshape(shape)
    names = ("smooth", "sticking")
    bad = [branches[0].verdict != SMOOTH, np.isin(branches[1].verdict, (STICK_SLIP, STUCK))]
    edges = [edges_of(axes, where, branch.verdict != NONE) for where, branch in zip(bad, branches, strict=True)]

    def decide(points: np.ndarray, owner: np.ndarray) -> np.ndarray:
        """Whether smooth running is lost (owner 0), or stick-slip lasts (owner 1)."""
        _, _, verdict = judged(points, owner == 1)
        return np.where(owner == 1, np.isin(verdict, (STICK_SLIP, STUCK)), verdict != SMOOTH)

    together = Edges.joined(edges)
    places = together.halved(decide, halvings)
    at = np.cumsum([0, *(len(each.low) for each in edges)])
    borders = {name: edges[k].segments(places[at[k] : at[k + 1]]) for k, name in enumerate(names)}
    linear = edges_of(axes, growth > 0, np.isfinite(growth))
    borders = {"linear": linear.segments(linear.halved(lambda points, _: loop.growth(points) > 0, LINEAR_HALVINGS)), **borders}
    found = SeverityMap(
        title=loop.title, names=loop.names, units=loop.units, axes=axes, element=loop.element, signal=loop.signal, smooth=branches[0], sticking=branches[1],  # type: ignore[arg-type]
        growth=growth, borders=borders, duration=loop.run.duration, after=loop.after, accuracy=loop.run.accuracy, resolution=0.5**halvings, runs=count,
        seconds=clock.perf_counter() - began, notes=tuple(loop.notes),
        errors={(names[i // len(points)], *map(int, np.unravel_index(i % len(points), shape))): text for i, text in first.items()},  # type: ignore[misc]
    )  # fmt: skip
    if out is not None:
        found.save(Path(out) / "map.npz")
    return found


# --------------------------------------------------------------------------------------------------------------------------------------- the runs
@dataclass
class _Loop:
    """The closed loop of a map: as it runs, and in its continuous form with its steady states."""

    title: str
    names: tuple[str, str]
    units: tuple[str, str]
    run: Run
    closed: HybridSystem
    element: str
    signal: str
    after: float
    inputs: dict[str, float]
    modes: np.ndarray
    middle: np.ndarray
    rest: np.ndarray
    notes: list[str]

    @staticmethod
    def of(
        machine: Any, over: Any, duration: Any, after: Any, controller: Any, sample_time: Any, inputs: Any, parameters: Any, mode: Any, guess: Any,
        element: Any, signal: Any, accuracy: Any,
    ) -> _Loop:  # fmt: skip
        from toolbox.scenes.scene import Scene

        title = ""
        if isinstance(machine, Scene):
            scene = machine
            case = scene.case(controller) if controller is not None else scene.cases[0]
            given = scene.arguments(case)
            inputs, parameters = {**given["inputs"], **(inputs or {})}, {**given["parameters"], **(parameters or {})}
            plant, law, title = scene.plant(), case.controller, case.label
            element, signal = element or scene.element, signal or scene.signal
            duration = scene.duration if duration is None else duration
            after = scene.after if after is None and scene.after < duration else after
            accuracy = scene.accuracy if accuracy is None else accuracy
        else:
            plant, law = checked_plant(machine, "machine"), controller
        duration = 120.0 if duration is None else duration
        if not is_finite_number(duration) or not duration > 0:
            raise SceneError(f"Argument `duration` must be a finite number > 0 s, but it is {duration!r}.")
        after = duration / 2 if after is None else after
        if not is_finite_number(after) or not 0 < after < duration:
            raise SceneError(f"Argument `after` must be > 0 s and before the end at {duration:g} s, but it is {after!r}.")
        if not isinstance(over, Mapping) or len(over) != 2:
            raise SceneError(f"Argument `over` must map two names to (low, high), but it is {over!r}.")
        for name, ends in over.items():
            if not (isinstance(ends, (tuple, list)) and len(ends) == 2 and all(map(is_finite_number, ends)) and ends[0] < ends[1]):
                raise SceneError(f"Argument `{name}` must be a range (low, high) with low < high, but it is {ends!r}.")
        names: tuple[str, str] = tuple(over)
        fixed = {name: value for name, value in (inputs or {}).items() if name not in names}
        moving = next((name for name, value in fixed.items() if not is_finite_number(value)), None)
        if moving is not None:
            raise SceneError(f"Argument `{moving}` must be a number for a steady state to exist, but it varies in time.")
        own = {name: value for name, value in (parameters or {}).items() if name not in names}
        middle = np.array([(low + high) / 2 for low, high in over.values()])
        run = varied_run(
            plant, Variations(names, middle[None, :], (1,)), float(duration), inputs=fixed, parameters=own, controller=law, sample_time=sample_time,
            accuracy=1e-6 if accuracy is None else accuracy,
        )  # fmt: skip
        laws = law if isinstance(law, (list, tuple)) or law is None else [law]
        closed = continuous_loop(plant, laws, inputs=fixed, parameters=own)
        knobs = [Knob.of(closed, name) for name in names]
        here = {k.name: float(v) for k, v in zip(knobs, middle, strict=True) if k.is_input}
        there = {k.name: float(v) for k, v in zip(knobs, middle, strict=True) if not k.is_input}
        rest = equilibrium(closed, inputs={**fixed, **here}, parameters=there or None, mode=mode, start=guess)
        contact = judged_contact(closed, element)
        m = mode_numbers(closed, rest.modes)
        if m[[e.name for e in closed.elements].index(contact)] == 0.0:
            raise SceneError(f"The contact `{contact}` must slip in the steady state in the middle of the map, but it sticks.")
        speed = signal or judged_speed(closed, contact)
        closed.signal_unit(speed)  # an unknown signal is refused here
        notes = []
        if sample_time is not None or any(isinstance(each, Sampled) for each in laws or []):
            notes.append("the linear border is that of the continuous form of the law; the others are of the law as it runs, sampled")
        return _Loop(
            title=title or ", ".join(type(law_of(part)).__name__ for part in run.system.parts), names=names,
            units=(knobs[0].unit, knobs[1].unit), run=run, closed=closed, element=contact, signal=speed, after=float(after),
            inputs=fixed, modes=m, middle=middle, rest=rest.states, notes=notes,
        )  # fmt: skip

    def _numbers(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters and inputs of the continuous form at all points, one column each."""
        values = np.repeat(self.closed.values[:, None], len(points), axis=1)
        knobs = [Knob.of(self.closed, name) for name in self.names]
        for knob, column in zip(knobs, points.T, strict=True):
            if not knob.is_input:
                values[self.closed._parameter(knob.name).offset] = column
        u = np.array(self.closed.input_defaults(values)).reshape(-1, len(points))
        names = list(self.closed.inputs)
        if self.inputs:
            input_values(self.closed, self.inputs)  # raises for unknown names
        for name, value in self.inputs.items():
            u[names.index(name)] = value
        for knob, column in zip(knobs, points.T, strict=True):
            if knob.is_input:
                u[names.index(knob.name)] = column
        return values, u

    def steady(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States of steady running at all points, shape (n, points), and where it was found: Newton's method, for all points at once.

        From the middle of the map to each point in steps; contacts must slide the way they do in the middle.
        """
        residual, slopes = residual_functions(self.closed)
        size, n = len(points), self.rest.size
        sticking = (self.modes == 0.0) & holding_elements(self.closed)
        m = np.repeat(self.modes[:, None], size, axis=1)
        x = np.repeat(self.rest[:, None], size, axis=1)
        step = np.zeros_like(x)
        for part in (0.2, 0.4, 0.6, 0.8, 1.0):
            values, u = self._numbers(self.middle + part * (points - self.middle))
            for _ in range(12 if part == 1.0 else 4):
                flow, slip = (np.array(v) for v in residual(0.0, x, u, values, m))
                of_flow, of_slip = (np.array(v).reshape(-1, size, n).transpose(1, 0, 2) for v in slopes(0.0, x, u, values, m))
                rows = np.concatenate([flow, slip[sticking]]).T[:, :, None]
                matrix = np.concatenate([of_flow, of_slip[:, sticking]], axis=1)
                good = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(rows).all(axis=(1, 2))
                step = np.full_like(x, np.nan)
                step[:, good] = -(np.linalg.pinv(matrix[good], rcond=1e-13) @ rows[good])[:, :, 0].T
                x = x + step
                if not (np.abs(step).max(axis=0) > 1e-13 * np.abs(x).max(axis=0)).any():  # nan where there is none
                    break
        scale = np.abs(x).max(axis=0) + 1e-300
        slips = np.array(residual(0.0, x, u, values, m)[1])
        sliding = np.array([e.law is not None for e in self.closed.elements]) & (self.modes != 0.0)
        found = np.isfinite(x).all(axis=0) & (np.abs(step).max(axis=0) <= 1e-8 * scale) & (slips[sliding] * m[sliding] > 0).all(axis=0)
        return np.where(found, x, self.rest[:, None]), found

    def growth(self, points: np.ndarray) -> np.ndarray:
        """Largest real part of the poles of steady running at all points [1/s], but for those at zero; nan without steady running."""
        x, found = self.steady(points)
        values, u = self._numbers(points)
        _, slopes = residual_functions(self.closed)
        a = np.array(slopes(0.0, x, u, values, np.repeat(self.modes[:, None], len(points), axis=1))[0])
        poles = np.linalg.eigvals(a.reshape(x.shape[0], len(points), x.shape[0]).transpose(1, 0, 2))
        size = np.abs(poles).max(axis=1, keepdims=True)
        real = np.where(np.abs(poles) > 1e-9 * size, poles.real, -np.inf).max(axis=1)
        return np.where(found, real, np.nan)

    def judged(
        self, points: np.ndarray, stopped: np.ndarray, executor: Any, path: Path | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[int, str]]:
        """(severity, part of the time in stick, verdict) of a run from every point, and failures; stopped: on which branch each is."""
        end = self.run.duration
        early = end / 8
        measures = {
            "severity": tally.severity(self.signal, self.after), "stuck_ratio": tally.stuck_ratio(self.element, self.after),
            "last_stick": tally.last_stay(self.element), "early_minimum": tally.minimum(self.signal, 0.0, early),
            "early_maximum": tally.maximum(self.signal, 0.0, early), "minimum": tally.minimum(self.signal, self.after),
            "maximum": tally.maximum(self.signal, self.after),
        }  # fmt: skip
        variations = Variations(self.names, points, (len(points),))
        numbers, broken = varied_numbers(self.run, variations)
        x, found = self.steady(points)
        values, u = self._numbers(points)
        broken = {**broken, **{int(i): "There is no steady running." for i in np.flatnonzero(~found)}}
        task = Task(self.run, numbers, tuple(measures.values()), *self._begins(x, u, values, stopped))
        store = None
        if path is not None:
            sheet = Sweep(
                self.title, self.names, self.units, points, variations.shape, (), {}, {name: each.unit(self.run.system) for name, each in
                measures.items()}, duration=end, accuracy=self.run.accuracy,
            )  # fmt: skip
            store = Store(path, sheet, run_fingerprint(task, variations, tuple(measures)))
        result, errors, _ = evaluated(task, broken, executor, store, label="map")
        severity, ratio, last, low0, high0, low, high = result.T
        with np.errstate(invalid="ignore"):
            sticks = (last > end - 0.25 * (end - self.after)) & (ratio > max(10 * self.run.accuracy, 1e-9))
            grows = (high - low > high0 - low0) & (high - low > 10 * self.run.accuracy * np.maximum(np.abs(high), np.abs(low)))
        verdict = np.where(sticks, np.where(ratio > 1 - 1e-9, STUCK, STICK_SLIP), np.where(grows, SWING, SMOOTH))
        return severity, ratio, np.where(np.isfinite(low), verdict, NONE), errors

    def _begins(self, x: np.ndarray, u: np.ndarray, values: np.ndarray, stopped: np.ndarray) -> tuple[Any, Any, Any]:
        """(starts, memories, held signals) of runs from steady states with the judged contact slowed or stopped."""
        closed, system, size = self.closed, self.run.system, x.shape[1]
        m = np.repeat(self.modes[:, None], size, axis=1)
        stuck = m.copy()
        stuck[[e.name for e in closed.elements].index(self.element)] = 0.0
        halt = closed.function("projected", closed.switching.projected, "stopped")
        at_rest = np.array(halt(0.0, x, u, values, stuck)).reshape(x.shape)
        begin = x + np.where(stopped, 1.0, SLOWED) * (at_rest - x)
        labels = [name for name, _ in state_labels(closed)]
        starts = np.stack([begin[labels.index(name)] for name, _ in state_labels(system)], axis=1)
        if not system.updates:
            return starts, None, None
        memories, held = [], np.zeros((size, system.held.numel()))
        for update in system.updates:
            for i in range(update.memory.numel()):
                name = update.memory[i].name()
                if name not in labels:
                    note = f"the memory {name} of a sampled law is no state of its continuous form, and begins at zero"
                    self.notes += [note] if note not in self.notes else []
                memories.append(x[labels.index(name)] if name in labels else np.zeros(size))
            memories += [np.zeros(size)] * len(update.channels)
            for i, name in enumerate(update.names):
                function = function_of(closed, ("signal", name), lambda name=name: [closed_signal(closed, name)])  # type: ignore[misc]
                held[:, update.first_held + i] = np.array(function(0.0, x, u, values, m)).ravel()
        return starts, np.stack(memories, axis=1) if memories else np.zeros((size, 0)), held
