"""What a run comes to where its inputs have come to rest: the judge of `toolbox.measuring.judge` with the growth of smooth running there."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
from dataclasses import dataclass

import numpy as np

from toolbox.errors import SceneError, SimulationError
from toolbox.measuring.judge import NOT_DECIDED, Judged
from toolbox.measuring.sticks import lasting, stick_intervals
from toolbox.measuring.verdict import NO_STICK, Verdict, of_judged, of_sticks
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.inputs import Table
from toolbox.modelling.steady_point import Equilibrium
from toolbox.onsets.carried import JudgedRuns
from toolbox.onsets.growth import SmoothBranch
from toolbox.simulation.request import Request, accuracy_of
from toolbox.simulation.run_state import RunState
from toolbox.simulation.trajectory import Trajectory
from toolbox.steady_states.linear import equilibrium

LONGEST = 200
"""Swings for which a run that its own time does not decide is carried on, at most."""

HERE = 0.0
"""The only place of a loop of which no number is free."""


def verdict_on(run: Trajectory, element: str, signal: str, after: float) -> tuple[Verdict, Judged | None]:
    """Return the verdict on a run, and what the judge found; None if no judge can tell more than the run shows.

    The verbs that judge single runs all take this one.

    Parameters
    ----------
    run, element, signal, after
        As in `comes_to`.
    """
    return of_run(run, element, after, comes_to(run, element, signal, after))


def of_run(run: Trajectory, element: str, after: float, judged: Judged | None) -> tuple[Verdict, Judged | None]:
    """Return the verdict on a run and its judgement. Without a judgement, the verdict follows from the intervals of stick in the run."""
    length = run.end - max(after, run.begin)
    intervals = lasting(stick_intervals(run, element, after), length)
    if judged is not None:
        return of_judged(judged, len(intervals)), judged
    found = of_sticks(intervals, after, run.end)
    return found if intervals else NO_STICK.because(found.reason), None


def comes_to(run: Trajectory, element: str, signal: str, after: float) -> Judged | None:
    """Return the judgement on a run from a time on. If the run itself does not decide, it is continued with the inputs of its end. None if
    the loop cannot be judged.

    None where no judge can say more than the run shows: an input or a law goes on changing in time, friction has two directions, nothing tells the scale of
    time because the machine has no steady running, or what is looked at is shorter than a swing.

    Parameters
    ----------
    run
        A run of a closed loop.
    element, signal
        The contact whose sticks count, and the speed whose severity is told.
    after
        Time from which on the run is looked at [s]; later where an input still changes then.
    """
    found = Settled.of(run.run.loop, element, signal, after, run.accuracy)
    return None if found is None or not found.runs.period < run.end - found.begin else found.judged(run)


@dataclass(frozen=True)
class Settled:
    """A closed loop with the last values of its inputs, and the judge of its runs. No input changes after the time `begin`.

    runs: of the loop;  begin: the time [s].
    """

    runs: JudgedRuns[float]
    begin: float

    @classmethod
    def of(
        cls,
        loop: ClosedLoop,
        element: str,
        signal: str,
        after: float,
        accuracy: float | None = None,
        known: SmoothBranch[float] | None = None,
    ) -> Settled | None:
        """Return the judge of a loop, or None if the loop cannot be judged. known: smooth running of the same loop with other seeds."""
        settled = _settled(loop, after)
        if settled is None:
            return None
        loop, begin = settled
        if loop.depends_on_time or any(each.directions > 1 for each in loop.system.elements):
            return None
        with contextlib.suppress(SceneError, SimulationError):
            still = Request(loop, 0.0, accuracy=accuracy_of(loop, accuracy)).checked()
            steady = functools.cache(lambda _: _steady(loop))  # asked for its swing and for its beginnings
            branch = known or SmoothBranch[float](still, lambda _: (), steady)
            period = branch.swing(HERE)
            runs = JudgedRuns(
                base=still, branch=branch, element=element, signal=signal, perturbation=math.nan, period=period, budget=LONGEST
            )
            return None if math.isnan(period) else cls(runs, begin)
        return None

    @property
    def rate(self) -> float:
        """Rate at which a small disturbance of smooth running grows [1/s]; nan if the rate is not known."""
        return self.runs.branch.rate(HERE)

    def judged(self, run: Trajectory) -> Judged | None:
        """Return the judgement on a run of this loop. An undecided run is continued. None if the continued run fails."""
        with contextlib.suppress(SceneError, SimulationError):
            judged = self.runs.judge(HERE).of_run(run, self.begin)
            return self.runs.run(HERE, run.last)[0] if judged.regime == NOT_DECIDED else judged
        return None

    def of_start(self, start: RunState, budget: float) -> Judged | None:
        """Return the judgement on a run from a start with the last values of the inputs. budget: longest duration of the run in swings.
        None if the run fails."""
        with contextlib.suppress(SceneError, SimulationError):
            return dataclasses.replace(self.runs, budget=budget).run(HERE, start)[0]
        return None


def last_change(loop: ClosedLoop) -> float:
    """Return the time of the last node of the inputs of a loop over time [s]; 0 if all of them are constant."""
    return max((float(value.times[-1]) for value in loop.input_values.values() if isinstance(value, Table)), default=0.0)


def _settled(loop: ClosedLoop, after: float) -> tuple[ClosedLoop, float] | None:
    """The loop with its inputs as they are at last, and the time from which on they are, `after` at least; None where one goes on changing."""
    for name, value in loop.input_values.items():
        if isinstance(value, Table):
            changes = np.flatnonzero(value.values != value.values[-1])
            after = max(after, float(value.times[changes[-1] + 1]) if changes.size else -math.inf)
            loop = loop.at(name, float(value.values[-1]))
        elif not isinstance(value, float):
            return None
    return loop, after


def _steady(loop: ClosedLoop) -> Equilibrium | None:
    """Steady running of the continuous form of a loop; None where there is none."""
    with contextlib.suppress(SceneError):
        return equilibrium(loop.continuous_loop)
    return None
