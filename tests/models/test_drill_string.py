"""Torsional strings against linear theory: matrix exponentials while a mode holds, equilibria, break-off torque."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from controllers import PI
from models import BitRock, Coulomb, TorsionalChain, wells
from toolbox import SceneError, compose, simulate

RADIUS = 0.155575


def chain_matrix(chain):
    """Matrix of the string's (twists, speeds) without friction at the bit, and the columns of top torque and bit torque."""
    n = len(chain.inertia)
    matrix = np.zeros((2 * n - 1, 2 * n - 1))
    for i, (k, c) in enumerate(zip(chain.stiffness, chain.damping, strict=True)):
        above, below = n - 1 + i, n + i
        matrix[i, [above, below]] = 1, -1
        row = np.zeros(2 * n - 1)
        row[[i, above, below]] = k, c, -c
        matrix[above] -= row / chain.inertia[i]
        matrix[below] += row / chain.inertia[i + 1]
    matrix[n - 1, n - 1] -= chain.top_drag / chain.inertia[0]
    matrix[-1, -1] -= chain.bit_drag / chain.inertia[-1]
    top, bit = np.zeros(2 * n - 1), np.zeros(2 * n - 1)
    top[n - 1], bit[-1] = 1 / chain.inertia[0], -1 / chain.inertia[-1]
    return matrix, top, bit


def linear_motion(matrix, constant, start, t):
    """State at t of x' = A x + b from `start`, by the exponential of the matrix extended with b."""
    n = len(start)
    extended = np.zeros((n + 1, n + 1))
    extended[:n, :n], extended[:n, n] = matrix, constant
    return (expm(extended * t) @ np.append(start, 1.0))[:n]


def state_of(run, t):
    samples = run.at(t)
    return np.concatenate([np.atleast_1d(samples["chain.twist"]), samples["chain.speed"]])


