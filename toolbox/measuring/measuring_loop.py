"""The compiled loops of `toolbox.measuring.measures`: over the nodes of a run for its signals, over its events for stays and switches."""

from __future__ import annotations

import numpy as np

from toolbox.compilation.calls import call
from toolbox.compilation.numba_cache import cached

DEPTH = 12
"""A step is halved at most so often, so that it has at most 4096 pieces, whatever the signal."""


@cached
def _state_at(step, project, t, h, n, ne, x, k, p, m, y, new):
    """Leave the state at t + h in `y`, by one step from x with slope k."""
    call(step, t, h, x, k, p, m, y)
    for i in range(ne):
        if m[i] == 0.0:
            for j in range(n):
                new[j] = y[j]
            call(project, t + h, 0.0, new, k, p, m, y)
            return


@cached
def _fits(a, b, h, count, size, tolerance):
    """Whether the cubic through both ends of a piece is near enough to the quintic."""
    for s in range(count):
        rise, d0, d1 = b[s] - a[s], h * a[count + s], h * b[count + s]
        off = abs(h * h * a[2 * count + s] - (6.0 * rise - 4.0 * d0 - 2.0 * d1))
        off += abs(h * h * b[2 * count + s] - (-6.0 * rise + 2.0 * d0 + 4.0 * d1))
        if not 0.0173 * off <= tolerance * max(size[s], abs(a[s]), abs(b[s])):
            return False
    return True


@cached
def _depth(a, b, count):
    """How often the step about a piece may be halved: seldom where slopes are not finite at both ends, as those of a root that stays at zero."""
    for s in range(count, 3 * count):
        if not np.isfinite(a[s]) and not np.isfinite(b[s]):
            return 4
    return DEPTH


@cached
def _highest(f0, d0, c0, f1, d1, c1, best):
    """Largest of `best` and the quintic on [0, 1] with these values, slopes and curvatures at its ends (Bernstein form), and where; -1 for `best`."""
    where = -1.0
    if f0 > best:
        best, where = f0, 0.0
    if f1 > best:
        best, where = f1, 1.0
    b0, b1, b2 = f0, f0 + 0.2 * d0, f0 + 0.4 * d0 + 0.05 * c0
    b3, b4, b5 = f1 - 0.4 * d1 + 0.05 * c1, f1 - 0.2 * d1, f1
    if max(max(b1, b2), max(b3, b4)) <= best:
        return best, where
    s0, s1, s2, s3, s4 = b1 - b0, b2 - b1, b3 - b2, b4 - b3, b5 - b4  # of the slope, over five
    left, before = 0.0, s0
    for piece in range(8):
        right = (piece + 1) / 8.0
        u, v = right, 1.0 - right
        after = v * v * v * v * s0 + 4.0 * v * v * v * u * s1 + 6.0 * v * v * u * u * s2 + 4.0 * v * u * u * u * s3 + u * u * u * u * s4
        if before > 0.0 and after <= 0.0:
            low, high = left, right
            for _ in range(40):
                u = 0.5 * (low + high)
                v = 1.0 - u
                if (
                    v * v * v * v * s0 + 4.0 * v * v * v * u * s1 + 6.0 * v * v * u * u * s2 + 4.0 * v * u * u * u * s3 + u * u * u * u * s4
                    > 0.0
                ):
                    low = u
                else:
                    high = u
            u = low
            v = 1.0 - u
            top = v * (
                v * v * v * v * b0
                + 5.0 * u * v * v * v * b1
                + 10.0 * u * u * v * v * b2
                + 10.0 * u * u * u * v * b3
                + 5.0 * u * u * u * u * b4
            )
            top += u * u * u * u * u * b5
            if top > best:
                best, where = top, u
        left, before = right, after
    return best, where


