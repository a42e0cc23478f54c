"""Frequency responses and charts over two gains against the transfer functions and poles that python-control gives."""

import numpy as np
import pytest

from controllers import PI, SoftTorque
from models import BitRock, wells
from toolbox import Sampled, SceneError, closed_loop, compose, equilibrium, linearise
from toolbox.robustness import StabilityChart, frequency_response, stability_chart
from toolbox.steady_states import pole_locus

RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
PI_LOOP = closed_loop(RIG, PI(proportional=1000.0, integral=500.0, reference="38 rpm"))


def test_the_response_is_that_of_the_drive_times_that_of_the_string():
    found = frequency_response(PI_LOOP, np.geomspace(0.05, 20.0, 40))
    s = 1j * found.omega
    string = linearise(RIG, equilibrium(PI_LOOP), inputs="top.torque", outputs="top.speed")(s)
    assert found.values["top.torque"] == pytest.approx((1000.0 + 500.0 / s) * string, rel=1e-9)


def test_the_nearest_point_of_the_response_gives_the_disk_margin():
    found = frequency_response(closed_loop(RIG, SoftTorque(reference="90 rpm")))
    value = found.values["top.torque"]
    assert 2.0 / np.abs((1 - value) / (1 + value)).max() == pytest.approx(found.margins.disk_margin, rel=1e-4)


def test_a_sampled_law_ends_at_half_its_sampling_frequency():
    late = closed_loop(RIG, Sampled(PI(proportional=1000.0, integral=500.0, reference="38 rpm"), "50 ms", delay="20 ms"))
    assert frequency_response(late).omega[-1] == pytest.approx(np.pi / 0.05)
    with pytest.raises(SceneError, match="half the sampling frequency, 62.83 rad/s"):
        frequency_response(late, (1.0, 100.0))
    with pytest.raises(SceneError, match="increasing"):
        frequency_response(late, (2.0, 1.0))


def test_the_pictures_show_the_margins(tmp_path):
    found = frequency_response(closed_loop(RIG, SoftTorque(reference="90 rpm")))
    _, phases = found.bode()
    shown = [text.get_text() for text in phases.texts]
    assert f" {np.degrees(found.margins['top.torque'].phase_margin):.3g}°" in shown
    disk = found.nyquist().patches[0]
    low, high = found.margins["top.torque"].disk_gains
    assert disk.radius == pytest.approx((high - low) / 2)
    assert found.nichols().lines[0].get_ydata() == pytest.approx(np.abs(found.values["top.torque"]))
    assert np.loadtxt(found.to_csv(tmp_path / "response.csv"), delimiter=",", skiprows=1)[:, 1] == pytest.approx(
        np.abs(found.values["top.torque"])
    )


def test_the_chart_has_the_growth_of_the_poles_and_no_margin_where_they_grow():
    chart = stability_chart(PI_LOOP, {"pi.proportional": (100.0, 3000.0), "pi.integral": (50.0, 1500.0)}, shape=(4, 3))
    for i, value in enumerate(chart.axes[0]):
        poles = pole_locus(PI_LOOP.at("pi.proportional", value), "pi.integral", chart.axes[1])
        assert chart.growth_rate[i] == pytest.approx(poles.real.max(axis=1), rel=1e-6, abs=1e-9)
    assert (chart.growth_rate > 0).any() and ((chart.growth_rate < 0) == (chart.disk_margin > 0)).all()
    ax = chart.plot()
    assert any(line.get_marker() == "o" and line.get_xydata().tolist() == [[1000.0, 500.0]] for line in ax.lines)


def test_a_chart_that_is_stable_all_over_is_shaded_no_further_than_it_was_looked_at():
    over = {"pi.proportional": (1500.0, 2500.0), "pi.integral": (300.0, 450.0)}
    chart = stability_chart(PI_LOOP, over, shape=(3, 3))
    assert (chart.growth_rate < 0).all()
    ax = chart.plot()
    shaded = ax.collections[0].get_datalim(ax.transData)
    assert (shaded.x0, shaded.x1, shaded.y0, shaded.y1) == (1500.0, 2500.0, 300.0, 450.0)
    assert ax.get_facecolor() == (1.0, 1.0, 1.0, 1.0) and ax.get_xlim()[0] == 1000.0  # the declared point is shown, beside it


def test_without_an_integral_part_there_is_no_steady_running_to_judge():
    chart = stability_chart(PI_LOOP, {"pi.proportional": (500.0, 1500.0), "pi.integral": (0.0, 1000.0)}, shape=(3, 3))
    assert np.isnan(chart.growth_rate[:, 0]).all() and np.isfinite(chart.growth_rate[:, 1:]).all()
    assert "not known at 3" in str(chart)


def test_charts_over_what_is_no_pair_of_ranges_are_refused():
    for over, words in (({"pi.integral": (1, 2)}, "two numbers"), ({"pi.integral": (2, 1), "pi.proportional": (1, 2)}, "from 2 to 1")):
        with pytest.raises(SceneError, match=words):
            stability_chart(PI_LOOP, over)
    with pytest.raises(SceneError, match="`shape`"):
        stability_chart(PI_LOOP, {"pi.integral": (1, 2), "pi.proportional": (1, 2)}, shape=(2, 5))


def test_lines_of_the_chart_follow_what_is_smooth_between_its_points():
    # growth r^2 - 1 and margin 1 - r^2 of seven points a side: straight pieces would be 2 % off the circles, and no line of the margin close to the border
    side = np.linspace(-1.3, 1.3, 7)
    squared = side[:, None] ** 2 + side**2
    squared[0] = np.nan  # not known
    units = ("1", "1")
    chart = StabilityChart(("a", "b"), units, (side, side), squared - 1.0, np.maximum(1.0 - squared, 0.0) + 0.0 * squared, (0.0, 0.0))
    ax = chart.plot()
    lines = [each for each in ax.collections if not each.filled]
    radii = {0.0: [], **{level: [] for level in (0.1, 0.2, 0.4, 0.6, 0.8)}}
    for each in lines:
        for level, path in zip(each.levels, each.get_paths(), strict=True):
            radii[level] = np.hypot(*path.vertices.T)
    for level, radius in radii.items():
        assert len(radius) > 40 and radius == pytest.approx(np.full(len(radius), np.sqrt(1.0 - level)), abs=2e-3), level


def test_the_response_plots_itself_as_a_bode_diagram():
    found = frequency_response(PI_LOOP, np.geomspace(0.05, 20.0, 40))
    assert all(
        one.lines[0].get_xydata().tolist() == other.lines[0].get_xydata().tolist()
        for one, other in zip(found.plot(), found.bode(), strict=True)
    )
