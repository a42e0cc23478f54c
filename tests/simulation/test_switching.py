"""What jumps, samples and bounds do to switches and contacts: each against its closed form, by every method."""

import itertools
import math
from dataclasses import dataclass
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from models import BlockOnBelt, Coulomb
from models.friction import StepFriction
from toolbox import Component, DryFriction, Equations, Sampled, SimulationError, compose, quantity, simulate, state, sweep, time
from toolbox.compilation import work_layout as layout
from toolbox.inputs import sine
from toolbox.modelling import Hysteresis, Relay  # fmt: skip
from toolbox.stepping.step_control import stalls

METHODS = ("event", "explicit", "stiff")


@dataclass(frozen=True)
class Thermostat(Component):
    """x' = output - 0.1 x, the output of a switch with memory on an input."""

    def equations(self, signal):
        x, u = state("room.x", "1"), signal("room.u", "1", default=0.0)
        switch = Hysteresis("switch", u, -1.0, 1.0)
        return Equations(flow={x: switch.output - 0.1 * x}, elements=[switch])


PULSE = ([0.0, 1.0, 1.0, 1.01], [0.0, 0.0, 2.0, 0.0])
AFTER = 10.0 - (10.0 - math.exp(-0.1)) * math.exp(-0.9)


@pytest.mark.parametrize("method", METHODS)
def test_a_pulse_shorter_than_a_step_throws_a_switch(method):
    run = simulate(compose(Thermostat()), 10.0, start={"room.x": 1.0}, inputs={"room.u": PULSE}, method=method)
    assert run.events == [(1.0, "switch", "low", "high")]
    assert run["room.x"][-1] == pytest.approx(AFTER, rel=1e-6)
    twin = simulate(
        compose(Thermostat()), 10.0, start={"room.x": 1.0}, inputs={"room.u": ([0.0, 1.0, 1.0, 1.01], [0.0, 0.0, 0.9, 0.0])}, method=method
    )
    assert twin.events == [] and twin["room.x"][-1] == pytest.approx(math.exp(-1.0), rel=1e-6)  # inside its band it keeps its position


def test_a_sample_throws_a_switch_and_the_next_one_throws_it_back():
    law = Sampled(lambda t, y: {0.5: 2.0, 1.0: 0.0, 1.5: -2.0}.get(t, 0.0), 0.5, measured_signals="room.x", actuated_signals="room.u")
    run = simulate(compose(Thermostat()), 3.0, controller=law)
    assert run.events == [(0.5, "switch", "low", "high"), (1.5, "switch", "high", "low")]


def test_a_sweep_over_the_input_starts_on_its_far_side():
    found = sweep(compose(Thermostat()), {"room.u": np.linspace(1.5, 2.5, 64)}, duration=1.0,
                  metrics={"end": lambda run: run["room.x"][-1]})  # fmt: skip
    np.testing.assert_allclose(found.metrics["end"], 10.0 * (1.0 - math.exp(-0.1)), rtol=1e-6)


def test_a_law_knows_on_which_side_of_its_break_a_jump_of_the_belt_puts_it():
    plant = compose(BlockOnBelt(load=5.0, friction=StepFriction(static=1.0, kinetic=0.2, drop_speed=0.3)))
    belt = ([0.0, 0.02, 0.02, 0.05], [0.3, 0.3, -0.35, -0.35])
    run = simulate(plant, 0.05, start={"block.position": -2.0}, inputs={"block.belt_speed": belt})
    after = run.at(0.02)
    assert after["belt.slip"] > 0.3 and after["belt.force"] == pytest.approx(-5.0 * 0.2)
    assert run.modes["belt.break"][-1] == "beyond"


@dataclass(frozen=True)
class Held(Component):
    """A body held by a relay on v + 1.846 x, a second one rubbing on it, and a force on the second."""

    first: float = quantity(1.0, "kg", "mass", above=0)
    second: float = quantity(0.7, "kg", "mass", above=0)
    stiffness: float = quantity(0.0, "N/m", "of both springs to ground", at_least=0)

    def equations(self, signal):
        x, v, y, w = state("a.x", "m"), state("a.v", "m/s"), state("b.x", "m"), state("b.v", "m/s")
        push = signal("b.force", "N", default=0.0)
        relay = Relay("relay", v + 1.846 * x, 1.9)
        rub = DryFriction("rub", w - v, Coulomb(static=1.2, kinetic=0.25))
        flow = {
            x: v, v: (relay.force - rub.force - self.stiffness * x) / self.first,
            y: w, w: (push + rub.force - self.stiffness * y) / self.second,
        }  # fmt: skip
        return Equations(flow=flow, elements=[relay, rub])


