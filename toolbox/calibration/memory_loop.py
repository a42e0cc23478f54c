"""A law of friction with memory against measured force over measured slip: its memory is integrated along the slip that was measured, without the machine.

Between samples the slip follows the cubic spline through them (C. de Boor, A Practical Guide to Splines, Springer 1978), and where only its way was measured,
the slope of that curve: straight lines would cut off the peaks of the speed, and curves of lower order, such as that of Akima, still move the stiffness and the
damping of bristles by more than their intervals. Steps are those of a linearly
implicit method of second order, ROS2 (J. G. Verwer and others, SIAM J. Sci. Comput. 20 (1999) 1456-1480), because a bristle yields within a small part of the
time between samples. Slopes are those of these very steps.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from toolbox.arguments import count_of
from toolbox.calibration.columnwise import Columnwise
from toolbox.calibration.misfit import ContactMisfit
from toolbox.calibration.panels import Panel
from toolbox.calibration.recording import Recording
from toolbox.calibration.shifts import Shift, moved
from toolbox.errors import SceneError
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.numbers import Number

FINE = 1e-4
"""Change of the force, in parts of its deviation, by twice as many steps between samples, below which there are enough."""

MOST_STEPS = 64
"""Steps between two samples, at most."""

TRIAL_MEMORY = 4000
"""Samples, from the first on, with which the searches from different starts are done."""


class MemoryLoop(ContactMisfit):
    """The law of a contact without modes against measured force over measured slip.

    output: the measured signal that holds the force;  memory: rows of the states that the law remembers by.
    """

    def __init__(self, loop: ClosedLoop, recording: Recording, numbers: Sequence[Number], contact: str, shifts: Sequence[Shift] = ()):
        plant = loop.assembly.plant
        self.loop, self.plant, self.numbers, self.contact = loop, plant, list(numbers), contact
        self.names = [number.name for number in numbers]
        rows = [(first, count_of(size)) for name, (first, size, _) in plant.states.items() if name.startswith(f"{contact}.")]
        self.memory = [row for first, size in rows for row in range(first, first + size)]
        memory = plant.x[self.memory]
        self.output = self._force_signal(recording, memory)
        given = loop.input_values
        self.recording, self.shifts = _continuous(recording, [name for name in recording.signals if name != self.output]), tuple(shifts)
        law = ca.vertcat(plant.flow[self.memory], plant.expression(self.output))
        if plant.F.numel() and ca.depends_on(law, plant.F):
            raise SceneError(f"The signal `{self.output}` must hold the force of `{contact}` alone, but that of another contact enters it.")
        measured = [name for name in plant.inputs if name in self.recording.signals]
        law = self._driven(law, given, measured)
        self._sources = self._driving(law, measured)
        self._begin = {row: (number.name, i) for i, number in enumerate(numbers) if number.is_start for row in self._row(number.name)}
        self._first = np.array([self._declared(row) for row in self.memory])
        self._last: tuple[bytes, np.ndarray] = (b"", plant.values)
        free = ca.vertcat(*[plant.p[plant._parameter(name).offset] for name in self._parameters]) if self._parameters else ca.SX(0, 1)
        self._law = law, free
        driving = ca.vertcat(*[symbol for symbol, *_ in self._sources])
        symbols = [memory, driving, plant.p]
        force = law[len(self.memory)]
        slopes = [ca.densify(ca.jacobian(force, each)) for each in (memory, free)]
        self._force = Columnwise(ca.Function("force", symbols, [force]))
        self._force_slopes = Columnwise(ca.Function("force_slopes", symbols, slopes))
        self.outputs = [self.output]
        self._kept = self._compared()
        self.time = {self.output: self.recording.time[self._kept]}
        self.measured = {self.output: self.recording.signals[self.output][self._kept]}
        self.steps = self.every = 1
        self._made: dict[tuple[int, bool], ca.Function] = {}

    def _driven(self, law: ca.SX, given: Mapping[str, Any], measured: Sequence[str]) -> ca.SX:
        """The law with inputs that were not measured as numbers. Raises SceneError for one that varies in time."""
        constants = []
        for name, entry in self.plant.inputs.items():
            value = given.get(name, entry.default)
            known = isinstance(value, (int, float, ca.SX))
            if name not in measured and not known and ca.depends_on(law, entry.symbol):
                raise SceneError(f"Argument `{name}` must be a number or be measured for a loop to be fitted, but it varies in time.")
            constants.append(value if known and name not in measured else entry.symbol)
        return ca.substitute(law, self.plant.u, ca.vertcat(*constants)) if constants else law

    def _compared(self) -> np.ndarray:
        """Where the force was measured, and the slip for every shift between its bounds."""
        time = self.recording.time
        kept: np.ndarray = np.isfinite(self.recording.signals[self.output])
        for shift in self.shifts:
            reach = max(shift.high, -shift.low, 0.0)
            kept &= (time >= reach) & (time <= time[-1] - reach)
        return kept

    @property
    def _parameters(self) -> list[str]:
        return [number.name for number in self.numbers if number.is_parameter]

    @property
    def how(self) -> str:
        """What was fitted, in words."""
        return f"law of `{self.contact}`, with memory, along the measured slip"

    def _row(self, name: str) -> list[int]:
        """The row of a start value of the memory. Raises SceneError for any other start value."""
        rows = self.plant.state_index(name)
        if rows is None or rows[0] not in self.memory:
            raise SceneError(
                f"Argument `free` must hold parameters and the memory of `{self.contact}` for its law to be fitted, but it has `{name}`."
            )
        return [rows[0]]

    def _declared(self, row: int) -> float:
        """Where an entry of the memory starts, as the loop says."""
        for name, value in self.loop.start.items():
            rows = self.plant.state_index(name)
            if rows is not None and rows[0] == row:
                return float(value)
        return float(self.plant.begin[row])

    def _driving(self, law: ca.SX, measured: Sequence[str]) -> list[tuple[ca.SX, str, bool]]:
        """(symbol, measured signal, whether the symbol is its rate) of all that the law is driven by. Raises SceneError for what was not measured."""
        plant = self.plant
        found = [(plant.inputs[name].symbol, name, False) for name in measured if ca.depends_on(law, plant.inputs[name].symbol)]
        held = {name: rows[0] for name in self.recording.signals if (rows := self._state(name)) is not None}
        for row in range(plant.x.numel()):
            symbol = plant.x[row]
            if row in self.memory or not ca.depends_on(law, symbol):
                continue
            own = next((name for name, at in held.items() if at == row), None)
            way = next((name for name, at in held.items() if ca.is_equal(plant.flow[at], symbol)), None)
            if own is None and way is None:
                raise self._missing(row)
            found.append((symbol, own or way or "", own is None))
        return found

    def _state(self, name: str) -> tuple[int, int] | None:
        """(row, 1) of a measured signal that is a state."""
        expression = self.plant.expression(name)
        if expression.numel() != 1:
            return None
        rows = (row for row in range(self.plant.x.numel()) if ca.is_equal(expression, self.plant.x[row]))
        row = next(rows, None)
        return None if row is None else (row, 1)

    def _columns(self, values: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """What drives the law: at the ends of the steps of every interval between samples, shape (sources x (steps + 1), nt - 1), and at the samples."""
        from scipy.interpolate import CubicSpline  # here, because scipy.interpolate is slow to import

        time = self.recording.time
        through = np.unique(np.append(np.arange(0, time.size, self.every), time.size - 1))
        parts = np.linspace(0.0, 1.0, steps + 1)[:, None]
        nodes = time[:-1] + parts * np.diff(time)
        signals = moved(self.recording, self.shifts, values, self.output)
        between, at = [], []
        for _, name, is_way in self._sources:
            curve = CubicSpline(time[through], signals[name][through])
            curve = curve.derivative() if is_way else curve
            between.append(curve(nodes))
            at.append(curve(time))
        return np.stack(between, axis=1).reshape(-1, time.size - 1), np.array(at)

    def _step(self, steps: int, slopes: bool) -> ca.Function:
        """What the memory, and its slopes, come to over one interval between samples."""
        made = self._made.get((steps, slopes))
        if made is not None:
            return made
        law, free = self._law
        n, driving = len(self.memory), ca.vertcat(*[symbol for symbol, *_ in self._sources])
        memory, p, count = self.plant.x[self.memory], self.plant.p, driving.numel()
        rate = ca.Function("rate", [memory, driving, p], [law[:n]])
        z, begin, end, h = ca.SX.sym("z", n), ca.SX.sym("begin", driving.numel()), ca.SX.sym("end", driving.numel()), ca.SX.sym("h")
        gamma = 1.0 - 1.0 / math.sqrt(2.0)
        flow = rate(z, begin, p)
        matrix = ca.SX.eye(n) - gamma * h * ca.jacobian(flow, z)
        turn = gamma * ca.jtimes(flow, begin, end - begin)
        one = ca.solve(matrix, flow + turn)
        two = ca.solve(matrix, rate(z + h * one, end, p) - 2.0 * one - turn)
        after = z + h * (1.5 * one + 0.5 * two)
        tangent = ca.SX.sym("tangent", n, free.numel() + n)
        turned = ca.jacobian(after, z) @ tangent + ca.horzcat(ca.densify(ca.jacobian(after, free)), ca.SX.zeros(n, n))
        part = ca.Function("part", [z, tangent, begin, end, h, p], [after, turned if slopes else tangent])
        a, b, nodes = z, tangent, ca.SX.sym("nodes", count * (steps + 1))
        for i in range(steps):
            a, b = part(a, b, nodes[i * count : (i + 1) * count], nodes[(i + 1) * count : (i + 2) * count], h / steps, p)
        if slopes:
            made = ca.Function("step", [z, tangent, nodes, h, p], [a, b])
        else:
            made = ca.Function("step", [z, nodes, h, p], [ca.substitute(a, tangent, ca.SX.zeros(tangent.shape))])
        carried = [0, 1] if slopes else [0]
        made = self._made[steps, slopes] = made.mapaccum("along", self.recording.time.size - 1, carried, carried, {"base": 16})
        return made

    def _along(self, values: np.ndarray, slopes: bool, steps: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """(what drives the law, its memory (n, nt), slopes of the memory (nt, n, parameters and starts), numbers of the plant) at all samples."""
        p, n = self._numbers(values), len(self.memory)
        nodes, at = self._columns(values, steps)
        first = self._first.copy()
        for i, row in enumerate(self.memory):
            if row in self._begin:
                first[i] = values[self._begin[row][1]]
        h = np.diff(self.recording.time)[None]
        k = len(self._parameters)
        tangent = np.hstack([np.zeros((n, k)), np.eye(n)])
        given = [first, tangent, nodes, h, np.repeat(p[:, None], h.size, axis=1)]
        found = self._step(steps, slopes)(*(given if slopes else [given[0], *given[2:]]))
        memory = np.hstack([first[:, None], np.array(found[0] if slopes else found)])
        if not slopes:
            return at, memory, np.empty(0), p
        turned = np.array(found[1]).reshape(n, h.size, k + n).transpose(1, 0, 2)
        return at, memory, np.concatenate([tangent[None], turned]), p

    def resolved(self, values: np.ndarray) -> MemoryLoop:
        """Itself, with as many steps between samples as the force at these numbers asks for."""
        size = float(np.std(self.measured[self.output])) or 1.0
        coarse = self.model(values)[self.output]
        while self.steps < MOST_STEPS:
            self.steps *= 2
            fine = self.model(values)[self.output]
            if np.abs(fine - coarse).max(initial=0.0) < FINE * size:
                break
            coarse = fine
        return self

    def _force_at(self, values: np.ndarray) -> np.ndarray:
        at, memory, _, p = self._along(values, False, self.steps)
        ((force,),) = self._force(list(memory), list(at), p.tolist(), count=memory.shape[1])
        found: np.ndarray = np.broadcast_to(force, memory.shape[1])[self._kept]
        return found

    def _slopes_at(self, values: np.ndarray) -> np.ndarray:
        at, memory, turned, p = self._along(values, True, self.steps)
        count = memory.shape[1]
        of_memory, of_free = self._force_slopes(list(memory), list(at), p.tolist(), count=count)
        along = np.stack([np.broadcast_to(each, count) for each in of_memory], axis=1)
        through = np.einsum("ni,nij->nj", along, turned)
        found = np.empty((values.size, count)).T
        k, parameters = len(self._parameters), self._parameters
        for i, number in enumerate(self.numbers):
            if number.is_parameter:
                j = parameters.index(number.name)
                found[:, i] = through[:, j] + of_free[j]
            elif number.is_start:
                found[:, i] = through[:, k + self.memory.index(self._row(number.name)[0])]
        return found[self._kept]

    def panels(self, left: Mapping[str, np.ndarray], _: np.ndarray) -> tuple[Panel, ...]:
        """What was measured beside the law, over what drives it; left: law less measured."""
        name, measured = self.output, self.measured[self.output]
        source = next((signal for _, signal, _ in self._sources), name)
        unit = self.plant.unit(source)
        over = self.recording.signals[source][self._kept]
        nowhere = np.zeros(measured.size, bool)
        return (Panel(name, self.plant.unit(name), f"{source} [{unit}]", over, measured, measured + left[name], nowhere, np.empty((2, 0))),)

    def thinned(self) -> MemoryLoop:
        """The misfit along the curve through every other sample of what drives the law."""
        made = MemoryLoop(self.loop, self.recording, self.numbers, self.contact, self.shifts)
        made.steps, made.every = self.steps, 2 * self.every
        return made

    def trial(self) -> MemoryLoop:
        """The misfit of the first samples: enough to find what is then fitted to all."""
        if self.recording.time.size <= 2 * TRIAL_MEMORY:
            return self
        few = self.recording.between(0.0, float(self.recording.time[TRIAL_MEMORY]))
        made = MemoryLoop(self.loop, few, self.numbers, self.contact, self.shifts)
        made.steps = self.steps
        return made


def _continuous(recording: Recording, names: Sequence[str]) -> Recording:
    """The samples at which all of these were measured. Raises SceneError where they lie farther apart than a gap, over which a memory is lost."""
    if not names:  # the law will say what it lacks
        return recording
    recording.unbroken(names, "what a law with memory is driven by")
    good = np.all([np.isfinite(recording.signals[name]) for name in names], axis=0)
    time = recording.time[good]
    signals = {name: values[good] for name, values in recording.signals.items()}
    return Recording(time - time[0], signals, recording.source, recording.units, recording.flaws, recording.notes)
