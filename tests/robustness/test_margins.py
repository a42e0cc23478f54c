"""Margins against closed forms, against loops written by hand in z, and against the machine itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import control
import numpy as np
import pytest
from scipy.linalg import expm

from controllers import LQG, PI, HInfinity, IdealSlidingMode, Lifting, LinearMPC, SlidingMode, SoftTorque, StiffPI, SuperTwisting, ZTorque
from controllers.observers import Kalman
from models import BitRock, Block, Coulomb, TorsionalChain, wells
from toolbox import (
    Component,
    Controller,
    Equations,
    Sampled,
    SceneError,
    Update,
    closed_loop,
    compose,
    equilibrium,
    margins,
    measure,
    quantity,
    simulate,
    state,
)
from toolbox.robustness.disk_margins import LoopMargins, joint_margins, loop_margins, scaled_norm
from toolbox.robustness.margins import disk_margin
from toolbox.robustness.measured import measured_margins, with_delay, with_gain
from toolbox.steady_states.linear_loop import LinearLoop
from toolbox.steady_states.steady_loop import steady_loop

J, DRAG, GAIN, INTEGRAL = 2.0, 0.5, 3.0, 4.0


@dataclass(frozen=True)
class Rotor(Component):
    """J w' = u - c w, a' = w."""

    inertia: float = quantity(J, "kg m2", "", above=0)
    drag: float = quantity(DRAG, "N m s/rad", "")

    def equations(self, signal):
        w = state("rotor.speed", "rad/s")
        torque = signal("rotor.torque", "N m", default=0.0)
        return Equations(flow={w: (torque - self.drag * w) / self.inertia})


@dataclass(frozen=True)
class Proportional(Controller):
    """u = gain e, e = reference - speed, or another function of the error: its sign, a corner at zero, a limit."""

    measured_signals = ("rotor.speed",)
    actuated_signals = ("rotor.torque",)

    gain: float = quantity(GAIN, "N m s/rad", "")
    reference: float = quantity(2.0, "rad/s", "")
    shape: str = "linear"

    def error(self, signal):
        return self.reference - signal("rotor.speed", "rad/s")

    def command(self, signal):
        e = self.error(signal)
        bent = {"linear": e, "sign": ca.sign(e), "corner": ca.fmax(e, 0.2 * e), "limit": ca.fmin(e, -1.0)}[self.shape]
        return {"rotor.torque": (self.gain * bent, "N m")}

    def continuous(self, signal):
        return Equations(flow={}, outputs=self.command(signal))

    def sampled(self, signal, period):
        return Update({}, self.command(signal))


@dataclass(frozen=True)
class WithIntegral(Proportional):
    """u = gain e + integral z, z' = e."""

    integral: float = quantity(INTEGRAL, "N m/rad", "")

    def continuous(self, signal):
        z = state("law.angle", "rad")
        return Equations(
            flow={z: self.error(signal)}, outputs={"rotor.torque": (self.gain * self.error(signal) + self.integral * z, "N m")}
        )

    def sampled(self, signal, period):
        z = state("law.angle", "rad")
        return Update({z: z + period * self.error(signal)}, {"rotor.torque": (self.gain * self.error(signal) + self.integral * z, "N m")})


@dataclass(frozen=True)
class Damping(Controller):
    """u = -damping v on a block."""

    measured_signals = ("block.speed",)
    actuated_signals = ("block.force",)

    damping: float = quantity(0.7, "N s/m", "")

    def continuous(self, signal):
        return Equations(flow={}, outputs={"block.force": (-self.damping * signal("block.speed", "m/s"), "N")})


@pytest.fixture(scope="module")
def rotor():
    return compose(Rotor())


@pytest.fixture(scope="module")
def rig():
    return compose(wells.JANSEN_2, BitRock(weight=97_347.0))


# --- continuous loops


