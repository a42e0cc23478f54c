"""The variational equations of a run, in machine code between events and with saltation matrices at them.

    S' = f_x S + f_p      between events, by the same steps and stages as the run: the derivative of what was computed, not of something near it
    dt = -(g_x S + g_p) / (g_t + g_x f-)                                  when guard g reaches zero
    S+ = R_x (S + f- dt) + R_p + R_t dt - f+ dt                           R the reset at the event, the identity but for impacts

S holds one column per direction: start states first, then parameters. At release from stick the field jumps where static friction exceeds kinetic; at
entry into stick the slip is zero on both sides, so that S loses the direction that stick forgets; a kink changes nothing, because the field is
continuous there. Kinks inside fabs, fmin and fmax are written with their side as a number: a stage that ends on a kink must not see the slope behind it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from toolbox.compilation import work_layout
from toolbox.compilation.bodies import plain_body
from toolbox.compilation.emitter import compiled, function_text
from toolbox.compilation.program import Program
from toolbox.errors import GrazingError
from toolbox.modelling.elimination import called_with, calls
from toolbox.modelling.two_directions import check_one_direction
from toolbox.orbits.sampled_memory import SampledLaws, SampledTangent, default_slopes
from toolbox.orbits.transport import Tableau, Transport
from toolbox.simulation.samples import Samples
from toolbox.simulation.trajectory import Trajectory

GRAZING = 1e-7
"""A guard that approaches zero slower than this part of its mean rate since the last event has no usable derivative of its time."""


@dataclass(frozen=True)
class Tangent:
    """Derivatives along a run.

    nodes: at every node, shape (nodes, n, k), where they were asked for, else empty;  end: at the end, shape (n, k);  event_times: shape (events, k);
    n counts the states and behind them the held signals;  memory: of sampled laws, at the end, shape (memory, k);
    approach: slowest rate at which a guard reached zero, in parts of its mean rate since the event before: 0 at grazing.
    """

    nodes: np.ndarray
    end: np.ndarray
    event_times: np.ndarray
    memory: np.ndarray
    approach: float


class VariationalEquations:
    """Compiled derivatives of a program with respect to its states and to the entries `columns` of its parameter vector.

    What sampled laws hold counts as states that rest between samples: plant is the number of states without them, states with them.
    """

    def __init__(self, program: Program, columns: tuple[int, ...]):
        self.program = program
        system, form = program.system, program.form
        check_one_direction(system.elements, "The derivative of a run", "take the difference of two runs of a high accuracy")
        t, m, (p, _, _) = system.t, system.m, program.expressions
        held = system.held
        x = ca.vertcat(system.x, held)
        self.plant, self.states, self.columns = system.x.numel(), x.numel(), columns
        self.controllers = SampledLaws(program, columns) if system.updates else None
        n, count = self.states, len(program.system.elements)
        chosen = ca.vertcat(*[p[c] for c in columns]) if columns else ca.SX(0, 1)
        z = ca.vertcat(x, chosen)
        if held.numel():  # they are read from among the states
            first = program.held_slot
            p = ca.vertcat(p[:first], ca.SX.sym("held before", held.numel()), p[first + held.numel() :])
        field, projected = (
            ca.vertcat(ca.densify(e[: self.plant]), rest) for e, rest in ((form.field, ca.SX.zeros(held.numel())), (form.projected, held))
        )
        together = ca.vertcat(field, ca.densify(form.guards[: 2 * count]), projected)
        smooth, self.sides, arguments = sided(together, ca.vertcat(t, x))
        field, guards, projected = smooth[:n], smooth[n : n + 2 * count], smooth[n + 2 * count :]
        modes = ca.vertcat(m, self.sides)
        slope = ca.jacobian(field, z)
        rows, entries = (np.array(v, np.int64) for v in slope.sparsity().get_triplet())
        function = ca.Function("slope", [t, x, p, modes], [ca.vertcat(field, ca.reshape(slope.nz[:], slope.nnz(), 1))])
        body = plain_body(function, 0)
        text = "\n".join([function_text("slope", body), *sorted(body.declarations)])
        address = compiled(text, ["slope"], body.count)["slope"]
        formulas: Any = program.formulas  # explicit ones: runs by others are made again
        a = np.array([[*row, *[0.0] * (len(formulas.b) - len(row))] for row in formulas.a])
        self.tableau = Tableau(address, a, np.array(formulas.b), np.array(formulas.c), rows, entries)
        arguments_of = [t, x, p, modes]
        self.field = ca.Function("field", arguments_of, [field])
        self.guards = ca.Function("guards", arguments_of, [guards])
        self.edge = ca.Function("edge", arguments_of, [field, ca.densify(ca.jacobian(guards, t)), ca.densify(ca.jacobian(guards, z))])
        self.projection = ca.Function("projection", arguments_of, [ca.densify(ca.jacobian(projected, z))])
        self.project = ca.Function("project", arguments_of, [projected])
        self.kinks = ca.Function("kinks", [t, x, p, m], [arguments])
        watched = guards if self.controllers is None else ca.vertcat(guards, x[np.flatnonzero(self.controllers.reads).tolist()])
        self.drifting = _drifting(ca.jacobian(field, x), ca.jacobian(watched, x))[: self.plant]
        self.forced = bool(ca.depends_on(ca.vertcat(field, guards), t))
        self.impact: Any = None
        if form.impulse is not None:
            marks, elastic, results = form.impulse
            struck = ca.vertcat(results[: self.plant], held)
            self.impact = ca.Function("impact", [t, x, p, m, ca.vertcat(marks, elastic)], [
                struck, ca.densify(ca.jacobian(struck, t)), ca.densify(ca.jacobian(struck, z))])  # fmt: skip

    def whole(self, nodes: Samples, rows: Any = slice(None)) -> np.ndarray:
        """States of a run, and behind them its held signals."""
        return np.ascontiguousarray(np.hstack([nodes.states[rows], nodes.held[rows, : self.states - self.plant]]))

    def along(
        self,
        run: Trajectory,
        starts: np.ndarray,
        keep: bool = False,
        memory: np.ndarray | None = None,
        held_first: np.ndarray | None = None,
    ) -> Tangent:
        """Derivatives along `run.every_step` for start directions (plant states, k_s), followed by one direction per parameter.

        memory, held_first: of the same directions, shape (memory, k_s) and (held signals, k_s), zero without.
        """
        nodes = run.every_step
        n, own = self.states, starts.shape[1]
        time, state = nodes.time, self.whole(nodes)
        p = nodes.parameters.copy()
        modes = nodes.mode.astype(float)
        if self.sides.numel():
            modes = np.hstack([modes, self._sides(nodes)])
        tangent = np.zeros((n, own + len(self.columns)))
        tangent[: self.plant, :own] = starts
        held = np.ascontiguousarray(nodes.held)
        first_held = self.program.first_held
        sampled, acts = None, list[int]()
        if self.controllers is not None:
            remembered = np.zeros((self.controllers.memory, tangent.shape[1]))
            if memory is not None:
                remembered[:, :own] = memory
            if held_first is not None:
                tangent[self.plant :, :own] = held_first
            tangent[self.plant :, own:] = default_slopes(nodes.run, self.program, self.columns)
            sampled = SampledTangent(self.controllers, nodes, remembered, own)
            sampled.checked_holds(self.guards, state, modes)
            acts = list(sampled.due)
        if ((self.program.kind != work_layout.SWITCH) & (nodes.mode[0] == 0)).any():
            p[first_held:] = held[0]
            tangent = self._applied(np.array(self.projection(time[0], state[0], p, modes[0])), tangent, own)
        kept = np.empty((time.size if keep else 0, n, tangent.shape[1]))
        if keep:
            kept[0] = tangent
        steps = Transport.of(self.tableau, time, state, modes, held, p, first_held, own)._replace(kept=kept)
        together = np.flatnonzero(np.diff(time) <= 0.0)
        # where an input jumps at a given time states do not, and carrying over a step of no length leaves the directions as they are
        pairs = set(together[~(held[together] != held[together + 1]).any(axis=1)].tolist())
        stops = np.unique([0, *(together + 1), *acts])
        place, dated = 0, []
        approach = np.inf
        for k in sorted({*pairs, *acts, time.size - 1}):
            steps.carrying(tangent).over(place, k)  # in place
            begin, place = int(stops[max(np.searchsorted(stops, k) - 1, 0)]), k
            if sampled is not None and k in sampled.due:
                tangent = np.ascontiguousarray(sampled.act(k, p, tangent))
                if keep:
                    kept[k] = tangent
            if k in pairs:
                tangent, dt, slowest = self._event(nodes, state, k, begin, tangent, own, p, modes)
                if keep:
                    kept[k + 1] = tangent
                approach = min(approach, slowest)
                if dt is not None:
                    dated.append((k, dt))
                place = k + 1
        event_time, *_ = nodes._event_arrays
        times = np.zeros((event_time.size, tangent.shape[1]))
        for k, dt in dated:
            times[event_time == time[k]] = dt
        return Tangent(kept, tangent, times, np.empty((0, tangent.shape[1])) if sampled is None else sampled.memory, approach)

    def between(self, nodes: Trajectory, kept: np.ndarray, own: int, times: np.ndarray) -> np.ndarray:
        """Derivatives at any times within the run, each by one step from the node at or before it, shape (times, n, k)."""
        modes = nodes.mode.astype(float)
        if self.sides.numel():
            modes = np.hstack([modes, self._sides(nodes)])
        p, first_held, state = nodes.parameters.copy(), self.program.first_held, self.whole(nodes)
        places = np.maximum(np.searchsorted(nodes.time, times, side="right") - 1, 0)
        found = kept[places].copy()
        for q, (k, t) in enumerate(zip(places.tolist(), times.tolist(), strict=True)):
            if t > nodes.time[k]:
                once = slice(k, k + 1)
                times_of = np.array([nodes.time[k], t])
                steps = Transport.of(self.tableau, times_of, state[once], modes[once], nodes.held[once], p, first_held, own)
                steps.carrying(found[q]).over(0, 1)
        return found

    def rate(self, nodes: Samples, row: int, parameters: np.ndarray) -> np.ndarray:
        """dx/dt at one of the times of a run with its parameters, every kink on the side where it is, and behind it the zeros of held signals."""
        t, x, p, mode = nodes.time[row], self.whole(nodes, [row])[0], parameters.copy(), nodes.mode[row]
        p[self.program.first_held :] = nodes.held[row]
        sides = np.sign(np.array(self.kinks(t, x, p, mode)).ravel()) if self.sides.numel() else np.empty(0)
        return np.array(self.field(t, x, p, np.concatenate([mode, sides]))).ravel()

    def _sides(self, nodes: Trajectory) -> np.ndarray:
        """The side of every kink over every step, from both its ends: at a crossing one of them is zero."""
        p = np.repeat(nodes.parameters[:, None], nodes.time.size, axis=1)
        p[self.program.first_held :] = nodes.held.T
        ends = p.copy()
        ends[:, 1:] = p[:, :-1]
        modes, state = nodes.mode.T.astype(float), self.whole(nodes).T
        begin = np.array(self.kinks(nodes.time[None], state, p, modes))
        later = state[:, 1:].copy()
        later[self.plant :] = state[self.plant :, :-1]  # what is held over the step
        following = np.array(self.kinks(nodes.time[None, 1:], later, ends[:, 1:], modes[:, :-1]))
        total = begin.copy()
        total[:, :-1] += following
        sides = np.where(total < 0.0, -1.0, 1.0).T
        for k in np.flatnonzero(np.diff(nodes.time) <= 0.0):  # an event is seen from the step that leads to it
            if k > 0:
                sides[k] = sides[k - 1]
        return sides

    @staticmethod
    def _applied(jacobian: np.ndarray, tangent: np.ndarray, own: int) -> np.ndarray:
        """A map's derivative (n, n + parameters) times the directions."""
        n = tangent.shape[0]
        result = jacobian[:, :n] @ tangent
        result[:, own:] += jacobian[:, n:]
        return result

    def _event(
        self, nodes: Trajectory, state: np.ndarray, k: int, begin: int, tangent: np.ndarray, own: int, p: np.ndarray, modes: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray | None, float]:
        """Directions after what happens between nodes k and k + 1, the derivatives of its time, and how fast the guard was."""
        n, kind = self.states, self.program.kind
        first_held = self.program.first_held
        t, before, after = nodes.time[k], nodes.mode[k], nodes.mode[k + 1]
        changed = before != after
        moved = np.abs(nodes.states[k + 1] - nodes.states[k]) > 1e-12 * np.abs(nodes.states).max(axis=0)
        event_time, element, _ = nodes._event_arrays
        here = {int(i) for i in element[event_time == t]}
        struck = [i for i in sorted(here) if kind[i] == work_layout.RIGID and before[i] == 1 and (changed[i] or moved.any())]
        if not changed.any() and not struck:
            return tangent, None, np.inf  # a kink
        x, p[first_held:] = state[k], nodes.held[k]
        flow, of_t, of_z = (np.array(v) for v in self.edge(t, x, p, modes[k]))
        flow, of_t = flow.ravel(), of_t.ravel()
        upwards = (kind == work_layout.FRICTION) & (before == 0) & (after == 1)
        firing = [2 * i for i in struck] if struck else [2 * i + int(upwards[i]) for i in np.flatnonzero(changed).tolist()]
        if len(firing) > 1 and not struck:
            size = np.abs(of_z[:, :n]) @ np.abs(x) + np.abs(of_t * t) + 1e-300
            distance = np.abs(np.array(self.guards(t, x, p, modes[k])).ravel()[firing]) / size[firing]
            firing = [j for j, d in zip(firing, distance, strict=True) if d <= max(1e-9, 1.0001 * distance.min())]
        dates, slowest = [], np.inf
        for j in firing:
            rate = of_t[j] + of_z[j, :n] @ flow
            slowest = min(slowest, self._approach(nodes, state, j, rate, begin, k, p, modes))
            guard = of_z[j, :n] @ tangent
            guard[own:] += of_z[j, n:]
            dates.append(-guard / rate)
        if any(np.abs(date - dates[0]).max() > 1e-6 * np.abs(dates[0]).max() + 1e-12 for date in dates[1:]):
            names = " and ".join(f"`{self.program.system.elements[j // 2].name}`" for j in firing[:2])
            raise GrazingError(
                f"At t = {t:.9g} s {names} switch at one instant: which comes first decides, and no derivative exists.", nodes
            )
        dt = dates[0]
        p[first_held:] = nodes.held[k + 1]
        flow_after = np.array(self.field(t, state[k + 1], p, modes[k + 1])).ravel()
        if struck:
            jump = self._struck(nodes, state, k, struck, p, modes)
            tangent = self._applied(jump[:, 1:], tangent + np.outer(flow, dt), own) + np.outer(jump[:, 0] - flow_after, dt)
        else:
            tangent = tangent + np.outer(flow - flow_after, dt)
        return np.ascontiguousarray(tangent), dt, slowest

    def _approach(
        self, nodes: Trajectory, state: np.ndarray, j: int, rate: float, begin: int, k: int, p: np.ndarray, modes: np.ndarray
    ) -> float:
        rows = np.arange(begin, k + 1)[:: max(1, (k - begin) // 16)]
        values = np.array(self.guards(nodes.time[None, rows], state[rows].T, p, modes[rows].T))[j]
        mean = np.abs(values).max() / max(nodes.time[k] - nodes.time[begin], 1e-300)
        if not abs(rate) > GRAZING * mean:
            name = self.program.system.elements[j // 2].name
            raise GrazingError(
                f"At t = {nodes.time[k]:.9g} s the guard of `{name}` only touches zero (its rate is {abs(rate):.3g} where {mean:.3g} is usual): "
                "the run grazes there and has no derivative.", nodes)  # fmt: skip
        return abs(rate) / mean if mean > 0.0 else np.inf

    def _struck(self, nodes: Trajectory, state: np.ndarray, k: int, struck: list[int], p: np.ndarray, modes: np.ndarray) -> np.ndarray:
        """Derivative (n, 1 + n + parameters) of an impact with respect to time, states and parameters.

        The loop does not record which friction took part in it and how; the combination that gives the recorded state is the one.
        """
        program, n = self.program, self.states
        t, x, goal = nodes.time[k], state[k], state[k + 1]
        scale = np.abs(state).max(axis=0) + 1e-300
        partners = [i for i in range(program.kind.size) if program.attached[i] >= 0]
        closed = [i for i in range(program.kind.size) if program.kind[i] == work_layout.RIGID and nodes.mode[k, i] == 0]
        best, found = np.inf, None
        for elastic, *choice in itertools.product((1.0, 0.0), *[(0, 1, -1)] * len(partners), *[(1, 0)] * len(closed)):
            marks, m = np.zeros(program.kind.size + 1), nodes.mode[k].astype(float)
            marks[-1] = elastic
            marks[struck] = 1.0
            for i, way in zip(partners, choice, strict=False):
                marks[i], m[i] = (1.0, 0.0) if way == 0 else (0.0, float(way))
            for i, way in zip(closed, choice[len(partners) :], strict=True):
                marks[i] = way
            landed, of_t, of_z = (np.array(v) for v in self.impact(t, x, p, m, marks))
            away = float(np.max(np.abs(landed.ravel() - goal) / scale))
            if away < best:
                best, found = away, np.hstack([of_t, of_z])
        if found is None or best > 1e-5:
            raise GrazingError(f"The impact at t = {t:.9g} s was not resolved: it has no derivative.", nodes)
        if ((program.kind != work_layout.SWITCH) & (nodes.mode[k + 1] == 0)).any():
            of_goal = np.array(self.projection(t, goal, p, modes[k + 1]))
            of_parameters = of_goal[:, n:]
            found = of_goal[:, :n] @ found
            found[:, 1 + n :] += of_parameters
        return found


def _drifting(of_field: ca.SX, of_guards: ca.SX) -> np.ndarray:
    """Which states only add up what others do, such as the angle of a free shaft: nothing but such states depends on them."""
    field, guards = (np.array(ca.DM(matrix.sparsity())) != 0 for matrix in (of_field, of_guards))
    drifts = np.zeros(field.shape[1], bool)
    while True:
        more = ~drifts & ~guards.any(axis=0) & ~field[~drifts].any(axis=0)
        if not more.any():
            return drifts
        drifts |= more


def variational_equations(program: Program, columns: tuple[int, ...]) -> VariationalEquations:
    """The compiled derivatives of a program; kept with it."""
    key = ("variational", columns)
    found = program.outputs.get(key)
    if found is None:
        found = program.outputs[key] = VariationalEquations(program, columns)
    return found


def sided(expression: ca.SX, moving: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """The expression with fabs, fmin and fmax of what moves written with their side as a symbol; the symbols; the arguments whose sign the sides are."""
    expression = ca.densify(expression)
    symbols = ca.symvar(expression)
    kinked = (ca.OP_FABS, ca.OP_FMIN, ca.OP_FMAX)
    function = ca.Function("scan", symbols, [expression]) if symbols else None
    if function is None or not any(function.instruction_id(k) in kinked for k in range(function.n_instructions())):
        return expression, ca.SX(0, 1), ca.SX(0, 1)
    called = calls(function)
    work: dict[int, tuple[ca.SX, ca.SX]] = {}
    sides: list[ca.SX] = []
    arguments: list[ca.SX] = []
    out = ca.SX(expression)

    def side(argument: ca.SX) -> ca.SX:
        for known, symbol in zip(arguments, sides, strict=True):
            if ca.is_equal(known, argument, 5):
                return symbol
        arguments.append(argument)
        sides.append(ca.SX.sym(f"side_{len(sides)}"))
        return sides[-1]

    for k in range(function.n_instructions()):
        op, args, target = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_INPUT:
            work[target[0]] = (symbols[args[0]].nz[args[1]],) * 2
        elif op == ca.OP_CONST:
            work[target[0]] = (ca.SX(function.instruction_constant(k)),) * 2
        elif op == ca.OP_OUTPUT:
            out.nz[target[1]] = work[args[0]][1]
        elif op == ca.OP_CALL:
            sides_of = [called_with(called[k], [work[i][which] for i in args]) for which in (0, 1)]
            work |= zip(target, zip(*sides_of, strict=True), strict=True)
        else:
            plain = [work[i][0] for i in args]
            new = [work[i][1] for i in args]
            was = ca.SX.unary(op, *plain) if len(args) == 1 else ca.SX.binary(op, *plain)
            argument = None if op not in kinked else plain[0] if op == ca.OP_FABS else plain[0] - plain[1]
            if argument is not None and ca.depends_on(argument, moving):
                if op == ca.OP_FABS:
                    now = side(argument) * new[0]
                else:
                    half = side(argument) * (new[0] - new[1]) / 2
                    now = (new[0] + new[1]) / 2 + (half if op == ca.OP_FMAX else -half)
            else:
                now = ca.SX.unary(op, *new) if len(args) == 1 else ca.SX.binary(op, *new)
            work[target[0]] = (was, now)
    return out, ca.vertcat(*sides), ca.vertcat(*arguments)
