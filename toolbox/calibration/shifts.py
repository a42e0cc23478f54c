"""Shifts in time between channels as numbers that are fitted: how much later a channel was written than it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from toolbox.calibration.recording import Recording
from toolbox.modelling import number_kinds as kinds
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.numbers import Number, number_of

SHIFT = ".shift"
"""What the name of a shift ends with: `bit.speed.shift` is that of one signal, `bit.shift` that of all measured ones of `bit` that are no inputs."""

MOST, PART = 5.0, 0.1
"""Shifts are looked for within so many seconds and so large a part of the data, unless bounds are given."""


@dataclass(frozen=True)
class Shift:
    """A shift that is free: the place of its number, its channels, and the bounds between which it is looked for [s]."""

    place: int
    channels: tuple[str, ...]
    low: float
    high: float


def is_shift(loop: ClosedLoop, name: str) -> bool:
    """Whether a name is that of a shift, and not of a number of the loop."""
    return name.endswith(SHIFT) and number_of(loop, name) is None


def shift_number(loop: ClosedLoop, recording: Recording, name: str) -> Number | None:
    """The number of a shift by its name, 0 at the start; None for any other name."""
    if not is_shift(loop, name) or not channels_of(loop, recording, name):
        return None
    most = min(MOST, PART * float(recording.time[-1]))
    bounds = {"at_least": -most, "above": None, "at_most": most}
    return Number(
        name, "s", kinds.SHIFT, 0.0, f"how much later {' and '.join(channels_of(loop, recording, name))} was written than it was", bounds
    )


def channels_of(loop: ClosedLoop, recording: Recording, name: str) -> tuple[str, ...]:
    """The measured signals that a shift is of."""
    head, inputs = name.removesuffix(SHIFT), loop.assembly.plant.inputs
    return tuple(signal for signal in recording.signals if signal == head or (signal.startswith(f"{head}.") and signal not in inputs))


def shifts_of(loop: ClosedLoop, numbers: Sequence[Number], recording: Recording, low: np.ndarray, high: np.ndarray) -> tuple[Shift, ...]:
    """The shifts among free numbers, with the bounds of all numbers."""
    return tuple(
        Shift(i, channels_of(loop, recording, number.name), float(low[i]), float(high[i]))
        for i, number in enumerate(numbers)
        if number.is_shift
    )


def moved(recording: Recording, shifts: Sequence[Shift], values: np.ndarray, output: str) -> dict[str, np.ndarray]:
    """Signals on the clock of one of them, smooth between samples (F. N. Fritsch, J. Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300-304).

    The one stays as it was measured, so that its noise is not made smaller between samples, which would draw a shift there.
    """
    late = {name: float(values[shift.place]) for shift in shifts for name in shift.channels}
    if not late:
        return dict(recording.signals)
    from scipy.interpolate import PchipInterpolator  # here, because scipy.interpolate is slow to import

    found = dict(recording.signals)
    for name, own in recording.signals.items():
        ahead = late.get(name, 0.0) - late.get(output, 0.0)
        good = np.isfinite(own)
        if name == output or ahead == 0.0 or good.sum() < 2:
            continue
        times = np.clip(recording.time + ahead, recording.time[good][0], recording.time[good][-1])
        found[name] = np.where(good, PchipInterpolator(recording.time[good], own[good])(times), np.nan)
    return found
