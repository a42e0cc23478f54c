"""The study of drives: what its table claims about the best law, and how a row joins it."""

from __future__ import annotations

import numpy as np
import pytest

from controllers import PI, LinearMPC, NonlinearMPC
from studies.questions.drives import (
    DELAY,
    GRID,
    LIMITS,
    PLANT,
    SEEDS,
    Contender,
    contenders,
    lowest,
    on_speed,
    run_of,
    step_time,
    stick_phase_end,
    succeeds,
)

EVERY = {contender.label: contender for contender in contenders()}


def test_lqg_ends_stick_slip_at_2_6_rad_s_from_the_top_speed_alone_and_its_twins_do_not():
    for seed in SEEDS:
        assert succeeds(run_of(EVERY["LQR, LQG"], 2.6, True, seed), 2.6, True)
    for label in ("stiff PI", "soft torque", "Z-torque"):
        assert not succeeds(run_of(EVERY[label], 2.6, True, SEEDS[0]), 2.6, True)


@pytest.mark.slow
@pytest.mark.parametrize(("law", "numbers"), [(LinearMPC, {"torque_walk": 2000.0}), (NonlinearMPC, {"adapt": False})])
def test_predictive_laws_end_stick_slip_at_2_6_rad_s_too_and_fail_with_a_filter_that_does_not_know_the_rock(law, numbers):
    row = EVERY["linear MPC" if law is LinearMPC else "nonlinear MPC"]
    assert succeeds(run_of(row, 2.6, True, SEEDS[0]), 2.6, True)
    twin = Contender("twin", row.nominal, lambda reference: law(reference=reference, delay=DELAY, **numbers, **LIMITS).design(PLANT), 0.1)
    assert not succeeds(run_of(twin, 2.6, True, SEEDS[0]), 2.6, True)


def test_every_run_starts_wound_up_with_a_bit_about_to_break_free():
    for real, weight in ((False, 1.0), (True, 1.1)):
        point = stick_phase_end(4.0, real)
        assert point["chain.speed"][1] == 0.0
        slip = point["chain.speed"][0]
        assert 473.0 * point["chain.twist"][0] + 23.2 * slip == pytest.approx(weight * 97_347.0 * 0.155575 * 0.8, rel=1e-6)


def test_a_run_that_ends_stuck_off_its_set_point_or_swinging_is_no_success():
    run = run_of(EVERY["LQR, LQG"], 5.0, False)
    assert run.time[0] == GRID[0]
    assert succeeds(run, 5.0, False)
    assert not succeeds(run, 5.4, False)  # 5 % off
    assert not succeeds(run_of(EVERY["stiff PI"], 5.0, False), 5.0, False)


def test_the_scan_stops_at_the_first_failure():
    asked = []

    def law(reference):
        asked.append(reference)
        return PI(reference=reference if reference > 13.7 else 0.5 * reference, **LIMITS)

    assert lowest(Contender("half-way", law, law), False) == 13.8
    assert asked == [14.0, 13.9, 13.8, 13.7]
    asked.clear()
    assert lowest(Contender("half-way", law, law, coarse=13.8), False) == 13.8  # between 14 and 13.8 only whole set-points
    assert asked == [14.0, 13.8, 13.7]
    assert np.isnan(lowest(on_speed("stiff PI", EVERY["stiff PI"].nominal(1.0).__class__), True, highest=6.0))


def test_a_python_function_is_a_row_like_any_other():
    def torque(reference):
        return lambda t, y: float(np.clip(11_000.0 + 400.0 * (reference - y[0]), 0.0, 20_000.0))

    row = Contender("function", torque, torque, period=0.1)
    run = run_of(row, 9.0, True, SEEDS[0])
    assert run["top.torque"].max() <= 20_000.0
    assert 0.0 < step_time(row, 9.0) < 1.0
    assert 0.0 < step_time(EVERY["LQR, LQG"], 9.0) < 1e-2
