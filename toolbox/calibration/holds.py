"""Whether a measured input is held between its samples (zero-order hold), or is a straight line: as the data say.

A digital drive holds each command until the next one. Drawn as straight lines such an input acts half a sample too early, which a fit pays with other numbers:
the mass of an axis at 1 kHz is .1 % off. No look at the input tells which it is, but the motion does: both ways of drawing it are compared by what they leave
of the outputs, where the free numbers and the starts of all states may move to make up for it. That look is of first order, and enough where the fit with
straight lines is near the truth. Where its residuals are no noise at all, the input is fitted both ways.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from toolbox.calibration.results import Fit

EVIDENCE = 5.0
"""Difference of the log-likelihoods from which on the data tell: odds of 150 to 1."""

STRUCTURED = 0.9
"""Correlation of neighbouring residuals from which on they are no noise."""


def evidence(found: Fit, held: Any) -> float:
    """Return by how much the log-likelihood is greater with inputs held than as they were fitted.

    Parameters
    ----------
    found
        The fit with straight lines.
    held
        Its misfit with inputs held.
    """
    misfit = found.misfit
    size = np.where(found.values != 0.0, np.abs(found.values), np.maximum(found.standard_errors, 1e-300))
    ways, starts = misfit.slopes(found.values, size), misfit.start_slopes(found.values)
    models = misfit.model(found.values), held.model(found.values)
    pairs, columns, blocks = [], [], []
    for residual in found.residuals:
        name = residual.signal
        kept = ~found.outliers.get(name, np.zeros(misfit.measured[name].size, bool))
        scale = residual.rms or 1.0
        pairs.append(np.stack([(model[name] - misfit.measured[name])[kept] / scale for model in models], axis=1))
        columns.append(np.hstack([ways[name], starts[name]])[kept] / scale)
        blocks += [int(part.sum()) for part in np.split(kept, np.cumsum(misfit.blocks(name))[:-1])]
    left, basis = np.concatenate(pairs), np.concatenate(columns)
    basis = basis[:, (basis != 0.0).any(axis=0) & np.isfinite(basis).all(axis=0)]
    basis = basis / np.sqrt(np.einsum("ni,ni->i", basis, basis))
    left = left - basis @ np.linalg.lstsq(basis, left, rcond=1e-10)[0]
    return likelihood(left[:, 0], left[:, 1], blocks, found.values.size)


def fitted_evidence(found: Fit, other: Any, values: np.ndarray) -> float:
    """Return by how much the log-likelihood of another misfit at its numbers is greater than that of a fit.

    Parameters
    ----------
    found
        The fit, as with straight lines or a simpler law.
    other
        The other misfit, as with inputs held or a richer law.
    values
        Its numbers.
    """
    rows, blocks = [], [size for each in found.residuals for size in found.misfit.blocks(each.signal)]
    for misfit, numbers in ((found.misfit, found.values), (other, values)):
        model, measured = misfit.model(numbers), misfit.measured
        rows.append(np.concatenate([(model[each.signal] - measured[each.signal]) / (each.rms or 1.0) for each in found.residuals]))
    return likelihood(rows[0], rows[1], blocks, found.values.size)


def likelihood(straight: np.ndarray, other: np.ndarray, blocks: Sequence[int], numbers: int) -> float:
    """Return by how much the log-likelihood of other residuals is greater, by those samples alone that tell anything new.

    blocks: samples of each recording, whose noise is its own;  numbers: free numbers, which are the least samples of all recordings together.
    """
    ends = np.cumsum(blocks)[:-1]
    gains = np.array([_likelihood(*pair) for pair in zip(np.split(straight, ends), np.split(other, ends), strict=True)])
    return float(gains[:, 0] @ gains[:, 1]) * max(1.0, numbers / max(float(gains[:, 0].sum()), 1e-300))


def _likelihood(straight: np.ndarray, other: np.ndarray) -> tuple[float, float]:
    """(samples that tell anything new, logarithm of the ratio of both residuals)."""
    powers = [float(np.einsum("n,n->", row, row)) for row in (straight, other)]
    best = other if powers[1] < powers[0] else straight
    correlation = min(max(float(np.einsum("n,n->", best[1:], best[:-1])) / min(powers), 0.0), 1.0) if min(powers) else 0.0
    samples = best.size * (1.0 - correlation) / (1.0 + correlation)
    return samples, 0.5 * math.log(max(powers[0], 1e-300) / max(powers[1], 1e-300))
