"""The linear loop around steady running, broken at the inputs that control laws drive, with sampling, hold and delay as they are.

    x' = f(x, h),   (z_(k+1), w_k) = update(x_k, h_k, z_k),   h(t) = w_(k-d) from t_k + e on,   delay = d period + e, 0 <= e < period

Its state at a sample is (x, z, w_(k-1), ... w_(k-d-1)); the step of x from sample to sample is that of the matrix exponential, exact for a hold with any
delay (K. J. Åström, B. Wittenmark, Computer-Controlled Systems, 3rd ed., 1997, section 2.3). The loop is broken where a command leaves a law: the
commands v that the plant gets are the input, the commands w that the laws give the output, and L = -w / v is the loop transfer of negative feedback.
"""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from toolbox.arguments import count_of, mapping
from toolbox.errors import SceneError, SimulationError
from toolbox.modelling.clocks import Clock, check_regular
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.components import Equations, Signal
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Controller, Sampled
from toolbox.modelling.start import place_starts
from toolbox.modelling.steady_point import Equilibrium, mode_numbers
from toolbox.modelling.two_directions import check_one_direction
from toolbox.simulation.budget import Budget
from toolbox.simulation.methods import EventExact
from toolbox.simulation.samples import Samples
from toolbox.simulation.simulate import simulate
from toolbox.steady_states.linear import at_rest, equilibrium, input_values, linearise, residual_functions
from toolbox.steady_states.linear_loop import LinearLoop, NoDerivative, acts, checked_smooth, zero_order_hold
from toolbox.steady_states.running import at_set_points

KICK = 0.02
"""Part of the states by which a run starts off steady running."""
SETTLING = 20_000
"""Samples that a loop is given to show where it is steady."""
STANDS = 1e-9
"""Slip [rad/s or m/s] below which a contact is taken to stand: what is found there instead of 0 is round-off, of either sign."""


@dataclass(frozen=True)
class SteadyLoop:
    """A closed loop at steady running: `loop(delay, only=i)` is its linear loop with some delay [s] of command i more, or of all, which only
    sampled laws have.

    signals: values of scalar states and commands at the point, by name;  drives: the commands;  start: states of the plant and memory of
    the laws for a run that begins KICK off the point.
    """

    signals: Mapping[str, float]
    actuated_signals: tuple[str, ...]
    loop: Callable[..., LinearLoop]
    start: Mapping[str, Any]


# -------------------------------------------------------------------------------------------------------------------------------- continuous laws
@dataclass(frozen=True)
class Broken(Controller):
    """A continuous law whose commands do not reach the plant: they are given as `opened.<signal>`."""

    holds_law: ClassVar[bool] = True

    law: Controller = dataclasses.field(default_factory=Controller)

    def continuous(self, signal: Signal) -> Equations:
        equations = self.law.continuous(signal)
        given = {f"opened.{name}" if name in self.law.actuated_signals else name: value for name, value in equations.outputs.items()}
        return dataclasses.replace(equations, outputs=given)


def continuous_steady_loop(loop: ClosedLoop, guess: Mapping[str, Any]) -> SteadyLoop:
    """Return the linear loop of laws that all act continuously. NoDerivative is raised if a law switches or its command is constant."""
    plant, inputs = loop.plant, loop.constant_inputs("a linear loop")
    point = equilibrium(loop, guess=guess or None)
    closed = point.plant
    own = {element.name for element in plant.elements}
    for element in closed.elements:
        if element.name not in own:
            raise NoDerivative(f"`{element.name}` of the law switches")
    flow, modes = residual_functions(closed)[0], mode_numbers(closed, point.modes)
    checked_smooth(lambda x: np.array(flow(0.0, x, point.inputs, closed.values, modes)[0]).ravel(), _slope(closed, point), point.states)
    broken = dataclasses.replace(loop, controllers=tuple(Broken(law, name=law.name) for law in loop.designed_controllers))
    drives = tuple(name for law in loop.designed_controllers for name in law.actuated_signals)
    commands = {plant.redirected_signals.get(name, name): float(point[plant.redirected_signals.get(name, name)]) for name in drives}
    state = {name: point[name] for name in closed.states}
    system = broken.system
    linear = linearise(
        broken, {**state, **{n: v for n, v in commands.items() if n in system.inputs}, **dict(inputs)},
        mode={name: word for name, word in point.modes.items() if name in own},
        inputs=tuple(commands), outputs=tuple(f"opened.{name}" for name in drives),
    )  # fmt: skip
    opened = LinearLoop(linear.A, linear.B, linear.C, linear.D, tuple(commands))
    acts(opened)
    start_of_run = {name: (1.0 - KICK) * point[name] if name in plant.states else point[name] for name in closed.states}
    return SteadyLoop(commands | _scalars(closed, point.states), opened.actuated_signals, lambda delay=0.0, only=None: opened, start_of_run)


