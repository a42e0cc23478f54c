"""What was measured of a signal beside what a fitted model makes of it: what a picture of a fit shows."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from toolbox.arguments import BoolArray, FloatArray

TIME = "time [s]"
"""What most signals are drawn over."""


@dataclass(frozen=True)
class Panel:
    """What was measured of one signal, and what the fitted model makes of it.

    Attributes
    ----------
    name, unit
        The signal and its unit.
    over
        What it is drawn over, in words with the unit.
    x, measured, model
        Where, and both values there, shapes (k,).
    released
        Where a contact breaks away, shape (k,); nowhere over time.
    resting
        (2, r): where, and what was measured, at rest.
    sticks
        Intervals of time in which the contact of the model sticks, shape (s, 2); none over slip.
    """

    name: str
    unit: str
    over: str
    x: FloatArray
    measured: FloatArray
    model: FloatArray
    released: BoolArray
    resting: FloatArray
    sticks: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
