"""The verdicts on the controllers of a scene: what they are called, and their table as text, in cells and on disk."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from toolbox.errors import SceneError
from toolbox.files import tables
from toolbox.files.archives import understood
from toolbox.files.printing import columns, shown
from toolbox.files.reading import TEXT, text_of
from toolbox.files.unit_systems import reading
from toolbox.measuring.verdict import Verdict
from toolbox.scenes.judged import judged_measures
from toolbox.scenes.situation import Situation, start_in_words

if TYPE_CHECKING:
    from toolbox.scenes.scene import Scene


@dataclass(frozen=True)
class Row:
    """A row of the table of a study, in SI. nan if a number does not exist, inf for a run that never settles.

    Attributes
    ----------
    controller
        Label of the case.
    verdict
        What the controller achieved; a text.
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
    failure
        Why the run could not be finished; empty if it was.
    remark
        What the reader should know of the run, such as limits that were reached; empty for nothing.
    start
        Start of the run in words; empty for the start that the scene gives.
    more
        {name: value} of further measures.
    """

    controller: str
    verdict: Verdict
    stuck: float = math.nan
    severity: float = math.nan
    settling: float = math.nan
    overshoot: float = math.nan
    peak: float = math.nan
    error: float = math.nan
    wall_time: float = math.nan
    files: str = ""
    failure: str = ""
    remark: str = ""
    start: str = ""
    more: Mapping[str, float] = field(default_factory=dict)

    @property
    def failed(self) -> bool:
        """Whether the run could not be finished; `failure` then says why."""
        return bool(self.failure)


HEADINGS = tuple(each.name for each in dataclasses.fields(Row) if each.name not in ("wall_time", "more"))
"""Headings of the table on disk, before further measures: all but the time, which is never the same again."""
JUDGED = ("regime", "tone", "failed", "reason")
"""Fields of a verdict, which are columns of the table on disk."""
TEXTS = ("controller", "verdict", "files", "failure", "remark", "start")
"""Columns of the table on disk that hold text, beside those of the verdict."""


def _others(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(name for row in rows for name in row.more))


def write_table(rows: Sequence[Row], path: Path) -> None:
    """The rows as csv in SI units, whole or not at all; a number that does not exist is left empty, what never settles is inf."""
    others = _others(rows)
    cells = [
        [
            *(getattr(row, name) for name in HEADINGS),
            *(getattr(row.verdict, name) for name in JUDGED),
            *(row.more.get(name, math.nan) for name in others),
        ]
        for row in rows
    ]
    tables.write(path, [*HEADINGS, *JUDGED, *others], cells)


def read_table(path: Path) -> list[Row]:
    """Return the rows that `write_table` wrote. SceneError is raised if the file is no table of a study."""
    rows = []
    with understood(path, "the table of a study"):
        for told in csv.DictReader(io.StringIO(text_of(path, TEXT, "table"))):
            texts: dict[str, Any] = {name: told.pop(name, "") for name in TEXTS}
            regime, tone, failed, reason = (told.pop(name, "") for name in JUDGED)
            if regime:  # a table of an earlier version has the word alone
                texts["verdict"] = Verdict(texts["verdict"], regime, tone, failed == "True", reason)
            values = {name: float(text) if text else math.nan for name, text in told.items()}
            own: dict[str, Any] = {name: values.pop(name) for name in HEADINGS if name not in texts}
            rows.append(Row(**texts, **own, more=values))
    return rows


def table(scene: Scene, rows: Sequence[Row], times: bool = True) -> str:
    """Return the rows as text, with the judged quantities above and the remarks below. times: whether to show the computing time of each
    row."""
    lines = columns(in_cells(scene, rows, times), (0, 1), "")
    lines.insert(1, "-" * max(map(len, lines)))
    return "\n".join([scene.title, judged_by(scene, rows), "", *lines, *remarks(rows)])


def remarks(rows: Sequence[Row]) -> list[str]:
    """Return the failed runs with their reasons, and the remarks on the other runs. Equal remarks are merged, with the names of their
    controllers."""
    labels: dict[str, list[str]] = {}
    for row in rows:
        if row.remark:
            labels.setdefault(row.remark, []).append(row.controller)
    failed = [f"{row.controller} {row.verdict}: {row.failure}" for row in rows if row.failed]
    return failed + [f"{', '.join(of)}: {remark}" for remark, of in labels.items()]


def judged_by(scene: Scene, rows: Sequence[Row] = ()) -> str:
    """A sentence about what is judged in which time, and the situation of the rows."""
    speed = reading(scene.plant().unit(scene.signal), scene.display_units)
    until = (
        f"{scene.duration:g} s"
        if scene.standstill_speed is None
        else f"standstill at {scene.standstill_speed * speed.factor:g} {speed.unit}"
    )
    set_point = f"; set-point {scene.reference * speed.factor:.4g} {speed.unit}" if scene.reference else ""
    return f"{scene.judged_names}, judged from {scene.after:g} s to {until}{set_point}.\n{situation_of(scene, rows)}"


def situation_of(scene: Scene, rows: Sequence[Row] = ()) -> Situation:
    """The situation that the verdicts on the controllers of a scene hold for; rows: of a study, whose runs may begin otherwise than the scene does."""
    label = next((each for each in scene.labels if scene[each].controllers), scene.labels[0])
    return Situation.of(
        scene[label],
        begun_otherwise(rows) or start_in_words(scene[label]),
        f"{scene.duration:g} s, carried on until the regime is decided",
        design="controllers as the scene gives them",
        cases={each: scene[each] for each in scene.labels},
    )


def begun_otherwise(rows: Sequence[Row]) -> str:
    """The start of the rows of a study in words; empty for that of the scene."""
    return next((row.start for row in rows if row.start), "")


def _time_stuck(stuck: float) -> str:
    """A time in stick as text: two decimals, and three digits where these would be zeros, so that a stick is never shown as 0.00 s."""
    return shown(stuck, ".2g" if stuck and f"{stuck:.2f}" == "0.00" else ".2f", " s")


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
    if scene.standstill_speed is not None:
        head[head.index("settling")] = "stands at"
    others = _others(rows)
    left_out = [] if scene.standstill_speed is None else [head.index("severity"), head.index("overshoot")]  # a stop has neither
    cells = [[*head, *(with_unit(scene, name) for name in others)]]
    for row in rows:
        cells.append(
            [
                row.controller,
                row.verdict,
                _time_stuck(row.stuck),
                shown(row.severity, ".3f"),
                "never" if row.settling == math.inf else shown(row.settling, ".1f", " s"),
                "-" if row.settling == math.inf else shown(100 * row.overshoot, ".1f", " %"),  # without settling it is only a peak
                shown(row.peak * effort.factor, ".0f" if row.peak * effort.factor >= 1000 else ".4g", f" {effort.unit}"),
                shown(row.error, ".0e"),
                *([shown(1e3 * row.wall_time, ".2g" if row.wall_time < 0.1 else ".0f", " ms")] if times else []),
                *(shown(row.more.get(name, math.nan), ".4g") for name in others),
            ]
        )
    return [[cell for k, cell in enumerate(line) if k not in left_out] for line in cells]


def with_unit(scene: Scene, name: str) -> str:
    """The heading of a further measure, with its unit if it has one."""
    try:
        unit = judged_measures(name, scene[scene.labels[0]], 0.0, scene.duration)[name].unit_in(scene.plant())
    except SceneError:  # a function of a run
        unit = "1"
    return name if unit == "1" else f"{name} [{unit}]"
