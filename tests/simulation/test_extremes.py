"""The edges: every law, element, method and verb ends with the answer that theory gives, or with an error of the toolbox that names what is wrong."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest
from scipy.linalg import expm

import controllers
import toolbox
from controllers import LQG, LQR, PI, BrakePI, HeldSpeed, HInfinity, LinearMPC, NonlinearMPC, SoftTorque, StiffPI, observers
from models import BitRock, BlockOnBelt, BlocksOnBelt, Coulomb, DiscBrake, HystereticBitRock, TorsionalChain
from studies.benchmarks.extremes import EXTREMES, belt, belt_arcs, scaled
from tests.plants import BELT, RIG
from tests.refusals import refusals
from toolbox import (
    Budget,
    Component,
    Controller,
    DryFriction,
    Equations,
    Sampled,
    SceneError,
    SimulationError,
    UnilateralContact,
    closed_loop,
    compose,
    quantity,
    state,
)
from toolbox.calibration import Search
from toolbox.errors import AccuracyError, BudgetError
from toolbox.modelling import Hysteresis, ObserverBasedController, Relay, Takeover
from toolbox.modelling.components import fields_of
from toolbox.simulation import EventExact, TimeStepping
from toolbox.simulation.methods import METHODS, method_of


def simulate(*arguments, method="event", **more):
    return toolbox.simulate(*arguments, method=replace(method_of(method), budget=Budget(steps=2_000_000)), **more)


BRAKE = compose(DiscBrake())
LAWS = sorted(
    name
    for name, kind in ((name, getattr(controllers, name)) for name in controllers.__all__)
    if isinstance(kind, type)
    and dataclasses.is_dataclass(kind)
    and issubclass(kind, Controller)
    and not issubclass(
        kind, (ObserverBasedController, controllers.Lifting, controllers.PID)
    )  # which need another law to act on, or signals
)
PERIOD = {"LinearMPC": 0.1, "NonlinearMPC": 0.1, "BrakeMPC": 0.03}
CONTINUOUS = ("IdealSlidingMode", "HeldSpeed")


def plant_of(law):
    return BRAKE if law.actuated_signals in (BrakePI().actuated_signals, HeldSpeed().actuated_signals) else RIG


def clocked(law, period=None):
    """A law as it runs: sampled where it can be."""
    name = type(law).__name__
    return law if name in CONTINUOUS else Sampled(law, period or PERIOD.get(name, 0.01))


# --- numbers of machines: friction ratio, decay, speed, load, inertia, time scale, against closed forms

LIMIT = {"friction falls within 1e-6 m/s": 1e-3}  # the closed form is its limit, Coulomb friction
QUICK = [name for name in EXTREMES if name not in ("inertias 1e6 apart", "a shaft 1e9 times too stiff", "1000 contacts")]
MORE = {
    "no decay": lambda: belt(F_s=0.5, F_k=0.5, x=0.3),
    "load 1e-9 N": lambda: belt(k=1e-9, m=1e-9, F_s=1e-9, F_k=5e-10),
    "begins at the bound": lambda: belt(x=1.0),
    "begins at the other bound": lambda: belt(x=-1.0),
    "no time": lambda: belt(periods=0.0),
}


@pytest.mark.parametrize(
    ("method", "accuracy"), [("event", 1e-6), ("explicit", 1e-9), ("stiff", 1e-6), ("event", 1e-3), ("time-stepping", 1e-3)]
)
@pytest.mark.parametrize("title", [*QUICK, *MORE])
def test_a_machine_at_the_edge_of_its_numbers_follows_its_closed_form(title, method, accuracy):
    if method == "time-stepping" and title == "10 000 periods":
        pytest.skip("a million steps, of which the answer is an AccuracyError: `python -m studies extremes`")
    case = {**EXTREMES, **MORE}[title]()
    times = np.linspace(0.0, case.duration, 401) if case.duration else np.zeros(1)
    run = toolbox.simulate(
        case.plant, case.duration, start=case.start, inputs=case.inputs, method=method, accuracy=accuracy, output_times=times
    )
    assert scaled(run.states, case.truth(times)) < max(10 * accuracy, LIMIT.get(title, 1e-7))


@pytest.mark.filterwarnings("ignore::toolbox.errors.UnusualValue")  # no machine, but numbers that a formula must survive
@pytest.mark.parametrize("method", ["event", "stiff"])
@pytest.mark.parametrize(("stiffness", "inertia"), [(1e-6, 400.0), (1e3, 400.0), (1e9, 400.0), (1e6, 2e-3), (1e-6, 2e-3)])
def test_two_inertias_on_a_shaft_of_any_stiffness_follow_the_matrix_exponential(stiffness, inertia, method):
    J = np.array([2000.0, inertia])
    chain = TorsionalChain(
        inertia=tuple(J),
        stiffness=(stiffness,),
        damping=(0.0,),
        top_drag=100.0,
        friction=Coulomb(static=0.3, kinetic=0.3),
        friction_load=(1000.0, 0.0),
    )
    # x = (twist, top speed, bit speed, 1)
    A = np.zeros((4, 4))
    A[0, 1:3] = 1.0, -1.0
    A[1] = np.array([-stiffness, -100.0, 0.0, 1000.0 - 300.0]) / J[0]
    A[2, 0] = stiffness / J[1]
    duration = min(20.0, 300.0 / math.sqrt(stiffness * (1 / J).sum()))
    run = simulate(compose(chain), duration, inputs={"top.torque": 1000.0}, method=method, output_times=np.linspace(0.0, duration, 51))
    exact = np.array([(expm(A * t) @ [0.0, 0.0, 0.0, 1.0])[:3] for t in run.time])
    assert np.abs(run.states - exact).max(axis=0) == pytest.approx(np.zeros(3), abs=1e-5 * np.abs(exact).max())
    assert run.error_estimate < 1e-4


@pytest.mark.parametrize(("method", "accuracy"), [("event", 1e-6), ("stiff", 1e-6), ("time-stepping", 1e-3)])
@pytest.mark.parametrize("damping", [0.0, 1e3, 1e6, 1e9, 1e12])
def test_a_block_in_any_damper_is_dragged_along_as_its_closed_form_says(damping, method, accuracy):
    # m v' = F_k - k x - c v from rest on a belt that it never catches: c v_belt > F_s
    plant = compose(BlockOnBelt(damping=damping, belt_speed=1.0, friction=Coulomb(static=1.0, kinetic=0.5)))
    times = np.linspace(0.0, 3.0, 31)
    if method == "time-stepping" and damping > 1e3:  # its mean of begin and end lets a fast speed ring, and it says so
        with pytest.raises(AccuracyError, match="cannot meet the accuracy"):
            toolbox.simulate(plant, 3.0, method=replace(METHODS[method], budget=Budget(seconds=0.3)), accuracy=accuracy)
        return
    run = simulate(plant, 3.0, method=method, accuracy=accuracy, output_times=times)
    exact = np.array([expm(np.array([[0.0, 1.0, 0.0], [-1.0, -damping, 0.5], [0.0, 0.0, 0.0]]) * t)[:2, 2] for t in times])
    if damping > 1e7:  # expm loses the slow mode to round-off: x = F_k t / c
        exact = np.column_stack([0.5 * times / damping, np.full(times.size, 0.5 / damping)])
    late = times > 0.0  # at first there is a boundary layer of the length m / c
    assert scaled(run.states[late], exact[late]) < 10 * accuracy


# --- element by element: a start exactly on the switching surface


@dataclass(frozen=True)
class Ball(Component):
    """A ball on a floor, rigid or not, under a pull: v' = -g + a + N."""

    pull: float = quantity(0.0, "m/s2", "pull upwards")
    rigid: bool = True

    def equations(self, signal):
        z, v = state("ball.height", "m"), state("ball.speed", "m/s")
        kind = {"restitution": 0.5} if self.rigid else {"stiffness": 1e3}
        floor = UnilateralContact("floor", closure=-z, rate=-v, **kind)
        return Equations(flow={z: v, v: -9.81 + self.pull + floor.force}, elements=[floor])


