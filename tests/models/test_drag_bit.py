"""Drag bits against closed forms: steady cutting, the delay of a prescribed motion, the characteristic equation, break-off, and the cut surface."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

from controllers import PI
from models import AxialChain, DragBit, TorsionalPendulum, wells
from models.drag_bit import radau
from toolbox import SceneError, compose, energy_audit, equilibrium, linearise, simulate
from toolbox.measuring.measure import extent

MASS, BIT = 34_000.0, DragBit()
FORWARD = {"bit": "slip+", "bit.axial": "slip+"}
FLAT = BIT.flat_length * BIT.radius * BIT.flat_stress  # l a sigma
TORQUE_PER_CUT = BIT.specific_energy * BIT.radius**2 / 2
WEIGHT_PER_CUT = BIT.cutter_inclination * BIT.specific_energy * BIT.radius
TORQUE_PER_FLAT = BIT.friction * BIT.bit_geometry_number * BIT.radius / 2


def rig(weight=40_000.0, bit=BIT, **torsion):
    """A rigid string of 34 t that sets down `weight`, on a torsional pendulum."""
    return compose(TorsionalPendulum(**torsion), AxialChain(mass=(MASS,), stiffness=(), damping=(), hook_load=MASS * 9.81 - weight), bit)


def prescribed(bit, swing=0.0):
    """A bit whose motion no rock can change: z = v0 t + A sin(W t) with A, v0 set by the start, angle likewise with `swing` [1/s2]."""
    heavy = 1e16
    return compose(
        TorsionalPendulum(inertia=heavy, stiffness=heavy * swing, top_speed=10.0),
        AxialChain(mass=(heavy,), stiffness=(heavy * 30.0**2,), damping=(0.0,)),
        bit,
    )


@pytest.mark.parametrize("n", [1, 2, 5, 12])
def test_radau_points_give_exact_slopes_of_polynomials_and_integrate_twice_their_degree(n):
    points, slopes = radau(n)
    assert points[0] == 0.0 and points[-1] == 1.0
    for power in range(n + 1):
        np.testing.assert_allclose(slopes @ points**power, power * points ** max(power - 1, 0), atol=1e-11 * n**4)
    # q' = 1 + s^m from q(0) = 0: the value at s = 1 is exact up to degree 2 n - 2, as for a Radau Runge-Kutta method
    right = points[1:] ** (2 * n - 2)
    assert np.linalg.solve(slopes[1:, 1:], right)[-1] == pytest.approx(1 / (2 * n - 1), rel=1e-10)


@pytest.mark.parametrize("kind", [float, complex])
def test_radau_points_are_real_numbers_whichever_kind_the_roots_come_in(kind, monkeypatch):
    roots = np.polynomial.legendre.legroots
    monkeypatch.setattr(np.polynomial.legendre, "legroots", lambda series: roots(series).real.astype(kind))
    points, slopes = radau(2)
    assert points.dtype == slopes.dtype == float
    # P2 - P1 = (3 s^2 - 2 s - 1) / 2 is zero at -1/3 and 1
    np.testing.assert_allclose(points, [0.0, 1 / 3, 1.0], rtol=1e-14)


@pytest.mark.parametrize("n", [1, 2, 4, 8, 10, 16, 24])
def test_no_wave_grows_in_the_profile_neither_on_bottom_nor_off_it(n):
    _, slopes = radau(n)
    on_bottom = -slopes[1:, 1:]
    ring = on_bottom.copy()
    ring[:, -1] -= slopes[1:, 0]
    assert np.linalg.eigvals(on_bottom).real.max() < -0.9
    assert np.linalg.eigvals(ring).real.max() < 1e-11


@pytest.mark.parametrize("weight", [25_000.0, 40_000.0, 80_000.0])
@pytest.mark.parametrize("blades", [1, 4])
def test_steady_cutting_has_the_depth_and_torque_of_the_balance_of_forces(weight, blades):
    # W = zeta eps a d + l a sigma;  T = eps a^2 d/2 + mu gamma (a/2) l a sigma;  d = 2 pi v/w
    steady = equilibrium(rig(weight, dataclasses.replace(BIT, blades=blades), top_speed=15.0), mode=FORWARD)
    depth = (weight - FLAT) / WEIGHT_PER_CUT
    assert steady["bit.cut_depth"] == pytest.approx(depth, rel=1e-10)
    assert steady["bit.axial_speed"] == pytest.approx(depth * 15.0 / (2 * math.pi), rel=1e-10)
    assert steady["bit.torque"] == pytest.approx(TORQUE_PER_CUT * depth + TORQUE_PER_FLAT * FLAT, rel=1e-10)
    points, _ = radau(BIT.nodes)  # the rock between two blades is a ramp
    np.testing.assert_allclose(steady["bit.profile"], depth / blades * points[1:], rtol=1e-9)
    # what the bit takes from string and hook is the energy of the volume cut and of the two frictions
    power = steady["bit.torque"] * 15.0 + steady["bit.weight"] * steady["bit.axial_speed"]
    volume = math.pi * BIT.radius**2 * steady["bit.axial_speed"]
    cutting = BIT.specific_energy * volume * (1 + BIT.cutter_inclination * depth / (math.pi * BIT.radius))
    assert power == pytest.approx(cutting + TORQUE_PER_FLAT * FLAT * 15.0 + FLAT * steady["bit.axial_speed"], rel=1e-10)


def test_specific_energy_against_drilling_strength_is_the_friction_line():
    # E = 2 T/(a^2 d), S = W/(a d):  E = (1 - mu gamma zeta) eps + mu gamma S for every weight and every wear
    slope = BIT.friction * BIT.bit_geometry_number
    for weight, length in ((30_000.0, 1e-3), (30_000.0, 3e-3), (90_000.0, 3e-3), (50_000.0, 0.0)):
        steady = equilibrium(rig(weight, dataclasses.replace(BIT, flat_length=length)), mode=FORWARD)
        depth = steady["bit.cut_depth"]
        energy, strength = 2 * steady["bit.torque"] / (BIT.radius**2 * depth), steady["bit.weight"] / (BIT.radius * depth)
        assert energy == pytest.approx((1 - slope * BIT.cutter_inclination) * BIT.specific_energy + slope * strength, rel=1e-9)


def test_a_weight_that_the_flats_can_carry_cuts_nothing_to_speak_of():
    steady = equilibrium(rig(0.6 * FLAT), mode=FORWARD)
    assert steady["bit.cut_depth"] == pytest.approx(0.6 * FLAT / (WEIGHT_PER_CUT + FLAT / BIT.engagement_depth), rel=1e-9)
    assert steady["bit.cut_depth"] < BIT.engagement_depth


def cut_of_prescribed(swing, times, v0, amplitude):
    """n (z(t) - z(t - t_n)) for the prescribed motion, with the delay found from the angle."""

    def z(t):
        return v0 * t + amplitude * math.sin(30.0 * t)

    pace = math.sqrt(swing)

    def angle(t):  # w = W + (w0 - W) cos(pace t)
        return 10.0 * t + (3.0 * math.sin(pace * t) / pace if swing else 0.0)

    def before(t):
        return brentq(lambda s: angle(s) - angle(t) + 2 * math.pi / 4, t - 2.0, t, xtol=1e-15)

    return np.array([4 * (z(t) - z(before(t))) for t in times])


@pytest.mark.parametrize("swing", [0.0, 25.0], ids=["constant speed", "swinging speed"])
def test_the_profile_delays_a_prescribed_motion_by_one_blade_angle_with_spectral_accuracy(swing):
    # with the hook fed at v0 from the start, the chain's spring leaves z = v0 t + A sin(30 t)
    v0, amplitude = 0.05, 2e-4
    times = np.linspace(1.2, 2.4, 41)  # more than two passages after the kink of the start
    errors = []
    for nodes in (4, 6, 8, 12):
        run = simulate(
            prescribed(dataclasses.replace(BIT, nodes=nodes), swing), 2.4, inputs={"hook.speed": v0}, accuracy=1e-10,
            start={"bit.speed": 13.0 if swing else 10.0, "bit.axial_speed": v0 + 30.0 * amplitude},
        )  # fmt: skip
        expected = cut_of_prescribed(swing, times, v0, amplitude)
        errors.append(np.abs(run.at(times)["bit.cut_depth"] - expected).max() / (4 * 2 * amplitude))
    assert errors[3] < 1e-4
    assert errors[1] < 0.3 * errors[0] and errors[2] < 0.1 * errors[1] and errors[3] < 0.01 * errors[2]


def characteristic(s, speed, depth, n=BIT.blades, pendulum=None):
    """Determinant of the delayed two-degree-of-freedom model around steady cutting, times s."""
    pendulum = pendulum or TorsionalPendulum()
    ratio, tau = depth / (2 * math.pi), 2 * math.pi / (n * speed)
    g = n * (1 - np.exp(-s * tau)) / s
    axial = MASS * s + WEIGHT_PER_CUT * g
    torsional = pendulum.inertia * s + pendulum.stiffness / s + pendulum.damping - TORQUE_PER_CUT * g * ratio
    return (axial * torsional + WEIGHT_PER_CUT * g * ratio * TORQUE_PER_CUT * g) * s


def exact_root(guess, speed, depth, pendulum):
    found = root(
        lambda v: (lambda f: (f.real / 1e6, f.imag / 1e6))(characteristic(complex(*v), speed, depth, pendulum=pendulum)),
        (guess.real, guess.imag), tol=1e-14,
    )  # fmt: skip
    return complex(*found.x)


@pytest.mark.parametrize("speed", [8.0, 25.0])
def test_poles_of_the_collocated_bit_converge_to_the_roots_of_the_characteristic_equation(speed):
    pendulum = TorsionalPendulum(damping=20.0, top_speed=speed)
    depth = (40_000.0 - FLAT) / WEIGHT_PER_CUT
    errors = []
    for nodes in (3, 5, 8, 12):
        plant = rig(40_000.0, dataclasses.replace(BIT, nodes=nodes), damping=20.0, top_speed=speed)
        poles = linearise(plant, at=equilibrium(plant, mode=FORWARD), mode=FORWARD).poles()
        slowest = sorted((p for p in poles if p.imag > 0.1), key=abs)[:2]  # torsion, then axial motion on the delay
        exact = [exact_root(p, speed, depth, pendulum) for p in slowest]
        assert abs(exact[0] - exact[1]) > 1.0
        errors.append(max(abs(p - e) / abs(e) for p, e in zip(slowest, exact, strict=True)))
    assert errors[-1] < 1e-9
    assert errors[1] < 0.1 * errors[0] and errors[2] < 0.01 * errors[1]


def test_axial_cutting_loses_stability_where_half_a_wave_fits_between_two_blades():
    # M s^2 + K (1 - exp(-s tau)) = 0 with K = n zeta eps a crosses the axis at w tau = pi, M w^2 = 2 K: stable for tau < pi/sqrt(2 K/M)
    critical = 2 * math.pi / BIT.blades * math.sqrt(2 * BIT.blades * WEIGHT_PER_CUT / MASS) / math.pi
    for factor, stable in ((0.99, False), (1.01, True)):
        # a table too stiff to let the speed follow leaves the axial motion alone
        plant = rig(40_000.0, dataclasses.replace(BIT, nodes=14), inertia=1e9, stiffness=1e9, damping=1e9, top_speed=factor * critical)
        poles = linearise(plant, at=equilibrium(plant, mode=FORWARD), mode=FORWARD).poles()
        assert bool(poles.real.max() < 1e-9) is stable


def test_a_bit_at_rest_breaks_off_forwards_against_cutting_and_flats_and_backwards_against_flats_alone():
    depth, weight = 2e-3, WEIGHT_PER_CUT * 2e-3 + 0.5 * FLAT
    for direction, bound in ((1.0, TORQUE_PER_CUT * depth + TORQUE_PER_FLAT * 0.5 * FLAT), (-1.0, TORQUE_PER_FLAT * 0.5 * FLAT)):
        plant = rig(weight, top_speed=0.1 * direction)
        run = simulate(plant, 40.0, start={"bit.profile": np.full(BIT.nodes, depth / BIT.blades)}, accuracy=1e-10)
        first = run.events[0]
        assert (first.element, first.after) == ("bit", "slip+" if direction > 0 else "slip-")
        assert 938.0 * 0.1 * first.time == pytest.approx(bound, rel=1e-9)
        assert run.at(0.5 * first.time)["bit.axial.force"] == pytest.approx(0.0, abs=1e-6)  # the flats carry half of what they can


def test_the_axial_force_of_a_bit_at_rest_is_what_the_weight_leaves_to_the_flats():
    depth = 2e-3
    start = {"bit.profile": np.full(BIT.nodes, depth / BIT.blades), "pendulum.twist": 0.1}  # a torque that cutting alone can hold
    for share, sticks in ((0.01, True), (0.99, True), (-0.01, False), (1.01, False)):
        run = simulate(rig(WEIGHT_PER_CUT * depth + share * FLAT, top_speed=0.0), 0.5, start=start)
        assert (run.time_in("bit.axial", "stick") == 0.5) is sticks
        assert run.time_in("bit", "stick") == 0.5


def surface_reference(times, z, speed, blades, cells=20_000):
    """Depth of cut of a bit that turns at constant speed over an explicit surface: each cell keeps the deepest blade that passed it."""
    surface = np.zeros(cells)
    angle = 2 * math.pi / blades
    turned = np.arange(1, int(times[-1] * speed / angle * cells) + 1)
    when = turned * angle / cells / speed
    deep = z(when)
    cut = np.empty(turned.size)
    for k in range(turned.size):
        cell = turned[k] % cells
        cut[k] = deep[k] - surface[cell]
        surface[cell] = max(surface[cell], deep[k])
    return np.interp(times, when, blades * cut)


def test_a_bit_that_leaves_the_bottom_comes_back_to_the_surface_that_it_left():
    # z = v0 t + A sin(30 t) with A 30 >> v0: every cycle leaves the bottom, and the deepest cut of each place stays
    v0, amplitude = 4e-3, 1e-3
    times = np.linspace(0.3, 1.5, 400)
    expected = surface_reference(times, lambda t: v0 * t + amplitude * np.sin(30.0 * t), 10.0, 4, 4000)
    assert expected.min() < -0.5 * 4 * amplitude and expected.max() > 0.0
    errors = []
    for nodes in (6, 12, 24):
        run = simulate(
            prescribed(dataclasses.replace(BIT, nodes=nodes)), 1.5, inputs={"hook.speed": v0},
            start={"bit.speed": 10.0, "bit.axial_speed": v0 + 30.0 * amplitude},
        )  # fmt: skip
        errors.append(np.sqrt(np.mean((run.at(times)["bit.cut_depth"] - expected) ** 2)) / np.ptp(expected))
    # the surface has kinks, so convergence is algebraic
    assert errors[2] < errors[1] < errors[0] and errors[2] < 0.02


def turned_by_hand(speed, weight=40_000.0):
    """Mean torque and share of axial stick by time stepping with the history of the motion: no profile, no events, flats as an impulse."""
    step, flat = 2e-5, 3e-3 * BIT.radius * BIT.flat_stress
    delay = round(2 * math.pi / BIT.blades / speed / step)
    turns = round(80 * 2 * math.pi / BIT.blades / speed / step)
    pace = (weight - flat) / WEIGHT_PER_CUT * speed / (2 * math.pi)
    z = np.empty(delay + turns)
    z[:delay] = pace * step * np.arange(-delay, 0)
    v, depth, stuck = 0.8 * pace, np.empty(turns), 0
    for k in range(turns):
        z[delay + k] = z[delay + k - 1] + step * v
        depth[k] = BIT.blades * (z[delay + k] - z[k])
        v += step * (weight - WEIGHT_PER_CUT * depth[k]) / MASS
        v = v if v < 0 else max(0.0, v - step * flat / MASS)
        stuck += v == 0.0 and 2 * k > turns
    assert depth.min() > 0.0
    return TORQUE_PER_CUT * depth[turns // 2 :].mean(), stuck / (turns - turns // 2)


def turned(speed, nodes=16):
    """The same by the model: a run whose last half is the cycle."""
    bit = dataclasses.replace(BIT, flat_length=3e-3, nodes=nodes)
    depth = (40_000.0 - 3e-3 * BIT.radius * BIT.flat_stress) / WEIGHT_PER_CUT
    start = {"bit.speed": speed, "bit.axial_speed": 0.8 * depth * speed / (2 * math.pi), "bit.profile": depth / 4 * radau(nodes)[0][1:]}
    return simulate(rig(40_000.0, bit, inertia=1e12, stiffness=0.0), 80 * 2 * math.pi / BIT.blades / speed, start=start)


def test_the_axial_cycle_is_that_of_time_stepping_with_the_history_itself():
    run = turned(8.0)
    torque, stuck = turned_by_hand(8.0)
    half = 0.5 * run.end
    cutting = TORQUE_PER_CUT * extent(run, "bit.cut_depth", after=half).mean
    assert cutting == pytest.approx(torque, rel=2e-3)
    assert run.time_in("bit.axial", "stick", after=half) / half == pytest.approx(stuck, abs=5e-3)
    assert 0.2 < stuck < 0.6 and not run.time_in("bit.axial", "slip-", after=half) > 0.05 * half


def test_the_mean_torque_falls_with_speed_though_the_rock_knows_no_speed():
    # the flats unload while the bit sticks axially, and the slower it turns the longer that is; above the critical speed cutting is steady
    torques = [extent(run, "bit.torque", after=0.5 * run.end).mean for run in map(turned, (6.0, 9.0, 12.0, 16.0, 25.0))]
    flat = 3e-3 * BIT.radius * BIT.flat_stress
    steady = TORQUE_PER_CUT * (40_000.0 - flat) / WEIGHT_PER_CUT + TORQUE_PER_FLAT * flat
    assert torques[0] > 1.03 * torques[1] > 1.06 * torques[2] > 1.08 * torques[3]
    np.testing.assert_allclose(torques[3:], steady, rtol=1e-3)


def test_the_axial_cycle_does_not_depend_on_the_number_of_nodes():
    torques = [extent(run, "bit.torque", after=0.5 * run.end).mean for run in (turned(8.0, nodes) for nodes in (8, 12, 20))]
    np.testing.assert_allclose(torques, torques[-1], rtol=2e-3)


def test_while_the_bit_stands_the_rock_ahead_waits():
    # at rest only the axial motion changes the profile, by the same amount everywhere
    before = np.linspace(0.1e-3, 1e-3, BIT.nodes)
    run = simulate(rig(60_000.0, top_speed=0.0), 0.2, start={"bit.profile": before, "pendulum.twist": 0.1})
    change = run.at(0.2)["bit.profile"] - before
    assert run.time_in("bit", "stick") == 0.2
    np.testing.assert_allclose(change, change[0], atol=1e-12)
    assert change[0] > 1e-4


def test_an_independent_integration_of_the_delay_agrees_while_the_bit_cuts():
    # method of steps in the angle: z and the time t as functions of the angle turned, the delay then is constant
    weight, speed, angle = 40_000.0, 25.0, 2 * math.pi / 4
    depth = (weight - FLAT) / WEIGHT_PER_CUT
    v0 = depth * speed / (2 * math.pi)
    plant = rig(weight, dataclasses.replace(BIT, nodes=16), top_speed=speed)
    points, _ = radau(16)
    twist = (TORQUE_PER_CUT * depth + TORQUE_PER_FLAT * FLAT) / 938.0
    start = {"bit.profile": depth / 4 * points[1:], "bit.speed": 0.97 * speed, "bit.axial_speed": v0, "pendulum.twist": twist}
    run = simulate(plant, 1.5, start=start, accuracy=1e-10)
    assert not run.events

    history = [lambda th: depth / (2 * math.pi) * th]  # the ramp before the start

    def slopes(th, y):
        z, v, w, twist, _ = y
        cut = 4 * (z - history[-1](th - angle))
        return np.array([v, (weight - WEIGHT_PER_CUT * cut - FLAT) / MASS,
                         (938.0 * twist - TORQUE_PER_CUT * cut - TORQUE_PER_FLAT * FLAT) / 116.0, speed - w, 1.0]) / w  # fmt: skip

    y, th = np.array([0.0, v0, 0.97 * speed, twist, 0.0]), 0.0
    while y[4] < 0.95:
        piece = solve_ivp(slopes, (th, th + angle), y, method="DOP853", rtol=1e-12, atol=1e-16, dense_output=True)
        th, y = th + angle, piece.y[:, -1]
        history.append(lambda a, piece=piece: piece.sol(a)[0])
    sample = run.at(y[4])
    np.testing.assert_allclose([sample["bit.axial_speed"], sample["bit.speed"]], [y[1], y[2]], rtol=2e-7)


@pytest.mark.parametrize("speed", [6.0, 25.0])
def test_the_energy_of_a_drilling_string_closes_and_the_rock_only_takes(speed):
    bit = dataclasses.replace(BIT, flat_length=3e-3)
    run = simulate(rig(40_000.0, bit, top_speed=speed), 20.0, start={"bit.speed": speed}, accuracy=1e-9)
    audit = energy_audit(run)
    assert audit.relative < 1e-8
    taken = -(audit.supplies["pendulum.bit torque"] + audit.supplies["axial.bit weight"])
    supplied = audit.supplies["pendulum.table"] + audit.supplies["axial.hook"]
    growth = sum(end - begin for begin, end in audit.stored.values())
    assert taken == pytest.approx(supplied - growth, rel=1e-7) and taken > 0.0
    # the volume cut alone costs eps per volume, less what is still above the blades at the end
    drilled = audit.supplies["axial.hook"] / 40_000.0  # the work of the weight set down, by that weight [m]
    assert taken > 0.99 * BIT.specific_energy * math.pi * BIT.radius**2 * drilled


def test_at_low_speed_the_coupled_string_sticks_both_ways_and_at_high_speed_in_neither():
    bit = dataclasses.replace(BIT, flat_length=3e-3)
    slow, fast = (
        simulate(rig(40_000.0, bit, top_speed=speed), 60.0, start={"bit.speed": speed, "bit.axial_speed": 1e-3}) for speed in (6.0, 25.0)
    )
    assert slow.time_in("bit", "stick", after=40.0) > 1.0 and slow.time_in("bit.axial", "stick", after=40.0) > 5.0
    assert fast.time_in("bit", "stick", after=40.0) == 0.0 == fast.time_in("bit.axial", "stick", after=40.0)


def test_a_bit_that_just_touches_starts_from_rest():
    # depth, speeds and every bound are zero at once; the cut then grows as W t^2/(2 M), until the flats stick or cut
    run = simulate(rig(40_000.0, top_speed=6.0), 5.0)
    early = run.at(1e-3)
    assert early["bit.cut_depth"] == pytest.approx(4 * 40_000.0 / MASS * 1e-6 / 2, rel=0.2)
    assert energy_audit(run).relative < 1e-6


def test_without_wear_flats_torque_and_weight_keep_the_ratio_of_the_cutters():
    sharp = dataclasses.replace(BIT, flat_length=0.0)
    run = simulate(rig(30_000.0, sharp, top_speed=25.0), 3.0, start={"bit.speed": 25.0})
    cutting = (run.modes["bit"] == "slip+") & (run["bit.cut_depth"] > 1e-6)
    assert cutting.sum() > 50
    np.testing.assert_allclose(
        run["bit.torque"][cutting], run["bit.weight"][cutting] * BIT.radius / (2 * BIT.cutter_inclination), rtol=1e-12
    )


def test_a_published_string_with_axial_masses_and_a_drive_cuts_and_its_energy_closes():
    string = AxialChain(
        mass=(8000.0, 12_000.0, 20_000.0), stiffness=(4e6, 2e7, 4e7), damping=(4e4, 4e4, 4e4), drag=0.2
    )  # fmt: skip
    plant = compose(wells.NAVARRO_LOPEZ_4, string, dataclasses.replace(BIT, flat_length=3e-3))
    assert plant.x.numel() == 7 + 6 + BIT.nodes
    assert [element.name for element in plant.elements] == ["bit.axial", "bit"]
    run = simulate(
        plant, 12.0, start={"chain.speed": 12.0, "bit.profile": 1e-5}, inputs={"hook.speed": 8e-3}, accuracy=1e-8,
        controller=PI(proportional=4000.0, integral=1500.0, reference=12.0),
    )  # fmt: skip
    audit = energy_audit(run)
    assert audit.relative < 1e-7
    # what the hook pays out is what the bit drills, on the mean of the last six seconds
    assert extent(run, "bit.axial_speed", after=6.0).mean == pytest.approx(8e-3, rel=0.05)
    assert extent(run, "bit.cut_depth", after=6.0).minimum > 0.0
    mean = extent(run, "bit.weight", after=6.0).mean
    assert mean == pytest.approx(9.81 * 40_000.0 - extent(run, "hook.load", after=6.0).mean - 0.2 * 40_000.0 * -8e-3, rel=0.02)


@pytest.mark.parametrize("nodes", [1, 10])
def test_a_coupled_string_has_as_many_states_and_contacts_as_its_mechanisms(nodes):
    plant = rig(bit=dataclasses.replace(BIT, nodes=nodes))
    assert plant.x.numel() == 2 + 1 + nodes  # torsion, axial motion, rock between two blades
    assert [element.name for element in plant.elements] == ["bit.axial", "bit"]


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"blades": 0}, "blades"),
        ({"nodes": 0}, "nodes"),
    ],
)  # fmt: skip
def test_a_bit_that_cannot_be_built_is_refused_by_name(change, word):
    with pytest.raises(SceneError, match=word):
        rig(bit=dataclasses.replace(BIT, **change))


def test_blades_and_nodes_may_be_integers_of_numpy():
    assert (
        rig(bit=dataclasses.replace(BIT, blades=np.int64(2), nodes=np.int32(3))).x.numel()
        == rig(bit=dataclasses.replace(BIT, blades=2, nodes=3)).x.numel()
    )


def test_a_bit_at_a_prescribed_speed_is_that_on_an_inertia_that_nothing_slows_down():
    def axial(bit, *others):
        return compose(AxialChain(mass=(MASS,), stiffness=(), damping=(), hook_load=MASS * 9.81 - 40_000.0), bit, *others)

    alone = axial(dataclasses.replace(BIT, has_prescribed_speed=True))
    heavy = axial(BIT, TorsionalPendulum(inertia=1e16, stiffness=0.0, top_speed=12.0))
    times = np.linspace(0.0, 1.0, 21)
    found = simulate(alone, 1.0, inputs={"bit.speed": 12.0}, output_times=times, accuracy=1e-9)
    expected = simulate(heavy, 1.0, start={"bit.speed": 12.0}, output_times=times, accuracy=1e-9)
    for name in ("bit.torque", "bit.weight", "bit.cut_depth"):
        np.testing.assert_allclose(found[name], expected[name], rtol=1e-6, atol=1e-6 * np.abs(expected[name]).max())
    assert "bit.speed" in alone.inputs and [element.name for element in alone.elements] == ["bit.axial"]
