"""How fast a disturbance of smooth running grows: by poles, by differences of the sampled map and by twin runs, against each other and against matrices."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from controllers import PI, ImplicitSlidingMode, Lifting, SlidingMode, SoftTorque, SuperTwisting
from models import BitRock, TorsionalChain, wells
from toolbox import Sampled, closed_loop, compose, hopf_curve, hopf_points, onset
from toolbox.modelling.clocks import Clock
from toolbox.onsets.growth import SmoothBranch
from toolbox.onsets.sampled_map import section
from toolbox.onsets.search import OnsetSearch
from toolbox.onsets.twins import SAMPLES, _exponent, twin_growth
from toolbox.simulation.request import Request
from toolbox.steady_states.equilibria import EquilibriumBranch
from toolbox.steady_states.steady_loop import steady_loop

RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
REFERENCE = closed_loop(RIG, PI()).number("top.reference")
SWING = 5.6
"""Period of the string's swing [s]."""


def branch(law, continuous=None, plant=RIG):
    base = Request(closed_loop(plant, law, inputs={"top.reference": 6.0}), 1.0).checked()
    followed = EquilibriumBranch(closed_loop(RIG, continuous).system, REFERENCE, {}, None) if continuous is not None else None
    return SmoothBranch(base, lambda value: [(REFERENCE, value)], followed)


class PythonPI:
    """The law of `PI`, as an object in Python that begins with the torque that acts and tells its memory."""

    measured_signals, actuated_signals = ("top.speed",), ("top.torque",)

    def __init__(self, law, period=0.01):
        self.defaults = {"top.reference": (6.0, "rad/s"), "top.torque": (0.0, "N m")}
        self.proportional, self.integral, self.period, self.angle = law.proportional, law.integral, period, None

    def __call__(self, t, y):
        error = y[1] - y[0]
        if self.angle is None:
            self.angle = (y[2] - self.proportional * error) / self.integral if y[2] else 0.0
        torque = self.proportional * error + self.integral * self.angle
        self.angle += self.period * error
        return torque

    def get_memory(self):
        return [math.nan if self.angle is None else self.angle]

    def set_memory(self, values):
        self.angle = None if math.isnan(values[0]) else float(values[0])


def test_a_continuous_law_loses_smooth_running_at_its_hopf_point():
    found = branch(PI(), PI())
    assert found.loss(3.5, 5.0) == pytest.approx(hopf_points(closed_loop(RIG, PI()), "top.reference", (2.0, 8.0))[0].value, rel=1e-9)
    assert found(5.0).growth.way == "poles" and found.rate(5.0) < 0 < found.rate(3.5)


@pytest.mark.parametrize(
    "law",
    [
        Sampled(PI(), 0.01),
        Sampled(PI(), 0.01, delay=0.05),
        Sampled(SoftTorque(), 0.05, delay=0.07),
        Sampled(ImplicitSlidingMode(), 0.01),
        Sampled(SlidingMode(), 0.02),
    ],
    ids=["PI", "late PI", "late soft torque", "implicit sliding mode", "sliding mode"],
)
def test_matrix_over_the_period_and_differences_of_the_map_have_the_multipliers_of_the_loop_closed_at_its_commands(law):
    found, loop = branch(law), steady_loop(closed_loop(RIG, law, inputs={"top.reference": 5.0})).loop()
    multipliers = np.linalg.eigvals(loop.A + loop.B @ loop.C)  # closed: what the law gives is what the plant gets
    rate = math.log(np.abs(multipliers).max()) / law.period
    assert found(5.0).growth.way == "matrices"
    assert found.rate(5.0) == pytest.approx(rate, rel=1e-10)
    differences = found.by_runs(5.0).growth
    assert differences.way == "differences"
    assert abs(differences.rate - rate) <= differences.error < 1e-5


def zero_order_hold(a, b, period):
    whole = np.zeros((len(a) + 1, len(a) + 1))
    whole[:-1, :-1], whole[:-1, -1:] = a, b
    found = expm(whole * period)
    return found[:-1, :-1], found[:-1, -1:]


def string_at(speed):
    """Matrices of the string of two inertias about smooth running: x = (twist, speed of the top, of the bit), driven by the torque at the top."""
    rock = -97_347.0 * 0.155575 * 0.3 * 0.9 * math.exp(-0.9 * speed)  # slope of the rock torque by the speed
    a = np.array([[0, 1, -1], [-473 / 2122, -(23.2 + 425) / 2122, 23.2 / 2122], [473 / 374, 23.2 / 374, -(23.2 + 50 + rock) / 374]])
    return a, np.array([[0.0], [1 / 2122], [0.0]])


