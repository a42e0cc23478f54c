"""Explicit Runge-Kutta formulas: their numbers, and their step as machine code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from toolbox.compilation.bodies import arguments_of, end_bodies, internal_text, loop_over, operations, slope_bodies
from toolbox.compilation.emitter import Body, inline, literal
from toolbox.compilation.formulas import ClosedEquations, Formulas, StepCode

UNROLLED = 600
"""Steps with at most this many state-stage products are written without loops."""

LONG = 20_000
"""Instructions of all stages beyond which they are not written out either."""


@dataclass(frozen=True)
class RungeKutta(Formulas):
    """Nodes c, stage rows a (row s combines slopes 0..s-1), weights b of the solution, and error weights.

    `error` and `error_low` weigh the slopes into error estimates; `error` of formulas whose last stage is the first of the next step has one weight more, for
    the slope at the new state.
    """

    c: tuple[float, ...]
    a: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]
    error: tuple[float, ...]
    error_low: tuple[float, ...]
    interpolates: bool = False

    explicit: ClassVar[bool] = True

    @property
    def two_errors(self) -> bool:
        return bool(self.error_low)

    def written_out(self, states: int) -> bool:
        """Whether a step of so many states is short enough to be written without loops."""
        return states * len(self.b) <= UNROLLED

    def step(self, equations: ClosedEquations) -> StepCode:
        rhs, field, n, stages = equations.rhs, equations.field, equations.x.numel(), len(self.a)
        texts: tuple[str, ...] = ()
        if self.written_out(n) and rhs.n_instructions() * len(self.b) <= LONG:
            body = _unrolled_step(self, rhs, field, n)
        else:
            body, text = _looped_step(self, rhs, field, n)
            texts = (text,)
        return StepCode({"step": body}, texts, stages * (operations(rhs) + n * stages) + operations(field), n)


def _unrolled_step(formulas: RungeKutta, rhs: ca.Function, field: ca.Function, n: int) -> Body:
    body = Body()
    _, x, p, m = arguments_of(body, rhs)
    slopes, new, end = stages(body, formulas, rhs, field, ("%t", "%h"), (x, [body.load("%k", i) for i in range(n)], p, m))
    for i, value in enumerate([*new, *end]):
        body.store(value, "%y", i)
    base = n + len(end)
    for weights in (formulas.error, formulas.error_low):
        used = [*slopes, end[:n]][: len(weights)]
        for i in range(n if weights else 0):
            body.store(body.combination("", "%h", weights, [k[i] for k in used]), "%y", base + i)
        base += n
    return body


def stages(
    body: Body, formulas: RungeKutta, rhs: ca.Function, field: ca.Function, times: tuple[str, str], values: Sequence[Sequence[str]]
) -> tuple[list[list[str]], list[str], list[str]]:
    """Write the stages of a step from (t, h) and (x, slope, p, m); returns the slopes of the stages, the new states and the field there."""
    (t, h), (x, k, p, m) = times, values
    slopes = [list(k)]
    for c, row in zip(formulas.c[1:], formulas.a[1:], strict=True):
        stage = [body.combination(x[i], h, row, [k[i] for k in slopes]) for i in range(len(x))]
        now = body.combination(t, h, [c], [body.number(1.0)])
        slopes += inline(body, rhs, [[now], stage, p, m])
    new = [body.combination(x[i], h, formulas.b, [k[i] for k in slopes]) for i in range(len(x))]
    (end,) = inline(body, field, [[body.add(t, h)], new, p, m])
    return slopes, new, end


def _looped_step(formulas: RungeKutta, rhs: ca.Function, field: ca.Function, n: int) -> tuple[Body, str]:
    """A step whose right-hand side is one function and whose stages are loops over the states; returns the text of that function too."""
    body = Body()
    stage = body.value(f"alloca [{n} x double], align 64")
    slopes = ["%k"] + [body.value(f"alloca [{n} x double], align 64") for _ in formulas.b[1:]]
    inner, kept = slope_bodies(body, rhs)
    for s in range(1, len(formulas.b)):
        loop_over(body, n, stage, "%x", formulas.a[s], slopes[:s])
        now = body.combination("%t", "%h", [formulas.c[s]], [literal(1.0)])
        body.lines.append(f"  call void @slope(double {now}, double %h, ptr {stage}, ptr {kept}, ptr %p, ptr %m, ptr {slopes[s]})")
    loop_over(body, n, stage, "%x", formulas.b, slopes)
    last, ends = end_bodies(field, n)
    end = body.add("%t", "%h")
    body.lines.append(f"  call void @{ends}(double {end}, double %h, ptr {stage}, ptr %k, ptr %p, ptr %m, ptr %y)")
    loop_over(body, n, "%y", stage, (), ())
    base = field.numel_out(0) + n
    slope = body.value(f"getelementptr double, ptr %y, i64 {n}")
    for weights in (formulas.error, formulas.error_low):
        if weights:
            target = body.value(f"getelementptr double, ptr %y, i64 {base}")
            loop_over(body, n, target, "", weights, [*slopes, slope][: len(weights)])
        base += n
    return body, internal_text(body, inner | last)
