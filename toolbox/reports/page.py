"""The page of a report in HTML: one file, no script, nothing that is fetched. Its parts stand in `report.html.j2`, which escapes every text."""

from __future__ import annotations

import base64
import itertools
from collections.abc import Sequence
from importlib import resources
from typing import Any

from toolbox.files.origin import Origin
from toolbox.files.printing import marked, table
from toolbox.reports.first_page import first_page
from toolbox.reports.machine import laws, machine
from toolbox.reports.sections import Section, preformatted

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
"""What a browser may load for the page: its own figures and its own style."""


def page(title: str, sections: Sequence[Section]) -> str:
    """The whole page: the first page, the answers, then the appendix."""
    import jinja2  # here, because only a report needs it
    from markupsafe import Markup

    home = resources.files("toolbox.reports")
    pages = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, keep_trailing_newline=True)
    pages.filters |= {"base64": lambda content: base64.b64encode(content).decode()}
    pages.filters |= {"marked": lambda text: Markup(marked(text)), "preformatted": lambda text: Markup(preformatted(str(text)))}
    of: dict[str, list[str]] = {}  # the laws of each machine once, with what one types into the drive, and the results that they belong to
    for section in sections:
        if any(loop.controllers for _, loop in section.loops):
            of.setdefault(laws(section.loops), []).append(section.kind or section.title)
    sentences, glance = first_page([section.findings for section in sections if section.findings is not None])
    return pages.from_string(home.joinpath("report.html.j2").read_text(encoding="utf-8")).render(
        title=title, sentences=sentences, glance=glance,
        policy=POLICY, style=Markup(home.joinpath("report.css").read_text(encoding="utf-8")), sections=sections, controllers=of,
        kinds=list(dict.fromkeys(each.kind for each in sections if each.kind)), dates=sorted({_date(each.origin) for each in sections if each.origin}),
        numbers=itertools.count(1), next=next, machines=list(dict.fromkeys(machine(each.loops[0][1]) for each in sections if each.loops)), **_origins(sections),
    )  # fmt: skip


def _date(origin: Origin) -> str:
    return origin.began.replace("T", " ").replace("+00:00", " UTC")


def _origins(sections: Sequence[Section]) -> dict[str, Any]:
    """Commands, inputs and versions, so that the same comes out again."""
    origins = [(section, section.origin) for section in sections if section.origin is not None]
    read = {name: told for _, each in origins for name, told in each.inputs.items()}
    files = [(str(section.folder), name, told) for section, each in origins for name, told in each.files.items()]
    return {
        "origins": [each for _, each in origins],
        "versions": list(dict.fromkeys(f"{name} {version}" for _, each in origins for name, version in each.versions.items())),
        "took": [f"{section.kind}: {each.seconds:.3g} s, begun {_date(each)}" for section, each in origins],
        "read": table("Files that were read", ("file", "SHA-256"), list(read.items())),
        "files": table("Files that were written", ("folder", "file", "SHA-256"), files),
    }
