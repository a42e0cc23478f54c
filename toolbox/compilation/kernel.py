"""The function set of one closed scene as machine code, with one signature for all models.

Every function is `void f(double t, double h, x, k, p, m, y)` on arrays of doubles:

    field    y = [ - | dx | guards | guard rates]                      at (t, x)
    step     y = [x(t+h) | dx(t+h) | guards | rates | error | error_low]  from (t, x) with slope k = dx(t); of time stepping see
    `toolbox.compilation.moreau_jean`; behind the error of an implicit step stands whether it may stand, > 0
    project  y = [x with zero slip in sticking elements]
    probe    y = [slip | slip rate | force | static bound | pace]       of the elements (`Switching.probed`)
    series   y = [coefficients of the states and guards at (t, x)]     of Taylor steps, which is then k of step; h tells how long one is about
    burden   y = [size of what the forces of elements cancel]         of each slope
    impulse  y = [x | impulses | slips before | after | bounds]       of an impact, with k = [sticking | elastic]; only with rigid contacts
    update_i y = [controller state | outputs]                          of sampled controller i, with its state in k
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from toolbox.compilation.bodies import body_of, is_long, plain_body
from toolbox.compilation.emitter import Body, compiled_for, function_text
from toolbox.compilation.formulas import ClosedEquations, Formulas, StepCode
from toolbox.compilation.notices import announced_code


def _written(equations: ClosedEquations, function: ca.Function, offset: int) -> Body:
    """A function of a kernel; a long one is written once for the kernels of all steps."""
    name = function.name()
    if name in equations.written:
        return equations.written[name]
    body = body_of(name, function, offset)
    if is_long(function):
        equations.written[name] = body
    return body


@dataclass(frozen=True)
class Kernel:
    """Addresses of a compiled function set and the sizes its arrays need; `cost` is the number of instructions of one step, `slopes` the size of
    `Work.k`; the code at the addresses lives as long as `code`."""

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


MANY = 10
"""States from which series win a tenth by equal instructions that are joined in vectors; of fewer states looking for them takes longer than all else."""


def kernel_of(
    equations: ClosedEquations,
    formulas: Formulas,
    step: StepCode,
    updates: Sequence[tuple[ca.SX, ca.SX, ca.SX]] = (),
    passing: bool = False,
) -> Kernel:
    """Compile the functions of a closed system and the `step` that the formulas have written for it.

    updates: (z, next z, outputs) of every sampled controller, in terms of t, x, p, m and z;  passing: the code goes with the kernel, else it stays as long
    as the process.
    """
    form, n = equations.form, equations.x.numel()
    padded = ca.vertcat(ca.densify(form.burden), ca.SX.zeros(n - form.burden.numel()))
    bodies: dict[str, Body] = {**step.bodies, "field": _written(equations, equations.field, n)}
    for name, result in (("project", ca.densify(form.projected)), ("probe", form.probed), ("burden", padded)):
        bodies[name] = _written(equations, equations.function(name, result), 0)
    symbols = [equations.t, equations.x, equations.p, equations.m]
    if form.impulse is not None:
        sticking, elastic, results = form.impulse
        bodies["impulse"] = body_of("impulse", ca.Function("impulse", [*symbols, ca.vertcat(sticking, elastic)], [results]))
    for i, (z, following, outputs) in enumerate(updates):
        update = ca.Function("update", [*symbols, z], [ca.densify(ca.vertcat(following, outputs))])
        bodies[f"update_{i}"] = plain_body(update, 0)
    texts = [*step.texts, *[function_text(name, body) for name, body in bodies.items()]]
    declared = {each for body in bodies.values() for each in body.declarations}
    count = sum(body.count for body in bodies.values())
    if not formulas.implicit:
        announced_code(count)
    found, code = compiled_for(
        "\n".join([*texts, *sorted(declared)]), list(bodies), count, passing, side_by_side=formulas.series and n >= MANY
    )
    return Kernel(
        n,
        len(equations.elements),
        form.guards.numel(),
        not form.gain.sparsity().is_diag(),
        tuple(found.get(name, 0) for name in ("field", "step", "project", "probe", "burden", "impulse", "series")),
        tuple(found[f"update_{i}"] for i in range(len(updates))),
        count,
        step.cost,
        step.slopes,
        code,
    )
