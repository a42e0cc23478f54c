"""A disc brake at low speed: the pad swings on its caliper and groans; the plant for laws that command the force of the pads."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca

from models.friction import Exponential
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, quantity, state
from toolbox.modelling import OptionalQuantity


@dataclass(frozen=True)
class DiscBrake(Component):
    """Disc between two pads on a caliper, which is held against rotation by a spring and a damper.

        I w' = T_drive - r F ;   m v' = F + a - k x - c v ;   F dry friction with slip speed r w - v and load 2 N

    Symbols and their fields: I `inertia` [kg m2], r `radius` [m], m `pad_mass` [kg], k `stiffness` [N/m], c `damping`
    [N s/m].

    w is the speed of the disc. x and v are position and speed of pads and caliper in tangential direction at the
    effective radius r. N = `brake.force` + `brake.disturbance` is the normal force of one pad. The commanded force must
    stay >= 0, because pads only push.

    Optional features (default None: off):

    - `lag` [s]: time constant of a first-order lag between the command and N. The part `BrakeActuator` is an actuator
      with limits.
    - `wheel_radius` R [m]: the speed of the car, R w, replaces the speed of the disc as a state. A stop then begins
      with `start={"disc.car_speed": "30 km/h"}`.
    - `second_pad_friction`: a separate friction law for the second pad, so that each pad carries the load N. Both pads are
      on one caliper.
    - `heat_capacity` C [J/K]: the temperature h [K] of the disc above the surroundings, C h' = F (r w - v) - cooling h,
      with the field `cooling` [W/K]. All friction is multiplied by max(1 - fade h, 0), with the field `fade` [1/K].

    Needs the signals

    - `brake.force` [N] (default: the field `force`);
    - `brake.disturbance` [N] (default 0). For a harmonic disturbance give this input the value `toolbox.sine(mean,
      amplitude, frequency)`;
    - `disc.torque` T_drive [N m] (default 0);
    - `pad.attachment` a [N] (default 0), the force of a part that is attached to the pads, such as an absorber or a
      shaker.

    Gives the signals

    - `disc.speed` w [rad/s], `pad.position` x [m], `pad.speed` v [m/s], `brake.torque` r F [N m];
    - with a lag `brake.normal_force` [N];
    - with a wheel radius `disc.car_speed` [m/s];
    - with a heat capacity `disc.warming` h [K].

    Contacts: `pad` and, with a second friction law, `other_pad`. Both stick and break away together.

    Range of validity: groan at low speed (below about 3 rad/s for the default values). Squeal and the heating of the
    pads are not modelled; `SquealingPad` is a model of squeal.

    The default values are examples, not published values. They represent one wheel of a passenger car of 1600 kg on
    tyres of 0.3 m radius. A quarter of the mass acts as inertia on the disc. Pads and caliper have a natural frequency
    of 50 Hz. With exponential friction the pad loses its damping if 2 N (mu_s - mu_k) decay exp(-decay r w) > c.

    This model is a reconstruction. Its structure (disc and pad with a harmonic normal force) is the structure of the
    model of Balaram et al., whose full paper was not available.

    Examples
    --------
    >>> from models import DiscBrake
    >>> from toolbox import compose
    >>> plant = compose(DiscBrake())
    >>> print(plant.x.numel(), "states,", len(plant.elements), "contacts")
    3 states, 1 contacts
    """

    inertia: Quantity = quantity(
        36.0, "kg m2", "inertia I of disc, wheel and a quarter of the car", above=0, typical_range=(1e-3, math.inf)
    )
    radius: Quantity = quantity(0.12, "m", "effective radius r of the pads", above=0, typical_range=(0.01, 1.0))
    pad_mass: Quantity = quantity(10.0, "kg", "mass m of pads, caliper and other parts that vibrate with them", above=0)
    stiffness: Quantity = quantity(1e6, "N/m", "tangential stiffness k that holds the caliper", at_least=0)
    damping: Quantity = quantity(200.0, "N s/m", "tangential damping c", at_least=0)
    force: Quantity = quantity(1000.0, "N", "normal force of one pad", at_least=0, typical_range=(1.0, 1e6))
    lag: OptionalQuantity = quantity(None, "s", "time constant of the actuator", above=0)
    friction: FrictionLaw = Exponential(static=0.45, kinetic=0.35, decay=5.0)
    wheel_radius: OptionalQuantity = quantity(
        None, "m", "radius R of the tyre, which makes the speed of the car a state", above=0, typical_range=(0.05, 2.0)
    )
    second_pad_friction: FrictionLaw | None = None
    heat_capacity: OptionalQuantity = quantity(None, "J/K", "heat capacity C of the disc", above=0)
    cooling: Quantity = quantity(20.0, "W/K", "heat flow from the disc per kelvin above the surroundings", at_least=0)
    fade: Quantity = quantity(1e-3, "1/K", "relative loss of friction per kelvin", at_least=0)

    def equations(self, signal):
        flow, gives = {}, {}
        if self.wheel_radius is None:
            turning = w = state("disc.speed", "rad/s")
        else:
            turning = state("disc.car_speed", "m/s")
            w = turning / self.wheel_radius
            gives["disc.speed"] = (w, "rad/s")
        x, v = state("pad.position", "m"), state("pad.speed", "m/s")
        command = signal("brake.force", "N", default=self.force)
        disturbance = signal("brake.disturbance", "N", default=0.0)
        drive = signal("disc.torque", "N m", default=0.0)
        attachment = signal("pad.attachment", "N", default=0.0)
        normal = command
        if self.lag is not None:
            normal = state("brake.normal_force", "N")
            flow = {normal: (command - normal) / self.lag}
        slip = self.radius * w - v
        load = normal + disturbance
        if self.heat_capacity is not None:
            warming = state("disc.warming", "K")
            load = load * ca.fmax(1.0 - self.fade * warming, 0.0)
        pads = [DryFriction("pad", slip, self.friction, 2 * load if self.second_pad_friction is None else load)]
        if self.second_pad_friction is not None:
            pads.append(DryFriction("other_pad", slip, self.second_pad_friction, load))
        grip = -sum(pad.force for pad in pads)  # on the pads, along the rotation
        torque = self.radius * grip
        if self.heat_capacity is not None:
            flow[warming] = (grip * slip - self.cooling * warming) / self.heat_capacity
        spin = (drive - torque) / self.inertia
        return Equations(
            flow={
                turning: spin if self.wheel_radius is None else self.wheel_radius * spin,
                x: v,
                v: (grip + attachment - self.stiffness * x - self.damping * v) / self.pad_mass,
                **flow,
            },
            outputs={"brake.torque": (torque, "N m"), **gives},
            elements=pads,
            stored=self.inertia * w**2 / 2 + self.pad_mass * v**2 / 2 + self.stiffness * x**2 / 2,
            losses={"friction": grip * slip, "caliper": self.damping * v**2},
            supplies={"drive": drive * w, "attachment": attachment * v},
        )
