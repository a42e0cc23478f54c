"""Random mechanisms against a reference by Gauss's principle: groups of frictions, stops, backlash, one-way clutches, levers, wagons that touch.

    M q'' = f(t, q, q') + sum c_k F_k          bodies on springs and dampers, each driven by a mean force and a sine

The reference (`studies.benchmarks.mechanism_reference`) knows no modes that the toolbox knows: it solves for forces by least squares with bounds. Where its own
end moves by more than 1e-6 with a change of the forces by 1e-9, or it decides one way now and another way a moment later, a mechanism is left out.
A refusal is right only for a ring of frictions that are weaker in slip than at rest, and only where `two_motions` finds two that obey every law.

    python -m studies fuzz --section mechanisms [--structures 600] [--seed 1] [--first N]
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from models import Coulomb, TwoWay, Viscous
from studies.benchmarks.mechanism_reference import Clutch, Friction, LeftOut, Reference, Stop
from toolbox import (
    Component,
    DryFriction,
    Equations,
    SceneError,
    SimulationError,
    UnilateralContact,
    compose,
    simulate,
    state,
    time,
)
from toolbox.modelling import OneWayClutch

METHODS = ("event", "explicit", "taylor", "stiff")
ACCURACY = 1e-9
APART = 1e-5
"""Distance from the reference, in parts of the largest value, from which on a run is wrong."""
STIRRED = 1e-9
"""Part by which forces are changed to see whether a mechanism is too sensitive to compare."""


@dataclass(frozen=True)
class Rub:
    """A friction on the slip row q': bounds and kinetic forces forwards and backwards, a viscous term, and whether its lever is a cosine of q."""

    row: tuple[float, ...]
    static: tuple[float, float]
    kinetic: tuple[float, float]
    viscous: float = 0.0
    lever: bool = False


