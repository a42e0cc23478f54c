"""Memory and time that a log takes, asked before it is read: a few kilobytes of a sheet, parquet or MAT 7.3 can stand for gigabytes, of LAS for hours."""

from __future__ import annotations

import io
import math
import os
import re
import zipfile
import zlib
from collections import Counter
from itertools import islice
from pathlib import Path
from typing import Any

from toolbox.errors import SceneError
from toolbox.files.reading import UNPACKED

LIFTED = "STICKSLIP_UNPACKED"
"""Variable of the environment with the MiB that such a file may take, in place of those of `UNPACKED`."""

CELL = 64
"""Bytes that a cell of a sheet takes, about: an object, and its place in two tables."""

WIDEST = 16384
"""Columns of the widest sheet, as in the programs that write them."""

ELEMENT = 1024
"""Bytes that any other element takes, about: styles and names are objects."""

DEEP = 16
"""Groups and references that may stand in one another in a MAT file of version 7.3."""

NAMED = 8192
"""Bytes of an array, a group and a reference in a MAT file of version 7.3, beside their numbers, about; the time that each takes grows with it."""

LETTER = 32
"""Bytes of a letter of a text in such a file, about, which is an object of its own for a time."""

COPIES = 3
"""How often the numbers of a file in binary stand in memory while they are read."""

LINE = 200
"""Bytes that a line of a table in text takes beside its cells, about."""

MARKED_UP, WRITTEN = 16, 12
"""How often the text of a WITSML document and of a LAS file stands in memory while it is read, about."""

LONGEST = 1000
"""Characters of the longest line in the head of a LAS file: the time to take one apart grows faster than its length."""

HEAD_LINES, COLUMNS, SAME = 1000, 1000, 40
"""Lines in the head of a LAS file, values in a line of its data, and lines of one mnemonic: the time grows with the square of the first two, and with the cube
of the last."""

_ROW, _CELL = re.compile(rb'<(?:\w+:)?row\b[^>]*?\br\s*=\s*["\'](\d+)'), re.compile(rb"<(?:\w+:)?(row|c)\b([^>]*)")
_HIDDEN = re.compile(rb'<(?:\w+:)?(?:row|c)\b[^<>]*\br\s*=\s*["\'][^"\'<>]*&')
_SHEET = re.compile(rb"<(?:\w+:)?sheet\s")
_OTHER = re.compile(rb"</?(?:\w+:)?(?:row|c|v|is|t|f)\b|</|<\?")
_LAS_DATA, _LAS_UNUSED = re.compile(r"\s*~(?:a|\w+_data)", re.IGNORECASE), re.compile(r"\s*~[op]", re.IGNORECASE)
_LAS_NAME, _BLANKS = re.compile("[.:]"), re.compile(r"[\s,]+")
_RICH = re.compile(rb"<(?!/|\?|(?:\w+:)?(?:si|t|sst)\b)")
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
            else:  # plain shared texts are cheap
                elements += part.count(b"<") if b"<si>" not in part else len(_RICH.findall(part))
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
    if columns > WIDEST:
        raise ValueError(f"it has a row of more than {WIDEST} cells")
    return rows * columns


def _column(letters: bytes) -> int:
    """Number of a column from its letters, A being 1."""
    found = 0
    for letter in letters.upper():
        found = 26 * found + letter - 64
    return found


