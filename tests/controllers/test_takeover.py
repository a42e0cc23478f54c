"""Laws that take over from a drive in smooth running: no step of the torque, on the declared rig and on others."""

from __future__ import annotations

import numpy as np
import pytest

from controllers import (
    LQG,
    LQR,
    PI,
    ActiveDamping,
    HInfinity,
    ImpedanceSuperTwisting,
    ImplicitSlidingMode,
    LinearMPC,
    NonlinearMPC,
    SlidingMode,
    SoftTorque,
    StiffPI,
    StringObserverController,
    SuperTwisting,
    ZTorque,
)
from controllers.observers import DisturbanceObserver, Kalman, SlidingObserver
from models import BitRock, wells
from toolbox import Sampled, SceneError, closed_loop, compose, simulate
from toolbox.modelling import ObserverBasedController, Takeover

SPEED, AT, WEIGHT = 12.0, 40.0, 97_347.0
RIG = compose(wells.JANSEN_2, BitRock(weight=WEIGHT))
NUMBERS = {"reference": SPEED, "lowest_torque": 0.0, "highest_torque": 20_000.0}
RIGS = {
    "declared": (1.0, 1.0, 1.0, 1.0),
    "light drive, heavy bit, soft string": (0.8, 1.2, 0.8, 1.0),
    "heavy drive, light bit, stiff string": (1.2, 0.8, 1.2, 1.0),
    "all light": (0.8, 0.8, 0.8, 1.0),
    "light rock": (1.0, 1.0, 1.0, 0.8),
    "heavy rock": (1.0, 1.0, 1.0, 1.2),
}
STATES = (LQR, SlidingMode, ImplicitSlidingMode, SuperTwisting, ImpedanceSuperTwisting)
LAWS = {kind.__name__: kind(**NUMBERS) for kind in (StiffPI, PI, SoftTorque, ActiveDamping, ZTorque, HInfinity, LQG, *STATES)}
LAWS |= {f"{kind.__name__} on estimates": StringObserverController(kind(**NUMBERS), Kalman()) for kind in STATES}
LAWS |= {
    "LQR on a disturbance observer": StringObserverController(LQR(**NUMBERS), DisturbanceObserver()),
    "LQR on a sliding observer": StringObserverController(LQR(**NUMBERS), SlidingObserver()),
    "LQG, commands late": LQG(delay_samples=3, **NUMBERS),
    "PI with a rate limit": PI(torque_rate=20_000.0, **NUMBERS),
}
STRANGE = {"SlidingMode on estimates", "ImplicitSlidingMode on estimates"}
"""Laws whose filter trusts its drive and that swing on other rigs whatever way they start; see `studies.questions.drives`."""


def torques(run, period, at=AT):
    """Torque and speed before the takeover, and the torque of every sample after it."""
    held = run.at(np.arange(round(10.0 / period)) * period + at + period / 2)["top.torque"]
    return float(run.at(at - period / 2)["top.torque"]), held


def smooth(law, rig, period=0.01, at=AT):
    """Smooth running under soft torque, and for 40 s from a time on under the law; drive, bit, stiffness and weight in parts of the declared."""
    drive, bit, stiffness, weight = rig
    parameters = {"chain.inertia": (2122.0 * drive, 374.0 * bit), "chain.stiffness": (473.0 * stiffness,)}
    return simulate(
        RIG, at + 40.0, controller=Sampled(law, period), parameters=parameters, inputs={"bit.weight": weight * WEIGHT},
        start={"chain.speed": (SPEED, SPEED), "chain.twist": 18.0},
    )  # fmt: skip


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_a_law_begins_with_the_torque_that_acts(law):
    run = smooth(Takeover(SoftTorque(**NUMBERS), law, at=AT), RIGS["declared"])
    before, held = torques(run, 0.01)
    assert run.at(AT)["bit.speed"] == pytest.approx(SPEED, rel=0.01)
    assert abs(held[0] - before) <= 1e-6 * before
    assert np.abs(held / before - 1.0).max() <= 0.1  # and the seconds after it
    assert run.time_in("bit", "stick") == 0.0


@pytest.mark.parametrize("name", [name for name in LAWS if name not in STRANGE])
@pytest.mark.parametrize("rig", [name for name in RIGS if name != "declared"])
def test_on_another_rig_it_does_so_too_and_the_bit_does_not_stick(name, rig):
    run = smooth(Takeover(SoftTorque(**NUMBERS), LAWS[name], at=AT), RIGS[rig])
    before, held = torques(run, 0.01)
    assert abs(held[0] - before) <= 1e-6 * before
    assert run.time_in("bit", "stick") == 0.0


