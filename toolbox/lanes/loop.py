"""The loop over blocks of lanes, compiled once per machine: it fills lanes with scenarios and looks after the instants that a pass leaves to it.

An event that a lane has stepped to is handled here by functions of the scalar loop (`toolbox.lanes.scalar_parts`); whatever else a pass does
not carry, such as a guard that starts at zero, an impact or a dip of a guard inside a step, is one step of the scalar loop from where the lane stands, after
which the lane goes on in its block. So the lanes know every kind of element, and switch as the scalar loop does.
"""

from __future__ import annotations

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from toolbox.compilation import work_layout
from toolbox.compilation.calls import call, lent, owned
from toolbox.compilation.numba_cache import cached, inlined
from toolbox.lanes import layout
from toolbox.lanes.scalar_parts import call_part
from toolbox.lanes.transfers import gather_history, gather_point, gather_samples, next_stop, put_parameters, scatter, scatter_samples
from toolbox.measuring.stay_loop import note_end


@intrinsic
def call_block(typingctx, address, block):  # pragma: no cover - compiled
    """Call void f(double *) at a raw address with the data of an array."""

    def codegen(context, builder, sig, args):
        from llvmlite import ir

        pointer = ir.IntType(8).as_pointer()
        data = builder.bitcast(cgutils.create_struct_proxy(sig.args[1])(context, builder, value=args[1]).data, pointer)
        function = builder.inttoptr(args[0], ir.FunctionType(ir.VoidType(), [pointer]).as_pointer())
        builder.call(function, [data])
        return context.get_dummy_value()

    return types.void(types.int64, block), codegen


@intrinsic
def call_sample(typingctx, address, block, clocks, noise, queue):  # pragma: no cover - compiled
    """Call void f(double *, double *, double *, double *) at a raw address with the data of arrays."""

    def codegen(context, builder, sig, args):
        from llvmlite import ir

        pointer = ir.IntType(8).as_pointer()
        data = [
            builder.bitcast(cgutils.create_struct_proxy(sig.args[i])(context, builder, value=args[i]).data, pointer) for i in range(1, 5)
        ]
        function = builder.inttoptr(args[0], ir.FunctionType(ir.VoidType(), [pointer] * 4).as_pointer())
        builder.call(function, data)
        return context.get_dummy_value()

    return types.void(types.int64, block, clocks, noise, queue), codegen


@inlined
def _observe(b, lanes, lane, views, observe, w, t):
    """Measure the signals of a lane over a step that the scalar loop has taken: Simpson's integral and parabolas over 64 parts, from steps of their own."""
    block, rows, values = b.block, b.rows, lanes.signals
    h = w.reals[work_layout.TIME] - t
    counts = False
    for v in range(views):
        counts = counts or block[rows[layout.EDGES] + 2 * v, lane] <= t < block[rows[layout.EDGES] + 2 * v + 1, lane]
    if counts and w.ints[work_layout.SERIES] != 0:
        call(w.ints[work_layout.SERIES], t, h, lanes.x_old, lanes.k_old, lanes.p_old, lanes.m_old, lanes.k_old)
    for part in range(65 if counts else 0):
        weight = h / 192.0 * (1.0 if part % 64 == 0 else (4.0 if part % 2 == 1 else 2.0))
        call(w.ints[work_layout.STEP], t, h * part / 64.0, lanes.x_old, lanes.k_old, lanes.p_old, lanes.m_old, w.y)
        for i in range(lanes.x_old.size):
            w.x_other[i] = w.y[i]
        call(observe, t + h * part / 64.0, 0.0, w.x_other, lanes.k_old, lanes.p_old, lanes.m_old, values[part % 3])
        for q in range(values.shape[1]):
            value, middle, before = values[part % 3, q], values[(part + 2) % 3, q], values[(part + 1) % 3, q]
            low, high = value, value
            if part > 1 and (middle - before) * (value - middle) < 0.0:  # the vertex of the parabola
                middle -= (value - before) ** 2 / (8.0 * (value - 2.0 * middle + before))
                low, high = min(value, middle), max(value, middle)
            for v in range(views):
                if block[rows[layout.EDGES] + 2 * v, lane] <= t < block[rows[layout.EDGES] + 2 * v + 1, lane]:
                    place = rows[layout.MEASURED] + 3 * (q * views + v)
                    block[place, lane] = min(block[place, lane], low)
                    block[place + 1, lane] = max(block[place + 1, lane], high)
                    block[place + 2, lane] += weight * value


@inlined
def _copy(values, into, first):
    """Copy an array into another, from the place `first` on; a slice would be a reason to keep count of references."""
    for i in range(values.size):
        into[first + i] = values[i]


