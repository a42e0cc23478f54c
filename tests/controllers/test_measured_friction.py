"""Brake laws on measured friction: the border of groan in pieces, and stops from 30 km/h beside a simulation in C that shares nothing with the toolbox."""

from __future__ import annotations

import math
import shutil

import numpy as np
import pytest

from controllers import BrakeForce, HeldSpeed, groan_border
from models import BrakeActuator, DiscBrake, Exponential, GaussianStribeck, StepFriction, Tabulated, Viscous
from studies.questions import brake_check as own
from studies.questions import brakes
from tests.refusals import refusals
from toolbox import Sampled, SceneError, closed_loop, compose, equilibrium, linearise, measure, simulate
from toolbox.inputs import sine
from toolbox.measuring import metrics

SPEEDS, COEFFICIENTS = own.SPEEDS, own.COEFFICIENTS
TABLE = Tabulated(speeds=SPEEDS, coefficients=COEFFICIENTS, static=0.45)
WANTED = own.WANTED / own.WHEEL


def brake(friction=TABLE, **fields):
    return compose(DiscBrake(force=0.0, friction=friction, **fields))


# --- the border in closed form


def test_the_border_of_a_table_is_half_the_damping_by_the_slope_of_each_row():
    slopes = [(a - b) / (w - v) for a, b, v, w in zip(COEFFICIENTS, COEFFICIENTS[1:], SPEEDS, SPEEDS[1:], strict=False)]
    found = groan_border(brake())
    assert found.speeds == pytest.approx([v / 0.12 for v in SPEEDS])
    assert found.forces[:-1] == pytest.approx([200.0 / (2.0 * s) for s in slopes]) and found.forces[-1] == math.inf


def test_the_force_and_the_speed_at_the_kinks_are_exact_and_the_higher_piece_holds_there():
    # falls of 0.12, 0.1 and 0.08 s/m under a damping of 200 N s/m: 200 / 0.24, 200 / 0.2, 200 / 0.16
    table = Tabulated(speeds=(0.0, 0.12, 0.36, 0.6), coefficients=(0.45, 0.4356, 0.4116, 0.3924), static=0.45)
    found = groan_border(brake(table))
    assert found.speeds == pytest.approx((0.0, 1.0, 3.0, 5.0), rel=1e-14)
    assert found.forces == pytest.approx((2500.0 / 3.0, 1000.0, 1250.0, math.inf), rel=1e-12)
    assert [found.at(speed) for speed in (0.0, 0.999, 1.001, 4.999, 5.001)] == [found.forces[i] for i in (0, 0, 1, 2, 3)]


@pytest.mark.parametrize(("speed", "piece"), [(0.2, 0), (1.0, 1), (2.0, 2), (6.0, 3)])
def test_the_pad_has_damping_below_the_border_of_its_piece_and_none_above_it(speed, piece):
    border = groan_border(brake()).forces[piece]
    growth = []
    for part in (0.99, 1.01):
        bench = closed_loop(compose(DiscBrake(force=part * border, inertia=1e9, friction=TABLE)), HeldSpeed(reference=speed))
        poles = np.linalg.eigvals(np.asarray(linearise(bench, at=equilibrium(bench, mode={"pad": "slip+"}), mode={"pad": "slip+"}).A))
        growth.append(max(pole.real for pole in poles if abs(pole.imag) > 100.0))
    assert growth[0] < 0.0 < growth[1]


@pytest.mark.parametrize(
    "friction", [GaussianStribeck(static=0.45, kinetic=0.35, stribeck_speed=0.3), Viscous(Exponential(0.45, 0.35, 5.0), viscous=0.01)]
)
def test_of_any_other_law_the_border_is_never_above_the_true_one_and_near_it(friction):
    found = groan_border(brake(friction))

    def fall(v):
        if isinstance(friction, Viscous):
            return 0.1 * 5.0 * math.exp(-5.0 * v) - 0.01
        return 0.1 * 2.0 * v / 0.3**2 * math.exp(-((v / 0.3) ** 2))

    # a cell is a factor of 1.19 of speed wide, in which these curves change by less than a third
    for speed in np.geomspace(0.02, 2.0, 60):
        assert found.at(speed) <= 200.0 / (2.0 * fall(0.12 * speed)) * (1.0 + 1e-9)
        assert found.at(speed) >= 0.67 * 200.0 / (2.0 * fall(0.12 * speed))


