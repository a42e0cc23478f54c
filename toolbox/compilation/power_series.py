"""Taylor coefficients of casadi expressions along the solution of x' = f, written as machine code.

With u(t + s) = sum u_k s^k every operation has a recurrence that gives its coefficient k from those of its arguments up to k and its own below k (A.
Jorba, M. Zou,
A software package for the numerical integration of ODEs by means of high-order Taylor methods, Experimental Mathematics 14 (2005) 99-117). Products are sums

    (u v)_k = sum_{j=0..k} u_j v_{k-j}

and an elementary function follows from the linear equation that its derivative fulfils, for example w = exp(u) from w' = w u'. What does not change in
time, such as
the modes, has a coefficient 0 only, and a factor like that costs one multiplication per order.

A kink, of fabs, fmin or fmax, takes the side on which the solution is just after t: that of the argument, or of its first coefficient that weighs more
where the argument
is zero but for round-off. The event loop ends steps on kinks, so that a side lasts for a step.

The newest coefficients enter a sum last, since they are what the next order waits for, and constant factors are multiplied with each other first.
"""

from __future__ import annotations

from collections.abc import Sequence

from toolbox.compilation.emitter import FLAGS, Body

LOOK_AHEAD = 1e-6
"""Part of a step within which an argument of a kink that crosses zero counts as zero."""

DEPTH = 3
"""Coefficients that may decide on which side of a kink the solution is."""

Value = str | None


class NoSeries(Exception):
    """An operation has no Taylor coefficients: it jumps."""


class Series:
    """Taylor coefficients of a value, as names in a body; None is zero. A constant value has coefficient 0 only."""

    def __init__(self, body: Body, first: Value, varies: bool):
        self.body = body
        self.c: list[Value] = [first]
        self.varies = varies

    def extend(self) -> None:
        """Append the next coefficient."""
        k = len(self.c)
        self.c.append(self.next(k) if self.varies else None)

    def next(self, k: int) -> Value:
        """Return coefficient k from the known coefficients."""
        raise NotImplementedError

    def at(self, k: int) -> Value:
        """Coefficient k, None where it is zero."""
        return self.c[k] if k < len(self.c) else None


class State(Series):
    """A state, or time: coefficients are given from outside."""

    def next(self, k: int) -> Value:
        raise AssertionError("coefficients of states are given")


def add(body: Body, a: Value, b: Value) -> Value:
    """a + b."""
    return a if b is None else b if a is None else body.add(a, b)


def subtract(body: Body, a: Value, b: Value) -> Value:
    """a - b."""
    if b is None:
        return a
    return negative(body, b) if a is None else body.value(f"fsub {FLAGS} {body.type} {a}, {b}")


def negative(body: Body, a: Value) -> Value:
    """-a."""
    return None if a is None else body.value(f"fneg {FLAGS} {body.type} {a}")


def multiply(body: Body, a: Value, b: Value) -> Value:
    """a b."""
    return None if a is None or b is None else body.mul(a, b)


def scaled(body: Body, a: Value, factor: float) -> Value:
    """a times a number."""
    return a if a is None or factor == 1.0 else body.mul(a, body.number(factor))


def _inverse(body: Body, a: Value, numerator: float = 1.0) -> str:
    return body.value(f"fdiv {FLAGS} {body.type} {body.number(numerator)}, {a or body.number(0.0)}")


def _plus_product(body: Body, total: Value, a: Value, b: Value) -> Value:
    """total + a b."""
    if a is None or b is None:
        return total
    return body.mul(a, b) if total is None else body.intrinsic("fmuladd", a, b, total)


def _products(body: Body, a: Sequence[Value], b: Sequence[Value], k: int, first: int, last: int, total: Value = None) -> Value:
    """total + sum of a_j b_{k-j} for j from first to last, the oldest coefficients first."""
    for j in sorted(range(first, last + 1), key=lambda j: max(j, k - j)):
        if j < len(a) and k - j < len(b):
            total = _plus_product(body, total, a[j], b[k - j])
    return total


class Sum(Series):
    """a + b, or a - b."""

    def __init__(self, body: Body, first: Value, a: Series, b: Series, minus: bool):
        super().__init__(body, first, a.varies or b.varies)
        self.a, self.b, self.minus = a, b, minus

    def next(self, k: int) -> Value:
        return (subtract if self.minus else add)(self.body, self.a.at(k), self.b.at(k))


