"""What happens at a located event: which guards fire, what switches, and whether switching has an end."""

from __future__ import annotations

import math

import numpy as np

from toolbox.compilation import work_layout as layout
from toolbox.stepping.guards import flies, guard_size, no_modes, nudge, project, two_directions
from toolbox.stepping.impacts import impact, many_at_once, piles_up
from toolbox.stepping.modes import HELD, ROUND_OFF, decide, modes_consistent, settle
from toolbox.stepping.step_control import first_step, measure_round_off
from toolbox.translation.words import call


def project_event(w, t, again):
    """Mark the guards that fire and set the slips that have just become zero to zero, so that they are so in the record, too.

    Slip in two directions stays until the record is written: at zero its force would have no direction.
    """
    mark(w, again)
    for i in range(w.ints[layout.NE]):
        if w.kind[i] == layout.FRICTION and w.m[i] != 0.0 and w.fired[2 * i] and not flies(w, i) and not two_directions(w, i):
            w.m[i] = 0.0
    project(w, t)
    for i in range(w.ints[layout.NE]):
        w.m[i] = w.before[i]


def after_event(w, t, again):
    """Switch the elements that fire at an event. Return DONE, or the status of `advance` if switching has no end, no modes are consistent,
    or a bound becomes negative.

    again: whether a guard that was at zero has gone below it from the start of a step.
    """
    if t - w.reals[layout.LAST_EVENT] <= 1e-13 * abs(t):
        w.ints[layout.CLOSE] += 1
        if w.ints[layout.CLOSE] > 2 * many_at_once(w):
            return layout.ENDLESS
    elif t - w.reals[layout.LAST_EVENT] > 1e-11 * abs(t):  # between both is the row of events as it was
        w.ints[layout.CLOSE] = 0
    w.reals[layout.LAST_EVENT] = t
    if w.ints[layout.CLOSE] == many_at_once(w) + 1:
        _end_together(w, t)
    if _bound_falls(w):
        return layout.NEGATIVE_BOUND
    if not fire(w, t, again):
        return no_modes(w, t)
    if w.ints[layout.SERIES] != 0:  # the next step follows from its own coefficients
        return layout.DONE
    if w.ints[layout.IMPLICIT] == 1:  # slopes, which the fast modes rule, say less about the next step than the last one does
        w.reals[layout.STEP_OLD] = 0.0
        measure_round_off(w)
    else:
        first_step(w)
    return layout.DONE


TOGETHER = 1e-7
"""Part of its size below which the slip of a friction is zero where frictions switch without end."""


def _end_together(w, t):
    """Put at zero together the slips that switch without end, as two relays do that take each other back and forth ever faster; forces then decide."""
    for i in range(w.ints[layout.NE]):
        slides = w.kind[i] == layout.FRICTION and w.m[i] != 0.0 and not flies(w, i) and not two_directions(w, i)
        if slides and abs(w.g[2 * i]) <= TOGETHER * guard_size(w, 2 * i):
            w.fired[2 * i], w.m[i] = True, 0.0
    project(w, t)
    for i in range(w.ints[layout.NE]):
        w.m[i] = w.before[i]


def _bound_falls(w):
    """Whether a bound that fires becomes negative, of the element in CULPRIT: one that only touches zero, or that a kink keeps at zero, does not."""
    ng = w.ints[layout.NG]
    for q in range(w.ints[layout.BOUNDS]):
        j = ng - w.ints[layout.BOUNDS] + q
        h = max(w.reals[layout.STEP_OLD], w.reals[layout.STEP_SIZE])
        if w.fired[j] and w.g[ng + j] * h < -1e-6 * guard_size(w, j):
            if w.ints[layout.SERIES] != 0:
                call(w.ints[layout.SERIES], w.reals[layout.TIME], h, w.x, w.k, w.p, w.m, w.k)
            call(w.ints[layout.STEP], w.reals[layout.TIME], 1e-3 * h, w.x, w.k, w.p, w.m, w.y)
            if w.y[2 * w.ints[layout.N] + j] < 0.5e-3 * h * w.g[ng + j]:
                w.ints[layout.CULPRIT] = _bounded(w, q)
                return True
    return False


