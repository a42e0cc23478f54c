"""Logs over time in WITSML 1.3.1 and 1.4.1, read by the parser of the standard library, which is given no document type to expand.

A `logs` document holds `log` objects, each with its curves in `logCurveInfo` and rows of cells in `data` (Energistics, WITSML Data Schema 1.4.1.1). From 1.4.1
on `mnemonicList` and `unitList` name the cells; before, `columnIndex` of the curves does.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any
from xml.parsers import expat

import numpy as np

from toolbox.errors import SceneError, suggest
from toolbox.files.tables import parted
from toolbox.logs.grids import Column, Source

DEEPEST = 100
"""Elements that may stand in one another."""

_DECLARES = re.compile(r"<!(?!--|\[CDATA\[)")


@dataclass
class _Rows:
    """Rows of one `logData`, with the names and units of their cells."""

    names: str = ""
    units: str = ""
    lines: list[str] = field(default_factory=list)


@dataclass
class _Log:
    """One `log`: its own elements, its curves and its rows."""

    words: dict[str, str] = field(default_factory=dict)
    curves: list[dict[str, str]] = field(default_factory=list)
    tables: list[_Rows] = field(default_factory=list)


@dataclass
class _Table:
    """Named columns of one log, and its rows of cells."""

    log: _Log
    names: list[str]
    units: list[str]
    rows: list[list[str]]
    lost: int


def of_witsml(text: str, where: str, names: Sequence[str] = ()) -> Source:
    """Return the columns of a log over time in WITSML.

    Parameters
    ----------
    text
        The document.
    where
        The file, as an error names it.
    names
        Mnemonics that are asked for, by which one log is chosen of several.

    Raises
    ------
    SceneError
        If the document declares a document type or entities, is damaged, holds no log over time, or several that may be meant.
    """
    logs, root = _logs(text, where)
    if not logs:
        raise SceneError(
            f"{where} must be a log in WITSML 1.4.1, whose first element is `logs`, but it is XML whose first element is `{root}`: export the log over time "
            "as WITSML 1.4.1, LAS or CSV."
        )
    deep = [log for log in logs if "depth" in log.words.get("indexType", "")]
    if len(deep) == len(logs):
        index = deep[0].words.get("indexCurve", "depth")
        raise SceneError(f"{where} must be a log over time, but it is one over depth (`{index}`): export the log over time.")
    tables = _joined([table for log in logs if log not in deep for table in _tables(log, where)])
    if not tables:
        raise SceneError(f"{where} must hold rows in `data` of its `logData`, but it has none: export the log with its data.")
    table = _meant(tables, where, names)
    notes = ["WITSML log" + (f" `{table.log.words['name']}`" if table.log.words.get("name") else "")]
    if len(logs) > 1:
        notes.append(f"{len(logs)} logs in the file" + (f", {len(deep)} over depth passed over" if deep else ""))
    if table.lost:
        notes.append(f"{table.lost} row(s) of another length than the {len(table.names)} mnemonics left out")
    infos = {curve.get("mnemonic", ""): curve for curve in table.log.curves}
    cells = list(zip(*table.rows, strict=True)) if table.rows else [() for _ in table.names]
    columns = []
    for name, unit, column in zip(table.names, table.units, cells, strict=True):
        null = infos.get(name, {}).get("nullValue", "")
        columns.append(Column(name, unit or None, list(column), _numbers(null)))
    index = table.log.words.get("indexCurve") or table.names[0]
    return Source(columns, "WITSML log", notes=notes, nulls=_numbers(table.log.words.get("nullValue", "")), index=index)


def _numbers(text: str) -> tuple[float, ...]:
    try:
        return (float(text),) if np.isfinite(float(text)) else ()
    except ValueError:
        return ()


def _logs(text: str, where: str) -> tuple[list[_Log], str]:
    """(logs of a document, name of its first element). A document type is refused before anything is parsed, so that no entity is ever expanded."""
    if (declared := _DECLARES.search(text)) is not None:
        raise SceneError(
            f"{where} must be XML without a document type and without entities of its own, but it has `{text[declared.start() :][:40].split()[0]}`: "
            "remove these declarations."
        )
    logs: list[_Log] = []
    stack: list[str] = []
    held: list[str] = []
    first: list[str] = []

    def begin(name: str, _: Any) -> None:
        name = name.rpartition(":")[2]
        stack.append(name)
        first[:] = first or [name]
        held.clear()
        if len(stack) > DEEPEST:
            raise SceneError(f"{where} must have at most {DEEPEST} elements in one another, but it has more.")
        if name == "log" and stack[:-1] in ([], ["logs"]):
            logs.append(_Log())
        elif logs and stack[-2:] == ["log", "logCurveInfo"]:
            logs[-1].curves.append({})
        elif logs and stack[-2:] == ["log", "logData"]:
            logs[-1].tables.append(_Rows())

    def end(_: str) -> None:
        name, words = stack.pop(), "".join(held).strip()
        held.clear()
        if not logs or not stack:
            return
        log = logs[-1]
        if stack[-1] == "log":
            log.words.setdefault(name, words)
        elif stack[-1] == "logCurveInfo" and log.curves:
            log.curves[-1].setdefault(name, words)
        elif stack[-1] == "logData" and log.tables:
            if name == "data":
                log.tables[-1].lines.extend(line for line in words.splitlines() if line.strip())
            elif name == "mnemonicList":
                log.tables[-1].names = words
            elif name == "unitList":
                log.tables[-1].units = words

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = begin, end, held.append
    try:
        parser.Parse(re.sub(r"^\s*<\?xml[^>]*\?>", "", text.lstrip("\ufeff")), True)
    except expat.ExpatError as error:
        raise SceneError(f"{where} must be whole XML, but it cannot be read: {error}. Export it again.") from None
    return logs, first[0] if first else ""


def _tables(log: _Log, where: str) -> list[_Table]:
    """The rows of a log, each with as many cells as there are mnemonics."""
    mark = log.words.get("dataDelimiter") or ","
    curves = sorted(
        (curve for curve in log.curves if curve.get("mnemonic")), key=lambda curve: int(_numbers(curve.get("columnIndex", "") or "0")[0])
    )
    own = {curve["mnemonic"]: curve.get("unit", "") for curve in curves}
    found = []
    for table in log.tables:
        names = [name.strip() for name in table.names.split(",")] if table.names else list(own)
        units = [unit.strip() for unit in table.units.split(",")] if table.units else []
        if len(units) != len(names):
            units = [own.get(name, "") for name in names]
        rows = list(parted(enumerate(table.lines, 1), mark, f"{where}, `data`"))
        whole = [row for row in rows if len(row) == len(names)]
        if rows and len(whole) < 0.5 * len(rows):
            raise SceneError(
                f"{where} must have {len(names)} cells in every `data`, one for each mnemonic, but {len(rows) - len(whole)} of {len(rows)} have another number."
            )
        if whole:
            found.append(_Table(log, names, units, whole, len(rows) - len(whole)))
    return found


def _joined(tables: Sequence[_Table]) -> list[_Table]:
    """Tables of equal names and units as one, in the order in which they stand."""
    found: dict[Any, _Table] = {}
    for table in tables:
        key = (tuple(table.names), tuple(table.units))
        if key in found:
            found[key].rows.extend(table.rows)
            found[key].lost += table.lost
        else:
            found[key] = table
    return list(found.values())


def _meant(tables: Sequence[_Table], where: str, names: Sequence[str]) -> _Table:
    """The table with all names that are asked for."""
    asked = {name.casefold() for name in names}
    fitting = [table for table in tables if asked <= {name.casefold() for name in table.names}] if asked else list(tables)
    if len(fitting) == 1 or len(tables) == 1:
        return (fitting or tables)[0]
    if not fitting:
        every = sorted({name for table in tables for name in table.names})
        missing = next((name for name in names if name.casefold() not in {each.casefold() for each in every}), None)
        if missing is not None:
            raise SceneError(f"{where} must have `{missing}`, but it is not there: {suggest(missing, every)}")
    told = "; ".join(", ".join(f"`{name}`" for name in table.names[:6]) for table in tables[:4])
    raise SceneError(
        f"{where} must hold one log over time with all columns that are asked for, but it holds {len(tables)} with different mnemonics ({told}): "
        "save the one that is meant in a file of its own, or name columns that only one of them has."
    )
