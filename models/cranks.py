"""Levers that vanish: a crank and slider, and a scotch yoke, whose guide rubs.

    (J + m p^2) w' + m p p' w^2 = T - d w + p F          x = x(a), p = dx/da, slip of the guide p w

At a dead centre p = 0: the guide stands still however fast the crank turns, its slip passes through zero, and no friction of it holds the crank. Elsewhere it
holds the crank while |T| <= p times its bound. The friction of the guide is the force F alone: a connecting rod that presses on it is left out.
Source: textbook kinematics, as in J. J. Uicker, G. R. Pennock, J. E. Shigley, Theory of Machines and Mechanisms, Oxford.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from models.friction import Coulomb
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, SceneError, quantity, state


def _turned(signal, inertia, mass, damping, friction, place, angle, speed):
    """The equations of a shaft that moves a body along a guide, whose place is an expression of the angle."""
    torque = signal("crank.torque", "N m", default=0.0)
    lever = ca.jacobian(place, angle)
    guide = DryFriction("guide", lever * speed, friction)
    whole = inertia + mass * lever**2
    pull = torque - damping * speed - mass * lever * ca.jacobian(lever, angle) * speed**2 + lever * guide.force
    return Equations(
        flow={angle: speed, speed: pull / whole},
        outputs={"slider.position": (place, "m"), "slider.speed": (lever * speed, "m/s")},
        elements=[guide],
        stored=whole * speed**2 / 2,
        losses={"guide": -guide.force * lever * speed, "drag": damping * speed**2},
        supplies={"torque": torque * speed},
    )


@dataclass(frozen=True)
class CrankSlider(Component):
    """Crank and connecting rod that move a slider, with dry friction at its guide: x = r cos a + sqrt(l^2 - (r sin a)^2).

        (J + m p^2) w' + m p p' w^2 = T - d w + p F,   p = dx/da

    Symbols and their fields: J `inertia` [kg m2], m `mass` [kg], r `crank` [m], l `rod` [m], d `damping` [N m s/rad].

    a is the angle of the crank [rad], w its speed [rad/s], x the distance of the slider from the axis of the crank [m] and
    F the friction at the guide on the slider [N], against its speed p w. At a = 0 the slider is at its largest distance r
    + l. The load of the guide is 1, so the coefficients of the friction law `friction` are forces [N].

    - Needs the signal `crank.torque` T [N m] (default 0).
    - Gives the signals `slider.position` x [m] and `slider.speed` p w [m/s].
    - States: `crank.angle` a [rad] and `crank.speed` w [rad/s]. Contact: `guide`.

    At a dead centre (a = 0 or pi) p = 0, so the friction of the guide does not hold the crank there.

    J is the inertia of the crank shaft with damping d, m the mass of the slider, r the length of the crank and l the
    length of the rod.

    Range of validity: a rod that is longer than the crank. The force with which the rod presses the slider on the guide
    is neglected. The default values are examples without a source.

    Source of the equations: textbook (J. J. Uicker, G. R. Pennock, J. E. Shigley, Theory of Machines and Mechanisms,
    Oxford).

    Examples
    --------
    >>> from models import CrankSlider
    >>> from toolbox import compose
    >>> print(compose(CrankSlider()))
    HybridSystem(CrankSlider): 2 states (crank.angle, crank.speed); contacts: guide; inputs: crank.torque [N m]
    """

    inertia: Quantity = quantity(0.01, "kg m2", "inertia of the crank", above=0)
    mass: Quantity = quantity(1.0, "kg", "mass of the slider", at_least=0)
    crank: Quantity = quantity(0.05, "m", "length of the crank", above=0)
    rod: Quantity = quantity(0.15, "m", "length of the connecting rod", above=0)
    damping: Quantity = quantity(0.0, "N m s/rad", "drag of the shaft", at_least=0)
    friction: FrictionLaw = Coulomb(30.0, 20.0)

    def check(self):
        if self.rod <= self.crank:
            raise SceneError(f"Argument `rod` must be longer than the crank of {self.crank:g} m, but it is {self.rod!r}.")

    def equations(self, signal):
        angle, speed = state("crank.angle", "rad"), state("crank.speed", "rad/s")
        place = self.crank * ca.cos(angle) + ca.sqrt(self.rod**2 - (self.crank * ca.sin(angle)) ** 2)
        return _turned(signal, self.inertia, self.mass, self.damping, self.friction, place, angle, speed)


@dataclass(frozen=True)
class ScotchYoke(Component):
    """Crank pin that moves a slotted yoke to and fro, with dry friction at the guide of the yoke: x = r sin a.

        (J + m p^2) w' + m p p' w^2 = T - d w + p F,   p = dx/da

    Symbols and their fields: J `inertia` [kg m2], m `mass` [kg], r `crank` [m], d `damping` [N m s/rad].

    a is the angle of the crank [rad], w its speed [rad/s], x the position of the yoke [m], 0 in the middle of its stroke,
    and F the friction at the guide on the yoke [N], against its speed p w. The load of the guide is 1, so the
    coefficients of the friction law `friction` are forces [N].

    - Needs the signal `crank.torque` T [N m] (default 0).
    - Gives the signals `slider.position` x [m] and `slider.speed` p w [m/s] of the yoke.
    - States: `crank.angle` a [rad] and `crank.speed` w [rad/s]. Contact: `guide`.

    J is the inertia of the crank shaft with damping d, m the mass of the yoke and r the length of the crank. At a dead
    centre p = 0, so the friction of the guide does not hold the crank there. The default values are examples without a
    source.

    Source of the equations: textbook (J. J. Uicker, G. R. Pennock, J. E. Shigley, Theory of Machines and Mechanisms,
    Oxford).

    Examples
    --------
    >>> from models import ScotchYoke
    >>> from toolbox import compose
    >>> print(compose(ScotchYoke()))
    HybridSystem(ScotchYoke): 2 states (crank.angle, crank.speed); contacts: guide; inputs: crank.torque [N m]
    """

    inertia: Quantity = quantity(1.0, "kg m2", "inertia of the crank", above=0)
    mass: Quantity = quantity(0.0, "kg", "mass of the yoke", at_least=0)
    crank: Quantity = quantity(1.0, "m", "length of the crank", above=0)
    damping: Quantity = quantity(0.0, "N m s/rad", "drag of the shaft", at_least=0)
    friction: FrictionLaw = Coulomb(0.1, 0.1)

    def equations(self, signal):
        angle, speed = state("crank.angle", "rad"), state("crank.speed", "rad/s")
        return _turned(signal, self.inertia, self.mass, self.damping, self.friction, self.crank * ca.sin(angle), angle, speed)
