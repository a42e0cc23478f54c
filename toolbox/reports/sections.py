"""Sections of a report: what one result answers, with its figures (`toolbox.reports.figures`), its machine and where it comes from."""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from toolbox.drilling.answer_results import Answers
from toolbox.errors import SceneError
from toolbox.reports.figures import Picture, figures_of_result
from toolbox.reports.first_page import Findings, of_answers
from toolbox.reports.machine import usual_units

if TYPE_CHECKING:
    from pathlib import Path

    from toolbox.files.origin import Origin
    from toolbox.modelling.closed_loop import ClosedLoop


@dataclass(frozen=True)
class Section:
    """What one result says on a page.

    Attributes
    ----------
    title
        What it is about.
    kind
        What was asked, in a word or two; empty where the title says it.
    answer
        Its answer in HTML.
    pictures
        Figures that belong to the answer.
    more
        Figures for the appendix.
    text
        What the command printed.
    loops
        {label: closed loop} of its machine.
    origin, folder
        Where it comes from, and the folder that it was read from.
    remarks
        What the reader should know: what failed, or is not known.
    findings
        Its verdicts as values, for the first page; None if it has none.
    """

    title: str
    kind: str
    answer: str
    pictures: tuple[Picture, ...] = ()
    more: tuple[Picture, ...] = ()
    text: str = ""
    loops: tuple[tuple[str, ClosedLoop], ...] = ()
    origin: Origin | None = None
    folder: Path | None = None
    remarks: tuple[str, ...] = ()
    findings: Findings | None = None


def of_result(result: Any) -> Section:
    """Return the section of a result that can print itself, with its plot if it has one.

    Raises SceneError for what is no result.
    """
    if not hasattr(result, "plot") and not hasattr(result, "_repr_html_"):
        raise SceneError(
            f"Argument `results` must be folders of results, or results that print and plot themselves, but one is {result!r}."
        )
    loop = getattr(result, "loop", None) or getattr(getattr(result, "run", None), "loop", None)
    with usual_units(loop):
        text = str(result)
        first, _, rest = text.strip().partition("\n")
        label = getattr(loop, "label", None) or "closed loop"
        return Section(
            getattr(result, "title", None) or first,
            type(result).__name__,
            result._repr_html_() if hasattr(result, "_repr_html_") else preformatted(rest or first),
            figures_of_result(result, first),
            text=text,
            loops=((label, loop),) if loop is not None else (),
            findings=of_answers(result) if isinstance(result, Answers) else None,
        )


def preformatted(text: str) -> str:
    """Text with its columns, in HTML."""
    return f"<pre>{html.escape(text.strip(chr(10)))}</pre>"
