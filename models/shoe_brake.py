"""A drum with two brake shoes, one of which digs in forwards and the other backwards, and a bearing.

    J w' = T + R (F_leading + F_trailing) + M_bearing          |F| <= mu (press) gain,  gain 1 / (1 - mu c) leading, 1 / (1 + mu c) trailing

A leading shoe is drawn in by its own friction, a trailing one is pushed off: with the lever ratio c its force is that of the actuator times the gain, and the
two change places with the direction. All three rub at one speed and are one friction at rest, each with its own bound. Self-locking, mu c >= 1, is refused.
Source: textbook (R. Limpert, Brake Design and Safety, SAE, shoe factors).
"""

from __future__ import annotations

from dataclasses import dataclass

from models.friction import Coulomb, TwoWay
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, SceneError, quantity, state


@dataclass(frozen=True)
class ShoeBrake(Component):
    """Drum brake with a leading and a trailing shoe, and a bearing.

        J w' = T + R (F_leading + F_trailing) + M_bearing,   |F| <= mu press gain
        gain = 1 / (1 - mu c) for the leading shoe, 1 / (1 + mu c) for the trailing shoe

    Symbols and their fields: J `inertia` [kg m2], R `radius` [m], c `lever` [1], mu `static` at rest and `kinetic` in
    slip [1], M_bearing friction law `bearing`. w is the speed of the drum [rad/s] and press the signal `drum.press`
    [N].

    F_leading and F_trailing are the friction forces of the shoes on the drum [N], against its rotation. Friction presses
    the leading shoe more strongly on the drum and the trailing shoe less strongly. c is the lever ratio. The names hold
    for w > 0. If the drum turns backwards (w < 0), the shoes change their roles. A self-locking brake, mu c >= 1, raises
    an error.

    - Needs the signals `drum.torque` T [N m] (default 0) and `drum.press` [N] (default 0, must stay >= 0), the force of
      the actuator on each shoe.
    - States: `drum.angle` [rad] and `drum.speed` w [rad/s].
    - Contacts: `leading`, `trailing` and `bearing`.

    The default values are examples without a source. Source of the equations: textbook (R. Limpert, Brake Design and
    Safety, SAE, shoe factors).

    Examples
    --------
    >>> from models import ShoeBrake
    >>> from toolbox import compose
    >>> print(compose(ShoeBrake()))
    HybridSystem(ShoeBrake): 2 states (drum.angle, drum.speed); contacts: leading, trailing, bearing; inputs: drum.torque [N m], drum.press [N]
    """

    inertia: Quantity = quantity(0.8, "kg m2", "inertia of the drum", above=0)
    radius: Quantity = quantity(0.15, "m", "radius of the drum", above=0)
    static: Quantity = quantity(0.4, "1", "static coefficient of the lining", at_least=0)
    kinetic: Quantity = quantity(0.3, "1", "kinetic coefficient of the lining", at_least=0)
    lever: Quantity = quantity(0.8, "1", "lever ratio c with which friction presses a shoe on the drum", at_least=0)
    bearing: FrictionLaw = Coulomb(0.5, 0.3)

    def check(self):
        if self.static * self.lever >= 1:
            raise SceneError(
                f"Argument `lever` must be < {1 / self.static:g}, beyond which the shoe locks by itself, but it is {self.lever!r}."
            )
        if self.kinetic > self.static:
            raise SceneError(f"Argument `kinetic` must be <= the static coefficient {self.static:g}, but it is {self.kinetic!r}.")

    def _law(self, sign):
        """Coulomb friction of a lining whose shoe is drawn in (+1) or pushed off (-1) by it."""
        return Coulomb(self.static / (1 - sign * self.static * self.lever), self.kinetic / (1 - sign * self.kinetic * self.lever))

    def equations(self, signal):
        torque, press = signal("drum.torque", "N m", default=0.0), signal("drum.press", "N", default=0.0)
        angle, speed = state("drum.angle", "rad"), state("drum.speed", "rad/s")
        rubbing = self.radius * speed
        leading = DryFriction("leading", rubbing, TwoWay(self._law(1), self._law(-1)), press)
        trailing = DryFriction("trailing", rubbing, TwoWay(self._law(-1), self._law(1)), press)
        bearing = DryFriction("bearing", speed, self.bearing, slip_unit="rad/s", force_unit="N m")
        pull = torque + self.radius * (leading.force + trailing.force) + bearing.force
        return Equations(
            flow={angle: speed, speed: pull / self.inertia},
            elements=[leading, trailing, bearing],
            stored=self.inertia * speed**2 / 2,
            losses={"shoes": -(leading.force + trailing.force) * rubbing, "bearing": -bearing.force * speed},
            supplies={"torque": torque * speed},
        )
