"""Chances of stick-slip over one or two numbers, with bounds: printed, drawn, saved, and asked for the lowest set-point."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray, number
from toolbox.errors import SceneError, suggest
from toolbox.files.printing import Rows, Told
from toolbox.files.results import HeadedRows, Result
from toolbox.files.unit_systems import reading
from toolbox.onsets.map_loop import NONE, STICK_SLIP, STUCK
from toolbox.probability.bounds import clopper_pearson, least_draws
from toolbox.probability.pictures import picture


@dataclass(frozen=True)
class Chance(Told, Result):
    """Probabilities of stick-slip over one or two numbers, the result of `chance`: `print(found)`, `found.plot()`, `found.chances["soft torque"]`.

    Attributes
    ----------
    title
        Title of the table.
    labels
        Names of the controllers.
    names, units, axes
        Names, units and values of the numbers that vary along the axes of all arrays.
    uncertainty
        {name: description of its distribution}.
    outcomes
        {label: outcome of each run, shape (*axes, draws)}: 0 smooth, 1 swing, 2 stick-slip, 3 stuck, -1 not known
        (`toolbox.onsets.map_loop`).
    severities
        {label: severity of each run [1], in the shape of `outcomes`}.
    duration, accuracy
        Length [s] and accuracy of a run.
    confidence
        Confidence level of the bounds.
    judged_runs
        {label: number of runs that were undecided at their end and were continued}.
    display_units
        {SI unit: unit that was typed}.
    situation
        The situation for which the verdict holds, in one line.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.probability import chance
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock()), SoftTorque())
    >>> found = chance(loop, {"top.reference": ["30 rpm"]}, {"bit.weight": "60 kN +- 10 kN"}, draws=72)
    >>> print(found.names, found.chances["as it is"].round(2))
    ('top.reference',) [0.99]
    """

    title: str
    labels: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    axes: tuple[np.ndarray, ...]
    uncertainty: dict[str, str]
    outcomes: dict[str, np.ndarray]
    severities: dict[str, np.ndarray]
    duration: float
    accuracy: float
    confidence: float
    judged_runs: dict[str, int]
    display_units: Mapping[str, str] = field(default_factory=dict)
    situation: str = ""

    @property
    def draws(self) -> int:
        """Number of draws at each point."""
        return int(next(iter(self.outcomes.values())).shape[-1])

    @property
    def chances(self) -> dict[str, FloatArray]:
        """{label: fraction of the decided runs that end in stick-slip or standstill, in the shape of the axes}. nan if no run is decided."""
        found = {}
        for label, outcomes in self.outcomes.items():
            known = (outcomes != NONE).sum(axis=-1)
            found[label] = np.where(known > 0, _troubled(outcomes) / np.maximum(known, 1), math.nan)
        return found

    @property
    def bounds(self) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Clopper-Pearson bounds of `chances`, as {label: (lower, upper)}.

        Undecided runs count as free of stick-slip for the lower bound, and as stick-slip for the upper bound.
        """
        found = {}
        for label, outcomes in self.outcomes.items():
            troubled, unknown = _troubled(outcomes), (outcomes == NONE).sum(axis=-1)
            found[label] = clopper_pearson(troubled, troubled + unknown, self.draws, self.confidence)
        return found

    @property
    def expected_severities(self) -> dict[str, FloatArray]:
        """Mean severities over the draws as {label: severity [1]}. nan if no run is decided."""
        found = {}
        for label, severities in self.severities.items():
            known = np.isfinite(severities)
            total = np.where(known, severities, 0.0).sum(axis=-1)
            found[label] = np.where(known.any(axis=-1), total / np.maximum(known.sum(axis=-1), 1), math.nan)
        return found

    def lowest(self, free: float = 0.95, name: str | None = None) -> dict[str, FloatArray]:
        """Return the lowest set-points that are free of stick-slip with a given probability.

        Parameters
        ----------
        free
            The probability, by default 0.95. The lower confidence bound must reach this probability, not only the
            fraction of the runs.
        name
            The axis that is the set-point. By default the first one.

        Returns
        -------
        dict
            {label: lowest set-point at which, and at every higher set-point that was tried, the machine is free with
            this probability}. One entry for each value of the other axis. nan if there is no such set-point.

        Raises
        ------
        SceneError
            If there is no such axis, or if the number of draws is too small to show this probability even if all of
            them are free.
        """
        free = number("free", free, above=0, below=1)
        name = self.names[0] if name is None else name
        if name not in self.names:
            raise SceneError(f"There is no axis `{name}`: {suggest(name, self.names)}")
        least = least_draws(free, self.confidence)
        if self.draws < least:
            raise SceneError(
                f"Argument `free` must be within what {self.draws} draws can show, but {free:g} takes at least {least} draws of which all are free."
            )
        place = self.names.index(name)
        axis, found = self.axes[place], {}
        order = np.argsort(axis)
        for label, (_, upper) in self.bounds.items():
            holds = np.moveaxis(upper, place, 0)[order] <= 1.0 - free
            lasting = np.logical_and.accumulate(holds[::-1], axis=0)[::-1]
            found[label] = np.where(lasting.any(axis=0), axis[order][np.argmax(lasting, axis=0)], math.nan)
        return found

    def better(self, one: str, other: str) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Compare two controllers on the same draws.

        Parameters
        ----------
        one, other
            Labels of the controllers.

        Returns
        -------
        only_one, only_other, p
            At each point: the fraction of the draws in which only the controller `one` is free of stick-slip, the
            fraction in which only the controller `other` is free, and the probability p that two equally good
            controllers differ at least this much (sign test on the draws in which they differ, McNemar's exact test).
        """
        from scipy.stats import binom

        for label in (one, other):
            if label not in self.outcomes:
                raise SceneError(f"There is no law `{label}`: {suggest(label, self.labels)}")
        a, b = self.outcomes[one], self.outcomes[other]
        known = (a != NONE) & (b != NONE)
        free = [~np.isin(each, (STICK_SLIP, STUCK)) & known for each in (a, b)]
        first, second = (free[0] & ~free[1]).sum(axis=-1), (free[1] & ~free[0]).sum(axis=-1)
        p = np.minimum(2.0 * binom.cdf(np.minimum(first, second), first + second, 0.5), 1.0)
        return first / self.draws, second / self.draws, p

    def _told(self) -> list[str | Rows]:
        read = [reading(unit, self.display_units) for unit in self.units]
        size = " x ".join(str(axis.size) for axis in self.axes)
        lines: list[str | Rows] = [
            f"Chance of stick-slip: {self.title}, {size} points with {self.draws} draws each, runs of {self.duration:.4g} s at accuracy {self.accuracy:g}",
            *([f"  {self.situation}"] if self.situation else []),
            *(f"  {name} known as {words}" for name, words in self.uncertainty.items()),
        ]
        if len(self.names) == 1:
            head = (
                "controller",
                f"{self.names[0]} [{read[0].unit}]",
                "chance",
                f"{100 * self.confidence:g} % bounds",
                "severity",
                "unknown",
            )
            lines.append(Rows([head, *self._rows()]))
        else:
            for label in self.labels:
                lines += [f"  {label}: chance in %, over {self.names[0]} [{read[0].unit}] by {self.names[1]} [{read[1].unit}]"]
                lines.append(Rows(self._grid(label), left=(), indent="    "))
        least = least_draws(0.95, self.confidence)
        if self.draws >= least:
            for label, found in self.lowest().items():
                told = ", ".join("none" if math.isnan(v) else f"{v * read[0].factor:.4g}" for v in np.atleast_1d(found).tolist())
                told += read[0].tail * bool(np.isfinite(found).any())
                beside = f", by {self.names[1]} from lowest to last" if len(self.names) > 1 else ""
                lines.append(f"  lowest {self.names[0]} that is free with 95 %, {label}: {told}{beside}")
        else:
            lines.append(f"  no set-point can be shown to be free with 95 % by fewer than {least} draws")
        return lines

    __repr__ = Told.__str__

    def _rows(self) -> list[tuple[str, ...]]:
        read = [reading(unit, self.display_units) for unit in self.units]
        rows = []
        for label, chances in self.chances.items():
            low, high = self.bounds[label]
            for place in np.ndindex(chances.shape):
                at = [f"{axis[i] * each.factor:.4g}" for axis, i, each in zip(self.axes, place, read, strict=True)]
                unknown = int((self.outcomes[label][place] == NONE).sum())
                severity = self.expected_severities[label][place]
                rows.append(
                    (label, *at, f"{chances[place]:.3f}", f"{low[place]:.3f} .. {high[place]:.3f}", f"{severity:.3g}", str(unknown))
                )
        return rows

    def _grid(self, label: str) -> list[tuple[str, ...]]:
        """The chances of a law [%] over both numbers, with those along the axes at the head and at the left."""
        ends = [
            [f"{value * reading(unit, self.display_units).factor:.4g}" for value in axis]
            for axis, unit in zip(self.axes, self.units, strict=True)
        ]
        body = [(first, *(f"{100 * chance:.1f}" for chance in row)) for first, row in zip(ends[0], self.chances[label], strict=True)]
        return [("", *ends[1]), *body]

    def _table(self) -> HeadedRows:
        """One row per law and value."""
        rows: list[list[Any]] = []
        for label, chances in self.chances.items():
            low, high, severity = *self.bounds[label], self.expected_severities[label]
            for place in np.ndindex(chances.shape):
                at = [float(axis[i]) for axis, i in zip(self.axes, place, strict=True)]
                rows.append([label, *at, *(float(each[place]) for each in (chances, low, high, severity))])
        return ["controller", *self.names, "chance", "lower", "upper", "severity"], rows

    plot = picture(
        "chance_diagram",
        "Draw the probabilities of stick-slip: for two numbers one panel per controller, for one number curves with bounds",
    )

    def check_loaded(self) -> None:
        """Raise ValueError if the loaded arrays do not fit together."""
        size = tuple(axis.size for axis in self.axes)
        shapes = {each.shape for each in (*self.outcomes.values(), *self.severities.values())}
        labels = set(self.labels)
        if len(shapes) != 1 or next(iter(shapes))[:-1] != size or {*self.outcomes} != labels or {*self.severities} != labels:
            raise ValueError("its arrays do not fit together")


def _troubled(outcomes: np.ndarray) -> np.ndarray:
    """How many of the draws stick and slip, or stand."""
    return np.isin(outcomes, (STICK_SLIP, STUCK)).sum(axis=-1)
