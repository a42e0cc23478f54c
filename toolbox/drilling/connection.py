"""The start of a run after a connection: the weight is taken off while the string turns, and put on again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toolbox.errors import SceneError
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.robustness.starts import Found, Start
from toolbox.steady_states.steady_loop import smooth_start

WEIGHT = "bit.weight"
"""The number that a connection takes away for a while."""

BEFORE, OFF, AWAY = 20.0, 10.0, 90.0
"""Smooth running before the connection, time in which the weight goes off, and time for which it stays off [s]."""

REST = 1e-3
"""Share of the weight that is left: a contact without any load has no friction."""


@dataclass(frozen=True)
class AfterConnection(Start):
    """Start after a connection: from smooth running the weight is taken off within 10 s, stays off for 90 s, and is put on again.

    Parameters
    ----------
    ramps
        Times within which the weight is put on again [s], one run each.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose, worst_case
    >>> from toolbox.drilling import AfterConnection
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), Sampled(SoftTorque(reference="95 rpm"), "10 ms"))
    >>> print(worst_case(loop, "150 s", starts=AfterConnection([20.0])).survives)
    True
    """

    ramps: Sequence[float] = (10.0, 20.0, 60.0)

    @property
    def words(self) -> str:
        """Description of the start."""
        times = ", ".join(f"{each:g}" for each in self.ramps)
        return f"a connection: weight off for {AWAY:g} s, on again in {times} s"

    def on(self, loop: ClosedLoop) -> Found:
        """Return the start values and the weight over time on the plant of a loop. Raises SceneError if it has no constant weight.

        Parameters
        ----------
        loop
            The loop whose runs begin at these start values.
        """
        weight = float(loop.number(WEIGHT).value) if WEIGHT in loop.variable_numbers() else math.nan
        if math.isnan(weight):
            raise SceneError(f"A start after a connection takes off `{WEIGHT}`, but the loop has no constant one.")
        begin = smooth_start(loop)
        inputs = []
        for ramp in self.ramps:
            times = np.cumsum([BEFORE, OFF, AWAY, ramp])
            inputs.append({WEIGHT: ((0.0, *times.tolist()), (weight, weight, REST * weight, REST * weight, weight))})
        return Found([begin for _ in self.ramps], inputs=inputs)
