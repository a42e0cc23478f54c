"""What a fit found: estimates, their confidence intervals, and what the residuals say."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.arguments import BoolArray, FloatArray
from toolbox.calibration.panels import Panel
from toolbox.calibration.trust import Residual, begins_apart
from toolbox.errors import SceneError, suggest
from toolbox.files.printing import Rows, Told
from toolbox.files.results import LEFT_OUT, HeadedRows, Result
from toolbox.files.unit_systems import reading
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.hybrid_system import HybridSystem


@dataclass(frozen=True)
class Fit(Told, Result):
    """Estimates of numbers of a machine, the result of `fit`: `found["bit.friction.static"]`, `found.interval(name)`, `print(found)`, `found.plot()`.

    Attributes
    ----------
    names, units, values, standard_errors
        The estimates and their standard errors, shapes (k,).
    covariance
        Covariance of the estimates, shape (k, k).
    confidence, interval_factor
        Confidence level, and the factor of the intervals: estimate +- factor * standard error.
    residuals
        One entry per measured output.
    condition_number
        Condition number of the scaled Jacobian.
    at_bounds
        Names of numbers whose estimate is at a bound, or at the limit that another number sets.
    agreeing_starts, starts
        Number of searches that ended at this optimum, and number of all searches.
    data_description
        Description of the data.
    exact_derivatives
        Whether the derivatives of the model are exact.
    panels
        Measured and fitted values, a `Panel` for each signal.
    misfit
        The model and the data. None after loading, because a file holds no loop and no plant.
    fixed_by
        {name: reason} for numbers that cannot reach their optimum, because another number limits them.
    unidentifiable
        Names of numbers without influence while other numbers are at a limit. They have no estimate.
    sampling_errors
        Estimated error of each number due to the sampling of measured inputs, shape (k,).
    display_units
        {SI unit: unit that was typed}: the units of report and figure.
    outliers
        {signal: whether each sample is an outlier and was left out, shape (n,), for all windows in order}.
    initial_mismatch
        {signal: deviation of its first samples from the model}, if the simulation begins at another state than the
        machine.
    held
        {measured input with zero-order hold: log-likelihood with zero-order hold minus log-likelihood with linear
        interpolation}. inf if the hold was declared by the user.
    stepped
        {measured input whose jumps are at the sample behind them: log-likelihood with such jumps minus log-likelihood with
        linear interpolation}.
    indistinguishable_friction
        The friction law whose static and kinetic friction the data cannot distinguish, such as "bit.friction.". Empty
        if the data can distinguish them.

    Examples
    --------
    >>> import numpy as np
    >>> from models import BitRock, wells
    >>> from toolbox import compose, fit
    >>> speed = np.linspace(2.0, 20.0, 50)
    >>> torque = 97e3 * 0.155575 * (0.45 + 0.35 * np.exp(-0.9 * speed)) + np.random.default_rng(1).normal(0.0, 20.0, 50)
    >>> log = {"time": np.arange(50.0), "bit.speed": speed, "bit.torque": torque}
    >>> found = fit(compose(wells.JANSEN_2, BitRock(weight="97 kN")), log, ["bit.friction.kinetic"], contact="bit")
    >>> print(f"{found['bit.friction.kinetic']:.3f}, standard error {found.standard_errors[0]:.4f}")
    0.450, standard error 0.0002
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray
    standard_errors: FloatArray
    covariance: FloatArray
    confidence: float
    interval_factor: float
    residuals: tuple[Residual, ...]
    condition_number: float
    at_bounds: tuple[str, ...]
    agreeing_starts: int
    starts: int
    data_description: str
    exact_derivatives: bool
    panels: tuple[Panel, ...] = field(repr=False)
    misfit: Any = field(repr=False, metadata=LEFT_OUT)
    fixed_by: Mapping[str, str] = field(default_factory=dict)
    unidentifiable: tuple[str, ...] = ()
    sampling_errors: FloatArray = field(default_factory=lambda: np.zeros(0))
    display_units: Mapping[str, str] = field(default_factory=dict)
    outliers: Mapping[str, BoolArray] = field(default_factory=dict)
    indistinguishable_friction: str = ""
    initial_mismatch: Mapping[str, float] = field(default_factory=dict)
    held: Mapping[str, float] = field(default_factory=dict)
    stepped: Mapping[str, float] = field(default_factory=dict)

    def __getitem__(self, name: str) -> float:
        """An estimate in SI."""
        return float(self.values[self._place(name)])

    def _place(self, name: str) -> int:
        if name not in self.names:
            raise SceneError(f"There is no estimate `{name}`: {suggest(name, self.names)}")
        return self.names.index(name)

    def interval(self, name: str) -> tuple[float, float]:
        """Return the ends (low, high) of the confidence interval of an estimate.

        Parameters
        ----------
        name
            Name of the estimate, one of `names`.
        """
        i = self._place(name)
        half = self.interval_factor * self.standard_errors[i]
        return float(self.values[i] - half), float(self.values[i] + half)

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix of the estimates, shape (k, k)."""
        size = np.sqrt(np.diag(self.covariance))
        known = np.isfinite(size) & (size > 0.0)
        size[~known] = 1.0
        return np.where(np.outer(known, known), self.covariance, 0.0) / np.outer(size, size)

    @property
    def parameters(self) -> dict[str, float]:
        """Estimated parameters of the plant as {name: estimate}."""
        loop = self._machine.loop
        taken = [each.name for each in self.misfit.numbers if each.is_parameter or (each.is_input and each.name not in loop.inputs)]
        return {name: self[name] for name in taken if loop.plant.has_parameter(name)}

    @property
    def loop(self) -> ClosedLoop:
        """The loop with the estimates in place of its declared numbers, and with the measured inputs."""
        return self._machine.at(self.values)

    @property
    def _machine(self) -> Any:
        """The model; raises SceneError where there is none."""
        if self.misfit is None:
            raise SceneError(
                "This fit was read from a file, which holds its numbers alone: put them into a loop by `loop.at(name, fit[name])`."
            )
        return self.misfit

    @property
    def plant(self) -> HybridSystem:
        """The plant with the estimates in place of its declared parameters."""
        return self.loop.assembly.plant.with_parameters(self.parameters)

    @property
    def white(self) -> bool:
        """Whether the test for structure in the residuals finds none in any of them, at the significance level 0.05."""
        return all(residual.whiteness >= 0.05 for residual in self.residuals)

    def _told(self) -> list[str | Rows]:
        interval = f"{100 * self.confidence:g} %"
        return [
            f"Fit of {len(self.names)} number(s) to {self.data_description}",
            f"{self.agreeing_starts} of {self.starts} start(s) end here; intervals of {interval}",
            "",
            Rows(self._rows(), range(5), headings=("name", "estimate", f"interval of {interval}", "unit", "")),
            "",
            *self._remarks(),
        ]

    __repr__ = Told.__str__

    def _rows(self) -> list[list[str]]:
        """(name, estimate, interval, unit, relative deviation)."""
        rows = []
        for i, (name, unit) in enumerate(zip(self.names, self.units, strict=True)):
            low, high = self.interval(name)
            factor, unit = reading(unit, self.display_units)
            shown = "" if unit == "1" else unit
            if name in self.unidentifiable:
                rows.append([name, "undetermined", "none", shown, ""])
            elif name in self.at_bounds:
                rows.append([name, f"{self.values[i] * factor:.6g}", "none", shown, "at its bound"])
            else:
                part = f"deviation {100 * self.standard_errors[i] / abs(self.values[i]):.2g} %" if self.values[i] else "-"
                rows.append([name, f"{self.values[i] * factor:.6g}", f"{low * factor:.6g} .. {high * factor:.6g}", shown, part])
        return rows

    def _remarks(self) -> list[str]:
        """What the residuals say, and what to know about the estimates."""
        lines: list[str] = []
        for left in self.residuals:
            lines += left.lines(self.display_units)
        lines += begins_apart(self.residuals, self.initial_mismatch, self.display_units, "free the start values of its states")
        for name, gain in self.held.items():
            why = (
                "as declared"
                if gain == np.inf
                else f"as the data say (log-likelihood {gain:+.3g}; `zero_order_hold=()`, or --zero-order-hold none, draws straight lines)"
            )
            lines.append(f"  {name} is held between its samples, {why}")
        lines += [
            f"  {name} jumps at its samples, and is a straight line between all others, as the data say (log-likelihood {gain:+.3g}; "
            "`zero_order_hold=()`, or --zero-order-hold none, draws straight lines)"
            for name, gain in self.stepped.items()
        ]
        if len(self.names) > 1:
            i, k = max(itertools.combinations(range(len(self.names)), 2), key=lambda pair: abs(self.correlation[pair]))
            lines.append(
                f"  condition {self.condition_number:.3g}; strongest correlation {self.correlation[i, k]:+.3f}, of {self.names[i]} and {self.names[k]}"
            )
        for name in self.at_bounds:
            where = f"rests on another number, because {self.fixed_by[name]}" if name in self.fixed_by else "ended at its bound:"
            lines.append(f"  `{name}` {where} Its interval means nothing, and the optimum lies outside.".replace(": Its", ": its"))
        if self.indistinguishable_friction:
            lines.append(
                f"  `{self.indistinguishable_friction}static` and `{self.indistinguishable_friction}kinetic` are one number: "
                "the data do not tell them apart (F-test, 5 %), so friction has no decay."
            )
        lines += [f"  `{name}` has no influence {self._extent(name)}, and so no estimate." for name in self.unidentifiable]
        lines += [
            f"  {np.sum(left_out)} sample(s) of {name} break the law and were left out (`robust`)"
            for name, left_out in self.outliers.items()
        ]
        for name, shift, error in zip(self.names, self.sampling_errors, self.standard_errors, strict=True):
            if abs(shift) > self.interval_factor * error:
                lines.append(
                    f"  `{name}` is less sure than its interval says: what the measured inputs do between their samples may move it by {abs(shift):.2g}, "
                    f"{abs(shift) / (self.interval_factor * error):.1f} half-widths. Record them faster, or fit the law alone to its loop (`contact=`)."
                )
        if not self.exact_derivatives:
            lines.append("  slopes by differences, because a law in Python or an encoder has no exact ones")
        return lines

    def _extent(self, name: str) -> str:
        """Where a number has no influence, in words."""
        return "at these estimates"

    def check_loaded(self) -> None:
        """Raise ValueError if the arrays do not fit the names."""
        k = len(self.names)
        if not (self.values.shape == self.standard_errors.shape == (k,) and self.covariance.shape == (k, k) and len(self.units) == k):
            raise ValueError("its arrays do not fit to its names")

    def _table(self) -> HeadedRows:
        """One row per number: estimate, deviation and interval."""
        estimates = zip(self.names, self.units, self.values.tolist(), self.standard_errors.tolist(), strict=True)
        headings = ["name", "unit", "estimate", "standard deviation", "low", "high"]
        return headings, [[name, *rest, *self.interval(name)] for name, *rest in estimates]

    def plot(self) -> Any:
        """Draw measurement and model: time series, residuals, and the friction loop. Return the axes."""
        from toolbox.calibration.figures import fitted  # here, because matplotlib is slow to import

        return fitted(self.panels, self.display_units)
