"""How far a machine with given numbers is from what was measured, and how that changes with the numbers.

Two misfits, one interface (`model`, `slopes`, `measured`, `time`):

    Simulated     the measured inputs drive a simulation; its outputs at the measured times are compared with the measured ones. Slopes are those of
                  `toolbox.sensitivity`, exact through every stick and slip.
    MeasuredLoop  the friction law of one contact is compared with measured force at measured slip, sample by sample, without simulation. In stick friction
                  is whatever the machine asks for and says nothing, except at its end: the force at break-away is the static bound.
"""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from toolbox.calibration.columnwise import Columnwise
from toolbox.calibration.panels import TIME, Panel
from toolbox.calibration.recording import Recording
from toolbox.errors import GrazingError, SceneError, SimulationError, suggest
from toolbox.measuring.measure import stick_intervals
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.elements import check_one_direction
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.inputs import Table
from toolbox.modelling.numbers import Number
from toolbox.modelling.start import place_start
from toolbox.orbits.sensitivity import sensitivity
from toolbox.simulation.simulate import simulate
from toolbox.simulation.trajectory import Trajectory

HORIZONS = (0.25, 0.5)
"""Parts of the data that a simulation is fitted to before all of them."""

TRIAL = 500
"""Samples of a loop, about, with which the searches from different starts are done."""

TRIAL_RUN = 2000
"""Samples of a simulation, about, with which the searches from different starts are done where there are several times as many."""

TRIAL_ACCURACY = 1e-5
"""Accuracy of their runs, at best."""

BREAKAWAY_SAMPLES = 10
"""Last samples of a stick phase through which a line is laid, whose end is the force at break-away; a shorter phase tells nothing."""


