"""Figures: what they show is checked on the artists, not on pixels."""

from __future__ import annotations

import io
import math

import casadi as ca
import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex, to_rgb

from controllers import PI, IdealSlidingMode
from models import BitRock, BlockOnBelt, Coulomb, TopDrive, TorsionalChain, wells
from tests.plants import BELT, RIG
from toolbox import DryFriction, SceneError, Trajectory, UnilateralContact, compose, simulate
from toolbox.figures.curves import draw_line
from toolbox.figures.style import LINES, MANY_EVENTS, RESOLUTION, TONES
from toolbox.measuring.measure import extent, stick_intervals
from toolbox.modelling import Hysteresis, OneWayClutch
from toolbox.simulation.plot import comparison, phase_plane, traces


@pytest.fixture(scope="module")
def belt_run():
    return simulate(compose(BlockOnBelt()), 60.0)


@pytest.fixture(scope="module")
def rig_run():
    return simulate(compose(wells.JANSEN_2, BitRock()), 60.0, inputs={"top.torque": 10_000.0})


def curves(ax):
    """The lines of a panel by label."""
    return {line.get_label(): line.get_xydata() for line in ax.get_lines()}


def luminance(color):
    return float(np.dot(to_rgb(color), [0.299, 0.587, 0.114]))


def hairlines(ax):
    return [c for c in ax.collections if isinstance(c, LineCollection)]


def test_traces_give_every_unit_a_panel_and_every_axis_a_unit(rig_run):
    axes = traces(rig_run)
    assert [ax.get_ylabel() for ax in axes] == ["speed [rad/s]", "torque [kN m]"]
    assert [ax.get_xlabel() for ax in axes] == ["", "time [s]"]
    assert list(curves(axes[0])) == ["top speed", "bit speed"]
    assert "top torque" in curves(axes[1]) and "bit torque" in curves(axes[1])
    assert axes[0].get_xlim() == (0.0, 60.0)
    axes[0].figure.canvas.draw()


def test_one_signal_in_a_panel_is_named_by_its_axis(belt_run):
    axes = traces(belt_run)
    assert [ax.get_ylabel() for ax in axes] == ["block speed [m/s]", "belt force [N]", "block position [m]"]
    assert all(ax.get_legend() is None for ax in axes)


def test_curves_reach_the_peaks_that_the_nodes_miss(rig_run):
    (ax,) = traces(rig_run, "bit.speed", after=20.0, until=40.0)
    drawn = curves(ax)["bit speed"]
    whole = extent(rig_run, "bit.speed", 20.0, 40.0)
    node = rig_run["bit.speed"][(rig_run.time >= 20.0) & (rig_run.time <= 40.0)].max()
    half = 0.5 * 20.0 / RESOLUTION  # a point is drawn so near the peak, wherever the steps end
    beside = min(rig_run.at(whole.time_of_maximum + away)["bit.speed"] for away in (-half, half))
    assert beside <= drawn[:, 1].max() <= whole.maximum
    assert node < beside
    assert drawn[0, 0] == 20.0 and drawn[-1, 0] == 40.0
    assert drawn[-1, 1] == rig_run.at(40.0)["bit.speed"]


def test_a_jump_of_the_friction_force_is_drawn_upright(belt_run):
    (ax,) = traces(belt_run, "belt.force")
    drawn = curves(ax)["belt force"]
    caught = stick_intervals(belt_run, "belt", after=6.0)[0][0]
    there = drawn[drawn[:, 0] == caught, 1]
    assert there.max() == pytest.approx(1.0, abs=1e-5) and there.min() == pytest.approx(belt_run.at(caught)["block.position"])


def test_a_sampled_input_is_drawn_as_steps():
    run = simulate(RIG, 2.0, controller=lambda t, y: 1000.0 * (1 + round(2 * t)), sample_time=0.5)
    (ax,) = traces(run, "top.torque")
    drawn = curves(ax)["top torque"]
    assert set(np.unique(drawn[:, 1])) == {1000.0, 2000.0, 3000.0, 4000.0}
    assert set(drawn[np.isclose(drawn[:, 0], 1.0), 1]) == {2000.0, 3000.0}


def test_the_ribbon_shows_the_modes_that_occur_and_their_legend(belt_run, rig_run):
    for run, present in ((belt_run, ["stick", "slip-"]), (rig_run, ["stick", "slip+"])):
        ax = traces(run)[0]
        legends = [a for a in ax.get_children() if type(a).__name__ == "Legend"]
        words = [text.get_text() for legend in legends for text in legend.get_texts()]
        assert [word for word in words if word in TONES] == present
        name = next(iter(run.modes))
        assert name in [text.get_text() for text in ax.texts]
        bars = [c for c in ax.collections if len(c.get_paths()) == sum(word == present[0] for *_, word in run.intervals(name))]
        assert bars


