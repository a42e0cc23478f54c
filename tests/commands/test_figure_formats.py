"""Figures of every command that writes some, in the format that was asked for."""

from __future__ import annotations

import dataclasses

import matplotlib.pyplot as plt
import pytest
from matplotlib.figure import Figure

from controllers import BrakeForce
from models import BlockOnBelt, DiscBrake
from toolbox import Scene, Trajectory, compose, measure, simulate
from toolbox.commands import figures as figures_of_commands
from toolbox.commands.command_line import main

BEGINNINGS = {"png": b"\x89PNG", "pdf": b"%PDF-", "svg": b"<?xml"}


def figures(folder):
    return {path.name: path.read_bytes()[:5] for path in folder.iterdir() if path.suffix[1:] in BEGINNINGS}


@pytest.mark.parametrize("kind", BEGINNINGS)
def test_figures_are_written_in_the_format_asked_for_and_replace_those_of_another(kind, belt, tmp_path):
    out = tmp_path / "out"
    assert main(["simulate", str(belt), "--duration", "5", "--out", str(out)]) == 0
    assert main(["simulate", str(belt), "--duration", "5", "--out", str(out), "--format", kind]) == 0
    found = figures(out)
    assert set(found) == {f"01_one.{kind}", f"02_two.{kind}"}
    assert all(content.startswith(BEGINNINGS[kind]) for content in found.values())
    assert Trajectory.load(out / "01_one.npz").end == 5.0


def test_a_figure_is_drawn_once_for_its_file_and_is_the_one_that_matplotlib_draws_by_itself(tmp_path, monkeypatch):
    drawn = []
    draw = Figure.draw
    monkeypatch.setattr(Figure, "draw", lambda self, renderer: (drawn.append(self), draw(self, renderer))[1])
    run = simulate(compose(BlockOnBelt()), 20.0)
    figures_of_commands.draw_found(run, None, tmp_path / "ours.png")
    assert len(drawn) == 1
    figure = run.plot()[0].figure
    figure.savefig(tmp_path / "theirs.png", dpi=figures_of_commands.DPI)
    assert len(drawn) > 2 and (plt.imread(tmp_path / "ours.png") == plt.imread(tmp_path / "theirs.png")).all()


@pytest.mark.slow
def test_a_study_and_a_comparison_write_pdf(belt, tmp_path):
    out = tmp_path / "out"
    for _ in range(2):
        assert main(["study", str(belt), "--out", str(out), "--format", "pdf"]) == 0
    names = {"comparison.pdf", *(f"0{i}_{word}{tail}.pdf" for i, word in ((1, "one"), (2, "two")) for tail in ("", "_phase"))}
    assert set(figures(out)) == names
    runs = [str(out / f"0{i}_{word}.npz") for i, word in ((1, "one"), (2, "two"))]
    for kind in ("svg", "pdf"):
        assert main(["compare", *runs, "--out", str(tmp_path / "both"), "--format", kind]) == 0
        assert set(figures(tmp_path / "both")) == {f"compare.{kind}"}


@pytest.mark.parametrize(
    "command", ["study", "simulate", "compare", "onset", "map", "chance", "basin", "tune", "fit", "posterior", "estimate", "tradeoff"]
)
def test_an_unknown_format_is_refused_by_every_command_that_writes_figures(command, capsys):
    with pytest.raises(SystemExit) as caught:
        main([command, "--format", "jpeg"])
    assert caught.value.code == 2
    assert "argument --format: invalid choice: 'jpeg' (choose from" in capsys.readouterr().err


def test_figures_of_a_stop_end_a_little_after_standstill_and_show_the_speed_of_the_car_once(tmp_path, monkeypatch):
    stop = Scene.of(
        compose(DiscBrake(wheel_radius="300 mm")), 6.0, signal="disc.car_speed", effort="brake.force", after=0.2, standstill_speed=0.03,
        start={"disc.car_speed": "5 km/h"}, inputs={"brake.force": 1000.0},
    )  # fmt: skip
    run = stop.run(stop.labels[0])
    stands = measure.standstill(run, "disc.car_speed", 0.03)
    assert 0.2 < stands < 3.0
    assert figures_of_commands.shown_until(stop, [run]) == pytest.approx(1.1 * stands)
    assert figures_of_commands.shown_until(dataclasses.replace(stop, standstill_speed=None), [run]) is None
    assert figures_of_commands.shown_until(stop, [simulate(stop[stop.labels[0]], 0.5)]) == 0.5  # it rolls to the end
    shown = []
    monkeypatch.setattr(figures_of_commands, "_write", lambda axes, title, path: shown.append(axes))
    figures_of_commands.draw(stop, "stop", run, tmp_path / "a.png", tmp_path / "b.png")
    figures_of_commands.draw_comparison(stop, {"stop": run}, tmp_path / "c.png")
    for panels in (shown[0], shown[-1]):
        assert panels[-1].get_xlim()[1] == pytest.approx(1.1 * stands)
    assert shown[0][0].get_ylabel() == "disc car speed [m/s]"
    assert "disc.speed" not in run.main_signals and "disc.car_speed" in run.main_signals


def test_what_a_controller_remembers_is_no_main_signal_of_a_run():
    plant, law = compose(DiscBrake(force=0.0, wheel_radius="300 mm")), BrakeForce(car_deceleration=2.5)
    run = simulate(plant, 0.5, start={"disc.car_speed": 2.0}, controller=law, sample_time=1e-3)
    assert run.main_signals == ["disc.car_speed", "brake.torque", "brake.force"]
