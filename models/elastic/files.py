"""Matrices from the files of finite-element programs: Matrix Market and MAT."""

from __future__ import annotations

import gzip
import io
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from toolbox import SceneError
from toolbox.authoring import opened, read_mat, suggest

LARGEST = 2**28
"""Bytes of the largest Matrix Market file, unpacked."""

SMALL, RATIO = 2**25, 50
"""Bytes to which any packed file may unpack, and how many times its size a larger one may: text of numbers shrinks by less."""

MOST_ROWS = 2**22
"""Rows and columns of the largest matrix: one that names more of them than it has entries would take the memory for all."""

ENTRY, CHEAP, PER_BYTE = 100, 2**28, 8
"""Bytes of memory that an entry takes while it is read, about; what all may take of any file; and how often the text may, of a larger one."""

_COMMENTS = re.compile(rb"(?:[ \t\r]*(?:%[^\n]*)?\n)*")

_TEXT = bytes(range(32, 127)) + b"\t\r\n"


def read_matrix(path: Path | str, name: str | None = None) -> Any:
    """The matrix in a Matrix Market file (.mtx, also .mtx.gz) or a MAT file (.mat, up to version 7), sparse or dense as it is stored.

    name: which matrix of a MAT file; needed where it holds several. Raises SceneError for a file that is missing, damaged, of another kind, or holds
    no matrix of that name.
    """
    path = Path(path)
    kinds = {".mtx": _matrix_market, ".mat": _mat}
    kind = path.name.removesuffix(".gz")[-4:].lower()
    if kind not in kinds:
        raise SceneError(f"A file of a matrix must end in .mtx, .mtx.gz or .mat, but it is `{path}`.")
    return kinds[kind](path, name)


def _matrix_market(path: Path, name: str | None) -> Any:
    if name is not None:
        raise SceneError(f"`{path}` holds one matrix without a name, but `{name}` is asked for.")
    try:
        with opened(path, LARGEST) as file, gzip.GzipFile(fileobj=file) if path.suffix.lower() == ".gz" else file as plain:
            held, most = bytearray(), LARGEST  # memory is taken for what is there, not for what may be
            if plain is not file:
                most = min(LARGEST, max(SMALL, RATIO * path.stat().st_size))
            while piece := plain.read(2**20):
                held += piece
                if len(held) > most:
                    raise ValueError(f"it unpacks to more than {most / 2**20:.0f} MiB")
        return _market(bytes(held))
    except SceneError:
        raise
    except (ValueError, OSError, EOFError, OverflowError, MemoryError, zlib.error) as error:
        raise SceneError(f"`{path}` is no sound Matrix Market file: {str(error).rstrip('.')}.") from None


def _market(held: bytes) -> Any:
    """The matrix in the text of a Matrix Market file (NIST, math.nist.gov/MatrixMarket/formats.html). Raises ValueError and OverflowError.

    Why not scipy's reader: zeros behind the last line, or sizes that do not fit, end the process there.
    """
    from scipy.sparse import coo_array

    head, _, rest = held.partition(b"\n")
    sizes, _, entries = rest[len(_COMMENTS.match(rest)[0]) :].partition(b"\n")  # type: ignore[index]
    sparse, sign = _form(head)
    rows, columns, *count = _sizes(sizes, sparse, sign)
    below = np.triu_indices(rows, 1 if sign < 0 else 0)[::-1] if sign and not sparse and rows**2 <= 4 * len(entries) + 4 else ()
    wanted = count[0] if sparse else len(below[0]) if below else rows * columns
    if wanted < 0 or wanted > len(entries) or (entries.translate(None, _TEXT)):
        raise ValueError("its entries are not whole, or no text")
    if ENTRY * wanted > max(CHEAP, PER_BYTE * len(entries)):
        raise ValueError(f"its {wanted} entries take far more memory than their text")
    numbers = np.loadtxt(io.BytesIO(entries), ndmin=2, comments=None) if entries.strip() else np.empty((0, 3 if sparse else 1))
    if numbers.shape != (wanted, 3 if sparse else 1):
        raise ValueError(f"it must have {wanted} entries, but it has {len(numbers)}")
    if not sparse and not sign:
        return numbers.reshape(rows, columns, order="F")
    named = numbers[:, :2]
    if sparse and not ((named >= 1) & (named <= (rows, columns)) & (np.floor(named) == named)).all():
        raise ValueError("it has an entry outside")
    places = named.astype(int).T - 1 if sparse else np.array(below)
    values = numbers[:, -1]
    if sign:
        off = places[0] != places[1]
        places, values = np.concatenate([places, places[::-1, off]], axis=1), np.concatenate([values, sign * values[off]])
    found = coo_array((values, tuple(places)), shape=(rows, columns))
    return found if sparse else found.toarray()


def _form(head: bytes) -> tuple[bool, int]:
    """Whether a matrix is sparse, and whether what is above its diagonal is what is below (1), minus that (-1) or given (0), from the first line."""
    mark, matrix, form, field, symmetry = (head.decode("ascii").lower().split() + [""] * 5)[:5]
    sign = {"general": 0, "symmetric": 1, "skew-symmetric": -1}.get(symmetry)
    known = form in ("coordinate", "array") and field in ("real", "double", "integer") and sign is not None
    if (mark, matrix) != ("%%matrixmarket", "matrix") or not known:
        raise ValueError("its first line names no real matrix")
    return form == "coordinate", sign or 0


def _sizes(line: bytes, sparse: bool, sign: int) -> list[int]:
    """Rows, columns and, of a sparse matrix, the number of its entries."""
    found = [int(number) for number in line.split()]
    if len(found) != 2 + sparse or not all(0 < size <= MOST_ROWS for size in found[:2]) or (sign and found[0] != found[1]):
        raise ValueError("its sizes are no whole numbers > 0, or too large")
    return found


def _mat(path: Path, name: str | None) -> Any:
    matrices = {key: value for key, value in read_mat(path).items() if value.ndim == 2}
    if name is None and len(matrices) != 1:
        listed = ", ".join(f"`{key}`" for key in matrices) or "none"
        raise SceneError(f"`{path}` must hold one matrix, or `names` must say which, but it holds {listed}.")
    if name is not None and name not in matrices:
        raise SceneError(f"`{path}` holds no matrix `{name}`: {suggest(name, matrices)}")
    return matrices[name] if name is not None else next(iter(matrices.values()))