@dataclass(frozen=True)
class Switched(Component):
    """A signal under a relay, or under a switch with hysteresis."""

    push: float = quantity(0.0, "1/s", "push")
    relay: bool = True

    def equations(self, signal):
        s = state("point.s", "1")
        if self.relay:
            element = Relay("element", s, 1.0)
            return Equations(flow={s: self.push + element.force}, elements=[element])
        element = Hysteresis("element", s, -1.0, 1.0)
        return Equations(flow={s: 1.0 - 2.0 * element.output}, elements=[element])


@dataclass(frozen=True)
class Block(Component):
    """A block under a push on a table: v' = u + F."""

    push: float = quantity(0.0, "N", "push")

    def equations(self, signal):
        x, v = state("block.position", "m"), state("block.speed", "m/s")
        table = DryFriction("table", v, Coulomb(static=1.0, kinetic=0.5))
        return Equations(flow={x: v, v: self.push + table.force}, elements=[table])


G, W = 9.81, math.sqrt(1e3)
ON_THE_SURFACE = {
    "ball at rest": (Ball(), {}, 1.0, (0.0, 0.0)),
    "ball leaves": (Ball(), {"ball.speed": 5.0}, 0.5, (2.5 - G / 8, 5.0 - G / 2)),
    "ball strikes": (Ball(), {"ball.speed": -1.0}, 0.05, (0.025 - G * 0.05**2 / 2, 0.5 - 0.05 * G)),
    "ball without weight": (Ball(pull=G), {}, 1.0, (0.0, 0.0)),
    "ball pulled a little more than it weighs": (Ball(pull=G + 1e-9), {}, 1.0, (0.5e-9, 1e-9)),
    "ball touches an elastic floor": (Ball(rigid=False), {}, 0.05, (-G / 1e3 * (1 - math.cos(0.05 * W)), -G / W * math.sin(0.05 * W))),
    "ball leaves an elastic floor": (Ball(rigid=False), {"ball.speed": 1.0}, 0.1, (0.1 - G * 0.005, 1.0 - 0.1 * G)),
    "relay slides": (Switched(), {}, 1.0, (0.0,)),
    "relay slides at its bound": (Switched(push=1.0), {}, 1.0, (0.0,)),
    "relay is overcome": (Switched(push=1.5), {}, 1.0, (0.5,)),
    "switch at its upper threshold": (Switched(relay=False), {"point.s": 1.0}, 0.5, (0.5,)),
    "switch at its lower threshold": (Switched(relay=False), {"point.s": -1.0}, 0.5, (-0.5,)),
    "block at its bound": (Block(push=1.0), {}, 1.0, (0.0, 0.0)),
    "block beyond its bound": (Block(push=1.001), {}, 1.0, (0.501 / 2, 0.501)),
    "block beyond its bound, backwards": (Block(push=-1.001), {}, 1.0, (-0.501 / 2, -0.501)),
    "block that hardly moves": (Block(), {"block.speed": 1e-12}, 1.0, (0.0, 0.0)),
    "block that moves by a denormal": (Block(), {"block.speed": 1e-310}, 1.0, (0.0, 0.0)),
    "block at 1e4 m/s": (Block(), {"block.speed": 1e4}, 1.0, (1e4 - 0.25, 1e4 - 0.5)),
}


