"""Predictive laws: the regulator they become, limits, answers that do not pass, disturbances, and the trap of a lowered peak."""

import copy
import dataclasses
import pickle

import casadi as ca
import control
import numpy as np
import pytest

from controllers import LinearMPC, NonlinearMPC, StiffPI, condensing, quadratic_program
from controllers.predictive import Record
from controllers.quadratic_program import SOLVERS, QuadraticProgram, residuals
from controllers.string_model import drilling_point
from controllers.watchdog import MEMORY, STANDS, SWINGS, Watchdog
from models import BitRock, TorsionalChain, wells
from toolbox import Budget, Sampled, Scene, SceneError, compose, simulate
from toolbox.authoring import zero_order_hold
from toolbox.errors import BudgetError
from toolbox.simulation import EventExact

WEIGHT = 97_347.0
RIG = compose(wells.JANSEN_2, BitRock(weight=WEIGHT))
LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}
STATES = {"sensors": ("top.speed", "bit.speed", "chain.twist.0"), "sensor_noise": (1e-3, 1e-3, 1e-3)}
HEAVIER = {"bit.weight": 1.1 * WEIGHT}


def drilling(speed, weight=WEIGHT):
    """The steady state of the rig at a speed, and its torque."""
    plant = compose(wells.JANSEN_2, BitRock(weight=weight))
    _, x, u, _ = drilling_point(plant, speed)
    return dict(zip(("chain.twist.0", "chain.speed.0", "chain.speed.1"), x, strict=True)), u


# --- without limits


@pytest.mark.parametrize("horizon", [1, 7, 40])
def test_without_active_limits_the_linear_law_is_the_regulator_of_the_riccati_equation_at_any_horizon(horizon):
    law = LinearMPC(reference=8.0, horizon=horizon, top_speed_scale=2.0, torque_scale=3000.0, torque_step_scale=4000.0, **STATES)
    planned = law.design(RIG)
    model, x_s, u_s, A = drilling_point(RIG, 8.0)
    F, G = zero_order_hold(A, model.B[:, None], 0.1)
    # the same problem for another solver: states (x, last torque) with torques in kN m, input the change of the torque
    F = np.block([[F, 1e3 * G], [np.zeros((1, 3)), np.ones((1, 1))]])
    G = np.append(1e3 * G, 1.0)[:, None]
    Q = np.zeros((4, 4))
    Q[:3, :3] = np.outer(model.top, model.top) / 2.0**2 + np.outer(model.bit, model.bit) / 2.0**2
    Q[3, 3] = 1 / 3.0**2
    K, _, _ = control.dlqr(F, G, Q, [[1 / 3.0**2 + 1 / 4.0**2]], np.array([[0.0], [0.0], [0.0], [1 / 3.0**2]]))
    # a state off the steady one, and the torque T of the rock that the law takes for constant
    T = float(np.linalg.lstsq(model.E[:, None], A @ x_s + model.B * u_s, rcond=None)[0][0])
    x, last = x_s + np.array([1.5, -0.7, 0.9]), u_s + 700.0
    planned.filter.waiting[-1] = last
    torque, reason = planned.plan(np.append(x, T))
    assert reason == ""
    expected = last - 1e3 * float((K @ np.append(x - x_s, (last - u_s) / 1e3)).item())
    assert torque == pytest.approx(expected, rel=1e-6)


@pytest.mark.slow
def test_the_cost_of_a_longer_iteration_is_never_above_that_of_a_single_one():
    values = []
    for iterations in (1, 3, 30):
        law = NonlinearMPC(reference=4.0, iterations=iterations, **LIMITS, **STATES).design(RIG)
        law.filter.waiting[-1] = 9000.0
        law.plan(np.array([26.0, 3.0, 4.0, 8000.0]))
        values.append(law.value)
        assert law.record.programs <= iterations
    assert values[0] >= values[1] >= values[2]
    assert values[2] < values[0]


def test_the_plan_of_the_regulator_rests_at_its_steady_state_and_goes_by_its_gain_elsewhere():
    law = NonlinearMPC(reference=8.0, adapt_rock_strength=False, **LIMITS, **STATES).design(RIG)
    weights, N, n = law.weights, law.law.horizon, 3
    x_s, u_s = (np.array(each) for each in drilling_point(RIG, 8.0)[1:3])
    weights.x_s[:], weights.numbers[condensing.STEADY], weights.numbers[condensing.LAST] = x_s, u_s, u_s
    rest = law.rollout.motion(x_s, np.empty((N, 1)))
    condensing.regulated(rest, weights)
    np.testing.assert_allclose(rest.U, u_s, rtol=1e-8)
    np.testing.assert_allclose(rest.X, np.tile(x_s, (N + 1, 1)), rtol=1e-8)
    weights.numbers[condensing.LAST] = before = u_s + 700.0
    moved = law.rollout.motion(x_s + np.array([0.5, -0.7, 0.3]), np.empty((N, 1)))
    condensing.regulated(moved, weights)
    for x, u in zip(moved.X, moved.U[:, 0], strict=False):
        assert u == pytest.approx(before - weights.gain[:n] @ (x - x_s) - weights.gain[n] * (before - u_s), rel=1e-9)
        before = u


