"""`--load my_drive.py`: a law of one's own in a scene file, without packaging; said plainly that the file is run."""

from __future__ import annotations

import pytest

from toolbox.commands.command_line import main
from toolbox.scenes import catalogue

LAW = '''
from dataclasses import dataclass
from toolbox import Controller, Equations, quantity


@dataclass(frozen=True)
class {name}(Controller):
    """A constant torque and a damper about a set-point."""

    measured_signals, actuated_signals = ("top.speed",), ("top.torque",)
    reference: float = quantity(4.7, "rad/s", "set-point")
    damping: float = quantity(3000.0, "N m s/rad", "damping", at_least=0)

    def continuous(self, signal):
        error = self.reference - signal("top.speed", "rad/s")
        return Equations(outputs={{"top.torque": (10_000.0 + self.damping * error, "N m")}})
'''
SCENE = """
title = "own law"
duration = "20 s"
reference = "45 rpm"
[[plant]]
part = "wells.NAVARRO_LOPEZ_4"
[[plant]]
part = "BitRock"
[[controllers]]
label = "mine"
law = "{name}"
damping = "2 kN m s/rad"
"""


@pytest.fixture
def written(tmp_path):
    """(law file, scene) of one's own; every test has a name of its own, because a module is loaded once."""

    def write(name):
        (tmp_path / f"{name.lower()}.py").write_text(LAW.format(name=name))
        (tmp_path / "scene.toml").write_text(SCENE.format(name=name))
        return tmp_path / f"{name.lower()}.py", tmp_path / "scene.toml"

    return write


def test_a_scene_with_a_law_of_ones_own_runs_where_its_file_is_loaded(written, tmp_path, capsys):
    law, scene = written("MyFirstDamper")
    assert main(["simulate", str(scene)]) == 2
    said = capsys.readouterr().err
    assert "There is no control law `MyFirstDamper`" in said and "`--load FILE.py`" in said
    assert main(["simulate", str(scene), "--duration", "0.5 min", "--load", str(law)]) == 0
    assert "30 s" in capsys.readouterr().out
    assert main(["list", "MyFirstDamper", "--load", str(law)]) == 0
    assert "damping" in capsys.readouterr().out


def test_worker_processes_find_the_law_too(written, tmp_path, capsys):
    law, scene = written("MySecondDamper")
    words = [
        "tune",
        scene,
        "--controller",
        "mine",
        "--range",
        "myseconddamper.damping=500:5000",
        "--objective",
        "severity",
        "--runs",
        "10",
        "--processes",
        "2",
    ]
    assert main([*map(str, words), "--out", str(tmp_path / "out"), "--load", str(law)]) == 0
    assert "MySecondDamper" in (tmp_path / "out" / "tune.txt").read_text()


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("missing.py", None, "There is no file"),
        ("notes.txt", "", "must be a Python file such as `my_drive.py`"),
        ("no-word.py", "", "must be a Python file such as `my_drive.py`"),
        ("numpy.py", "", "must not have the name of another module, but `numpy` is one"),
        ("models.py", "", "must not have the name of another module, but `models` is one"),
        ("broken_drive.py", "1 / 0", "cannot be loaded: ZeroDivisionError"),
        ("empty_drive.py", "x = 1", "offers nothing"),
    ],
)
def test_a_file_that_offers_no_law_is_one_error_that_names_it(name, text, words, tmp_path, capsys):
    if text is not None:
        (tmp_path / name).write_text(text)
    assert main(["list", "--load", str(tmp_path / name)]) == 2
    assert words in capsys.readouterr().err
    assert name.partition(".")[0] not in catalogue._LOADED or name == "empty_drive.py"
