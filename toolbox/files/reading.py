"""Opening files for reading: regular files alone, and none larger than it may be, before a byte of it is read.

A device such as /dev/zero has no end, and a pipe that nobody writes to lets its reader wait for ever; a few kilobytes can unpack to more than a machine
holds. Every reader of the toolbox opens its files here.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from toolbox.errors import SceneError, suggest

LARGEST = 4 * 2**30
"""Bytes of the largest file of arrays that is read."""

TEXT = 256 * 2**20
"""Bytes of the largest table, report or journal that is read."""

SCENE = 4 * 2**20
"""Bytes of the largest file in TOML that is read."""

UNPACKED, RATIO = 256 * 2**20, 50
"""A file may unpack to so many bytes, and beyond that to so many times its size: measured arrays shrink by less, and what shrinks more was made to."""

_KINDS = {stat.S_IFDIR: "a folder", stat.S_IFIFO: "a pipe", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device", stat.S_IFSOCK: "a socket"}


_NOTING: list[set[Path]] = []


@contextmanager
def noted() -> Iterator[set[Path]]:
    """Yield a set that collects the path of every file opened here during the block, except files opened with `apart`."""
    found: set[Path] = set()
    _NOTING.append(found)
    try:
        yield found
    finally:
        _NOTING.remove(found)


def opened(path: str | Path, most: int = LARGEST, what: str = "file", apart: bool = False) -> BinaryIO:
    """Open a regular file for reading.

    Parameters
    ----------
    path
        The file.
    most
        Largest size [byte], by default 4 GiB.
    what
        Description of the expected contents of the file, for messages, such as "log", by default "file".
    apart
        Whether the file is an earlier result or a checkpoint rather than an input of a command, by default False.

    Returns
    -------
    BinaryIO
        The open file.

    Raises
    ------
    SceneError
        If the file is missing, cannot be read, is larger than `most`, or is no regular file. A pipe is refused at
        once.

    Examples
    --------
    >>> from pathlib import Path
    >>> from toolbox.authoring import opened
    >>> _ = Path("gains.txt").write_text("420.6")
    >>> with opened("gains.txt") as file:
    ...     print(float(file.read()))
    420.6
    """
    path = Path(path)
    for found in _NOTING if not apart else ():
        found.add(Path(os.path.normpath(path)))
    try:
        _check(path, os.stat(path), most, what)
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
        try:
            _check(path, os.fstat(handle), most, what)  # it may be another by now
            return os.fdopen(handle, "rb")
        except BaseException:
            os.close(handle)
            raise
    except SceneError:
        raise
    except (FileNotFoundError, NotADirectoryError):
        raise SceneError(f"There is no {what} `{_named(path)}`{_near(path)}") from None
    except (OSError, ValueError) as error:
        words = error.strerror if isinstance(error, OSError) else str(error)
        raise SceneError(f"{what.capitalize()} `{_named(path)}` cannot be read: {words}.") from None


def content(path: str | Path, most: int = LARGEST, what: str = "file", apart: bool = False) -> bytes:
    """The bytes of a file; else as `opened`."""
    with opened(path, most, what, apart) as file:
        try:
            return file.read(os.fstat(file.fileno()).st_size)
        except OSError as error:
            raise SceneError(f"{what.capitalize()} `{_named(Path(path))}` cannot be read: {error.strerror}.") from None


def text_of(path: str | Path, most: int = TEXT, what: str = "file", apart: bool = False) -> str:
    """The text of a file in UTF-8, with a byte order mark or without; else as `opened`. Raises SceneError for anything else than UTF-8, too."""
    try:
        return content(path, most, what, apart).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        raise SceneError(f"{what.capitalize()} `{_named(Path(path))}` must be text in UTF-8, but it is not.") from None


def most_unpacked(size: int) -> int:
    """Bytes that a packed file of a size may hold."""
    return min(max(UNPACKED, RATIO * size), LARGEST)


def _check(path: Path, found: os.stat_result, most: int, what: str) -> None:
    if not stat.S_ISREG(found.st_mode):
        kind = _KINDS.get(stat.S_IFMT(found.st_mode), "something else")
        raise SceneError(f"{what.capitalize()} `{_named(path)}` must be a regular file, but it is {kind}: it cannot be read.")
    if found.st_size > most:
        raise SceneError(
            f"{what.capitalize()} `{_named(path)}` must be of at most {most / 2**20:.0f} MiB, but it is of {found.st_size / 2**20:.0f} MiB."
        )


def _near(path: Path) -> str:
    """The end of the sentence that there is no such file: where a link of that name leads, or the name of one beside it that is nearest."""
    if path.is_symlink():
        return f": it is a symbolic link to `{_named(Path(os.readlink(path)))}`, which is not there."
    try:
        beside = [other.name for other in path.parent.iterdir() if other.suffix == path.suffix]
    except (OSError, ValueError):
        beside = []
    return f": {suggest(path.name, beside)}" if beside else "."


def _named(path: Path) -> str:
    name = str(path)
    return name if len(name) <= 500 else f"{name[:200]}...{name[-200:]}"