def test_the_predicted_motion_is_what_simulate_gives_for_the_planned_torques():
    law = NonlinearMPC(reference=4.0, integration_steps=8, adapt_rock_strength=False, **LIMITS, **STATES).design(RIG)
    law.filter.waiting[-1] = 9000.0
    law.plan(np.array([26.0, 3.0, 4.0, 8000.0]))
    times = np.arange(41) * 0.1
    start = dict(zip(("chain.twist.0", "chain.speed.0", "chain.speed.1"), law.states[0], strict=True))
    held_torques = (np.repeat(times, 2)[1:-1], np.repeat(law.torques[:, 0], 2))
    run = simulate(RIG, 4.0, start=start, inputs={"top.torque": held_torques}, output_times=times, accuracy=1e-10)
    assert np.abs(run.states - law.states).max() < 1e-5


# --- limits


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_a_law_that_solves_programs_without_end_ends_with_the_seconds_of_its_run(solver):
    H, A, g, low, high = program()
    solved = QuadraticProgram(H, A, solver)

    def law(t, y):
        while True:
            solved.solve(g, low, high)

    with pytest.raises(BudgetError, match=r"s and reached t = 0 s"):
        simulate(RIG, 1.0, controller=law, sample_time=0.1, method=EventExact(budget=Budget(seconds=0.1)))
    assert solved.solve(g, low, high).sound


@pytest.mark.parametrize("law", [LinearMPC, NonlinearMPC])
def test_limits_of_torque_and_rate_are_kept_exactly_while_they_bind(law):
    numbers = {"lowest_torque": 2000.0, "highest_torque": 15_000.0, "torque_rate": 10_000.0}
    run = simulate(RIG, 40.0, controller=law(reference=8.0, **numbers, **STATES), sample_time=0.1)
    torques = np.array(run.answers[0]).ravel()
    assert torques[0] >= 0.0  # the first one starts from rest, within the rate
    assert torques.max() == 15_000.0
    assert torques[10:].min() >= 2000.0
    changes = np.abs(np.diff(torques))
    assert changes.max() <= 1000.0 * (1 + 1e-12)
    assert np.isclose(changes, 1000.0).sum() > 5
    free = simulate(RIG, 40.0, controller=law(reference=8.0, **STATES), sample_time=0.1)
    torques = np.array(free.answers[0]).ravel()
    assert torques.max() > 15_000.0  # the twin without limits goes beyond
    assert np.abs(np.diff(torques)).max() > 1000.0


def test_a_limit_of_the_top_speed_is_kept_by_the_prediction_and_passed_without_it():
    start, _ = drilling(4.0)
    speeds = {}
    for limit in (None, 8.2):
        law = LinearMPC(reference=8.0, highest_speed=limit, top_speed_scale=20.0, **LIMITS, **STATES)
        run = simulate(RIG, 30.0, start=start, controller=law, sample_time=0.1)
        speeds[limit] = run["top.speed"].max()
        assert not run.controllers[0].record.fallbacks
    assert speeds[None] > 8.35
    assert speeds[8.2] < 8.25  # the slope of the rock changes on the way, which the linear law does not know


def test_a_hard_limit_that_cannot_be_kept_makes_the_soft_drive_act_and_is_recorded_and_a_soft_one_gives_way():
    start, _ = drilling(8.0)
    runs = {}
    for soft in (True, False):
        law = LinearMPC(
            reference=8.0, highest_twist=5.0, soft_limits=soft, drive_process_noise=50.0, torque_process_noise=200.0, **LIMITS, **STATES
        )
        runs[soft] = simulate(RIG, 5.0, start=start, controller=law, sample_time=0.1)
    assert start["chain.twist.0"] > 5.0
    assert not runs[True].controllers[0].record.fallbacks
    record = runs[False].controllers[0].record
    assert [when for when, _ in record.fallbacks][:3] == pytest.approx([0.0, 0.1, 0.2])
    assert record.fallbacks[0][1] == "daqp stopped: nothing keeps all limits"
    assert "fallbacks, first at 0 s" in str(record)
    first = runs[False].answers[0][0][0]
    assert 0.0 <= first < 100.0  # from the torque that was, 0, without a jump


# --- answers that must not count


