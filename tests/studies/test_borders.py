"""Where stick-slip ends: by `onset`, by `severity_map`, by `follow`, and by slow ramps of a simulation that shares nothing with them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from studies.questions import borders as study
from studies.questions.slow_ramp import String, ramp
from toolbox import limit_cycle, simulate

CASES = [pytest.param(case, id=case.label, marks=[pytest.mark.slow] if k in (2, 4, 6, 7) else []) for k, case in enumerate(study.CASES)]


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_onset_in_every_range_and_the_map_agree_with_the_cycle_that_is_followed_and_with_a_slow_ramp(case):
    found, mapped, followed, ramped = study.row(case)
    for measure in (ramped, *([] if math.isnan(followed) else [followed])):
        assert [*found, mapped] == pytest.approx([measure] * (len(found) + 1), rel=5e-3)


@pytest.mark.slow
def test_the_independent_simulation_has_the_cycle_of_the_toolbox():
    case = study.CASES[3]
    cycle = limit_cycle(simulate(case.plant, 400.0, controller=case.law, inputs={case.parameter: 6.0}, accuracy=1e-9))
    errors = []
    for step in (4e-3, 2e-3, 1e-3):
        own = ramp(String.of(case.well, case.rock, case.law.design(case.plant)), (6.0, 6.0 + 1e-9), (1.0,), hold=500.0, step=step)
        rounds, sticks = np.diff(own.sticks[-20:, 0]), np.diff(own.sticks[-20:-1], axis=1)
        errors.append(abs(rounds.mean() / cycle.period - 1))
        assert sticks.mean() == pytest.approx(cycle.stick_share("bit") * cycle.period, abs=2 * step)
    assert errors[2] < 2e-4 and errors[2] < errors[0]  # of first order in the step: the bit is let go at the end of one


@pytest.mark.slow
def test_a_ramp_at_a_third_of_the_rate_comes_closer_to_the_period_doubling_that_ends_the_cycle():
    case = study.CASES[3]
    lost, away = study.by_follow(case), []
    string = String.of(case.well, case.rock, case.law.design(case.plant))
    for rate in (3e-5, 1e-5, 3e-6):
        away.append(ramp(string, (case.sticks, 0.985 * lost, 1.03 * lost), (1e-4 * lost, rate * lost)).border - lost)
    assert away[0] > away[1] > away[2] > 0.0 and away[2] < 4e-3 * lost
