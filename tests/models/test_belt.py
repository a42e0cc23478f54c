"""Oscillators on belts and on the ground against their closed forms (Den Hartog 1931, Leine 1998, Thomsen and Fidlin 2003)."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from models import BlockOnBelt, Coulomb, CubicStribeck, Hyperbolic
from toolbox import compose, simulate, time


def switches(run, before, after):
    return np.array([event.time for event in run.events if (event.before, event.after) == (before, after)])


def lengths(run, mode):
    """Lengths of all intervals in a mode but the last of the run."""
    return np.array([end - begin for begin, end, word in run.intervals("belt")[:-1] if word == mode])


# --- Coulomb friction on a belt: m x'' + k x = F, belt speed v


@pytest.mark.parametrize("z", [0.01, 0.3, 1.0, 3.0, 30.0])
@pytest.mark.parametrize(("mass", "stiffness"), [(1.0, 1.0), (2.0, 50.0), (1e-3, 4000.0)])
def test_stick_and_slip_of_a_block_with_coulomb_friction_last_as_long_as_the_closed_form_says(z, mass, stiffness):
    # z = (F_s - F_k) w_n / (k v);  t_slip = (2 / w_n)(pi - arctan z);  t_stick = 2 z / w_n;  T / T_n = 1 + (z - arctan z) / pi
    w_n, speed, kinetic = math.sqrt(stiffness / mass), 0.3, 2.0
    static = kinetic + z * stiffness * speed / w_n
    plant = compose(BlockOnBelt(mass=mass, stiffness=stiffness, belt_speed=speed, friction=Coulomb(static=static, kinetic=kinetic)))
    period = (2 * math.pi / w_n) * (1 + (z - math.atan(z)) / math.pi)
    caught = (2 * kinetic - static) / stiffness  # where it sticks again, mirrored about the kinetic equilibrium
    run = simulate(plant, 8.5 * period, start={"block.position": caught, "block.speed": speed}, accuracy=1e-11)
    slip, stick = lengths(run, "slip-"), lengths(run, "stick")
    assert len(slip) == 8 and len(stick) in (8, 9)
    assert "slip+" not in run.modes["belt"]
    # accuracy 1e-11 of states; a switch is late by the error of the state over its rate
    np.testing.assert_allclose(slip, (2 / w_n) * (math.pi - math.atan(z)), rtol=1e-8)
    np.testing.assert_allclose(stick, 2 * z / w_n, rtol=1e-8, atol=1e-9 / w_n)
    np.testing.assert_allclose(np.diff(switches(run, "stick", "slip-")), period, rtol=1e-8)


def test_a_block_leaves_the_belt_where_the_spring_pulls_with_the_static_force():
    run = simulate(compose(BlockOnBelt(stiffness=2.0, friction=Coulomb(static=1.0, kinetic=0.6))), 60.0, accuracy=1e-11)
    left = switches(run, "stick", "slip-")
    assert len(left) >= 5
    np.testing.assert_allclose(run.at(left)["block.position"], 1.0 / 2.0, rtol=1e-10)
    np.testing.assert_array_equal(run.at(left)["block.speed"], 0.2)  # projected: the belt's speed to the last bit


def test_a_block_sticks_again_mirrored_about_the_kinetic_equilibrium():
    # while slipping the block swings about x_k = F_k / k and meets the belt's speed again at 2 x_k - x_s
    run = simulate(compose(BlockOnBelt(friction=Coulomb(static=1.0, kinetic=0.6))), 60.0, accuracy=1e-11)
    stuck = switches(run, "slip-", "stick")[1:]
    np.testing.assert_allclose(run.at(stuck)["block.position"], 2 * 0.6 - 1.0, atol=1e-9)


def test_static_equal_to_kinetic_friction_gives_no_stick_slip_but_a_harmonic_swing():
    # z = 0: after the first release the block swings about F / k with amplitude v / w_n and only touches the belt's speed
    run = simulate(compose(BlockOnBelt(belt_speed=0.5, friction=Coulomb(static=1.0, kinetic=1.0))), 40.0, accuracy=1e-9)
    released = switches(run, "stick", "slip-")[0]
    times = np.linspace(released, 40.0, 400)
    np.testing.assert_allclose(run.at(times)["block.position"], 1.0 + 0.5 * np.sin(times - released), atol=1e-6)


# --- Coulomb friction on the ground


@pytest.mark.parametrize("static", [0.04, 0.05])
def test_free_decay_loses_four_f_over_k_per_cycle_and_stops_inside_the_dead_zone(static):
    # turning points x_n = (-1)^n (x_0 - 2 n F / k) at t_n = n pi / w_n; the first with |x_n| <= F_s / k is the last
    mass, stiffness, kinetic, x0 = 2.0, 8.0, 0.04, 0.0983
    plant = compose(BlockOnBelt(mass=mass, stiffness=stiffness, belt_speed=0.0, friction=Coulomb(static=static, kinetic=kinetic)))
    run = simulate(plant, 40.0, start={"block.position": x0}, accuracy=1e-11)
    loss, half = 2 * kinetic / stiffness, math.pi / math.sqrt(stiffness / mass)
    stops = next(n for n in range(100) if abs(x0 - n * loss) <= static / stiffness)
    turning = switches(run, "slip-", "slip+").tolist() + switches(run, "slip+", "slip-").tolist()
    turning = sorted(turning + [event.time for event in run.events if event.after == "stick"])
    np.testing.assert_allclose(turning, half * np.arange(1, stops + 1), rtol=1e-9)
    n = np.arange(1, stops + 1)
    np.testing.assert_allclose(run.at(turning)["block.position"], (-1.0) ** n * (x0 - n * loss), atol=1e-10)
    assert run.intervals("belt")[-1][2] == "stick"
    assert run.at(40.0)["block.speed"] == 0.0
    assert run.at(40.0)["block.position"] == run.at(turning[-1])["block.position"]  # it never creeps


def test_the_energy_lost_in_free_decay_is_the_friction_force_times_the_way():
    plant = compose(BlockOnBelt(mass=2.0, stiffness=8.0, belt_speed=0.0, friction=Coulomb(static=0.04, kinetic=0.04)))
    run = simulate(plant, 40.0, start={"block.position": 0.1}, accuracy=1e-11)
    turning = [0.0, *(event.time for event in run.events), 40.0]
    x = run.at(turning)["block.position"]
    lost = 4.0 * (x[0] ** 2 - x[-1] ** 2)
    assert lost == pytest.approx(0.04 * np.abs(np.diff(x)).sum(), rel=1e-9)


def test_without_friction_the_same_block_keeps_its_amplitude():
    plant = compose(BlockOnBelt(mass=2.0, stiffness=8.0, belt_speed=0.0, load=0.0, friction=Coulomb()))
    run = simulate(plant, 40.0, start={"block.position": 0.1}, accuracy=1e-9)
    times = np.linspace(0, 40, 300)
    np.testing.assert_allclose(run.at(times)["block.position"], 0.1 * np.cos(2 * times), atol=1e-9)


@pytest.mark.parametrize("r", [0.6, 0.8, 1.3, 2.0])
def test_den_hartogs_amplitude_of_motion_without_stops(r):
    # m x'' + k x + F sgn x' = P cos wt;  r = w / w_n;  V = 1 / (1 - r^2);  U = sin(pi/r) / (r (1 + cos(pi/r)));
    # x0 = (P / k) sqrt(V^2 - (F/P)^2 U^2)
    mass, stiffness, force, friction = 2.0, 18.0, 5.0, 1.0
    w = r * math.sqrt(stiffness / mass)
    f, v, u = friction / force, 1 / (1 - r * r), math.sin(math.pi / r) / (r * (1 + math.cos(math.pi / r)))
    amplitude = force / stiffness * math.sqrt(v * v - f * f * u * u)
    plant = compose(BlockOnBelt(mass=mass, stiffness=stiffness, belt_speed=0.0, friction=Coulomb(static=friction, kinetic=friction)))
    cycles = 200
    run = simulate(plant, cycles * 2 * math.pi / w, inputs={"block.force": force * ca.cos(w * time)}, accuracy=1e-9)
    late = (cycles - 12) * 2 * math.pi / w
    assert run.time_in("belt", "stick", after=late) == 0.0
    top = switches(run, "slip+", "slip-")
    top = top[top > late]
    np.testing.assert_allclose(np.diff(top), 2 * math.pi / w, rtol=1e-5)
    # what is left of the start decays by friction alone
    np.testing.assert_allclose(run.at(top)["block.position"], amplitude, rtol=1e-4)


def test_a_force_too_weak_for_the_friction_moves_nothing():
    plant = compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=1.0, kinetic=1.0)))
    run = simulate(plant, 50.0, inputs={"block.force": 0.999 * ca.cos(0.7 * time)})
    assert run.time_in("belt", "stick") == 50.0
    assert run.at(49.0)["block.position"] == 0.0


# --- Leine et al. 1998


def leines_slip(accuracy=1e-13):
    """Time and end of one slip phase of Leine's oscillator from (1, 0.2), by scipy."""

    def rate(t, y):
        x, v = y
        return [v, 1 / (1 + 3 * max(0.2 - v, -0.1)) - x]

    def caught(t, y):
        return y[1] - 0.2 if t > 0.1 else -1.0

    caught.terminal, caught.direction = True, 1
    run = solve_ivp(rate, (0, 20), [1.0, 0.2], method="DOP853", rtol=accuracy, atol=accuracy, events=caught, max_step=0.05)
    return run.t_events[0][0], run.y_events[0][0][0]


