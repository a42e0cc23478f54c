"""Masters that run an exported machine: FMPy with CVODE, one of our own, and co-simulation in FMPy; each answers with the switches that it met.

Our own master integrates by an explicit method of order 8 of scipy, and locates every event indicator that changes sign on its dense output. It looks at the
inside of every step, too, because an indicator may dip below zero and come back within one.
"""

from __future__ import annotations

import ctypes
import math
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Model, FMU2Slave
from fmpy.fmi3 import FMU3Slave
from scipy.integrate import DOP853

INSIDE = np.linspace(0.0, 1.0, 9)[1:]
"""Where our own master looks at the indicators inside a step, as shares of it."""


Switches = dict[str, list[tuple[float, str]]]
"""{element: (time [s], mode after it) of every change of its mode}; of several at one instant the last, and none where it is back in its mode."""


class Watch:
    """The modes of a unit as a master meets them; every change becomes a switch."""

    def __init__(self, description: Any):
        variables = [each for each in description.modelVariables if each.name.endswith(".mode")]
        self.elements = {each.name.removesuffix(".mode"): each.valueReference for each in variables}
        self.legends = [{int(word.split(": ")[0]): word.split(": ")[1] for word in each.description.split(", ")} for each in variables]
        self.modes: list[int] = []
        self.switches: Switches = {name: [] for name in self.elements}

    def look(self, time: float, modes: Sequence[int]) -> None:
        """Take the modes at a time."""
        for name, legend, before, after in zip(self.elements, self.legends, self.modes, modes, strict=False):
            if before != after:
                self.switches[name].append((time, legend[after]))
        self.modes = list(modes)


def switches_of(run: Any) -> Switches:
    """The switches of a run of `simulate`, as a master sees them."""
    found: Switches = {}
    first: dict[tuple[float, str], str] = {}
    for time, element, before, after in run.events:
        begin = first.setdefault((time, element), before)
        listed = found.setdefault(element, [])
        if listed and listed[-1][0] == time:
            del listed[-1]
        if begin != after:
            listed.append((time, after))
    return found


def seen_at_points(run: Any, period: float) -> Switches:
    """The switches of a run of `simulate`, as one sees them who looks at its modes once in a period."""
    found: Switches = {}
    modes: dict[str, str] = {}
    for time, element, before, after in run.events:
        point = math.ceil(time / period - 1e-9) * period
        if point > float(run.duration) * (1.0 + 1e-12):
            continue
        listed = found.setdefault(element, [])
        modes.setdefault(element, before)
        if listed and listed[-1][0] == point:
            del listed[-1]
        if after != (listed[-1][1] if listed else modes[element]):
            listed.append((point, after))
    return found


def compared(found: Switches, wanted: Switches) -> tuple[int, int, int, float]:
    """(switches found, wanted, those that are the same from the start on, the largest error of their times [s])."""
    same, error = 0, 0.0
    for element in wanted.keys() | found.keys():
        pairs = list(zip(found.get(element, []), wanted.get(element, []), strict=False))
        good = next((i for i, (mine, theirs) in enumerate(pairs) if mine[1] != theirs[1]), len(pairs))
        same += good
        error = max([error, *(abs(mine[0] - theirs[0]) for mine, theirs in pairs[:good])])
    return sum(map(len, found.values())), sum(map(len, wanted.values())), same, error


def parted(found: Switches, wanted: Switches) -> float:
    """The time until which the same happens [s]: infinite, or that of the first switch to another mode, or nearer to a neighbour than to the one wanted."""
    first = math.inf
    for element in wanted.keys() | found.keys():
        mine, theirs = found.get(element, []), wanted.get(element, [])
        for i, (one, other) in enumerate(zip(mine, theirs, strict=False)):
            stay = min((abs(theirs[k][0] - theirs[k - 1][0]) for k in (i, i + 1) if 0 < k < len(theirs)), default=math.inf)
            if one[1] != other[1] or abs(one[0] - other[0]) > 0.5 * stay:
                first = min(first, one[0], other[0])
                break
        else:
            common = min(len(mine), len(theirs))
            first = min([first, *(time for time, _ in mine[common:] + theirs[common:])])
    return first


