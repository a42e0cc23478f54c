"""Linear systems from hybrid plants against matrices written by hand."""

from __future__ import annotations

import math
import subprocess
import sys
from dataclasses import dataclass, replace

import control
import numpy as np
import pytest

from controllers import PI, SoftTorque, StiffPI
from models import BitRock, BlockOnBelt, Coulomb, CubicStribeck, Exponential, TorsionalChain, wells
from tests.plants import RIG
from toolbox import Component, DryFriction, Equations, FrictionLaw, SceneError, closed_loop, compose, quantity, simulate, state
from toolbox.modelling import Relay
from toolbox.steady_states.linear import equilibrium, linearise

J1, J2, K, C12, CR, CB = 2122.0, 374.0, 473.0, 23.2, 425.0, 50.0
TORQUE = 97_347.0 * 0.155575


@pytest.fixture(scope="module")
def rig():
    return compose(wells.JANSEN_2, BitRock())


@dataclass(frozen=True)
class TwoDisks(Component):
    """Rotor I1 with drag c on a stator I2 with spring k: I1 w1' = T - c w1 + F, I2 w2' = -F - k a, a' = w2; F acts on w1 - w2."""

    rotor: float = quantity(2.0, "kg m2", "", above=0)
    stator: float = quantity(0.5, "kg m2", "", above=0)
    drag: float = quantity(0.3, "N m s/rad", "")
    stiffness: float = quantity(10.0, "N m/rad", "")
    friction: FrictionLaw = Coulomb()

    def equations(self, signal):
        w1, w2, a = state("rotor.speed", "rad/s"), state("stator.speed", "rad/s"), state("stator.angle", "rad")
        torque = signal("rotor.torque", "N m", default=0.0)
        disk = DryFriction("disk", w1 - w2, self.friction, 10.0, slip_unit="rad/s", force_unit="N m")
        flow = {w1: (torque - self.drag * w1 + disk.force) / self.rotor, w2: (-disk.force - self.stiffness * a) / self.stator, a: w2}
        return Equations(flow=flow, elements=[disk])


@dataclass(frozen=True)
class SlidingMass(Component):
    """x'' = u + d with the ideal relay u = -U sgn(x' + slope (x - r)): on the surface, x' = -slope (x - r) whatever d is."""

    slope: float = quantity(3.0, "1/s", "slope of the surface", above=0)

    def equations(self, signal):
        x, v = state("mass.position", "m"), state("mass.speed", "m/s")
        push, target = signal("mass.push", "N", default=0.0), signal("mass.target", "m", default=0.0)
        relay = Relay("relay", v + self.slope * (x - target), 5.0)
        return Equations(flow={x: v, v: push + relay.force}, elements=[relay])


@dataclass(frozen=True)
class Drift(Component):
    """Without a spring nothing says where it rests, and a push makes it run away."""

    def equations(self, signal):
        x, v = state("cart.position", "m"), state("cart.speed", "m/s")
        return Equations(flow={x: v, v: signal("cart.push", "N", default=0.0)})


# ------------------------------------------------------------------------------------------------------------------------------------- matrices
def test_the_poles_of_two_inertias_are_those_of_the_matrix_written_by_hand(rig):
    point = equilibrium(closed_loop(rig, inputs={"top.torque": 12_000.0}))
    w = point["bit.speed"]
    slope = -TORQUE * 0.3 * 0.9 * math.exp(-0.9 * w)
    hand = np.array([[0.0, 1.0, -1.0], [-K / J1, -(C12 + CR) / J1, C12 / J1], [K / J2, C12 / J2, -(C12 + CB + slope) / J2]])
    system = linearise(rig, point)
    assert system.state_labels == ["chain_twist[0]", "chain_speed[0]", "chain_speed[1]"]
    np.testing.assert_allclose(system.A, hand, rtol=1e-13)
    np.testing.assert_allclose(system["bit_speed", "top_torque"].B.ravel(), [0.0, 1 / J1, 0.0], rtol=1e-15)
    np.testing.assert_allclose(np.sort_complex(system.poles()), np.sort_complex(np.linalg.eigvals(hand)), rtol=1e-10)


def test_the_steady_gain_from_torque_to_speed_is_one_over_all_drags(rig):
    point = equilibrium(closed_loop(rig, inputs={"top.torque": 12_000.0}))
    slope = -TORQUE * 0.3 * 0.9 * math.exp(-0.9 * point["bit.speed"])
    system = linearise(rig, point, inputs="top.torque", outputs=["top.speed", "bit.speed", "top.load"])
    assert system.input_labels == ["top_torque"] and system.output_labels == ["top_speed", "bit_speed", "top_load"]
    gain = 1 / (CR + CB + slope)
    np.testing.assert_allclose(system.dcgain().ravel(), [gain, gain, 1 - CR * gain], rtol=1e-12)


