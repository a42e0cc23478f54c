"""Maps of stick-slip over two numbers: how severe it is, from smooth running and from inside stick-slip, with the borders between.

At every point of a grid two questions are asked. How does a small disturbance of smooth running go on: where it grows, a run tells what it becomes. And what
becomes of a machine whose judged contact is stopped at once, as by a stuck bit; where that start dies beside points where stick-slip lasts, the cycle of
those points is led on to it (`toolbox.onsets.front`). Smooth running is lost where the growth changes its sign; where stick-slip ends, the edge between
neighbours is halved until the border is known to a part of a cell.

Why both branches: a machine in the band between their borders runs smoothly until something disturbs it, and then sticks and slips for ever.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import dataclasses
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.arguments import BoolArray, FloatArray, number, whole
from toolbox.errors import SceneError, SimulationError, suggest
from toolbox.files import tables
from toolbox.files.archives import Shape, check_shapes
from toolbox.files.journal import Journal
from toolbox.files.printing import Rows, Told
from toolbox.files.results import HeadedRows, Result
from toolbox.files.tables import heading
from toolbox.files.unit_systems import Reading, asked_in, reading, typed
from toolbox.files.units import NumberOrText
from toolbox.measuring import judge
from toolbox.measuring.judge import Judged
from toolbox.messages import progress_bar
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.onsets.borders import Edges, coordinates, edges_of, lines_of
from toolbox.onsets.carried import JudgedRuns, is_run
from toolbox.onsets.front import Front
from toolbox.onsets.map_loop import NONE, SMOOTH, STICK_SLIP, STUCK, VERDICTS, Plane, map_runs, steady_plane
from toolbox.onsets.regions import MEANINGS
from toolbox.scenes.situation import Situation
from toolbox.sweeps.designs import grid
from toolbox.sweeps.executors import check_executor
from toolbox.sweeps.store import folder_of
from toolbox.sweeps.variants import fingerprints

BORDERS = {"smooth": "smooth running is lost", "sticking": "existing stick-slip ends"}
"""{border: what happens there}."""

EXACT = 1e-12
"""Precision of the border of smooth running by poles, in parts of a cell."""

EXACT_BELOW = 1e-9
"""Error of a point of a border, as a fraction of its value, below which it is printed as 0."""


@dataclass(frozen=True)
class MapSide:
    """One branch of a map; every array has the shape of the map.

    Attributes
    ----------
    severity
        Severity of the judged signal [1].
    interval
        Time after which the same stick or swing comes back [s]; nan where nothing does.
    verdict
        What the machine does, as a number of `toolbox.onsets.map_loop` (`SMOOTH`, `SWING`, `STICK_SLIP`, `STUCK`, or `NONE` where there is no steady running,
        a run failed, or nothing decided it).
    """

    severity: FloatArray
    interval: FloatArray
    verdict: np.ndarray


@dataclass(frozen=True)
class SeverityMap(Told, Result):
    """Map of stick-slip over two numbers, the result of `severity_map`: `print(found)`, `found.plot()`, `found.smooth.severity`.

    Attributes
    ----------
    title
        Name of the loop.
    names, units, axes
        Names, units and values of the two numbers. The first number varies along the rows of all arrays, the second
        along the columns.
    element, signal
        The contact and the speed that were judged.
    smooth, sticking
        The two branches (`MapSide`): from smooth running, and from stick-slip.
    growth
        Growth rate of a small disturbance of smooth running in the running loop [1/s]. nan if it is not known.
    borders
        Segments of the borders "smooth" and "sticking", each of shape (k, 2, 2): segment, end, (first, second number).
        The segments of a line are in order.
    duration, accuracy
        Longest time for which a run was continued until its regime was decided [s], and accuracy of the runs.
    border_errors
        Half the width of the interval in which each end of a segment lies, for both numbers, in SI: {border: array of
        the shape of its segments}. The interval lies along one line of the grid, so one of the two numbers is 0.
    resolution
        Resolution of borders that come from runs, as a fraction of a cell. If `growth` is known, the border "smooth"
        lies at its change of sign, and this resolution does not apply.
    logarithmic
        Whether the values of the first and of the second number are spaced by their logarithm.
    failures
        Reasons why runs failed: {(branch, i, j): message}.
    runs
        Number of runs.
    nominal_point
        Values of both numbers in the loop that was mapped, in SI: the operating point, if it lies in the map.
    situation
        The situation for which the verdict holds, in one line.
    notes
        Notes for the reader of the map.
    display_units
        {SI unit: unit that was typed}: the units of report and figure.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, severity_map
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm"))
    >>> found = severity_map(loop, {"top.reference": (4.0, 12.0), "bit.weight": (60e3, 100e3)}, shape=(3, 3), halvings=0)
    >>> print(found.runs > 9, found.sticking.severity.shape)
    True (3, 3)
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
    accuracy: float
    resolution: float
    runs: int
    failures: dict[tuple[str, int, int], str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    nominal_point: tuple[float, float] = (math.nan, math.nan)
    display_units: Mapping[str, str] = field(default_factory=dict)
    situation: str = ""
    logarithmic: tuple[bool, bool] = (False, False)
    border_errors: dict[str, FloatArray] = field(default_factory=dict)

    @property
    def regions(self) -> dict[str, BoolArray]:
        """Behaviour of the machine on both branches, as {behaviour: whether each point of the grid has it, shape of the grid}.

        The behaviours are "free", "bistable", "smooth or stuck", "stick-slip", "swing", "stuck" and "none".
        """
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
        return [reading(unit, self.display_units) for unit in self.units]

    def _told(self) -> list[str | Rows]:
        read = self._read
        failed = [f"  {len(self.failures)} runs failed"] if self.failures else []
        for (branch, i, j), text in list(self.failures.items())[:3]:
            failed.append(f"    {branch}, {self.axes[0][i] * read[0].factor:.5g}, {self.axes[1][j] * read[1].factor:.5g}: {text}")
        return [
            f"Severity map of {self.title}: `{self.signal}`, contact `{self.element}`",
            *(
                f"  {name} from {axis[0] * each.factor:.6g} to {axis[-1] * each.factor:.6g}{each.tail}, {axis.size} values"
                f"{', spaced by logarithm' if spaced else ''}"
                for name, each, axis, spaced in zip(self.names, read, self.axes, self.logarithmic, strict=True)
            ),
            f"  {self.runs} runs, each until it is decided, of {self.duration:.4g} s at most, at accuracy {self.accuracy:g}",
            *([f"  {self.situation}"] if self.situation else []),
            Rows([("region", "share of the map", "what the machine does"), *self._share_rows()], (0, 2)),
            Rows([("border", *self.names), *self._border_rows()]),
            *(f"  note: {note}" for note in self.notes),
            *failed,
        ]

    __repr__ = Told.__str__

    def _share_rows(self) -> list[tuple[str, str, str]]:
        """(region, part of the map, meaning) of the regions that there are, and of the free one."""
        found = self.regions.items()
        return [(name, f"{100 * where.mean():.1f} %", MEANINGS[name]) for name, where in found if where.any() or name == "free"]

    def _border_rows(self) -> list[tuple[str, str, str]]:
        """(border, range of the first number, range of the second)."""
        rows = []
        for name, segments in self.borders.items():
            ranges = ["not in the map", ""]
            for k, (factor, unit) in enumerate(self._read) if len(segments) else ():
                ranges[k] = f"{segments[..., k].min() * factor:.5g} .. {segments[..., k].max() * factor:.5g} {unit}"
            rows.append((BORDERS[name], ranges[0], ranges[1]))
        return rows

    def border(self, name: str, along: float) -> FloatArray:
        """Return the values of the first number at which a border crosses a value of the second number, ascending.

        Between two values of the grid the border is a straight line, in the logarithm of a number that is spaced by it.
        The error at a curved border can therefore be larger than `resolution`. `border_points` gives the points that
        were computed, with their errors.

        Parameters
        ----------
        name
            "smooth" or "sticking".
        along
            The value of the second number, in SI.

        Raises
        ------
        SceneError
            If there is no border of that name.
        """
        self._check_border(name)
        if self.logarithmic[1]:
            along = math.log(number("along", along, self.units[1], above=0))
        (x0, y0), (x1, y1) = (coordinates(self.borders[name][:, k], self.logarithmic).T for k in range(2))
        crossing = ((y0 - along) * (y1 - along) <= 0) & (y0 != y1)
        with np.errstate(divide="ignore", invalid="ignore"):
            x = x0 + (along - y0) / (y1 - y0) * (x1 - x0)
        found = np.unique(x[crossing])
        return np.exp(found) if self.logarithmic[0] else found

    def border_points(self, name: str) -> BorderPoints:
        """Return the points of a border where it crosses the lines of the grid, in order along it, with their errors.

        Parameters
        ----------
        name
            "smooth" (smooth running is lost) or "sticking" (existing stick-slip ends).

        Returns
        -------
        BorderPoints
            The points and their errors in SI. `print` shows them, and `to_csv` writes them, in the units in which the
            ranges were typed.

        Raises
        ------
        SceneError
            If there is no border of that name.

        Examples
        --------
        >>> from controllers import HeldSpeed
        >>> from models import DiscBrake
        >>> from toolbox import closed_loop, compose, severity_map
        >>> bench = closed_loop(compose(DiscBrake()), HeldSpeed())
        >>> found = severity_map(bench, {"disc.reference": ("10 rpm", "40 rpm"), "brake.force": ("0.5 kN", "2 kN")}, shape=(3, 2), halvings=2)
        >>> points = found.border_points("smooth")
        >>> print(points.points.shape, points.errors.max() < 1e-3)
        (3, 2) True
        """
        self._check_border(name)
        segments = self.borders[name]
        errors = self.border_errors.get(name, np.full(segments.shape, np.nan))
        lines = lines_of(segments)
        return BorderPoints(
            name=name,
            names=self.names,
            units=self.units,
            points=np.concatenate([np.empty((0, 2)), *lines]),
            errors=np.concatenate([np.empty((0, 2)), *_along(errors, lines)]),
            line=np.repeat(np.arange(len(lines)), [len(line) for line in lines]),
            display_units=self.display_units,
        )

    def _check_border(self, name: str) -> None:
        """Raise SceneError unless there is a border of that name."""
        if name not in self.borders:
            raise SceneError(f"There is no border `{name}`: {suggest(name, self.borders)}")

    def plot(self, axes: Any = None) -> Any:
        """Draw the severity from smooth running and from stick-slip side by side, with all borders
        (`toolbox.onsets.figures.severity_panels`). Return the axes.

        Parameters
        ----------
        axes
            Two matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.onsets.figures import severity_panels

        return severity_panels(self, axes)

    def _table(self) -> HeadedRows:
        """One row per point of the map: both numbers in the units that were typed, the region, and severity, interval and growth."""
        region = np.full(self.growth.shape, "none", dtype=object)
        for name, where in self.regions.items():
            region[where] = name
        arrays_of = [self.smooth.severity, self.smooth.interval, self.sticking.severity, self.sticking.interval, self.growth]
        axes, units = zip(*(typed(axis, unit, self.display_units) for axis, unit in zip(self.axes, self.units, strict=True)), strict=True)
        rows: list[list[object]] = [
            [float(x), float(y), region[i, j], *(float(array[i, j]) for array in arrays_of)]
            for i, x in enumerate(axes[0])
            for j, y in enumerate(axes[1])
        ]
        headings = [*map(heading, self.names, units), "region"]
        headings += [f"{branch} {name}" for branch in ("smooth", "sticking") for name in ("severity", "interval [s]")]
        return [*headings, "growth [1/s]"], rows

    def save_borders(self, path: str | Path) -> Path:
        """Write the points of both borders as csv, atomically, in the units in which the ranges were typed: one row per
        point with the border, the line of the border to which the point belongs, and both numbers with their errors.

        Parameters
        ----------
        path
            Path of the file.
        """
        both = [self.border_points(name)._table() for name in self.borders]
        return tables.write(path, both[0][0], [row for _, rows in both for row in rows])

    @classmethod
    def _earlier(cls, found: Mapping[str, np.ndarray]) -> Mapping[str, Any]:
        if "smooth.ratio" in found:
            raise SceneError("The map is of an earlier version, which judged its runs in a window of time: map it again.")
        notes = json.loads(str(found["map"]))
        notes.pop("seconds", None)
        sides = {branch: {each.name: f"{branch}.{each.name}" for each in dataclasses.fields(MapSide)} for branch in ("smooth", "sticking")}
        held = {
            "axes": ["axis.0", "axis.1"],
            "growth": "growth",
            "borders": [[name, f"border.{name}"] for name in BORDERS],
            "errors": [[key, text] for *key, text in notes["errors"]],
            "asked": [*notes.get("asked", {}).items()],
        }
        return {**notes, **sides, **held}

    def check_loaded(self) -> None:
        """Raise ValueError if arrays, borders or failures do not fit the grid."""
        if any(self.border_errors[name].shape != self.borders[name].shape for name in self.border_errors):
            raise ValueError("its errors do not fit its borders")
        grid = ("rows", "columns")
        found = {"growth": self.growth} | {f"axis.{k}": axis for k, axis in enumerate(self.axes)}
        shapes: dict[str, Shape] = {"axis.0": ("f", "rows"), "axis.1": ("f", "columns"), "growth": ("f", *grid)}
        for branch, side in (("smooth", self.smooth), ("sticking", self.sticking)):
            for name, values in vars(side).items():
                found[f"{branch}.{name}"], shapes[f"{branch}.{name}"] = values, ("i" if name == "verdict" else "f", *grid)
        for name in BORDERS:
            found[f"border.{name}"], shapes[f"border.{name}"] = self.borders[name], ("f", f"segments of {name}", 2, 2)
        check_shapes(found, shapes)
        rows, columns = self.growth.shape
        if not all(branch in ("smooth", "sticking") and 0 <= i < rows and 0 <= j < columns for branch, i, j in self.failures):
            raise ValueError("it has an error of a run that it does not have")


@dataclass(frozen=True)
class BorderPoints(Told, Result):
    """Points of one border of a severity map, the result of `SeverityMap.border_points`. `print(points)` shows them.

    Attributes
    ----------
    name
        "smooth" or "sticking".
    names, units
        Names and SI units of the two numbers of the map.
    points
        The points in SI, shape (n, 2), in order along every line of the border.
    errors
        Half the width of the interval in which each point lies, in SI, shape (n, 2). The number that a line of the grid
        keeps has the error 0. nan in a map of an earlier version.
    line
        Index of the line to which each point belongs, shape (n,): a border may have several separate lines.
    display_units
        {SI unit: unit that was typed}: the units of the printed table and of the file.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, severity_map
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm"))
    >>> ranges = {"top.reference": ("40 rpm", "120 rpm"), "bit.weight": ("60 kN", "100 kN")}
    >>> points = severity_map(loop, ranges, shape=(3, 3), halvings=1).border_points("sticking")
    >>> print(points)
    Border of the map: existing stick-slip ends
      top.reference [rpm]  +-  bit.weight [kN]  +-
                       90  10              100   0
                       80   0               95   5
                       70  10               80   0
                       50  10               60   0
    """

    name: str
    names: tuple[str, str]
    units: tuple[str, str]
    points: FloatArray
    errors: FloatArray
    line: np.ndarray
    display_units: Mapping[str, str] = field(default_factory=dict)

    def _told(self) -> list[str | Rows]:
        read = [reading(unit, self.display_units) for unit in self.units]
        head = [text for name, each in zip(self.names, read, strict=True) for text in (heading(name, each.unit), "+-")]
        if not len(self.points):
            return [f"Border of the map: {BORDERS[self.name]}", "  not in the map"]
        factors = [each.factor for each in read]
        cells = np.stack([self.points * factors, self.errors * factors], axis=2).reshape(-1, 4)
        cells[:, 1::2] = np.where(cells[:, 1::2] < EXACT_BELOW * np.abs(cells[:, ::2]), 0.0, cells[:, 1::2])
        rows = [[f"{value:.6g}" if k % 2 == 0 else f"{value:.2g}" for k, value in enumerate(row)] for row in cells]
        return [f"Border of the map: {BORDERS[self.name]}", Rows([head, *rows], ())]

    __repr__ = Told.__str__

    def _table(self) -> HeadedRows:
        """One row per point: the border, its line, and both numbers with their errors in the units that were typed."""
        columns: list[np.ndarray] = []
        headings = ["border", "line"]
        for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            for what, values in ((name, self.points[:, k]), (f"+- {name}", self.errors[:, k])):
                shown, shown_in = typed(values, unit, self.display_units) if len(values) else (values, self.display_units.get(unit, unit))
                columns.append(shown)
                headings.append(heading(what, shown_in))
        cells = np.stack(columns, axis=1).tolist()
        return headings, [[BORDERS[self.name], int(line), *row] for line, row in zip(self.line, cells, strict=True)]


@takes_loop
def severity_map(
    loop: ClosedLoop,
    ranges: Mapping[str, tuple[NumberOrText, NumberOrText]],
    *,
    shape: tuple[int, int] = (50, 50),
    duration: NumberOrText | None = None,
    mode: Mapping[str, str] | None = None,
    guess: Mapping[str, Any] | None = None,
    halvings: int = 3,
    logarithmic: Sequence[str] = (),
    executor: concurrent.futures.Executor | None = None,
    checkpoint: str | Path | None = None,
) -> SeverityMap:
    """Map the severity of stick-slip over two inputs or parameters, for runs from smooth running and for runs from stick-slip.

    The map contains the results of both kinds of runs, the border at which smooth running is lost, and the border at
    which stick-slip ends. The borders follow from the growth of a small disturbance of the running loop, and from runs
    that are continued until their regime (smooth running, stick-slip or standstill) is decided. This works for every
    kind of controller.

    Parameters
    ----------
    loop
        A loop with constant inputs, or a plant. A controller may be continuous or sampled, in machine code or in
        Python.
    ranges
        {name: (low, high)} of exactly two numbers, in SI or text with units. The first name gives the rows of all
        arrays.
    shape
        Number of grid points along the first and the second number, by default (50, 50).
    duration
        Longest time for which a run is continued until its regime (smooth running, stick-slip or standstill) is decided
        [s]. By default 2000 periods of the least damped motion.
    mode
        {contact or relay: mode} of the steady state in the middle of the map. By default contacts slide in the
        direction in which they slide at the start.
    guess
        {state: value} near the steady state in the middle of the map, as a start of the search. By default None: the
        search starts without a guess.
    halvings
        Number of bisections of each grid edge that crosses a border, from 0 to 20, by default 3. Each bisection halves
        the error of the border.
    logarithmic
        Names of the numbers whose values are spaced by their logarithm, with many values near the lower end of the
        range. The range of such a number must be positive. By default none.
    executor
        Any `concurrent.futures.Executor`, such as the executor of a Dask client (`client.get_executor()`). It computes
        the runs from the points of the grid. By default one thread per core.
    checkpoint
        Folder for the map (`map.npz`) and the outcome of each run (`runs.jsonl`). A map that was interrupted continues
        from this folder. By default None: nothing is stored.

    Returns
    -------
    SeverityMap
        Severity and regime of the runs from smooth running and of the runs from stick-slip, and the borders.

    Raises
    ------
    SceneError
        If a name is unknown, a range is empty, or there is no smooth running in the middle of the map.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose, severity_map
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm"))
    >>> ranges = {"top.reference": ("40 rpm", "120 rpm"), "bit.weight": ("60 kN", "100 kN")}
    >>> found = severity_map(loop, ranges, shape=(3, 3), halvings=0)
    >>> print(found.sticking.severity.round(2))
    [[1.39 1.63 1.83]
     [0.   0.   1.21]
     [0.   0.   0.  ]]
    """
    if not isinstance(shape, Sequence) or len(shape) != 2:
        raise SceneError(f"Argument `shape` must be two integers >= 2, but it is {shape!r}.")
    rows, columns = (whole(f"shape.{i}", count, 2) for i, count in enumerate(shape))
    shape = (rows, columns)
    whole("halvings", halvings, 0, 20)
    check_executor(executor)
    plane = Plane.of(loop, ranges, logarithmic)
    steady = steady_plane(loop, plane, mode, guess)
    axes = tuple(np.linspace(low, high, n) for (low, high), n in zip(plane.ends.tolist(), shape, strict=True))
    places = [plane.place(point) for point in grid(dict(zip(plane.names, axes, strict=True))).points]
    learn: Callable[[Sequence[complex]], None] = (lambda _: None) if steady is None else steady.learn
    search = map_runs(loop, plane, steady, places, duration)
    if checkpoint is not None:
        asked = {
            "ranges": [plane.names, plane.ranges],
            "shape": [*shape],
            "duration": search.budget,
            "mode": mode,
            "guess": guess,
            "halvings": halvings,
            **({"logarithmic": [*plane.logarithmic]} if any(plane.logarithmic) else {}),
        }
        folder_of(Path(checkpoint))
        search.journal = Journal(Path(checkpoint) / "runs.jsonl", fingerprints(search.base, plane.names, **asked), is_run)
    front = Front(search=search, plane=plane, places=places, shape=shape, executor=executor)
    smooth = front.smooth()
    front.stopped()
    with progress_bar(None, "map, near borders") as search.bar:
        front.entered()
        front.spread()
        front.passed()
    inside = [front.found[place] for place in places]
    branches = [_side(row, shape) for row in (smooth, inside)]
    growth = np.array([search.branch.rate(place) for place in places]).reshape(shape)
    decided = [branch.verdict != NONE for branch in branches]
    # smooth running that grows so slowly that no run decides where it ends up is lost all the same: its growth is known
    lost, sticks = np.where(decided[0], branches[0].verdict != SMOOTH, growth > 0.0), branches[1].verdict == STICK_SLIP
    edges = [edges_of(axes, lost, decided[0] | np.isfinite(growth)), edges_of(axes, sticks, decided[1])]
    with progress_bar(None, "map, borders") as search.bar:
        losses = _losses(search, plane, edges[0], halvings, learn)
        ends = front.halved(edges[1], halvings, learn), edges[1].errors(0.5**halvings)
    crossings = {name: [each.segments(part) for part in both] for name, each, both in zip(BORDERS, edges, (losses, ends), strict=True)}
    found = SeverityMap(
        title=loop.title,
        names=plane.names,
        units=(plane.numbers[0].unit, plane.numbers[1].unit),
        axes=tuple(plane.in_si(np.stack([axis, axis], axis=-1))[..., k] for k, axis in enumerate(axes)),  # type: ignore[arg-type]
        element=search.element,
        signal=search.signal,
        smooth=branches[0],
        sticking=branches[1],
        growth=growth,
        borders={name: plane.in_si(places) for name, (places, _) in crossings.items()},
        duration=search.budget * search.period,
        accuracy=search.base.accuracy,
        resolution=0.5**halvings,
        runs=search.runs,
        situation=str(situation_of(loop)),
        logarithmic=plane.logarithmic,
        border_errors={
            name: 0.5 * (plane.in_si(places + width) - plane.in_si(places - width)) for name, (places, width) in crossings.items()
        },
        notes=tuple(_notes(search, (smooth, inside))),
        nominal_point=(plane.numbers[0].value, plane.numbers[1].value),
        display_units={
            number.unit: asked_in(number.in_si(number.name, ends), number.unit)
            for number, ends in reversed([*zip(plane.numbers, ranges.values(), strict=True)])
        },
    )
    if checkpoint is not None:
        found.save(Path(checkpoint) / "map.npz")
    return found


def situation_of(loop: ClosedLoop) -> Situation:
    """The situation that a map of a loop holds for."""
    return Situation.of(
        loop, "smooth running with a small disturbance, and from a contact that is stopped at once", "until the regime is decided"
    )


def _side(judged: Sequence[Judged], shape: tuple[int, int]) -> MapSide:
    """One branch of a map from what the judge says at its points."""
    verdicts = np.array([VERDICTS.get(each.regime, NONE) for each in judged]).reshape(shape)
    severity, interval = (np.array([getattr(each, name) for each in judged]).reshape(shape) for name in ("severity", "interval"))
    return MapSide(severity, interval, verdicts)


def _losses(
    search: JudgedRuns[complex], plane: Plane, edges: Edges, halvings: int, learn: Callable[[Sequence[complex]], None]
) -> tuple[np.ndarray, np.ndarray]:
    """Where smooth running is lost on every edge, and the errors: where its growth changes its sign, else by runs."""

    def rates(points: np.ndarray) -> np.ndarray:
        places = [plane.place(point) for point in points]
        learn(places)
        return np.array([search.branch.rate_near(place) for place in places])

    def lost(points: np.ndarray) -> np.ndarray:
        return np.array([search.smooth(plane.place(point)).regime != judge.SMOOTH for point in points])

    low, high = edges.low.copy(), edges.high.copy()
    for k, both in enumerate(zip(edges.low, edges.high, strict=True)):
        ends = [plane.place(point) for point in both]
        if any(math.isnan(search.branch.rate(end)) for end in ends):
            with contextlib.suppress(SimulationError):  # where growth is known on no two sides, runs tell
                points = np.array([plane.point(end) for end in search.branch.bracket(*ends)])
                low[k], high[k] = coordinates(points, plane.logarithmic)
    bracketed, precision = Edges(low, high, edges.cells), 0.1 * 0.5**halvings if search.base.system.updates else EXACT
    roots = bracketed.roots(rates, precision)[:, None]
    places, errors = low + np.nan_to_num(roots) * (high - low), 2.0 * bracketed.errors(precision)
    rest = np.isnan(roots[:, 0])
    places[rest] = Edges(edges.low[rest], edges.high[rest], edges.cells[:0]).halved(lost, halvings)
    errors[rest] = edges.errors(0.5**halvings)[rest]
    return places, errors


def _along(segments: np.ndarray, lines: Sequence[np.ndarray]) -> list[np.ndarray]:
    """What belongs to both ends of segments in order, shape (k, 2, 2), as rows of the points of each line that they make (`lines_of`)."""
    parts = np.split(segments, np.cumsum([len(line) - 1 for line in lines])[:-1]) if lines else []
    return [np.vstack([part[:1, 0], part[:, 1]]) for part in parts]


def _notes(search: JudgedRuns[complex], rows: Sequence[Sequence[Judged]]) -> list[str]:
    """What the reader of a map should know."""
    notes = []
    if search.base.system.updates:
        ways = dict.fromkeys(smooth.growth.way for smooth in search.branch.known.values() if smooth is not None)
        notes.append(f"The law runs sampled; its growth is known by {', '.join(ways)}.")
    if search.branch.run is not search.base:
        notes.append("Smooth running is judged without measurement noise and steps of encoders, stick-slip with them.")
    for name, row in zip(("smooth running", "inside stick-slip"), rows, strict=True):
        undecided = sum(each.regime == judge.NOT_DECIDED for each in row)
        if undecided:
            what = "1 point was" if undecided == 1 else f"{undecided} points were"
            seconds = search.budget * search.period
            longest = f"{seconds / 60:.0f} min" if seconds >= 600 else f"{seconds:.3g} s"
            notes.append(
                f"From {name}, {what} not decided within {longest} of simulated time: there the motion neither came back nor died out."
            )
    return notes
