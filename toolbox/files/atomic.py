"""Writing files whole or not at all: what takes the place of an earlier result does so at one instant, or the earlier one comes back.

Everything is written under a temporary name beside its place, which no other process takes for a result, and which is locked while its process lives. What
a process leaves that is killed is told by the missing lock, and the next one that writes beside it clears it away; where it was killed between the old
and the new, the old comes back first.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import re
import secrets
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from toolbox.errors import SceneError
from toolbox.files.interrupts import GATE, undivided

try:
    import fcntl
except ImportError:  # Windows, where what is open cannot be removed
    fcntl = None  # type: ignore[assignment]

FORGOTTEN = 86_400.0
"""Seconds after which a temporary file counts as left where the system has no locks that tell."""

_OURS = re.compile(r"\.(?P<name>.+)\.[0-9a-f]{16}\.part|\.stickslip-[0-9a-f]{16}")

_TEMPORARY: set[Path] = set()


@contextmanager
def replaced(path: Path, durable: bool = False) -> Iterator[IO[bytes]]:
    """A binary file that takes the place of `path` when the block ends well, and vanishes otherwise. Raises SceneError where it cannot be written.

    durable: force it to disk before it takes the place, and the place after.
    """
    clear_left(path.parent)
    with _temporary(path.with_name(f".{path.name[:200]}.{secrets.token_hex(8)}.part")) as name:
        try:
            file = os.fdopen(_locked_file(name), "wb")
        except OSError as error:
            raise SceneError(f"Cannot write `{path}`: {error.strerror}.") from None
        with file:
            yield file
            file.flush()
            if durable:
                os.fsync(file.fileno())
            if fcntl is None:
                file.close()
            with undivided():
                os.replace(name, path)
    if durable:
        synced(path.parent)


def synced(folder: Path) -> None:
    """Force the names in a folder to disk, where the system can."""
    if os.name == "posix":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextmanager
def replaced_folder(path: Path) -> Iterator[Path]:
    """A new folder that takes the place of `path`, empty or not, when the block ends well, and vanishes otherwise. Raises SceneError where it cannot be."""
    path = path.absolute()
    clear_left(path.parent)
    shelter = path.with_name(f".{path.name}.{secrets.token_hex(8)}.part")
    with contextlib.ExitStack() as locked, _temporary(shelter):
        try:
            _lock_folder(shelter, locked)
            yield shelter / "new"
            with undivided():
                _swapped(shelter, path)
                synced(path.parent)
        except OSError as error:
            raise SceneError(f"Cannot write `{path}`: {error.strerror}.") from None


@contextmanager
def whole_folder(path: Path, names: Sequence[str], left_by: Callable[[Path], set[str]], last: bool = True) -> Iterator[Path]:
    """A temporary folder whose files `names` appear in `path` together when the block ends well, and vanish otherwise.

    Files of an earlier study in `path` are replaced, other files stay; left_by: function that names those of an earlier one;
    last: whether a command has nothing to do after it that an interrupt could spoil.
    Raises SceneError, before the block runs, where `path` cannot be written and where a file in the way is not from an earlier study.
    """
    path = path.absolute()
    if os.path.lexists(path) and not path.is_dir():
        raise SceneError(f"Argument `--out` must be a folder, but `{path}` is something else.")
    exists = path.is_dir()
    ground = path if exists else next(parent for parent in path.parents if parent.exists())
    clear_left(ground)
    earlier = left_by(path) if exists else set()
    for name in names:
        if exists and (path / name).exists() and name not in earlier:
            raise SceneError(f"Argument `--out` must not hide your own files, but `{path / name}` is not from an earlier study.")
    shelter = ground / f".stickslip-{secrets.token_hex(8)}"
    with contextlib.ExitStack() as locked, _temporary(shelter):
        try:
            _lock_folder(shelter, locked)
            (shelter / "new").mkdir()
        except OSError as error:
            raise SceneError(f"Argument `--out` must be a folder that can be written, but `{path}` cannot: {error.strerror}.") from None
        yield shelter / "new"
        with undivided():
            GATE.check()
            if exists:
                _placed(shelter, path, earlier)
            else:
                _moved_in(shelter / "new", path)
            GATE.placed = last


def clear_left(folder: Path) -> None:
    """Clear away what processes that were killed have left in a folder, and bring back what they had moved aside."""
    try:
        found = [Path(entry.path) for entry in os.scandir(folder) if _OURS.fullmatch(entry.name) and Path(entry.path) not in _TEMPORARY]
    except OSError:  # what cannot be looked at cannot be written either, and that is said there
        return
    for left in found:
        with contextlib.suppress(OSError), _abandoned(left):
            _released(left)


def clear_own() -> None:
    """Clear away what this process was writing: for its last moment."""
    for path in list(_TEMPORARY):
        with contextlib.suppress(OSError):
            _released(path)


# ------------------------------------------------------------------------------------------------------------------------------- temporary names
@contextmanager
def _temporary(path: Path) -> Iterator[Path]:
    """A path that is free again after the block: noted before it exists, so that nothing stays behind."""
    _TEMPORARY.add(path)
    try:
        yield path
    finally:
        with undivided():
            try:
                _released(path)
            except BaseException:
                _released(path)
                raise
            finally:
                _TEMPORARY.discard(path)


def _released(path: Path) -> None:
    _put_back(path)
    _removed(path)
    if os.path.lexists(path):
        _removed(path)


def _removed(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink()


def _locked_file(path: Path) -> int:
    """Handle of a new file, locked as long as it is open."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666)
        if _lock(handle, path):
            return handle
        os.close(handle)


