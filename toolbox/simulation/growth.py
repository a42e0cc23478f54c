"""How long an implicit step may be so that it follows modes that grow, where the pivots of its elimination do not tell.

The pivots of `toolbox.compilation.implicit_step` tell growth for nothing, and rightly where every contact has an inertia of its own. Where forces hold each
other through coupled inertias, as on a reduced elastic body, they tell nothing: eleven rows of a cube at rest were held to steps of 1e-5 s in place of 1e-3 s,
and a row that broke away with a growth of 7e7/s was passed over in a step of 2e-4 s. There the loop stops after every event and every 32 steps, and asks
the eigenvalues.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from toolbox.compilation import work_layout
from toolbox.compilation.implicit_step import FASTEST_GROWTH, eigenvalues_tell, linearised
from toolbox.compilation.program import Program


def attended(advance: Callable[[Any], int], program: Program) -> Callable[[Any], int]:
    """The compiled loop, with an answer where it asks whether a step may stand."""
    if not program.formulas.implicit:
        return advance

    def through(work: Any) -> int:
        ints, reals = work.ints, work.reals
        end = ints[work_layout.ACCEPTED] + ints[work_layout.REJECTED] + ints[work_layout.BUDGET]
        while True:
            ints[work_layout.BUDGET] = end - ints[work_layout.ACCEPTED] - ints[work_layout.REJECTED]
            status = advance(work)
            if status != work_layout.GROWTH:
                return status
            reals[work_layout.FOLLOWED] = longest_followed(program, work)

    return through


def longest_followed(program: Program, work: Any) -> float:
    """The longest step [s] that follows every growing mode of the plant as it is now; UNTOLD where the pivots tell, inf where none grows."""
    if not eigenvalues_tell(program.form, program.kernel.states):
        return work_layout.UNTOLD
    function, n = _matrix(program), program.system.x.numel()
    matrix = function(work.reals[work_layout.TIME], work.x[:n], work.p, work.m).full()
    try:
        forces = np.linalg.solve(matrix[n:, n:], matrix[n:, :n])
        fastest = np.linalg.eigvals(matrix[:n, :n] - matrix[:n, n:] @ forces).real.max()
    except np.linalg.LinAlgError:
        return work_layout.UNTOLD
    return FASTEST_GROWTH / float(fastest) if fastest > 0.0 else np.inf


def _matrix(program: Program) -> ca.Function:
    """(t, x, p, modes) -> derivatives of [slopes | balance of the forces] by [x | forces]."""
    if "growth" not in program.outputs:
        system, form = program.system, program.form
        force = ca.vertcat(*[element.multiplier for element in system.elements])
        rows, columns = linearised(system.x, force, form)
        n = system.x.numel()
        kept = ca.vertcat(rows[:n], rows[rows.numel() - form.balance.numel() :])  # without what hidden forces add, on which nothing depends
        jacobian = ca.substitute(ca.jacobian(kept, columns), force, form.force)
        program.outputs["growth"] = ca.Function("growth", [system.t, system.x, program.expressions[0], system.m], [jacobian])
    return program.outputs["growth"]
