"""The basin of a working point: from which part of the disturbances it comes back, with bounds, and the smallest one that tips it.

    found = basin(loop, {"block.position": (-2.0, 2.0), "block.speed": (-2.0, 2.0)}, 1000)

Disturbances are states, drawn evenly from a declared box. A short bump of torque is a jump of a speed, its impulse over the inertia. Runs are decided in lanes
and by the judge of all verdicts, as those of `chance`. Source: P. J. Menck, J. Heitzig, N. Marwan, J. Kurths (2013), doi:10.1038/nphys2516.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.arguments import BoolArray, FloatArray, number, short, whole
from toolbox.errors import SceneError
from toolbox.files.printing import Rows, Told
from toolbox.files.results import HeadedRows, Result
from toolbox.files.tables import heading
from toolbox.files.unit_systems import asked_units, reading
from toolbox.files.units import NumberOrText
from toolbox.halving import divided
from toolbox.messages import progress_bar
from toolbox.modelling.closed_loop import ClosedLoop, closed_loop, takes_loop
from toolbox.onsets.map_loop import NONE, SMOOTH
from toolbox.probability.bounds import clopper_pearson
from toolbox.probability.chances import Search
from toolbox.probability.pictures import picture
from toolbox.scenes.situation import Situation
from toolbox.steady_states.linear import equilibrium
from toolbox.sweeps.designs import Variations, uniform

HALVED = 1e-3
"""Width of the interval in which the smallest disturbance is sought, at last, in parts of it."""

SIDE_BY_SIDE = 32
"""Parts of that interval of which those are found out at once, in lanes, that tip."""


@dataclass(frozen=True)
class Basin(Told, Result):
    """Basin of attraction of an operating point, the result of `basin`: `print(found)`, `found.share`, `found.smallest_disturbances`, `found.plot()`.

    Attributes
    ----------
    title
        Name of the machine.
    names, units
        Names of the disturbed states, and their units.
    ranges
        Lowest and highest value of each state, in SI, shape (states, 2).
    equilibrium
        The operating point, in SI.
    initial_states
        Values of the disturbed states at the start of each run, in SI, shape (runs, states).
    outcomes
        Outcome of each run: 0 smooth, 1 swing, 2 stick-slip, 3 stuck, -1 not known.
    smallest_disturbances
        Values of the disturbed states at the border of the basin, on the line from the operating point to the nearest
        start whose run does not return. Distances are measured as fractions of the ranges. nan if every run returns.
    duration, accuracy
        Length [s] and accuracy of a run.
    confidence
        Confidence level of the bounds.
    judged_runs
        Number of runs that were undecided at their end and were continued.
    situation
        The situation for which the verdict holds, in one line.
    display_units
        {SI unit: unit that was typed}.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.probability import basin
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm"))
    >>> found = basin(loop, {"bit.speed": ("0 rpm", "200 rpm")}, runs=20)
    >>> print(f"{found.share:.2f} of {len(found.outcomes)} runs return")
    0.30 of 20 runs return
    """

    title: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    ranges: np.ndarray
    equilibrium: np.ndarray
    initial_states: np.ndarray
    outcomes: np.ndarray
    smallest_disturbances: np.ndarray
    duration: float
    accuracy: float
    confidence: float
    judged_runs: int
    display_units: Mapping[str, str] = field(default_factory=dict)
    situation: str = ""

    @property
    def share(self) -> float:
        """Fraction of the known disturbances after which the machine returns to the operating point."""
        known = int((self.outcomes != NONE).sum())
        return float((self.outcomes == SMOOTH).sum()) / known if known else math.nan

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of `share` by Clopper and Pearson, as (lower, upper). Undecided runs count as no return for the lower
        bound and as return for the upper bound.
        """
        back, unknown = int((self.outcomes == SMOOTH).sum()), int((self.outcomes == NONE).sum())
        low, high = clopper_pearson(back, back + unknown, self.outcomes.size, self.confidence)
        return float(low), float(high)

    def _told(self) -> list[str | Rows]:
        low, high = self.bounds
        lines = [
            f"Basin of {self.title}: {self.outcomes.size} disturbances, runs of {self.duration:.4g} s at accuracy {self.accuracy:g}",
            f"  it comes back from {100 * self.share:.4g} % of them, {100 * self.confidence:g} % bounds {100 * low:.4g} .. {100 * high:.4g} %",
        ]
        lines += [f"  {self.situation}"] if self.situation else []
        rows: list[tuple[str, ...]] = [("state", "unit", "working point", "ranges", "smallest that tips it")]
        for k, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            factor, shown = reading(unit, self.display_units)[:2]
            at, begin, end, tip = (float(each) * factor for each in (self.equilibrium[k], *self.ranges[k], self.smallest_disturbances[k]))
            rows.append((name, shown, f"{at:.5g}", f"{begin:.5g} .. {end:.5g}", "none" if math.isnan(tip) else f"{tip:.5g}"))
        return [*lines, Rows(rows, left=(0, 1))]

    __repr__ = Told.__str__

    def _table(self) -> HeadedRows:
        """One row per disturbance, and what it came to."""
        headings = [heading(name, unit) for name, unit in zip(self.names, self.units, strict=True)]
        rows = [[*row, int(outcome)] for row, outcome in zip(self.initial_states.tolist(), self.outcomes, strict=True)]
        return [*headings, "outcome"], rows

    plot = picture("basin_diagram", "Draw the disturbances over the first two states, or over the only state with the outcome of each run")

    def check_loaded(self) -> None:
        """Raise ValueError if the loaded arrays do not fit together."""
        if self.initial_states.shape != (self.outcomes.size, len(self.names)) or self.ranges.shape != (len(self.names), 2):
            raise ValueError("its arrays do not fit together")


