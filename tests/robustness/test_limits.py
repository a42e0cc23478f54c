"""Limits of performance against closed forms, against laws that come as near as one likes, and against every shipped law."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import minimize

from controllers import LQG, LQR, PI, ActiveDamping, HInfinity, SoftTorque, StiffPI, ZTorque
from models import BitRock, TopDrive, TorsionalChain, wells
from toolbox import Component, Equations, Sampled, SceneError, closed_loop, compose, equilibrium, linearise, margins, quantity, state
from toolbox.robustness import absorber_limit, performance_limit
from toolbox.robustness.limits import gramian, interpolation, smallest_peak
from toolbox.steady_states.running import running

WEIGHT = 97_347.0
FALL = WEIGHT * 0.155575 * 0.3 * 0.9  # slope of the rock's torque at standstill [N m s/rad]
K, J_BIT = 473.0, 374.0


@pytest.fixture(scope="module")
def rig():
    return compose(wells.JANSEN_2, BitRock(weight=WEIGHT))


@dataclass(frozen=True)
class Unstable(Component):
    """x' = p x + w, w' = zero form: y = (s - z) / ((s - p) (s + 1)) u, in the states of the observer form."""

    pole: float = quantity(1.0, "1/s", "")
    zero: float = quantity(3.0, "1/s", "")

    def equations(self, signal):
        a, b = state("plant.a", "1"), state("plant.b", "1")
        u = signal("plant.u", "1", default=0.0)
        flow = {a: b + (self.pole - 1.0) * a + u, b: self.pole * a - self.zero * u}
        return Equations(flow=flow, outputs={"plant.y": (a, "1")})


def limit_of(pole, zero, **how):
    return performance_limit(compose(Unstable(pole, zero)), {"plant.y": 0.0}, measured_signals="plant.y", actuated_signals="plant.u", **how)


# --- closed forms


@pytest.mark.parametrize(("pole", "zero"), [(1.0, 3.0), (2.0, 0.5), (1.0, 40.0)])
def test_a_pole_and_a_zero_leave_what_the_textbook_says(pole, zero):
    # |S| >= (z + p) / |z - p| (Doyle, Francis, Tannenbaum, section 6.2);  |S - T| >= (sqrt z + sqrt p) / |sqrt z - sqrt p| by the Pick matrix of two points
    found = limit_of(pole, zero)
    assert found.peak_sensitivity == pytest.approx((zero + pole) / abs(zero - pole), rel=1e-9)
    roots = math.sqrt(zero), math.sqrt(pole)
    assert found.disk_margin == pytest.approx(2 * abs(roots[0] - roots[1]) / sum(roots), rel=1e-9)
    assert found.poles == pytest.approx([pole]) and found.zeros == pytest.approx([zero])


def test_a_stable_plant_or_one_without_zeros_has_no_limit_but_two(rig):
    assert limit_of(-2.0, 3.0).disk_margin == 2.0
    assert limit_of(1.0, -3.0).disk_margin == 2.0
    assert limit_of(1.0, 3.0).disk_margin < 1.0


@pytest.mark.parametrize("period", [0.1, 0.5])
def test_an_unstable_pole_behind_one_sample_leaves_the_circle_of_schwarz_and_pick(period):
    # f(0) = 1 and f(1 / p) = -1 on the disk: 2 g / (g^2 + 1) <= 1 / p for the smallest peak g
    found = limit_of(1.0, -3.0, period=period)
    assert found.samples == 1
    q = math.exp(-period)
    assert 2 / found.disk_margin == pytest.approx((1 + math.sqrt(1 - q**2)) / q, rel=1e-9)
    assert found.peak_sensitivity == pytest.approx(
        math.exp(period), rel=1e-9
    )  # f(0) = 1 and f(1 / p) = 0 times the Blaschke factor of 1 / p


def test_a_delay_of_samples_takes_what_a_power_of_the_pole_allows():
    # S = B f, B the Blaschke factor of q = 1 / p, and f = 1 / B up to the power k of a disk: the norm of the Toeplitz matrix of the series of 1 / B
    q = math.exp(-0.1)
    for delay in (0.1, 0.3, 1.0):
        found = limit_of(1.0, -3.0, period=0.1, delay=delay)
        k = round(delay / 0.1) + 1
        assert found.samples == k
        series = np.array([1 / q] + [(1 / q - q) / q**j for j in range(1, k)])  # (1 - q x) / (q - x)
        toeplitz = sum(np.diag(np.full(k - j, series[j]), -j) for j in range(k))
        assert found.peak_sensitivity == pytest.approx(np.linalg.norm(toeplitz, 2), rel=1e-7)


def test_a_delay_takes_margin_and_a_part_of_a_period_no_more_than_a_whole_one(rig):
    margin = [performance_limit(rig, {"top.speed": 3.0}, period=0.1, delay=delay).disk_margin for delay in (0.0, 0.1, 0.15, 0.2)]
    assert margin[0] > margin[1] > margin[3]
    # up to half a period late, the hold of two steps has its zero inside the circle, where a law may take it away: nothing is lost but what the hold is
    assert margin[3] < margin[2] < 1.005 * margin[1]
    fast = performance_limit(rig, {"top.speed": 3.0}, period=1e-3).disk_margin
    assert fast == pytest.approx(performance_limit(rig, {"top.speed": 3.0}).disk_margin, rel=1e-3)


# --- the bound is reached


def optimal(found, poles, zeros, samples, period):
    """f of the smallest peak as a function of 1 / z: f = g^2 a* (1 - x L*)^-1 v / b* (1 - x L*)^-1 v with (P_a - P_b / g^2) v = 0."""
    points, a, b = interpolation(poles, zeros, samples, period, -1.0)
    peak = 2.0 / found.disk_margin
    matrix = gramian(points, a) - gramian(points, b) / peak**2
    v = np.linalg.eigh(matrix)[1][:, 0]

    def f(x):
        inner = np.linalg.solve(np.eye(a.size) - x * points.conj().T, v)
        return peak**2 * (a.conj() @ inner) / (b.conj() @ inner)

    return f, peak


@pytest.mark.parametrize(("speed", "period", "delay"), [(3.0, 0.1, 0.03), (2.6, 0.1, 0.1), (3.6, 0.2, 0.25)])
def test_a_law_of_interpolation_reaches_the_limit_and_stabilises_the_plant(rig, speed, period, delay):
    from toolbox.robustness.limits import sampled_plant

    found = performance_limit(rig, {"top.speed": speed}, period=period, delay=delay)
    poles, zeros = np.exp(found.poles * period), np.exp(found.zeros * period)
    f, peak = optimal(found, poles, zeros, found.samples, period)
    turn = np.exp(2j * np.pi * np.arange(2**14) / 2**14)
    np.testing.assert_allclose(np.abs([f(x) for x in turn]), peak, rtol=1e-5)  # flat: no frequency is better than another
    for pole in poles:
        assert f(1 / pole) == pytest.approx(-1.0, abs=1e-5)
    for zero in zeros:
        assert f(1 / zero) == pytest.approx(1.0, abs=1e-5)
    # the law is K = L / G with L = (1 - f) / (1 + f); it stabilises the plant if T, K S = T / G and G S have no poles outside the circle: no negative
    # powers of 1 / z in their series
    point = running(rig, {"top.speed": speed}, "top.torque")
    linear = linearise(point.plant, point, inputs="top.torque", outputs="top.speed")
    whole = int(delay / period + 1e-9)
    a, b, c, _ = sampled_plant(linear.A, linear.B, linear.C, linear.D, period, delay - whole * period)

    def plant(z):
        return (c @ np.linalg.solve(z * np.eye(a.shape[0]) - a, b))[0, 0] * z**-whole

    for function in (lambda x: (1 - f(x)) / 2, lambda x: (1 - f(x)) / 2 / plant(1 / x), lambda x: plant(1 / x) * (1 + f(x)) / 2):
        series = np.fft.fft([function(x) for x in turn]) / turn.size
        assert np.abs(series[turn.size // 2 :]).max() < 1e-6 * np.abs(series).max()
    # the plant itself has such powers: the test would see what is not stable
    series = np.fft.fft([plant(1 / x) for x in turn]) / turn.size
    assert np.abs(series[turn.size // 2 :]).max() > 0.1 * np.abs(series).max()


def test_no_function_goes_below_the_smallest_peak():
    # by search: f = 1 + x^2 h with h a polynomial that brings f(q) to -1, largest on the circle; no degree gets below the limit, and high ones come near it
    q, k = math.exp(-0.3), 2
    peak = smallest_peak(np.array([1 / q]), np.empty(0), k, 0.1, -1.0)
    turn = np.exp(1j * np.linspace(0, np.pi, 400))

    def curve(free):  # the last coefficient of h is set by f(q) = -1
        last = (-2.0 / q**k - np.polyval(np.append(free, 0.0)[::-1], q)) / q**free.size
        return np.abs(1 + turn**k * np.polyval(np.append(free, last)[::-1], turn))

    reached = []
    for degree in (1, 4, 12):
        free = minimize(
            lambda free: float((curve(free) ** 60).mean() ** (1 / 60)), np.zeros(degree), method="BFGS", options={"maxiter": 400}
        ).x
        reached.append(curve(free).max())
    assert min(reached) >= peak * (1 - 1e-6)
    assert reached[-1] < 1.06 * peak and reached[-1] < reached[0]


@pytest.mark.parametrize("speed", [3.4, 4.0, 5.0])
def test_no_shipped_law_surpasses_the_limit(rig, speed):
    best = performance_limit(rig, {"top.speed": speed}, period=0.01, delay=0.03)
    laws = [
        StiffPI(reference=speed), PI(reference=speed), ActiveDamping(reference=speed), SoftTorque(reference=speed), ZTorque(reference=speed, filter_time=0.02),
        HInfinity(reference=speed), LQG(reference=speed, delay_samples=3),
    ]  # fmt: skip
    found = [margins(closed_loop(rig, Sampled(law, 0.01, 0.03)), by_simulation=False) for law in laws]
    assert any(each.stable for each in found)
    for each in found:
        assert not each.stable or (each.disk_margin <= best.disk_margin and each.peak_sensitivity >= best.peak_sensitivity)


def test_a_law_that_sees_the_bit_may_surpass_the_limit_of_those_that_do_not(rig):
    speed = 3.4
    top = performance_limit(rig, {"top.speed": speed}, period=0.01, delay=0.03)
    both = performance_limit(rig, {"top.speed": speed}, measured_signals=("top.speed", "bit.speed"), period=0.01, delay=0.03)
    law = margins(closed_loop(rig, Sampled(LQR(reference=speed), 0.01, 0.03)))
    assert top.disk_margin < law.disk_margin < both.disk_margin


def test_the_zeros_of_the_top_speed_are_the_poles_of_a_string_held_at_its_top(rig):
    # J_b s^2 + (c + c_b - fall exp(-0.9 w)) s + k = 0
    speed = 3.0
    found = performance_limit(rig, {"top.speed": speed})
    expected = np.roots([J_BIT, 23.2 + 50.0 - FALL * math.exp(-0.9 * speed), K])
    np.testing.assert_allclose(np.sort_complex(found.zeros), np.sort_complex(expected), rtol=1e-9)
    clamped = compose(
        TorsionalChain(inertia=(1e9, J_BIT), stiffness=(K,), damping=(23.2,), top_drag=0.0, bit_drag=50.0), BitRock(weight=WEIGHT)
    )
    poles = linearise(
        clamped,
        equilibrium(
            closed_loop(clamped, inputs={"top.torque": WEIGHT * 0.155575 * (0.5 + 0.3 * math.exp(-0.9 * speed)) + 50 * speed}),
            guess={"top.speed": speed, "bit.speed": speed},
        ),
    ).poles()
    assert np.abs(poles[:, None] - found.zeros).min(axis=0).max() < 1e-3


def test_jansen_s_rig_leaves_a_tenth_at_2_4_and_one_at_4(rig):
    limits = [performance_limit(rig, {"top.speed": speed}, period=0.01, delay=0.03).disk_margin for speed in (2.4, 3.0, 3.4, 4.0, 4.2)]
    assert limits == pytest.approx([0.106, 0.177, 0.316, 1.041, 2.0], abs=1e-3)


def test_a_drive_with_lags_stands_between_the_law_and_the_string(rig):
    # the lags of the drive are outside of the interpolation, which stable dynamics do not touch; those of the sensor are, too
    late = compose(wells.JANSEN_2, TopDrive(), BitRock(weight=WEIGHT))
    plain = performance_limit(rig, {"top.speed": 3.0}, period=0.01, delay=0.03).disk_margin
    assert performance_limit(late, {"top.speed": 3.0}, period=0.01, delay=0.03).disk_margin == pytest.approx(plain, rel=0.02)
    found = margins(closed_loop(late, Sampled(SoftTorque(reference=6.5), 0.01, 0.03)))
    assert found.loop_margins[0].command == "drive.command"
    assert 0.0 < found.disk_margin < margins(closed_loop(rig, Sampled(SoftTorque(reference=6.5), 0.01, 0.03))).disk_margin


# --- the absorber


def test_a_damper_and_an_inertia_like_the_bit_bear_the_slope_of_the_closed_form():
    # J_b s^2 - d s + k with J s^2 + c s at the other end of k: with J = J_b, c = d the polynomial is s^2 (s^2 + (2 k J_b - d^2) / J_b^2)
    bare = compose(
        TorsionalChain(inertia=(2122.0, J_BIT), stiffness=(K,), damping=(0.0,), top_drag=0.0, bit_drag=0.0), BitRock(weight=WEIGHT)
    )
    found = absorber_limit(bare, (1.0, 8.0))
    assert found.speed == pytest.approx(math.log(FALL / math.sqrt(2 * K * J_BIT)) / 0.9, rel=5e-3)
    assert found.inertia == pytest.approx(J_BIT, rel=0.05) and found.damping == pytest.approx(math.sqrt(2 * K * J_BIT), rel=0.05)


@pytest.mark.slow
def test_the_inertia_of_the_drive_costs_the_absorber_speed(rig):
    free, own = (absorber_limit(rig, (1.0, 8.0), keep_inertia=each) for each in (False, True))
    assert free.speed < own.speed and own.inertia == pytest.approx(2122.0)
    # spring and damper on the drive are a PI: there it is stable, and a little below no PI is
    law = PI(reference=own.speed, proportional=own.damping, integral=own.stiffness)
    assert margins(closed_loop(rig, law)).stable

    def growth(logs):
        below = PI(reference=0.98 * own.speed, proportional=own.damping * math.exp(logs[0]), integral=own.stiffness * math.exp(logs[1]))
        return margins(closed_loop(rig, below)).linear_loop.growth()

    assert minimize(growth, np.zeros(2), method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-5}).fun > 0.0
    assert "smooth down to" in str(own)


def test_a_range_without_a_border_says_so(rig):
    assert math.isnan(absorber_limit(rig, (0.5, 1.0)).speed)
    assert absorber_limit(rig, (5.0, 8.0)).speed == 5.0


# --- what it says


def test_the_limit_prints_what_it_rests_on(rig):
    text = str(performance_limit(rig, {"top.speed": 3.0}, period=0.01, delay=0.03))
    assert "disk margin <= 0.177" in text and "0.206+1.17j" in text and "sampled every 0.01 s" in text


def test_a_pole_that_nobody_moves_leaves_nothing():
    plant = compose(Unstable(1.0, 1.0))  # its zero takes the pole away
    assert performance_limit(plant, {"plant.y": 0.0}, measured_signals="plant.y", actuated_signals="plant.u").disk_margin == 0.0


def test_mistakes_are_told(rig):
    for arguments, word in (
        ({"delay": 0.03}, "delay"),
        ({"period": 0.0}, "period"),
        ({"actuated_signals": ("top.torque", "bit.weight")}, "actuated_signals"),
        ({"actuated_signals": "top.torqu"}, "top.torque"),
    ):
        with pytest.raises(SceneError, match=word):
            performance_limit(rig, {"top.speed": 3.0}, **arguments)
    with pytest.raises(SceneError, match="Argument `top.speed` must be a finite number"):
        performance_limit(rig, {"top.speed": math.nan})
