"""Matrices from MAT files up to version 7, dense and sparse, read with no more trust than the file has earned.

Why not scipy's reader: it believes what the file says of itself, and a damaged one ends the process (70 of 600). Here every length is compared with what
is there, every index of a sparse matrix with its size, and what is packed is unpacked to its end, where its checksum stands. Cells, structures and text
are passed over.

Source: MAT-File Format, R2023b, The MathWorks, chapter 1 (versions 4 and 5; version 7 packs the elements of version 5).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.errors import SceneError
from toolbox.files.archives import understood
from toolbox.files.reading import content, most_unpacked

_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Types of numbers as they lie in the file."""

_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
"""Types of numbers of a matrix, which may lie in the file as smaller ones."""

_MATRIX, _PACKED, _SPARSE = 14, 15, 5

MOST_ROWS = 2**24
"""Rows and columns of the largest sparse matrix that is read: one that names more of them than it has entries would take the memory for all."""

_EARLY = ("f8", "f4", "i4", "i2", "u2", "u1")
"""Types of version 4."""


def read_mat(path: str | Path) -> dict[str, Any]:
    """Read the real numeric matrices in a MAT file.

    Parameters
    ----------
    path
        The file.

    Returns
    -------
    dict of {str: array or scipy.sparse.csc_array}
        The matrices by name, with two or more axes. Sparse matrices stay sparse.

    Raises
    ------
    SceneError
        If the file is missing, damaged, of version 7.3, or no MAT file.

    Examples
    --------
    >>> import numpy as np
    >>> import scipy.io
    >>> from toolbox.authoring import read_mat
    >>> scipy.io.savemat("body.mat", {"mass": np.eye(2)})
    >>> print(read_mat("body.mat")["mass"])
    [[1. 0.]
     [0. 1.]]
    """
    path, what = Path(path), "a MAT file"
    held = content(path)
    if held[:4] == b"\x89HDF" or held[124:128] in (b"\0\2IM", b"\2\0MI"):
        raise SceneError(f"File `{path}` must be a MAT file up to version 7, but it is of version 7.3: save it with `-v7`.")
    with understood(path, what):
        if held[126:128] in (b"IM", b"MI"):
            order = "<" if held[126:128] == b"IM" else ">"
            return dict(_matrices(_Bytes(memoryview(held)[128:], order), most_unpacked(len(held))))
        return dict(_early(held))


class _Bytes:
    """Bytes that are read one after the other, with their order in numbers. What is asked for and not there raises ValueError."""

    def __init__(self, held: bytes | memoryview, order: str):
        self.held, self.order, self.at = memoryview(held), order, 0

    def __bool__(self) -> bool:
        return self.at < len(self.held)

    def take(self, size: int) -> memoryview:
        """So many bytes."""
        if not 0 <= size <= len(self.held) - self.at:
            raise ValueError(f"it ends {size - len(self.held) + self.at} bytes too early")
        self.at += size
        return self.held[self.at - size : self.at]

    def element(self) -> tuple[int, memoryview]:
        """(type, content) of the next element; small ones have their content in the place of their length."""
        kind, size = struct.unpack(self.order + "II", self.take(8))
        if kind >> 16:
            kind, size = kind & 0xFFFF, kind >> 16
            if size > 4:
                raise ValueError("a small element is too long")
            self.at -= 4
            return kind, self.take(4)[:size]
        held = self.take(size)
        if kind != _PACKED:
            self.at = min(self.at + -size % 8, len(self.held))
        return kind, held

    def numbers(self) -> np.ndarray:
        """The next element as numbers."""
        kind, held = self.element()
        if kind not in _STORED:
            raise ValueError(f"numbers are of the unknown type {kind}")
        return np.frombuffer(held, self.order + _STORED[kind])


def _matrices(given: _Bytes, most: int) -> Iterator[tuple[str, Any]]:
    while given:
        kind, held = given.element()
        if kind == _PACKED:
            kind, held = _Bytes(_unpacked(held, most), given.order).element()
            most -= len(held)
        if kind != _MATRIX:
            raise ValueError(f"an element is of the unknown type {kind}")
        found = _matrix(_Bytes(held, given.order))
        if found is not None and found[0]:
            yield found


