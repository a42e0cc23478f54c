"""Rock under a rotating bit whose torque is higher while the bit speeds up than while it slows down.

    T = T0(w) [1 + beta0 tanh(beta1 w' sgn w)],   J w' = M - T

T depends on the acceleration w' that it causes. With M (`bit.load`, all that turns the bit but the rock) and J (`bit.inertia`) from the part
that owns the bit, q = w' sgn w is the root of a monotone equation, solved inside the expressions: no state, no lag, no event of its own.

Why Newton with a fixed number of steps: z = beta1 q solves z + A tanh z = C with A = beta0 beta1 |T0| / J >= 0. The left side is odd,
increasing, and concave for z > 0. From C / (1 + A), which lies between 0 and the root because tanh z <= z, every step stays between 0
and the root and comes nearer. STEPS of them reach round-off for all C where A <= 1e4 (a test measures it); rocks have A below 1e3.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from models.friction import Exponential
from models.smooth_bit_rock import smooth_torque
from toolbox import Component, DryFriction, Equations, FrictionLaw, quantity

STEPS = 12
"""Newton steps for the acceleration."""


def acceleration(free: ca.SX, swing: ca.SX, steepness: ca.SX) -> ca.SX:
    """Root q of q + swing tanh(steepness q) = free, all in rad/s2 but the steepness [s2/rad]; swing and steepness >= 0."""
    slope = swing * steepness
    q = free / (1 + slope)
    for _ in range(STEPS):
        level = ca.tanh(steepness * q)
        q = q - (q + swing * level - free) / (1 + slope * (1 - level**2))
    return q


@dataclass(frozen=True)
class HystereticBitRock(Component):
    """Set-valued rock torque with hysteresis in the acceleration: T = W R_b mu(|w|) [1 + beta0 tanh(beta1 w' sgn w)] sgn w.

    Signals: needs `bit.speed` w [rad/s], `bit.load` M [N m], `bit.inertia` J [kg m2] and `bit.weight` W [N] (the field `weight`); gives
    `bit.torque` [N m]. Contact: `bit`, which sticks up to W R_b mu_s: at w' = 0 both branches meet, so break-off is that of `BitRock`. A
    rate form of the hysteretic bit-rock law of F. F. Real et al. (2018), on the law of Navarro-Lopez and Cortes (2007), which unlike the
    smooth law sticks; it stands in for the hysteretic dry friction of Hong and Dhupia, a reconstruction. beta0 and beta1 are assumed.
    Range: beta0 < 1, else the lower branch would drive the bit.
    """

    weight: float = quantity(97_347.0, "N", "weight on bit", at_least=0)
    radius: float = quantity(0.155575, "m", "radius of the bit", above=0)
    beta0: float = quantity(0.2, "1", "half distance of the branches in parts of the torque (assumed)", at_least=0, at_most=1)
    beta1: float = quantity(0.5, "s2/rad", "steepness of the change between the branches (assumed)", at_least=0)
    friction: FrictionLaw = Exponential(static=0.8, kinetic=0.5, decay=0.9)

    def equations(self, signal):
        speed, load, inertia = signal("bit.speed", "rad/s"), signal("bit.load", "N m"), signal("bit.inertia", "kg m2")
        weight = signal("bit.weight", "N", default=self.weight)
        bit = DryFriction("bit", speed, self.friction, weight * self.radius, slip_unit="rad/s", force_unit="N m")
        base = bit.kinetic / inertia
        q = acceleration(bit.mode * load / inertia - base, self.beta0 * base, self.beta1)
        bit.sliding *= 1 + self.beta0 * ca.tanh(self.beta1 * q)
        return Equations(gives={"bit.torque": (-bit.force, "N m")}, elements=[bit])


@dataclass(frozen=True)
class SmoothHystereticBitRock(Component):
    """Smooth rock torque with hysteresis in the acceleration: T = T0(w) + beta0 |T0(w)| tanh(beta1 w'), T0 that of `SmoothBitRock`.

    Signals as `HystereticBitRock`; no contact, and no stick. Source: F. F. Real et al. (2018) for law and b0 .. b3; beta0 and beta1 are
    assumed. Range: as `SmoothBitRock`, beta0 < 1.
    """

    weight: float = quantity(97_347.0, "N", "weight on bit", at_least=0)
    b0: float = quantity(0.0239, "m", "torque per weight at high speed", at_least=0)
    b1: float = quantity(1.910, "s/rad", "steepness at zero speed", at_least=0)
    b2: float = quantity(8.500, "s/rad", "height of the peak", at_least=0)
    b3: float = quantity(5.470, "s2/rad2", "narrowness of the peak", at_least=0)
    beta0: float = quantity(0.2, "1", "half distance of the branches in parts of the torque (assumed)", at_least=0, at_most=1)
    beta1: float = quantity(0.5, "s2/rad", "steepness of the change between the branches (assumed)", at_least=0)

    def equations(self, signal):
        speed, load, inertia = signal("bit.speed", "rad/s"), signal("bit.load", "N m"), signal("bit.inertia", "kg m2")
        weight = signal("bit.weight", "N", default=self.weight)
        torque = smooth_torque(self, weight, speed)
        height = self.beta0 * ca.fabs(torque)
        rate = acceleration((load - torque) / inertia, height / inertia, self.beta1)
        return Equations(gives={"bit.torque": (torque + height * ca.tanh(self.beta1 * rate), "N m")})
