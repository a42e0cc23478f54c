"""Two disks in frictional contact, axially rigid or pressed together across a gap: a brake or clutch coming to rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from models.friction import Exponential
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, UnilateralContact, quantity, state
from toolbox.authoring import NumberOrText, number


def uniform_wear_radius(inner: NumberOrText, outer: NumberOrText) -> float:
    """Compute the effective radius of a worn friction ring, whose pressure is proportional to 1/r: R = (R_o + R_i) / 2.

    R_i and R_o are the inner and outer radius. The friction torque is mu N R, with the normal force N. Source:
    textbook.

    Parameters
    ----------
    inner, outer
        Inner and outer radius [m], 0 <= inner < outer.

    Returns
    -------
    float
        Effective radius R [m].

    Raises
    ------
    SceneError
        Unless 0 <= inner < outer.

    Examples
    --------
    >>> from models import uniform_wear_radius
    >>> print(f"{uniform_wear_radius('80 mm', '120 mm') * 1e3:.2f} mm")
    100.00 mm
    """
    inner, outer = _annulus(inner, outer)
    return (outer + inner) / 2


def uniform_pressure_radius(inner: NumberOrText, outer: NumberOrText) -> float:
    """Compute the effective radius of a new friction ring under uniform pressure: R = (2/3) (R_o^3 - R_i^3) / (R_o^2 -
    R_i^2).

    R_i and R_o are the inner and outer radius. The friction torque is mu N R, with the normal force N. R is never
    smaller than the result of `uniform_wear_radius`. Source: textbook.

    Parameters
    ----------
    inner, outer
        Inner and outer radius [m], 0 <= inner < outer.

    Returns
    -------
    float
        Effective radius R [m].

    Raises
    ------
    SceneError
        Unless 0 <= inner < outer.

    Examples
    --------
    >>> from models import uniform_pressure_radius
    >>> print(f"{uniform_pressure_radius('80 mm', '120 mm') * 1e3:.2f} mm")
    101.33 mm
    """
    inner, outer = _annulus(inner, outer)
    return 2 / 3 * (outer**2 + outer * inner + inner**2) / (outer + inner)  # free of cancellation for a thin ring


def _annulus(inner: NumberOrText, outer: NumberOrText) -> tuple[float, float]:
    inner = number("inner", inner, "m", at_least=0)
    return inner, number("outer", outer, "m", above=inner)


@dataclass(frozen=True)
class TwoDisks(Component):
    """Rotor that rubs on a stator, which is held by a torsional spring and a damper.

        I1 w1' = T + F ;   I2 w2' = -F - k th2 - c w2 ;   th2' = w2 ;   F friction torque N R mu with slip speed w = w1 - w2

    Symbols and their fields: I1 `rotor_inertia` and I2 `stator_inertia` [kg m2], k `stiffness` [N m/rad], c `damping`
    [N m s/rad], R `radius` [m], mu friction law `friction`. w1 and w2 are the speeds of rotor and stator [rad/s], th2
    is the angle of the stator [rad].

    F is the friction torque on the rotor [N m], against the slip speed w.

    - Needs the signals `disks.torque` T [N m] (default 0), the torque on the rotor, and `disks.normal_force` N [N]
      (default: the field `normal_force`).
    - States: `disks.rotor_speed` w1 [rad/s], `disks.stator_angle` th2 [rad] and `disks.stator_speed` w2 [rad/s].
    - Contact: `disks`.

    This model is a reconstruction, because only the abstract of J. A. Larsson and K. Farhang (2016) is public. The
    equations and the default values are chosen to reproduce the reported result: a stop (from `disks.rotor_speed` = 2
    rad/s) with stick-slip cycles that begin near the period of the stator and end near three times this period.

    From start speeds up to 4 rad/s every cycle can be computed. From 6 rad/s on the motion of the stator decays to
    round-off before its damping becomes negative. `run.error_estimate` is then of the order of 1.

    Examples
    --------
    >>> from models import TwoDisks
    >>> from toolbox import compose
    >>> plant = compose(TwoDisks())
    >>> print(plant.x.numel(), "states,", len(plant.elements), "contacts")
    3 states, 1 contacts
    """

    rotor_inertia: Quantity = quantity(20.0, "kg m2", "inertia of the rotor", above=0)
    stator_inertia: Quantity = quantity(0.02, "kg m2", "inertia of the stator", above=0)
    stiffness: Quantity = quantity(2000.0, "N m/rad", "stiffness of the stator mount", at_least=0)
    damping: Quantity = quantity(0.5, "N m s/rad", "damping of the stator mount", at_least=0)
    normal_force: Quantity = quantity(1000.0, "N", "normal force", at_least=0)
    radius: Quantity = quantity(0.1, "m", "effective radius of the contact", above=0, typical_range=(1e-3, 5.0))
    friction: FrictionLaw = Exponential(static=0.4, kinetic=0.3, decay=2.0)

    def equations(self, signal):
        torque = signal("disks.torque", "N m", default=0.0)
        return _turning(self, torque, signal("disks.normal_force", "N", default=self.normal_force))


def _turning(disks: Any, torque: ca.SX, force: ca.SX) -> Equations:
    """The torsion of a rotor and a stator under a torque [N m], pressed together by a force [N]."""
    w1 = state("disks.rotor_speed", "rad/s")
    th2, w2 = state("disks.stator_angle", "rad"), state("disks.stator_speed", "rad/s")
    contact = DryFriction("disks", w1 - w2, disks.friction, force * disks.radius, slip_unit="rad/s", force_unit="N m")
    return Equations(
        flow={
            w1: (torque + contact.force) / disks.rotor_inertia,
            th2: w2,
            w2: (-contact.force - disks.stiffness * th2 - disks.damping * w2) / disks.stator_inertia,
        },
        elements=[contact],
        stored=disks.rotor_inertia * w1**2 / 2 + disks.stator_inertia * w2**2 / 2 + disks.stiffness * th2**2 / 2,
        losses={"friction": -contact.force * (w1 - w2), "mount": disks.damping * w2**2},
        supplies={"torque": torque * w1},
    )


@dataclass(frozen=True)
class PressedDisks(Component):
    """Two disks that an actuator presses together across a gap: the torsion of `TwoDisks` with an axial motion that gives the normal force.

        I1 w1' = T + F ;   I2 w2' = -F - k th2 - c w2 ;   th2' = w2 ;   F friction torque N R mu with slip speed w = w1 - w2
        m1 z1'' = F_a - N ;   m2 z2'' = N - k_a z2 - c_a z2' ;   d = z1 - z2 - gap
        N = max(0, k_c d + c_c d') while the faces touch (d > 0), else 0

    Symbols and their fields: I1 `rotor_inertia` and I2 `stator_inertia` [kg m2], k `stiffness` [N m/rad], c `damping`
    [N m s/rad], R `radius` [m], m1 `rotor_mass` and m2 `stator_mass` [kg], k_a `axial_stiffness` and k_c
    `contact_stiffness` [N/m], c_a `axial_damping` and c_c `contact_damping` [N s/m], `gap` [m], mu friction law
    `friction`.

    - Needs the signals `disks.torque` T [N m] (default 0) and `disks.actuator_force` F_a [N] (default: the field
      `actuator_force`).
    - Gives the signal `disks.normal_force` N [N].
    - States of the torsion: `disks.rotor_speed` w1 [rad/s], `disks.stator_angle` th2 [rad] and `disks.stator_speed` w2
      [rad/s].
    - States of the axial motion: `disks.rotor_position` z1 and `disks.stator_position` z2 [m], positive in the direction
      in which the actuator pushes, with `disks.rotor_axial_speed` and `disks.stator_axial_speed` [m/s].
    - Contacts: `disks` (stick and slip) and `disks.faces` (open and closed).

    Friction has no influence on the axial motion.

    This model is a reconstruction, like `TwoDisks`: only the abstract of J. A. Larsson and K. Farhang (2016) was
    available. The parameter values are not published. They are chosen to reproduce the results in the abstract, for a
    stop from 10 rad/s in which the force rises in 50 ms. The axial mount of the stator (k_a, c_a) is an additional
    assumption.

    Examples
    --------
    >>> from models import PressedDisks
    >>> from toolbox import compose
    >>> plant = compose(PressedDisks())
    >>> print(plant.x.numel(), "states,", len(plant.elements), "contacts")
    7 states, 2 contacts
    """

    rotor_inertia: Quantity = quantity(5.0, "kg m2", "inertia of the rotor", above=0)
    stator_inertia: Quantity = quantity(0.02, "kg m2", "inertia of the stator", above=0)
    stiffness: Quantity = quantity(2000.0, "N m/rad", "torsional stiffness of the stator mount", at_least=0)
    damping: Quantity = quantity(0.5, "N m s/rad", "torsional damping of the stator mount", at_least=0)
    radius: Quantity = quantity(0.15, "m", "effective radius of the contact", above=0, typical_range=(1e-3, 5.0))
    rotor_mass: Quantity = quantity(2.0, "kg", "axial mass of the rotor", above=0)
    stator_mass: Quantity = quantity(2.0, "kg", "axial mass of the stator", above=0)
    axial_stiffness: Quantity = quantity(1e7, "N/m", "axial stiffness of the stator mount (assumed)", at_least=0)
    axial_damping: Quantity = quantity(2e3, "N s/m", "axial damping of the stator mount (assumed)", at_least=0)
    contact_stiffness: Quantity = quantity(1e7, "N/m", "stiffness of the contact", above=0)
    contact_damping: Quantity = quantity(2e3, "N s/m", "damping of the contact", at_least=0)
    gap: Quantity = quantity(0.5e-3, "m", "gap between the faces at the start", at_least=0)
    actuator_force: Quantity = quantity(1000.0, "N", "force of the actuator", at_least=0)
    friction: FrictionLaw = Exponential(static=0.5, kinetic=0.3, decay=1.0)

    def equations(self, signal):
        z1, v1 = state("disks.rotor_position", "m"), state("disks.rotor_axial_speed", "m/s")
        z2, v2 = state("disks.stator_position", "m"), state("disks.stator_axial_speed", "m/s")
        torque = signal("disks.torque", "N m", default=0.0)
        actuator = signal("disks.actuator_force", "N", default=self.actuator_force)
        faces = UnilateralContact(
            "disks.faces", z1 - z2 - self.gap, v1 - v2, stiffness=self.contact_stiffness, damping=self.contact_damping
        )
        turning = _turning(self, torque, faces.force)
        return Equations(
            flow={
                **turning.flow,
                z1: v1,
                v1: (actuator - faces.force) / self.rotor_mass,
                z2: v2,
                v2: (faces.force - self.axial_stiffness * z2 - self.axial_damping * v2) / self.stator_mass,
            },
            outputs={"disks.normal_force": (faces.force, "N")},
            elements=[faces, *turning.elements],
            stored=turning.stored
            + self.rotor_mass * v1**2 / 2
            + self.stator_mass * v2**2 / 2
            + self.axial_stiffness * z2**2 / 2
            + faces.stored,
            losses={**turning.losses, "axial mount": self.axial_damping * v2**2, "contact": faces.loss},
            supplies={**turning.supplies, "actuator": actuator * v1},
        )
