"""The loop of time stepping: fixed steps, modes by pivoting, samples, inputs and outputs, compiled once per machine (see `toolbox.compilation.moreau_jean`).

It shares the arrays and the small functions of the event loop.
"""

from __future__ import annotations

import math

from toolbox.compilation import work_layout as layout
from toolbox.stepping.calendar import GO_ON, full, jumps, next_stop, outputs_due, record, samples
from toolbox.stepping.events import BEYOND
from toolbox.stepping.guards import finite, project
from toolbox.stepping.modes import note_event
from toolbox.stepping.starts import begin
from toolbox.translation.compiled import Compiled
from toolbox.translation.words import call


def _switches(w, t):
    """Turn the switches whose guards are negative at the begin of a step; those that turn others follow."""
    n, ne = w.ints[layout.N], w.ints[layout.NE]
    for _ in range(2 * ne):
        turned = False
        call(w.ints[layout.FIELD], t, 0.0, w.x, w.k, w.p, w.m, w.z)
        for i in range(ne):
            if w.kind[i] == layout.SWITCH and w.z[2 * n + 2 * i] < 0.0:
                w.m[i] = 1.0 - w.m[i]
                turned = True
        if not turned:
            break
    for i in range(ne):
        if w.kind[i] == layout.SWITCH and w.m[i] != w.before[i]:
            note_event(w, t, i, w.before[i], w.m[i])


def _agrees(w, i):
    """Whether the mode of element i agrees with the trial step in `y`; where it does not, it is changed. held[i]: 1 where a contact is thrown back."""
    n, ne = w.ints[layout.N], w.ints[layout.NE]
    after, force, bound, slip = w.y[n + i], w.y[n + ne + i], w.y[n + 2 * ne + i], w.y[n + 3 * ne + i]
    tiny = 1e-12 * w.guard_scale[2 * i]
    if w.loader[i] == layout.PASSES:
        way = slip if slip != 0.0 else after
        right = 0.0 if way == 0.0 else math.copysign(1.0, way)
        agrees = w.m[i] == right
        w.m[i] = right
        return agrees
    if w.kind[i] == layout.RIGID:
        if w.m[i] == 0.0:
            if force <= 0.0:
                return True
            w.m[i] = 1.0
            return False
        closure, restitution = w.y[n + 4 * ne + i], w.y[n + 5 * ne + i]
        if w.before[i] != 0.0 and closure < 0.0 and w.loader[i] != layout.ONE_WAY:
            return True  # the gap stays open over this step
        if after + max(0.0, restitution * slip) <= tiny:
            return True
        # thrown back, unless it would fall back within the step
        w.m_other[i] = 1.0 if w.before[i] != 0.0 and restitution * slip > max(after - slip, 0.0) else 0.0
        w.m[i] = 0.0
        return False
    if w.m[i] == 0.0:
        if abs(force) <= bound * (1.0 + 1e-10) or force == 0.0:
            return True
        w.m[i] = -1.0 if force > 0.0 else 1.0
        w.forced[i] = w.lever[i] == 1 and not abs(force) <= BEYOND * bound
        return False
    if w.m[i] * after >= -tiny:
        return True
    w.m[i] = 0.0 if bound > 0.0 and not w.forced[i] else -w.m[i]  # without load, or lever, there is nothing to hold with
    return False


def _step(w, t, h):
    """One step from t with modes that agree with its forces; its result is left in `y`. False where none are found."""
    n, ne = w.ints[layout.N], w.ints[layout.NE]
    together = 12 + 2 * ne
    w.m_other[ne] = 1.0
    plastic = False
    for _ in range(4):
        for i in range(ne):
            w.m_other[i] = 0.0
            w.m[i] = w.before[i]
            w.forced[i] = False
        settled = False
        for attempt in range(together + 200 + 20 * ne):
            call(w.ints[layout.STEP], t, h, w.x, w.m_other, w.p, w.m, w.y)
            settled = True
            for i in range(ne):
                if w.kind[i] == layout.SWITCH or _agrees(w, i):
                    continue
                if plastic:
                    w.m_other[i] = 0.0
                settled = False
                if attempt >= together:
                    break
            if settled:
                break
        for i in range(ne):
            if w.loader[i] == layout.PASSES and w.m[i] == 0.0:
                return False  # a slip that is prescribed stands still
        if not settled and w.m_other[ne] == 0.0:
            return False
        if not settled:
            w.m_other[ne] = 0.0
            continue
        energy, size, thrown = 0.0, 0.0, False
        for i in range(ne):
            work = w.y[n + ne + i] * (w.y[n + 3 * ne + i] + w.y[n + i])
            energy += work
            size += abs(work)
            thrown = thrown or (w.m_other[i] == 1.0 and w.m[i] == 0.0)
        if not thrown or energy <= 1e-12 * size:
            return True
        plastic = True
    return True


