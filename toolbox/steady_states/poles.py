"""How stable steady running is: its poles, the critical one among them, and the slope of friction that acts as negative damping."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import numbers
from toolbox.files.units import NumberOrText
from toolbox.modelling.closed_loop import ClosedLoop, takes_loop
from toolbox.modelling.steady_point import Equilibrium, function_of, mode_numbers
from toolbox.steady_states.equilibria import EquilibriumBranch, flow_slopes
from toolbox.steady_states.linear import holding_elements, linearise


def friction_slopes(point: Equilibrium) -> dict[str, float]:
    """How steeply the friction of every sliding contact rises with slip speed at a steady state, load * d mu / d|v|.

    In the force unit over the slip unit (N s/m, N m s/rad): where it is negative it acts as negative damping of that size, and steady sliding is
    stable only if the rest of the machine damps more. Contacts that stick are left out.
    """
    plant = point.plant
    m = mode_numbers(plant, point.modes)
    slopes = {}
    for place, (element, mode) in enumerate(zip(plant.elements, m, strict=True)):
        if element.law is None or mode == 0.0:
            continue
        names = [e.name for e in plant.elements]
        companions = [plant.m[names.index(twin.name)] for twin in element.breaks]
        slips = ca.vertcat(*[e.slip for e in plant.elements[place : place + element.directions]])

        def expression(element: Any = element, companions: Any = companions, slips: Any = slips) -> list[ca.SX]:
            speed = ca.SX.sym("speed")
            slope = ca.jacobian(ca.SX(element.law.sliding(speed, *companions)), speed)
            slope = ca.substitute(element.load * slope, speed, element.slip_speed(slips))
            return [ca.substitute(slope, plant.F, plant.switching.force)]

        function = function_of(plant, ("slope", element.name), expression)
        slopes[element.name] = float(function(0.0, point.states, point.inputs, plant.values, m)[0, 0])
    return slopes


def critical_pole(point: Equilibrium) -> tuple[complex, np.ndarray]:
    """The pole with the largest real part (of a pair the one with positive imaginary part), and its eigenvector over all states of the plant.

    The poles that sticking contacts and relays on their surface put at zero do not count.
    """
    plant, m = point.plant, mode_numbers(point.plant, point.modes)
    values, vectors = np.linalg.eig(flow_slopes(point))
    constraints = int(((m == 0.0) & holding_elements(plant)).sum())
    order = np.argsort(np.abs(values))
    keep = np.sort(order[constraints:])
    values, vectors = values[keep], vectors[:, keep]
    best = max(range(values.size), key=lambda i: (values[i].real, values[i].imag))
    return complex(values[best]), vectors[:, best]


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
