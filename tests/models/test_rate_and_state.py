"""Rate and state friction: steps of the speed, the critical stiffness of a slider on a spring, and what stands still."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from models import BitRock, Block, BlockOnBelt, DiscBrake, GuideContact, RateAndState, wells
from toolbox import compose, energy_audit, equilibrium, hopf_points, linearise, measure, simulate
from toolbox.errors import NoSteadyState

LAW = RateAndState(base=0.6, direct=0.010, evolving=0.015, distance=1e-5, speed=1e-6)
HEAVY = Block(mass=1e22, stiffness=0.0)  # moves at the speed it starts with, whatever rubs on it


def sliding(law, speed, duration, age):
    """Coefficient of friction over time at a constant slip, from an age of the contacts."""
    run = simulate(compose(HEAVY, GuideContact(friction=law)), duration, start={"block.speed": speed, "guide.age": age}, accuracy=1e-11)
    times = np.linspace(0.0, duration, 41)
    return times, run.at(times)["guide.drag"], run.at(times)["guide.age"]


@pytest.mark.parametrize("factor", [10.0, 0.1])
def test_a_step_of_the_speed_acts_at_once_by_a_and_over_d_c_by_b_as_the_ageing_law_has_it(factor):
    # theta = D/v + (theta_0 - D/v) exp(-v t / D), theta_0 = D/v_0: steady sliding at v_0 before the step
    speed = factor * LAW.speed
    times, mu, age = sliding(LAW, speed, 20 * LAW.distance / speed, 0.0)
    theta = LAW.distance / speed * (1 + (factor - 1) * np.exp(-speed * times / LAW.distance))
    np.testing.assert_allclose(age, np.log(LAW.speed * theta / LAW.distance), atol=1e-8)
    np.testing.assert_allclose(mu, 0.6 + 0.010 * math.log(factor) + 0.015 * age, atol=1e-10)
    assert mu[0] - 0.6 == pytest.approx(0.010 * math.log(factor), abs=1e-10)
    assert mu[-1] - mu[0] == pytest.approx(-0.015 * math.log(factor), rel=1e-6)
    assert float(LAW.sliding(speed)) == pytest.approx(mu[-1], abs=1e-8)


@pytest.mark.parametrize("factor", [10.0, 0.1])
def test_under_the_slip_law_a_step_fades_as_an_exponential_of_the_way_alike_up_and_down(factor):
    # psi' = -(v / D) (ln(v / v_0) + psi)
    law = dataclasses.replace(LAW, ageing=False)
    speed = factor * law.speed
    times, _, age = sliding(law, speed, 5 * law.distance / speed, 0.0)
    np.testing.assert_allclose(age, -math.log(factor) * -np.expm1(-speed * times / law.distance), atol=1e-8)


def critical(mass, speed, load):
    """k_c = N (b - a) / D (1 + m v^2 / (N a D)) of Rice and Ruina, with the numbers of LAW, and the steady sliding there as a guess."""
    stiffness = load * 0.005 / 1e-5 * (1 + mass * speed**2 / (load * 0.010 * 1e-5))
    return stiffness, {"block.position": 0.6 * load / stiffness, "belt.age": -math.log(speed / 1e-6)}


@pytest.mark.parametrize("mass", [0.01, 1e5])
def test_a_slider_on_a_spring_loses_its_steady_sliding_at_the_critical_stiffness(mass):
    # at the frequency w^2 = (b - a) / a (v / D)^2
    expected, guess = critical(mass, 1e-5, 50.0)
    block = compose(BlockOnBelt(mass=mass, stiffness=2 * expected, belt_speed=1e-5, load=50.0, friction=LAW))
    (found,) = hopf_points(block, "block.stiffness", (0.3 * expected, 3 * expected), guess=guess)
    assert found.value == pytest.approx(expected, rel=1e-9)
    assert found.stable == "above"
    assert found.frequency == pytest.approx(math.sqrt(0.5) * 1e-5 / 1e-5, rel=1e-6)


@pytest.mark.parametrize("load", [1e4, 1e6])
def test_under_a_large_load_a_creeping_contact_below_a_block_that_moves_is_no_steady_state(load):
    # on rock of 10 kN and more the slope of creep is 1e14 N s/m: its round-off is a force, and says nothing of how fast the block moves
    expected, guess = critical(10.0, 1e-4, load)
    for law in (LAW, dataclasses.replace(LAW, ageing=False)):
        block = compose(BlockOnBelt(mass=10.0, stiffness=expected, belt_speed=1e-4, load=load, friction=law))
        (found,) = hopf_points(block, "block.stiffness", (0.3 * expected, 3 * expected), guess=guess)
        assert found.value == pytest.approx(expected, rel=1e-9)
        try:
            rest = equilibrium(block)
        except NoSteadyState:
            continue
        assert abs(rest["block.speed"]) < 1e-12 * 1e-4


@pytest.mark.parametrize("mass", [0.01, 1e5])
def test_the_slip_law_loses_its_steady_sliding_at_the_same_stiffness(mass):
    expected, guess = critical(mass, 1e-5, 50.0)
    for factor, side in ((1 - 1e-6, 1), (1 + 1e-6, -1)):
        block = BlockOnBelt(
            mass=mass, stiffness=factor * expected, belt_speed=1e-5, load=50.0, friction=dataclasses.replace(LAW, ageing=False)
        )
        point = equilibrium(compose(block), guess=guess)
        growth = max(linearise(point.plant, at=point).poles().real)
        assert math.copysign(1.0, growth) == side


def test_below_the_critical_stiffness_the_slider_sticks_and_slips_and_above_it_slides():
    # critical stiffness 25 kN/m
    load, speed = 50.0, 1e-5
    swings = []
    for stiffness in (15e3, 40e3):
        block = BlockOnBelt(mass=0.01, stiffness=stiffness, belt_speed=speed, load=load, friction=LAW)
        rest = equilibrium(compose(block), guess={"block.position": 30 / stiffness, "belt.age": -2.0})
        start = {"block.position": 1.001 * rest["block.position"], "belt.age": rest["belt.age"]}
        run = simulate(compose(block), 120.0, start=start)
        assert energy_audit(run).relative < 1e-5
        swings.append(measure.extent(run, "block.speed", 60.0))
    assert swings[0].maximum - swings[0].minimum > speed
    assert swings[1].maximum - swings[1].minimum < 1e-3 * speed


def test_rest_is_a_creep_that_no_machine_notices():
    # half of the friction: v / sqrt(v^2 + floor^2) is about a half, a speed of some 1e-12 m/s
    block = BlockOnBelt(stiffness=0.0, damping=0.0, belt_speed=0.0, load=1.0, friction=LAW)
    run = simulate(compose(block), 10.0, inputs={"block.force": ([0.0, 1.0], [0.0, 0.3])})
    assert 0.0 <= run.at(10.0)["block.position"] < 1e-11
    assert run.at(10.0)["belt.force"] == pytest.approx(-0.3, rel=1e-6)


def test_rate_and_state_serves_bits_and_brakes_in_their_units():
    law = RateAndState(base=0.5, direct=0.05, evolving=0.1, distance=0.05, speed=1.0)
    rig = compose(wells.NAVARRO_LOPEZ_4, BitRock(friction=law))
    assert {name: entry.unit for name, entry in rig.parameters.items() if "friction" in name} == {
        "bit.friction.base": "1", "bit.friction.direct": "1", "bit.friction.evolving": "1", "bit.friction.distance": "rad",
        "bit.friction.speed": "rad/s", "bit.friction.regularisation_speed": "rad/s",
    }  # fmt: skip
    run = simulate(rig, 30.0, inputs={"top.torque": 9000.0}, accuracy=1e-8)
    assert energy_audit(run).relative < 1e-6
    braked = simulate(
        compose(DiscBrake(friction=dataclasses.replace(law, speed=0.1, distance=0.001))), 1.0, start={"disc.speed": 10.0}, accuracy=1e-8
    )
    assert energy_audit(braked).relative < 1e-6
    assert braked.at(1.0)["disc.speed"] < 10.0


def test_steady_sliding_is_damped_by_its_direct_effect_and_undone_by_its_age():
    # poles of a heavy slip at v: z' in psi alone, -v / D
    plant = compose(HEAVY, GuideContact(friction=LAW))
    point = linearise(plant, at={"block.speed": 2e-6, "guide.age": -math.log(2)})
    assert np.sort_complex(point.poles())[0] == pytest.approx(-2e-6 / 1e-5, rel=1e-6)
