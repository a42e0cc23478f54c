"""Torsion of a drill string: a chain of inertias."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, SceneError, quantity, state
from toolbox.authoring import entries, whole
from toolbox.modelling import OptionalQuantities, Quantities


@dataclass(frozen=True)
class TorsionalChain(Component):
    """Torsional drill string: inertias in a row from the top drive (first) to the bit (last), joined by springs and dampers.

        J_i w_i' = tau_(i-1) - tau_i - c_i w_i + T_i,   tau_i = k_i twist_i + c_i,i+1 (w_i - w_(i+1)),   twist_i' = w_i - w_(i+1)

    Symbols and their fields: J_i `inertia` [kg m2], k_i `stiffness` [N m/rad], c_i,i+1 `damping` [N m s/rad], c_i
    `drag`, `top_drag` and `bit_drag` [N m s/rad]. The inertias are counted from 0, top first, as the entries of the
    fields: `stiffness[i]` and `damping[i]` lie between the inertias i and i+1. twist_i is the angle by which inertia i is
    ahead of inertia i+1, and tau_i the torque of the spring between both. T_i is the torque on inertia i from outside [N
    m]: `top.torque` on the first, -`bit.torque` on the last inertia, and dry friction.

    The states are twists instead of angles: n inertias have 2n-1 states, `chain.twist` (n-1) [rad] and `chain.speed`
    (n) [rad/s].

    Needs the signals

    - `top.torque` [N m] (default 0);
    - `bit.torque` [N m] (default 0), positive against the rotation.

    Gives the signals

    - `top.speed` and `bit.speed` [rad/s];
    - `top.load` tau_0 [N m], the torque with which the string loads the top inertia, positive against the rotation;
    - `bit.free_acceleration` [rad/s2], the acceleration of the last inertia without the rock;
    - `bit.inertia` [kg m2].

    Options:

    - `friction`: dry friction law at the inertias. The contact of inertia i is `chain.i`, i from 0, with the load
      `friction_load[i]`.
    - `friction_load`: one load [N m] per inertia, the side force times the radius that touches the borehole. The
      friction torque is the load times the coefficient of friction. If `friction_load` has n-1 entries, the last inertia
      has no friction (use this if `BitRock` acts there).
    - `friction_at`: indices of the inertias that have friction, one index for each load. Inertias that are not listed
      have no friction.
    - `drag`: viscous drag c_i of every inertia, in addition to `top_drag` and `bit_drag`.
    - `collar_index`: index of the inertia (-1: last) to which a lateral model such as `WhirlingCollar` is attached. The
      chain then also needs `collar.torque` [N m] (default 0) and gives `collar.speed` [rad/s].

    Examples
    --------
    >>> from models import TorsionalChain
    >>> from toolbox import compose
    >>> print(compose(TorsionalChain()))
    HybridSystem(TorsionalChain): 3 states (chain.twist, chain.speed); contacts: none; inputs: top.torque [N m], bit.torque [N m]
    """

    inertia: Quantities = quantity((2122.0, 374.0), "kg m2", "inertias, top first", above=0)
    stiffness: Quantities = quantity((473.0,), "N m/rad", "stiffness between neighbours", at_least=0, typical_range=(1.0, math.inf))
    damping: Quantities = quantity((23.2,), "N m s/rad", "damping between neighbours", at_least=0)
    top_drag: Quantity = quantity(0.0, "N m s/rad", "viscous drag on the top inertia", at_least=0)
    bit_drag: Quantity = quantity(0.0, "N m s/rad", "viscous drag on the last inertia", at_least=0)
    friction: FrictionLaw | None = None
    friction_load: OptionalQuantities = quantity(None, "N m", "load of the friction at every inertia", at_least=0)
    friction_at: tuple[int, ...] | None = None
    drag: OptionalQuantities = quantity(None, "N m s/rad", "viscous drag on every inertia", at_least=0)
    collar_index: int | None = None

    def check(self):
        n = len(self.inertia)
        if n < 2:
            raise SceneError(
                f"Argument `chain.inertia` must hold at least 2 inertias, but it has {n}: one under a table is a `TorsionalPendulum`."
            )
        for name in ("stiffness", "damping"):
            entries(f"chain.{name}", getattr(self, name), n - 1, ", one less than `chain.inertia`")
        if (self.friction is None) != (self.friction_load is None):
            raise SceneError("Arguments `chain.friction` and `chain.friction_load` must be given together.")
        entries("chain.drag", self.drag, n, ", one for each inertia")
        if self.friction_at is not None:
            _check_friction_at(self.friction_at, self.friction_load, n)
        elif self.friction_load is not None and len(self.friction_load) != n - 1:
            entries("chain.friction_load", self.friction_load, n, f", or {n - 1} to leave the last inertia to the rock")
        if self.collar_index is not None:
            whole("chain.collar_index", self.collar_index, -n, n - 1)

    @property
    def element_count(self) -> int:
        """Number of elements of the string."""
        return len(self.stiffness)

    @property
    def mode_summary(self) -> str:
        """Text with the number of inertias and the first three torsional natural frequencies [Hz] of the chain without controller and rock."""
        k, n = np.array(self.stiffness, float), len(self.inertia)
        joints = np.diff(np.eye(n), axis=0)
        root = 1.0 / np.sqrt(np.array(self.inertia, float))
        slopes = root[:, None] * (joints.T * k) @ joints * root
        modes = np.sqrt(np.maximum(np.linalg.eigvalsh(slopes)[1:4], 0.0)) / (2.0 * np.pi)
        word = "mode" if modes.size == 1 else "modes"
        return f"{n} inertias, first torsional {word} at {', '.join(f'{mode:.3g}' for mode in modes)} Hz"

    def equations(self, signal):
        n = len(self.inertia)
        twist, speed = state("chain.twist", "rad", n - 1), state("chain.speed", "rad/s", n)
        top_torque, bit_torque = signal("top.torque", "N m", default=0.0), signal("bit.torque", "N m", default=0.0)
        inertia, stiffness, damping = ca.vertcat(*self.inertia), ca.vertcat(*self.stiffness), ca.vertcat(*self.damping)
        slip = speed[:-1] - speed[1:]
        tau = stiffness * twist + damping * slip
        contacts = {}
        if self.friction is not None:
            at = range(len(self.friction_load)) if self.friction_at is None else self.friction_at
            contacts = {
                i: DryFriction(f"chain.{i}", speed[i], self.friction, load, slip_unit="rad/s", force_unit="N m")
                for i, load in zip(at, self.friction_load, strict=True)
            }
        push = ca.vertcat(0, tau) - ca.vertcat(tau, 0)
        push[0] += top_torque - self.top_drag * speed[0]
        push[-1] -= self.bit_drag * speed[-1]
        for i, contact in contacts.items():
            push[i] += contact.force
        losses = {
            "damping": ca.dot(damping, slip**2),
            "top drag": self.top_drag * speed[0] ** 2,
            "bit drag": self.bit_drag * speed[-1] ** 2,
        }
        if self.drag is not None:
            drag = ca.vertcat(*self.drag)
            push -= drag * speed
            losses["drag"] = ca.dot(drag, speed**2)
        losses |= {f"friction {i}": -contact.force * speed[i] for i, contact in contacts.items()}
        supplies = {"top torque": top_torque * speed[0], "bit torque": -bit_torque * speed[-1]}
        gives = {
            "top.speed": (speed[0], "rad/s"),
            "bit.speed": (speed[-1], "rad/s"),
            "top.load": (tau[0], "N m"),
        }
        if self.collar_index is not None:
            collar_torque = signal("collar.torque", "N m", default=0.0)
            push[self.collar_index] += collar_torque
            gives["collar.speed"] = (speed[self.collar_index], "rad/s")
            supplies["collar torque"] = collar_torque * speed[self.collar_index]
        bit_load = push[-1]
        push[-1] = bit_load - bit_torque
        gives["bit.free_acceleration"] = (bit_load / self.inertia[-1], "rad/s2")
        gives["bit.inertia"] = (self.inertia[-1], "kg m2")
        return Equations(
            flow={twist: slip, speed: push / inertia},
            outputs=gives,
            elements=list(contacts.values()),
            stored=ca.dot(inertia, speed**2) / 2 + ca.dot(stiffness, twist**2) / 2,
            losses=losses,
            supplies=supplies,
        )


def _check_friction_at(at: tuple[int, ...], load: tuple[float, ...] | None, n: int) -> None:
    if load is None:
        raise SceneError("Argument `chain.friction_at` must come with `chain.friction` and `chain.friction_load`, but they are not given.")
    if list(at) != sorted({i for i in at if isinstance(i, (int, np.integer)) and 0 <= i < n}):
        raise SceneError(f"Argument `chain.friction_at` must be increasing numbers of inertias, 0 to {n - 1}, but it is {at!r}.")
    entries("chain.friction_load", load, len(at), ", one for each of `chain.friction_at`")
