"""Rock under a rotating bit whose torque is higher while the bit speeds up than while it slows down.

    rate form:      T = T0(w) [1 + beta0 tanh(beta1 w' sgn w)],   J w' = M - T
    switched form:  T = T0(w) (1 + beta0) while it speeds up, T0(w) (1 - beta0) while it slows down, and between at w' = 0

T depends on the acceleration w' that it causes. With M/J (`bit.free_acceleration`, that of the bit without the rock) and J (`bit.inertia`)
from the part that owns the bit, both forms are solved inside the expressions: no state, no lag, no element.

Switched: the bit holds its speed exactly while M lies between the branches, so that T = M there, and T is M cut off at the branches,
T = min(max(M, T0 (1 - beta0)), T0 (1 + beta0)). The three modes are the three pieces of this function, and every step ends on its kinks. A switch with
memory would be needed only if speeding up and slowing down were told apart by something else than the balance of torques.

Rate form, and why Newton with a fixed number of steps: with q = w' sgn w, z = beta1 q solves z + A tanh z = C, A = beta0 beta1 |T0| / J >= 0. The left
side is odd, increasing, and concave for z > 0. From C / (1 + A), which lies between 0 and the root because tanh z <= z, every step
stays between 0 and the root and comes nearer. STEPS of them reach round-off for all C where A <= 1e4 (a test measures it); rocks have A
below 1e3.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from models.friction import Exponential
from models.smooth_bit_rock import SmoothBitRock, smooth_torque
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, SceneError, quantity
from toolbox.modelling import OptionalQuantity

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


def resisting(load: ca.SX, base: ca.SX, width: ca.SX, steepness: ca.SX | None, inertia: ca.SX) -> ca.SX:
    """Torque between base - width and base + width that the load meets, by its own acceleration; steepness None is the switched form."""
    if steepness is None:
        lower, upper = base - width, base + width
        return (lower + upper + ca.fabs(load - lower) - ca.fabs(load - upper)) / 2  # the load, cut off at the branches
    rate = acceleration((load - base) / inertia, width / inertia, steepness)
    return base + width * ca.tanh(steepness * rate)


@dataclass(frozen=True)
class HystereticBitRock(Component):
    """Set-valued rock torque with hysteresis: the torque is higher while the bit accelerates than while it decelerates.

        rate form:      T = T0(w) [1 + beta0 tanh(beta1 w' sgn w)],   T0 = W R_b mu(|w|) sgn w,   J w' = M - T
        switched form:  T = T0(w) (1 + beta0) while the bit speeds up, T0(w) (1 - beta0) while it slows down,
                        any value between these two at w' = 0

    Symbols and their fields: R_b `radius` [m] of the bit, beta0 `hysteresis_fraction` [1], beta1 `hysteresis_steepness`
    [s2/rad], mu friction law `friction`. mu_s is the static coefficient of this law. The rate form is used if beta1 is
    given, otherwise the switched form. M is the torque of the string on the bit and J the inertia of the bit.

    - Needs the signals `bit.speed` w [rad/s], `bit.free_acceleration` M/J [rad/s2], `bit.inertia` J [kg m2] and
      `bit.weight` W [N] (default: the field `weight`).
    - Gives the signal `bit.torque` T [N m].
    - Contact: `bit`. The bit sticks while the torque M of the string is below the break-away torque. The break-away
      torque is W R_b mu_s in the rate form, because its two branches meet at w' = 0. In the switched form it is (1 +
      beta0) W R_b mu_s, the torque of the branch on which the bit speeds up.

    The law mu of Navarro-Lopez and Cortes (2007) is the basis of both forms. Unlike the smooth law of
    `SmoothHystereticBitRock`, this law sticks. The rate form follows the hysteretic law of F. F. Real et al. (2018).

    This model is a reconstruction of the hysteretic dry friction of Hong and Dhupia, whose equations were not
    available. The values of beta0 and beta1 are assumptions. Range of validity: beta0 <= 1. With beta0 > 1 the lower
    branch would drive the bit.

    Examples
    --------
    >>> from models import HystereticBitRock, wells
    >>> from toolbox import compose
    >>> print(compose(wells.JANSEN_2, HystereticBitRock()))
    HybridSystem(TorsionalChain, HystereticBitRock): 3 states (chain.twist, chain.speed); contacts: bit; inputs: top.torque [N m], bit.weight [N]
    """

    weight: Quantity = quantity(
        97_347.0, "N", "weight on bit", at_least=0, typical_range=(500.0, 5e6), source="Navarro-Lopez and Cortes (2007)"
    )
    radius: Quantity = quantity(
        0.155575, "m", "radius of the bit", above=0, typical_range=(0.01, 1.0), source="Navarro-Lopez and Cortes (2007)"
    )
    hysteresis_fraction: Quantity = quantity(
        0.2, "1", "half of the distance of the branches as a fraction of the torque (assumed)", at_least=0, at_most=1
    )
    hysteresis_steepness: OptionalQuantity = quantity(
        None, "s2/rad", "steepness of the change between the branches; None for the switched form", at_least=0
    )
    friction: FrictionLaw = Exponential(static=0.8, kinetic=0.5, decay=0.9)

    def check(self):
        if self.friction.memory(1):
            raise SceneError(
                "Argument `friction` must be a law without memory, whose place the branches take: `BitRock` takes one with it."
            )

    def equations(self, signal):
        speed, inertia = signal("bit.speed", "rad/s"), signal("bit.inertia", "kg m2")
        load = inertia * signal("bit.free_acceleration", "rad/s2")
        weight = signal("bit.weight", "N", default=self.weight)
        bit = DryFriction("bit", speed, self.friction, weight * self.radius, slip_unit="rad/s", force_unit="N m")
        base = bit.kinetic
        width = self.hysteresis_fraction * base
        if self.hysteresis_steepness is None:
            bit.static *= 1 + self.hysteresis_fraction
            # one piece for each direction, so that no argument of a kink jumps when the mode does
            forward, backward = (resisting(sign * load, base, width, None, inertia) for sign in (1, -1))
            torque = bit.mode * ((bit.mode + 1) * forward + (bit.mode - 1) * backward) / 2
        else:
            torque = resisting(bit.mode * load, base, width, self.hysteresis_steepness, inertia)
        bit.load, bit.sliding = ca.SX(1), torque
        return Equations(outputs={"bit.torque": (-bit.force, "N m")}, elements=[bit])


@dataclass(frozen=True)
class SmoothHystereticBitRock(SmoothBitRock):
    """Smooth rock torque with hysteresis in the acceleration: the torque of `SmoothBitRock` on the branches T0 +- beta0 |T0|.

        rate form:      T = T0(w) [1 + beta0 tanh(beta1 w' sgn w)],   J w' = M - T
        switched form:  T = T0(w) (1 + beta0) while the bit speeds up, T0(w) (1 - beta0) while it slows down,
                        any value between these two at w' = 0

    T0 = W b0 [tanh(b1 w) + b2 w / (1 + b3 w^2)] is the torque of `SmoothBitRock`, with the weight on bit W and the
    speed w of the bit. M is the torque of the string on the bit and J the inertia of the bit. beta0 and beta1 are the
    fields `hysteresis_fraction` [1] and `hysteresis_steepness` [s2/rad]. The rate form is used if beta1 is given,
    otherwise the switched form. There is no contact, so the bit never sticks.

    - Needs the signals `bit.speed` w [rad/s], `bit.free_acceleration` M/J [rad/s2], `bit.inertia` J [kg m2] and
      `bit.weight` W [N] (default: the field `weight`).
    - Gives the signal `bit.torque` T [N m].

    The values of beta0 and beta1 are assumptions. Range of validity: |w| up to about 30 rad/s, and beta0 <= 1.

    Source: F. F. Real et al. (2018) (law and b0 .. b3).

    Examples
    --------
    >>> from models import SmoothHystereticBitRock, wells
    >>> from toolbox import compose
    >>> print(compose(wells.JANSEN_2, SmoothHystereticBitRock()))
    HybridSystem(TorsionalChain, SmoothHystereticBitRock): 3 states (chain.twist, chain.speed); contacts: none; inputs: top.torque [N m], bit.weight [N]
    """

    hysteresis_fraction: Quantity = quantity(
        0.2, "1", "half of the distance of the branches as a fraction of the torque (assumed)", at_least=0, at_most=1
    )
    hysteresis_steepness: OptionalQuantity = quantity(
        None, "s2/rad", "steepness of the change between the branches; None for the switched form", at_least=0
    )

    def equations(self, signal):
        speed, inertia = signal("bit.speed", "rad/s"), signal("bit.inertia", "kg m2")
        load = inertia * signal("bit.free_acceleration", "rad/s2")
        weight = signal("bit.weight", "N", default=self.weight)
        torque = smooth_torque(self, weight, speed)
        width = self.hysteresis_fraction * ca.fabs(torque)
        return Equations(outputs={"bit.torque": (resisting(load, torque, width, self.hysteresis_steepness, inertia), "N m")})
