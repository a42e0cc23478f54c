"""The compiled loops of `toolbox.measuring.metrics` over the nodes of a run for its signals."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from toolbox.compilation import work_layout as layout
from toolbox.compilation.program import Program
from toolbox.stepping.between import load_node, open_step, room_of, step_between
from toolbox.translation.compiled import Compiled
from toolbox.translation.words import call

DEPTH = 12
"""A step is halved at most so often, so that it has at most 4096 pieces, whatever the signal."""

FEW = 4
"""The same of a step in which slopes are not finite at both ends of a piece."""

SIGNALS, READER = layout.INTS, layout.INTS + 1
"""Indices into `Reading.ints`, behind those of a program: how many signals are read, and the address of the function that gives them with two derivatives."""


class Reading(NamedTuple):
    """Arrays of a run for the reader of its signals, with space for a step and its pieces.

    ints: see above;  tolerance: of a piece, relative to the size of a signal, shape (1,);  p: parameters of the run, with what is held at a node behind
    FIRST_HELD;
    time, state, mode, held: recorded nodes;  windows: (begin, end) of each;
    lowest, highest, when_lowest, when_highest, integral: extrema of signals, their times and their integrals, shape (rows, signals), to which is added;
    ends: signals at the last node;  size: of the signals so far;
    x, k, m: the node that a step begins with;  y, new: at an instant within it;  left, stack: signals where a piece begins, and where those that wait end,
    at the times stack_t.
    """

    ints: np.ndarray
    tolerance: np.ndarray
    p: np.ndarray
    time: np.ndarray
    state: np.ndarray
    mode: np.ndarray
    held: np.ndarray
    windows: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    when_lowest: np.ndarray
    when_highest: np.ndarray
    integral: np.ndarray
    ends: np.ndarray
    size: np.ndarray
    x: np.ndarray
    k: np.ndarray
    m: np.ndarray
    y: np.ndarray
    new: np.ndarray
    left: np.ndarray
    stack_t: np.ndarray
    stack: np.ndarray


KINDS: dict[str, tuple[str, int]] = dict.fromkeys(Reading._fields, ("float64", 1)) | {
    "ints": ("int64", 1), "mode": ("int8", 2),
    **dict.fromkeys(("state", "held", "windows", "lowest", "highest", "when_lowest", "when_highest", "integral", "stack"), ("float64", 2)),
}  # fmt: skip
"""{field of `Reading`: (dtype, number of dimensions)}."""


def reading(program: Program, outputs: int, count: int, tolerance: float, p: np.ndarray, **arrays: np.ndarray) -> Reading:
    """Return the arrays for a reader of `count` signals, with machine code at the address `outputs`. arrays: arrays that depend on the
    run."""
    sizes = {"left": 3 * count, "stack_t": DEPTH + 1, "stack": (DEPTH + 1, 3 * count), "size": count, "ends": count}
    room = room_of(program.kernel) | {name: np.zeros(size) for name, size in sizes.items()}
    ints = np.append(program.ints, [count, outputs])
    return Reading(**{"ints": ints, "tolerance": np.array([tolerance]), "p": p, **room, **arrays})


def _signals_at(w, t, x, out):
    """The signals with two derivatives at an instant."""
    call(w.ints[READER], t, 0.0, x, w.k, w.p, w.m, out)


def _fits_one(w, b, h, s, tolerance):
    """Whether the cubic of signal s through both ends of a piece is within a tolerance, in parts of the size of the signal, of the quintic."""
    a, count = w.left, w.ints[SIGNALS]
    rise, d0, d1 = b[s] - a[s], h * a[count + s], h * b[count + s]
    off = abs(h * h * a[2 * count + s] - (6.0 * rise - 4.0 * d0 - 2.0 * d1))
    off += abs(h * h * b[2 * count + s] - (-6.0 * rise + 2.0 * d0 + 4.0 * d1))
    return 0.0173 * off <= tolerance * max(w.size[s], abs(a[s]), abs(b[s]))


def _fits(w, b, h):
    """Whether the cubic through both ends of a piece is near enough to the quintic."""
    fits = True
    for s in range(w.ints[SIGNALS]):
        fits = fits and _fits_one(w, b, h, s, w.tolerance[0])
    return fits


def _most(w, b):
    """How many pieces the step about a piece may have: few where slopes are not finite at both ends, as those of a root that stays at zero."""
    for s in range(w.ints[SIGNALS], 3 * w.ints[SIGNALS]):
        if not math.isfinite(w.left[s]) and not math.isfinite(b[s]):
            return 2.0**FEW
    return 2.0**DEPTH


def _quartic(s0, s1, s2, s3, s4, u):
    """The polynomial of these control points at u."""
    v = 1.0 - u
    return v * v * v * v * s0 + 4.0 * v * v * v * u * s1 + 6.0 * v * v * u * u * s2 + 4.0 * v * u * u * u * s3 + u * u * u * u * s4


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
        after = _quartic(s0, s1, s2, s3, s4, right)
        if before > 0.0 and after <= 0.0:
            low, high = left, right
            for _ in range(40):
                u = 0.5 * (low + high)
                if _quartic(s0, s1, s2, s3, s4, u) > 0.0:
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


def _straightened(w, right, h):
    """Where slopes are not finite, as of a root at zero, or so large that they cannot be those of a piece so short, as of a length that grows from zero, or
    of a stiff state that follows others within the accuracy of the run, a piece is straight."""
    count = w.ints[SIGNALS]
    for s in range(count):
        if not _fits_one(w, right, h, s, 1e-4):
            slope = (right[s] - w.left[s]) / h
            w.left[count + s], right[count + s] = slope, slope
            w.left[2 * count + s], right[2 * count + s] = 0.0, 0.0


def _take_in(w, right, at, end, row):
    """Extrema and integrals of signals over a piece from `at` to `end`."""
    h, count = end - at, w.ints[SIGNALS]
    for s in range(count):
        f0, d0, c0 = w.left[s], h * w.left[count + s], h * h * w.left[2 * count + s]
        f1, d1, c1 = right[s], h * right[count + s], h * h * right[2 * count + s]
        w.size[s] = max(w.size[s], abs(f0), abs(f1))
        w.integral[row, s] += h * (0.5 * (f0 + f1) + 0.1 * (d0 - d1) + (c0 + c1) / 120.0)
        w.highest[row, s], where = _highest(f0, d0, c0, f1, d1, c1, w.highest[row, s])
        if where >= 0.0:
            w.when_highest[row, s] = end if where == 1.0 else at + where * h
        low, where = _highest(-f0, -d0, -c0, -f1, -d1, -c1, -w.lowest[row, s])
        w.lowest[row, s] = -low
        if where >= 0.0:
            w.when_lowest[row, s] = end if where == 1.0 else at + where * h


def _read_piece(w, origin, begin, end, following, row):
    """Extrema, their times and the integrals of signals from begin to end, inside one step that begins at `origin`, added to a row of what was found.

    following: the node at `end` where that is one, else -1.
    """
    count = w.ints[SIGNALS]
    if begin == origin:
        _signals_at(w, begin, w.x, w.left)
    else:
        step_between(w, origin, begin - origin)
        _signals_at(w, begin, w.y, w.left)
    if following >= 0:
        for i in range(w.state.shape[1]):
            w.y[i] = w.state[following, i]
        for i in range(w.state.shape[1], w.ints[layout.N]):
            w.y[i] = 0.0
    else:
        step_between(w, origin, end - origin)
    _signals_at(w, end, w.y, w.stack[0])
    at, top = begin, 0
    w.stack_t[0] = end
    while top >= 0:
        h = w.stack_t[top] - at
        if not _fits(w, w.stack[top], h):
            middle = at + 0.5 * h
            if top < DEPTH and h > 1.5 * (end - begin) / _most(w, w.stack[top]) and at < middle < w.stack_t[top]:
                top += 1
                w.stack_t[top] = middle
                step_between(w, origin, middle - origin)
                _signals_at(w, middle, w.y, w.stack[top])
                continue
            _straightened(w, w.stack[top], h)
        _take_in(w, w.stack[top], at, w.stack_t[top], row)
        for j in range(3 * count):
            w.left[j] = w.stack[top, j]
        at = w.stack_t[top]
        top -= 1


def _read_nodes(w):
    """Extrema and integrals of signals over the recorded nodes, added to what was found in the rows of the windows, and the signals at the last node."""
    for r in range(w.ints[layout.RECORDS]):
        last = r == w.ints[layout.RECORDS] - 1
        skip = not last
        for q in range(w.windows.shape[0]):
            if w.time[r] <= w.windows[q, 1] and (last or w.time[r + 1] >= w.windows[q, 0]):
                skip = False
        if skip:
            continue
        load_node(w, r)
        if last:
            _signals_at(w, w.time[r], w.x, w.stack[0])
            for s in range(w.ints[SIGNALS]):
                value = w.stack[0, s]
                w.ends[s] = value
                for q in range(w.windows.shape[0]):
                    if w.windows[q, 0] <= w.time[r] <= w.windows[q, 1]:
                        w.lowest[q, s] = min(w.lowest[q, s], value)
                        w.highest[q, s] = max(w.highest[q, s], value)
            break
        if w.time[r + 1] == w.time[r]:
            continue
        known = False
        for q in range(w.windows.shape[0]):
            begin, end = max(w.time[r], w.windows[q, 0]), min(w.time[r + 1], w.windows[q, 1])
            if begin >= end:
                continue
            if not known:
                open_step(w, w.time[r], w.time[r + 1] - w.time[r])
                known = True
            _read_piece(w, w.time[r], begin, end, r + 1 if end == w.time[r + 1] else -1, q)


def _read_steps(w):
    """Extrema, their times and the integral of one signal in every window, each of which lies inside one step between recorded nodes, in order.

    The arrays have shape (windows, 1) and hold inf, -inf, nan, nan and 0 at first.
    """
    r, begun = 0, -1
    for q in range(w.windows.shape[0]):
        begin, end = w.windows[q, 0], w.windows[q, 1]
        while r + 2 < w.time.size and w.time[r + 1] <= begin:
            r += 1
        if r != begun:
            load_node(w, r)
            open_step(w, w.time[r], w.time[r + 1] - w.time[r])
            begun = r
        _read_piece(w, w.time[r], begin, end, r + 1 if end == w.time[r + 1] else -1, q)


read_nodes = Compiled(_read_nodes, KINDS)
read_steps = Compiled(_read_steps, KINDS)
