"""How stable steady running is: its poles."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from toolbox.arguments import numbers
from toolbox.files.units import NumberOrText
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.steady_states.equilibria import EquilibriumBranch
from toolbox.steady_states.linear import linearise


@takes_loop
def pole_locus(loop: ClosedLoop, parameter: str, values: Sequence[NumberOrText], *, mode: Mapping[str, str] | None = None) -> np.ndarray:
    """Compute the poles of steady running while a parameter varies.

    For the locus over a loop gain, or a Bode diagram, give what `linearise` returns to `control`.

    Parameters
    ----------
    loop
        A loop of laws in their continuous form, or a plant.
    parameter, values
        The parameter or input, and its values.
    mode
        As in `equilibrium`.

    Returns
    -------
    complex array, shape (len(values), number of poles)
        Each column follows its pole from row to row; a row is nan where there is no steady state.
    """
    from scipy.optimize import linear_sum_assignment

    loop = loop.unsampled()
    free = loop.acting(parameter, "pole_locus")
    followed = EquilibriumBranch(loop.system, free, loop.constant_inputs("steady running"), mode)
    rows: list[np.ndarray | None] = []
    before: np.ndarray | None = None
    for value in numbers("values", free.in_si("values", values)):
        point = followed(value)
        if point is None:
            rows.append(None)
            continue
        poles = np.sort_complex(np.asarray(linearise(point.plant, point).poles(), complex))
        if before is not None and before.size == poles.size:
            poles = poles[linear_sum_assignment(np.abs(before[:, None] - poles[None, :]))[1]]
        rows.append(poles)
        before = poles
    width = max((row.size for row in rows if row is not None), default=0)
    return np.array([np.full(width, complex(math.nan, math.nan)) if row is None else row for row in rows])