def shift(found: Switches, wanted: Switches, end: float) -> float:
    """The root of the mean square by which switches before an end are shifted [s], 0 without any."""
    pairs = [pair for element in wanted for pair in zip(found.get(element, []), wanted[element], strict=False)]
    shifts = [one[0] - other[0] for one, other in pairs if one[0] < end and other[0] < end]
    return float(np.sqrt(np.mean(np.square(shifts)))) if shifts else 0.0


@contextmanager
def unpacked(path: Path, make: Any, description: Any, identifier: str) -> Iterator[Any]:
    """An instance of a unit, whose folder and memory are given back at the end."""
    folder = fmpy.extract(str(path))
    unit = make(guid=description.guid, unzipDirectory=folder, modelIdentifier=identifier)
    try:
        yield unit
    finally:
        unit.freeInstance()
        shutil.rmtree(folder, ignore_errors=True)


def by_cvode(path: Path, duration: float, tolerance: float, look: Callable[[float, Any], bool] | None = None) -> Switches:
    """Switches of a unit for model exchange in FMPy with CVODE; `look` is called with time and recorder at each recorded point, and may end the run."""
    description = fmpy.read_model_description(str(path))
    watch = Watch(description)
    names = [f"{name}.mode" for name in watch.elements]
    found = fmpy.simulate_fmu(
        str(path), stop_time=duration, output_interval=duration / 1000.0, fmi_type="ModelExchange", output=names, relative_tolerance=tolerance,
        record_events=True, step_finished=look,
    )  # fmt: skip
    for row in found:
        watch.look(float(row[0]), [int(mode) for mode in list(row)[1:]])
    return watch.switches


def by_own_master(path: Path, duration: float, tolerance: float) -> Switches:
    """Switches of a unit of FMI 2.0 for model exchange in a master of our own."""
    with exchanged(path, tolerance) as master:
        master.run(duration, 0.0)
    return master.watch.switches


@contextmanager
def exchanged(path: Path, tolerance: float) -> Iterator[Master]:
    """A unit of FMI 2.0 for model exchange in our own master, initialised, in the event mode with which it begins."""
    description = fmpy.read_model_description(str(path))
    with unpacked(path, FMU2Model, description, description.modelExchange.modelIdentifier) as unit:
        unit.instantiate()
        unit.setupExperiment(startTime=0.0)
        unit.enterInitializationMode()
        unit.exitInitializationMode()
        yield Master(unit, description, tolerance)


class Steps(DOP853):
    """Steps of order 8 whose error is estimated by the formula of order 5 alone.

    The estimate of DOP853 mixes in that of order 3, and behind an event, where steps grow fast, it accepts some whose error is far above the tolerance: with it
    the errors of a block on a belt are 1e-7, 1e-6 and 5e-7 s at 1e-8, 3e-9 and 1e-9.
    """

    def _estimate_error_norm(self, stages: np.ndarray, step: float, scale: np.ndarray) -> float:
        error = stages.T @ self.E5 / scale
        return float(abs(step) * np.sqrt(np.mean(np.square(error))))


