"""Dither of a load and along the slip: closed forms, the band of Leine's block, and one number for each claim of the study; every cure has its open twin."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from controllers import HeldSpeed, NormalDither, PhasedDither, SquareDither, SweptDither, dither_map
from controllers.dither import DitherMap
from models import (
    Absorber,
    Block,
    BlockOnBelt,
    Coulomb,
    DiscBrake,
    Exponential,
    StepFriction,
    averaged_friction,
    oscillators,
    tangential_dither,
)
from studies.questions.dither import BRAKE, LEINE, STRING, cures, falling, judged
from tests.plants import RIG
from tests.refusals import refusals
from toolbox import Sampled, Scene, SceneError, closed_loop, compose, energy_audit, equilibrium, linearise, measure, simulate
from toolbox.inputs import sine, square

NATURAL = 1.0 / (2.0 * math.pi)
BLOCK = compose(oscillators.LEINE)


def swing(run, signal="block.position", after=300.0):
    found = measure.extent(run, signal, after)
    return found.maximum - found.minimum


# --- the laws are what their formulas say


def test_a_dithered_load_is_its_formula():
    times = np.linspace(0.0, 50.0, 400)
    run = simulate(BLOCK, 50.0, controller=NormalDither(load="block.load", depth=0.7, frequency=0.3))
    np.testing.assert_allclose(run.at(times)["block.load"], 1.0 + 0.7 * np.sin(2 * np.pi * 0.3 * times), atol=1e-12)
    as_input = simulate(BLOCK, 50.0, inputs={"block.load": sine(1.0, 0.7, 0.3)})
    np.testing.assert_allclose(run.at(times)["block.position"], as_input.at(times)["block.position"], atol=1e-5)


def test_a_swept_dither_has_the_frequency_of_its_formula():
    law = SweptDither(load="block.load", depth=1.0, frequency=1.0, frequency_deviation=0.5, sweep_time=20.0)
    run = simulate(BLOCK, 20.0, controller=law)
    times = np.linspace(0.0, 20.0, 200_001)
    wave = run.at(times)["block.load"] - 1.0
    rises = times[1:][(wave[:-1] < 0) & (wave[1:] >= 0)]
    turns = rises + 0.5 * 20.0 / (2 * np.pi) * (1 - np.cos(2 * np.pi * rises / 20.0))  # int 1 + 0.5 sin(2 pi t / 20) dt
    np.testing.assert_allclose(turns, np.round(turns), atol=2e-4)
    assert np.diff(turns).min() > 0.9 and rises.size == 19
    with pytest.raises(SceneError, match="frequency_deviation"):
        dataclasses.replace(law, frequency_deviation=2.0).check()


def test_a_sampled_square_dither_is_the_square_wave():
    law = SquareDither(load="block.load", depth=0.5, frequency=0.5)
    run = simulate(BLOCK, 20.0, controller=law, sample_time=0.01)
    middles = np.arange(0.005, 20.0, 0.01)
    expected = np.where(np.floor(middles / 1.0).astype(int) % 2 == 0, 1.5, 0.5)
    assert np.mean(run.at(middles)["block.load"] != expected) < 0.02  # the sample on which the sine is zero may fall to either side
    with pytest.raises(SceneError, match="jumps"):
        simulate(BLOCK, 1.0, controller=law)
    other = simulate(BLOCK, 20.0, inputs={"block.load": square(1.0, 0.5, 0.5, 20.0)})
    assert other.at(0.5)["block.load"] == run.at(0.5)["block.load"] == 1.5


def test_a_dither_that_rides_on_a_force_is_a_part_of_it():
    brake = compose(DiscBrake(lag=0.05))
    law = NormalDither(load="brake.disturbance", over="brake.normal_force", depth=0.4, frequency=80.0)
    run = simulate(brake, 0.4, start={"disc.speed": 5.0}, inputs={"brake.force": 800.0}, controller=law)
    times = np.linspace(0.0, 0.4, 300)
    expected = 0.4 * 800.0 * -np.expm1(-times / 0.05) * np.sin(2 * np.pi * 80.0 * times)
    np.testing.assert_allclose(run.at(times)["brake.disturbance"], expected, atol=1e-2)


def test_dither_puts_no_energy_where_the_audit_does_not_see_it():
    run = simulate(BLOCK, 60.0, controller=NormalDither(load="block.load", depth=0.9, frequency=0.5), accuracy=1e-9)
    assert energy_audit(run).relative < 1e-8


# --- phased with the slip


def test_a_load_phased_with_the_slip_turns_the_slope_of_friction_round_at_the_closed_form():
    # d(mu N)/dv = N_0 (mu' + mu depth / size): Leine's mu = 1 / (1 + 3 v), mu' = -3 mu^2, at v = 0.2
    mu = 1 / 1.6
    border = 3 * mu * 0.2  # depth at size 0.2
    for ratio, side in ((0.99, 1), (1.01, -1)):
        law = PhasedDither(load="block.load", mean=1.0, depth=ratio * border / 2, speed="block.speed", unit="m/s", speed_scale=-0.1)
        run = simulate(BLOCK, 60.0, start={"block.position": mu + 1e-4}, controller=law, accuracy=1e-10)
        growth = swing(run, after=50.0) / swing(
            simulate(BLOCK, 10.0, start={"block.position": mu + 1e-4}, controller=law, accuracy=1e-10), after=0.0
        )
        assert np.sign(math.log(growth)) == side
        # the slope left over is a damping: 2 pi / w_n per period
        expected = 3 * mu**2 * (1 - ratio) / 2 * 50.0
        assert math.log(growth) == pytest.approx(expected, rel=0.35, abs=0.02)


@pytest.mark.parametrize("ratio", [0.0, 0.98, 1.0, 1.02, 2.0])
def test_a_load_phased_with_the_slip_adds_the_damping_that_the_closed_form_says(ratio):
    # m s^2 + N_0 (mu' + mu depth / size) s + k = 0
    law = Exponential(static=0.5, kinetic=0.3, decay=4.0)
    mu, fall = 0.3 + 0.2 * math.exp(-0.8), 0.8 * math.exp(-0.8)
    plant = compose(BlockOnBelt(friction=law, load=10.0, mass=2.0, stiffness=100.0, belt_speed=0.2))
    phased = PhasedDither(load="block.load", speed="belt.slip", reference=-0.2, speed_scale=-0.5, depth=ratio * 0.5 * fall / mu)
    poles = np.linalg.eigvals(linearise(closed_loop(plant, phased), equilibrium(closed_loop(plant, phased))).A)
    np.testing.assert_allclose(poles.real, 10.0 * fall * (1.0 - ratio) / (2 * 2.0), atol=1e-12)


def test_a_load_phased_with_the_slip_ends_stick_slip_and_phased_against_it_does_not():
    with_slip = PhasedDither(load="block.load", depth=0.5, speed="block.speed", speed_scale=-0.2)
    assert simulate(BLOCK, 400.0).time_in("belt", "stick", after=300.0) > 50.0
    run = simulate(BLOCK, 400.0, controller=with_slip)
    assert run.time_in("belt", "stick", after=300.0) == 0.0 and swing(run) < 1e-6
    against = simulate(BLOCK, 400.0, controller=dataclasses.replace(with_slip, speed_scale=0.2))
    assert swing(against) > 1.0


def test_a_phased_load_that_comes_late_loses_its_hold_where_the_cosine_says():
    # N_0 (mu' + mu cos(w tau) depth / size) > 0 for cos(w tau) > 3 mu 0.2 / 0.5 = 0.75, tau < 0.115 periods (a little less: the phase stiffens the block)
    law = PhasedDither(load="block.load", mean=1.0, depth=0.5, speed="block.speed", unit="m/s", speed_scale=-0.2)
    for periods, calm in ((0.05, True), (0.13, False)):
        late = Sampled(law, 0.01, delay=periods / NATURAL)
        stuck = simulate(BLOCK, 500.0, controller=late).time_in("belt", "stick", after=400.0)
        assert (stuck == 0.0) == calm


# --- along the slip


def test_the_smallest_tangential_dither_is_where_the_averaged_friction_stops_to_fall():
    for friction, drag in ((Exponential(static=1.0, kinetic=0.5, decay=3.0), 0.0), (Exponential(static=1.0, kinetic=0.5, decay=3.0), 0.2)):
        plant = compose(BlockOnBelt(friction=friction))
        found = tangential_dither(plant, "belt", 0.3, 5.0, drag=drag)

        def slope(amplitude, friction=friction, drag=drag):
            below, above = (averaged_friction(friction, 0.3 + width, amplitude) for width in (-3e-7, 3e-7))
            return (above - below) / 6e-7 + drag

        assert slope(found.amplitude) >= 0.0 > slope(0.998 * found.amplitude)
        assert found.amplitude >= 0.3 * (1 - 1e-12)  # before the slip turns round friction falls in the mean, too
        assert found.force == pytest.approx(2 * math.pi * 5.0 * found.amplitude, rel=1e-12)  # of a mass of 1 kg
    # enough drag, and friction that does not fall: none is needed
    assert tangential_dither(plant, "belt", 0.3, 5.0, drag=2.0).amplitude == 0.0
    assert tangential_dither(compose(BlockOnBelt(friction=Coulomb(static=0.5, kinetic=0.3))), "belt", 0.3, 5.0).amplitude == 0.0


def test_the_force_of_a_tangential_dither_moves_what_the_contact_moves():
    found = tangential_dither(RIG, "bit", 2.0, 10.0)
    assert found.amplitude > 0.0
    assert found.force == pytest.approx(374.0 * 2 * math.pi * 10.0 * found.amplitude, rel=1e-9)


def test_the_designed_tangential_dither_ends_the_stick_slip_of_leines_block_and_half_of_it_does_not():
    found = tangential_dither(BLOCK, "belt", 0.2, 3.0)
    assert found.amplitude == pytest.approx(0.2, rel=2e-3)  # the slip must turn round
    alone = swing(simulate(BLOCK, 400.0))
    shaken = simulate(BLOCK, 400.0, inputs={"block.force": sine(0.0, 1.2 * found.force, 3.0)})
    assert shaken.time_in("belt", "stick", after=300.0) == 0.0 and swing(shaken) < 0.02 * alone
    weak = simulate(BLOCK, 400.0, inputs={"block.force": sine(0.0, 0.5 * found.force, 3.0)})
    assert swing(weak) > 0.3 * alone


# --- the map, and what the study claims of each rig


@pytest.fixture(scope="module")
def leine():
    return dither_map(
        BLOCK,
        "block.load",
        1.0,
        NATURAL,
        contact="belt",
        signal="block.position",
        ratios=(0.3, 0.5, 0.8, 2.5, 3.5, 4.5, 12.0, 40.0),
        depths=(0.3, 0.95),
    )


def test_leines_block_has_a_band_of_suppression_amplification_below_and_fading_above(leine):
    low, high = leine.band(0.95)
    assert 2.0 < low / NATURAL < high / NATURAL < 5.0
    assert leine.swing[1, :2].min() > 1.2  # below the band
    assert leine.swing[1, 3:6].max() < 0.45
    assert leine.swing[1, 6] > 0.6 and leine.swing[1, 7] > 0.85  # above it
    assert np.isnan(leine.band(0.3)).all()  # too little


def test_the_choice_of_a_map_is_the_least_depth_with_a_wide_band():
    frequency, depth = np.array([1.0, 2.0, 4.0, 8.0]), np.array([0.2, 0.5, 0.8])
    values = np.array([[1.2, 1.0, 0.4, 1.0], [1.5, 0.3, 0.2, 0.9], [2.0, 0.1, 0.1, 0.3]])
    found = DitherMap(1.0, frequency, depth, values, 0 * values)
    assert found.band(0.8) == (2.0, 8.0) and found.band(0.2) == (4.0, 4.0)
    assert found.choice() == (math.sqrt(8.0), 0.5)
    with pytest.raises(SceneError, match="No dither"):
        found.choice(below=0.01)


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda: tangential_dither(BLOCK, "bit", 0.2, 3.0), "There is no element `bit`"),
    *[(lambda slip=slip, frequency=frequency: tangential_dither(BLOCK, "belt", slip, frequency), word) for slip, frequency,
     word in ((0.0, 3.0, "slip"), (0.2, math.nan, "frequency"))],
    (lambda: tangential_dither(compose(BlockOnBelt(friction=StepFriction())), "belt", 0.2, 3.0), "without breaks"),
    (lambda: dither_map(BLOCK, "block.load", 1.0, 0.0, contact="belt", signal="block.position", ratios=(3.0,), depths=(0.5,)), "natural"),
    (lambda: dither_map(compose(BlockOnBelt(belt_speed=0.0)), "block.load", 1.0, NATURAL, contact="belt", signal="block.position", ratios=(3.0,),
     depths=(0.5,)), "stands without dither.*start="),
)  # fmt: skip


def test_a_dither_that_stops_the_contact_is_never_recommended_and_the_map_prints_so():
    frequency, depth = np.array([1.0, 2.0, 4.0]), np.array([0.5])
    swing, stuck = np.array([[0.0, 0.4, 1.5]]), np.array([[1.0, 0.2, 0.3]])
    found = DitherMap(1.0, frequency, depth, swing, stuck)
    assert found.stands.tolist() == [[True, False, False]] and found.choice() == (2.0, 0.5)
    assert "0.00*" in str(found) and "Choice: 2 Hz at depth 0.5" in str(found)
    standing = DitherMap(1.0, frequency, depth, swing, np.ones((1, 3)))
    assert math.isnan(standing.band(0.5)[0])
    with pytest.raises(SceneError, match="stands at 3 of 3 points: hold its speed"):
        standing.choice()
    assert "HeldSpeed" in str(standing)


def test_a_brake_that_comes_to_stand_has_no_map_and_with_its_speed_held_it_has_one():
    common = {"contact": "pad", "signal": "pad.position", "ratios": (1.4,), "depths": (0.8,), "start": {"disc.speed": 0.5}}
    brake = compose(DiscBrake())
    with pytest.raises(SceneError, match="`pad` stands without dither.*HeldSpeed"):  # 84 N m and more brake it, 90 N m drive it
        dither_map(brake, "brake.force", 1000.0, 50.3, inputs={"disc.torque": 90.0}, periods=200.0, **common)
    held = dither_map(brake, "brake.force", 1000.0, 50.3, controller=HeldSpeed(reference=1.0), **common)
    assert not held.stands.any() and held.swing[0, 0] > 0.5


def row(rig, cure, **changed):
    """A line of the study, at a frequency in the band that needs no map."""
    run = simulate(rig.plant, 160.0 / rig.natural, **rig.run)
    found = measure.extent(run, rig.position, run.end / 2)
    return judged(rig, cure, alone=found.maximum - found.minimum, **changed)


def test_on_the_brake_normal_dither_below_the_band_harms_and_in_it_leaves_a_third():
    def sine_of(ratio):
        return NormalDither(load=BRAKE.load, over=BRAKE.over, depth=0.9, frequency=ratio * BRAKE.natural)

    assert row(BRAKE, "none").stuck > 0.1
    assert row(BRAKE, "below", law=sine_of(0.6)).swing > 1.8
    calmed = row(BRAKE, "in", law=sine_of(2.3))
    assert calmed.swing < 0.5 and calmed.stuck > 0.0  # entrained, not calm


def test_on_the_brake_a_phased_load_and_a_small_absorber_end_the_groan():
    found = row(
        BRAKE,
        "phased",
        law=PhasedDither(load=BRAKE.load, over=BRAKE.over, depth=0.5, speed=BRAKE.speed, unit="m/s", speed_scale=-BRAKE.slip),
    )
    assert found.stuck == 0.0 and found.swing < 1e-3 and found.load < 1e-3
    absorber = dataclasses.replace(Absorber.tuned(Block(mass=10.0, stiffness=1e6), 0.02), attached_to="pad")
    assert falling(BRAKE) - 200.0 < 2 * math.sqrt(1e7) * Absorber.max_negative_damping(0.02)  # it bears what the caliper does not
    assert row(BRAKE, "absorber", parts=(BRAKE.parts[0], absorber)).stuck == 0.0
    with_less = dataclasses.replace(Absorber.tuned(Block(mass=10.0, stiffness=1e6), 0.002), attached_to="pad")
    assert row(BRAKE, "absorber", parts=(BRAKE.parts[0], with_less)).stuck > 0.05


def test_an_absorber_on_the_pad_keeps_the_energy_audit():
    brake = compose(DiscBrake(), dataclasses.replace(Absorber.tuned(Block(mass=10.0, stiffness=1e6), 0.02), attached_to="pad"))
    audit = energy_audit(simulate(brake, 1.0, start={"disc.speed": 2.0}, accuracy=1e-9))
    assert audit.relative < 1e-8


def test_on_the_string_dither_shakes_the_bit_into_smooth_drilling_which_then_needs_no_dither():
    assert row(STRING, "none").stuck > 0.25
    law = NormalDither(load="bit.weight", depth=0.6, frequency=11.0 * STRING.natural)
    run = simulate(STRING.plant, 160.0 / STRING.natural, controller=law, **STRING.run)
    assert run.time_in("bit", "stick", after=run.end / 2) == 0.0
    alone = simulate(STRING.plant, 300.0, start={name: run.at(run.end)[name] for name in STRING.plant.states}, **STRING.run)
    assert alone.time_in("bit", "stick") == 0.0 and swing(alone, "bit.speed", 250.0) < 0.01
    below = row(STRING, "below", law=dataclasses.replace(law, frequency=0.8 * STRING.natural))
    assert below.swing > 1.5 and below.stuck > 0.3


def test_on_the_string_no_weight_dither_helps_where_smooth_drilling_is_unstable():
    # 6 rad/s: falling friction takes more than the string damps
    torque = 475.0 * 3.0 + 0.155575 * 97_347.0 * (0.5 + 0.3 * math.exp(-2.7))
    rest = equilibrium(closed_loop(STRING.plant, inputs={"top.torque": torque}), guess={"chain.speed": [3.0, 3.0], "chain.twist": [15.0]})
    assert linearise(STRING.plant, rest).poles().real.max() > 0.0
    law = NormalDither(load="bit.weight", depth=0.6, frequency=11.0 * STRING.natural)
    run = simulate(STRING.plant, 160.0 / STRING.natural, controller=law, inputs={"top.torque": torque})
    assert run.time_in("bit", "stick", after=run.end / 2) > 20.0


def shipped(root, name):
    return Scene.load(root / "studies" / "scenes" / f"{name}.toml")


def test_the_scene_of_weight_dither_says_what_the_study_says(root):
    scene = shipped(root, "weight_dither")
    stuck = {label: scene.run(label).time_in("bit", "stick", after=scene.after) for label in scene.labels}
    assert stuck["steady weight"] > 50.0 and stuck["sine, 0.8 x natural"] > 50.0
    assert stuck["sine, 11 x natural"] == stuck["phased with the bit speed"] == 0.0


def test_the_cures_of_leines_block_beside_each_other(monkeypatch):
    monkeypatch.setattr("studies.questions.dither.best", lambda label: (3.3 * NATURAL, 0.9))
    found = {
        cure: row(LEINE, cure, **how)
        for cure, how in cures(LEINE).items()
        if cure in ("none", "square in the band", "damping", "absorber", "tangential")
    }
    assert found["none"].swing == pytest.approx(1.0)
    assert found["square in the band"].swing < 0.2 < 0.8 < found["absorber"].swing  # a tenth of the mass bears 0.32 N s/m of 1.17
    assert found["damping"].swing < 1e-6 and found["damping"].stuck == 0.0
    assert found["tangential"].swing < 0.05 and found["tangential"].power > 0.0
    assert found["damping"].wear == pytest.approx(1.0, rel=1e-6)
