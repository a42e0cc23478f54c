"""Where a table begins in the text or the sheet of a recorder, what parts its cells, and which lines are its headings and units."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from toolbox.errors import SceneError
from toolbox.files.tables import parted
from toolbox.logs.cells import UNITLESS, decimal_mark, is_unit, plain_number
from toolbox.logs.dates import is_time

MARKS = ("\t", ";", "|", ",", None)
"""What may part cells; None for spaces."""

LOOKED_AT = 400
"""Rows by whose cells the marks of a log are told."""

NONE = ("", "-", "--", "---", "nan", "na", "n/a", "null", "none", "#n/a", "nil", "no data", "bad", "missing", "***")
"""Cells by which a log says that there is no value, in small letters."""

_UNIT = re.compile(r"(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))\s*")


@dataclass
class Column:
    """A column of a log: its name, unit (None if the log has none), cells, and the numbers that stand for a missing value in this column
    only."""

    name: str
    unit: str | None
    cells: Any
    nulls: tuple[float, ...] = ()


@dataclass
class Source:
    """Columns of a log, and the notes of the log on them.

    bare: numbers without a unit are SI;  notes: what was found, in words;  mark: decimal mark of its text;  nulls: those it declares;  index: the column that
    it declares to be its time.
    """

    columns: list[Column]
    what: str
    bare: bool = False
    mark: str = "."
    notes: list[str] = field(default_factory=list)
    nulls: tuple[float, ...] = ()
    index: str | None = None


def named(heading: str) -> tuple[str, str | None]:
    """(name, unit) of a heading such as `WOB [klbf]` or `Torque (surface) (kN m)`; brackets that hold no unit are part of the name."""
    match = _UNIT.fullmatch(" ".join(heading.split()))
    inside = None if match is None else match[2] if match[2] is not None else match[3]
    if match is None or inside is None or not match[1] or not is_unit(inside):
        return " ".join(heading.split()), None
    return match[1], inside.strip().replace("-", "1") if inside.strip() in ("-", "") else inside.strip()


def of_text(text: str, where: str, decimal: str | None = None, names: Sequence[str] = ()) -> Source:
    """The columns of a table in text; names: headings that are asked for, by which the row of headings is told from a row of units.

    Raises SceneError where no table is found, it has no headings, or commas may be decimal as well as of thousands.
    """
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and not line.lstrip().startswith("#")]
    mark, width = _parted(lines, where)
    rows = _without_ends(_rows(lines, mark, where))
    seen = list(zip(*(row for row in rows[-LOOKED_AT:] if len(row) == width), strict=True))
    quoted = mark == "," and any(re.fullmatch(r"[+-]?\d+,\d+", cell) for cells in seen for cell in cells)
    point = decimal or ("." if mark == "," and not quoted else decimal_mark(seen))
    if point is None:
        either = next(cell for cells in seen for cell in cells if "," in cell)
        raise SceneError(f'{where} must tell thousands from decimals, but `{either}` may be either: give `decimal=","` or `decimal="."`.')
    cut = text[-1:] not in "\r\n" and _is_cut(rows, width, point)
    source = of_rows(rows[:-1] if cut else rows, where, point, names)
    if cut:
        source.notes.append(f"the last row left out: the file ends inside its last number, `{rows[-1][-1]}`")
    words = {"\t": "tabulators", ";": "semicolons", "|": "bars", ",": "commas", None: "spaces"}[mark]
    source.notes.insert(0, f"cells parted by {words}" + (", decimal comma" if point == "," else ""))
    return source


def _is_cut(rows: Sequence[Sequence[str]], width: int, mark: str) -> bool:
    """Whether a text without an end of its last line ends inside a number: all others of its column have the same places behind the mark, and it has fewer."""
    ends = [row[-1] for row in rows[-LOOKED_AT:] if len(row) == width and plain_number(row[-1], mark) == plain_number(row[-1], mark)]
    if len(ends) < 3 or len(rows[-1]) != width or rows[-1][-1] != ends[-1]:
        return False
    places = [len(cell.partition(mark)[2]) for cell in ends]
    usual, count = Counter(places[:-1]).most_common(1)[0]
    return count >= 0.9 * (len(places) - 1) and places[-1] < min(usual, 1 + min(places[:-1]))


def of_rows(rows: Sequence[Sequence[Any]], where: str, mark: str = ".", names: Sequence[str] = ()) -> Source:
    """The columns of a table in rows of cells, text or numbers: preamble, headings, units and data."""
    width, first, place, head, units = _headed(rows, where, mark, names)
    preamble = place
    data = rows[first:]
    whole = [row for row in data if len(row) == width]
    columns, there = [], Counter[str]()
    for i, heading in enumerate(head):
        name, unit = named(heading)
        if units is not None and unit is None:
            unit = "1" if units[i] in ("-", "1") else units[i] or None
        there[name] += 1
        if name:
            columns.append(Column(name if there[name] == 1 else f"{name} ({there[name]})", unit, [row[i] for row in whole]))
    notes = [f"{preamble} line(s) above the headings passed over"] if preamble > 0 else []
    notes += [f"`{name}` is there {count} times: the second is called `{name} (2)`" for name, count in there.items() if count > 1 and name]
    if len(whole) < len(data):
        notes.append(f"{len(data) - len(whole)} line(s) of another length than the others left out")
    return Source(columns, "table", mark=mark, notes=notes, nulls=_declared(rows[:first]))


def _headed(
    rows: Sequence[Sequence[Any]], where: str, mark: str, names: Sequence[str]
) -> tuple[int, int, int, list[str], list[str] | None]:
    """(columns, first row of data, row of the headings, headings, units of a line of their own)."""
    width = Counter(len(row) for row in rows[-LOOKED_AT:]).most_common(1)[0][0]
    first = _first_of_data(rows, width, mark)
    if first is None:
        raise SceneError(f"{where} must hold numbers below its headings, but no line of it has numbers in more than half of its cells.")
    if first == 0:
        raise SceneError(
            f"{where} must have a line of headings above its numbers, but it has none: write one, such as `time [s],speed [rpm]`."
        )
    above = [list(map(_heading, row)) for row in rows[:first]]
    place = _row_of_headings(above, width, names)
    head = above[place]
    units = next(([cell.strip("[]() ") for cell in row] for row in above[place + 1 :] if len(row) == width), None)
    if len(head) != width:
        raise SceneError(f"{where} must have a heading for each of its {width} columns, but the line above the numbers has {len(head)}.")
    return width, first, place, head, units


def _row_of_headings(above: Sequence[Sequence[str]], width: int, names: Sequence[str]) -> int:
    """The row with all names asked for; without such a row the last one, or the one before it if the last one holds units."""
    asked = {" ".join(name.split()).casefold() for name in names}
    for k in range(len(above) - 1, max(-1, len(above) - 4), -1):
        there = {form.casefold() for cell in above[k] for form in (" ".join(cell.split()), named(cell)[0])}
        if asked and len(above[k]) == width and asked <= there and (k == len(above) - 1 or not _data_like(above[k + 1 :], width)):
            return k
    last = len(above) - 1
    if last > 0 and len(above[last - 1]) == len(above[last]) == width and _are_units(above[last]):
        full = [sum(map(bool, row)) for row in (above[last - 1], above[last])]
        if full[0] >= full[1]:
            return last - 1
    return last


def _data_like(rows: Sequence[Sequence[str]], width: int) -> bool:
    """Whether rows between headings and data hold neither units nor words for them, but are longer than two or of another width."""
    return len(rows) > 2 or any(len(row) != width for row in rows)


def _heading(cell: Any) -> str:
    return "" if cell is None or cell != cell else str(cell).strip().strip("\ufeff").strip('"')


def _declared(above: Sequence[Sequence[Any]]) -> tuple[float, ...]:
    """Numbers that lines above the headings declare to mean no value."""
    found = (
        re.search(r"\b(?:null|no ?data|missing)\b[^\d+-]*([+-]?\d+(?:\.\d+)?)", " ".join(map(_heading, row)), re.IGNORECASE)
        for row in above
    )
    return tuple(float(match[1]) for match in found if match)


def _are_units(cells: Sequence[str]) -> bool:
    """Whether most of the cells that are not empty are units, formats of dates, or words that stand for none."""
    given = [cell.strip("[]() ") for cell in cells if cell]
    dates = re.compile(r"[ymdhs:./\- tfZ]+", re.IGNORECASE)
    good = sum(cell.lower() in UNITLESS or is_unit(cell) or dates.fullmatch(cell) is not None for cell in given)
    return 2 * good > len(given)


def _rows(lines: Sequence[tuple[int, str]], mark: str | None, where: str) -> list[list[str]]:
    return [line.split() for _, line in lines] if mark is None else list(parted(lines, mark, where))


def _without_ends(rows: list[list[str]]) -> list[list[str]]:
    """The rows without the empty cell behind a mark that stands at the end of every line."""
    if len(rows) > 2 and all(not row[-1] for row in rows[-LOOKED_AT:] if row):
        return [row[:-1] if row and not row[-1] else row for row in rows]
    return rows


def _is_value(cell: Any, mark: str) -> bool:
    return isinstance(cell, (int, float)) or plain_number(cell, mark) == plain_number(cell, mark) or is_time(cell)


def _parted(lines: Sequence[tuple[int, str]], where: str) -> tuple[str | None, int]:
    """(what parts the cells, how many there are in a row): what gives most cells that are numbers in rows of one length."""
    last = lines[-LOOKED_AT:]
    best: tuple[float, str | None, int] = (0.0, None, 0)
    for mark in MARKS:
        rows = _without_ends([row for line in last for row in _rows([line], mark, where)])
        width, count = Counter(map(len, rows)).most_common(1)[0] if rows else (0, 0)
        if width < 2:
            continue
        cells = [cell for row in rows if len(row) == width for cell in row]
        good = sum(cell.lower() in NONE or _is_value(cell, "." if mark == "," else ",") or _is_value(cell, ".") for cell in cells)
        # a time with a blank is two cells that are numbers where blanks part: beside w columns of words and v of values a gain of
        # w / ((v + w + 1)(v + w + 2)), at most 0.1
        score = good / len(cells) * count / len(rows) - (0.12 if mark is None else 0.02 if mark == "," else 0.0)
        if score > best[0] + 1e-9:
            best = score, mark, width
    if best[0] < 0.3:
        raise SceneError(
            f"{where} must hold a table of numbers whose cells are parted by commas, semicolons, tabulators or spaces, but none was found."
        )
    return best[1], best[2]


def _first_of_data(rows: Sequence[Sequence[Any]], width: int, mark: str) -> int | None:
    """The first row that holds values: of the width of most, and more than half of its cells that say a value are numbers or times."""
    for k, row in enumerate(rows):
        cells = [cell for cell in row if _heading(cell).lower() not in NONE]
        if len(row) == width and cells and sum(_is_value(cell, mark) for cell in cells) > 0.5 * len(cells):
            return k
    return None
