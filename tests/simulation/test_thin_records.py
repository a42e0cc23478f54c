"""Records of long chains: not every step is a node, and what is between two nodes is as exact as if it were."""

import gc
import pickle
import weakref

import numpy as np
import pytest

from controllers import PI
from models import BitRock, TorsionalChain
from models.friction import Exponential
from toolbox import compose, measure, simulate
from toolbox.errors import BudgetError
from toolbox.simulation import thin_records
from toolbox.simulation.budget import Budget
from toolbox.simulation.methods import Explicit


@pytest.fixture(scope="module")
def string():
    n = 4
    friction = {"friction": Exponential(static=1.0, kinetic=0.65, decay=1.0), "friction_load": (600.0,) * (n - 1)}
    chain = TorsionalChain(
        inertia=(2900.0, *(100.0,) * (n - 2), 400.0), stiffness=(1500.0,) * (n - 1), damping=(20.0,) * (n - 1), top_drag=425.0, **friction
    )
    return compose(chain, BitRock(weight=97_000.0))


@pytest.fixture
def thin(monkeypatch):
    monkeypatch.setattr(thin_records, "MOST", 40_000)
    monkeypatch.setattr(thin_records, "WIDE", 1)


JUMPING = {"top.torque": ([0.0, 100.0, 100.0, 400.0], [11_000.0, 12_000.0, 10_000.0, 11_000.0])}


@pytest.mark.parametrize("method", ["explicit", "taylor", "stiff"])
def test_a_run_that_leaves_steps_out_is_the_run_with_all_of_them(string, monkeypatch, method):
    whole = simulate(string, 400.0, inputs=JUMPING, method=method, accuracy=1e-8)
    monkeypatch.setattr(thin_records, "MOST", 40_000)
    monkeypatch.setattr(thin_records, "WIDE", 1)
    run = simulate(string, 400.0, inputs=JUMPING, method=method, accuracy=1e-8)
    assert run.time.size < 0.75 * whole.time.size
    assert run.passed.size + run.time.size == whole.time.size
    assert run.steps == whole.steps and run.events == whole.events
    assert np.isin([event.time for event in run.events], run.time).all()
    times = np.concatenate([np.linspace(0.0, 400.0, 301), run.passed[::7], run.passed[:-1:11] + 0.3 * np.diff(run.passed)[::11]])
    size = np.abs(whole.states).max(axis=0)
    for found in (run, pickle.loads(pickle.dumps(run))):
        assert (np.abs(found.at(times).states - whole.at(times).states) < 1e-7 * size).all()
        assert found.every_step.time.tobytes() == whole.time.tobytes() and found.every_step.mode.tobytes() == whole.mode.tobytes()
        assert (np.abs(found.every_step.states - whole.states) < 1e-7 * size).all()
    assert measure.extent(run, "bit.speed").maximum == pytest.approx(measure.extent(whole, "bit.speed").maximum, rel=1e-6)


def test_nodes_from_which_on_a_law_holds_something_else_stay(string, thin):
    run = simulate(string, 60.0, controller=PI(900.0, 400.0, reference=8.0), sample_time=0.05)
    assert run.passed.size > 0
    assert np.isin(np.arange(1, 1200) * 0.05, run.time).mean() > 0.99
    assert run.last.time == run.time[-1] == 60.0


def test_a_run_that_ends_early_knows_the_steps_that_it_left_out(string, thin):
    with pytest.raises(BudgetError) as caught:
        simulate(string, 400.0, inputs=JUMPING, method=Explicit(budget=Budget(events=250)))
    run = caught.value.run
    assert run.passed.size > 0 and run.passed[-1] < run.end
    assert run.every_step.time.size == run.time.size + run.passed.size


def test_without_many_states_every_step_is_a_node(string, monkeypatch):
    monkeypatch.setattr(thin_records, "MOST", 40_000)
    run = simulate(string, 400.0, inputs=JUMPING, method="explicit")
    assert run.passed.size == 0 and run.every_step is run


READS = {
    "every step": lambda run: run.every_step,
    "a measure": lambda run: measure.severity(run, "bit.speed"),
    "its events": lambda run: (run.events, run.last),
    "its error": lambda run: run.error_estimate,
    "a signal": lambda run: run["bit.speed"],
}


@pytest.mark.parametrize("output_times", [None, np.linspace(0.0, 20.0, 201)], ids=["every step recorded", "output times"])
@pytest.mark.parametrize("read", READS)
def test_a_run_leaves_memory_with_its_last_reference(string, read, output_times):
    """A study of a long string makes a thousand runs of 10 MB: a run that held itself would stay until Python looks for such circles."""
    run = simulate(string, 20.0, inputs={"top.torque": 11_000.0}, output_times=output_times)
    READS[read](run)
    gone = weakref.ref(run)
    gc.disable()
    try:
        del run
        assert gone() is None
    finally:
        gc.enable()
