"""The page of a report in HTML: one file, no script, nothing that is fetched."""

from __future__ import annotations

import base64
import html
import itertools
from collections.abc import Iterable, Sequence
from importlib import resources

from toolbox.files.origin import Origin
from toolbox.files.printing import marked, table
from toolbox.reports.machine import laws, machine
from toolbox.reports.sections import Picture, Section, preformatted

POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
"""What a browser may load for the page: its own figures and its own style."""


def page(title: str, sections: Sequence[Section]) -> str:
    """The whole page: answers first, then the appendix."""
    numbers = itertools.count(1)
    dates = sorted({_date(each.origin) for each in sections if each.origin})
    style = resources.files("toolbox.reports").joinpath("report.css").read_text(encoding="utf-8")
    body = [
        f"<header><h1>{html.escape(title)}</h1>",
        f'<p class="of">{html.escape(", ".join(dict.fromkeys(each.kind for each in sections if each.kind)))}'
        + (f"; computed {html.escape(dates[0] if len(dates) == 1 else f'{dates[0]} to {dates[-1]}')}" if dates else "")
        + "</p></header><main>",
        *(_answer(title, each, numbers) for each in sections),
        *_laws(sections),
        '<section class="appendix"><h2>Appendix</h2>',
        *_machines(sections),
        *(_appendix(each, numbers) for each in sections),
        *_reproduce(sections),
        "</section></main>",
    ]
    return "\n".join(
        [
            "<!DOCTYPE html>",
            f'<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>',
            f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">',
            '<meta name="generator" content="stickslip report">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<style>\n{style}</style></head><body>",
            *body,
            "</body></html>\n",
        ]
    )


def _date(origin: Origin) -> str:
    return origin.began.replace("T", " ").replace("+00:00", " UTC")


def _answer(title: str, section: Section, numbers: Iterable[int]) -> str:
    own = "" if section.title == title else f": {html.escape(section.title)}"
    remarks = "".join(f'<p class="remark">{marked(each)}</p>' for each in section.remarks)
    heading = f"<h2>{html.escape(section.kind)}{own}</h2>"
    return f"<section>{heading}{section.answer}{remarks}{''.join(_figure(each, numbers) for each in section.pictures)}</section>"


def _figure(picture: Picture, numbers: Iterable[int]) -> str:
    """A figure, whose number is the next one."""
    number = next(iter(numbers))
    data = base64.b64encode(picture.content).decode()
    caption = html.escape(picture.caption)
    return (
        f'<figure><img src="data:{picture.kind};base64,{data}" alt="{caption}"><figcaption>Figure {number}. {caption}</figcaption></figure>'
    )


def _laws(sections: Sequence[Section]) -> list[str]:
    """The laws of each machine once, with what one types into the drive; of several machines each with the results that it belongs to."""
    found: dict[str, list[str]] = {}
    for section in sections:
        if any(loop.laws for _, loop in section.loops):
            found.setdefault(laws(section.loops), []).append(section.kind or section.title)
    of = [f"<h2>Laws of: {html.escape(', '.join(dict.fromkeys(kinds)))}</h2>" if len(found) > 1 else "" for kinds in found.values()]
    return [f"<section>{heading}{text}</section>" for heading, text in zip(of, found, strict=True)]


def _machines(sections: Sequence[Section]) -> list[str]:
    """Each machine once."""
    found: list[str] = []
    for section in sections:
        if section.loops:
            text = machine(section.loops[0][1])
            if text not in found:
                found.append(text)
    return [f"<h3>Machine</h3>{text}" for text in found]


def _appendix(section: Section, numbers: Iterable[int]) -> str:
    parts = []
    if section.more:
        parts.append(f"<h3>{html.escape(section.kind)}: further figures</h3>" + "".join(_figure(each, numbers) for each in section.more))
    if section.text:
        parts.append(f"<h3>{html.escape(section.kind)}: as printed</h3>{preformatted(section.text)}")
    return "".join(parts)


def _reproduce(sections: Sequence[Section]) -> list[str]:
    """Commands, inputs and versions, so that the same comes out again."""
    origins = [(section, section.origin) for section in sections if section.origin is not None]
    if not origins:
        return []
    parts = ["<h3>To get the same again</h3>", preformatted("\n".join(dict.fromkeys(each.command for _, each in origins)))]
    read = {name: told for _, each in origins for name, told in each.inputs.items()}
    files = [(str(section.folder), name, told) for section, each in origins for name, told in each.files.items()]
    versions = {f"{name} {version}": None for _, each in origins for name, version in each.versions.items()}
    took = [f"{section.kind}: {each.seconds:.3g} s, begun {_date(each)}" for section, each in origins]
    parts.append(f"<p>Versions: {html.escape(', '.join(versions))}.</p><p>{html.escape('; '.join(took))}.</p>")
    parts += ['<div class="files">', table("Files that were read", ("file", "SHA-256"), list(read.items()))]
    parts += [table("Files that were written", ("folder", "file", "SHA-256"), files), "</div>"]
    return parts
