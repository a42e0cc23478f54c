"""Sampled laws in the lanes of a vector, against runs one by one and closed forms."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from scipy.special import j0

from controllers import PI, BrakePI, ImpedanceSuperTwisting, SlidingMode, SoftTorque, SuperTwisting, ZTorque, observers
from models import Coulomb, DiscBrake, TorsionalChain
from tests.mechanisms import Oscillator, Tank
from tests.plants import RIG
from tests.together import together
from toolbox import (
    Component,
    Controller,
    DryFriction,
    Equations,
    Sampled,
    SceneError,
    UnilateralContact,
    Update,
    closed_loop,
    compose,
    quantity,
    simulate,
    state,
    sweep,
)
from toolbox.lanes.lanes import Lanes
from toolbox.lanes.samples import noise_table
from toolbox.measuring import metrics
from toolbox.modelling import ObserverBasedController  # fmt: skip
from toolbox.simulation.carry_out import carry_out
from toolbox.simulation.request import Request
from toolbox.stepping import noise
from toolbox.sweeps import batch, listed, uniform
from toolbox.sweeps.batch import FEWEST_LANES, Task, finished, pays_in_lanes, runs_in_lanes, single, with_room
from toolbox.sweeps.sweep import task_of as sweep_task
from toolbox.sweeps.variants import shared_run, varied_numbers


@dataclass(frozen=True)
class Proportional(Controller):
    """u = -gain level"""

    measured_signals = ("tank.level",)
    actuated_signals = ("tank.inflow",)

    gain: float = quantity(1.0, "1/s", "gain")

    def sampled(self, signal, period):
        return Update(memory={}, outputs={"tank.inflow": (-self.gain * signal("tank.level", "m"), "m/s")})


@dataclass(frozen=True)
class Counter(Controller):
    """u_k = k: open loop, with a memory."""

    actuated_signals = ("tank.inflow",)

    def sampled(self, signal, period):
        count = state("counter.count", "1")
        return Update(memory={count: count + 1}, outputs={"tank.inflow": (count, "m/s")})


@dataclass(frozen=True)
class Sled(Component):
    """A block on rough ground: m v' = F - friction, whose bound is 1 N."""

    mass: float = quantity(1.0, "kg", above=0)

    def equations(self, signal):
        x, v = state("sled.position", "m"), state("sled.speed", "m/s")
        ground = DryFriction("ground", v, Coulomb(static=1.0, kinetic=0.5))
        return Equations(flow={x: v, v: (signal("sled.force", "N", default=0.0) + ground.force) / self.mass}, elements=[ground])


@dataclass(frozen=True)
class Stairs(Controller):
    """F_k = rise k: a pull in steps."""

    actuated_signals = ("sled.force",)

    rise: float = quantity(0.3, "N", "rise of a step")

    def sampled(self, signal, period):
        count = state("stairs.count", "1")
        return Update(memory={count: count + 1}, outputs={"sled.force": (self.rise * count, "N")})


@dataclass(frozen=True)
class Hammer(Component):
    """A ball that a held force throws at a rigid ceiling and floor."""

    restitution: float = quantity(0.5, "1", at_least=0, at_most=1)

    def equations(self, signal):
        x, v = state("hammer.height", "m"), state("hammer.speed", "m/s")
        floor = UnilateralContact("floor", -x, -v, restitution=self.restitution)
        return Equations(flow={x: v, v: signal("hammer.force", "N", default=0.0) - 10.0 + floor.force}, elements=[floor])


@dataclass(frozen=True)
class Throw(Controller):
    """A force of 23 N in every fourth period: under 25 N the ball comes down with no speed at the very instant of a sample, and round-off decides."""

    actuated_signals = ("hammer.force",)

    def sampled(self, signal, period):
        count = state("throw.count", "1")
        return Update(
            memory={count: ca.if_else(count >= 3, 0, count + 1)}, outputs={"hammer.force": (ca.if_else(count >= 3, 23.0, 0.0), "N")}
        )


