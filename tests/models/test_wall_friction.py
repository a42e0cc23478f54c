"""A string that slides and turns: one cone, so that turning takes axial drag away."""

import math

import numpy as np
import pytest

from models import AxialChain, Coulomb, TorsionalChain, sliding_resultant, string_on_wall
from toolbox import SceneError, ramp, step_contacts

RADIUS, MU = 0.1, 0.3
LOADS = (2000.0, 5000.0, 8000.0)


def string(loads=LOADS, friction=None, **options):
    n = len(loads)
    axial = AxialChain(mass=(5000.0,) * n, stiffness=(4e6,) * n, damping=(2e5,) * n)
    torsional = TorsionalChain(inertia=(2000.0, *(100.0,) * n), stiffness=(2000.0,) * n, damping=(800.0,) * n)
    return string_on_wall(axial, torsional, **{"radius": RADIUS, "loads": loads, "friction": friction or Coulomb(MU, MU)} | options)


@pytest.mark.parametrize("hook_speed", [0.0, 0.05, -0.5])
@pytest.mark.parametrize("top_speed", [0.0, 1.0, 10.0])
def test_lowering_and_hoisting_with_rotation_take_the_force_and_the_torque_of_the_closed_form(hook_speed, top_speed):
    if hook_speed == top_speed == 0:
        return
    run = step_contacts(string(), 60.0, step=0.02, inputs={"hook.speed": hook_speed, "top.speed": top_speed})
    force, torque = (sum(part) for part in zip(*(sliding_resultant(MU, load, hook_speed, top_speed, RADIUS) for load in LOADS), strict=True))
    total = MU * sum(LOADS)
    assert -4e6 * run["axial.0"][-1] == pytest.approx(force, abs=1e-4 * total)  # what the lines carry less, of hoisting what they carry more
    assert -2000.0 * run["twist.0"][-1] == pytest.approx(torque, abs=1e-4 * total * RADIUS)
    size = np.linalg.norm(run.tangential[-1], axis=1)
    np.testing.assert_allclose(size, MU * np.array(LOADS), rtol=1e-9)


def test_turning_takes_nearly_all_axial_drag_away_and_two_cones_would_not():
    lowered, turned = (step_contacts(string(), 60.0, step=0.02, inputs={"hook.speed": 0.05, "top.speed": w})["axial.0"][-1] for w in (0.0, 10.0))
    assert turned / lowered == pytest.approx(0.05 / math.hypot(0.05, RADIUS * 10.0), rel=1e-3)


def test_a_string_that_is_pulled_and_twisted_lets_go_where_the_resultant_reaches_the_bound():
    """One mass on the wall: k_a z and k_t phi / R of the springs grow with the distances that hook and top have moved."""
    problem = string(loads=(1000.0,))
    inputs = {"hook.speed": ramp(0.0, -5e-5, 0.0, 0.1), "top.speed": ramp(0.0, 0.01, 0.0, 0.1)}
    run = step_contacts(problem, 5.0, step=1e-3, inputs=inputs)
    # springs and dampers: force 4e6 * 5e-5 t + 2e5 * 5e-5, torque (2000 * 0.01 t + 800 * 0.01) / R
    t = np.linspace(0.1, 5, 500_001)
    moved = t - 0.05
    reached = t[np.hypot(4e6 * 5e-5 * moved + 2e5 * 5e-5, (2000.0 * 0.01 * moved + 800.0 * 0.01) / RADIUS) >= MU * 1000.0][0]
    assert run.first("slip") == pytest.approx(reached, abs=3e-3)
    alone = step_contacts(problem, 5.0, step=1e-3, inputs={"top.speed": inputs["top.speed"]})
    assert alone.first("slip") > reached + 0.05


def test_weight_and_torque_on_the_bit_reach_hook_and_top():
    run = step_contacts(string(), 60.0, step=0.02, inputs={"hook.speed": 0.02, "top.speed": 5.0, "bit.weight": 1e4, "bit.torque": 300.0})
    force, torque = (sum(part) for part in zip(*(sliding_resultant(MU, load, 0.02, 5.0, RADIUS) for load in LOADS), strict=True))
    assert -4e6 * run["axial.0"][-1] == pytest.approx(force + 1e4, rel=1e-3)
    assert -2000.0 * run["twist.0"][-1] == pytest.approx(torque + 300.0, rel=1e-3)
    audit = run.audit()
    assert abs(audit["missing"]) < 1e-9 * audit["size"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [({"radius": 0.0}, "radius"), ({"loads": (1.0, 2.0, -1.0)}, "loads"), ({"loads": (0.0, 0.0, 0.0)}, "not all 0"), ({"loads": "much"}, "loads")],
)
def test_numbers_out_of_range_are_refused(changes, words):
    axial = AxialChain(mass=(1.0,) * 3, stiffness=(1.0,) * 3, damping=(0.0,) * 3)
    torsional = TorsionalChain(inertia=(1.0,) * 4, stiffness=(1.0,) * 3, damping=(0.0,) * 3)
    with pytest.raises(SceneError, match=words):
        string_on_wall(axial, torsional, **{"radius": 0.1, "loads": (1.0,) * 3, "friction": Coulomb(0.3, 0.3)} | changes)


def test_chains_that_do_not_fit_are_refused():
    axial = AxialChain(mass=(1.0,), stiffness=(), damping=(), hook_load=1000.0)
    with pytest.raises(SceneError, match="hoisting lines"):
        string_on_wall(axial, TorsionalChain(), radius=0.1, loads=(1.0,), friction=Coulomb(0.3, 0.3))
    with pytest.raises(SceneError, match="4 inertias"):
        three = AxialChain(mass=(1.0,) * 3, stiffness=(1.0,) * 3, damping=(0.0,) * 3)
        string_on_wall(three, TorsionalChain(), radius=0.1, loads=(1.0,) * 3, friction=Coulomb(0.3, 0.3))
    with pytest.raises(SceneError, match="both be 0"):
        sliding_resultant(0.3, 10.0, 0.0, 0.0, 0.1)