@pytest.mark.parametrize("method", ["event", "explicit", "stiff", "time-stepping"])
@pytest.mark.parametrize("title", ON_THE_SURFACE)
def test_a_start_exactly_on_a_switching_surface_goes_the_way_that_force_decides(title, method):
    part, start, duration, end = ON_THE_SURFACE[title]
    step = 1e-4
    stepped = method == "time-stepping"
    run = simulate(compose(part), duration, start=start, method=TimeStepping(step) if stepped else method)
    tolerance = 2 * G * step if stepped else 1e-9 * max(1.0, *np.abs(end))  # a method of order one
    np.testing.assert_allclose(run.at(duration).states[0], end, rtol=0.0, atol=tolerance)


@pytest.mark.parametrize("tie", [0.0, 10.0])
def test_hundreds_of_contacts_that_switch_at_one_instant_switch_as_one(tie):
    n = 200
    ones = (1.0,) * n
    blocks = BlocksOnBelt(
        mass=ones,
        stiffness=ones,
        damping=(0.0,) * n,
        tie=(tie,) * (n - 1),
        load=ones,
        belt_speed=0.2,
        friction=Coulomb(static=1.0, kinetic=0.5),
    )
    run = simulate(compose(blocks), 20.0, start={"blocks.speed": np.full(n, 0.2)}, output_times=np.linspace(0.0, 20.0, 41))
    alone = belt_arcs(run.time, 1.0, 1.0, 0.2, 1.0, 0.5)[:, :1]
    assert np.abs(run["blocks.position"] - alone).max() < 1e-6
    instants = {event.time for event in run.events}
    assert len(run.events) == n * len(instants) > 0


