"""Laws that bring a disc brake to standstill, and what no law without a faster actuator can do; every stop without groan has its open twin."""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest

from controllers import BrakeForce, BrakeMPC, BrakePI, BrakeSlidingMode
from controllers.brake_law import groan_border, groan_force
from models import BrakeActuator, Coulomb, DiscBrake, Tabulated
from models.closed_forms import groan_growth
from studies.questions import brakes
from toolbox import Sampled, Scene, SceneError, compose, energy_audit, measure, simulate
from toolbox.inputs import sine
from toolbox.measuring import metrics
from toolbox.onsets import verdicts
from toolbox.scenes.cases import Case
from toolbox.scenes.verdict_table import judged_by, table

EVERY = {
    "constant force": BrakeForce,
    "constant force, eased": partial(BrakeForce, margin=0.8),
    "sliding mode": BrakeSlidingMode,
    "MPC": BrakeMPC,
}
HIGHER = {"pad.friction.static": 0.54, "pad.friction.kinetic": 0.42}
START, LAG = 6.0, 0.01
STEADY = DiscBrake(force=0.0, friction=Coulomb(static=0.3, kinetic=0.3))


def run_of(law, deceleration, lag=None):
    """A stop from 6 rad/s without noise or delay, on a slightly rough disc."""
    duration, period = 2.0 * START / deceleration + 2.0, 0.03 if law is BrakeMPC else 1e-3
    controller = Sampled(law(deceleration=deceleration), period)
    rough = {"pad.attachment": sine(0.0, 4.0, 40.0)}
    return simulate(compose(DiscBrake(force=0.0, lag=lag)), duration, start={"disc.speed": START}, inputs=rough, controller=controller)


class Found(NamedTuple):
    """Releases above 0.1 rad/s, the distance beyond the planned one as a fraction of it, and the largest backward acceleration at the halt."""

    groans: int
    excess: float
    jolt: float


def found_of(run, deceleration):
    times = np.arange(0.0, run.end, 1e-3)
    at = run.at(times)
    stands = np.flatnonzero(at["disc.speed"] <= 0.0)
    end = int(stands[0]) if stands.size else times.size
    turning = np.interp(brakes.releases_of(run), times[:end], at["disc.speed"][:end], right=0.0)
    planned = START**2 / (2.0 * deceleration)
    jolt = (-at["brake.torque"][end:] / 36.0).max(initial=0.0)
    return Found(int((turning > 0.1).sum()), at["disc.speed"][:end].sum() * 1e-3 / planned - 1.0, jolt)


def stop(label, deceleration, lag=None):
    return found_of(run_of(EVERY[label], deceleration, lag), deceleration)


# --- the border and the growth in closed form


def test_under_constant_force_the_pad_grows_by_the_exponent_of_the_closed_form():
    brake = DiscBrake()
    for force, until in ((600.0, 0.6), (1000.0, 1.3)):
        edge = math.log(2 * force * 0.1 * 5 / 200) / 0.6  # 2 N |mu'(r w)| = c
        start = 1.1 * edge
        place = 2 * force * (0.35 + 0.1 * math.exp(-0.6 * start)) / 1e6
        near, far = (
            simulate(
                compose(brake),
                2.0,
                start={"disc.speed": start, "pad.position": place + shift},
                inputs={"brake.force": force},
                accuracy=1e-11,
            )
            for shift in (0.0, 1e-7)
        )
        times = np.linspace(0.0, 2.0, 20_001)
        speed = near.at(times)["disc.speed"]
        assert min(event.time for event in near.events) > times[np.argmax(speed < until)] + 0.01  # no stick so far

        def amplitude(speed_there, times=times, speed=speed, near=near, far=far):
            around = times[np.argmax(speed < speed_there)] + np.linspace(-0.01, 0.01, 101)  # a period of the pad
            apart = [far.at(around)[name] - near.at(around)[name] for name in ("pad.position", "pad.speed")]
            return np.hypot(apart[0], apart[1] / math.sqrt(1e5)).mean()

        grown = math.log(amplitude(until) / amplitude(edge))
        assert grown == pytest.approx(groan_growth(brake, force, until), rel=0.03)


def test_braking_harder_does_not_outrun_groan():
    brake = DiscBrake()
    growth = [groan_growth(brake, force) for force in (150.0, 300.0, 1000.0, 1e4, 1e8)]
    assert growth[0] == 0.0 and growth == sorted(growth)
    assert growth[-1] == pytest.approx(36 / (2 * 10 * 0.12**2) * math.log(0.45 / 0.35), rel=1e-3)
    with pytest.raises(SceneError, match="Exponential"):
        groan_growth(STEADY, 500.0)


