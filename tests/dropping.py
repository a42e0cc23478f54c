"""A friction law that may fall below zero, where it drives the machine."""

from __future__ import annotations

from dataclasses import dataclass

from toolbox import FrictionLaw, quantity


@dataclass(frozen=True)
class Dropping(FrictionLaw):
    """A law that falls, by half at 1 m/s, to a number that may be below zero."""

    static: float = quantity(0.4, "1")
    beyond: float = quantity(0.1, "1")

    def sliding(self, speed):
        return self.static + (self.beyond - self.static) * speed / (1.0 + speed)

    def breakaway(self):
        return self.static
