"""A drill string that slides along its hole and turns in it at once: one friction cone for both."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from models.axial import AxialChain
from models.drill_string import TorsionalChain
from toolbox import ContactProblem, FrictionLaw, SceneError
from toolbox.authoring import check_fields, finite_array, is_finite_number


def sliding_resultant(friction: float, load: float, axial_speed: float, turning_speed: float, radius: float) -> tuple[float, float]:
    """Axial force [N] and torque [N m] of dry friction on a string that slides and turns, both against its motion.

        F = mu N v / s ,   T = mu N R (R w) / s ,   s = sqrt(v^2 + (R w)^2)

    Turning takes axial drag away, and the other way round: only the resultant is mu N.
    Source: textbook (torque and drag).

    Parameters
    ----------
    friction, load
        mu [1] and N [N], >= 0.
    axial_speed, turning_speed
        v [m/s] and w [rad/s].
    radius
        R [m], > 0.

    Raises
    ------
    SceneError
        For numbers that are not finite or out of range, and at rest, where friction is whatever holds.
    """
    for word, value in (("friction", friction), ("load", load), ("axial_speed", axial_speed), ("turning_speed", turning_speed), ("radius", radius)):
        if not is_finite_number(value) or (word in ("friction", "load") and value < 0) or (word == "radius" and value <= 0):
            raise SceneError(f"Argument `{word}` must be a finite number in its range, but it is {value!r}.")
    speed = math.hypot(axial_speed, radius * turning_speed)
    if speed == 0:
        raise SceneError("Arguments `axial_speed` and `turning_speed` must not both be 0: at rest friction is whatever holds.")
    return friction * load * axial_speed / speed, friction * load * radius * (radius * turning_speed / speed)


def string_on_wall(
    axial: AxialChain, torsional: TorsionalChain, *, radius: float, loads: Sequence[float], friction: FrictionLaw
) -> ContactProblem:
    """A string with dry friction against the wall of its hole at every mass, by one cone for axial and turning slip, for `toolbox.step_contacts`.

    Inputs: `hook.speed` [m/s], downwards, and `top.speed` [rad/s] at which hook and top drive move; `bit.weight` [N] and `bit.torque` [N m] against the last
    mass. Outputs, relative to hook and top drive: `axial.i` [m], `twist.i` [rad], i from 0; the hook load is the weight of the string less stiffness[0]
    times `axial.0`, the torque of the top drive -stiffness[0] times `twist.0`.
    The run is written in the frame of hook and top drive, in which the hole moves: exact while their speeds are constant, without the forces of
    their acceleration where they change. Own drags of the chains (`drag`, `top_drag`, `bit_drag`) and their friction are not taken over.

    Parameters
    ----------
    axial
        n masses behind hoisting lines (no `hook_load`).
    torsional
        n + 1 inertias, of which the first is the top drive; the others belong to the masses in order.
    radius
        Of the surface that touches the wall [m].
    loads
        Side forces on the wall [N], shape (n,), 0 for none but at least one > 0.
    friction
        The law of friction.

    Raises
    ------
    SceneError
        For chains that do not fit each other, loads < 0 and a radius that is not > 0.
    """
    for chain in (axial, torsional):
        check_fields(chain)
    n = len(axial.mass)
    if axial.hook_load is not None:
        raise SceneError("Argument `axial` must hang on hoisting lines: leave its `hook_load` out.")
    if len(torsional.inertia) != n + 1:
        raise SceneError(f"Argument `torsional` must have {n + 1} inertias, the top drive and one for each mass, but it has {len(torsional.inertia)}.")
    if not is_finite_number(radius) or not radius > 0:
        raise SceneError(f"Argument `radius` must be a finite number > 0 m, but it is {radius!r}.")
    side = finite_array(loads)
    if side is None or side.shape != (n,) or (side < 0).any() or not side.any():
        raise SceneError(f"Argument `loads` must be {n} numbers >= 0 N, one for each mass, that are not all 0, but it is {loads!r}.")
    stiffness, damping = (_block(_chain(a), _chain(b)) for a, b in ((axial.stiffness, torsional.stiffness), (axial.damping, torsional.damping)))
    mass = np.diag([*axial.mass, *torsional.inertia[1:]])
    unit = np.eye(2 * n)
    rubbing = np.flatnonzero(side)
    ones = np.ones((rubbing.size, 1))
    return ContactProblem(
        mass,
        stiffness,
        np.stack([unit[rubbing], radius * unit[n + rubbing]], axis=1),
        friction,
        load=side[rubbing],
        damping=damping,
        forces={"bit.weight": -unit[n - 1], "bit.torque": -unit[2 * n - 1]},
        surface={"hook.speed": -ones * [1.0, 0.0], "top.speed": -ones * [0.0, radius]},
        outputs={f"axial.{i}": unit[i] for i in range(n)} | {f"twist.{i}": unit[n + i] for i in range(n)},
    )


def _chain(springs: Sequence[float]) -> np.ndarray:
    """Matrix of springs in a row, the first of which is fixed."""
    k = np.asarray(springs, float)
    below = np.append(k[1:], 0.0)
    return np.diag(k + below) - np.diag(k[1:], 1) - np.diag(k[1:], -1)


def _block(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.block([[first, np.zeros((len(first), len(second)))], [np.zeros((len(second), len(first))), second]])
