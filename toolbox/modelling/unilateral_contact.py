"""Contacts that push and never pull: elastic, or rigid with impacts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import casadi as ca

from toolbox.errors import SceneError
from toolbox.modelling.elements import Element


class UnilateralContact(Element):
    """Unilateral contact, which pushes and never pulls: its force N is >= 0 and acts only while the gap is closed.

        elastic (stiffness k, damping c):  N = k d + c d' while closed; closes when d and k d + c d' are both positive, opens at N = 0
        rigid (restitution e):             d' = 0 while closed, opens at N = 0; an impact turns d' into -e d'

    `closure` d is the overlap of the bodies, negative while the contact is open. `rate` is its rate of change d'. Give
    either `stiffness` or `restitution`. Stiffness and damping may be expressions. For example, `damping=c * stiffness *
    closure` is the contact of Hunt and Crossley, N = k d (1 + c d').

    - In the equations of motion N must act against the closure, with the sign that reduces d'.
    - Friction at the contact is a `DryFriction` with load N. List it after the unilateral contact in `elements`.
    - A rigid impact includes a Coulomb impulse of the same friction law. The energy never rises: if Newton's
      restitution would increase it, the impact is plastic.
    - When the bounces become too small to be resolved, the contact closes.
    - For the energy audit, `stored` [J] is the energy of the elastic contact and `loss` [W] the power of its damper.
      Energy that the spring still holds at opening is lost, as in an impact.

    Source: B. Brogliato, Nonsmooth Mechanics, 3rd ed., Springer 2016.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from toolbox import Component, Equations, UnilateralContact, compose, state
    >>> @dataclass(frozen=True)
    ... class Ball(Component):
    ...     def equations(self, signal):
    ...         z, v = state("ball.height", "m"), state("ball.speed", "m/s")
    ...         floor = UnilateralContact("floor", closure=-z, rate=-v, restitution=0.8)
    ...         return Equations(flow={z: v, v: floor.force - 9.81}, elements=[floor])
    >>> print(compose(Ball()))
    HybridSystem(Ball): 2 states (ball.height, ball.speed); contacts: floor; inputs: none
    """

    mode_names: Mapping[int, str] = {1: "open", 0: "closed"}
    expression_fields: ClassVar[tuple[str, ...]] = (*Element.expression_fields, "closure", "rate", "relaxation", "restitution")
    event_field: ClassVar[str] = "closure"
    has_gap: ClassVar[bool] = True
    initial = 1

    def __init__(
        self,
        name: str,
        closure: ca.SX,
        rate: ca.SX,
        *,
        stiffness: ca.SX | float | None = None,
        damping: ca.SX | float = 0.0,
        restitution: ca.SX | float | None = None,
        rate_unit: str = "m/s",
        force_unit: str = "N",
    ):
        if (stiffness is None) == (restitution is None):
            raise SceneError(f"`{name}` must have either a `stiffness`, for an elastic contact, or a `restitution`, for a rigid one.")
        self.holds = self.rigid = stiffness is None
        super().__init__(name, rate if self.holds else 0, rate_unit, force_unit)
        self.closure = ca.SX(closure)
        self.rate = ca.SX(rate)
        closed = 1 - self.mode
        self.stored, self.loss = ca.SX(0), ca.SX(0)
        self.relaxation = ca.SX(0)  # c/k, the time in which an unloaded contact would relax
        self.restitution = ca.SX(0 if restitution is None else restitution)
        if stiffness is None:
            self.force = -self.multiplier
        else:
            self.relaxation = damping / ca.SX(stiffness)
            self.force = closed * (stiffness * self.closure + damping * self.rate)
            self.stored = closed * stiffness * self.closure**2 / 2
            self.loss = closed * damping * self.rate**2

    def guards(self, multiplier: ca.SX, bound: ca.SX) -> tuple[ca.SX, ca.SX]:
        if self.holds:
            return -multiplier - self.mode * self.closure, ca.SX(1)
        pressed = self.relaxation * self.rate
        return (1 - self.mode) * (self.closure + pressed) - self.mode * (self.closure + ca.fmin(0, pressed)), ca.SX(1)

    def signals(self) -> dict[str, tuple[ca.SX, str]]:
        return {"force": (self.force, self.force_unit), "closure": (self.closure, self.slip_unit.removesuffix("/s"))}
