"""How far a machine with given numbers is from what was measured, and how that changes with the numbers.

Three misfits, one interface (`model`, `slopes`, `measured`, `time`), and `Together` of several windows with the same:

    Simulated     the measured inputs drive a simulation; its outputs at the measured times are compared with the measured ones. Slopes are those of
                  `toolbox.sensitivity`, exact through every stick and slip.
    MeasuredLoop  the friction law of one contact is compared with measured force at measured slip, sample by sample, without simulation.
    MemoryLoop    the same of a law with memory, which is integrated along the measured slip.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.calibration.misfit import Misfit
from toolbox.calibration.panels import TIME, Panel
from toolbox.calibration.recording import Recording
from toolbox.calibration.shifts import Shift
from toolbox.calibration.trust import scatter
from toolbox.errors import GrazingError, SceneError, SimulationError
from toolbox.logs.flaws import of_levels
from toolbox.measuring.sticks import stick_intervals
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.inputs import Table
from toolbox.modelling.numbers import Number
from toolbox.orbits.sensitivity import sensitivity
from toolbox.simulation.budget import Budget
from toolbox.simulation.methods import EventExact, Explicit
from toolbox.simulation.simulate import simulate
from toolbox.simulation.trajectory import Trajectory

HORIZONS = (0.25, 0.5)
"""Parts of the data that a simulation is fitted to before all of them."""

TRIAL_RUN = 2000
"""Samples of a simulation, about, with which the searches from different starts are done where there are several times as many."""

PART, FAR = 0.2, 5.0
"""How far from the model the first samples are where it begins elsewhere: in parts of the measured range, and in deviations of the noise of the signal."""

EXPLICIT = 4
"""Times as many steps as the usual method, at most, for which explicit steps are taken for runs, too: their derivatives follow them."""

FEW_STEPS, LONGER = 1000, 100
"""Explicit steps that are few in any case, and times as many steps as the first run that a later one may take: a search can lose its way to numbers with which
a run never ends."""

MANY_STEPS = 1_000_000
"""Steps that every run may take."""

TRIAL_ACCURACY = 1e-5
"""Accuracy of their runs, at best."""


@dataclass
class Simulated(Misfit):
    """Outputs of a simulation against measured ones.

    loop: driven by the measured inputs;  numbers: of the loop, which are free.
    """

    loop: ClosedLoop
    recording: Recording
    numbers: Sequence[Number]
    accuracy: float
    shifts: tuple[Shift, ...] = ()
    by_samples = False

    def __post_init__(self) -> None:
        self.names = [number.name for number in self.numbers]
        measured = {
            name: np.isfinite(values).any() for name, values in self.recording.signals.items()
        }  # another window may have what this one lacks
        self.outputs = [name for name, there in measured.items() if there and name not in self.loop.inputs]
        self.good = {name: np.isfinite(self.recording.signals[name]) for name in self.outputs}
        time, end = self.recording.time, float(self.recording.time[-1])
        for shift in self.shifts:  # what is compared is simulated for every shift between the bounds, and driven by what was measured
            for name in self.outputs if set(shift.channels) - set(self.outputs) else shift.channels:
                self.good[name] &= (time >= max(shift.high, -shift.low, 0.0)) & (time <= end - max(shift.high, -shift.low, 0.0))
        self.time = {name: self.recording.time[good] for name, good in self.good.items()}
        self.measured = {name: self.recording.signals[name][good] for name, good in self.good.items()}
        self.exact = True
        self._last: tuple[bytes, Trajectory] | None = None
        self._explicit, self._steps = False, 0

    def horizons(self) -> list[Simulated]:
        """The misfit over the first quarter, the first half and all of the data.

        Over many cycles a small error of the period makes phases drift apart, and the misfit has an optimum for every cycle that is off; over few it has
        not, and leads to numbers from which the long one is a small step.
        """
        end = float(self.recording.time[-1])
        shorter = [
            Simulated(self.loop, self.recording.between(0.0, part * end), self.numbers, self.accuracy, self.shifts)
            for part in HORIZONS
            if part * self.recording.time.size >= 10 * len(self.names)
        ]
        return [*shorter, self]

    def thinned(self) -> Simulated | None:
        """Return the misfit with every other sample of measured inputs left out; None if no input is a line between its samples.

        An input that is held is known at all times. Of one of levels the samples around each jump stay, whose place the fit of the others tells.
        """
        given = self.loop.input_values
        held = self.recording.held or ()
        measured = [name for name in self.recording.signals if isinstance(given.get(name), Table) and name not in held]
        if not measured:
            return None
        fewer = {}
        for name in measured:
            size = given[name].times.size
            keep = np.zeros(size, bool)
            keep[::2] = keep[-1] = True
            if of_levels(given[name].values) or name in self.recording.stepped:
                kept = np.diff(given[name].values) != 0.0 if of_levels(given[name].values) else np.diff(given[name].times) == 0.0
                keep[1:] |= kept
                keep[:-1] |= kept
            fewer[name] = Table(given[name].times[keep], given[name].values[keep])
        return Simulated(self.loop.replace(inputs={**self.loop.inputs, **fewer}), self.recording, self.numbers, self.accuracy, self.shifts)

    def trial(self) -> Simulated:
        """The misfit of means over groups of samples, with runs of a coarse accuracy: enough to find what is then fitted to all."""
        groups = self.recording.time.size // TRIAL_RUN
        if groups < 2:
            return self
        coarse = self.recording.resampled(groups * self.recording.interval)
        fewer = {}
        for name, value in self.loop.input_values.items():
            if name in coarse.signals and isinstance(value, Table):
                good = np.isfinite(coarse.signals[name])
                middle = (
                    0.5 * self.recording.interval if name in (self.recording.held or ()) else 0.0
                )  # of the times for which a sample stands
                fewer[name] = Table(coarse.time[good] + middle, coarse.signals[name][good])
        accuracy = max(self.accuracy, TRIAL_ACCURACY)
        return Simulated(self.loop.replace(inputs={**self.loop.inputs, **fewer}), coarse, self.numbers, accuracy, self.shifts)

    def apart(self, values: np.ndarray) -> dict[str, float]:
        """{output: how far from the model its first samples are}, of those that begin elsewhere than the machine that is simulated."""
        found = {}
        for name, model in self.model(values).items():
            measured = self.measured[name]
            first = float(np.median(np.abs(model - measured)[:3]))  # not one sample, which may be a stray
            if first > max(PART * np.ptp(measured), FAR * scatter(measured)):
                found[name] = first
        return found

    @property
    def plant(self) -> HybridSystem:
        """The plant with its laws."""
        return self.loop.system

    def at(self, values: np.ndarray) -> ClosedLoop:
        """The loop with the free numbers at given values, driven on the clock of the machine; raises SceneError where numbers contradict each other."""
        loop, late = super().at(values), self._late(values)
        moved = {
            name: Table(loop.input_values[name].times - late[name], loop.input_values[name].values)
            for name in late
            if name not in self.outputs
        }
        return loop.replace(inputs={**loop.inputs, **moved}) if moved else loop

    def _late(self, values: np.ndarray) -> dict[str, float]:
        """{channel: by how much later it was written than it was}."""
        return {name: float(values[shift.place]) for shift in self.shifts for name in shift.channels}

    def _times(self, values: np.ndarray) -> dict[str, np.ndarray]:
        """{output: times of the machine at which its samples were taken}."""
        late, end = self._late(values), float(self.recording.time[-1])
        return {name: np.clip(self.time[name] - late.get(name, 0.0), 0.0, end) for name in self.outputs}

    def run(self, values: np.ndarray) -> Trajectory:
        """The simulation with the free numbers at given values, at all samples of outputs; raises what `simulate` raises."""
        key = values.tobytes()
        if self._last is None or self._last[0] != key:  # slopes are asked for where the model just was
            end = float(self.recording.time[-1])
            late = self._late(values)
            times = np.unique(np.concatenate([*self._times(values).values()])) if late else self.recording.time
            self._last = (key, self._simulated(self.at(values), end, times))
        return self._last[1]

    def _simulated(self, loop: ClosedLoop, end: float, times: np.ndarray) -> Trajectory:
        """The run of a loop: by explicit steps after a run whose derivatives needed few of them, which saves taking every step twice."""
        given: dict[str, Any] = {"output_times": times, "accuracy": self.accuracy}
        if not self._steps:
            run = simulate(loop, end, **given)
            self._steps = sum(run.steps)
            return run
        budget = Budget(steps=max(LONGER * self._steps, MANY_STEPS))
        if self._explicit:
            with contextlib.suppress(SimulationError):
                return simulate(loop, end, method=Explicit(budget=budget), **given)
        return simulate(loop, end, method=EventExact(budget=budget), **given)

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
        self.at(values).assembly  # noqa: B018

    def model(self, values: np.ndarray) -> dict[str, np.ndarray]:
        """Simulated outputs at the times of samples that are data; where a signal jumps within half a sampling interval of a sample, the nearer side counts.

        Else every sample that a switch passes would be a step of the misfit, and their edges would hold the search before its optimum.
        """
        run = self.run(values)
        switches = np.unique([event.time for event in run.events])
        sampled = self._times(values)
        found = {name: np.array(run[name])[np.searchsorted(run.time, sampled[name])] for name in self.outputs}
        if not switches.size:
            return found
        nodes = run.every_step
        for name, value in found.items():
            time, along, measured = sampled[name], nodes[name], self.measured[name]
            gap = np.diff(time)
            near = np.minimum(np.append(gap, gap[-1]), np.insert(gap, 0, gap[0])) / 2
            before, after = (np.searchsorted(nodes.time, switches, side=side) for side in ("left", "right"))
            jumps = along[after - 1] - along[before]
            first, last = (np.searchsorted(time, switches, side=side) for side in ("left", "right"))
            for t, jump, low, high in zip(switches.tolist(), jumps.tolist(), first.tolist(), last.tolist(), strict=True):
                for k in range(max(low - 1, 0), min(high + 1, time.size)) if jump else ():
                    if abs(time[k] - t) < near[k]:
                        other = value[k] + (-jump if time[k] >= t else jump)
                        if abs(other - measured[k]) < abs(value[k] - measured[k]):
                            value[k] = other
        return found

    def slopes(self, values: np.ndarray, sizes: np.ndarray) -> dict[str, np.ndarray]:
        """Derivatives of `model` with respect to the free numbers, shape (nt, k): exact, or central differences where a run has none."""
        driving = {shift.place for shift in self.shifts if set(shift.channels) - set(self.outputs)}
        moving = [i for i, number in enumerate(self.numbers) if not number.is_shift]
        found = {name: np.zeros((self.time[name].size, values.size)) for name in self.outputs}
        differenced = [*driving, *moving]
        if self.exact and moving:
            try:
                run = self.run(values)
                slopes = sensitivity(run, [self.names[i] for i in moving])
                self._explicit = sum(slopes.run.steps) <= EXPLICIT * sum(run.steps) + FEW_STEPS
                times = self._times(values)
                for name in self.outputs:
                    found[name][:, moving] = slopes[name][np.searchsorted(slopes.time, times[name])]
                differenced = [*driving]
            except GrazingError:
                pass
            except SceneError:  # a law in Python, or one that reads an encoder
                self.exact = False
        for i in differenced:
            step = np.zeros(values.size)
            step[i] = 1e-5 * sizes[i] if i in moving else 0.1 * self.recording.interval
            # one side is enough for a shift by a tenth of a sample, and the run of the other is there
            back, width = (self.model(values - step), 2 * step[i]) if i in moving else (self.model(values), step[i])
            last = self._last
            ahead = self.model(values + step)
            self._last = last
            for name in self.outputs:
                found[name][:, i] = (ahead[name] - back[name]) / width
        for shift in self.shifts:
            if shift.place not in driving:
                for name in shift.channels:
                    found[name][:, shift.place] = -self._rate(values, name)
        return found

    def start_slopes(self, values: np.ndarray) -> dict[str, np.ndarray]:
        """Return derivatives of `model` with respect to the start of every state, shape (nt, states); none if a run has no exact ones."""
        names = [
            name if size is None else f"{name}.{i}"
            for name, (_, size, _) in self.plant.states.items()
            for i in range(1 if size is None else size)
        ]
        if self.exact:
            try:
                slopes, times = sensitivity(self.run(values), names), self._times(values)
            except (GrazingError, SceneError):
                pass
            else:
                return {name: slopes[name][np.searchsorted(slopes.time, times[name])] for name in self.outputs}
        return {name: np.zeros((self.time[name].size, 0)) for name in self.outputs}

    def _rate(self, values: np.ndarray, name: str) -> np.ndarray:
        """Rate of an output at its samples, by differences within a tenth of the time between them."""
        nodes, times, end = self.run(values).every_step, self._times(values)[name], float(self.recording.time[-1])
        h = 0.05 * self.recording.interval
        back, ahead = np.maximum(times - h, 0.0), np.minimum(times + h, end)
        rate: np.ndarray = (nodes.at(ahead)[name] - nodes.at(back)[name]) / (ahead - back)
        return rate


def residuals(misfit: Any, values: np.ndarray, scales: Mapping[str, float]) -> np.ndarray:
    """Model minus measured in parts of the scales, all signals in a row; nan where the numbers cannot be simulated."""
    try:
        found = misfit.model(values)
    except (SceneError, SimulationError):
        return np.full(sum(array.size for array in misfit.measured.values()), np.nan)
    return np.concatenate([(found[name] - misfit.measured[name]) / scales[name] for name in misfit.outputs])
