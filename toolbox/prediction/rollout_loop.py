"""The compiled loop of a rollout; see `toolbox.prediction.rollout`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from toolbox.translation.compiled import Compiled
from toolbox.translation.words import call

MOST_SWITCHES = 50
"""Switches in one interval after which the rest of it is taken without looking at guards."""

MOST_STEPS = 500
"""Steps beyond the planned ones that an interval may take; one of a bit that chatters takes some two for each of its switches."""

(MOVE, SLOPE, EDGE, STEPS) = range(4)
"""Indices into `Motion.ints`: addresses of the functions of `Rollout`, and the steps in an interval."""


class Motion(NamedTuple):
    """Arrays of a predicted motion over N intervals, with n states, `nu` varying inputs and `ne` contacts. `Rollout.motion` makes it.

    Attributes
    ----------
    ints, interval
        Addresses of the compiled functions and number of steps, and length of an interval [s].
    inputs, columns, p
        All inputs of the plant, indices of the inputs that vary, and parameters of the plant with the factors of the loads.
    X, M
        States, shape (N+1, n), and modes, shape (N+1, ne). The first rows are given.
    U
        Varying inputs of each interval, shape (N, nu).
    A, B
        Derivatives over each interval by states and inputs, shapes (N, n, n) and (N, n, nu). Empty: not computed.
    x, m, y, z, f, row, J, K
        Work arrays of the loop.

    Examples
    --------
    >>> import numpy as np
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.authoring import Rollout
    >>> rollout = Rollout(compose(wells.JANSEN_2, BitRock()), ["top.torque"], interval=0.1, steps=2)
    >>> motion = rollout.motion(np.array([15.0, 10.0, 10.0]), np.full((5, 1), 12e3))
    >>> print(motion.X.shape, motion.U.shape)
    (6, 3) (5, 1)
    """

    ints: np.ndarray
    interval: np.ndarray
    inputs: np.ndarray
    columns: np.ndarray
    p: np.ndarray
    X: np.ndarray
    M: np.ndarray
    U: np.ndarray
    A: np.ndarray
    B: np.ndarray
    x: np.ndarray
    m: np.ndarray
    y: np.ndarray
    z: np.ndarray
    f: np.ndarray
    row: np.ndarray
    J: np.ndarray
    K: np.ndarray


MOTION_KINDS = dict.fromkeys(Motion._fields, ("float64", 1)) | {
    "ints": ("int64", 1), "columns": ("int64", 1), "X": ("float64", 2), "M": ("float64", 2), "U": ("float64", 2), "A": ("float64", 3),
    "B": ("float64", 3), "J": ("float64", 2), "K": ("float64", 2),
}  # fmt: skip
"""{field of a `Motion`: its dtype and dimensions}, as `Compiled` takes them."""


def _released(w, i):
    """Set contact i in motion where its guards in `z` say that its bound cannot hold it."""
    if w.z[w.x.size + 2 * i] < 0.0:
        w.m[i] = -1.0
    elif w.z[w.x.size + 2 * i + 1] < 0.0:
        w.m[i] = 1.0


def _bearable_step(w, p, function, h):
    """Take a step of length h, halved until its states and guards are finite; returns its length."""
    call(function, 0.0, h, w.x, w.inputs, p, w.m, w.y)
    while h > 1e-6 * w.interval[0]:  # friction looked at far beyond zero slip may overflow
        total = 0.0
        for i in range(w.x.size + 2 * w.M.shape[1]):
            total += w.y[i]
        if math.isfinite(total):
            break
        h *= 0.5
        call(function, 0.0, h, w.x, w.inputs, p, w.m, w.y)
    return h


def _most_negative(w, besides, level):
    """The guard that is most negative after a step, and below -level, other than one; -1 for none."""
    n, found = w.x.size, -1
    for i in range(2 * w.M.shape[1]):
        if i != besides and w.y[n + i] < -level and (found < 0 or w.y[n + i] < w.y[n + found]):
            found = i
    return found


def _first_crossing(w, p, guard, h):
    """The step to the first crossing: regula falsi on the guard that is most negative, restarted where another one is negative there.

    Returns its length and the guard.
    """
    n = w.x.size
    for _ in range(2 * w.M.shape[1]):
        low, high, g_high = 0.0, h, w.y[n + guard]
        call(w.ints[EDGE], 0.0, 0.0, w.x, w.inputs, p, w.m, w.z)
        g_low = max(w.z[n + guard], 0.0)
        tiny = 1e-12 * (abs(g_high) + abs(g_low))
        for _ in range(60):
            h = low + (high - low) * min(max(g_low / (g_low - g_high), 0.02), 0.98)
            call(w.ints[MOVE], 0.0, h, w.x, w.inputs, p, w.m, w.y)
            g = w.y[n + guard]
            if g >= 0.0:
                low, g_low = h, g
            else:
                high, g_high = h, g
            if abs(g) <= tiny or high - low <= 1e-13 * w.interval[0]:
                break
        other = _most_negative(w, guard, tiny)
        if other < 0:
            break
        guard = other
    return h, guard


def _carried(w):
    """Carry the derivatives J over a step, whose own derivatives stand in y behind states and guards."""
    n, nu = w.x.size, w.columns.size
    first = n + 2 * w.M.shape[1]
    for a in range(n):
        for c in range(n + nu):
            total = w.y[first + n * n + a * nu + c - n] if c >= n else 0.0
            for b in range(n):
                total += w.y[first + a * n + b] * w.J[b, c]
            w.K[a, c] = total
    for a in range(n):
        for c in range(n + nu):
            w.J[a, c] = w.K[a, c]


def _switched(w, p, guard):
    """Switch the contact whose guard is zero, and carry the derivatives J over the event."""
    n, nu, ne, derivatives = w.x.size, w.columns.size, w.M.shape[1], w.A.shape[0] > 0
    e = guard // 2
    before = w.m[e]
    call(w.ints[EDGE], 0.0, 0.0, w.x, w.inputs, p, w.m, w.z)
    crossing = 0.0
    for i in range(n):
        w.f[i] = w.z[i]
        crossing += w.z[n + 2 * ne + guard * n + i] * w.z[i]
    if derivatives:
        for c in range(n + nu):
            total = w.z[n + 2 * ne + 2 * ne * n + guard * nu + c - n] if c >= n else 0.0
            for b in range(n):
                total += w.z[n + 2 * ne + guard * n + b] * w.J[b, c]
            w.row[c] = total
    if before == 0.0:
        w.m[e] = -1.0 if guard % 2 == 0 else 1.0
    else:
        w.m[e] = 0.0
        call(w.ints[EDGE], 0.0, 0.0, w.x, w.inputs, p, w.m, w.z)
        last = n + 2 * ne + 2 * ne * (n + nu)
        for i in range(n):
            w.x[i] = w.z[last + i]
        _released(w, e)
    if derivatives and crossing != 0.0:
        call(w.ints[EDGE], 0.0, 0.0, w.x, w.inputs, p, w.m, w.z)
        for a in range(n):
            for c in range(n + nu):
                w.J[a, c] += (w.z[a] - w.f[a]) * w.row[c] / crossing


def _begun(w, p, j):
    """Take up inputs, states and modes at the begin of interval j."""
    for i in range(w.columns.size):
        w.inputs[w.columns[i]] = w.U[j, i]
    for i in range(w.x.size):
        w.x[i] = w.X[j, i]
        for c in range(w.J.shape[1] if w.A.shape[0] > 0 else 0):
            w.J[i, c] = 1.0 if i == c else 0.0
    for i in range(w.M.shape[1]):
        w.m[i] = w.M[j, i]
    # a contact at rest that its bound cannot hold moves at once
    if w.M.shape[1] > 0:
        call(w.ints[EDGE], 0.0, 0.0, w.x, w.inputs, p, w.m, w.z)
        for i in range(w.M.shape[1]):
            if w.m[i] == 0.0:
                _released(w, i)


def _lost(w, j):
    """What follows from interval j on is not known: nan, with modes of 0."""
    for k in range(j, w.U.shape[0]):
        for i in range(w.x.size):
            w.X[k + 1, i] = math.nan
            if w.A.shape[0] > 0:
                for c in range(w.x.size):
                    w.A[k, i, c] = math.nan
                for c in range(w.columns.size):
                    w.B[k, i, c] = math.nan
        for i in range(w.M.shape[1]):
            w.M[k + 1, i] = 0.0


def advance_interval(w, p, j):
    """Advance a predicted motion over one interval, inside a loop that `Compiled` makes.

    Parameters
    ----------
    w
        The motion, as `Rollout.motion` makes it.
    p
        Numbers of the plant and factors of the loads, an array.
    j
        Index of the interval.

    Returns
    -------
    bool
        Whether the interval could be computed. If the states overflow, or the interval takes too many steps, the rest
        of the motion is nan.

    Examples
    --------
    >>> import numpy as np
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.authoring import Rollout, advance_rollout  # a compiled loop that calls it for every interval
    >>> rollout = Rollout(compose(wells.JANSEN_2, BitRock()), ["top.torque"], interval=0.1, steps=2)
    >>> motion = rollout.motion(np.array([15.0, 10.0, 10.0]), np.full((1, 1), 12e3))
    >>> _ = advance_rollout(motion)
    >>> print(motion.X[1].round(2))
    [15.01 10.03  9.74]
    """
    interval, steps, derivatives = w.interval[0], w.ints[STEPS], w.A.shape[0] > 0
    function = w.ints[SLOPE] if derivatives else w.ints[MOVE]
    _begun(w, p, j)
    left, switches, taken = interval, 0, 0
    while left > 1e-12 * interval:
        taken += 1
        h = _bearable_step(w, p, function, min(interval / steps, left))
        if (h <= 1e-6 * interval and h < left) or taken > steps + MOST_STEPS:  # nothing finite comes of it, or not in time
            _lost(w, j)
            return False
        guard = _most_negative(w, -1, 0.0) if switches < MOST_SWITCHES else -1
        if guard >= 0:
            h, guard = _first_crossing(w, p, guard, h)
            if derivatives:
                call(function, 0.0, h, w.x, w.inputs, p, w.m, w.y)
        if derivatives:
            _carried(w)
        for i in range(w.x.size):
            w.x[i] = w.y[i]
        left -= h
        if guard >= 0:
            switches += 1
            _switched(w, p, guard)
    for i in range(w.x.size):
        w.X[j + 1, i] = w.x[i]
        if derivatives:
            for c in range(w.x.size):
                w.A[j, i, c] = w.J[i, c]
            for c in range(w.columns.size):
                w.B[j, i, c] = w.J[i, w.x.size + c]
    for i in range(w.M.shape[1]):
        w.M[j + 1, i] = w.m[i]
    return True


def _advance(w):
    """Fill states, modes and derivatives."""
    for j in range(w.U.shape[0]):
        if not advance_interval(w, w.p, j):
            return


advance_rollout = Compiled(_advance, MOTION_KINDS)
"""Fills a `Motion` from its first states and modes, as machine code."""
