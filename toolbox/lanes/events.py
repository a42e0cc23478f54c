"""Events settled in lanes: what `toolbox.simulation.event_loop` does where a guard is zero, for all lanes of a block that wait at one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import casadi as ca
import numpy as np

from toolbox.compilation.emitter import inline
from toolbox.compilation.loop_layout import RIGID, SWITCH
from toolbox.compilation.program import Program
from toolbox.compilation.runge_kutta import Pair
from toolbox.compilation.vector_emitter import VectorBody
from toolbox.lanes.loop import EVENT
from toolbox.lanes.vectors import Rows, Value, largest, smallest


def carries_events(program: Program) -> bool:
    """Whether events are settled in the block: without rigid contacts, and without friction that can lose its load."""
    return program.machine.elements > 0 and bool((program.kind != RIGID).all() and (program.loader < 0).all())


def settling(
    program: Program, width: int, rows: dict[str, int], lengths: dict[str, int | None], functions: tuple[ca.Function, ...]
) -> VectorBody:
    """What `toolbox.simulation.event_loop` does at an event, for the lanes that have stepped to one: modes by force, slopes, guards, round-off, first step.

    A lane whose modes need more than one correction keeps its flag.
    """
    rhs, field, projected = functions
    form, system, pair = program.form, program.system, program.pair
    assert isinstance(pair, Pair)
    n, ne, ng, own = program.machine.states, program.machine.elements, program.machine.guards, system.x.numel()
    arguments = [system.t, ca.vertcat(system.x, ca.SX.sym("hidden", n - own)), program.expressions[0], system.m]
    pace = ca.diag(form.gain) * form.static
    probe = ca.Function("probe", arguments, [ca.vertcat(*map(ca.densify, (form.slip_rate, form.force, form.static, pace)))])
    burden = ca.Function("burden", arguments, [ca.densify(form.burden)])

    body = VectorBody(width)
    was = Rows(body, rows, lengths)
    t, m, end, zero = was["time"], was["m"][:], was["end"], was["time"] * 0.0

    def call(function: ca.Function, now: Value, x: Iterable[Value], p: Iterable[Value], modes: list[Value]) -> list[Value]:
        values = [[now.name], *([value.name for value in column] for column in (x, p, modes))]
        return [Value(body, name) for name in inline(body, function, values)[0]]

    # --- what fires
    fired = []
    for j in range(ng):
        rate, value = was["side"][j] * was["g"][ng + j], was["side"][j] * was["g"][j]
        descends = rate <= 0.0 if j < 2 * ne else rate < 0.0
        fired.append((descends & (value <= 1e-9 * was["guard_scale"][j])) | ~was["located"].differs(float(j)))
    unbroken = zero <= 0.0
    for j in range(ng - len(program.bounded), ng):  # a bound at zero is left to the scalar loop
        unbroken &= ~fired[j]
    side = [*was["side"][: 2 * ne], *(fired[j].choose(-was["side"][j], was["side"][j]) for j in range(2 * ne, ng))]
    caught, modes = [], []
    zeros: list[Any] = []
    forced: list[Any] = []
    for i in range(ne):
        sticks = ~m[i].differs(0.0)
        if program.kind[i] == SWITCH:
            caught.append(m[i])
            modes.append(fired[2 * i].choose(1.0 - m[i], m[i]))
            zeros.append(None)
            forced.append(None)
            continue
        caught.append(fired[2 * i].choose(0.0, m[i]))
        only_first, only_second = sticks & fired[2 * i] & ~fired[2 * i + 1], sticks & fired[2 * i + 1] & ~fired[2 * i]
        modes.append(only_first.choose(-1.0, only_second.choose(1.0, caught[i])))
        zeros.append(sticks | fired[2 * i])
        forced.append(only_first | only_second)
    x = call(projected, t, was["x"], was["p"], caught) + was["x"][own:]

    # --- modes by force: all consistent at once, or one that cannot stick slides
    def inconsistent(modes: list[Value], found: list[Value]) -> list[Any]:
        wrong: list[Any] = []
        for i in range(ne):
            if zeros[i] is None:
                wrong.append(None)
                continue
            rate, force, static, pace = found[i], found[ne + i], found[2 * ne + i], found[3 * ne + i]
            sticks = ~modes[i].differs(0.0)
            stick_scale = m[i].differs(0.0).choose(was["other_scale"][2 * i], was["guard_scale"][2 * i])
            holds = sticks & (abs(force) <= static * (1.0 + 1e-9) + 1e-12 * stick_scale)
            slides = ~sticks & (modes[i] * rate >= -1e-7 * abs(pace))
            wrong.append(zeros[i] & ~(holds | slides))
        return wrong

    first = call(probe, t, x, was["p"], modes)
    wrong, count, sound = inconsistent(modes, first), zero, unbroken
    chosen = list(modes)
    for i in range(ne):
        if wrong[i] is not None:
            count = count + wrong[i].choose(1.0, 0.0)
            sound &= ~(wrong[i] & forced[i])
            chosen[i] = wrong[i].choose((first[ne + i] > 0.0).choose(-1.0, 1.0), modes[i])
    again = inconsistent(chosen, call(probe, t, x, was["p"], chosen))
    for i in range(ne):
        if again[i] is not None:
            sound &= ~again[i]
    settled = ~was["flag"].differs(float(EVENT)) & sound & (count <= 1.0)

    # --- slopes, guards, sizes and round-off there
    was = Rows(body, rows, lengths)
    values = call(field, t, x, was["p"], chosen)
    k, g = values[:n], values[n:]
    scale = [largest(abs(a), b) for a, b in zip(x, was["scale"], strict=True)]
    group_scale = list(was["group_scale"])
    for i, group in enumerate(program.groups.tolist()):
        group_scale[group] = largest(scale[i], group_scale[group])
    guard_scale, other_scale, armed = [], [], []
    for j in range(ng):
        size = was["guard_scale"][j]
        if j < 2 * ne:
            changed = (m[j // 2].differs(0.0) & ~chosen[j // 2].differs(0.0)) | (~m[j // 2].differs(0.0) & chosen[j // 2].differs(0.0))
            other_scale.append(changed.choose(size, was["other_scale"][j]))
            size = changed.choose(was["other_scale"][j], size)
        guard_scale.append(largest(abs(g[j]), size))
        armed.append((side[j] * g[j] > 1e-13 * guard_scale[j]).choose(1.0, 0.0))
    for i in range(ne):  # a switch that a new mode throws past its threshold is left to the scalar loop
        if program.kind[i] == SWITCH:
            settled &= ~(g[2 * i] < -2e-9 * largest(guard_scale[2 * i], other_scale[2 * i]))
    nudged = [value * (1.0 + 1e-7 * (1.0 - 0.3 * (i % 5))) for i, value in enumerate(x)]
    nudged_p = [value * (1.0 + 1e-7 * (0.9 - 0.37 * (i % 7))) for i, value in enumerate(was["p"])]
    moved = call(field, t * (1.0 + 1e-7), nudged, nudged_p, chosen)[:n]
    cancelled = call(burden, t, x, was["p"], chosen) + [zero] * (n - form.burden.numel())
    noise = [(1e7 * abs(a - b) + c) * (32.0 * 2.220446049250313e-16) for a, b, c in zip(moved, k, cancelled, strict=True)]

    # --- a first step by Hairer's rule
    was = Rows(body, rows, lengths)

    def root(value: Value) -> Value:
        return Value(body, body.intrinsic("sqrt", value.name))

    d0, d1, d2 = zero, zero, zero
    weights = []
    for i in range(n):
        weights.append(1.0 / (was["rtol"] * largest(largest(scale[i], 1e-10 * group_scale[int(program.groups[i])]), 1e-14)))
        a, b = x[i] * weights[i], k[i] * weights[i]
        d0, d1 = d0 + a * a, d1 + b * b
    h0 = ((d0 < 1e-10) | (d1 < 1e-10)).choose(1e-6, 0.01 * root(d0 / d1))
    h0 = smallest(h0, end - t)
    ahead = call(rhs, t + h0, [a + h0 * b for a, b in zip(x, k, strict=True)], was["p"], chosen)
    for i in range(n):
        a = (ahead[i] - k[i]) * weights[i]
        d2 = d2 + a * a
    top = largest(root(d1 * (1 / n)), (h0 > 0.0).choose(root(d2 * (1 / n)) / h0, 0.0))
    h1 = Value(body, body.rough_exp2((Value(body, body.rough_log2((0.01 / largest(top, 1e-15)).name)) * (1 / pair.order)).name))
    h1 = (top > 1e-15).choose(h1, largest(h0 * 1e-3, 1e-6))
    h = largest(smallest(100.0 * h0, h1), 1e-9 * end)
    h = ((h > 0.0) & (h < np.inf)).choose(h, 1e-9)

    results = {"x": x, "k": k, "m": chosen, "g": g, "side": side, "armed": armed, "guard_scale": guard_scale, "other_scale": other_scale,
               "scale": scale, "group_scale": group_scale, "noise": noise}  # fmt: skip
    was = Rows(body, rows, lengths)
    for name, column in results.items():
        for i, value in enumerate(column):
            body.store(settled.choose(value, was[name][i]).name, "%lanes", rows[name] + i)
    for name, value in (("wanted", h), ("step_old", zero), ("flag", zero)):
        body.store(settled.choose(value, was[name]).name, "%lanes", rows[name])
    return body