@pytest.mark.parametrize(
    "chain", [wells.JANSEN_2, wells.NAVARRO_LOPEZ_2, wells.NAVARRO_LOPEZ_4], ids=["jansen 2", "navarro 2", "navarro 4"]
)
def test_a_string_turning_with_constant_friction_follows_the_matrix_exponential(chain):
    n = len(chain.inertia)
    plant = compose(chain, BitRock(weight=50_000.0, friction=Coulomb(static=0.6, kinetic=0.5)))
    start = {"chain.speed": np.linspace(10.0, 9.0, n), "chain.twist": np.full(n - 1, 3.0)}
    run = simulate(plant, 8.0, start=start, inputs={"top.torque": 9000.0}, accuracy=1e-11)
    assert run.events == []
    matrix, top, bit = chain_matrix(chain)
    constant = 9000.0 * top + 0.5 * 50_000.0 * RADIUS * bit
    begin = np.concatenate([start["chain.twist"], start["chain.speed"]])
    for t in (0.3, 2.0, 8.0):
        expected = linear_motion(matrix, constant, begin, t)
        np.testing.assert_allclose(state_of(run, t), expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("chain", [wells.JANSEN_2, wells.NAVARRO_LOPEZ_4], ids=["jansen 2", "navarro 4"])
def test_a_stuck_bit_breaks_off_when_the_string_carries_the_static_torque(chain):
    n, weight, torque = len(chain.inertia), 60_000.0, 12_000.0
    bound = 0.8 * weight * RADIUS
    run = simulate(compose(chain, BitRock(weight=weight)), 30.0, inputs={"top.torque": torque}, accuracy=1e-11)
    matrix, top, _ = chain_matrix(chain)
    matrix[-1] = 0.0  # the bit is held

    def held(t):
        x = linear_motion(matrix, torque * top, np.zeros(2 * n - 1), t)
        return chain.stiffness[-1] * x[n - 2] + chain.damping[-1] * x[2 * n - 3]

    grid = np.linspace(0, 30, 3000)
    above = next(i for i, t in enumerate(grid) if held(t) > bound)
    release = brentq(lambda t: held(t) - bound, grid[above - 1], grid[above], xtol=1e-13)
    first = run.events[0]
    assert (first.element, first.before, first.after) == ("bit", "stick", "slip+")
    assert first.time == pytest.approx(release, abs=1e-9)
    node = np.searchsorted(run.time, first.time)  # the first of the two nodes at the event: the last instant of stick
    assert run["bit.torque"][node] == pytest.approx(bound, rel=1e-9)


def test_below_the_break_off_torque_the_bit_never_moves():
    weight = 60_000.0
    bound = 0.8 * weight * RADIUS
    # a step of torque overshoots to twice its value at most
    run = simulate(compose(wells.JANSEN_2, BitRock(weight=weight)), 300.0, inputs={"top.torque": 0.49 * bound})
    assert run.time_in("bit", "stick") == 300.0
    assert np.all(run["bit.speed"] == 0.0)
    assert run.at(300.0)["bit.torque"] == pytest.approx(0.49 * bound, rel=1e-6)
    assert run.at(300.0)["chain.twist.0"] == pytest.approx(0.49 * bound / 473.0, rel=1e-6)


def test_a_ramp_of_torque_frees_the_bit_that_a_lower_one_leaves_stuck():
    run = simulate(compose(wells.JANSEN_2, BitRock(weight=60_000.0)), 300.0, inputs={"top.torque": ((0.0, 250.0), (0.0, 9000.0))})
    release = run.events[0].time
    # slow enough that the string carries the torque but for the drag on the drive and the swing that the ramp leaves
    assert 9000.0 / 250.0 * release == pytest.approx(0.8 * 60_000.0 * RADIUS, rel=0.02)


@pytest.mark.parametrize("reference", [10.0, 20.0])
def test_the_equilibrium_of_a_pi_drive_is_where_theory_puts_it(reference):
    # w = Om everywhere; k twist = c_b Om + T(Om); u = c_r Om + k twist = K_i z
    chain, weight = wells.NAVARRO_LOPEZ_2, 40_000.0
    torque = weight * RADIUS * (0.5 + 0.3 * math.exp(-0.9 * reference))
    load = 50.0 * reference + torque
    law = PI(proportional=2000.0, integral=500.0, reference=reference)
    start = {"chain.speed": (reference, reference), "chain.twist": load / 861.5336, "pi.angle": (425.0 * reference + load) / 500.0}
    run = simulate(compose(chain, BitRock(weight=weight)), 100.0, start=start, controller=law, accuracy=1e-9)
    assert run.events == []
    np.testing.assert_allclose(run["chain.speed"], reference, rtol=1e-8)
    assert run.at(100.0)["top.torque"] == pytest.approx(425.0 * reference + load, rel=1e-8)
    # from anywhere near it comes back
    start |= {"chain.speed": (1.2 * reference, 1.1 * reference)}
    run = simulate(compose(chain, BitRock(weight=weight)), 200.0, start=start, controller=law, accuracy=1e-9)
    assert run.at(200.0)["bit.speed"] == pytest.approx(reference, rel=1e-6)
    assert run.at(200.0)["bit.torque"] == pytest.approx(torque, rel=1e-6)


def test_a_free_string_keeps_its_angular_momentum_and_its_energy():
    chain = TorsionalChain(inertia=(3.0, 1.0, 2.0), stiffness=(50.0, 80.0), damping=(0.0, 0.0))
    run = simulate(compose(chain), 50.0, start={"chain.speed": (1.0, -2.0, 0.5), "chain.twist": (0.1, -0.2)}, accuracy=1e-11)
    speed, twist = run["chain.speed"], run["chain.twist"]
    momentum = speed @ [3.0, 1.0, 2.0]
    energy = speed**2 @ [1.5, 0.5, 1.0] + twist**2 @ [25.0, 40.0]
    np.testing.assert_allclose(momentum, momentum[0], atol=1e-9)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-9)


@pytest.mark.parametrize("n", [12, 60])  # a step written out, and a step with loops over the states
def test_torsional_waves_of_a_uniform_string_have_the_frequencies_of_a_lumped_chain(n):
    # free-free chain of equal J and k: w_j = 2 sqrt(k / J) sin(j pi / 2 n); start in the shape of mode j and stay in it
    j, inertia, stiffness = 5, 2.0, 800.0
    chain = TorsionalChain(inertia=(inertia,) * n, stiffness=(stiffness,) * (n - 1), damping=(0.0,) * (n - 1))
    shape = np.cos(j * math.pi * (np.arange(n) + 0.5) / n)
    w = 2 * math.sqrt(stiffness / inertia) * math.sin(j * math.pi / (2 * n))
    run = simulate(compose(chain), 10.0, start={"chain.speed": shape}, accuracy=1e-10)
    for t in (0.7, 10.0):
        np.testing.assert_allclose(run.at(t)["chain.speed"], shape * math.cos(w * t), atol=1e-8)