@dataclass(frozen=True)
class Flagged(Oscillator):
    """And one that is 1 above a level, 0 below."""

    level: float = quantity(0.5, "m")

    def equations(self, signal):
        made = super().equations(signal)
        flag = ca.if_else(next(iter(made.flow)) > self.level, 1.0, 0.0)
        return dataclasses.replace(made, outputs={"mass.above": (flag, "1")})


@dataclass(frozen=True)
class Idle(Controller):
    """u = 0"""

    measured_signals = ("mass.speed",)
    actuated_signals = ("mass.push",)

    def sampled(self, signal, period):
        return Update(memory={}, outputs={"mass.push": (0.0 * signal("mass.speed", "m/s"), "m/s2")})


CHAIN = TorsionalChain(
    inertia=(900.0, 300.0, 400.0), stiffness=(2000.0, 1200.0), damping=(40.0, 30.0), top_drag=300.0,
    friction=Coulomb(static=1.0, kinetic=0.8), friction_load=(1500.0, 300.0, 900.0),
)  # fmt: skip
WEIGHT = {"bit.weight": (5e4, 1.2e5)}
NOISY = {"noise": {"top.speed": 0.05}, "resolution": {}, "seed": 3}
# plant, what varies, duration, laws, other arguments, signals that are measured, the contact judged
PLANTS = {
    "PI": (RIG, {**WEIGHT, "pi.reference": (4.0, 14.0)}, 60.0, Sampled(PI(), 0.01), {}, ("bit.speed", "top.torque"), "bit"),
    "late and noisy": (RIG, WEIGHT, 30.0, Sampled(PI(), 0.01, delay=0.0033, **NOISY), {}, ("bit.speed",), "bit"),
    "late by a period": (RIG, WEIGHT, 30.0, Sampled(PI(), 0.01, delay=0.01), {}, ("bit.speed",), "bit"),
    "late by many periods": (RIG, WEIGHT, 30.0, Sampled(PI(), 0.02, delay=0.31), {}, ("bit.speed", "top.torque"), "bit"),
    "limits of torque and rate": (
        RIG, WEIGHT, 40.0, Sampled(PI(lowest_torque=0.0, highest_torque=11_000.0, torque_rate=4000.0), 0.01), {}, ("top.torque",), "bit",
    ),
    "soft torque": (RIG, WEIGHT, 40.0, Sampled(SoftTorque(reference=5.0), 0.01), {}, ("bit.speed",), "bit"),
    "Z torque": (RIG, WEIGHT, 40.0, Sampled(ZTorque(reference=9.0), 0.01), {}, ("bit.speed",), "bit"),
    "sliding mode": (RIG, WEIGHT, 30.0, Sampled(SlidingMode(reference=12.0), 0.01, delay=0.002), {}, ("bit.speed",), "bit"),
    "super-twisting": (RIG, WEIGHT, 20.0, Sampled(SuperTwisting(reference=12.0), 0.01), {}, ("bit.speed",), "bit"),
    "law with an observer": (
        RIG, WEIGHT, 20.0, Sampled(ObserverBasedController(SlidingMode(reference=8.0), observers.Kalman()), 0.01, noise={"top.speed": 0.02}), {},
        ("bit.speed",), "bit",
    ),
    "table beside a law": (
        RIG, {"pi.reference": (4.0, 14.0)}, 40.0, Sampled(PI(), 0.01), {"inputs": {"bit.weight": ([0.0, 9.0, 9.0, 20.0], [5e4, 9e4, 6e4, 1.1e5])}},
        ("bit.speed", "bit.torque"), "bit",
    ),
    "slow law on friction at every inertia": (
        compose(CHAIN), {"chain.friction_load.1": (200.0, 500.0)}, 30.0, Sampled(PI(reference=3.0), 0.25), {}, ("bit.speed", "top.torque"), "chain.2",
    ),
    "brake": (
        compose(DiscBrake()), {"disc.inertia": (0.8, 1.2)}, 0.8, Sampled(BrakePI(deceleration=10.0), 0.002, delay=0.001),
        {"start": {"disc.speed": 5.0}}, ("disc.speed", "brake.torque"), "pad",
    ),
    "stairs": (compose(Sled()), {"stairs.rise": (0.1, 0.4)}, 3.0, Sampled(Stairs(), 0.25, delay=0.1), {}, ("sled.speed",), "ground"),
    "thrown ball": (compose(Hammer()), {"hammer.restitution": (0.2, 0.7)}, 4.0, Sampled(Throw(), 0.2), {}, ("hammer.height",), "floor"),
    "no contact at all": (compose(Tank()), {"proportional.gain": (0.1, 2.0)}, 10.0, Sampled(Proportional(), 0.3), {"start": {"tank.level": 1.0}},
                          ("tank.level", "tank.inflow"), ""),
}  # fmt: skip


