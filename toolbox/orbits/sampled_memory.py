"""Tangent of sampled control laws: derivatives of their memory z and held outputs h are propagated from sample to sample.

    z+ = a(t, x, h, z, p),   w = b(t, x, h, z, p)      at the samples t_k = k period: memory z, outputs w
    h+ = w                                             at t_k + delay: held signals h

Samples come at given times. Neither they nor the jumps of force that they make move with a parameter, and states are continuous there, so that derivatives
pass through those of a and b, and no saltation is needed. Only where an event meets a sample is there none: which of the two comes first decides.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import count_of
from toolbox.compilation.program import Program
from toolbox.errors import GrazingError, SceneError
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.simulation.trajectory import Trajectory

MEETING = 1e-9
"""An event nearer to a sample than this part of the period meets it, and so does a force this near to its bound when it is held."""


@dataclass
class Waiting:
    """Outputs that were computed and wait for their delay: values, and their derivatives in k directions, shape (outputs, k)."""

    values: np.ndarray
    tangent: np.ndarray


class SampledLaws:
    """The sampled laws of a program, with compiled derivatives of their updates with respect to states, held signals, memory and parameters.

    held, memory: sizes of h and z;  read: entries of h that a law reads before they are held again;  angles: which states a law reads, by row.
    """

    def __init__(self, program: Program, columns: tuple[int, ...]):
        system = program.system
        p = program.expressions[0]
        chosen = ca.vertcat(*[p[c] for c in columns]) if columns else ca.SX(0, 1)
        self.program, self.n, self.held = program, system.x.numel(), system.held.numel()
        self.places: list[int] = []
        self.functions = []
        self.memory = 0
        reads = np.zeros(self.n + self.held, bool)
        for update in system.updates:
            pair = ca.densify(program.closed(ca.vertcat(update.following, update.outputs)))
            of = ca.vertcat(system.x, system.held, update.memory, chosen)
            slope = ca.jacobian(pair, of)
            reads |= np.any(np.array(ca.DM(slope.sparsity())) != 0, axis=0)[: reads.size]
            symbols = [system.t, system.x, p, system.m, update.memory, update.noise]
            self.functions.append(ca.Function("update", symbols, [pair, ca.densify(slope)]))
            self.places.append(self.memory)
            self.memory += update.memory.numel()
        self.reads = reads[: self.n]
        self.read = np.flatnonzero(reads[self.n :])


class SampledTangent:
    """Derivatives of sampled laws along a run, beginning with those of their memory, shape (memory, k).

    `due` holds the nodes at which a law is sampled or its output applied; `act(k, ...)` carries the derivatives over node k.
    """

    def __init__(self, laws: SampledLaws, nodes: Trajectory, memory: np.ndarray, own: int):
        from toolbox.stepping.noise import channel_key

        self.controllers, self.nodes, self.own = laws, nodes, own
        system, run = laws.program.system, nodes.run
        start = run.start
        self.value = start.held.copy()
        self.z, self.tangent, place = [], [], 0
        for at, update in zip(laws.places, system.updates, strict=True):
            size = update.memory.numel()
            self.z.append(start.memory[place : place + size].copy())
            self.tangent.append(memory[at : at + size].copy())
            place += size + len(update.channels)
        self.keys = [
            [channel_key(seed, zlib.crc32(name.encode())) for name in update.channels]
            for seed, update in zip(run.seeds, system.updates, strict=True)
        ]
        self.waiting: list[dict[int, Waiting]] = [
            {s: Waiting(row, np.zeros((row.size, memory.shape[1]))) for s, row in enumerate(rows, start.applied[c])}
            for c, rows in enumerate(start.waiting)
        ]
        self.due: dict[int, list[tuple[bool, int, int]]] = {}
        self._planned()
        self._kept_apart()

    def _planned(self) -> None:
        """Which law samples, and which output is held, at which node; samples of one instant before holds, laws in their order, as in the loop."""
        time, end, instants, start = self.nodes.time, self.nodes.end, [], self.nodes.run.start
        planned: list[tuple[int, bool, int, int]] = []
        for c, clock in enumerate(self.nodes.run.clocks):
            first, applied = start.taken[c], start.applied[c]
            taken = np.arange(first, int(end / clock.period) + 2) * clock.period
            taken = taken[(taken < self.nodes.run.end) & (taken <= end)]
            held = np.arange(applied, first + taken.size) * clock.period + clock.delay
            held = held[held <= end]
            for late, times, number in ((False, taken, first), (True, held, applied)):
                place = np.searchsorted(time, times * (1 + 1e-13) + 1e-300, side="right") - 1
                planned += [(int(k), late, c, s) for s, k in enumerate(place, number)]
            instants.append(np.unique(np.concatenate([taken, held])))
        self.instants = instants
        for k, late, c, s in sorted(planned):
            self.due.setdefault(k, []).append((late, c, s))

    def _kept_apart(self) -> None:
        """Raise GrazingError where an event meets a sample, or a held signal brings a force just to its bound."""
        nodes = self.nodes
        event_time, element, _ = nodes._event_arrays
        names = [e.name for e in nodes.program.system.elements]
        time = nodes.time
        for instants, clock in zip(self.instants, nodes.run.clocks, strict=True):
            for t, i in zip(event_time, element, strict=True):
                near = np.searchsorted(instants, t)
                gap = min((abs(instants[j] - t) for j in (near - 1, near) if 0 <= j < instants.size), default=np.inf)
                at = np.searchsorted(time, t)
                made = gap == 0.0 and (at + 1 >= time.size or time[at + 1] > t)  # by the held signal, not at the end of a step
                if gap <= MEETING * clock.period and not made:
                    raise GrazingError(
                        f"At t = {t:.9g} s `{names[i]}` switches at a sample: which comes first decides, and no derivative exists.", nodes
                    )

    def checked_holds(self, guards: Any, states: np.ndarray, modes: np.ndarray) -> None:
        """Raise GrazingError where a held signal brings a sticking force just to its bound; guards: of (t, states, p, modes)."""
        nodes, program = self.nodes, self.controllers.program
        elements = program.system.elements
        rows = np.array([k for k in self.due if k > 0 and any(late for late, _, _ in self.due[k])], int)
        sticking = [i for i, e in enumerate(elements) if e.slides and (nodes.mode[:, i] == 0).any()]
        if not rows.size or not sticking:
            return
        p = np.repeat(nodes.parameters[:, None], rows.size, axis=1)
        p[program.first_held :] = nodes.held[rows].T
        before = modes[rows - 1]
        values = np.abs(np.array(guards(nodes.time[None, rows], states[rows].T, p, before.T)))
        for i in sticking:
            stuck = before[:, i] == 0
            for j in (2 * i, 2 * i + 1):
                size = values[j, stuck].max(initial=0.0)
                wrong = np.flatnonzero(stuck & (values[j] <= MEETING * size))
                if size > 0.0 and wrong.size:
                    raise GrazingError(
                        f"At t = {nodes.time[rows[wrong[0]]]:.9g} s a held signal brings the force of `{elements[i].name}` just to its bound: "
                        "no derivative exists.", nodes)  # fmt: skip

    def act(self, k: int, p: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """Everything that is due at node k, given the derivatives (n + held, directions) of states and held signals; returns them as they are after it."""
        from toolbox.stepping.noise import normal

        laws, nodes = self.controllers, self.nodes
        first = laws.program.first_held
        paired = k > 0 and nodes.time[k - 1] == nodes.time[k]
        mode = nodes.mode[k if k == 0 or paired else k - 1].astype(float)
        for late, c, s in self.due[k]:
            update = laws.program.system.updates[c]
            if late:
                arriving = self.waiting[c].pop(s)
                place = slice(update.first_held, update.first_held + arriving.values.size)
                self.value[place] = arriving.values
                tangent = tangent.copy()
                tangent[laws.n :][place] = arriving.tangent
                continue
            p[first:] = nodes.held[k]
            p[first : first + laws.held] = self.value
            noise = [normal(key, s) for key in self.keys[c]]
            found, slope = (np.array(v) for v in laws.functions[c](nodes.time[k], nodes.states[k], p, mode, self.z[c], noise))
            size, found = self.z[c].size, found.ravel()
            middle = laws.n + laws.held
            change = slope[:, :middle] @ tangent + slope[:, middle : middle + size] @ self.tangent[c]
            change[:, self.own :] += slope[:, middle + size :]
            self.z[c], self.tangent[c] = found[:size], change[:size]
            self.waiting[c][s] = Waiting(found[size:], change[size:])
        recorded = nodes.held[k, : laws.held]
        away = np.abs(self.value - recorded) > 1e-7 * np.maximum(np.abs(recorded), np.abs(self.value)) + 1e-9 * np.abs(
            nodes.held[:, : laws.held]
        ).max(axis=0)
        if any(late for late, _, _ in self.due[k]) and away.any():
            raise GrazingError(
                f"What a sampled law computed at t = {nodes.time[k]:.9g} s is not what the record holds: it reads a force that the sample itself decides.",
                nodes,
            )
        return tangent

    @property
    def memory(self) -> np.ndarray:
        """Derivatives of all memory as it is now, shape (memory, k)."""
        return np.vstack(self.tangent) if self.tangent else np.empty((0, 0))


def check_laws(system: HybridSystem) -> None:
    """Raise SceneError for a closed system with a sampled law that has no derivative: a Python callable, or one that reads an encoder."""
    sensing: list[Any] = [part for part in system.parts if getattr(part, "sensors", None) is not None]
    for update, part in zip(system.updates, sensing, strict=False):
        if update.from_callable:
            raise SceneError(
                "Argument `controller` must be written in casadi for a run to have derivatives, but a law is a Python callable."
            )
        if part.sensors.resolution is not None:
            raise SceneError(
                f"Argument `resolution` must be left out for a run to have derivatives, but the encoder of `{part.sensors.coarse[0]}` has steps, "
                "and a rounded measurement has the derivative 0."
            )


def default_slopes(run: Any, program: Program, columns: tuple[int, ...]) -> np.ndarray:
    """Derivatives of the signals held before the first sample, which are defaults where outputs are late, with respect to parameters: (held, columns)."""
    system, plant = program.system, run.plant
    slopes = np.zeros((system.held.numel(), len(columns)))
    if run.start.carried:
        return slopes
    for update, clock in zip(system.updates, run.clocks, strict=True):
        for row, name in enumerate(update.names, update.first_held):
            if clock.delay > 0.0 and name in plant.inputs:
                of = ca.Function("slope", [plant.p], [ca.densify(ca.jacobian(plant.inputs[name].default, plant.p))])
                gradient = np.array(of(plant.values)).ravel()
                for entry in plant.parameters.values():
                    closed = system.parameters.get(entry.name)
                    if closed is None:  # what the law drives is no parameter of the closed loop
                        continue
                    for j, column in enumerate(columns):
                        if closed.offset <= column < closed.offset + count_of(entry.size):
                            slopes[row, j] = gradient[entry.offset + column - closed.offset]
    return slopes
