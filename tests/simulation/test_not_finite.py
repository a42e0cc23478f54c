"""Controllers whose values are no finite numbers: an error that names controller, signal and time, wherever they run.

The law here holds z_k = g^k at sample k, z_0 = 1, and commands clip(z_k^2 - 3 z_k^2, -1, 1): from the k on at which z_k^2 is beyond the largest number, that is
the clip of inf - inf, which fmin and fmax alone would turn into a limit.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
import pytest

from tests.mechanisms import Tank
from toolbox import (
    Controller,
    Equations,
    Sampled,
    SimulationError,
    Update,
    closed_loop,
    compose,
    quantity,
    simulate,
    state,
    stepper,
    sweep,
)
from toolbox.compilation import work_layout
from toolbox.errors import ControllerError
from toolbox.lanes.lanes import Lanes
from toolbox.sweeps.designs import grid
from toolbox.sweeps.variants import shared_run, varied_numbers

PERIOD = 0.01


@dataclass(frozen=True)
class Growing(Controller):
    """See the module."""

    measured_signals = ("tank.level",)
    actuated_signals = ("tank.inflow",)

    growth: float = quantity(1.0, "1", "factor g of the memory from sample to sample")

    def continuous(self, signal):
        z = state("growing.size", "1")
        return Equations(
            flow={z: self.growth * (1.0 + z) ** 2}, outputs={"tank.inflow": (ca.fmin(z, 1.0) + 0.0 * signal("tank.level", "m"), "m/s")}
        )

    def sampled(self, signal, period):
        log = state("growing.exponent", "1")
        size = ca.exp(log) + 0.0 * signal("tank.level", "m")
        wanted = size**2 - 3.0 * size**2
        return Update({log: log + ca.log(self.growth)}, {"tank.inflow": (ca.fmin(ca.fmax(wanted, -1.0), 1.0), "m/s")})


def sample_of(growth: float) -> int:
    """The first sample whose square of the size is no number: g^(2 k) > largest number."""
    return math.floor(math.log(sys.float_info.max) / (2.0 * math.log(growth))) + 1


PLANT = compose(Tank())


@pytest.mark.parametrize("growth", [3.0, 1e10])
@pytest.mark.parametrize("method", ["event", "time-stepping"])
@pytest.mark.parametrize("delay", [0.0, 2.5 * PERIOD])
def test_a_clip_of_a_value_that_is_no_number_is_an_error_at_its_sample_and_no_limit(growth, method, delay):
    arguments = {"controller": Sampled(Growing(growth), PERIOD, delay=delay), "method": method}
    last = (sample_of(growth) - 1) * PERIOD
    before = simulate(PLANT, last, **arguments)
    assert before["tank.inflow"][-1] == -1.0  # at all samples before, the command is the lower limit by right
    with pytest.raises(
        ControllerError, match=r"Controller `Growing` must give finite numbers, but `tank.inflow` is -?nan at t = "
    ) as found:
        simulate(PLANT, last + 1.0, **arguments)
    assert found.value.run.time[-1] == pytest.approx(last + PERIOD) or found.value.run.end == pytest.approx(last + PERIOD)
    assert found.value.run.last["tank.level"] == pytest.approx(-(last + PERIOD - delay), abs=2 * PERIOD)


@pytest.mark.parametrize("start", [math.inf, -math.inf])
def test_a_memory_that_is_infinite_is_an_error_that_names_it(start):
    @dataclass(frozen=True)
    class Counting(Growing):
        """Its memory is beyond all numbers at sample 4, and does nothing to the command."""

        def sampled(self, signal, period):
            z = state("counting.size", "1")
            return Update(
                {z: ca.if_else(z == 0.0, math.copysign(1e80, start), z * 1e80)}, {"tank.inflow": (0.0 * signal("tank.level", "m"), "m/s")}
            )

    with pytest.raises(ControllerError, match=rf"Controller `Counting` .* `counting.size` is {start:g} at t = 0.03 s"):
        simulate(PLANT, 1.0, controller=Counting(), sample_time=PERIOD)


def test_a_continuous_controller_that_grows_beyond_all_numbers_is_named():
    # z' = g (1 + z)^2 from 0: z = 1 / (1 - g t) - 1, which has no end at t = 1 / g
    with pytest.raises(ControllerError, match=r"`Growing` must give finite numbers: .*`growing.size`"):
        simulate(PLANT, 3.0, controller=Growing(0.5))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_controller_in_python_that_answers_no_number_is_named(bad):
    def broken(t, y):
        return bad if t > 0.045 else 1.0

    broken.measured_signals, broken.actuated_signals = ("tank.level",), ("tank.inflow",)
    with pytest.raises(ControllerError, match=r"for tank.inflow, but at t = 0.05 s `broken` returned") as found:
        simulate(PLANT, 1.0, controller=Sampled(broken, PERIOD))
    assert found.value.run.last["tank.level"] == pytest.approx(0.05)


def test_a_controller_in_python_that_overflows_is_named():
    def squaring(t, y):
        return (1.0 + 1e200 * (t > 0.025)) ** 2.0  # an OverflowError of Python

    squaring.measured_signals, squaring.actuated_signals = ("tank.level",), ("tank.inflow",)
    with pytest.raises(ControllerError, match=r"at t = 0.03 s `squaring` overflows") as found:
        simulate(PLANT, 1.0, controller=Sampled(squaring, PERIOD))
    assert found.value.run.last["tank.level"] == pytest.approx(0.03)


@dataclass(frozen=True)
class Around(Growing):
    """A law around one in Python: its own clip stands behind the answer of the other."""

    law: Controller = field(default_factory=Growing)

    def design(self, plant):
        def inside(t, y):
            return 0.0

        inside.measured_signals, inside.actuated_signals, inside.dt = ("tank.level",), ("tank.inflow",), PERIOD
        return Around(self.growth, inside)

    def sampled(self, signal, period):
        own = super().sampled(signal, period)
        return Update(self.law.sampled(signal, period).memory | own.memory, own.outputs)


def test_a_law_around_one_in_python_is_no_hiding_place():
    with pytest.raises(ControllerError, match=r"for tank.inflow, but at t = .* `LawInPython` returned"):
        simulate(PLANT, 2.0, controller=Around(10.0), sample_time=PERIOD)


@pytest.mark.parametrize("delay", [0.0, 2.5 * PERIOD])
def test_lanes_fail_alone_with_the_reason_and_their_neighbours_do_not(delay):
    growths = np.geomspace(1.0 + 1e-9, 1e12, 40)
    variations, loop = grid({"growing.growth": growths.tolist()}), closed_loop(PLANT, Sampled(Growing(), PERIOD, delay=delay))
    fails = np.array([growth > 1.1 and sample_of(growth) * PERIOD < 1.0 - 1e-9 for growth in growths])
    assert 5 < fails.sum() < 38
    run = shared_run(loop, variations, 1.0, method="explicit")
    made, numbers = Lanes(run), varied_numbers(run, variations)[0]
    batch = made.run(numbers, np.zeros((40, 1)))
    np.testing.assert_array_equal(batch.statuses, np.where(fails, work_layout.NOT_FINITE, work_layout.DONE))
    last = np.array([sample_of(growth) * PERIOD if fail else 1.0 for growth, fail in zip(growths, fails, strict=True)])
    np.testing.assert_allclose(batch.states[:, 0], -(last - delay), atol=1e-12)  # the lower limit from the first command on
    found = sweep(loop, variations, 1.0, metrics={"level": lambda run: run["tank.level"][-1]})
    assert set(found.failures) == set(np.flatnonzero(fails))
    assert all("Controller `Growing` must give finite numbers" in text for text in found.failures.values())


def test_a_machine_that_is_stepped_says_it_too():
    loop = closed_loop(PLANT, Growing(), sample_time=PERIOD)
    machine = stepper(loop, PERIOD, inputs="growing.growth", outputs="tank.level", duration=1.0)
    for _ in range(3):
        machine.step(1.0)
    with pytest.raises(ControllerError, match=r"Controller `Growing` .* `tank.inflow` is -?nan"):
        for _ in range(sample_of(1e5) + 2):
            machine.step(1e5)
    assert issubclass(ControllerError, SimulationError)
