"""Maps of stick-slip over two numbers: how severe it is, from smooth running and from inside stick-slip, with the borders between.

At every point of a grid two runs begin at the steady state: one with the judged contact slowed a little, one with it stopped at once, as by a stuck
bit. The first asks how large the disturbance of smooth running grows; whether it grows is told by the poles of the linearised machine, of which the largest
real part changes its sign on the border. The second asks whether stick-slip that has begun goes on; where that start dies beside points where it does not, the
cycle of those points is led on to it (`toolbox.onsets.front`), and where that ends the edge between neighbours is halved until the border is known to
a part of a cell. A sampled law grows otherwise than its continuous form: there the run tells, and both borders of smooth running are given.

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
from typing import Any

import numpy as np

from toolbox.arguments import BoolArray, FloatArray, whole
from toolbox.errors import SceneError, suggest
from toolbox.files.archives import Shape, arrays, check_notes, check_shapes, understood
from toolbox.files.atomic import replaced
from toolbox.files.printing import table
from toolbox.files.unit_systems import Reading, reading
from toolbox.files.units import NumberOrText
from toolbox.messages import progress_bar
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.onsets.borders import edges_of
from toolbox.onsets.front import Front, Point
from toolbox.onsets.map_loop import NONE, SMOOTH, STICK_SLIP, STUCK, SWING, MapLoop
from toolbox.onsets.regions import MEANINGS
from toolbox.sweeps.designs import grid
from toolbox.sweeps.store import folder_of

LINEAR_HALVINGS = 40


@dataclass(frozen=True)
class MapSide:
    """One branch of a map; every array has the shape of the map.

    Attributes
    ----------
    severity
        Severity of the judged signal [1].
    stuck_ratio
        Part of the judged time in stick [1].
    verdict
        What the machine does, as a number of `toolbox.onsets.map_loop` (`SMOOTH`, `SWING`, `STICK_SLIP`, `STUCK`, or `NONE` for a run that failed).
    """

    severity: FloatArray
    stuck_ratio: FloatArray
    verdict: np.ndarray


@dataclass(frozen=True)
class SeverityMap:
    """A map of stick-slip over two numbers, as `severity_map` returns it: `print(found)`, `found.plot()`, `found.smooth.severity`.

    Attributes
    ----------
    title
        What was mapped.
    names, units, axes
        What is varied, along the rows and the columns of all arrays.
    element, signal
        The contact and the speed that were judged.
    smooth, sticking
        The two branches (`MapSide`): from smooth running, and from inside stick-slip.
    growth
        Largest real part of the poles of steady running [1/s]; nan where there is no steady running.
    borders
        Segments of the borders "linear", "smooth" and "sticking", each of shape (k, 2, 2): segment, end, (first, second number). Segments follow one another
        along each line.
    duration, after, accuracy
        Length of a run, the time from which on it is judged [s], and its accuracy.
    resolution
        Resolution of the simulated borders, in parts of a cell.
    errors
        Why a run failed: {(branch, i, j): message}.
    runs, seconds
        Number of runs and time that they took [s].
    notes
        What the reader of the map should know.
    asked
        {unit: unit that was typed}: the units in which report and figure answer.
    """

    title: str
    names: tuple[str, str]
    units: tuple[str, str]
    axes: tuple[FloatArray, FloatArray]
    element: str
    signal: str
    smooth: MapSide
    sticking: MapSide
    growth: FloatArray
    borders: dict[str, FloatArray]
    duration: float
    after: float
    accuracy: float
    resolution: float
    runs: int
    seconds: float = 0.0
    errors: dict[tuple[str, int, int], str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    asked: Mapping[str, str] = field(default_factory=dict)

    @property
    def regions(self) -> dict[str, BoolArray]:
        """What the machine does on both branches, as boolean arrays under "free", "bistable", "smooth or stuck", "stick-slip", "swing", "stuck" and "none"."""
        sticks, stands = self.sticking.verdict == STICK_SLIP, self.sticking.verdict == STUCK
        calm, none = self.smooth.verdict == SMOOTH, (self.smooth.verdict == NONE) | (self.sticking.verdict == NONE)
        sticks = sticks | (self.smooth.verdict == STICK_SLIP)
        stands = ~sticks & (stands | (self.smooth.verdict == STUCK))
        return {
            "free": calm & ~sticks & ~stands & ~none, "bistable": calm & sticks & ~none, "smooth or stuck": calm & stands & ~none,
            "stick-slip": ~calm & sticks & ~none, "swing": ~calm & ~sticks & ~stands & ~none, "stuck": ~calm & stands & ~none, "none": none,
        }  # fmt: skip

    @property
    def _read(self) -> list[Reading]:
        """How numbers along both axes are read."""
        return [reading(unit, self.asked) for unit in self.units]

    def __str__(self) -> str:
        read = self._read
        lines = [
            f"Severity map of {self.title}: `{self.signal}`, contact `{self.element}`",
            *(
                f"  {name} from {axis[0] * each.factor:.6g} to {axis[-1] * each.factor:.6g}{each.tail}, {axis.size} values"
                for name, each, axis in zip(self.names, read, self.axes, strict=True)
            ),
            f"  {self.runs} runs of {self.duration:g} s, judged from {self.after:g} s, at accuracy {self.accuracy:g}, in {self.seconds:.3g} s",
            "",
            "  share of the map",
        ]
        lines += [f"    {name:<16}{share:>5} %   {meaning}" for name, share, meaning in self._share_rows()]
        lines += ["", f"  border                         {self.names[0]:>30}   {self.names[1]:>30}"]
        lines += [f"    {name:<28} {first:>29}   {second:>30}".rstrip() for name, first, second in self._border_rows()]
        lines += [f"  note: {note}" for note in self.notes]
        if self.errors:
            lines.append(f"  {len(self.errors)} runs failed")
            for (branch, i, j), text in list(self.errors.items())[:3]:
                lines.append(f"    {branch}, {self.axes[0][i] * read[0].factor:.5g}, {self.axes[1][j] * read[1].factor:.5g}: {text}")
        return "\n".join(lines)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        shares = table(f"Severity map of {self.title}", ("region", "share of the map [%]", "what the machine does"), self._share_rows())
        read = self._read
        ranges = [
            f"{name} from {axis[0] * each.factor:.6g} to {axis[-1] * each.factor:.6g}{each.tail}"
            for name, each, axis in zip(self.names, read, self.axes, strict=True)
        ]
        notes = [f"{', '.join(ranges)}; {self.runs} runs of {self.duration:g} s, {len(self.errors)} failed", *self.notes]
        return shares + table("Borders", ("border", *self.names), self._border_rows(), notes)

    def _share_rows(self) -> list[tuple[str, str, str]]:
        """(region, part of the map [%], meaning) of the regions that there are, and of the free one."""
        found = self.regions.items()
        return [(name, f"{100 * where.mean():.1f}", MEANINGS[name]) for name, where in found if where.any() or name == "free"]

    def _border_rows(self) -> list[tuple[str, str, str]]:
        """(border, range of the first number, range of the second)."""
        titles = {"linear": "poles on the imaginary axis", "smooth": "smooth running is lost", "sticking": "existing stick-slip ends"}
        rows = []
        for name, segments in self.borders.items():
            ranges = ["not in the map", ""]
            for k, (factor, unit) in enumerate(self._read) if len(segments) else ():
                ranges[k] = f"{segments[..., k].min() * factor:.5g} .. {segments[..., k].max() * factor:.5g} {unit}"
            rows.append((titles[name], ranges[0], ranges[1]))
        return rows

    def border(self, name: str, along: float) -> FloatArray:
        """Return where a border crosses a value of the second number: values of the first one, in increasing order.

        Parameters
        ----------
        name
            "linear", "smooth" or "sticking".
        along
            The value of the second number.

        Raises
        ------
        SceneError
            If there is no border of that name.
        """
        if name not in self.borders:
            raise SceneError(f"There is no border `{name}`: {suggest(name, self.borders)}")
        (x0, y0), (x1, y1) = (self.borders[name][:, k].T for k in range(2))
        crossing = ((y0 - along) * (y1 - along) <= 0) & (y0 != y1)
        with np.errstate(divide="ignore", invalid="ignore"):
            x = x0 + (along - y0) / (y1 - y0) * (x1 - x0)
        return np.unique(x[crossing])

    def plot(self, axes: Any = None) -> Any:
        """Draw both branches side by side with all borders; see `toolbox.onsets.figures.severity_panels`."""
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
                "asked",
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
        """Read a map that `save` wrote. Raises SceneError for any other file."""
        what = "a severity map written by `SeverityMap.save`"
        with understood(Path(path), what):
            data = arrays(Path(path), what)
            notes = json.loads(str(data["map"]))
            branches = {
                branch: MapSide(**{each.name: data[f"{branch}.{each.name}"] for each in dataclasses.fields(MapSide)})
                for branch in ("smooth", "sticking")
            }
            borders = {name: data[f"border.{name}"] for name in ("linear", "smooth", "sticking")}
            errors = {(branch, i, j): text for branch, i, j, text in notes.pop("errors")}
            for name in ("names", "units", "notes"):
                notes[name] = tuple(notes[name])
            found = SeverityMap(
                axes=(data["axis.0"], data["axis.1"]), growth=data["growth"], borders=borders, errors=errors, **{**branches, **notes}
            )
            found._check(data)
            return found

    def _check(self, data: Mapping[str, np.ndarray]) -> None:
        """Raise ValueError where what was read, from these arrays, does not fit together."""
        texts = {
            "title": "text",
            "element": "text",
            "signal": "text",
            "names": "texts",
            "units": "texts",
            "notes": "texts",
            "asked": "by name",
        }
        check_notes(self, texts | dict.fromkeys(("duration", "after", "accuracy", "resolution", "runs", "seconds"), "number"))
        shapes: dict[str, Shape] = {"axis.0": ("f", "rows"), "axis.1": ("f", "columns"), "growth": ("f", "rows", "columns")}
        for branch in ("smooth", "sticking"):
            shapes |= {f"{branch}.{name}": ("i" if name == "verdict" else "f", "rows", "columns") for name in vars(self.smooth)}
        shapes |= {f"border.{name}": ("f", f"segments of {name}", 2, 2) for name in self.borders}
        check_shapes(data, shapes)
        rows, columns = self.growth.shape
        inside = (branch in ("smooth", "sticking") and 0 <= i < rows and 0 <= j < columns for branch, i, j in self.errors)
        if (
            (len(self.names), len(self.units)) != (2, 2)
            or not all(inside)
            or not all(isinstance(text, str) for text in self.errors.values())
        ):
            raise ValueError("its notes do not fit to its arrays")


@takes_loop
def severity_map(
    loop: ClosedLoop,
    over: Mapping[str, tuple[NumberOrText, NumberOrText]],
    *,
    shape: tuple[int, int] = (50, 50),
    duration: NumberOrText | None = None,
    after: NumberOrText | None = None,
    mode: Mapping[str, str] | None = None,
    guess: Mapping[str, Any] | None = None,
    halvings: int = 3,
    executor: concurrent.futures.Executor | None = None,
    out: str | Path | None = None,
) -> SeverityMap:
    """Map the severity of stick-slip over two inputs or parameters, from smooth running and from inside stick-slip.

    The map shows both branches of the machine, the border of linear stability and both simulated borders. Stick-slip means stick phases that come back until
    the last quarter of the judged time. A cycle that takes longer than the run to die counts as alive: compare with a longer `duration` near the end of
    stick-slip.

    Parameters
    ----------
    loop
        A loop with constant inputs, or a plant. A sampled law also needs its continuous form, for the steady state.
    over
        The two ranges {name: (low, high)}, in SI or text with units; the first name gives the rows of all arrays.
    shape
        Number of points of the grid along both axes.
    duration, after
        Length of a run, and the time from which on it is judged [s]; by default those of the scene, or 120 s and half of it.
    mode, guess
        Modes of the steady state in the middle of the map and values near it, as in `onset`.
    halvings
        How often an edge of the grid across a border is halved, from 0 to 20.
    executor, out
        As in `sweep`; a map that was interrupted continues where it was.

    Returns
    -------
    SeverityMap
        Severity and verdict on both branches, and the borders.

    Raises
    ------
    SceneError
        If a name is unknown, a range is none, or there is no steady running in the middle of the map.
    """
    began = clock.perf_counter()
    mapped = MapLoop.of(loop, over, duration, after, mode, guess)
    if not isinstance(shape, Sequence) or len(shape) != 2 or not all(isinstance(n, int) and n >= 2 for n in shape):
        raise SceneError(f"Argument `shape` must be two integers >= 2, but it is {shape!r}.")
    whole("halvings", halvings, 0, 20)
    axes = tuple(np.linspace(*ends, n) for ends, n in zip(mapped.ranges, shape, strict=True))
    points = grid(dict(zip(mapped.names, axes, strict=True))).points
    stages = iter(range(1000))
    count = 0
    failures: dict[int, str] = {}

    def verdicts_of(points: np.ndarray, stopped: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        nonlocal count, failures
        path = None if out is None else Path(out) / f"stage_{next(stages):02d}.zarr"
        severity, ratio, verdict, failures = mapped.verdicts(points, stopped, executor, path)
        count += len(points)
        return severity, ratio, verdict

    if out is not None:
        folder_of(Path(out))
    both = np.repeat([False, True], len(points))
    columns = verdicts_of(np.vstack([points, points]), both)
    first = failures
    growth = mapped.growth(points)
    front = Front(mapped, points, shape)
    smooth, inside = ([column[part] for column in columns] for part in (slice(0, len(points)), slice(len(points), None)))
    verdicts = inside[2].copy()
    with progress_bar(None, "map, near borders") as front.bar:
        _changed(inside, front.spread(verdicts))
        inside[2] = verdicts
        with np.errstate(invalid="ignore"):
            grows = (smooth[2] == SWING) | ((smooth[2] == STICK_SLIP) & (smooth[0] < 0.8 * inside[0]))
        _changed(smooth, front.settled(np.flatnonzero(grows)))
    branches = [MapSide(*(column.reshape(shape) for column in branch)) for branch in (smooth, inside)]
    growth = growth.reshape(shape)
    names = ("smooth", "sticking")
    bad = [branches[0].verdict != SMOOTH, branches[1].verdict == STICK_SLIP]
    edges = [edges_of(axes, where, branch.verdict != NONE) for where, branch in zip(bad, branches, strict=True)]

    def lost(points: np.ndarray) -> np.ndarray:
        """Whether smooth running is lost."""
        return mapped.growth(points) > 0 if not mapped.sampled else verdicts_of(points, np.zeros(len(points), bool))[2] != SMOOTH

    with progress_bar(None, "map, borders") as front.bar:
        halved = (edges[0].halved(lost, halvings if mapped.sampled else LINEAR_HALVINGS), front.halved(edges[1], halvings))
    borders = {name: each.segments(place) for name, each, place in zip(names, edges, halved, strict=True)}
    linear = edges_of(axes, growth > 0, np.isfinite(growth))
    borders = {"linear": linear.segments(linear.halved(lambda points: mapped.growth(points) > 0, LINEAR_HALVINGS)), **borders}
    places = {i: (names[i // len(points)], *map(int, np.unravel_index(i % len(points), shape))) for i in first}
    found = SeverityMap(
        title=mapped.title,
        names=mapped.names,
        units=mapped.units,
        axes=axes,  # type: ignore[arg-type]
        element=mapped.element,
        signal=mapped.signal,
        smooth=branches[0],
        sticking=branches[1],
        growth=growth,
        borders=borders,
        duration=mapped.run.duration,
        after=mapped.after,
        accuracy=mapped.run.accuracy,
        resolution=0.5**halvings,
        runs=count + front.runs,
        seconds=clock.perf_counter() - began,
        notes=tuple(mapped.notes),
        asked=mapped.asked,
        errors={places[i]: text for i, text in first.items()},  # type: ignore[misc]
    )
    if out is not None:
        found.save(Path(out) / "map.npz")
    return found


def _changed(columns: list[np.ndarray], points: Mapping[int, Point]) -> None:
    """Put what longer runs found into the columns (severity, part of the time in stick, verdict) of a branch."""
    for k, point in points.items():
        for column, value in zip(columns, (point.severity, point.ratio, point.verdict), strict=True):
            column[k] = value
