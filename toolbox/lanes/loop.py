"""The loop over blocks of lanes, compiled once per machine: it fills lanes with scenarios and looks after the instants that a pass leaves to it.

An event that a lane has stepped to is handled here by the functions of `toolbox.simulation.event_loop`; whatever else a pass does not carry, such as
a guard that starts
at zero, an impact or a dip of a guard inside a step, is one step of the scalar loop from where the lane stands, after which the lane goes on in its block.
So the lanes know every kind of element, and switch as the scalar loop does.

What numba keeps of it on disk is made anew after an edit of `toolbox/simulation/event_loop.py` (see `toolbox.compilation.numba_cache`).
"""

from __future__ import annotations

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from toolbox.compilation.calls import borrowed_all, call
from toolbox.compilation.loop_layout import (
    ACCEPTED,
    APPLIED,
    BUDGET,
    CLOSE,
    DONE,
    END,
    ENDLESS,
    ERROR_OLD,
    EVENTS,
    FIRST_HELD,
    FIRST_OUTPUT,
    JUMP,
    LAST_EVENT,
    LOCATED,
    LONGEST,
    MERGED,
    NE,
    NG,
    OUTPUT,
    OUTPUTS,
    PAUSED,
    RECORDS,
    REJECTED,
    RTOL,
    STARTED,
    STEP,
    STEP_OLD,
    STEP_SIZE,
    TAKEN,
    TIME,
    N,
)
from toolbox.compilation.numba_cache import cached, inlined
from toolbox.measuring.measuring_loop import note_end
from toolbox.simulation.event_loop import advance
from toolbox.simulation.events import after_event, project_event
from toolbox.simulation.step_control import measure_round_off, spread_round_off

GOES_ON, EVENT, ALONE, ROUND_OFF, STOP, SAMPLE = range(6)
"""Why a lane waits: an event has been stepped to; a step for the scalar loop; round-off to be measured again; an instant of the run's calendar; a sample."""
(TIME_ROW, WANTED_ROW, STOP_ROW, ERROR_OLD_ROW, STEP_OLD_ROW, REJECTED_ROW, SEARCHING_ROW, WHOLE_ROW, LOW_ROW, HIGH_ROW, FRACTION_ROW, TRIES_ROW,
 LONGEST_ROW, END_ROW, RTOL_ROW, ACCEPTED_ROW, REFUSED_ROW, FLAG_ROW, LOCATED_ROW, WAITING_ROW) = range(20)  # fmt: skip
(X, K, P, M, G, SIDE, ARMED, GUARD_SCALE, SCALE, GROUP_SCALE, NOISE, OTHER_SCALE, EDGES, MEASURED, DOUBT, CALENDAR, DUE, SAMPLES, MEMORY) = range(19)
ITEMS = (
    "x",
    "k",
    "p",
    "m",
    "g",
    "side",
    "armed",
    "guard_scale",
    "scale",
    "group_scale",
    "noise",
    "other_scale",
    "edges",
    "measured",
    "doubt",
    "calendar",
    "due",
    "samples",
    "memory",
)
"""Items of a block whose first rows the loop is told, in this order."""
ENDLESS_FLAG = 9
SLACK = 2e-13
"""Part of an instant by which a step may miss the edge of a window."""
MOST_STEPS = 20_000_000
"""Steps after which a scenario ends with the status PAUSED."""


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


@intrinsic
def _call_scalar(typingctx, address, w):  # pragma: no cover - compiled
    """Call `toolbox.simulation.event_loop.advance` at a raw address: called by name it would be compiled anew as a part of this file, which takes a minute."""

    def codegen(context, builder, sig, args):
        from llvmlite import ir

        kind = ir.FunctionType(ir.IntType(64), [context.get_value_type(sig.args[1])])
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), [args[1]])

    return types.int64(types.int64, w), codegen


def scalar_address(w):
    """Address of `toolbox.simulation.event_loop.advance` for the arrays `w`."""
    from numba import typeof

    found = advance.overloads.get((typeof(w),))
    if found is None:
        advance.compile((typeof(w),))
        found = advance.overloads[(typeof(w),)]
    return found.library.get_pointer_to_function(found.fndesc.llvm_cfunc_wrapper_name)


