"""Guards over a step of the lanes: which are passed, which may have dipped below zero, and where to look for an event."""

from __future__ import annotations

from dataclasses import dataclass

from toolbox.lanes.layout import GOES_ON
from toolbox.lanes.trial_step import CLEARED, PROBING, Pass, Step
from toolbox.lanes.vectors import Row, Truth, Value, largest, smallest, where_any

MOST_TRIES = 30
"""Steps of a search after which the scalar loop takes over."""


@dataclass(frozen=True)
class Dip:
    """A guard that falls and rises inside a step in the lanes of `turns`, with its value and slope at both ends."""

    turns: Truth
    a: Value
    da: Value
    b: Value
    db: Value


@dataclass(frozen=True)
class Guards:
    """What the guards do over a step.

    runs: lanes that wait for nothing;  nothing: no lane;  side: signs of the guards, None for +1;  hit: one is passed;  odd: what the scalar loop has to
    look at;  near: one is zero at the end, the last of them `located`;  below: one is passed or was never armed;  maybe: one may have dipped below zero,
    among `dips`.
    """

    runs: Truth
    nothing: Truth
    side: list[Value | None]
    armed: list[Truth]
    hit: Truth
    odd: Truth
    near: Truth
    below: Truth
    maybe: Truth
    located: Value
    dips: list[Dip]


