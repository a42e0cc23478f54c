"""Where a loop is stable over two of its numbers, and with which disk margin."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray, number
from toolbox.errors import NoSteadyState, SceneError, SimulationError
from toolbox.files.results import HeadedRows, Result
from toolbox.files.units import NumberOrText
from toolbox.messages import sign_of_life
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.robustness.margins import margins


@dataclass(frozen=True)
class StabilityChart(Result):
    """Growth rate and disk margin of a loop over two of its numbers, the result of `stability_chart`. `found.plot()` draws them.

    Attributes
    ----------
    names, units
        Names and units of the two numbers: first the horizontal axis, then the vertical axis.
    axes
        Values of the two numbers, in SI.
    growth_rate
        Largest real part of the poles at every point [1/s], shape (horizontal, vertical). nan if there is no steady
        running or no linear loop.
    disk_margin
        Disk margin of all commands together at every point [1], in the shape of `growth_rate`. 0 if the loop is
        unstable.
    nominal_point
        Values of the two numbers in the loop, in SI.
    display_units
        {SI unit: unit that was typed}.

    Examples
    --------
    >>> from controllers import PI
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.robustness import stability_chart
    >>> drive = PI(proportional=400.0, integral=200.0, reference="60 rpm")
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), drive)
    >>> chart = stability_chart(loop, {"pi.proportional": (100.0, 2000.0), "pi.integral": (100.0, 1000.0)}, shape=(3, 3))
    >>> print(chart.growth_rate.shape, chart.best)
    (3, 3) (1050.0, 100.0)
    """

    names: tuple[str, str]
    units: tuple[str, str]
    axes: tuple[FloatArray, FloatArray]
    growth_rate: FloatArray
    disk_margin: FloatArray
    nominal_point: tuple[float, float]
    display_units: Mapping[str, str] = field(default_factory=dict)

    @property
    def best(self) -> tuple[float, float]:
        """Values of the two numbers at the point with the largest disk margin."""
        i, j = np.unravel_index(int(np.argmax(np.nan_to_num(self.disk_margin))), self.disk_margin.shape)
        return float(self.axes[0][i]), float(self.axes[1][j])

    def __str__(self) -> str:
        known = np.isfinite(self.growth_rate)
        best = ", ".join(f"{name} = {value:.4g} {unit}" for name, value, unit in zip(self.names, self.best, self.units, strict=True))
        return (
            f"Stability over {self.names[0]} and {self.names[1]}: stable at {int((self.growth_rate[known] < 0).sum())} of {self.growth_rate.size} points"
            f"{'' if known.all() else f', not known at {int((~known).sum())}'}; largest disk margin {np.nanmax(self.disk_margin):.3g} at {best}"
        )

    __repr__ = __str__

    def _table(self) -> HeadedRows:
        """One row per point."""
        rows = [
            [u, v, self.growth_rate[i, j], self.disk_margin[i, j]] for i, u in enumerate(self.axes[0]) for j, v in enumerate(self.axes[1])
        ]
        return [*self.names, "growth", "disk_margin"], rows

    def plot(self, ax: Any = None) -> Any:
        """Draw the stable region with lines of equal disk margin, and return the axes.

        Parameters
        ----------
        ax
            Matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.robustness.response_figures import stability_diagram

        return stability_diagram(self, ax)


@sign_of_life("stability_chart is at work")
@takes_loop
def stability_chart(
    loop: ClosedLoop, ranges: Mapping[str, tuple[NumberOrText, NumberOrText]], *, shape: tuple[int, int] = (15, 15)
) -> StabilityChart:
    """Compute stability and disk margin of a loop at smooth running over two of its numbers, such as both gains of a
    drive.

    Parameters
    ----------
    loop
        A loop with at least one controller and constant inputs.
    ranges
        {number of the loop: (lowest, highest value)}, exactly two, the first for the horizontal axis:
        `{"pi.proportional": (0, 5000), "pi.integral": (0, 3000)}`.
    shape
        Number of points along the horizontal and the vertical axis, at least 3 each, by default (15, 15).

    Returns
    -------
    StabilityChart
        Growth rate and disk margin at every point.

    Raises
    ------
    SceneError
        If `ranges` does not hold exactly two numbers of the loop with a range, `shape` is too small, or no point has
        a linear loop.

    Examples
    --------
    >>> from controllers import PI
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.robustness import stability_chart
    >>> drive = PI(proportional=400.0, integral=200.0, reference="60 rpm")
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), drive)
    >>> chart = stability_chart(loop, {"pi.proportional": (100.0, 2000.0), "pi.integral": (100.0, 1000.0)}, shape=(5, 5))
    >>> print(f"largest disk margin {chart.disk_margin.max():.2f}")
    largest disk margin 2.00
    """
    if len(ranges) != 2:
        raise SceneError(f"Argument `ranges` must hold two numbers with their ranges, but it holds {len(ranges)}.")
    if len(shape) != 2 or min(shape) < 3:
        raise SceneError(f"Argument `shape` must be two whole numbers >= 3, but it is {shape}.")
    known = [loop.number(name) for name in ranges]
    rows = []
    for each, (low, high), points in zip(known, ranges.values(), shape, strict=True):
        low, high = (number(f"over[{each.name!r}]", end, each.unit) for end in (low, high))
        if not low < high:
            raise SceneError(f"Argument `ranges` must hold (lowest, highest), but `{each.name}` goes from {low:g} to {high:g}.")
        rows.append(np.linspace(low, high, points))
    growth, disk = np.full(shape, math.nan), np.full(shape, math.nan)
    reason = ""
    for i, across in enumerate(rows[0]):
        for j, up in enumerate(rows[1]):
            with contextlib.suppress(NoSteadyState, SimulationError):
                found = margins(loop.at(known[0].name, float(across)).at(known[1].name, float(up)), by_simulation=False)
                if found.linear_loop is None:
                    reason = found.reason
                    continue
                growth[i, j], disk[i, j] = found.linear_loop.growth(), found.disk_margin if found.stable else 0.0
    if np.isnan(growth).all():
        raise SceneError(f"No point has a linear loop{f': {reason}' if reason else ''}.")
    names, units = (known[0].name, known[1].name), (known[0].unit, known[1].unit)
    return StabilityChart(names, units, (rows[0], rows[1]), growth, disk, (known[0].value, known[1].value), loop.display_units)
