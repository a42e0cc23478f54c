"""What acts on a body with many contacts from outside: inputs in time, and sampled control laws that measure it.

A plant without dynamics stands for the body: its inputs are those of the problem, its states `<output>.position` and `<output>.speed` of every output. It
reads inputs and closes the loop as every plant does, so names, units, noise, delays and laws in Python mean the same here and in `simulate`.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import mapping
from toolbox.contacts.problem import ContactProblem
from toolbox.errors import ControllerError, SceneError
from toolbox.files.units import in_si
from toolbox.modelling.clamps import passing_nan
from toolbox.modelling.clocks import check_regular
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.closing import laws_of
from toolbox.modelling.components import Component, Equations, Signal
from toolbox.modelling.composition import compose
from toolbox.modelling.elements import state
from toolbox.modelling.elements import time as clock
from toolbox.modelling.hybrid_system import HybridSystem, SampledUpdate
from toolbox.modelling.input_kinds import input_kinds
from toolbox.modelling.inputs import Shape, Table
from toolbox.modelling.laws import External, fresh
from toolbox.simulation.failures import not_finite


@dataclass(frozen=True)
class BodySignals(Component):
    """The inputs of a contact problem and the positions and speeds of its outputs, each with its unit, as the signals of a plant."""

    inputs: tuple[tuple[str, str], ...] = ()
    outputs: tuple[tuple[str, str], ...] = ()

    def equations(self, signal: Signal) -> Equations:
        for name, unit in self.inputs:
            signal(name, unit, default=0.0)
        kinds = (("position", ""), ("speed", "/s"))
        return Equations(flow={state(f"{name}.{word}", unit + per): 0.0 for word, per in kinds for name, unit in self.outputs})


def signals_of(problem: ContactProblem, with_outputs: bool) -> HybridSystem:
    """The plant without dynamics that stands for a body; states for its outputs only where somebody measures them."""
    names = tuple((name, problem.unit(name)) for name in (*problem.force_inputs, *problem.surface_velocity))
    outputs = tuple((name, problem.output_unit(name)) for name in problem.outputs) if with_outputs else ()
    return compose(BodySignals(names, outputs or (("body", "m"),)))


class Acting:
    """The inputs of a run at its instants, and the laws that drive some of them.

    values: {input: (t,) what acts}; those that laws drive are written as the run goes on.  driven: their names.
    """

    def __init__(self, problem: ContactProblem, inputs: Any, times: np.ndarray, controller: Any = None, sample_time: Any = None):
        self.problem, self.times = problem, times
        plant = signals_of(problem, controller is not None)
        closed = ClosedLoop(plant, laws_of(controller, in_si(sample_time, "s", "sample_time"))).assembly
        self.system, self.clocks, self.seeds = closed.system, closed.clocks, closed.seeds
        check_regular(self.clocks, "for steps of one length")
        if len(self.system.parts) > 1 + len(self.clocks):
            raise SceneError(
                "Argument `controller` must hold sampled laws: give `sample_time`, because steps of one length know no continuous ones."
            )
        _, given, _ = input_kinds(self.system, mapping("inputs", inputs))
        self.values = {name: _at(name, value, times) for name, value in given.items()}
        self._sides = {name: _sides(name, value, times, self.values[name]) for name, value in given.items()}
        own, updates = (*problem.force_inputs, *problem.surface_velocity), self.system.updates
        self.driven = tuple(name for update in updates for name in update.names if name in own)
        if updates and not self.driven:
            names = ", ".join(f"`{name}`" for update in updates for name in update.names)
            raise SceneError(
                f"Argument `controller` must drive an input of the body, {', '.join(f'`{name}`' for name in own)}, but it drives {names}."
            )
        self.values |= {name: np.zeros(times.size) for name in self.driven}
        externals = iter([part for part in self.system.parts if isinstance(part, External)])
        callables = iter(closed.callables)
        self.controllers = [
            _Law(self.system, update, seed, next(externals), fresh(next(callables)))
            if update.from_callable
            else _Law(self.system, update, seed)
            for update, seed in zip(updates, self.seeds, strict=True)
        ]
        if self.controllers:
            self._schedule()

    def _schedule(self) -> None:
        """Periods and delays in steps, and what the laws read beside the body."""
        step = self.times[1] - self.times[0]
        self.every: list[int] = []
        self.after: list[int] = []
        for own in self.clocks:
            for word, length, into in (("sample_time", own.period, self.every), ("delay", own.delay, self.after)):
                steps = round(length / step)
                if abs(length / step - steps) > 1e-6 or (word == "sample_time" and not steps):
                    raise SceneError(f"Argument `{word}` must be a whole number of steps of {step:.9g} s, but it is {length:g} s.")
                into.append(steps)
        system = self.system
        entries = list(system.inputs.values())
        defaults = ca.Function("defaults", [system.p], [ca.vertcat(*(entry.default for entry in entries)) if entries else ca.SX(0, 1)])
        self.inputs = [entry.name for entry in entries]
        self.defaults = np.array(defaults(system.values), float).ravel()
        self.held = np.zeros(system.held.numel())
        self.waiting: list[tuple[int, int, np.ndarray]] = []
        self.weights = np.array(list(self.problem.outputs.values())).reshape(-1, self.problem.size)

    def over(self, name: str, i: int) -> tuple[float, float]:
        """An input at the begin and at the end of the step that ends at instant i; what laws drive is the same in both."""
        begin, end = self._sides.get(name, (self.values[name][1:],) * 2)
        return float(begin[i - 1]), float(end[i - 1])

    def hold(self, i: int, q: np.ndarray, v: np.ndarray) -> None:
        """Take the samples that are due at instant i, and hold what is due over the step that begins there."""
        if not self.controllers:
            return
        x = np.concatenate([self.weights @ q, self.weights @ v])
        u = self.defaults.copy()
        for k, name in enumerate(self.inputs):
            if name in self.values:
                u[k] = self.values[name][i]
        for k, law in enumerate(self.controllers):
            if i % self.every[k] == 0:
                self.waiting.append((i + self.after[k], k, law.sample(float(self.times[i]), x, u, self.held)))
        for due, k, outputs in [entry for entry in self.waiting if entry[0] <= i]:
            first = self.controllers[k].update.first_held
            self.held[first : first + outputs.size] = outputs
            self.waiting.remove((due, k, outputs))
        for law in self.controllers:
            for k, name in enumerate(law.update.names):
                if name in self.driven:
                    self.values[name][i + 1] = self.held[law.update.first_held + k]
                    if i == 0:
                        self.values[name][0] = self.values[name][1]


class _Law:
    """One sampled law: its memory, and what it answers."""

    def __init__(self, system: HybridSystem, update: SampledUpdate, seed: int, part: External | None = None, law: Any = None):
        from toolbox.stepping.noise import channel_key  # here, because LLVM is slow to import

        self.system, self.update, self.part, self.law, self.taken = system, update, part, law, 0
        self.memory = np.zeros(update.memory.numel())
        self.keys = [channel_key(seed, zlib.crc32(name.encode())) for name in update.channels]
        known = [system.t, system.x, system.u, system.p, system.held]
        if part is None:
            asked = passing_nan([update.following, update.outputs], system.p)
            known += [update.memory, update.noise]
        else:
            asked = [ca.vertcat(*(system.expression(name) for name in part.measured_signals))]
        self.function = ca.Function("law", known, [ca.densify(each) for each in asked])
        self.numbers = system.values

    def sample(self, t: float, x: np.ndarray, u: np.ndarray, held: np.ndarray) -> np.ndarray:
        """The outputs, behind them the memory as it was, at a sample."""
        from toolbox.stepping.noise import normal

        noise = [normal(key, self.taken) for key in self.keys]
        self.taken += 1
        if self.part is None:
            following, outputs = (
                np.array(found, float).ravel() for found in self.function(t, x, u, self.numbers, held, self.memory, noise)
            )
            if not (np.isfinite(following).all() and np.isfinite(outputs).all()):
                raise ControllerError(
                    not_finite(self.system, self.system.updates.index(self.update), t, np.concatenate([following, outputs]))
                )
            self.memory = following
            return outputs
        measured = np.array(self.function(t, x, u, self.numbers, held), float).ravel()
        return self.part.answer(self.law, t, measured, dict(zip(self.update.channels, noise, strict=True)))


def constants(problem: ContactProblem, inputs: Mapping[str, Any] | None) -> Acting:
    """Inputs that are numbers, for a state of rest; raises SceneError for others."""
    acting = Acting(problem, inputs, np.zeros(1))
    for name, value in (inputs or {}).items():
        if not np.isscalar(value):
            raise SceneError(f"Argument `inputs` must be numbers for a state of rest, but `{name}` is {value!r}.")
    return acting


def _at(name: str, given: Any, times: np.ndarray) -> np.ndarray:
    """Values of an input at the given times."""
    if isinstance(given, Table):
        return np.interp(times, given.times, given.values)
    if isinstance(given, Shape):
        symbol = ca.SX.sym("c", len(given.coefficients))
        given = ca.substitute(given.expression(clock, symbol), symbol, ca.SX(list(given.coefficients)))
    if not isinstance(given, ca.SX):
        return np.full(times.shape, given)
    values = np.array(ca.Function("input", [clock], [given])(times[None])).ravel()
    if not np.isfinite(values).all():
        raise SceneError(f"Argument `{name}` must be finite at all times, but it is not.")
    return values


def _sides(name: str, given: Any, times: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An input at the begin and at the end of every step: where it jumps between two steps, each has the side that is its own."""
    if times.size == 1:
        return values[:0], values[:0]
    near = 1e-9 * (times[1] - times[0])
    before, after = (_at(name, given, times + shift) for shift in (-near, near))
    jumps = np.abs(after - before) > 1e-6 * np.abs(values).max()
    return np.where(jumps, after, values)[:-1], np.where(jumps, before, values)[1:]