@dataclass
class Simulated:
    """Outputs of a simulation against measured ones.

    loop: driven by the measured inputs;  numbers: of the loop, which are free.
    """

    loop: ClosedLoop
    recording: Recording
    numbers: Sequence[Number]
    accuracy: float

    def __post_init__(self) -> None:
        self.names = [number.name for number in self.numbers]
        self.outputs = [name for name in self.recording.signals if name not in self.loop.inputs]
        self.good = {name: np.isfinite(self.recording.signals[name]) for name in self.outputs}
        self.time = {name: self.recording.time[good] for name, good in self.good.items()}
        self.measured = {name: self.recording.signals[name][good] for name, good in self.good.items()}
        self.exact = True
        self._last: tuple[bytes, Trajectory] | None = None

    def horizons(self) -> list[Simulated]:
        """The misfit over the first quarter, the first half and all of the data.

        Over many cycles a small error of the period makes phases drift apart, and the misfit has an optimum for every cycle that is off; over few it has
        not, and leads to numbers from which the long one is a small step.
        """
        end = float(self.recording.time[-1])
        shorter = [
            Simulated(self.loop, self.recording.between(0.0, part * end), self.numbers, self.accuracy)
            for part in HORIZONS
            if part * self.recording.time.size >= 10 * len(self.names)
        ]
        return [*shorter, self]

    def thinned(self) -> Simulated | None:
        """The misfit with every other sample of its measured inputs left out; None where no input is measured."""
        given = self.loop.values
        measured = [name for name in self.recording.signals if isinstance(given.get(name), Table)]
        if not measured:
            return None
        fewer = {}
        for name in measured:
            size = given[name].times.size
            keep = np.unique(np.append(np.arange(0, size, 2), size - 1))
            fewer[name] = Table(given[name].times[keep], given[name].values[keep])
        return Simulated(self.loop.but(inputs={**self.loop.inputs, **fewer}), self.recording, self.numbers, self.accuracy)

    def trial(self) -> Simulated:
        """The misfit of means over groups of samples, with runs of a coarse accuracy: enough to find what is then fitted to all."""
        groups = self.recording.time.size // TRIAL_RUN
        if groups < 2:
            return self
        coarse = self.recording.resampled(groups * self.recording.interval)
        fewer = {}
        for name, value in self.loop.values.items():
            if name in coarse.signals and isinstance(value, Table):
                good = np.isfinite(coarse.signals[name])
                fewer[name] = Table(coarse.time[good], coarse.signals[name][good])
        return Simulated(self.loop.but(inputs={**self.loop.inputs, **fewer}), coarse, self.numbers, max(self.accuracy, TRIAL_ACCURACY))

    @property
    def plant(self) -> HybridSystem:
        """The plant with its laws."""
        return self.loop.system

    def at(self, values: np.ndarray) -> ClosedLoop:
        """The loop with the free numbers at given values; raises SceneError where they contradict each other."""
        loop = self.loop
        for number, value in zip(self.numbers, values.tolist(), strict=True):
            loop = number.put(loop, value)
        return loop

    def run(self, values: np.ndarray) -> Trajectory:
        """The simulation with the free numbers at given values; raises what `simulate` raises."""
        key = values.tobytes()
        if self._last is None or self._last[0] != key:  # slopes are asked for where the model just was
            end = float(self.recording.time[-1])
            self._last = (key, simulate(self.at(values), end, output_times=self.recording.time, accuracy=self.accuracy))
        return self._last[1]

    how = "by simulation"

    def panels(self, left: Mapping[str, np.ndarray], found: np.ndarray) -> tuple[Panel, ...]:
        """What was measured beside the model; left: model less measured;  found: the free numbers."""
        run, nothing = self.run(found), np.empty((2, 0))
        contacts = [name for name in run.contacts if name in run.modes]

        def sticks(name: str) -> np.ndarray:
            """Of the contact of that part, or of the only one."""
            own = [each for each in contacts if each == name.partition(".")[0]] or (contacts if len(contacts) == 1 else [])
            return np.array([pair for each in own for pair in stick_intervals(run, each, run.begin)], float).reshape(-1, 2)

        values = ((name, self.plant.unit(name), self.measured[name], self.measured[name] + left[name]) for name in self.outputs)
        return tuple(
            Panel(name, unit, TIME, self.time[name], measured, model, np.zeros(measured.size, bool), nothing, sticks(name))
            for name, unit, measured, model in values
        )

    def allowed(self, values: np.ndarray) -> None:
        """Raise SceneError where the numbers contradict each other."""
        self.at(values).closed  # noqa: B018

    def model(self, values: np.ndarray) -> dict[str, np.ndarray]:
        """Simulated outputs at the times of samples that are data; where a signal jumps within half a sampling interval of a sample, the nearer side counts.

        Else every sample that a switch passes would be a step of the misfit, and their edges would hold the search before its optimum.
        """
        run = self.run(values)
        found = {name: np.array(run[name]) for name in self.outputs}
        nodes, time = run.nodes, self.recording.time
        gap = np.diff(time)
        near = np.minimum(np.append(gap, gap[-1]), np.insert(gap, 0, gap[0])) / 2
        times = np.unique([event.time for event in run.events])
        at = {name: nodes[name] for name in found} if times.size else {}
        for t in times:
            before, after = np.searchsorted(nodes.time, t), np.searchsorted(nodes.time, t, side="right") - 1
            for k in range(max(np.searchsorted(time, t) - 1, 0), min(np.searchsorted(time, t, side="right") + 1, time.size)):
                if abs(time[k] - t) < near[k]:
                    for name, value in found.items():
                        jump = (at[name][after] - at[name][before]) * (-1.0 if time[k] >= t else 1.0)
                        there = self.recording.signals[name][k]
                        if abs(value[k] + jump - there) < abs(value[k] - there):
                            value[k] += jump
        return {name: value[self.good[name]] for name, value in found.items()}

    def slopes(self, values: np.ndarray, sizes: np.ndarray) -> dict[str, np.ndarray]:
        """Derivatives of `model` with respect to the free numbers, shape (nt, k): exact, or central differences where a run has none."""
        if self.exact:
            try:
                slopes = sensitivity(self.run(values), list(self.names))
                return {name: slopes[name][self.good[name]] for name in self.outputs}
            except GrazingError:
                pass
            except SceneError:  # a law in Python, or one that reads an encoder
                self.exact = False
        columns = []
        for i, size in enumerate(sizes):
            step = np.zeros(values.size)
            step[i] = 1e-5 * size
            ahead, back = (self.model(values + sign * step) for sign in (1.0, -1.0))
            columns.append({name: (ahead[name] - back[name]) / (2 * step[i]) for name in self.outputs})
        return {name: np.stack([column[name] for column in columns], axis=1) for name in self.outputs}


