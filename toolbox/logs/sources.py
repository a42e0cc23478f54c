"""Files of logs by their kind, each read by the library of its format: text, sheets and parquet by pandas, LAS by lasio, MAT 7.3 by pymatreader."""

from __future__ import annotations

import io
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.errors import SceneError, joined
from toolbox.files.archives import understood
from toolbox.files.mat import read_mat
from toolbox.files.reading import TEXT, content, opened
from toolbox.logs.grids import Column, Source, named, of_rows, of_text
from toolbox.logs.sizes import MARKED_UP, check_hdf, check_las, check_memory, check_parquet, check_sheets, check_text, texts_of_parquet
from toolbox.logs.witsml import of_witsml

EXTRA = "pip install 'stickslip-toolbox[data]'"

NO_TABLE = "must be a table in text, a sheet (xlsx), parquet, LAS or MAT file, but it is none of these"


def from_file(path: Path, decimal: str | None = None, names: Sequence[str] = ()) -> Source:
    """The columns of a file.

    names: headings that are asked for. Raises SceneError where it cannot be read, and ImportError that names the extra where its library is not there."""
    kind, where = path.suffix.lower(), f"File `{path}`"
    if kind == ".mat":
        return _of_mat(path)
    held = content(path, TEXT)
    if not held.strip():
        raise SceneError(f"{where} must hold a table, but it is empty.")
    if kind in (".xlsx", ".xls", ".ods", ".parquet"):
        return _by_pandas(path, kind, held, names)
    held = _marked(held)
    if b"\0\0\0\0" in held:
        raise SceneError(f"{where} {NO_TABLE}.")
    text = decoded(held)
    start = text.lstrip()[:4000].lower()
    if kind == ".xml" or start.startswith(("<?xml", "<log", "<witsml", "<!")):
        check_memory(path, MARKED_UP * len(text))
        return of_witsml(text, where, names)
    if kind == ".las" or start.startswith("~v"):
        return _of_las(path, text)
    if "\0" in text:
        raise SceneError(f"{where} {NO_TABLE}.")
    check_text(path, text)
    return of_text(text, where, decimal, names)


def _marked(held: bytes) -> bytes:
    """Bytes with the mark of UTF-16 where every other one of the first is zero."""
    head = held[:400]
    for first, mark in ((1, b"\xff\xfe"), (0, b"\xfe\xff")):
        if len(head) > 8 and len(held) % 2 == 0 and not any(head[first::2]) and all(head[1 - first :: 2]):
            return mark + held
    return held


