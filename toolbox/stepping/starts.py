"""How a run begins: the modes that follow from its start state, or that an earlier run has left."""

from __future__ import annotations

import math

from toolbox.compilation import work_layout as layout
from toolbox.stepping.guards import bounds_hold, loads_hold, nudge, project, refresh, two_directions
from toolbox.stepping.modes import ROUND_OFF, SEEN, decide, note_event
from toolbox.translation.words import call


def _gaps_open(w, t):
    """Set `m_other` to 1 where a gap is closed, to 0 where it is open; False where a rigid contact is inside.

    A gap whose mode is known was looked at when that was decided. Another one is closed where it is zero within the round-off of its terms, or inside by less
    than 1e-14 of the way that its acceleration covers in the run, as the last numbers of a run that came to rest are.
    """
    n, ne = w.ints[layout.N], w.ints[layout.NE]
    span = max(w.reals[layout.END], w.reals[layout.HORIZON]) - t
    rigid = False
    for i in range(ne):
        rigid = rigid or w.kind[i] == layout.RIGID
    if rigid:
        call(w.ints[layout.FIELD], t, 0.0, w.x_other, w.k, w.p_other, w.m, w.z)
        for i in range(ne):
            w.m_other[i] = w.z[2 * n + 2 * i]
        call(w.ints[layout.PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.y)
        call(w.ints[layout.FIELD], t, 0.0, w.x, w.k, w.p, w.m, w.z)
        for i in range(ne):
            gap = w.z[2 * n + 2 * i]
            close = w.initial[i] != layout.UNDECIDED or abs(gap) <= ROUND_OFF * abs(w.m_other[i] - gap)
            if w.kind[i] == layout.RIGID and gap < 0.0 and not close:
                close = -gap <= 1e-14 * abs(w.y[ne + i]) * span * span
                if not close:
                    w.ints[layout.CULPRIT] = i
                    return False
            w.m_other[i] = 1.0 if close else 0.0
    return True


def _turn_switches(w, t):
    """Turn switches until all guards agree: one may turn another."""
    n, ne, ng = w.ints[layout.N], w.ints[layout.NE], w.ints[layout.NG]
    for _ in range(2 * ne):
        call(w.ints[layout.FIELD], t, 0.0, w.x, w.k, w.p, w.m, w.z)
        turned = False
        for i in range(ne):
            g, rate = w.z[2 * n + 2 * i], w.z[2 * n + ng + 2 * i]
            size = max(w.guard_scale[2 * i], w.guard_scale[2 * i + ng])  # 0 but where a run goes on
            if w.kind[i] == layout.SWITCH and (g < -SEEN * size or (size == 0.0 and g == 0.0 and rate < 0.0)):
                w.m[i] = 1.0 - w.m[i]
                turned = True
        if not turned:
            break


def _arm_what_falls(w):
    """Arm the guards about to fall through zero where a run goes on, as it may be cut at a release or a rest, but not those that stay at zero.

    So is a gap that is closed at the start and closes on: it strikes at once, also where it opens again within a step.
    """
    for j in range(2 * w.ints[layout.NE]):
        i, rate = j // 2, w.side[j] * w.g[j + w.ints[layout.NG]]
        if j % 2 == 0 and w.kind[i] == layout.RIGID and w.m[i] == 1.0 and w.m_other[i] == 1.0 and not w.zero[i]:
            w.armed[j] = w.armed[j] or rate < 0.0
        if w.initial[i] != layout.UNDECIDED and w.kind[i] != layout.SWITCH:
            falls = rate < 0.0 and not w.zero[i] and j % 2 == 0
            w.armed[j] = w.armed[j] or falls or (w.m[i] == 0.0 and (rate < 0.0 or w.side[j] * w.g[j] > 0.0))


def _place(w, i):
    """Put element i at zero slip, or into a slip, by what `probe` has left in `z`, and in `y` with small changes; what an earlier run has left is kept."""
    ne = w.ints[layout.NE]
    slip, known = w.z[i], w.initial[i] != layout.UNDECIDED
    if w.kind[i] == layout.SWITCH:
        w.zero[i] = False
        return
    w.zero[i] = abs(slip) <= ROUND_OFF * abs(w.y[i] - slip)
    if w.kind[i] == layout.RIGID:
        w.zero[i] = w.zero[i] and w.m_other[i] == 1.0
        if not known:
            w.m[i] = 0.0 if w.zero[i] else 1.0
        elif not w.zero[i]:
            w.m[i] = 1.0
        return
    if known and (w.zero[i] or abs(slip) <= SEEN * w.guard_scale[2 * i]):
        # it sticks, has just been let go, or is about to come to rest, which is an event still to come
        w.zero[i] = w.m[i] == 0.0 or (w.zero[i] and w.m[i] * w.z[ne + i] >= -1e-7 * abs(w.z[4 * ne + i]))
    elif not w.zero[i]:
        w.m[i] = 1.0 if two_directions(w, i) else math.copysign(1.0, slip)
    w.forced[i] = w.zero[i] and w.m[i] != 0.0  # it had just been let go
    if two_directions(w, i) and (not known or w.m[i] == 0.0 or w.initial[i] == 0.0):
        w.m[i + 1] = abs(w.m[i])


def begin(w):
    """Modes from the start state, then slopes, guards and the first step size. False where no modes are consistent.

    An element slides where its slip is not zero; at zero slip force decides, which begins with the mode that an earlier run has left, if there is one. Rigid
    contacts are closed where their gap is, and does not close or open; switches turn until their guards agree.
    """
    n, ne, ng = w.ints[layout.N], w.ints[layout.NE], w.ints[layout.NG]
    t = w.reals[layout.TIME]
    for i in range(ne):
        w.m[i], w.forced[i] = w.initial[i], False
        if w.m[i] == layout.UNDECIDED:
            w.m[i] = 1.0 if w.kind[i] == layout.RIGID else 0.0
    # a slip, or a gap, is zero where it is no more than the round-off of its terms, which small relative changes show
    nudge(w)
    if not _gaps_open(w, t):
        return False
    call(w.ints[layout.PROBE], t, 0.0, w.x_other, w.k, w.p_other, w.m, w.y)
    call(w.ints[layout.PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    for i in range(ne):
        _place(w, i)
    _turn_switches(w, t)
    project(w, t)
    if not decide(w, t):
        return False
    for i in range(ne):  # what an earlier run held, and numbers that have changed since let go, switches here
        if two_directions(w, i):
            w.m[i] = abs(w.m[i])
        if w.zero[i] and w.initial[i] != layout.UNDECIDED and w.m[i] != w.initial[i]:
            note_event(w, t, i, w.initial[i], w.m[i])
    if not loads_hold(w, t, layout.BY_CONTACT):  # one that is constant has no guard
        return False
    call(w.ints[layout.FIELD], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    for j in range(2 * ne, ng - w.ints[layout.BOUNDS]):
        g, rate = w.z[2 * n + j], w.z[2 * n + ng + j]
        w.side[j] = -1.0 if g < 0.0 or (g == 0.0 and rate < 0.0) else 1.0
    refresh(w)
    _arm_what_falls(w)
    return bounds_hold(w)