def test_jacobians_agree_with_differences_of_the_right_hand_side():
    plant = compose(wells.NAVARRO_LOPEZ_4, BitRock())
    x = np.array([10.0, 7.0, 8.0, 5.0, 4.0, 6.0, 5.5])
    u = np.array(plant.input_defaults(plant.values)).ravel()
    system = linearise(plant, {"chain.twist": x[:3], "chain.speed": x[3:]})
    for j in range(x.size):
        step = np.zeros(x.size)
        step[j] = 1e-5
        rise = np.array(plant.rhs(0, x + step, u, plant.values, 1) - plant.rhs(0, x - step, u, plant.values, 1)).ravel() / 2e-5
        np.testing.assert_allclose(system.A[:, j], rise, rtol=1e-7, atol=1e-8)


def test_a_small_step_of_the_plant_follows_the_linear_system_to_second_order(rig):
    point = equilibrium(closed_loop(rig, inputs={"top.torque": 12_000.0}))
    system = linearise(rig, point, inputs="top.torque", outputs="bit.speed")
    t = np.linspace(0.0, 30.0, 301)
    start = {"chain.twist": point["chain.twist"], "chain.speed": point["chain.speed"]}
    errors = []
    for change in (40.0, 20.0):
        run = simulate(rig, 30.0, start=start, inputs={"top.torque": 12_000.0 + change}, accuracy=1e-11, output_times=t)
        linear = control.forced_response(system, t, np.full(t.size, change)).outputs
        errors.append(np.abs(run["bit.speed"] - point["bit.speed"] - linear).max())
    assert errors[0] < 0.01 * np.abs(linear).max()
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize("beta", [0.0, 0.05, 0.1])
def test_a_block_on_a_belt_loses_stability_at_the_hopf_speed_of_thomsen_and_fidlin(beta):
    """v_b1 = v_m sqrt(1 - 4 beta v_m / (3 g2 (mu_s - mu_m))): damping and falling friction cancel there."""
    v_m, mu_s, mu_m, g2 = 0.5, 0.4, 0.25, 1.2
    hopf = v_m * math.sqrt(1 - 4 * beta * v_m / (3 * g2 * (mu_s - mu_m)))
    plant = compose(BlockOnBelt(damping=2 * beta, load=g2, friction=CubicStribeck(mu_s, mu_m, v_m)))

    def growth(speed):
        changed = {"block.belt_speed": speed}
        point = equilibrium(closed_loop(plant, parameters=changed))
        assert point.modes == {"belt": "slip-"} and point["block.speed"] == 0.0
        return linearise(plant, point).poles().real.max()

    assert growth(hopf) == pytest.approx(0.0, abs=1e-15)
    assert growth(0.99 * hopf) > 1e-3 > -1e-3 > growth(1.01 * hopf)


# ----------------------------------------------------------------------------------------------------------------------------------- sticking
def test_a_sticking_bit_leaves_the_top_drive_on_the_spring(rig):
    system = linearise(rig, mode={"bit": "stick"})
    assert system.state_labels == ["chain_twist[0]", "chain_speed[0]"]
    np.testing.assert_allclose(system.A, [[0.0, 1.0], [-K / J1, -(C12 + CR) / J1]], rtol=1e-14)
    # the rock takes what the string delivers
    np.testing.assert_allclose(system["bit_torque", "top_torque"].C, [[K, C12]], rtol=1e-12)
    assert system["bit_torque", "top_torque"].dcgain() == pytest.approx(1.0, rel=1e-12)


def test_a_steady_state_under_a_relay_is_on_its_surface_while_the_relay_is_strong_enough():
    plant = compose(SlidingMass())
    point = equilibrium(closed_loop(plant, inputs={"mass.push": 4.0, "mass.target": 2.0}))
    assert point["mass.position"] == pytest.approx(2.0, rel=1e-14) and point["relay.force"] == pytest.approx(-4.0, rel=1e-14)
    assert linearise(plant, point).nstates == 1
    with pytest.raises(SceneError, match="`relay` in stick needs a force of 6, but its bound is 5"):
        equilibrium(closed_loop(plant, inputs={"mass.push": 6.0}))
    off = linearise(plant, {"mass.position": 1.0})
    np.testing.assert_array_equal(off.A, [[0.0, 1.0], [0.0, 0.0]])


