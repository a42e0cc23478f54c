"""Rules that hold for the whole project: the direction of imports, a light start, documentation, and commands that are written down once."""

import ast
import importlib
import importlib.util
import inspect
import itertools
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import controllers
import models
import toolbox
from toolbox import authoring
from toolbox.faces import imported as imported_names

FORBIDDEN = {"toolbox": {"models", "controllers"}, "models": {"controllers"}, "controllers": {"models"}}
FORBIDDEN = {package: others | {"studies", "tests"} for package, others in FORBIDDEN.items()}
CALLED = ("import_module(file)", "import_module(f\"{package['__name__']}.{name}\")", "importlib.import_module(name)")
"""Imports by a call: of the public names, and of a user's own file (`--load`)."""
HEAVY = ("control", "scipy", "osqp", "matplotlib", "numba", "llvmlite", "pint", "pandas", "tqdm", "tomli_w")


def sources(root, *packages):
    return [path for package in packages for path in sorted((root / package).rglob("*.py"))]


def imported(tree):
    """Top-level names of everything that a module imports, at its top or inside functions."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute here, so that this test sees them"
            yield node.module.partition(".")[0]
        elif isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in ("import_module", "__import__"):
            assert ast.unparse(node) in CALLED, "imports are written down, so that this test sees them"


FACES = [
    (toolbox, "_ROOMS", {"time"}, set()),
    (models, "_FILES", set(), set()),
    (controllers, "_FILES", set(), set()),
    (authoring, "_FILES", set(), {"face"}),
]


@pytest.mark.parametrize(("face", "homes", "left_out", "own"), FACES, ids=[face[0].__name__ for face in FACES])
def test_a_face_finds_every_public_name_where_its_imports_for_types_say_it_is(face, homes, left_out, own):
    tree = ast.parse(Path(face.__file__).read_text())
    block = next(node for node in tree.body if isinstance(node, ast.If))
    written = {(node.module, alias.name, alias.asname or alias.name) for node in block.body for alias in node.names}
    modules = {name for file, name, _ in written if file == face.__name__}
    assert {each for each in written if each[1] not in modules} == {
        (file, name, public) for file, names in vars(face)[homes].items() for name, public in imported_names(names).items()
    }
    assert set(face.__all__) | left_out == {public for _, _, public in written} | own
    for name in face.__all__:
        assert getattr(face, name) is not None and name in dir(face)
        hidden = name not in modules and importlib.util.find_spec(f"{face.__name__}.{name}") if hasattr(face, "__path__") else None
        assert not hidden, f"the file {name}.py hides the public name {name}: what imports the file first gets the module"
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        face.nothing  # noqa: B018


@pytest.mark.parametrize("package", FORBIDDEN)
def test_imports_go_one_way(root, package):
    for path in sources(root, package):
        wrong = set(imported(ast.parse(path.read_text()))) & FORBIDDEN[package]
        assert not wrong, f"{path.relative_to(root)} must not import {', '.join(wrong)}"


@pytest.mark.parametrize(
    "module", ["toolbox", "models", "controllers", "toolbox.scenes.scene", "toolbox.commands.command_line", "toolbox.scenes.catalogue"]
)
def test_importing_the_language_stays_light(module):
    code = f"import sys, {module}; print(*sorted(name for name in {HEAVY!r} if name in sys.modules))"
    heavy = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60).stdout.split()
    assert heavy == []


def commented(path, name):
    """Whether an assignment at the top of a file is followed by a docstring."""
    body = ast.parse(path.read_text()).body
    for statement, after in itertools.pairwise(body):
        targets = statement.targets if isinstance(statement, ast.Assign) else []
        if any(isinstance(target, ast.Name) and target.id == name for target in targets):
            return isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str)
    return False


@pytest.mark.parametrize(("module", "name"), [(m, name) for m in (toolbox, models, controllers) for name in m.__all__])
def test_every_public_name_is_documented(root, module, name):
    thing = getattr(module, name)
    if inspect.isclass(thing) or inspect.isroutine(thing) or inspect.ismodule(thing):
        own = vars(thing).get("__doc__") if inspect.isclass(thing) else thing.__doc__  # a class would inherit one
        assert (own or "").strip(), f"{module.__name__}.{name} needs a docstring of its own"
    else:
        assert any(commented(path, name) for path in sources(root, module.__name__)), f"{module.__name__}.{name} needs a docstring below it"


@pytest.mark.parametrize("package", ["toolbox", "models", "controllers"])
def test_every_module_and_every_public_function_and_class_says_what_it_is(root, package):
    for path in sources(root, package):
        tree = ast.parse(path.read_text())
        assert ast.get_docstring(tree), f"{path.relative_to(root)} needs a docstring"
        for node in tree.body:
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_"):
                assert ast.get_docstring(node), f"{path.relative_to(root)}: `{node.name}` needs a docstring"


def test_a_star_import_leaves_the_module_time_alone():
    names: dict[str, object] = {}
    exec("import time\nfrom toolbox import *\nnow = time.perf_counter()", names)
    assert callable(names["simulate"]) and names["now"] > 0.0
    assert toolbox.time.is_symbolic()  # `from toolbox import time` is the symbol of time


@pytest.mark.parametrize("package", ["toolbox", "models", "controllers"])
def test_all_lists_exactly_what_the_package_imports_and_does_not_hide(package):
    module = importlib.import_module(package)
    assert sorted(set(module.__all__)) == sorted(module.__all__)
    for name in module.__all__:
        getattr(module, name)


def test_the_test_command_of_the_readme_is_the_one_that_continuous_integration_runs(root):
    readme = root / "README.md"
    if not readme.exists():
        pytest.skip("there is no README yet")
    command = re.search(r'^tests="(.+)"$', (root / ".ci" / "run").read_text(), re.MULTILINE)[1]
    lines = [line.strip().removeprefix("$ ") for line in readme.read_text().splitlines()]
    assert command in lines


def test_the_main_job_of_the_readme_names_a_scene_that_is_shipped(root):
    readme = root / "README.md"
    if not readme.exists():
        pytest.skip("there is no README yet")
    scenes = re.findall(r"stickslip study (\S+\.toml)", readme.read_text())
    assert scenes
    assert all((root / scene).is_file() for scene in scenes)


def test_the_project_registers_its_own_parts_and_command(root):
    project = tomllib.loads((root / "pyproject.toml").read_text())["project"]
    assert project["entry-points"]["stickslip.parts"] == {"models": "models", "controllers": "controllers"}
    module, _, name = project["scripts"]["stickslip"].partition(":")
    assert callable(getattr(importlib.import_module(module), name))
    assert f"## {project['version']}" in (root / "CHANGELOG.md").read_text()
