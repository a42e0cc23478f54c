"""Sampled control: exact recursions, delays, several clocks, Python callables, and the order of things at one instant."""

from __future__ import annotations

import functools
import math
import re
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

from controllers import PI, SlidingMode, SoftTorque
from models import BitRock, Coulomb, wells
from tests.mechanisms import Tank
from tests.plants import RIG
from tests.refusals import each_of, refusals
from toolbox import (
    Component,
    Controller,
    DryFriction,
    Equations,
    Sampled,
    SceneError,
    SimulationError,
    Update,
    compose,
    quantity,
    simulate,
    state,
)
from toolbox.inputs import step


@dataclass(frozen=True)
class Proportional(Controller):
    """u = -gain level"""

    measured_signals = ("tank.level",)
    actuated_signals = ("tank.inflow",)

    gain: float = quantity(1.0, "1/s", "gain")

    def continuous(self, signal):
        return Equations(outputs={"tank.inflow": (-self.gain * signal("tank.level", "m"), "m/s")})

    def sampled(self, signal, period):
        return Update(memory={}, outputs={"tank.inflow": (-self.gain * signal("tank.level", "m"), "m/s")})


@dataclass(frozen=True)
class Counter(Controller):
    """u_k = k: open loop, with a memory."""

    measured_signals = ()
    actuated_signals = ("tank.inflow",)

    def sampled(self, signal, period):
        count = state("counter.count", "1")
        return Update(memory={count: count + 1}, outputs={"tank.inflow": (count, "m/s")})


def law(measured_signals, actuated_signals):
    """A decorator that says what a callable measures and drives."""

    def mark(function):
        function.measured_signals, function.actuated_signals = measured_signals, actuated_signals
        return function

    return mark


tank = compose(Tank())
rig = compose(wells.NAVARRO_LOPEZ_2, BitRock(weight=40_000.0))
PERIODS = pytest.mark.parametrize("period", [0.5, 0.1, 0.03, 1 / 3])


# --- exact recursions


