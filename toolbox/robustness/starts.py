"""Starts of judged runs: where the runs begin that a verdict holds for, as small values that every verb takes.

    SmoothRunning()                     smooth running, with what the controllers remember there: the default of `worst_case`, `smallest_error`, `schedule`
    FromRest(ramp=0.0)                  rest, with the set-point in one step, or by a ramp of so many seconds: the default of a study and of `chance`
    TakenOver(controller, phases=8)     the stick-slip of another controller, which the judged one takes over: the default of `lowest_set_point`
    OwnStickSlip(phases=4)              the stick-slip of the judged loop itself
    GivenStarts(values)                 start values {state, memory or held command: value} of each run
    toolbox.drilling.AfterConnection()  smooth running, from which the weight is taken off, and put on again

A verdict on a closed loop holds for the start of its runs. A loop can be smooth from one start and keep sticking from another one. Each start is data, says in
words what it is, and `start.on(loop)` finds the start values, and inputs that change on the way, on the very plant that is judged, errors of the model
included. `onset`, `severity_map` and `windows` take no start: they follow both branches, from smooth running and from the stick-slip of the loop itself.

A takeover is bumpless: the judged controller begins with the commands that act at that instant. Sampled controllers read the held commands at their first
sample (`controllers.bumpless`); of a continuous controller with one state, such as an integral, that state is chosen so that it gives the same command.
"""

from __future__ import annotations

import abc
import contextlib
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from toolbox.arguments import number, whole
from toolbox.errors import SceneError, SimulationError
from toolbox.files.units import NumberOrText
from toolbox.measuring.judge import STICKS
from toolbox.messages import LOG
from toolbox.modelling.closed_loop import ClosedLoop, value_at
from toolbox.modelling.closing import described
from toolbox.modelling.inputs import ramp
from toolbox.modelling.laws import Controller, Sampled
from toolbox.onsets.carried import Carried
from toolbox.onsets.coming_to import HERE, Settled, last_change
from toolbox.onsets.reach import held_starts
from toolbox.onsets.takeover import BEFORE, PHASES, at_set_point, cycle_phases, taken_over, under_controller
from toolbox.scenes.judged import judged_contact, judged_speed, set_point
from toolbox.simulation.run_state import RunState
from toolbox.simulation.simulate import simulate
from toolbox.steady_states.steady_loop import smooth_start

Starts = Sequence[Mapping[str, Any]]
"""Start values {state of the plant, memory or held command of a controller: value}, one mapping per run."""


@dataclass(frozen=True)
class Found:
    """Where runs begin on one plant.

    Attributes
    ----------
    values
        Start values, one mapping per run.
    note
        Why there is no stick-slip to start from; empty if there is.
    period
        Period of the stick-slip [s]; nan without.
    inputs
        Inputs of each run that take the place of those of the loop; empty if there are none.
    """

    values: Starts
    note: str = ""
    period: float = math.nan
    inputs: Sequence[Mapping[str, Any]] = ()

    def loops(self, loop: ClosedLoop) -> list[ClosedLoop]:
        """Return the loop of each run. The duration and the judged time of a loop of a scene count from the last change of the inputs of its start."""
        inputs = self.inputs or [{} for _ in self.values]
        begun = [loop.replace(start=start, inputs={**loop.inputs, **more}) for start, more in zip(self.values, inputs, strict=True)]
        return [_later(each, max(last_change(each) - last_change(loop), 0.0)) for each in begun]


def _later(loop: ClosedLoop, seconds: float) -> ClosedLoop:
    """A loop of a scene that lasts longer by so many seconds, and is judged later by as many."""
    times = {name: value + seconds for name, value in (("duration", loop.duration), ("after", loop.after)) if value is not None}
    return loop.replace(**times) if seconds else loop


class Start(abc.ABC):
    """Where judged runs begin: a value that says it in words and finds it on a plant.

    Examples
    --------
    >>> from toolbox.robustness import FromRest, Start
    >>> print(isinstance(FromRest("30 s"), Start), FromRest("30 s").words)
    True rest, set-point by a ramp of 30 s
    """

    @property
    @abc.abstractmethod
    def words(self) -> str:
        """Description of the start."""

    @abc.abstractmethod
    def on(self, loop: ClosedLoop) -> Found:
        """Return the start values on the plant of a loop. Raises SceneError if the loop cannot start so.

        Parameters
        ----------
        loop
            The loop whose runs begin at these start values.
        """

    def single_loop(self, loop: ClosedLoop) -> ClosedLoop:
        """Return the loop of the only run that begins at this start, for `simulate`.

        Raises SceneError if no run, or more than one, begins so.

        Parameters
        ----------
        loop
            The loop whose run begins at this start.
        """
        found = self.on(loop)
        runs = found.loops(loop)
        if len(runs) > 1:
            raise SceneError(
                f"Argument `start` must begin one run, but {type(self).__name__} begins {len(runs)}: "
                "simulate each loop of `start.on(loop).loops(loop)`, or take one phase."
            )
        if not runs:
            raise SceneError(f"Argument `start` must be a start that the loop has: {found.note}.")
        if found.note:
            LOG.warning("%s", found.note)
        return runs[0]


