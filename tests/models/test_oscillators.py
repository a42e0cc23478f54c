"""Published oscillators, two blocks, absorber, dither and the three cures against closed forms; every cure has its open twin."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import brentq

from models import (
    Absorber,
    Block,
    BlockOnBelt,
    BlocksOnBelt,
    Coulomb,
    CubicStribeck,
    Exponential,
    Hyperbolic,
    averaged_friction,
    oscillators,
)
from studies.questions.lyapunov import lyapunov
from tests.refusals import each_of, refusals
from toolbox import compose, energy_audit, equilibrium, linearise, measure, simulate
from toolbox.inputs import sine


def poles(plant, **arguments):
    """Poles of a plant that slides backwards on its belt, at the steady state."""
    modes = {element.name: "slip-" for element in plant.elements}
    return linearise(plant, equilibrium(plant, mode=modes, **arguments)).poles()


def swing(run, signal, after):
    found = measure.extent(run, signal, after)
    return found.maximum - found.minimum


# --- energy


PARTS = {
    "block": (Block(damping=0.1),),
    "belt": (BlockOnBelt(damping=0.1, drag=0.2),),
    "two blocks": (BlocksOnBelt(damping=(0.1, 0.0)),),
    "absorber": (BlockOnBelt(friction=Exponential(static=1.0, kinetic=0.5, decay=3.0)), Absorber()),
    "Thomsen-Fidlin": (oscillators.THOMSEN_FIDLIN,),
    "Veraszto-Stepan": (oscillators.VERASZTO_STEPAN,),
}


@pytest.mark.parametrize("name", PARTS)
def test_every_joule_of_an_oscillator_is_accounted_for(name):
    plant = compose(*PARTS[name])
    run = simulate(plant, 50.0, inputs={"block.force": sine(0.1, 0.3, 0.2)} if "block.force" in plant.inputs else {}, accuracy=1e-9)
    assert energy_audit(run).relative < 1e-8


# --- Veraszto and Stepan 2017, and the Hopf speeds in closed form


def test_the_hopf_speed_of_veraszto_and_stepan_is_the_published_logarithm():
    # v = ln(c_v (C0 - C) / (b0 + b_s)) / c_v
    assert oscillators.hopf_speed(oscillators.VERASZTO_STEPAN) == pytest.approx(math.log(10 * 4 / 5.946) / 10, rel=1e-14)


@pytest.mark.parametrize("name", ["THOMSEN_FIDLIN", "VERASZTO_STEPAN"])
def test_the_poles_cross_the_axis_at_the_hopf_speed_and_at_the_natural_frequency(name):
    block = getattr(oscillators, name)
    hopf = oscillators.hopf_speed(block)
    for ratio, side in ((0.999, 1), (1.001, -1)):
        found = poles(compose(dataclasses.replace(block, belt_speed=ratio * hopf)))
        assert np.all(np.sign(found.real) == side)
    found = poles(compose(dataclasses.replace(block, belt_speed=hopf)))
    np.testing.assert_allclose(sorted(found.imag), np.array([-1, 1]) * math.sqrt(block.stiffness / block.mass), rtol=1e-9)


@pytest.mark.parametrize("ratio", [1.02, 1.1, 1.3])
def test_beyond_the_hopf_speed_of_veraszto_and_stepan_rest_and_stick_slip_are_both_stable(ratio):
    block = oscillators.VERASZTO_STEPAN
    speed = ratio * oscillators.hopf_speed(block)
    plant = compose(dataclasses.replace(block, belt_speed=speed))
    rest = equilibrium(plant, mode={"belt": "slip-"})["block.position"]
    near = simulate(plant, 60.0, start={"block.position": rest + 1e-5})
    assert near.time_in("belt", "stick") == 0.0
    assert swing(near, "block.position", 58.0) < 0.9 * 2e-5
    carried = simulate(plant, 60.0, start={"block.speed": speed})  # the same plant, started in stick
    assert carried.time_in("belt", "stick", after=58.0) > 0.05
    assert carried.time_in("belt", "slip-", after=58.0) > 0.05


def test_at_more_than_twice_the_hopf_speed_the_block_of_veraszto_and_stepan_comes_to_rest_from_stick_too():
    plant = compose(dataclasses.replace(oscillators.VERASZTO_STEPAN, belt_speed=0.4))
    run = simulate(plant, 60.0, start={"block.speed": 0.4})
    assert run.time_in("belt", "stick", after=1.0) == 0.0
    assert swing(run, "block.position", 58.0) < 1e-9


def test_drag_on_the_belt_is_damping_to_ground_and_a_constant_pull():
    # d (v_belt - v) = d v_belt - d v: the same run, but for round-off
    dragged = simulate(compose(BlockOnBelt(drag=0.3)), 40.0, accuracy=1e-10)
    twin = simulate(compose(BlockOnBelt(damping=0.3)), 40.0, inputs={"block.force": 0.3 * 0.2}, accuracy=1e-10)
    times = np.linspace(0, 40, 200)
    np.testing.assert_allclose(dragged.at(times)["block.position"], twin.at(times)["block.position"], atol=1e-8)
    assert len(dragged.events) == len(twin.events) > 4


def test_thomsen_and_fidlins_three_ranges_of_belt_speed():
    block = oscillators.THOMSEN_FIDLIN
    high = oscillators.hopf_speed(block)
    low = math.sqrt(4 / 5) * high

    def late(speed):
        return simulate(compose(dataclasses.replace(block, belt_speed=speed)), 1500.0).time_in("belt", "stick", after=1400.0)

    assert late(0.95 * low) > 1.0
    assert late((low + high) / 2) == 0.0
    resting = simulate(compose(dataclasses.replace(block, belt_speed=1.1 * high)), 1500.0)
    assert swing(resting, "block.position", 1400.0) < 1e-3


def test_enough_damping_leaves_no_hopf_speed():
    assert oscillators.hopf_speed(dataclasses.replace(oscillators.VERASZTO_STEPAN, damping=40.0)) == 0.0
    assert oscillators.hopf_speed(dataclasses.replace(oscillators.THOMSEN_FIDLIN, damping=0.5)) == 0.0
    assert oscillators.hopf_speed(BlockOnBelt(friction=CubicStribeck(static=0.3, minimum=0.3))) == 0.0


# --- Den Hartog 1931: with stops


def stop_free_bound(r):
    """Largest F / P without stops: sqrt(V^2 / (U^2 + 1 / r^4)), where the block would not turn round at once."""
    v, u = 1 / (1 - r * r), math.sin(math.pi / r) / (r * (1 + math.cos(math.pi / r)))
    return abs(v) / math.sqrt(u * u + 1 / r**4)


@pytest.mark.parametrize("r", [0.7, 1.3, 2.0])
@pytest.mark.parametrize(("share", "stops"), [(0.97, False), (1.03, True)])
def test_den_hartogs_block_stops_once_per_half_cycle_beyond_the_bound_and_not_below(r, share, stops):
    bound = stop_free_bound(r)
    if bound * share > 0.99:
        pytest.skip("the block would not move")
    friction = share * bound
    plant = compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=friction, kinetic=friction)))
    period = 2 * math.pi / r
    run = simulate(plant, 200 * period, inputs={"block.force": sine(0.0, 1.0, r / (2 * math.pi))}, accuracy=1e-9)
    assert (run.time_in("belt", "stick", after=180 * period) > 0) is stops
    if stops:
        held = [piece for piece in measure.stick_intervals(run, "belt", 180 * period) if piece[0] > 180 * period]
        np.testing.assert_allclose(np.diff([begin for begin, _ in held]), period / 2, rtol=1e-5)


# --- two blocks


def test_two_equal_blocks_started_alike_move_as_one():
    plant = compose(BlocksOnBelt(mass=(1.0, 1.0), tie=(0.7,)))
    both, one = simulate(plant, 40.0, accuracy=1e-10), simulate(compose(BlockOnBelt()), 40.0, accuracy=1e-10)
    times = np.linspace(0, 40, 200)
    for i in (0, 1):
        np.testing.assert_allclose(both.at(times)["blocks.position"][:, i], one.at(times)["block.position"], atol=1e-7)
    assert [event.time for event in both.events if event.element == "belt.0"] == pytest.approx(
        [event.time for event in one.events], abs=1e-6
    )


def test_sliding_blocks_have_the_modes_of_the_chain():
    # equal masses, Coulomb friction: in phase sqrt(k / m), against each other sqrt((k + 2 q) / m)
    friction = Coulomb(static=0.5, kinetic=0.5)
    plant = compose(BlocksOnBelt(mass=(2.0, 2.0), stiffness=(8.0, 8.0), tie=(5.0,), friction=friction))
    found = poles(plant)
    np.testing.assert_allclose(sorted(found[found.imag > 0].imag), [2.0, 3.0], rtol=1e-9)


def test_a_force_holds_one_of_two_blocks_against_the_others_spring():
    # no friction: m_i x_i'' = u_i - k_i x_i - c_i v_i + q (x_j - x_i); at rest (k_1 + q) x_1 - q x_2 = u_1, (k_2 + q) x_2 - q x_1 = u_2
    blocks = BlocksOnBelt(stiffness=(2.0, 3.0), damping=(1.0, 1.0), tie=(0.5,), load=(0.0, 0.0))
    force = np.array([1.5, -0.7])
    run = simulate(compose(blocks), 100.0, inputs={f"blocks.force.{i}": u for i, u in enumerate(force)}, accuracy=1e-10)
    np.testing.assert_allclose(run["blocks.position"][-1], np.linalg.solve([[2.5, -0.5], [-0.5, 3.5]], force), rtol=1e-8)
    assert energy_audit(run).relative < 1e-8
    assert np.abs(simulate(compose(blocks), 100.0)["blocks.position"]).max() == 0.0  # without a force nothing moves


def test_unequal_blocks_stick_apart_and_together():
    run = simulate(compose(BlocksOnBelt()), 200.0)
    first, second = run.modes["belt.0"] == "stick", run.modes["belt.1"] == "stick"
    assert (first & second).any() and (first & ~second).any() and (~first & second).any()
    stuck = run["blocks.speed"][first & second]
    assert np.all(stuck == 0.2)


def test_a_held_neighbour_is_a_stiffer_spring():
    # block 1 is pressed so hard that it rides with the belt; on a belt at rest block 0 swings on k + q
    plant = compose(
        BlocksOnBelt(mass=(1.0, 1.0), stiffness=(3.0, 1.0), tie=(1.0,), load=(0.0, 100.0), belt_speed=0.0, friction=Coulomb(static=1.0, kinetic=1.0))
    )  # fmt: skip
    run = simulate(plant, 10.0, start={"blocks.position": (0.1, 0.0)}, accuracy=1e-10)
    times = np.linspace(0, 10, 100)
    np.testing.assert_allclose(run.at(times)["blocks.position"][:, 0], 0.1 * np.cos(2 * times), atol=1e-9)
    assert run.time_in("belt.1", "stick") == 10.0


# --- absorber

FALLING = Exponential(static=1.0, kinetic=0.5, decay=3.0)
DAMPED = BlockOnBelt(damping=0.05, friction=FALLING)


def worst_growth(block, absorber, negative):
    """Largest real part of the poles of block and absorber under a negative damping ratio `negative` of the block."""
    w = math.sqrt(block.stiffness / block.mass)
    mass, c, k = block.mass, -2 * negative * block.mass * w, block.stiffness
    a = absorber
    matrix = np.array(
        [
            [0, 1, 0, 0],
            [-(k + a.stiffness) / mass, -(c + a.damping) / mass, a.stiffness / mass, a.damping / mass],
            [0, 0, 0, 1],
            [a.stiffness / a.mass, a.damping / a.mass, -a.stiffness / a.mass, -a.damping / a.mass],
        ]
    )
    return np.linalg.eigvals(matrix).real.max()


@pytest.mark.parametrize("e", [0.01, 0.1, 0.5])
def test_the_tuned_absorber_bears_as_much_negative_damping_as_its_closed_form_says(e):
    block = Block(mass=2.0, stiffness=18.0)
    tuned = Absorber.tuned(block, e)
    limit = Absorber.max_negative_damping(e)
    assert worst_growth(block, tuned, 0.999 * limit) < 0 < worst_growth(block, tuned, 1.001 * limit)


def test_no_other_absorber_of_that_mass_bears_much_more():
    block, e = Block(), 0.1
    tuned, limit = Absorber.tuned(block, e), math.sqrt((1 + e) * (1 - 1 / math.sqrt(1 + e)) / 2)
    assert limit == pytest.approx((1 + e / 8) * Absorber.max_negative_damping(e), rel=0.1 * e**2)
    for stiffness in np.linspace(0.8, 1.2, 21):
        for damping in np.linspace(0.6, 1.6, 21):
            other = dataclasses.replace(tuned, stiffness=stiffness * tuned.stiffness, damping=damping * tuned.damping)
            assert worst_growth(block, other, 1.0001 * limit) > 0


def onset(negative):
    """Belt speed at which -N mu'(v) - c falls to a given negative damping coefficient."""
    return brentq(lambda v: 1.5 * math.exp(-3 * v) - 0.05 - negative, 0.0, 5.0)


