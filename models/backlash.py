"""Two bodies with backlash between them, and dry friction on both sides.

    m1 v1' = P + F1 - N+ + N-,   m2 v2' = F2 + N+ - N-          |x1 - x2| <= play

While a side of the play is closed and both bodies stand, the frictions hold together what the motion asks for. Source: textbook (play in a drive).
"""

from __future__ import annotations

from dataclasses import dataclass

from models.friction import Coulomb
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, UnilateralContact, quantity, state


@dataclass(frozen=True)
class BacklashDrive(Component):
    """Two bodies with backlash between them, impacts at both sides of the gap, and dry friction.

        m1 v1' = P + F1 - N+ + N-,   m2 v2' = F2 + N+ - N-,   |x1 - x2| <= play

    Symbols and their fields: m1 `driving_mass` and m2 `driven_mass` [kg], `play` [m], F1 and F2 friction laws
    `driving_friction` and `driven_friction`. x1, v1 and x2, v2 are position [m] and speed [m/s] of the first and the
    second body. `play` is the distance from the middle of the gap to each side, so the whole gap is 2 `play`.

    F1 and F2 are the frictions between bodies and ground. Their load is 1, so the coefficients of both friction laws are
    forces [N]. N+ >= 0 is the contact force at x1 - x2 = `play`, where the first body pushes the second body, and N- >= 0
    the contact force at x1 - x2 = -`play`, where it pulls. Both contacts are rigid, with the field `restitution` [1].

    - Needs the signal `driver.force` P [N] (default 0), the force on the first body.
    - States: `driver.position` x1 [m], `driver.speed` v1 [m/s], `driven.position` x2 [m], `driven.speed` v2 [m/s].
    - Contacts: `push` (N+) and `pull` (N-), `driving_guide` and `driven_guide`.

    The default values are examples without a source.

    Examples
    --------
    >>> from models import BacklashDrive
    >>> from toolbox import compose
    >>> plant = compose(BacklashDrive())
    >>> print(plant.x.numel(), "states,", len(plant.elements), "contacts")
    4 states, 4 contacts
    """

    driving_mass: Quantity = quantity(1.0, "kg", "mass of the driving body", above=0)
    driven_mass: Quantity = quantity(2.0, "kg", "mass of the driven body", above=0)
    play: Quantity = quantity(0.05, "m", "distance from the middle to each side of the play", above=0)
    restitution: Quantity = quantity(0.4, "1", "restitution", at_least=0, at_most=1)
    driving_friction: FrictionLaw = Coulomb(0.5, 0.4)
    driven_friction: FrictionLaw = Coulomb(0.8, 0.6)

    def equations(self, signal):
        force = signal("driver.force", "N", default=0.0)
        x, v = state("driver.position", "m"), state("driver.speed", "m/s")
        y, u = state("driven.position", "m"), state("driven.speed", "m/s")
        near, far = DryFriction("driving_guide", v, self.driving_friction), DryFriction("driven_guide", u, self.driven_friction)
        push = UnilateralContact("push", x - y - self.play, v - u, restitution=self.restitution)
        pull = UnilateralContact("pull", y - x - self.play, u - v, restitution=self.restitution)
        given = push.force - pull.force
        return Equations(
            flow={x: v, v: (force + near.force - given) / self.driving_mass, y: u, u: (far.force + given) / self.driven_mass},
            elements=[near, far, push, pull],
            stored=(self.driving_mass * v**2 + self.driven_mass * u**2) / 2,
            losses={"driving_guide": -near.force * v, "driven_guide": -far.force * u},
            supplies={"force": force * v},
        )
