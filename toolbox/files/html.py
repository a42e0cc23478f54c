"""Tables in HTML, as notebooks show results."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence


def table(title: str, headings: Sequence[str], rows: Iterable[Sequence[object]], notes: Iterable[str] = ()) -> str:
    """Return a table in HTML under a title, with notes below it.

    Parameters
    ----------
    title
        What stands above the table.
    headings
        Names of the columns; without any, title and notes stand alone.
    rows
        Cells, one sequence per row. Floats are written with six digits; numbers, also those written as text, stand at the right, and everything else at
        the left. No character is read as HTML.
    notes
        Sentences that stand below the table.
    """
    lines = ["<div>", f"<p><b>{html.escape(title)}</b></p>"]
    if headings:
        lines += [
            "<table>",
            "<thead><tr>" + "".join(f'<th style="text-align:left">{html.escape(word)}</th>' for word in headings) + "</tr></thead>",
        ]
        lines += ["<tbody>", *("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in rows), "</tbody>", "</table>"]
    lines += [f"<p>{html.escape(note)}</p>" for note in notes]
    return "\n".join([*lines, "</div>"])


def _cell(value: object) -> str:
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    try:
        number = text == f"{float(text)}" or text[-1:].isdigit()
    except ValueError:
        number = False
    return f'<td style="text-align:{"right" if number else "left"}">{html.escape(text)}</td>'
