"""Linearly implicit Runge-Kutta (Rosenbrock) formulas and their step as machine code, for plants whose fast modes die long before anything happens.

With J = df/dx at the start of a step, stage i solves one linear system, all with the same matrix:

    (1/(gamma h) - J) u_i = f(t + alpha_i h, x + sum_j a_ij u_j) + sum_j c_ij u_j / h + gamma_i h df/dt

The last stage brings the solution to x + sum_j a_sj u_j + u_s, and u_s is its error estimate. Modes whose rate times h is large are damped out
within a step (L-stability), so that the step follows what happens, not the fastest mode.

The same damping would hide a mode that grows: its factor per step is right to 2 % where h times its rate is 2, has the wrong sign at 3, and falls to zero from
1/gamma on, with no error to see where the state still is at rest. Friction that falls steeply with speed has such modes. A pivot of the elimination is
1/(gamma h) less the rate at which its state grows: where one is below 1/(gamma h) - 2/h, the step is refused. Where contacts hold each other through coupled
inertias pivots do not tell, and the eigenvalues of df/dx are asked (`toolbox.simulation.growth`).

Why linearly implicit: within a mode the equations are smooth and their derivatives are known as formulas, so that one sparse factorisation per step, unrolled
into machine code without search for pivots, replaces the Newton iterations of implicit methods; and the result is a smooth function of h, which is
what finding events by stepping to them needs.

Up to a size the elimination is written out; that of a longer chain is in loops (`toolbox.compilation.banded_systems`), whose text does not grow with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import casadi as ca

from toolbox.compilation.banded_systems import Banded, banded, factor_text, least_text, solve_text, split
from toolbox.compilation.bodies import end_bodies, internal_text, loop_over, operations, slope_bodies
from toolbox.compilation.emitter import Body, inline, literal
from toolbox.compilation.formulas import ClosedEquations, Formulas, StepCode
from toolbox.compilation.notices import announced_code
from toolbox.compilation.rolled import Rolled, RolledBody
from toolbox.compilation.sparse_factors import elimination, factors
from toolbox.modelling.switching import Switching

MOST = 3_000
"""Operations of an elimination and a solution beyond which they are in loops, where the equations are those of a chain."""


MOST_EIGENVALUES = 120
"""States beyond which eigenvalues would cost more than the steps."""


FASTEST_GROWTH = 2.0
"""Rate of growth of a mode, times the step, up to which the step stands."""


@dataclass(frozen=True)
class Rosenbrock(Formulas):
    """Numbers of a stiffly accurate method, as in the equations of this module.

    alpha: nodes of the stages;  gamma: the diagonal;  slope_weights: gamma_i, weights of df/dt;  a, c: rows of the stages.
    """

    gamma: float
    alpha: tuple[float, ...]
    slope_weights: tuple[float, ...]
    a: tuple[tuple[float, ...], ...]
    c: tuple[tuple[float, ...], ...]

    implicit: ClassVar[bool] = True

    @property
    def steps(self) -> str:
        return "implicit steps, which stability makes the cheaper ones"

    def step(self, equations: ClosedEquations) -> StepCode:
        rhs, field, n, stages = equations.rhs, equations.field, equations.x.numel(), len(self.a)
        announced_code(implicit_size(equations.x, equations.force, equations.form))
        linear = linear_algebra(self, equations)
        body, inner = implicit_step(self, rhs, field, linear, n)
        cost = stages * (operations(rhs) + n * stages) + operations(field) + linear.cost[0] + stages * linear.cost[1]
        return StepCode({"step": body}, (inner,), cost, n)


class LinearAlgebra(NamedTuple):
    """Functions of an implicit step. `prepare` writes df/dt, `size` numbers for a solution, and a number > 0 if the step is possible.
    `solve` reads these numbers as its argument x and replaces a right side y by the solution. `text` holds the functions that both call.
    `cost` holds the operations of the factors and of a solution."""

    prepare: Body
    solve: Body
    size: int
    text: str
    cost: tuple[int, int]


def linear_algebra(method: Rosenbrock, equations: ClosedEquations) -> LinearAlgebra:
    """The functions for the matrix 1/(gamma h) - df/dx of a step.

    Forces that hold each other are unknowns beside the states, so that the matrix stays as sparse as the chain that couples them.
    """
    t, x, force, form, h = equations.t, equations.x, equations.force, equations.form, ca.SX.sym("h")
    jacobian = ca.jacobian(*linearised(x, force, form))
    drift = ca.densify(ca.jtimes(form.field, t, ca.SX(1)))
    diagonal, extra = 1 / (method.gamma * h), form.balance.numel()
    pace = (1 / method.gamma - FASTEST_GROWTH) / h
    given = [t, x, equations.p, equations.m, h]
    parts = split(jacobian.sparsity()) if not extra and sum(elimination(jacobian.sparsity())) > MOST else None
    if parts:
        return _in_loops(banded(jacobian, diagonal, parts), given, drift, diagonal, pace)
    if extra:
        jacobian = ca.substitute(jacobian, force, form.force)
    values, solve, least = factors(jacobian, diagonal, extra)
    sound = ca.SX(-1) if eigenvalues_tell(form, x.numel()) else least - pace
    return _written_out(ca.Function("factor", given, [ca.vertcat(drift, values, sound)]), solve, x.numel())


def eigenvalues_tell(form: Switching, n: int) -> bool:
    """Whether the eigenvalues of df/dx, and not the pivots, tell how long a step may be: where forces hold each other, and of n states, not too many."""
    return form.balance.numel() > 0 and n <= MOST_EIGENVALUES


def _written_out(factor: ca.Function, solve: ca.Function, n: int) -> LinearAlgebra:
    prepare = Body()
    pointers = enumerate(("%x", "%p", "%m"), 1)
    arguments = [[prepare.load(pointer, j) for j in range(factor.numel_in(i))] for i, pointer in pointers]
    (values,) = inline(prepare, factor, [["%t"], *arguments, ["%h"]])
    for i, value in enumerate(values):
        prepare.store(value, "%y", i)
    back = Body()
    size = solve.numel_in(0)
    (values,) = inline(back, solve, [[back.load("%x", n + j) for j in range(size)], [back.load("%y", j) for j in range(n)]])
    for i, value in enumerate(values):
        back.store(value, "%y", i)
    return LinearAlgebra(prepare, back, size, "", (factor.n_instructions(), solve.n_instructions()))


def _in_loops(made: Banded, given: list[ca.SX], drift: ca.SX, diagonal: ca.SX, pace: ca.SX) -> LinearAlgebra:
    n, size = drift.numel(), made.values.numel()
    s, m, width = len(made.apart), len(made.others), made.width
    needed = ca.Function("prepare", given, [ca.vertcat(drift, made.values, diagonal, pace)])
    rolled = Rolled(needed, ("%t", "%x", "%p", "%m", "%h"))
    prepare = RolledBody("prepare")
    results = prepare.value(f"alloca [{n + size + 2} x double], align 64")
    prepare.write(rolled, prepare.value(f"alloca [{max(rolled.size, 1)} x double], align 64"), results, 0)
    loop_over(prepare, n + size, "%y", results, (), ())

    def pointer(body: Body, array: str, place: int) -> str:
        return body.value(f"getelementptr double, ptr {array}, i64 {place}")

    apart = f"ptr {pointer(prepare, '%y', n)}, double {prepare.load(results, n + size)}"
    least = prepare.value(f"call double @least(i64 {s}, {apart})")
    least = prepare.value(f"call double @band_factor(ptr {pointer(prepare, '%y', n + made.band)}, double {least})")
    prepare.store(prepare.value(f"fsub double {least}, {prepare.load(results, n + size + 1)}"), "%y", n + size)

    solve = RolledBody("solve")
    values = pointer(solve, "%x", n)
    left = solve.value(f"alloca [{m} x double], align 64")
    reduced, completed = Rolled(made.reduced, (values, "%y")), Rolled(made.completed, (values, "%y", left))
    cells = solve.value(f"alloca [{max(reduced.size, completed.size, 1)} x double], align 64")
    solution = solve.value(f"alloca [{n} x double], align 64")
    solve.write(reduced, cells, left, 0)
    solve.lines.append(f"  call void @band_solve(ptr {pointer(solve, values, made.band)}, ptr {left})")
    solve.write(completed, cells, solution, 0)
    loop_over(solve, n, "%y", solution, (), ())
    text = "\n".join([least_text(), factor_text(width, m), solve_text(width, m), ""])
    one = made.reduced.n_instructions() + made.completed.n_instructions() + m * (4 * width + 2)
    return LinearAlgebra(prepare, solve, size, text, (needed.n_instructions() + m * (2 * width * (width + 1) + 2), one))


def linearised(x: ca.SX, force: ca.SX, form: Switching) -> tuple[ca.SX, ca.SX]:
    """Return the expressions whose derivative is the matrix of a step, and the variables of the derivative."""
    if form.balance.numel():
        return ca.vertcat(form.open_field, form.balance), ca.vertcat(x, force)
    return form.field, x


def implicit_size(x: ca.SX, force: ca.SX, form: Switching) -> int:
    """Number of instructions that a step of a Rosenbrock method is written in beside the field, from the sparsity of the equations alone."""
    pattern = ca.jacobian_sparsity(*linearised(x, force, form))
    size = sum(elimination(pattern))
    return MOST if size > MOST and not form.balance.numel() and split(pattern) else size


def implicit_step(method: Rosenbrock, rhs: ca.Function, field: ca.Function, linear: LinearAlgebra, n: int) -> tuple[Body, str]:
    """A step of a Rosenbrock method, whose stages are loops over the states; returns the text of the functions it calls, too."""
    prepare, back, size, text, _ = linear
    forced = ca.depends_on(field(*(symbols := field.sx_in())), symbols[0])
    body = Body()
    matrix, stage, *u = (body.value(f"alloca [{k} x double], align 64") for k in (n + size + 1, n, *[n] * len(method.a)))
    rate = body.value(f"fdiv double {literal(1.0)}, %h")
    inner, kept = slope_bodies(body, rhs)
    body.lines.append(f"  call void @prepare(double %t, double %h, ptr %x, ptr %k, ptr %p, ptr %m, ptr {matrix})")
    for s, (nodes, a, c, weight) in enumerate(zip(method.alpha, method.a, method.c, method.slope_weights, strict=True)):
        slope = "%k"
        if s:
            loop_over(body, n, stage, "%x", a, u[:s], literal(1.0))
            now = body.combination("%t", "%h", [nodes], [literal(1.0)])
            body.lines.append(f"  call void @slope(double {now}, double %h, ptr {stage}, ptr {kept}, ptr %p, ptr %m, ptr {u[s]})")
            slope = u[s]
        loop_over(body, n, u[s], slope, c, u[:s], rate)
        if forced and weight:
            loop_over(body, n, u[s], u[s], (weight,), (matrix,), "%h")
        body.lines.append(f"  call void @solve(double %t, double %h, ptr {matrix}, ptr %k, ptr %p, ptr %m, ptr {u[s]})")
    loop_over(body, n, stage, stage, (1.0,), u[-1:], literal(1.0))
    last, ends = end_bodies(field, n)
    end = body.add("%t", "%h")
    body.lines.append(f"  call void @{ends}(double {end}, double %h, ptr {stage}, ptr %k, ptr %p, ptr %m, ptr %y)")
    loop_over(body, n, "%y", stage, (), ())
    base = field.numel_out(0) + n
    loop_over(body, n, body.value(f"getelementptr double, ptr %y, i64 {base}"), "", (1.0,), u[-1:], literal(1.0))
    body.store(
        body.load(matrix, n + size), "%y", base + n
    )  # not above 0 where some mode may grow too fast for the step, which the estimate would not show
    inner |= last | {"prepare": prepare, "solve": back}
    text += internal_text(body, inner)
    body.count += sum(function.count for function in inner.values())
    return body, text