def test_two_sticking_disks_move_as_one_body():
    plant = compose(TwoDisks())
    system = linearise(plant, mode={"disk": "stick"})
    assert system.state_labels == ["rotor_speed", "stator_angle"]
    np.testing.assert_allclose(system.A, [[-0.3 / 2.5, -10.0 / 2.5], [1.0, 0.0]], rtol=1e-14)
    np.testing.assert_allclose(system["stator_speed", "rotor_torque"].C, [[1.0, 0.0]], atol=1e-15)
    slipping = linearise(plant, at={"rotor.speed": 3.0})
    np.testing.assert_allclose(slipping.A, [[-0.15, 0, 0], [0, 0, -20], [0, 1, 0]], atol=1e-14)


def test_every_sticking_contact_takes_one_state_and_no_pole_at_zero_is_left():
    chain = TorsionalChain(
        inertia=(3.0, 2.0, 1.0), stiffness=(5.0, 7.0), damping=(0.1, 0.2), friction=Coulomb(), friction_load=(1.0, 1.0, 1.0)
    )
    plant = compose(chain)
    for stuck in range(3):
        modes = {f"chain.{i}": "stick" for i in range(stuck)}
        system = linearise(plant, at={"chain.speed.2": 1.0}, mode=modes)
        assert system.nstates == 5 - stuck
        assert [name for name in system.state_labels if "speed" in name] == [f"chain_speed[{i}]" for i in range(stuck, 3)]


def test_an_ideal_sliding_mode_has_the_pole_of_its_surface_and_rejects_the_disturbance():
    plant = compose(SlidingMass())
    system = linearise(plant)
    assert system.nstates == 1
    assert system.poles()[0].real == pytest.approx(-3.0, rel=1e-14)
    assert system.input_labels == ["mass_push"]  # the target moves the surface itself
    assert system["mass_position", "mass_push"].dcgain() == 0.0
    assert system["relay_force", "mass_push"].dcgain() == pytest.approx(-1.0, rel=1e-14)  # equivalent control
    with pytest.raises(SceneError, match=r"must not hold `mass\.target`, because it moves the slip of the sticking `relay`"):
        linearise(plant, mode={"relay": "stick"}, inputs="mass.target")


# ------------------------------------------------------------------------------------------------------------------------------ steady states
def test_with_coulomb_friction_the_steady_speed_is_torque_left_over_drag():
    plant = compose(wells.JANSEN_2, BitRock(friction=Coulomb(static=0.6, kinetic=0.5)))
    point = equilibrium(closed_loop(plant, inputs={"top.torque": 12_000.0, "bit.weight": 80_000.0}))
    speed = (12_000.0 - 80_000.0 * 0.155575 * 0.5) / (CR + CB)
    assert point["bit.speed"] == pytest.approx(speed, rel=1e-14)
    assert point["chain.twist"] == pytest.approx((12_000.0 - CR * speed) / K, rel=1e-13)
    assert point.modes == {"bit": "slip+"}
    assert "bit in slip+" in str(point) and "bit.speed" in str(point)


def test_falling_friction_has_two_steady_speeds_and_the_fast_one_is_found_without_a_start(rig):
    def balance(w):
        return 475.0 * w + TORQUE * (0.5 + 0.3 * math.exp(-0.9 * w)) - 10_000.0

    fast = equilibrium(closed_loop(rig, inputs={"top.torque": 10_000.0}))
    slow = equilibrium(closed_loop(rig, inputs={"top.torque": 10_000.0}), guess={"bit.speed": 1.0, "top.speed": 1.0})
    assert slow["bit.speed"] < 2.39 < fast["bit.speed"]  # friction and drag together are least there
    for point in (fast, slow):
        assert balance(point["bit.speed"]) == pytest.approx(0.0, abs=1e-8)
    assert (linearise(rig, slow).poles().real > 0).any()


def test_backwards_is_the_mirror_image_of_forwards(rig):
    forwards, backwards = (equilibrium(closed_loop(rig, inputs={"top.torque": t})) for t in (12_000.0, -12_000.0))
    assert backwards["bit.speed"] == pytest.approx(-forwards["bit.speed"], rel=1e-13)
    assert backwards.modes == {"bit": "slip-"}
    np.testing.assert_allclose(linearise(rig, backwards).A, linearise(rig, forwards).A, rtol=1e-12)


