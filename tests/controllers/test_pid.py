"""PID on any signals: beside the PI of a top drive, python-control, and a sampled loop that is written here."""

from __future__ import annotations

import control
import numpy as np
import pytest

from controllers import PI, PID
from models import Axis, BitRock, Coulomb, Joint, Viscous, wells
from toolbox import Sampled, SceneError, closed_loop, compose, simulate, sweep
from toolbox.inputs import step
from toolbox.measuring import metrics

FREE = compose(Joint(inertia=0.1, friction=Viscous(Coulomb(1e-9, 1e-9), 0.1)))
SIGNALS = ("joint.speed", "joint.torque")


@pytest.mark.parametrize("period", [None, 0.01])
def test_as_a_pi_of_the_top_speed_it_moves_a_drill_string_as_the_pi_does(period):
    rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    gains = {"proportional": 4000.0, "integral": 1500.0}
    laws = [
        PI(**gains, reference="90 rpm", lowest_torque=0.0, highest_torque="9 kN m"),
        PID("top.speed", "top.torque", **gains, reference="90 rpm", lowest=0.0, highest="9 kN m"),
    ]
    run, other = (simulate(rig, 30.0, controller=law, sample_time=period, accuracy=1e-9) for law in laws)
    assert run["top.torque"].max() == 9000.0  # the limit acts
    assert len(run.events) == len(other.events) > 0
    assert np.allclose(run.at(30.0)["bit.speed"], other.at(30.0)["bit.speed"], rtol=1e-6, atol=1e-6)


def test_the_step_of_a_free_inertia_is_the_one_of_python_control():
    pid = PID(*SIGNALS, proportional=0.8, integral=2.0, derivative=0.05, filter_time=0.02, reference=0.0)
    run = simulate(FREE, 2.0, controller=pid, inputs={"joint.reference": step(0.0, 3.0, 0.0)}, accuracy=1e-10)
    s = control.tf("s")
    plant = 1.0 / (0.1 * s + 0.1)
    inner = control.feedback(plant, 0.05 * s / (0.02 * s + 1.0))
    loop = control.feedback((0.8 + 2.0 / s) * inner, 1.0)
    times = np.linspace(0.1, 2.0, 20)
    exact = control.forced_response(loop, np.r_[0.0, times], 3.0 * np.ones(21)).outputs[1:]
    assert np.allclose([run.at(t)["joint.speed"] for t in times], exact, atol=1e-6)


def test_the_sampled_form_with_a_limit_is_its_difference_equations():
    law = PID(
        *SIGNALS, proportional=0.8, integral=9.0, derivative=0.02, filter_time=0.03, reference=3.0, bias=0.1, lowest=-0.5, highest=0.9
    )
    run = simulate(FREE, 3.0, controller=Sampled(law, 0.05), accuracy=1e-11)
    speed, integral, filtered, most = 0.0, 0.0, 0.0, -1.0
    decay = np.exp(-0.05)  # J w' = u - 0.1 w with J = 0.1
    for k in range(60):
        assert run.at(k * 0.05)["joint.speed"] == pytest.approx(speed, abs=1e-7)
        error, rate = 3.0 - speed, (speed - filtered) / (0.03 + 0.05)
        wanted = 0.1 + 0.8 * error + 9.0 * integral - 0.02 * rate
        u = min(max(wanted, -0.5), 0.9)
        integral += 0.05 * (error + (u - wanted) / 0.8)
        filtered += 0.05 * rate
        speed = decay * speed + (1.0 - decay) * u / 0.1
        most = max(most, wanted)
    assert most > 0.9  # the limit acts


def test_it_holds_a_position_and_its_set_point_can_be_swept():
    axis = compose(Axis(friction=Viscous(Coulomb(0.2, 0.2), 1.0)))
    pid = PID("axis.position", "axis.force", proportional=100.0, derivative=15.0, filter_time="5 ms", reference="20 mm")
    found = sweep(closed_loop(axis, pid), {"axis.reference": [0.05, 0.1]}, 3.0, metrics=metrics.final("axis.position"))
    errors = np.array([0.05, 0.1]) - np.asarray(found["final"])
    assert (np.abs(errors) <= 0.2 / 100.0 + 1e-9).all()  # friction holds the axis within F / K


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"measured_signals": ("a.x", "b.x")}, "`measured_signals` of PID must name one signal"),
        ({"measured_signals": ()}, "`measured_signals` of PID must name one signal"),
        ({"actuated_signals": 3}, "`actuated_signals` of PID must name one signal"),
        ({"measured_signals": "joint.sped"}, "joint.speed"),
        ({"derivative": 1.0}, "`derivative` and `filter_time` of PID must be given together"),
        ({"proportional": 0.0, "highest": 1.0}, "`proportional` of PID must be > 0"),
        ({"proportional": -1.0}, "proportional"),
        ({"proportional": float("nan")}, "proportional"),
        ({"reference": "3 N"}, "`reference` must be in rad/s"),
        ({"reference": float("inf")}, "`reference`"),
        ({"lowest": 2.0, "highest": 1.0}, "`highest` must be > 2"),
    ],
)
def test_a_wrong_field_is_refused_by_its_name(fields, words):
    with pytest.raises(SceneError, match=words):
        simulate(FREE, 1.0, controller=PID(**{"measured_signals": SIGNALS[0], "actuated_signals": SIGNALS[1]} | fields))
