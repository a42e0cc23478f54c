"""The one verb: a plant, a duration and perhaps a controller in, a trajectory out."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import FunctionType
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import mapping
from toolbox.compilation.moreau_jean import MOREAU_JEAN, Theta
from toolbox.compilation.notices import announced
from toolbox.compilation.program import ExpressionKey, Program, program_of
from toolbox.compilation.rosenbrock import RODAS5P, Rosenbrock
from toolbox.compilation.runge_kutta import DOP853, DOPRI5, Pair
from toolbox.errors import SceneError, SimulationError, suggest
from toolbox.modelling.components import Component, checked, numbers_of, structure_of
from toolbox.modelling.composition import assembled
from toolbox.modelling.elements import finite_array, is_finite_number
from toolbox.modelling.hybrid_system import HybridSystem, checked_plant
from toolbox.modelling.inputs import Shape, Table
from toolbox.modelling.laws import Controller, External, Sampled, callable_law, designed, held
from toolbox.modelling.regularisation import SmoothSystem, checked_widths, smoothed
from toolbox.simulation.failures import exhausted, failure, trajectory_so_far
from toolbox.simulation.stiffness import FIRST_LOOK, pays, progress
from toolbox.simulation.trajectory import Samples, Stepped, Trajectory
from toolbox.simulation.work_arrays import grown, work_arrays
from toolbox.steady_states.linear import Equilibrium


@dataclass(frozen=True)
class Budget:
    """What a run may spend before it ends in a BudgetError, which holds the trajectory so far.

    steps: tried, accepted or not;  events: switches of elements: a run that has exactly so many finishes, one that has more ends where the next is due and
    holds those before;  seconds: on the clock in the event loop, looked at about ten times a second.
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
    start: Mapping[str, Any] | Samples | Equilibrium | None = None,
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

    start: {state or signal that is a state: value}, all else 0; or one instant of a run (`run.at(12.5)`) or an `equilibrium`, whose states are taken.  inputs:
    {signal, or parameter of the plant that changes in time: number, (times, values), a shape of `toolbox.inputs` (step, ramp, sine, square, triangle,
    `inputs.sweep`), or a casadi expression of `toolbox.time`}.  parameters: {name: value} for this run only; the controller keeps the plant's declared
    values.  controller: a Controller, a
    callable (t, y) -> u, `Sampled(law, period, delay)`, or a sequence of them; without `sample_time` [s] a Controller acts continuously.
    method: "event" steps by an explicit method, or by a linearly implicit one where that is cheaper (see `toolbox.simulation.stiffness`; runs with a law in
    Python stay explicit); "explicit" and "stiff" prescribe one of the two. All three locate every switch as an event. "time-stepping" locates none
    (see `toolbox.compilation.moreau_jean`): its `step` [s] is refined until the accuracy is met, unless it is given. "smoothed" regularises friction (see
    `toolbox.smoothed`): so is its `width`, a slip speed or {element: slip speed}. "auto" takes the cheapest by the rule of
    `toolbox.simulation.method_choice` and says why in `run.why`.  accuracy: target for the global error, states scaled by their size.
    output_times: increasing times [s] at which to record (right-hand limits at events); without, every step and both sides of every event.
    budget: what the run may spend.

    Returns a Trajectory. Raises SceneError for arguments that cannot be simulated, and SimulationError, ZenoError or BudgetError, with
    the trajectory so far in `.run`, for a run that cannot be finished, and AccuracyError for a method that cannot meet the accuracy at a bearable price.
    """
    return carry_out(
        checked_run(
            plant, duration, start=start, inputs=inputs, parameters=parameters, controller=controller, sample_time=sample_time,
            method=method, accuracy=accuracy, output_times=output_times, step=step, width=width, budget=budget,
        )
    )  # fmt: skip


def checked_run(
    plant: HybridSystem,
    duration: float,
    *,
    start: Mapping[str, Any] | Samples | Equilibrium | None = None,
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
    checked_plant(plant)
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
    instant: Samples | None = None
    if isinstance(start, Samples):
        instant = start
        start = _states_of(plant, instant)
    elif isinstance(start, Equilibrium):
        start = {name: start[name] for name in start.plant.states}
    for word, given in (("start", start), ("inputs", inputs), ("parameters", parameters)):
        mapping(word, given)
    grid = None
    if output_times is not None:
        grid = finite_array(output_times)
        if grid is None or grid.ndim != 1 or not grid.size or (np.diff(grid) <= 0).any() or grid[0] < 0 or grid[-1] > duration:
            raise SceneError(f"Argument `output_times` must be increasing times between 0 and {duration:g} s, but {_wrong_with(grid, duration)}.")
    declared = plant
    if parameters:
        own = {name: value for name, value in parameters.items() if not (inputs and name in inputs)}
        if len(own) < len(parameters):
            both = next(name for name in parameters if name not in own)
            raise SceneError(f"Argument `{both}` must be given in `inputs` or in `parameters`, but it is in both.")
        try:
            plant = plant.with_parameters(parameters)
        except SceneError:
            sharp = declared.sharp if isinstance(declared, SmoothSystem) else declared
            closed = _closed(sharp, sharp, controller, sample_time)[0]
            for name in parameters:
                if closed.has_parameter(name) and not declared.has_parameter(name):
                    raise SceneError(f"Argument `{name}` must be a parameter of the plant, but it is a number of the law: give it to the law.") from None
            raise
    smooth = None if not isinstance(plant, SmoothSystem) else plant
    original, sharp = (each.sharp if isinstance(each, SmoothSystem) else each for each in (declared, plant))
    system, clocks, laws, seeds = _closed(original, sharp, controller, sample_time)
    begin = dict(start or {})
    if instant is not None:
        known = instant.program.system.states
        begin |= {name: _value(instant, name, size) for name, (_, size, _) in system.states.items() if name in known}
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
        plant, system, float(duration), begin, values, kinds, clocks, laws, float(accuracy), grid, longest, seeds, method, step, widths,
        budget=budget,
    )  # fmt: skip


def _wrong_with(grid: np.ndarray | None, duration: float) -> str:
    """What is wrong with output times."""
    if grid is None or grid.ndim != 1 or not grid.size:
        return "they are " + ("no finite numbers" if grid is None else f"an array of shape {grid.shape}")
    late = np.flatnonzero(np.diff(grid) <= 0)
    if late.size:
        before, after = grid[late[0] : late[0] + 2].tolist()
        return f"{before!r} s is followed by {after!r} s"
    return f"they begin at {grid[0]:g} s" if grid[0] < 0 else f"they end at {float(grid[-1])!r} s"


def _states_of(plant: HybridSystem, instant: Samples) -> dict[str, Any]:
    """The states of a plant at one instant of a run of it; raises SceneError where the run has none of that name."""
    if instant.time.size != 1:
        raise SceneError(f"Argument `start` must be one instant of a run, such as `run.at(12.5)`, but it holds {instant.time.size} times.")
    for name in plant.states:
        if name not in instant:
            raise SceneError(f"Argument `start` must hold the state `{name}`, but the run it comes from has none.")
    return {name: _value(instant, name, size) for name, (_, size, _) in plant.states.items()}


def _value(instant: Samples, name: str, size: int | None) -> Any:
    return np.squeeze(instant[name]) if size is None else np.ravel(instant[name])


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
    everything = controller if isinstance(controller, (list, tuple)) else (controller,)
    if sample_time is not None and everything and all(isinstance(given, Sampled) and given.period != sample_time for given in everything):
        raise SceneError(
            f"Argument `sample_time` must be left out where every controller is Sampled, with a period of its own, but it is {sample_time!r}."
        )
    for given in everything:
        sampled = given
        if not isinstance(given, Sampled):
            sampled = Sampled(given, sample_time) if sample_time is not None else None
        law = given.law if isinstance(given, Sampled) else given
        if sampled is not None:
            sampled.check()
        if isinstance(law, Controller):
            law = designed(law, declared)
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
            hint = ": the swept sine is `toolbox.inputs.sweep`" if getattr(value, "__name__", "") == "sweep" else ""
            raise SceneError(
                f"Argument `{name}` must be a finite number, (times, values), a shape or an expression of time, but it is {value!r}{hint}."
            )
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


def compiled_loop(run: Run, program: Program) -> tuple[Any, Any]:
    """The file of the event loop, and the loop that steps with this program: loaded by a run of no duration in each process.

    Says so on stderr where this machine has to compile it first.
    """
    from toolbox.simulation import event_loop as loop

    name, advance = "event loop", loop.advance
    if isinstance(program.pair, Theta):
        from toolbox.simulation import stepping_loop

        name, advance = "loop of time stepping", stepping_loop.advance

    if advance not in _LOADED:
        _LOADED.append(advance)
        announced(name, advance)
        empty = work_arrays(loop, dataclasses.replace(run, duration=0.0, output_times=None), program)
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


def carry_out(run: Run) -> Trajectory:
    """The trajectory of checked arguments; raises SimulationError and its kinds as `simulate` does."""
    if run.method == "auto":
        from toolbox.simulation.method_choice import chosen

        return chosen(run)
    if (run.method == "time-stepping" and run.step is None) or (run.method == "smoothed" and run.widths is None):
        from toolbox.simulation.refinement import refined

        return refined(run)
    if run.method == "smoothed" and not isinstance(run.system, SmoothSystem):
        from toolbox.simulation.refinement import tolerance

        run = dataclasses.replace(run, system=smoothed(run.system, run.widths or {}), tolerance=run.tolerance or tolerance(run))
    program = program_of(run.system, run.kinds, pair_of(run))
    loop, advance = compiled_loop(run, program)
    work = work_arrays(loop, run, program)
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
                raise exhausted(loop, run, program, work, began, answers)
            if status == loop.DONE:
                done = trajectory_so_far(loop, run, program, work, began, answers)
                done.laws = tuple(laws)
                return _sound(done, program)
            if status == loop.EVENTS_FULL and work.ints[loop.EVENTS] > run.budget.events:
                raise exhausted(loop, run, program, work, began, answers)
            if status == loop.RECORDS_FULL or status == loop.EVENTS_FULL:
                work = grown(work, program, status == loop.RECORDS_FULL, run.budget)
            elif status == loop.SAMPLE_DUE:
                _sample(loop, run, program, work, laws, answers, began)
            elif status == loop.PAUSED:
                if progress(loop, work)[1] >= run.budget.steps:
                    raise exhausted(loop, run, program, work, began, answers)
                if run.budget.seconds < np.inf:  # as many steps as take a tenth of a second at most
                    chunk = max(1, min(2 * chunk, int(0.1 * progress(loop, work)[1] / spent)))
                if progress(loop, work)[1] >= following:
                    if pays(loop, run, program, work, look):
                        left = dataclasses.replace(run.budget, seconds=run.budget.seconds - spent)
                        return carry_out(dataclasses.replace(run, method="stiff", budget=left))
                    look = progress(loop, work)
                    following = 2 * look[1]
                if bar is None and spent > 1.0:
                    from tqdm import tqdm

                    bar = tqdm(total=run.duration, unit="s", unit_scale=True, leave=False, disable=None)  # silent where stderr is no terminal
                if bar is not None:
                    bar.update(float(work.reals[loop.TIME]) - bar.n)
            else:
                raise failure(loop, status, run, program, work, began, answers)
    except BaseException as error:  # an exception of the user's law or an interrupt: what was computed is not lost
        if getattr(error, "run", None) is None:
            with contextlib.suppress(AttributeError):
                error.run = trajectory_so_far(loop, run, program, work, began, answers)  # type: ignore[attr-defined]
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
            trajectory_so_far(loop, run, program, work, began, answers),
        )
    work.queue[c, row[loop.TAKEN] % work.queue.shape[1], : u.size] = u.ravel()
    answers[index].append(u.ravel())
    row[loop.TAKEN] += 1


def again(run: Run, **changes: Any) -> Trajectory:
    """The same run with some arguments changed, e.g. another accuracy."""
    return carry_out(dataclasses.replace(run, **changes))
