"""What an ensemble of strings makes of a log of the surface: estimates with their uncertainty over time, and when stick-slip began."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.calibration.recording import Recording
from toolbox.errors import SceneError
from toolbox.files.printing import Rows, Told
from toolbox.files.results import HeadedRows, Result
from toolbox.files.tables import heading
from toolbox.files.unit_systems import reading
from toolbox.logs.flaws import spacing
from toolbox.messages import progress_bar
from toolbox.modelling.closed_loop import ClosedLoop, as_loop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.probability.ensemble import SEEN, EnsembleFilter, Estimate, Knowledge
from toolbox.probability.pictures import picture

SEVERE, CALM = 0.85, 0.6
"""Severity from which on a bit that has stuck is evidence of stick-slip, below which it is over: half-range over the mean, 1 where it just stops."""

STICKING = 0.5
"""Part of the members that must have stuck."""

UNITS = {"bit_speed": "rad/s", "bit_torque": "N m", "strength": "1", "severity": "1", "margin": "rad/s"}
"""{what is estimated: its unit}."""


class Detector:
    """Whether the bit sticks and slips, from estimates one after the other.

    It begins with a swing nearly as large as the mean speed in which half of the members stuck, and ends where the swing has become small.
    """

    def __init__(self) -> None:
        self.alarm = False

    def __call__(self, found: Estimate) -> bool:
        """Take in an estimate; returns whether there is stick-slip."""
        severity = found.severity[0]
        if self.alarm:
            self.alarm = not severity < CALM
        else:
            self.alarm = severity >= SEVERE and found.sticking >= STICKING
        return self.alarm


@dataclass(frozen=True)
class Estimates(Told, Result):
    """Estimates over a log, as `estimate` returns them: `print(found)`, `found.plot()`, `found.mean["bit_speed"]`.

    Attributes
    ----------
    title
        Of the machine.
    time
        Of the samples [s], shape (nt,).
    mean, deviation
        {"bit_speed", "bit_torque", "strength", "severity" or "margin": values in SI, shape (nt,)}; nan where nothing is known.
    alarm
        Whether there is stick-slip, shape (nt,).
    source
        Where the log comes from.
    members
        Of the ensemble.
    measured
        Number of samples with a top speed.
    display_units
        {unit: unit that was typed}.
    notes
        What is not known and why, and where the machine cannot be that of the log.
    """

    title: str
    time: np.ndarray
    mean: dict[str, np.ndarray]
    deviation: dict[str, np.ndarray]
    alarm: np.ndarray
    source: str
    members: int
    measured: int
    display_units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def units(self) -> dict[str, str]:
        """{what is estimated: its unit}."""
        return dict(UNITS)

    @property
    def spells(self) -> list[tuple[float, float]]:
        """Begin and end [s] of each time of stick-slip, as it was told; a gap of the log ends one."""
        apart = np.diff(self.time) > spacing(self.time)[1]
        first = np.flatnonzero(self.alarm & np.append(True, apart | ~self.alarm[:-1]))
        last = np.flatnonzero(self.alarm & np.append(apart | ~self.alarm[1:], True))
        return [(float(self.time[a]), float(self.time[b])) for a, b in zip(first, last, strict=True)]

    def _told(self) -> list[str | Rows]:
        lines: list[str | Rows] = [
            f"Estimates of {self.title}: {self.time.size} samples over {self.time[-1] - self.time[0]:.4g} s ({self.source}), {self.measured} with a top speed, "
            f"{self.members} members"
        ]
        rows: list[tuple[str, ...]] = [("estimate", "unit", "at the end", "deviation", "mean", "lowest", "highest")]
        for name, unit in UNITS.items():
            factor, shown = reading(unit, self.display_units)[:2]
            values = self.mean[name] * factor
            known = values[np.isfinite(values)]
            told = [f"{each:.4g}" for each in (known.mean(), known.min(), known.max())] if known.size else ["-"] * 3
            rows.append((name.replace("_", " "), shown, f"{values[-1]:.4g}", f"{self.deviation[name][-1] * factor:.3g}", *told))
        lines.append(Rows(rows, left=(0, 1)))
        spells = self.spells
        lines += [f"  stick-slip from {begin:.4g} s to {end:.4g} s" for begin, end in spells]
        if not spells:
            lines.append("  no stick-slip")
        return [*lines, *(f"Note: {note}" for note in self.notes)]

    __repr__ = Told.__str__

    def _table(self) -> HeadedRows:
        """One row per sample."""
        headings, values = ["time [s]"], [self.time]
        for name, unit in UNITS.items():
            headings += [heading(name, unit), heading(f"{name} deviation", unit)]
            values += [self.mean[name], self.deviation[name]]
        return [*headings, "stick-slip"], [[*row, int(on)] for row, on in zip(np.stack(values, 1).tolist(), self.alarm, strict=True)]

    plot = picture("estimate_diagram", "Draw the estimates that are known with their bands of 95 %, and when there was stick-slip")

    def check_loaded(self) -> None:
        """Raise ValueError where what was read does not fit together."""
        if {*self.mean} != {*UNITS} or {*self.deviation} != {*UNITS} or any(each.shape != self.time.shape for each in self.mean.values()):
            raise ValueError("its rows do not fit together")


def estimate(
    loop: ClosedLoop | HybridSystem,
    data: Any,
    *,
    columns: Mapping[str, str] | None = None,
    knowledge: Knowledge | None = None,
    members: int = 64,
    seed: int = 0,
) -> Estimates:
    """Estimate what the bit did from a log of the surface.

    Parameters
    ----------
    loop
        A drill string with a rock; of a loop with a law over `top.reference` the margin to the border of smooth running is told, too.
    data, columns
        What was measured: `top.torque` and `top.speed`, and `bit.weight` where it was; see `Recording.of`. A sample that is nan is a gap.
    knowledge
        What is known of machine and measurement.
    members, seed
        Of the ensemble, as in `EnsembleFilter`.

    Returns
    -------
    Estimates
        What is known at every sample from that sample and those before it.

    Raises
    ------
    SceneError
        If the machine is no drill string with a rock, or the log lacks torque or speed.
    """
    loop = as_loop(loop)
    made = EnsembleFilter(loop, knowledge, members=members, seed=seed)
    recording = Recording.of(data, made.plant, columns)
    for name in ("top.torque", "top.speed"):
        if name not in recording.signals:
            raise SceneError(f"Argument `data` must have `{name}`, but it has {', '.join(recording.signals)}.")
    time, torque, speed = recording.time, recording.signals["top.torque"], recording.signals["top.speed"]
    weight = recording.signals.get("bit.weight", np.full(time.size, math.nan))
    steps = np.diff(time, prepend=time[0])
    between = 0.5 * (torque + np.concatenate([torque[:1], torque[:-1]]))
    found = np.empty((time.size, 2 * len(UNITS)))
    alarm, detector, last = np.zeros(time.size, bool), Detector(), time[0]
    with progress_bar(time.size, "estimate", unit="sample") as bar:
        for k in range(time.size):
            unseen = time[k] - last
            if np.isfinite(speed[k]):
                last = time[k]
            now = made.step(float(steps[k]), float(between[k]), float(speed[k]), float(weight[k]))
            if unseen > recording.gap and last == time[k]:  # what was told before a gap tells nothing after it
                detector, now = Detector(), made.forgotten() if unseen > SEEN * made.period else now
            found[k] = np.ravel([getattr(now, name) for name in UNITS])
            alarm[k] = time[k] - last <= recording.gap and detector(now)
            if k % 500 == 499:
                bar.update(500)
    mean = {name: found[:, 2 * k].copy() for k, name in enumerate(UNITS)}
    deviation = {name: found[:, 2 * k + 1].copy() for k, name in enumerate(UNITS)}
    measured = int(np.isfinite(speed).sum())
    notes = [f"There is no margin: {made.no_border}."] if made.no_border else []
    notes += _too_wound(recording, mean["bit_speed"], made.stiffness)
    return Estimates(loop.title, time, mean, deviation, alarm, recording.source, members, measured, dict(loop.display_units), tuple(notes))


def _too_wound(recording: Recording, bit_speed: np.ndarray, stiffness: float) -> list[str]:
    """A sentence where bit and top drive turn by so different ways that no string of this stiffness [N m/rad] bears it."""
    steps = np.diff(recording.time, prepend=recording.time[0])
    top_speed = recording.signals["top.speed"]
    told = np.isfinite(top_speed) & (steps <= recording.gap)
    top, bit = (float(values[told] @ steps[told]) for values in (top_speed, bit_speed))
    bears = 2.0 * float(np.nanmax(np.abs(recording.signals["top.torque"]))) / stiffness
    if abs(top - bit) < max(bears, 0.1 * abs(top)):
        return []
    turns = (abs(top), abs(bit), bears)
    return [
        "The top drive turns {:.3g} times, the estimated bit {:.3g} times, and the string of the scene bears {:.2g} turns of twist at most: the machine of "
        "the scene is not that of the log.".format(*(each / (2.0 * math.pi) for each in turns))
    ]
