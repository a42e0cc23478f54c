"""Gains of the laws of the drive study: searched on rigs, phases and a seed that its table does not use, with equal budgets, and stored with their command.

    minimise over the numbers q of a law:   failures over a ladder of set-points, of 28 runs each: every rig of the groups robust and corners of
    `studies.protocol`, half-way between the phases of the table, with another seed

    python -m studies drives --tune LABEL ... [--runs N]        (minutes; writes studies/data/gains.json)

Laws that lift their own set-point are searched with the lift, at lower set-points, and of numbers that fail equally often those win that leave the largest disk
margin at 4 rad/s on the worst of the robust rigs.

The search is differential evolution from a Sobol population (R. Storn, K. Price, J. Global Optimization 11 (1997) 341-359, scipy), as in `toolbox.tune`. Why
not `tune` itself: it simulates one run after the other, and the 28 runs of a set-point step side by side in lanes, some twenty times as fast. A law with many
failures at a set-point is not tried at lower ones, where all of its runs count as failed.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from controllers import LQG, PI, HInfinity, Lifting, ZTorque
from studies.protocol import CORNERS, DELAY, LIMITS, SINGLES, trial
from toolbox import SceneError, SimulationError
from toolbox.robustness.groups import Group

STORE = Path(__file__).parent / "data" / "gains.json"
LADDER = (6.5, 5.5, 4.5, 4.0)
"""Set-points [rad/s] that a law is tuned at, the easiest first."""
LIFTED = (9.0, 5.0, 4.3, 4.0, 3.8)
"""Those of a law that lifts its own set-point: at the first the top swings least while the bit sticks."""
LOW = 4.0
"""Set-point [rad/s] of the disk margin."""
TUNING = Group("tuning", SINGLES + CORNERS, (1,), phases=(1 / 16, 9 / 16))
LATE = round(DELAY / 0.01)


@dataclass(frozen=True)
class Family:
    """Laws with free numbers: what makes one of numbers, and the bounds of these, positive, searched by their logarithm.

    lifts: whether they lift their own set-point.
    """

    of: Callable[[Mapping[str, float]], Any]
    bounds: Mapping[str, tuple[float, float]]
    lifts: bool = False

    @property
    def ladder(self) -> tuple[float, ...]:
        """Set-points [rad/s] that its laws are tuned at, the easiest first."""
        return LIFTED if self.lifts else LADDER


FAMILIES: dict[str, Family] = {
    "impedance": Family(lambda q: PI(**q, **LIMITS), {"proportional": (200.0, 4000.0), "integral": (50.0, 3000.0)}),
    "Z-torque": Family(
        lambda q: ZTorque(**q, **LIMITS),
        {"impedance": (100.0, 3000.0), "integral": (20.0, 2000.0), "inertia": (50.0, 1900.0), "filter_time": (0.01, 1.0)},
    ),
    "H-infinity": Family(
        lambda q: HInfinity(**q, **LIMITS),
        {
            "bit_size": (0.1, 10.0),
            "angle_size": (1.0, 100.0),
            "disturbance": (200.0, 20_000.0),
            "speed_noise": (0.003, 0.3),
            "margin": (1.02, 3.0),
        },
    ),
    "LQG": Family(
        lambda q: LQG(late=LATE, **q, **LIMITS),
        {
            "top_size": (0.3, 30.0),
            "bit_size": (0.1, 10.0),
            "angle_size": (1.0, 100.0),
            "torque_walk": (200.0, 20_000.0),
            "drive_walk": (20.0, 1000.0),
        },
    ),
}


def _lifting(family: Family) -> Family:
    return Family(lambda q: Lifting(family.of(q)), family.bounds, lifts=True)


FAMILIES |= {f"{name}, lifting": _lifting(FAMILIES[name]) for name in ("impedance", "Z-torque", "LQG")}


def label_of(family: str) -> str:
    """What a tuned law is called in tables."""
    name, _, lifting = family.partition(", ")
    return f"{name}, tuned, {lifting}" if lifting else f"{name}, tuned"


def failures(family: Family, numbers: Mapping[str, float], ladder: tuple[float, ...]) -> int:
    """How many of the runs of a ladder of set-points fail; the rest of the ladder counts as failed below one at which more than half do."""
    total = 0
    for i, speed in enumerate(ladder):
        try:
            here = sum(len(failed) for failed, _ in trial("tuned", family.of(numbers)).attempts(TUNING, speed))
        except (SceneError, SimulationError):  # numbers for which there is no law
            here = TUNING.runs
        total += here
        if here > TUNING.runs // 2:
            return total + TUNING.runs * (len(ladder) - 1 - i)
    return total


@dataclass(frozen=True)
class Found:
    """The best numbers of a search, how many runs fail with them, points tried, and processor seconds."""

    numbers: dict[str, float]
    failures: int
    points: int
    seconds: float


def searched(label: str, points: int, seed: int = 1) -> Found:
    """The numbers of a family with the fewest failures among so many points; the same arguments give the same numbers."""
    from scipy.optimize import differential_evolution

    family, began, tried = FAMILIES[label], time.process_time(), [0]
    most = TUNING.runs * len(family.ladder) + 1
    names, low, high = list(family.bounds), *(np.log([pair[side] for pair in family.bounds.values()]) for side in (0, 1))
    best: tuple[float, dict[str, float]] = (most, {})

    def value(q: np.ndarray) -> float:
        nonlocal best
        if tried[0] >= points:  # the budget is spent, the search only ends
            return most
        tried[0] += 1
        numbers = {name: float(f"{each:.4g}") for name, each in zip(names, np.exp(q), strict=True)}
        found: float = failures(family, numbers, family.ladder)
        if family.lifts and found < best[0] + 1:
            found += 0.5 * (1.0 - margin(family, numbers))
        best = min(best, (found, numbers), key=lambda pair: pair[0])
        return found

    size = max(5, 40 // len(names))
    differential_evolution(
        value,
        list(zip(low, high, strict=True)),
        popsize=size,
        maxiter=max(1, points // (size * len(names))),
        seed=seed,
        polish=False,
        init="sobol",
    )
    return Found(best[1], int(best[0]), tried[0], time.process_time() - began)


def margin(family: Family, numbers: Mapping[str, float]) -> float:
    """The smallest disk margin at `LOW` over one error of the rig at a time, at most 1; 0 where the loop is unstable."""
    worst = trial("tuned", family.of(numbers)).disk_margins(SINGLES, LOW)[1]
    return 0.0 if np.isnan(worst) else min(worst, 1.0)


def store(label: str, found: Found, path: Path = STORE) -> None:
    """Keep the numbers of a family beside those of the others, with the command that found them."""
    rows = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    rows[label] = {
        "numbers": found.numbers, "command": f"python -m studies drives --tune {label!r} --runs {found.points}", "failures": found.failures,
        "of": TUNING.runs * len(FAMILIES[label].ladder), "points": found.points, "processor seconds": round(found.seconds),
    }  # fmt: skip
    path.write_text(json.dumps(rows, indent=2) + "\n", encoding="utf-8")


def stored(label: str, path: Path = STORE) -> dict[str, float]:
    """The numbers of a family as they were found. Raises KeyError where none are stored."""
    return dict(json.loads(path.read_text(encoding="utf-8"))[label]["numbers"])


def tuned(label: str) -> Any:
    """A law of a family with its stored gains."""
    return FAMILIES[label].of(stored(label))
