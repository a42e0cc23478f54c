"""Watchdog of a predictive law: whether the string does what a plan promises, whatever the solver says of the plan.

Why behaviour: a plan on a model that is not the machine may be solved to the last digit, sample after sample, while the bit stays parked. What cannot lie
is the motion of the top: a string that stands and is not wound up further will stand for ever.
"""

from __future__ import annotations

from typing import Any, ClassVar

import casadi as ca
import numpy as np

from toolbox.modelling import Stateful

STANDING = 0.2
"""Part of the set-point below which the mean speed of the top is a standstill."""
GAINED = 0.02
"""Part by which the torque of the string must exceed what it has held, to count as winding up."""
SWINGING = 0.35
"""Part of the time at each limit of the torque from which on the motor swings between them."""
HOLD = 2.0
"""How long the soft drive acts, in times of the patience; twice as long at every further time, up to `LONGEST`."""
LONGEST = 16.0
STANDS = "the top stands and the string is not wound up further"
SWINGS = "the motor swings between its limits"


class Watchdog(Stateful):
    """Tells in each sample why the soft drive must act, or an empty text.

        mean' = (value - mean) / patience      of top speed, string torque, and of the times at the lowest and at the highest torque

    The string stands where the mean speed of the top has been below `STANDING` of the set-point for the time `patience` and the mean torque of the string has
    not risen by `GAINED` above what it had held before. The motor swings where it spends more than `SWINGING` of the time at each of its limits. The soft
    drive then acts for `HOLD` times the patience, and twice as long each time that this happens again, so that a law that cannot do it ends with the soft
    drive in charge.

    period, patience: in s;  lowest, highest: limits of the torque in N m, None where there is none, and then no swing is seen.
    """

    memory_fields: ClassVar[tuple[str, ...]] = (
        "speed", "load", "held", "stood", "at_lowest", "at_highest", "left", "times", "swings",
    )  # fmt: skip

    def __init__(self, period: float, patience: float, lowest: float | None, highest: float | None):
        self.period, self.patience = period, patience
        self.lowest = -np.inf if lowest is None else lowest
        self.highest = np.inf if highest is None else highest
        self.share = min(1.0, period / patience)
        self.rest()

    def rest(self) -> None:
        """Forget what was seen."""
        self.speed, self.load, self.held, self.stood, self.at_lowest, self.at_highest = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        self.left, self.times, self.swings = 0.0, 0, False

    def __call__(self, speed: float, load: float, command: float, reference: float) -> str:
        """Why the soft drive must act, given top speed [rad/s], string torque on the drive [N m], last command [N m] and set-point [rad/s]."""
        share, span = self.share, self.highest - self.lowest
        self.speed += share * (speed - self.speed)
        self.load += share * (load - self.load)
        edge = 0.01 * span if np.isfinite(span) else 0.0
        self.at_lowest += share * (float(command <= self.lowest + edge) - self.at_lowest)
        self.at_highest += share * (float(command >= self.highest - edge) - self.at_highest)
        if self.left > 0.0:
            self.left -= self.period
            if self.left > 1e-9 * self.period:
                return SWINGS if self.swings else STANDS
            self._forgive()
        standing = self.speed < STANDING * reference
        if not standing:
            self.held, self.stood = 0.0, 0.0
        elif self.load > (1.0 + GAINED) * self.held:
            self.held, self.stood = self.load, 0.0
        else:
            self.stood += self.period
        self.swings = min(self.at_lowest, self.at_highest) > SWINGING
        if self.stood <= self.patience and not self.swings:
            return ""
        self.left = self.patience * min(HOLD * 2.0**self.times, LONGEST)
        self.times += 1
        return SWINGS if self.swings else STANDS

    def _forgive(self) -> None:
        """The law acts again: what it is judged by begins anew."""
        self.held, self.stood, self.at_lowest, self.at_highest, self.left = 0.0, 0.0, 0.0, 0.0, 0.0

    def expressions(self, memory: Any, speed: Any, load: Any, command: Any, reference: Any) -> tuple[Any, Any]:
        """The same sample as casadi expressions, for exported code: (next memory, 1 where the soft drive must act), memory in the order of `MEMORY`."""
        share, far = self.share, 1e30
        mean, loaded, held, stood, below, above, left, times = ca.vertsplit(memory)
        span = self.highest - self.lowest
        edge = 0.01 * span if np.isfinite(span) else 0.0
        mean, loaded = mean + share * (speed - mean), loaded + share * (load - loaded)
        below += share * ((command <= max(self.lowest, -far) + edge) - below)
        above += share * ((command >= min(self.highest, far) - edge) - above)
        counted = left > 0.0
        left = ca.if_else(counted, left - self.period, left)
        kept = ca.logic_and(counted, left > 1e-9 * self.period)
        over = ca.logic_and(counted, ca.logic_not(kept))
        held, stood, below, above, left = (ca.if_else(over, 0.0, value) for value in (held, stood, below, above, left))
        standing = mean < STANDING * reference
        gained = loaded > (1.0 + GAINED) * held
        judged_held = ca.if_else(standing, ca.if_else(gained, loaded, held), 0.0)
        judged_stood = ca.if_else(standing, ca.if_else(gained, 0.0, stood + self.period), 0.0)
        found = ca.logic_or(judged_stood > self.patience, ca.fmin(below, above) > SWINGING)
        begins = ca.logic_and(ca.logic_not(kept), found)
        time = self.patience * ca.fmin(HOLD * 2.0**times, LONGEST)
        following = ca.vertcat(
            mean, loaded, ca.if_else(kept, held, judged_held), ca.if_else(kept, stood, judged_stood), below, above,
            ca.if_else(begins, time, left), ca.if_else(begins, times + 1.0, times),
        )  # fmt: skip
        return following, ca.logic_or(kept, begins)


MEMORY: tuple[tuple[str, str], ...] = (
    ("mean top speed", "rad/s"),
    ("mean string torque", "N m"),
    ("string torque held", "N m"),
    ("time stood", "s"),
    ("share of the time at the lowest torque", "1"),
    ("share of the time at the highest torque", "1"),
    ("time left to the soft drive", "s"),
    ("times the soft drive took over", "1"),
)
"""What a watchdog remembers, in the order of its exported memory, with units."""
