"""A plant for tests of lanes whose friction lets go at an instant in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from models import Coulomb
from toolbox import Component, DryFriction, Equations, quantity, state, time


@dataclass(frozen=True)
class FadingBrake(Component):
    """A mass under a force of 1 N and friction whose bound is 2 cos(w t): negative from the time pi/(2 w) on."""

    frequency: float = quantity(1.0, "rad/s", at_least=0)

    def equations(self, signal):
        v = state("mass.speed", "m/s")
        brake = DryFriction("brake", v, Coulomb(static=1.0, kinetic=1.0), load=2.0 * ca.cos(self.frequency * time))
        return Equations(flow={v: 1.0 + brake.force}, elements=[brake])
