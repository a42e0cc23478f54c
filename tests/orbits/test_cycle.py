"""Periodic motions and their branches against closed forms, independent differences and what the machine does when left alone."""

from __future__ import annotations

import cmath
import dataclasses
import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from controllers import SoftTorque, StiffPI
from models import BitRock, Block, BlockOnBelt, Coulomb, TwoDisks, oscillators, wells
from studies.questions import cycles
from tests.plants import RIG
from tests.refusals import each_of, refusals
from toolbox import (
    Component,
    DryFriction,
    Equations,
    SceneError,
    UnilateralContact,
    closed_loop,
    compose,
    equilibrium,
    follow,
    limit_cycle,
    linearise,
    quantity,
    simulate,
    state,
    time,
)
from toolbox.inputs import sine, step
from toolbox.modelling import Hysteresis
from toolbox.orbits import CycleError
from toolbox.orbits.arclength import ArcWalk
from toolbox.orbits.sensitivity import placed
from toolbox.steady_states import pole_locus


@pytest.mark.parametrize("z", [0.1, 1.0, 8.0])
def test_a_block_on_a_belt_with_constant_kinetic_friction_has_the_period_of_the_closed_form(z):
    # z = (F_s - F_k) w / (k v);  t_slip = (2 / w)(pi - arctan z);  t_stick = 2 z / w; once it sticks it has forgotten how it got there
    mass, stiffness, belt = 1.7, 4.3, 0.6
    w = math.sqrt(stiffness / mass)
    plant = compose(
        BlockOnBelt(mass=mass, stiffness=stiffness, belt_speed=belt, friction=Coulomb(static=0.5 + z * stiffness * belt / w, kinetic=0.5))
    )
    cycle = limit_cycle(closed_loop(plant, start={"block.speed": belt}), 60.0)
    np.testing.assert_allclose(cycle.period, 2 * (math.pi - math.atan(z)) / w + 2 * z / w, rtol=1e-10)
    np.testing.assert_allclose(cycle.stick_share("belt"), 2 * z / w / cycle.period, rtol=1e-9)
    np.testing.assert_allclose(cycle.multipliers, [0.0], atol=1e-9)
    assert cycle.stable
    assert not cycle.forced


def test_a_branch_goes_on_where_the_start_of_its_cycle_has_come_near_a_switch_and_is_moved():
    kinetic, belt = 0.6, 0.1
    cycle = limit_cycle(compose(BlockOnBelt(friction=Coulomb(static=1.0, kinetic=kinetic), belt_speed=belt)), 300.0)
    branch = follow(cycle, "belt.friction.static", (0.65, 2.5), points=200, step=0.1)
    assert (np.diff(branch.values) > 0.0).all() and branch.stop_reason == "the end of the span at 2.5"
    z = (np.array(branch.values) - kinetic) / belt  # the closed form above at w = k = 1
    np.testing.assert_allclose(branch.periods, 2 * (math.pi - np.arctan(z)) + 2 * z, rtol=1e-8)
    begins = np.array([point.start for point in branch.cycles])
    assert np.linalg.norm(np.diff(begins, axis=0), axis=1).max() > 1.0  # once at least it was moved, by more than a step leads


def test_newtons_steps_that_grow_more_than_threefold_are_given_up_after_the_fourth(monkeypatch):
    cycle = limit_cycle(compose(BlockOnBelt(friction=Coulomb(static=1.0, kinetic=0.6))), 300.0)
    free = cycle.run.run.loop.differentiable_number("block.belt_speed", "follow")
    walk = ArcWalk(dataclasses.replace(cycle, run=placed(cycle.run, [free])), free, (0.01, 3.0))
    shots, matrix, shot = [], ArcWalk._matrix, ArcWalk._shot
    monkeypatch.setattr(ArcWalk, "_shot", lambda self, u: shots.append(u) or shot(self, u))
    guess = walk.here.u + 1e-4 * np.eye(walk.here.u.size)[0]
    found = walk._corrected(guess, None, None)
    assert found.u == pytest.approx(walk.here.u, abs=1e-9) and len(shots) <= 3
    # slopes of the wrong sign and five times too flat: what is left is six times as much after every step
    monkeypatch.setattr(ArcWalk, "_matrix", lambda self, *given: -0.2 * matrix(self, *given))
    shots.clear()
    assert walk._corrected(guess, None, None) is None and len(shots) == 4


