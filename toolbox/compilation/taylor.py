"""Steps by Taylor series: the coefficients of states and guards once per step, and polynomials for all that is asked of it.

    x(t + h) = sum_{k=0..P} x_k h^k

The coefficients come from recurrences (`toolbox.compilation.recurrences`) with the same instructions as the field. A shorter step, an output, a guard
on the way to
an event are then a polynomial, and a step is as long as its last two coefficients allow, so that none is rejected.

Why an order far above that of Runge-Kutta pairs: what a step costs is mostly the time in which one operation waits for another. In a pair the stages
wait for each
other, and each holds the elementary functions of the model; here they are evaluated once, and another order costs a few products.

A table of coefficients holds one row of `width` = states + guards per coefficient: rows 1 to P, then row 0, so that it begins with the slopes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from toolbox.compilation.emitter import FLAGS, Body, literal
from toolbox.compilation.formulas import ClosedEquations, Formulas, StepCode
from toolbox.compilation.power_series import LOOK_AHEAD, NoSeries
from toolbox.compilation.recurrences import solved, written
from toolbox.compilation.runge_kutta import DOP853

MOST = 12_000
"""Instructions of the coefficients beyond which explicit formulas are taken: to write and optimise so many takes a second, and more run no faster."""


JUMPS, TOO_LONG = "an operation of the plant has no Taylor series", "the Taylor series of the plant would be too long"
"""Why a plant is stepped by other formulas."""


@dataclass(frozen=True, init=False)
class Taylor(Formulas):
    """Taylor series up to an order."""

    series: ClassVar[bool] = True

    def __init__(self, order: int):
        for word, value in (("name", f"taylor{order}"), ("order", order), ("power", 1.0 / (order - 1))):
            object.__setattr__(self, word, value)

    @property
    def interpolates(self) -> bool:
        return True

    @property
    def steps(self) -> str:
        return f"Taylor series of order {self.order}"

    @property
    def instead(self) -> Formulas:
        return DOP853

    def step(self, equations: ClosedEquations) -> StepCode | str:
        n, guards = equations.x.numel(), equations.form.guards.numel()
        series = series_of(self, equations.with_guards)
        if isinstance(series, str):
            return series
        step = polynomial_body(self, n, guards)
        return StepCode({"series": series, "step": step}, (), series.count + step.count, (self.order + 1) * (n + guards))

    def may_miss_peaks(self, equations: ClosedEquations) -> bool:
        return peaks_in_time(equations.with_guards)


def series_of(formulas: Taylor, function: ca.Function) -> Body | str:
    """The function of `series_body`, or why there is none: an operation has no Taylor coefficients, or they would be too long."""
    if function.n_instructions() * formulas.order > 6 * MOST:
        return TOO_LONG
    try:
        body = series_body(formulas, function)
    except NoSeries:
        return JUMPS
    return body if body.count <= MOST else TOO_LONG


_WAVES = {ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_NEG, ca.OP_SQ, ca.OP_TWICE, ca.OP_SIN, ca.OP_COS, ca.OP_ASSIGN, ca.OP_LIFT,
          ca.OP_FABS, ca.OP_FMIN, ca.OP_FMAX, ca.OP_CALL}  # fmt: skip


def peaks_in_time(function: ca.Function) -> bool:
    """Whether a formula of time alone may hold a peak that coefficients far from it do not show, such as exp(-t^2); polynomials and sines show theirs.

    function: (t, x, p, m) -> [f, outputs].
    """
    found: dict[int, tuple[bool, bool]] = {}  # by place: whether it depends on time, and on states
    for q in range(function.n_instructions()):
        op, args, target = function.instruction_id(q), function.instruction_input(q), function.instruction_output(q)
        if op == ca.OP_INPUT:
            found[target[0]] = (args[0] == 0, args[0] == 1)
        elif op == ca.OP_CONST:
            found[target[0]] = (False, False)
        elif op != ca.OP_OUTPUT:
            given = [found[a] for a in args]
            waves = op in _WAVES or (op == ca.OP_DIV and not given[1][0])
            if not waves and any(time and not state for time, state in given):
                return True
            found |= dict.fromkeys(target, (any(time for time, _ in given), any(state for _, state in given)))
    return False


def series_body(formulas: Taylor, function: ca.Function) -> Body:
    """The function that writes the table of coefficients into y; h is the size of a step, to tell on which side a kink is.

    function: (t, x, p, m) -> [dx/dt, guards].
    """
    body = Body()
    values = [[body.load(pointer, i) for i in range(function.numel_in(j))] for j, pointer in ((1, "%x"), (2, "%p"), (3, "%m"))]
    look = body.mul("%h", literal(LOOK_AHEAD))
    first, *rows = written(solved(body, function, "%t", look, values, formulas.order))
    for k, row in enumerate([*rows, first]):
        for i, value in enumerate(row):
            body.store(value, "%y", k * len(row) + i)
    return body


def polynomial_body(formulas: Taylor, n: int, guards: int) -> Body:
    """The step: states, slopes, guards and their rates at h after the start of the table in k, by Horner's rule for several at once.

    Behind them stand the last term of each state, and the least and the most that each guard can be within the step, from the cubic through its ends

        |g - cubic| <= 1/384 h^4 max |d^4 g / dt^4|

    whose control points enclose it.
    """
    body = Body()
    width, order = n + guards, formulas.order
    for first, count, target in ((0, n, 0), (n, guards, 2 * n)):
        done = 0
        while done < count:
            size = next(size for size in (8, 4, 2, 1) if size <= count - done)
            column = first + done
            value, slope = _horner(body, column, size, width, order)
            _put(body, value, size, target + done)
            _put(body, slope, size, target + count + done)
            if target == 0:
                _put(body, _last_term(body, column, size, width, order), size, 2 * width + column)
            else:
                for q, bound in enumerate(_enclosed(body, column, size, width, order, (value, slope))):
                    _put(body, bound, size, 2 * width + q * guards + column)
            done += size
    return body


def _kind(size: int) -> str:
    return "double" if size == 1 else f"<{size} x double>"


def _put(body: Body, value: str, size: int, place: int) -> None:
    target = body.value(f"getelementptr double, ptr %y, i64 {place}")
    body.lines.append(f"  store {_kind(size)} {value}, ptr {target}, align 8")


def _row(body: Body, k: int, column: int, size: int, width: int, order: int) -> str:
    place = body.value(f"getelementptr double, ptr %k, i64 {(order if k == 0 else k - 1) * width + column}")
    return body.value(f"load {_kind(size)}, ptr {place}, align 8")


def _step(body: Body, size: int) -> str:
    if size == 1:
        return "%h"
    one = body.value(f"insertelement {_kind(size)} undef, double %h, i32 0")
    return body.value(f"shufflevector {_kind(size)} {one}, {_kind(size)} undef, <{size} x i32> zeroinitializer")


def _advanced(body: Body, kind: str, total: str, step: str, other: str) -> str:
    return body.value(f"fadd {FLAGS} {kind} {body.value(f'fmul {FLAGS} {kind} {total}, {step}')}, {other}")


def _horner(body: Body, column: int, size: int, width: int, order: int) -> tuple[str, str]:
    """Values and slopes of `size` polynomials from a column of the table on."""
    kind, step = _kind(size), _step(body, size)
    value = slope = _row(body, order, column, size, width, order)
    for k in range(order - 1, -1, -1):
        value = _advanced(body, kind, value, step, _row(body, k, column, size, width, order))
        if k:
            slope = _advanced(body, kind, slope, step, value)
    return value, slope


def _call(body: Body, what: str, size: int, *values: str) -> str:
    kind, name = _kind(size), f"llvm.{what}.f64" if size == 1 else f"llvm.{what}.v{size}f64"
    body.declarations.add(f"declare {kind} @{name}({', '.join([kind] * len(values))}) nounwind readnone willreturn")
    return body.value(f"call {kind} @{name}({', '.join(f'{kind} {value}' for value in values)})")


def _spread(size: int, number: float) -> str:
    return literal(number) if size == 1 else f"<{', '.join([f'double {literal(number)}'] * size)}>"


def _enclosed(body: Body, column: int, size: int, width: int, order: int, end: tuple[str, str]) -> tuple[str, str]:
    """The least and the most of `size` polynomials within the step, from their (values, slopes) at its end."""
    kind = _kind(size)
    third = body.value(f"fmul {FLAGS} {kind} {_step(body, size)}, {_spread(size, 1.0 / 3.0)}")
    a, da = (_row(body, k, column, size, width, order) for k in (0, 1))
    after = _advanced(body, kind, da, third, a)
    before = body.value(f"fsub {FLAGS} {kind} {end[0]}, {body.value(f'fmul {FLAGS} {kind} {end[1]}, {third}')}")
    doubt = _bend(body, column, size, width, order)

    def outermost(which: str) -> str:
        return _call(body, which, size, _call(body, which, size, a, after), _call(body, which, size, before, end[0]))

    low, high = outermost("minnum"), outermost("maxnum")
    return body.value(f"fsub {FLAGS} {kind} {low}, {doubt}"), body.value(f"fadd {FLAGS} {kind} {high}, {doubt}")


def _bend(body: Body, column: int, size: int, width: int, order: int) -> str:
    """Sum of the sizes of k (k - 1) (k - 2) (k - 3) c_k h^k, by 384."""
    kind, step = _kind(size), _step(body, size)
    total = ""
    for k in range(order, 3, -1):
        weight = _spread(size, k * (k - 1.0) * (k - 2.0) * (k - 3.0) / 384.0)
        term = body.value(f"fmul {FLAGS} {kind} {_call(body, 'fabs', size, _row(body, k, column, size, width, order))}, {weight}")
        total = _advanced(body, kind, total, step, term) if total else term
    square = body.value(f"fmul {FLAGS} {kind} {step}, {step}")
    return body.value(f"fmul {FLAGS} {kind} {total}, {body.value(f'fmul {FLAGS} {kind} {square}, {square}')}")


def _last_term(body: Body, column: int, size: int, width: int, order: int) -> str:
    kind, power = _kind(size), _step(body, size)
    value, exponent = _row(body, order, column, size, width, order), order
    while exponent:
        if exponent % 2:
            value = body.value(f"fmul {FLAGS} {kind} {value}, {power}")
        exponent //= 2
        if exponent:
            power = body.value(f"fmul {FLAGS} {kind} {power}, {power}")
    return value
