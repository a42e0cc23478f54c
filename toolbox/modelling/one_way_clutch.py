"""A clutch that holds a slip as a stop holds a gap: by a force of one sign."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import casadi as ca

from toolbox.errors import SceneError
from toolbox.modelling.elements import Element


class OneWayClutch(Element):
    """A one-way clutch (freewheel, sprag clutch), or a ratchet without play: it drives one way and runs free the other way.

        locked:  slip = 0 and force >= 0          free:  slip < 0 and force = 0

    `slip` is the speed of the driving side less that of the driven side, and `force` drives the driven side: in the flow it stands with a minus at the driving
    side. A ratchet that holds a drum is one between the drum and the ground. The force has no bound. A start with a slip above zero is an error, and an impact
    elsewhere passes through a clutch that is locked, or that it locks.
    """

    mode_names: Mapping[int, str] = {0: "locked", 1: "free"}
    expression_fields: ClassVar[tuple[str, ...]] = (*Element.expression_fields, "closure")
    rigid = True
    is_unilateral: ClassVar[bool] = True
    initial = 1

    def __init__(self, name: str, slip: ca.SX, *, slip_unit: str = "rad/s", force_unit: str = "N m"):
        super().__init__(name, slip, slip_unit, force_unit)
        if not self.slip.is_scalar():
            raise SceneError(f"Argument `slip` of `{name}` must be one expression, but its shape is {self.slip.shape}.")
        self.force = -self.multiplier
        self.closure = self.slip

    def guards(self, multiplier: ca.SX, bound: ca.SX) -> tuple[ca.SX, ca.SX]:
        return -multiplier - self.mode * self.slip, ca.SX(1)

    def signals(self) -> dict[str, tuple[ca.SX, str]]:
        return {"force": (self.force, self.force_unit), "slip": (self.mode * self.slip, self.slip_unit)}
