"""Estimates that another number stops are results, and are said to be such."""

import numpy as np
import pytest

from models import BlockOnBelt, Coulomb, Exponential
from toolbox import compose, fit

SLIP = np.linspace(-1.0, 1.0, 400)
SLIP = SLIP[np.abs(SLIP) > 0.02]
SIDE = np.sign(SLIP)
NOISE = 0.1 * np.random.default_rng(1).standard_normal(SLIP.size)


def data(force):
    return {"time": 0.01 * np.arange(SLIP.size), "block.speed": SLIP, "belt.force": -force * SIDE + NOISE}


def belt(law):
    return compose(BlockOnBelt(belt_speed=0.0, friction=law))


def test_kinetic_friction_that_the_static_one_stops_is_told_by_name_and_reason():
    found = fit(belt(Coulomb(static=2.0, kinetic=1.0)), data(3.0), "belt.friction.kinetic", contact="belt")
    assert found["belt.friction.kinetic"] == pytest.approx(2.0, rel=1e-9)
    assert found.at_bounds == ("belt.friction.kinetic",)
    assert "must be <= the static coefficient 2" in found.fixed_by["belt.friction.kinetic"]
    assert "`belt.friction.kinetic` rests on another number" in str(found)


def test_one_that_nothing_stops_rests_on_nothing():
    found = fit(belt(Coulomb(static=4.0, kinetic=1.0)), data(3.0), "belt.friction.kinetic", contact="belt")
    assert found["belt.friction.kinetic"] == pytest.approx(-np.mean(data(3.0)["belt.force"] * SIDE), rel=1e-8)
    assert found.at_bounds == () and not found.fixed_by and not found.unidentifiable


def test_an_optimum_at_static_equal_to_kinetic_is_that_of_one_number():
    rising = data(2.0 + np.abs(SLIP))  # force that grows with speed, which no law with static >= kinetic can
    law = Exponential(static=2.0, kinetic=1.0, decay=1.0)
    found = fit(belt(law), rising, ["belt.friction.kinetic", "belt.friction.static"], contact="belt")
    mean = -np.mean(rising["belt.force"] * SIDE)
    assert found["belt.friction.kinetic"] == pytest.approx(mean, rel=1e-6)
    assert found["belt.friction.static"] == pytest.approx(mean, rel=1e-6)
    assert set(found.at_bounds) == {"belt.friction.kinetic", "belt.friction.static"}
    assert found.correlation[0, 1] == pytest.approx(1.0)


def test_a_number_without_influence_where_others_rest_has_no_estimate():
    rising = data(2.0 + np.abs(SLIP))
    free = ["belt.friction.kinetic", "belt.friction.static", "belt.friction.decay"]
    found = fit(belt(Exponential(static=2.0, kinetic=1.0, decay=1.0)), rising, free, contact="belt")
    assert "belt.friction.decay" in found.unidentifiable and np.isinf(found.interval("belt.friction.decay")).all()
    assert "`belt.friction.decay` has no influence at these estimates, and so no estimate" in str(found)
    assert found.at_bounds and np.isfinite(found.interval("belt.friction.static")).all()
