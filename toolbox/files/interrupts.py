"""Ctrl-C, the few operations on files that must not be cut in two, and the temporary files that vanish with the process.

What takes the place of an earlier result does so inside `undivided`: an interrupt that comes meanwhile waits for its end. A process that has to end at
once (see `toolbox.commands.interrupt`) asks `closed` for a moment in which nobody is inside, and nobody comes in any more.
"""

from __future__ import annotations

import contextlib
import secrets
import shutil
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any


class Gate:
    """Number of threads inside an undivided operation, and whether a result is in place. After that there is nothing to interrupt.

    asked: whether the process was interrupted and is to end;  keeping: whether the main thread looks at that by itself, to keep what is finished;  placed:
    whether the result of the process is in place.
    """

    def __init__(self) -> None:
        self.asked = self.keeping = self.placed = False
        self._inside = 0
        self._closed = False
        self._changed = threading.Condition()

    @property
    def interrupted(self) -> bool:
        """Whether an interrupt came before the result was in place."""
        return self.asked and not self.placed

    def enter(self) -> None:
        """Come in; for ever waiting where the process is about to end."""
        with self._changed:
            self._changed.wait_for(lambda: not self._closed or self._inside > 0)
            self._inside += 1

    @contextlib.contextmanager
    def kept(self) -> Iterator[None]:
        """Mark a block that calls `check` often and keeps finished results when `check` raises."""
        before, self.keeping = self.keeping, True
        try:
            yield
        finally:
            self.keeping = before

    def check(self, patience: float = 0.0) -> None:
        """Raise KeyboardInterrupt if the process was interrupted, or is interrupted within `patience` seconds."""
        last = time.monotonic() + patience
        while not self.asked and time.monotonic() < last:
            time.sleep(0.01)
        if self.asked:
            raise KeyboardInterrupt

    def leave(self) -> None:
        """Go out again."""
        with self._changed:
            self._inside -= 1
            self._changed.notify_all()

    def closed(self, seconds: float) -> bool:
        """Close the gate when the last thread has left, or after so many seconds. Return False, with the gate open, if the result is in
        place by then."""
        with self._changed:
            self._changed.wait_for(lambda: self._inside == 0, seconds)
            self._closed = not self.placed
            return self._closed


GATE = Gate()
"""The gate of this process."""


@contextlib.contextmanager
def undivided() -> Iterator[None]:
    """Ctrl-C during the block counts when it ends. Blocks may stand in blocks, and in other threads, which no signal reaches."""
    came: list[tuple[int, Any]] = []
    try:
        before = signal.signal(signal.SIGINT, lambda number, frame: came.append((number, frame)))
    except ValueError:  # not the main thread
        before, main = None, False
    else:
        main = True
    try:
        GATE.enter()
        try:
            yield
        finally:
            GATE.leave()
    finally:
        if main:
            signal.signal(signal.SIGINT, before or signal.SIG_DFL)
            if came:
                if callable(before):
                    before(*came[0])
                elif before == signal.SIG_DFL:
                    signal.raise_signal(signal.SIGINT)


_TEMPORARY: set[Path] = set()


@contextlib.contextmanager
def temporary(path: Path) -> Iterator[Path]:
    """A free name beside a path, `.NAME.<16 digits>.part`, which is free again after the block, or when the process is interrupted."""
    name = path.with_name(f".{path.name[:200]}.{secrets.token_hex(8)}.part")
    _TEMPORARY.add(name)
    try:
        yield name
    finally:
        with undivided():
            try:
                _remove(name)
            finally:  # an interrupt may have cut the first try
                _remove(name)
                _TEMPORARY.discard(name)


def clear_temporary() -> None:
    """Remove the temporary files and folders of this process: for its last moment."""
    for path in list(_TEMPORARY):
        _remove(path)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        with contextlib.suppress(OSError):
            path.unlink()