def task_of(name, runs, accuracy=1e-6, measured=True):
    plant, ranges, duration, laws, arguments, signals, element = PLANTS[name]
    variations = uniform(ranges, runs, 1)
    loop, rest = together(plant, laws, **arguments)
    run = shared_run(loop, variations, duration, method="explicit", accuracy=accuracy, **rest)
    asked = []
    after, until = 0.3141 * duration, 0.8765 * duration
    for signal in signals:
        for window in ((after, until), (0.0, duration / 8)):
            asked += [metrics.minimum(signal, *window), metrics.maximum(signal, *window), metrics.mean(signal, *window)]
        asked += [metrics.final(signal), metrics.severity(signal, after, until=until)]
    if element:
        mode = run.system.elements[[e.name for e in run.system.elements].index(element)].mode_names[0]
        asked += [metrics.time_in(element, after, until, mode=mode), metrics.stuck_ratio(element, after)] if mode == "stick" else []
        asked += [metrics.stays(element, after, until, mode=mode), metrics.events(element)]
    return Task(run, varied_numbers(run, variations)[0], tuple(asked) if measured else ())


def lanes_of(task, width=None, **arguments):
    made = Lanes(task.run, task.metrics, width)
    return made.run(task.numbers, np.tile(made.work.x[: task.run.system.x.numel()], (len(task.numbers), 1)), **arguments)


@pytest.fixture(scope="module", autouse=True)
def driver():
    """The driver of the lanes, compiled once per machine outside the time of any test."""
    lanes_of(task_of("stairs", 1))


@pytest.mark.parametrize("name", PLANTS)
def test_lanes_switch_as_the_scalar_loop_does_and_end_where_it_ends(name):
    task = task_of(name, 21, measured=False)
    duration = task.run.duration
    found = lanes_of(task, most_events=3000)
    assert (found.statuses == 0).all()
    for s in (0, 7, 15, 16, 20):
        run = carry_out(single(task, s))
        names = [element.name for element in run.program.system.elements]
        legends = {element.name: {word: mode for mode, word in element.mode_names.items()} for element in run.program.system.elements}
        assert found.switches[s] == len(run.events)
        events = range(len(run.events))
        assert [names[found.event_elements[s, e]] for e in events] == [event.element for event in run.events]
        assert [found.event_modes[s, e] for e in events] == [legends[event.element][event.after] for event in run.events]
        np.testing.assert_allclose(found.event_times[s, : len(run.events)], [event.time for event in run.events], atol=1e-6 * duration)
        size = np.abs(run.states).max(axis=0)
        np.testing.assert_allclose(found.states[s], run.at(duration).states[0], atol=1e-5 * size.max())


