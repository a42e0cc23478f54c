"""Onset criteria for every law: laws that exist only sampled, predictive laws and Python functions, against long runs and other ways to the same number."""

import numpy as np
import pytest

from controllers import PI, Lifting, LinearMPC, SoftTorque, SuperTwisting
from models import BitRock, TorsionalChain, wells
from tests.onsets.test_growth import PythonPI
from toolbox import Sampled, closed_loop, compose, measure, onset, simulate

RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
HALF_AN_HOUR = 1800.0


def sticks_at(law, value, speed):
    """Whether the bit still sticks half an hour after it was held, under a top that is led from `speed` to a set-point: what nothing in `onset` uses."""
    ramp = ((0.0, 60.0, 60.0 + 400.0 * abs(value - speed)), (speed, speed, value))
    run = simulate(RIG, ramp[0][-1] + HALF_AN_HOUR, controller=law, inputs={"top.reference": ramp})
    return any(end > run.end - 60.0 for _, end in measure.stick_intervals(run, "bit"))


@pytest.mark.parametrize(
    ("law", "loss", "end", "way"),
    [(Sampled(SuperTwisting(), 0.01), 3.7279, 7.7388, "twin runs"), (Sampled(PI(), 0.01, delay=0.05), 3.9785797, 9.4801, "matrices")],
    ids=["super-twisting", "late PI"],
)
def test_a_law_that_is_only_sampled_has_both_borders(law, loss, end, way):
    found = onset(closed_loop(RIG, law), "top.reference", (3.0, 11.0), num_values=4)
    assert found.loss == pytest.approx(loss, abs=1e-3 if way == "twin runs" else 1e-6)
    assert found.losses[0].followed == way
    assert found.end == pytest.approx(end, abs=0.005)
    assert sticks_at(law, found.end - 0.02, 6.0) and not sticks_at(law, found.end + 0.02, 6.0)


@pytest.mark.slow
def test_a_law_that_lifts_relapses_up_to_where_the_swing_of_its_coming_down_dies():
    """Above the loss of smooth running a swing grows that is large enough: slowly, for a quarter of an hour, until the law lifts again."""
    loop = closed_loop(RIG, Sampled(Lifting(PI()), 0.01))
    found = onset(loop, "top.reference", (3.0, 6.0), num_values=4)
    assert found.loss == pytest.approx(3.990099, abs=1e-5)
    assert found.verdict(5.0) == "free" and not found.undecided
    assert 4.0006 < found.end < 1.05 * 1.05 * found.loss  # what has given up below the loss lives on
    for value, relapses in ((4.0006 - 0.005, True), (4.0006 + 0.005, False)):
        run = simulate(loop.at("top.reference", value), 7200.0)
        assert any(end > 3600.0 for _, end in measure.stick_intervals(run, "bit")) == relapses


@pytest.mark.slow
def test_stick_slip_under_a_law_that_has_given_up_is_led_to_where_it_tries_again():
    """Given up at 3.5 rad/s, again 5 % above it, it stays so for 5 % more: from smooth running there it never sticks."""
    loop = closed_loop(RIG, Sampled(Lifting(SoftTorque()), 0.01))
    found = onset(loop, "top.reference", (3.5, 4.1), num_values=3)
    assert found.loss == pytest.approx(3.69488, abs=1e-5)
    assert any("what the law remembers" in note for note in found.notes)
    lives = found.end - 0.01
    way = ((0.0, 1500.0, 1600.0, 3500.0, 3600.0, 5500.0), (3.5, 3.5, 3.676, 3.676, lives, lives))
    led, alone = (simulate(loop, 5500.0, inputs={"top.reference": reference}) for reference in (way, lives))
    assert led["lifting.gave_up"][-1] == pytest.approx(3.676) and alone["lifting.gave_up"][-1] == 0.0
    assert led.time_in("bit", "stick", after=5400.0) > 20.0 and alone.time_in("bit", "stick", after=5400.0) == 0.0
    assert lives > 1.04 * 3.676


@pytest.mark.slow
def test_a_python_function_has_the_borders_of_the_law_that_it_is():
    own, same = (
        onset(closed_loop(RIG, Sampled(law, 0.05)), "top.reference", (3.5, 10.5), num_values=3) for law in (PythonPI(PI(), 0.05), PI())
    )
    assert own.loss == pytest.approx(same.loss, abs=1e-5) and own.end == pytest.approx(same.end, abs=0.02)
    assert own.losses[0].followed == "differences"


@pytest.mark.slow
def test_a_predictive_law_has_both_borders():
    law = Sampled(LinearMPC(reference=6.0, lowest_torque=0.0, highest_torque=20_000.0), 0.1)
    found = onset(closed_loop(RIG, law), "top.reference", (2.0, 8.0), num_values=4)
    assert found.losses[0].followed == "differences"
    assert sticks_at(law, found.end - 0.02, 4.0) and not sticks_at(law, found.end + 0.02, 4.0)
    short, near = 20.0, found.loss
    # a disturbance of a part in a thousand grows below the loss and dies above it
    for value, grows in ((0.97 * near, True), (1.03 * near, False)):
        run = simulate(RIG, 400.0, controller=law, inputs={"top.reference": ((0.0, 100.0, 200.0), (8.0, 8.0, value))})
        early, late = (measure.extent(run, "bit.speed", after, after + short) for after in (220.0, 380.0))
        assert (late.maximum - late.minimum > early.maximum - early.minimum) == grows


def test_cycles_of_several_modes_that_live_side_by_side_are_told_with_their_ends():
    chain = TorsionalChain(inertia=(1302, 252, 784.5, 721), stiffness=(1487, 459.5, 793), damping=(8.26, 26.3, 22.8))
    rig = compose(chain, BitRock(weight=1e5))
    found = onset(closed_loop(rig, SoftTorque()), "top.reference", (1.5, 10.5), num_values=5)
    slow, fast = sorted(found.coexisting, key=lambda each: -each.period)
    assert slow.period > 5 * fast.period and "the swing of" in fast.begun
    assert found.end == pytest.approx(fast.high, abs=0.01) and slow.high < found.end - 1.0
    assert f"That of {slow.period:.3g} s ends first, that of {fast.period:.3g} s lives longest." in str(found)

    def sticks(*speeds, rate):
        """Sticks of the bit of a string that was stopped, while the set-point is raised at a rate."""
        raised = (
            (0.0, 600.0, 600.0 + (speeds[1] - speeds[0]) / rate, 2600.0 + (speeds[1] - speeds[0]) / rate),
            (*speeds[:1], *speeds[:1], *speeds[1:], *speeds[1:]),
        )
        return raised, measure.stick_intervals(
            simulate(rig, raised[0][-1], controller=SoftTorque(), inputs={"top.reference": raised}), "bit"
        )

    # an independent way: the set-point raised slowly; the fast cycle ends, the slow one has other rounds from its end on
    raised, held = sticks(3.75, 9.0, rate=1e-3)
    assert float(np.interp(held[-1][1], *raised)) == pytest.approx(found.end, rel=4e-3)
    rounds = [np.diff([begin for begin, _ in sticks(3.75, value, rate=1e-3)[1]])[-20:] for value in (slow.high - 0.02, slow.high + 0.02)]
    assert np.ptp(rounds[0]) < 1e-3 and rounds[0].mean() == pytest.approx(30.0, rel=0.01)
    assert rounds[1].min() < 10.0