@dataclass(frozen=True)
class Trial:
    """Numbers of a mechanism. stops: (row, place, restitution);  clutches: rows;  drive: (mean, amplitude, rad/s, phase) of every body."""

    kind: str
    masses: tuple[float, ...]
    springs: tuple[float, ...]
    dampers: tuple[float, ...]
    drive: tuple[tuple[float, float, float, float], ...]
    rubs: tuple[Rub, ...]
    stops: tuple[tuple[tuple[float, ...], float, float], ...]
    clutches: tuple[tuple[float, ...], ...]
    q: tuple[float, ...]
    v: tuple[float, ...]
    duration: float

    def plant(self) -> Any:
        """The mechanism for the toolbox."""
        return compose(Mechanism(self))

    def run(self, **changes: Any) -> Any:
        """The run by the toolbox."""
        given = {"start": {"row.place": self.q, "row.speed": self.v}, "accuracy": ACCURACY}
        return simulate(self.plant(), self.duration, **(given | changes))

    def reference(self, stirred: float = 0.0) -> Reference:
        """The run by the reference, with all forces changed by a part."""
        drive, springs, dampers = np.array(self.drive), np.array(self.springs), np.array(self.dampers)

        def pull(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
            given = drive[:, 0] + drive[:, 1] * np.sin(drive[:, 2] * t + drive[:, 3])
            return (1 + stirred) * given - springs * q - dampers * v

        contacts: list[Any] = []
        for i, rub in enumerate(self.rubs):
            row = np.array(rub.row)
            laws = [lambda s, k=k, c=rub.viscous: k + c * s for k in rub.kinetic]
            contacts.append(Friction(f"rub{i}", (lambda q, row=row: row * math.cos(float(row @ q))) if rub.lever else row, rub.static[0], laws[0],
                                     static_back=rub.static[1], kinetic_back=laws[1]))  # fmt: skip
        contacts += [Stop(f"stop{i}", np.array(row), e, lambda t, at=at: at) for i, (row, at, e) in enumerate(self.stops)]
        contacts += [Clutch(f"clutch{i}", np.array(row)) for i, row in enumerate(self.clutches)]
        return Reference(np.array(self.masses), pull, contacts, np.array(self.q), np.array(self.v), self.duration)


@dataclass(frozen=True)
class Mechanism(Component):
    """The equations of a trial."""

    trial: Trial

    def equations(self, signal):
        one, n = self.trial, len(self.trial.masses)
        q, v = state("row.place", "m", n), state("row.speed", "m/s", n)
        force = [a + b * ca.sin(w * time + c) for a, b, w, c in one.drive]
        pull = ca.vertcat(*force) - ca.DM(one.springs) * q - ca.DM(one.dampers) * v
        elements: list[Any] = []
        for i, rub in enumerate(one.rubs):
            row = ca.DM(rub.row).T
            lever = ca.cos(row @ q) if rub.lever else 1.0
            laws = [
                Coulomb(s, k) if not rub.viscous else Viscous(Coulomb(s, k), rub.viscous)
                for s, k in zip(rub.static, rub.kinetic, strict=True)
            ]
            element = DryFriction(f"rub{i}", lever * (row @ v), laws[0] if rub.static[0] == rub.static[1] else TwoWay(*laws))
            pull += row.T * lever * element.force
            elements.append(element)
        for i, (numbers, at, e) in enumerate(one.stops):
            row = ca.DM(numbers).T
            stop = UnilateralContact(f"stop{i}", row @ q - at, row @ v, restitution=e)
            pull -= row.T * stop.force
            elements.append(stop)
        for i, numbers in enumerate(one.clutches):
            row = ca.DM(numbers).T
            clutch = OneWayClutch(f"clutch{i}", row @ v, slip_unit="m/s", force_unit="N")
            pull -= row.T * clutch.force
            elements.append(clutch)
        return Equations(flow={q: v, v: pull / ca.DM(one.masses)}, elements=elements)


KINDS = ("group", "stops", "backlash", "clutch", "wagons", "drive", "lever", "mixed")


def trial(seed: int, number: int) -> Trial:
    """A random mechanism of one to three bodies; one in sixty has a ring of frictions that are weaker in slip than at rest, and one a ring of others."""
    random = np.random.default_rng([seed, number, 7])
    kind = KINDS[number % len(KINDS)]
    if number % 64 in (5, 37):
        kind = "ring"
    n = {"group": 1, "stops": 1, "lever": 1, "wagons": 3}.get(kind, 2)

    def rub(*row: float, lever: bool = False) -> Rub:
        ahead = random.uniform(0.1, 1.5)
        back = ahead if lever or kind == "ring" or random.random() < 0.7 else random.uniform(0.1, 1.5)
        part = (random.uniform(0.4, 0.9) if number % 64 == 5 else 1.0) if kind == "ring" else random.choice([1.0, random.uniform(0.4, 1.0)])
        viscous = random.uniform(0.0, 0.5) * random.integers(2) if not lever else 0.0
        return Rub(tuple(map(float, row)), (ahead, back), (part * ahead, part * back), viscous, lever)

    def unit(i: int, size: float = 1.0) -> list[float]:
        return [size if k == i else 0.0 for k in range(n)]

    e, gap = float(random.choice([0.0, random.uniform(0.1, 0.7)])), float(random.uniform(0.02, 0.5))
    rubs: list[Rub] = []
    stops: list[Any] = []
    clutches: list[Any] = []
    if kind == "group":
        rubs = [rub(random.choice([1.0, 2.0, -1.0, 0.5])) for _ in range(random.integers(2, 4))]
        stops = [((1.0,), gap, e)] * int(random.integers(2))
    elif kind == "stops":
        rubs = [rub(1.0) for _ in range(random.integers(1, 3))]
        stops = [((1.0,), gap, e), ((-1.0,), float(random.uniform(0.02, 0.5)), e)]
    elif kind == "backlash":
        rubs = [rub(*unit(i)) for i in range(2)]
        stops = [((1.0, -1.0), gap, e), ((-1.0, 1.0), gap, e)]
    elif kind == "clutch":
        rubs = [rub(*unit(i)) for i in range(2) if random.integers(3)]
        clutches = [(1.0, -float(random.choice([1.0, 2.0])))]
        stops = [(tuple(unit(int(random.integers(2)))), gap, e)] * int(random.integers(2))
    elif kind == "wagons":
        rubs = [rub(*unit(i)) for i in range(3)]
        stops = [((1.0, -1.0, 0.0), gap * int(random.integers(2)), 0.0), ((0.0, 1.0, -1.0), gap * int(random.integers(2)), 0.0)]
    elif kind == "ring":
        rubs = [rub(1.0, 0.0), rub(0.0, 1.0), rub(1.0, -1.0)]
    elif kind == "drive":
        rubs = [rub(*unit(0)), rub(*unit(0, 2.0)), rub(*unit(1))]
        stops = [((1.0, -1.0), gap, e), ((-1.0, 1.0), gap, e), (tuple(unit(1)), float(random.uniform(0.3, 1.0)), e)]
    elif kind == "lever":
        rubs = [rub(1.0, lever=True)]
    else:
        rubs = [rub(*unit(i)) for i in range(2)] + [rub(*unit(0))]
        stops = [((1.0, 0.0), gap, e), ((1.0, -1.0), float(random.uniform(0.02, 0.5)), e)]
        clutches = [(0.0, -1.0)] * int(random.integers(2))
    drive = [
        (float(random.uniform(-1, 1) * random.integers(2)), float(random.uniform(0.5, 4.0) * (i == 0 or random.integers(2))),
         float(random.uniform(0.5, 3.0)), float(random.uniform(0, 6)))
        for i in range(n)
    ]  # fmt: skip
    v = random.normal(size=n) * random.integers(2)
    if clutches:
        v *= 0.0
    return Trial(
        kind, tuple(random.uniform(0.3, 3.0, n)), tuple(random.uniform(0, 5, n) * random.integers(2)), tuple(random.uniform(0, 0.3, n) * random.integers(2)),
        tuple(drive), tuple(rubs), tuple(stops), tuple(clutches), (0.0,) * n, tuple(map(float, v)), float(random.uniform(2.0, 6.0)),
    )  # fmt: skip


def two_motions(one: Trial) -> tuple[np.ndarray, np.ndarray] | None:
    """Two different accelerations of a mechanism at rest in which every friction obeys its law, for one of many pulls; None if there are none.

    A friction that holds has a force within its bound, one that slides its kinetic force against the way that it begins to go.
    """
    rows = np.array([rub.row for rub in one.rubs])
    inverse = np.diag(1 / np.array(one.masses))
    n = len(one.masses)
    for size, angle in itertools.product(np.linspace(0.3, 6.0, 40), np.linspace(0.0, 2 * np.pi, 25)):
        pull = size * np.array([math.cos(angle), math.sin(angle)] + [0.0] * (n - 2))[:n]
        found: list[np.ndarray] = []
        for way in itertools.product((-1, 0, 1), repeat=len(rows)):
            a = _accelerated(one, rows, inverse, pull, way)
            if a is not None and not any(np.abs(a - other).max() < 1e-6 for other in found):
                found.append(a)
        if len(found) > 1:
            return found[0], found[1]
    return None


def _accelerated(one: Trial, rows: np.ndarray, inverse: np.ndarray, pull: np.ndarray, way: tuple[int, ...]) -> np.ndarray | None:
    """The acceleration with given ways of all frictions, where it agrees with their laws."""
    from scipy.optimize import linprog

    slides = np.array([w != 0 for w in way])
    held = rows[~slides]
    force = pull - sum((w * rub.kinetic[0] * np.array(rub.row) for w, rub in zip(way, one.rubs, strict=True)), np.zeros(len(pull)))
    if held.size:
        gain = held @ inverse @ held.T
        least = np.linalg.lstsq(gain, -held @ inverse @ force, rcond=1e-11)[0]
        if np.abs(gain @ least + held @ inverse @ force).max() > 1e-9:
            return None
        bounds = [(-rub.static[0], rub.static[0]) for rub, s in zip(one.rubs, slides, strict=True) if not s]
        if linprog(np.zeros(len(held)), A_eq=gain, b_eq=gain @ least, bounds=bounds).status != 0:
            return None
        force = force + held.T @ least
    a = inverse @ force
    rates = rows @ a
    return a if all(w * r > 1e-3 for w, r in zip(way, rates, strict=True) if w) else None


def examine(seed: int, number: int) -> Iterator[tuple[str, str]]:
    """(kind, words) of what comes of one mechanism by all methods: right, left out, refused with two motions that prove it, or findings."""
    one = trial(seed, number)
    try:
        one.plant()
    except SceneError as error:
        falls = any(rub.static != rub.kinetic for rub in one.rubs)
        motions = two_motions(one) if one.kind == "ring" and falls else None
        yield ("refused", f"two motions: {motions}") if motions else (type(error).__name__, str(error))
        return
    runs, found = {}, []
    for method in METHODS:
        try:
            run = one.run(method=method)
        except SimulationError as error:
            found.append((type(error).__name__, f"{one.kind}, {method}: {error}"))
            continue
        if not np.isfinite(run.states).all():
            found.append(("nan", f"{one.kind}, {method}: a state is not finite"))
            continue
        if sum(run.steps) > 100_000:
            found.append(("slow", f"{one.kind}, {method}: {run.steps} steps"))
        runs[method] = np.concatenate([run["row.place"][-1], run["row.speed"][-1]])
    yield from found
    if not runs:
        return
    try:
        right = one.reference()
        expected, size = np.concatenate([right.q, right.v]), np.maximum(right.largest, 1e-2)
        apart = {method: float((np.abs(end - expected) / size).max()) for method, end in runs.items()}
        wrong = {method: by for method, by in apart.items() if not by <= APART}
        stirred = one.reference(STIRRED) if wrong else right
    except LeftOut as why:
        yield "left out", str(why)
        return
    moved = float((np.abs(np.concatenate([stirred.q, stirred.v]) - expected) / size).max())
    if moved > 1e-6:
        yield "left out", f"a change of {STIRRED:g} of the forces moves the end by {moved:.2g}"
        return
    for method, by in wrong.items():
        yield "wrong", f"{one.kind}, {method}: ends {by:.2g} from the reference: {runs[method]}, right {expected}"
    if not (found or wrong):
        yield "right", ""


def simpler(one: Trial, **changes: Any) -> Trial:
    """The trial with other numbers, to look for what makes it wrong."""
    return replace(one, **changes)