class Master:
    """Steps and events of one unit; `watch` holds its modes and switches."""

    def __init__(self, unit: Any, description: Any, tolerance: float):
        self.unit, self.watch, self.tolerance = unit, Watch(description), tolerance
        self.references = {each.name: each.valueReference for each in description.modelVariables}
        self.states, self.indicators = description.numberOfContinuousStates, description.numberOfEventIndicators
        self.x, self.slopes, self.nominal = (np.empty(self.states) for _ in range(3))
        self.z = np.empty(self.indicators)

    def state(self) -> np.ndarray:
        """The states."""
        self.unit.getContinuousStates(self._point(self.x), self.states)
        return self.x.copy()

    def read(self, name: str) -> float:
        """A variable."""
        return float(self.unit.getReal([self.references[name]])[0])

    def _point(self, array: np.ndarray) -> Any:
        return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))

    def go(self, t: float, x: np.ndarray) -> None:
        """Set time and states."""
        self.unit.setTime(t)
        self.x[:] = x
        self.unit.setContinuousStates(self._point(self.x), self.states)

    def slope(self, t: float, x: np.ndarray) -> np.ndarray:
        """Derivatives of the states; none where the unit discards these, as it does those of a step that is far too long."""
        if not np.isfinite(x).all():
            return np.full(self.states, np.nan)
        self.go(t, x)
        self.unit.getDerivatives(self._point(self.slopes), self.states)
        return self.slopes.copy()

    def indicator(self, t: float, x: np.ndarray) -> np.ndarray:
        """Event indicators."""
        self.go(t, x)
        self.unit.getEventIndicators(self._point(self.z), self.indicators)
        return self.z.copy()

    def events(self, t: float) -> float:
        """Event mode at the present point; returns the time of the next event in time, infinite without one."""
        again, left = True, 1000
        while again:
            again, ended, _, _, known, later = self.unit.newDiscreteStates()
            left -= 1
            if ended or left == 0:
                raise RuntimeError(f"Event mode at t = {t:.9g} s has no end.")
        self.unit.enterContinuousTimeMode()
        self.watch.look(t, self.unit.getInteger(list(self.watch.elements.values())))
        return float(later) if known else np.inf

    def run(self, end: float, t: float) -> None:
        """From event mode at a time to an end."""
        following = self.events(t)
        while t < end:
            t = self.smooth(t, min(end, following))
            if t < end:
                self.unit.enterEventMode()
                following = self.events(t)

    def smooth(self, t: float, end: float) -> float:
        """Integrate to an end, or to the first indicator that changes its sign; returns where."""
        x = self.state()
        self.unit.getNominalsOfContinuousStates(self._point(self.nominal), self.states)
        below = self.indicator(t, x) <= 0.0
        method = self._method(t, x, end)
        while method.status == "running":
            old, begin = method.t, method.y
            with np.errstate(all="ignore"):  # of a step that is far too long
                message = method.step()
            if method.status == "failed":
                raise RuntimeError(f"At t = {method.t:.9g} s: {message}")
            inside, low = method.dense_output(), old
            for share in INSIDE:
                high = method.t if share == 1.0 else old + share * (method.t - old)
                if self._changed(high, inside(high), below).size:
                    return self._located(old, begin, low, high, below)
                low = high
            self.go(method.t, method.y)
            self.unit.completedIntegratorStep()
            below = self.indicator(method.t, method.y) <= 0.0
        return float(method.t)

    def _method(self, t: float, x: np.ndarray, end: float, step: float | None = None) -> DOP853:
        return Steps(self.slope, t, x, end, rtol=max(self.tolerance, 1e-13), atol=self.tolerance * self.nominal, first_step=step)

    def _changed(self, t: float, x: np.ndarray, below: np.ndarray) -> np.ndarray:
        """Indicators that have another sign than before."""
        return np.flatnonzero((self.indicator(t, x) <= 0.0) != below)

    def _reached(self, t: float, x: np.ndarray, end: float) -> np.ndarray:
        """The states at an end within a step: by a step to there, which is as accurate as the whole one; what lies inside of a step is not."""
        method = self._method(t, x, end, end - t)
        while method.status == "running":
            method.step()
        return method.y

    def _located(self, t: float, x: np.ndarray, low: float, high: float, below: np.ndarray) -> float:
        """Go just behind the first change of sign in a step, between `low` and `high`, and return its time."""
        reached = self._reached(t, x, high)
        while not self._changed(high, reached, below).size:  # the inside of the step told of it too soon
            high += 0.01 * (high - t)
            reached = self._reached(t, x, high)
        low = low if low > t and not self._changed(low, self._reached(t, x, low), below).size else t
        while high - low > 4.0 * np.spacing(high):
            middle = 0.5 * (low + high)
            there = self._reached(t, x, middle) if middle > t else x
            if self._changed(middle, there, below).size:
                high, reached = middle, there
            else:
                low = middle
        self.go(high, reached)
        self.unit.completedIntegratorStep()
        return high