def decoded(held: bytes) -> str:
    """Text in UTF-8, UTF-16 with its mark, or else the alphabet of Western Windows, which every file is."""
    if held[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return held.decode("utf-16", errors="replace")
    try:
        return held.decode("utf-8-sig")
    except UnicodeDecodeError:
        return held.decode("cp1252", errors="replace")


def from_mapping(given: Mapping[str, Any]) -> Source:
    """Return the columns of a mapping of names to values. A name without a unit means SI; a matrix `log` becomes the columns `log.0`,
    `log.1` and so on."""
    columns = []
    for heading, cells in given.items():
        name, unit = named(heading) if "[" in heading else (heading, None)
        matrix = isinstance(cells, np.ndarray) and cells.ndim == 2 and cells.dtype.kind in "iuf" and 1 < cells.shape[1] < cells.shape[0]
        columns += [Column(f"{name}.{i}", unit, cells[:, i]) for i in range(cells.shape[1])] if matrix else [Column(name, unit, cells)]
    return Source(columns, "given data", bare=True)


def from_frame(table: Any, bare: bool) -> Source:
    """Return the columns of a table of pandas. The index is the time if no column has this name."""
    columns = [Column(*named(str(heading)), _cells(table[heading])) for heading in table.columns]
    index, words = table.index, [str(column.name).lower() for column in columns]
    plain = index.name is None and type(index).__name__ == "RangeIndex"
    if not plain and "time" not in words and index.nlevels == 1:
        if hasattr(index, "total_seconds"):
            columns.insert(0, Column("time", "s", index.total_seconds().to_numpy()))
        else:
            name, unit = named(str(index.name)) if index.name else ("time", None)
            columns.insert(0, Column(name if index.name else "time", unit, _zoned(index)))
    for i, column in enumerate(columns):
        columns[i].cells = _plain(column.cells)
    return Source(columns, "table of pandas", bare=bare)


def _zoned(index: Any) -> Any:
    return index.tz_convert("UTC").tz_localize(None).to_numpy() if getattr(index, "tz", None) is not None else index.to_numpy()


def _cells(column: Any) -> Any:
    """Cells of a column of pandas; a text of a dictionary stands in memory once, however many of its rows name it."""
    if hasattr(column, "cat") and column.cat.categories.dtype.kind not in "biuf":
        return np.append(np.asarray(column.cat.categories, object), np.nan)[column.cat.codes]
    return column.to_numpy()


def _plain(cells: Any) -> Any:
    """Cells of pandas as those of numpy: spans of time in seconds, what has a zone in UTC."""
    array = np.asarray(cells)
    if array.dtype.kind == "m":
        return array / np.timedelta64(1, "s")
    return array


def _by_pandas(path: Path, kind: str, held: bytes, names: Sequence[str]) -> Source:
    try:
        import pandas

        with understood(path, "parquet" if kind == ".parquet" else "a sheet"):
            if kind == ".parquet":
                flat, nested = check_parquet(path, held)
                source = from_frame(pandas.read_parquet(io.BytesIO(held), columns=flat, read_dictionary=texts_of_parquet(held)), bare=False)
                source.notes += [f"{joined(nested)} left out: lists or structures"] if nested else []
                return source
            if held[:2] == b"PK":
                check_sheets(path, held)
            engine = "openpyxl" if kind == ".xlsx" else None  # else pandas chooses by what is in the file
            sheets = pandas.read_excel(io.BytesIO(held), header=None, sheet_name=None, dtype=object, engine=engine)
    except ImportError as error:
        raise ImportError(f"A file such as `{path.name}` is read by pandas with pyarrow and openpyxl, but {error}: {EXTRA}") from None
    full = {name: sheet for name, sheet in sheets.items() if sheet.shape[0] > 1 and sheet.shape[1] > 1}
    if not full:
        raise SceneError(f"File `{path}` must hold a table, but its sheets are empty.")
    name, sheet = max(full.items(), key=lambda pair: pair[1].size)
    with understood(path, "a sheet"):
        source = of_rows(sheet.where(sheet.notna(), None).values.tolist(), f"File `{path}`, sheet `{name}`,", names=names)
    source.notes.insert(0, f"sheet `{name}`" + (f" of {len(sheets)}, the largest" if len(sheets) > 1 else ""))
    return source


def _of_las(path: Path, text: str) -> Source:
    try:
        import lasio
    except ImportError:
        raise ImportError(f"LAS files such as `{path.name}` are read by lasio, which is not there: {EXTRA}") from None
    with understood(path, "a LAS file"):
        las = lasio.read(io.StringIO(check_las(path, text)), null_policy="none", engine="normal")
    columns = [Column(curve.mnemonic, curve.unit or None, curve.data) for curve in las.curves]
    if (
        columns
        and (columns[0].unit or "").lower() in ("m", "ft", "f", "feet", "meter")
        and columns[0].name.lower()[:4] in ("dept", "md", "tvd", "dmea")
    ):
        times = [column.name for column in columns if column.name.lower() in ("time", "etim", "tim")]
        if not times:
            raise SceneError(
                f"File `{path}` must be a log over time, but it is one over depth (`{columns[0].name}`): export the log over time."
            )
    nulls = tuple(
        float(item.value) for item in las.well if item.mnemonic.upper() == "NULL" and isinstance(item.value, (int, float, np.number))
    )
    return Source(columns, "LAS file", nulls=nulls)


def _of_mat(path: Path) -> Source:
    with opened(path) as file:
        head, size = file.read(128), os.fstat(file.fileno()).st_size
    check_memory(path, size)
    if head[:4] != b"\x89HDF" and head[124:128] not in (b"\0\2IM", b"\2\0MI"):
        return from_mapping(read_mat(path))
    try:
        import pymatreader
    except ImportError:
        raise ImportError(
            f"`{path.name}` is a MAT file of version 7.3, read by pymatreader, which is not there: {EXTRA}, or save it with `-v7`."
        ) from None
    with understood(path, "a MAT file that can be read as one of version 7.3 (or saved with `-v7`)"):
        check_hdf(path)
        found = pymatreader.read_mat(str(path))
    return from_mapping(dict(_flat(found)))


def _flat(found: Mapping[str, Any], before: str = "") -> Any:
    """(name, values) of the arrays in structures, `log.wob`."""
    for name, value in found.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{name}.")
        elif isinstance(value, (np.ndarray, list)) and np.size(value) > 1:
            yield before + name, value