def test_a_parked_bit_is_a_steady_state_up_to_the_static_bound(rig):
    point = equilibrium(closed_loop(rig, inputs={"top.torque": 9500.0}), mode={"bit": "stick"})
    assert point["bit.speed"] == 0.0 and point["top.speed"] == 0.0
    assert point["bit.torque"] == pytest.approx(9500.0, rel=1e-13)
    with pytest.raises(SceneError, match="`bit` in stick needs a force of 12500 N m, but its bound is 12116"):
        equilibrium(closed_loop(rig, inputs={"top.torque": 12_500.0}), mode={"bit": "stick"})


def test_where_no_steady_state_exists_the_error_says_what_still_moves(rig):
    with pytest.raises(SceneError, match=r"There is no steady state for top\.torque = 9000.* with `bit` in slip\+: .*still changes by"):
        equilibrium(closed_loop(rig, inputs={"top.torque": 9000.0}))
    with pytest.raises(SceneError, match=r"the only state found contradicts its mode: `bit` in slip- has the slip .* rad/s"):
        equilibrium(
            closed_loop(compose(wells.JANSEN_2, BitRock(friction=Coulomb())), inputs={"top.torque": 20_000.0}), mode={"bit": "slip-"}
        )
    with pytest.raises(SceneError, match=r"`cart\.speed` still changes by 2 m/s per second"):
        equilibrium(closed_loop(compose(Drift()), inputs={"cart.push": 2.0}))
    with pytest.raises(SceneError, match=r"block\.position"):  # carried along by the belt
        equilibrium(compose(BlockOnBelt()), mode={"belt": "stick"})


def test_a_steady_state_that_is_free_to_be_anywhere_is_accepted():
    point = equilibrium(compose(Drift()), guess={"cart.position": 4.0})
    assert point["cart.position"] == 4.0 and point["cart.speed"] == 0.0


def test_a_long_chain_and_a_stiff_law_still_find_their_steady_state():
    n = 60
    chain = TorsionalChain(inertia=(50.0,) * n, stiffness=(3e4,) * (n - 1), damping=(5.0,) * (n - 1), top_drag=425.0, bit_drag=50.0)
    plant = compose(chain, BitRock(friction=Exponential(0.8, 0.5, 1e4)))
    point = equilibrium(closed_loop(plant, inputs={"top.torque": 10_000.0}))
    assert point["bit.speed"] == pytest.approx((10_000.0 - TORQUE * 0.5) / 475.0, rel=1e-11)
    assert linearise(plant, point).nstates == 2 * n - 1


# ------------------------------------------------------------------------------------------------------------------------ points and borders
def test_a_point_may_be_a_mapping_a_steady_state_or_an_instant_of_a_run(rig):
    run = simulate(rig, 12.0, inputs={"top.torque": 12_000.0})
    slipping, stuck = run.at(6.0), run.at(2.0)
    assert run.events[0].time > 2.0
    same = linearise(
        rig, {"chain.twist.0": slipping["chain.twist"][0], "top.speed": slipping["top.speed"], "bit.speed": slipping["bit.speed"]}
    )
    np.testing.assert_array_equal(linearise(rig, slipping).A, same.A)
    assert linearise(rig, stuck).nstates == 2
    assert linearise(rig, stuck, outputs="bit.torque").noutputs == 1


def test_a_point_of_a_controlled_run_serves_the_plant_alone(rig):
    run = simulate(rig, 10.0, controller=lambda t, y: 12_000.0, sample_time=0.1)
    assert run.at(6.05)["bit.speed"] > 1.0
    np.testing.assert_allclose(linearise(rig, run.at(6.05)).A, linearise(rig, {"bit.speed": run.at(6.05)["bit.speed"]}).A)


def test_inputs_given_with_values_set_the_point(rig):
    heavy = linearise(closed_loop(rig, inputs={"bit.weight": 2 * 97_347.0}), {"bit.speed": 2.0}, outputs="bit.speed")
    light = linearise(rig, {"bit.speed": 2.0, "bit.weight": 97_347.0}, outputs="bit.speed")
    slope = -TORQUE * 0.3 * 0.9 * math.exp(-1.8)
    assert light.A[2, 2] - heavy.A[2, 2] == pytest.approx(slope / J2, rel=1e-12)
    overridden = linearise(closed_loop(rig, parameters={"bit.weight": 2 * 97_347.0}), {"bit.speed": 2.0})
    np.testing.assert_allclose(overridden.A, heavy.A, rtol=1e-15)


