"""Bodies with many contacts against closed forms: sliding, sticking, impact, waves, the cone, and the balance of energy."""

import dataclasses
import itertools
import math

import casadi as ca
import numpy as np
import pytest

from models import Block, BristleContact, Coulomb, ElasticBody, Exponential, StepFriction
from tests.refusals import each_of, refusals
from toolbox import Sampled, SceneError, SimulationError, compose, simulate, time
from toolbox.contacts import ContactProblem, press_contacts, step_contacts
from toolbox.inputs import ramp, sine

MU, LOAD, MASS = 0.4, 10.0, 2.0


def block(stiffness=0.0, directions=1, friction=None, **options):
    """A rigid block with one contact of given load, on springs of one stiffness in each direction."""
    unit = np.eye(directions)
    fields = {
        "mass": MASS * unit, "stiffness": stiffness * unit, "tangent": unit[None], "friction": friction or Coulomb(MU, MU), "load": [LOAD],
        "force_inputs": {f"force.{axis}": unit[i] for i, axis in enumerate("xy"[:directions])},
        "surface_velocity": {f"surface.{axis}": unit[i][None] for i, axis in enumerate("xy"[:directions])},
        "outputs": {axis: unit[i] for i, axis in enumerate("xy"[:directions])},
    }  # fmt: skip
    return ContactProblem(**fields | options)


def thrown(problem, *speeds):
    """A run at rest whose last rates are changed: the begin of a run with speed."""
    begin = step_contacts(problem, 1e-9, step=1e-9)
    begin.rates[-1] = speeds
    return begin


def test_below_the_bound_nothing_moves_and_the_force_is_what_holds():
    run = step_contacts(block(), 1.0, step=0.1, inputs={"force.x": ramp(0.0, 0.99 * MU * LOAD, 0.0, 1.0)})
    assert (run["x"] == 0.0).all()
    assert run.share().min() == 1.0
    np.testing.assert_allclose(run.tangential[1:, 0, 0], -0.99 * MU * LOAD * run.time[1:], rtol=1e-12)


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.6, 0.8), (-0.28, 0.96)])
def test_a_block_thrown_in_any_direction_slows_along_it_and_stops_where_the_textbook_says(direction):
    speed, deceleration = 3.0, MU * LOAD / MASS
    problem = block(directions=2)
    errors = []
    for step in (0.02, 0.01, 0.005):
        run = step_contacts(problem, 2.0, step=step, start=thrown(problem, *(speed * np.array(direction))))
        moved = np.array([run["x"][-1], run["y"][-1]])
        errors.append(abs(np.linalg.norm(moved) - speed**2 / (2 * deceleration)))
        np.testing.assert_allclose(moved / np.linalg.norm(moved), direction, atol=1e-9)
        assert run.last("slip") == pytest.approx(speed / deceleration, abs=1.01 * step)
        assert (run.rates[-1] == 0).all()
    for coarse, fine in itertools.pairwise(errors):
        assert coarse / fine == pytest.approx(2.0, rel=0.05)


def test_the_error_that_a_run_measures_is_the_one_it_makes_and_falls_with_the_step():
    size, speed = 5e-4, 10.0  # the plate carries the block to x = size (speed t - sin(speed t)), and the contact holds k x + m x''
    made = []
    for step in (0.01, 0.005):
        run = step_contacts(block(500.0), 1.0, step=step, inputs={"surface.x": size * speed * (1 - ca.cos(speed * time))})
        phase = speed * run.time
        exact = 500.0 * size * (phase - np.sin(phase)) + MASS * size * speed**2 * np.sin(phase)
        impulse = 500.0 * size * (phase**2 / 2 + np.cos(phase) - 1) / speed + MASS * size * speed * (1 - np.cos(phase))
        made.append(np.abs(np.cumsum(run.tangential[1:, 0, 0]) * step - impulse[1:]).max() / np.hypot(LOAD, impulse[-1]))
        assert np.abs(run.tangential[:, 0, 0] - exact).max() < 0.1 * exact.max()
        assert "ask `run.error_estimate`" in str(run)
        assert run.error_estimate == pytest.approx(made[-1], rel=0.1)
        assert f"error {run.error_estimate:.1e}" in str(run)
    assert made[0] / made[1] == pytest.approx(2.0, rel=0.05)


