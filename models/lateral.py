"""Lateral motion of a drill collar in its borehole: whirl, and rubbing against the wall.

States are those of the mass centre, because the forces at the geometric centre then never meet the angular acceleration: one Newton equation for
each direction, one moment, and no mass matrix to invert. The published form in polar coordinates is not used: it omits the moment
k_l r e sin(phi - theta) of the bending force about the mass centre, so that its energy is not conserved, and it is singular in the middle of the hole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from models.friction import Coulomb
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, SceneError, Trajectory, UnilateralContact, quantity, state
from toolbox.authoring import window
from toolbox.modelling import OptionalQuantity

TINY = 1e-20
"""A length [m] or speed [m/s] below all others: it gives a collar in the very middle of the hole a direction, and changes no digit elsewhere."""


@dataclass(frozen=True)
class WhirlingCollar(Component):
    """Eccentric drill collar between two stabilisers, which rotates, bends and rubs on the borehole wall (whirl).

        m y_c'' = Y, m z_c'' = Z;   (y_c, z_c) = (y, z) + e (cos phi, sin phi)
        (Y, Z) = -k_l (y, z) - c_h |v| (y', z') - N (y, z)/r + F (-z, y)/r;   M = R_co F + e (Y sin phi - Z cos phi)
        k_l = E I_a pi^4/(2 L^3) - T pi^3/(2 L^2) - W pi^2/(2 L)
        N unilateral contact force with closure r - gap;   F dry friction with load N and slip speed R_co phi' + r theta'

    (y, z) is the geometric centre of the collar [m], (y_c, z_c) its mass centre, phi the angle of rotation of the
    collar, and r and theta are the polar coordinates of (y, z). (y, z) is zero at rest in the middle of the borehole. W
    is the weight on bit, T the torque on bit, and v the velocity (y', z'). N is the force of the wall [N], nonzero only
    for r >= gap. gap is half of `hole_diameter` - `outer_diameter` [m]. m is the modal mass [kg], k_l the lateral
    stiffness [N/m], E I_a the bending stiffness of the pipe [N m2] and c_h the drag of the mud [N s2/m2]. They are
    computed from the fields. Symbols and their fields: e `eccentricity` [m], R_co half of `outer_diameter` [m], L
    `span` [m], E `young` [Pa]. M is the resulting reaction torque on the string.

    Connect the collar to a `TorsionalChain` with `collar_index=` set.

    - Needs the signals `collar.speed` phi' [rad/s], `bit.torque` T [N m] (default 0) and `bit.weight` W [N] (from the
      model of the bit, else the field `weight`).
    - Gives the signals `collar.torque` M [N m], `collar.y` [m], `collar.z` [m], `collar.radius` r [m].
    - States (five): `collar.angle` phi [rad], `collar.displacement` (2) [m] of the mass centre from its position at
      rest, and `collar.velocity` (2) [m/s] of the mass centre.
    - Contacts: `wall`, and its friction `rub`.

    The wall is elastic (`wall_stiffness`, `wall_damping`), or rigid if `restitution` is given.

    Range of validity: one bending mode. If the weight on bit makes k_l negative, the collar lies on the wall.

    This model is a reconstruction of the torsional-lateral string of Hong and Dhupia, of which only the abstract was
    available. Equations and numbers are taken from publications of UFRJ, Rio de Janeiro (stiffness of the wall 1e9 to
    1e10 N/m, damping 0 to 1000 N s/m). The rigid wall with restitution is an addition of this toolbox.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from models import BitRock, WhirlingCollar, wells
    >>> from toolbox import compose
    >>> plant = compose(replace(wells.UFRJ_2, collar_index=-1), BitRock(), WhirlingCollar())
    >>> print(plant.x.numel(), "states,", len(plant.elements), "contacts")
    8 states, 3 contacts
    """

    span: Quantity = quantity(8.55, "m", "length L between stabilisers", above=0, typical_range=(0.5, 500.0))
    outer_diameter: Quantity = quantity(0.171, "m", "outer diameter of the collar, 2 R_co", above=0, typical_range=(0.02, 2.0))
    inner_diameter: Quantity = quantity(0.071, "m", "inner diameter of the collar", at_least=0, typical_range=(0.005, 2.0))
    hole_diameter: Quantity = quantity(0.216, "m", "diameter of the borehole", above=0, typical_range=(0.02, 2.0))
    eccentricity: Quantity = quantity(0.014, "m", "distance e from geometric to mass centre", at_least=0, typical_range=(1e-5, 0.3))
    young: Quantity = quantity(220e9, "Pa", "Young's modulus E of the collar", above=0, typical_range=(1e8, 1e13))
    density: Quantity = quantity(7800.0, "kg/m3", "density of the collar", above=0, typical_range=(300.0, 30_000.0))
    mud_density: Quantity = quantity(1500.0, "kg/m3", "density of the mud", at_least=0, typical_range=(300.0, 5000.0))
    added_mass: Quantity = quantity(1.7, "1", "added mass coefficient C_A", at_least=0)
    drag_coefficient: Quantity = quantity(1.0, "1", "drag coefficient C_D", at_least=0)
    wall_stiffness: Quantity = quantity(1e9, "N/m", "stiffness k_s of an elastic wall", above=0)
    wall_damping: Quantity = quantity(1000.0, "N s/m", "damping c_s of an elastic wall", at_least=0)
    restitution: OptionalQuantity = quantity(None, "1", "restitution of a rigid wall", at_least=0, at_most=1)
    friction: FrictionLaw = Coulomb(static=0.35, kinetic=0.35)
    weight: OptionalQuantity = quantity(None, "N", "weight on bit if no rock gives it", at_least=0, typical_range=(500.0, 5e6))

    def check(self):
        if not self.inner_diameter < self.outer_diameter < self.hole_diameter:
            raise SceneError(
                "Arguments `inner_diameter`, `outer_diameter` and `hole_diameter` must increase, but they are "
                f"{self.inner_diameter:g}, {self.outer_diameter:g} and {self.hole_diameter:g} m."
            )

    @property
    def outer_radius(self) -> Any:
        """Outer radius of the collar, R_co = D_o/2 [m]."""
        return self.outer_diameter / 2

    @property
    def gap(self) -> Any:
        """Radial clearance between collar and borehole, (D_hole - D_o)/2 [m]."""
        return (self.hole_diameter - self.outer_diameter) / 2

    @property
    def modal_mass(self) -> Any:
        """Modal mass m = L (rho A + rho_f pi/4 (D_i^2 + C_A D_o^2))/2 [kg], with the mud inside and the added mass of the mud outside."""
        steel = self.density * np.pi / 4 * (self.outer_diameter**2 - self.inner_diameter**2)
        mud = self.mud_density * np.pi / 4 * (self.inner_diameter**2 + self.added_mass * self.outer_diameter**2)
        return self.span * (steel + mud) / 2

    @property
    def quadratic_drag(self) -> Any:
        """Coefficient of the quadratic drag of the mud, c_h = 2 rho_f C_D D_o L/(3 pi) [N s2/m2]."""
        return 2 * self.mud_density * self.drag_coefficient * self.outer_diameter * self.span / (3 * np.pi)

    @property
    def bending_stiffness(self) -> Any:
        """Lateral stiffness of the unloaded collar, E I_a pi^4/(2 L^3) [N/m]."""
        return self.young * np.pi / 64 * (self.outer_diameter**4 - self.inner_diameter**4) * np.pi**4 / (2 * self.span**3)

    def softening(self, weight: Any, torque: Any) -> Any:
        """Return the reduction of the lateral stiffness by weight and torque, T pi^3/(2 L^2) + W pi^2/(2 L) [N/m].

        Parameters
        ----------
        weight
            Weight on bit W [N].
        torque
            Torque on bit T [N m].

        Returns
        -------
        float or casadi expression
            The reduction [N/m].
        """
        return torque * np.pi**3 / (2 * self.span**2) + weight * np.pi**2 / (2 * self.span)

    def stiffness(self, weight: float = 0.0, torque: float = 0.0) -> Any:
        """Return the lateral stiffness k_l [N/m] under a weight on bit [N] and a torque on bit [N m].

        Parameters
        ----------
        weight
            Weight on bit [N], by default 0.
        torque
            Torque on bit [N m], by default 0.
        """
        return self.bending_stiffness - self.softening(weight, torque)

    def synchronous_radius(self, speed: float, weight: float = 0.0, torque: float = 0.0) -> float:
        """Compute the radius of forward synchronous whirl, m e w^2/|k_l - m w^2| [m], at a speed of rotation w [rad/s].

        k_l is the lateral stiffness under weight and torque, m the modal mass and e the eccentricity. Mud drag and wall
        contact are neglected.

        Parameters
        ----------
        speed
            Speed of rotation w of the collar [rad/s].
        weight
            Weight on bit [N], by default 0.
        torque
            Torque on bit [N m], by default 0.
        """
        return self.modal_mass * self.eccentricity * speed**2 / abs(self.stiffness(weight, torque) - self.modal_mass * speed**2)

    def contact_speed(self, weight: float = 0.0, torque: float = 0.0) -> float:
        """Compute the lowest speed at which steady synchronous whirl reaches the wall, sqrt(k_l/m gap/(gap + e)) [rad/s].

        k_l is the lateral stiffness under weight and torque, m the modal mass, e the eccentricity and gap the radial clearance.
        Mud drag is neglected.

        Parameters
        ----------
        weight
            Weight on bit [N], by default 0.
        torque
            Torque on bit [N m], by default 0.
        """
        return float(np.sqrt(self.stiffness(weight, torque) / self.modal_mass * self.gap / (self.gap + self.eccentricity)))

    def rolling_ratio(self) -> float:
        """Return the whirl ratio theta'/phi' = -R_co/gap [1] of backward whirl in which the collar rolls along the wall
        without slip.
        """
        return -self.outer_radius / self.gap

    def rolling_speed(self, weight: float = 0.0, torque: float = 0.0, friction: float | None = None) -> float:
        """Compute the lowest steady speed of rotation at which a collar keeps rolling backward along a rigid wall.

        The result is inf if friction is too low for rolling at every speed.

            w^2 = mu k_l gap/(mu m R_co^2/gap - m e sqrt(1 + mu^2) - c_h R_co^2)

        The symbols are defined in `WhirlingCollar`. Above this speed the normal force of the wall, N = m gap theta'^2 +
        m e w^2 cos psi - k_l gap, is large enough that friction can balance drag and imbalance at every angle psi = phi
        - theta: |F| = |m e w^2 sin psi + c_h gap^2 theta'^2| <= mu N.

        Parameters
        ----------
        weight, torque
            Weight on bit [N] and torque on bit [N m], which reduce the stiffness k_l, by default 0.
        friction
            Coefficient of friction mu. By default the static coefficient of the friction law.

        Returns
        -------
        float
            The speed of rotation w [rad/s].
        """
        mu = float(self.friction.breakaway()) if friction is None else friction
        held = (
            mu * self.modal_mass * self.outer_radius**2 / self.gap
            - self.modal_mass * self.eccentricity * np.sqrt(1 + mu**2)
            - self.quadratic_drag * self.outer_radius**2
        )
        return float(np.sqrt(mu * self.stiffness(weight, torque) * self.gap / held)) if held > 0 else np.inf

    def equations(self, signal):
        phi, speed = state("collar.angle", "rad"), signal("collar.speed", "rad/s")
        displacement, velocity = state("collar.displacement", "m", 2), state("collar.velocity", "m/s", 2)
        torque, weight = signal("bit.torque", "N m", default=0.0), signal("bit.weight", "N", default=self.weight)
        e, sin, cos = self.eccentricity, ca.sin(phi), ca.cos(phi)
        centre = displacement + e * ca.vertcat(2 * ca.sin(phi / 2) ** 2, -sin)  # 1 - cos would be all round-off at small angles
        v = velocity + e * speed * ca.vertcat(sin, -cos)
        off_centre = centre + ca.vertcat(TINY, 0)
        r = ca.norm_2(off_centre)
        outward, along = off_centre / r, ca.vertcat(-off_centre[1], off_centre[0]) / r
        rigid = self.restitution is not None
        wall = UnilateralContact(
            "wall", r - self.gap, ca.dot(outward, v), restitution=self.restitution,
            stiffness=None if rigid else self.wall_stiffness, damping=0.0 if rigid else self.wall_damping,
        )  # fmt: skip
        slip = self.outer_radius * speed + ca.dot(along, v)
        rub = DryFriction("rub", slip, self.friction, wall.force)
        softening = self.softening(weight, torque)
        current = ca.sqrt(ca.dot(v, v) + TINY**2)
        force = (softening - self.bending_stiffness) * centre - self.quadratic_drag * current * v - wall.force * outward + rub.force * along
        moment = self.outer_radius * rub.force + e * (force[0] * sin - force[1] * cos)
        return Equations(
            flow={phi: speed, displacement: velocity, velocity: force / self.modal_mass},
            outputs={
                "collar.torque": (moment, "N m"),
                "collar.y": (centre[0], "m"),
                "collar.z": (centre[1], "m"),
                "collar.radius": (r, "m"),
            },
            elements=[wall, rub],
            stored=self.modal_mass * ca.dot(velocity, velocity) / 2 + self.bending_stiffness * ca.dot(centre, centre) / 2 + wall.stored,
            losses={"mud": self.quadratic_drag * current**3, "rub": -rub.force * slip, "wall": wall.loss},
            supplies={"string": -moment * speed, "weight and torque": softening * ca.dot(centre, v)},
        )


def whirl_ratio(run: Trajectory, after: float = 0.0, until: float | None = None, name: str = "collar") -> float:
    """Measure the whirl ratio: revolutions of the centre of a collar around the borehole per revolution of the collar.

        ratio = (theta(end) - theta(begin)) / (phi(end) - phi(begin)),   theta = atan2(z, y), counted on over full turns

    phi is the angle of rotation of the collar, the state `collar.angle` [rad]. theta is the polar angle of its centre in
    the borehole [rad], from the signals `collar.y` y and `collar.z` z [m]. begin and end are the ends of the window.

    The ratio is positive if the centre moves around the borehole in the direction in which the collar rotates:

    - 1 in forward synchronous whirl;
    - -R_co/gap while the collar rolls backward along the wall without slip. R_co is the outer radius of the collar and
      gap the radial clearance between collar and borehole, both [m].

    If the centre passes through the middle of the borehole, this counts as half a revolution, in either direction.

    Parameters
    ----------
    run
        The run.
    after, until
        Begin and end of the window [s]. By default the whole run.
    name
        Name of the collar, by default "collar".

    Returns
    -------
    float
        The ratio [1], the mean over the window. nan if the angle of the collar is the same at both ends of the window.

    Raises
    ------
    SceneError
        If the window lies outside the run, or the run has no collar of this name.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from models import BitRock, WhirlingCollar, wells, whirl_ratio
    >>> from toolbox import compose, simulate
    >>> plant = compose(replace(wells.UFRJ_2, collar_index=-1), BitRock(weight="60 kN"), WhirlingCollar())
    >>> run = simulate(plant, "20 s", inputs={"top.torque": "9 kN m"})
    >>> print(f"{whirl_ratio(run, after=10.0):.2f}")
    1.00
    """
    begin, end = window(run, after, until)
    times = np.unique(np.concatenate([run.every_step.time[(run.every_step.time > begin) & (run.every_step.time < end)], [begin, end]]))
    for _ in range(12):  # until neighbours are less than a quarter turn apart
        samples = run.every_step.at(times)
        theta = np.unwrap(np.arctan2(samples[f"{name}.z"], samples[f"{name}.y"]))
        far = np.flatnonzero(np.abs(np.diff(theta)) > np.pi / 4)
        if not far.size:
            break
        times = np.sort(np.concatenate([times, 0.5 * (times[far] + times[far + 1])]))
    turned = run.every_step.at(np.array([begin, end]))[f"{name}.angle"]
    return float((theta[-1] - theta[0]) / (turned[1] - turned[0])) if turned[1] != turned[0] else np.nan
