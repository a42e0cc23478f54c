"""Sliders against the closed forms of the two papers that they come from."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from models import Coulomb, InclinedSlider, PlateContact, Slider
from studies.questions import sliders as study
from toolbox import compose, energy_audit, simulate
from toolbox.inputs import sine


def test_the_slider_adheres_until_spring_damper_and_inertia_need_the_static_bound():
    # while it adheres v = a t: k a t^2 / 2 + c a t + m a = mu_s N
    a = 0.01 / 4.0
    run = study.adhesion_run()
    release = run.events[0]
    assert (release.element, release.before, release.after) == ("plate", "stick", "slip-")
    expected = (-5000 + math.sqrt(5000**2 + 2 * 1e4 * (3.5 - 7.8e-3 * a) / a)) / 1e4
    assert release.time == pytest.approx(expected, rel=1e-9)
    assert study.adhesion_time(Slider(), PlateContact(), a) == pytest.approx(expected, rel=1e-12)
    assert run.at(release.time)["plate.speed"] == pytest.approx(a * expected, rel=1e-9)


def test_adhesion_ends_where_the_paper_says_within_its_unknown_area():
    run = study.adhesion_run()
    assert run.events[0].time == pytest.approx(0.225, rel=0.02)
    assert 1e3 * run.at(run.events[0].time)["plate.speed"] == pytest.approx(0.5625, rel=0.02)


def test_after_adhesion_the_stiff_damper_lets_the_slider_creep_without_sticking_again():
    run = study.adhesion_run()
    assert len(run.events) == 1
    # quasi-static: c x' + k x = N mu(v_plate - x'), an independent first-order problem with an error of m / c = 1.6e-6 s
    release = run.events[0].time

    def creep(t, x):
        rate = 0.0
        for _ in range(50):
            rate = (10.0 * (0.25 + 0.1 * math.exp(-(2.5e-3 * t - rate))) - 1e4 * x[0]) / 5000.0
        return [rate]

    start = run.at(release)["slider.position"]
    reference = solve_ivp(creep, (release, run.end), [start], rtol=1e-10, atol=1e-14)
    assert run.at(run.end)["slider.position"] == pytest.approx(reference.y[0, -1], rel=1e-5)


def test_the_energy_of_the_dragged_slider_closes():
    audit = energy_audit(study.adhesion_run())
    assert abs(audit.residual) < 1e-9 * audit.turnover


def test_on_a_fixed_plate_a_pull_below_the_static_bound_moves_nothing():
    for amplitude, moves in ((3.49, False), (3.6, True)):
        run = simulate(compose(Slider(), PlateContact()), 0.4, inputs={"slider.pull": sine(0.0, amplitude, 5.0)})
        assert bool(run.events) is moves
        assert (run.time_in("plate", "stick") < 0.4) is moves


def test_an_alternating_pull_drags_the_slider_both_ways():
    run = simulate(compose(Slider(), PlateContact()), 0.4, inputs={"slider.pull": sine(0.0, 8.0, 5.0)}, accuracy=1e-8)
    assert {"stick", "slip+", "slip-"} == set(run.modes["plate"])
    audit = energy_audit(run)
    assert abs(audit.residual) < 1e-7 * audit.turnover


@pytest.mark.parametrize("mu", [0.2, 0.35, 0.6])
def test_a_slider_on_an_incline_moves_if_and_only_if_the_slope_exceeds_the_friction(mu):
    limit = math.atan(mu)
    friction = Coulomb(static=mu, kinetic=mu)
    for angle, moves in ((limit * (1 - 1e-6), False), (limit * (1 + 1e-6), True)):
        run = simulate(compose(InclinedSlider(angle=angle, friction=friction)), 1.0)
        assert (run.time_in("slope", "stick") < 1.0) is moves
    assert math.degrees(math.atan(0.35)) == pytest.approx(19.29, abs=0.005)
    assert study.critical_angle(mu) == pytest.approx(limit, rel=1e-6)


def test_the_inclined_slider_follows_its_linear_motion_down_the_slope():
    run = simulate(compose(InclinedSlider()), 12.0, accuracy=1e-10)
    cos = math.cos(math.pi / 4)
    mass, push = 10 * cos / 9.8, 10 * cos * (1 - 0.35)
    assert mass == pytest.approx(0.7215, rel=1e-3)
    fast, slow = np.roots([mass, 1000.0, 1000.0])
    for t in (0.001, 0.1, 3.0):
        # y = y_s [1 - (slow exp(fast t) - fast exp(slow t)) / (slow - fast)]
        expected = push / 1000.0 * (1 - (slow * math.exp(fast * t) - fast * math.exp(slow * t)) / (slow - fast))
        assert run.at(t)["slider.position"] == pytest.approx(expected, rel=1e-7)
    audit = energy_audit(run)
    assert abs(audit.residual) < 1e-9 * audit.turnover


def test_a_slider_without_a_plate_is_an_oscillator():
    run = simulate(compose(Slider(mass=1.0, stiffness=100.0, damping=0.0)), 1.0, start={"slider.position": 0.1}, accuracy=1e-10)
    assert run.at(1.0)["slider.position"] == pytest.approx(0.1 * math.cos(10.0), rel=1e-8)