def test_a_run_of_thousands_of_rounds_ends_in_one_round_and_not_in_four():
    # slip by 2 pi - 2 atan(1), stick by 2, where the kinetic swing and the belt are as fast as each other
    block = compose(BlockOnBelt(friction=Coulomb(static=0.6, kinetic=0.4)))
    assert limit_cycle(block, 50_000.0).period == pytest.approx(1.5 * math.pi + 2.0, rel=1e-12)


def test_a_stator_under_a_driven_rotor_has_the_period_of_the_closed_form():
    inertia, stiffness, drive, load, radius, z = 0.02, 2000.0, 2.0, 1000.0, 0.1, 1.0
    w = math.sqrt(stiffness / inertia)
    static = 0.3 + z * stiffness * drive / w / (load * radius)
    plant = compose(
        TwoDisks(rotor_inertia=1e13, damping=0.0, stator_inertia=inertia, stiffness=stiffness, normal_force=load, radius=radius,
                 friction=Coulomb(static=static, kinetic=0.3))
    )  # fmt: skip
    caught = (2 * 0.3 - static) * load * radius / stiffness
    start = {"disks.rotor_speed": drive, "disks.stator_speed": drive, "disks.stator_angle": caught}
    run = simulate(plant, 0.4, start=start, accuracy=1e-11)
    # the rotor coasts at any speed: that is the one multiplier of 1 beside that of the phase
    cycle = limit_cycle(run)
    z *= drive / cycle.start[0]
    np.testing.assert_allclose(cycle.period, (2 * math.pi / w) * (1 + (z - math.atan(z)) / math.pi), rtol=1e-9)
    np.testing.assert_allclose(np.abs(cycle.multipliers), [1.0, 0.0], atol=1e-7)


def test_a_driven_linear_oscillator_has_the_multipliers_of_its_matrix():
    mass, stiffness, damping = 2.0, 8.0, 0.5
    plant = compose(BlockOnBelt(mass=mass, stiffness=stiffness, damping=damping, load=0.0, belt_speed=50.0))
    cycle = limit_cycle(closed_loop(plant, inputs={"block.force": sine(0.3, 1.0, 0.4)}), 20.0)
    assert cycle.forced
    assert cycle.period == 1 / 0.4
    theory = [cmath.exp(root * cycle.period) for root in np.roots([mass, damping, stiffness])]
    np.testing.assert_allclose(sorted(cycle.multipliers, key=lambda v: v.imag), sorted(theory, key=lambda v: v.imag), rtol=1e-9)
    w = 2 * math.pi * 0.4
    np.testing.assert_allclose(cycle.amplitude("block.position"), 1 / abs(stiffness - mass * w**2 + 1j * damping * w), rtol=1e-6)


def test_den_hartogs_oscillator_without_stops_has_his_amplitude():
    # x0 = (P / k) sqrt(V^2 - f^2 U^2), V = 1 / (1 - r^2), U = sin(pi / r) / (r (1 + cos(pi / r)))
    for r, f in ((0.8, 0.3), (1.4, 0.25)):
        plant = compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=f, kinetic=f)))
        cycle = limit_cycle(closed_loop(plant, inputs={"block.force": sine(0.0, 1.0, r / (2 * math.pi))}), 400.0)
        assert cycle.stick_share("belt") == 0.0
        gain, drift = 1 / (1 - r**2), math.sin(math.pi / r) / (r * (1 + math.cos(math.pi / r)))
        np.testing.assert_allclose(cycle.amplitude("block.position"), math.sqrt(gain**2 - (f * drift) ** 2), rtol=1e-8)
        # between its two turns the block is a free oscillator, and each turn contracts: the area shrinks
        assert abs(np.prod(cycle.multipliers)) < 1 - 1e-3
        assert cycle.stable