def _slope(closed: HybridSystem, point: Equilibrium) -> np.ndarray:
    from toolbox.steady_states.equilibria import flow_slopes

    return flow_slopes(point)


def _scalars(closed: HybridSystem, x: np.ndarray) -> dict[str, float]:
    return {name: float(x[first]) for name, (first, size, _) in closed.states.items() if size is None}


# ----------------------------------------------------------------------------------------------------------------------------------- sampled laws
class SampledPoint:
    """The steady running of sampled laws, and the slopes of plant and laws there.

    Unknown are the states x, the held signals h that something reads, and the memories z: f(x, h) = 0, h = outputs(x, h, z), z = following(x, h, z).
    """

    def __init__(self, system: HybridSystem, plant: HybridSystem, clocks: Sequence[Clock], inputs: Mapping[str, float]):
        self.system, self.clocks = system, clocks
        self.u = input_values(system, inputs)
        field = at_rest(system, system.switched_equations.field)
        following, outputs = (
            [system.substitute_forces(ca.densify(each)) for each in pair]
            for pair in zip(*[(update.following, update.outputs) for update in system.updates], strict=True)
        )
        names, owners = [], []
        for c, update in enumerate(system.updates):
            entries = list(update.names) + [""] * (update.outputs.numel() - len(update.names))
            names += entries
            owners += [c] * len(entries)
        everything = ca.vertcat(field, *following, *outputs)
        used = system.once(
            ("read by laws",), lambda: np.any(np.array(ca.DM(ca.jacobian(everything, system.held).sparsity())) != 0, axis=0)
        ) | np.array([name in plant.inputs for name in names])
        self.places = np.flatnonzero(used)
        self.names = tuple(names[k] for k in self.places)
        self.owner = np.array([owners[k] for k in self.places])
        self.driven = np.flatnonzero([name in plant.inputs for name in self.names])
        held = system.held[self.places.tolist()]
        memory = ca.vertcat(*[update.memory for update in system.updates])
        noise = ca.vertcat(*[update.noise for update in system.updates])
        self.n, self.h, self.z = system.x.numel(), len(self.places), memory.numel()
        ends = np.cumsum([0, *(update.memory.numel() for update in system.updates)]).tolist()
        self.memory_of = [slice(first, last) for first, last in itertools.pairwise(ends)]

        def functions() -> tuple[ca.Function, ca.Function]:
            q = ca.vertcat(system.x, held, memory)
            values = ca.vertcat(field, ca.vertcat(*outputs)[self.places.tolist()], *following)
            values = ca.substitute(values, noise, ca.SX.zeros(noise.shape)) if noise.numel() else values
            symbols = [q, system.t, system.u, system.p, system.m]
            return ca.Function("step", symbols, [ca.densify(values)]), ca.Function("slope", symbols, [ca.densify(ca.jacobian(values, q))])

        self._value, self._slope = system.once(("sampled point", self.names), functions)
        self.m = np.ones(len(system.elements))

    def placed(self, states: Mapping[str, Any], memory: Mapping[str, Any], modes: Mapping[str, float]) -> bool:
        """Set the given modes, and the others by the direction of slip. Return False if a contact sticks, because the loop is not linear
        there."""
        x = np.zeros(self.n)
        place_starts(self.system, x, states)
        slips = np.array(self.system.slip_function(0.0, x, self.u, self.system.values, np.ones(self.m.size))).ravel()
        self.m = np.array([modes.get(e.name, -1.0 if slip < 0 else 1.0) for e, slip in zip(self.system.elements, slips, strict=True)])
        return not any(e.slides and mode == 0.0 for e, mode in zip(self.system.elements, self.m, strict=True))

    def with_outputs(self, states: Mapping[str, Any], memory: Mapping[str, Any]) -> np.ndarray:
        """Return q for states and memories by name, zero for missing names, with the outputs of the laws at this point."""
        q = np.zeros(self.n + self.h + self.z)
        place_starts(self.system, q[: self.n], states)
        place = self.n + self.h
        for update in self.system.updates:
            for name, (first, size) in update.places.items():
                q[place + first : place + first + count_of(size)] = memory.get(name, 0.0)
            place += update.memory.numel()
        for _ in range(2):
            q[self.n : self.n + self.h] = self.value(q)[self.n : self.n + self.h]
        return q

    def begun(self, states: Mapping[str, Any], commands: Mapping[str, float]) -> np.ndarray:
        """Return q at states, with the memory of the laws after their first sample under the present commands."""
        q = self.with_outputs(states, {})
        for j in self.driven:
            q[self.n + j] = commands[self.names[j]]
        q[self.n + self.h :] = self.value(q)[self.n + self.h :]
        return q

    def start(self, plant: HybridSystem, q: np.ndarray, kick: float = KICK) -> dict[str, Any]:
        """Return the start values of a run: states of the plant displaced by the fraction `kick`, and the memory and held outputs of the
        laws."""
        found: dict[str, Any] = {name: q[self.n + j] for j, name in enumerate(self.names) if name}
        for name, (first, size, _) in self.system.states.items():
            value = q[first] if size is None else q[first : first + size]
            found[name] = (1.0 - kick) * value if name in plant.states else value
        place = self.n + self.h
        for update in self.system.updates:
            for name, (first, size) in update.places.items():
                found[name] = q[place + first] if size is None else q[place + first : place + first + size]
            place += update.memory.numel()
        return found

    def value(self, q: np.ndarray) -> np.ndarray:
        """(f, outputs, following) at q = (x, h, z)."""
        return np.array(self._value(q, 0.0, self.u, self.system.values, self.m)).ravel()

    def slope(self, q: np.ndarray) -> np.ndarray:
        """Derivatives of `value` by q."""
        return np.array(self._slope(q, 0.0, self.u, self.system.values, self.m))

    def solved(self, guess: np.ndarray) -> np.ndarray | None:
        """The steady q next to a guess; None where none is found."""
        from scipy.optimize import least_squares

        still = np.zeros((guess.size, guess.size))
        still[self.n :, self.n :] = np.eye(guess.size - self.n)

        def residual(q: np.ndarray) -> np.ndarray:
            return self.value(q) - still @ q

        def slope(q: np.ndarray) -> np.ndarray:
            return self.slope(q) - still

        q = guess
        rows = np.abs(slope(q)) @ np.maximum(np.abs(q), 1.0) + np.abs(self.value(q)) + 1e-9
        if not np.isfinite(rows).all():
            raise NoDerivative("the slope of the law is not finite near steady running")
        try:
            with np.errstate(over="ignore", invalid="ignore"):  # far from steady running a law may be anything
                q = least_squares(
                    lambda q: residual(q) / rows, q, lambda q: slope(q) / rows[:, None], x_scale="jac", method="trf", xtol=1e-15, ftol=1e-15, gtol=1e-15
                ).x  # fmt: skip
        except ValueError:  # values that are not finite on the way
            return None
        for _ in range(6):
            a, b = slope(q), residual(q)
            if not np.isfinite(a).all():
                raise NoDerivative("the slope of the law is not finite at steady running")
            size = np.maximum(np.abs(q), 1e-6)
            step = size * np.linalg.lstsq(a * size / rows[:, None], -b / rows, rcond=1e-13)[0]
            if not np.abs(residual(q + step) / rows).sum() < np.abs(b / rows).sum():
                break
            q = q + step
        size = np.abs(slope(q)) @ np.abs(q) + np.abs(q) * (np.diag(still) > 0) + rows * 1e-12
        return q if (np.abs(residual(q)) <= 1e-11 * size + 1e-12 * rows).all() else None

    def slips(self, q: np.ndarray) -> np.ndarray:
        """Slips of all contacts at q, shape (elements,)."""
        return np.array(self.system.slip_function(0.0, q[: self.n], self.u, self.system.values, self.m)).ravel()

    def loop(self, slope: np.ndarray, delay: float = 0.0, only: int | None = None) -> LinearLoop:
        """The linear loop from the slopes at the steady q, with commands that come some delay [s] later than they do: all, or `only` one."""
        period = self.clocks[0].period
        lags = []
        for j in range(self.h):
            later = delay if j in self.driven and only in (None, self.driven.tolist().index(j)) else 0.0
            late = self.clocks[self.owner[j]].delay + later
            whole = int(np.floor(late / period * (1.0 + 1e-12)))
            lags.append((whole, max(late - whole * period, 0.0)))
        n, h, z = self.n, self.h, self.z
        depth = [whole + 1 for whole, _ in lags]
        first = n + z + np.concatenate([[0], np.cumsum(depth)]).astype(int)
        size = first[-1]
        a, b = np.zeros((size, size)), np.zeros((size, h))  # b: of the newest entry of each line
        drift, force = slope[:n, :n], slope[:n, n : n + h]
        now, late_part = np.zeros((n, h)), np.zeros((n, h))
        a[:n, :n], whole_part = zero_order_hold(drift, force, period)
        for fraction in {fraction for _, fraction in lags}:
            columns = [j for j in range(h) if lags[j][1] == fraction]
            now[:, columns] = zero_order_hold(drift, force[:, columns], period - fraction)[1]
        late_part[:] = whole_part - now
        for j in range(h):
            line = slice(first[j], first[j + 1])
            a[:n, line.stop - 1] += late_part[:, j]
            if depth[j] > 1:
                a[:n, line.stop - 2] += now[:, j]
                a[line.start + 1 : line.stop, line.start : line.stop - 1] = np.eye(depth[j] - 1)
            else:
                b[:n, j] += now[:, j]
            b[line.start, j] = 1.0
        law = np.zeros((h + z, size))  # outputs, then following
        law[:, :n], law[:, n : n + z] = slope[n:, :n], slope[n:, n + h :]
        for j in range(h):
            law[:, first[j + 1] - 1] += slope[n:, n + j]
        a[n : n + z] = law[h:]
        own = [j for j in range(h) if j not in self.driven]
        a += b[:, own] @ law[own]
        return LinearLoop(
            a, b[:, self.driven], law[self.driven], np.zeros((len(self.driven),) * 2), tuple(self.names[j] for j in self.driven), period
        )


