"""Which steps a run takes where none are named, which says why: the fastest that locate events."""

import math
import pickle

import casadi as ca
import pytest

from models import BlockOnBelt, TorsionalChain
from studies.benchmarks.methods import names, pairs
from toolbox import compose, simulate, time

LONG = {"whirl", "predictive", "disk_stack", "elastic_slider", "elastic_pad"}
"""Scenes whose runs take long and are explicit or implicit by either way."""


def string(n):
    return TorsionalChain(inertia=(1.0,) * n, stiffness=(100.0,) * (n - 1), damping=(0.1,) * (n - 1))


@pytest.mark.parametrize(
    ("plant", "accuracy", "why"),
    [
        (BlockOnBelt(), 1e-6, "Taylor series of order 16: 2 states at an accuracy of 1e-06"),
        (BlockOnBelt(), 2e-5, "explicit steps: an accuracy of 2e-05 is not between 1e-09 and 1e-05"),
        (BlockOnBelt(), 9e-10, "explicit steps: an accuracy of 9e-10 is not between 1e-09 and 1e-05"),
        (string(5), 1e-5, "Taylor series of order 16: 9 states at an accuracy of 1e-05"),
        (string(6), 1e-6, "explicit steps: 11 states are more than 9"),
    ],
)
def test_without_a_method_steps_are_series_of_small_plants_at_a_fine_accuracy(plant, accuracy, why):
    plant = compose(plant)
    run = simulate(plant, 1.0, accuracy=accuracy)
    same = simulate(plant, 1.0, accuracy=accuracy, method="taylor" if why.startswith("Taylor") else "explicit")
    assert run.why == why and why in str(run)
    assert (run.states == same.states).all()
    assert pickle.loads(pickle.dumps(run)).why == why


def test_without_a_method_a_sampled_law_and_a_plant_without_series_are_stepped_explicitly_without_a_warning(caplog):
    assert simulate(compose(string(3)), 1.0, controller=lambda t, y: 1.0, sample_time=0.01).why == "explicit steps: a law is sampled"
    cut = simulate(compose(BlockOnBelt()), 0.1, inputs={"block.force": ca.fmin(time, 0.05)})
    assert cut.why == "explicit steps: an operation of the plant has no Taylor series"
    assert not caplog.records


def test_without_a_method_a_stiff_plant_is_stepped_implicitly():
    stiff = TorsionalChain(inertia=(1.0, 1.0, 1.0), stiffness=(1.0, 1e9), damping=(0.1, 0.5 * math.sqrt(1e9)))
    run = simulate(compose(stiff), 200.0, inputs={"top.torque": 1.0})
    assert run.program.formulas.implicit
    assert run.why == "implicit steps, which stability makes the cheaper ones"


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in names() if name not in LONG])
def test_without_a_method_every_scene_switches_as_by_explicit_steps(name):
    for pair in pairs(name):
        if isinstance(pair, str):
            continue
        assert pair.sensitive or pair.same_switches, pair.title
        assert pair.sensitive or pair.shift <= pair.default.accuracy, pair.title
        assert pair.default.error_estimate <= 10 * max(pair.default.accuracy, pair.explicit.error_estimate), pair.title