def _bounded(w, q):
    """The element of the bound number q of those that guards watch."""
    before = 0
    for i in range(w.ints[layout.NE]):
        if w.bound[i] == layout.BY_STATES:
            if before == q:
                return i
            before += 1
    return 0


def mark(w, again):
    """Mark the guards that fire now: the located one in any case, others if they are as near to zero and descending, unless it decides again.

    A slip that passes through zero in flight fires alone: it concerns no other element. Where impacts pile up, all gaps at zero take part in the next one.
    """
    ng = w.ints[layout.NG]
    first = w.ints[layout.LOCATED] // 2 if w.ints[layout.LOCATED] < 2 * w.ints[layout.NE] else -1
    alone = first >= 0 and w.m[first] != 0.0 and flies(w, first)
    strikes = first >= 0 and w.m[first] != 0.0 and w.kind[first] == layout.RIGID
    piled_up = strikes and piles_up(w)
    for i in range(w.ints[layout.NE]):
        w.before[i] = w.m[i]
        w.zero[i] = w.m[i] == 0.0 and w.kind[i] != layout.SWITCH
    for j in range(ng):
        rate = w.side[j] * w.g[ng + j]
        # a kink that is at zero and stays there has not been crossed, nor has a gap, which takes part in the impact of another
        stays = j >= 2 * w.ints[layout.NE] or (w.kind[j // 2] == layout.RIGID and w.m[j // 2] != 0.0 and not strikes)
        near = w.side[j] * w.g[j] <= 1e-9 * guard_size(w, j) and (rate < 0.0 or (rate == 0.0 and not stays))
        flying = j < 2 * w.ints[layout.NE] and w.m[j // 2] != 0.0 and flies(w, j // 2)
        w.fired[j] = (near and not again and not alone and not flying) or j == w.ints[layout.LOCATED]
        if piled_up and j % 2 == 0 and j < 2 * w.ints[layout.NE] and w.kind[j // 2] == layout.RIGID and w.m[j // 2] != 0.0:
            w.fired[j] = w.fired[j] or w.g[j] <= 1e-9 * guard_size(w, j)


def fire(w, t, again):
    """Handle the marked guards: kinks change side, switches turn, elements are put at zero slip or released, and modes are decided.

    again: whether a guard that was at zero has gone below it from the start of a step.
    """
    ne, ng = w.ints[layout.NE], w.ints[layout.NG]
    kink, strike = False, False
    for j in range(2 * ne, ng - w.ints[layout.BOUNDS]):
        if w.fired[j]:
            w.side[j] = -w.side[j]
            kink = True
    for i in range(ne):
        w.forced[i] = False
        if w.kind[i] == layout.SWITCH and w.fired[2 * i]:
            w.m[i] = 1.0 - w.m[i]
        strike = strike or (w.kind[i] == layout.RIGID and w.before[i] != 0.0 and w.fired[2 * i])
    if strike:
        impact(w, t)
        if w.ints[layout.COUPLED] == 1 and _closes(w):
            _rest_with_others(w, t)
    else:
        _come_to_rest(w, t, again)
        _release(w)
        _go_with_what_holds(w, t)
        _take_in_what_touches(w, t)
    events = w.ints[layout.EVENTS]
    if not settle(w, t):
        return False
    if w.ints[layout.COUPLED] == 1:
        for e in range(events, w.ints[layout.EVENTS]):
            w.ev_m[e, 2] = np.int8(_other_choice(w, t, w.ev_i[e]))
    if w.ints[layout.EVENTS] == events and not kink:
        w.ints[layout.MERGED] += 1  # touched zero and went on, or left and came back faster than can be resolved
    return True


BEYOND = 1e3
"""From how many times its bound the force that would hold a contact is that of a lever about to vanish, whose slip its motion decides."""


def _cannot_hold(w, t, i):
    """Whether the force that would hold element i is far beyond its bound, as where its lever is almost zero. Leaves its mode as it is."""
    ne, mode = w.ints[layout.NE], w.m[i]
    w.m[i] = 0.0
    call(w.ints[layout.PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    w.m[i] = mode
    return not abs(w.z[2 * ne + i]) <= BEYOND * w.z[3 * ne + i]


def _come_to_rest(w, t, again):
    """Put frictions whose slip has ended at zero slip; one that begins at zero and goes the other way than its mode, and that no force holds, does so."""
    ended, rests = False, False
    for i in range(w.ints[layout.NE]):
        if w.kind[i] == layout.FRICTION and w.before[i] != 0.0 and w.fired[2 * i]:
            if w.loader[i] == layout.PASSES:
                w.zero[i] = True
                continue
            if flies(w, i) or (again and w.lever[i] == 1 and _cannot_hold(w, t, i)):
                w.m[i] = -w.m[i]
                continue
            w.m[i] = 0.0  # its slip has been projected to zero already, in two directions it is now
            w.zero[i] = True
            rests = True
            if two_directions(w, i):
                w.m[i + 1] = 0.0
                ended = True
    if ended:
        project(w, t)
    if rests and w.ints[layout.COUPLED] == 1:
        _rest_with_others(w, t)


def _closes(w):
    """Whether a contact that has just struck stays closed, which ends the slips of the bodies that it holds."""
    closes = False
    for i in range(w.ints[layout.NE]):
        closes = closes or (w.struck[i] and w.zero[i])
    return closes


def _rest_with_others(w, t):
    """Put frictions at rest whose slip what has just come to rest holds at zero, as that of a body that a closed stop ties to another one at rest.

    A friction that was released at this instant has no slip and no slip rate either, but another one if it pulled the other way.
    """
    ne = w.ints[layout.NE]
    call(w.ints[layout.PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    for i in range(ne):
        slides = w.kind[i] == layout.FRICTION and w.m[i] != 0.0 and not w.zero[i] and w.lever[i] == 0 and not flies(w, i)
        if not slides or w.loader[i] == layout.SECOND or two_directions(w, i):
            continue
        if abs(w.z[i]) <= 1e-9 * guard_size(w, 2 * i) and _stays(w, i):
            w.m[i] = -w.m[i]
            call(w.ints[layout.PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)
            w.m[i] = 0.0 if _stays(w, i) else -w.m[i]
            w.zero[i] = w.m[i] == 0.0
            call(w.ints[layout.PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)


def _stays(w, i):
    """Whether the slip of a friction has no rate."""
    ne = w.ints[layout.NE]
    return abs(w.z[ne + i]) <= HELD * abs(w.z[4 * ne + i])


def _release(w):
    """Let go what is at the limit of its force: frictions in the direction of the guard that fired, rigid contacts that no longer push."""
    for i in range(w.ints[layout.NE]):
        if w.kind[i] == layout.FRICTION:
            w.forced[i] = w.before[i] == 0.0 and w.fired[2 * i] != w.fired[2 * i + 1]
            if w.forced[i]:
                w.m[i] = -1.0 if w.fired[2 * i] else 1.0
        elif w.kind[i] == layout.RIGID and w.before[i] == 0.0 and w.fired[2 * i]:
            w.m[i], w.forced[i] = 1.0, True


def _go_with_what_holds(w, t):
    """Let frictions go together that hold each other, as on two bodies that a clutch locks to each other.

    One that is let go has no slip while others hold it: it has not come to rest where one of these is let go, too. And one that reaches its limit takes along
    those that hold it and are at theirs, but for what events are located by.
    """
    ne, ng = w.ints[layout.NE], w.ints[layout.NG]
    released = False
    for i in range(ne):
        released = released or (w.kind[i] == layout.FRICTION and w.forced[i])
    if not (released and w.ints[layout.COUPLED] == 1):
        return
    call(w.ints[layout.PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    held = False
    for i in range(ne):
        if w.kind[i] != layout.FRICTION or two_directions(w, i) or w.loader[i] == layout.SECOND:
            continue
        still = HELD * abs(w.z[4 * ne + i])
        if w.zero[i] and w.m[i] == 0.0 and w.before[i] != 0.0 and abs(w.g[ng + 2 * i]) <= still:
            w.m[i], w.forced[i] = w.before[i], True
        held = held or (w.forced[i] and _stays(w, i))
    if not held:
        return
    for i in range(ne):
        w.m_other[i] = w.m[i]
        stuck = w.m[i] == 0.0 and w.before[i] == 0.0 and w.kind[i] == layout.FRICTION and not two_directions(w, i)
        if stuck and w.loader[i] != layout.SECOND and abs(w.z[2 * ne + i]) >= (1.0 - HELD) * w.z[3 * ne + i]:
            w.m[i] = -math.copysign(1.0, w.z[2 * ne + i])
    if modes_consistent(w, t, False, -1):
        for i in range(ne):
            w.forced[i] = w.forced[i] or w.m[i] != w.m_other[i]
    else:
        for i in range(ne):
            w.m[i] = w.m_other[i]


def _take_in_what_touches(w, t):
    """Let forces decide on the open rigid contacts, too, whose gap is zero and stays so.

    Where a stop lets go of a body without play the one opposite holds from then on: between both the force is zero, to what events are located by, and would
    drive the body from one to the other without end.
    """
    n, ne = w.ints[layout.N], w.ints[layout.NE]
    touches, released, least = False, False, 0.0
    for i in range(ne):
        if w.kind[i] == layout.RIGID:
            least = max(least, 1e-9 * w.guard_scale[2 * i + w.ints[layout.NG]])
            released = released or w.forced[i]
    for i in range(ne):
        near = released or w.g[2 * i] <= 1e-9 * guard_size(w, 2 * i)
        touches = touches or (w.kind[i] == layout.RIGID and w.m[i] != 0.0 and not w.forced[i] and near)
    if not touches:
        return
    nudge(w)
    call(w.ints[layout.FIELD], t * (1.0 + 1e-7), 0.0, w.x_other, w.k, w.p_other, w.m, w.z)
    for i in range(ne):
        w.m_other[i] = w.z[2 * n + 2 * i]
    call(w.ints[layout.FIELD], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    for i in range(ne):
        gap = w.z[2 * n + 2 * i]
        part = (
            max(ROUND_OFF, 1e7 * w.reals[layout.RTOL]) if released else ROUND_OFF
        )  # of a body that moves with its stops the gap has drifted
        w.m_other[i] = 1.0 if abs(gap) <= part * abs(w.m_other[i] - gap) else 0.0
    call(w.ints[layout.PROBE], t * (1.0 + 1e-7), 0.0, w.x_other, w.k, w.p_other, w.m, w.y)
    call(w.ints[layout.PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    for i in range(ne):
        if (
            w.kind[i] == layout.RIGID
            and w.m[i] != 0.0
            and not w.forced[i]
            and w.m_other[i] == 1.0
            and abs(w.z[i]) <= ROUND_OFF * abs(w.y[i] - w.z[i])
        ):
            w.zero[i] = True
            if released and w.lever[i] == layout.OPPOSED and abs(w.z[ne + i]) <= least * abs(w.z[4 * ne + i]):
                w.m[i], w.forced[i] = 0.0, True
    w.m_other[ne] = least


def _other_choice(w, t, i):
    """Whether the contact i that has just switched could have done otherwise: stuck where it slides, or slid on or back where it sticks.

    The others decide anew each time. Where forces hold each other and static friction is above kinetic both can be consistent. Leaves the modes in m.
    """
    ne = w.ints[layout.NE]
    if w.kind[i] != layout.FRICTION or not w.zero[i]:
        return False
    for j in range(ne):
        w.m_other[j] = w.m[j]
    possible = False
    for way in (-1.0, 0.0, 1.0):
        if way == w.m_other[i] or (way != 0.0 and w.m_other[i] != 0.0) or possible or (way < 0.0 and two_directions(w, i)):
            continue
        for j in range(ne):
            w.m[j] = w.m_other[j]
        w.m[i] = way
        w.zero[i] = False
        if decide(w, t):
            w.zero[i] = True
            if modes_consistent(w, t, False, -1):
                rate, force, static, pace = w.z[ne + i], w.z[2 * ne + i], w.z[3 * ne + i], w.z[4 * ne + i]
                # clearly so: at its limit a contact is on the border of both
                possible = abs(force) < (1.0 - 1e-6) * static if way == 0.0 else way * rate > 1e-6 * abs(pace)
        w.zero[i] = True
    for j in range(ne):
        w.m[j] = w.m_other[j]
    return possible