def test_tones_and_lines_differ_without_colour():
    shades = [luminance(TONES[mode]["facecolor"]) for mode in ("stick", "slip-", "slip+")]
    assert np.diff(shades).min() > 0.15
    strokes = {(str(style["linestyle"]), round(luminance(style["color"]), 1)) for style in LINES}
    assert len(strokes) == len(LINES)


def test_many_events_do_not_blacken_the_picture(belt_run):
    def ink(run):
        return [c.get_alpha() for c in hairlines(traces(run, "block.speed")[0])]

    # of one contact the edges of its bands are its events; of several each has dots of its own
    assert ink(belt_run) == []
    plant = compose(BlockOnBelt(), BlockOnBelt(name="other", belt_speed=0.1))
    few, many, thousands = (simulate(plant, duration) for duration in (60.0, 1500.0, 8000.0))
    counts = [min(sum(event.element == name for event in run.events) for name in run.modes) for run in (few, many, thousands)]
    assert counts[0] < MANY_EVENTS < counts[1] < 10 * MANY_EVENTS < counts[2]
    assert ink(few)[0] > 2 * ink(many)[0] and len(ink(few)) == 2
    assert len({str(c.get_linestyle()) for c in hairlines(traces(few, "block.speed")[0])}) == 2
    assert ink(thousands) == []
    assert traces(thousands, "block.speed")[0].get_lines()[0].get_linewidth() < 0.5


def test_very_long_curves_are_thinned_but_keep_their_extremes():
    run = simulate(compose(BlockOnBelt()), 20_000.0)
    (ax,) = traces(run, "block.position")
    drawn = curves(ax)["block position"]
    assert drawn.shape[0] < 8000
    found = extent(run, "block.position", after=100.0)
    assert drawn[:, 1].max() == pytest.approx(found.maximum, abs=2e-3)
    assert drawn[:, 1].min() == pytest.approx(found.minimum, abs=2e-3)


def test_by_default_the_inside_of_a_control_law_is_not_shown():
    run = simulate(RIG, 5.0, controller=IdealSlidingMode())
    axes = traces(run)
    assert [ax.get_ylabel() for ax in axes] == ["speed [rad/s]", "torque [kN m]"]
    shown = [name for ax in axes for name in curves(ax)]
    assert not any(name.startswith("idealslidingmode") for name in shown) and "top torque" in shown
    rows = {text.get_text() for text in axes[0].texts}
    assert {"bit", "idealslidingmode"} <= rows  # but its mode is


def test_vector_signals_are_drawn_entry_by_entry():
    n = 10
    chain = TorsionalChain((100.0,) * n, (4000.0,) * (n - 1), (5.0,) * (n - 1), friction=Coulomb(), friction_load=(300.0,) * n)
    run = simulate(compose(chain), 3.0, inputs={"top.torque": 2000.0})
    axes = traces(run, "chain.speed")
    assert len(axes[0].get_lines()) == n
    assert [text.get_text() for text in axes[0].get_legend().get_texts()] == ["chain speed 0", "chain speed 9"]
    assert {f"chain {i}" for i in range(n)} <= {text.get_text() for text in axes[0].texts}
    assert list(curves(traces(run, "chain.speed.3")[0])) == ["chain speed 3"]
    axes[0].figure.canvas.draw()


def test_the_sticking_segment_of_a_phase_plane_is_thick_and_lies_at_the_speed_of_the_belt(belt_run):
    ax = phase_plane(belt_run, "block.position", "block.speed", "belt")
    thin, thick = sorted(hairlines(ax), key=lambda c: c.get_linewidths()[0])
    assert thick.get_linewidths()[0] > 3 * thin.get_linewidths()[0]
    points = np.concatenate(thick.get_segments())
    assert (points[:, 1] == 0.2).all()
    assert points[:, 0].max() == pytest.approx(1.0, abs=1e-6)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("block position [m]", "block speed [m/s]")
    ax.figure.canvas.draw()


def test_a_phase_plane_has_no_more_points_than_a_page_shows(belt_run):
    (thin, *_), points = hairlines(phase_plane(belt_run, "block.position", "block.speed")), curves(traces(belt_run, "block.speed")[0])
    stretches = thin.get_segments()
    drawn = np.concatenate(stretches)
    assert len(stretches) < 40 < len(drawn) <= len(points["block speed"])
    steps = [np.abs(np.diff(stretch, axis=0) / np.ptp(drawn, axis=0)).max() for stretch in stretches]
    assert max(steps) < 0.1  # and each is still a curve


