"""Observers of the bit against their poles, their Riccati equation, and a bit that they do not see."""

from __future__ import annotations

import numpy as np
import pytest

from controllers import LQG, PI, Lifting, StiffPI
from controllers.observers import DisturbanceObserver, Kalman, SlidingObserver
from controllers.observers.linear import one_step
from controllers.on_estimates import StringObserverController
from models import BitRock, BlockOnBelt, Coulomb, TorsionalChain, wells
from tests.plants import RIG
from toolbox import Sampled, SceneError, closed_loop, compose, simulate
from toolbox.measure import stick_intervals
from toolbox.modelling import ObserverBasedController

EVERY = pytest.mark.parametrize("observer", [Kalman(), DisturbanceObserver(), SlidingObserver()], ids=lambda o: type(o).__name__)


def matrices(observer):
    stacked = stack(observer)
    n = stacked.shape[1]
    return stacked[:n], np.array(observer.gain), stacked[n + 1]


def stack(observer):
    """A, B', and the rows of top speed, bit speed and top load."""
    n = len(observer.gain)
    found = np.zeros((n + 4, n))
    found.flat[list(observer.model_indices)] = observer.model
    return found


def seen(observer, law, duration=60.0, after=20.0, plant=RIG, noise=0.0, **arguments):
    """Signals of a loop that does not use the estimates but records them."""
    run = simulate(
        plant,
        duration,
        controller=Sampled(ObserverBasedController(law, observer), 0.01, noise={"top.speed": noise} if noise else {}),
        **arguments,
    )
    return run.at(np.arange(after, duration, 0.02))


# --- poles


def test_the_disturbance_observer_has_all_poles_at_its_bandwidth():
    A, L, C = matrices(DisturbanceObserver(bandwidth=5.0).design(RIG))
    np.testing.assert_allclose(np.poly(A - np.outer(L, C)), np.poly(np.full(4, -5.0)), rtol=1e-6)


def test_the_poles_of_the_filter_are_the_stable_half_of_its_hamiltonian():
    law = Kalman().design(RIG)
    A, L, C = matrices(law)
    B = stack(law)[len(law.gain)]
    Q = law.drive_process_noise**2 * np.outer(B, B)
    Q[-1, -1] += law.torque_process_noise**2
    R = law.speed_noise**2 * law.period
    every = np.linalg.eigvals(np.block([[A.T, -np.outer(C, C) / R], [-Q, -A]]))
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(A - np.outer(L, C))), np.sort_complex(every[every.real < 0]), rtol=1e-5)


def test_on_its_surface_the_sliding_observer_has_all_poles_at_its_bandwidth():
    # e_top = 0: the others obey (1 - g c) A on the kernel of c
    A, g, C = matrices(SlidingObserver(bandwidth=3.0).design(RIG))
    assert C @ g == pytest.approx(1.0)
    found = np.poly(np.linalg.eigvals((np.eye(4) - np.outer(g, C)) @ A))
    np.testing.assert_allclose(found, np.append(np.poly(np.full(3, -3.0)), 0.0), rtol=1e-6, atol=1e-6)


def test_samples_too_far_apart_for_the_steps_of_an_observer_are_refused_by_name():
    # the fastest pole of the filter is at drive_walk / (J noise sqrt(period)), and Runge-Kutta steps of order four bear 2.785 / pole
    fast = Kalman(drive_process_noise=491.9)
    longest = 2.785 * RIG.parameter("chain.inertia")[0] * fast.speed_noise * fast.period**0.5 / fast.drive_process_noise
    for law in (
        StringObserverController(PI(), fast, delay_samples=2),
        ObserverBasedController(PI(), fast),
        Lifting(PI(), observer=fast),
        LQG(drive_process_noise=491.9),
    ):
        assert closed_loop(RIG, law, sample_time=0.95 * longest).system.updates
        with pytest.raises(SceneError, match=f"`sample_time` must be at most 0.0{round(1000 * longest)}.* s for Kalman .* but it is 0.0"):
            closed_loop(RIG, law, sample_time=1.05 * longest)
    with pytest.raises(SceneError, match="for DisturbanceObserver with these numbers"):  # all poles at 30 rad/s
        closed_loop(RIG, ObserverBasedController(PI(), DisturbanceObserver(bandwidth=30.0)), sample_time=2.785 / 30.0 * 1.01)
    with pytest.raises(SceneError, match="for SlidingObserver with these numbers"):
        closed_loop(RIG, ObserverBasedController(PI(), SlidingObserver(reaching=100.0)), sample_time=0.05)


def test_what_is_refused_would_swing_ever_more():
    law = Kalman(drive_process_noise=491.9).design(RIG)
    A, L, C = matrices(law)
    for period, swings in ((0.0115, False), (0.0125, True)):
        step = one_step(lambda z: (A - np.outer(L, C)) @ z, np.eye(A.shape[0]), period)
        assert (np.linalg.norm(np.linalg.matrix_power(step, 2000)) > 1.0) == swings


