"""The study of onset: one number for every claim, each by a way that does not know the other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from studies.questions import onset as study
from toolbox import simulate

STIFF, SOFT, SLIDING, _, SOFT_10, _ = study.DRIVES


def test_the_hopf_speed_of_a_sampled_drive_is_that_of_its_transition_matrix():
    # steady drilling is linear about its equilibrium: rock torque falls by W R (mu_s - mu_c) gamma exp(-gamma w) per rad/s
    top, bit, k, c, drag, own = 2122.0, 374.0, 473.0, 23.2, 425.0, 50.0
    h, law = SOFT_10.sample_time, SOFT_10.law.design(study.RIG)
    p, i = law.proportional, law.integral

    def growth(speed):
        rock = -97_347.0 * 0.155575 * 0.3 * 0.9 * np.exp(-0.9 * speed)
        plant = np.array([[0.0, 1.0, -1.0], [-k / top, -(c + drag) / top, c / top], [k / bit, c / bit, -(c + own + rock) / bit]])
        whole = np.zeros((4, 4))
        whole[:3, :3], whole[1, 3] = plant, 1 / top
        step = expm(h * whole)
        phi, gamma = step[:3, :3], step[:3, 3:]
        loop = np.block([[phi - gamma @ [[0.0, p, 0.0]], i * gamma], [np.array([[0.0, -h, 0.0]]), np.ones((1, 1))]])
        return np.abs(np.linalg.eigvals(loop)).max() - 1.0

    theory = brentq(growth, 3.0, 5.0, xtol=1e-12)
    assert study.hopf(SOFT_10) == pytest.approx(theory, rel=1e-7)
    assert theory > 1.05 * 3.677134  # 10 Hz makes soft torque lose smooth drilling earlier than its continuous form does


def test_sampled_drilling_grows_below_its_hopf_speed_and_dies_above():
    branch, speed = study.steady(SOFT_10), study.hopf(SOFT_10)
    for side in (-1.0, 1.0):
        value, point = min(
            ((v, c) for v, c in zip(branch.values, branch.cycles, strict=True) if side * (v - speed) > 0.2),
            key=lambda pair: abs(pair[0] - speed),
        )
        start = {"chain.twist": point.start[:1], "chain.speed": point.start[1:3] * (1.0, 1.001), "softtorque.angle": float(point.memory[0])}
        run = simulate(SOFT_10.at(value), 60.0, start=start, accuracy=1e-9)
        away = np.abs(run["bit.speed"] - value)
        grows = away[run.time > 50.0].max() > 3 * away[run.time < 10.0].max()
        dies = away[run.time > 50.0].max() < away[run.time < 10.0].max() / 3
        assert point.stable == (side > 0) == dies != grows


@pytest.mark.slow
def test_sliding_mode_loses_stick_slip_in_a_fold_and_soft_torque_by_period_doubling():
    fold, corner, hopf = study.cycles(SLIDING).bifurcations
    assert [fold.kind, corner.kind, hopf.kind] == ["fold", "grazing-sliding", "Hopf"]
    assert hopf.value == pytest.approx(3.7296557, abs=1e-5)  # the Hopf point of the linearised loop, which the branch comes back to
    kind, value = study.lost(study.cycles(SOFT, 50))
    assert kind == "period doubling"
    for drive, border in ((SLIDING, fold.value), (SOFT, value)):
        inside = study.swept(drive, [border - 0.3, border - 0.05], {"chain.speed": (border, 0.0)})
        beyond = study.swept(drive, [border - 0.3, border + 0.05], {"chain.speed": (border, 0.0)}, length=500.0)
        assert abs(inside[-1, 0]) < 1e-9  # it still sticks
        assert np.ptp(beyond[-1]) < 0.5  # and here it has come free


def test_a_branch_round_a_corner_keeps_to_cycles_that_do_not_stick():
    branch = study.cycles(SOFT, 50)
    place = next(i for i, cycle in enumerate(branch.cycles) if not cycle.run.events)
    assert all(not cycle.run.events for cycle in branch.cycles[place:])
    assert [point.kind for point in branch.bifurcations].count("grazing-sliding") == 1
    assert not branch.stable[place:].any()


def test_a_kick_beyond_the_unstable_cycle_ends_in_stick_slip_and_one_inside_it_in_steady_drilling():
    branch = study.cycles(SLIDING)
    cycle = next(c for c, v in zip(branch.cycles, branch.values, strict=True) if not c.stable and not c.run.events and v < 6.0)
    value = next(v for c, v in zip(branch.cycles, branch.values, strict=True) if c is cycle)
    rest = simulate(SLIDING.at(value), 300.0, start={"chain.speed": (value, value), "chain.twist": 16.0}).last
    name = "slidingmode.angle"
    for factor, sticks in ((0.97, False), (1.03, True)):
        start = {
            "chain.twist": rest["chain.twist"] + factor * (cycle.start[:1] - rest["chain.twist"]),
            "chain.speed": rest["chain.speed"] + factor * (cycle.start[1:3] - rest["chain.speed"]),
            name: rest[name] + factor * (cycle.start[3] - rest[name]),
        }
        run = simulate(SLIDING.at(value), 300.0, start=start, accuracy=1e-8)
        assert (run.time_in("bit", "stick", after=250.0) > 0.0) == sticks
