"""Writing files whole or not at all: what takes the place of an earlier result does so at one instant, or the earlier one comes back.

Everything is written under a temporary name beside its place, which no other process takes for a result, and which is locked while its process lives. What
a process leaves that is killed is told by the missing lock, and the next one that writes beside it clears it away; where it was killed between the old
and the new, the old comes back first.

What is recovered: files `.NAME.<16 digits>.part` and folders of that name are removed, of which the folder NAME comes back where there is none; folders
`.stickslip-<16 digits>` are removed, and the results of a command come back that it had moved into one, in place of those that it had put there. Only what
belongs to the user itself counts, never a symbolic link, and only what the note in the folder knows by its number in the file system: a folder that was
copied, unpacked or changed is not one that was left. It stays as it is, one sentence says so, and the write goes on.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import json
import os
import re
import secrets
import shutil
import stat
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from toolbox.errors import SceneError
from toolbox.files.interrupts import GATE, undivided
from toolbox.files.reading import TEXT, content
from toolbox.messages import LOG

try:
    import fcntl
except ImportError:  # Windows, where what is open cannot be removed
    fcntl = None  # type: ignore[assignment]

FORGOTTEN = 86_400.0
"""Seconds after which a temporary file counts as left where the system has no locks that tell."""

_OURS = re.compile(r"\.(?P<name>.+)\.[0-9a-f]{16}\.part|\.stickslip-[0-9a-f]{16}")

_TEMPORARY: set[Path] = set()

_TOLD: set[Path] = set()
"""What is not as it was left, and was told of."""


@contextmanager
def replaced(path: Path, durable: bool = False) -> Iterator[IO[bytes]]:
    """A binary file that takes the place of `path` when the block ends well, and vanishes otherwise. Raises SceneError where it cannot be written.

    durable: force it to disk before it takes the place, and the place after.
    """
    if not path.name:
        raise SceneError(f"Cannot write `{path}`: it names no file.")
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


def replaced_together(texts: Mapping[Path, str]) -> None:
    """Write several files of text, each in the place of the one that is there, all of them or none. Raises SceneError where one cannot be written."""
    with contextlib.ExitStack() as places:
        for path, text in texts.items():
            file = places.enter_context(replaced(path))
            file.write(text.encode())
            file.flush()  # a full disk shows before the first one takes its place


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
    ground, exists = check_folder(path), path.is_dir()
    for parent in (path, *path.parents):  # one that was killed may have made the folders below that in which it began
        if os.access(parent, os.W_OK):
            clear_left(parent)
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


def check_folder(path: Path) -> Path:
    """The lowest folder that there is on the way to one that is to be written, or it itself.

    Raises SceneError where nothing can be written there: who asks before a long work does not lose what comes of it.
    """
    path = path.absolute()
    if os.path.lexists(path) and not path.is_dir():
        raise SceneError(f"Argument `--out` must be a folder, but `{path}` is something else.")
    ground = path if path.is_dir() else next(parent for parent in path.parents if parent.exists())
    if not ground.is_dir() or not os.access(ground, os.W_OK | os.X_OK):
        frozen = os.name == "posix" and bool(os.statvfs(ground).f_flag & os.ST_RDONLY)
        reason = os.strerror(errno.ENOTDIR if not ground.is_dir() else errno.EROFS if frozen else errno.EACCES)
        raise SceneError(f"Argument `--out` must be a folder that can be written, but `{path}` cannot: {reason}.")
    return ground


def clear_left(folder: Path) -> None:
    """Clear away what processes of this user that were killed have left in a folder, and bring back what they had moved aside. Raises nothing."""
    try:
        found = [Path(entry.path) for entry in os.scandir(folder) if _OURS.fullmatch(entry.name) and Path(entry.path) not in _TEMPORARY]
    except OSError:  # what cannot be looked at cannot be written either, and that is said there
        return
    for left in found:
        try:
            with _abandoned(left):
                _check_left(left)
                _released(left)
        except OSError:
            continue
        except ValueError as error:
            if left not in _TOLD:
                _TOLD.add(left)
                LOG.warning("`%s` is left alone, because it is not what a command that was killed leaves: %s.", left, error)


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
    """Hold what a process of this user has left; raises OSError where its process lives, or may live, or is another's, ValueError for a link."""
    found = os.lstat(path)
    if not stat.S_ISREG(found.st_mode) and not stat.S_ISDIR(found.st_mode):
        raise ValueError("it is neither a file nor a folder")
    if fcntl is None:
        if time.time() - found.st_mtime < FORGOTTEN:
            raise BlockingIOError
        yield
        return
    handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        if os.fstat(handle).st_uid != os.geteuid() or not os.path.samestat(os.fstat(handle), found):
            raise PermissionError
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise
        except OSError:
            if time.time() - found.st_mtime < FORGOTTEN:
                raise
        yield
    finally:
        os.close(handle)


