"""A gear stage whose loss at the teeth follows the torque that they transmit, by a table over speed, with a bearing.

    J1 w1' = T1 - tau + M_teeth + M_bearing,   J2 w2' = i tau + T2          tau = k (a1 - i a2) + c (w1 - i w2)
    |M_teeth| <= mu(|w1|) |tau|,   M_bearing by its own law

The teeth and the bearing rub at the speed of the driving shaft: at rest they are one friction. tau must not depend on their force, so the teeth are elastic.
The bearing keeps a bound where the teeth are unloaded. Source: as the lossy gear of the Modelica Standard Library (C. Pelchen, C. Schweiger, M. Otter, Modeling
and simulating the efficiency of gearboxes and of planetary gearboxes, 2nd Modelica Conference, 2002), with the loss at one side.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from models.friction import Coulomb, Tabulated
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, quantity, state


@dataclass(frozen=True)
class GearStage(Component):
    """Gear stage between a driving and a driven shaft, with elastic teeth, a table of tooth losses, and a bearing.

        J1 w1' = T1 - tau + M_teeth + M_bearing,   J2 w2' = i tau + T2,   tau = k (a1 - i a2) + c (w1 - i w2)
        |M_teeth| <= mu(|w1|) |tau|,   M_bearing by its own friction law

    T1 and T2 are the external torques, positive in the direction of positive speeds: a load on the driven shaft has
    T2 < 0. The friction of the teeth acts on the driving shaft, against w1. It is proportional to the transmitted torque
    tau, with a coefficient mu from a table over the speed w1. The bearing is on the driving shaft, and its friction law is
    a torque [N m].

    - Needs the signals `input.torque` T1 and `output.torque` T2 [N m] (default 0).
    - States: `input.speed` w1 and `output.speed` w2 [rad/s], `teeth.twist` a1 - i a2 [rad].
    - Contacts: `teeth` and `bearing`.

    a1 and a2 are the angles [rad], w1 and w2 the speeds [rad/s] of the driving and the driven shaft, and i is the field
    `ratio` [1]. Symbols and their fields: J1 `driving_inertia` and J2 `driven_inertia` [kg m2], k `stiffness` [N
    m/rad], c `damping` [N m s/rad], mu table `losses`, M_bearing friction law `bearing`. The default values are
    examples without a source.

    Source of the equations: lossy gear of C. Pelchen, C. Schweiger, M. Otter, 2nd Modelica Conference, 2002, with the
    loss at one side.

    Examples
    --------
    >>> from models import GearStage
    >>> from toolbox import compose
    >>> print(compose(GearStage()))
    HybridSystem(GearStage): 3 states (teeth.twist, input.speed, output.speed); contacts: bearing, teeth; inputs: input.torque [N m], output.torque [N m]
    """

    ratio: Quantity = quantity(2.0, "1", "speed of the driving shaft as a multiple of the speed of the driven shaft", above=0)
    driving_inertia: Quantity = quantity(1.0, "kg m2", "inertia of the driving shaft", above=0)
    driven_inertia: Quantity = quantity(1.5, "kg m2", "inertia of the driven shaft", above=0)
    stiffness: Quantity = quantity(1e4, "N m/rad", "stiffness of the teeth at the driving shaft", above=0)
    damping: Quantity = quantity(20.0, "N m s/rad", "damping of the teeth at the driving shaft", at_least=0)
    losses: FrictionLaw = Tabulated(speeds=(0.0, 10.0, 100.0), coefficients=(0.08, 0.05, 0.04), static=0.1)
    bearing: FrictionLaw = Coulomb(0.5, 0.4)

    def equations(self, signal):
        torque, load = signal("input.torque", "N m", default=0.0), signal("output.torque", "N m", default=0.0)
        twist = state("teeth.twist", "rad")
        driving, driven = state("input.speed", "rad/s"), state("output.speed", "rad/s")
        rate = driving - self.ratio * driven
        tau = self.stiffness * twist + self.damping * rate
        units = {"slip_unit": "rad/s", "force_unit": "N m"}
        bearing = DryFriction("bearing", driving, self.bearing, **units)
        teeth = DryFriction("teeth", driving, self.losses, ca.fabs(tau), **units)
        return Equations(
            flow={
                twist: rate,
                driving: (torque - tau + teeth.force + bearing.force) / self.driving_inertia,
                driven: (self.ratio * tau + load) / self.driven_inertia,
            },
            elements=[bearing, teeth],
            stored=(self.driving_inertia * driving**2 + self.driven_inertia * driven**2 + self.stiffness * twist**2) / 2,
            losses={"teeth": -teeth.force * driving, "bearing": -bearing.force * driving, "damping": self.damping * rate**2},
            supplies={"input": torque * driving, "output": load * driven},
        )
