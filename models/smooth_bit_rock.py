"""Rock under a rotating bit: smooth torque with a peak, after Ritto and Real."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from toolbox import Component, Equations, Quantity, quantity


@dataclass(frozen=True)
class SmoothBitRock(Component):
    """Smooth torque of the rock on the bit, without sticking: T = W b0 [tanh(b1 w) + b2 w / (1 + b3 w^2)].

    - Needs the signals `bit.speed` w [rad/s] and `bit.weight` W [N] (default: the field `weight`).
    - Gives the signal `bit.torque` T [N m].

    T is the torque of the rock on the bit, W the weight on bit and w the speed of the bit. The numbers b0, b1, b2 and
    b3 are the fields `torque_per_weight` [m], `zero_speed_steepness` [s/rad], `peak_height` [s/rad] and
    `peak_narrowness` [s2/rad2].

    There is no contact: this bit creeps and never sticks. Use it for comparisons with published runs, not for questions
    about break-away. T rises to a peak near w = 1/sqrt(b3) and then falls to W b0.

    Range of validity: |w| up to about 30 rad/s, where the numbers were identified from field data.

    Source: F. F. Real et al. (2018), after T. G. Ritto (law and numbers).

    Examples
    --------
    >>> from models import SmoothBitRock, wells
    >>> from toolbox import compose
    >>> print(compose(wells.JANSEN_2, SmoothBitRock()))
    HybridSystem(TorsionalChain, SmoothBitRock): 3 states (chain.twist, chain.speed); contacts: none; inputs: top.torque [N m], bit.weight [N]
    """

    weight: Quantity = quantity(97_347.0, "N", "weight on bit", at_least=0, typical_range=(500.0, 5e6))
    torque_per_weight: Quantity = quantity(0.0239, "m", "torque per weight at high speed", at_least=0, source="Real et al. (2018)")
    zero_speed_steepness: Quantity = quantity(1.910, "s/rad", "steepness at zero speed", at_least=0, source="Real et al. (2018)")
    peak_height: Quantity = quantity(8.500, "s/rad", "height of the peak", at_least=0, source="Real et al. (2018)")
    peak_narrowness: Quantity = quantity(5.470, "s2/rad2", "narrowness of the peak", at_least=0, source="Real et al. (2018)")

    def equations(self, signal):
        speed = signal("bit.speed", "rad/s")
        weight = signal("bit.weight", "N", default=self.weight)
        return Equations(outputs={"bit.torque": (smooth_torque(self, weight, speed), "N m")})


def smooth_torque(law, weight: ca.SX, speed: ca.SX) -> ca.SX:
    """W b0 [tanh(b1 w) + b2 w / (1 + b3 w^2)] with the numbers b0 .. b3 of `law` [N m]."""
    return (
        weight
        * law.torque_per_weight
        * (ca.tanh(law.zero_speed_steepness * speed) + law.peak_height * speed / (1 + law.peak_narrowness * speed**2))
    )
