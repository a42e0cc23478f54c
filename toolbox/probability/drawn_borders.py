"""From which set-point on a machine is free of stick-slip, where its numbers are known as distributions only.

    found = uncertain_onset(loops, "top.reference", ("40 rpm", "140 rpm"), {"bit.weight": "97 kN +- 8 kN"})
    print(found); found.lowest(0.95)

Each draw is a machine with a border of its own: started as its loop starts, it sticks and slips below it and is free above. All draws are halved to their
borders together, in lanes and by the judge of all verdicts, as those of `chance`, to a finer step than a grid of set-points has. The border that is not
passed by 95 % of all machines is told with the bound that holds for 95 % of all samples of draws, from order statistics. Beside it stands where each machine
loses smooth running.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray, number, short, whole
from toolbox.errors import SceneError, SimulationError
from toolbox.files.printing import Rows, Told
from toolbox.files.results import HeadedRows, Result
from toolbox.files.tables import heading
from toolbox.files.unit_systems import asked_units, reading
from toolbox.files.units import NumberOrText
from toolbox.messages import progress_bar
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.numbers import put_all
from toolbox.onsets.map_loop import SMOOTH, SWING
from toolbox.probability.bounds import clopper_pearson, least_draws
from toolbox.probability.chances import Search, begun, begun_in_words, labelled, start_of_draws
from toolbox.probability.distributions import Draws, drawn, known_as
from toolbox.probability.pictures import picture
from toolbox.robustness.starts import Start
from toolbox.scenes.situation import Situation
from toolbox.steady_states.hopf import hopf_points
from toolbox.sweeps.designs import grid
from toolbox.vocabulary import new_names_only

BEGINS = 0.02
"""Share of the range to which the borders are halved where nobody says."""


@dataclass(frozen=True)
class UncertainOnset(Told, Result):
    """Borders of stick-slip for random machines, the result of `uncertain_onset`: `print(found)`, `found.lowest(0.95)`, `found.plot()`.

    Attributes
    ----------
    title
        Name of the machine.
    name, unit
        The number whose border is searched, such as the set-point, and its unit.
    bounds
        Range that was searched, in SI.
    uncertainty
        {name: description of its distribution}.
    names, points
        The drawn numbers, in SI, shape (draws, names).
    onset_values
        {label of the controller: value above which the machine of each draw is free of stick-slip, shape (draws,)}.
        -inf if the machine is free in the whole range, inf if it is not free at the end of the range.
    smooth_running_limits
        {label of the controller: highest value at which the machine of each draw loses smooth running, shape (draws,)}.
        nan if smooth running is not lost within the range, or if the loop cannot be linearised.
    tolerance
        Width at which the bisection of the borders ended.
    undecided_runs
        {label of the controller: number of undecided runs}. These runs count as stick-slip.
    duration, accuracy
        Length [s] and accuracy of a run.
    confidence
        Confidence level of the bounds.
    display_units
        {SI unit: unit that was typed}.
    situation
        The situation for which the borders hold, in one line.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.probability import uncertain_onset
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock()), SoftTorque())
    >>> found = uncertain_onset(loop, "top.reference", ("40 rpm", "140 rpm"), {"bit.weight": "60 kN +- 5 kN"}, draws=80, num_values=5)
    >>> print({name: round(correlation, 1) for name, correlation in found.moved_by("as it is").items()})
    {'bit.weight': 1.0}
    """

    title: str
    name: str
    unit: str
    bounds: tuple[float, float]
    uncertainty: dict[str, str]
    names: tuple[str, ...]
    points: np.ndarray
    onset_values: dict[str, np.ndarray]
    smooth_running_limits: dict[str, np.ndarray]
    tolerance: float
    undecided_runs: dict[str, int]
    duration: float
    accuracy: float
    confidence: float
    display_units: Mapping[str, str] = field(default_factory=dict)
    situation: str = ""

    def lowest(self, free: float = 0.95) -> dict[str, float]:
        """Return for each controller the lowest value that is free of stick-slip with a given probability.

        At this value the lower confidence bound of the probability, and not only the fraction of the draws, is at least
        `free`.

        Parameters
        ----------
        free
            The probability, by default 0.95.

        Returns
        -------
        dict
            {label of the controller: value}. inf if there is no such value within the range.

        Raises
        ------
        SceneError
            If the number of draws is too small to show this probability even if all of them are free.
        """
        free = number("free", free, above=0, below=1)
        least = least_draws(free, self.confidence)
        draws = len(self.points)
        if draws < least:
            raise SceneError(f"Argument `free` must be within what {draws} draws can show, but {free:g} takes at least {least} draws.")
        _, upper = clopper_pearson(np.arange(draws + 1), np.arange(draws + 1), draws, self.confidence)
        most = int(np.flatnonzero(upper <= 1.0 - free)[-1])  # machines that may be in stick-slip
        return {label: float(max(np.sort(values)[draws - 1 - most], self.bounds[0])) for label, values in self.onset_values.items()}

    def moved_by(self, label: str) -> dict[str, float]:
        """Return {drawn number: rank correlation with the border of a controller}, the strongest correlation first.

        The correlation is nan if the border does not vary. `label` is the label of the controller.

        Parameters
        ----------
        label
            Label of the controller.
        """
        from scipy.stats import spearmanr

        borders, found = self.onset_values[label], {}
        for name, column in zip(self.names, self.points.T, strict=True):
            vary = np.unique(borders).size > 1 and np.unique(column).size > 1
            found[name] = float(spearmanr(column, borders).statistic) if vary else math.nan
        return dict(sorted(found.items(), key=lambda pair: -abs(np.nan_to_num(pair[1]))))

    def _told(self) -> list[str | Rows]:
        read = reading(self.unit, self.display_units)
        low, high = (each * read.factor for each in self.bounds)
        lines: list[str | Rows] = [
            f"Onset of stick-slip over {self.name} from {low:.4g} to {high:.4g}{read.tail}: {self.title}, {len(self.points)} draws, "
            f"runs of {self.duration:.4g} s at accuracy {self.accuracy:g}",
            *([f"  {self.situation}"] if self.situation else []),
            *(f"  {name} known as {words}" for name, words in self.uncertainty.items()),
        ]
        shows = len(self.points) >= least_draws(0.95, self.confidence)
        lowest = self.lowest() if shows else dict.fromkeys(self.onset_values, math.nan)
        rows: list[tuple[str, ...]] = [
            ("controller", f"free with 95 % from [{read.unit}]", "median", "5 % .. 95 %", "smooth running lost", "moves with")
        ]
        for label, borders in self.onset_values.items():
            ends = np.quantile(borders, (0.05, 0.95), method="inverted_cdf") * read.factor
            smooth = self.smooth_running_limits[label][np.isfinite(self.smooth_running_limits[label])] * read.factor
            lost = f"{np.quantile(smooth, 0.05):.4g} .. {np.quantile(smooth, 0.95):.4g}" if smooth.size > len(borders) / 2 else "-"
            moved = ", ".join(f"{name} {each:+.2f}" for name, each in list(self.moved_by(label).items())[:2] if math.isfinite(each)) or "-"
            first = "-" if not shows else self._border(lowest[label] * read.factor)
            middle = self._border(float(np.quantile(borders, 0.5, method="inverted_cdf")) * read.factor)
            rows.append((label, first, middle, " .. ".join(map(self._border, ends.tolist())), lost, moved))
        lines.append(Rows(rows, left=(0, 5)))
        if not shows:
            lines.append(f"  no set-point can be shown to be free with 95 % by fewer than {least_draws(0.95, self.confidence)} draws")
        lines += [
            f"  {label}: {count} runs of which nobody knows count as stick-slip" for label, count in self.undecided_runs.items() if count
        ]
        return lines

    __repr__ = Told.__str__

    @staticmethod
    def _border(value: float) -> str:
        return "below" if value == -math.inf else "none" if value == math.inf else f"{value:.4g}"

    def _table(self) -> HeadedRows:
        """One row per draw."""
        headings = [*self.names]
        values = [*self.points.T]
        for label, borders in self.onset_values.items():
            headings += [heading(f"{label} free from", self.unit), heading(f"{label} smooth running lost", self.unit)]
            values += [borders, self.smooth_running_limits[label]]
        return headings, np.stack(values, axis=1).tolist()

    plot = picture("onset_diagram", "Draw for each controller the probability of no stick-slip over the set-point, with its bounds")

    def check_loaded(self) -> None:
        """Raise ValueError if the loaded arrays do not fit together."""
        rows = [*self.onset_values.values(), *self.smooth_running_limits.values()]
        if self.points.shape[1:] != (len(self.names),) or any(each.shape != (len(self.points),) for each in rows):
            raise ValueError("its arrays do not fit together")


@new_names_only
def uncertain_onset(
    loop: ClosedLoop | HybridSystem | Mapping[str, ClosedLoop],
    parameter: str,
    bounds: tuple[NumberOrText, NumberOrText],
    uncertainty: Mapping[str, Any] | Draws,
    *,
    draws: int = 200,
    num_values: int = 13,
    tolerance: NumberOrText | None = None,
    starts: Start | None = None,
    accuracy: float = 1e-4,
    confidence: float = 0.95,
    seed: int = 0,
) -> UncertainOnset:
    """Find the set-point above which a machine is free of stick-slip, if some of its numbers are uncertain and known as distributions.

    A run begins as `starts` says, by default at the start of its loop, for example from rest with a bit that sticks.
    Between neighbouring values of the set-point a machine is assumed to have at most one border.

    Parameters
    ----------
    loop
        A loop, a plant, or {label: loop}.
    parameter
        Name of the set-point. Stick-slip lies below its border.
    bounds
        Range (low, high) of the set-point, in SI or text with units.
    uncertainty
        {name: distribution} of independent numbers, each `Normal`, `Uniform`, `LogNormal`, or text such as "97 kN +-
        8 kN" with the standard deviation of a normal distribution. Or `Draws` of numbers that are known together.
    draws
        Number of machines, the same for all controllers, by default 200. 72 draws are the least with which 95 % can be
        shown by two-sided bounds of 95 %.
    num_values
        Number of values of the range that are examined before borders are halved, >= 3, by default 13.
    tolerance
        Width to which borders are halved. By default 1/50 of the range.
    starts
        Start of the runs, as in `chance`: `FromRest()`, `SmoothRunning()`, `OwnStickSlip()` or
        `TakenOver(initial_controller)`. By default the start of the loop, which is rest if it gives no values.
    accuracy
        Target for the global error of the runs, between 1e-13 and 0.1, by default 0.0001.
    confidence
        Confidence level of the bounds, by default 0.95.
    seed
        Seed of the random numbers, by default 0.

    Returns
    -------
    UncertainOnset
        The border of every draw, and the set-point that is free of stick-slip with 95 %.

    Raises
    ------
    SceneError
        If a name is unknown, is both varied and uncertain, or the range is empty.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.probability import uncertain_onset
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock()), SoftTorque())
    >>> found = uncertain_onset(loop, "top.reference", ("40 rpm", "140 rpm"), {"bit.weight": "60 kN +- 5 kN"}, draws=80, num_values=5)
    >>> print({label: round(value, 1) for label, value in found.lowest(0.95).items()})
    {'as it is': 5.2}
    """
    loops = labelled(loop)
    first = next(iter(loops.values()))
    varied = first.number(parameter)
    low, high = varied.span(bounds)
    whole("draws", draws, 1)
    whole("num_values", num_values, 3)
    width = BEGINS * (high - low) if tolerance is None else number("tolerance", tolerance, varied.unit, above=0)
    accuracy, confidence = number("accuracy", accuracy, above=0), number("confidence", confidence, above=0, below=1)
    known = drawn(first, uncertainty, draws, seed)
    if varied.name in known.names:
        raise SceneError(f"Argument `uncertainty` must not name what is varied, but it has {short(varied.name)}.")
    looked = np.linspace(high, low, num_values)
    borders, smooth, unknown = {}, {}, {}
    searches = {
        label: Search(
            begun(each, starts), grid({varied.name: looked[::-1].tolist()}), known, None, start_of_draws(each, starts, known), accuracy
        )
        for label, each in loops.items()
    }
    longest = max(each.duration for each in searches.values())
    with progress_bar(len(loops) * draws, "onset") as bar:
        for label, search in searches.items():
            search.duration = longest
            borders[label], unknown[label] = _borders(search, known.points, looked, width)
            smooth[label] = _smooth(loops[label], varied.name, (low, high), known.names, known.points, bar)
    lasts = f"{longest:.4g} s, carried on until the regime is decided"
    return UncertainOnset(
        title=first.title, name=varied.name, unit=varied.unit, bounds=(low, high), uncertainty=known_as(uncertainty, known.names, draws),
        names=known.names, points=known.points, onset_values=borders, smooth_running_limits=smooth, tolerance=width, undecided_runs=unknown,
        duration=longest, accuracy=accuracy, confidence=confidence, display_units=asked_units((low, high)),
        situation=str(Situation.of(first, begun_in_words(first, starts), lasts, plants=f"{draws} plants with drawn numbers")),
    )  # fmt: skip


def _borders(search: Search, known: FloatArray, looked: FloatArray, width: float) -> tuple[FloatArray, int]:
    """(border of each draw, number of runs of which nobody knows); looked: values from the highest to the lowest."""
    draws = len(known)
    bad, good = np.full(draws, -math.inf), np.full(draws, math.inf)
    unknown = 0

    def free(which: Any, at: FloatArray) -> Any:
        nonlocal unknown
        came, _, _ = search.block(np.column_stack([at, known[which]]))
        unknown += int((came < SMOOTH).sum())
        return (came == SMOOTH) | (came == SWING)

    open_draws = np.arange(draws)
    for value in looked.tolist():
        if not open_draws.size:
            break
        holds = free(open_draws, np.full(open_draws.size, value))
        good[open_draws[holds]], bad[open_draws[~holds]] = value, value
        open_draws = open_draws[holds]
    while True:
        wide = np.flatnonzero(np.isfinite(bad) & np.isfinite(good) & (good - bad > width))
        if not wide.size:
            break
        middle = 0.5 * (good[wide] + bad[wide])
        holds = free(wide, middle)
        good[wide[holds]], bad[wide[~holds]] = middle[holds], middle[~holds]
    return np.where(np.isfinite(bad), good, -math.inf), unknown


def _smooth(loop: ClosedLoop, name: str, between: tuple[float, float], names: tuple[str, ...], points: FloatArray, bar: Any) -> FloatArray:
    """The highest value at which each draw loses smooth running."""
    found = np.full(len(points), math.nan)
    for k, row in enumerate(points):
        bar.update(1)
        each = put_all(loop, dict(zip(names, row.tolist(), strict=True)))
        try:
            at = [point.value for point in hopf_points(each, name, between, num_values=9)]
        except (SceneError, SimulationError):
            continue
        found[k] = max(at, default=math.nan)
    return found
