"""Bristle laws against closed forms, their bounds, and the set-valued contact to which they tend, at every contact."""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest

from models import (
    AxialChain,
    BitRock,
    Block,
    BlockOnBelt,
    Coulomb,
    Dahl,
    Dankowicz,
    DiscBrake,
    Exponential,
    FrictionDamper,
    GuideContact,
    LuGre,
    TorsionalChain,
    WallContact,
    WhirlingCollar,
    wells,
)
from toolbox import compose, energy_audit, linearise, measure, simulate
from toolbox.inputs import sine

STRIBECK = Exponential(static=1.0, kinetic=0.6, decay=3.0)
HEAVY = Block(mass=1e12, stiffness=0.0)  # moves at the speed it starts with, whatever rubs on it
BRISTLES = [Dahl(), LuGre(viscous=0.1), Dankowicz(steady=STRIBECK)]
each_bristle = pytest.mark.parametrize("bristle", BRISTLES, ids=lambda law: type(law).__name__)


def dragged(bristle, speed, duration, load=1.0, **start):
    """A run in which the slip has a constant speed."""
    plant = compose(HEAVY, GuideContact(friction=bristle, load=load))
    return simulate(plant, duration, start={"block.speed": speed, **start}, accuracy=1e-11)


@each_bristle
def test_every_joule_of_a_bristle_is_accounted_for(bristle):
    plant = compose(BlockOnBelt(damping=0.1, friction=bristle))
    run = simulate(plant, 40.0, inputs={"block.force": sine(0.0, 0.7, 0.1), "block.load": sine(1.0, 0.5, 0.3)}, accuracy=1e-9)
    assert energy_audit(run).relative < 1e-8


@pytest.mark.parametrize("bristle", [Dahl(), LuGre()], ids=lambda law: type(law).__name__)
def test_what_a_bristle_took_up_is_the_energy_of_its_spring_and_the_rest_is_lost(bristle):
    run = simulate(compose(BlockOnBelt(load=2.0, friction=bristle)), 3.0, accuracy=1e-10)
    audit = energy_audit(run)
    held = 2.0 * bristle.stiffness * run.at(run.end)["belt.deflection"] ** 2 / 2
    assert -audit.supplies["belt memory"] == pytest.approx(held, rel=1e-7)
    lost = sum(value for name, value in audit.losses.items() if name.startswith("belt "))
    assert lost == pytest.approx(audit.losses["block.friction"] - held, rel=1e-7)


@pytest.mark.parametrize("speed", [0.05, 0.5, -2.0])
def test_steady_sliding_on_bristles_is_the_stribeck_curve(speed):
    coefficient = 0.6 + 0.4 * math.exp(-3.0 * abs(speed))
    for bristle, expected in (
        (Dahl(stiffness=50.0, kinetic=0.35), 0.35),
        (LuGre(stiffness=50.0, damping=5.0, viscous=0.15, steady=STRIBECK), coefficient + 0.15 * abs(speed)),
        (Dankowicz(steady=STRIBECK), coefficient),
    ):
        run = dragged(bristle, speed, 1.5 / abs(speed), load=2.0)
        assert run.at(run.end)["guide.force"] == pytest.approx(-math.copysign(2 * expected, speed), rel=1e-8)
        assert float(bristle.sliding(abs(speed))) == pytest.approx(expected, rel=1e-14)


def test_dahls_force_is_an_exponential_of_the_way():
    # F = F_k (1 - exp(-s d / F_k)), d = v t
    run = dragged(Dahl(stiffness=40.0, kinetic=0.8), 0.25, 1.0)
    times = np.linspace(0, 1, 50)
    np.testing.assert_allclose(-run.at(times)["guide.force"], 0.8 * -np.expm1(-40.0 * 0.25 * times / 0.8), atol=1e-10)


def test_dahls_force_after_turning_round_starts_from_where_it_was():
    # after the turn at F_0: F = -F_k + (F_k + F_0) exp(-s d / F_k), the other branch of the hysteresis loop
    run = dragged(Dahl(stiffness=40.0, kinetic=0.8), -0.25, 1.0, **{"guide.deflection": 0.5 / 40.0})
    times = np.linspace(0, 1, 50)
    np.testing.assert_allclose(-run.at(times)["guide.force"], -0.8 + 1.3 * np.exp(-40.0 * 0.25 * times / 0.8), atol=1e-10)