def _lock_folder(path: Path, locked: contextlib.ExitStack) -> None:
    """Make a folder, locked until the stack is closed."""
    while True:
        path.mkdir(mode=0o700)
        if fcntl is None:
            return
        handle = os.open(path, os.O_RDONLY)
        locked.callback(os.close, handle)
        if _lock(handle, path):
            return


def _lock(handle: int, path: Path) -> bool:
    """Lock what has just been made, and return whether it is still there: another process may have taken it for left before it was locked."""
    if fcntl is not None:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_EX)
    with contextlib.suppress(OSError):
        return os.path.samestat(os.fstat(handle), path.stat())
    return False


@contextmanager
def _abandoned(path: Path) -> Iterator[None]:
    """Hold what a process has left; raises OSError where its process lives, or may live."""
    if fcntl is None:
        if time.time() - path.stat().st_mtime < FORGOTTEN:
            raise BlockingIOError
        yield
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise
        except OSError:
            if time.time() - path.stat().st_mtime < FORGOTTEN:
                raise
        yield
    finally:
        os.close(handle)


# ------------------------------------------------------------------------------------------------------------------------------------ old and new
def _swapped(shelter: Path, path: Path) -> None:
    """Put `shelter/new` in the place of a folder: at one instant where the system can, else by two renames of which the first is taken back."""
    new, old = shelter / "new", shelter / "old"
    if not os.path.lexists(path):
        os.rename(new, path)
    elif not _exchanged(new, path):
        os.rename(path, old)
        try:
            os.rename(new, path)
        except BaseException:
            os.rename(old, path)
            raise


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange two folders at one instant; False where the system cannot."""
    try:
        library = ctypes.CDLL(None, use_errno=True)
        if sys.platform == "linux":
            return library.renameat2(-100, os.fsencode(one), -100, os.fsencode(other), 2) == 0
        if sys.platform == "darwin":
            return library.renamex_np(os.fsencode(one), os.fsencode(other), 2) == 0
    except (OSError, AttributeError, TypeError):
        pass
    return False


def _moved_in(new: Path, path: Path) -> None:
    """Move a folder to a place that is free, with the folders above it; those that are new vanish where it fails."""
    above = [parent for parent in path.parents if not parent.exists()]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        new.rename(path)
    except BaseException:
        for parent in above:
            with contextlib.suppress(OSError):
                parent.rmdir()
        raise


def _placed(shelter: Path, path: Path, earlier: set[str]) -> None:
    """Put the files of `shelter/new` into a folder in place of `earlier` ones; where that fails, or is cut off by a kill, `_put_back` undoes it.

    While `shelter/old` is there, the folder counts as not changed, and `shelter/names` says what was to come.
    """
    new, old = shelter / "new", shelter / "old"
    files = sorted(file.name for file in new.iterdir())
    (shelter / "names").write_text(json.dumps(files), encoding="utf-8")
    old.mkdir()
    for name in sorted(earlier):
        with contextlib.suppress(FileNotFoundError):
            os.rename(path / name, old / name)
    for name in files:
        os.rename(new / name, path / name)
    os.rename(old, shelter / "gone")


def _put_back(shelter: Path) -> None:
    """Bring back what stands in `shelter/old`, which is there only where the new did not get into place whole."""
    old = shelter / "old"
    if not old.is_dir() and not old.is_symlink():
        return
    match = _OURS.fullmatch(shelter.name)
    if match is not None and match["name"] is not None:  # a whole folder
        path = shelter.with_name(match["name"])
        if not os.path.lexists(path):
            os.rename(old, path)
        return
    for name in json.loads((shelter / "names").read_text(encoding="utf-8")):
        if not (shelter / "new" / name).exists():
            (shelter.parent / name).unlink(missing_ok=True)
    for file in sorted(old.iterdir()):
        os.rename(file, shelter.parent / file.name)
    old.rmdir()
