"""Rock as a spring and damper under the bit, which may lift off: bit bounce."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from toolbox import Component, Equations, Quantity, UnilateralContact, quantity, state
from toolbox.authoring import whole
from toolbox.modelling import OptionalQuantity


@dataclass(frozen=True)
class ElasticRock(Component):
    """Elastic rock that carries the bit while they touch: W = max(0, k d + c d') on bottom, 0 off bottom, d = z + a cos(j phi).

    Symbols and their fields: k `stiffness` [N/m], c `damping` [N s/m], a `lobe_height` [m], j `lobes`.

    W is the weight on bit, d the depth by which the bit presses into the rock, z the depth of the bit below the mean
    surface of the rock, and phi the angle of the bit. The mean surface is at rest, so the hook speed is relative to the
    mean rate of penetration. Roller-cone bits leave a surface with j lobes of height a. The lobes lift the bit once per
    lobe.

    - Needs the signals `bit.axial_speed` [m/s], positive downwards, and, with lobes, `bit.speed` [rad/s].
    - Gives the signals `bit.weight` W [N], the state `bit.position` z [m] and, with lobes, the state `bit.angle` phi
      [rad].
    - Contact: `bit.bottom`, with the modes "open" and "closed".

    The torque that lifts the bit over the lobes is neglected, as is usual. In the energy audit the power of this torque
    is the supply `lobes`.

    Source: textbook.

    The default stiffness and damping are examples without a source: they have the size of stiff rock under a bit.

    Examples
    --------
    >>> from models import AxialChain, ElasticRock
    >>> from toolbox import compose
    >>> print(compose(AxialChain(), ElasticRock()))
    HybridSystem(AxialChain, ElasticRock): 3 states (axial.stretch, axial.speed, bit.position); contacts:
      bit.bottom; inputs: hook.speed [m/s]
    """

    stiffness: Quantity = quantity(1e8, "N/m", "stiffness k of the rock under the bit", above=0)
    damping: Quantity = quantity(1e5, "N s/m", "damping c parallel to the stiffness", at_least=0)
    lobe_height: OptionalQuantity = quantity(
        None, "m", "height a of the lobes above and below the mean surface", at_least=0, typical_range=(1e-6, 0.1)
    )
    lobes: int = 3

    def check(self):
        whole("bit.lobes", self.lobes, 1)

    def equations(self, signal):
        position, axial_speed = state("bit.position", "m"), signal("bit.axial_speed", "m/s")
        flow, lift, lift_rate = {position: axial_speed}, ca.SX(0), ca.SX(0)
        if self.lobe_height is not None:
            angle, speed = state("bit.angle", "rad"), signal("bit.speed", "rad/s")
            flow[angle] = speed
            lift = self.lobe_height * ca.cos(self.lobes * angle)
            lift_rate = -self.lobe_height * self.lobes * speed * ca.sin(self.lobes * angle)
        bottom = UnilateralContact("bit.bottom", position + lift, axial_speed + lift_rate, stiffness=self.stiffness, damping=self.damping)
        return Equations(
            flow=flow,
            outputs={"bit.weight": (bottom.force, "N")},
            elements=[bottom],
            stored=bottom.stored,
            losses={"rock": bottom.loss},
            supplies={"bit": bottom.force * axial_speed, "lobes": bottom.force * lift_rate},
        )
