"""Maps against theory: the criteria decide as their closed forms say, a little to both sides of the border."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from models.oscillators import LEINE
from studies.questions import maps
from studies.questions.disks import critical_drop
from toolbox.onsets.borders import border


def test_a_driven_stator_is_caught_again_above_the_critical_drop():
    ratios = np.array([0.05, 0.2, 0.35])
    for factor, expected in ((0.995, False), (1.005, True)):
        points = np.array([(zeta, factor * critical_drop(zeta)) for zeta in ratios])
        assert (maps.caught(points) == expected).all()


def test_dither_ends_stick_slip_where_its_velocity_passes_that_of_the_belt_and_not_before():
    v = LEINE.belt_speed
    rows = [{"dither.frequency": 40.0, "dither.amplitude": factor * LEINE.mass * 40.0 * v} for factor in (0.0, 0.5, 0.97, 1.03, 2.0)]
    swing = maps.slow_swing(maps.dithered(rows))
    assert swing[0] > 0.8  # without dither it sticks and slips
    assert swing[1] > 0.4 and swing[2] > 0.05
    assert (swing[3:] < 1e-3).all()
    assert maps.averaged_slope(0.99 * v, v) < 0 < maps.averaged_slope(1.01 * v, v)


def test_the_averaged_slope_of_friction_is_the_derivative_of_its_average():
    law, v, a, h = LEINE.friction, LEINE.belt_speed, 0.3, 1e-4

    def average(speed):
        turns = -np.arcsin(speed / a)  # where the slip turns

        def friction(angle):
            slip = speed + a * np.sin(angle)
            return np.sign(slip) * law.static / (1 + law.decay * abs(slip))

        return sum(quad(friction, *ends, epsabs=1e-12)[0] for ends in ((-np.pi / 2, turns), (turns, np.pi / 2))) / np.pi

    assert maps.averaged_slope(a, v) == pytest.approx((average(v + h) - average(v - h)) / (2 * h), rel=1e-5)


def test_the_collar_meets_the_wall_and_rolls_on_where_its_closed_forms_say():
    load = 100e3
    contact, rolls = maps.COLLAR.contact_speed(load), maps.COLLAR.rolling_speed(load)
    speeds = np.array([(0.99 * contact, load), (1.01 * contact, load)])
    assert (maps.touching(speeds, maps.synchronous) > 0).tolist() == [False, True]
    speeds = np.array([(0.93 * rolls, load), (1.01 * rolls, load), (0.9 * contact, load)])
    assert (maps.touching(speeds, maps.rolling) > 0.99).tolist() == [False, True, True]
    assert maps.touching(speeds[2:], maps.synchronous)[0] == 0.0  # the same speed: what was last disturbed into lasts


def test_the_border_of_first_contact_is_a_line_in_the_plane():
    grid = np.array([18.0, 20.0, 22.0]), np.array([50e3, 150e3])
    _, segments = border(grid, lambda points: maps.touching(points, maps.synchronous) > 0.0, 5)
    across = [(speed, load) for speed, load in segments.reshape(-1, 2) if load in grid[1]]
    assert len(across) == 2
    for speed, load in across:
        assert speed == pytest.approx(maps.COLLAR.contact_speed(load), abs=2.0 / 2**5)


def test_sampling_the_drive_at_100_hz_moves_neither_border_of_the_string():
    continuous, sampled = (maps.string_map((4, 3), each, halvings=8) for each in (False, True))
    np.testing.assert_array_equal(continuous.smooth.verdict, sampled.smooth.verdict)
    np.testing.assert_array_equal(continuous.sticking.verdict, sampled.sticking.verdict)
    assert continuous.regions["bistable"].any() and continuous.regions["free"].any()
    for name in ("smooth", "sticking"):
        np.testing.assert_allclose(sampled.borders[name], continuous.borders[name], rtol=0.02)
