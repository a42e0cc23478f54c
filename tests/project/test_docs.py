"""The documentation: every example runs, generated pages are up to date, and every page is reachable."""

import importlib.util
import os
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
BLOCK = re.compile(r'^```(python|toml|console)(?: title="([\w.]+)")?\n(.*?)^```', re.DOTALL | re.MULTILINE)


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


@pytest.mark.timeout(300)  # commands are processes of their own, and import everything anew
@pytest.mark.parametrize("path", [p for p in PAGES if BLOCK.search(p.read_text(encoding="utf-8"))], ids=lambda path: path.stem)
def test_a_page_runs_from_top_to_bottom_in_a_folder_of_its_own(path, tmp_path, monkeypatch):
    """Python is executed, blocks with a title are files, lines of a console that begin with $ are commands."""
    (tmp_path / "studies").symlink_to(ROOT / "studies", target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    modules = set(sys.modules)
    names = {"__name__": "page"}
    for language, title, text in BLOCK.findall(path.read_text(encoding="utf-8")):
        if title:
            (tmp_path / title).write_text(text, encoding="utf-8")
        elif language == "python":
            exec(compile(text, str(path), "exec"), names)
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
