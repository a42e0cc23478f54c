"""Tables of results: in HTML for notebooks, and as text."""

from __future__ import annotations

import dataclasses
import html
import math
import re
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass

from toolbox.vocabulary import Renamed


def table(title: str, headings: Sequence[str], rows: Iterable[Sequence[object]], notes: Iterable[str] = ()) -> str:
    """Return a table in HTML under a title, with notes below it.

    Parameters
    ----------
    title
        Title above the table.
    headings
        Names of the columns. If the sequence is empty, the result has only title and notes.
    rows
        Cells, one sequence per row. Floats are written with six digits. Numbers, also numbers that are given as text,
        are aligned right, and all other cells are aligned left. Characters such as "<" are escaped.
    notes
        Sentences below the table, by default none.

    Returns
    -------
    str
        The table in HTML.

    Examples
    --------
    >>> from toolbox.authoring import html_table
    >>> page = html_table("Hook load", ["operation", "hook load [kN]"], [["picking up", 1396]])
    >>> print(page.count("<tr>"))
    2
    """
    lines = ["<div>", f"<p><b>{marked(title)}</b></p>"]
    if headings:
        lines += _grid(headings, rows)
    lines += [f"<p>{marked(note)}</p>" for note in notes]
    return "\n".join([*lines, "</div>"])


def _grid(headings: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """The lines of a table in HTML without a title."""
    head = "".join(f'<th style="text-align:left">{html.escape(word)}</th>' for word in headings)
    body = ("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in rows)
    return ["<table>", f"<thead><tr>{head}</tr></thead>", "<tbody>", *body, "</tbody>", "</table>"]


def marked(text: str) -> str:
    """A sentence in HTML; names, which stand between backticks in text, in the type of code."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", html.escape(text))


def columns(rows: Sequence[Sequence[str]], left: Container[int] = (0,), indent: str = "  ") -> list[str]:
    r"""Return the lines of a text table, with two spaces between columns that are as wide as their longest cells.

    Parameters
    ----------
    rows
        Cells, one sequence per row. A row may have fewer cells.
    left
        Indices of columns that are aligned left, by default the first. All other columns are aligned right.
    indent
        Beginning of every line, by default two spaces.

    Returns
    -------
    list of str
        The lines.

    Examples
    --------
    >>> from toolbox.authoring import columns
    >>> print(*columns([["speed", "60", "rpm"], ["torque", "9.5", "kN m"]], left=(0, 2), indent=""), sep="\n")
    speed    60  rpm
    torque  9.5  kN m
    """
    widths = [max(len(row[i]) for row in rows if i < len(row)) for i in range(max(map(len, rows), default=0))]
    aligned = (
        [cell.ljust(w) if i in left else cell.rjust(w) for i, (cell, w) in enumerate(zip(row, widths, strict=False))] for row in rows
    )
    return [(indent + "  ".join(row)).rstrip() for row in aligned]


def shown(value: float, form: str = ".3g", unit: str = "") -> str:
    """Return the text of a number in a report, with its unit; "-" for nan."""
    return "-" if math.isnan(value) else f"{value:{form}}{unit}"


class Printed(Renamed):
    """A value that a notebook shows as it prints: the first line as its title, the rest as it stands in columns."""

    def _repr_html_(self) -> str:
        title, _, rest = str(self).partition("\n")
        return f"<div><p><b>{html.escape(title)}</b></p>" + (f"<pre>{html.escape(rest)}</pre>" if rest else "") + "</div>"


@dataclass(frozen=True)
class Rows:
    """A table in a printed value: its rows and the arguments for `columns`.

    headings: those of a table that is printed without any; without them the first row has the headings.
    """

    rows: Sequence[Sequence[str]]
    left: Container[int] = (0,)
    indent: str = "  "
    headings: Sequence[str] = ()

    @property
    def grid(self) -> list[str]:
        """The lines of the table in HTML."""
        return _grid(self.headings or self.rows[0], filter(None, self.rows if self.headings else self.rows[1:]))


class Told(Printed):
    """A value that describes itself in sentences and tables, with the same content in print, in a notebook and in a report."""

    def _told(self) -> Iterable[str | Rows]:
        """Its title, then sentences and tables; an empty sentence is an empty line where it is printed."""
        raise NotImplementedError

    def __str__(self) -> str:
        return "\n".join(
            line for part in self._told() for line in ([part] if isinstance(part, str) else columns(part.rows, part.left, part.indent))
        )

    def _repr_html_(self) -> str:
        title, *parts = self._told()
        lines = ["<div>", f"<p><b>{marked(str(title))}</b></p>"]
        for part in (each for each in parts if each):
            lines += [f"<p>{marked(part.strip())}</p>"] if isinstance(part, str) else part.grid
        return "\n".join([*lines, "</div>"])


class Declared:
    """A part or a law, which a notebook shows as a table of its fields with units and meanings."""

    def _repr_html_(self) -> str:
        rows = []
        for each in dataclasses.fields(self):  # type: ignore[arg-type]
            value = getattr(self, each.name)
            if value is None or (each.name == "name" and not value):
                continue
            shown = (
                ", ".join(f"{entry:.6g}" if isinstance(entry, float) else str(entry) for entry in value)
                if isinstance(value, tuple)
                else value
            )
            unit = each.metadata.get("unit", "")
            rows.append((each.name, shown, "" if unit == "1" else unit, each.metadata.get("meaning", "")))
        return table(type(self).__name__, ("field", "value", "unit", "meaning") if rows else (), rows)


def _cell(value: object) -> str:
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    try:
        number = text == f"{float(text)}" or text[-1:].isdigit()
    except ValueError:
        number = False
    return f'<td style="text-align:{"right" if number else "left"}">{html.escape(text)}</td>'
