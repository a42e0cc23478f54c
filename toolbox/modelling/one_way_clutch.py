"""A clutch that holds a slip as a stop holds a gap: by a force of one sign."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import casadi as ca

from toolbox.errors import SceneError
from toolbox.modelling.elements import Element


class OneWayClutch(Element):
    """One-way clutch (freewheel, sprag clutch) or ratchet without play, locked against positive slip and free for negative slip.

        locked:  slip = 0 and force >= 0          free:  slip < 0 and force = 0

    `slip` is the speed of the driving side minus the speed of the driven side. `force` acts positively on the driven
    side and negatively on the driving side in the equations of motion. The force has no upper bound.

    - To model a ratchet that holds a drum, use a clutch between the drum and the ground.
    - A start with slip > 0 raises an error.
    - An impact at another contact is transmitted if the clutch is locked, or if the impact locks it.

    Examples
    --------
    >>> from models import OverrunningDrive
    >>> from toolbox import compose, simulate
    >>> run = simulate(compose(OverrunningDrive()), 5.0, inputs={"driver.torque": 1.0})
    >>> print(run.modes["clutch"][-1])
    locked
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
