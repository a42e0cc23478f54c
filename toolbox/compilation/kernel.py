"""The function set of one closed scene as machine code, with one signature for all models.

Every function is `void f(double t, double h, x, k, p, m, y)` on arrays of doubles:

    field    y = [ - | dx | guards | guard rates]                      at (t, x)
    step     y = [x(t+h) | dx(t+h) | guards | rates | error | error_low]  from (t, x) with slope k = dx(t); of time stepping see
    `toolbox.compilation.moreau_jean` project  y = [x with zero slip in sticking elements]
    probe    y = [slip | slip rate | force | static bound | pace]       of the elements; pace is the slip rate that the bound can make
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

from toolbox.compilation.emitter import Body, compiled_for, function_text, inline, literal
from toolbox.compilation.moreau_jean import Theta, trial_step
from toolbox.compilation.notices import announced_code
from toolbox.compilation.rolled import rolled_body, rolled_slope
from toolbox.compilation.rosenbrock import FASTEST_GROWTH, Rosenbrock, elimination, factors
from toolbox.compilation.runge_kutta import Pair
from toolbox.compilation.taylor import Taylor, polynomial_body
from toolbox.modelling.elements import Element
from toolbox.modelling.elimination import calls, size_solved
from toolbox.modelling.switching import Switching

UNROLLED = 600
"""Steps with at most this many state-stage products are written without loops."""

LONG = 20_000
"""Instructions of all stages beyond which they are not written out either."""

ROLLED = 1_500
"""Instructions of a function beyond which it is written as loops over equal rows."""


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
    bounds = ca.vertcat(*[1 if e.unilateral else form.static[i] for i, e in enumerate(elements)])
    pace = ca.diag(form.gain) * bounds  # the slip rate that a force at its bound makes, of a rigid contact one of 1
    probed = ca.vertcat(*map(ca.densify, (form.slip, form.slip_rate, form.force, form.static, pace)))
    probe = ca.Function("probe", [t, x, p, m], [probed])
    padded = ca.vertcat(ca.densify(form.burden), ca.SX.zeros(x.numel() - form.burden.numel()))
    burden = ca.Function("burden", [t, x, p, m], [padded])
    n = x.numel()

    bodies: dict[str, Body] = {}
    texts: list[str] = []
    stages = len(pair.a) if isinstance(pair, (Pair, Rosenbrock)) else 0
    table = n
    cost = stages * (_operations(rhs) + n * stages) + _operations(field)
    if isinstance(pair, Theta):
        assert flow is not None
        trial = trial_step(pair, t, x, p, flow, elements, form)
        bodies["step"] = _trial(trial)
        cost = trial.n_instructions()
    elif isinstance(pair, Rosenbrock):
        force = ca.vertcat(*[e.multiplier for e in elements]) if elements else ca.SX(0, 1)
        announced_code(implicit_size(x, force, form))
        factor, solve = _factor(pair, t, x, p, m, force, form)
        bodies["step"], inner = _implicit_step(pair, rhs, field, (factor, solve), n)
        cost += factor.n_instructions() + len(pair.a) * solve.n_instructions()
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
        bodies[name] = _body(name, function, n if name == "field" else 0)
    if form.impulse is not None:
        held, elastic, results = form.impulse
        bodies["impulse"] = _body("impulse", ca.Function("impulse", [t, x, p, m, ca.vertcat(held, elastic)], [results]))
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


def _arguments(body: Body, function: ca.Function) -> list[list[str]]:
    """Values of the inputs (t, x, p, m and, for updates, the controller state in k)."""
    pointers = ["", "%x", "%p", "%m", "%k"]
    values = [["%t"]]
    for i in range(1, function.n_in()):
        values.append([body.load(pointers[i], j) for j in range(function.numel_in(i))])
    return values


def _operations(function: ca.Function) -> int:
    """Instructions of a function, with those of the dense systems that it solves, once there are factors."""
    return function.n_instructions() + sum(2 * size_solved(called.name())[0] ** 2 for called in calls(function).values())


def _body(name: str, function: ca.Function, offset: int = 0) -> Body:
    """The function of `plain_body`, as loops where it is long."""
    return plain_body(function, offset) if function.n_instructions() <= ROLLED else rolled_body(name, function, offset)


def _slope(body: Body, rhs: ca.Function) -> tuple[dict[str, Body], str]:
    """The functions that give the slopes of a stage, called with a pointer as k: what is the same in all stages is computed once, by `body`."""
    if rhs.n_instructions() <= ROLLED:
        return {"slope": plain_body(rhs, 0)}, "%k"
    once, each, size = rolled_slope(rhs)
    kept = body.value(f"alloca [{size} x double], align 64")
    body.lines.append(f"  call void @once(double %t, double %h, ptr %x, ptr %k, ptr %p, ptr %m, ptr {kept})")
    return {"once": once, "slope": each}, kept


def plain_body(function: ca.Function, offset: int) -> Body:
    """The instructions that evaluate a function of the arguments of every kernel and write its values from an offset on."""
    body = Body()
    (values,) = inline(body, function, _arguments(body, function))
    for i, value in enumerate(values):
        body.store(value, "%y", offset + i)
    return body


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
    _, x, p, m = _arguments(body, rhs)
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
    inner, kept = _slope(body, rhs)
    for s in range(1, len(pair.b)):
        _loop(body, n, stage, "%x", pair.a[s], slopes[:s])
        now = body.combination("%t", "%h", [pair.c[s]], [literal(1.0)])
        body.lines.append(f"  call void @slope(double {now}, double %h, ptr {stage}, ptr {kept}, ptr %p, ptr %m, ptr {slopes[s]})")
    _loop(body, n, stage, "%x", pair.b, slopes)
    end = body.add("%t", "%h")
    body.lines.append(f"  call void @ends(double {end}, double %h, ptr {stage}, ptr %k, ptr %p, ptr %m, ptr %y)")
    _loop(body, n, "%y", stage, (), ())
    base = field.numel_out(0) + n
    last = body.value(f"getelementptr double, ptr %y, i64 {n}")
    for weights in (pair.error, pair.error_low):
        if weights:
            target = body.value(f"getelementptr double, ptr %y, i64 {base}")
            _loop(body, n, target, "", weights, [*slopes, last][: len(weights)])
        base += n
    return body, _internal(body, inner | {"ends": _body("ends", field, n)})


def _internal(body: Body, inner: dict[str, Body]) -> str:
    """The text of functions that only `body` calls."""
    for function in inner.values():
        body.declarations |= function.declarations
    return "\n".join(function_text(name, function).replace("define void", "define internal void") for name, function in inner.items())


def _factor(method: Rosenbrock, t: ca.SX, x: ca.SX, p: ca.SX, m: ca.SX, force: ca.SX, form: Switching) -> tuple[ca.Function, ca.Function]:
    """Functions (t, x, p, m, h) -> [df/dt | factors of the matrix of a step | > 0 where it may stand] and (factors, right side) -> solution.

    Forces that hold each other are unknowns beside the states, so that the matrix stays as sparse as the chain that couples them.
    """
    h = ca.SX.sym("h")
    jacobian = ca.jacobian(*_linearised(x, force, form))
    if form.balance.numel():
        jacobian = ca.substitute(jacobian, force, form.force)
    values, solve, least = factors(jacobian, 1 / (method.gamma * h), form.balance.numel())
    drift = ca.densify(ca.jtimes(form.field, t, ca.SX(1)))
    sound = least - (1 / method.gamma - FASTEST_GROWTH) / h
    return ca.Function("factor", [t, x, p, m, h], [ca.vertcat(drift, values, sound)]), solve


def _linearised(x: ca.SX, force: ca.SX, form: Switching) -> tuple[ca.SX, ca.SX]:
    """What the matrix of a step is the derivative of, and by what."""
    if form.balance.numel():
        return ca.vertcat(form.open_field, form.balance), ca.vertcat(x, force)
    return form.field, x


def implicit_size(x: ca.SX, force: ca.SX, form: Switching) -> int:
    """Number of instructions that a step of a Rosenbrock method is written in beside the field, from the sparsity of the equations alone."""
    return sum(elimination(ca.jacobian_sparsity(*_linearised(x, force, form))))


def _implicit_step(
    method: Rosenbrock, rhs: ca.Function, field: ca.Function, linear: tuple[ca.Function, ca.Function], n: int
) -> tuple[Body, str]:
    """A step of a Rosenbrock method, whose stages are loops over the states; returns the text of the functions it calls, too."""
    factor, solve = linear
    forced = ca.depends_on(field(*(symbols := field.sx_in())), symbols[0])
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

    body = Body()
    matrix, stage, *u = (body.value(f"alloca [{k} x double], align 64") for k in (n + size + 1, n, *[n] * len(method.a)))
    rate = body.value(f"fdiv double {literal(1.0)}, %h")
    inner, kept = _slope(body, rhs)
    body.lines.append(f"  call void @prepare(double %t, double %h, ptr %x, ptr %k, ptr %p, ptr %m, ptr {matrix})")
    for s, (nodes, a, c, weight) in enumerate(zip(method.alpha, method.a, method.c, method.slope_weights, strict=True)):
        slope = "%k"
        if s:
            _loop(body, n, stage, "%x", a, u[:s], literal(1.0))
            now = body.combination("%t", "%h", [nodes], [literal(1.0)])
            body.lines.append(f"  call void @slope(double {now}, double %h, ptr {stage}, ptr {kept}, ptr %p, ptr %m, ptr {u[s]})")
            slope = u[s]
        _loop(body, n, u[s], slope, c, u[:s], rate)
        if forced and weight:
            _loop(body, n, u[s], u[s], (weight,), (matrix,), "%h")
        body.lines.append(f"  call void @solve(double %t, double %h, ptr {matrix}, ptr %k, ptr %p, ptr %m, ptr {u[s]})")
    _loop(body, n, stage, stage, (1.0,), u[-1:], literal(1.0))
    end = body.add("%t", "%h")
    body.lines.append(f"  call void @ends(double {end}, double %h, ptr {stage}, ptr %k, ptr %p, ptr %m, ptr %y)")
    _loop(body, n, "%y", stage, (), ())
    base = field.numel_out(0) + n
    # where some mode grows too fast for the step, which the estimate would not show, there is none
    sound = body.select(body.compare("ogt", body.load(matrix, n + size), literal(0.0)), literal(1.0), literal(float("nan")))
    _loop(body, n, body.value(f"getelementptr double, ptr %y, i64 {base}"), "", (1.0,), u[-1:], sound)
    inner |= {"ends": _body("ends", field, n), "prepare": prepare, "solve": back}
    text = _internal(body, inner)
    body.count += sum(function.count for function in inner.values())
    return body, text


def _loop(body: Body, n: int, target: str, base: str, factors: Sequence[float], sources: Sequence[str], scale: str = "%h") -> None:
    """target[i] = base[i] + scale * sum(factor * source[i]) for all i, left to LLVM to vectorise."""
    label = f"l{body.count}"
    body.lines += [f"  br label %{label}a", f"{label}a:", f"  br label %{label}", f"{label}:"]
    body.lines.append(f"  %{label}i = phi i64 [0, %{label}a], [%{label}n, %{label}]")

    def at(pointer: str) -> str:
        place = body.value(f"getelementptr double, ptr {pointer}, i64 %{label}i")
        return body.value(f"load double, ptr {place}")

    start = at(base) if base else ""
    used = [(f, s) for f, s in zip(factors, sources, strict=True) if f]
    value = body.combination(start, scale, [f for f, _ in used], [at(s) for _, s in used])
    place = body.value(f"getelementptr double, ptr {target}, i64 %{label}i")
    body.lines += [
        f"  store double {value}, ptr {place}",
        f"  %{label}n = add i64 %{label}i, 1",
        f"  %{label}c = icmp ult i64 %{label}n, {n}",
        f"  br i1 %{label}c, label %{label}, label %{label}z",
        f"{label}z:",
    ]