def test_a_first_order_loop_bears_any_gain_and_has_the_delay_margin_of_its_crossover(rotor):
    # L = K / (J s + c): |L| = 1 at w = sqrt(K^2 - c^2) / J
    found = margins(closed_loop(rotor, Proportional()))["rotor.torque"]
    crossover = math.sqrt(GAIN**2 - DRAG**2) / J
    phase = math.pi - math.atan2(J * crossover, DRAG)
    assert found.phase_margin == pytest.approx(phase, rel=1e-9)
    assert found.delay_margin == pytest.approx(phase / crossover, rel=1e-9)
    assert (found.lowest_gain, found.highest_gain) == (0.0, math.inf)
    assert found.peak_sensitivity == 1.0  # a loop in the right half plane never comes nearer to -1 than 0 does
    # |S - T| = |(i J w + c - K) / (i J w + c + K)| tends to 1
    assert found.disk_margin == pytest.approx(2.0, rel=1e-6)


def test_a_pi_on_an_inertia_has_the_margins_of_the_textbook(rotor):
    # L = (K_p s + K_i) / (J s^2):  w_c^2 = (K_p^2 + sqrt(K_p^4 + 4 K_i^2 J^2)) / (2 J^2),  phase margin = arctan(w_c K_p / K_i)
    found = margins(closed_loop(rotor, WithIntegral(), parameters={"rotor.drag": 0.0}))["rotor.torque"]
    w = math.sqrt((GAIN**2 + math.sqrt(GAIN**4 + 4 * INTEGRAL**2 * J**2)) / (2 * J**2))
    assert found.phase_margin == pytest.approx(math.atan(w * GAIN / INTEGRAL), rel=1e-9)
    assert found.delay_margin == pytest.approx(math.atan(w * GAIN / INTEGRAL) / w, rel=1e-9)
    # S - T = (J s^2 - K_p s - K_i) / (J s^2 + K_p s + K_i), whose largest value is 2 / alpha
    s = 1j * np.linspace(0.01, 20.0, 400_001)
    worst = np.abs((J * s**2 - GAIN * s - INTEGRAL) / (J * s**2 + GAIN * s + INTEGRAL)).max()
    assert found.disk_margin == pytest.approx(2 / worst, rel=1e-8)
    assert found.peak_sensitivity == pytest.approx(np.abs(J * s**2 / (J * s**2 + GAIN * s + INTEGRAL)).max(), rel=1e-8)


@pytest.mark.parametrize("period", [None, 0.01])
def test_the_lowest_gain_of_a_rotor_that_runs_away_alone_is_known(rotor, period):
    # L(0) = K / c < 0: with less gain than -c a real pole passes zero, at no frequency but zero
    found = margins(closed_loop(rotor, Proportional(gain=3.0), sample_time=period, parameters={"rotor.drag": -1.0}))["rotor.torque"]
    assert found.lowest_gain == pytest.approx(1 / 3, rel=1e-9)
    # a sampled pole reaches -1 where (e^{T/J} - 1) K k = 1 + e^{T/J}
    highest = math.inf if period is None else (1 + math.exp(period / J)) / (math.exp(period / J) - 1) / 3
    assert found.highest_gain == pytest.approx(highest, rel=1e-9)


@pytest.mark.parametrize("stiffness", [1.0, 5.0])
def test_a_loop_of_second_order_bears_any_gain(stiffness):
    # L = K / (s^2 + 0.2 s + 1) ends at zero along the negative axis, and meets -1 for no gain
    loop = LinearLoop(
        np.array([[0.0, 1.0], [-1.0, -0.2]]), np.array([[0.0], [1.0]]), np.array([[-stiffness, 0.0]]), np.zeros((1, 1)), ("u",)
    )
    found = loop_margins(loop)
    assert (found.lowest_gain, found.highest_gain) == (0.0, math.inf)


