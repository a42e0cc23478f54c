"""What was measured beside what is simulated: in Python, and in a study whose scene names a log."""

import csv

import numpy as np
import pytest

from models import BitRock, wells
from studies.questions.synthetic import COLUMNS, FOLDER, NOISE, true_rig
from toolbox import Scene, SceneError, compose
from toolbox.calibration import validate
from toolbox.commands.command_line import main

SCENE = """title = "A rig and its log"
duration = 5.0
plant = [{{ part = "wells.JANSEN_2" }}, {{ part = "BitRock", friction = {{ law = "Exponential", static = 0.74, kinetic = 0.46, decay = 1.15 }} }}]

[inputs]
"top.torque" = "9 kN m"

[measured]
file = "{file}"
columns = {columns}
"""


def test_the_machine_behind_a_log_deviates_by_the_noise_of_its_sensors_and_another_by_more():
    found = validate(true_rig(), FOLDER / "rig.csv", COLUMNS)
    assert {each.signal: each.rms for each in found.residuals} == pytest.approx(NOISE, rel=0.1)
    wrong = validate(compose(wells.JANSEN_2, BitRock()), FOLDER / "rig.csv", COLUMNS)
    assert wrong.residuals[1].rms > 10 * found.residuals[1].rms
    assert "bit.speed: rms deviation" in str(found)
    windows = validate(true_rig(), FOLDER / "rig.csv", COLUMNS, [(0, "10 s"), (0, 20)])  # both from rest, as the log begins
    assert windows.residuals[0].rms == pytest.approx(found.residuals[0].rms, rel=0.1) and windows.plot().shape == (2, 6)


def test_windows_stand_on_the_clock_of_the_log_also_where_they_begin_between_samples():
    found = validate(true_rig(), FOLDER / "rig.csv", COLUMNS, [(0, "10 s"), (10.013, 20)])
    late = [panel for panel in found.panels if panel.name.endswith("[2]")]
    assert late and all(panel.x[0] == pytest.approx(10.04, abs=1e-9) for panel in late)  # samples are 0.04 s apart


def test_a_study_shows_what_was_measured_beside_what_is_simulated(tmp_path, capsys):
    (tmp_path / "rig.csv").write_bytes((FOLDER / "rig.csv").read_bytes())
    columns = "{ " + ", ".join(f'"{name}" = "{heading}"' for name, heading in COLUMNS.items()) + " }"
    scene = tmp_path / "rig.toml"
    scene.write_text(SCENE.format(file="rig.csv", columns=columns) + 'windows = [["0 s", "12 s"]]\n')
    assert main(["study", str(scene), "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    for printed in (told, (tmp_path / "out" / "study.txt").read_text()):
        assert "no controller: Simulated beside 903 measured values over 12 s" in printed and "bit.speed: rms deviation" in printed
    with (tmp_path / "out" / "measured.csv").open(newline="") as file:
        rows = {row["signal"]: float(row["rms"]) for row in csv.DictReader(file)}
    assert rows == pytest.approx(NOISE, rel=0.15)
    assert [path.name for path in (tmp_path / "out").glob("*_measured.png")]
    again = Scene.load(tmp_path / "out" / "scene.toml")  # which finds the log wherever the folder is
    assert again.measured == Scene.load(scene).measured and again.measured.windows == ((0.0, 12.0),)
    assert np.isclose(
        validate(again["no controller"], again.measured.file, again.measured.columns, (0, 12)).residuals[0].rms, rows["top.speed"]
    )


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("windows = [5, 35]", "must be a list of .begin, end."),
        ("windows = [[35, 5]]", "must begin before it ends"),
        ("widows = [[5, 35]]", "There is no key `widows` in measured: did you mean `windows`"),
    ],
)
def test_what_is_wrong_with_the_log_of_a_scene_is_told(tmp_path, line, words):
    scene = tmp_path / "rig.toml"
    scene.write_text(SCENE.format(file="rig.csv", columns="{}") + line + "\n")
    with pytest.raises(SceneError, match=words):
        Scene.load(scene)


def test_a_log_that_is_not_there_is_told_by_the_study(tmp_path, capsys):
    scene = tmp_path / "rig.toml"
    scene.write_text(SCENE.format(file="none.csv", columns="{}"))
    assert main(["study", str(scene), "--out", str(tmp_path / "out")]) == 2
    assert "none.csv" in capsys.readouterr().err and not (tmp_path / "out").exists()
