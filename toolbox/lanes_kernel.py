"""One pass of a block of lanes as machine code: every lane tries one step of its own, of its own length, and judges it by itself.

A lane steps on, or searches an event inside a step whose end it has seen; either way a pass is one step from where the lane stands, so that lanes that
search and lanes that step on share the same instructions. The pass does what `toolbox.loop` does between events, in the same order: error,
guards, acceptance, step size. It flags what it leaves to the loop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from toolbox.emit import compiled, inline
from toolbox.emit import function_text as scalar_text
from toolbox.emit_vector import VectorBody, function_text
from toolbox.errors import SceneError
from toolbox.kernel import plain_body, stages
from toolbox.loop import RIGID, SWITCH
from toolbox.program import Program
from toolbox.runge_kutta import DOP853, DOP853_DENSE, DOP853_MORE_A, DOP853_MORE_C, Pair

GOES_ON, EVENT, ALONE, ROUND_OFF, STOP = range(5)
"""Why a lane waits: an event has been stepped to; a step for the scalar loop; round-off to be measured again; an instant of the run's calendar."""

SCALARS = ("time", "wanted", "stop", "error_old", "step_old", "rejected", "searching", "whole", "low", "high", "fraction", "tries",
           "longest", "end", "rtol", "accepted", "refused", "flag", "located", "waiting")  # fmt: skip
"""Rows of a block with one number per lane."""

POINTS, WEIGHTS = (0.5 * (column + shift) for column, shift in zip(np.polynomial.legendre.leggauss(5), (1.0, 0.0), strict=True))
PLACES = (0.0, *POINTS.tolist(), 1.0)
"""Fractions of a step at which signals are measured: Gauss points and both ends."""

MOST_TRIES = 30
"""Steps of a search after which the scalar loop takes over."""


@dataclass(frozen=True)
class Block:
    """A compiled pass, the settling of events and the signals measured (0 where there are none), for blocks of shape (size, width).

    rows: the first row of every item.
    """

    address: int
    settle: int
    observe: int
    width: int
    rows: dict[str, int]
    size: int


class Value:
    """A vector of doubles under construction, with the operators of arithmetic."""

    def __init__(self, body: VectorBody, name: str) -> None:
        self.body, self.name = body, name

    def _of(self, other: Any) -> str:
        return other.name if isinstance(other, Value) else self.body.number(other)

    def __add__(self, other: Any) -> Value:
        return Value(self.body, self.body.add(self.name, self._of(other)))

    def __sub__(self, other: Any) -> Value:
        return Value(self.body, self.body.sub(self.name, self._of(other)))

    def __rsub__(self, other: Any) -> Value:
        return Value(self.body, self.body.sub(self._of(other), self.name))

    def __mul__(self, other: Any) -> Value:
        return Value(self.body, self.body.mul(self.name, self._of(other)))

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, other: Any) -> Value:
        return Value(self.body, self.body.div(self.name, self._of(other)))

    def __rtruediv__(self, other: Any) -> Value:
        return Value(self.body, self.body.div(self._of(other), self.name))

    def __neg__(self) -> Value:
        return Value(self.body, self.body.value(f"fneg {self.body.type} {self.name}"))

    def __abs__(self) -> Value:
        return Value(self.body, self.body.intrinsic("fabs", self.name))

    def _compare(self, how: str, other: Any) -> Truth:
        return Truth(self.body, self.body.compare(how, self.name, self._of(other)))

    def __lt__(self, other: Any) -> Truth:
        return self._compare("olt", other)

    def __le__(self, other: Any) -> Truth:
        return self._compare("ole", other)

    def __gt__(self, other: Any) -> Truth:
        return self._compare("ogt", other)

    def __ge__(self, other: Any) -> Truth:
        return self._compare("oge", other)

    def differs(self, other: Any) -> Truth:
        return self._compare("une", other)