def emit_guards(made: Pass, step: Step) -> Guards:
    """What the guards do over the step."""
    program, ne, ng = made.program, made.ne, made.ng
    was, h = step.was, step.h
    side, armed = made.sides(was)
    runs = ~was["flag"].differs(float(GOES_ON))
    nothing = h < -1.0
    hit, odd, near, below, maybe = nothing, nothing, nothing, nothing, nothing
    dips: list[Dip] = []
    located = h * 0.0
    for j in reversed(range(ng)):
        a, da, b, db = (signed(side, values, i) for values in (was["g"], step.g) for i in (j, ng + j))
        guard_scale = was["guard_scale"][j]
        close = smallest(largest(1e-5 * was["rtol"], 1e-13), 1e-9) * guard_scale
        wrong = ~armed[j] & (b < -1e-12 * guard_scale)
        hit |= armed[j] & (b <= 0.0)
        odd |= wrong
        # only where a control point of the cubic lies low can its minimum lie low
        turns = runs & armed[j] & (b > 0.0) & (da < 0.0) & (db > 0.0)
        turns &= (smallest(a + da * h * (1 / 3), b - db * h * (1 / 3)) <= 0.5 * largest(a, b)) & (step.error <= 1.0)
        maybe |= turns
        dips.append(Dip(turns, a, da, b, db))
        if j < 2 * ne and program.system.elements[j // 2].rigid:  # how deep an impact is located decides which bounce is the last
            odd |= armed[j] & (b <= 0.0)
        elif j < 2 * ne and program.table_slot:  # at its bound where an input turns: what follows decides
            odd |= step.to_stop & armed[j] & (b <= 0.0) & (b >= -1e-12 * guard_scale)
        this = armed[j] & (abs(b) <= close) & (db < 0.0)
        near |= this
        below |= wrong | (armed[j] & (b < 0.0) & ~this)
        located = this.choose(float(j), located)
    return Guards(runs, nothing, side, armed, hit, odd, near, below, maybe, located, dips)


def signed(side: list[Value | None], values: Row | list[Value], j: int) -> Value:
    """Value j of a guard, or its rate behind the values of all, positive before the guard is passed."""
    sign = side[j % len(side)]
    return values[j] if sign is None else sign * values[j]


def emit_dips(
    made: Pass, step: Step, guards: Guards, kinds: tuple[Truth, Truth, Truth], found: tuple[Truth, Truth]
) -> tuple[Truth, Truth, Truth]:
    """Return three sets of lanes: lanes that ask for a step to a minimum, lanes with a guard that dips below zero, lanes with a guard that
    may dip.

    A guard may dip below zero inside a step, which a step to its minimum shows, or before an event that cuts a step short. kinds: fresh steps, steps to
    a minimum, and steps to an event;  found: what is hit, and what is odd.
    """
    (fresh, probing, event), (hit, odd) = kinds, found
    h, nothing = step.h, guards.nothing
    known = step.was["dip"][:]

    def low_dips() -> tuple[Truth]:
        low = nothing
        for dip in guards.dips:
            low |= dip.turns & (hermite_minimum(dip.a, dip.da * h, dip.b, dip.db * h)[1] <= 0.5 * largest(dip.a, dip.b))
        return (low & ((fresh & ~step.cleared) | event),)

    def look() -> tuple[Truth, ...]:
        _, guard, expected, late, late_rate, _, rest = known
        some, several, one = nothing, nothing, [h * 0.0] * 6
        start, start_rate, value, rate = h * 0.0, h * 0.0, h * 0.0, h * 0.0
        for i, dip in enumerate(guards.dips):
            j = float(made.ng - 1 - i)
            place, lowest = hermite_minimum(dip.a, dip.da * h, dip.b, dip.db * h)
            this = dip.turns & (lowest <= 0.5 * largest(dip.a, dip.b))
            several |= some & this
            some |= this
            one = [this.choose(new, old) for new, old in zip((j, lowest, dip.b, dip.db, place * h, h - place * h), one, strict=True)]
            this = ~guard.differs(j)
            was = start, start_rate, value, rate
            start, start_rate, value, rate = (this.choose(new, old) for new, old in zip((dip.a, dip.da, dip.b, dip.db), was, strict=True))
        asks = low & fresh & ~several & ~hit & ~odd
        # the part of the step in which the minimum lies, now that a point near it is known
        falls = rate < 0.0
        a, da, b, db = falls.choose(value, start), falls.choose(rate, start_rate), falls.choose(late, value), falls.choose(late_rate, rate)
        width = falls.choose(rest, h)
        clear = ~((da < 0.0) & (db > 0.0)) | (hermite_minimum(a, da * width, b, db * width)[1] > abs(value - expected))
        made.store({"dip": [asks.choose(PROBING, (probing & clear).choose(CLEARED, 0.0)), *one]})
        return asks, low & ~asks, probing & ~hit & ~clear

    (low,) = where_any(guards.maybe & ((fresh & ~step.cleared) | event), low_dips)
    if not made.probes:
        return made.never, low, made.never
    made.store({"dip": [h * 0.0]})
    asks, dipped, doubtful = where_any(low | probing, look)
    return asks, dipped, doubtful


def emit_search(made: Pass, step: Step, guards: Guards, begins: Truth, goes_on: Truth) -> tuple[Truth, Truth]:
    """Narrow the bracket of the search and choose the next fraction. Return the lanes that continue the search, and the lanes that have
    lost it.

    begins, goes_on: lanes whose search begins, and goes on.
    """
    ng, h, was = made.ng, step.h, made.loaded()
    searches, rises, falls = begins | goes_on, goes_on & ~guards.below, goes_on & guards.below
    low = begins.choose(0.0, rises.choose(was["fraction"], was["low"]))
    high = begins.choose(1.0, falls.choose(was["fraction"], was["high"]))
    bracketed = begins.choose(h, was["bracketed"])
    width = (high - low) * bracketed
    g_low = [begins.choose(g, rises.choose(e, o)) for g, e, o in zip(was["g"], step.g, was["g_low"], strict=True)]
    g_high = [(begins | falls).choose(e, o) for e, o in zip(step.g, was["g_high"], strict=True)]
    part = h * 0.0 + 2.0
    for j in range(ng):
        a, b, da, db = (signed(guards.side, values, i) for i in (j, ng + j) for values in (g_low, g_high))
        part = (searches & guards.armed[j] & (b <= 0.0)).choose(smallest(crossing(a, b, da, db, width), part), part)
    tries = begins.choose(0.0, was["tries"] + 1.0)
    lost = searches & ((tries > float(MOST_TRIES)) | (part > 1.5))
    part = (tries > 8.0).choose(0.5, part)
    inside = low + part * (high - low)
    inside = ((inside > low) & (inside <= high)).choose(inside, 0.5 * (low + high))
    fraction = searches.choose(inside, was["fraction"])
    bracket = {"bracketed": [bracketed], "low": [low], "high": [high], "fraction": [fraction], "tries": [tries]}
    made.store(bracket | {"g_low": g_low, "g_high": g_high})
    return searches & ~lost, lost


def hermite_minimum(a: Value, da: Value, b: Value, db: Value) -> tuple[Value, Value]:
    """Place and value of the minimum of a cubic between a falling start and a rising end: see `toolbox.stepping.crossings.hermite_minimum`."""
    c2 = 3.0 * (b - a) - 2.0 * da - db
    c3 = 2.0 * (a - b) + da + db
    s = -da / (c2 + largest(c2 * c2 - 3.0 * c3 * da, 0.0).root())
    s = ((s > 0.0) & (s < 1.0)).choose(s, 0.5)
    return s, a + s * (da + s * (c2 + s * c3))


def crossing(a: Value, b: Value, da: Value, db: Value, width: Value) -> Value:
    """Return the fraction of a bracket at which a guard that falls from a > 0 to b <= 0 is zero. If the guard falls all the way, the
    inverse function is interpolated by cubic Hermite; otherwise the tangent at the end is used, which lies behind the zero."""
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