@pytest.mark.parametrize("integral", [50.0, 100.0, 200.0])
def test_a_sampled_pi_on_a_string_without_drag_bears_any_little_gain(integral):
    # string and integral have two poles at z = 1, beside which round-off decides the side of the axis
    string = TorsionalChain(inertia=(2122.0, 374.0), stiffness=(473.0,), damping=(0.0,))
    rig = compose(string, BitRock(weight=50e3, friction=Coulomb(0.6, 0.6)))
    found = margins(closed_loop(rig, PI(proportional=500.0, integral=integral, reference=8.0), sample_time=0.01))["top.torque"]
    assert found.lowest_gain == 0.0 and found.highest_gain > 100.0


@pytest.mark.parametrize("stiffness", [1.0, 2.25])
def test_a_block_without_damping_has_the_margins_of_what_damps_it(stiffness):
    # L = c s / (s^2 + k) turns at +- 90 deg: |L| = 1 where w^2 -+ c w - k = 0, and the loop is infinite at sqrt(k)
    damping = 0.7
    found = margins(closed_loop(compose(Block(stiffness=stiffness)), Damping(damping)))["block.force"]
    crossover = (damping + math.sqrt(damping**2 + 4 * stiffness)) / 2
    assert (found.lowest_gain, found.highest_gain) == (0.0, math.inf)
    assert found.phase_margin == pytest.approx(math.pi / 2, rel=1e-9)
    assert found.delay_margin == pytest.approx(math.pi / 2 / crossover, rel=1e-9)
    assert found.disk_margin == pytest.approx(2.0, rel=1e-9) and found.peak_sensitivity == pytest.approx(1.0, rel=1e-9)


def test_an_unstable_loop_has_no_margin(rotor):
    found = margins(closed_loop(rotor, Proportional(gain=-1.0)))
    assert not found.stable and found.disk_margin == 0.0 and found.peak_sensitivity == math.inf and "unstable" in str(found)
    assert margins(closed_loop(rotor, Proportional(gain=1.0))).stable


# --- sampled loops


@pytest.mark.parametrize(("period", "delay"), [(0.3, 0.3), (0.3, 0.75), (0.3, 0.1)])
def test_a_sampled_loop_is_that_of_the_exact_z_domain(rotor, period, delay):
    # held input, late by d periods and a fraction e: x+ = a x + b0 u_(k-d) + b1 u_(k-d-1)  (Astrom and Wittenmark, example 2.3)
    whole = int(delay / period + 1e-9)
    e = delay - whole * period
    a = math.exp(-DRAG / J * period)
    b0, b1 = (1 - math.exp(-DRAG / J * (period - e))) / DRAG, (math.exp(-DRAG / J * (period - e)) - a) / DRAG
    by_hand = GAIN * control.tf([b0, b1], [1.0, -a] + [0.0] * (whole + 1), period)
    found = margins(closed_loop(rotor, Sampled(Proportional(), period, delay)))
    w = np.linspace(1e-3, math.pi / period, 200_001)
    ours = found.linear_loop.transfer(w[::5000])[:, 0, 0]
    np.testing.assert_allclose(ours, [complex(by_hand(np.exp(1j * each * period))) for each in w[::5000]], rtol=1e-9, atol=1e-12)
    row = found["rotor.torque"]
    gain, phase, *_ = control.stability_margins(by_hand)
    assert row.highest_gain == pytest.approx(gain, rel=1e-6)
    assert math.degrees(row.phase_margin) == pytest.approx(phase, rel=1e-6)
    curve = found.linear_loop.transfer(w)[:, 0, 0]
    assert row.disk_margin == pytest.approx(2 / np.abs((1 - curve) / (1 + curve)).max(), rel=1e-6)
    assert row.peak_sensitivity == pytest.approx(1 / np.abs(1 + curve).min(), rel=1e-6)


def test_the_highest_gain_of_a_sampled_first_order_loop_is_known(rotor):
    # x+ = a x - K b x is on the unit circle where K b = 1 + a
    period = 0.3
    a, b = math.exp(-DRAG / J * period), (1 - math.exp(-DRAG / J * period)) / DRAG
    assert margins(closed_loop(rotor, Sampled(Proportional(), period)))["rotor.torque"].highest_gain == pytest.approx(
        (1 + a) / (b * GAIN), rel=1e-9
    )


