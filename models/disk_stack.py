"""Stack of disks, as in the brake of an aircraft wheel: rotors keyed to the wheel between stators keyed to the axle."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from models.friction import Exponential
from models.shaft import chain_frequencies
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, quantity, state
from toolbox.authoring import NumberOrText, number, whole


@dataclass(frozen=True)
class DiskStack(Component):
    """Multi-disc brake: rotors and stators in alternation, pressed together by an actuator.

    Each of the 2 n interfaces sticks and slips independently. Disk j = 0 .. 2n is a stator if j is even and a rotor if
    j is odd. Interface i lies between the disks i and i+1 and has its own load N_i:

        rotor    J_r w_j' = T_(j-1) + T_j - k_r a_j - c_r a_j' ,   a_j' = w_j - w_wheel
        stator   J_s w_j' = -T_(j-1) - T_j - k_s a_j - c_s a_j' ,  a_j' = w_j
        wheel    I w_wheel' = T + sum over rotors (k_r a_j + c_r a_j')
        T_i      friction torque of interface i, N_i R mu against rotor speed - stator speed
        axial    m_j z_j'' = N_(j-1) - N_j - c_z z_j' ,  N_i = max(0, F_0 + k_c (z_i - z_(i+1)))
                 N_(-1) = F_a (actuator),  N_2n = F_0 + k_b z_2n (back plate)

    Symbols and their fields: J_r `rotor_inertia`, J_s `stator_inertia` and I `wheel_inertia` [kg m2], k_r
    `rotor_stiffness` and k_s `stator_stiffness` [N m/rad], c_r `rotor_damping` and c_s `stator_damping` [N m s/rad],
    m_j `rotor_mass` or `stator_mass` [kg], k_c `contact_stiffness` and k_b `back_stiffness` [N/m], c_z `axial_damping`
    [N s/m], R `radius` [m], n `rotors`, mu friction law `friction`.

    - The position z_j is counted from the position at rest under F_0, the field `actuator_force`. A start from zero is
      therefore a closed stack.
    - Faces may separate and touch again. The contacts have no damping, so their force has a kink at this point but no
      jump. The axial motion is damped at the keys.
    - Friction has no influence on the axial motion. Only inertia makes the loads of the interfaces differ.

    Signals:

    - Needs `stack.torque` T [N m] (default 0) and `stack.actuator_force` F_a [N] (default: the field `actuator_force`).
    - Gives `stack.brake_torque` [N m], the torque of all rotors against the wheel, and `stack.load` (2n) [N].
    - States: `stack.twist` (2n+1) [rad], `stack.speed` (2n+1) [rad/s], `stack.wheel_speed` [rad/s], `stack.position`
      (2n+1) [m], `stack.axial_speed` (2n+1) [m/s].
    - Contacts: `stack.i`, i from 0 to 2n-1.

    This model is a reconstruction. Of the eight-rotor assembly of J. A. Larsson and K. Farhang only the abstract was
    available. The abstract reports slip phases of nearly constant duration and stick phases that become longer up to
    the last stick phase. The equations and the default values are chosen to reproduce this result.

    Examples
    --------
    >>> from models import DiskStack
    >>> from toolbox import compose
    >>> plant = compose(DiskStack())
    >>> print(plant.x.numel(), "states,", len(plant.elements), "contacts")
    69 states, 16 contacts
    """

    rotors: int = 8
    wheel_inertia: Quantity = quantity(320.0, "kg m2", "inertia of the wheel and of the mass that it carries", above=0)
    rotor_inertia: Quantity = quantity(0.02, "kg m2", "inertia of a rotor", above=0)
    stator_inertia: Quantity = quantity(0.02, "kg m2", "inertia of a stator", above=0)
    rotor_stiffness: Quantity = quantity(20_000.0, "N m/rad", "stiffness of the keys between a rotor and the wheel", at_least=0)
    rotor_damping: Quantity = quantity(1.0, "N m s/rad", "damping of those keys", at_least=0)
    stator_stiffness: Quantity = quantity(2000.0, "N m/rad", "stiffness of the mount of a stator", at_least=0)
    stator_damping: Quantity = quantity(3.0, "N m s/rad", "damping of the mount", at_least=0)
    rotor_mass: Quantity = quantity(2.0, "kg", "mass of a rotor", above=0)
    stator_mass: Quantity = quantity(2.0, "kg", "mass of a stator", above=0)
    contact_stiffness: Quantity = quantity(1e7, "N/m", "axial stiffness of an interface", above=0)
    back_stiffness: Quantity = quantity(1e7, "N/m", "axial stiffness behind the last stator", above=0)
    axial_damping: Quantity = quantity(100.0, "N s/m", "damping of the axial motion of a disk in its keys", at_least=0)
    actuator_force: Quantity = quantity(1000.0, "N", "force of the actuator", at_least=0)
    radius: Quantity = quantity(0.1, "m", "effective radius of the contacts", above=0, typical_range=(1e-3, 5.0))
    friction: FrictionLaw = Exponential(static=0.4, kinetic=0.3, decay=2.0)

    def check(self):
        whole("rotors", self.rotors, 1)

    def equations(self, signal):
        n = 2 * self.rotors + 1
        twist, speed = state("stack.twist", "rad", n), state("stack.speed", "rad/s", n)
        wheel = state("stack.wheel_speed", "rad/s")
        z, v = state("stack.position", "m", n), state("stack.axial_speed", "m/s", n)
        torque = signal("stack.torque", "N m", default=0.0)
        actuator = signal("stack.actuator_force", "N", default=self.actuator_force)

        rotor = np.arange(n) % 2 == 1

        def per_disk(of_rotor, of_stator):
            return ca.vertcat(*[of_rotor if turns else of_stator for turns in rotor])

        inertia, mass = per_disk(self.rotor_inertia, self.stator_inertia), per_disk(self.rotor_mass, self.stator_mass)
        stiffness = per_disk(self.rotor_stiffness, self.stator_stiffness)
        damping = per_disk(self.rotor_damping, self.stator_damping)

        # loads less F_0, whose round-off would shake the disks that nothing has reached yet
        growth = ca.fmax(-self.actuator_force, self.contact_stiffness * (z[:-1] - z[1:]))
        load = self.actuator_force + growth
        ahead = ca.DM([1.0 if turns else -1.0 for turns in rotor[:-1]])  # 1 where the disk before the interface is the rotor
        slip = ahead * (speed[:-1] - speed[1:])
        contacts = [
            DryFriction(f"stack.{i}", slip[i], self.friction, load[i] * self.radius, slip_unit="rad/s", force_unit="N m")
            for i in range(n - 1)
        ]
        friction = ahead * ca.vertcat(*[contact.force for contact in contacts])  # on the disk before the interface
        twist_rate = speed - per_disk(wheel, 0)
        mount = stiffness * twist + damping * twist_rate
        brake = -ca.dot(ca.DM(rotor.astype(float)), mount)
        behind = self.back_stiffness * z[-1]
        return Equations(
            flow={
                twist: twist_rate,
                speed: (ca.vertcat(friction, 0) - ca.vertcat(0, friction) - mount) / inertia,
                wheel: (torque - brake) / self.wheel_inertia,
                z: v,
                v: (ca.vertcat(actuator - self.actuator_force, growth) - ca.vertcat(growth, behind) - self.axial_damping * v) / mass,
            },
            outputs={"stack.brake_torque": (brake, "N m"), "stack.load": (load, "N")},
            elements=contacts,
            stored=self.wheel_inertia * wheel**2 / 2
            + ca.dot(inertia, speed**2) / 2
            + ca.dot(stiffness, twist**2) / 2
            + ca.dot(mass, v**2) / 2
            + ca.sumsqr(load) / (2 * self.contact_stiffness)
            + (self.actuator_force + behind) ** 2 / (2 * self.back_stiffness),
            losses={
                "friction": sum(-contact.force * slip[i] for i, contact in enumerate(contacts)),
                "mounts": ca.dot(damping, twist_rate**2),
                "keys": self.axial_damping * ca.sumsqr(v),
            },
            supplies={"torque": torque * wheel, "actuator": actuator * v[0]},
        )

    def static_positions(self, force: NumberOrText) -> np.ndarray:
        """Return the axial positions of the disks at rest under an actuator force, as start values without axial motion.

        F_0 is the field `actuator_force`. Every spring of the stack carries the force: z_j = (force - F_0) (1 / k_b +
        (2n - j) / k_c).

        Parameters
        ----------
        force
            Actuator force [N], > 0.

        Returns
        -------
        numpy.ndarray
            Axial positions z [m], shape (2n+1,).

        Raises
        ------
        SceneError
            Unless force > 0. Faces that touch without force would begin with a friction bound and a gap of exactly
            zero.
        """
        force = number("force", force, "N", above=0)
        behind = np.arange(2 * self.rotors, -1, -1)
        return (force - self.actuator_force) * (1 / self.back_stiffness + behind / self.contact_stiffness)

    def axial_frequencies(self) -> np.ndarray:
        """Compute the axial natural frequencies of the closed stack without damping.

        The stack is closed if all neighbouring disks touch, so that every interface acts as a spring of the stiffness
        `contact_stiffness`. The last stator is held by the spring `back_stiffness`.

        Returns
        -------
        numpy.ndarray
            Natural frequencies [rad/s], ascending, shape (2n+1,), with the number n of rotors (the field `rotors`).
        """
        masses = [self.stator_mass, *[self.rotor_mass, self.stator_mass] * self.rotors]
        springs = [*[self.contact_stiffness] * (2 * self.rotors), self.back_stiffness]
        return 2 * np.pi * chain_frequencies([*masses, 1.0], springs, bit_held=True)  # behind the back plate nothing moves
