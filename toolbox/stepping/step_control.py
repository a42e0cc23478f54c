"""Step sizes of the event loop: scaled error, first step, round-off of the slopes."""

from __future__ import annotations

import math

import numpy as np

from toolbox.compilation import work_layout as layout
from toolbox.stepping.guards import nudge
from toolbox.translation.words import call

STAGES = 10.0
"""Stages of a step, about: the noise of a slope is in every one of them, that of the first alone leaves a tenth of it in the states."""

REACH = 1e6
"""Size of a state, in units of what round-off can have done to it in the run so far, from which on round-off does not reach it."""


GROWTH_OF_SLIP = 4.0
"""How much larger slip in two directions may be at the end of an implicit step: at little slip friction turns it so fast that a longer step takes its
direction from the start and shows no error."""

LEAP, LEAP_OF_SETTLED, SETTLED = 10.0, 2.0, 3.0
"""How many times longer than a step the next may be: LEAP, or LEAP_OF_SETTLED where the step is less than SETTLED times as long as the one before it.

Steps that stability holds have errors that vanish by chance now and then. One several times longer was accepted by chance as well, and states within it were
40 to 70 times the accuracy off. SETTLED is more than LEAP_OF_SETTLED, so that two such chances in a row make no leap."""

STALL, LEAST_PROGRESS = 1_000_000, 1e-6
"""Accepted steps in which time must grow by this part of itself, of a millionth of the run at its start: `stalls`."""

PASSED_OVER = 1e3
"""What counts as its growth where an implicit step has passed over a rest between its ends."""


def log2(x):
    """Binary logarithm of a positive number to one part in a hundred, which is all that step sizes need."""
    bits = np.float64(x).view(np.int64)
    fraction = np.int64((bits & 0xFFFFFFFFFFFFF) | 0x3FF0000000000000).view(np.float64) - 1.0
    return float((bits >> 52) - 1023) + fraction * (1.3465 - 0.3465 * fraction)


def exp2(x):
    """Two to the power of x, |x| < 1000, to one part in two hundred."""
    floor = math.floor(x)
    fraction = x - floor
    return np.int64((np.int64(floor) + 1023) << 52).view(np.float64) * (1.0 + fraction * (0.6565 + 0.3435 * fraction))


def tolerance(w, i):
    """Local tolerance of state i: the accuracy asked times its size, with floors for states that are still small."""
    return w.reals[layout.RTOL] * max(w.scale[i], 1e-10 * w.group_scale[w.group[i]], 1e-14)


def measure_round_off(w):
    """Estimate the round-off of every slope and guard by small changes of the point. Slopes also get the round-off of forces that
    cancel."""
    n = w.ints[layout.N]
    nudge(w)
    call(w.ints[layout.FIELD], w.reals[layout.TIME] * (1.0 + 1e-7), 0.0, w.x_other, w.k, w.p_other, w.m, w.z)
    for i in range(n):
        w.noise[i] = 1e7 * abs(w.z[n + i] - w.k[i]) * 32.0 * layout.EPS
    for j in range(w.ints[layout.NG]):
        w.noise[n + j] = 1e7 * abs(w.z[2 * n + j] - w.g[j]) * 32.0 * layout.EPS
    call(w.ints[layout.BURDEN], w.reals[layout.TIME], 0.0, w.x, w.k, w.p, w.m, w.z)
    for i in range(n):
        w.noise[i] += w.z[i] * 32.0 * layout.EPS


def spread_round_off(w, h):
    """Add to the noise of every slope the noise that an accepted step h carries over from other slopes.

    A position whose speed is only the round-off of balanced forces has no scale of its own: without this its error would be held to one. States of a size
    that round-off does not reach are left alone.
    """
    reached = False
    for i in range(w.ints[layout.N]):
        reached = reached or (w.scale[i] > 0.0 and w.noise[i] * h > 1e-7 * w.scale[i])
    if reached:
        _spread(w, h)


