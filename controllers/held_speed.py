"""A drive that holds the speed of a brake disc: the test bench on which groan is mapped over pressure and speed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from toolbox import Controller, Equations, Quantity, SceneError, quantity, state
from toolbox.modelling import OptionalQuantity


@dataclass(frozen=True)
class HeldSpeed(Controller):
    """PI control of the disc speed, so that a brake can be tested at constant speed, as on a test bench.

        T = I (2 zeta om e + om^2 int e dt),   e = reference - w,   om = 2 pi frequency

    I is the field `inertia` [kg m2], zeta the field `damping` [1], om the natural frequency [rad/s] and w the speed of
    the disc [rad/s]. The gains place the poles of a disc with inertia I at the roots of s^2 + 2 zeta om s + om^2.
    `design` reads I (`disc.inertia`) from the plant.

    Why: a stop passes the speeds at which a pad groans in a few seconds. It has no steady state whose stability could
    be analysed. A drive that holds the speed gives such a steady state. Choose

    - the frequency far below the frequency of the pad, so that the drive does not damp the vibration under test;
    - the inertia of the disc far above the inertia of the pad, so that the pad hardly changes the disc speed.

    Signals:

    - Needs `disc.speed` [rad/s] and `disc.reference` [rad/s] (default: the field `reference`). On a brake with a
      `wheel_radius` R, the set-point is the speed of the car, `car.reference` [m/s] (default: R times the field
      `reference`), in place of `disc.reference`.
    - Gives `disc.torque` [N m].

    Source: textbook (pole placement).

    Examples
    --------
    >>> from controllers import HeldSpeed
    >>> from models import DiscBrake
    >>> from toolbox import closed_loop, compose, equilibrium
    >>> loop = closed_loop(compose(DiscBrake(force="1 kN")), HeldSpeed(reference=2.0))
    >>> print(f"{equilibrium(loop)['disc.speed']:.2f} rad/s")
    2.00 rad/s
    >>> loop = closed_loop(compose(DiscBrake(force="1 kN", wheel_radius="300 mm")), HeldSpeed(), inputs={"car.reference": "2 km/h"})
    >>> print(f"{3.6 * equilibrium(loop)['disc.car_speed']:.2f} km/h")
    2.00 km/h
    """

    measured_signals: ClassVar[tuple[str, ...]] = ("disc.speed",)
    actuated_signals: ClassVar[tuple[str, ...]] = ("disc.torque",)

    reference: Quantity = quantity(1.0, "rad/s", "set-point of the disc speed", above=0)
    frequency: Quantity = quantity(0.5, "Hz", "natural frequency of the drive", above=0)
    damping: Quantity = quantity(0.7, "1", "its damping ratio zeta", above=0)
    inertia: OptionalQuantity = quantity(None, "kg m2", "inertia I of disc and drive; by default read from the plant", above=0)
    wheel_radius: OptionalQuantity = quantity(None, "m", "wheel radius R of the car; by default read from the plant", above=0)

    def design(self, plant):
        found = {}
        if self.wheel_radius is None and plant.has_parameter("disc.wheel_radius"):
            found["wheel_radius"] = float(plant.parameter("disc.wheel_radius"))
        if self.inertia is None:
            try:
                found["inertia"] = float(plant.parameter("disc.inertia"))
            except SceneError as error:
                raise SceneError(f"HeldSpeed is designed on a brake with a disc, or needs its field `inertia`: {error}") from None
        return replace(self, **found)

    def continuous(self, signal):
        angle, om = state("held.angle", "rad"), 2.0 * math.pi * self.frequency
        if self.wheel_radius is None:
            wanted = signal("disc.reference", "rad/s", default=self.reference)
        else:
            wanted = signal("car.reference", "m/s", default=self.wheel_radius * self.reference) / self.wheel_radius
        error = wanted - signal("disc.speed", "rad/s")
        return Equations(
            flow={angle: error}, outputs={"disc.torque": (self.inertia * (2.0 * self.damping * om * error + om**2 * angle), "N m")}
        )
