"""A run that has spent its budget says what it spent it on: a cause for every kind of short step."""

from dataclasses import dataclass

import numpy as np
import pytest

from models import BlockOnBelt, Coulomb
from toolbox import Budget, Component, Equations, Sampled, compose, quantity, simulate, state
from toolbox.errors import BudgetError
from toolbox.inputs import sine
from toolbox.modelling import Hysteresis
from toolbox.simulation import EventExact, Explicit, Implicit

STILL = compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=1.0, kinetic=1.0)))


def law(t, y):
    return 0.1


@pytest.mark.parametrize(("duration", "steps", "arguments", "cause"), [
    (100.0, 500, {"controller": Sampled(law, 1e-3, measured_signals="block.position", actuated_signals="block.force")}, r"a law samples every 0\.001 s"),
    (100.0, 500, {"inputs": {"block.force": (np.arange(0.0, 100.0, 1e-3), np.random.default_rng(0).uniform(-0.1, 0.1, 100_000))}},
     "tables of inputs turn or jump at"),
    (100.0, 100, {"inputs": {"block.force": sine(0.0, 0.1, 1.0)}}, "inputs that vary in time let no step be longer than 0.3"),
], ids=["samples", "tables", "waves"])  # fmt: skip
def test_the_message_of_a_spent_budget_names_what_ends_the_steps(duration, steps, arguments, cause):
    with pytest.raises(BudgetError, match=rf"used {steps} steps and reached t = .*{cause}"):
        simulate(STILL, duration, method=EventExact(budget=Budget(steps=steps)), accuracy=1e-4, **arguments)


@dataclass(frozen=True)
class Triangle(Component):
    """x' = -1 or 1 between the thresholds of a switch."""

    def equations(self, signal):
        x = state("wave.x", "1")
        switch = Hysteresis("switch", x, -1.0, 1.0)
        return Equations(flow={x: 1 - 2 * switch.output}, elements=[switch])


def test_the_message_of_a_spent_budget_names_the_element_that_switches():
    with pytest.raises(BudgetError, match=r"used 500 steps and reached t = .*: `switch` switched \d+ times\.") as failed:
        simulate(compose(Triangle()), 1e5, method=EventExact(budget=Budget(steps=500)))
    assert f"`switch` switched {len(failed.value.run.events)} times" in str(failed.value)


@dataclass(frozen=True)
class Two(Component):
    """A slow mass, and a lag that follows its position faster by a stiffness ratio."""

    rate: float = quantity(1e5, "1/s", "of the lag", above=0)

    def equations(self, signal):
        x, v, z = state("slow.x", "m"), state("slow.v", "m/s"), state("lag.z", "m")
        return Equations(flow={x: v, v: -x, z: self.rate * (x - z)})


def test_the_message_of_a_spent_budget_names_the_state_and_the_time_constant_that_hold_it_up():
    start = {"slow.x": 1.0, "lag.z": 1.0}
    with pytest.raises(
        BudgetError, match=r"which `lag.z` asks for, at a plant whose fastest time constant is 1e-05 s \(method stiff"
    ) as failed:
        simulate(compose(Two()), 1e3, start=start, method=Explicit(budget=Budget(steps=3000)))
    assert failed.value.run.end < 1.0
    assert simulate(compose(Two()), 20.0, start=start, method=Implicit(budget=Budget(steps=3000))).end == 20.0  # as it says


def test_without_a_stiff_part_the_message_names_no_time_constant():
    with pytest.raises(BudgetError, match=r"steps of about .* s, which `(slow|lag)\.\w` asks for\.$"):
        simulate(compose(Two(rate=1.0)), 1e6, start={"slow.x": 1.0}, accuracy=1e-10, method=Explicit(budget=Budget(steps=3000)))
