"""Time stepping: steps of fixed length with contact forces implicit at the velocity level (Moreau-Jean), for many contacts and accumulating impacts.

No switch is located. Over a step h the mean forces F and the change d of the state solve

    d = h (f + theta (f_x d + f_t h) + B F)          theta = 1/2, f and its derivatives at the begin of the step
    stick:    slip(t + h, x) + slip_x d = 0,  of a rigid contact that is struck -e slip(t, x)
    sliding:  F + m kinetic = 0,              kinetic linearised about the begin, weighted by theta

and the modes m are those with |F| <= static where they stick, m slip > 0 where sliding, and 0 <= N, -(slip + e slip_before) >= 0 with one of them zero at a
contact that closes. Modes are found by pivoting, all wrong ones at once and one by one where that cycles; every trial is one sparse elimination without search
for pivots, in an order of minimum degree, so that a chain of contacts costs in proportion to its length.

Inside a step with a switch the error is O(h), and a switch is known to a step. Where the momentum of such a step is right, as on a limit cycle, that error is
not carried along, and away from switches O(h^2) is left. A sticking slip is zero to round-off. Bounces
whose flight is shorter than a step close the contact. Where Newton's restitution with friction would add energy the impact is plastic.

Source: M. Jean, The non-smooth contact dynamics method, Comput. Methods Appl. Mech. Eng. 177 (1999) 235-257; B. Brogliato, Nonsmooth Mechanics,
3rd ed., Springer 2016. Pivoting on modes in place of projected Gauss-Seidel, and the closing of short flights, are this toolbox's own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import casadi as ca
import numpy as np

from toolbox.compilation.emitter import Body, inline
from toolbox.compilation.formulas import ClosedEquations, Formulas, StepCode
from toolbox.modelling.elimination import masked_solve
from toolbox.modelling.rings import limits_of_rings
from toolbox.modelling.shared_holds import REPEATED, Sharing


@dataclass(frozen=True)
class Theta(Formulas):
    """The number of the method: 1/2 is of order two between switches and damps nothing, 1 of order one and damps fast modes."""

    theta: float

    locates: ClassVar[bool] = False

    @property
    def steps(self) -> str:
        return "fixed steps"

    def step(self, equations: ClosedEquations) -> StepCode:
        trial = trial_step(self.theta, equations)
        body = Body()
        places = [("%x", 2), ("%p", 3), ("%m", 4), ("%k", 5)]
        given = [[body.load(pointer, j) for j in range(trial.numel_in(i))] for pointer, i in places]
        (values,) = inline(body, trial, [["%t"], ["%h"], *given])
        for i, value in enumerate(values):
            body.store(value, "%y", i)
        return StepCode({"step": body}, (), trial.n_instructions(), equations.x.numel())


MOREAU_JEAN = Theta("moreau-jean", 1, 1.0, 0.5)


def trial_step(theta: float, equations: ClosedEquations) -> ca.Function:
    """casadi Function (t, h, x, p, m, marks) -> [x after | slip after | force | bound | slip before | closure half a step on |
    restitution] for given modes.

    marks: one per element, 1 where a rigid contact is thrown back, then 1 for laws linearised about the begin of the step, 0 for laws taken there: where
    friction falls so steeply that a step outruns it, no modes agree with its slope; and then the forces of the step before, for f_x.
    Forces are means over a step.
    """
    assert equations.flow is not None
    t, x, p, flow, elements, form = equations.t, equations.x, equations.p, equations.flow, equations.elements, equations.form
    n, ne = x.numel(), len(elements)
    h = ca.SX.sym("h")

    def column(values: list[ca.SX]) -> ca.SX:
        return ca.vertcat(*values) if values else ca.SX(0, 1)

    force, mode, slip = (column([getattr(e, name) for e in elements]) for name in ("multiplier", "mode", "slip"))
    elastic, ahead, last = ca.SX.sym("elastic", ne), ca.SX.sym("ahead"), ca.SX.sym("last", ne)
    restitution = column([e.restitution for e in elements])
    closure = column([e.closure for e in elements])
    # a load that an elastic contact gives is below zero until the contact is seen to be open, at the end of the step
    given = ca.vertcat(t, x, mode)
    positive = [e.law is not None and ca.depends_on(e.load, given) and not ca.depends_on(e.load, force) for e in elements]
    kinetic = column([(ca.fmax(e.load, 0) if above else e.load) * e.sliding for e, above in zip(elements, positive, strict=True)])
    static = column([ca.fmax(e.static, 0) if above else e.static for e, above in zip(elements, positive, strict=True)])
    # a law is taken at the slip that there is, also where a trial turns its direction
    side = ca.sign(slip) + (1 - ca.sign(slip) ** 2) * mode
    straight = ahead * (1 + mode * side) / 2
    none = ca.SX.zeros(force.shape)

    def at_rest(expression: ca.SX) -> ca.SX:
        return ca.substitute(expression, force, none) if ne else expression

    def about(expression: ca.SX) -> ca.SX:
        return ca.substitute(expression, force, last) if ne else expression

    frictions = [i for i, e in enumerate(elements) if e.slides]

    def at_side(expression: ca.SX) -> ca.SX:
        return ca.substitute(expression, mode[frictions], side[frictions]) if frictions else expression

    inputs = ca.jacobian(flow, force)
    pace = ca.densify(at_rest(flow))
    for i in np.flatnonzero(form.levers).tolist():
        # the lever where the slip is looked at: else the gain is negative in a step inside which the lever vanishes
        inputs[:, i] += theta * h * ca.jtimes(ca.densify(inputs[:, i]), x, pace)
    slopes = about(ca.jacobian(flow, x))
    free = h * (pace + theta * h * about(ca.densify(ca.jacobian(flow, t))))
    to_slip = ca.jacobian(slip, x)
    later = ca.substitute(slip, t, t + h)
    sticks = form.sticks
    slides = 1 - sticks
    target = -elastic * restitution * slip

    top = ca.horzcat(ca.SX.eye(n) - h * theta * slopes, -h * inputs)
    stick_rows = ca.horzcat(h * theta * ca.mtimes(to_slip, slopes), h * ca.mtimes(to_slip, inputs) + h * ca.diag(form.floor))
    law_rows = ca.horzcat(
        ca.diag(mode * straight) @ (theta * about(at_side(ca.jacobian(kinetic, x)))),
        ca.SX.eye(ne) + ca.diag(mode) @ at_side(ca.jacobian(kinetic, force)),
    )
    rows = ca.diag(sticks) @ stick_rows + ca.diag(slides) @ law_rows if ne else ca.SX(0, n)
    law = at_rest(at_side(kinetic)) + straight * theta * h * about(at_side(ca.jacobian(kinetic, t))) if ne else ca.SX(0, 1)
    right = ca.vertcat(free, sticks * (target - later - ca.mtimes(to_slip, free)) - slides * mode * law)
    matrix = ca.sparsify(ca.vertcat(top, rows))
    solved = _solved(matrix, right) if not form.shared.members else _shared(matrix, right, form.shared, sticks, h)
    change, found = solved[:n], solved[n:]
    bound = ca.substitute(static, force, found) if ne else static
    let_go_at, least = (
        limits_of_rings(elements, form.gain, ca.vertcat(t, x), found, bound, sticks) if form.shared.members else (found, bound)
    )
    results = [x + change, later + ca.mtimes(to_slip, change), let_go_at, least, slip, closure + 0.5 * h * slip, restitution]
    return ca.Function("trial", [t, h, x, p, mode, ca.vertcat(elastic, ahead, last)], [ca.vertcat(*map(ca.densify, results))])


def _shared(matrix: ca.SX, right: ca.SX, shared: Sharing, sticks: ca.SX, h: ca.SX) -> ca.SX:
    """Solve where frictions hold what others hold, too: their rows yield, and further solutions take the yield out of the motion again."""
    n = matrix.shape[0] - sticks.numel()
    size = ca.vertcat(ca.SX.ones(n), 1 + sticks * (shared.weights - 1))
    matrix, right = ca.sparsify(ca.diag(size) @ matrix), size * right
    yielding = ca.sparsify(matrix + ca.diag(ca.vertcat(ca.SX(n, 1), h * sticks * shared.softness)))
    found = _solved(yielding, right)
    for _ in range(REPEATED):
        found = found + _solved(yielding, right - matrix @ found)
    return found


def _solved(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Solve by elimination without pivoting in an order of minimum degree."""
    size = matrix.shape[0]
    pattern = ca.DM(matrix.sparsity(), 1)
    order = list((pattern + pattern.T + ca.DM.eye(size)).sparsity().amd())
    solution = masked_solve(matrix[order, order], right[order])
    return solution[np.argsort(order).tolist()]
