"""A law that lifts its set-point: from inside stick-slip it holds what it otherwise holds only in smooth running, and nothing else lifts it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from controllers import PI, Lifting, LinearMPC, NonlinearMPC, SoftTorque, StiffPI, ZTorque
from studies import gains
from tests.plants import RIG
from toolbox import Sampled, SceneError, closed_loop, inputs, margins, measure, simulate
from toolbox.modelling import Takeover
from toolbox.robustness.starts import at_set_point

LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}
HEAVY = {"chain.inertia": (1.2 * 2122.0, 374.0)}
SPEED = 4.5
SMOOTH = ((0.0, 80.0, 110.0), (10.0, 10.0, 6.0))
"""A set-point that winds the string up at 10 rad/s and comes down to 6 by 110 s."""


def z_torque(reference=SPEED):
    return ZTorque(reference=reference, **gains.stored("Z-torque"), **LIMITS)


def sampled(law, **others):
    return Sampled(law, 0.01, delay=0.03, noise={"top.speed": 0.01}, seed=7, **others)


def inside(law, at=40.0, reference=SPEED, parameters=HEAVY, until=240.0):
    """A law that takes over from a stiff drive inside stick-slip."""
    both = Takeover(StiffPI(reference=reference, **LIMITS), law, at=at)
    run = simulate(RIG, until, controller=sampled(both), parameters=parameters, inputs={"top.reference": reference})
    assert run.time_in("bit", "stick", until=at) > 5.0
    return run


def test_it_ends_a_stick_slip_that_the_law_inside_does_not_at_every_phase():
    stuck = {"alone": [], "lifting": []}
    for at in (40.0, 42.0, 44.0, 46.0):
        for name, law in (("alone", z_torque()), ("lifting", Lifting(law=z_torque(), reference=SPEED))):
            run = inside(law, at)
            assert name == "alone" or (run["takeover.lifting.lifts"][-1] <= 1.0 and run["takeover.lifting.gave_up"][-1] == 0.0)
            stuck[name].append(run.time_in("bit", "stick", after=160.0))
    assert stuck["lifting"] == [0.0] * 4
    assert max(stuck["alone"]) > 10.0
    assert run.at(240.0)["bit.speed"] == pytest.approx(SPEED, rel=0.02)


@pytest.mark.parametrize("reference", [4.0, 6.0])
@pytest.mark.parametrize("kind", [PI, SoftTorque])
def test_the_price_of_a_recovery(kind, reference):
    """The top turns at most 2.9 times as fast as asked, sticks for 27 s more, and is back at its set-point within 70 s."""
    run = inside(Lifting(law=kind(reference=reference, **LIMITS), reference=reference), reference=reference, parameters=None)
    lifted = run["lifting.reference"] > 1.02 * reference
    assert run["top.speed"].max() < 2.9 * reference
    assert measure.stick_intervals(run, "bit")[-1][1] < 40.0 + 27.0
    assert run.time[lifted][-1] < 40.0 + 70.0
    assert run["takeover.lifting.held"][-1] >= reference * 0.999  # at least twice the set-point calmed it


def test_the_set_point_rises_and_falls_at_its_rates_to_what_was_asked():
    law = Lifting(law=z_torque(), reference=SPEED, raise_rate=2.0, lower_rate=0.1)
    run = inside(law, 45.0)
    lifted = run.at(np.arange(47.0, 240.0, 0.05) + 0.001)["lifting.reference"]
    assert lifted.max() == pytest.approx(2.0 * SPEED, rel=1e-9)
    rates = np.diff(lifted) / 0.05
    assert rates.max() == pytest.approx(2.0, rel=0.21) and rates.min() == pytest.approx(-0.1, rel=0.21)  # a step holds four to six samples
    assert lifted[-1] == pytest.approx(SPEED, abs=1e-9)


@pytest.mark.parametrize("reference", [2.0, 3.0])
def test_below_what_it_can_hold_it_gives_up_and_says_so_until_another_set_point_is_asked(reference):
    both = Takeover(StiffPI(reference=reference, **LIMITS), Lifting(law=PI(reference=reference, **LIMITS), reference=reference), at=40.0)
    asked = inputs.step(reference, 4.5, 1500.0)
    run = simulate(RIG, 1800.0, controller=sampled(both), inputs={"top.reference": asked})
    before = run.time < 1500.0
    assert (run["takeover.lifting.gave_up"][run.time > 440.0][0], run.at(1499.0)["takeover.lifting.gave_up"]) == (reference, reference)
    lifted = run["lifting.reference"][before] > 1.1 * reference
    assert np.trapezoid(lifted.astype(float), run.time[before]) < 0.15 * 1500.0
    assert run.time_in("bit", "stick", after=1400.0, until=1500.0) > 5.0
    assert run["takeover.lifting.gave_up"][-1] == 0.0
    assert run.time_in("bit", "stick", after=1700.0) == 0.0


def test_after_giving_up_it_tries_again_when_the_time_has_passed_and_never_without_one():
    """The rock holds the string for 500 s; then the weight is that of a rock which one lift frees."""
    period = Lifting().design(RIG).string_period
    weight = inputs.step(2.5 * 97_347.0, 97_347.0, 500.0)
    for retry, tries in ((None, False), (300.0, True)):
        law = Lifting(law=PI(reference=6.0, **LIMITS), reference=6.0, retry_time=retry)
        run = simulate(RIG, 900.0, controller=sampled(law), inputs={"top.reference": 6.0, "bit.weight": weight})
        told = run.time[run["lifting.gave_up"] == 6.0]
        assert 36.0 * period < told[0] < 500.0
        assert (run["lifting.gave_up"][-1] == 0.0) == tries
        assert (run.time_in("bit", "stick", after=850.0) == 0.0) == tries


def test_after_a_stall_h_infinity_runs_away_without_a_limit_of_the_speed_and_not_with_one():
    law = gains.tuned("H-infinity, lifting")
    weight = inputs.Table.of("stall", (200.0, 202.0, 242.0, 244.0), np.array([1.0, 2.5, 2.5, 1.0]) * 97_347.0)
    asked = ((0.0, 80.0, 100.0), (10.0, 10.0, SPEED))
    tops = {}
    for limit in (None, 2.2):
        lifting = dataclasses.replace(at_set_point(law, SPEED), speed_limit_factor=limit)
        run = simulate(RIG, 400.0, controller=sampled(lifting), inputs={"top.reference": asked, "bit.weight": weight})
        assert run.time_in("bit", "stick", after=200.0) > 30.0 and run.time_in("bit", "stick", after=350.0) == 0.0
        tops[limit] = run["top.speed"][run.time > 200.0].max() / SPEED
    assert tops[2.2] < 3.1 < 4.5 < tops[None]


def test_what_it_lifts_in_vain_and_a_string_that_stands_are_told_after_36_periods():
    period = Lifting().design(RIG).string_period
    weak = PI(reference=6.0, lowest_torque=0.0, highest_torque=2000.0)  # less than the rock has at rest
    run = simulate(RIG, 300.0, controller=sampled(Lifting(law=weak, reference=6.0)))
    told = run.time[run["lifting.gave_up"] == 6.0]
    assert run["lifting.lifts"].max() == 0.0 and 36.0 * period < told[0] < 40.0 * period and told[-1] == 300.0
    off = Lifting(law=PI(reference=1.8, **LIMITS), reference=1.8, first_factor=1.3, factor_step=0.25, raise_rate=0.2, weight_relief=0.4)
    run = inside(off, reference=1.8, parameters=None, until=340.0)
    told, late = run.time[run["takeover.lifting.gave_up"] == 1.8], run.time > 300.0
    assert run["takeover.lifting.lifts"].max() > 0.0 and 36.0 * period < told[0] - 40.0 < 45.0 * period
    assert (run["lifting.reference"][late] == 1.8).all()


@pytest.mark.parametrize(
    ("display_units", "weight"),
    [
        (SMOOTH, 97_347.0),
        (((*SMOOTH[0], 150.0, 150.01), (*SMOOTH[1], 6.0, 12.0)), 97_347.0),
        (((*SMOOTH[0], 150.0, 150.01, 200.0, 200.01), (*SMOOTH[1], 6.0, 12.0, 12.0, 6.0)), 97_347.0),
        (SMOOTH, inputs.sine(97_347.0, 0.05 * 97_347.0, 0.17)),
        (SMOOTH, inputs.sine(97_347.0, 0.1 * 97_347.0, 0.1)),
    ],
    ids=["smooth", "set-point doubled", "and halved", "weight at the frequency of the string", "heave"],
)
def test_what_does_not_stop_the_bit_does_not_lift(display_units, weight):
    law = Lifting(law=z_torque(6.0), reference=6.0)
    run = simulate(RIG, 300.0, controller=sampled(law), inputs={"top.reference": display_units, "bit.weight": weight})
    late = run.time > 120.0
    assert run["lifting.lifts"][-1] == run["lifting.lifts"][late][0]
    assert run.time_in("bit", "stick", after=110.0) == 0.0
    wanted = np.interp(run.time, *display_units)
    if not isinstance(weight, inputs.Shape):
        assert run["top.speed"][late].max() < 1.05 * wanted[late].max()
        np.testing.assert_allclose(run["lifting.reference"][-1], wanted[-1], rtol=1e-9)


@pytest.mark.parametrize("times", [1.3, 1.5])
def test_a_step_of_the_weight_is_held(times):
    law = Lifting(law=PI(reference=6.0, **LIMITS), reference=6.0)
    weight = inputs.step(97_347.0, times * 97_347.0, 150.0)
    run = simulate(RIG, 500.0, controller=sampled(law), inputs={"top.reference": SMOOTH, "bit.weight": weight})
    assert run.time_in("bit", "stick", after=150.0, until=180.0) > 1.0
    assert run.time_in("bit", "stick", after=180.0) == 0.0
    assert run.at(500.0)["lifting.reference"] == 6.0


def test_smooth_running_has_the_margins_of_the_law_inside_and_it_begins_where_the_string_turns():
    alone, lifted = (
        margins(closed_loop(RIG, sampled(law)), by_simulation=False).disk_margin
        for law in (z_torque(8.0), Lifting(law=z_torque(8.0), reference=8.0))
    )
    assert lifted == pytest.approx(alone, rel=1e-6)


@pytest.mark.parametrize("kind", [LinearMPC, NonlinearMPC])
def test_a_predictive_law_inside_gets_the_lifted_set_point(kind):
    law = Lifting(law=kind(reference=4.0, **LIMITS), reference=4.0)
    run = simulate(RIG, 120.0, controller=law, sample_time=0.1)
    assert run.at(120.0)["bit.speed"] == pytest.approx(4.0, rel=0.01)
    assert run.time_in("bit", "stick", after=60.0) == 0.0


def test_what_is_no_law_is_refused():
    with pytest.raises(SceneError, match="`law` must be a Controller"):
        simulate(RIG, 1.0, controller=dataclasses.replace(Lifting(law=z_torque()), law=3), sample_time=0.01)
    with pytest.raises(SceneError, match="`observer` must be a StringObserver"):
        simulate(RIG, 1.0, controller=Lifting(law=z_torque(), observer=3), sample_time=0.01)


RELIEVING = {"first_factor": 1.3, "factor_step": 0.25, "raise_rate": 0.2, "weight_relief": 0.4}


def test_with_weight_as_a_second_actuator_a_smaller_lift_ends_the_stick_slip_and_all_of_the_weight_comes_back():
    law = PI(reference=SPEED, **gains.stored("impedance, lifting"), **LIMITS)
    tops = {}
    for name, numbers in (("lift", {}), ("lift and relief", RELIEVING)):
        run = inside(Lifting(law=law, reference=SPEED, **numbers), parameters=None)
        assert run.time_in("bit", "stick", after=70.0) == 0.0
        tops[name] = run["top.speed"][run.time > 40.0].max() / SPEED
    assert tops["lift and relief"] < 2.0 < tops["lift"]
    times = np.arange(45.0, 239.0, 0.05) + 0.001
    taken, weight = (run.at(times)[name] for name in ("takeover.lifting.relief", "bit.weight"))
    np.testing.assert_allclose(weight, 97_347.0 * (1.0 - taken), rtol=1e-12)
    assert taken.max() == pytest.approx(0.4, rel=1e-9) and taken[-1] == 0.0
    rates = np.diff(taken) / 0.05
    assert rates.max() == pytest.approx(0.05, rel=0.21) and rates.min() == pytest.approx(-0.01, rel=0.21)


def test_the_weight_that_is_asked_is_a_signal_and_without_relief_the_weight_is_not_driven():
    law = Lifting(law=PI(reference=6.0, **LIMITS), reference=6.0, **RELIEVING)
    asked = inputs.step(97_347.0, 1.3 * 97_347.0, 150.0)
    run = simulate(RIG, 400.0, controller=sampled(law), inputs={"top.reference": SMOOTH, "weight.reference": asked})
    assert run["bit.weight"][-1] == pytest.approx(1.3 * 97_347.0, rel=1e-12)
    assert run["bit.weight"][(run.time > 160.0)].min() == pytest.approx(0.6 * 1.3 * 97_347.0, rel=1e-9)
    assert run.time_in("bit", "stick", after=300.0) == 0.0
    assert Lifting(law=law.law).actuated_signals == ("top.torque",) and law.actuated_signals == ("top.torque", "bit.weight")
    with pytest.raises(SceneError, match="relief"):
        simulate(RIG, 1.0, controller=Lifting(law=law.law, weight_relief=1.5), sample_time=0.01)


def test_a_law_that_may_take_weight_off_has_the_margins_of_the_same_law_without():
    law = PI(reference=6.0, **LIMITS)
    plain, relieving = (
        margins(closed_loop(RIG, sampled(Lifting(law=law, reference=6.0, **more))), by_simulation=False) for more in ({}, RELIEVING)
    )
    assert relieving.stable and relieving.disk_margin == pytest.approx(plain.disk_margin, rel=1e-9)
    assert relieving.operating_point["bit.weight"] == pytest.approx(97_347.0, rel=1e-12)


def test_to_the_left_it_does_the_same_to_the_last_bit():
    """The machine is odd in its speeds, and so must be a law; a set-point that turns back is followed, and lifted only on the other side."""
    law = Sampled(Lifting(law=PI()), 0.01, delay=0.03)
    right, left = (simulate(RIG, 60.0, controller=law, inputs={"top.reference": sign * 8.0}) for sign in (1.0, -1.0))
    assert np.array_equal(right["top.speed"], -left["top.speed"]) and right["lifting.lifts"][-1] == left["lifting.lifts"][-1] == 1.0
    assert left["lifting.reference"].min() == -16.0
    back = simulate(RIG, 400.0, controller=law, inputs={"top.reference": ((0.0, 200.0, 200.0, 400.0), (8.0, 8.0, -8.0, -8.0))})
    assert back["lifting.lifts"][-1] == 2.0 and back.time_in("bit", "stick", after=300.0) == 0.0
    assert back["bit.speed"][-1] == pytest.approx(-8.0, rel=0.01)


def test_a_string_that_is_to_stop_is_not_lifted():
    law = Sampled(Lifting(law=SoftTorque()), 0.01, delay=0.03)
    run = simulate(RIG, 400.0, controller=law, inputs={"top.reference": ((0.0, 100.0, 100.0, 400.0), (8.0, 8.0, 0.0, 0.0))})
    assert run["lifting.lifts"][-1] == run["lifting.gave_up"].max() == 0.0 and run.time_in("bit", "stick", after=250.0) == 150.0


def test_a_bit_that_sticks_once_for_longer_than_a_period_of_the_string_is_lifted():
    """Next to the border the bit sticks rarely, and then for long: no second dip is waited for."""
    law = Lifting(law=z_torque(2.5), reference=2.5)
    run = simulate(RIG, 220.0, controller=sampled(law), inputs={"top.reference": ((0.0, 80.0, 110.0), (10.0, 10.0, 2.5))})
    begin, end = measure.stick_intervals(run, "bit", after=100.0)[0]
    assert 110.0 < begin < end - 8.0
    lifted = run.time[run["lifting.lifts"] > run.at(100.0)["lifting.lifts"]][0]
    assert begin + 5.0 < lifted < end


def test_a_limit_of_the_speed_lowers_the_torque_above_it_and_nothing_else_knows_of_it():
    """The torque is that of the law inside below the limit, less above it, and never turned round."""
    tops, plain = {}, PI(reference=6.0, **LIMITS)
    for limit in (None, 1.5):
        run = inside(Lifting(law=z_torque(), reference=SPEED, first_factor=1.4, raise_rate=0.3, speed_limit_factor=limit), parameters=None)
        tops[limit] = run["top.speed"].max() / SPEED
        assert run["top.torque"].min() >= 0.0 and run.time_in("bit", "stick", after=120.0) == 0.0
    assert 1.5 < tops[1.5] < 1.75 < 1.9 < tops[None]
    doubled = ((*SMOOTH[0], 150.0, 150.01), (*SMOOTH[1], 6.0, 12.0))
    free, held = (
        simulate(
            RIG,
            250.0,
            controller=sampled(Lifting(law=z_torque(6.0), reference=6.0, speed_limit_factor=limit)),
            inputs={"top.reference": doubled},
        )
        for limit in (None, 1.5)
    )
    times = np.arange(150.0, 250.0, 0.1)
    np.testing.assert_allclose(held.at(times)["top.speed"], free.at(times)["top.speed"], rtol=1e-6)  # the start from rest was braked
    found = [
        margins(closed_loop(RIG, sampled(Lifting(law=plain, reference=6.0, speed_limit_factor=each))), by_simulation=False)
        for each in (None, 1.5)
    ]
    assert found[0].disk_margin == pytest.approx(found[1].disk_margin, rel=1e-9)


def test_a_least_limit_lets_the_top_follow_a_bit_that_is_let_go_at_a_low_set_point():
    """It changes nothing where the limit is above it; below, the law inside may calm the bit, which the limit alone does not let it do."""
    law = gains.FAMILIES["LQG"].of(gains.between("LQG", "LQG, lifting", 0.25))
    last = {}
    for speed in (3.2, 4.5):
        for least in (0.0, 6.8):
            gentle = {"first_factor": 1.6, "raise_rate": 0.3, "speed_limit_factor": 1.7, "min_speed_limit": least}
            run = inside(Lifting(at_set_point(law, speed), reference=speed, **gentle), reference=speed, parameters=None, until=120.0)
            last[speed, least] = measure.stick_intervals(run, "bit")[-1][1] - 40.0
    assert last[4.5, 6.8] == last[4.5, 0.0]
    assert last[3.2, 6.8] < 16.0 < 22.0 < last[3.2, 0.0]
