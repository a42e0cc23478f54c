"""Mechanisms that tests share: a shaft with bearing and brake, friction on a prescribed motion, a ring, wagons, relays, and motions whose closed forms
are known: a ball, an oscillator, a tank, a Hertz contact."""

from dataclasses import dataclass

import casadi as ca

from models import Coulomb, GaussianStribeck, TwoWay
from toolbox import Component, DryFriction, Equations, FrictionLaw, Quantity, UnilateralContact, quantity, state, time
from toolbox.modelling import Hysteresis, Quantities, Relay


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


@dataclass(frozen=True)
class Wagons(Component):
    """Three wagons that touch, each with friction at its wheels: the first is pushed and pulled."""

    inertia: Quantity = quantity(1.0, "kg", "mass of a wagon", above=0)

    def equations(self, signal):
        push = signal("drive.torque", "N", default=0.0)
        x, v = state("wagons.place", "m", 3), state("wagons.speed", "m/s", 3)
        wheels = [DryFriction(f"wheel{i}", v[i], Coulomb(1.0, 0.8)) for i in range(3)]
        first, second = (UnilateralContact(f"buffer{i}", x[i] - x[i + 1], v[i] - v[i + 1], restitution=0.0) for i in range(2))
        pull = ca.vertcat(push - first.force, first.force - second.force, second.force) + ca.vertcat(*[wheel.force for wheel in wheels])
        return Equations(flow={x: v, v: pull / self.inertia}, outputs={"shaft.speed": (v[0], "m/s")}, elements=[*wheels, first, second])


@dataclass(frozen=True)
class LaggedRelay(Component):
    """A relay whose output reaches its switching function through two lags and an integrator."""

    inertia: Quantity = quantity(1.0, "1", "divisor of the highest derivative", above=0)

    def equations(self, signal):
        x = state("lags.x", "1", 3)
        relay = Relay("relay", x[0], 1.0, higher_degree=True)
        return Equations(
            flow={x: ca.vertcat(x[1], x[2], (-3 * x[1] - 2 * x[2] + relay.force) / self.inertia)},
            outputs={"shaft.speed": (x[0], "1")},
            elements=[relay],
        )


@dataclass(frozen=True)
class TwoRelays(Component):
    """Two relays that switch ever faster until both slide, and a lag that their outputs drive."""

    inertia: Quantity = quantity(1.0, "1", "divisor of the rates of the switching functions", above=0)

    def equations(self, signal):
        push = signal("drive.torque", "1", default=0.0)
        x, speed = state("pair.x", "1", 2), state("shaft.speed", "1")
        first, second = Relay("first", x[0], 1.0), Relay("second", x[1], 1.0)
        rates = 2 * ca.vertcat(first.force - 26 * second.force + push, 26 * first.force + second.force)
        return Equations(flow={x: rates / self.inertia, speed: first.force - second.force - speed}, elements=[first, second])


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