def growth_by_hand(law, speed):
    """Growth [1/s] of the string under a sampled PI with a delay, from its transition matrices: state (x, integral, torques on their way)."""
    period, (whole, part) = law.period, divmod(law.delay, law.period)
    whole = int(whole)
    a, b = string_at(speed)
    f, g = zero_order_hold(a, b, period)
    late = g - zero_order_hold(a, b, period - part)[1]
    matrix = np.zeros((5 + whole, 5 + whole))
    torque = np.zeros(5 + whole)
    torque[1], torque[3] = -law.law.proportional, law.law.integral
    past = [torque, *np.eye(5 + whole)[4:]]  # torque of this sample, of the one before, ...
    matrix[:3, :3] = f
    matrix[:3] += (g - late) * past[whole] + late * past[whole + 1]
    matrix[3, 1], matrix[3, 3] = -period, 1.0
    for k in range(whole + 1):
        matrix[4 + k] = past[k]
    return math.log(np.abs(np.linalg.eigvals(matrix)).max()) / period


@pytest.mark.parametrize(("period", "delay"), [(0.01, 0.0), (0.01, 0.034), (0.2, 0.13), (0.01, 0.4321)])
def test_the_border_of_a_sampled_pi_is_that_of_its_transition_matrices_and_its_tolerance_holds_the_distance(period, delay):
    law = Sampled(PI().design(RIG), period, delay=delay)
    right = brentq(lambda speed: growth_by_hand(law, speed), 2.0, 6.5, xtol=1e-14)
    [border] = onset(closed_loop(RIG, law, inputs={"top.reference": 6.0}), "top.reference", (3.0, 8.0), num_values=3, duration=60.0).losses
    assert border.followed == "matrices"
    assert abs(border.value - right) <= border.tolerance <= 1e-8
    [by_python] = search_losses(Sampled(PythonPI(law.law, period), period, delay=delay), border.value - 0.3, border.value + 0.3)
    assert by_python.followed == "differences"
    assert abs(by_python.value - right) <= by_python.tolerance < 1e-3


@pytest.mark.parametrize(("name", "low", "high"), [("softtorque.sample_time", 0.1, 0.6), ("softtorque.delay", 0.1, 0.6)])
def test_hopf_points_over_sample_time_and_delay_are_where_the_transition_matrices_say(name, low, high):
    law, word = SoftTorque(reference=9.0), {"softtorque.sample_time": "period", "softtorque.delay": "delay"}[name]
    loop, gains = closed_loop(RIG, Sampled(law, 0.01)), closed_loop(RIG, law).designed_controllers[0]
    right = brentq(lambda value: growth_by_hand(dataclasses.replace(Sampled(gains, 0.01), **{word: value}), 9.0), low, high, xtol=1e-14)
    point, other = hopf_points(loop, name, (low, high))  # the swing of the string and that of the integral
    assert point.value == pytest.approx(right, rel=1e-10) and point.stable == "below"
    found = SmoothBranch(Request(loop, 1.0).checked(), lambda value: [(loop.number(name), value)], None)
    assert found.loss(low, high) == pytest.approx(right, rel=1e-9)
    curve = hopf_curve(loop, name, (low, high), "bit.weight", [97_347.0, 80_000.0])
    assert curve[0] == pytest.approx(other.value, rel=1e-9) and other.value > right  # the outermost


def search_losses(law, low, high):
    """Borders of smooth running by the growth alone."""
    found = branch(law)
    search = OnsetSearch(base=found.run, branch=found, element="bit", signal="bit.speed", perturbation=1e-3, period=SWING, budget=10.0,
                         free=REFERENCE, followed=None)  # fmt: skip
    return search.losses([low, high], 1e-3)


def test_a_sampled_loop_loses_smooth_running_where_the_matrix_does_and_near_its_continuous_form():
    law = Sampled(PI(), 0.01, delay=0.05)
    lost = branch(law).loss(3.5, 5.0)
    loop = steady_loop(closed_loop(RIG, law, inputs={"top.reference": lost})).loop()
    assert np.abs(np.linalg.eigvals(loop.A + loop.B @ loop.C)).max() == pytest.approx(1.0, abs=1e-9)
    continuous = hopf_points(closed_loop(RIG, PI()), "top.reference", (2.0, 8.0))[0].value
    assert branch(Sampled(PI(), 0.001)).loss(3.5, 5.0) == pytest.approx(continuous, abs=3e-4)
    assert lost < branch(Sampled(PI(), 0.01)).loss(3.5, 5.0) < continuous


def test_a_law_around_another_and_one_in_python_lose_it_where_the_law_itself_does():
    law = PI().design(RIG)
    lost = branch(Sampled(law, 0.01)).loss(3.5, 5.0)
    assert branch(Sampled(Lifting(law), 0.01)).loss(3.5, 5.0) == pytest.approx(lost, abs=1e-7)
    assert branch(Sampled(PythonPI(law), 0.01)).loss(3.5, 5.0) == pytest.approx(lost, abs=1e-7)


