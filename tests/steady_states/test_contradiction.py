"""Modes that the equations of a machine contradict: told without a search, and only where no search could find a steady state."""

import numpy as np
import pytest

from controllers import PI, SoftTorque, StiffPI
from tests.plants import RIG
from toolbox import closed_loop, equilibrium
from toolbox.errors import NoSteadyState
from toolbox.steady_states.equilibria import EquilibriumBranch
from toolbox.steady_states.zeros import contradictory

STUCK = {"bit": "stick"}


def stuck(law):
    """The steady states of the rig under a law with its bit stuck."""
    loop = closed_loop(RIG, law, element="bit")
    return loop, EquilibriumBranch(loop.system, loop.number("top.reference"), {}, STUCK)


@pytest.mark.parametrize("law", [PI(900.0, 400.0), StiffPI(), SoftTorque()], ids=lambda law: type(law).__name__)
def test_an_integral_of_the_speed_contradicts_a_stuck_bit_unless_it_is_to_stand(law):
    loop, rest = stuck(law)
    with pytest.raises(NoSteadyState):  # a search finds none either
        equilibrium(loop.at("top.reference", 8.0), mode=STUCK)
    assert rest(8.0) is None
    assert "contradict `bit` in stick" in rest.reason
    assert rest(0.0) is not None


def test_under_a_constant_torque_a_stuck_bit_is_a_steady_state_up_to_its_break_away():
    loop = closed_loop(RIG)
    rest = EquilibriumBranch(loop.system, loop.number("top.torque"), {}, STUCK)
    assert rest(5000.0) is not None
    assert rest(50_000.0) is None
    assert "contradicts its mode" in rest.reason  # by its force, which no equation tells


def of(rows):
    """Equations with rows as functions of x, and their slopes by differences."""

    def equations(x):
        return np.array([row(x) for row in rows])

    def slopes(x):
        return np.stack([(equations(x + d) - equations(x - d)) / 2.0 for d in np.eye(x.size)], axis=1)

    return equations, slopes


def test_linear_equations_contradict_one_another_where_their_rank_says_so():
    rng = np.random.default_rng(5)
    for _ in range(50):
        a = rng.normal(size=(4, 6)) * 10.0 ** rng.uniform(-3, 6, size=(4, 1))
        b = rng.normal(size=4) * np.abs(a).max(axis=1)
        rows = [lambda x, a=a[i], b=b[i]: a @ x - b for i in range(4)]
        shares = rng.normal(size=4)
        assert not contradictory(*of(rows), np.zeros(6))
        off = 0.1 * np.abs(shares * b).max()
        rows.append(lambda x, a=a, b=b, shares=shares, off=off: shares @ (a @ x - b) + off)
        assert contradictory(*of(rows), np.zeros(6))


@pytest.mark.parametrize(
    "row",
    [
        lambda x: np.tanh(x[0]) - 0.5,
        lambda x: np.sign(x[0]) + x[0] - 3.0,
        lambda x: min(x[0], 2.0) - 1.0,
        lambda x: np.floor(x[0]) - 2.0,
        lambda x: x[0] if x[0] > -1.0 else 1.0 - x[0],
        lambda x: x[0] + 1e-3 * x[0] * x[1],
    ],
    ids=["tanh", "sign", "limit", "floor", "kink", "product"],
)
def test_what_is_not_linear_contradicts_nothing(row):
    linear = [lambda x: x[0] + x[1] - 1.0]
    assert not contradictory(*of([row, *linear, row]), np.array([0.25, 0.0]))
    assert contradictory(*of([row, *linear, lambda x: x[0] + x[1] - 2.0]), np.array([0.25, 0.0]))
