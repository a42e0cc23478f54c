"""Frictions whose lever vanishes: slip = p(angle) * speed with p = 0 at a dead centre, as of a crank, a scotch yoke, a piston ring."""

from __future__ import annotations

import dataclasses
import itertools
import math

import casadi as ca
import numpy as np
import pytest

from models import Coulomb
from studies.benchmarks.levers import Lever, Reference, Trial
from tests.lanes.test_lanes import batch
from toolbox import Component, DryFriction, Equations, closed_loop, compose, energy_audit, sensitivity, simulate, state, stepper, time
from toolbox.modelling import Relay
from toolbox.simulation import Explicit, Implicit, TaylorSeries, TimeStepping

METHODS = [Explicit(), TaylorSeries(), Implicit()]
YOKE, SINE = (0.0, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0, 0.0)


def named(method):
    return type(method).__name__


# ------------------------------------------------------------------------------------------------------------------------- energy
@pytest.mark.parametrize("method", METHODS, ids=named)
def test_a_dead_centre_is_passed_at_the_speed_that_the_work_of_friction_leaves(method):
    """J w^2 / 2 falls by F times the way along the guide, which from the angle .5 to pi is 1 + cos .5."""
    plant = compose(Lever(harmonics=SINE))
    run = simulate(plant, 10.0, start={"shaft.angle": 0.5, "shaft.speed": 1.0}, method=method, accuracy=1e-9)
    first = run.events[0]
    assert tuple(first)[1:] == ("guide", "slip+", "slip-")
    at = run.at(first.time)
    assert at["shaft.angle"] == pytest.approx(math.pi, abs=1e-9)
    assert at["shaft.speed"] == pytest.approx(math.sqrt(1.0 - 0.2 * (1.0 + math.cos(0.5))), rel=1e-8)
    assert energy_audit(run).relative < 1e-7


@pytest.mark.parametrize(
    "units", [(1.0, 1.0, 1.0), (1e-6, 1.0, 1.0), (1e6, 1.0, 1.0), (1.0, 1e-6, 1.0), (1.0, 1e6, 1.0), (1.0, 1.0, 1e-6), (1e-6, 1e6, 1e6)]
)
@pytest.mark.parametrize("method", METHODS, ids=named)
def test_a_scotch_yoke_comes_to_rest_where_its_energy_is_spent_in_any_units(method, units):
    """From the angle 0 with w^2 = 1.69: 2 r F / J = .2 to the first dead centre, twice that to each next one, and .29 = .2 (1 + sin a) behind 7 pi / 2."""
    length, second, mass = units
    force = mass * length / second**2
    plant = compose(Lever(inertia=mass * length**2, harmonics=tuple(length * h for h in YOKE), friction=Coulomb(0.1 * force, 0.1 * force)))
    run = simulate(plant, 40.0 * second, start={"shaft.speed": 1.3 / second}, method=method, accuracy=1e-9)
    assert [event.after for event in run.events] == ["slip-", "slip+", "slip-", "slip+", "stick"]
    squares = 1.69 - np.array([0.2, 0.6, 1.0, 1.4])
    speeds = run.at([event.time for event in run.events[:4]])["shaft.speed"] * second
    np.testing.assert_allclose(speeds, np.sqrt(squares), rtol=1e-7)
    assert run["shaft.angle"][-1] == pytest.approx(4 * math.pi + math.asin(0.45), abs=1e-7)
    assert abs(run["shaft.speed"][-1]) * second < 1e-25


def test_time_stepping_comes_to_rest_at_the_same_place_as_its_steps_shorten():
    plant = compose(Lever(harmonics=YOKE))
    right, off = 4 * math.pi + math.asin(0.45), []
    for step in (4e-3, 2e-3, 1e-3):
        run = simulate(plant, 25.0, start={"shaft.speed": 1.3}, method=TimeStepping(step=step))
        assert [event.after for event in run.events] == ["slip-", "slip+", "slip-", "slip+", "stick"]
        off.append(abs(run["shaft.angle"][-1] - right))
    assert off[2] < 2e-3 and off[2] < 0.6 * off[0]


# --------------------------------------------------------------------------------------------------- starts at a dead centre
@pytest.mark.parametrize("method", METHODS, ids=named)
@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("torque", [0.05, 0.05 * ca.sin(time), 0.05 * time**3])
def test_a_shaft_that_starts_at_a_dead_centre_at_rest_turns_as_it_is_driven(method, way, torque):
    """The lever is zero there and holds nothing: to first order the angle is that of the free shaft, by d^2 a/dt^2 = T."""
    plant = compose(Lever(harmonics=SINE))
    run = simulate(plant, 0.4, inputs={"shaft.torque": way * torque}, method=method, accuracy=1e-9)
    t = np.linspace(0.0, 0.4, 401)
    drive = np.broadcast_to(np.array(ca.Function("torque", [time], [ca.SX(torque)])(t[None])).ravel(), t.shape)
    free = np.trapezoid(np.concatenate([[0.0], np.cumsum((drive[1:] + drive[:-1]) / 2 * 1e-3)]), t)
    assert run["shaft.angle"][-1] == pytest.approx(way * free, rel=2e-3)  # friction has had a lever of no more than the angle
    assert [event for event in run.events if event.after == "stick"] == []


