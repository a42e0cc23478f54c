"""The moving-horizon observer: the Kalman filter that it is without limits, what limits add, and laws that act on it."""

from __future__ import annotations

import copy
import pickle

import control
import numpy as np
import pytest

from controllers import LQR, StiffPI
from controllers.observers import Kalman, MovingHorizon
from models import BlockOnBelt
from tests.plants import RIG
from toolbox import Sampled, SceneError, compose, simulate
from toolbox.modelling import ObserverBasedController

FREE = {"lowest_speed": None, "lowest_torque": None}
LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}


@pytest.mark.parametrize("window", [1, 6, 25])
def test_without_limits_it_is_the_stationary_kalman_filter_whatever_its_window(window):
    seen = MovingHorizon(window=window, **FREE).create_estimator(RIG)
    F, C = seen.whole, seen.rows
    unit = np.array([1.0, 1.0, 1.0, 1e4])  # torques in 10 kN m, for a well-scaled equation
    L, _, _ = control.dlqe(
        F * unit / unit[:, None], np.eye(4), C * unit, seen.walk / np.outer(unit, unit), seen.noise
    )  # gain of the prediction, F times that of the correction
    random = np.random.default_rng(2)
    z = np.zeros(4)
    for _ in range(60):
        y, torque = random.normal(size=1), 1e4 * random.normal()
        z = z + unit * (np.linalg.solve(F * unit / unit[:, None], L) @ (y - C @ z))
        assert seen.correct(y) / unit == pytest.approx(z / unit, rel=1e-6, abs=1e-6)
        z = F @ z + seen.whole_drive * torque
        seen.predict(torque)
    assert seen.failures == 0


def in_stick_slip(observer, seed=1):
    """Estimated and true bit speed and torque in the stick-slip of a stiff drive, seen through noise."""
    run = simulate(RIG, 60.0, controller=Sampled(ObserverBasedController(StiffPI(), observer), 0.05, noise={"top.speed": 0.01}, seed=seed))
    estimates = run.controllers[0].estimates
    true = run.at(np.arange(len(estimates)) * 0.05)
    assert run.controllers[0].estimator.failures == 0
    return {
        name: (np.array([e[name] for e in estimates])[400:], true[name][400:])
        for name in ("bit.speed", "bit.torque", "bit.friction_scale")[:2]
    }


@pytest.mark.parametrize("seed", [1, 2])
def test_in_stick_slip_its_limits_make_it_better_than_the_filter_and_than_a_filter_that_is_cut(seed):
    def rms(values):
        return float(np.sqrt(np.mean(values**2)))

    limited, free = in_stick_slip(MovingHorizon(), seed), in_stick_slip(MovingHorizon(**FREE), seed)
    seen, true = limited["bit.speed"]
    plain, _ = free["bit.speed"]
    assert seen.min() > -1e-6 and plain.min() < -1.0  # the filter lets the bit turn backwards
    assert rms(seen - true) < 0.95 * rms(np.maximum(plain, 0.0) - true) < 0.95 * rms(plain - true)
    stuck = true == 0.0
    assert stuck.sum() > 200
    assert rms(seen[stuck]) < 0.85 * rms(plain[stuck])
    assert rms(np.subtract(*limited["bit.torque"])) < rms(np.subtract(*free["bit.torque"]))


def test_limits_that_are_not_reached_change_nothing_and_a_heavier_rock_is_found():
    point = {"chain.speed": (10.0, 10.0), "chain.twist": 18.0}
    run = simulate(RIG, 30.0, controller=StiffPI(reference=14.0), sample_time=0.05, start=point, inputs={"bit.weight": 1.1 * 97_347.0})
    limited, free = (observer.create_estimator(RIG) for observer in (MovingHorizon(), MovingHorizon(**FREE)))
    for k, instant in enumerate(run.at(np.arange(600) * 0.05)["top.speed"]):
        seen, plain = (each.estimate(np.array([instant])) for each in (limited, free))
        if k > 300:  # the memory of a start that both take for rest has faded
            assert seen == pytest.approx(plain, rel=1e-6, abs=1e-6)
        for each in (limited, free):
            each.predict(float(run.at(k * 0.05)["top.torque"]))
    assert seen["bit.speed"] == pytest.approx(float(run.at(599 * 0.05)["bit.speed"]), abs=0.02)
    assert seen["bit.friction_scale"] == pytest.approx(1.1, abs=0.01)


def test_a_regulator_on_its_estimates_ends_the_stick_slip_that_a_stiff_drive_keeps():
    stuck = {}
    for law in (LQR(reference=6.0, **LIMITS), StiffPI(reference=6.0, **LIMITS)):
        loop = Sampled(
            ObserverBasedController(law, MovingHorizon(delay=0.03, torque_process_noise=2000.0)),
            0.05,
            delay=0.03,
            noise={"top.speed": 0.01},
        )
        run = simulate(RIG, 100.0, controller=loop)
        stuck[type(law).__name__] = run.time_in("bit", "stick", after=60.0)
    assert stuck["LQR"] == 0.0
    assert stuck["StiffPI"] > 5.0


def test_a_law_on_its_estimates_follows_a_set_point_as_the_same_law_on_a_filter():
    ends = [
        simulate(
            RIG,
            80.0,
            controller=ObserverBasedController(LQR(reference=8.0, **LIMITS), observer),
            sample_time=0.05,
            inputs={"top.reference": 9.0},
        )
        for observer in (MovingHorizon(), Kalman(period=0.05))
    ]
    for run in ends:
        assert run.at(80.0)["top.reference"] == 9.0
        assert run.at(80.0)["bit.speed"] == pytest.approx(9.0, abs=0.02)


def test_designed_observers_copy_and_pickle_with_their_memory():
    law = ObserverBasedController(StiffPI(), MovingHorizon()).design(RIG)
    for k in range(5):
        law(0.05 * k, np.array([0.1 * k, 0.0, 8.0]))
    torques = [twin(0.25, np.array([0.6, 0.0, 8.0])) for twin in (copy.deepcopy(law), pickle.loads(pickle.dumps(law)), law)]
    assert (
        torques[0] == torques[1] == pytest.approx(torques[2], rel=1e-12)
    )  # whose solver starts from its last active set, that of a copy cold


def test_bad_arguments_are_named():
    def run(observer, plant=RIG, **more):
        return simulate(plant, 1.0, controller=ObserverBasedController(StiffPI(), observer, **more), sample_time=0.05)

    for wrong, name in (
        ({"window": 0}, "window"),
        ({"solver": "best"}, "solver"),
        ({"speed_noise": 0.0}, "speed_noise"),
        ({"delay": -1.0}, "delay"),
    ):
        with pytest.raises(SceneError, match=f"`{name}`.* must"):
            run(MovingHorizon(**wrong))
    with pytest.raises(SceneError, match="`delay_samples` must be 0"):
        run(MovingHorizon(), delay_samples=2)
    with pytest.raises(SceneError, match=r"`sample_time` must be 0\.05 s"):
        simulate(RIG, 1.0, controller=ObserverBasedController(StiffPI(), MovingHorizon()), sample_time=0.1)
    with pytest.raises(SceneError, match="drill string"):
        run(MovingHorizon(), compose(BlockOnBelt()))
