"""The exact matrix of sampled loops with several sample times and delays, against runs of a linear plant, whose states it must give exactly."""

from dataclasses import dataclass

import numpy as np
import pytest

from toolbox import Component, Controller, Equations, Sampled, Update, closed_loop, compose, quantity, simulate, state
from toolbox.steady_states.linear_loop import NoDerivative
from toolbox.steady_states.sampled_matrix import common_period, matrix_over_period
from toolbox.steady_states.steady_loop import SampledPoint

STIFFNESS, DRAG = 40.0, (0.5, 0.2)


@dataclass(frozen=True)
class Shaft(Component):
    """Two rotors of 1 kg m2 and 2 kg m2 on a spring: a' = v - w, v' = T - c v - k a, 2 w' = S - d w + k a."""

    def equations(self, signal):
        a, v, w = state("shaft.twist", "rad"), state("left.speed", "rad/s"), state("right.speed", "rad/s")
        left, right = (signal(f"{side}.torque", "N m", default=0.0) for side in ("left", "right"))
        return Equations(flow={a: v - w, v: left - DRAG[0] * v - STIFFNESS * a, w: (right - DRAG[1] * w + STIFFNESS * a) / 2.0})


@dataclass(frozen=True)
class Integrating(Controller):
    """u = -p speed - i sum, where the sum grows by period speed; it also reads the torque that it drives, as it is held."""

    side: str = "left"
    p: float = quantity(3.0, "N m s/rad", "")
    i: float = quantity(5.0, "N m/rad", "")
    own: float = quantity(0.0, "1", "")

    @property
    def measured_signals(self):
        return (f"{self.side}.speed", f"{self.side}.torque")

    @property
    def actuated_signals(self):
        return (f"{self.side}.torque",)

    def sampled(self, signal, period):
        z = state(f"{self.side}.sum", "rad")
        speed = signal(f"{self.side}.speed", "rad/s")
        torque = self.own * signal(f"{self.side}.torque", "N m") - self.p * speed - self.i * z
        return Update({z: z + period * speed}, {f"{self.side}.torque": (torque, "N m")})


def loop_of(*laws):
    return closed_loop(compose(Shaft()), list(laws))


LOOPS = {
    "one sample time, no delay": [(0.02, 0.0, 0.0)],
    "a delay of a whole period": [(0.02, 0.02, 0.0)],
    "three periods in floating point": [(0.01, 0.03, 0.0)],
    "a delay by parts of a period": [(0.02, 0.053, 0.3)],
    "two sample times": [(0.004, 0.0, 0.3), (0.01, 0.0, 0.0)],
    "two sample times and delays": [(0.004, 0.003, 0.3), (0.01, 0.013, 0.2)],
    "arrivals at samples of the other": [(0.004, 0.002, 0.3), (0.006, 0.008, 0.2)],
}


@pytest.mark.parametrize("entries", LOOPS.values(), ids=LOOPS)
def test_the_matrix_leads_a_linear_loop_where_a_run_leads_it(entries):
    laws = [
        Sampled(Integrating(side, own=own, name=side), period, delay=delay)
        for side, (period, delay, own) in zip(("left", "right"), entries, strict=False)
    ]
    loop = loop_of(*laws)
    point = SampledPoint(loop.system, loop.assembly.plant, loop.assembly.clocks, {})
    slope = point.slope(np.zeros(point.n + point.h + point.z))
    matrix, span = matrix_over_period(point, slope)
    steps = int(np.ceil(0.6 / span))
    powers = np.linalg.matrix_power(matrix, steps)
    sums = [name for update in loop.system.updates for name in update.places]
    for k, name in enumerate([*loop.system.states, *sums]):
        begin = np.zeros(len(matrix))
        begin[k if k < point.n else point.h + k] = 1.0
        run = simulate(loop.replace(start={name: 1.0}), steps * span, accuracy=1e-12)
        np.testing.assert_allclose([run[each][-1] for each in loop.system.states], (powers @ begin)[: point.n], rtol=0, atol=1e-10)


def test_sample_times_come_round_together_and_refuse_to_where_they_never_do():
    assert common_period([0.004, 0.006]) == (pytest.approx(0.012), [3, 2])
    assert common_period([0.1 / 3, 0.1 / 3]) == (0.1 / 3, [1, 1])
    loop = loop_of(Sampled(Integrating("left", name="left"), 0.01), Sampled(Integrating("right", name="right"), 0.0100001))
    point = SampledPoint(loop.system, loop.assembly.plant, loop.assembly.clocks, {})
    with pytest.raises(NoDerivative, match="common period"):
        matrix_over_period(point, point.slope(np.zeros(point.n + point.h + point.z)))
