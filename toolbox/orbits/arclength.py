"""The walk along a branch of cycles by pseudo-arclength: predict along the tangent, correct across it, and look for what changed between."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.errors import SceneError, SimulationError
from toolbox.halving import zero
from toolbox.modelling.numbers import Number
from toolbox.orbits.branch import Bifurcation
from toolbox.orbits.limit_cycle import anchored, forcing_period
from toolbox.orbits.orbit import Cycle, CycleError, Orbit, signature_of
from toolbox.orbits.sliding import sliding_kind
from toolbox.simulation.trajectory import Trajectory


@dataclass
class Corrected:
    """A corrected point: unknowns u, its run and derivatives, Newton steps, tangent, and the matrix whose null vector that is."""

    u: np.ndarray
    run: Trajectory
    tangent: np.ndarray
    iterations: int
    value: float
    period: float
    direction: np.ndarray
    approach: float


class ArcWalk:
    """The state of a continuation: where it is, which way it heads, and in which scales."""

    def __init__(self, cycle: Cycle, free: Number, bounds: tuple[float, float]):
        self.free = free
        self.orbit = Orbit.of(cycle.run, free, cycle.run.accuracy, cycle.period if cycle.forced else None)
        self.kept = self.orbit.returning
        self.base = cycle.run.run
        self.forced = cycle.forced
        self.scale = np.concatenate([self.orbit.scale[self.kept], [] if self.forced else [cycle.period], [bounds[1] - bounds[0]]])
        natural = forcing_period(self.base) if self.forced else None
        self.multiple = round(cycle.period / natural) if natural else 0
        self.forced_period = cycle.period
        if self.orbit.clocked and self._paces:
            raise SceneError(
                f"Argument `parameter` must not be `{free.name}` under a sampled law: the period must stay a multiple of its sample time."
            )
        self.rest = self.orbit.begins(cycle.run).copy()
        self.like = cycle.run
        u = np.concatenate([self.rest[self.kept], [] if self.forced else [cycle.period], [free.value]]) / self.scale
        self.heading = np.zeros(u.size)
        self.before: Corrected | None = None
        self.beyond: Trajectory | None = None
        self._phase_at(cycle.run)
        found = self._corrected(u, None, None)
        if found is None:
            raise CycleError("The cycle to start from is not found again.", cycle.run)
        self.here = found

    @property
    def _paces(self) -> bool:
        """Whether what varies is the frequency of the sines whose period the cycle has."""
        return bool(self.multiple) and self.free.is_shape and self.free.name.endswith(".frequency")

    def _phase_at(self, run: Trajectory) -> None:
        """Fix the phase of what follows by the flow at the start of a run."""
        self.reference = self.orbit.begins(run)[self.kept] / self.scale[: self.kept.size]
        flow = self.orbit.slopes(run)[0][self.kept] / self.scale[: self.kept.size]
        self.flow = flow / (np.linalg.norm(flow) or 1.0)

    def head_for(self, sign: float) -> None:
        """Face the way in which the parameter changes so."""
        along = self.here.direction
        self.heading = self.here.direction = along * (sign if along[-1] >= 0 else -sign)

    def _period(self, u: np.ndarray, run: Any) -> float:
        if not self.forced:
            return float(u[-2] * self.scale[-2])
        natural = None if self.orbit.clocked else forcing_period(run)
        return self.multiple * natural if natural and self.multiple else self.forced_period

    def _shot(self, u: np.ndarray) -> tuple[Trajectory, np.ndarray, float]:
        arguments = self.base.at(self.free, float(u[-1] * self.scale[-1]))
        taken = {word: getattr(arguments, word) for word in ("inputs", "system", "plant", "loop")}
        self.orbit.run = dataclasses.replace(self.orbit.run, **taken)
        x = self.rest.copy()
        x[self.kept] = u[: self.kept.size] * self.scale[: self.kept.size]
        period = self._period(u, arguments)
        run, tangent = self.orbit.shot(self.orbit.clean(x, self.like), period)
        return run, tangent, period

    def _matrix(self, run: Trajectory, tangent: np.ndarray, period: float) -> np.ndarray:
        """Derivatives of closure and phase with respect to the unknowns."""
        n, s = self.kept.size, self.scale[: self.kept.size]
        _, end = self.orbit.slopes(run)
        monodromy = tangent[np.ix_(self.kept, self.kept)]
        columns = [(monodromy - np.eye(n)) * (s[None, :] / s[:, None])]
        of_parameter = tangent[self.kept, -1]
        if not self.forced:
            columns.append((end[self.kept] * self.scale[-2] / s)[:, None])
        elif self._paces:
            of_parameter = of_parameter - end[self.kept] * period**2 / self.multiple
        columns.append((of_parameter * self.scale[-1] / s)[:, None])
        matrix = np.hstack(columns)
        if not self.forced:
            matrix = np.vstack([matrix, np.concatenate([self.flow, [0.0, 0.0]])])
        return matrix

    def _corrected(self, u: np.ndarray, normal: np.ndarray | None, level: float | None, most: int = 10) -> Corrected | None:
        """The point of the branch in the plane normal . u = level (or at the parameter of u), or None where Newton's method does not find it."""
        n = self.kept.size
        across = normal if normal is not None else np.eye(u.size)[-1]
        target = level if level is not None else float(u[-1])
        last = np.inf
        for iteration in range(1, most + 1):
            try:
                run, tangent, period = self._shot(u)
            except (SimulationError, SceneError):
                return None
            u = u.copy()
            begin = self.orbit.begins(run)[self.kept]
            u[:n] = begin / self.scale[:n]
            gap = (self.orbit.ends(run)[self.kept] - begin) / self.scale[:n]
            if not self.forced:
                gap = np.append(gap, self.flow @ (u[:n] - self.reference))
            matrix = self._matrix(run, tangent, period)
            residual = np.append(gap, across @ u - target)
            try:
                move = np.linalg.solve(np.vstack([matrix, across]), -residual)
            except np.linalg.LinAlgError:
                return None
            length = float(np.linalg.norm(move))
            if not math.isfinite(length) or length > 1.0 or (iteration > 3 and length > 3 * last):
                return None
            if length < 1e-9:
                direction = np.linalg.svd(matrix)[2][-1]
                if direction @ self.heading < 0:
                    direction = -direction
                return Corrected(u, run, tangent, iteration, float(u[-1] * self.scale[-1]), period, direction, self.orbit.approach)
            u, last = u + move, length
        return None

    def step(self, size: float, start: np.ndarray | None = None) -> Corrected | None:
        """The point at a distance along the tangent; start: a better guess than the tangent's."""
        guess = self.here.u + size * self.heading if start is None else start
        point = self._corrected(guess, self.heading, float(self.heading @ self.here.u) + size)
        if point is None or point.direction @ self.heading < 0.3:
            return None
        if start is None and np.linalg.norm(point.u - guess) > 0.5 * size:  # the branch bends sharply, or this is another one
            return None
        return None if self._dead(point) else point

    def _dead(self, point: Corrected) -> bool:
        """Whether a free cycle has shrunk to a steady state."""
        if self.forced:
            return False
        swing = np.ptp(point.run.states[:, self.kept], axis=0) / self.scale[: self.kept.size]
        return float(swing.max()) < 1e-4

    def vanishing(self, point: Corrected, size: float) -> float | None:
        """The parameter at which the cycle shrinks to a steady state before the next point, whose cycle is then the same half a period later.

        By symmetry the parameter is stationary there; it is interpolated from both points with their tangents.
        """
        if self.forced or self.here.run.events or point.run.events:
            return None
        begins = []
        for each in (self.here, point):
            states = each.run.states[:, self.kept]
            begins.append((states[0] - (states.max(axis=0) + states.min(axis=0)) / 2) / self.scale[: self.kept.size])
        if begins[0] @ begins[1] >= 0:
            return None
        a, b, length = self.here.u[-1], point.u[-1], float(np.linalg.norm(point.u - self.here.u))
        da, db = self.heading[-1] * length, point.direction[-1] * length
        c2, c3 = 3 * (b - a) - 2 * da - db, 2 * (a - b) + da + db
        roots = [r.real for r in np.roots([3 * c3, 2 * c2, da]) if abs(r.imag) < 1e-9 and -0.1 <= r.real <= 1.1]
        s = min(roots, key=lambda r: abs(r - 0.5), default=0.5)
        return float((a + s * (da + s * (c2 + s * c3))) * self.scale[-1])

    def touched(self) -> float | None:
        """The parameter at which the slowest event of the last two points becomes a touch; None where it is not about to.

        The square of its rate is linear in the parameter there, as for a body thrown just high enough.
        """
        if self.before is None or not self.here.approach < min(0.05, self.before.approach):
            return None
        a, b = self.before, self.here
        return b.value + (b.value - a.value) * b.approach**2 / (a.approach**2 - b.approach**2)

    def look_beyond(self, left: Any = None) -> Iterator[tuple[float, Trajectory, np.ndarray, float]]:
        """(distance, run, tangent, period) of runs started nearby whose cycles have other switches; the first is kept for `corner`."""
        self.beyond = None
        mine, n = signature_of(self.here.run), self.kept.size
        probes = [self.heading, -self.heading, *(sign * row for row in np.eye(self.heading.size)[:n] for sign in (1.0, -1.0))]
        for near, probe in itertools.product((1e-6, 1e-5, 1e-4, 1e-3), probes):
            try:
                run, tangent, period = self._shot(self.here.u + near * probe)
            except (SimulationError, SceneError):
                continue
            if signature_of(run) not in (mine, left):
                self.beyond = self.beyond or run
                yield near, run, tangent, period

    def around(self, left: Any = None) -> Corrected | None:
        """The branch beyond a corner: its tangent there is that of the cycles with other switches, which runs started nearby show.

        left: the switches that a corner just passed led away from, to which there is no way back.
        """
        heading, mine = self.heading, signature_of(self.here.run)
        for near, run, tangent, period in self.look_beyond(left):
            beyond = np.linalg.svd(self._matrix(run, tangent, period))[2][-1]
            for far, way in itertools.product((3 * near, 10 * near, 100 * near), (beyond, -beyond)):
                self.heading = way
                point = self._corrected(self.here.u + far * way, way, float(way @ self.here.u) + far, most=20)
                if point is not None and not self._dead(point) and signature_of(point.run) not in (mine, left):
                    return point
        self.heading = heading
        return None

    def corner(self) -> str:
        """What happens at the corner that `around` was asked to pass, by the switches of the runs that it saw beyond."""
        return (None if self.beyond is None else sliding_kind(self.here.run, self.beyond)) or "grazing"

    def move_to(self, point: Corrected) -> None:
        """Make a point the current one, with the start of its cycle moved midway between events again where it has come near one."""
        self.before = self.here
        self.here, self.heading, self.like = point, point.direction, point.run
        self.rest = self.orbit.begins(point.run).copy()
        self._phase_at(point.run)
        if self.forced or abs(point.direction[-1]) < 0.02 or not point.run.events:
            return
        times = [e.time for e in point.run.events]
        first, last = times[0], point.period - times[-1]
        if min(first, last) > 0.2 * (first + last):
            return
        anchor = anchored(point.run, 0.0, point.period, self.orbit)
        state = point.run.at(anchor)
        self.rest, self.like = state.states[0].copy(), _at(point.run, state)
        moved = np.concatenate([self.rest[self.kept], [point.period], [point.value]]) / self.scale
        sign = math.copysign(1.0, point.direction[-1])
        try:
            run, tangent, period = self._shot(moved)
        except SimulationError:
            self.rest, self.like = point.run.states[0].copy(), point.run
            return
        self.like = run
        self._phase_at(run)
        direction = np.linalg.svd(self._matrix(run, tangent, period))[2][-1]
        direction = direction * math.copysign(1.0, direction[-1]) * sign
        self.here = Corrected(moved, run, tangent, point.iterations, point.value, period, direction, point.approach)
        self.heading = direction

    def cycle(self, point: Corrected) -> Cycle:
        """The cycle of a point."""
        return self.orbit.cycle(point.run, point.tangent, point.period, 1e-9, point.iterations)

    def changes(self, before: Corrected, after: Corrected, size: float) -> list[Bifurcation]:
        """The bifurcations between two neighbouring points."""
        found = []
        if self.cycle(before).signature != self.cycle(after).signature:
            low, high, edge, beyond = 0.0, size, before, after
            wanted = self.cycle(before).signature
            for _ in range(60):
                middle = (low + high) / 2
                point = self.step(middle, before.u + middle / size * (after.u - before.u))
                if point is not None and self.cycle(point).signature == wanted:
                    low, edge = middle, point
                else:
                    high, beyond = middle, point or beyond
                if high - low < 1e-9 * size or abs(edge.value - after.value) * (high - low) < 1e-10 * size * self.scale[-1]:
                    break
            return [Bifurcation(sliding_kind(edge.run, beyond.run) or "grazing", edge.value, self.cycle(edge))]

        def doubling(point: Corrected) -> float:
            return float(np.real(np.prod(1.0 + self.cycle(point).multipliers)))

        def torus(point: Corrected) -> float:
            values = self.cycle(point).multipliers[:8]
            return float(np.real(np.prod([values[i] * values[j] - 1.0 for i in range(values.size) for j in range(i)])))

        tests: dict[str, Callable[[Corrected], float]] = {"fold": lambda point: float(point.direction[-1]), "period doubling": doubling}
        if self.kept.size > 1:
            tests["Neimark-Sacker"] = torus
        for kind, test in tests.items():
            if test(before) * test(after) >= 0:
                continue
            point = self._located(test, before, after, size)
            if point is None:
                continue
            cycle = self.cycle(point)
            if kind == "Neimark-Sacker" and not any(abs(abs(v) - 1) < 1e-3 and abs(v.imag) > 1e-6 for v in cycle.multipliers):
                continue  # two real multipliers whose product is one: a neutral saddle, where nothing happens
            found.append(Bifurcation(kind, point.value, cycle))
        return found

    def _located(self, test: Callable[[Corrected], float], before: Corrected, after: Corrected, size: float) -> Corrected | None:
        points: dict[float, Corrected] = {0.0: before, size: after}

        def value(s: float) -> float:
            if s not in points:
                point = self.step(s, before.u + s / size * (after.u - before.u))
                if point is None:
                    raise CycleError("The branch breaks off.")
                points[s] = point
            return test(points[s])

        try:
            root = zero(value, 0.0, size, 1e-10 * size + 1e-14)
            value(root)
            return points[root]
        except (CycleError, ValueError):
            return None


def _at(run: Trajectory, state: Any) -> Any:
    """What `Orbit.clean` needs of a run that starts at a sample of another."""
    return _Begin(run.program, state.mode, run.parameters, state.held)


@dataclass(frozen=True)
class _Begin:
    program: Any
    mode: np.ndarray
    parameters: np.ndarray
    held: np.ndarray
