"""The instructions of a casadi function as Taylor series, and the coefficients of the solution of x' = f.

Each operation becomes one of the series of `toolbox.compilation.power_series`, or several where its derivative needs more than its argument.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from toolbox.compilation.emitter import Body, literal, operation
from toolbox.compilation.power_series import (
    DenseSystem,
    Divided,
    Integral,
    Multiple,
    Negative,
    NoSeries,
    Power,
    Product,
    Quotient,
    Root,
    Same,
    Series,
    Sided,
    State,
    Sum,
    Unknown,
    Value,
    add,
    multiply,
    negative,
    scaled,
    subtract,
    unscaled,
)
from toolbox.modelling.elimination import calls, size_solved

_WHOLE = 8
"""Largest whole exponent that is written as products, which hold at zero, too."""


class Recurrences:
    """The instructions of an SX function as series in a body: `extend` writes the next coefficient of each."""

    def __init__(self, body: Body, function: ca.Function, arguments: Sequence[Sequence[Series]], look: str):
        """arguments: one sequence of series per input;  look: the time within which a kink counts as passed. Raises NoSeries."""
        self.body, self.look = body, look
        self.made: list[Series] = []
        self._zero = Series(body, None, False)
        work: dict[int, Series] = {}
        numbers: dict[int, float] = {}
        called = calls(function)
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
            elif op == ca.OP_CALL:
                for place, series in zip(target, self._called(called[q], [work[a] for a in args]), strict=True):
                    work[place] = series
                    numbers.pop(place, None)
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

    def _called(self, function: ca.Function, v: list[Series]) -> list[Series]:
        """The solution of a dense system whose matrix does not change, or its derivative. Raises NoSeries for anything else."""
        n, derived = size_solved(function.name())
        matrix, right, slopes = v[: n * n], v[n * n : n * n + n], v[n * n + n : 2 * n * n + n]
        if not n or any(entry.varies for entry in matrix):
            raise NoSeries
        if derived:
            if any(entry.varies or entry.c[0] for entry in slopes):
                raise NoSeries
            right = v[-n:]
        system = DenseSystem(self.body, n, matrix, right)
        return [self._keep(Unknown(system, i)) for i in range(n)]

    def _first(self, op: int, values: Sequence[Series]) -> str:
        return operation(self.body, op, [v.c[0] or self.body.number(0.0) for v in values])

    def _sq(self, u: Series) -> Series:
        return self._keep(Product(self.body, self._first(ca.OP_SQ, [u]), u, u))

    def _offset(self, u: Series, first: str) -> Series:
        return self._keep(Same(self.body, first, u))

    def _one_plus(self, u: Series) -> Series:
        return self._offset(u, self.body.add(self.body.number(1.0), u.c[0] or self.body.number(0.0)))

    def _minus(self, u: Series) -> Series:
        return self._keep(Negative(self.body, negative(self.body, u.c[0]), u))

    def _apply(self, op: int, v: list[Series], numbers: list[float | None]) -> Series:
        body = self.body
        if op in (ca.OP_ASSIGN, ca.OP_LIFT):
            return v[0]
        if not any(series.varies for series in v):
            return self._constant(op, v)
        if op in (ca.OP_ADD, ca.OP_SUB):
            first = (subtract if op == ca.OP_SUB else add)(body, v[0].c[0], v[1].c[0])
            return self._keep(Sum(body, first, v[0], v[1], op == ca.OP_SUB))
        if op == ca.OP_TWICE:
            return self._keep(Sum(body, add(body, v[0].c[0], v[0].c[0]), v[0], v[0], False))
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
            return self._keep(Quotient(body, self._first(op, v), above, below))
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
            return self._keep(Product(body, multiply(body, a.c[0], b.c[0]), a, b))
        changing, factor = (a, b) if a.varies else (b, a)
        if factor.c[0] is None:
            return self._zero
        return self._multiple(changing, factor.c[0], multiply(body, changing.c[0], factor.c[0]))

    def _multiple(self, u: Series, factor: str, first: Value) -> Series:
        base, before = unscaled(u)
        return self._keep(Multiple(self.body, first, base, factor if before is None else self.body.mul(before, factor)))

    def _kink(self, op: int, v: list[Series]) -> Series:
        body = self.body
        first = self._first(op, v)
        if op == ca.OP_FABS:
            argument, above, below = v[0], v[0], self._minus(v[0])
        else:
            argument = self._keep(Sum(body, subtract(body, v[0].c[0], v[1].c[0]), v[0], v[1], True))
            above, below = v if op == ca.OP_FMAX else v[::-1]
        return self._keep(Sided(body, first, argument, above, below, self.look))

    def _elementary(self, op: int, v: list[Series], numbers: list[float | None]) -> Series:
        body, u = self.body, v[0]
        if op in (ca.OP_POW, ca.OP_CONSTPOW):
            return self._power(op, v, numbers[1])
        if op == ca.OP_SQRT:
            return self._keep(Root(body, self._first(op, v), u))
        if op in (ca.OP_ATAN2, ca.OP_HYPOT):
            return self._angle(op, v)
        if len(v) != 1:
            raise NoSeries
        first = self._first(op, v)
        if op == ca.OP_EXP:
            return self._keep(Integral(body, first, u, None))
        if op == ca.OP_EXPM1:
            return self._keep(Integral(body, first, u, None, also=body.add(first, body.number(1.0))))
        if op == ca.OP_LOG:
            return self._keep(Divided(body, first, u, [(None, u)]))
        if op == ca.OP_LOG1P:
            return self._keep(Divided(body, first, self._one_plus(u), [(None, u)]))
        pairs = {
            ca.OP_SIN: (ca.OP_COS, 1.0, -1.0),
            ca.OP_COS: (ca.OP_SIN, -1.0, 1.0),
            ca.OP_SINH: (ca.OP_COSH, 1.0, 1.0),
            ca.OP_COSH: (ca.OP_SINH, 1.0, 1.0),
        }
        if op in pairs:
            other, own_sign, other_sign = pairs[op]
            one = Integral(body, first, u, None, own_sign)
            two = Integral(body, self._first(other, v), u, one, other_sign)
            one.rate = two
            self._keep(one)
            self._keep(two)
            return one
        if op in (ca.OP_TAN, ca.OP_TANH):  # 1 + w^2, and 1 - w^2
            w = Integral(body, first, u, None)
            self._keep(w)
            square = self._sq(w)
            w.rate = self._one_plus(square if op == ca.OP_TAN else self._minus(square))
            return w
        if op == ca.OP_ERF:
            bell = self._minus(self._sq(u))
            bell = self._keep(Integral(body, operation(body, ca.OP_EXP, [bell.c[0] or body.number(0.0)]), bell, None))
            return self._keep(Integral(body, first, u, bell, 1.1283791670955126))
        square = self._sq(u)
        inside = {ca.OP_ATAN: 1, ca.OP_ASINH: 1, ca.OP_ATANH: -1, ca.OP_ASIN: -1, ca.OP_ACOS: -1, ca.OP_ACOSH: 0}.get(op)
        if inside is None:
            raise NoSeries
        if inside == 0:
            below = self._offset(square, body.add(square.c[0] or body.number(0.0), body.number(-1.0)))
        else:
            below = self._one_plus(square if inside > 0 else self._minus(square))
        if op not in (ca.OP_ATAN, ca.OP_ATANH):
            below = self._keep(Root(body, body.intrinsic("sqrt", below.c[0] or body.number(0.0)), below))
        return self._keep(Divided(body, first, below, [(None, u)], -1.0 if op == ca.OP_ACOS else 1.0))

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
            return self._keep(Power(body, first, u, exponent.c[0] or body.number(0.0)))
        logarithm = self._elementary(ca.OP_LOG, [u], [None]) if u.varies else Series(body, self._first(ca.OP_LOG, [u]), False)
        return self._keep(Integral(body, first, self._product(exponent, logarithm), None))

    def _angle(self, op: int, v: list[Series]) -> Series:
        body = self.body
        squares = [self._sq(s) if s.varies else self._constant(ca.OP_SQ, [s]) for s in v]
        total = self._keep(Sum(body, add(body, squares[0].c[0], squares[1].c[0]), squares[0], squares[1], False))
        first = self._first(op, v)
        if op == ca.OP_HYPOT:
            return self._keep(Root(body, first, total))
        y, x = v
        return self._keep(
            Divided(body, first, total, [(x, y), (self._minus(y) if y.varies else Series(body, negative(body, y.c[0]), False), x)])
        )


def constants(body: Body, names: Sequence[str]) -> list[Series]:
    """Series of values that do not change."""
    return [Series(body, name, False) for name in names]


def solved(body: Body, function: ca.Function, t: str, look: str, values: Sequence[Sequence[str]], order: int) -> list[list[Value]]:
    """Coefficients 0 to `order` of the states and of further outputs along the solution of x' = f.

    function: (t, x, p, m) -> [f, outputs];  values: names of x, p and m. Raises NoSeries where an operation has none. A row per coefficient: states,
    then outputs.
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
            base, factor = unscaled(slope)
            if k == 0 or factor is None:
                state.c.append(scaled(body, slope.at(k), 1.0 / (k + 1)))
            else:
                state.c.append(multiply(body, base.at(k), scaled(body, factor, 1.0 / (k + 1))))
    made.extend()
    return [[series.at(k) for series in (*states, *outputs)] for k in range(order + 1)]


def written(rows: Sequence[Sequence[Value]]) -> list[list[str]]:
    """Coefficients with zeros as numbers."""
    return [[value or literal(0.0) for value in row] for row in rows]