def test_at_a_dead_centre_at_rest_without_drive_all_stays_and_a_later_step_moves_it():
    plant = compose(Lever(harmonics=SINE))
    run = simulate(plant, 2.0, inputs={"shaft.torque": ((0.0, 1.0, 1.0, 2.0), (0.0, 0.0, 0.05, 0.05))})
    assert run.at(1.0)["shaft.angle"] == 0.0 and [tuple(event) for event in run.events] == [(1.0, "guide", "stick", "slip+")]
    later = simulate(plant, 1.0, inputs={"shaft.torque": 0.05})
    assert run["shaft.angle"][-1] == pytest.approx(later["shaft.angle"][-1], rel=1e-6)


@pytest.mark.parametrize("method", METHODS, ids=named)
def test_a_lever_that_only_touches_zero_lets_the_shaft_pass_and_go_on_as_it_was(method):
    """p = 1 - cos a is never negative: the slip keeps its sign over the angle 0, and the speed falls by the work of the way, a - sin a."""
    plant = compose(Lever(harmonics=(1.0, -1.0, 0.0, 0.0, 0.0)))
    for start in (-1.0, 0.0):
        run = simulate(plant, 2.0, start={"shaft.angle": start, "shaft.speed": 1.0}, method=method, accuracy=1e-9)
        assert run.events == []
        a, w = run["shaft.angle"][-1], run["shaft.speed"][-1]
        assert w**2 == pytest.approx(1.0 - 0.2 * ((a - math.sin(a)) - (start - math.sin(start))), rel=1e-7)


# --------------------------------------------------------------------------------------------------------- a driven crank
CRANK = Trial(
    (0.0, 0.0, -1.0, 0.0, -0.15), 1.0, 0.4, 0.3, 0.2, 0.9, 0.7, (0.0, 0.8, 0.25, 0.5), (2.8, 0.0), 12.0, (1.0, 1.0, 1.0), "explicit"
)


@pytest.mark.parametrize("method", ["explicit", "taylor", "stiff"])
def test_a_driven_crank_switches_as_an_integration_from_event_to_event_says(method):
    reference = Reference(CRANK)
    run = dataclasses.replace(CRANK, method=method).run()
    modes = {"slip+": 1, "slip-": -1, "stick": 0}
    after = [mode for _, mode in reference.events]
    assert 0 in after and any(a * b == -1 for a, b in itertools.pairwise(after))  # it rests, and passes dead centres
    assert [modes[event.after] for event in run.events] == after
    np.testing.assert_allclose([event.time for event in run.events], [moment for moment, _ in reference.events], atol=2e-6)
    assert run["shaft.angle"][-1] == pytest.approx(reference.end[0], abs=1e-5)


# ----------------------------------------------------------------------------------------- the other readings of the same loop
def test_lanes_and_a_stepped_machine_pass_dead_centres_as_a_run_alone_does():
    plant = compose(Lever(harmonics=YOKE))
    inertias = np.linspace(0.5, 2.0, 8)
    found = batch(plant, 15.0, {"shaft.inertia": inertias}, 8, start={"shaft.speed": 1.3})
    assert not found.statuses.any()
    for i in (0, 3, 7):
        alone = simulate(plant, 15.0, start={"shaft.speed": 1.3}, parameters={"shaft.inertia": inertias[i]})
        assert found.switches[i] == len(alone.events) > 1
        np.testing.assert_allclose(found.states[i], alone.states[-1], rtol=1e-5, atol=1e-6)
    machine = stepper(closed_loop(plant, start={"shaft.speed": 1.3}), 0.1, outputs=("shaft.angle",), duration=40.0)
    machine.reset()
    for _ in range(250):
        angle = machine.step()
    assert angle[0] == pytest.approx(4 * math.pi + math.asin(0.45), abs=1e-5)


def test_the_angle_of_rest_has_the_derivative_of_its_closed_form():
    """F r (1 + sin a) = J (w0^2 - 1.4) / 2 with F, r, J = .1, 1, 1:  da/dw0 = w0 / (.1 cos a)."""
    run = simulate(compose(Lever(harmonics=YOKE)), 25.0, start={"shaft.speed": 1.3}, accuracy=1e-10)
    (slope,) = np.atleast_1d(sensitivity(run, "shaft.speed").end("shaft.angle"))
    assert slope == pytest.approx(1.3 / (0.1 * math.sqrt(1.0 - 0.45**2)), rel=1e-6)


# ------------------------------------------------------------------------------------------------------------ what is no lever
@dataclasses.dataclass(frozen=True)
class Rod(Component):
    """A slip of a constant part and one that turns, a wall around a shaft, and a relay with a lever."""

    def equations(self, signal):
        a, w = state("rod.angle", "rad"), state("rod.turning", "rad/s")
        v, u = state("rod.speed", "m/s", 2), state("rod.surface", "1")
        tip = DryFriction("tip", v[0] + ca.cos(a) * w, Coulomb(0.1, 0.1))
        wall = DryFriction("wall", ca.cos(a) * v[0] + ca.sin(a) * v[1], Coulomb(0.1, 0.1))
        relay = Relay("relay", ca.sin(a) * u, 1.0)
        push = ca.vertcat(tip.force + ca.cos(a) * wall.force, ca.sin(a) * wall.force)
        return Equations(flow={a: w, w: ca.cos(a) * tip.force, v: push, u: ca.sin(a) * relay.force}, elements=[tip, wall, relay])


def test_only_frictions_all_of_whose_levers_can_vanish_at_once_are_let_pass():
    assert compose(Rod()).switched_equations.levers == (0, 0, 0)
    assert compose(Lever(harmonics=YOKE)).switched_equations.levers == (1,)
