"""What is due at an instant of a run: jumps of parameters, samples, held outputs, records."""

from __future__ import annotations

import math

import numpy as np

from toolbox.compilation import work_layout as layout
from toolbox.stepping.guards import bounds_hold, loads_hold, nudge, refresh, two_directions, without_lever
from toolbox.stepping.holding import holds
from toolbox.stepping.modes import settle, turn_switches
from toolbox.stepping.noise import normal, uniform
from toolbox.translation.words import call

GO_ON = -1
"""What is given, instead of a status of the loop, where the run goes on with a step."""


def record(w, t, x):
    """Write a node: time, state, modes and held parameters."""
    r = w.ints[layout.RECORDS]
    w.rec_t[r] = t
    for i in range(w.rec_x.shape[1]):
        w.rec_x[r, i] = x[i]
    for i in range(w.ints[layout.NE]):
        w.rec_m[r, i] = np.int8(w.m[i])
    first = w.ints[layout.FIRST_HELD]
    for i in range(w.p.size - first):
        w.rec_p[r, i] = w.p[first + i]
    w.ints[layout.RECORDS] = r + 1


def full(w, events):
    """Whether the buffers have no room for four more nodes or for a number of events: a status of the loop, or GO_ON."""
    if w.ints[layout.RECORDS] + 4 > w.rec_t.size:
        return layout.RECORDS_FULL
    if w.ints[layout.EVENTS] + events > w.ev_t.size:
        return layout.EVENTS_FULL
    return GO_ON