def _spread(w, h):
    """Add the noise for `spread_round_off`: what two steps differ by, one of which starts from slopes with their noise; of Taylor series, what the slopes at
    two points differ by that noise puts apart within the step.

    A step carries the noise from state to state as far as it carries everything else, and damps it in modes that die within it.
    """
    n = w.ints[layout.N]
    if w.ints[layout.SERIES] != 0:  # whose steps begin with a table, not with slopes
        for i in range(n):
            w.x_other[i] = w.x[i] + h * w.noise[i]
        call(w.ints[layout.FIELD], w.reals[layout.TIME], 0.0, w.x_other, w.k, w.p, w.m, w.z)
        for i in range(n):
            _take_over(w, i, abs(w.z[n + i] - w.k[i]))
        return
    for i in range(n):
        w.x_other[i] = w.k[i] + STAGES * w.noise[i]
    call(w.ints[layout.STEP], w.reals[layout.TIME], h, w.x, w.k, w.p, w.m, w.y)
    call(w.ints[layout.STEP], w.reals[layout.TIME], h, w.x, w.x_other, w.p, w.m, w.z)
    for i in range(n):
        _take_over(w, i, abs(w.z[i] - w.y[i]) / h)


def _take_over(w, i, spread):
    """Add what other slopes pass on to the noise of slope i, unless its state is of a size that round-off does not reach."""
    if w.scale[i] <= REACH * spread * w.reals[layout.TIME] < math.inf:
        w.noise[i] += spread


def stalls(w, t):
    """Whether a run makes no progress: a million accepted steps, and time has grown by less than a millionth of itself.

    It asks nothing of runs that are long or slow, however many steps they take. At a millionth of a millionth of the time a step, doubling the time would take
    1e12 steps, and one step is less than 1e4 times what times can tell apart (2e-16 of the time): a motion that needs such steps could not be followed to
    the accuracy of any run. At the start, where time is zero, a millionth of the run stands for it.
    """
    steps = w.ints[layout.ACCEPTED] - w.ints[layout.LOOKED]
    if steps < STALL:
        return False
    whole = w.reals[layout.HORIZON]
    stalled = t - w.reals[layout.LOOKED_AT] < LEAST_PROGRESS * min(max(abs(t), 1e-6 * whole), whole)
    w.ints[layout.LOOKED], w.reals[layout.LOOKED_AT] = w.ints[layout.ACCEPTED], t
    return stalled


def first_step(w):
    """A first step size by Hairer's rule."""
    n, t = w.ints[layout.N], w.reals[layout.TIME]
    d0, d1, d2 = 0.0, 0.0, 0.0
    for i in range(n):
        tol = tolerance(w, i)
        d0 += (w.x[i] / tol) ** 2
        d1 += (w.k[i] / tol) ** 2
    measure_round_off(w)
    h0 = 1e-6 if d0 < 1e-10 or d1 < 1e-10 else 0.01 * math.sqrt(d0 / d1)
    h0 = min(h0, w.reals[layout.LAST] - t)
    for i in range(n):
        w.y[i] = w.x[i] + h0 * w.k[i]
    call(w.ints[layout.FIELD], t + h0, 0.0, w.y, w.k, w.p, w.m, w.z)
    for i in range(n):
        d2 += ((w.z[n + i] - w.k[i]) / tolerance(w, i)) ** 2
    d1 = math.sqrt(d1 / n)
    d2 = math.sqrt(d2 / n) / h0 if h0 > 0.0 else 0.0
    top = max(d1, d2)
    h1 = (0.01 / top) ** (1.0 / w.ints[layout.ORDER]) if top > 1e-15 else max(1e-6, h0 * 1e-3)
    # states that are still zero would make the rule absurdly careful; a step too long is only rejected
    h = max(min(100.0 * h0, h1), 1e-9 * w.reals[layout.HORIZON])
    w.reals[layout.STEP_SIZE] = h if h > 0.0 and math.isfinite(h) else 1e-9
    w.reals[layout.STEP_OLD] = 0.0