def program(seed=1, n=8, m=12):
    random = np.random.default_rng(seed)
    root, A = random.normal(size=(n, n)), random.normal(size=(m, n))
    low, high = np.append(np.full(n, -0.3), np.full(m, -0.5)), np.append(np.full(n, 0.3), np.full(m, 0.5))
    return root @ root.T + np.eye(n), A, 3.0 * random.normal(size=n), low, high


@pytest.mark.parametrize("solver", SOLVERS)
def test_every_solver_gives_the_same_answer_or_none(solver):
    H, A, g, low, high = program()
    exact = QuadraticProgram(H, A).solve(g, low, high)
    assert exact.sound and (np.abs(exact.multipliers) > 1e-6).any()
    found = QuadraticProgram(H, A, solver)
    answer = found.solve(g, low, high)
    if solver == "qrqp" and not answer.sound:
        assert "KKT residual" in answer.reason  # it says that it succeeded
        return
    assert answer.sound
    assert answer.z == pytest.approx(exact.z, abs=1e-5)
    found.update(2.0 * H, A)  # in place
    assert found.solve(2.0 * g, low, high).z == pytest.approx(exact.z, abs=1e-5)


@pytest.fixture(scope="module")
def problems():
    """H, A, the row of the first torque in parts of its limit, and what a law with limits has to solve beside a drive that lets the bit stick."""
    run = simulate(RIG, 30.0, controller=StiffPI(reference=4.0), sample_time=0.01, inputs=HEAVIER)
    assert run.time_in("bit", "stick") > 10.0
    law = LinearMPC(reference=4.0, torque_rate=40_000.0, highest_speed=8.0, highest_twist=32.0, **LIMITS, **STATES).design(RIG)
    recorded, solve = [], law.program.solve

    def recording(*vectors):
        recorded.append([vector.copy() for vector in vectors])
        return solve(*vectors)

    law.program.solve = recording
    instants = run.at(np.arange(0.0, 30.0, 0.1))
    for k, t in enumerate(instants.time):
        law(t, np.array([instants[name][k] for name in law.measured_signals]))
    return law.program.H, law.program.A, law.back[0] * law.law.torque_scale / LIMITS["highest_torque"], recorded


@pytest.mark.parametrize("solver", [name for name in SOLVERS if name not in ("daqp", "qrqp")])
def test_every_plan_that_counts_has_the_same_first_torque_whatever_the_solver(problems, solver):
    H, A, torque, recorded = problems
    exact, found = QuadraticProgram(H, A), QuadraticProgram(H, A, solver)
    pairs = [(exact.solve(*vectors), found.solve(*vectors)) for vectors in recorded[::2]]
    assert all(mine.sound for mine, _ in pairs)
    assert sum((np.abs(mine.multipliers[H.shape[0] :]) > 1e-6).any() for mine, _ in pairs) > 50  # limits are active
    off = [abs(torque @ (theirs.z - mine.z)) for mine, theirs in pairs if theirs.sound]
    assert len(off) > 0.95 * len(pairs) and max(off) < 1e-3


def test_the_design_of_a_nonlinear_law_loads_everything_that_a_sample_needs(monkeypatch):
    from toolbox.authoring import Compiled

    called, call = set(), Compiled.__call__

    def watched(loop, *given):
        called.add(loop.py_func.__name__.strip("_"))
        return call(loop, *given)

    monkeypatch.setattr(Compiled, "__call__", watched)
    for sensors in (("top.speed",), STATES["sensors"]):
        called.clear()
        NonlinearMPC(reference=8.0, sensors=sensors, sensor_noise=(1e-3,) * len(sensors)).design(RIG)
        assert called >= {"advance", "cost", "condense", "wound_up", "regulated", "kkt"}


def test_the_check_rejects_answers_that_are_corrupted_in_any_way():
    H, A, g, low, high = program()
    answer = QuadraticProgram(H, A).solve(g, low, high)
    z, y = answer.z, answer.multipliers
    assert residuals(H, A, g, low, high, z, y).largest < 1e-9
    assert residuals(H, A, g, low, high, z + 1e-3, y).stationarity > 1e-6
    active = np.flatnonzero(np.abs(y) > 1e-6)[0]
    assert residuals(H, A, g, low, high, z, np.where(np.arange(y.size) == active, -y, y)).largest > 1e-6  # a wrong sign
    assert residuals(H, A, g, 0.5 * low, 0.5 * high, z, y).violation > 1e-3
    assert residuals(H, A, g, 2.0 * low, 2.0 * high, z, y).complementarity > 1e-3
    assert residuals(H, A, g, low, high, np.full_like(z, np.nan), y).largest == np.inf


