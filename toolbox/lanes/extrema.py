"""Signals measured as lanes step: extrema and integrals in windows, on the dense output of every step or on its series.

A signal is read at both ends of a step and at Gauss points: at five, which integrate a polynomial of degree nine exactly, on the steps of DOP853, and
at eight on those of Taylor series, which are about twice as long. Where a rule on all of these places but the middle one is far from it, the step may be too
long for what the signal does in it: its lane is marked as doubtful.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from operator import or_
from typing import Any

import casadi as ca
import numpy as np

from toolbox.compilation.emitter import inline
from toolbox.compilation.explicit_step import RungeKutta
from toolbox.compilation.runge_kutta import DOP853_DENSE, DOP853_MORE_A, DOP853_MORE_C
from toolbox.compilation.vector_emitter import VectorBody
from toolbox.lanes.polynomials import value_at
from toolbox.lanes.vectors import Rows, Truth, Value, called, largest, when_any


class Rule:
    """Fractions of a step at which signals are measured: Gauss points and both ends. `weights` belong to all points, `coarse` to the rule
    without the middle point."""

    def __init__(self, points: int) -> None:
        inner, weights = (0.5 * (column + shift) for column, shift in zip(np.polynomial.legendre.leggauss(points), (1.0, 0.0), strict=True))
        self.places = (0.0, *inner.tolist(), 1.0)
        self.weights = (0.0, *weights.tolist(), 0.0)
        middle = (points + 1) // 2
        fewer = np.delete(self.places, middle)
        coarse = np.linalg.solve(np.vander(fewer, increasing=True).T, 1.0 / np.arange(1, points + 2))
        self.coarse = tuple(np.insert(coarse, middle, 0.0).tolist())


_DOUBT = 0.02
"""Difference of the two rules, in parts of the range of the signal over the step, beyond which its extrema may be others than those found."""


def measure_step(
    observe: ca.Function, path: Path | SeriesPath, moves: Truth, windows: list[tuple[Value, Value]], rows: dict[str, int], rtol: Value
) -> None:
    """Write what adds a step to the extrema and integrals in the rows `measured` (signal by signal, window by window) of the lanes that move.

    A step belongs to the windows (after, until) in which it begins: the loop ends steps on their edges.
    """
    body = path.t.body
    inside, somewhere = steps_inside(windows, path.t, moves)

    def write() -> None:
        path.begin()
        doubtful = path.h < -1.0
        for q in range(observe.numel_out(0)):
            low, high, integral, doubt = _measured(path.signal(observe, q), path.rule, path.h, rtol)
            doubtful |= doubt
            for w, within in enumerate(inside):
                place = rows["measured"] + 3 * (q * len(windows) + w)
                add_step(within, place, so_far(body, place), low, high, integral)
        before = Value(body, body.load("%lanes", rows["doubt"]))
        body.store((somewhere & doubtful).choose(1.0, before).name, "%lanes", rows["doubt"])

    when_any(somewhere, write)


def steps_inside(windows: list[tuple[Value, Value]], t: Value, moves: Truth) -> tuple[list[Truth], Truth]:
    """Return the lanes whose step from t belongs to each window, and the lanes whose step belongs to any window."""
    inside = [moves & (t >= after) & (t < until) for after, until in windows]
    return inside, reduce(or_, inside)


def so_far(body: VectorBody, place: int) -> list[Value]:
    """Minimum, maximum and integral of a signal in a window, from the rows at a place on."""
    return [Value(body, body.load("%lanes", place + i)) for i in range(3)]


def add_step(within: Truth, place: int, before: list[Value], low: Value, high: Value, integral: Value) -> None:
    """Merge the extrema and the integral of a step into the rows at a place. before: values of these rows."""
    lowest, highest, total = before
    merged = (
        (within & (low < lowest)).choose(low, lowest),
        (within & (high > highest)).choose(high, highest),
        total + within.choose(integral, 0.0),
    )
    for i, value in enumerate(merged):
        within.body.store(value.name, "%lanes", place + i)


class Path:
    """The dense output of a step of DOP853, of order 7."""

    rule = Rule(5)

    def __init__(
        self,
        formulas: RungeKutta,
        rhs: ca.Function,
        t: Value,
        h: Value,
        was: Rows,
        slopes: list[list[str]],
        x: list[Value],
        k: list[Value],
    ) -> None:
        assert formulas.interpolates
        self.rhs, self.t, self.h, self.start, self.slope = rhs, t, h, was["x"], was["k"]
        self.others = [was[name][:] for name in ("p", "m")]
        self.slopes, self.x, self.k = slopes, x, k
        self.terms: list[list[Value]] = []

    def begin(self) -> None:
        """Write the coefficients."""
        body, t, h, x, k = self.t.body, self.t, self.h, self.x, self.k
        stages_so_far = [*self.slopes, [value.name for value in k]]
        names = [value.name for value in self.start]
        for c, row in zip(DOP853_MORE_C, DOP853_MORE_A, strict=True):
            stage = [body.combination(names[i], h.name, row, [k[i] for k in stages_so_far]) for i in range(len(x))]
            stages_so_far += inline(body, self.rhs, [[(t + c * h).name], stage, *([each.name for each in other] for other in self.others)])
        for i in range(len(x)):
            rise, first = x[i] - self.start[i], h * self.slope[i]
            last = [Value(body, body.combination("", h.name, row, [k[i] for k in stages_so_far])) for row in DOP853_DENSE]
            self.terms.append([rise, first - rise, 2.0 * rise - first - h * k[i], *last])

    def signal(self, observe: ca.Function, which: int) -> Callable[[Any], Value]:
        """Return a signal as a function of the fraction of the step."""

        def at(fraction: Any) -> Value:
            rest = 1.0 - fraction
            x = []
            for start, terms in zip(self.start, self.terms, strict=True):
                value = terms[-1] * fraction
                for i, term in enumerate(reversed(terms[:-1])):
                    value = (value + term) * (rest if i % 2 == 0 else fraction)
                x.append(value + start)
            return called(observe, self.t + self.h * fraction, x, *self.others)[which]

        return at


class SeriesPath:
    """The polynomials of a step of Taylor series."""

    rule = Rule(8)

    def __init__(self, states: list[list[Value]], t: Value, h: Value, was: Rows) -> None:
        self.states, self.t, self.h = states, t, h
        self.others = [was[name][:] for name in ("p", "m")]

    def begin(self) -> None:
        """Write nothing: the coefficients are there."""

    def signal(self, observe: ca.Function, which: int) -> Callable[[Any], Value]:
        """Return a signal as a function of the fraction of the step."""

        def at(fraction: Any) -> Value:
            s = self.h * fraction
            return called(observe, self.t + s, [value_at(c, s) for c in self.states], *self.others)[which]

        return at


def _measured(signal: Callable[[Any], Value], rule: Rule, h: Value, rtol: Value) -> tuple[Value, Value, Value, Truth]:
    """Minimum, maximum and integral of a signal over a step, the extrema refined by parabolas, and where they are doubtful."""
    places = rule.places
    values = [signal(place) for place in places]
    integral, coarse = (
        sum((value * (h * float(weight)) for value, weight in zip(values, weights, strict=True) if weight), h * 0.0)
        for weights in (rule.weights, rule.coarse)
    )
    found = []
    for sign in (-1.0, 1.0):
        best = (sign * values[-1] > sign * values[0]).choose(values[-1], values[0])
        zero = h * 0.0
        triple = [(zero + places[i], values[i]) for i in range(3)]
        for i in range(2, len(places) - 1):
            higher = sign * values[i] > sign * triple[1][1]
            triple = [(higher.choose(places[i + k], triple[1 + k][0]), higher.choose(values[i + k], triple[1 + k][1])) for k in (-1, 0, 1)]
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
    low, high = found
    size = largest(abs(low), abs(high))
    doubt = (abs(integral - coarse) > _DOUBT * abs(h) * (high - low)) & (high - low > 10.0 * rtol * size)
    return low, high, integral, doubt
