"""One pass of a block of lanes as machine code: every lane tries one step of its own, of its own length, and judges it by itself.

A lane steps on, or searches an event inside a step whose end it has seen; either way a pass is one step from where the lane stands, so that lanes that
search and lanes that step on share the same instructions. The pass does what `toolbox.loop` does between events, in the same order: error,
guards, acceptance, step size. It flags what it leaves to the loop.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from toolbox.emit import compiled, inline
from toolbox.emit import function_text as scalar_text
from toolbox.emit_vector import VectorBody, function_text
from toolbox.kernel import plain_body, stages
from toolbox.lanes_loop import ALONE, EVENT, GOES_ON, ROUND_OFF, SAMPLE, STOP
from toolbox.lanes_observe import Path, measure_step
from toolbox.lanes_quintic import measure_quintics
from toolbox.lanes_sample import POINTERS, sampling
from toolbox.lanes_settle import carries_events, settling
from toolbox.lanes_value import Truth, Value, largest, smallest, where_any
from toolbox.program import Program
from toolbox.runge_kutta import Pair
from toolbox.tally import observed, with_derivatives

SCALARS = ("time", "wanted", "stop", "error_old", "step_old", "rejected", "searching", "whole", "low", "high", "fraction", "tries",
           "longest", "end", "rtol", "accepted", "refused", "flag", "located", "waiting")  # fmt: skip
"""Rows of a block with one number per lane."""

MOST_TRIES = 30
"""Steps of a search after which the scalar loop takes over."""


@dataclass(frozen=True)
class Block:
    """A compiled pass, the settling of events, the signals measured and the samples (0 where there are none), for blocks of shape (size, width).

    rows: the first row of every item.
    """

    address: int
    settle: int
    observe: int
    sample: int
    width: int
    rows: dict[str, int]
    size: int


def block(program: Program, width: int, signals: tuple[str, ...] = (), windows: int = 0, late: tuple[bool, ...] = ()) -> Block:
    """The pass of a program whose pair is explicit, for blocks of `width` lanes; kept with the program's structure.

    signals: measured in so many windows, and with them the bounds of friction that vary in time, which takes the dense output of DOP853 unless laws are
    sampled;  late: which of these have a delay.
    """
    key = ("lanes", id(program), width, signals, windows, late)
    found = program.system.kernels.get(key)
    if found is None:
        found = program.system.kernels[key] = _compiled(program, width, signals, windows, late)
    return found


def _compiled(program: Program, width: int, signals: tuple[str, ...], windows: int, late: tuple[bool, ...]) -> Block:
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

    observe = ca.Function("observe", arguments, [ca.densify(observed(program, signals, program.varying)) if windows else ca.SX(0, 1)])
    count = observe.numel_out(0)
    groups = program.group_count
    rows: dict[str, int] = {}
    size = 0
    vectors = {"x": n, "k": n, "p": p.numel(), "m": ne, "g": 2 * ng, "side": ng, "armed": ng, "guard_scale": ng, "scale": n, "group_scale": groups,
               "noise": n, "g_low": 2 * ng, "g_high": 2 * ng, "other_scale": 2 * ne,
               "edges": 2 * windows, "measured": 3 * count * windows, "doubt": 1,
               "calendar": 1, "due": 1, "samples": 2 * len(program.updates), "memory": sum(z.numel() for z, _, _ in program.updates)}  # fmt: skip
    for name, length in [*((name, 1) for name in SCALARS), *vectors.items()]:
        rows[name], size = size, size + length
    for name in ("measured", "doubt", "calendar", "due", "samples", "memory"):  # which only steps inside a window, and samples, touch
        del vectors[name]

    body = VectorBody(width)
    old = {name: Value(body, body.load("%lanes", rows[name])) for name in SCALARS[:-1]}
    state = {name: [Value(body, body.load("%lanes", rows[name] + i)) for i in range(length)] for name, length in vectors.items()}
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
    meets = runs & unresolved & to_stop if program.updates else nothing  # a sample nearer than can be resolved: its time is this one
    fresh, searching = runs & ~searching & ~meets, runs & searching
    event = searching & near & ~below

    def low_dips() -> Truth:
        found = nothing
        for turns, a, da, b, db in dips:
            found |= turns & (_lowest(a, da * h, b, db * h) <= 0.5 * largest(a, b))
        return found & (fresh | event)

    dipped = where_any(maybe & (fresh | event), low_dips)
    seen = error < 1e4
    hit, odd = fresh & seen & hit, (fresh & ((seen & odd) | unresolved)) | dipped
    event &= ~dipped
    begins = hit & ~odd
    goes_on = searching & ~event & ~dipped
    good = error <= 1.0
    steps = fresh & ~hit & ~odd
    edges = list(zip(state["edges"][::2], state["edges"][1::2], strict=True))
    too_long = nothing
    if count and program.updates:
        derived = with_derivatives(program, signals, program.varying)
        others, numbers = [state["p"], state["m"]], {"rtol": old["rtol"], "longest": old["longest"]}
        too_long = measure_quintics(derived, ((t, state["x"]), (t + h, x_new)), others, (steps | event) & good, edges, rows, numbers)
        good &= ~too_long
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
    shrunk = h * too_long.choose(0.5, (error < 1e30).choose(largest(0.9 * factor, 0.1), 0.1))
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
    taken = old["accepted"] + moves.choose(1.0, 0.0)
    new["accepted"] = taken
    new["refused"] = old["refused"] + refused.choose(1.0, 0.0)
    t_new = to_stop.choose(accepted.choose(stop, t + h), t + h)
    new["time"] = moves.choose(t_new, meets.choose(stop, t))
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

    if count and not program.updates:
        path = Path(pair, rhs, t, h, state, slopes, x_new, k_new)
        measure_step(observe, path, moves, edges, rows, old["rtol"])

    # --- what the pass leaves to the loop
    every = Value(body, body.intrinsic("floor", (taken * (1 / 128)).name)) * 128.0
    stale = (refused & rejected) | (moves & ~every.differs(taken))
    flag = stale.choose(float(ROUND_OFF), old["flag"])
    flag = ((accepted & to_stop) | meets).choose(float(SAMPLE if program.updates else STOP), flag)
    flag = arrives.choose(float(EVENT), flag)
    flag = (odd | lost).choose(float(ALONE), flag)
    new["flag"] = flag

    for name, value in new.items():
        body.store(value.name, "%lanes", rows[name])
    for name, values in more.items():
        for i, value in enumerate(values):
            body.store(value.name, "%lanes", rows[name] + i)
    body.store_bits(flag.differs(0.0).name, "%lanes", rows["waiting"])
    if program.updates:
        body.store_bits((~flag.differs(float(SAMPLE))).name, "%lanes", rows["due"])
    bodies = {"advance": body}
    if carries_events(program):
        bodies["settle"] = settling(program, width, rows, vectors, (rhs, field, projected))
    if program.updates:
        bodies["sample"] = sampling(program, width, rows, late)
    scalar_texts: list[str] = []
    functions, declared = dict(body.functions), set(body.intrinsics)
    if count:
        plain = plain_body(observe, 0)
        scalar_texts.append(scalar_text("observe", plain))
        declared |= plain.intrinsics
    for other in bodies.values():
        functions |= other.functions
        declared |= other.intrinsics
    texts = [function_text(name, text, POINTERS if name == "sample" else ()) for name, text in bodies.items()]
    names_of = [*bodies, *(["observe"] if count else [])]
    count_of = sum(text.count for text in bodies.values())
    found = compiled("\n".join([*texts, *scalar_texts, *functions.values(), *sorted(declared)]), names_of, count_of)
    settle, observing, sample = (found.get(name, 0) for name in ("settle", "observe", "sample"))
    return Block(found["advance"], settle, observing, sample, width, rows, size)


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
