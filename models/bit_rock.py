"""Rock under a rotating bit: set-valued torque that falls with speed."""

from __future__ import annotations

from dataclasses import dataclass

from models.friction import Exponential
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, quantity


@dataclass(frozen=True)
class BitRock(Component):
    """Rock under a rotating bit: set-valued Stribeck torque T = W R_b [mu_c + (mu_s - mu_c) exp(-gamma |w| / v_f)] sgn w.

    T is the torque of the rock on the bit, W the weight on bit, w the speed of the bit and R_b the radius of the bit,
    the field `radius` [m]. The static coefficient mu_s [1], the kinetic coefficient mu_c [1] and gamma / v_f [s/rad]
    are the numbers `static`, `kinetic` and `decay` of the default friction law `friction`.

    - Needs the signals `bit.speed` w [rad/s] and `bit.weight` W [N] (default: the field `weight`).
    - Gives the signal `bit.torque` T [N m].
    - Contact: `bit`.

    The viscous drag of the bit is a field of the chain (`TorsionalChain.bit_drag`).

    The defaults are mu_c = 0.5, mu_s = 0.8, gamma = 0.9 and v_f = 1 rad/s, so decay = gamma / v_f = 0.9 s/rad.

    Source: E. M. Navarro-Lopez, D. Cortes, J. Sound Vib. 307 (2007) 152-171, doi:10.1016/j.jsv.2007.06.037.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> print(compose(wells.JANSEN_2, BitRock(weight="97 kN", radius="6 1/8 in")))
    HybridSystem(TorsionalChain, BitRock): 3 states (chain.twist, chain.speed); contacts: bit; inputs: top.torque [N m], bit.weight [N]
    """

    weight: Quantity = quantity(
        97_347.0, "N", "weight on bit", at_least=0, typical_range=(500.0, 5e6), source="Navarro-Lopez and Cortes (2007)"
    )
    radius: Quantity = quantity(
        0.155575, "m", "radius of the bit", above=0, typical_range=(0.01, 1.0), source="Navarro-Lopez and Cortes (2007)"
    )
    friction: FrictionLaw = Exponential(static=0.8, kinetic=0.5, decay=0.9)

    def equations(self, signal):
        speed = signal("bit.speed", "rad/s")
        weight = signal("bit.weight", "N", default=self.weight)
        bit = DryFriction("bit", speed, self.friction, weight * self.radius, slip_unit="rad/s", force_unit="N m")
        # the power that enters the rock is what the chain books as its bit torque
        return Equations(outputs={"bit.torque": (-bit.force, "N m")}, elements=[bit])