class Multiple(Series):
    """A value times what does not change."""

    def __init__(self, body: Body, first: Value, a: Series, factor: Value):
        super().__init__(body, first, a.varies)
        self.a, self.factor = a, factor

    def next(self, k: int) -> Value:
        return multiply(self.body, self.a.at(k), self.factor)


def unscaled(u: Series) -> tuple[Series, Value]:
    """Return (v, factor) with u = factor * v; (u, None) if u is no multiple."""
    return (u.a, u.factor) if isinstance(u, Multiple) else (u, None)


class Negative(Series):
    """-a."""

    def __init__(self, body: Body, first: Value, a: Series):
        super().__init__(body, first, a.varies)
        self.a = a

    def next(self, k: int) -> Value:
        return negative(self.body, self.a.at(k))


class Same(Series):
    """A value whose first coefficient alone is another."""

    def __init__(self, body: Body, first: Value, a: Series):
        super().__init__(body, first, a.varies)
        self.a = a

    def next(self, k: int) -> Value:
        return self.a.at(k)


class Product(Series):
    """a b with both that change."""

    def __init__(self, body: Body, first: Value, a: Series, b: Series):
        super().__init__(body, first, True)
        self.a, self.b = a, b

    def next(self, k: int) -> Value:
        body, a, b = self.body, self.a.c, self.b.c
        if self.a is self.b:
            return _square(body, a, k)
        total = _products(body, a, b, k, 1, k - 1)
        return _plus_product(body, _plus_product(body, total, a[0], b[k]), a[k], b[0])