def test_leines_block_repeats_its_cycle_to_the_last_digits():
    run = simulate(compose(BlockOnBelt()), 100.0, accuracy=1e-10)
    left, stuck = switches(run, "stick", "slip-"), switches(run, "slip-", "stick")
    assert len(left) >= 7
    np.testing.assert_allclose(run.at(left)["block.position"], 1.0, rtol=1e-10)  # k x = F_s
    # every release starts from the same state (1, v_belt), so every cycle is the same
    np.testing.assert_allclose(np.diff(left), np.diff(left)[0], rtol=1e-8)
    np.testing.assert_allclose(np.diff(stuck)[1:], np.diff(left)[0], rtol=1e-8)


def test_leines_cycle_agrees_with_an_independent_integration():
    duration, caught = leines_slip()
    run = simulate(compose(BlockOnBelt()), 100.0, accuracy=1e-10)
    stuck = switches(run, "slip-", "stick")[1:]  # the first cycle starts from rest
    np.testing.assert_allclose(lengths(run, "slip-")[1:], duration, rtol=1e-8)
    np.testing.assert_allclose(run.at(stuck)["block.position"], caught, atol=1e-8)
    np.testing.assert_allclose(lengths(run, "stick")[1:], (1 - caught) / 0.2, rtol=1e-8)  # carried by the belt to k x = F_s