@pytest.mark.parametrize("delay", [0.0, 0.13, 0.3])
def test_the_delay_margin_of_a_sampled_loop_is_where_its_poles_reach_the_unit_circle(rotor, delay):
    law = WithIntegral(integral=1.0)
    found = margins(closed_loop(rotor, Sampled(law, 0.1, delay)))["rotor.torque"].delay_margin
    for more, stable in ((0.999, True), (1.001, False)):
        assert margins(closed_loop(rotor, Sampled(law, 0.1, delay + more * found))).stable == stable


def test_fast_sampling_with_a_delay_has_the_margins_of_the_continuous_loop_less_the_delay(rotor):
    period, delay = 4e-3, 0.02
    continuous = margins(closed_loop(rotor, Proportional()))["rotor.torque"]
    sampled = margins(closed_loop(rotor, Sampled(Proportional(), period, delay)))["rotor.torque"]
    assert sampled.delay_margin == pytest.approx(continuous.delay_margin - delay - period / 2, rel=1e-4)


# --- several commands


def test_the_textbook_satellite_is_robust_in_each_channel_and_not_in_both():
    # P. Seiler, A. Packard, P. Gahinet (2020) and the example of python-control: each loop alone looks safe
    a, b, c = np.array([[0.0, 10.0], [-10.0, 0.0]]), np.eye(2), np.array([[1.0, 10.0], [-10.0, 1.0]])
    k = np.array([[1.0, -2.0], [0.0, 1.0]])
    loop = LinearLoop(a, b @ np.eye(2), -k @ c, np.zeros((2, 2)), ("one", "two"))
    joint = joint_margins(loop)
    s, w = np.eye(2), np.linspace(0.01, 50.0, 2001)
    grid = [np.linalg.inv(s + k @ c @ np.linalg.inv(1j * each * s - a) @ b) - s / 2 for each in w]
    worst = max(np.linalg.norm(each, 2) for each in grid)
    assert joint.unstructured_margin == pytest.approx(1 / worst, rel=1e-3)
    assert joint.unstructured_margin <= joint.disk_margin <= min(loop_margins(loop.alone(i)).disk_margin for i in range(2))


def test_the_bound_of_the_structured_singular_value_is_exact_where_it_is_known():
    rng = np.random.default_rng(1)
    for n in (2, 3, 4):
        a, b = rng.standard_normal((2, n)) + 1j * rng.standard_normal((2, n))
        # of a matrix a b' of rank one: sum |a_i b_i|; of a triangular one: its largest diagonal entry
        assert scaled_norm(np.outer(a, b)) == pytest.approx(np.abs(a * b).sum(), rel=1e-6)
    assert scaled_norm(np.array([[0.5, 1e3], [0.0, 0.7j]])) == pytest.approx(0.7, rel=1e-15)
    for matrix in rng.standard_normal((20, 2, 2)) + 1j * rng.standard_normal((20, 2, 2)):
        d = np.geomspace(1e-3, 1e3, 20_001)[:, None, None]
        scaled = np.linalg.norm(
            matrix * np.concatenate([np.ones_like(d), d, 1 / d, np.ones_like(d)], axis=2).reshape(-1, 2, 2), 2, axis=(1, 2)
        )
        assert scaled.min() * (1 - 1e-6) <= scaled_norm(matrix) <= scaled.min() * (1 + 1e-14)