STAIRS = (np.repeat(np.arange(11) * 0.1, 2)[1:], np.repeat(np.arange(11) * 0.1, 2)[:-1])


@pytest.mark.parametrize("masses", [(0.66, 2.25), (1.72, 1.14), (2.82, 1.27), (1.9, 1.21)])
@pytest.mark.parametrize("stiffness", [0.0, 1.0])
def test_contacts_far_inside_their_bounds_hold_at_every_step_of_a_force(masses, stiffness):
    plant = compose(Held(*masses, stiffness))
    for arguments in (
        {"inputs": {"b.force": STAIRS}},
        {"controller": Sampled(lambda t, y: min(1.0, round(t, 6)), 0.1, measured_signals="a.x", actuated_signals="b.force")},
    ):
        run = simulate(plant, 2.0, **arguments)
        assert run.events == [] and np.abs(run.states).max() < 1e-15
    assert np.abs(simulate(plant, 2.0, inputs={"b.force": 1.3}).states).max() > 0.1  # beyond the bound it moves


@pytest.mark.parametrize("masses", [(0.66, 2.25), (1.72, 1.14)])
def test_contacts_that_hold_each_other_at_rest_take_steps_as_long_as_their_force_asks_for(masses):
    run = simulate(compose(Held(*masses)), 1.0, inputs={"b.force": sine(0.0, 0.5, 1.0)})
    assert run.events == [] and run.steps[0] < 1_000
    assert run.error_estimate < 1.0  # and its second run comes to an end, too


