"""A drill string under a table that turns at a given speed: the simplest string."""

from __future__ import annotations

import math
from dataclasses import dataclass

from toolbox import Component, Equations, Quantity, quantity, state


@dataclass(frozen=True)
class TorsionalPendulum(Component):
    """One inertia on a spring under a rotary table with imposed speed.

        J w' = k twist + c (W - w) - c_b w - T,   twist' = W - w

    Symbols and their fields: J `inertia` [kg m2], k `stiffness` [N m/rad], c `damping` [N m s/rad], c_b `bit_drag` [N m
    s/rad].

    W is the speed of the table, w the speed of the bit, and T the torque on the bit. twist [rad] is the angle by which
    the table is ahead of the bit. The model has two states.

    - Needs the signals `top.speed` W [rad/s] (default: the field `top_speed`) and `bit.torque` T [N m] (default 0).
    - Gives the signals `bit.speed` w [rad/s], `top.load` [N m], the torque with which the string
      loads the table (positive against the rotation),
      `bit.free_acceleration` [rad/s2], the acceleration of the bit without the rock, and `bit.inertia` [kg m2].

    The default values are examples of the size of the 1000 m string in the source.

    Source: T. Richard, C. Germay, E. Detournay, J. Sound Vib. 305 (2007).

    Examples
    --------
    >>> from models import TorsionalPendulum
    >>> from toolbox import compose
    >>> print(compose(TorsionalPendulum()))
    HybridSystem(TorsionalPendulum): 2 states (pendulum.twist, pendulum.speed); contacts: none; inputs: top.speed [rad/s], bit.torque [N m]
    """

    inertia: Quantity = quantity(
        116.0, "kg m2", "inertia of the bit and of the parts that rotate with it", above=0, typical_range=(1e-3, math.inf)
    )
    stiffness: Quantity = quantity(938.0, "N m/rad", "torsional stiffness of the string", at_least=0, typical_range=(1.0, math.inf))
    damping: Quantity = quantity(0.0, "N m s/rad", "damping of the string", at_least=0)
    bit_drag: Quantity = quantity(0.0, "N m s/rad", "viscous drag on the bit", at_least=0)
    top_speed: Quantity = quantity(12.566370614359172, "rad/s", "speed of the table", typical_range=(0.05, 40.0))

    def equations(self, signal):
        twist, speed = state("pendulum.twist", "rad"), state("pendulum.speed", "rad/s")
        top, torque = signal("top.speed", "rad/s", default=self.top_speed), signal("bit.torque", "N m", default=0.0)
        tau = self.stiffness * twist + self.damping * (top - speed)
        load = tau - self.bit_drag * speed
        return Equations(
            flow={twist: top - speed, speed: (load - torque) / self.inertia},
            outputs={
                "bit.speed": (speed, "rad/s"),
                "top.load": (tau, "N m"),
                "bit.free_acceleration": (load / self.inertia, "rad/s2"),
                "bit.inertia": (self.inertia, "kg m2"),
            },
            stored=self.inertia * speed**2 / 2 + self.stiffness * twist**2 / 2,
            losses={"damping": self.damping * (top - speed) ** 2, "bit drag": self.bit_drag * speed**2},
            supplies={"table": tau * top, "bit torque": -torque * speed},
        )
