"""Rules that hold for the whole project: the direction of imports, a light start, documentation, and commands that are written down once."""

import ast
import compileall
import importlib
import importlib.util
import inspect
import itertools
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import controllers
import models
import toolbox
from toolbox import authoring
from toolbox.faces import public_names

FORBIDDEN = {"toolbox": {"models", "controllers"}, "models": {"controllers"}, "controllers": {"models"}}
FORBIDDEN = {package: others | {"studies", "tests"} for package, others in FORBIDDEN.items()}
CALLED = (
    "import_module(file)",
    "import_module(package)",
    "import_module(f'toolbox.commands.{module}')",
    "import_module(f'{package}.{name}')",
    "import_module(place)",
    "importlib.import_module(name)",
)
"""Imports by a call: of the public names, and of a user's own file (`--load`)."""
HEAVY = ("control", "scipy", "osqp", "matplotlib", "llvmlite", "pint", "pandas", "tqdm", "tomli_w")


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


ROOMS = [
    importlib.import_module(f"toolbox.{room}")
    for room in sorted(path.parent.name for path in Path(toolbox.__file__).parent.glob("*/__init__.py"))
    if room != "authoring"
]
FACES = [toolbox, models, controllers, controllers.observers, authoring, *(room for room in ROOMS if hasattr(room, "__all__"))]
MODULES = [toolbox.errors, toolbox.inputs, toolbox.measure, toolbox.plot]
"""Public modules: each function and class that they define is public, without a list."""
FORMER = """
    AccuracyError Bifurcation Branch BudgetError ContactBody ContactProblem ContactRun ContactScene Cycle CycleError Differences Event
    EventExact Explicit Fit GrazingError Hysteresis Implicit Margins ObserverBasedController Observer OptionalQuantities OptionalQuantity Quantities Recording
    Relay Sensitivity SeverityMap Smoothing Sweep Takeover TaylorSeries TimeStepping Tuned UnusualValue WorkPrecision WorstCase ZenoError absorber_limit
    cycle_phases cycles linear overshoot performance_limit pole_locus press_contacts ramp reflection settling severity sine smoothed square step
    step_contacts stick_intervals triangle
"""
"""Names that `toolbox` itself once had."""


def in_stub(face):
    """{public name: (package or module, name there)} of the stub of a face."""
    tree = ast.parse(Path(face.__file__).with_suffix(".pyi").read_text())
    assert all(isinstance(node, ast.ImportFrom) and node.level == 1 for node in tree.body)
    return {alias.asname: (f"{face.__name__}.{node.module or ''}".rstrip("."), alias.name) for node in tree.body for alias in node.names}


@pytest.mark.parametrize("face", FACES, ids=lambda face: face.__name__)
def test_a_face_finds_every_public_name_where_its_stub_says_it_is(face):
    written = in_stub(face)
    assert face.__all__ == sorted(written.keys() - {"time", "__version__"}) and None not in written
    for public, (file, own) in written.items():
        home = importlib.import_module(file)
        module = hasattr(home, "__path__")
        assert getattr(face, public) is (importlib.import_module(f"{file}.{own}") if module else getattr(home, own)) and public in dir(face)
        hidden = not module and importlib.util.find_spec(f"{face.__name__}.{public}")
        assert not hidden, f"the file {public}.py hides the public name {public}: what imports the file first gets the module"
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        face.nothing  # noqa: B018
    assert not hasattr(face, "_nothing")


def test_the_files_of_the_face_for_authors_have_no_name_that_its_stub_leaves_out():
    homes = {file for file, _ in in_stub(authoring).values()}
    assert homes == {f"toolbox.authoring.{path.stem}" for path in Path(authoring.__file__).parent.glob("*.py")} - {
        "toolbox.authoring.__init__"
    }
    for home in homes:
        tree = ast.parse(Path(importlib.import_module(home).__file__).read_text())
        taken = {alias.asname for node in tree.body if isinstance(node, ast.ImportFrom) for alias in node.names}
        assert taken == {name for name, (file, _) in in_stub(authoring).items() if file == home}