def test_a_free_block_rests_on_its_friction_alone():
    rest = press_contacts(block(), {"force.x": 0.9 * MU * LOAD})
    assert rest["x"][0] == 0.0 and rest.share()[0] == 1.0
    assert rest.tangential[0, 0, 0] == pytest.approx(-0.9 * MU * LOAD, rel=1e-12)
    with pytest.raises(SimulationError, match="No set of open, sticking and sliding contacts is at rest"):
        press_contacts(block(), {"force.x": 1.1 * MU * LOAD})


def test_a_state_of_rest_has_no_error_of_a_step_and_that_of_a_run_that_failed_is_not_known():
    assert press_contacts(block(500.0), {"force.x": 1.0}).error_estimate == 0.0
    run = step_contacts(block(500.0), 1.0, step=0.1)
    assert np.isnan(dataclasses.replace(run, _finer=None).error_estimate)


def test_an_output_keeps_its_unit_beside_an_input_of_its_name():
    problem = block(500.0, outputs={"force.x": [1.0]}, units={"force.x": "kN"})
    assert (problem.unit("force.x"), problem.output_unit("force.x")) == ("kN", "m")
    assert block(outputs={"turn": [1.0]}, units={"turn": "rad"}).output_unit("turn") == "rad"


def test_a_block_lets_go_where_the_resultant_of_two_forces_reaches_the_bound_and_not_where_one_does():
    both = {"force.x": ramp(0.0, 4.0, 0.0, 1.0), "force.y": 3.0}
    run = step_contacts(block(directions=2), 1.0, step=1e-3, inputs=both)
    release = math.sqrt((MU * LOAD) ** 2 - 3.0**2) / 4.0
    assert run.first("slip") == pytest.approx(release, abs=1.01e-3)
    alone = step_contacts(block(directions=2), 1.0, step=1e-3, inputs=both | {"force.y": 0.0})
    assert math.isnan(alone.first("slip"))


def test_a_block_on_springs_over_a_plate_that_turns_away_feels_the_resultant_of_both_speeds():
    """Held by springs, in steady sliding: k x = mu N v_x / |v|, k y = mu N v_y / |v|."""
    run = step_contacts(block(500.0, 2, damping=200.0 * np.eye(2)), 10.0, step=0.01, inputs={"surface.x": 0.3, "surface.y": -0.1})
    size = math.hypot(0.3, 0.1)
    assert run["x"][-1] == pytest.approx(MU * LOAD * 0.3 / size / 500.0, rel=1e-6)
    assert run["y"][-1] == pytest.approx(-MU * LOAD * 0.1 / size / 500.0, rel=1e-6)


def test_forces_act_as_they_are_at_the_end_of_a_step_and_surfaces_by_the_mean_of_both_ends():
    """An implicit Euler written out: a block that slides one way all the time on a surface that speeds up and down, so that friction is its kinetic one."""
    push, belt = (lambda t: 3.0 * np.sin(7.0 * t + 0.3)), (lambda t: 2.0 + 0.5 * np.sin(5.0 * t))
    inputs = {"force.x": 3.0 * ca.sin(7.0 * time + 0.3), "surface.x": 2.0 + 0.5 * ca.sin(5.0 * time)}
    law, k, duration = Exponential(static=0.3, kinetic=0.2, decay=1.0), 20.0, 1.0
    ends = []
    for step in (0.01, 0.005, 0.0025, 0.00125):
        run = step_contacts(block(k, friction=law), duration, step=step, inputs=inputs)
        x, v, slip, friction = 0.0, 0.0, 0.0, 0.3
        for i, t in enumerate(run.time[1:], 1):
            moved = (push(t) + friction * LOAD + MASS * v / step - k * x) / (MASS / step**2 + k)
            slip = moved / step - (belt(t - step) + belt(t)) / 2
            assert slip < 0
            x, v, friction = x + moved, moved / step, 0.2 + 0.1 * np.exp(-abs(slip))
            assert run["x"][i] == pytest.approx(x, abs=1e-11)
        ends.append(x)
    changes = np.abs(np.diff(ends))
    assert changes[:-1] / changes[1:] == pytest.approx(2.0, rel=0.2)


