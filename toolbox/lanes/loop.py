"""The loop over blocks of lanes, compiled once per machine: it fills lanes with scenarios and looks after the instants that a pass leaves to it.

An event that a lane has stepped to is handled here by functions of the scalar loop; whatever else a pass does
not carry, such as a guard that starts at zero, an impact or a dip of a guard inside a step, is one step of the scalar loop from where the lane stands, after
which the lane goes on in its block. So the lanes know every kind of element, and switch as the scalar loop does.
"""

from __future__ import annotations

import numpy as np

from toolbox.compilation import work_layout
from toolbox.lanes import layout
from toolbox.lanes.transfers import copy, gather, gather_history, gather_point, gather_samples, next_stop, put, scatter, scatter_samples
from toolbox.measuring.stay_loop import note_end
from toolbox.stepping.events import after_event, project_event
from toolbox.stepping.step_control import measure_round_off, spread_round_off
from toolbox.translation.compiled import Compiled
from toolbox.translation.words import call, call_code, call_loop


def _observe(b, lanes, lane, views, w, t):
    """Measure the signals of a lane over a step that the scalar loop has taken: Simpson's integral and parabolas over 64 parts, from steps of their own."""
    h = w.reals[work_layout.TIME] - t
    counts = False
    for v in range(views):
        counts = counts or b.block[b.rows[layout.EDGES] + 2 * v, lane] <= t < b.block[b.rows[layout.EDGES] + 2 * v + 1, lane]
    if counts and w.ints[work_layout.SERIES] != 0:
        call(w.ints[work_layout.SERIES], t, h, lanes.x_old, lanes.k_old, lanes.p_old, lanes.m_old, lanes.k_old)
    for part in range(65 if counts else 0):
        weight = h / 192.0 * (1.0 if part % 64 == 0 else (4.0 if part % 2 == 1 else 2.0))
        call(w.ints[work_layout.STEP], t, h * part / 64.0, lanes.x_old, lanes.k_old, lanes.p_old, lanes.m_old, w.y)
        copy(w.x_other, w.y, lanes.x_old.size)
        call(b.code[layout.OBSERVE], t + h * part / 64.0, 0.0, w.x_other, lanes.k_old, lanes.p_old, lanes.m_old, lanes.signals[part % 3])
        for q in range(lanes.signals.shape[1]):
            value, middle, before = lanes.signals[part % 3, q], lanes.signals[(part + 2) % 3, q], lanes.signals[(part + 1) % 3, q]
            low, high = value, value
            if part > 1 and (middle - before) * (value - middle) < 0.0:  # the vertex of the parabola
                middle -= (value - before) ** 2 / (8.0 * (value - 2.0 * middle + before))
                low, high = min(value, middle), max(value, middle)
            for v in range(views):
                if b.block[b.rows[layout.EDGES] + 2 * v, lane] <= t < b.block[b.rows[layout.EDGES] + 2 * v + 1, lane]:
                    place = b.rows[layout.MEASURED] + 3 * (q * views + v)
                    b.block[place, lane] = min(b.block[place, lane], low)
                    b.block[place + 1, lane] = max(b.block[place + 1, lane], high)
                    b.block[place + 2, lane] += weight * value


def _fill(values, count, number):
    """Give the first entries of an array a number."""
    for i in range(count):
        values[i] = number


def begin(b, given, w, s, steps):
    """Start scenario s in the arrays of the scalar loop and take at most so many steps; returns its status."""
    copy(w.p, given.rest, given.rest.size)
    copy(w.p, given.parameters[s], given.parameters.shape[1])
    copy(w.p[w.ints[work_layout.FIRST_HELD] :], given.held[s], given.held.shape[1])
    copy(w.memory, given.memories[s], given.memories.shape[1])
    copy(w.keys, given.keys[s], given.memories.shape[1])
    for c in range(w.samplers.shape[0]):
        w.samplers[c, work_layout.TAKEN], w.samplers[c, work_layout.APPLIED] = 0, 0
        w.clocks[c, 0], w.clocks[c, 1] = given.clocks[s, 2 * c], given.clocks[s, 2 * c + 1]
    _fill(w.x, w.x.size, 0.0)
    copy(w.x, given.starts[s], given.starts.shape[1])
    _fill(w.scale, w.scale.size, 0.0)  # what the loop adds to, or may read first; all else it sets
    _fill(w.group_scale, w.group_scale.size, 0.0)
    _fill(w.guard_scale, w.guard_scale.size, 0.0)
    _fill(w.side, w.side.size, 1.0)
    _fill(w.forced, w.forced.size, False)
    _fill(w.struck, w.struck.size, False)
    w.ints[work_layout.ACCEPTED], w.ints[work_layout.REJECTED], w.ints[work_layout.STARTED] = 0, 0, 0
    w.ints[work_layout.JUMP], w.ints[work_layout.CLOSE], w.ints[work_layout.OUTPUT] = 0, 0, 0
    w.reals[work_layout.TIME], w.reals[work_layout.STEP_OLD], w.reals[work_layout.ERROR_OLD] = 0.0, 0.0, 0.0
    w.reals[work_layout.LAST_EVENT] = -np.inf
    return _alone(b, w, steps)


