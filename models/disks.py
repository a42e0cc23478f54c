"""Two disks in frictional contact, axially rigid: a brake or clutch coming to rest."""

from __future__ import annotations

from dataclasses import dataclass

from models.friction import Exponential
from toolbox import Component, DryFriction, Equations, FrictionLaw, SceneError, quantity, state


def uniform_wear_radius(inner: float, outer: float) -> float:
    """Effective radius of a worn annulus, whose pressure goes as 1/r: R = (R_o + R_i) / 2 [m].

    Torque = mu N R. Raises SceneError unless 0 <= inner < outer. Source: textbook.
    """
    _check_annulus(inner, outer)
    return (outer + inner) / 2


def uniform_pressure_radius(inner: float, outer: float) -> float:
    """Effective radius of a new annulus under uniform pressure: R = (2/3) (R_o^3 - R_i^3) / (R_o^2 - R_i^2) [m].

    Torque = mu N R; never less than the radius of uniform wear. Raises SceneError unless 0 <= inner < outer. Source: textbook.
    """
    _check_annulus(inner, outer)
    return 2 / 3 * (outer**2 + outer * inner + inner**2) / (outer + inner)  # free of cancellation for a thin ring


def _check_annulus(inner: float, outer: float) -> None:
    if not inner >= 0:
        raise SceneError(f"Argument `inner` must be >= 0 m, but it is {inner!r}.")
    if not inner < outer < float("inf"):
        raise SceneError(f"Argument `outer` must be > {inner:g} m, but it is {outer!r}.")


@dataclass(frozen=True)
class TwoDisks(Component):
    """Rotor rubbing on a stator that is held by a torsional spring and damper.

        I1 w1' = T + F ;   I2 w2' = -F - k th2 - c w2 ;   th2' = w2 ;   F friction torque N R mu against w = w1 - w2

    Signals: needs `disks.torque` T [N m] (0) and `disks.normal_force` N [N] (the field). Contact: `disks`. A reconstruction: only the
    abstract of J. A. Larsson and K. Farhang (2016) is public; equations and the defaults (a stop from `disks.rotor_speed` = 2 rad/s) are chosen to
    show what it reports. At much higher initial speed the motion of the stator dies to round-off before its damping turns negative.
    """

    rotor_inertia: float = quantity(20.0, "kg m2", "inertia of the rotor", above=0)
    stator_inertia: float = quantity(0.02, "kg m2", "inertia of the stator", above=0)
    stiffness: float = quantity(2000.0, "N m/rad", "stiffness of the stator mount", at_least=0)
    damping: float = quantity(0.5, "N m s/rad", "damping of the stator mount", at_least=0)
    normal_force: float = quantity(1000.0, "N", "normal force", at_least=0)
    radius: float = quantity(0.1, "m", "effective radius of the contact", above=0)
    friction: FrictionLaw = Exponential(static=0.4, kinetic=0.3, decay=2.0)

    def equations(self, signal):
        w1 = state("disks.rotor_speed", "rad/s")
        th2, w2 = state("disks.stator_angle", "rad"), state("disks.stator_speed", "rad/s")
        torque = signal("disks.torque", "N m", default=0.0)
        load = signal("disks.normal_force", "N", default=self.normal_force) * self.radius
        disks = DryFriction("disks", w1 - w2, self.friction, load, slip_unit="rad/s", force_unit="N m")
        return Equations(
            flow={
                w1: (torque + disks.force) / self.rotor_inertia,
                th2: w2,
                w2: (-disks.force - self.stiffness * th2 - self.damping * w2) / self.stator_inertia,
            },
            elements=[disks],
            stored=self.rotor_inertia * w1**2 / 2 + self.stator_inertia * w2**2 / 2 + self.stiffness * th2**2 / 2,
            losses={"friction": -disks.force * (w1 - w2), "mount": self.damping * w2**2},
            supplies={"torque": torque * w1},
        )
