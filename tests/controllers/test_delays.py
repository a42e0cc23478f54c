"""Commands that come late: a law that knows it varies its torque hardly more than without delay, and one that does not know it chatters."""

from __future__ import annotations

from dataclasses import replace

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
from controllers.observers import Kalman
from controllers.string_model import drilling_point
from models import BitRock, wells
from studies.questions import chatter
from tests.plants import RIG
from toolbox import Sampled, SceneError, compose, simulate
from toolbox.inputs import sine

NUMBERS = {"reference": 12.0, "lowest_torque": 0.0, "highest_torque": 20_000.0}
SLIDING = (SlidingMode, ImplicitSlidingMode, SuperTwisting, ImpedanceSuperTwisting)
LAWS = {kind.__name__: lambda late, kind=kind: kind(delay_samples=late, **NUMBERS) for kind in SLIDING}
LAWS |= {
    f"{kind.__name__} on estimates": lambda late, kind=kind: StringObserverController(kind(**NUMBERS), Kalman(), delay_samples=late)
    for kind in (*SLIDING, LQR)
}
LAWS |= {
    kind.__name__: lambda late, kind=kind: kind(**NUMBERS) for kind in (StiffPI, PI, SoftTorque, ActiveDamping, ZTorque, HInfinity, LQR)
}
LAWS["LQG"] = lambda late: LQG(delay_samples=late, **NUMBERS)


def variation(law, late, period=0.01):
    """How much the torque moves in a second [N m/s] while the weight on bit sways, commands so many samples late."""
    inputs = {"bit.weight": sine(97_347.0, 5000.0, 0.3), "top.reference": 12.0}
    run = simulate(
        RIG,
        60.0,
        controller=Sampled(law, period, delay=late * period),
        start={"chain.speed": (12.0, 12.0), "chain.twist": 18.0},
        inputs=inputs,
    )
    assert run.time_in("bit", "stick", after=30.0) == 0.0
    torque = run.at((np.arange(round(20.0 / period)) + 0.5) * period + 40.0)["top.torque"]
    return float(np.abs(np.diff(torque)).sum()) / 20.0


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_with_one_to_three_samples_of_delay_a_law_varies_its_torque_at_most_twice_as_much(law):
    prompt = variation(law(0), 0)
    for late in (1, 2, 3):
        assert variation(law(late), late) <= 2.0 * prompt


@pytest.mark.slow
@pytest.mark.parametrize("kind", [LinearMPC, NonlinearMPC])
def test_predictive_laws_do_so_too(kind):
    prompt = variation(kind(**NUMBERS), 0, 0.1)
    for late in (1, 2, 3):
        assert variation(kind(delay=0.1 * late, **NUMBERS), late, 0.1) <= 2.0 * prompt


def test_an_implicit_sign_that_does_not_know_of_one_sample_of_delay_chatters():
    torques = chatter.late_torques()["implicit"]
    assert torques[1, 0] > 100.0 * torques[0, 0]
    assert (torques[1:, 1] < 1.1 * torques[0, 0]).all()


def test_estimates_for_the_instant_of_arrival_are_those_of_the_string_then_and_not_now():
    # no rock, no noise: the model is that of the string, but for a measurement that is held over a sample
    free, late, off = compose(wells.JANSEN_2, BitRock(weight=0.0)), 0.1, {}
    for h in (0.02, 0.01):
        law = StringObserverController(PI(reference=4.0), Kalman(), delay_samples=round(late / h))
        run = simulate(free, 30.0, controller=Sampled(law, h, delay=late), inputs={"top.reference": sine(4.0, 1.0, 0.1)})
        times = np.arange(15.0, 29.0, 0.1)
        seen, then, now = run.at(times + late + h / 2)["estimate.top.speed"], run.at(times + late)["top.speed"], run.at(times)["top.speed"]
        off[h] = np.abs(seen - then).max()
    assert np.abs(seen - now).max() > 0.05
    assert off[0.01] < 0.2 * np.abs(seen - now).max()
    assert off[0.01] < 0.6 * off[0.02]


def test_what_is_left_of_s_is_of_second_order_while_the_set_point_rises_and_of_first_where_nothing_is_learned():
    law = chatter.laws()["implicit"]
    blind = replace(law, adaptation_gain=0.0)
    for each, order in ((law, 2), (blind, 1)):
        left = [np.abs(chatter.held(each, h, rising=0.1)[1]).max() for h in (0.02, 0.01, 0.005)]
        assert np.divide(left[:-1], left[1:]) == pytest.approx([2.0**order, 2.0**order], rel=0.1)


def test_a_step_of_the_set_point_asks_for_no_more_than_the_reaching_rate():
    law = ImplicitSlidingMode(reference=8.0).design(RIG)
    _, x, _, _ = drilling_point(RIG, 8.0)
    start = {"chain.twist": x[0], "chain.speed": (8.0, 8.0)}
    run = simulate(
        RIG, 6.0, controller=law, sample_time=0.01, start=start, inputs={"top.reference": ((0.0, 5.0, 5.0, 6.0), (8.0, 8.0, 9.0, 9.0))}
    )
    torque = run.at(np.arange(490, 510) * 0.01 + 0.005)["top.torque"]
    assert np.abs(np.diff(torque)).max() < 2.5 * 2122.0 * law.reaching_rate


def test_samples_that_no_memory_holds_are_refused():
    with pytest.raises(SceneError, match="`delay_samples` must be an integer >= 0 and <= 100"):
        simulate(RIG, 1.0, controller=SlidingMode(delay_samples=-1), sample_time=0.01)