def test_stick_slip_of_a_block_on_a_belt_converges_to_the_run_with_located_events_with_first_order():
    from models import BlockOnBelt

    friction = Exponential(static=1.0, kinetic=0.4, decay=3.0)
    exact = simulate(compose(BlockOnBelt(friction=friction)), 12.0, accuracy=1e-10)
    problem = block(1.0, friction=friction, mass=[[1.0]], load=[1.0])
    errors = []
    for step in (0.016, 0.008, 0.004):
        run = step_contacts(problem, 12.0, step=step, inputs={"surface.x": 0.2})
        errors.append(np.abs(run["x"] - exact.at(run.time)["block.position"]).max())
        assert run.error_estimate == pytest.approx(
            errors[-1] / np.abs(run["x"]).max(), rel=0.05
        )  # though forces jump where the block lets go
    assert errors[-1] < 1e-2
    for coarse, fine in itertools.pairwise(errors):
        assert coarse / fine == pytest.approx(2.0, rel=0.15)
    stuck = run.share()[run.time > 6.0].mean()
    assert stuck == pytest.approx(exact.time_in("belt", "stick", after=6.0) / 6.0, abs=0.02)


def test_bristles_of_the_event_loop_are_the_limit_of_a_body_without_mass_at_its_contacts():
    """Sixteen springs between a plate and a base that is drawn to and fro: the same play operators, so the same force at every step."""
    n, k = 16, 1e6
    model = BristleContact(n)
    shares = np.linspace(0.5, 1.5, n) / n
    base = 4e-6
    exact = simulate(
        compose(BristleContact(n, shares=tuple(shares))), 2.5, inputs={"plate.speed": base * 2 * math.pi * ca_cos()}, accuracy=1e-10
    )
    stiffness = k / n * np.eye(n)
    problem = ContactProblem(
        0 * stiffness, stiffness, np.eye(n)[:, None, :], Coulomb(model.friction, model.friction), load=shares * model.load,
        surface_velocity={"plate": np.ones((n, 1))},
    )  # fmt: skip
    errors = []
    for step in (0.01, 0.005):
        run = step_contacts(problem, 2.5, step=step, inputs={"plate": base * 2 * math.pi * ca_cos()})
        drag = -run.tangential.sum(axis=(1, 2))
        errors.append(np.abs(drag + exact.at(run.time)["plate.drag"]).max() / (model.friction * model.load))
    assert errors[-1] < 1e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)  # the trapezoid of the speed of the plate is all that is wrong
    assert 0.2 < run.share().mean() < 0.9


def ca_cos():
    import casadi as ca

    return ca.cos(2 * ca.pi * time)


# ------------------------------------------------------------------------------------------------------------------------------ opening and impact
def dropped(elements, speed=1.0, gap=1e-4, length=0.5, area=1e-4, density=7800.0, modulus=2.1e11):
    """An elastic rod that flies towards a rigid wall: problem, run of its begin, wave speed."""
    h = length / elements
    side = np.ones(elements)
    inside = np.full(elements + 1, 2.0)
    inside[[0, -1]] = 1.0
    stiffness = modulus * area / h * (np.diag(inside) - np.diag(side, 1) - np.diag(side, -1))
    mass = density * area * h * np.diag(inside) / 2
    tip = np.eye(elements + 1)[-1]
    problem = ContactProblem(
        mass, stiffness, 0 * tip[None, None] + np.eye(elements + 1)[:1][None] * 1e-9, Coulomb(0.0, 0.0), normal=tip[None], gap=[gap]
    )
    begin = step_contacts(problem, 1e-12, step=1e-12)
    begin.rates[-1] = speed
    return problem, begin, math.sqrt(modulus / density)