def test_a_plant_with_other_parameters_is_linearised_with_them(rig):
    point = equilibrium(closed_loop(rig, inputs={"top.torque": 12_000.0}, parameters={"chain.top_drag": 500.0}))
    assert linearise(rig, point).A[1, 1] == pytest.approx(-(C12 + 500.0) / J1, rel=1e-14)
    assert linearise(rig, {"bit.speed": 5.0}).A[1, 1] == pytest.approx(-(C12 + CR) / J1, rel=1e-14)


@pytest.mark.filterwarnings("default")  # python-control falls back to another class where numpy's deprecations are errors
def test_the_result_is_at_home_in_python_control(rig):
    system = linearise(rig, {"bit.speed": 9.0}, inputs="top.torque", outputs="top.speed")
    loop = control.feedback(system * control.ss([[0.0]], [[1.0]], [[1500.0]], [[4000.0]]), 1)
    assert loop.poles().real.max() < 0
    named = control.interconnect(
        [
            linearise(rig, {"bit.speed": 9.0}, outputs=["top.speed", "bit.speed"]),
            control.ss([], [], [], [[-100.0]], inputs="bit_speed", outputs="top_torque", name="law"),
        ],
        inputs="bit_weight",
        outputs="top_speed",
    )
    assert named.nstates == 3


def test_bad_arguments_are_refused_by_name(rig):
    other = equilibrium(closed_loop(compose(replace(wells.NAVARRO_LOPEZ_4), BitRock()), inputs={"top.torque": 12_000.0}))
    run = simulate(rig, 1.0)
    law = compose(Drift())
    refused = [
        (lambda: linearise("rig"), "Argument `loop` must be a plant made by `compose`"),
        (lambda: equilibrium(closed_loop(rig, inputs={"top.torqe": 1.0})), r"There is no input `top\.torqe`: did you mean `top\.torque`"),
        (lambda: equilibrium(closed_loop(rig, inputs={"bit.speed": 1.0})), "must not be an input"),
        (lambda: equilibrium(closed_loop(rig, inputs={"top.torque": math.nan})), "must be a finite number"),
        (lambda: equilibrium(closed_loop(rig, inputs={"bit.weight": -1.0})), r"Argument `bit\.weight` must be >= 0"),
        (lambda: equilibrium(rig, mode={"bitt": "stick"}), "There is no element `bitt`"),
        (lambda: equilibrium(rig, mode={"bit": "slide"}), "must be stick, slip. or slip- for `bit`"),
        (lambda: linearise(rig, {"bit.sped": 1.0}), r"There is no state `bit\.sped`"),
        (lambda: linearise(rig, {"top.load": 1.0}), "must be a state to be given a start value"),
        (lambda: linearise(rig, {"bit.speed": 1.0}, mode={"bit": "slip-"}), "`bit` in slip- has the slip 1 rad/s"),
        (lambda: linearise(rig, {"bit.speed": 1.0}, mode={"bit": "stick"}), "`bit` in stick has the slip 1 rad/s"),
        (lambda: linearise(rig, {"chain.twist": [100.0]}, mode={"bit": "stick"}), "needs a force of 47300 N m"),
        (lambda: linearise(rig, 3.0), "Argument `at` must be a mapping"),
        (lambda: linearise(rig, other), "belongs to another plant"),
        (lambda: linearise(rig, run), "must be one instant of a run"),
        (lambda: linearise(law, run.at(0.5)), r"must hold the state `cart\.position`"),
        (lambda: linearise(rig, outputs="bit.sped"), r"There is no signal `bit\.sped`"),
        (lambda: linearise(rig, inputs=["top.speed"]), r"There is no input `top\.speed`"),
        (lambda: equilibrium(closed_loop(rig, inputs={"top.torque": 1e4}))["bit.sped"], r"There is no signal `bit\.sped`"),
        (lambda: linearise(simulate(rig, 1.0, controller=lambda t, y: 0.0, sample_time=0.1).program.system), "must not hold sampled laws"),
    ]
    for call, message in refused:
        with pytest.raises(SceneError, match=message):
            call()


def test_importing_it_loads_neither_control_nor_scipy():
    code = "import sys, toolbox.steady_states.linear, toolbox.measure; print([m for m in ('control', 'scipy', 'matplotlib') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("law", [StiffPI, SoftTorque])
