"""Bristles against the closed forms of quasi-static partial slip: backbone, Masing's rule, dissipated energy, convergence."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from models import BristleContact, Coulomb, PlateContact, Slider, parabolic_shares
from studies.questions import sliders as study
from toolbox import SceneError, compose, energy_audit, simulate
from toolbox.inputs import ramp, sine

N, MU, K = 10.0, 0.35, 1e6


def drawn(bristles, distance, duration=1.0, **options):
    """The plate is drawn evenly by a distance [m] under a slider at rest: the drag is F(distance)."""
    plant = compose(BristleContact(bristles))
    return simulate(plant, duration, inputs={"plate.speed": distance / duration}, accuracy=1e-10, **options)


@pytest.mark.parametrize("bristles", [1, 5, 16])
def test_loading_follows_the_sum_of_springs_that_have_not_slipped_yet(bristles):
    run = drawn(bristles, 1e-5)
    shares = np.array(parabolic_shares(bristles))
    for t in np.linspace(0.05, 1.0, 12):
        expected = np.minimum(K / bristles * 1e-5 * t, MU * N * shares).sum()
        assert run.at(t)["plate.drag"] == pytest.approx(expected, rel=1e-9)


def test_shares_of_a_rounded_contact_add_up_to_one_and_are_those_of_the_parabola():
    for n in (1, 2, 7, 64):
        shares = np.array(parabolic_shares(n))
        assert shares.sum() == pytest.approx(1.0, rel=1e-14)
        np.testing.assert_allclose(shares, shares[::-1], rtol=1e-12)
    middle = (2 * np.arange(1000) + 1) / 1000 - 1
    np.testing.assert_allclose(parabolic_shares(1000), 1.5 * (1 - middle**2) / 1000, rtol=1e-3, atol=1e-9)


def test_more_bristles_converge_with_second_order_to_partial_slip_of_a_rounded_contact():
    # stuck half-width a = sqrt(1 - q), q = 2 k x / (3 mu N):  F = k x a + mu N [1 - (3 a - a^3) / 2]
    full = 1.5 * MU * N / K
    a = math.sqrt(0.4)
    assert study.partial_slip(0.6 * full, K, MU * N) == pytest.approx(K * 0.6 * full * a + MU * N * (1 - (3 * a - a**3) / 2))
    assert study.partial_slip(2 * full, K, MU * N) == pytest.approx(MU * N)
    errors = [study.bristle_error(n) for n in (8, 16, 32, 64)]
    assert errors[-1] < 1e-3
    for coarse, fine in itertools.pairwise(errors):
        assert coarse / fine == pytest.approx(4.0, rel=0.3)


@pytest.mark.parametrize("bristles", [1, 8, 9])
def test_reversals_follow_the_rule_of_masing(bristles):
    # unloading from x_a: F(x) = f(x_a) - 2 f((x_a - x) / 2), reloading alike, with f the backbone
    swing = 6e-6
    shares = np.array(parabolic_shares(bristles))

    def backbone(x):
        return np.minimum(K / bristles * x, MU * N * shares).sum()

    plant = compose(BristleContact(bristles))
    # x goes 0, a, -a, a in a second each
    speed = ((0.0, 1.0, 1.0, 2.0, 2.0, 3.0), (swing, swing, -2 * swing, -2 * swing, 2 * swing, 2 * swing))
    run = simulate(plant, 3.0, inputs={"plate.speed": speed}, accuracy=1e-10)
    top = backbone(swing)
    for s in np.linspace(0.03, 1.0, 9):
        assert run.at(1.0 + s)["plate.drag"] == pytest.approx(top - 2 * backbone(swing * s), abs=1e-8)
        assert run.at(2.0 + s)["plate.drag"] == pytest.approx(-top + 2 * backbone(swing * s), abs=1e-8)


def test_a_closed_loop_costs_the_energy_that_it_encloses_and_the_audit_knows_it():
    swing = 6e-6
    plant = compose(BristleContact(8))
    run = simulate(plant, 4.0, inputs={"plate.speed": sine(0.0, swing * 2 * math.pi, 1.0, math.pi / 2)}, accuracy=1e-10)
    audit = energy_audit(run)
    assert abs(audit.residual) < 1e-9 * audit.turnover
    times = np.linspace(1.0, 2.0, 200_001)
    drag, speed = run.at(times)["plate.drag"], run.at(times)["plate.speed"]
    area = np.trapezoid(drag * speed, times)
    # the loop by Masing: 4 (2 times the energy under the backbone, less the secant)
    shares = np.array(parabolic_shares(8))
    x = np.linspace(0, swing, 100_001)
    backbone = np.minimum(K / 8 * x[:, None], MU * N * shares).sum(axis=1)
    assert area == pytest.approx(8 * (np.trapezoid(backbone, x) - backbone[-1] * swing / 2), rel=1e-6)


def test_bristles_without_a_slider_book_what_drives_them():
    run = simulate(compose(BristleContact(4)), 2.0, inputs={"slider.speed": sine(0.0, 1e-4, 1.0), "plate.speed": 2e-5}, accuracy=1e-9)
    audit = energy_audit(run)
    assert audit.turnover > 1e-6
    assert abs(audit.residual) < 1e-8 * audit.turnover


def test_the_edge_slips_first_and_the_middle_last():
    run = drawn(9, 1e-5)
    first = {event.element: event.time for event in run.events if event.after == "slip"}
    order = [first[f"plate.{i}"] for i in range(9)]
    assert order == order[::-1]
    assert np.all(np.diff(order[:5]) > 0)
    stuck = run["plate.stuck"]
    assert stuck[0] == 1.0 and stuck[-1] == 0.0 and np.all(np.diff(stuck) <= 0)


def test_a_bristle_that_touches_its_bound_exactly_at_a_reversal_goes_on():
    # the middle ones slip in the first half stroke and touch their bound again at every second reversal
    plant = compose(BristleContact(8))
    run = simulate(plant, 6.0, inputs={"plate.speed": sine(0.0, -5e-6 * 2 * math.pi, 1.0)}, accuracy=1e-9)
    assert np.abs(run["plate.stretch"]).max() <= MU * N * max(parabolic_shares(8)) * 8 / K * (1 + 1e-9)
    peaks = run.at(np.arange(0.5, 6.0, 1.0))["plate.drag"]
    np.testing.assert_allclose(peaks, peaks[0], rtol=1e-8)


def test_a_stiff_bristle_is_a_dry_contact():
    spring = Slider(mass=1.0, stiffness=1e4, damping=20.0)
    drive = {"inputs": {"slider.pull": sine(0.0, 6.0, 10.0)}, "accuracy": 1e-9}
    rigid = simulate(compose(spring, PlateContact(friction=Coulomb(static=MU, kinetic=MU))), 1.0, **drive)
    times = np.linspace(0, 1, 300)
    size = np.abs(rigid["slider.position"]).max()
    assert rigid.time_in("plate", "stick") > 0.05 and size > 1e-4
    errors = []
    for stiffness in (1e7, 1e8):
        run = simulate(compose(spring, BristleContact(1, stiffness=stiffness)), 1.0, **drive)
        errors.append(np.abs(run.at(times)["slider.position"] - rigid.at(times)["slider.position"]).max() / size)
    assert errors[1] < 1e-3 and errors[0] / errors[1] == pytest.approx(10.0, rel=0.3)


def test_before_it_slips_the_slider_swings_on_the_stiffness_of_its_bristles():
    plant = compose(Slider(mass=1.0, stiffness=0.0, damping=0.0), BristleContact(4))
    run = simulate(plant, 0.05, start={"slider.speed": 1e-4}, accuracy=1e-10)
    assert run.events == []
    times = np.linspace(0, 0.05, 50)
    np.testing.assert_allclose(run.at(times)["slider.position"], 1e-4 / 1e3 * np.sin(1e3 * times), atol=1e-14)


def test_energy_closes_with_a_load_that_varies():
    plant = compose(Slider(mass=1.0, stiffness=1e4, damping=20.0), BristleContact(6))
    run = simulate(plant, 1.0, inputs={"slider.pull": sine(0.0, 3.0, 5.0), "plate.load": sine(10.0, 5.0, 11.0)}, accuracy=1e-9)
    bound = MU * run["plate.load"][:, None] * np.array(parabolic_shares(6)) * 6 / K
    assert np.all(np.abs(run["plate.stretch"]) <= bound * (1 + 1e-6))
    assert len(run.events) > 50
    audit = energy_audit(run)
    assert abs(audit.residual) < 1e-7 * audit.turnover


@pytest.mark.parametrize("bristles", [0, -3, 2.0, True])
def test_a_row_without_bristles_is_refused(bristles):
    with pytest.raises(SceneError, match="`n` must"):
        parabolic_shares(bristles)


@pytest.mark.parametrize(
    ("change", "word"),
    [({"n": 2, "shares": (0.5, 0.4)}, "add up"), ({"n": 2, "shares": (1.2, -0.2)}, "shares"), ({"shares": (0.5, 0.5)}, "16 entries"),],
)  # fmt: skip
def test_bristles_that_cannot_be_built_are_refused_by_name(change, word):
    with pytest.raises(SceneError, match=word):
        compose(BristleContact(**change))


def test_a_ramp_of_the_plate_drags_the_slider_by_its_bristles_until_all_slip():
    plant = compose(Slider(mass=1.0, stiffness=1e4, damping=500.0), BristleContact())
    run = simulate(plant, 1.0, inputs={"plate.speed": ramp(0.0, 0.01, 0.0, 0.05)}, accuracy=1e-9)
    assert run.at(1.0)["plate.drag"] == pytest.approx(MU * N, rel=1e-9)
    assert run.at(1.0)["slider.position"] == pytest.approx(MU * N / 1e4, rel=1e-6)


def test_a_bristle_that_starts_far_beyond_its_bound_falls_to_it_and_stays():
    """A stretch of a million times the bound decays at 2e4 per second until it is the bound, and is held there by a steady pull."""
    contact = BristleContact(n=1, stiffness=1e6, load=10.0, friction=0.35)
    bound = 0.35 * 10.0 / 1e6
    run = simulate(compose(Slider(), contact), 0.01, start={"plate.stretch": [1e6 * bound]}, inputs={"slider.pull": 0.0}, accuracy=1e-8)
    after = next(event.time for event in run.events if event.before == "beyond")
    assert 0 < after < 0.01
    assert abs(run.at(after)["plate.stretch"][0]) == pytest.approx(bound, rel=1e-9)
    assert np.abs(run.at(np.linspace(after, 0.01, 50))["plate.stretch"]).max() <= bound * (1 + 1e-9)
    assert run.error_estimate < 1e-6