def test_a_tuned_absorber_moves_the_onset_where_the_poles_say():
    # without absorber instability below -F'(v) = c, with it below -F'(v) - c = 2 m w_n bearable(e)
    e = 0.1
    for parts, speed in (((), onset(0.0)), ((Absorber.tuned(DAMPED, e),), onset(2 * Absorber.max_negative_damping(e)))):
        slower, faster = (poles(compose(dataclasses.replace(DAMPED, belt_speed=s * speed), *parts)).real.max() for s in (0.99, 1.01))
        assert faster < 0 < slower


@pytest.mark.parametrize("speed", [0.7, 0.9, 1.1])
def test_a_tuned_absorber_ends_the_stick_slip_that_its_twin_without_shows(speed):
    block = dataclasses.replace(DAMPED, belt_speed=speed)
    bare = simulate(compose(block), 600.0)
    calmed = simulate(compose(block, Absorber.tuned(block, 0.1)), 600.0)
    assert bare.time_in("belt", "stick", after=500.0) > 10.0
    assert calmed.time_in("belt", "stick", after=500.0) == 0.0
    assert swing(calmed, "block.position", 500.0) < 1e-3 * swing(bare, "block.position", 500.0)


def test_a_tuned_absorber_shrinks_the_range_of_stick_slip_and_does_not_abolish_it():
    block = dataclasses.replace(DAMPED, belt_speed=0.9 * onset(2 * Absorber.max_negative_damping(0.1)))
    run = simulate(compose(block, Absorber.tuned(block, 0.1)), 600.0)
    assert run.time_in("belt", "stick", after=500.0) > 10.0


