"""The one verb: a plant, a duration and perhaps a controller in, a trajectory out."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import time as clock
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import FunctionType
from typing import Any

import casadi as ca
import numpy as np

from toolbox.announce import announced
from toolbox.closed_loop import Controller, External, Sampled, callable_law, held
from toolbox.compose import assembled
from toolbox.elements import finite_array, is_finite_number
from toolbox.errors import BudgetError, SceneError, SimulationError, ZenoError, suggest
from toolbox.hybrid import HybridSystem
from toolbox.inputs import Shape, Table
from toolbox.parts import Component, checked, numbers_of, structure_of
from toolbox.program import ExpressionKey, Program, program_of
from toolbox.rosenbrock import RODAS5P, Rosenbrock
from toolbox.runge_kutta import DOP853, DOPRI5, Pair
from toolbox.smoothed import SmoothSystem, checked_widths, smoothed
from toolbox.stiffness import FIRST_LOOK, pays, progress, set_method
from toolbox.time_stepping import MOREAU_JEAN, Theta
from toolbox.trajectory import Samples, Smoothed, Stepped, Trajectory, output_function


@dataclass(frozen=True)
class Budget:
    """What a run may spend before it ends in a BudgetError, which holds the trajectory so far.

    steps: tried, accepted or not;  events: switches of elements;  seconds: on the clock in the event loop, looked at about ten times a second.
    Raises SceneError, when a run is given it, for anything but positive numbers.
    """

    steps: int = 20_000_000
    events: float = np.inf
    seconds: float = np.inf

    def check(self) -> None:
        """Raise SceneError unless all three are positive numbers; events and seconds may be infinite."""
        for name in ("steps", "events", "seconds"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)) or not value > 0:
                raise SceneError(f"Argument `budget.{name}` must be a number > 0, but it is {value!r}.")


UNHURRIED = Budget()

MAX_RECORDS = 400_000
"""Steps of fixed length that are recorded; of more every second, third ... one is, and those next to a switch."""

METHODS = ("event", "explicit", "stiff", "time-stepping", "smoothed", "auto")
"""How a run may step."""


@dataclass
class Run:
    """Arguments of a run, checked and resolved, so that it can be run again with another accuracy or other output times.

    tolerance: of the integrator where it is not the accuracy.
    resume: (memory of the sampled laws, held signals) to begin with, as an earlier run left them; None begins at zero.
    """

    plant: HybridSystem
    system: HybridSystem
    duration: float
    start: dict[str, Any]
    inputs: dict[str, Any]
    kinds: tuple[tuple[str, Any], ...]
    clocks: list[tuple[float, float]]
    laws: list[Any]
    accuracy: float
    output_times: np.ndarray | None
    longest_step: float
    seeds: list[int]
    method: str = "event"
    step: float | None = None
    widths: Mapping[str, float] | None = None
    tolerance: float | None = None
    budget: Budget = UNHURRIED
    resume: tuple[np.ndarray, np.ndarray] | None = None


def simulate(
    plant: HybridSystem,
    duration: float,
    *,
    start: Mapping[str, Any] | Samples | None = None,
    inputs: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    controller: Any = None,
    sample_time: float | None = None,
    method: str = "event",
    accuracy: float = 1e-6,
    output_times: Sequence[float] | np.ndarray | None = None,
    step: float | None = None,
    width: float | Mapping[str, float] | None = None,
    budget: Budget = UNHURRIED,
) -> Trajectory:
    """Simulate a plant from rest for `duration` seconds, with every switch between stick and slip located as an event.

    start: {state or signal that is a state: value}, all else 0; or one instant of a run (`run.at(12.5)`), whose states are taken.  inputs:
    {signal, or parameter of the plant that changes in time: number, (times, values), a shape of `toolbox.inputs`, or a casadi expression of
    `toolbox.time`}.  parameters: {name: value} for this run only; the controller keeps the plant's declared values.  controller: a Controller, a
    callable (t, y) -> u, `Sampled(law, period, delay)`, or a sequence of them; without `sample_time` [s] a Controller acts continuously.
    method: "event" steps by an explicit method, or by a linearly implicit one where that is cheaper (see `toolbox.stiffness`; runs with a law in
    Python stay explicit); "explicit" and "stiff" prescribe one of the two. All three locate every switch as an event. "time-stepping" locates none
    (see `toolbox.time_stepping`): its `step` [s] is refined until the accuracy is met, unless it is given. "smoothed" regularises friction (see
    `toolbox.smoothed`): so is its `width`, a slip speed or {element: slip speed}. "auto" takes the cheapest by the rule of `toolbox.choice` and
    says why in `run.why`.  accuracy: target for the global error, states scaled by their size.
    output_times: increasing times [s] at which to record (right-hand limits at events); without, every step and both sides of every event.
    budget: what the run may spend.

    Returns a Trajectory. Raises SceneError for arguments that cannot be simulated, and SimulationError, ZenoError or BudgetError, with
    the trajectory so far in `.run`, for a run that cannot be finished, and AccuracyError for a method that cannot meet the accuracy at a bearable price.
    """
    return _run(
        checked_run(
            plant, duration, start=start, inputs=inputs, parameters=parameters, controller=controller, sample_time=sample_time,
            method=method, accuracy=accuracy, output_times=output_times, step=step, width=width, budget=budget,
        )
    )  # fmt: skip


def checked_run(
    plant: HybridSystem,
    duration: float,
    *,
    start: Mapping[str, Any] | Samples | None = None,
    inputs: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    controller: Any = None,
    sample_time: float | None = None,
    method: str = "event",
    accuracy: float = 1e-6,
    output_times: Any = None,
    step: Any = None,
    width: Any = None,
    budget: Budget = UNHURRIED,
) -> Run:
    """The arguments of `simulate`, checked and resolved; raises SceneError as it does."""
    if not isinstance(plant, HybridSystem):
        raise SceneError(f"Argument `plant` must be a plant made by `compose`, but it is {plant!r}.")
    if not is_finite_number(duration) or duration < 0:
        raise SceneError(f"Argument `duration` must be a finite number >= 0 s, but it is {duration!r}.")
    if method not in METHODS:
        raise SceneError(f"Argument `method` must be one of {', '.join(map(repr, METHODS))}, but it is {method!r}.")
    if not is_finite_number(accuracy) or not 1e-13 <= accuracy <= 0.1:
        raise SceneError(f"Argument `accuracy` must be between 1e-13 and 0.1, but it is {accuracy!r}.")
    if not isinstance(budget, Budget):
        raise SceneError(f"Argument `budget` must be a Budget, such as Budget(seconds=60), but it is {budget!r}.")
    budget.check()
    if step is not None:
        if method != "time-stepping":
            raise SceneError(f"Argument `step` must come with method='time-stepping', but the method is {method!r}.")
        if not is_finite_number(step) or not step > 0 or duration / step > budget.steps:
            raise SceneError(f"Argument `step` must be > 0 s and at least {duration / budget.steps:.2g} s, {budget.steps} steps, but it is {step!r}.")
        step = float(step)
    if width is not None and method != "smoothed":
        raise SceneError(f"Argument `width` must come with method='smoothed', but the method is {method!r}.")
    if sample_time is not None and controller is None:
        raise SceneError("Argument `sample_time` must come with a `controller`, but there is none.")
    if isinstance(start, Samples):
        start = _states_of(plant, start)
    for word, given in (("start", start), ("inputs", inputs), ("parameters", parameters)):
        if given is not None and not (isinstance(given, Mapping) and all(isinstance(name, str) for name in given)):
            raise SceneError(f"Argument `{word}` must map names to values, but it is {given!r}.")
    grid = None
    if output_times is not None:
        grid = finite_array(output_times)
        if grid is None or grid.ndim != 1 or not grid.size or (np.diff(grid) <= 0).any() or grid[0] < 0 or grid[-1] > duration:
            raise SceneError(f"Argument `output_times` must be increasing times between 0 and {duration:g} s.")
    declared = plant
    if parameters:
        own = {name: value for name, value in parameters.items() if not (inputs and name in inputs)}
        if len(own) < len(parameters):
            both = next(name for name in parameters if name not in own)
            raise SceneError(f"Argument `{both}` must be given in `inputs` or in `parameters`, but it is in both.")
        plant = plant.with_parameters(parameters)
    smooth = None if not isinstance(plant, SmoothSystem) else plant
    original, sharp = (each.sharp if isinstance(each, SmoothSystem) else each for each in (declared, plant))
    system, clocks, laws, seeds = _closed(original, sharp, controller, sample_time)
    changing = [name for name in inputs or {} if not system.has_signal(name) and declared.has_parameter(name)]
    if changing:
        system = system.varying(changing)
    widths = None
    if method == "smoothed":
        if smooth is not None:
            raise SceneError("Argument `method` must not be 'smoothed' for a plant that is smooth already.")
        widths = checked_widths(system, 1.0 if width is None else width)
        if width is None:
            widths = None
    if smooth is not None:
        system = smoothed(system, smooth.widths, matched=smooth.matched)
    kinds, values = _input_kinds(system, inputs or {})
    if changing:  # what parts demand of their fields must hold where all are lowest, and where all are highest
        for extreme in (min, max):
            plant.with_parameters({name: extreme(_range(values[name])) for name in changing if _range(values[name])})
    longest = float(duration) / 256
    return Run(
        plant, system, float(duration), dict(start or {}), values, kinds, clocks, laws, float(accuracy), grid, longest, seeds, method, step, widths,
        budget=budget,
    )  # fmt: skip


def _states_of(plant: HybridSystem, instant: Samples) -> dict[str, Any]:
    """The states of a plant at one instant of a run of it; raises SceneError where the run has none of that name."""
    if instant.time.size != 1:
        raise SceneError(f"Argument `start` must be one instant of a run, such as `run.at(12.5)`, but it holds {instant.time.size} times.")
    for name in plant.states:
        if name not in instant:
            raise SceneError(f"Argument `start` must hold the state `{name}`, but the run it comes from has none.")
    return {name: np.squeeze(instant[name]) if size is None else np.ravel(instant[name]) for name, (_, size, _) in plant.states.items()}


def _closed(
    declared: HybridSystem, plant: HybridSystem, controller: Any, sample_time: float | None
) -> tuple[HybridSystem, list[tuple[float, float]], list[Any], list[int]]:
    """The plant with its controllers as parts, the (period, delay) of the sampled ones in order, the Python callables, and the seeds."""
    if controller is None:
        return plant, [], [], []
    parts: list[Component] = []
    clocks: list[tuple[float, float]] = []
    laws: list[Any] = []
    seeds: list[int] = []
    for given in controller if isinstance(controller, (list, tuple)) else (controller,):
        sampled = given
        if not isinstance(given, Sampled):
            sampled = Sampled(given, sample_time) if sample_time is not None else None
        law = given.law if isinstance(given, Sampled) else given
        if sampled is not None:
            sampled.check()
        if isinstance(law, Controller):
            law = law.design(declared)
        if isinstance(law, Controller):
            structure_of(law)  # the kinds of its fields, before `checked` compares their values
            checked(law)
            parts.append(law if sampled is None else held(sampled, law))
        elif callable(law) and not isinstance(law, type):
            if sampled is None:
                raise SceneError("A callable controller must come with `sample_time`, but there is none.")
            parts.append(callable_law(dataclasses.replace(sampled, law=law), declared))
            laws.append(law)
        else:
            raise SceneError(f"Argument `controller` must be a Controller, Sampled or a callable, but it is {law!r}.")
        if sampled is not None:
            clocks.append((float(sampled.period), float(sampled.delay)))
            seeds.append(sampled.seed)
    key = ("closed", tuple(structure_of(part) for part in parts))
    found = plant.kernels.get(key)
    if found is None:
        closed = assembled((*plant.parts, *parts))
        by_name = {p.name: p.offset for p in plant.parameters.values()}
        places: list[tuple[int, int]] = []
        for entry in closed.parameters.values():
            if entry.name in by_name:
                size = entry.size or 1
                places += zip(range(by_name[entry.name], by_name[entry.name] + size), range(entry.offset, entry.offset + size), strict=True)
        first = sum(len(numbers_of(part)) for part in plant.parts)
        found = plant.kernels[key] = (closed, np.array(places, np.int64).reshape(-1, 2), first)
    shared, places_of, first = found
    closed = copy.copy(shared)
    closed.parts = (*plant.parts, *parts)
    closed.values = shared.values.copy()
    closed.values[places_of[:, 1]] = plant.values[places_of[:, 0]]
    numbers = [value for part in parts for value in numbers_of(part)]
    closed.values[first : first + len(numbers)] = numbers
    for entry in closed.parameters.values():
        if first <= entry.offset < first + len(numbers):
            size = entry.size or 1
            entry.check(tuple(closed.values[entry.offset : entry.offset + size].tolist()))
    return closed, clocks, laws, seeds


def _input_kinds(system: HybridSystem, inputs: Mapping[str, Any]) -> tuple[tuple[tuple[str, Any], ...], dict[str, Any]]:
    """How each input is given (number, table, shape with its size, expression), which is structure, and the checked values."""
    kinds: list[tuple[str, Any]] = []
    values: dict[str, Any] = {}
    for name, value in inputs.items():
        entry = system.inputs.get(name)
        if entry is None:
            if name in system.signals:
                raise SceneError(f"Argument `{name}` must not be an input: a part of the plant gives this signal.")
            raise SceneError(f"There is no input `{name}`: {suggest(name, system.inputs)}")
        if isinstance(value, (tuple, list, np.ndarray)) and len(value) == 2:
            value = Table.of(name, *value)
        if isinstance(value, Table):
            kinds.append((name, "table"))
        elif isinstance(value, Shape):
            kinds.append((name, (value.kind, len(value.coefficients))))
        elif isinstance(value, ca.SX):
            strangers = [str(s) for s in ca.symvar(value) if not ca.is_equal(s, system.t)]
            if strangers or value.numel() != 1 or (value.is_constant() and not is_finite_number(float(value))):
                raise SceneError(f"Argument `{name}` must be a scalar expression of `toolbox.time`, but it is {value}.")
            kinds.append((name, ExpressionKey(value)))
        elif is_finite_number(value):
            kinds.append((name, "number"))
            value = float(value)
        else:
            raise SceneError(f"Argument `{name}` must be a finite number, (times, values), a shape or an expression of time, but it is {value!r}.")
        if name in system.parameters:
            system.parameters[name].check(np.array(_range(value)))
        values[name] = value
    return tuple(sorted(kinds, key=lambda pair: pair[0])), values


def _range(value: Any) -> tuple[float, ...]:
    """Smallest and largest value of an input; none for a formula of time."""
    if isinstance(value, Table):
        return float(value.values.min()), float(value.values.max())
    return value.range() if isinstance(value, Shape) else () if isinstance(value, ca.SX) else (value,)


_LOADED: list[Any] = []


def _compiled_loop(run: Run, program: Program) -> tuple[Any, Any]:
    """The file of the event loop, and the loop that steps with this program: loaded by a run of no duration in each process.

    Says so on stderr where this machine has to compile it first.
    """
    from toolbox import loop

    name, advance = "event loop", loop.advance
    if isinstance(program.pair, Theta):
        from toolbox import stepping_loop

        name, advance = "loop of time stepping", stepping_loop.advance

    if advance not in _LOADED:
        _LOADED.append(advance)
        announced(name, advance)
        empty = _work(loop, dataclasses.replace(run, duration=0.0, output_times=None), program)
        advance(empty)
    return loop, advance


def _undecided(run: Run) -> bool:
    """Whether the run may turn out to be stiff; a law in Python is asked once per sample, so that its runs do not begin anew."""
    return run.method == "event" and not run.laws


def pair_of(run: Run) -> Pair | Rosenbrock | Theta:
    """The formulas that a run steps with."""
    if run.method in ("stiff", "smoothed"):
        return RODAS5P
    if run.method == "time-stepping":
        return MOREAU_JEAN
    if run.system.updates:
        return DOP853 if run.accuracy < 1e-9 else DOPRI5
    return DOPRI5 if run.accuracy > 1e-5 else DOP853


def _run(run: Run) -> Trajectory:
    if run.method == "auto":
        from toolbox.choice import chosen

        return chosen(run)
    if (run.method == "time-stepping" and run.step is None) or (run.method == "smoothed" and run.widths is None):
        from toolbox.dial import refined

        return refined(run)
    if run.method == "smoothed" and not isinstance(run.system, SmoothSystem):
        from toolbox.dial import tolerance

        run = dataclasses.replace(run, system=smoothed(run.system, run.widths or {}), tolerance=run.tolerance or tolerance(run))
    program = program_of(run.system, run.kinds, pair_of(run))
    loop, advance = _compiled_loop(run, program)
    work = _work(loop, run, program)
    began = clock.perf_counter()
    laws = [_fresh(law) for law in run.laws]
    answers: list[list[np.ndarray]] = [[] for _ in laws]
    bar: Any = None
    look = progress(loop, work)
    following = FIRST_LOOK if _undecided(run) else run.budget.steps
    chunk = 200_000 if run.budget.seconds == np.inf else 100
    try:
        while True:
            tried = progress(loop, work)[1]
            work.ints[loop.BUDGET] = min(following - tried, run.budget.steps - tried, chunk)
            status = advance(work)
            spent = clock.perf_counter() - began
            if spent > run.budget.seconds and status != loop.DONE:
                raise _exhausted(loop, run, program, work, began, answers)
            if status == loop.DONE:
                done = _trajectory(loop, run, program, work, began, answers)
                done.laws = tuple(laws)
                return _sound(done, program)
            if status == loop.EVENTS_FULL and work.ints[loop.EVENTS] > run.budget.events:
                raise _exhausted(loop, run, program, work, began, answers)
            if status == loop.RECORDS_FULL or status == loop.EVENTS_FULL:
                work = _grown(loop, work, status == loop.RECORDS_FULL, run.budget)
            elif status == loop.SAMPLE_DUE:
                _sample(loop, run, program, work, laws, answers, began)
            elif status == loop.PAUSED:
                if progress(loop, work)[1] >= run.budget.steps:
                    raise _exhausted(loop, run, program, work, began, answers)
                if run.budget.seconds < np.inf:  # as many steps as take a tenth of a second at most
                    chunk = max(1, min(2 * chunk, int(0.1 * progress(loop, work)[1] / spent)))
                if progress(loop, work)[1] >= following:
                    if pays(loop, run, program, work, look):
                        left = dataclasses.replace(run.budget, seconds=run.budget.seconds - spent)
                        return _run(dataclasses.replace(run, method="stiff", budget=left))
                    look = progress(loop, work)
                    following = 2 * look[1]
                if bar is None and spent > 1.0:
                    from tqdm import tqdm

                    bar = tqdm(total=run.duration, unit="s", unit_scale=True, leave=False, disable=None)  # silent where stderr is no terminal
                if bar is not None:
                    bar.update(float(work.reals[loop.TIME]) - bar.n)
            else:
                raise _failure(loop, status, run, program, work, began, answers)
    except BaseException as error:  # an exception of the user's law or an interrupt: what was computed is not lost
        if getattr(error, "run", None) is None:
            with contextlib.suppress(AttributeError):
                error.run = _trajectory(loop, run, program, work, began, answers)  # type: ignore[attr-defined]
        if getattr(error, "run", None) is not None:
            error.run.laws = tuple(laws)  # type: ignore[attr-defined]
        raise
    finally:
        if bar is not None:
            bar.close()


def _fresh(law: Any) -> Any:
    """A copy of a law that may have a state, so that every run starts alike; itself where it is a function or cannot be copied."""
    if isinstance(law, FunctionType):
        return law
    try:
        return copy.deepcopy(law)
    except Exception:  # whatever an object that holds a lock or a solver raises
        return law


def _sound(run: Trajectory, program: Program) -> Trajectory:
    """The run, unless a bound that varies in time was negative at a recorded time: friction would have driven the machine."""
    if program.varying:
        names = [program.system.elements[i].name for i in program.varying]
        expression = ca.vertcat(*[program.system.elements[i].static for i in program.varying])
        bounds = np.atleast_2d(run.computed("varying bounds", expression).T)
        wrong = bounds < -1e-9 * np.abs(bounds).max(axis=1, keepdims=True)
        if isinstance(run, Stepped):  # which sees a contact open at the end of a step, and takes no friction until then
            wrong[:, 2:] = wrong[:, 2:] & wrong[:, 1:-1] & wrong[:, :-2]
            wrong[:, :2] = False
        if wrong.any():
            i, k = np.unravel_index(np.argmin(bounds), bounds.shape)
            raise SimulationError(
                f"The bound of `{names[i]}` must be >= 0, but it is {bounds[i, k]:.6g} at t = {run.time[k]:.9g} s: is its load negative?", run
            )
    return run


def _work(loop: Any, run: Run, program: Program) -> Any:
    """All arrays of a run, filled with its numbers."""
    system, machine = run.system, program.machine
    n, ne, ng = machine.states, machine.elements, machine.guards
    p = np.empty(program.p_size)
    base = system.values.size
    p[:base] = system.values
    p[program.first_held :] = 0.0
    jumps: list[tuple[float, int, float]] = []
    for name, value in run.inputs.items():
        if isinstance(value, Table):
            slot = program.table_slot[name]
            for begin, a, b, t0 in value.segments():
                if begin <= 0.0:
                    p[slot : slot + 3] = a, b, t0
                else:
                    jumps += [(begin, slot, a), (begin, slot + 1, b), (begin, slot + 2, t0)]
        elif isinstance(value, Shape):
            slot = program.coefficient_slot[name]
            p[slot : slot + len(value.coefficients)] = value.coefficients
        elif not isinstance(value, ca.SX):
            p[program.coefficient_slot[name]] = value
    times, first = np.empty(0), np.zeros(1, np.int64)
    if jumps:
        jumps.sort(key=lambda jump: jump[0])
        times, first = np.unique(np.array([jump[0] for jump in jumps]), return_index=True)
        first = np.append(first, len(jumps)).astype(np.int64)

    ints = np.zeros(loop.INTS, np.int64)
    ints[loop.N], ints[loop.NE], ints[loop.NG] = n, ne, ng
    ints[loop.COUPLED] = machine.coupled
    ints[loop.FIRST_HELD] = program.first_held
    ints[loop.NODES] = 1 if run.output_times is None else 0
    if isinstance(program.pair, Theta) and run.step is not None and run.output_times is None:
        ints[loop.NODES] = 1 + int(run.duration / run.step / MAX_RECORDS)
    reals = np.zeros(loop.REALS)
    reals[loop.LONGEST] = run.longest_step if program.forced else np.inf
    reals[loop.STEP_SIZE] = run.step or 0.0
    reals[loop.END] = run.duration
    reals[loop.RTOL] = run.tolerance or run.accuracy
    reals[loop.LAST_EVENT] = -np.inf

    samplers = np.zeros((len(system.updates), loop.COLUMNS), np.int64)
    clocks = np.array(run.clocks, float).reshape(len(system.updates), 2)
    memory_size = 0
    keys: list[int] = []
    for c, update in enumerate(system.updates):
        size, first_output = update.memory.numel(), program.held_slot + update.first_held
        address = 0 if update.external else machine.updates[c]
        samplers[c] = address, 0, 0, memory_size, size, first_output, update.outputs.numel(), len(update.channels)
        keys += [0] * size + [loop.channel_key(run.seeds[c], zlib.crc32(name.encode())) for name in update.channels]
        memory_size = len(keys)
        if clocks[c, 1] > 0.0:  # until a delayed output arrives the signal has its stand-in
            defaults = dict(zip(run.plant.inputs, np.array(run.plant.input_defaults(run.plant.values)).ravel(), strict=True))
            p[first_output : first_output + len(update.names)] = [defaults.get(name, 0.0) for name in update.names]
    memory = np.zeros(memory_size)
    if run.resume is not None:
        memory[:], p[program.held_slot : program.held_slot + system.held.numel()] = run.resume
    depth = 2 + int(max((min(np.ceil(d / h), run.duration // h + 1) for h, d in clocks), default=0))
    widest = max((u.outputs.numel() for u in system.updates), default=1)
    room = max(4 * n + 2 * ng, n + 6 * ne, memory_size + widest, n) + 8
    capacity = 1024 if run.output_times is None else run.output_times.size + 8
    if isinstance(program.pair, Theta) and run.step is not None and run.output_times is None:
        capacity = 1024 + int(run.duration / run.step / ints[loop.NODES])
    x = np.zeros(n)  # behind the states come those of hidden forces
    for name, value in run.start.items():
        remembered = [row[loop.FIRST_STATE] for row, update in zip(samplers, system.updates, strict=True) if name in update.places]
        if remembered:
            _place_memory(system, memory[remembered[0] :], name, value)
        else:
            place_start(system, x, name, value)
    events = _event_room(128 + 2 * ne, ne, run.budget)
    work = loop.Work(
        ints=ints, reals=reals, x=x, k=np.zeros(n), p=p, m=np.zeros(ne), y=np.zeros(room), z=np.zeros(room), s=np.zeros(n), q=np.zeros(p.size),
        scale=np.zeros(n), noise=np.zeros(n), group=program.groups, group_scale=np.zeros(program.group_count),
        g=np.zeros(2 * ng), g_low=np.zeros(2 * ng), g_high=np.zeros(2 * ng), guard_scale=np.zeros(2 * ng), slot=np.zeros(ng, np.int64), side=np.ones(ng),
        armed=np.zeros(ng, np.bool_), fired=np.zeros(ng, np.bool_), zero=np.zeros(ne, np.bool_), forced=np.zeros(ne, np.bool_), before=np.zeros(ne),
        kind=program.kind, initial=program.initial, attached=program.attached, loader=program.loader, held=np.zeros(2 * ne + 1), bounced=np.zeros(ne, np.bool_),
        excited=program.excited,
        rec_t=np.empty(capacity), rec_x=np.empty((capacity, n - program.excited.size)), rec_m=np.empty((capacity, ne), np.int8),
        rec_p=np.empty((capacity, program.p_size - program.first_held)),
        ev_t=np.empty(events), ev_i=np.empty(events, np.int32), ev_m=np.empty((events, 2), np.int8),
        jump_t=times, jump_first=first, jump_index=np.array([j[1] for j in jumps], np.int64), jump_value=np.array([j[2] for j in jumps]),
        out_t=run.output_times if run.output_times is not None else np.empty(0),
        samplers=samplers, clocks=clocks, memory=memory, keys=np.array(keys, np.uint64), queue=np.zeros((len(system.updates), depth, widest)),
    )  # fmt: skip
    set_method(loop, work, program)
    return work


def _place_memory(system: HybridSystem, memory: np.ndarray, name: str, value: Any) -> None:
    """Write the start value of a state that a sampled law remembers into the memory of that law."""
    first, size = next(update.places[name] for update in system.updates if name in update.places)
    array = finite_array(value)
    if array is None or (array.ndim and array.shape != (size or 1,)):
        raise SceneError(f"Argument `{name}` must be {size or 1} finite number(s), but it is {value!r}.")
    memory[first : first + (size or 1)] = array


def place_start(system: HybridSystem, x: np.ndarray, name: str, value: Any) -> None:
    """Write a start value: of a state, of one entry of a vector state (`chain.speed.0`), or of a signal that is a state (`bit.speed`)."""
    target: Any = None
    rows = system.rows(name)
    if rows is not None:
        target = slice(rows[0], rows[0] + (rows[1] or 1))
    elif name in system.signals:
        expression = system.signals[name][0]
        if expression.numel() == 1 and expression.is_symbolic():
            place = np.flatnonzero(np.array(ca.DM(ca.jacobian(system.x, expression))))
            if place.size == 1:
                target = slice(place[0], place[0] + 1)
    if target is None:
        if name in system.signals:
            raise SceneError(f"Argument `{name}` must be a state to be given a start value, but it is computed from states.")
        raise SceneError(f"There is no state `{name}`: {suggest(name, [*system.states, *system.signals])}")
    array = finite_array(value)
    if array is None:
        raise SceneError(f"Argument `{name}` must be finite numbers, but it is {value!r}.")
    if array.ndim and array.shape != x[target].shape:
        raise SceneError(f"Argument `{name}` must have shape {x[target].shape}, but it has {array.shape}.")
    x[target] = array


def _event_room(asked: int, elements: int, budget: Budget) -> int:
    """Room for events, no more than the budget allows and one instant fills: the loop stops when it is full."""
    return int(min(asked, budget.events + 2 * elements + 1))


def _grown(loop: Any, work: Any, records: bool, budget: Budget) -> Any:
    """The work arrays with twice the room for records, or for events."""
    names = ("rec_t", "rec_x", "rec_m", "rec_p") if records else ("ev_t", "ev_i", "ev_m")
    bigger = {}
    for name in names:
        old = getattr(work, name)
        room = 2 * old.shape[0] if records else _event_room(2 * old.shape[0], work.m.size, budget)
        new = np.empty((room, *old.shape[1:]), old.dtype)
        new[: old.shape[0]] = old
        bigger[name] = new
    return work._replace(**bigger)


def _sample(
    loop: Any, run: Run, program: Program, work: Any, laws: list[Any], answers: list[list[np.ndarray]], began: float
) -> None:
    """Evaluate a Python controller at the current instant and queue its outputs."""
    c = int(work.ints[loop.CULPRIT])
    row = work.samplers[c]
    index = [i for i, update in enumerate(program.system.updates) if update.external].index(c)
    part = [part for part in run.system.parts if isinstance(part, External)][index]
    point = Trajectory.point(run, program, work.reals[loop.TIME], work.x, work.m, work.p)
    sensors, update = part.sensors, program.system.updates[c]
    first = row[loop.FIRST_STATE] + row[loop.STATES]
    noise = {name: loop.normal(work.keys[first + i], row[loop.TAKEN]) for i, name in enumerate(update.channels)}
    y = np.array([sensors.reading(name, point[place], noise.get(name, 0.0)) for name, place in zip(part.asked, part.measures, strict=True)])
    answer = laws[index](float(work.reals[loop.TIME]), y)
    u = finite_array(answer)
    if u is None or u.size != row[loop.OUTPUTS]:
        raise SimulationError(
            f"The controller must return {row[loop.OUTPUTS]} finite value(s) for {', '.join(part.drives)}, but at "
            f"t = {work.reals[loop.TIME]:g} s it returned {answer!r}.",
            _trajectory(loop, run, program, work, began, answers),
        )
    work.queue[c, row[loop.TAKEN] % work.queue.shape[1], : u.size] = u.ravel()
    answers[index].append(u.ravel())
    row[loop.TAKEN] += 1


def _trajectory(loop: Any, run: Run, program: Program, work: Any, began: float, answers: list[list[np.ndarray]]) -> Trajectory:
    r, e = int(work.ints[loop.RECORDS]), int(work.ints[loop.EVENTS])
    kind = Stepped if run.method == "time-stepping" else Smoothed if run.method == "smoothed" else Trajectory
    return kind(
        run=run,
        program=program,
        time=work.rec_t[:r].copy(),
        states=work.rec_x[:r].copy(),
        mode=work.rec_m[:r].copy(),
        held=work.rec_p[:r].copy(),
        parameters=work.p,
        event_arrays=(work.ev_t[:e].copy(), work.ev_i[:e].copy(), work.ev_m[:e].copy()),
        last_mode=work.m,
        end=float(work.reals[loop.TIME]),
        answers=answers,
        memory=work.memory.copy(),
        steps=(int(work.ints[loop.ACCEPTED]), int(work.ints[loop.REJECTED])),
        merged=int(work.ints[loop.MERGED]),
        wall_time=clock.perf_counter() - began,
    )


def _exhausted(loop: Any, run: Run, program: Program, work: Any, began: float, answers: list[list[np.ndarray]]) -> BudgetError:
    """The error of a run that has spent its budget: what it spent and what it spent it on."""
    so_far = _trajectory(loop, run, program, work, began, answers)
    t, steps, events = progress(loop, work)
    spent = f"{steps} steps" if steps >= run.budget.steps else f"{so_far.wall_time:.3g} s" if so_far.wall_time > run.budget.seconds else ""
    if spent:
        cause = f"steps of about {t / max(steps, 1):.1g} s, which a fast stiff part of the plant or a very short period asks for"
    else:
        spent, names = f"{events} events", [element.name for element in program.system.elements]
        often = np.bincount(work.ev_i[:events], minlength=len(names))
        cause = f"most of them are of `{names[int(np.argmax(often))]}`"
    return BudgetError(f"The run used {spent} and reached t = {t:.9g} s of {run.duration:g} s: {cause}.", so_far)


def _failure(
    loop: Any, status: int, run: Run, program: Program, work: Any, began: float, answers: list[list[np.ndarray]]
) -> SimulationError:
    so_far = _trajectory(loop, run, program, work, began, answers)
    t = float(work.reals[loop.TIME])
    names = [element.name for element in program.system.elements]
    point = Trajectory.point(run, program, t, work.x, work.m, work.p)
    if status in (loop.INCONSISTENT, loop.ENDLESS):
        bounds = np.array(output_function(program, "bounds of elements", ca.vertcat(*[e.static for e in program.system.elements]))(
            t, point.states.T, work.p[: program.first_held], work.p[program.first_held :], work.m)).ravel()  # fmt: skip
        if (bounds < 0).any():
            name = names[int(np.argmin(bounds))]
            return SimulationError(f"The bound of `{name}` must be >= 0, but it is {bounds.min():.6g} at t = {t:.9g} s: is its load negative?", so_far)
    if status == loop.ENDLESS:
        return ZenoError(f"Element `{names[int(work.ints[loop.CULPRIT])]}` switches without end at t = {t:.9g} s.", so_far)
    if status == loop.INCONSISTENT:
        inside = [e.name for e in program.system.elements if e.unilateral and float(np.ravel(point[f"{e.name}.closure"])[0]) > 0.0] if t == 0.0 else []
        if inside:
            return SimulationError(f"The closure of the rigid contact `{inside[0]}` must be <= 0 at the start, but it is inside.", so_far)
        return SimulationError(f"No modes of the elements {', '.join(names)} are consistent with the forces at t = {t:.9g} s.", so_far)
    labels = [name for name, (_, size, _) in program.system.states.items() for _ in range(size or 1)]
    finite = np.isfinite(work.k)
    if not finite.all():
        return SimulationError(f"The rate of `{labels[int(np.argmin(finite))]}` is not finite at t = {t:.9g} s.", so_far)
    if not np.isfinite(work.y[: len(labels)]).all():
        name = labels[int(np.argmin(np.isfinite(work.y[: len(labels)])))]
        return SimulationError(
            f"No step from t = {t:.9g} s gives a finite `{name}`: its equations, and friction laws a little beyond zero slip, must be smooth.", so_far
        )
    largest = int(np.argmax(np.abs(work.x[: len(labels)])))
    if abs(work.x[largest]) > 1e12:
        return SimulationError(f"The run diverges: `{labels[largest]}` is {work.x[largest]:.3g} at t = {t:.9g} s.", so_far)
    return SimulationError(f"The step size fell below what double precision resolves at t = {t:.9g} s; lower the accuracy asked.", so_far)


def again(run: Run, **changes: Any) -> Trajectory:
    """The same run with some arguments changed, e.g. another accuracy."""
    return _run(dataclasses.replace(run, **changes))