def test_a_chain_that_hundreds_of_contacts_hold_rests_and_lets_go_where_its_push_exceeds_them():
    n = 300
    chain = TorsionalChain(
        inertia=(1.0,) * n,
        stiffness=(1e4,) * (n - 1),
        damping=(1.0,) * (n - 1),
        friction=Coulomb(static=1.0, kinetic=0.5),
        friction_load=(1.0,) * n,
    )
    plant = compose(chain)
    held = simulate(plant, 1.0, inputs={"top.torque": 0.999})
    assert not held.states.any()
    pushed = simulate(plant, 0.05, inputs={"top.torque": 2.0})
    assert pushed.modes["chain.0"][0] == "slip+"
    assert not pushed["chain.speed"][:, -1].any()  # a wave passes 100 contacts a second


# --- laws: their clocks


@pytest.mark.filterwarnings("ignore::toolbox.errors.UnusualValue")  # no machine, but numbers that the engine must survive
@pytest.mark.parametrize("name", [name for name in LAWS if name not in (*CONTINUOUS, *PERIOD)])
def test_a_command_that_comes_after_the_run_leaves_the_machine_as_it_is(name):
    law = getattr(controllers, name)()
    plant = plant_of(law)
    free = simulate(plant, 2.0)
    late = simulate(plant, 2.0, controller=Sampled(law, 0.01, delay=1e9))
    np.testing.assert_allclose(late.at(free.time).states[:, : free.states.shape[1]], free.states, atol=1e-9)


@pytest.mark.filterwarnings("ignore::toolbox.errors.UnusualValue")  # no machine, but numbers that the engine must survive
@pytest.mark.parametrize("name", ["ZTorque", "HInfinity"])
def test_a_period_at_which_the_filter_of_a_law_would_grow_is_refused(name):
    """One sample of theirs is one step of a Runge-Kutta or an Euler formula, which multiplies the state of the filter by more than one beyond its limit."""
    with pytest.raises(SceneError, match=r"Argument `sample_time` must be (<=|at most) 0\.\d+ s"):
        simulate(RIG, 5.0, controller=getattr(controllers, name)(reference=6.0), sample_time=1e6)


@pytest.mark.parametrize("name", ["PI", "SoftTorque", "LQR", "SlidingMode", "SuperTwisting", "ActiveDamping", "ImplicitSlidingMode"])
def test_a_period_beyond_the_run_is_one_sample_whose_command_is_held(name):
    law = getattr(controllers, name)(reference=6.0)
    run = simulate(RIG, 5.0, controller=law, sample_time=1e6)
    command = run["top.torque"]
    assert np.ptp(command) == 0.0
    held = simulate(RIG, 5.0, inputs={"top.torque": float(command[0])})
    for speed in ("top.speed", "bit.speed"):
        assert run.at(5.0)[speed] == pytest.approx(held.at(5.0)[speed], abs=1e-6 * (1 + abs(held.at(5.0)[speed])))


@pytest.mark.parametrize("name", [name for name in LAWS if name not in (*CONTINUOUS, *PERIOD)])
def test_samples_every_ten_microseconds_are_all_taken(name):
    law = getattr(controllers, name)()
    run = simulate(plant_of(law), 0.01, controller=Sampled(law, 1e-5, delay=3.3e-5))
    assert run.steps[0] >= 1000
    assert np.isfinite(run.states).all()
    assert run.time[-1] == 0.01


@pytest.mark.filterwarnings("ignore::toolbox.errors.UnusualValue")  # no machine, but numbers that the engine must survive
@pytest.mark.parametrize("period", [1e-9, 1e-12])
def test_billions_of_commands_on_their_way_end_in_a_budget_and_not_in_a_shortage_of_memory(period):
    with pytest.raises(BudgetError, match="1000 steps") as failed:
        toolbox.simulate(RIG, 10.0, controller=Sampled(PI(), period, delay=5.0), method=EventExact(budget=Budget(steps=1000)))
    assert failed.value.run.end == pytest.approx(1000 * period, rel=0.01)


@pytest.mark.parametrize("name", LAWS)
def test_a_run_of_no_time_under_any_law_is_its_start(name):
    law = getattr(controllers, name)()
    run = simulate(plant_of(law), 0.0, controller=clocked(law))
    assert run.time.tolist() == [0.0]
    assert run.error_estimate == 0.0


