"""The linearly implicit method: its order, its damping, and the same machines as the explicit one steps through."""

import ctypes
import dataclasses
import pickle
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

from controllers import LQG, LQR, PI, HInfinity
from models import BitRock, BlockOnBelt, Exponential, Hyperbolic, TorsionalChain
from studies.benchmarks.stiff import deviated
from toolbox import (
    Component,
    DryFriction,
    Equations,
    Scene,
    closed_loop,
    compose,
    energy_audit,
    equilibrium,
    linearise,
    quantity,
    simulate,
    state,
)
from toolbox.compilation import work_layout
from toolbox.compilation.implicit_step import FASTEST_GROWTH
from toolbox.compilation.rosenbrock import RODAS5P
from toolbox.compilation.sparse_factors import elimination, factors
from toolbox.errors import BudgetError
from toolbox.inputs import ramp, sine
from toolbox.simulation import EventExact, carry_out, stiffness, thin_records
from toolbox.simulation.budget import Budget
from toolbox.simulation.growth import longest_followed
from toolbox.simulation.stiffness import pays, progress, spectral_radius, stiff_size
from toolbox.simulation.work_arrays import work_arrays

# --- the method: conditions of order, E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section IV.7


def coefficients():
    """alpha_ij, beta_ij = alpha_ij + gamma_ij and b_i of the method in its original form."""
    s = len(RODAS5P.a)
    a, c = np.zeros((s, s)), np.zeros((s, s))
    for i in range(s):
        a[i, :i], c[i, :i] = RODAS5P.a[i], RODAS5P.c[i]
    gamma = np.linalg.inv(np.eye(s) / RODAS5P.gamma - c)
    last = a[-1].copy()
    last[-1] = 1.0
    return a @ gamma, a @ gamma + gamma, last @ gamma


def test_the_coefficients_satisfy_all_conditions_of_order_five():
    a, beta, b = coefficients()
    al, be = a.sum(axis=1), beta.sum(axis=1)
    conditions = [
        (b.sum(), 1), (b @ be, 1 / 2), (b @ al**2, 1 / 3), (b @ beta @ be, 1 / 6), (b @ al**3, 1 / 4), (b @ (al * (a @ be)), 1 / 8),
        (b @ beta @ al**2, 1 / 12), (b @ beta @ beta @ be, 1 / 24), (b @ al**4, 1 / 5), (b @ (al**2 * (a @ be)), 1 / 10), (b @ (a @ be) ** 2, 1 / 20),
        (b @ (al * (a @ al**2)), 1 / 15), (b @ (al * (a @ beta @ be)), 1 / 30), (b @ beta @ al**3, 1 / 20), (b @ beta @ (al * (a @ be)), 1 / 40),
        (b @ beta @ beta @ al**2, 1 / 60), (b @ beta @ beta @ beta @ be, 1 / 120),
    ]  # fmt: skip
    for k, (left, right) in enumerate(conditions):
        assert left == pytest.approx(right, abs=1e-11), k
    np.testing.assert_allclose(al, RODAS5P.alpha, atol=1e-12)
    np.testing.assert_allclose(be - al, RODAS5P.slope_weights, atol=1e-12)


def test_fast_modes_die_within_a_step_and_no_decaying_mode_grows():
    _, beta, b = coefficients()
    one = np.ones(b.size)

    def growth(z):
        return abs(1 + z * b @ np.linalg.solve(np.eye(b.size) - z * beta, one))

    assert growth(-1e9) < 1e-6
    assert max(growth(1j * y) for y in np.geomspace(1e-2, 1e4, 500)) <= 1 + 1e-9
    left_half = [r * np.exp(1j * angle) for r in np.geomspace(0.1, 1e4, 60) for angle in np.linspace(np.pi / 2, np.pi, 20)]
    assert max(map(growth, left_half)) <= 1 + 1e-9


def test_a_growing_mode_is_followed_as_long_as_a_step_may_stand_and_not_beyond():
    _, beta, b = coefficients()

    def growth(z):
        return 1 + z * b @ np.linalg.solve(np.eye(b.size) - z * beta, np.ones(b.size))

    assert growth(FASTEST_GROWTH) == pytest.approx(np.exp(FASTEST_GROWTH), rel=0.03)
    assert growth(1.5 * FASTEST_GROWTH) < 0  # the danger: it would go the other way,
    assert abs(growth(1e6)) < 1e-4  # or seem to die


