"""Parts by name: what scenes can reach, and that they can reach nothing else."""

import os
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

import controllers
import models
from tests.refusals import refusals
from toolbox import Component, Controller, FrictionLaw, SceneError
from toolbox.scenes import catalogue

FOREIGN = '''
import os
import subprocess as shell
from dataclasses import dataclass

from models import BitRock as Borrowed
from toolbox import Component, quantity

from {package} import inner


@dataclass(frozen=True)
class Motor(Component):
    """A motor."""

    inertia: float = quantity(2.0, "kg m2", "inertia")


@dataclass(frozen=True)
class BitRock(Component):
    """Another rock."""


_HIDDEN = Motor()
READY = Motor(inertia=5.0)
secret = "text"


def function():
    raise AssertionError("nothing in a catalogue is called")
'''


@pytest.fixture
def register(monkeypatch, tmp_path):
    """Register modules, given as {entry point: source of a package}, beside models and controllers."""
    points = [EntryPoint(name, name, catalogue.GROUP) for name in ("models", "controllers")]

    def register(**sources):
        monkeypatch.syspath_prepend(tmp_path)
        for name, source in sources.items():
            (tmp_path / name).mkdir()
            (tmp_path / name / "inner.py").write_text("from models import BlockOnBelt\n\nSMALL = BlockOnBelt(mass=0.1)\n")
            (tmp_path / name / "__init__.py").write_text(source.replace("{package}", name))
            points.append(EntryPoint(name, name, catalogue.GROUP))

    monkeypatch.setattr(catalogue, "entry_points", lambda group: points)
    known = set(sys.modules)
    for cached in (catalogue._packages, catalogue._entries):
        cached.cache_clear()
    yield register
    for name in set(sys.modules) - known:
        del sys.modules[name]
    for cached in (catalogue._packages, catalogue._entries):
        cached.cache_clear()


def test_parts_laws_and_ready_made_parts_are_found_by_name():
    assert catalogue.part("BitRock") is models.BitRock
    assert catalogue.part("models.BitRock") is models.BitRock
    assert catalogue.part("wells.NAVARRO_LOPEZ_4") is models.wells.NAVARRO_LOPEZ_4
    assert catalogue.part("Exponential", "friction law") is models.Exponential
    assert catalogue.part("SoftTorque", "control law") is controllers.SoftTorque


def test_everything_that_the_packages_export_is_listed_once():
    listed = [entry.item for entry in catalogue.parts()]
    for module in (models, controllers):
        for name in module.__all__:
            if isinstance(getattr(module, name), type) and issubclass(getattr(module, name), (Component, FrictionLaw)):
                assert listed.count(getattr(module, name)) == 1
    assert listed.count(models.wells.JANSEN_2) == 1


def test_an_entry_tells_kind_and_parameters_with_units():
    entries = {entry.name: entry for entry in catalogue.parts()}
    assert entries["BitRock"].kind == "part"
    assert ("weight", "N", 97_347.0, "weight on bit") in entries["BitRock"].parameters
    assert entries["wells.JANSEN_2"].parameters[0][2] == (2122.0, 374.0)
    assert all(issubclass(entry.item, Controller) for entry in catalogue.parts("control law"))
    assert all(issubclass(entry.item, FrictionLaw) for entry in catalogue.parts("friction law"))
    assert all(entry.summary for entry in catalogue.parts())
    assert all(entry.summary[-1] in ".:)" for entry in catalogue.parts() if isinstance(entry.item, type)), "a summary is cut"


@pytest.mark.parametrize("name", ["os", "annotations", "dataclass", "quantity", "Component", "Controller", "FrictionLaw", "__doc__", "wells.__file__",
                                  "wells.annotations", "belt.dataclass", "..wells", "wells.", ".", "", "models", "wells", "toolbox.Component"])  # fmt: skip
def test_nothing_but_parts_and_laws_can_be_reached(name):
    with pytest.raises(SceneError, match="There is no part"):
        catalogue.part(name)


test_wrong_uses_are_refused_in_these_words = refusals(
    (lambda: catalogue.part("BitRok"), "did you mean `BitRock`"),
    (lambda: catalogue.part("wells.NAVARRO_LOPEZ4"), "did you mean `wells.NAVARRO_LOPEZ_4`"),
    (lambda: catalogue.part(4), "must be text"),
    (lambda: catalogue.part("SoftTorque", "part"), "must be a part, but it is a control law"),
)  # fmt: skip


def test_the_name_of_a_class_finds_it_again():
    for entry in catalogue.parts():
        if isinstance(entry.item, type):
            assert catalogue.part(catalogue.name_of(entry.item)) is entry.item


def test_a_class_that_nobody_registered_has_no_name():
    class Strange(models.BitRock):
        pass

    with pytest.raises(SceneError, match="must be in the catalogue"):
        catalogue.name_of(Strange)