@pytest.fixture(scope="module")
def drilling():
    """The cycle of Jansen's rig under its stiff drive at 95 rpm."""
    run = simulate(RIG, 120.0, controller=StiffPI(reference=95 * math.pi / 30), accuracy=1e-8)
    return limit_cycle(run)


def test_the_multipliers_of_a_drill_string_agree_with_differences(drilling):
    columns = []
    for i in range(4):
        ends = []
        for sign in (1.0, -1.0):
            x = drilling.start.copy()
            x[i] += sign * 1e-6
            start = {"chain.twist": x[:1], "chain.speed": x[1:3], "stiffpi.angle": x[3]}
            arguments = drilling.run.run
            ends.append(simulate(arguments.plant.with_parameters({}), drilling.period, start=start, accuracy=1e-13,
                                 controller=StiffPI(reference=95 * math.pi / 30)).states[-1])  # fmt: skip
        columns.append((ends[0] - ends[1]) / 2e-6)
    values = np.linalg.eigvals(np.array(columns).T)
    values = values[np.argsort(-np.abs(values))]
    np.testing.assert_allclose(values[0], 1.0, atol=1e-5)
    np.testing.assert_allclose(values[1:], drilling.multipliers, atol=1e-5)


def test_the_cycle_of_a_drill_string_is_what_a_long_run_comes_to(drilling):
    assert drilling.stable
    assert drilling.last_period_change < 1e-9
    run = simulate(drilling.run.run.plant, 300.0, controller=StiffPI(reference=95 * math.pi / 30), accuracy=1e-11)
    releases = [e.time for e in run.events if e.before == "stick"]
    np.testing.assert_allclose(releases[-1] - releases[-2], drilling.period, atol=1e-8)
    np.testing.assert_allclose(drilling.run.states[-1], drilling.start, rtol=1e-9)


@dataclass(frozen=True)
class Bautin(Component):
    """r' = r (lambda + r^2 - r^4), turning at 1 rad/s: cycles where lambda = r^4 - r^2, with multiplier exp(2 pi (2 r^2 - 4 r^4))."""

    lift: float = quantity(0.5, "1", "lambda")

    def equations(self, signal):
        x, y = state("form.x", "1"), state("form.y", "1")
        square = x**2 + y**2
        growth = self.lift + square - square**2
        return Equations(flow={x: growth * x - y, y: growth * y + x})


def test_a_branch_passes_its_fold_and_ends_at_its_hopf_point():
    cycle = limit_cycle(closed_loop(compose(Bautin()), start={"form.x": 1.0}), 30.0)
    branch = follow(cycle, next(iter(cycle.run.program.system.parameters)), (-0.4, 0.6), points=300, start_towards=-0.4)
    fold, hopf = branch.bifurcations
    assert [fold.kind, hopf.kind] == ["fold", "Hopf"]
    np.testing.assert_allclose(fold.value, -0.25, atol=1e-9)
    np.testing.assert_allclose(hopf.value, 0.0, atol=1e-12)
    np.testing.assert_allclose(branch.periods, 2 * math.pi, rtol=1e-9)
    for value, point in zip(branch.values, branch.cycles, strict=True):
        square = float(np.sum(point.start**2))
        np.testing.assert_allclose(value, square**2 - square, atol=1e-9)
        np.testing.assert_allclose(point.multipliers, [math.exp(2 * math.pi * (2 * square - 4 * square**2))], rtol=1e-7, atol=1e-12)
    assert branch.stable[0]
    assert not branch.stable[-1]


@dataclass(frozen=True)
class Duffing(Component):
    """x'' + c x' + a x + b x^3 = u."""

    damping: float = quantity(0.3, "N s/m", "c")
    linear: float = quantity(-1.0, "N/m", "a")
    cubic: float = quantity(1.0, "N/m3", "b")

    def equations(self, signal):
        x, v = state("mass.position", "m"), state("mass.speed", "m/s")
        return Equations(flow={x: v, v: signal("mass.force", "N", default=0.0) - self.damping * v - self.linear * x - self.cubic * x**3})