def without_sensor_errors(loop: ClosedLoop) -> ClosedLoop:
    """Return the loop with sensors that read without noise and without steps."""
    quiet = loop.with_controllers(
        dataclasses.replace(law, noise={}, resolution={}) if isinstance(law, Sampled) else law for law in loop.controllers
    )
    return quiet.replace(parameters={name: value for name, value in loop.parameters.items() if ".sensors." not in name})


def sampled_steady_loop(loop: ClosedLoop, guess: Mapping[str, Any]) -> SteadyLoop:
    """The loop of sampled laws, with continuous ones as a part of the plant; raises NoDerivative where a law has none at steady running."""
    exact = without_sensor_errors(loop)
    check_regular(exact.assembly.clocks, "for a loop to have a linear form")
    plant, inputs, system, clocks = loop.plant, loop.constant_inputs("a linear loop"), exact.system, exact.assembly.clocks
    check_one_direction(system.elements, "The linear loop of a sampled law", "let the law act continuously")
    if any(update.from_callable for update in system.updates):
        raise NoDerivative("the law is a Python callable")
    periods = {clock.period for clock in clocks}
    if len(periods) > 1:
        raise SceneError(
            f"Argument `controller` must hold laws of one period to have a linear loop, but their periods are {sorted(periods)} s."
        )
    point = SampledPoint(system, plant, clocks, inputs)
    q, reason = None, "no steady running was found at which the law is smooth (where there is one, give a `guess` near to it)"
    for begin in _guesses(point, exact, guess):
        q = point.solved(begin)
        if q is not None:
            break
    if q is None:
        raise NoDerivative(reason)
    for element, mode, slip in zip(system.elements, point.m, point.slips(q), strict=True):
        if element.law is not None and mode * slip <= STANDS:
            raise SceneError(
                f"Argument `controller` must keep `{element.name}` sliding at steady running, but its slip is {mode * slip:.3g} {element.slip_unit}."
            )
    slope = point.slope(q)
    checked_smooth(point.value, slope, q)
    acts(point.loop(slope))
    signals = _scalars(system, q[: point.n]) | {name: float(q[point.n + j]) for j, name in enumerate(point.names) if name}
    return SteadyLoop(
        signals,
        tuple(point.names[j] for j in point.driven),
        lambda delay=0.0, only=None: point.loop(slope, delay, only),
        point.start(plant, q),
    )