def test_a_users_package_adds_its_public_parts_and_nothing_that_it_imports(register):
    register(mine=FOREIGN)
    assert catalogue.part("READY").inertia == 5.0
    assert catalogue.part("inner.SMALL").mass == 0.1
    names = {entry.name for entry in catalogue.parts() if entry.source == "mine"}
    assert names == {"Motor", "BitRock", "READY", "inner.SMALL"}


def test_a_name_that_two_packages_use_must_be_led_by_its_package(register):
    register(mine=FOREIGN)
    with pytest.raises(SceneError, match=r"write `mine.BitRock` or `models.BitRock`"):
        catalogue.part("BitRock")
    assert catalogue.part("models.BitRock") is models.BitRock
    assert catalogue.part("mine.BitRock") is not models.BitRock
    assert catalogue.name_of(models.BitRock) == "models.BitRock"


def test_a_broken_package_leaves_the_others_alone_and_is_named_when_something_is_missing(register):
    register(broken="raise RuntimeError('half installed')")
    assert catalogue.part("BlockOnBelt") is models.BlockOnBelt
    with pytest.raises(SceneError, match="`broken` cannot be loaded: RuntimeError: half installed"):
        catalogue.part("Motor")


def test_without_any_registered_package_the_error_says_to_install_one(register, monkeypatch):
    monkeypatch.setattr(catalogue, "entry_points", lambda group: [])
    monkeypatch.setattr(catalogue, "_LOADED", {})  # a test of `--load` may have left some
    assert catalogue.parts() == []
    with pytest.raises(SceneError, match="registers its parts"):
        catalogue.part("BitRock")


@pytest.mark.parametrize(("package", "scene"), [("models", 'part = "BitRock"'), ("controllers", 'part = "wells.JANSEN_2"')])
@pytest.mark.parametrize("as_file", [False, True], ids=["folder", "file"])
def test_a_package_of_the_user_that_hides_ours_is_named(tmp_path, package, scene, as_file):
    hiding = tmp_path / (f"{package}.py" if as_file else f"{package}/__init__.py")
    hiding.parent.mkdir(exist_ok=True)
    hiding.write_text("mine = 1\n")
    law = '[[controllers]]\nlabel = "PI"\nlaw = "PI"\n'
    (tmp_path / "rig.toml").write_text(f'title = "Rig"\nduration = 1.0\n[[plant]]\n{scene}\n[[plant]]\npart = "BitRock"\n{law}')
    root = Path(__file__).parents[2]
    path = os.pathsep.join([str(tmp_path), str(root), os.environ.get("PYTHONPATH", "")])
    words = [sys.executable, "-c", "from toolbox.commands.command_line import script; script()", "simulate", "rig.toml"]
    done = subprocess.run(words, cwd=tmp_path, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False)
    warned, *_, error = done.stderr.splitlines()
    assert warned.endswith(
        f"UserWarning: `{hiding}` hides the package `{package}` of the toolbox, which cannot be imported: rename it, or start Python elsewhere."
    )
    assert done.returncode == 2 and done.stdout == "" and "There is no " in error


def test_a_script_beside_a_package_of_that_name_is_told_before_it_fails_and_any_other_is_told_nothing(tmp_path, root):
    (tmp_path / "controllers").mkdir()
    (tmp_path / "controllers" / "__init__.py").write_text("")
    path = os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])
    said = []
    for folder in (tmp_path, root):
        words = [sys.executable, "-c", "import toolbox; from controllers import PI"]
        done = subprocess.run(words, cwd=folder, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=False)
        said.append(done.stderr.splitlines())
    assert "hides the package `controllers` of the toolbox" in said[0][0] and "ImportError" in said[0][-1]
    assert said[1] == []


def test_what_is_offered_under_a_name_is_what_the_whole_catalogue_has_there():
    for entry in catalogue._entries():
        for name in (entry.name, f"{entry.source}.{entry.name}"):
            assert [(found.item, found.kind) for found in catalogue.offered(name) if found.source == entry.source] == [
                (entry.item, entry.kind)
            ]
    for name in ("", "wells", "models", "os", "wells.JANSEN", "wells._tables", "drill_string", "wells.wells.JANSEN_2"):
        assert catalogue.offered(name) == []


def test_a_scene_loads_only_the_parts_that_it_names(root, tmp_path):
    code = """
import sys
from toolbox import Scene
Scene.load("studies/scenes/jansen_2.toml").save(sys.argv[1])
print([name for name in ("models.squeal", "models.tabulated_string", "pint", "matplotlib") if name in sys.modules], "models.wells" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "scene.toml")], capture_output=True, text=True, cwd=root, timeout=60)
    assert done.stdout == "[] True\n", done.stderr
