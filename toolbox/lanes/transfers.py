"""Where a lane stands, carried between its block and the arrays of the scalar loop."""

from __future__ import annotations

import numpy as np

from toolbox.compilation import work_layout
from toolbox.lanes import layout


def copy(target, source, count):
    """Copy the first numbers of an array to another."""
    for i in range(count):
        target[i] = source[i]


def gather(b, item, lane, values, count):
    """The first rows of an item, of one lane."""
    for i in range(count):
        values[i] = b.block[b.rows[item] + i, lane]


def put(b, item, lane, values, count):
    """The same back in their lane."""
    for i in range(count):
        b.block[b.rows[item] + i, lane] = values[i]


def gather_point(b, lane, w):
    """Where a lane stands, in the arrays of the scalar loop."""
    w.reals[work_layout.TIME] = b.block[layout.TIME_ROW, lane]
    w.ints[work_layout.ACCEPTED] = np.int64(b.block[layout.ACCEPTED_ROW, lane])
    w.ints[work_layout.REJECTED] = np.int64(b.block[layout.REFUSED_ROW, lane])
    gather(b, layout.X, lane, w.x, w.ints[work_layout.N])
    gather(b, layout.K, lane, w.k, w.ints[work_layout.N])
    gather(b, layout.P, lane, w.p, w.p.size)
    gather(b, layout.M, lane, w.m, w.ints[work_layout.NE])