def test_the_border_of_groan_is_the_force_at_which_the_pad_loses_its_damping():
    border, rate = groan_force(compose(DiscBrake()))
    assert (border, rate) == (pytest.approx(200.0), pytest.approx(0.6))  # c / (2 (mu_s - mu_k) decay), decay r
    with pytest.raises(SceneError, match="does not fall"):
        groan_force(compose(STEADY))
    with pytest.raises(SceneError, match="only for exponential friction"):
        groan_force(compose(DiscBrake(friction=Tabulated())))
    with pytest.raises(SceneError, match="does not fall"):
        groan_force(compose(dataclasses.replace(DiscBrake(), friction=dataclasses.replace(DiscBrake().friction, kinetic=0.45))))


# --- the laws follow the plan


@pytest.mark.parametrize("law", [BrakePI, BrakeSlidingMode, BrakeMPC])
def test_a_law_with_feedback_stands_after_the_planned_way_whatever_the_friction_is_and_its_twin_does_not(law):
    # friction 0.3 that does not fall, 0.4 expected: nothing to ease, a quarter less than the constant force needs
    ways = []
    for each in (law(deceleration=2.0, margin=None), BrakeForce(deceleration=2.0)):
        run = simulate(compose(STEADY), 6.0, start={"disc.speed": 6.0}, controller=each, sample_time=getattr(each, "period", 0.001))
        ways.append(found_of(run, 2.0).excess)
    assert abs(ways[0]) < ways[1] / 5
    assert ways[1] == pytest.approx(1 / 0.75 - 1, abs=0.05)


def test_on_the_surface_the_speed_follows_the_plan_with_the_rate_of_the_surface():
    # friction off by a third from the first sample: s' = -eta sat(s / width) does not know the friction, once the law has seen one quotient
    law = BrakeSlidingMode(deceleration=2.0, force_rate=None)
    run = simulate(compose(STEADY), 2.0, start={"disc.speed": 6.0}, controller=law, sample_time=0.001)
    times = np.linspace(0.1, 2.0, 50)
    np.testing.assert_allclose(run.at(times)["disc.speed"], 6.0 - 2.0 * times, atol=2e-3)


def test_commands_keep_their_limits_and_are_held_at_standstill():
    for law in (BrakeForce, BrakePI, BrakeSlidingMode, BrakeMPC):
        controller = law(deceleration=3.0, highest_force=900.0)
        period = getattr(controller, "period", 0.001)
        grid = np.arange(0.0, 5.0, period) + 0.5 * period
        run = simulate(
            compose(DiscBrake(force=0.0)), 5.0, start={"disc.speed": 6.0}, controller=controller, sample_time=period, output_times=grid
        )
        force = run["brake.force"]
        assert force.max() <= 900.0
        assert np.abs(np.diff(force)).max() <= 20_000.0 * period * (1 + 1e-12)
        backwards = np.flatnonzero(run["disc.speed"] < 0.0)
        assert backwards.size
        assert force[backwards[1]] >= 100.0


def test_the_predictive_law_keeps_below_the_border_it_sees_ahead():
    run = run_of(BrakeMPC, 2.0)
    at = run.at(np.arange(0.0, 4.0, 1e-3))
    turning = at["disc.speed"] > 0.1
    border = 0.8 * 200.0 * np.exp(0.6 * at["disc.speed"])
    assert (at["brake.force"] - border)[turning].max() < 10.0  # a speed that wanders within a sample
    assert at["brake.force"].max() > 1.2 * 750.0  # and brakes harder than the plan before it has to ease
    assert not run.controllers[0].record.fallbacks


# --- groan


def test_a_constant_force_groans_and_eased_it_does_not_but_takes_more_way():
    constant, eased, ahead = (stop(label, 3.0) for label in ("constant force", "constant force, eased", "MPC"))
    assert constant.groans > 5 and eased.groans == 0 and ahead.groans == 0
    assert eased.excess > ahead.excess + 0.1 > 0.2  # seeing the border ahead saves way
    assert eased.jolt < 0.4 * constant.jolt


def test_sliding_mode_ends_groan_without_the_pad_being_measured_behind_a_fast_actuator():
    assert stop("constant force", 4.0).groans > 5
    found = stop("sliding mode", 4.0)
    assert found.groans < 2 and abs(found.excess) < 0.01


