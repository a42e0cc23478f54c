"""Guards of the event loop: their sizes, what counts as zero, and the armed flags at a point."""

from __future__ import annotations

from toolbox.compilation import work_layout as layout
from toolbox.translation.words import call


def guard_size(w, j):
    """Size of guard j so far; a contact's first guard is a speed in slip and a force in stick, so each has a slot per kind of mode."""
    return w.guard_scale[w.slot[j]]


def close_to_zero(w, j):
    """Return the size below which a guard counts as zero, far below the accuracy of the run. The size is still smaller for a gap that
    closes, since bounces amplify it."""
    if is_open(w, j):
        return 1e-14 * guard_size(w, j)
    return min(max(1e-5 * w.reals[layout.RTOL], 1e-13), 1e-9) * guard_size(w, j)


def is_open(w, j):
    """Whether guard j is the gap of an open rigid contact."""
    return j < 2 * w.ints[layout.NE] and w.kind[j // 2] == layout.RIGID and w.m[j // 2] == 1.0


def stays(w, j, begin, begin_rate, end, end_rate):
    """Whether guard j, which starts at zero, has not fallen through it from the value `begin` to `end`: all that it has lost is round-off.

    A gap that others hold at zero has rates of exactly zero. One that has opened begins inside by what it has drifted while it was closed, and then rises.
    """
    low = -1e-12 * guard_size(w, j)
    if is_open(w, j):
        low += min(w.side[j] * begin, 0.0)
        if begin_rate == 0.0 and end_rate == 0.0:
            return True
    return w.side[j] * end >= low


def flies(w, i):
    """Whether the slip of element i passes through zero unhindered: of a friction whose contact is open, or whose motion is prescribed."""
    return w.loader[i] == layout.PASSES or (w.loader[i] >= 0 and w.m[w.loader[i]] == 1.0)


def without_lever(w, i):
    """Return whether element i is a friction that seems to stick only because its lever is exactly zero. `z` must hold the results of
    `probe`."""
    ne = w.ints[layout.NE]
    return w.lever[i] == 1 and w.m[i] == 0.0 and w.z[4 * ne + i] == 0.0 and w.z[3 * ne + i] > 0.0


def two_directions(w, i):
    """Whether element i is a friction with two slip directions, of which the second is the next element."""
    return i + 1 < w.ints[layout.NE] and w.loader[i + 1] == layout.SECOND


def _take(w, found):
    """Take slopes and guards as machine code has left them, and the states into their sizes so far, and into those of their units."""
    n = w.ints[layout.N]
    w.ints[layout.OPENED] = 0
    for i in range(n):
        w.k[i] = found[n + i]
        size = abs(w.x[i])
        if size > w.scale[i]:
            w.scale[i] = size
            if size > w.group_scale[w.group[i]]:
                w.group_scale[w.group[i]] = size
    for j in range(2 * w.ints[layout.NG]):
        w.g[j] = found[2 * n + j]


def refresh(w):
    """Slopes, guards and armed flags at the current point.

    A contact that has just been let go has no slip yet: what it shows is the round-off of the projection, from which nothing can fall.
    """
    call(w.ints[layout.FIELD], w.reals[layout.TIME], 0.0, w.x, w.k, w.p, w.m, w.z)
    _take(w, w.z)
    for j in range(w.ints[layout.NG]):
        w.slot[j] = j + w.ints[layout.NG] if j < 2 * w.ints[layout.NE] and w.m[j // 2] == 0.0 else j
        w.armed[j] = False
        accept_guard(w, j)
    for i in range(w.ints[layout.NE]):
        if w.zero[i] and w.m[i] != 0.0 and w.kind[i] == layout.FRICTION:
            w.armed[2 * i] = False
    _arm_falling_from_zero(w)


def leaves_zero(w, j):
    """Whether guard j belongs to an open rigid contact, a switch or a kink: it may stand at zero and fall, which no force decides."""
    if j < 2 * w.ints[layout.NE]:
        kind, driven = w.kind[j // 2], w.loader[j // 2] == layout.ONE_WAY  # of a one-way clutch force decides
        return j % 2 == 0 and (kind == layout.SWITCH or (kind == layout.RIGID and w.m[j // 2] == 1.0 and not driven))
    return j < w.ints[layout.NG] - w.ints[layout.BOUNDS]


def _falling_from_zero(w, j):
    """Whether guard j stands at zero, unarmed, and its slope is negative, but of a contact that has just been let go: the closing speed of that is an error."""
    let_go = j < 2 * w.ints[layout.NE] and w.kind[j // 2] == layout.RIGID and w.before[j // 2] == 0.0 and w.ints[layout.STARTED] == 1
    return leaves_zero(w, j) and not w.armed[j] and not let_go and w.side[j] * w.g[w.ints[layout.NG] + j] < 0.0


def _arm_falling_from_zero(w):
    """Arm the guards that stand at zero and fall by more than the round-off of their slope, so that they cross at once.

    An impact changes speeds: it can drive a body into a stop that it touches. The gap there starts at zero and is negative for a short time only, if it rises
    again within the step. Its end does not show that.
    """
    n, ng = w.ints[layout.N], w.ints[layout.NG]
    found = False
    for j in range(ng):
        found = found or _falling_from_zero(w, j)
    if not found:
        return
    nudge(w)
    call(w.ints[layout.FIELD], w.reals[layout.TIME], 0.0, w.x_other, w.k, w.p_other, w.m, w.z)
    for j in range(ng):
        slope = w.g[ng + j]
        if _falling_from_zero(w, j) and abs(slope) > 1e-12 * 1e7 * abs(w.z[2 * n + ng + j] - slope):
            w.armed[j] = True


def held_quietly(w):
    """Accept new held outputs if the guards at the current point show no change of a mode. Return False if a mode may change; nothing has
    been decided then.

    Outputs never enter a slip, and a contact that sticks lets go only where its guards, which are then negative, say so, or where its lever is zero.
    """
    if w.ints[layout.LEVERS] > 0:
        return False
    for i in range(w.ints[layout.NE]):
        if w.kind[i] != layout.FRICTION:
            return False
        w.zero[i] = w.m[i] == 0.0
    refresh(w)
    quiet = True
    for j in range(w.ints[layout.NG]):
        quiet = quiet and w.side[j] * w.g[j] >= 0.0
    return quiet


def nudge(w):
    """States and parameters with small relative changes, all different, in `s` and `q`: they show how large the terms are that cancel."""
    for i in range(w.ints[layout.N]):
        w.x_other[i] = w.x[i] * (1.0 + 1e-7 * (1.0 - 0.3 * (i % 5)))
    for i in range(w.p.size):
        w.p_other[i] = w.p[i] * (1.0 + 1e-7 * (0.9 - 0.37 * (i % 7)))


def loads_hold(w, t, least):
    """Whether no bound of friction is negative here, beyond the round-off of its terms; else CULPRIT is the element. Overwrites `y` and `z`.

    least: looks at elements whose `bound` is that or more: on the way, one that a guard or a contact sees to may lie below zero by what these let pass.
    """
    ne, asked = w.ints[layout.NE], False
    for i in range(ne):
        asked = asked or w.bound[i] >= least
    if not asked:
        return True
    nudge(w)
    call(w.ints[layout.PROBE], t, 0.0, w.x_other, w.k, w.p_other, w.m, w.y)
    call(w.ints[layout.PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    for i in range(ne):
        bound = w.z[3 * ne + i]
        if w.kind[i] == layout.FRICTION and w.bound[i] >= least and bound < -1e-2 * abs(w.y[3 * ne + i] - bound):
            w.ints[layout.CULPRIT] = i
            return False
    return True


def no_modes(w, t):
    """Return the status after no modes were found: NEGATIVE_BOUND with the friction in CULPRIT if a negative bound is the cause, else
    INCONSISTENT."""
    return layout.INCONSISTENT if loads_hold(w, t, layout.BY_CONTACT) else layout.NEGATIVE_BOUND


def project(w, t):
    """Set the slip of sticking elements to exactly zero, if there are any."""
    for i in range(w.ints[layout.NE]):
        if w.m[i] == 0.0 and w.kind[i] != layout.SWITCH:
            call(w.ints[layout.PROJECT], t, 0.0, w.x, w.k, w.p, w.m, w.z)
            for j in range(w.ints[layout.N]):
                w.x[j] = w.z[j]
            return


def finite(w):
    """Whether all states are finite numbers."""
    total = 0.0
    for i in range(w.ints[layout.N]):
        total += 0.0 * w.x[i]
    return total == 0.0


def accept_guard(w, j):
    """Take in the value of guard j at the end of an accepted step: its size so far, and whether it is armed from now on."""
    size = abs(w.g[j])
    if size > guard_size(w, j):
        w.guard_scale[w.slot[j]] = size
    if not w.armed[j] and w.side[j] * w.g[j] > 1e-13 * guard_size(w, j):
        w.armed[j] = True


def accept(w):
    """Take the step in `y`: states, slopes, guards and their sizes so far."""
    for i in range(w.ints[layout.N]):
        w.x[i] = w.y[i]
    _take(w, w.y)
    for j in range(w.ints[layout.NG]):
        accept_guard(w, j)


def bounds_hold(w):
    """Whether no bound of friction is negative at the current guards, beyond round-off."""
    hold = True
    for j in range(w.ints[layout.NG] - w.ints[layout.BOUNDS], w.ints[layout.NG]):
        hold = hold and w.g[j] >= -1e-9 * guard_size(w, j)
    return hold