def outgrown(w, h):
    """Whether the implicit step h in `y` is longer than modes that may grow allow."""
    return w.ints[layout.IMPLICIT] == 1 and h > w.reals[layout.FOLLOWED] and not w.y[3 * w.ints[layout.N] + 2 * w.ints[layout.NG]] > 0.0


def _growth_of_slip(w, h, i):
    """How many times larger the slip speed of element i is at the end of the step h in `y` than at its start; PASSED_OVER where the slip has turned round."""
    ne = w.ints[layout.NE]
    call(w.ints[layout.PROBE], w.reals[layout.TIME], 0.0, w.x, w.k, w.p, w.m, w.z)
    before, first, second = w.z[i], w.z[i + 1], w.z[ne + i + 1]
    call(w.ints[layout.PROBE], w.reals[layout.TIME] + h, 0.0, w.y, w.k, w.p, w.m, w.z)
    if first * w.z[i + 1] + second * w.z[ne + i + 1] < 0.0:
        return PASSED_OVER
    return w.z[i] / before if before > 0.0 else 1.0


def scaled_error(w, h):
    """Scaled error of the step in `y`: root mean square over the states, in units of the local tolerance.

    A step may add its share of time to the global error (error per unit step): the phase error of a limit cycle adds up over the run. A step of an
    implicit method, which is much shorter only where fast modes die after an event, may add the share of the mean step so far. Hidden forces
    count only as far as guards are interpolated: by the estimate of lowest order, against a fraction of the bound.
    """
    if outgrown(w, h):
        return math.nan
    hidden = w.excited.size
    n = w.ints[layout.N] - hidden
    base = 2 * w.ints[layout.N] + 2 * w.ints[layout.NG]
    two = w.ints[layout.TWO_ERRORS] == 1
    sum1, sum2 = 0.0, 0.0
    portion, turned = h, 0.0
    if w.ints[layout.IMPLICIT] == 1:
        portion = max(h, w.reals[layout.TIME] / (w.ints[layout.ACCEPTED] + 1.0))
        for i in range(1, w.ints[layout.NE]):
            if w.loader[i] == layout.SECOND and w.m[i] == 1.0 and w.m[i - 1] != 0.0:
                portion = h  # a slip that ends must not miss its rest by what other steps may add
                turned = max(turned, _growth_of_slip(w, h, i - 1) / GROWTH_OF_SLIP)
    share = max(w.reals[layout.RTOL] * min(portion / w.reals[layout.HORIZON], 0.1), 1e-14 if w.reals[layout.RTOL] > 1e-14 else 2e-15)
    for i in range(n):
        size = max(w.scale[i], abs(w.y[i]), 1e-10 * w.group_scale[w.group[i]], 1e-14)
        if w.ints[layout.IMPLICIT] == 1 and abs(w.y[i]) > w.scale[i]:  # nobody knows yet how large it will be
            size = max(size, 1e-4 * w.group_scale[w.group[i]])
        tol = 1.0 / (share * size + w.noise[i] * h)
        e = w.y[base + i] * tol
        sum1 += e * e
        if two:
            e = w.y[base + w.ints[layout.N] + i] * tol
            sum2 += e * e
    if two:
        bottom = sum1 + 0.01 * sum2
        error = 0.0 if bottom == 0.0 else sum1 / math.sqrt(bottom * n)  # NaN stays NaN
    else:
        error = math.sqrt(sum1 / n)
    lowest = base + w.ints[layout.N] if two else base
    if turned > 1.0:  # less says nothing of the next step
        error = max(error, turned)
    for q in range(hidden):
        # where nothing has acted yet the force is taken to become what its rate makes of it in a thousandth of the run
        size = max(w.guard_scale[2 * w.excited[q] + w.ints[layout.NG]], 1e-3 * w.reals[layout.HORIZON] * abs(w.k[n + q]), 1e-300)
        error = max(error, abs(w.y[lowest + n + q]) / ((0.02 if two else 3e-4) * size))
    return error