def test_a_rod_that_strikes_a_wall_stays_for_two_passages_of_the_wave_and_pushes_with_its_impedance():
    problem, begin, wave_speed = dropped(100)
    period = 2 * 0.5 / wave_speed
    run = step_contacts(problem, 3 * period, step=period / 1500, start=begin)
    touching = run.contact_modes[:, 0] != 2
    assert touching.sum() * period / 1500 == pytest.approx(period, rel=0.03)
    arrival = run.time[np.flatnonzero(touching)[0]]
    assert arrival == pytest.approx(1e-4, rel=0.01)
    plateau = (run.time > arrival + 0.3 * period) & (run.time < arrival + 0.7 * period)
    assert run.normal[plateau, 0] == pytest.approx(7800.0 * wave_speed * 1e-4 * 1.0, rel=0.02)
    assert (run.coordinates[:, -1] <= 1e-4 * (1 + 1e-9)).all()


def test_the_rod_comes_back_with_its_speed_in_the_limit_of_small_steps():
    problem, begin, wave_speed = dropped(40)
    period = 2 * 0.5 / wave_speed
    lost = []
    for parts in (500, 1000, 2000):
        run = step_contacts(problem, 1e-4 + 1.5 * period, step=period / parts, start=begin)
        back = problem.mass.diagonal() @ run.rates[-1] / problem.mass.trace()
        lost.append(1.0 + back)
        audit = run.audit()
        assert abs(audit["missing"]) < 1e-10 * audit["size"]
        assert audit["stepping"] > 0
    assert all(fine < coarse for coarse, fine in itertools.pairwise(lost))
    assert lost[-1] < 0.15


def test_energy_is_accounted_for_while_contacts_open_slide_and_stick():
    random = np.random.default_rng(4)
    n, c = 12, 3
    root = random.normal(size=(n, n))
    problem = ContactProblem(
        np.diag(0.5 + random.random(n)), 200.0 * root @ root.T + 50.0 * np.eye(n), np.stack([np.eye(n)[[i, i + 3]] for i in range(c)]), Coulomb(0.5, 0.3),
        normal=np.eye(n)[6 : 6 + c], damping=0.02 * root @ root.T, gap=[0.0, 0.001, 0.002],
        force_inputs={"press": np.eye(n)[6:9].sum(axis=0), "shake": random.normal(size=n)}, surface_velocity={"belt": np.tile([1.0, 0.3], (c, 1))},
    )  # fmt: skip
    import casadi as ca

    run = step_contacts(problem, 2.0, step=1e-3, inputs={"press": 20.0, "shake": 30.0 * ca.sin(20 * time), "belt": 0.2})
    for mode in ("stick", "slip", "open"):
        assert run.share(mode).max() > 0
    audit = run.audit()
    assert abs(audit["missing"]) < 1e-11 * audit["size"]
    assert audit["friction"] > 0.01 * audit["size"]
    assert min(audit["damping"], audit["impacts"], audit["stepping"]) > 0
    assert (np.diff(run.friction_work, axis=0) >= -1e-12 * audit["size"]).all()
    assert (np.linalg.norm(run.tangential, axis=2) <= 0.5 * run.normal * (1 + 1e-9) + 1e-9).all()


