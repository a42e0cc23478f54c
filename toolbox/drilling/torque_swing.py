"""A second opinion on stick-slip that needs no model: how far the torque at the surface swings over the period of the string, against its mean.

    index = (max T - min T) / (2 mean |T|)  over a period P                                            (stick-slip index, as rigs show it)
    D(t) = T(t - P/2) - (T(t) + T(t - P)) / 2,  swing = (max D - min D) / (4 mean |T|)  over a period   (of that, what goes back and forth)

Both are a / mean |T| for a torque that swings with the period P and the amplitude a. A torque that rises evenly has the swing 0, and one jump is over after a
period, so that ramps of weight and speed are no stick-slip. Of the string only its period counts, and 10 % more or less of that change the swing by 3 %.
A bit that just stops swings the torque of a drive that takes the waves of the string by its impedance times the mean speed: 0.3 to 0.4 of the mean torque for
the strings of `studies slow_logs`, and half of that where half of the torque is lost along the hole.

Why three periods in a row: a string that was hit rings for one or two.
"""

from __future__ import annotations

import itertools

import numpy as np

from toolbox.logs.flaws import local_spacing

ENOUGH = 5.0
"""Samples in a period of the string from which on stick-slip is seen."""

DOUBT = 0.88
"""Period of the string of the scene over that of the log, at worst: inertia or stiffness may be 20 % off."""

SWINGS, RESTS, CALM = 0.2, 0.15, 0.06
"""Swing from which on, over three periods, the torque swings as with a bit that sticks; index below which that is over; and below which no bit sticks."""

IN_A_ROW = 3
"""Periods over which it must swing."""


def too_slow(time: np.ndarray, known: np.ndarray, period: float) -> np.ndarray:
    """Return where a log has too few samples in a period to see stick-slip.

    Parameters
    ----------
    time
        Times of the samples [s], shape (n,).
    known
        Whether torque and speed were measured, shape (n,).
    period
        Period of the string [s].

    Returns
    -------
    np.ndarray
        True where it is too slow, shape (n,).
    """
    own = time[known]
    if own.size < 3:
        return np.ones(time.size, bool)
    interval = local_spacing(own)[0]
    place = np.clip(np.searchsorted(own, time, side="right") - 2, 0, interval.size - 1)
    slow: np.ndarray = interval[place] * ENOUGH * DOUBT > period
    return slow


def torque_swing(time: np.ndarray, torque: np.ndarray, period: float, cut: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the stick-slip index of a torque over the last period, and the least swing over each of the last three.

    Parameters
    ----------
    time, torque
        Times [s] and torque at the surface [N m], nan where it was not measured, shape (n,).
    period
        Period of the string [s].
    cut
        Whether a gap lies before a sample, shape (n,); nothing is told from samples on both sides of one.

    Returns
    -------
    index, least
        Index and least swing [1] at every sample from it and those before it, shape (n,); nan where too little was measured since the last gap.
    """
    index, least = np.full(time.size, np.nan), np.full(time.size, np.nan)
    edges = [0, *np.flatnonzero(cut).tolist(), time.size]
    for begin, end in itertools.pairwise(edges):
        good = begin + np.flatnonzero(np.isfinite(torque[begin:end]))
        if good.size < 4 or time[good[-1]] - time[good[0]] < period:
            continue
        t, values = time[good], _smoothed(time[good], torque[good], period)
        bent = np.interp(t - 0.5 * period, t, values) - 0.5 * (values + np.interp(t - period, t, values))
        behind = np.searchsorted(t, t - period, side="right")
        total = np.concatenate([[0.0], np.cumsum(np.abs(values))])
        here = np.arange(t.size)
        mean = np.maximum((total[here + 1] - total[behind]) / (here + 1 - behind), 1e-12)
        swing = np.full(t.size, np.nan)
        for k in np.flatnonzero(t >= t[0] + period).tolist():
            index[good[k]] = 0.5 * np.ptp(values[behind[k] : k + 1]) / mean[k]
            if t[k] >= t[0] + 2.0 * period:
                swing[k] = 0.25 * np.ptp(bent[behind[k] : k + 1]) / mean[k]
        earlier = [np.searchsorted(t, t - m * period, side="right") - 1 for m in range(IN_A_ROW)]
        least[good] = np.min([np.where(place >= 0, swing[np.maximum(place, 0)], np.nan) for place in earlier], axis=0)
    return index, least


def _smoothed(time: np.ndarray, values: np.ndarray, period: float) -> np.ndarray:
    """Means over a twelfth of a period, so that noise is no swing where samples are dense."""
    size = int(period / (12.0 * float(np.median(np.diff(time))))) // 2
    if size < 1:
        return values
    total = np.concatenate([[0.0], np.cumsum(values)])
    low, high = np.maximum(np.arange(values.size) - size, 0), np.minimum(np.arange(values.size) + size + 1, values.size)
    means: np.ndarray = (total[high] - total[low]) / (high - low)
    return means


def swinging(index: np.ndarray, least: np.ndarray) -> np.ndarray:
    """Return where the torque swings as with a bit that sticks: from three periods of a high swing on, until the index is low; shape (n,)."""
    found, on = np.zeros(index.size, bool), False
    for k, (now, long) in enumerate(zip(index.tolist(), least.tolist(), strict=True)):
        on = now >= RESTS if on else now >= SWINGS and long >= SWINGS  # a nan ends it
        found[k] = on
    return found
