"""Planetary trains against the kinematics of Willis, power balance and rigid-body motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from controllers import PI
from models import BitRock, GearNetwork, TorsionalChain
from models.gears import Train, steady_gears
from toolbox import SceneError, compose, energy_audit, linearise, simulate

SINGLE = [Train("sun", "ground", "carrier", -3.0, 0.98)]


def test_a_sun_drives_its_carrier_at_a_quarter_of_its_speed_and_with_the_known_efficiency():
    running = steady_gears(SINGLE, {"sun": 8.0}, {"carrier": -100.0})
    assert running.speed["sun"] / running.speed["carrier"] == pytest.approx(4.0, rel=1e-14)
    assert running.efficiency == pytest.approx((1 + 3 * 0.98) / 4, rel=1e-14)  # 0.985
    assert running.torque["sun"] == pytest.approx(100.0 / (1 + 3 * 0.98), rel=1e-14)
    assert running.direction == (1,)
    assert sum(running.torque.values()) == pytest.approx(0.0, abs=1e-12)


def test_a_carrier_drives_its_sun_with_another_efficiency_because_the_teeth_lose_in_the_other_direction():
    running = steady_gears(SINGLE, {"carrier": 2.0}, {"sun": -25.0})
    assert running.efficiency == pytest.approx(4 / (1 + 3 / 0.98), rel=1e-14)
    assert running.direction == (-1,)


def test_trains_in_series_multiply_their_ratios_and_their_efficiencies():
    trains = [*SINGLE, Train("carrier", "ground", "slow", -5.0, 0.97)]
    running = steady_gears(trains, {"sun": 24.0}, {"slow": -600.0})
    assert running.speed["slow"] == pytest.approx(24.0 / 4 / 6, rel=1e-14)
    assert running.efficiency == pytest.approx((1 + 3 * 0.98) / 4 * (1 + 5 * 0.97) / 6, rel=1e-13)
    assert running.torque["carrier"] == 0.0  # nothing acts on the shaft between them


def test_a_differential_adds_the_speeds_of_two_motors_and_shares_the_torque_whatever_they_are():
    for sun, ring in ((30.0, -4.0), (12.0, 5.0)):
        running = steady_gears([Train("sun", "ring", "carrier", -3.0)], {"sun": sun, "ring": ring}, {"carrier": -80.0})
        assert running.speed["carrier"] == pytest.approx((sun + 3 * ring) / 4, rel=1e-14)
        assert (running.torque["sun"], running.torque["ring"]) == pytest.approx((20.0, 60.0), rel=1e-14)
        assert running.efficiency == pytest.approx(1.0, rel=1e-13)


def test_a_block_that_turns_as_one_loses_nothing():
    running = steady_gears([Train("sun", "ring", "carrier", -3.0, 0.9)], {"sun": 5.0, "ring": 5.0}, {"carrier": -80.0})
    assert running.efficiency == pytest.approx(1.0, rel=1e-13)
    assert running.direction == (0,)


@pytest.mark.parametrize("seed", range(8))
def test_what_a_network_with_a_second_path_of_power_loses_is_what_its_teeth_lose_as_seen_from_their_carriers(seed):
    # the sun drives the carrier directly and, through a second train, by way of the ring: power splits or goes round
    random = np.random.default_rng(seed)
    i1, i2 = -random.uniform(1.5, 5.0), random.choice([-1, 1]) * random.uniform(1.5, 5.0)
    eta1, eta2 = random.uniform(0.97, 0.99, 2)
    trains = [Train("sun", "ring", "carrier", i1, eta1), Train("sun", "ground", "ring", i2, eta2)]
    running = steady_gears(trains, {"sun": 10.0}, {"carrier": -100.0})
    w = running.speed
    assert w["ring"] == pytest.approx(10.0 / (1 - i2))
    assert w["carrier"] == pytest.approx((10.0 - i1 * w["ring"]) / (1 - i1))
    # nothing acts on the ring from outside: 0 = -p1 t1 - (1 - p2) t2;  on the carrier: -100 = -(1 - p1) t1
    p1, p2 = i1 * eta1 ** running.direction[0], i2 * eta2 ** running.direction[1]
    t1 = 100.0 / (1 - p1)
    t2 = -p1 * t1 / (1 - p2)
    assert t1 + t2 == pytest.approx(running.torque["sun"], rel=1e-12)
    lost = 0.0
    for power, eta in ((t1 * (w["sun"] - w["carrier"]), eta1), (t2 * (w["sun"] - w["ring"]), eta2)):
        lost += (1 - eta) * power if power > 0 else (1 / eta - 1) * -power
    assert sum(running.power.values()) == pytest.approx(lost, rel=1e-10)
    assert lost > 0


def test_responsivity_is_the_slope_of_the_logarithms_and_adds_up_to_one():
    trains = [Train("sun", "ring", "carrier", -3.0, 0.98), Train("motor", "ground", "ring", -2.0, 0.97)]
    speeds, torques = {"sun": 30.0, "motor": 9.0}, {"carrier": -80.0, "ring": -15.0}
    running = steady_gears(trains, speeds, torques)
    for of in ("sun", "motor"):
        slopes = {}
        for to in torques:
            changed = steady_gears(trains, speeds, torques | {to: torques[to] * 1.001})
            slopes[to] = math.log(changed.power[of] / running.power[of]) / math.log(1.001)
            assert running.responsivity(of, to) == pytest.approx(slopes[to], rel=2e-3, abs=1e-9)
        assert sum(running.responsivity(of, to) for to in torques) == pytest.approx(1.0, rel=1e-12)
    for to in speeds:
        changed = steady_gears(trains, speeds | {to: speeds[to] * 1.001}, torques)
        slope = math.log(changed.power["carrier"] / running.power["carrier"]) / math.log(1.001)
        assert running.responsivity("carrier", to) == pytest.approx(slope, rel=2e-3)
    assert sum(running.responsivity("carrier", to) for to in speeds) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize(
    ("trains", "speeds", "torques", "words"),
    [
        ([], {"sun": 1.0}, {}, "trains"),
        (SINGLE, {}, {}, "speeds.*1 of the shafts"),
        (SINGLE, {"sun": 1.0, "carrier": 2.0}, {}, "speeds.*1 of the shafts"),
        (SINGLE, {"son": 1.0}, {}, "no shaft `son`"),
        (SINGLE, {"sun": math.nan}, {}, "speeds"),
        (SINGLE, {"sun": 1.0}, {"carrier": math.inf}, "torques"),
        (SINGLE, {"sun": 1.0}, {"sun": 1.0}, "both"),
        (SINGLE, {"ground": 1.0}, {}, "ground"),
        ([*SINGLE, *SINGLE], {"sun": 1.0}, {}, "independent"),
        ([*SINGLE, Train("other", "ring", "arm", -2.0)], {"sun": 1.0, "carrier": 0.25, "ring": 0.0}, {}, "stay free"),
    ],
)
def test_a_network_that_has_no_single_answer_is_refused_with_the_reason(trains, speeds, torques, words):
    with pytest.raises(SceneError, match=words):
        steady_gears(trains, speeds, torques)


@pytest.mark.parametrize(
    "change",
    [{"ratio": 0.0}, {"ratio": 1.0}, {"ratio": math.nan}, {"efficiency": 0.0}, {"efficiency": 1.1}, {"efficiency": math.nan}, {"b": "sun"}],
)
def test_numbers_and_names_that_make_no_train_are_refused(change):
    with pytest.raises(SceneError):
        Train(**({"a": "sun", "b": "ring", "carrier": "carrier", "ratio": -3.0} | change))


def test_a_high_ratio_train_locks_itself_when_it_is_driven_from_its_slow_shaft():
    # i0 near 1: 1 - i0 / eta < 0, so that no torque on the slow shaft drives the carrier
    trains = [Train("slow", "ground", "fast", 0.99, 0.95)]
    assert 0 < steady_gears(trains, {"fast": 100.0}, {"slow": -50.0}).efficiency < 0.2
    with pytest.raises(SceneError, match="locks itself"):
        steady_gears(trains, {"slow": 1.0}, {"fast": -0.5})


def test_an_unloaded_lossless_pair_of_inertias_swings_at_the_frequency_of_its_teeth():
    # windup'' = -k (1 / J_sun + (1 - i0)^2 / J_carrier) windup
    plant = compose(GearNetwork(inertia=(2.0, 7.0), mesh_stiffness=(5000.0,), mesh_damping=(0.0,)))
    poles = np.linalg.eigvals(linearise(plant).A)
    assert max(poles.imag) == pytest.approx(math.sqrt(5000.0 * (1 / 2.0 + 16 / 7.0)), rel=1e-12)
    run = simulate(plant, 2.0, start={"gears.windup": 0.01}, accuracy=1e-10)
    t = np.linspace(0, 2, 50)
    np.testing.assert_allclose(run.at(t)["gears.windup"].ravel(), 0.01 * np.cos(max(poles.imag) * t), atol=1e-10)
    assert len(plant.elements) == 0 and plant.x.numel() == 3  # no efficiency, no contact; no shaft, no twist


@pytest.mark.parametrize(("load", "s"), [(-10.0, 1), (200.0, -1)])
def test_accelerating_gears_pass_on_the_torque_that_the_direction_of_power_leaves(load, s):
    # rigid: J_s w' = T - T_a,  J_c w' / 4 = load + (1 - i0 eta^s) T_a
    j_s, j_c, eta, torque = 1.0, 10.0, 0.9, 5.0
    net = GearNetwork(inertia=(j_s, j_c), efficiency=(eta,), idle_torque=(1e-9,), mesh_damping=(200.0,))
    inputs = {"sun.torque": torque, "carrier.torque": load}
    run = simulate(compose(net), 4.0, inputs=inputs, start={"sun.speed": 40.0, "carrier.speed": 10.0}, accuracy=1e-9)
    gain = 1 + 3 * eta**s
    t_a = (torque / j_s - 4 * load / j_c) / (1 / j_s + 4 * gain / j_c)
    assert np.sign(t_a) == s
    early, late = run.at(2.0), run.at(4.0)
    assert (late["sun.speed"] - early["sun.speed"]) / 2 == pytest.approx((torque - t_a) / j_s, rel=1e-6)
    assert set(run.modes["gears.0"]) == {"slip+"}


@pytest.mark.parametrize(("load", "mode"), [(-36.5, "slip+"), (-37.5, "stick"), (-43.0, "stick"), (-43.7, "slip-")])
def test_teeth_at_rest_take_any_ratio_of_torques_between_their_two_efficiencies(load, mode):
    # 10 N m on the sun balance between (1 - i0 eta) 10 = 37 and (1 - i0 / eta) 10 = 43.3 N m on the carrier
    net = GearNetwork(efficiency=(0.9,), idle_torque=(1e-3,), mesh_damping=(300.0,))
    inputs = {"sun.torque": ((0.0, 20.0), (0.0, 10.0)), "carrier.torque": ((0.0, 20.0), (0.0, load))}
    run = simulate(compose(net), 40.0, inputs=inputs, accuracy=1e-8)
    assert run.modes["gears.0"][-1] == mode
    if mode == "stick":
        assert run.at(40.0)["sun.speed"] == pytest.approx(0.0, abs=1e-9)


def test_a_motor_behind_a_gearbox_turns_a_string_and_every_joule_is_accounted_for():
    net = GearNetwork(
        nodes=("motor", "table"), inertia=(5.0, 300.0), trains=(("motor", "ground", "table"),), ratio=(-3.0,), mesh_stiffness=(1e5,), mesh_damping=(200.0,),
        efficiency=(0.95,), idle_torque=(5.0,), shafts=(("table", "top"),), stiffness=(1e5,), damping=(500.0,), input_node="motor",
    )  # fmt: skip
    chain = TorsionalChain(inertia=(500.0, 374.0), stiffness=(473.0,), damping=(23.2,), bit_drag=50.0)
    plant = compose(net, chain, BitRock(weight=30_000.0))
    law = PI(proportional=300.0, integral=50.0, reference=36.0)
    run = simulate(plant, 60.0, controller=law, accuracy=1e-8)
    assert run.at(60.0)["motor.speed"] / run.at(60.0)["bit.speed"] == pytest.approx(4.0, rel=0.02)
    assert run.at(60.0)["motor.speed"] == pytest.approx(36.0, rel=0.02)
    audit = energy_audit(run)
    assert audit.relative < 1e-9
    assert all(value >= 0 for value in audit.losses.values())
    assert {e.name for e in plant.elements} == {"gears.0", "bit"}
    # the same network, rigid and steady
    steady = net.steady({"motor": 36.0}, {"top": -1000.0})
    assert steady.speed["top"] == pytest.approx(9.0)
    assert steady.efficiency == pytest.approx((1 + 3 * 0.95) / 4)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"nodes": ()}, "nodes"),
        ({"nodes": ("sun", "sun")}, "nodes"),
        ({"nodes": ("sun", "ground")}, "nodes"),
        ({"nodes": ("sun", "carrier", "lone"), "inertia": (1.0, 1.0, 1.0)}, "lone"),
        ({"inertia": (1.0,)}, "inertia"),
        ({"trains": ()}, "trains"),
        ({"trains": (("sun", "carrier"),)}, "train"),
        ({"ratio": (1.0,)}, "ratio"),
        ({"ratio": (-3.0, -3.0)}, "ratio"),
        ({"efficiency": (0.9,)}, "idle_torque"),
        ({"idle_torque": (1.0,)}, "efficiency"),
        ({"efficiency": (1.2,), "idle_torque": (1.0,)}, "efficiency"),
        ({"shafts": (("sun", "top"),)}, "stiffness"),
        ({"shafts": (("sun", "sun"),), "stiffness": (1.0,), "damping": (0.0,)}, "shafts"),
        ({"input_node": "ring"}, "input_node"),
        ({"shafts": (("sun", "top"),), "stiffness": (1.0,), "damping": (0.0,)}, "top.speed"),
    ],
)
def test_a_network_that_cannot_be_built_is_refused_by_name(change, word):
    with pytest.raises(SceneError, match=word):
        compose(GearNetwork(**change))
