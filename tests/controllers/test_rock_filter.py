"""The filter that knows the law of the rock while the bit turns: a Kalman filter where the law is a constant, and sharper than one that does not know it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from controllers import NonlinearMPC
from controllers.string_model import drilling_point
from models import BitRock, Coulomb, wells
from toolbox import Sampled, compose, simulate

WEIGHT = 97_347.0
RIG = compose(wells.JANSEN_2, BitRock(weight=WEIGHT))
LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}


def test_with_a_constant_rock_it_becomes_the_stationary_filter_of_states_and_strength():
    plant = compose(wells.JANSEN_2, BitRock(friction=Coulomb(static=0.5, kinetic=0.5)))
    _, x, u, _ = drilling_point(plant, 8.0)
    seen = NonlinearMPC(reference=8.0, strength_process_noise=0.02).design(plant).filter
    seen.z = np.append(x, seen.rock(8.0)[0])
    for _ in range(400):
        seen.correct(seen.rows[:, :-1] @ x)
        seen.predict(u)
    assert seen.sliding
    # x' = A x + B u - E T s: exact over a period
    unit = np.append(np.ones(3), seen.rock(8.0)[0])
    F = seen.whole * unit / unit[:, None]
    H = seen.rows * np.append(np.ones(3), 0.0)
    expected = solve_discrete_are(F.T, H.T, seen.wander + seen.drive_process_noise**2 * seen.shaken, seen.noise)
    assert seen.doubt == pytest.approx(expected, rel=1e-3, abs=1e-3 * np.abs(expected).max())
    assert seen.strength == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("seed", [1, 2])
def test_at_low_speed_it_finds_a_heavier_rock_and_halves_the_errors_of_the_filter_that_does_not_know_its_law(seed):
    speed = 4.0
    _, x, _, _ = drilling_point(compose(wells.JANSEN_2, BitRock(weight=1.1 * WEIGHT)), speed)
    start = dict(zip(("chain.twist.0", "chain.speed.0", "chain.speed.1"), x, strict=True))
    law = NonlinearMPC(reference=speed, delay=0.03, **LIMITS).design(RIG)
    seen: list[tuple[bool, float, float, float]] = []

    def watched(t, y):
        command = law(t, y)
        bit = law.model.bit
        seen.append((law.filter.sliding, law.filter.strength, float(bit @ law.filter.xi[:-1]), float(bit @ law.filter.z[:-1])))
        return command

    watched.measured_signals, watched.actuated_signals = law.measured_signals, law.actuated_signals
    run = simulate(
        RIG,
        100.0,
        start=start,
        inputs={"bit.weight": 1.1 * WEIGHT},
        controller=Sampled(watched, 0.1, delay=0.03, noise={"top.speed": 0.01}, seed=seed),
    )
    sliding, strength, known, unknown = (np.array(values)[501:1000] for values in zip(*seen, strict=True))
    assert sliding.all()
    assert strength == pytest.approx(np.full(strength.size, 1.1), abs=0.03)
    true = run.at(np.arange(502, 1001) * 0.1)["bit.speed"]  # both are estimates of the next sample, which they predicted
    assert np.std(known - true) < 0.5 * np.std(unknown - true)


def test_it_gives_way_where_the_bit_comes_to_rest_or_the_rock_is_not_what_it_believes():
    law = NonlinearMPC(reference=6.0, **LIMITS).design(RIG)
    seen = law.filter
    _, x, u, _ = drilling_point(RIG, 6.0)
    seen.z = np.append(x, seen.rock(6.0)[0])
    for _ in range(30):
        seen.correct(x[1:2])
        seen.predict(u)
    assert seen.sliding
    believed = []
    for k in range(20):  # the top slows down as no rock of this law would let it
        seen.correct(x[1:2] - 0.3 * (k + 1))
        seen.predict(u)
        believed.append(seen.sliding)
    assert not all(believed)
    while seen.sliding or seen.z[2] > 0.0:  # and a string at rest
        seen.correct(np.zeros(1))
        seen.predict(0.0)
    assert not seen.sliding
