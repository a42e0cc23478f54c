"""What an ensemble of strings makes of a log of the surface: estimates with their uncertainty over time, and when stick-slip began."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from toolbox.calibration.recording import Recording
from toolbox.drilling.ensemble import SEEN, EnsembleFilter, Estimate, Knowledge, check_string
from toolbox.drilling.torque_swing import CALM as CALM_TORQUE
from toolbox.drilling.torque_swing import ENOUGH, SWINGS, swinging, too_slow, torque_swing
from toolbox.errors import SceneError
from toolbox.files.printing import Rows, Told
from toolbox.files.results import HeadedRows, Result
from toolbox.files.tables import heading
from toolbox.files.unit_systems import reading
from toolbox.logs.flaws import local_spacing
from toolbox.measuring.verdict import stick_slip_begins, stick_slip_ends
from toolbox.messages import progress_bar
from toolbox.modelling.closed_loop import ClosedLoop, as_loop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.vocabulary import new_field

UNITS = {"bit_speed": "rad/s", "bit_torque": "N m", "rock_strength": "1", "severity": "1", "onset_margin": "rad/s"}
"""{what is estimated: its unit}."""

SHOWN = {"onset_margin": "margin to the loss of smooth running"}
"""{what is estimated: its name in report and figure, where it is another}."""

LASTING = 5.0
"""Periods of the string for which two opinions on stick-slip must differ to be told."""


CALM_BIT = (
    "and the bit of the ensemble does not stick. Believe the torque: it is measured, and swings so for three periods only with a bit that sticks, or nearly. "
    "The machine of the scene is not that of the log (`fit` finds its numbers): do not use its bit speed there"
)
"""What is said where the torque swings and the ensemble does not stick."""

CALM_STRING = (
    "and the bit of the ensemble sticks. Believe the torque: it is measured, and a bit that sticks winds up the string, which swings it. "
    "The rock or the string of the scene is not that of the log (`fit` finds their numbers): do not use its bit speed there"
)
"""What is said where the ensemble sticks and the torque does not swing."""


class Detector:
    """Detector that decides from a sequence of estimates whether the bit sticks and slips.

    Stick-slip is reported from the sample on at which the range of the bit speed is nearly as large as its mean and
    half of the members have stuck. The report ends when the range has become small.

    Examples
    --------
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.drilling import Detector, EnsembleFilter
    >>> detector, ensemble = Detector(), EnsembleFilter(compose(wells.JANSEN_2, BitRock(weight="97 kN")), members=16)
    >>> reports = [detector(ensemble.step(0.1, torque=11e3, speed=10.0)) for _ in range(3)]
    >>> print(sum(reports), "of", len(reports), "samples with stick-slip")
    0 of 3 samples with stick-slip
    """

    def __init__(self) -> None:
        self.alarm = False

    def __call__(self, found: Estimate) -> bool:
        """Take in an estimate; returns whether there is stick-slip."""
        severity = found.severity[0]
        if self.alarm:
            self.alarm = not stick_slip_ends(severity)
        else:
            self.alarm = stick_slip_begins(severity, found.probability_stick_slip)
        return self.alarm


@dataclass(frozen=True)
class Estimates(Told, Result):
    """Estimates over a log, the result of `estimate`: `print(found)`, `found.plot()`, `found.mean["bit_speed"]`.

    Attributes
    ----------
    title
        Name of the machine.
    time
        Times of the samples [s], shape (nt,).
    mean, deviation
        {"bit_speed", "bit_torque", "rock_strength", "severity" or "onset_margin": values in SI, shape (nt,)}. nan if
        nothing is known.

        The onset margin is the mean bit speed minus the border below which smooth running is lost. It is nan while the
        bit sticks and slips. Severity and margin are nan if ensemble and torque disagree about stick-slip.
    stick_slip
        Whether there is stick-slip, from ensemble and torque, shape (nt,).
    source
        Origin of the log.
    members
        Number of members of the ensemble.
    measured_samples
        Number of samples with a measured top speed.
    display_units
        {SI unit: unit that was typed}.
    notes
        Notes for the reader: quantities that are unknown, with the reason; times at which ensemble and torque disagree
        about stick-slip; and signs that the log comes from another machine than the given plant.
    torque_swing
        Stick-slip index that needs no model: amplitude of the surface torque at the natural period of the string, as a
        fraction of the mean torque, shape (nt,).
    sampling_too_slow
        Whether the sampling of the log is too slow to show stick-slip, shape (nt,).

    Examples
    --------
    >>> import numpy as np
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> from toolbox.drilling import estimate
    >>> time = np.linspace(0.0, 20.0, 201)
    >>> log = {"time": time, "top.torque": np.full(201, 11e3), "top.speed": np.full(201, 12.0)}
    >>> found = estimate(compose(wells.JANSEN_2, BitRock(weight="97 kN")), log, members=16)
    >>> print(found.measured_samples, "samples,", found.mean["bit_speed"].shape)
    201 samples, (201,)
    """

    title: str
    time: np.ndarray
    mean: dict[str, np.ndarray]
    deviation: dict[str, np.ndarray]
    stick_slip: np.ndarray
    source: str
    members: int
    measured_samples: int
    display_units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    torque_swing: np.ndarray = field(default_factory=lambda: np.zeros(0))
    sampling_too_slow: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))

    @property
    def units(self) -> dict[str, str]:
        """{name of an estimate, such as "bit_speed": SI unit}."""
        return dict(UNITS)

    @property
    def spells(self) -> list[tuple[float, float]]:
        """(begin, end) of each interval of time in which stick-slip is reported [s]. A gap of the log ends an interval."""
        return _stretches(self.time, self.stick_slip)

    def _told(self) -> list[str | Rows]:
        lines: list[str | Rows] = [
            f"Estimates of {self.title}: {self.time.size} samples over {self.time[-1] - self.time[0]:.4g} s ({self.source}), "
            f"{self.measured_samples} with a top speed, {self.members} members"
        ]
        rows: list[tuple[str, ...]] = [("estimate", "unit", "at the end", "deviation", "mean", "lowest", "highest")]
        for name, unit in UNITS.items():
            factor, shown = reading(unit, self.display_units)[:2]
            values = self.mean[name] * factor
            known = values[np.isfinite(values)]
            told = [f"{each:.4g}" for each in (known.mean(), known.min(), known.max())] if known.size else ["-"] * 3
            end = (f"{values[-1]:.4g}", f"{self.deviation[name][-1] * factor:.3g}") if np.isfinite(values[-1]) else ("-", "-")
            rows.append((SHOWN.get(name, name.replace("_", " ")), shown, *end, *told))
        known = self.torque_swing[np.isfinite(self.torque_swing)]
        if known.size:
            end = (f"{self.torque_swing[-1]:.4g}" if np.isfinite(self.torque_swing[-1]) else "-", "-")
            rows.append(("torque swing over mean", "1", *end, *(f"{each:.4g}" for each in (known.mean(), known.min(), known.max()))))
        lines.append(Rows(rows, left=(0, 1)))
        spells = self.spells
        slow = _stretches(self.time, self.sampling_too_slow) if self.sampling_too_slow.size else []
        lines += [f"  too slow to see stick-slip from {begin:.4g} s to {end:.4g} s" for begin, end in slow]
        lines += [f"  stick-slip from {begin:.4g} s to {end:.4g} s" for begin, end in spells]
        if not spells and not (self.sampling_too_slow.size and self.sampling_too_slow.all()):
            lines.append("  no stick-slip")
        return [*lines, *(f"Note: {note}" for note in self.notes)]

    __repr__ = Told.__str__

    def _table(self) -> HeadedRows:
        """One row per sample."""
        headings, values = ["time [s]"], [self.time]
        for name, unit in UNITS.items():
            headings += [heading(name, unit), heading(f"{name} deviation", unit)]
            values += [self.mean[name], self.deviation[name]]
        headings.append("stick-slip")
        values.append(self.stick_slip.astype(float))
        if self.sampling_too_slow.size:
            headings += ["torque swing", "too slow"]
            values += [self.torque_swing, self.sampling_too_slow.astype(float)]
        ends = len(headings) - 1 - 2 * bool(self.sampling_too_slow.size)
        return headings, [
            [int(each) if k == ends or k == ends + 2 else each for k, each in enumerate(row)] for row in np.stack(values, 1).tolist()
        ]

    def plot(self, axes: Any = None) -> Any:
        """Draw the known estimates with their 95 % bands, and the times of stick-slip. Return the axes.

        Parameters
        ----------
        axes
            Matplotlib axes to draw on. By default None: a new figure.
        """
        from toolbox.drilling.figures import estimate_diagram

        return estimate_diagram(self, axes)

    def check_loaded(self) -> None:
        """Rename rows of a file of an earlier version to the present names. Raise ValueError if the loaded arrays do not fit together."""
        for word in ("mean", "deviation"):
            object.__setattr__(self, word, {new_field(Estimate, name): each for name, each in getattr(self, word).items()})
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
    """Estimate the motion of the bit from a log of the surface.

    Parameters
    ----------
    loop
        A drill string with a rock. For a loop with a controller that follows `top.reference`, the margin to the loss
        of smooth running is estimated, too.
    data
        The measurement of `top.torque`, `top.speed` and optionally `bit.weight`: a path of a log, a mapping {column:
        samples}, a table, a run, or a `Recording`. A sample that is nan is a gap.
    columns
        {signal: column of the log}. By default columns have the names of signals. `Recording.of` describes the forms.
    knowledge
        Prior knowledge about machine and measurement. By default `Knowledge()`.
    members
        Number of members of the ensemble, by default 64.
    seed
        Seed of the random numbers, by default 0.

    Returns
    -------
    Estimates
        Estimates at every sample, from this sample and the samples before it.

    Raises
    ------
    SceneError
        If the machine is no drill string with a rock, or the log lacks torque or speed.

    Examples
    --------
    >>> import numpy as np
    >>> from models import BitRock, wells
    >>> from toolbox import compose, simulate
    >>> from toolbox.drilling import estimate
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> time = np.linspace(0.0, 60.0, 1201)
    >>> run = simulate(rig, 60.0, inputs={"top.torque": "11 kN m"}, output_times=time)
    >>> log = {"time": time, "top.torque": run["top.torque"], "top.speed": run["top.speed"]}
    >>> found = estimate(rig, log, members=32)
    >>> print(found.time.size, "samples")
    1201 samples
    """
    loop = as_loop(loop)
    check_string(loop.plant)
    recording = Recording.of(data, loop.plant, columns)  # what is wrong with a log is told before the ensemble is prepared
    for name in ("top.torque", "top.speed"):
        if name not in recording.signals:
            raise SceneError(f"Argument `data` must have `{name}`, but it has {', '.join(recording.signals)}.")
    made = EnsembleFilter(loop, knowledge, members=members, seed=seed)
    time, torque, speed = recording.time, recording.signals["top.torque"], recording.signals["top.speed"]
    weight = recording.signals.get("bit.weight", np.full(time.size, math.nan))
    steps = np.diff(time, prepend=time[0])
    reach = local_spacing(time)[1]
    longest = np.concatenate([reach[:1], reach])  # before each sample
    between = 0.5 * (torque + np.concatenate([torque[:1], torque[:-1]]))
    found = np.empty((time.size, 2 * len(UNITS)))
    sticks, detector, last = np.zeros(time.size, bool), Detector(), time[0]
    lost = np.zeros(time.size, bool)
    with progress_bar(time.size, "estimate", unit="sample") as bar:
        for k in range(time.size):
            unseen = time[k] - last
            if np.isfinite(speed[k]):
                last = time[k]
            now = made.step(float(steps[k]), float(between[k]), float(speed[k]), float(weight[k]))
            if unseen > longest[k] and last == time[k]:  # what was told before a gap tells nothing after it
                detector, now = Detector(), made.forgotten() if unseen > SEEN * made.period else now
            found[k] = np.ravel([getattr(now, name) for name in UNITS])
            lost[k] = time[k] - last > longest[k]
            sticks[k] = not lost[k] and detector(now)
            if k % 500 == 499:
                bar.update(500)
    slow = too_slow(time, np.isfinite(speed) & np.isfinite(torque), made.period)
    sticks, swing, alarm = _judged(time, np.where(slow, np.nan, torque), sticks & ~slow, steps > longest, lost, made.period)
    mean = {name: found[:, 2 * k].copy() for k, name in enumerate(UNITS)}
    deviation = {name: found[:, 2 * k + 1].copy() for k, name in enumerate(UNITS)}
    for name in UNITS:
        blank = slow | (alarm if name == "onset_margin" else False) | ((sticks != alarm) if name in ("severity", "onset_margin") else False)
        mean[name][blank] = deviation[name][blank] = np.nan
    measured = int(np.isfinite(speed).sum())
    notes = [f"There is no margin: {made.no_border}."] if made.no_border else []
    notes += _slow_words(time, slow, made.period)
    notes += _disagreements(time, sticks, alarm, swing, made.period)
    notes += _too_wound(recording, np.where(slow, np.nan, mean["bit_speed"]), made.stiffness)
    return Estimates(
        loop.title, time, mean, deviation, alarm, recording.source, members, measured, dict(loop.display_units), tuple(notes), swing, slow
    )


def _judged(
    time: np.ndarray, torque: np.ndarray, sticks: np.ndarray, cut: np.ndarray, lost: np.ndarray, period: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(whether the ensemble sticks, swing of the torque over its mean, whether there is stick-slip by both), each of shape (nt,).

    The torque is measured and the ensemble is a model: a torque that swings over three periods is stick-slip, and an ensemble that sticks is none where the
    torque of the last period is calm.
    """
    index, least = torque_swing(time, torque, period, cut)
    swings = swinging(index, least) & ~lost
    return sticks, index, swings | (sticks & ~(index < CALM_TORQUE))


