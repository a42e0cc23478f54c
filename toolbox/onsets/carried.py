"""Runs of one loop at places of its free numbers, each carried on until the judge can tell its regime, and stick-slip carried on from place to place.

A place is the value of one number, as in `onset`, or a point of the plane of two, as in `severity_map`: what is done at it, and on the straight way from one to
the next, is the same.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic

import numpy as np

from toolbox.arguments import count_of
from toolbox.errors import SceneError, SimulationError
from toolbox.files.journal import Journal
from toolbox.measuring import measure
from toolbox.measuring.judge import FAILED, NONE, NOT_DECIDED, SMOOTH, STANDS, STICKS, SWINGS, Judge, Judged
from toolbox.modelling.steady_point import function_of
from toolbox.onsets.growth import Place, SmoothBranch, with_numbers
from toolbox.onsets.motions import Smooth, moved, slip_rows, swings
from toolbox.simulation.run import Run
from toolbox.simulation.run_state import RunState
from toolbox.simulation.trajectory import Trajectory
from toolbox.steady_states.running import at_set_points

STEPS = 12
"""Steps in which the parameter goes from one value to the next, with a little more than two periods at each: a jump at once would shake a cycle off."""

FINEST = 1 / 256
"""The smallest step, in parts of the way, in which stick-slip is led into the range."""

NOISY = 32
"""Swings of smooth running over which the deviation that measurement noise makes is looked at; half as much again may come."""

BEYOND = 1.5
"""Swing of a mode from which stick-slip may start, in parts of what brings the slip of the contact to zero."""

DAMPED = 0.3
"""Damping ratio from which on a mode does not swing enough to begin stick-slip."""

STOPPED = "a stopped contact"
"""The beginning that is tried first."""

RANK = (NONE, FAILED, SMOOTH, SWINGS, NOT_DECIDED, STANDS, STICKS)
"""Regimes, the more of a stick-slip the later."""


@dataclass(frozen=True)
class Job:
    """A run that is carried on until its judge can tell; it holds all that it takes, so that another thread or process may do it."""

    run: Run
    judge: Judge
    begin: RunState

    def __call__(self) -> tuple[Judged, RunState | None]:
        """What the run comes to, and where it ended."""

        def on(state: RunState, duration: float) -> Trajectory:
            return self.run.again(start=state, duration=duration, longest_step=self.judge.swing / 32)

        try:
            return self.judge.carried(on, self.begin)
        except SimulationError:
            return Judged(FAILED), None


@dataclass(kw_only=True)
class JudgedRuns(Generic[Place]):
    """Runs of one closed loop at places of its free numbers, judged and counted.

    branch: smooth running without measurement noise: with noise no motion is smooth, and nothing shows whether a disturbance grows. `led` holds
    {value: (regime, end)} of smooth running that was lost into stick-slip or standstill. journal: keeps what each run came to, in the order of the runs, which
    is the same each time.
    """

    base: Run
    branch: SmoothBranch[Place]
    element: str
    signal: str
    perturbation: float
    period: float
    budget: float
    runs: int = 0
    notes: list[str] = field(default_factory=list)
    led: dict[Place, tuple[str, RunState]] = field(default_factory=dict)
    bar: Any = None
    journal: Journal | None = None
    resting: dict[Place, tuple[float, RunState | None]] = field(default_factory=dict)
    noises: dict[Place, float] = field(default_factory=dict)

    def at(self, value: Place) -> Run:
        """The run with the free parameter at a value."""
        return with_numbers(self.base, self.branch.numbers(value))

    # ------------------------------------------------------------------------------------------------------------------------------------- one run
    def job(self, value: Place, begin: RunState, /, finer: float = 1.0, silent: bool = False, known: Sequence[Judged] = ()) -> Job:
        """Return the run at a place with its judge. silent: without measurement noise; known: results of other runs at the place."""
        begin = self.still_stuck(value, begin)
        run = dataclasses.replace(self.branch.at(value) if silent else self.at(value), accuracy=self.base.accuracy * finer)
        return Job(run, dataclasses.replace(self.judge(value), known=known), begin)

    def run(
        self, value: Place, begin: RunState, /, finer: float = 1.0, silent: bool = False, known: Sequence[Judged] = ()
    ) -> tuple[Judged, RunState | None]:
        """Run at a place, and return the judgement and the last state. silent: without measurement noise; known: results of other runs at
        the place."""
        self.runs += 1
        if self.bar is not None:
            self.bar.update()
        number = self.runs
        kept = self.kept(number)
        return self.keeping(number, self.job(value, begin, finer, silent, known)()) if kept is None else kept

    def kept(self, number: int) -> tuple[Judged, RunState | None] | None:
        """Return the judgement and the last state of a run from the journal, by the number of the run. None if the journal does not have
        the run."""
        known = None if self.journal is None else self.journal.known.get((number,))
        return known and (Judged(*known[0]), None if known[1] is None else self.base.start.as_told(known[1]))

    def keeping(self, number: int, came_to: tuple[Judged, RunState | None]) -> tuple[Judged, RunState | None]:
        """Write the result of a run into the journal, by the number of the run. A run whose Python controller does not give its memory is
        not written."""
        judged, end = came_to
        told = None if end is None else end.told()
        if self.journal is not None and (end is None or told is not None):
            self.journal.add((number,), [dataclasses.astuple(judged), told])
        return came_to

    def judge(self, value: Place) -> Judge:
        """The judge of runs at a value."""
        smooth = self.branch(value)
        if smooth is None:
            return Judge(self.element, self.signal, self.period, budget=self.budget)
        target = self.steady(value)[0]
        return Judge(self.element, self.signal, self.period, target, smooth.growth.rate, self._noise(value, smooth), self.budget)

    def steady(self, value: Place) -> tuple[float, RunState | None]:
        """Return the mean of the judged signal in smooth running, stable or not, and a state with its modes a moment later. nan and None if
        there is no smooth running."""
        if value not in self.resting:
            smooth, self.resting[value] = self.branch(value), (math.nan, None)
            if smooth is not None:
                with contextlib.suppress(SimulationError):
                    short = self.branch.at(value).again(start=smooth.state, duration=self.period / 8, longest_step=self.period / 256)
                    self.resting[value] = measure.extent(short, self.signal).mean, short.last
        return self.resting[value]

    def _noise(self, value: Place, smooth: Smooth) -> float:
        """Largest deviation of the judged signal that measurement noise makes in smooth running; 0 without noise, and where smooth running does not last."""
        if self.branch.run is self.base or not smooth.growth.rate < 0:
            return 0.0
        if value not in self.noises:
            run = self.at(value).again(start=smooth.state, duration=NOISY * self.period, longest_step=self.period / 32)
            found, target = measure.extent(run, self.signal, run.begin), self.steady(value)[0]
            self.noises[value] = 1.5 * max(found.maximum - target, target - found.minimum)
        return self.noises[value]

    def walked(self, begin: RunState, origin: Place, value: Place) -> RunState:
        """Where the machine is after the free parameter went from one value to another in small steps."""
        if value == origin:
            return begin
        for k in range(1, STEPS):
            try:
                between = origin + (value - origin) * k / STEPS
                run, begin = self.at(between), self.still_stuck(between, begin)
                begin = run.again(start=begin, duration=2.3 * self.period, longest_step=self.period / 256).last
            except SimulationError:
                return begin
        return begin

    def still_stuck(self, value: Place, begin: RunState) -> RunState:
        """Return the state with every sticking contact kept at rest at the new value. The slip may depend on the value, as on the speed of
        a belt, and a jump of the slip would end the stick."""
        modes = self._modes(begin)
        return self._projected(value, begin, modes) if 0.0 in modes.values() else begin

    # ----------------------------------------------------------------------------------------------------------------------- from smooth running
    def smooth(self, value: Place, finer: float = 1.0) -> Judged:
        """Return the judgement on smooth running with the smallest disturbance. The last state is kept if the run ends in stick-slip or
        standstill."""
        found = self.branch(value)
        if found is None:
            return Judged(NONE)
        if found.growth.rate < 0:
            return Judged(SMOOTH, 0.0, rate=found.growth.rate)
        judged, end = self.run(value, self.disturbed(value, found), finer=finer, silent=True)
        self.keep_led(value, judged, end)
        return judged

    def keep_led(self, value: Place, judged: Judged, end: RunState | None) -> None:
        """Keep the last state of a run whose smooth running was lost to stick-slip or standstill, as a start of later runs."""
        if judged.regime in (STICKS, STANDS) and end is not None:
            self.led.setdefault(value, (judged.regime, end))

    def disturbed(self, value: Place, found: Smooth) -> RunState:
        """Smooth running moved along its least damped motion, until the slip of the judged contact changes by the perturbation at most."""
        n, names = found.state.states.size, [element.name for element in self.base.system.elements]
        slope = slip_rows(self.base.system, found.state.states, self.at(value).system.values)[names.index(self.element)]
        moved, sizes = abs(float(slope @ found.direction[:n])), np.abs(slope) @ np.abs(found.direction[:n])
        if moved > 1e-9 * sizes:
            size = abs(self.steady(value)[0] or 1.0) / moved
        else:  # this motion does not move the contact
            size = np.abs(found.state.states).max(initial=1.0) / np.abs(found.direction).max(initial=1e-300)
        return found.state.at_values(found.state.values + self.perturbation * size * found.direction)

    def stopped(self, value: Place) -> RunState | None:
        """Return the state of smooth running with the judged contact stopped at once, like a bit that gets stuck. None if there is no
        smooth running."""
        smooth = self.branch(value)
        if smooth is None:
            return None
        return self._projected(value, smooth.state, {**self._modes(self.steady(value)[1]), self.element: 0.0})

    def _modes(self, state: RunState | None) -> dict[str, float]:
        """{element: its mode in a state}; empty where it does not know them."""
        if state is None or state.modes is None:
            return {}
        return dict(zip([each.name for each in self.base.system.elements], state.modes.tolist(), strict=True))

    def _projected(self, value: Place, state: RunState, modes: dict[str, float]) -> RunState:
        """A state whose contacts of mode 0 are brought to rest, as at their entry into stick; modes: {element: mode}, 1 where it is not known."""
        run = self.at(value)
        plant = run.plant
        m = np.array([modes.get(each.name, 1.0) for each in plant.elements])
        x = np.concatenate([np.atleast_1d(state[name]) for name in plant.states])
        u = np.array(plant.input_defaults(plant.values)).ravel()
        for k, name in enumerate(plant.inputs):
            if isinstance(given := run.loop.input_values.get(name), float):
                u[k] = given
        project = function_of(plant, ("project",), lambda: [plant.switched_equations.projected])
        moved = np.array(project(0.0, x, u, plant.values, m)).ravel()
        if np.allclose(moved, x, rtol=1e-13, atol=0.0):
            return state
        places = {name: (first, size) for name, (first, size, _) in plant.states.items()}
        return state.with_values({name: moved[first : first + count_of(size)] for name, (first, size) in places.items()})


@dataclass(kw_only=True)
class Carried(Generic[Place]):
    """Stick-slip and standstill of a loop: each is found at some places and carried on to other places.

    Attributes
    ----------
    search
        The runs.
    cycling, standing
        {place: where a run ended} in stick-slip, and in standstill.
    found
        {place: what the runs there came to, of them the one that is most of a stick-slip}.
    outer
        Places outside of what is looked at with stick-slip.
    rounds
        {place: (what it began from, verdict, where the run ended)} of all runs that came to stick-slip.
    calm
        {place: the first verdict on a run there that came to smooth running}.
    begun
        (place, beginning) of all that were tried.
    """

    search: JudgedRuns[Place]
    cycling: dict[Place, RunState] = field(default_factory=dict)
    standing: dict[Place, RunState] = field(default_factory=dict)
    found: dict[Place, Judged] = field(default_factory=dict)
    outer: list[Place] = field(default_factory=list)
    rounds: dict[Place, list[tuple[str, Judged, RunState]]] = field(default_factory=dict)
    calm: dict[Place, Judged] = field(default_factory=dict)
    begun: set[tuple[Place, str]] = field(default_factory=set)

    def still_starts(self, value: Place) -> Iterator[tuple[str, RunState]]:
        """Yield (name, state) of the two starts with a contact at rest: smooth running with the contact stopped, and rest."""
        stopped: RunState | None = self.search.stopped(value)
        if stopped is not None:
            yield STOPPED, stopped
        yield "rest", self.search.base.start

    def starts(self, value: Place) -> Iterator[tuple[str, RunState]]:
        """Yield (name, state) of the starts of stick-slip: the starts with a contact at rest, then smooth running disturbed along each
        weakly damped mode."""
        yield from self.still_starts(value)
        search, smooth = self.search, self.search.branch(value)
        if smooth is None:
            return
        with contextlib.suppress(SceneError):
            point = at_set_points(search.at(value).loop)
            names = [each.name for each in point.plant.elements]
            row = slip_rows(point.plant, point.states, point.plant.values)[names.index(search.element)]
            for exponent, motion in swings(point, row):
                if -exponent.real > DAMPED * abs(exponent):
                    continue
                size = BEYOND * abs(search.steady(value)[0])
                yield f"the swing of {2 * math.pi / exponent.imag:.3g} s", moved(smooth.state, point.plant, -size * motion)

    def tried(
        self, value: Place, begin: RunState, finer: float = 1.0, begun: str = "stick-slip carried on", known: Sequence[Judged] = ()
    ) -> Judged:
        """Run from a start, and keep the last state under the regime in which the run ends. begun: name of the start; known: results of
        other runs at the place."""
        judged, end = self.search.run(value, begin, finer=finer, known=known)
        self.keep(value, judged, end, begun)
        return judged

    def keep(self, value: Place, judged: Judged, end: RunState | None, begun: str) -> None:
        """Keep the judgement on a run and its last state. begun: name of the start of the run."""
        if end is not None and judged.regime == STICKS:
            self.cycling[value] = end
            self.rounds.setdefault(value, []).append((begun, judged, end))
        elif end is not None and judged.regime == STANDS:
            self.standing.setdefault(value, end)
        elif judged.regime == SMOOTH:
            self.calm.setdefault(value, judged)
        if value not in self.found or worse(judged, self.found[value]):
            self.found[value] = judged

    def seek(self, value: Place) -> RunState | None:
        """Stick-slip at a value from all beginnings, until one leads into it."""
        for begun, begin in () if value in self.cycling else self._untried(value):
            if self.tried(value, begin, begun=begun, known=self.known(value)).regime == STICKS:
                break
        return self.cycling.get(value)

    def begun_from_all(self, value: Place) -> None:
        """Begin stick-slip at a value from all starts that were not tried. A cycle that was known before remains the cycle that is carried
        on."""
        known = self.cycling.get(value)
        for begun, begin in self._untried(value):
            self.tried(value, begin, begun=begun, known=self.known(value))
        if known is not None:
            self.cycling[value] = known

    def known(self, value: Place) -> list[Judged]:
        """Return earlier judgements at a value that help to judge other runs there: all stick-slip cycles, and smooth running."""
        known: list[Judged] = [judged for _, judged, _ in self.rounds.get(value, ())]
        return [self.calm[value], *known] if value in self.calm else known

    def _untried(self, value: Place) -> Iterator[tuple[str, RunState]]:
        """The beginnings at a value that were not tried yet."""
        for begun, begin in self.starts(value):
            if (value, begun) not in self.begun:
                self.begun.add((value, begun))
                yield begun, begin

    def outside(self, edge: Place, beyond: Iterable[Place]) -> None:
        """Look for stick-slip outside of an edge of the range, and lead it to the edge. beyond: places outside, the nearest first."""
        for value in beyond:
            try:
                end = self.seek(value)
            except SceneError:  # the number itself is refused there
                return
            if end is not None:
                self.outer.append(value)
                self.led(value, edge)
                return

    def led(self, origin: Place, goal: Place) -> bool:
        """Lead stick-slip from one value to another, and return whether it arrives. A step that loses stick-slip is halved. The results of
        all steps are kept."""
        part, size = 0.0, 0.25
        here = origin
        while part < 1.0 and size >= FINEST:
            following = origin + (goal - origin) * min(part + size, 1.0)
            begin = self.search.walked(self.cycling[here], here, following)
            if self.tried(following, begin).regime == STICKS:
                part, here = min(part + size, 1.0), following
            else:
                size /= 2
        return part >= 1.0


def worse(judged: Judged, other: Judged) -> bool:
    """Whether a verdict is more of a stick-slip than another."""
    return RANK.index(judged.regime) > RANK.index(other.regime)


def is_run(result: Any) -> bool:
    """Whether a result of a journal is what a run came to."""
    return isinstance(result, list) and len(result) == 2 and isinstance(result[0], list) and isinstance(result[1], dict | None)
