"""The protocol by which laws of a drill string are judged: rigs, noise, ways of starting, what success is, and the search for the lowest set-point.

Plant: the two inertias of Jansen and van den Steen with the bit of Navarro-Lopez and Cortes at 97 347 N. A law is designed on it for a set-point, measures
the top speed alone, commands 0 to 20 kN m and knows that its commands come 30 ms late. A stiff PI drive has the rig in stick-slip at the same set-point; the
law takes over at one of 8 phases of that cycle. Two ways of starting:

    direct   the set-point stays
    raised   the set-point is lifted to 12 rad/s, held for 40 s and lowered again within 60 s, as drillers do

Groups of rigs, each run with 8 phases:

    declared   the rig that the law was designed for, no noise
    real       weight + 10 %, noise of 0.01 rad/s on the measured speed, 20 seeds
    robust     one error at a time: inertia of the drive +-10 and +-20 %, inertia of the bit, stiffness and weight +-20 %, commands 60 ms late; noise, 3 seeds
    corners    (drive, bit, stiffness) = (.8, 1.2, .8), (1.2, .8, 1.2), (.8, .8, .8); noise, 3 seeds
    rocks      two other laws of friction with the same static torque: Gaussian (with the same excess over all speeds), and half the decay; noise, 3 seeds

Success: from 80 s after the last set-point change the bit does not stick; over the 80 s that follow its mean speed is within 2 % of the set-point, and the
standard deviation of the torque is at most 2 % of its mean without noise, and 5 % with noise, while the torque is at a limit at most 1 % of the time. A group
stops at the first failure. The lowest set-point is found by bisection on a grid of 0.1 rad/s and confirmed at three set-points above it.

Why here and not in `toolbox`: the protocol names a well, rocks and the drive that is replaced, which `toolbox` does not know.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from controllers import StiffPI
from models import BitRock, Exponential, GaussianStribeck, wells
from toolbox import Component, Controller, Equations, HybridSystem, Sampled, SimulationError, closed_loop, compose, margins, simulate, sweep
from toolbox.measuring import measures
from toolbox.modelling import Takeover

WEIGHT = 97_347.0
ROCK = BitRock(weight=WEIGHT)
PLANT = compose(wells.JANSEN_2, ROCK)
LIMITS = {"lowest_torque": 0.0, "highest_torque": 20_000.0}
NOISE, DELAY = 0.01, 0.03
LIFTED, LIFT, HELD, LOWERED = 12.0, 5.0, 40.0, 60.0
"""A raised set-point [rad/s]; seconds in which it is lifted, held and lowered."""
SETTLING, JUDGED = 80.0, 80.0
"""Seconds after the last change of the set-point until the judged window, and its length."""
LOWEST, HIGHEST, STEP = 1.5, 14.0, 0.1
"""Set-points [rad/s] that are searched."""
WAYS = ("direct", "raised")


@dataclass(frozen=True)
class Rig:
    """A machine beside the declared one: inertias, stiffness and weight in parts of the declared ones, delay of commands [s], and another rock."""

    name: str
    drive: float = 1.0
    bit: float = 1.0
    stiffness: float = 1.0
    weight: float = 1.0
    delay: float = DELAY
    rock: str = "exponential"

    @property
    def numbers(self) -> dict[str, float]:
        """Its parameters and inputs by name."""
        chain = wells.JANSEN_2
        return {
            "chain.inertia.0": self.drive * chain.inertia[0], "chain.inertia.1": self.bit * chain.inertia[1],
            "chain.stiffness.0": self.stiffness * chain.stiffness[0], "bit.weight": self.weight * WEIGHT,
        }  # fmt: skip

    @property
    def parameters(self) -> dict[str, tuple[float, ...]]:
        """Its parameters as `simulate` and `margins` take them; the weight is an input."""
        numbers = self.numbers
        return {
            "chain.inertia": (numbers["chain.inertia.0"], numbers["chain.inertia.1"]),
            "chain.stiffness": (numbers["chain.stiffness.0"],),
        }


@dataclass(frozen=True)
class Group:
    """Rigs that a law must do well on, with seeds of the noise and phases of the cycle (in parts of its period) at which it takes over.

    noise: standard deviation of the measured top speed [rad/s], 0 for none.
    """

    name: str
    rigs: tuple[Rig, ...]
    seeds: tuple[int, ...] = (0,)
    noise: float = NOISE
    phases: tuple[float, ...] = tuple(k / 8 for k in range(8))

    @property
    def runs(self) -> int:
        """Number of runs at one set-point."""
        return len(self.rigs) * len(self.seeds) * len(self.phases)


SINGLES = (
    *(Rig(f"drive {100 * (each - 1):+.0f} %", drive=each) for each in (0.8, 0.9, 1.1, 1.2)),
    *(Rig(f"{name} {100 * (each - 1):+.0f} %", **{name: each}) for name in ("bit", "stiffness", "weight") for each in (0.8, 1.2)),
    Rig("commands 60 ms late", delay=0.06),
)
CORNERS = tuple(
    Rig(f"drive {a:g}, bit {b:g}, stiffness {c:g}", drive=a, bit=b, stiffness=c)
    for a, b, c in ((0.8, 1.2, 0.8), (1.2, 0.8, 1.2), (0.8, 0.8, 0.8))
)
ROCKS: dict[str, BitRock] = {
    "exponential": ROCK,
    "Gaussian": BitRock(weight=WEIGHT, friction=GaussianStribeck(static=0.8, kinetic=0.5, speed=1.2538)),
    "half the decay": BitRock(weight=WEIGHT, friction=Exponential(decay=0.45)),
}
SEEDS = tuple(range(101, 121))
GROUPS = {
    group.name: group
    for group in (
        Group("declared", (Rig("declared"),), noise=0.0),
        Group("real", (Rig("weight +10 %", weight=1.1),), SEEDS),
        Group("robust", SINGLES, SEEDS[:3]),
        Group("corners", CORNERS, SEEDS[:3]),
        Group("rocks", tuple(Rig(name, rock=name) for name in ROCKS if name != "exponential"), SEEDS[:3]),
    )
}


@dataclass(frozen=True)
class Law:
    """A law to be judged: what makes it for a set-point [rad/s], and its period [s].

    of: returns a Controller or a Python callable (t, y) -> torque that measures the top speed alone and knows that commands are late by `DELAY`.
    """

    label: str
    of: Callable[[float], Any]
    period: float = 0.01


@dataclass(frozen=True)
class Outcome:
    """What came of a group at a set-point: whether every run succeeded, the rig, seed and phase that failed first and why, and how many were run."""

    passed: bool
    why: str = ""
    runs: int = 0


@dataclass(frozen=True)
class Watch(Component):
    """What is read of the torque beside its mean: its square, and 1 where it is at a limit."""

    def equations(self, signal):
        torque = signal("top.torque", "N m", default=0.0)
        low, high = LIMITS["lowest_torque"], LIMITS["highest_torque"]
        limited = ca.if_else(torque < low + 1.0, 1.0, ca.if_else(torque > high - 1.0, 1.0, 0.0))
        return Equations(gives={"watch.square": (torque * torque, "1"), "watch.limited": (limited, "1")})


@cache
def plant_with(rock: str) -> HybridSystem:
    """The plant with one of `ROCKS`, and what is read of its torque."""
    return compose(wells.JANSEN_2, ROCKS[rock], Watch())


@cache
def cycle(reference: float) -> tuple[dict[str, Any], float]:
    """States at the last release of the stick-slip under the stiff drive of a set-point, and the period; where it leaves none, at 200 s and 8 s."""
    run = simulate(PLANT, 200.0, controller=StiffPI(reference=reference, **LIMITS), sample_time=0.01)
    releases = [event.time for event in run.events if event.before == "stick" and event.time > 100.0]
    point = run.at(releases[-1] if len(releases) > 1 else 200.0)
    start = {name: point[name] for name in PLANT.states} | {"before.pi.angle": point["pi.angle"], "before.pi.started": 1.0}
    return start, float(releases[-1] - releases[-2]) if len(releases) > 1 else 8.0


def set_point(reference: float, way: str, begin: float) -> tuple[Any, float]:
    """(input, end) of the set-point [rad/s] over time where every law has taken over by `begin` [s]; `end` [s] is its last change."""
    if way == "direct":
        return reference, begin
    top = max(LIFTED, reference)
    times = np.cumsum([0.0, begin, LIFT, HELD, LOWERED])
    return (tuple(times.tolist()), (reference, reference, top, top, reference)), float(times[-1])


def judged(law: Law, group: Group, reference: float, way: str = "direct") -> Outcome:
    """What comes of a law on a group of rigs at a set-point; stops at the first sweep that holds a failure."""
    runs = 0
    for failed, count in attempts(law, group, reference, way):
        runs += count
        if failed:
            return Outcome(False, failed[0], runs)
    return Outcome(True, "", runs)


def attempts(law: Law, group: Group, reference: float, way: str) -> Iterator[tuple[list[str], int]]:
    """(which runs failed and why, number of runs) of one sweep after the other, or of one run after the other for a Python law."""
    made = law.of(reference)
    if isinstance(made, Controller):
        made = made.design(PLANT)
    find = _in_lanes if isinstance(made, Controller) else _one_by_one
    for seed in group.seeds:
        for delay, rock in dict.fromkeys((rig.delay, rig.rock) for rig in group.rigs):
            rigs = [rig for rig in group.rigs if (rig.delay, rig.rock) == (delay, rock)]
            yield from find(law, made, rigs, group, seed, reference, way)


def verdict(numbers: dict[str, float], reference: float, noise: float) -> str:
    """Why a run is no success, given seconds stuck, means of speed, torque, its square and the share at a limit; empty where it is one."""
    if numbers["stuck"] > 0.0:
        return f"stuck {numbers['stuck']:.1f} s"
    off = numbers["speed"] / reference - 1.0
    if not abs(off) <= 0.02:
        return f"speed {100 * off:+.1f} %"
    ripple = float(np.sqrt(max(numbers["square"] - numbers["torque"] ** 2, 0.0))) / numbers["torque"]
    if not ripple <= (0.05 if noise else 0.02):
        return f"torque ripple {100 * ripple:.1f} %"
    return f"at a limit {100 * numbers['limited']:.1f} % of the time" if numbers["limited"] > 0.01 else ""


def _window(reference: float, way: str) -> tuple[dict[str, Any], float, Any, float, float]:
    """Start, period of the cycle, set-point, begin and end of the judged window."""
    start, period = cycle(reference)
    given, last = set_point(reference, way, 2.0 * period + 1.0)
    return start, period, given, last + SETTLING, last + SETTLING + JUDGED


def _in_lanes(
    law: Law, made: Controller, rigs: Sequence[Rig], group: Group, seed: int, reference: float, way: str
) -> Iterator[tuple[list[str], int]]:
    start, period, given, after, end = _window(reference, way)
    both = Takeover(StiffPI(reference=reference, **LIMITS), made, at=period, name="takeover")
    rows = [(rig, phase) for rig in rigs for phase in group.phases]
    vary = [{"takeover.at": round(period * (1.0 + phase), 2), **rig.numbers} for rig, phase in rows]
    noise = {"top.speed": group.noise} if group.noise else {}
    signals = {"speed": "bit.speed", "torque": "top.torque", "square": "watch.square", "limited": "watch.limited"}
    sampled = Sampled(both, law.period, delay=rigs[0].delay, noise=noise, seed=seed)
    loop = closed_loop(plant_with(rigs[0].rock), sampled, inputs={"top.reference": given}, start=start)
    means = {name: measures.mean(of, after) for name, of in signals.items()}
    found = sweep(loop, vary, end, measures={"stuck": measures.time_in("bit", after), **means})
    failed = []
    for i, (rig, phase) in enumerate(rows):
        numbers = {name: float(found[name][i]) for name in ("stuck", *signals)}
        why = verdict(numbers, reference, group.noise) if np.isfinite(list(numbers.values())).all() else "the run failed"
        if why:
            failed.append(f"{rig.name}, seed {seed}, phase {phase:g}: {why}")
    yield failed, len(rows)


def _one_by_one(
    law: Law, made: Any, rigs: Sequence[Rig], group: Group, seed: int, reference: float, way: str
) -> Iterator[tuple[list[str], int]]:
    start, period, given, after, end = _window(reference, way)
    states = {name: value for name, value in start.items() if not name.startswith("before.")}
    grid = np.arange(after, end, law.period / 2) + law.period / 4
    noise = {"top.speed": group.noise} if group.noise else {}
    for rig in rigs:
        for phase in group.phases:
            taken = TakenOver(
                made, law.period, np.ceil(period * (1.0 + phase) / law.period) * law.period, reference, start["before.pi.angle"]
            )
            inputs = {"top.reference": given, "bit.weight": rig.numbers["bit.weight"]}
            parameters = {
                "chain.inertia": (rig.numbers["chain.inertia.0"], rig.numbers["chain.inertia.1"]), "chain.stiffness": (rig.numbers["chain.stiffness.0"],)
            }  # fmt: skip
            try:
                run = simulate(
                    plant_with(rig.rock), end, controller=Sampled(taken, law.period, delay=rig.delay, noise=noise, seed=seed), start=states, inputs=inputs,
                    parameters=parameters, output_times=grid,
                )  # fmt: skip
                torque = run["top.torque"]
                limited = (torque < LIMITS["lowest_torque"] + 1.0) | (torque > LIMITS["highest_torque"] - 1.0)
                numbers = {
                    "stuck": run.time_in("bit", "stick", after=after), "speed": float(run["bit.speed"].mean()), "torque": float(torque.mean()),
                    "square": float((torque**2).mean()), "limited": float(limited.mean()),
                }  # fmt: skip
                why = verdict(numbers, reference, group.noise)
            except SimulationError:
                why = "the run failed"
            yield ([f"{rig.name}, seed {seed}, phase {phase:g}: {why}"] if why else []), 1


class TakenOver:
    """A Python law that takes over from the stiff drive at a time [s]: `toolbox.modelling.Takeover` for callables; the stiff drive is sampled as slowly.

    law: a predictive law as designed, which is told the torque that is held.  angle: integral [rad] of the stiff drive at the start.
    """

    def __init__(self, law: Any, period: float, at: float, reference: float, angle: float):
        self.law, self.period, self.at, self.angle = law, period, at, angle
        self.drive = StiffPI(reference=reference, **LIMITS)
        self.measures, self.drives = law.measures, law.drives
        self.defaults = dict(law.defaults)

    def __call__(self, t: float, y: Any) -> float:
        if t > self.at - 1e-6:
            return float(self.law(t, y))
        error = float(y[-1] - y[0])
        wanted = self.drive.proportional * error + self.drive.integral * self.angle
        torque = min(max(wanted, LIMITS["lowest_torque"]), LIMITS["highest_torque"])
        self.angle += self.period * (error + (torque - wanted) / self.drive.proportional)
        return torque


def disk_margins(of: Callable[[float], Any], reference: float, period: float = 0.01) -> tuple[float, float, str]:
    """The disk margin of a law at a set-point [rad/s] on the declared rig, the smallest over one error of the rig at a time, and which; nan without a slope."""
    declared = margins(closed_loop(PLANT, Sampled(of(reference), period, DELAY)), measured=False).disk_margin
    if np.isnan(declared):
        return declared, declared, ""
    found = []
    for rig in SINGLES:
        inputs = {"bit.weight": rig.numbers["bit.weight"]}
        sampled = Sampled(of(reference), period, rig.delay)
        found.append((margins(closed_loop(PLANT, sampled, inputs=inputs, parameters=rig.parameters), measured=False).disk_margin, rig.name))
    return declared, *min(found)


# --- the search


class Cells:
    """Outcomes that are known, by law, group, way and set-point, kept in a file of JSON lines, so that a search that was stopped goes on where it was.

    path: of the file, or None for none.  A line that was not finished is left out. The numbers of the law are part of the key: another law of the same
    label is judged anew.
    """

    def __init__(self, path: Path | None = None, progress: bool = False):
        self.path, self.progress = path, progress
        self.known: dict[str, Outcome] = {}
        if path is not None and path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                try:
                    row = json.loads(line)
                except json.JSONDecodeError:
                    continue
                self.known[row["key"]] = Outcome(row["passed"], row["why"], row["runs"])

    def outcome(self, law: Law, group: Group, reference: float, way: str) -> Outcome:
        """The outcome at a set-point, known or new."""
        made = law.of(reference)
        key = json.dumps(
            [law.label, repr(getattr(made, "law", made) if not isinstance(made, Controller) else made), repr(group), way, reference]
        )
        if key not in self.known:
            found = judged(law, group, reference, way)
            self.known[key] = found
            if self.path is not None:
                with self.path.open("a", encoding="utf-8") as file:
                    file.write(json.dumps({"key": key, "passed": found.passed, "why": found.why, "runs": found.runs}) + "\n")
            if self.progress:
                said = "holds" if found.passed else f"fails: {found.why}"
                print(f"{law.label}, {group.name}, {way}, {reference:.1f} rad/s: {said}", file=sys.stderr, flush=True)
        return self.known[key]


@dataclass(frozen=True)
class Lowest:
    """The lowest set-point [rad/s] that a law holds on a group, nan where it holds none, and what fails one step below."""

    speed: float
    why: str


def lowest(
    law: Law, group: Group, way: str, cells: Cells | None = None, lower: float = LOWEST, higher: float = HIGHEST, step: float = STEP
) -> Lowest:
    """The lowest set-point by bisection between `lower` (taken to fail) and `higher`, confirmed at three set-points above it.

    Where one of these fails, the search goes on above it: what is printed is the lowest from which on nothing that was tried failed.
    """
    cells = cells or Cells()

    def fails(k: int) -> str:
        found = cells.outcome(law, group, round(k * step, 6), way)
        return "" if found.passed else found.why

    low, high = round(lower / step), round(higher / step)
    why = fails(high)
    if why:
        return Lowest(float("nan"), why)
    below = "not tried below"
    while True:
        while high - low > 1:
            middle = (low + high) // 2
            said = fails(middle)
            low, high, below = (middle, high, said) if said else (low, middle, below)
        top = round(higher / step)
        above = sorted({min(high + round(each / step), top) for each in (0.3, 0.8, 2.0)})
        broken = [(k, said) for k in above if (said := fails(k))]
        if not broken:
            return Lowest(round(high * step, 6), below)
        low, below = broken[-1]
        high = top


def tuned_on(group: Group) -> Group:
    """The group as laws are tuned on it: phases half-way between those of the table, and one seed that it does not use."""
    return replace(group, phases=tuple(phase + 1 / 16 for phase in group.phases[::2]), seeds=(1,) if group.noise else (0,))


def rock_torques(reference: float) -> dict[str, float]:
    """Torque [N m] of each of `ROCKS` at a set-point: they agree at rest."""
    from controllers.string_model import rock_slope

    return {name: rock_slope(plant_with(name), reference)[0] for name in ROCKS}
