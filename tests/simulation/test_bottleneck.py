"""A run that has spent its budget says what it spent it on: a cause for every kind of short step."""

from dataclasses import dataclass

import numpy as np
import pytest

from models import BlockOnBelt, Coulomb
from toolbox import Budget, BudgetError, Component, Equations, Sampled, TimeStepping, compose, quantity, simulate, sine, state

STILL = compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=1.0, kinetic=1.0)))


def law(t, y):
    return 0.1


@pytest.mark.parametrize(("arguments", "cause"), [
    ({"start": {"block.position": 1e3}, "parameters": {"block.load": 1e-3}}, r"`belt` switched \d+ times"),
    ({"controller": Sampled(law, 1e-3, measures="block.position", drives="block.force")}, r"a law samples every 0\.001 s"),
    ({"inputs": {"block.force": (np.arange(0.0, 100.0, 1e-3), np.random.default_rng(0).uniform(-0.1, 0.1, 100_000))}}, "tables of inputs turn or jump at"),
    ({"inputs": {"block.force": sine(0.0, 0.1, 1.0)}}, "inputs that vary in time let no step be longer than 0.3"),
    ({"method": TimeStepping(step=1e-3)}, r"its step is 0\.001 s"),
], ids=["switches", "samples", "tables", "waves", "time-stepping"])  # fmt: skip
def test_the_message_of_a_spent_budget_names_what_ends_the_steps(arguments, cause):
    steps = 100 if "wave" in cause or "vary" in cause else 500
    with pytest.raises(BudgetError, match=rf"used {steps} steps and reached t = .*{cause}"):
        simulate(STILL, 1e4 if cause.startswith("`") else 100.0, budget=Budget(steps=steps), **arguments)


@dataclass(frozen=True)
class Two(Component):
    """A slow mass, and a lag that follows its position faster by a stiffness ratio."""

    rate: float = quantity(1e5, "1/s", "of the lag", above=0)

    def equations(self, signal):
        x, v, z = state("slow.x", "m"), state("slow.v", "m/s"), state("lag.z", "m")
        return Equations(flow={x: v, v: -x, z: self.rate * (x - z)})


def test_the_message_of_a_spent_budget_names_the_state_and_the_time_constant_that_hold_it_up():
    start = {"slow.x": 1.0, "lag.z": 1.0}
    with pytest.raises(BudgetError, match=r"which `lag.z` asks for, at a plant whose fastest time constant is 1e-05 s \(method stiff") as failed:
        simulate(compose(Two()), 1e3, start=start, method="explicit", budget=Budget(steps=3000))
    assert failed.value.run.end < 1.0
    assert simulate(compose(Two()), 20.0, start=start, method="stiff", budget=Budget(steps=3000)).end == 20.0  # as it says


def test_without_a_stiff_part_the_message_names_no_time_constant():
    with pytest.raises(BudgetError, match=r"steps of about .* s, which `slow\.\w` asks for\.$"):
        simulate(compose(Two(rate=1.0)), 1e6, start={"slow.x": 1.0}, method="explicit", accuracy=1e-10, budget=Budget(steps=3000))