@takes_loop
def basin(
    loop: ClosedLoop,
    ranges: Mapping[str, Any],
    runs: int = 1000,
    *,
    duration: NumberOrText | None = None,
    accuracy: float = 1e-4,
    confidence: float = 0.95,
    seed: int = 0,
) -> Basin:
    """Estimate the probability of a return to smooth running after a random disturbance, and the smallest disturbance without return.

    Parameters
    ----------
    loop
        A loop with a steady state, or a plant. Its controllers take part in their continuous form.
    ranges
        {state: (lowest, highest)}, in SI or text with units. Values are drawn uniformly; other states start at smooth
        running.
    runs
        Number of disturbances, by default 1000.
    duration
        Length of a run [s], or text with a unit. By default forty oscillations of the machine.
    accuracy
        Target for the global error of the runs, between 1e-13 and 0.1, by default 0.0001.
    confidence
        Confidence level of the bounds of Clopper and Pearson, by default 0.95.
    seed
        Seed of the random numbers, by default 0.

    Returns
    -------
    Basin
        The fraction with its bounds, all disturbances, and the smallest disturbance without return. `print`, `plot`
        and `save` it.

    Raises
    ------
    SceneError
        If a name is no state, a range is empty, or the loop has no steady state.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.probability import basin
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm"))
    >>> found = basin(loop, {"bit.speed": ("0 rpm", "200 rpm"), "top.speed": ("30 rpm", "90 rpm")}, runs=100)
    >>> print(f"{found.share:.2f} of the disturbances die out")
    0.52 of the disturbances die out
    """
    if not isinstance(ranges, Mapping) or not ranges:
        raise SceneError(f"Argument `ranges` must map at least one state to its range, but it is {short(ranges)}.")
    whole("runs", runs, 1)
    confidence, accuracy = number("confidence", confidence, above=0, below=1), number("accuracy", accuracy, above=0)
    states = [loop.number(name) for name in ranges]
    for each in states:
        if not each.is_start:
            raise SceneError(f"Argument `ranges` must name states, but `{each.name}` is a number of the kind {each.kind}.")
    loop = closed_loop(loop, start=equilibrium(loop))
    names = tuple(each.name for each in states)
    ends = [each.between(given, f"box.{each.name}") for each, given in zip(states, ranges.values(), strict=True)]
    design = uniform(dict(zip(names, ends, strict=True)), runs, seed)
    point = np.array([loop.number(name).value for name in names])
    search = Search(loop, Variations((), np.zeros((1, 0)), (1,)), design, duration, None, accuracy)
    with progress_bar(runs, "basin") as bar:
        came, _ = search.found(bar)
    return Basin(
        title=loop.title, names=names, units=tuple(each.unit for each in states), ranges=np.array(ends), equilibrium=point, initial_states=design.points,
        outcomes=came, smallest_disturbances=_smallest(search, point, np.array(ends), design.points, came), duration=search.duration, accuracy=accuracy,
        confidence=confidence, judged_runs=search.judged, display_units=asked_units(ends),
        situation=str(Situation.of(loop, "smooth running disturbed within the box", f"{search.duration:.4g} s, carried on until the regime is decided")),
    )  # fmt: skip


def _smallest(search: Search, point: FloatArray, ranges: FloatArray, starts: FloatArray, outcomes: Any) -> FloatArray:
    """Where the working point is just tipped on the way to the nearest start that tips it."""
    tips = np.flatnonzero((outcomes != SMOOTH) & (outcomes != NONE))
    if not tips.size:
        return np.full(point.size, math.nan)
    if search.alike is not None and search.alike.rate > 0:  # any disturbance grows
        return point
    sizes = np.linalg.norm((starts[tips] - point) / (ranges[:, 1] - ranges[:, 0]), axis=1)
    nearest = starts[tips[int(np.argmin(sizes))]]

    # as many runs at once between both as stand side by side in lanes, or one after the other
    parts = SIDE_BY_SIDE if search.manner is not None and search.manner.lanes else 2

    def tipped(shares: list[float]) -> BoolArray:
        came, _, _ = search.block(point + np.array(shares)[:, None] * (nearest - point))
        return (came != SMOOTH) & (came != NONE)

    border: FloatArray = point + divided(tipped, 0.0, 1.0, parts, HALVED)[1] * (nearest - point)
    return border
