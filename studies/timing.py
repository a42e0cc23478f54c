"""How studies time what they do."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any


def timed(call: Callable[[], Any], turns: int = 1, clock: Callable[[], float] = time.process_time) -> tuple[Any, float]:
    """(what the last of some calls returns, the least time of a call [s]), by default of the processor."""
    least = float("inf")
    for _ in range(turns):
        began = clock()
        found = call()
        least = min(least, clock() - began)
    return found, least


def least(calls: Sequence[Callable[[], float]], turns: int) -> list[float]:
    """The least of what each call returns, seconds, over turns that alternate between the calls."""
    return [min(each) for each in zip(*([call() for call in calls] for _ in range(turns)), strict=True)]