def test_a_phase_plane_without_stick_has_no_thick_segment():
    run = simulate(compose(wells.JANSEN_2, BitRock()), 5.0, start={"bit.speed": 20.0, "top.speed": 20.0}, inputs={"top.torque": 2e4})
    ax = phase_plane(run, "chain.twist.0", "bit.speed")
    assert len(hairlines(ax)) == 1 and ax.get_legend() is None


def test_a_comparison_has_a_panel_per_run_on_common_axes():
    runs = {f"{torque / 1e3:g} kN m": simulate(RIG, 20.0, inputs={"top.torque": torque}) for torque in (1e4, 1.2e4, 2e4)}
    axes = comparison(runs, "bit.speed")
    assert [ax.get_title(loc="left") for ax in axes] == list(runs)
    assert len({ax.get_ylim() for ax in axes}) == 1
    assert axes[0].figure.get_supylabel() == "bit speed [rad/s]"
    _, one = plt.subplots()
    assert comparison(runs, "bit.speed", "bit", ax=one) is one
    assert list(curves(one)) == list(runs) and one.get_ylabel() == "bit speed [rad/s]"
    assert set(runs) <= {text.get_text() for text in one.texts}


def test_runs_of_different_length_are_compared_on_the_longest():
    axes = comparison({"short": simulate(BELT, 5.0), "long": simulate(BELT, 20.0)}, "block.speed")
    assert axes[0].get_xlim() == (0.0, 20.0)
    assert curves(axes[0])["short"][:, 0].max() == 5.0
    comparison({"short": simulate(BELT, 5.0), "long": simulate(BELT, 20.0)}, "block.speed", after=6.0)


def test_drawing_into_given_axes_leaves_global_state_alone(rig_run):
    figure = matplotlib.figure.Figure()
    before, settings = plt.get_fignums(), dict(plt.rcParams)
    ax = figure.add_subplot()
    assert traces(rig_run, "bit.speed", "top.speed", ax=ax) is ax
    assert phase_plane(rig_run, "bit.speed", "top.speed", ax=figure.add_subplot()) is not None
    comparison({"a": rig_run, "b": rig_run}, "bit.speed", ax=figure.add_subplot())
    figure.savefig(io.BytesIO(), format="png")
    assert plt.get_fignums() == before
    traces(rig_run)
    assert dict(plt.rcParams) == settings


def test_a_figure_is_written_with_room_for_its_legends(rig_run, tmp_path):
    ax = rig_run.plot()[0]
    ax.figure.savefig(tmp_path / "traces.png")
    assert (tmp_path / "traces.png").stat().st_size > 10_000
    height = ax.figure.bbox.height
    renderer = ax.figure.canvas.get_renderer()
    for legend in (a for a in ax.get_children() if type(a).__name__ == "Legend"):
        assert legend.get_window_extent(renderer).y1 <= height


def test_runs_with_output_times_are_drawn_as_smoothly():
    coarse = simulate(BELT, 20.0, output_times=[0.0, 10.0, 20.0])
    fine = simulate(BELT, 20.0)
    np.testing.assert_array_equal(
        curves(traces(coarse, "block.speed")[0])["block speed"], curves(traces(fine, "block.speed")[0])["block speed"]
    )


def test_bad_arguments_are_refused_by_name(rig_run, belt_run):
    _, ax = plt.subplots()
    refused = [
        (lambda: traces(rig_run, "bit.sped"), r"did you mean `bit\.speed`"),
        (lambda: traces(rig_run, "bit.speed", "bit.torque", ax=ax), "Argument `ax` must take signals of one unit"),
        (lambda: traces(rig_run, "bit.speed", after=30.0, until=20.0), "Argument `until` must be > 30 and <= 60 s"),
        (lambda: traces(rig_run, "bit.speed", after=math.nan), "Argument `after` must be (a finite number )?>= 0 and < 60 s"),
        (lambda: traces(rig_run, "bit.speed", until=61.0), "Argument `until` must be > 0 and <= 60 s"),
        (lambda: phase_plane(rig_run, "chain.speed", "bit.speed"), "must be a scalar, but `chain.speed` has 2 entries"),
        (lambda: phase_plane(rig_run, "top.speed", "bit.speed", "bitt"), "There is no element `bitt`"),
        (lambda: comparison({}, "bit.speed"), "Argument `runs` must hold at least one run"),
        (lambda: comparison({"a": rig_run, "b": belt_run}, "bit.speed", "bit"), 'There is no element `bit` in the run "b"'),
        (lambda: comparison({"a": rig_run}, "chain.speed"), "must be a scalar"),
    ]
    for call, message in refused:
        with pytest.raises(SceneError, match=message):
            call()


