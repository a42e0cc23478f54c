"""Modes of the elements: decided by force, at the start and at every event."""

from __future__ import annotations

import math

import numpy as np

from toolbox.compilation import work_layout as layout
from toolbox.stepping.guards import bounds_hold, flies, refresh, two_directions, without_lever
from toolbox.stepping.holding import holds
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