@PERIODS
def test_a_sampled_proportional_law_on_an_integrator_is_a_geometric_sequence(period):
    # x_(k+1) = (1 - gain h) x_k, straight lines in between
    run = simulate(tank, 10.0, start={"tank.level": 1.0}, controller=Proportional(gain=1.5), sample_time=period)
    k = np.arange(int(10.0 / period))
    np.testing.assert_allclose(run.at(k * period)["tank.level"], (1 - 1.5 * period) ** k, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(
        run.at((k + 0.3) * period)["tank.level"], (1 - 0.45 * period) * (1 - 1.5 * period) ** k, rtol=1e-11, atol=1e-14
    )


def test_a_law_with_memory_updates_it_once_per_sample():
    # u_k = k: x(n h) = h (0 + 1 + ... + n - 1)
    run = simulate(tank, 5.0, controller=Counter(), sample_time=0.1)
    n = np.arange(50)
    np.testing.assert_allclose(run.at(n * 0.1)["tank.level"], 0.1 * n * (n - 1) / 2, rtol=1e-11, atol=1e-14)
    np.testing.assert_array_equal(run.at((n + 0.5) * 0.1)["tank.inflow"], n)


@pytest.mark.parametrize("period", [0.1, 0.3, 0.01, 1 / 3, 0.7])
def test_samples_are_taken_at_exact_multiples_of_the_period_and_not_at_the_end(period):
    times = []

    @law(("tank.level",), ("tank.inflow",))
    def spy(t, y):
        times.append(t)
        return 0.0

    simulate(tank, 30.0, controller=spy, sample_time=period)
    assert times == [k * period for k in range(10_000) if k * period < 30.0]


def test_a_period_longer_than_the_run_samples_once():
    run = simulate(tank, 2.0, start={"tank.level": 1.0}, controller=Proportional(), sample_time=5.0)
    assert run.at(2.0)["tank.level"] == pytest.approx(-1.0, rel=1e-12)


def test_a_run_of_no_time_takes_no_harm_from_a_sampled_law():
    run = simulate(tank, 0.0, start={"tank.level": 1.0}, controller=Proportional(), sample_time=0.1)
    assert run.at(0.0)["tank.level"] == 1.0


def test_a_sampled_law_may_jump():
    # bang-bang u = -sgn(x_k): from 1 down in steps of the period, then to and fro across zero
    @dataclass(frozen=True)
    class Bang(Controller):
        measured_signals = ("tank.level",)
        actuated_signals = ("tank.inflow",)

        def sampled(self, signal, period):
            level = signal("tank.level", "m")
            return Update(memory={}, outputs={"tank.inflow": (ca.if_else(level > 0, -1.0, 1.0), "m/s")})

    run = simulate(tank, 4.0, start={"tank.level": 1.05}, controller=Bang(), sample_time=0.1)
    np.testing.assert_allclose(run.at([0.5, 1.0, 1.1, 1.2, 3.9])["tank.level"], [0.55, 0.05, -0.05, 0.05, -0.05], atol=1e-12)


# --- delays


@pytest.mark.parametrize("delay", [0.0, 0.03, 0.1, 0.25, 1.0])
@pytest.mark.parametrize("kind", ["casadi", "callable"])
def test_an_open_loop_law_with_a_delay_is_the_law_without_it_later(delay, kind):
    def counter():
        if kind == "casadi":
            return Counter()
        return law(("tank.level",), ("tank.inflow",))(lambda t, y: round(t / 0.1))

    plain = simulate(tank, 4.0, controller=Sampled(counter(), 0.1))
    late = simulate(tank, 4.0 + delay, controller=Sampled(counter(), 0.1, delay=delay))
    times = np.linspace(0, 4, 123)
    np.testing.assert_allclose(late.at(times + delay)["tank.level"], plain.at(times)["tank.level"], rtol=1e-10, atol=1e-12)
    assert late.at(delay * 0.999)["tank.level"] == 0.0


@pytest.mark.parametrize("delay", [0.05, 0.1, 0.13, 0.95])
def test_a_delayed_feedback_follows_its_recursion(delay):
    # u held on [k h + d, (k + 1) h + d) is -gain x(k h): x is piecewise linear and known at every knot
    h, gain, end = 0.1, 0.8, 6.0
    knots = [(k * h + delay, k) for k in range(int(end / h))]

    def exact(t, cache={}):  # noqa: B006
        key = (delay, round(t, 12))
        if key not in cache:
            x, last, u = 1.0, 0.0, 0.0
            for at, k in knots:
                if at >= t:
                    break
                x, last, u = x + u * (at - last), at, -gain * exact(k * h)
            cache[key] = x + u * (t - last)
        return cache[key]

    run = simulate(tank, end, start={"tank.level": 1.0}, controller=Sampled(Proportional(gain=gain), h, delay=delay))
    times = np.arange(0.0, end, 0.07)
    np.testing.assert_allclose(run.at(times)["tank.level"], [exact(t) for t in times], rtol=1e-9, atol=1e-12)


def test_a_delay_destabilises_what_is_stable_without_it():
    # x' = -g x(t - d) is stable for g d < pi/2
    size = {}
    for delay in (1.3, 1.9):
        run = simulate(tank, 60.0, start={"tank.level": 1.0}, controller=Sampled(Proportional(gain=1.0), 0.005, delay=delay))
        size[delay] = np.abs(run.at(np.linspace(50, 60, 200))["tank.level"]).max()
    assert size[1.3] < 0.1 < 1.0 < size[1.9]


# --- limits


def test_a_sampled_pi_tends_to_the_continuous_one_with_the_first_order_of_its_period():
    start = {"chain.speed": (12.0, 11.0), "chain.twist": 5.0}
    controller = PI(proportional=2000.0, integral=500.0, reference=10.0)
    exact = simulate(rig, 10.0, start=start, controller=controller, accuracy=1e-10)
    assert exact.events == []
    periods, errors = [0.08, 0.04, 0.02, 0.01], []
    for period in periods:
        run = simulate(rig, 10.0, start=start, controller=controller, sample_time=period, accuracy=1e-9)
        errors.append(np.abs(run.at(np.linspace(0, 10, 50))["bit.speed"] - exact.at(np.linspace(0, 10, 50))["bit.speed"]).max())
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 2.0, rtol=0.1)


