"""Ctrl-C and SIGTERM in a process that is a command: it ends with 130 or 143 and one line on stderr, soon, whatever it is doing, and nothing half-written.

Why not KeyboardInterrupt: Python raises it between any two of its own instructions. While LLVM makes a loop there are none for seconds. Where the next one is
in a function that LLVM calls back, the exception is lost and the study runs on, or LLVM goes on without what it asked for and the process dies; where it is in
an import, half a module stays behind, and something else fails. So the signal is noted, no more, and a thread that the system wakes at once ends it all:
it lets a sweep keep what is finished, waits until no result is just taking its place, and clears the temporary files and the worker processes away.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from toolbox.files.interrupts import GATE, clear_temporary

INTERRUPTED = 130
"""Exit code of what was interrupted."""

TERMINATED = 143
"""Exit code of what was asked to end by SIGTERM, as the system and batch queues do."""

NOTHING = "interrupted, and nothing was written."
"""Message of most commands."""

GOES_ON = "interrupted; the same call goes on from here."
"""Message of a command whose folder holds a part of its results."""

MOMENT = 0.5
"""Seconds that a sweep has to keep what is finished and to say how much that is."""

PLACING = 5.0
"""Seconds that results which are just taking their places have to get there."""

LAST = 2.0
"""Seconds that clearing away may take."""


class Watch:
    """Watch over the interrupts of a process. message: function that gives its line on stderr, called when the interrupt comes."""

    def __init__(self) -> None:
        self.message: Callable[[], str] = lambda: NOTHING
        self._code = INTERRUPTED
        self._out, self._ending = threading.Event(), threading.Lock()
        self._woken, self._wakes = socket.socketpair()
        self._wakes.setblocking(False)

    def begin(self) -> None:
        """Look after them from now on, in the main thread of a process that is nothing but a command."""
        GATE.asked = GATE.placed = False
        threading.Thread(target=self._wait, name="interrupts", daemon=True).start()
        signal.set_wakeup_fd(self._wakes.fileno(), warn_on_full_buffer=False)
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, _noted)

    def interrupted(self, words: str = "") -> NoReturn:
        """End the process from its main thread."""
        self._out.set()
        self._end(words or self.message())

    def over(self, code: int) -> NoReturn:
        """End the process with the exit code of its result, unless it was interrupted before that was in place."""
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        if GATE.interrupted:
            self.interrupted()
        sys.exit(code)

    def _wait(self) -> None:
        while not (came := {signal.SIGINT, signal.SIGTERM} & set(self._woken.recv(64))):
            pass
        self._code = TERMINATED if signal.SIGTERM in came else INTERRUPTED
        GATE.asked = True
        if GATE.keeping:
            self._out.wait(MOMENT)
        if GATE.closed(PLACING):
            self._end(self.message())

    def _end(self, words: str) -> NoReturn:
        self._ending.acquire()  # and never released: whoever comes second waits for the end
        last = threading.Timer(LAST, os._exit, (self._code,))
        last.daemon = True
        last.start()
        with contextlib.suppress(Exception):
            sys.stdout.flush()
        with contextlib.suppress(Exception):
            sys.stderr.write(f"stickslip: {' '.join(words.split())}\n")
            sys.stderr.flush()
        with contextlib.suppress(Exception):
            clear_temporary()
        with contextlib.suppress(Exception):
            _without_workers()
        os._exit(self._code)


def goes_on(folder: Path | None) -> str:
    """Return the message of a command that keeps results in a folder as they come: that the same call goes on, if the folder holds any.

    Parameters
    ----------
    folder
        Folder of the results; None for a command that was given none.
    """
    if folder is None:
        return "interrupted."
    with contextlib.suppress(OSError):
        if any(_is_kept(path) for path in folder.rglob("*")):
            return GOES_ON
    return NOTHING


def _is_kept(path: Path) -> bool:
    """Whether a search goes on from a file or folder: a journal with a result behind its first line, the store of a sweep, or finished results."""
    if path.suffix == ".jsonl":
        with path.open("rb") as file:
            return bool(file.readline() and file.readline())
    return path.suffix in (".zarr", ".npz")


def _noted(number: int, frame: object) -> None:
    """Do nothing: the thread knows."""


def _without_workers() -> None:
    """End the worker processes, and give back what the system keeps for them."""
    if "multiprocessing" in sys.modules:
        import multiprocessing
        from multiprocessing import util

        for child in multiprocessing.active_children():
            child.kill()
        util._run_finalizers(0)  # type: ignore[attr-defined]
