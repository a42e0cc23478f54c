"""Gains of the laws of the drive study: every family is searched by one verb, on rigs, phases, seeds and weights that the table does not use.

    minimise over the numbers q of a law:   share of runs that fail on rigs  +  share that fail under a weight that varies  +  (1 - disk margin) / 50

    rigs: a ladder of set-points, each with every rig of the groups robust and corners of `studies.protocol`, half-way between the phases of the table and with
    another seed;  weight: noise of 5 %, a sine of 5 % and a heave of 10 %, with another realisation, at two set-points;  disk margin: the smallest at 4 rad/s
    over the robust rigs, 0 for a law without a slope

    python -m studies drives --tune FAMILY ... [--runs N] [--jobs N] [--out FOLDER] [--keep]
        (minutes; FOLDER keeps every point and the gains; --keep writes studies/data/gains.json)

Laws that lift their own set-point are searched with the lift, at lower set-points, and at one more on the declared and a heavier rig. A law that fails at more
than half of the runs of a set-point is not tried at lower ones, nor under weights where it fails on half of the rigs: all of these runs count as failed.
Predictive laws cost hundreds of times as much: they are searched on the corners alone, from one phase, with few points, which is stored beside them.

The search is differential evolution from a Sobol population that holds the numbers that are stored, or else the middle of the bounds (R. Storn, K. Price,
J. Global Optimization 11 (1997) 341-359, scipy), as in `toolbox.tune`. Why not `tune` itself: it simulates one run after the other, and the 28 runs of a
set-point step side by side in lanes, some twenty times as fast. Stored are the numbers, the budget, the seed, where the search began and the Pareto front over
the three terms.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controllers import (
    LQG,
    PI,
    HInfinity,
    ImpedanceSuperTwisting,
    ImplicitSlidingMode,
    Lifting,
    LinearMPC,
    NonlinearMPC,
    SlidingMode,
    SoftTorque,
    StringObserverController,
    SuperTwisting,
    ZTorque,
)
from controllers.dither import declared_load
from controllers.observers import Kalman
from studies.protocol import CORNERS, DELAY, GROUPS, LIMITS, NOISE, SINGLES, trial
from toolbox import Controller, Quantity, SceneError, SimulationError, Update, quantity
from toolbox.drilling.groups import Group, Machine
from toolbox.files.atomic import replaced
from toolbox.files.journal import Journal
from toolbox.modelling import OptionalQuantity
from toolbox.tuning.results import front_of

STORE = Path(__file__).parent / "data" / "gains.json"
LADDER = (9.0, 6.5, 5.5, 4.5, 4.0)
"""Set-points [rad/s] that a law is tuned at, the easiest first."""
LIFTED = (9.0, 5.0, 4.3, 4.0, 3.8)
"""Those of a law that lifts its own set-point: at the first the top swings least while the bit sticks."""
NEAR = (3.4,)
"""Those of such a law on the rigs that are nearly the declared one."""
WEIGHED = (8.0, 6.0)
"""Set-points [rad/s] under a weight that varies."""
PLANNED = (8.5, 6.0)
"""Those of predictive laws."""
LOW = 4.0
"""Set-point [rad/s] of the disk margin."""
SMALL = 0.02
"""What the disk margin counts: a few runs."""
POPULATION = 16
TUNING = Group("tuning", SINGLES + CORNERS, (1,), takeover_phases=(1 / 16, 9 / 16))
NEARLY = Group("nearly declared", (Machine("nominal"), *GROUPS["noisy"].machines), (1,), takeover_phases=TUNING.takeover_phases)
WEIGHTS = Group("weights", GROUPS["varying_weight"].machines[1:], (1,), takeover_phases=TUNING.takeover_phases, judged_time=200.0)
BRIEF = Group("combined", CORNERS, (1,), takeover_phases=(1 / 16,), judged_time=60.0)
BRIEF_WEIGHTS = Group("weights", GROUPS["varying_weight"].machines[2:3], (1,), takeover_phases=(1 / 16,), judged_time=100.0)
LATE = round(DELAY / 0.01)


@dataclass(frozen=True)
class Dithered(Controller):
    """A law of the torque that presses the bit harder while it turns faster than asked: the phased dither of `controllers.PhasedDither` beside a drive.

        weight = what is asked (1 + depth clip((bit speed - set-point) / size, -1, 1))

    It drives `bit.weight`, too, as fast as the string swings, which no rig does today; the bit speed is an estimate where it acts inside
    `StringObserverController`.
    """

    law: Controller
    depth: Quantity = quantity(0.2, "1", "amplitude in parts of the weight that is asked", at_least=0, at_most=1)
    size: Quantity = quantity(2.0, "rad/s", "deviation of the bit speed at which the depth is reached", above=0)
    reference: Quantity = quantity(8.0, "rad/s", "set-point", above=0)
    weight: OptionalQuantity = quantity(None, "N", "weight that is asked, default of `weight.reference`; filled in by design", at_least=0)

    @property
    def measured_signals(self) -> tuple[str, ...]:  # type: ignore[override]
        """What the law measures, and the bit speed."""
        return tuple(dict.fromkeys((*self.law.measured_signals, "bit.speed")))

    @property
    def actuated_signals(self) -> tuple[str, ...]:  # type: ignore[override]
        """What the law drives, and the weight."""
        return (*self.law.actuated_signals, "bit.weight")

    def design(self, plant):
        """The law inside designed, with the weight of the plant."""
        return replace(self, law=self.law.design(plant), weight=declared_load(plant, "bit.weight"))

    def sampled(self, signal, period):
        inside = self.law.sampled(signal, period)
        faster = signal("bit.speed", "rad/s") - signal("top.reference", "rad/s", default=self.reference)
        wave = ca.fmin(ca.fmax(faster / self.size, -1.0), 1.0)
        asked = signal("weight.reference", "N", default=self.weight)
        return Update(inside.memory, {**inside.outputs, "bit.weight": (asked * (1.0 + self.depth * wave), "N")})


@dataclass(frozen=True)
class Family:
    """Laws with free numbers: what makes one of numbers, and the bounds of these, positive, searched by their logarithm.

    lifts: whether they lift their own set-point.  planned: whether they are predictive, sampled every 0.1 s.
    """

    of: Callable[[Mapping[str, float]], Any]
    bounds: Mapping[str, tuple[float, float]]
    lifts: bool = False
    planned: bool = False

    @property
    def ladder(self) -> tuple[float, ...]:
        """Set-points [rad/s] that its laws are tuned at, the easiest first."""
        return PLANNED if self.planned else LIFTED if self.lifts else LADDER

    @property
    def rungs(self) -> tuple[tuple[Group, tuple[float, ...]], ...]:
        """(group of rigs, set-points [rad/s]) that its laws are tuned on."""
        return ((BRIEF if self.planned else TUNING, self.ladder), *(((NEARLY, NEAR),) if self.lifts else ()))

    @property
    def weighed(self) -> tuple[Group, tuple[float, ...]]:
        """The same under a weight that varies."""
        return (BRIEF_WEIGHTS, WEIGHED[:1]) if self.planned else (WEIGHTS, WEIGHED)

    @property
    def runs(self) -> tuple[int, int]:
        """Runs on rigs, and runs under a weight that varies."""
        group, speeds = self.weighed
        return sum(each.runs * len(ladder) for each, ladder in self.rungs), group.runs * len(speeds)

    def trial(self, numbers: Mapping[str, float]) -> Any:
        """How the law of some numbers is tried."""
        return trial("tuned", self.of(numbers), 0.1 if self.planned else 0.01)


WALKS = {"torque_process_noise": (100.0, 20_000.0), "drive_process_noise": (20.0, 1000.0)}
"""Bounds of what the Kalman filter of a law holds for possible."""


def _on_estimates(kind: Callable[..., Controller], bounds: Mapping[str, tuple[float, float]]) -> Family:
    """A law that asks for more than the top speed, on a Kalman filter whose numbers are free, too."""

    def law(q: Mapping[str, float]) -> StringObserverController:
        filtered = Kalman(speed_noise=NOISE, **{name: q[name] for name in WALKS})
        return StringObserverController(kind(**{name: q[name] for name in bounds}), filtered, delay_samples=LATE)

    return Family(law, {**bounds, **WALKS})


def _dithered(proportional: float, integral: float, **numbers: float) -> Controller:
    return Dithered(PI(proportional=proportional, integral=integral, **LIMITS), **numbers)


IMPEDANCE = {"proportional": (200.0, 4000.0), "integral": (50.0, 3000.0)}
FAMILIES: dict[str, Family] = {
    "soft torque": Family(lambda q: SoftTorque(**q, **LIMITS), {"detuning": (0.2, 5.0)}),
    "impedance": Family(lambda q: PI(**q, **LIMITS), IMPEDANCE),
    "Z-torque": Family(
        lambda q: ZTorque(**q, **LIMITS),
        {"impedance": (100.0, 3000.0), "integral": (20.0, 2000.0), "inertia": (50.0, 1900.0), "filter_time": (0.01, 1.0)},
    ),
    "H-infinity": Family(
        lambda q: HInfinity(**q, **LIMITS),
        {
            "bit_speed_scale": (0.1, 10.0),
            "angle_scale": (1.0, 100.0),
            "disturbance_scale": (200.0, 20_000.0),
            "speed_noise": (0.003, 0.3),
            "norm_factor": (1.02, 3.0),
        },
    ),
    "LQG": Family(
        lambda q: LQG(delay_samples=LATE, **q, **LIMITS),
        {
            "top_speed_scale": (0.3, 30.0),
            "bit_speed_scale": (0.1, 10.0),
            "angle_scale": (1.0, 100.0),
            "torque_process_noise": (200.0, 20_000.0),
            "drive_process_noise": (20.0, 1000.0),
        },
    ),
    "sliding mode": _on_estimates(
        lambda **q: SlidingMode(**q, **LIMITS), {"surface_gain": (0.02, 2.0), "reaching_rate": (0.1, 10.0), "boundary_layer": (0.02, 2.0)}
    ),
    "implicit sliding mode": _on_estimates(
        lambda **q: ImplicitSlidingMode(**q, **LIMITS),
        {"surface_gain": (0.02, 2.0), "reaching_rate": (0.1, 10.0), "adaptation_gain": (0.001, 0.5)},
    ),
    "super-twisting": _on_estimates(
        lambda **q: SuperTwisting(**q, **LIMITS), {"surface_gain": (0.02, 2.0), "disturbance_rate": (0.05, 20.0)}
    ),
    "impedance super-twisting": _on_estimates(
        lambda **q: ImpedanceSuperTwisting(**q, **LIMITS),
        {"surface_gain": (0.02, 2.0), "disturbance_rate": (0.05, 20.0), "impedance": (100.0, 4000.0)},
    ),
    "impedance and dither of the weight": _on_estimates(_dithered, {**IMPEDANCE, "depth": (0.02, 0.5), "size": (0.2, 10.0)}),
}


def _lifting(family: Family) -> Family:
    return replace(family, of=lambda q: Lifting(family.of(q)), lifts=True)


FAMILIES |= {f"{name}, lifting": _lifting(family) for name, family in list(FAMILIES.items())}
FAMILIES |= {
    "linear MPC": Family(
        lambda q: LinearMPC(delay=DELAY, **q, **LIMITS),
        {
            "top_speed_scale": (1.0, 40.0),
            "bit_speed_scale": (0.3, 20.0),
            "torque_step_scale": (1000.0, 40_000.0),
            "torque_process_noise": (100.0, 4000.0),
            "drive_process_noise": (10.0, 1000.0),
        },
        planned=True,
    ),
    "nonlinear MPC": Family(
        lambda q: NonlinearMPC(delay=DELAY, **q, **LIMITS),
        {
            "top_speed_scale": (1.0, 40.0),
            "bit_speed_scale": (0.3, 20.0),
            "drive_torque_error": (0.02, 0.5),
            "strength_process_noise": (0.001, 0.05),
        },
        planned=True,
    ),
}


def label_of(family: str) -> str:
    """What a tuned law is called in tables."""
    name, _, lifting = family.partition(", ")
    return f"{name}, tuned, {lifting}" if lifting else f"{name}, tuned"


def failures(family: Family, numbers: Mapping[str, float], ladder: Sequence[float], group: Group = TUNING) -> int:
    """How many of the runs of a ladder of set-points fail; the rest of the ladder counts as failed below one at which more than half do."""
    total = 0
    for i, speed in enumerate(ladder):
        try:
            here = sum(len(failed) for failed, _ in family.trial(numbers).attempts(group, speed))
        except (SceneError, SimulationError, np.linalg.LinAlgError):  # numbers for which there is no law
            here = group.runs
        total += here
        if here > group.runs // 2:
            return total + group.runs * (len(ladder) - 1 - i)
    return total


class Score(NamedTuple):
    """Runs that fail on rigs and under a weight that varies, and the disk margin that is left on the worst of the robust rigs, at most 1."""

    rigs: int
    weights: int
    margin: float


def score(family: Family, numbers: Mapping[str, float]) -> Score:
    """What the numbers of a family are worth."""
    most, weighed = family.runs
    rigs = 0
    for group, ladder in family.rungs:
        rigs += failures(family, numbers, ladder, group) if rigs <= most // 2 else group.runs * len(ladder)
    if rigs > most // 2:
        return Score(rigs, weighed, 0.0)
    group, ladder = family.weighed
    return Score(rigs, failures(family, numbers, ladder, group), 0.0 if family.planned else margin(family, numbers))


def counted(family: Family, found: Score) -> float:
    """The number that a search makes small."""
    rigs, weights = family.runs
    return found.rigs / rigs + found.weights / weights + SMALL * (1.0 - found.margin)


@dataclass(frozen=True)
class Found:
    """What a search found: the best numbers and their score, all points with theirs, where it began, its seed, and processor seconds (nan where it went on)."""

    numbers: dict[str, float]
    score: Score
    points: list[tuple[dict[str, float], Score]]
    begun: dict[str, float]
    seed: int
    seconds: float

    @property
    def front(self) -> list[tuple[dict[str, float], Score]]:
        """The points that no other one beats in all three terms."""
        return [self.points[i] for i in front_of(np.array([(each.rigs, each.weights, -each.margin) for _, each in self.points]))]


def begun(label: str, path: Path = STORE) -> dict[str, float]:
    """Where the search of a family begins: at its stored numbers, those of the law without a lift, or in the middle of the bounds."""
    family, rows = FAMILIES[label], json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    middle = {name: float(f"{math.sqrt(low * high):.4g}") for name, (low, high) in family.bounds.items()}
    return dict(next((rows[name]["numbers"] for name in (label, label.partition(",")[0]) if name in rows), middle))


def searched(label: str, points: int, seed: int = 1, kept: Path | None = None, first: Mapping[str, float] | None = None) -> Found:
    """The numbers of a family with the smallest score among so many points, which a file keeps, from `first` on, or from `begun`."""
    from scipy.optimize import differential_evolution
    from scipy.stats import qmc

    family, began = FAMILIES[label], time.process_time()
    first = dict(first or begun(label))
    names, low, high = list(family.bounds), *(np.log([pair[side] for pair in family.bounds.values()]) for side in (0, 1))
    journal = Journal(kept, {"family": label, "bounds": repr(family.bounds), "seed": str(seed), "first": repr(first)}) if kept else None
    resumed = bool(journal and journal.known)
    tried: dict[tuple[float, ...], Score] = {}

    def value(q: np.ndarray) -> float:
        key = tuple(float(f"{each:.4g}") for each in np.exp(q))
        if key not in tried:
            if len(tried) >= points:  # the budget is spent, the search only ends
                return math.inf
            known = journal.known.get(key) if journal else None
            tried[key] = Score(*known) if known else score(family, dict(zip(names, key, strict=True)))
            if journal and not known:
                journal.add(key, list(tried[key]))
        return counted(family, tried[key])

    sample = qmc.Sobol(len(names), seed=seed).random(POPULATION)
    population = low + (high - low) * sample
    population[0] = np.clip(np.log([first[name] for name in names]), low, high)
    generations = max(1, math.ceil(points / POPULATION))
    differential_evolution(value, list(zip(low, high, strict=True)), init=population, maxiter=generations, seed=seed, polish=False)
    every = [(dict(zip(names, key, strict=True)), found) for key, found in tried.items()]
    numbers, best = min(every, key=lambda pair: counted(family, pair[1]))
    return Found(numbers, best, every, first, seed, math.nan if resumed else time.process_time() - began)


def margin(family: Family, numbers: Mapping[str, float]) -> float:
    """The smallest disk margin at `LOW` over one error of the rig at a time, at most 1; 0 where the loop is unstable or has no slope."""
    try:
        worst = family.trial(numbers).disk_margins(SINGLES, LOW)[1]
    except (SceneError, SimulationError):  # no smooth running
        return 0.0
    return 0.0 if np.isnan(worst) else min(worst, 1.0)


AIMS = {"nominal": 3.2, "noisy": 3.5, "one_at_a_time": 3.8, "combined": 4.0, "other_rocks": 5.4}
"""Set-points [rad/s] of groups at which one law should be left with a margin."""


def margins_at(family: Family, numbers: Mapping[str, float], aims: Mapping[str, float] = AIMS) -> dict[str, float]:
    """The smallest disk margin of every group at its set-point, that of the declared machine included: seconds, where runs take minutes."""
    tried = family.trial(numbers)
    return {name: min(tried.disk_margins(GROUPS[name].machines, speed)[:2]) for name, speed in aims.items()}


def store(label: str, found: Found, path: Path = STORE) -> None:
    """Keep the numbers of a family beside those of the others, with the command that found them and the front."""
    rows = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    rigs, weights = FAMILIES[label].runs
    rows[label] = {
        "numbers": found.numbers, "command": f"python -m studies drives --tune {label!r} --runs {len(found.points)}", "failures": found.score.rigs,
        "of": rigs, "failures under weight": found.score.weights, "of weight": weights, "margin": round(found.score.margin, 4),
        "points": len(found.points), "seed": found.seed, "begun": found.begun,
        "processor seconds": None if math.isnan(found.seconds) else round(found.seconds),
        "front": [{**numbers, "failures": each.rigs, "failures under weight": each.weights, "margin": round(each.margin, 4)} for numbers, each in found.front],
    }  # fmt: skip
    with replaced(path) as file:  # whole at every instant: processes that search other families read it
        file.write((json.dumps(rows, indent=2) + "\n").encode())


def stored(label: str, path: Path = STORE) -> dict[str, float]:
    """The numbers of a family as they were found. Raises KeyError where none are stored."""
    return dict(json.loads(path.read_text(encoding="utf-8"))[label]["numbers"])


def tuned(label: str) -> Any:
    """A law of a family with its stored gains."""
    return FAMILIES[label].of(stored(label))


def between(first: str, second: str, part: float) -> dict[str, float]:
    """Numbers a part of the way from those that are stored of one family to those of another, in logarithms."""
    ends = stored(first), stored(second)
    return {name: float(f"{low ** (1.0 - part) * ends[1][name] ** part:.4g}") for name, low in ends[0].items()}


def known() -> list[str]:
    """The families whose gains are stored."""
    rows = json.loads(STORE.read_text(encoding="utf-8"))
    return [label for label in FAMILIES if label in rows]


def points(row: str) -> int:
    """How many points were tried for the gains of a row of the table; 0 for a law as it is delivered."""
    rows = json.loads(STORE.read_text(encoding="utf-8"))
    return next((each["points"] for label, each in rows.items() if label_of(label) == row), 0)
