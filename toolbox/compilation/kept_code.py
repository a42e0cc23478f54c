"""Machine code on disk, for all installations of a user on a machine: whole files with their checksums, which cost time at most where they are lost."""

from __future__ import annotations

import contextlib
import hashlib
import os
from pathlib import Path

from toolbox.errors import SceneError
from toolbox.files.atomic import replaced
from toolbox.messages import LOG


def cache_directory() -> Path:
    """Where machine code is kept: STICKSLIP_CACHE_DIR, else the user's cache directory."""
    named = os.environ.get("STICKSLIP_CACHE_DIR")
    if named:
        return Path(named)
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    if not base:
        try:
            base = str(Path.home() / ".cache")
        except RuntimeError:  # a user without a home, as in a container: nothing can be kept there, which costs time only
            base = os.devnull
    return Path(base) / "stickslip"


def kept(path: Path) -> bytes | None:
    """The code of a file, which counts as used just now; None where there is none or the file is damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    if hashlib.sha256(content[32:]).digest() != content[:32]:
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return content[32:]


def keep(path: Path, code: bytes) -> None:
    """Write a file of code; a folder that cannot be written is only told to the log."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replaced(path) as file:
            file.write(hashlib.sha256(code).digest() + code)
    except (OSError, SceneError) as error:
        LOG.debug("machine code is not kept, so that it is made again: %s", error)
