"""How slow a log may be, and the second opinion of the surface torque: closed forms, known stretches of stick-slip, and logs of two rates."""

from __future__ import annotations

import numpy as np
import pytest

from models import wells
from studies.benchmarks.slow_logs import MODELS, logged, outcome, scene, smooth, sticks_between, string_period, strings
from studies.benchmarks.slow_logs import _run as run_of
from toolbox import SceneError
from toolbox.drilling import estimate, estimates
from toolbox.drilling.torque_swing import ENOUGH, SWINGS, swinging, too_slow, torque_swing

PERIOD = 5.0


def indices(torque, step=0.1, duration=60.0):
    """(times, index, least swing) of a torque that is a function of time."""
    t = np.arange(0.0, duration, step)
    return t, *torque_swing(t, torque(t), PERIOD, np.zeros(t.size, bool))


@pytest.mark.parametrize("share", [0.05, 0.25, 0.9])
@pytest.mark.parametrize("step", [0.01, 0.1, 0.5])
def test_a_torque_that_swings_at_the_period_has_its_amplitude_over_the_mean_as_index(share, step):
    _, index, least = indices(lambda t: 1e4 * (1.0 + share * np.sin(2.0 * np.pi * t / PERIOD)), step)
    # samples, and means over up to a twelfth of a period, miss the top by at most 1 - cos(pi / 10) and 1 - sinc(1 / 12)
    assert index[-1] == pytest.approx(share, rel=0.05)
    assert least[-1] == pytest.approx(share, rel=0.08)


@pytest.mark.parametrize("off", [0.9, 1.1])
def test_ten_percent_of_the_period_change_the_swing_by_three_percent(off):
    # of a wave with the angle a over half a period, D has the amplitude (1 - cos a) / 2 of that at a = pi
    _, _, least = indices(lambda t: 1e4 * (1.0 + 0.3 * np.sin(2.0 * np.pi * t / (off * PERIOD))), 0.01, 100.0)
    inside = 0.5 * (1.0 - np.cos(np.pi / off))
    assert inside > 0.965 and least[-1] == pytest.approx(0.3 * inside, rel=0.06)


@pytest.mark.parametrize(
    "torque",
    [
        lambda t: 1e3 + 500.0 * t,
        lambda t: np.where(t < 30.0, 4e3, 1.2e4),
        lambda t: np.where(t < 30.0, 1.2e4, 3e3),
        lambda t: np.full(t.size, 9e3),
    ],
    ids=["a ramp", "a jump up", "a jump down", "a constant"],
)
def test_a_ramp_and_a_jump_are_no_swing_over_three_periods(torque):
    _, index, least = indices(torque)  # means over a twelfth of a period spread a jump, so that a third window sees a part of it
    assert np.nanmax(least) < 0.5 * SWINGS and not swinging(index, least).any()


def test_the_swing_begins_within_five_periods_and_ends_within_one():
    wave = lambda t: 1e4 * (1.0 + 0.4 * ((t > 40.0) & (t < 100.0)) * np.sin(2.0 * np.pi * t / PERIOD))  # noqa: E731
    t, index, least = indices(wave, 0.1, 150.0)
    on = t[swinging(index, least)]
    assert 40.0 + 3.0 * PERIOD < on[0] < 40.0 + 5.0 * PERIOD and 100.0 <= on[-1] < 100.0 + PERIOD + 0.2


def test_nothing_is_told_from_both_sides_of_a_gap():
    t = np.concatenate([np.arange(0.0, 60.0, 0.1), np.arange(200.0, 260.0, 0.1)])
    torque = 1e4 * (1.0 + 0.4 * np.sin(2.0 * np.pi * t / PERIOD))
    index, least = torque_swing(t, torque, PERIOD, np.isclose(t, 200.0))
    behind = t > 199.0
    assert np.isnan(index[behind & (t < 200.0 + PERIOD - 0.01)]).all() and np.isfinite(index[t >= 200.0 + PERIOD + 0.01]).all()
    assert np.isnan(least[behind & (t < 200.0 + 4.0 * PERIOD - 0.2)]).all()


@pytest.mark.parametrize(("samples", "slow"), [(5.0, False), (4.5, False), (4.3, True), (2.0, True), (50.0, False)])
def test_a_log_is_too_slow_below_five_samples_in_a_period_that_may_be_some_percent_off(samples, slow):
    t = np.arange(0.0, 100.0, PERIOD / samples)
    assert too_slow(t, np.ones(t.size, bool), PERIOD).all() == slow
    every = np.arange(t.size) % 2 == 0  # with every other sample missing it has half as many
    assert too_slow(t, every, PERIOD).all() == (samples < 8.6)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("interval", [1.0, 5.0])
def test_stick_slip_is_found_where_the_log_is_fast_enough_and_else_called_too_slow(model, interval):
    told = outcome(model, interval, members=32)
    assert told.right, told
    assert (told.samples < ENOUGH) == any("too slow to see stick-slip" in note for note in told.notes)


