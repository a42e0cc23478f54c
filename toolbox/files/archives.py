"""Arrays from npz files that anybody may have written or damaged: read whole and checked before they are used, and never as code."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from toolbox.errors import SceneError, suggest


def arrays(path: Path, what: str) -> dict[str, np.ndarray]:
    """The arrays in an npz file, by name, each of which agrees with its checksum. Raises SceneError where that is not so; what: that the file must be."""
    if not path.is_file():
        beside = [other.name for other in path.parent.glob("*.npz")] if path.parent.is_dir() else []
        raise SceneError(f"There is no file `{path}`" + (f": {suggest(path.name, beside)}" if beside else "."))
    found = {}
    with understood(path, what), zipfile.ZipFile(path) as archive:
        for entry in archive.infolist():
            content = io.BytesIO(archive.read(entry))  # to its end, where the checksum is looked at
            found[entry.filename.removesuffix(".npy")] = np.lib.format.read_array(content, allow_pickle=False)
    return found


@contextmanager
def understood(path: Path, what: str) -> Iterator[None]:
    """Whatever a damaged file raises in the block, from wrong types to a lack of memory, becomes a SceneError that names the file."""
    try:
        yield
    except SceneError:
        raise
    except KeyError as error:
        raise SceneError(f"File `{path}` must be {what}, but it has no {error}.") from None
    except Exception as error:
        words = f"{error}".rstrip(".") or type(error).__name__
        raise SceneError(f"File `{path}` must be {what}, but it is not: {words}.") from None
