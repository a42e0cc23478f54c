"""Machine code on disk, for all installations of a user on a machine: whole files with their checksums, which cost time at most where they are lost.

Machine code is run, so that it is taken only from where nobody but the user can have put it: files of the user or of root, in folders of either in which
others cannot write, up to the root of the file system. A folder such as /tmp, in which everybody writes, but where nobody moves what is another's, is no danger
to the folders in it. Systems without owners, such as Windows, keep what is in a user's folder from others by themselves.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
from pathlib import Path

from toolbox.errors import SceneError
from toolbox.files.atomic import replaced
from toolbox.files.reading import opened
from toolbox.messages import LOG

_TOLD: list[str] = []
"""What was said of a folder that is not used: once in a process."""


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


def trusted(folder: Path) -> bool:
    """Return whether only the user and root can put code into a folder, or into the parents in which the folder is to be made. A fault is
    reported once."""
    if not hasattr(os, "geteuid"):
        return True
    given = Path(os.path.abspath(folder))
    real = Path(os.path.realpath(folder))
    for part in {given, *given.parents, real, *real.parents}:
        try:
            found = part.stat()
        except OSError:  # not there yet, and its place is looked at
            continue
        fault = ""
        if found.st_uid not in (0, os.geteuid()):
            fault = "belongs to another user"
        elif found.st_mode & 0o022 and not found.st_mode & stat.S_ISVTX and not _private_group(found):
            fault = "can be written by other users"
        if fault:
            if not _TOLD:
                _TOLD.append(fault)
                LOG.warning(
                    "machine code is not kept in `%s`, because `%s` %s, so that every process compiles anew: STICKSLIP_CACHE_DIR names a better folder.",
                    folder, part, fault,
                )  # fmt: skip
            return False
    return True


def _private_group(found: os.stat_result) -> bool:
    """Whether only a group may write that has the user alone, as many systems give to each user."""
    if found.st_mode & 0o002 or found.st_gid != os.getegid():
        return False
    import grp
    import pwd

    try:
        group, user = grp.getgrgid(found.st_gid), pwd.getpwuid(os.geteuid())
    except KeyError:
        return False
    return group.gr_name == user.pw_name and set(group.gr_mem) <= {user.pw_name}


def kept(path: Path) -> bytes | None:
    """Return the code of a file, and mark the file as used now. None if the file is missing, is damaged, or may have been written by
    others."""
    if not os.path.lexists(path) or not trusted(path.parent):
        return None
    try:
        with opened(path, apart=True) as file:
            owned = not hasattr(os, "geteuid") or os.fstat(file.fileno()).st_uid in (0, os.geteuid())
            content = file.read() if owned else b""
    except (OSError, SceneError):
        return None
    if hashlib.sha256(content[32:]).digest() != content[:32]:
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return content[32:]


def keep(path: Path, code: bytes) -> bool:
    """Write a file of code into a folder for its user alone, and return whether the file was written. A failure is only written to the
    log."""
    if not trusted(path.parent):
        return False
    try:
        for folder in reversed(path.parents):
            with contextlib.suppress(FileExistsError):
                if not folder.exists():
                    folder.mkdir(mode=0o700)
        with replaced(path) as file:
            file.write(hashlib.sha256(code).digest() + code)
        return True
    except (OSError, SceneError) as error:
        LOG.debug("machine code is not kept, so that it is made again: %s", error)
        return False
