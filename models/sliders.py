"""Sliders: a block on a spring and a damper, dragged by a plate; and one that a vertical force pushes down an incline."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca

from models.friction import Coulomb, Exponential
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, quantity, state


@dataclass(frozen=True)
class Slider(Component):
    """Rigid slider held by a spring and a damper: m v' = u - k x - c v + F.

    Symbols and their fields: m `mass` [kg], k `stiffness` [N/m], c `damping` [N s/m].

    F is the drag of the plate under the slider.

    - Needs the signals `slider.pull` u [N] (default 0) and `plate.drag` F [N] (default 0), which `PlateContact` or
      `BristleContact` gives.
    - Gives the signals `slider.position` x [m], `slider.speed` v [m/s].

    The default spring and damper are taken from a published finite-element study of a slider on a plate (10 N/mm, 5 N
    s/mm). The default mass is an assumption: a steel cube of 10 mm. With these values c / m = 6e5 1/s, so the model is
    stiff: an explicit method needs about 2e5 steps for each second of slip.

    Examples
    --------
    >>> from models import Slider
    >>> from toolbox import compose
    >>> print(compose(Slider()))
    HybridSystem(Slider): 2 states (slider.position, slider.speed); contacts: none; inputs: slider.pull [N], plate.drag [N]
    """

    mass: Quantity = quantity(7.8e-3, "kg", "mass of the slider (assumed)", above=0)
    stiffness: Quantity = quantity(10_000.0, "N/m", "stiffness of the spring to ground", at_least=0)
    damping: Quantity = quantity(5000.0, "N s/m", "damping to ground", at_least=0)

    def equations(self, signal):
        x, v = state("slider.position", "m"), state("slider.speed", "m/s")
        pull, drag = signal("slider.pull", "N", default=0.0), signal("plate.drag", "N", default=0.0)
        return Equations(
            flow={x: v, v: (pull - self.stiffness * x - self.damping * v + drag) / self.mass},
            stored=self.mass * v**2 / 2 + self.stiffness * x**2 / 2,
            losses={"damper": self.damping * v**2},
            supplies={"pull": pull * v, "plate": drag * v},
        )


@dataclass(frozen=True)
class PlateContact(Component):
    """Dry friction between a slider and a moving plate, as one contact that sticks and slips as a whole.

    - Needs the signals `slider.speed` [m/s], `plate.speed` [m/s] (default 0) and `plate.load` [N] (default: the field
      `load`).
    - Gives the signal `plate.drag` [N], the force on the slider.
    - Contact: `plate`.

    The default friction is taken from a published finite-element study: 0.35, falling to 0.25 with 0.001 s/mm, under a
    pressure of 0.1 MPa. The same study gives spring and damper of `Slider`. The study does not give the area. An area
    of 10 mm x 10 mm is assumed, so the load is 10 N.

    Examples
    --------
    >>> from models import PlateContact, Slider
    >>> from toolbox import compose
    >>> print(compose(Slider(), PlateContact()))
    HybridSystem(Slider, PlateContact): 2 states (slider.position, slider.speed); contacts: plate; inputs: slider.pull [N], plate.speed [m/s], plate.load [N]
    """

    load: Quantity = quantity(10.0, "N", "normal load (0.1 MPa on an assumed 100 mm2)", at_least=0)
    friction: FrictionLaw = Exponential(static=0.35, kinetic=0.25, decay=1.0)

    def equations(self, signal):
        v, plate_speed = signal("slider.speed", "m/s"), signal("plate.speed", "m/s", default=0.0)
        load = signal("plate.load", "N", default=self.load)
        plate = DryFriction("plate", v - plate_speed, self.friction, load)
        return Equations(
            outputs={"plate.drag": (plate.force, "N")},
            elements=[plate],
            losses={"friction": -plate.force * (v - plate_speed)},
            supplies={"plate drive": plate.force * plate_speed, "slider": -plate.force * v},
        )


@dataclass(frozen=True)
class InclinedSlider(Component):
    """Slider on an incline of angle a under a vertical force F, held by a spring and a damper along the slope.

        m y'' + c y' + k y = F sin a - friction,   |friction| <= mu F cos a,   m = F cos a / g

    Symbols and their fields: F `force` [N], a `angle` [rad], c `damping` [N s/m], k `stiffness` [N/m], g `gravity`
    [m/s2], mu coefficient of the friction law `friction` [1].

    The slider moves from rest if and only if tan a > mu. It then creeps to k y = F (sin a - mu cos a).

    - Needs the signal `slider.force` F [N] (default: the field `force`).
    - Gives the signals `slider.position` y [m] and `slider.speed` [m/s], positive down the slope.
    - Contact: `slope`.

    The default values and the unusual definition of the mass m = F cos a / g are taken from a published finite-element
    study (10 N, 1 N/mm, 1 N s/mm, mu 0.35, 45 deg, g = 9.8 m/s2). If the input `slider.force` varies, the mass still
    follows from the field `force`.

    Range of validity: 0 <= a < pi/2.

    Examples
    --------
    >>> from models import InclinedSlider
    >>> from toolbox import compose
    >>> print(compose(InclinedSlider()))
    HybridSystem(InclinedSlider): 2 states (slider.position, slider.speed); contacts: slope; inputs: slider.force [N]
    """

    force: Quantity = quantity(10.0, "N", "vertical force", above=0)
    angle: Quantity = quantity(math.pi / 4, "rad", "angle of the incline", at_least=0, at_most=1.57)
    stiffness: Quantity = quantity(1000.0, "N/m", "stiffness of the spring along the slope", at_least=0)
    damping: Quantity = quantity(1000.0, "N s/m", "damping along the slope", at_least=0)
    gravity: Quantity = quantity(9.8, "m/s2", "gravity, in m = F cos a / g only", above=0)
    friction: FrictionLaw = Coulomb(static=0.35, kinetic=0.35)

    def equations(self, signal):
        y, v = state("slider.position", "m"), state("slider.speed", "m/s")
        force = signal("slider.force", "N", default=self.force)
        mass = self.force * ca.cos(self.angle) / self.gravity
        slope = DryFriction("slope", v, self.friction, force * ca.cos(self.angle))
        push = force * ca.sin(self.angle)
        return Equations(
            flow={y: v, v: (push - self.stiffness * y - self.damping * v + slope.force) / mass},
            elements=[slope],
            stored=mass * v**2 / 2 + self.stiffness * y**2 / 2,
            losses={"friction": -slope.force * v, "damper": self.damping * v**2},
            supplies={"force": push * v},
        )