def check_text(path: Path, text: str) -> None:
    """Raise SceneError if the cells of a table in text take more memory than they may."""
    lines = sum(map(text.count, "\n\r\v\f\x1c\x1d\x1e\x85\u2028\u2029")) - text.count("\r\n")
    blanks = sum(1 for _ in islice(re.finditer(" +", text), UNPACKED // CELL + 1))
    check_memory(path, len(text) + LINE * lines + CELL * (lines + max(blanks, *map(text.count, "\t;|,"))))


def check_las(path: Path, text: str) -> str:
    """Return the text of a LAS file without its parameters and remarks, which nobody uses.

    Raises SceneError if it takes more memory than it may. Raises ValueError if it takes more time: then it has no shape that a log has.
    """
    check_memory(path, WRITTEN * len(text))
    kept, names, kind = [], Counter[str](), ""
    for line in text.splitlines():
        if line.lstrip().startswith("~"):
            kind = "data" if _LAS_DATA.match(line) else "unused" if _LAS_UNUSED.match(line) else "head"
        if kind == "head":
            names[_LAS_NAME.split(line.strip(), maxsplit=1)[0].strip().upper()] += not line.lstrip().startswith("#")
            if len(line) > LONGEST:
                raise ValueError(f"a line of its head has more than {LONGEST} characters")
        elif kind == "data" and len(line) > COLUMNS and len(_BLANKS.split(line, maxsplit=COLUMNS)) > COLUMNS:
            raise ValueError(f"a line of its data has more than {COLUMNS} values")
        if kind != "unused":
            kept.append(line)
    if names.total() > HEAD_LINES or max(names.values(), default=0) > SAME:
        raise ValueError(f"its head has more than {HEAD_LINES} lines, or one mnemonic more than {SAME} times")
    return "\n".join(kept)


def check_parquet(path: Path, held: bytes) -> tuple[list[str], list[str]]:
    """Return the columns of a parquet file with a value per row, and the columns of lists and structures, which are not read.

    Raises SceneError if its table takes more memory than it may.
    """
    import pyarrow.parquet

    file = pyarrow.parquet.ParquetFile(io.BytesIO(held))
    notes = file.metadata
    packed = sum(notes.row_group(k).total_byte_size for k in range(notes.num_row_groups))
    values = sum(notes.row_group(k).column(i).num_values for k in range(notes.num_row_groups) for i in range(notes.num_columns))
    check_memory(path, COPIES * max(8 * max(values, notes.num_rows * notes.num_columns), packed))
    nested = [field.name for field in file.schema_arrow if field.type.num_fields]
    return [name for name in file.schema_arrow.names if name not in nested], nested


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
        size = NAMED
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
        """Return the bytes of a dataset and of all datasets to which it refers. A dataset counts once for each reference."""
        place = h5py.h5o.get_info(held.id).addr
        if place in known:
            return known[place]
        if held.external or held.is_virtual:
            raise ValueError(f"the numbers of its `{held.name}` stand in another file, which is not read")
        if h5py.check_vlen_dtype(held.dtype) is not None:
            raise ValueError(f"its `{held.name}` holds lists of several lengths")
        if depth > DEEP:
            raise ValueError(f"its references lead to one another, or are more than {DEEP} deep")
        each = LETTER if held.attrs.get("MATLAB_class") == b"char" else held.dtype.itemsize
        size: int = NAMED + max(held.size, math.prod(held.chunks or (0,))) * each
        check_memory(path, COPIES * size)
        if held.chunks:
            _check_chunks(held, math.prod(held.chunks) * held.dtype.itemsize)
        if h5py.check_ref_dtype(held.dtype) is not None:
            for reference in held[()].ravel():
                other = file[reference] if reference else None
                size += NAMED + (taken(other, depth + 1) if isinstance(other, h5py.Dataset) else 0)
                check_memory(path, COPIES * size)
        known[place] = size
        return size

    with h5py.File(path, "r") as file:
        check_memory(path, COPIES * added(file, ()))


def _check_chunks(held: Any, size: int) -> None:
    """Raise ValueError if a chunk of a dataset unpacks to more bytes than it has room for, or is packed in a way in which that cannot be told."""
    from h5py import h5z

    notes = held.id.get_create_plist()
    filters = [notes.get_filter(k)[0] for k in range(notes.get_nfilters())]
    if filters != [each for each in (h5z.FILTER_SHUFFLE, h5z.FILTER_DEFLATE, h5z.FILTER_FLETCHER32) if each in filters]:
        raise ValueError(f"its `{held.name}` is packed in a way that is not read")
    for k in range(held.id.get_num_chunks() if h5z.FILTER_DEFLATE in filters else 0):
        left_out, chunk = held.id.read_direct_chunk(held.id.get_chunk_info(k).chunk_offset)
        if not left_out and len(zlib.decompressobj().decompress(chunk, size + 1)) > size:
            raise ValueError(f"a part of its `{held.name}` unpacks to more than it has room for")


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
