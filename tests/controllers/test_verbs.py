"""Every verb with every law: it answers, or refuses with a sentence that is true of this law."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from controllers import (
    PI,
)
from models import BitRock, DiscBrake, wells
from toolbox import closed_loop, compose

RIG, BRAKE = compose(wells.JANSEN_2, BitRock(weight="97.347 kN")), compose(DiscBrake())
NUMBERS = {"reference": 8.0}
LIMITED = {**NUMBERS, "lowest_torque": 0.0, "highest_torque": 20_000.0}
SMOOTH = {"chain.speed": (8.0, 8.0), "chain.twist": 18.0}


def in_python(t, y):
    return 11_300.0 + 900.0 * (8.0 - y[0])


@dataclass(frozen=True)
class Rigged:
    """A law on its machine, how it samples, and what each verb refuses of it, in a sentence that its words must match."""

    law: Any
    period: float | None = 0.01
    refusals: dict[str, str] = field(default_factory=dict)
    brake: bool = False
    seconds: float = 0.0

    @property
    def loop(self):
        if self.brake:
            return closed_loop(BRAKE, self.law, sample_time=self.period, start={"disc.speed": 6.0})
        return closed_loop(RIG, self.law, sample_time=self.period, start=SMOOTH)


FREE = "must act continuously for a free cycle"
PYTHON = {"limit_cycle": "a law is a Python callable"}
STEADY = {"limit_cycle": "comes to rest"}
MOVING = {
    "onset": "must not depend on time itself",
    "limit_cycle": "must act continuously for a free cycle|`period` must be given for a driven",
}
BRAKES = {
    "onset": "There is no number `top.reference`", "limit_cycle": FREE, "margins": "No steady running of this loop is known",
    "worst_case": "No steady running of this loop is known",
}  # fmt: skip

LAWS = {
    "PI": Rigged(PI(**NUMBERS), refusals={"limit_cycle": FREE}),
    "PI, continuous": Rigged(PI(**NUMBERS), None, STEADY),
}