def test_an_exponential_law_has_its_border_in_one_piece():
    found = groan_border(brake(Exponential(0.45, 0.35, 5.0)))
    assert (found.speeds, found.forces[0], found.border_growth) == ((0.0,), pytest.approx(200.0), pytest.approx(0.6))
    assert found.at(2.0) == pytest.approx(200.0 * math.exp(1.2))
    assert "exp(0.6 s/rad" in str(found)


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda: groan_border(brake(StepFriction())), "`border_speeds`"),
    (lambda: groan_border(brake(Tabulated(speeds=(0.0, 1.0), coefficients=(0.3, 0.4), static=0.4))), "does not fall"),
    (lambda: BrakeForce(border_forces=(100.0,)).check(), "given together"),
    (lambda: BrakeForce(border_speeds=(1.0, 2.0), border_forces=(100.0, 200.0)).check(), "begin at 0"),
    (lambda: BrakeForce(border_speeds=(0.0, 2.0), border_forces=(100.0,)).check(), "one length"),
    (lambda: BrakeForce(margin=0.8, border=500.0).design(brake()), "`border_growth` is missing"),
)  # fmt: skip


# --- the laws take it


def test_an_eased_law_keeps_the_margin_of_every_piece_and_its_twin_does_not():
    eased, twin = (
        simulate(brake(), 4.0, start={"disc.speed": 9.0}, controller=BrakeForce(deceleration=WANTED, margin=margin), sample_time=1e-3)
        for margin in (0.8, None)
    )
    border = groan_border(brake())

    def excess(run):
        times = np.arange(0.2, 3.0, 1e-3) + 5e-4
        at = run.at(times)
        turning = at["disc.speed"] > 0.0
        falling = 20_000.0 * 1e-3 * np.arange(1, 200)  # the force takes its time at the rate of the law
        bound = np.array([0.8 * border.at(max(speed, 0.0)) for speed in at["disc.speed"]])
        late = np.max([np.append(np.full(k, np.inf), bound[:-k]) - step for k, step in enumerate(falling, 1)], axis=0)
        late[~np.isfinite(late)] = np.inf
        return (at["brake.force"] - np.maximum(bound, late))[turning].max()

    assert excess(eased) < 25.0 < excess(twin)


def test_a_force_eased_with_a_jerk_never_exceeds_the_border_and_its_twin_does():
    plant, border = brake(wheel_radius=own.WHEEL), groan_border(brake())
    found = {}
    for jerk in (None, 5.0):
        law = BrakeForce(car_deceleration=own.WANTED, friction=0.385, margin=0.8, car_jerk=jerk)
        run = simulate(plant, 4.0, start={"disc.car_speed": 2.7}, controller=law, sample_time=1e-3)
        stands = measure.standstill(run, "disc.car_speed", 0.03)
        at = run.at(np.arange(0.3, stands, 1e-3))
        share = (at["brake.force"] / [border.at(max(speed, 0.0)) for speed in at["disc.speed"]]).max()
        found[jerk] = (
            share,
            metrics.jerk("disc.car_speed", 0.3, stands).read(run),
            metrics.distance("disc.car_speed", 0.0, stands).read(run),
        )
    (share, jerk, distance), (twin, twin_jerk, twin_distance) = found[5.0], found[None]
    assert share < 0.82 and twin > 2.0  # 0.8, and the last sample before a lower piece
    assert jerk < 1.35 * 5.0 < twin_jerk  # the friction is up to 0.445 where 0.385 is expected
    assert twin_distance < distance < twin_distance + 0.5