def test_a_sampled_pi_switches_where_the_continuous_one_does_in_the_limit():
    exact = simulate(RIG, 20.0, controller=PI(), accuracy=1e-9)
    errors = []
    for period in (0.02, 0.005):
        run = simulate(RIG, 20.0, controller=PI(), sample_time=period, accuracy=1e-8)
        assert [(e.before, e.after) for e in run.events] == [(e.before, e.after) for e in exact.events]
        errors.append(max(abs(a.time - b.time) for a, b in zip(run.events, exact.events, strict=True)))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)


def test_a_controller_in_the_plant_is_the_controller_of_the_run():
    parts = (wells.JANSEN_2, BitRock())
    inside = simulate(compose(*parts, PI()), 20.0, accuracy=1e-9)
    outside = simulate(compose(*parts), 20.0, controller=PI(), accuracy=1e-9)
    assert [e.time for e in inside.events] == pytest.approx([e.time for e in outside.events], abs=1e-9)


# --- several controllers


@dataclass(frozen=True)
class Tanks(Component):
    def equations(self, signal):
        a, b = state("tanks.a", "m"), state("tanks.b", "m")
        return Equations(flow={a: signal("tanks.in_a", "m/s", default=0.0), b: signal("tanks.in_b", "m/s", default=0.0)})


def hold(measured, driven, function):
    return law((measured,), (driven,))(lambda t, y: function(y[0]))


def test_two_controllers_with_periods_of_their_own_do_not_disturb_each_other():
    laws = [
        Sampled(hold("tanks.a", "tanks.in_a", lambda x: -x), 0.1),
        Sampled(hold("tanks.b", "tanks.in_b", lambda x: -0.5 * x), 0.07, delay=0.0),
    ]
    for order in (laws, laws[::-1]):
        run = simulate(compose(Tanks()), 5.0, start={"tanks.a": 1.0, "tanks.b": 2.0}, controller=order)
        k = np.arange(50)
        np.testing.assert_allclose(run.at(k * 0.1)["tanks.a"], 0.9**k, rtol=1e-11)
        np.testing.assert_allclose(run.at(k * 0.07)["tanks.b"], 2 * 0.965**k, rtol=1e-11)


@dataclass(frozen=True)
class Tick(Controller):
    """a_k = k, held"""

    actuated_signals = ("tanks.in_a",)

    def sampled(self, signal, period):
        count = state("tick.count", "1")
        return Update(memory={count: count + 1}, outputs={"tanks.in_a": (count, "m/s")})


@dataclass(frozen=True)
class Follow(Controller):
    """b_k = what is held on `tanks.in_a` when the sample is taken"""

    measured_signals = ("tanks.in_a",)
    actuated_signals = ("tanks.in_b",)

    def sampled(self, signal, period):
        return Update(memory={}, outputs={"tanks.in_b": (signal("tanks.in_a", "m/s"), "m/s")})


@pytest.mark.parametrize("order", [(0, 1), (1, 0)], ids=["giver first", "taker first"])
def test_samples_of_one_instant_all_come_before_the_holds_whatever_the_order_of_the_list(order):
    # order at one instant: event, sample, update, hold. So the follower sees what was held until now, k - 1
    laws = [Sampled(Tick(), 0.1), Sampled(Follow(), 0.1)]
    run = simulate(compose(Tanks()), 2.0, controller=[laws[i] for i in order])
    k = np.arange(1, 20)
    np.testing.assert_array_equal(run.at((k + 0.5) * 0.1)["tanks.in_a"], k)
    np.testing.assert_array_equal(run.at((k + 0.5) * 0.1)["tanks.in_b"], k - 1)


