"""Matrices from the files of finite-element programs: Matrix Market and MAT."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from toolbox import SceneError
from toolbox.authoring import suggest


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
    if not path.is_file():
        raise SceneError(f"There is no file `{path}`.")
    return kinds[kind](path, name)


def _matrix_market(path: Path, name: str | None) -> Any:
    from scipy.io import mmread

    if name is not None:
        raise SceneError(f"`{path}` holds one matrix without a name, but `{name}` is asked for.")
    try:
        return mmread(path)
    except (ValueError, OSError, EOFError, OverflowError, TypeError) as error:
        raise SceneError(f"`{path}` is no sound Matrix Market file: {error}") from None


def _mat(path: Path, name: str | None) -> Any:
    from scipy.io import loadmat

    try:
        held = loadmat(path)
    except NotImplementedError:
        raise SceneError(f"`{path}` is a MAT file of version 7.3, which is not read: save it with -v7, or as Matrix Market.") from None
    except Exception as error:  # a damaged file may fail anywhere in the reader
        raise SceneError(f"`{path}` is no sound MAT file: {error}") from None
    matrices = {
        key: value
        for key, value in held.items()
        if not key.startswith("__") and getattr(value, "ndim", 0) == 2 and value.dtype.kind in "iuf"
    }
    if name is None and len(matrices) != 1:
        listed = ", ".join(f"`{key}`" for key in matrices) or "none"
        raise SceneError(f"`{path}` must hold one matrix, or `names` must say which, but it holds {listed}.")
    if name is not None and name not in matrices:
        raise SceneError(f"`{path}` holds no matrix `{name}`: {suggest(name, matrices)}")
    return matrices[name] if name is not None else next(iter(matrices.values()))
