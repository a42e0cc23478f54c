"""Many runs that differ in numbers alone: compiled once, run one after the other in one set of arrays, or many at once in lanes, measured as they go.

`finished(task)` is all that a worker does, whether it is a thread, a process or another machine: a task holds parts, laws and numbers, never an
address of machine code, which every process makes or loads for itself.
"""

from __future__ import annotations

import dataclasses
import threading
import time as clock
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.arguments import count_of
from toolbox.compilation import work_layout
from toolbox.compilation.program import program_of
from toolbox.compilation.runge_kutta import DOP853
from toolbox.errors import SimulationError
from toolbox.measuring.metrics import Metric
from toolbox.measuring.readings import RunningMeasures
from toolbox.modelling.clocks import Clock
from toolbox.modelling.inputs import Shape
from toolbox.modelling.laws import Sampled
from toolbox.modelling.number_kinds import clock_path, clock_prefixes
from toolbox.modelling.numbers import Number
from toolbox.simulation.budget import UNHURRIED
from toolbox.simulation.carry_out import carry_out, compiled_loop, formulas_of
from toolbox.simulation.failures import exhausted, failure
from toolbox.simulation.run import Run
from toolbox.simulation.work_arrays import clock_keys, limited, noise_keys, work_arrays
from toolbox.steady_states.equilibria import state_values


@dataclass(frozen=True)
class Numbers:
    """Numbers of n runs that differ in few columns: `np.asarray(numbers)` gives the full array, shape (n, columns), when it is needed.

    same: what they share, shape (columns,);  places: which columns vary;  points: what stands there, shape (n, places).
    """

    same: np.ndarray
    places: Sequence[int]
    points: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, rows: slice) -> Numbers:
        return Numbers(self.same, self.places, self.points[rows])

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        found = np.repeat(self.same[None, :], len(self.points), axis=0)
        found[:, self.places] = self.points
        return found


@dataclass(frozen=True)
class Task:
    """n runs of one closed loop.

    run: everything they share;  numbers: parameters and coefficients of inputs, shape (n, first_held) in the layout of `Program`;  starts: shape (n,
    states), None for that of `run`;  clocks: fields of `Clock` of the sampled controllers, shape (n, controllers, fields), None for those of `run`;
    memories: of the sampled laws, shape (n, m);  held: signals held at the start, shape (n, h), None for those of `run`;  seeds: of the noise of each
    sampled law, shape (n, laws), None for those of `run`;
    measures: read by a `RunningMeasures`, all from trajectories where one has no compiled form;
    first: index of the first run among all;  lanes: whether the runs are to step side by side.
    """

    run: Run
    numbers: np.ndarray | Numbers
    metrics: tuple[Metric, ...]
    starts: np.ndarray | None = None
    memories: np.ndarray | None = None
    held: np.ndarray | None = None
    seeds: np.ndarray | None = None
    clocks: np.ndarray | None = None
    first: int = 0
    lanes: bool = False

    def chosen(self, rows: Any) -> Task:
        """The task of some of the runs, by a slice or their numbers."""
        cut: dict[str, Any] = {
            name: None if (array := getattr(self, name)) is None else array[rows]
            for name in ("numbers", "starts", "memories", "held", "seeds", "clocks")
        }
        return dataclasses.replace(self, **cut)

    def part(self, rows: slice) -> Task:
        """The task of some of the runs, which keep their places among all."""
        return dataclasses.replace(self.chosen(rows), first=self.first + rows.start)


@dataclass(frozen=True)
class Outcome:
    """Results of n runs: values of the metrics, shape (n, metrics), nan for a failed run, reasons of failures by index among all runs,
    seconds and steps."""

    first: int
    values: np.ndarray
    errors: dict[int, str]
    seconds: float
    steps: int = 0


def finished(task: Task) -> Outcome:
    """Run a task. Failures are recorded, not raised; an exception of a law or a measure in Python is one too."""
    began = clock.perf_counter()
    values = np.full((len(task.numbers), len(task.metrics)), np.nan)
    errors: dict[int, str] = {}
    run, steps = task.run, 0
    alone = run.method.alone
    if run.controllers or alone or run.budget.seconds < np.inf or not all(measure.in_loops for measure in task.metrics):
        _one_by_one(task, values, errors, range(len(task.numbers)))
    elif task.lanes:
        _side_by_side(task, values, errors)
    else:
        steps = _in_a_row(task, values, errors)
    return Outcome(task.first, values, errors, clock.perf_counter() - began, steps)


_PREPARING = threading.Lock()
"""Threads that begin together compile once; the symbols of casadi are shared by all of them."""


FEWEST_LANES = 100
"""Runs below which most lanes stand empty."""

LANES_WORK = 1.5e9
"""Instructions of runs one after the other, about a second, that the compilation of a block of lanes is worth."""

ALONE = 75_000
"""Instructions, about 50 microseconds, that a run alone costs besides its steps: arrays cleared, measures read out."""


