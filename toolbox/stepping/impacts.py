"""Impacts of rigid contacts: impulses of restitution and Coulomb friction that never add energy."""

from __future__ import annotations

import math

from toolbox.compilation import work_layout as layout
from toolbox.stepping.guards import guard_size, nudge, project, two_directions
from toolbox.translation.words import call

MOST_TRIED = 8192
"""Ways of an impact that are tried one by one: all of four contacts with friction are 1296, of thirteen without 8192."""

STILL = 1e-11
"""Part of the speed of an impact below which a friction that stuck before it still does: contacts that hold each other yield by so little."""

ROUND_OFF = 1e-9
"""Part of the largest impulse or speed of an impact below which one of the wrong sign is none."""


def balanced(w, t):
    """Compute the impulses of an impact in `y`: unilateral impulses push, friction is within its bound. Return the energy that they add,
    and a number above 0 if no impulses are consistent.

    What is tried first follows from holding everything. Where what it ends with does not agree, as where a contact that was let go would go on into the
    other body, the first element that does not agree is turned, again and again, which ends at the one answer where there is no friction (K. G. Murty, Opsearch
    11 (1974) 201-206); where that does not end either, all ways of a few contacts are tried.
    """
    _held_at_first(w, t)
    if _first_wrong(w) >= 0:
        _hold_all(w)
        wrong = 0
        for _ in range(8 * w.ints[layout.NE] + 64):
            call(w.ints[layout.IMPULSE], t, 0.0, w.x, w.m_other, w.p, w.m, w.y)
            wrong = _first_wrong(w)
            if wrong < 0:
                break
            _turn(w, wrong)
        if wrong >= 0 and not _any_way(w, t):
            _hold_all(w)
            _held_at_first(w, t)
            return max(_energy(w), 1e-300)
    return _energy(w)


def _energy(w):
    """The energy that the impulses in `y` add, 0 where it is round-off."""
    n, ne = w.ints[layout.N], w.ints[layout.NE]
    energy, size = 0.0, 0.0
    for i in range(ne):
        energy += 0.5 * w.y[n + i] * (w.y[n + ne + i] + w.y[n + 2 * ne + i])
        size += abs(w.y[n + i] * w.y[n + ne + i])
    return energy if energy > 1e-12 * size else 0.0


def _strikes(w, i):
    """Whether a rigid contact takes part in the impact: it is closed, or has just closed, or is a one-way clutch, which an impact can lock."""
    return w.kind[i] == layout.RIGID and (w.before[i] == 0.0 or w.fired[2 * i] or w.loader[i] == layout.ONE_WAY)


def _rubs(w, i):
    """Whether a friction takes part in the impact."""
    return w.kind[i] == layout.FRICTION and w.attached[i] >= 0 and _strikes(w, w.attached[i])


def _hold_all(w):
    """Begin with all contacts that take part held, and with the friction that they press."""
    for i in range(w.ints[layout.NE]):
        w.forced[i] = False
        w.m_other[i] = 1.0 if _strikes(w, i) or _rubs(w, i) else 0.0
        if w.kind[i] != layout.SWITCH:
            w.m[i] = w.before[i]


def _held_at_first(w, t):
    """Impulses that follow from holding everything; `z` gets the speeds after it of the contacts, as they are held, and behind them the largest impulse.

    Friction holds at first. Where its impulse exceeds the bound it slides against that impulse, which a strong normal impulse can make another way than before;
    where no way of sliding lasts it holds again. A unilateral contact is let go only after the friction that it presses, which by holding can pull at it.
    """
    n, ne = w.ints[layout.N], w.ints[layout.NE]
    for k in range(4 * ne + 8):
        call(w.ints[layout.IMPULSE], t, 0.0, w.x, w.m_other, w.p, w.m, w.y)
        settled = True
        if k == 0:
            w.z[ne] = 0.0
            for i in range(ne):
                w.z[i], w.z[ne] = w.y[n + 2 * ne + i], max(w.z[ne], abs(w.y[n + i]))
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


def _first_wrong(w):
    """The first element that does not agree with the impulses in `y`, or -1.

    A contact that is held pulls, or one that is let go ends faster inwards than if it were held; a friction that holds is above its bound, or one that slides
    goes the other way.
    """
    n, ne = w.ints[layout.N], w.ints[layout.NE]
    push, fast, slip = 0.0, 0.0, 0.0
    for i in range(ne):
        if _strikes(w, i):
            push, fast = max(push, abs(w.y[n + i])), max(fast, abs(w.y[n + ne + i]))
        elif _rubs(w, i):
            slip = max(slip, max(abs(w.y[n + ne + i]), abs(w.y[n + 2 * ne + i])))
    least = 64.0 * layout.EPS * max(fast, slip)  # what is less may be round-off: of a closed contact all of its speed is
    push, fast, slip = ROUND_OFF * push + 64.0 * layout.EPS * w.z[ne], ROUND_OFF * fast + least, ROUND_OFF * slip + least
    for i in range(ne):
        impulse, after, bound = w.y[n + i], w.y[n + 2 * ne + i], w.y[n + 3 * ne + i]
        wrong = False
        if _strikes(w, i):
            wrong = impulse > push if w.m_other[i] == 1.0 else after > w.z[i] + fast
        elif _rubs(w, i):
            wrong = abs(impulse) > bound + push if w.m_other[i] == 1.0 else w.m[i] * after < -slip and bound > push
        if wrong:
            return i
    return -1