@pytest.mark.parametrize("name", PLANTS)
def test_all_measures_are_those_of_runs_one_after_the_other(name):
    accuracy, duration = 1e-7, PLANTS[name][2]
    task = task_of(name, 24, accuracy)
    found = finished(dataclasses.replace(task, lanes=True))
    expected = finished(task_of(name, 24, accuracy / 100))
    assert not found.errors and not expected.errors
    values = dict(zip(task.metrics, expected.values.T, strict=True))
    for q, asked in enumerate(task.metrics):
        if asked.name in ("sticks", "events"):
            np.testing.assert_array_equal(found.values[:, q], values[asked])
            continue
        size = {"stuck": duration, "stuck_ratio": 1.0}.get(asked.name)
        if size is None:
            size = np.max([np.abs(column) for m, column in values.items() if m.of == asked.of and m.name in ("minimum", "maximum")], axis=0)
        if asked.name == "severity":  # swing over twice the mean: an error of the mean counts more the smaller it is
            average = np.abs(values[metrics.mean(asked.of, asked.after, asked.until)])
            size = np.maximum(1.0, values[asked]) * size / average
        assert np.array_equal(np.isnan(found.values[:, q]), np.isnan(values[asked]))
        # the accuracy asked is kept within ten
        assert np.nanmax(np.abs(found.values[:, q] - values[asked]) / size, initial=0.0) <= 10 * accuracy, asked


@pytest.mark.parametrize("name", ["PI", "late and noisy", "brake", "thrown ball"])
def test_neighbours_change_nothing_to_the_last_bit(name):
    task = dataclasses.replace(task_of(name, 70), lanes=True)
    whole = finished(task)
    for cut in (slice(0, 1), slice(1, 18), slice(50, 70)):
        np.testing.assert_array_equal(finished(task.part(cut)).values, whole.values[cut])


@pytest.mark.parametrize("width", [4, 8, 16])
def test_a_counter_in_lanes_of_any_width_counts_as_its_closed_form_does(width):
    # u_k = k, applied a delay of 2.5 periods later: x(n h) = rate h (0 + 1 + ... + n - 4 + (n - 3) / 2)
    variations = uniform({"tank.rate": (0.5, 2.0)}, 19)
    run = shared_run(closed_loop(compose(Tank()), Sampled(Counter(), 0.1, delay=0.25)), variations, 5.0, method="explicit")
    task = Task(run, varied_numbers(run, variations)[0], (metrics.final("tank.inflow"),))
    found = lanes_of(task, width)
    n = 50
    expected = variations.points[:, 0] * 0.1 * ((n - 4) * (n - 3) / 2 + (n - 3) / 2)
    np.testing.assert_allclose(found.states[:, 0], expected, rtol=1e-12)
    np.testing.assert_array_equal(found.values[:, 0], n - 3.0)


