"""Modes of the elements: decided by force, at the start and at every event."""

from __future__ import annotations

import math

import numpy as np

from toolbox.compilation import work_layout as layout
from toolbox.stepping.guards import bounds_hold, flies, guard_size, nudge, project, refresh, two_directions, without_lever
from toolbox.stepping.holding import holds
from toolbox.stepping.impacts import impact, piles_up
from toolbox.translation.words import call

ROUND_OFF = 4.0 * layout.EPS * 1e7
"""What the round-off of a number is in parts of what `nudge` changes it by."""

ZERO_RATE = 1e-12
"""Part of the forces at an open contact from which on the rate that they leave closes it: those that hold each other cancel to no better."""

HELD = 1e-7
"""Part of what its bound makes below which the rate of a slip is zero."""

SEEN = 2e-9
"""How far a guard must have passed zero, in parts of its size, to have been passed: more than events are located to."""


RESIDUE = 10.0
"""How much larger the round-off of the rate at an open contact may be than that of contacts that hold each other beside it."""


def _residue(w):
    """The round-off of rates that `probe` has left in `z`, in parts of what bounds make: those of contacts that hold are zero but for it."""
    ne, most = w.ints[layout.NE], 0.0
    for i in range(ne):
        if w.zero[i] and w.m[i] == 0.0 and w.lever[i] != 1:
            most = max(most, min(abs(w.z[ne + i]), 1e-11 * abs(w.z[4 * ne + i])) / max(abs(w.z[4 * ne + i]), 1e-300))
    return RESIDUE * most