@pytest.mark.slow
def test_two_drives_that_do_not_meet_have_the_margins_of_each_alone():
    plant = compose(Rotor(name="left"), Rotor(inertia=1.0, name="right"))
    laws = [
        Sampled(OnSide("left", 3.0, name="one"), 0.3, 0.3),
        Sampled(OnSide("right", 1.0, name="two"), 0.3, 0.0),
    ]
    found = margins(closed_loop(plant, laws))
    alone = [
        margins(closed_loop(compose(Rotor(inertia=i)), Sampled(Proportional(gain=g), 0.3, d))).disk_margin
        for i, g, d in ((J, 3.0, 0.3), (1.0, 1.0, 0.0))
    ]
    assert [row.disk_margin for row in found.loop_margins] == pytest.approx(alone, rel=1e-9)
    assert found.disk_margin == pytest.approx(min(alone), rel=1e-6)
    assert "all, each its own" in str(found)
    assert found["right.torque"].delay_margin == pytest.approx(
        margins(closed_loop(compose(Rotor(inertia=1.0)), Sampled(Proportional(gain=1.0), 0.3)))["rotor.torque"].delay_margin, rel=1e-9
    )


@dataclass(frozen=True)
class OnSide(Controller):
    """u = gain (2 - speed) on the rotor of a side."""

    side: str = "left"
    gain: float = quantity(1.0, "N m s/rad", "")

    @property
    def actuated_signals(self):
        return (f"{self.side}.torque",)

    def sampled(self, signal, period):
        return Update({}, {f"{self.side}.torque": (self.gain * (2.0 - signal(f"{self.side}.speed", "rad/s")), "N m")})


# --- the drill string


@pytest.mark.slow
def test_the_margins_of_a_drill_string_are_those_of_python_control_on_a_fine_grid(rig):
    found = margins(closed_loop(rig, Sampled(LQG(reference=5.0, delay_samples=3), 0.01, 0.03)))
    loop = control.ss(found.linear_loop.A, found.linear_loop.B, -found.linear_loop.C, -found.linear_loop.D, 0.01)
    disk, *_ = control.disk_margins(loop, np.geomspace(3.0, 4.5, 20_000), skew=0.0)
    assert found.disk_margin == pytest.approx(disk, rel=1e-6)
    # `control.stability_margins` finds crossings here that are none (of 15 poles by polynomials): poles tell the gain, a grid the phase
    row = found["top.torque"]
    assert found.linear_loop.growth(0.9999 * row.highest_gain) < 0.0 < found.linear_loop.growth(1.0001 * row.highest_gain)
    assert all(found.linear_loop.growth(k) < 0.0 for k in np.linspace(0.01, 0.9999 * row.highest_gain, 100))
    curve = found.linear_loop.transfer(np.geomspace(0.01, math.pi / 0.01, 100_000))[:, 0, 0]
    crossing = np.flatnonzero(np.diff(np.sign(np.abs(curve) - 1.0)))
    assert row.phase_margin == pytest.approx(np.abs(np.angle(-curve[crossing])).min(), abs=2e-3)


def test_the_loop_of_a_sampled_pi_is_that_of_its_transition_matrices(rig):
    # by hand: x = (twist, top, bit), z the integral; rock torque falls by W R (mu_s - mu_c) gamma exp(-gamma w) per rad/s
    speed, period, delay = 9.0, 0.01, 0.034
    found = steady_loop(closed_loop(rig, Sampled(StiffPI(reference=speed), period, delay)))
    rock = -97_347.0 * 0.155575 * 0.3 * 0.9 * math.exp(-0.9 * speed)
    a = np.array([[0, 1, -1], [-473 / 2122, -(23.2 + 425) / 2122, 23.2 / 2122], [473 / 374, 23.2 / 374, -(23.2 + 50 + rock) / 374]])
    b = np.array([[0.0], [1 / 2122], [0.0]])
    w = np.geomspace(0.01, 300.0, 50)
    z = np.exp(1j * w * period)

    def step(t):
        whole = np.zeros((4, 4))
        whole[:3, :3], whole[:3, 3:] = a, b
        return expm(whole * t)

    late = step(period)[:3, 3:] - step(0.006)[:3, 3:]  # 34 ms are three periods, and the last 4 ms of the fourth
    top = [np.linalg.solve(each * np.eye(3) - step(period)[:3, :3], step(0.006)[:3, 3:] * each**-3 + late * each**-4)[1, 0] for each in z]
    law = 2e4 + 2e3 * period / (z - 1)
    np.testing.assert_allclose(found.loop().transfer(w)[:, 0, 0], law * np.array(top), rtol=1e-8)


