"""The worst case against single runs, and what it says of laws that are known to fail."""

from __future__ import annotations

import math

import numpy as np
import pytest

from controllers import LQG, PI, SoftTorque, StiffPI
from models import BitRock, BlockOnBelt, wells
from toolbox import Sampled, SceneError, closed_loop, compose, measure, simulate, worst_case
from toolbox.robustness import cycle_phases
from toolbox.steady_states.steady_loop import smooth_start

REFERENCE = 6.5
LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}


@pytest.fixture(scope="module")
def rig():
    return compose(wells.JANSEN_2, BitRock(weight=97_347.0))


@pytest.fixture(scope="module")
def stuck(rig):
    return simulate(rig, 200.0, controller=StiffPI(reference=REFERENCE, **LIMITS), sample_time=0.01)


@pytest.fixture(scope="module")
def found(rig, stuck):
    law = Sampled(LQG(reference=REFERENCE, delay_samples=3, **LIMITS), 0.01, 0.03)
    return worst_case(
        closed_loop(rig, law),
        120.0,
        uncertainty={"chain.inertia.0": (0.8, 1.2), "delay": 2.0},
        corners=[{"bit.weight": 0.9, "chain.inertia.1": 1.1}],
        starts=cycle_phases(stuck, 2),
    )


def test_the_phases_go_once_round_the_cycle_from_the_release(stuck):
    phases = cycle_phases(stuck, 8)
    periods = np.diff([event.time for event in stuck.events if event.before == "stick"])
    assert len(phases) == 8 and phases[0]["chain.speed"][1] == pytest.approx(0.0, abs=1e-9)
    fast = [phase["chain.speed"][1] for phase in phases]
    assert max(fast) > REFERENCE and periods[-1] == pytest.approx(periods[-2], rel=0.05)
    # the state a whole cycle on is the first one again
    releases = [event.time for event in stuck.events if event.before == "stick"]
    np.testing.assert_allclose(stuck.at(releases[-1])["chain.speed"].ravel(), phases[0]["chain.speed"], atol=0.2)


def test_every_outcome_is_that_of_its_own_run(rig, stuck, found):
    law = LQG(reference=REFERENCE, delay_samples=3, **LIMITS)
    cases = {
        "nominal": ({}, 0.03),
        "chain.inertia.0 -20 %": ({"chain.inertia.0": 0.8 * 2122.0}, 0.03),
        "delay +100 %": ({}, 0.06),
        "bit.weight -10 %, chain.inertia.1 +10 %": ({"bit.weight": 0.9 * 97_347.0, "chain.inertia.1": 1.1 * 374.0}, 0.03),
    }
    for outcome in found.outcomes:
        if outcome.error not in cases:
            continue
        changed, delay = cases[outcome.error]
        inputs = {name: value for name, value in changed.items() if name == "bit.weight"}
        parameters = {name: value for name, value in changed.items() if name not in inputs}
        start = cycle_phases(stuck, 2)[outcome.start]
        run = simulate(rig, 120.0, controller=Sampled(law, 0.01, delay), start=start, inputs=inputs, parameters=parameters)
        extent = measure.extent(run, "top.torque", 84.0)
        assert outcome.stuck == pytest.approx(run.time_in("bit", "stick", after=84.0) / 36.0, abs=1e-5)
        assert outcome.mean_error == pytest.approx(measure.extent(run, "bit.speed", 84.0).mean / REFERENCE - 1.0, abs=1e-5)
        assert outcome.ripple == pytest.approx((extent.maximum - extent.minimum) / 2 / extent.mean, abs=1e-4)


def test_a_drive_that_is_lighter_than_declared_is_the_worst_case_of_the_regulator(found):
    assert not found.survives and found.worst.error == "chain.inertia.0 -20 %"
    assert found.by_error["nominal"].excess <= 1.0  # the law itself is well on the nominal plant
    text = str(found)
    assert "2 of 10 runs fail, the worst with chain.inertia.0 -20 %" in text and "LQG, sampled every 10 ms" in text
    assert len(found.outcomes) == 10 and next(iter(found.by_error)) == "nominal"


def test_a_law_that_sticks_fails_by_more_than_one_that_swings(rig, stuck):
    stiff = worst_case(closed_loop(rig, Sampled(StiffPI(reference=REFERENCE, **LIMITS), 0.01)), 100.0, starts=cycle_phases(stuck, 2))
    assert not stiff.survives and stiff.worst.stuck > 0.1 and stiff.worst.excess == math.inf
    calm = worst_case(
        closed_loop(rig, Sampled(StiffPI(reference=REFERENCE, **LIMITS), 0.01)), 100.0
    )  # from smooth running the same law is free
    assert calm.survives and calm.worst.ripple < 0.01


def test_seeds_are_used_where_there_is_noise(rig):
    law = Sampled(SoftTorque(reference=9.0), 0.01, noise={"top.speed": 0.01})
    noisy = worst_case(closed_loop(rig, law), 60.0, seeds=(1, 2, 3))
    assert [outcome.seed for outcome in noisy.outcomes] == [1, 2, 3]
    assert len({outcome.ripple for outcome in noisy.outcomes}) == 3
    assert len(worst_case(closed_loop(rig, Sampled(SoftTorque(reference=9.0), 0.01)), 60.0, seeds=(1, 2, 3)).outcomes) == 1


