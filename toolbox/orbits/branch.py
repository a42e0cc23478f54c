"""A branch of cycles over a parameter as a result: cycles, stability, the points at which their kind changes, and the bifurcation diagram."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.arguments import BoolArray, FloatArray
from toolbox.files.unit_systems import reading
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.orbits.orbit import Cycle
from toolbox.vocabulary import Renamed


@dataclass(frozen=True)
class Bifurcation:
    """Point of a branch of limit cycles at which the stability or the sequence of switches of the cycle changes.

    Attributes
    ----------
    kind
        Kind of the bifurcation, such as "fold".
    value
        Value of the parameter.
    cycle
        The cycle at this point. If the sequence of switches changes, the last cycle before the change.

    Examples
    --------
    >>> from models import oscillators
    >>> from toolbox import compose, follow, limit_cycle
    >>> cycle = limit_cycle(compose(oscillators.THOMSEN_FIDLIN), settle="200 s")
    >>> branch = follow(cycle, "block.belt_speed", (0.1, 0.6), start_towards=0.6)
    >>> for point in branch.bifurcations:
    ...     print(f"{point.kind} at {point.value:.3f} m/s")
    Hopf at 0.441 m/s
    """

    kind: str
    value: float
    cycle: Cycle

    def __str__(self) -> str:
        return f"{self.kind} at {self.value:.9g}, period {self.cycle.period:.6g} s"


@dataclass
class Branch(Renamed):
    """Limit cycles along a parameter, the result of `follow`: `branch.values`, `branch.periods`, `branch.stable`, `branch.plot("bit.speed")`.

    Attributes
    ----------
    parameter, unit
        Name and unit of the parameter.
    values
        Values of the parameter, shape (points,).
    cycles
        One `Cycle` per value.
    bifurcations
        Points at which the kind of the cycle changes.
    stop_reason
        Reason for the end of the branch.
    display_units
        {SI unit: unit that was typed}: the units of report and figure.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, follow, limit_cycle
    >>> cycle = limit_cycle(compose(BlockOnBelt()), settle="60 s")
    >>> branch = follow(cycle, "block.belt_speed", (0.1, 0.4), points=3)
    >>> print(f"{branch.periods[0]:.2f} s at {branch.values[0]:.2f} m/s, all stable: {branch.stable.all()}")
    12.00 s at 0.20 m/s, all stable: True
    """

    parameter: str
    unit: str
    values: list[float] = field(default_factory=list)
    cycles: list[Cycle] = field(default_factory=list)
    bifurcations: list[Bifurcation] = field(default_factory=list)
    stop_reason: str = ""
    display_units: Mapping[str, str] = field(default_factory=dict)

    @property
    def loop(self) -> ClosedLoop:
        """The loop of the first cycle. `branch.cycles[i].loop` is the loop with the value of the parameter of cycle i."""
        return self.cycles[0].loop

    @property
    def periods(self) -> FloatArray:
        """Period of every cycle [s], shape (points,)."""
        return np.array([cycle.period for cycle in self.cycles])

    @property
    def stable(self) -> BoolArray:
        """For each cycle: whether it is stable, shape (points,)."""
        return np.array([cycle.stable for cycle in self.cycles])

    def extremes(self, signal: str) -> FloatArray:
        """Return the smallest and the largest value of a signal over each cycle, shape (points, 2).

        Parameters
        ----------
        signal
            Name of a scalar signal, such as "block.speed".
        """
        return np.array([cycle.extremes(signal) for cycle in self.cycles])

    def plot(self, signal: str | None = None, ax: Any = None) -> Any:
        """Draw the bifurcation diagram: the largest and the smallest value of a signal over the parameter.

        Lines of stable cycles are solid, lines of unstable cycles are dashed, and bifurcations are marked.

        Parameters
        ----------
        signal
            Name of a scalar signal. By default the signal that the loop judges, else the most important signal.
        ax
            Axes to draw into. By default a new figure.

        Returns
        -------
        Axes
            The axes.

        Raises
        ------
        SceneError
            If the signal is unknown or a vector.
        """
        import matplotlib.pyplot as plt

        from toolbox.figures.style import LINES, name_axis, place_words

        signal = signal or self.cycles[0].main_signal
        if ax is None:
            _, ax = plt.subplots(figsize=(5.2, 3.6), layout="constrained")
        values, ends, stable = np.array(self.values), self.extremes(signal), self.stable
        color = LINES[0]["color"]
        cuts = [0, *(np.flatnonzero(np.diff(stable.astype(int))) + 1).tolist(), values.size]
        labels = set()
        for a, b in itertools.pairwise(cuts):
            piece = slice(max(a - 1, 0), b)
            word = "stable" if stable[a] else "unstable"
            for side in (0, 1):
                style = {"linestyle": "-", "linewidth": 1.6} if stable[a] else {"linestyle": (0, (4, 2)), "linewidth": 1.2}
                ax.plot(values[piece], ends[piece, side], color=color, label=None if word in labels else word, **style)
                labels.add(word)
        markers = {"fold": "o", "period doubling": "s", "Neimark-Sacker": "D", "grazing": "v", "grazing-sliding": "v", "crossing-sliding": "X",
                   "adding-sliding": "^", "switching-sliding": ">", "Hopf": "P"}  # fmt: skip
        for point in self.bifurcations:
            low, high = point.cycle.extremes(signal)
            label = None if point.kind in labels else point.kind
            labels.add(point.kind)
            ax.plot([point.value] * 2, [low, high], markers[point.kind], color=LINES[1]["color"], markersize=5.5, markeredgecolor="0.1",
                    markeredgewidth=0.6, linestyle="none", label=label, zorder=4)  # fmt: skip
        name_axis(ax.xaxis, place_words(self.parameter), self.unit, self.display_units)
        name_axis(
            ax.yaxis, f"{place_words(signal)}, smallest and largest", self.cycles[0].run.unit(signal), self.cycles[0].run.display_units
        )
        ax.legend(frameon=False)
        return ax

    def __str__(self) -> str:
        factor, unit = reading(self.unit, self.display_units)
        lines = [
            f"{len(self.values)} cycles, {self.parameter} from {min(self.values) * factor:.6g} to {max(self.values) * factor:.6g} {unit}: "
            f"{int(self.stable.sum())} stable, {int((~self.stable).sum())} unstable; {self.stop_reason}"
        ]
        return "\n".join(
            [
                *lines,
                *(f"  {point.kind} at {point.value * factor:.9g} {unit}, period {point.cycle.period:.6g} s" for point in self.bifurcations),
            ]
        )