def test_a_rod_with_friction_along_it_carries_a_torque_that_falls_linearly_with_depth():
    # slow turning of the top: inertia i holds its own friction, so the torque below it is what the inertias below need
    n, load = 5, 100.0
    chain = TorsionalChain(
        inertia=(1.0,) * n, stiffness=(1000.0,) * (n - 1), damping=(5.0,) * (n - 1),
        friction=Coulomb(static=1.0, kinetic=1.0), friction_load=(load,) * n, top_drag=1.0,
    )  # fmt: skip
    run = simulate(compose(chain), 300.0, inputs={"top.torque": n * load + 2.0}, accuracy=1e-9)
    end = run.at(300.0)
    assert [run.modes[f"chain.{i}"][-1] for i in range(n)] == ["slip+"] * n
    np.testing.assert_allclose(1000.0 * end["chain.twist"], load * np.arange(n - 1, 0, -1), rtol=1e-4)
    np.testing.assert_allclose(end["chain.speed"], 2.0, rtol=1e-4)


def test_each_inertia_of_a_rod_with_friction_sticks_until_the_twist_above_reaches_it():
    n, load = 5, 100.0
    chain = TorsionalChain(
        inertia=(1.0,) * n, stiffness=(1000.0,) * (n - 1), damping=(5.0,) * (n - 1),
        friction=Coulomb(static=1.0, kinetic=1.0), friction_load=(load,) * n,
    )  # fmt: skip
    run = simulate(compose(chain), 60.0, inputs={"top.torque": ((0.0, 60.0), (0.0, 3 * load + 50.0))}, accuracy=1e-8)
    # each moves steadily, if slowly, long before the next one does, so that inertia i lets go at (i + 1) loads
    rate = (3 * load + 50.0) / 60.0
    assert [event.element for event in run.events] == ["chain.0", "chain.1", "chain.2"]  # 350 N m cannot move the fourth
    np.testing.assert_allclose([event.time for event in run.events], load / rate * np.arange(1, 4), rtol=1e-7)
    assert np.all(run["chain.speed.3"] == 0.0) and np.all(run["chain.speed.4"] == 0.0)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"inertia": (1.0,)}, "at least 2 inertias, but it has 1: one under a table is a `TorsionalPendulum`"),
        ({"stiffness": (1.0, 2.0)}, "stiffness"),
        ({"damping": ()}, "damping"),
        ({"friction": Coulomb()}, "friction"),
        ({"friction_load": (1.0, 1.0)}, "friction"),
        ({"friction": Coulomb(), "friction_load": (1.0, 1.0, 1.0)}, "friction_load"),
        ({"friction": Coulomb(), "friction_load": (1.0, -1.0)}, "friction_load"),
    ],
)
def test_a_string_that_cannot_be_built_is_refused_by_name(change, word):
    with pytest.raises(SceneError, match=word):
        compose(TorsionalChain(**change))


def test_a_string_with_dry_friction_along_it_leaves_its_last_inertia_to_the_rock():
    # at rest every contact holds what the string brings it: a torque below the first bound moves nothing
    chain = TorsionalChain(
        inertia=(1.0, 1.0, 1.0), stiffness=(1000.0, 1000.0), damping=(5.0, 5.0),
        friction=Coulomb(static=1.0, kinetic=0.8), friction_load=(100.0, 100.0),
    )  # fmt: skip
    plant = compose(chain, BitRock(weight=1000.0))
    assert [element.name for element in plant.elements] == ["chain.0", "chain.1", "bit"]
    run = simulate(plant, 5.0, inputs={"top.torque": 90.0})
    assert all(run.time_in(name, "stick") == 5.0 for name in run.modes)
    # friction of the hole at the last inertia, too, is one friction with the rock: both give way at their sum
    whole = compose(dataclasses.replace(chain, friction_load=(100.0, 100.0, 100.0)), BitRock(weight=1000.0))
    assert set(whole.shared_modes) == {"bit"} and whole.shared_modes["bit"][0] == "chain.2"
    run = simulate(whole, 5.0, inputs={"top.torque": 90.0})
    assert all(run.time_in(name, "stick") == 5.0 for name in run.modes)