def test_the_speed_of_leines_block_in_stick_is_the_speed_of_the_belt():
    run = simulate(compose(BlockOnBelt()), 100.0)
    stuck = run.modes["belt"] == "stick"
    assert stuck.any()
    np.testing.assert_array_equal(run["block.speed"][stuck], 0.2)
    np.testing.assert_array_equal(run["belt.slip"][stuck], 0.0)


# --- Thomsen and Fidlin 2003: x'' + 2 beta x' + x + g2 mu(x' - v_b) = 0

STATIC, MINIMUM, SPEED = 0.4, 0.25, 0.5


def hopf(beta, gamma):
    """v_b1, the belt speed below which the equilibrium loses its damping."""
    return SPEED * math.sqrt(1 - 4 * beta * SPEED / (3 * gamma * (STATIC - MINIMUM)))


def thomsen_fidlin(ratio, start, duration, gamma=1.0, beta=0.05):
    """Run at belt speed ratio * v_b1 from `start` beside the equilibrium; also its position, friction against the moving belt."""
    law = CubicStribeck(static=STATIC, minimum=MINIMUM, minimum_speed=SPEED)
    speed = ratio * hopf(beta, gamma)
    plant = compose(BlockOnBelt(damping=2 * beta, load=gamma, belt_speed=speed, friction=law))
    rest = gamma * float(law.sliding(speed))
    run = simulate(plant, duration, start={"block.position": rest + start}, accuracy=1e-8)
    return run, rest


def amplitude(run, rest, after, until):
    return np.abs(run.at(np.linspace(after, until, 2000))["block.position"] - rest).max()


def test_above_the_hopf_speed_a_slipping_block_comes_to_rest():
    run, rest = thomsen_fidlin(1.05, 0.05, 400.0)
    assert run.events == []
    assert amplitude(run, rest, 390, 400) < 0.1 * amplitude(run, rest, 0, 10)


def test_just_below_the_hopf_speed_the_same_block_does_not_come_to_rest():
    run, rest = thomsen_fidlin(0.97, 0.01, 2000.0)
    assert amplitude(run, rest, 1990, 2000) > 5 * amplitude(run, rest, 0, 10)


@pytest.mark.parametrize("ratio", [0.92, 0.95, 0.98])
def test_between_the_two_critical_speeds_the_block_slips_with_the_amplitude_of_first_order(ratio):
    # v_b0 = sqrt(4/5) v_b1 = 0.894 v_b1 < v_b < v_b1: pure slip, A = 2 sqrt(v_b1^2 - v_b^2)
    first_order = 2 * hopf(0.05, 1.0) * math.sqrt(1 - ratio**2)
    deviations = []
    for small in (0.2, 0.05):  # scales friction and damping alike, which leaves v_b1 and A and is what "first order" neglects
        # the rate at which the amplitude settles is about 2 small beta (1 - ratio^2) / (v_m^2 / v_b1^2 - 1), here > 4e-3 small
        run, rest = thomsen_fidlin(ratio, 0.9 * first_order, 1500.0 / small, gamma=small, beta=0.05 * small)
        end = run.duration
        assert run.time_in("belt", "stick", after=end / 2) == 0.0
        deviations.append(amplitude(run, rest, end - 50, end) / first_order - 1)
    assert abs(deviations[1]) < 0.01
    assert abs(deviations[1]) < 0.5 * abs(deviations[0])


def test_below_the_lower_critical_speed_the_block_sticks_and_slips():
    run, _ = thomsen_fidlin(0.8, 0.05, 1500.0)
    assert run.time_in("belt", "stick", after=1400.0) > 1.0
    assert run.time_in("belt", "slip-", after=1400.0) > 1.0


def test_a_belt_without_the_falling_part_of_the_law_never_sticks():
    run = simulate(compose(BlockOnBelt(damping=0.1, friction=Hyperbolic(static=1.0, decay=0.0))), 300.0)
    assert run.time_in("belt", "stick", after=100.0) == 0.0
    assert abs(run.at(300.0)["block.speed"]) < 1e-5