class Truth:
    """A vector of truth values under construction."""

    def __init__(self, body: VectorBody, name: str) -> None:
        self.body, self.name = body, name

    def __and__(self, other: Truth) -> Truth:
        return Truth(self.body, self.body.both(self.name, other.name))

    def __or__(self, other: Truth) -> Truth:
        return Truth(self.body, self.body.either(self.name, other.name))

    def __invert__(self) -> Truth:
        ones = f"<{', '.join(['i1 true'] * self.body.width)}>"
        return Truth(self.body, self.body.value(f"xor {self.body.truths} {self.name}, {ones}"))

    def choose(self, yes: Any, no: Any) -> Value:
        """`yes` in the lanes where it is true, `no` elsewhere."""
        names = [v.name if isinstance(v, Value) else self.body.number(v) for v in (yes, no)]
        return Value(self.body, self.body.select(self.name, *names))


def largest(a: Value, b: Any) -> Value:
    """The larger of two vectors; `b` where one is NaN."""
    return (a > b).choose(a, b)


def smallest(a: Value, b: Any) -> Value:
    """The smaller of two vectors; `b` where one is NaN."""
    return (a < b).choose(a, b)


def block(program: Program, width: int, signals: tuple[str, ...] = ()) -> Block:
    """The pass of a program whose pair is explicit, for blocks of `width` lanes that measure `signals`; kept with the program's structure.

    Signals are measured on the dense output of DOP853. Raises SceneError for an unknown or vector signal.
    """
    key = ("lanes", id(program), width, signals)
    found = program.system.kernels.get(key)
    if found is None:
        found = program.system.kernels[key] = _compiled(program, width, signals)
    return found