def test_a_log_that_is_too_slow_tells_no_severity_and_no_wrong_machine():
    log = logged(run_of(strings("exact")[0]), 2.0)
    found = estimate(scene("exact"), log, members=16)
    assert all(np.isnan(values).all() for values in found.mean.values()) and not found.stick_slip.any() and found.sampling_too_slow.all()
    assert (
        "too slow to see stick-slip from 0 s to" in str(found)
        and "not that of the log" not in str(found)
        and "no stick-slip" not in str(found)
    )
    period = string_period(wells.JANSEN_2)
    assert (
        f"{period / 2.0:.2g} in a period of the string of {period:.3g} s, and 5 are needed: log every {period / 5.0:.2g} s or faster"
        in str(found)
    )
    assert np.ravel(found.plot())[0].texts[0].get_text() == "too slow to see stick-slip"


def test_the_margin_is_called_by_its_name_and_blank_while_it_sticks():
    log = logged(run_of(strings("exact")[0]), 0.5)
    found = estimate(scene("exact"), log, members=16)
    assert "margin to the loss of smooth running" in str(found)
    assert (
        np.isnan(found.mean["onset_margin"][found.stick_slip]).all()
        and np.isfinite(found.mean["onset_margin"][(found.time > 60.0) & ~found.stick_slip]).any()
    )


def test_a_log_of_two_rates_is_judged_and_drawn_in_both():
    run = run_of(strings("exact")[0])
    begin, end = sticks_between(run)
    slow, fast = logged(run, 1.0), logged(run, 0.2)
    middle = 0.5 * (begin + end)
    log = {name: np.concatenate([slow[name][slow["time"] < middle], fast[name][fast["time"] >= middle]]) for name in slow}
    found = estimate(scene("exact"), log, members=16)
    long = [spell for spell in found.spells if spell[1] - spell[0] > 60.0]
    assert len(long) == 1 and long[0][0] < begin + 4.0 * string_period(wells.JANSEN_2) and long[0][1] >= end
    line = np.ravel(found.plot())[0].lines[0]
    assert np.isfinite(line.get_ydata()).all()  # the first half of it, too


def test_a_part_of_a_log_that_is_too_slow_is_told_with_its_times():
    run = run_of(strings("exact")[0])
    slow, fast = logged(run, 4.0), logged(run, 0.5)
    log = {name: np.concatenate([slow[name][slow["time"] < 270.0], fast[name][fast["time"] >= 270.0]]) for name in slow}
    found = estimate(scene("exact"), log, members=16)
    assert found.sampling_too_slow[found.time < 268.0].all() and not found.sampling_too_slow[found.time > 275.0].any()
    assert "too slow to see stick-slip from 0 s to 2" in str(
        found
    ) and "too slow to see stick-slip in part: it has a sample every 4 s" in str(found)
    assert found.stick_slip[(found.time > 300.0) & (found.time < 420.0)].all() and not found.stick_slip[found.sampling_too_slow].any()


def test_where_ensemble_and_torque_disagree_it_is_said_which_to_believe_and_why(monkeypatch):
    monkeypatch.setattr(estimates, "Detector", lambda: lambda found: False)  # an ensemble that never sticks
    found = estimate(scene("exact"), logged(run_of(strings("exact")[0]), 0.5), members=16)
    begin, end = sticks_between(run_of(strings("exact")[0]))
    inside = (found.time > begin + 25.0) & (found.time < end)
    assert found.stick_slip[inside].all() and np.isnan(found.mean["severity"][inside]).all()
    assert "Two opinions on stick-slip differ from" in str(found) and "Believe the torque: it is measured" in str(found)


def test_an_ensemble_that_sticks_under_a_calm_torque_is_not_believed():
    t = np.arange(0.0, 120.0, 0.5)
    on = np.ones(t.size, bool)
    sticks, index, alarm = estimates._judged(t, np.full(t.size, 9e3), on, np.zeros(t.size, bool), ~on, PERIOD)
    assert sticks.all() and index[-1] == 0.0 and not alarm[t > PERIOD].any()
    words = estimates._disagreements(t, sticks, alarm, index, PERIOD)
    assert len(words) == 1 and "the bit of the ensemble sticks. Believe the torque" in words[0]


def test_smooth_running_with_steps_of_the_weight_is_no_stick_slip():
    _, found = smooth(1, 1.0, 300.0)
    assert not any(begin > 60.0 for begin, _ in found.spells)
    assert np.nanmax(found.torque_swing[found.time > 60.0]) > SWINGS  # a step swings it once, which is no three periods


def test_a_log_that_cannot_be_read_is_refused_before_the_ensemble_is_prepared(tmp_path, monkeypatch):
    monkeypatch.setattr(estimates, "EnsembleFilter", lambda *given, **more: pytest.fail("the ensemble was prepared"))
    (tmp_path / "log.csv").write_text("time [s],top.torque [N m],top.speed [wibble]\n0,1,1\n1,2,2\n2,3,3\n")
    with pytest.raises(SceneError, match="wibble"):
        estimate(scene("exact"), tmp_path / "log.csv")
