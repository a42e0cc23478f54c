"""Axial strings against linear theory: free fall, matrix exponentials, natural frequencies, and the energy of the hook."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.linalg import eigh, expm

from models import AxialChain, BitRock, TorsionalChain, TorsionalPendulum, wells
from toolbox import SceneError, closed_loop, compose, energy_audit, equilibrium, linearise, simulate
from toolbox.inputs import sine

RIGID = AxialChain(mass=(30_000.0,), stiffness=(), damping=(), hook_load=290_000.0)
HUNG = AxialChain(mass=(5000.0, 12_000.0, 20_000.0), stiffness=(5e6, 3e6, 4e6), damping=(1e4, 2e4, 0.0))
LOADED = dataclasses.replace(HUNG, stiffness=(3e6, 4e6), damping=(2e4, 0.0), hook_load=360_000.0)


def matrices(chain):
    """M, C, K of the chain for displacements of its masses; lines, if any, go to a fixed hook."""
    n, first = len(chain.mass), 0 if chain.hook_load is None else 1
    c, k = np.zeros((n, n)), np.zeros((n, n))
    for i, (stiffness, damping) in enumerate(zip(chain.stiffness, chain.damping, strict=True)):
        row = np.zeros(n)
        row[i + first] += 1.0
        if i + first > 0:
            row[i + first - 1] -= 1.0
        k += stiffness * np.outer(row, row)
        c += damping * np.outer(row, row)
    return np.diag(chain.mass), c, k


def test_a_rigid_string_falls_with_what_the_hook_does_not_carry():
    run = simulate(compose(RIGID), 3.0, accuracy=1e-11)
    assert run.at(3.0)["bit.axial_speed"] == pytest.approx((9.81 - 290_000.0 / 30_000.0) * 3.0, rel=1e-12)


def test_drag_limits_the_speed_of_a_falling_string():
    # v = (g - H/M)/drag (1 - exp(-drag t))
    run = simulate(compose(dataclasses.replace(RIGID, drag=0.7)), 5.0, accuracy=1e-11)
    expected = (9.81 - 290_000.0 / 30_000.0) / 0.7 * (1 - math.exp(-0.7 * 5.0))
    assert run.at(5.0)["bit.axial_speed"] == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("chain", [HUNG, LOADED], ids=["on lines", "under a hook load"])
def test_a_string_on_a_weight_on_bit_follows_the_matrix_exponential(chain):
    n, lines = 3, chain.hook_load is None
    mass, c, k = matrices(chain)
    push = np.zeros(n)
    push[-1] = -80_000.0
    if not lines:
        push[0] += 9.81 * 37_000.0 - chain.hook_load
    system = np.zeros((2 * n + 1, 2 * n + 1))
    system[:n, n:-1] = np.eye(n)
    system[n:-1, :n], system[n:-1, n:-1], system[n:-1, -1] = (
        np.linalg.solve(mass, -k),
        np.linalg.solve(mass, -c),
        np.linalg.solve(mass, push),
    )
    run = simulate(compose(chain), 2.0, inputs={"bit.weight": 80_000.0}, accuracy=1e-11)
    for t in (0.1, 2.0):
        expected = (expm(system * t) @ np.append(np.zeros(2 * n), 1.0))[:-1]
        samples = run.at(t)
        np.testing.assert_allclose(samples["axial.speed"], expected[n:], atol=1e-9)
        stretch = np.diff(expected[:n], prepend=0.0) if lines else np.diff(expected[:n])
        np.testing.assert_allclose(samples["axial.stretch"], stretch, atol=1e-9)


def test_the_linearised_string_has_the_natural_frequencies_of_its_stiffness_and_mass():
    chain = dataclasses.replace(HUNG, damping=(0.0, 0.0, 0.0))
    mass, _, k = matrices(chain)
    expected = np.sqrt(eigh(k, mass, eigvals_only=True))
    poles = np.sort(linearise(compose(chain)).poles().imag)[3:]
    np.testing.assert_allclose(poles, expected, rtol=1e-10)


def test_a_string_at_rest_on_bottom_leaves_the_hook_its_weight_less_the_weight_on_bit():
    rest = equilibrium(closed_loop(compose(HUNG), inputs={"bit.weight": 80_000.0}))
    assert rest["hook.load"] == pytest.approx(9.81 * 37_000.0 - 80_000.0, rel=1e-12)
    np.testing.assert_allclose(rest["axial.stretch"], -80_000.0 / np.array(HUNG.stiffness), rtol=1e-10)


def test_the_energy_of_a_string_closes_under_a_moving_hook_and_under_a_shaking_load():
    moved = {"hook.speed": sine(0.02, 0.1, 0.7), "bit.weight": 50_000.0}
    shaken = {"hook.load": sine(330_000.0, 20_000.0, 0.7), "bit.weight": sine(40_000.0, 10_000.0, 0.3)}
    for chain, inputs in ((HUNG, moved), (LOADED, shaken), (dataclasses.replace(LOADED, drag=0.2), shaken)):
        audit = energy_audit(simulate(compose(chain), 20.0, inputs=inputs, accuracy=1e-10))
        assert audit.relative < 1e-9
        assert audit.losses["axial.damping"] > 0.0


@pytest.mark.parametrize("n", [1, 2, 7])
def test_states_are_two_per_mass_on_lines_and_one_less_under_a_hook_load(n):
    on_lines = compose(AxialChain(mass=(1e3,) * n, stiffness=(1e6,) * n, damping=(1e3,) * n))
    loaded = compose(AxialChain(mass=(1e3,) * n, stiffness=(1e6,) * (n - 1), damping=(1e3,) * (n - 1), hook_load=n * 9810.0))
    assert (on_lines.x.numel(), loaded.x.numel()) == (2 * n, 2 * n - 1)
    assert not on_lines.elements and not loaded.elements
    assert "hook.speed" in on_lines.inputs and "hook.load" in loaded.inputs


def test_adding_an_axial_string_leaves_the_torsional_equations_as_they_were_bit_for_bit():
    torsion, both = compose(wells.NAVARRO_LOPEZ_4), compose(wells.NAVARRO_LOPEZ_4, LOADED)
    assert both.x.numel() == torsion.x.numel() + 5
    random = np.random.default_rng(4)
    for _ in range(20):
        x, u = random.normal(size=12), random.normal(size=4)
        alone = np.array(torsion.rhs(0.0, x[:7], u[: torsion.u.numel()], torsion.values, [])).ravel()
        together = np.array(both.rhs(0.0, x, [u[list(torsion.inputs).index(i)] if i in torsion.inputs else 7.0 for i in both.inputs],
                                     both.values, [])).ravel()  # fmt: skip
        assert np.array_equal(together[:7], alone)
    runs = [simulate(plant, 20.0, inputs={"top.torque": 10_000.0}, accuracy=1e-9) for plant in (torsion, both)]
    times = np.linspace(0, 20, 50)
    np.testing.assert_allclose(runs[1].at(times)["chain.speed"], runs[0].at(times)["chain.speed"], atol=1e-7)


def test_a_pendulum_swings_about_the_speed_of_its_table():
    # J w' = k twist - T, twist' = W - w from rest at the table's speed: w = W - (T / sqrt(k J)) sin(sqrt(k/J) t)
    plant = compose(TorsionalPendulum(inertia=2.0, stiffness=50.0, top_speed=3.0))
    run = simulate(plant, 10.0, start={"pendulum.speed": 3.0}, inputs={"bit.torque": 4.0}, accuracy=1e-11)
    times = np.linspace(0, 10, 60)
    np.testing.assert_allclose(run.at(times)["bit.speed"], 3.0 - 0.4 * np.sin(5.0 * times), atol=1e-9)
    assert energy_audit(run).relative < 1e-10


def test_a_pendulum_is_a_chain_whose_table_is_too_heavy_to_change_its_speed():
    rock = BitRock(weight=40_000.0)
    pendulum = compose(TorsionalPendulum(inertia=374.0, stiffness=473.0, damping=23.2, bit_drag=50.0, top_speed=2.0), rock)
    chain = compose(TorsionalChain(inertia=(1e13, 374.0), stiffness=(473.0,), damping=(23.2,), bit_drag=50.0), rock)
    one = simulate(pendulum, 30.0, accuracy=1e-9)
    two = simulate(chain, 30.0, start={"chain.speed": (2.0, 0.0)}, accuracy=1e-9)
    times = np.linspace(0, 30, 80)
    assert len(one.events) == len(two.events) > 2
    np.testing.assert_allclose(one.at(times)["bit.speed"], two.at(times)["bit.speed"], atol=1e-6)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"mass": ()}, "mass"),
        ({"stiffness": (1.0, 1.0)}, "stiffness"),
        ({"hook_load": 1000.0}, "stiffness"),
        ({"hook_load": math.nan, "stiffness": (1.0, 1.0), "damping": (1.0, 1.0)}, "hook_load"),
    ],
)
def test_an_axial_string_that_cannot_be_built_is_refused_by_name(change, word):
    with pytest.raises(SceneError, match=word):
        compose(dataclasses.replace(HUNG, **change))


def test_two_defaults_for_one_weight_on_bit_are_refused():
    # a torsional rock with a weight of its own under an axial string: what is between bit and rock must say how large the weight is
    with pytest.raises(SceneError, match=r"bit\.weight"):
        compose(wells.JANSEN_2, BitRock(), RIGID)
