"""Mechanisms that tests share: a shaft with bearing and brake, a valve spool between stops, a one-way clutch, friction on a prescribed motion, and
motions whose closed forms are known: a ball, an oscillator, a tank, a Hertz contact."""

from dataclasses import dataclass

import casadi as ca

from models import Coulomb, GaussianStribeck, TwoWay
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, UnilateralContact, quantity, state, time
from toolbox.modelling import Hysteresis, OneWayClutch, Quantities


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


@dataclass(frozen=True)
class Ball(Component):
    """A ball on a rigid floor under gravity and a push."""

    restitution: float = quantity(0.5, "1", at_least=0, at_most=1)
    gravity: float = quantity(10.0, "m/s2", above=0)
    mass: float = quantity(1.0, "kg", above=0)

    def equations(self, signal):
        x, v = state("ball.height", "m"), state("ball.speed", "m/s")
        floor = UnilateralContact("floor", -x, -v, restitution=self.restitution)
        return Equations({x: v, v: (signal("ball.push", "N", default=0.0) + floor.force) / self.mass - self.gravity}, elements=[floor])


@dataclass(frozen=True)
class Oscillator(Component):
    """x'' = -w^2 x + u, its square, and a signal cos(k x) that turns much faster than it."""

    frequency: float = quantity(1.0, "rad/s", above=0)
    waves: float = quantity(40.0, "rad/m", above=0)

    def equations(self, signal):
        x, v = state("mass.position", "m"), state("mass.speed", "m/s")
        push = signal("mass.push", "m/s2", default=0.0)
        outputs = {"mass.wave": (ca.cos(self.waves * x), "1"), "mass.square": (x * x, "m2")}
        return Equations(flow={x: v, v: push - self.frequency**2 * x}, outputs=outputs)


@dataclass(frozen=True)
class Swing(Component):
    """x'' = -x with a switch that is on above a height."""

    high: float = quantity(0.9999, "1", "height above which the switch is on")

    def equations(self, signal):
        x, v = state("swing.x", "1"), state("swing.v", "1/s")
        return Equations(flow={x: v, v: -x}, elements=[Hysteresis("switch", x, self.high, self.high)])


@dataclass(frozen=True)
class Tank(Component):
    """x' = rate u: what a held input does to it is a straight line."""

    rate: float = quantity(1.0, "1", "rate")

    def equations(self, signal):
        x = state("tank.level", "m")
        return Equations(flow={x: self.rate * signal("tank.inflow", "m/s", default=0.0)})


@dataclass(frozen=True)
class Hertz(Component):
    """A mass between a force and a Hertz contact, whose force grows as depth^1.5 and has no series where the contact closes."""

    stiffness: float = quantity(50.0, "1", "stiffness")

    def equations(self, signal):
        x, v = state("ball.depth", "m"), state("ball.speed", "m/s")
        return Equations(flow={x: v, v: 1.0 - self.stiffness * ca.fmax(x, 0.0) ** 1.5})
