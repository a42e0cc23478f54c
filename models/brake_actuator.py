"""The hydraulics or the motor between the commanded and the delivered force of a pad: a lag, a highest force, a highest rate."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from toolbox import Component, Equations, Quantity, quantity, state
from toolbox.modelling import OptionalQuantity


@dataclass(frozen=True)
class BrakeActuator(Component):
    """Actuator of a disc brake: first-order lag between commanded and delivered force, with a highest force and a highest rate.

        n' = clip((clip(u + d + A p, 0, highest_force) - n) / lag, -rate_limit, rate_limit)

    Symbols and their fields: `lag` [s], A `piston_area` [m2], highest_force [N] and rate_limit [N/s] the fields of
    these names.

    u is the commanded force of one pad, d a dither, p a brake pressure on a piston of area A, and n the delivered
    force.

    Compose it with a `DiscBrake`. The actuator then stands between the controllers and the brake: a controller that
    gives `brake.force` gives `actuator.command` instead, without any change of the controller. A dither through the
    same actuator gives `actuator.dither`. A dead time belongs to the controller: `Sampled(controller, period,
    delay=...)`.

    - Needs the signals `actuator.command` u [N] (default 0), `actuator.dither` d [N] (default 0) and, with a
      `piston_area`, `actuator.pressure` p [Pa] (default 0).
    - Gives the signals `brake.force` n [N] and, with a `piston_area`, `brake.pressure` n / A [Pa].

    If `highest_force` or `rate_limit` is None, the actuator has no such limit.

    Range of validity: a single lag represents valves, line and caliper. The default values are examples: 10 ms and 20
    kN/s (about 90 bar/s) are typical of a fast hydraulic unit.

    Examples
    --------
    >>> from models import BrakeActuator, DiscBrake
    >>> from toolbox import compose, simulate
    >>> brake = compose(DiscBrake(wheel_radius="300 mm"), BrakeActuator(piston_area="2290 mm^2"))
    >>> run = simulate(brake, 1.0, start={"disc.car_speed": "30 km/h"}, inputs={"actuator.pressure": "13 bar"})
    >>> round(float(run.at(0.9)["brake.pressure"]) / 1e5, 3)
    13.0
    """

    lag: Quantity = quantity(0.01, "s", "time constant from command to force", above=0)
    highest_force: OptionalQuantity = quantity(8000.0, "N", "highest force of one pad", above=0, typical_range=(1.0, 1e6))
    rate_limit: OptionalQuantity = quantity(20_000.0, "N/s", "highest rate of the force", above=0)
    piston_area: OptionalQuantity = quantity(None, "m2", "area A of the pistons that press one pad", above=0, typical_range=(1e-5, 0.1))

    @property
    def redirected_signals(self):
        """{"brake.force": "actuator.command"}: a controller that gives `brake.force` gives `actuator.command` instead."""
        return {"brake.force": f"{self.name or 'actuator'}.command"}

    @property
    def signal_limits(self):
        """Physical limits of the delivered force, as {"brake.force": (0, highest force)} [N]. None means no limit.
        Figures of a run draw these limits.
        """
        return {"brake.force": (0.0, self.highest_force)}

    def equations(self, signal):
        force = state("actuator.force", "N")
        asked = signal("actuator.command", "N", default=0.0) + signal("actuator.dither", "N", default=0.0)
        gives = {"brake.force": (force, "N")}
        if self.piston_area is not None:
            asked = asked + self.piston_area * signal("actuator.pressure", "Pa", default=0.0)
            gives["brake.pressure"] = (force / self.piston_area, "Pa")
        asked = ca.fmax(asked, 0.0)
        if self.highest_force is not None:
            asked = ca.fmin(asked, self.highest_force)
        rate = (asked - force) / self.lag
        if self.rate_limit is not None:
            rate = ca.fmin(ca.fmax(rate, -self.rate_limit), self.rate_limit)
        return Equations(flow={force: rate}, outputs=gives)