def inputs_changed(w, t, slips_jump):
    """After a parameter jumped, or a sample: elements whose slip jumped away from zero slide, switches turn, the others are decided by force.

    slips_jump: whether a slip can have jumped; its value before is then in `y`, as `jumps` leaves it, so that who changes parameters does so by `jumps`.
    A change within the round-off of its terms is none. False where no modes are consistent, or a bound is negative now.
    """
    ne = w.ints[layout.NE]
    wrong = False
    if slips_jump:
        for i in range(ne):
            w.m_other[i] = w.y[i]
        nudge(w)
        call(w.ints[layout.PROBE], t * (1.0 + 1e-7), 0.0, w.x_other, w.k, w.p_other, w.m, w.y)
    call(w.ints[layout.PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    for i in range(ne):
        w.before[i] = w.m[i]
        slip, force, static = w.z[i], w.z[2 * ne + i], w.z[3 * ne + i]
        w.zero[i], w.forced[i] = w.m[i] == 0.0 and w.kind[i] != layout.SWITCH, False
        if w.kind[i] != layout.FRICTION:  # an open contact, like a switch, is seen to by its guard
            wrong = wrong or (w.zero[i] and force > 1e-9 * static)
        elif w.m[i] == 0.0:
            jumped = slips_jump and abs(slip - w.m_other[i]) > max(4.0 * layout.EPS * 1e7 * abs(w.y[i] - slip), 1e-9 * w.guard_scale[2 * i])
            if jumped and slip != 0.0:
                w.m[i] = 1.0 if two_directions(w, i) else math.copysign(1.0, slip)
                w.zero[i] = False
                wrong = True
            elif not holds(force, static, w.guard_scale[2 * i + w.ints[layout.NG]]) or without_lever(w, i):
                wrong = True
        elif w.m[i] * slip < 0.0 and not two_directions(w, i):
            w.m[i] = -w.m[i]
            wrong = True
    for i in range(ne):
        if two_directions(w, i) and w.before[i] == 0.0 and w.m[i] != 0.0:
            w.m[i + 1] = 1.0  # it has a direction
    if not wrong:
        refresh(w)
        wrong = turn_switches(w)
    held = settle(w, t) if wrong else bounds_hold(w)
    return held and (not slips_jump or loads_hold(w, t, layout.BY_CONTACT))


def jumps(w, t):
    """Apply the parameter jumps due at time t, and leave the slips before them in `y`; returns whether there were any."""
    changed = False
    if w.ints[layout.JUMP] < w.jump_t.size and w.jump_t[w.ints[layout.JUMP]] <= t:
        call(w.ints[layout.PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.y)
    while w.ints[layout.JUMP] < w.jump_t.size and w.jump_t[w.ints[layout.JUMP]] <= t:
        j = w.ints[layout.JUMP]
        for q in range(w.jump_first[j], w.jump_first[j + 1]):
            w.p[w.jump_index[q]] = w.jump_value[q]
        w.ints[layout.JUMP] = j + 1
        changed = True
    return changed


def sampled_at(w, c, k):
    """Return the instant of sample number k of a controller. Every sample but the first is late by its jitter."""
    instant = k * w.clocks[c, 0]
    if w.clocks[c, 2] > 0.0 and k > 0:
        instant += w.clocks[c, 2] * uniform(w.clock_keys[2 * c], k)
    return instant


def misses(w, c, k):
    """Whether a controller misses its sample of number k; never the first."""
    return w.clocks[c, 3] > 0.0 and k > 0 and uniform(w.clock_keys[2 * c + 1], k) < w.clocks[c, 3]


def samples(w, t):
    """Take all samples due at time t, then hold the outputs due. Returns (status, whether a held value was set).

    NOT_FINITE where a law gives a value that is no finite number, which is left in `z`; its sample then counts as not taken.
    """
    depth = w.queue.shape[1]
    for c in range(w.samplers.shape[0]):
        s = w.samplers[c]
        due = sampled_at(w, c, s[layout.TAKEN]) <= t and t < w.reals[layout.END]
        if due and misses(w, c, s[layout.TAKEN]):
            s[layout.TAKEN] += 1
        elif due:
            if s[layout.ADDRESS] == 0:
                w.ints[layout.CULPRIT] = c
                return layout.SAMPLE_DUE, False
            states, outputs = s[layout.STATES], s[layout.OUTPUTS]
            memory = w.memory[s[layout.FIRST_STATE] :]
            for i in range(states, states + s[layout.NOISES]):
                memory[i] = normal(w.keys[s[layout.FIRST_STATE] + i], s[layout.TAKEN])
            call(s[layout.ADDRESS], t, 0.0, w.x, memory, w.p, w.m, w.z)
            for i in range(outputs):  # the memory stands behind the outputs once more, as it was
                if not math.isfinite(w.z[i]):
                    w.ints[layout.CULPRIT] = c
                    return layout.NOT_FINITE, False
            for i in range(states):
                memory[i] = w.z[i]
            slot = s[layout.TAKEN] % depth if depth > 1 else 0
            for i in range(outputs):
                w.queue[c, slot, i] = w.z[states + i]
            s[layout.TAKEN] += 1
    changed = False
    for c in range(w.samplers.shape[0]):
        s = w.samplers[c]
        while s[layout.APPLIED] < s[layout.TAKEN] and sampled_at(w, c, s[layout.APPLIED]) + w.clocks[c, 1] <= t:
            if not misses(w, c, s[layout.APPLIED]):
                slot = s[layout.APPLIED] % depth if depth > 1 else 0
                for i in range(s[layout.OUTPUTS]):
                    w.p[s[layout.FIRST_OUTPUT] + i] = w.queue[c, slot, i]
                changed = True
            s[layout.APPLIED] += 1
    return layout.DONE, changed


def next_stop(w):
    """The next instant at which a step must end: end of the run, parameter jump, sample or application of a delayed output."""
    stop = w.reals[layout.END]
    if w.ints[layout.JUMP] < w.jump_t.size:
        stop = min(stop, w.jump_t[w.ints[layout.JUMP]])
    for c in range(w.samplers.shape[0]):
        s = w.samplers[c]
        stop = min(stop, sampled_at(w, c, s[layout.TAKEN]))
        if s[layout.APPLIED] < s[layout.TAKEN]:
            stop = min(stop, sampled_at(w, c, s[layout.APPLIED]) + w.clocks[c, 1])
    return stop


def outputs_due(w, t, every_node):
    """Record the output times that are reached, and the end of the run; a status of the loop, or GO_ON."""
    while w.ints[layout.OUTPUT] < w.out_t.size and w.out_t[w.ints[layout.OUTPUT]] <= t:
        record(w, t, w.x)
        w.ints[layout.OUTPUT] += 1
        if w.ints[layout.RECORDS] + 4 > w.rec_t.size:
            return layout.RECORDS_FULL
    if t >= w.reals[layout.END]:
        if every_node and w.rec_t[w.ints[layout.RECORDS] - 1] < t:
            record(w, t, w.x)
        return layout.DONE
    return GO_ON


def outputs_before(w, t_new):
    """Record the output times inside the step (t, t_new) by stepping to each of them."""
    t = w.reals[layout.TIME]
    while w.ints[layout.OUTPUT] < w.out_t.size and w.out_t[w.ints[layout.OUTPUT]] < t_new:
        if w.ints[layout.RECORDS] >= w.rec_t.size:
            return False
        target = w.out_t[w.ints[layout.OUTPUT]]
        call(w.ints[layout.STEP], t, target - t, w.x, w.k, w.p, w.m, w.z)
        x = w.z
        for i in range(w.ints[layout.NE]):
            if w.m[i] == 0.0 and w.kind[i] != layout.SWITCH:
                for j in range(w.ints[layout.N]):
                    w.x_other[j] = w.z[j]
                call(w.ints[layout.PROJECT], target, 0.0, w.x_other, w.k, w.p, w.m, w.z)
                break
        record(w, target, x)
        w.ints[layout.OUTPUT] += 1
    return True
