"""Arrays from npz files that anybody may have written or damaged: checked before they are read, read whole, and never run as code."""

from __future__ import annotations

import reprlib
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.errors import SceneError
from toolbox.files.reading import most_unpacked, opened
from toolbox.files.units import is_finite_number

MOST_WORDS = 300
"""Characters of another library's words that an error repeats: some repeat what they read."""

Shape = tuple[str, *tuple[int | str, ...]]
"""Kinds of the numbers of an array, as numpy names them (`f`, `iu`, `U`), and its lengths: a length with a name is the same wherever the name stands."""


def arrays(path: Path, what: str) -> dict[str, np.ndarray]:
    """Read the arrays in an npz file and check their checksums.

    Parameters
    ----------
    path
        The file.
    what
        Description of the expected contents of the file, for messages, such as "a body".

    Returns
    -------
    dict of {str: array}
        The arrays by name.

    Raises
    ------
    SceneError
        If the file is missing, damaged or no npz file.

    Examples
    --------
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from toolbox.authoring import read_arrays
    >>> np.savez("gains.npz", gains=[420.6, 2684.0])
    >>> print(read_arrays(Path("gains.npz"), "a set of gains")["gains"])
    [ 420.6 2684. ]
    """
    found = {}
    with opened(path) as file, understood(path, what), zipfile.ZipFile(file) as archive:
        most = most_unpacked(path.stat().st_size)
        unpacked = sum(entry.file_size for entry in archive.infolist())
        if any(entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for entry in archive.infolist()):
            raise ValueError("it is packed in a way that is not read")
        if unpacked > most:
            raise ValueError(f"it unpacks to {unpacked / 2**20:.0f} MiB, and may to {most / 2**20:.0f}")
        for entry in archive.infolist():
            with archive.open(entry) as content:
                found[entry.filename.removesuffix(".npy")] = _array(content, entry.file_size)
    return found


def _array(content: Any, size: int) -> np.ndarray:
    """The array of an entry, whose header must say what the entry holds before memory is taken for it."""
    version = np.lib.format.read_magic(content)
    read_header = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in read_header:
        raise ValueError(f"an array has the unknown version {version}")
    shape, columns_first, kind = read_header[version](content)
    if kind.hasobject:
        raise ValueError("it holds objects of Python, which are not read")
    count = 1
    for length in shape:
        count *= length
    if count * kind.itemsize != size - content.tell():
        raise ValueError("the header of an array does not fit to its content")
    held = bytearray(count * kind.itemsize)
    at = 0
    while piece := content.read(2**20):
        held[at : at + len(piece)] = piece
        at += len(piece)
    if at != len(held):  # the checksum is looked at at the end
        raise ValueError("an array ends before its end")
    return np.ndarray(shape, kind, held, order="F" if columns_first else "C")


def check_shapes(found: Mapping[str, np.ndarray], shapes: Mapping[str, Shape], lengths: Mapping[str, int] | None = None) -> None:
    """Raise ValueError for an array of a wrong kind or shape, and KeyError for a missing array.

    lengths: those of the named ones that are known.
    """
    known: dict[int | str, int] = {}
    known.update(lengths or {})
    for name, (kinds, *shape) in shapes.items():
        array = found[name]
        if array.dtype.kind not in kinds:
            raise ValueError(f"its `{name}` is of kind {array.dtype}")
        if array.ndim != len(shape):
            raise ValueError(f"its `{name}` has {array.ndim} axes, and must have {len(shape)}")
        for length, must in zip(array.shape, shape, strict=True):
            if length != known.setdefault(must, length if isinstance(must, str) else must):
                raise ValueError(f"its `{name}` is of shape {array.shape}, which does not fit to its other arrays")


def check_notes(held: Any, kinds: Mapping[str, str]) -> None:
    """Raise ValueError for an attribute that is not of its kind: "text", "number", "texts" (a tuple), or "by name", a mapping of names to texts."""
    for name, kind in kinds.items():
        value = getattr(held, name)
        texts = (
            (value,) if kind == "text" else value if kind == "texts" else (*value, *value.values()) if isinstance(value, Mapping) else ()
        )
        fits = {"number": is_finite_number(value), "texts": isinstance(value, tuple), "by name": isinstance(value, Mapping)}.get(kind, True)
        if not fits or (kind != "number" and not all(isinstance(each, str) for each in texts)):
            raise ValueError(f"its `{name}` is {reprlib.repr(value)}")


@contextmanager
def understood(path: Path, what: str) -> Iterator[None]:
    """Whatever a damaged file raises in the block, from wrong types to a lack of memory, becomes a SceneError that names the file."""
    try:
        yield
    except (SceneError, ImportError):
        raise
    except Exception as error:
        if isinstance(error, KeyError) and " " not in str(error):
            raise SceneError(f"File `{path}` must be {what}, but it has no {error}.") from None
        words = " ".join(f"{error}"[:MOST_WORDS].split()).rstrip(".") or type(error).__name__
        raise SceneError(f"File `{path}` must be {what}, but it is not: {words}.") from None
