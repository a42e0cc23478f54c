"""Impacts of rigid contacts: impulses of restitution and Coulomb friction that never add energy."""

from __future__ import annotations

import math

from toolbox.compilation import work_layout as layout
from toolbox.stepping.guards import guard_size, nudge, project
from toolbox.translation.words import call


def balanced(w, t):
    """Impulses in `y` of an impact of the held elements: unilateral ones that push, friction within its bound. Returns the energy they add.

    Friction holds at first. Where its impulse exceeds the bound it slides against that impulse, which a strong normal impulse can make another way than before;
    where no way of sliding lasts it holds again. A unilateral contact is let go only after the friction that it presses, which by holding can pull at it.
    """
    n, ne = w.ints[layout.N], w.ints[layout.NE]
    for _ in range(4 * ne + 8):
        call(w.ints[layout.IMPULSE], t, 0.0, w.x, w.m_other, w.p, w.m, w.y)
        settled = True
        for i in range(ne):
            impulse, after, bound = w.y[n + i], w.y[n + 2 * ne + i], w.y[n + 3 * ne + i]
            if w.kind[i] == layout.RIGID:
                if w.m_other[i] == 1.0 and impulse > 0.0 and not _holds_friction(w, i):
                    w.m_other[i] = 0.0
                    settled = False
            elif w.m_other[i] == 1.0:
                if abs(impulse) > bound * (1.0 + 1e-9) and not w.forced[i]:
                    w.m_other[i] = 0.0
                    w.m[i] = -math.copysign(1.0, impulse)
                    settled = False
            elif w.attached[i] >= 0 and w.m_other[w.attached[i]] == 1.0 and w.m[i] * after < 0.0:
                w.m_other[i], w.m[i], w.forced[i] = 1.0, 0.0, True
                settled = False
        if settled:
            break
    energy, size = 0.0, 0.0
    for i in range(ne):
        energy += 0.5 * w.y[n + i] * (w.y[n + ne + i] + w.y[n + 2 * ne + i])
        size += abs(w.y[n + i] * w.y[n + ne + i])
    return energy if energy > 1e-12 * size else 0.0


def _holds_friction(w, contact):
    """Whether a friction that the contact presses still holds, without being bound to."""
    found = False
    for i in range(w.ints[layout.NE]):
        found = found or (w.attached[i] == contact and w.kind[i] == layout.FRICTION and w.m_other[i] == 1.0 and not w.forced[i])
    return found


def _end_low_flights(w, t):
    """Close contacts whose next flight would be too low to be resolved."""
    n, ne = w.ints[layout.N], w.ints[layout.NE]
    nudge(w)
    call(w.ints[layout.FIELD], t * (1.0 + 1e-7), 0.0, w.x_other, w.k, w.p_other, w.m, w.z)
    for i in range(ne):
        w.m_other[i] = w.z[2 * n + 2 * i]
    call(w.ints[layout.FIELD], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    for i in range(ne):  # round-off of the gap, whose terms may be far larger than itself
        w.m_other[i] = 64.0 * layout.EPS * 1e7 * abs(w.m_other[i] - w.z[2 * n + 2 * i])
    call(w.ints[layout.PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    for i in range(ne):
        if w.bounced[i]:
            after, fall = w.z[i], w.z[ne + i]
            # a flight must also rise well above the depth at which the impact was located, or its end could not be told from its beginning
            if fall > 0.0 and 0.5 * after * after <= fall * max(1e-13 * guard_size(w, 2 * i), -10.0 * w.g[2 * i], w.m_other[i]):
                w.bounced[i], w.zero[i], w.m[i] = False, True, 0.0


def impact(w, t):
    """The impact of the rigid contacts whose gap has just closed; they bounce, or close where the next flight would be too low to be resolved."""
    n, ne = w.ints[layout.N], w.ints[layout.NE]
    for elastic in range(1, -1, -1):
        w.m_other[ne] = float(elastic)
        for i in range(ne):
            w.forced[i] = False
            w.m_other[i] = 1.0 if w.kind[i] == layout.RIGID and (w.before[i] == 0.0 or w.fired[2 * i]) else 0.0
            if w.kind[i] != layout.SWITCH:
                w.m[i] = w.before[i]
        for i in range(ne):
            if w.attached[i] >= 0 and w.m_other[w.attached[i]] == 1.0:
                w.m_other[i] = 1.0
        if balanced(w, t) == 0.0:
            break
    for i in range(n):
        w.x[i] = w.y[i]
    for i in range(ne):
        after = w.y[n + 2 * ne + i]
        if w.kind[i] == layout.RIGID:
            if w.before[i] == 0.0:
                w.m[i] = 1.0 - w.m_other[i]
                w.zero[i] = w.m_other[i] == 1.0
            elif w.fired[2 * i]:
                w.zero[i] = not after < 0.0
                w.bounced[i] = not w.zero[i]
                w.m[i] = 0.0 if w.zero[i] else 1.0
        elif w.kind[i] == layout.FRICTION:
            w.zero[i] = w.m_other[i] == 1.0 or abs(after) <= 1e-9 * w.guard_scale[2 * i]
            w.m[i] = 0.0 if w.zero[i] else math.copysign(1.0, after)
    _end_low_flights(w, t)
    project(w, t)
