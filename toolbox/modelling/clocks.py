"""Clocks of sampled controllers: when they sample, and when their outputs take effect."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from toolbox.errors import SceneError


class Clock(NamedTuple):
    """Clock of a sampled controller, with the fields of `Sampled`. Arrays of clocks have these fields as columns.

    Attributes
    ----------
    period
        Sample time [s].
    delay
        Time from a sample until its outputs take effect [s].
    jitter
        Largest lateness of a sample [s].
    missed_samples
        Probability that a sample is missed.
    """

    period: float
    delay: float = 0.0
    jitter: float = 0.0
    missed_samples: float = 0.0

    @property
    def regular(self) -> bool:
        """Whether every sample is taken, and in time."""
        return self.jitter == self.missed_samples == 0.0


def check_regular(clocks: Iterable[Clock], word: str) -> None:
    """Raise SceneError if samples are late or missed, because such a loop has no period. The message says by `word` why a period is
    needed."""
    if not all(clock.regular for clock in clocks):
        raise SceneError(
            f"Arguments `jitter` and `missed_samples` must be left out {word}, because no period brings the samples of such a loop round: "
            "judge its runs, by `simulate`, `sweep` or `worst_case`."
        )
