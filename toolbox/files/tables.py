"""Tables of numbers with units, from CSV or TOML, read at the border: every mistake is an error that names file, row and column. CSV is written, too.

A CSV file has one line of headings, each with its unit in brackets (`length [m]`, `OD [in]`; none for text and plain numbers), and one line per row,
parted by commas, semicolons or tabulators. Blank lines at the end and lines that begin with # are left out. A TOML file holds one array of
tables; its keys are the same headings with plain numbers, or bare names whose values are text with a unit, or numbers in SI.
A heading that begins with # marks a column that is not read.
"""

from __future__ import annotations

import csv
import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toolbox.errors import SceneError, joined, suggest
from toolbox.files.reading import SCENE, text_of

LARGEST = 8 * 2**20
"""Bytes of the largest table that is read: a row takes about thirty times its text."""

MOST_LINES = 20
"""Lines over which one cell between quotation marks may go on."""

_HEADING = re.compile(r"\s*([^\[\]]*?)\s*(?:\[\s*([^\[\]]*?)\s*\])?\s*")


@dataclass(frozen=True)
class Column:
    """A column that a table file may have.

    Attributes
    ----------
    name, unit
        Name of the column, and SI unit of its numbers. None for text.
    also
        Other names that the heading may have.
    required
        Whether the table must have this column, by default True.
    blank
        Whether cells may be empty, by default False.

    Examples
    --------
    >>> from toolbox.authoring import Column
    >>> print(Column("OD", "m", also=("outer diameter",)).also)
    ('outer diameter',)
    """

    name: str
    unit: str | None
    also: tuple[str, ...] = ()
    required: bool = True
    blank: bool = False


@dataclass(frozen=True)
class Table:
    """Rows of a table file, each as {column: number in SI, or text}, the result of `read_table`. `places` holds the
    position of each row in the file, for error messages.

    Examples
    --------
    >>> from pathlib import Path
    >>> from toolbox.authoring import Column, read_table
    >>> _ = Path("sections.csv").write_text("name,OD [in]\\npipe,5\\n")
    >>> table = read_table("sections.csv", [Column("name", None), Column("OD", "m")])
    >>> print(len(table.rows), "row,", round(table.rows[0]["OD"], 3), "m")
    1 row, 0.127 m
    """

    path: Path
    rows: tuple[Mapping[str, Any], ...]
    places: tuple[str, ...]
    headings: Mapping[str, str]

    def __iter__(self) -> Iterator[Mapping[str, Any]]:
        return iter(self.rows)

    def error(self, row: int, column: str, words: str) -> SceneError:
        """Return the SceneError for a wrong cell. Its message names the position of the row and the heading of the column.

        Parameters
        ----------
        row
            Index of the row, counted from 0.
        column
            Name of the column.
        words
            Description of a correct value of the cell.
        """
        return _fault(self.path, self.places[row], self.headings.get(column, column), words)


def read(path: str | Path, columns: Sequence[Column], *, others: bool = False) -> Table:
    r"""Read the table in a CSV or TOML file, with its numbers in SI.

    Parameters
    ----------
    path
        The file.
    columns
        The columns that the table may have.
    others
        Whether unknown columns are left out instead of refused, by default False.

    Returns
    -------
    Table
        The table, with at least one row.

    Raises
    ------
    SceneError
        If the file cannot be read or is empty, a required column is missing, a column is unknown or occurs twice, a
        unit is missing or does not fit, a cell is empty or no finite number, or a row has another length than the
        headings.

    Examples
    --------
    >>> from pathlib import Path
    >>> from toolbox.authoring import Column, read_table
    >>> _ = Path("sections.csv").write_text("name,OD [in]\npipe,5\n")
    >>> for row in read_table("sections.csv", [Column("name", None), Column("OD", "m")]):
    ...     print(row["name"], f"{row['OD']:.3f} m")
    pipe 0.127 m
    """
    path = Path(path)
    toml = path.suffix.lower() == ".toml"
    text = text_of(path, SCENE if toml else LARGEST, "table")
    named = {name.casefold(): column for column in columns for name in (column.name, *column.also)}
    rows = _toml(path, text) if toml else _csv(path, text)
    if not rows:
        raise SceneError(f"Table `{path}` must have at least one row, but it is empty.")
    found: list[dict[str, Any]] = []
    headings: dict[str, str] = {}
    for place, cells in rows:
        values: dict[str, Any] = {}
        for heading, cell in cells.items():
            if heading.lstrip().startswith("#"):
                continue
            match = _HEADING.fullmatch(heading)
            column = named.get(" ".join(match[1].split()).casefold()) if match else None
            if column is None and others:
                continue
            if column is None or match is None:
                known = [c.name for c in columns]
                raise SceneError(f"Table `{path}` has the unknown column `{heading}`: {suggest(match[1] if match else heading, known)}")
            if column.name in values:
                raise SceneError(
                    f"Table `{path}` must have the column `{column.name}` once, but `{heading}` is there beside `{headings[column.name]}`."
                )
            headings[column.name] = heading
            values[column.name] = _value(path, place, heading, match[2], column, cell)
        for column in columns:
            if column.required and column.name not in values:
                unit = f" [{column.unit}]" if column.unit not in (None, "1") else ""
                where = f"Table `{path}`" if path.suffix.lower() != ".toml" else f"Table `{path}`, {place},"
                there = joined(cells)
                raise SceneError(f"{where} must have a column `{column.name}{unit}`, but it has {there}.")
        found.append(_filled(values))
    return Table(path, tuple(found), tuple(place for place, _ in rows), headings)


