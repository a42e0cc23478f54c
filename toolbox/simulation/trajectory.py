"""Results: signals in time, modes, events, and what they cost."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import casadi as ca
import numpy as np

from toolbox.arguments import FloatArray, short
from toolbox.compilation.formulas import Formulas
from toolbox.compilation.program import program_of
from toolbox.errors import SceneError, SimulationError, suggest
from toolbox.modelling.closing import kind_of
from toolbox.modelling.components import law_of
from toolbox.simulation.between_nodes import outside_jumps, states_between
from toolbox.simulation.budget import UNHURRIED, Budget
from toolbox.simulation.methods import EventExact, Smoothing, TimeStepping
from toolbox.simulation.recorded import Recorded
from toolbox.simulation.run_state import RunState
from toolbox.simulation.samples import Event, Samples
from toolbox.simulation.saved_run import SavedRun
from toolbox.vocabulary import Renamed


class Replay:
    """A law that gives the recorded answers of another, one after the other."""

    def __init__(self, answers: list[np.ndarray]):
        self.answers = answers
        self.place = 0

    def __call__(self, t: float, y: np.ndarray) -> np.ndarray:
        self.place += 1
        return self.answers[self.place - 1]


ROUND_OFF = 1e-10
"""A state below this part of the largest of its unit is what that one leaves of it in rounding: its errors are errors of the large one. No step is controlled
by less."""


@dataclass(frozen=True)
class Records:
    """Records of the event loop for a run.

    `time`, `states`, `mode` and `held` have a row for every node, `passed` are the ends of steps that are none. `before` is the time of the node until which
    the steps were others, and their formulas. `event_arrays` are the times, elements and modes of the events, `last_mode` the modes at the end, and `last` the
    state there, without that of Python laws. All others are what they are in `Trajectory`.
    """

    time: np.ndarray
    states: np.ndarray
    mode: np.ndarray
    held: np.ndarray
    parameters: np.ndarray
    event_arrays: tuple[np.ndarray, np.ndarray, np.ndarray]
    last_mode: np.ndarray
    end: float
    answers: list[list[np.ndarray]]
    steps: tuple[int, int]
    merged: int
    wall_time: float
    last: RunState | None
    passed: np.ndarray = field(default_factory=lambda: np.empty(0))
    before: tuple[float, Formulas] | None = None


class Trajectory(Renamed, Recorded, Samples[FloatArray]):
    """Result of `simulate`: the signals, modes and events of a run.

    - `run.time` and `run["bit.speed"]`: recorded times and values of a signal.
    - `run.modes["bit"]`: modes of a contact. `run.events`: all switches.
    - `run.at(12.5)["bit.speed"]`: value of a signal at any time.
    - `print(run)`: summary.

    Attributes
    ----------
    time
        Recorded times [s], shape (nt,). With `output_times` these times. Otherwise every step, and each event twice
        (before and after it).

        Exception: if the records of a very long run would need more memory than `toolbox.simulation.thin_records.MOST`,
        the run keeps only every second, third ... step and all events. `run.at` has the same accuracy as with all
        steps, and `run.every_step` computes the omitted steps again.
    states
        States at the recorded times, shape (nt, n).
    begin
        Time at which the run begins [s]: 0, or the time of the state from which it continues.
    end
        Time at which the run ends [s]: `begin` + duration, or an earlier time if the run failed.
    wall_time
        Computing time in the event loop [s].
    steps
        Numbers of steps of the run, a pair (accepted, rejected).
    merged
        Number of cases in which a contact reached the limit of its mode, but its mode did not change. The contact only
        touched the limit, or it left its mode and returned faster than can be resolved.
    before
        (time [s], formulas) of a run that changed from explicit to implicit steps: the time of the change, and the
        explicit formulas of the steps before this time. None for every other run.
    answers
        Outputs of the controllers that are written in Python: for each controller a list with one array per sample.
    controllers
        The controllers that are written in Python, in their state at the end of the run, with their records. A pickled
        trajectory does not contain them.
    why
        Text about the choice of steps. For the method "event": the kind of steps that the run used, and the reason for
        this kind. For another method: empty text, or the reason if the run did not use the steps of this method.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, simulate
    >>> run = simulate(compose(BlockOnBelt()), "60 s")
    >>> print(f"{run.at(30.0)['block.speed']:.2f} m/s, {len(run.events)} events, {run.time_in('belt', 'stick'):.1f} s in stick")
    0.04 m/s, 11 events, 38.3 s in stick
    """

    controllers: tuple[Any, ...] = ()

    if TYPE_CHECKING:

        @overload
        def at(self, time: float | str) -> Samples[float | Any]: ...  # type: ignore[overload-overlap]
        @overload
        def at(self, time: Sequence[float | str] | FloatArray) -> Samples[FloatArray]: ...
        def at(self, time: Any) -> Any: ...

    def __init__(self, *, run: Any, program: Any, records: Records, why: str = ""):
        super().__init__(program, records.time, records.states, records.mode, records.held, records.parameters, False)
        self.run = run
        self.parameters = records.parameters
        self.steps = records.steps
        self.merged = records.merged
        self.wall_time = records.wall_time
        self._event_arrays = records.event_arrays
        self._last_mode = records.last_mode
        self.begin, self.end = run.start.time, records.end
        self.answers = records.answers
        self._last = records.last
        self.passed = records.passed
        self.before = records.before
        self.why = why

    @staticmethod
    def at_instant(run: Any, program: Any, t: float, x: np.ndarray, m: np.ndarray, p: np.ndarray) -> Samples[float | Any]:
        """Return the signals at one instant of a run that has not ended, for code inside the event loop.

        Parameters
        ----------
        run, program
            The description of the run, and the compiled program of its plant.
        t, x, m, p
            Time [s], states, modes and parameters at this instant.
        """
        held = p[program.first_held :]
        return Samples(program, np.array([t]), x[None, : program.system.x.numel()].copy(), m[None, :], held[None, :].copy(), p, True)

    def __reduce__(self) -> Any:
        """A trajectory travels as its arguments and arrays; the program is made again from the cache of object code."""
        return _trajectory_again, (type(self), self.program.formulas, self._told())

    def _told(self) -> dict[str, Any]:
        """The arguments and arrays of a trajectory."""
        names = (
            "run",
            "time",
            "states",
            "mode",
            "held",
            "parameters",
            "steps",
            "merged",
            "wall_time",
            "end",
            "answers",
            "passed",
            "before",
            "why",
        )
        data = {name: getattr(self, name) for name in names}
        data |= {"event_arrays": self._event_arrays, "last_mode": self._last_mode, "last": self._last}
        return data

    def end_before(self, event: int) -> None:
        """Remove the event with a given index and all later events, and end the recorded run at the time of this event.

        A simulation uses this method if the run has had more events than its `budget` allows.

        Parameters
        ----------
        event
            Index of the first event to remove, counted from 0.
        """
        times, index, modes = self._event_arrays
        first = int(np.searchsorted(times, times[event]))
        for i, (before, _, _) in zip(index[first:][::-1], modes[first:][::-1], strict=True):
            self._last_mode[i] = before
        self.end = float(times[event])
        self._last = None
        self._event_arrays = times[:first], index[:first], modes[:first]
        kept = int(np.searchsorted(self.time, self.end)) + 1  # its left side
        self.time, self.states, self.mode, self.held = (array[:kept] for array in (self.time, self.states, self.mode, self.held))
        if self.time.size and self.time[-1] == self.end:
            self.mode[-1] = self._last_mode

    @property
    def duration(self) -> float:
        """Duration of the run that was requested [s]."""
        return self.run.duration

    @cached_property
    def last(self) -> RunState:
        """The whole state at the end of the run, from which another run continues: `simulate(plant, duration,
        start=run.last, ...)`.

        It contains the states of the plant, the memory of all controllers, the commands that are held, and the commands
        that are still delayed. For a controller in Python it contains the array of its method `get_memory`. Without
        this method it contains a copy of the object. A plain function is assumed to have no memory.

        Raises SceneError in three cases:

        - a controller in Python has no `get_memory` and cannot be copied;
        - the trajectory was pickled, so that its controllers in Python are lost;
        - a limit on the number of events ended the run.
        """
        if self._last is None or len(self.controllers) != len(self.run.controllers):
            lost = (
                "it ended between two events of one instant"
                if self._last is None
                else "its Python laws do not travel with a pickled run: pickle `run.last`"
            )
            raise SceneError(f"The run has no state to go on from: {lost}.")
        return self._last.remembering(self.controllers)

    @property
    def display_units(self) -> Mapping[str, str]:
        """Units of reports and figures of this run, as {SI unit: unit that was typed}."""
        return self.run.display_units

    @property
    def accuracy(self) -> float:
        """Accuracy that was requested: target for the global error [1]."""
        return self.run.accuracy

    @cached_property
    def events(self) -> list[Event]:  # type: ignore[override]
        """Every switch of every contact or other element, as a list of `Event` (time, element, modes before and after)
        in order of time.

        If several frictions act on the same slip, they switch at the same instant, and each of them has its own event.
        The auxiliary element that gives the direction of a friction in two directions has no events here.
        """
        found = [event for event, _ in self._switches()]
        if self.program.system.shared_modes:
            found = sorted(
                found + [event for name in self.program.system.shared_modes for event in self._events_of(name)], key=lambda e: e.time
            )
        return found

    def _events_of(self, element: str) -> list[Event]:
        place, legend = self.program.system.element_modes(element)
        if place == self._elements.index(element):
            return [event for event, _ in self._switches(place)]
        own = self._event_arrays[1] == place
        times, modes = self._event_arrays[0][own], self._event_arrays[2][own]
        return [Event(float(t), element, legend[int(b)], legend[int(a)]) for t, (b, a, _) in zip(times, modes, strict=True)]

    def _switches(self, place: int | None = None) -> list[tuple[Event, bool]]:
        """Every switch, or those of the element at a place, and whether other modes were consistent with the forces, too."""
        elements = self.program.system.elements
        times, index, modes = self._event_arrays
        if place is not None:
            times, index, modes = (array[self._event_arrays[1] == place] for array in self._event_arrays)
        return [
            (Event(float(t), elements[i].name, elements[i].mode_names[int(b)], elements[i].mode_names[int(a)]), bool(other))
            for t, i, (b, a, other) in zip(times, index, modes, strict=True)
            if not elements[i].second
        ]

    @property
    def ambiguous_events(self) -> list[Event]:
        """List of the events at which more than one choice of modes was consistent with the forces.

        If several contacts hold each other and the static friction is above the kinetic friction, Coulomb's law is not
        unique. It does not determine whether an arriving contact sticks, or which contact at its limit breaks away
        first. At such an event the run continues with as many contacts in stick as possible. A different choice would
        lead to a different motion.
        """
        return [event for event, other in self._switches() if other]

    @property
    def contacts(self) -> list[str]:
        """Names of the elements with a friction law, such as "bit"."""
        return [element.name for element in self.program.system.elements if element.law is not None]

    @property
    def main_signals(self) -> list[str]:
        """Names of the most important signals, which a plot shows: first speeds, then driving and resisting forces or torques."""
        from toolbox.simulation.main_signals import main_signals

        return main_signals(self)

    @property
    def signal_limits(self) -> dict[str, tuple[float | None, float | None]]:
        """Physical limits that drives and controllers enforce on signals, as {signal: (lowest, highest)} in SI. None
        means no limit in this direction.
        """
        found: dict[str, tuple[float | None, float | None]] = {}
        for part in (*self.run.system.parts, *self.run.controllers):
            for name, (low, high) in getattr(law_of(part), "signal_limits", {}).items():
                lowest, highest = found.get(name, (None, None))
                lows, highs = ([end for end in ends if end is not None] for ends in ((low, lowest), (high, highest)))
                found[name] = (max(lows, default=None), min(highs, default=None))
        return found

    def impact_speeds(self, element: str) -> FloatArray:
        """Return the approach speeds at the impacts of a unilateral contact [m/s], in the order of its events, shape (n,).

        Parameters
        ----------
        element
            Name of the unilateral contact.

        Raises
        ------
        SceneError
            If the element is no unilateral contact.
        """
        elements = {each.name: each for each in self.program.system.elements if each.has_gap}
        if element not in elements:
            raise SceneError(f"There is no unilateral contact `{element}`: {suggest(element, elements)}")
        nodes = self.every_step
        times = np.array([event.time for event in self.events if event.element == element and event.before == "open"])
        before = np.searchsorted(nodes.time, times, side="left")  # of the two nodes at an event the first is what was
        rows: Samples[Any] = Samples(
            nodes.program, times, nodes.states[before], nodes.mode[before], nodes.held[before], nodes.parameters, False
        )
        return rows.computed(ca.SX(elements[element].rate))

    @property
    def _legends(self) -> dict[str, dict[int, str]]:
        return {element.name: element.mode_names for element in self.program.system.elements}

    def _no_element(self, name: str) -> SceneError:
        return self.program.system.unknown_element_error(name)

    def _at_last(self, element: str) -> str:
        place, legend = self.program.system.element_modes(element)
        return legend[int(self._last_mode[place])]

    def interpolated(self, row: np.ndarray, times: np.ndarray, single: bool = False) -> Samples[Any]:
        """Return all signals at times within the recorded steps.

        If a step ends with a switch, the value at its end is the value before the switch.

        Parameters
        ----------
        row
            For each time, the index of the recorded time at which its step begins.
        times
            Times [s], in the shape of `row`.
        single
            Whether to return the values of a single time instead of arrays, by default False.
        """
        following = np.minimum(row + 1, self.time.size - 1)
        ends = (times == self.time[following]) & (row < following)
        known = np.where(ends, following, row)
        within = times != self.time[known]
        states = self.states[known]
        if within.any():
            states[within] = self._between(times[within], row[within])
        return Samples(self.program, times, states, self.mode[row], self.held[row], self.parameters, single)

    def _between(self, times: np.ndarray, row: np.ndarray) -> np.ndarray:
        """States at times within the recorded steps that begin at the nodes `row`."""
        return states_between(self, times, row)

    @property
    def every_step(self) -> Trajectory:
        """The same run with every step recorded. If every step is recorded already, this is the run itself. Otherwise the steps are computed again."""
        found = self.restart_nodes
        return found._with_passed_steps if found.passed.size else found

    @cached_property
    def _with_passed_steps(self) -> Trajectory:
        """The run at its nodes and at the steps between them that are not recorded."""
        places, row = np.searchsorted(self.time, self.passed), np.searchsorted(self.time, self.passed, side="right") - 1
        inside = self.interpolated(row, self.passed)
        names = ("time", "states", "mode", "held")
        whole = {name: np.insert(getattr(self, name), places, getattr(inside, name), axis=0) for name in names}
        return _trajectory_again(type(self), self.program.formulas, {**self._told(), **whole, "passed": np.empty(0)})

    @property
    def restart_nodes(self) -> Trajectory:
        """The same run recorded at steps instead of output times, so that any state can be computed by one step from a recorded state.

        If no output times were given, this is the run itself. It is not kept in the run then: a run that holds itself stays in memory.
        """
        return self if self.run.output_times is None else self._at_steps

    @cached_property
    def _at_steps(self) -> Trajectory:
        """The run with output times, carried out once more and recorded at its steps."""
        laws = [Replay(answers) for answers in self.answers]  # what a Python law answered is repeated, not asked again
        start = replace(self.run.start, controllers=())
        budget = UNHURRIED  # as far, however long it takes
        if self.end < self.run.end:
            budget = Budget(steps=max(sum(self.steps), 1), events=self.run.budget.events)
        try:
            return self.run.again(output_times=None, controllers=laws, budget=budget, start=start)
        except SimulationError as failed:  # a run that failed once fails again, and is as far as it goes
            return failed.run

    @cached_property
    def error_estimate(self) -> float:
        """Estimated error of the run: the largest difference between a state of this run and of a second run with accuracy/100.

        The difference is relative to the size of the state over the run, with two exceptions.

        - A state that is below 1e-10 of the largest state with the same unit is round-off, such as a vibration mode
          that nothing moves. It is compared with the largest state of this unit. States with different units are never
          compared. A twist that is small beside large speeds therefore counts with its own size, because the torque of
          the string follows from it.
        - At an impact a state jumps, and the two runs jump at slightly different times. The runs are compared outside
          the time between the two jumps. The length of this time, as a fraction of the duration, counts as a
          difference, too.
        """
        longest = self.run.longest_step / 5.3
        if self.program.system.updates:  # where samples set the steps, another accuracy alone would repeat them, and their error
            longest = min(longest, float(np.diff(self.every_step.time).max(initial=np.inf if self.every_step.time.size < 2 else 0.0)) / 1.9)
        finer = {"accuracy": self.accuracy / 100, "method": EventExact(), "output_times": None, "longest_step": longest}
        return self.difference(self.run.again(**finer, duration=min(self.end, self.run.end) - self.begin, budget=UNHURRIED))

    def difference(self, better: Trajectory) -> float:
        """Compute the largest relative difference of a state between this run and another run of the same plant.

        Return the largest difference as a fraction of the size of the state. Impacts are treated as in
        `error_estimate`.

        Parameters
        ----------
        better
            The other run, usually with a smaller error.
        """
        if not isinstance(better, Trajectory):
            raise SceneError(f"Argument `better` must be a trajectory, as `simulate` returns it, but it is {short(better)}.")
        nodes = self.every_step
        times = nodes.time
        if not self.program.system.updates:  # between samples, which are many, the largest difference is that at one of them
            times = np.concatenate([times, 0.5 * (times[1:] + times[:-1])])
        times = np.unique(times)
        times = times[times <= min(nodes.end, better.end)]
        late = 0.0
        if any(element.rigid for element in self.program.system.elements):
            times, late = outside_jumps(times, nodes, better)
        mine, theirs = nodes.at(times).states, better.at(times).states
        size = np.abs(theirs).max(axis=0, initial=0.0)
        groups = self.program.groups[: size.size]
        largest = np.zeros(self.program.group_count)
        np.maximum.at(largest, groups, size)
        floor = np.where(size < ROUND_OFF * largest[groups], largest[groups], 1e-14)
        size[size > 0] = np.maximum(size, floor)[size > 0]
        difference = np.abs(mine - theirs).max(axis=0, initial=0.0)
        return float(np.max(difference[size > 0] / size[size > 0], initial=late))

    @property
    def _blur(self) -> float:
        """Time about an impact within which states are not comparable [s]."""
        return 1e-12 * (self.end - self.begin)

    @property
    def _setting(self) -> str:
        """What decided how exact the run is."""
        return f"accuracy asked {self.accuracy:g}"

    def _jumps(self, least: float) -> np.ndarray:
        """Times at which states jump by more than a hundredth of the part `least` of their size: smaller jumps may count as a difference of states."""
        change = np.abs(np.diff(self.states, axis=0)) / np.maximum(np.abs(self.states).max(axis=0), 1e-300)
        return self.time[1:][(np.diff(self.time) == 0.0) & (change.max(axis=1) > 0.01 * least)]

    def save(self, path: str | Path, signals: Sequence[str] | None = None) -> Path:
        """Write signals, modes and events to an npz file (without pickle), which `Trajectory.load` reads.

        The file contains the records, and for each step a polynomial for each signal. The deviation of the polynomial
        from `run.at`, relative to the size of the signal, is at most the smaller of 1e-10 and 1e-4 times the accuracy
        of the run, but not below 1e-12. The file is written atomically. `toolbox.simulation.saved_run` describes its
        keys.

        Parameters
        ----------
        path
            Path of the file.
        signals
            Names of the signals to write. By default all.

        Returns
        -------
        Path
            The path of the file.

        Raises
        ------
        SceneError
            If a signal is unknown.
        """
        from toolbox.simulation.saved_run import write

        for name in signals or ():
            self.unit(name)  # which says so if there is none
        return write(self, Path(path), signals)

    @staticmethod
    def load(path: str | Path) -> SavedRun:
        """Read a run from a file that `Trajectory.save` has written.

        Plots, metrics, comparisons and tables work with this run as with the result of `simulate`.

        Parameters
        ----------
        path
            Path of the file.

        Raises
        ------
        SceneError
            If the file is missing or is no file of `Trajectory.save`."""
        return SavedRun.read(Path(path))

    def __repr__(self) -> str:
        return f"Trajectory({self.duration:g} s, {self.time.size} times, {len(self.events)} events)"

    @property
    def _headlines(self) -> list[str]:
        names = [*(kind_of(law_of(part)) for part in self.run.plant.parts), *(kind_of(law) for law in self.run.loop.controllers)]
        took = "" if math.isnan(self.wall_time) else f" in {1e3 * self.wall_time:.3g} ms"
        lines = [
            f"{type(self).__name__} of {', '.join(names)}",
            f"{self.duration:g} s{took}: {self.steps[0]} steps, {self.steps[1]} rejected, {len(self.events)} events",
            self._setting
            + (f", error {self.error_estimate:.1e}" if "error_estimate" in self.__dict__ else ", error: ask `run.error_estimate`"),
        ]
        if self.why:
            lines.append(self.why)
        if self.ambiguous_events:
            lines.append(f"{len(self.ambiguous_events)} switches at which other modes were consistent, too: see `run.ambiguous_events`")
        if self.merged:
            lines.append(f"{self.merged} touches without a change of mode")
        return lines

    def _ranges(self) -> list[tuple[str, float, float, float, str]]:
        memories = {name for update in self.program.system.updates for name in update.places}
        return [row for row in super()._ranges() if row[0] not in memories]


class Stepped(Trajectory):
    """Result of time stepping: between its nodes states are interpolated linearly, and an event bears the time of the node at the end of its step.

    `run.step` is the length of a step [s], and `run.steps` is (steps taken, 0).
    """

    @property
    def _setting(self) -> str:
        return f"time stepping, steps of {self.step:.3g} s"

    @property
    def step(self) -> float:
        """Length of a step [s]."""
        return float(self.run.method.step)

    def _between(self, times: np.ndarray, row: np.ndarray) -> np.ndarray:
        return np.column_stack([np.interp(times, self.time, self.states[:, i]) for i in range(self.states.shape[1])])

    @cached_property
    def error_estimate(self) -> float:
        """Four thirds of the largest difference of a state to a second run with a quarter of the step: the error of a method of order one."""
        return 4.0 / 3.0 * self.difference(self.run.again(method=TimeStepping(self.step / 4), output_times=None))

    @property
    def _blur(self) -> float:
        return 1.5 * self.step

    def _jumps(self, least: float) -> np.ndarray:
        nodes, (times, index, modes) = self.every_step, self._event_arrays
        rigid = np.array([element.rigid for element in self.program.system.elements])
        times = np.unique(times[rigid[index] & (modes[:, 0] == 1)])
        row = np.searchsorted(nodes.time, times)
        change = np.abs(nodes.states[row] - nodes.states[row - 1]) / np.maximum(np.abs(nodes.states).max(axis=0), 1e-300)
        return times[change.max(axis=1, initial=0.0) > max(least, 1e-3)]


class Smoothed(Trajectory):
    """Result of a run with smoothed friction: contacts are in mode "stick" while they creep, else in "slip"; `run.widths` {element: width} says how smooth."""

    @property
    def _setting(self) -> str:
        return "smoothed, width " + ", ".join(f"{width:.3g} ({name})" for name, width in self.widths.items())

    @property
    def widths(self) -> dict[str, float]:
        """Width of each smoothed element, in the unit of its slip."""
        return dict(self.run.method.width)

    @cached_property
    def error_estimate(self) -> float:
        """Difference to the set-valued law: 5/3 of the largest difference of a state to a second run with a quarter of the width and of the tolerance.

        5/3 belongs to an error that falls with the width to the power 2/3, as the passage of a peak makes it; where it falls in proportion it is 4/3.
        """
        finer = Smoothing({name: width / 4 for name, width in self.widths.items()}, self.run.method.tolerance / 4)
        return 5.0 / 3.0 * self.difference(self.run.again(system=self.run.system.sharp, method=finer, output_times=None))


def _trajectory_again(kind: type[Trajectory], formulas: Any, data: dict[str, Any]) -> Trajectory:
    """A trajectory from what `Trajectory.__reduce__` gives."""
    run, why = data.pop("run"), data.pop("why")
    return kind(run=run, program=program_of(run.system, run.kinds, formulas), records=Records(**data), why=why)
