"""Rates of two faults of prose, of the pages and of the docstrings: words that point in place of naming, and paragraphs that a reader has to read twice.

Rates of whole texts, which may only fall: never a verdict on a sentence, nor a limit on its length. Every other text, such as code, is left out.
"""

import ast
import inspect
import re
from pathlib import Path

import pytest

from tests.public import PUBLIC, docstring

ROOT = Path(__file__).parents[2]

POINTERS = re.compile(r"\b(what|where|which|whose|that|those|these|this|it|its|they|them|their|one|ones|such|so|there)\b", re.IGNORECASE)
FAULTS = tuple(
    map(
        re.compile,
        (
            r"\b[Ww]hat\b(?![^.]*\?)",
            r"\b(by|of|from|in|on|at|to|for|with|behind|between|after|under|over|through)\s+(which|whom|whose|what|where)\b",
            r"(?:^|[.;:]\s+)(It|They|This|That|These|Those|Its|Their|Such|One)\b",
            r"\bwhere\b",
            r"\b(that|those|the one|the ones|one) (of|that|which|where)\b",
        ),
    )
)
"""`what` as a noun, a fronted clause, a sentence that begins with a pronoun, `where`, and `that of`."""

DENSE, LONG = 0.085, 30
"""Share of pointers, and words of a sentence, that count as one of the faults."""

MOST = {"docs": (4.3, 8.6), "docstrings": (6.9, 5.0), "public docstrings": (5.0, 0.8)}
"""{text: (pointers in 100 words, flagged paragraphs in 100)}, numbers that may only fall."""


def paragraphs(path):
    """Paragraphs of prose of a page: no code, tables, headings and pictures."""
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    return [
        each for each in re.split(r"\n\s*\n", text) if each.strip() and not each.lstrip().startswith(("#", "|", "!", "<", ":::", "---"))
    ]


def docstrings():
    """First paragraphs of the docstrings of all functions and classes without an underscore, also of rooms that are not public."""
    for package in ("toolbox", "models", "controllers"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if (
                    isinstance(node, (ast.FunctionDef, ast.ClassDef))
                    and not node.name.startswith("_")
                    and (text := ast.get_docstring(node))
                ):
                    yield re.split(r"\n\s*\n", text)[0]


def public_docstrings():
    """First paragraphs of the docstrings of what is reachable through the faces: functions, classes and their methods."""
    for thing in PUBLIC.values():
        yield docstring(thing)
        for name, member in vars(thing).items() if inspect.isclass(thing) else ():
            function = getattr(member, "fget", None) or getattr(member, "func", None) or getattr(member, "__func__", member)
            if inspect.isfunction(function) and not name.startswith("_") and function.__doc__:
                yield inspect.cleandoc(function.__doc__)


TEXTS = {
    "docs": lambda: [each for path in sorted((ROOT / "docs").rglob("*.md")) if "reference" not in path.parts for each in paragraphs(path)],
    "docstrings": lambda: list(docstrings()),
    "public docstrings": lambda: [re.split(r"\n\s*\n", text)[0] for text in public_docstrings()],
}


def flagged(text):
    """Whether a paragraph has two of the faults or more."""
    words = re.sub(r"`[^`]*`", "N", text).split()
    dense = len(words) >= 8 and len(POINTERS.findall(text)) / len(words) > DENSE
    long = any(len(sentence.split()) > LONG for sentence in re.split(r"(?<=[.!?])\s+", text))
    return sum(fault.search(text) is not None for fault in FAULTS) + dense + long >= 2


def rates(texts):
    """(pointers in 100 words, flagged texts in 100)."""
    texts = [each for each in (" ".join(text.split()) for text in texts) if each]
    words, pointers = sum(len(text.split()) for text in texts), sum(len(POINTERS.findall(text)) for text in texts)
    return 100 * pointers / words, 100 * sum(map(flagged, texts)) / len(texts)


def test_the_rates_tell_a_text_that_points_from_one_that_names():
    points = "What was made small. It is that of which the law where it acts knows."
    names = "Objectives that were minimised, and their units."
    assert flagged(points) and not flagged(names)
    assert rates([points])[0] > 30 and rates([points, names])[1] == pytest.approx(50)


@pytest.mark.parametrize("name", MOST)
def test_pointers_and_flagged_paragraphs_become_fewer(name):
    found, most = rates(TEXTS[name]()), MOST[name]
    told = f"{name}: {found[0]:.2f} pointers in 100 words, {found[1]:.1f} % of the paragraphs flagged; at most {most[0]} and {most[1]}"
    assert found[0] <= most[0] and found[1] <= most[1], told
