"""Samples taken in lanes: what `toolbox.stepping.event_stepper` does with sampled laws at one instant, for all lanes of a block that have stepped to one.

Every lane counts its own samples. The order at one instant is that of the loop: samples of all laws, updates of their memories, then the holds that are due,
then slopes and guards anew, with the step size kept. A lane in which a contact that holds would not hold the new input, or in which anything else is due at
the instant (a jump of a table, the edge of a window, the end), is left as it was to the scalar loop.

Noise is read from a table: the standard normal number of a sample depends on its channel and its number alone, so that all lanes with one seed share it, to
the last bit with the scalar loop; the row `course` says where that of a lane begins.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import casadi as ca
import numpy as np

from toolbox.compilation import work_layout
from toolbox.compilation.vector_emitter import VectorBody
from toolbox.compilation.work_layout import FRICTION, RIGID
from toolbox.lanes.layout import GOES_ON, ROUND_OFF, SAMPLE, STOP
from toolbox.lanes.trial_step import Pass
from toolbox.lanes.vectors import Rows, Truth, Value, called, largest, smallest
from toolbox.stepping.holding import holds

POINTERS = ("sizes", "noise", "queue")
"""Arrays that a sample reads beside the block: see `queue_sizes`, `noise_table`, and the outputs of late laws on their way, (law, slot, output, lane)."""


def queue_sizes(queue: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """1 / depth of the queue, its depth, and the length of a channel in the table of noise."""
    depth = queue.shape[1]
    return np.array([1.0 / max(depth, 1), depth, noise.shape[1]], float)


def noise_table(work: Any, keys: np.ndarray, periods: np.ndarray, duration: float) -> np.ndarray:
    """The standard normal numbers of all samples of runs with these keys, shape (n, places in the memory of laws), one below the other.

    Its shape is (n places, samples); rows that hold no noise are zero. periods: the shortest sample time of each law.
    """
    counts = [
        int(duration / period) + 2 if row[work_layout.NOISES] else 0 for row, period in zip(work.samplers, periods.tolist(), strict=True)
    ]
    most = max(counts, default=0)
    table = np.zeros((keys.size if most else 0, most))
    for row, count in zip(work.samplers, counts, strict=True):
        first = row[work_layout.FIRST_STATE] + row[work_layout.STATES]
        for place in range(first, first + row[work_layout.NOISES]):
            for course, key in enumerate(keys[:, place]):
                table[course * keys.shape[1] + place, :count] = _channel(key, count)
    return table


@lru_cache(maxsize=32)
def _channel(key: np.uint64, count: int) -> np.ndarray:
    """The first numbers of a channel of noise."""
    from toolbox.stepping.noise import Channel, normals

    channel = Channel(np.array([key], np.uint64), np.empty(count))
    normals(channel)
    return channel.numbers


class Sample(Pass):
    """The sampling of the laws of a program under construction, beside a pass, and what the lanes hold.

    late: which laws have a delay;  was: the rows of the block;  waits: lanes that wait at a sample;  acts: those of them at which nothing else is due;
    refreshed: slopes, guards, and slip, force and bound of every element.
    """

    def __init__(self, made: Pass, late: tuple[bool, ...]) -> None:
        vars(self).update(vars(made), body=VectorBody(made.body.width))
        form = self.program.form
        ne = form.slip.numel()
        anew = (form.field, form.guards, form.guard_rates, form.slip, form.probed[2 * ne : 4 * ne])
        self.late, self.refreshed = late, ca.Function("refreshed", self.arguments, [ca.vertcat(*map(ca.densify, anew))])
        self.was = was = Rows(self.body, self.rows, self.every)
        self.t, self.flag, (self.calendar,) = was["time"], was["flag"], was["calendar"]
        self.states, self.p, self.m = was["x"][:], was["p"][:], was["m"][:]
        self.waits = ~self.flag.differs(float(SAMPLE))
        self.acts = self.waits & (self.t < self.calendar)

    def replace(self, name: str, i: int, where: Truth, value: Any, old: Value) -> None:
        """Write a row of an item in the lanes with `where` true."""
        self.body.store(where.choose(value, old).name, "%lanes", self.rows[name] + i)

    def number(self, place: int) -> Value:
        """One of `sizes` in every lane."""
        return Value(self.body, self.body.spread("%sizes", place))

    def instant(self, count: Value, period: Value, delay: Value | None = None) -> Value:
        """count period + delay, rounded as the scalar loop rounds it."""
        product = self.body.mul_rounded(count.name, period.name)
        return Value(self.body, product if delay is None else self.body.add_rounded(product, delay.name))


@dataclass
class Taken:
    """Results of the samples of all laws.

    held: parameters with the signals held;  changed: lanes in which something held is new;  failed: lanes in which a law gives a value that is no finite
    number;  following: the next instant;  memory: (place, new, old value) of what laws remember;  counts: samples taken and applied, law by law.
    """

    held: list[Value]
    changed: Truth
    failed: Truth
    following: Value
    memory: list[tuple[int, Value, Value]]
    counts: list[Value]


def sampling(other: Pass, late: tuple[bool, ...]) -> VectorBody:
    """Write the function (block, sizes, noise, queue) that evaluates the sampled laws and applies held outputs for lanes stopped at a sample.

    late: which laws have a delay. Writes the row `due`: bits of the lanes that wait at another instant too near to be stepped to.
    """
    made = Sample(other, late)
    body, acts, was, rows = made.body, made.acts, made.was, made.rows
    taken = _samples_taken(made)
    done = _refreshed(made, taken)
    for i, (value, old) in enumerate(zip(taken.held, made.p, strict=True)):
        if value is not old:
            made.replace("p", i, done, value, old)
    for i, value, old in taken.memory:
        made.replace("memory", i, done, value, old)
    for i, value in enumerate(taken.counts):
        made.replace("samples", i, done, value, was["samples"][i])

    # --- the next stop, or one too near to be stepped to
    near = done & (taken.following - made.t < 1e-14 * abs(made.t))
    made.replace("time", 0, near, taken.following, made.t)
    made.replace("stop", 0, done, taken.following, was["stop"])
    every = Value(body, body.intrinsic("floor", (was["accepted"] * (1 / 128)).name)) * 128.0
    goes_on = (~every.differs(was["accepted"])).choose(float(ROUND_OFF), float(GOES_ON))
    flag = (made.waits & ~acts).choose(float(STOP), (acts & ~done).choose(float(STOP), made.flag))
    flag = near.choose(float(SAMPLE), done.choose(goes_on, flag))
    body.store(flag.name, "%lanes", rows["flag"])
    body.store_bits(near.name, "%lanes", rows["due"])
    body.store_bits(flag.differs(0.0).name, "%lanes", rows["waiting"])
    return body


def _samples_taken(made: Sample) -> Taken:
    """Samples and updates of all laws, by the inputs held so far."""
    program, acts, t, p = made.program, made.acts, made.t, made.p
    updates = program.updates
    queue = [made.number(i) for i in range(3)]
    (course,) = made.was["course"]
    found = Taken(list(p), acts & (t < t), acts & (t < t), made.calendar, [], [])
    place, widest = 0, max(outputs.numel() for _, _, outputs in updates)
    for c, ((z, update, outputs), law) in enumerate(zip(updates, program.system.updates, strict=True)):
        period, delay = made.was["clocks"][2 * c], made.was["clocks"][2 * c + 1] if made.late[c] else None
        taken, applied = made.was["samples"][2 * c : 2 * c + 2]
        takes = acts & (made.instant(taken, period) <= t)
        states, first = law.memory.numel(), program.held_slot + law.first_held
        memory = made.was["memory"][place : place + states]
        noise = []
        for i in range(states, z.numel()):
            at = made.body.as_integers((taken + (course + float(place + i)) * queue[2]).name)
            noise.append(Value(made.body, made.body.gather("%noise", at, takes.name)))
        function = ca.Function("update", [*made.arguments, z], [ca.densify(ca.vertcat(update, outputs))])
        values = called(function, t, made.states, p, made.m, [*memory, *noise])
        finite = values[0] * 0.0  # 0, and nan where a value is no finite number
        for value in values[1 : len(values) - states]:  # behind these, the memory as it was
            finite += value * 0.0
        found.failed |= takes & finite.differs(0.0)
        found.memory += [(place + i, takes.choose(value, old), old) for i, (value, old) in enumerate(zip(values, memory, strict=False))]
        place += z.numel()
        more = takes.choose(taken + 1.0, taken)
        computed = values[states:]
        if delay is None:
            found.held[first : first + len(computed)] = [takes.choose(value, p[first + i]) for i, value in enumerate(computed)]
            found.changed |= takes
            after = more
        else:
            places = partial(_queue_place, made, c, widest, queue)
            for i, value in enumerate(computed):
                made.body.scatter(value.name, "%queue", places(taken, i), takes.name)
            applies = acts & (applied < more) & (made.instant(applied, period, delay) <= t)
            for i in range(len(computed)):
                come = Value(made.body, made.body.gather("%queue", places(applied, i), applies.name))
                found.held[first + i] = applies.choose(come, p[first + i])
            found.changed |= applies
            after = applies.choose(applied + 1.0, applied)
            waits = after < more
            found.following = waits.choose(smallest(made.instant(after, period, delay), found.following), found.following)
        found.following = smallest(made.instant(more, period), found.following)
        found.counts += [more, after]
    return found


def _queue_place(made: Sample, c: int, widest: int, queue: list[Value], count: Value, i: int) -> str:
    """Where output i of sample `count` of law c waits for its delay, in every lane. queue: see `queue_sizes`."""
    inverse, depth, _ = queue
    slot = count - depth * Value(made.body, made.body.intrinsic("floor", ((count + 0.5) * inverse).name))
    row = ((slot + float(c) * depth) * float(widest) + float(i)) * float(made.body.width)
    return made.body.as_integers((row + Value(made.body, _lane_numbers(made.body.width))).name)


def _refreshed(made: Sample, taken: Taken) -> Truth:
    """Store slopes and guards with what is held now; a contact that would not hold is left to the scalar loop. Returns the lanes that are done."""
    program, acts, t, m, n, ne, ng = made.program, made.acts, made.t, made.m, made.n, made.ne, made.ng
    was, new = made.was, called(made.refreshed, t, made.states, taken.held, m)
    k_new, g_new = new[:n], new[n : n + 2 * ng]
    slip, force, static = (new[n + 2 * ng + q * ne : n + 2 * ng + (q + 1) * ne] for q in range(3))
    wrong = acts & (t < t)
    for i in range(ne):
        sticks = ~m[i].differs(0.0)
        if program.kind[i] == RIGID:
            wrong |= sticks & (force[i] > 1e-9 * static[i])
        elif program.kind[i] == FRICTION:
            wrong |= sticks & ~holds(force[i], static[i], was["guard_scale"][2 * i])
            wrong |= ~sticks & (m[i] * slip[i] < 0.0)
        else:
            wrong |= g_new[2 * i] < -2e-9 * largest(largest(abs(g_new[2 * i]), was["guard_scale"][2 * i]), was["other_scale"][2 * i])
    done = acts & ~(taken.changed & wrong) & ~taken.failed  # the scalar loop says which value it is
    renewed = done & taken.changed
    for i in range(n):
        made.replace("k", i, renewed, k_new[i], was["k"][i])
    for j in range(2 * ng):
        made.replace("g", j, renewed, g_new[j], was["g"][j])
    for j in range(ng):
        size = largest(abs(g_new[j]), was["guard_scale"][j])
        made.replace("guard_scale", j, renewed, size, was["guard_scale"][j])
        made.replace("armed", j, renewed, (was["side"][j] * g_new[j] > 1e-13 * size).choose(1.0, 0.0), was["armed"][j])
    return done


def _lane_numbers(width: int) -> str:
    """0, 1, 2, ... as a vector."""
    return f"<{', '.join(f'double {float(lane):.1f}' for lane in range(width))}>"
