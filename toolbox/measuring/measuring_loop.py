"""The compiled loops of `toolbox.measuring.measures`: over the nodes of a run for its signals, over its events for stays and switches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from toolbox.compilation.calls import call
from toolbox.compilation.numba_cache import cached, inlined

DEPTH = 12
"""A step is halved at most so often, so that it has at most 4096 pieces, whatever the signal."""


class Reader(NamedTuple):
    """What is read in a run: machine code and sizes of its program.

    addresses: of field, step, project, the signals with two derivatives, and the coefficients of Taylor steps or 0;  slopes: size of what a step takes
    as slopes;  signals: their number;  p: parameters of the run, with what is held at a
    node behind `first_held`;  tolerance: of a piece, relative to the size of a signal.
    """

    addresses: np.ndarray
    states: int
    elements: int
    guards: int
    slopes: int
    signals: int
    p: np.ndarray
    first_held: int
    tolerance: float


class Nodes(NamedTuple):
    """Recorded nodes: time, states, modes and held parameters."""

    time: np.ndarray
    state: np.ndarray
    mode: np.ndarray
    held: np.ndarray


class Extremes(NamedTuple):
    """Extrema of signals, their times and their integrals, shape (rows, signals), to which is added."""

    lowest: np.ndarray
    highest: np.ndarray
    when_lowest: np.ndarray
    when_highest: np.ndarray
    integral: np.ndarray


class Pieces(NamedTuple):
    """Space for a step and its pieces.

    x, k, m: the node that a step begins with;  y, new: at an instant within it;  left, stack: signals where a piece begins, and where those that wait end,
    at the times stack_t;  size: of the signals so far.
    """

    x: np.ndarray
    k: np.ndarray
    m: np.ndarray
    y: np.ndarray
    new: np.ndarray
    left: np.ndarray
    stack_t: np.ndarray
    stack: np.ndarray
    size: np.ndarray


class Events(NamedTuple):
    """Recorded events: time, element, and modes before and after."""

    time: np.ndarray
    element: np.ndarray
    modes: np.ndarray


class StayCounts(NamedTuple):
    """Stays and switches, to which is added.

    asked: rows (element, mode, begin, end of the window), one per measure;  since: begin of the current stay of each element;  spent, number, latest,
    switches: seconds, stays, end of the last stay, and switches, one per measure.
    """

    asked: np.ndarray
    since: np.ndarray
    spent: np.ndarray
    number: np.ndarray
    latest: np.ndarray
    switches: np.ndarray


@inlined(_nrt=True)
def _pieces(reader, size):
    """Space for the steps of a run."""
    n, count = reader.states, reader.signals
    y = np.zeros(max(4 * n + 2 * reader.guards, 3 * n + 4 * reader.guards) + 4)
    stack = np.empty((DEPTH + 1, 3 * count))
    return Pieces(
        np.zeros(n),
        np.zeros(reader.slopes),
        np.zeros(reader.elements + 1),
        y,
        np.zeros(n),
        np.empty(3 * count),
        np.empty(DEPTH + 1),
        stack,
        size,
    )


@inlined
def _begin_step(reader, nodes, r, pieces):
    """Put a node where a step begins."""
    for i in range(nodes.state.shape[1]):
        pieces.x[i] = nodes.state[r, i]
    for i in range(reader.elements):
        pieces.m[i] = nodes.mode[r, i]
    for i in range(nodes.held.shape[1]):
        reader.p[reader.first_held + i] = nodes.held[r, i]


@inlined
def _slope(reader, t, h, pieces):
    """Put the slope of the states where a step of length h begins."""
    if reader.addresses[4] != 0:
        call(reader.addresses[4], t, h, pieces.x, pieces.k, reader.p, pieces.m, pieces.k)
        return
    call(reader.addresses[0], t, 0.0, pieces.x, pieces.k, reader.p, pieces.m, pieces.y)
    for i in range(reader.states):
        pieces.k[i] = pieces.y[reader.states + i]


@inlined
def _state_at(reader, pieces, t, h):
    """Leave the state at t + h in `y`, by one step from where a step begins."""
    call(reader.addresses[1], t, h, pieces.x, pieces.k, reader.p, pieces.m, pieces.y)
    for i in range(reader.elements):
        if pieces.m[i] == 0.0:
            for j in range(reader.states):
                pieces.new[j] = pieces.y[j]
            call(reader.addresses[2], t + h, 0.0, pieces.new, pieces.k, reader.p, pieces.m, pieces.y)
            return


@inlined
def _signals_at(reader, pieces, t, x, out):
    """The signals with two derivatives at an instant."""
    call(reader.addresses[3], t, 0.0, x, pieces.k, reader.p, pieces.m, out)


@inlined
def _fits_one(a, b, h, s, count, size, tolerance):
    """Whether the cubic of signal s through both ends of a piece is within a tolerance, in parts of the size of the signal, of the quintic."""
    rise, d0, d1 = b[s] - a[s], h * a[count + s], h * b[count + s]
    off = abs(h * h * a[2 * count + s] - (6.0 * rise - 4.0 * d0 - 2.0 * d1))
    off += abs(h * h * b[2 * count + s] - (-6.0 * rise + 2.0 * d0 + 4.0 * d1))
    return 0.0173 * off <= tolerance * max(size[s], abs(a[s]), abs(b[s]))


@cached
def _fits(a, b, h, count, size, tolerance):
    """Whether the cubic through both ends of a piece is near enough to the quintic."""
    fits = True
    for s in range(count):
        fits = fits and _fits_one(a, b, h, s, count, size, tolerance)
    return fits


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


@inlined
def _straightened(left, right, h, count, size):
    """Where slopes are not finite, as of a root at zero, or so large that they cannot be those of a piece so short, as of a length that grows from zero, or
    of a stiff state that follows others within the accuracy of the run, a piece is straight."""
    for s in range(count):
        if not _fits_one(left, right, h, s, count, size, 1e-4):
            slope = (right[s] - left[s]) / h
            left[count + s] = right[count + s] = slope
            left[2 * count + s] = right[2 * count + s] = 0.0


@inlined
def _take_in(left, right, at, end, count, size, found, row):
    """Extrema and integrals of signals over a piece from `at` to `end`."""
    h = end - at
    for s in range(count):
        f0, d0, c0 = left[s], h * left[count + s], h * h * left[2 * count + s]
        f1, d1, c1 = right[s], h * right[count + s], h * h * right[2 * count + s]
        size[s] = max(size[s], abs(f0), abs(f1))
        found.integral[row, s] += h * (0.5 * (f0 + f1) + 0.1 * (d0 - d1) + (c0 + c1) / 120.0)
        found.highest[row, s], where = _highest(f0, d0, c0, f1, d1, c1, found.highest[row, s])
        if where >= 0.0:
            found.when_highest[row, s] = end if where == 1.0 else at + where * h
        low, where = _highest(-f0, -d0, -c0, -f1, -d1, -c1, -found.lowest[row, s])
        found.lowest[row, s] = -low
        if where >= 0.0:
            found.when_lowest[row, s] = end if where == 1.0 else at + where * h


@cached(_nrt=False)
def _read_piece(reader, pieces, origin, begin, end, following, found, row):
    """Extrema, their times and the integrals of signals from begin to end, inside one step that begins at `origin`, added to a row of what was found.

    following: the state at `end` where that is the next node, else empty.
    """
    count, left, stack_t, stack, y = reader.signals, pieces.left, pieces.stack_t, pieces.stack, pieces.y
    if begin == origin:
        _signals_at(reader, pieces, begin, pieces.x, left)
    else:
        _state_at(reader, pieces, origin, begin - origin)
        _signals_at(reader, pieces, begin, y, left)
    if following.size:
        for i in range(following.size):
            y[i] = following[i]
        for i in range(following.size, reader.states):
            y[i] = 0.0
    else:
        _state_at(reader, pieces, origin, end - origin)
    _signals_at(reader, pieces, end, y, stack[0])
    at, top = begin, 0
    stack_t[0] = end
    while top >= 0:
        right = stack[top]
        h = stack_t[top] - at
        if not _fits(left, right, h, count, pieces.size, reader.tolerance):
            middle = at + 0.5 * h
            if top < DEPTH and h > 1.5 * (end - begin) / 2 ** _depth(left, right, count) and at < middle < stack_t[top]:
                top += 1
                stack_t[top] = middle
                _state_at(reader, pieces, origin, middle - origin)
                _signals_at(reader, pieces, middle, y, stack[top])
                continue
            _straightened(left, right, h, count, pieces.size)
        _take_in(left, right, at, stack_t[top], count, pieces.size, found, row)
        for j in range(3 * count):
            left[j] = right[j]
        at = stack_t[top]
        top -= 1


@cached
def read_nodes(reader, nodes, records, windows, size, found, ends):
    """Extrema and integrals of signals over the first `records` recorded nodes, added to what was `found`, shape (windows, signals).

    windows: (begin, end) of each;  size: of the signals so far;  ends: signals at the last node.
    """
    pieces, time = _pieces(reader, size), nodes.time
    for r in range(records):
        last = r == records - 1
        skip = not last
        for w in range(windows.shape[0]):
            if time[r] <= windows[w, 1] and (last or time[r + 1] >= windows[w, 0]):
                skip = False
        if skip:
            continue
        _begin_step(reader, nodes, r, pieces)
        if last:
            _signals_at(reader, pieces, time[r], pieces.x, pieces.stack[0])
            for s in range(reader.signals):
                value = pieces.stack[0, s]
                ends[s] = value
                for w in range(windows.shape[0]):
                    if windows[w, 0] <= time[r] <= windows[w, 1]:
                        found.lowest[w, s] = min(found.lowest[w, s], value)
                        found.highest[w, s] = max(found.highest[w, s], value)
            break
        if time[r + 1] == time[r]:
            continue
        known = False
        for w in range(windows.shape[0]):
            begin, end = max(time[r], windows[w, 0]), min(time[r + 1], windows[w, 1])
            if begin >= end:
                continue
            if not known:
                _slope(reader, time[r], time[r + 1] - time[r], pieces)
                known = True
            following = nodes.state[r + 1] if end == time[r + 1] else nodes.state[r, :0]
            _read_piece(reader, pieces, time[r], begin, end, following, found, w)


@cached
def read_steps(reader, nodes, begin, end, found):
    """Extrema, their times and the integral of one signal in every step between recorded nodes, cut to the window from begin to end.

    The arrays have shape (steps, 1) and hold inf, -inf, nan, nan and 0 at first, which a step without length keeps.
    """
    pieces, time = _pieces(reader, np.zeros(1)), nodes.time
    for r in range(time.size - 1):
        first, last = max(time[r], begin), min(time[r + 1], end)
        if first >= last:
            continue
        _begin_step(reader, nodes, r, pieces)
        _slope(reader, time[r], time[r + 1] - time[r], pieces)
        following = nodes.state[r + 1] if last == time[r + 1] else nodes.state[r, :0]
        _read_piece(reader, pieces, time[r], first, last, following, found, r)


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
def read_events(events, count, finished, end, m, stays):
    """Stays and switches from `count` recorded events, added to what `stays` holds; when `finished`, the last stays end at `end` in the modes m."""
    asked, since = stays.asked, stays.since
    for e in range(count):
        note_end(
            events.element[e],
            events.modes[e, 0],
            events.time[e],
            True,
            since,
            asked,
            stays.spent,
            stays.number,
            stays.latest,
            stays.switches,
        )
    for i in range(since.size if finished else 0):
        note_end(i, np.int8(m[i]), end, False, since, asked, stays.spent, stays.number, stays.latest, stays.switches)