def _step_size(w, t):
    """Length of the step from t and the time at its end: the two steps before a stop have the same length."""
    stop, h = next_stop(w), w.reals[layout.STEP_SIZE]
    left = stop - t
    if left <= h * (1.0 + 1e-6):
        return left, stop
    if left < 2.0 * h:
        h = 0.5 * left
    return h, t + h


def _take_modes(w):
    """Take forces and modes from the solution of a step. Returns whether a mode has changed or an impact has been elastic."""
    n, ne = w.ints[layout.N], w.ints[layout.NE]
    switched = False
    for i in range(ne):
        size = abs(w.y[n + i])
        if w.kind[i] != layout.SWITCH and size > w.guard_scale[2 * i]:
            w.guard_scale[2 * i] = size
        w.m_other[ne + 1 + i] = (
            0.0 if w.kind[i] == layout.RIGID and w.before[i] != 0.0 else w.y[n + ne + i]
        )  # the force of an impact does not last
        if w.m_other[i] == 1.0 and w.m[i] == 0.0:
            w.m[i] = 1.0
        else:
            w.m_other[i] = 0.0
        switched = switched or w.m[i] != w.before[i] or w.m_other[i] == 1.0
    return switched


def _record_inside(w, t, h, t_new):
    """Record the output times inside a step, with the modes before it. Returns whether the buffer had room; w.z keeps the modes after the step."""
    n, ne = w.ints[layout.N], w.ints[layout.NE]
    for i in range(ne):
        w.z[i] = w.m[i]
        w.m[i] = w.before[i]
    while w.ints[layout.OUTPUT] < w.out_t.size and w.out_t[w.ints[layout.OUTPUT]] < t_new:
        if w.ints[layout.RECORDS] + 4 > w.rec_t.size:
            return False
        part = (w.out_t[w.ints[layout.OUTPUT]] - t) / h
        for i in range(n):
            w.x_other[i] = w.x[i] + part * (w.y[i] - w.x[i])
        record(w, w.out_t[w.ints[layout.OUTPUT]], w.x_other)
        w.ints[layout.OUTPUT] += 1
    return True


def _advance(w):  # noqa: C901 (a compiled loop)
    """Step until the end time, a full buffer, a sample of a Python controller or the step budget; can be called again."""
    n, ne = w.ints[layout.N], w.ints[layout.NE]
    every = w.ints[layout.NODES]
    budget = w.ints[layout.ACCEPTED] + w.ints[layout.BUDGET]
    turns = False
    for i in range(ne):
        turns = turns or w.kind[i] == layout.SWITCH
    if w.ints[layout.STARTED] == 0 and not begin(w):
        return layout.INCONSISTENT
    while True:
        t = w.reals[layout.TIME]
        status = full(w, 4 * ne + 1)
        if status != GO_ON:
            return status
        changed = jumps(w, t)
        status, held = samples(w, t)
        if status != layout.DONE:
            return status
        if w.ints[layout.STARTED] == 0 or changed or held:
            w.ints[layout.STARTED] = 1
            if every > 0:
                if w.ints[layout.RECORDS] > 0 and w.rec_t[w.ints[layout.RECORDS] - 1] == t and held:
                    w.ints[layout.RECORDS] -= 1
                record(w, t, w.x)
        status = outputs_due(w, t, every > 0)
        if status == layout.DONE and not finite(w):
            return layout.STATE_NOT_FINITE
        if status != GO_ON:
            return status
        if w.ints[layout.ACCEPTED] >= budget:
            return layout.PAUSED

        h, t_new = _step_size(w, t)
        if t_new <= t:
            return layout.UNDERFLOW
        if turns:
            for i in range(ne):
                w.before[i] = w.m[i]
            _switches(w, t)
        for i in range(ne):
            w.before[i] = w.m[i]
        if not _step(w, t, h):
            return layout.INCONSISTENT
        for i in range(n):
            if not math.isfinite(w.y[i]):
                return layout.UNDERFLOW
        switched = _take_modes(w)
        if not _record_inside(w, t, h, t_new):
            return layout.RECORDS_FULL
        if every > 1 and switched and w.rec_t[w.ints[layout.RECORDS] - 1] < t:
            record(w, t, w.x)
        for i in range(ne):
            w.m[i] = w.z[i]
            if w.m[i] != w.before[i] or w.m_other[i] == 1.0:
                note_event(w, t_new, i, w.before[i], w.m[i])
        for i in range(n):
            w.x[i] = w.y[i]
        w.ints[layout.ACCEPTED] += 1
        w.reals[layout.TIME] = t_new
        project(w, t_new)
        if every > 0 and (switched or w.ints[layout.ACCEPTED] % every == 0):
            record(w, t_new, w.x)


advance = Compiled(_advance, layout.KINDS)
"""The loop of time stepping as machine code."""