def test_beyond_a_period_doubling_the_motion_comes_round_only_every_second_time():
    plant = compose(Duffing())
    frequency = 1.2 / (2 * math.pi)
    cycle = limit_cycle(closed_loop(plant, inputs={"mass.force": sine(0.0, 0.2, frequency)}, start={"mass.position": 1.0}), 400.0)
    branch = follow(cycle, "mass.force.amplitude", (0.15, 0.32), points=60)
    (doubling,) = [point for point in branch.bifurcations if point.kind == "period doubling"]
    np.testing.assert_allclose(min(abs(value + 1) for value in doubling.cycle.multipliers), 0.0, atol=1e-7)
    for factor, doubled in ((0.99, False), (1.01, True)):
        start = {"mass.position": doubling.cycle.start[0], "mass.speed": doubling.cycle.start[1] + 1e-3}
        length = 1500 / frequency
        times = np.array([length - 2 / frequency, length - 1 / frequency, length])
        run = simulate(
            plant,
            length,
            start=start,
            inputs={"mass.force": sine(0.0, factor * doubling.value, frequency)},
            output_times=times,
            accuracy=1e-9,
        )
        once, twice = (np.abs(run.states[-1] - run.states[k]).max() for k in (-2, -3))
        assert twice < 1e-5
        assert (once > 1e-2) == doubled


def test_a_driven_oscillator_whose_damping_changes_sign_leaves_its_cycle_by_a_torus():
    # multipliers exp((-c +- i sqrt(4 - c^2)) T / 2): on the unit circle at c = 0
    cycle = limit_cycle(
        closed_loop(compose(Duffing(damping=0.2, linear=1.0, cubic=0.0)), inputs={"mass.force": sine(0.0, 1.0, 0.23)}), 100.0
    )
    name = next(name for name in cycle.run.program.system.parameters if name.endswith(".damping"))
    branch = follow(cycle, name, (-0.2, 0.3), points=60, start_towards=-0.2)
    (torus,) = branch.bifurcations
    assert torus.kind == "Neimark-Sacker"
    np.testing.assert_allclose(torus.value, 0.0, atol=1e-8)
    assert branch.stop_reason.startswith("the end of the span")


def test_the_frequency_of_a_drive_can_be_followed_with_its_period():
    cycle = limit_cycle(
        closed_loop(compose(Duffing(damping=0.2, linear=1.0, cubic=0.0)), inputs={"mass.force": sine(0.0, 1.0, 0.23)}), 100.0
    )
    branch = follow(cycle, "mass.force.frequency", (0.05, 0.4), points=40)
    for value, point in list(zip(branch.values, branch.cycles, strict=True))[::8]:
        w = 2 * math.pi * value
        np.testing.assert_allclose(point.amplitude("mass.position"), 1 / abs(1 - w**2 + 0.2j * w), rtol=1e-5)
        np.testing.assert_allclose(point.period, 1 / value)
        assert point.loop.number("mass.force.frequency").value == pytest.approx(value, rel=1e-12)
    assert branch.loop == branch.cycles[0].loop


def test_thomsen_and_fidlins_block_goes_from_stick_slip_through_grazing_to_sliding_and_rest():
    block = oscillators.THOMSEN_FIDLIN
    hopf = oscillators.hopf_speed(block)
    cycle = limit_cycle(closed_loop(compose(block), parameters={"block.belt_speed": 0.36}, start={"block.position": 0.4}), 300.0)
    assert cycle.stick_share("belt") > 0.05
    branch = follow(cycle, "block.belt_speed", (0.3, 0.5), points=150)
    grazing, end = branch.bifurcations
    assert [grazing.kind, end.kind] == ["grazing-sliding", "Hopf"]
    np.testing.assert_allclose(end.value, hopf, rtol=1e-10)
    np.testing.assert_allclose(grazing.value, math.sqrt(0.8) * hopf, rtol=0.01)  # averaging, to first order
    np.testing.assert_allclose(grazing.cycle.extremes("block.speed")[1], grazing.value, rtol=1e-6)  # the belt is just reached
    for value, point in zip(branch.values, branch.cycles, strict=True):
        if value > grazing.value + 1e-3:
            assert point.stick_share("belt") == 0.0
            np.testing.assert_allclose(point.amplitude("block.speed"), 2 * math.sqrt(hopf**2 - value**2), rtol=0.02, atol=2e-3)
    assert branch.stable.all()


