"""How far the intervals of a fit can be trusted: what its residuals look like, and what its measured inputs leave open."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.errors import SceneError, SimulationError
from toolbox.files.unit_systems import reading

COHERENT = 0.99
"""Correlation of neighbouring residuals from which on they are no noise, but a part of the motion that the model lacks."""

PARTS = 10
"""Parts of a log whose contributions to an estimate may all have one sign where residuals are such a part of the motion."""


@dataclass(frozen=True)
class Residual:
    """What the model leaves of one measured signal.

    A p-value below 0.05 says that the residual has structure: the model lacks something, or noise has a memory; intervals are widened for it.

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
        """About how many times wider than for white residuals an interval is where each residual repeats so much of the one before (AR(1))."""
        return math.sqrt((1.0 + self.correlation) / (1.0 - self.correlation)) if 0.0 < self.correlation < 1.0 else 1.0

    def deviation(self, display_units: Mapping[str, str] | None = None) -> list[str]:
        """What a report in the units of `asked` says of it where nothing was fitted."""
        read = reading(self.unit, display_units)
        return [f"  {self.signal}: rms deviation {self.rms * read.factor:.4g}{read.tail}, {100 * self.part:.2g} % of its range"]

    def lines(self, display_units: Mapping[str, str] | None = None) -> list[str]:
        """What a report in the units of `asked` says of it."""
        read = reading(self.unit, display_units)
        line = f"  residual of {self.signal}: rms {self.rms * read.factor:.4g}{read.tail}, {100 * self.part:.2g} % of its range; "
        if self.whiteness >= 0.05:
            return [line + f"white (p = {self.whiteness:.2g})"]
        found = [
            line + f"NOT white: neighbours correlate by {self.correlation:.2f}, which the intervals account for (p = {self.whiteness:.2g})"
        ]
        if self.stretch > 1.2:
            found.append(
                f"    they are about {self.stretch:.2g} times as wide as for white noise: the model lacks something (another law of friction, a lag of a "
                "sensor), or samples follow each other faster than they tell anything new: try both, and leave samples out"
            )
        return found


def begins_apart(
    residuals: Sequence[Residual], apart: Mapping[str, float], display_units: Mapping[str, str] | None, remedy: str
) -> list[str]:
    """What a report says where a simulation begins elsewhere than the machine did; apart: {signal: how far its first samples are from the model}."""
    lines = []
    for each in residuals:
        if each.signal in apart:
            read = reading(each.unit, display_units)
            lines.append(
                f"  {each.signal} begins {apart[each.signal] * read.factor:.3g}{read.tail} from the model, which begins every window at the start of the loop, "
                f"at rest unless that says otherwise: {remedy}"
            )
    return lines


def residual_of(signal: str, unit: str, left: np.ndarray, measured: np.ndarray) -> Residual:
    """The residual of one signal. left: model minus measured."""
    whiteness, correlation = portmanteau(left)
    span = float(np.ptp(measured))
    rms = float(np.sqrt(np.mean(left**2)))
    return Residual(signal, unit, rms, rms / span if span else math.nan, whiteness, correlation)


