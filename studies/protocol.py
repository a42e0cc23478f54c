"""The protocol by which laws of a drill string are judged (`toolbox.drilling.set_points`) on one rig: plant, machines beside it, and the drive before.

Plant: the two inertias of Jansen and van den Steen with the bit of Navarro-Lopez and Cortes at 97 347 N. A law is designed on it for a set-point, measures
the top speed alone, commands 0 to 20 kN m and knows that its commands come 30 ms late. A stiff PI drive has the rig in stick-slip at the same set-point;
the law takes over at one of 8 phases of that cycle, directly or while the set-point is raised. Groups of machines: `nominal`, `noisy`, `one_at_a_time`,
`combined`, `other_rocks` and `varying_weight` as `machine_groups` has them, and among the rocks one with a Gaussian law, with the same static torque and
the same excess over all speeds.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from controllers import StiffPI
from models import BitRock, Exponential, GaussianStribeck, wells
from toolbox import Sampled, closed_loop, compose
from toolbox.drilling.groups import Machine, machine_groups
from toolbox.drilling.set_points import Trial

WEIGHT = 97_347.0
ROCK = BitRock(weight=WEIGHT)
PLANT = compose(wells.JANSEN_2, ROCK)
LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}
NOISE, DELAY = 0.01, 0.03
LOWEST, HIGHEST, STEP = 1.5, 14.0, 0.1
"""Set-points [rad/s] that are searched."""
ROCKS: dict[str, BitRock] = {
    "exponential": ROCK,
    "Gaussian": BitRock(weight=WEIGHT, friction=GaussianStribeck(static=0.8, kinetic=0.5, stribeck_speed=1.2538)),
    "half the decay": BitRock(weight=WEIGHT, friction=Exponential(decay=0.45)),
}
GROUPS = machine_groups(PLANT, NOISE, DELAY)
GROUPS["other_rocks"] = replace(
    GROUPS["other_rocks"], machines=(Machine("Gaussian", plant=compose(wells.JANSEN_2, ROCKS["Gaussian"])), *GROUPS["other_rocks"].machines)
)
SINGLES, CORNERS = GROUPS["one_at_a_time"].machines, GROUPS["combined"].machines


STIFF = StiffPI(**LIMITS)
"""The drive that has the rig in stick-slip."""


def trial(label: str, law: Any, period: float = 0.01) -> Trial:
    """A law on the rig, and its period [s]."""
    return Trial(replace(closed_loop(PLANT, Sampled(law, period, DELAY)), label=label), STIFF)


def rock_torques(reference: float) -> dict[str, float]:
    """Torque [N m] of each of `ROCKS` at a set-point: they agree at rest."""
    from controllers.string_model import rock_slope

    return {name: rock_slope(compose(wells.JANSEN_2, rock), reference)[0] for name, rock in ROCKS.items()}