LAWS = {
    "LQG": LQG(reference=5.0, delay_samples=3),
    "H-infinity": HInfinity(reference=5.0),
    "Z-torque": ZTorque(reference=5.0, filter_time=0.02),
}


@pytest.mark.parametrize("what", ["gain", "delay"])
@pytest.mark.parametrize("label", LAWS)
def test_the_machine_itself_loses_smooth_running_where_the_margin_says(rig, label, what):
    law = Sampled(LAWS[label], 0.01, 0.03)
    row = margins(closed_loop(rig, law))["top.torque"]

    def grows(part):
        """(growth of what the bit does, growth of the linear loop) [1/s] with a part of the margin used up."""
        changed = with_gain(law, 1 + part * (row.highest_gain - 1)) if what == "gain" else with_delay(law, part * row.delay_margin)
        point = steady_loop(closed_loop(rig, changed))
        begin = {name: value / 0.98 if name in rig.states else value for name, value in point.start.items()}
        begin["chain.speed"] = begin["chain.speed"] * np.array([1.0, 1 - 1e-6])  # near enough that friction is a line
        held = {"top.torque": point.signals["top.torque"]}  # until the first command arrives
        run = simulate(rig, 80.0, controller=changed, start=begin, parameters=held, accuracy=1e-11)
        early, late = (measure.extent(run, "bit.speed", after, until=after + 20.0) for after in (20.0, 50.0))
        return math.log((late.maximum - late.minimum) / (early.maximum - early.minimum)) / 30.0, point.loop().growth()

    found, expected = grows(0.9)  # several modes die there at about one rate
    assert found < 0.0 and expected < 0.0
    found, expected = grows(1.1)
    assert found > 0.0 and found == pytest.approx(expected, rel=0.1, abs=2e-3)


# --- laws that no line describes


def test_a_relay_has_measured_margins_and_no_linear_ones(rig):
    found = margins(closed_loop(rig, IdealSlidingMode(reference=6.0)), inertia_parameter="chain.inertia.0", simulation_duration=40.0)
    assert math.isnan(found.disk_margin) and not found.stable and "switches" in found.reason
    assert found.simulated_margins.highest_gain > 1.1 and math.isnan(found.simulated_margins.delay)
    assert found.simulated_margins.lowest_inertia < 0.8
    assert "measured" in str(found) and "There is no linear loop" in str(found)


def test_measured_margins_of_a_linear_law_agree_with_its_linear_ones(rig):
    found = margins(closed_loop(rig, Sampled(LQG(reference=5.0, delay_samples=3), 0.01, 0.03)), by_simulation=True)
    assert found.simulated_margins.highest_gain == pytest.approx(found["top.torque"].highest_gain, rel=0.03)
    assert found.simulated_margins.delay == pytest.approx(found.delay_margin, rel=0.03)


@pytest.mark.parametrize(("reference", "grows"), [(3.985, True), (4.0, False)])
def test_a_loop_that_grows_with_a_quarter_of_an_hour_has_no_measured_margin(reference, grows):
    loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight=97_347.0)), PI(4_000.0, 1_500.0, reference=reference))  # lost at 3.9919
    rest = equilibrium(loop)
    start = {name: rest[name] for name in loop.system.states} | {"chain.speed": rest["chain.speed"] * [1.0, 1.001]}
    found = measured_margins(loop.replace(start=start), duration=60.0)
    assert (found.highest_gain == 1.0) == grows and (found.lowest_gain == 1.0) == grows