def test_a_program_without_answer_is_not_sound_for_any_solver():
    H, A, g, low, high = program()
    impossible = low.copy()
    impossible[8:] = 1e3
    for solver in SOLVERS:
        assert not QuadraticProgram(H, A, solver).solve(g, impossible, np.maximum(high, impossible + 1.0)).sound
    assert not QuadraticProgram(H, A).solve(np.full(8, np.nan), low, high).sound


def test_with_or_without_its_own_package_daqp_gives_the_same_plans(problems, monkeypatch):
    pytest.importorskip("daqp")
    H, A, torque, recorded = problems
    own = QuadraticProgram(H, A)
    monkeypatch.setattr(quadratic_program, "interface", lambda solver: quadratic_program._Plugin)
    plugged = QuadraticProgram(H, A)
    assert type(own._call) is not type(plugged._call)
    pairs = [(own.solve(*vectors), plugged.solve(*vectors)) for vectors in recorded]
    assert all(mine.sound and theirs.sound for mine, theirs in pairs)
    assert max(abs(torque @ (theirs.z - mine.z)) for mine, theirs in pairs) < 1e-6
    own.update(2.0 * H, A)
    g, low, high = recorded[0]
    assert own.solve(2.0 * g, low, high).z == pytest.approx(pairs[0][0].z, abs=1e-6)


@pytest.mark.parametrize("law", [LinearMPC, NonlinearMPC])
def test_a_solver_that_lies_is_replaced_by_the_soft_drive_and_the_run_says_when(law, monkeypatch):
    solver = quadratic_program.interface("daqp")
    honest = solver.__call__
    count = []

    def lying(self, *given):
        count.append(0)
        z, y = honest(self, *given)
        return (z + 0.1, y) if 20 <= len(count) <= 24 else (z, y)

    monkeypatch.setattr(solver, "__call__", lying)
    run = simulate(RIG, 10.0, controller=law(reference=8.0, **LIMITS, **STATES), sample_time=0.1)
    fallbacks = run.controllers[0].record.fallbacks
    assert len(fallbacks) == 5
    assert fallbacks[0][0] > 1.0  # not before the lie, and not after it
    assert np.diff([when for when, _ in fallbacks]) == pytest.approx([0.1] * 4)
    assert all("KKT residual" in why for _, why in fallbacks)


@pytest.mark.parametrize("solver", ["daqp", "piqp"])
def test_a_warm_start_changes_nothing_but_time(solver):
    runs = [
        simulate(RIG, 15.0, controller=LinearMPC(reference=6.0, solver=solver, warm_start=warm, **LIMITS, **STATES), sample_time=0.1)
        for warm in (True, False)
    ]
    answers = [np.array(run.answers[0]).ravel() for run in runs]
    failed = [[t for t, _ in run.controllers[0].record.fallbacks] for run in runs]
    assert failed == [[], []]
    assert answers[0].max() > 19_999.0  # the limit is active
    assert np.abs(answers[0] - answers[1]).max() < 1.0  # N m


# --- disturbances, estimates, delay


def test_the_linear_law_has_no_offset_under_a_torque_that_its_model_does_not_know():
    start, _ = drilling(8.0)
    ends = {}
    for walk in (2000.0, 1e-3):
        law = LinearMPC(reference=8.0, torque_process_noise=walk, **LIMITS)
        run = simulate(RIG, 80.0, start=start, inputs=HEAVIER, controller=law, sample_time=0.1)
        ends[walk] = run["top.speed"][-1]
    assert ends[2000.0] == pytest.approx(8.0, abs=1e-6)
    assert abs(ends[1e-3] - 8.0) > 0.5  # a filter that believes in a constant torque of zero


def test_the_nonlinear_law_has_no_offset_either_and_learns_the_strength_of_the_rock():
    start, _ = drilling(8.0)
    runs = {
        adapt: simulate(
            RIG,
            80.0,
            start=start,
            inputs=HEAVIER,
            controller=NonlinearMPC(reference=8.0, adapt_rock_strength=adapt, **LIMITS),
            sample_time=0.1,
        )
        for adapt in (True, False)
    }
    assert runs[True]["top.speed"][-1] == pytest.approx(8.0, abs=1e-4)
    assert runs[True].controllers[0].strength == pytest.approx(1.1, abs=1e-3)
    assert abs(runs[False]["top.speed"][-1] - 8.0) > 0.05


def test_the_filter_knows_when_a_late_command_arrives():
    free = compose(wells.JANSEN_2, BitRock(weight=0.0))
    errors = {}
    for known in (0.03, 0.0):
        law = LinearMPC(reference=4.0, delay=known, **LIMITS, **STATES).design(free)
        missed = []

        def watched(t, y, law=law, missed=missed):
            missed.append(np.abs(law.filter.rows @ law.filter.z - y).max())
            return law(t, y)

        watched.measured_signals, watched.actuated_signals = law.measured_signals, law.actuated_signals
        simulate(free, 10.0, controller=Sampled(watched, 0.1, delay=0.03), accuracy=1e-10)
        errors[known] = max(missed)
    assert errors[0.03] < 1e-8
    assert errors[0.0] > 1e-2


