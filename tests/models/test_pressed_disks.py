"""Disks pressed together across a gap: flight, impact and rest against closed forms, torsion against the disks that are axially rigid."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from models import PressedDisks, TwoDisks
from studies.questions import disks as study
from toolbox import compose, energy_audit, simulate
from toolbox.inputs import ramp


@pytest.fixture(scope="module")
def stop():
    return study.pressed_stop(5.0)


def closing(stop):
    return [event for event in stop.run.events if event.element == "disks.faces"]


def test_the_rotor_crosses_the_gap_in_free_flight_and_feels_no_friction_until_then(stop):
    # m z'' = F' t: gap = F' t^3 / (6 m)
    met = closing(stop)[0]
    assert met.after == "closed"
    assert met.time == pytest.approx((6 * 2.0 * 0.5e-3 / (1000.0 / 0.05)) ** (1 / 3), rel=1e-9)
    times = np.linspace(0.0, met.time * (1 - 1e-9), 50)
    assert np.all(stop.run.at(times)["disks.normal_force"] == 0.0)
    assert np.all(stop.run.at(times)["disks.rotor_speed"] == 5.0)
    assert np.all(stop.run.at(times)["disks.stator_speed"] == 0.0)


def test_the_first_touch_ends_where_the_linear_motion_of_the_closed_pair_loses_its_force(stop):
    met, parted = closing(stop)[:2]
    assert parted.after == "open"
    k, c, m, rate = 1e7, 2e3, 2.0, 1000.0 / 0.05
    # z1, v1, z2, v2, then 1 and t for the ramp of the actuator and the gap
    push = np.array([k, c, -k, -c])
    matrix = np.zeros((6, 6))
    matrix[0, 1] = matrix[2, 3] = matrix[5, 4] = 1.0
    matrix[1, :4], matrix[1, 4], matrix[1, 5] = -push / m, k * 0.5e-3 / m, rate / m
    matrix[3, :4], matrix[3, 4] = (push - [0, 0, 1e7, 2e3]) / m, -k * 0.5e-3 / m
    begin = np.array([rate * met.time**3 / 6 / m, rate * met.time**2 / 2 / m, 0.0, 0.0, 1.0, met.time])

    def force(t):
        x = expm(matrix * (t - met.time)) @ begin
        return push @ x[:4] - k * 0.5e-3

    expected = brentq(force, met.time + 1e-3, parted.time + 3e-4, xtol=1e-13)
    assert parted.time == pytest.approx(expected, abs=1e-8)
    assert parted.time < closing(stop)[2].time and closing(stop)[2].after == "closed"


def test_faces_never_pull_and_carry_the_actuator_force_in_the_end(stop):
    times = np.linspace(0, stop.run.end, 20_001)
    assert stop.run.at(times)["disks.normal_force"].min() == 0.0
    assert stop.run.at(stop.run.end)["disks.normal_force"] == pytest.approx(1000.0, rel=1e-9)


def test_while_the_faces_are_apart_friction_neither_holds_nor_drags(stop):
    parted, again = closing(stop)[1].time, closing(stop)[2].time
    times = np.linspace(parted + 1e-9, again - 1e-9, 40)
    samples = stop.run.at(times)
    assert np.all(samples["disks.force"] == 0.0)
    assert np.ptp(samples["disks.rotor_speed"]) < 1e-13


def test_the_energy_of_closing_rubbing_and_sticking_closes(stop):
    audit = energy_audit(stop.run)
    assert abs(audit.residual) < 1e-8 * audit.turnover


def test_pressed_from_the_start_they_stop_like_disks_that_are_axially_rigid():
    same = {"rotor_inertia": 20.0, "radius": 0.1, "friction": TwoDisks().friction}
    start = {"disks.rotor_speed": 2.0, "disks.rotor_position": 0.5e-3 + 2 * 1000.0 / 1e7, "disks.stator_position": 1000.0 / 1e7}
    run = simulate(compose(PressedDisks(**same)), 1.0, start=start, accuracy=1e-9)
    rigid = simulate(compose(TwoDisks()), 1.0, start={"disks.rotor_speed": 2.0}, accuracy=1e-9)
    times = np.linspace(0, 1, 400)
    for name in ("disks.rotor_speed", "disks.stator_angle"):
        np.testing.assert_allclose(run.at(times)[name], rigid.at(times)[name], atol=1e-6)
    assert len(rigid.events) > 20


def test_the_period_of_a_stop_grows_to_about_three_times_that_of_the_stator():
    for speed in (4.0, 10.0):
        found = study.pressed_stop(speed)
        assert np.all(np.diff(found.ratios) > 0)
        assert found.onset < 1.6 and 2.0 < found.termination < 4.0
        assert found.run.error_estimate < 1e-5
    assert study.pressed_stop(4.0).onset < 1.25


def test_an_actuator_that_lets_go_opens_the_gap():
    start = {"disks.rotor_position": 0.5e-3 + 2 * 1000.0 / 1e7, "disks.stator_position": 1000.0 / 1e7, "disks.rotor_speed": 5.0}
    run = simulate(compose(PressedDisks()), 0.2, start=start, inputs={"disks.actuator_force": ramp(1000.0, 0.0, 0.0, 1e-3)})
    assert run.modes["disks.faces"][0] == "closed" and run.modes["disks.faces"][-1] == "open"
    assert run.at(0.2)["disks.faces.closure"] < 0.0