def test_a_continuous_and_a_sampled_controller_work_side_by_side():
    @dataclass(frozen=True)
    class Drain(Controller):
        measured_signals = ("tanks.a",)
        actuated_signals = ("tanks.in_a",)

        def continuous(self, signal):
            return Equations(outputs={"tanks.in_a": (-signal("tanks.a", "m"), "m/s")})

    laws = [Drain(), Sampled(hold("tanks.b", "tanks.in_b", lambda x: -x), 0.1)]
    for order in (laws, laws[::-1]):
        run = simulate(compose(Tanks()), 3.0, start={"tanks.a": 1.0, "tanks.b": 1.0}, controller=order, accuracy=1e-9)
        assert run.at(3.0)["tanks.a"] == pytest.approx(math.exp(-3), rel=1e-7)
        assert run.at(3.0)["tanks.b"] == pytest.approx(0.9**30, rel=1e-10)


# --- Python callables


class PythonPI:
    """The sampled PI of `controllers.pi`, in Python, with a state of its own."""

    measured_signals, actuated_signals = ("top.speed",), ("top.torque",)

    def __init__(self, period):
        self.period, self.angle, self.calls = period, 0.0, 0

    def __call__(self, t, y):
        error = 8.0 - y[0]
        torque = 4000.0 * error + 1500.0 * self.angle
        self.angle += self.period * error
        self.calls += 1
        return torque

    def method(self, t, y):
        return self(t, y)


def python_law(kind, period):
    """The same law as an object, a bound method, a closure, a partial."""
    owner = PythonPI(period)
    if kind == "object":
        return owner
    if kind == "method":
        return owner.method  # attributes of the class: measures, drives are the defaults
    if kind == "partial":
        return functools.partial(owner)
    angle = 0.0

    def closure(t, y):
        nonlocal angle
        error = 8.0 - y[0]
        torque = 4000.0 * error + 1500.0 * angle
        angle += period * error
        return torque

    return closure


@pytest.mark.parametrize("kind", ["object", "method", "partial", "closure"])
def test_a_python_callable_gives_what_the_compiled_law_gives(kind):
    compiled = simulate(RIG, 10.0, controller=PI(), sample_time=0.02)
    run = simulate(RIG, 10.0, controller=python_law(kind, 0.02), sample_time=0.02)
    times = np.linspace(0, 10, 200)
    np.testing.assert_allclose(run.at(times)["bit.speed"], compiled.at(times)["bit.speed"], atol=1e-9)
    np.testing.assert_allclose(run.at(times)["top.torque"], compiled.at(times)["top.torque"], rtol=1e-9, atol=1e-6)
    assert [e.time for e in run.events] == pytest.approx([e.time for e in compiled.events], abs=1e-9)


@pytest.mark.parametrize("kind", ["object", "method", "partial"])
def test_asking_for_the_error_does_not_disturb_a_callable_with_a_state(kind):
    compiled = simulate(RIG, 10.0, controller=PI(), sample_time=0.02)
    run = simulate(RIG, 10.0, controller=python_law(kind, 0.02), sample_time=0.02)
    before = run.at(7.0)["bit.speed"]
    assert run.error_estimate < 10 * max(
        compiled.error_estimate, 1e-6
    )  # a law that starts from its last state would be off by its integral
    assert run.at(7.0)["bit.speed"] == before
    gridded = simulate(RIG, 10.0, controller=python_law(kind, 0.02), sample_time=0.02, output_times=np.linspace(0, 10, 11))
    assert gridded.at(7.0)["bit.speed"] == pytest.approx(before, abs=1e-9)


