"""What stands between plant and law: noise that is a function of its sample, encoders, memories as signals, takeovers and estimates."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy import stats

from controllers import PI, SoftTorque, StiffPI
from models import BitRock, TopDrive, wells
from tests.plants import RIG
from tests.refusals import refusals
from toolbox import Component, Controller, Equations, Sampled, SceneError, Update, compose, quantity, simulate, state
from toolbox.inputs import step
from toolbox.modelling import Observer, ObserverBasedController, Takeover


@dataclass(frozen=True)
class Line(Component):
    """a' = slope_a + u, b' = slope_b: two signals to be measured."""

    slope: float = quantity(0.0, "m/s", "slope of a")

    def equations(self, signal):
        a, b = state("line.a", "m"), state("line.b", "m")
        return Equations(flow={a: self.slope + signal("line.push", "m/s", default=0.0), b: 0})


@dataclass(frozen=True)
class Meter(Controller):
    """Holds what it measures; 0 where nothing gives it."""

    measured: str = "line.a"
    actuated_signals = ("meter.value",)

    def sampled(self, signal, period):
        return Update(memory={}, outputs={"meter.value": (signal(self.measured, "m", default=0.0), "m")})


LINE = compose(Line())
SLOPE = 0.01 * math.sqrt(2)  # never half-way between two steps


def readings(count, plant=LINE, law=None, **arguments):
    """What a law reads at `count` samples, one per second."""
    run = simulate(plant, float(count), controller=Sampled(law or Meter(), 1.0, **arguments), output_times=np.arange(count) + 0.5)
    return run["meter.value"]


# --- noise


def test_noise_is_white_and_normal_with_the_standard_deviation_asked_for():
    n = 20_000
    noise = readings(n, noise={"line.a": 0.3}) / 0.3
    assert stats.kstest(noise, "norm").pvalue > 1e-3
    assert abs(noise.mean()) < 4 / math.sqrt(n)
    assert abs(noise.var() - 1) < 4 * math.sqrt(2 / n)
    assert abs(stats.kurtosis(noise)) < 4 * math.sqrt(24 / n)
    for lag in (1, 2, 3, 10, 100):
        assert abs(np.mean(noise[lag:] * noise[:-lag])) < 4 / math.sqrt(n)


def test_seeds_and_signals_have_noise_of_their_own():
    n = 4000
    rows = [readings(n, noise={"line.a": 1.0}, seed=seed) for seed in (0, 1, 2, 2**40)]
    rows.append(readings(n, law=Meter("line.b"), noise={"line.b": 1.0}))
    together = np.corrcoef(rows)
    assert np.abs(together - np.eye(len(rows))).max() < 4.5 / math.sqrt(n)


def test_noise_is_a_function_of_seed_signal_and_sample_alone():
    # another plant, other outputs, a second law before it, more samples: the same numbers
    alone = readings(50, noise={"line.a": 1.0}, seed=7)
    np.testing.assert_array_equal(readings(3000, noise={"line.a": 1.0}, seed=7)[:50], alone)
    other = Sampled(PI(name="other"), 0.3, noise={"top.speed": 1.0}, seed=7)
    both = simulate(compose(Line(), wells.JANSEN_2), 50.0, controller=[other, Sampled(Meter(), 1.0, noise={"line.a": 1.0}, seed=7)])
    np.testing.assert_array_equal(both.at(np.arange(50) + 0.5)["meter.value"], alone)


def test_a_python_function_sees_the_noise_that_a_compiled_law_sees():
    seen = []

    def law(t, y):
        seen.append(y[0])
        return 0.0

    law.measured_signals, law.actuated_signals = ("line.a",), ("line.push",)
    simulate(LINE, 30.0, controller=Sampled(law, 1.0, noise={"line.a": 0.2}, resolution={"line.a": 0.01}, seed=3))
    np.testing.assert_allclose(seen, readings(30, noise={"line.a": 0.2}, resolution={"line.a": 0.01}, seed=3), rtol=1e-13)


def test_a_python_function_behind_a_top_drive_is_given_the_noise_by_the_name_it_asked_for():
    plant = compose(wells.JANSEN_2, BitRock(), TopDrive(encoder_lag=None, drive_lag=None))
    seen = []

    def law(t, y):
        seen.append(y[0])
        return 0.0

    silent = simulate(plant, 1.0, controller=Sampled(law, 0.1))
    quiet, seen = np.array(seen), []
    simulate(plant, 1.0, controller=Sampled(law, 0.1, noise={"top.speed": 0.5}, seed=4))
    assert np.all(quiet == 0.0) and silent.at(1.0)["top.speed"] == 0.0
    meter = simulate(compose(Line()), 1.0, controller=Sampled(Meter("top.speed"), 0.1, noise={"top.speed": 0.5}, seed=4))
    np.testing.assert_allclose(seen, meter.at((np.arange(10) + 0.5) * 0.1)["meter.value"], rtol=1e-13)


def test_the_error_of_a_noisy_run_is_that_of_its_steps_and_not_that_of_its_noise():
    def noisy(seed, **changes):
        return simulate(RIG, 20.0, controller=Sampled(PI(), 0.01, noise={"top.speed": 0.05}, seed=seed), **changes)

    run = noisy(1)
    assert run.error_estimate < 1e-5
    again = noisy(1, output_times=np.linspace(0, 20, 100))
    np.testing.assert_array_equal(again["bit.speed"], run.at(np.linspace(0, 20, 100))["bit.speed"])
    assert np.abs(again["bit.speed"] - noisy(2).at(again.time)["bit.speed"]).max() > 1e-3


def test_no_noise_is_no_change():
    exact = simulate(RIG, 5.0, controller=Sampled(PI(), 0.01))
    silent = simulate(RIG, 5.0, controller=Sampled(PI(), 0.01, noise={"top.speed": 0.0}))
    np.testing.assert_allclose(silent.at(5.0).states, exact.at(5.0).states, rtol=1e-12)  # the sum with zero is rounded once more


# --- encoders


@pytest.mark.parametrize("resolution", [0.25, 0.1, 1e-3])
def test_an_encoder_rounds_to_the_nearest_of_its_steps(resolution):
    plant = compose(Line(slope=SLOPE))
    times = np.arange(400)
    run = simulate(plant, 400.0, controller=Sampled(Meter(), 1.0, resolution={"line.a": resolution}), output_times=times + 0.5)
    steps = run["meter.value"] / resolution
    np.testing.assert_allclose(steps, np.floor(SLOPE * times / resolution + 0.5), atol=1e-9)
    assert np.abs(run["meter.value"] - SLOPE * times).max() <= resolution / 2 * (1 + 1e-9)


def test_noise_comes_before_the_encoder():
    values = readings(500, noise={"line.a": 1.0}, resolution={"line.a": 0.5})
    np.testing.assert_array_equal(values, 0.5 * np.round(values / 0.5))
    np.testing.assert_array_equal(values, 0.5 * np.floor(readings(500, noise={"line.a": 1.0}) / 0.5 + 0.5))


# --- memories


def test_the_memory_of_a_sampled_law_is_a_signal_and_takes_start_values():
    run = simulate(RIG, 5.0, controller=Sampled(PI(), 0.1), start={"pi.angle": 2.0})
    k = np.arange(50)
    error = 8.0 - run.at(k * 0.1)["top.speed"]
    np.testing.assert_allclose(run.at((k + 0.5) * 0.1)["pi.angle"], 2.0 + 0.1 * np.concatenate([[0], np.cumsum(error[:-1])]), rtol=1e-12)
    held = run.at((k + 0.5) * 0.1)
    np.testing.assert_allclose(held["top.torque"], 4000.0 * error + 1500.0 * held["pi.angle"], rtol=1e-12)


# --- switched on in the middle


def test_a_law_that_takes_over_acts_as_one_that_starts_from_that_instant_with_the_torque_that_was():
    whole = simulate(RIG, 40.0, controller=Takeover(StiffPI(), SoftTorque(), at=25.0), sample_time=0.05, accuracy=1e-9)
    first = simulate(RIG, 25.0, controller=StiffPI(), sample_time=0.05, accuracy=1e-9)
    times = np.linspace(0.0, 24.9, 40)
    np.testing.assert_allclose(whole.at(times)["bit.speed"], first.at(times)["bit.speed"], atol=1e-9)
    # the integral of the drive that takes over begins where it gives the torque of the drive before it
    law, last = SoftTorque().design(RIG), first.at(25.0 - 0.025)["top.torque"]
    angle = (last - law.proportional * (8.0 - first.at(25.0)["top.speed"])) / law.integral
    start = {name: first.at(25.0)[name] for name in RIG.states} | {"pi.angle": angle}
    second = simulate(RIG, 15.0, controller=law, sample_time=0.05, start=start, accuracy=1e-9)
    times = np.linspace(0.0, 15.0, 40)
    np.testing.assert_allclose(whole.at(25.0 + times)["bit.speed"], second.at(times)["bit.speed"], atol=1e-6)


def test_soft_torque_switched_on_in_stick_slip_ends_it_and_the_stiff_drive_keeps_it():
    stiff = simulate(RIG, 150.0, controller=StiffPI(reference=10.0), sample_time=0.01)
    assert stiff.time_in("bit", "stick", after=100.0) > 5.0
    soft = simulate(RIG, 150.0, controller=Takeover(StiffPI(reference=10.0), SoftTorque(reference=10.0), at=50.0), sample_time=0.01)
    assert soft.time_in("bit", "stick", after=30.0, until=50.0) > 2.0
    assert soft.time_in("bit", "stick", after=100.0) == 0.0


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda: simulate(RIG, 1.0, controller=Sampled(PI(), 0.1), start={"pi.angle": (1.0, 2.0)}), r"pi\.angle"),
    (lambda: simulate(RIG, 1.0, controller=Takeover(PI(), Meter("chain.twist.0")), sample_time=0.1), r"top\.torque"),
    (lambda: simulate(LINE, 1.0, start=simulate(RIG, 1.0).at(0.5)), r"line\.a"),
)  # fmt: skip


def test_a_run_cut_in_two_goes_on_as_the_whole_one_with_the_integral_of_its_drive():
    whole = simulate(RIG, 40.0, controller=StiffPI(reference=6.0), accuracy=1e-10)
    rest = simulate(RIG, 20.0, controller=StiffPI(reference=6.0), start=whole.at(20.0), accuracy=1e-10)
    assert whole.time_in("bit", "stick", after=20.0) > 1.0  # it sticks and slips
    for name in ("bit.speed", "stiffpi.angle"):
        np.testing.assert_allclose(rest.at(np.linspace(0, 20, 50))[name], whole.at(np.linspace(20, 40, 50))[name], atol=1e-7)


# --- profiles


def test_set_points_and_weights_may_change_in_time():
    run = simulate(
        RIG, 200.0, controller=SoftTorque(), sample_time=0.01,
        inputs={"top.reference": ((0.0, 100.0, 110.0), (8.0, 8.0, 10.0)), "bit.weight": step(80_000.0, 97_347.0, 150.0)},
    )  # fmt: skip
    assert run.at(99.0)["bit.speed"] == pytest.approx(8.0, rel=1e-3)
    assert run.at(149.0)["bit.speed"] == pytest.approx(10.0, rel=1e-3)
    before, after = run.at(149.9), run.at(200.0)
    # the torque at the bit is W R_b mu(w)
    for point, weight in ((before, 80_000.0), (after, 97_347.0)):
        speed = point["bit.speed"]
        assert point["bit.torque"] == pytest.approx(weight * 0.155575 * (0.5 + 0.3 * math.exp(-0.9 * speed)), rel=1e-12)


# --- estimates


@dataclass(frozen=True)
class Ramp(Controller):
    """u_k = 1 + the number of the sample; it asks for `line.b`, which an observer may stand in for."""

    measured_signals, actuated_signals = ("line.b",), ("line.push",)

    def sampled(self, signal, period):
        count = state("ramp.count", "1")
        return Update(memory={count: count + 1}, outputs={"line.push": (1 + count + 0 * signal("line.b", "m"), "m/s")})


@dataclass(frozen=True)
class Count(Observer):
    """An exact observer of line.a, b_hat' = u, from the command alone."""

    measured_signals, estimates = (), ("line.b",)

    def sampled(self, signal, period):
        level = state("count.level", "m")
        return Update(memory={level: level + period * signal("line.push", "m/s")}, outputs={"line.b": (level, "m")})


