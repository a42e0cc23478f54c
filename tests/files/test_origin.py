"""The origin of a folder of results: what was called and read, and whether its files are still those that were written."""

import hashlib
import json

import pytest

from toolbox.commands.command_line import main
from toolbox.errors import SceneError
from toolbox.files.origin import ORIGIN, Origin

SCENE = 'title = "belt"\nduration = 4\n[[plant]]\npart = "BlockOnBelt"\n'


@pytest.fixture
def results(tmp_path):
    (tmp_path / "belt.toml").write_text(SCENE)
    assert main(["simulate", str(tmp_path / "belt.toml"), "--out", str(tmp_path / "out")]) == 0
    return tmp_path / "out"


def test_a_command_tells_what_it_was_given_and_what_it_wrote(results):
    origin = Origin.read(results)
    scene = results.parent / "belt.toml"
    assert origin.command == f"stickslip simulate {scene} --out {results}"
    assert origin.inputs == {str(scene): hashlib.sha256(scene.read_bytes()).hexdigest()}
    assert set(origin.files) == {path.name for path in results.iterdir()} - {ORIGIN}
    assert origin.files["simulate.txt"] == hashlib.sha256((results / "simulate.txt").read_bytes()).hexdigest()
    assert {"Python", "machine", "casadi", "numpy"} <= set(origin.versions) and origin.seconds > 0
    assert origin.changed(results) == []


def test_the_same_call_writes_the_same_bytes_but_for_its_date_and_time(results):
    first = {path.name: path.read_bytes() for path in results.iterdir() if path.name != ORIGIN}
    assert main(["simulate", str(results.parent / "belt.toml"), "--out", str(results)]) == 0
    assert {path.name: path.read_bytes() for path in results.iterdir() if path.name != ORIGIN} == first


def test_files_that_were_changed_or_are_gone_are_named(results):
    (results / "simulate.txt").write_text("mine")
    next(results.glob("*.csv")).unlink()
    csv = next(name for name in Origin.read(results).files if name.endswith(".csv"))
    assert Origin.read(results).changed(results) == sorted(["simulate.txt", csv])


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"command": 1}', "null"])
def test_a_damaged_origin_is_refused(results, text):
    (results / ORIGIN).write_text(text)
    with pytest.raises(SceneError, match="origin of a folder of results"):
        Origin.read(results)


@pytest.mark.parametrize("key", ["files", "inputs", "versions"])
def test_an_origin_with_other_kinds_of_entries_is_refused(results, key):
    told = json.loads((results / ORIGIN).read_text())
    (results / ORIGIN).write_text(json.dumps({**told, key: {"a": 1}}))
    with pytest.raises(SceneError, match="other kinds"):
        Origin.read(results)