@pytest.mark.parametrize("delay", [0.03, 0.1, 0.35])
def test_a_delay_that_the_law_knows_is_as_if_it_measured_so_much_later(delay):
    # a string without rock is linear: the law must command now what one without delay would, given the state at which its command will arrive
    free = compose(wells.JANSEN_2, BitRock(weight=0.0))
    late = LinearMPC(reference=4.0, delay=delay, **LIMITS, **STATES)
    prompt = LinearMPC(reference=4.0, **LIMITS, **STATES).design(free)
    times = np.arange(100) * 0.1 + delay
    run = simulate(free, 11.0, controller=Sampled(late, 0.1, delay=delay), output_times=times, accuracy=1e-11)
    commands = np.array(run.answers[0]).ravel()[:100]
    assert commands.max() > 5000.0
    for k in range(100):
        prompt.filter.waiting[-1] = commands[k - 1] if k else 0.0
        expected, _ = prompt.plan(np.append(run.states[k], 0.0))
        assert commands[k] == pytest.approx(min(max(expected, 0.0), 20_000.0), abs=0.05)
    # the twin that does not know of it commands something else
    blind = simulate(free, 11.0, controller=Sampled(LinearMPC(reference=4.0, **LIMITS, **STATES), 0.1, delay=delay))
    assert np.abs(np.array(blind.answers[0]).ravel()[:100] - commands).max() > 10.0


@pytest.mark.parametrize("law", [LinearMPC, NonlinearMPC])
def test_a_delay_of_three_and_a_half_periods_leaves_a_law_that_knows_it_able_to_end_stick_slip(law):
    stuck = {}
    for known in (0.35, 0.0):
        late = Sampled(law(reference=5.0, delay=known, **LIMITS), 0.1, delay=0.35)
        run = simulate(RIG, 120.0, inputs=HEAVIER, controller=late)
        stuck[known] = run.time_in("bit", "stick", after=60.0)
        if known:
            assert run.at(120.0)["bit.speed"] == pytest.approx(5.0, abs=0.05)
    assert stuck[0.35] == 0.0
    assert stuck[0.0] > 1.0


# --- the stiction trap


@pytest.mark.parametrize("speed", [3.0, 4.0, 6.0, 8.0])
def test_a_lowered_peak_parks_the_string_for_ever_while_its_solver_reports_success(speed):
    naive = NonlinearMPC(
        reference=speed, width=0.5, match_static_peak=False, adapt_rock_strength=False, fallback_time=1e6, **LIMITS, **STATES
    )
    run = simulate(RIG, 120.0, inputs=HEAVIER, controller=naive, sample_time=0.1)
    record = run.controllers[0].record
    assert run.time_in("bit", "stick") == 120.0
    assert not record.fallbacks and record.answer.sound  # every program was solved to its KKT conditions
    assert abs(run.at(120.0)["top.speed"]) < 0.05  # it stands
    assert run.at(120.0)["top.load"] < 0.8 * 1.1 * WEIGHT * 0.155575  # below what would break the bit free
    assert run["top.torque"][-1] < 19_000.0  # and the drive could
    # the watchdog, which looks at the string and not at the solver, has the soft drive break the bit free
    watched = simulate(RIG, 120.0, inputs=HEAVIER, controller=dataclasses.replace(naive, fallback_time=5.0), sample_time=0.1)
    assert watched.time_in("bit", "stick") < 110.0
    assert watched.controllers[0].record.fallbacks[0][1] == STANDS


@pytest.mark.parametrize("speed", [3.0, 4.0, 6.0, 8.0])
def test_a_matched_peak_breaks_the_bit_free(speed):
    """Whether it holds the bit then, on a rock that is heavier than it knows, round-off decides at low set-points."""
    law = NonlinearMPC(reference=speed, width=0.2, fallback_time=1e6, **LIMITS, **STATES)
    run = simulate(RIG, 90.0, inputs=HEAVIER, controller=law, sample_time=0.1)
    assert run.events and run.events[0].after == "slip+" and run.events[0].time < 20.0
    assert run["top.load"].max() > 0.8 * 1.1 * WEIGHT * 0.155575
    assert not run.controllers[0].record.fallbacks


@pytest.mark.parametrize("speed", [3.0, 4.0, 6.0, 8.0])
def test_exact_modes_free_the_bit_and_hold_it(speed):
    run = simulate(RIG, 90.0, inputs=HEAVIER, controller=NonlinearMPC(reference=speed, **LIMITS, **STATES), sample_time=0.1)
    assert run.time_in("bit", "stick", after=45.0) == 0.0
    assert run.at(90.0)["bit.speed"] == pytest.approx(speed, abs=0.02)
    assert not run.controllers[0].record.fallbacks


