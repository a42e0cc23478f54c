"""Taylor steps in the event loop: how long a step may be, and where a guard's polynomial first falls through zero inside it.

The table of coefficients stands in `Work.k` (`toolbox.compilation.taylor`). A step is as long as the last two coefficients of every state allow, which
are then the error that
a step leaves; of guards, which only say when something happens, so that none of them has a large error between its zeros.

A guard is safe where a cubic through its values and slopes at both ends of the step, less the most that it can be off, stays above zero. Where it does
not, the step
is halved into pieces in which it does:

    |g - cubic| <= d^4/384 max |g''''|      in a piece of length d

so that no dip longer than the shortest piece, 1e-4 of the step, is missed, and the first piece in which the guard becomes negative is known.
"""

from __future__ import annotations

import math

from toolbox.compilation import work_layout as layout
from toolbox.stepping.crossings import first_descent
from toolbox.stepping.guards import close_to_zero, guard_size, stays
from toolbox.stepping.step_control import exp2, log2, measure_round_off, spread_round_off
from toolbox.translation.words import call

SHARE = 2.0
"""Size of the last term of a state in parts of the error that a step may add."""

GUARD_SHARE = 0.1
"""Size of the last term of a guard, in parts of the accuracy asked times the size of the guard."""

SLACK = 0.6
"""Binary logarithm of how much longer than the step the steps may be which the third and fourth coefficients from the end allow."""

SHORTEST = 1e-4
"""Part of a step below which pieces are not halved: the cubic is then right to round-off."""


def _allowance(ratio, power):
    """Binary logarithm of the step at which a term c h^k is as large as allowed, from the ratio of c to that; infinite for none."""
    return -log2(ratio) * power if ratio > 0.0 else 1e3


def open_series(w, t):
    """Write the table at the current point and choose the step size from it. Return False if a coefficient is not finite."""
    n, ng, order = w.ints[layout.N], w.ints[layout.NG], w.ints[layout.ORDER]
    width = n + ng
    call(w.ints[layout.SERIES], t, max(w.reals[layout.STEP_SIZE], 0.0), w.x, w.k, w.p, w.m, w.k)
    rate = SHARE * w.reals[layout.RTOL] / w.reals[layout.HORIZON]
    first, second, guard, total = 0.0, 0.0, 0.0, 0.0
    last = (order - 1) * width
    for i in range(n - w.excited.size):
        size = max(w.scale[i], 1e-10 * w.group_scale[w.group[i]], 1e-14)
        weight = 1.0 / (rate * size + w.noise[i])
        first = max(first, abs(w.k[last + i]) * weight)
        second = max(second, abs(w.k[last - width + i]) * weight)
        total += abs(w.k[last + i])
    for j in range(ng):
        size = abs(w.k[last + n + j])
        total += size
        if guard_size(w, j) > 0.0:  # of a slip that has just begun only states have a size
            guard = max(guard, size / guard_size(w, j))
    if not total < math.inf:
        return False
    p = float(order)
    h = min(_allowance(first, 1.0 / (p - 1.0)), _allowance(second, 1.0 / (p - 2.0)))
    if w.reals[layout.STEP_SIZE] <= 0.0 or h > 1.0 + log2(w.reals[layout.STEP_SIZE]):  # the last two may be zero alone
        third, fourth = 0.0, 0.0
        for i in range(n - w.excited.size):
            weight = 1.0 / (rate * max(w.scale[i], 1e-10 * w.group_scale[w.group[i]], 1e-14) + w.noise[i])
            third = max(third, abs(w.k[last - 2 * width + i]) * weight)
            fourth = max(fourth, abs(w.k[last - 3 * width + i]) * weight)
        h = min(h, SLACK + min(_allowance(third, 1.0 / (p - 3.0)), _allowance(fourth, 1.0 / (p - 4.0))))
    tenth = log2(0.1 * w.reals[layout.HORIZON])
    if h > tenth and first > 0.0:  # of an error that a tenth of the run may make
        h = max(tenth, -(log2(first) - tenth) / p)
    if first > 0.0 and w.reals[layout.RTOL] < 1e-10:  # no less than round-off
        h = max(h, (log2(1e-14 / rate) - log2(first)) / p)
    if guard > 0.0:
        h = min(h, (log2(GUARD_SHARE * w.reals[layout.RTOL]) - log2(guard)) / p)
    w.reals[layout.STEP_SIZE] = exp2(max(min(h, 900.0), -900.0))
    w.reals[layout.STEP_OLD] = 0.0
    w.ints[layout.OPENED] = 1
    for j in range(ng):
        w.g[j] = w.k[order * width + n + j]
        w.g[ng + j] = w.k[n + j]
    return True