def _alone(b, w, steps):
    """Let the scalar loop do what is due and take at most so many steps; returns its status.

    A refused step of series is tried again at once: the next would begin with a table of its own, and be as long.
    """
    w.ints[work_layout.BUDGET], w.ints[work_layout.RECORDS], w.ints[work_layout.OPENED] = steps, 0, 0
    taken = w.ints[work_layout.ACCEPTED]
    while w.ints[work_layout.SERIES] != 0:
        status = call_loop(b.code[layout.SCALAR], w)
        if steps == 0 or status != work_layout.PAUSED or w.ints[work_layout.ACCEPTED] > taken:
            return status
    return call_loop(b.code[layout.SCALAR], w)


def _event(w, t):
    """What the scalar loop does with an event that has been stepped to; returns its status."""
    project_event(w, t, False)
    status = after_event(w, t, False)
    return work_layout.PAUSED if status == work_layout.DONE else status


def _note_switch(found, given, lanes, lane, s, i, before, after, t):
    """Write down that element i of a lane switches at t."""
    note_end(given, i, before, t, True, lanes.since[lane], found.spent[s], found.number[s], found.latest[s], found.switches[s])
    if found.counts[s, 2] < found.event_times.shape[1]:
        found.event_times[s, found.counts[s, 2]] = t
        found.event_elements[s, found.counts[s, 2]] = i
        found.event_modes[s, found.counts[s, 2]] = np.int8(after)
    found.counts[s, 2] += 1


