"""The hand-arm chain against closed forms, the weighting against the table of the standard, exposure against its definition."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models import BlockOnBelt, Exponential, HandArm
from models.hand_arm import daily_exposure, weighted_acceleration, weighting
from tests.refusals import each_of, refusals
from toolbox import SceneError, compose, energy_audit, linearise, simulate
from toolbox.inputs import sine

# a hand whose stick-slip has some 20 Hz, see studies/scenes/hand_held_block.toml
GRIP = HandArm(mass=(0.7, 2.0), stiffness=(20e3, 20e3, 5e3), damping=(20.0, 100.0, 200.0), attached_to="block")


def block(belt_speed):
    friction = Exponential(static=0.6, kinetic=0.35, decay=20.0)
    return BlockOnBelt(mass=0.4, stiffness=0.0, belt_speed=belt_speed, load=60.0, friction=friction)


@pytest.mark.parametrize("arm", [HandArm(), HandArm(mass=(1.3,), stiffness=(2e4, 800.0), damping=(40.0, 9.0))])
def test_the_impedance_of_the_equations_is_the_ladder_of_springs_dampers_and_masses(arm):
    system = linearise(compose(arm), inputs="handle.speed", outputs="hand.force")
    frequencies = np.array([0.5, 4.0, 16.0, 63.0, 500.0])
    expected = arm.impedance(frequencies)
    np.testing.assert_allclose([complex(system(2j * math.pi * f).item()) for f in frequencies], expected, rtol=1e-10)


def test_the_impedance_of_one_mass_is_the_textbook_fraction_with_its_limits():
    m, k, c = 1.3, (2e4, 800.0), (40.0, 9.0)
    arm = HandArm(mass=(m,), stiffness=k, damping=c)
    s = 2j * math.pi * 10.0
    first, ground = c[0] + k[0] / s, c[1] + k[1] / s
    assert arm.impedance(10.0) == pytest.approx(first * (s * m + ground) / (first + s * m + ground), rel=1e-13)
    # slow: springs in series; fast: the first damper alone
    assert arm.impedance(1e-6) * (2j * math.pi * 1e-6) == pytest.approx(1 / (1 / k[0] + 1 / k[1]), rel=1e-5)
    assert arm.impedance(1e7) == pytest.approx(c[0], rel=1e-5)


def test_a_shaken_handle_feels_the_impedance_and_the_hand_takes_the_power_of_its_real_part():
    arm, frequency, amplitude = HandArm(), 20.0, 0.1
    # a cosine of speed is a sine of position, which does not lean on the arm
    run = simulate(compose(arm), 6.0, inputs={"handle.speed": sine(0.0, amplitude, frequency, math.pi / 2)}, accuracy=1e-9)
    t = np.linspace(5.0, 6.0, 400, endpoint=False)
    z = arm.impedance(frequency)
    expected = np.real(amplitude * z * np.exp(2j * math.pi * frequency * t))
    np.testing.assert_allclose(run.at(t)["hand.force"], expected, atol=1e-6 * abs(z))
    assert np.array_equal(run["handle.force"], -run["hand.force"])
    power = np.mean(run.at(t)["hand.force"] * amplitude * np.cos(2 * math.pi * frequency * t))
    assert power == pytest.approx(amplitude**2 / 2 * z.real, rel=1e-6)
    assert energy_audit(run).relative < 1e-10


def test_the_weighting_has_the_values_that_the_standard_tables_at_third_octaves():
    # ISO 5349-1, table A.2, W_h at nominal 6.3 ... 1250 Hz; the exact frequencies are 10^(n / 10)
    table = {
        8: 0.727,
        9: 0.873,
        10: 0.951,
        11: 0.958,
        12: 0.896,
        13: 0.782,
        14: 0.647,
        15: 0.519,
        18: 0.256,
        21: 0.127,
        24: 0.0634,
        27: 0.0314,
        30: 0.0135,
    }
    for n, value in table.items():
        assert float(weighting(10 ** (n / 10))) == pytest.approx(value, abs=0.5 * 10 ** (math.floor(math.log10(value)) - 2) * 1.01)


def test_above_the_transition_the_weighting_follows_velocity():
    # W_h f -> 15.915 Hz Q2-independent, inside the band
    assert float(weighting(200.0)) * 200.0 == pytest.approx(100 / (2 * math.pi), rel=0.01)


@pytest.mark.parametrize("frequency", [12.3, 40.0, 171.7])
def test_a_shaking_handle_has_the_weighted_acceleration_of_its_sine(frequency):
    t = np.arange(20_000) * 2e-4  # 4 s, not a whole number of periods
    speed = 0.3 + 0.02 * np.sin(2 * math.pi * frequency * t)
    rms = 0.02 * 2 * math.pi * frequency / math.sqrt(2)
    assert weighted_acceleration(speed, 2e-4) == pytest.approx(float(weighting(frequency)) * rms, rel=1e-3)


def test_exposure_is_energy_equivalent_to_eight_hours():
    assert daily_exposure([3.0, 4.0, 12.0], 28_800.0) == pytest.approx(13.0, rel=1e-15)
    assert daily_exposure([5.0], 7200.0) == pytest.approx(2.5, rel=1e-15)
    assert daily_exposure([5.0], 0.0) == 0.0


def test_a_block_that_sticks_and_slips_shakes_the_hand_that_holds_it_and_a_faster_belt_does_not():
    t = 4.0 + np.arange(20_000) * 1e-4
    rubbing, sliding = (simulate(compose(block(speed), GRIP), 6.0, accuracy=1e-8) for speed in (0.05, 0.1))
    assert rubbing.time_in("belt", "stick", after=4.0) > 0.5
    assert sliding.time_in("belt", "stick", after=4.0) == 0.0
    # above 5 m/s2 for an hour, the daily exposure is beyond what most rules let pass unnoticed
    shaken = weighted_acceleration(rubbing.at(t)["block.speed"], 1e-4)
    assert shaken > 5.0 and weighted_acceleration(sliding.at(t)["block.speed"], 1e-4) < 1e-4
    for run in (rubbing, sliding):
        assert energy_audit(run).relative < 1e-8
    # a stricter run gives the same dose
    again = simulate(compose(block(0.05), GRIP), 6.0, accuracy=1e-11)
    assert weighted_acceleration(again.at(t)["block.speed"], 1e-4) == pytest.approx(shaken, rel=1e-3)


@pytest.mark.parametrize(
    ("change", "word"),
    [({"mass": ()}, "mass"), ({"stiffness": (1.0, 1.0)}, "stiffness"), ({"holds": "hand"}, "holds"), ({"holds": "two words"}, "holds")],
)
def test_a_hand_that_cannot_be_built_is_refused_by_name(change, word):
    with pytest.raises(SceneError, match=word):
        compose(HandArm(**change))


test_wrong_uses_are_refused_in_these_words = refusals(
    *each_of(lambda call: call(), "frequency", (lambda: weighting(0.0), lambda: weighting(math.nan), lambda: HandArm().impedance(-1.0))),
    (lambda: weighted_acceleration([0.0, 1.0], 1e-3), "speed"),
    (lambda: weighted_acceleration(np.zeros(100), 0.0), "sample_time"),
    *each_of(lambda wrong: daily_exposure(wrong, 1.0), "accelerations", ([], [1.0] * 4, [-1.0], [math.nan])),
    (lambda: daily_exposure([1.0], -1.0), "duration"),
)  # fmt: skip
