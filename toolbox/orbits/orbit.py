"""Cycles, and the return map of a machine over a period, by which Newton's method finds them."""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from toolbox.arguments import count_of
from toolbox.errors import SceneError, SimulationError
from toolbox.files.printing import Rows, Told
from toolbox.files.unit_systems import reading
from toolbox.measuring.sticks import stuck_ratio
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.inputs import Table
from toolbox.modelling.numbers import Number
from toolbox.simulation.main_signals import position_of
from toolbox.simulation.methods import Explicit
from toolbox.simulation.run import Run
from toolbox.simulation.run_state import RunState
from toolbox.simulation.trajectory import Trajectory

CONVERGED = 1e-10
"""Newton step, relative to the size of states and period, at which a cycle counts as found."""


ON_CIRCLE = 1e-9
"""How near to the unit circle a multiplier lies on it, as far as cycles are known."""


class CycleError(SimulationError):
    """Error of `limit_cycle` if it finds no periodic motion. `run` is the last run of the search.

    Examples
    --------
    >>> from models import Block
    >>> from toolbox import compose, limit_cycle
    >>> from toolbox.orbits import CycleError
    >>> try:
    ...     limit_cycle(compose(Block(damping=0.5)), settle="60 s")
    ... except CycleError as error:
    ...     print(f"last run of {error.run.end:.0f} s")
    last run of 60 s
    """


