"""The event loop: adaptive steps, guards, modes, samples and outputs, compiled once per machine.

The loop knows no model. It calls the machine code of `toolbox.compilation.kernel` through raw addresses, keeps one armed flag per guard, ends steps exactly
on events, and decides modes by forces alone. What it does at an instant stands in the files beside this one, each by its noun: `calendar`, `guards`,
`crossings`, `starts`, `modes`, `impacts`, `step_control`, `noise`.

How an event is found: an armed guard that changes sign over a step, or whose minimum inside it proves to be negative, is located by stepping again from
the start of the step to the root of a cubic Hermite interpolant, with shrinking brackets. No dense output is involved, so
the accuracy at an event, like at an output time, is that of a step.

A sticking contact hides a force that varies in time from the states, and a long step could jump over its peak. Where that can be, the force is
integrated along as one more state, so that the error control sees it; `Work.excited` names the element of each such state.
"""

from __future__ import annotations

from typing import Any

from toolbox.compilation import work_layout as layout
from toolbox.stepping.between import load_node, open_step, step_between
from toolbox.stepping.calendar import GO_ON, full, inputs_changed, jumps, next_stop, outputs_before, outputs_due, record, samples
from toolbox.stepping.crossings import dip_inside, hermite_minimum, locate, rising_fraction, watch
from toolbox.stepping.events import after_event, project_event
from toolbox.stepping.guards import accept, finite, held_quietly, no_modes, project, stays
from toolbox.stepping.impacts import many_at_once
from toolbox.stepping.quiet_samples import REFRESHED, cut_short, from_sample_to_sample, samples_rule
from toolbox.stepping.series_steps import checked_end, open_series, watch_series
from toolbox.stepping.starts import begin
from toolbox.stepping.step_control import (
    LEAP,
    LEAP_OF_SETTLED,
    SETTLED,
    exp2,
    first_step,
    log2,
    measure_round_off,
    outgrown,
    scaled_error,
    spread_round_off,
    stalls,
)
from toolbox.translation.compiled import Compiled
from toolbox.translation.words import call


def _due(w, t, every_node, undecided):
    """Everything due at this instant: events came first, then samples, then updates, then hold, then records. A status of `advance`, or GO_ON.

    undecided: whether samples have been taken already, after which modes are still to be decided.
    """
    recorded = False
    for sampling in (False, True):  # a loop, so that the code for what follows a change is there once
        if sampling:
            status, changed = samples(w, t)
            if status != layout.DONE:
                return status
            changed = changed or undecided
        else:
            changed = jumps(w, t)
        if not changed:
            continue
        if not (sampling and held_quietly(w)) and not inputs_changed(w, t, not sampling):
            return no_modes(w, t)
        for i in range(w.ints[layout.NE]):
            if w.m[i] != w.before[i]:
                w.reals[layout.FOLLOWED] = 0.0
        if not sampling:
            first_step(w)
        if every_node:
            if sampling and w.ints[layout.RECORDS] > 0 and w.rec_t[w.ints[layout.RECORDS] - 1] == t:
                w.ints[layout.RECORDS] -= 1
            record(w, t, w.x)
            recorded = True
    if w.ints[layout.STARTED] == 0:
        w.ints[layout.STARTED] = 1
        first_step(w)
        if every_node and not recorded:
            record(w, t, w.x)
    return outputs_due(w, t, every_node)


def _first_dip(w, t, h):
    """The fraction of the step h at which the first guard dips below zero, 1 where none does; the step to there is left in `y`, its guards in `g_high`."""
    ng, end, top = w.ints[layout.NG], 2 * w.ints[layout.N], 1.0
    for j in range(ng):
        a, b = w.side[j] * w.g[j], w.side[j] * w.g_high[j]
        if not (w.armed[j] and b > 0.0 and w.side[j] * w.g[ng + j] < 0.0 and w.side[j] * w.g_high[ng + j] > 0.0):
            continue
        slope = w.side[j] * w.g_high[ng + j] * h
        if hermite_minimum(a, w.side[j] * w.g[ng + j] * h, b, slope)[1] <= 0.5 * max(a, b):
            top = min(top, dip_inside(w, h, j))
    call(w.ints[layout.STEP], t, top * h, w.x, w.k, w.p, w.m, w.y)
    if top < 1.0:
        for j in range(2 * ng):
            w.g_high[j] = w.y[end + j]
    return top