# --- what they see


@EVERY
def test_a_turning_bit_is_seen_exactly_whatever_rock_it_turns_in(observer):
    # the law of the rock is not in the observer: its torque is found as a constant, its weight is 10 % more than declared
    late = seen(
        observer,
        PI(reference=10.0),
        200.0,
        190.0,
        inputs={"bit.weight": 1.1 * 97_347.0},
        start={"chain.speed": (10.0, 10.0), "chain.twist": 18.0},
    )
    assert np.ptp(late["bit.speed"]) < 1e-3
    for name, tolerance in (("bit.speed", 1e-3), ("top.load", 1.0), ("bit.torque", 2.0)):
        np.testing.assert_allclose(late[f"estimate.{name}"], late[name], atol=tolerance)
    np.testing.assert_allclose(late["estimate.bit.friction_scale"], 1.1, rtol=1e-3)


@EVERY
def test_a_bit_in_stick_slip_is_seen_from_the_surface_through_noise(observer):
    late = seen(observer, StiffPI(), noise=0.01)
    assert late["bit.speed"].min() == 0.0 and late["bit.speed"].max() > 15.0
    error = np.std(late["estimate.bit.speed"] - late["bit.speed"])
    assert error < 0.3 * np.std(late["bit.speed"])
    # the twin that takes the string for rigid sees nothing of it
    assert np.std(late["top.speed"] - late["bit.speed"]) > 0.95 * np.std(late["bit.speed"])
    assert np.std(late["estimate.bit.torque"] - late["bit.torque"]) < 0.2 * late["bit.torque"].max()


@EVERY
def test_while_the_bit_stands_the_estimates_lag_by_what_a_ramp_of_its_torque_does_to_them(observer):
    # T = k twist grows by k w_top; an observer that takes it for constant has the error e = (A - L C)^-1 (0, ..., T') in the end
    run = simulate(RIG, 60.0, controller=ObserverBasedController(StiffPI(reference=3.0), observer), sample_time=0.01)
    A, L, C = matrices(observer.design(RIG))
    if isinstance(observer, SlidingObserver):
        L = L * (observer.switching_gain / observer.boundary_layer + observer.reaching)
    sticks = [(begin, end) for begin, end in stick_intervals(run, "bit") if end - begin > 5.0]
    assert len(sticks) >= 3
    for _, end in sticks:
        last = run.at(end - 0.01)
        assert last["bit.speed"] == 0.0
        error = np.linalg.solve(A - np.outer(L, C), [0, 0, 0, 473.0 * last["top.speed"]])
        assert last["estimate.bit.speed"] == pytest.approx(error[2], abs=0.02)
        assert last["estimate.bit.torque"] - last["bit.torque"] == pytest.approx(error[3], abs=60.0)
        assert abs(error[2]) < 0.1 * run["bit.speed"].max()  # small against the swing of the bit


def test_a_filter_told_of_less_noise_follows_sooner_and_passes_more_of_it():
    quiet, trusting = Kalman(speed_noise=0.05), Kalman(speed_noise=0.001)
    slow, fast = (np.linalg.norm(matrices(o.design(RIG))[1]) for o in (quiet, trusting))
    assert fast > 5 * slow
    turning = {"start": {"chain.speed": (10.0, 10.0), "chain.twist": 17.0}}
    jitter = [
        np.std(np.diff(seen(o, PI(reference=10.0), 60.0, 40.0, noise=0.05, **turning)["estimate.bit.speed"])) for o in (quiet, trusting)
    ]
    assert jitter[1] > 2 * jitter[0]


def test_a_chain_of_four_inertias_is_observed_too():
    plant = compose(wells.NAVARRO_LOPEZ_4, BitRock())
    late = seen(
        Kalman(), PI(reference=10.0), 150.0, 140.0, plant=plant, start={"chain.speed": (10.0,) * 4, "chain.twist": (15.0, 10.0, 11.0)}
    )
    np.testing.assert_allclose(late["estimate.bit.speed"], late["bit.speed"], atol=0.01)
    np.testing.assert_allclose(late["estimate.chain.speed.1"], late["chain.speed"][:, 1], atol=0.01)


# --- what is refused, and what is left out


def test_an_observer_knows_no_scale_of_a_rock_whose_law_it_cannot_read():
    plant = compose(wells.JANSEN_2, BitRock(friction=Coulomb(static=0.6, kinetic=0.5)))
    run = simulate(plant, 5.0, controller=Sampled(ObserverBasedController(PI(), Kalman()), 0.01))
    assert "estimate.bit.torque" in run
    assert "estimate.bit.friction_scale" not in run


def test_an_observer_without_a_string_is_refused():
    with pytest.raises(SceneError, match="drill string"):
        Kalman().design(compose(BlockOnBelt()))
    with pytest.raises(SceneError, match=r"bit\.force"):
        Kalman().design(compose(TorsionalChain()))