@inlined
def begin(scalar, w, rest, parameters, start, memory, held, steps):
    """Start a scenario in the arrays of the scalar loop and take at most so many steps; returns its status."""
    _copy(rest, w.p, 0)
    _copy(parameters, w.p, 0)
    _copy(held, w.p, w.ints[work_layout.FIRST_HELD])
    _copy(memory, w.memory, 0)
    w.samplers[:, work_layout.TAKEN], w.samplers[:, work_layout.APPLIED] = 0, 0
    w.x[:] = 0.0
    _copy(start, w.x, 0)
    for array in (w.k, w.m, w.scale, w.noise, w.group_scale, w.g, w.guard_scale, w.before):
        array[:] = 0.0
    w.side[:] = 1.0
    for array in (w.armed, w.fired, w.zero, w.forced, w.bounced):
        array[:] = False
    (
        w.ints[work_layout.ACCEPTED],
        w.ints[work_layout.REJECTED],
        w.ints[work_layout.STARTED],
        w.ints[work_layout.JUMP],
        w.ints[work_layout.CLOSE],
    ) = 0, 0, 0, 0, 0
    w.ints[work_layout.OUTPUT] = 0
    w.reals[work_layout.TIME], w.reals[work_layout.STEP_OLD], w.reals[work_layout.ERROR_OLD], w.reals[work_layout.LAST_EVENT] = (
        0.0,
        0.0,
        0.0,
        -np.inf,
    )
    return _alone(scalar, w, steps)


@inlined
def _alone(scalar, w, steps):
    """Let the scalar loop do what is due and take at most so many steps; returns its status.

    A refused step of series is tried again at once: the next would begin with a table of its own, and be as long.
    """
    w.ints[work_layout.BUDGET], w.ints[work_layout.RECORDS], w.ints[work_layout.OPENED] = steps, 0, 0
    taken = w.ints[work_layout.ACCEPTED]
    while w.ints[work_layout.SERIES] != 0:
        status = call_part(scalar, owned(w), None)
        if steps == 0 or status != work_layout.PAUSED or w.ints[work_layout.ACCEPTED] > taken:
            return status
    return call_part(scalar, owned(w), None)


@inlined
def _note_switch(found, asked, lanes, lane, s, i, before, after, t):
    """Write down that element i of a lane switches at t."""
    note_end(i, before, t, True, lanes.since[lane], asked, found.spent[s], found.number[s], found.latest[s], found.switches[s])
    if found.counts[s, 2] < found.event_times.shape[1]:
        found.event_times[s, found.counts[s, 2]] = t
        found.event_elements[s, found.counts[s, 2]] = i
        found.event_modes[s, found.counts[s, 2]] = np.int8(after)
    found.counts[s, 2] += 1


@inlined
def _start_block(b, w):
    """A block without scenarios."""
    b.block[:] = 0.0
    b.block[layout.STOP_ROW, :] = np.inf
    b.block[layout.LONGEST_ROW, :] = w.reals[work_layout.LONGEST]
    b.block[layout.END_ROW, :] = w.reals[work_layout.END]
    b.block[layout.RTOL_ROW, :] = w.reals[work_layout.RTOL]
    b.block[layout.FLAG_ROW, :] = layout.STOP
    b.waiting[0] = 1