def test_a_law_that_lifts_the_set_point_for_a_while_has_the_margins_of_the_law_inside():
    rig = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
    found = []
    for law in (PI(4_000.0, 1_500.0), Lifting(PI(4_000.0, 1_500.0))):
        loop = closed_loop(rig, law, sample_time=0.01).at("top.reference", 8.0)
        rest = equilibrium(closed_loop(rig, PI(4_000.0, 1_500.0)).at("top.reference", 8.0))
        start = {name: rest[name] for name in rig.states} | {"chain.speed": 0.98 * rest["chain.speed"]}
        found.append(measured_margins(loop.replace(start=start), duration=60.0))
    inner, lifting = found
    assert lifting.highest_gain == inner.highest_gain and lifting.delay >= inner.delay and lifting.lowest_gain <= inner.lowest_gain


def test_a_loop_that_fails_as_it_is_has_no_measured_margin(rig):
    found = margins(
        closed_loop(rig, Sampled(StiffPI(reference=3.0), 0.01)), by_simulation=True, simulation_duration=100.0
    )  # below its Hopf speed
    assert not found.stable
    assert (found.simulated_margins.lowest_gain, found.simulated_margins.highest_gain, found.simulated_margins.delay) == (1.0, 1.0, 0.0)


@pytest.mark.parametrize(
    ("law", "why"),
    [
        (Proportional(shape="sign", reference=0.0), "kink or a jump"),
        (Proportional(shape="corner", reference=0.0), "kink or a jump"),
        (Proportional(shape="limit", reference=0.0), "limit holds `rotor.torque`"),
        (lambda t, y: -y, "Python callable"),
    ],
)
def test_a_law_without_a_derivative_says_why(rotor, law, why):
    given = (
        Sampled(law, 0.01)
        if isinstance(law, Controller)
        else Sampled(law, 0.01, measured_signals="rotor.speed", actuated_signals="rotor.torque")
    )
    found = margins(closed_loop(rotor, given), by_simulation=False)
    assert why in found.reason and math.isnan(found.disk_margin) and found.simulated_margins is None
    assert margins(closed_loop(rotor, Sampled(Proportional(reference=0.0), 0.01)), by_simulation=False).reason == ""


@dataclass(frozen=True)
class Leaking(Controller):
    """A law whose memory leaks to zero, where it bends at `place`; the torque follows it."""

    measured_signals = ("rotor.speed",)
    actuated_signals = ("rotor.torque",)

    place: float = quantity(1e-4, "1")
    round: float = quantity(0.0, "1")

    def sampled(self, signal, period):
        slip, kept = signal("rotor.speed", "rad/s"), state("leak.kept", "1")
        bent = 0.5 * ca.fmax(kept - self.place, 0) + self.round * kept**2
        return Update({kept: bent}, {"rotor.torque": (1e5 - 100.0 * slip - 1e4 * bent, "N m")})


def test_what_bends_near_to_steady_running_is_no_kink_there_whatever_its_size_beside_others(rotor):
    def reason(**numbers):
        return margins(closed_loop(rotor, Sampled(Leaking(**numbers), 0.01)), by_simulation=False).reason

    assert reason(place=1e-4) == "" and reason(place=1e-7) == ""  # the memory is zero, the torque near to 1e5 N m
    assert reason(place=1.0, round=1e3) == ""
    assert all("kink or a jump" in reason(place=0.0, round=round) for round in (0.0, 0.1, -0.1, 10.0))


@pytest.mark.parametrize("period", ["1 ms", "0.1 ms"])
def test_a_law_that_takes_weight_off_has_the_linear_loop_of_the_law_inside(rig, period):
    without, relieved = (
        margins(closed_loop(rig, Lifting(PI(), weight_relief=relief), sample_time=period), by_simulation=False) for relief in (None, 0.4)
    )
    assert relieved.reason == "" and relieved["top.torque"].highest_gain == pytest.approx(without["top.torque"].highest_gain, rel=1e-6)


def test_a_boundary_layer_has_a_slope_and_a_root_has_none(rig):
    assert margins(closed_loop(rig, Sampled(SlidingMode(reference=5.0), 0.01)), by_simulation=False).stable
    assert "not finite" in margins(closed_loop(rig, Sampled(SuperTwisting(reference=5.0), 0.01)), by_simulation=False).reason
    assert "callable" in margins(closed_loop(rig, Sampled(LinearMPC(reference=5.0), 0.1)), by_simulation=False).reason


