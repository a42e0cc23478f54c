"""Event handling in lanes: mode changes and projection, as in `toolbox.stepping.event_stepper`, for all lanes of a block that stopped at a guard."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from toolbox.compilation.program import Program
from toolbox.compilation.vector_emitter import VectorBody
from toolbox.compilation.work_layout import RIGID, SECOND, SWITCH
from toolbox.lanes.layout import EVENT
from toolbox.lanes.trial_step import Pass, explicit_formulas
from toolbox.lanes.vectors import Rows, Truth, Value, called, largest, smallest
from toolbox.stepping.holding import holds


def carries_events(program: Program) -> bool:
    """Whether events are settled in the block: without rigid contacts, and without friction that can lose its load."""
    return program.kernel.elements > 0 and bool((program.kind != RIGID).all() and np.isin(program.loader, (-1, SECOND)).all())


class Event(Pass):
    """The settling of an event under construction, beside a pass, and where the lanes stand.

    was: the rows of the block;  t, m, end: time, modes before the event and duration;  zero: in every lane.
    """

    def __init__(self, made: Pass) -> None:
        vars(self).update(vars(made), body=VectorBody(made.body.width))
        form = self.program.form
        self.probe = ca.Function("probe", self.arguments, [form.probed[form.slip.numel() :]])  # all but the slips
        self.burden = ca.Function("burden", self.arguments, [ca.densify(form.burden)])
        self.was = was = self.loaded()
        self.t, self.m, self.end, self.zero = was["time"], was["m"][:], was["end"], was["time"] * 0.0


@dataclass(frozen=True)
class Firing:
    """What fires at an event.

    unbroken: no bound is at zero;  side: signs of the guards after it;  caught: modes with what arrives at rest;  modes: to begin the search of consistent
    ones with;  zeros, forced: elements without slip, and those that their guard sets in motion (None for switches).
    """

    unbroken: Truth
    side: list[Value]
    caught: list[Value]
    modes: list[Value]
    zeros: list[Truth | None]
    forced: list[Truth | None]


@dataclass(frozen=True)
class Renewed:
    """Slopes, guards and sizes after an event. settled: lanes without a switch beyond its threshold."""

    k: list[Value]
    g: list[Value]
    scale: list[Value]
    group_scale: list[Value]
    guard_scale: list[Value]
    other_scale: list[Value]
    armed: list[Value]
    settled: Truth


def settling(other: Pass) -> VectorBody:
    """Write the event handling of `toolbox.stepping.event_stepper` for the lanes at an event: modes by force, slopes, guards, round-off,
    first step.

    A lane whose modes need more than one correction keeps its flag.
    """
    made = Event(other)
    firing = _fired(made)
    x = called(made.projected, made.t, made.was["x"], made.was["p"], firing.caught) + made.was["x"][made.own :]
    chosen, settled = _modes_by_force(made, firing, x)
    was = made.loaded()
    renewed = _renewed(made, was, firing, x, chosen, settled)
    noise = _round_off(made, was, x, chosen, renewed)
    series = made.program.formulas.series  # the next step follows from its own coefficients
    columns = {"x": x, "k": renewed.k, "m": chosen, "g": renewed.g, "side": firing.side, "armed": renewed.armed, "guard_scale": renewed.guard_scale,
               "other_scale": renewed.other_scale, "scale": renewed.scale, "group_scale": renewed.group_scale, "noise": noise}  # fmt: skip
    was = made.loaded()
    made.store({name: [renewed.settled.choose(value, was[name][i]) for i, value in enumerate(column)] for name, column in columns.items()})
    numbers = {"flag": made.zero} if series else {"wanted": _first_step(made, x, chosen, renewed), "step_old": made.zero, "flag": made.zero}
    made.store({name: [renewed.settled.choose(value, was[name])] for name, value in numbers.items()})
    return made.body


def _fired(made: Event) -> Firing:
    """What fires, and the modes that it leads to before any force is looked at."""
    program, was, m, ne, ng = made.program, made.was, made.m, made.ne, made.ng
    fired = []
    for j in range(ng):
        rate, value = was["side"][j] * was["g"][ng + j], was["side"][j] * was["g"][j]
        descends = rate <= 0.0 if j < 2 * ne else rate < 0.0
        fired.append((descends & (value <= 1e-9 * was["guard_scale"][j])) | ~was["located"].differs(float(j)))
    unbroken = made.zero <= 0.0
    for j in range(ng - len(program.bounded), ng):  # a bound at zero is left to the scalar loop
        unbroken &= ~fired[j]
    side = [*was["side"][: 2 * ne], *(fired[j].choose(-was["side"][j], was["side"][j]) for j in range(2 * ne, ng))]
    found = Firing(unbroken, side, [], [], [], [])
    for i in range(ne):
        sticks = ~m[i].differs(0.0)
        if program.kind[i] == SWITCH:
            found.caught.append(m[i])
            found.modes.append(fired[2 * i].choose(1.0 - m[i], m[i]))
            found.zeros.append(None)
            found.forced.append(None)
            continue
        found.caught.append(fired[2 * i].choose(0.0, m[i]))
        only_first, only_second = sticks & fired[2 * i] & ~fired[2 * i + 1], sticks & fired[2 * i + 1] & ~fired[2 * i]
        found.modes.append(only_first.choose(-1.0, only_second.choose(1.0, found.caught[i])))
        found.zeros.append(sticks | fired[2 * i])
        found.forced.append(only_first | only_second)
    return found


def _inconsistent(made: Event, zeros: list[Truth | None], modes: list[Value], found: list[Value]) -> list[Truth | None]:
    """Which elements without slip are in a mode that their forces contradict; None for switches. found: what `probe` gives."""
    was, m, ne = made.was, made.m, made.ne
    wrong: list[Truth | None] = []
    for i, still in enumerate(zeros):
        if still is None:
            wrong.append(None)
            continue
        rate, force, static, pace = found[i], found[ne + i], found[2 * ne + i], found[3 * ne + i]
        sticks = ~modes[i].differs(0.0)
        stick_scale = m[i].differs(0.0).choose(was["other_scale"][2 * i], was["guard_scale"][2 * i])
        held = sticks & holds(force, static, stick_scale)
        slides = ~sticks & (modes[i] * rate >= -1e-7 * abs(pace))
        wrong.append(still & ~(held | slides))
    return wrong


def _modes_by_force(made: Event, firing: Firing, x: list[Value]) -> tuple[list[Value], Truth]:
    """Modes by force, all consistent at once, or one that cannot stick slides; and the lanes in which that settles it."""
    ne, p = made.ne, made.was["p"]
    first = called(made.probe, made.t, x, p, firing.modes)
    wrong, count, sound = _inconsistent(made, firing.zeros, firing.modes, first), made.zero, firing.unbroken
    chosen, arrives = list(firing.modes), made.zero > 0.0
    for i, still in enumerate(firing.zeros):
        if still is not None and made.program.kernel.coupled:
            arrives |= still & made.m[i].differs(0.0)
    for i, (bad, forced) in enumerate(zip(wrong, firing.forced, strict=True)):
        if bad is not None and forced is not None:
            count = count + bad.choose(1.0, 0.0)
            sound &= ~(
                bad & (forced | (arrives & ~made.m[i].differs(0.0)))
            )  # what was stuck stays so if it can, which the scalar loop finds out
            chosen[i] = bad.choose((first[ne + i] > 0.0).choose(-1.0, 1.0), firing.modes[i])
    again = _inconsistent(made, firing.zeros, chosen, called(made.probe, made.t, x, p, chosen))
    for bad in again:
        if bad is not None:
            sound &= ~bad
    return chosen, ~made.was["flag"].differs(float(EVENT)) & sound & (count <= 1.0)


def _renewed(made: Event, was: Rows, firing: Firing, x: list[Value], chosen: list[Value], settled: Truth) -> Renewed:
    """Slopes, guards and sizes in the new modes."""
    program, m, n, ne, side, zeros = made.program, made.m, made.n, made.ne, firing.side, firing.zeros
    values = called(made.field, made.t, x, was["p"], chosen)
    k, g = values[:n], values[n:]
    scale = [largest(abs(a), b) for a, b in zip(x, was["scale"], strict=True)]
    group_scale = list(was["group_scale"])
    for i, group in enumerate(program.groups.tolist()):
        group_scale[group] = largest(scale[i], group_scale[group])
    guard_scale, other_scale, armed = [], [], []
    for j in range(made.ng):
        size = was["guard_scale"][j]
        if j < 2 * ne:
            changed = (m[j // 2].differs(0.0) & ~chosen[j // 2].differs(0.0)) | (~m[j // 2].differs(0.0) & chosen[j // 2].differs(0.0))
            other_scale.append(changed.choose(size, was["other_scale"][j]))
            size = changed.choose(was["other_scale"][j], size)
        guard_scale.append(largest(abs(g[j]), size))
        away = side[j] * g[j] > 1e-13 * guard_scale[j]
        still = zeros[j // 2] if j < 2 * ne and j % 2 == 0 else None
        if still is not None:  # let go, it has no slip yet but round-off
            away &= ~(still & chosen[j // 2].differs(0.0))
        armed.append(away.choose(1.0, 0.0))
    for i in range(ne):  # a switch that a new mode throws past its threshold is left to the scalar loop
        if program.kind[i] == SWITCH:
            settled &= ~(g[2 * i] < -2e-9 * largest(guard_scale[2 * i], other_scale[2 * i]))
    return Renewed(k, g, scale, group_scale, guard_scale, other_scale, armed, settled)


def _round_off(made: Event, was: Rows, x: list[Value], chosen: list[Value], renewed: Renewed) -> list[Value]:
    """Round-off of the slopes: see `toolbox.stepping.step_control.measure_round_off`."""
    t, n = made.t, made.n
    nudged = [value * (1.0 + 1e-7 * (1.0 - 0.3 * (i % 5))) for i, value in enumerate(x)]
    nudged_p = [value * (1.0 + 1e-7 * (0.9 - 0.37 * (i % 7))) for i, value in enumerate(was["p"])]
    moved = called(made.field, t * (1.0 + 1e-7), nudged, nudged_p, chosen)[:n]
    cancelled = called(made.burden, t, x, was["p"], chosen) + [made.zero] * (n - made.program.form.burden.numel())
    return [(1e7 * abs(a - b) + c) * (32.0 * 2.220446049250313e-16) for a, b, c in zip(moved, renewed.k, cancelled, strict=True)]


def _first_step(made: Event, x: list[Value], chosen: list[Value], renewed: Renewed) -> Value:
    """A first step by Hairer's rule."""
    body, n, t, end, k = made.body, made.n, made.t, made.end, renewed.k
    was = made.loaded()
    d0, d1, d2 = made.zero, made.zero, made.zero
    weights = []
    for i in range(n):
        rtol = was["rtol"]
        size = largest(largest(renewed.scale[i], 1e-10 * renewed.group_scale[int(made.program.groups[i])]), 1e-14)
        weights.append(1.0 / (rtol * size))
        a, b = x[i] * weights[i], k[i] * weights[i]
        d0, d1 = d0 + a * a, d1 + b * b
    h0 = ((d0 < 1e-10) | (d1 < 1e-10)).choose(1e-6, 0.01 * (d0 / d1).root())
    h0 = smallest(h0, end - t)
    ahead = called(made.rhs, t + h0, [a + h0 * b for a, b in zip(x, k, strict=True)], was["p"], chosen)
    for i in range(n):
        a = (ahead[i] - k[i]) * weights[i]
        d2 = d2 + a * a
    top = largest((d1 * (1 / n)).root(), (h0 > 0.0).choose((d2 * (1 / n)).root() / h0, 0.0))
    order = explicit_formulas(made.program).order
    h1 = Value(body, body.rough_exp2((Value(body, body.rough_log2((0.01 / largest(top, 1e-15)).name)) * (1 / order)).name))
    h1 = (top > 1e-15).choose(h1, largest(h0 * 1e-3, 1e-6))
    h = largest(smallest(100.0 * h0, h1), 1e-9 * end)
    return ((h > 0.0) & (h < np.inf)).choose(h, 1e-9)
