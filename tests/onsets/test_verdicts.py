"""What the verdict says of runs that their own time does not decide."""

import math
from pathlib import Path

import numpy as np
import pytest

from controllers import PI, IdealSlidingMode, SoftTorque
from models import BitRock, wells
from tests.relapsing import Relapsing
from toolbox import Sampled, Scene, closed_loop, compose, hopf_points, inputs, simulate
from toolbox.measuring.judge import NOT_DECIDED, SMOOTH, STANDS, STICKS, SWINGS, Judged
from toolbox.measuring.verdict import of_judged
from toolbox.onsets.coming_to import comes_to
from toolbox.onsets.verdicts import verdict_row

RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
SCENES = Path(__file__).parents[2] / "studies" / "scenes"
BIT = ("bit", "bit.speed")


DOWN = 600.0
"""How long a set-point falls from 10 rad/s, where nothing sticks."""


def slowed(law, to, **kwargs):
    """A run of smooth running whose set-point falls slowly and then stays for 80 s, and what it comes to."""
    run = simulate(closed_loop(RIG, law, inputs={"top.reference": inputs.ramp(10.0, to, 0.0, DOWN)}, **kwargs), DOWN + 80.0)
    at_last = run.time > DOWN
    assert (run.modes["bit"][at_last] != 0).all() and np.ptp(run["bit.speed"][at_last]) < 0.03
    return comes_to(run, *BIT, DOWN)


def test_a_loop_that_looks_calm_for_its_run_and_grows_with_minutes_is_not_free():
    grows, calm = (slowed(PI(4_000.0, 1_500.0), to) for to in (3.985, 4.0))
    assert of_judged(grows, 0) == f"grows in {1.0 / grows.rate:.3g} s" and 500.0 < 1.0 / grows.rate < 2000.0
    assert calm.regime == SMOOTH
    loss = 3.985 + 0.015 * grows.rate / (grows.rate - calm.rate)  # where the growth of these two is zero
    assert loss == pytest.approx(hopf_points(closed_loop(RIG, PI(4_000.0, 1_500.0)), "top.reference", (2.0, 6.0))[0].value, abs=1e-4)


def test_a_drive_that_relapses_every_six_minutes_is_not_free():
    judged = slowed(Relapsing(PI(4_000.0, 1_500.0)), 3.97, sample_time=0.01)
    assert of_judged(judged, 0).startswith("grows in ") and judged.rate > 1e-3


def test_inputs_count_as_they_are_at_last():
    loop = closed_loop(RIG, SoftTorque(reference=8.0), inputs={"bit.weight": inputs.step(40e3, 97_347.0, 50.0)})
    judged = comes_to(simulate(loop, 120.0), *BIT, 20.0)
    assert judged.regime == SMOOTH
    assert judged.rate == comes_to(simulate(loop.at("bit.weight", 97_347.0), 120.0), *BIT, 60.0).rate
    assert comes_to(simulate(loop, 45.0), *BIT, 20.0) is None  # the step is still to come
    shaken = closed_loop(RIG, SoftTorque(reference=8.0), inputs={"bit.weight": inputs.sine(9e4, 1e3, 0.1)})
    assert comes_to(simulate(shaken, 45.0), *BIT, 20.0) is None


def test_steps_of_an_encoder_and_noise_do_not_make_a_swing():
    exact = Sampled(SoftTorque(reference=8.0), 0.01)
    rough = Sampled(SoftTorque(reference=8.0), 0.01, noise={"top.speed": 0.01}, resolution={"top.speed": 0.002})
    still, shaken = (comes_to(simulate(closed_loop(RIG, law), 120.0), *BIT, 60.0) for law in (exact, rough))
    assert still.regime == shaken.regime == SMOOTH and shaken.severity > 1e-5
    assert shaken.rate == pytest.approx(still.rate, rel=1e-6)


def test_a_sliding_surface_adds_no_motion_that_neither_grows_nor_dies():
    judged = comes_to(simulate(closed_loop(RIG, IdealSlidingMode(reference=9.0)), 120.0), *BIT, 60.0)
    assert judged.regime == SMOOTH and judged.rate < -0.1


def test_a_large_swing_without_a_stick_is_no_free_running():
    scene = Scene.load(SCENES / "elastic_pad.toml")
    row, _ = verdict_row(scene, "held")
    assert row.verdict == "swing" and row.stuck == 0.0 and row.severity > 0.5


@pytest.mark.parametrize(
    ("judged", "sticks", "word"),
    [
        (Judged(SMOOTH), 0, "free"),
        (Judged(SMOOTH), 1, "recovered after 1 stick"),
        (Judged(SMOOTH), 3, "recovered"),
        (Judged(STICKS, sticks=1), 2, "stick-slip"),
        (Judged(STICKS, sticks=1), 0, "stick-slip later"),
        (Judged(STANDS, sticks=1), 1, "stuck"),
        (Judged(STANDS, sticks=1), 0, "stuck later"),
        (Judged(SWINGS), 0, "swing"),
        (Judged(NOT_DECIDED, sticks=7), 4, "stick-slip"),
        (Judged(NOT_DECIDED, rate=1 / 46_800), 0, "grows in 4.68e+04 s"),
        (Judged(NOT_DECIDED, rate=-0.1), 0, "not decided"),
        (Judged(NOT_DECIDED, rate=math.nan), 0, "no stick"),
    ],
)
def test_the_words_of_a_verdict(judged, sticks, word):
    assert of_judged(judged, sticks) == word