def _turn(w, i):
    """Let an element go that is held, or hold it; friction slides against the impulse that held it."""
    held = w.m_other[i] == 1.0
    w.m_other[i] = 0.0 if held else 1.0
    if w.kind[i] == layout.FRICTION:
        w.m[i] = -math.copysign(1.0, w.y[w.ints[layout.N] + i]) if held else 0.0


def _any_way(w, t):
    """Try all ways of an impact, beginning with everything held; whether one agrees and adds no energy, whose impulses are then in `y`."""
    _hold_all(w)
    for _ in range(MOST_TRIED):
        call(w.ints[layout.IMPULSE], t, 0.0, w.x, w.m_other, w.p, w.m, w.y)
        if _first_wrong(w) < 0 and _energy(w) == 0.0:
            return True
        if not _go_on(w):
            break
    return False


def _go_on(w):
    """The next way: contacts are held or let go, friction holds or slides one way or the other; False behind the last."""
    for i in range(w.ints[layout.NE]):
        if _strikes(w, i):
            if w.m_other[i] == 1.0:
                w.m_other[i] = 0.0
                return True
            w.m_other[i] = 1.0
        elif _rubs(w, i):
            if w.m_other[i] == 1.0:
                w.m_other[i], w.m[i] = 0.0, 1.0
                return True
            if w.m[i] == 1.0:
                w.m[i] = -1.0
                return True
            w.m_other[i], w.m[i] = 1.0, 0.0
    return False


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
        if w.struck[i] and not w.zero[i]:
            after, fall = w.z[i], w.z[ne + i]
            # a flight must also rise well above the depth at which the impact was located, or its end could not be told from its beginning
            if fall > 0.0 and 0.5 * after * after <= fall * max(1e-13 * guard_size(w, 2 * i), -10.0 * w.g[2 * i], w.m_other[i]):
                w.zero[i], w.m[i] = True, 0.0


def _close_what_does_not_part(w, t):
    """Close the contacts that part at no more than 1e-12 of the speeds of their bodies: the impulses of many impacts have left that."""
    nudge(w)
    call(w.ints[layout.PROBE], t, 0.0, w.x_other, w.k, w.p_other, w.m, w.y)
    call(w.ints[layout.PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    for i in range(w.ints[layout.NE]):
        if _strikes(w, i) and w.m[i] == 1.0 and abs(w.z[i]) <= 1e-12 * 1e7 * abs(w.y[i] - w.z[i]):
            w.zero[i], w.m[i] = True, 0.0


def many_at_once(w):
    """As many events at one instant as no finite row of them has; so many more, and switching is without end."""
    return 50 + 20 * w.ints[layout.NE]


def piles_up(w):
    """Whether impacts follow one another without end."""
    return w.ints[layout.CLOSE] > many_at_once(w)


def impact(w, t):
    """Carry out the impact of the rigid contacts whose gap has just closed. The contacts bounce, or close if the next flight would be too
    low to be resolved.

    Impacts of several contacts can follow one another faster and faster, without end in a finite time, as those of a light body between a heavy one and the
    floor: an inelastic collapse (S. McNamara, W. R. Young, Phys. Fluids A 4 (1992) 496-504). Behind it these contacts are closed, with the momentum that they
    had, as after one impact without restitution, which takes the place of those that cannot be told apart.
    """
    n, ne = w.ints[layout.N], w.ints[layout.NE]
    for elastic in range(0 if piles_up(w) else 1, -1, -1):
        w.m_other[ne] = float(elastic)
        _hold_all(w)
        if balanced(w, t) == 0.0:
            break
    fast = 0.0
    for i in range(n):
        w.x[i] = w.y[i]
    for i in range(ne):
        fast = max(fast, abs(w.y[n + ne + i])) if _strikes(w, i) else fast
    for i in range(ne):
        after = w.y[n + 2 * ne + i]
        if w.kind[i] == layout.RIGID:
            if w.loader[i] == layout.ONE_WAY:  # forces decide what it does where its sides come to one speed
                w.zero[i] = w.m_other[i] == 1.0 or abs(after) <= 1e-9 * w.guard_scale[2 * i]
                w.m[i] = 0.0 if w.zero[i] else 1.0
            elif w.before[i] == 0.0:
                w.m[i] = 1.0 - w.m_other[i]
                w.zero[i] = w.m_other[i] == 1.0
            elif w.fired[2 * i]:
                w.zero[i] = not after < 0.0
                w.struck[i] = True
                w.m[i] = 0.0 if w.zero[i] else 1.0
        elif w.kind[i] == layout.FRICTION:
            if two_directions(w, i):
                after = math.sqrt(after * after + w.y[n + 2 * ne + i + 1] ** 2)
            still = max(1e-9 * w.guard_scale[2 * i], STILL * fast if w.before[i] == 0.0 else 0.0)
            w.zero[i] = w.m_other[i] == 1.0 or abs(after) <= still
            w.m[i] = 0.0 if w.zero[i] else math.copysign(1.0, after)
            if two_directions(w, i) and w.before[i] == 0.0:
                w.m[i + 1] = abs(w.m[i])
    if piles_up(w):
        _close_what_does_not_part(w, t)
    _end_low_flights(w, t)
    project(w, t)
