"""Bit bounce against closed forms: drop, dither at the hook, lobes that throw the bit off bottom, and torque that comes and goes with weight."""

from __future__ import annotations

import dataclasses
import math

import casadi as ca
import numpy as np
import pytest

from models import AxialChain, BitRock, Coulomb, ElasticRock, HystereticBitRock, TorsionalChain, TorsionalPendulum, wells
from toolbox import SceneError, compose, energy_audit, equilibrium, simulate, time
from toolbox.inputs import sine
from toolbox.measuring.measure import extent

MASS, WEIGHT = 34_000.0, 60_000.0
STRING = AxialChain(mass=(MASS,), stiffness=(), damping=(), hook_load=MASS * 9.81 - WEIGHT)
ROCK = ElasticRock(stiffness=5e7, damping=0.0)
W0 = math.sqrt(5e7 / MASS)
SAG = WEIGHT / 5e7


def test_a_dropped_string_bounces_back_to_where_it_came_from():
    # down with W/M from height h, v0 = sqrt(2 h W/M); on bottom half a swing about the sag and what lies above it
    height = 0.02
    pace = WEIGHT / MASS
    v0 = math.sqrt(2 * pace * height)
    run = simulate(compose(STRING, ROCK), 1.2, start={"bit.position": -height}, accuracy=1e-9)
    touch, leave = run.events[:2]
    assert (touch.after, leave.after) == ("closed", "open")
    assert touch.time == pytest.approx(v0 / pace, rel=1e-8)
    assert leave.time - touch.time == pytest.approx((math.pi + 2 * math.atan(pace / (W0 * v0))) / W0, rel=1e-7)
    back = run.at(leave.time + v0 / pace)
    assert back["bit.position"] == pytest.approx(-height, rel=1e-6) and back["bit.weight"] == 0.0
    assert extent(run, "bit.weight").maximum == pytest.approx(WEIGHT + math.hypot(WEIGHT, MASS * W0 * v0), rel=1e-6)


def test_damping_lets_the_bit_rest_on_its_sag_and_the_energy_closes():
    run = simulate(compose(STRING, dataclasses.replace(ROCK, damping=2e5)), 8.0, start={"bit.position": -0.02}, accuracy=1e-9)
    assert len(run.events) >= 3 and run.intervals("bit.bottom")[-1][2] == "closed"
    assert run.at(8.0)["bit.position"] == pytest.approx(SAG, rel=1e-6)
    audit = energy_audit(run)
    assert audit.relative < 1e-9
    # all that the string brought and lost stays in damper, spring and lift-offs
    assert audit.losses["bit.rock"] + audit.impacts > 0.9 * WEIGHT * 0.02


@pytest.mark.parametrize("frequency", [3.0, 6.0, 20.0])
def test_dither_at_the_hook_reaches_the_bit_by_the_transfer_function_of_mass_and_rock(frequency):
    # W/H = -(k + i w c)/(k + i w c - M w^2)
    rock, amplitude, w = dataclasses.replace(ROCK, damping=4e5), 4000.0, 2 * math.pi * frequency
    impedance = 5e7 + 1j * w * 4e5
    gain = abs(impedance / (impedance - MASS * w**2))
    run = simulate(
        compose(STRING, rock), 6.0, inputs={"hook.load": sine(MASS * 9.81 - WEIGHT, amplitude, frequency)}, start={"bit.position": SAG}
    )
    assert run.time_in("bit.bottom", "closed") == 6.0
    swing = extent(run, "bit.weight", after=5.0)
    assert (swing.maximum - swing.minimum) / 2 == pytest.approx(gain * amplitude, rel=1e-4)
    assert swing.maximum + swing.minimum == pytest.approx(2 * WEIGHT, rel=1e-4)


def test_lobes_throw_the_bit_off_bottom_above_the_speed_at_which_the_weight_no_longer_follows():
    # d = sag - D cos(3 w t), D = a (3w)^2/(W0^2 - (3w)^2): the weight reaches zero where k D = W
    height = 1e-3
    fastest = W0 / 3 * math.sqrt(SAG / (height + SAG))
    rock = dataclasses.replace(ROCK, lobe_height=height)
    for factor, bounces in ((0.98, False), (1.02, True)):
        speed = factor * fastest
        plant = compose(TorsionalPendulum(inertia=1e9, stiffness=0.0), STRING, rock)
        depth = height * (3 * speed) ** 2 / (W0**2 - (3 * speed) ** 2)
        run = simulate(plant, 4.0, start={"bit.speed": speed, "bit.position": SAG - depth - height}, accuracy=1e-9)
        assert bool(run.events) is bounces
        if not bounces:
            times = np.linspace(0.0, 4.0, 300)
            expected = WEIGHT - 5e7 * depth * np.cos(3 * speed * times)
            np.testing.assert_allclose(run.at(times)["bit.weight"], expected, atol=1e-5 * WEIGHT)
        assert energy_audit(run).relative < 1e-7