def test_with_a_fifth_more_friction_a_force_eased_with_a_jerk_is_silent_and_its_twin_is_not():
    plant = compose(DiscBrake(force=0.0, friction=TABLE, wheel_radius=own.WHEEL), BrakeActuator())
    more = {"pad.friction.coefficients": 1.2 * np.array(COEFFICIENTS), "pad.friction.static": 1.2 * 0.45}
    found = []
    for jerk in (None, 5.0):
        law = BrakeForce(car_deceleration=own.WANTED, friction=0.385, margin=0.8, car_jerk=jerk)
        run = simulate(
            plant, 6.0, start={"disc.car_speed": "30 km/h"}, inputs={"pad.attachment": sine(0.0, 4.0, 40.0)},
            controller=Sampled(law, 1e-3, delay=0.002), parameters=more,
        )  # fmt: skip
        found.append(metrics.releases("pad", 0.2, measure.standstill(run, "disc.car_speed", 0.03)).read(run))
    assert found[0] >= 2 and found[1] == 0


def test_the_eased_force_falls_along_a_constant_jerk_to_each_lower_piece():
    law = BrakeForce(deceleration=WANTED, friction=0.385, margin=0.8, jerk=20.0).design(brake())
    speeds = np.linspace(0.0, 12.0, 2001)
    force = law.highest_eased(speeds)
    assert (force <= 0.8 * law.border_at(speeds)).all()
    k = int(np.searchsorted(SPEEDS, 0.4))  # the force falls from 4000 N to 1000 N at 0.4 m/s
    begin, below = law.border_speeds[k], law.border_forces[k - 1]
    near = speeds[(speeds > begin) & (speeds < begin + 0.3)]
    slowed = law.highest_eased(near) / law.force_for(1.0)  # deceleration of the disc
    np.testing.assert_allclose(slowed**2, (0.8 * below / law.force_for(1.0)) ** 2 + 2.0 * 20.0 * (near - begin), rtol=1e-12)
    with pytest.raises(SceneError, match="`car_jerk` needs a DiscBrake with a `wheel_radius`"):
        BrakeForce(margin=0.8, car_jerk=5.0).design(brake())


def test_a_border_that_is_given_is_used_in_place_of_that_of_the_plant():
    law = BrakeForce(deceleration=WANTED, margin=1.0, border_speeds=(0.0, 4.0), border_forces=(300.0, 600.0))
    run = simulate(brake(), 3.0, start={"disc.speed": 6.0}, controller=law, sample_time=1e-3)
    at = run.at(np.linspace(0.2, 2.9, 200))
    fast = at["disc.speed"] > 4.05
    slow = (at["disc.speed"] < 3.9) & (at["disc.speed"] > 0.0)
    assert fast.any() and slow.any()
    assert at["brake.force"][fast] == pytest.approx(600.0) and at["brake.force"][slow].min() == pytest.approx(300.0)


@pytest.mark.skipif(shutil.which("cc") is None, reason="the other simulation is compiled with `cc`, which is not here")
@pytest.mark.parametrize("name", own.MEASURED)
def test_a_stop_from_30_km_h_on_a_falling_kinked_table_is_that_of_a_simulation_in_c(name):
    ours, other = own.stopped(name), own.stopped_in_c(name)
    assert ours.time < 6.0 and other.time == pytest.approx(ours.time, abs=0.01)
    assert own.WHEEL * other.angle == pytest.approx(own.WHEEL * ours.angle, abs=0.01)  # of 14 to 15 m
    assert ours.releases == other.releases and (ours.releases >= 2) == (name == "constant force")
    # the force that MPC commands is known to the accuracy of two solvers, the force of the others to the accuracy of the steps
    assert own.apart(ours, other) < (30.0 if name == "MPC" else 1.0)


@pytest.mark.skipif(shutil.which("cc") is None, reason="the other simulation is compiled with `cc`, which is not here")
@pytest.mark.parametrize("duration", [0.25, 1.0])
def test_a_release_on_a_slope_lets_the_pad_go_as_often_as_a_simulation_in_c(duration):
    count, speed = brakes.creep_of(None, False, duration)
    again, there = own.released(duration)
    assert count == again > 10
    assert speed == pytest.approx(there, abs=0.01)
