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
    """Let calls inside the block end at a deadline [s on `time.perf_counter`], or at the earlier deadline of the run around the block."""
    token = _DEADLINE.set(min(deadline, _DEADLINE.get()))
    try:
        yield
    finally:
        _DEADLINE.reset(token)


def time_left() -> float:
    """Return the computing time that the budget of the present run still allows [s].

    A controller that solves several programs in a sample calls this before each program.

    Returns
    -------
    float
        The remaining time [s]. inf without a limit, and outside a run.

    Raises
    ------
    Exception
        If no time is left. The run then ends with a BudgetError.

    Examples
    --------
    >>> from toolbox.authoring import time_left
    >>> print(time_left() > 60.0)
    True
    """
    deadline = _DEADLINE.get()
    if deadline == math.inf:
        return math.inf
    left = deadline - clock.perf_counter()
    if left <= 0.0:
        raise OutOfTime
    return left