@cached
def _read_piece(
    addresses, n, ne, count, origin, begin, end, x, k, p, m, following, tolerance, size, y, new, left, stack_t, stack,
    lowest, highest, when_lowest, when_highest, integral,
):  # fmt: skip
    """Extrema, their times and the integrals of signals from begin to end, inside one step from (origin, x), added to what the arrays hold.

    following: the state at `end` where that is the next node, else empty.
    """
    step, project, signals = addresses[1], addresses[2], addresses[3]
    if begin == origin:
        call(signals, begin, 0.0, x, k, p, m, left)
    else:
        _state_at(step, project, origin, begin - origin, n, ne, x, k, p, m, y, new)
        call(signals, begin, 0.0, y, k, p, m, left)
    if following.size:
        for i in range(following.size):
            y[i] = following[i]
        for i in range(following.size, n):
            y[i] = 0.0
    else:
        _state_at(step, project, origin, end - origin, n, ne, x, k, p, m, y, new)
    call(signals, end, 0.0, y, k, p, m, stack[0])
    at, top = begin, 0
    stack_t[0] = end
    while top >= 0:
        right = stack[top]
        h = stack_t[top] - at
        if not _fits(left, right, h, count, size, tolerance):
            middle = at + 0.5 * h
            if top < DEPTH and h > 1.5 * (end - begin) / 2 ** _depth(left, right, count) and at < middle < stack_t[top]:
                top += 1
                stack_t[top] = middle
                _state_at(step, project, origin, middle - origin, n, ne, x, k, p, m, y, new)
                call(signals, middle, 0.0, y, k, p, m, stack[top])
                continue
            for s in range(count):  # slopes that are not finite, as of a root at zero: the piece is straight
                if not np.isfinite(left[count + s] + right[count + s] + left[2 * count + s] + right[2 * count + s]):
                    slope = (right[s] - left[s]) / h
                    left[count + s] = right[count + s] = slope
                    left[2 * count + s] = right[2 * count + s] = 0.0
        for s in range(count):
            f0, d0, c0 = left[s], h * left[count + s], h * h * left[2 * count + s]
            f1, d1, c1 = right[s], h * right[count + s], h * h * right[2 * count + s]
            size[s] = max(size[s], abs(f0), abs(f1))
            integral[s] += h * (0.5 * (f0 + f1) + 0.1 * (d0 - d1) + (c0 + c1) / 120.0)
            highest[s], where = _highest(f0, d0, c0, f1, d1, c1, highest[s])
            if where >= 0.0:
                when_highest[s] = stack_t[top] if where == 1.0 else at + where * h
            low, where = _highest(-f0, -d0, -c0, -f1, -d1, -c1, -lowest[s])
            lowest[s] = -low
            if where >= 0.0:
                when_lowest[s] = stack_t[top] if where == 1.0 else at + where * h
        for j in range(3 * count):
            left[j] = right[j]
        at = stack_t[top]
        top -= 1


@cached
def read_nodes(
    addresses, n, ne, ng, count, time, state, mode, held, records, p, first_held, windows, tolerance, size, lowest, highest, integral, ends
):
    """Extrema and integrals of signals over the first `records` recorded nodes, added to what the arrays (windows, signals) hold.

    addresses: of field, step, project, and the signals with two derivatives;  windows: (begin, end) of each;  size: of the signals so far;
    ends: signals at the last node.
    """
    field, signals = addresses[0], addresses[3]
    x, k, m, new = np.zeros(n), np.zeros(n), np.zeros(ne + 1), np.zeros(n)
    y = np.zeros(4 * n + 2 * ng + 4)
    stack_t, stack = np.empty(DEPTH + 1), np.empty((DEPTH + 1, 3 * count))
    left, when = np.empty(3 * count), np.empty(count)
    for r in range(records):
        last = r == records - 1
        skip = not last
        for w in range(windows.shape[0]):
            if time[r] <= windows[w, 1] and (last or time[r + 1] >= windows[w, 0]):
                skip = False
        if skip:
            continue
        for i in range(state.shape[1]):
            x[i] = state[r, i]
        for i in range(ne):
            m[i] = mode[r, i]
        for i in range(held.shape[1]):
            p[first_held + i] = held[r, i]
        if last:
            call(signals, time[r], 0.0, x, k, p, m, stack[0])
            for s in range(count):
                ends[s] = stack[0, s]
                for w in range(windows.shape[0]):
                    if windows[w, 0] <= time[r] <= windows[w, 1]:
                        lowest[w, s] = min(lowest[w, s], stack[0, s])
                        highest[w, s] = max(highest[w, s], stack[0, s])
            break
        if time[r + 1] == time[r]:
            continue
        known = False
        for w in range(windows.shape[0]):
            begin, end = max(time[r], windows[w, 0]), min(time[r + 1], windows[w, 1])
            if begin >= end:
                continue
            if not known:
                call(field, time[r], 0.0, x, k, p, m, y)
                for i in range(n):
                    k[i] = y[n + i]
                known = True
            following = state[r + 1] if end == time[r + 1] else state[r, :0]
            _read_piece(
                addresses, n, ne, count, time[r], begin, end, x, k, p, m, following, tolerance, size, y, new, left, stack_t, stack,
                lowest[w], highest[w], when, when, integral[w],
            )  # fmt: skip


