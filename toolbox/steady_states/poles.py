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
from toolbox.steady_states.sampled_hopf import SampledBranch, check_slopes, refuse_modes


@takes_loop
def pole_locus(loop: ClosedLoop, parameter: str, values: Sequence[NumberOrText], *, mode: Mapping[str, str] | None = None) -> np.ndarray:
    """Compute the poles of smooth running while a parameter varies.

    For a root locus over a loop gain, or for a Bode diagram, give the result of `linearise` to python-control.

    Parameters
    ----------
    loop
        A loop, or a plant. A sampled controller must have a slope: its command must be a differentiable function of its
        measurements.
    parameter, values
        The parameter or input, and its values.
    mode
        {contact or relay: mode} of the steady state. By default contacts slide in the direction in which they slide
        at the start.

    Returns
    -------
    complex array, shape (len(values), number of poles)
        Each column follows one pole from row to row. A row is nan if there is no steady state. Continuous loops have
        poles s [1/s]. Sampled loops have poles z = exp(s T), with the time T after which all sample times coincide
        again.

    Raises
    ------
    SceneError
        If a name is unknown, or a sampled controller has no slope.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import closed_loop, compose
    >>> from toolbox.steady_states import pole_locus
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), SoftTorque(reference="60 rpm"))
    >>> poles = pole_locus(loop, "top.reference", ["30 rpm", "60 rpm"])
    >>> print(poles.real.max(axis=1).round(3), "1/s")
    [ 0.11  -0.117] 1/s
    """
    from scipy.optimize import linear_sum_assignment

    check_slopes(loop)
    free = loop.differentiable_number(parameter, "pole_locus", lambda number: number.kind.poles)
    if loop.is_sampled:
        refuse_modes(mode, "pole_locus")
        poles_at = SampledBranch(loop, free).poles
    else:
        followed = EquilibriumBranch(loop.continuous_loop.system, free, loop.constant_inputs("steady running"), mode)

        def poles_at(value: float) -> np.ndarray | None:
            point = followed(value)
            return None if point is None else np.asarray(linearise(point.plant, point).poles(), complex)

    rows: list[np.ndarray | None] = []
    before: np.ndarray | None = None
    for value in numbers("values", free.in_si("values", values)):
        found = poles_at(value)
        if found is None:
            rows.append(None)
            continue
        poles = np.sort_complex(found)
        if before is not None and before.size == poles.size:
            poles = poles[linear_sum_assignment(np.abs(before[:, None] - poles[None, :]))[1]]
        rows.append(poles)
        before = poles
    width = max((row.size for row in rows if row is not None), default=0)
    return np.array([np.full(width, complex(math.nan, math.nan)) if row is None else row for row in rows])