@pytest.mark.parametrize("law", [LinearMPC, NonlinearMPC])
@pytest.mark.parametrize("rig", RIGS)
def test_predictive_laws_begin_with_the_torque_that_acts(law, rig):
    """A drive that samples as slowly leaves the string swinging for longer; the law begins as if it did not."""
    at = 120.0
    run = smooth(Takeover(SoftTorque(**NUMBERS), law(**NUMBERS), at=at), RIGS[rig], period=0.1, at=at)
    before, held = torques(run, 0.1, at)
    assert abs(held[0] - before) <= 0.02 * before
    assert run.time_in("bit", "stick") == 0.0


def test_a_predictive_law_is_not_asked_before_it_takes_over():
    run = smooth(Takeover(SoftTorque(**NUMBERS), LinearMPC(**NUMBERS), at=AT), RIGS["declared"], period=0.1)
    (inside,) = run.controllers[0].inside
    assert len(inside.record.seconds) == round((80.0 - AT) / 0.1) and not inside.record.fallbacks
    back = smooth(Takeover(LinearMPC(**NUMBERS), SoftTorque(**NUMBERS), at=AT), RIGS["declared"], period=0.1)
    before, held = torques(back, 0.1)
    assert len(back.controllers[0].inside[0].record.seconds) == round(AT / 0.1)
    assert abs(held[0] - before) <= 1e-6 * before


def test_a_run_of_a_law_around_one_in_python_goes_on_from_its_end_as_if_it_had_never_been_cut():
    law = Takeover(SoftTorque(**NUMBERS), LinearMPC(**NUMBERS), at=2.05)
    loop = closed_loop(RIG, law, sample_time=0.1, start={"chain.speed": (SPEED, SPEED), "chain.twist": 18.0})
    whole, first = simulate(loop, 6.0), simulate(loop, 3.0)
    assert simulate(loop, 3.0, start=first.last).at(6.0)["bit.speed"] == pytest.approx(whole.at(6.0)["bit.speed"], rel=1e-9)


def test_laws_in_python_of_two_sample_times_are_refused():
    with pytest.raises(SceneError, match=r"inside of Takeover must say one sample time, but they say \[0.05, 0.1\] s"):
        simulate(RIG, 1.0, controller=Takeover(LinearMPC(), LinearMPC(period=0.05), at=0.5), sample_time=0.1)
    with pytest.raises(SceneError, match="`sample_time` must be 0.1 s, for which the law was designed"):
        simulate(RIG, 1.0, controller=Takeover(LinearMPC(), SoftTorque(), at=0.5), sample_time=0.01)


@pytest.mark.parametrize("kind", [LQR, SlidingMode])
def test_an_observer_that_does_not_know_where_the_string_is_kicks_the_drive(kind):
    # the twin: toolbox.modelling.ObserverBasedController starts its observer at rest
    run = smooth(Takeover(SoftTorque(**NUMBERS), ObserverBasedController(kind(**NUMBERS), Kalman()), at=AT), RIGS["declared"])
    before, held = torques(run, 0.01)
    assert np.abs(held / before - 1.0).max() > 0.3


def test_on_a_rig_at_rest_where_no_torque_acts_a_law_starts_from_its_start_values():
    run = simulate(RIG, 1.0, controller=SoftTorque(reference=8.0), sample_time=0.01)
    law = SoftTorque(reference=8.0).design(RIG)
    assert run.at(0.0)["top.torque"] == pytest.approx(law.proportional * 8.0)


def test_a_string_that_is_wound_up_is_taken_over_as_it_is():
    # at the end of a stick phase of the stiff drive: the law goes on from its torque, not from none
    stiff = StiffPI(reference=5.0, lowest_torque=0.0, highest_torque=20_000.0)
    alone = simulate(RIG, 60.0, controller=stiff, sample_time=0.01)
    at = round([event.time for event in alone.events if event.before == "stick" and event.time < 55.0][-1], 2)
    law = ZTorque(reference=5.0, lowest_torque=0.0, highest_torque=20_000.0)
    run = simulate(RIG, 60.0, controller=Takeover(stiff, law, at=at), sample_time=0.01)
    assert run.time_in("bit", "stick", until=at) > 5.0
    before, after = (float(run.at(at + shift)["top.torque"]) for shift in (-0.005, 0.005))
    assert before > 2000.0
    assert after == pytest.approx(before, rel=1e-9)
