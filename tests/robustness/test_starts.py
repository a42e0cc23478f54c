"""Starts of judged runs: takeovers without a jump, on the plant that is judged, and the loop's own stick-slip."""

from __future__ import annotations

import math

import numpy as np
import pytest

from controllers import PI, SoftTorque, StiffPI
from models import BitRock, wells
from toolbox import Sampled, SceneError, closed_loop, compose, simulate, worst_case
from toolbox.drilling import AfterConnection, schedule
from toolbox.onsets.takeover import taken_over
from toolbox.robustness import FromRest, GivenStarts, OwnStickSlip, SmoothRunning, TakenOver, cycle_phases, smallest_error
from toolbox.scenes.situation import Situation

LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}


def rig(weight=97_347.0):
    return compose(wells.JANSEN_2, BitRock(weight=weight))


def loop_of(law, speed, weight=97_347.0, sampled=True):
    made = Sampled(law, "10 ms", delay="30 ms") if sampled else law
    return closed_loop(rig(weight), made, inputs={"top.reference": speed})


@pytest.fixture(scope="module")
def stick_slip():
    """A run in which the stiff drive sticks and slips at 7.9 rad/s."""
    return simulate(loop_of(StiffPI(), 7.9, sampled=False), 200.0)


@pytest.mark.parametrize("sampled", [True, False])
def test_a_controller_that_takes_over_begins_with_the_torque_that_acts(stick_slip, sampled):
    loop = loop_of(PI(), 7.9, sampled=sampled)
    for start in cycle_phases(stick_slip, 4):
        run = simulate(loop.replace(start=taken_over(loop, start)), 0.2)
        # the PI of the judged loop needs the angle (torque - proportional error) / integral to give the same torque
        error = 7.9 - float(np.atleast_1d(start["chain.speed"])[0])
        angle = (start["top.torque"] - 4000.0 * error) / 1500.0
        first = run.at(0.035 if sampled else 0.0)  # the first sample acts after its delay
        assert first["top.torque"] == pytest.approx(start["top.torque"], rel=0.03 if sampled else 1e-9)
        if not sampled:
            assert first["pi.angle"] == pytest.approx(angle, rel=1e-9)
        assert abs(first["top.torque"] - start["top.torque"]) < 0.1 * abs(
            4000.0 * error - start["top.torque"]
        )  # which it would be without angle


@pytest.mark.parametrize("torque", [-3000.0, 500.0, 9000.0, 26_000.0])
def test_a_continuous_controller_with_limits_takes_over_as_a_sampled_one_does(torque):
    """The angle is (torque - proportional error) / integral within its limits, beyond them, and if no small angle brings the command within them."""
    start = {"chain.twist": [20.0], "chain.speed": [2.0, 0.0], "top.torque": torque}
    loop = loop_of(PI(proportional=9000.0, **LIMITS), 7.9, sampled=False)
    given = taken_over(loop, start)
    assert given["pi.angle"] == pytest.approx((torque - 9000.0 * 5.9) / 1500.0, rel=1e-6)
    assert simulate(loop.replace(start=given), 1e-9).at(0.0)["top.torque"] == pytest.approx(min(max(torque, 0.0), 20_000.0), rel=1e-6)


def test_a_takeover_ends_the_stick_slip_that_a_jump_to_no_torque_would_keep(stick_slip):
    loop = loop_of(SoftTorque(**LIMITS), 7.9)
    bumpless = worst_case(loop, 200.0, starts=TakenOver(StiffPI(), 8))
    states = [{name: value for name, value in start.items() if name != "top.torque"} for start in cycle_phases(stick_slip, 8)]
    jump = worst_case(loop, 200.0, starts=states)
    assert bumpless.survives and not jump.survives
    assert worst_case(loop, 200.0, starts=cycle_phases(stick_slip, 8)).survives


def test_the_cycle_is_that_of_the_machine_that_is_judged():
    """At 12.46 rad/s the stiff drive of the rig is smooth; with 20 % more weight it sticks and slips."""
    loop = loop_of(SoftTorque(**LIMITS), 12.6)
    found = worst_case(loop, 60.0, starts=TakenOver(StiffPI(), 2), uncertainty={"bit.weight": "+20 %"})
    assert [outcome.error for outcome in found.outcomes] == ["nominal", "bit.weight +20 %", "bit.weight +20 %"]
    assert "no stick-slip to end under StiffPI" in str(found) and "(nominal)" in str(found)


