"""A band around a drum: friction that winds itself up in one direction and unwinds itself in the other.

    J w' = T + R F_band          |F| <= gain x pull,   gain = exp(mu angle) - 1 along the pull, 1 - exp(-mu angle) against it

The actuator pulls at one end of the band; the other end is anchored. Where the drum turns towards the actuator's end the band tightens itself (Euler-Eytelwein,
the capstan), where it turns back the band slackens. Source: textbook (R. Limpert, Brake Design and Safety, SAE; drawworks and winches have band brakes).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca

from models.friction import Exponential, TwoWay
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, SceneError, quantity, state


@dataclass(frozen=True)
class Wound(FrictionLaw):
    """Friction of a band as a fraction of the pull at its end: exp(mu angle) - 1 if the band tightens itself (sense 1), 1 - exp(-mu angle)
    if it slackens (sense -1).

    `lining` is the friction mu(v) of the lining. Source: textbook (Euler-Eytelwein).
    """

    lining: FrictionLaw = Exponential(static=0.35, kinetic=0.28, decay=2.0)
    wrap_angle: Quantity = quantity(1.5 * math.pi, "rad", "angle of wrap", above=0)
    sense: int = 1

    def _gain(self, mu):
        return self.sense * (ca.exp(self.sense * mu * self.wrap_angle) - 1)

    def sliding(self, speed, *beyond):
        return self._gain(self.lining.sliding(speed, *beyond))

    def break_speeds(self):
        return self.lining.break_speeds()

    def breakaway(self):
        return self._gain(self.lining.breakaway())

    def check(self):
        if self.lining.memory(1):
            raise SceneError(f"Argument `lining` must be a law without memory, but {type(self.lining).__name__} has one.")
        if self.sense not in (1, -1):
            raise SceneError(f"Argument `sense` must be 1 or -1, but it is {self.sense!r}.")


@dataclass(frozen=True)
class BandBrake(Component):
    """Drum with a band brake: the friction increases the tension of the band in one direction and reduces it in the other.

        J w' = T + R F_band
        w > 0:  F_band = -(exp(mu angle) - 1) pull
        w < 0:  F_band = (1 - exp(-mu angle)) pull
        w = 0:  -(exp(mu_s angle) - 1) pull <= F_band <= (1 - exp(-mu_s angle)) pull

    Symbols and their fields: J `inertia` [kg m2], R `radius` [m], angle `wrap_angle` [rad]. mu is the kinetic and mu_s the
    static coefficient of the friction law `friction` [1]. w is the speed of the drum [rad/s], pull the signal `drum.pull`
    [N], and F_band the friction force of the band on the drum [N].

    w is positive if the drum turns in the direction that tightens the band: its surface then moves along the band from
    the anchored end towards the end at which the actuator pulls.

    - Needs the signals `drum.torque` T [N m] (default 0) and `drum.pull` [N] (default 0, must stay >= 0), the force of
      the actuator at the end of the band.
    - Gives the signals `drum.angle` [rad], `drum.speed` [rad/s].
    - Contact: `band`, with the speed of the drum surface under the band as slip [m/s].

    Range of validity: a band without mass and elasticity, which therefore does not groan by itself. The default values
    are examples that represent the drum of a small winch. Source of the equations: textbook (R. Limpert, Brake Design
    and Safety, SAE).

    Examples
    --------
    >>> from models import BandBrake
    >>> from toolbox import compose, simulate
    >>> held = simulate(compose(BandBrake()), 1.0, inputs={"drum.pull": 1000.0, "drum.torque": 1000.0})
    >>> float(held.at(1.0)["drum.angle"])
    0.0
    """

    inertia: Quantity = quantity(40.0, "kg m2", "inertia of the drum", above=0)
    radius: Quantity = quantity(0.4, "m", "radius of the drum", above=0)
    wrap_angle: Quantity = quantity(1.5 * math.pi, "rad", "angle of wrap", above=0)
    friction: FrictionLaw = Exponential(static=0.35, kinetic=0.28, decay=2.0)

    def equations(self, signal):
        torque, pull = signal("drum.torque", "N m", default=0.0), signal("drum.pull", "N", default=0.0)
        angle, speed = state("drum.angle", "rad"), state("drum.speed", "rad/s")
        rubbing = self.radius * speed
        law = TwoWay(Wound(self.friction, self.wrap_angle, 1), Wound(self.friction, self.wrap_angle, -1))
        band = DryFriction("band", rubbing, law, pull)
        return Equations(
            flow={angle: speed, speed: (torque + self.radius * band.force) / self.inertia},
            elements=[band],
            stored=self.inertia * speed**2 / 2,
            losses={"band": -band.force * rubbing},
            supplies={"torque": torque * speed},
        )
