"""Writing files and folders whole or not at all: each is written beside its place under a temporary name, and takes its place at one instant.

A folder takes its place by exchange with the one that is there, in one step of the system where it has one (Linux, macOS), else by two renames. Whoever is
killed leaves the old or the new in place, and perhaps a temporary file or folder `.NAME.<16 digits>.part`, which nobody reads and anybody may delete. Between
two renames it leaves the old folder there. Nothing that is found under such a name is ever obeyed.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import IO, Any

from toolbox.errors import SceneError
from toolbox.files.interrupts import GATE, temporary, undivided
from toolbox.files.writable import check_folder


@contextlib.contextmanager
def replaced(path: Path, durable: bool = False) -> Iterator[IO[bytes]]:
    """Open a temporary binary file for a `with` block. If the block ends without an error, the file replaces `path`. Otherwise it is removed.

    Parameters
    ----------
    path
        The file that is replaced.
    durable
        Whether the new file is forced to disk before it replaces the old one, and the directory after it, by default
        False.

    Returns
    -------
    context manager of a binary file
        The new file.

    Raises
    ------
    SceneError
        If the file cannot be written.

    Examples
    --------
    >>> from pathlib import Path
    >>> from toolbox.authoring import replaced
    >>> with replaced(Path("gains.txt")) as file:
    ...     _ = file.write(b"420.6")
    >>> print(Path("gains.txt").read_text())
    420.6
    """
    if not path.name:
        raise SceneError(f"Cannot write `{path}`: it names no file.")
    with temporary(path) as name:
        try:
            handle = os.open(name, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666)
        except OSError as error:
            raise SceneError(f"Cannot write `{path}`: {error.strerror}.") from None
        with os.fdopen(handle, "wb") as file:
            yield file
            file.flush()
            if durable:
                os.fsync(file.fileno())
        with undivided():
            os.replace(name, path)
    if durable:
        _sync(path.parent)


@contextlib.contextmanager
def replaced_folder(path: Path) -> Iterator[Path]:
    """Yield a new folder that replaces `path` when the block ends without error, and vanishes otherwise. SceneError is raised if the folder
    cannot be written."""
    path = path.absolute()
    with temporary(path) as shelter:
        try:
            shelter.mkdir()
            yield shelter / "new"
            with undivided():
                _exchange(shelter / "new", path)
                _sync(path.parent)
        except OSError as error:
            raise SceneError(f"Cannot write `{path}`: {error.strerror}.") from None


@contextlib.contextmanager
def whole_folder(path: Path, names: Sequence[str], left_by: Callable[[Path], set[str]], last: bool = True) -> Iterator[Path]:
    """A temporary folder whose files `names` appear in `path` together when the block ends well, and vanish otherwise.

    Files of an earlier study, which `left_by` names, are replaced; other files stay: they get a second name in the new folder, which is exchanged with the old.
    Where that cannot be (the working directory, a mount, a file system without links) the files take their places one by one.
    last: whether a command has nothing to do after it that an interrupt could spoil.
    Raises SceneError, before the block runs, where `path` cannot be written and where a file in the way is not from an earlier study.
    """
    path, used = Path(os.path.realpath(path)), Path.cwd()
    ground, exists, earlier = check_folder(path), path.is_dir(), left_by(path) if path.is_dir() else set()
    if hidden := [name for name in names if os.path.lexists(path / name) and name not in earlier]:
        raise SceneError(f"Argument `--out` must not hide your own files, but `{path / hidden[0]}` is not from an earlier study.")
    moves = os.access(path.parent, os.W_OK | os.X_OK) and not os.path.ismount(path) and path not in (used, *used.parents)
    with temporary(path if exists and moves else ground / path.name) as shelter:
        new = shelter / "new"
        try:
            new.mkdir(parents=True)
        except OSError as error:
            raise SceneError(f"Argument `--out` must be a folder that can be written, but `{path}` cannot: {error.strerror}.") from None
        yield new
        made = {file.name for file in new.iterdir()}
        try:
            if exists and moves:
                _carry(path, new, earlier | made)
        except (OSError, NotImplementedError):
            moves = False
        with undivided():
            GATE.check()
            path.parent.mkdir(parents=True, exist_ok=True)
            if moves or not path.is_dir():
                old = _exchange(new, path)
                if old.is_dir():
                    _carry(old, path, earlier | made)  # files that came meanwhile
            else:
                for name in sorted(made):
                    os.replace(new / name, path / name)
                for name in earlier - made:
                    (path / name).unlink(missing_ok=True)
            GATE.placed = last


def _sync(folder: Path) -> None:
    """Force the names in a folder to disk, where the system can."""
    if os.name == "posix":
        with contextlib.ExitStack() as stack:
            stack.callback(os.close, handle := os.open(folder, os.O_RDONLY))
            os.fsync(handle)


def _exchange(new: Path, path: Path) -> Path:
    """Put a folder in the place of another, at one instant where the system can. Returns where the other one is then, if there was one."""
    old = new.with_name("old")
    if _exchanged(new, path):
        return new
    try:
        if os.path.lexists(path):
            os.rename(path, old)
        os.rename(new, path)
    except BaseException:
        if old.is_dir() and not os.path.lexists(path):
            os.rename(old, path)
        raise
    return old


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange two folders at one instant; False where the system cannot."""
    with contextlib.suppress(OSError, AttributeError, TypeError):
        library = ctypes.CDLL(None, use_errno=True)
        if sys.platform == "linux":
            return library.renameat2(-100, os.fsencode(one), -100, os.fsencode(other), 2) == 0
        if sys.platform == "darwin":
            return library.renamex_np(os.fsencode(one), os.fsencode(other), 2) == 0
    return False


LINK_ITSELF: dict[str, Any] = {"follow_symlinks": False} if os.link in os.supports_follow_symlinks else {}  # Windows does so untold


def _carry(source: Path, target: Path, without: Collection[str] = ()) -> None:
    """Give all files in a folder a second name in another one; a file that is another one there takes its place."""
    for entry in list(os.scandir(source)):
        place = target / entry.name
        if entry.is_dir(follow_symlinks=False):
            place.mkdir(exist_ok=True)
            _carry(Path(entry.path), place)
        elif entry.name not in without and not os.path.lexists(place):
            os.link(entry.path, place, **LINK_ITSELF)
        elif entry.name not in without and not os.path.samestat(entry.stat(follow_symlinks=False), place.lstat()):
            os.replace(entry.path, place)
    if os.name == "posix":
        os.chown(target, source.stat().st_uid, source.stat().st_gid)
    shutil.copystat(source, target)