def _unpacked(held: memoryview, most: int) -> bytes:
    unpacking = zlib.decompressobj()
    found = unpacking.decompress(held, most + 1)
    if len(found) > most:
        raise ValueError(f"it unpacks to more than {most / 2**20:.0f} MiB")
    if not unpacking.eof:
        raise ValueError("an element is not whole")
    return found


def _matrix(given: _Bytes) -> tuple[str, Any] | None:
    """(name, matrix), None for what is no real numeric matrix."""
    flags, shape, name = given.numbers(), given.numbers().tolist(), bytes(given.element()[1]).decode("ascii")
    if len(flags) != 2 or len(shape) < 2 or min(shape) < 0:
        raise ValueError("a matrix has no sound head")
    kind, imaginary, logical = (int(flags[0]) & mask for mask in (0xFF, 0x800, 0x200))
    if imaginary or kind not in (*_CLASSES, _SPARSE) or (logical and kind == _SPARSE):
        return None
    if kind == _SPARSE:
        return name, _sparse(shape, given.numbers(), given.numbers(), given.numbers().astype(float))
    return name, given.numbers().astype(_CLASSES[kind]).reshape(shape, order="F")


def _sparse(shape: list[int], rows: np.ndarray, starts: np.ndarray, values: np.ndarray) -> Any:
    from scipy.sparse import csc_array

    if rows.dtype.kind + starts.dtype.kind not in ("ii", "uu", "iu", "ui"):
        raise ValueError("places in a sparse matrix are no whole numbers")
    rows, starts = rows.astype(np.int64), starts.astype(np.int64)
    used = int(starts[-1]) if len(starts) else -1
    used = used if used <= min(len(rows), len(values)) else -1
    if len(shape) != 2 or shape[0] > MOST_ROWS or len(starts) != shape[1] + 1 or starts[0] != 0 or (np.diff(starts) < 0).any() or used < 0:
        raise ValueError("the columns of a sparse matrix do not fit to its numbers")
    rows = rows[:used]
    if used and (rows.min() < 0 or rows.max() >= shape[0]):
        raise ValueError("a sparse matrix has an entry outside")
    return csc_array((values[:used], rows, starts), shape=shape)


def _early(held: bytes) -> Iterator[tuple[str, Any]]:
    """Matrices of version 4, whose head is five whole numbers of four bytes."""
    if not held:
        raise ValueError("it is empty")
    order = "<" if int.from_bytes(held[:4], "little") < 5000 else ">"
    given = _Bytes(held, order)
    while given:
        kind, rows, columns, imaginary, length = struct.unpack(order + "iiiii", given.take(20))
        machine, reserved, stored, form = (kind // 10**k % 10 for k in (3, 2, 1, 0))
        if not 0 <= kind < 5000 or reserved or machine != (order == ">") or stored >= len(_EARLY) or form > 2 or imaginary not in (0, 1):
            raise ValueError("it is of another kind")
        if rows < 0 or columns < 0 or length < 1:
            raise ValueError("a matrix has no sound head")
        name = bytes(given.take(length)).rstrip(b"\0").decode("ascii")
        size = rows * columns * np.dtype(_EARLY[stored]).itemsize
        numbers = np.frombuffer(given.take(size), order + _EARLY[stored]).reshape((rows, columns), order="F")
        given.take(size * imaginary)
        if form == 0 and not imaginary:
            yield name, numbers.astype(_EARLY[stored])
        elif form == 2 and not imaginary and columns == 3:
            yield name, _triples(numbers)


def _triples(numbers: np.ndarray) -> Any:
    """A sparse matrix from rows, columns and values, of which the last row is its size."""
    from scipy.sparse import csc_array

    whole = [[int(number) for number in row] for row in numbers[:, :2].tolist()]  # raises ValueError and OverflowError for nan and infinity
    *places, size = whole
    if (
        not (numbers[:, :2] == whole).all()
        or not all(0 < i <= size[0] and 0 < j <= size[1] for i, j in places)
        or not 0 <= max(size) <= MOST_ROWS
    ):
        raise ValueError("a sparse matrix has an entry outside")
    rows, columns = (np.array(places, np.int64).reshape(-1, 2) - 1).T
    return csc_array((numbers[:-1, 2].astype(float), (rows, columns)), shape=size)
