"""What was measured of a signal beside what a fitted model makes of it: what a picture of a fit shows."""

from __future__ import annotations

from dataclasses import dataclass

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
    """

    name: str
    unit: str
    over: str
    x: FloatArray
    measured: FloatArray
    model: FloatArray
    released: BoolArray
    resting: FloatArray