def test_veraszto_and_stepans_block_turns_at_grazing_and_comes_back_unstable_to_its_hopf_speed():
    block = oscillators.VERASZTO_STEPAN
    cycle = limit_cycle(closed_loop(compose(block), start={"block.position": 0.002}), 10.0)
    assert cycle.stable
    assert cycle.stick_share("belt") > 0.0
    branch = follow(cycle, "block.belt_speed", (0.15, 2.0), points=300)
    kinds = [point.kind for point in branch.bifurcations]
    assert kinds == ["grazing-sliding", "Hopf"]
    np.testing.assert_allclose(branch.bifurcations[1].value, oscillators.hopf_speed(block), rtol=1e-10)
    last = branch.cycles[-1]
    assert not last.stable
    # between the two, what starts inside the unstable cycle comes to rest and what starts outside sticks and slips
    middle = next(
        c for c, v in zip(branch.cycles, branch.values, strict=True) if not c.stable and v < 0.5 * sum(p.value for p in branch.bifurcations)
    )
    x = middle.start
    rest = equilibrium(middle.run.run.plant, guess={"block.position": float(middle.run["block.position"].mean())})["block.position"]
    for factor, sticks in ((0.98, False), (1.02, True)):
        start = {"block.position": rest + factor * (x[0] - rest), "block.speed": factor * x[1]}
        run = simulate(middle.run.run.plant, 20.0, start=start)
        assert (run.time_in("belt", "stick", after=10.0) > 0) == sticks


@pytest.mark.slow
def test_a_stiff_drive_lets_a_drill_string_stick_and_slip_far_above_its_hopf_speed(drilling):
    branch = cycles.reach(drilling)
    grazing, hopf = branch.bifurcations
    assert [grazing.kind, hopf.kind] == ["grazing-sliding", "Hopf"]
    assert not branch.stable[-1]
    plant = drilling.run.run.plant
    closed = compose(*plant.parts, StiffPI(reference=hopf.value))
    rest = equilibrium(closed)
    poles = linearise(closed, at=rest).poles()
    assert abs(max(poles.real)) < 1e-4  # the steady state at the end of the branch is about to lose its stability
    assert grazing.value > 2.5 * hopf.value


def test_an_unstable_cycle_is_found_from_a_guess_of_its_start_and_period():
    # Veraszto-Stepan between Hopf and grazing: to first order a circle about the steady state, at the frequency of the free block
    block = oscillators.VERASZTO_STEPAN
    plant = compose(block)
    rest = equilibrium(plant)["block.position"]
    w = math.sqrt(block.stiffness / block.mass)
    cycle = limit_cycle(closed_loop(plant, start={"block.position": rest + 0.13 / w}), period=2 * math.pi / w)
    assert not cycle.stable
    assert cycle.stick_share("belt") == 0.0
    np.testing.assert_allclose(cycle.period, 2 * math.pi / w, rtol=1e-2)


def test_a_driven_block_with_stops_has_the_multipliers_that_differences_show():
    plant = compose(BlockOnBelt(belt_speed=0.0, damping=0.1, friction=Coulomb(static=0.6, kinetic=0.4)))
    force = {"block.force": sine(0.1, 1.0, 0.06)}
    cycle = limit_cycle(closed_loop(plant, inputs=force), 200.0)
    assert 0.05 < cycle.stick_share("belt") < 0.95
    columns = []
    for i in range(2):
        ends = []
        for sign in (1.0, -1.0):
            x = cycle.start.copy()
            x[i] += sign * 1e-6
            ends.append(
                simulate(plant, cycle.period, start={"block.position": x[0], "block.speed": x[1]}, inputs=force, accuracy=1e-13).states[-1]
            )
        columns.append((ends[0] - ends[1]) / 2e-6)
    values = np.linalg.eigvals(np.array(columns).T)
    np.testing.assert_allclose(np.sort(np.abs(cycle.multipliers)), np.sort(np.abs(values)), atol=1e-5)


