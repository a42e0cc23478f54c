"""Stack of disks against linear theory, conservation laws, and the two disks that it must become."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.linalg import expm

from models import Coulomb, DiskStack, TwoDisks
from studies.questions import disk_stack as study
from studies.questions.disks import rest_of
from tests.refusals import each_of, refusals
from toolbox import compose, energy_audit, measure, simulate
from toolbox.inputs import ramp, step


@pytest.fixture(scope="module")
def stop():
    return study.stack_stop()


def turning(stack, speed):
    """Start of a stack whose wheel and rotors turn, closed under its full force."""
    rotors = np.arange(2 * stack.rotors + 1) % 2 == 1
    return {"stack.wheel_speed": speed, "stack.speed": np.where(rotors, speed, 0.0)}


def sliding(stack, speed, torque):
    """As `turning`, with every mount already wound up by the friction torque of its faces [N m]."""
    faces = np.where(np.isin(np.arange(2 * stack.rotors + 1), (0, 2 * stack.rotors)), 1, 2)
    rotors = np.arange(2 * stack.rotors + 1) % 2 == 1
    twist = faces * torque * np.where(rotors, -1 / stack.rotor_stiffness, 1 / stack.stator_stiffness)
    return turning(stack, speed) | {"stack.twist": twist}


def test_a_clamped_stack_stays_clamped_and_every_interface_carries_the_force_of_the_actuator():
    stack = DiskStack(rotors=3)
    run = simulate(compose(stack), 0.1, start=turning(stack, 1.0))
    assert np.all(run["stack.load"] == 1000.0)
    softly = simulate(compose(stack), 0.1, start={"stack.position": stack.static_positions(300.0)}, inputs={"stack.actuator_force": 300.0})
    np.testing.assert_allclose(softly["stack.load"], 300.0, rtol=1e-9)


def test_the_axial_motion_of_a_closed_stack_is_that_of_a_chain_of_springs():
    stack = DiskStack(rotors=2, axial_damping=0.0)
    frequencies = stack.axial_frequencies()
    assert frequencies.shape == (5,) and np.all(np.diff(frequencies) > 0)
    # one end free, one on a spring as stiff as the others: w_j = 2 sqrt(k / m) sin((2 j - 1) pi / (4 n + 2))
    expected = 2 * math.sqrt(1e7 / 2.0) * np.sin((2 * np.arange(1, 6) - 1) * math.pi / 22)
    np.testing.assert_allclose(frequencies, expected, rtol=1e-12)
    # a small step of force stays inside the closed range; matrix exponential of z'' = M^-1 (F - K z)
    n = 5
    stiffness = 1e7 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    stiffness[0, 0] = 1e7
    matrix = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness / 2.0, np.zeros((n, n))]])
    start, rest = stack.static_positions(900.0), stack.static_positions(1100.0)
    run = simulate(compose(stack), 0.02, start={"stack.position": start}, inputs={"stack.actuator_force": 1100.0}, accuracy=1e-10)
    for t in (0.003, 0.02):
        moved = expm(matrix * t) @ np.concatenate([start - rest, np.zeros(n)])
        np.testing.assert_allclose(run.at(t)["stack.position"], rest + moved[:n], atol=2e-8 * rest[0])


def test_faces_that_part_carry_nothing_and_lose_no_energy():
    # the actuator lets go: the stack springs back, its faces part and meet again
    stack = DiskStack(rotors=1, axial_damping=0.0)
    run = simulate(compose(stack), 0.05, inputs={"stack.actuator_force": 0.0}, accuracy=1e-10)
    load = run["stack.load"]
    assert load.min() == 0.0 and (load == 0.0).sum() > 10 and load.max() > 100.0
    audit = energy_audit(run)
    assert abs(audit.residual) < 1e-8 * audit.turnover
    before, after = next(iter(audit.stored.values()))
    assert after == pytest.approx(before, rel=1e-8)


@pytest.mark.parametrize("rotors", [1, 3])
def test_the_energy_of_a_stop_goes_where_the_parts_say(rotors):
    stack = DiskStack(rotors=rotors, wheel_inertia=40.0 * rotors)
    start = turning(stack, 1.0) | {"stack.position": stack.static_positions(500.0)}
    run = simulate(compose(stack), 1.2, start=start, inputs={"stack.torque": step(0.0, 50.0, 0.9)}, accuracy=1e-9)
    assert len(run.events) > 20
    audit = energy_audit(run)
    assert abs(audit.residual) < 1e-7 * audit.turnover


def test_the_wheel_and_its_rotors_lose_exactly_the_friction_of_all_interfaces():
    # Coulomb friction, no stick: momentum of wheel and rotors falls as 2 n N R mu, whatever the keys do
    stack = DiskStack(rotors=3, friction=Coulomb(static=0.3, kinetic=0.3))
    run = simulate(compose(stack), 0.5, start=sliding(stack, 3.0, 30.0), accuracy=1e-9)
    inertia = np.where(np.arange(7) % 2 == 1, 0.02, 0.0)
    momentum = 320.0 * run["stack.wheel_speed"] + run["stack.speed"] @ inertia
    assert all(set(run.modes[f"stack.{i}"]) == {"slip+"} for i in range(6))
    np.testing.assert_allclose(momentum, momentum[0] - 6 * 1000.0 * 0.1 * 0.3 * run.time, rtol=1e-9)


def test_each_interface_rubs_with_the_load_that_the_axial_motion_brings_it():
    stack = DiskStack(rotors=2, friction=Coulomb(static=0.3, kinetic=0.3))
    run = simulate(compose(stack), 0.02, start=sliding(stack, 30.0, 30.0),
                   inputs={"stack.actuator_force": ramp(1000.0, 3000.0, 0.0, 0.002)})  # fmt: skip
    load = run["stack.load"]
    assert np.ptp(load, axis=1).max() > 500.0
    for i in range(4):
        np.testing.assert_allclose(run[f"stack.{i}.force"], -0.3 * 0.1 * load[:, i], rtol=1e-12)


def test_a_stack_of_one_rotor_on_stiff_keys_stops_like_two_disks_with_both_faces():
    # mirror images: both stators move alike, so the pair is one stator of twice the inertia, stiffness, damping under twice the torque
    law = TwoDisks().friction
    stack = DiskStack(rotors=1, wheel_inertia=40.0, rotor_stiffness=2e8, rotor_damping=3000.0, stator_damping=0.5, friction=law)
    run = simulate(compose(stack), 0.3, start=turning(stack, 2.0), accuracy=1e-8)
    disks = TwoDisks(rotor_inertia=40.02, stator_inertia=0.04, stiffness=4000.0, damping=1.0, normal_force=2000.0, friction=law)
    pair = simulate(compose(disks), 0.3, start={"disks.rotor_speed": 2.0}, accuracy=1e-8)
    mine, theirs = measure.cycles(run, "stack.0"), measure.cycles(pair, "disks")
    assert len(mine) == len(theirs) > 8
    # the keys give by 60 N m / 2e8 N m/rad, 3e-7 rad against a swing of 0.02 rad
    np.testing.assert_allclose([cycle.period for cycle in mine], [cycle.period for cycle in theirs], rtol=1e-3)


def test_interfaces_stick_and_slip_on_their_own():
    run = study.stack_stop(DiskStack(rotors=4, wheel_inertia=160.0), speed=1.5)
    sets = {tuple(row) for row in np.array([run.modes[f"stack.{i}"] for i in range(8)]).T}
    assert len(sets) > 20


def test_stuck_interfaces_have_exactly_no_slip():
    stack = DiskStack(rotors=2)
    run = simulate(compose(stack), 0.5, start=turning(stack, 1.0))
    for i in range(4):
        stuck = run.modes[f"stack.{i}"] == "stick"
        assert stuck.any() and np.all(run[f"stack.{i}.slip"][stuck] == 0.0)


@pytest.mark.slow
def test_in_a_stop_slips_keep_their_duration_while_sticks_grow_until_the_last(stop):
    run = stop
    begin = study.phases(run)["stick-slip"][0]
    assert run.error_estimate < 1e-2
    early, late = [], []
    for i in range(16):
        found = measure.cycles(run, f"stack.{i}", after=begin, until=rest_of(run, "stack.wheel_speed"))
        n = len(found) // 5
        early += found[:n]
        late += found[-n:]
        assert max(cycle.stick for cycle in found) > 4 * np.median([cycle.stick for cycle in found])
    slips, sticks = ([np.median([getattr(cycle, what) for cycle in part]) for part in (early, late)] for what in ("slip", "stick"))
    assert slips[1] == pytest.approx(slips[0], rel=0.15)
    assert sticks[1] > 1.3 * sticks[0]


def test_without_falling_friction_a_stack_does_not_stick_before_its_wheel_rests():
    run = study.stack_stop(DiskStack(friction=Coulomb(static=0.3, kinetic=0.3)))
    captures = [event.time for event in run.events if event.after == "stick"]
    assert captures and min(captures) > 0.95 * rest_of(run, "stack.wheel_speed")


def test_axial_modes_show_in_the_torsional_spectrum_of_steady_slip(stop):
    run, stack = stop, DiskStack()
    frequency, density = study.spectrum(run, "stack.brake_torque", *study.phases(run)["steady slip"])
    modes = stack.axial_frequencies() / (2 * math.pi)
    for here, above in itertools.pairwise(modes[:3]):
        near, between = (density[np.abs(frequency - place) < 3.0].max() for place in (here, (here + above) / 2))
        assert near > 5 * between


test_wrong_uses_are_refused_in_these_words = refusals(
    *each_of(lambda rotors: compose(DiskStack(rotors=rotors)), r"Argument `rotors`.* must be an integer( >= 1)?, but it is ", [0, -1, 1.5, True]),
    *each_of(lambda force: DiskStack().static_positions(force), "force", [0.0, -1.0, math.nan, math.inf]),
)  # fmt: skip


@pytest.mark.slow
def test_a_stack_of_sixty_four_interfaces_brakes():
    stack = DiskStack(rotors=32, wheel_inertia=1280.0)
    run = simulate(compose(stack), 0.01, start=turning(stack, 2.0))
    assert run.end == 0.01 and len(run.modes) == 64
    assert 0.0 < run.at(0.01)["stack.wheel_speed"] < 2.0


@pytest.mark.slow
def test_many_interfaces_that_let_go_at_one_instant_do_not_chatter():
    # the wave of a step of force has not reached them yet: all inner disks are alike to round-off, and so are the limits of their interfaces
    stack = DiskStack(rotors=32)
    run = simulate(compose(stack), 0.02, start=turning(stack, 2.0) | {"stack.position": stack.static_positions(500.0)})
    assert run.end == 0.02
    assert any(event.before == "stick" and event.time < 0.0092 for event in run.events)