def test_the_default_absorber_is_tuned_to_the_default_block():
    tuned, default = Absorber.tuned(BlockOnBelt(), 0.1), Absorber()
    assert (default.mass, default.stiffness, default.damping) == pytest.approx((tuned.mass, tuned.stiffness, tuned.damping), rel=1e-5)


# --- tangential dither


@pytest.mark.parametrize("ratio", [-0.9, -0.2, 0.0, 0.3, 0.999, 1.0, 1.5, -2.0])
def test_coulomb_friction_averaged_over_dither_is_an_arc_sine(ratio):
    law = Coulomb(static=0.9, kinetic=0.3)
    expected = 0.3 * 2 / math.pi * math.asin(min(1.0, max(-1.0, ratio)))
    assert averaged_friction(law, 0.7 * ratio, 0.7) == pytest.approx(expected, abs=1e-15)


def test_without_dither_friction_is_what_the_law_says():
    for speed in (0.4, -0.4):
        assert averaged_friction(Hyperbolic(), speed, 0.0) == pytest.approx(math.copysign(1 / 2.2, speed), rel=1e-14)


def test_averaged_friction_is_the_integral_over_a_period():
    # the midpoint rule of 2e6 points, an independent quadrature, is good to 1e-6 at the jump of the sign
    law, speed, amplitude = Exponential(static=0.8, kinetic=0.5, decay=4.0), 0.1, 0.5
    slip = speed + amplitude * np.sin(2 * math.pi * (np.arange(2_000_000) + 0.5) / 2_000_000)
    expected = np.mean(np.sign(slip) * (0.5 + 0.3 * np.exp(-4.0 * np.abs(slip))))
    assert averaged_friction(law, speed, amplitude) == pytest.approx(expected, abs=2e-6)