def test_a_machine_on_which_smooth_running_grows_is_no_success_however_calm_the_window(rig):
    """On the nominal plant the drive leaves smooth running in 1000 s, of which 100 s show nothing; with less weight it stays."""
    loop = closed_loop(rig, PI(4_000.0, 1_500.0, reference=3.985))
    start = {**smooth_start(loop), "chain.speed": np.full(2, 3.985)}
    calm = worst_case(loop, 100.0, uncertainty={"bit.weight": 0.98}, starts=[start])
    declared, light = calm.outcomes
    assert declared.stuck == light.stuck == 0.0 and declared.ripple < 0.05 and abs(declared.mean_error) < 0.02
    assert declared.rate > 0 > light.rate and declared.failure.startswith("grows in") and not declared.excess <= 1.0
    assert light.excess <= 1.0 and not light.failure
    assert "1 of 2 runs fail, the worst with nominal" in str(calm) and declared.failure in str(calm)


def test_a_window_before_the_first_stick_is_no_success(rig):
    """A drive that holds its speed keeps smooth running and stick-slip alike: a bit that has slowed down is followed to which of them it goes."""
    loop = closed_loop(rig, StiffPI(reference=REFERENCE, **LIMITS))
    wide = {"mean_within": 10.0, "ripple_within": 10.0, "after": 0.05}
    slow, near = (
        worst_case(loop, 0.2, starts=[{**smooth_start(loop), "chain.speed": [REFERENCE, bit]}], **wide).worst
        for bit in (0.2 * REFERENCE, 0.9 * REFERENCE)
    )
    assert slow.stuck == near.stuck == 0.0 and slow.rate == near.rate < 0
    assert slow.failure == "stick-slip later" and slow.excess == math.inf
    assert not near.failure and near.excess <= 1.0


def test_the_result_draws_every_run(found):
    stuck, ripple = found.plot()
    assert [label.get_text().replace("\n", " ") for label in stuck.get_yticklabels()] == list(found.by_error)
    assert sum(line.get_xdata().size for line in ripple.lines) == len(found.outcomes)


@pytest.mark.parametrize(
    ("typed", "factors"),
    [
        ("20%", (0.8, 1.2)),
        ("±20 %", (0.8, 1.2)),
        ("+- 20 %", (0.8, 1.2)),
        ("+20%", (1.2,)),
        ("-5 %", (0.95,)),
        (["10%", 1.3], (0.9, 1.1, 1.3)),
        (0.2, (0.2,)),
    ],
)
def test_a_share_is_an_error_to_either_side_as_on_the_command_line(rig, typed, factors):
    """`margins --uncertainty bit.weight=20%` tries 20 % less and 20 % more; it was a factor of 0.2 here."""
    loop = closed_loop(rig, SoftTorque(reference=REFERENCE))
    found, same = (worst_case(loop, 2.0, uncertainty={"bit.weight": given}) for given in (typed, factors))
    assert list(found.by_error) == list(same.by_error) == ["nominal", *(f"bit.weight {100 * (each - 1):+.3g} %" for each in factors)]
    assert [each.mean_error for each in found.outcomes] == [each.mean_error for each in same.outcomes]


def test_mistakes_are_told(rig, stuck):
    law = Sampled(SoftTorque(reference=REFERENCE), 0.01)
    for arguments, word in (
        ({"uncertainty": {"chain.inertia": 0.8}}, "chain.inertia.0"),
        ({"uncertainty": {"chain.inertai.0": 0.8}}, "chain.inertia"),
        ({"uncertainty": {"bit.weight": -1.0}}, "must be (> 0|a finite number)"),
        ({"uncertainty": {"bit.weight": (0.8, "x")}}, "must be (> 0|a finite number)"),
        ({"uncertainty": {"bit.weight": "-120 %"}}, "`bit.weight` must be > -1"),
        ({"uncertainty": {"bit.weight": "120 %"}}, "`bit.weight` must be > 0"),
        ({"corners": [{"bit.weight": "20 %"}]}, "must be one factor in `corners`, such as 1.2 or `.20 %`, but it is '?20 %"),
    ):
        with pytest.raises(SceneError, match=word):
            worst_case(closed_loop(rig, law), 10.0, **arguments)
    with pytest.raises(SceneError, match="continuously"):
        worst_case(closed_loop(rig, SoftTorque(reference=REFERENCE)), 10.0, uncertainty={"delay": 2.0})
    with pytest.raises(SceneError, match="duration"):
        worst_case(closed_loop(rig, law), 0.0)
    with pytest.raises(SceneError, match="count"):
        cycle_phases(stuck, 0)
    with pytest.raises(SceneError, match="release"):
        cycle_phases(simulate(compose(BlockOnBelt()), 0.5))