def test_two_runs_with_one_callable_object_give_the_same():
    plant, controller = compose(wells.JANSEN_2, BitRock()), PythonPI(0.02)
    first, second = (simulate(plant, 5.0, controller=controller, sample_time=0.02) for _ in range(2))
    np.testing.assert_array_equal(first["bit.speed"], second["bit.speed"])


def test_a_callable_gets_its_measurements_in_their_order_and_gives_its_outputs_in_theirs():
    seen = []

    @law(("tanks.b", "tanks.a"), ("tanks.in_b", "tanks.in_a"))
    def swap(t, y):
        seen.append(tuple(y))
        return [10.0, 20.0]

    run = simulate(compose(Tanks()), 1.0, start={"tanks.a": 1.0, "tanks.b": 2.0}, controller=swap, sample_time=0.5)
    assert seen[0] == (2.0, 1.0)
    assert run.at(0.7)["tanks.in_b"] == 10.0
    assert run.at(0.7)["tanks.in_a"] == 20.0


@pytest.mark.parametrize("answer", [math.nan, math.inf, None, "strong", [1.0, 2.0], [], ...], ids=repr)
def test_a_callable_that_answers_nonsense_ends_the_run_with_what_there_is_so_far(answer):
    controller = law(("tank.level",), ("tank.inflow",))(lambda t, y: 1.0 if t < 0.55 else answer)
    with pytest.raises(SimulationError, match=r"tank\.inflow") as caught:
        simulate(tank, 2.0, controller=controller, sample_time=0.1)
    assert caught.value.run is not None
    assert caught.value.run.time[-1] == pytest.approx(0.6, abs=1e-9)


def test_an_exception_of_a_callable_is_the_users_own():
    def broken(t, y):
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        simulate(rig, 1.0, controller=broken, sample_time=0.1)


# --- the order of things at one instant


@dataclass(frozen=True)
class Block(Component):
    """v' = u + w + F, to be pushed by a table u and a law w."""

    def equations(self, signal):
        v = state("block.speed", "m/s")
        pad = DryFriction("pad", v, Coulomb(static=1.0, kinetic=0.8))
        push = signal("block.push", "N", default=0.0) + signal("block.drive", "N", default=0.0)
        return Equations(flow={v: push + pad.force}, elements=[pad])


@dataclass(frozen=True)
class Recorder(Controller):
    """Holds what it measures on a signal that nobody uses but the next question."""

    measured: str = "block.push"
    unit: str = "N"
    actuated_signals = ("recorder.value",)

    @property
    def measured_signals(self):
        return (self.measured,)

    def sampled(self, signal, period):
        return Update(memory={}, outputs={"recorder.value": (signal(self.measured, self.unit), self.unit)})


def test_a_sample_at_the_instant_of_a_jump_sees_the_input_after_it():
    run = simulate(compose(Block()), 2.0, inputs={"block.push": step(0.0, 0.5, 1.0)}, controller=Recorder(), sample_time=0.5)
    assert run.at(0.9)["recorder.value"] == 0.0
    assert run.at(1.1)["recorder.value"] == 0.5


def test_a_sample_at_the_instant_of_a_release_sees_the_friction_after_it():
    # the push jumps to 1.8 at t = 1 and frees the block: from then on friction is -0.8, not the -1.8 that would have held it
    run = simulate(
        compose(Block()), 2.0, inputs={"block.push": step(0.5, 1.8, 1.0)}, controller=Recorder(measured="pad.force"), sample_time=0.5
    )
    assert run.events[0].time == 1.0
    assert run.at(0.9)["recorder.value"] == -0.5
    assert run.at(1.1)["recorder.value"] == -0.8


