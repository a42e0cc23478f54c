"""How far the intervals of a fit can be trusted: what its residuals look like, and what its measured inputs leave open."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.errors import SceneError, SimulationError
from toolbox.files.unit_systems import reading


@dataclass(frozen=True)
class Residual:
    """What the model leaves of one measured signal.

    A p-value below 0.05 says that the residual has structure: the model lacks something, and intervals are too narrow.

    Attributes
    ----------
    signal, unit
        The signal and its unit.
    rms
        Root mean square, in that unit.
    part
        Its part of the measured range [1].
    whiteness
        The p-value of whiteness (Ljung and Box 1978).
    correlation
        Correlation of neighbours [1].
    """

    signal: str
    unit: str
    rms: float
    part: float
    whiteness: float
    correlation: float

    @property
    def stretch(self) -> float:
        """About how many times wider the intervals would have to be: as where each residual repeats so much of the one before (AR(1))."""
        return math.sqrt((1.0 + self.correlation) / (1.0 - self.correlation)) if 0.0 < self.correlation < 1.0 else 1.0

    def lines(self, asked: Mapping[str, str] | None = None) -> list[str]:
        """What a report in the units of `asked` says of it."""
        read = reading(self.unit, asked)
        line = f"  residual of {self.signal}: rms {self.rms * read.factor:.4g}{read.tail}, {100 * self.part:.2g} % of its range; "
        if self.whiteness >= 0.05:
            return [line + f"white (p = {self.whiteness:.2g})"]
        found = [
            line + f"NOT white: neighbours correlate by {self.correlation:.2f}, so intervals are too narrow (p = {self.whiteness:.2g})"
        ]
        if self.stretch > 1.2:
            found.append(
                f"    they would have to be about {self.stretch:.2g} times as wide: the model lacks something (another law of friction, a lag of a sensor), "
                "or samples follow each other faster than they tell anything new: try both, and leave samples out"
            )
        return found


def residual_of(signal: str, unit: str, left: np.ndarray, measured: np.ndarray) -> Residual:
    """The residual of one signal. left: model minus measured."""
    from scipy.stats import chi2

    n = left.size
    centred = left - left.mean()
    power = float(centred @ centred)
    lags = max(1, min(20, n // 5))
    # not @, whose threads wait for each other for longer than so short a product takes
    correlations = [float(np.einsum("i,i->", centred[i:], centred[:-i])) / power if power else 0.0 for i in range(1, lags + 1)]
    portmanteau = n * (n + 2) * sum(r * r / (n - i) for i, r in enumerate(correlations, 1))
    span = float(np.ptp(measured))
    rms = float(np.sqrt(np.mean(left**2)))
    return Residual(signal, unit, rms, rms / span if span else math.nan, float(chi2.sf(portmanteau, lags)), correlations[0])


def sampling_error(misfit: Any, values: np.ndarray, jacobian: np.ndarray, scales: Mapping[str, float]) -> np.ndarray:
    """About how far the estimates are off because measured inputs are straight lines between their samples, along the columns of a Jacobian.

    Every other sample left out makes four times the error, as long as the samples follow the signal at all; the difference is three times that of all.
    """
    coarse = misfit.thinned()
    if coarse is None:
        return np.zeros(jacobian.shape[1])
    try:
        fine, rough = misfit.model(values), coarse.model(values)
    except (SceneError, SimulationError):  # of the coarse inputs
        return np.full(jacobian.shape[1], math.inf)
    moved = np.concatenate([(rough[name] - fine[name]) / scales[name] for name in misfit.outputs])
    return np.linalg.lstsq(jacobian, moved, rcond=None)[0] / 3.0
