"""Bristle laws against closed forms, their bounds, and the set-valued contact to which they tend."""

from __future__ import annotations

import dataclasses
import math

import casadi as ca
import numpy as np
import pytest

from models import Block, BlockOnBelt, Coulomb, Dahl, Dankowicz, Exponential, LuGre
from toolbox import compose, energy_audit, linearise, measure, simulate
from toolbox.inputs import sine

STRIBECK = Exponential(static=1.0, kinetic=0.6, decay=3.0)
HEAVY = Block(mass=1e12, stiffness=0.0)  # moves at the speed it starts with, whatever rubs on it
BRISTLES = [Dahl(), LuGre(viscous=0.1), Dankowicz(friction=STRIBECK)]
each_bristle = pytest.mark.parametrize("bristle", BRISTLES, ids=lambda part: type(part).__name__)


def dragged(bristle, speed, duration):
    """A run in which the slip has a constant speed."""
    return simulate(compose(HEAVY, bristle), duration, start={"block.speed": speed}, accuracy=1e-11)


@each_bristle
def test_every_joule_of_a_bristle_is_accounted_for(bristle):
    plant = compose(Block(damping=0.1), dataclasses.replace(bristle, belt_speed=0.2))
    run = simulate(plant, 40.0, inputs={"block.force": sine(0.0, 0.7, 0.1)}, accuracy=1e-9)
    assert energy_audit(run).relative < 1e-8


@pytest.mark.parametrize("speed", [0.05, 0.5, -2.0])
def test_steady_sliding_on_bristles_is_the_stribeck_curve(speed):
    coefficient = 0.6 + 0.4 * math.exp(-3.0 * abs(speed))
    for bristle, expected in (
        (Dahl(kinetic=0.7), 0.7),
        (LuGre(load=2.0, viscous=0.3, friction=STRIBECK), 2 * coefficient + 0.3 * abs(speed)),
        (Dankowicz(load=2.0, friction=STRIBECK), 2 * coefficient),
    ):
        run = dragged(bristle, speed, 1.5 / abs(speed))
        assert run.at(run.end)["block.attachment"] == pytest.approx(-math.copysign(expected, speed), rel=1e-8)


def test_dahls_force_is_an_exponential_of_the_way():
    # F = F_k (1 - exp(-s d / F_k)), d = v t
    run = dragged(Dahl(stiffness=40.0, kinetic=0.8), 0.25, 1.0)
    times = np.linspace(0, 1, 50)
    np.testing.assert_allclose(-run.at(times)["block.attachment"], 0.8 * -np.expm1(-40.0 * 0.25 * times / 0.8), atol=1e-10)


def test_dahls_force_after_turning_round_starts_from_where_it_was():
    # after the turn at F_0: F = -F_k + (F_k + F_0) exp(-s d / F_k)
    bristle = Dahl(stiffness=40.0, kinetic=0.8)
    start = {"block.speed": -0.25, "bristle.deflection": 0.5 / 40.0}
    run = simulate(compose(HEAVY, bristle), 1.0, start=start, accuracy=1e-11)
    times = np.linspace(0, 1, 50)
    np.testing.assert_allclose(-run.at(times)["block.attachment"], -0.8 + 1.3 * np.exp(-40.0 * 0.25 * times / 0.8), atol=1e-10)


def test_asperities_bend_with_the_way_alone():
    # z = z_m (1 - exp(-d / z_m)) at any speed
    for speed in (0.1, 3.0):
        run = dragged(Dankowicz(reach=0.02, friction=STRIBECK), speed, 0.1 / speed)
        way = np.linspace(0, 0.1, 50)
        np.testing.assert_allclose(run.at(way / speed * (1 - 1e-12))["bristle.deflection"], 0.02 * -np.expm1(-way / 0.02), atol=1e-11)


@pytest.mark.parametrize(
    ("bristle", "stiffness", "damping"),
    [
        (Dahl(stiffness=200.0), 200.0, 0.0),
        (LuGre(stiffness=200.0, damping=3.0, viscous=0.5), 200.0, 3.5),
        (Dankowicz(reach=0.005), 200.0, 0.0),
    ],
    ids=["Dahl", "LuGre", "Dankowicz"],
)
def test_before_sliding_a_bristle_is_a_spring_and_a_damper(bristle, stiffness, damping):
    # poles of m s^2 + (s1 + s2) s + k + s0, and one at 0: z and x move together
    found = linearise(compose(Block(mass=2.0, stiffness=8.0), bristle)).poles()
    expected = np.append(np.roots([2.0, damping, 8.0 + stiffness]), 0.0)
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(expected), atol=1e-9)