@dataclass(frozen=True)
class Relaxation(Component):
    """x' = rate (sin(t + x) - cos(t) - x): nonlinear and driven in time."""

    rate: float = quantity(1.0, "1/s", "how fast")

    def equations(self, signal):
        x = state("point.x", "1")
        drive = signal("point.drive", "1", default=0.0)
        return Equations(flow={x: -self.rate * (x - drive) + 0.2 * ca.sin(3 * x) + signal("point.slope", "1/s", default=0.0)})


def fixed_steps(plant, inputs, x0, duration, count):
    """End state of `count` equal steps of the compiled step, without any control of errors."""
    run = simulate(plant, 0.0, inputs=inputs, method="stiff")
    machine, n = run.program.kernel, len(x0)
    pointer = ctypes.c_void_p
    kind = ctypes.CFUNCTYPE(None, ctypes.c_double, ctypes.c_double, *[pointer] * 5)
    field, step = kind(machine.addresses[0]), kind(machine.addresses[1])
    x, k, p, m = np.array(x0, float), np.zeros(n), run.parameters, np.ones(max(machine.elements, 1))
    y = np.zeros(4 * n + 2 * machine.guards + 8)

    def call(function, t, h):
        function(t, h, *(array.ctypes.data for array in (x, k, p, m, y)))

    call(field, 0.0, 0.0)
    for i in range(count):
        k[:] = y[n : 2 * n]
        call(step, i * duration / count, duration / count)
        x[:] = y[:n]
    return x


