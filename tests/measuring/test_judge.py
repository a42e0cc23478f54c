"""One judge of regimes: what comes back and how a disturbance grows decide, not a window of fixed length."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from controllers import PI, SoftTorque, StiffPI
from models import BitRock, BlockOnBelt, Coulomb, TorsionalChain, wells
from tests.relapsing import Relapsing
from toolbox import Sampled, closed_loop, compose, equilibrium, measure, simulate
from toolbox.measuring.judge import NOT_DECIDED, SMOOTH, STANDS, STICKS, SWINGS, Judge, Judged, Record
from toolbox.simulation.request import Request

RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
SWING = 5.6


def carried(plant, law, judge, start, **arguments):
    """What the judge says of a loop from a start, and the time that it took to say so [s]."""
    run = Request(closed_loop(plant, law, start=start, **arguments), 1.0).checked()
    judged, last = judge.carried(lambda state, duration: run.again(start=state, duration=duration, longest_step=duration / 256), run.start)
    return judged, last.time


def at(reference, rate):
    return Judge("bit", "bit.speed", SWING, reference, rate)


def beside(reference, part):
    """A start beside the smooth running of a PI, in parts of the speed of the bit."""
    rest = equilibrium(closed_loop(RIG, PI(), inputs={"top.reference": reference}))
    speed = (reference, (1.0 - part) * reference)
    return {"chain.twist": rest["chain.twist"], "chain.speed": speed, "pi.angle": rest["pi.angle"], "pi.started": 1.0}


@pytest.mark.parametrize(("reference", "interval", "rate"), [(3.0, 72.0, 0.222), (3.97, 374.0, 0.00282), (3.985, 647.0, 0.00071)])
def test_a_law_that_relapses_every_ten_minutes_sticks_and_slips(reference, interval, rate):
    law = Sampled(Relapsing(), 0.01)
    judged, _ = carried(RIG, law, at(reference, rate), {"chain.speed": (reference, 0.0)}, inputs={"top.reference": reference})
    assert judged.regime == STICKS and judged.interval == pytest.approx(interval, rel=2e-3)
    # its twin: a run of two minutes after a lull shows nothing
    run = simulate(RIG, 0.9 * interval, controller=law, start={"chain.speed": (reference, 0.0)}, inputs={"top.reference": reference})
    last = measure.stick_intervals(run, "bit")[-1][1]
    assert run.end - last > 0.5 * interval


def test_a_swing_that_grows_with_four_minutes_is_not_smooth_and_is_carried_on_until_it_sticks():
    """From a deviation of a part in a thousand it takes half an hour to the first stick."""
    reference, law = 3.96, Sampled(PI(), 0.01)
    start = beside(reference, 1e-3)
    judged, time = carried(RIG, law, at(reference, 0.0042594), start, inputs={"top.reference": reference})
    assert judged.regime == STICKS and time > 1000.0
    window = simulate(RIG, 80.0, controller=law, start=start, inputs={"top.reference": reference})
    assert measure.stick_intervals(window, "bit") == [] and measure.severity(window, "bit.speed", 40.0) < 0.01
    assert at(reference, 0.0042594).of_run(window, 40.0).regime == NOT_DECIDED


def test_a_swing_that_grows_until_the_budget_is_spent_is_not_decided():
    """Chaos rises and falls until then, and swings: `tests/onsets/test_verdicts.py` has a pad whose squeal never repeats."""
    reference, rate = 3.96, 0.0042594
    judge = replace(at(reference, rate), budget=40)
    judged, time = carried(RIG, Sampled(PI(), 0.01), judge, beside(reference, 1e-2), inputs={"top.reference": reference})
    assert judged.regime == NOT_DECIDED and time == pytest.approx(40 * SWING)


def test_a_run_that_has_drawn_near_to_a_known_round_comes_to_it():
    law, start, inputs = SoftTorque(reference=6.0), {"chain.speed": (6.0, 0.0)}, {"top.reference": 6.0}
    judged, time = carried(RIG, law, at(6.0, -0.3), start, inputs=inputs)
    again, sooner = carried(RIG, law, replace(at(6.0, -0.3), known=[judged]), start, inputs=inputs)
    assert sooner < 0.7 * time and again.regime == STICKS and again.sticks == 1
    assert (again.interval, again.longest) == pytest.approx((judged.interval, judged.longest), rel=0.01)
    other = replace(judged, interval=1.05 * judged.interval)
    assert carried(RIG, law, replace(at(6.0, -0.3), known=[other]), start, inputs=inputs) == (judged, time)


def seen(away, judge):
    """A record of windows without a stick in which the signal went so far from its target, in parts of it."""
    record = Record("bit", "bit.speed", 1e-6, 2 * judge.swing, first=0.0, now=2 * judge.swing * len(away))
    low, high = judge.target * (1 - away), judge.target * (1 + away)
    edges = 2 * judge.swing * np.arange(len(away) + 1)
    record.windows = np.column_stack([low, high])
    record.steps = [np.stack([edges[:-1], edges[1:], low, high, judge.target * np.diff(edges)])]
    return record


def test_swings_that_beat_fall_to_smooth_running_that_is_known_as_a_small_deviation_does():
    """The windows of two swings that die alike show their sum and their difference by turns: no three rates in a row are that of a small deviation."""
    judge = at(12.0, -0.03)
    count, beat = np.arange(12), np.tile([1.0, 0.85, 1.05], 4)
    away = 0.3 * np.exp(judge.rate * 2 * SWING * count) * beat
    known = replace(judge, known=[Judged(SMOOTH)])
    assert judge.decided(seen(away, judge)) is None
    assert known.decided(seen(away, judge)).regime == SMOOTH
    assert known.decided(seen(away[:8], judge)) is None  # too few windows
    for other in (0.7, 1.3):  # what falls otherwise, as on the way to a swing or past one, is carried on
        assert known.decided(seen(0.3 * np.exp(other * judge.rate * 2 * SWING * count) * beat, judge)) is None
    slower = 0.1 + 0.2 * np.exp(judge.rate * 2 * SWING * count) * beat
    assert known.decided(seen(slower, judge)) is None
    grows = replace(known, rate=0.03)
    assert grows.decided(seen(0.003 * np.exp(0.03 * 2 * SWING * count) * beat, judge)) is None


def test_smooth_running_that_is_known_hides_no_stick_slip():
    law, start, inputs = SoftTorque(reference=6.0), {"chain.speed": (6.0, 0.0)}, {"top.reference": 6.0}
    judged, time = carried(RIG, law, at(6.0, -0.3), start, inputs=inputs)
    assert carried(RIG, law, replace(at(6.0, -0.3), known=[Judged(SMOOTH)]), start, inputs=inputs) == (judged, time)


def test_a_run_that_takes_long_is_looked_at_in_longer_pieces_and_ends_with_its_budget():
    looked = []

    def run_on(state, duration):
        looked.append(duration)
        return run.again(start=state, duration=duration)

    loop = closed_loop(RIG, Sampled(PI(), 0.01), start=beside(9.0, 1e-2), inputs={"top.reference": 9.0})
    run = Request(loop, 1.0).checked()
    judge = replace(at(9.0, 1e-9), budget=400)  # a rate with which nothing falls
    judged, last = judge.carried(run_on, run.start)
    assert judged.regime == NOT_DECIDED and last.time == pytest.approx(400 * SWING)
    assert len(looked) < 30 and looked[0] == 8 * SWING and max(looked) <= sum(looked) / 8


def test_stick_slip_beyond_its_end_is_smooth_and_before_it_lasts():
    law = SoftTorque(reference=6.0)
    inside = carried(RIG, law, at(6.0, -0.3), {"chain.speed": (6.0, 0.0)}, inputs={"top.reference": 6.0})[0]
    beyond = carried(RIG, law, at(9.0, -0.3), {"chain.speed": (9.0, 0.0)}, inputs={"top.reference": 9.0})[0]
    assert (inside.regime, beyond.regime) == (STICKS, SMOOTH)
    assert inside.sticks == 1 and inside.severity > 1.0 and beyond.severity < 0.01


def test_a_bit_under_too_little_torque_stands():
    plant = compose(wells.NAVARRO_LOPEZ_4, BitRock())
    judge = Judge("bit", "bit.speed", 10.0)
    assert carried(plant, None, judge, {}, inputs={"top.torque": 9000.0})[0].regime == STANDS
    assert carried(plant, None, judge, {}, inputs={"top.torque": 13_000.0})[0].regime != STANDS


def test_a_bit_whose_force_rests_while_the_drive_winds_up_the_string_above_does_not_stand():
    """The collars stick to the hole above a bit on the rock, and swing fast against it: for seconds the force of the bit does not change at all."""
    chain = TorsionalChain(
        inertia=(2122.0, 300.0, 60.0),
        stiffness=(473.0, 4e5),
        damping=(23.2, 1.0),
        top_drag=2000.0,
        friction=Coulomb(1.0, 0.6),
        friction_load=(9000.0,),
        friction_at=(1,),
    )
    plant = compose(chain, BitRock(weight=50e3))
    judge = Judge("bit", "bit.speed", 0.05, budget=4000)
    assert carried(plant, StiffPI(), judge, {}, inputs={"top.reference": 8.0})[0].regime == STICKS
    assert carried(plant, None, judge, {}, inputs={"top.torque": 5000.0})[0].regime == STANDS


def test_a_block_on_a_belt_sticks_and_slips_and_one_with_damping_comes_to_slide_smoothly():
    judge = Judge("belt", "belt.slip", 2 * math.pi)
    judged, _ = carried(compose(BlockOnBelt()), None, judge, {})
    assert judged.regime == STICKS and judged.sticks == 1
    run = simulate(compose(BlockOnBelt()), 100.0)
    cycle = measure.cycles(run, "belt", 50.0)[0]
    assert judged.interval == pytest.approx(cycle.period, rel=1e-4) and judged.longest == pytest.approx(cycle.stick, rel=1e-4)


def test_a_swing_without_a_stick_comes_back_with_its_severity():
    """Between the end of stick-slip and the Hopf speed of Thomsen and Fidlin the block swings and never sticks."""
    from models import closed_forms, oscillators

    block = oscillators.THOMSEN_FIDLIN
    plant = compose(block)
    speed = 0.5 * (closed_forms.stick_slip_speed(block) + oscillators.hopf_speed(block))
    judge = Judge("belt", "belt.slip", 2 * math.pi, -speed, 1e-3)
    judged, time = carried(plant, None, judge, {"block.position": 0.5}, parameters={"block.belt_speed": speed})
    assert judged.regime == SWINGS and 0.05 < judged.severity < 1.0 and judged.sticks == 0
    run = simulate(plant, time, start={"block.position": 0.5}, parameters={"block.belt_speed": speed})
    assert judged.severity == pytest.approx(
        measure.severity(run, "belt.slip", time - 4 * math.pi), rel=1e-2
    )  # of a window, which holds no whole swings


def test_noise_does_not_hide_that_the_same_stick_comes_back():
    law = Sampled(SoftTorque(reference=6.0), 0.05, noise={"top.speed": 0.1}, seed=11)
    judged, _ = carried(RIG, law, at(6.0, -0.3), {"chain.speed": (6.0, 0.0)})
    assert judged.regime == STICKS and np.isfinite(judged.interval)
