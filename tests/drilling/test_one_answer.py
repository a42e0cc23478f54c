"""One loop, one situation, one verdict: the same question asked through every verb that can ask it.

Five small loops, each from smooth running, from rest, taken over from a stiff drive, and from their own stick-slip. Every verb says whether the loop fails
there; all must say the same, and print the situation that their verdict holds for.
"""

from __future__ import annotations

import functools
import math

import pytest

from controllers import PI, SoftTorque, StiffPI
from models import BitRock, wells
from toolbox import Sampled, Scene, SceneError, closed_loop, compose, onset, severity_map, simulate, tune, worst_case
from toolbox.drilling import answers, schedule, windows
from toolbox.drilling.groups import machine_groups
from toolbox.drilling.set_points import Trial
from toolbox.measuring.judge import SMOOTH
from toolbox.onsets.coming_to import verdict_on
from toolbox.onsets.map_loop import SMOOTH as CALM
from toolbox.onsets.map_loop import STICK_SLIP, STUCK
from toolbox.probability import basin, chance, uncertain_onset
from toolbox.robustness import FromRest, OwnStickSlip, SmoothRunning, TakenOver, smallest_error
from toolbox.robustness.checks import Checks
from toolbox.steady_states.steady_loop import smooth_start

LIMITS = {"lowest_torque": 0.0, "highest_torque": 20e3}
WEIGHT = 97_347.0
LONG = 300.0
"""Length of the runs [s]: what they do not decide is carried on."""

TAKEN = TakenOver(StiffPI(), 2)
DOUBT = {"bit.friction.static": "0.8 +- 1e-9"}
"""A draw that is the nominal plant."""


def loop_of(law, sampled=True, delay="30 ms"):
    return closed_loop(compose(wells.JANSEN_2, BitRock(weight=WEIGHT)), Sampled(law, "10 ms", delay=delay) if sampled else law)


LOOPS = {
    "free": (loop_of(SoftTorque(reference=9.5, **LIMITS)), 9.5),
    "stick-slip beside": (loop_of(SoftTorque(reference=7.0, **LIMITS)), 7.0),
    "kept by the stiff drive": (loop_of(StiffPI(reference=8.0), sampled=False), 8.0),
    "smooth running is lost": (loop_of(PI(reference=3.5), sampled=False), 3.5),
    "grows by its delay": (loop_of(SoftTorque(reference=9.5, **LIMITS), delay="500 ms"), 9.5),
}


def of_run(loop, start):
    """The verdict on one run of a loop, as a study gives it."""
    return verdict_on(simulate(loop.replace(start=start), LONG), "bit", "bit.speed", 0.7 * LONG)[0].failed


def of_chance(loop, at, starts):
    found = chance(loop, {"top.reference": [at]}, DOUBT, draws=1, starts=starts)
    return bool(next(iter(found.chances.values()))[0] > 0.5), found


def of_check(tmp_path, loop, start):
    """Whether the check for tests fails on a run."""
    try:
        Checks(tmp_path).no_stick_slip(simulate(loop.replace(start=start), LONG), 0.7 * LONG)
    except AssertionError:
        return True
    return False


def of_onset(loop, at, starts):
    """Whether a drawn plant, which is the nominal one, is not free of stick-slip at the set-point in the middle of a narrow range."""
    found = uncertain_onset(loop, "top.reference", (at - 0.4, at + 0.4), DOUBT, draws=1, num_values=3, starts=starts)
    return bool(found.onset_values["as it is"][0] > at), found


def of_tune(loop, starts):
    """Whether the controller as given fails in a tuning, whose objective is the verdict; None if there is no run."""
    scene = Scene.of(loop.plant, LONG, {"asked": loop.controllers[0]}, after=0.7 * LONG)
    name = next(each for each in ("softtorque.detuning", "pi.proportional", "stiffpi.proportional") if each in loop.variable_numbers())
    value = loop.number(name).value
    found = tune(scene, "asked", still_fails, {name: (value, 1.001 * value)}, starts=starts, runs=10)
    return None if found.before.failed else found.before.values[0][0] > 0.0, found


def still_fails(run):
    return float(verdict_on(run, "bit", "bit.speed", 0.7 * LONG)[0].failed)


def of_schedule(loop, starts):
    """The verdict of a schedule whose plant is the same at both depths."""
    found = schedule(lambda _: loop.plant, [1000.0, 2000.0], loop.controllers[0], LONG, starts=starts)
    return not found.holds, found


@functools.cache
def answered(name):
    return answers({name: LOOPS[name][0]}, StiffPI(), phases=2, duration=LONG)


@functools.cache
def branches(name):
    loop, at = LOOPS[name]
    return onset(loop, "top.reference", (at - 0.4, at + 0.4), num_values=3)


@functools.cache
def mapped(name):
    loop, at = LOOPS[name]
    ranges = {"top.reference": (at - 0.4, at + 0.4), "bit.weight": (0.98 * WEIGHT, 1.02 * WEIGHT)}
    return severity_map(loop, ranges, shape=(3, 3), halvings=0)


def from_smooth_running(name, tmp_path):
    loop, at = LOOPS[name]
    start = smooth_start(loop)
    worst, kicked = worst_case(loop, LONG, starts=SmoothRunning()), basin(loop, {"bit.speed": (0.999 * at, 1.001 * at)}, 3)
    likely, drawn = of_chance(loop, at, SmoothRunning())
    yield "study", of_run(loop, start), None
    yield "worst_case", not worst.survives, worst
    yield "basin", kicked.share < 1.0, kicked
    yield "chance", likely, drawn
    yield "checks", of_check(tmp_path, loop, start), None
    yield "schedule", *of_schedule(loop, None)
    yield "uncertain_onset", *of_onset(loop, at, SmoothRunning())
    yield "tune", *of_tune(loop, SmoothRunning())
    middle = list(branches(name).values).index(at)
    yield "onset", branches(name).smooth[middle].regime != SMOOTH, branches(name)
    yield "severity_map", bool(mapped(name).smooth.verdict[1, 1] != CALM), mapped(name)
    try:
        smallest = smallest_error(loop, {"bit.weight": 1e-3}, LONG)
    except SceneError as refused:
        assert "must be a success on the nominal plant" in str(refused)
        yield "smallest_error", True, None
    else:
        yield "smallest_error", False, smallest