def test_torque_follows_the_weight_and_is_gone_while_the_bit_flies():
    rig = compose(wells.JANSEN_2, STRING, dataclasses.replace(ROCK, damping=5e4), BitRock(friction=Coulomb(static=0.5, kinetic=0.5)))
    run = simulate(rig, 5.0, start={"bit.position": -0.03, "chain.speed": 10.0, "chain.twist": 8.0})
    turns, flies = run.modes["bit"] == "slip+", run.modes["bit.bottom"] == "open"
    assert flies.sum() > 10 and (turns & ~flies).sum() > 50
    np.testing.assert_allclose(run["bit.torque"][turns], 0.5 * 0.155575 * run["bit.weight"][turns], rtol=1e-12)
    assert np.all(run["bit.torque"][flies] == 0.0)
    assert energy_audit(run).relative < 1e-6


@pytest.mark.parametrize("law", [BitRock, HystereticBitRock])
def test_on_bottom_at_rest_an_axial_string_leaves_the_torsional_equations_as_they_were_bit_for_bit(law):
    alone = compose(wells.NAVARRO_LOPEZ_4, law(weight=WEIGHT))
    both = compose(wells.NAVARRO_LOPEZ_4, STRING, ROCK, law(weight=1000.0))  # the weight is now that of the string
    rest = equilibrium(both, mode={"bit": "stick", "bit.bottom": "closed"})
    assert rest["bit.weight"] == pytest.approx(WEIGHT, rel=1e-13)
    random, position = np.random.default_rng(2), WEIGHT / 5e7
    weight = 5e7 * position
    alone = alone.with_parameters({"bit.weight": weight})
    for mode in (1.0, -1.0, 0.0):
        x = random.normal(size=7) * mode**2
        x[-1] = abs(x[-1]) * mode
        modes = [mode if e.name == "bit" else 0.0 for e in both.elements]
        first = np.array(alone.rhs(0.0, x, np.array(alone.input_defaults(alone.values)), alone.values, [mode])).ravel()
        second = np.array(both.rhs(0.0, [*x, 0.0, position], np.array(both.input_defaults(both.values)), both.values, modes)).ravel()
        assert np.array_equal(second[:7], first)
        assert abs(second[7]) < 1e-12 and second[8] == 0.0


def test_a_string_at_rest_on_bottom_keeps_the_stick_slip_of_a_given_weight():
    push = {"top.torque": 7600.0}
    alone = simulate(compose(wells.JANSEN_2, BitRock(weight=WEIGHT)), 60.0, inputs=push, accuracy=1e-9)
    rig = compose(wells.JANSEN_2, STRING, ROCK, BitRock())
    both = simulate(rig, 60.0, inputs=push, start={"bit.position": SAG}, accuracy=1e-9)
    assert len(alone.events) == len(both.events) > 3
    np.testing.assert_allclose([e.time for e in both.events], [e.time for e in alone.events], atol=1e-6)


def test_dither_of_the_hook_load_shakes_the_weight_that_holds_the_bit():
    # a stuck bit breaks off when the lowest weight of a cycle no longer holds it
    torque = 0.8 * WEIGHT * 0.155575 * 0.9
    chain = TorsionalChain(inertia=(1.0, 374.0), stiffness=(1e6,), damping=(1e4,))
    rig = compose(chain, STRING, dataclasses.replace(ROCK, damping=4e5), BitRock())
    start = {"bit.position": SAG, "chain.twist": torque / 1e6}
    still = simulate(rig, 2.0, inputs={"top.torque": torque}, start=start)
    shaken = simulate(
        rig, 2.0, inputs={"top.torque": torque, "hook.load": MASS * 9.81 - WEIGHT + 9000.0 * ca.sin(20.0 * time)}, start=start
    )
    assert still.time_in("bit", "stick") == 2.0
    assert shaken.time_in("bit", "stick") < 2.0
    release = shaken.events[0].time
    assert shaken.at(release)["bit.weight"] == pytest.approx(0.9 * WEIGHT, rel=1e-6)


def test_states_and_contacts_are_those_of_the_mechanisms():
    cases = {
        (STRING, ROCK): (2, ["bit.bottom"]),
        (wells.JANSEN_2, STRING, ROCK, BitRock()): (3 + 1 + 1, ["bit.bottom", "bit"]),
        (wells.JANSEN_2, STRING, dataclasses.replace(ROCK, lobe_height=1e-3), BitRock()): (3 + 1 + 2, ["bit.bottom", "bit"]),
        (wells.NAVARRO_LOPEZ_4, AxialChain(), ROCK, BitRock()): (7 + 2 + 1, ["bit.bottom", "bit"]),
    }
    for parts, (states, contacts) in cases.items():
        plant = compose(*parts)
        assert (plant.x.numel(), [element.name for element in plant.elements]) == (states, contacts)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"lobes": 0}, "lobes"),
    ],
)  # fmt: skip
def test_a_rock_that_cannot_be_built_is_refused_by_name(change, word):
    with pytest.raises(SceneError, match=word):
        compose(TorsionalPendulum(), STRING, dataclasses.replace(ROCK, **change))
