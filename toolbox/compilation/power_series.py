"""Taylor coefficients of casadi expressions along the solution of x' = f, written as machine code.

With u(t + s) = sum u_k s^k every operation has a recurrence that gives its coefficient k from those of its arguments up to k and its own below k (A. Jorba, M. Zou,
A software package for the numerical integration of ODEs by means of high-order Taylor methods, Experimental Mathematics 14 (2005) 99-117). Products are sums

    (u v)_k = sum_{j=0..k} u_j v_{k-j}

and an elementary function follows from the linear equation that its derivative fulfils, for example w = exp(u) from w' = w u'. What does not change in time, such as
the modes, has a coefficient 0 only, and a factor like that costs one multiplication per order.

A kink, of fabs, fmin or fmax, takes the side on which the solution is just after t: that of the argument, or of its first coefficient that weighs more where the argument
is zero but for round-off. The event loop ends steps on kinks, so that a side lasts for a step.

The newest coefficients enter a sum last, since they are what the next order waits for, and constant factors are multiplied with each other first.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from toolbox.compilation.emitter import FLAGS, Body, literal, operation

LOOK_AHEAD = 1e-6
"""Part of a step within which an argument of a kink that crosses zero counts as zero."""

DEPTH = 3
"""Coefficients that may decide on which side of a kink the solution is."""

_WHOLE = 8
"""Largest whole exponent that is written as products, which hold at zero, too."""

Value = str | None


class NoSeries(Exception):
    """An operation has no Taylor coefficients: it jumps."""


class Series:
    """Coefficients of one value, as names in a body; None is zero. One that does not change has coefficient 0 alone."""

    def __init__(self, body: Body, first: Value, varies: bool):
        self.body = body
        self.c: list[Value] = [first]
        self.varies = varies

    def extend(self) -> None:
        """Append the next coefficient."""
        k = len(self.c)
        self.c.append(self.next(k) if self.varies else None)

    def next(self, k: int) -> Value:
        """Coefficient k from what is known."""
        raise NotImplementedError

    def at(self, k: int) -> Value:
        return self.c[k] if k < len(self.c) else None


class State(Series):
    """A state, or time: coefficients are given from outside."""

    def next(self, k: int) -> Value:
        raise AssertionError("coefficients of states are given")


def _add(body: Body, a: Value, b: Value) -> Value:
    return a if b is None else b if a is None else body.add(a, b)


def _subtract(body: Body, a: Value, b: Value) -> Value:
    if b is None:
        return a
    return _negative(body, b) if a is None else body.value(f"fsub {FLAGS} {body.type} {a}, {b}")


def _negative(body: Body, a: Value) -> Value:
    return None if a is None else body.value(f"fneg {FLAGS} {body.type} {a}")


def _multiply(body: Body, a: Value, b: Value) -> Value:
    return None if a is None or b is None else body.mul(a, b)


def _scaled(body: Body, a: Value, factor: float) -> Value:
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


class _Sum(Series):
    def __init__(self, body: Body, first: Value, a: Series, b: Series, minus: bool):
        super().__init__(body, first, a.varies or b.varies)
        self.a, self.b, self.minus = a, b, minus

    def next(self, k: int) -> Value:
        return (_subtract if self.minus else _add)(self.body, self.a.at(k), self.b.at(k))


class _Multiple(Series):
    """A value times what does not change."""

    def __init__(self, body: Body, first: Value, a: Series, factor: Value):
        super().__init__(body, first, a.varies)
        self.a, self.factor = a, factor

    def next(self, k: int) -> Value:
        return _multiply(self.body, self.a.at(k), self.factor)


def _unscaled(u: Series) -> tuple[Series, Value]:
    """The value of which u is a multiple, and the factor; u itself and None where it is no multiple."""
    return (u.a, u.factor) if isinstance(u, _Multiple) else (u, None)


class _Negative(Series):
    def __init__(self, body: Body, first: Value, a: Series):
        super().__init__(body, first, a.varies)
        self.a = a

    def next(self, k: int) -> Value:
        return _negative(self.body, self.a.at(k))


class _Same(Series):
    """A value whose first coefficient alone is another."""

    def __init__(self, body: Body, first: Value, a: Series):
        super().__init__(body, first, a.varies)
        self.a = a

    def next(self, k: int) -> Value:
        return self.a.at(k)


class _Product(Series):
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
    total = _add(body, total, total)
    if k % 2 == 0:
        total = _plus_product(body, total, a[k // 2], a[k // 2])
    return _plus_product(body, total, _add(body, a[0], a[0]), a[k]) if ends else total


class _Quotient(Series):
    """a / b with b that changes: b q = a."""

    def __init__(self, body: Body, first: Value, a: Series, b: Series):
        super().__init__(body, first, True)
        self.a, self.b = a, b
        self.inverse = _inverse(body, b.c[0])

    def next(self, k: int) -> Value:
        total = _products(self.body, self.b.c, self.c, k, 1, k)
        return _multiply(self.body, _subtract(self.body, self.a.at(k), total), self.inverse)


class _Root(Series):
    """sqrt(a): s^2 = a."""

    def __init__(self, body: Body, first: str, a: Series):
        super().__init__(body, first, True)
        self.a = a
        self.half = _inverse(body, first, 0.5)

    def next(self, k: int) -> Value:
        return _multiply(self.body, _subtract(self.body, self.a.at(k), _square(self.body, self.c, k, ends=False)), self.half)


class _Slope(Series):
    """Coefficient j of a value, times j."""

    def __init__(self, body: Body, a: Series):
        super().__init__(body, None, a.varies)
        self.a = a

    def next(self, k: int) -> Value:
        return _scaled(self.body, self.a.at(k), float(k))


class _Integral(Series):
    """w with w' = r u', where r is known one order behind, times a factor."""

    def __init__(self, body: Body, first: Value, u: Series, rate: Series | None, factor: float = 1.0, also: str | None = None):
        super().__init__(body, first, True)
        self.u, self.slope, self.rate, self.factor, self.also = u, _Slope(body, u), rate or self, factor, also
        self.newest: Value = None

    def next(self, k: int) -> Value:
        self.slope.extend()
        # the newest coefficient of u without its factor k, which the division by k takes back
        rate = self.rate.c if self.rate is not self or self.also is None else [self.also, *self.c[1:]]
        total = _products(self.body, self.slope.c, rate, k, 1, k - 1)
        total = _scaled(self.body, total, self.factor / k)
        base, factor = _unscaled(self.u)
        if k == 1:
            self.newest = _scaled(self.body, rate[0], self.factor)
            self.newest = _multiply(self.body, self.newest, factor) if factor else self.newest
        return _plus_product(self.body, total, base.at(k), self.newest)


class _Divided(Series):
    """w with d w' = sum of pairs (a u'), a None for one: of logarithms and inverse functions."""

    def __init__(self, body: Body, first: Value, d: Series, pairs: Sequence[tuple[Series | None, Series]], sign: float = 1.0):
        super().__init__(body, first, True)
        self.d, self.pairs, self.sign = d, [(a, u, _Slope(body, u)) for a, u in pairs], sign
        self.inverse = _inverse(body, d.c[0], sign)
        self.own: list[Value] = [None]

    def next(self, k: int) -> Value:
        body = self.body
        if k > 1:
            self.own.append(_scaled(body, self.c[k - 1], float(k - 1)))
        total = _products(body, self.own, self.d.c, k, 1, k - 1)
        total = _scaled(body, total, -self.sign / k)
        for a, u, slope in self.pairs:
            slope.extend()
            if a is None:
                total = _add(body, total, u.at(k))
            else:
                part = _products(body, slope.c, a.c, k, 1, k)
                total = _add(body, total, _scaled(body, part, 1.0 / k))
        return _multiply(body, total, self.inverse)


class _Power(Series):
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
            self.own.append(_scaled(body, self.c[k - 1], float(k - 1)))
        gain = _multiply(body, _products(body, self.slope.c, self.c, k, 1, k), self.exponent)
        loss = _products(body, self.own, self.u.c, k, 1, k - 1)
        return _multiply(body, _scaled(body, _subtract(body, gain, loss), 1.0 / k), self.inverse)


class _Sided(Series):
    """One of two values, by the side on which a kink's argument is just after the start; fabs(a) is one of a and -a."""

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
            term = _multiply(body, self.argument.at(k), self.scale)
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


