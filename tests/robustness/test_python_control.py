"""Poles, margins and delay margins of ten sampled loops, and poles of loops with several sample times, against python-control."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest
from scipy.optimize import brentq

from controllers import PI, SoftTorque, StiffPI
from models import BitRock, wells
from tests.steady_states.test_sampled_matrix import Integrating, Shaft
from toolbox import Sampled, closed_loop, compose, equilibrium, linearise, margins
from toolbox.steady_states import pole_locus

RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
SPEED = 9.0
LOOPS = [
    (PI(), 0.01, 0.0), (PI(), 0.02, 0.02), (PI(), 0.1, 0.0), (StiffPI(), 0.01, 0.0), (StiffPI(), 0.005, 0.02), (SoftTorque(), 0.01, 0.0),
    (SoftTorque(), 0.05, 0.117), (SoftTorque(detuning=2.0), 0.02, 0.06), (PI(), 0.04, 0.125), (StiffPI(), 0.02, 0.1),
]  # fmt: skip


def by_control(law, period, delay):
    """The loop transfer in z of the string about smooth running under a sampled PI: the law, outputs on their way, the plant under what it gets.

    Over a period the plant gets the output of `whole` samples ago, and for the first `part` of the period the one before.
    """
    loop = closed_loop(RIG, law, inputs={"top.reference": SPEED})
    gains, steady = loop.designed_controllers[0], equilibrium(loop)
    plant = linearise(closed_loop(RIG, inputs={"top.torque": steady["top.torque"]}), steady, inputs=["top.torque"], outputs=["top.speed"])
    whole = math.floor(delay / period + 1e-9)
    part = max(delay - whole * period, 0.0)
    sampled = control.sample_system(control.ss(plant.A, plant.B, plant.C, plant.D), period, method="zoh")
    newer = control.sample_system(control.ss(plant.A, plant.B, plant.C, plant.D), period - part, method="zoh").B
    both = control.ss(sampled.A, np.hstack([newer, sampled.B - newer]), sampled.C, np.zeros((1, 2)), period)
    count = whole + 1
    line = np.eye(count, k=-1)  # outputs of the last samples, the newest first
    outputs = np.zeros((2, count))
    outputs[1, whole] = 1.0
    if whole:
        outputs[0, whole - 1] = 1.0
    way = control.ss(line, np.eye(count)[:, :1], outputs, [[0.0 if whole else 1.0], [0.0]], period)
    pi = control.ss([[1.0]], [[period]], [[gains.integral]], [[gains.proportional]], period)
    return both * way * pi


@pytest.mark.parametrize(("law", "period", "delay"), LOOPS)
def test_poles_margins_and_delay_margin_are_those_of_python_control(law, period, delay):
    by_hand, loop = by_control(law, period, delay), closed_loop(RIG, Sampled(law, period, delay), inputs={"top.reference": SPEED})

    poles, own = control.feedback(by_hand, 1).poles(), pole_locus(loop, "top.reference", [SPEED])[0]
    for pole in poles[np.abs(poles) > 1e-2]:  # others are those of the outputs on their way, a root of many equal poles
        assert np.abs(own - pole).min() < 1e-6 * abs(pole)

    found = margins(loop, by_simulation=False)["top.torque"]
    frequency = np.geomspace(1e-3, 0.9999 * math.pi / period, 20_000)

    def transfer(w):
        return complex(by_hand(np.exp(1j * w * period)))

    curve = by_hand(np.exp(1j * frequency * period))
    crossings = [
        brentq(lambda w: abs(transfer(w)) - 1.0, frequency[k], frequency[k + 1], xtol=1e-13)
        for k in np.flatnonzero(np.diff(np.abs(curve) > 1.0))
    ]
    assert found.phase_margin == pytest.approx(min(abs(np.angle(-transfer(w))) for w in crossings), rel=1e-6)

    real = [
        brentq(lambda w: transfer(w).imag, frequency[k], frequency[k + 1], xtol=1e-13) for k in np.flatnonzero(np.diff(curve.imag > 0.0))
    ]
    gains = [-1.0 / transfer(w).real for w in (*real, math.pi / period) if transfer(w).real < 0.0]
    assert found.highest_gain == pytest.approx(min(gain for gain in gains if gain > 1.0), rel=1e-6)

    def radius(more):
        return np.abs(control.feedback(by_control(law, period, delay + more), 1).poles()).max() - 1.0

    assert radius(0.999 * found.delay_margin) < 0.0
    assert found.delay_margin == pytest.approx(brentq(radius, 0.999 * found.delay_margin, 1.001 * found.delay_margin, xtol=1e-12), rel=1e-6)


@pytest.mark.parametrize(
    "clocks",
    [[(0.004, 0.0), (0.01, 0.0)], [(0.004, 0.002), (0.006, 0.008)], [(0.05, 0.02), (0.02, 0.05)]],
    ids=["two rates", "two rates and delays", "delays of parts and of more than a period"],
)
def test_poles_of_controllers_with_several_sample_times_are_those_of_python_control(clocks):
    """The plant from one tick to the next by python-control; samples, memory and outputs on their way by hand, over the common period."""
    laws = [Sampled(Integrating(side, name=side), period, delay) for side, (period, delay) in zip(("left", "right"), clocks, strict=True)]
    loop = closed_loop(compose(Shaft()), laws)
    ticks = [[round(each / 1e-3) for each in clock] for clock in clocks]
    tick, span = math.gcd(*(each for clock in ticks for each in clock)), math.lcm(*(clock[0] for clock in ticks))
    plant = control.ss([[0, 1, -1], [-40, -0.5, 0], [20, 0, -0.1]], [[0, 0], [1, 0], [0, 0.5]], np.eye(3), 0)
    sampled = control.sample_system(plant, 1e-3 * tick, method="zoh")
    waiting = [delay // period + 1 for period, delay in ticks]

    def after_the_common_period(start):
        x, held, sums = start[:3].copy(), start[3:5].copy(), start[5:7].copy()
        queues = [[*start[7 : 7 + waiting[0]]], [*start[7 + waiting[0] :]]]  # the output of the last sample stands last
        for now in range(0, span, tick):
            speeds = x[1:3].copy()
            for c, (period, delay) in enumerate(ticks):
                if now % period == 0:
                    queues[c] = [*queues[c][1:], -3.0 * speeds[c] - 5.0 * sums[c]]
                    sums[c] += 1e-3 * period * speeds[c]
                if (now - delay) % period == 0:
                    held[c] = queues[c][-1 - delay // period]
            x = sampled.A @ x + sampled.B @ held
        return np.concatenate([x, held, sums, *queues])

    size = 7 + sum(waiting)
    right = np.linalg.eigvals(np.column_stack([after_the_common_period(column) for column in np.eye(size)]))
    found = pole_locus(loop, "left.p", [3.0])[0]
    swings = right[np.abs(right) > 1e-2]  # others are those of the outputs on their way
    assert len(swings) >= 4
    for pole in swings:
        assert np.abs(found - pole).min() < 1e-6 * abs(pole)
