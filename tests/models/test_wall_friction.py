"""A string that slides and turns: one cone, so that turning takes axial drag away."""

import math

import numpy as np
import pytest

from controllers import PI, SoftTorque
from models import AxialChain, Coulomb, TorsionalChain, WallContact, sliding_resultant, string_on_wall
from toolbox import Sampled, SceneError, SimulationError, closed_loop, compose, energy_audit, equilibrium, linearise, simulate
from toolbox.contacts import step_contacts
from toolbox.inputs import ramp, sine

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
    force, torque = (
        sum(part) for part in zip(*(sliding_resultant(MU, load, hook_speed, top_speed, RADIUS) for load in LOADS), strict=True)
    )
    total = MU * sum(LOADS)
    assert -4e6 * run["axial.0"][-1] == pytest.approx(
        force, abs=1e-4 * total
    )  # what the lines carry less, of hoisting what they carry more
    assert -2000.0 * run["twist.0"][-1] == pytest.approx(torque, abs=1e-4 * total * RADIUS)
    size = np.linalg.norm(run.tangential[-1], axis=1)
    np.testing.assert_allclose(size, MU * np.array(LOADS), rtol=1e-9)


def test_turning_takes_nearly_all_axial_drag_away_and_two_cones_would_not():
    lowered, turned = (
        step_contacts(string(), 60.0, step=0.02, inputs={"hook.speed": 0.05, "top.speed": w})["axial.0"][-1] for w in (0.0, 10.0)
    )
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
    [
        ({"radius": 0.0}, "radius"),
        ({"loads": (1.0, 2.0, -1.0)}, "loads"),
        ({"loads": (0.0, 0.0, 0.0)}, "all are 0"),
        ({"loads": "much"}, "loads"),
    ],
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


# ------------------------------------------------------------------------------------------------------------------------- a top drive under control
def driven(law, hook_speed=0.0, step=4e-3, duration=16.0, inputs_of=None, **options):
    """A string whose top drive is an inertia under a law, sampled every 20 ms."""
    axial = AxialChain(mass=(5000.0,) * 2, stiffness=(4e6,) * 2, damping=(2e5,) * 2)
    problem = string_on_wall(axial, TORSION, radius=RADIUS, loads=LOADS[:2], friction=Coulomb(MU, MU), top_drive=True)
    return step_contacts(problem, duration, step=step, inputs={"hook.speed": hook_speed} | (inputs_of or {}), controller=law, **options)


TORSION = TorsionalChain(inertia=(2000.0, 100.0, 100.0), stiffness=(2000.0, 2000.0), damping=(80.0, 80.0), top_drag=20.0)


def test_a_turning_string_under_a_sampled_law_with_delay_and_noise_converges_to_the_run_with_located_events_with_first_order():
    """Where nothing moves along the hole one direction of the cone is all there is: dry friction with the load N R at every inertia."""
    law = Sampled(
        PI(proportional=900.0, integral=300.0, reference=2.0),
        0.02,
        delay=0.04,
        noise={"top.speed": 0.02},
        resolution={"top.speed": 0.01},
        seed=3,
    )
    chain = TorsionalChain(
        inertia=TORSION.inertia, stiffness=TORSION.stiffness, damping=TORSION.damping, top_drag=TORSION.top_drag, friction=Coulomb(MU, MU),
        friction_load=tuple(RADIUS * load for load in LOADS[:2]), friction_at=(1, 2),
    )  # fmt: skip
    exact = simulate(compose(chain), 4.0, controller=law, accuracy=1e-9)
    assert any(event.after == "stick" for event in exact.events) or exact["bit.speed"].max() > 1.0
    errors = []
    for step in (0.01, 0.005, 0.0025):
        run = driven(law, step=step, duration=4.0)
        assert (run["axial.0"] == 0.0).all()
        errors.append(np.abs(run["top.speed"] - exact.at(run.time)["top.speed"]).max())
    assert errors[-1] < 0.03
    assert errors[0] / errors[1] > 1.6 < errors[1] / errors[2]