def _step_to(w, t, h, part):
    """Step by a part of h, unless the whole step is there already, and leave its guards in `g_high`; returns the part."""
    if part < 1.0:
        call(w.ints[layout.STEP], t, part * h, w.x, w.k, w.p, w.m, w.y)
    for j in range(2 * w.ints[layout.NG]):
        w.g_high[j] = w.y[2 * w.ints[layout.N] + j]
    return part


def _from_zero(w, h):
    """Guards that start at zero and are negative at the end of the step h: where each was positive in between.

    Returns (whether a kink took the side that it goes to, whether an element has to decide again here, the fraction of the step before which nothing
    happens, the step, shortened to where a guard has fallen again or another one comes first). The guards at that fraction are left in `g_low`.
    """
    t = w.reals[layout.TIME]
    ng, ne, end = w.ints[layout.NG], w.ints[layout.NE], 2 * w.ints[layout.N]
    low = 0.0
    for j in range(2 * ng):
        w.g_low[j] = w.g[j]
    for j in range(ng):
        if w.armed[j] or stays(w, j, w.g[j], w.g[ng + j], w.g_high[j], w.g_high[ng + j]):
            continue
        rise, fall = rising_fraction(w, h, j)
        if (
            rise == 0.0 and 2 * ne <= j < ng - w.ints[layout.BOUNDS]
        ):  # a kink that starts at zero is on the side it goes to, which changes nothing else
            w.side[j] = -w.side[j]
            return True, False, low, h
        if rise == 0.0:  # it goes the wrong way from its start: decide again here
            w.ints[layout.LOCATED] = j
            return False, True, low, h
        crossed = False
        for i in range(ng):
            crossed = crossed or (w.armed[i] and w.side[i] * w.y[end + i] <= 0.0)
        if crossed:  # another guard comes first
            h = rise * h
            low = 0.0
            for i in range(2 * ng):
                w.g_low[i], w.g_high[i] = w.g[i], w.y[end + i]
            continue
        if low == 0.0 or rise < low:
            low = rise
            for i in range(2 * ng):
                w.g_low[i] = w.y[end + i]
        # however long the step, the end of a low flight is looked for close to its rise; a slip that begins with the round-off of a projection is none
        if fall < 1.0 and j < 2 * ne and w.kind[j // 2] == layout.RIGID:
            low = low / fall
            h = _step_to(w, t, h, fall) * h
    return False, False, low, h


def _next_size(w, h, h_wanted, error, rejected):
    """Choose the next step size after an accepted step h, of which h_wanted was wanted, by Gustafsson's prediction from the last two steps.

    A step cut short leaves the size as it was. Sizes leap only while they grow from an event on.
    """
    if cut_short(h, h_wanted):
        w.reals[layout.STEP_OLD] = 0.0
        return
    power = w.reals[layout.POWER]
    size = log2(max(error, 1e-10))
    growth = -power * size
    if w.reals[layout.STEP_OLD] > 0.0:
        growth += min(0.0, log2(h / w.reals[layout.STEP_OLD]) + power * (w.reals[layout.ERROR_OLD] - size))
    most = LEAP_OF_SETTLED if h < SETTLED * w.reals[layout.STEP_OLD] else LEAP
    factor = min(1.0 if rejected else most, max(0.2, 0.85 * exp2(growth)))
    w.reals[layout.ERROR_OLD], w.reals[layout.STEP_OLD] = max(size, -13.3), h
    grown = h * factor
    w.reals[layout.STEP_SIZE] = max(grown, h_wanted) if h < h_wanted else grown


def _crossed(w, t, h, t_new, error, node, series):
    """Look at the guards over the step h to t_new, which is in `y`, and end it where the first of them crosses zero.

    Returns (whether a kink has changed side, so that the step is to be made anew, whether it ends on an event, its size, end and error).
    """
    event, located, top = False, False, 1.0
    if series is not None:
        hit, at_once, doubtful, first, top = watch_series(w, h, node)
        located = hit and not doubtful
        if located:
            size = 0.0 if at_once else first * h
            if size > 0.0:
                call(w.ints[layout.STEP], t, size, w.x, w.k, w.p, w.m, w.y)
            t_new = t + size if size < h else t_new
            h, event = size, True
        elif hit:
            top = _step_to(w, t, h, top)
    else:
        hit, suspicious, located = watch(w, h, error, node)
        if located:
            return False, True, 0.0, w.reals[layout.TIME], 0.0
        if suspicious:
            top = _first_dip(w, t, h)
            hit = hit or top < 1.0
    if hit and not located:
        if top < 1.0:
            h = top * h
            t_new = t + h
        turned, again, low, shorter = _from_zero(w, h)
        if turned:
            return True, False, h, t_new, error
        if shorter < h:
            h = shorter
            t_new = t + h
        size = 0.0 if again else locate(w, h, low)
        if size >= 0.0:
            event = True
            if series is None:
                error = scaled_error(w, size) if size > 0.0 else 0.0
            t_new = t + size if size < h else t_new
            h = size
        elif error <= 1.0:
            call(w.ints[layout.STEP], t, h, w.x, w.k, w.p, w.m, w.y)
    return False, event, h, t_new, error


def _step_size(w, t, stop):
    """Length that the next step may have, its length up to the next stop, and the time at its end."""
    h_wanted = min(w.reals[layout.STEP_SIZE], w.reals[layout.LONGEST])
    if w.reals[layout.FOLLOWED] > layout.UNTOLD:
        h_wanted = min(h_wanted, w.reals[layout.FOLLOWED])
    h, t_new = h_wanted, t + h_wanted
    if t_new >= stop or stop - t_new < 1e-3 * h:
        return h_wanted, stop - t, stop
    return h_wanted, h, t_new


def _reject(w, h, error, again, series):
    """Make the next step shorter after one whose error was too large. If the step before was rejected as well, measure the round-off."""
    w.ints[layout.REJECTED] += 1
    shrink = 0.9 * error ** (-w.reals[layout.POWER]) if error < 1e30 else 0.1
    w.reals[layout.STEP_SIZE] = h * max(shrink, 0.1)
    if series is None:  # noqa: SIM102
        if again:
            measure_round_off(w)
            spread_round_off(w, w.reals[layout.STEP_OLD])


def _accept_step(w, h, t_new, event, refresh):
    """Take the state at the end of a step, and project it onto the modes."""
    if event or refresh:  # with the modes, and with the speed in a friction law, the growth of a mode changes
        w.reals[layout.FOLLOWED] = 0.0
    if h > 0.0:
        accept(w)
    w.reals[layout.TIME] = t_new
    if event:
        project_event(w, t_new, h == 0.0)
    else:
        project(w, t_new)


def _stalls(w, t_new, h):
    """Whether the run makes no progress; if it does, the round-off is measured again."""
    if stalls(w, t_new):
        return True
    measure_round_off(w)
    spread_round_off(w, h)
    return False


def advance(w, series):  # noqa: C901 (a compiled loop)
    """Run until the end time, a full buffer, a sample of a Python controller, the step budget, or a failure; can be called again.

    series: True where the steps are Taylor series, else None: another type, so that the loop of other steps is compiled without them. A condition
    on it stands alone, because the translator leaves out only what such a condition alone decides.
    """
    ne = w.ints[layout.NE]
    every_node = w.ints[layout.NODES] == 1
    budget = w.ints[layout.ACCEPTED] + w.ints[layout.REJECTED] + w.ints[layout.BUDGET]
    rejected, undecided, turns = False, False, 0
    if w.ints[layout.STARTED] == 0 and not begin(w):
        return no_modes(w, w.reals[layout.TIME])
    while True:
        t = w.reals[layout.TIME]
        status = full(w, 2 * ne + 1)
        if status != GO_ON:
            return status
        status = _due(w, t, every_node, undecided)
        if status == layout.DONE and not finite(w):
            return layout.STATE_NOT_FINITE
        if status != GO_ON:
            return status
        if w.ints[layout.ACCEPTED] + w.ints[layout.REJECTED] >= budget:
            return layout.PAUSED
        undecided = False
        if series is None:  # noqa: SIM102
            if samples_rule(w):
                undecided = from_sample_to_sample(w, every_node, budget)
                if w.reals[layout.TIME] > t:
                    continue

        # --- one step
        if series is not None:  # noqa: SIM102
            if w.ints[layout.OPENED] == 0 and not open_series(w, t):
                return layout.NO_SERIES
        stop = next_stop(w)
        h_wanted, h, t_new = _step_size(w, t, stop)
        if h < 1e-14 * abs(t) or h < 1e-300:
            if stop - t <= 1e-13 * abs(t):  # the next stop is closer than can be resolved
                w.reals[layout.TIME] = stop
                continue
            return layout.UNDERFLOW
        call(w.ints[layout.STEP], t, h, w.x, w.k, w.p, w.m, w.y)
        error = 0.0
        if series is None:
            if w.reals[layout.FOLLOWED] == 0.0 and outgrown(w, h):
                return layout.GROWTH
            error = scaled_error(w, h)

        # --- its guards
        node = t_new == stop and w.ints[layout.JUMP] < w.jump_t.size and w.jump_t[w.ints[layout.JUMP]] == stop
        turned, event, h, t_new, error = _crossed(w, t, h, t_new, error, node, series)
        if turned:
            turns += 1
            if turns > 2 * many_at_once(w):
                w.ints[layout.CULPRIT] = ne
                return layout.ENDLESS
            continue
        if series is not None:  # noqa: SIM102
            if h > 0.0:
                error, h, t_new = checked_end(w, t, h, t_new, event, rejected)
        if not error <= 1.0:
            _reject(w, h, error, rejected, series)
            rejected = True
            continue
        if not outputs_before(w, t_new):
            return layout.RECORDS_FULL

        # --- accepted
        w.ints[layout.ACCEPTED] += 1
        if series is None:  # noqa: SIM102
            if not event:
                _next_size(w, h, h_wanted, error, rejected)
        rejected, turns = False, 0
        refresh = w.ints[layout.ACCEPTED] % REFRESHED == 0
        _accept_step(w, h, t_new, event, refresh)
        if refresh and _stalls(w, t_new, h):
            return layout.STALLED
        if every_node and h > 0.0:
            record(w, t_new, w.x)
        if event:
            status = after_event(w, t_new, h == 0.0)
            if status != layout.DONE:
                return status
            if every_node:
                record(w, t_new, w.x)


advance_plain = Compiled(advance, layout.KINDS, None)
"""The loop of steps that are no Taylor series, as machine code."""

advance_series = Compiled(advance, layout.KINDS, True)
"""The loop of Taylor series."""


def loop_of(work: Any) -> Compiled:
    """The loop of the steps that the work arrays ask for."""
    return advance_series if work.ints[layout.SERIES] else advance_plain


def run_on(work: Any) -> Any:
    """Run as `advance` does, by the loop of the steps that the work arrays ask for."""
    return loop_of(work)(work)


def _evaluate(w):
    """States at `times`, each from its node `row`, by one step from there, or from the last step that has ended before it."""
    last, following, here = -1, 0, 0.0
    for q in range(w.times.size):
        r = w.row[q]
        end = w.first[r + 1] if r + 1 < w.time.size else w.passed.size
        if r != last or w.times[q] < here:
            load_node(w, r)
            last, following, here = r, w.first[r], w.time[r]
            after = w.passed[following] if following < end else w.time[r + 1] if r + 1 < w.time.size else w.times[q]
            open_step(w, here, after - here)
        while following < end and w.passed[following] <= w.times[q]:
            step_between(w, here, w.passed[following] - here)
            for i in range(w.state.shape[1]):
                w.x[i] = w.y[i]
            here = w.passed[following]
            following += 1
            after = w.passed[following] if following < end else w.time[r + 1] if r + 1 < w.time.size else w.times[q]
            open_step(w, here, after - here)
        if w.times[q] == here:
            for i in range(w.states.shape[1]):
                w.states[q, i] = w.x[i]
            continue
        step_between(w, here, w.times[q] - here)
        for i in range(w.states.shape[1]):
            w.states[q, i] = w.y[i]


evaluate = Compiled(_evaluate, layout.BETWEEN_KINDS)
"""States between the nodes of a run (`toolbox.compilation.work_layout.Between`), as machine code."""