def test_the_closed_hysteresis_loop_of_dahl_takes_its_area_per_round():
    # x from -X to X and back: F_1 = F_k tanh(s X / F_k) at the ends, area = 4 F_k X - 4 (F_k / s) F_1
    s, f, amplitude = 40.0, 0.8, 0.05
    block = Block(mass=1e8, stiffness=1e8 * (2 * math.pi) ** 2)  # swings at 1 Hz, whatever rubs on it
    plant = compose(block, GuideContact(friction=Dahl(stiffness=s, kinetic=f)))
    run = simulate(plant, 3.0, start={"block.position": amplitude}, accuracy=1e-11)
    f1 = f * math.tanh(s * amplitude / f)
    assert run.at(2.0)["guide.force"] == pytest.approx(-f1, rel=1e-5)
    works = [
        energy_audit(simulate(plant, t, start={"block.position": amplitude}, accuracy=1e-11)).losses["guide sliding"] for t in (2.0, 3.0)
    ]
    assert works[1] - works[0] == pytest.approx(4 * f * amplitude - 4 * f / s * f1, rel=1e-5)


def test_a_block_on_a_belt_takes_a_guide_whose_friction_is_a_stiff_bristle():
    # x = 0.6 (1 - cos t) under the belt's 1 N less 0.4 N of the guide, until it has the speed of the belt; it sticks until x + 0.4 = 1
    belt = BlockOnBelt(friction=Coulomb(1.0, 1.0))
    sticks = math.asin(0.2 / 0.6)
    lets_go = sticks + 0.6 * math.cos(sticks) / 0.2
    set_valued = simulate(compose(belt, GuideContact(friction=Coulomb(0.4, 0.4))), 4.0)
    exact = [event.time for event in set_valued.events if event.element == "belt"]
    np.testing.assert_allclose(exact[:2], (sticks, lets_go), rtol=1e-7)
    late = []
    for stiffness in (1e4, 1e5):
        run = simulate(compose(belt, GuideContact(friction=Dahl(stiffness=stiffness, kinetic=0.4))), 4.0, accuracy=1e-8)
        assert [(event.element, event.after) for event in run.events[:2]] == [("belt", "stick"), ("belt", "slip-")]
        late.append([event.time - exact for event, exact in zip(run.events[:2], (sticks, lets_go), strict=True)])
    np.testing.assert_allclose(late[1], 0.0, atol=2e-3)
    assert (np.abs(late[1]) < 0.5 * np.abs(late[0])).all()


def test_asperities_bend_with_the_way_alone():
    # z = z_m (1 - exp(-d / z_m)) at any speed
    for speed in (0.1, 3.0):
        run = dragged(Dankowicz(presliding_displacement=0.02, steady=STRIBECK), speed, 0.1 / speed)
        way = np.linspace(0, 0.1, 50)
        np.testing.assert_allclose(run.at(way / speed * (1 - 1e-12))["guide.deflection"], 0.02 * -np.expm1(-way / 0.02), atol=1e-11)


@pytest.mark.parametrize(
    ("bristle", "stiffness", "damping"),
    [
        (Dahl(stiffness=100.0), 200.0, 0.0),
        (LuGre(stiffness=100.0, damping=1.5, viscous=0.25), 200.0, 3.5),
        (Dankowicz(presliding_displacement=0.01), 200.0, 0.0),
    ],
    ids=["Dahl", "LuGre", "Dankowicz"],
)
def test_before_sliding_a_bristle_is_a_spring_and_a_damper(bristle, stiffness, damping):
    # poles of m s^2 + (s1 + s2) N s + k + s0 N, and one at 0: z and x move together
    found = linearise(compose(Block(mass=2.0, stiffness=8.0), GuideContact(load=2.0, friction=bristle))).poles()
    expected = np.append(np.roots([2.0, damping, 8.0 + stiffness]), 0.0)
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(expected), atol=1e-9)


def test_the_bristle_of_lugre_never_holds_more_than_the_static_force():
    plant = compose(BlockOnBelt(friction=LuGre(steady=STRIBECK)))
    run = simulate(plant, 100.0, inputs={"block.force": sine(0.0, 3.0, 0.3)})
    extent = measure.extent(run, "belt.deflection")
    assert max(extent.maximum, -extent.minimum) <= 1.0 / 100.0 * (1 + 1e-6)


def test_lugre_breaks_away_at_a_lower_force_the_faster_it_is_pulled():
    # a slow pull comes up to the static force; at a constant slip the bristle follows z' = v - s0 |v| z / g, g < static
    def peak(rate):
        plant = compose(
            Block(stiffness=0.0), GuideContact(friction=LuGre(stiffness=1e4, damping=100.0, steady=Exponential(1.0, 0.6, 30.0)))
        )
        run = simulate(plant, 2.0 / rate, inputs={"block.force": ([0.0, 2.0 / rate], [0.0, 2.0])}, accuracy=1e-9)
        return -measure.extent(run, "guide.force").minimum

    peaks = [peak(rate) for rate in (0.01, 0.1, 1.0, 10.0)]
    assert peaks == sorted(peaks, reverse=True)
    assert 0.99 < peaks[0] < 1.0 and peaks[-1] < 0.93