def test_a_state_of_rest_is_the_begin_of_a_run_in_which_nothing_happens():
    body = np.array([[3.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]) * 1e4
    problem = ContactProblem(
        np.eye(3), body, np.eye(3)[:1][None], Coulomb(0.3, 0.3), normal=np.eye(3)[1:2], gap=[1e-4], force_inputs={"press": np.eye(3)[2]}
    )
    rest = press_contacts(problem, {"press": 50.0})
    np.testing.assert_allclose(body @ rest.coordinates[0], [rest.tangential[0, 0, 0], -rest.normal[0, 0], 50.0], atol=1e-9)
    run = step_contacts(problem, 0.1, step=1e-3, inputs={"press": 50.0}, start=rest)
    np.testing.assert_allclose(run.coordinates, np.tile(rest.coordinates[0], (len(run.time), 1)), atol=1e-15)


def test_events_name_contact_time_and_modes():
    run = step_contacts(block(), 1.0, step=1e-2, inputs={"force.x": ramp(0.0, 8.0, 0.0, 1.0)})
    assert [(event.element, event.before, event.after) for event in run.events] == [("contact.0", "stick", "slip")]
    assert run.events[0].time == pytest.approx(0.5, abs=0.0101)
    assert "1 contacts" in str(run)


def test_units_may_be_typed_and_positions_and_speeds_of_outputs_are_read_by_name():
    typed = step_contacts(
        block(500.0), "1 s", step="10 ms", inputs={"force.x": ramp("8 N", "0 N", "0 s", "500 ms"), "surface.x": "10 mm/s"}
    )
    plain = step_contacts(block(500.0), 1.0, step=0.01, inputs={"force.x": ramp(8.0, 0.0, 0.0, 0.5), "surface.x": 0.01})
    assert (typed["x"] == plain["x"]).all()
    assert np.ptp(typed["x"]) > 0
    assert (typed["x.position"] == typed["x"]).all()
    assert (typed["x.speed"] == typed.rate("x")).all()
    with pytest.raises(SceneError, match=r"no output `x\.sped`"):
        typed["x.sped"]


def test_units_of_inputs_and_outputs_are_those_that_the_problem_declares():
    problem = block(units={"force.x": "N m", "x": "rad", "surface.x": "rad/s"})
    assert problem.unit("x") == "rad"
    assert block().unit("x") == "m"
    run = step_contacts(problem, 1.0, step=0.1, inputs={"force.x": "8 N m", "surface.x": "60 rpm"})
    assert run.inputs["surface.x"][-1] == pytest.approx(2 * math.pi)
    with pytest.raises(SceneError, match=r"surface\.x"):
        step_contacts(problem, 1.0, step=0.1, inputs={"surface.x": "60 m/s"})
    for units, words in (({"y": "m"}, "names `y`"), ({"x": "metres and more"}, "metres and more")):
        with pytest.raises(SceneError, match=words):
            block(units=units)


def test_a_motion_of_the_surface_that_a_law_drives_is_held_over_whole_steps():
    """The speed of the plate is set from the position that is measured: a block that sticks follows what is held between samples exactly."""
    law = Sampled(lambda t, y: 0.1 + y[0], "50 ms", measured_signals="x.position", actuated_signals="surface.x")
    run = step_contacts(block(load=[1e5]), 0.4, step=0.01, controller=law)
    assert (run.contact_modes[1:] == 0).all()
    position, speeds = [0.0], []
    for _ in range(8):
        speeds.append(0.1 + position[-1])
        position.append(position[-1] + 0.05 * speeds[-1])
    np.testing.assert_allclose(run["x"][::5], position, rtol=1e-9)
    np.testing.assert_allclose(run.inputs["surface.x"][1:], np.repeat(speeds, 5), rtol=1e-9)


def test_the_noise_of_every_seed_is_that_of_a_run_with_located_events():
    """Keys of channels are 64 bits: half of them, as plain numbers, drew other noise or none at all."""

    def seen(run, seed):
        noise = []

        def law(_, y):
            noise.append(float(np.ravel(y)[0]))
            return 0.0

        run(Sampled(law, 0.1, noise={"block.speed": 1.0}, seed=seed, measured_signals="block.speed", actuated_signals="block.force"))
        return noise

    at_rest = block(force_inputs={"block.force": [1.0]}, surface_velocity={}, outputs={"block": [1.0]})
    for seed in range(6):
        noise = seen(lambda law: step_contacts(at_rest, 5.0, step=0.1, controller=law), seed)
        assert noise == seen(lambda law: simulate(compose(Block()), 5.0, controller=law), seed)
        assert np.std(noise) == pytest.approx(1.0, abs=0.3)


def test_impacts_take_nothing_where_contacts_stay_closed():
    """Two feet of an elastic body under a weight, in stick-slip on a surface: how they press is round-off beside what friction takes."""
    random = np.random.default_rng(7)
    root = random.normal(size=(8, 8))
    problem = ContactProblem(
        np.diag(0.5 + random.random(8)), 1e8 * root @ root.T + 1e8 * np.eye(8), np.eye(8)[[0, 1]][:, None], Coulomb(0.5, 0.3), normal=np.eye(8)[2:4],
        damping=10.0 * np.eye(8), force_inputs={"press": np.eye(8)[2:4].sum(axis=0)}, surface_velocity={"belt": [[1.0], [1.0]]},
    )  # fmt: skip
    rest = press_contacts(problem, {"press": 1e3})
    run = step_contacts(problem, 0.2, step=1e-3, inputs={"press": 1e3, "belt": 1e-4}, start=rest)
    audit = run.audit()
    assert (run.contact_modes != 2).all() and (run.contact_modes == 1).any() and audit["friction"] > 0
    assert audit["impacts"] == 0.0
    assert (run.energy.stepping >= 0).all() and abs(audit["missing"]) < 1e-9 * audit["size"]


def test_impacts_take_what_falls_and_the_stepping_only_what_falls_with_the_step():
    """A weight that falls by 1 m, from whatever part of a step; and one that a pull lifts off a belt again and again, which strikes it and rubs at once."""
    unit, gravity = np.eye(2), 9.81
    fall = ContactProblem(unit, 0 * unit, unit[None, 1:], Coulomb(MU, MU), normal=-unit[:1], gap=[1.0], force_inputs={"weight": unit[0]})
    for step in (1e-3, 1.37e-3, 2e-3):
        audit = step_contacts(fall, 1.0, step=step, inputs={"weight": -gravity}).audit()
        assert audit["impacts"] == pytest.approx(gravity, rel=1e-9)
        assert abs(audit["stepping"]) < 1e-9 and abs(audit["missing"]) < 1e-9
    lifted = ContactProblem(
        unit, np.diag([100.0, 50.0]), unit[None, 1:], Coulomb(0.3, 0.3), normal=-unit[:1], damping=np.diag([0.0, 1.0]),
        force_inputs={"pull": unit[0]}, surface_velocity={"belt": [[1.0]]},
    )  # fmt: skip
    rest = press_contacts(lifted, {"pull": -5.0})
    runs = [
        step_contacts(lifted, 2.0, step=step, inputs={"pull": sine(-5.0, 12.0, 1.3), "belt": 0.4}, start=rest)
        for step in (2e-3, 1e-3, 5e-4)
    ]
    assert runs[0].contact_modes.min() == 0 and runs[0].contact_modes.max() == 2
    taken = [run.audit()["stepping"] for run in runs]
    for coarse, fine in itertools.pairwise(taken):
        assert coarse / fine == pytest.approx(2.0, rel=0.03)
    assert abs(runs[-1].audit()["missing"]) < 1e-12 * runs[-1].audit()["size"] + 1e-12


# ------------------------------------------------------------------------------------------------------------------------------------------ borders
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"load": None}, "Either `normal`"),
        ({"normal": [[1.0]]}, "Either `normal`"),
        ({"load": [-1.0]}, ">= 0"),
        ({"load": [1.0, 2.0]}, r"shape \(1,\)"),
        ({"mass": [[math.nan]]}, "mass"),
        ({"tangent": [[1.0]]}, "tangent"),
        ({"tangent": np.zeros((0, 1, 1))}, "at least one contact"),
        ({"friction": 0.3}, "friction law"),
        ({"friction": StepFriction()}, "without breaks"),
        ({"friction": Coulomb(0.2, 0.3)}, "kinetic"),
        ({"force_inputs": {"pull": [1.0, 2.0]}}, "pull"),
        ({"contact_positions": [[0.0], [1.0]]}, "contact_positions"),
        ({"contact_areas": [-1.0]}, ">= 0"),
        ({"contact_areas": [0.0]}, "`contact_areas` must be > 0 for one contact"),
        ({"mass": [[-1.0]]}, "`mass` must not be negative along any motion"),
    ],
)
def test_problems_that_are_none_are_refused(changes, words):
    with pytest.raises(SceneError, match=words):
        block(**changes)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"duration": 0.0}, "duration"),
        ({"step": -1.0}, "step"),
        ({"step": 1e-9}, "1000000 steps"),
        ({"inputs": {"force.z": 1.0}}, "force.x"),
        ({"inputs": {"force.x": "much"}}, "force.x"),
        ({"inputs": {"force.x": "3 m"}}, "force.x"),
        ({"inputs": {"surface.x": "3 N"}}, "surface.x"),
        ({"inputs": {"force.x": math.nan}}, "must be a finite number"),
        ({"inputs": {"force.x": 1 / time}}, "finite at all times"),
        ({"inputs": 3.0}, "inputs"),
        ({"duration": "1 m"}, "duration"),
        ({"step": "many"}, "step"),
        ({"start": 3.0}, "ContactRun"),
    ],
)
def test_runs_refuse_what_they_cannot_do(arguments, words):
    with pytest.raises(SceneError, match=words):
        step_contacts(block(), **{"duration": 1.0, "step": 0.01} | arguments)


