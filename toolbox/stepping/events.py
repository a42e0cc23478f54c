"""What happens at a located event: which guards fire, what switches, and whether switching has an end."""

from __future__ import annotations

from toolbox.compilation import work_layout as layout
from toolbox.stepping.guards import flies, guard_size, no_modes, project, two_directions
from toolbox.stepping.impacts import many_at_once
from toolbox.stepping.modes import fire, mark
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
