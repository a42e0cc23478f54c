"""Mechanisms that tests share: a shaft with bearing and brake, a valve spool between stops, a one-way clutch, friction on a prescribed motion."""

from dataclasses import dataclass

import casadi as ca

from models import Coulomb, GaussianStribeck, TwoWay
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, UnilateralContact, quantity, state, time
from toolbox.modelling import OneWayClutch, Quantities


@dataclass(frozen=True)
class BrakedShaft(Component):
    """A shaft in a bearing, with a brake."""

    inertia: Quantity = quantity(1.0, "kg m2", "inertia", above=0)
    bearing: FrictionLaw = GaussianStribeck(2.0, 1.0, 0.5)
    brake: FrictionLaw = Coulomb(0.4, 0.3)
    press: Quantity = quantity(2.0, "N m", "press of the brake", at_least=0)

    def equations(self, signal):
        torque = signal("drive.torque", "N m", default=0.0)
        angle, speed = state("shaft.angle", "rad"), state("shaft.speed", "rad/s")
        units = {"slip_unit": "rad/s", "force_unit": "N m"}
        bearing = DryFriction("bearing", speed, self.bearing, **units)
        brake = DryFriction("brake", speed, self.brake, self.press, **units)
        return Equations(
            flow={angle: speed, speed: (torque + bearing.force + brake.force) / self.inertia},
            elements=[bearing, brake],
            stored=self.inertia * speed**2 / 2,
            losses={"bearing": -bearing.force * speed, "brake": -brake.force * speed},
            supplies={"drive": torque * speed},
        )


@dataclass(frozen=True)
class Spool(Component):
    """A valve spool on a spring, with seals, between two stops."""

    inertia: Quantity = quantity(0.2, "kg", "mass", above=0)
    stiffness: Quantity = quantity(30.0, "N/m", "spring", at_least=0)
    stroke: Quantity = quantity(0.1, "m", "way to either stop", above=0)
    restitution: Quantity = quantity(0.3, "1", "restitution of the stops", at_least=0)
    seal: FrictionLaw = Coulomb(2.0, 1.2)

    def equations(self, signal):
        force = signal("drive.torque", "N", default=0.0)
        place, speed = state("spool.place", "m"), state("shaft.speed", "m/s")
        seal = DryFriction("seal", speed, self.seal)
        upper = UnilateralContact("upper", place - self.stroke, speed, restitution=self.restitution)
        lower = UnilateralContact("lower", -place - self.stroke, -speed, restitution=self.restitution)
        pull = force - self.stiffness * place + seal.force - upper.force + lower.force
        return Equations(flow={place: speed, speed: pull / self.inertia}, elements=[seal, upper, lower])


@dataclass(frozen=True)
class Overrunning(Component):
    """A driving shaft and a driven one behind a one-way clutch."""

    inertia: Quantity = quantity(1.0, "kg m2", "inertia of the driving shaft", above=0)
    driven: Quantity = quantity(2.0, "kg m2", "inertia of the driven shaft", above=0)
    drag: Quantity = quantity(0.3, "N m s/rad", "drag of the driven shaft", at_least=0)

    def equations(self, signal):
        torque = signal("drive.torque", "N m", default=0.0)
        driving, driven = state("shaft.speed", "rad/s"), state("wheel.speed", "rad/s")
        clutch = OneWayClutch("clutch", driving - driven)
        return Equations(
            flow={driving: (torque - clutch.force) / self.inertia, driven: (clutch.force - self.drag * driven) / self.driven},
            elements=[clutch],
        )


@dataclass(frozen=True)
class RubbedArm(Component):
    """An arm that a surface rubs on whose speed against it is given."""

    inertia: Quantity = quantity(1.0, "kg m2", "inertia", above=0)
    friction: FrictionLaw = Coulomb(2.0, 1.5)

    def equations(self, signal):
        torque = signal("drive.torque", "N m", default=0.0)
        speed = state("shaft.speed", "rad/s")
        rub = DryFriction("rub", 0.3 * ca.cos(2 * time) + 0.1, self.friction)
        return Equations(flow={speed: (torque + rub.force - speed) / self.inertia}, elements=[rub])


@dataclass(frozen=True)
class Stack(Component):
    """A driven plate on another one, each of which rubs on the ground, too: three frictions hold two bodies."""

    inertia: Quantity = quantity(1.0, "kg", "mass of the driven plate", above=0)
    other: Quantity = quantity(2.0, "kg", "mass of the other plate", above=0)
    bounds: Quantities = quantity(
        (0.8, 1.5, 1.1), "N", "friction of the first and of the second plate on the ground, and between them", at_least=0
    )

    def equations(self, signal):
        force = signal("drive.torque", "N", default=0.0)
        v, u = state("shaft.speed", "m/s"), state("plate.speed", "m/s")
        first, second, between = (
            DryFriction(name, slip, Coulomb(self.bounds[i], self.bounds[i]))
            for i, (name, slip) in enumerate((("first", v), ("second", u), ("between", v - u)))
        )
        return Equations(
            flow={v: (force + first.force + between.force) / self.inertia, u: (second.force - between.force) / self.other},
            elements=[first, second, between],
        )


TWO_WAY = TwoWay(Coulomb(2.0, 1.2), Coulomb(1.5, 1.0))