def test_what_is_no_problem_is_refused():
    for ask in (lambda: step_contacts("cube", 1.0, step=0.1), lambda: press_contacts(None)):
        with pytest.raises(SceneError, match="must be a ContactProblem"):
            ask()
    with pytest.raises(SceneError, match="numbers for a state of rest"):
        press_contacts(block(1.0), {"force.x": ramp(0.0, 1.0, 0.0, 1.0)})
    assert press_contacts(block(500.0), {"force.x": "3 N"}).tangential[0, 0, 0] == pytest.approx(-3.0)


def test_a_part_that_no_contact_holds_rests_until_it_is_pushed():
    chain = np.array([[0.1, -0.1, 0.0], [-0.1, 0.4, -0.3], [0.0, -0.3, 0.3]])  # free, but for round-off
    stiffness = np.block([[chain, np.zeros((3, 3))], [np.zeros((3, 3)), chain]])
    problem = ContactProblem(np.eye(6), stiffness, np.eye(6)[None, :1], Coulomb(MU, MU), load=[LOAD], force_inputs={"push": np.eye(6)[5]})
    assert np.abs(press_contacts(problem).coordinates).max() == 0.0
    with pytest.raises(SceneError, match="hold all rigid motions, but under these inputs one is free"):
        press_contacts(problem, {"push": 1.0})


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda: block(directions=2, stiffness=1.0, damping=[[0.0, 1.0], [0.0, 0.0]]), "symmetric"),
    (lambda: step_contacts(block(), 1.0, step=0.1, start=step_contacts(block(directions=2), 1.0, step=0.5)), "as many coordinates"),
    *each_of(lambda changes: step_contacts(block(**changes), 1.0, step=0.1), "`tangent`", ({"tangent": np.ones((2, 1, 1)), "load": [1.0, 1.0],
     "force_inputs": {}, "surface_velocity": {}}, {"tangent": np.zeros((1, 1, 1))})),
    # a body that slips away has no state of rest
    (lambda: press_contacts(block(), {"force.x": 1e3}), "", (SceneError, SimulationError)),
)  # fmt: skip


