"""The step that a pass tries in every lane: the rows of a block, the step itself and its error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from toolbox.compilation.explicit_step import RungeKutta, stages
from toolbox.compilation.program import Program
from toolbox.compilation.vector_emitter import VectorBody
from toolbox.lanes.vectors import Rows, Truth, Value, largest, smallest
from toolbox.measuring.quintics import signals_and_bounds

SCALARS = ("time", "wanted", "stop", "error_old", "step_old", "rejected", "searching", "bracketed", "low", "high", "fraction", "tries",
           "longest", "end", "rtol", "accepted", "refused", "flag", "located", "waiting")  # fmt: skip
"""Rows of a block with one number per lane."""

PROBING, CLEARED = 1.0, 2.0
"""What the row `dip` begins with where a step goes to the minimum of a guard, and where that has shown that the guard stays positive; behind that stand the
guard, the minimum expected, and value and slope at the end of the step.
"""


class Pass:
    """A pass under construction: the functions of its program, the rows of a block, and the body that is written.

    signals, windows: as in `block`;  x, arguments: symbols of the states, and of what functions take;  count: of the rows measured;  every, lengths: of the
    items of a block, all and most;  probes: whether a step may be tried to the minimum of a guard.
    """

    def __init__(self, program: Program, width: int, signals: tuple[str, ...], windows: int):
        form, system, kernel = program.form, program.system, program.kernel
        self.program, self.signals = program, signals
        self.n, self.ne, self.ng, self.own = kernel.states, kernel.elements, kernel.guards, system.x.numel()
        n, ne, ng = self.n, self.ne, self.ng
        self.x = x = ca.vertcat(system.x, ca.SX.sym("hidden", n - self.own))
        p = program.expressions[0]
        arguments = [system.t, x, p, system.m]
        self.arguments = arguments
        self.rhs = ca.Function("rhs", arguments, [ca.densify(form.field)])
        self.field = ca.Function("field", arguments, [ca.vertcat(*map(ca.densify, (form.field, form.guards, form.guard_rates)))])
        self.projected = ca.Function("projected", arguments, [ca.densify(form.projected[: self.own])])
        watched = ca.densify(signals_and_bounds(program, signals, program.unguarded)) if windows else ca.SX(0, 1)
        self.observe = ca.Function("observe", arguments, [watched])
        self.count = self.observe.numel_out(0)
        self.rows: dict[str, int] = {}
        self.size = 0
        vectors = {"x": n, "k": n, "p": p.numel(), "m": ne, "g": 2 * ng, "side": ng, "armed": ng, "guard_scale": ng, "scale": n,
                   "group_scale": program.group_count, "noise": n, "g_low": 2 * ng, "g_high": 2 * ng, "other_scale": 2 * ne, "dip": 7,
                   "edges": 2 * windows, "measured": 3 * self.count * windows, "doubt": 1,
                   "calendar": 1, "due": 1, "samples": 2 * len(program.updates), "course": 1, "clocks": 2 * len(program.updates),
                   "memory": sum(z.numel() for z, _, _ in program.updates)}  # fmt: skip
        for name, length in [*((name, 1) for name in SCALARS), *vectors.items()]:
            self.rows[name], self.size = self.size, self.size + length
        self.every: dict[str, int | None] = {**dict.fromkeys(SCALARS), **vectors}
        seldom = (
            "measured",
            "doubt",
            "calendar",
            "due",
            "samples",
            "memory",
            "course",
            "clocks",
        )  # only of steps inside a window, and samples
        self.lengths = {name: length for name, length in self.every.items() if name not in seldom}
        self.body = VectorBody(width)
        self.probes = self.count > 0  # where nothing is measured, a step of the scalar loop costs less than what this adds to every pass

    @property
    def never(self) -> Truth:
        """False in every lane."""
        return Truth(self.body, "zeroinitializer")

    def loaded(self) -> Rows:
        """Return all rows of the block. A row is loaded when it is used."""
        return Rows(self.body, self.rows, self.lengths)

    def store(self, columns: dict[str, list[Value]]) -> None:
        """Write values to rows."""
        for name, values in columns.items():
            for i, value in enumerate(values):
                self.body.store(value.name, "%lanes", self.rows[name] + i)

    def sides(self, was: Rows) -> tuple[list[Value | None], list[Truth]]:
        """Signs of the guards, None for +1, and which of them are armed."""
        return [*[None] * (2 * self.ne), *was["side"][2 * self.ne :]], [value.differs(0.0) for value in was["armed"]]

    def windows(self, was: Rows) -> list[tuple[Value, Value]]:
        """(begin, end) of the windows that are measured."""
        return list(zip(was["edges"][::2], was["edges"][1::2], strict=True))


@dataclass(frozen=True)
class Step:
    """A step of length h from the point of every lane at t: states, slopes and guards at its end, and its error.

    wanted: the length asked for;  to_stop: whether the step ends at `stop`;  searching, probing: whether the lane searches an event or a minimum of a guard;
    cleared: whether a guard has been shown to stay positive;  unresolved: whether the step is too short to be taken;  given, slopes, ends: names of the
    arguments at the start, of the slopes of all stages, and of the states at the end.
    """

    was: Rows
    t: Value
    h: Value
    stop: Value
    wanted: Value
    to_stop: Truth
    searching: Truth
    probing: Truth
    cleared: Truth
    unresolved: Truth
    given: list[list[str]]
    slopes: list[list[str]]
    ends: list[str]
    x: list[Value]
    k: list[Value]
    g: list[Value]
    error: Value


def explicit_formulas(program: Program) -> RungeKutta:
    """The explicit formulas that the lanes step with."""
    formulas: Any = program.formulas
    return formulas


def emit_step(made: Pass) -> Step:
    """Write a step from the present point of every lane."""
    body, n = made.body, made.n
    formulas = explicit_formulas(made.program)
    was = made.loaded()
    t, searching, stop = was["time"], was["searching"].differs(0.0), was["stop"]
    probing, cleared = (~was["dip"][0].differs(value) if made.probes else made.never for value in (PROBING, CLEARED))
    wanted = smallest(was["wanted"], was["longest"])
    to_stop = (t + wanted >= stop) | (stop - (t + wanted) < 1e-3 * wanted)
    h = searching.choose(was["fraction"] * was["bracketed"], to_stop.choose(stop - t, wanted))
    h = probing.choose(was["dip"][5], h)
    unresolved = ~searching & ~probing & ~((h >= 1e-14 * abs(t)) & (h >= 1e-300))
    names = [[value.name for value in was[item]] for item in ("x", "k", "p", "m")]
    slopes, ends, end_field = stages(body, formulas, made.rhs, made.field, (t.name, h.name), names)
    x_new = [Value(body, name) for name in ends]
    end = [Value(body, name) for name in end_field]
    k_new, g_new = end[:n], end[n:]
    estimates = []
    for weights in (formulas.error, formulas.error_low):
        used = [*slopes, end_field[:n]][: len(weights)]
        estimates.append([Value(body, body.combination("", h.name, weights, [k[i] for k in used])) for i in range(n if weights else 0)])
    was = made.loaded()
    error = scaled_error(made.program, was, h, x_new, estimates)
    return Step(was, t, h, stop, wanted, to_stop, searching, probing, cleared, unresolved, names, slopes, ends, x_new, k_new, g_new, error)


def scaled_error(program: Program, was: Rows, h: Value, x_new: list[Value], estimates: list[list[Value]]) -> Value:
    """Scaled error of a step: see `toolbox.stepping.step_control.scaled_error`."""
    hidden = program.excited.size
    n = len(x_new)
    own, two = n - hidden, bool(estimates[1])
    zero = h * 0.0
    share = largest(was["rtol"] * smallest(h / was["end"], 0.1), (was["rtol"] > 1e-14).choose(1e-14, 2e-15))
    sums = [zero, zero]
    for i in range(own):
        size = largest(largest(was["scale"][i], abs(x_new[i])), largest(1e-10 * was["group_scale"][int(program.groups[i])], 1e-14))
        tolerance = 1.0 / (share * size + was["noise"][i] * h)
        for which in range(1 + two):
            ratio = estimates[which][i] * tolerance
            sums[which] = sums[which] + ratio * ratio
    if two:
        bottom = sums[0] + 0.01 * sums[1]
        error = bottom.differs(0.0).choose(sums[0] / (bottom * float(own)).root(), 0.0)
    else:
        error = (sums[0] * (1.0 / max(own, 1))).root()
    for q, element in enumerate(program.excited.tolist()):
        bound = was["m"][element].differs(0.0).choose(was["other_scale"][2 * element], was["guard_scale"][2 * element])
        size = largest(largest(bound, 1e-3 * was["end"] * abs(was["k"][own + q])), 1e-300)
        missed = abs(estimates[1 if two else 0][own + q]) / ((0.02 if two else 3e-4) * size)
        error = (missed > error).choose(missed, error)
    return error