@pytest.mark.parametrize("value", [3.7, 3.9, 4.1, 5.0])
@pytest.mark.parametrize("law", [Sampled(PI(), 0.01), Sampled(ImplicitSlidingMode(), 0.01)], ids=["PI", "implicit sliding mode"])
def test_twin_runs_agree_with_differences(law, value):
    found = branch(law)
    run, state = found.at(value), found(value).state
    twins = twin_growth(run, state, found.shaken(run, state), SWING)
    assert twins.way == "twin runs"
    assert twins.rate == pytest.approx(found.rate(value), abs=1e-6, rel=5e-3)
    assert twins.period == pytest.approx(found(value).growth.period, rel=5e-3)


def test_twin_runs_that_come_together_to_the_last_digit_tell_no_growth():
    """As two runs do under a law that decides by steps: what is between them is then exactly 0, at some of the instants or at all."""
    times = np.arange(2 * SAMPLES + 1) / SAMPLES
    apart = np.exp(-times)[:, None] * np.column_stack([np.cos(6.0 * times), np.sin(6.0 * times)])
    assert _exponent(apart, 1.0 / SAMPLES) == pytest.approx(-1.0 + 6.0j)
    for left in (1, 5, 0):
        assert np.isnan(_exponent(np.where(np.arange(times.size)[:, None] < left, apart, 0.0), 1.0 / SAMPLES))


def test_super_twisting_has_no_slope_at_its_surface_and_twin_runs_tell():
    """On its surface the top is held: what is left is the motion that an ideal sliding mode leaves, whose loss differs in the third decimal."""
    found = branch(Sampled(SuperTwisting(), 0.01))
    assert found(3.7).growth.way == "twin runs"
    assert found.loss(3.7, 3.75, 1e-4) == pytest.approx(branch(Sampled(ImplicitSlidingMode(), 0.01)).loss(3.5, 5.0), abs=1e-3)


SECOND = compose(
    TorsionalChain((2690.0, 293.0, 293.0), (1020.0, 1560.0), (30.0, 7.0), top_drag=66.0, bit_drag=36.0), BitRock(weight=78_400.0)
)
"""A string that loses smooth running in its second swing, of less than half of the period of the first, which dies ten times as fast."""


@pytest.mark.parametrize("value", [3.6, 3.625, 3.8, 4.0])
def test_the_growth_is_that_of_the_swing_that_a_run_shows_at_last_also_where_it_is_not_the_first(value):
    found = branch(Sampled(SuperTwisting(), 0.01), plant=SECOND)
    run, smooth = found.at(value), found(value)
    kicked = smooth.state.states + 1e-5 * found.shaken(run, smooth.state)
    shown = run.again(start=dataclasses.replace(smooth.state, states=kicked), duration=300.0, accuracy=1e-11)
    early, late = (np.ptp(shown.at(np.linspace(end - 30.0, end, 6001))["bit.speed"]) for end in (200.0, 300.0))
    assert smooth.growth.rate == pytest.approx(math.log(late / early) / 100.0, abs=1e-4)
    assert smooth.growth.period == pytest.approx(1.764, abs=5e-3)


def test_what_does_not_act_back_has_no_part_in_the_growth():
    """A law whose memory drifts, and is only shown, leaves the growth as it is."""

    class Counting(PythonPI):
        samples = 0.0

        def __call__(self, t, y):
            self.samples = 1.5 * self.samples + 1e-3 * y[0]
            return super().__call__(t, y)

        def get_memory(self):
            return [*super().get_memory(), self.samples]

        def set_memory(self, values):
            super().set_memory(values[:1])
            self.samples = float(values[1])

    law = PI().design(RIG)
    plain = branch(Sampled(PythonPI(law), 0.01))
    assert branch(Sampled(Counting(law), 0.01)).rate(5.0) == pytest.approx(plain.rate(5.0), rel=1e-6)


def test_noise_is_left_out_of_the_growth():
    noisy = Sampled(PI(), 0.01, noise={"top.speed": 0.1}, seed=3)
    assert branch(noisy).rate(5.0) == pytest.approx(branch(dataclasses.replace(noisy, noise={})).rate(5.0), rel=1e-12)


def test_the_map_begins_where_no_sample_is_taken_and_none_arrives():
    phase, common = section([Clock(0.01), Clock(0.004, 0.003)])
    assert common == pytest.approx(0.02)
    marks = [k * 0.01 for k in range(3)] + [k * 0.004 for k in range(6)] + [k * 0.004 + 0.003 for k in range(6)]
    assert min(abs(phase - mark) for mark in marks) > 2e-4
