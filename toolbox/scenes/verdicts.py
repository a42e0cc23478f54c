"""A study: every controller of a scene simulated, judged, tabled and drawn."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from toolbox.errors import SimulationError
from toolbox.files import tables
from toolbox.files.printing import columns
from toolbox.files.unit_systems import reading

if TYPE_CHECKING:
    from toolbox.scenes.scene import Scene
    from toolbox.simulation.trajectory import Trajectory


@dataclass(frozen=True)
class Row:
    """One line of the table of a study, in SI; nan where a number does not exist, inf for what never settles.

    Attributes
    ----------
    controller
        Label of the case.
    verdict
        What the controller achieved, in words; or why the run failed.
    stuck
        Time of sticking after the settle time [s].
    severity, settling, overshoot
        As in `toolbox.measure`; for a stop, the settling is the time of standstill [s].
    peak
        Largest |effort|.
    error
        Largest scaled state error.
    wall_time
        Time in the event loop [s].
    files
        Beginning of the names of the files of this controller.
    """

    controller: str
    verdict: str
    stuck: float = math.nan
    severity: float = math.nan
    settling: float = math.nan
    overshoot: float = math.nan
    peak: float = math.nan
    error: float = math.nan
    wall_time: float = math.nan
    files: str = ""

    @property
    def failed(self) -> bool:
        """Whether the run could not be finished; the verdict then says why."""
        return self.verdict.startswith("failed")


def verdict_row(scene: Scene, label: str, files: str = "") -> tuple[Row, Trajectory | None]:
    """Simulate and judge one controller: its row, and its run. A run that fails is a row as well, with the trajectory so far."""
    from toolbox.measuring import measure

    try:
        run = scene.run(label)
    except SimulationError as failure:
        return Row(label, f"failed: {failure}", files=files), failure.run
    try:
        error = run.error
    except SimulationError:  # the run to compare with, at a hundredth of the accuracy, may fail alone
        error = math.nan
    if scene.standstill is not None:
        row = Row(label, "", peak=measured(scene, run, "peak"), error=error, wall_time=run.wall_time, files=files)
        return _stop(scene, run, row), run
    row = Row(
        controller=label,
        verdict="no modes"  # a contact without modes never sticks, whether it swings says the severity
        if scene.element is None
        else verdict(measure.stick_intervals(run, scene.element, scene.after), scene.after, scene.duration),
        **{name: measured(scene, run, name) for name in MEASURES},
        error=error,
        wall_time=run.wall_time,
        files=files,
    )
    return row, run


MEASURES = ("stuck", "severity", "settling", "overshoot", "peak")
"""Numbers of the verdict, by the names of their columns."""


def measured(scene: Scene, run: Trajectory, name: str) -> float:
    """One of the `MEASURES` of a run of a scene, in SI; nan for settling and overshoot where there is no set-point."""
    from toolbox.measuring import measure

    if scene.standstill is not None and name in ("stuck", "settling"):
        return getattr(_stop(scene, run, Row("", "")), name)
    if name == "stuck":
        return math.nan if scene.element is None else run.time_in(scene.element, "stick", after=scene.after)
    if name == "severity":
        return measure.severity(run, scene.signal, after=scene.after)
    if name == "peak":
        peak = measure.extent(run, scene.effort)
        return max(abs(peak.minimum), abs(peak.maximum))
    if not scene.reference:
        return math.nan
    return {"settling": measure.settling, "overshoot": measure.overshoot}[name](run, scene.signal, scene.reference)


def _stop(scene: Scene, run: Trajectory, row: Row) -> Row:
    """The row of a stop, judged until it stands: sticks that let go again before that, and when it stands (as the settling)."""
    from toolbox.measuring import measure

    stands = measure.standstill(run, scene.signal, scene.standstill or 0.0, after=scene.after)
    if stands <= scene.after:
        return dataclasses.replace(row, verdict="stands at once", stuck=0.0, settling=0.0)
    end = min(stands, scene.duration)
    sticks = [] if scene.element is None else measure.stick_intervals(run, scene.element, scene.after, end)
    if sticks and sticks[-1][1] >= end and stands < math.inf:
        sticks.pop()  # the stick in which it comes to stand
    word = verdict(sticks, scene.after, end)
    if stands == math.inf:
        word = "does not stand"
    return dataclasses.replace(row, verdict=word, stuck=sum(last - first for first, last in sticks), settling=stands)


def verdict(sticks: Sequence[tuple[float, float]], after: float, end: float) -> str:
    """What the stick intervals between `after` and `end` [s] amount to.

    "free" for none; "stuck" where the last one lasts to the end and longer than half of the window; "stick-slip" for two or more;
    "sticks once" for a single shorter one.
    """
    if not sticks:
        return "free"
    begin, last = sticks[-1]
    if last >= end and last - begin > 0.5 * (end - after):
        return "stuck"
    return "stick-slip" if len(sticks) > 1 else "sticks once"


# --- the table


def write_table(rows: Sequence[Row], path: Path) -> None:
    """The rows as csv in SI units, whole or not at all; a number that does not exist is left empty, what never settles is inf."""
    tables.write(path, [field.name for field in dataclasses.fields(Row)], map(dataclasses.astuple, rows))


def table(scene: Scene, rows: Sequence[Row]) -> str:
    """The rows as text, under what was judged and above the reasons of failures."""
    plant = scene.plant()
    effort, speed = (reading(plant.unit(name), scene.asked) for name in (scene.effort, scene.signal))
    until = f"{scene.duration:g} s" if scene.standstill is None else f"standstill at {scene.standstill * speed.factor:g} {speed.unit}"
    set_point = f"; set-point {scene.reference * speed.factor:.4g} {speed.unit}" if scene.reference else ""
    head = ["controller", "verdict", "stuck", "severity", "settling", "overshoot", f"peak {scene.effort}", "error", "wall time"]
    if scene.standstill is not None:
        head[head.index("settling")] = "stands at"
    cells = [head]
    for row in rows:
        cells.append(
            [
                row.controller,
                row.verdict.partition(":")[0],
                _number(row.stuck, "{:.2f} s"),
                _number(row.severity, "{:.3f}"),
                "never" if row.settling == math.inf else _number(row.settling, "{:.1f} s"),
                "-" if row.settling == math.inf else _number(100 * row.overshoot, "{:.1f} %"),  # without settling it is only a peak
                _number(row.peak * effort.factor, ("{:.0f} " if row.peak * effort.factor >= 1000 else "{:.4g} ") + effort.unit),
                _number(row.error, "{:.0e}"),
                _number(1e3 * row.wall_time, "{:.2g} ms" if row.wall_time < 0.1 else "{:.0f} ms"),
            ]
        )
    lines = columns(cells, (0, 1), "")
    lines.insert(1, "-" * max(map(len, lines)))
    judged_by = f"{scene.judges}, judged from {scene.after:g} s to {until}{set_point}."
    reasons = [f"{row.controller} {row.verdict}" for row in rows if row.failed]
    return "\n".join([scene.title, judged_by, "", *lines, *reasons])


def _number(value: float, form: str) -> str:
    return "-" if math.isnan(value) else form.format(value)


# --- the figures