@pytest.mark.parametrize("speed", [3.0, 4.0, 6.0, 8.0])
def test_exact_modes_free_the_bit_on_the_top_speed_alone(speed):
    run = simulate(RIG, 90.0, inputs=HEAVIER, controller=NonlinearMPC(reference=speed, **LIMITS), sample_time=0.1)
    assert run.time_in("bit", "stick", after=45.0) == 0.0
    assert run.at(90.0)["bit.speed"] == pytest.approx(speed, abs=0.02)


@pytest.mark.parametrize("speed", [3.0, 4.0, 6.0, 8.0])
def test_the_linear_law_frees_the_bit_too(speed):
    run = simulate(RIG, 90.0, inputs=HEAVIER, controller=LinearMPC(reference=speed, **LIMITS, **STATES), sample_time=0.1)
    assert run.time_in("bit", "stick", after=45.0) == 0.0


# --- a drive that is not the declared one

OTHERS = {
    "drive - 10 %": (0.9, 1.0, 1.0),
    "drive + 20 %": (1.2, 1.0, 1.0),
    "light drive, heavy bit, soft string": (0.8, 1.2, 0.8),
    "heavy drive, light bit, stiff string": (1.2, 0.8, 1.2),
    "all light": (0.8, 0.8, 0.8),
}
TRUSTING = {LinearMPC: {"drive_process_noise": 50.0}, NonlinearMPC: {"drive_torque_error": 0.0}}


def on_another_rig(law, drive, bit, stiffness):
    """180 s on the top speed alone, noise and delay included, with inertias and stiffness in parts of the declared ones."""
    other = {"chain.inertia": (2122.0 * drive, 374.0 * bit), "chain.stiffness": (473.0 * stiffness,)}
    late = Sampled(law, 0.1, delay=0.03, noise={"top.speed": 0.01}, seed=3)
    return simulate(RIG, 180.0, controller=late, parameters=other, output_times=np.arange(0.0, 180.0, 0.05))


@pytest.mark.slow
@pytest.mark.parametrize("law", [LinearMPC, NonlinearMPC])
@pytest.mark.parametrize("rig", OTHERS.values(), ids=OTHERS)
def test_on_a_rig_that_is_not_the_declared_one_the_bit_turns_at_its_set_point_with_the_soft_drive_at_rest(law, rig):
    run = on_another_rig(law(reference=8.0, delay=0.03, **LIMITS), *rig)
    assert run.time_in("bit", "stick", after=60.0) == 0.0
    assert run["bit.speed"][1200:].mean() == pytest.approx(8.0, rel=0.05)
    taken = [when for when, _ in run.controllers[0].record.fallbacks if when >= 60.0]
    assert 0.1 * len(taken) <= 0.1 * 120.0


@pytest.mark.slow
@pytest.mark.parametrize("rig", [OTHERS["drive - 10 %"], OTHERS["drive + 20 %"]])
def test_a_filter_that_trusts_its_drive_parks_the_bit_and_the_watchdog_sees_the_motor_swing(rig):
    trusting = NonlinearMPC(reference=8.0, delay=0.03, **TRUSTING[NonlinearMPC], **LIMITS)
    parked = on_another_rig(dataclasses.replace(trusting, fallback_time=1e6), *rig)
    assert parked.time_in("bit", "stick", after=60.0) > 60.0
    assert not parked.controllers[0].record.fallbacks and parked.controllers[0].record.answer.sound
    watched = on_another_rig(trusting, *rig)
    assert {why for _, why in watched.controllers[0].record.fallbacks} <= {STANDS, SWINGS}
    assert watched.time_in("bit", "stick", after=60.0) < 20.0


def test_the_linear_law_swings_between_its_limits_with_a_filter_that_trusts_its_drive():
    trusting = LinearMPC(reference=8.0, delay=0.03, fallback_time=1e6, **TRUSTING[LinearMPC], **LIMITS)
    swings = {}
    for label, law in (("trusts", trusting), ("allows for 20 %", LinearMPC(reference=8.0, delay=0.03, **LIMITS))):
        run = on_another_rig(law, *OTHERS["drive + 20 %"])
        swings[label] = float(np.std(run["top.torque"][1200:]) / np.mean(run["top.torque"][1200:]))
    assert swings["trusts"] > 0.5
    assert swings["allows for 20 %"] < 0.02


# --- the watchdog


