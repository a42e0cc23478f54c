"""Laws of the top drive against their closed forms: poles, impedances, Riccati equations, sliding surfaces and limits."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
import pytest

from controllers import (
    LQG,
    LQR,
    PI,
    ActiveDamping,
    HInfinity,
    IdealSlidingMode,
    ImpedanceSuperTwisting,
    ImplicitSlidingMode,
    SlidingMode,
    SoftTorque,
    StiffPI,
    SuperTwisting,
    ZTorque,
)
from controllers.pipe import pipe_impedance
from controllers.string_model import drilling_point, string_model
from controllers.z_torque import compensated
from models import BitRock, Coulomb, TopDrive, TorsionalChain, wells
from studies.questions import chatter
from tests.plants import BELT, RIG
from tests.refusals import each_of, refusals
from toolbox import Sampled, SceneError, compose, impedance, linearise, simulate
from toolbox.inputs import sine
from toolbox.measure import overshoot
from toolbox.measuring.measure import severity
from toolbox.modelling import Takeover
from toolbox.steady_states import reflection

STRING = compose(wells.JANSEN_2)
LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}


def poles(*parts, **arguments):
    """Poles of a closed loop of continuous parts, sorted."""
    return np.sort_complex(linearise(compose(*parts), **arguments).poles())


def freed(law, reference):
    """Seconds that the bit still sticks in the last 50 s of 150 s, with the law taking over from a stiff drive after 50 s of stick-slip."""
    both = Takeover(StiffPI(reference=reference, **LIMITS), law, at=50.0)
    run = simulate(RIG, 150.0, controller=both, sample_time=0.01, inputs={"top.reference": reference})
    assert run.time_in("bit", "stick", until=50.0) > 10.0
    return run.time_in("bit", "stick", after=100.0)


def test_every_speed_law_frees_a_bit_that_the_stiff_drive_leaves_in_stick_slip():
    assert freed(StiffPI(reference=8.5, **LIMITS), 8.5) > 10.0
    for kind in (
        SoftTorque,
        ZTorque,
        ActiveDamping,
        SlidingMode,
        ImplicitSlidingMode,
        SuperTwisting,
        ImpedanceSuperTwisting,
        LQR,
        LQG,
        HInfinity,
    ):
        assert freed(kind(reference=8.5, **LIMITS).design(RIG), 8.5) == 0.0, kind.__name__


def test_laws_that_know_the_bit_or_match_the_string_free_it_at_speeds_where_soft_torque_does_not():
    assert freed(SoftTorque(reference=4.0, **LIMITS).design(RIG), 4.0) > 10.0
    for kind in (ZTorque, ImpedanceSuperTwisting, LQR, LQG):
        assert freed(kind(reference=4.0, **LIMITS).design(RIG), 4.0) == 0.0, kind.__name__


# --- limits of the drive


@dataclass(frozen=True)
class Winding(PI):
    """A PI law that is cut by the drive and does not know it."""

    @staticmethod
    def led_back(error, wanted, command, torque, least=None):
        return error


@pytest.mark.parametrize("sample_time", [None, 0.01])
def test_back_calculation_takes_the_overshoot_of_a_cut_command_away(sample_time):
    peaks = {}
    for kind in (PI, Winding):
        law = kind(reference=8.0, proportional=6000.0, integral=3000.0, highest_torque=6000.0)
        run = simulate(STRING, 60.0, controller=law, sample_time=sample_time)
        assert run["top.torque"].max() == 6000.0
        assert run.at(60.0)["top.speed"] == pytest.approx(8.0, rel=1e-3)
        peaks[kind] = overshoot(run, "top.speed", 8.0)
    assert peaks[Winding] > 0.3
    assert peaks[PI] < 0.1 * peaks[Winding]


def test_limits_that_are_never_met_change_nothing():
    free = simulate(RIG, 30.0, controller=PI(), sample_time=0.01)
    wide = simulate(RIG, 30.0, controller=PI(lowest_torque=-1e6, highest_torque=1e6, torque_rate=1e9), sample_time=0.01)
    np.testing.assert_allclose(wide.at(30.0).states, free.at(30.0).states, rtol=1e-10)


@pytest.mark.parametrize(
    "kind", [PI, ZTorque, SlidingMode, ImplicitSlidingMode, SuperTwisting, ImpedanceSuperTwisting, LQR, LQG, HInfinity]
)
def test_no_law_commands_more_than_its_limits(kind):
    law = kind(reference=6.0, lowest_torque=1000.0, highest_torque=9000.0, torque_rate=20_000.0)
    run = simulate(RIG, 20.0, controller=law, sample_time=0.02, output_times=(np.arange(1000) + 0.5) * 0.02)
    torque = run["top.torque"][100:]
    assert torque.min() >= 1000.0 and torque.max() <= 9000.0
    assert np.abs(np.diff(run["top.torque"])).max() <= 20_000.0 * 0.02 * (1 + 1e-12)
    assert torque.max() == 9000.0  # and the limit was met


# --- Jansen's optimum


def test_the_optimum_of_jansen_gives_two_equal_pairs_of_poles_and_nothing_else_damps_the_less_damped_more():
    drive, below, stiffness = 2122.0, 374.0, 473.0
    bare = TorsionalChain(inertia=(drive, below), stiffness=(stiffness,), damping=(0.0,))
    om, a = np.sqrt(stiffness / below), np.sqrt(below / drive)
    found = poles(bare, ActiveDamping())
    np.testing.assert_allclose(np.poly(found).real, np.poly(np.tile(np.roots([1.0, a * om, om**2]), 2)).real, rtol=1e-9)
    np.testing.assert_allclose(found.real, -a * om / 2, rtol=1e-6)  # a double root is only as sharp as the square root of round-off
    spring, damper = ActiveDamping.gains(stiffness, below, drive)
    for i in range(12):
        other = (1 + 0.2 * np.cos(0.5236 * i), 1 + 0.2 * np.sin(0.5236 * i))
        assert poles(bare, PI(integral=spring * other[0], proportional=damper * other[1])).real.max() > -a * om / 2 * 0.999
    # the twin: a drive that holds its speed damps nothing
    assert poles(bare, PI(proportional=1e9, integral=0.0)).real.max() > -1e-3


def test_the_drag_of_the_drive_counts_towards_the_optimal_damper_and_too_much_is_refused():
    assert ActiveDamping().design(STRING).proportional == pytest.approx(2 * np.sqrt(374 / 2122) * np.sqrt(473 / 374) * 2122 - 425.0)
    with pytest.raises(SceneError, match="drag"):
        ActiveDamping().design(compose(TorsionalChain(top_drag=5000.0)))


# --- impedances

PIPE = (0.146529, 0.123024, 61e9, 7850.0)


def test_the_impedance_of_a_pipe_is_its_polar_moment_times_the_root_of_modulus_and_density():
    # the line's own constants: inertia per length rho I_p, compliance per length 1 / (G I_p)
    outer, inner, modulus, density = PIPE
    polar = np.pi / 2 * ((outer / 2) ** 4 - (inner / 2) ** 4)
    assert pipe_impedance(*PIPE) == pytest.approx(np.sqrt(density * polar * modulus * polar), rel=1e-12)


@pytest.mark.parametrize("share", [0.5, 1.0, 2.0])
def test_z_torque_reflects_what_its_impedance_lacks_and_no_more(share):
    zeta = pipe_impedance(*PIPE)
    om = np.array([0.1, 1.0, 5.0])
    law = ZTorque.for_string(share * zeta, 2900.0, filter_time=1e-8)
    np.testing.assert_allclose(
        np.abs(reflection(impedance(law, frequency=om, inertia=2900.0), zeta)), abs(share - 1) / (share + 1), atol=2e-3
    )
    # its twin without compensation is inertia, and a stiff drive a wall
    bare = replace(law, inertia=0.0)
    assert np.abs(reflection(impedance(bare, frequency=[5.0], inertia=2900.0), zeta)) > 0.9
    assert np.abs(reflection(impedance(StiffPI(), frequency=[1.0], inertia=2900.0), zeta)) > 0.9


def test_the_filter_of_z_torque_leaves_a_double_pole():
    # J s + Z - J_c s / (T s + 1) = 0
    inertia, Z, T = 2122.0, 425.0, 0.05
    part = compensated(inertia, Z, T)
    roots = np.roots([inertia * T, inertia - part + Z * T, Z])
    np.testing.assert_allclose(roots, -np.sqrt(Z / (inertia * T)), rtol=1e-6)
    assert 0 < part < inertia


def test_the_impedance_of_a_pi_law_is_that_of_its_inertia_damper_and_spring():
    om = np.array([0.3, 1.0, 10.0])
    Z = impedance(PI(proportional=4000.0, integral=1500.0), frequency=om, inertia=2122.0, drag=425.0)
    np.testing.assert_allclose(Z, 4425.0 + 1j * (om * 2122.0 - 1500.0 / om), rtol=1e-12)


def test_soft_torque_matches_at_the_frequency_of_the_string():
    # k / J_b = I / J_r: spring and inertia of the drive cancel there, sqrt(k J_b) stays
    law = SoftTorque().design(STRING)
    om = np.sqrt(473.0 / 374.0)
    assert np.abs(reflection(impedance(law, frequency=om, inertia=2122.0), np.sqrt(473.0 * 374.0))) == pytest.approx(0.0, abs=1e-12)
    assert np.abs(reflection(impedance(StiffPI(), frequency=om, inertia=2122.0), np.sqrt(473.0 * 374.0))) > 0.9


def test_soft_torque_for_a_pipe_shows_four_times_its_impedance_at_its_frequency():
    zeta = pipe_impedance(*PIPE)
    law = SoftTorque.for_string(zeta, 2900.0, 0.2, highest_torque=3e4)
    assert impedance(law, frequency=[2 * np.pi * 0.2], inertia=2900.0)[0] == pytest.approx(4 * zeta)
    assert np.abs(reflection(impedance(law, frequency=[2 * np.pi * 0.2], inertia=2900.0), zeta))[0] == pytest.approx(3 / 5)
    assert law.highest_torque == 3e4


def test_a_placed_pi_gives_its_inertia_the_poles_asked_for():
    pi = PI.placed(2122.0, frequency=3.0, damping=0.5)
    # behind a string without stiffness the drive is alone
    found = poles(TorsionalChain(stiffness=(0.0,), damping=(0.0,)), pi)
    np.testing.assert_allclose(np.poly(found[np.abs(found) > 1e-3]).real, [1.0, 3.0, 9.0], rtol=1e-9)


def test_a_wave_that_comes_up_a_pipe_leaves_it_through_z_torque_and_returns_from_a_stiff_drive():
    # 3000 m of pipe as 80 inertias; a bump of torque at the free bit runs up within 1.1 s, and what the top reflects runs down
    outer, inner, modulus, density = PIPE
    n, length = 80, 3000.0
    polar = np.pi / 32 * (outer**4 - inner**4)
    zeta, piece = pipe_impedance(*PIPE), length / n
    pipe = TorsionalChain(
        inertia=(2900.0,) + (density * polar * piece,) * n, stiffness=(modulus * polar / piece,) * n, damping=(0.0,) * n
    )  # fmt: skip
    bump = np.linspace(0.0, 0.8, 81), 500.0 * (1 - np.cos(np.linspace(0.0, 2 * np.pi, 81)))
    times = np.array([1.0, 1.9])  # all of the wave is in the pipe, and all of it has met the top
    left = {}
    laws = {"matched": ZTorque.for_string(zeta, 2900.0, filter_time=1e-3, reference=0.0), "stiff": StiffPI(reference=0.0)}
    for name, law in laws.items():
        run = simulate(compose(pipe), 2.0, controller=law, inputs={"bit.torque": bump}, accuracy=1e-5).at(times)
        kinetic = (run["chain.speed"][:, 1:] ** 2).sum(axis=1) * density * polar * piece / 2
        energy = kinetic + (run["chain.twist"] ** 2).sum(axis=1) * modulus * polar / piece / 2
        left[name] = energy[1] / energy[0]
    # what returns is |r|^2 of every frequency in the bump
    om = np.linspace(0.05, 60.0, 1200)
    share = np.abs(np.trapezoid(bump[1] * np.exp(-1j * om[:, None] * bump[0]), bump[0], axis=1)) ** 2
    for name, law in laws.items():
        expected = np.trapezoid(share * np.abs(reflection(impedance(law, frequency=om, inertia=2900.0), zeta)) ** 2, om) / np.trapezoid(
            share, om
        )
        assert left[name] == pytest.approx(expected, rel=0.1)
    assert left["matched"] < 0.15 < 0.9 < left["stiff"]


# --- the linear model


def test_the_string_model_and_the_drilling_point_are_those_of_the_plant():
    model = string_model(RIG)
    np.testing.assert_allclose(
        model.A, [[0, 1, -1], [-473 / 2122, -(425 + 23.2) / 2122, 23.2 / 2122], [473 / 374, 23.2 / 374, -(50 + 23.2) / 374]]
    )
    np.testing.assert_allclose([*model.B, *model.E], [0, 1 / 2122, 0, 0, 0, 1 / 374])
    _, x, u, A = drilling_point(RIG, 4.0)
    load = 97_347.0 * 0.155575
    torque = load * (0.5 + 0.3 * np.exp(-3.6))
    np.testing.assert_allclose([*x, u], [(torque + 200.0) / 473.0, 4.0, 4.0, torque + 200.0 + 1700.0], rtol=1e-9)
    assert A[2, 2] == pytest.approx((-73.2 + 0.9 * load * 0.3 * np.exp(-3.6)) / 374.0, rel=1e-9)
    steady = simulate(RIG, 1.0, start=dict(zip(model.states, x, strict=True)), inputs={"top.torque": u})
    assert steady.at(1.0)["bit.speed"] == pytest.approx(4.0, abs=1e-8)


def test_laws_are_designed_on_the_string_behind_a_top_drive_and_free_the_bit_through_it():
    behind = compose(wells.JANSEN_2, BitRock(), TopDrive(torque_limit=20_000.0))
    assert LQR(reference=4.0).design(behind) == LQR(reference=4.0).design(RIG)
    stiff = simulate(behind, 150.0, controller=StiffPI(reference=5.0, **LIMITS), sample_time=0.01)
    assert stiff.time_in("bit", "stick", after=100.0) > 10.0
    for kind in (ZTorque, LQG, HInfinity):
        law = Sampled(kind(reference=5.0, **LIMITS), 0.01, noise={"top.speed": 0.01}, resolution={"top.speed": 0.002})
        assert simulate(behind, 150.0, controller=law).time_in("bit", "stick", after=100.0) == 0.0, kind.__name__


# --- LQR, LQG, H-infinity


def at_point(law, reference, **more):
    """The states of the drilling point, where a loop is linearised."""
    model, x, _, _ = drilling_point(RIG, reference)
    return dict(zip(model.states, x, strict=True)) | more


def test_the_poles_under_lqr_are_the_stable_half_of_the_hamiltonian():
    speed = 3.0
    law = LQR(reference=speed).design(RIG)
    model, _, _, A = drilling_point(RIG, speed)
    F = np.block([[A, np.zeros((3, 1))], [model.top[None, :], np.zeros((1, 1))]])
    G = np.append(model.B, 0.0)
    Q = np.diag([0.0, 1 / law.top_speed_scale**2, 1 / law.bit_speed_scale**2, 1 / law.angle_scale**2])
    hamiltonian = np.block([[F, -np.outer(G, G) * law.torque_scale**2], [-Q, -F.T]])
    every = np.linalg.eigvals(hamiltonian)
    found = poles(wells.JANSEN_2, BitRock(), law, at=at_point(law, speed), mode={"bit": "slip+"})
    np.testing.assert_allclose(found, np.sort_complex(every[every.real < 0]), rtol=1e-6)
    # its twin without the law falls off the point
    assert np.linalg.eigvals(A).real.max() > 0.1


def test_lqr_keeps_the_return_difference_above_one():
    law = LQR(reference=3.0).design(RIG)
    model, _, _, A = drilling_point(RIG, 3.0)
    F = np.block([[A, np.zeros((3, 1))], [model.top[None, :], np.zeros((1, 1))]])
    G, K = np.append(model.B, 0.0), np.array(law.gain)
    for om in np.geomspace(0.01, 100, 60):
        assert abs(1 + K @ np.linalg.solve(1j * om * np.eye(4) - F, G)) >= 1 - 1e-9


def test_lqr_follows_a_set_point_that_moves_to_another_drilling_point():
    law = LQR(reference=6.0)
    run = simulate(RIG, 200.0, start=at_point(law, 6.0), controller=law, inputs={"top.reference": ((0.0, 10.0, 40.0), (6.0, 6.0, 9.0))})
    _, x, u, _ = drilling_point(RIG, 9.0)
    end = run.at(200.0)
    np.testing.assert_allclose([end["chain.twist"][0], end["top.speed"], end["top.torque"]], [x[0], 9.0, u], rtol=1e-4)


def test_with_a_rock_of_constant_torque_the_poles_under_lqg_are_those_of_regulator_and_filter():
    rock = BitRock(friction=Coulomb(static=0.6, kinetic=0.5))
    plant = compose(wells.JANSEN_2, rock)
    law = LQG(reference=3.0).design(plant)
    regulator = poles(wells.JANSEN_2, rock, law.law, at={"chain.speed": (3.0, 3.0)}, mode={"bit": "slip+"})
    n = len(law.observer.gain)
    stacked = np.zeros((n + 4, n))
    stacked.flat[list(law.observer.model_indices)] = law.observer.model
    A, C = stacked[:n], stacked[n + 1]
    expected = np.concatenate([regulator, np.linalg.eigvals(A - np.outer(law.observer.gain, C))])
    found = poles(wells.JANSEN_2, rock, law, at={"chain.speed": (3.0, 3.0)}, mode={"bit": "slip+"})
    np.testing.assert_allclose(np.poly(found).real, np.poly(expected).real, rtol=1e-5)


def test_h_infinity_keeps_the_norm_it_names_at_every_frequency_and_no_law_can_keep_much_less():
    law = HInfinity(reference=4.0).design(RIG)
    model, _, _, A = drilling_point(RIG, 4.0)
    n, many = law.order, len(law.nonzero_indices)
    A_K, (B_K, C_K, _) = np.zeros((n, n)), np.array(law.controller_matrices[many:]).reshape(3, n)
    A_K.flat[list(law.nonzero_indices)] = law.controller_matrices[:many]
    worst = 0.0
    for om in np.geomspace(1e-3, 100.0, 400):
        K = C_K @ np.linalg.solve(1j * om * np.eye(n) - A_K, B_K)
        from_bit, from_drive = (np.linalg.solve(1j * om * np.eye(3) - A, column) for column in (-model.E, model.B))
        top, bit = (row @ from_bit for row in (model.top, model.bit))
        loop = 1 - K * (model.top @ from_drive)
        torque = np.array([K * top * law.disturbance_scale, K * law.speed_noise]) / loop
        speeds = [top * law.disturbance_scale + model.top @ from_drive * torque[0], model.top @ from_drive * torque[1]]
        bits = [bit * law.disturbance_scale + model.bit @ from_drive * torque[0], model.bit @ from_drive * torque[1]]
        gain = np.array(
            [
                np.array(bits) / law.bit_speed_scale,
                np.array(speeds) / (1j * om + law.integrator_leak) / law.angle_scale,
                torque / law.torque_scale,
            ]
        )
        worst = max(worst, np.linalg.norm(gain, 2))
    assert law.gamma / 1.2 * 0.9 < worst < law.gamma


def test_h_infinity_stabilises_its_point():
    law = HInfinity(reference=4.0).design(RIG)
    found = np.sort(poles(wells.JANSEN_2, BitRock(), law, at=at_point(law, 4.0), mode={"bit": "slip+"}).real)
    # the integral adds one pole near its own zero at -leak, where it moves nothing that is seen
    assert found[-1] == pytest.approx(-law.integrator_leak, rel=1e-2)
    assert found[-2] < -0.25


def test_h_infinity_comes_to_its_set_point_under_a_rock_that_it_does_not_know_and_without_its_integral_stays_low():
    law, off = HInfinity(reference=4.0).design(RIG), {}
    for name, each in (("integral", law), ("none", _without_integral(law))):
        run = simulate(RIG, 600.0, start=at_point(law, 4.0), controller=each, sample_time=0.01, inputs={"bit.weight": 0.8 * 97_347.0})
        assert run.time_in("bit", "stick") == 0.0
        off[name] = abs(run.at(600.0)["top.speed"] / 4.0 - 1.0)
    assert off["integral"] < 1e-3
    assert off["none"] > 0.01


def _without_integral(law):
    """The same K without the factor 1 + leak / s."""

    @dataclass(frozen=True)
    class Bare(HInfinity):
        def _law(self, signal, period):
            x, angle, rate, turning, command, memory = super()._law(signal, period)
            return x, angle, rate, 0.0 * turning, command, memory

    return Bare(**{each.name: getattr(law, each.name) for each in fields(law)})


# --- sliding modes


def test_inside_its_boundary_layer_s_stays():
    for width in (0.2, 0.05):
        _, surface, _ = chatter.held(replace(chatter.laws()["explicit"], boundary_layer=width), 0.01)
        assert np.abs(surface).max() < width


def test_the_explicit_sign_chatters_with_its_period_and_the_implicit_one_does_not():
    found, periods = chatter.changes(), np.array(chatter.PERIODS)
    s, torque = found["explicit"].T
    # the equivalent control lacks (425 - 340) w_top / J, which adds to eta on the way down; the torque jumps by 2 J eta however short the period
    lacking = 85.0 * 8.0 / 2122.0
    np.testing.assert_allclose(s, (2.0 + lacking) * periods, rtol=0.02)
    np.testing.assert_allclose(torque, 2 * 2122.0 * 2.0, rtol=0.02)
    s, torque = found["implicit"].T
    assert np.all(s[:-1] / s[1:] > 3.9)  # second order in the period, or better
    np.testing.assert_allclose(torque[:-1] / torque[1:], 2.0, rtol=0.05)  # steps of a continuous torque
    assert s[0] < 1e-3 * found["explicit"][0, 0]


def test_super_twisting_holds_the_surface_with_a_continuous_torque():
    # |s| is of second order in the period, where a first-order switch has the first
    every = {name: [np.abs(chatter.held(law, period)[1]).max() for period in (0.02, 0.005)] for name, law in chatter.laws().items()}
    assert every["super-twisting"][0] / every["super-twisting"][1] > 8.0
    assert every["explicit"][0] / every["explicit"][1] < 6.0
    assert every["super-twisting"][1] < 0.05 * every["explicit"][1]
    _, _, torque = chatter.held(chatter.laws()["super-twisting"], 0.005)
    assert np.abs(np.diff(torque)).max() < 0.01 * 2 * 2122.0 * 2.0


def test_super_twisting_on_the_impedance_surface_makes_the_drive_a_matched_end():
    law = ImpedanceSuperTwisting(reference=8.0, disturbance_rate=10.0).design(RIG)
    assert law.impedance == pytest.approx(np.sqrt(473.0 * 374.0))
    run = simulate(RIG, 40.0, controller=law, sample_time=0.002, start={"chain.speed": (8.0, 8.0), "chain.twist": 17.0},
                   inputs={"bit.weight": sine(97_347.0, 5000.0, 0.3)})  # fmt: skip
    late = run.at(np.arange(20.0, 40.0, 0.05))
    assert np.abs(late["impedancesupertwisting.surface"]).max() < 0.02
    expected = -law.impedance * (late["top.speed"] - 8.0 + law.surface_gain * late["impedancesupertwisting.angle"])
    np.testing.assert_allclose(late["top.load"], expected, atol=0.03 * law.impedance)
    assert np.ptp(late["top.load"]) > 300.0


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda: simulate(RIG, 1.0, controller=PI(lowest_torque=5000.0, highest_torque=5000.0)), "highest_torque"),
    (lambda: simulate(RIG, 1.0, controller=PI(torque_rate=100.0)), "sample_time"),
    (lambda: simulate(RIG, 1.0, controller=PI(proportional=0.0, highest_torque=100.0)), "proportional"),
    (lambda: simulate(RIG, 1.0, controller=IdealSlidingMode(highest_torque=100.0)), "without torque limits"),
    (lambda: impedance(SlidingMode().design(RIG), frequency=[1.0]), r"bit\.speed|top\.load"),
    *each_of(lambda law: law.design(BELT), "drill string", (LQR(), LQG())),
    *[(lambda law=law: law.design(BELT), type(law).__name__) for law in (ZTorque(), ActiveDamping(), ImpedanceSuperTwisting())],
    (lambda: simulate(RIG, 1.0, controller=ImpedanceSuperTwisting()), "sample_time"),
)  # fmt: skip


def test_severity_with_a_law_on_the_bit_is_small_where_the_stiff_drive_swings_to_standstill():
    for kind, holds in ((LQG, True), (StiffPI, False)):
        run = simulate(RIG, 150.0, controller=kind(reference=4.0, **LIMITS), sample_time=0.01)
        assert (severity(run, after=100.0) < 0.05) is holds