def test_a_law_that_releases_a_contact_does_so_at_its_sample():
    drive = law(("block.speed",), ("block.drive",))(lambda t, y: 1.8 if t >= 0.7 else 0.5)
    run = simulate(compose(Block()), 2.0, controller=drive, sample_time=0.1)
    assert [(e.before, e.after) for e in run.events] == [("stick", "slip+")]
    assert run.events[0].time == 7 * 0.1
    assert run.at(2.0)["block.speed"] == pytest.approx(1.3, rel=1e-9)


def test_no_event_is_missed_next_to_a_sample():
    # deceleration 0.8 from v0: it stops at v0 / 0.8, just before, at and just after the sample at 1; the law then pushes it on
    drive = law(("block.speed",), ("block.drive",))(lambda t, y: 0.0)
    for v0 in 0.8 + np.array([-1e-6, -1e-9, -1e-12, -1e-15, 0.0, 1e-15, 1e-12, 1e-9, 1e-6]):
        run = simulate(compose(Block()), 2.0, start={"block.speed": float(v0)}, controller=drive, sample_time=0.1)
        assert [(e.before, e.after) for e in run.events] == [("slip+", "stick")]
        assert run.events[0].time == pytest.approx(v0 / 0.8, abs=1e-9)
        assert run.at(1.5)["block.speed"] == 0.0


def test_a_limit_cycle_sampled_fast_keeps_all_its_events():
    exact = simulate(RIG, 60.0, controller=PI(), accuracy=1e-8)
    run = simulate(RIG, 60.0, controller=PI(), sample_time=0.001)
    assert [(e.before, e.after) for e in run.events] == [(e.before, e.after) for e in exact.events]
    stuck = run.modes["bit"] == "stick"
    assert np.all(run["bit.speed"][stuck] == 0.0)


# --- the plant changes, the law does not


def test_parameters_of_a_run_change_the_plant_and_leave_the_design_alone():
    heavier = {"chain.inertia.1": 600.0, "chain.stiffness": (700.0,)}
    run = simulate(RIG, 10.0, controller=SoftTorque(), parameters=heavier)
    designed = SoftTorque().design(RIG)
    same = simulate(RIG.with_parameters(heavier), 10.0, controller=designed)
    np.testing.assert_array_equal(run["bit.speed"], same["bit.speed"])
    adapted = simulate(RIG.with_parameters(heavier), 10.0, controller=SoftTorque())
    assert np.abs(run.at(9.0)["bit.speed"] - adapted.at(9.0)["bit.speed"]) > 1e-3


@pytest.mark.parametrize("sample_time", [None, 0.01])
def test_a_sliding_mode_keeps_its_model_when_the_plant_changes(sample_time):
    run = simulate(RIG, 5.0, controller=SlidingMode(), sample_time=sample_time, parameters={"chain.inertia.0": 3000.0})
    explicit = SlidingMode(inertia=2122.0, drag=425.0)
    same = simulate(RIG.with_parameters({"chain.inertia.0": 3000.0}), 5.0, controller=explicit, sample_time=sample_time)
    np.testing.assert_array_equal(run["bit.speed"], same["bit.speed"])


# --- what is refused


def test_a_period_that_no_controller_takes_is_refused():
    for controller in (Sampled(PI(), 0.02), [Sampled(PI(), 0.02)]):
        with pytest.raises(SceneError, match="sample_time"):
            simulate(rig, 1.0, controller=controller, sample_time=0.1)
        simulate(rig, 1.0, controller=controller, sample_time=0.02)  # the same twice contradicts nothing