def modes_consistent(w, t, change, one):
    """Return whether the modes of the elements marked in `zero` agree with the forces. `change` corrects wrong modes: all, or only the
    first from element `one` on."""
    ne = w.ints[layout.NE]
    call(w.ints[layout.PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    consistent = True
    for j in range(ne):
        i = j if one < 0 else (j + one) % ne
        if not w.zero[i]:
            continue
        rate, force, static, pace = w.z[ne + i], w.z[2 * ne + i], w.z[3 * ne + i], w.z[4 * ne + i]
        if w.kind[i] == layout.RIGID:  # pushes while closed (a multiplier below zero), and stays open where the gap grows
            hands_over = w.forced[i] and w.before[i] != 0.0
            if (
                force <= (w.m_other[ne] if hands_over else 0.0)
                if w.m[i] == 0.0
                else rate <= abs(pace) * max(1e-9 * w.guard_scale[2 * i + w.ints[layout.NG]], ZERO_RATE * abs(static), _residue(w))
            ):
                continue  # released where its force is zero, it may seem to close by the round-off of that zero
            right = 1.0 - w.m[i]
        elif flies(w, i):
            if w.m[i] != 0.0:
                continue
            right = -1.0 if force > 0.0 else 1.0
        elif w.m[i] == 0.0:
            if holds(force, static, w.guard_scale[2 * i + w.ints[layout.NG]]):
                continue
            right = -1.0 if force > 0.0 else 1.0
        else:
            # a contact released exactly at its limit starts with zero slip rate and must not fall back
            if w.m[i] * rate >= -HELD * abs(pace):
                continue
            right = 0.0
        if not change:
            return False
        consistent = False
        w.m[i] = right
        if one >= 0:
            return False
    return consistent


def decide(w, t):
    """Decide the modes of the elements marked in `zero` by force: stick if the bound allows it, else slip in the direction of the excess.

    Starts from the modes in m and changes all inconsistent elements at once; if that does not settle, one by one. With static friction above
    kinetic several sets can be consistent: where a contact comes to rest, one that was stuck before stays so if it can, and what can stick beside the others
    does. Returns False where no consistent set is found.
    """
    ne = w.ints[layout.NE]
    together = 20 + 4 * ne
    settled = w.ints[layout.COUPLED] == 1 and _stuck_stay(w, t)
    for attempt in range(0 if settled else together + 60 + 20 * ne):
        if modes_consistent(w, t, True, -1 if attempt < together else attempt % ne):
            settled = True
            break
    if settled and w.ints[layout.COUPLED] == 1:
        for i in range(ne):
            if w.zero[i] and not w.forced[i] and w.m[i] != 0.0 and w.kind[i] == layout.FRICTION:
                _stick_if_it_can(w, t, i)
    if settled and w.ints[layout.COUPLED] == 1:
        _caught(w, t)
    if settled and w.ints[layout.LEVERS] > 0:
        _let_pass(w, t)
    return settled and _passes(w, t)


def _stick_if_it_can(w, t, i):
    """Let friction i stick where that agrees with the other modes, or with closed contacts beside it that then let go and frictions that then stick, too."""
    ne, opens = w.ints[layout.NE], False
    for j in range(ne):
        w.m_other[ne + 1 + j] = w.m[j]
        opens = opens or (w.kind[j] == layout.RIGID and w.zero[j] and w.m[j] == 0.0)
    w.m[i] = 0.0
    agrees = modes_consistent(w, t, False, -1)
    if not agrees and opens:
        w.zero[i] = False
        for _ in range(20 + 4 * ne):
            if modes_consistent(w, t, True, -1):
                break
        w.zero[i] = True
        agrees = modes_consistent(w, t, False, -1)
        for j in range(ne):
            agrees = agrees and (w.kind[j] != layout.FRICTION or w.m[j] == 0.0 or w.m_other[ne + 1 + j] == w.m[j])
    for j in range(0 if agrees else ne):
        w.m[j] = w.m_other[ne + 1 + j]


def _caught(w, t):
    """Keep a friction at rest that reached its limit where a contact which it thereby closes holds it within that: it has not slipped."""
    ne, closed = w.ints[layout.NE], False
    for i in range(ne):
        closed = closed or (w.kind[i] == layout.RIGID and w.zero[i] and w.m[i] == 0.0 and w.before[i] == 1.0)
    if closed:  # those that it sets in motion may hold, too
        held = True
        for i in range(ne):
            w.m_other[ne + 1 + i] = w.m[i]
            if w.kind[i] == layout.FRICTION and w.zero[i] and w.before[i] == 0.0:
                w.m[i] = 0.0
        held = modes_consistent(w, t, False, -1)
        for i in range(ne):
            held = held and not (w.forced[i] and w.m[i] == 0.0 and abs(w.z[2 * ne + i]) > (1.0 - 1e-9) * w.z[3 * ne + i])
        for i in range(0 if held else ne):
            w.m[i] = w.m_other[ne + 1 + i]
    for i in range(ne if closed else 0):
        if w.kind[i] == layout.FRICTION and w.zero[i] and w.forced[i] and w.before[i] == 0.0 and w.m[i] != 0.0:
            mode = w.m[i]
            w.m[i] = 0.0
            if not modes_consistent(w, t, False, -1) or abs(w.z[2 * ne + i]) > (1.0 - 1e-9) * w.z[3 * ne + i]:
                w.m[i] = mode


STUCK, ARRIVES, LET_GO = 1.0, 2.0, 3.0
"""What a friction is where another comes to rest, behind the modes in `m_other`; 0 for none of these."""


def _what_was_stuck(w):
    """Note what every friction without slip was; returns how many were stuck, 0 where none comes to rest."""
    ne, kept, arrives = w.ints[layout.NE], 0, False
    for i in range(ne):
        w.m_other[ne + 1 + i] = 0.0
        if w.kind[i] == layout.FRICTION and w.zero[i] and w.m[i] == 0.0:
            if w.before[i] != 0.0:
                w.m_other[ne + 1 + i] = ARRIVES
                arrives = True
            elif not w.forced[i]:
                w.m_other[ne + 1 + i] = STUCK
                kept += 1
    return kept if arrives else 0


def _agrees_with_stuck(w, t, way):
    """Whether modes are found with what was stuck at rest, beginning with what arrives at rest (0), going on (1) or going back (-1)."""
    ne = w.ints[layout.NE]
    for i in range(ne):
        if w.m_other[ne + 1 + i] == STUCK:
            w.m[i], w.zero[i] = 0.0, False
        elif w.m_other[ne + 1 + i] == ARRIVES:
            w.m[i] = abs(way) * w.before[i] if two_directions(w, i) else way * w.before[i]
    for _ in range(20 + 4 * ne):
        if modes_consistent(w, t, True, -1):
            break
    for i in range(ne):
        w.zero[i] = w.zero[i] or w.m_other[ne + 1 + i] == STUCK
    return modes_consistent(w, t, False, -1)


def _stuck_stay(w, t):
    """Find modes in which what was stuck before stays so, where a friction comes to rest beside it; False, with the modes as they were, where none agree.

    What comes to rest is tried at rest, going on and going back. What holds least of all is let go where none of that is consistent.
    """
    ne, kept = w.ints[layout.NE], _what_was_stuck(w)
    if kept == 0:
        return False
    if modes_consistent(w, t, False, -1):
        return True
    while kept > 0:
        worst, most = -1, 1.0
        for way in (0.0, 1.0, -1.0):
            if _agrees_with_stuck(w, t, way):
                return True
            for i in range(ne if way == 0.0 else 0):
                part = abs(w.z[2 * ne + i]) / max(w.z[3 * ne + i], 1e-300)
                if w.m_other[ne + 1 + i] == STUCK and part > most:
                    worst, most = i, part
        if worst < 0:
            break
        w.m_other[ne + 1 + worst] = LET_GO  # decided like the others from here on
        kept -= 1
    for i in range(ne):
        if w.m_other[ne + 1 + i] > 0.0:
            w.m[i] = 0.0
    return False


LOOKS = 7
"""How many times are tried in which a slip without lever shows the way it goes: each is ten times longer than the one before, the last 4e-4 of the run."""


def _let_pass(w, t):
    """Let frictions slide whose lever is exactly zero while what they rub on moves, or is set in motion: no force holds such a slip, and its rate is zero, too.

    They slide the way that a few short steps show. Where those show none, all is at rest.
    """
    for i in range(w.ints[layout.NE]):
        if w.zero[i] and without_lever(w, i):
            w.m[i] = 1.0
            w.m[i] = _way(w, t, i)


def _passes(w, t):
    """Let slips that are prescribed, or those of relays of higher degree, go on the way that a few short steps show; False where one stands still."""
    for i in range(w.ints[layout.NE]):
        if w.loader[i] == layout.PASSES and (w.m[i] == 0.0 or w.zero[i]):
            w.m[i] = _way(w, t, i)
            if w.m[i] == 0.0:
                return False
    return True


def _way(w, t, i):
    """The sign of slip i after the shortest of a few short steps after which it is not zero; 0 where it stays zero."""
    n = w.ints[layout.N]
    slip, h = 0.0, 1e-10 * w.reals[layout.HORIZON]
    for _ in range(LOOKS):
        for j in range(n):
            w.x_other[j] = w.x[j]
        for step in range(4):  # a force that begins at zero moves the lever in the third
            call(w.ints[layout.FIELD], t + step * h, 0.0, w.x_other, w.k, w.p, w.m, w.y)
            for j in range(n):
                w.x_other[j] += h * w.y[n + j]
        call(w.ints[layout.PROBE], t + 4.0 * h, 0.0, w.x_other, w.k, w.p, w.m, w.y)
        slip = w.y[i]
        if slip != 0.0:
            break
        h *= 10.0
    return 0.0 if slip == 0.0 or not math.isfinite(slip) else math.copysign(1.0, slip)


def turn_switches(w):
    """Turn every switch whose threshold is passed at the current guards by more than events are located to; returns whether there was one."""
    turned = False
    for i in range(w.ints[layout.NE]):
        size = max(
            w.guard_scale[2 * i], w.guard_scale[2 * i + w.ints[layout.NG]]
        )  # in both positions: a position that is new has seen nothing yet
        if w.kind[i] == layout.SWITCH and w.g[2 * i] < -SEEN * size:
            w.m[i] = 1.0 - w.m[i]
            turned = True
    return turned


def settle(w, t):
    """Decide the modes at the current point, record the changes, and update slopes and guards. Return False if no modes are consistent.

    A switch whose threshold is passed turns, too, which may change the forces that decide, and turn others.
    """
    for _ in range(2 * w.ints[layout.NE] + 1):
        if not decide(w, t):
            return False
        for i in range(w.ints[layout.NE]):
            if two_directions(w, i) and flies(w, i):
                w.m[i + 1] = 1.0
        refresh(w)
        if not bounds_hold(w):
            return False
        if not turn_switches(w):
            break
    for i in range(w.ints[layout.NE]):
        if w.m[i] != w.before[i] or w.struck[i]:
            w.struck[i] = False
            note_event(w, t, i, w.before[i], w.m[i])
    return True


def note_event(w, t, i, before, after):
    """Note a switch of element i."""
    e = w.ints[layout.EVENTS]
    w.ev_t[e], w.ev_i[e] = t, i
    w.ev_m[e, 0], w.ev_m[e, 1], w.ev_m[e, 2] = np.int8(before), np.int8(after), 0
    w.ints[layout.EVENTS], w.ints[layout.CULPRIT] = e + 1, i


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