def _square(body: Body, a: Sequence[Value], k: int, ends: bool = True) -> Value:
    """Coefficient k of a^2; without ends without the terms of a_0."""
    total = _products(body, a, a, k, 1, (k - 1) // 2)
    total = add(body, total, total)
    if k % 2 == 0:
        total = _plus_product(body, total, a[k // 2], a[k // 2])
    return _plus_product(body, total, add(body, a[0], a[0]), a[k]) if ends else total


class Quotient(Series):
    """a / b with b that changes: b q = a."""

    def __init__(self, body: Body, first: Value, a: Series, b: Series):
        super().__init__(body, first, True)
        self.a, self.b = a, b
        self.inverse = _inverse(body, b.c[0])

    def next(self, k: int) -> Value:
        total = _products(self.body, self.b.c, self.c, k, 1, k)
        return multiply(self.body, subtract(self.body, self.a.at(k), total), self.inverse)


class Root(Series):
    """sqrt(a): s^2 = a."""

    def __init__(self, body: Body, first: str, a: Series):
        super().__init__(body, first, True)
        self.a = a
        self.half = _inverse(body, first, 0.5)

    def next(self, k: int) -> Value:
        return multiply(self.body, subtract(self.body, self.a.at(k), _square(self.body, self.c, k, ends=False)), self.half)


class _Slope(Series):
    """Coefficient j of a value, times j."""

    def __init__(self, body: Body, a: Series):
        super().__init__(body, None, a.varies)
        self.a = a

    def next(self, k: int) -> Value:
        return scaled(self.body, self.a.at(k), float(k))


class Integral(Series):
    """w with w' = factor * r u'. The coefficients of r are known to the order before."""

    def __init__(self, body: Body, first: Value, u: Series, rate: Series | None, factor: float = 1.0, also: str | None = None):
        super().__init__(body, first, True)
        self.u, self.slope, self.rate, self.factor, self.also = u, _Slope(body, u), rate or self, factor, also
        self.newest: Value = None

    def next(self, k: int) -> Value:
        self.slope.extend()
        # the newest coefficient of u without its factor k, which the division by k takes back
        rate = self.rate.c if self.rate is not self or self.also is None else [self.also, *self.c[1:]]
        total = _products(self.body, self.slope.c, rate, k, 1, k - 1)
        total = scaled(self.body, total, self.factor / k)
        base, factor = unscaled(self.u)
        if k == 1:
            self.newest = scaled(self.body, rate[0], self.factor)
            self.newest = multiply(self.body, self.newest, factor) if factor else self.newest
        return _plus_product(self.body, total, base.at(k), self.newest)


class Divided(Series):
    """w with d w' = sum of pairs (a u'), a None for one: of logarithms and inverse functions."""

    def __init__(self, body: Body, first: Value, d: Series, pairs: Sequence[tuple[Series | None, Series]], sign: float = 1.0):
        super().__init__(body, first, True)
        self.d, self.pairs, self.sign = d, [(a, u, _Slope(body, u)) for a, u in pairs], sign
        self.inverse = _inverse(body, d.c[0], sign)
        self.own: list[Value] = [None]

    def next(self, k: int) -> Value:
        body = self.body
        if k > 1:
            self.own.append(scaled(body, self.c[k - 1], float(k - 1)))
        total = _products(body, self.own, self.d.c, k, 1, k - 1)
        total = scaled(body, total, -self.sign / k)
        for a, u, slope in self.pairs:
            slope.extend()
            if a is None:
                total = add(body, total, u.at(k))
            else:
                part = _products(body, slope.c, a.c, k, 1, k)
                total = add(body, total, scaled(body, part, 1.0 / k))
        return multiply(body, total, self.inverse)


class Power(Series):
    """u^a with an exponent that does not change: u w' = a w u'."""

    def __init__(self, body: Body, first: str, u: Series, exponent: str):
        super().__init__(body, first, True)
        self.u, self.exponent, self.slope = u, exponent, _Slope(body, u)
        self.inverse = _inverse(body, u.c[0])
        self.own: list[Value] = [None]

    def next(self, k: int) -> Value:
        body = self.body
        self.slope.extend()
        if k > 1:
            self.own.append(scaled(body, self.c[k - 1], float(k - 1)))
        gain = multiply(body, _products(body, self.slope.c, self.c, k, 1, k), self.exponent)
        loss = _products(body, self.own, self.u.c, k, 1, k - 1)
        return multiply(body, scaled(body, subtract(body, gain, loss), 1.0 / k), self.inverse)


class Sided(Series):
    """A value chosen from two values by the sign of the argument of a kink just after the start. fabs(a) is a or -a."""

    def __init__(self, body: Body, first: str, argument: Series, above: Series, below: Series, look: str):
        super().__init__(body, first, True)
        self.argument, self.above, self.below, self.look = argument, above, below, look
        self.weight = argument.c[0]
        self.scale: Value = None
        self.flag = ""

    def next(self, k: int) -> Value:
        body = self.body
        if k <= DEPTH:
            self.scale = self.look if self.scale is None else body.mul(self.scale, self.look)
            term = multiply(body, self.argument.at(k), self.scale)
            if self.weight is None:
                self.weight = term
            elif term is not None:
                larger = body.compare("ogt", body.intrinsic("fabs", term), body.intrinsic("fabs", self.weight))
                self.weight = body.select(larger, term, self.weight)
            self.flag = body.compare("oge", self.weight or body.number(0.0), body.number(0.0))
        above, below = self.above.at(k), self.below.at(k)
        if above is None and below is None:
            return None
        return body.select(self.flag, above or body.number(0.0), below or body.number(0.0))


class DenseSystem:
    """Unknowns y of A y = r with a constant matrix. Each coefficient of r gives the coefficient of y by a solution with the same
    factors."""

    def __init__(self, body: Body, n: int, matrix: Sequence[Series], right: Sequence[Series]):
        self.body, self.n, self.right = body, n, right
        self.matrix = tuple(entry.c[0] or body.number(0.0) for entry in matrix)
        self.rows: list[Sequence[Value]] = []
        self.row(0)

    def row(self, k: int) -> Sequence[Value]:
        """Coefficient k of all unknowns."""
        if k == len(self.rows):
            given = [series.at(k) for series in self.right]
            zero = self.body.number(0.0)
            self.rows.append(self.body.dense_solution(self.n, self.matrix, [r or zero for r in given]) if any(given) else given)
        return self.rows[k]


class Unknown(Series):
    """One unknown of a dense system."""

    def __init__(self, system: DenseSystem, i: int):
        super().__init__(system.body, system.row(0)[i], any(series.varies for series in system.right))
        self.system, self.i = system, i

    def next(self, k: int) -> Value:
        return self.system.row(k)[self.i]