@dataclass(frozen=True)
class SmoothRunning(Start):
    """Start of a run near smooth running, with the commands and the memory that the controllers have in this steady state.

    In a loop that has a linear approximation there, the states of the plant are 2 % smaller than in the steady state, so
    that a run shows whether an oscillation grows.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose, worst_case
    >>> from toolbox.robustness import SmoothRunning
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), Sampled(SoftTorque(reference="60 rpm"), "10 ms"))
    >>> print(worst_case(loop, "60 s", starts=SmoothRunning()).survives)
    True
    """

    @property
    def words(self) -> str:
        """Description of the start as text."""
        return "smooth running"

    def on(self, loop: ClosedLoop) -> Found:
        """Return the start values for the plant of a loop. Raises SceneError if no smooth running is found.

        Parameters
        ----------
        loop
            The loop whose runs begin at these start values.
        """
        return Found([smooth_start(loop)])


@dataclass(frozen=True)
class FromRest(Start):
    """Start of a run from rest, with the set-point in one step or by a ramp.

    Parameters
    ----------
    ramp
        Duration of the ramp from 2 % of the set-point to the set-point [s]. 0 (default) for one step.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose, worst_case
    >>> from toolbox.robustness import FromRest
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), Sampled(SoftTorque(reference="95 rpm"), "10 ms"))
    >>> print(worst_case(loop, "150 s", starts=FromRest("30 s")).survives)
    True
    """

    ramp: NumberOrText = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "ramp", number("ramp", self.ramp, "s", at_least=0))

    @property
    def words(self) -> str:
        """Description of the start."""
        return f"rest, set-point by a ramp of {self.ramp:g} s" if self.ramp else "rest, set-point in one step"

    def on(self, loop: ClosedLoop) -> Found:
        """Return the start values on the plant of a loop. Raises SceneError for a ramp of a loop without a set-point.

        Parameters
        ----------
        loop
            The loop whose runs begin at these start values.
        """
        if not self.ramp:
            return Found([{}])
        name = set_point(loop.system, judged_speed(loop, judged_contact(loop)))
        if name is None or math.isnan(float(loop.number(name).value)):
            raise SceneError("Argument `ramp` must be given to a loop with a constant set-point, but it has none.")
        value = float(loop.number(name).value)
        return Found([{}], inputs=[{name: ramp(0.02 * value, value, 0.0, float(self.ramp))}])


@dataclass(frozen=True)
class GivenStarts(Start):
    """Start from given values of states, memories and held commands, such as `cycle_phases` returns.

    Parameters
    ----------
    values
        {state of the plant, memory or held command of a controller: value} of each run.

    Examples
    --------
    >>> from toolbox.robustness import GivenStarts
    >>> GivenStarts([{"bit.speed": 1.0}, {"bit.speed": 2.0}]).words
    '2 given start(s)'
    """

    values: Starts

    @property
    def words(self) -> str:
        """Description of the start."""
        return f"{len(self.values)} given start(s)"

    def on(self, loop: ClosedLoop) -> Found:
        """Return the start values on the plant of a loop, with the commands that act.

        Parameters
        ----------
        loop
            The loop whose runs begin at these start values.
        """
        return Found([{**loop.start, **taken_over(loop, start)} for start in self.values])


@dataclass(frozen=True)
class TakenOver(Start):
    """Start of a run in the stick-slip cycle of another controller. The judged controller takes over without a jump of the command.

    Parameters
    ----------
    initial_controller
        The controller under which the plant sticks and slips, such as `StiffPI()`. Its `reference` follows the
        set-point of the judged loop.
    phases
        Number of instants of the cycle at which the judged controller takes over, at equal fractions of its period.
    duration
        Time for which the initial controller runs before the takeover [s]. Its last complete cycle is used.

    Examples
    --------
    >>> from controllers import SoftTorque, StiffPI
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose, worst_case
    >>> from toolbox.robustness import TakenOver
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> loop = closed_loop(rig, Sampled(SoftTorque(reference="95 rpm"), "10 ms", delay="30 ms"))
    >>> worst_case(loop, "150 s", starts=TakenOver(StiffPI(), phases=2)).survives
    True
    """

    initial_controller: Controller | Sampled
    phases: int = PHASES
    duration: float = BEFORE

    def __post_init__(self) -> None:
        whole("phases", self.phases, 1)

    @property
    def words(self) -> str:
        """Description of the start as text."""
        return f"{self.phases} phase(s) of the stick-slip under {described(self.initial_controller)}, which is taken over without a jump"

    def on(self, loop: ClosedLoop) -> Found:
        """Return the start values for the plant of a loop. If the initial controller shows no stick-slip, return the
        last instant of its run and a note.

        Raises SimulationError if the run of the initial controller cannot be finished.

        Parameters
        ----------
        loop
            The loop whose runs begin at these start values.
        """
        values, note = under_controller(loop, self.initial_controller, self.phases, self.duration)
        return Found(values, note)


