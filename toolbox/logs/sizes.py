"""Memory that a sheet, a parquet or a MAT 7.3 file takes, asked before it is read: a few kilobytes of these can stand for gigabytes."""

from __future__ import annotations

import io
import math
import os
import re
import zipfile
from pathlib import Path
from typing import Any

from toolbox.errors import SceneError
from toolbox.files.reading import UNPACKED

LIFTED = "STICKSLIP_UNPACKED"
"""Variable of the environment with the MiB that such a file may take, in place of those of `UNPACKED`."""

CELL = 64
"""Bytes that a cell of a sheet takes, about: an object, and its place in two tables."""

ELEMENT = 1024
"""Bytes that any other element takes, about: styles and names are objects."""

DEEP = 16
"""Groups and references that may stand in one another in a MAT file of version 7.3."""

COPIES = 3
"""How often the numbers of a file in binary stand in memory while they are read."""

_ROW, _CELL = re.compile(rb'<(?:\w+:)?row\b[^>]*?\br\s*=\s*["\'](\d+)'), re.compile(rb"<(?:\w+:)?(row|c)\b([^>]*)")
_HIDDEN = re.compile(rb'<(?:\w+:)?(?:row|c)\b[^<>]*\br\s*=\s*["\'][^"\'<>]*&')
_SHEET = re.compile(rb"<(?:\w+:)?sheet\s")
_OTHER = re.compile(rb"</?(?:\w+:)?(?:row|c|v|is|t|f)\b|</|<\?")
_PLACE = re.compile(rb'\br\s*=\s*["\']([A-Za-z]{0,3})\d+["\']')


def check_sheets(path: Path, held: bytes) -> None:
    """Raise SceneError if the parts of a packed file unpack to more than they may, or a far cell makes a table of them that takes more.

    Any part may be a sheet, whatever it is called. Raises ValueError for parts whose cells cannot be told by their bytes, and for a sheet that stands twice.
    """
    cells = elements = 0
    with zipfile.ZipFile(io.BytesIO(held)) as archive:
        check_memory(path, sum(entry.file_size for entry in archive.infolist()))
        for entry in archive.infolist():
            part = archive.read(entry)
            if b"<!DOCTYPE" in part or b"<!ENTITY" in part or part[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in part[:4]:
                raise ValueError(f"its part `{entry.filename}` declares entities, or is no text in UTF-8")
            if _HIDDEN.search(part):
                raise ValueError(f"its part `{entry.filename}` hides the place of a cell in entities")
            found = _cells(part)
            cells += found
            if found:
                elements += _OTHER.sub(b"", part).count(b"<")
            elif b"<si>" not in part:
                elements += part.count(b"<")
            if len(_SHEET.findall(part)) > len(archive.namelist()):
                raise ValueError("it names one sheet several times")
    check_memory(path, CELL * cells + ELEMENT * elements)


def _cells(sheet: bytes) -> int:
    """Cells of the table that a sheet spans, from the places that its rows and cells name, or take in turn."""
    rows = row = columns = column = 0
    for match in _CELL.finditer(sheet):
        if match[1] == b"row":
            number = _ROW.match(sheet, match.start())
            row, column = int(number[1]) if number else row + 1, 0
            rows = max(rows, row)
        else:
            place = _PLACE.search(match[2])
            column = _column(place[1]) if place and place[1] else column + 1
            columns = max(columns, column)
    return rows * columns


def _column(letters: bytes) -> int:
    """Number of a column from its letters, A being 1."""
    found = 0
    for letter in letters.upper():
        found = 26 * found + letter - 64
    return found


def check_parquet(path: Path, held: bytes) -> None:
    """Raise SceneError if the table of a parquet file takes more memory than it may."""
    import pyarrow.parquet

    notes = pyarrow.parquet.ParquetFile(io.BytesIO(held)).metadata
    packed = sum(notes.row_group(k).total_byte_size for k in range(notes.num_row_groups))
    values = sum(notes.row_group(k).column(i).num_values for k in range(notes.num_row_groups) for i in range(notes.num_columns))
    check_memory(path, COPIES * max(8 * max(values, notes.num_rows * notes.num_columns), packed))


def texts_of_parquet(held: bytes) -> list[str]:
    """Return the columns of texts in a parquet file: read as a dictionary, each text stands in memory once, however often it is named."""
    import pyarrow.parquet

    columns = pyarrow.parquet.ParquetFile(io.BytesIO(held)).schema
    return [columns.column(k).path for k in range(len(columns)) if columns.column(k).physical_type == "BYTE_ARRAY"]


def check_hdf(path: Path) -> None:
    """Raise SceneError if the arrays of a MAT file of version 7.3 take more memory than they may."""
    import h5py

    def added(group: Any, above: tuple[Any, ...]) -> int:
        if len(above) > DEEP or group.id in above:
            raise ValueError(f"its groups stand in one another, or more than {DEEP} deep")
        size = 0
        for name in group:
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                raise ValueError(f"its `{name}` is a link, which is not followed")
            held = group[name]
            if isinstance(held, h5py.Group):
                size += added(held, (*above, group.id))
            elif isinstance(held, h5py.Dataset):
                size += taken(held, 0)
        return size

    known: dict[Any, int] = {}

    def taken(held: Any, depth: int) -> int:
        """Bytes of a dataset, with those of all to which it refers, each as often as it is named."""
        place = h5py.h5o.get_info(held.id).addr
        if place in known:
            return known[place]
        if held.external or held.is_virtual:
            raise ValueError(f"the numbers of its `{held.name}` stand in another file, which is not read")
        if h5py.check_vlen_dtype(held.dtype) is not None:
            raise ValueError(f"its `{held.name}` holds lists of several lengths")
        if depth > DEEP:
            raise ValueError(f"its references lead to one another, or are more than {DEEP} deep")
        size: int = max(held.size, math.prod(held.chunks or (0,))) * held.dtype.itemsize
        check_memory(path, COPIES * size)
        if h5py.check_ref_dtype(held.dtype) is not None:
            for reference in held[()].ravel():
                other = file[reference] if reference else None
                size += taken(other, depth + 1) if isinstance(other, h5py.Dataset) else 0
                check_memory(path, COPIES * size)
        known[place] = size
        return size

    with h5py.File(path, "r") as file:
        check_memory(path, COPIES * added(file, ()))


def check_memory(path: Path, size: int) -> None:
    """Raise SceneError if a file would take more bytes than it may; the message says how to lift the limit."""
    told = os.environ.get(LIFTED, "")
    most = int(told) * 2**20 if told.isdecimal() else UNPACKED
    if size > most:
        need = -(-size // 2**20)
        raise SceneError(
            f"File `{path}` must take at most {most // 2**20} MiB once it is read, but it takes {need} MiB: leave out what is not needed, "
            f"or set the environment variable {LIFTED}={need}."
        )
