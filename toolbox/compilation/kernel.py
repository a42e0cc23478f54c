"""The function set of one closed scene as machine code, with one signature for all models.

Every function is `void f(double t, double h, x, k, p, m, y)` on arrays of doubles:

    field    y = [ - | dx | guards | guard rates]                      at (t, x)
    step     y = [x(t+h) | dx(t+h) | guards | rates | error | error_low]  from (t, x) with slope k = dx(t); of time stepping see
    `toolbox.compilation.moreau_jean`; behind the error of an implicit step stands whether it may stand, > 0
    project  y = [x with zero slip in sticking elements]
    probe    y = [slip | slip rate | force | static bound | pace]       of the elements (`Switching.probed`)
    series   y = [coefficients of the states and guards at (t, x)]     of Taylor steps, which is then k of step; h tells how long one is about
    burden   y = [size of what the forces of elements cancel]         of each slope
    impulse  y = [x | impulses | slips before | after | bounds]       of an impact, with k = [held | elastic]; only with rigid contacts
    update_i y = [controller state | outputs]                          of sampled controller i, with its state in k
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from toolbox.compilation.bodies import arguments_of, body_of, end_bodies, internal_text, loop_over, operations, plain_body, slope_bodies
from toolbox.compilation.emitter import Body, compiled_for, function_text, inline, literal
from toolbox.compilation.implicit_step import implicit_size, implicit_step, linear_algebra
from toolbox.compilation.moreau_jean import Theta, trial_step
from toolbox.compilation.notices import announced_code
from toolbox.compilation.rosenbrock import Rosenbrock
from toolbox.compilation.runge_kutta import Pair
from toolbox.compilation.taylor import Taylor, polynomial_body
from toolbox.modelling.elements import Element
from toolbox.modelling.switching import Switching

UNROLLED = 600
"""Steps with at most this many state-stage products are written without loops."""

LONG = 20_000
"""Instructions of all stages beyond which they are not written out either."""


@dataclass(frozen=True)
class Kernel:
    """Addresses of a compiled function set and the sizes its arrays need; `cost` is the number of instructions of one step, `slopes` the size of
    `Work.k`; the code at
    the addresses lives as long as `code`."""

    states: int
    elements: int
    guards: int
    coupled: bool
    addresses: tuple[int, ...]
    updates: tuple[int, ...]
    instructions: int
    cost: int
    slopes: int
    code: Any


def kernel_of(
    t: ca.SX,
    x: ca.SX,
    p: ca.SX,
    elements: Sequence[Element],
    form: Switching,
    pair: Pair | Rosenbrock | Theta | Taylor,
    updates: Sequence[tuple[ca.SX, ca.SX, ca.SX]] = (),
    flow: ca.SX | None = None,
    series: Body | None = None,
    passing: bool = False,
) -> Kernel:
    """Compile the functions of a closed system whose only symbols are t, x, p and the modes.

    updates: (z, next z, outputs) of every sampled controller, in terms of t, x, p, m and z;  flow: the field with forces as symbols, for time stepping;
    series: the coefficients of Taylor steps;  passing: the code goes with the kernel, else it stays as long as the process.
    """
    m = ca.vertcat(*[e.mode for e in elements]) if elements else ca.SX(0, 1)
    rhs = ca.Function("rhs", [t, x, p, m], [ca.densify(form.field)])
    slopes = ca.vertcat(*map(ca.densify, (form.field, form.guards, form.guard_rates)))
    field = ca.Function("field", [t, x, p, m], [slopes])
    project = ca.Function("project", [t, x, p, m], [ca.densify(form.projected)])
    probe = ca.Function("probe", [t, x, p, m], [form.probed])
    padded = ca.vertcat(ca.densify(form.burden), ca.SX.zeros(x.numel() - form.burden.numel()))
    burden = ca.Function("burden", [t, x, p, m], [padded])
    n = x.numel()

    bodies: dict[str, Body] = {}
    texts: list[str] = []
    stages = len(pair.a) if isinstance(pair, (Pair, Rosenbrock)) else 0
    table = n
    cost = stages * (operations(rhs) + n * stages) + operations(field)
    if isinstance(pair, Theta):
        assert flow is not None
        trial = trial_step(pair, t, x, p, flow, elements, form)
        bodies["step"] = _trial(trial)
        cost = trial.n_instructions()
    elif isinstance(pair, Rosenbrock):
        force = ca.vertcat(*[e.multiplier for e in elements]) if elements else ca.SX(0, 1)
        announced_code(implicit_size(x, force, form))
        linear = linear_algebra(pair, t, x, p, m, force, form)
        bodies["step"], inner = implicit_step(pair, rhs, field, linear, n)
        cost += linear.cost[0] + len(pair.a) * linear.cost[1]
        texts.append(inner)
    elif isinstance(pair, Taylor):
        assert series is not None
        bodies["series"] = series
        bodies["step"] = polynomial_body(pair, n, form.guards.numel())
        cost = bodies["series"].count + bodies["step"].count
        table = (pair.order + 1) * (n + form.guards.numel())
    elif n * len(pair.b) <= UNROLLED and rhs.n_instructions() * len(pair.b) <= LONG:
        bodies["step"] = _unrolled_step(pair, rhs, field, n)
    else:
        step, inner = _looped_step(pair, rhs, field, n)
        bodies["step"] = step
        texts.append(inner)
    for name, function in (("field", field), ("project", project), ("probe", probe), ("burden", burden)):
        bodies[name] = body_of(name, function, n if name == "field" else 0)
    if form.impulse is not None:
        held, elastic, results = form.impulse
        bodies["impulse"] = body_of("impulse", ca.Function("impulse", [t, x, p, m, ca.vertcat(held, elastic)], [results]))
    for i, (z, following, outputs) in enumerate(updates):
        update = ca.Function("update", [t, x, p, m, z], [ca.densify(ca.vertcat(following, outputs))])
        bodies[f"update_{i}"] = plain_body(update, 0)
    declared: set[str] = set()
    for name, body in bodies.items():
        texts.append(function_text(name, body))
        declared |= body.declarations
    count = sum(body.count for body in bodies.values())
    if not isinstance(pair, Rosenbrock):
        announced_code(count)
    found, code = compiled_for("\n".join([*texts, *sorted(declared)]), list(bodies), count, passing, side_by_side=isinstance(pair, Taylor))
    return Kernel(
        n,
        len(elements),
        form.guards.numel(),
        not form.gain.sparsity().is_diag(),
        tuple(found.get(name, 0) for name in ("field", "step", "project", "probe", "burden", "impulse", "series")),
        tuple(found[f"update_{i}"] for i in range(len(updates))),
        count,
        cost,
        table,
        code,
    )


def equations(t: ca.SX, x: ca.SX, p: ca.SX, m: ca.SX, form: Switching) -> ca.Function:
    """The function (t, x, p, m) -> [dx/dt, guards]."""
    return ca.Function("equations", [t, x, p, m], [ca.densify(form.field), ca.densify(form.guards)])


def _trial(function: ca.Function) -> Body:
    body = Body()
    places = [("%x", 2), ("%p", 3), ("%m", 4), ("%k", 5)]
    given = [[body.load(pointer, j) for j in range(function.numel_in(i))] for pointer, i in places]
    (values,) = inline(body, function, [["%t"], ["%h"], *given])
    for i, value in enumerate(values):
        body.store(value, "%y", i)
    return body


def _unrolled_step(pair: Pair, rhs: ca.Function, field: ca.Function, n: int) -> Body:
    body = Body()
    _, x, p, m = arguments_of(body, rhs)
    slopes, new, end = stages(body, pair, rhs, field, ("%t", "%h"), (x, [body.load("%k", i) for i in range(n)], p, m))
    for i, value in enumerate([*new, *end]):
        body.store(value, "%y", i)
    base = n + len(end)
    for weights in (pair.error, pair.error_low):
        used = [*slopes, end[:n]][: len(weights)]
        for i in range(n if weights else 0):
            body.store(body.combination("", "%h", weights, [k[i] for k in used]), "%y", base + i)
        base += n
    return body


def stages(
    body: Body, pair: Pair, rhs: ca.Function, field: ca.Function, times: tuple[str, str], values: Sequence[Sequence[str]]
) -> tuple[list[list[str]], list[str], list[str]]:
    """Write the stages of a step from (t, h) and (x, slope, p, m); returns the slopes of the stages, the new states and the field there."""
    (t, h), (x, k, p, m) = times, values
    slopes = [list(k)]
    for c, row in zip(pair.c[1:], pair.a[1:], strict=True):
        stage = [body.combination(x[i], h, row, [k[i] for k in slopes]) for i in range(len(x))]
        now = body.combination(t, h, [c], [body.number(1.0)])
        slopes += inline(body, rhs, [[now], stage, p, m])
    new = [body.combination(x[i], h, pair.b, [k[i] for k in slopes]) for i in range(len(x))]
    (end,) = inline(body, field, [[body.add(t, h)], new, p, m])
    return slopes, new, end


def _looped_step(pair: Pair, rhs: ca.Function, field: ca.Function, n: int) -> tuple[Body, str]:
    """A step whose right-hand side is one function and whose stages are loops over the states; returns the text of that function too."""
    body = Body()
    stage = body.value(f"alloca [{n} x double], align 64")
    slopes = ["%k"] + [body.value(f"alloca [{n} x double], align 64") for _ in pair.b[1:]]
    inner, kept = slope_bodies(body, rhs)
    for s in range(1, len(pair.b)):
        loop_over(body, n, stage, "%x", pair.a[s], slopes[:s])
        now = body.combination("%t", "%h", [pair.c[s]], [literal(1.0)])
        body.lines.append(f"  call void @slope(double {now}, double %h, ptr {stage}, ptr {kept}, ptr %p, ptr %m, ptr {slopes[s]})")
    loop_over(body, n, stage, "%x", pair.b, slopes)
    last, ends = end_bodies(field, n)
    end = body.add("%t", "%h")
    body.lines.append(f"  call void @{ends}(double {end}, double %h, ptr {stage}, ptr %k, ptr %p, ptr %m, ptr %y)")
    loop_over(body, n, "%y", stage, (), ())
    base = field.numel_out(0) + n
    slope = body.value(f"getelementptr double, ptr %y, i64 {n}")
    for weights in (pair.error, pair.error_low):
        if weights:
            target = body.value(f"getelementptr double, ptr %y, i64 {base}")
            loop_over(body, n, target, "", weights, [*slopes, slope][: len(weights)])
        base += n
    return body, internal_text(body, inner | last)