def _guesses(point: SampledPoint, loop: ClosedLoop, guess: Mapping[str, Any]) -> Iterator[np.ndarray]:
    """Where to look for steady running: where the continuous forms are steady, where laws that take over there begin, where the set-points are kept, at the
    start, and where a run goes from there.

    Sets the modes of `point` to those of each guess.
    """
    plant, candidates = loop.plant, smooth_points(loop, guess)
    for known in candidates:
        states = {name: known[name] for name in plant.states}
        memory = {name: known[name] for update in point.system.updates for name in update.places if name in known.plant.states}
        if point.placed(
            states,
            memory,
            {element.name: mode for element, mode in zip(known.plant.elements, mode_numbers(known.plant, known.modes), strict=True)},
        ):
            yield point.with_outputs(states, memory)
    for known in candidates:
        states = {name: known[name] for name in plant.states}
        if point.placed(states, {}, {}):
            yield point.begun(states, {point.names[j]: known[point.names[j]] for j in point.driven})
    states = {name: value for name, value in guess.items() if point.system.state_index(name) is not None or name in point.system.signals}
    states = states or ({name: candidates[-1][name] for name in plant.states} if candidates else {})
    if point.placed(states, {}, {}):
        yield point.with_outputs(states, {})
    duration = SETTLING * max(clock.period for clock in point.clocks)
    try:
        run = simulate(loop, duration, start=states, method=EventExact(budget=Budget(steps=1_000_000)))
    except SimulationError:
        return
    yield from _settled(point, plant, run.at(np.linspace(0.5, 1.0, 501) * duration))