def test_a_law_keeps_the_speed_of_a_string_that_slides_and_slides_with_less_torque():
    law = PI(proportional=3000.0, integral=2500.0)
    turned, slid = (
        driven(law, speed, step=0.02, duration=24.0, sample_time="20 ms", inputs_of={"top.reference": "2 rad/s"}) for speed in (0.0, 0.2)
    )
    for run, speed in ((turned, 0.0), (slid, 0.2)):
        assert run["top.speed"][-1] == pytest.approx(2.0, abs=1e-3)
        torque = sum(sliding_resultant(MU, load, speed, 2.0, RADIUS)[1] for load in LOADS[:2])
        assert run.inputs["top.torque"][-1] == pytest.approx(torque + TORSION.top_drag * 2.0, rel=2e-3)
    assert slid.inputs["top.torque"][-1] < 0.8 * turned.inputs["top.torque"][-1]
    assert driven(None, duration=1.0)["top.speed"].max() == 0.0  # nothing turns by itself


def test_a_law_in_python_is_told_what_it_measures_and_drives():
    seen = []

    def law(t, y):
        seen.append((t, *y))
        return 500.0 + 900.0 * (1.0 - y[0])

    run = driven(
        Sampled(law, "20 ms", measured_signals=("top.speed", "twist.1.position"), actuated_signals="top.torque"), duration=2.0, step=2e-3
    )
    assert len(seen) == 100
    np.testing.assert_allclose([row[0] for row in seen], 0.02 * np.arange(100), atol=1e-12)
    np.testing.assert_allclose([row[1] for row in seen], run["top.speed"][:-1:10])
    np.testing.assert_allclose([row[2] for row in seen], run["twist.1"][:-1:10])
    np.testing.assert_allclose(run.inputs["top.torque"][1:], np.repeat([500.0 + 900.0 * (1.0 - row[1]) for row in seen], 10))


def test_a_law_with_a_state_of_its_own_begins_every_run_anew():
    class Counting:
        measures, drives = "top.speed", "top.torque"

        def __init__(self):
            self.samples = 0

        def __call__(self, t, y):
            self.samples += 1
            return float(self.samples)

    law = Counting()
    for _ in range(2):
        run = driven(law, duration=0.2, step=0.02, sample_time=0.02)
        np.testing.assert_array_equal(run.inputs["top.torque"][1:], np.arange(1, 11))
    assert law.samples == 0


@pytest.mark.parametrize(
    ("law", "options", "words"),
    [
        (PI(), {}, "sample_time"),
        (PI(), {"sample_time": 0.003}, "whole number of steps"),
        (Sampled(PI(), 0.02, delay=0.001), {}, "`delay` must be a whole number"),
        (Sampled(PI(), 0.02, noise={"bit.speed": 0.1}), {}, "bit.speed"),
        (Sampled(lambda t, y: 0.0, 0.02, measured_signals="top.angle", actuated_signals="top.torque"), {}, "top.angle"),
        (Sampled(lambda t, y: 0.0, 0.02, measured_signals="top.speed", actuated_signals="top.speed"), {}, "top.speed"),
        (None, {"sample_time": 0.02}, "come with a `controller`"),
        (3.0, {"sample_time": 0.02}, "must be a Controller"),
        (SoftTorque(), {"sample_time": 0.02}, "designed on a chain"),
    ],
)
def test_laws_that_cannot_run_are_refused(law, options, words):
    with pytest.raises(SceneError, match=words):
        driven(law, **options)


def test_an_input_that_a_law_drives_cannot_be_given():
    with pytest.raises(SceneError, match=r"top\.torque"):
        driven(PI(), sample_time=0.02, inputs_of={"top.torque": 100.0})


def test_a_law_that_fails_leaves_the_run_so_far():
    def law(t, y):
        return math.nan if t > 0.5 else 0.0

    with pytest.raises(SimulationError, match="1 finite value") as raised:
        driven(Sampled(law, 0.02, actuated_signals="top.torque"))
    assert raised.value.run.end == pytest.approx(0.52)


LINES, TOP = AxialChain(mass=(20_000.0, 20_000.0), stiffness=(4e6, 8e6), damping=(4e4, 4e4)), 425.0
END = compose(LINES, TorsionalChain(inertia=(2122.0, 374.0), stiffness=(473.0,), damping=(23.2,), top_drag=TOP), WallContact())
"""Half a drill string on ten lines whose collars lie on the wall of a horizontal hole, all switches located."""