@pytest.mark.parametrize("version", ["lowest", "newest"])
def test_all_public_names_are_there_on_the_lowest_and_on_the_newest_python_of_this_machine(root, tmp_path, version):
    python = subprocess.run([sys.executable, root / ".ci" / "interpreters.py", version], capture_output=True, text=True, timeout=60)
    if python.returncode:
        pytest.skip(python.stderr.strip())
    loader = Path(importlib.import_module("lazy_loader").__file__).parents[1]
    shutil.copytree(loader / "lazy_loader", tmp_path / "lazy_loader")  # the other packages are built for this Python
    code = "import toolbox, models, controllers\nfor face in (toolbox, models, controllers): print(face.__name__, *face.__all__, sep=',')"
    done = subprocess.run(
        [python.stdout.strip(), "-S", "-c", code],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(root), str(tmp_path)])},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.stdout.splitlines() == [",".join((face.__name__, *face.__all__)) for face in (toolbox, models, controllers)], done.stderr


def test_a_face_knows_its_names_where_there_is_no_source(tmp_path):
    shutil.copytree(Path(toolbox.__file__).parent, tmp_path / "toolbox", ignore=shutil.ignore_patterns("__pycache__"))
    compileall.compile_dir(tmp_path / "toolbox", quiet=2, legacy=True)  # beside the sources, which then go
    for path in (tmp_path / "toolbox").rglob("*.py"):
        path.unlink()
    code = "import toolbox; print(toolbox.__file__, toolbox.SceneError, len(toolbox.__all__))"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == [
        str(tmp_path / "toolbox" / "__init__.pyc"), "<class", "'toolbox.errors.SceneError'>", str(len(toolbox.__all__))
    ], done.stderr  # fmt: skip


def test_a_public_name_of_the_toolbox_has_one_home_and_users_need_few():
    homes = [(name, place.__name__) for place in (toolbox, *ROOMS) for name in public_names(place) if hasattr(place, "__all__")]
    homes += [(name, place.__name__) for place in MODULES for name in public_names(place) if name not in toolbox.__all__]
    names = [name for name, _ in homes if name not in ("sweep", "start_up")]  # shapes of an input, too, and always written `inputs.sweep`
    assert sorted(set(names)) == sorted(names)
    assert len([name for name in toolbox.__all__ if not inspect.ismodule(getattr(toolbox, name))]) <= 48


@pytest.mark.parametrize("name", FORMER.split())
def test_a_name_that_stands_in_a_room_is_refused_with_the_line_that_imports_it(name):
    with pytest.raises(ImportError, match=f"^`{name}` is in `toolbox") as refused:
        exec(f"from toolbox import {name}")
    found: dict[str, object] = {}
    exec(re.search(r"write `(.+)`\.$", str(refused.value))[1], found)
    assert found[name] is not None


@pytest.mark.parametrize("name", [FORMER.split()[0], "posterior", "no_such_name"])
def test_who_asks_whether_the_toolbox_has_a_name_of_a_room_is_told_that_it_has_not(name):
    assert not hasattr(toolbox, name) and getattr(toolbox, name, None) is None
    with pytest.raises(AttributeError, match=f"has no attribute '{name}'"):
        getattr(toolbox, name)


def test_modules_under_short_names_have_stubs_that_lead_to_them():
    stubs = [path for path in Path(toolbox.__file__).parent.glob("*.pyi") if path.stem != "__init__"]
    for path in stubs:
        assert path.read_text() == f"from {getattr(toolbox, path.stem).__name__} import *\n"
        module = importlib.import_module(f"toolbox.{path.stem}")
        room, _, own = module.__name__.rpartition(".")
        assert getattr(toolbox, path.stem) is module is getattr(importlib.import_module(room), own)
    assert {path.stem for path in stubs} == {"inputs", "measure", "plot"}


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
    """Whether an assignment at the top of a file, or below `else` there, is followed by a docstring."""
    top = ast.parse(path.read_text()).body
    bodies = [top, *(statement.orelse for statement in top if isinstance(statement, ast.If))]
    for statement, after in itertools.chain(*map(itertools.pairwise, bodies)):
        targets = statement.targets if isinstance(statement, ast.Assign) else []
        if any(isinstance(target, ast.Name) and target.id == name for target in targets):
            return isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str)
    return False


@pytest.mark.parametrize(("module", "name"), [(m, name) for m in (*FACES, *MODULES) for name in public_names(m)])
def test_every_public_name_is_documented(root, module, name):
    thing = getattr(module, name)
    if inspect.isclass(thing) or inspect.isroutine(thing) or inspect.ismodule(thing):
        own = vars(thing).get("__doc__") if inspect.isclass(thing) else thing.__doc__  # a class would inherit one
        assert (own or "").strip(), f"{module.__name__}.{name} needs a docstring of its own"
    else:
        assert any(commented(path, name) for path in sources(root, module.__name__.split(".")[0])), (
            f"{module.__name__}.{name} needs a docstring below it"
        )


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
