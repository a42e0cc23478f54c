"""method="auto": located events for few contacts, time stepping for many at a loose accuracy and where switching has no end; it says why."""

import math
import pickle
from dataclasses import dataclass

import numpy as np
import pytest

from models import BlockOnBelt, Coulomb, TorsionalChain
from toolbox import Component, Equations, compose, quantity, simulate, state
from toolbox.errors import ZenoError
from toolbox.inputs import sine
from toolbox.modelling import Hysteresis


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
    assert simulate(plant, 1.0).why == ""


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