def table(columns):
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def test_every_lane_counts_by_the_sample_time_and_delay_of_its_own():
    # u_k = k, held from k h + delay on: in whole numbers of h / 8, the inflow at 5 s is the last k that has come, and the level the sum of what was held
    steps, delays = np.meshgrid([8, 12, 20, 25, 40], [0, 2, 5, 17, 90])  # in units of 1/80 s
    steps, delays = steps.ravel(), delays.ravel()
    loop = closed_loop(compose(Tank()), Sampled(Counter(), 0.1, delay=0.1))
    variations = listed(table({"counter.sample_time": steps / 80.0, "counter.delay": delays / 80.0}))
    asked = {"inflow": metrics.final("tank.inflow")}
    task, *_ = sweep_task(loop, variations, 5.0, start=None, metrics=asked, method="explicit", accuracy=1e-6)
    found = finished(dataclasses.replace(task, lanes=True))
    assert not found.errors and runs_in_lanes(task)
    ticks = np.arange(400)
    held = np.maximum((ticks[None, :] - delays[:, None]) // steps[:, None], 0)
    last = np.where(delays == 0, 399, 400)  # no sample is taken at the end of a run
    np.testing.assert_array_equal(found.values[:, 0], (last - delays) // steps)
    made = Lanes(with_room(task.run, task.clocks), ())
    states = made.run(task.numbers, np.tile(made.work.x[:1], (len(steps), 1)), held=task.held, clocks=task.clocks).states[:, 0]
    np.testing.assert_allclose(states, held.sum(axis=1) / 80.0, rtol=1e-12)


def test_runs_with_sample_times_and_delays_of_their_own_switch_as_runs_alone_do():
    plant, _, duration, laws, arguments, *_ = PLANTS["late and noisy"]
    loop, _ = together(plant, laws, **arguments)
    names = [name for name in loop.variable_numbers() if name.endswith((".sample_time", ".delay"))]
    draw = np.random.default_rng(3)
    varied = {name: loop.number(name).value * draw.uniform(0.4, 1.7, 21) for name in names}
    assert len(varied) >= 2
    task, *_ = sweep_task(
        loop, listed(table(varied)), duration, start=None, metrics={"end": metrics.final("bit.speed")}, method="explicit", accuracy=1e-6
    )
    made = Lanes(with_room(task.run, task.clocks), ())
    starts = np.tile(made.work.x[: task.run.system.x.numel()], (21, 1))
    found = made.run(task.numbers, starts, task.memories, task.held, clocks=task.clocks, most_events=3000)
    assert (found.statuses == 0).all()
    for s in range(21):
        alone = carry_out(single(task, s))
        assert found.switches[s] == len(alone.events)
        np.testing.assert_allclose(found.event_times[s, : len(alone.events)], [event.time for event in alone.events], atol=1e-6 * duration)
        np.testing.assert_allclose(found.states[s], alone.states[-1], atol=1e-5 * np.abs(alone.states).max())
    assert len({tuple(times[:3]) for times in found.event_times.tolist()}) == 21


def test_the_noise_of_a_sample_is_that_of_the_scalar_loop_to_the_last_bit():
    # x_(k+1) = x_k - h gain (x_k + sigma n_k), with the same n_k in every lane
    variations = uniform({"proportional.gain": (0.1, 2.0)}, 17)
    law = Sampled(Proportional(), 0.25, noise={"tank.level": 0.3}, seed=7)
    run = shared_run(closed_loop(compose(Tank()), law), variations, 100.0, method="explicit")
    task = Task(run, varied_numbers(run, variations)[0], ())
    made = Lanes(run)
    keys = made.work.keys[made.work.keys != 0]
    numbers = [noise.normal(keys[0], k) for k in range(400)]
    np.testing.assert_array_equal(noise_table(made.work, made.work.keys[None], made.work.clocks[:, 0], 100.0)[0, :400], numbers)
    assert abs(np.mean(numbers)) < 0.2 and 0.8 < np.std(numbers) < 1.2
    x, gain = np.zeros(17), variations.points[:, 0]
    for n in numbers:
        x = x - 0.25 * gain * (x + 0.3 * n)
    found = lanes_of(task)
    np.testing.assert_allclose(found.states[:, 0], x, atol=1e-12)
    np.testing.assert_allclose(carry_out(single(task, 3)).states[-1, 0], x[3], atol=1e-12)


def test_runs_with_seeds_of_their_own_have_the_noise_of_runs_alone_with_these():
    variations = uniform({"proportional.gain": (0.1, 2.0)}, 17)
    law = Sampled(Proportional(), 0.25, noise={"tank.level": 0.3}, seed=7)
    run = shared_run(closed_loop(compose(Tank()), law), variations, 100.0, method="explicit")
    seeds = np.array([[k % 5] for k in range(17)])
    asked = (metrics.final("tank.level"), metrics.mean("tank.level", 20.0))
    task = Task(run, varied_numbers(run, variations)[0], asked, seeds=seeds)
    found, row = finished(dataclasses.replace(task, lanes=True)), finished(task)
    np.testing.assert_allclose(found.values, row.values, atol=1e-9)
    for k in (0, 6, 16):
        alone = closed_loop(compose(Tank()), dataclasses.replace(law, seed=k % 5)).at("proportional.gain", variations.points[k, 0])
        np.testing.assert_allclose(found.values[k, 0], simulate(alone, 100.0).states[-1, 0], atol=1e-9)
        np.testing.assert_allclose(carry_out(single(task, k)).states[-1, 0], found.values[k, 0], atol=1e-9)


def test_the_mean_of_a_flag_is_placed_as_closely_in_lanes_as_in_runs_alone():
    # cos(t) is above c for 2 acos(c) of every turn; steps could be as long as the period of 1 s
    turns = 7
    loop = closed_loop(compose(Flagged()), Idle(), sample_time=1.0, start={"mass.position": 1.0})
    variations = uniform({"mass.level": (-0.9, 0.9)}, 33)
    run = shared_run(loop, variations, 2 * math.pi * turns, method="explicit")
    task = Task(run, varied_numbers(run, variations)[0], (metrics.mean("mass.above"), metrics.maximum("mass.above")))
    found = lanes_of(task)
    assert not found.doubtful.any()
    np.testing.assert_allclose(found.values[:, 0], np.arccos(variations.points[:, 0]) / math.pi, atol=2e-6)
    np.testing.assert_allclose(found.values, finished(task).values, atol=2e-6)
    np.testing.assert_array_equal(found.values[:, 1], 1.0)


def test_a_stuck_sled_is_released_at_the_instant_its_pull_passes_the_bound():
    # F_k = rise k arrives at k h + d: the first above 1 N releases, in open loop (a constant 1 N) nothing ever does
    task = task_of("stairs", 40, measured=False)
    rise = varied_rises(task)
    found = lanes_of(task, most_events=4)
    first = np.floor(1.0 / rise) + 1
    np.testing.assert_array_equal(found.event_times[:, 0], np.where(first * 0.25 + 0.1 <= 3.0, first * 0.25 + 0.1, np.nan))
    held = Request(closed_loop(compose(Sled()), inputs={"sled.force": 1.0}), 3.0).checked()
    assert Lanes(held).run(held.system.values[None], np.zeros((1, 2))).switches[0] == 0


def varied_rises(task):
    return np.asarray(task.numbers)[:, task.run.system._parameter("stairs.rise").offset]


def test_laws_with_different_periods_and_delays_share_a_lane():
    @dataclass(frozen=True)
    class Setpoint(Controller):
        """A set-point in stairs of 1 rad/s up to 8."""

        actuated_signals = ("top.reference",)

        def sampled(self, signal, period):
            count = state("setpoint.count", "rad/s")
            return Update(memory={count: ca.fmin(count + 1.0, 8.0)}, outputs={"top.reference": (count, "rad/s")})

    laws = [Sampled(Setpoint(), 1.0, delay=0.2), Sampled(PI(), 0.01, delay=0.004)]
    variations = uniform(WEIGHT, 20)
    run = shared_run(closed_loop(RIG, laws), variations, 30.0, method="explicit")
    asked = (metrics.maximum("bit.speed", 3.0), metrics.mean("top.torque", 3.0), metrics.final("top.reference"), metrics.events("bit"))
    task = Task(run, varied_numbers(run, variations)[0], asked)
    found, expected = finished(dataclasses.replace(task, lanes=True)), finished(task)
    np.testing.assert_allclose(found.values, expected.values, rtol=1e-6)
    assert found.values[:, -1].max() > 3
    np.testing.assert_array_equal(found.values[:, 2], 8.0)


def test_a_signal_that_turns_faster_than_the_samples_is_measured_all_the_same():
    # mean of cos(k cos t) over whole turns is J_0(k), on steps that could be as long as the period of 1 s
    variations = uniform({"mass.waves": (20.0, 40.0)}, 33)
    loop = closed_loop(compose(Oscillator()), Idle(), sample_time=1.0, start={"mass.position": 1.0})
    run = shared_run(loop, variations, 2 * math.pi, method="explicit", accuracy=1e-7)
    asked = (metrics.mean("mass.wave"), metrics.minimum("mass.wave"), metrics.maximum("mass.wave"))
    task = Task(run, varied_numbers(run, variations)[0], asked)
    found = lanes_of(task)
    assert not found.doubtful.any()
    np.testing.assert_allclose(found.values[:, 0], j0(variations.points[:, 0]), atol=1e-6)
    np.testing.assert_allclose(found.values[:, 1], -1.0, atol=1e-6)
    np.testing.assert_allclose(found.values[:, 2], 1.0, atol=1e-6)
    plain = lanes_of(dataclasses.replace(task, metrics=(metrics.mean("mass.position"),)))
    assert plain.steps.max() < found.steps.min()


def test_a_sample_nearer_to_the_edge_of_a_window_than_can_be_resolved_is_taken_there():
    # 111 periods of 0.1 s end one unit in the last place behind 11.1 s
    assert 0.0 < 111 * 0.1 - 11.1 < 1e-14
    variations = uniform(WEIGHT, 17)
    run = shared_run(closed_loop(RIG, PI(), sample_time=0.1), variations, 20.0, method="explicit")
    asked = (
        metrics.minimum("bit.speed", 11.1), metrics.maximum("top.torque", 11.1), metrics.mean("top.torque", 0.0, 11.1),
        metrics.minimum("top.torque", 2.0, 11.1),
    )  # fmt: skip
    task = Task(run, varied_numbers(run, variations)[0], asked)
    found = lanes_of(task)
    assert found.alone.sum() == 0
    np.testing.assert_allclose(found.values, finished(task).values, rtol=1e-6, atol=1e-9)


def test_what_is_held_from_the_end_on_counts_as_the_last_value():
    # u_k = k arrives two periods late, at the end as well
    run = Request(closed_loop(compose(Tank()), Sampled(Counter(), 0.25, delay=0.5)), 10.0, method="explicit").checked()
    asked = (metrics.final("tank.inflow"), metrics.maximum("tank.inflow", 5.0), metrics.maximum("tank.inflow", 5.0, 9.0))
    task = Task(run, run.system.values[None], asked)
    np.testing.assert_array_equal(lanes_of(task).values, [[38.0, 38.0, 33.0]])
    np.testing.assert_array_equal(finished(task).values, [[38.0, 38.0, 33.0]])


def test_memories_and_held_signals_that_differ_by_run_are_begun_with():
    # one period of 1 s in which the held value alone acts, then u = -gain x
    run = Request(closed_loop(compose(Tank()), Sampled(Proportional(gain=0.5), 4.0, delay=1.0)), 2.0, method="explicit").checked()
    held = np.linspace(-1.0, 1.0, 20)[:, None]
    start = np.linspace(0.0, 3.0, 20)[:, None]
    made = Lanes(run)
    numbers = np.tile(run.system.values, (20, 1))
    found = made.run(numbers, start, held=held)
    np.testing.assert_allclose(found.states, start + held - 0.5 * start, atol=1e-12)
    with pytest.raises(SceneError, match="`held`"):
        made.run(numbers, start, held=held[:3])


def test_sweeps_of_sampled_laws_pay_in_lanes_unless_they_are_python():
    def law(t, y):
        return 8000.0

    def pays(controller):
        run = shared_run(closed_loop(RIG, controller), uniform(WEIGHT, FEWEST_LANES), 10.0, method="explicit")
        return pays_in_lanes(Task(run, np.zeros((FEWEST_LANES, 1)), (metrics.mean("bit.speed"),)), 1_000_000), run

    assert pays(Sampled(PI(), 0.01))[0]
    refused, run = pays(Sampled(law, 0.01))
    assert not refused
    with pytest.raises(SceneError, match="Python"):
        Lanes(run)


def test_a_sweep_gives_the_same_table_with_lanes_and_without(monkeypatch):
    loop = closed_loop(RIG, ImpedanceSuperTwisting(), sample_time=0.01)
    given = {"duration": 30.0, "metrics": ("severity", "stuck_ratio", "events")}
    weights = {"bit.weight": np.linspace(50e3, 110e3, FEWEST_LANES)}
    monkeypatch.setattr(batch, "LANES_WORK", math.inf)
    alone = sweep(loop, weights, **given)
    monkeypatch.setattr(batch, "LANES_WORK", 0.0)
    found = sweep(loop, weights, **given)
    np.testing.assert_array_equal(found["events"], alone["events"])
    for name in ("severity", "stuck_ratio"):
        np.testing.assert_allclose(found[name], alone[name], rtol=1e-6, atol=1e-7)
