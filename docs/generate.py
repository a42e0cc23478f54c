"""Write the pages that follow from the code: the reference of public names, the keys of a scene file, and the sources that docstrings cite.

python docs/generate.py          (a test says when the pages are no longer up to date)
"""

from __future__ import annotations

import ast
import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path

FOLDER = Path(__file__).parent
ROOT = FOLDER.parent
PACKAGES = {
    "toolbox": "The language: plants, contacts, simulation, analysis.",
    "models": "Physics: one mechanism per file.",
    "controllers": "Control laws and observers.",
}
AUTHORS = {
    "toolbox.authoring": "What parts, laws and packages of your own build on, beside the names of `toolbox` itself. "
    "It changes only with a line in the changelog.",
}
_ENDS = r"(?=[.;] (?:Range|range|Defaults?|Assumed|Raises|Signals|Accuracy|Without|Sampled|Exact|Why|Where|The|A(?= [a-z])|It|With|Their|They)\b|$)"
_SOURCE = re.compile(r"\bSources?: (.+?)" + _ENDS)
_CITED = re.compile(r"((?:[A-Z]\. ?)+[A-Z][a-z][^:;]*?\(\d{4}\)(?: \d+(?:-\d+)?)?(?:, doi:10\.[^\s,;]+)?)")
_DOI = re.compile(r"doi:(10\.[^\s,;]+)")


def docstrings() -> Iterator[tuple[str, str]]:
    """(dotted name, paragraph in one line) of the docstrings of every module, class and function of the packages."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            module = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
            tree = ast.parse(path.read_text(encoding="utf-8"))
            for node in [tree, *ast.walk(tree)]:
                if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and not (
                    isinstance(node, ast.Module) and node is not tree
                ):
                    text = ast.get_docstring(node)
                    if text:
                        name = module if node is tree else f"{module}.{node.name}"  # type: ignore[union-attr]
                        yield from ((name, " ".join(paragraph.split())) for paragraph in re.split(r"\n\s*\n", text))


def cited() -> dict[str, list[str]]:
    """{dotted name: sources that its docstring cites}, textbooks without a name left out."""
    found: dict[str, list[str]] = {}
    for name, text in docstrings():
        spans = [match[1].rstrip(".; ") for match in _SOURCE.finditer(text)]
        spans += [match[1].rstrip(".;,") for match in _CITED.finditer(text) if not any(match[1].rstrip(".;,") in span for span in spans)]
        spans = [span for span in spans if not re.fullmatch(r"textbook|as `.*`", span) and "`{" not in span]
        if spans:
            found.setdefault(name, []).extend(span for span in spans if span not in found.get(name, []))
    return found


def sources_page() -> str:
    """The page of sources: publications with a DOI first, then what every part cites."""
    rows = cited()
    dois: dict[str, list[str]] = {}
    for name, spans in rows.items():
        for span in spans:
            for doi in _DOI.findall(span):
                dois.setdefault(doi.rstrip("."), []).append(name)
    lines = [
        "# Sources",
        "",
        "Made from the docstrings by `python docs/generate.py`. A source that is only named by authors and year is cited so where it is used.",
        "",
        "## With a DOI",
        "",
        "| DOI | cited by |",
        "|---|---|",
    ]
    lines += [
        f"| [{doi}](https://doi.org/{doi}) | {', '.join(f'`{name}`' for name in sorted(set(names)))} |"
        for doi, names in sorted(dois.items())
    ]
    lines += ["", "## By part", "", "| part | source |", "|---|---|"]
    lines += [f"| `{name}` | {span.replace('|', chr(92) + '|')} |" for name, spans in sorted(rows.items()) for span in spans]
    return "\n".join(lines) + "\n"


def reference_page(package: str, says: str) -> str:
    """The page of the public names of a package or module, for mkdocstrings."""
    module = importlib.import_module(package)
    lines = [f"# {package}", "", says, ""]
    hidden = {"toolbox": ["time"]}.get(package, [])  # public, but in no star import
    for name in sorted([*module.__all__, *hidden], key=str.lower):
        lines += [f"::: {package}.{name}", ""]
    return "\n".join(lines)


def scene_page() -> str:
    """The page of the keys of a scene file."""
    keys = importlib.import_module("toolbox.scenes.keys")
    lines = ["# Keys of a scene file", "", "Numbers are SI, or text with a unit. `stickslip list scene` prints this page on a terminal.", ""]
    for table, entries in keys.KEYS.items():
        lines += [f"## {'At the head of the file' if table == 'scene' else f'`{table}`'}", "", "| key | unit | without it | meaning |", "|---|---|---|---|"]
        lines += [f"| `{key.name}` | {key.unit} | {key.default} | {key.meaning} |" for key in entries]
        lines.append("")
    return "\n".join(lines)


def pages() -> dict[Path, str]:
    """{path: text} of every generated page."""
    references = {
        FOLDER / "reference" / f"{name.rpartition('.')[2]}.md": reference_page(name, says) for name, says in (PACKAGES | AUTHORS).items()
    }
    return {FOLDER / "sources.md": sources_page(), FOLDER / "reference" / "scene.md": scene_page(), **references}


def main() -> None:
    """Write the pages."""
    for path, text in pages().items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    main()