test_wrong_uses_are_refused_in_these_words = refusals(
    *[(lambda block=block: oscillators.hopf_speed(block), word) for block, word in [(BlockOnBelt(friction=Hyperbolic()), "friction"),
     (BlockOnBelt(friction=Coulomb()), "friction"), (BlockOnBelt(friction=Exponential(static=1.0, kinetic=0.5, decay=1.0)), "damping")]],
    (lambda: compose(BlocksOnBelt(tie=(1.0, 2.0))), r"blocks.tie.*must have 1"),
    (lambda: compose(BlocksOnBelt(mass=(1.0,), stiffness=(1.0,), damping=(0.0,), tie=(), load=(1.0,))), "at least 2"),
    *each_of(lambda bad: Absorber.tuned(DAMPED, bad), "mass_ratio", [0.0, -1.0, math.inf, math.nan]),
    *each_of(lambda bad: Absorber.max_negative_damping(bad), "mass_ratio", [0.0, -1.0, math.inf, math.nan]),
    (lambda: Absorber.tuned(Block(stiffness=0.0), 0.1), "stiffness"),
    *[(lambda speed=speed, amplitude=amplitude: averaged_friction(Coulomb(), speed, amplitude), word) for speed, amplitude,
     word in [(math.nan, 1.0, "speed"), (0.1, -1.0, "amplitude"), (0.1, math.inf, "amplitude")]],
)  # fmt: skip


