"""A state on which nothing depends, such as the angle of a shaft, may go on while the machine runs steadily."""

from __future__ import annotations

import control
import numpy as np
import pytest

from controllers import PID
from models import Coulomb, Joint, Viscous
from toolbox import closed_loop, compose, equilibrium, margins, onset
from toolbox.errors import NoSteadyState
from toolbox.steady_states.equilibria import flow_slopes

JOINT = compose(Joint(friction=Viscous(Coulomb(0.3, 0.1), 0.02)))
DRIVE = PID("joint.speed", "joint.torque", proportional=0.2, integral=3.0, reference=2.0)
LOOP = closed_loop(JOINT, DRIVE)


def test_a_joint_at_constant_speed_is_steady_though_its_angle_grows():
    rest = equilibrium(LOOP)
    assert rest["joint.speed"] == pytest.approx(2.0, abs=1e-12) and rest["joint.angle"] == 0.0
    assert rest["joint.torque"] == pytest.approx(0.1 + 0.02 * 2.0, abs=1e-12)  # Coulomb and viscous friction
    assert equilibrium(LOOP, guess={"joint.speed": 5.0})["joint.speed"] == pytest.approx(2.0, abs=1e-12)


def test_an_angle_that_a_controller_reads_must_rest():
    with pytest.raises(NoSteadyState, match="slip"):
        equilibrium(closed_loop(JOINT, PID("joint.angle", "joint.torque", proportional=8.0, reference=1.0)), mode={"bearing": "slip+"})


def test_poles_and_margins_are_those_of_the_motion_without_the_angle():
    s = control.tf("s")
    opened = (0.2 + 3.0 / s) / (0.1 * s + 0.02)
    exact = control.feedback(opened, 1.0).poles()
    found = np.linalg.eigvals(flow_slopes(equilibrium(LOOP)))
    assert found.size == exact.size + 1  # the angle adds a zero
    assert np.abs(found[:, None] - np.append(exact, 0.0)[None, :]).min(axis=0).max() < 1e-9
    phase = control.stability_margins(opened)[1]
    assert f"{phase:.1f} deg" in str(margins(LOOP, by_simulation=False))


@pytest.mark.parametrize("period", [None, 0.05])
def test_onset_walks_a_set_point_of_a_joint(period):
    found = onset(closed_loop(JOINT, DRIVE, sample_time=period), "joint.reference", (0.1, 1.5))
    assert "smooth running is stable in all of it" in str(found)
    assert not found.losses and len(found.ends) == 1  # below its end, stick-slip exists beside smooth running