def _settle(b, lanes, running):
    """Settle the events of all lanes that wait at one, where there are enough of them; returns whether there were."""
    few = max(b.block.shape[1] // 5, 2)
    events = 0
    for lane in range(b.block.shape[1]):
        if b.block[layout.FLAG_ROW, lane] == layout.EVENT and lanes.scenario[lane] >= 0:
            lanes.happened[lane] = True
            events += 1
    settled = events >= few or events == running
    if settled:
        call_code(b.code[layout.SETTLE], b.block)
    return settled


def _note_settled(b, found, given, lanes, lane, w):
    """Write down the event that has been settled in a lane; returns why the lane waits now."""
    s, ne = lanes.scenario[lane], w.ints[work_layout.NE]
    lanes.happened[lane] = False
    t = b.block[layout.TIME_ROW, lane]
    changed = False
    for i in range(ne):
        mode = b.block[b.rows[layout.M] + i, lane]
        if mode != lanes.modes[lane, i]:
            changed = True
            _note_switch(found, given, lanes, lane, s, i, lanes.modes[lane, i], mode, t)
            lanes.modes[lane, i] = mode
    found.counts[s, 3] += not changed and b.block[layout.LOCATED_ROW, lane] < 2 * ne
    lanes.close[lane] = (
        lanes.close[lane] + 1 if t - lanes.last_event[lane] <= 1e-13 * max(abs(t), min(w.reals[work_layout.END], 1.0)) else 0
    )
    lanes.last_event[lane] = t
    if lanes.close[lane] <= 50 + 20 * ne:
        return layout.GOES_ON
    gather_point(b, lane, w)
    return layout.ENDLESS_FLAG


def _round_off_again(b, lane, w):
    """Measure the round-off of a lane anew; returns whether it goes on."""
    measure_round_off(w)
    gather(b, layout.SCALE, lane, w.scale, w.ints[work_layout.N])
    spread_round_off(w, b.block[layout.WANTED_ROW, lane])
    put(b, layout.NOISE, lane, w.noise, w.ints[work_layout.N])
    b.block[layout.FLAG_ROW, lane] = layout.GOES_ON
    return w.ints[work_layout.ACCEPTED] + w.ints[work_layout.REJECTED] < layout.MOST_STEPS


def _step_alone(b, given, lanes, lane, w, flag):
    """One step of the scalar loop from where a lane stands, or what is due there; returns its status."""
    t = w.reals[work_layout.TIME]
    copy(lanes.x_old, w.x, w.ints[work_layout.N])
    copy(lanes.k_old, w.k, w.ints[work_layout.N])
    copy(lanes.m_old, w.m, w.ints[work_layout.NE])
    copy(lanes.p_old, w.p, w.p.size)  # which may jump at the end of the step
    longest = w.reals[work_layout.LONGEST]
    for e in range(given.edges.size):
        if flag == layout.ALONE and t < given.edges[e] * (1.0 - layout.SLACK):
            w.reals[work_layout.LONGEST] = min(w.reals[work_layout.LONGEST], given.edges[e] - t)
    status = _alone(b, w, 1 if flag == layout.ALONE else 0)
    w.reals[work_layout.LONGEST] = longest
    if lanes.signals.shape[1] > 0 and w.reals[work_layout.TIME] > t:
        _observe(b, lanes, lane, given.windows.shape[0], w, t)
    return status


def _look_after(b, given, found, lanes, lane, w, flag):
    """Do what a lane waits for; returns the status of its scenario, or GOING where the lane simply goes on in its block."""
    s, t = lanes.scenario[lane], b.block[layout.TIME_ROW, lane]
    gather_point(b, lane, w)
    if b.code[layout.SAMPLING] != 0:
        gather_samples(b, lane, w)
        for i in range(w.keys.size):
            w.keys[i] = given.keys[s, i]
    if flag == layout.ROUND_OFF:
        return layout.GOING if _round_off_again(b, lane, w) else work_layout.PAUSED
    if flag == layout.STOP and t >= w.reals[work_layout.END] and b.code[layout.SAMPLING] == 0:
        return work_layout.DONE
    gather_history(b, lane, w)
    w.reals[work_layout.LAST_EVENT], w.ints[work_layout.CLOSE], w.ints[work_layout.JUMP] = (
        lanes.last_event[lane],
        lanes.close[lane],
        lanes.jump[lane],
    )
    if flag == layout.EVENT:
        w.ints[work_layout.LOCATED] = np.int64(b.block[layout.LOCATED_ROW, lane])
        return _event(w, t)
    found.counts[s, 4] += flag == layout.ALONE
    status = _step_alone(b, given, lanes, lane, w, flag)
    put(b, layout.P, lane, w.p, w.p.size)
    return status


def _go_on(b, given, lanes, lane, w):
    """Put a scenario that goes on back into its lane."""
    scatter(b, lane, w, next_stop(given, w))
    if b.code[layout.SAMPLING] != 0:
        scatter_samples(b, lane, w)
    copy(lanes.modes[lane], w.m, w.ints[work_layout.NE])
    lanes.last_event[lane], lanes.close[lane], lanes.jump[lane] = (
        w.reals[work_layout.LAST_EVENT],
        w.ints[work_layout.CLOSE],
        w.ints[work_layout.JUMP],
    )


def _finish(b, given, found, lanes, lane, w, status):
    """Write down what a scenario has come to."""
    s = lanes.scenario[lane]
    signals, views = found.lowest.shape[1], found.lowest.shape[2]
    for i in range(w.ints[work_layout.NE]):
        note_end(
            given,
            i,
            w.m[i],
            w.reals[work_layout.TIME],
            False,
            lanes.since[lane],
            found.spent[s],
            found.number[s],
            found.latest[s],
            found.switches[s],
        )
        found.modes[s, i] = w.m[i]
    copy(found.states[s], w.x, found.states.shape[1])
    if signals > 0:
        call(b.code[layout.OBSERVE], w.reals[work_layout.TIME], 0.0, w.x, w.k, w.p, w.m, lanes.signals[0])
        found.doubtful[s] = b.block[b.rows[layout.DOUBT], lane] != 0.0
    for q in range(signals):
        found.ends[s, q] = lanes.signals[0, q]
        for v in range(views):
            place = b.rows[layout.MEASURED] + 3 * (q * views + v)
            low, high = b.block[place, lane], b.block[place + 1, lane]
            if given.windows[v, 1] >= w.reals[work_layout.TIME]:  # the far side of a jump there
                low, high = min(low, lanes.signals[0, q]), max(high, lanes.signals[0, q])
            found.lowest[s, q, v], found.highest[s, q, v], found.integral[s, q, v] = low, high, b.block[place + 2, lane]
    found.statuses[s] = status
    found.counts[s, 0], found.counts[s, 1] = w.ints[work_layout.ACCEPTED], w.ints[work_layout.REJECTED]


def _take(b, given, found, lanes, lane, w, s):
    """Begin scenario s in a lane; returns the status of the scalar loop."""
    signals, views = found.lowest.shape[1], found.lowest.shape[2]
    lanes.scenario[lane] = s
    w.ints[work_layout.EVENTS], w.ints[work_layout.MERGED] = 0, 0
    status = begin(b, given, w, s, 0)
    put(b, layout.P, lane, w.p, w.p.size)
    _fill(lanes.since[lane], w.ints[work_layout.NE], 0.0)
    b.block[b.rows[layout.DOUBT], lane] = 0.0
    b.block[b.rows[layout.COURSE], lane] = given.courses[s]
    for i in range(given.clocks.shape[1]):
        b.block[b.rows[layout.CLOCKS] + i, lane] = given.clocks[s, i]
    for v in range(views):
        for i in range(2):
            b.block[b.rows[layout.EDGES] + 2 * v + i, lane] = given.windows[v, i] * (1.0 - layout.SLACK)
        for q in range(signals):
            place = b.rows[layout.MEASURED] + 3 * (q * views + v)
            b.block[place, lane], b.block[place + 1, lane], b.block[place + 2, lane] = np.inf, -np.inf, 0.0
    return status


def _run(b, given, found, lanes, w):
    """Run the scenarios of a span in the lanes of one block.

    b, given, found, lanes: `BlockArrays`, `Scenarios`, `Results` and `LaneStates` of `toolbox.lanes.layout`;  w: the arrays of the
    scalar loop.
    """
    width = b.block.shape[1]
    following, last, running = b.span[0], b.span[1], 0
    while True:
        settled = b.code[layout.SETTLE] != 0 and b.waiting[0] != 0 and _settle(b, lanes, running)
        for lane in range(width if b.waiting[0] != 0 else 0):
            flag = np.int64(b.block[layout.FLAG_ROW, lane])
            s = lanes.scenario[lane]
            if s >= 0 and settled and flag == layout.GOES_ON and lanes.happened[lane]:
                flag = _note_settled(b, found, given, lanes, lane, w)
            if flag == layout.GOES_ON or (s < 0 and following >= last):
                continue
            if flag == layout.EVENT and b.code[layout.SETTLE] != 0 and s >= 0:
                if not settled:
                    continue  # until a few lanes wait together
                lanes.happened[lane] = False
            status = work_layout.DONE
            w.ints[work_layout.EVENTS], w.ints[work_layout.MERGED] = 0, 0
            if flag == layout.ENDLESS_FLAG:
                status = work_layout.ENDLESS
            elif s >= 0:
                status = _look_after(b, given, found, lanes, lane, w, flag)
            if status == layout.GOING:
                continue
            while True:  # ends with a lane that goes on, or with none left to begin
                if s >= 0:
                    for e in range(w.ints[work_layout.EVENTS]):
                        _note_switch(found, given, lanes, lane, s, w.ev_i[e], w.ev_m[e, 0], w.ev_m[e, 1], w.ev_t[e])
                    found.counts[s, 3] += w.ints[work_layout.MERGED]
                    if status == work_layout.PAUSED and w.ints[work_layout.ACCEPTED] + w.ints[work_layout.REJECTED] < layout.MOST_STEPS:
                        _go_on(b, given, lanes, lane, w)
                        break
                    _finish(b, given, found, lanes, lane, w, status)
                    running -= 1
                if following >= last:
                    lanes.scenario[lane] = -1
                    for row in range(b.block.shape[0]):
                        b.block[row, lane] = 0.0
                    b.block[layout.STOP_ROW, lane] = np.inf
                    break
                s = following
                following += 1
                running += 1
                status = _take(b, given, found, lanes, lane, w, s)
        if running == 0:
            return
        call_code(b.code[layout.PASS], b.block)
        while b.due[0] != 0:
            call_code(b.code[layout.SAMPLING], b.block, b.sizes, b.noise, b.queue)


run = Compiled(_run, layout.BLOCK_KINDS, layout.SCENARIO_KINDS, layout.RESULT_KINDS, layout.LANE_KINDS, work_layout.KINDS)
