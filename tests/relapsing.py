"""A law for tests of judges: it lifts its set-point at one slow sample, comes down, and relapses for ever where smooth running is not stable."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from controllers import PI
from toolbox import Controller, Update, state


@dataclass(frozen=True)
class Relapsing(Controller):
    """PI whose set-point rises at 1 rad/s2 to 12 rad/s while the top is 10 % slower, and for 15 s after, and else falls at 0.2 rad/s2."""

    law: PI = PI()
    actuated_signals = ("top.torque",)

    def sampled(self, signal, period):
        extra, left = state("relapsing.speed", "rad/s"), state("relapsing.time", "s")
        asked = signal("top.reference", "rad/s", default=self.law.reference)

        def higher(name, unit, default=None):
            return asked + extra if name == "top.reference" else signal(name, unit, default)

        update = self.law.sampled(higher, period)
        swings = (signal("top.speed", "rad/s") < 0.9 * (asked + extra)) * (signal("top.torque", "N m") != 0.0)
        waits = ca.if_else(swings, 15.0, ca.fmax(left - period, 0.0))
        moved = ca.if_else(waits > 0.0, ca.fmin(extra + period, ca.fmax(12.0 - asked, 0.0)), ca.fmax(extra - 0.2 * period, 0.0))
        return Update({**update.memory, extra: moved, left: waits}, update.outputs)