@dataclass(frozen=True)
class Cycle(Told):
    """Periodic motion, the result of `limit_cycle`: `cycle.period`, `cycle.multipliers`, `cycle.stable`,
    `cycle.amplitude("bit.speed")`, `print(cycle)`, `cycle.plot()`.

    Attributes
    ----------
    run, period
        One period of the motion, and its length [s].
    monodromy
        Monodromy matrix dx(T)/dx(0) of the periodic quantities, shape (n, n), in the order of `monodromy_indices`: rows
        of x, then the memory of sampled controllers and the held signals that they read.
    monodromy_indices
        Indices of the periodic quantities, in the order of the rows and columns of `monodromy`.
    multipliers
        Eigenvalues of `monodromy` (Floquet multipliers), the largest first. For an autonomous system the multiplier 1,
        which belongs to a shift in time, is left out.
    forced
        Whether time appears in the equations.
    newton_step
        Size of the last Newton step, as a fraction of the size of the motion [1].
    iterations
        Number of Newton steps.
    last_period_change
        Change of the period in the last Newton step [s].

    Examples
    --------
    >>> from models import BlockOnBelt
    >>> from toolbox import compose, limit_cycle
    >>> cycle = limit_cycle(compose(BlockOnBelt()), settle="60 s")
    >>> print(f"period {cycle.period:.3f} s")
    period 12.001 s
    """

    run: Trajectory
    period: float
    monodromy: np.ndarray
    multipliers: np.ndarray
    monodromy_indices: np.ndarray
    forced: bool
    newton_step: float
    iterations: int
    last_period_change: float

    @property
    def loop(self) -> ClosedLoop:
        """Loop that has this periodic motion, with the values of its numbers."""
        return self.run.run.loop

    @property
    def start(self) -> np.ndarray:
        """States at time 0 of the cycle, shape (n_x,)."""
        return self.run.states[0]

    @property
    def memory(self) -> np.ndarray:
        """Memory of the sampled controllers at time 0 of the cycle, controller after controller, shape (n_m,)."""
        return self.run.run.start.memory

    @property
    def stable(self) -> bool:
        """Whether all multipliers lie inside the unit circle, so that the cycle is asymptotically stable. False for a cycle without energy loss."""
        return bool(np.abs(self.multipliers).max(initial=0.0) < 1.0 - ON_CIRCLE)

    @property
    def signature(self) -> tuple[tuple[str, str, str], ...]:
        """The switches of one period as (element, mode before, mode after), independent of the instant chosen as the begin of the period."""
        return signature_of(self.run)

    def extremes(self, signal: str) -> tuple[float, float]:
        """Return the smallest and the largest value of a scalar signal over the period.

        Parameters
        ----------
        signal
            Name of a scalar signal, such as "block.speed".
        """
        found = []
        for sign in (1.0, -1.0):
            times = np.unique(np.concatenate([self.run.time, np.linspace(0.0, self.run.end, 400)]))
            for _ in range(3):  # each look is some twenty times closer than the one before
                values = sign * self.run.at(times)[signal]
                i = int(np.argmin(values))
                times = np.linspace(times[max(i - 1, 0)], times[min(i + 1, times.size - 1)], 41)
            found.append(sign * float(values.min()))
        return found[0], found[1]

    def amplitude(self, signal: str) -> float:
        """Return half of the difference between the largest and the smallest value of a scalar signal over the period.

        Parameters
        ----------
        signal
            Name of a scalar signal, such as "block.speed".
        """
        low, high = self.extremes(signal)
        return (high - low) / 2

    def stick_share(self, element: str) -> float:
        """Return the fraction of the period during which an element sticks, from 0 to 1.

        Parameters
        ----------
        element
            Name of the element, such as "bit".
        """
        return stuck_ratio(self.run, element)

    @property
    def main_signal(self) -> str:
        """Name of the judged signal if the loop has a judged signal. Otherwise the speed at the contact, such as
        `bit.speed`, or the most important signal.
        """
        speeds = [f"{contact}.speed" for contact in self.run.contacts if f"{contact}.speed" in self.run.names]
        return self.loop.signal or next(iter([*speeds, *self.run.main_signals]))

    def plot(self, x: str | None = None, y: str | None = None, ax: Any = None) -> Any:
        """Draw the closed orbit in a phase plane, and return the axes.

        Parameters
        ----------
        x, y
            Names of two scalar signals. By default `y` is the judged or most important signal, and `x` the state whose
            rate it is, or another state.
        ax
            Axes to draw into. By default a new figure.

        Raises
        ------
        SceneError
            If a signal is unknown or a vector.
        """
        from toolbox.simulation.plot import phase_plane

        y = y or self.main_signal
        x = x or position_of(self.loop.plant, y) or next((name for name in self.run.main_signals if name != y), y)
        return phase_plane(self.run, x, y, ax=ax)

    def _told(self) -> list[str | Rows]:
        shown = ", ".join(_complex(value) for value in self.multipliers[:6]) + (", ..." if self.multipliers.size > 6 else "")
        largest = np.abs(self.multipliers).max(initial=0.0)
        kind = "Stable" if self.stable else "Neutral" if largest <= 1.0 + ON_CIRCLE else "Unstable"
        told: list[str | Rows] = [
            f"{kind} cycle of {self.period:.10g} s, {'forced' if self.forced else 'free'}, "
            f"found in {self.iterations} steps, the last of {self.newton_step:.1e}",
            f"  Floquet multipliers  {shown or 'none'}",
        ]
        for element in self.run.program.system.elements:
            if "stick" in element.mode_names.values():
                told.append(f"  {element.name} sticks {100 * self.stick_share(element.name):.2f} % of the period")
        return [*told, Rows(self._rows(), (0, 2, 3), headings=("state", "smallest", "largest", "unit"))]

    __repr__ = Told.__str__

    def _rows(self) -> list[tuple[str, str, str, str]]:
        """(state, smallest value, largest value, unit) of the states that return."""
        rows = []
        system = self.run.program.system
        for name, (row, size, unit) in system.states.items():
            for i in range(count_of(size)):
                if row + i in self.monodromy_indices:
                    label = name if size is None else f"{name}.{i}"
                    factor, shown = reading(unit, self.run.display_units)
                    low, high = self.extremes(label)
                    rows.append((label, f"{factor * low:.6g}", f".. {factor * high:.6g}", shown))
        return rows


def _complex(value: complex) -> str:
    return f"{value.real:.6g}" if abs(value.imag) < 1e-12 else f"{value.real:.6g} {'+' if value.imag > 0 else '-'} {abs(value.imag):.6g}i"


