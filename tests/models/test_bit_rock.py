"""Laws of the rock under the bit against their formulas: the smooth law, and hysteresis that is implicit in the acceleration."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import brentq

from models import BitRock, Coulomb, Exponential, HystereticBitRock, SmoothBitRock, SmoothHystereticBitRock, TorsionalChain, wells
from models.hysteretic_bit_rock import acceleration
from toolbox import SceneError, compose, energy_audit, simulate
from toolbox.measure import severity

WEIGHT, RADIUS, INERTIA = 97_347.0, 0.155575, 471.9698
PUSH = {"top.torque": 10_000.0}


def smooth(w):
    return WEIGHT * 0.0239 * (np.tanh(1.910 * w) + 8.5 * w / (1 + 5.470 * w**2))


def acceleration_of_bit(run):
    """w' = M/J - T/J at the nodes of a run, from the signals alone."""
    return run["bit.free_acceleration"] - run["bit.torque"] / run["bit.inertia"]


def free_bit(rock, inertia=400.0):
    """A bit that nothing but the rock acts on: a chain without stiffness."""
    return compose(TorsionalChain(inertia=(1.0, inertia), stiffness=(0.0,), damping=(0.0,)), rock)


def test_the_smooth_law_has_the_published_torque_at_every_speed():
    plant = free_bit(SmoothBitRock())
    for speed in (-8.0, -0.4, 0.0, 0.43, 2.0, 30.0):
        torque = simulate(plant, 0.0, start={"bit.speed": speed}).at(0.0)["bit.torque"]
        assert torque == pytest.approx(float(smooth(speed)), rel=1e-14)
    # W b0 is what is left at high speed, less than 1 % above it at 160 rad/s
    assert smooth(160.0) == pytest.approx(WEIGHT * 0.0239, rel=0.01)


def test_a_smooth_bit_under_a_load_below_its_peak_creeps_where_a_set_valued_one_stands():
    load = 0.5 * float(smooth(0.43))
    creep = simulate(compose(wells.JANSEN_2, SmoothBitRock()), 200.0, inputs={"top.torque": load}).at(200.0)["bit.speed"]
    expected = brentq(lambda w: smooth(w) + (425.0 + 50.0) * w - load, 0.0, 0.43)
    assert creep == pytest.approx(expected, rel=1e-3) and creep > 0.05
    stands = simulate(compose(wells.JANSEN_2, BitRock()), 200.0, inputs={"top.torque": load})
    assert stands.time_in("bit", "stick") == 200.0


@pytest.mark.parametrize("stiff", [0.0, 1e-3, 1.0, 30.0, 1e3, 1e4])
def test_the_acceleration_solves_its_equation_to_round_off(stiff):
    # z + A tanh z = C, with q = z / steepness; the root is set first, so that the reference needs no solver
    steepness = 0.5
    roots = np.concatenate([-np.logspace(-9, 3, 400), [0.0], np.logspace(-9, 3, 400)])
    swing = stiff / steepness
    free, q = ca.SX.sym("free"), roots / steepness
    solve = ca.Function("solve", [free], [acceleration(free, ca.SX(swing), ca.SX(steepness))]).map(roots.size)
    found = np.array(solve((q + swing * np.tanh(roots))[None, :])).ravel()
    # C cannot hold z better than its own round-off, which grows with A where tanh has saturated
    np.testing.assert_allclose(found, q, rtol=1e-13, atol=4e-16 * swing)


@pytest.mark.parametrize(
    "rock",
    [HystereticBitRock(hysteresis_steepness=0.05), HystereticBitRock(hysteresis_steepness=20.0, hysteresis_fraction=0.4)],
    ids=["mild", "steep"],
)
def test_the_torque_of_a_sliding_bit_is_that_of_its_own_acceleration(rock):
    plant = compose(wells.NAVARRO_LOPEZ_4, rock)
    run = simulate(plant, 60.0, inputs={"top.torque": 12_000.0}, accuracy=1e-9)
    moves = run.modes["bit"] == "slip+"
    w, rate = run["bit.speed"][moves], acceleration_of_bit(run)[moves]
    assert moves.sum() > 100 and rate.min() < -0.5 < 0.5 < rate.max()
    base = WEIGHT * RADIUS * (0.5 + 0.3 * np.exp(-0.9 * w))
    np.testing.assert_allclose(
        run["bit.torque"][moves], base * (1 + rock.hysteresis_fraction * np.tanh(rock.hysteresis_steepness * rate)), rtol=1e-10
    )


