"""Writing files whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
import signal
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from toolbox.errors import SceneError


@contextmanager
def replaced(path: Path, durable: bool = False) -> Iterator[IO[bytes]]:
    """A binary file that takes the place of `path` when the block ends well, and vanishes otherwise. Raises SceneError where it cannot be written.

    durable: force it to disk before it takes the place, and the place after.
    """
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise SceneError(f"Cannot write `{path}`: {error.strerror}.") from None
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
            if durable:
                file.flush()
                os.fsync(file.fileno())
        os.chmod(name, 0o644)
        os.replace(name, path)
    except BaseException:
        os.unlink(name)
        raise
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
    try:
        shelter = Path(tempfile.mkdtemp(dir=path.absolute().parent, prefix=f".{path.name}."))
    except OSError as error:
        raise SceneError(f"Cannot write `{path}`: {error.strerror}.") from None
    try:
        yield shelter / "new"
        if path.exists():
            os.replace(path, shelter / "old")
        os.replace(shelter / "new", path)
        synced(path.absolute().parent)
    except OSError as error:
        raise SceneError(f"Cannot write `{path}`: {error.strerror}.") from None
    finally:
        shutil.rmtree(shelter, ignore_errors=True)


@contextmanager
def whole_folder(path: Path, names: Sequence[str], left_by: Callable[[Path], set[str]]) -> Iterator[Path]:
    """A temporary folder whose files `names` appear in `path` together when the block ends well, and vanish otherwise.

    Files of an earlier study in `path` are replaced, other files stay; left_by: function that names those of an earlier one.
    Raises SceneError, before the block runs, where `path` cannot be written and where a file in the way is not from an earlier study.
    """
    path = path.absolute()
    if os.path.lexists(path) and not path.is_dir():
        raise SceneError(f"Argument `--out` must be a folder, but `{path}` is something else.")
    exists = path.is_dir()
    earlier = left_by(path) if exists else set()
    for name in names:
        if exists and (path / name).exists() and name not in earlier:
            raise SceneError(f"Argument `--out` must not hide your own files, but `{path / name}` is not from an earlier study.")
    ground = path if exists else next(parent for parent in path.parents if parent.exists())
    shelter = ground / f".stickslip-{secrets.token_hex(8)}"  # named before it exists, so that an interrupt leaves nothing behind
    folder = shelter / "study"
    try:
        try:
            shelter.mkdir(mode=0o700)
            folder.mkdir()
        except OSError as error:
            raise SceneError(f"Argument `--out` must be a folder that can be written, but `{path}` cannot: {error.strerror}.") from None
        yield folder
        with _uninterrupted():
            if not exists:
                path.parent.mkdir(parents=True, exist_ok=True)
                folder.rename(path)
            else:
                for name in earlier:
                    (path / name).unlink(missing_ok=True)
                for file in folder.iterdir():
                    file.replace(path / file.name)
    finally:
        shutil.rmtree(shelter, ignore_errors=True)


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Ctrl-C has no effect on the block (where signals can be handled at all)."""
    try:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    except ValueError:  # not the main thread
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