def pays_in_lanes(task: Task, steps: int) -> bool:
    """Whether a task, of about so many steps per run, can run in vector lanes and is expected to be faster there.

    This is decided from counts, not from timing, so that results do not depend on the machine.
    """
    runs = len(task.numbers)
    return runs >= FEWEST_LANES and runs_in_lanes(task) and runs * work_alone(task, steps) > LANES_WORK


def runs_in_lanes(task: Task) -> bool:
    """Whether a task can run in vector lanes, and is not slower there.

    Lanes take explicit methods, Taylor series among them, and laws in machine code, but no runs that go on from another one, no jitter or missed
    samples, nor friction with two slip directions. They pay where events are settled in lanes, too: not with impacts, nor with friction that loses its
    load; and while the step is a straight line of instructions.
    """
    run = task.run
    clocks = run.clocks if task.clocks is None else [Clock(*task.clocks[:, c].max(axis=0, initial=0.0)) for c in range(len(run.clocks))]
    if not all(clock.regular for clock in clocks):  # lanes count samples by their number alone
        return False
    if not run.method.in_lanes or run.controllers or run.start.carried or run.budget != UNHURRIED:
        return False
    if not all(measure.in_loops for measure in task.metrics) or any(element.directions > 1 for element in run.system.elements):
        return False
    from toolbox.lanes.events import carries_events

    kernel = (program := program_of(run.system, run.kinds, formulas_of(run))).kernel
    return DOP853.written_out(kernel.states) and (not kernel.elements or carries_events(program))


def lanes_of(task: Task) -> int:
    """How many runs of a task step side by side in lanes."""
    from toolbox.lanes.lanes import host_width

    return host_width(program_of(task.run.system, task.run.kinds, formulas_of(task.run)))


def work_alone(task: Task, steps: int) -> float:
    """Instructions, about, of one run of a task with so many steps."""
    return float(steps * program_of(task.run.system, task.run.kinds, formulas_of(task.run)).kernel.cost + ALONE)


def _side_by_side(task: Task, values: np.ndarray, errors: dict[int, str]) -> None:
    """Run a task in lanes; what fails there, or is doubtful, is run again alone, which finds the words for it."""
    from toolbox.lanes.lanes import Lanes

    run, numbers = task.run, np.asarray(task.numbers)
    with _PREPARING:
        lanes = Lanes(with_room(run, task.clocks), task.metrics)
    starts = task.starts
    if starts is None:
        starts = np.tile(lanes.work.x[: run.system.x.numel()], (len(numbers), 1))
    batch = lanes.run(numbers, starts, task.memories, task.held, seeds=task.seeds, clocks=task.clocks)
    values[:] = batch.values
    again = np.flatnonzero((batch.statuses != 0) | batch.doubtful | batch.negative)
    if again.size:
        alone = dataclasses.replace(task, numbers=numbers, starts=starts, first=0).chosen(again)
        rows, found = np.full((len(again), values.shape[1]), np.nan), dict[int, str]()
        _in_a_row(alone, rows, found)
        values[again] = rows
        errors |= {task.first + int(again[i]): text for i, text in found.items()}


def _in_a_row(task: Task, values: np.ndarray, errors: dict[int, str]) -> int:
    """Run a task, one run after the other; returns the steps that were tried."""
    run, tried = task.run, 0
    with _PREPARING:
        program = program_of(run.system, run.kinds, formulas_of(run))
        advance = compiled_loop(run, program)
        readings = RunningMeasures(program, task.metrics, run.end, run.accuracy)
        work = full = work_arrays(with_room(run, task.clocks), program)
    fixed = ("rec_t", "rec_x", "rec_m", "rec_p", "ev_t", "ev_i", "ev_m")
    fresh = [(array, array.copy()) for name, array in zip(work._fields, work, strict=True) if name not in fixed and array.size]
    n, held = run.system.x.numel(), slice(program.held_slot, program.held_slot + run.system.held.numel())
    for i, numbers in enumerate(np.asarray(task.numbers)):
        for array, original in fresh:
            array[...] = original
        work.p[: program.first_held] = numbers
        if task.starts is not None:
            work.x[:n] = task.starts[i]
        if task.memories is not None:
            work.memory[:] = task.memories[i]
        if task.held is not None:
            work.p[held] = task.held[i]
        if task.seeds is not None:
            work.keys[:], work.clock_keys[:] = noise_keys(run.system.updates, task.seeds[i]), clock_keys(task.seeds[i])
        if task.clocks is not None:
            work.clocks[:] = task.clocks[i]
        readings.begin()
        switches = np.zeros(len(run.system.elements), np.int64)  # of each element, in what has been read
        work = full
        while True:
            work.ints[work_layout.BUDGET] = run.budget.steps - int(work.ints[work_layout.ACCEPTED] + work.ints[work_layout.REJECTED])
            status = advance(work)
            if status == work_layout.PAUSED or switches.sum() + work.ints[work_layout.EVENTS] > run.budget.events:
                errors[task.first + i] = str(exhausted(run, program, work, clock.perf_counter(), [], switches))
                break
            if program.formulas.series and status in (work_layout.NO_SERIES, work_layout.UNDERFLOW):
                _one_by_one(task, values, errors, range(i, i + 1))  # by other formulas
                break
            if status not in (work_layout.DONE, work_layout.RECORDS_FULL, work_layout.EVENTS_FULL):
                errors[task.first + i] = str(failure(status, run, program, work, clock.perf_counter(), []))
                break
            if run.budget.events < np.inf:
                switches += np.bincount(work.ev_i[: work.ints[work_layout.EVENTS]], minlength=switches.size)
            readings.read(work, status == work_layout.DONE)
            work = limited(full, program, run.budget, int(switches.sum()))
            if status == work_layout.DONE:
                broken = readings.broken_bound
                if broken is None:
                    values[i] = readings.values()
                else:
                    errors[task.first + i] = broken
                break
        tried += int(work.ints[work_layout.ACCEPTED] + work.ints[work_layout.REJECTED])
    return tried


