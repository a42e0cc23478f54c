"""Periodic inputs against the answer of an integrator and of a brake."""

import numpy as np
import pytest

from models import DiscBrake, TorsionalChain
from tests.refusals import each_of, refusals
from toolbox import SceneError, closed_loop, compose, simulate, sweep
from toolbox.inputs import noise, square, triangle
from toolbox.measuring import metrics


@pytest.mark.parametrize(("shape", "peak"), [(square, 0.25 * 0.4), (triangle, 0.125 * 0.4)])
def test_a_periodic_force_without_mean_moves_an_integrator_up_and_back_in_every_period(shape, peak):
    # speed of a free inertia of 1 kg m2 under +-0.4 N m of 2 Hz: half a period of a square gives 0.4 * 0.25, of a triangle half of that
    plant = compose(TorsionalChain(inertia=(1.0, 1.0), stiffness=(0.0,), damping=(0.0,)))
    run = simulate(plant, 5.0, inputs={"top.torque": shape(0.0, 0.4, 2.0, until=5.0)}, accuracy=1e-10)
    np.testing.assert_allclose(run.at(np.arange(0.0, 5.0, 0.5))["top.speed"], 0.0, atol=1e-9)
    np.testing.assert_allclose(run.at(np.arange(0.25, 5.0, 0.5))["top.speed"], peak, rtol=1e-9)


def test_a_square_pressure_of_a_brake_presses_with_its_two_values_only():
    run = simulate(compose(DiscBrake()), 0.5, start={"disc.speed": 5.0}, inputs={"brake.force": square(1000.0, 300.0, 40.0, until=0.5)})
    assert set(np.round(run["brake.force"], 9)) == {700.0, 1300.0}
    assert run.at(0.001)["brake.force"] == 1300.0


def force(seed, corner=0.1, duration=2000.0):
    """A noisy torque on a free inertia, sampled every 0.1 s."""
    plant = compose(TorsionalChain(inertia=(1.0, 1.0), stiffness=(0.0,), damping=(0.0,)))
    run = simulate(plant, duration, inputs={"top.torque": noise(3.0, 0.5, corner, seed=seed)})
    return run.at(np.arange(0.0, duration, 0.1))["top.torque"]


def test_a_noise_has_its_mean_its_deviation_and_the_spectrum_of_a_first_order_filter():
    values = force(1)
    assert values.mean() == pytest.approx(3.0, abs=0.02)
    assert values.std() == pytest.approx(0.5, rel=0.03)
    assert np.abs(values - 3.0).max() < 0.5 * np.sqrt(48.0)
    power = np.abs(np.fft.rfft((values - 3.0) * np.hanning(values.size))) ** 2
    frequencies = np.fft.rfftfreq(values.size, 0.1)
    assert power[frequencies > 0.505].sum() < 1e-6 * power.sum()
    for below in (0.05, 0.1, 0.2):
        assert power[frequencies < below].sum() / power.sum() == pytest.approx(np.arctan(below / 0.1) / np.arctan(5.0), abs=0.05)


def test_another_seed_is_another_realisation_and_the_same_seed_is_the_same():
    drawn = np.array([force(seed, duration=600.0) for seed in range(6)])
    apart = np.corrcoef(drawn) - np.eye(6)
    assert np.abs(apart).max() < 0.3
    np.testing.assert_array_equal(drawn[2], force(2, duration=600.0))


def test_deviation_and_corner_of_a_noise_are_swept_like_any_number_and_its_seed_is_that_of_a_loop():
    plant = compose(TorsionalChain(inertia=(1.0, 1.0), stiffness=(0.0,), damping=(0.0,)))
    loop = closed_loop(plant, inputs={"top.torque": noise(0.0, 0.5, 0.5, seed=3)})
    points = [{"top.torque.deviation": size, "top.torque.corner": corner} for size in (0.5, 1.0) for corner in (0.4, 0.5)]
    found = sweep(loop, points, 30.0, metrics={"peak": metrics.maximum("top.speed")})["peak"]
    np.testing.assert_allclose(found[2:], 2.0 * found[:2], rtol=1e-4)
    run = simulate(loop.at("top.torque.corner", 0.4), 30.0)
    assert found[0] == pytest.approx(run.at(np.linspace(0.0, 30.0, 30_001))["top.speed"].max(), rel=1e-5)
    other = simulate(loop.at("top.torque.seed", 4), 30.0)
    assert np.corrcoef(*(each.at(np.arange(0.0, 30.0, 0.1))["top.torque"] for each in (other, simulate(loop, 30.0))))[0, 1] < 0.5
    with pytest.raises(SceneError, match="another seed is another realisation"):
        sweep(loop, {"top.torque.seed": [1, 2]}, 30.0, metrics={"peak": metrics.maximum("top.speed")})


test_wrong_uses_are_refused_in_these_words = refusals(
    # waveforms refuse what is no wave
    *each_of(lambda given: square(*given), "", ((1.0, 1.0, 0.0, 1.0), (1.0, 1.0, 1.0, -1.0), (1.0, np.nan, 1.0, 1.0), (0.0, 1.0, 1e9, 1.0))),
    *[(lambda given=given: noise(*given), named) for given, named in [((1.0, 1.0, 0.0), "corner"), ((1.0, np.nan, 1.0), "of a noise"),
     ((1.0, -0.5, 1.0), "deviation"), ((1.0, 1.0, 1.0, 0.5), "seed"), ((1.0, 1.0, 1.0, -1), "seed")]],
)  # fmt: skip
