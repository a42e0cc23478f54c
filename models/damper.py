"""A friction damper: a dry slider on a spring, which takes most energy from a vibration at a load in between."""

from __future__ import annotations

from dataclasses import dataclass

from models.friction import Coulomb
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, quantity, state


@dataclass(frozen=True)
class FrictionDamper(Component):
    """Friction damper on a block: a slider of small mass on the ground, joined to the block by a spring and a damper (Jenkins element).

        m_d w' = k_d (x - y) + c_d (v - w) + F,   F dry friction with slip speed w

    Symbols and their fields: m_d `slider_mass` [kg], k_d `stiffness` [N/m], c_d `damping` [N s/m].

    x and v are position and speed of the block, y and w of the slider. The slider sticks, and the damper acts as a
    spring, while |k_d (x - y)| is below the static friction force F_c. If the force exceeds F_c, the slider slides.

    A massless slider dissipates the energy W = 4 F_c (X - F_c / k_d) per cycle of a slow oscillation of the block with
    amplitude X > F_c / k_d. The maximum of W is k_d X^2, for F_c = k_d X / 2. The damper dissipates nothing if it has
    no normal load or if it never slides.

    - Needs the signals `block.speed` v [m/s] and `damper.load` [N] (default: the field `load`).
    - Gives the signals `block.attachment` [N], `damper.stretch` x - y [m], `damper.speed` w [m/s].
    - Contact: `damper`.

    Why the slider has a mass: its speed is then a state that sticks exactly. c_d damps the vibration of the slider on
    its spring. The default c_d is the critical damping for the default mass.

    Range of validity: sqrt(k_d / m_d) far above the frequency of the vibration. The default values are examples without
    a source.

    Source: textbook.

    Examples
    --------
    >>> from models import Block, FrictionDamper
    >>> from toolbox import compose
    >>> print(compose(Block(), FrictionDamper()))
    HybridSystem(Block, FrictionDamper): 4 states (block.position, block.speed, damper.stretch, damper.speed); contacts: damper; inputs:
      block.force [N], damper.load [N]
    """

    stiffness: Quantity = quantity(1.0, "N/m", "stiffness k_d between block and slider", above=0)
    damping: Quantity = quantity(0.02, "N s/m", "viscous damping c_d parallel to the spring", at_least=0)
    slider_mass: Quantity = quantity(1e-4, "kg", "mass m_d of the slider", above=0)
    load: Quantity = quantity(1.0, "N", "normal load of the slider; 1 if the friction law is a force", at_least=0)
    friction: FrictionLaw = Coulomb(static=0.5, kinetic=0.5)

    def equations(self, signal):
        stretch, w = state("damper.stretch", "m"), state("damper.speed", "m/s")
        v = signal("block.speed", "m/s")
        damper = DryFriction("damper", w, self.friction, signal("damper.load", "N", default=self.load))
        pull = self.stiffness * stretch + self.damping * (v - w)
        return Equations(
            flow={stretch: v - w, w: (pull + damper.force) / self.slider_mass},
            outputs={"block.attachment": (-pull, "N")},
            elements=[damper],
            stored=self.slider_mass * w**2 / 2 + self.stiffness * stretch**2 / 2,
            losses={"friction": -damper.force * w, "spring damping": self.damping * (v - w) ** 2},
            supplies={"block": pull * v},
        )
