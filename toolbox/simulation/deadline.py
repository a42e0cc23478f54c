"""The time that a run has left while a law in Python computes: a law that plans for long asks, and ends with the run."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_DEADLINE: ContextVar[float] = ContextVar("deadline", default=math.inf)


class OutOfTime(Exception):
    """The seconds of the budget are spent; the event loop makes a BudgetError of it."""


@contextmanager
def until(deadline: float) -> Iterator[None]:
    """Let what is called within end at a deadline [s on `time.perf_counter`], or at that of the run around it if this is earlier."""
    token = _DEADLINE.set(min(deadline, _DEADLINE.get()))
    try:
        yield
    finally:
        _DEADLINE.reset(token)


def time_left() -> float:
    """The seconds that the run which calls this law may still take by its `Budget`; inf without a limit, and outside a run.

    A law that solves several programs in a sample asks before each. Raises an exception, which ends the run in a BudgetError, where none are left.
    """
    deadline = _DEADLINE.get()
    if deadline == math.inf:
        return math.inf
    left = deadline - clock.perf_counter()
    if left <= 0.0:
        raise OutOfTime
    return left
