"""The documentation: every example runs, generated pages are up to date, and every page is reachable."""

import dataclasses
import importlib
import importlib.util
import inspect
import os
import pkgutil
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
BLOCK = re.compile(r'^```([a-z]*)(?: title="([\w.]+)")?\n(.*?)^```$', re.DOTALL | re.MULTILINE)
RUNS = re.compile(r"^```(python|toml|console)", re.MULTILINE)
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def generator():
    spec = importlib.util.spec_from_file_location("generate", DOCS / "generate.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def blocks(path, language):
    return re.findall(rf"^```{language}\n(.*?)^```", path.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


def command(line, folder):
    """Run a line of a console block: `stickslip` and `python` of this environment; returns what it printed."""
    program, *arguments = shlex.split(line)
    prefix = {"stickslip": [sys.executable, "-m", "toolbox"], "python": [sys.executable]}[program]
    path = os.pathsep.join([str(folder), str(ROOT), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [*prefix, *arguments], cwd=folder, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, timeout=240
    )
    assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
    return done.stdout


def unprinted(told, printed):
    """Lines of a block behind an example that it did not print: with the same words, and numbers within a hundredth or two thousandths."""

    def parts(line):
        return " ".join(NUMBER.sub("#", line).split()), [float(each) for each in NUMBER.findall(line)]

    found = [parts(line) for line in printed.splitlines()]
    missing = []
    for line in told.splitlines():
        words, numbers = parts(line)
        same = [each for text, each in found if text == words]
        if words not in ("", "...") and not any(each == pytest.approx(numbers, rel=0.01, abs=2e-3) for each in same):
            missing.append(line)
    return missing


LONG = ("first_hour", "elastic_contact")


@pytest.mark.parametrize(
    "path",
    [pytest.param(p, marks=pytest.mark.slow if p.stem in LONG else ()) for p in PAGES if RUNS.search(p.read_text(encoding="utf-8"))],
    ids=lambda path: path.stem,
)
def test_a_page_runs_from_top_to_bottom_in_a_folder_of_its_own_and_prints_what_it_says(path, tmp_path, monkeypatch, capsys):
    """Python is executed, blocks with a title are files, lines of a console that begin with $ are commands; a block without a language
    behind an example is what that prints."""
    (tmp_path / "studies").symlink_to(ROOT / "studies", target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    modules = set(sys.modules)
    names, printed = {"__name__": "page"}, ""
    for language, title, text in BLOCK.findall(path.read_text(encoding="utf-8")):
        if title:
            (tmp_path / title).write_text(text, encoding="utf-8")
        elif language == "python":
            capsys.readouterr()
            exec(compile(text, str(path), "exec"), names)
            printed = capsys.readouterr().out
        elif language == "" and printed:
            assert not unprinted(text, printed), "measure it again"
        elif language == "console":
            for line in text.splitlines():
                if line.startswith("$ "):
                    command(line.removeprefix("$ "), tmp_path)
    for name in set(sys.modules) - modules:
        if getattr(sys.modules[name], "__file__", None) and Path(sys.modules[name].__file__).is_relative_to(tmp_path):
            del sys.modules[name]


@pytest.mark.parametrize("path", [p for p in PAGES if "```toml" in p.read_text(encoding="utf-8")], ids=lambda path: path.stem)
def test_the_toml_of_a_page_is_toml(path):
    for language, _, text in BLOCK.findall(path.read_text(encoding="utf-8")):
        assert language != "toml" or tomllib.loads(text)


def test_the_scene_of_the_documentation_can_be_simulated(tmp_path):
    from toolbox import Scene

    path = tmp_path / "scene.toml"
    path.write_text(blocks(DOCS / "concepts" / "scenes.md", "toml")[0])
    assert Scene.load(path).labels == ["soft torque"]


def test_reference_and_sources_follow_from_the_code():
    for path, text in generator().pages().items():
        assert path.read_text(encoding="utf-8") == text, "write it again: python docs/generate.py"


def test_every_doi_of_a_docstring_is_on_the_page_of_sources():
    page = (DOCS / "sources.md").read_text(encoding="utf-8")
    dois = set()
    for package in ("toolbox", "models", "controllers"):
        for path in (ROOT / package).rglob("*.py"):
            dois |= {doi.rstrip(".,;") for doi in re.findall(r"doi:(10\.[^\s,;]+)", path.read_text(encoding="utf-8"))}
    assert dois
    assert not [doi for doi in dois if doi not in page]


def test_every_page_is_in_the_navigation_and_every_link_leads_to_a_page():
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    for path in PAGES:
        assert f"{path.relative_to(DOCS).as_posix()}\n" in navigation + "\n"
        for target in re.findall(r"\]\(([^)#:\s]+\.md)", path.read_text(encoding="utf-8")):
            assert (path.parent / target).is_file(), f"{path.name} links to {target}"


PUBLIC = (
    *(
        "toolbox",
        "toolbox.authoring",
        "toolbox.measure",
        "toolbox.plot",
        "toolbox.inputs",
        "toolbox.steady_states.linear",
        "models",
        "controllers",
    ),
    *(f"toolbox.{room.name}" for room in pkgutil.iter_modules([str(ROOT / "toolbox")]) if room.ispkg),
)


def described(text, section):
    """Names that a NumPy section of a docstring describes."""
    found = re.search(rf"^{section}\n-+\n(.*?)(?=\n\n\S+\n-+\n|\Z)", text, re.DOTALL | re.MULTILINE)
    return [] if found is None else [name for line in found[1].splitlines() if line[:1].strip() for name in line.split(", ")]


def public_things():
    """(dotted name, function or class) of everything public that has a docstring, methods included."""
    for package in PUBLIC:
        module = importlib.import_module(package)
        for name in getattr(module, "__all__", None) or [name for name in vars(module) if not name.startswith("_")]:
            thing = getattr(module, name)
            if (inspect.isfunction(thing) or inspect.isclass(thing)) and thing.__module__.split(".")[0] in (
                "toolbox",
                "models",
                "controllers",
            ):
                yield f"{package}.{name}", thing
                members = vars(thing).items() if inspect.isclass(thing) else ()
                for key, member in members:
                    function = getattr(member, "__func__", member)
                    if inspect.isfunction(function) and not key.startswith("_") and function.__doc__:
                        yield f"{package}.{name}.{key}", function


def test_lists_of_parameters_and_attributes_name_those_that_there_are():
    lists = 0
    for name, thing in public_things():
        text = inspect.getdoc(thing) or ""
        if told := described(text, "Parameters"):
            lists += 1
            own = {each for each in inspect.signature(thing).parameters if each not in ("self", "cls")}
            assert len(told) == len(set(told)) and set(told) <= own, f"{name} describes {sorted(set(told) - own)}, which it does not take"
            assert own - set(told) <= {"former_names", "former_positional"}, f"{name} does not describe {sorted(own - set(told))}"
        if told := described(text, "Attributes"):
            own = (
                {field.name for field in dataclasses.fields(thing) if not field.name.startswith("_")}
                if dataclasses.is_dataclass(thing)
                else set()
            )
            assert own <= set(told), f"{name} does not describe {sorted(own - set(told))}"
            assert dataclasses.is_dataclass(thing) is False or all(each in own or hasattr(thing, each) for each in told), name
    assert lists > 60


def test_a_function_of_many_arguments_lists_them():
    for name, thing in public_things():
        if inspect.isfunction(thing) and len(set(inspect.signature(thing).parameters) - {"self", "cls"}) > 4:
            assert described(inspect.getdoc(thing) or "", "Parameters"), f"{name} must list its parameters in a NumPy section"