def test_laws_that_sample_at_one_instant_read_what_was_held_before_it_however_they_are_listed():
    """A cascade v_ref = 1 - x every 0.1 s, u = 5 (v_ref - v) every 0.02 s on v' = u, stepped by hand with u constant between samples."""

    @dataclass(frozen=True)
    class Cart(Component):
        def equations(self, signal):
            x, v = state("cart.x", "m"), state("cart.v", "m/s")
            return Equations(flow={x: v, v: signal("cart.push", "m/s2", default=0.0)})

    @dataclass(frozen=True)
    class Outer(Controller):
        measured_signals, actuated_signals = ("cart.x",), ("cart.wanted",)

        def sampled(self, signal, period):
            return Update({}, {"cart.wanted": (1.0 - signal("cart.x", "m"), "m/s")})

    @dataclass(frozen=True)
    class Inner(Controller):
        measured_signals, actuated_signals = ("cart.v",), ("cart.push",)

        def sampled(self, signal, period):
            return Update({}, {"cart.push": (5.0 * (signal("cart.wanted", "m/s", default=0.0) - signal("cart.v", "m/s")), "m/s2")})

    laws = [Sampled(Outer(), 0.1), Sampled(Inner(), 0.02)]
    x, v, wanted, by_hand = 0.0, 0.0, 0.0, []
    for k in range(100):
        push = 5.0 * (wanted - v)
        wanted = 1.0 - x if k % 5 == 0 else wanted
        x, v = x + 0.02 * v + 0.02**2 / 2 * push, v + 0.02 * push
        by_hand.append(x)
    for order in (laws, laws[::-1]):
        run = simulate(compose(Cart()), 2.0, controller=order, output_times=0.02 * np.arange(1, 101))
        np.testing.assert_allclose(run["cart.x"], by_hand, rtol=0, atol=1e-12)


def test_a_callable_that_measures_a_vector_is_told_to_name_entries():
    with pytest.raises(SceneError, match=r"`chain\.speed\.0`"):
        simulate(rig, 1.0, controller=law(("chain.speed",), ("top.torque",))(lambda t, y: 0.0), sample_time=0.1)
    simulate(rig, 1.0, controller=law(("chain.speed.0",), ("top.torque",))(lambda t, y: y[0]), sample_time=0.1)


@pytest.mark.parametrize(
    ("measured_signals", "actuated_signals"),
    [(("top.sped",), ("top.torque",)), (("top.speed",), ("top.torqe",)), (("top.speed",), ("bit.torque",))],
)
def test_a_callable_that_names_unknown_signals_is_refused_by_name(measured_signals, actuated_signals):
    wrong = measured_signals[0] if measured_signals[0] != "top.speed" else actuated_signals[0]
    with pytest.raises(SceneError, match=wrong):
        simulate(rig, 1.0, controller=law(measured_signals, actuated_signals)(lambda t, y: 0.0), sample_time=0.1)


def test_a_lambda_is_told_its_signals_where_it_is_sampled():
    # u = 2 - x on x' = u, held over 0.1 s: x_(k+1) = x_k + 0.1 (2 - x_k)
    told = Sampled(lambda t, y: 2.0 - y[0], 0.1, measured_signals="tank.level", actuated_signals=["tank.inflow"])
    run = simulate(tank, 1.0, controller=told, output_times=0.1 * np.arange(11))
    np.testing.assert_allclose(run["tank.level"], 2.0 * (1.0 - 0.9 ** np.arange(11)), rtol=1e-12)
    assert np.abs(simulate(tank, 1.0)["tank.level"]).max() == 0.0


def test_a_lambda_on_a_plant_without_a_drive_is_told_what_to_write_and_that_works():
    words = r'write `(measured_signals="tank\.level", actuated_signals="tank\.inflow")`'
    with pytest.raises(SceneError, match=words) as caught:
        simulate(tank, 1.0, controller=lambda t, y: 0.0, sample_time=0.1)
    advice = re.search(words, str(caught.value))[1]
    run = simulate(tank, 1.0, controller=Sampled(lambda t, y: 3.0, 0.1, **eval(f"dict({advice})")))
    assert run["tank.level"][-1] == pytest.approx(3.0, rel=1e-12)