def _compiled(program: Program, width: int, signals: tuple[str, ...]) -> Block:
    pair, form, system = program.pair, program.form, program.system
    assert isinstance(pair, Pair)
    n, ne, ng = program.machine.states, program.machine.elements, program.machine.guards
    own = system.x.numel()
    x = ca.vertcat(system.x, ca.SX.sym("hidden", n - own))
    p = program.expressions[0]
    arguments = [system.t, x, p, system.m]
    rhs = ca.Function("rhs", arguments, [ca.densify(form.field)])
    field = ca.Function("field", arguments, [ca.vertcat(*map(ca.densify, (form.field, form.guards, form.guard_rates)))])
    projected = ca.Function("projected", arguments, [ca.densify(form.projected[:own])])

    observe = _observed(program, signals, arguments)
    groups = program.group_count
    rows: dict[str, int] = {}
    size = 0
    vectors = {"x": n, "k": n, "p": p.numel(), "m": ne, "g": 2 * ng, "side": ng, "armed": ng, "guard_scale": ng, "scale": n, "group_scale": groups,
               "noise": n, "g_low": 2 * ng, "g_high": 2 * ng, "other_scale": 2 * ne,
               "after": 1, "measured": 3 * len(signals)}  # fmt: skip
    for name, count in [*((name, 1) for name in SCALARS), *vectors.items()]:
        rows[name], size = size, size + count

    body = VectorBody(width)
    old = {name: Value(body, body.load("%lanes", rows[name])) for name in SCALARS[:-1]}
    state = {name: [Value(body, body.load("%lanes", rows[name] + i)) for i in range(count)] for name, count in vectors.items()}
    new: dict[str, Value] = {}
    more: dict[str, list[Value]] = {}

    # --- one step from where the lane stands
    t, searching, stop = old["time"], old["searching"].differs(0.0), old["stop"]
    wanted = smallest(old["wanted"], old["longest"])
    to_stop = (t + wanted >= stop) | (stop - (t + wanted) < 1e-3 * wanted)
    h = searching.choose(old["fraction"] * old["whole"], to_stop.choose(stop - t, wanted))
    unresolved = ~searching & ~((h >= 1e-14 * abs(t)) & (h >= 1e-300))
    names = [[value.name for value in state[item]] for item in ("x", "k", "p", "m")]
    slopes, ends, end_field = stages(body, pair, rhs, field, (t.name, h.name), names)
    x_new = [Value(body, name) for name in ends]
    end = [Value(body, name) for name in end_field]
    k_new, g_new = end[:n], end[n:]
    estimates = []
    for weights in (pair.error, pair.error_low):
        used = [*slopes, end_field[:n]][: len(weights)]
        estimates.append([Value(body, body.combination("", h.name, weights, [k[i] for k in used])) for i in range(n if weights else 0)])
    error = _error(program, old, state, h, x_new, estimates)

    # --- guards over the step
    side = [*[None] * (2 * ne), *state["side"][2 * ne :]]

    def signed(values: list[Value], j: int) -> Value:
        sign = side[j % ng]
        return values[j] if sign is None else sign * values[j]

    runs = ~old["flag"].differs(float(GOES_ON))
    nothing = h < -1.0
    hit, odd, near, below, maybe = nothing, nothing, nothing, nothing, nothing
    dips: list[tuple[Truth, Value, Value, Value, Value]] = []
    located = h * 0.0
    armed = [value.differs(0.0) for value in state["armed"]]
    for j in reversed(range(ng)):
        a, da, b, db = signed(state["g"], j), signed(state["g"], ng + j), signed(g_new, j), signed(g_new, ng + j)
        guard_scale = state["guard_scale"][j]
        close = smallest(largest(1e-5 * old["rtol"], 1e-13), 1e-9) * guard_scale
        wrong = ~armed[j] & (b < -1e-12 * guard_scale)
        hit |= armed[j] & (b <= 0.0)
        odd |= wrong
        # only where a control point of the cubic lies low can its minimum lie low
        turns = runs & armed[j] & (b > 0.0) & (da < 0.0) & (db > 0.0)
        turns &= (smallest(a + da * h * (1 / 3), b - db * h * (1 / 3)) <= 0.5 * largest(a, b)) & (error <= 1.0)
        maybe |= turns
        dips.append((turns, a, da, b, db))
        if j < 2 * ne and system.elements[j // 2].unilateral:  # how deep an impact is located decides which bounce is the last
            odd |= armed[j] & (b <= 0.0)
        this = armed[j] & (abs(b) <= close) & (db < 0.0)
        near |= this
        below |= wrong | (armed[j] & (b < 0.0) & ~this)
        located = this.choose(float(j), located)

    # a guard may dip below zero inside a step, or before an event that cuts a step short
    fresh, searching = runs & ~searching, runs & searching
    event = searching & near & ~below

    def low_dips() -> Truth:
        found = nothing
        for turns, a, da, b, db in dips:
            found |= turns & (_lowest(a, da * h, b, db * h) <= 0.5 * largest(a, b))
        return found & (fresh | event)

    dipped = _where_any(maybe & (fresh | event), low_dips)
    seen = error < 1e4
    hit, odd = fresh & seen & hit, (fresh & ((seen & odd) | unresolved)) | dipped
    event &= ~dipped
    begins = hit & ~odd
    goes_on = searching & ~event & ~dipped
    good = error <= 1.0
    steps = fresh & ~hit & ~odd
    accepted, arrives = steps & good, event & good
    moves = accepted | arrives
    refused = (steps | event) & ~good

    # --- the bracket of the search, and where to look next
    low = begins.choose(0.0, (goes_on & ~below).choose(old["fraction"], old["low"]))
    high = begins.choose(1.0, (goes_on & below).choose(old["fraction"], old["high"]))
    whole = begins.choose(h, old["whole"])
    more["g_low"] = [begins.choose(g, (goes_on & ~below).choose(e, o)) for g, e, o in zip(state["g"], g_new, state["g_low"], strict=True)]
    more["g_high"] = [(begins | (goes_on & below)).choose(e, o) for e, o in zip(g_new, state["g_high"], strict=True)]
    part = h * 0.0 + 2.0
    for j in range(ng):
        a, b, da, db = (signed(more[item], i) for i in (j, ng + j) for item in ("g_low", "g_high"))
        place = _crossing(a, b, da, db, (high - low) * whole)
        part = (armed[j] & (signed(more["g_high"], j) <= 0.0)).choose(smallest(place, part), part)
    tries = begins.choose(0.0, old["tries"] + 1.0)
    lost = (begins | goes_on) & ((tries > float(MOST_TRIES)) | (part > 1.5))
    part = (tries > 8.0).choose(0.5, part)
    inside = low + part * (high - low)
    inside = ((inside > low) & (inside <= high)).choose(inside, 0.5 * (low + high))
    continues = (begins | goes_on) & ~lost

    # --- acceptance and the next step size
    power = float(pair.power)
    logarithm = Value(body, body.rough_log2(largest(error, 1e-10).name))
    prediction = Value(body, body.rough_log2((h / old["step_old"]).name)) + power * (old["error_old"] - logarithm)
    growth = -power * logarithm
    growth = growth + (old["step_old"] > 0.0).choose(smallest(prediction, 0.0), 0.0)
    exponent = smallest(largest(accepted.choose(growth, -power * logarithm), -900.0), 900.0)
    factor = Value(body, body.rough_exp2(exponent.name))
    rejected = old["rejected"].differs(0.0)
    grown = h * smallest(largest(0.85 * factor, 0.2), rejected.choose(1.0, 10.0))
    grown = (h < wanted).choose(largest(grown, wanted), grown)
    shrunk = h * (error < 1e30).choose(largest(0.9 * factor, 0.1), 0.1)
    new["wanted"] = accepted.choose(grown, refused.choose(shrunk, old["wanted"]))
    new["error_old"] = accepted.choose(largest(logarithm, -13.3), old["error_old"])
    new["step_old"] = accepted.choose(h, old["step_old"])
    new["rejected"] = refused.choose(1.0, moves.choose(0.0, old["rejected"]))
    new["searching"] = continues.choose(1.0, 0.0)
    new |= {
        "whole": whole,
        "low": low,
        "high": high,
        "fraction": inside,
        "tries": tries,
        "located": arrives.choose(located, old["located"]),
    }
    count = old["accepted"] + moves.choose(1.0, 0.0)
    new["accepted"] = count
    new["refused"] = old["refused"] + refused.choose(1.0, 0.0)
    t_new = to_stop.choose(accepted.choose(stop, t + h), t + h)
    new["time"] = moves.choose(t_new, t)
    straight = inline(body, projected, [[t_new.name], ends, names[2], names[3]])[0] if ne else ends[:own]
    final = [accepted.choose(Value(body, straight[i]), x_new[i]) if i < own else x_new[i] for i in range(n)]
    more["x"] = [moves.choose(value, o) for value, o in zip(final, state["x"], strict=True)]
    more["k"] = [moves.choose(value, o) for value, o in zip(k_new, state["k"], strict=True)]
    more["g"] = [moves.choose(value, o) for value, o in zip(g_new, state["g"], strict=True)]
    more["scale"] = [(moves & (abs(value) > o)).choose(abs(value), o) for value, o in zip(x_new, state["scale"], strict=True)]
    more["group_scale"] = list(state["group_scale"])
    for i, group in enumerate(program.groups.tolist()):
        more["group_scale"][group] = largest(more["scale"][i], more["group_scale"][group])
    more["guard_scale"] = [(moves & (abs(g_new[j]) > o)).choose(abs(g_new[j]), o) for j, o in enumerate(state["guard_scale"])]
    more["armed"] = [(armed[j] | (moves & (signed(g_new, j) > 1e-13 * more["guard_scale"][j]))).choose(1.0, 0.0) for j in range(ng)]

    if signals:
        counts = moves & (t >= state["after"][0])
        path = _Path(pair, rhs, t, h, state, slopes, x_new, k_new)
        more["measured"] = []
        for q in range(len(signals)):
            signal = path.signal(observe, q)
            before = state["measured"][3 * q : 3 * q + 3]
            more["measured"] += [counts.choose(value, o) for value, o in zip(_measured(signal, h, before), before, strict=True)]

    # --- what the pass leaves to the loop
    every = Value(body, body.intrinsic("floor", (count * (1 / 128)).name)) * 128.0
    stale = (refused & rejected) | (moves & ~every.differs(count))
    flag = stale.choose(float(ROUND_OFF), old["flag"])
    flag = (accepted & to_stop).choose(float(STOP), flag)
    flag = arrives.choose(float(EVENT), flag)
    flag = (odd | lost).choose(float(ALONE), flag)
    new["flag"] = flag

    for name, value in new.items():
        body.store(value.name, "%lanes", rows[name])
    for name, values in more.items():
        for i, value in enumerate(values):
            body.store(value.name, "%lanes", rows[name] + i)
    waiting = body.value(f"bitcast {body.truths} {flag.differs(0.0).name} to i{width}")
    waiting = body.value(f"zext i{width} {waiting} to i64") if width < 64 else waiting
    target = body.value(f"getelementptr double, ptr %lanes, i64 {rows['waiting'] * width}")
    body.lines.append(f"  store i64 {waiting}, ptr {target}")
    bodies = {"advance": body}
    if carries_events(program):
        bodies["settle"] = _settling(program, width, rows, vectors, (rhs, field, projected))
    scalar_texts: list[str] = []
    functions, declared = dict(body.functions), set(body.intrinsics)
    if signals:
        plain = plain_body(observe, 0)
        scalar_texts.append(scalar_text("observe", plain))
        declared |= plain.intrinsics
    for other in bodies.values():
        functions |= other.functions
        declared |= other.intrinsics
    texts = [function_text(name, text) for name, text in bodies.items()]
    names_of = [*bodies, *(["observe"] if signals else [])]
    count_of = sum(text.count for text in bodies.values())
    found = compiled("\n".join([*texts, *scalar_texts, *functions.values(), *sorted(declared)]), names_of, count_of)
    return Block(found["advance"], found.get("settle", 0), found.get("observe", 0), width, rows, size)


def _observed(program: Program, signals: tuple[str, ...], arguments: list[ca.SX]) -> ca.Function:
    """Function (t, x, p, m) -> signals; raises SceneError for an unknown or vector signal."""
    system = program.system
    _, u, force = program.expressions
    columns = []
    for name in signals:
        expression = ca.densify(ca.SX(system.expression(name)))
        if expression.numel() != 1:
            raise SceneError(f"Argument `signals` must name scalar signals, but `{name}` has {expression.numel()} entries.")
        expression = ca.substitute(expression, system.F, force) if system.elements else expression
        columns.append(ca.substitute(expression, system.u, u) if system.inputs else expression)
    return ca.Function("observe", arguments, [ca.vertcat(*columns) if columns else ca.SX(0, 1)])


class _Path:
    """The dense output of a step of DOP853, of order 7."""

    def __init__(
        self,
        pair: Pair,
        rhs: ca.Function,
        t: Value,
        h: Value,
        state: dict[str, list[Value]],
        slopes: list[list[str]],
        x: list[Value],
        k: list[Value],
    ) -> None:
        assert pair is DOP853
        body, self.t, self.h, self.start = t.body, t, h, state["x"]
        self.others = [[value.name for value in state[name]] for name in ("p", "m")]
        stages_so_far = [*slopes, [value.name for value in k]]
        names = [value.name for value in self.start]
        for c, row in zip(DOP853_MORE_C, DOP853_MORE_A, strict=True):
            stage = [body.combination(names[i], h.name, row, [k[i] for k in stages_so_far]) for i in range(len(x))]
            stages_so_far += inline(body, rhs, [[(t + c * h).name], stage, *self.others])
        self.terms = []
        for i in range(len(x)):
            rise, first = x[i] - self.start[i], h * state["k"][i]
            last = [Value(body, body.combination("", h.name, row, [k[i] for k in stages_so_far])) for row in DOP853_DENSE]
            self.terms.append([rise, first - rise, 2.0 * rise - first - h * k[i], *last])

    def signal(self, observe: ca.Function, which: int) -> Callable[[Any], Value]:
        """One signal as a function of the fraction of the step."""

        def at(fraction: Any) -> Value:
            rest = 1.0 - fraction
            x = []
            for start, terms in zip(self.start, self.terms, strict=True):
                value = terms[-1] * fraction
                for i, term in enumerate(reversed(terms[:-1])):
                    value = (value + term) * (rest if i % 2 == 0 else fraction)
                x.append((value + start).name)
            return Value(self.t.body, inline(self.t.body, observe, [[(self.t + self.h * fraction).name], x, *self.others])[0][which])

        return at


def _measured(signal: Callable[[Any], Value], h: Value, before: list[Value]) -> list[Value]:
    """Minimum, maximum and integral of a signal with those of a step: Gauss-Legendre integral, extrema refined by parabolas."""
    values = [signal(place) for place in PLACES]
    integral = before[2]
    for value, weight in zip(values[1:-1], WEIGHTS, strict=True):
        integral = integral + value * (h * weight)
    found = []
    for sign, old in ((-1.0, before[0]), (1.0, before[1])):
        best = old
        for value in (values[0], values[-1]):
            best = (sign * value > sign * best).choose(value, best)
        zero = h * 0.0
        triple = [(zero + PLACES[i], values[i]) for i in range(3)]
        for i in range(2, len(PLACES) - 1):
            higher = sign * values[i] > sign * triple[1][1]
            triple = [(higher.choose(PLACES[i + k], triple[1 + k][0]), higher.choose(values[i + k], triple[1 + k][1])) for k in (-1, 0, 1)]
        for _ in range(3):
            (a, fa), (b, fb), (c, fc) = triple
            left, right = (b - a) * (fb - fc), (b - c) * (fb - fa)
            vertex = b - 0.5 * ((b - a) * left - (b - c) * right) / (left - right)
            vertex = ((vertex > a) & (vertex < c)).choose(vertex, b)
            value = signal(vertex)
            later, better = vertex > b, sign * value >= sign * fb
            triple = [
                (
                    later.choose(better.choose(b, a), better.choose(a, vertex)),
                    later.choose(better.choose(fb, fa), better.choose(fa, value)),
                ),
                (better.choose(vertex, b), better.choose(value, fb)),
                (
                    later.choose(better.choose(c, vertex), better.choose(b, c)),
                    later.choose(better.choose(fc, value), better.choose(fb, fc)),
                ),
            ]
        found.append((sign * triple[1][1] > sign * best).choose(triple[1][1], best))
    return [*found, integral]


def carries_events(program: Program) -> bool:
    """Whether events are settled in the block: without rigid contacts, and without friction that can lose its load."""
    return program.machine.elements > 0 and bool((program.kind != RIGID).all() and (program.loader < 0).all())


def _settling(
    program: Program, width: int, rows: dict[str, int], vectors: dict[str, int], functions: tuple[ca.Function, ...]
) -> VectorBody:
    """What `toolbox.loop` does at an event, for the lanes that have stepped to one: modes by force, slopes, guards, round-off, first step.

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
    names = ("time", "flag", "located", "end", "rtol")
    old = {name: Value(body, body.load("%lanes", rows[name])) for name in (*names, "wanted", "step_old")}
    kept = [name for name in vectors if name not in ("g_low", "g_high", "after", "measured")]
    state = {name: [Value(body, body.load("%lanes", rows[name] + i)) for i in range(vectors[name])] for name in kept}
    t, m, end, zero = old["time"], state["m"], old["end"], old["time"] * 0.0

    def call(function: ca.Function, now: Value, x: list[Value], p: list[Value], modes: list[Value]) -> list[Value]:
        values = [[now.name], *([value.name for value in column] for column in (x, p, modes))]
        return [Value(body, name) for name in inline(body, function, values)[0]]

    # --- what fires
    fired = []
    for j in range(ng):
        rate, value = state["side"][j] * state["g"][ng + j], state["side"][j] * state["g"][j]
        descends = rate <= 0.0 if j < 2 * ne else rate < 0.0
        fired.append((descends & (value <= 1e-9 * state["guard_scale"][j])) | ~old["located"].differs(float(j)))
    side = [*state["side"][: 2 * ne], *(fired[j].choose(-state["side"][j], state["side"][j]) for j in range(2 * ne, ng))]
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
    x = call(projected, t, state["x"], state["p"], caught) + state["x"][own:]

    # --- modes by force: all consistent at once, or one that cannot stick slides
    def inconsistent(modes: list[Value], found: list[Value]) -> list[Any]:
        wrong: list[Any] = []
        for i in range(ne):
            if zeros[i] is None:
                wrong.append(None)
                continue
            rate, force, static, pace = found[i], found[ne + i], found[2 * ne + i], found[3 * ne + i]
            sticks = ~modes[i].differs(0.0)
            stick_scale = m[i].differs(0.0).choose(state["other_scale"][2 * i], state["guard_scale"][2 * i])
            holds = sticks & (abs(force) <= static * (1.0 + 1e-9) + 1e-12 * stick_scale)
            slides = ~sticks & (modes[i] * rate >= -1e-7 * abs(pace))
            wrong.append(zeros[i] & ~(holds | slides))
        return wrong

    first = call(probe, t, x, state["p"], modes)
    wrong, count, sound = inconsistent(modes, first), zero, zero <= 0.0
    chosen = list(modes)
    for i in range(ne):
        if wrong[i] is not None:
            count = count + wrong[i].choose(1.0, 0.0)
            sound &= ~(wrong[i] & forced[i])
            chosen[i] = wrong[i].choose((first[ne + i] > 0.0).choose(-1.0, 1.0), modes[i])
    again = inconsistent(chosen, call(probe, t, x, state["p"], chosen))
    for i in range(ne):
        if again[i] is not None:
            sound &= ~again[i]
    settled = ~old["flag"].differs(float(EVENT)) & sound & (count <= 1.0)

    # --- slopes, guards, sizes and round-off there
    values = call(field, t, x, state["p"], chosen)
    k, g = values[:n], values[n:]
    scale = [largest(abs(a), b) for a, b in zip(x, state["scale"], strict=True)]
    group_scale = list(state["group_scale"])
    for i, group in enumerate(program.groups.tolist()):
        group_scale[group] = largest(scale[i], group_scale[group])
    guard_scale, other_scale, armed = [], [], []
    for j in range(ng):
        size = state["guard_scale"][j]
        if j < 2 * ne:
            changed = (m[j // 2].differs(0.0) & ~chosen[j // 2].differs(0.0)) | (~m[j // 2].differs(0.0) & chosen[j // 2].differs(0.0))
            other_scale.append(changed.choose(size, state["other_scale"][j]))
            size = changed.choose(state["other_scale"][j], size)
        guard_scale.append(largest(abs(g[j]), size))
        armed.append((side[j] * g[j] > 1e-13 * guard_scale[j]).choose(1.0, 0.0))
    nudged = [value * (1.0 + 1e-7 * (1.0 - 0.3 * (i % 5))) for i, value in enumerate(x)]
    nudged_p = [value * (1.0 + 1e-7 * (0.9 - 0.37 * (i % 7))) for i, value in enumerate(state["p"])]
    moved = call(field, t * (1.0 + 1e-7), nudged, nudged_p, chosen)[:n]
    cancelled = call(burden, t, x, state["p"], chosen) + [zero] * (n - form.burden.numel())
    noise = [(1e7 * abs(a - b) + c) * (32.0 * 2.220446049250313e-16) for a, b, c in zip(moved, k, cancelled, strict=True)]

    # --- a first step by Hairer's rule
    def root(value: Value) -> Value:
        return Value(body, body.intrinsic("sqrt", value.name))

    d0, d1, d2 = zero, zero, zero
    weights = []
    for i in range(n):
        weights.append(1.0 / (old["rtol"] * largest(largest(scale[i], 1e-10 * group_scale[int(program.groups[i])]), 1e-14)))
        a, b = x[i] * weights[i], k[i] * weights[i]
        d0, d1 = d0 + a * a, d1 + b * b
    h0 = ((d0 < 1e-10) | (d1 < 1e-10)).choose(1e-6, 0.01 * root(d0 / d1))
    h0 = smallest(h0, end - t)
    ahead = call(rhs, t + h0, [a + h0 * b for a, b in zip(x, k, strict=True)], state["p"], chosen)
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
    for name, column in results.items():
        for i, value in enumerate(column):
            body.store(settled.choose(value, state[name][i]).name, "%lanes", rows[name] + i)
    for name, value in (("wanted", h), ("step_old", zero), ("flag", zero)):
        body.store(settled.choose(value, old[name]).name, "%lanes", rows[name])
    return body


def _error(
    program: Program, old: dict[str, Value], state: dict[str, list[Value]], h: Value, x_new: list[Value], estimates: list[list[Value]]
) -> Value:
    """Scaled error of a step: see `toolbox.loop._error`."""
    hidden = program.excited.size
    n = len(x_new)
    own, two = n - hidden, bool(estimates[1])
    body = h.body
    zero = h * 0.0
    share = largest(old["rtol"] * smallest(h / old["end"], 0.1), (old["rtol"] > 1e-14).choose(1e-14, 2e-15))
    sums = [zero, zero]
    for i in range(own):
        size = largest(largest(state["scale"][i], abs(x_new[i])), largest(1e-10 * state["group_scale"][int(program.groups[i])], 1e-14))
        tolerance = 1.0 / (share * size + state["noise"][i] * h)
        for which in range(1 + two):
            ratio = estimates[which][i] * tolerance
            sums[which] = sums[which] + ratio * ratio

    def root(value: Value) -> Value:
        return Value(body, body.intrinsic("sqrt", value.name))

    if two:
        bottom = sums[0] + 0.01 * sums[1]
        error = bottom.differs(0.0).choose(sums[0] / root(bottom * float(own)), 0.0)
    else:
        error = root(sums[0] * (1.0 / max(own, 1)))
    for q, element in enumerate(program.excited.tolist()):
        bound = state["m"][element].differs(0.0).choose(state["other_scale"][2 * element], state["guard_scale"][2 * element])
        size = largest(largest(bound, 1e-3 * old["end"] * abs(state["k"][own + q])), 1e-300)
        missed = abs(estimates[1 if two else 0][own + q]) / ((0.02 if two else 3e-4) * size)
        error = (missed > error).choose(missed, error)
    return error


def _lowest(a: Value, da: Value, b: Value, db: Value) -> Value:
    """Minimum of the cubic Hermite interpolant between a falling start and a rising end: see `toolbox.loop._lowest`."""
    body = a.body
    c2 = 3.0 * (b - a) - 2.0 * da - db
    c3 = 2.0 * (a - b) + da + db
    root = Value(body, body.intrinsic("sqrt", largest(c2 * c2 - 3.0 * c3 * da, 0.0).name))
    s = -da / (c2 + root)
    s = ((s > 0.0) & (s < 1.0)).choose(s, 0.5)
    return a + s * (da + s * (c2 + s * c3))


def _crossing(a: Value, b: Value, da: Value, db: Value, width: Value) -> Value:
    """Fraction of a bracket at which a guard falls from a > 0 to b <= 0 is zero: by the cubic Hermite interpolant of the inverse function where the
    guard falls all the way, else from the end, which has been passed, by its tangent.
    """
    da, db = da * width, db * width
    fall = b - a
    once = 1.0 / (da * db * fall)
    u = -a * da * db * once
    first, last = fall * fall * db * once, fall * fall * da * once
    smooth = (first > 0.0) & (first <= 3.0) & (last > 0.0) & (last <= 3.0)
    inverse = u + u * (1.0 - u) * ((first - 1.0) * (1.0 - u) - (last - 1.0) * u)
    tangent = 1.0 - b * da * fall * once
    tangent = ((tangent > 0.0) & (tangent <= 1.0) & (db < 0.0)).choose(tangent, 0.5)
    return smooth.choose(inverse, tangent)


def _where_any(condition: Truth, compute: Callable[[], Truth]) -> Truth:
    """`compute()` where the condition holds in any lane, else false, which it must be where the condition is false."""
    body = condition.body
    here, there, label = f"b{body.count}", f"c{body.count}", f"d{body.count}"
    body.intrinsics.add(f"declare i1 @llvm.vector.reduce.or.v{body.width}i1({body.truths})")
    anywhere = body.value(f"call i1 @llvm.vector.reduce.or.v{body.width}i1({body.truths} {condition.name})")
    body.lines += [f"  br label %{here}", f"{here}:", f"  br i1 {anywhere}, label %{there}, label %{label}", f"{there}:"]
    found = compute()
    body.lines += [f"  br label %{label}", f"{label}:"]
    return Truth(body, body.value(f"phi {body.truths} [ {found.name}, %{there} ], [ zeroinitializer, %{here} ]"))
