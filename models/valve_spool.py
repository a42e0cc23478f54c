"""A valve spool on a spring, with dry friction at its seals, between two rigid stops.

    m v' = P - k x - d v + F_seal - N_upper + N_lower          -stroke <= x <= stroke

At a stop the seal holds what the stop holds already: the motion says what both carry together, and the stop takes it. Source: textbook; the seal may have a law
for each direction, `TwoWay`, as lip seals have.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.friction import Coulomb
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, UnilateralContact, quantity, state


@dataclass(frozen=True)
class ValveSpool(Component):
    """Valve spool that a force moves between two rigid stops, against a spring and the dry friction of its seals.

        m v' = P - k x - d v + F_seal - N_upper + N_lower,   -stroke <= x <= stroke

    Symbols and their fields: m `mass` [kg], k `stiffness` [N/m], d `damping` [N s/m], `stroke` [m], F_seal
    friction law `friction`, whose coefficients are forces [N]. x and v are position [m] and speed [m/s] of the spool. x is 0
    in the middle, where the spring has no force, and `stroke` is the distance from the middle to each stop. N_upper >= 0
    and N_lower >= 0 are the contact forces of the stops at x = `stroke` and x = -`stroke`, with the field `restitution`.

    - Needs the signal `spool.force` P [N] (default 0), positive in the direction of x.
    - States: `spool.position` x [m] and `spool.speed` v [m/s].
    - Contacts: `seal`, `upper` and `lower`.

    The default values are examples without a source.

    Examples
    --------
    >>> from models import ValveSpool
    >>> from toolbox import compose
    >>> print(compose(ValveSpool()))
    HybridSystem(ValveSpool): 2 states (spool.position, spool.speed); contacts: seal, upper, lower; inputs: spool.force [N]
    """

    mass: Quantity = quantity(0.2, "kg", "mass of the spool", above=0)
    stiffness: Quantity = quantity(30.0, "N/m", "stiffness of the spring", at_least=0)
    damping: Quantity = quantity(0.0, "N s/m", "viscous drag", at_least=0)
    stroke: Quantity = quantity(0.1, "m", "distance from the middle to each stop", above=0)
    restitution: Quantity = quantity(0.3, "1", "restitution of the stops", at_least=0, at_most=1)
    friction: FrictionLaw = Coulomb(2.0, 1.2)

    def equations(self, signal):
        force = signal("spool.force", "N", default=0.0)
        place, speed = state("spool.position", "m"), state("spool.speed", "m/s")
        seal = DryFriction("seal", speed, self.friction)
        upper = UnilateralContact("upper", place - self.stroke, speed, restitution=self.restitution)
        lower = UnilateralContact("lower", -place - self.stroke, -speed, restitution=self.restitution)
        pull = force - self.stiffness * place - self.damping * speed + seal.force - upper.force + lower.force
        return Equations(
            flow={place: speed, speed: pull / self.mass},
            elements=[seal, upper, lower],
            stored=(self.mass * speed**2 + self.stiffness * place**2) / 2,
            losses={"seal": -seal.force * speed, "drag": self.damping * speed**2},
            supplies={"force": force * speed},
        )
