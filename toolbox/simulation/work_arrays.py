"""The arrays of a run: the numbers that the compiled loop reads, and the room that it writes to."""

from __future__ import annotations

import dataclasses
import math
import zlib
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from toolbox.compilation import work_layout
from toolbox.compilation.program import Program
from toolbox.modelling.inputs import Shape, Table
from toolbox.simulation.budget import Budget
from toolbox.simulation.run import Run
from toolbox.simulation.run_state import RunState
from toolbox.simulation.samples import signal_reader

MAX_RECORDS = 400_000
"""Steps of fixed length that are recorded; of more every second, third ... one is, and those next to a switch."""


MAX_SAMPLES = 200_000
"""Samples for whose records there is room from the start."""


def work_arrays(run: Run, program: Program) -> Any:
    """All arrays of a run, filled with its numbers."""
    system, kernel, state = run.system, program.kernel, run.start
    fixed, tolerance = run.method.fixed_step, run.method.own_tolerance
    n, ne, ng = kernel.states, kernel.elements, kernel.guards
    p = np.empty(program.p_size)
    base = system.values.size
    p[:base] = system.values
    p[program.first_held :] = 0.0
    if any(element.second for element in system.elements):
        p[program.first_held - 3 : program.first_held] = _resolution(run)
    times, first, index, values = _put_inputs(p, run, program)

    ints = program.ints.copy()
    ints[work_layout.NODES] = 1 if run.output_times is None else 0
    if fixed is not None and run.output_times is None:
        ints[work_layout.NODES] = 1 + int(run.duration / fixed / MAX_RECORDS)
    reals = np.zeros(work_layout.REALS)
    reals[work_layout.LONGEST] = run.longest_step if program.forced or system.updates else np.inf
    reals[work_layout.STEP_SIZE] = fixed or 0.0
    reals[work_layout.TIME] = state.time
    reals[[work_layout.END, work_layout.LAST, work_layout.HORIZON]] = run.end
    reals[work_layout.RTOL] = tolerance or run.accuracy
    reals[work_layout.LAST_EVENT] = -np.inf
    reals[work_layout.POWER] = program.formulas.power

    samplers, clocks, keys, queue, widest = _NO_ROWS, _NO_CLOCKS, _NO_KEYS, _NO_QUEUE, 1
    own_keys = _NO_KEYS
    if system.updates:
        samplers, clocks, keys, queue, widest = _sampling(run, program)
        own_keys = clock_keys(run.seeds)
    p[program.held_slot : program.held_slot + state.held.size] = state.held
    room = max(4 * n + 2 * ng, 3 * n + 4 * ng, kernel.slopes, n + 6 * ne, state.memory.size + widest, n) + 8
    if run.output_times is not None:
        capacity = run.output_times.size + 8
    elif fixed is not None:
        capacity = 1024 + int(run.duration / fixed / ints[work_layout.NODES])
    else:  # arrays that are full cost a copy each time
        capacity = 1024 + int(min(sum([1.05 * run.duration / clock.period for clock in run.clocks]), MAX_SAMPLES))
    x = np.zeros(n)  # behind the states come those of hidden forces
    x[: state.states.size] = state.states
    initial, sizes = program.initial, np.zeros(2 * ng)
    if state.modes is not None:
        initial = np.where(_same_gaps(program, state, p, x), state.modes, initial)
    if state.sizes is not None:
        sizes.reshape(2, ng)[:, : 2 * ne] = state.sizes
    events = _event_room(128 + 4 * ne, program, run.budget.events)
    return work_layout.Work(
        ints=ints, reals=reals, x=x, k=np.zeros(kernel.slopes), p=p, m=np.zeros(ne), y=np.zeros(room), z=np.zeros(room),
        x_other=np.zeros(n), p_other=np.zeros(p.size), m_other=np.zeros(2 * ne + 1),
        scale=np.zeros(n), noise=np.zeros(n + ng), group=program.groups, group_scale=np.zeros(program.group_count),
        g=np.zeros(2 * ng), g_low=np.zeros(2 * ng), g_high=np.zeros(2 * ng), guard_scale=sizes, slot=np.zeros(ng, np.int64), side=np.ones(ng),
        armed=np.zeros(ng, np.bool_), fired=np.zeros(ng, np.bool_), zero=np.zeros(ne, np.bool_), forced=np.zeros(ne, np.bool_), before=np.zeros(ne),
        kind=program.kind, initial=initial, attached=program.attached, loader=program.loader, lever=program.lever,
        bound=program.bound, struck=np.zeros(ne, np.bool_),
        excited=program.excited,
        rec_t=np.empty(capacity), rec_x=np.empty((capacity, n - program.excited.size)), rec_m=np.empty((capacity, ne), np.int8),
        rec_p=np.empty((capacity, program.p_size - program.first_held)),
        ev_t=np.empty(events), ev_i=np.empty(events, np.int32), ev_m=np.zeros((events, 3), np.int8),
        jump_t=times, jump_first=first, jump_index=index, jump_value=values,
        out_t=run.output_times if run.output_times is not None else _NO_NUMBERS,
        samplers=samplers, clocks=clocks, clock_keys=own_keys, memory=state.memory.copy(), keys=keys, queue=queue,
    )  # fmt: skip


