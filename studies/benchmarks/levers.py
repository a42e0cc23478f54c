"""Random machines whose friction has a lever that vanishes, as a crank at its dead centres, against an integration that goes from event to event.

    (J + m p^2) w' + m p p' w^2 = T(t) - k a - c w + p F          slip p(a) w, p a sum of a constant and two harmonics

The reference shares no code with the event loop: scipy's DOP853 with a relative tolerance of 1e-11 between dead centres, turning points and rests, and a root
of the force that is needed for the end of a rest. Lengths, times and masses are scaled by up to ten to the power of +-6.

    python -m studies fuzz --section levers [--structures 300] [--seed 1] [--first N]
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from models import Coulomb
from toolbox import (
    Component,
    DryFriction,
    Equations,
    FrictionLaw,
    Quantity,
    SceneError,
    SimulationError,
    compose,
    energy_audit,
    quantity,
    simulate,
    state,
)
from toolbox.inputs import sine
from toolbox.modelling import Quantities

METHODS = ("event", "explicit", "taylor", "stiff")
ACCURACY = 1e-9
ROUND_OFF = 1e-20
"""Energy of a machine at rest, in its own units, in which there is nothing to add up."""
APART = 1e-5
"""Distance from the reference, in parts of the largest value of each state, from which on a run is wrong: both are as exact as 1e-8 without chaos."""


@dataclass(frozen=True)
class Lever(Component):
    """A shaft that moves a body along a guide by a lever which depends on its angle."""

    inertia: Quantity = quantity(1.0, "kg m2", "inertia of the shaft", above=0)
    mass: Quantity = quantity(0.0, "kg", "mass of the body on the guide", at_least=0)
    stiffness: Quantity = quantity(0.0, "N m/rad", "torsion spring", at_least=0)
    damping: Quantity = quantity(0.0, "N m s/rad", "viscous drag", at_least=0)
    harmonics: Quantities = quantity((0.0, 1.0, 0.0, 0.0, 0.0), "m", "lever: constant, then cosine and sine of the angle and of its double")
    friction: FrictionLaw = Coulomb(static=0.1, kinetic=0.1)

    def equations(self, signal):
        a, w = state("shaft.angle", "rad"), state("shaft.speed", "rad/s")
        torque = signal("shaft.torque", "N m", default=0.0)
        h = self.harmonics
        p = h[0] + h[1] * ca.cos(a) + h[2] * ca.sin(a) + h[3] * ca.cos(2 * a) + h[4] * ca.sin(2 * a)
        guide = DryFriction("guide", p * w, self.friction)
        inertia = self.inertia + self.mass * p**2
        pull = torque - self.stiffness * a - self.damping * w - self.mass * p * ca.jacobian(p, a) * w**2
        return Equations(
            flow={a: w, w: (pull + p * guide.force) / inertia},
            elements=[guide],
            stored=(inertia * w**2 + self.stiffness * a**2) / 2,
            losses={"guide": -guide.force * p * w, "drag": self.damping * w**2},
            supplies={"torque": torque * w},
        )


@dataclass(frozen=True)
class Trial:
    """Numbers of a machine in its own units of length, time and mass, the units [m, s, kg], and where it starts."""

    harmonics: tuple[float, ...]
    inertia: float
    mass: float
    stiffness: float
    damping: float
    static: float
    kinetic: float
    torque: tuple[float, float, float, float]  # mean, amplitude, frequency [Hz], phase
    start: tuple[float, float]
    duration: float
    units: tuple[float, float, float]
    method: str

    def run(self, **changes: Any) -> Any:
        """The run by the toolbox."""
        length, time, mass = self.units
        energy = mass * length**2 / time**2
        machine = Lever(
            self.inertia * mass * length**2, self.mass * mass, self.stiffness * energy, self.damping * energy * time,
            tuple(h * length for h in self.harmonics), Coulomb(self.static * energy / length, self.kinetic * energy / length),
        )  # fmt: skip
        mean, amplitude, frequency, phase = self.torque
        given = {
            "start": {"shaft.angle": self.start[0], "shaft.speed": self.start[1] / time},
            "inputs": {"shaft.torque": sine(mean * energy, amplitude * energy, frequency / time, phase)},
            "method": self.method,
            "accuracy": ACCURACY,
        }
        return simulate(compose(machine), self.duration * time, **(given | changes))


def trial(seed: int, number: int) -> Trial:
    """A random machine. Some start at rest at a dead centre, at a double one, or are not driven."""
    random = np.random.default_rng([seed, number])
    kind = random.integers(6)
    harmonics = np.zeros(5)
    if kind < 2:  # scotch yoke: its angle is zero at a dead centre, or a quarter turn from it
        harmonics[1 + kind] = 1.0
    elif kind == 2:  # crank
        harmonics[2], harmonics[4] = -1.0, -random.uniform(0.05, 0.3)
    elif kind == 3:  # touches zero, and goes back
        harmonics[0], harmonics[1] = 1.0, -1.0
    else:
        harmonics[:] = random.normal(size=5) * (0.3, 1.0, 1.0, 0.4, 0.4)
    harmonics *= random.uniform(0.3, 2.0)
    kinetic = random.uniform(0.05, 0.6)
    mean, amplitude = random.uniform(-0.5, 0.5) * random.integers(2), random.uniform(0.1, 1.5) * random.integers(4) / 3
    start = (random.choice([0.0, math.pi / 2, random.uniform(-3, 3)]), random.choice([0.0, random.normal(), 3 * random.normal()]))
    scaled = random.integers(4) == 0
    return Trial(
        tuple(harmonics), random.uniform(0.3, 3.0), random.uniform(0, 1) * random.integers(2), random.uniform(0, 1) * random.integers(2),
        random.uniform(0, 0.2) * random.integers(2), kinetic * random.choice([1.0, random.uniform(1.0, 2.0)]), kinetic,
        (mean, amplitude, random.uniform(0.05, 0.5), random.uniform(0, 6)), (float(start[0]), float(start[1])), random.uniform(2.0, 15.0),
        tuple(10.0 ** random.choice([-6, 0, 6], size=3)) if scaled else (1.0, 1.0, 1.0), METHODS[number % len(METHODS)],
    )  # fmt: skip


class LeftOut(Exception):
    """The reference cannot tell what the machine does, and why."""


class Reference:
    """A trial from event to event, in its own units; `events` are (time, mode after it), modes -1, 0 and 1 of the slip, `end` is (angle, speed)."""

    def __init__(self, one: Trial):
        self.one, self.events = one, list[tuple[float, int]]()
        self.largest = np.zeros(2)
        self.end = self._through()

    def lever(self, a: float) -> float:
        """p(a)."""
        h = self.one.harmonics
        return h[0] + h[1] * math.cos(a) + h[2] * math.sin(a) + h[3] * math.cos(2 * a) + h[4] * math.sin(2 * a)

    def slope(self, a: float) -> float:
        """p'(a)."""
        h = self.one.harmonics
        return -h[1] * math.sin(a) + h[2] * math.cos(a) - 2 * h[3] * math.sin(2 * a) + 2 * h[4] * math.cos(2 * a)

    def pull(self, t: float, a: float) -> float:
        """What the shaft is driven by at rest."""
        mean, amplitude, frequency, phase = self.one.torque
        return mean + amplitude * math.sin(2 * math.pi * frequency * t + phase) - self.one.stiffness * a

    def _ahead(self, t: float, a: float, way: int) -> int:
        """The sign of the lever a little further on."""
        for step in (1e-7, 1e-5, 1e-3):
            if abs(p := self.lever(a + way * step)) > 1e-12 * max(map(abs, self.one.harmonics)):
                return 1 if p > 0 else -1
        raise LeftOut("the lever stays zero")

    def _through(self) -> tuple[float, float]:
        one = self.one
        t, (a, w), mode, first = 0.0, one.start, None, True
        for _ in range(400):
            if t >= one.duration:
                return a, w
            if w == 0.0:
                room = one.static * abs(self.lever(a)) - abs(self.pull(t, a))
                if not first and abs(room) < 1e-5 * (one.static + abs(self.pull(t, a))):
                    raise LeftOut("comes to rest at its limit")
                if room >= 0.0 and (room > 0.0 or self.pull(t, a) == 0.0 or first):
                    leaves = self._leaves(t, a)
                    if mode not in (0, None):
                        self.events.append((t, 0))
                    mode = 0
                    if leaves is None:
                        return a, w
                    t = leaves
                    way = self._way(t, a)
                else:
                    way = 1 if self.pull(t, a) > 0 else -1
            else:
                way = 1 if w > 0 else -1
            side = self._ahead(t, a, way)
            if mode not in (side * way, None):
                self.events.append((t, side * way))
            mode, first = side * way, False
            t, a, w = self._slide(t, a, w, way, side)
        raise LeftOut("too many events")

    def _way(self, t: float, a: float) -> int:
        for step in (1e-9, 1e-7, 1e-5, 1e-3):
            if (pull := self.pull(t + step * self.one.duration, a)) != 0.0:
                return 1 if pull > 0 else -1
        raise LeftOut("nothing pulls")

    def _leaves(self, t: float, a: float) -> float | None:
        """When the pull exceeds what friction holds by its lever, None for never."""
        from scipy.optimize import brentq

        bound = self.one.static * abs(self.lever(a))
        if bound == 0.0 and self.pull(t, a) == 0.0 and any(self.pull(s, a) != 0.0 for s in np.linspace(t, self.one.duration, 9)):
            return t
        grid = np.linspace(t, self.one.duration, 4001)
        room = np.array([bound - abs(self.pull(s, a)) for s in grid])
        if (np.abs(room[1:-1][(room[1:-1] < room[:-2]) & (room[1:-1] < room[2:])]) < 1e-4 * (bound + 0.1)).any():
            raise LeftOut("almost breaks away")
        out = np.flatnonzero(room < 0.0)
        if not out.size:
            return None
        if out[0] == 0:
            return t
        return float(brentq(lambda s: bound - abs(self.pull(s, a)), grid[out[0] - 1], grid[out[0]], xtol=1e-14))

    def _slide(self, t: float, a: float, w: float, way: int, side: int) -> tuple[float, float, float]:
        """From t on with the lever on one side and the shaft turning one way, to the dead centre or the turning point; (time, angle, speed) there."""
        from scipy.integrate import solve_ivp

        one = self.one

        def field(time: float, y: np.ndarray) -> list[float]:
            p = self.lever(y[0])
            force = -one.kinetic * side * way
            pull = self.pull(time, y[0]) - one.damping * y[1] - one.mass * p * self.slope(y[0]) * y[1] ** 2
            return [y[1], (pull + p * force) / (one.inertia + one.mass * p * p)]

        def dead(time: float, y: np.ndarray) -> float:
            return side * self.lever(y[0])

        def turns(time: float, y: np.ndarray) -> float:
            return way * y[1]

        for event in (dead, turns):
            event.terminal, event.direction = True, -1  # type: ignore[attr-defined]
        found = solve_ivp(
            field, (t, one.duration), [a, w], method="DOP853", rtol=1e-11, atol=1e-13, events=(dead, turns), max_step=one.duration / 400
        )
        self.largest = np.maximum(self.largest, np.abs(found.y).max(axis=1))
        a, w = (float(value) for value in found.y[:, -1])
        if found.status == 1:
            if len(found.t_events[1]):
                if abs(self.lever(a)) < 1e-5 * max(map(abs, one.harmonics)):
                    raise LeftOut("turns at a dead centre")
                w = 0.0
            elif abs(w) < 1e-4 * self.largest[1]:
                raise LeftOut("creeps over a dead centre")
            if float(found.t[-1]) - t < 1e-9 * one.duration:
                raise LeftOut("two events at one instant")
        return float(found.t[-1]), a, w


