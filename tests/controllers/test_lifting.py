"""A law that lifts its set-point: from inside stick-slip it holds what it otherwise holds only in smooth running, and it leaves smooth running alone."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from controllers import PI, Lifting, LinearMPC, NonlinearMPC, StiffPI, ZTorque
from models import BitRock, wells
from studies import gains
from studies.protocol import Law, Rig
from studies.questions.drives import run_of
from toolbox import Sampled, SceneError, compose, simulate
from toolbox.modelling import Takeover

RIG = compose(wells.JANSEN_2, BitRock())
LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}
HEAVY = {"chain.inertia": (1.2 * 2122.0, 374.0)}
SPEED = 4.5


def inner(reference=SPEED):
    return ZTorque(reference=reference, **gains.stored("Z-torque"), **LIMITS)


def inside(law, at):
    """200 s on a heavy drive, the law taking over from a stiff drive inside stick-slip."""
    both = Takeover(StiffPI(reference=SPEED, **LIMITS), law, at=at)
    late = Sampled(both, 0.01, delay=0.03, noise={"top.speed": 0.01}, seed=7)
    return simulate(RIG, 240.0, controller=late, parameters=HEAVY, inputs={"top.reference": SPEED})


def test_it_ends_a_stick_slip_that_the_law_inside_does_not_at_every_phase():
    stuck = {"alone": [], "lifting": []}
    for at in (40.0, 42.0, 44.0, 46.0):
        for name, law in (("alone", inner()), ("lifting", Lifting(law=inner(), reference=SPEED))):
            run = inside(law, at)
            assert run.time_in("bit", "stick", until=at) > 5.0
            stuck[name].append(run.time_in("bit", "stick", after=160.0))
    assert stuck["lifting"] == [0.0] * 4
    assert max(stuck["alone"]) > 10.0
    assert run.at(240.0)["bit.speed"] == pytest.approx(SPEED, rel=0.02)


def test_a_stick_slip_at_which_the_top_of_a_stiffer_string_swings_by_a_fifth_is_ended():
    """A threshold of 0.3 does not see it: the lift ends at once, and the bit sticks for ever."""
    stiffer = Rig("stiffer", drive=1.2, bit=0.8, stiffness=1.2)
    soft = PI(proportional=803.0, integral=1457.0, reference=8.5, **LIMITS)
    stuck = {}
    for swing in (0.1, 0.3):
        law = Law("lifting", lambda reference, swing=swing: Lifting(law=soft, reference=reference, swing=swing))
        run = run_of(law, 8.5, stiffer, seed=101, phase=0.125)
        after = run.at(np.arange(100.0, 180.0, 0.05))
        stuck[swing] = run.time_in("bit", "stick", after=100.0)
    assert stuck[0.1] == 0.0
    assert stuck[0.3] > 10.0
    assert np.abs(after["top.speed"] / 8.5 - 1.0).max() == pytest.approx(0.21, abs=0.02)


def test_the_set_point_rises_at_its_rate_stays_and_comes_down_at_its_rate_to_what_was_asked():
    law = Lifting(law=inner(), reference=SPEED, rise=2.0, fall=0.1, hold=10.0)
    run = inside(law, 46.0)
    lifted = run.at(np.arange(47.0, 240.0, 0.05) + 0.001)["lifting.reference"]
    assert lifted.max() == pytest.approx(12.0, abs=1e-9)
    rates = np.diff(lifted) / 0.05
    assert rates.max() <= 2.0 * 1.21 and rates.min() >= -0.1 * 1.21  # a step of 0.05 s holds five or six samples
    assert lifted[-1] == pytest.approx(SPEED, abs=1e-9)


def test_smooth_running_is_left_alone():
    law = Lifting(law=inner(8.0), reference=8.0)
    run = simulate(RIG, 150.0, controller=Sampled(law, 0.01), inputs={"top.reference": ((0.0, 100.0, 110.0, 150.0), (8.0, 8.0, 9.0, 9.0))})
    after = run.at(np.arange(90.0, 150.0, 0.1))
    np.testing.assert_allclose(after["lifting.reference"], after["top.reference"], atol=0.011)  # held over a sample


@pytest.mark.parametrize("kind", [LinearMPC, NonlinearMPC])
def test_a_predictive_law_inside_is_lifted_from_rest_and_lowered_to_its_set_point(kind):
    law = Lifting(law=kind(reference=4.0, **LIMITS), reference=4.0)
    run = simulate(RIG, 90.0, controller=law, sample_time=0.1)
    assert run.at(20.0)["top.speed"] == pytest.approx(12.0, rel=0.05)
    assert run.at(90.0)["bit.speed"] == pytest.approx(4.0, rel=0.01)
    assert run.time_in("bit", "stick", after=20.0) == 0.0


def test_what_is_no_law_is_refused():
    with pytest.raises(SceneError, match="`law` must be a Controller"):
        simulate(RIG, 1.0, controller=dataclasses.replace(Lifting(law=inner()), law=3), sample_time=0.01)