def by_co_simulation(path: Path, duration: float, period: float) -> Switches:
    """Switches of a unit of FMI 3.0 for co-simulation in steps of a period, of which each returns early at a switch."""
    description = fmpy.read_model_description(str(path))
    watch = Watch(description)
    references = list(watch.elements.values())
    with unpacked(path, FMU3Slave, description, description.coSimulation.modelIdentifier) as unit:
        unit.instantiate(earlyReturnAllowed=True, eventModeUsed=True)
        unit.enterInitializationMode(startTime=0.0)
        unit.exitInitializationMode()
        unit.enterStepMode()
        watch.look(0.0, unit.getInt32(references))
        t = 0.0
        for k in range(1, math.ceil(duration / period - 1e-9) + 1):
            target = min(k * period, duration)
            while t < target:
                _, _, early, last = unit.doStep(t, target - t)
                if early:
                    unit.enterEventMode()
                    unit.updateDiscreteStates()
                    unit.enterStepMode()
                watch.look(last, unit.getInt32(references))
                t = last if early else target
        unit.terminate()
    return watch.switches


def by_ecos(path: Path, duration: float, period: float) -> Switches:
    """Switches of a unit for co-simulation in ecos, as seen at communication points; raises ImportError where it or libtbb12 is not here."""
    try:
        from ecospy import EcosSimulation, EcosSimulationStructure
    except (ImportError, OSError) as error:
        raise ImportError(f"ecos is asked for, but it is not here (pip install ecospy, and Debian's libtbb12): {error}") from None
    watch = Watch(fmpy.read_model_description(str(path)))
    structure = EcosSimulationStructure()
    structure.add_model("machine", str(path))
    with EcosSimulation(structure=structure, step_size=period) as simulation:
        simulation.init()

        def modes() -> list[int]:
            return [int(simulation.get_integer(f"machine::{name}.mode")) for name in watch.elements]

        watch.look(0.0, modes())
        for k in range(1, math.floor(duration / period + 1e-9) + 1):
            simulation.step()
            watch.look(k * period, modes())
        simulation.terminate()
    return watch.switches


def by_libcosim(path: Path, duration: float, period: float) -> Switches:
    """Switches of a unit for co-simulation in libcosim, as seen at communication points; raises ImportError where it is not installed."""
    try:
        from libcosimpy.CosimExecution import CosimExecution
        from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
        from libcosimpy.CosimObserver import CosimObserver
        from libcosimpy.CosimSlave import CosimLocalSlave
    except (ImportError, OSError) as error:
        raise ImportError(f"libcosim is asked for, but it is not here (pip install libcosimpy): {error}") from None
    log_output_level(CosimLogLevel.WARNING)
    description = fmpy.read_model_description(str(path))
    watch = Watch(description)
    references = list(watch.elements.values())
    with unpacked(path, FMU2Slave, description, description.coSimulation.modelIdentifier) as unit:
        # an observer has seen nothing before the first step
        unit.instantiate()
        unit.setupExperiment(startTime=0.0)
        unit.enterInitializationMode()
        unit.exitInitializationMode()
        watch.look(0.0, unit.getInteger(references))
    execution = CosimExecution.from_step_size(round(1e9 * period))
    machine = execution.add_local_slave(CosimLocalSlave(fmu_path=str(path), instance_name="machine"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    for k in range(1, math.floor(duration / period + 1e-9) + 1):
        execution.step()
        watch.look(k * period, observer.last_integer_values(machine, references))
    return watch.switches