def watched_for(seconds, speed, load, command):
    """What a watchdog of a drive of 0 to 20 kN m with 5 s of patience says in each sample of 0.1 s, and the watchdog."""
    dog = Watchdog(0.1, 5.0, 0.0, 20_000.0)
    times = np.arange(0.0, seconds, 0.1)
    return times, [dog(speed(t), load(t), command(t), 8.0) for t in times], dog


def test_a_string_that_stands_is_given_its_patience_and_one_that_is_wound_up_all_the_time_it_takes():
    times, said, _ = watched_for(40.0, lambda t: 0.0, lambda t: 6000.0, lambda t: 6000.0)
    first = next(t for t, why in zip(times, said, strict=True) if why)
    assert said[round(first / 0.1)] == STANDS
    assert 5.0 < first < 30.0  # the mean torque settles, then nothing is gained
    _, winding, _ = watched_for(40.0, lambda t: 0.5, lambda t: 500.0 + 400.0 * t, lambda t: 10_000.0)
    _, turning, _ = watched_for(40.0, lambda t: 8.0, lambda t: 9000.0, lambda t: 9000.0)
    assert not any(winding[:200]) and not any(turning[100:])


def test_the_soft_drive_acts_twice_as_long_each_time():
    _, said, dog = watched_for(200.0, lambda t: 0.0, lambda t: 6000.0, lambda t: 6000.0)
    acts = np.array([bool(why) for why in said])
    edges = np.flatnonzero(np.diff(acts.astype(int)))
    lengths = np.diff(edges)[::2] * 0.1
    assert dog.times >= 3
    assert lengths[:3] == pytest.approx([10.0, 20.0, 40.0], abs=0.11)


def test_a_motor_between_its_limits_is_seen_and_one_at_a_limit_is_not():
    _, said, _ = watched_for(30.0, lambda t: 4.0, lambda t: 8000.0, lambda t: 20_000.0 * (int(t / 0.5) % 2))
    assert SWINGS in said
    _, said, _ = watched_for(30.0, lambda t: 4.0, lambda t: 8000.0 + 500.0 * t, lambda t: 20_000.0)
    assert SWINGS not in said


