"""The study of tuned drives: its two questions on runs whose answers are known, and what its table claims."""

import dataclasses

import numpy as np
import pytest

from controllers import LQG, SlidingMode, SoftTorque
from studies.protocol import trial
from studies.questions import whirl
from studies.questions.drives import DELAY, LIMITS, NOISE
from studies.questions.tune_drive import (
    HELD,
    LEVELS,
    OBJECTIVES,
    SET_POINT,
    STARTED,
    begin_of,
    collar,
    drill_strings,
    impacts,
    lowest_set_point,
    measured,
    settling,
    tuned_pi,
)
from toolbox.drilling.groups import Machine
from toolbox.scenes.cases import Case


def run_of(scene, law):
    """A scene under a law, or under what `Sampled` makes of one."""
    return dataclasses.replace(scene, cases=(Case.of("law", law),)).run("law")


def test_one_run_tells_the_settling_time_and_the_lowest_set_point_that_is_kept():
    scene = drill_strings()["97 kN"]
    run = run_of(scene, measured(SoftTorque(reference=SET_POINT, **LIMITS)))
    kept = lowest_set_point(run)
    place = LEVELS.index(kept)
    for k, level in enumerate(LEVELS):
        assert run.at(begin_of(k) + 1.0)["top.reference"] == pytest.approx(level)
    late = [run.time_in("bit", "stick", after=begin_of(k) + HELD / 2, until=begin_of(k + 1)) for k in range(len(LEVELS))]
    assert late[place - 1] > 1.0 and not any(late[place:])
    found = settling(run)
    after = np.linspace(found + 1e-6, STARTED, 4001)
    assert np.abs(run.at(after)["bit.speed"] / SET_POINT - 1).max() <= 0.05 + 1e-9
    assert abs(run.at(found - 1e-4)["bit.speed"] / SET_POINT - 1) > 0.05 - 1e-4


def test_a_law_that_takes_over_inside_stick_slip_at_a_constant_set_point_keeps_what_the_steps_tell():
    kept = lowest_set_point(run_of(drill_strings()["97 kN"], measured(SoftTorque(reference=SET_POINT, **LIMITS))))
    law = trial("soft torque", SoftTorque(**LIMITS))
    late = {speed: law.run(Machine("nominal"), speed, seed=1).time_in("bit", "stick", after=120.0) for speed in (kept, kept - 1.5)}
    assert late[kept] == 0.0
    assert late[kept - 1.5] > 5.0


def test_the_tuned_lqg_is_better_than_the_one_as_given_in_both_on_every_weight():
    given = LQG(reference=SET_POINT, delay_samples=round(DELAY / 0.01), speed_noise=NOISE, **LIMITS)
    tuned = dataclasses.replace(given, top_speed_scale=0.48625, bit_speed_scale=0.499034, angle_scale=3.41606)
    before, after = (
        [[of(run_of(scene, measured(law))) for of in OBJECTIVES.values()] for scene in drill_strings().values()] for law in (given, tuned)
    )
    assert np.max(after, axis=0)[0] <= 3.0 < np.max(before, axis=0)[0]
    assert np.max(after, axis=0)[1] < 13.0 < np.max(before, axis=0)[1]


def test_the_tuned_sliding_mode_spares_the_collar_that_the_given_one_drives_against_the_wall():
    given, tuned = (SlidingMode(reference=whirl.REFERENCE, surface_gain=s, reaching_rate=r) for s, r in ((0.6, 1.0), (0.258658, 0.333763)))
    before, after = (run_of(collar(), law) for law in (given, tuned))
    assert impacts(before) > 50 and impacts(after) == 0
    assert lowest_set_point(after) <= lowest_set_point(before) - 1.0


@pytest.mark.slow
def test_tuning_the_gains_of_soft_torque_lowers_the_set_point_that_they_hold():
    found = tuned_pi(16)
    assert found.counted(found.before)[0] > 8.0 > found.counted(found.best)[0]
    assert set(found.scenes) == {"90 kN", "97 kN", "107 kN"}