def test_a_body_whose_stiffness_has_the_wrong_sign_is_refused_and_one_that_is_slightly_unstable_is_not():
    with pytest.raises(SceneError, match=r"over a step of 0\.1 s one of -4\.98e\+03 N/m pushes on: is a sign wrong"):
        step_contacts(block(-5180.0), 1.0, step=0.1)
    assert step_contacts(block(-5.0), 1.0, step=0.1, inputs={"force.x": 3.0})["x"][-1] == 0.0  # 3 N are less than mu N = 4 N


def test_a_reduced_body_becomes_a_problem_with_named_inputs_and_outputs():
    body = ElasticBody(np.eye(3), 1e4 * np.eye(3), dof_map=[[0, 1, 2]])
    reduced = body.reduced({"x.0": body.point(0, "x"), "y.0": body.point(0, "y"), "z.0": body.point(0, "z")})
    problem = reduced.mounted({"x.0": (5.0, 2.0)}).in_contact(Coulomb(0.3, 0.3), ("x", "y"), "z", force_ports=("z.0",))
    assert problem.stiffness[0, 0] == pytest.approx(1e4 + 5.0)
    assert problem.damping[0, 0] == 2.0
    assert set(problem.force_inputs) == {"z.0"}
    assert set(problem.surface_velocity) == {"surface.x", "surface.y"}
    run = step_contacts(problem, 0.01, step=1e-3, inputs={"z.0": -10.0, "surface.x": 0.1})
    assert run.normal[-1, 0] == pytest.approx(10.0)
    for arguments, options, words in (
        (((),), {}, "as many contacts"),
        (("x", "z"), {}, "a tuple of words"),
        ((("x", "y", "z"),), {"load": [1.0]}, "one or two words"),
        ((("x", "x"), "z"), {}, "words that differ"),
        ((("x", "y"), "y"), {}, "words that differ"),
        ((("x", "y"), "z"), {"normal_sign": 0.5}, "1 or -1"),
        ((("x", "y"), "z"), {"force_ports": "z.0"}, "tuple of ports"),
        ((("x", "y"), "z"), {"force_ports": ("z.1",)}, "no port `z.1`"),
    ):
        with pytest.raises(SceneError, match=words):
            reduced.in_contact(Coulomb(0.3, 0.3), *arguments, **options)
    with pytest.raises(SceneError, match="must map ports"):
        reduced.mounted(["x.0"])


