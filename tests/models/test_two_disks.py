"""Two disks in frictional contact against closed forms and an independent integration of the stop."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from models import Coulomb, Exponential, TwoDisks, uniform_pressure_radius, uniform_wear_radius
from studies.questions import disks as study
from studies.questions.critical_curve import critical_curve
from toolbox import SceneError, compose, simulate
from toolbox.measure import cycles


@pytest.mark.parametrize("z", [0.1, 1.0, 8.0])
@pytest.mark.parametrize("radius", [0.1, 0.37])
def test_an_undamped_stator_under_a_driven_rotor_sticks_and_slips_as_the_closed_form_says(z, radius):
    # z = (T_s - T_k) w_n / (k_t W);  t_slip = (2 / w_n)(pi - arctan z);  t_stick = 2 z / w_n
    inertia, stiffness, drive, load = 0.02, 2000.0, 2.0, 1000.0
    w_n = math.sqrt(stiffness / inertia)
    kinetic = 0.3
    static = kinetic + z * stiffness * drive / w_n / (load * radius)
    # a rotor of 1e9 kg m2 turns as if driven: friction changes its speed by 1e-7 in this run
    plant = compose(
        TwoDisks(rotor_inertia=1e12, damping=0.0, stator_inertia=inertia, stiffness=stiffness, normal_force=load, radius=radius,
                 friction=Coulomb(static=static, kinetic=kinetic))
    )  # fmt: skip
    caught = (2 * kinetic - static) * load * radius / stiffness
    period = (2 * math.pi / w_n) * (1 + (z - math.atan(z)) / math.pi)
    start = {"disks.rotor_speed": drive, "disks.stator_speed": drive, "disks.stator_angle": caught}
    run = simulate(plant, 6.5 * period, start=start, accuracy=1e-11)
    pieces = run.intervals("disks")[:-1]
    slip = [end - begin for begin, end, mode in pieces if mode == "slip+"]
    stick = [end - begin for begin, end, mode in pieces if mode == "stick"]
    assert len(slip) >= 5 and {mode for *_, mode in pieces} == {"stick", "slip+"}
    np.testing.assert_allclose(slip, (2 / w_n) * (math.pi - math.atan(z)), rtol=1e-8)
    np.testing.assert_allclose(stick, 2 * z / w_n, rtol=1e-8)


def test_slip_of_sticking_disks_is_exactly_zero_though_both_speeds_change():
    run = simulate(compose(TwoDisks()), 3.0, start={"disks.rotor_speed": 2.0})
    stuck = run.modes["disks"] == "stick"
    assert stuck.sum() > 20
    assert np.ptp(run["disks.rotor_speed"][stuck]) > 0.1
    assert np.all(run["disks.slip"][stuck] == 0.0)
    assert np.all(run["disks.rotor_speed"][stuck] == run["disks.stator_speed"][stuck])


def test_a_locked_pair_of_disks_swings_as_one_inertia():
    # stick: (I1 + I2) th'' + k th = 0
    plant = compose(
        TwoDisks(rotor_inertia=3.0, stator_inertia=1.0, stiffness=100.0, damping=0.0, friction=Coulomb(static=0.5, kinetic=0.4))
    )
    run = simulate(plant, 10.0, start={"disks.stator_angle": 0.1}, accuracy=1e-10)
    assert run.time_in("disks", "stick") == 10.0
    times = np.linspace(0, 10, 200)
    np.testing.assert_allclose(run.at(times)["disks.stator_angle"], 0.1 * np.cos(5 * times), atol=1e-9)
    # the interface carries the inertia of the rotor: |F| = I1 |w1'| = I1 w^2 th
    np.testing.assert_allclose(run.at(times)["disks.force"], 3.0 * -(25.0 * 0.1 * np.cos(5 * times)), atol=1e-7)


def test_the_interface_of_a_locked_pair_lets_go_where_the_rotor_needs_more_than_the_static_torque():
    # I1 w^2 A = 7.5 N m at the turning points; the bound is one per cent lower, so it slips, and one per cent higher, so it holds
    for bound, slips in ((7.5 * 0.99, True), (7.5 * 1.01, False)):
        plant = compose(
            TwoDisks(rotor_inertia=3.0, stator_inertia=1.0, stiffness=100.0, damping=0.0, normal_force=bound, radius=1.0,
                     friction=Coulomb(static=1.0, kinetic=0.9))
        )  # fmt: skip
        angle = -0.1 * math.cos(5 * 0.3)
        run = simulate(plant, 1.0, start={"disks.stator_angle": angle, "disks.stator_speed": 0.5 * math.sin(1.5),
                                          "disks.rotor_speed": 0.5 * math.sin(1.5)}, accuracy=1e-10)  # fmt: skip
        assert (run.time_in("disks", "stick") < 1.0) is slips


def test_angular_momentum_of_the_rotor_is_what_friction_took():
    run = simulate(compose(TwoDisks(friction=Coulomb(static=0.4, kinetic=0.3))), 3.0, start={"disks.rotor_speed": 2.0}, accuracy=1e-10)
    # while it slips the torque on the rotor is constant, so its speed is a straight line
    for begin, end, mode in run.intervals("disks"):
        if mode == "slip+":
            w = run.at([begin, end])["disks.rotor_speed"]
            assert w[1] - w[0] == pytest.approx(-0.3 * 100.0 / 20.0 * (end - begin), abs=1e-9)


def reference_stop(duration, tolerance=1e-12):
    """Switch times and end state of the braking stop of physics.md 2.1, by scipy with explicit modes."""
    rotor, stator, stiffness, damping, load = 20.0, 0.02, 2000.0, 0.5, 100.0

    def torque(w):
        return load * (0.3 + 0.1 * math.exp(-2.0 * max(w, -0.3)))

    def slip(t, y):
        w1, th, w2 = y
        return [-torque(w1 - w2) / rotor, w2, (torque(w1 - w2) - stiffness * th - damping * w2) / stator]

    def stick(t, y):
        w1, th, _ = y
        common = -(stiffness * th + damping * w1) / (rotor + stator)
        return [common, w1, common]

    def need(y):
        return rotor * (stiffness * y[1] + damping * y[0]) / (rotor + stator)

    def falls(t, y):
        return y[0] - y[2]

    def breaks(t, y):
        return load * 0.4 - abs(need(y))

    falls.terminal = breaks.terminal = True
    falls.direction = breaks.direction = -1
    t, y, sticking, switches = 0.0, np.array([2.0, 0.0, 0.0]), False, []
    while t < duration:
        run = solve_ivp(stick if sticking else slip, (t, duration), y, method="DOP853", rtol=tolerance, atol=tolerance * 1e-2,
                        events=breaks if sticking else falls, max_step=1e-3)  # fmt: skip
        t, y = run.t[-1], run.y[:, -1].copy()
        if run.status == 1:
            if not sticking:
                y[2] = y[0]
            # at zero slip force decides; here it always holds after slipping
            assert sticking or abs(need(y)) <= load * 0.4
            sticking = not sticking
            switches.append(t)
    return np.array(switches), y


def test_the_braking_stop_agrees_with_an_independent_integration():
    times, end = reference_stop(1.2)
    run = simulate(compose(TwoDisks()), 1.2, start={"disks.rotor_speed": 2.0}, accuracy=1e-10)
    mine = np.array([event.time for event in run.events])
    assert len(mine) == len(times) > 20
    np.testing.assert_allclose(mine, times, atol=1e-7)
    last = run.at(1.2)
    np.testing.assert_allclose([last["disks.rotor_speed"], last["disks.stator_angle"], last["disks.stator_speed"]], end, atol=1e-7)


def test_a_stop_ends_in_stick_and_without_falling_friction_it_has_no_stick_slip():
    run = simulate(compose(TwoDisks()), 6.0, start={"disks.rotor_speed": 2.0})
    assert run.intervals("disks")[-1][2] == "stick"
    smooth = simulate(compose(TwoDisks(friction=Exponential(static=0.3, kinetic=0.3, decay=2.0))), 6.0, start={"disks.rotor_speed": 2.0})
    assert len(smooth.events) < len(run.events) / 4


# ------------------------------------------------------------------------------------------------------------------------------- cycles of a stop
@pytest.mark.parametrize("z", [0.2, 3.0])
def test_cycles_of_a_driven_rotor_have_the_durations_of_the_closed_form(z):
    inertia, stiffness, kinetic = 0.02, 2000.0, 30.0
    w_n = math.sqrt(stiffness / inertia)
    static = kinetic + z * stiffness / w_n
    plant = compose(
        TwoDisks(rotor_inertia=1e12, stator_inertia=inertia, stiffness=stiffness, damping=0.0, normal_force=1.0, radius=1.0,
                 friction=Coulomb(static=static, kinetic=kinetic))
    )  # fmt: skip
    run = simulate(plant, 0.3, start={"disks.rotor_speed": 1.0}, accuracy=1e-10)
    found = cycles(run, "disks")
    assert len(found) >= 3
    slip, stick, period = (np.array(part) * 2 * math.pi / w_n for part in study.driven_cycle(z))
    for cycle in found:
        assert cycle.slip == pytest.approx(float(slip), rel=1e-7)
        assert cycle.stick == pytest.approx(float(stick), rel=1e-7)
        assert cycle.period == pytest.approx(float(period), rel=1e-7)


def test_the_period_of_a_stop_starts_near_that_of_the_stator_and_ends_near_three_times_it():
    stop = study.stop_of(TwoDisks(), 2.0)
    assert 1.0 < stop.onset < 1.1
    assert 2.7 < stop.termination < 3.3
    assert np.all(np.diff(stop.ratios) > 0)
    assert stop.run.error_estimate < 1e-6
    slips = np.array([cycle.slip for cycle in stop.cycles])
    assert np.ptp(slips) < 0.2 * slips.max()
    assert study.stop_of(TwoDisks(friction=Exponential(static=0.3, kinetic=0.3, decay=2.0)), 2.0).cycles == []


def test_the_last_period_is_set_by_the_ratio_of_inertias_and_the_drop_of_friction():
    rotor, stator, static, kinetic = 2000.0, 0.02, 40.0, 30.0
    low, high = study.last_period_range(rotor, stator, static, kinetic)
    disks = TwoDisks(rotor_inertia=rotor, damping=0.0, normal_force=100.0, radius=1.0, friction=Coulomb(static=0.4, kinetic=0.3))
    for speed in np.linspace(0.05, 0.06, 8):
        stop = study.stop_of(disks, float(speed))
        # the slips take 1.5 % off the speed, which the theory of a rotor much heavier than the stator leaves out
        assert 0.97 * low < stop.termination < high


def test_a_stop_from_high_speed_is_not_computable_and_says_so():
    assert study.stop_of(TwoDisks(), 8.0).run.error_estimate > 0.01 > 1e-6 > study.stop_of(TwoDisks(), 4.0).run.error_estimate


@pytest.mark.parametrize("zeta", [0.05, 0.2])
def test_bisection_of_runs_finds_the_critical_drop_of_friction(zeta):
    damping = 2 * zeta * math.sqrt(2000.0 * 0.02)
    found = critical_curve(lambda c, z: study.driven(2000.0, c, z), [damping], (0.01, 10.0))
    assert found[0] == pytest.approx(study.critical_drop(zeta), rel=1e-3)


def test_a_critical_curve_is_followed_and_has_gaps_where_nothing_changes():
    calls = []

    def circle(x, y):
        calls.append(x)
        return 1.0 - x**2 - y**2

    along = [0.0, 0.3, 0.6, 0.9, 1.2]
    found = critical_curve(circle, along, (0.01, 2.0), tolerance=1e-8)
    np.testing.assert_allclose(found[:4], np.sqrt(1 - np.array(along[:4]) ** 2), rtol=1e-7)
    assert math.isnan(found[4])
    with pytest.raises(SceneError, match="between"):
        critical_curve(circle, along, (0.0, 2.0))


# ---------------------------------------------------------------------------------------------------------------------------- radius of an annulus
def test_the_effective_radius_of_an_annulus_is_the_mean_radius_of_its_torque():
    inner, outer = 0.06, 0.14
    r = np.linspace(inner, outer, 200_001)
    for radius, pressure in ((uniform_pressure_radius, np.ones_like(r)), (uniform_wear_radius, 1 / r)):
        mean = np.trapezoid(pressure * r**2, r) / np.trapezoid(pressure * r, r)
        assert radius(inner, outer) == pytest.approx(mean, rel=1e-9)
    assert uniform_pressure_radius(inner, outer) == pytest.approx(2 / 3 * (outer**3 - inner**3) / (outer**2 - inner**2), rel=1e-14)
    assert uniform_pressure_radius(0.0, 0.3) == pytest.approx(0.2)


@pytest.mark.parametrize("radius", [uniform_pressure_radius, uniform_wear_radius])
@pytest.mark.parametrize(
    ("inner", "outer", "word"),
    [(-0.1, 0.2, "inner"), (0.2, 0.2, "outer"), (0.2, math.nan, "outer"), (math.nan, 0.2, "inner"), (0.1, math.inf, "outer")],
)
def test_an_annulus_that_is_none_is_refused(radius, inner, outer, word):
    with pytest.raises(SceneError, match=word):
        radius(inner, outer)