def test_the_smooth_hysteretic_torque_is_that_of_its_own_acceleration_in_both_directions():
    rock = SmoothHystereticBitRock(hysteresis_steepness=2.0)
    run = simulate(
        compose(wells.JANSEN_2, rock), 30.0, inputs={"top.torque": ((0.0, 15.0, 15.0, 30.0), (6000.0, 6000.0, -6000.0, -6000.0))}
    )
    w, rate = run["bit.speed"], acceleration_of_bit(run)
    assert w.min() < -1.0 < 1.0 < w.max()
    expected = smooth(w) + rock.hysteresis_fraction * np.abs(smooth(w)) * np.tanh(rock.hysteresis_steepness * rate)
    np.testing.assert_allclose(run["bit.torque"], expected, rtol=1e-10, atol=1e-8)


def first_release(rock, torque):
    return simulate(compose(wells.NAVARRO_LOPEZ_4, rock), 60.0, inputs={"top.torque": torque}, accuracy=1e-10).events[0]


def test_the_rate_form_breaks_off_where_the_plain_law_does_and_the_switched_form_on_its_upper_branch():
    plain, rate, switched = (
        first_release(rock, 16_000.0) for rock in (BitRock(), HystereticBitRock(hysteresis_steepness=0.5), HystereticBitRock())
    )
    raised = first_release(BitRock(friction=Exponential(static=0.8 * 1.2, kinetic=0.5)), 16_000.0)
    assert plain[1:] == rate[1:] == switched[1:] == ("bit", "stick", "slip+")
    assert rate.time == pytest.approx(plain.time, abs=1e-9)
    assert switched.time == pytest.approx(raised.time, abs=1e-9) and switched.time > plain.time + 0.1


@pytest.mark.parametrize(
    "rock",
    [HystereticBitRock(hysteresis_fraction=0.0), HystereticBitRock(hysteresis_fraction=0.0, hysteresis_steepness=1.0)],
    ids=["switched", "rate"],
)
def test_without_distance_between_the_branches_the_hysteretic_bit_is_the_plain_one(rock):
    plain, same = (simulate(compose(wells.NAVARRO_LOPEZ_4, each), 60.0, inputs=PUSH, accuracy=1e-9) for each in (BitRock(), rock))
    assert len(plain.events) == len(same.events) > 5
    np.testing.assert_allclose([e.time for e in same.events], [e.time for e in plain.events], atol=1e-6)


@pytest.mark.parametrize("rock", [HystereticBitRock(), SmoothHystereticBitRock()], ids=["set-valued", "smooth"])
def test_a_switched_bit_holds_its_speed_while_the_load_lies_between_the_branches(rock):
    start = {"chain.speed": 6.0, "chain.twist": (12.0, 10.0, 12.0)}
    run = simulate(compose(wells.NAVARRO_LOPEZ_4, rock), 20.0, start=start, inputs={"top.torque": 9000.0}, accuracy=1e-9)
    seen = run.at(np.linspace(0.0, 20.0, 401))
    w, load, rate = seen["bit.speed"], seen["bit.free_acceleration"] * INERTIA, acceleration_of_bit(seen)
    base = WEIGHT * RADIUS * (0.5 + 0.3 * np.exp(-0.9 * w)) if isinstance(rock, HystereticBitRock) else smooth(w)
    moves = w > 0
    high, low = moves & (load > base * 1.2), moves & (load < base * 0.8)
    held = moves & ~high & ~low
    assert min(high.sum(), low.sum(), held.sum()) > 5
    np.testing.assert_allclose(seen["bit.torque"][high], 1.2 * base[high], rtol=1e-12)
    np.testing.assert_allclose(seen["bit.torque"][low], 0.8 * base[low], rtol=1e-12)
    assert np.abs(rate[held]).max() < 1e-13 * base.max() / INERTIA