def _settled(point: SampledPoint, plant: HybridSystem, recorded: Samples[np.ndarray]) -> Iterator[np.ndarray]:
    """Where a run ends, and its mean."""
    for reading in (lambda name: recorded[name][-1], lambda name: recorded[name].mean(axis=0)):
        states = {name: reading(name) for name in plant.states}
        memory = {name: reading(name) for update in point.system.updates for name in update.places}
        if point.placed(states, memory, {}):
            yield point.with_outputs(states, memory)


def smooth_points(loop: ClosedLoop, guess: Mapping[str, Any]) -> list[Equilibrium]:
    """Return guesses of steady running: the steady state of the continuous forms, and the steady state of the plant at the set-points of
    the laws.

    A set-point is an input of the closed loop: `top.reference` is that of the signal `top.speed`.
    """
    found: list[Equilibrium] = []
    with contextlib.suppress(SceneError):
        found.append(equilibrium(loop, guess=guess or None))
    with contextlib.suppress(SceneError):
        found.append(at_set_points(loop))
    return found


# ------------------------------------------------------------------------------------------------------------------------------------- both kinds
def steady_loop(loop: ClosedLoop, guess: Mapping[str, Any] | None = None) -> SteadyLoop:
    """A loop at steady running; guess: states of the plant near to it.

    Raises SceneError as `simulate` does and where there is no law, NoDerivative where there is no linear loop.
    """
    near = mapping("guess", guess)
    if not loop.controllers:
        raise SceneError("Argument `loop` must contain a controller, but it has none: give one, `closed_loop(plant, controller)`.")
    if loop.depends_on_time:
        raise NoDerivative("time itself enters the equations of the loop")
    place_starts(loop.system, np.zeros(loop.system.x.numel()), {name: value for name, value in near.items() if not _remembered(loop, name)})
    return (sampled_steady_loop if loop.is_sampled else continuous_steady_loop)(loop, near)


def linear_loop(loop: ClosedLoop) -> LinearLoop:
    """Return the linear loop at steady running. Without a law, the machine alone is returned, without commands.

    Raises SceneError where no steady running is found, NoDerivative where nothing is linear there.
    """
    if loop.controllers:
        return steady_loop(loop).loop(0.0)
    if loop.depends_on_time:
        raise NoDerivative("time itself enters the equations of the machine")
    point = equilibrium(loop)
    if any(
        element.slides and mode == 0.0 for element, mode in zip(point.plant.elements, mode_numbers(point.plant, point.modes), strict=True)
    ):
        raise NoDerivative("a contact sticks at steady running")
    slope = _slope(point.plant, point)
    machine, modes = point.plant, mode_numbers(point.plant, point.modes)
    checked_smooth(lambda x: np.array(machine.rhs(0.0, x, point.inputs, machine.values, modes)).ravel(), slope, point.states)
    n = slope.shape[0]
    return LinearLoop(slope, np.zeros((n, 0)), np.zeros((0, n)), np.zeros((0, 0)), ())


def _remembered(loop: ClosedLoop, name: str) -> bool:
    """Whether a sampled law has a state of that name."""
    return any(name in update.places for update in loop.system.updates)


def smooth_start(loop: ClosedLoop) -> dict[str, Any]:
    """Start values of a run near smooth running: states of the plant, and the commands that sampled laws hold, as if they had just taken over.

    With what the laws remember where their loop is linear. Raises SceneError where no steady running is known.
    """
    with contextlib.suppress(NoDerivative, SceneError):
        return dict(steady_loop(loop).start)
    points = smooth_points(loop, {})
    if not points:
        raise SceneError(
            "No steady running of this loop is known to begin from: give the states of the plant there, as `guess` or `starts`."
        )
    held = [name for update in loop.system.updates for name in update.names if name in loop.plant.inputs]
    return {name: points[0][name] for name in (*loop.plant.states, *held)}
