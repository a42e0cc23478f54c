"""The driller's window: at which speed and weight a law keeps a well smooth, over the depth of the well.

At every depth both branches of the machine are mapped (`severity_map`). From the map is read, at several values of the second number, from which value of the
first one on the machine is *free* up to the end of the range: smooth running is stable, and stick-slip that has begun ends by itself. Between that and where
smooth running is lost a machine is smooth only as long as nothing disturbs it. Margins are those of the working point of the loop: how far its first number
is above both borders, and the disk margin of its linear loop.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.arguments import numbers
from toolbox.errors import SceneError
from toolbox.files.printing import Rows, Told, shown
from toolbox.files.results import LEFT_OUT, HeadedRows, Result
from toolbox.files.tables import heading
from toolbox.files.unit_systems import asked_in, reading
from toolbox.files.units import NumberOrText, in_si
from toolbox.modelling.closed_loop import ClosedLoop, as_loop
from toolbox.modelling.closing import described
from toolbox.modelling.laws import Controller, Sampled
from toolbox.onsets.map_loop import NONE, SMOOTH
from toolbox.onsets.severity_map import MapSide, SeverityMap, severity_map, situation_of
from toolbox.robustness.margins import disk_margin
from toolbox.vocabulary import new_names_only

HALVINGS = 4
"""How often an edge of the grid across a border is halved: a grid of 13 by 7 points then has the borders of one of 25 by 13 whose edges are halved thrice."""


@dataclass(frozen=True)
class Windows(Told, Result):
    """Windows without stick-slip over depth, the result of `windows`. `print(found)` shows one line per depth and
    second value, `found.plot()` draws one figure per depth.

    Attributes
    ----------
    title
        The controller and how it runs.
    names, units
        Names of the two numbers of the windows, such as set-point and weight on bit, and their units in SI.
    first_low, first_high
        Ends of the range of the first number, in SI.
    depths
        Depths [m].
    second_values
        Values of the second number at which the windows are read, in SI.
    smooth_from, free_from
        Value of the first number above which, up to `first_high`, smooth running is stable, and above which stick-slip
        ends as well. Shape (depths, second values), in SI. -inf if this holds in the whole range, inf if it holds
        nowhere up to the end of the range.
    operating_points
        Operating point of the two numbers at every depth, shape (depths, 2), in SI.
    onset_margins
        Distance of the first number of the operating point above the value at which smooth running is lost, and above
        the value at which stick-slip ends, as fractions of this number. Shape (depths, 2) [1]. inf if there is no
        border within the range, -inf if the operating point is not in the window.
    disk_margin
        Disk margin at the operating point [1], shape (depths,). nan if there is no linear loop.
    display_units
        {SI unit: unit that was typed}: the units in which `print` answers.
    situation
        The situation for which the verdict holds, in one line.
    severity_maps
        The map of every depth, each with its own figure. Empty after loading.

    Examples
    --------
    >>> from controllers import StiffPI
    >>> from models import BitRock, TorsionalChain
    >>> from toolbox import compose
    >>> from toolbox.drilling import windows
    >>> def well(depth):
    ...     string = TorsionalChain(inertia=(2122.0, 374.0), stiffness=(473.0 * 2000.0 / depth,), damping=(23.2,), top_drag=425.0, bit_drag=50.0)
    ...     return compose(string, BitRock())
    >>> ranges = {"top.reference": ("60 rpm", "180 rpm"), "bit.weight": ("40 kN", "100 kN")}
    >>> found = windows(well, [1500.0], StiffPI(reference="120 rpm"), ranges, second_values=["60 kN"], shape=(4, 3))
    >>> print(f"no stick-slip above {found.free_from[0, 0]:.1f} rad/s at {found.depths[0]:.0f} m")
    no stick-slip above 8.6 rad/s at 1500 m
    """

    title: str
    names: tuple[str, str]
    units: tuple[str, str]
    first_low: float
    first_high: float
    depths: tuple[float, ...]
    second_values: np.ndarray
    smooth_from: np.ndarray
    free_from: np.ndarray
    operating_points: np.ndarray
    onset_margins: np.ndarray
    disk_margin: np.ndarray
    display_units: Mapping[str, str]
    severity_maps: Any = field(default=(), repr=False, compare=False, metadata=LEFT_OUT)
    situation: str = ""

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The table as text: at every depth one line per value of the second number."""
        first, second, deep = (reading(unit, self.display_units) for unit in (*self.units, "m"))
        lines: list[tuple[str, ...]] = [
            (
                f"depth [{deep.tail.strip()}]", f"{self.names[1]} [{second.tail.strip() or '1'}]", f"smooth from {self.names[0]} [{first.tail.strip() or '1'}]",
                "free from", "margin, smooth", "margin, free", "disk margin",
            )
        ]  # fmt: skip
        for i, depth in enumerate(self.depths):
            parts = [_part(each) for each in self.onset_margins[i]] + [shown(self.disk_margin[i])]
            for j, value in enumerate(self.second_values):
                borders = [_border(each[i, j], first.factor) for each in (self.smooth_from, self.free_from)]
                head = f"{depth * deep.factor:.5g}" if j == 0 else ""
                lines.append((head, f"{value * second.factor:.4g}", *borders, *(parts if j == 0 else ("", "", ""))))
        return lines

    def _told(self) -> list[str | Rows]:
        first, second = (reading(unit, self.display_units) for unit in self.units)
        points = np.unique(self.operating_points, axis=0)
        point = ""
        if len(points) == 1 and np.isfinite(points).all():
            x, y = points[0]
            point = f", working point {x * first.factor:.4g}{first.tail}, {y * second.factor:.4g}{second.tail}"
        notes = [
            f"  between {self.first_low * first.factor:.4g} and {self.first_high * first.factor:.4g}{first.tail}{point}",
            *([f"  {self.situation}"] if self.situation else []),
            "  smooth: as long as nothing disturbs it; free: from stick-slip, too; all: in the whole range; none: nowhere up to its end",
        ]
        return [f"Windows over depth of {self.title}", *notes, Rows(self.rows, ())]

    def _table(self) -> HeadedRows:
        """One row per depth and value of the second number."""
        headings = [
            "depth [m]",
            heading(self.names[1], self.units[1]),
            heading(f"smooth from {self.names[0]}", self.units[0]),
            heading(f"free from {self.names[0]}", self.units[0]),
            "margin smooth",
            "margin free",
            "disk margin",
        ]
        rows = [
            [depth, value, self.smooth_from[i, j], self.free_from[i, j], *self.onset_margins[i].tolist(), self.disk_margin[i]]
            for i, depth in enumerate(self.depths)
            for j, value in enumerate(self.second_values.tolist())
        ]
        return headings, rows

    def plot(self, axes: Any = None) -> Any:
        """Draw the window of every depth, one figure each (`toolbox.drilling.figures.window_diagram`), and return the axes.

        Parameters
        ----------
        axes
            Matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.drilling.figures import window_diagram

        first, second, deep = (reading(unit, self.display_units) for unit in (*self.units, "m"))
        labels = [f"{name} [{read.tail.strip() or '1'}]" for name, read in zip(self.names, (first, second), strict=True)]
        size = np.array([first.factor, second.factor])
        return window_diagram(
            labels, [f"{depth * deep.factor:.5g}{deep.tail}" for depth in self.depths], self.second_values * size[1], self.smooth_from * size[0],
            self.free_from * size[0], self.operating_points * size, (self.first_low * size[0], self.first_high * size[0]), axes=axes,
        )  # fmt: skip


@new_names_only
def windows(
    well: Callable[[float], Any],
    depths: Iterable[NumberOrText],
    controller: Controller | Sampled | Callable[[float], Controller | Sampled],
    ranges: Mapping[str, tuple[NumberOrText, NumberOrText]],
    *,
    second_values: Iterable[NumberOrText] | None = None,
    shape: tuple[int, int] = (13, 7),
    checkpoint: str | Path | None = None,
) -> Windows:
    """Find the windows of set-point and weight on bit in which a controller runs without stick-slip, at several depths of a well.

    Parameters
    ----------
    well
        A function depth [m] -> plant, or loop without controllers, such as a function that cuts a string to this
        length.
    depths
        Depths, in metres or text with units.
    controller
        The controller, or a function depth [m] -> controller. `schedule(...).law_at` is such a function.
    ranges
        {name: (low, high)} of the two numbers of a map. First the number whose lowest value is searched, such as the
        set-point, then the other number, such as the weight on bit.
    second_values
        Values of the second number at which windows are read. By default five over its range.
    shape
        Number of grid points along the first and the second number, for the map of each depth, by default (13, 7).
    checkpoint
        Folder that keeps the points of all maps. A search that was interrupted continues from this folder. By default
        None: nothing is stored.

    Returns
    -------
    Windows
        The windows. `found.severity_maps[i].plot()` draws the map of depth number i, from smooth running and from
        stick-slip.

    Raises
    ------
    SceneError
        If an argument is wrong, or the loop of a depth cannot be mapped.

    Examples
    --------
    >>> from controllers import StiffPI
    >>> from models import BitRock, TorsionalChain
    >>> from toolbox import compose
    >>> from toolbox.drilling import windows
    >>> def well(depth):
    ...     string = TorsionalChain(inertia=(2122.0, 374.0), stiffness=(473.0 * 2000.0 / depth,), damping=(23.2,), top_drag=425.0, bit_drag=50.0)
    ...     return compose(string, BitRock())
    >>> ranges = {"top.reference": ("60 rpm", "180 rpm"), "bit.weight": ("40 kN", "100 kN")}
    >>> found = windows(well, [1500.0], StiffPI(reference="120 rpm"), ranges, second_values=["60 kN"], shape=(4, 3))
    >>> print(found.depths, "m")
    (1500.0,) m
    """
    deep = in_si(list(depths), "m", "depths")
    places = numbers("depths", deep, "m", at_least=0)
    if not places:
        raise SceneError("Argument `depths` must hold at least one depth, but it is empty.")
    maps: list[SeverityMap] = []
    points, disks = [], []
    loops: list[ClosedLoop] = []
    for depth in places:
        here = controller(depth) if callable(controller) and not isinstance(controller, Controller | Sampled) else controller
        loop = closed_at(well, depth).replace(controllers=(here,))
        loops.append(loop)
        folder = None if checkpoint is None else Path(checkpoint) / f"{depth:g}m"
        found = severity_map(loop, ranges, shape=shape, halvings=HALVINGS, checkpoint=folder)
        maps.append(found)
        points.append(found.nominal_point)
        disks.append(disk_margin(loop))
    second = loop.number(maps[0].names[1])
    low, high = maps[0].axes[1][[0, -1]]
    typed = np.linspace(low, high, 5).tolist() if second_values is None else in_si(list(second_values), second.unit, "second_values")
    values = numbers("second_values", typed, second.unit, at_least=low, at_most=high)
    at = np.array(points, float)
    borders = [np.array([[_from(found, name, value) for value in values] for found in maps]) for name in ("smooth", "sticking")]
    inside = [
        [_from(found, name, y) if low <= y <= high else math.nan for name in ("smooth", "sticking")]
        for found, (_, y) in zip(maps, at, strict=True)
    ]
    with np.errstate(divide="ignore", invalid="ignore"):
        margin = np.where(np.isneginf(inside), math.inf, (at[:, :1] - np.array(inside)) / at[:, :1])
    margin = np.where(np.isposinf(inside), -math.inf, margin)
    first = maps[0].axes[0]
    return Windows(
        title=described(loop.controllers[0]),
        names=maps[0].names,
        units=maps[0].units,
        first_low=float(first[0]),
        first_high=float(first[-1]),
        depths=tuple(places),
        second_values=np.array(values),
        smooth_from=borders[0],
        free_from=borders[1],
        operating_points=at,
        onset_margins=margin,
        disk_margin=np.array(disks),
        display_units={**maps[0].display_units, "m": asked_in(deep, "m")},
        severity_maps=tuple(maps),
        situation=str(dataclasses.replace(situation_of(loops[0]), plants="the nominal plant at each depth")),
    )


def closed_at(well: Callable[[float], Any], depth: float) -> ClosedLoop:
    """The loop of a depth, without laws; raises SceneError for one with laws."""
    loop = as_loop(well(depth), "well")
    if loop.controllers:
        raise SceneError(
            f"Argument `well` must give a plant, or a loop without laws, but at {depth:g} m it gives one with {described(loop.controllers[0])}."
        )
    return loop


def _from(found: SeverityMap, name: str, value: float) -> float:
    """Value of the first number from which on a branch is smooth up to its end, at a value of the second; -inf for everywhere, inf for nowhere.

    Beside a point of the map that nothing decided there may be no border: the branch is smooth from the next point on.
    """
    side: MapSide = getattr(found, name)
    near = int(np.abs(found.axes[1] - value).argmin())
    column, crossings = side.verdict[:, near], found.border(name, value)
    if crossings.size:
        above = found.axes[0] > max([crossings[-1], *found.border(name, float(found.axes[1][near]))])
        if (column[above] == SMOOTH).all():
            return float(crossings[-1])
    others = np.flatnonzero(column != SMOOTH)
    if not others.size:
        return math.inf if crossings.size else -math.inf
    undecided = column[others[-1]] == NONE and others[-1] + 1 < column.size
    return float(found.axes[0][others[-1] + 1]) if undecided else math.inf


def _border(value: float, factor: float) -> str:
    return "all" if value == -math.inf else "none" if value == math.inf else f"{value * factor:.4g}"


def _part(value: float) -> str:
    return "all" if value == math.inf else "outside" if value == -math.inf else shown(100.0 * value, "+.3g", " %")