@pytest.mark.parametrize("step", [0.01, 0.02])
def test_a_push_acts_over_its_own_steps_alone_so_that_a_puck_gets_the_whole_of_it(step):
    """A push of 0.1 s that jumps to 0, and one that jumps from 0: by the momentum F T - mu N T both throw the puck equally far."""
    push, length = 100.0, 0.1
    deceleration = MU * LOAD / MASS
    speed = (push / MASS - deceleration) * length
    far = speed * length / 2 + speed**2 / (2 * deceleration)
    problem = block(directions=2)
    for begin in (0.0, 0.3, 0.7):  # 3 * 0.1 and 7 * 0.1 are not 0.3 and 0.7 to the last bit
        values = ([0.0, begin, begin, begin + length, begin + length], [0.0, 0.0, push, push, 0.0])
        pushes = {
            "force.x": (values[0], [0.6 * value for value in values[1]]),
            "force.y": (values[0], [0.8 * value for value in values[1]]),
        }
        run = step_contacts(problem, 5.0, step=step, inputs=pushes)
        assert np.hypot(run["x"][-1], run["y"][-1]) == pytest.approx(far, rel=2e-4)
        np.testing.assert_allclose(0.8 * run["x"], 0.6 * run["y"], atol=1e-12)


def test_a_plate_that_jumps_to_a_speed_carries_a_stuck_block_over_whole_steps():
    held = block(stiffness=100.0)
    run = step_contacts(held, 0.3, step=0.1, inputs={"surface.x": ([0.0, 0.1, 0.1, 0.2, 0.2, 0.3], [0.0, 0.0, 0.05, 0.05, 0.0, 0.0])})
    np.testing.assert_allclose(run["x"], [0.0, 0.0, 0.005, 0.005], atol=1e-12)


def test_contacts_at_rest_on_the_edge_of_their_friction_stick_and_do_not_flicker():
    """Three nodes without mass between springs k, pulled at the last: node i lets go when the pull is the friction of all from i to the last."""
    k, pull = 1e4, 7.5
    unit, stiffness = np.eye(3), k * np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    problem = ContactProblem(
        0 * stiffness,
        stiffness,
        unit[:, None],
        Coulomb(0.5, 0.5),
        load=[2.0, 10.0, 4.0],
        force_inputs={"pull": unit[2]},
        outputs={"x.2": unit[2]},
    )
    run = step_contacts(problem, 3.0, step=0.01, inputs={"pull": ([0.0, 1.0, 2.0, 3.0], [0.0, pull, pull, -pull])})
    by_hand = [  # 2 N and 7 N forth; back by twice 2 N, and until 2 N and 5 N hold what is left of 0.5 N between the first two
        (2.0 / pull, "contact.2", "slip"), (7.0 / pull, "contact.1", "slip"), (1.0, "contact.1", "stick"), (1.0, "contact.2", "stick"),
        (2.0 + 4.0 / (2 * pull), "contact.2", "slip"), (2.0 + 14.0 / (2 * pull), "contact.1", "slip"),
    ]  # fmt: skip
    assert [(event.element, event.after) for event in run.events] == [tuple(what) for _, *what in by_hand]
    np.testing.assert_allclose([event.time for event in run.events], [at for at, *_ in by_hand], atol=0.0101)
    assert run["x.2"][100] == pytest.approx(6.0 / k)
