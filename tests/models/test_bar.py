"""The oscillator on a bar: its modes against the continuous bar, its motion against the matrix exponential, its two periods."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import brentq

from models import BlockOnBelt, Coulomb, OscillatorOnBar
from toolbox import SceneError, compose, energy_audit, equilibrium, linearise, simulate

PLAIN = OscillatorOnBar()
WAVE = math.sqrt(PLAIN.modulus / PLAIN.density)


def stuck_frequencies(n):
    """Angular frequencies of the undamped oscillator that sticks to a bar of n modes."""
    plant = compose(dataclasses.replace(PLAIN, modes=n, loss=0.0, damping=0.0, bar_speed=0.0))
    return np.sort(np.unique(np.round(abs(np.linalg.eigvals(linearise(plant, mode={"bar": "stick"}).A).imag), 6)))


def exact_frequency(low, high):
    """E A kappa (cot kappa a + cot kappa (L - a)) + k - m w^2 = 0 with kappa = w / c: the continuous bar with the oscillator on it."""
    a = PLAIN.contact_position * PLAIN.length

    def balance(w):
        kappa = w / WAVE
        bar = PLAIN.modulus * PLAIN.area * kappa * (1 / math.tan(kappa * a) + 1 / math.tan(kappa * (PLAIN.length - a)))
        return bar + PLAIN.stiffness - PLAIN.mass * w**2

    return brentq(balance, low, high, xtol=1e-9)


def test_an_oscillator_that_sticks_to_the_bar_swings_with_it_as_on_the_continuous_bar():
    exact = exact_frequency(1000.0, 0.99 * math.pi * WAVE / PLAIN.length)
    errors = [min(abs(stuck_frequencies(n) - exact)) / exact for n in (20, 40)]
    assert errors[1] < 0.01
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.15)  # a point force: the compliance of the modes left out falls like 1 / n


def test_a_bar_under_steady_friction_gives_way_as_a_bar_does():
    # u(a) = F a (L - a) / (E A L); the modes beyond n would add at most 2 F L / (E A pi^2 n)
    n, load = 40, 10.0
    bar = dataclasses.replace(PLAIN, modes=n, friction=Coulomb(static=0.3, kinetic=0.3), bar_speed=0.05)
    rest = equilibrium(compose(bar), mode={"bar": "slip-"})
    shape = np.sin(math.pi * np.arange(1, n + 1) * PLAIN.contact_position)
    a = PLAIN.contact_position * PLAIN.length
    exact = 0.3 * load * a * (PLAIN.length - a) / (PLAIN.modulus * PLAIN.area * PLAIN.length)
    left_out = 2 * 0.3 * load * PLAIN.length / (PLAIN.modulus * PLAIN.area * math.pi**2 * n)
    assert exact - left_out < -shape @ rest["oscillator.amplitude"] < exact
    assert left_out < 0.03 * exact
    assert rest["oscillator.position"] == pytest.approx(0.3 * load / PLAIN.stiffness, rel=1e-12)


def test_while_friction_is_constant_oscillator_and_bar_ring_each_at_their_own_frequency():
    # constant F: x and every q_j are cosines about their rest
    bar = dataclasses.replace(PLAIN, friction=Coulomb(static=0.3, kinetic=0.3), bar_speed=3.0, loss=0.0, damping=0.0)
    run = simulate(compose(bar), 0.05, accuracy=1e-10)
    assert run.events == []
    t = np.linspace(0.0, 0.05, 200)
    found, force = run.at(t), 3.0
    x = force / bar.stiffness
    np.testing.assert_allclose(found["oscillator.position"], x * (1 - np.cos(math.sqrt(bar.stiffness / bar.mass) * t)), atol=1e-9 * x)
    for j in range(1, bar.modes + 1):
        w = j * math.pi * WAVE / bar.length
        rest = -force * math.sin(j * math.pi * bar.contact_position) / (bar.density * bar.area * bar.length / 2 * w**2)
        np.testing.assert_allclose(found["oscillator.amplitude"][:, j - 1], rest * (1 - np.cos(w * t)), atol=1e-7 * abs(rest) + 1e-16)


def test_the_oscillator_gives_the_long_period_and_the_bar_the_short_one():
    run = simulate(compose(PLAIN), 2.0)
    gaps = np.diff([event.time for event in run.events if event.before == "stick" and event.time > 0.5])
    long, short = gaps[gaps > 0.01], gaps[gaps < 0.01]
    own = 2 * math.pi * math.sqrt(PLAIN.mass / PLAIN.stiffness)
    assert len(long) > 10 and len(short) > 3 * len(long)
    assert np.all(abs(long / own - 1) < 0.25)
    # between the period of the bar alone and that of the bar with the oscillator stuck to it, or cut off by the oscillator's turn
    together = 2 * math.pi / exact_frequency(1000.0, 0.99 * math.pi * WAVE / PLAIN.length)
    alone = 2 * PLAIN.length / WAVE
    assert alone < np.median(short) < together
    assert short.max() < 1.05 * together
    # a rigid bar knows only the long one
    rigid = BlockOnBelt(
        mass=PLAIN.mass,
        stiffness=PLAIN.stiffness,
        damping=PLAIN.damping,
        belt_speed=PLAIN.bar_speed,
        load=PLAIN.load,
        friction=PLAIN.friction,
    )
    gaps = np.diff([event.time for event in simulate(compose(rigid), 2.0).events if event.before == "stick" and event.time > 0.5])
    assert len(gaps) > 10 and gaps.min() > own


def test_a_stiff_bar_is_a_belt():
    stiff = dataclasses.replace(PLAIN, modulus=3e12, modes=1, loss=0.5)
    belt = BlockOnBelt(mass=0.1, stiffness=4000.0, damping=0.5, belt_speed=0.05, load=10.0, friction=PLAIN.friction)
    t = np.linspace(0.0, 0.1, 50)
    bar, rigid = (simulate(compose(part), 0.1, accuracy=1e-8).at(t) for part in (stiff, belt))
    np.testing.assert_allclose(bar["oscillator.position"], rigid["block.position"], atol=1e-3 * abs(rigid["block.position"]).max())


def test_every_joule_of_bar_and_oscillator_is_accounted_for():
    audit = energy_audit(simulate(compose(PLAIN), 0.5, inputs={"oscillator.force": 1.0}, accuracy=1e-8))
    assert audit.relative < 1e-9
    assert all(value >= 0 for value in audit.losses.values())


@pytest.mark.parametrize(("change", "word"), [({"modes": 0}, "modes"), ({"contact": 1.0}, "contact")])
def test_a_bar_that_cannot_be_built_is_refused_by_name(change, word):
    with pytest.raises(SceneError, match=word):
        compose(OscillatorOnBar(**change))
