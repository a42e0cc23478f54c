"""Smooth running of a sampled loop and its growth from the exact matrix of the loop, for controllers that have slopes."""

from __future__ import annotations

import numpy as np

from toolbox.arguments import FloatArray
from toolbox.errors import SceneError
from toolbox.onsets.motions import Growth, Smooth, in_phase, least_damped, slip_rows
from toolbox.simulation.request import Request
from toolbox.simulation.run import Run
from toolbox.simulation.run_state import RunState
from toolbox.steady_states.linear_loop import checked_smooth
from toolbox.steady_states.sampled_matrix import matrix_over_period
from toolbox.steady_states.steady_loop import STANDS, SampledPoint, without_sensor_errors

WAY = "matrices"
"""The word for a growth that is known from the exact matrix."""


def exact_run(base: Run) -> Run | None:
    """The run whose sampled loop has a matrix, without the errors of sensors; None where a controller is in Python, or samples are late or missed."""
    if not all(clock.regular for clock in base.clocks) or base.controllers or any(update.from_callable for update in base.system.updates):
        return None
    loop = without_sensor_errors(base.loop)
    return base if loop.system.p.numel() == base.system.p.numel() else Request(loop, 0.0, accuracy=base.accuracy).checked()


def exact_smooth(run: Run, begin: RunState, target: Run) -> Smooth | None:
    """Return smooth running near a state, with its growth from the exact matrix of the loop. None if no smooth running is found.

    target: the run whose states the result has, which may have noise.

    Raises
    ------
    NoDerivative
        If the loop has no slope there.
    """
    try:
        inputs = {name: float(value) for name, value in run.inputs.items()}
        point = SampledPoint(run.system, run.plant, run.clocks, inputs)
        states = {name: begin[name] for name in run.system.states}
        memory = {name: begin[name] for update in run.system.updates for name in update.places}
        if not point.placed(states, memory, {}):
            return None
        held = {name: begin[name] for name in point.names if name}
        q = next(
            (q for guess in (point.with_outputs(states, memory), point.begun(states, held)) if (q := point.solved(guess)) is not None), None
        )
    except SceneError:
        return None
    if q is None or any(
        e.law is not None and mode * slip <= STANDS for e, mode, slip in zip(run.system.elements, point.m, point.slips(q), strict=True)
    ):
        return None
    slope = point.slope(q)
    checked_smooth(point.value, slope, q)
    matrix, span = matrix_over_period(point, slope)
    rows = slip_rows(run.system, q[: point.n], run.system.values)
    exponents, motions, errors = modes_of(matrix, span)
    rows = np.hstack([rows, np.zeros((len(rows), len(matrix) - point.n))])
    best = least_damped(exponents, motions, rows)
    state = RunState.begun(target.system, target.plant, target.clocks).with_values(point.start(run.plant, q, kick=0.0))
    motion = in_phase(motions[:, best], rows)
    moved = state.with_values(point.start(run.plant, q + motion[: q.size] * _small(q, motion), kick=0.0))
    direction = (moved.values - state.values) / _small(q, motion)
    return Smooth(state, Growth.of(complex(exponents[best]), WAY, float(errors[best])), direction)


def _small(q: FloatArray, motion: FloatArray) -> float:
    """A factor with which a motion is not lost in the round-off of a point, nor larger than it."""
    return float((np.abs(q).max(initial=0.0) or 1.0) / (np.abs(motion[: q.size]).max(initial=0.0) or 1.0))


def modes_of(matrix: FloatArray, span: float) -> tuple[np.ndarray, np.ndarray, FloatArray]:
    """(exponents, motions, errors of the exponents by round-off) of the matrix of a loop over a time `span` [s].

    Each multiplier is that of its left and right motion, which is exact to the second order of what the solver leaves of them; the error is what round-off
    of each entry of the matrix makes of it, which no choice of units changes.
    """
    from scipy.linalg import eig, matrix_balance

    balanced, (scale, _) = matrix_balance(matrix, separate=True, permute=False)
    multipliers, lefts, rights = eig(balanced, left=True, right=True)
    lefts = lefts.conj()
    products = (lefts * rights).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        better = (lefts * (balanced @ rights)).sum(axis=0) / products
        multipliers = np.where(np.abs(better - multipliers) < 1e-3 * np.abs(multipliers), better, multipliers)
        sizes = np.where(multipliers == 0.0, 1e-300, np.abs(multipliers))
        changes = (np.abs(lefts) * (np.abs(balanced) @ np.abs(rights))).sum(axis=0) / np.abs(products)
        errors = len(matrix) * np.finfo(float).eps * changes / (sizes * span)
    exponents = np.log(np.where(multipliers == 0.0, 1e-300, multipliers).astype(complex)) / span
    return exponents, rights * scale[:, None], errors
