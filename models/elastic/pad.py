"""An elastic pad pressed on a disc: squeal by mode coupling where regions of the face stick, slip and part."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from models.elastic.reduced_body import ReducedBody
from models.friction import Coulomb
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, SceneError, UnilateralContact, quantity, state
from toolbox.authoring import halved
from toolbox.modelling import Quantities


@dataclass(frozen=True)
class ElasticPad(Component):
    """Elastic pad on a disc that moves under it, in a plane: M q'' + C q' + K q = forces on its ports.

        N_i = k_c (y_i + a_i) + c_c y_i' if the contact is closed and this value is > 0, else 0
        F_i dry friction with slip speed x_i' - v_disc and load N_i

    Contact i consists of two ports of the reduced body: `along.i`, with the displacement x_i along the disc, and
    `into.i`, with the displacement y_i into the disc. A spring k_c, the field `contact_stiffness` [N/m], represents
    lining and disc. c_c is the field `contact_damping` [N s/m]. q is counted from the unloaded pad. a_i is the field
    `initial_approach` [m], the distance by which the disc is pushed into contact i (preload).

    With one rigid mass on two springs the model equals `SquealingPad` with the preload k_c a. In contrast to
    `SquealingPad` the contact may open.

    - Needs the signals `disc.speed` v_disc [m/s] (default: the field `disc_speed`) and `pad.push` [N] (default 0), a
      force on the port `force_ports`. It pushes the pad into the disc if the positive direction of that port points
      into the disc.
    - Gives the signals `pad.normal_force` and `pad.friction_force` [N] of all contacts.
    - States: `pad.displacement` q and `pad.rate` q', only with the modes that at least one port excites.
    - Elements: `touch.i` with the modes "open" and "closed", and `pad.i` with the modes "stick" and "slip+/-".

    Range of validity: small strains, the same disc speed under all contacts, about ten contacts.

    Examples
    --------
    >>> import numpy as np
    >>> from models import ElasticPad, ReducedBody
    >>> body = ReducedBody(("along.0", "into.0"), np.eye(2), np.zeros((2, 2)), np.array([[2e6, 1e6], [1e6, 2e6]]))
    >>> pad = ElasticPad(body, initial_approach=(1e-5,), contact_stiffness=1e6)
    >>> print(f"unstable above a friction coefficient of {pad.flutter_friction(up_to=3.0):.3f}")
    unstable above a friction coefficient of 1.250
    """

    body: ReducedBody = field(metadata={"meaning": "the reduced body; in a scene file the path of its .npz, or a table of its attributes"})
    initial_approach: Quantities = quantity(unit="m", meaning="approach of the disc at every contact; below 0 a gap")
    contact_stiffness: Quantity = quantity(1e8, "N/m", "stiffness k_c of one contact", above=0)
    contact_damping: Quantity = quantity(0.0, "N s/m", "damping c_c of one contact", at_least=0)
    disc_speed: Quantity = quantity(1.0, "m/s", "speed of the disc under the pad")
    force_ports: str | None = None
    friction: FrictionLaw = Coulomb(static=0.5, kinetic=0.5)

    def check(self):
        if not isinstance(self.body, ReducedBody):
            raise SceneError(f"Argument `body` must be a ReducedBody, as `ElasticBody.reduced` makes it, but it is {self.body!r}.")
        along, into = self.body.indices("along"), self.body.indices("into")
        if not len(along) == len(into) == len(self.initial_approach):
            raise SceneError(
                f"Argument `pad.initial_approach` must have one entry for each contact, as ports `along.i` and `into.i`, but there are "
                f"{len(self.initial_approach)}, {len(along)} and {len(into)}."
            )
        if self.force_ports is not None:
            self.body.index(self.force_ports)

    @property
    def _body(self) -> ReducedBody:
        return self.body.controllable_body

    def equations(self, signal):
        n, along, into = self._body.size, self._body.indices("along"), self._body.indices("into")
        q, v = state("pad.displacement", "m", n), state("pad.rate", "m/s", n)
        disc_speed = signal("disc.speed", "m/s", default=self.disc_speed)
        push = signal("pad.push", "N", default=0.0) if self.force_ports is not None else 0.0
        touch = [
            UnilateralContact(
                f"touch.{i}", q[j] + self.initial_approach[i], v[j], stiffness=self.contact_stiffness, damping=self.contact_damping
            )
            for i, j in enumerate(into)
        ]
        pad = [DryFriction(f"pad.{i}", v[j] - disc_speed, self.friction, touch[i].force) for i, j in enumerate(along)]
        places = [*into, *along] + ([self._body.index(self.force_ports)] if self.force_ports is not None else [])
        forces = ca.vertcat(
            *(-contact.force for contact in touch), *(contact.force for contact in pad), *([push] if self.force_ports is not None else [])
        )
        compliance = np.linalg.inv(self._body.mass)
        compliance = (compliance + compliance.T) / 2
        inner = -ca.DM(compliance @ self._body.stiffness) @ q - ca.DM(compliance @ self._body.damping) @ v
        normal, drag = sum(contact.force for contact in touch), sum(contact.force for contact in pad)
        slips = [v[j] - disc_speed for j in along]
        supplies = {"disc drive": drag * disc_speed}
        if self.force_ports is not None:
            supplies["push"] = push * v[self._body.index(self.force_ports)]
        return Equations(
            flow={q: v, v: inner + ca.DM(compliance[:, places]) @ forces},
            outputs={"pad.normal_force": (normal, "N"), "pad.friction_force": (drag, "N")},
            elements=[*touch, *pad],
            stored=(ca.bilin(ca.DM(self._body.mass), v, v) + ca.bilin(ca.DM(self._body.stiffness), q, q)) / 2
            + sum(contact.stored for contact in touch),
            losses={
                "friction": -sum(contact.force * slip for contact, slip in zip(pad, slips, strict=True)),
                "damping": ca.bilin(ca.DM(self._body.damping), v, v),
                "contact": sum(contact.loss for contact in touch),
            },
            supplies=supplies,
        )

    def _coefficient(self, friction: float | None) -> float:
        """The coefficient with the sign of the speed of the disc: that given, or that of the law at this speed."""
        coefficient = float(self.friction.sliding(ca.SX(abs(self.disc_speed)))) if friction is None else friction
        return math.copysign(coefficient, self.disc_speed)

    def steady_sliding_displacement(self, friction: float | None = None, push: float = 0.0) -> np.ndarray:
        """Compute the displacements at steady sliding, as a start for runs.

        For a positive disc speed the friction of the disc pulls the pad in the direction of positive x.

        Parameters
        ----------
        friction
            Coefficient of friction. By default the coefficient of the friction law at the speed of the disc.
        push
            Force on the port `force_ports` [N], by default 0.

        Returns
        -------
        numpy.ndarray
            Displacements q [m], shape (n,).

        Raises
        ------
        SceneError
            If no consistent set of closed contacts is found.
        """
        along, into, count = self._body.indices("along"), self._body.indices("into"), len(self.initial_approach)
        mu = self._coefficient(friction)
        closed, approach = np.ones(count, bool), np.asarray(self.initial_approach)
        for _ in range(4 * count + 4):
            matrix, force = self._body.stiffness.copy(), np.zeros(self._body.size)
            if self.force_ports is not None:
                force[self._body.index(self.force_ports)] += push
            for i in np.flatnonzero(closed):
                matrix[into[i], into[i]] += self.contact_stiffness
                matrix[along[i], into[i]] -= mu * self.contact_stiffness
                force[into[i]] -= self.contact_stiffness * approach[i]
                force[along[i]] += mu * self.contact_stiffness * approach[i]
            try:
                q = np.linalg.solve(matrix, force)
            except np.linalg.LinAlgError:
                break
            should = q[into] + approach > 0
            if (should == closed).all():
                return q
            closed = should
        raise SceneError(
            "Argument `initial_approach` must press the pad somewhere, in a way that can last, but no set of closed contacts is at rest."
        )

    def poles(self, friction: float | None = None) -> np.ndarray:
        """Compute the eigenvalues of steady sliding with constant friction, if all closed contacts slip.

        The set of closed contacts is taken from `steady_sliding_displacement`.

        Parameters
        ----------
        friction
            Coefficient of friction. By default the coefficient of the friction law at the speed of the disc; the slope
            of the friction law is neglected.

        Returns
        -------
        numpy.ndarray
            Eigenvalues [1/s], shape (2 n,), sorted by decreasing real part.
        """
        along, into = self._body.indices("along"), self._body.indices("into")
        mu = self._coefficient(friction)
        closed = self.steady_sliding_displacement(friction)[into] + np.asarray(self.initial_approach) > 0
        stiffness, damping = self._body.stiffness.copy(), self._body.damping.copy()
        for i in np.flatnonzero(closed):
            for matrix, contact in ((stiffness, self.contact_stiffness), (damping, self.contact_damping)):
                matrix[into[i], into[i]] += contact
                matrix[along[i], into[i]] -= mu * contact
        n = self._body.size
        system = np.block(
            [[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(self._body.mass, stiffness), -np.linalg.solve(self._body.mass, damping)]]
        )
        found = np.linalg.eigvals(system).astype(complex)
        return found[np.argsort(-found.real)]

    def flutter_friction(self, up_to: float = 2.0, tolerance: float = 1e-6) -> float:
        """Find the smallest coefficient of friction at which steady sliding becomes unstable. inf if steady sliding is
        stable up to the coefficient `up_to`.

        The search scans 200 coefficients and refines the first unstable one by bisection, with the eigenvalues of
        `poles`. It may miss an unstable range that is narrower than one step of the scan. Without damping the poles of
        a stable pad lie on the imaginary axis. A pole counts as unstable if its real part is above 1e-7 of the
        magnitude of the fastest pole.

        Parameters
        ----------
        up_to
            Largest coefficient of friction of the search, by default 2.
        tolerance
            Absolute tolerance of the bisection, by default 1e-6.

        Returns
        -------
        float
            The coefficient [1].
        """

        def unstable(mu: float) -> bool:
            poles = self.poles(mu)
            return bool(poles[0].real > 1e-7 * np.abs(poles).max())

        low = 0.0
        for high in np.linspace(0.0, up_to, 201)[1:]:
            if unstable(high):
                return float(sum(halved(unstable, low, high, 0.0, tolerance)) / 2)
            low = float(high)
        return math.inf
