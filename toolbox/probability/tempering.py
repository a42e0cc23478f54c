"""Draws of a posterior and its evidence, by a sequential Monte Carlo sampler: particles go from the prior to the posterior through tempered likelihoods.

At each stage the exponent of the likelihood grows until the weights of the particles leave a part of them in effect, the particles are drawn anew by their
weights, and random walks of Metropolis move them, in steps of their own covariance. All particles move at once, so that a likelihood by simulation is asked
for many runs together. Source: P. Del Moral, A. Doucet, A. Jasra (2006), doi:10.1111/j.1467-9868.2006.00553.x.

The unknowns are standard normal here: who calls takes them to the prior by its quantiles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from toolbox.arguments import FloatArray
from toolbox.errors import SimulationError
from toolbox.halving import ROUND_OFF, halved

IN_EFFECT = 0.5
"""Part of the particles that stays in effect from one stage to the next."""

ACCEPTED = 3.0
"""Moves that a particle accepts in a stage, on average."""

MOST_MOVES = 24
"""Moves tried in a stage at most."""

AIM = 0.3
"""Part of the moves that is to be accepted; the length of the steps follows it."""


@dataclass(frozen=True)
class Sampled:
    """Particles after the last stage.

    points: shape (particles, unknowns);  likelihoods: their logarithms;  evidence: logarithm of the mean likelihood under the prior;  error: standard error of
    that, as if the particles of all stages were independent;  stages: number of stages;  runs: how often the likelihood was asked.
    """

    points: FloatArray
    likelihoods: FloatArray
    evidence: float
    error: float
    stages: int
    runs: int


def tempered(
    likelihood: Callable[[FloatArray], FloatArray],
    unknowns: int,
    particles: int,
    rng: np.random.Generator,
    said: Callable[[float], None] = lambda exponent: None,
) -> Sampled:
    """Sample a posterior.

    likelihood: function of points, shape (n, unknowns), that gives logarithms, -inf where impossible;  said: called with the exponent after each stage.
    Raises SimulationError where the likelihood is zero at every point drawn from the prior.
    """
    points = rng.standard_normal((particles, unknowns))
    known = likelihood(points)
    if not np.isfinite(known).any():
        raise SimulationError("No draw of the prior gives a run with what was measured: look at the prior and at the measures.")
    exponent, evidence, variance, stages, runs, scale = 0.0, 0.0, 0.0, 0, particles, 1.0
    while exponent < 1.0:
        step = _step(known, 1.0 - exponent)
        weights, mean = _weights(known, step)
        evidence += mean
        variance += float(weights @ weights) - 1.0 / particles
        exponent = 1.0 if step >= 1.0 - exponent else exponent + step
        stages += 1
        covariance = np.atleast_2d(np.cov(points.T, aweights=weights)) + 1e-12 * np.eye(unknowns)
        chosen = np.searchsorted(np.cumsum(weights), (rng.random() + np.arange(particles)) / particles).clip(max=particles - 1)
        points, known = points[chosen], known[chosen]
        root = 2.38 / math.sqrt(unknowns) * np.linalg.cholesky(covariance)
        accepted = 0.0
        for _ in range(MOST_MOVES):
            tried = points + scale * rng.standard_normal(points.shape) @ root.T
            found = likelihood(tried)
            runs += particles
            with np.errstate(invalid="ignore"):
                ratio = exponent * (found - known) + 0.5 * (points**2 - tried**2).sum(axis=1)
            goes = np.log(rng.random(particles)) < ratio
            points, known = np.where(goes[:, None], tried, points), np.where(goes, found, known)
            accepted += goes.mean()
            scale = float(np.clip(scale * math.exp(goes.mean() - AIM), 0.02, 2.0))
            if accepted >= ACCEPTED:
                break
        said(exponent)
    return Sampled(points, known, evidence, math.sqrt(variance), stages, runs)


def _weights(known: FloatArray, step: float) -> tuple[FloatArray, float]:
    """Normalised weights of the particles for a growth of the exponent, and the logarithm of their mean."""
    logs = step * known
    top = float(logs.max())
    weights = np.exp(logs - top)
    return weights / weights.sum(), top + math.log(float(weights.mean()))


def _step(known: FloatArray, left: float) -> float:
    """By how much the exponent grows: all that is left, or as far as leaves a part of the possible particles in effect."""
    wanted = IN_EFFECT * np.isfinite(known).sum()

    def in_effect(step: float) -> float:
        weights, _ = _weights(known, step)
        return 1.0 / float(weights @ weights)

    if in_effect(left) >= wanted:
        return left
    low, _ = halved(lambda step: in_effect(step) < wanted, 0.0, left, ROUND_OFF, left * 2.0**-60)
    return max(low, 1e-12 * left)