class MeasuredLoop:
    """The friction law of one contact against measured force at measured slip.

    output: the measured signal that holds the force;  slip: at every sample;  still: slip speed up to which the contact counts as at rest;  rows: indices of
    the samples that count;  released: True for those of them at break-away.
    """

    exact = True

    def __init__(self, loop: ClosedLoop, recording: Recording, numbers: Sequence[Number], contact: str, still: float | None):
        plant, inputs, names = loop.closed.plant, loop.values, [number.name for number in numbers]
        elements = [element.name for element in plant.elements]
        if contact not in elements or plant.elements[elements.index(contact)].law is None:
            raise SceneError(f"There is no contact with dry friction `{contact}`: {suggest(contact, elements)}")
        check_one_direction(plant.elements, "Measured friction", "fit the motion instead")
        self.plant, self.recording, self.names, self.place = plant, recording, names, elements.index(contact)
        self.loop, self.numbers = loop, numbers
        element: Any = plant.elements[self.place]
        force = plant.F[self.place]
        self.output = self._holder(contact, force)
        switches = [elements.index(twin.name) for twin in element.breaks]
        inside = self._inputs(inputs)
        gain, rest = ca.jacobian(plant.expression(self.output), force), ca.substitute(plant.expression(self.output), force, 0)
        side = ca.SX.sym("side")
        law: list[Any] = [element.slip, rest - gain * element.mode * element.kinetic, rest - gain * side * element.static]
        law += [-gain * side, ca.vertcat(*[twin.high for twin in element.breaks])]
        law = [ca.substitute(each, plant.u, inside) for each in law]
        self._complain_about_missing(contact, ca.vertcat(*law))
        free = ca.vertcat(*[plant.p[plant._parameter(name).offset] for name in names])
        symbols = [plant.x, self._u_symbol, plant.p, plant.m, side]
        self._law = Columnwise(ca.Function("law", symbols, law))
        self._law_slopes = Columnwise(ca.Function("law_slopes", symbols, [ca.densify(ca.jacobian(each, free)) for each in law[1:3]]))
        self._switches = switches

        self._last: tuple[bytes, np.ndarray] = (b"", plant.values)
        self._side = np.zeros(recording.time.size)
        known = np.all([np.isfinite(values) for values in recording.signals.values()], axis=0)
        self.slip = np.broadcast_to(self._of(self._law, plant.values)[0][0], recording.time.size)
        self.still = 0.01 * float(np.abs(self.slip[known]).max(initial=0.0)) if still is None else still
        moving = known & (np.abs(self.slip) > self.still)
        if not moving.any():
            raise SceneError(
                f"The data must hold samples in which `{contact}` slips faster than {self.still:g} {element.slip_unit}, but there are none."
            )
        self._side = np.sign(np.where(moving, self.slip, np.append(self.slip[1:], 0.0)))
        values, release = recording.signals[self.output].copy(), []
        cut = ~known | np.insert(np.diff(recording.time) > recording.gap, 0, False)  # no stick phase reaches over it
        toward = np.broadcast_to(np.sign(self._of(self._law, plant.values)[3][0]), values.size)
        for k in np.flatnonzero(moving[1:] & ~moving[:-1] & ~cut[1:]) if self._jumps(element) else []:
            first = 1 + int(np.max(np.flatnonzero((moving | ~known)[: k + 1]), initial=-1))
            first = max(first, int(np.max(np.flatnonzero(cut[: k + 1] & known[: k + 1]), initial=0)))
            if k + 1 - first >= BREAKAWAY_SAMPLES:  # a shorter one is noise where slip begins or ends
                top, value = _peak(recording.time[first : k + 1], values[first : k + 1], toward[k])
                values[first + top] = value
                self._side[first + top] = self._side[k]
                release.append(first + top)
        away = np.zeros(values.size, bool)
        away[release] = True
        rows = np.flatnonzero(moving | away)
        self.rows, self.released = rows, away[rows]
        self.outputs = [self.output]
        self.time, self.measured = {self.output: recording.time[rows]}, {self.output: values[rows]}

    @property
    def how(self) -> str:
        """What was fitted, in words."""
        return f"law of `{self.plant.elements[self.place].name}` against the measured loop"

    def panels(self, left: Mapping[str, np.ndarray], _: np.ndarray) -> tuple[Panel, ...]:
        """What was measured beside the law; left: law less measured."""
        name, element = self.output, self.plant.elements[self.place]
        measured = self.measured[name]
        rests = np.isfinite(self.slip + self.recording.signals[name])
        rests[self.rows] = False
        still = np.flatnonzero(rests)
        resting = np.stack([self.slip[still], self.recording.signals[name][still]])
        over = f"slip of {element.name} [{element.slip_unit}]"
        return (Panel(name, self.plant.unit(name), over, self.slip[self.rows], measured, measured + left[name], self.released, resting),)

    def at(self, values: np.ndarray) -> ClosedLoop:
        """The loop with the free numbers at given values."""
        return self.loop.but(parameters={**self.loop.parameters, **dict(zip(self.names, values.tolist(), strict=True))})

    def horizons(self) -> list[MeasuredLoop]:
        """The misfit itself: samples of a loop do not know of each other."""
        return [self]

    def thinned(self) -> None:
        """None: a loop asks for its inputs at the samples only."""
        return

    def trial(self) -> MeasuredLoop:
        """The misfit of at most about `TRIAL` samples, all break-aways among them: enough to find what is then fitted to all."""
        if self.rows.size <= 2 * TRIAL:
            return self
        chosen = self.released.copy()
        chosen[:: self.rows.size // TRIAL] = True
        few, kept = copy.copy(self), self.rows[chosen]
        few._x, few._u, few._side = self._x[:, kept], self._u[:, kept], self._side[kept]
        few.rows, few.released = np.arange(kept.size), self.released[chosen]
        few.time, few.measured = ({name: values[chosen] for name, values in each.items()} for each in (self.time, self.measured))
        return few

    def _jumps(self, element: Any) -> bool:
        """Whether the force drops at release: then release is sharp, and the force before it is the static bound; else slip itself tells the bound."""
        away = self.plant.p * 0 + self.plant.values * (1 + 0.1 * np.cos(np.arange(self.plant.values.size)))
        law = ca.vertcat(element.load * element.law.sliding(ca.SX(0), *[0] * len(element.breaks)), element.static)
        law = ca.substitute(ca.substitute(law, self.plant.u, ca.SX.ones(self.plant.u.numel())), self.plant.p, away)
        kinetic, static = np.array(ca.evalf(ca.substitute(law, ca.vertcat(*ca.symvar(law)), 1.0))).ravel()
        return bool(abs(static - kinetic) > 1e-12 * abs(static))

    def _holder(self, contact: str, force: ca.SX) -> str:
        """The measured signal that the force of the contact enters."""
        scalars = {name: expression for name, (expression, _) in self.plant.signals.items() if expression.numel() == 1}
        able = [name for name, expression in scalars.items() if ca.depends_on(expression, force)]
        there = [name for name in self.recording.signals if name in able]
        if len(there) != 1:
            raise SceneError(
                f"The data must hold exactly one signal with the force of `{contact}`, such as {' or '.join(f'`{name}`' for name in able)}, but "
                f"they hold {' and '.join(f'`{name}`' for name in there) or 'none'}."
            )
        expression = scalars[there[0]]
        others = [each.name for i, each in enumerate(self.plant.elements) if i != self.place and ca.depends_on(expression, self.plant.F[i])]
        if others or ca.depends_on(ca.jacobian(expression, force), force):
            raise SceneError(
                f"The signal `{there[0]}` must hold the force of `{contact}` alone, but that of `{others[0]}` enters it as well."
            )
        return there[0]

    def _inputs(self, given: Mapping[str, Any]) -> ca.SX:
        """The inputs of the plant: measured ones as symbols, others as given, or their defaults."""
        measured = [name for name in self.plant.inputs if name in self.recording.signals]
        self._u_symbol = ca.SX.sym("measured", len(measured))
        self._u = np.array([self.recording.signals[name] for name in measured]).reshape(len(measured), self.recording.time.size)
        out = []
        for name, entry in self.plant.inputs.items():
            if name in given and not isinstance(given[name], (int, float)) and name not in measured:
                raise SceneError(f"Argument `{name}` must be a number or be measured for a loop to be fitted, but it varies in time.")
            out.append(self._u_symbol[measured.index(name)] if name in measured else given.get(name, entry.default))
        return ca.vertcat(*out) if out else ca.SX(0, 1)

    def _complain_about_missing(self, contact: str, law: ca.SX) -> None:
        """Lay the measured states in place; raises SceneError where the law needs another."""
        x = np.zeros((self.plant.x.numel(), self.recording.time.size))
        there: set[int] = set()
        for name, values in self.recording.signals.items():
            mark = np.zeros(x.shape[0])
            with contextlib.suppress(SceneError):  # a signal that is computed from states
                place_start(self.plant, mark, name, 1.0)
            x[mark == 1.0] = values
            there.update(np.flatnonzero(mark))
        self._x = x
        for name, (first, size, _) in self.plant.states.items():
            for i in range(size or 1):
                if first + i not in there and ca.depends_on(law, self.plant.x[first + i]):
                    alias = [
                        word for word, (e, _) in self.plant.signals.items() if e.numel() == 1 and ca.is_equal(e, self.plant.x[first + i])
                    ]
                    label = (alias or [name if size is None else f"{name}.{i}"])[0]
                    held = ", ".join(f"`{each}`" for each in self.recording.signals)
                    raise SceneError(
                        f"The data must hold `{label}`, which the friction of `{contact}` depends on, but they hold only {held}."
                    )

    def _of(self, function: Columnwise, p: np.ndarray) -> list[list[Any]]:
        """Entries of the results of a function of the law, each a number or an array of all samples; a law with breaks is beyond those that slip exceeds."""
        count = self._side.size
        m: list[Any] = [0.0] * self.plant.m.numel()
        m[self.place] = self._side
        given = (list(self._x), list(self._u), p.tolist(), m, [self._side])
        if self._switches:
            (slip,), *_, places = self._law(*given, count=count)
            for at, place in zip(self._switches, places, strict=True):
                m[at] = 1.0 * (self._side * slip >= place)
        return function(*given, count=count)

    def _counted(self, sliding: Any, release: Any) -> np.ndarray:
        """A quantity at the samples that count: at break-away that of release."""
        found = np.broadcast_to(sliding, self._side.size)[self.rows]
        if self.released.any():
            found[self.released] = np.broadcast_to(release, self._side.size)[self.rows[self.released]]
        return found

    def allowed(self, values: np.ndarray) -> None:
        """Raise SceneError where the numbers contradict each other."""
        self._numbers(values)

    def _numbers(self, values: np.ndarray) -> np.ndarray:
        """All numbers of the plant; raises SceneError where they contradict each other. Kept for the slopes at the same place."""
        key = values.tobytes()
        if self._last[0] != key:
            self._last = (key, self.plant.with_parameters(dict(zip(self.names, map(float, values), strict=True))).values)
        return self._last[1]

    def model(self, values: np.ndarray) -> dict[str, np.ndarray]:
        """The force of the law at the measured slip, and with the static bound at break-away."""
        _, (sliding,), (release,), *_ = self._of(self._law, self._numbers(values))
        return {self.output: self._counted(sliding, release)}

    def slopes(self, values: np.ndarray, sizes: np.ndarray) -> dict[str, np.ndarray]:
        """Derivatives of `model` with respect to the free numbers, shape (nt, k), exact."""
        both = self._of(self._law_slopes, self._numbers(values))
        return {self.output: np.stack([self._counted(*each) for each in zip(*both, strict=True)], axis=1)}


def _peak(time: np.ndarray, values: np.ndarray, toward: float) -> tuple[int, float]:
    """(sample, force) at break-away in a stick phase: where the force is largest in one direction, by the line through the samples up to it.

    Slip is slow at first, so that a force that drops may end the samples at rest: the peak is where they rise no more. Release comes, on average, half a
    sample after the last one before it.
    """
    smooth = np.convolve(np.pad(values, 1, mode="edge"), np.ones(3) / 3, mode="valid")
    top = int(np.argmax(toward * smooth[:-1]))
    before = slice(max(0, top + 1 - BREAKAWAY_SAMPLES), top + 1)
    if before.stop - before.start < 3:
        return top, float(values[top])
    line = np.polynomial.polynomial.polyfit(time[before] - time[top], values[before], 1)
    return top, float(line[0] + line[1] * (time[top + 1] - time[top]) / 2)


def residuals(misfit: Any, values: np.ndarray, scales: Mapping[str, float]) -> np.ndarray:
    """Model minus measured in parts of the scales, all signals in a row; nan where the numbers cannot be simulated."""
    try:
        found = misfit.model(values)
    except (SceneError, SimulationError):
        return np.full(sum(array.size for array in misfit.measured.values()), np.nan)
    return np.concatenate([(found[name] - misfit.measured[name]) / scales[name] for name in misfit.outputs])