@dataclass(frozen=True)
class Oven(Component):
    """w' = P s - L w, s on below `low` and off above `high`."""

    low: float = quantity(0.8, "K", "on below")
    high: float = quantity(1.2, "K", "off above")

    def equations(self, signal):
        warm = state("oven.warm", "K")
        switch = Hysteresis("switch", warm, self.low, self.high, start="high")
        return Equations(flow={warm: 2.0 * (1 - switch.output) - 0.5 * warm}, elements=[switch])


def test_an_oven_goes_round_in_the_time_of_the_closed_form():
    cycle = limit_cycle(compose(Oven()), 30.0)
    np.testing.assert_allclose(cycle.period, 2 * math.log((4 - 0.8) / (4 - 1.2)) + 2 * math.log(1.2 / 0.8), rtol=1e-10)


@dataclass(frozen=True)
class Table(Component):
    """A ball that bounces on a table a sin(w t): h'' = -g + N / m, restitution e."""

    amplitude: float = quantity(0.004, "m", "a")
    frequency: float = quantity(60.0, "rad/s", "w")
    restitution: float = quantity(0.7, "1", "e")

    def equations(self, signal):
        h, v = state("ball.height", "m"), state("ball.speed", "m/s")
        a, w = self.amplitude, self.frequency
        table = UnilateralContact("table", a * ca.sin(w * time) - h, a * w * ca.cos(w * time) - v, restitution=self.restitution)
        return Equations(flow={h: v, v: table.force - 9.81}, elements=[table])


def test_a_ball_on_a_shaking_table_doubles_its_period_where_the_closed_form_says():
    # one bounce per period: det M = e^2, trace M = 1 + e^2 - (1 + e)^2 a w^2 sin(phi) / g, a w^2 cos(phi) = pi g (1 - e) / (1 + e)
    g, e, w, a = 9.81, 0.7, 60.0, 0.0026
    period = 2 * math.pi / w
    phase = math.acos(math.pi * g * (1 - e) / (1 + e) / (a * w**2))
    flight = period - phase / w
    start = {"ball.height": a * math.sin(phase) + g * period / 2 * flight - g * flight**2 / 2, "ball.speed": g * period / 2 - g * flight}
    cycle = limit_cycle(closed_loop(compose(Table(amplitude=a)), start=start), period=period)
    trace = 1 + e**2 - (1 + e) ** 2 * a * w**2 * math.sin(phase) / g
    np.testing.assert_allclose([np.prod(cycle.multipliers), np.sum(cycle.multipliers)], [e**2, trace], rtol=1e-7)
    np.testing.assert_allclose(cycle.run.events[0].time, phase / w, rtol=1e-8)
    name = next(name for name in cycle.run.program.system.parameters if name.endswith(".amplitude"))
    branch = follow(cycle, name, (0.002, 0.008), points=60)
    doubling = branch.bifurcations[0]
    assert doubling.kind == "period doubling"
    theory = g / w**2 * math.hypot(math.pi * (1 - e) / (1 + e), 2 * (1 + e**2) / (1 + e) ** 2)
    np.testing.assert_allclose(doubling.value, theory, rtol=1e-7)