# --- what it says


def test_the_result_prints_its_table_and_draws_the_disk(rig):
    found = margins(closed_loop(rig, Sampled(SoftTorque(reference=5.0), 0.01, 0.03)))
    text = str(found)
    assert "SoftTorque, sampled every 10 ms with a delay of 30 ms at top.reference = 5 rad/s, top.torque = 9998 N m" in text
    assert f"{found.disk_margin:.3g}" in text and f"{found.peak_sensitivity:.3g}" in text
    nyquist, bode = found.plot()
    assert nyquist.patches and "frequency" in bode.get_xlabel()


def test_the_disk_guarantees_its_gains_and_phases():
    row = LoopMargins("u", disk_margin=0.5)
    assert row.disk_gains == pytest.approx((0.6, 1 / 0.6))
    assert math.degrees(row.disk_phase) == pytest.approx(28.07, abs=0.01)


def test_parameters_move_the_plant_and_not_the_law(rig):
    lighter = margins(
        closed_loop(rig, Sampled(LQG(reference=5.0, delay_samples=3), 0.01, 0.03), parameters={"chain.inertia.0": 0.9 * 2122.0})
    )
    assert lighter.disk_margin < margins(closed_loop(rig, Sampled(LQG(reference=5.0, delay_samples=3), 0.01, 0.03))).disk_margin


def test_mistakes_are_told(rig):
    with pytest.raises(SceneError, match="must contain a controller"):
        margins(rig)
    with pytest.raises(SceneError, match="one period"):
        margins(
            closed_loop(
                compose(Rotor(name="left"), Rotor(name="right")),
                [Sampled(OnSide("left", name="one"), 0.1), Sampled(OnSide("right", name="two"), 0.2)],
            )
        )
    with pytest.raises(SceneError, match="There are no margins of"):
        margins(closed_loop(rig, SoftTorque(reference=5.0)))["bottom.torque"]
    with pytest.raises(SceneError, match="duration"):
        margins(closed_loop(rig, SoftTorque()), simulation_duration=0.0)
    with pytest.raises(SceneError, match="inertia"):
        margins(closed_loop(rig, SoftTorque(reference=5.0)), by_simulation=True, inertia_parameter="chain.inertia")


@pytest.mark.parametrize("speed", [2.2, 3.0, 4.0])
def test_a_law_that_lifts_runs_steadily_at_what_is_asked_and_not_while_it_lifts(speed):
    rig = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
    inner = PI(proportional=1334.0, integral=2052.0, reference=speed, lowest_torque=0.0, highest_torque="20 kN m")
    lifts = Lifting(inner, reference=speed, observer=Kalman(speed_noise=0.01))
    plain, lifting = (margins(closed_loop(rig, Sampled(law, "10 ms", delay="30 ms"))) for law in (inner, lifts))
    assert lifting.operating_point["top.torque"] == pytest.approx(plain.operating_point["top.torque"], rel=1e-9)
    assert lifting.disk_margin == pytest.approx(plain.disk_margin, rel=1e-6)


def test_the_disk_margin_alone_is_that_of_all_margins():
    rig = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
    laws = (
        PI(reference=6.0),  # smooth running is stable
        Sampled(PI(reference=2.0), 0.01),  # it is not
        Sampled(SoftTorque(reference=6.0), 0.01, 0.03),
        SlidingMode(),
    )
    found = [disk_margin(closed_loop(rig, law)) for law in laws]
    np.testing.assert_array_equal(found, [margins(closed_loop(rig, law), by_simulation=False).disk_margin for law in laws])
    assert found[1] == 0.0 and found[0] > 0.0 and found[2] > 0.0
    assert math.isnan(disk_margin(closed_loop(rig, IdealSlidingMode())))
