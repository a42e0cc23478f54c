"""Verdicts on the controllers of a scene: each is simulated and judged; `toolbox.scenes.verdict_table` has the table."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from toolbox.errors import SceneError, SimulationError
from toolbox.files.unit_systems import reading
from toolbox.measuring.judge import Judged
from toolbox.measuring.verdict import DOES_NOT_STAND, NO_MODES, RUN_FAILED, STANDS_AT_ONCE, Verdict, of_sticks
from toolbox.modelling.components import law_of
from toolbox.modelling.laws import Sampled
from toolbox.onsets.coming_to import verdict_on
from toolbox.scenes.judged import judged_measures, sticks_before_standstill
from toolbox.scenes.verdict_table import Row
from toolbox.simulation.simulate import simulate

if TYPE_CHECKING:
    from toolbox.modelling.closed_loop import ClosedLoop
    from toolbox.scenes.scene import Scene
    from toolbox.simulation.trajectory import Trajectory


def verdict_row(
    scene: Scene, label: str, files: str = "", metrics: Any = (), loop: ClosedLoop | None = None
) -> tuple[Row, Trajectory | None]:
    """Simulate and judge one controller: its row, with further measures as `sweep` takes them, and its run.

    A run that fails is a row as well, with the trajectory so far.  loop: of the run, by default that of the case of this label.
    """
    judged = scene[label] if loop is None else loop
    duration = judged.duration or scene.duration
    further = {} if scene.standstill_speed is None else judged_measures(STOP, judged, 0.0, duration)
    if metrics:
        further |= judged_measures(metrics, judged, 0.0, duration)
    try:
        run = scene.run(label) if loop is None else simulate(loop)
    except SimulationError as failure:
        return Row(label, RUN_FAILED, files=files, failure=str(failure)), failure.run
    try:
        error = run.error_estimate
    except SimulationError:  # the run to compare with, at a hundredth of the accuracy, may fail alone
        error = math.nan
    words, found, _ = verdict_of(judged, run)
    more = {name: each.read(run) for name, each in further.items()}
    remark = _remark(scene, run, found)
    return Row(label, words, error=error, wall_time=run.wall_time, files=files, remark=remark, more=more, **dict[str, Any](found)), run


def _remark(scene: Scene, run: Trajectory, found: Mapping[str, float]) -> str:
    """Limits that the controllers reached in a run, and how long to run a stop that does not end, in words; empty for neither."""
    told, until = [], run.end
    if scene.standstill_speed is not None:
        until = min(found["settling"], until)
        if found["settling"] == math.inf:
            speed = reading(run.unit(scene.signal), scene.display_units)
            left = abs(float(np.asarray(run[scene.signal])[-1])) * speed.factor
            told.append(
                f"`{scene.signal}` is still {left:.3g}{speed.tail} at the end of the run: increase `duration` ({scene.duration:g} s)."
            )
    for signal, values in limits_reached(run, until).items():
        words = []
        for word, limit, time in values:
            read = reading(run.unit(signal) + "/s" * (word == "rate"), scene.display_units)
            words.append(f"{word} {limit * read.factor:.4g}{read.tail} for {time:.2g} s")
        told.append(f"The command of `{signal}` was at its limits: {', '.join(words)}.")
    return " ".join(told)


CLOSE = 1e-9
"""Distance from a limit, as a fraction of it, up to which a command is at the limit."""


def limits_reached(run: Trajectory, until: float) -> dict[str, list[tuple[str, float, float]]]:
    """Return {signal: (limit in words, value of the limit, time [s] at the limit)} for the limits that the controllers declare and reach
    before a time [s]."""
    found: dict[str, list[tuple[str, float, float]]] = {}
    plant = run.run.loop.plant
    nodes = run.time <= until
    steps = np.diff(run.time[nodes])
    for given, designed in zip(run.run.loop.controllers, run.run.loop.designed_controllers, strict=True):
        inner: Any = designed.law if isinstance(designed, Sampled) else designed
        law = law_of(inner)
        for signal, (low, high) in getattr(law, "signal_limits", {}).items():
            command = plant.redirected_signals.get(signal, signal)
            if command not in run or not steps.size:
                continue
            values = np.asarray(run[command])[nodes]
            acts = np.maximum.accumulate(values != values[0])[:-1]  # the first command has arrived
            period = float(getattr(given, "period", 0.0))
            small = CLOSE * max(abs(each) for each in (low, high, 0.0) if each is not None)
            times = [("highest", high, steps[values[:-1] >= high - small].sum())] if high is not None else []
            times += [("lowest", low, steps[acts & (np.abs(values[:-1] - low) <= small)].sum())] if low is not None else []
            rate = getattr(law, "rate_limits", {}).get(signal)
            if rate is not None and period:
                full = np.abs(np.diff(values)) >= (1.0 - CLOSE) * rate * period
                times.append(("rate", rate, period * np.count_nonzero(full)))
            reached = [(word, float(limit), float(time)) for word, limit, time in times if time > 1.5 * period]  # not on the way past it
            if reached:
                found[signal] = reached
    return found


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
    """Return the verdict on a run in words, its metrics by the names of their columns, and the judgement. The judgement is None if it adds
    nothing to the run itself.

    scene: a scene, or a loop with all that a scene says of it.
    """
    found = verdict_metrics(scene, run)
    words, judged = words_of(scene, run, found)
    return words, found, judged


def verdict_metrics(scene: Any, run: Trajectory) -> dict[str, float]:
    """The measures of the verdict on a run, by the names of their columns."""
    return {name: _number_of(name, run) for name in (COLUMNS if scene.standstill_speed is None else ("stuck", "settling", "peak"))}


def words_of(scene: Any, run: Trajectory, found: Mapping[str, float]) -> tuple[Verdict, Judged | None]:
    """The verdict in words, and what the judge found, as `verdict_of`; found: the measures of the run.

    This is where the run may be carried on until the judge can tell.
    """
    if scene.standstill_speed is None:
        if scene.element is None:
            return NO_MODES, None  # a contact without modes never sticks, whether it swings says the severity
        return verdict_on(run, scene.element, scene.signal, scene.after)
    stands = found["settling"]
    if not scene.after < stands < math.inf:
        return DOES_NOT_STAND if stands == math.inf else STANDS_AT_ONCE, None
    sticks = (
        sticks_before_standstill(run, scene.element, scene.signal, scene.standstill_speed, scene.after, stands)
        if scene.element is not None
        else []
    )
    return of_sticks(sticks, scene.after, stands), None