class Recurrences:
    """The instructions of an SX function as series in a body: `extend` writes the next coefficient of each."""

    def __init__(self, body: Body, function: ca.Function, arguments: Sequence[Sequence[Series]], look: str):
        """arguments: one sequence of series per input;  look: the time within which a kink counts as passed. Raises NoSeries."""
        self.body, self.look = body, look
        self.made: list[Series] = []
        self._zero = Series(body, None, False)
        work: dict[int, Series] = {}
        numbers: dict[int, float] = {}
        self.outputs: list[list[Series]] = [[self._zero] * function.nnz_out(i) for i in range(function.n_out())]
        for q in range(function.n_instructions()):
            op, args, target = function.instruction_id(q), function.instruction_input(q), function.instruction_output(q)
            if op == ca.OP_INPUT:
                work[target[0]] = arguments[args[0]][args[1]]
                numbers.pop(target[0], None)
            elif op == ca.OP_OUTPUT:
                self.outputs[target[0]][target[1]] = work[args[0]]
            elif op == ca.OP_CONST:
                number = function.instruction_constant(q)
                work[target[0]] = Series(body, body.number(number) if number else None, False)
                numbers[target[0]] = number
            else:
                number_of = [numbers.get(a) for a in args]
                work[target[0]] = self._apply(op, [work[a] for a in args], number_of)
                numbers.pop(target[0], None)

    def extend(self) -> None:
        """Write the next coefficient of every series."""
        for series in self.made:
            series.extend()

    def _keep(self, series: Series) -> Series:
        if series.varies:
            self.made.append(series)
        return series

    def _first(self, op: int, values: Sequence[Series]) -> str:
        return operation(self.body, op, [v.c[0] or self.body.number(0.0) for v in values])

    def _sq(self, u: Series) -> Series:
        return self._keep(_Product(self.body, self._first(ca.OP_SQ, [u]), u, u))

    def _offset(self, u: Series, first: str) -> Series:
        return self._keep(_Same(self.body, first, u))

    def _one_plus(self, u: Series) -> Series:
        return self._offset(u, self.body.add(self.body.number(1.0), u.c[0] or self.body.number(0.0)))

    def _minus(self, u: Series) -> Series:
        return self._keep(_Negative(self.body, _negative(self.body, u.c[0]), u))

    def _apply(self, op: int, v: list[Series], numbers: list[float | None]) -> Series:
        body = self.body
        if op in (ca.OP_ASSIGN, ca.OP_LIFT):
            return v[0]
        if not any(series.varies for series in v):
            return self._constant(op, v)
        if op in (ca.OP_ADD, ca.OP_SUB):
            first = (_subtract if op == ca.OP_SUB else _add)(body, v[0].c[0], v[1].c[0])
            return self._keep(_Sum(body, first, v[0], v[1], op == ca.OP_SUB))
        if op == ca.OP_TWICE:
            return self._keep(_Sum(body, _add(body, v[0].c[0], v[0].c[0]), v[0], v[0], False))
        if op == ca.OP_NEG:
            return self._minus(v[0])
        if op == ca.OP_SQ:
            return self._sq(v[0])
        if op == ca.OP_MUL:
            return self._product(*v)
        if op in (ca.OP_DIV, ca.OP_INV):
            above, below = v if op == ca.OP_DIV else (Series(body, body.number(1.0), False), v[0])
            if not below.varies:
                inverse = operation(body, ca.OP_INV, [below.c[0] or body.number(0.0)])
                return self._multiple(above, inverse, self._first(op, v))
            return self._keep(_Quotient(body, self._first(op, v), above, below))
        if op in (ca.OP_FABS, ca.OP_FMIN, ca.OP_FMAX):
            return self._kink(op, v)
        return self._elementary(op, v, numbers)

    def _constant(self, op: int, v: list[Series]) -> Series:
        """A value of what does not change; zeros are kept as such, since forces of other modes are switched off by them only at run time."""
        zero = [series.c[0] is None for series in v]
        if (op == ca.OP_MUL and any(zero)) or (op in (ca.OP_ADD, ca.OP_SUB) and all(zero)):
            return self._zero
        return Series(self.body, self._first(op, v), False)

    def _product(self, a: Series, b: Series) -> Series:
        body = self.body
        if a.varies and b.varies:
            return self._keep(_Product(body, _multiply(body, a.c[0], b.c[0]), a, b))
        changing, factor = (a, b) if a.varies else (b, a)
        if factor.c[0] is None:
            return self._zero
        return self._multiple(changing, factor.c[0], _multiply(body, changing.c[0], factor.c[0]))

    def _multiple(self, u: Series, factor: str, first: Value) -> Series:
        base, before = _unscaled(u)
        return self._keep(_Multiple(self.body, first, base, factor if before is None else self.body.mul(before, factor)))

    def _kink(self, op: int, v: list[Series]) -> Series:
        body = self.body
        first = self._first(op, v)
        if op == ca.OP_FABS:
            argument, above, below = v[0], v[0], self._minus(v[0])
        else:
            argument = self._keep(_Sum(body, _subtract(body, v[0].c[0], v[1].c[0]), v[0], v[1], True))
            above, below = v if op == ca.OP_FMAX else v[::-1]
        return self._keep(_Sided(body, first, argument, above, below, self.look))

    def _elementary(self, op: int, v: list[Series], numbers: list[float | None]) -> Series:
        body, u = self.body, v[0]
        if op in (ca.OP_POW, ca.OP_CONSTPOW):
            return self._power(op, v, numbers[1])
        if op == ca.OP_SQRT:
            return self._keep(_Root(body, self._first(op, v), u))
        if op in (ca.OP_ATAN2, ca.OP_HYPOT):
            return self._angle(op, v)
        if len(v) != 1:
            raise NoSeries
        first = self._first(op, v)
        if op == ca.OP_EXP:
            return self._keep(_Integral(body, first, u, None))
        if op == ca.OP_EXPM1:
            return self._keep(_Integral(body, first, u, None, also=body.add(first, body.number(1.0))))
        if op == ca.OP_LOG:
            return self._keep(_Divided(body, first, u, [(None, u)]))
        if op == ca.OP_LOG1P:
            return self._keep(_Divided(body, first, self._one_plus(u), [(None, u)]))
        pairs = {ca.OP_SIN: (ca.OP_COS, 1.0, -1.0), ca.OP_COS: (ca.OP_SIN, -1.0, 1.0), ca.OP_SINH: (ca.OP_COSH, 1.0, 1.0), ca.OP_COSH: (ca.OP_SINH, 1.0, 1.0)}
        if op in pairs:
            other, own_sign, other_sign = pairs[op]
            one = _Integral(body, first, u, None, own_sign)
            two = _Integral(body, self._first(other, v), u, one, other_sign)
            one.rate = two
            self._keep(one)
            self._keep(two)
            return one
        if op in (ca.OP_TAN, ca.OP_TANH):  # 1 + w^2, and 1 - w^2
            w = _Integral(body, first, u, None)
            self._keep(w)
            square = self._sq(w)
            w.rate = self._one_plus(square if op == ca.OP_TAN else self._minus(square))
            return w
        if op == ca.OP_ERF:
            bell = self._minus(self._sq(u))
            bell = self._keep(_Integral(body, operation(body, ca.OP_EXP, [bell.c[0] or body.number(0.0)]), bell, None))
            return self._keep(_Integral(body, first, u, bell, 1.1283791670955126))
        square = self._sq(u)
        inside = {ca.OP_ATAN: 1, ca.OP_ASINH: 1, ca.OP_ATANH: -1, ca.OP_ASIN: -1, ca.OP_ACOS: -1, ca.OP_ACOSH: 0}.get(op)
        if inside is None:
            raise NoSeries
        if inside == 0:
            below = self._offset(square, body.add(square.c[0] or body.number(0.0), body.number(-1.0)))
        else:
            below = self._one_plus(square if inside > 0 else self._minus(square))
        if op not in (ca.OP_ATAN, ca.OP_ATANH):
            below = self._keep(_Root(body, body.intrinsic("sqrt", below.c[0] or body.number(0.0)), below))
        return self._keep(_Divided(body, first, below, [(None, u)], -1.0 if op == ca.OP_ACOS else 1.0))

    def _power(self, op: int, v: list[Series], number: float | None) -> Series:
        body, (u, exponent) = self.body, v
        if number is not None and number == int(number) and 1 <= number <= _WHOLE:
            result, base, left = None, u, int(number)
            while left:
                if left % 2:
                    result = base if result is None else self._product(result, base)
                left //= 2
                if left:
                    base = self._sq(base)
            assert result is not None
            return result
        first = self._first(op, v)
        if u.varies and not exponent.varies:
            return self._keep(_Power(body, first, u, exponent.c[0] or body.number(0.0)))
        logarithm = self._elementary(ca.OP_LOG, [u], [None]) if u.varies else Series(body, self._first(ca.OP_LOG, [u]), False)
        return self._keep(_Integral(body, first, self._product(exponent, logarithm), None))

    def _angle(self, op: int, v: list[Series]) -> Series:
        body = self.body
        squares = [self._sq(s) if s.varies else self._constant(ca.OP_SQ, [s]) for s in v]
        total = self._keep(_Sum(body, _add(body, squares[0].c[0], squares[1].c[0]), squares[0], squares[1], False))
        first = self._first(op, v)
        if op == ca.OP_HYPOT:
            return self._keep(_Root(body, first, total))
        y, x = v
        return self._keep(_Divided(body, first, total, [(x, y), (self._minus(y) if y.varies else Series(body, _negative(body, y.c[0]), False), x)]))


