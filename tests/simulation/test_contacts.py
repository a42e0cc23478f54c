"""Unilateral contacts, hysteresis and laws that jump, against closed forms, energy and independent solutions."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from models import BlockOnBelt, Coulomb, Exponential, StepFriction
from toolbox import (
    Budget,
    Component,
    DryFriction,
    Equations,
    FrictionLaw,
    SceneError,
    SimulationError,
    UnilateralContact,
    compose,
    energy_audit,
    equilibrium,
    linearise,
    quantity,
    simulate,
    state,
)
from toolbox.errors import ZenoError
from toolbox.inputs import sine
from toolbox.modelling import Hysteresis
from toolbox.simulation import EventExact


@dataclass(frozen=True)
class Ball(Component):
    """A ball falling on a floor, rigid or elastic."""

    mass: float = quantity(2.0, "kg", above=0)
    gravity: float = quantity(10.0, "m/s2")
    restitution: float | None = quantity(None, "1", at_least=0, at_most=1)
    stiffness: float | None = quantity(None, "N/m", above=0)
    damping: float = quantity(0.0, "N s/m", at_least=0)

    def equations(self, signal):
        x, v = state("ball.height", "m"), state("ball.speed", "m/s")
        floor = UnilateralContact("floor", -x, -v, stiffness=self.stiffness, damping=self.damping, restitution=self.restitution)
        pull = signal("ball.force", "N", default=0.0)
        return Equations(
            flow={x: v, v: -self.gravity + (floor.force + pull) / self.mass},
            elements=[floor],
            stored=self.mass * v**2 / 2 + self.mass * self.gravity * x + floor.stored,
            losses={"floor": floor.loss},
            supplies={"pull": pull * v},
        )


@dataclass(frozen=True)
class Stop(Component):
    """A cart before an elastic buffer, that pushes back with `sign` = -1 and attracts with +1."""

    sign: float = quantity(-1.0, "1")
    damping: float = quantity(0.0, "N s/m", at_least=0)

    def equations(self, signal):
        x, v = state("cart.position", "m"), state("cart.speed", "m/s")
        buffer = UnilateralContact("buffer", x - 0.1, v, stiffness=1e4, damping=self.damping)
        return Equations(flow={x: v, v: (self.sign * buffer.force - 3.0 * x) / 2.0}, elements=[buffer])


@pytest.mark.parametrize("damping", [0.0, 20.0])
def test_an_elastic_contact_that_attracts_is_refused(damping):
    with pytest.raises(SceneError, match="The force of `buffer` must act against its closure"):
        compose(Stop(sign=1.0, damping=damping))
    # the twin with the right sign throws the cart back: without damping as fast as it came
    run = simulate(compose(Stop(damping=damping)), 0.2, start={"cart.speed": 2.0}, accuracy=1e-10)
    assert run["cart.speed"].min() < (-1.0 if damping else -1.9)
    with pytest.raises(SceneError, match="act against its closure"):  # another number is checked like the declared one
        compose(Stop(sign=0.5, damping=damping))
    compose(Stop(sign=0.0, damping=damping))  # a contact that does nothing to its gap decides nothing


def test_a_rigid_bounce_keeps_restitution_times_the_speed_and_comes_to_rest_in_finite_time():
    run = simulate(compose(Ball(restitution=0.5)), 3.0, start={"ball.height": 1.0})
    first = np.sqrt(0.2)
    times = [event.time for event in run.events]
    theory = first * (1 + 2 * np.concatenate([[0.0], np.cumsum(0.5 ** np.arange(1, len(times)))]))
    np.testing.assert_allclose(times, theory, rtol=1e-9)
    assert {(event.before, event.after) for event in run.events[:-1]} == {("open", "open")}
    assert run.events[-1].after == "closed"
    assert run.events[-1].time == pytest.approx(3 * first, abs=1e-5)  # the geometric series, cut off where it can no longer be resolved
    assert run.at(2.0)["ball.speed"] == 0.0
    assert run.at(2.0)["floor.force"] == pytest.approx(20.0, rel=1e-12)
    assert run["ball.height"].min() > -1e-12
    assert run.error_estimate < 1e-5


@pytest.mark.parametrize("restitution", [0.0, 0.3, 0.9, 1.0])
def test_each_impact_takes_the_share_of_kinetic_energy_that_restitution_says(restitution):
    run = simulate(compose(Ball(restitution=restitution)), 0.6, start={"ball.height": 1.0})
    audit = energy_audit(run)
    assert audit.impacts == pytest.approx((1 - restitution**2) * 20.0, rel=1e-9, abs=1e-9)
    assert audit.relative < 1e-9


def test_an_elastic_bounce_agrees_with_its_closed_form():
    stiffness, v0 = 1e4, np.sqrt(20.0)
    run = simulate(compose(Ball(stiffness=stiffness)), 0.6, start={"ball.height": 1.0}, accuracy=1e-9)
    closed, opened = run.events
    w = np.sqrt(stiffness / 2)
    assert (closed.after, opened.after) == ("closed", "open")
    # m x'' = -m g - k x from x = 0, v = -v0: half a swing about the static sag and what lies above it
    assert opened.time - closed.time == pytest.approx((np.pi + 2 * np.arctan(10.0 / (w * v0))) / w, rel=1e-8)
    assert run.at(opened.time)["ball.speed"] == pytest.approx(v0, rel=1e-8)
    assert energy_audit(run).relative < 1e-9


def test_a_damped_contact_opens_at_zero_force_and_loses_what_its_spring_still_held():
    run = simulate(compose(Ball(stiffness=1e4, damping=50.0)), 5.0, start={"ball.height": 1.0}, accuracy=1e-9)
    inside = run["floor.force"]
    assert inside.min() >= -1e-9 * inside.max()
    opened = next(event.time for event in run.events if event.after == "open")
    before = run.at(np.nextafter(opened, 0.0))
    assert before["floor.force"] == pytest.approx(0.0, abs=1e-6 * inside.max())
    assert before["ball.height"] < -1e-4  # the spring is still compressed
    audit = energy_audit(run)
    assert audit.impacts == pytest.approx(
        sum(0.5e4 * run.at(e.time)["ball.height"] ** 2 for e in run.events if e.after == "open"), rel=1e-6
    )
    assert audit.relative < 1e-9
    assert run["ball.height"][-1] == pytest.approx(-20.0 / 1e4, rel=1e-5)


@dataclass(frozen=True)
class Flyer(Component):
    """A mass that flies against a wall of Hunt and Crossley, N = k d (1 + c d'), whose damping is an expression of the closure."""

    mass: float = quantity(2.0, "kg", above=0)
    stiffness: float = quantity(1e4, "N/m", above=0)
    damping: float = quantity(0.5, "s/m", at_least=0)

    def equations(self, signal):
        x, v = state("flyer.position", "m"), state("flyer.speed", "m/s")
        wall = UnilateralContact("wall", x, v, stiffness=self.stiffness, damping=self.damping * self.stiffness * x)
        kinetic = self.mass * v**2 / 2
        return Equations(flow={x: v, v: -wall.force / self.mass}, elements=[wall], stored=kinetic + wall.stored, losses={"wall": wall.loss})


@pytest.mark.parametrize("damping", [0.0, 0.5])
def test_a_wall_of_hunt_and_crossley_gives_back_the_speed_of_its_closed_form(damping):
    # m v dv/dd = -k d (1 + c v): v/c - ln(1 + c v)/c^2 is a function of d^2 alone, and the same before and after
    run = simulate(compose(Flyer(damping=damping)), 0.5, start={"flyer.position": -0.1, "flyer.speed": 2.0}, accuracy=1e-9)
    back = -run["flyer.speed"][-1]

    def kept(v):
        return damping * v - np.log1p(damping * v)

    expected = brentq(lambda v: kept(-v) - kept(2.0), 1e-6, 1.99) if damping else 2.0
    assert back == pytest.approx(expected, rel=1e-7)
    assert [event.after for event in run.events] == ["closed", "open"]
    assert energy_audit(run).relative < 1e-7


def test_stiff_contacts_tend_to_the_rigid_one():
    rigid = simulate(compose(Ball(restitution=1.0)), 1.2, start={"ball.height": 1.0})
    gaps = []
    for stiffness in (1e6, 1e8, 1e10):
        run = simulate(compose(Ball(stiffness=stiffness)), 1.2, start={"ball.height": 1.0}, accuracy=1e-9)
        gaps.append(abs(run.at(1.2)["ball.height"] - rigid.at(1.2)["ball.height"]))
    assert gaps[0] > 5 * gaps[1] > 25 * gaps[2]


@pytest.mark.parametrize("law", [{"restitution": 0.4}, {"stiffness": 1e5, "damping": 100.0}])
def test_contact_lost_by_a_pull_returns_when_the_pull_ends(law):
    pull = ([0.0, 1.0, 1.0, 1.5, 1.5], [0.0, 0.0, 30.0, 30.0, 0.0])  # 1.5 times the weight for half a second
    run = simulate(compose(Ball(**law)), 6.0, inputs={"ball.force": pull}, accuracy=1e-8)
    assert run.modes["floor"][0] == "closed"
    lifted = next(event.time for event in run.events if event.after == "open" and event.time > 0.5)
    assert lifted == pytest.approx(1.0, abs=1e-2 if "stiffness" in law else 0.0)
    assert run["ball.height"].max() > 0.5
    assert run.modes["floor"][-1] == "closed"
    assert energy_audit(run).relative < 1e-8


def test_a_body_between_two_rigid_stops_crosses_its_gap_slower_by_the_restitution_every_time():
    """Free flight over a gap of 2 w: impact n at w / v + sum_(k=1)^(n-1) 2 w / (e^k v), speed e^n v behind it."""

    @dataclass(frozen=True)
    class Rattle(Component):
        gap: float = quantity(0.25, "m", "half of the gap w")
        restitution: float = quantity(0.8, "1")

        def equations(self, signal):
            x, v = state("body.position", "m"), state("body.speed", "m/s")
            left = UnilateralContact("left", -x - self.gap, -v, restitution=self.restitution)
            right = UnilateralContact("right", x - self.gap, v, restitution=self.restitution)
            return Equations(flow={x: v, v: left.force - right.force + signal("body.force", "N", default=0.0)}, elements=[left, right])

    plant = compose(Rattle())
    run = simulate(plant, 10.0, start={"body.speed": 1.0})
    times = 0.25 + 0.5 * np.concatenate([[0.0], np.cumsum(0.8 ** -np.arange(1.0, 20.0))])
    times = times[times < 10.0]
    np.testing.assert_allclose([event.time for event in run.events], times, rtol=1e-9)
    assert [event.element for event in run.events] == (["right", "left"] * 10)[: len(times)]
    assert abs(run["body.speed"][-1]) == pytest.approx(0.8 ** len(times), rel=1e-9)
    soft = {"body.restitution": 0.3}
    pressed = simulate(plant, 10.0, start={"body.speed": 1.0}, parameters=soft, inputs={"body.force": ([0.0, 5.0, 5.0], [1.0, 1.0, -1.0])})
    assert pressed.time_in("right", "closed") > 1.0 and pressed.time_in("left", "closed") > 1.0
    assert np.abs(pressed["body.position"]).max() < 0.25 + 1e-12


def test_a_slow_pull_opens_a_rigid_contact_where_it_equals_the_weight():
    run = simulate(compose(Ball(restitution=0.0)), 3.0, inputs={"ball.force": ([0.0, 3.0], [0.0, 30.0])})
    (event,) = run.events
    assert event.time == pytest.approx(2.0, rel=1e-12)
    assert (event.before, event.after) == ("closed", "open")


def test_a_start_inside_a_rigid_wall_is_an_error_and_inside_an_elastic_one_is_not():
    with pytest.raises(SimulationError, match="`floor` must be <= 0 at the start"):
        simulate(compose(Ball(restitution=0.5)), 1.0, start={"ball.height": -0.1})
    run = simulate(compose(Ball(stiffness=1e3)), 1.0, start={"ball.height": -0.1})
    assert run.modes["floor"][0] == "closed"


def test_a_contact_needs_one_law_and_a_rate_that_is_its_derivative():
    for given in ({}, {"restitution": 0.1, "stiffness": 1.0}):
        with pytest.raises(SceneError, match="either a `stiffness`"):
            compose(Ball(**given))

    @dataclass(frozen=True)
    class Wrong(Component):
        def equations(self, signal):
            x, v = state("ball.height", "m"), state("ball.speed", "m/s")
            floor = UnilateralContact("floor", -x, v, restitution=0.5)
            return Equations(flow={x: v, v: floor.force - 10.0}, elements=[floor])

    with pytest.raises(SceneError, match="derivative of its closure|oppose its slip"):
        compose(Wrong())


@dataclass(frozen=True)
class Disc(Component):
    """A disc of mass m and inertia I in the plane, falling on a rough floor: impact with friction."""

    mass: float = quantity(1.0, "kg", above=0)
    inertia: float = quantity(0.5, "kg m2", above=0)
    radius: float = quantity(1.0, "m", above=0)
    gravity: float = quantity(10.0, "m/s2")
    restitution: float | None = quantity(None, "1", at_least=0, at_most=1)
    stiffness: float | None = quantity(None, "N/m", above=0)
    eccentricity: float = quantity(0.0, "m")
    friction: FrictionLaw = Coulomb(static=0.3, kinetic=0.3)

    def equations(self, signal):
        # a, b: position of the centre of mass; the geometric centre lies at the eccentricity from it along the angle c
        a, b, c = state("disc.along", "m"), state("disc.height", "m"), state("disc.angle", "rad")
        u, v, w = state("disc.u", "m/s"), state("disc.v", "m/s"), state("disc.spin", "rad/s")
        e, r = self.eccentricity, self.radius
        closure = r - b - e * ca.sin(c)
        rate = -v - e * w * ca.cos(c)
        floor = UnilateralContact("floor", closure, rate, stiffness=self.stiffness, restitution=self.restitution)
        slide = u + (r - 0.0) * w - e * w * ca.sin(c)
        rub = DryFriction("rub", slide, self.friction, load=floor.force)
        moment = floor.force * e * ca.cos(c) + rub.force * (r - e * ca.sin(c))
        return Equations(
            flow={a: u, b: v, c: w, u: rub.force / self.mass, v: floor.force / self.mass - self.gravity, w: moment / self.inertia},
            elements=[floor, rub],
            stored=self.mass * (u**2 + v**2) / 2 + self.inertia * w**2 / 2 + self.mass * self.gravity * b + floor.stored,
            losses={"rub": -rub.force * slide, "floor": floor.loss},
        )


@pytest.mark.parametrize("u0", [0.5, 4.0])
def test_an_impact_with_friction_gives_the_coulomb_impulse(u0):
    run = simulate(compose(Disc(restitution=0.6)), 1.0, start={"disc.height": 1.0 + 0.2, "disc.u": u0})
    v = np.sqrt(2 * 10.0 * 0.2)
    after = run.at(run.events[0].time)
    normal = 1.6 * v
    stick = u0 / (1 / 1.0 + 1.0 / 0.5)  # the impulse that stops the slip
    tangential = min(stick, 0.3 * normal)
    assert (tangential < stick) == (u0 == 4.0)
    assert after["disc.v"] == pytest.approx(0.6 * v, rel=1e-9)
    assert after["disc.u"] == pytest.approx(u0 - tangential, rel=1e-9)
    assert after["disc.spin"] == pytest.approx(-tangential / 0.5, rel=1e-9)


@pytest.mark.parametrize("law", [Coulomb(static=0.1, kinetic=0.1), Exponential(static=0.12, kinetic=0.08, decay=50.0)])
def test_the_impulses_of_an_impact_stay_in_the_friction_cone_also_where_the_normal_one_turns_the_slip_or_holding_would_pull(law):
    plant = compose(Disc(restitution=0.6, eccentricity=0.5, friction=law))
    random = np.random.default_rng(7)
    seen = {"stick": 0, "slip on": 0, "turned": 0, "holding would pull": 0}
    for k in range(90):
        angle, e, inertia = random.uniform(-3, 3), random.uniform(0.2, 0.9), 10 ** random.uniform(-1.5, 0)
        slip, restitution = random.normal() * (0.3, 1.0, 10.0)[k % 3], 0.3 * random.random()
        arms = np.array(
            [e * np.cos(angle), 1.0 - e * np.sin(angle)]
        )  # of the normal and of the tangential impulse about the centre of mass
        gain = np.eye(2) + np.outer(arms, arms) / inertia
        static, kinetic = (0.1, 0.1) if isinstance(law, Coulomb) else (0.12, 0.08 + 0.04 * np.exp(-50.0 * abs(slip)))
        # Newton's restitution with stick, slip+ or slip-: the one that agrees with the slip that it leaves
        held = np.linalg.solve(gain, [1 + restitution, -slip])
        found = {"stick": held} if abs(held[1]) <= static * held[0] else {}
        for way in (1.0, -1.0) if not found else ():
            normal = (1 + restitution) / (gain[0] @ [1.0, -way * kinetic])
            impulse = normal * np.array([1.0, -way * kinetic])
            if normal > 0 and way * (slip + gain[1] @ impulse) > 0:
                found["turned" if way * slip < 0 else "holding would pull" if held[0] < 0 else "slip on"] = impulse
        [(way, impulse)] = found.items()
        if impulse @ (np.array([-2.0, 2 * slip]) + gain @ impulse) > 0.0:
            continue  # it would add energy: the impact is plastic
        start = {"disc.height": 1.0 - e * np.sin(angle) + 1e-9, "disc.angle": angle, "disc.u": slip, "disc.v": -1.0}
        numbers = {"disc.restitution": restitution, "disc.eccentricity": e, "disc.inertia": inertia}
        run = simulate(plant, 1e-7, start=start, parameters=numbers, accuracy=1e-9)
        expected = [slip + impulse[1], -1.0 + impulse[0], arms @ impulse / inertia]
        assert [run["disc.u"][-1], run["disc.v"][-1], run["disc.spin"][-1]] == pytest.approx(expected, rel=1e-5, abs=1e-5), way
        seen[way] += 1
    assert min(seen.values()) >= 5


@dataclass(frozen=True)
class Rod(Component):
    """A slender rod of 1 m and 1 kg whose lower end, left of its centre, slides on rough ground."""

    friction: float = quantity(1.0, "1")
    restitution: float | None = quantity(None, "1")
    stiffness: float | None = quantity(None, "N/m")
    feed: float = quantity(0.0, "N s/m", "of what keeps the speed of its centre")
    speed: float = quantity(0.0, "m/s", "at which that holds it")

    def equations(self, signal):
        x, y, angle = state("rod.x", "m"), state("rod.y", "m"), state("rod.angle", "rad")
        u, v, w = state("rod.u", "m/s"), state("rod.v", "m/s"), state("rod.spin", "rad/s")
        across, along = 0.5 * ca.cos(angle), 0.5 * ca.sin(angle)
        tip = UnilateralContact(
            "tip",
            along - y,
            across * w - v,
            stiffness=self.stiffness,
            restitution=self.restitution,
            damping=0.0 if self.stiffness is None else 10.0,
        )
        rub = DryFriction("rub", u + along * w, Coulomb(static=self.friction, kinetic=self.friction), load=tip.force)
        moment = along * rub.force - across * tip.force
        return Equations(
            flow={x: u, y: v, angle: w, u: rub.force + self.feed * (self.speed - u), v: tip.force - 9.81, w: 12.0 * moment},
            elements=[tip, rub],
        )


@pytest.mark.parametrize(
    ("numbers", "angle", "speed", "spin"),
    [
        ({"friction": 1.86525}, 0.555349, -4.567553, 2.961023),
        ({"friction": 2.03214, "feed": 50.0, "speed": -2.32198}, 0.350625, -1.765102, 1.660099),
        ({"friction": 2.08472, "feed": 50.0, "speed": -2.20907}, 0.678772, 0.661492, 2.488907),
    ],
    ids=["into it", "about to slip", "at break-away"],
)
def test_a_rod_that_jams_on_its_way_is_told_that_it_jams(numbers, angle, speed, spin):
    start = {"rod.angle": angle, "rod.y": 0.5 * np.sin(angle), "rod.u": speed, "rod.v": 0.5 * np.cos(angle) * spin, "rod.spin": spin}
    # the force grows without bound there: whether the step, the switches or the modes come to their end first is round-off, the cause is not
    with pytest.raises(
        SimulationError, match=r": the machine jams .Painleve's paradox.\. .* rigid contact `tip` .* with a `stiffness` it has one"
    ) as failed:
        simulate(compose(Rod(restitution=0.0, **numbers)), 2.0, start=start)
    assert "accuracy" not in str(failed.value)
    # the factor of the ground's force (see below), with the sign of the friction of a tip that slides, or would, to the left
    end = failed.value.run["rod.angle"][-1]
    assert 1 + 3 * np.cos(end) * (np.cos(end) - numbers["friction"] * np.sin(end)) < 1e-6


def test_a_sliding_slender_rod_meets_the_paradox_of_painleve_beyond_friction_of_four_thirds():
    # the ground's force on the sliding tip has the factor 1 + 3 cos a (cos a - mu sin a), which is never below 0 up to mu = 4/3, reached at tan a = 2
    angle = np.arctan(2.0)
    start = {"rod.angle": angle, "rod.y": 0.5 * np.sin(angle), "rod.u": -1.0}
    rigid = compose(Rod(restitution=0.0))
    run = simulate(rigid, 1e-6, start=start, parameters={"rod.friction": (mu := 4 / 3 - 1e-3)})
    factor = 1 + 3 * np.cos(angle) * (np.cos(angle) - mu * np.sin(angle))
    assert run["tip.force"][0] == pytest.approx(9.81 / factor, rel=1e-9)
    with pytest.raises(SimulationError, match="rigid contact `tip` agrees with this slip .Painleve's paradox.; with a `stiffness`"):
        simulate(rigid, 1e-6, start=start, parameters={"rod.friction": 4 / 3 + 1e-3})
    # an elastic tip catches itself: it jams, and is thrown off
    elastic = simulate(compose(Rod(friction=1.5, stiffness=1e6)), 0.05, start=start)
    assert elastic["tip.force"].max() > 10.0 * 9.81 and elastic.modes["tip"][-1] == "open"


@pytest.mark.parametrize(("stiffness", "height"), [(1e6, 1e-6), (1e8, 0.0)])
def test_an_elastic_tip_that_lets_go_where_it_hardly_presses_takes_no_steps_below_what_its_slip_resolves(stiffness, height):
    # the slip has just begun: relative to its size so far, the round-off of the speeds that cancel in it is an error that no shorter step removes
    start = {"rod.angle": 0.1, "rod.y": 0.5 * np.sin(0.1) + height}
    method = EventExact(budget=Budget(steps=5000))
    run = simulate(compose(Rod(friction=0.3, stiffness=stiffness)), 0.3, start=start, method=method)
    assert sum(run.steps) < 3000 and run.time_in("rub", "slip+") > 0.0
    assert run.error_estimate < 1e-6


def test_a_thrown_disc_ends_rolling_without_slip():
    run = simulate(compose(Disc(restitution=0.6)), 30.0, start={"disc.height": 1.5, "disc.u": 4.0})
    assert run.modes["floor"][-1] == "closed"
    assert run.modes["rub"][-1] == "stick"
    # about a point of the floor angular momentum is conserved: m r u - I w with u = -r w at the end
    assert run["disc.u"][-1] == pytest.approx(4.0 / (1 + 0.5), rel=1e-6)
    assert energy_audit(run).relative < 1e-6
    twin = simulate(
        compose(Disc(restitution=0.6, friction=Coulomb(static=0.0, kinetic=0.0))), 30.0, start={"disc.height": 1.5, "disc.u": 4.0}
    )
    assert twin["disc.u"][-1] == pytest.approx(4.0, rel=1e-12)  # without friction nothing makes it roll


def test_impacts_never_add_energy_whatever_the_geometry():
    plant = compose(Disc(restitution=0.6, eccentricity=0.5))
    random = np.random.default_rng(5)
    taken, worst = [], 0.0
    for _ in range(150):
        speed = {f"disc.{name}": random.normal() * 3 for name in ("u", "v", "spin")}
        numbers = {
            "disc.restitution": random.random(), "disc.eccentricity": 0.9 * random.random(), "disc.inertia": 10 ** random.uniform(-1.5, 1),
            "rub.friction.static": (mu := 3 * random.random()), "rub.friction.kinetic": mu,
        }  # fmt: skip
        start = {"disc.height": 2.2, "disc.angle": random.uniform(-3, 3)} | speed
        run = simulate(plant, 2.0, start=start, parameters=numbers, accuracy=1e-7)
        speeds = run["disc.u"] ** 2 + run["disc.v"] ** 2 + numbers["disc.inertia"] * run["disc.spin"] ** 2
        energy = speeds / 2 + 10.0 * run["disc.height"]
        jump = np.flatnonzero(np.diff(run.time) == 0.0)
        growth = energy[jump + 1] - energy[jump]
        worst = max(worst, float(np.max(growth / energy.max(), initial=-1.0)))
        taken += list(-growth)
        assert run["floor.closure"].max() < run.accuracy
    assert len(taken) > 300
    assert worst < 1e-10


def test_friction_sticks_flies_and_returns_with_its_elastic_contact():
    run = simulate(compose(Disc(stiffness=1e4)), 20.0, start={"disc.height": 1.3, "disc.u": 1.0}, accuracy=1e-8)
    flying = run.modes["floor"] == "open"
    assert np.all(run["rub.force"][flying] == 0.0)
    assert np.all(np.abs(run["rub.force"][~flying]) <= 0.3 * run["floor.force"][~flying] + 1e-9)
    assert energy_audit(run).relative < 1e-8


def test_two_balls_on_top_of_each_other_pass_the_impulse_on():
    @dataclass(frozen=True)
    class Pair(Component):
        light: float = quantity(1.0, "kg", above=0)
        heavy: float = quantity(3.0, "kg", above=0)

        def equations(self, signal):
            x, v = state("pair.x", "m", 2), state("pair.v", "m/s", 2)
            hit = UnilateralContact("hit", x[0] - x[1], v[0] - v[1], restitution=1.0)
            return Equations(flow={x: v, v: ca.vertcat(-hit.force / self.light, hit.force / self.heavy)}, elements=[hit])

    run = simulate(compose(Pair()), 2.0, start={"pair.x": [0.0, 1.0], "pair.v": [2.0, 0.0]})
    assert run.events[0].time == pytest.approx(0.5, rel=1e-12)
    np.testing.assert_allclose(run["pair.v"][-1], [2 * (1 - 3) / 4, 2 * 2 / 4], rtol=1e-12)  # elastic collision of two masses


def test_a_ball_on_a_shaking_table_follows_the_impact_map():
    @dataclass(frozen=True)
    class Shaken(Component):
        amplitude: float = quantity(0.01, "m")
        frequency: float = quantity(40.0, "rad/s")

        def equations(self, signal):
            from toolbox import time

            x, v = state("ball.height", "m"), state("ball.speed", "m/s")
            table, speed = self.amplitude * ca.sin(self.frequency * time), self.amplitude * self.frequency * ca.cos(self.frequency * time)
            floor = UnilateralContact("table", table - x, speed - v, restitution=0.5)
            return Equations(flow={x: v, v: floor.force - 9.81}, elements=[floor])

    run = simulate(compose(Shaken()), 1.2, start={"ball.height": 0.03}, accuracy=1e-9)
    t, x, v, times = 0.0, 0.03, 0.0, []
    while len(times) < 6:

        def gap(s, t=t, x=x, v=v):
            return x + v * (s - t) - 9.81 * (s - t) ** 2 / 2 - 0.01 * np.sin(40 * s)

        grid = t + 1e-4 + np.linspace(0, 0.4, 4001)
        k = np.flatnonzero(gap(grid) < 0)[0]
        hit = brentq(gap, grid[k - 1], grid[k], xtol=1e-14)
        down, table = v - 9.81 * (hit - t), 0.4 * np.cos(40 * hit)
        t, x, v = hit, 0.01 * np.sin(40 * hit), table - 0.5 * (down - table)
        times.append(hit)
    np.testing.assert_allclose([event.time for event in run.events[:6]], times, rtol=1e-7)


@pytest.mark.parametrize("accuracy", [1e-6, 1e-7, 1e-8, 1e-10])
@pytest.mark.parametrize(("restitution", "lift"), [(0.3, 1.02), (0.5, 1.05), (0.9, 1.1)])
def test_a_body_leaves_a_shaking_table_where_its_acceleration_reaches_gravity_and_settles_on_it_again(restitution, lift, accuracy):
    @dataclass(frozen=True)
    class Shaken(Component):
        amplitude: float = quantity(0.025, "m")

        def equations(self, signal):
            from toolbox import time

            x, v = state("ball.height", "m"), state("ball.speed", "m/s")
            table, speed = self.amplitude * ca.sin(20 * time), 20 * self.amplitude * ca.cos(20 * time)
            floor = UnilateralContact("table", table - x, speed - v, restitution=restitution)
            return Equations(flow={x: v, v: floor.force - 10.0}, elements=[floor])

    amplitude = lift * 10.0 / 20**2
    plant = compose(Shaken(amplitude))
    run = simulate(plant, 2.0, start={"ball.speed": 20 * amplitude}, accuracy=accuracy)
    left = [event.time for event in run.events if event.before == "closed"]
    turns = np.round((np.array(left) * 20 - np.arcsin(1 / lift)) / (2 * np.pi))
    np.testing.assert_allclose(left, (np.arcsin(1 / lift) + 2 * np.pi * turns) / 20, rtol=1e-9)
    assert len(left) >= 2
    gap = run["ball.height"] - amplitude * np.sin(20 * run.time)
    assert gap.min() > -1e-12
    calm = simulate(compose(Shaken(0.999 * 10.0 / 20**2)), 2.0, start={"ball.speed": 0.999 * 10.0 / 20}, accuracy=accuracy)
    assert calm.events == []


def test_a_body_leaves_a_wall_where_the_force_that_presses_it_ends_from_whichever_side_round_off_finds_that():
    """x'' = f - N with f = sin(2 t + phase) from x = 0: free from 2 t + phase = pi on, x = -(sin(2 t + phase) / 4 + (t - release) / 2)."""

    @dataclass(frozen=True)
    class Pressed(Component):
        def equations(self, signal):
            x, v = state("body.position", "m"), state("body.speed", "m/s")
            wall = UnilateralContact("wall", x, v, restitution=0.5)
            return Equations(flow={x: v, v: signal("body.force", "N", default=0.0) - wall.force}, elements=[wall])

    plant = compose(Pressed())
    for phase in np.linspace(0.01, 3.1, 60):
        run = simulate(plant, 3.0, inputs={"body.force": sine(0.0, 1.0, 1 / np.pi, phase)})
        release = (np.pi - phase) / 2
        (event,) = run.events
        assert (event.before, event.after) == ("closed", "open")
        assert event.time == pytest.approx(release, rel=1e-9)
        assert run["body.position"][-1] == pytest.approx(-(np.sin(6.0 + phase) / 4 + (3.0 - release) / 2), rel=1e-6)


@dataclass(frozen=True)
class Heated(Component):
    """A room with a two-position heater: T' = (q - (T - outside)) / tau."""

    low: float = quantity(19.0, "K")
    high: float = quantity(21.0, "K")
    start: str = "low"

    def equations(self, signal):
        temperature = state("room.temperature", "K")
        off = Hysteresis("thermostat", temperature, self.low, self.high, start=self.start, signal_unit="K")
        return Equations(flow={temperature: (30.0 * (1 - off.output) - temperature) / 10.0}, elements=[off])


def test_hysteresis_switches_at_its_two_thresholds_with_the_period_of_the_closed_form():
    run = simulate(compose(Heated()), 100.0, start={"room.temperature": 20.0})
    times = np.array([event.time for event in run.events])
    np.testing.assert_allclose(run.at(times)["room.temperature"], np.where(np.arange(times.size) % 2, 19.0, 21.0), rtol=1e-9)
    period = 10 * np.log(11 / 9) + 10 * np.log(21 / 19)
    np.testing.assert_allclose(np.diff(times[::2]), period, rtol=1e-6)
    assert [event.after for event in run.events[:2]] == ["high", "low"]


def test_hysteresis_between_its_thresholds_starts_as_declared_and_outside_as_it_must():
    for start, temperature, mode in [("low", 20.0, "low"), ("high", 20.0, "high"), ("low", 22.0, "high"), ("high", 18.0, "low")]:
        run = simulate(compose(Heated(start=start)), 0.01, start={"room.temperature": temperature})
        assert run.modes["thermostat"][0] == mode
    with pytest.raises(SceneError, match="low or high"):
        compose(Heated(start="off"))


def test_a_switch_that_both_sides_lead_back_to_is_reported_as_endless():
    with pytest.raises(ZenoError, match="thermostat"):
        simulate(compose(Heated(low=20.0, high=20.0)), 10.0, start={"room.temperature": 18.0})


def test_a_law_that_jumps_switches_exactly_at_its_break():
    run = simulate(
        compose(BlockOnBelt(stiffness=0.0, belt_speed=3.0, friction=StepFriction(static=1.0, kinetic=0.5, drop_speed=1.5))),
        3.0,
        start={"block.speed": 0.0},
    )
    # slip -3, friction +0.5 until |slip| = 1.5 after 3 s / 1 = 3 s
    assert run.modes["belt.break"][0] == "beyond"
    run = simulate(compose(BlockOnBelt(stiffness=0.0, belt_speed=3.0, friction=StepFriction(static=1.0, kinetic=0.5, drop_speed=1.5))), 6.0)
    assert [(e.element, e.before, e.after) for e in run.events] == [("belt.break", "beyond", "below"), ("belt", "slip-", "stick")]
    assert run.events[0].time == pytest.approx(3.0, rel=1e-10)
    assert run.events[1].time == pytest.approx(4.5, rel=1e-10)


def test_a_law_that_jumps_agrees_with_scipy_stopped_at_every_switch():
    plant = compose(BlockOnBelt(belt_speed=1.0, friction=StepFriction(static=2.0, kinetic=0.8, drop_speed=1.5)))
    run = simulate(plant, 20.0, start={"block.position": 3.0}, accuracy=1e-9)
    assert {e.element for e in run.events} == {"belt", "belt.break"}
    x, t = np.array([3.0, 0.0]), 0.0
    for event in [*run.events, None]:
        end = 20.0 if event is None else event.time
        middle = run.at(0.5 * (t + end))
        force = float(middle["belt.force"])
        stuck = middle.modes["belt"][0] == "stick"
        slope = (lambda t, y: [1.0, 0.0]) if stuck else (lambda t, y, f=force: [y[1], -y[0] + f])
        x = solve_ivp(slope, (t, end), x, rtol=1e-12, atol=1e-12).y[:, -1]
        t = end
        if event is not None and event.element == "belt.break":
            assert abs(x[1] - 1.0) == pytest.approx(1.5, rel=1e-7)
    np.testing.assert_allclose([run["block.position"][-1], run["block.speed"][-1]], x, atol=1e-7)


def test_steady_states_and_linearisation_know_contacts():
    plant = compose(Ball(stiffness=1e4, damping=10.0))
    rest = equilibrium(plant, guess={"ball.height": -1e-3})
    assert rest.modes == {"floor": "closed"}
    assert rest["ball.height"] == pytest.approx(-20.0 / 1e4)
    linear = linearise(plant, at=rest)
    np.testing.assert_allclose(
        sorted(np.linalg.eigvals(linear.A), key=np.imag), np.sort_complex(np.roots([2.0, 10.0, 1e4]))[::1], rtol=1e-9
    )
    free = linearise(plant, at={"ball.height": 1.0})
    np.testing.assert_allclose(free.A, [[0, 1], [0, 0]], atol=0)


def test_events_of_contacts_fall_on_output_and_sample_times_without_harm():
    times = np.linspace(0, 3, 301)
    dense = simulate(compose(Ball(restitution=0.7)), 3.0, start={"ball.height": 0.05})
    coarse = simulate(compose(Ball(restitution=0.7)), 3.0, start={"ball.height": 0.05}, output_times=times)
    np.testing.assert_allclose(coarse["ball.height"], dense.at(times)["ball.height"], atol=1e-9)
