"""What stands around a brake: the actuator, the wheel, a second pad, a warm disc and a band, each in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from controllers import BrakeForce, NormalDither, groan_border
from models import BandBrake, BrakeActuator, Coulomb, DiscBrake, Exponential
from toolbox import Sampled, SceneError, compose, energy_audit, simulate

FLAT = Coulomb(static=0.4, kinetic=0.4)
QUICK = BrakeActuator(highest_force=None, rate_limit=None)


# --- the actuator


def test_the_force_follows_a_step_with_the_lag():
    run = simulate(compose(DiscBrake(), QUICK), 0.1, inputs={"actuator.command": 1000.0}, accuracy=1e-10)
    times = np.array([0.005, 0.01, 0.03])
    np.testing.assert_allclose(run.at(times)["brake.force"], 1000.0 * (1.0 - np.exp(-times / 0.01)), rtol=1e-8)


def test_a_large_step_rises_at_the_rate_limit_and_ends_at_the_highest_force():
    run = simulate(compose(DiscBrake(), BrakeActuator(highest_force=5000.0, rate_limit=20_000.0)), 1.0, inputs={"actuator.command": 9000.0})
    assert run.at(0.1)["brake.force"] == pytest.approx(2000.0)
    assert run.at(1.0)["brake.force"] == pytest.approx(5000.0)


def test_a_pressure_presses_with_its_piston():
    plant = compose(DiscBrake(friction=FLAT, wheel_radius="300 mm"), BrakeActuator(piston_area="2290 mm^2"))
    run = simulate(plant, 1.5, start={"disc.car_speed": "30 km/h"}, inputs={"actuator.pressure": "12 bar"})
    assert run.at(1.0)["brake.force"] == pytest.approx(12e5 * 2290e-6)
    assert run.at(1.0)["brake.pressure"] == pytest.approx(12e5)
    slowed = run.at(0.8)["disc.car_speed"] - run.at(1.3)["disc.car_speed"]
    assert slowed == pytest.approx(0.5 * 0.3 * 2 * 0.4 * 12e5 * 2290e-6 * 0.12 / 36.0, rel=1e-3)


def test_laws_and_dither_go_through_the_actuator():
    # a lag of 10 ms leaves 1 / sqrt(1 + (2 pi 150 Hz 10 ms)^2) of a sine of 150 Hz, here 0.1055
    dither = NormalDither(load="actuator.dither", over="brake.force", depth=0.5, frequency=150.0)
    law = BrakeForce(deceleration=4.0, force_rate=None)
    plant = compose(DiscBrake(friction=FLAT), QUICK)
    run = simulate(plant, 1.0, start={"disc.speed": 9.0}, controller=[Sampled(law, 1e-3), Sampled(dither, 1e-4)])
    force = run.at(np.linspace(0.5, 0.9, 20_001))["brake.force"]
    assert force.mean() == pytest.approx(1500.0, rel=1e-3)
    assert np.ptp(force) / 2 == pytest.approx(0.5 * 1500.0 / math.hypot(1.0, 2 * math.pi * 1.5), rel=0.02)


# --- the car


def test_a_car_that_is_braked_by_its_deceleration_stops_after_the_distance_of_the_closed_form():
    plant = compose(DiscBrake(force=0.0, friction=FLAT, wheel_radius=0.3))
    law = BrakeForce(car_deceleration="2.5 m/s2", force_rate=None)
    run = simulate(plant, 3.6, start={"disc.car_speed": "30 km/h"}, controller=law, sample_time=1e-3)
    times = np.arange(0.0, 3.6, 1e-3)
    speed = run.at(times)["disc.car_speed"]
    assert speed[speed > 0.0].sum() * 1e-3 == pytest.approx((30 / 3.6) ** 2 / 5.0, rel=2e-3)
    assert energy_audit(run).relative < 1e-8
    with pytest.raises(SceneError, match="needs a DiscBrake with a `wheel_radius`"):
        law.design(compose(DiscBrake()))


# --- two pads, a warm disc


def test_two_pads_add_their_friction_and_let_go_together():
    plant = compose(DiscBrake(force=500.0, friction=Coulomb(0.5, 0.3), second_pad_friction=Coulomb(0.3, 0.2)))
    run = simulate(plant, 1.0, start={"disc.speed": 9.0})
    assert run.at(0.5)["brake.torque"] == pytest.approx(500.0 * 0.12 * 0.5)
    bound = 500.0 * 0.12 * 0.8
    for torque, holds in ((0.99 * bound, True), (1.01 * bound, False)):
        wound = {"pad.position": torque / 0.12 / 1e6}  # the caliper holds that torque already
        held = simulate(plant, 1.0, start=wound, inputs={"disc.torque": torque})
        assert (not any(event.before == "stick" for event in held.events)) == holds


def test_two_pads_groan_above_the_damping_by_the_sum_of_their_falls():
    same, other = Exponential(0.45, 0.35, 5.0), Exponential(0.4, 0.38, 5.0)
    two = groan_border(compose(DiscBrake(friction=same, second_pad_friction=other)))
    for speed in (0.5, 2.0):
        true = 200.0 / ((0.1 + 0.02) * 5.0 * math.exp(-0.6 * speed))
        assert 0.8 * true < two.at(speed) <= true * (1.0 + 1e-9)


def test_the_disc_takes_the_heat_of_the_friction_and_friction_fades_with_it():
    # a heavy disc turns at a constant speed: C h' = 2 mu N (1 - fade h) v - cooling h
    brake = DiscBrake(inertia=1e9, force=2000.0, friction=FLAT, heat_capacity=4000.0, cooling=20.0, fade=1e-3)
    run = simulate(compose(brake), 60.0, start={"disc.speed": 20.0}, accuracy=1e-9)
    heat = 2 * 0.4 * 2000.0 * 0.12 * 20.0
    rate = (1e-3 * heat + 20.0) / 4000.0
    warm = heat / (1e-3 * heat + 20.0) * (1.0 - math.exp(-rate * 60.0))
    assert run.at(60.0)["disc.warming"] == pytest.approx(warm, rel=1e-3)
    assert run.at(60.0)["brake.torque"] == pytest.approx(2 * 0.4 * 2000.0 * 0.12 * (1.0 - 1e-3 * warm), rel=1e-3)
    assert energy_audit(run).relative < 1e-8


def test_a_stop_turns_the_energy_of_the_car_into_the_heat_of_the_disc_and_a_hot_disc_needs_more_distance():
    stops = {}
    for fade in (0.0, 1e-3):
        brake = DiscBrake(force=3000.0, friction=FLAT, wheel_radius=0.3, heat_capacity=4000.0, cooling=0.0, fade=fade)
        for warm in (0.0, 300.0):
            run = simulate(compose(brake), 12.0, start={"disc.car_speed": 30.0 / 3.6, "disc.warming": warm}, accuracy=1e-9)
            stops[fade, warm] = next(begin for begin, _, mode in run.intervals("pad") if mode == "stick")
            audit = energy_audit(run)
            assert audit.relative < 1e-8
            gained = 4000.0 * (run.at(12.0)["disc.warming"] - warm)
            assert gained == pytest.approx(audit.losses["disc.friction"], rel=1e-7)
            assert gained == pytest.approx(400.0 * (30.0 / 3.6) ** 2 / 2.0, rel=1e-3)  # a little swings on in the caliper
    assert stops[0.0, 300.0] == pytest.approx(stops[0.0, 0.0], rel=1e-6)
    # constant torque if fade were constant: 3.5 K of warming in the stop change it by at most 0.35 %
    assert stops[1e-3, 300.0] == pytest.approx(stops[0.0, 0.0] / 0.7, rel=4e-3)


# --- a band


@pytest.mark.parametrize(("way", "gain"), [(1.0, math.exp(0.3 * math.pi) - 1.0), (-1.0, 1.0 - math.exp(-0.3 * math.pi))])
def test_a_band_tightens_itself_one_way_and_slackens_the_other(way, gain):
    drum = compose(BandBrake(wrap_angle=math.pi, friction=Coulomb(0.3, 0.3)))
    run = simulate(drum, 1.0, start={"drum.speed": 30.0 * way}, inputs={"drum.pull": 500.0}, accuracy=1e-9)
    assert run.at(1.0)["drum.speed"] == pytest.approx(way * (30.0 - 0.4 * 500.0 * gain / 40.0), rel=1e-9)
    assert energy_audit(run).relative < 1e-8
    for part, holds in ((0.99, True), (1.01, False)):
        held = simulate(drum, 1.0, inputs={"drum.pull": 500.0, "drum.torque": part * way * 0.4 * 500.0 * gain})
        assert (held.at(1.0)["drum.angle"] == 0.0) == holds
