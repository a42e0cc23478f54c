"""Cycles that leave their rhythm, and cycles whose switches change: Liouville's formula, solutions by scipy and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq, fsolve

from models import BlockOnBelt, Coulomb, oscillators
from studies.questions import torus
from toolbox import closed_loop, compose, follow, limit_cycle
from toolbox.inputs import sine


@pytest.fixture(scope="module")
def sliding():
    return torus.slowing(torus.dithered())


def sliding_block(speed):
    """The cycle of the dithered block in pure slip and its monodromy matrix, by scipy from the equations as they stand: x, v and the matrix at the end."""
    block = torus.BLOCK
    mu_s, mu_m, v_m = block.friction.static, block.friction.minimum, block.friction.minimum_speed

    def friction(v):
        return mu_s - 1.5 * (mu_s - mu_m) * (v / v_m - (v / v_m) ** 3 / 3)

    def slope(v):
        return -1.5 * (mu_s - mu_m) * (1 - (v / v_m) ** 2) / v_m

    def load(t):
        return block.load * (1 + torus.DEPTH * math.sin(2 * math.pi * t / torus.PERIOD))

    def flow(t, y):
        x, v, *m = y
        m = np.reshape(m, (2, 2))
        jacobian = np.array([[0.0, 1.0], [-block.stiffness, -block.damping - load(t) * slope(speed - v)]]) / [[1.0], [block.mass]]
        return [v, (load(t) * friction(speed - v) - block.damping * v - block.stiffness * x) / block.mass, *(jacobian @ m).ravel()]

    def end(start):
        return solve_ivp(flow, (0.0, torus.PERIOD), [*start, 1.0, 0.0, 0.0, 1.0], rtol=1e-12, atol=1e-13, dense_output=True)

    start = fsolve(lambda s: end(s).y[:2, -1] - s, [friction(speed), 0.0], xtol=1e-13)
    found = end(start)
    matrix = found.y[2:, -1].reshape(2, 2)
    growth = quad(lambda t: -(block.damping + load(t) * slope(speed - found.sol(t)[1])) / block.mass, 0.0, torus.PERIOD, epsabs=1e-11)[0]
    return start, matrix, math.exp(growth)


def test_a_dithered_block_in_pure_slip_has_the_determinant_of_liouville(sliding):
    cycle = sliding.cycles[0]
    start, matrix, liouville = sliding_block(0.5)
    np.testing.assert_allclose(cycle.start, start, atol=1e-9)
    np.testing.assert_allclose(np.sort_complex(cycle.multipliers), np.sort_complex(np.linalg.eigvals(matrix)), rtol=1e-8)
    np.testing.assert_allclose(np.prod(cycle.multipliers), liouville, rtol=1e-8)


def test_it_leaves_its_cycle_by_a_torus_where_damping_and_falling_friction_balance_over_a_period(sliding):
    (point,) = sliding.bifurcations
    assert point.kind == "Neimark-Sacker"
    theory = brentq(lambda speed: sliding_block(speed)[2] - 1.0, 0.42, 0.46, xtol=1e-10)
    np.testing.assert_allclose(point.value, theory, atol=1e-8)
    assert point.cycle.stick_share("belt") == 0.0
    assert abs(point.value - oscillators.hopf_speed(torus.BLOCK)) < 0.005  # near the Hopf speed without dither, and below it


def test_beyond_the_torus_bifurcation_the_block_draws_a_closed_curve_and_never_returns(sliding):
    (point,) = sliding.bifurcations
    assert np.ptp(torus.struck(0.46, count=100), axis=0).max() < 1e-6  # before it, the block comes round
    squares = []
    for away in (0.004, 0.008):
        points = torus.struck(point.value - away, settle=4000)
        assert min(np.abs(points[k:] - points[:-k]).max() for k in range(1, 100)) > 1e-3  # nor does it with up to a hundred periods
        turning = points - points.mean(axis=0)
        angle = np.unwrap(np.arctan2(turning[:, 1], turning[:, 0]))
        radius = np.hypot(*turning.T)
        shapes = np.stack([f(k * angle) for k in range(17) for f in (np.cos, np.sin)], axis=1)
        left = radius - shapes @ np.linalg.lstsq(shapes, radius, rcond=None)[0]
        assert np.abs(left).max() < 1e-4 * radius.mean()  # all on one smooth closed curve
        turns = (angle[-1] - angle[0]) / (2 * math.pi) / (angle.size - 1)
        phase = abs(np.angle(point.cycle.multipliers[0])) / (2 * math.pi)
        assert min(abs(abs(turns) - phase), abs(abs(turns) - (1 - phase))) < 2e-3
        squares.append(np.mean(radius**2))
    assert squares[1] / squares[0] == pytest.approx(2.0, rel=0.05)  # born small: the square of its size grows in proportion


def test_no_cycle_of_leines_block_in_pure_slip_attracts_whatever_the_dither():
    # det M = exp(int N |mu'| / m dt) > 1 without damping: what calms the block in the band of dither is no such cycle
    block = oscillators.LEINE
    law = block.friction
    for ratio, depth in ((3.0, 0.5), (4.0, 0.8), (5.0, 0.5)):
        period = 2 * math.pi / ratio
        force = {"block.load": sine(1.0, depth, 1 / period)}
        cycle = limit_cycle(
            closed_loop(compose(block), inputs=force, start={"block.position": law.static / (1 + law.decay * block.belt_speed)}),
            period,
            period=period,
        )
        assert cycle.run.events == []

        def falling(t, cycle=cycle, depth=depth, ratio=ratio):
            slip = block.belt_speed - cycle.run.at(t)["block.speed"]
            return (1 + depth * math.sin(ratio * t)) * law.static * law.decay / (1 + law.decay * slip) ** 2

        growth = quad(falling, 0.0, cycle.period, epsabs=1e-9)[0]
        np.testing.assert_allclose(np.prod(cycle.multipliers).real, math.exp(growth), rtol=1e-7)
        assert growth > 0 and not cycle.stable


def test_a_cycle_of_one_block_that_sticks_has_no_complex_multipliers():
    plant = compose(BlockOnBelt(belt_speed=0.0, damping=0.1, friction=Coulomb(static=0.6, kinetic=0.4)))
    for frequency in (0.06, 0.1):
        cycle = limit_cycle(closed_loop(plant, inputs={"block.force": sine(0.1, 1.0, frequency)}), 200.0)
        assert cycle.stick_share("belt") > 0.0
        assert np.abs(cycle.multipliers.imag).max() < 1e-12
        assert abs(np.prod(cycle.multipliers)) < 1e-12


@pytest.mark.parametrize("r", [0.8, 1.3])
def test_stops_appear_in_den_hartogs_oscillator_where_it_just_starts_again_at_its_turn(r):
    # x0 = V cos(phase), f U = V sin(phase) with his V and U (P = k = w_n = 1): at the turn x0 - cos(phase) = x0 r^2 pulls, and f holds
    gain, drift = 1 / (1 - r**2), math.sin(math.pi / r) / (r * (1 + math.cos(math.pi / r)))
    theory = r**2 * abs(gain) / math.sqrt(1 + r**4 * drift**2)
    plant = compose(BlockOnBelt(belt_speed=0.0, friction=Coulomb(static=1.0, kinetic=1.0)))
    frequency = r / (2 * math.pi)
    cycle = limit_cycle(closed_loop(plant, inputs={"block.force": sine(0.0, 1.0, frequency), "block.load": theory - 0.1}), 400.0)
    assert cycle.stick_share("belt") == 0.0
    branch = follow(cycle, "block.load", (theory - 0.12, theory + 0.1), points=60, start_towards=theory + 0.1)
    stops = [point for point in branch.bifurcations if point.kind == "crossing-sliding"]
    np.testing.assert_allclose(stops[0].value, theory, atol=1e-7)
    assert branch.cycles[-1].stick_share("belt") > 0.0  # a crossing has become a stop, and the cycle goes on


def test_a_drill_string_that_sticks_in_every_period_leaves_its_rhythm_by_complex_multipliers_on_the_unit_circle():
    branch = torus.loosening(torus.entrained(), points=24)
    point = branch.bifurcations[0]
    assert point.kind == "Neimark-Sacker" and point.cycle.stick_share("bit") > 0.2
    assert branch.cycles[0].stable and not branch.cycles[-1].stable
    pair = point.cycle.multipliers[:2]
    np.testing.assert_allclose(np.abs(pair), 1.0, atol=1e-8)
    assert abs(pair[0].imag) > 0.9 and abs(point.cycle.multipliers[-1]) < 1e-9  # the direction that stick forgets
    inside, beyond = (torus.strobed(point.cycle, factor * point.value, count=400) for factor in (1.02, 0.98))
    assert np.abs(inside[-1] - inside[-2]).max() < 1e-6
    assert np.abs(beyond[-1] - beyond[-2]).max() > 1.0
