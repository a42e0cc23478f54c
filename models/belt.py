"""Block on a moving belt: the smallest machine with stick-slip."""

from __future__ import annotations

from dataclasses import dataclass

from models.friction import Hyperbolic
from toolbox import Component, DryFriction, Equations, FrictionLaw, quantity, state


@dataclass(frozen=True)
class BlockOnBelt(Component):
    """Block on a moving belt, held by a spring: m v' = u - k x + F, F dry friction against v - v_belt.

    Signals: needs `block.force` u [N] (0); gives `block.position` [m], `block.speed` [m/s]. Contact: `belt`. Defaults are the numbers of
    Leine et al., Nonlinear Dynamics 16 (1998) 41-54: stick-slip of amplitude about one, stick while |k x| <= F_s.
    """

    mass: float = quantity(1.0, "kg", "mass of the block", above=0)
    stiffness: float = quantity(1.0, "N/m", "stiffness of the spring", at_least=0)
    damping: float = quantity(0.0, "N s/m", "viscous damping to ground", at_least=0)
    belt_speed: float = quantity(0.2, "m/s", "speed of the belt")
    load: float = quantity(1.0, "N", "normal load; 1 where the law is a force", at_least=0)
    friction: FrictionLaw = Hyperbolic(static=1.0, decay=3.0)

    def equations(self, signal):
        x, v = state("block.position", "m"), state("block.speed", "m/s")
        force = signal("block.force", "N", default=0.0)
        belt = DryFriction("belt", v - self.belt_speed, self.friction, self.load)
        return Equations(
            flow={x: v, v: (force - self.stiffness * x - self.damping * v + belt.force) / self.mass},
            elements=[belt],
            stored=self.mass * v**2 / 2 + self.stiffness * x**2 / 2,
            losses={"friction": -belt.force * (v - self.belt_speed), "damping": self.damping * v**2},
            supplies={"belt drive": belt.force * self.belt_speed, "force": force * v},
        )
