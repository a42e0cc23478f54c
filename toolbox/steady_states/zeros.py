"""Zeros of the equations of a steady state: by Newton's steps from nearby, or by a search from afar."""

from __future__ import annotations

from typing import Any

import numpy as np

CONTRACTION = 0.1
"""Part of a residual that a step of Newton leaves at most where the zero it goes to is near."""

NEARER = 1.0 - 2.0**-52
"""Part of a residual that a step leaves at most where it comes nearer at all."""

ACROSS = 1e3
"""Part of a residual that a step of Newton leaves at most on the way across the kink of a limit, behind which the next one leads to the zero."""

SHORTEST = 1e-7
"""Part of the way from an open limit to a closed one below which a step is not worth its time."""


def newton(equations: Any, slopes: Any, x: np.ndarray, most: int, contraction: float, alone: bool = False) -> np.ndarray:
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
    alone
        Whether there are as many equations as unknowns and none follows from others: least squares, which serve all, take ten times as long for the 101 of
        the Hopf point of 16 inertias.

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
        try:
            step, rank = (np.linalg.solve(matrix, -residual), x.size) if alone else np.linalg.lstsq(matrix, -residual, rcond=1e-13)[::2]
        except np.linalg.LinAlgError:
            break
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


def past_limits(equations: Any, slopes: Any, held_back: Any, shares: int, begin: np.ndarray, method: str) -> np.ndarray:
    """Where equations with limits are zero, by way of their zero without limits: behind a limit nothing has a slope that leads back.

    Limits that hold nothing back at that zero, such as those of a rate, stay open. The others are closed, and the zero is followed; then those are closed
    that hold something back now.

    Parameters
    ----------
    equations, slopes
        Functions of x and of the shares of the limits, which are 1 where a limit is open and 0 where it is as declared.
    held_back
        Function of x and the shares that gives what each limit holds back.
    shares
        Number of limits.
    begin
        Where the search without limits begins.
    method
        Method of that search.
    """
    share = np.ones(shares)

    def at(share: np.ndarray) -> tuple[Any, Any]:
        return lambda x: equations(x, share), lambda x: slopes(x, share)

    x = searched(*at(share), begin, method)
    for _ in range(shares):
        gaps = held_back(x, share)
        shut = (np.abs(gaps) > 1e-9 * np.abs(gaps).max(initial=0.0)) & (share == 1.0)
        if not (np.isfinite(x).all() and shut.any()):
            break
        part, step = 1.0, 0.5
        while part > 0.0 and step > SHORTEST:
            following = max(part - step, 0.0)
            rows, matrix = at(np.where(shut, following, share))
            y = newton(rows, matrix, x, 20, ACROSS)
            there = matrix(y)
            if vanishes(rows(y), np.abs(there) @ np.abs(y) + 1e-300, there, y.size):
                x, part, step = y, following, 2.0 * step
            else:
                step *= 0.25
        share = np.where(shut, part, share)
        if part > 0.0:
            break
    return x


def contradictory(equations: Any, slopes: Any, x: np.ndarray) -> bool:
    """Return whether the linear equations among the given equations contradict one another. Then no zero exists anywhere.

    What a linear row is at any other place its slope tells; it is asked at places of both signs and of all sizes.

    Parameters
    ----------
    equations, slopes
        Functions of x that give the residual and its Jacobian.
    x
        Any place, shape (n,).
    """
    residual, matrix = equations(x), slopes(x)
    size = np.abs(x) + np.abs(x).max(initial=1e-3)
    signs = np.where(np.arange(x.size) % 2, 1.0, -1.0)
    linear = np.isfinite(matrix).all(axis=1) & np.isfinite(residual)
    matrix, residual = np.where(linear[:, None], matrix, 0.0), np.where(linear, residual, 0.0)
    for move in (-2.0 * x, *(part * sign * size for part in (1e-3, 1.0, 1e3, 1e6) for sign in (1.0, -1.0, signs, -signs))):
        terms = np.abs(matrix) @ (np.abs(x) + np.abs(move)) + np.abs(residual)
        with np.errstate(invalid="ignore"):
            linear &= np.abs(equations(x + move) - residual - matrix @ move) <= 1e-11 * terms
    rows = np.abs(matrix).max(axis=1, initial=0.0)
    linear &= rows > 0.0
    a, b = matrix[linear] / rows[linear, None], residual[linear] / rows[linear]
    columns = np.abs(a).max(axis=0, initial=0.0)
    a = a / np.where(columns > 0.0, columns, 1.0)
    step = np.linalg.lstsq(a, -b, rcond=1e-12)[0]
    return bool(np.abs(a @ step + b).max(initial=0.0) > 1e-9 * max(np.abs(step).max(initial=0.0), np.abs(b).max(initial=0.0)))


def vanishes(residual: np.ndarray, size: np.ndarray, slopes: np.ndarray, states: int) -> bool:
    """Whether a residual is the round-off of the terms of its equations.

    Besides its own terms an equation such as x' = v shows the round-off of its unknowns, which other equations have fixed: at rest v is no exact zero. How
    surely the largest of these fixes it is what is granted, and never more than the largest terms of all have: those of other units may be anything.

    Parameters
    ----------
    residual
        The residual, shape (m,).
    size
        Sizes of what cancels in every equation, shape (m,).
    slopes
        Jacobian of the equations, shape (m, n).
    states
        Number of equations of the flow, which come first; those behind them repeat some of these.
    """
    if not (np.isfinite(residual).all() and np.isfinite(slopes).all()):
        return False
    slopes = np.abs(slopes)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # 0 times inf is where an unknown is none of an equation
        sure = np.where(slopes > 0.0, size[:, None] / slopes, 0.0)[:states].max(axis=0, initial=0.0)
        sure[(slopes[:states] > 0.0).sum(axis=0) < 2] = np.inf  # nothing else fixes it
        shown = np.where(slopes > 0.0, slopes * sure, 0.0).max(axis=1, initial=0.0)
    return bool((np.abs(residual) <= 1e-9 * size + 1e-13 * np.minimum(shown, size.max())).all())
