"""Starts of judged runs: from smooth running, from the stick-slip of another controller that is taken over, or from the loop's own stick-slip.

A verdict on a closed loop holds for the start of its runs. A loop can be smooth from one start and keep sticking from another one. Each start here finds its
start values on the very plant that is judged, errors of the model included, and says in words what it is.

A takeover is bumpless: the judged controller begins with the commands that act at that instant. Sampled controllers read the held commands at their first
sample (`controllers.bumpless`); of a continuous controller with one state, such as an integral, that state is chosen so that it gives the same command.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from toolbox.arguments import whole
from toolbox.errors import SimulationError
from toolbox.measuring.judge import STICKS
from toolbox.modelling.closed_loop import ClosedLoop, value_at
from toolbox.modelling.closing import described
from toolbox.modelling.laws import Controller, Sampled
from toolbox.onsets.carried import Carried
from toolbox.onsets.coming_to import HERE, Settled
from toolbox.onsets.reach import held_starts
from toolbox.onsets.takeover import acting_at, cycle_phases, reference_of, releases_of, taken_over
from toolbox.scenes.judged import judged_contact, judged_speed, set_point
from toolbox.simulation.run_state import RunState
from toolbox.simulation.simulate import simulate
from toolbox.steady_states.steady_loop import smooth_start


def at_set_point(law: Any, reference: float) -> Any:
    """A law, and the laws inside of it, with that set-point [rad/s]; what is no dataclass is returned as it is."""
    if not dataclasses.is_dataclass(law):
        return law
    changed = {each.name: at_set_point(getattr(law, each.name), reference) for each in dataclasses.fields(law) if each.init}
    changed = {name: value for name, value in changed.items() if isinstance(value, Controller) and value is not getattr(law, name)}
    if isinstance(law, Controller) and hasattr(law, "reference"):
        changed["reference"] = reference
    return replace(law, **changed) if changed else law


Starts = Sequence[Mapping[str, Any]]
"""Start values {state of the plant, memory or held command of a controller: value}, one mapping per run."""


@dataclass(frozen=True)
class Found:
    """Start values on one plant. note: why there is no stick-slip to start from, empty if there is;  period: of the stick-slip [s]."""

    values: Starts
    note: str = ""
    period: float = math.nan


@dataclass(frozen=True)
class SmoothRunning:
    """Start of a run at smooth running, with the commands and the memory that the controllers have in this steady state.

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
        """Return the start values for the plant of a loop. Raises SceneError if no smooth running is found."""
        return Found([smooth_start(loop)])


@dataclass(frozen=True)
class TakenOver:
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
    phases: int = 8
    duration: float = 200.0

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
        """
        contact = judged_contact(loop)
        aim = reference_of(loop, judged_speed(loop, contact))
        initial = self.initial_controller if aim is None else at_set_point(self.initial_controller, aim)
        alone = loop.without_controllers.replace(controllers=(initial,), inputs={}, start={})
        run = simulate(alone.replace(inputs={name: value for name, value in loop.inputs.items() if _takes(alone, name)}), self.duration)
        if len(releases_of(run, contact)) < 2 or run.time_in(contact, "stick", after=0.8 * self.duration) == 0.0:
            return Found([taken_over(loop, acting_at(run, run.end))], f"no stick-slip to end under {described(initial)}")
        return Found([taken_over(loop, start) for start in cycle_phases(run, self.phases)])


@dataclass(frozen=True)
class OwnStickSlip:
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


Start = SmoothRunning | TakenOver | OwnStickSlip
"""Where judged runs start."""


def _takes(loop: ClosedLoop, name: str) -> bool:
    """Whether a loop has an input, or a parameter that an input may take the place of."""
    return name in loop.system.inputs or loop.system.has_parameter(name) or loop.system.has_signal(name)


def start_of(starts: Any) -> Start | None:
    """The value that says where runs start, of an argument; None for given start values."""
    if starts is None:
        return SmoothRunning()
    return starts if isinstance(starts, (SmoothRunning, TakenOver, OwnStickSlip)) else None
