"""A run that goes on from the state in which another one ended: the pieces are one run, for every kind of law."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from controllers import PI, ImplicitSlidingMode, Lifting, LinearMPC, NonlinearMPC, SoftTorque, SuperTwisting
from tests.plants import BELT, RIG
from toolbox import Sampled, SceneError, measure, simulate
from toolbox.inputs import sine, step

STUCK = {"chain.speed": (6.0, 0.0)}
"""The bit is at rest under a turning top: stick-slip follows."""


class RememberingPI:
    """A PI law in Python whose sum is told by `get_memory`; without `tells`, its object is copied."""

    def __init__(self, reference: float = 6.0):
        self.reference, self.sum = reference, 0.0

    def __call__(self, t, y):
        error = self.reference - y[0]
        self.sum += 0.05 * error
        return 900.0 * error + 300.0 * self.sum


class TellingPI(RememberingPI):
    """The same with a lock, which cannot be copied."""

    def get_memory(self):
        return [self.sum]

    def set_memory(self, values):
        (self.sum,) = values


LAWS = {
    "continuous": PI(reference=6.0),
    "sampled": Sampled(PI(reference=6.0), "10 ms"),
    "late by more than a period": Sampled(SoftTorque(reference=6.0), "20 ms", delay="70 ms"),
    "late by a part of one, with noise": Sampled(PI(reference=6.0), "50 ms", delay="30 ms", noise={"top.speed": 0.05}, seed=3),
    "two clocks": [Sampled(PI(reference=6.0), "30 ms", delay="110 ms", noise={"top.speed": 0.02})],
    "super-twisting": Sampled(SuperTwisting(reference=6.0), "10 ms"),
    "implicit sliding mode": Sampled(ImplicitSlidingMode(reference=6.0), "10 ms"),
    "lifting": Sampled(Lifting(PI(reference=6.0)), "10 ms"),
    "Python object": Sampled(RememberingPI(), "50 ms", delay="120 ms", noise={"top.speed": 0.02}),
    "Python object that tells": Sampled(TellingPI(), "50 ms"),
    "linear MPC": Sampled(LinearMPC(reference=6.0, delay=0.15), "100 ms", delay="150 ms"),
}


def pieces(plant, cuts, **arguments):
    """Runs from each cut to the next, each from the state that the one before left."""
    found, before = [], 0.0
    for cut in cuts:
        if found:
            arguments["start"] = pickle.loads(pickle.dumps(found[-1].last))
        found.append(simulate(plant, cut - before, **arguments))
        before = cut
    return found


def apart(whole, parts, times=400):
    """Largest difference of a state of the pieces to the whole run, in parts of the largest value of the state."""
    size, worst = np.abs(whole.at(np.linspace(0.0, whole.end, 2000)).states).max(axis=0), 0.0
    for part in parts:
        at = np.linspace(part.begin, part.end, times)[:-1]
        worst = max(worst, float((np.abs(part.at(at).states - whole.at(at).states) / size).max()))
    return worst


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_pieces_cut_anywhere_equal_the_whole_run(law):
    arguments = {"controller": law, "start": STUCK, "accuracy": 1e-12}
    whole = simulate(RIG, 30.0, **arguments)
    first = measure.stick_intervals(whole, "bit")[0]
    # inside a stick, at a sample, between a sample and its delayed output, and anywhere
    cuts = sorted({0.5 * (first[0] + first[1]), 7.0, 7.075, 12.345678, 30.0})
    parts = pieces(RIG, cuts, **arguments)
    assert parts[1].begin == cuts[0] == parts[1].time[0] and parts[-1].end == pytest.approx(30.0)
    assert parts[1].modes["bit"][0] == "stick" or first[1] > cuts[1]
    assert apart(whole, parts) < 1e-9


def test_a_nonlinear_predictive_law_goes_on_where_it_was():
    law = Sampled(
        NonlinearMPC(reference=6.0, lowest_torque=0.0, highest_torque=12e3), "100 ms"
    )  # without limits its plans jump at round-off
    arguments = {"controller": law, "start": STUCK, "accuracy": 1e-12}
    whole = simulate(RIG, 8.0, **arguments)
    assert apart(whole, pieces(RIG, (2.33, 5.0, 8.0), **arguments)) < 1e-9


def test_inputs_and_clocks_are_those_of_absolute_time():
    inputs = {"bit.weight": sine(90_000.0, 9000.0, 0.17), "top.reference": step(6.0, 7.0, 4.0)}
    arguments = {"controller": Sampled(PI(), "70 ms", delay="40 ms"), "start": STUCK, "inputs": inputs, "accuracy": 1e-12}
    whole = simulate(RIG, 20.0, **arguments)
    parts = pieces(RIG, (1.0, 4.0, 11.111, 20.0), **arguments)
    assert apart(whole, parts) < 1e-9
    assert parts[2].at(11.0)["top.reference"] == 7.0


def test_without_the_state_of_the_law_a_run_does_not_go_on_as_it_was():
    """The twin of the tests above: with the memory at zero, states alone are far from the whole run."""
    arguments = {"controller": Sampled(PI(reference=6.0), "10 ms"), "accuracy": 1e-10}
    whole = simulate(RIG, 20.0, start=STUCK, **arguments)
    states = whole.at(10.0)
    anew = simulate(RIG, 10.0, start={name: states[name] for name in RIG.states}, **arguments)
    assert np.abs(anew.states[-1] - whole.states[-1]).max() > 0.1


def test_an_instant_of_a_sampled_run_with_memory_is_refused_as_a_start():
    law = {"controller": Sampled(PI(reference=6.0), "10 ms")}
    run = simulate(RIG, 2.0, **law)
    with pytest.raises(SceneError, match=r"run\.last"):
        simulate(RIG, 1.0, start=run.at(1.0), **law)
    assert simulate(RIG, 1.0, start=run.at(1.0), controller=PI()).time[0] == 0.0  # nothing sampled goes on
    continuous = simulate(RIG, 2.0, controller=PI(reference=6.0))
    assert simulate(RIG, 1.0, start=continuous.at(1.0), controller=PI(reference=6.0)).at(0.0)["pi.angle"] == continuous.at(1.0)["pi.angle"]


def test_another_law_or_another_clock_cannot_go_on_from_a_state():
    last = simulate(RIG, 1.0, controller=Sampled(PI(), "10 ms")).last
    with pytest.raises(SceneError, match=r"pi\.angle"):
        simulate(RIG, 1.0, start=last)
    with pytest.raises(SceneError, match="sample times"):
        simulate(RIG, 1.0, start=last, controller=Sampled(PI(), "20 ms"))
    python = simulate(RIG, 1.0, controller=Sampled(RememberingPI(), "50 ms")).last
    with pytest.raises(SceneError, match="another one"):
        simulate(RIG, 1.0, start=python, controller=Sampled(lambda t, y: 0.0, "50 ms"))


def test_a_law_that_can_neither_tell_nor_be_copied_has_no_state():
    class Locked(RememberingPI):
        def __deepcopy__(self, memo):
            raise TypeError("it holds a solver")

    run = simulate(RIG, 1.0, controller=Sampled(Locked(), "50 ms"))
    with pytest.raises(SceneError, match="get_memory"):
        _ = run.last


def test_a_run_that_goes_on_is_measured_saved_and_read_in_its_own_time(tmp_path):
    first = simulate(BELT, 10.0)
    second = simulate(BELT, 10.0, start=first.last, output_times=np.linspace(11.0, 20.0, 10))
    assert (second.begin, second.end, second.duration) == (10.0, 20.0, 10.0)
    assert second.time[0] == 11.0 and second.every_step.time[0] == 10.0
    assert second.intervals("belt")[0][0] == 10.0
    assert measure.stick_intervals(second, "belt") == measure.stick_intervals(second, "belt", 10.0)
    with pytest.raises(SceneError, match="between 10 and 20 s"):
        second.at(9.0)
    with pytest.raises(SceneError, match="between 10 and 20 s"):
        simulate(BELT, 10.0, start=first.last, output_times=[5.0])
    assert second.error_estimate < 1e-5
    again = type(second).load(second.save(tmp_path / "run.npz"))
    assert again.begin == 10.0 and again.intervals("belt") == second.intervals("belt")


def test_a_state_knows_its_entries_by_name():
    run = simulate(RIG, 1.0, controller=Sampled(PI(reference=6.0), "10 ms"))
    assert run.last["chain.twist"] == run.states[-1][run.program.system.states["chain.twist"][0]]
    assert run.last.taken == (100,) and run.last.time == 1.0
    assert run.last["top.torque"] == run["top.torque"][-1]
    slower = run.last.with_values({"chain.speed": run.last["chain.speed"] * (1.0, 0.99)})
    assert slower["chain.speed"][1] == 0.99 * run.last["chain.speed"][1] and slower["pi.angle"] == run.last["pi.angle"]
    with pytest.raises(SceneError, match="finite"):
        slower.with_values({"chain.speed": (1.0, 2.0, 3.0)})
    with pytest.raises(KeyError):
        run.last["pi.angel"]