@dataclass
class Orbit:
    """The equations of a cycle: arguments of its runs, compiled derivatives, and which states return.

    A point of it holds the states, the memory of sampled laws, and the held signals `read`: those that laws read, and those of a law with a delay, which
    act on until its next output arrives.  columns: entries of the parameter vector that are
    directions behind those of the point;  scale: size of every entry of a point;  held: all held signals before the first sample;  approach: how fast the last
    run met its slowest event, 0 at grazing.
    """

    run: Run
    variational: Any
    columns: tuple[int, ...]
    returning: np.ndarray
    forced: bool
    scale: np.ndarray
    held: np.ndarray
    read: np.ndarray
    approach: float = np.inf

    @staticmethod
    def of(run: Trajectory, free: Number | None, accuracy: float, period: float | None = None) -> Orbit:
        """The equations for cycles of the same plant and arguments as a run, with derivatives by a number."""
        from toolbox.orbits.variational import variational_equations

        for clock in run.run.clocks:
            if clock.delay >= clock.period:
                raise SceneError(
                    f"Argument `delay` must be shorter than the sample time {clock.period:g} s in a periodic motion, but it is {clock.delay:g} s: what is on "
                    "its way for longer would have to return as well. Let the law remember its output for whole samples, as "
                    "`ObserverBasedController(..., delay_samples=1)` lets its observer."
                )
        if any(update.channels for update in run.program.system.updates):
            raise SceneError("Argument `controller` must be without noise in a periodic motion.")
        for name, value in run.run.inputs.items():
            if isinstance(value, Table) and np.ptp(value.values) > 0 and not (period is not None and _returns(value, period, run.end)):
                raise SceneError(
                    f"Argument `{name}` must be constant, a sine or an expression of time in a periodic motion, but it is a table"
                    + (": give its `period`." if period is None else f" that does not repeat itself after {period:g} s.")
                )
        arguments = dataclasses.replace(run.run, accuracy=accuracy, method=Explicit(), output_times=None, duration=0.0)
        program = arguments.again().program  # that of a coarse run, or of a stiff one, is another
        columns = () if free is None else (program.place(free, arguments.inputs),)
        variational = variational_equations(program, columns)
        returning = np.flatnonzero(~variational.drifting)
        size = [np.abs(run.states).max(axis=0)]
        read = np.empty(0, int)
        if variational.controllers is not None:
            late = [
                update.first_held + np.arange(len(update.names))
                for update, clock in zip(run.program.system.updates, run.run.clocks, strict=True)
                if clock.delay > 0.0
            ]
            read = np.unique(np.concatenate([variational.controllers.read, *late]))
            returning = np.append(returning, run.states.shape[1] + np.arange(variational.controllers.memory + read.size))
            for update in run.program.system.updates:
                first = update.first_held + len(update.names)
                found = np.abs(run.held[:, first : first + update.memory.numel()]).max(axis=0)
                size.append(
                    np.where(found > 1e-9 * size[0].max(), found, 0.0)
                )  # of an integral that has come to rest at 0 round-off is left
            size.append(np.abs(run.held[:, read]).max(axis=0))
        scale = np.concatenate(size)
        scale[scale == 0.0] = 1.0
        held = run.run.start.held
        return Orbit(
            arguments, variational, columns, returning, variational.forced or variational.controllers is not None, scale, held, read
        )

    @property
    def clocked(self) -> bool:
        """Whether sampled laws act."""
        return self.variational.controllers is not None

    def whole(self, period: float) -> float:
        """The period, to the last bit that of the samples; raises SceneError unless it is a whole multiple of every sample time."""
        least = period
        for sample_time in (clock.period for clock in self.run.clocks):
            count = round(period / sample_time)
            if count < 1 or abs(count * sample_time - period) > 1e-9 * period:
                times = Fraction(period / sample_time).limit_denominator(1000).denominator
                raise SceneError(
                    f"Argument `period` must be a whole multiple of the sample time {sample_time:g} s, but it is {period:g} s: "
                    f"choose another sample time"
                    + (f", or `period` = {times * period:g} s, where both come round." if times < 1000 else ".")
                )
            least = min(least, count * sample_time)
        return float(least)

    def within(self, run: Trajectory, t: float) -> np.ndarray:
        """The point of a run at a time, which is an instant of all samples where there are any."""
        if not self.clocked:
            return run.at(t).states[0]
        if t == 0.0:
            return self.begins(run)
        at, before = run.at(t * (1 + 1e-15)), run.at(t * (1 - 1e-13))
        self.held = before.held[0, : self.held.size].copy()
        places = [update.first_held + len(update.names) + np.arange(update.memory.numel()) for update in run.program.system.updates]
        return np.concatenate([at.states[0], at.held[0, np.concatenate(places)], self.held[self.read]])

    def begins(self, run: Trajectory) -> np.ndarray:
        """The point at the start of a shot."""
        return np.concatenate([run.every_step.states[0], run.run.start.memory, run.run.start.held[self.read]])

    def ends(self, run: Trajectory) -> np.ndarray:
        """The point at the end of a shot."""
        return np.concatenate([run.states[-1], run.last.memory, run.held[-1, self.read]])

    def shot(self, x: np.ndarray, period: float) -> tuple[Trajectory, np.ndarray]:
        """The run over a period from a point, and derivatives of its end, shape (point, point + parameters)."""
        if not np.isfinite(x).all() or not 0.0 < period < np.inf:
            raise CycleError("The search for a cycle diverges.")
        n, behind, every = self.variational.plant, x.size - self.read.size, np.eye(x.size)
        held, first = self.held.copy(), np.zeros((self.held.size, x.size))
        held[self.read], first[self.read] = x[behind:], every[behind:]
        begun = RunState.begun(self.run.system, self.run.plant, self.run.clocks)
        start = dataclasses.replace(begun, states=x[:n].copy(), memory=x[n:behind].copy(), held=held, carried=True)
        run = self.run.again(start=start, duration=float(period), longest_step=period / 64)
        tangent = self.variational.along(run, every[:n], memory=every[n:behind], held_first=first)
        self.approach, self.held = tangent.approach, run.held[-1, : held.size].copy()
        return run, np.vstack([tangent.end[:n], tangent.memory, tangent.end[n:][self.read]])

    def slopes(self, run: Trajectory) -> tuple[np.ndarray, np.ndarray]:
        """dx/dt at begin and end of a run."""
        rows = []
        for row in (0, -1):
            rate = self.variational.rate(run, row, run.parameters)[: self.variational.plant]
            rows.append(np.append(rate, np.zeros(self.scale.size - rate.size)))
        return rows[0], rows[1]

    def clean(self, x: np.ndarray, like: Trajectory) -> np.ndarray:
        """A start whose sticking elements have no slip at all."""
        from toolbox.compilation.work_layout import SWITCH

        mode, n = like.mode[0].astype(float), self.variational.plant
        if not ((like.program.kind != SWITCH) & (mode == 0)).any():
            return x
        modes = np.concatenate([mode, np.ones(self.variational.sides.numel())])
        p = like.parameters.copy()
        p[like.program.first_held :] = like.held[0]
        whole = np.concatenate([x[:n], like.held[0, : self.held.size]])
        return np.concatenate([np.array(self.variational.project(0.0, whole, p, modes)).ravel()[:n], x[n:]])

    def solved(self, x: np.ndarray, period: float, most: int = 25) -> Cycle:
        """The cycle near a start and a period, by Newton's method."""
        free, kept = not self.forced, self.returning
        scale, count = self.scale[kept], kept.size
        run, tangent = self.shot(x, period)
        towards, _ = self.slopes(run)
        reference, guess = self.begins(run).copy(), period
        towards = towards[kept] / scale
        towards = towards / (np.linalg.norm(towards) or 1.0)

        def residual(run: Trajectory) -> np.ndarray:
            begin = self.begins(run)
            gap = (self.ends(run) - begin)[kept] / scale
            return np.append(gap, towards @ ((begin - reference)[kept] / scale)) if free else gap

        size = np.linalg.norm(residual(run))
        step = np.inf
        for iterations in itertools.count(1):
            if iterations > most:
                raise CycleError(
                    f"No cycle was found near the start: after {most} steps the motion still misses itself by {size:.2g} of its size.", run
                )
            matrix = (tangent[np.ix_(kept, kept)] - np.eye(count)) * (scale[None, :] / scale[:, None])
            if free:
                matrix = np.block([[matrix, (self.slopes(run)[1][kept] * guess / scale)[:, None]], [towards[None, :], np.zeros((1, 1))]])
            move = np.linalg.lstsq(matrix, -residual(run), rcond=1e-13)[0]
            step = float(np.linalg.norm(move))
            if step < CONVERGED:
                if size > 1e-7 * max(1.0, float(np.linalg.norm(matrix))):  # no start mends what is missing
                    raise CycleError(
                        f"No cycle was found: from round to round the motion changes by {size:.2g} of its size wherever near it starts. It dies out, or "
                        "grows; start elsewhere, or give what drives it.",
                        run,
                    )
                break
            share, tried = min(1.0, 0.5 / step), None
            for attempt in range(8):
                following = self.begins(run).copy()
                following[kept] += share * move[:count] * scale
                longer = period + share * move[count] * guess if free else period
                try:
                    tried = self.shot(self.clean(following, run), longer)
                    grown = np.linalg.norm(residual(tried[0]))
                    if grown < 2 * size + 1e-9:
                        break
                except SimulationError as failed:
                    if attempt == 7:
                        raise failed
                share /= 2
            if tried is None:
                raise CycleError("The search for a cycle found no step that can be simulated.", run)
            run, tangent = tried
            period = longer
            size = np.linalg.norm(residual(run))
        # what holds follows the states, and the first sample
        judged = np.array([not (self.clocked and element.holds) for element in self.run.system.elements], bool)
        if (run.mode[0] != run.mode[-1])[judged].any():
            names = [e.name for e, a, b in zip(run.program.system.elements, run.mode[0], run.mode[-1], strict=True) if a != b]
            raise CycleError(
                f"The states return but the mode of `{names[0]}` does not: it starts a run as the states say, not as it was left.", run
            )
        if free and (
            (np.ptp(run.states[:, kept], axis=0) / scale).max(initial=0.0) < 1e-7
            or np.linalg.norm(self.slopes(run)[0][kept] * period / scale) < 1e-6
        ):
            raise CycleError(
                "The search for a cycle ended in a steady state: the machine rests, or the guess was too near to its rest.", run
            )
        return self.cycle(run, tangent, float(period), step, iterations, abs(move[count] * guess) if free else 0.0)

    def cycle(
        self, run: Trajectory, tangent: np.ndarray, period: float, step: float, iterations: int, last_period_change: float = 0.0
    ) -> Cycle:
        """The cycle of a run that comes round, with the derivatives of its end, and how its search ended."""
        monodromy = tangent[np.ix_(self.returning, self.returning)]
        multipliers = multipliers_of(monodromy, not self.forced)
        return Cycle(run, period, monodromy, multipliers, self.returning, self.forced, step, iterations, last_period_change)