def parted(lines: Iterable[tuple[int, str]], mark: str, where: str) -> Iterator[list[str]]:
    """Yield the cells of every row in lines of text.

    Parameters
    ----------
    lines
        Number and text of every line. A cell between quotation marks may go on over a few of them.
    mark
        Text that parts the cells.
    where
        The file, as the error names it.

    Raises
    ------
    SceneError
        If a quotation mark opens a cell and none closes it, so that one cell would take the rows below it; the message names the line.
    """
    first, taken = 1, 0

    def counted() -> Iterator[str]:
        nonlocal first, taken
        for number, line in lines:
            if taken == 0:
                first = number
            taken += 1
            if taken > MOST_LINES:
                raise csv.Error
            yield line

    try:
        for row in csv.reader(counted(), delimiter=mark):
            taken = 0
            yield [cell.strip() for cell in row]
    except csv.Error:
        raise SceneError(
            f"{where}, line {first}: a cell that a quotation mark opens must be closed by another within {MOST_LINES} lines and "
            f"{csv.field_size_limit()} characters, but it is not."
        ) from None


def heading(name: str, unit: str) -> str:
    """A name with its unit in brackets, as a column is headed; a plain number has none."""
    return name if unit in ("", "1") else f"{name} [{unit}]"


def write(path: str | Path, headings: Sequence[str], rows: Iterable[Sequence[Any]]) -> Path:
    """Write a table as CSV, whole or not at all; numbers keep every digit, and a number that does not exist (nan, None) is an empty cell. Returns the path."""
    import io

    from toolbox.files.atomic import replaced

    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(headings)
    table.writerows(["" if cell is None or cell != cell else cell for cell in row] for row in rows)
    with replaced(Path(path)) as file:
        file.write(text.getvalue().encode())
    return Path(path)


def _filled(values: Mapping[str, Any]) -> dict[str, Any]:
    """The cells of a row that are not blank."""
    return {name: value for name, value in values.items() if value is not None}


def _fault(path: Path, place: str, heading: str, words: str) -> SceneError:
    return SceneError(f"Table `{path}`, {place}, column `{heading}`: {words}")


def _csv(path: Path, text: str) -> list[tuple[str, dict[str, Any]]]:
    """(place, {heading: cell}) of every row."""
    lines = [(number, line) for number, line in enumerate(text.splitlines(), 1) if not line.lstrip().startswith("#")]
    while lines and not lines[-1][1].strip(" \t,;"):
        lines.pop()
    if not lines:
        return []
    head = lines[0][1]
    mark = max(",;\t", key=head.count)
    headings = next(parted(lines[:1], mark, f"Table `{path}`"), [])
    for heading, count in Counter(headings).items():
        if count > 1:
            raise SceneError(f"Table `{path}` must have every column once, but `{heading}` is there {count} times.")
    rows = []
    for row, (number, line) in enumerate(lines[1:], 1):
        place = f"row {row} (line {number})"
        cells = next(parted([(number, line)], mark, f"Table `{path}`"), [])
        if not any(cells):
            raise SceneError(f"Table `{path}`, {place}: the row must not be blank, because rows follow it.")
        if len(cells) != len(headings):
            raise SceneError(
                f"Table `{path}`, {place}: the row must have {len(headings)} cells, one for each heading, but it has {len(cells)}."
            )
        rows.append((place, dict(zip(headings, cells, strict=True))))
    return rows


def _toml(path: Path, text: str) -> list[tuple[str, dict[str, Any]]]:
    import tomllib

    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise SceneError(f"Table `{path}` must be TOML, but: {error}.") from None
    if not data:
        return []
    key, entries = next(iter(data.items()))
    if len(data) > 1 or not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise SceneError(f"Table `{path}` must be one array of tables such as [[{key}]], but its keys are {joined(data)}.")
    return [(f"row {row}", entry) for row, entry in enumerate(entries, 1)]


def _value(path: Path, place: str, heading: str, unit: str | None, column: Column, cell: Any) -> Any:
    from toolbox.files.units import parse

    if column.blank and cell == "":
        return None
    if cell == "" or cell is None:
        raise _fault(path, place, heading, "the cell must not be empty.")
    if column.unit is None:
        if unit is not None or not isinstance(cell, str):
            raise _fault(path, place, heading, f"it must hold text without a unit, but it is {cell!r}.")
        return cell
    bare = unit is None and path.suffix.lower() == ".toml"  # as in scene files: SI, or text with its unit
    if unit is None and column.unit != "1" and not bare:
        raise SceneError(f"Table `{path}`: the column `{heading}` must name its unit, such as `{heading} [{column.unit}]`.")
    if not bare:
        try:
            fraction = isinstance(cell, str) and re.search("[/¼-¾⅐-⅞]", cell)  # a diameter such as 6 3/4
            number = parse(cell, "1") if fraction else float(cell) if not isinstance(cell, bool) else math.nan
        except (TypeError, ValueError, SceneError):
            raise _fault(path, place, heading, f"it must be a number, but it is `{cell}`.") from None
        if not math.isfinite(number):
            raise _fault(path, place, heading, f"it must be a finite number, but it is `{cell}`.")
        if unit in (None, column.unit):
            return number
        try:
            parse(f"1 {unit}", column.unit, heading)
        except SceneError as error:
            raise SceneError(f"Table `{path}`: {error}") from None
        cell = f"{cell} {unit}"
    try:
        return parse(cell, column.unit, heading)
    except SceneError as error:
        raise SceneError(f"Table `{path}`, {place}: {error}") from None
