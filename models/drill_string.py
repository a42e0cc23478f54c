"""Torsion of a drill string: a chain of inertias, and the rock under the bit."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from models.friction import Exponential
from toolbox import Component, DryFriction, Equations, FrictionLaw, SceneError, quantity, state


@dataclass(frozen=True)
class TorsionalChain(Component):
    """Inertias in a row, from the top drive (first) to the bit (last), joined by springs and dampers.

        J_i w_i' = tau_(i-1) - tau_i - c_i w_i + T_i,   tau_i = k_i twist_i + c_i,i+1 (w_i - w_(i+1)),   twist_i' = w_i - w_(i+1)

    Twists instead of angles: n inertias have 2n-1 states, `chain.twist` (n-1) [rad] and `chain.speed` (n) [rad/s].
    Signals: needs `top.torque` [N m] (0) and `bit.torque` [N m] (0, against the rotation); gives `top.speed`, `bit.speed` [rad/s] and
    `top.load` [N m], the torque of the string on the top inertia. `friction` adds dry friction at every inertia i, contact `chain.i`
    (i from 0, like the columns of `chain.speed`), with load `friction_load[i]`; with one load less the last inertia has none, as where
    `BitRock` holds it. `collar` is the inertia (-1 for the last) on which a part acts sideways of the string, such as `WhirlingCollar`: it needs
    `collar.torque` [N m] (0) and gives `collar.speed` [rad/s].
    """

    inertia: tuple[float, ...] = quantity((2122.0, 374.0), "kg m2", "inertias, top first", above=0)
    stiffness: tuple[float, ...] = quantity((473.0,), "N m/rad", "stiffness between neighbours", at_least=0)
    damping: tuple[float, ...] = quantity((23.2,), "N m s/rad", "damping between neighbours", at_least=0)
    top_drag: float = quantity(0.0, "N m s/rad", "viscous drag on the top inertia", at_least=0)
    bit_drag: float = quantity(0.0, "N m s/rad", "viscous drag on the last inertia", at_least=0)
    friction: FrictionLaw | None = None
    friction_load: tuple[float, ...] | None = quantity(None, "N m", "load of the friction at every inertia", at_least=0)
    collar: int | None = None

    def check(self):
        n = len(self.inertia)
        if n < 2:
            raise SceneError(f"Argument `chain.inertia` must hold at least 2 inertias, but it has {n}.")
        for name in ("stiffness", "damping"):
            if len(getattr(self, name)) != n - 1:
                raise SceneError(f"Argument `chain.{name}` must have {n - 1} entries, one less than `chain.inertia`, but it has {len(getattr(self, name))}.")
        if (self.friction is None) != (self.friction_load is None):
            raise SceneError("Arguments `chain.friction` and `chain.friction_load` must be given together.")
        if self.friction_load is not None and len(self.friction_load) not in (n - 1, n):
            raise SceneError(
                f"Argument `chain.friction_load` must have {n} entries, or {n - 1} to leave the last inertia to the rock, but it has "
                f"{len(self.friction_load)}."
            )

        if self.collar is not None and not (type(self.collar) is int and -n <= self.collar < n):
            raise SceneError(f"Argument `chain.collar` must be the number of an inertia, {-n} to {n - 1}, but it is {self.collar!r}.")

    def equations(self, signal):
        n = len(self.inertia)
        twist, speed = state("chain.twist", "rad", n - 1), state("chain.speed", "rad/s", n)
        top_torque, bit_torque = signal("top.torque", "N m", default=0.0), signal("bit.torque", "N m", default=0.0)
        inertia, stiffness, damping = ca.vertcat(*self.inertia), ca.vertcat(*self.stiffness), ca.vertcat(*self.damping)
        slip = speed[:-1] - speed[1:]
        tau = stiffness * twist + damping * slip
        contacts = []
        if self.friction is not None:
            contacts = [
                DryFriction(f"chain.{i}", speed[i], self.friction, self.friction_load[i], slip_unit="rad/s", force_unit="N m")
                for i in range(len(self.friction_load))
            ]
        push = ca.vertcat(0, tau) - ca.vertcat(tau, 0)
        push[0] += top_torque - self.top_drag * speed[0]
        push[-1] -= bit_torque + self.bit_drag * speed[-1]
        for i, contact in enumerate(contacts):
            push[i] += contact.force
        losses = {
            "damping": ca.dot(damping, slip**2),
            "top drag": self.top_drag * speed[0] ** 2,
            "bit drag": self.bit_drag * speed[-1] ** 2,
        }
        losses |= {f"friction {i}": -contact.force * speed[i] for i, contact in enumerate(contacts)}
        gives = {
            "top.speed": (speed[0], "rad/s"),
            "bit.speed": (speed[-1], "rad/s"),
            "top.load": (tau[0], "N m"),
        }
        supplies = {"top torque": top_torque * speed[0], "bit torque": -bit_torque * speed[-1]}
        if self.collar is not None:
            collar_torque = signal("collar.torque", "N m", default=0.0)
            push[self.collar] += collar_torque
            gives["collar.speed"] = (speed[self.collar], "rad/s")
            supplies["collar torque"] = collar_torque * speed[self.collar]
        return Equations(
            flow={twist: slip, speed: push / inertia},
            gives=gives,
            elements=contacts,
            stored=ca.dot(inertia, speed**2) / 2 + ca.dot(stiffness, twist**2) / 2,
            losses=losses,
            supplies=supplies,
        )


@dataclass(frozen=True)
class BitRock(Component):
    """Rock under a rotating bit: set-valued Stribeck torque, T = W R_b [mu_c + (mu_s - mu_c) exp(-gamma |w| / v_f)] sgn w.

    Signals: needs `bit.speed` [rad/s] and `bit.weight` [N] (the field `weight`); gives `bit.torque` [N m]. Contact: `bit`. Defaults: E. M.
    Navarro-Lopez, D. Cortes, J. Sound Vib. 307 (2007) 152-171, doi:10.1016/j.jsv.2007.06.037 (mu_c 0.5, mu_s 0.8, gamma 0.9, v_f 1 rad/s,
    so that decay = gamma / v_f = 0.9 s/rad). The viscous drag of the bit belongs to the chain.
    """

    weight: float = quantity(97_347.0, "N", "weight on bit", at_least=0)
    radius: float = quantity(0.155575, "m", "radius of the bit", above=0)
    friction: FrictionLaw = Exponential(static=0.8, kinetic=0.5, decay=0.9)

    def equations(self, signal):
        speed = signal("bit.speed", "rad/s")
        weight = signal("bit.weight", "N", default=self.weight)
        bit = DryFriction("bit", speed, self.friction, weight * self.radius, slip_unit="rad/s", force_unit="N m")
        # the power that enters the rock is what the chain books as its bit torque
        return Equations(gives={"bit.torque": (-bit.force, "N m")}, elements=[bit])
