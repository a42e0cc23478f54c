"""Predicted motion: agreement with the event loop, derivatives across release and re-sticking, and peaks of regularised friction."""

import copy
import pickle

import casadi as ca
import numpy as np
import pytest

from models import BitRock, BlockOnBelt, Coulomb, Exponential, Hyperbolic, Tabulated, wells
from tests.plants import BELT, RIG
from toolbox import SceneError, compose, simulate
from toolbox.modelling.regularisation import lacking, regularised
from toolbox.prediction.rollout import Rollout

TORQUES = np.repeat(np.random.default_rng(1).uniform(0.0, 20_000.0, 40), 10)[:, None]


def as_input(torques, interval):
    """A table of held torques, a jump at each interval."""
    times = np.arange(torques.size + 1) * interval
    return np.repeat(times, 2)[1:-1], np.repeat(torques.ravel(), 2)


def test_a_rollout_with_exact_modes_is_the_motion_that_simulate_finds_through_release_and_resticking():
    times = np.arange(TORQUES.size + 1) * 0.1
    run = simulate(RIG, times[-1], inputs={"top.torque": as_input(TORQUES, 0.1)}, output_times=times, accuracy=1e-10)
    assert sum(event.before == "stick" for event in run.events) >= 4  # it does stick and slip
    sizes = np.abs(run.states).max(axis=0)
    errors = []
    for steps in (4, 8):
        X, M = Rollout(RIG, ["top.torque"], 0.1, steps).states(np.zeros(3), TORQUES)
        assert np.array_equal(M[:-1, 0], run.mode[:-1, 0])
        errors.append(np.abs((X - run.states) / sizes).max())
    assert errors[0] < 1e-4
    assert errors[1] < errors[0] / 8  # order four over forty seconds, events included: 16 but for round-off


def test_a_machine_a_million_times_as_fast_moves_alike_in_its_own_time():
    """Time in other units: masses by the square, damping and the friction's speeds by the factor, forces and positions as they were."""
    motions = []
    for unit in (1.0, 2.0**-20, 2.0**20):
        belt = BlockOnBelt(
            mass=unit**2, damping=0.05 * unit, belt_speed=0.2 / unit, friction=Exponential(static=1.0, kinetic=0.5, decay=3.0 * unit)
        )
        X, M = Rollout(compose(belt), ["block.force"], 0.1 * unit, 4).states(np.zeros(2), 0.3 * np.sin(np.arange(300.0))[:, None])
        motions.append((X * [1.0, unit], M))
    (X, M), *others = motions
    assert (M == 0).any() and (M != 0).any()  # it sticks and slips
    for other, modes in others:
        assert np.array_equal(modes, M) and np.abs(other - X).max() < 1e-9


@pytest.mark.parametrize("regularisation", [None, regularised(0.05)], ids=["exact", "smooth"])
def test_a_law_with_kinks_is_rolled_out_over_them(regularisation):
    """Kinks of fmax are guards of the event loop, and none of a prediction: its numbers are those of modes alone."""
    table = Tabulated(speeds=(0.0, 1.0, 3.0, 8.0), coefficients=(0.8, 0.6, 0.52, 0.5), static=0.8)
    rig = compose(wells.JANSEN_2, BitRock(friction=table))
    times = np.arange(TORQUES.size + 1) * 0.1
    run = simulate(rig, times[-1], inputs={"top.torque": as_input(TORQUES, 0.1)}, output_times=times, accuracy=1e-10)
    steps = 8 if regularisation is None else 400
    X, A, B, _ = Rollout(rig, ["top.torque"], 0.1, steps, regularisation).advance(np.zeros(3), TORQUES)
    sizes = np.abs(run.states).max(axis=0)
    assert np.abs((X - run.states) / sizes).max() < (1e-4 if regularisation is None else 0.2)
    assert np.isfinite(A).all() and np.isfinite(B).all()


