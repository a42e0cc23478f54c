"""Every verb with every law: it answers, or refuses with a sentence that is true of this law."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pkgutil import iter_modules
from typing import Any

import numpy as np
import pytest

import controllers
from controllers import (
    LQG,
    LQR,
    PI,
    ActiveDamping,
    BrakeForce,
    BrakeMPC,
    BrakePI,
    BrakeSlidingMode,
    HInfinity,
    IdealSlidingMode,
    ImpedanceSuperTwisting,
    ImplicitSlidingMode,
    Lifting,
    LinearMPC,
    NonlinearMPC,
    NormalDither,
    OnEstimates,
    PhasedDither,
    SlidingMode,
    SoftTorque,
    SquareDither,
    StiffPI,
    SuperTwisting,
    SweptDither,
    ZTorque,
)
from controllers.observers import Kalman, MovingHorizon
from models import BitRock, DiscBrake, wells
from toolbox import SceneError, closed_loop, compose, limit_cycle, margins, onset, simulate, sweep, worst_case
from toolbox.errors import SimulationError
from toolbox.modelling import Observed, Takeover
from toolbox.modelling.laws import Controller

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
MOVING = {"onset": "must not depend on time itself", "limit_cycle": "must act continuously for a free cycle|`period` must be given for a driven"}
BRAKES = {
    "onset": "There is no number `top.reference`", "limit_cycle": FREE, "margins": "No steady running of this loop is known",
    "worst_case": "No steady running of this loop is known",
}  # fmt: skip

LAWS = {
    "PI": Rigged(PI(**NUMBERS), refusals={"limit_cycle": FREE}),
    "PI, continuous": Rigged(PI(**NUMBERS), None, STEADY),
}
