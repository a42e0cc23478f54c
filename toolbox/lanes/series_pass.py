"""A pass of Taylor series: one call advances all lanes by one step, which ends where the first event of the lane is.

The coefficients of states and guards are written once (`toolbox.compilation.recurrences`); how far they reach, whether a guard falls through zero, where, and
where every state is then, are read off the polynomials, as in `toolbox.stepping.series_steps`. So no lane searches an event in passes of its own, and no lane
waits for another that does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from toolbox.compilation.formulas import ClosedEquations
from toolbox.compilation.power_series import LOOK_AHEAD
from toolbox.compilation.recurrences import solved
from toolbox.lanes.arrival import Verdicts, emit_arrival
from toolbox.lanes.extrema import SeriesPath, measure_step
from toolbox.lanes.layout import GOES_ON
from toolbox.lanes.polynomials import Falls, powers, scaled, stays_positive, total, turn, value_and_slope, value_at
from toolbox.lanes.trial_step import Pass, Step
from toolbox.lanes.vectors import Rows, Slot, Truth, Value, called, constant, largest, repeat_while_any, smallest, when_any
from toolbox.stepping.series_steps import GUARD_SHARE, SHARE, SLACK

POLISHES = 3
"""How often the end of a step is moved onto an event by the guard itself, at most."""


NEAR = 1e-7
"""Part of a step within which its end is moved along the slopes there, right to the square of it."""


@dataclass(frozen=True)
class Expansion:
    """The series of every lane at t.

    states, guards: coefficients, a list for each, guards positive before they are passed;  falls: the search in them;  reach: how far they reach;  h: the
    step, which ends at `stop` where `to_stop`;  finite: whether they are numbers;  unresolved: whether the step is too short to be taken.
    """

    was: Rows
    t: Value
    states: list[list[Value]]
    guards: list[list[Value]]
    side: list[Value | None]
    falls: Falls
    reach: Value
    h: Value
    stop: Value
    to_stop: Truth
    finite: Truth
    unresolved: Truth
    given: list[list[str]]


@dataclass(frozen=True)
class Crossings:
    """What the guards do over a step.

    first: the first fraction of it at which one is zero, 2 for none;  located: which;  odd: where the scalar loop has to look;  middle: the first fraction
    at which a slip comes closest to zero and turns, where friction laws have their peak, 2 for none.
    """

    first: Value
    located: Value
    odd: Truth
    middle: Value


@dataclass(frozen=True)
class End:
    """End of a step of length h: states, slopes and guards, and the residual of the equations as a fraction of the tolerance."""

    h: Value
    x: list[Value]
    k: list[Value]
    g: list[Value]
    error: Value


def series_pass(made: Pass) -> Value:
    """Write the pass; returns the flags."""
    body = made.body
    series = _expanded(made)
    was = series.was
    runs = ~was["flag"].differs(float(GOES_ON))
    sound = runs & series.finite & ~series.unresolved
    seen = _crossings(made, series, sound)
    odd = (runs & ~sound) | seen.odd
    fresh, hits = sound & ~seen.odd, seen.first <= 1.0
    end = _checked(made, series, seen, fresh, hits)
    good = end.error <= 1.0
    moves, refused = fresh & good, fresh & ~good
    never = made.never
    verdicts = Verdicts(moves & ~hits, moves & hits, moves, refused, never, never, never, never, odd)
    names = [value.name for value in end.x]
    step = Step(
        was, series.t, end.h, series.stop, series.reach, series.to_stop, never, never, never, series.unresolved, series.given, [], names, end.x, end.k, end.g,
        end.error,
    )  # fmt: skip
    logarithm = Value(body, body.rough_log2(end.error.name))  # of lanes whose step is refused alone, whose error is above 1
    factor = Value(body, body.rough_exp2((-made.program.formulas.power * logarithm).name))
    shrunk = end.h * (end.error < 1e30).choose(largest(0.9 * factor, 0.1), 0.1)
    found = emit_arrival(made, was, step, seen.located, verdicts, never)
    found["wanted"] = [refused.choose(shrunk, moves.choose(series.reach, was["wanted"]))]
    if made.count:
        path = SeriesPath(series.states, series.t, end.h, was)
        measure_step(made.observe, path, moves, made.windows(was), made.rows, was["rtol"])
    made.store(found)
    return found["flag"][0]


def _expanded(made: Pass) -> Expansion:
    """The coefficients, and the step that they allow."""
    body, n, ng, program = made.body, made.n, made.ng, made.program
    order = program.formulas.order
    was = made.loaded()
    t, stop = was["time"], was["stop"]
    given = [[value.name for value in was[item]] for item in ("x", "k", "p", "m")]
    look = was["wanted"] * LOOK_AHEAD
    weights = _weights(made, was)
    function = ClosedEquations(program.system.t, made.x, program.expressions[0], program.system.elements, program.form).with_guards
    table = solved(body, function, t.name, look.name, [given[0], *given[2:]], order)
    columns = [[Value(body, row[i] or body.number(0.0)) for row in table] for i in range(n + ng)]
    side, _ = made.sides(was)
    guards = [c if sign is None else [sign * value for value in c] for c, sign in zip(columns[n:], side, strict=True)]
    last = constant(body, 0.0)
    for column in columns:
        last = last + abs(column[-1])
    reach = was["rejected"].differs(0.0).choose(was["wanted"], _reach(made, was, columns[:n], guards, weights))
    wanted = smallest(reach, was["longest"])
    to_stop = (t + wanted >= stop) | (stop - (t + wanted) < 1e-3 * wanted)
    h = to_stop.choose(stop - t, wanted)
    unresolved = ~((h >= 1e-14 * abs(t)) & (h >= 1e-300))
    return Expansion(was, t, columns[:n], guards, side, Falls(body, order), reach, h, stop, to_stop, last < 1e300, unresolved, given)


def _reach(made: Pass, was: Rows, states: list[list[Value]], guards: list[list[Value]], weights: Weights) -> Value:
    """How far the last coefficients reach: see `toolbox.stepping.series_steps.open_series`."""
    body = made.body
    order = len(states[0]) - 1

    def logarithm(value: Value) -> Value:
        return Value(body, body.rough_log2(value.name))

    rtol = was["rtol"]
    zero = constant(body, 0.0)
    terms = [zero] * 4
    for c, weight in zip(states, weights.states, strict=False):
        terms = [largest(abs(c[order - back]) * weight, term) for back, term in enumerate(terms)]
    guard = zero
    for c, weight in zip(guards, weights.guards, strict=True):
        guard = largest(abs(c[-1]) * weight, guard)

    def allowed(back: int) -> Value:
        return (terms[back] > 0.0).choose(logarithm(terms[back]) * (-1.0 / (order - 1.0 - back)), 1e3)

    reach = Slot(smallest(allowed(0), allowed(1)))
    some, before = terms[0] > 0.0, was["wanted"]
    tenth = weights.tenth  # of an error that a tenth of the run may make
    leaps = ~(before > 0.0) | (reach.get() > 1.0 + logarithm(before))  # the last two may be zero alone

    def look() -> None:
        now, first = reach.get(), logarithm(terms[0])
        now = leaps.choose(smallest(now, SLACK + smallest(allowed(2), allowed(3))), now)
        now = (some & (now > tenth)).choose(largest(tenth, (first - tenth) * (-1.0 / order)), now)
        round_off = (logarithm(1e-14 * was["end"] / (SHARE * rtol)) - first) * (1.0 / order)
        reach.set((some & (rtol < 1e-10)).choose(largest(now, round_off), now))  # no less than round-off

    when_any(leaps | (reach.get() > tenth) | (rtol < 1e-10), look)
    found = (guard > 0.0).choose(smallest(reach.get(), logarithm(guard) * (-1.0 / order)), reach.get())
    return Value(body, body.rough_exp2(largest(smallest(found, 900.0), -900.0).name))


@dataclass(frozen=True)
class Weights:
    """Factors that scale the coefficients of states and guards by their tolerances. tenth: binary logarithm of a tenth of the run.

    Written before the coefficients: divisions take long, but nothing else waits for them.
    """

    states: list[Value]
    guards: list[Value]
    tenth: Value


def _weights(made: Pass, was: Rows) -> Weights:
    body, rtol, end = made.body, was["rtol"], was["end"]
    rate = SHARE * rtol / end
    states = [1.0 / (rate * _size(made, was, i) + was["noise"][i]) for i in range(made.own)]
    bound = GUARD_SHARE * rtol
    guards = [
        (size > 0.0).choose(1.0 / (bound * size), 0.0) for size in was["guard_scale"]
    ]  # of a slip that has just begun only states have a size
    return Weights(states, guards, Value(body, body.rough_log2((0.1 * end).name)))


def _size(made: Pass, was: Rows, i: int) -> Value:
    """Size of a state, with floors for one that is still small."""
    return largest(largest(was["scale"][i], 1e-10 * was["group_scale"][int(made.program.groups[i])]), 1e-14)


def _crossings(made: Pass, series: Expansion, sound: Truth) -> Crossings:
    """What the guards do over the step: see `toolbox.stepping.series_steps.watch_series`."""
    body, program, ne, was, h = made.body, made.program, made.ne, series.was, series.h
    first, located, odd = (Slot(constant(body, number)) for number in (2.0, 0.0, 0.0))
    middle = Slot(constant(body, 2.0))
    power = powers(h, len(series.guards[0]) - 1) if series.guards else []
    for j, own in enumerate(series.guards):
        c = scaled(own, power)
        unsafe = sound & ~stays_positive(c)
        if j < 2 * ne and j % 2 == 0 and program.system.elements[j // 2].holds:
            _emit_turn(c, sound & was["m"][j // 2].differs(0.0), middle)

        def look(j: int = j, c: list[Value] = c, unsafe: Truth = unsafe) -> None:
            armed, size = was["armed"][j].differs(0.0), was["guard_scale"][j]
            end, zero = total(c), constant(body, 0.0)
            begins, creeps = unsafe & armed & (c[0] > 0.0), unsafe & ~armed & (end > 0.0)
            wrong = unsafe & ((armed & (c[0] <= 0.0) & (c[1] < 0.0)) | (~armed & (end < -1e-12 * size)))
            later, latest = [*c[1:], zero], [*c[2:], zero, zero]
            rises = c[1] > 0.0  # what begins at zero is divided by time, or by its square
            shown = [armed.choose(a, rises.choose(b, d)) for a, b, d in zip(c, later, latest, strict=True)]
            place = series.falls.first(shown, begins | creeps, (begins & (end > 0.0)).choose(0.5, 1.0))
            falls = place <= 1.0
            if j < 2 * ne and program.system.elements[j // 2].rigid:  # how deep an impact is located decides which bounce is the last
                wrong |= falls
            elif program.table_slot and (
                j < 2 * ne or j >= made.ng - len(program.bounded)
            ):  # at its bound where an input turns: what follows decides
                wrong |= series.to_stop & armed & (end <= 0.0) & (end >= -1e-12 * size)
            odd.set((wrong | (creeps & falls)).choose(1.0, odd.get()))
            sooner = begins & (place < first.get())
            first.set(sooner.choose(place, first.get()))
            located.set(sooner.choose(float(j), located.get()))

        when_any(unsafe, look)
    return Crossings(first.get(), located.get(), odd.get().differs(0.0), middle.get())


def _emit_turn(c: list[Value], slips: Truth, middle: Slot) -> None:
    """Write where a slip first comes closest to zero and turns to `middle`, in parts of the step, unless that is before it."""
    ends = total(c), total([value * float(k) for k, value in enumerate(c)][1:])
    turns = slips & (c[1] < 0.0) & (ends[1] > 0.0)
    when_any(turns, lambda: middle.set(turns.choose(smallest(turn(c, ends), middle.get()), middle.get())))


def _checked(made: Pass, series: Expansion, seen: Crossings, fresh: Truth, hits: Truth) -> End:
    """The end of a step, checked against the field where a slip turns inside it and there, and moved onto an event until the guard itself is zero.

    A lane whose step is checked already has it checked again, with the same bits, while others go on: see
    `toolbox.stepping.series_steps.checked_end`.
    """
    body, was, n, ng = made.body, series.was, made.n, made.ng
    size = hits.choose(seen.first * series.h, series.h)
    middle = seen.middle * series.h
    turning = middle < size
    place, error = Slot(turning.choose(middle, size)), Slot(constant(body, 0.0))
    stage = Slot(turning.choose(0.0, 1.0))  # at a turn; at the end; polished so many times
    found: list[End] = []
    others = [[Value(body, name) for name in column] for column in series.given[2:]]

    def look() -> Truth:
        h, now = place.get(), stage.get()
        ends = [value_and_slope(c, h) for c in series.states]
        x = [value for value, _ in ends]
        field = called(made.field, series.t + h, x, *others)
        k, g = field[:n], field[n:]
        shown = [value_at(c, h) for c in series.guards]
        parts = _defect(made, series, h, (x, [slope for _, slope in ends]), shown, (k, g))
        good = fresh & (now > 1.5)  # an end that is moved has been checked
        checked = fresh
        for off, most in parts:
            checked &= off <= most  # not where one is NaN
        good |= checked

        def measure() -> None:
            worst = constant(body, 1.5)
            for off, most in parts:
                ratio = off / most
                worst = (ratio <= worst).choose(worst, ratio)
            error.set((fresh & ~good).choose(worst, error.get()))

        when_any(fresh & ~good, measure)
        turned = good & ~now.differs(0.0)
        value, slope, close = constant(body, 0.0), constant(body, 0.0), constant(body, 0.0)
        nearness = smallest(largest(1e-5 * was["rtol"], 1e-13), 1e-9)
        for j in range(ng):
            this, sign = ~seen.located.differs(float(j)), series.side[j]
            own = [g[j], g[ng + j]] if sign is None else [sign * g[j], sign * g[ng + j]]
            value, slope, close = (
                this.choose(a, b) for a, b in zip((*own, nearness * was["guard_scale"][j]), (value, slope, close), strict=True)
            )
        move = -value / slope
        moves = good & hits & (now > 0.5) & (now < POLISHES + 0.5) & (abs(value) > close) & (slope < 0.0) & (abs(move) <= 0.1 * h)
        near = abs(move) <= NEAR * h
        again = turned | (moves & ~near)
        place.set(turned.choose(size, again.choose(h + move, h)))
        stage.set(again.choose(now + 1.0, now))
        move = (moves & near).choose(move, 0.0)
        x, g[:ng] = ([a + move * rate for a, rate in zip(column, rates, strict=True)] for column, rates in ((x, k), (g[:ng], g[ng:])))
        found[:] = [End(h + move, x, k, g, error.get())]
        return again

    repeat_while_any(body, look)
    return found[0]


def _defect(
    made: Pass,
    series: Expansion,
    h: Value,
    end: tuple[list[Value], list[Value]],
    shown: list[Value],
    field: tuple[list[Value], list[Value]],
) -> list[tuple[Value, Value]]:
    """How far a step h is from the equations, and how far it may be: see `toolbox.stepping.series_steps.defect`.

    end: states and slopes;  shown: guards;  field: slopes and guards.
    """
    was = series.was
    (x, slopes), (k, g) = end, field
    order = len(series.states[0]) - 1
    share = SHARE * largest(was["rtol"] * smallest(h / was["end"], 0.1), 1e-14)
    parts = []
    for i in range(made.own):
        size = largest(_size(made, was, i), abs(x[i]))
        parts.append((abs(k[i] - slopes[i]) * h, float(order) * (share * size + was["noise"][i] * h)))
    for j in range(made.ng):
        value = g[j] if (sign := series.side[j]) is None else sign * g[j]
        size = largest(was["guard_scale"][j], abs(value))
        parts.append((abs(value - shown[j]), (size > 0.0).choose(was["rtol"] * size, math.inf)))
    return parts
