"""Does a simulation of a brake that shares nothing with the toolbox give the same stops?

The plant is `brake_stops.c`, compiled here; the five control laws are written again below, from their formulas. Nothing of `toolbox`, `models` or
`controllers` takes part. What agrees with it is the event location, the compiled laws, their sampling and delays, and the actuator.

    python -m studies brake_check        (needs a C compiler, `cc`; two minutes: twelve cells of the table of `python -m studies brakes`, twice)
"""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

INERTIA, RADIUS, MASS, STIFFNESS, DAMPING = 36.0, 0.12, 10.0, 1e6, 200.0
EXPECTED, LOWEST, PUSH, RATE = 0.4, 100.0, 8000.0, 20_000.0
FINE = 1e-5
"""Step of the integration [s]."""


@dataclass(frozen=True)
class Own:
    """A brake in numbers of its own: friction as a table, actuator, roughness of the disc, drive torque and the noise of speed and torque."""

    speeds: tuple[float, ...]
    coefficients: tuple[float, ...]
    static: float
    lag: float = 0.01
    delay: int = 2
    rate: float = math.inf
    highest: float = PUSH
    rough: float = 4.0
    frequency: float = 40.0
    drive: float = 0.0
    noise: tuple[float, float] = (0.0, 0.0)
    seed: int = 1

    def borders(self) -> tuple[np.ndarray, np.ndarray]:
        """Disc speeds at which the border of groan changes, and c / (2 s) from each of them on."""
        fall = [
            (b - a) / (u - w) for a, b, u, w in zip(self.coefficients, self.coefficients[1:], self.speeds, self.speeds[1:], strict=False)
        ]
        return np.array(self.speeds) / RADIUS, np.array([DAMPING / (2 * s) if s > 0 else 1e9 for s in [*fall, 0.0]])


@dataclass
class Halt:
    """What became of a stop: releases above the slowest speed that counts, time [s] and angle [rad] to standstill (inf for none), forces asked for [N]."""

    releases: int
    time: float
    angle: float
    forces: np.ndarray = field(repr=False)


