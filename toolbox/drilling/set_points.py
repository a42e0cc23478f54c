"""How a law of a drill string is tried at a set-point: another drive has the string in stick-slip, and the law takes over at some phases of that cycle.

Two protocols:

    takeover   the set-point stays
    ramp       the set-point is raised to 12 rad/s, held for 40 s and lowered again within 60 s, as drillers do

Success: from 80 s after the last change of the set-point on the bit does not stick; over the window that follows its mean speed is within 2 % of the
set-point; the standard deviation of the torque is at most 2 % of its mean without noise, 5 % with noise, and free where the weight varies; the torque is at a
limit at most 1 % of the time. Where that has to last, smooth running moreover is stable on every machine, and a law that lifts its set-point does not lift it
again; where the weight varies it may, but not above 1.1 times what is asked for more than 2 % of the time.
"""

from __future__ import annotations

import concurrent.futures
import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from toolbox.drilling.groups import LASTING, Group, Machine
from toolbox.errors import SceneError, SimulationError
from toolbox.measuring.sticks import is_stick, releases
from toolbox.measuring.verdict import growth_in_words
from toolbox.modelling.closed_loop import ClosedLoop
from toolbox.modelling.components import Component, Equations
from toolbox.modelling.composition import compose
from toolbox.modelling.elements import Quantity, quantity
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Controller, Sampled, Takeover, designed
from toolbox.modelling.numbers import put_all
from toolbox.robustness.starts import at_set_point
from toolbox.vocabulary import Renamed

if TYPE_CHECKING:
    from toolbox.simulation.trajectory import Trajectory

LIFTED, LIFT, HELD, LOWERED = 12.0, 5.0, 40.0, 60.0
"""A raised set-point [rad/s]; seconds in which it is lifted, held and lowered."""
SETTLING = 80.0
"""Seconds after the last change of the set-point until the judged window."""
FINE = 0.01
"""Sample time [s] of the drive before, alone."""
LANES = 16
"""Runs that fill the lanes of any processor."""
SEARCHED = 12
"""Set-points at which a group is tried in a search, about."""
PROTOCOLS = ("takeover", "ramp")


@dataclass(frozen=True)
class Outcome(Renamed):
    """Result of a group of machines at a set-point.

    Attributes
    ----------
    passed
        Whether every run succeeded.
    why
        Machine, seed and phase that failed first, and why.
    runs
        How many were run.
    time_above_setpoint
        Largest share of the judged window in which the top was more than 10 % above what is asked [1].
    recovery_time
        Longest time that it was so before that window [s]; of a raised set-point that includes the raising.
    max_bit_speed, max_torque
        Highest speed of the bit [rad/s] and highest torque of the drive [N m] after the takeover.
    max_lifts, relapses_per_hour, max_weight_relief
        Most lifts of a run, most of them an hour in the judged window, and largest mean share of the weight that is taken off, for a law that does so.
    growth_rate
        Largest rate [1/s] at which a small disturbance of smooth running grows on a machine, where that was looked at.
    """

    passed: bool
    why: str = ""
    runs: int = 0
    time_above_setpoint: float = math.nan
    recovery_time: float = math.nan
    max_bit_speed: float = math.nan
    max_torque: float = math.nan
    max_lifts: float = math.nan
    relapses_per_hour: float = math.nan
    max_weight_relief: float = math.nan
    growth_rate: float = math.nan


@dataclass(frozen=True)
class Watch(Component):
    """Signals of a drive for the verdict: the square of its torque, 1 while the torque is at a limit, 1 while the top speed is 10 % too
    high, 1 while the lifted set-point is."""

    lowest: Quantity = quantity(-1e30, "N m", "lowest torque")
    highest: Quantity = quantity(1e30, "N m", "highest torque")
    reference: Quantity = quantity(8.0, "rad/s", "set-point", above=0)

    def equations(self, signal):
        torque = signal("top.torque", "N m", default=0.0)
        limited = ca.if_else(torque < self.lowest + 1.0, 1.0, ca.if_else(torque > self.highest - 1.0, 1.0, 0.0))
        above = ca.if_else(signal("top.speed", "rad/s") > 1.1 * self.reference, 1.0, 0.0)
        lifted = ca.if_else(signal("lifting.reference", "rad/s", default=self.reference) > 1.1 * self.reference, 1.0, 0.0)
        flags = {"limited": limited, "above": above, "lifted": lifted}
        return Equations(outputs={"watch.square": (torque * torque, "1"), **{f"watch.{name}": (flag, "1") for name, flag in flags.items()}})