def gather_history(b, lane, w):
    """Copy the history of a lane into the arrays of the scalar loop."""
    n, ne, ng = w.ints[work_layout.N], w.ints[work_layout.NE], w.ints[work_layout.NG]
    w.reals[work_layout.STEP_SIZE] = b.block[layout.WANTED_ROW, lane]
    w.reals[work_layout.ERROR_OLD] = b.block[layout.ERROR_OLD_ROW, lane]
    w.reals[work_layout.STEP_OLD] = b.block[layout.STEP_OLD_ROW, lane]
    gather(b, layout.SCALE, lane, w.scale, n)
    gather(b, layout.NOISE, lane, w.noise, n)
    gather(b, layout.GROUP_SCALE, lane, w.group_scale, w.group_scale.size)
    gather(b, layout.G, lane, w.g, 2 * ng)
    gather(b, layout.SIDE, lane, w.side, ng)
    for j in range(2 * ng):
        w.guard_scale[j] = 0.0
    for j in range(ng):
        w.noise[n + j] = 0.0  # of another lane
        w.armed[j] = b.block[b.rows[layout.ARMED] + j, lane] != 0.0
        w.slot[j] = j + ng if j < 2 * ne and w.m[j // 2] == 0.0 else j
        w.guard_scale[w.slot[j]] = b.block[b.rows[layout.GUARD_SCALE] + j, lane]
        if j < 2 * ne:
            w.guard_scale[2 * j + ng - w.slot[j]] = b.block[b.rows[layout.OTHER_SCALE] + j, lane]


def scatter(b, lane, w, stop):
    """The arrays of the scalar loop back in their lane."""
    n, ne, ng = w.ints[work_layout.N], w.ints[work_layout.NE], w.ints[work_layout.NG]
    b.block[layout.TIME_ROW, lane] = w.reals[work_layout.TIME]
    b.block[layout.WANTED_ROW, lane] = w.reals[work_layout.STEP_SIZE]
    b.block[layout.ERROR_OLD_ROW, lane] = w.reals[work_layout.ERROR_OLD]
    b.block[layout.STEP_OLD_ROW, lane] = w.reals[work_layout.STEP_OLD]
    b.block[layout.ACCEPTED_ROW, lane] = w.ints[work_layout.ACCEPTED]
    b.block[layout.REFUSED_ROW, lane] = w.ints[work_layout.REJECTED]
    b.block[layout.STOP_ROW, lane] = stop
    b.block[layout.REJECTED_ROW, lane] = 0.0
    b.block[layout.SEARCHING_ROW, lane] = 0.0
    b.block[layout.FLAG_ROW, lane] = 0.0
    put(b, layout.X, lane, w.x, n)
    put(b, layout.K, lane, w.k, n)
    put(b, layout.SCALE, lane, w.scale, n)
    put(b, layout.NOISE, lane, w.noise, n)
    put(b, layout.M, lane, w.m, ne)
    put(b, layout.GROUP_SCALE, lane, w.group_scale, w.group_scale.size)
    put(b, layout.G, lane, w.g, 2 * ng)
    put(b, layout.SIDE, lane, w.side, ng)
    for j in range(ng):
        b.block[b.rows[layout.ARMED] + j, lane] = 1.0 if w.armed[j] else 0.0
        b.block[b.rows[layout.GUARD_SCALE] + j, lane] = w.guard_scale[w.slot[j]]
    for j in range(2 * ne):
        b.block[b.rows[layout.OTHER_SCALE] + j, lane] = w.guard_scale[2 * j + ng - w.slot[j]]


def gather_samples(b, lane, w):
    """What the sampled laws of a lane remember, hold and have on the way, in the arrays of the scalar loop."""
    depth, widest = w.queue.shape[1], w.queue.shape[2]
    for c in range(w.samplers.shape[0]):
        s = w.samplers[c]
        w.clocks[c, 0], w.clocks[c, 1] = b.block[b.rows[layout.CLOCKS] + 2 * c, lane], b.block[b.rows[layout.CLOCKS] + 2 * c + 1, lane]
        s[work_layout.TAKEN] = np.int64(b.block[b.rows[layout.SAMPLES] + 2 * c, lane])
        s[work_layout.APPLIED] = np.int64(b.block[b.rows[layout.SAMPLES] + 2 * c + 1, lane])
        for q in range(s[work_layout.APPLIED], s[work_layout.TAKEN]):
            for i in range(s[work_layout.OUTPUTS]):
                w.queue[c, q % depth, i] = b.queue[(c * depth + q % depth) * widest + i, lane]
    gather(b, layout.MEMORY, lane, w.memory, w.memory.size)


def scatter_samples(b, lane, w):
    """The same back in their lane, and the stop that is next after the calendar's."""
    depth, widest = w.queue.shape[1], w.queue.shape[2]
    stop = b.block[layout.STOP_ROW, lane]
    b.block[b.rows[layout.CALENDAR], lane] = stop
    for c in range(w.samplers.shape[0]):
        s = w.samplers[c]
        b.block[b.rows[layout.SAMPLES] + 2 * c, lane] = s[work_layout.TAKEN]
        b.block[b.rows[layout.SAMPLES] + 2 * c + 1, lane] = s[work_layout.APPLIED]
        stop = min(stop, s[work_layout.TAKEN] * w.clocks[c, 0])
        if s[work_layout.APPLIED] < s[work_layout.TAKEN]:
            stop = min(stop, s[work_layout.APPLIED] * w.clocks[c, 0] + w.clocks[c, 1])
        for q in range(s[work_layout.APPLIED], s[work_layout.TAKEN]):
            for i in range(s[work_layout.OUTPUTS]):
                b.queue[(c * depth + q % depth) * widest + i, lane] = w.queue[c, q % depth, i]
    put(b, layout.MEMORY, lane, w.memory, w.memory.size)
    b.block[layout.STOP_ROW, lane] = stop


def next_stop(given, w):
    """The next instant of the calendar at which a step must end: an edge of a window, a jump of a parameter or the end."""
    stop = w.reals[work_layout.END]
    for e in range(given.edges.size):
        if w.reals[work_layout.TIME] < given.edges[e] * (1.0 - layout.SLACK):
            stop = min(stop, given.edges[e])
    if w.ints[work_layout.JUMP] < w.jump_t.size:
        stop = min(stop, w.jump_t[w.ints[work_layout.JUMP]])
    return stop
