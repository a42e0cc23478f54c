"""Blocks on a cart, where every contact acts on every other: closed forms, energy, and the same run with the equations written out."""

import numpy as np
import pytest

from studies.benchmarks.blocks_on_cart import BlocksOnCart, shaken
from toolbox import compose, energy_audit, simulate
from toolbox.compilation import bodies
from toolbox.modelling import elimination


@pytest.mark.parametrize("n", [3, 12, pytest.param(24, marks=pytest.mark.slow)])
@pytest.mark.parametrize("method", ["explicit", "stiff", "taylor"])
def test_blocks_let_go_one_after_the_other_at_the_times_of_the_closed_form(n, method):
    # all that still stick move as one body: block i lets go where m_i times its acceleration is the bound
    random = np.random.default_rng(n)
    mass, cart, rate = 0.2 + random.random(n), 3.0, 2.0
    limit = np.sort(1.0 + 4.0 * random.random(n))  # acceleration at which each lets go
    static = mass * limit
    run = simulate(
        compose(BlocksOnCart(cart=cart, mass=tuple(mass), stiffness=(0.0,) * n, static=tuple(static), kinetic=tuple(static))),
        60.0, inputs={"cart.force": ([0.0, 60.0], [0.0, 60.0 * rate])}, method=method, accuracy=1e-9,
    )  # fmt: skip
    moving = cart + mass[::-1].cumsum()[::-1]
    sliding = np.concatenate([[0.0], static.cumsum()[:-1]])
    times = (moving * limit + sliding) / rate
    assert [(e.element, e.before, e.after) for e in run.events] == [(f"block.{i}", "stick", "slip-") for i in range(n)]
    np.testing.assert_allclose([e.time for e in run.events], times, rtol=1e-9)
    assert energy_audit(run).relative < 1e-8


def test_energy_balances_and_written_out_equations_give_the_same_run(monkeypatch):
    n, grid = 16, np.linspace(0.0, 10.0, 100)
    push = {"cart.force": (grid, 20.0 * np.sin(2.0 * grid))}
    run = simulate(shaken(n), 10.0, inputs=push, accuracy=1e-8)
    assert energy_audit(run).relative < 1e-7
    monkeypatch.setattr(elimination, "LARGE", 1000)
    monkeypatch.setattr(bodies, "ROLLED", 10**9)
    plain = simulate(shaken(n), 10.0, inputs=push, accuracy=1e-8)
    assert len(run.events) > 100
    assert [(e.element, e.before, e.after) for e in run.events] == [(e.element, e.before, e.after) for e in plain.events]
    assert run.steps == plain.steps
    np.testing.assert_allclose([e.time for e in run.events], [e.time for e in plain.events], rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.states, plain.states, rtol=0, atol=1e-9 * np.abs(plain.states).max())