@cached
def read_steps(
    addresses,
    n,
    ne,
    ng,
    time,
    state,
    mode,
    held,
    p,
    first_held,
    begin,
    end,
    tolerance,
    lowest,
    highest,
    when_lowest,
    when_highest,
    integral,
):
    """Extrema, their times and the integral of one signal in every step between recorded nodes, cut to the window from begin to end.

    The arrays have shape (steps, 1) and hold inf, -inf, nan, nan and 0 at first, which a step without length keeps.
    """
    x, k, m, new, size = np.zeros(n), np.zeros(n), np.zeros(ne + 1), np.zeros(n), np.zeros(1)
    y = np.zeros(4 * n + 2 * ng + 4)
    stack_t, stack, left = np.empty(DEPTH + 1), np.empty((DEPTH + 1, 3)), np.empty(3)
    for r in range(time.size - 1):
        first, last = max(time[r], begin), min(time[r + 1], end)
        if first >= last:
            continue
        for i in range(state.shape[1]):
            x[i] = state[r, i]
        for i in range(ne):
            m[i] = mode[r, i]
        for i in range(held.shape[1]):
            p[first_held + i] = held[r, i]
        call(addresses[0], time[r], 0.0, x, k, p, m, y)
        for i in range(n):
            k[i] = y[n + i]
        following = state[r + 1] if last == time[r + 1] else state[r, :0]
        _read_piece(
            addresses, n, ne, 1, time[r], first, last, x, k, p, m, following, tolerance, size, y, new, left, stack_t, stack,
            lowest[r], highest[r], when_lowest[r], when_highest[r], integral[r],
        )  # fmt: skip


@cached(forceinline=True)
def note_end(i, was, t, switched, since, asked, spent, number, latest, switches):
    """Add a stay of element i in mode `was`, which ends at t, by a switch or with the run."""
    for q in range(asked.shape[0]):
        if asked[q, 0] != i:
            continue
        if switched and asked[q, 2] <= t <= asked[q, 3]:
            switches[q] += 1
        first, last = max(since[i], asked[q, 2]), min(t, asked[q, 3])
        if was == asked[q, 1] and first < last:
            spent[q] += last - first
            if latest[q] != first:  # a stay that is left and taken up at one instant is one
                number[q] += 1
            latest[q] = last
    since[i] = t


@cached
def read_events(time, index, modes, count, finished, end, m, since, asked, spent, number, latest, switches):
    """Stays and switches from `count` recorded events, added to what the arrays hold; when `finished`, the last stays end at `end` in the modes m.

    asked: rows (element, mode, begin, end of the window), one per measure;  since: begin of the current stay of each element.
    """
    for e in range(count):
        note_end(index[e], modes[e, 0], time[e], True, since, asked, spent, number, latest, switches)
    for i in range(since.size if finished else 0):
        note_end(i, np.int8(m[i]), end, False, since, asked, spent, number, latest, switches)