@cache
def compiled() -> Any:
    """The C of the plant; raises RuntimeError without a compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        raise RuntimeError("A C compiler is needed, but there is no `cc`.")
    place = Path(tempfile.mkdtemp()) / "brake_stops.so"
    source = Path(__file__).with_name("brake_stops.c")
    subprocess.run([compiler, "-O2", "-shared", "-fPIC", "-o", str(place), str(source), "-lm"], check=True)
    library = ctypes.CDLL(str(place))
    library.advance.restype = ctypes.c_double
    return library


def halted(
    brake: Own, law: Callable[[float, float, float], float], speed: float, duration: float, period: int = 1, slowest: float = 0.1
) -> Halt:
    """One stop from a disc speed [rad/s]; `law(time, speed, torque)` is asked every `period` milliseconds."""
    library, pointer = compiled(), ctypes.c_void_p
    numbers = np.array([INERTIA, RADIUS, MASS, STIFFNESS, DAMPING, brake.static, brake.lag, min(brake.rate, 1e300), brake.highest,
                        brake.rough, brake.frequency, 0.0, brake.drive])  # fmt: skip
    v, mu = np.array(brake.speeds), np.array(brake.coefficients)
    state, out = np.array([speed, 0.0, 0.0, 0.0]), np.array([0.0, 1.0, -1.0, 0.0, 0.0])
    random, torque, acting, asked = np.random.default_rng(brake.seed), 0.0, 0.0, []
    waiting: list[tuple[int, float]] = []
    for k in range(round(duration * 1000)):
        if k % period == 0:
            seen = (state[0] + brake.noise[0] * random.standard_normal(), torque + brake.noise[1] * random.standard_normal())
            asked.append(law(1e-3 * k, *seen))
            waiting.append((k + brake.delay, asked[-1]))
        while waiting and waiting[0][0] <= k:
            acting = waiting.pop(0)[1]
        arrays = [pointer(each.ctypes.data) for each in (numbers, v, mu, state, out)]
        torque = library.advance(
            arrays[0], arrays[1], arrays[2], len(v), ctypes.c_double(acting), ctypes.c_double(FINE), round(1e-3 / FINE), ctypes.c_double(slowest), *arrays[3:]
        )  # fmt: skip
        if out[2] >= 0.0:
            break
    stands = out[2] if out[2] >= 0.0 else math.inf
    return Halt(int(out[4]), float(stands), float(out[3]), np.array(asked))


# --- the laws again


def need(deceleration: float, mu: float = EXPECTED) -> float:
    """Force of one pad for a deceleration [rad/s2]."""
    return INERTIA * deceleration / (2 * RADIUS * mu)


@dataclass
class Law:
    """What all laws share: the border in pieces, the part of it that is allowed (None: any), the limits, the last command."""

    deceleration: float
    margin: float | None = None
    borders: tuple[Any, Any] | None = None
    growth: float = 0.0
    highest: float = PUSH
    period: float = 1e-3
    last: float = 0.0
    plan: float | None = None

    def border(self, speed: float) -> float:
        """Force above which the pad groans at a disc speed."""
        assert self.borders is not None
        places, forces = self.borders
        return float(forces[max(i for i in range(len(places)) if places[i] <= max(speed, 0.0))]) * math.exp(self.growth * max(speed, 0.0))

    def cut(self, wanted: float, speed: float) -> float:
        """The command within its limits."""
        if speed <= 0.0:
            return self.last
        if self.margin is not None:
            wanted = min(wanted, self.margin * self.border(speed))
        wanted = min(max(wanted, LOWEST), self.highest)
        self.last = min(max(wanted, self.last - RATE * self.period), self.last + RATE * self.period)
        return self.last

    def follow(self, speed: float) -> float:
        """The planned speed now."""
        now = speed if self.plan is None else self.plan
        self.plan = max(now - self.deceleration * self.period, 0.0)
        return now


class Constant(Law):
    """The constant force."""

    def __call__(self, t: float, speed: float, torque: float) -> float:
        return self.cut(need(self.deceleration), speed)


@dataclass
class Feedback(Law):
    """PI on the deceleration."""

    proportional: float = 0.1
    integral: float = 1.0

    def __call__(self, t: float, speed: float, torque: float) -> float:
        excess = speed - self.follow(speed)
        asked = self.deceleration + self.proportional * (self.deceleration - torque / INERTIA) + self.integral * excess
        return self.cut(need(asked), speed)


@dataclass
class Sliding(Law):
    """Sliding mode with the friction read off torque and force."""

    surface: float = 1.0
    reaching: float = 0.3
    width: float = 0.2
    filter_time: float = 0.1
    off: float = 0.0
    angle: float = 0.0

    def __call__(self, t: float, speed: float, torque: float) -> float:
        e = speed - self.follow(speed)
        if self.last > 0.0:
            seen = torque / (2 * RADIUS * max(self.last, LOWEST)) - EXPECTED
            seen = min(max(seen, -EXPECTED / 2), EXPECTED)
            self.off += self.period / (self.period + self.filter_time) * (seen - self.off)
        else:
            self.off = 0.0
        s = (e + self.surface * self.angle) / max(self.width, self.reaching * self.period)
        self.angle += self.period * e
        return self.cut(need(self.deceleration + self.surface * e + self.reaching * min(max(s, -1.0), 1.0), EXPECTED + self.off), speed)


@dataclass
class Planned(Law):
    """The predictive law: the same program, set up by running its recursion for each unknown, and solved by OSQP."""

    horizon: int = 60
    lag: float = 0.01
    begin: float | None = None
    count: int = 0
    force: float = 0.0
    friction: float = EXPECTED
    excess: float = 0.0
    seen: Any = None

    def predict(self, moves: np.ndarray, speed: float) -> tuple[np.ndarray, np.ndarray]:
        """Forces and speeds along the horizon under commands."""
        keep, n, w = math.exp(-self.period / self.lag), self.force, speed
        forces, speeds = [], []
        for u in moves:
            n = keep * n + (1 - keep) * u
            w -= 2 * RADIUS * self.friction * self.period / INERTIA * n
            forces.append(n)
            speeds.append(w)
        return np.array(forces), np.array(speeds)

    def __call__(self, t: float, speed: float, torque: float) -> float:
        import osqp
        from scipy import sparse

        H, h, N = self.horizon, self.period, self.horizon
        self.begin = speed if self.begin is None else self.begin
        wish = np.maximum(self.begin - self.deceleration * h * (self.count + np.arange(H + 1)), 0.0)
        command = self.last
        if speed > 0.0:
            if self.force >= LOWEST / 2:
                seen = min(max(torque / (2 * RADIUS * self.force), EXPECTED / 2), 2 * EXPECTED)
                self.friction += h / (h + 0.1) * (seen - self.friction)
            force_0, speed_0 = self.predict(np.zeros(H), speed)
            rows = [self.predict(row, speed) for row in 1000.0 * np.eye(H)]
            G, S = (np.array([row[i] - base for row in rows]).T for i, base in ((0, force_0), (1, speed_0)))
            C = h * np.tril(np.ones((H, H)))
            total = self.excess + h * (speed - wish[0])
            D = np.eye(N) - np.eye(N, k=-1)
            weighted = [(S / 0.2, (speed_0 - wish[1:]) / 0.2), (C @ S / 0.05, (total + C @ (speed_0 - wish[1:])) / 0.05)]
            weighted.append((D * 1000.0 / 100.0, -np.append(self.last, np.zeros(N - 1)) / 100.0))
            P = sum(A.T @ A for A, _ in weighted)
            q = sum(A.T @ b for A, b in weighted)
            A, low, high = [np.eye(N)], [np.full(N, LOWEST)], [np.full(N, self.highest)]
            rising = self.last + RATE * h * np.arange(1, N + 1)
            low[0] = np.minimum(low[0], rising)
            A.append(D)
            low.append(np.full(N, -RATE * h) + np.append(self.last, np.zeros(N - 1)))
            high.append(np.full(N, RATE * h) + np.append(self.last, np.zeros(N - 1)))
            scale = [1e-3, 1e-3]
            if self.margin is not None:
                around = np.maximum(wish[1:] if self.seen is None else np.append(self.seen[1:], self.seen[-1]), 0.0)
                border = self.margin * np.array([self.border(w) for w in around])
                P = np.block([[P, np.zeros((N, 1))], [np.zeros((1, N)), np.array([[1e5]])]])
                q = np.append(q, 1e5)
                A = [np.hstack([each, np.zeros((N, 1))]) for each in A]
                A.append(np.hstack([(G - (self.growth * border)[:, None] * S) / 1000.0, -np.ones((N, 1))]))
                A.append(np.append(np.zeros(N), 1.0)[None, :])
                low += [np.full(N, -1e9), np.zeros(1)]
                high += [border + self.growth * border * (speed_0 - around) - force_0, np.full(1, 1e9)]
                scale += [1e-3, 1.0]
            solver = osqp.OSQP()
            least, most = (np.concatenate([s * each for s, each in zip(scale, side, strict=True)]) for side in (low, high))
            solver.setup(sparse.triu(sparse.csc_matrix(P), format="csc"), q, sparse.csc_matrix(np.vstack(A)), least, most, verbose=False, eps_abs=1e-7,
                         eps_rel=1e-7, max_iter=50_000, polishing=True)  # fmt: skip
            found = solver.solve(raise_error=True).x[:N]
            self.seen = speed_0 + S @ found
            command = min(max(1000.0 * float(found[0]), LOWEST), self.highest)
            command = min(max(command, self.last - RATE * h), self.last + RATE * h)
        self.excess += h * (speed - wish[0])
        self.force += (1 - math.exp(-h / self.lag)) * (command - self.force)
        self.last = command
        self.count += 1
        return command