def limits_of(law: Any) -> dict[str, float]:
    """Return the limits [N m] of the torque that a law has, or the limits of the law inside of it."""
    own = {name: getattr(law, f"{name}_torque", None) for name in ("lowest", "highest")}
    if any(own.values()):
        return {name: value for name, value in own.items() if value is not None}
    inside = [value for value in vars(law).values() if isinstance(value, Controller)] if dataclasses.is_dataclass(law) else []
    return next((found for each in inside if (found := limits_of(each))), {})


@dataclass(frozen=True)
class Cycle:
    """The stick-slip under a drive: start values at its last release before 200 s, its period, and the time of that release [s].

    sticks: whether there is any; without, the period is 8 s and the release 200 s.
    """

    start: Mapping[str, Any]
    period: float
    release: float
    sticks: bool = True


@dataclass(frozen=True)
class Trial:
    """How a law is tried: its loop, and the drive that it takes over from.

    loop: of the declared plant with one sampled law of `top.torque`; at a set-point its law has that `reference`, is designed on that plant, and acts on the
    machines of a group.  before: a law, at whose set-point likewise the string sticks and slips.  executor: does the runs; None for the cores of this machine.
    """

    loop: ClosedLoop
    before: Controller
    executor: concurrent.futures.Executor | None = field(default=None, repr=False, compare=False)

    @cached_property
    def clock(self) -> Sampled:
        """Sampled law of the loop. SceneError is raised if the loop has another kind of law, or none."""
        laws = self.loop.controllers
        if len(laws) != 1 or not isinstance(laws[0], Sampled) or "top.torque" not in self.loop.plant.inputs:
            raise SceneError(
                f"Argument `loop` must hold one sampled law that drives `top.torque` of a drill string, but it holds {len(laws)} "
                "law(s): give `closed_loop(plant, Sampled(law, '10 ms', delay='30 ms'))`."
            )
        lost = next((name for name in self.loop.parameters if name not in self.loop.without_controllers.parameters), None)
        if lost is not None:
            raise SceneError(f"Argument `{lost}` must be given to the law itself to be tried at other set-points, not in `parameters`.")
        return laws[0]

    @cached_property
    def _found(self) -> dict[Any, Any]:
        """What is known already: how runs of a kind are done, how small disturbances grow, and the law designed for a set-point."""
        return {}

    @property
    def plant(self) -> HybridSystem:
        """The declared plant."""
        return self.loop.plant

    @property
    def period(self) -> float:
        """Sample time of both laws [s]."""
        return float(self.clock.period)

    @property
    def label(self) -> str:
        """What tables call the law."""
        return self.loop.label or type(self.clock.law).__name__

    def place(self, name: str) -> str:
        """Return the name in the loop of a number of the machine. The weight becomes `weight.reference` if the law commands `bit.weight`
        itself."""
        return "weight.reference" if name == "bit.weight" and name in getattr(self.clock.law, "actuated_signals", ()) else name

    def key(self, reference: float) -> list[Any]:
        """Return texts and numbers that distinguish this trial at a set-point from others."""
        clock = replace(self.clock, law=None)  # type: ignore[arg-type]
        laws = [repr(self.of(reference)), repr(at_set_point(self.before, reference))]
        bare = _bare(self.loop)
        return [self.label, repr(self.plant.parts), repr((dict(bare.inputs), dict(bare.parameters))), repr(clock), *laws]

    def of(self, reference: float) -> Any:
        """The law for a set-point [rad/s]."""
        return at_set_point(self.clock.law, reference)

    def inputs(self, reference: Any) -> dict[str, Any]:
        """The inputs of a loop with the law, under a set-point [rad/s]."""
        return {self.place(name): value for name, value in _bare(self.loop).inputs.items()} | {"top.reference": reference}

    def cycle(self, reference: float) -> Cycle:
        """The stick-slip under the drive before at a set-point."""
        return _cycle(_bare(self.loop), at_set_point(self.before, reference), reference)

    def in_python(self, reference: float) -> bool:
        """Whether the law is designed as a callable: its memory cannot be told, and its runs begin at rest under the drive before."""
        return not isinstance(self.design(reference), Controller)

    def design(self, reference: float) -> Any:
        """The law for a set-point, designed on the declared plant: once, because runs act with copies of it."""
        if reference not in self._found:
            self._found[reference] = designed(self.of(reference), self.plant)
        return self._found[reference]

    def on(
        self, machine: Machine, law: Any, noise: float | None = None, seed: int = 0, plant: HybridSystem | None = None, **changes: Any
    ) -> ClosedLoop:
        """The loop of a law on a machine; noise: of the top speed, None for none;  plant: in place of that of the machine;  changes: of fields of the loop."""
        late = float(self.clock.delay) + machine.delay
        noises = {name: value for name, value in self.clock.noise.items() if name != "top.speed"} | (
            {} if noise is None else {"top.speed": noise}
        )
        sampled = replace(self.clock, law=law, delay=late, noise=noises, seed=seed, measured_signals=None, actuated_signals=None)
        loop = replace(_bare(self.loop), plant=plant or machine.plant or self.plant, controllers=(sampled,), **changes)
        return self.off(loop, machine)

    def off(self, loop: ClosedLoop, machine: Machine) -> ClosedLoop:
        """A loop of the law with the numbers of a machine."""
        for name, factor in machine.parameter_factors:
            loop = loop.at(self.place(name), factor * float(loop.number(self.place(name)).value))
        return loop

    def takes_over(self, machine: Machine, group: Group, reference: float, way: str, seed: int, at: float) -> tuple[ClosedLoop, float]:
        """(loop, last change of its set-point [s]) in which the law takes over at a time [s], on the declared numbers of a machine."""
        cycle, asleep = self.cycle(reference), self.in_python(reference)
        given, last = set_point(reference, way, (cycle.release if asleep else 0.0) + 2.0 * cycle.period + 1.0)
        before, plant = at_set_point(self.before, reference), machine.plant or self.plant
        law = self.design(reference) if asleep or machine.plant is not None else self.of(reference)  # designed on the declared plant
        inputs = self.inputs(given)
        if machine.weight_variation is not None:
            inputs[self.place("bit.weight")] = machine.weight_variation.input(_bare(self.loop).number("bit.weight").value, seed)
        watched = _watched(plant, Watch(reference=reference, **(limits_of(law) or limits_of(before)), name="watch"))
        both = Takeover(before, law, at=at, name="takeover")
        alike = replace(machine, parameter_factors=())
        if asleep:
            return self.on(alike, both, group.noise or None, seed, watched, inputs=inputs), last
        inputs["top.reference"] = (
            given if way == "ramp" else ((0.0,), (given,))
        )  # so that runs of both ways, with and without noise, are one program
        return self.on(alike, both, group.noise, seed, watched, inputs=inputs, start=cycle.start), last

    def takeover(self, reference: float, phase: float = 0.0) -> float:
        """When the law takes over [s], at a phase of the cycle and at a sample of its own."""
        cycle = self.cycle(reference)
        first = cycle.release if self.in_python(reference) else 0.0
        return math.ceil(round((first + cycle.period * (1.0 + phase)) / self.period, 6)) * self.period

    def run(
        self, machine: Machine, reference: float, noise: float = 0.01, seed: int = 0, phase: float = 0.0, duration: float = 180.0
    ) -> Trajectory:
        """Simulate a takeover of the law at a set-point. The duration [s] counts from the first release after which a law may take over.

        Raises SimulationError where it cannot be finished.
        """
        from toolbox.simulation.simulate import simulate

        loop, _ = self.takes_over(machine, Group("", (machine,), noise=noise), reference, "takeover", seed, self.takeover(reference, phase))
        return simulate(self.off(loop, machine), duration + (self.cycle(reference).release if self.in_python(reference) else 0.0))

    def outcome(self, group: Group, reference: float, way: str = "takeover") -> Outcome:
        """Return the outcome of the law on a group of machines. The search stops at the first sweep with a failure."""
        growth = math.nan
        if group.judged_time >= LASTING:
            growth, where = self.growth(group.machines, reference)
            if growth > 0.0:
                return Outcome(False, f"{where}: smooth running is not stable, a disturbance {growth_in_words(growth)}", growth_rate=growth)
        runs = 0
        most = dict.fromkeys(
            ("time_above_setpoint", "recovery_time", "max_bit_speed", "max_torque", "max_lifts", "relapses_per_hour", "max_weight_relief"),
            0.0,
        )
        for failed, numbers in self.attempts(group, reference, way):
            runs += len(numbers["stuck"])
            if failed:
                return Outcome(False, failed[0], runs)
            most = {name: max(most[name], float(np.max(numbers[name]))) if name in numbers else math.nan for name in most}
        return Outcome(True, "", runs, growth_rate=growth, **most)

    def attempts(self, group: Group, reference: float, way: str = "takeover") -> Iterator[tuple[list[str], dict[str, np.ndarray]]]:
        """Yield (failed runs with reasons, metrics of each run) of each batch of runs.

        As many seeds as fill the lanes come before all others, because most failures show with them.
        """
        cycle, asleep = self.cycle(reference), self.in_python(reference)
        times = [self.takeover(reference, phase) for phase in group.takeover_phases]
        begun = (cycle.release if asleep else 0.0) + 2.0 * cycle.period + 1.0
        alike = _alike(group.machines, asleep)
        few = 1 if asleep else -(-LANES // (max(map(len, alike)) * len(times)))
        for seeds in [(seed,) for seed in group.seeds] if asleep else filter(None, (group.seeds[:few], group.seeds[few:])):
            for machines in alike:
                loop, last = self.takes_over(machines[0], group, reference, way, seeds[0], times[0])
                after, end = last + SETTLING, last + SETTLING + group.judged_time
                asked = _measures(loop, begun, after)
                numbers = self._numbers(loop, machines)
                names = [
                    f"{each.name}, seed {seed}, phase {phase:g}" for seed in seeds for each in machines for phase in group.takeover_phases
                ]
                found: Iterable[Any]
                if asleep:  # a law in Python: up to the first run that fails
                    given = (
                        (self.takes_over(machines[0], group, reference, way, seeds[0], at)[0], each, end, asked)
                        for each in numbers
                        for at in times
                    )
                    found = ({name: np.array([value]) for name, value in row.items()} for row in self._in_turn(given))
                else:
                    rows = [{"takeover.at": at, **each} for each in numbers for at in times]
                    found = [self._together(loop, rows, machines, seeds, group, duration=end, metrics=asked)]
                for several in found:
                    measured = {name: np.asarray(several[name]) for name in asked}
                    count = len(measured["stuck"])
                    measured |= _again(measured, group.judged_time)
                    varying = machines[0].weight_variation is not None
                    failed = _failed(names[:count], measured, reference, group.noise, varying, group.judged_time >= LASTING)
                    names = names[count:]
                    measured["recovery_time"] = measured["recovery_time"] * (after - begun)
                    yield failed, measured

    def _in_turn(self, given: Iterable[tuple[Any, ...]]) -> Iterator[dict[str, float]]:
        """What is measured of each run of a law in Python, in their order: one after the other, or side by side where there is an executor."""
        if self.executor is None:
            yield from (_measured(*each) for each in given)
            return
        from toolbox.sweeps.executors import travelling

        each = list(given)
        with travelling(each[:1]):
            yield from self.executor.map(_measured, *zip(*each, strict=True))

    def _numbers(self, loop: ClosedLoop, machines: Sequence[Machine]) -> list[dict[str, float]]:
        """The numbers of machines that are alike, all under the same names; the weight is among them unless it varies."""
        factors = [{self.place(name): factor for name, factor in each.parameter_factors} for each in machines]
        given = {name for each in factors for name in each} | (
            {self.place("bit.weight")} if machines[0].weight_variation is None else set()
        )
        declared = {name: float(loop.number(name).value) for name in sorted(given)}
        return [declared | {name: factor * declared[name] for name, factor in each.items()} for each in factors]

    def _together(
        self, loop: ClosedLoop, rows: list[dict[str, float]], machines: Sequence[Machine], seeds: Sequence[int], group: Group, **asked: Any
    ) -> dict[str, np.ndarray]:
        """What is measured of machines that are alike, under every seed: rows of what varies under one; asked: `duration` and `measures` of `Courses`."""
        from toolbox.sweeps.courses import Courses

        mean, (place, kind) = _bare(self.loop).number("bit.weight").value, (self.place("bit.weight"), machines[0].weight_variation)
        weights = [
            each.weight_variation.input(mean, seed)
            for seed in seeds
            for each in machines
            if each.weight_variation
            for _ in group.takeover_phases
        ]
        courses = Courses(loop, rows, seeds, inputs={place: weights} if weights else {}, **asked)
        alike = (machines[0].plant, tuple(type(value) for value in loop.inputs.values()), kind and kind.noise)
        if alike not in self._found:
            self._found[alike] = courses.manner()
        return courses.measured(self._found[alike], SEARCHED * group.runs, round(courses.duration / self.period), self.executor)

    def steady(self, machine: Machine, reference: float) -> ClosedLoop:
        """The loop of the law alone on a machine at a set-point, without noise and with a constant weight."""
        law = self.of(reference) if machine.plant is None else self.design(reference)
        return self.on(machine, law, inputs=self.inputs(reference))

    def growth(self, machines: Sequence[Machine], reference: float) -> tuple[float, str]:
        """Return the largest rate [1/s] at which a small disturbance of smooth running grows at a set-point, and the machine with this
        rate; nan if no rate is known."""
        from toolbox.onsets.coming_to import Settled

        key = (tuple(machines), reference)
        if key not in self._found:
            found = [(Settled.of(self.steady(each, reference), "bit", "bit.speed", 0.0), each.name) for each in machines]
            rates = [(settled.rate, name) for settled, name in found if settled is not None]
            self._found[key] = max((each for each in rates if not math.isnan(each[0])), default=(math.nan, ""))
        return self._found[key]

    def disk_margins(self, machines: Sequence[Machine], reference: float) -> tuple[float, float, str]:
        """Return the disk margin of the declared machine at a set-point [rad/s], the smallest disk margin of the other machines, and its
        machine. nan if the law has no slope."""
        from toolbox.robustness.margins import disk_margin

        found = []
        for machine in (Machine(""), *machines):
            found.append((disk_margin(self.steady(machine, reference)), machine.name))
            if np.isnan(found[0][0]):
                return math.nan, math.nan, ""
        return found[0][0], *min(found[1:], default=found[0])


def _measured(loop: ClosedLoop, numbers: Mapping[str, float], end: float, display_units: Mapping[str, Any]) -> dict[str, float]:
    """What is measured of one run of a machine; nan where it cannot be finished."""
    from toolbox.simulation.simulate import simulate

    try:
        run = simulate(put_all(loop, numbers), end)
    except SimulationError:
        return dict.fromkeys(display_units, math.nan)
    return {name: each.read(run) for name, each in display_units.items()}


def _measures(loop: ClosedLoop, begun: float, after: float) -> dict[str, Any]:
    """{name: measure} of what a run is judged by: from the takeover at `begun` on, or from `after` on."""
    from toolbox.measuring import metrics

    # a controller that holds `Lifting` has its word before these signals
    lifts, relief = (
        next((each for each in loop.system.signals if f".{each}".endswith(f".lifting.{word}")), "") for word in ("lifts", "relief")
    )
    lifting = {
        "max_lifts": (lifts, metrics.maximum(lifts, begun)),
        "before": (lifts, metrics.minimum(lifts, after)),
        "lifted": (lifts, metrics.mean("watch.lifted", after)),
        "max_weight_relief": (relief, metrics.mean(relief, begun)),
    }
    last = {"speed": "bit.speed", "torque": "top.torque", "square": "watch.square", "limited": "watch.limited"}
    return {
        "stuck": metrics.time_in("bit", after),
        "time_above_setpoint": metrics.mean("watch.above", after),
        "recovery_time": metrics.mean("watch.above", begun, after),
        "max_bit_speed": metrics.maximum("bit.speed", begun),
        "max_torque": metrics.maximum("top.torque", begun),
        **{name: metrics.mean(of, after) for name, of in last.items()},
        **{name: each for name, (of, each) in lifting.items() if of},
    }


def _again(measured: Mapping[str, np.ndarray], judged: float) -> dict[str, np.ndarray]:
    """Lifts an hour in the judged window of so many seconds, of a law that lifts."""
    return {"relapses_per_hour": (measured["max_lifts"] - measured["before"]) * 3600.0 / judged} if "max_lifts" in measured else {}


def _failed(
    names: Sequence[str], measured: Mapping[str, np.ndarray], reference: float, noise: float, varying: bool, lasting: bool
) -> list[str]:
    """Which runs failed, and why."""
    failed = []
    for i, name in enumerate(names):
        row = {word: float(values[i]) for word, values in measured.items()}
        why = verdict(row, reference, noise, varying, lasting) if np.isfinite(list(row.values())).all() else "the run failed"
        failed += [f"{name}: {why}"] if why else []
    return failed


def verdict(numbers: Mapping[str, float], reference: float, noise: float, varying: bool = False, lasting: bool = False) -> str:
    """Return the reason of a failed run, from the seconds stuck and the means of the watched signals; empty for a success."""
    if is_stick(numbers["stuck"]):
        return f"stuck {numbers['stuck']:.3g} s"
    off = numbers["speed"] / reference - 1.0
    if not abs(off) <= 0.02:
        return f"speed {100 * off:+.1f} %"
    ripple = math.sqrt(max(numbers["square"] - numbers["torque"] ** 2, 0.0)) / numbers["torque"]
    if not varying and not ripple <= (0.05 if noise else 0.02):
        return f"torque ripple {100 * ripple:.1f} %"
    if varying and numbers.get("lifted", 0.0) > 0.02:
        return f"lifted {100 * numbers['lifted']:.1f} % of the time"
    if lasting and not varying and numbers.get("relapses_per_hour", 0.0) > 0.0:
        return "lifted again"
    return f"at a limit {100 * numbers['limited']:.1f} % of the time" if numbers["limited"] > 0.01 else ""


def set_point(reference: float, way: str, begin: float) -> tuple[Any, float]:
    """Return the set-point [rad/s] over time as an input, and the time [s] of its last change. Every law has taken over by `begin` [s]."""
    if way == "takeover":
        return reference, begin
    top = max(LIFTED, reference)
    times = np.cumsum([0.0, begin, LIFT, HELD, LOWERED])
    return (tuple(times.tolist()), (reference, reference, top, top, reference)), float(times[-1])


def _alike(machines: Sequence[Machine], apart: bool) -> list[list[Machine]]:
    """Machines that differ by numbers only, together; apart: those with other courses of the weight not."""
    found: dict[Any, list[Machine]] = {}
    for each in machines:
        weight = each.weight_variation if apart or each.weight_variation is None else each.weight_variation.noise
        found.setdefault((each.delay, each.plant, weight), []).append(each)
    return list(found.values())


@cache
def _watched(plant: HybridSystem, watch: Watch) -> HybridSystem:
    return compose(*plant.parts, watch)


@cache
def _bare(loop: ClosedLoop) -> ClosedLoop:
    """The loop without its law, set-point, start and label: laws that take over from the same drive find its cycle once."""
    return replace(loop.without_controllers, start={}, label="")


@cache
def _cycle(bare: ClosedLoop, before: Controller, reference: float) -> Cycle:
    from toolbox.simulation.simulate import simulate

    loop = replace(bare, controllers=(Sampled(before, FINE),), inputs=dict(bare.inputs) | {"top.reference": reference})
    run = simulate(loop, 200.0)
    released = releases(run, "bit", 100.0)
    sticks = len(released) > 1
    release = released[-1] if sticks else 200.0
    point = run.at(release)
    memory = [name for update in loop.system.updates for name in update.places]
    start = {name: point[name] for name in bare.plant.states} | {
        f"takeover.before.{name.partition('.')[2]}": point[name] for name in memory
    }
    return Cycle(start, float(released[-1] - released[-2]) if sticks else 8.0, float(release), sticks)