def test_the_own_stick_slip_of_a_loop_goes_on_from_every_phase():
    loop = loop_of(SoftTorque(**LIMITS), 7.0)
    own = OwnStickSlip(3).on(loop)
    assert len(own.values) == 3 and own.period > 5.0
    for start in own.values:
        run = simulate(loop.replace(start=start), 4.2 * own.period)
        assert run.time_in("bit", "stick", after=3.0 * own.period) > 0.1 * own.period
        releases = [event.time for event in run.events if event.before == "stick"]
        np.testing.assert_allclose(np.diff(releases), own.period, rtol=0.02)
    found = worst_case(loop, 60.0, starts=OwnStickSlip(3))
    assert len(found.outcomes) == 3 and not any(outcome.excess <= 1.0 for outcome in found.outcomes)


def test_a_loop_without_stick_slip_of_its_own_has_no_runs_from_it():
    found = worst_case(loop_of(SoftTorque(**LIMITS), 12.6), 60.0, starts=OwnStickSlip())
    assert found.outcomes == () and "no stick-slip to start from" in str(found) and "was found" in str(found)
    with pytest.raises(SceneError, match="no run"):
        _ = found.worst


def test_the_smallest_error_says_what_exists_beside_smooth_running():
    loop = loop_of(SoftTorque(**LIMITS), 7.0)
    found = smallest_error(loop, {"bit.weight": 0.05}, 60.0)
    assert "started from smooth running" in str(found) and "4 of 4 runs of the nominal plant fail" in found.own_stick_slip
    calm = smallest_error(loop_of(SoftTorque(**LIMITS), 12.6), {"bit.weight": 0.05}, 60.0)
    assert "no stick-slip of its own was found" in calm.own_stick_slip


def test_phases_are_counted():
    for start in (TakenOver, OwnStickSlip):
        with pytest.raises(SceneError, match="phases"):
            start(StiffPI(), phases=0) if start is TakenOver else start(phases=0)


def test_smooth_running_starts_with_the_commands_it_holds():
    loop = loop_of(SoftTorque(**LIMITS), 9.0)
    (start,) = SmoothRunning().on(loop).values
    run = simulate(loop.replace(start=start), 5.0)
    assert np.abs(run["bit.speed"] / 9.0 - 1.0).max() < 0.06 and start["top.torque"] == pytest.approx(run["top.torque"].mean(), rel=0.1)


def test_a_situation_names_plant_start_design_surroundings_and_duration():
    loop = closed_loop(rig(), Sampled(SoftTorque(reference="75 rpm"), "10 ms", noise={"top.speed": 0.01}))
    words = str(Situation.of(loop, "smooth running", "60 s, judged from 42 s on"))
    for part in ("the nominal plant (2 inertias", "started from smooth running", "designed once", "75 rpm", "noise on top.speed", "60 s"):
        assert part in words, (part, words)
    quiet = closed_loop(rig(), SoftTorque(reference="75 rpm"))
    called = Sampled(lambda t, y: 8e3, "10 ms", measured_signals="top.speed", actuated_signals="top.torque", noise={"top.speed": 0.01})
    assert "constant inputs, no noise;" in str(Situation.of(quiet, "rest", "60 s"))
    assert "constant inputs, noise on top.speed;" in str(Situation.of(closed_loop(rig(), called), "rest", "60 s"))
    several = Situation.of(quiet, "rest", "60 s", cases={"quiet": quiet, "noisy": loop})
    assert "constant inputs, noise on top.speed under `noisy`;" in str(several)
    # two inertias J1, J2 on a spring k swing freely at sqrt(k (1 / J1 + 1 / J2))
    mode = math.sqrt(473.0 * (1 / 2122.0 + 1 / 374.0)) / (2 * math.pi)
    assert f"torsional mode at {mode:.3g} Hz" in words


