"""A study: every controller of a scene simulated, judged, tabled and drawn."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox.errors import SceneError, SimulationError
from toolbox.files import tables
from toolbox.files.archives import understood
from toolbox.files.printing import columns, shown
from toolbox.files.reading import TEXT, text_of
from toolbox.files.unit_systems import reading
from toolbox.measuring.judge import NOT_DECIDED, SMOOTH, STANDS, STICKS, SWINGS, Judged, told_growth
from toolbox.measuring.measure import stick_intervals
from toolbox.onsets.coming_to import comes_to
from toolbox.scenes.judged import judged_measures, sticks_before_standstill

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
    more
        {name: value} of further measures.
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
    more: Mapping[str, float] = field(default_factory=dict)

    @property
    def failed(self) -> bool:
        """Whether the run could not be finished; the verdict then says why."""
        return self.verdict.startswith("failed")


def verdict_row(scene: Scene, label: str, files: str = "", metrics: Any = ()) -> tuple[Row, Trajectory | None]:
    """Simulate and judge one controller: its row, with further measures as `sweep` takes them, and its run.

    A run that fails is a row as well, with the trajectory so far.
    """
    further = judged_measures(metrics, scene[label], 0.0, scene.duration) if metrics else {}
    try:
        run = scene.run(label)
    except SimulationError as failure:
        return Row(label, f"failed: {failure}", files=files), failure.run
    try:
        error = run.error
    except SimulationError:  # the run to compare with, at a hundredth of the accuracy, may fail alone
        error = math.nan
    words, found, _ = verdict_of(scene, run)
    more = {name: each.read(run) for name, each in further.items()}
    return Row(label, words, **found, error=error, wall_time=run.wall_time, files=files, more=more), run


WORDS = {STICKS: "stick-slip", STANDS: "stuck", SWINGS: "swing"}
"""Verdicts of the regimes of a judge, as in reports of onsets."""

COLUMNS = ("stuck", "severity", "settling", "overshoot", "peak")
"""Measures of the verdict, by the names of their columns."""


def _number_of(name: str, run: Trajectory) -> float:
    """A measure of a run by its name; nan where the run has nothing that it looks at, or no set-point."""
    try:
        return judged_measures(name, run.run.loop, run.begin, run.end)[name].read(run)
    except SceneError:
        return math.nan


def verdict_of(scene: Any, run: Trajectory) -> tuple[str, dict[str, float], Judged | None]:
    """The verdict on a run in words, its measures by the names of their columns, and what the judge found; None where he says no more than the run shows.

    scene: a scene, or a loop with all that a scene says of it.
    """
    found = metrics_of(scene, run)
    words, judged = words_of(scene, run, found)
    return words, found, judged


def metrics_of(scene: Any, run: Trajectory) -> dict[str, float]:
    """The measures of the verdict on a run, by the names of their columns."""
    return {name: _number_of(name, run) for name in (COLUMNS if scene.standstill is None else ("stuck", "settling", "peak"))}


def words_of(scene: Any, run: Trajectory, found: Mapping[str, float]) -> tuple[str, Judged | None]:
    """The verdict in words, and what the judge found, as `verdict_of`; found: the measures of the run.

    This is where the run may be carried on until the judge can tell.
    """
    if scene.standstill is None:
        if scene.element is None:
            return "no modes", None  # a contact without modes never sticks, whether it swings says the severity
        sticks = stick_intervals(run, scene.element, scene.after)
        judged = comes_to(run, scene.element, scene.signal, scene.after)
        if judged is None:  # the run shows no more than its own time
            return verdict(sticks, scene.after, scene.duration) if sticks else "no stick", None
        return in_words(judged, len(sticks)), judged
    stands = found["settling"]
    if not scene.after < stands < math.inf:
        return "does not stand" if stands == math.inf else "stands at once", None
    sticks = (
        sticks_before_standstill(run, scene.element, scene.signal, scene.standstill, scene.after, stands)
        if scene.element is not None
        else []
    )
    return verdict(sticks, scene.after, stands), None


def in_words(judged: Judged, sticks: int) -> str:
    """The verdict on a run that the judge has decided; sticks: how often it stuck in the time that was looked at.

    "free", "stick-slip", "swing" and "stuck" for its regime at last; "sticks once" and "free at last" where it is free after one stick or several; "irregular"
    where sticks go on and never repeat. What nothing decides tells in which time a small disturbance of smooth running grows.
    """
    if judged.regime == SMOOTH:
        return {0: "free", 1: "sticks once"}.get(sticks, "free at last")
    if judged.regime == NOT_DECIDED:
        return "irregular stick-slip" if judged.sticks else told_growth(judged.rate) if judged.rate > 0 else NOT_DECIDED
    return WORDS.get(judged.regime, judged.regime)


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

HEADINGS = tuple(each.name for each in dataclasses.fields(Row) if each.name not in ("wall_time", "more"))
"""Headings of the table on disk, before further measures: all but the time, which is never the same again."""


def _others(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(name for row in rows for name in row.more))


def write_table(rows: Sequence[Row], path: Path) -> None:
    """The rows as csv in SI units, whole or not at all; a number that does not exist is left empty, what never settles is inf."""
    others = _others(rows)
    cells = [[*(getattr(row, name) for name in HEADINGS), *(row.more.get(name, math.nan) for name in others)] for row in rows]
    tables.write(path, [*HEADINGS, *others], cells)


def read_table(path: Path) -> list[Row]:
    """The rows that `write_table` wrote. Raises SceneError where the file is none of a study."""
    rows = []
    with understood(path, "the table of a study"):
        for told in csv.DictReader(io.StringIO(text_of(path, TEXT, "table"))):
            texts: dict[str, Any] = {name: told.pop(name) for name in ("controller", "verdict", "files")}
            values = {name: float(text) if text else math.nan for name, text in told.items()}
            own: dict[str, Any] = {name: values.pop(name) for name in HEADINGS if name not in texts}
            rows.append(Row(**texts, **own, more=values))
    return rows


def table(scene: Scene, rows: Sequence[Row], times: bool = True) -> str:
    """The rows as text, under what was judged and above the reasons of failures; times: whether with the time that each took."""
    lines = columns(in_cells(scene, rows, times), (0, 1), "")
    lines.insert(1, "-" * max(map(len, lines)))
    reasons = [f"{row.controller} {row.verdict}" for row in rows if row.failed]
    return "\n".join([scene.title, judged_by(scene), "", *lines, *reasons])


def judged_by(scene: Scene) -> str:
    """A sentence about what is judged in which time."""
    speed = reading(scene.plant().unit(scene.signal), scene.display_units)
    until = f"{scene.duration:g} s" if scene.standstill is None else f"standstill at {scene.standstill * speed.factor:g} {speed.unit}"
    set_point = f"; set-point {scene.reference * speed.factor:.4g} {speed.unit}" if scene.reference else ""
    return f"{scene.judges}, judged from {scene.after:g} s to {until}{set_point}."


def in_cells(scene: Scene, rows: Sequence[Row], times: bool = True) -> list[list[str]]:
    """Headings and rows as texts, in the units of the scene; times: whether with the time that each took."""
    effort = reading(scene.plant().unit(scene.effort), scene.display_units)
    head = [
        "controller",
        "verdict",
        "stuck",
        "severity",
        "settling",
        "overshoot",
        f"peak {scene.effort}",
        "error",
        *(["wall time"] if times else []),
    ]
    if scene.standstill is not None:
        head[head.index("settling")] = "stands at"
    others = _others(rows)
    cells = [[*head, *others]]
    for row in rows:
        cells.append(
            [
                row.controller,
                row.verdict.partition(":")[0],
                shown(row.stuck, ".2f", " s"),
                shown(row.severity, ".3f"),
                "never" if row.settling == math.inf else shown(row.settling, ".1f", " s"),
                "-" if row.settling == math.inf else shown(100 * row.overshoot, ".1f", " %"),  # without settling it is only a peak
                shown(row.peak * effort.factor, ".0f" if row.peak * effort.factor >= 1000 else ".4g", f" {effort.unit}"),
                shown(row.error, ".0e"),
                *([shown(1e3 * row.wall_time, ".2g" if row.wall_time < 0.1 else ".0f", " ms")] if times else []),
                *(shown(row.more.get(name, math.nan), ".4g") for name in others),
            ]
        )
    return cells


# --- the figures
