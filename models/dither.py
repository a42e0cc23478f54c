"""Friction as a slow motion feels it under fast dither along the slip."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from toolbox import FrictionLaw, SceneError


def averaged_friction(law: FrictionLaw, speed: float, amplitude: float) -> float:
    """Mean coefficient of friction against a slip v + B sin t, (1 / 2 pi) int mu(v + B sin t) dt over a period, with the sign of v.

    speed: v, the mean slip;  amplitude: B >= 0, the velocity amplitude of the dither, in the unit of v. Dry friction that turns round with the
    slip becomes a drag: Coulomb's law gives mu_k (2 / pi) arcsin(v / B) for |v| < B and mu_k beyond, the bound at rest plays no part.
    Range: dither so fast that v hardly changes in a period, and the contact does not rest when the slip turns. By Gauss-Legendre
    quadrature between the turns of the slip; exact to round-off for constant friction, relative error below 1e-8 for decays up to
    about 30 / B. Raises SceneError for numbers that are not finite and B < 0. Source: textbook; J. J. Thomsen, A. Fidlin (2003).
    """
    if not math.isfinite(speed):
        raise SceneError(f"Argument `speed` must be a finite number, but it is {speed!r}.")
    if not 0 <= amplitude < math.inf:
        raise SceneError(f"Argument `amplitude` must be >= 0 and finite, but it is {amplitude!r}.")
    # sin takes every value of a period twice between -pi/2 and pi/2; the slip turns at the phase between
    turn = -math.asin(min(1.0, max(-1.0, speed / amplitude))) if amplitude > 0 else -math.copysign(math.pi / 2, speed)
    points, weights = np.polynomial.legendre.leggauss(64)
    total = 0.0
    for begin, end, sign in ((-math.pi / 2, turn, -1.0), (turn, math.pi / 2, 1.0)):
        phase = begin + (end - begin) * (points + 1) / 2
        slip = np.abs(speed + amplitude * np.sin(phase))
        coefficient = np.array(ca.evalf(ca.SX(law.sliding(ca.SX(slip))))).ravel()
        total += sign * (end - begin) / 2 * float(np.sum(weights * coefficient))
    return total / math.pi