@pytest.mark.parametrize("late", [0, 1, 3])
def test_an_observer_knows_the_commands_that_have_reached_the_plant_and_no_others(late):
    run = simulate(LINE, 10.0, controller=Sampled(ObserverBasedController(Ramp(), Count(), delay_samples=late), 0.1, delay=0.1 * late))
    k = np.arange(late, 99)
    level = run.at(k * 0.1)["line.a"]
    estimate = run.at((k + late + 0.5) * 0.1 if late == 0 else np.minimum((k + late) * 0.1 + 0.05, 10.0))["estimate.line.b"]
    np.testing.assert_allclose(estimate[: 90 - late], level[: 90 - late], rtol=1e-9, atol=1e-12)


def test_an_estimate_of_another_unit_is_refused():
    @dataclass(frozen=True)
    class Wrong(Count):
        def sampled(self, signal, period):
            return Update(memory={}, outputs={"line.b": (0, "N")})

    with pytest.raises(SceneError, match="units"):
        simulate(LINE, 1.0, controller=ObserverBasedController(Ramp(), Wrong()), sample_time=0.1)


def test_an_estimate_that_depends_on_the_command_of_its_instant_is_refused():
    @dataclass(frozen=True)
    class Loop(Count):
        def sampled(self, signal, period):
            return Update(memory={}, outputs={"line.b": (signal("line.push", "m/s"), "m")})

    with pytest.raises(SceneError, match="same instant"):
        simulate(LINE, 1.0, controller=ObserverBasedController(Ramp(), Loop()), sample_time=0.1)


# --- what is refused


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"noise": {"top.speed": -0.1}}, "noise"),
        ({"noise": {"top.speed": math.nan}}, "noise"),
        ({"noise": 0.1}, "noise"),
        ({"noise": {"top.sped": 0.1}}, r"top\.sped.*top\.speed"),
        ({"noise": {"bit.speed": 0.1}}, r"bit\.speed"),
        ({"resolution": {"top.speed": 0.0}}, "resolution"),
        ({"resolution": {"bit.speed": 0.1}}, r"bit\.speed"),
        ({"seed": -1}, "seed"),
        ({"seed": 1.5}, "seed"),
        ({"seed": True}, "seed"),
    ],
    ids=str,
)
def test_bad_sensors_are_refused_by_name(arguments, word):
    for law in (PI(), lambda t, y: 0.0):
        with pytest.raises(SceneError, match=word):
            simulate(RIG, 1.0, controller=Sampled(law, 0.1, **arguments))
