"""A study: every controller of a scene simulated and judged; `toolbox.scenes.verdict_table` has the table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from toolbox.errors import SceneError, SimulationError
from toolbox.measuring.judge import NOT_DECIDED, SMOOTH, STANDS, STICKS, SWINGS, Judged, told_growth
from toolbox.measuring.measure import stick_intervals
from toolbox.onsets.coming_to import comes_to
from toolbox.scenes.judged import judged_measures, sticks_before_standstill
from toolbox.scenes.verdict_table import (
    DOES_NOT_STAND,
    FAILED,
    FREE,
    IRREGULAR,
    NO_MODES,
    NO_STICK,
    RECOVERED,
    RECOVERED_ONCE,
    STANDS_AT_ONCE,
    STICK_SLIP,
    STICK_SLIP_LATER,
    STUCK,
    SWING,
    Row,
    Verdict,
)  # fmt: skip

if TYPE_CHECKING:
    from toolbox.scenes.scene import Scene
    from toolbox.simulation.trajectory import Trajectory


def verdict_row(scene: Scene, label: str, files: str = "", metrics: Any = ()) -> tuple[Row, Trajectory | None]:
    """Simulate and judge one controller: its row, with further measures as `sweep` takes them, and its run.

    A run that fails is a row as well, with the trajectory so far.
    """
    further = {} if scene.standstill_speed is None else judged_measures(STOP, scene[label], 0.0, scene.duration)
    if metrics:
        further |= judged_measures(metrics, scene[label], 0.0, scene.duration)
    try:
        run = scene.run(label)
    except SimulationError as failure:
        return Row(label, FAILED, files=files, failure=str(failure)), failure.run
    try:
        error = run.error_estimate
    except SimulationError:  # the run to compare with, at a hundredth of the accuracy, may fail alone
        error = math.nan
    words, found, _ = verdict_of(scene, run)
    more = {name: each.read(run) for name, each in further.items()}
    return Row(label, words, error=error, wall_time=run.wall_time, files=files, more=more, **dict[str, Any](found)), run


WORDS = {STICKS: STICK_SLIP, STANDS: STUCK, SWINGS: SWING}
"""Verdicts of the regimes of a judge, as in reports of onsets."""

COLUMNS = ("stuck", "severity", "settling", "overshoot", "peak")
"""Measures of the verdict, by the names of their columns."""


STOP = ("releases", "distance", "jerk")
"""Further measures of a stop."""


def _number_of(name: str, run: Trajectory) -> float:
    """A measure of a run by its name; nan where the run has nothing that it looks at, or no set-point."""
    try:
        return judged_measures(name, run.run.loop, run.begin, run.end)[name].read(run)
    except SceneError:
        return math.nan


def verdict_of(scene: Any, run: Trajectory) -> tuple[Verdict, dict[str, float], Judged | None]:
    """The verdict on a run in words, its measures by the names of their columns, and what the judge found; None where he says no more than the run shows.

    scene: a scene, or a loop with all that a scene says of it.
    """
    found = metrics_of(scene, run)
    words, judged = words_of(scene, run, found)
    return words, found, judged


def metrics_of(scene: Any, run: Trajectory) -> dict[str, float]:
    """The measures of the verdict on a run, by the names of their columns."""
    return {name: _number_of(name, run) for name in (COLUMNS if scene.standstill_speed is None else ("stuck", "settling", "peak"))}


def words_of(scene: Any, run: Trajectory, found: Mapping[str, float]) -> tuple[Verdict, Judged | None]:
    """The verdict in words, and what the judge found, as `verdict_of`; found: the measures of the run.

    This is where the run may be carried on until the judge can tell.
    """
    if scene.standstill_speed is None:
        if scene.element is None:
            return NO_MODES, None  # a contact without modes never sticks, whether it swings says the severity
        sticks = stick_intervals(run, scene.element, scene.after)
        judged = comes_to(run, scene.element, scene.signal, scene.after)
        if judged is None:  # the run shows no more than its own time
            return verdict(sticks, scene.after, scene.duration) if sticks else NO_STICK, None
        return in_words(judged, len(sticks)), judged
    stands = found["settling"]
    if not scene.after < stands < math.inf:
        return DOES_NOT_STAND if stands == math.inf else STANDS_AT_ONCE, None
    sticks = (
        sticks_before_standstill(run, scene.element, scene.signal, scene.standstill_speed, scene.after, stands)
        if scene.element is not None
        else []
    )
    return verdict(sticks, scene.after, stands), None


def in_words(judged: Judged, sticks: int) -> Verdict:
    """The verdict on a run that the judge has decided; sticks: how often it stuck in the time that was looked at.

    "free", "stick-slip", "swing" and "stuck" for its regime at last; "recovered after 1 stick" and "recovered" where it is free after one stick or several;
    "irregular" where sticks go on and never repeat; "stick-slip later" where it begins only after the time that was looked at. What nothing decides tells in
    which time a small disturbance of smooth running grows.
    """
    if judged.regime == SMOOTH:
        return {0: FREE, 1: RECOVERED_ONCE}.get(sticks, RECOVERED)
    if judged.regime == STICKS and not sticks:
        return STICK_SLIP_LATER
    if judged.regime == NOT_DECIDED:
        return IRREGULAR if judged.sticks else Verdict(told_growth(judged.rate) if judged.rate > 0 else NOT_DECIDED)
    return WORDS.get(judged.regime, Verdict(judged.regime))


def verdict(sticks: Sequence[tuple[float, float]], after: float, end: float) -> Verdict:
    """What the stick intervals between `after` and `end` [s] amount to.

    "free" for none; "stuck" where the last one lasts to the end and longer than half of the window; "stick-slip" for two or more;
    "recovered after 1 stick" for a single shorter one.
    """
    if not sticks:
        return FREE
    begin, last = sticks[-1]
    if last >= end and last - begin > 0.5 * (end - after):
        return STUCK
    return STICK_SLIP if len(sticks) > 1 else RECOVERED_ONCE
