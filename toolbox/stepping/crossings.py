"""Where guards cross zero inside a step: by cubic Hermite interpolation, confirmed by steps from the same start."""

from __future__ import annotations

import math

from toolbox.compilation import work_layout as layout
from toolbox.stepping.guards import close_to_zero, guard_size, leaves_zero, stays
from toolbox.translation.words import call


def first_descent(a, da, b, db):
    """Return the first fraction in (0, 1] at which the cubic Hermite interpolant falls through zero; 2 if it stays positive.

    a, b: values at 0 and 1;  da, db: slopes times the step.
    """
    c2 = 3.0 * (b - a) - 2.0 * da - db
    c3 = 2.0 * (a - b) + da + db
    # critical points of a + da s + c2 s^2 + c3 s^3 split (0, 1) into monotone pieces
    s1, s2 = 1.0, 1.0
    disc = c2 * c2 - 3.0 * c3 * da
    if disc > 0.0:
        q = -(c2 + math.copysign(math.sqrt(disc), c2))
        r1 = q / (3.0 * c3) if c3 != 0.0 else 2.0
        r2 = da / q if q != 0.0 else 2.0
        if r1 > r2:
            r1, r2 = r2, r1
        if 0.0 < r1 < 1.0:
            s1 = r1
        if 0.0 < r2 < 1.0:
            s2 = r2
            if s1 == 1.0:
                s1 = s2
                s2 = 1.0
    left, f_left = 0.0, a
    for piece in range(3):
        right = s1 if piece == 0 else (s2 if piece == 1 else 1.0)
        f_right = b if right == 1.0 else a + right * (da + right * (c2 + right * c3))
        if f_left > 0.0 and f_right <= 0.0:
            low, high = left, right
            s = left + (right - left) * f_left / (f_left - f_right)
            for _ in range(60):  # Newton, kept inside the bracket
                f = a + s * (da + s * (c2 + s * c3))
                if f > 0.0:
                    low = s
                else:
                    high = s
                slope = da + s * (2.0 * c2 + 3.0 * s * c3)
                following = s - f / slope
                if not low <= following <= high:
                    following = 0.5 * (low + high)
                moved = abs(following - s)
                s = following
                if moved < 1e-9:
                    break
            return s
        if right == 1.0:
            break
        left, f_left = right, f_right
    return 2.0


def hermite_minimum(a, da, b, db):
    """Place and value of the minimum of the cubic Hermite interpolant between a falling start (da < 0) and a rising end (db > 0)."""
    c2 = 3.0 * (b - a) - 2.0 * da - db
    c3 = 2.0 * (a - b) + da + db
    root = math.sqrt(max(c2 * c2 - 3.0 * c3 * da, 0.0))
    s = -da / (c2 + root) if c2 + root > 0.0 else 0.5
    if not 0.0 < s < 1.0:
        s = 0.5
    return s, a + s * (da + s * (c2 + s * c3))


def dip_inside(w, h, j):
    """Whether guard j, positive at both ends of the step h but falling at first and rising at last, dips below zero inside it.

    Steps to the interpolated minimum, closer and closer, until the guard is negative there (returns the fraction) or the interpolation has
    become sharper than its distance to zero (returns 2).
    """
    n, ng = w.ints[layout.N], w.ints[layout.NG]
    left, right = 0.0, 1.0
    a, da = w.side[j] * w.g[j], w.side[j] * w.g[ng + j] * h
    b, db = w.side[j] * w.g_high[j], w.side[j] * w.g_high[ng + j] * h
    for _ in range(12):
        width = right - left
        s, expected = hermite_minimum(a, da * width, b, db * width)
        middle = left + s * width
        call(w.ints[layout.STEP], w.reals[layout.TIME], middle * h, w.x, w.k, w.p, w.m, w.y)
        value, slope = w.side[j] * w.y[2 * n + j], w.side[j] * w.y[2 * n + ng + j] * h
        if value < 0.0:
            return middle
        doubt = abs(value - expected)
        if slope < 0.0:
            left, a, da = middle, value, slope
        else:
            right, b, db = middle, value, slope
        if not (da < 0.0 and db > 0.0):
            return 2.0
        _, lowest = hermite_minimum(a, da * (right - left), b, db * (right - left))
        if lowest > doubt or right - left < 1e-7:
            return 2.0
    return 2.0


def candidate(w, h, low, high, width):
    """Return the earliest fraction of [low, high] (as fractions of h) at which a guard descends through zero by Hermite interpolation; 2 if
    no guard does."""
    ng = w.ints[layout.NG]
    best = 2.0
    for j in range(ng):
        a, b = w.side[j] * low[j], w.side[j] * high[j]
        if w.armed[j]:
            if not (b <= 0.0 or (low[ng + j] * w.side[j] < 0.0 and high[ng + j] * w.side[j] > 0.0)):
                continue
        elif stays(w, j, low[j], low[ng + j], high[j], high[ng + j]):
            continue
        s = first_descent(a, w.side[j] * low[ng + j] * width * h, b, w.side[j] * high[ng + j] * width * h)
        if s > 1.0 and b <= 0.0:
            s = 1.0
        if s < best:
            best = s
            w.ints[layout.LOCATED] = j
    return best


