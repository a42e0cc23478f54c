"""What the toolbox says while it works: records of the logger `stickslip`, and bars of progress."""

from __future__ import annotations

import logging
import sys
import threading
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

LOG = logging.getLogger("stickslip")
"""The logger: INFO what one waits for, WARNING what one should know, DEBUG which way a computation took.

A program that wants to see the records adds a handler, as `logging.basicConfig(level="INFO")` does; the command `stickslip` writes them to stderr.
"""
LOG.addHandler(logging.NullHandler())


class _OnStderr(logging.Handler):
    """Writes records to stderr, unless the program has handlers of its own, which get them as well."""

    def emit(self, record: logging.LogRecord) -> None:
        if not logging.getLogger().handlers:
            print(f"stickslip: {self.format(record)}", file=sys.stderr, flush=True)


def write_log_to_stderr() -> None:
    """Write the records of the logger to stderr from now on, from INFO upwards: a command does, a library does not."""
    if not any(isinstance(handler, _OnStderr) for handler in LOG.handlers):
        LOG.addHandler(_OnStderr())
        LOG.setLevel(logging.INFO)


def complaint(text: str, code: int) -> int:
    """Print a message about a failure on stderr, in a line, and return the exit code."""
    print(f"stickslip: {' '.join(text.split())}", file=sys.stderr)
    return code


_STEP: ContextVar[Callable[[], None] | None] = ContextVar("step", default=None)


@contextmanager
def at_every_step(step: Callable[[], None]) -> Iterator[None]:
    """Call `step` whenever a run begins or pauses in this thread, or a bar of progress moves, shown or not.

    Work that nobody waits for any more ends with what it raises.
    """
    before = _STEP.set(step)
    try:
        yield
    finally:
        _STEP.reset(before)


def step_here() -> Callable[[], None] | None:
    """Return the function to call at every step of work in this thread, or None."""
    return _STEP.get()


SILENT = 1.0
"""Time [s] after which work says that it goes on."""

_BARS: weakref.WeakSet[Any] = weakref.WeakSet()
"""The bars that are shown."""


_SPEAKS = threading.Lock()
"""Held by the one piece of work that says that it goes on: what it calls is silent."""


@contextmanager
def sign_of_life(what: str) -> Iterator[None]:
    """Say on stderr after a second that something is at work, unless a bar tells how far it is, or work that it belongs to says so already.

    Of functions that may take seconds it is the decorator: `@sign_of_life("limit_cycle is at work")`. Where no bar is shown, nothing is said.
    """
    if not _shown() or not _SPEAKS.acquire(blocking=False):
        yield
        return

    def tell() -> None:
        if not done.wait(SILENT) and not any(not bar.disable for bar in list(_BARS)):
            print(f"stickslip: {what} ...", file=sys.stderr, flush=True)

    done = threading.Event()
    threading.Thread(target=tell, daemon=True).start()
    try:
        yield
    finally:
        done.set()
        _SPEAKS.release()


def _keep_moving(known: Callable[[], Any]) -> None:
    """Draw a bar each second until it is closed or forgotten: its first step may come late, and its clock goes on between steps."""
    pause = threading.Event()
    while not pause.wait(SILENT):
        bar = known()
        if bar is None:
            return
        with bar.get_lock():
            if bar.disable:
                return
            bar.refresh(nolock=True)
        del bar  # else nothing would end a bar that nobody closes


def progress_bar(total: float | None, what: str, *, unit: str = "run", done: float = 0, **looks: Any) -> Any:
    """Return a bar on stderr, for `with`: `update(count)` moves it.

    It appears after a second and goes away when the work is done. Where stderr is neither a terminal nor that of a notebook there is none.

    Parameters
    ----------
    total
        How much there is to do; None where nobody knows.
    what
        What is being done.
    unit
        What is counted.
    done
        How much was done before.
    looks
        What else `tqdm` takes.
    """
    from tqdm import tqdm

    shown = _shown()
    step = _STEP.get()

    class Bar(tqdm):
        """A bar that tells when it moves."""

        def update(self, n: float | None = 1) -> bool | None:
            assert step is not None
            step()
            return super().update(n)

    kind = tqdm if step is None else Bar
    bar = kind(**{"total": total, "initial": done, "unit": unit, "desc": what, "delay": 1.0, "leave": False, "disable": not shown} | looks)
    if shown:
        _BARS.add(bar)
        threading.Thread(target=_keep_moving, args=(weakref.ref(bar),), daemon=True).start()
    return bar


def _shown() -> bool:
    """Whether somebody sees bars on stderr."""
    return sys.stderr.isatty() or _in_notebook()


def _in_notebook() -> bool:
    """Whether the process is the kernel of a notebook, which is no terminal and shows bars none the less."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return type(shell).__name__ == "ZMQInteractiveShell"