def examine(seed: int, number: int) -> Iterator[tuple[str, str]]:
    """(kind, words) of what comes of one machine: right, left out, or a finding."""
    one = trial(seed, number)
    try:
        reference = Reference(one)
    except LeftOut as why:
        reference = None
        left = str(why)
    try:
        run = one.run()
    except (SceneError, SimulationError) as error:
        yield type(error).__name__, str(error)
        return
    if not np.isfinite(run.states).all():
        yield "nan", "a state is not finite"
        return
    if sum(run.steps) > 50_000:
        yield "slow", f"{run.steps} steps"
    audit, (length, time, mass) = energy_audit(run), one.units
    if (
        audit.turnover > ROUND_OFF * mass * length**2 / time**2
        and audit.relative > 1e-5
        and energy_audit(one.run(accuracy=ACCURACY / 100)).relative > 0.1 * audit.relative
    ):
        yield "energy", f"audit closes to {audit.relative:.2g}"
    if reference is None:
        yield "left out", left
        return
    found = np.array([run["shaft.angle"][-1], run["shaft.speed"][-1] * time])
    size = np.maximum(np.maximum(reference.largest, np.abs(found)), (1.0, 1.0 / one.duration))
    apart = float((np.abs(found - np.array(reference.end)) / size).max())
    events = [(event.time / time, {"slip+": 1, "slip-": -1, "stick": 0}[event.after]) for event in run.events]
    events = [each for each in events if each[0] > 1e-6 * one.duration]
    expected = [each for each in reference.events if each[0] > 1e-6 * one.duration]
    if [mode for _, mode in events] != [mode for _, mode in expected]:
        yield "wrong", f"switches {events[:6]}, right {expected[:6]}"
    elif apart > APART:
        yield "wrong", f"ends {apart:.2g} from the reference: {found}, right {reference.end}"
    else:
        yield "right", ""
