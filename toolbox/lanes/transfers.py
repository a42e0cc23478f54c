"""Where a lane stands, carried between its block and the arrays of the scalar loop."""

from __future__ import annotations

import numpy as np

from toolbox.compilation import work_layout
from toolbox.compilation.numba_cache import inlined
from toolbox.lanes import layout


@inlined
def gather_point(block, rows, lane, w, p):
    """Where a lane stands, in the arrays of the scalar loop."""
    w.reals[work_layout.TIME] = block[layout.TIME_ROW, lane]
    w.ints[work_layout.ACCEPTED] = np.int64(block[layout.ACCEPTED_ROW, lane])
    w.ints[work_layout.REJECTED] = np.int64(block[layout.REFUSED_ROW, lane])
    for i in range(w.ints[work_layout.N]):
        w.x[i] = block[rows[layout.X] + i, lane]
        w.k[i] = block[rows[layout.K] + i, lane]
    for i in range(w.p.size):
        w.p[i] = p[lane, i]
    for i in range(w.ints[work_layout.NE]):
        w.m[i] = block[rows[layout.M] + i, lane]


@inlined
def gather_history(block, rows, lane, w):
    """What a lane remembers of its way, in the arrays of the scalar loop."""
    ne, ng = w.ints[work_layout.NE], w.ints[work_layout.NG]
    w.reals[work_layout.STEP_SIZE] = block[layout.WANTED_ROW, lane]
    w.reals[work_layout.ERROR_OLD] = block[layout.ERROR_OLD_ROW, lane]
    w.reals[work_layout.STEP_OLD] = block[layout.STEP_OLD_ROW, lane]
    for i in range(w.ints[work_layout.N]):
        w.scale[i] = block[rows[layout.SCALE] + i, lane]
        w.noise[i] = block[rows[layout.NOISE] + i, lane]
    for i in range(w.group_scale.size):
        w.group_scale[i] = block[rows[layout.GROUP_SCALE] + i, lane]
    for j in range(2 * ng):
        w.g[j] = block[rows[layout.G] + j, lane]
        w.guard_scale[j] = 0.0
    for j in range(ng):
        w.side[j] = block[rows[layout.SIDE] + j, lane]
        w.armed[j] = block[rows[layout.ARMED] + j, lane] != 0.0
        w.slot[j] = j + ng if j < 2 * ne and w.m[j // 2] == 0.0 else j
        w.guard_scale[w.slot[j]] = block[rows[layout.GUARD_SCALE] + j, lane]
        if j < 2 * ne:
            w.guard_scale[2 * j + ng - w.slot[j]] = block[rows[layout.OTHER_SCALE] + j, lane]


@inlined
def scatter(block, rows, lane, w, stop):
    """The arrays of the scalar loop back in their lane."""
    n, ne, ng = w.ints[work_layout.N], w.ints[work_layout.NE], w.ints[work_layout.NG]
    block[layout.TIME_ROW, lane] = w.reals[work_layout.TIME]
    block[layout.WANTED_ROW, lane] = w.reals[work_layout.STEP_SIZE]
    block[layout.ERROR_OLD_ROW, lane] = w.reals[work_layout.ERROR_OLD]
    block[layout.STEP_OLD_ROW, lane] = w.reals[work_layout.STEP_OLD]
    block[layout.ACCEPTED_ROW, lane] = w.ints[work_layout.ACCEPTED]
    block[layout.REFUSED_ROW, lane] = w.ints[work_layout.REJECTED]
    block[layout.STOP_ROW, lane] = stop
    block[layout.REJECTED_ROW, lane] = 0.0
    block[layout.SEARCHING_ROW, lane] = 0.0
    block[layout.FLAG_ROW, lane] = 0.0
    for i in range(n):
        block[rows[layout.X] + i, lane] = w.x[i]
        block[rows[layout.K] + i, lane] = w.k[i]
        block[rows[layout.SCALE] + i, lane] = w.scale[i]
        block[rows[layout.NOISE] + i, lane] = w.noise[i]
    for i in range(ne):
        block[rows[layout.M] + i, lane] = w.m[i]
    for i in range(w.group_scale.size):
        block[rows[layout.GROUP_SCALE] + i, lane] = w.group_scale[i]
    for j in range(2 * ng):
        block[rows[layout.G] + j, lane] = w.g[j]
    for j in range(ng):
        block[rows[layout.SIDE] + j, lane] = w.side[j]
        block[rows[layout.ARMED] + j, lane] = 1.0 if w.armed[j] else 0.0
        block[rows[layout.GUARD_SCALE] + j, lane] = w.guard_scale[w.slot[j]]
    for j in range(2 * ne):
        block[rows[layout.OTHER_SCALE] + j, lane] = w.guard_scale[2 * j + ng - w.slot[j]]


@inlined
def put_parameters(block, rows, lane, w, p):
    """The parameters of the scalar loop back in their lane."""
    for i in range(w.p.size):
        p[lane, i] = w.p[i]
        block[rows[layout.P] + i, lane] = w.p[i]


@inlined
def gather_samples(block, rows, lane, w, queue):
    """What the sampled laws of a lane remember, hold and have on the way, in the arrays of the scalar loop."""
    depth, widest = w.queue.shape[1], w.queue.shape[2]
    for c in range(w.samplers.shape[0]):
        s = w.samplers[c]
        s[work_layout.TAKEN] = np.int64(block[rows[layout.SAMPLES] + 2 * c, lane])
        s[work_layout.APPLIED] = np.int64(block[rows[layout.SAMPLES] + 2 * c + 1, lane])
        for i in range(s[work_layout.OUTPUTS]):
            w.p[s[work_layout.FIRST_OUTPUT] + i] = block[rows[layout.P] + s[work_layout.FIRST_OUTPUT] + i, lane]
        for q in range(s[work_layout.APPLIED], s[work_layout.TAKEN]):
            for i in range(s[work_layout.OUTPUTS]):
                w.queue[c, q % depth, i] = queue[(c * depth + q % depth) * widest + i, lane]
    for i in range(w.memory.size):
        w.memory[i] = block[rows[layout.MEMORY] + i, lane]


@inlined
def scatter_samples(block, rows, lane, w, queue):
    """The same back in their lane, and the stop that is next after the calendar's."""
    depth, widest = w.queue.shape[1], w.queue.shape[2]
    stop = block[layout.STOP_ROW, lane]
    block[rows[layout.CALENDAR], lane] = stop
    for c in range(w.samplers.shape[0]):
        s = w.samplers[c]
        block[rows[layout.SAMPLES] + 2 * c, lane] = s[work_layout.TAKEN]
        block[rows[layout.SAMPLES] + 2 * c + 1, lane] = s[work_layout.APPLIED]
        stop = min(stop, s[work_layout.TAKEN] * w.clocks[c, 0])
        if s[work_layout.APPLIED] < s[work_layout.TAKEN]:
            stop = min(stop, s[work_layout.APPLIED] * w.clocks[c, 0] + w.clocks[c, 1])
        for q in range(s[work_layout.APPLIED], s[work_layout.TAKEN]):
            for i in range(s[work_layout.OUTPUTS]):
                queue[(c * depth + q % depth) * widest + i, lane] = w.queue[c, q % depth, i]
    for i in range(w.memory.size):
        block[rows[layout.MEMORY] + i, lane] = w.memory[i]
    block[layout.STOP_ROW, lane] = stop


@inlined
def next_stop(w, edges):
    """The next instant of the calendar at which a step must end: an edge of a window, a jump of a parameter or the end."""
    stop = w.reals[work_layout.END]
    for edge in edges:
        if w.reals[work_layout.TIME] < edge * (1.0 - layout.SLACK):
            stop = min(stop, edge)
    if w.ints[work_layout.JUMP] < w.jump_t.size:
        stop = min(stop, w.jump_t[w.ints[work_layout.JUMP]])
    return stop
