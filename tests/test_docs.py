"""The documentation: every example runs, generated pages are up to date, and every page is reachable."""

import importlib.util
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))


def generator():
    spec = importlib.util.spec_from_file_location("generate", DOCS / "generate.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def blocks(path, language):
    return re.findall(rf"^```{language}\n(.*?)^```", path.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("path", [p for p in PAGES if blocks(p, "python")], ids=lambda path: path.stem)
def test_the_python_of_a_page_runs_from_top_to_bottom(path, capsys):
    names = {"__name__": "page"}
    for block in blocks(path, "python"):
        exec(compile(block, str(path), "exec"), names)


@pytest.mark.parametrize("path", [p for p in PAGES if blocks(p, "toml")], ids=lambda path: path.stem)
def test_the_toml_of_a_page_is_toml(path):
    for block in blocks(path, "toml"):
        assert tomllib.loads(block)


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