def test_the_exported_watchdog_is_the_one_in_python():
    rng, dog = np.random.default_rng(4), Watchdog(0.1, 1.0, 0.0, 20_000.0)
    symbols = [ca.SX.sym("memory", len(MEMORY))] + [ca.SX.sym(name) for name in ("speed", "load", "command", "reference")]
    step = ca.Function("step", symbols, dog.expressions(*symbols))
    memory, seen = np.zeros(len(MEMORY)), set()
    for k in range(3000):
        phase = (k // 300) % 3  # parked, swinging, turning
        speed = (0.0, 4.0, 8.0)[phase] + 0.1 * rng.normal()
        load, command = 8000.0 + 10.0 * rng.normal(), (8000.0, 20_000.0 * (k % 2), 9000.0)[phase]
        why = dog(speed, load, command, 8.0)
        memory, acts = step(memory, speed, load, command, 8.0)
        memory = np.array(memory).ravel()
        assert bool(acts) == bool(why)
        seen.add(why)
    assert seen == {"", STANDS, SWINGS}


# --- set-points that move


@pytest.mark.parametrize("law", [LinearMPC, NonlinearMPC])
def test_a_set_point_given_as_an_input_is_followed_and_stands_in_for_the_field(law):
    profile = ((0.0, 60.0, 70.0), (5.0, 5.0, 8.0))
    moved = simulate(RIG, 100.0, controller=law(reference=6.0, **LIMITS), sample_time=0.1, inputs={"top.reference": profile})
    kept = simulate(RIG, 60.0, controller=law(reference=6.0, **LIMITS), sample_time=0.1)
    for run, time, speed in ((moved, 59.0, 5.0), (moved, 100.0, 8.0), (kept, 60.0, 6.0)):
        assert run.at(time)["top.reference"] == speed
        assert run.at(time)["bit.speed"] == pytest.approx(speed, abs=2e-3)
    given = simulate(RIG, 20.0, controller=law(reference=6.0, **LIMITS), sample_time=0.1, inputs={"top.reference": 6.0})
    assert np.array(given.answers[0])[:200] == pytest.approx(
        np.array(kept.answers[0])[:200], abs=1.0
    )  # N m; steps differ with the duration


def test_a_python_law_is_given_the_inputs_that_it_asks_for_behind_what_it_measures():
    seen = []

    def law(t, y):
        seen.append(tuple(y))
        return 0.0

    law.measured_signals, law.actuated_signals = ("bit.speed",), ("top.torque",)
    law.defaults = {"top.reference": (3.0, "rad/s")}
    simulate(RIG, 0.35, controller=law, sample_time=0.1)
    simulate(RIG, 0.35, controller=law, sample_time=0.1, inputs={"top.reference": ((0.0, 1.0), (1.0, 2.0))})
    assert np.array(seen) == pytest.approx(np.array([(0.0, value) for value in (3.0, 3.0, 3.0, 3.0, 1.0, 1.1, 1.2, 1.3)]))


def test_a_scene_tells_a_law_what_it_knows_apart_from_what_is_so(tmp_path, root):
    scene = Scene.load(root / "studies" / "scenes" / "predictive.toml")
    case = scene.case("linear MPC")
    assert (case.law.delay, case.law.sensor_noise, case.delay, case.noise) == (0.03, (0.01,), 0.03, {"top.speed": 0.01})
    other = dataclasses.replace(
        scene, cases=(dataclasses.replace(case, delay=0.05, law=dataclasses.replace(case.law, sensor_noise=(0.02,))),)
    )
    assert Scene.load(other.save(tmp_path / "other.toml")) == other
    text = (root / "studies" / "scenes" / "predictive.toml").read_text()
    (tmp_path / "wrong.toml").write_text(text.replace('law = "LinearMPC", ', 'law = "LinearMPC", delay_samples = 3, '))
    with pytest.raises(SceneError, match="There is no key `delay_samples` in `LinearMPC`"):
        Scene.load(tmp_path / "wrong.toml")


# --- an ordinary controller


def test_a_run_starts_with_a_fresh_law_keeps_it_and_is_repeated_by_its_error():
    law = LinearMPC(reference=8.0, **LIMITS, **STATES)
    first, second = (simulate(RIG, 20.0, controller=law, sample_time=0.1) for _ in range(2))
    assert np.array_equal(first.states[-1], second.states[-1])
    assert len(first.controllers[0].record.seconds) == 200
    assert first.error_estimate < 1e-5
    designed = law.design(RIG)
    third = simulate(RIG, 20.0, controller=designed, sample_time=0.1)
    assert np.array_equal(first.states[-1], third.states[-1])
    assert not designed.started  # the run worked on a copy
    assert first.controllers[0].record.median > 0 and "200 samples" in str(first.controllers[0].record)
    assert str(Record()) == "no samples"


@pytest.mark.parametrize("law", [LinearMPC, NonlinearMPC])
def test_designed_laws_copy_and_pickle_with_their_memory(law):
    designed = law(reference=8.0, **LIMITS, **STATES).design(RIG)
    y = np.array([1.0, 0.5, 3.0])
    for k in range(3):
        designed(0.1 * k, y)
    twins = [copy.deepcopy(designed), pickle.loads(pickle.dumps(designed))]
    torques = [twin(0.3, y) for twin in (designed, *twins)]
    assert torques[1] == pytest.approx(torques[0], abs=1e-6) and torques[2] == pytest.approx(torques[0], abs=1e-6)


def test_bad_arguments_are_named():
    for wrong, words in (
        ({"horizon": 0}, "horizon"),
        ({"sensor_noise": (0.1, 0.1)}, "sensor_noise"),
        ({"delay": -0.1}, "delay"),
        ({"solver": "best"}, "solver"),
        ({"period": -1.0}, "period"),
        ({"highest_torque": -5000.0, "lowest_torque": 0.0}, "highest_torque"),
    ):
        with pytest.raises(SceneError, match=f"`.*{words}`.* must"):
            simulate(RIG, 1.0, controller=LinearMPC(**wrong), sample_time=0.1)
    with pytest.raises(SceneError, match="`sample_time` must be 0.1 s"):
        simulate(RIG, 1.0, controller=LinearMPC(), sample_time=0.05)
    with pytest.raises(SceneError, match="`sample_time`"):
        simulate(RIG, 1.0, controller=LinearMPC())
    with pytest.raises(SceneError, match="`iterations` must"):
        simulate(RIG, 1.0, controller=NonlinearMPC(iterations=0), sample_time=0.1)
    with pytest.raises(SceneError, match="drill string with a rock"):
        simulate(compose(TorsionalChain()), 1.0, controller=LinearMPC(), sample_time=0.1)
    with pytest.raises(SceneError, match="linear in the states, but `bit.torque`"):
        simulate(RIG, 1.0, controller=LinearMPC(sensors=("bit.torque",)), sample_time=0.1)


@pytest.mark.parametrize("seed", [101, 102])
def test_with_noise_and_a_late_command_the_nonlinear_law_on_the_top_speed_alone_still_ends_stick_slip(seed):
    law = NonlinearMPC(reference=4.0, delay=0.03, **LIMITS)
    measured = Sampled(law, 0.1, delay=0.03, noise={"top.speed": 0.01}, seed=seed)
    run = simulate(RIG, 120.0, inputs=HEAVIER, controller=measured)
    assert run.time_in("bit", "stick", after=60.0) == 0.0