def _stretches(time: np.ndarray, on: np.ndarray) -> list[tuple[float, float]]:
    """Begin and end [s] of each row of samples that are on; a gap of the log ends one."""
    apart = np.diff(time) > local_spacing(time)[1]
    first = np.flatnonzero(on & np.append(True, apart | ~on[:-1]))
    last = np.flatnonzero(on & np.append(apart | ~on[1:], True))
    return [(float(time[a]), float(time[b])) for a, b in zip(first, last, strict=True)]


def _slow_words(time: np.ndarray, slow: np.ndarray, period: float) -> list[str]:
    """A sentence where a log is too slow to see stick-slip."""
    if not slow.any():
        return []
    interval = float(np.median(np.diff(time)[slow[1:]])) if slow[1:].any() else float(np.median(np.diff(time)))
    part = "" if slow.all() else " in part"
    rate = f"it has a sample every {interval:.3g} s, {period / interval:.2g} in a period of the string of {period:.3g} s, and {ENOUGH:g} are needed"
    return [
        f"The log is too slow to see stick-slip{part}: {rate}: log every {period / ENOUGH:.2g} s or faster. Nothing is estimated there."
    ]


def _disagreements(time: np.ndarray, sticks: np.ndarray, alarm: np.ndarray, swing: np.ndarray, period: float) -> list[str]:
    """A sentence for each way in which ensemble and torque disagree for long, with which to believe and why."""
    words = []
    for on, who in ((alarm & ~sticks, CALM_BIT), (sticks & ~alarm, CALM_STRING)):
        long = [(a, b) for a, b in _stretches(time, on) if b - a > LASTING * period]
        if not long:
            continue
        inside = on & np.isfinite(swing)
        size = 100.0 * float(np.median(swing[inside])) if inside.any() else math.nan
        spans = ", ".join(f"{a:.4g} to {b:.4g} s" for a, b in long[:4]) + (f" and {len(long) - 4} more" if len(long) > 4 else "")
        words.append(
            f"Two opinions on stick-slip differ from {spans}: the surface torque swings by {size:.2g} % of its mean over the period of the string "
            f"(stick-slip from {100 * SWINGS:g} % on, none below {100 * CALM_TORQUE:g} %), {who}."
        )
    return words


def _too_wound(recording: Recording, bit_speed: np.ndarray, stiffness: float) -> list[str]:
    """A sentence where bit and top drive turn by so different ways that no string of this stiffness [N m/rad] bears it."""
    steps = np.diff(recording.time, prepend=recording.time[0])
    top_speed = recording.signals["top.speed"]
    told = np.isfinite(top_speed) & np.isfinite(bit_speed) & ~np.insert(recording.gaps, 0, False)
    if not told.any():
        return []
    top, bit = (float(values[told] @ steps[told]) for values in (top_speed, bit_speed))
    bears = 2.0 * float(np.nanmax(np.abs(recording.signals["top.torque"]))) / stiffness
    if abs(top - bit) < max(bears, 0.1 * abs(top)):
        return []
    turns = (abs(top), abs(bit), bears)
    return [
        "The top drive turns {:.3g} times, the estimated bit {:.3g} times, and the string of the scene bears {:.2g} turns of twist at most: the machine of "
        "the scene is not that of the log.".format(*(each / (2.0 * math.pi) for each in turns))
    ]