def test_stick_slip_under_constant_friction_ends_where_the_damped_block_just_reaches_the_belt_again():
    # m = k = 1, released at speed v_b with acceleration -(F_s - F_k); it slides as v = exp(-z t) (v_b cos w t + B sin w t), w^2 = 1 - z^2
    static, kinetic, belt = 1.0, 0.4, 0.5

    def regained(damping):
        z = damping / 2
        w = math.sqrt(1 - z**2)
        b = (kinetic - static + z * belt) / w
        # the second rest of the acceleration, v' = exp(-z t) ((w B - z v_b) cos w t - (w v_b + z B) sin w t), is the top
        top = (math.atan2(w * b - z * belt, w * belt + z * b) % math.pi + math.pi) / w
        return math.exp(-z * top) * (belt * math.cos(w * top) + b * math.sin(w * top)) - belt

    theory = brentq(regained, 1e-3, 1.0)
    plant = compose(BlockOnBelt(belt_speed=belt, damping=0.02, friction=Coulomb(static=static, kinetic=kinetic)))
    branch = follow(limit_cycle(closed_loop(plant, start={"block.speed": belt}), 80.0), "block.damping", (0.0, 1.0), points=150)
    (grazing,) = branch.bifurcations
    assert grazing.kind == "grazing-sliding"
    np.testing.assert_allclose(grazing.value, theory, rtol=1e-7)
    assert grazing.cycle.stick_share("belt") > 0.1  # nothing shrinks: the cycle is gone at once, and the block comes to rest
    assert branch.stable.all()
    assert "none is found beyond" in branch.stop_reason


@dataclass(frozen=True)
class Odometer(Component):
    """The way w that the belt has slid under the block, and twice that: w' = v_belt - v, u' = 2 (v_belt - v)."""

    belt_speed: float = quantity(0.2, "m/s", "speed of the belt")

    def equations(self, signal):
        way, double = state("odometer.way", "m"), state("odometer.double", "m")
        slip = self.belt_speed - signal("block.speed", "m/s")
        return Equations(flow={way: slip, double: 2 * slip})


def test_a_swing_that_loses_no_energy_is_neutral():
    """The block slides for ever: it swings about the stretch that friction holds, and any other swing would do as well."""
    cycle = limit_cycle(
        simulate(compose(BlockOnBelt(mass=2.0, stiffness=8.0, belt_speed=0.3, friction=Coulomb(static=1.5, kinetic=1.0))), 200.0)
    )
    assert cycle.period == pytest.approx(math.pi, rel=1e-9) and not cycle.stable
    assert str(cycle).startswith("Neutral cycle of 3.141592654 s")


def test_what_only_adds_up_need_not_return():
    alone = limit_cycle(closed_loop(compose(BlockOnBelt()), start={"block.position": 1.2}), 60.0)
    counted = limit_cycle(closed_loop(compose(BlockOnBelt(), Odometer()), start={"block.position": 1.2}), 60.0)
    np.testing.assert_allclose(counted.period, alone.period, rtol=1e-10)
    assert counted.multipliers.size == 1
    np.testing.assert_allclose(counted.run["odometer.way"][-1] - counted.run["odometer.way"][0], 0.2 * alone.period, rtol=1e-9)


def test_what_is_no_cycle_is_said_to_be_none():
    plant = compose(BlockOnBelt(damping=1.0, friction=Coulomb(static=0.5, kinetic=0.5)))
    with pytest.raises(CycleError, match="rest"):
        limit_cycle(closed_loop(plant, start={"block.position": 1.0}), 60.0)
    with pytest.raises(SceneError, match="settle"):
        limit_cycle(plant)
    with pytest.raises(SceneError, match="table"):
        limit_cycle(closed_loop(plant, inputs={"block.force": step(0.0, 1.0, 3.0)}), 60.0)
    cycle = limit_cycle(closed_loop(compose(BlockOnBelt()), start={"block.position": 1.2}), 60.0)
    with pytest.raises(SceneError, match="bounds"):
        follow(cycle, "block.belt_speed", (0.3, 0.5))
    with pytest.raises(SceneError, match="`block.position` must be an input or a parameter for `follow`, but it is a start value"):
        follow(cycle, "block.position", (0.0, 0.5))


