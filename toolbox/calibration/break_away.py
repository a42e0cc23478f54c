"""The force at break-away, which a recorder never samples: it is told by the rise before, up to the time at which slip begins between two samples."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

RISE = 10
"""Last samples of a stick phase through which a curve is laid, whose end is the force at break-away; a shorter phase tells nothing."""

BEHIND = 3
"""Samples behind the peak that tell whether the force drops there."""

SLIPS = 6
"""First samples that slip, which tell when slip began."""

BENT = 6.0
"""F ratio from which a rise with a level behind it is told from one line; ten samples of a line, rising by twice their noise each, have it in one of fifty."""


class BreakAway(NamedTuple):
    """sample: the last at rest;  force: at break-away, and its standard deviation."""

    sample: int
    force: float
    deviation: float


def break_away(time: np.ndarray, values: np.ndarray, slip: np.ndarray, last: int, toward: float) -> BreakAway:
    """The break-away of a stick phase: where the force is largest in one direction.

    time, values, slip: of the phase and the first samples that slip behind it, shapes (n,);  last: place of its last sample at rest.

    Slip is slow at first, so that the samples at rest may end with some that slip: the peak is where they rise no more. Before it the force rises along a line,
    behind it the force is level, lower where it drops at release. Where these two pieces are told from one line and the force does not drop, the force at
    break-away is the level. Else it is where the curve through the rise is when slip begins, which the first samples that slip tell.
    """
    smooth = np.convolve(np.pad(values[: last + 2], 1, mode="edge"), np.ones(3) / 3, mode="valid")
    top = int(np.argmax(toward * smooth[:-1]))
    first = max(0, top + 1 - RISE)
    step = (time[-1] - time[0]) / (time.size - 1)  # the unit of times in all that follows
    t, force, count = (time[first:] - time[top]) / step, toward * values[first:], top + 1 - first
    if count < 3:
        return BreakAway(top, float(values[top]), float(np.ptp(force)))
    around, k, level = min(count + BEHIND, t.size), count, (-math.inf, 0.0)
    if around > 5:
        _, whole = _polynomial(t[:around], force[:around], 1)
        pieces = [(_polynomial(t[:k], force[:k], 1), force[k:around]) for k in range(3, around)]
        off = [left + float(((flat - flat.mean()) ** 2).sum()) for (_, left), flat in pieces]
        best = int(np.argmin(off))
        ((_, slope), _), flat = pieces[best]
        spread = off[best] / (around - 4)
        if slope > 0 and whole - off[best] > 2 * BENT * spread:
            k, level = best + 3, _level(flat)
    begin, doubt = _begin(t[last + 1 - first :], np.abs(slip[last + 1 :]))
    if begin > t[k - 1] and doubt < t[k] - t[k - 1]:  # else the slip tells nothing, as where it begins without a jump of its rate
        k = int(np.searchsorted(t, min(begin, t[last + 1 - first])))
    else:
        begin, doubt = 0.5 * (t[k - 1] + t[k]), 0.5 * (t[k] - t[k - 1])
    end, rate, deviation = _risen(t[:k], force[:k]).at(begin)
    deviation = math.hypot(deviation, rate * doubt)
    if end - level[0] <= 2.0 * math.hypot(deviation, level[1]):
        end, deviation = level[0], math.hypot(level[1], max(end - level[0], 0.0))
    return BreakAway(first + k - 1, float(toward * end), deviation)


def _begin(t: np.ndarray, slip: np.ndarray) -> tuple[float, float]:
    """When slip began, and its standard deviation, infinite where that is not told. t, slip: of the first samples that slip, whose curve is zero there."""
    if t.size < 3:
        return 0.0, math.inf
    curve = _slipped(t, slip)
    roots = np.roots(curve.coefficients[::-1])
    before = roots.real[(np.abs(roots.imag) < 1e-9 * (t[1] - t[0])) & (roots.real <= t[0])]
    if not before.size:
        return 0.0, math.inf
    begin = float(before.max())
    _, rate, deviation = curve.at(begin)
    return begin, deviation / rate if rate > 0 else math.inf


def _level(flat: np.ndarray) -> tuple[float, float]:
    """(mean, standard deviation of it) of the forces behind a rise, but for the first, in which it may end."""
    flat = flat[1:] if flat.size > 2 else flat
    return float(flat.mean()), float(flat.std(ddof=1)) / math.sqrt(flat.size) if flat.size > 1 else math.inf


class _Curve:
    """A polynomial through samples. other: one of another degree beside it, which says how much the choice of the degree counts."""

    def __init__(self, t: np.ndarray, coefficients: np.ndarray, left: float, other: np.ndarray):
        self.coefficients, self.other, self.powers = coefficients, other, np.arange(coefficients.size)
        basis = t[:, None] ** self.powers
        self.covariance = np.linalg.inv(basis.T @ basis) * (left / (t.size - coefficients.size))

    def at(self, time: float) -> tuple[float, float, float]:
        """(value, slope, standard deviation of the value) at a time."""
        here = time**self.powers
        value = float(here @ self.coefficients)
        slope = float(self.powers[1:] * time ** self.powers[:-1] @ self.coefficients[1:])
        apart = float(np.polynomial.polynomial.polyval(time, self.other)) - value
        return value, slope, math.hypot(math.sqrt(here @ self.covariance @ here), apart)


def _risen(t: np.ndarray, force: np.ndarray) -> _Curve:
    """The curve through a rise: a cubic, of fewer samples a parabola or a line."""
    found, left = _polynomial(t, force, max(1, min(3, (t.size - 1) // 3)))
    return _Curve(t, found, left, found)


def _slipped(t: np.ndarray, slip: np.ndarray) -> _Curve:
    """The curve through the first samples that slip, of no higher degree than they ask for (F-test of 5 %)."""
    from scipy.special import fdtri  # here, because scipy is slow to import

    found, left = _polynomial(t, slip, 1)
    other = found
    for degree in range(2, t.size - 1):
        other, rest = _polynomial(t, slip, degree)
        if left - rest <= fdtri(1, t.size - degree - 1, 0.95) * rest / (t.size - degree - 1):
            break
        found, left = other, rest
    return _Curve(t, found, left, other)


def _polynomial(t: np.ndarray, values: np.ndarray, degree: int) -> tuple[np.ndarray, float]:
    """(coefficients, sum of squares that is left) of the polynomial through samples."""
    found = np.polynomial.polynomial.polyfit(t, values, degree)
    return found, float(((values - np.polynomial.polynomial.polyval(t, found)) ** 2).sum())