def _first_fall(w, h, j, shift, length):
    """The first zero of guard j in the step h, and the end of the piece in which it becomes negative, in parts of h; both 2 where it stays positive.

    length: of the first piece;  shift: leave out so many first coefficients, of a guard that begins at zero, and look at what it is divided by that
    power of time.
    """
    n, ng, order = w.ints[layout.N], w.ints[layout.NG], w.ints[layout.ORDER]
    width = n + ng
    c = w.z
    power, bend = 1.0, 0.0
    degree = order - shift
    for k in range(degree + 1):
        row = k + shift
        c[k] = w.side[j] * w.k[(order if row == 0 else row - 1) * width + n + j] * power
        power *= h
        bend += k * (k - 1.0) * (k - 2.0) * (k - 3.0) * abs(c[k])
    left, a, da = 0.0, c[0], c[1]
    while left < 1.0:
        right = min(left + length, 1.0)
        b, db = _value(c, degree, right)
        third = (right - left) / 3.0
        doubt = (right - left) ** 4 * bend / 384.0
        if b <= 0.0:
            if length <= SHORTEST or doubt <= 1e-3 * (a - b):
                guess = first_descent(a, 3.0 * da * third, b, 3.0 * db * third)
                return _zero(c, degree, left, right, left + min(guess, 1.0) * (right - left)), right
        elif min(a + da * third, b - db * third) > doubt or length <= SHORTEST:
            left, a, da = right, b, db
            length *= 2.0
            continue
        length *= 0.5
    return 2.0, 2.0


def _value(c, degree, s):
    """Value and slope of a polynomial."""
    value, slope = c[degree], 0.0
    for k in range(degree - 1, -1, -1):
        slope = slope * s + value
        value = value * s + c[k]
    return value, slope


def _zero(c, degree, low, high, s):
    """Where a polynomial that is positive at `low` and not at `high` is zero, by Newton's method from s on inside a shrinking bracket."""
    for _ in range(60):
        value, slope = _value(c, degree, s)
        if value > 0.0:
            low = s
        else:
            high = s
        following = s - value / slope
        if not low <= following <= high:
            following = 0.5 * (low + high)
        moved = abs(following - s)
        s = following
        if moved <= 1e-9 * high:  # the next move would be its square
            break
    return s