def portmanteau(left: np.ndarray) -> tuple[float, float]:
    """The p-value of whiteness (Ljung and Box 1978), and the correlation of neighbours."""
    from scipy.special import chdtrc

    n = left.size
    centred = left - left.mean()
    power = float(centred @ centred)
    lags = max(1, min(20, n // 5))
    # not @, whose threads wait for each other for longer than so short a product takes
    correlations = [float(np.einsum("i,i->", centred[i:], centred[:-i])) / power if power else 0.0 for i in range(1, lags + 1)]
    total = n * (n + 2) * sum(r * r / (n - i) for i, r in enumerate(correlations, 1))
    return float(chdtrc(lags, total)), correlations[0]


def scatter(samples: np.ndarray) -> float:
    """Deviation of the noise of samples, by the part of each sample that its two neighbours do not tell."""
    return 1.4826 * float(np.median(np.abs(np.diff(samples, 2)))) / math.sqrt(6.0)


def is_white(left: np.ndarray) -> bool:
    """Whether residuals have no structure, at the significance level 0.05."""
    return portmanteau(left)[0] >= 0.05


def step_of(measured: np.ndarray, repeats: np.ndarray) -> float:
    """The step of an encoder, where samples repeat its values; 0 of other samples. repeats: weights of the samples, below 1 of those that repeat."""
    changes = np.abs(np.diff(measured))
    return float(changes[changes > 0.0].min(initial=math.inf)) if (repeats < 1.0).any() and changes.any() else 0.0


def deviation(left: np.ndarray, repeats: np.ndarray, measured: np.ndarray) -> float:
    """Standard deviation of residuals, at least that of the steps of an encoder."""
    size = float(np.sum(repeats**2))
    return max(math.sqrt(float(np.sum((repeats * left) ** 2)) / size) if size else 0.0, step_of(measured, repeats) / math.sqrt(12.0))


def memory(left: np.ndarray) -> float:
    """How many times as wide an interval is as by white residuals of the same size; 1 where they are white, or alternate."""
    if left.size < 21 or is_white(left):
        return 1.0
    return math.sqrt(max(1.0 + 2.0 * float(autocorrelation(left)[1:].sum()), 1.0))


def correlated(jacobian: np.ndarray, weighed: np.ndarray, variance: float, has_structure: bool) -> np.ndarray:
    """J^T G J of one recording, where G is the covariance of its residuals: `variance` times one where they are white, else that of an autoregression.

    With (J^T J)^-1 on both sides it is the covariance of estimates by least squares, for any G. The order of the autoregression is that of the criterion of
    Schwarz. Where neighbours are alike to a hundredth, the residual is what the model lacks: no average over time makes it smaller, so that what the tenths of
    the log do to an estimate are taken with one sign.
    """
    from scipy.signal import fftconvolve

    size = len(jacobian)
    white = np.einsum("ni,nj->ij", jacobian, jacobian) * variance
    lags = autocorrelation(weighed) if has_structure and size > 20 else np.ones(1)
    if lags.size > 1 and lags[1] > COHERENT and size >= 20 * PARTS:
        pulls = np.stack([np.einsum("ni,n->i", jacobian[part], weighed[part]) for part in np.array_split(np.arange(size), PARTS)])
        return np.einsum("bi,bj->ij", pulls, pulls) * PARTS**2 / (PARTS - 1)
    if lags.size > 1 and 1.0 + 2.0 * lags[1:].sum() > 1.0:  # residuals that alternate would make intervals narrower
        kernel = np.concatenate([lags[:0:-1], lags])[:, None]
        smoothed = fftconvolve(jacobian, kernel, axes=0)[lags.size - 1 : lags.size - 1 + size]
        wide = np.einsum("ni,nj->ij", jacobian, smoothed) * float(np.mean(weighed[weighed != 0.0] ** 2))
        return _without_negative(0.5 * (wide + wide.T), np.sqrt(np.diag(white)))
    return white


def _without_negative(matrix: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """A symmetric matrix without its negative eigenvalues, which an autocorrelation that is cut off may leave; sizes: of its rows."""
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    values, ways = np.linalg.eigh(matrix / np.outer(sizes, sizes))
    kept: np.ndarray = (ways * np.maximum(values, 0.0)) @ ways.T * np.outer(sizes, sizes)
    return kept


def autocorrelation(left: np.ndarray) -> np.ndarray:
    """Autocorrelation (lags from 0) of the autoregression that residuals are like, its order by the criterion of Schwarz; by the recursion of Levinson."""
    centred = left - left.mean()
    n = centred.size
    power = float(centred @ centred)
    if not power:
        return np.ones(1)
    orders = min(30, n // 10)
    measured = np.array([float(np.einsum("i,i->", centred[i:], centred[: n - i])) / power for i in range(orders + 1)])
    filters, variance = [np.zeros(0)], [1.0]
    for order in range(1, orders + 1):
        before = filters[-1]
        reflection = (measured[order] - float(before @ measured[order - 1 : 0 : -1])) / variance[-1] if order > 1 else measured[1]
        if not abs(reflection) < 1.0:
            break
        filters.append(np.append(before - reflection * before[::-1], reflection))
        variance.append(variance[-1] * (1.0 - reflection**2))
    scores = [n * math.log(max(v, 1e-300)) + order * math.log(n) for order, v in enumerate(variance)]
    best = filters[int(np.argmin(scores))]
    lags = list(measured[: best.size + 1])
    while best.size and len(lags) < n and max(abs(value) for value in lags[-best.size :]) > 1e-3:
        lags.append(float(best @ np.array(lags[-1 : -best.size - 1 : -1])))
    return np.array(lags)


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
