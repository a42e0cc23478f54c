"""What a simulation is asked: one value, made once, checked once, and handed on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import FunctionType
from typing import Any

import numpy as np

from toolbox.arguments import finite_array, number
from toolbox.errors import SceneError
from toolbox.modelling.clocks import Clock
from toolbox.modelling.closed_loop import ClosedLoop, states_of, value_at
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.regularisation import SmoothSystem, checked_widths
from toolbox.modelling.two_directions import check_one_direction
from toolbox.simulation.budget import UNHURRIED
from toolbox.simulation.carry_out import carry_out
from toolbox.simulation.methods import Method, Smoothing, TimeStepping, method_of
from toolbox.simulation.run import Run
from toolbox.simulation.run_state import RunState
from toolbox.simulation.samples import Samples
from toolbox.simulation.work_arrays import closures


def accuracy_of(loop: ClosedLoop, given: float | None = None) -> float:
    """Return the accuracy of a run of a loop: the given accuracy, else the accuracy of its scene, else 1e-6."""
    return next(each for each in (given, loop.accuracy, 1e-6) if each is not None)


@dataclass(frozen=True)
class Request:
    """Arguments of `simulate`: a loop, and the options of its run."""

    loop: ClosedLoop
    duration: float | str
    start: Samples | RunState | None = None
    method: Method | str = "event"
    accuracy: float = 1e-6
    output_times: Sequence[float] | np.ndarray | None = None

    def checked(self) -> Run:
        """The run that is asked for, with all names resolved; raises SceneError as `simulate` does."""
        duration = number("duration", self.duration, "s", at_least=0)
        accuracy = number("accuracy", self.accuracy, at_least=1e-13, at_most=0.1)
        method = method_of(self.method)
        method.check(duration)
        budget, method = method.budget, method.unhurried
        loop, start = self.loop, self.start
        closed, system = loop.assembly, loop.assembly.system
        if budget == UNHURRIED:
            _check_samples(closed.clocks, duration)
        grid = _checked_times(self.output_times, start.time if isinstance(start, RunState) else 0.0, duration)
        if isinstance(start, RunState):
            start.check(system, closed.clocks, closed.callables)
            begin = start
        else:
            states = dict(loop.start)
            if start is not None:
                states = states_of(start, loop.plant) | _remembered(start, system, closed.clocks, closed.callables)
            begin = RunState.begun(system, closed.plant, closed.clocks, states)
            if isinstance(start, Samples):
                begin = _with_modes(begin, system, start)
        if isinstance(method, TimeStepping):
            check_one_direction(
                system.elements, f"`method={method.text!r}`", "locate its events, by 'event', or give a ContactProblem to `step_contacts`"
            )
        if isinstance(method, Smoothing):
            if isinstance(closed.plant, SmoothSystem):
                raise SceneError("Argument `method` must not be 'smoothed' for a plant that is smooth already.")
            widths = checked_widths(system, 1.0 if method.width is None else method.width)
            if method.width is not None:
                method = Smoothing(widths, method.tolerance)
        return Run(
            plant=closed.plant, system=loop.system, duration=duration, start=begin, inputs=loop.input_values, kinds=loop.input_kinds, clocks=closed.clocks,
            controllers=closed.callables, accuracy=accuracy, output_times=grid, longest_step=duration / 256, seeds=closed.seeds, method=method,
            budget=budget, solver=carry_out, loop=loop,
        )  # fmt: skip


MOST_SAMPLES = 1e10
"""Samples of a law in one run, far beyond the steps of any budget that nobody chose; more are a slip of the unit."""


def _check_samples(clocks: Sequence[Clock], duration: float) -> None:
    """Raise SceneError where a law would sample beyond count in a run that no budget ends."""
    period = min([clock.period for clock in clocks], default=math.inf)
    if duration / period > MOST_SAMPLES:
        raise SceneError(
            f"Argument `sample_time` must be at least {duration / MOST_SAMPLES:.3g} s in a run of {duration:g} s, which is {MOST_SAMPLES:g} samples, but it is "
            f"{period:g} s."
        )


def _checked_times(given: Any, begin: float, duration: float) -> np.ndarray | None:
    """The output times, shape (nt,), of a run that begins at a time and lasts so long; None where every step is recorded."""
    if given is None:
        return None
    grid = finite_array(given)
    if grid is None or grid.ndim != 1 or not grid.size or (np.diff(grid) <= 0).any() or grid[0] < begin or grid[-1] > begin + duration:
        raise SceneError(
            f"Argument `output_times` must be increasing times between {begin:g} and {begin + duration:g} s, but {_wrong_with(grid, begin)}."
        )
    return grid


def _wrong_with(grid: np.ndarray | None, begin: float) -> str:
    """What is wrong with output times."""
    if grid is None or grid.ndim != 1 or not grid.size:
        return "they are " + ("no finite numbers" if grid is None else f"an array of shape {grid.shape}")
    late = np.flatnonzero(np.diff(grid) <= 0)
    if late.size:
        before, after = grid[late[0] : late[0] + 2].tolist()
        return f"{before!r} s is followed by {after!r} s"
    return f"they begin at {grid[0]:g} s" if grid[0] < begin else f"they end at {float(grid[-1])!r} s"


def _with_modes(begin: RunState, system: HybridSystem, instant: Samples) -> RunState:
    """Return a state with the modes that the elements had at an instant of a run, if that run had the same elements."""
    before = instant.program.system
    if [element.name for element in before.elements] != [element.name for element in system.elements]:
        return begin
    p = np.concatenate([instant._constants, instant.held[0]])
    gaps = closures(instant.program, float(instant.time[0]), instant.states[0].copy(), p) if any(e.rigid for e in before.elements) else None
    return replace(begin, modes=instant.mode[0].copy(), closures=gaps)


def _remembered(instant: Samples, system: HybridSystem, clocks: Sequence[Clock], laws: Sequence[Any]) -> dict[str, Any]:
    """What continuous laws remember at an instant of a run, by state.

    Raises SceneError where sampled laws of that run, and of the one that is to begin there, remember something: the record of a run does not hold it.
    """
    before = instant.program.system
    remember = any(update.memory.numel() for update in system.updates) or any(clock.delay > 0.0 for clock in clocks)
    if before.updates and (remember or not all(isinstance(law, FunctionType) for law in laws)):
        raise SceneError(
            "Argument `start` must be `run.last` for a run to go on where its laws are sampled, because an instant such as `run.at(12.5)` does not "
            "hold what they remember: end the run there. Where the laws shall begin anew, give the states by name, `{name: run.at(12.5)[name] for "
            "name in plant.states}`."
        )
    return {name: value_at(instant, name, size) for name, (_, size, _) in system.states.items() if name in before.states}
