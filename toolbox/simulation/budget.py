"""What a run may spend."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from toolbox.errors import SceneError
from toolbox.files.units import in_si
from toolbox.modelling.elements import Quantity, quantity


@dataclass(frozen=True)
class Budget:
    """Limits on the cost of a run. At a limit the run ends with a `BudgetError`, which holds the trajectory so far.

    Attributes
    ----------
    steps
        Largest number of steps, accepted and rejected, by default 20 million.
    events
        Largest number of switches of contacts and other elements, by default no limit. A run with exactly this number
        of switches finishes. A run with more switches ends at the first switch beyond this number and contains all
        switches before it.
    seconds
        Largest computing time of the run [s], by default no limit. It is checked about ten times per second. Predictive
        controllers also check it before each optimisation. Other controllers in Python can read the remaining time with
        `toolbox.authoring.time_left`.

    Raises
    ------
    SceneError
        If a limit is not positive, or `steps` or `events` is no integer. The error is raised at the start of a run with
        this budget.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import Budget, compose, simulate
    >>> from toolbox.errors import BudgetError
    >>> from toolbox.simulation import EventExact
    >>> try:
    ...     run = simulate(compose(BlockOnBelt()), "60 s", method=EventExact(budget=Budget(events=5)))
    ... except BudgetError as error:
    ...     print(len(error.run.events), "events")
    5 events
    """

    steps: int = 20_000_000
    events: float = np.inf
    seconds: Quantity = quantity(np.inf, "s", "time that a run may take")

    def __post_init__(self) -> None:
        object.__setattr__(self, "seconds", in_si(self.seconds, "s", "budget.seconds"))

    def check(self) -> None:
        """Raise SceneError unless `steps` and `events` are positive integers and `seconds` is positive. `events` and `seconds` may be infinite."""
        for name in ("steps", "events", "seconds"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)) or not value > 0:
                raise SceneError(f"Argument `budget.{name}` must be a number > 0, but it is {value!r}.")
            if (name == "steps" or value < np.inf) and name != "seconds" and value % 1 != 0:
                raise SceneError(f"Argument `budget.{name}` must be a whole number > 0, but it is {value!r}.")


UNHURRIED = Budget()