def test_the_error_of_a_smooth_driven_motion_falls_with_the_fifth_power_of_the_step():
    from toolbox import time

    plant, inputs = compose(Relaxation()), {"point.drive": time**2}
    exact = fixed_steps(plant, inputs, [0.5], 3.0, 4000)
    errors = [abs(fixed_steps(plant, inputs, [0.5], 3.0, n) - exact)[0] for n in (80, 160, 320)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders == pytest.approx([5, 5], abs=0.3)


@pytest.mark.parametrize("rate", [1e3, 1e6])
def test_a_stiff_relaxation_towards_a_moving_target_keeps_order_four(rate):
    # Prothero and Robinson: x' = -rate (x - phi) + phi', x = phi; here with the small nonlinear term taken off
    from toolbox import time

    phi = ca.sin(time) + 2
    inputs = {"point.drive": phi, "point.slope": ca.cos(time) - 0.2 * ca.sin(3 * phi)}
    plant = compose(Relaxation(rate=rate))
    errors = [abs(fixed_steps(plant, inputs, [2.0], 2.0, n)[0] - (np.sin(2.0) + 2)) for n in (8, 16, 32)]
    assert errors[0] < 1e-4
    assert max(errors[-1], 1e-13) < max(errors[0] / 2 ** (2 * 3.5), 1e-11)  # at a rate of 1e6 round-off is reached


def test_the_elimination_solves_sparse_systems_with_algebraic_rows():
    generator = np.random.default_rng(3)
    matrix = np.diag(generator.uniform(-3, -2, 9)) + np.diag(generator.uniform(-1, 1, 8), 1) + np.diag(generator.uniform(-1, 1, 6), -3)
    matrix[0, 8] = 0.3
    sparse = ca.sparsify(ca.SX(ca.DM(matrix)))
    values, solve, least = factors(sparse, ca.SX(2.0), extra=2)
    right = generator.uniform(-1, 1, 7)
    full = np.diag([2.0] * 7 + [0.0] * 2) - matrix
    expected = np.linalg.solve(full, np.append(right, [0, 0]))[:7]
    np.testing.assert_allclose(np.array(solve(ca.DM(values), right)).ravel(), expected, rtol=1e-12)
    assert float(least) > 0  # the eigenvalues of the matrix all decay


@pytest.mark.parametrize(
    "law", [Hyperbolic(static=1.0, decay=1e6), Exponential(static=1.0, kinetic=0.5, decay=1e6)], ids=["hyperbolic", "exponential"]
)
@pytest.mark.parametrize("accuracy", [1e-3, 1e-6])
def test_a_block_breaks_away_though_implicit_damping_would_hold_it(law, accuracy):
    # after stick the slip grows at the rate F_s decay / m = 1e6/s from nothing: a long implicit step sees no error in letting it die
    # without the damping the block comes back with all but a part in 1e5 of the force at which it broke away, and round-off decides whether it sticks
    plant = compose(BlockOnBelt(damping=0.1, friction=law))
    exact = simulate(plant, 50.0, start={"block.speed": 0.2}, method="explicit", accuracy=1e-10)
    run = simulate(plant, 50.0, start={"block.speed": 0.2}, method="stiff", accuracy=accuracy)
    assert run.merged == 0
    assert len(run.events) == len(exact.events)
    assert run.difference(exact) < accuracy
    assert run.error_estimate < accuracy


@pytest.mark.parametrize("n", [5, 50])
def test_the_operations_of_an_elimination_are_known_from_its_pattern(n):
    # of a chain each of n - 1 pivots meets one entry below and one to the right; of a full matrix the k-th meets k of each
    cases = [(ca.Sparsity.banded(n, 1), np.append(np.ones(n - 1), 0)), (ca.Sparsity.dense(n, n), np.arange(n))]
    for pattern, entries in cases:
        assert elimination(pattern) == ((1 + entries + 2 * entries**2).sum(), 2 * (2 * entries.sum() + n))


# --- machines


def string(n, friction=None, **changes):
    """A chain like a pipe cut into n elements: stiffness k n, damping c n, inertia J / n."""
    inertia = np.full(n, 374.0 / n)
    inertia[0] += 2122.0
    inertia[-1] += 374.0
    parts = {
        "inertia": tuple(inertia),
        "stiffness": (473.0 * n,) * (n - 1),
        "damping": (23.2 * n,) * (n - 1),
        "top_drag": 425.0,
        "bit_drag": 50.0,
    }
    if friction is not None:
        parts |= {"friction": Exponential(static=1.0, kinetic=0.65, decay=1.0), "friction_load": (friction / n,) * (n - 1)}
    return TorsionalChain(**(parts | changes))


PLANTS = {
    "bit": (compose(string(40), BitRock()), {"top.torque": 10_000.0}),
    "everywhere": (compose(string(12, 1500.0), BitRock(weight=60_000.0)), {"top.torque": 9_000.0}),
}


def switches(run):
    return [(event.element, event.before, event.after) for event in run.events]


@pytest.mark.parametrize("name", PLANTS)
@pytest.mark.parametrize("accuracy", [1e-3, 1e-6])
def test_the_stiff_method_finds_the_switches_of_the_explicit_one(name, accuracy):
    plant, inputs = PLANTS[name]
    truth = simulate(plant, 40.0, inputs=inputs, method="explicit", accuracy=1e-10)
    run = simulate(plant, 40.0, inputs=inputs, method="stiff", accuracy=accuracy)
    assert switches(run) == switches(truth)
    assert len(run.events) > 10
    times = np.linspace(0, 40, 501)
    size = np.abs(truth.states).max(axis=0)
    assert (np.abs(run.at(times).states - truth.at(times).states).max(axis=0) / size).max() < accuracy
    stuck = run.modes["bit"] == "stick"
    assert np.all(run["bit.speed"][stuck] == 0.0)


def test_run_error_is_measured_by_a_better_run():
    plant, inputs = PLANTS["bit"]
    run = simulate(plant, 20.0, inputs=inputs, method="stiff", accuracy=1e-4)
    assert 0 < run.error_estimate < 1e-3


@pytest.mark.parametrize("accuracy", [1e-3, 1e-6])
def test_a_linear_stiff_string_follows_its_closed_form(accuracy):
    # x' = A x + b with eigenvalues up to 1e6 1/s, by the exponential of the matrix
    plant = compose(TorsionalChain(inertia=(1.0, 1.0, 0.01), stiffness=(1.0, 1e4), damping=(0.1, 1e4)))
    a = np.zeros((5, 5))
    a[0, [2, 3]] = 1, -1
    a[1, [3, 4]] = 1, -1
    for i, (k, c) in enumerate(((1.0, 0.1), (1e4, 1e4))):
        row = np.zeros(5)
        row[[i, 2 + i, 3 + i]] = k, c, -c
        a[2 + i] -= row
        a[3 + i] += row / (0.01 if i else 1.0)
    extended = np.zeros((6, 6))
    extended[:5, :5], extended[2, 5] = a, 1.0
    run = simulate(plant, 20.0, inputs={"top.torque": 1.0}, method="stiff", accuracy=accuracy)
    times = np.linspace(0.5, 20, 40)
    exact = np.array([(expm(extended * t) @ [0, 0, 0, 0, 0, 1.0])[:5] for t in times])
    assert (np.abs(run.at(times).states - exact).max(axis=0) / np.abs(exact).max(axis=0)).max() < 10 * accuracy
    assert sum(run.steps) < 5_000


def test_a_string_that_its_friction_holds_never_slips():
    run = simulate(compose(string(12, 40_000.0), BitRock()), 10.0, inputs={"top.torque": 2_000.0}, method="stiff")
    assert not run.events
    assert np.all(run["chain.speed"] == 0.0)
    assert np.all(run["chain.twist"] == 0.0)


def test_no_energy_is_lost_by_steps_far_beyond_the_fast_modes():
    plant, inputs = PLANTS["bit"]
    audit = energy_audit(simulate(plant, 20.0, inputs=inputs, method="stiff", accuracy=1e-6))
    explicit = energy_audit(simulate(plant, 20.0, inputs=inputs, method="explicit", accuracy=1e-6))
    assert audit.relative < max(1e-5, 10 * explicit.relative)


@dataclass(frozen=True)
class Stack(Component):
    """Five disks pressed together, the first driven, the last held by a spring: contacts that share disks hold each other."""

    driven: float = quantity(30.0, "N m", "torque on the first disk")
    stiffness: float = quantity(4e4, "N m/rad", "of the mount")
    damping: float = quantity(400.0, "N m s/rad", "of the mount")

    def equations(self, signal):
        angle, speed = state("stack.angle", "rad"), state("stack.speed", "rad/s", 5)
        shake = signal("stack.shake", "N m", default=0.0)
        law = Exponential(static=0.4, kinetic=0.3, decay=1.0)
        contacts = [DryFriction(f"stack.{i}", speed[i] - speed[i + 1], law, 60.0 + 10 * i, slip_unit="rad/s") for i in range(4)]
        push = [self.driven + shake, 0.0, 0.0, 0.0, -self.stiffness * angle - self.damping * speed[4]]
        for i, contact in enumerate(contacts):
            push[i] += contact.force
            push[i + 1] -= contact.force
        return Equations(flow={angle: speed[4], speed: ca.vertcat(*push) / 0.1}, elements=contacts)


@pytest.mark.parametrize("shake", [0.0, sine(0.0, 20.0, 2.0)], ids=["constant", "shaken"])
def test_contacts_that_hold_each_other_switch_as_in_the_explicit_method(shake):
    plant = compose(Stack())
    arguments = {"inputs": {"stack.shake": shake}, "start": {"stack.speed": [2.0, 1.0, 0.5, 0.0, 0.0]}}
    truth = simulate(plant, 2.0, **arguments, method="explicit", accuracy=1e-9)
    run = simulate(plant, 2.0, **arguments, method="stiff", accuracy=1e-5)
    assert switches(run) == switches(truth)
    assert run.events
    times = np.linspace(0, 2, 101)
    size = np.abs(truth.states).max(axis=0)
    assert (np.abs(run.at(times).states - truth.at(times).states).max(axis=0) / size).max() < 1e-4


@dataclass(frozen=True)
class Bumper(Component):
    """A mass on a stiff damper, with a spring that only pushes: m v' = F - c v - k max(x, 0) - |x|."""

    damping: float = quantity(1e4, "N s/m", "damping")

    def equations(self, signal):
        x, v = state("bumper.position", "m"), state("bumper.speed", "m/s")
        force = signal("bumper.force", "N", default=0.0)
        return Equations(flow={x: v, v: force - self.damping * v - 1e4 * ca.fmax(x, 0) - 1e3 * ca.fabs(x - 0.2)})


def test_kinks_and_tables_are_met_as_by_the_explicit_method():
    plant = compose(Bumper())
    arguments = {"inputs": {"bumper.force": ((0, 1, 1, 3, 5), (0, 8e3, -6e3, 6e3, -1e3))}, "start": {"bumper.position": -0.1}}
    truth = simulate(plant, 6.0, **arguments, method="explicit", accuracy=1e-10)
    run = simulate(plant, 6.0, **arguments, method="stiff", accuracy=1e-6)
    times = np.linspace(0, 6, 301)
    error = np.abs(run.at(times).states - truth.at(times).states).max(axis=0) / np.abs(truth.states).max(axis=0)
    assert error.max() < 1e-5
    assert sum(run.steps) < 0.1 * sum(truth.steps)


def test_a_sampled_drive_is_met_as_by_the_explicit_method():
    plant = compose(string(40), BitRock())
    arguments = {"controller": PI(proportional=2e4, integral=2e3, reference=5.0), "sample_time": 0.05}
    truth = simulate(plant, 15.0, **arguments, method="explicit", accuracy=1e-9)
    run = simulate(plant, 15.0, **arguments, method="stiff", accuracy=1e-5)
    assert switches(run) == switches(truth)
    times = np.linspace(0, 15, 301)
    size = np.abs(truth.states).max(axis=0)
    assert (np.abs(run.at(times).states - truth.at(times).states).max(axis=0) / size).max() < 1e-4


# --- the choice


def test_a_stiff_plant_is_recognised_and_a_mild_one_left_alone():
    # the open-loop twin: the explicit method pays for the same answer with ten times the steps
    plant, inputs = compose(string(100), BitRock()), {"top.torque": 10_000.0}
    run = simulate(plant, 60.0, inputs=inputs, accuracy=1e-4)
    assert run.program.formulas is RODAS5P
    explicit = simulate(plant, 60.0, inputs=inputs, accuracy=1e-4, method="explicit")
    assert sum(explicit.steps) > 10 * sum(run.steps)
    assert switches(run) == switches(explicit)
    assert run.error_estimate < 1e-3
    mild = simulate(compose(BlockOnBelt()), 2000.0)
    assert mild.program.formulas is not RODAS5P


@dataclass(frozen=True)
class Relaxations(Component):
    """Forty states that decay at rates from 1 to 3e4 1/s, each alone, or mixed by a rotation so that all depend on all."""

    mixed: bool = False

    def equations(self, signal):
        x = state("many.x", "1", 40)
        rotation = np.linalg.qr(np.random.default_rng(0).standard_normal((40, 40)))[0] if self.mixed else np.eye(40)
        matrix = rotation @ np.diag(np.geomspace(1.0, 3e4, 40)) @ rotation.T
        return Equations(flow={x: -ca.sparsify(ca.SX(ca.DM(matrix))) @ (x - signal("many.goal", "1", default=1.0))})


@pytest.mark.slow
def test_an_elimination_that_would_take_longer_than_the_run_is_not_written():
    # 2/3 40^3 instructions where all states depend on all; the twin without that is stepped by the stiff method
    runs = {mixed: simulate(compose(Relaxations(mixed)), 10.0) for mixed in (True, False)}
    programs = {mixed: {key[2] for key in run.program.system.cache if key[0] == "program"} for mixed, run in runs.items()}
    assert "rodas5p" not in programs[True] and runs[True].run.method == EventExact()
    assert runs[False].program.formulas is RODAS5P
    assert stiff_size(runs[True].program) > 40**3 * 2 / 3 > 100 * stiff_size(runs[False].program)


@pytest.mark.parametrize("law", [LQG(reference=8.0), HInfinity(reference=8.0), LQR(reference=8.0)], ids=lambda law: type(law).__name__)
def test_the_stiff_step_under_a_law_that_knows_the_whole_string_grows_with_its_length_alone(law):
    # a feedback and an observer gain fill a row and a column: an arrow, whose elimination stays linear when it comes last
    sizes = []
    for n in (8, 16):
        run = simulate(compose(string(n), BitRock()), 0.0, controller=law, method="explicit")
        sizes.append(stiff_size(run.program))
    assert sizes[1] < 2.3 * sizes[0]


def test_the_choice_is_the_same_with_output_times():
    plant, inputs = compose(string(100), BitRock()), {"top.torque": 10_000.0}
    times = np.linspace(0, 60, 61)
    run = simulate(plant, 60.0, inputs=inputs, accuracy=1e-3, output_times=times)
    whole = simulate(plant, 60.0, inputs=inputs, accuracy=1e-3)
    assert run.program.formulas is whole.program.formulas is RODAS5P
    np.testing.assert_array_equal(run.time, times)
    np.testing.assert_array_equal(run.states, whole.at(times).states)


@pytest.fixture
def eager(monkeypatch):
    """Looks at stiffness for which no run is too short."""
    monkeypatch.setattr(stiffness, "WORTH", 0.0)
    monkeypatch.setattr(stiffness, "COMPILING", 0.0)


@pytest.mark.slow
def test_a_run_that_proves_stiff_on_its_way_goes_on_with_implicit_steps(eager, monkeypatch):
    # contacts let go one after the other at first, each with a layer that both kinds of steps follow; then stability alone holds explicit ones
    plant, inputs, times = deviated(200, everywhere=True), {"top.torque": 10_000.0}, np.linspace(0.0, 10.0, 41)
    run, explicit = (simulate(plant, 10.0, inputs=inputs, method=method) for method in ("event", "explicit"))
    turn, formulas = run.before
    assert 0.0 < turn < 10.0 and formulas is explicit.program.formulas and run.program.formulas is RODAS5P
    assert run.why == f"{RODAS5P.steps} at t = {turn:.9g} s and later: before that {formulas.steps}"
    early = run.time <= turn
    np.testing.assert_array_equal(run.time[early], explicit.time[: early.sum()])  # the steps until then stay
    assert sum(run.steps) - early.sum() < 0.5 * (sum(explicit.steps) - early.sum())
    assert switches(run) == switches(explicit)
    around = np.sort(np.concatenate([times, turn + np.array([-1e-3, -1e-6, 0.0, 1e-6, 1e-3])]))
    np.testing.assert_allclose(run.at(around).states, explicit.at(around).states, rtol=0, atol=1e-7)
    finer = simulate(plant, 10.0, inputs=inputs, method="explicit", accuracy=1e-8)
    assert run.difference(finer) < 1e-6 and run.error_estimate < 1e-6

    asked = simulate(plant, 10.0, inputs=inputs, output_times=times)
    np.testing.assert_array_equal(asked.states, run.at(times).states)
    for twin in (asked, pickle.loads(pickle.dumps(run))):
        np.testing.assert_array_equal(twin.at(around).states, run.at(around).states)
    monkeypatch.setattr(thin_records, "MOST", 2**18)  # bytes
    thin = simulate(plant, 10.0, inputs=inputs)
    assert thin.before == run.before and thin.time.size < run.time.size == thin.every_step.time.size
    np.testing.assert_allclose(thin.at(around).states, run.at(around).states, rtol=0, atol=1e-7)
    np.testing.assert_allclose(thin.every_step.states, run.states, rtol=0, atol=1e-7)

    with pytest.raises(BudgetError) as failed:
        simulate(plant, 10.0, inputs=inputs, method=EventExact(budget=Budget(steps=sum(run.steps) - 20)))
    so_far = failed.value.run
    assert so_far.before == run.before
    both = [turn - 1e-3, so_far.end]
    np.testing.assert_allclose(so_far.at(both).states, run.at(both).states, rtol=0, atol=1e-7)


def test_a_chosen_run_travels():
    plant, inputs = PLANTS["bit"]
    run = simulate(plant, 5.0, inputs=inputs, method="stiff")
    twin = pickle.loads(pickle.dumps(run))
    np.testing.assert_array_equal(twin.at([1.234, 4.5]).states, run.at([1.234, 4.5]).states)


def test_other_parameters_compile_nothing(monkeypatch):
    plant, inputs = PLANTS["bit"]
    simulate(plant, 1.0, inputs=inputs, method="stiff")

    def refused(*arguments):
        raise AssertionError("compiled again")

    monkeypatch.setattr("toolbox.compilation.kernel.compiled_for", refused)
    other = simulate(plant, 1.0, inputs=inputs, method="stiff", parameters={"bit.weight": 50_000.0})
    assert other["bit.speed"].size


def test_a_law_in_python_is_asked_once_per_sample():
    asked = []

    def law(t, y):
        asked.append(t)
        return 10_000.0

    law.measured_signals, law.actuated_signals = ("top.speed",), ("top.torque",)
    run = simulate(compose(string(100), BitRock()), 60.0, controller=law, sample_time=0.5, accuracy=1e-3)
    assert len(asked) == 120
    assert run.program.formulas is not RODAS5P


def test_linear_analysis_does_not_depend_on_the_method():
    plant, inputs = PLANTS["bit"]
    before = linearise(plant, at=equilibrium(closed_loop(plant, inputs={"top.torque": 30_000.0})))
    simulate(plant, 1.0, inputs=inputs, method="stiff")
    after = linearise(plant, at=equilibrium(closed_loop(plant, inputs={"top.torque": 30_000.0})))
    np.testing.assert_array_equal(before.A, after.A)


# --- inertias that are coupled


@pytest.fixture
def cube(root):
    """Eleven rows of an elastic cube on a plate: forces that hold each other through a full mass matrix."""
    return Scene.load(root / "studies/scenes/elastic_slider.toml")


def test_coupled_inertias_take_long_steps_where_nothing_grows_and_more_of_them_for_a_higher_accuracy(cube):
    steps = []
    for accuracy in (1e-3, 1e-5, 1e-7):
        run = simulate(cube.plant(), cube.duration, inputs={"plate.speed": ramp(0.0, 0.01, 0.0, 4.0)}, method="stiff", accuracy=accuracy)
        assert len(run.events) == 11  # one for each row, and none again
        steps.append(sum(run.steps))
    assert steps == sorted(steps)
    assert steps[0] < 500  # their pivots alone would allow 1e-5 s, 3e4 steps


def test_a_row_that_breaks_away_through_coupled_inertias_is_followed(cube):
    # slip grows at 7e7/s from nothing, and the row sticks again within a microsecond; its pivots see none of that
    part = dataclasses.replace(cube.parts[0], friction=Exponential(static=0.35, kinetic=0.25, decay=1e5))
    drive = {"inputs": {"plate.speed": ramp(0.0, 0.01, 0.0, 4.0)}, "method": "stiff"}
    exact = simulate(compose(part), 0.06, accuracy=1e-9, **drive)
    run = simulate(compose(part), 0.06, accuracy=1e-4, **drive)
    assert [event.after for event in exact.events] == ["slip-", "stick"] * 2
    assert exact.events[1].time - exact.events[0].time < 1e-6
    assert [(event.element, event.after) for event in run.events] == [(event.element, event.after) for event in exact.events]
    assert max(abs(one.time - other.time) for one, other in zip(run.events, exact.events, strict=True)) < 1e-4 * 1e-3
    times = np.linspace(0.0, 0.06, 301)  # outside the microseconds of slip, within which so small a shift in time is an error of percents
    largest = np.abs(exact.states).max(axis=0)
    assert (np.abs(run.at(times).states - exact.at(times).states).max(axis=0) < 1e-4 * largest).all()


def test_what_slipping_makes_stiff_is_stepped_implicitly_before_it_slips(cube, monkeypatch):
    looks = []

    def watched(run, program, work, since):
        looks.append(
            (
                *progress(work),
                spectral_radius(program, float(work.reals[work_layout.TIME]), work.x, work.p, work.m),
                pays(run, program, work, since),
            )
        )
        return looks[-1][-1]

    monkeypatch.setattr(carry_out, "pays", watched)
    drive = {"inputs": {"plate.speed": ramp(0.0, 0.01, 0.0, 4.0)}, "accuracy": 1e-6}
    run = simulate(cube.plant(), cube.duration, **drive)
    ((when, steps, events, radius, answer),) = looks
    assert steps == 1000 and events == 0 and answer and when < 0.2 * run.events[0].time
    assert radius == pytest.approx(5.2e5, rel=0.05)  # all rows stick, and explicit steps are bearable still: 31 000 to the end
    stiff = simulate(cube.plant(), cube.duration, method="stiff", **drive)
    assert run.events == stiff.events and np.array_equal(run.states, stiff.states)


def test_a_lone_contact_asks_no_eigenvalues_and_coupled_ones_that_do_not_grow_have_no_longest_step(cube):
    lone = simulate(compose(BlockOnBelt()), 1.0, method="stiff")
    assert longest_followed(lone.program, work_arrays(lone.run, lone.program)) == work_layout.UNTOLD
    rows = simulate(cube.plant(), 0.01, method="stiff")
    assert longest_followed(rows.program, work_arrays(rows.run, rows.program)) > 1e6
