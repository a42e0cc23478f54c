"""The smallest error that breaks a loop against the border of Routh and Hurwitz, against margins, and against runs on their own."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from controllers import PI, SoftTorque
from models import BitRock, BlockOnBelt, Exponential, wells
from toolbox import Sampled, SceneError, closed_loop, compose, equilibrium, margins, simulate
from toolbox.halving import halved
from toolbox.robustness import smallest_error
from toolbox.robustness.joint_errors import PRECISION
from toolbox.steady_states.steady_loop import smooth_start

SPEED = 5.0


@pytest.fixture(scope="module")
def rig():
    return compose(wells.JANSEN_2, BitRock(weight=97_347.0))


@pytest.fixture(scope="module")
def loop(rig):
    return closed_loop(rig, PI(4_000.0, 1_500.0, reference=SPEED))


def routh(loop, changed):
    """Whether a string of two inertias under PI is stable by the criterion of Routh, with factors of its numbers, written from the equations alone.

    J_0 w_0' = u - k phi - d (w_0 - w_1) - c_0 w_0,   J_1 w_1' = k phi + d (w_0 - w_1) - (c_1 + slope of the rock) w_1,   u' = -P w_0' - I w_0
    """
    known = {name: number.value * changed.get(name, 1.0) for name, number in loop.variable_numbers().items()}
    slope = -0.9 * known["bit.weight"] * known["bit.radius"] * 0.3 * math.exp(-0.9 * SPEED)
    k, d = known["chain.stiffness.0"], known["chain.damping.0"]
    top = [known["chain.inertia.0"], d + known["chain.top_drag"] + known["pi.proportional"], k + known["pi.integral"]]
    bit = [known["chain.inertia.1"], d + known["chain.bit_drag"] + slope, k]
    a = np.polysub(np.polymul(top, bit), np.polymul([d, k], [d, k]))  # without the free angle
    first = a[1] * a[2] - a[0] * a[3]
    return bool((a > 0).all() and first > 0 and a[3] * first - a[1] ** 2 * a[4] > 0)


def test_the_border_of_smooth_running_is_exact_along_its_way():
    """A block under N (0.5 + 0.5 exp(-v)) swings on beyond c (1 - s) = N (1 + s) 0.5 exp(-v), where both are wrong by s."""
    belt = BlockOnBelt(belt_speed=2.0, damping=0.2, friction=Exponential(static=1.0, kinetic=0.5, decay=1.0))
    found = smallest_error(closed_loop(compose(belt)), {"block.damping": (0.0, 0.4), "block.load": (0.0, 2.0)}, 40.0)
    fall = 0.5 * math.exp(-2.0)
    assert found.linear_size == pytest.approx((0.2 - fall) / (0.2 + fall), abs=2e-6)
    assert "breaks the machine without a law" in str(found)
    # both errors enter s^2 + (c - N f) s + k as one damping, so that D scales to the border itself
    assert found.guaranteed_size == pytest.approx((0.2 - fall) / (0.2 + fall), rel=1e-6) and found.undetermined_reason == ""


def test_where_no_size_is_guaranteed_it_is_said_why(rig):
    """A law in Python has no slope."""
    at = equilibrium(closed_loop(rig, SoftTorque(reference=9.0)))
    law = Sampled(lambda t, y: at["top.torque"] + 400.0 * (9.0 - y[0]), 0.05)
    start = {name: at[name] for name in ("chain.twist", "chain.speed")}
    found = smallest_error(closed_loop(rig, law), {"bit.weight": 0.02}, 20.0, starts=[start], mean_within=10.0, ripple_within=10.0)
    assert math.isnan(found.guaranteed_size) and found.undetermined_reason == "the law is a Python callable"
    assert "no size is guaranteed (mu): the law is a Python callable" in str(found)


RANGES = {"bit.weight": 1.0, "chain.stiffness.0": 0.5, "proportional": 0.9}
NAMES = ("bit.weight", "chain.stiffness.0", "pi.proportional")


def test_the_smallest_joint_error_is_the_border_of_routh(loop):
    """Of the corners of the box one reaches the border first; the criterion of Routh knows where."""
    found = smallest_error(loop, RANGES, 40.0, mean_within=10.0, ripple_within=10.0)

    def stable(size, corner):
        return routh(loop, {name: 1.0 + size * part * RANGES.get(name, 0.9) for name, part in zip(NAMES, corner, strict=True)})

    assert stable(0.0, (1, 1, 1))
    borders = {
        c: halved(lambda r, c=c: not stable(r, c), 0.0, 1.0, 1e-9)[1] for c in itertools.product((-1, 1), repeat=3) if not stable(1.0, c)
    }
    nearest = min(borders, key=borders.get)
    assert borders[nearest] < 0.9 and len(borders) < 8
    assert borders[nearest] <= found.linear_size <= borders[nearest] + PRECISION
    assert found.linear_error == pytest.approx(np.array(nearest) * found.linear_size)
    assert 0.0 < found.guaranteed_size <= borders[nearest]  # what holds for every error holds for this one
    assert found.size <= found.linear_size + PRECISION  # and a machine on which smooth running grows has failed


def test_the_error_found_breaks_the_machine_and_a_smaller_one_does_not(loop):
    found = smallest_error(loop, {"bit.weight": ("60 kN", "160 kN"), "chain.inertia.0": 0.5}, 60.0)
    assert (
        math.isfinite(found.size)
        and found.largest_tolerated < found.size <= found.largest_tolerated + PRECISION
        and found.size == max(map(abs, found.error))
    )
    assert "stick-slip" in found.why and "weight [kN]" in str(found)
    off = 100.0 * (found.values["bit.weight"] / found.parameters[0].nominal - 1.0)
    assert f"{found.values['bit.weight'] / 1e3:.4g} ({off:+.3g} %)" in str(
        found
    )  # how far off the weight itself is, not in parts of its range
    for size, sticks in ((found.size, True), (0.9 * found.largest_tolerated, False)):
        values = {number.name: number.value(size * np.sign(part)) for number, part in zip(found.parameters, found.error, strict=True)}
        other = loop
        for name, value in values.items():
            other = other.at(name, value)
        run = simulate(other.replace(start=smooth_start(loop)), 60.0)
        assert (run.time_in("bit", "stick", after=42.0) > 0.0) is sticks


def test_an_error_of_the_delay_alone_is_the_delay_margin(rig):
    loop = closed_loop(rig, Sampled(SoftTorque(reference=9.0), 0.05, 0.05))
    margin = margins(loop, by_simulation=False).delay_margin
    found = smallest_error(loop, {"delay": (0.05, 0.05 + 1.25 * margin)}, 20.0, mean_within=10.0, ripple_within=10.0)
    assert found.linear_size == pytest.approx(0.8, abs=PRECISION)
    assert found.values["delay"] == pytest.approx(0.05 + 1.25 * margin * found.size)
    assert 0.2 < found.guaranteed_size < 0.8  # a factor of any phase is more than a delay


def test_nothing_within_the_ranges_is_said(rig):
    loop = closed_loop(rig, SoftTorque(reference=9.0))
    found = smallest_error(loop, {"bit.weight": 0.02}, 20.0)
    assert found.size == math.inf and found.error == () and found.values == {} and found.largest_tolerated == 1.0
    assert "none within the ranges" in str(found) and "stays stable within them" in str(found) and found.guaranteed_size > 1.0


def test_mistakes_are_told(rig, loop):
    for ranges, word in (
        ({}, "1 to 7 numbers"),
        ({"bit.weight": ("100 kN", "120 kN")}, "around the nominal 97347 N"),
        ({"bit.weight": "97 kN"}, r"\(low, high\)"),
        ({"bit.wieght": 0.1}, "bit.weight"),
        ({"delay": ("0 ms", "40 ms")}, "sampled laws of one delay"),
        ({"bit.weight": (-1.0, 1e5)}, "must be >= 0"),
    ):
        with pytest.raises(SceneError, match=word):
            smallest_error(loop, ranges, 10.0)
    with pytest.raises(SceneError, match="must be a success on the nominal plant, but it is not: .*stick"):
        smallest_error(closed_loop(rig, PI(4_000.0, 1_500.0, reference=3.0)), {"bit.weight": 0.1}, 60.0)
