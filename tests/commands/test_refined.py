"""The option `--refined` of a study: every verdict again with twice as many elements of the string."""

import pytest

from toolbox import Scene
from toolbox.commands.command_line import main
from toolbox.onsets.verdicts import verdict_row

SCENE = """
title = "short string"
duration = 30
reference = 8.0
[[plant]]
part = "DrillString"
sections = "sections.csv"
top_inertia = 2000
elements = 2
[[plant]]
part = "BitRock"
weight = "60 kN"
[[controllers]]
label = "stiff PI"
law = "StiffPI"
"""


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "sections.csv").write_text("length [m],OD [in],ID [in],material\n2000,5,4.276,steel\n")
    path = tmp_path / "string.toml"
    path.write_text(SCENE)
    return path


@pytest.mark.slow
def test_the_verdict_with_twice_the_elements_is_that_of_the_finer_scene(scene, tmp_path, capsys):
    assert main(["study", str(scene), "--refined", "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    finer = verdict_row(Scene.load(scene, refined=True), "stiff PI")[0]
    row = next(line for line in told[told.index("With twice as many elements (5 inertias") :].splitlines() if "stiff PI" in line)
    assert row.split()[-2:] == [f"{finer.stuck:.3g}", "s"] and finer.verdict in row
    assert "number of elements." in told


def test_a_machine_without_a_string_has_no_elements_to_double(root, tmp_path, capsys):
    path = root / "studies" / "scenes" / "jansen_2.toml"
    assert main(["study", str(path), "--refined", "--out", str(tmp_path / "out")]) == 2
    assert "no number of elements can be doubled" in capsys.readouterr().err