def rising_fraction(w, h, j):
    """Return a fraction of h with guard j positive, and a later fraction with guard j no longer positive. The guard is zero now and
    negative after the step h.

    The first is 0 where the guard only falls. A contact released exactly at its limit has no slip rate yet, so that neither the guard nor its slope tells
    which way it goes. A guard that rises now is followed down to the round-off of time: the flight between two impacts is short where the bounces end,
    however long the step.
    """
    fraction, later, shortest = 0.5, 1.0, 1e-9
    if w.side[j] * w.g[w.ints[layout.NG] + j] > 0.0:
        shortest = min(shortest, 4.0 * layout.EPS * abs(w.reals[layout.TIME]) / h)
    for _ in range(40):
        call(w.ints[layout.STEP], w.reals[layout.TIME], fraction * h, w.x, w.k, w.p, w.m, w.y)
        if w.side[j] * w.y[2 * w.ints[layout.N] + j] > 0.0:
            return fraction, later
        later = fraction
        fraction *= 0.5 if fraction > 0.01 else 0.1
        if fraction < shortest:
            break
    return 0.0, 1.0


def locate(w, h, low):
    """Step from the current point to the first event inside the step h, whose end guards are in `g_high`; its result is left in `y`.

    low: fraction of h before which nothing happens, with guards in `g_low`. Returns the size of the step, or -1 where the interpolated
    dip turns out not to reach zero.
    """
    ng, t = w.ints[layout.NG], w.reals[layout.TIME]
    n = w.ints[layout.N]
    high, fraction = 1.0, 1.0
    for attempt in range(60):
        width = high - low
        s = candidate(w, h, w.g_low, w.g_high, width)
        if s > 1.0:
            if high == 1.0:
                return -1.0
            call(
                w.ints[layout.STEP], t, high * h, w.x, w.k, w.p, w.m, w.y
            )  # below zero there, by what counts as round-off of a guard that starts at zero
            return high * h
        if attempt > 12:
            s = 0.5
        fraction = low + s * width
        if fraction <= low:
            fraction = low + 0.5 * width
        call(w.ints[layout.STEP], t, fraction * h, w.x, w.k, w.p, w.m, w.y)
        below, near = False, False
        for j in range(ng):
            value = w.side[j] * w.y[2 * n + j]
            still = stays(w, j, w.g[j], w.g[ng + j], w.y[2 * n + j], w.y[2 * n + ng + j])
            if not w.armed[j] and j != w.ints[layout.LOCATED] and still:
                continue  # round-off of a guard that starts at zero
            if abs(value) <= close_to_zero(w, j) and w.side[j] * w.y[2 * n + ng + j] < 0.0:
                near = True
            elif value < 0.0:
                below = True
        if (near and not below) or width * h <= 4.0 * layout.EPS * (abs(t) + fraction * h):
            return fraction * h
        if below:
            high = fraction
            for j in range(2 * ng):
                w.g_high[j] = w.y[2 * n + j]
        else:
            low = fraction
            for j in range(2 * ng):
                w.g_low[j] = w.y[2 * n + j]
    return fraction * h


def watch(w, h, error, node):
    """Whether a guard has crossed zero over the step in `y`, and whether one may have dipped below it; its end guards are then in `g_high`.

    Returns a third truth: whether the guard in LOCATED stands at zero and falls, so that it crosses at the start of the step.

    node: whether the step ends where an input turns. A step too long to be trusted may still show where an event cuts it short.
    """
    ng, ne, end = w.ints[layout.NG], w.ints[layout.NE], 2 * w.ints[layout.N]
    hit, suspicious = False, False
    for j in range(ng if error < 1e4 else 0):
        a, b = w.side[j] * w.g[j], w.side[j] * w.y[end + j]
        if w.armed[j]:
            bound = (j < 2 * ne and w.m[j // 2] == 0.0 and w.kind[j // 2] == layout.FRICTION) or j >= ng - w.ints[layout.BOUNDS]
            if a <= 0.0 and leaves_zero(w, j) and w.side[j] * w.g[ng + j] < 0.0:
                w.ints[layout.LOCATED] = j
                return True, False, True
            if node and bound and b >= -1e-12 * guard_size(w, j) and b <= 0.0:
                continue  # at its bound, or a bound at zero, where an input turns: what follows decides
            if b <= 0.0:
                hit = True
            elif w.side[j] * w.g[ng + j] < 0.0 and w.side[j] * w.y[end + ng + j] > 0.0 and error <= 1.0:
                slope = w.side[j] * w.y[end + ng + j] * h
                suspicious = suspicious or hermite_minimum(a, w.side[j] * w.g[ng + j] * h, b, slope)[1] <= 0.5 * max(a, b)
        elif not stays(w, j, w.g[j], w.g[ng + j], w.y[end + j], w.y[end + ng + j]):
            hit = True
    if hit or suspicious:
        for j in range(2 * ng):
            w.g_high[j] = w.y[end + j]
    return hit, suspicious, False