@inlined
def _gather_point(block, rows, lane, w, p):
    """Where a lane stands, in the arrays of the scalar loop."""
    w.reals[TIME] = block[TIME_ROW, lane]
    w.ints[ACCEPTED] = np.int64(block[ACCEPTED_ROW, lane])
    w.ints[REJECTED] = np.int64(block[REFUSED_ROW, lane])
    for i in range(w.ints[N]):
        w.x[i] = block[rows[X] + i, lane]
        w.k[i] = block[rows[K] + i, lane]
    for i in range(w.p.size):
        w.p[i] = p[lane, i]
    for i in range(w.ints[NE]):
        w.m[i] = block[rows[M] + i, lane]


@inlined
def _gather_history(block, rows, lane, w):
    """What a lane remembers of its way, in the arrays of the scalar loop."""
    ne, ng = w.ints[NE], w.ints[NG]
    w.reals[STEP_SIZE] = block[WANTED_ROW, lane]
    w.reals[ERROR_OLD] = block[ERROR_OLD_ROW, lane]
    w.reals[STEP_OLD] = block[STEP_OLD_ROW, lane]
    for i in range(w.ints[N]):
        w.scale[i] = block[rows[SCALE] + i, lane]
        w.noise[i] = block[rows[NOISE] + i, lane]
    for i in range(w.group_scale.size):
        w.group_scale[i] = block[rows[GROUP_SCALE] + i, lane]
    for j in range(2 * ng):
        w.g[j] = block[rows[G] + j, lane]
        w.guard_scale[j] = 0.0
    for j in range(ng):
        w.side[j] = block[rows[SIDE] + j, lane]
        w.armed[j] = block[rows[ARMED] + j, lane] != 0.0
        w.slot[j] = j + ng if j < 2 * ne and w.m[j // 2] == 0.0 else j
        w.guard_scale[w.slot[j]] = block[rows[GUARD_SCALE] + j, lane]
        if j < 2 * ne:
            w.guard_scale[2 * j + ng - w.slot[j]] = block[rows[OTHER_SCALE] + j, lane]


@inlined
def _scatter(block, rows, lane, w, stop):
    """The arrays of the scalar loop back in their lane."""
    n, ne, ng = w.ints[N], w.ints[NE], w.ints[NG]
    block[TIME_ROW, lane] = w.reals[TIME]
    block[WANTED_ROW, lane] = w.reals[STEP_SIZE]
    block[ERROR_OLD_ROW, lane] = w.reals[ERROR_OLD]
    block[STEP_OLD_ROW, lane] = w.reals[STEP_OLD]
    block[ACCEPTED_ROW, lane] = w.ints[ACCEPTED]
    block[REFUSED_ROW, lane] = w.ints[REJECTED]
    block[STOP_ROW, lane] = stop
    block[REJECTED_ROW, lane] = 0.0
    block[SEARCHING_ROW, lane] = 0.0
    block[FLAG_ROW, lane] = 0.0
    for i in range(n):
        block[rows[X] + i, lane] = w.x[i]
        block[rows[K] + i, lane] = w.k[i]
        block[rows[SCALE] + i, lane] = w.scale[i]
        block[rows[NOISE] + i, lane] = w.noise[i]
    for i in range(ne):
        block[rows[M] + i, lane] = w.m[i]
    for i in range(w.group_scale.size):
        block[rows[GROUP_SCALE] + i, lane] = w.group_scale[i]
    for j in range(2 * ng):
        block[rows[G] + j, lane] = w.g[j]
    for j in range(ng):
        block[rows[SIDE] + j, lane] = w.side[j]
        block[rows[ARMED] + j, lane] = 1.0 if w.armed[j] else 0.0
        block[rows[GUARD_SCALE] + j, lane] = w.guard_scale[w.slot[j]]
    for j in range(2 * ne):
        block[rows[OTHER_SCALE] + j, lane] = w.guard_scale[2 * j + ng - w.slot[j]]


@inlined
def _put_parameters(block, rows, lane, w, p):
    for i in range(w.p.size):
        p[lane, i] = w.p[i]
        block[rows[P] + i, lane] = w.p[i]


@inlined
def _gather_samples(block, rows, lane, w, queue):
    """What the sampled laws of a lane remember, hold and have on the way, in the arrays of the scalar loop."""
    depth, widest = w.queue.shape[1], w.queue.shape[2]
    for c in range(w.samplers.shape[0]):
        s = w.samplers[c]
        s[TAKEN] = np.int64(block[rows[SAMPLES] + 2 * c, lane])
        s[APPLIED] = np.int64(block[rows[SAMPLES] + 2 * c + 1, lane])
        for i in range(s[OUTPUTS]):
            w.p[s[FIRST_OUTPUT] + i] = block[rows[P] + s[FIRST_OUTPUT] + i, lane]
        for q in range(s[APPLIED], s[TAKEN]):
            for i in range(s[OUTPUTS]):
                w.queue[c, q % depth, i] = queue[(c * depth + q % depth) * widest + i, lane]
    for i in range(w.memory.size):
        w.memory[i] = block[rows[MEMORY] + i, lane]


@inlined
def _scatter_samples(block, rows, lane, w, queue):
    """The same back in their lane, and the stop that is next after the calendar's."""
    depth, widest = w.queue.shape[1], w.queue.shape[2]
    stop = block[STOP_ROW, lane]
    block[rows[CALENDAR], lane] = stop
    for c in range(w.samplers.shape[0]):
        s = w.samplers[c]
        block[rows[SAMPLES] + 2 * c, lane] = s[TAKEN]
        block[rows[SAMPLES] + 2 * c + 1, lane] = s[APPLIED]
        stop = min(stop, s[TAKEN] * w.clocks[c, 0])
        if s[APPLIED] < s[TAKEN]:
            stop = min(stop, s[APPLIED] * w.clocks[c, 0] + w.clocks[c, 1])
        for q in range(s[APPLIED], s[TAKEN]):
            for i in range(s[OUTPUTS]):
                queue[(c * depth + q % depth) * widest + i, lane] = w.queue[c, q % depth, i]
    for i in range(w.memory.size):
        block[rows[MEMORY] + i, lane] = w.memory[i]
    block[STOP_ROW, lane] = stop


@inlined
def _next_stop(w, edges):
    """The next instant of the calendar at which a step must end: an edge of a window, a jump of a parameter or the end."""
    stop = w.reals[END]
    for edge in edges:
        if w.reals[TIME] < edge * (1.0 - SLACK):
            stop = min(stop, edge)
    if w.ints[JUMP] < w.jump_t.size:
        stop = min(stop, w.jump_t[w.ints[JUMP]])
    return stop


@inlined
def _observe(block, rows, lane, windows, observe, w, t, x_old, k_old, m_old, values):
    """Measure the signals of a lane over a step that the scalar loop has taken: Simpson's integral and parabolas over 64 parts, from steps of their own."""
    h = w.reals[TIME] - t
    counts = False
    for v in range(windows):
        counts = counts or block[rows[EDGES] + 2 * v, lane] <= t < block[rows[EDGES] + 2 * v + 1, lane]
    for part in range(65 if counts else 0):
        weight = h / 192.0 * (1.0 if part % 64 == 0 else (4.0 if part % 2 == 1 else 2.0))
        call(w.ints[STEP], t, h * part / 64.0, x_old, k_old, w.p, m_old, w.y)
        for i in range(x_old.size):
            w.s[i] = w.y[i]
        call(observe, t + h * part / 64.0, 0.0, w.s, k_old, w.p, m_old, values[part % 3])
        for q in range(values.shape[1]):
            value, middle, before = values[part % 3, q], values[(part + 2) % 3, q], values[(part + 1) % 3, q]
            low, high = value, value
            if part > 1 and (middle - before) * (value - middle) < 0.0:  # the vertex of the parabola
                middle -= (value - before) ** 2 / (8.0 * (value - 2.0 * middle + before))
                low, high = min(value, middle), max(value, middle)
            for v in range(windows):
                if block[rows[EDGES] + 2 * v, lane] <= t < block[rows[EDGES] + 2 * v + 1, lane]:
                    place = rows[MEASURED] + 3 * (q * windows + v)
                    block[place, lane] = min(block[place, lane], low)
                    block[place + 1, lane] = max(block[place + 1, lane], high)
                    block[place + 2, lane] += weight * value


@inlined
def _event(w, t):
    """What the scalar loop does with an event that has been stepped to; returns its status."""
    project_event(w, t, False)
    status = after_event(w, t)
    return PAUSED if status == DONE else status


@inlined
def _begin(scalar, w, rest, parameters, start, memory, held, steps):
    """Start a scenario in the arrays of the scalar loop and take at most so many steps; returns its status."""
    w.p[: parameters.size] = parameters
    w.p[parameters.size :] = rest[parameters.size :]
    w.p[w.ints[FIRST_HELD] : w.ints[FIRST_HELD] + held.size] = held
    w.memory[:] = memory
    w.samplers[:, TAKEN], w.samplers[:, APPLIED] = 0, 0
    w.x[:] = 0.0
    w.x[: start.size] = start
    for array in (w.k, w.m, w.scale, w.noise, w.group_scale, w.g, w.guard_scale, w.before):
        array[:] = 0.0
    w.side[:] = 1.0
    for array in (w.armed, w.fired, w.zero, w.forced, w.bounced):
        array[:] = False
    w.ints[ACCEPTED], w.ints[REJECTED], w.ints[STARTED], w.ints[JUMP], w.ints[CLOSE] = 0, 0, 0, 0, 0
    w.ints[OUTPUT] = 0
    w.reals[TIME], w.reals[STEP_OLD], w.reals[ERROR_OLD], w.reals[LAST_EVENT] = 0.0, 0.0, 0.0, -np.inf
    return _alone(scalar, w, steps)


@inlined
def _alone(scalar, w, steps):
    """Let the scalar loop do what is due and take at most so many steps; returns its status."""
    w.ints[BUDGET], w.ints[RECORDS] = steps, 0
    return _call_scalar(scalar, w)


# fmt: off
@cached
def run(address, settle, observe, sample, scalar, block, waiting, due, clocks, noise, queue, rows, w, parameters, starts, memories, held, first,
        last, windows, asked, x_end, m_end, statuses, counts, lowest, highest, integral, ends, doubt, spent, number, latest, switches, ev_t, ev_i, ev_m):
    # fmt: on
    """Run the scenarios `first` to `last` - 1 in the lanes of one block.

    address, settle, observe, sample, scalar: of the pass, the settling of events (0 for none), the signals, the samples (0 for none) and the scalar
    loop;  waiting, due: the rows of these names as integers;  clocks, noise, queue: see `toolbox.lanes.lanes.samples`;  parameters, starts,
    memories, held: one row per scenario, the last two of sampled laws;
    windows: (begin, end) of each, whose inner edges the steps end on;  asked: rows (element, mode, begin, end of the window);  x_end, m_end, statuses:
    what each ends with;  counts: steps, refused steps, switches, merged events, and steps that the scalar loop took;  lowest to switches: the arrays of a
    `toolbox.measuring.measures.Readings`;  doubt: whether extrema are doubtful (see `toolbox.lanes.lanes.extrema`);  ev_*: the first switches of
    every scenario, as many as there is room for.
    """
    w = borrowed_all(w)
    width, n, ne = block.shape[1], w.ints[N], w.ints[NE]
    scenario = np.full(width, -1, np.int64)
    p = np.zeros((width, w.p.size))
    modes = np.zeros((width, ne))
    few = max(width // 5, 2)
    last_event, close, jump = np.zeros(width), np.zeros(width, np.int64), np.zeros(width, np.int64)
    since = np.zeros((width, ne))
    happened = np.zeros(width, np.bool_)
    x_old, k_old, m_old = np.zeros(n), np.zeros(n), np.zeros(max(ne, 1))
    p_old, p_new = np.zeros(w.p.size), np.zeros(w.p.size)
    signals, views = lowest.shape[1], lowest.shape[2]
    values = np.zeros((3, signals))
    cuts = windows.ravel()
    end = w.reals[END]
    rest = w.p.copy()
    block[:] = 0.0
    block[STOP_ROW, :] = np.inf
    block[LONGEST_ROW, :] = w.reals[LONGEST]
    block[END_ROW, :] = end
    block[RTOL_ROW, :] = w.reals[RTOL]
    block[FLAG_ROW, :] = STOP
    waiting[0] = 1
    following, running = first, 0
    while True:
        settled = False
        if settle != 0 and waiting[0] != 0:
            events = 0
            for lane in range(width):
                if block[FLAG_ROW, lane] == EVENT and scenario[lane] >= 0:
                    happened[lane] = True
                    events += 1
            settled = events >= few or events == running
            if settled:
                call_block(settle, block)
        for lane in range(width if waiting[0] != 0 else 0):
            flag = np.int64(block[FLAG_ROW, lane])
            s = scenario[lane]
            if s >= 0 and settled and flag == GOES_ON and happened[lane]:
                happened[lane] = False
                t = block[TIME_ROW, lane]
                changed = False
                for i in range(ne):
                    mode = block[rows[M] + i, lane]
                    if mode == modes[lane, i]:
                        continue
                    changed = True
                    note_end(i, modes[lane, i], t, True, since[lane], asked, spent[s], number[s], latest[s], switches[s])
                    if counts[s, 2] < ev_t.shape[1]:
                        ev_t[s, counts[s, 2]] = t
                        ev_i[s, counts[s, 2]] = i
                        ev_m[s, counts[s, 2]] = np.int8(mode)
                    counts[s, 2] += 1
                    modes[lane, i] = mode
                counts[s, 3] += not changed and block[LOCATED_ROW, lane] < 2 * ne
                close[lane] = close[lane] + 1 if t - last_event[lane] <= 1e-13 * max(abs(t), min(end, 1.0)) else 0
                last_event[lane] = t
                if close[lane] <= 50 + 20 * ne:
                    continue
                _gather_point(block, rows, lane, w, p)
                flag = ENDLESS_FLAG
            if flag == GOES_ON or (s < 0 and following >= last):
                continue
            if flag == EVENT and settle != 0 and s >= 0:
                if not settled:
                    continue  # until a few lanes wait together
                happened[lane] = False
            status = DONE
            w.ints[EVENTS], w.ints[MERGED] = 0, 0
            if flag == ENDLESS_FLAG:
                status = ENDLESS
            elif s >= 0:
                t = block[TIME_ROW, lane]
                _gather_point(block, rows, lane, w, p)
                if sample != 0:
                    _gather_samples(block, rows, lane, w, queue)
                if flag == ROUND_OFF:
                    measure_round_off(w)
                    for i in range(n):
                        w.scale[i] = block[rows[SCALE] + i, lane]
                    spread_round_off(w, block[WANTED_ROW, lane])
                    for i in range(n):
                        block[rows[NOISE] + i, lane] = w.noise[i]
                    block[FLAG_ROW, lane] = GOES_ON
                    if w.ints[ACCEPTED] + w.ints[REJECTED] < MOST_STEPS:
                        continue
                    status = PAUSED
                elif flag != STOP or t < end or sample != 0:
                    _gather_history(block, rows, lane, w)
                    w.reals[LAST_EVENT], w.ints[CLOSE], w.ints[JUMP] = last_event[lane], close[lane], jump[lane]
                    if flag == EVENT:
                        w.ints[LOCATED] = np.int64(block[LOCATED_ROW, lane])
                        status = _event(w, t)
                    else:
                        counts[s, 4] += flag == ALONE
                        for i in range(n):
                            x_old[i], k_old[i] = w.x[i], w.k[i]
                        for i in range(ne):
                            m_old[i] = w.m[i]
                        for i in range(w.p.size):
                            p_old[i] = w.p[i]
                        for cut in cuts:
                            if flag == ALONE and t < cut * (1.0 - SLACK) < t + w.reals[STEP_SIZE]:
                                w.reals[STEP_SIZE] = cut - t
                        status = _alone(scalar, w, 1 if flag == ALONE else 0)
                        if signals > 0 and w.reals[TIME] > t:
                            p_new[:] = w.p  # which may have jumped at the end of the step
                            w.p[:] = p_old
                            _observe(block, rows, lane, views, observe, w, t, x_old, k_old, m_old, values)
                            w.p[:] = p_new
                        _put_parameters(block, rows, lane, w, p)
            while True:  # ends with a lane that goes on, or with none left to begin
                if s >= 0:
                    for e in range(w.ints[EVENTS]):
                        i, t = w.ev_i[e], w.ev_t[e]
                        note_end(i, w.ev_m[e, 0], t, True, since[lane], asked, spent[s], number[s], latest[s], switches[s])
                        if counts[s, 2] < ev_t.shape[1]:
                            ev_t[s, counts[s, 2]] = t
                            ev_i[s, counts[s, 2]] = i
                            ev_m[s, counts[s, 2]] = w.ev_m[e, 1]
                        counts[s, 2] += 1
                    counts[s, 3] += w.ints[MERGED]
                    if status == PAUSED and w.ints[ACCEPTED] + w.ints[REJECTED] < MOST_STEPS:
                        _scatter(block, rows, lane, w, _next_stop(w, cuts))
                        if sample != 0:
                            _scatter_samples(block, rows, lane, w, queue)
                        for i in range(ne):
                            modes[lane, i] = w.m[i]
                        last_event[lane], close[lane], jump[lane] = w.reals[LAST_EVENT], w.ints[CLOSE], w.ints[JUMP]
                        break
                    for i in range(ne):
                        note_end(i, w.m[i], w.reals[TIME], False, since[lane], asked, spent[s], number[s], latest[s], switches[s])
                        m_end[s, i] = w.m[i]
                    for i in range(x_end.shape[1]):
                        x_end[s, i] = w.x[i]
                    if signals > 0:
                        call(observe, w.reals[TIME], 0.0, w.x, w.k, w.p, w.m, values[0])
                        doubt[s] = block[rows[DOUBT], lane] != 0.0
                    for q in range(signals):
                        ends[s, q] = values[0, q]
                        for v in range(views):
                            place = rows[MEASURED] + 3 * (q * views + v)
                            lowest[s, q, v], highest[s, q, v], integral[s, q, v] = block[place, lane], block[place + 1, lane], block[place + 2, lane]
                            if windows[v, 1] >= w.reals[TIME]:  # the far side of a jump there
                                lowest[s, q, v], highest[s, q, v] = min(lowest[s, q, v], values[0, q]), max(highest[s, q, v], values[0, q])
                    statuses[s] = status
                    counts[s, 0], counts[s, 1] = w.ints[ACCEPTED], w.ints[REJECTED]
                    running -= 1
                if following >= last:
                    scenario[lane] = -1
                    block[:, lane] = 0.0
                    block[STOP_ROW, lane] = np.inf
                    break
                s = following
                following += 1
                running += 1
                scenario[lane] = s
                w.ints[EVENTS], w.ints[MERGED] = 0, 0
                status = _begin(scalar, w, rest, parameters[s], starts[s], memories[s], held[s], 0)
                _put_parameters(block, rows, lane, w, p)
                for i in range(ne):
                    since[lane, i] = 0.0
                block[rows[DOUBT], lane] = 0.0
                for v in range(views):
                    for i in range(2):
                        block[rows[EDGES] + 2 * v + i, lane] = windows[v, i] * (1.0 - SLACK)
                    for q in range(signals):
                        place = rows[MEASURED] + 3 * (q * views + v)
                        block[place, lane], block[place + 1, lane], block[place + 2, lane] = np.inf, -np.inf, 0.0
        if running == 0:
            return
        call_block(address, block)
        while due[0] != 0:
            call_sample(sample, block, clocks, noise, queue)
