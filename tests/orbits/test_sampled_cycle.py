"""Forced cycles under sampled laws: states and memory return together, and their multipliers are those that differences show."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.linalg import expm

from controllers import PI, SoftTorque, StiffPI
from models import BlockOnBelt
from tests.plants import RIG
from toolbox import Controller, Sampled, SceneError, Update, closed_loop, compose, follow, limit_cycle, quantity, simulate, state
from toolbox.inputs import sine, square, triangle

STATES = ("chain.twist.0", "chain.speed.0", "chain.speed.1", "stiffpi.angle")


def differences(cycle, law, sample_time, inputs, by=1e-6):
    """Multipliers of the states and of the integral from central differences of runs over a period, the largest first."""
    begin = np.concatenate([cycle.start, cycle.memory])
    assert cycle.memory.size == 2 and begin[-1] == 1.0  # behind its integral, the law knows that its first sample is over
    begin = begin[:-1]
    columns = []
    for i in range(begin.size):
        ends = []
        for sign in (1.0, -1.0):
            x = begin.copy()
            x[i] += sign * by * max(1.0, abs(x[i]))
            run = simulate(
                RIG,
                cycle.period,
                start=dict(zip(STATES, x, strict=True)) | {"stiffpi.started": 1.0},
                inputs=inputs,
                controller=law,
                sample_time=sample_time,
                accuracy=1e-13,
            )
            ends.append(np.concatenate([run.states[-1], run.last.memory[:1]]))
        columns.append((ends[0] - ends[1]) / (2 * by * max(1.0, abs(begin[i]))))
    values = np.linalg.eigvals(np.array(columns).T).astype(complex)
    return values[np.argsort(-np.abs(values))]


@dataclass(frozen=True)
class Holding(Controller):
    """A sampled PI on the position of a block: u_k = -p x_k - i z_k, z_(k+1) = z_k + h x_k."""

    measured_signals, actuated_signals = ("block.position",), ("block.force",)
    proportional: float = quantity(0.5, "N/m", "p")
    integral: float = quantity(0.3, "N/m s", "i")

    def sampled(self, signal, period):
        total, x = state("holding.total", "m s"), signal("block.position", "m")
        return Update({total: total + period * x}, {"block.force": (-self.proportional * x - self.integral * total, "N")})


def test_a_linear_block_under_a_sampled_pi_has_the_multipliers_of_its_transition_matrix():
    # over a sample: x+ = Phi x + Gamma u, u = -p x - i z, z+ = z + h x; over the period its power
    h, count, damping, p, i = 0.25, 16, 0.5, 0.5, 0.3
    plant = compose(BlockOnBelt(damping=damping, load=0.0, belt_speed=50.0))
    cycle = limit_cycle(
        closed_loop(plant, Holding(p, i), sample_time=h, inputs={"block.load": 0.0}, start={"block.position": 1.0}), 200.0, period=count * h
    )
    whole = expm(h * np.array([[0.0, 1.0, 0.0], [-1.0, -damping, 1.0], [0.0, 0.0, 0.0]]))
    matrix = np.block([[whole[:2, :2] - whole[:2, 2:] @ [[p, 0.0]], -i * whole[:2, 2:]], [np.array([[h, 0.0]]), np.ones((1, 1))]])
    theory = np.linalg.eigvals(np.linalg.matrix_power(matrix, count))
    for value in theory:
        assert min(abs(value - found) for found in cycle.multipliers) < 1e-9
    assert cycle.multipliers.size == 3 and cycle.forced and cycle.stable


def test_a_delay_within_a_sample_brings_the_output_before_it_among_the_multipliers():
    # x+ = Phi x + (G(h) - G(h - d)) u_before + G(h - d) u, over a sample h with delay d
    h, delay, count, damping, p, i = 0.25, 0.1, 16, 0.5, 0.5, 0.3
    plant = compose(BlockOnBelt(damping=damping, load=0.0, belt_speed=50.0))
    arguments = {"inputs": {"block.load": 0.0}, "start": {"block.position": 1.0}}
    cycle = limit_cycle(closed_loop(plant, Sampled(Holding(p, i), h, delay=delay), **arguments), 200.0, period=count * h)
    field = np.array([[0.0, 1.0, 0.0], [-1.0, -damping, 1.0], [0.0, 0.0, 0.0]])
    whole, rest = expm(h * field), expm((h - delay) * field)
    now, before, u = rest[:2, 2:], whole[:2, 2:] - rest[:2, 2:], np.array([[-p, 0.0, -i]])
    matrix = np.zeros((4, 4))  # of x, z and the output before
    matrix[:2, :2], matrix[:2, 3:], matrix[2, :3], matrix[3, :3] = whole[:2, :2], before, (h, 0.0, 1.0), u
    matrix[:2, :3] += now @ u
    theory = np.linalg.eigvals(np.linalg.matrix_power(matrix, count))
    assert cycle.multipliers.size == 4
    for value in theory:
        assert min(abs(value - found) for found in cycle.multipliers) < 1e-9
    prompt = limit_cycle(closed_loop(plant, Holding(p, i), sample_time=h, **arguments), 200.0, period=count * h)
    assert np.abs(prompt.multipliers).max() < np.abs(cycle.multipliers).max()  # the delay takes damping away


@pytest.mark.parametrize("case", ["weight", "reference"])
def test_a_drill_string_under_a_sampled_drive_has_the_multipliers_that_differences_show(case):
    law, period, h = StiffPI(reference=8.0), 5.4 if case == "weight" else 7.2, 0.1
    if case == "weight":
        inputs, given = {"bit.weight": sine(97_347.0, 20_000.0, 1 / period)}, {}
    else:
        inputs, given = {"top.reference": triangle(6.0, 2.0, 1 / period, 1500.0)}, {"period": period}
    cycle = limit_cycle(closed_loop(RIG, law, sample_time=h, inputs=inputs), 100 * period, **given)
    assert cycle.period == pytest.approx(period, rel=1e-14) and cycle.multipliers.size == 6
    assert cycle.stick_share("bit") > 0.1
    assert np.abs(cycle.multipliers[4:]).max() < 1e-12  # of the flag and of the held torque, which only the first sample reads
    np.testing.assert_allclose(np.abs(cycle.multipliers[:4] - differences(cycle, law, h, inputs)).max(), 0.0, atol=1e-5)
    # what is left of a long run comes to it
    run = simulate(RIG, 200 * period, inputs=inputs, controller=law, sample_time=h, accuracy=1e-9)
    np.testing.assert_allclose(run.states[-1], cycle.start, atol=1e-5 * np.abs(cycle.start).max())
    np.testing.assert_allclose(run.last.memory, cycle.memory, atol=1e-5 * np.abs(cycle.memory).max())


def test_fast_sampling_leaves_the_multipliers_of_the_continuous_law():
    period, law = 5.4, SoftTorque(reference=9.0)
    inputs = {"bit.weight": sine(97_347.0, 10_000.0, 1 / period)}
    smooth = limit_cycle(closed_loop(RIG, law, inputs=inputs), 400.0)
    away = []
    for count in (540, 1080):
        fast = limit_cycle(closed_loop(RIG, law, sample_time=period / count, inputs=inputs), 400.0)
        away.append(np.abs(fast.multipliers[:4] - smooth.multipliers).max())
    assert away[0] < 0.02
    assert away[1] == pytest.approx(away[0] / 2, rel=0.1)  # a hold is late by half a sample


def test_a_branch_of_sampled_cycles_loses_its_stability_where_the_loop_of_its_samples_does():
    # with the gain p as parameter: the multiplier of largest modulus of Phi(p) passes the unit circle, whatever drives the block
    h, count, damping, i = 0.5, 8, 0.2, 0.1
    plant = compose(BlockOnBelt(damping=damping, load=0.0, belt_speed=50.0))
    whole = expm(h * np.array([[0.0, 1.0, 0.0], [-1.0, -damping, 1.0], [0.0, 0.0, 0.0]]))

    def largest(p):
        matrix = np.block([[whole[:2, :2] - whole[:2, 2:] @ [[p, 0.0]], -i * whole[:2, 2:]], [np.array([[h, 0.0]]), np.ones((1, 1))]])
        return np.abs(np.linalg.eigvals(matrix)).max() - 1.0

    from scipy.optimize import brentq

    theory = brentq(largest, 0.05, 2.0)
    cycle = limit_cycle(
        closed_loop(plant, Holding(0.05, i), sample_time=h, inputs={"block.load": sine(0.0, 0.0, 1 / (count * h))}), 800.0, period=count * h
    )
    name = next(name for name in cycle.run.program.system.parameters if name.endswith(".proportional"))
    branch = follow(cycle, name, (0.0, 2.0), points=60, start_towards=2.0)
    torus = [point for point in branch.bifurcations if point.kind == "Neimark-Sacker"]
    np.testing.assert_allclose(torus[0].value, theory, rtol=1e-8)
    assert cmath.isclose(abs(torus[0].cycle.multipliers[0]), 1.0, rel_tol=1e-8)


def test_a_sampled_cycle_that_cannot_be_is_refused_with_a_way_out():
    law = PI(reference=8.0)
    with pytest.raises(SceneError, match="continuously for a free cycle"):
        limit_cycle(closed_loop(RIG, law, sample_time=0.1), 60.0)
    weight = {"bit.weight": sine(97_347.0, 20_000.0, 1 / 5.4)}
    with pytest.raises(SceneError, match=r"whole multiple of the sample time 0.25 s.*`period` = 27 s"):
        limit_cycle(closed_loop(RIG, law, sample_time=0.25, inputs=weight), 60.0)
    with pytest.raises(SceneError, match="whole multiple"):
        limit_cycle(closed_loop(RIG, law, sample_time=math.pi / 20, inputs=weight), 60.0)
    with pytest.raises(SceneError, match=r"shorter than the sample time 0.1 s.*it is 0.25 s.*delay_samples=1"):
        limit_cycle(closed_loop(RIG, Sampled(law, 0.1, delay=0.25), inputs=weight), 60.0)
    with pytest.raises(SceneError, match="without noise"):
        limit_cycle(closed_loop(RIG, Sampled(law, 0.1, noise={"top.speed": 0.1}), inputs=weight), 60.0)
    with pytest.raises(SceneError, match="Python"):
        limit_cycle(closed_loop(RIG, lambda t, y: 1e4, sample_time=0.1, inputs=weight), 60.0)
    with pytest.raises(SceneError, match="repeat itself"):
        limit_cycle(closed_loop(RIG, PI(), sample_time=0.1, inputs={"top.reference": square(8.0, 1.0, 1 / 5.0, 60.0)}), 60.0, period=5.4)
