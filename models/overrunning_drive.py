"""A driving shaft and a driven one behind a one-way clutch.

    J1 w1' = T - d1 w1 - c,   J2 w2' = c - d2 w2 - T_load          w1 <= w2,  c >= 0,  c (w1 - w2) = 0

The clutch drives while it is locked and overruns where the driven side is faster. Source: textbook (sprag clutch, freewheel of a bicycle).
"""

from __future__ import annotations

from dataclasses import dataclass

from toolbox import Component, Equations, Quantity, quantity, state
from toolbox.modelling import OneWayClutch


@dataclass(frozen=True)
class OverrunningDrive(Component):
    """Shaft that drives another shaft through a one-way clutch.

        J1 w1' = T - d1 w1 - c,   J2 w2' = c - d2 w2 - T_load,   w1 <= w2,  c >= 0,  c (w1 - w2) = 0

    Symbols and their fields: J1 `driving_inertia` and J2 `driven_inertia` [kg m2], d1 `driving_damping` and d2
    `driven_damping` [N m s/rad]. w1 and w2 are the speeds of the driving and the driven shaft [rad/s].

    The clutch transmits the torque c while it is locked and overruns while the driven shaft is faster. The inputs are
    the torques T and T_load, `driver.torque` and `driven.load` [N m].

    The default values are examples without a source.

    Examples
    --------
    >>> from models import OverrunningDrive
    >>> from toolbox import compose
    >>> print(compose(OverrunningDrive()))
    HybridSystem(OverrunningDrive): 2 states (driver.speed, driven.speed); contacts: clutch; inputs: driver.torque [N m], driven.load [N m]
    """

    driving_inertia: Quantity = quantity(1.0, "kg m2", "inertia of the driving shaft", above=0)
    driven_inertia: Quantity = quantity(2.0, "kg m2", "inertia of the driven shaft", above=0)
    driving_damping: Quantity = quantity(0.0, "N m s/rad", "drag of the driving shaft", at_least=0)
    driven_damping: Quantity = quantity(0.3, "N m s/rad", "drag of the driven shaft", at_least=0)

    def equations(self, signal):
        torque, load = signal("driver.torque", "N m", default=0.0), signal("driven.load", "N m", default=0.0)
        driving, driven = state("driver.speed", "rad/s"), state("driven.speed", "rad/s")
        clutch = OneWayClutch("clutch", driving - driven)
        return Equations(
            flow={
                driving: (torque - self.driving_damping * driving - clutch.force) / self.driving_inertia,
                driven: (clutch.force - self.driven_damping * driven - load) / self.driven_inertia,
            },
            elements=[clutch],
            stored=(self.driving_inertia * driving**2 + self.driven_inertia * driven**2) / 2,
            losses={"drag": self.driving_damping * driving**2 + self.driven_damping * driven**2},
            supplies={"torque": torque * driving, "load": -load * driven},
        )
