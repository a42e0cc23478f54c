"""Whether a folder can be written, asked before a long work whose results it is to hold."""

from __future__ import annotations

import errno
import os
from pathlib import Path

from toolbox.errors import SceneError


def check_folder(path: Path) -> Path:
    """Return the folder to be written if it exists, or else its lowest existing parent. SceneError is raised if the folder cannot be
    written.

    Raises SceneError where nothing can be written there: who asks before a long work does not lose what comes of it.
    """
    path = path.absolute()
    if os.path.lexists(path) and not path.is_dir():
        raise SceneError(f"Argument `--out` must be a folder, but `{path}` is something else.")
    ground = next(place for place in (path, *path.parents) if place.exists())
    if not ground.is_dir() or not os.access(ground, os.W_OK | os.X_OK):
        frozen = os.name == "posix" and os.statvfs(ground).f_flag & os.ST_RDONLY
        reason = os.strerror(errno.ENOTDIR if not ground.is_dir() else errno.EROFS if frozen else errno.EACCES)
        raise SceneError(f"Argument `--out` must be a folder that can be written, but `{path}` cannot: {reason}.")
    return ground