def _check_left(left: Path) -> None:
    """Raise ValueError unless a folder is as this module leaves it; a file may hold anything."""
    if not left.is_dir():
        return
    with os.scandir(left) as entries:
        for entry in entries:
            if entry.name not in ("names", "new", "old", "gone") or entry.is_symlink() or entry.is_dir() == (entry.name == "names"):
                raise ValueError(f"it holds `{entry.name}`")
    if fcntl is not None and left.stat().st_mode & 0o022:
        raise ValueError("others may write in it")
    if _whole(left) is None and (left / "old").exists():
        _check_note(left)


def _check_note(shelter: Path) -> None:
    """Raise ValueError unless the note in a shelter is its own, and everything in `old` has its place free."""
    try:
        note = json.loads(content(shelter / "names", TEXT))
        files, number = note["files"], note["folder"]
        bare = all(os.path.basename(name) == name and name not in ("", ".", "..") and type(value) is int for name, value in files.items())
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise ValueError("its note of what belongs to it is missing or damaged") from None
    if number != shelter.stat().st_ino or not bare:
        raise ValueError("its note is that of another folder")
    for file in (shelter / "old").iterdir():
        place = shelter.parent / file.name
        if os.path.lexists(place) and not _is_placed(place, files):
            raise ValueError(f"`{file.name}` would come back, but there is another one")


def _is_placed(place: Path, files: dict[str, int]) -> bool:
    """Whether a file is one that the process put there that left a note of them."""
    return os.path.lexists(place) and files.get(place.name) == os.lstat(place).st_ino


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
    files = {file.name: file.lstat().st_ino for file in sorted(new.iterdir())}
    (shelter / "names").write_text(json.dumps({"folder": shelter.stat().st_ino, "files": files}), encoding="utf-8")
    old.mkdir()
    for name in sorted(earlier):
        with contextlib.suppress(FileNotFoundError):
            os.rename(path / name, old / name)
    for name in files:
        os.rename(new / name, path / name)
    os.rename(old, shelter / "gone")


def _whole(shelter: Path) -> Path | None:
    """The folder whose place a temporary one takes as a whole; None for the results of a command among other files."""
    match = _OURS.fullmatch(shelter.name)
    return None if match is None or match["name"] is None else shelter.with_name(match["name"])


def _put_back(shelter: Path) -> None:
    """Bring back what stands in `shelter/old`, which is there only where the new did not get into place whole."""
    old = shelter / "old"
    if not old.is_dir():
        return
    path = _whole(shelter)
    if path is not None:
        if not os.path.lexists(path):
            os.rename(old, path)
        return
    files = json.loads(content(shelter / "names", TEXT))["files"]
    for name in files:
        if _is_placed(shelter.parent / name, files):
            os.rename(shelter.parent / name, shelter / "new" / name)
    for file in sorted(old.iterdir()):
        os.rename(file, shelter.parent / file.name)
    old.rmdir()