# --- laws: their numbers


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("bad", [math.nan, math.inf, "strong"], ids=str)
def test_a_number_of_a_law_that_is_none_is_refused_by_its_name(name, bad):
    law = getattr(controllers, name)()
    plant = plant_of(law)
    refused = 0
    for field in fields_of(type(law)):
        if field.numeric:
            wrong = (bad,) * len(getattr(law, field.name) or (0,)) if field.tuples else bad
            with pytest.raises(SceneError, match=field.name.split("_")[0]):
                simulate(plant, 0.0, controller=clocked(dataclasses.replace(law, **{field.name: wrong})))
            refused += 1
    assert refused


@pytest.mark.parametrize("observer", [observers.Kalman, observers.DisturbanceObserver, observers.SlidingObserver, observers.MovingHorizon])
def test_a_number_of_an_observer_that_is_none_is_refused_by_its_name(observer):
    for field in fields_of(observer):
        if field.numeric and getattr(observer(), field.name) is not None:
            with pytest.raises(SceneError, match=field.name):
                simulate(RIG, 0.0, controller=Sampled(ObserverBasedController(SoftTorque(), observer(**{field.name: math.nan})), 0.01))


@pytest.mark.parametrize(
    ("law", "words"),
    [
        (LQR(top_speed_scale=1e-300), "LQR cannot be designed"),
        (HInfinity(speed_noise=1e-300), "HInfinity"),
        (HInfinity(norm_factor=1.0), "`norm_factor` of HInfinity must be > 1"),
        (LinearMPC(delay=1e9), "`delay` must be at most 1000 periods"),
        (NonlinearMPC(delay=1e9), "`delay` must be at most 1000 periods"),
        (LinearMPC(sensors=3), "`sensors` of LinearMPC must be a row of strings"),  # type: ignore[arg-type]
        (LinearMPC(horizon=2.5), "`horizon` of LinearMPC must be an integer"),  # type: ignore[arg-type]
        (LinearMPC(sensor_noise=(1e-300,)), "squares"),
        (LQG(delay_samples=-1), "`delay_samples` must be an integer >= 0 and <= 1000"),
        (LQG(delay_samples=10**9), "`delay_samples` must be an integer >= 0 and <= 1000"),
        (ObserverBasedController(StiffPI(), observers.Kalman(speed_noise=1e-300)), "Kalman cannot be designed"),
        (PI(proportional=(1.0, 2.0)), "`proportional` of PI must be one number"),  # type: ignore[arg-type]
        (Takeover(before=StiffPI(), after=5.0), "must be a Controller"),  # type: ignore[arg-type]
    ],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
def test_numbers_that_no_law_can_be_designed_with_are_refused(law, words):
    with pytest.raises(SceneError, match=words):
        simulate(RIG, 0.0, controller=clocked(law))


def test_a_machine_that_the_drive_cannot_steer_is_refused_by_the_law():
    # at a steady speed the rock holds the bit: nothing moves it, and the Riccati equation has no stabilising solution
    held = compose(
        TorsionalChain(inertia=(2000.0, 400.0), stiffness=(800.0,), damping=(100.0,), top_drag=425.0), HystereticBitRock(weight=97_347.0)
    )
    with pytest.raises(SceneError, match="LQR cannot be designed on this plant"):
        simulate(held, 1.0, controller=LQR(reference=7.5))
    assert simulate(RIG, 1.0, controller=LQR(reference=7.5)).time[-1] == 1.0


# --- verbs: arguments that are no numbers, names or runs

RUN = simulate(BELT, 50.0, start={"block.speed": 0.2})
CYCLE = toolbox.limit_cycle(BELT, 50.0)
NO_NUMBERS = (math.nan, math.inf, "strong", None, (1.0, math.nan), object(), 1j)
NO_NAMES = (math.nan, 5, None, (math.nan,), object())
DATA = {"time": RUN.at(np.linspace(0.0, 50.0, 101)).time, "block.speed": RUN.at(np.linspace(0.0, 50.0, 101))["block.speed"]}
VERBS = {
    "difference to": (lambda bad: RUN.difference(bad), "better", (*NO_NAMES, BELT)),
    "varying names": (BELT.with_time_varying, "names", (*NO_NAMES, "block.mass")),
    "fit free": (lambda bad: toolbox.fit(BELT, DATA, bad), "name", NO_NAMES),
    "fit ranges": (lambda bad: toolbox.fit(BELT, DATA, "block.mass", bad), "ranges", (5, "strong", [1.0, 2.0])),
    "fit noise": (lambda bad: toolbox.fit(BELT, DATA, "block.mass", noise=bad), "noise", (5, "strong", {"block.speed": math.nan})),
    "fit columns": (lambda bad: toolbox.fit(BELT, DATA, "block.mass", columns=bad), "columns", (5, "strong", {"block.speed": math.nan})),
    "fit seed": (lambda bad: toolbox.fit(BELT, DATA, "block.mass", starts=Search(seed=bad)), "seed", (math.nan, "strong", -1)),
    "fit confidence": (lambda bad: toolbox.fit(BELT, DATA, "block.mass", confidence=bad), "confidence", (*NO_NUMBERS, 0.0, 1.0)),
    "export_c period": (
        lambda bad: toolbox.export_c(closed_loop(RIG, StiffPI(), sample_time=bad), "nowhere"), "sample_time|must be sampled",
        (*NO_NUMBERS, 0.0),
    ),
    "severity after": (lambda bad: toolbox.measure.severity(RUN, "block.speed", bad), "after", NO_NUMBERS),
    "severity signal": (lambda bad: toolbox.measure.severity(RUN, bad), "signal", (math.nan, 5, (math.nan,), object())),
    "severity definition": (lambda bad: toolbox.measure.severity(RUN, "block.speed", definition=bad), "definition", NO_NAMES),
    "settling target": (lambda bad: toolbox.measure.settling(RUN, "block.speed", bad), "target", NO_NUMBERS),
    "overshoot of": (lambda bad: toolbox.measure.overshoot(bad, "block.speed", 1.0), "run", (*NO_NAMES, BELT)),
    "energy_audit of": (toolbox.energy_audit, "run", (*NO_NAMES, BELT)),
    "cycles element": (lambda bad: toolbox.measure.cycles(RUN, bad), "element", NO_NAMES),
    "time_in element": (lambda bad: RUN.time_in(bad, "stick"), "element", NO_NAMES),
    "time_in mode": (lambda bad: RUN.time_in("belt", bad), "mode", NO_NAMES),
    "time_in after": (lambda bad: RUN.time_in("belt", "stick", after=bad), "after", (math.nan, "strong", None, object())),
    "run signal": (lambda bad: RUN[bad], "signal", (*NO_NAMES, [], {})),
    "equilibrium inputs": (lambda bad: toolbox.equilibrium(closed_loop(RIG, inputs=bad)), "inputs", (5, "strong", ["top.torque"])),
    "equilibrium guess": (lambda bad: toolbox.equilibrium(RIG, guess=bad), "guess", (5, "strong", ["bit.speed"])),
    "equilibrium mode": (lambda bad: toolbox.equilibrium(RIG, mode=bad), "mode", (5, "strong", ["bit"])),
    "equilibrium parameters": (lambda bad: toolbox.equilibrium(closed_loop(RIG, parameters=bad)), "parameters", (5, "strong", ["bit.weight"])),
    "linearise outputs": (lambda bad: toolbox.linearise(RIG, {"bit.speed": 1.0}, outputs=bad), "name", (5, 1j, object(), [])),
    "hopf_points parameter": (lambda bad: toolbox.hopf_points(closed_loop(RIG, StiffPI()), bad, (2.0, 8.0)), "parameter", (*NO_NAMES, [])),
    "hopf_points values": (lambda bad: toolbox.hopf_points(closed_loop(RIG, StiffPI()), "top.reference", (2.0, 8.0), num_values=bad), "values", NO_NUMBERS),
    "pole_locus values": (lambda bad: toolbox.steady_states.pole_locus(closed_loop(RIG, StiffPI()), "top.reference", bad), "values", NO_NUMBERS),
    "limit_cycle accuracy": (lambda bad: toolbox.limit_cycle(RUN, accuracy=bad), "accuracy", NO_NUMBERS),
    "follow bounds": (lambda bad: toolbox.follow(CYCLE, "block.belt_speed", bad), "bounds", (*NO_NUMBERS, (1.0, 0.0))),
    "follow points": (lambda bad: toolbox.follow(CYCLE, "block.belt_speed", (0.1, 0.3), points=bad), "points", (*NO_NUMBERS, 0)),
    "follow towards": (lambda bad: toolbox.follow(CYCLE, "block.belt_speed", (0.1, 0.3), start_towards=bad), "towards", (math.nan, "strong", (1.0,), 1j)),
    "onset perturbation": (
        lambda bad: toolbox.onset(closed_loop(RIG, StiffPI()), "top.reference", (4.0, 9.0), perturbation=bad), "perturbation", NO_NUMBERS
    ),
    "sweep parameters": (lambda bad: toolbox.sweep(closed_loop(BELT, parameters=bad), {"block.mass": [1.0]}, duration=1.0), "parameters", (5, "strong")),
    "sweep duration": (lambda bad: toolbox.sweep(BELT, {"block.mass": [1.0]}, duration=bad), "duration", (*NO_NUMBERS, 0.0)),
    "work_precision duration": (lambda bad: toolbox.work_precision(BELT, bad), "duration", (*NO_NUMBERS, 0.0)),
    "work_precision accuracies": (lambda bad: toolbox.work_precision(BELT, 1.0, accuracies=bad), "accuracies", NO_NUMBERS),
    "work_precision widths": (lambda bad: toolbox.work_precision(BELT, 1.0, widths=bad), "widths", NO_NUMBERS),
    "work_precision repeats": (lambda bad: toolbox.work_precision(BELT, 1.0, repeats=bad), "repeats", (*NO_NUMBERS, 0)),
    "severity_map duration": (
        lambda bad: toolbox.severity_map(closed_loop(RIG, StiffPI()), {"top.reference": (4.0, 8.0), "bit.weight": (5e4, 1e5)}, duration=bad),
        "duration", (math.nan, "strong", 0.0, 1j),
    ),
    "impedance speed": (lambda bad: toolbox.impedance(StiffPI(), frequency=[1.0], speed=bad), "speed", NO_NUMBERS),
    "reflection impedance": (lambda bad: toolbox.steady_states.reflection(bad, 1.0), "impedance", (math.nan, "strong", None, [1.0, math.nan])),
    "smoothed matched": (lambda bad: toolbox.modelling.smoothed(BELT, 0.1, match_static_peak=bad), "match_static_peak", NO_NUMBERS),
    "part": (lambda bad: compose(BlockOnBelt(mass=bad)), "mass", NO_NUMBERS),
}  # fmt: skip


@pytest.mark.parametrize("title", VERBS)
def test_what_is_no_argument_is_refused_by_its_name(title):
    verb, word, wrong = VERBS[title]
    for bad in wrong:
        with pytest.raises(SceneError, match=word):
            verb(bad)


def test_a_run_of_no_time_has_nothing_to_measure_and_says_so():
    run = simulate(BELT, 0.0)
    for measure in (
        toolbox.measure.severity,
        partial(toolbox.measure.settling, target=0.2),
        partial(toolbox.measure.overshoot, target=0.2),
    ):
        with pytest.raises(SceneError, match="must last longer than 0 s"):
            measure(run, "block.speed")
    assert toolbox.energy_audit(run).residual == 0.0
    assert run.time_in("belt", "stick") == 0.0


def test_a_state_that_is_too_fast_for_the_times_is_named_with_its_time_constant():
    """A bit of 1e-9 kg m2 breaks free with a growth of W R_b (mu_s - mu_c) decay / J = 4e12 1/s; at 3.6 s times are 4e-16 s apart."""
    string = TorsionalChain(inertia=(2122.0, 1e-9), stiffness=(473.0,), damping=(23.2,), top_drag=425.0, bit_drag=50.0)
    with pytest.raises(
        SimulationError, match=r"`chain.speed.1` moves with a time constant of 2.\de-13 s there, and times are 4.4e-16 s apart"
    ):
        toolbox.simulate(compose(string, BitRock(weight=97_347.0)), 10.0, inputs={"top.torque": 13e3}, accuracy=1e-2)


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda: simulate(RIG, 100.0, controller=PI(proportional=1e9), sample_time=1.0),
     r"t = .*`chain\.(twist\.0|speed\.[01])`|`chain\.(twist\.0|speed\.[01])`.* t = ", SimulationError),
    (lambda: toolbox.simulate(RIG, 10.0, controller=PI(reference=5.0), sample_time=1e-12),
     "`sample_time` must be at least 1e-09 s in a run of 10 s, which is 1e[+]10 samples, but it is 1e-12 s"),
)  # fmt: skip