def test_a_start_from_rest_is_the_run_of_the_loop_itself():
    """By a step it begins with nothing given; by a ramp the set-point comes up within the time of the ramp."""
    loop = loop_of(SoftTorque(**LIMITS), 9.5).replace(start={"bit.speed": 9.5})
    step, slow = FromRest().on(loop).loops(loop)[0], FromRest("30 s").on(loop).loops(loop)[0]
    assert dict(step.start) == dict(slow.start) == {} and step.inputs == loop.inputs
    np.testing.assert_allclose([slow.input_values["top.reference"].values[k] for k in (0, -1)], [0.02 * 9.5, 9.5])
    sticks = [simulate(each, 100.0).time_in("bit", "stick") for each in (step, slow)]
    worst = worst_case(loop, 100.0, starts=FromRest(), after=0.0)
    assert worst.outcomes[0].stuck == pytest.approx(sticks[0] / 100.0, rel=1e-6) and sticks[1] != sticks[0]


def test_a_connection_takes_the_weight_off_and_is_judged_when_it_is_on_again():
    loop = loop_of(SoftTorque(**LIMITS), 9.5)
    for begun, ramp in zip(AfterConnection().on(loop).loops(loop), (10.0, 20.0, 60.0), strict=True):
        table = begun.input_values["bit.weight"]
        assert table.values.max() == 97_347.0 and table.values.min() < 100.0 and table.times[-1] == 120.0 + ramp
    found = worst_case(loop, 60.0, starts=AfterConnection([20.0]))
    assert found.survives and "weight off for 90 s" in str(found)
    with pytest.raises(SceneError, match="has no constant one"):
        AfterConnection().on(loop.replace(inputs={**loop.inputs, "bit.weight": ((0.0, 10.0), (1e4, 2e4))}))


def test_given_values_are_a_start_as_well():
    assert GivenStarts([{"bit.speed": 1.0}]).words == "1 given start(s)"
    loop = loop_of(SoftTorque(**LIMITS), 9.5)
    given = [{"chain.speed": [9.5, 9.5], "chain.twist": [20.0]}]
    same = worst_case(loop, 60.0, starts=given), worst_case(loop, 60.0, starts=GivenStarts(given))
    assert same[0].outcomes == same[1].outcomes


def test_the_argument_that_a_start_replaced_is_refused_with_its_name_now():
    with pytest.raises(SceneError, match="`initial_controller` of `schedule` is now `starts`"):
        schedule(lambda depth: rig(), [1000.0, 2000.0], SoftTorque(), 10.0, initial_controller=StiffPI())


def test_a_single_run_begins_at_a_start_on_its_own_plant(stick_slip, caplog):
    loop = loop_of(SoftTorque(**LIMITS), 9.5)
    run = simulate(loop.plant, 1.0, controller=loop.controllers, inputs=loop.inputs, start=TakenOver(StiffPI(), 1))
    (start,) = TakenOver(StiffPI(), 1).on(loop).values
    assert run["chain.twist"][0] == pytest.approx(start["chain.twist"], rel=1e-9) and run["top.torque"][0] > 5000.0
    ramped = simulate(loop, 31.0, start=FromRest("30 s"))
    assert np.interp([0.0, 15.0, 30.0], ramped.time, ramped["top.reference"]) == pytest.approx([0.19, 4.845, 9.5], rel=1e-3)
    smooth = simulate(loop.replace(start={"bit.speed": 1.0}), 1.0, start=SmoothRunning())
    assert smooth["bit.speed"][0] == pytest.approx(0.98 * 9.5) and np.min(smooth["bit.speed"]) > 9.0
    assert not caplog.records
    simulate(loop.at("top.reference", 13.0), 1.0, start=TakenOver(StiffPI(), 1))  # the stiff drive has no stick-slip there
    assert "no stick-slip to end under StiffPI" in caplog.text


@pytest.mark.parametrize(
    ("start", "words"),
    [(TakenOver(StiffPI(), 2), "TakenOver begins 2: simulate each loop"), (OwnStickSlip(1), "no stick-slip of its own was found")],
)
def test_a_start_of_several_runs_or_none_begins_no_single_run(start, words):
    with pytest.raises(SceneError, match=words):
        simulate(loop_of(SoftTorque(**LIMITS), 9.5), 1.0, start=start)