@pytest.mark.parametrize(
    "law", [Coulomb(static=0.3, kinetic=0.3), Exponential(static=0.5, kinetic=0.3, decay=3.0)], ids=["Coulomb", "exponential"]
)
@pytest.mark.parametrize("ratio", [0.2, 0.5, 0.8])
def test_a_block_shaken_along_the_belt_feels_the_averaged_friction(law, ratio):
    # force m W B cos W t shakes the block with the velocity amplitude B; the spring carries the mean friction, to first order in 1 / W
    amplitude, w = 0.5, 60.0
    speed = ratio * amplitude
    block = BlockOnBelt(damping=0.5, belt_speed=speed, friction=law)
    run = simulate(compose(block), 120.0, inputs={"block.force": sine(0.0, w * amplitude, w / (2 * math.pi), math.pi / 2)})
    period = 2 * math.pi / w
    pulled = measure.extent(run, "block.position", 60.0, 60.0 + 500 * period).mean
    assert run.time_in("belt", "stick", after=60.0) == 0.0
    assert pulled == pytest.approx(averaged_friction(law, speed, amplitude), rel=0.02)
    assert pulled < 0.8 * float(law.sliding(speed))  # twin: what the belt would carry without dither


# --- the three cures of Popp and Rudolph

LEINE = compose(oscillators.LEINE)


def test_more_damping_ends_the_stick_slip_of_leines_block():
    # rest is stable for c > -F'(v_b) = 3 / (1 + 3 v_b)^2; from rest on the belt it takes somewhat more
    assert simulate(LEINE, 200.0).time_in("belt", "stick", after=100.0) > 50.0
    needed = 3 / 1.6**2
    assert poles(compose(BlockOnBelt(damping=0.99 * needed))).real.max() > 0 > poles(compose(BlockOnBelt(damping=1.01 * needed))).real.max()
    cured = simulate(compose(BlockOnBelt(damping=1.2 * needed)), 200.0)
    assert cured.time_in("belt", "stick", after=100.0) == 0.0


def test_external_excitation_ends_the_stick_slip_of_leines_block():
    # dither of velocity amplitude P / (m W) = 0.27 m/s turns the slip at 0.2 m/s round in every cycle
    free, shaken = simulate(LEINE, 200.0), simulate(LEINE, 200.0, inputs={"block.force": sine(0.0, 5.0, 3.0)})
    assert free.time_in("belt", "stick", after=100.0) > 50.0
    assert shaken.time_in("belt", "stick", after=100.0) == 0.0
    assert swing(shaken, "block.position", 100.0) < 0.05 * swing(free, "block.position", 100.0)


def test_a_fluctuating_load_calms_leines_block_in_a_band_and_excites_it_below():
    def late(ratio, depth=0.95):
        return swing(simulate(LEINE, 400.0, inputs={"block.load": sine(1.0, depth, ratio / (2 * math.pi))}), "block.position", 300.0)

    alone = late(3.0, 0.0)
    assert late(3.0) < 0.35 * alone  # inside the band around 2 to 5 natural frequencies
    assert late(0.5) > 1.5 * alone  # below
    assert late(40.0) > 0.8 * alone  # far above: only dither along the slip linearises


# --- towards chaos under an alternating load


def test_the_largest_exponent_of_a_damped_oscillator_is_half_its_damping():
    exponent, _ = lyapunov(compose(Block(mass=2.0, stiffness=8.0, damping=0.4)), {"block.force": sine(0.0, 1.0, 0.2)}, 5.0, 60, skip=2)
    assert exponent == pytest.approx(-0.4 / (2 * 2.0), rel=0.02)  # the ellipse that turns in the phase plane leaves a remainder of 1 / n


def test_an_alternating_load_drives_leines_block_into_chaos_and_a_weak_one_does_not():
    def exponent(depth, ratio):
        return lyapunov(LEINE, {"block.load": sine(1.0, depth, ratio / (2 * math.pi))}, 2 * math.pi / ratio, 150)

    calm, orbit = exponent(0.3, 0.8)
    assert calm < -0.3 and np.ptp(orbit[100:, 0]) < 1e-6  # entrained: the same state after every period
    wild, scattered = exponent(0.8, 2.2)
    assert wild > 0.05 and np.ptp(scattered[100:, 0]) > 0.1