@pytest.mark.parametrize(("s1", "s2"), [(1.0, 0.0), (10.0, 0.2)])
def test_the_losses_of_lugre_are_positive_up_to_the_speed_of_its_closed_form_and_not_beyond(s1, s2):
    # |v| <= 4 g(|v|) (s1 + s2) / s1^2; with constant g the border is one speed
    g, s0 = 0.6, 100.0
    border = 4 * g * (s1 + s2) / s1**2
    plant = compose(HEAVY, GuideContact(friction=LuGre(stiffness=s0, damping=s1, viscous=s2, steady=Coulomb(static=g, kinetic=g))))
    power = sum(value for name, value in plant.losses.items() if name != "guide.friction")
    v, z = plant.x[1], plant.x[2]
    inputs = plant.input_defaults(plant.values)
    loss = ca.Function("loss", [plant.x, plant.u, plant.p], [power])
    assert ca.depends_on(power, v) and ca.depends_on(power, z)

    def least(speed):
        return min(float(loss([0.0, speed, deflection], inputs, plant.values)) for deflection in np.linspace(-g / s0, 2 * g / s0, 3001))

    assert least(0.99 * border) > 0 > least(1.01 * border)


def test_a_round_trip_on_lugre_costs_energy_where_its_damping_is_small():
    plant = compose(Block(), GuideContact(friction=LuGre(damping=1.0, steady=STRIBECK)))
    run = simulate(plant, 100.0, inputs={"block.force": sine(0.0, 1.5, 0.1)})
    audit = energy_audit(run)
    assert all(loss >= 0 for loss in audit.losses.values() if loss)
    assert audit.losses["guide sliding"] > 0.1


def test_a_bristle_has_no_rest_where_the_set_valued_contact_stands():
    # half of the break-away force, pulsing: the block in stick stays, that on bristles creeps, more with every pulse
    inputs = {"block.force": sine(0.5, 0.3, 2.0)}
    block = BlockOnBelt(stiffness=0.0, belt_speed=0.0, friction=STRIBECK)
    held = simulate(compose(block), 100.0, inputs=inputs)
    assert held.time_in("belt", "stick") == 100.0 and held.at(100.0)["block.position"] == 0.0
    crept = simulate(compose(dataclasses.replace(block, friction=LuGre(steady=STRIBECK))), 100.0, inputs=inputs)
    assert crept.at(100.0)["block.position"] - crept.at(50.0)["block.position"] > 0.01


def test_dahls_friction_has_no_stick_slip():
    run = simulate(compose(BlockOnBelt(damping=0.1, friction=Dahl())), 200.0)
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
        bristle = LuGre(stiffness=stiffness, damping=0.2 * math.sqrt(stiffness), steady=STRIBECK)
        found = cycle(simulate(compose(BlockOnBelt(friction=bristle)), 60.0), 20.0)
        errors.append(max(abs(a / b - 1) for a, b in zip(found, exact, strict=True)))
    assert errors[1] < 1e-2
    assert errors[1] < 0.35 * errors[0]


def test_a_stiff_dahl_tends_to_coulombs_law_with_the_first_power_of_its_compliance():
    # free flight against friction: Coulomb stops after x = v^2 / (2 mu); Dahl's spring takes F_k^2 / (2 s) less work on the way, of the order 1 / s
    def way(friction):
        run = simulate(
            compose(BlockOnBelt(stiffness=0.0, belt_speed=0.0, friction=friction)), 1.9, start={"block.speed": 1.0}, accuracy=1e-11
        )
        return run.at(1.9)["block.position"]

    exact = way(Coulomb(static=0.5, kinetic=0.5))
    assert exact == pytest.approx(1.0 - 0.5 * 0.5 * 0.1**2, rel=1e-9)  # still moving at 0.05 m/s
    errors = [way(Dahl(stiffness=stiffness, kinetic=0.5)) - exact for stiffness in (1e3, 1e4, 1e5)]
    for coarse, fine in pairwise(errors):
        assert coarse / fine == pytest.approx(10.0, rel=0.05)


CHAIN = TorsionalChain(inertia=(2122.0, 374.0), stiffness=(473.0,), damping=(23.2,), top_drag=425.0)
AXIAL = AxialChain(mass=(20_000.0,) * 2, stiffness=(4e6, 8e6), damping=(4e4,) * 2)