def test_behind_a_slow_actuator_the_same_sliding_mode_groans_more_than_its_twin():
    assert stop("sliding mode", 2.0, LAG).groans > stop("constant force", 2.0, LAG).groans + 20


def test_behind_one_actuator_with_noise_only_eased_laws_are_silent_whatever_friction_is():
    every = {contender.label: contender for contender in brakes.contenders()}
    for friction in (0.8, 1.0, 1.2):
        for label in ("constant force, eased", "PI, eased", "sliding mode, eased", "MPC"):
            found = brakes.stop_of(brakes.run_of(every[label], 2.5, friction))
            assert found.releases == 0 and found.standstill < math.inf
        for label in ("PI", "sliding mode", "constant, sine dither", "constant, phased dither"):
            assert brakes.stop_of(brakes.run_of(every[label], 2.5, friction)).groans


def test_the_phased_dither_that_is_silent_at_once_is_loud_through_the_actuator_of_the_others():
    every = {contender.label: contender for contender in brakes.contenders()}
    ideal, real, alone = (
        brakes.stop_of(brakes.run_of(every[label], 2.5)).releases
        for label in ("constant, phased dither, ideal actuator", "constant, phased dither", "constant force")
    )
    assert ideal < 2 <= alone < real


def test_behind_the_actuator_a_deep_sine_is_never_above_the_triangle_of_its_rate_and_near_it_and_a_shallow_one_has_the_lag():
    for frequency in (60.0, 150.0):
        assert brakes.triangle(frequency) == pytest.approx(20_000.0 / (4.0 * frequency * brakes.NEEDED))
        # the force turns round where it meets the command, a little before the triangle would
        assert 0.97 < brakes.delivered(frequency, 0.9) / brakes.triangle(frequency) <= 1.0
        assert brakes.delivered(frequency, 0.01) == pytest.approx(0.01 / math.hypot(1.0, 2 * math.pi * frequency * 0.01), rel=1e-3)


def test_no_sine_silences_a_stop_from_7_km_h_and_at_three_times_the_frequency_of_the_pad_it_makes_a_stop_from_30_km_h_louder():
    for frequency, depth in ((20.0, 0.9), (100.0, 0.5), (300.0, 0.9)):
        assert brakes.dithered(frequency, depth, ideal=False, start=brakes.SHORT) >= 2
    alone, ideal = (brakes.dithered(0.0, 0.0, each, brakes.SHORT) for each in (False, True))
    assert alone >= 2 and brakes.dithered(60.0, 0.9, ideal=True, start=brakes.SHORT) > 3 * ideal
    assert brakes.dithered(150.0, 0.9, ideal=False) > 3 * brakes.dithered(0.0, 0.0, ideal=False)


def test_phased_dither_helps_at_once_and_harms_2_ms_late():
    at_once, late = (brakes.phased_late(each, start=brakes.SHORT) for each in (0.0, 0.002))
    assert at_once < 2 <= brakes.dithered(0.0, 0.0, ideal=True, start=brakes.SHORT) < late


def test_stops_of_the_study_stand_after_the_planned_distance_where_nothing_is_off():
    row = brakes.Contender("sliding mode", partial(BrakeSlidingMode, **brakes.COMMONLY, force_rate=None), ideal=True)
    found = brakes.stop_of(brakes.run_of(row, 2.5))
    assert found.distance == pytest.approx((30 / 3.6) ** 2 / 5.0, rel=5e-3)
    assert found.mean == pytest.approx(2.5, rel=5e-3)
    assert found.peak == pytest.approx(36.0 * 2.5 / 0.3 / (2 * 0.12 * 0.35) / 2290e-6 / 1e5, rel=0.1)


# --- borders


def test_a_law_says_what_it_needs():
    from models import BlockOnBelt

    with pytest.raises(SceneError, match="needs `inertia` and `radius`"):
        BrakeForce().design(compose(BlockOnBelt()))
    with pytest.raises(SceneError, match="highest_force"):
        BrakeForce(lowest_force=6000.0).check()
    with pytest.raises(SceneError, match="horizon"):
        BrakeMPC(horizon=1).check()
    with pytest.raises(SceneError, match="solver"):
        BrakeMPC(solver="magic").check()
    with pytest.raises(SceneError, match="sample_time"):
        simulate(compose(DiscBrake()), 1.0, start={"disc.speed": 6.0}, controller=BrakeMPC(), sample_time=0.01)