def with_room(run: Run, clocks: np.ndarray | None) -> Run:
    """Return the run with sample times and delays that reserve enough room for delayed outputs: at least as many are on their way as in any
    run with those clocks."""
    if clocks is None:
        return run
    of_each = [[Clock(*row) for row in rows] for rows in np.swapaxes(clocks, 0, 1).tolist()]
    room = [Clock(min(each.period for each in own), max(each.delay + each.jitter for each in own)) for own in of_each]
    return dataclasses.replace(run, clocks=room)


def single(task: Task, i: int) -> Run:
    """Run i of a task with its own numbers, which its plant and its loop hold, too."""
    base, numbers = task.run, np.asarray(task.numbers[i : i + 1])[0]
    parameters: dict[str, Any] = {}
    for name, entry in base.system.parameters.items():
        own = slice(entry.offset, entry.offset + count_of(entry.size))
        if (numbers[own] != base.system.values[own]).any():
            parameters[name] = numbers[own].tolist()[0] if entry.size is None else numbers[own].copy()
    system = base.system.with_parameters(parameters)
    plant = base.plant.with_parameters({name: value for name, value in parameters.items() if base.plant.has_parameter(name)})
    program = program_of(base.system, base.kinds, formulas_of(base))
    inputs = dict(base.inputs)
    for name, kind in base.kinds:
        slot = program.coefficient_slot.get(name, 0)
        if kind == "number":
            inputs[name] = float(numbers[slot])
        elif isinstance(inputs[name], Shape):
            values = numbers[slot : slot + len(inputs[name].coefficients)].tolist()
            inputs[name] = dataclasses.replace(
                inputs[name], coefficients=tuple(values), numbers=dict(zip(inputs[name].numbers, values, strict=False))
            )
    given = {"states": task.starts, "memory": task.memories, "held": task.held}
    start = dataclasses.replace(base.start, **{name: array[i].copy() for name, array in given.items() if array is not None})
    varied = {name: inputs[name] for name in inputs if inputs[name] is not base.inputs[name]}
    base = base if task.clocks is None else _on_clocks(base, [Clock(*row) for row in task.clocks[i].tolist()])
    start = start.on_clocks(base.clocks)
    clocked = {clock_path(base.loop, index) for index in clock_prefixes(base.loop).values()}  # `Sampled` says what they are
    own_numbers = {name: value for name, value in parameters.items() if name not in clocked}
    loop = base.loop.replace(inputs={**base.loop.inputs, **varied}, parameters={**base.loop.parameters, **own_numbers})
    if task.starts is not None:
        loop = loop.replace(start={**loop.start, **state_values(system, start.states)})
    seeds = base.seeds if task.seeds is None else task.seeds[i].tolist()
    return dataclasses.replace(base, plant=plant, system=system, inputs=inputs, start=start, loop=loop, seeds=seeds)


def _on_clocks(run: Run, clocks: list[Clock]) -> Run:
    """A run whose sampled controllers have other clocks."""
    given = iter(clocks)
    laws = [dataclasses.replace(law, **next(given)._asdict()) if isinstance(law, Sampled) else law for law in run.loop.controllers]
    return dataclasses.replace(run, clocks=clocks, loop=run.loop.with_controllers(laws))


def _one_by_one(task: Task, values: np.ndarray, errors: dict[int, str], rows: Iterable[int]) -> None:
    for i in rows:
        try:
            run = carry_out(single(task, i))
            values[i] = [measure.read(run) for measure in task.metrics]
        except SimulationError as error:
            errors[task.first + i] = str(error)
        except Exception as error:  # of a law or a measure in Python: one run fails, the others go on
            errors[task.first + i] = f"{type(error).__name__}: {error}"


def numbers_of_run(run: Run) -> np.ndarray:
    """Parameters and coefficients of inputs of a run, shape (first_held,)."""
    program = program_of(run.system, run.kinds, formulas_of(run))
    return work_arrays(run, program).p[: program.first_held].copy()


def slots(run: Run, numbers: Sequence[Number]) -> list[int]:
    """Where inputs, numbers of shapes and parameters stand among the numbers of a task; an input must be given as a number."""
    program = program_of(run.system, run.kinds, formulas_of(run))
    return [program.place(number, run.inputs) for number in numbers]
