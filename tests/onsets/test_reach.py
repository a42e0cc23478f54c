"""From which starts the stick-slip beside smooth running is reached, beside runs that are counted one by one."""

from __future__ import annotations

import numpy as np
import pytest

from controllers import SoftTorque, StiffPI
from models import BitRock, wells
from toolbox import Sampled, closed_loop, compose, onset, simulate
from toolbox.onsets.takeover import taken_over, under_controller, under_held_commands

LIMITS = {"lowest_torque": 0.0, "highest_torque": 20e3}


@pytest.fixture(scope="module")
def loop():
    rig = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
    return closed_loop(rig, Sampled(SoftTorque(**LIMITS), "10 ms", delay="30 ms"), inputs={"top.reference": 7.0})


@pytest.fixture(scope="module")
def found(loop):
    return onset(loop, "top.reference", (6.5, 9.0), num_values=3, initial_controller=StiffPI())


def test_a_bistable_point_counts_the_starts_that_reach_its_stick_slip(loop, found):
    assert found.verdict(7.0) == "bistable"
    counted = {each.start: each for each in found.reached}
    sticks = 0
    for start in under_held_commands(loop):  # 500 s tell: a disturbance of smooth running dies in 9 s
        run = simulate(loop.replace(start=taken_over(loop, start)), 500.0)
        sticks += run.time_in("bit", "stick", after=450.0) > 0.0
    held = counted["the stick-slip under constant commands"]
    assert (held.reached, held.runs) == (sticks, 8)
    assert 0 < sticks < 8
    stopped, rest = counted["a stopped contact"], counted["rest"]
    assert stopped.runs == rest.runs == 1
    run = simulate(loop, 500.0)
    assert rest.reached == (run.time_in("bit", "stick", after=450.0) > 0.0)


def test_the_advice_says_what_reaches_the_stick_slip_and_what_does_not(found):
    text = found.advice
    assert "never ends by itself" not in text and "Once the loop is in this stick-slip (period 7." in text
    assert "It is reached from" in text and "the stick-slip under constant commands (" in text
    kicks = next(each for each in found.reached if each.start.startswith("a kick"))
    assert kicks.runs == 20 and (np.isnan(kicks.smallest) or 0.0 < kicks.smallest <= 4.0)
    assert "Holds for: the nominal plant" in str(found) and "small disturbance" in found.situation


def test_the_present_stick_slip_is_taken_over_where_another_one_exists_beside(loop, found):
    """Each of the 8 takeovers is a run of its own, as long as its verdict takes."""
    starts, note = under_controller(loop, StiffPI(), 8, 200.0)
    sticks = sum(simulate(loop.replace(start=start), 500.0).time_in("bit", "stick", after=450.0) > 0.0 for start in starts)
    present = next(each for each in found.reached if each.start.startswith("the stick-slip under StiffPI"))
    assert note == "" and (present.reached, present.runs) == (sticks, 8)
    assert str(present) in found.advice


def test_a_free_point_has_nothing_to_reach(loop):
    assert onset(loop.at("top.reference", 11.0), "top.reference", (10.5, 12.0), num_values=3).reached == ()


@pytest.mark.slow
def test_stick_slip_over_the_sample_time_ends_below_the_shortest_at_which_a_takeover_keeps_sticking():
    """Stick-slip under constant commands is taken over at 150 ms: one phase of it keeps sticking for 3000 s, none does at 140 ms."""
    rig = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
    loop = closed_loop(rig, Sampled(SoftTorque(reference="95 rpm"), "10 ms"))
    lasting = {}
    for period in (0.14, 0.15):
        at = loop.at("softtorque.sample_time", period)
        runs = [simulate(at.replace(start=taken_over(at, start)), 3000.0) for start in under_held_commands(at)]
        lasting[period] = any(run.time_in("bit", "stick", after=2900.0) > 0.0 for run in runs)
    assert lasting == {0.14: False, 0.15: True}
    found = onset(loop, "softtorque.sample_time", ("100 ms", "300 ms"), num_values=5)
    assert 0.14 < found.end < 0.15