@pytest.mark.parametrize("hook_speed", [-0.2, 0.05])
@pytest.mark.parametrize("top_torque", [4000.0, 20_000.0])
def test_hoisting_and_lowering_with_rotation_take_the_resultant_along_the_slip(hook_speed, top_torque):
    inputs = {"hook.speed": hook_speed, "top.torque": top_torque}
    steady = equilibrium(closed_loop(END, inputs=inputs))
    wall = WallContact()
    force, torque = sliding_resultant(wall.friction.kinetic, wall.load, hook_speed, steady["bit.speed"], wall.radius)
    assert (steady["wall.drag"], steady["wall.torque"]) == pytest.approx((force, torque), rel=1e-9)
    assert steady["hook.load"] == pytest.approx(40_000.0 * 9.81 - force, rel=1e-9)
    assert steady["bit.speed"] == pytest.approx((top_torque - torque) / TOP, rel=1e-9)
    run = simulate(END, 60.0, start=steady, inputs=inputs, accuracy=1e-9)
    assert not run.events and run["wall.drag"][-1] == pytest.approx(force, rel=1e-7)


def test_turning_damps_the_motion_along_the_hole_by_the_closed_form():
    """While the string turns, dry friction is a viscous drag along the hole: dF/dv = mu N / (R w) at v = 0."""
    steady = equilibrium(closed_loop(END, inputs={"top.torque": 8000.0}))
    wall = WallContact()
    slope = wall.friction.kinetic * wall.load / (wall.radius * steady["bit.speed"])
    linear = linearise(END, steady)
    assert steady["bit.axial_speed"] == 0.0
    place = linear.state_labels.index("axial_speed[1]")
    assert linear.A[place, place] == pytest.approx(-(slope + LINES.damping[1]) / 20_000.0, rel=1e-9)


def test_a_string_that_is_hoisted_slowly_sticks_and_slips_and_turning_ends_it():
    inputs = {"hook.speed": -0.05}
    hoisted = simulate(END, 60.0, inputs=inputs)
    turned = simulate(END, 60.0, inputs=inputs | {"top.torque": 8000.0})
    assert hoisted.time_in("wall", "stick", after=30.0) > 3.0
    assert turned.time_in("wall", "stick", after=30.0) == 0.0
    # the top has spun up to e^-8 of its speed, with (2122 + 374) kg m2 against 425 N m s/rad
    assert np.ptp(turned["hook.load"][turned.time > 50.0]) < 0.01 * np.ptp(hoisted["hook.load"][hoisted.time > 50.0])


def test_a_string_that_hangs_up_along_its_hole_comes_free_when_it_is_turned():
    """Pulled by 90 % of what would free it, it needs no more of its torque than sqrt(1 - 0.9^2)."""
    wall = WallContact()
    bound = wall.friction.static * wall.load
    rigid = compose(
        AxialChain(mass=(20_000.0,), stiffness=(), damping=(), hook_load=20_000.0 * 9.81),
        TorsionalChain(inertia=(10.0, 374.0), stiffness=(1e5,), damping=(1e3,)),
        wall,
    )
    pull = {"hook.load": 20_000.0 * 9.81 + 0.9 * bound}
    hung = simulate(rigid, 10.0, inputs=pull)
    assert hung.time_in("wall", "stick") == 10.0
    freed = simulate(rigid, 10.0, inputs=pull | {"top.torque": ramp(0.0, 6000.0, 0.0, 10.0)}, accuracy=1e-9)
    leaves = next(event.time for event in freed.events if event.element == "wall" and event.after == "slip")
    assert freed.at(leaves)["top.load"] == pytest.approx(np.sqrt(1 - 0.9**2) * bound * wall.radius, rel=1e-8)


def test_the_energy_of_rocking_a_string_that_slides_balances():
    run = simulate(END, 60.0, inputs={"hook.speed": 0.02, "top.torque": sine(0.0, 8000.0, 0.2)}, accuracy=1e-8)
    assert run.time_in("wall", "stick") > 1.0
    audit = energy_audit(run)
    assert abs(audit.residual) < 1e-8 * audit.turnover