def test_derivatives_across_a_switch_are_those_of_the_hybrid_flow():
    rollout = Rollout(RIG, ["top.torque"], 0.1, 8)
    X, A, B, M = rollout.advance(np.zeros(3), TORQUES)
    released = np.flatnonzero((M[:-1, 0] == 0) & (M[1:, 0] == 1))[:3]
    stuck = np.flatnonzero((M[:-1, 0] == 1) & (M[1:, 0] == 0))[:3]
    sliding = np.flatnonzero((M[:-1, 0] == 1) & (M[1:, 0] == 1))[:3]
    for k in (*released, *stuck, *sliding):
        # the speed of a stuck bit is zero, and is no free state
        for j, size in enumerate((1e-5, 1e-5) if M[k, 0] == 0 else (1e-5, 1e-5, 1e-5)):
            moved = [rollout.states(X[k] + sign * size * np.eye(3)[j], TORQUES[k : k + 1])[0][1] for sign in (1, -1)]
            assert (moved[0] - moved[1]) / (2 * size) == pytest.approx(A[k][:, j], abs=1e-4)
        moved = [rollout.states(X[k], TORQUES[k : k + 1] + sign)[0][1] for sign in (1, -1)]
        assert (moved[0] - moved[1]) / 2 == pytest.approx(B[k][:, 0], abs=1e-8)
    for k in stuck:
        assert A[k][2] == pytest.approx([0, 0, 0], abs=1e-12)  # whatever came before, the bit is at rest


def test_the_scale_of_a_contact_multiplies_what_it_holds():
    rollout = Rollout(RIG, ["top.torque"], 0.1, 4)
    bound = 97_347.0 * 0.155575 * 0.8
    state = np.array([1.05 * bound / 473.0, 0.0, 0.0])
    still = np.array([[1.05 * bound]])
    assert rollout.states(state, still)[1][1, 0] == 1.0
    rollout.scale[:] = 1.1
    assert rollout.states(state, still)[1][1, 0] == 0.0


@pytest.mark.parametrize(
    "law", [Exponential(static=0.8, kinetic=0.5, decay=0.9), Coulomb(static=0.5, kinetic=0.3), Hyperbolic(static=1.0, decay=3.0)]
)
@pytest.mark.parametrize("width", [0.01, 0.1, 0.5])
def test_a_matched_peak_is_the_static_bound_and_a_plain_tanh_stays_below_it(law, width):
    v = np.linspace(0.0, 40.0 * width, 40_001)
    smooth = np.tanh(v / width)
    speed = v * smooth
    plain = smooth * np.array(ca.DM(law.sliding(ca.DM(speed)))).ravel()
    matched = plain + lacking(law, width) * smooth * np.exp(-speed / (2 * width))
    bound = float(law.breakaway())
    assert plain.max() < bound
    assert matched.max() == pytest.approx(bound, rel=1e-6)
    assert matched[-1] == pytest.approx(plain[-1], rel=1e-6)  # far from rest nothing is added


def test_regularised_rollouts_approach_the_exact_motion_with_their_width_and_need_the_matched_peak():
    exact, _ = Rollout(RIG, ["top.torque"], 0.1, 8).states(np.zeros(3), TORQUES[:150])

    def far(width, matched):
        steps = int(np.ceil(0.1 * 17_000.0 / width / 374.0 / 2.0))
        X, _ = Rollout(RIG, ["top.torque"], 0.1, steps, regularised(width, matched)).states(np.zeros(3), TORQUES[:150])
        return np.abs(X - exact).max()

    assert far(0.05, True) < far(0.2, True)
    assert far(0.05, True) < far(0.05, False)


def test_rollouts_travel_and_copy_with_factors_of_their_own():
    rollout = Rollout(RIG, ["top.torque"], 0.1, 4)
    rollout.scale[:] = 1.2
    for twin in (copy.deepcopy(rollout), pickle.loads(pickle.dumps(rollout))):
        assert np.array_equal(twin.states(np.zeros(3), TORQUES)[0], rollout.states(np.zeros(3), TORQUES)[0])
        twin.scale[:] = 1.0
        assert rollout.scale[0] == 1.2


def test_a_block_on_a_belt_is_rolled_out_with_the_same_code():
    X, _ = Rollout(BELT, ["block.force"], 0.05, 4).states(np.zeros(2), np.zeros((600, 1)))
    run = simulate(BELT, 30.0, output_times=np.arange(601) * 0.05, accuracy=1e-10)
    assert np.abs(X - run.states).max() < 1e-5
    assert any(event.after == "stick" for event in run.events)


def test_what_a_rollout_cannot_predict_is_named():
    from controllers import IdealSlidingMode

    with pytest.raises(SceneError, match="is a Relay"):
        Rollout(compose(wells.JANSEN_2, BitRock(), IdealSlidingMode()), [], 0.1, 4)