def test_what_shakes_the_pads_is_in_the_energy_audit():
    run = simulate(
        compose(DiscBrake()),
        1.0,
        start={"disc.speed": 2.0},
        inputs={"pad.attachment": sine(0.0, 50.0, 45.0)},
        parameters=HIGHER,
        accuracy=1e-9,
    )
    audit = energy_audit(run)
    assert audit.relative < 1e-8
    assert abs(audit.supplies["disc.attachment"]) > 0.0


# --- the verdict of a stop


def shipped(root, name):
    return Scene.load(root / "studies" / "scenes" / f"{name}.toml")


def test_the_verdict_of_a_stop_ends_at_standstill_and_does_not_call_a_standing_wheel_stuck(root):
    scene = shipped(root, "brake_laws")
    rows = {label: verdicts.verdict_row(scene, label)[0] for label in ("constant force", "eased force", "MPC")}
    assert [row.verdict for row in rows.values()] == ["stick-slip", "free", "free"]
    assert rows["constant force"].stuck > 0.02 and rows["eased force"].stuck == 0.0
    assert rows["eased force"].settling > rows["constant force"].settling > 2.0
    without = verdicts.verdict_row(dataclasses.replace(scene, standstill_speed=None), "eased force")[0]
    assert without.verdict != "free"  # the wheel that stands
    late = verdicts.verdict_row(dataclasses.replace(scene, duration=1.0), "constant force")[0]
    assert late.verdict == "does not stand" and late.settling == math.inf
    assert "standstill at 0.1 rad/s" in table(scene, [rows["MPC"]]) and "stands at" in table(scene, [rows["MPC"]])
    assert "at the end of the run: increase `duration` (1 s)" in late.remark and late.remark in table(scene, [late])


def test_a_stop_says_how_long_the_command_was_at_its_limits():
    # 1 kN/s from 0 to 800 N in samples of 1 ms, then 800 N to standstill; the plan asks for 1 kN
    law = BrakeForce(deceleration=2.0 / 3.0, friction=0.1, highest_force=800.0, force_rate=1000.0)
    scene = Scene.of(
        compose(DiscBrake(force=0.0, friction=Coulomb(static=0.1, kinetic=0.1))), 9.0, {"weak": Sampled(law, 1e-3)}, signal="disc.speed",
        effort="brake.force", after=0.5, standstill_speed=0.1, start={"disc.speed": 3.0},
    )  # fmt: skip
    assert 36.0 * law.deceleration / (2.0 * 0.12 * law.friction) == pytest.approx(1000.0)
    row, run = verdicts.verdict_row(scene, "weak")
    reached = verdicts.limits_reached(run, row.settling)["brake.force"]
    assert [(word, limit) for word, limit, _ in reached] == [("highest", 800.0), ("rate", 1000.0)]
    assert [time for *_, time in reached] == pytest.approx([row.settling - 0.8, 0.8], abs=2e-3)
    assert (
        row.remark
        == f"The command of `brake.force` was at its limits: highest 800 N for {row.settling - 0.8:.2g} s, rate 1000 N/s for 0.8 s."
    )
    free = dataclasses.replace(law, highest_force=1001.0, force_rate=None)
    assert verdicts.verdict_row(dataclasses.replace(scene, cases=(Case("free", free, 1e-3),)), "free")[0].remark == ""


def test_controllers_keep_their_border_on_a_brake_with_other_friction_and_the_study_says_so(root):
    changed = shipped(root, "brake_laws")
    scene = dataclasses.replace(changed, parameters={})
    assert changed["eased force"].designed_controllers[0].border == scene["eased force"].designed_controllers[0].border
    words = "the nominal plant with other values of `pad.friction.static`, `pad.friction.kinetic` than its controllers are designed for"
    assert words in judged_by(changed) and "other values" not in judged_by(scene)


def test_a_scene_of_a_stop_is_the_same_after_a_round_trip(root, tmp_path):
    scene = shipped(root, "brake_laws")
    assert scene.standstill_speed == 0.1
    assert Scene.load(scene.save(tmp_path / "saved.toml")) == scene


def test_standstill_is_found_where_the_closed_form_has_it():
    # constant torque 2 mu N r: w = w_0 - T t / I
    run = simulate(compose(STEADY), 3.0, start={"disc.speed": 3.0}, inputs={"brake.force": 1000.0}, accuracy=1e-11)
    rate = 2 * 0.3 * 1000.0 * 0.12 / 36.0
    for speed in (2.5, 1.0, 0.7):
        assert measure.standstill(run, "disc.speed", speed) == pytest.approx((3.0 - speed) / rate, rel=1e-9)
    assert measure.standstill(run, "disc.speed", 0.7, after=2.0) == 2.0
    assert measure.standstill(run, "disc.speed", -5.0) == math.inf
    with pytest.raises(SceneError, match="speed"):
        measure.standstill(run, "disc.speed", math.nan)


