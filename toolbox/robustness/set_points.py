"""The lowest set-point that a law of a drill string holds: on the declared machine, on others, under a weight that varies, for half an hour.

Another drive has the string in stick-slip at the set-point; the law takes over at some phases of that cycle. Two ways of starting:

    direct   the set-point stays
    raised   the set-point is lifted to 12 rad/s, held for 40 s and lowered again within 60 s, as drillers do

Success: from 80 s after the last change of the set-point on the bit does not stick; over the window that follows its mean speed is within 2 % of the
set-point; the standard deviation of the torque is at most 2 % of its mean without noise, 5 % with noise, and free where the weight varies; the torque is at a
limit at most 1 % of the time. A group stops at the first failure. The lowest set-point is found by bisection on a grid, and confirmed at three set-points
above it and by runs of half an hour at it.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from toolbox.errors import SceneError, SimulationError
from toolbox.modelling import inputs as shapes
from toolbox.modelling.closed_loop import ClosedLoop, closed_loop
from toolbox.modelling.components import Component, Equations
from toolbox.modelling.composition import compose
from toolbox.modelling.elements import Quantity, quantity
from toolbox.modelling.hybrid_system import HybridSystem
from toolbox.modelling.laws import Controller, Sampled, Takeover, designed

if TYPE_CHECKING:
    from toolbox.simulation.trajectory import Trajectory

LIFTED, LIFT, HELD, LOWERED = 12.0, 5.0, 40.0, 60.0
"""A raised set-point [rad/s]; seconds in which it is lifted, held and lowered."""
SETTLING = 80.0
"""Seconds after the last change of the set-point until the judged window."""
LASTING, FEW, SEEN = 1800.0, 2, 3
"""Judged window [s] of the runs that confirm a set-point, and the most phases and seeds of them."""
WAYS = ("direct", "raised")


@dataclass(frozen=True)
class Varying:
    """A weight that varies about its mean: a sine of that size (in parts of the mean) and frequency [Hz], or noise of that standard deviation below it."""

    size: float
    frequency: float
    noise: bool = False

    def input(self, mean: float, seed: int) -> Any:
        """The weight over time."""
        varied = (mean, self.size * mean, self.frequency)
        return shapes.noise(*varied, seed=seed) if self.noise else shapes.sine(*varied)


@dataclass(frozen=True)
class Machine:
    """A machine beside the declared one.

    factors: ((number of the loop, factor of its declared value), ...).  late: by how much commands come later than declared [s].
    plant: another plant, with the same names, in place of the declared one.  weight: how the weight varies.
    """

    name: str
    factors: tuple[tuple[str, float], ...] = ()
    late: float = 0.0
    plant: HybridSystem | None = field(default=None, repr=False)
    weight: Varying | None = None


@dataclass(frozen=True)
class Group:
    """Machines that a law must do well on, with seeds of the noise and phases of the cycle (in parts of its period) at which it takes over.

    noise: standard deviation of the measured top speed [rad/s], 0 for none.  judged: length of the judged window [s].
    """

    name: str
    machines: tuple[Machine, ...]
    seeds: tuple[int, ...] = (0,)
    noise: float = 0.01
    phases: tuple[float, ...] = tuple(k / 8 for k in range(8))
    judged: float = 80.0

    @property
    def runs(self) -> int:
        """Number of runs at one set-point."""
        return len(self.machines) * len(self.seeds) * len(self.phases)

    @property
    def lasting(self) -> Group:
        """The same machines with few phases and seeds for half an hour."""
        chosen = self.phases[:: max(1, len(self.phases) // FEW)][:FEW]
        return replace(self, seeds=self.seeds[:SEEN], phases=chosen, judged=LASTING)


@dataclass(frozen=True)
class Outcome:
    """What came of a group at a set-point.

    passed: whether every run succeeded;  why: machine, seed and phase that failed first, and why;  runs: how many were run;  above: largest share of the time
    after the takeover at which the top was more than 10 % above what is asked;  fastest: highest bit speed [rad/s] after the takeover.
    """

    passed: bool
    why: str = ""
    runs: int = 0
    above: float = math.nan
    fastest: float = math.nan


@dataclass(frozen=True)
class Watch(Component):
    """What is read of a drive beside means: the square of its torque, 1 where that is at a limit, and 1 where the top is 10 % above the set-point."""

    lowest: Quantity = quantity(-1e30, "N m", "lowest torque")
    highest: Quantity = quantity(1e30, "N m", "highest torque")
    reference: Quantity = quantity(8.0, "rad/s", "set-point", above=0)

    def equations(self, signal):
        torque = signal("top.torque", "N m", default=0.0)
        limited = ca.if_else(torque < self.lowest + 1.0, 1.0, ca.if_else(torque > self.highest - 1.0, 1.0, 0.0))
        above = ca.if_else(signal("top.speed", "rad/s") > 1.1 * self.reference, 1.0, 0.0)
        return Equations(gives={"watch.square": (torque * torque, "1"), "watch.limited": (limited, "1"), "watch.above": (above, "1")})


def at_set_point(law: Any, reference: float) -> Any:
    """A law, and the laws inside of it, with that set-point [rad/s]; what is no dataclass is returned as it is."""
    if not dataclasses.is_dataclass(law):
        return law
    changed = {each.name: at_set_point(getattr(law, each.name), reference) for each in dataclasses.fields(law) if each.init}
    changed = {name: value for name, value in changed.items() if isinstance(value, Controller) and value is not getattr(law, name)}
    if isinstance(law, Controller) and hasattr(law, "reference"):
        changed["reference"] = reference
    return replace(law, **changed) if changed else law


def limits_of(law: Any) -> dict[str, float]:
    """The limits [N m] of the torque that a law knows, its own or those of the law inside of it."""
    own = {name: getattr(law, f"{name}_torque", None) for name in ("lowest", "highest")}
    if any(own.values()):
        return {name: value for name, value in own.items() if value is not None}
    inside = [value for value in vars(law).values() if isinstance(value, Controller)] if dataclasses.is_dataclass(law) else []
    return next((found for each in inside if (found := limits_of(each))), {})


@dataclass(frozen=True)
class Cycle:
    """The stick-slip under a drive: start values at its last release before 200 s, its period, and the time of that release [s]; without one, 8 s and 200 s."""

    start: Mapping[str, Any]
    period: float
    release: float


@dataclass(frozen=True)
class Trial:
    """How a law is tried: the plant it was designed on, what makes it for a set-point [rad/s], its clock, and the drive that it takes over from.

    of: returns a Controller; it is designed on `plant`, and acts on the machines of a group.  period: sample time of both laws [s].
    late: declared delay of commands [s].  before: returns the drive that has the string in stick-slip at a set-point.
    """

    label: str
    plant: HybridSystem
    of: Callable[[float], Any]
    before: Callable[[float], Controller]
    period: float = 0.01
    late: float = 0.0

    def cycle(self, reference: float) -> Cycle:
        """The stick-slip under the drive before at a set-point."""
        return _cycle(self.plant, self.before(reference))

    def in_python(self, reference: float) -> bool:
        """Whether the law is designed as a callable: its memory cannot be told, and its runs begin at rest under the drive before."""
        return not isinstance(designed(self.of(reference), self.plant), Controller)

    def loop(self, machine: Machine, group: Group, reference: float, way: str, seed: int, at: float) -> tuple[ClosedLoop, float]:
        """(loop, last change of its set-point [s]) in which the law takes over at a time [s] on a machine with its own plant, delay and weight."""
        cycle, asleep = self.cycle(reference), self.in_python(reference)
        given, last = set_point(reference, way, (cycle.release if asleep else 0.0) + 2.0 * cycle.period + 1.0)
        law, before = self.of(reference), self.before(reference)
        if machine.plant is not None:  # the law is designed on the declared plant
            law = designed(law, self.plant)
        both = Takeover(before, law, at=at, name="takeover")
        sampled = Sampled(both, self.period, self.late + machine.late, {"top.speed": group.noise} if group.noise else {}, seed=seed)
        inputs = {"top.reference": given}
        if machine.weight is not None:
            inputs["bit.weight"] = machine.weight.input(_weight(machine.plant or self.plant), seed)
        watched = _watched(machine.plant or self.plant, Watch(reference=reference, **(limits_of(law) or limits_of(before)), name="watch"))
        return closed_loop(watched, sampled, inputs=inputs, start={} if asleep else cycle.start), last

    def takeover(self, reference: float, phase: float = 0.0) -> float:
        """When the law takes over [s], at a phase of the cycle and at a sample of its own."""
        cycle = self.cycle(reference)
        first = cycle.release if self.in_python(reference) else 0.0
        return math.ceil(round((first + cycle.period * (1.0 + phase)) / self.period, 6)) * self.period

    def run(
        self, machine: Machine, reference: float, noise: float = 0.01, seed: int = 0, phase: float = 0.0, duration: float = 180.0
    ) -> Trajectory:
        """One run of the law that takes over at a set-point, so long [s] from the first release that a law may take over at on.

        Raises SimulationError where it cannot be finished.
        """
        from toolbox.simulation.simulate import simulate

        loop, _ = self.loop(machine, Group("", (machine,), noise=noise), reference, "direct", seed, self.takeover(reference, phase))
        for name, factor in machine.factors:
            loop = loop.at(name, factor * float(loop.number(name).value))
        return simulate(loop, duration + (self.cycle(reference).release if self.in_python(reference) else 0.0))

    def outcome(self, group: Group, reference: float, way: str = "direct") -> Outcome:
        """What comes of the law on a group of machines; stops at the first sweep that holds a failure."""
        runs, above, fastest = 0, 0.0, 0.0
        for failed, numbers in self.attempts(group, reference, way):
            runs += len(numbers["stuck"])
            if failed:
                return Outcome(False, failed[0], runs)
            above, fastest = max(above, float(np.max(numbers["above"]))), max(fastest, float(np.max(numbers["fastest"])))
        return Outcome(True, "", runs, above, fastest)

    def attempts(self, group: Group, reference: float, way: str = "direct") -> Iterator[tuple[list[str], dict[str, np.ndarray]]]:
        """(which runs failed and why, what was measured of each) of one sweep after the other."""
        from toolbox.measuring import measures
        from toolbox.sweeps.sweep import sweep

        cycle, asleep = self.cycle(reference), self.in_python(reference)
        times = [self.takeover(reference, phase) for phase in group.phases]
        begun = (cycle.release if asleep else 0.0) + 2.0 * cycle.period + 1.0
        for seed in group.seeds:
            for apart in dict.fromkeys((each.late, each.plant, each.weight) for each in group.machines):
                machines = [each for each in group.machines if (each.late, each.plant, each.weight) == apart]
                loop, last = self.loop(machines[0], group, reference, way, seed, times[0])
                after, end = last + SETTLING, last + SETTLING + group.judged
                asked = {
                    "stuck": measures.time_in("bit", after),
                    "above": measures.mean("watch.above", begun),
                    "fastest": measures.maximum("bit.speed", begun),
                }
                for name, of in {
                    "speed": "bit.speed",
                    "torque": "top.torque",
                    "square": "watch.square",
                    "limited": "watch.limited",
                }.items():
                    asked[name] = measures.mean(of, after)
                declared = {name: float(loop.number(name).value) for each in machines for name, _ in each.factors}
                numbers = [declared | {name: factor * declared[name] for name, factor in each.factors} for each in machines]
                phases = list(zip(group.phases, times, strict=True))
                names = [f"{each.name}, seed {seed}, phase {phase:g}" for each in machines for phase, _ in phases]
                found: Iterable[Any]
                if asleep:  # a law in Python: one run after the other, up to the first that fails
                    found = (
                        _measured(self.loop(machines[0], group, reference, way, seed, at)[0], each, end, asked)
                        for each in numbers
                        for _, at in phases
                    )
                    found = ({name: np.array([value]) for name, value in row.items()} for row in found)
                else:
                    found = [sweep(loop, [{"takeover.at": at, **each} for each in numbers for _, at in phases], end, measures=asked)]
                for several in found:
                    rows = {name: np.asarray(several[name]) for name in asked}
                    count = len(rows["stuck"])
                    failed = []
                    for i, name in enumerate(names[:count]):
                        row = {word: float(values[i]) for word, values in rows.items()}
                        finite = np.isfinite(list(row.values())).all()
                        why = verdict(row, reference, group.noise, varying=apart[2] is not None) if finite else "the run failed"
                        failed += [f"{name}: {why}"] if why else []
                    names = names[count:]
                    yield failed, rows

    def disk_margins(self, machines: Sequence[Machine], reference: float) -> tuple[float, float, str]:
        """The disk margin on the declared machine at a set-point [rad/s], the smallest over others, and of which; nan where the law has no slope."""
        from toolbox.robustness.margins import margins

        found = []
        for machine in (Machine(""), *machines):
            loop = closed_loop(self.plant, Sampled(self.of(reference), self.period, self.late + machine.late))
            for name, factor in machine.factors:
                loop = loop.at(name, factor * float(loop.number(name).value))
            found.append((margins(loop, measured=False).disk_margin, machine.name))
            if np.isnan(found[0][0]):
                return math.nan, math.nan, ""
        return found[0][0], *min(found[1:], default=found[0])


def _measured(loop: ClosedLoop, numbers: Mapping[str, float], end: float, asked: Mapping[str, Any]) -> dict[str, float]:
    """What is measured of one run of a machine; nan where it cannot be finished."""
    from toolbox.simulation.simulate import simulate

    for name, value in numbers.items():
        loop = loop.at(name, value)
    try:
        run = simulate(loop, end)
    except SimulationError:
        return dict.fromkeys(asked, math.nan)
    return {name: each.read(run) for name, each in asked.items()}


def verdict(numbers: Mapping[str, float], reference: float, noise: float, varying: bool = False) -> str:
    """Why a run is no success, given seconds stuck, means of speed, torque, its square and the share at a limit; empty where it is one."""
    if numbers["stuck"] > 0.0:
        return f"stuck {numbers['stuck']:.1f} s"
    off = numbers["speed"] / reference - 1.0
    if not abs(off) <= 0.02:
        return f"speed {100 * off:+.1f} %"
    ripple = math.sqrt(max(numbers["square"] - numbers["torque"] ** 2, 0.0)) / numbers["torque"]
    if not varying and not ripple <= (0.05 if noise else 0.02):
        return f"torque ripple {100 * ripple:.1f} %"
    return f"at a limit {100 * numbers['limited']:.1f} % of the time" if numbers["limited"] > 0.01 else ""


def set_point(reference: float, way: str, begin: float) -> tuple[Any, float]:
    """(input, end) of the set-point [rad/s] over time where every law has taken over by `begin` [s]; `end` [s] is its last change."""
    if way == "direct":
        return reference, begin
    top = max(LIFTED, reference)
    times = np.cumsum([0.0, begin, LIFT, HELD, LOWERED])
    return (tuple(times.tolist()), (reference, reference, top, top, reference)), float(times[-1])


@cache
def _watched(plant: HybridSystem, watch: Watch) -> HybridSystem:
    return compose(*plant.parts, watch)


@cache
def _cycle(plant: HybridSystem, before: Controller) -> Cycle:
    from toolbox.simulation.simulate import simulate

    loop = closed_loop(plant, before, sample_time=0.01)
    run = simulate(loop, 200.0)
    releases = [event.time for event in run.events if event.element == "bit" and event.before == "stick" and event.time > 100.0]
    release = releases[-1] if len(releases) > 1 else 200.0
    point = run.at(release)
    memory = [name for update in loop.system.updates for name in update.places]
    start = {name: point[name] for name in plant.states} | {f"before.{name}": point[name] for name in memory}
    return Cycle(start, float(releases[-1] - releases[-2]) if len(releases) > 1 else 8.0, float(release))


def _weight(plant: HybridSystem) -> float:
    """The declared weight on bit [N]."""
    return float(closed_loop(plant).number("bit.weight").value)


# ------------------------------------------------------------------------------------------------------------------------------------- the search
class Cells:
    """Outcomes that are known, kept in a file of JSON lines, so that a search that was stopped goes on where it was.

    path: of the file, or None for none.  A line that was not finished is left out. The numbers of the law are part of the key: another law of the same
    label is judged anew.  say: called with a line of text for each new outcome.
    """

    def __init__(self, path: Path | None = None, say: Callable[[str], None] | None = None):
        self.path, self.say = path, say
        self.known: dict[str, Outcome] = {}
        if path is not None and path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                try:
                    row = json.loads(line)
                    key = row.pop("key")
                    self.known[key] = Outcome(**row)
                except (json.JSONDecodeError, KeyError, TypeError, AttributeError):
                    continue

    def outcome(self, trial: Trial, group: Group, reference: float, way: str) -> Outcome:
        """The outcome at a set-point, known or new."""
        law, before = trial.of(reference), trial.before(reference)
        key = json.dumps(
            [
                trial.label,
                repr(getattr(law, "law", law) if not isinstance(law, Controller) else law),
                repr(before),
                repr(group),
                way,
                reference,
            ]
        )
        if key not in self.known:
            found = trial.outcome(group, reference, way)
            self.known[key] = found
            if self.path is not None:
                with self.path.open("a", encoding="utf-8") as file:
                    file.write("\n" + json.dumps({"key": key, **dataclasses.asdict(found)}))
            if self.say is not None:
                lasts = f" for {group.judged:g} s" if group.judged == LASTING else ""
                self.say(
                    f"{trial.label}, {group.name}, {way}, {reference:.1f} rad/s: "
                    + (f"holds{lasts}" if found.passed else f"fails: {found.why}")
                )
        return self.known[key]


@dataclass(frozen=True)
class Lowest:
    """The lowest set-point [rad/s] that a law holds on a group, nan where it holds none, what fails one step below, and what it costs at it.

    above: largest share of the time after the takeover with the top 10 % above what is asked;  fastest: highest bit speed [rad/s].
    """

    speed: float
    why: str
    above: float = math.nan
    fastest: float = math.nan


def lowest(
    trial: Trial,
    group: Group,
    way: str = "direct",
    cells: Cells | None = None,
    lower: float = 1.5,
    higher: float = 14.0,
    step: float = 0.1,
    lasts: bool = True,
) -> Lowest:
    """The lowest set-point by bisection between `lower` (taken to fail) and `higher`, confirmed at three above it and, with `lasts`, for half an hour.

    Where one of these fails, the search goes on above it: what is given is the lowest from which on nothing that was tried failed. All in rad/s.
    """
    cells = cells or Cells()

    def fails(k: int, chosen: Group = group) -> str:
        found = cells.outcome(trial, chosen, round(k * step, 6), way)
        return "" if found.passed else found.why

    low, high = round(lower / step), round(higher / step)
    top = high
    why = fails(high)
    if why:
        return Lowest(math.nan, why)
    below = "not tried below"
    while True:
        while high - low > 1:
            middle = (low + high) // 2
            said = fails(middle)
            low, high, below = (middle, high, said) if said else (low, middle, below)
        above = sorted({min(high + round(each / step), top) for each in (0.3, 0.8, 2.0)})
        broken = [(k, said) for k in above if (said := fails(k))]
        if not broken and lasts and (said := fails(high, group.lasting)):
            broken = [(high, f"{said} within half an hour")]
            if high == top:
                return Lowest(math.nan, broken[0][1])
            low, below, high = high, broken[0][1], high + 1
            while high < top and (said := fails(high)):
                low, below, high = high, said, high + 1
            continue
        if not broken:
            found = cells.outcome(trial, group, round(high * step, 6), way)
            return Lowest(round(high * step, 6), below, found.above, found.fastest)
        low, below = broken[-1]
        high = top


# ------------------------------------------------------------------------------------------------------------------------------- groups of machines
WEIGHTS = (
    Varying(0.02, 0.2, noise=True),
    Varying(0.05, 0.2, noise=True),
    Varying(0.05, 0.17),
    Varying(0.1, 0.1),
)
"""Weights that vary: 2 and 5 % rms below 0.2 Hz, 5 % at the frequency of a string of 2 km, a heave of 10 % every ten seconds."""


def machine_groups(
    plant: HybridSystem, noise: float = 0.01, late: float = 0.03, seeds: Sequence[int] = tuple(range(101, 121))
) -> dict[str, Group]:
    """Groups of machines for a drill string with a chain of inertias and a rock, by name.

        declared   as declared, no noise
        real       weight + 10 %, noise, all seeds
        robust     one error at a time: inertia of the drive +-10 and +-20 %, inertia below it, stiffness and weight +-20 %, commands later; 3 seeds
        corners    (drive, below, stiffness) = (.8, 1.2, .8), (1.2, .8, 1.2), (.8, .8, .8); 3 seeds
        rocks      half the decay of the friction with speed; 3 seeds; only for a rock with an exponential law
        weight     a weight that varies in time: `WEIGHTS`, 3 seeds, 2 phases, judged for 600 s

    noise: of the measured top speed [rad/s].  late: by how much commands come later than declared [s] on one of the robust machines.
    """
    names = list(closed_loop(plant).numbers())

    def entries(name: str) -> list[str]:
        return [each for each in names if each.rpartition(".")[0] == name]

    places = {"drive": entries("chain.inertia")[:1], "bit": entries("chain.inertia")[1:], "stiffness": entries("chain.stiffness")}
    places["weight"] = ["bit.weight"] if "bit.weight" in names else []
    for word, found in places.items():
        if not found:
            raise SceneError(
                f"The machines beside a declared one are those of a drill string with a chain of inertias and a rock, but its {word} is not known."
            )

    def machine(name: str, late: float = 0.0, **factors: float) -> Machine:
        return Machine(name, tuple((place, factor) for word, factor in factors.items() for place in places[word]), late)

    singles = [machine(f"drive {100 * (each - 1):+.0f} %", drive=each) for each in (0.8, 0.9, 1.1, 1.2)]
    singles += [
        machine(f"{word} {100 * (each - 1):+.0f} %", **{word: each}) for word in ("bit", "stiffness", "weight") for each in (0.8, 1.2)
    ]
    corners = [
        machine(f"drive {a:g}, bit {b:g}, stiffness {c:g}", drive=a, bit=b, stiffness=c)
        for a, b, c in ((0.8, 1.2, 0.8), (1.2, 0.8, 1.2), (0.8, 0.8, 0.8))
    ]
    groups = [
        Group("declared", (Machine("declared"),), noise=0.0),
        Group("real", (machine("weight +10 %", weight=1.1),), tuple(seeds), noise),
        Group("robust", (*singles, machine(f"commands {1e3 * late:.0f} ms later", late)), tuple(seeds[:3]), noise),
        Group("corners", tuple(corners), tuple(seeds[:3]), noise),
    ]
    if "bit.friction.decay" in names:
        groups.append(Group("rocks", (Machine("half the decay", (("bit.friction.decay", 0.5),)),), tuple(seeds[:3]), noise))
    varying = tuple(
        Machine(f"weight {'noise' if each.noise else 'sine'} {100 * each.size:g} %, {each.frequency:g} Hz", weight=each) for each in WEIGHTS
    )
    groups.append(Group("weight", varying, tuple(seeds[:3]), noise, (0.0, 0.5), 600.0))
    return {group.name: group for group in groups}
