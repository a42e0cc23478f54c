"""A drill string that slides along its hole and turns in it at once: one friction cone for both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from models.axial import AxialChain
from models.drill_string import TorsionalChain
from models.friction import Coulomb
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, SceneError, quantity
from toolbox.authoring import NumberOrText, array, check_fields, number
from toolbox.contacts import ContactBody, ContactProblem
from toolbox.modelling import Quantities


@dataclass(frozen=True)
class WallContact(Component):
    """Dry friction at the lower end of a string that lies on the wall of its borehole, off bottom, with one cone for sliding and rotation.

        stick:  v = 0, R w = 0,  sqrt(F^2 + (T / R)^2) <= mu_s N
        slip:   F = mu N v / s,  T = mu N R (R w) / s,  s = sqrt(v^2 + (R w)^2)      both against the motion

    F is the axial force and T the torque of the friction. N is the side force, the field `load` [N], and R the radius
    that touches the wall, the field `radius` [m]. mu and mu_s are the kinetic and the static coefficient of the law
    `friction` [1]. v is the axial speed [m/s] and w the speed of rotation [rad/s]. Rotation reduces the axial drag: a
    string that friction holds in axial direction begins to slide when it is rotated.

    The part replaces the rock. It acts on the last mass of an `AxialChain` and on the last inertia of a
    `TorsionalChain`, and every switch is located as an event. For friction at every mass, computed in time steps, use
    `StringOnWall`.

    - Needs the signals `bit.axial_speed` v [m/s], positive downwards, and `bit.speed` w [rad/s].
    - Gives the signals `wall.drag` F [N] and `wall.torque` T [N m]. They act on the chains as `bit.weight` and
      `bit.torque`.
    - Contact: `wall`, with the modes "stick" and "slip". `wall.force` [N] is sqrt(F^2 + (T / R)^2), and `wall.slip`
      [m/s] is s.

    The default values are examples of the size of 200 m of collars on the low side of a horizontal borehole.

    Source: textbook (torque and drag).

    Examples
    --------
    >>> from models import AxialChain, TorsionalChain, WallContact
    >>> from toolbox import compose
    >>> print(compose(AxialChain(), TorsionalChain(), WallContact()))
    HybridSystem(AxialChain, TorsionalChain, WallContact): 5 states (axial.stretch, axial.speed, chain.twist,
      chain.speed); contacts: wall, wall.direction; inputs: hook.speed [m/s], top.torque [N m]
    """

    load: Quantity = quantity(150_000.0, "N", "side force on the wall", at_least=0, typical_range=(10.0, 1e7))
    radius: Quantity = quantity(0.085, "m", "radius of the surface that touches the wall", above=0, typical_range=(0.01, 1.0))
    friction: FrictionLaw = Coulomb(static=0.35, kinetic=0.25)

    def equations(self, signal):
        v, w = signal("bit.axial_speed", "m/s"), signal("bit.speed", "rad/s")
        wall = DryFriction("wall", ca.vertcat(v, self.radius * w), self.friction, self.load)
        drag, torque = -wall.force[0], -self.radius * wall.force[1]
        # the chains book the power that leaves them at their lower ends
        gives = {"wall.drag": (drag, "N"), "wall.torque": (torque, "N m"), "bit.weight": (drag, "N"), "bit.torque": (torque, "N m")}
        return Equations(outputs=gives, elements=[wall])


def sliding_resultant(
    friction: float, load: NumberOrText, axial_speed: NumberOrText, turning_speed: NumberOrText, radius: NumberOrText
) -> tuple[float, float]:
    """Compute axial force and torque of dry friction on a string that slides along its borehole and rotates at the same time.

    Both act against the motion.

        F = mu N v / s ,   T = mu N R (R w) / s ,   s = sqrt(v^2 + (R w)^2)

    Rotation reduces the axial drag, and sliding reduces the torque: only the resultant is mu N. Source: textbook
    (torque and drag).

    Parameters
    ----------
    friction
        Coefficient of friction mu [1], >= 0.
    load
        Normal load N [N], >= 0.
    axial_speed
        Axial speed v [m/s].
    turning_speed
        Speed of rotation w [rad/s].
    radius
        Radius R [m], > 0.

    Returns
    -------
    float, float
        Axial force F [N] and torque T [N m].

    Raises
    ------
    SceneError
        If a number is not finite or out of range, or both speeds are 0: friction at rest depends on the other forces.

    Examples
    --------
    >>> from models import sliding_resultant
    >>> force, torque = sliding_resultant(0.3, "10 kN", axial_speed=0.1, turning_speed="60 rpm", radius=0.1)
    >>> print(f"{force:.0f} N, {torque:.0f} N m")
    472 N, 296 N m
    """
    friction, load = number("friction", friction, at_least=0), number("load", load, "N", at_least=0)
    axial_speed, turning_speed = number("axial_speed", axial_speed, "m/s"), number("turning_speed", turning_speed, "rad/s")
    radius = number("radius", radius, "m", above=0)
    speed = math.hypot(axial_speed, radius * turning_speed)
    if speed == 0:
        raise SceneError("Arguments `axial_speed` and `turning_speed` must not both be 0: at rest friction is whatever holds.")
    return friction * load * axial_speed / speed, friction * load * radius * (radius * turning_speed / speed)


def string_on_wall(
    axial: AxialChain,
    torsional: TorsionalChain,
    *,
    radius: NumberOrText,
    loads: Sequence[float],
    friction: FrictionLaw,
    top_drive: bool = False,
) -> ContactProblem:
    """Return a string with dry friction against the wall of its borehole at every mass, for `toolbox.contacts.step_contacts`.

    Axial sliding and rotation share one friction cone at every mass.

    Inputs:

    - `hook.speed` [m/s], positive downwards, and `top.speed` [rad/s]: speeds of hook and top drive.
    - `bit.weight` [N] and `bit.torque` [N m]: load against the last mass.

    Outputs, relative to hook and top drive:

    - `axial.i` [m] and `twist.i` [rad], i from 0.
    - The hook load is the weight of the string minus stiffness[0] times `axial.0`.
    - The torque of the top drive is -stiffness[0] times `twist.0`.

    With `top_drive` the first inertia of `torsional` is driven by the input `top.torque` [N m], with its `top_drag`, in
    place of the input `top.speed`. The outputs `top` and `bit` are then the angles of both ends [rad], and controllers
    measure `top.speed` and give `top.torque`.

    The equations are written in the frame of hook and top drive, in which the borehole moves. This is exact while their
    speeds are constant. While their speeds change, the inertial forces of this frame are missing. The fields `drag` and
    `bit_drag` of the chains and their friction are not used.

    Parameters
    ----------
    axial
        n masses behind hoisting lines (no `hook_load`).
    torsional
        n + 1 inertias. The first is the top drive. The others belong to the masses in order.
    radius
        Radius of the surface that touches the wall [m].
    loads
        Side forces on the wall [N], shape (n,). 0 for no contact, but at least one must be > 0.
    friction
        The friction law.
    top_drive
        Whether the top drive is an inertia under a torque. By default it moves at the speed `top.speed`.

    Returns
    -------
    ContactProblem
        The string with its contacts.

    Raises
    ------
    SceneError
        If the chains do not fit each other, a load is < 0, or the radius is not > 0.

    Examples
    --------
    >>> from models import AxialChain, Coulomb, TorsionalChain, string_on_wall
    >>> from toolbox.contacts import step_contacts
    >>> axial = AxialChain(mass=(5000.0,), stiffness=(4e6,), damping=(2e5,))
    >>> torsional = TorsionalChain(inertia=(2000.0, 100.0), stiffness=(2000.0,), damping=(80.0,))
    >>> string = string_on_wall(axial, torsional, radius=0.1, loads=(5000.0,), friction=Coulomb(0.3, 0.3))
    >>> for turning in (0.0, 6.0):
    ...     run = step_contacts(string, "30 s", step=0.02, inputs={"hook.speed": -0.1, "top.speed": turning})
    ...     print(f"{turning} rad/s: drag {4e6 * run['axial.0'][-1]:.0f} N")
    0.0 rad/s: drag 1500 N
    6.0 rad/s: drag 247 N
    """
    for chain in (axial, torsional):
        check_fields(chain)
    n = len(axial.mass)
    if axial.hook_load is not None:
        raise SceneError("Argument `axial` must hang on hoisting lines: leave its `hook_load` out.")
    if len(torsional.inertia) != n + 1:
        raise SceneError(
            f"Argument `torsional` must have {n + 1} inertias, the top drive and one for each mass, but it has {len(torsional.inertia)}."
        )
    radius = number("radius", radius, "m", above=0)
    side = array("loads", loads, (n,), 0.0)
    if not side.any():
        raise SceneError("Argument `loads` must hold one that is > 0 N, but all are 0.")
    if not isinstance(top_drive, bool):
        raise SceneError(f"Argument `top_drive` must be True or False, but it is {top_drive!r}.")
    first = 0 if top_drive else 1  # of the inertias that are coordinates: behind a top drive that is told its speed the twists are relative
    twists = [_free_chain(row)[first:, first:] for row in (torsional.stiffness, torsional.damping)]
    twists[1][0, 0] += torsional.top_drag if top_drive else 0.0
    from scipy.linalg import block_diag

    stiffness, damping = (
        block_diag(_free_chain(row)[1:, 1:], twist) for row, twist in zip((axial.stiffness, axial.damping), twists, strict=True)
    )
    mass = np.diag([*axial.mass, *torsional.inertia[first:]])
    unit = np.eye(len(mass))
    along, turn = unit[:n], unit[len(mass) - n :]
    rubbing = np.flatnonzero(side)
    ones = np.ones((rubbing.size, 1))
    top = unit[n] if top_drive else np.zeros(len(mass))
    ends = {"top": top, "bit": turn[-1]} if top_drive else {}
    torque, told = {"top.torque": top}, {"top.speed": -ones * [0.0, radius]}
    outputs = {f"axial.{i}": along[i] for i in range(n)} | {f"twist.{i}": turn[i] - top for i in range(n)} | ends
    return ContactProblem(
        mass,
        stiffness,
        np.stack([along[rubbing], radius * turn[rubbing]], axis=1),
        friction,
        load=side[rubbing],
        damping=damping,
        force_inputs={"bit.weight": -along[-1], "bit.torque": -turn[-1]} | (torque if top_drive else {}),
        surface_velocity={"hook.speed": -ones * [1.0, 0.0]} | ({} if top_drive else told),
        outputs=outputs,
        units={"bit.torque": "N m"}
        | ({"top.torque": "N m"} if top_drive else {"top.speed": "rad/s"})
        | dict.fromkeys([*outputs][n:], "rad"),
    )


@dataclass(frozen=True)
class StringOnWall(ContactBody):
    """Drill string that slides along its borehole and rotates at the same time, with one Coulomb friction cone at every mass.

    This class is for scene files. In Python, the function `string_on_wall` makes the same string.

    Fields, for n masses below the hoisting lines, top first:

    - `mass` [kg], shape (n,).
    - `axial_stiffness` [N/m] and `axial_damping` [N s/m], shape (n,): first the hoisting lines, then the springs between
      neighbouring masses.
    - `inertia` [kg m2], shape (n+1,): first the top drive, then one inertia for each mass.
    - `stiffness` [N m/rad] and `damping` [N m s/rad], shape (n,): springs between neighbouring inertias.
    - `radius` [m] of the surface that touches the wall.
    - `loads` [N], shape (n,): side force on the wall at each mass. 0 means no contact.
    - `friction`: the friction law of all contacts, by default `Coulomb(0.3, 0.3)`.
    - `top_drive`: whether the top drive is an inertia under a torque, by default False. `top_drag` [N m s/rad] is then
      its viscous drag, by default 0.

    The method `problem()` returns the string as a `ContactProblem`, the argument of `toolbox.contacts.step_contacts`.

    - Inputs: `hook.speed` [m/s], positive downwards, `top.speed` [rad/s], `bit.weight` [N] and `bit.torque` [N m].
    - Outputs: the displacements `axial.i` [m] relative to the hook and the angles `twist.i` [rad] relative to the top
      drive, i from 0.
    - With `top_drive=True` the top drive is an inertia under the input `top.torque` [N m] in place of `top.speed`, and
      controllers measure `top.speed` and give `top.torque`.

    Examples
    --------
    >>> from models import StringOnWall
    >>> numbers = {"mass": (5000.0,), "axial_stiffness": (4e6,), "axial_damping": (2e5,), "inertia": (2000.0, 100.0)}
    >>> string = StringOnWall(**numbers, stiffness=(2000.0,), damping=(80.0,), radius=0.1, loads=(1e4,))
    >>> print(string.problem().contacts, "contact,", sorted(string.problem().outputs))
    1 contact, ['axial.0', 'twist.0']
    """

    mass: Quantities = quantity(unit="kg", meaning="masses behind the hoisting lines, top first", above=0)
    axial_stiffness: Quantities = quantity(unit="N/m", meaning="stiffness of the hoisting lines, then between masses", at_least=0)
    axial_damping: Quantities = quantity(unit="N s/m", meaning="damping beside every axial stiffness", at_least=0)
    inertia: Quantities = quantity(unit="kg m2", meaning="inertia of the top drive, then one inertia for every mass", above=0)
    stiffness: Quantities = quantity(unit="N m/rad", meaning="stiffness between inertias", at_least=0)
    damping: Quantities = quantity(unit="N m s/rad", meaning="damping between inertias", at_least=0)
    radius: Quantity = quantity(unit="m", meaning="radius of the surface that touches the wall", above=0)
    loads: Quantities = quantity(unit="N", meaning="side force on the wall at every mass", at_least=0)
    top_drag: Quantity = quantity(0.0, "N m s/rad", "viscous drag on the top drive, if the top drive is an inertia", at_least=0)
    top_drive: bool = False
    friction: FrictionLaw = Coulomb(0.3, 0.3)

    def problem(self) -> ContactProblem:
        check_fields(self)
        axial = AxialChain(mass=self.mass, stiffness=self.axial_stiffness, damping=self.axial_damping)
        torsional = TorsionalChain(inertia=self.inertia, stiffness=self.stiffness, damping=self.damping, top_drag=self.top_drag)
        return string_on_wall(axial, torsional, radius=self.radius, loads=self.loads, friction=self.friction, top_drive=self.top_drive)


def _free_chain(springs: Sequence[float]) -> np.ndarray:
    """Matrix of springs between neighbours in a row; without its first row and column the first spring is fixed there."""
    k = np.asarray(springs, float)
    return np.diag(np.append(k, 0.0) + np.append(0.0, k)) - np.diag(k, 1) - np.diag(k, -1)
