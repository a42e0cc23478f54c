"""Two runs by their measures, and two scenes by their keys."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from controllers import PI, StiffPI
from models import BitRock, BlockOnBelt, wells
from tests.plants import RIG
from tests.refusals import refusals
from toolbox import Scene, SceneError, Trajectory, compare, compose, measure, plot, simulate
from toolbox.commands.command_line import main


@pytest.fixture(scope="module")
def runs():
    return {"slow": simulate(RIG, 40.0, controller=PI(reference=6.0)), "fast": simulate(RIG, 30.0, controller=PI(reference=20.0))}


def test_the_measures_of_two_runs_are_those_of_each(runs):
    slow, fast = runs.values()
    found = compare(slow, fast, after=10.0, labels=tuple(runs))
    row = found["bit.speed, severity"]
    assert row.first == pytest.approx(measure.severity(slow, after=10.0, until=30.0)) and row.second == pytest.approx(
        measure.severity(fast, after=10.0, until=30.0)
    )
    assert row.change == pytest.approx(row.second - row.first)
    assert found["bit, stick phases"].first == len(measure.stick_intervals(slow, "bit", 10.0, 30.0))
    assert found["bit, part of the time in stick"].first == pytest.approx(measure.stuck_ratio(slow, "bit", 10.0, 30.0))
    text = str(found)
    assert "slow" in text.splitlines()[1] and f"{row.first:.6g}" in text and "rad/s" in text
    assert repr(found) == text and f"{row.first:.6g}" in found._repr_html_()
    with pytest.raises(SceneError, match=r"There is no `bit.speed, severty` in the comparison: did you mean `bit.speed, severity`"):
        found["bit.speed, severty"]


def test_a_run_differs_in_nothing_from_itself_read_back(runs, tmp_path):
    run = runs["slow"]
    found = compare(run, Trajectory.load(run.save(tmp_path / "run.npz")))
    for row in found.rows:
        assert row.change == pytest.approx(0.0, abs=1e-5 * max(abs(row.first), 1.0)), row


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda runs: compare(runs["slow"], 3), r"Argument `second` must be a run or a scene, and both of the same kind, but it is 3"),
    (lambda runs: compare(runs["slow"], SCENE), "Argument `second` must be a run or a scene, and both of the same kind"),
    (lambda runs: compare(SCENE, runs["slow"]), "Argument `first` must be a run or a scene, and both of the same kind"),
    (lambda runs: compare(runs["slow"], runs["slow"], signals=["bit.sped"]), r"There is no signal `bit.sped`"),
    (lambda runs: compare(runs["slow"], simulate(compose(BlockOnBelt()), 5.0)), "Argument `second` must have an element or a signal"),
)  # fmt: skip


SCENE = Scene.of(RIG, 60.0, {"PI": PI(reference=9.0)}, title="rig", reference=9.0)


def test_scenes_differ_in_the_keys_that_were_changed():
    assert compare(SCENE, SCENE).rows == () and "no difference" in str(compare(SCENE, SCENE))
    heavier = dataclasses.replace(SCENE, duration=90.0, parts=(wells.JANSEN_2, BitRock(weight=120e3)), inputs={"top.reference": 5.0})
    stiff = dataclasses.replace(heavier, cases=(dataclasses.replace(SCENE.cases[0], law=StiffPI(reference=9.0)),))
    found = {row.name: (row.first, row.second) for row in compare(SCENE, heavier).rows}
    assert found == {"duration": (60.0, 90.0), "plant.BitRock.weight": (BitRock().weight, 120e3), "inputs.top.reference": (None, 5.0)}
    assert compare(heavier, stiff)["controllers.PI.law"][2:] == ("PI", "StiffPI")
    twice = dataclasses.replace(SCENE, parts=(wells.JANSEN_2, BitRock(), BitRock(name="other")))
    assert {
        row.name for row in compare(twice, dataclasses.replace(twice, parts=(wells.JANSEN_2, BitRock(), BitRock(name="another")))).rows
    } == {"plant.BitRock 2.name"}


def test_overlaid_runs_have_a_colour_each_and_a_panel_per_signal(runs, tmp_path):
    saved = {label: Trajectory.load(run.save(tmp_path / f"{label}.npz")) for label, run in runs.items()}
    for shown in (runs, {"slow": runs["slow"], "fast": saved["fast"]}):
        axes = plot.overlay(shown, "bit.speed", "top.torque", after=5.0)
        assert [ax.get_ylabel() for ax in axes] == ["bit speed [rad/s]", "top torque [kN m]"]
        for ax in axes:
            assert [line.get_label() for line in ax.get_lines()] == ["slow", "fast"]
            assert len({line.get_color() for line in ax.get_lines()}) == 2
        assert [text.get_text() for text in axes[0].get_legend().get_texts()] == ["slow", "fast"]
        assert axes[0].get_lines()[1].get_xdata()[-1] == 30.0 and axes[0].get_xlim() == (5.0, 40.0)
    assert len(plot.overlay(runs)) == len(runs["slow"].main_signals)
    (ax,) = plot.overlay(runs, "bit.speed")
    assert plot.overlay(runs, "top.speed", ax=ax) is ax
    with pytest.raises(SceneError, match="must name one signal for one `ax`"):
        plot.overlay(runs, "bit.speed", "top.speed", ax=ax)
    with pytest.raises(SceneError, match=r"Argument `runs` must hold at least one run as \{label: run\}"):
        plot.overlay({})


def test_the_command_compares_saved_runs_and_scenes(runs, tmp_path, capsys):
    paths = [str(run.save(tmp_path / f"{label}.npz")) for label, run in runs.items()]
    assert main(["compare", *paths, "--after", "10 s", "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert str(compare(*runs.values(), after=10.0, labels=("slow", "fast"))).splitlines()[0] in printed
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["compare.png", "compare.txt", "origin.json"]
    assert main(["compare", *paths, "--out", str(tmp_path / "out")]) == 0  # replaces its own
    first, second = tmp_path / "first.toml", tmp_path / "second.toml"
    SCENE.save(first)
    dataclasses.replace(SCENE, duration=90.0).save(second)
    capsys.readouterr()
    assert main(["compare", str(first), str(second)]) == 0
    assert capsys.readouterr().out.split()[-4:] == ["duration", "60", "90", "+30"]
    assert main(["compare", str(first), paths[0]]) == 2
    assert "must be two runs (.npz) or two scenes (.toml)" in capsys.readouterr().err
    assert main(["compare", *paths, "--signal", "bit.sped"]) == 2
    assert "did you mean `bit.speed`" in capsys.readouterr().err


def test_a_folder_that_holds_one_run_stands_for_it(runs, tmp_path, capsys):
    slow, fast = runs.values()
    folder, other = tmp_path / "slow", tmp_path / "others"
    for each in (folder, other, tmp_path / "empty"):
        each.mkdir()
    path = slow.save(folder / "01_slow.npz")
    np.savez(folder / "margins.npz", result=np.array("{}"))  # what another command found
    paths = [str(fast.save(other / f"0{i}_fast.npz")) for i in (1, 2)]
    assert main(["compare", str(path), paths[0]]) == 0
    expected = capsys.readouterr().out
    assert main(["compare", str(folder), paths[0]]) == 0
    assert capsys.readouterr().out == expected
    assert main(["compare", str(folder), str(other)]) == 2
    assert (
        f"Folder `{other}` must hold one run (.npz), as simulate and study write it, but it holds 2: give one of `{paths[0]}`, `{paths[1]}`."
        in (capsys.readouterr().err)
    )
    assert main(["compare", str(tmp_path / "empty"), str(folder)]) == 2
    assert "but it holds none." in capsys.readouterr().err
