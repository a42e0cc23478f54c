"""The table that answers the user's question: does each controller end stick-slip on this plant, from which start, and from which set-point on?

Every column names its start, because a controller can end the stick-slip of another one and yet begin to stick after a start from rest, or keep a stick-slip
of its own that few starts reach. All columns are judged alike: a run holds if the judge of `toolbox.measuring.judge` finds that it comes to smooth running,
however long that takes; a run that no judge can tell holds if its contact does not stick in the last 30 % of it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from toolbox.arguments import mapping, number, numbers
from toolbox.drilling.answer_results import RAMP, STARTS, Answers, ControllerAnswer, Counted
from toolbox.drilling.connection import WEIGHT, AfterConnection
from toolbox.drilling.set_points import limits_of
from toolbox.errors import SceneError, SimulationError
from toolbox.files.journal import Journal, fingerprint
from toolbox.files.unit_systems import asked_in
from toolbox.files.units import NumberOrText
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.laws import Controller, Sampled
from toolbox.onsets.coming_to import last_change, verdict_on
from toolbox.onsets.onset import onset
from toolbox.robustness.starts import FromRest, OwnStickSlip, Start, TakenOver
from toolbox.robustness.worst_case import Trials, cases_of
from toolbox.scenes.judged import judged_contact, judged_speed, set_point
from toolbox.scenes.situation import Situation
from toolbox.simulation.simulate import simulate

ERRORS = len(STARTS)
"""Number of the question about plants with errors; those about the own stick-slip and the costs follow."""

CONFIRMED = (1, 2, 3, 5, 8, 13, 21, 34, 55, 89, 144)
"""Steps above a border at which it is confirmed: a start may fail again far above the lowest set-point that it holds."""

PEAKS = ("top_peak", "bit_peak", "torque_peak")
"""Costs of the takeovers."""


def answers(
    loops: Mapping[str, ClosedLoop],
    initial_controller: Controller | Sampled,
    *,
    bounds: tuple[NumberOrText, NumberOrText] | None = None,
    step: NumberOrText | None = None,
    uncertainty: Mapping[str, Any] | None = None,
    phases: int = 4,
    duration: NumberOrText = 200.0,
    title: str = "",
    checkpoint: str | Path | None = None,
    callback: Callable[[Answers], None] | None = None,
) -> Answers:
    """Find for each controller of a plant whether the controller ends stick-slip, for several starts, and above a lowest set-point.

    Each controller is designed once, at the set-point of its loop. Its gains stay the same at all other set-points. At
    the set-point of the loop it is tested from these starts:

    - it takes over the stick-slip of the initial controller;
    - it starts the string from rest, by a step and by a ramp of the set-point;
    - it runs through a connection: the weight is taken off, stays off for 90 s, and returns within 10, 20 or 60 s;
    - it runs from its own stick-slip, which is searched from many start values.

    With `bounds` the lowest successful set-point is searched for each of these starts.

    Parameters
    ----------
    loops
        {label: loop} of one plant with different controllers.
    initial_controller
        The controller whose stick-slip the judged controllers take over, such as `StiffPI()`.
    bounds, step
        Range (low, high) of set-points in which the lowest set-point is searched, and distance of neighbouring
        set-points, in SI or text with units. By default there is no search. With `bounds` the step is by default 1/40
        of the range.
    uncertainty
        {number of the loop: error}. An error is a percentage to either side, such as "10 %", or several factors of the
        value, such as (0.8, 1.2). By default 10 % of the weight on bit to either side, if the plant has a weight on
        bit.
    phases
        Number of instants of the stick-slip cycle at which a controller takes over, by default 4.
    duration
        Shortest length of a run [s], by default 200. A run whose outcome is not decided at this time is continued.
    title
        Name of the plant in the tables, by default empty.
    checkpoint
        Path of a file (JSON lines) for the outcomes of single set-points. A search that was stopped continues from this
        file. By default None: nothing is stored.
    callback
        Function that is called with the answers so far, by default none: for each controller once before and once after
        the search of its lowest set-points.

    Returns
    -------
    Answers
        Verdicts, lowest set-points and costs of each controller.

    Raises
    ------
    SceneError
        If a loop has no set-point, `bounds` is no range, no loop is given, or `checkpoint` belongs to a search with
        other arguments.

    Examples
    --------
    >>> from controllers import SoftTorque, StiffPI
    >>> from models import BitRock, wells
    >>> from toolbox import Sampled, closed_loop, compose
    >>> from toolbox.drilling import answers
    >>> rig = compose(wells.JANSEN_2, BitRock(weight="97 kN"))
    >>> loop = closed_loop(rig, Sampled(SoftTorque(reference="9 rad/s", lowest_torque=0.0), "10 ms", delay="30 ms"))
    >>> found = answers({"soft torque": loop}, StiffPI(), phases=2)
    >>> found["soft torque"].starts["takeover"].passed
    True
    """
    if not isinstance(loops, Mapping) or not loops:
        raise SceneError(f"Argument `loops` must map at least one label to a loop, but it is {loops!r}.")
    first = next(iter(loops.values()))
    name = knob_of(first)
    free = first.number(name)
    low, high = (math.nan, math.nan) if bounds is None else free.span(bounds, "bounds")
    grid = math.nan if bounds is None else (high - low) / 40.0 if step is None else number("step", step, free.unit, above=0)
    lasts = number("duration", duration, "s", above=0)
    asked = {**first.display_units, **({} if bounds is None else {free.unit: asked_in(numbers("bounds", bounds, free.unit), free.unit)})}
    design = "each controller designed once, at the set-point of the scene, which is turned like a knob"
    situation = Situation.of(first, "", f"{lasts:g} s at least, carried on until the regime is decided", design=design, cases=loops)
    situation = dataclasses.replace(situation, start="started as the head of each column says")
    found = Answers(
        title or first.title, type(getattr(initial_controller, "law", initial_controller)).__name__, free.name, free.unit, free.value, (low, high), grid,
        {}, {}, str(situation), asked,
    )  # fmt: skip
    journal = None if checkpoint is None else _journal(Path(checkpoint), loops, initial_controller, phases, lasts, uncertainty)
    questions: dict[str, Question] = {}
    for k, (label, loop) in enumerate(loops.items()):
        try:
            questions[label] = Question(loop, knob_of(loop), initial_controller, phases, lasts, k, journal)
            found = _with(found, label, questions[label].at_set_point(uncertainty))
        except (SceneError, SimulationError) as error:
            found = dataclasses.replace(found, failed={**found.failed, label: str(error)})
        if callback is not None:
            callback(found)
    for label in [] if bounds is None else list(found.results):
        try:
            lowest, end = questions[label].lowest(low, high, grid)
            found = _with(found, label, dataclasses.replace(found.results[label], lowest=lowest, own_end=end))
        except (SceneError, SimulationError) as error:
            found = dataclasses.replace(found, failed={**found.failed, label: str(error)})
        if callback is not None:
            callback(found)
    return found


def _with(found: Answers, label: str, entry: ControllerAnswer) -> Answers:
    return dataclasses.replace(found, results={**found.results, label: entry})


def knob_of(loop: ClosedLoop) -> str:
    """The name of the set-point of a loop. Raises SceneError if there is none."""
    name = set_point(loop.system, judged_speed(loop, judged_contact(loop)))
    if name is None:
        raise SceneError("Argument `loops` must hold loops with a set-point, such as `top.reference`, but one has none.")
    return name


@dataclass(frozen=True)
class Question:
    """One controller: its loop, the set-point that is turned, and the runs that are asked."""

    loop: ClosedLoop
    knob: str
    initial: Controller | Sampled
    phases: int
    duration: float
    place: int = 0
    journal: Journal | None = None
    known: dict[tuple[float | None, ...], Any] = field(default_factory=dict, compare=False)
    taken: dict[float, tuple[list[ClosedLoop], str]] = field(default_factory=dict, compare=False)

    @cached_property
    def contact(self) -> str:
        return judged_contact(self.loop)

    @cached_property
    def speed(self) -> str:
        return judged_speed(self.loop, self.contact)

    def at_set_point(self, uncertainty: Mapping[str, Any] | None) -> ControllerAnswer:
        """The answers at the set-point of the loop."""
        value = float(self.loop.number(self.knob).value)
        starts = {name: self.counted(name, value) for name in STARTS}
        own = float(self._kept(ERRORS + 1, value, lambda: [OwnStickSlip(1).on(self.loop).period])[0])
        errors = Counted(*self._kept(ERRORS, value, lambda: self._errors(uncertainty)))
        peaks = dict(zip(PEAKS, self._kept(ERRORS + 2, value, lambda: self._peaks(value)), strict=True))
        limits = [abs(limit) for law in self.loop.designed_controllers for limit in limits_of(law).values()]
        return ControllerAnswer(starts, errors, own, torque_limit=max(limits, default=math.nan) or math.nan, **peaks)

    def counted(self, start: str, value: float) -> Counted:
        """How many runs from a kind of start hold at a set-point."""

        def found() -> list[Any]:
            loops, note = self._loops(start, self.loop.at(self.knob, value), value)
            said = [self._fails(loop) for loop in loops]
            why = next((each for each in said if each), "")
            return [sum(not each for each in said), len(said), f"{note}; {why}" if note and why else note or why]

        return Counted(*self._kept(STARTS.index(start), value, found))

    def _kept(self, question: int, value: float, find: Callable[[], list[Any]]) -> list[Any]:
        """What was found for a question at a set-point: once, and from the checkpoint where that knows it."""
        key = (float(self.place), float(question), float(value))
        known = self.known if self.journal is None else self.journal.known
        if key not in known:
            result = find()
            if self.journal is None:
                self.known[key] = result
            else:
                self.journal.add(key, result)
        return known[key]

    def start_of(self, start: str) -> Start:
        """The start of a column."""
        if start == "takeover":
            return TakenOver(self.initial, self.phases)
        return AfterConnection() if start == "connection" else FromRest(RAMP if start == "ramp" else 0.0)

    def _loops(self, start: str, loop: ClosedLoop, value: float) -> tuple[list[ClosedLoop], str]:
        """The loops whose runs are judged from a kind of start, and a note if there is no stick-slip, or nothing, to start from.

        Without stick-slip of the initial controller, its run is taken over as it is at its end: the judged controller may still begin to stick.
        """
        if start == "takeover":
            if value not in self.taken:  # the initial controller runs once for each set-point
                found = self.start_of(start).on(loop)
                self.taken[value] = found.loops(loop), "no stick-slip to end" if found.note else ""
            return self.taken[value]
        try:
            return self.start_of(start).on(loop).loops(loop), ""
        except SceneError:
            if start == "connection":  # a plant without a weight has none
                return [], "-"
            raise

    def _fails(self, loop: ClosedLoop) -> str:
        """Why a run does not come to smooth running; empty if it does."""
        end = last_change(loop)
        try:
            run = simulate(loop, end + self.duration)
        except SimulationError as error:
            return str(error)
        words, _ = verdict_on(run, self.contact, self.speed, end + 0.5 * self.duration)
        return f"{words}: {words.reason}" if words.failed else ""

    def _errors(self, uncertainty: Mapping[str, Any] | None) -> list[Any]:
        """(held, runs, why) of takeovers on plants with one number wrong at a time, the nominal one left out."""
        wanted = (
            ({WEIGHT: "10 %"} if WEIGHT in self.loop.variable_numbers() else {})
            if uncertainty is None
            else mapping("uncertainty", uncertainty)
        )
        trials = Trials.of(self.loop, self.duration, starts=TakenOver(self.initial, self.phases), after=None)
        held, runs, why = 0, 0, ""
        for error, factors in cases_of(wanted, ()).items():
            if not factors:
                continue
            machine = trials.machine(factors)
            for begun in trials.starts(error, factors).loops(machine):
                said = self._fails(begun)
                held, runs, why = held + (not said), runs + 1, why or (said and f"{error}: {said}")
        return [held, runs, why]

    def _peaks(self, value: float) -> list[float]:
        """The largest speeds and command of the takeovers, in the order of `PEAKS`."""
        peaks = dict.fromkeys(PEAKS, math.nan)
        commands = [name for name in self.loop.plant.inputs if name not in self.loop.system.inputs]
        signals = {"top_peak": "top.speed", "bit_peak": self.speed, "torque_peak": commands[0] if commands else ""}
        for loop in self._loops("takeover", self.loop.at(self.knob, value), value)[0]:
            run = simulate(loop, self.duration)
            for peak, signal in signals.items():
                if signal and loop.system.has_signal(signal):
                    peaks[peak] = float(np.fmax(peaks[peak], np.abs(run[signal]).max()))
        return list(peaks.values())

    def lowest(self, low: float, high: float, step: float) -> tuple[dict[str, float], float]:
        """({start: lowest set-point from which on every one that was tried holds}, set-point at which the own stick-slip ends)."""
        found = {name: self.lowest_from(name, low, high, step) for name in STARTS if self.counted(name, high).runs or name == "takeover"}
        return found, float(self._kept(ERRORS + 3, high, lambda: [self._own_end(low, high)])[0])

    def _own_end(self, low: float, high: float) -> float:
        """The set-point at which the loop's own stick-slip ends; nan if it has none in the range, inf if it lasts to its end."""
        borders = onset(self.loop, self.knob, (low, high), num_values=9)
        return math.inf if borders.cycling[-1] else max((border.value for border in borders.ends), default=math.nan)

    def lowest_from(self, start: str, low: float, high: float, step: float) -> float:
        """The lowest set-point on the grid by bisection, confirmed at `CONFIRMED` steps above it; nan if the highest fails."""

        def holds(k: int) -> bool:
            return self.counted(start, low + k * step).passed

        bottom, top = -1, int((high - low) / step + 1e-9)
        if not holds(top):
            return math.nan
        while True:
            upper = top
            while upper - bottom > 1:
                middle = (bottom + upper) // 2
                bottom, upper = (bottom, middle) if holds(middle) else (middle, upper)
            broken = [upper + steps for steps in CONFIRMED if upper + steps <= top and not holds(upper + steps)]
            if not broken:
                return low + upper * step
            bottom = broken[-1]


def _journal(
    path: Path, loops: Mapping[str, ClosedLoop], initial: Any, phases: int, duration: float, uncertainty: Mapping[str, Any] | None
) -> Journal:
    """The checkpoint of a search with these arguments."""
    told = {
        label: fingerprint((loop.plant.parts, loop.controllers, dict(loop.inputs), dict(loop.parameters))) for label, loop in loops.items()
    }
    others = {
        "initial controller": fingerprint(initial),
        "phases": str(phases),
        "duration": repr(duration),
        "uncertainty": fingerprint(uncertainty),
    }
    return Journal(path, told | others, lambda result: isinstance(result, list), "checkpoint")