def test_the_bristle_of_lugre_never_holds_more_than_the_static_force():
    plant = compose(Block(), LuGre(belt_speed=0.2, friction=STRIBECK))
    run = simulate(plant, 100.0, inputs={"block.force": sine(0.0, 3.0, 0.3)})
    extent = measure.extent(run, "bristle.deflection")
    assert max(extent.maximum, -extent.minimum) <= 1.0 / 100.0 * (1 + 1e-6)


@pytest.mark.parametrize(("s1", "s2"), [(1.0, 0.0), (10.0, 0.2)])
def test_the_losses_of_lugre_are_positive_up_to_the_speed_of_its_closed_form_and_not_beyond(s1, s2):
    # |v| <= 4 g(|v|) (s1 + s2) / s1^2; with constant g the border is one speed
    g, s0 = 0.6, 100.0
    border = 4 * g * (s1 + s2) / s1**2
    plant = compose(HEAVY, LuGre(stiffness=s0, damping=s1, viscous=s2, friction=Coulomb(static=g, kinetic=g)))
    power = sum(plant.losses.values())
    v, z = plant.x[1], plant.x[2]
    loss = ca.Function("loss", [plant.x, plant.p], [ca.substitute(power, plant.u, 0)])
    assert ca.depends_on(power, v) and ca.depends_on(power, z)

    def least(speed):
        return min(float(loss([0.0, speed, deflection], plant.values)) for deflection in np.linspace(-g / s0, 2 * g / s0, 3001))

    assert least(0.99 * border) > 0 > least(1.01 * border)


def test_a_round_trip_on_lugre_costs_energy_where_its_damping_is_small():
    plant = compose(Block(), LuGre(damping=1.0, friction=STRIBECK))
    run = simulate(plant, 100.0, inputs={"block.force": sine(0.0, 1.5, 0.1)})
    audit = energy_audit(run)
    assert all(loss >= 0 for loss in audit.losses.values() if loss)
    assert audit.losses["bristle.sliding"] > 0.1


def test_a_bristle_has_no_rest_where_the_set_valued_contact_stands():
    # half of the break-away force, pulsing: the block in stick stays, that on bristles creeps, more with every pulse
    inputs = {"block.force": sine(0.5, 0.3, 2.0)}
    held = simulate(compose(BlockOnBelt(stiffness=0.0, belt_speed=0.0, friction=STRIBECK)), 100.0, inputs=inputs)
    assert held.time_in("belt", "stick") == 100.0 and held.at(100.0)["block.position"] == 0.0
    crept = simulate(compose(Block(stiffness=0.0), LuGre(friction=STRIBECK)), 100.0, inputs=inputs)
    assert crept.at(100.0)["block.position"] - crept.at(50.0)["block.position"] > 0.01


def test_dahls_friction_has_no_stick_slip():
    run = simulate(compose(Block(damping=0.1), Dahl(belt_speed=0.2)), 200.0)
    assert measure.extent(run, "block.speed", 190.0).maximum < 1e-3


def cycle(run, after):
    """Period and swing of the position after the transient, from its upward passages through the mean."""
    found = measure.extent(run, "block.position", after)
    times = np.linspace(after, run.end, 20001)
    x = run.at(times)["block.position"] - found.mean
    up = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    crossings = times[up] - x[up] * (times[1] - times[0]) / (x[up + 1] - x[up])
    return np.diff(crossings).mean(), found.maximum - found.minimum


def test_a_stiff_bristle_moves_the_block_as_the_set_valued_contact_does():
    # the deflection at break-away, g / s0, is what is left of the difference: a tenth of it for ten times the stiffness
    exact = cycle(simulate(compose(BlockOnBelt(friction=STRIBECK)), 60.0), 20.0)
    errors = []
    for stiffness in (1e3, 1e4):
        bristle = LuGre(stiffness=stiffness, damping=0.2 * math.sqrt(stiffness), belt_speed=0.2, friction=STRIBECK)
        found = cycle(simulate(compose(Block(), bristle), 60.0), 20.0)
        errors.append(max(abs(a / b - 1) for a, b in zip(found, exact, strict=True)))
    assert errors[1] < 1e-2
    assert errors[1] < 0.35 * errors[0]
