"""Zeros of the equations of a steady state: by Newton's steps from nearby, or by a search from afar."""

from __future__ import annotations

from typing import Any

import numpy as np

CONTRACTION = 0.1
"""Part of a residual that a step of Newton leaves at most where the zero it goes to is near."""


def newton(equations: Any, slopes: Any, x: np.ndarray, most: int, contraction: float) -> np.ndarray:
    """Go towards a zero of equations by Newton's steps, as long as they lead there.

    Parameters
    ----------
    equations, slopes
        Functions of x that give the residual and its Jacobian.
    x
        Where the steps begin, shape (n,).
    most
        Largest number of steps.
    contraction
        Part of the residual that a step may leave at most; below 1 steps go only towards a zero that stands alone.

    Returns
    -------
    array, shape (n,)
        Where the last step that was taken has led.
    """
    residual = equations(x)
    for _ in range(most):
        matrix = slopes(x)
        if not (np.isfinite(matrix).all() and np.isfinite(residual).all()):
            break
        step, _, rank, _ = np.linalg.lstsq(matrix, -residual, rcond=1e-13)
        following = equations(x + step)
        if not (np.isfinite(step).all() and np.abs(following).sum() <= contraction * np.abs(residual).sum()):
            break
        if contraction < 1.0 and rank < x.size:
            break
        x, residual = x + step, following
    return x


def searched(equations: Any, slopes: Any, begin: np.ndarray, method: str) -> np.ndarray:
    """Where equations are zero by a search from afar; a plant in stick has more equations than states: its constraints repeat rows of the flow."""
    from scipy.optimize import root

    return newton(equations, slopes, root(equations, begin, jac=slopes, method=method, options={"xtol": 1e-14}).x, 4, 1.0)


def vanishes(residual: np.ndarray, size: np.ndarray) -> bool:
    """Whether a residual is the round-off of terms of that size."""
    return bool(np.isfinite(residual).all() and (np.abs(residual) <= 1e-9 * size + 1e-13 * size.max()).all())