def test_a_part_has_its_colour_in_every_picture(rig_run):
    speed, torque = traces(rig_run)
    of = {line.get_label(): line for ax in (speed, torque) for line in ax.get_lines()}
    assert of["top speed"].get_color() == of["top torque"].get_color() != of["bit speed"].get_color() == of["bit torque"].get_color()
    # two of one part in a panel differ in their dashes
    assert of["top load"].get_color() == of["top torque"].get_color() and of["top load"].get_linestyle() != of["top torque"].get_linestyle()
    (alone,) = traces(rig_run, "bit.torque")
    (compared,) = comparison({"one": rig_run}, "bit.speed")
    plane = phase_plane(rig_run, "chain.twist.0", "bit.speed")
    found = {alone.get_lines()[0].get_color(), compared.get_lines()[0].get_color(), to_hex(hairlines(plane)[0].get_colors()[0])}
    assert found == {of["bit speed"].get_color()}


def test_a_curve_of_many_swings_is_thin_whatever_it_swings_about_and_round_off_is_no_swing():
    time = np.linspace(0.0, 1.0, 20_001)
    swings = np.sin(2.0 * np.pi * 60.0 * time)  # 120 turns, where 60 are drawn in full
    _, ax = plt.subplots()
    for values in (swings, 1000.0 + 0.1 * swings, 1000.0 + 1e-9 * swings):
        draw_line(ax, time, values, "a", {"linewidth": 1.5})
    about_zero, about_much, round_off = (line.get_linewidth() for line in ax.get_lines())
    assert about_zero == about_much == pytest.approx(0.75, rel=0.02) and round_off == 1.5


def test_a_peak_of_an_instant_does_not_flatten_the_rest_and_is_named():
    pulse = ([0.0, 20.0, 20.05, 20.1, 60.0], [1e4, 1e4, 3e5, 1e4, 1e4])
    run = simulate(RIG, 60.0, inputs={"top.torque": pulse})
    (ax,) = traces(run, "top.torque", "bit.torque")
    assert ax.get_ylim()[1] < 0.2 * 3e5
    (text,) = [text for text in ax.texts if "kN m" in text.get_text()]
    assert text.get_text() == "300 kN m" and text.xy[0] == pytest.approx(20.05, abs=0.01)
    (mark,) = [line for line in ax.get_lines() if line.get_label() == "_peak"]
    assert mark.get_xdata()[0] == pytest.approx(20.05, abs=0.01) and mark.get_ydata()[0] == ax.get_ylim()[1]
    # what lasts is shown whole
    (ax,) = traces(simulate(RIG, 60.0, inputs={"top.torque": ([0.0, 20.0, 20.0, 60.0], [1e4, 1e4, 3e5, 3e5])}), "top.torque")
    assert ax.get_ylim()[1] > 3e5 and not [text for text in ax.texts if "kN m" in text.get_text()]


@pytest.mark.parametrize("law", [PI(reference=9.0, lowest_torque=0.0, highest_torque="14 kN m"), None], ids=["law", "drive"])
def test_limits_of_the_drive_are_drawn_where_they_can_be_seen(law, tmp_path):
    drive = () if law else (TopDrive(ratio=7.0, torque_limit=2000.0, encoder_lag=None, drive_lag=None),)
    rig = compose(wells.JANSEN_2, BitRock(), *drive)
    run = simulate(rig, 20.0, controller=law or PI(reference=9.0))
    for shown in (run, Trajectory.load(run.save(tmp_path / "run.npz"))):
        (ax,) = traces(shown, "top.torque")
        limits = [line.get_ydata()[0] for line in ax.get_lines() if line.get_label() == "_limit"]
        assert limits == [14e3]  # 0 N m, or the other way round, is too far from what the drive does
        assert all(ax.get_ylim()[0] < limit < ax.get_ylim()[1] for limit in limits)
        (ax,) = traces(shown, "bit.speed")
        assert not [line for line in ax.get_lines() if line.get_label() == "_limit"]


def test_every_mode_of_every_element_has_a_tone():
    x, v = ca.SX.sym("x"), ca.SX.sym("v")
    kinds = [
        DryFriction("a", v, Coulomb()),
        UnilateralContact("b", x, v, restitution=0.5),
        OneWayClutch("c", v),
        Hysteresis("d", x, low=0.0, high=1.0),
    ]
    words = {word for element in kinds for word in element.mode_names.values()}
    assert {"stick", "slip+", "closed", "locked", "free", "high"} <= words <= set(TONES)
