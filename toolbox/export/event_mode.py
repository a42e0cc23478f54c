"""The event mode of an importer that integrates by itself: what is due at the point to which it has come, by the functions of the event loop.

These functions are translated into C beside the loop (`toolbox.export.machine_c`). An importer stops near a crossing, not on it, and looks at signs at the
ends of its steps only; what it needs beyond the loop stands here.
"""

from __future__ import annotations

from typing import Any

from toolbox.compilation import work_layout as layout
from toolbox.stepping.calendar import inputs_changed, jumps, sampled_at, samples
from toolbox.stepping.events import after_event, project_event
from toolbox.stepping.guards import accept, close_to_zero, guard_size, held_quietly, loads_hold, no_modes
from toolbox.translation.words import call

HAPPENED = -1
"""What `event_mode` returns where something has changed: the importer asks again."""

NEAR = 1e-6
"""Time before a crossing within which an importer that enters event mode means that crossing [s]."""

HEIGHT = 1e-6
"""Height of a flight below which a rigid contact closes, as a share of the widest gap so far."""

UNARMED = 1e-9
"""Depth below zero, as a share of its size, from which a guard that started at zero counts: it is added to its indicator."""


def come_to(w: Any) -> bool:
    """Accept the point to which the importer has integrated: compute its slopes and guards, the sizes of the guards, and which of them are
    armed.

    False where a bound of friction is negative that no guard watches: of inputs that the importer moves on the way nothing else tells.
    """
    call(w.ints[layout.FIELD], w.reals[layout.TIME], 0.0, w.x, w.k, w.p, w.m, w.y)
    for i in range(w.ints[layout.N]):
        w.y[i] = w.x[i]
    accept(w)
    return loads_hold(w, w.reals[layout.TIME], layout.BY_NUMBERS)


def first_to_fire(w: Any, near: float) -> int:
    """The guard that fires here, -1 for none: armed, and at zero or below, or there within the time `near`; the first that came there.

    One that rises from above zero does not fire, however near: a contact that has just opened would close and open again without end.
    """
    ng, found, earliest = w.ints[layout.NG], -1, near
    for j in range(ng):
        value, rate = w.side[j] * w.g[j], w.side[j] * w.g[ng + j]
        if not w.armed[j]:
            continue
        if value <= close_to_zero(w, j) and (value < 0.0 or rate <= 0.0):
            time = -value / rate if rate < 0.0 else -1e300 if value < 0.0 else 0.0
            time = min(time, 0.0)
        elif rate < 0.0 and value < -near * rate:
            time = -value / rate
        else:
            continue
        if found < 0 or time < earliest:
            found, earliest = j, time
    return found


def fell_from_zero(w: Any) -> int:
    """The guard that started at zero and fell, -1 for none."""
    for j in range(w.ints[layout.NG]):
        if not w.armed[j] and w.side[j] * w.g[j] < -UNARMED * guard_size(w, j):
            return j
    return -1


def event_mode(w: Any, entered: bool) -> int:
    """Everything due at this instant, in the order of the loop: events, then jumps of inputs, then samples. DONE, HAPPENED, or why not.

    entered: whether the importer comes from continuous time, where a crossing just ahead is what made it stop, unless something else is due.
    """
    t, ne, status = w.reals[layout.TIME], w.ints[layout.NE], layout.DONE
    due = w.ints[layout.JUMP] < w.jump_t.size and w.jump_t[w.ints[layout.JUMP]] <= t
    if not come_to(w) and not due:
        return layout.NEGATIVE_BOUND
    for c in range(w.samplers.shape[0]):
        due = due or sampled_at(w, c, w.samplers[c, layout.TAKEN]) <= t
    first = first_to_fire(w, NEAR if entered and not due else 0.0)
    again = first < 0
    if again:
        first = fell_from_zero(w)
    if first >= 0 and again and 2 * ne <= first < w.ints[layout.NG] - w.ints[layout.BOUNDS]:
        w.side[first] = -w.side[first]  # a kink on the side to which it goes
        status = HAPPENED
    elif first >= 0:
        w.ints[layout.LOCATED] = first
        for i in range(ne):
            if (
                w.kind[i] == layout.RIGID
            ):  # the depth at which an impact is located bounds the height of the flights that can be told from none
                w.g[2 * i] = min(w.g[2 * i], -0.1 * HEIGHT * guard_size(w, 2 * i))
        project_event(w, t, again)
        failed = after_event(w, t, again)
        if failed != layout.DONE:
            return failed
        status = HAPPENED
    if jumps(w, t):
        if not inputs_changed(w, t, True):
            return no_modes(w, t)
        status = HAPPENED
    failed, changed = samples(w, t)
    if failed != layout.DONE:
        return failed
    if changed:
        if not held_quietly(w) and not inputs_changed(w, t, False):
            return no_modes(w, t)
        status = HAPPENED
    return status