# ------------------------------------------------------------------------------------------------------------------------------ bounds
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("output_times", [None, [0.0, 5.0, 10.0]])
def test_a_load_that_becomes_negative_between_recorded_times_ends_the_run_where_it_does(method, output_times):
    with pytest.raises(SimulationError, match="The bound of `belt` must be >= 0, but it falls below 0 at t = 1.83259") as failed:
        simulate(compose(BlockOnBelt()), 10.0, inputs={"block.load": 0.5 + ca.sin(2 * time)}, method=method, output_times=output_times)
    assert failed.value.run.end == pytest.approx(7 * math.pi / 12, rel=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_a_load_that_only_touches_zero_does_not(method):
    run = simulate(compose(BlockOnBelt()), 10.0, inputs={"block.load": 1 + ca.cos(3 * time)}, method=method)
    assert run.end == 10.0 and run["belt.force"].min() >= -2.0


# ------------------------------------------------------------------------------------------------------------- more than one consistent choice
@dataclass(frozen=True)
class Pair(Component):
    """Two masses on springs: the first rubs on the ground, the second on the first, both by the same law."""

    static: float = quantity(1.0, "N", "bound", above=0)
    kinetic: float = quantity(0.3, "N", "while sliding", above=0)

    def equations(self, signal):
        x, v, y, w = state("a.x", "m"), state("a.v", "m/s"), state("b.x", "m"), state("b.v", "m/s")
        push, pull = signal("a.force", "N", default=0.0), signal("b.force", "N", default=0.0)
        law = Coulomb(static=self.static, kinetic=self.kinetic)
        ground, rub = DryFriction("ground", v, law), DryFriction("rub", w - v, law)
        return Equations(
            flow={x: v, v: push + ground.force - rub.force - 2 * x, y: w, w: (rub.force + pull - 2 * y) / 0.7}, elements=[ground, rub]
        )


def consistent_sets(plant, static, kinetic, x, v, y, w, push, pull, held):
    """All modes of (ground, rub) that agree with the forces at a point; held: which slips are zero, the other mode is the sign of its slip."""
    found = []
    slips = (v, w - v)
    for modes in itertools.product((-1, 0, 1), repeat=2):
        if any(not zero and mode != math.copysign(1, slip) for zero, mode, slip in zip(held, modes, slips, strict=True)):
            continue
        # unknown: forces of those that stick;  a_v = push + g - r - 2 x,  a_w = (r + pull - 2 y) / 0.7
        matrix, right = np.eye(2), np.array([-mode * kinetic for mode in modes], float)
        rates = np.array([[1.0, -1.0], [-1.0, 1.0 + 1.0 / 0.7]])
        free = np.array([push - 2 * x, (pull - 2 * y) / 0.7 - (push - 2 * x)])
        for i, mode in enumerate(modes):
            if mode == 0:
                matrix[i], right[i] = rates[i], -free[i]
        force = np.linalg.solve(matrix, right)
        rate = rates @ force + free
        if all(abs(force[i]) <= static * (1 + 1e-6) if modes[i] == 0 else not held[i] or modes[i] * rate[i] > -1e-6 for i in (0, 1)):
            found.append(modes)
    return found


def test_a_switch_at_which_other_modes_were_consistent_is_listed():
    random = np.random.default_rng(0)
    counted = 0
    for _ in range(10):
        static, kinetic = random.uniform(0.5, 1.5), random.uniform(0.1, 0.4)
        amplitudes, frequencies = random.uniform(1, 3, 2), random.uniform(0.1, 0.5, 2)
        plant = compose(Pair(static, kinetic))
        loads = {f"{body}.force": sine(0.0, a, f) for body, a, f in zip("ab", amplitudes, frequencies, strict=True)}
        run = simulate(plant, 20.0, inputs=loads, accuracy=1e-9)
        for event in run.ambiguous_events:
            at = run.at(event.time)
            slips = (at["a.v"], at["b.v"] - at["a.v"])
            sets = consistent_sets(
                plant, static, kinetic, *at.states[0][:4], at["a.force"], at["b.force"], [abs(slip) < 1e-9 for slip in slips]
            )
            assert len(sets) > 1
            counted += 1
        assert f"{len(run.ambiguous_events)} switches at which other modes" in str(run) or not run.ambiguous_events
    assert counted > 5


def test_with_static_and_kinetic_friction_equal_there_is_one_choice():
    for seed in range(5):
        a, b = np.random.default_rng(seed).uniform(1, 3, 2)
        run = simulate(compose(Pair(0.8, 0.8)), 20.0, inputs={"a.force": sine(0.0, a, 0.31), "b.force": sine(0.0, b, 0.17)})
        assert len(run.events) > 5 and run.ambiguous_events == []


def test_a_contact_that_sticks_is_not_torn_loose_by_one_that_comes_to_rest_where_it_can_stay():
    """At every switch at which one contact arrives and the other lets go, no set of modes in which that one sticks agrees with the forces."""
    torn, arrivals = 0, 0
    for seed in (16, 46, 58, 9, 27):
        random = np.random.default_rng(seed)
        static, kinetic = random.uniform(0.5, 1.5), random.uniform(0.1, 0.4)
        amplitudes, frequencies = random.uniform(1, 3, 2), random.uniform(0.1, 0.5, 2)
        plant = compose(Pair(static, kinetic))
        loads = {f"{body}.force": sine(0.0, a, f) for body, a, f in zip("ab", amplitudes, frequencies, strict=True)}
        run = simulate(plant, 20.0, inputs=loads, accuracy=1e-9)
        for event in run.events:
            here = {other.element: other for other in run.events if other.time == event.time}
            loose = [name for name, other in here.items() if other.before == "stick"]
            arrivals += (
                event.before != "stick" and run.at(event.time - 1e-6)["rub.slip" if event.element == "ground" else "ground.slip"] == 0.0
            )
            if event.before == "stick" or not loose:
                continue
            at = run.at(event.time)
            sets = consistent_sets(plant, static, kinetic, *at.states[0][:4], at["a.force"], at["b.force"], (True, True))
            torn += any(modes[["ground", "rub"].index(loose[0])] == 0 for modes in sets)
    assert arrivals > 20 and torn == 0


# ------------------------------------------------------------------------------------------------------------------------------- no progress
def test_a_run_stalls_where_a_million_steps_do_not_move_time_and_only_there():
    def stalls_at(begin, end, steps, horizon):
        ints, reals = np.zeros(layout.INTS, np.int64), np.zeros(layout.REALS)
        ints[layout.ACCEPTED], reals[layout.LOOKED_AT], reals[layout.HORIZON] = steps, begin, horizon
        return stalls(SimpleNamespace(ints=ints, reals=reals), end)

    for scale in (1e-6, 1.0, 1e6):
        assert stalls_at(0.5 * scale, 0.5 * (1 + 1e-7) * scale, 1_000_000, scale)
        assert not stalls_at(0.5 * scale, 0.5 * (1 + 1e-7) * scale, 999_999, scale)  # not yet
        assert not stalls_at(0.5 * scale, 0.5 * (1 + 1e-5) * scale, 1_000_000, scale)  # slow, not standing still
        assert not stalls_at(0.0, 1e-9 * scale, 1_000_000, scale)  # a fast transient at the start
        assert stalls_at(0.0, 1e-14 * scale, 1_000_000, scale)


# ------------------------------------------------------------------------------------------------------------------- durations beyond all clocks
@pytest.mark.parametrize("duration", [1e9, 1e14, 1e18])
def test_a_run_longer_than_times_can_be_told_apart_is_right_or_says_so(duration):
    try:
        run = simulate(compose(BlockOnBelt(belt_speed=0.0)), duration, start={"block.position": 3.0})
    except SimulationError as failed:
        assert "where times are" in str(failed)
    else:
        # the block stops inside the band of rest, +-F/k
        assert run.end == duration and abs(run["block.position"][-1]) <= 1.0 and run["block.speed"][-1] == 0.0


# ------------------------------------------------------------------------------------------------------------------- bounds that cannot be
@dataclass(frozen=True)
class Pushed(Component):
    """v' = push + force of a relay or of dry friction, whose bounds are inputs."""

    dry: bool = False

    def equations(self, signal):
        x, v = state("a.x", "m"), state("a.v", "m/s")
        static, kinetic = signal("a.static", "N", default=1.0), signal("a.kinetic", "N", default=0.5)
        contact = DryFriction("c", v - 0.2, Coulomb(static=static, kinetic=kinetic)) if self.dry else Relay("c", v, static)
        return Equations(flow={x: v, v: signal("a.push", "N", default=0.0) - self.dry * x + contact.force}, elements=[contact])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("bound", "when"), [(-1.0, 0.0), (1.0 - 0.5 * time, 2.0), (([0.0, 1.0, 1.0, 2.0], [1.0, 1.0, -1.0, -1.0]), 1.0)])