@pytest.mark.parametrize("reference", [7.0, 8.0])
@pytest.mark.parametrize("settle", [60.0, 200.0])
def test_from_smooth_running_no_cycle_is_found_and_from_inside_stick_slip_the_one_beside_it_is(reference, settle):
    # soft torque holds both: poles left of the axis, to which the run from rest winds down without a switch, and the cycle of a bit that sticks
    rig, law = compose(wells.JANSEN_2, BitRock(weight=97_347.0)), SoftTorque(reference=reference)
    assert pole_locus(closed_loop(rig, law), "top.reference", [reference], mode={"bit": "slip+"}).real.max() < 0.0
    with pytest.raises(CycleError, match="dies out without a switch"):
        limit_cycle(closed_loop(rig, law), settle)
    inside = limit_cycle(closed_loop(rig, law, start={"chain.speed": (reference, 0.0)}), settle)
    assert inside.stable and inside.stick_share("bit") > 0.2


test_wrong_uses_are_refused_in_these_words = refusals(
    *each_of(lambda settle: limit_cycle(closed_loop(compose(Block(damping=0.1)), start={"block.position": 1.0}), settle),
     "dies out without a switch", [30.0, 300.0, 3000.0], CycleError),
    # half a round each way loses 2 F / k, whatever the amplitude: a round is 4 F / k short, and no start mends that
    *each_of(lambda settle: limit_cycle(closed_loop(compose(BlockOnBelt(belt_speed=0.0, load=0.01, friction=Coulomb(static=1.0, kinetic=0.5))),
     start={"block.position": 1.0}), settle), r"No cycle was found.* by 0\.02 of its size", [30.0, 100.0], CycleError),
)  # fmt: skip


def test_cycle_and_branch_print_and_draw_themselves():
    cycle = limit_cycle(closed_loop(compose(BlockOnBelt()), start={"block.position": 1.2}), 60.0)
    assert "Stable cycle of 12.00" in str(cycle)
    assert "sticks 64.20 %" in str(cycle)
    branch = follow(cycle, "block.belt_speed", (0.1, 0.3), points=6)
    assert "6 cycles" in str(branch)
    ax = branch.plot("block.position")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("block belt speed [m/s]", "block position, smallest and largest [m]")
    cycle.plot("block.position", "block.speed")
    ax = branch.plot()  # what says most, where nobody names it
    assert ax.get_ylabel() == "block speed, smallest and largest [m/s]"
    ax = cycle.plot()
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("block position [m]", "block speed [m/s]")
    rig = closed_loop(compose(wells.JANSEN_2, BitRock(weight=97_347.0)), StiffPI(reference="95 rpm"))
    ax = limit_cycle(rig, 100.0).plot()
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("chain twist, 1st from the top [rad]", "bit speed [rpm]")
    with pytest.raises(SceneError, match="There is no signal `block.sped`"):
        branch.plot("block.sped")


def test_a_load_that_time_changes_asks_for_the_period_beside_a_sine_of_another_frequency():
    """A torque of period 2 pi s on a brake whose press has the period 4 pi s: the motion comes round after 4 pi s, not with the torque."""

    @dataclass(frozen=True)
    class PressedShaft(Component):
        def equations(self, signal):
            torque, speed = signal("drive.torque", "N m", default=0.0), state("shaft.speed", "rad/s")
            brake = DryFriction("brake", speed, Coulomb(0.4, 0.3), 2.0 + ca.cos(time / 2))
            return Equations(flow={speed: torque + brake.force - speed}, elements=[brake])

    loop = closed_loop(compose(PressedShaft()), inputs={"drive.torque": sine(0.0, 2.0, 0.5 / math.pi)})
    with pytest.raises(SceneError, match="`period` must be given for a driven machine that depends on time by itself"):
        limit_cycle(loop, 60.0)
    cycle = limit_cycle(loop, 60.0, period=4 * math.pi)
    run = simulate(loop, 32 * math.pi, accuracy=1e-11)
    speeds = [run.at(k * 2 * math.pi + 1.5)["shaft.speed"] for k in (12, 13, 14)]
    assert speeds[0] == pytest.approx(speeds[2], abs=1e-9) and abs(speeds[0] - speeds[1]) > 1e-2
    assert cycle.period == pytest.approx(4 * math.pi)
    assert cycle.run.at(1.5)["shaft.speed"] == pytest.approx(speeds[0], abs=1e-8)