@inlined
def _settle(code, b, lanes, running):
    """Settle the events of all lanes that wait at one, where there are enough of them; returns whether there were."""
    few = max(b.block.shape[1] // 5, 2)
    events = 0
    for lane in range(b.block.shape[1]):
        if b.block[layout.FLAG_ROW, lane] == layout.EVENT and lanes.scenario[lane] >= 0:
            lanes.happened[lane] = True
            events += 1
    settled = events >= few or events == running
    if settled:
        call_block(code.settle, b.block)
    return settled


@inlined
def _note_settled(b, found, asked, lanes, lane, w):
    """Write down the event that has been settled in a lane; returns why the lane waits now."""
    block, s, ne = b.block, lanes.scenario[lane], w.ints[work_layout.NE]
    lanes.happened[lane] = False
    t = block[layout.TIME_ROW, lane]
    changed = False
    for i in range(ne):
        mode = block[b.rows[layout.M] + i, lane]
        if mode != lanes.modes[lane, i]:
            changed = True
            _note_switch(found, asked, lanes, lane, s, i, lanes.modes[lane, i], mode, t)
            lanes.modes[lane, i] = mode
    found.counts[s, 3] += not changed and block[layout.LOCATED_ROW, lane] < 2 * ne
    lanes.close[lane] = (
        lanes.close[lane] + 1 if t - lanes.last_event[lane] <= 1e-13 * max(abs(t), min(w.reals[work_layout.END], 1.0)) else 0
    )
    lanes.last_event[lane] = t
    if lanes.close[lane] <= 50 + 20 * ne:
        return layout.GOES_ON
    gather_point(block, b.rows, lane, w, lanes.p)
    return layout.ENDLESS_FLAG


@inlined
def _round_off_again(code, b, lane, w):
    """Measure the round-off of a lane anew; returns whether it goes on."""
    block, rows, n = b.block, b.rows, w.ints[work_layout.N]
    call_part(code.measured, owned(w), None)
    for i in range(n):
        w.scale[i] = block[rows[layout.SCALE] + i, lane]
    call_part(code.spread, owned(w), block[layout.WANTED_ROW, lane])
    for i in range(n):
        block[rows[layout.NOISE] + i, lane] = w.noise[i]
    block[layout.FLAG_ROW, lane] = layout.GOES_ON
    return w.ints[work_layout.ACCEPTED] + w.ints[work_layout.REJECTED] < layout.MOST_STEPS


@inlined
def _step_alone(code, b, lanes, lane, w, flag, edges, views):
    """One step of the scalar loop from where a lane stands, or what is due there; returns its status."""
    t = w.reals[work_layout.TIME]
    for i in range(w.ints[work_layout.N]):
        lanes.x_old[i], lanes.k_old[i] = w.x[i], w.k[i]
    for i in range(w.ints[work_layout.NE]):
        lanes.m_old[i] = w.m[i]
    for i in range(w.p.size):
        lanes.p_old[i] = w.p[i]  # which may jump at the end of the step
    longest = w.reals[work_layout.LONGEST]
    for edge in edges:
        if flag == layout.ALONE and t < edge * (1.0 - layout.SLACK):
            w.reals[work_layout.LONGEST] = min(w.reals[work_layout.LONGEST], edge - t)
    status = _alone(code.scalar, w, 1 if flag == layout.ALONE else 0)
    w.reals[work_layout.LONGEST] = longest
    if lanes.signals.shape[1] > 0 and w.reals[work_layout.TIME] > t:
        _observe(b, lanes, lane, views, code.observe, w, t)
    return status


@inlined
def _look_after(code, b, given, found, lanes, lane, w, flag):
    """Do what a lane waits for; returns the status of its scenario, or GOING where the lane simply goes on in its block."""
    s, t = lanes.scenario[lane], b.block[layout.TIME_ROW, lane]
    gather_point(b.block, b.rows, lane, w, lanes.p)
    if code.sample != 0:
        gather_samples(b.block, b.rows, lane, w, b.queue)
    if flag == layout.ROUND_OFF:
        return layout.GOING if _round_off_again(code, b, lane, w) else work_layout.PAUSED
    if flag == layout.STOP and t >= w.reals[work_layout.END] and code.sample == 0:
        return work_layout.DONE
    gather_history(b.block, b.rows, lane, w)
    w.reals[work_layout.LAST_EVENT], w.ints[work_layout.CLOSE], w.ints[work_layout.JUMP] = (
        lanes.last_event[lane],
        lanes.close[lane],
        lanes.jump[lane],
    )
    if flag == layout.EVENT:
        w.ints[work_layout.LOCATED] = np.int64(b.block[layout.LOCATED_ROW, lane])
        return call_part(code.event, owned(w), t)
    found.counts[s, 4] += flag == layout.ALONE
    status = _step_alone(code, b, lanes, lane, w, flag, given.edges, given.windows.shape[0])
    put_parameters(b.block, b.rows, lane, w, lanes.p)
    return status


@inlined
def _go_on(code, b, edges, lanes, lane, w):
    """Put a scenario that goes on back into its lane."""
    scatter(b.block, b.rows, lane, w, next_stop(w, edges))
    if code.sample != 0:
        scatter_samples(b.block, b.rows, lane, w, b.queue)
    for i in range(w.ints[work_layout.NE]):
        lanes.modes[lane, i] = w.m[i]
    lanes.last_event[lane], lanes.close[lane], lanes.jump[lane] = (
        w.reals[work_layout.LAST_EVENT],
        w.ints[work_layout.CLOSE],
        w.ints[work_layout.JUMP],
    )


@inlined
def _finish(code, b, given, found, lanes, lane, w, status):
    """Write down what a scenario has come to."""
    s, block, values = lanes.scenario[lane], b.block, lanes.signals
    signals, views = found.lowest.shape[1], found.lowest.shape[2]
    for i in range(w.ints[work_layout.NE]):
        note_end(
            i,
            w.m[i],
            w.reals[work_layout.TIME],
            False,
            lanes.since[lane],
            given.asked,
            found.spent[s],
            found.number[s],
            found.latest[s],
            found.switches[s],
        )
        found.modes[s, i] = w.m[i]
    for i in range(found.states.shape[1]):
        found.states[s, i] = w.x[i]
    if signals > 0:
        call(code.observe, w.reals[work_layout.TIME], 0.0, w.x, w.k, w.p, w.m, values[0])
        found.doubtful[s] = block[b.rows[layout.DOUBT], lane] != 0.0
    for q in range(signals):
        found.ends[s, q] = values[0, q]
        for v in range(views):
            place = b.rows[layout.MEASURED] + 3 * (q * views + v)
            low, high = block[place, lane], block[place + 1, lane]
            if given.windows[v, 1] >= w.reals[work_layout.TIME]:  # the far side of a jump there
                low, high = min(low, values[0, q]), max(high, values[0, q])
            found.lowest[s, q, v], found.highest[s, q, v], found.integral[s, q, v] = low, high, block[place + 2, lane]
    found.statuses[s] = status
    found.counts[s, 0], found.counts[s, 1] = w.ints[work_layout.ACCEPTED], w.ints[work_layout.REJECTED]


@inlined
def _take(code, b, given, found, lanes, lane, w, s):
    """Begin scenario s in a lane; returns the status of the scalar loop."""
    signals, views = found.lowest.shape[1], found.lowest.shape[2]
    lanes.scenario[lane] = s
    w.ints[work_layout.EVENTS], w.ints[work_layout.MERGED] = 0, 0
    status = begin(code.scalar, w, given.rest, given.parameters[s], given.starts[s], given.memories[s], given.held[s], 0)
    put_parameters(b.block, b.rows, lane, w, lanes.p)
    for i in range(w.ints[work_layout.NE]):
        lanes.since[lane, i] = 0.0
    b.block[b.rows[layout.DOUBT], lane] = 0.0
    for v in range(views):
        for i in range(2):
            b.block[b.rows[layout.EDGES] + 2 * v + i, lane] = given.windows[v, i] * (1.0 - layout.SLACK)
        for q in range(signals):
            place = b.rows[layout.MEASURED] + 3 * (q * views + v)
            b.block[place, lane], b.block[place + 1, lane], b.block[place + 2, lane] = np.inf, -np.inf, 0.0
    return status


@cached(_nrt=False)
def run(code, b, given, found, lanes, w, first, last):
    """Run the scenarios `first` to `last` - 1 in the lanes of one block.

    code, b, given, found, lanes: `BlockCode`, `BlockArrays`, `Scenarios`, `Results` and `LaneStates` of `toolbox.lanes.layout`;  w: the arrays of the
    scalar loop.
    """
    b, given, found, lanes = lent(b), lent(given), lent(found), lent(lanes)
    w = lent(w)
    width = b.block.shape[1]
    _start_block(b, w)
    following, running = first, 0
    while True:
        settled = code.settle != 0 and b.waiting[0] != 0 and _settle(code, b, lanes, running)
        for lane in range(width if b.waiting[0] != 0 else 0):
            flag = np.int64(b.block[layout.FLAG_ROW, lane])
            s = lanes.scenario[lane]
            if s >= 0 and settled and flag == layout.GOES_ON and lanes.happened[lane]:
                flag = _note_settled(b, found, given.asked, lanes, lane, w)
            if flag == layout.GOES_ON or (s < 0 and following >= last):
                continue
            if flag == layout.EVENT and code.settle != 0 and s >= 0:
                if not settled:
                    continue  # until a few lanes wait together
                lanes.happened[lane] = False
            status = work_layout.DONE
            w.ints[work_layout.EVENTS], w.ints[work_layout.MERGED] = 0, 0
            if flag == layout.ENDLESS_FLAG:
                status = work_layout.ENDLESS
            elif s >= 0:
                status = _look_after(code, b, given, found, lanes, lane, w, flag)
            if status == layout.GOING:
                continue
            while True:  # ends with a lane that goes on, or with none left to begin
                if s >= 0:
                    for e in range(w.ints[work_layout.EVENTS]):
                        _note_switch(found, given.asked, lanes, lane, s, w.ev_i[e], w.ev_m[e, 0], w.ev_m[e, 1], w.ev_t[e])
                    found.counts[s, 3] += w.ints[work_layout.MERGED]
                    if status == work_layout.PAUSED and w.ints[work_layout.ACCEPTED] + w.ints[work_layout.REJECTED] < layout.MOST_STEPS:
                        _go_on(code, b, given.edges, lanes, lane, w)
                        break
                    _finish(code, b, given, found, lanes, lane, w, status)
                    running -= 1
                if following >= last:
                    lanes.scenario[lane] = -1
                    b.block[:, lane] = 0.0
                    b.block[layout.STOP_ROW, lane] = np.inf
                    break
                s = following
                following += 1
                running += 1
                status = _take(code, b, given, found, lanes, lane, w, s)
        if running == 0:
            return
        call_block(code.advance, b.block)
        while b.due[0] != 0:
            call_sample(code.sample, b.block, b.clocks, b.noise, b.queue)
