"""Samples taken in lanes: what `toolbox.simulation.event_loop` does with sampled laws at one instant, for all lanes of a block that have stepped to one.

Every lane counts its own samples. The order at one instant is that of the loop: samples of all laws, updates of their memories, then the holds that are due,
then slopes and guards anew, with the step size kept. A lane in which a contact that holds would not hold the new input, or in which anything else is due at
the instant (a jump of a table, the edge of a window, the end), is left as it was to the scalar loop.

Noise is read from a table: the standard normal number of a sample depends on its channel and its number alone, so that all lanes share it, to the last
bit with the scalar loop.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from toolbox.compilation import loop_layout
from toolbox.compilation.emitter import inline
from toolbox.compilation.loop_layout import FRICTION, RIGID
from toolbox.compilation.program import Program
from toolbox.compilation.vector_emitter import VectorBody
from toolbox.lanes.loop import GOES_ON, ROUND_OFF, SAMPLE, STOP
from toolbox.lanes.vectors import Truth, Value, largest, smallest

POINTERS = ("clocks", "noise", "queue")
"""Arrays that a sample reads beside the block: see `clock_numbers`, `noise_table`, and the outputs of late laws on their way, (law, slot, output, lane)."""


def clock_numbers(clocks: np.ndarray, queue: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """(period, delay) of every law, then 1 / depth of the queue, its depth, and the length of a channel in the table of noise."""
    depth = queue.shape[1]
    return np.array([*clocks.ravel(), 1.0 / max(depth, 1), depth, noise.shape[1]], float)


def noise_table(work: Any, duration: float) -> np.ndarray:
    """The standard normal numbers of all samples of a run, shape (places in the memory of laws, samples); rows that hold no noise are zero."""
    counts = [int(duration / period) + 2 if row[loop_layout.NOISES] else 0 for row, (period, _) in zip(work.samplers, work.clocks, strict=True)]
    most = max(counts, default=0)
    table = np.zeros((work.memory.size if most else 0, most))
    for row, count in zip(work.samplers, counts, strict=True):
        first = row[loop_layout.FIRST_STATE] + row[loop_layout.STATES]
        for place in range(first, first + row[loop_layout.NOISES]):
            table[place, :count] = _channel(work.keys[place], count)
    return table


@lru_cache(maxsize=4)
def _channel(key: np.uint64, count: int) -> np.ndarray:
    """The first numbers of a channel of noise."""
    from toolbox.simulation.noise import normal

    return np.array([normal(key, k) for k in range(count)])


def sampling(program: Program, width: int, rows: dict[str, int], late: tuple[bool, ...]) -> VectorBody:
    """The function (block, clocks, noise, queue) that takes the samples, and holds the outputs, of the lanes that wait at one.

    late: which laws have a delay. Writes the row `due`: bits of the lanes that wait at another instant too near to be stepped to.
    """
    form, system = program.form, program.system
    n, ne, ng = program.machine.states, program.machine.elements, program.machine.guards
    p_size = program.p_size
    arguments = [system.t, ca.vertcat(system.x, ca.SX.sym("hidden", n - system.x.numel())), program.expressions[0], system.m]
    anew = (form.field, form.guards, form.guard_rates, form.slip, form.force, form.static)
    refreshed = ca.Function("refreshed", arguments, [ca.vertcat(*map(ca.densify, anew))])

    body = VectorBody(width)

    def loaded(name: str, count: int = 1, first: int = 0) -> list[Value]:
        return [Value(body, body.load("%lanes", rows[name] + first + i)) for i in range(count)]

    def number(place: int) -> Value:
        """One of `clocks` in every lane."""
        one = body.value(f"load double, ptr {body.value(f'getelementptr double, ptr %clocks, i64 {place}')}")
        first = body.value(f"insertelement {body.type} poison, double {one}, i64 0")
        return Value(body, body.value(f"shufflevector {body.type} {first}, {body.type} poison, <{width} x i32> zeroinitializer"))

    def instant(count: Value, period: Value, delay: Value | None = None) -> Value:
        """count period + delay, rounded as the scalar loop rounds it."""
        product = body.value(f"fmul {body.type} {count.name}, {period.name}")
        return Value(body, product if delay is None else body.value(f"fadd {body.type} {product}, {delay.name}"))

    (t,), (stop,), (calendar,), (flag,), (steps,) = map(loaded, ("time", "stop", "calendar", "flag", "accepted"))
    x, k, p, m, g = loaded("x", n), loaded("k", n), loaded("p", p_size), loaded("m", ne), loaded("g", 2 * ng)
    side, armed, sizes, others = (
        loaded(name, count) for name, count in (("side", ng), ("armed", ng), ("guard_scale", ng), ("other_scale", 2 * ne))
    )
    waits = ~flag.differs(float(SAMPLE))
    acts = waits & (t < calendar)
    given = [[t.name], *([value.name for value in column] for column in (x, p, m))]

    # --- samples and updates of all laws, by the inputs held so far
    laws = len(program.updates)
    inverse, depth, length = (number(2 * laws + i) for i in range(3))
    remembered: list[tuple[int, Value, Value]] = []
    counts: list[Value] = []
    held = list(p)
    changed = acts & (t < t)
    place, following = 0, calendar
    widest = max(outputs.numel() for _, _, outputs in program.updates)
    for c, ((z, update, outputs), law) in enumerate(zip(program.updates, system.updates, strict=True)):
        period, delay = number(2 * c), number(2 * c + 1) if late[c] else None
        taken, applied = loaded("samples", 2, 2 * c)
        takes = acts & (instant(taken, period) <= t)
        states, first = law.memory.numel(), program.held_slot + law.first_held
        memory = loaded("memory", states, place)
        noise = []
        for i in range(states, z.numel()):
            at = body.as_integers((taken + float(place + i) * length).name)
            noise.append(body.gather("%noise", at, takes.name))
        function = ca.Function("update", [*arguments, z], [ca.densify(ca.vertcat(update, outputs))])
        values = [Value(body, name) for name in inline(body, function, [*given, [*(v.name for v in memory), *noise]])[0]]
        remembered += [(place + i, takes.choose(value, old), old) for i, (value, old) in enumerate(zip(values, memory, strict=False))]
        place += z.numel()
        more = takes.choose(taken + 1.0, taken)
        computed = values[states:]
        if delay is None:
            held[first : first + len(computed)] = [takes.choose(value, p[first + i]) for i, value in enumerate(computed)]
            changed |= takes
            after = more
        else:
            lane = Value(body, _lane_numbers(width))

            def places(count: Value, i: int, c: int = c, lane: Value = lane) -> str:
                slot = count - depth * Value(body, body.intrinsic("floor", ((count + 0.5) * inverse).name))
                row = ((slot + float(c) * depth) * float(widest) + float(i)) * float(width)
                return body.as_integers((row + lane).name)

            for i, value in enumerate(computed):
                body.scatter(value.name, "%queue", places(taken, i), takes.name)
            applies = acts & (applied < more) & (instant(applied, period, delay) <= t)
            for i in range(len(computed)):
                come = Value(body, body.gather("%queue", places(applied, i), applies.name))
                held[first + i] = applies.choose(come, p[first + i])
            changed |= applies
            after = applies.choose(applied + 1.0, applied)
            following = (after < more).choose(smallest(instant(after, period, delay), following), following)
        following = smallest(instant(more, period), following)
        counts += [more, after]

    # --- slopes and guards with what is held now; a contact that would not hold is left to the scalar loop
    (found,) = inline(body, refreshed, [given[0], given[1], [value.name for value in held], given[3]])
    new = [Value(body, name) for name in found]
    k_new, g_new, (slip, force, static) = (
        new[:n],
        new[n : n + 2 * ng],
        (new[n + 2 * ng + q * ne : n + 2 * ng + (q + 1) * ne] for q in range(3)),
    )
    wrong = acts & (t < t)
    for i in range(ne):
        sticks = ~m[i].differs(0.0)
        if program.kind[i] == RIGID:
            wrong |= sticks & (force[i] > 1e-9 * static[i])
        elif program.kind[i] == FRICTION:
            wrong |= sticks & ~(abs(force[i]) <= static[i] * (1.0 + 1e-9))
            wrong |= ~sticks & (m[i] * slip[i] < 0.0)
        else:
            wrong |= g_new[2 * i] < -2e-9 * largest(largest(abs(g_new[2 * i]), sizes[2 * i]), others[2 * i])
    done = acts & ~(changed & wrong)
    renewed = done & changed

    def store(name: str, i: int, where: Truth, value: Any, old: Value) -> None:
        body.store(where.choose(value, old).name, "%lanes", rows[name] + i)

    for i in range(n):
        store("k", i, renewed, k_new[i], k[i])
    for j in range(2 * ng):
        store("g", j, renewed, g_new[j], g[j])
    for j in range(ng):
        size = largest(abs(g_new[j]), sizes[j])
        store("guard_scale", j, renewed, size, sizes[j])
        store("armed", j, renewed, (side[j] * g_new[j] > 1e-13 * size).choose(1.0, 0.0), armed[j])
    for i, (value, old) in enumerate(zip(held, p, strict=True)):
        if value is not old:
            store("p", i, done, value, old)
    for i, value, old in remembered:
        store("memory", i, done, value, old)
    for i, value in enumerate(counts):
        store("samples", i, done, value, loaded("samples", 1, i)[0])

    # --- the next stop, or one too near to be stepped to
    near = done & (following - t < 1e-14 * abs(t))
    store("time", 0, near, following, t)
    store("stop", 0, done, following, stop)
    every = Value(body, body.intrinsic("floor", (steps * (1 / 128)).name)) * 128.0
    goes_on = (~every.differs(steps)).choose(float(ROUND_OFF), float(GOES_ON))
    flag = (waits & ~acts).choose(float(STOP), (acts & ~done).choose(float(STOP), flag))
    flag = near.choose(float(SAMPLE), done.choose(goes_on, flag))
    body.store(flag.name, "%lanes", rows["flag"])
    body.store_bits(near.name, "%lanes", rows["due"])
    body.store_bits(flag.differs(0.0).name, "%lanes", rows["waiting"])
    return body


def _lane_numbers(width: int) -> str:
    """0, 1, 2, ... as a vector."""
    return f"<{', '.join(f'double {float(lane):.1f}' for lane in range(width))}>"