def multipliers_of(monodromy: np.ndarray, free: bool) -> np.ndarray:
    """Eigenvalues, the largest first; of a free cycle without the one nearest to 1."""
    values = np.linalg.eigvals(monodromy).astype(complex)
    if free and values.size:
        values = np.delete(values, int(np.argmin(np.abs(values - 1.0))))
    return values[np.argsort(-np.abs(values), kind="stable")]


def signature_of(run: Trajectory) -> tuple[tuple[str, str, str], ...]:
    """The switches of a run that comes round, beginning with the one that sorts first."""
    switches = [(e.element, e.before, e.after) for e in run.events]
    return min((tuple(switches[i:] + switches[:i]) for i in range(len(switches))), default=())


def _returns(table: Table, period: float, end: float) -> bool:
    """Whether a table repeats itself after a period, as far as a run goes."""
    times = np.unique(np.concatenate([table.times, table.times - period, [0.0, end - period]]))
    times = times[(times >= 0.0) & (times <= end - period)]
    if times.size < 2:
        return True
    inside = np.concatenate([times[:-1] + part * np.diff(times) for part in (0.25, 0.75)])
    inside = inside[
        np.repeat(np.diff(times)[None, :], 2, axis=0).ravel() > 1e-9 * period
    ]  # the nodes of a period are sums, equal to round-off
    now, later = (np.interp(t, table.times, table.values) for t in (inside, inside + period))
    return bool(np.abs(now - later).max(initial=0.0) <= 1e-6 * np.ptp(table.values))