def watch_series(w, h, node):
    """Which guard first crosses zero in the step h, whose end is in `y`.

    Returns (whether one does, whether an element has to decide at once, whether guards that start at zero make it doubtful which is first, the fraction of h
    at which the first is zero, and one by which something is negative).
    """
    ng, ne, n = w.ints[layout.NG], w.ints[layout.NE], w.ints[layout.N]
    end = 2 * n
    least = 3 * n + 2 * ng
    hit, doubtful, first, top = False, False, 2.0, 1.0
    for j in range(ng):
        if (w.y[least + j] if w.side[j] > 0.0 else -w.y[least + ng + j]) > 0.0:
            continue
        a, b = w.side[j] * w.g[j], w.side[j] * w.y[end + j]
        zero, fraction = 2.0, 2.0
        if w.armed[j]:
            bound = (j < 2 * ne and w.m[j // 2] == 0.0 and w.kind[j // 2] == layout.FRICTION) or j >= ng - w.ints[layout.BOUNDS]
            if a <= 0.0:  # the polynomial that led here was just above
                if w.side[j] * w.g[ng + j] < 0.0:
                    w.ints[layout.LOCATED] = j
                    return True, True, False, 0.0, 1.0
                continue
            zero, fraction = _first_fall(w, h, j, 0, 1.0 if b <= 0.0 else 0.5)
            if node and bound and fraction == 1.0 and b >= -1e-12 * guard_size(w, j) and b <= 0.0:
                continue  # at its bound, or a bound at zero, where an input turns: what follows decides
        elif not stays(w, j, w.g[j], w.g[ng + j], w.y[end + j], w.y[end + ng + j]):
            hit, doubtful = True, True
            if w.side[j] * w.k[n + j] > 0.0:  # it rises first, for how long its polynomial tells: a low flight is far shorter than the step
                zero, fraction = _first_fall(w, h, j, 1, 1.0)
        elif b > 0.0:
            rise = w.side[j] * w.k[n + j] > 0.0
            zero, fraction = _first_fall(w, h, j, 1 if rise else 2, 1.0)
            doubtful = doubtful or fraction <= 1.0
        if fraction <= 1.0:
            hit = True
            top = min(top, fraction)
            if zero < first:
                first = zero
                w.ints[layout.LOCATED] = j
    return hit, False, doubtful, first, top


def defect(w, t, h):
    """Return the residual of the equations at the end of the step h in `y`, as a fraction of the tolerance. The neglected terms of the
    series cause it.

    The last coefficients do not show a term that is small now and grows faster than they do, such as that of a friction law far from its peak. The field there
    does. Of a step that is within bounds, slopes and guards at its end are then those of the field.
    """
    n, ng, order = w.ints[layout.N], w.ints[layout.NG], w.ints[layout.ORDER]
    call(w.ints[layout.FIELD], t + h, 0.0, w.y, w.k, w.p, w.m, w.z)
    share = SHARE * max(w.reals[layout.RTOL] * min(h / w.reals[layout.HORIZON], 0.1), 1e-14)
    error = 0.0
    for i in range(n - w.excited.size):
        size = max(w.scale[i], abs(w.y[i]), 1e-10 * w.group_scale[w.group[i]], 1e-14)
        off = abs(w.z[n + i] - w.y[n + i]) * h / (order * (share * size + w.noise[i] * h))
        error = off if not off <= error else error  # which keeps a NaN
    for j in range(ng):
        size = max(guard_size(w, j), abs(w.z[2 * n + j]))
        if size > 0.0:
            off = abs(w.z[2 * n + j] - w.y[2 * n + j]) / (w.reals[layout.RTOL] * size + w.noise[n + j])
            error = off if not off <= error else error
    if error <= 1.0:
        for i in range(n - w.excited.size):
            w.y[n + i] = w.z[n + i]
        for j in range(2 * ng):
            w.y[2 * n + j] = w.z[2 * n + j]
    return error


def turns(w, h):
    """Return the fraction of the step h at which a slip first comes closest to zero and turns, near the peak of a friction law; 1 if no
    slip turns. The end is in `y`."""
    ng, n = w.ints[layout.NG], w.ints[layout.N]
    first = 1.0
    for i in range(w.ints[layout.NE]):
        j = 2 * i
        if w.m[i] != 0.0 and w.kind[i] == layout.FRICTION and w.g[ng + j] < 0.0 and w.y[2 * n + ng + j] > 0.0:
            first = min(first, _turn(w, h, j))
    return first


def _turn(w, h, j):
    """Where the slope of guard j, negative at the start and positive at the end of the step h, is zero, in parts of h."""
    n, ng, order = w.ints[layout.N], w.ints[layout.NG], w.ints[layout.ORDER]
    width = n + ng
    power = 1.0
    for k in range(order):
        w.z[k] = -(k + 1.0) * w.k[k * width + n + j] * power
        power *= h
    value, _ = _value(w.z, order - 1, 1.0)
    return _zero(w.z, order - 1, 0.0, 1.0, w.z[0] / (w.z[0] - min(value, 0.0))) if w.z[0] > 0.0 else 1.0


def polish(w, t, size):
    """Move the end of a step that ends on the located guard until the guard itself, not its polynomial, is zero; returns the size of the step."""
    n, ng, j = w.ints[layout.N], w.ints[layout.NG], w.ints[layout.LOCATED]
    for _ in range(3):
        value, slope = w.side[j] * w.z[2 * n + j], w.side[j] * w.z[2 * n + ng + j]
        if abs(value) <= close_to_zero(w, j) or not slope < 0.0:
            break
        moved = size - value / slope
        if not 0.9 * size <= moved <= 1.1 * size:
            break
        size = moved
        call(w.ints[layout.STEP], t, size, w.x, w.k, w.p, w.m, w.y)
        call(w.ints[layout.FIELD], t + size, 0.0, w.y, w.k, w.p, w.m, w.z)
        for i in range(2 * ng):
            w.y[2 * n + i] = w.z[2 * n + i]
    return size


def checked_end(w, t, h, t_new, event, rejected):
    """Check the step h to t_new in `y` against the field, at its end and at a turn of a slip inside, and polish an event. Return (error,
    size, end)."""
    error = 0.0
    middle = turns(w, h)  # an excursion within the step, which its end does not show
    for attempt in range(3):  # a loop, so that the code of the check is there once
        size = h if attempt > 0 else middle * h
        if attempt == 2:
            if error <= 1.0 or rejected:
                break
            measure_round_off(w)
            spread_round_off(w, h)
        elif middle < 1.0:
            call(w.ints[layout.STEP], t, size, w.x, w.k, w.p, w.m, w.y)
        elif attempt == 0:
            continue
        error = defect(w, t, size)
        if attempt == 0 and not error <= 1.0:
            break
    if event and error <= 1.0:
        end = polish(w, t, h)
        t_new = t + end if end != h else t_new
        h = end
    return error, h, t_new
