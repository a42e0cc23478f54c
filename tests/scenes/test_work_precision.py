"""What accuracy costs: the table is honest about its truth, methods converge in it, and the command writes what it prints."""

import csv

import numpy as np
import pytest

from models import BitRock, TorsionalChain, wells
from studies.benchmarks import tradeoff
from studies.benchmarks.cases import cases
from tests.mechanisms import Ball, Hertz
from tests.plants import BELT
from toolbox import (
    Scene,
    SceneError,
    closed_loop,
    compose,
    simulate,
    work_precision,
)
from toolbox.commands.command_line import main
from toolbox.simulation import Smoothing


@pytest.fixture(scope="module")
def trade():
    return work_precision(BELT, 30.0, accuracies=(1e-3, 1e-6, 1e-9), steps=(0.02, 0.005, 0.00125), widths=(1e-3, 1e-5, 1e-7), repeats=1)


def test_every_method_gets_better_with_its_setting(trade):
    for method in ("taylor", "explicit", "stiff", "time-stepping", "smoothed"):
        errors = [point.error for point in trade.points if point.method == method]
        assert len(errors) == 3
        assert errors[2] < 0.3 * errors[0]


def test_the_truth_is_known_better_than_the_smallest_error_that_is_shown(trade):
    assert trade.reference_error < 1e-9
    exact = simulate(BELT, 30.0, accuracy=1e-3, method="taylor").difference(simulate(BELT, 30.0, accuracy=1e-11))
    assert trade.points[0].error == pytest.approx(exact, rel=1e-3)
    with pytest.raises(SceneError, match="Argument `error` must be >= .* below which the truth is not known"):
        trade.cheapest(trade.reference_error / 10)


def test_the_cheapest_run_for_an_error_meets_it(trade):
    best = trade.cheapest(1e-4)
    assert best.error <= 1e-4
    assert all(point.seconds >= best.seconds for point in trade.points if point.error <= 1e-4)
    assert trade.cheapest(trade.reference_error) is None or trade.cheapest(trade.reference_error).method in ("taylor", "explicit", "stiff")


def test_a_trade_prints_draws_and_saves_every_point(trade, tmp_path):
    assert str(trade).count("\n") == 2 + len(trade.points)
    ax = trade.plot()
    assert [line.get_label() for line in ax.get_lines()] == ["taylor", "explicit", "stiff", "time-stepping", "smoothed"]
    with trade.save(tmp_path / "trade.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["error"]) for row in rows] == [point.error for point in trade.points]


def test_steps_that_stand_in_for_taylor_series_do_not_count_as_such():
    trade = work_precision(
        closed_loop(compose(Hertz()), start={"ball.depth": -0.5}), 5.0, methods=("taylor", "explicit"), accuracies=(1e-6,), repeats=1
    )
    assert ["no Taylor series at t = " in point.failed for point in trade.points] == [True, False]
    assert "no Taylor series" in str(trade)


def test_levels_of_detail_are_compared_by_what_they_have_in_common():
    fine = TorsionalChain(inertia=(2122.0, 100.0, 374.0), stiffness=(946.0,) * 2, damping=(46.4,) * 2, top_drag=425.0, bit_drag=50.0)
    parts = {"three inertias": fine, "two inertias": wells.JANSEN_2}
    plants = {label: closed_loop(compose(part, BitRock()), inputs={"top.torque": 20_000.0}) for label, part in parts.items()}
    arguments = {"signals": ("bit.speed",), "methods": ("explicit",), "accuracies": (1e-6, 1e-9), "repeats": 1}
    trade = work_precision(plants, 5.0, **arguments)
    errors = {(point.plant, point.setting): point.error for point in trade.points}
    assert errors["three inertias", 1e-9] < 1e-7
    # an error of the model, which no tolerance mends
    assert errors["two inertias", 1e-6] == pytest.approx(errors["two inertias", 1e-9], rel=1e-3)
    assert errors["two inertias", 1e-9] > 1e-3
    with pytest.raises(SceneError, match="Argument `signals` must name what the levels of detail have in common"):
        work_precision(plants, 5.0)


def test_a_setting_that_fails_is_a_line_of_the_table():
    trade = work_precision(closed_loop(compose(Ball()), start={"ball.height": 1.0}), 1.0, methods=("smoothed",), widths=(1e-3,), repeats=1)
    assert trade.points[0].failed == "The rigid contact `floor` cannot be smoothed: give it a `stiffness` in place of a restitution."
    assert "cannot be smoothed" in str(trade)


@pytest.mark.slow
def test_the_command_writes_table_and_figure_of_a_scene(root, tmp_path, capsys):
    scene = root / "studies/scenes/block_on_belt.toml"
    assert main(["tradeoff", str(scene), "--duration", "5", "--out", str(tmp_path / "out")]) == 0
    made = ["origin.json", "scene.toml", "tradeoff.csv", "tradeoff.npz", "tradeoff.png", "tradeoff.txt"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == made
    printed = capsys.readouterr().out
    assert "time-stepping" in printed
    assert Scene.load(scene).title in printed
    assert main(["tradeoff", str(scene), "--duration", "1", "--out", str(tmp_path / "out")]) == 0  # replaces its own
    (tmp_path / "out" / "tradeoff.csv").write_text("mine")
    assert main(["tradeoff", str(scene), "--duration", "1", "--out", str(tmp_path / "out")]) == 2  # and nobody else's
    assert main(["tradeoff", str(scene), "--controller", "nobody"]) == 2


def test_casadi_integrates_the_smoothed_law_of_the_study_to_the_same_motion():
    case = cases()["belt"]
    grid = np.linspace(0.0, 10.0, 101)
    states, _ = tradeoff.cvodes(case, 1e-2, 1e-9)(grid)
    ours = simulate(case.loop, 10.0, method=Smoothing(1e-2 * _largest_slip(case)), accuracy=1e-9)
    np.testing.assert_allclose(states, ours.at(grid).states, atol=1e-5)


def _largest_slip(case):
    from toolbox.simulation.refinement import slips
    from toolbox.simulation.request import Request

    return slips(Request(case.loop, case.duration).checked())["belt"]


def test_methods_are_named_or_refused():
    with pytest.raises(SceneError, match="Argument `methods` must be among .* but one is 'magic'"):
        work_precision(BELT, 1.0, methods=("magic",))
    with pytest.raises(SceneError, match="Argument `duration` must be a finite number > 0 s, but it is None"):
        work_precision(BELT)
    with pytest.raises(SceneError, match="Argument `accuracies` must be >= 1e-13"):
        work_precision(BELT, 1.0, accuracies=(0.0, 1e-3))


def test_the_figure_of_the_command_says_its_title_once_and_within_the_figure(trade, tmp_path, monkeypatch):
    import matplotlib.pyplot as plt

    from toolbox.commands import figures

    drawn = []
    monkeypatch.setattr(plt, "close", drawn.append)
    figures.draw_found(trade, None, tmp_path / "own.png")
    figures.draw_found(trade, "A long title of a scene, as engineers like them, with weight, speed and depth " * 2, tmp_path / "long.png")
    monkeypatch.undo()
    assert drawn[0].get_suptitle() == ""
    figure = drawn[1]
    box = figure._suptitle.get_window_extent(figure.canvas.get_renderer())
    assert box.x0 > 0 and box.x1 < figure.bbox.x1
