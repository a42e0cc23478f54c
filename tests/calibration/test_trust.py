"""What a fit says of its intervals, and of data that are none."""

import numpy as np
import pytest

from models import BlockOnBelt, Coulomb
from toolbox import compose, fit, simulate
from toolbox.calibration import Recording
from toolbox.calibration.trust import residual_of

SLIDER = compose(BlockOnBelt(mass=1.0, stiffness=0.0, belt_speed=0.0, friction=Coulomb(static=0.3, kinetic=0.3)))


@pytest.mark.parametrize("null", [-999.25, -999.0, -9999.0])
def test_null_values_of_logs_are_marked_and_left_out_in_whatever_unit(null, tmp_path):
    speed = np.linspace(1.0, 2.0, 20)
    speed[[6, 9]] = null
    given = {"time": np.arange(20.0), "block.speed": speed, "belt.force": -np.ones(20)}
    path = tmp_path / "log.csv"
    rows = "".join(f"{k},{100.0 * value if value > 0 else value!r},-1\n" for k, value in enumerate(speed.tolist()))
    path.write_text("time [s],block.speed [mm/s],belt.force [N]\n" + rows)
    for data in (given, path):
        recording = Recording.of(data, SLIDER)
        assert recording.found("block.speed") == {"null": 2}
        assert np.flatnonzero(np.isnan(recording.signals["block.speed"])).tolist() == [6, 9]
        found = fit(SLIDER, recording, "belt.friction.kinetic", contact="belt")
        assert "18 measured values" in found.data_description


def recorded(step):
    """A block pushed by 1 + sin 7 t, its speed and the push as a log with that sampling step would hold them."""
    dense = np.linspace(0.0, 12.0, 4801)
    truth = simulate(SLIDER, 12.0, inputs={"block.force": (dense, 1.0 + np.sin(7.0 * dense))}, output_times=dense, accuracy=1e-10)
    keep = slice(None, None, round(step / 0.0025))
    noise = 1e-3 * np.random.default_rng(4).standard_normal(dense[keep].size)
    return {"time": dense[keep], "block.speed": truth["block.speed"][keep] + noise, "block.force": 1.0 + np.sin(7.0 * dense[keep])}


def test_inputs_that_are_sampled_too_coarsely_for_the_intervals_are_told_with_what_they_cost():
    fine, coarse = (fit(SLIDER, recorded(step), "block.mass", starts=1) for step in (0.0025, 0.15))
    assert abs(fine.sampling_errors[0]) < fine.interval_factor * fine.standard_errors[0] and "less sure" not in str(fine)
    assert abs(coarse.sampling_errors[0]) > coarse.interval_factor * coarse.standard_errors[0]
    assert "`block.mass` is less sure than its interval says" in str(coarse)
    off = abs(coarse["block.mass"] - 1.0)
    assert off > coarse.interval_factor * coarse.standard_errors[0]  # it is right to say so,
    assert 0.3 * off < abs(coarse.sampling_errors[0]) < 3.0 * off  # and by how much


def test_residuals_that_repeat_themselves_say_how_many_times_too_narrow_intervals_are():
    random = np.random.default_rng(5)
    white = random.standard_normal(20_000)
    left = white.copy()
    for k in range(1, left.size):
        left[k] += 0.8 * left[k - 1]
    found = residual_of("bit.speed", "rad/s", left, 10.0 * white)
    assert found.stretch == pytest.approx(3.0, rel=0.05)  # sqrt(1.8 / 0.2)
    assert f"rms {found.rms * 30 / np.pi:.4g} rpm" in found.lines({"rad/s": "rpm"})[0]
    assert "about 3 times as wide" in found.lines()[1] and "leave samples out" in found.lines()[1]
    assert residual_of("bit.speed", "rad/s", white, white).lines()[0].endswith(")")