# --- the predictive law


def test_the_predicted_stop_is_the_simulated_one():
    # friction as expected and constant: the plan of the first sample, applied as it is, must lead where the law says
    law = BrakeMPC(deceleration=2.0, force_rate=None).design(compose(DiscBrake()))
    law(0.0, (6.0, 0.0))
    brake = compose(dataclasses.replace(STEADY, friction=Coulomb(static=0.4, kinetic=0.4)))
    edges = 0.03 * np.arange(61)
    steps = (np.repeat(edges, 2)[1:-1], np.repeat(law.plan, 2))
    start = {"disc.speed": 6.0, "pad.position": 2 * 0.4 * law.plan[0] / 1e6}
    run = simulate(brake, 1.8, start=start, inputs={"brake.force": steps}, accuracy=1e-9)
    np.testing.assert_allclose(run.at(edges[1:])["disc.speed"], law.speeds, atol=1e-6)
    assert law.speeds[-1] == pytest.approx(6.0 - 2.0 * 1.8, abs=0.1)


def test_no_force_of_a_plan_changes_faster_than_the_actuator_bears():
    # a first sample at speed, where the plan wants to rise at once, and one far below the wanted speed, where it wants to fall
    law = BrakeMPC(deceleration=2.0, force_rate=5000.0).design(compose(DiscBrake()))
    most, before = 5000.0 * law.law.period, 0.0
    for t, speed, way in ((0.0, 6.0, 1.0), (0.03, 6.0, 1.0), (0.06, 2.0, -1.0)):
        force = law(t, (speed, 0.0))
        moves = way * np.diff(np.append(before, law.plan))
        assert moves[0] == pytest.approx(most, rel=1e-6)
        assert np.abs(moves).max() <= most * (1.0 + 1e-6)
        before = force


@pytest.mark.parametrize("given", [None, 5.0, 2.0])
def test_the_predictive_law_keeps_its_jerk_before_the_border_too_and_its_twin_has_that_of_its_rate(given):
    """The plan brakes harder before it must ease: at 20 kN/s by 2 r mu R / I 20 kN/s = 15.4 m/s3, with a jerk no faster than that, and below the border."""
    curve = Tabulated(speeds=(0.0, 0.05, 0.15, 0.4, 1.0, 3.0), coefficients=(0.45, 0.444, 0.43, 0.405, 0.39, 0.385), static=0.45)
    brake = DiscBrake(force=0.0, friction=curve, wheel_radius=0.3)
    law = BrakeMPC(car_deceleration=2.5, friction=0.385, highest_force=8000.0, car_jerk=given)
    run = simulate(
        compose(brake, BrakeActuator()), 6.0, start={"disc.car_speed": 30.0 / 3.6}, controller=Sampled(law, 0.03, delay=0.002),
        inputs={"pad.attachment": sine(0.0, 4.0, 40.0)},
    )  # fmt: skip
    stands = measure.standstill(run, "disc.car_speed", 0.03)
    jerk = metrics.jerk("disc.car_speed", 0.2, stands).read(run)
    of_rate = 2.0 * brake.radius * 0.385 * 0.3 / brake.inertia * 20_000.0
    assert jerk == pytest.approx(of_rate, rel=0.02) if given is None else jerk < 1.1 * given
    assert not any(each.element == "pad" and each.before == "stick" and 0.05 < each.time < stands for each in run.events)
    if given is not None:
        times = np.arange(0.2, stands, 1e-3)
        found, border = run.at(times), groan_border(compose(brake))
        assert all(force < border.at(max(speed, 0.0)) for force, speed in zip(found["brake.force"], found["disc.speed"], strict=True))


def test_without_a_sound_answer_the_last_plan_goes_on(monkeypatch):
    law = BrakeMPC(deceleration=2.0).design(compose(DiscBrake()))
    first = law(0.0, (6.0, 0.0))
    expected = law.plan[1]
    unsound = dataclasses.replace(law.record.answer, sound=False, reason="no")
    monkeypatch.setattr(law.program, "solve", lambda *vectors: unsound)
    assert law(0.03, (5.99, 30.0)) == expected != first
    assert law.record.fallbacks == [(0.03, "no")]