def _same_gaps(program: Program, state: RunState, p: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Whether each element may begin in the mode that a state has: a rigid contact only where its gap is the one with which that mode was decided."""
    same = np.ones(program.kind.size, bool)
    rigid = program.rigid
    if rigid.size:
        now, moved = (closures(program, state.time, *point) for point in ((x, p), (x * (1.0 + 1e-7), p * (1.0 + 0.7e-7))))
        then = np.full(rigid.size, np.nan) if state.closures is None else state.closures
        same[rigid] = np.abs(now - then) <= 64.0 * work_layout.EPS * 1e7 * np.abs(moved - now)  # round-off of their terms
    return same


def closures(program: Program, t: float, x: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return the closures of the gaps of the rigid contacts of a program at a point, in order."""
    elements = [element for element in program.system.elements if element.rigid]
    names = tuple(f"{element.name}.{'slip' if element.is_unilateral else 'closure'}" for element in elements)
    found, m = np.empty(len(names)), np.ones(program.kind.size)
    signal_reader(program, names)(t, 0.0, *(array.ctypes.data for array in (x, x, p, m, found)))
    return found


def _put_inputs(p: np.ndarray, run: Run, program: Program) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Write the inputs as they begin among the parameters; returns (times of jumps, first jump of each, place, value) of what changes later."""
    begins, slots, numbers = [np.empty(0)], [np.empty(0, np.int64)], [np.empty(0)]
    for name, value in run.inputs.items():
        if isinstance(value, Table):
            slot = program.table_slot[name]
            pieces = value.segments()
            first = int(np.searchsorted(pieces[:, 0], run.start.time, side="right"))
            p[slot : slot + 3] = pieces[first - 1, 1:]
            begins.append(np.repeat(pieces[first:, 0], 3))
            slots.append(np.tile(np.arange(slot, slot + 3), len(pieces) - first))
            numbers.append(pieces[first:, 1:].ravel())
        elif isinstance(value, Shape):
            slot = program.coefficient_slot[name]
            p[slot : slot + len(value.coefficients)] = value.coefficients
        elif not isinstance(value, ca.SX):
            p[program.coefficient_slot[name]] = value
    begin = np.concatenate(begins)
    order = np.argsort(begin, kind="stable")
    times, first_of = np.unique(begin[order], return_index=True)
    return times, np.append(first_of, begin.size).astype(np.int64), np.concatenate(slots)[order], np.concatenate(numbers)[order]


_NO_NUMBERS = np.empty(0)
_NO_ROWS, _NO_CLOCKS = np.empty((0, work_layout.COLUMNS), np.int64), np.empty((0, 4))
_NO_KEYS, _NO_QUEUE = np.empty(0, np.uint64), np.empty((0, 2, 1))


def _resolution(run: Run) -> tuple[float, float, float]:
    """What friction in two slip directions is resolved by (`toolbox.modelling.two_directions`).

    The end of slip costs steps in proportion to the logarithm of its time only. Of the break-away, in parts of the time in which the pull has risen to the
    bound, the way is wrong by the fourth power of the share, and explicit steps are as many as its inverse.
    """
    return 1e-12 * run.end, 1e-4 * run.accuracy**0.5 * run.end, run.accuracy**0.25


def _sampling(run: Run, program: Program) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int]:
    """The rows of sampled laws, their clocks, the keys of their noise, the queue of their outputs, and the most outputs that one has."""
    updates = run.system.updates
    samplers = np.zeros((len(updates), work_layout.COLUMNS), np.int64)
    clocks = np.array(run.clocks, float)
    first_state = 0
    for c, update in enumerate(updates):
        size, first_output = update.memory.numel(), program.held_slot + update.first_held
        address = 0 if update.from_callable else program.kernel.updates[c]
        samplers[c] = (
            address,
            run.start.taken[c],
            run.start.applied[c],
            first_state,
            size,
            first_output,
            update.outputs.numel(),
            len(update.channels),
        )
        first_state += size + len(update.channels)
    latest = [
        min(clock.delay + clock.jitter, run.duration + clock.period, run.budget.steps * clock.period) / clock.period for clock in run.clocks
    ]
    depth = 2 + math.ceil(max(latest))
    depth = max(depth, *(len(rows) + 2 for rows in run.start.waiting))
    widest = max(update.outputs.numel() for update in updates)
    queue = np.zeros((len(updates), depth, widest))
    for c, rows in enumerate(run.start.waiting):
        for sample, row in enumerate(rows, run.start.applied[c]):
            queue[c, sample % depth, : row.size] = row
    return samplers, clocks, noise_keys(updates, run.seeds), queue, widest


def noise_keys(updates: Sequence[Any], seeds: Sequence[int]) -> np.ndarray:
    """Return the keys of the noise of sampled laws with these seeds. The entries at the places of the memory of a law are zero; the keys of
    its channels follow."""
    from toolbox.stepping.noise import channel_key  # here, because LLVM is slow to import

    keys: list[int | np.uint64] = []
    for update, seed in zip(updates, seeds, strict=True):
        keys += [0] * update.memory.numel() + [channel_key(seed, zlib.crc32(name.encode())) for name in update.channels]
    return np.array(keys, np.uint64)


def clock_keys(seeds: Sequence[int]) -> np.ndarray:
    """The keys of lateness and of missed samples of controllers with these seeds, one behind the other."""
    from toolbox.stepping.noise import channel_key  # here, because LLVM is slow to import

    return np.array([channel_key(seed, zlib.crc32(word)) for seed in seeds for word in (b"lateness", b"missed")], np.uint64)


def _event_room(display_units: int, program: Program, left: float) -> int:
    """Room for events, no more than are left and one instant fills: the loop stops when another instant might not fit, so at the first beyond them."""
    instant = (2 if program.formulas.locates else 4) * program.kernel.elements
    return display_units if left >= display_units else min(display_units, int(left) + instant + 1)


def limited(work: Any, program: Program, budget: Budget, spent: int) -> Any:
    """Return the same arrays with room for the remaining events of a budget, of which `spent` are used. The loop stops when the room is
    full."""
    if budget.events == np.inf:
        return work
    room = _event_room(work.ev_t.size, program, budget.events - spent)
    return work._replace(ev_t=work.ev_t[:room], ev_i=work.ev_i[:room], ev_m=work.ev_m[:room])


GENEROUS = 2**24
"""Size of an array of records [bytes] up to which it doubles when it is full; a longer one grows by a quarter."""


def grown(work: Any, program: Program, records: bool, budget: Budget) -> Any:
    """The work arrays with more room for records, or with twice the room for events.

    Records of a long chain fill most of the memory: their arrays are made longer where they lie, which copies nothing of what is large.
    """
    if records:
        room = work.rec_t.size
        room += room if work.rec_x.nbytes <= GENEROUS else room // 4
        for array in (work.rec_t, work.rec_x, work.rec_m, work.rec_p):
            array.resize((room, *array.shape[1:]), refcheck=False)  # nothing but these work arrays reads them while a run is under way
        return work
    bigger = {}
    for name in ("ev_t", "ev_i", "ev_m"):
        old = getattr(work, name)
        new = np.zeros((_event_room(2 * old.shape[0], program, budget.events), *old.shape[1:]), old.dtype)
        new[: old.shape[0]] = old
        bigger[name] = new
    return work._replace(**bigger)


def first_rows(array: np.ndarray, rows: int) -> np.ndarray:
    """Return the filled first rows of an array. If they are most of the array, this is a view; otherwise a copy, so that the rest is
    released."""
    return array[:rows] if 2 * rows > array.shape[0] else array[:rows].copy()


def state_of(run: Run, program: Program, work: Any) -> RunState:
    """Return the present state of a run, without the memory of Python laws."""
    updates = program.system.updates
    depth = work.queue.shape[1]
    taken, applied = (tuple(work.samplers[: len(updates), column].tolist()) for column in (work_layout.TAKEN, work_layout.APPLIED))
    waiting = tuple(
        np.array([work.queue[c, sample % depth, : update.outputs.numel()] for sample in range(applied[c], taken[c])]).reshape(
            -1, update.outputs.numel()
        )
        for c, update in enumerate(updates)
    )
    held = work.p[program.held_slot : program.held_slot + run.start.held.size]
    t, elements = float(work.reals[work_layout.TIME]), program.kind.size
    return dataclasses.replace(
        run.start, time=t, states=work.x[: run.start.states.size].copy(), memory=work.memory.copy(), held=held.copy(), modes=work.m.copy(),
        closures=closures(program, t, work.x, work.p) if program.rigid.size else None,
        sizes=work.guard_scale.reshape(2, -1)[:, : 2 * elements].copy(), taken=taken, applied=applied, waiting=waiting, controllers=(), carried=True,
    )  # fmt: skip
