"""What happens at a located event: which guards fire, what switches, and whether switching has an end."""

from __future__ import annotations

from toolbox.compilation.calls import call
from toolbox.compilation.numba_cache import inlined
from toolbox.compilation.work_layout import (
    BOUNDS,
    CLOSE,
    CULPRIT,
    DONE,
    END,
    ENDLESS,
    FRICTION,
    IMPLICIT,
    INCONSISTENT,
    LAST_EVENT,
    NE,
    NEGATIVE_BOUND,
    NG,
    SERIES,
    STEP,
    STEP_OLD,
    STEP_SIZE,
    TIME,
    N,
)  # fmt: skip
from toolbox.stepping.guards import flies, guard_size, project, two_directions
from toolbox.stepping.modes import fire, mark
from toolbox.stepping.step_control import first_step, measure_round_off


@inlined
def project_event(w, t, again):
    """Mark the guards that fire and set the slips that have just become zero to zero, so that they are so in the record, too.

    Slip in two directions stays until the record is written: at zero its force would have no direction.
    """
    mark(w, again)
    for i in range(w.ints[NE]):
        if w.kind[i] == FRICTION and w.m[i] != 0.0 and w.fired[2 * i] and not flies(w, i) and not two_directions(w, i):
            w.m[i] = 0.0
    project(w, t)
    for i in range(w.ints[NE]):
        w.m[i] = w.before[i]


@inlined
def after_event(w, t):
    """Switch what fires at an event. DONE, or the status of `advance` where switching has no end, no modes are consistent, or a bound becomes negative."""
    if t - w.reals[LAST_EVENT] <= 1e-13 * max(abs(t), min(w.reals[END], 1.0)):
        w.ints[CLOSE] += 1
        if w.ints[CLOSE] > 50 + 20 * w.ints[NE]:
            return ENDLESS
    else:
        w.ints[CLOSE] = 0
    w.reals[LAST_EVENT] = t
    if _bound_falls(w):
        return NEGATIVE_BOUND
    if not fire(w, t):
        return INCONSISTENT
    if w.ints[SERIES] != 0:  # the next step follows from its own coefficients
        return DONE
    if w.ints[IMPLICIT] == 1:  # slopes, which the fast modes rule, say less about the next step than the last one does
        w.reals[STEP_OLD] = 0.0
        measure_round_off(w)
    else:
        first_step(w)
    return DONE


@inlined
def _bound_falls(w):
    """Whether a bound that fires becomes negative: one that only touches zero, or that a kink keeps at zero, does not."""
    ng = w.ints[NG]
    for q in range(w.ints[BOUNDS]):
        j = ng - w.ints[BOUNDS] + q
        h = max(w.reals[STEP_OLD], w.reals[STEP_SIZE])
        if w.fired[j] and w.g[ng + j] * h < -1e-6 * guard_size(w, j):
            if w.ints[SERIES] != 0:
                call(w.ints[SERIES], w.reals[TIME], h, w.x, w.k, w.p, w.m, w.k)
            call(w.ints[STEP], w.reals[TIME], 1e-3 * h, w.x, w.k, w.p, w.m, w.y)
            if w.y[2 * w.ints[N] + j] < 0.5e-3 * h * w.g[ng + j]:
                w.ints[CULPRIT] = q
                return True
    return False
