"""A law that lifts its own set-point while the string swings and lowers it again, as drillers do by hand."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import casadi as ca

from controllers.bumpless import acting
from toolbox import Controller, HybridSystem, Quantity, SceneError, Update, quantity, state


@dataclass(frozen=True)
class Lifting(Controller):
    """A law that gives another law a higher set-point while the top swings, and comes down slowly once it does not.

        the top swings where w_top < (1 - swing) lifted;   left = hold there, else counts down to 0
        lifted - reference rises at `rise` towards to - reference while left > 0, else falls at `fall` to 0

    Why: a stick-slip that lives beside smooth running at one set-point does not at a higher one, where the rock is flatter. A law that holds smooth running
    down to 4 rad/s may need 7 rad/s to break a cycle, most of all on a drive that is heavier than it knows; lifted, it needs no more than it holds. The price
    is speed: for the time of the lift the bit turns faster than asked. The top of a stiff drive does not swing: the law inside must give way to the string.
    While the bit sticks, the top of a string that is stiffer than the law knows swings by an eighth to a fifth of its speed: `swing` must lie below that. Above
    the set-point nothing counts as a swing, since the top of a law with a slow integral stays above one that falls.

    `law` gets the set-point `top.reference`. `reference` is the default of that signal, and the set-point that the inner law is designed for. From rest, too,
    the top is off its set-point, and the start is lifted. Sampled only. Source: the practice of lifting the rotary speed against stick-slip; the rule is a
    choice of this file. Around a law that is designed as a callable, such as a predictive one, the whole is a callable; `run.laws[0].inside` holds that law.
    """

    law: Controller = field(default_factory=Controller)
    reference: Quantity = quantity(8.0, "rad/s", "set-point of the speed", above=0, usual=(0.05, 40.0))
    to: Quantity = quantity(12.0, "rad/s", "set-point that is lifted to", above=0, usual=(0.05, 40.0))
    swing: Quantity = quantity(
        0.1, "1", "how far below the lifted set-point the top speed counts as swinging, in parts of it", above=0, at_most=1
    )
    hold: Quantity = quantity(15.0, "s", "time after the last swing for which the set-point stays up", above=0)
    rise: Quantity = quantity(1.0, "rad/s2", "rate at which the set-point is lifted", above=0)
    fall: Quantity = quantity(0.2, "rad/s2", "rate at which it is lowered", above=0)

    def check(self):
        if not isinstance(self.law, Controller):
            raise SceneError(f"Argument `law` must be a Controller, but it is {self.law!r}.")

    @property
    def drives(self) -> tuple[str, ...]:  # type: ignore[override]
        """What the inner law drives."""
        return self.law.drives

    def design(self, plant: HybridSystem) -> Controller:
        """The law with its inner law designed on the plant."""
        return dataclasses.replace(self, law=self.law.design(plant))

    def sampled(self, signal, period):
        extra, left = state("lifting.speed", "rad/s"), state("lifting.time", "s")
        asked = signal("top.reference", "rad/s", default=self.reference)
        lifted = asked + extra

        def higher(name, unit, default=None):
            return lifted if name == "top.reference" else signal(name, unit, default)

        update = self.law.sampled(higher, period)
        swings = (signal("top.speed", "rad/s") < (1.0 - self.swing) * lifted) * (acting(signal) != 0.0)
        waits = ca.if_else(swings, self.hold, ca.fmax(left - period, 0.0))
        highest = ca.fmax(self.to - asked, 0.0)
        moved = ca.if_else(waits > 0.0, ca.fmin(extra + self.rise * period, highest), ca.fmax(extra - self.fall * period, 0.0))
        return Update({**update.memory, extra: moved, left: waits}, {**update.outputs, "lifting.reference": (lifted, "rad/s")})
