"""What a simulation is asked: one value, made once, checked once, and handed on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import FunctionType
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import finite_array, is_finite_number, mapping
from toolbox.compilation.program import ExpressionKey
from toolbox.errors import SceneError, suggest
from toolbox.files.units import in_si
from toolbox.modelling.closed_loop import closed_loop
from toolbox.modelling.elements import check_one_direction
from toolbox.modelling.hybrid_system import HybridSystem, checked_plant
from toolbox.modelling.inputs import Shape, Table, Typed
from toolbox.modelling.laws import Controller, Sampled
from toolbox.modelling.regularisation import SmoothSystem, checked_widths, smoothed
from toolbox.modelling.steady_point import Equilibrium
from toolbox.simulation.carry_out import carry_out
from toolbox.simulation.methods import Method, Smoothing, TimeStepping, method_of
from toolbox.simulation.run import UNHURRIED, Budget, Run
from toolbox.simulation.run_state import RunState
from toolbox.simulation.samples import Samples, short


@dataclass(frozen=True)
class Request:
    """The arguments of `simulate`, which says what each of them means."""

    plant: HybridSystem
    duration: float | str
    start: Mapping[str, Any] | Samples | Equilibrium | RunState | None = None
    inputs: Mapping[str, Any] | None = None
    parameters: Mapping[str, Any] | None = None
    controller: Any = None
    sample_time: float | str | None = None
    method: Method | str = "event"
    accuracy: float = 1e-6
    output_times: Sequence[float] | np.ndarray | None = None
    budget: Budget | None = None

    def checked(self) -> Run:
        """The run that is asked for, with all names resolved; raises SceneError as `simulate` does."""
        duration = in_si(self.duration, "s", "duration")
        period = in_si(self.sample_time, "s", "sample_time")
        method = self._checked_numbers(duration)
        begin, instant = self._checked_start()
        grid = _checked_times(self.output_times, begin.time if isinstance(begin, RunState) else 0.0, duration)
        declared, plant = self.plant, self._varied_plant(period)
        original, sharp = (each.sharp if isinstance(each, SmoothSystem) else each for each in (declared, plant))
        system, clocks, laws, seeds = closed_loop(original, sharp, self.controller, period)
        inputs = self.inputs or {}
        changing = [name for name in inputs if not system.has_signal(name) and declared.has_parameter(name)]
        if changing:
            system = system.varying(changing)
        if isinstance(method, TimeStepping):
            check_one_direction(
                system.elements, f"`method={method.text!r}`", "locate its events, by 'event', or give a ContactProblem to `step_contacts`"
            )
        if isinstance(method, Smoothing):
            if isinstance(plant, SmoothSystem):
                raise SceneError("Argument `method` must not be 'smoothed' for a plant that is smooth already.")
            widths = checked_widths(system, 1.0 if method.width is None else method.width)
            if method.width is not None:
                method = Smoothing(widths, method.tolerance)
        if isinstance(plant, SmoothSystem):
            system = smoothed(system, plant.widths, matched=plant.matched)
        kinds, values, typed = input_kinds(system, inputs)
        if isinstance(begin, RunState):
            begin.check(system, clocks, laws)
        else:
            if instant is not None:
                begin |= _remembered(instant, system, clocks, laws)
            begin = RunState.begun(system, plant, clocks, begin)
        if changing:  # what parts demand of their fields must hold where all are lowest, and where all are highest
            for extreme in (min, max):
                plant.with_parameters({name: extreme(_range(values[name])) for name in changing if _range(values[name])})
        duration = float(duration)
        numbers = {name: in_si(value, declared._parameter(name).unit, name) for name, value in (self.parameters or {}).items()}
        return Run(
            plant=plant, system=system, duration=duration, start=begin, inputs=values, kinds=kinds, clocks=clocks, laws=laws,
            accuracy=float(self.accuracy), output_times=grid, longest_step=duration / 256, seeds=seeds, method=method,
            budget=self.budget or UNHURRIED, solver=carry_out,
            question=(declared, typed, numbers, self.controller),
        )  # fmt: skip

    def _checked_numbers(self, duration: float) -> Method:
        """The method, after all that can be said of the arguments one by one."""
        checked_plant(self.plant)
        if not is_finite_number(duration) or duration < 0:
            raise SceneError(f"Argument `duration` must be a finite number >= 0 s, but it is {duration!r}.")
        method = method_of(self.method)
        if not is_finite_number(self.accuracy) or not 1e-13 <= self.accuracy <= 0.1:
            raise SceneError(f"Argument `accuracy` must be a number between 1e-13 and 0.1, but it is {self.accuracy!r}.")
        budget = UNHURRIED
        if self.budget is not None:
            if not isinstance(self.budget, Budget):
                raise SceneError(f"Argument `budget` must be a Budget, such as Budget(seconds=60), but it is {self.budget!r}.")
            budget = self.budget
            budget.check()
        method.check(duration, budget.steps)
        if self.sample_time is not None and self.controller is None:
            raise SceneError("Argument `sample_time` must come with a `controller`, but there is none.")
        return method

    def _checked_start(self) -> tuple[dict[str, Any] | RunState, Samples | None]:
        """The start by state or as a whole, and the instant of a run from which it is taken, if it is."""
        start, instant = self.start, None
        if isinstance(start, RunState):
            mapping("inputs", self.inputs), mapping("parameters", self.parameters)
            return start, None
        if isinstance(start, Samples):
            instant = start
            start = _states_of(self.plant, instant)
        elif isinstance(start, Equilibrium):
            start = {name: start[name] for name in start.plant.states}
        for word, given in (("start", start), ("inputs", self.inputs), ("parameters", self.parameters)):
            mapping(word, given)
        return dict(start or {}), instant

    def _varied_plant(self, period: float | None) -> HybridSystem:
        """The plant with the parameters of this run."""
        plant, parameters = self.plant, self.parameters
        if not parameters:
            return plant
        both = [name for name in parameters if self.inputs and name in self.inputs]
        if both:
            raise SceneError(f"Argument `{both[0]}` must be given in `inputs` or in `parameters`, but it is in both.")
        try:
            return plant.with_parameters(parameters)
        except SceneError:
            sharp = plant.sharp if isinstance(plant, SmoothSystem) else plant
            closed = closed_loop(sharp, sharp, self.controller, period)[0]
            for name in parameters:
                if closed.has_parameter(name) and not plant.has_parameter(name):
                    raise SceneError(
                        f"Argument `{name}` must be a parameter of the plant, but it is a number of the law: give it to the law."
                    ) from None
            raise


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


def _states_of(plant: HybridSystem, instant: Samples) -> dict[str, Any]:
    """The states of a plant at one instant of a run of it; raises SceneError where the run has none of that name."""
    if instant.time.size != 1:
        raise SceneError(f"Argument `start` must be one instant of a run, such as `run.at(12.5)`, but it holds {instant.time.size} times.")
    for name in plant.states:
        if name not in instant:
            raise SceneError(f"Argument `start` must hold the state `{name}`, but the run it comes from has none.")
    return {name: _value(instant, name, size) for name, (_, size, _) in plant.states.items()}


def _remembered(instant: Samples, system: HybridSystem, clocks: Sequence[tuple[float, float]], laws: Sequence[Any]) -> dict[str, Any]:
    """What continuous laws remember at an instant of a run, by state.

    Raises SceneError where sampled laws of that run, and of the one that is to begin there, remember something: the record of a run does not hold it.
    """
    before = instant.program.system
    remember = any(update.memory.numel() for update in system.updates) or any(delay > 0.0 for _, delay in clocks)
    if before.updates and (remember or not all(isinstance(law, FunctionType) for law in laws)):
        raise SceneError(
            "Argument `start` must be `run.last` for a run to go on where its laws are sampled, because an instant such as `run.at(12.5)` does not "
            "hold what they remember: end the run there. Where the laws shall begin anew, give the states by name, `{name: run.at(12.5)[name] for "
            "name in plant.states}`."
        )
    return {name: _value(instant, name, size) for name, (_, size, _) in system.states.items() if name in before.states}


def _value(instant: Samples, name: str, size: int | None) -> Any:
    return np.squeeze(instant[name]) if size is None else np.ravel(instant[name])


def input_kinds(system: HybridSystem, inputs: Mapping[str, Any]) -> tuple[tuple[tuple[str, Any], ...], dict[str, Any], list[Any]]:
    """How each input is given (number, table, shape with its size, expression), which is structure, the checked values, and those that were typed."""
    kinds: list[tuple[str, Any]] = []
    typed: list[Any] = []
    values: dict[str, Any] = {}
    for name, value in inputs.items():
        entry = system.inputs.get(name)
        if entry is None:
            if name in system.signals:
                raise SceneError(f"Argument `{name}` must not be an input: a part of the plant gives this signal.")
            raise SceneError(f"There is no input `{name}`: {suggest(name, system.inputs)}")
        if isinstance(value, str):
            value = in_si(value, entry.unit, name)
        elif isinstance(value, Typed):
            value = value.made(name, entry.unit)
        elif isinstance(value, (tuple, list, np.ndarray)) and len(value) == 2:
            times, numbers = (
                in_si(row, unit, f"{name}.{word}") for row, unit, word in zip(value, ("s", entry.unit), ("times", "values"), strict=True)
            )
            typed.append(numbers)
            value = Table.of(name, times, numbers)
        typed.append(value.typed if isinstance(value, (Table, Shape)) else value)
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
            raise SceneError(
                f"Argument `{name}` must be a finite number, (times, values), a shape or an expression of time, but it is {short(value)}{_hint(value)}."
            )
        if name in system.parameters:
            system.parameters[name].check(np.array(_range(value)))
        values[name] = value
    return tuple(sorted(kinds, key=lambda pair: pair[0])), values, typed


def _hint(value: Any) -> str:
    """What to write in place of an input that cannot be taken."""
    if getattr(value, "__name__", "") == "sweep":
        return ": the swept sine is `toolbox.inputs.sweep`"
    if isinstance(value, (tuple, list, np.ndarray)):
        return ": values need their times, `(times, values)`"
    return ": write a formula of the symbol `toolbox.time`, such as `1e4 + 500 * casadi.sin(3 * time)`" if callable(value) else ""


def _range(value: Any) -> tuple[float, ...]:
    """Smallest and largest value of an input; none for a formula of time."""
    if isinstance(value, Table):
        return float(value.values.min()), float(value.values.max())
    return value.range() if isinstance(value, Shape) else () if isinstance(value, ca.SX) else (value,)


def continuous_loop(
    plant: HybridSystem,
    controller: Any = None,
    *,
    inputs: Mapping[str, float] | None = None,
    parameters: Mapping[str, Any] | None = None,
) -> HybridSystem:
    """The plant with its controllers as parts, each in its continuous form, also where it will run sampled.

    `controller` and `parameters` are those of `simulate`; a law is designed on the declared plant. Raises SceneError for a law without a continuous form, such
    as a Python callable.
    """
    laws = []
    for given in [] if controller is None else controller if isinstance(controller, (list, tuple)) else [controller]:
        law = given.law if isinstance(given, Sampled) else given
        if not isinstance(law, Controller):
            raise SceneError(f"Argument `controller` must be a Controller with a continuous form, but it is {law!r}.")
        laws.append(law)
    return Request(plant, 0.0, inputs=inputs, parameters=parameters, controller=laws or None).checked().system