@pytest.mark.parametrize("reference", [3.0, 8.0, 14.0])
def test_a_law_with_torque_limits_has_the_steady_state_that_it_has_without_where_they_do_not_bind(law, reference):
    # full steps of Newton jump from one limit to the other and find nothing
    states = []
    for limits in ({}, {"lowest_torque": 0.0, "highest_torque": 20e3}):
        states.append(equilibrium(closed_loop(RIG, law(reference=reference, **limits))).states)
    np.testing.assert_allclose(states[1], states[0], rtol=1e-9)
    assert states[1][1] == pytest.approx(reference, rel=1e-12)


def test_a_law_closes_the_loop_of_a_steady_state_and_of_its_linear_system(rig):
    """Poles of [twist, top speed, bit speed, angle of the PI] from the matrix written by hand; a run that begins there stays there."""
    law, w = PI(reference=8.0, proportional=2000.0, integral=700.0), 8.0
    rest = equilibrium(closed_loop(rig, law, inputs={"top.reference": w}))
    assert rest["bit.speed"] == pytest.approx(w, rel=1e-9)
    load = TORQUE * (0.5 + 0.3 * math.exp(-0.9 * w)) + CB * w
    assert rest["pi.angle"] * 700.0 == pytest.approx(CR * w + load, rel=1e-9)
    fall = TORQUE * 0.3 * 0.9 * math.exp(-0.9 * w)
    matrix = [
        [0, 1, -1, 0],
        [-K / J1, -(C12 + CR + 2000.0) / J1, C12 / J1, 700.0 / J1],
        [K / J2, C12 / J2, -(C12 + CB - fall) / J2, 0],
        [0, -1, 0, 0],
    ]
    by_hand = np.sort_complex(np.linalg.eigvals(matrix))
    for at in (rest, {"chain.speed": w}):
        closed = linearise(closed_loop(rig, law), at=at, mode={"bit": "slip+"})
        np.testing.assert_allclose(np.sort_complex(closed.poles()), by_hand, rtol=1e-7)
        assert closed.input_labels == ["bit_weight", "top_reference"]
    run = simulate(rig, 20.0, start=rest, controller=law)
    assert np.abs(run["bit.speed"] - w).max() < 1e-6 and run.events == []
    for verb in (equilibrium, linearise):
        with pytest.raises(SceneError, match="continuous form|must have continuous controllers"):
            verb(closed_loop(rig, lambda t, y: 0.0, sample_time=0.1))


def test_a_plant_is_linearised_where_a_loop_holds_it(rig):
    """The plant alone at the steady state of a loop, against matrices written by hand; closed by the law again it has the poles of the loop."""
    law, w = PI(reference=8.0, proportional=2000.0, integral=700.0), 6.0
    for weight in (TORQUE / 0.155575, 0.8 * TORQUE / 0.155575):
        rest = equilibrium(closed_loop(rig, law, inputs={"top.reference": w, "bit.weight": weight}))
        alone = linearise(rig, at=rest, inputs="top.torque", outputs=["top.speed", "bit.speed"])
        fall = weight * 0.155575 * 0.3 * 0.9 * math.exp(-0.9 * w)
        matrix = [[0, 1, -1], [-K / J1, -(C12 + CR) / J1, C12 / J1], [K / J2, C12 / J2, -(C12 + CB - fall) / J2]]
        np.testing.assert_allclose(alone.A, matrix, rtol=1e-7, atol=1e-12)
        np.testing.assert_allclose(alone.B, [[0], [1 / J1], [0]], rtol=1e-12)
        assert alone.state_labels == ["chain_twist[0]", "chain_speed[0]", "chain_speed[1]"] and alone.input_labels == ["top_torque"]
        speed, torque = alone.C[:1], alone.B  # u = -2000 y - 700 z with z' = y
        closed = np.block([[alone.A - 2000.0 * torque @ speed, -700.0 * torque], [speed, np.zeros((1, 1))]])
        np.testing.assert_allclose(
            np.sort_complex(np.linalg.eigvals(closed)), np.sort_complex(linearise(closed_loop(rig, law), at=rest).poles()), rtol=1e-6
        )
    heavier = equilibrium(closed_loop(rig, law, parameters={"chain.stiffness": (2 * K,)}))
    assert linearise(rig, at=heavier).A[1, 0] == pytest.approx(-2 * K / J1, rel=1e-12)  # its numbers are those of the loop
    with pytest.raises(SceneError, match="or of a loop with it, but it belongs to another plant"):
        linearise(rig, at=equilibrium(compose(BlockOnBelt())))
    with pytest.raises(SceneError, match="belongs to another plant"):
        linearise(compose(wells.NAVARRO_LOPEZ_4, BitRock()), at=rest)
