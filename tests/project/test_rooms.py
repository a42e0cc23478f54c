"""The rooms of `toolbox`, and `models` and `controllers` above all that they build on: each imports only rooms below it, and no file is part of a circle."""

import ast
import importlib
import re
from collections import defaultdict
from pathlib import Path

import pytest

from toolbox.faces import public_names

FLOORS = (
    "version",
    "errors", "former_names", "vocabulary",
    "messages", "faces", "halving", "files", "arguments", "figures", "modelling", "compilation", "translation", "stepping",
    "simulation", "contacts", "measuring", "prediction", "steady_states", "logs",
    "scenes", "lanes", "orbits", "sweeps", "onsets", "robustness", "calibration", "probability", "tuning", "drilling", "export", "reports", "authoring",
    "models", "controllers",
    "page", "commands", "face",
)  # fmt: skip
"""Rooms from the ground up."""

LONGEST_FILE, LONGEST_FUNCTION, MOST_ARGUMENTS = 470, 90, 10
"""Lines of a file and of a function, docstrings apart, and arguments of a function."""

COMPILED_LOOPS = {
    "event_stepper.advance", "time_stepper._advance", "lanes/loop._run",
}  # fmt: skip
"""Event loops in machine code, as file.name: a call of them, and every argument of it, is paid for at each step."""
MORE_ARGUMENTS = {
    "tabulated_string.from_tables": 18,
    "fit.fit": 11,
    "inputs.start_up": 16,
    "onset.onset": 12,
    "tune.tune": 11,
    "drawn_borders.uncertain_onset": 11,
}
"""Functions, as file.name, that take what their users need to say, and how many arguments at most."""


PACKAGES = ("toolbox", "models", "controllers")


def room(path: Path) -> str:
    """The room of a file given by its path from the root of the project; `models` and `controllers` are rooms as a whole."""
    package, *inner = path.parts
    if package != "toolbox":
        return package
    return "face" if inner[0] in ("__init__.py", "__main__.py") else inner[0].removesuffix(".py")


@pytest.fixture(scope="module")
def imports():
    """{file: {(imported file, line)}} of the packages: at the top, inside functions and for types alike; a name of a face counts as its own file."""
    root = Path(__file__).parents[2]
    files = {
        ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path
        for package in PACKAGES
        for path in (root / package).rglob("*.py")
    }

    def home(module: str, name: str) -> str:
        stub = files[module].with_suffix(".pyi") if module in files else None
        found = stub is not None and stub.exists() and re.search(rf"^from \.([\w.]+) import \w+ as {name}$", stub.read_text(), re.MULTILINE)
        return home(f"{module}.{found[1]}", name) if found else f"{module}.{name}" if f"{module}.{name}" in files else module

    found = defaultdict(set)
    for path in files.values():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [home(node.module, alias.name) for alias in node.names]
            found[path.relative_to(root)] |= {(files[name].relative_to(root), node.lineno) for name in names if name in files}
    return found


def test_every_room_has_its_floor(imports):
    assert {room(path) for path in imports} == set(FLOORS)


def test_a_room_imports_only_rooms_below_it(imports):
    upwards = [
        f"{path}:{line} imports {target}: `{room(path)}` must not import `{room(target)}`, which is above it"
        for path, targets in imports.items()
        for target, line in targets
        if FLOORS.index(room(path)) < FLOORS.index(room(target))
    ]
    assert not upwards, "\n".join(sorted(upwards))


def test_no_files_import_one_another_in_a_circle(imports):
    above = {path: {target for target, _ in targets if target != path} for path, targets in imports.items()}
    while above:  # take away what imports nothing that is left
        free = [path for path, targets in above.items() if not targets & above.keys()]
        assert free, "these files import one another: " + ", ".join(sorted(map(str, above)))
        for path in free:
            del above[path]


def test_only_compilation_and_the_files_llvm_of_translation_know_llvm(root):
    instruction = re.compile(
        r"\b(?:alloca|getelementptr|f(?:add|sub|mul|div|neg|cmp)|phi|inttoptr|shufflevector)\b [^\"]*[{%]|\bbr (?:i1|label) "
    )
    writing, loading = set(), set()
    for path in (root / "toolbox").rglob("*.py"):
        text, place = path.read_text(encoding="utf-8"), path.relative_to(root / "toolbox").as_posix()
        if instruction.search(text) and room(path.relative_to(root)) != "compilation":
            writing.add(place)
        if re.search(r"^ *(?:import|from) llvmlite", text, re.MULTILINE):
            loading.add(place)
    assert writing == {"translation/llvm_language.py", "translation/llvm_module.py"}
    assert loading == {"compilation/emitter.py"}


def test_no_room_bears_the_name_of_a_public_function():
    import toolbox

    rooms = set(FLOORS) - {"version", "errors", "arguments", "messages", "halving", "authoring", "face"}
    assert not rooms & set(toolbox.__all__)


def functions(root):
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.FunctionDef):
                    yield path.relative_to(root), node


def compiled_loop(path, name):
    return any(
        path.with_suffix("").as_posix().endswith(each.rpartition(".")[0]) and name == each.rpartition(".")[2] for each in COMPILED_LOOPS
    )


def docstring_lines(node):
    """Lines of the docstring of a module, class or function; 0 without one."""
    first = node.body[0] if node.body else None
    text = first if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant) and isinstance(first.value.value, str) else None
    return text.end_lineno - text.lineno + 1 if text else 0


def lines_without_docstring(node):
    return node.end_lineno - node.lineno + 1 - docstring_lines(node)


def lines_without_docstrings(text):
    """Lines of a file less those of all its docstrings: examples and descriptions may be as long as their reader needs."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    return text.count("\n") - sum(docstring_lines(node) for node in ast.walk(ast.parse(text)) if isinstance(node, documented))


def test_files_and_functions_can_be_read_at_once(root):
    long = {path: lines for package in PACKAGES for path in (root / package).rglob("*.py")
            if (lines := lines_without_docstrings(path.read_text(encoding="utf-8"))) > LONGEST_FILE}  # fmt: skip
    assert not long
    large = [
        f"{path}: {node.name}"
        for path, node in functions(root)
        if lines_without_docstring(node) > LONGEST_FUNCTION and not compiled_loop(path, node.name)
    ]
    assert not large


def test_functions_take_few_arguments_unless_users_need_them(root):
    many = []
    for path, node in functions(root):
        count = sum(argument.arg not in ("self", "cls") for argument in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs))
        if count > MORE_ARGUMENTS.get(f"{path.stem}.{node.name}", MOST_ARGUMENTS) and not compiled_loop(path, node.name):
            many.append(f"{path}: {node.name} takes {count} arguments")
    assert not many, "\n".join(many)


@pytest.mark.parametrize("package", ["models", "controllers"])
def test_models_and_laws_import_only_what_is_public_in_the_toolbox_and_its_rooms(root, package):
    taken = set()
    for path in (root / package).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            place = f"{path.relative_to(root)}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] == "toolbox":
                public = {*public_names(importlib.import_module(node.module)), *(("time",) if node.module == "toolbox" else ())}
                assert node.module.count(".") <= 1, f"{place} imports from {node.module}, which is a file of a room"
                for alias in node.names:
                    assert alias.name in public, f"{place} imports {alias.name}, which is not public in {node.module}"
                    taken.add(alias.name)
            elif isinstance(node, ast.Import):
                assert not any(alias.name.split(".")[0] == "toolbox" for alias in node.names), f"{place} imports a module of the toolbox"
    assert len(taken) > 20