SOFT = {"stiffness": 500.0, "damping": 0.1}
CONTACTS = {
    "bit": ((wells.NAVARRO_LOPEZ_4, BitRock()), {"top.torque": 9000.0}, 1.0),
    "bit without drag": ((dataclasses.replace(wells.NAVARRO_LOPEZ_4, top_drag=0.0, bit_drag=0.0), BitRock()), {"top.torque": 9000.0}, 1.0),
    "string": (
        (dataclasses.replace(wells.NAVARRO_LOPEZ_4, friction=Exponential(), friction_load=(2000.0, 3000.0, 500.0, 400.0)),),
        {"top.torque": 6000.0},
        1.0,
    ),
    "brake": ((DiscBrake(),), {"brake.force": ([0.0, 1.0], [0.0, 2000.0])}, 2.0),
    "belt": ((BlockOnBelt(),), {}, 1.0),
    "belt with drag": ((BlockOnBelt(drag=0.3),), {}, 1.0),
    "damper": ((Block(), FrictionDamper(load=1.0)), {"block.force": sine(0.0, 1.0, 0.1)}, 1.0),
    "wall": ((AXIAL, CHAIN, WallContact()), {"hook.speed": -0.05, "top.torque": 3000.0}, 1.0),
}


@pytest.mark.parametrize(
    "law", [Dahl(500.0, 0.4), LuGre(**SOFT, steady=Exponential(0.5, 0.3, 2.0)), Dankowicz(0.002)], ids=lambda law: type(law).__name__
)
@pytest.mark.parametrize("place", CONTACTS)
def test_a_law_with_memory_serves_every_contact_and_its_energy_is_accounted_for(place, law):
    parts, inputs, duration = CONTACTS[place]
    plant = compose(*[dataclasses.replace(part, friction=law) if getattr(part, "friction", None) is not None else part for part in parts])
    assert plant.modeless and not plant.elements
    start = {"disc.speed": 5.0} if place == "brake" else {}
    run = simulate(plant, duration, inputs=inputs, start=start, accuracy=1e-9)
    assert energy_audit(run).relative < 1e-7
    for contact in plant.modeless:
        assert measure.extent(run, f"{contact}.force").maximum != measure.extent(run, f"{contact}.force").minimum


@pytest.mark.parametrize("law", [Dahl(2000.0, 0.35), LuGre(2000.0, 0.1, 0.0, Coulomb(0.35, 0.35))], ids=lambda law: type(law).__name__)
def test_a_collar_that_rubs_on_bristles_follows_the_one_on_dry_friction(law):
    # bounces off an elastic wall: no force while it is open, and the way of the centre differs by the deflection of the bristles
    ends = []
    for friction in (Coulomb(0.35, 0.35), law):
        string = dataclasses.replace(CHAIN, collar_index=-1)
        plant = compose(string, WhirlingCollar(wall_stiffness=1e7, weight=0.0, friction=friction))
        run = simulate(
            plant, 2.0, start={"chain.speed": 25.0, "collar.velocity": (0.3, 0.1)}, inputs={"top.torque": 10_000.0}, accuracy=1e-8
        )
        assert energy_audit(run).relative < 1e-6
        times = np.linspace(0, 2, 4001)
        opened = run.at(times).modes["wall"] == "open"
        assert opened.any() and not opened.all()
        assert not np.any(run.at(times)["rub.force"][opened])
        ends.append(run.at(0.3)["collar.y"])
    assert ends[1] == pytest.approx(ends[0], abs=2e-3)


def test_bristles_in_two_directions_act_against_the_resultant_of_both_slips():
    # drawn straight at (3, 4) / 5 the column of forces is that of one direction
    law = LuGre(stiffness=50.0, damping=0.0, steady=STRIBECK)
    string = (
        AxialChain(mass=(1e12,) * 2, stiffness=(0.0,) * 2, damping=(0.0,) * 2),
        TorsionalChain(inertia=(1e12,) * 2, stiffness=(0.0,), damping=(0.0,)),
    )
    plant = compose(*string, WallContact(load=20.0, radius=1.0, friction=law))
    run = simulate(plant, 0.2, start={"axial.speed": 0.3, "chain.speed": 0.4}, accuracy=1e-10)
    one = dragged(law, 0.5, 0.2, load=20.0)
    assert run.at(0.2)["wall.force"] == pytest.approx(-one.at(0.2)["guide.force"], rel=1e-8)
    np.testing.assert_allclose(
        [run.at(0.2)["wall.drag"], run.at(0.2)["wall.torque"]], run.at(0.2)["wall.force"] * np.array([0.6, 0.8]), rtol=1e-8
    )
    assert run.at(0.2)["wall.slip"] == pytest.approx(0.5, rel=1e-10)  # a trillion kg feel 20 N