def test_a_negative_bound_of_a_relay_is_refused_where_it_happens(bound, when, method):
    with pytest.raises(SimulationError, match=rf"The bound of `c` must be >= 0, but it .* at t = {when:g} s") as failed:
        simulate(compose(Pushed()), 6.0, inputs={"a.static": bound}, method=method)
    assert failed.value.run.end == pytest.approx(when)
    assert simulate(compose(Pushed()), 6.0, inputs={"a.static": 0.0, "a.push": 0.5}, method=method)["a.v"][-1] == pytest.approx(
        3.0
    )  # 0 is a bound


def test_a_negative_bound_of_a_relay_ends_a_run_of_a_sweep():
    found = sweep(compose(Pushed()), {"a.static": [1.0, -1.0, 2.0]}, 1.0, metrics={"end": lambda run: run["a.v"][-1]})
    assert list(found.failures) == [1] and "must be >= 0" in found.failures[1]


@pytest.mark.parametrize("inputs", [{"a.kinetic": 2.0}, {"a.kinetic": 0.5 + 0.2 * time}, {"a.static": 1.0 - 0.2 * time}])
def test_kinetic_friction_above_static_is_refused_where_the_contact_leaves_or_enters_stick(inputs):
    """The block on the belt first slides at the turn of its cycle; there what holds it is below what rubs."""
    with pytest.raises(SimulationError, match="The kinetic friction of `c` must be <= its static friction, but it is") as failed:
        simulate(compose(Pushed(dry=True)), 20.0, inputs=inputs)
    run = failed.value.run
    static, kinetic = (
        ca.DM(ca.substitute(ca.SX(inputs.get(name, declared)), time, run.end)) for name, declared in (("a.static", 1.0), ("a.kinetic", 0.5))
    )
    assert kinetic > static
    assert simulate(compose(Pushed(dry=True)), 20.0).events  # the declared machine runs


# ------------------------------------------------------------------------------------------------------------------- switches that only time moves
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("accuracy", [1e-3, 1e-5, 1e-8])
def test_a_switch_that_a_wave_passes_for_an_instant_turns(method, accuracy):
    """sine above 0.9 for a seventh of its period, while the state it drives moves so evenly that it asks for steps longer than that."""
    run = simulate(
        compose(Thermostat()), 20.0, start={"room.x": 1.0}, inputs={"room.u": sine(0.0, 1.1, 0.2)}, method=method, accuracy=accuracy
    )
    rise = math.asin(1.0 / 1.1) / (2.0 * math.pi * 0.2)
    expected = [rise, *(k * 2.5 + rise for k in range(1, 8))]
    assert [event.time for event in run.events] == pytest.approx(expected, rel=1e-6)
