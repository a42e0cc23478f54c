"""Weights of the samples of a fit: none of those that break the law, one for all that repeat each other."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

FEW = 0.05
"""Part of a signal, at most, that may break its law: where more does, the law is wrong, and all samples count."""

MOST = 3.0
"""Weight, at most, of a sample that is known in another way than by measuring it: it is told by ten samples or so."""


def alike(one: np.ndarray, two: np.ndarray) -> bool:
    """Whether weights of samples leave out the same ones and are the same but for a hundredth."""
    return np.array_equal(one == 0.0, two == 0.0) and bool(np.all(np.abs(one - two) <= 0.01 * two))


def rows_of(sizes: Sequence[int]) -> list[slice]:
    """Places of the samples of each recording among those of a signal."""
    ends = np.cumsum([0, *sizes]).tolist()
    return [slice(*pair) for pair in itertools.pairwise(ends)]


def repeats_of(measured: np.ndarray, sizes: Sequence[int]) -> np.ndarray:
    """Weights of samples, of which n in a row that are equal count as one: the error of an encoder at rest stays the same."""
    weights = np.ones(measured.size)
    for rows in rows_of(sizes):
        edges = np.flatnonzero(np.diff(measured[rows], prepend=np.nan, append=np.nan))
        lengths = np.diff(edges)
        weights[rows] = np.repeat(1.0 / np.sqrt(lengths), lengths)
    return weights


def trusted(
    misfit: Any, name: str, left: np.ndarray, size: float, robust: float | None, given_noise: Mapping[str, float] | None
) -> np.ndarray:
    """Weights of the samples of a signal: none of those that break the law, and of those whose deviation is known otherwise that of the noise by it.

    These scatter more than they were thought to where their own residuals say so, by the ratio of Birge, with few of them by that of Student.
    """
    from scipy.special import ndtri, stdtrit

    given, weights, deviation = misfit.deviations(name), np.ones(left.size), 1e-6 * size
    own = np.isfinite(given)
    least = deviation
    for rows in rows_of(misfit.blocks(name)):
        deviation = least
        for group in (~own[rows], own[rows]):
            if not group.any():
                continue
            away = np.abs(left[rows][group])
            noise, deviation = deviation, max(1.4826 * float(np.median(away)), deviation)
            weights[rows][group] = away <= (robust or math.inf) * deviation
        if 1.0 - np.mean(weights[rows] > 0.0) > FEW:
            weights[rows] = 1.0
    if own.any():
        noise = noise if given_noise is None else given_noise[name]
        known = np.hypot(given[own], max(float(np.median(given[own])), 1e-6 * size)) / math.sqrt(
            2.0
        )  # each is itself known to its size only
        parts, count = (left[own] / known)[weights[own] > 0.0], int(weights[own].sum())
        scatter = float(parts @ parts) / (count - 1) * float(stdtrit(count - 1, 0.975) / ndtri(0.975)) ** 2 if count > 1 else 1.0
        weights[own] *= np.minimum(noise / (known * math.sqrt(max(scatter, 1.0))), MOST)
    return weights