def constants(body: Body, names: Sequence[str]) -> list[Series]:
    """Series of values that do not change."""
    return [Series(body, name, False) for name in names]


def solved(body: Body, function: ca.Function, t: str, look: str, values: Sequence[Sequence[str]], order: int) -> list[list[Value]]:
    """Coefficients 0 to `order` of the states and of further outputs along the solution of x' = f.

    function: (t, x, p, m) -> [f, outputs];  values: names of x, p and m. Raises NoSeries where an operation has none. A row per coefficient: states, then outputs.
    """
    x, p, m = values
    clock = State(body, t, True)
    states = [State(body, name, True) for name in x]
    made = Recurrences(body, function, [[clock], states, constants(body, p), constants(body, m)], look)
    slopes, outputs = made.outputs
    for k in range(order):
        if k:
            made.extend()
        clock.c.append(body.number(1.0) if k == 0 else None)
        for state, slope in zip(states, slopes, strict=True):
            base, factor = _unscaled(slope)
            if k == 0 or factor is None:
                state.c.append(_scaled(body, slope.at(k), 1.0 / (k + 1)))
            else:
                state.c.append(_multiply(body, base.at(k), _scaled(body, factor, 1.0 / (k + 1))))
    made.extend()
    return [[series.at(k) for series in (*states, *outputs)] for k in range(order + 1)]


def written(rows: Sequence[Sequence[Value]]) -> list[list[str]]:
    """Coefficients with zeros as numbers."""
    return [[value or literal(0.0) for value in row] for row in rows]
