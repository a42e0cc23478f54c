"""Memory that a sheet, a parquet or a MAT 7.3 file takes, asked before it is read: a few kilobytes of these can stand for gigabytes."""

from __future__ import annotations

import io
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

COPIES = 3
"""How often the numbers of a file in binary stand in memory while they are read."""

_ROW, _CELL = re.compile(rb'<(?:\w+:)?row\b[^>]*?\br\s*=\s*["\'](\d+)'), re.compile(rb"<(?:\w+:)?(row|c)\b([^>]*)")
_PLACE = re.compile(rb'\br\s*=\s*["\']([A-Za-z]{0,3})\d+["\']')


def check_sheets(path: Path, held: bytes) -> None:
    """Raise SceneError if the sheets of a packed file unpack to more than they may, or a far cell makes a table of them that takes more."""
    with zipfile.ZipFile(io.BytesIO(held)) as archive:
        check_memory(path, sum(entry.file_size for entry in archive.infolist()))
        for entry in archive.infolist():
            if re.fullmatch(r"xl/worksheets/[^/]*\.xml", entry.filename):
                check_memory(path, CELL * _cells(archive.read(entry)))


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
    check_memory(path, COPIES * max(8 * notes.num_rows * notes.num_columns, packed))


def check_hdf(path: Path) -> None:
    """Raise SceneError if the arrays of a MAT file of version 7.3 take more memory than they may."""
    import h5py

    size = 0

    def added(name: str, held: Any) -> None:
        nonlocal size
        if isinstance(held, h5py.Dataset):
            size += held.size * held.dtype.itemsize

    with h5py.File(path, "r") as file:
        file.visititems(added)
    check_memory(path, COPIES * size)


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
