"""Exact derivatives of a run: of its states, signals, event times and measures, with respect to start states, parameters and inputs.

Between events the variational equations are carried along by the very steps of the run; at events saltation matrices account for the change of the event's
time (see `toolbox.orbits.variational`). Nothing is differenced, so one run gives as many derivatives as asked for, to the accuracy of the run itself.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from toolbox.errors import SceneError
from toolbox.files.printing import columns
from toolbox.halving import zero
from toolbox.messages import sign_of_life
from toolbox.modelling.clocks import check_regular
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.laws import names
from toolbox.modelling.numbers import Number, memory_places
from toolbox.modelling.start import place_start
from toolbox.orbits.sampled_memory import check_laws
from toolbox.simulation.methods import Explicit
from toolbox.simulation.trajectory import Trajectory


class Sensitivity:
    """Derivatives of a run with respect to k numbers, the result of `sensitivity`.

    With the result `d`:

    - `d["bit.speed"]`: derivatives of a signal at the times `d.time`, shape (nt, k);
    - `d.end("bit.speed")`: at the end of the run, shape (k,);
    - `d.event_times`: derivatives of the times of events, shape (events, k);
    - `d.time_in("bit", "stick")`: derivatives of the time in a mode, shape (k,).

    Derivatives of signals are taken at a fixed time. If a signal jumps at an event, the effect of the shifted event on
    the signal is not in `d["..."]`: it follows from `d.event_times`.

    Attributes
    ----------
    run
        The trajectory.
    to
        Names of the k numbers, in the order of the last axis.
    time
        Times of the derivatives [s], the recorded times of the run, shape (nt,).

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, sensitivity, simulate
    >>> d = sensitivity(simulate(compose(BlockOnBelt()), "20 s"), "block.mass")
    >>> print(d["block.speed"].shape, d.time_in("belt", "stick").round(2), "s/kg")
    (41, 1) [-0.47] s/kg
    """

    def __init__(self, run: Trajectory, to: tuple[str, ...], order: np.ndarray, columns: tuple[int, ...], tangent: Any):
        self.run, self.to, self.time = run, to, run.time
        self._order, self._columns = order, columns
        self._own = order.size - len(columns)
        self._tangent = tangent
        self.event_times: np.ndarray = tangent.event_times[:, order]

    @property
    def loop(self) -> ClosedLoop:
        """The loop that was simulated."""
        return self.run.run.loop

    @cached_property
    def states(self) -> np.ndarray:
        """Derivatives of all states at `time`, shape (nt, n, k)."""
        return self._at_times()[:, : self.run.program.system.x.numel(), self._order]

    def _at_times(self) -> np.ndarray:
        return self._tangent.nodes if self.run.every_step is self.run else self._between(self.run.time)

    def __getitem__(self, name: str) -> np.ndarray:
        """Derivatives of a signal, shape (nt, k), or (nt, size, k) of a vector signal; raises SceneError for an unknown name."""
        values = self._of(name, self._at_times(), self.run)
        return values[:, 0] if values.shape[1] == 1 else values

    def end(self, name: str) -> np.ndarray:
        """Return the derivatives of a signal at the end of the run, shape (k,). For a vector signal, shape (size, k).

        Parameters
        ----------
        name
            Name of the signal.
        """
        values = self._of(name, self._tangent.end[None], self.run.at(self.run.end))[0]
        return values[0] if values.shape[0] == 1 else values

    def _of(self, name: str, tangent: np.ndarray, samples: Any) -> np.ndarray:
        slope, n = self._slopes(name, samples), tangent.shape[1]
        values = slope[:, :, 1 : 1 + n] @ tangent
        values[:, :, self._own :] += slope[:, :, 1 + n :]
        return values[:, :, self._order]

    def _slopes(self, name: str, samples: Any) -> np.ndarray:
        """Partial derivatives of a signal with respect to time, states, held signals and parameters, shape (nt, size, ...)."""
        program = self.run.program
        key = ("slope of", name, self._columns)
        function = program.outputs.get(key)
        if function is None:
            system, p, expression = program.system, program.expressions[0], program.closed(program.system.expression(name))
            chosen = ca.vertcat(system.t, system.x, system.held, *[p[c] for c in self._columns])
            slope = ca.densify(ca.jacobian(expression, chosen))
            function = ca.DM(slope) if slope.is_constant() else ca.Function("slope", [system.t, system.x, p, system.m], [slope])
            program.outputs[key] = function
        if isinstance(function, ca.DM):  # as of a signal that is a state
            return np.broadcast_to(np.array(function), (samples.time.size, *function.shape))
        p = np.repeat(self.run.parameters[:, None], samples.time.size, axis=1)
        p[program.first_held :] = samples.held.T
        slope = np.array(function(samples.time[None], samples.states.T, p, samples.mode.T.astype(float)))
        return slope.reshape(slope.shape[0], samples.time.size, -1).transpose(1, 0, 2)

    def _between(self, times: np.ndarray) -> np.ndarray:
        return self._variational.between(self.run.every_step, self._tangent.nodes, self._own, times)

    @property
    def _variational(self) -> Any:
        from toolbox.orbits.variational import variational_equations

        return variational_equations(self.run.every_step.program, self._columns)

    def time_in(self, element: str, mode: str, after: float = 0.0) -> np.ndarray:
        """Return the derivatives of `run.time_in(element, mode, after)`, shape (k,).

        Parameters
        ----------
        element
            Name of the contact.
        mode
            Mode of the contact, such as "stick".
        after
            Begin of the window [s], by default 0.
        """
        self.run.time_in(element, mode, after)
        total = np.zeros(len(self.to))
        for event, row in zip(self.run.events, self.event_times, strict=True):
            if event.element == element and event.time > after:
                total += row * ((event.before == mode) - (event.after == mode) * 1.0)
        return total

    def peak(self, name: str, after: float = 0.0) -> np.ndarray:
        """Return the derivatives of the largest value of a scalar signal after a time [s], shape (k,).

        These are the derivatives of the signal at the time of the peak. A shift of this time has no effect, because the
        slope at the peak is zero. Raises SceneError if the largest value is at an end of the window, because it is then
        no peak.

        Parameters
        ----------
        name
            Name of a scalar signal.
        after
            Begin of the window [s], by default 0.
        """
        from toolbox.measuring.measure import extent

        nodes = self.run.every_step
        t = extent(nodes, name, after).time_of_maximum  # the largest node may belong to another peak
        place = int(np.searchsorted(nodes.time, t, side="right"))
        low, high = max(nodes.time[max(place - 2, 0)], after), nodes.time[min(place + 1, nodes.time.size - 1)]
        if min(t - max(after, nodes.time[0]), nodes.end - t) < 1e-6 * (high - low):
            raise SceneError(f"Argument `name` must be a signal with a peak inside the run, but `{name}` is largest at its end.")
        for width in (high - low) * np.logspace(-6, 0, 7):
            first, last = max(t - width, low), min(t + width, high)
            if self._rate(name, first) > 0.0 > self._rate(name, last):
                t = zero(lambda at: self._rate(name, at), first, last, 1e-15 * nodes.end, 1e-14)
                break
        return self._of(name, self._between(np.array([t])), nodes.at([t]))[0, 0]

    def mean_square(self, name: str, target: float = 0.0, after: float = 0.0) -> np.ndarray:
        """Return the derivatives of `measure.mean_square(run, name, target, after=after)`, shape (k,).

        A jump of the signal at an event contributes through the time of the event.

        Parameters
        ----------
        name
            Name of a scalar signal.
        target
            Value from which the signal deviates, in SI, by default 0.
        after
            Begin of the window [s], by default 0.
        """
        from toolbox.measuring.energy import gauss
        from toolbox.simulation.samples import window

        nodes = self.run.every_step
        begin, end = window(self.run, after, None)
        total = np.zeros(len(self.to))
        for weights, samples in gauss(self.run, begin, end):
            slopes = self._of(name, self._between(samples.time), samples)[:, 0]
            total += 2.0 * (weights * (samples[name] - target)) @ slopes
        square = (nodes[name] - target) ** 2
        times, first = np.unique(nodes._event_arrays[0], return_index=True)
        for t, row in zip(times, self.event_times[first], strict=True):
            if begin < t < end:
                left, right = np.searchsorted(nodes.time, t), np.searchsorted(nodes.time, t, side="right") - 1
                total += (square[left] - square[right]) * row
        return total / (end - begin)

    def settling(self, name: str, target: float, band: float = 0.02, *, after: float = 0.0, size: float | None = None) -> np.ndarray:
        """Return the derivatives of `measure.settling(run, name, target, band, ...)`, shape (k,): -(dy/dp) / y' at the last crossing of the band.

        Raises SceneError if the signal does not stay in the band until the end of the run, because there is then no
        derivative.

        Parameters
        ----------
        name
            Name of a scalar signal.
        target, band, after, size
            Target, half-width of the band, begin of the window [s] and size, with the meanings and defaults of
            `measure.settling`.
        """
        from toolbox.measuring.measure import settling

        passed = settling(self.run, name, target, band, after=after, size=size)
        if not 0.0 < passed < np.inf:
            raise SceneError(f"Argument `name` must be a signal that settles during the run, but `{name}` settles after {passed:g} s.")
        nodes, t = self.run.every_step, after + passed
        return -self._of(name, self._between(np.array([t])), nodes.at([t]))[0, 0] / self._rate(name, t)

    def _rate(self, name: str, t: float) -> float:
        """Time derivative of a scalar signal at an instant between switches."""
        at = self.run.every_step.at([t])
        slope, flow = self._slopes(name, at)[0, 0], self._variational.rate(at, 0, self.run.every_step.parameters)
        return float(slope[0] + slope[1 : 1 + flow.size] @ flow)

    def __str__(self) -> str:
        lines = [f"Derivatives of {self.run!r} at its end, with respect to {', '.join(self.to)}"]
        rows = []
        for name in self.run.names:
            values = np.atleast_2d(self.end(name))
            labels = [name] if len(values) == 1 else [f"{name}.{i}" for i in range(len(values))]
            rows += [(label, *(f"{value:.5g}" for value in row)) for label, row in zip(labels, values, strict=True)]
        lines += columns(rows)
        return "\n".join(lines)


@sign_of_life("sensitivity is at work")
def sensitivity(run: Trajectory, to: str | Sequence[str]) -> Sensitivity:
    """Compute the derivatives of a run with respect to parameters, inputs or start values, through every switch and
    impact.

    The derivatives are exact. They are computed from variational equations with a saltation matrix at every event, not
    from differences of runs.

    Parameters
    ----------
    run
        The run, a result of `simulate`.
    to
        Names of the numbers with respect to which the run is differentiated:

        - parameters of the plant or of a controller, continuous or sampled (`block.mass`, `chain.stiffness.0`,
          `pi.proportional`);
        - constant inputs (`top.torque`, `top.reference`);
        - numbers of a sine or of a swept sine (`block.load.amplitude`);
        - start values of states and of the memory of a sampled controller (`chain.speed.1`, `pi.angle`, or `bit.speed`,
          a signal that is a state).

    Returns
    -------
    Sensitivity
        Derivatives of signals, event times and metrics.

    Raises
    ------
    SceneError
        If a name is unknown, or if it names a sample time, a number of a table, a number that only the design of a
        controller uses, or a parameter that an input overrides. Also if a controller is written in Python or a
        measurement has encoder steps.
    GrazingError
        If the run has no derivative.

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, sensitivity, simulate
    >>> run = simulate(compose(BlockOnBelt()), "20 s")
    >>> slopes = sensitivity(run, "block.mass")
    >>> print(f"{slopes.mean_square('block.speed', after=5.0).item():.4f}")
    -0.2266
    """
    if not isinstance(run, Trajectory):
        raise SceneError(f"Argument `run` must be a trajectory made by `simulate`, but it is {run!r}.")
    check_laws(run.run.system)
    check_regular(run.run.clocks, "for a run to have derivatives")
    from toolbox.orbits.variational import variational_equations

    if not run.program.formulas.explicit:  # derivatives follow explicit steps, stage by stage
        run = run.run.again(method=Explicit())
    wanted, loop = names(to), run.run.loop
    if not wanted:
        raise SceneError("Argument `to` must name at least one start state, parameter or input, but it is empty.")
    numbers = [
        loop.differentiable_number(name, "sensitivity", lambda number: number.is_shape or number.is_start or number.is_parameter)
        for name in wanted
    ]
    run = placed(run, numbers)
    for name in wanted:
        run.run.loop.varied_number(name)  # an input that is given now may take its place
    starts, columns, order = [], [], []
    for number in numbers:
        if number.is_start:
            starts.append(_direction(run, number.name))
            order.append(("start", len(starts) - 1))
        else:
            columns.append(run.program.place(number, run.run.inputs))
            order.append(("parameter", len(columns) - 1))
    own = len(starts)
    n = run.program.system.x.numel()
    variational = variational_equations(run.program, tuple(columns))
    begin = np.array(starts).reshape(own, -1).T if own else np.zeros((n, 0))
    tangent = variational.along(run, begin[:n], keep=True, memory=begin[n:] if own else None)
    return Sensitivity(run, wanted, np.array([i if kind == "start" else own + i for kind, i in order]), tuple(columns), tangent)


def placed(run: Trajectory, numbers: Sequence[Number]) -> Trajectory:
    """The run, or the same one with those inputs given that nobody gave, so that its program has a place for each of these numbers."""
    lacking = [each for each in numbers if each.is_input and each.name not in run.run.inputs]
    return functools.reduce(lambda made, each: made.at(each, each.value), lacking, run.run).again() if lacking else run


def _direction(run: Trajectory, name: str) -> np.ndarray:
    """The direction of a start value among the states and, behind them, the memory of the sampled laws."""
    system = run.program.system
    n, places = system.x.numel(), memory_places(system, name)
    direction = np.zeros(n + sum(update.memory.numel() for update in system.updates))
    if places is None:
        place_start(system, direction[:n], name, 1.0)
    else:
        direction[n:][places] = 1.0
    return direction