def test_a_steeper_rate_form_tends_to_the_switched_form():
    def end(beta1):
        plant = compose(wells.NAVARRO_LOPEZ_4, HystereticBitRock(hysteresis_steepness=beta1))
        start = {"chain.speed": 6.0, "chain.twist": (12.0, 8.0, 9.0)}
        return simulate(plant, 4.0, start=start, inputs={"top.torque": 9000.0}, accuracy=1e-9).at(np.linspace(0, 4, 200))["bit.speed"]

    gaps = [np.abs(end(beta1) - end(None)).max() for beta1 in (2.0, 20.0, 200.0)]
    assert gaps[0] > 4 * gaps[1] > 16 * gaps[2]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("beta1", [0.1, 1e3])
def test_a_bit_left_alone_stops_on_the_lower_branch(beta1, sign):
    # Coulomb: J q = -T_k (1 - beta0 tanh(beta1 |q|)) is constant, so the speed is a straight line to the stop
    rock = HystereticBitRock(hysteresis_fraction=0.3, hysteresis_steepness=beta1, friction=Coulomb(static=0.6, kinetic=0.5))
    torque = 0.5 * WEIGHT * RADIUS
    q = brentq(lambda q: 400.0 * q - torque * (1 - 0.3 * math.tanh(beta1 * q)), 0.0, torque / 400.0)
    run = simulate(free_bit(rock), 2.0, start={"bit.speed": 5.0 * sign}, accuracy=1e-10)
    assert [(e.before, e.after) for e in run.events] == [("slip+" if sign > 0 else "slip-", "stick")]
    assert run.events[0].time == pytest.approx(5.0 / q, rel=1e-9)
    if beta1 > 100:  # the branches are then (1 +- beta0) T_k
        assert q == pytest.approx(torque * 0.7 / 400.0, rel=1e-12)


def test_the_torque_runs_round_a_loop_upper_branch_first():
    # the work lost in the loop between speeding up and slowing down is positive: hysteresis takes energy
    run = simulate(
        compose(wells.NAVARRO_LOPEZ_4, HystereticBitRock(hysteresis_steepness=5.0)),
        3.0,
        start={"chain.speed": 10.0, "chain.twist": (12.0, 10.0, 20.0)},
    )
    rate, torque, w = acceleration_of_bit(run), run["bit.torque"], run["bit.speed"]
    base = WEIGHT * RADIUS * (0.5 + 0.3 * np.exp(-0.9 * w))
    up, down = rate > 1.0, rate < -1.0
    assert up.sum() > 3 and down.sum() > 3
    assert np.all(torque[up] > base[up]) and np.all(torque[down] < base[down])


@pytest.mark.parametrize(
    "rock", [BitRock(), SmoothBitRock(), HystereticBitRock(), SmoothHystereticBitRock()], ids=lambda rock: type(rock).__name__
)
def test_the_energy_of_a_string_on_each_rock_closes(rock):
    plant = compose(wells.NAVARRO_LOPEZ_4, rock)
    audit = energy_audit(simulate(plant, 40.0, inputs={"top.torque": 12_000.0}, accuracy=1e-10))
    assert audit.relative < 1e-9
    assert audit.supplies["chain.bit torque"] < 0.0  # the rock only takes
    assert plant.x.numel() == 7  # no rock law adds a state
    assert len(plant.elements) == (0 if isinstance(rock, (SmoothBitRock, SmoothHystereticBitRock)) else 1)


def test_hysteresis_calms_the_stick_slip_that_the_plain_law_keeps():
    # more torque while speeding up and less while slowing down resists every change of speed, like an inertia that takes energy
    plain, hysteretic = (
        simulate(compose(wells.NAVARRO_LOPEZ_4, rock), 200.0, inputs=PUSH)
        for rock in (BitRock(), HystereticBitRock(hysteresis_steepness=0.5))
    )
    assert plain.time_in("bit", "stick", after=100.0) > 30.0 and severity(plain, after=100.0) > 1.0
    assert hysteretic.time_in("bit", "stick", after=100.0) == 0.0 and severity(hysteretic, after=100.0) < 0.1


def test_a_hysteretic_rock_needs_a_part_that_says_what_turns_the_bit():
    with pytest.raises(SceneError, match=r"bit\.(speed|free_acceleration|inertia)"):
        compose(HystereticBitRock(friction=Exponential()))
