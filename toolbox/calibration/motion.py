"""Runs of one body in recordings: its speed and acceleration by smoothing, the numbers at which a search begins, and the friction in the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.calibration.recording import Recording
from toolbox.errors import SceneError

SMOOTH = 0.01
"""Part of a run over which a polynomial is laid for the derivative at its middle."""

SLOW = 0.05
"""Part of the largest speed below which friction is not looked at: it may be rest."""

REST = 5
"""Samples at the begin of a run that are equal if it begins at rest."""

BINS = 80
"""Points of friction in a picture, at most."""


@dataclass(frozen=True)
class Run:
    """A stretch of a recording without a gap.

    recording: its samples, from time 0;  time, speed, acceleration, force: smoothed motion and measured force, shapes (n,);  driven: whether the force was
    measured;  starts: {state: value at the begin}.
    """

    recording: Recording
    time: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray
    force: np.ndarray
    driven: bool
    starts: dict[str, float]

    @property
    def span(self) -> float:
        """Duration [s]."""
        return float(self.recording.time[-1])


def _derivative(time: np.ndarray, values: np.ndarray, order: int) -> np.ndarray:
    """Derivative of samples by cubic polynomials around each, at even times."""
    from scipy.signal import savgol_filter  # here, because it is slow to import

    step = (time[-1] - time[0]) / (time.size - 1)
    width = min(max(7, 2 * round(0.5 * SMOOTH * time.size) + 1), 2 * ((time.size - 1) // 2) + 1)
    found: np.ndarray = savgol_filter(values, width, min(3, width - 1), deriv=order, delta=step)
    return found


def runs_of(recording: Recording, part: Any) -> list[Run]:
    """The runs of a recording of a part, parted by the gaps of its force, or of all that was measured where there is none.

    Raises SceneError where neither speed nor position was measured.
    """
    place, speed, force = (f"{part.signal_prefix}.{name}" for name in (part.position_name, "speed", part.force_name))
    filtered = f"{part.signal_prefix}.filtered_speed"
    seen = next((name for name in (place, speed, filtered) if name in recording.signals), None)
    if seen is None:
        raise SceneError(f"The data must hold `{place}` or `{speed}`, but they hold {', '.join(recording.signals)}.")
    driven = force in recording.signals
    found = []
    for begin, end in recording.windows([force] if driven else [seen]):
        own = recording.between(begin, end)
        good = np.isfinite(own.signals[seen]) & (np.isfinite(own.signals[force]) if driven else True)
        time, values = own.time[good], own.signals[seen][good]
        if time.size < 10:
            continue
        even = np.linspace(time[0], time[-1], time.size)
        values = np.interp(even, time, values)
        shift = 1 if seen == place else 0
        rate = _derivative(even, values, 1)
        v, a = (rate, _derivative(even, values, 2)) if shift else (_derivative(even, values, 0), rate)
        starts = {}
        rests = bool(np.ptp(own.signals[seen][good][:REST]) == 0.0) if shift else own.signals[seen][good][0] == 0.0
        if place in own.signals:
            starts[place] = float(np.polynomial.polynomial.polyfit(time[:9] - time[0], own.signals[place][good][:9], 2)[0])
        starts[speed] = 0.0 if rests else float(v[0])
        if part.has_speed_filter:
            starts[filtered] = float(values[0])
        drive = np.interp(even, time, own.signals[force][good]) if driven else np.zeros(even.size)
        found.append(Run(own, even, v, a, drive, driven, starts))
    if not found:
        raise SceneError(f"The data of {recording.source} must hold a stretch of ten samples without a gap, but there is none.")
    return found


def together(runs: Sequence[Run], part: Any) -> tuple[Recording, list[float]]:
    """One recording of all runs behind each other, and the time at which each begins; an input that was not measured in some is its default there."""
    inputs = {f"{part.signal_prefix}.{part.force_name}", f"{part.signal_prefix}.load"}
    names = list(dict.fromkeys(name for run in runs for name in run.recording.signals))
    apart = 100.0 * max(run.span for run in runs)
    begins, end = [], 0.0
    for run in runs:
        begins.append(end)
        end += run.span + apart
    signals = {
        name: np.concatenate(
            [run.recording.signals.get(name, np.full(run.recording.time.size, 0.0 if name in inputs else np.nan)) for run in runs]
        )
        for name in names
    }
    first = runs[0].recording
    held = (
        None
        if any(run.recording.held is None for run in runs)
        else tuple(dict.fromkeys(n for run in runs for n in run.recording.held or ()))
    )
    time = np.concatenate([run.recording.time + begin for run, begin in zip(runs, begins, strict=True)])
    sources = ", ".join(dict.fromkeys(run.recording.source for run in runs))
    return Recording(time, signals, sources, first.units, held=held, display_units=first.display_units), begins


def _moving(run: Run) -> np.ndarray:
    """Where a run moves, away from its ends."""
    moves: np.ndarray = np.abs(run.speed) > SLOW * float(np.abs(run.speed).max(initial=0.0))
    edge = max(2, round(0.5 * SMOOTH * moves.size))
    moves[:edge] = moves[-edge:] = False
    return moves


def first_guess(runs: Sequence[Run], body: float, both_ways: bool) -> dict[str, float]:
    """Mass, level and slope of friction, and offset, by linear regression of the force; the mass is `body` where no force was measured."""
    rows, targets = [], []
    driven = any(run.driven for run in runs)
    for run in runs:
        there = _moving(run)
        v, a = run.speed[there], run.acceleration[there]
        inertia = a if driven else np.zeros(v.size)
        rows.append(np.stack([inertia, np.sign(v), v, np.ones(v.size) if both_ways else np.zeros(v.size)], axis=1))
        targets.append(run.force[there] - (0.0 if driven else body * a))
    basis, force = np.concatenate(rows), np.concatenate(targets)
    mass, level, slope, offset = np.linalg.lstsq(basis, force, rcond=None)[0].tolist()
    size, top = float(np.abs(force).max(initial=1e-9)), max(float(np.abs(run.speed).max()) for run in runs)
    return {
        "mass": mass if driven and mass > 0.0 else body,
        "level": max(level, 0.02 * size),
        "viscous": max(slope, 1e-3 * size / top),
        "offset": offset,
        "speed": 0.1 * top,
    }


def friction_points(runs: Sequence[Run], body: float, offset: float) -> np.ndarray:
    """(speed, friction) in the data, shape (2, points): force less inertia and offset, medians over ranges of speed."""
    pairs = []
    for run in runs:
        there = _moving(run)
        pairs.append(np.stack([run.speed[there], run.force[there] - body * run.acceleration[there] - offset]))
    speed, force = np.concatenate(pairs, axis=1)
    if not speed.size:
        return np.zeros((2, 0))
    order = np.argsort(speed)
    groups = np.array_split(order, min(BINS, order.size))
    return np.array([[np.median(speed[group]) for group in groups], [np.median(force[group]) for group in groups]])
