"""Which method a run takes, which says why: without a method the fastest steps that locate events; by "auto" time stepping too, for many contacts."""

import math
import pickle
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

from models import BlockOnBelt, Coulomb, TorsionalChain
from studies.benchmarks.methods import names, pairs
from toolbox import Component, Equations, compose, quantity, simulate, state, time
from toolbox.errors import ZenoError
from toolbox.inputs import sine
from toolbox.modelling import Hysteresis

LONG = {"whirl", "predictive", "disk_stack", "elastic_slider", "elastic_pad"}
"""Scenes whose runs take long and are explicit or implicit by either way."""


@dataclass(frozen=True)
class Heated(Component):
    """A room with a thermostat without hysteresis: on below 20 K, off above, both leading back."""

    threshold: float = quantity(20.0, "K")

    def equations(self, signal):
        temperature = state("room.temperature", "K")
        off = Hysteresis("thermostat", temperature, self.threshold, self.threshold, signal_unit="K")
        return Equations(flow={temperature: (30.0 * (1 - off.output) - temperature) / 10.0}, elements=[off])


def test_few_contacts_are_run_with_located_events():
    plant = compose(BlockOnBelt())
    run = simulate(plant, 30.0, method="auto")
    assert (run.states == simulate(plant, 30.0, method="taylor").states).all()
    assert run.why == "event: 1 contact at an accuracy of 1e-06, Taylor series of order 16"
    assert run.why in str(run)
    assert pickle.loads(pickle.dumps(run)).why == run.why
    assert simulate(plant, 1.0, method="event").why == ""


def string(n):
    return TorsionalChain(inertia=(1.0,) * n, stiffness=(100.0,) * (n - 1), damping=(0.1,) * (n - 1))


@pytest.mark.parametrize(
    ("plant", "accuracy", "why"),
    [
        (BlockOnBelt(), 1e-6, "Taylor series of order 16: 2 states at an accuracy of 1e-06"),
        (BlockOnBelt(), 2e-5, "explicit steps: an accuracy of 2e-05 is not between 1e-09 and 1e-05"),
        (BlockOnBelt(), 9e-10, "explicit steps: an accuracy of 9e-10 is not between 1e-09 and 1e-05"),
        (string(6), 1e-5, "Taylor series of order 16: 11 states at an accuracy of 1e-05"),
        (string(7), 1e-6, "explicit steps: 13 states are more than 12"),
    ],
)
def test_without_a_method_steps_are_series_of_small_plants_at_a_fine_accuracy(plant, accuracy, why):
    plant = compose(plant)
    run = simulate(plant, 1.0, accuracy=accuracy, method=None)
    same = simulate(plant, 1.0, accuracy=accuracy, method="taylor" if why.startswith("Taylor") else "event")
    assert run.why == why
    assert (run.states == same.states).all()
    assert pickle.loads(pickle.dumps(run)).why == why


def test_without_a_method_a_sampled_law_and_a_plant_without_series_are_stepped_explicitly_without_a_warning(caplog):
    assert (
        simulate(compose(string(3)), 1.0, controller=lambda t, y: 1.0, sample_time=0.01, method=None).why
        == "explicit steps: a law is sampled"
    )
    cut = simulate(compose(BlockOnBelt()), 0.1, inputs={"block.force": ca.fmin(time, 0.05)}, method=None)
    assert cut.why == "explicit steps: an operation of the plant has no Taylor series"
    assert not caplog.records


def test_without_a_method_a_stiff_plant_is_stepped_implicitly():
    stiff = TorsionalChain(inertia=(1.0, 1.0, 1.0), stiffness=(1.0, 1e9), damping=(0.1, 0.5 * math.sqrt(1e9)))
    run = simulate(compose(stiff), 200.0, inputs={"top.torque": 1.0}, method=None)
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
        assert pair.default.error <= 10 * max(pair.default.accuracy, pair.explicit.error), pair.title


@pytest.mark.slow
def test_many_contacts_at_a_loose_accuracy_are_stepped_in_time():
    n = 60
    dry = TorsionalChain(
        inertia=(2122.0, *(800.0 / (n - 2),) * (n - 2), 374.0), stiffness=(473.0 * (n - 1),) * (n - 1), damping=(23.2 * (n - 1),) * (n - 1),
        top_drag=425.0, bit_drag=50.0, friction=Coulomb(static=1.0, kinetic=1.0), friction_load=(3000.0, *(2400.0 / (n - 2),) * (n - 2), 6000.0),
    )  # fmt: skip
    arguments = {"inputs": {"top.torque": sine(8000.0, 8000.0, 0.8 / (2 * math.pi))}}
    plant = compose(dry)
    run = simulate(plant, 10.0, method="auto", accuracy=1e-2, **arguments)
    assert run.why.startswith("time-stepping: 60 contacts at an accuracy of 0.01, steps of ")
    exact = simulate(plant, 10.0, accuracy=1e-6, **arguments)
    assert run.difference(exact) < 1e-2
    assert exact.time_in("chain.59", "stick") == pytest.approx(run.time_in("chain.59", "stick"), abs=0.05)


def test_endless_switching_is_passed_by_time_stepping_where_located_events_end_in_an_error():
    plant, start = compose(Heated()), {"room.temperature": 18.0}
    with pytest.raises(ZenoError):
        simulate(plant, 10.0, start=start, accuracy=1e-3)
    run = simulate(plant, 10.0, start=start, method="auto", accuracy=1e-3)
    assert run.why.startswith("time-stepping, steps of ")
    assert "element `thermostat` switches without end at t = 1.8" in run.why  # 10 ln(12 / 10) s
    assert np.abs(run["room.temperature"][run.time > 2.0] - 20.0).max() < 20.0 * 1e-3
    share = run.time_in("thermostat", "low", after=2.0) / 8.0
    assert share == pytest.approx(2 / 3, abs=0.01)  # of the heating, in the mean, holds 20 K against 30 K
