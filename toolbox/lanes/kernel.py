"""One pass of a block of lanes as machine code: every lane tries one step of its own, of its own length, and judges it by itself.

A lane steps on, or searches an event inside a step whose end it has seen; either way a pass is one step from where the lane stands, so that lanes that
search and lanes that step on share the same instructions. The pass does what `toolbox.simulation.event_loop` does between events, in the same order: error,
guards, acceptance, step size. It flags what it leaves to the loop.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import casadi as ca

from toolbox.compilation.emitter import compiled, inline
from toolbox.compilation.emitter import function_text as scalar_text
from toolbox.compilation.kernel import plain_body, stages
from toolbox.compilation.program import Program
from toolbox.compilation.runge_kutta import Pair
from toolbox.compilation.vector_emitter import VectorBody, function_text
from toolbox.lanes.events import carries_events, settling
from toolbox.lanes.extrema import Path, measure_step
from toolbox.lanes.loop import ALONE, EVENT, GOES_ON, ROUND_OFF, SAMPLE, STOP
from toolbox.lanes.quintics import measure_quintics
from toolbox.lanes.samples import POINTERS, sampling
from toolbox.lanes.vectors import Row, Rows, Truth, Value, changed_where, largest, smallest, where_any
from toolbox.measuring.quintics import signals_and_bounds, with_derivatives

SCALARS = ("time", "wanted", "stop", "error_old", "step_old", "rejected", "searching", "whole", "low", "high", "fraction", "tries",
           "longest", "end", "rtol", "accepted", "refused", "flag", "located", "waiting")  # fmt: skip
"""Rows of a block with one number per lane."""

LARGE = 200_000
"""Instructions above which a block is compiled in a hurry: many runs are worth seconds of it."""

PROBING, CLEARED = 1.0, 2.0
"""What the row `dip` begins with where a step goes to the minimum of a guard, and where that has shown that the guard stays positive; behind that stand the
guard, the minimum expected, and value and slope at the end of the step.
"""

MANY_GUARDS = 8
"""Guards above which it pays to look whether any lane searches before its bracket is updated: instructions in between are reordered less freely."""

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

    observe = ca.Function("observe", arguments, [ca.densify(signals_and_bounds(program, signals, program.varying)) if windows else ca.SX(0, 1)])
    count = observe.numel_out(0)
    groups = program.group_count
    rows: dict[str, int] = {}
    size = 0
    vectors = {"x": n, "k": n, "p": p.numel(), "m": ne, "g": 2 * ng, "side": ng, "armed": ng, "guard_scale": ng, "scale": n, "group_scale": groups,
               "noise": n, "g_low": 2 * ng, "g_high": 2 * ng, "other_scale": 2 * ne, "dip": 7,
               "edges": 2 * windows, "measured": 3 * count * windows, "doubt": 1,
               "calendar": 1, "due": 1, "samples": 2 * len(program.updates), "memory": sum(z.numel() for z, _, _ in program.updates)}  # fmt: skip
    for name, length in [*((name, 1) for name in SCALARS), *vectors.items()]:
        rows[name], size = size, size + length
    for name in ("measured", "doubt", "calendar", "due", "samples", "memory"):  # which only steps inside a window, and samples, touch
        del vectors[name]

    body = VectorBody(width)
    lengths: dict[str, int | None] = {**dict.fromkeys(SCALARS), **vectors}
    was = Rows(body, rows, lengths)
    new: dict[str, Value] = {}
    more: dict[str, list[Value]] = {}

    def store(columns: dict[str, list[Value]]) -> None:
        for name, values in columns.items():
            for i, value in enumerate(values):
                body.store(value.name, "%lanes", rows[name] + i)

    # --- one step from where the lane stands
    t, searching, stop = was["time"], was["searching"].differs(0.0), was["stop"]
    never = Truth(body, "zeroinitializer")
    probes = count > 0  # where nothing is measured, a step of the scalar loop costs less than what this adds to every pass
    probing, cleared = (~was["dip"][0].differs(value) if probes else never for value in (PROBING, CLEARED))
    wanted = smallest(was["wanted"], was["longest"])
    to_stop = (t + wanted >= stop) | (stop - (t + wanted) < 1e-3 * wanted)
    h = searching.choose(was["fraction"] * was["whole"], to_stop.choose(stop - t, wanted))
    h = probing.choose(was["dip"][5], h)
    unresolved = ~searching & ~probing & ~((h >= 1e-14 * abs(t)) & (h >= 1e-300))
    names = [[value.name for value in was[item]] for item in ("x", "k", "p", "m")]
    slopes, ends, end_field = stages(body, pair, rhs, field, (t.name, h.name), names)
    x_new = [Value(body, name) for name in ends]
    end = [Value(body, name) for name in end_field]
    k_new, g_new = end[:n], end[n:]
    estimates = []
    for weights in (pair.error, pair.error_low):
        used = [*slopes, end_field[:n]][: len(weights)]
        estimates.append([Value(body, body.combination("", h.name, weights, [k[i] for k in used])) for i in range(n if weights else 0)])
    was = Rows(body, rows, lengths)
    error = _error(program, was, h, x_new, estimates)

    # --- guards over the step
    side = [*[None] * (2 * ne), *was["side"][2 * ne :]]

    def signed(values: Row | list[Value], j: int) -> Value:
        sign = side[j % ng]
        return values[j] if sign is None else sign * values[j]

    runs = ~was["flag"].differs(float(GOES_ON))
    nothing = h < -1.0
    hit, odd, near, below, maybe = nothing, nothing, nothing, nothing, nothing
    dips: list[tuple[Truth, Value, Value, Value, Value]] = []
    located = h * 0.0
    armed = [value.differs(0.0) for value in was["armed"]]
    for j in reversed(range(ng)):
        a, da, b, db = signed(was["g"], j), signed(was["g"], ng + j), signed(g_new, j), signed(g_new, ng + j)
        guard_scale = was["guard_scale"][j]
        close = smallest(largest(1e-5 * was["rtol"], 1e-13), 1e-9) * guard_scale
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
        elif j < 2 * ne and program.table_slot:  # at its bound where an input turns: what follows decides
            odd |= to_stop & armed[j] & (b <= 0.0) & (b >= -1e-12 * guard_scale)
        this = armed[j] & (abs(b) <= close) & (db < 0.0)
        near |= this
        below |= wrong | (armed[j] & (b < 0.0) & ~this)
        located = this.choose(float(j), located)

    # a guard may dip below zero inside a step, which a step to its minimum shows, or before an event that cuts a step short
    meets = runs & unresolved & to_stop if program.updates else never  # a sample nearer than can be resolved: its time is this one
    fresh, searching, probing = runs & ~searching & ~probing & ~meets, runs & searching, runs & probing
    event = searching & near & ~below
    seen = error < 1e4
    hit, odd = (fresh | probing) & seen & hit, (fresh & ((seen & odd) | unresolved)) | (probing & odd)

    known = was["dip"][:]

    def low_dips() -> tuple[Truth]:
        low = nothing
        for turns, a, da, b, db in dips:
            low |= turns & (_lowest(a, da * h, b, db * h)[1] <= 0.5 * largest(a, b))
        return (low & ((fresh & ~cleared) | event),)

    def look() -> tuple[Truth, ...]:
        _, guard, expected, late, late_rate, _, rest = known
        some, several, one = nothing, nothing, [h * 0.0] * 6
        start, start_rate, value, rate = h * 0.0, h * 0.0, h * 0.0, h * 0.0
        for i, (turns, a, da, b, db) in enumerate(dips):
            j = float(ng - 1 - i)
            place, lowest = _lowest(a, da * h, b, db * h)
            this = turns & (lowest <= 0.5 * largest(a, b))
            several |= some & this
            some |= this
            one = [this.choose(new, old) for new, old in zip((j, lowest, b, db, place * h, h - place * h), one, strict=True)]
            this = ~guard.differs(j)
            found = start, start_rate, value, rate
            start, start_rate, value, rate = (this.choose(new, old) for new, old in zip((a, da, b, db), found, strict=True))
        asks = low & fresh & ~several & ~hit & ~odd
        # the part of the step in which the minimum lies, now that a point near it is known
        falls = rate < 0.0
        a, da, b, db = falls.choose(value, start), falls.choose(rate, start_rate), falls.choose(late, value), falls.choose(late_rate, rate)
        width = falls.choose(rest, h)
        clear = ~((da < 0.0) & (db > 0.0)) | (_lowest(a, da * width, b, db * width)[1] > abs(value - expected))
        store({"dip": [asks.choose(PROBING, (probing & clear).choose(CLEARED, 0.0)), *one]})
        return asks, low & ~asks, probing & ~hit & ~clear

    (low,) = where_any(maybe & ((fresh & ~cleared) | event), low_dips)
    asks, dipped, doubtful = never, low, never
    if probes:
        store({"dip": [h * 0.0]})
        asks, dipped, doubtful = where_any(low | probing, look)
    odd |= dipped | doubtful
    event &= ~dipped
    begins = hit & ~odd
    goes_on = searching & ~event & ~dipped
    good = error <= 1.0
    steps = fresh & ~hit & ~odd & ~asks
    too_long = never
    if count and program.updates:
        derived = with_derivatives(program, signals, program.varying)
        edges = list(zip(was["edges"][::2], was["edges"][1::2], strict=True))
        others, numbers = [list(was["p"]), list(was["m"])], {"rtol": was["rtol"], "longest": was["longest"]}
        too_long = measure_quintics(derived, ((t, list(was["x"])), (t + h, x_new)), others, (steps | event) & good, edges, rows, numbers)
        good &= ~too_long
    accepted, arrives = steps & good, event & good
    moves = accepted | arrives
    refused = (steps | event) & ~good

    # --- the bracket of the search, and where to look next
    searches = begins | goes_on

    def search() -> tuple[Truth]:
        was = Rows(body, rows, lengths)
        rises, falls = goes_on & ~below, goes_on & below
        low = begins.choose(0.0, rises.choose(was["fraction"], was["low"]))
        high = begins.choose(1.0, falls.choose(was["fraction"], was["high"]))
        whole = begins.choose(h, was["whole"])
        width = (high - low) * whole
        g_low = [begins.choose(g, rises.choose(e, o)) for g, e, o in zip(was["g"], g_new, was["g_low"], strict=True)]
        g_high = [(begins | falls).choose(e, o) for e, o in zip(g_new, was["g_high"], strict=True)]
        part = h * 0.0 + 2.0
        for j in range(ng):
            a, b, da, db = (signed(values, i) for i in (j, ng + j) for values in (g_low, g_high))
            crosses = searches & armed[j] & (b <= 0.0)
            earlier = partial(_earlier, part, a, b, da, db, width)
            part = changed_where(crosses, earlier, part) if skips else crosses.choose(earlier(), part)
        tries = begins.choose(0.0, was["tries"] + 1.0)
        lost = searches & ((tries > float(MOST_TRIES)) | (part > 1.5))
        part = (tries > 8.0).choose(0.5, part)
        inside = low + part * (high - low)
        inside = ((inside > low) & (inside <= high)).choose(inside, 0.5 * (low + high))
        store(
            {
                "whole": [whole],
                "low": [low],
                "high": [high],
                "fraction": [searches.choose(inside, was["fraction"])],
                "tries": [tries],
                "g_low": g_low,
                "g_high": g_high,
            }
        )
        return (lost,)

    skips = ng > MANY_GUARDS
    (lost,) = where_any(searches, search) if skips else search()
    continues = searches & ~lost

    # --- acceptance and the next step size
    was = Rows(body, rows, lengths)
    power = float(pair.power)
    logarithm = Value(body, body.rough_log2(largest(error, 1e-10).name))
    prediction = Value(body, body.rough_log2((h / was["step_old"]).name)) + power * (was["error_old"] - logarithm)
    growth = -power * logarithm
    growth = growth + (was["step_old"] > 0.0).choose(smallest(prediction, 0.0), 0.0)
    exponent = smallest(largest(accepted.choose(growth, -power * logarithm), -900.0), 900.0)
    factor = Value(body, body.rough_exp2(exponent.name))
    rejected = was["rejected"].differs(0.0)
    grown = h * smallest(largest(0.85 * factor, 0.2), rejected.choose(1.0, 10.0))
    grown = (h < wanted).choose(largest(grown, wanted), grown)
    shrunk = h * too_long.choose(0.5, (error < 1e30).choose(largest(0.9 * factor, 0.1), 0.1))
    new["wanted"] = accepted.choose(grown, refused.choose(shrunk, was["wanted"]))
    new["error_old"] = accepted.choose(largest(logarithm, -13.3), was["error_old"])
    new["step_old"] = accepted.choose(h, was["step_old"])
    new["rejected"] = refused.choose(1.0, moves.choose(0.0, was["rejected"]))
    new["searching"] = continues.choose(1.0, 0.0)
    new["located"] = arrives.choose(located, was["located"])
    taken = was["accepted"] + moves.choose(1.0, 0.0)
    new["accepted"] = taken
    new["refused"] = was["refused"] + refused.choose(1.0, 0.0)
    t_new = to_stop.choose(accepted.choose(stop, t + h), t + h)
    new["time"] = moves.choose(t_new, meets.choose(stop, t))
    straight = inline(body, projected, [[t_new.name], ends, names[2], names[3]])[0] if ne else ends[:own]
    final = [accepted.choose(Value(body, straight[i]), x_new[i]) if i < own else x_new[i] for i in range(n)]
    more["x"] = [moves.choose(value, o) for value, o in zip(final, was["x"], strict=True)]
    more["k"] = [moves.choose(value, o) for value, o in zip(k_new, was["k"], strict=True)]
    more["g"] = [moves.choose(value, o) for value, o in zip(g_new, was["g"], strict=True)]
    more["scale"] = [(moves & (abs(value) > o)).choose(abs(value), o) for value, o in zip(x_new, was["scale"], strict=True)]
    more["group_scale"] = list(was["group_scale"])
    for i, group in enumerate(program.groups.tolist()):
        more["group_scale"][group] = largest(more["scale"][i], more["group_scale"][group])
    more["guard_scale"] = [(moves & (abs(g_new[j]) > o)).choose(abs(g_new[j]), o) for j, o in enumerate(was["guard_scale"])]
    more["armed"] = [(armed[j] | (moves & (signed(g_new, j) > 1e-13 * more["guard_scale"][j]))).choose(1.0, 0.0) for j in range(ng)]

    if count and not program.updates:
        path = Path(pair, rhs, t, h, was, slopes, x_new, k_new)
        edges = list(zip(was["edges"][::2], was["edges"][1::2], strict=True))
        measure_step(observe, path, moves, edges, rows, was["rtol"])

    # --- what the pass leaves to the loop
    every = Value(body, body.intrinsic("floor", (taken * (1 / 128)).name)) * 128.0
    stale = (refused & rejected) | (moves & ~every.differs(taken))
    flag = stale.choose(float(ROUND_OFF), was["flag"])
    flag = ((accepted & to_stop) | meets).choose(float(SAMPLE if program.updates else STOP), flag)
    flag = arrives.choose(float(EVENT), flag)
    flag = (odd | lost).choose(float(ALONE), flag)
    new["flag"] = flag

    store({name: [value] for name, value in new.items()} | more)
    body.store_bits(flag.differs(0.0).name, "%lanes", rows["waiting"])
    if program.updates:
        body.store_bits((~flag.differs(float(SAMPLE))).name, "%lanes", rows["due"])
    bodies = {"advance": body}
    if carries_events(program):
        bodies["settle"] = settling(program, width, rows, lengths, (rhs, field, projected))
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
    found = compiled("\n".join([*texts, *scalar_texts, *functions.values(), *sorted(declared)]), names_of, count_of, LARGE)
    settle, observing, sample = (found.get(name, 0) for name in ("settle", "observe", "sample"))
    return Block(found["advance"], settle, observing, sample, width, rows, size)


def _error(program: Program, was: Rows, h: Value, x_new: list[Value], estimates: list[list[Value]]) -> Value:
    """Scaled error of a step: see `toolbox.simulation.step_control.scaled_error`."""
    hidden = program.excited.size
    n = len(x_new)
    own, two = n - hidden, bool(estimates[1])
    body = h.body
    zero = h * 0.0
    share = largest(was["rtol"] * smallest(h / was["end"], 0.1), (was["rtol"] > 1e-14).choose(1e-14, 2e-15))
    sums = [zero, zero]
    for i in range(own):
        size = largest(largest(was["scale"][i], abs(x_new[i])), largest(1e-10 * was["group_scale"][int(program.groups[i])], 1e-14))
        tolerance = 1.0 / (share * size + was["noise"][i] * h)
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
        bound = was["m"][element].differs(0.0).choose(was["other_scale"][2 * element], was["guard_scale"][2 * element])
        size = largest(largest(bound, 1e-3 * was["end"] * abs(was["k"][own + q])), 1e-300)
        missed = abs(estimates[1 if two else 0][own + q]) / ((0.02 if two else 3e-4) * size)
        error = (missed > error).choose(missed, error)
    return error


def _lowest(a: Value, da: Value, b: Value, db: Value) -> tuple[Value, Value]:
    """Place and value of the minimum of the cubic Hermite interpolant between a falling start and a rising end: see `toolbox.simulation.crossings.lowest`."""
    body = a.body
    c2 = 3.0 * (b - a) - 2.0 * da - db
    c3 = 2.0 * (a - b) + da + db
    root = Value(body, body.intrinsic("sqrt", largest(c2 * c2 - 3.0 * c3 * da, 0.0).name))
    s = -da / (c2 + root)
    s = ((s > 0.0) & (s < 1.0)).choose(s, 0.5)
    return s, a + s * (da + s * (c2 + s * c3))


def _earlier(part: Value, a: Value, b: Value, da: Value, db: Value, width: Value) -> Value:
    """The smaller of a fraction and the crossing."""
    return smallest(_crossing(a, b, da, db, width), part)


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
