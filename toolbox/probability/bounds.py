"""Bounds of a probability that is known by runs only."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from toolbox.arguments import FloatArray


def clopper_pearson(low: Any, high: Any, runs: Any, confidence: float) -> tuple[FloatArray, FloatArray]:
    """Two-sided bounds of a probability by Clopper and Pearson.

    Parameters
    ----------
    low, high
        Number of runs with the outcome, without and with those of which nobody knows; arrays of one shape.
    runs
        Number of runs.
    confidence
        Such as 0.95.

    Returns
    -------
    lower, upper
        The bounds: each is passed by the true probability with half of 1 - confidence at most.

    Source: C. J. Clopper, E. S. Pearson (1934), doi:10.1093/biomet/26.4.404.
    """
    from scipy.stats import beta

    low, high, runs = np.asarray(low, float), np.asarray(high, float), np.asarray(runs, float)
    tail = (1.0 - confidence) / 2.0
    with np.errstate(invalid="ignore"):
        lower = np.where(low > 0, beta.ppf(tail, low, runs - low + 1.0), 0.0)
        upper = np.where(high < runs, beta.ppf(1.0 - tail, high + 1.0, runs - high), 1.0)
    return lower, upper


def least_draws(free: float, confidence: float) -> int:
    """Number of draws, all of them free, by which a probability is shown with two-sided bounds."""
    return math.ceil(math.log((1.0 - confidence) / 2.0) / math.log(free))
