"""The friction damper against its quasi-static closed form and its two limits without loss."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models import Block, Coulomb, FrictionDamper
from toolbox import compose, energy_audit, measure, simulate
from toolbox.inputs import sine

LAW = Coulomb(static=1.0, kinetic=1.0)


def loss_per_cycle(load, *, amplitude=1.0, stiffness=1.0, mass=1e-4):
    """Friction energy per cycle of a slow forced swing that the damper hardly disturbs, and the swing's measured amplitude."""
    heavy = Block(mass=1.0, stiffness=1e4)
    damper = FrictionDamper(stiffness=stiffness, slider_mass=mass, damping=2 * math.sqrt(stiffness * mass), load=load, friction=LAW)
    plant, period = compose(heavy, damper), 20.0
    w = 2 * math.pi / period
    force = amplitude * (1e4 - w**2)
    start = {"block.speed": amplitude * w, "damper.stretch": 0.0}
    ends = [
        energy_audit(simulate(plant, n * period, start=start, inputs={"block.force": sine(0.0, force, 1 / period)})).losses[
            "damper.friction"
        ]
        for n in (2, 3)
    ]
    return ends[1] - ends[0]


@pytest.mark.parametrize("load", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_the_loss_of_a_slow_cycle_is_that_of_the_jenkins_element(load):
    # W = 4 F (X - F / k); a slider of 1e-4 kg with critical damping is late by (c / k) X w = 0.6 % of the swing
    assert loss_per_cycle(load) == pytest.approx(4 * load * (1.0 - load), rel=0.02)


def test_a_lighter_slider_comes_nearer_to_the_jenkins_element():
    errors = [abs(loss_per_cycle(0.5, mass=mass) - 1.0) for mass in (1e-2, 1e-4)]
    assert errors[1] < 0.2 * errors[0]


def test_a_damper_that_never_slides_takes_nothing_and_is_a_spring():
    block = Block(stiffness=3.0)
    run = simulate(
        compose(block, FrictionDamper(damping=0.0, load=10.0, friction=LAW)),
        10.0,
        start={"block.position": 0.1, "damper.stretch": 0.1},
        accuracy=1e-10,
    )
    times = np.linspace(0, 10, 100)
    np.testing.assert_allclose(run.at(times)["block.position"], 0.1 * np.cos(2 * times), atol=1e-9)
    assert run.time_in("damper", "stick") == 10.0
    assert energy_audit(run).losses["damper.friction"] == 0.0


def swing(load):
    plant = compose(Block(damping=0.02), FrictionDamper(load=load, friction=LAW))
    worst = 0.0
    for w in (1.0, 1.1, 1.2, 1.3, math.sqrt(2)):  # between the frequencies of the free and of the held damper
        run = simulate(plant, 400.0, inputs={"block.force": sine(0.0, 0.1, w / (2 * math.pi))})
        worst = max(worst, measure.extent(run, "block.position", 350.0).maximum)
    return worst


def test_the_highest_resonance_is_lowest_at_a_load_in_between():
    free, best, held = swing(1e-4), swing(0.12), swing(5.0)
    assert best < 0.2 * free and best < 0.2 * held


def test_every_joule_of_the_damper_is_accounted_for():
    run = simulate(
        compose(Block(damping=0.02), FrictionDamper(load=0.1, friction=LAW)),
        60.0,
        inputs={"block.force": sine(0.0, 0.1, 0.17)},
        accuracy=1e-9,
    )
    assert len(run.events) > 10
    assert energy_audit(run).relative < 1e-8