@dataclass(frozen=True)
class OwnStickSlip(Start):
    """Start of a run in the stick-slip of the judged loop itself, at phases of the stick-slip cycle, with the memory that the controllers have there.

    The stick-slip is searched from four starts: smooth running whose contact is stopped, rest, smooth running in which
    each weakly damped mode oscillates, and the stick-slip of the plant with constant commands.

    Parameters
    ----------
    phases
        Number of instants of the cycle, at equal fractions of its period.

    Examples
    --------
    >>> from controllers import SoftTorque
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose, worst_case
    >>> from toolbox.robustness import OwnStickSlip
    >>> loop = closed_loop(compose(wells.JANSEN_2, BitRock(weight="97 kN")), Sampled(SoftTorque(reference="60 rpm"), "10 ms"))
    >>> print(worst_case(loop, "60 s", starts=OwnStickSlip()).survives)
    False
    """

    phases: int = 4

    def __post_init__(self) -> None:
        whole("phases", self.phases, 1)

    @property
    def words(self) -> str:
        """Description of the start as text."""
        return f"{self.phases} phase(s) of the loop's own stick-slip"

    def on(self, loop: ClosedLoop) -> Found:
        """Return the start values for the plant of a loop.

        If no start leads to permanent stick-slip, or if this cannot be decided, return no start values and a note.

        Parameters
        ----------
        loop
            The loop whose runs begin at these start values.
        """
        contact = judged_contact(loop)
        settled = Settled.of(loop, contact, judged_speed(loop, contact), 0.0)
        if settled is None:
            return Found([], "stick-slip of its own was not looked for, because no judge tells whether it lasts")
        carried = Carried(search=settled.runs)
        end = carried.seek(HERE)
        for begin in itertools.chain(held_starts(carried.search, HERE), _from_below(loop)) if end is None else ():
            if carried.tried(HERE, begin).regime == STICKS:
                end = carried.cycling[HERE]
                break
        if end is not None:
            period = next(judged.interval for _, judged, _ in carried.rounds[HERE] if judged.regime == STICKS)
            run = settled.runs.base.again(start=end, duration=1.001 * period, longest_step=period / 32)
            points = [run.at(float(end.time + period * k / self.phases)) for k in range(self.phases)]
            return Found([{name: value_at(point, name, size) for name, _, size in run.last.layout} for point in points], period=period)
        return Found([], f"no stick-slip of its own was found, begun from {TRIED}")


TRIED = "a stopped contact, rest, each weakly damped motion, the stick-slip under constant commands, and its own at lower set-points"
"""Starts from which the stick-slip of a loop is looked for."""

LOWER, STEPS = (0.75, 0.5), 32
"""Lower set-points at which stick-slip is begun, as fractions, and the steps in which it is led up from there."""


def _from_below(loop: ClosedLoop) -> Iterator[RunState]:
    """States of the loop into which its stick-slip at lower set-points was led."""
    name = set_point(loop.system, judged_speed(loop, judged_contact(loop)))
    aim = math.nan if name is None else float(loop.number(name).value)
    for share in LOWER if name is not None and math.isfinite(aim) else ():
        lower = Settled.of(loop.at(str(name), share * aim), judged_contact(loop), judged_speed(loop, judged_contact(loop)), 0.0)
        end = None if lower is None else Carried(search=lower.runs).seek(HERE)
        if lower is None or end is None:
            continue
        with contextlib.suppress(SimulationError):
            for k in range(1, STEPS + 1):
                end = simulate(loop.at(str(name), (share + (1.0 - share) * k / STEPS) * aim), 2.3 * lower.runs.period, start=end).last
            yield end


def start_of(starts: Start | Starts | None) -> Start:
    """The start that an argument says: smooth running if it is None, given start values if it is no start."""
    return SmoothRunning() if starts is None else starts if isinstance(starts, Start) else GivenStarts(list(starts))


__all__ = [
    "FromRest", "GivenStarts", "OwnStickSlip", "SmoothRunning", "Start", "TakenOver", "at_set_point", "cycle_phases", "start_of",
]  # fmt: skip