test_wrong_uses_are_refused_in_these_words = refusals(
    *each_of(lambda wrong: simulate(RIG, 1.0, controller=wrong, sample_time=0.1), r"`controller` must be callable as \(t, y\)",
     (lambda y: 1e4, lambda t, y, u: 1e4)),
    *each_of(lambda period: simulate(rig, 1.0, controller=PI(), sample_time=period), "sample_time", [0.0, -0.1, math.nan, math.inf, "fast", True,
     [0.1]]),
    *each_of(lambda period: simulate(rig, 1.0, controller=Sampled(PI(), period)), "sample_time|period", [0.0, -0.1, math.nan, math.inf, "fast", True,
     [0.1]]),
    *each_of(lambda delay: simulate(rig, 1.0, controller=Sampled(PI(), 0.1, delay=delay)), "delay", [-0.1, math.nan, math.inf, "late", None, True]),
    *each_of(lambda controller: simulate(rig, 1.0, controller=controller, sample_time=0.1), "ontroller", [5, "PI", PI, ..., [PI(), 5],
     Sampled(5, 0.1), Sampled(PI, 0.1)]),
    (lambda: simulate(rig, 1.0, controller=lambda t, y: 0.0), "sample_time"),
    (lambda: simulate(rig, 1.0, sample_time=0.1), "control law"),
    (lambda: simulate(rig, 1.0, controller=Sampled(PI(), 0.1, measured_signals="top.speed")),
     "Argument `measured_signals` must be left to a callable: PI declares its own"),
    (lambda: simulate(tank, 1.0, controller=Sampled(lambda t, y: 0.0, 0.1, measured_signals="tank.level", actuated_signals=3)),
     "Argument `actuated_signals` must be the name of a signal, or several, but it is 3"),
    (lambda: simulate(rig, 1.0, controller=[PI(), PI(name="other")]), r"top\.torque"),
    (lambda: simulate(rig, 1.0, controller=[PI(), lambda t, y: 0.0], sample_time=0.1), r"top\.torque"),
    (lambda: simulate(rig, 1.0, controller=PI(), inputs={"top.torque": 5.0}), r"top\.torque"),
    (lambda: simulate(tank, 1.0, controller=Counter()), "sample_time"),
)  # fmt: skip


def test_a_slip_that_a_sampled_law_would_make_jump_is_refused():
    class Treadmill(Component):
        def equations(self, signal):
            v = state("treadmill.v", "m/s")
            pad = DryFriction("pad", v - signal("treadmill.speed", "m/s", default=0.0), Coulomb())
            return Equations(flow={v: pad.force}, elements=[pad])

    controller = law(("treadmill.v",), ("treadmill.speed",))(lambda t, y: 1.0)
    with pytest.raises(SceneError, match="slip"):
        simulate(compose(Treadmill()), 1.0, controller=controller, sample_time=0.1)


@pytest.mark.parametrize(
    "law",
    [
        Sampled(PI(4000.0, 1500.0, 8.0), 0.01),
        Sampled(SoftTorque(reference=6.0), 0.01, delay=0.003, noise={"top.speed": 0.05}),
        Sampled(SlidingMode(reference=12.0), 0.02),
    ],
    ids=["PI from stick", "delay and noise", "sliding mode"],
)
def test_the_short_path_from_sample_to_sample_gives_the_bits_of_the_whole_loop(law):
    arguments = {"controller": law, "accuracy": 1e-5}
    plant = compose(wells.JANSEN_2, BitRock(weight=97_000.0))
    short = simulate(plant, 30.0, **arguments)
    instants = law.period * np.arange(int(30.0 / law.period))
    whole = simulate(plant, 30.0, output_times=instants, **arguments)  # outputs at every sample leave no step to the short path
    assert short.events
    rows = np.searchsorted(short.time, instants, side="right") - 1
    assert np.array_equal(short.time[rows], instants)
    assert np.array_equal(short.states[rows], whole.states)
    assert [(event.time, event.element) for event in short.events] == [(event.time, event.element) for event in whole.events]