def from_rest(name, tmp_path):
    loop, at = LOOPS[name]
    worst, found = worst_case(loop, LONG, starts=FromRest()), answered(name)
    likely, drawn = of_chance(loop, at, None)
    yield "study", of_run(loop, {}), None
    yield "worst_case", not worst.survives, worst
    yield "chance", likely, drawn
    yield "chance from rest", *of_chance(loop, at, FromRest())
    yield "uncertain_onset", *of_onset(loop, at, FromRest())
    yield "tune", *of_tune(loop, FromRest())
    yield "answers", not found[name].starts["step"].passed, found
    yield "checks", of_check(tmp_path, loop, {}), None


def taken_over(name, tmp_path):
    loop, at = LOOPS[name]
    worst, found, starts = worst_case(loop, LONG, starts=TAKEN), answered(name), TAKEN.on(loop)
    yield "study", any(of_run(loop, start) for start in starts.values), None
    yield "worst_case", not worst.survives, worst
    yield "answers", not found[name].starts["takeover"].passed, found
    yield "schedule", *of_schedule(loop, TAKEN)
    yield "chance", *of_chance(loop, at, TakenOver(StiffPI(), 1))
    yield "uncertain_onset", *of_onset(loop, at, TakenOver(StiffPI(), 1))
    yield "tune", *of_tune(loop, TAKEN)
    if loop.is_sampled:
        nominal = machine_groups(loop, 0.0)["nominal"]
        yield "lowest_set_point", not Trial(loop, StiffPI()).outcome(nominal, at).passed, None


def from_own_stick_slip(name, tmp_path):
    """Whether the loop has a stick-slip of its own, which never ends by itself."""
    loop, at = LOOPS[name]
    own, found = worst_case(loop, LONG, starts=OwnStickSlip(2)), answered(name)
    middle = list(branches(name).values).index(at)
    yield "worst_case", bool(own.outcomes) and not own.survives, own
    yield "answers", not math.isnan(found[name].own_period), found
    yield "uncertain_onset", *of_onset(loop, at, OwnStickSlip(1))
    tuned, trials = of_tune(loop, OwnStickSlip(1))
    yield "tune", bool(tuned), trials
    yield "onset", bool(branches(name).cycling[middle]), branches(name)
    yield "severity_map", bool(mapped(name).sticking.verdict[1, 1] in (STICK_SLIP, STUCK)), mapped(name)
    ranges = {"top.reference": (at - 0.4, at + 0.4), "bit.weight": (0.98 * WEIGHT, 1.02 * WEIGHT)}
    try:
        beside = smallest_error(loop, {"bit.weight": 1e-3}, LONG)
    except SceneError:  # its smooth running fails already
        pass
    else:
        yield "smallest_error", "of 4 runs of the nominal plant fail" in beside.own_stick_slip, beside
    try:
        wide = windows(lambda _: loop.plant, [1000.0], loop.controllers[0], ranges, second_values=[WEIGHT], shape=(3, 3))
    except SceneError:
        return
    yield "windows", bool(wide.free_from[0, 0] > at), wide


SITUATIONS = {each.__name__: each for each in (from_smooth_running, from_rest, taken_over, from_own_stick_slip)}


@pytest.mark.slow
@pytest.mark.parametrize("situation", list(SITUATIONS))
@pytest.mark.parametrize("name", list(LOOPS))
def test_every_verb_tells_the_same_of_one_loop_in_one_situation(name, situation, tmp_path):
    told = list(SITUATIONS[situation](name, tmp_path))
    assert len({failed for _, failed, _ in told}) == 1, {verb: failed for verb, failed, _ in told}
    for verb, _, found in told:
        assert found is None or "Holds for:" in str(found), verb


def test_a_short_walk_tells_the_same_of_a_loop_with_a_stick_slip_of_its_own(tmp_path):
    """From rest this loop comes to smooth running late, or not at all: a study, a worst case and a check for tests say the same."""
    loop, _ = LOOPS["stick-slip beside"]
    failed = of_run(loop, {})
    assert worst_case(loop, LONG, starts=FromRest()).survives != failed
    assert of_check(tmp_path, loop, {}) == failed


def test_a_run_that_sticks_in_its_window_and_recovers_afterwards_has_recovered_for_every_verb():
    """One of two takeovers sticks once more in a window from 2 s to 20 s; both come to smooth running, and error and ripple are those that they have there."""
    loop = loop_of(SoftTorque(reference=8.5, **LIMITS))
    worst = worst_case(loop, 20.0, starts=TAKEN, after=2.0)
    told = [verdict_on(simulate(loop.replace(start=start), 20.0), "bit", "bit.speed", 2.0)[0] for start in TAKEN.on(loop).values]
    assert [outcome.verdict for outcome in worst.outcomes] == told == ["free", "recovered after 1 stick"]
    assert worst.survives and worst.outcomes[1].stuck > 0.05 and worst.worst.ripple < 1e-3
    kept = worst_case(loop.at("top.reference", 7.0), 60.0, starts=TAKEN, after=20.0)
    assert not kept.survives and kept.worst.verdict == "stick-slip"
