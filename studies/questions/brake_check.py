"""Does a simulation of a brake that shares nothing with the toolbox give the same stops?

The plant is `brake_stops.c`, compiled here; the five control laws are written again below, from their formulas. Nothing of `toolbox`, `models` or
`controllers` takes part. What agrees with it is the event location, the compiled laws, their sampling and delays, and the actuator.

Twelve cells of the table of `python -m studies brakes`: stopping distances at 2.5 m/s2 of four laws with friction 20 % lower, nominal and 20 % higher. The
noise is another one, from numpy; the longest of two seeds is printed. Both agree within 0.02 m.

Five stops from 30 km/h at 2.5 m/s2 on a measured table of six points, without noise:

    measured table, toolbox / C     peak command [N]   largest difference [N]    releases        distance [m]
    ---------------------------------------------------------------------------------------------------------
    constant force                       3247 / 3247                      0.0       7 / 7       14.56 / 14.56
    constant force, eased                3247 / 3247                      0.0       0 / 0       14.98 / 14.98
    PI, eased                            3542 / 3542                      0.0       0 / 0       14.51 / 14.51
    sliding mode, eased                  4079 / 4079                      0.0       0 / 0       14.34 / 14.34
    MPC                                  6201 / 6202                      8.3       0 / 0       14.17 / 14.17

A release on a slope without dither: number of releases, and speed of the car [m/s] at the last one, over the time of the release. Both agree in every digit:

    release on a slope                    0.25 s           0.5 s             1 s             2 s             4 s
    ------------------------------------------------------------------------------------------------------------
    in C                                15, 0.01        21, 0.05        39, 0.15        67, 0.26       103, 0.41
    toolbox                             15, 0.01        21, 0.05        39, 0.15        67, 0.26       103, 0.41

    python -m studies brake_check        (needs a C compiler, `cc`; a minute)
"""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

INERTIA, RADIUS, MASS, STIFFNESS, DAMPING = 36.0, 0.12, 10.0, 1e6, 200.0
LOWEST, PUSH, RATE = 100.0, 8000.0, 20_000.0
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


def need(deceleration: float, mu: float) -> float:
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
    expected: float = 0.4

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
        return self.cut(need(self.deceleration, self.expected), speed)


@dataclass
class Feedback(Law):
    """PI on the deceleration."""

    proportional: float = 0.1
    integral: float = 1.0

    def __call__(self, t: float, speed: float, torque: float) -> float:
        excess = speed - self.follow(speed)
        asked = self.deceleration + self.proportional * (self.deceleration - torque / INERTIA) + self.integral * excess
        return self.cut(need(asked, self.expected), speed)


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
            seen = torque / (2 * RADIUS * max(self.last, LOWEST)) - self.expected
            seen = min(max(seen, -self.expected / 2), self.expected)
            self.off += self.period / (self.period + self.filter_time) * (seen - self.off)
        else:
            self.off = 0.0
        s = (e + self.surface * self.angle) / max(self.width, self.reaching * self.period)
        self.angle += self.period * e
        return self.cut(
            need(self.deceleration + self.surface * e + self.reaching * min(max(s, -1.0), 1.0), self.expected + self.off), speed
        )


@dataclass
class Planned(Law):
    """The predictive law: the same program, set up by running its recursion for each unknown, and solved by OSQP."""

    horizon: int = 60
    lag: float = 0.01
    begin: float | None = None
    count: int = 0
    force: float = 0.0
    friction: float = math.nan
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
        self.friction = self.expected if math.isnan(self.friction) else self.friction
        wish = np.maximum(self.begin - self.deceleration * h * (self.count + np.arange(H + 1)), 0.0)
        command = self.last
        if speed > 0.0:
            if self.force >= LOWEST / 2:
                seen = min(max(torque / (2 * RADIUS * self.force), self.expected / 2), 2 * self.expected)
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
                slope = np.where(border < 3 * self.highest, self.growth * border, 0.0)  # far above the highest force a border binds nothing
                border = np.minimum(border, 3 * self.highest)
                P = np.block([[P, np.zeros((N, 1))], [np.zeros((1, N)), np.array([[1e5]])]])
                q = np.append(q, 1e5)
                A = [np.hstack([each, np.zeros((N, 1))]) for each in A]
                A.append(np.hstack([(G - slope[:, None] * S) / 1000.0, -np.ones((N, 1))]))
                A.append(np.append(np.zeros(N), 1.0)[None, :])
                low += [np.full(N, -1e9), np.zeros(1)]
                high += [border + slope * (speed_0 - around) - force_0, np.full(1, 1e9)]
                scale += [1e-3, 1.0]
            solver = osqp.OSQP()
            least, most = (np.concatenate([s * each for s, each in zip(scale, side, strict=True)]) for side in (low, high))
            solver.setup(sparse.triu(sparse.csc_matrix(P), format="csc"), q, sparse.csc_matrix(np.vstack(A)), least, most, verbose=False, eps_abs=1e-5,
                         eps_rel=1e-5, max_iter=20_000, polishing=True)  # fmt: skip
            found = solver.solve(raise_error=False).x[:N]
            self.seen = speed_0 + S @ found
            command = min(max(1000.0 * float(found[0]), LOWEST), self.highest)
            command = min(max(command, self.last - RATE * h), self.last + RATE * h)
        self.excess += h * (speed - wish[0])
        self.force += (1 - math.exp(-h / self.lag)) * (command - self.force)
        self.last = command
        self.count += 1
        return command


# --- twelve cells

WHEEL, START, WANTED = 0.3, 30.0 / 3.6, 2.5
SEEDS = (7, 8)


def exponential(factor: float) -> Own:
    """The brake of the table with both coefficients of friction times a factor: mu = 0.35 + 0.1 exp(-5 v), in 300 rows."""
    speeds = np.append(0.0, np.geomspace(1e-3, 4.0, 299))
    coefficients = factor * (0.35 + 0.1 * np.exp(-5.0 * speeds))
    return Own(tuple(speeds), tuple(coefficients), factor * 0.45, rate=RATE, noise=(0.005, 2.0))


def law_of(label: str) -> tuple[Law, int]:
    """The law of a row, designed on the declared friction, and its period in milliseconds."""
    eased: dict[str, Any] = {"margin": 0.8, "borders": (np.zeros(1), np.array([200.0])), "growth": 0.6, "expected": 0.35}
    wanted = WANTED / WHEEL
    laws: dict[str, tuple[Law, int]] = {
        "constant force": (Constant(wanted, expected=0.35), 1),
        "PI, eased": (Feedback(wanted, **eased), 1),
        "sliding mode, eased": (Sliding(wanted, **eased), 1),
        "MPC": (Planned(wanted, period=0.03, **eased), 30),
    }
    return laws[label]


ROWS = ("MPC", "constant force", "PI, eased", "sliding mode, eased")


def distance(label: str, factor: float) -> float:
    """Longest stopping distance [m] from 30 km/h at 2.5 m/s2 over the seeds."""
    found = []
    for seed in SEEDS:
        law, period = law_of(label)
        found.append(WHEEL * halted(replace(exponential(factor), seed=seed), law, START / WHEEL, 13.0, period).angle)
    return max(found)


# --- five stops on a measured table

SPEEDS, COEFFICIENTS = (0.0, 0.05, 0.15, 0.4, 1.0, 3.0), (0.45, 0.444, 0.43, 0.405, 0.39, 0.385)
"""Slip speeds [m/s] and coefficients of friction of the table; the pad sticks up to the first coefficient."""
EXPECTED = 0.385
"""Friction that the controllers of the five stops expect."""
MEASURED = ("constant force", "constant force, eased", "PI, eased", "sliding mode, eased", "MPC")


def stopped_in_c(label: str) -> Halt:
    """The stop of a controller on the measured table, without noise, simulated in C."""
    brake = Own(SPEEDS, COEFFICIENTS, COEFFICIENTS[0], rate=RATE)
    eased: dict[str, Any] = {"margin": 0.8, "borders": brake.borders(), "expected": EXPECTED}
    wanted = WANTED / WHEEL
    laws: dict[str, tuple[Law, int]] = {
        "constant force": (Constant(wanted, expected=EXPECTED), 1),
        "constant force, eased": (Constant(wanted, **eased), 1),
        "PI, eased": (Feedback(wanted, **eased), 1),
        "sliding mode, eased": (Sliding(wanted, **eased), 1),
        "MPC": (Planned(wanted, period=0.03, **eased), 30),
    }
    law, period = laws[label]
    return halted(brake, law, START / WHEEL, 7.0, period)


def stopped(label: str) -> Halt:
    """The same stop, simulated with the toolbox."""
    from controllers import BrakeForce, BrakeMPC, BrakePI, BrakeSlidingMode
    from models import BrakeActuator, DiscBrake, Tabulated
    from studies.questions import brakes
    from toolbox import Sampled, compose, simulate
    from toolbox.inputs import sine

    common: dict[str, Any] = {"deceleration": WANTED / WHEEL, "friction": EXPECTED, "highest_force": PUSH}
    laws: dict[str, Any] = {
        "constant force": BrakeForce(**common),
        "constant force, eased": BrakeForce(margin=0.8, **common),
        "PI, eased": BrakePI(margin=0.8, **brakes.SOFT_PI, **common),
        "sliding mode, eased": BrakeSlidingMode(margin=0.8, **brakes.SOFT_SLIDING, **common),
        "MPC": BrakeMPC(margin=0.8, **common),
    }
    period = 30e-3 if label == "MPC" else 1e-3
    friction = Tabulated(speeds=SPEEDS, coefficients=COEFFICIENTS, static=COEFFICIENTS[0])
    run = simulate(
        compose(DiscBrake(force=0.0, friction=friction), BrakeActuator()), 7.0, start={"disc.speed": START / WHEEL},
        inputs={"pad.attachment": sine(0.0, 4.0, 40.0)}, controller=Sampled(laws[label], period, delay=0.002), accuracy=1e-8,
    )  # fmt: skip
    times = np.arange(0.0, run.end, 1e-3)
    speed = run.at(times)["disc.speed"]
    end = int(np.flatnonzero(speed <= 0.0)[0])
    turning = np.interp(brakes.releases_of(run, times[end]), times, speed)
    angle = float((speed[:end] + np.maximum(speed[1 : end + 1], 0.0)).sum()) * 0.5e-3
    commands = run.at(np.arange(0.0, times[end], period) + 0.0025)["actuator.command"]
    return Halt(int((turning > 0.1).sum()), float(times[end]), angle, commands)


def apart(ours: Halt, other: Halt) -> float:
    """Largest difference [N] of the commanded forces, without the last 60 ms before standstill."""
    count = min(len(ours.forces), len(other.forces))
    step = max(ours.time, other.time) / max(len(ours.forces), len(other.forces))
    count -= math.ceil(0.06 / step)
    return float(np.abs(ours.forces[:count] - other.forces[:count]).max())


def measured_table() -> str:
    """Peak force, releases and stopping distance of the five stops, with the toolbox and in C."""
    head = f"{'measured table, toolbox / C':<28}{'peak command [N]':>20}{'largest difference [N]':>25}{'releases':>12}{'distance [m]':>20}"
    lines = [head, "-" * len(head)]
    for label in MEASURED:
        ours, other = stopped(label), stopped_in_c(label)
        lines.append(
            f"{label:<28}{f'{ours.forces.max():.0f} / {other.forces.max():.0f}':>20}{apart(ours, other):>25.1f}"
            f"{f'{ours.releases} / {other.releases}':>12}{f'{WHEEL * ours.angle:.2f} / {WHEEL * other.angle:.2f}':>20}"
        )
    return "\n".join(lines)


# --- release on a slope

SLOPE, HELD = 100.0, 1100.0
"""Torque [N m] of the slope on one wheel, and force [N] of one pad that holds the car there."""


def released(duration: float) -> tuple[int, float]:
    """(releases, speed of the car [m/s] at the last one) while the brake is released on the slope in a time [s], simulated in C without a controller."""
    library, pointer = compiled(), ctypes.c_void_p
    brake = exponential(1.0)
    numbers = np.array(
        [INERTIA, RADIUS, MASS, STIFFNESS, DAMPING, brake.static, brake.lag, RATE, PUSH, brake.rough, brake.frequency, 0.0, SLOPE]
    )
    v, mu = np.array(brake.speeds), np.array(brake.coefficients)
    state, out = np.zeros(4), np.array([0.0, 1.0, -1.0, 0.0, 0.0])
    arrays = [pointer(each.ctypes.data) for each in (numbers, v, mu, state, out)]
    count, early, speed = 0, 0, 0.0
    fine = 1e-4
    for k in range(round((1.0 + duration) / fine)):
        part = min(max((fine * (k + 0.5) - 0.5) / duration, 0.0), 1.0)
        force = HELD * (1.0 - 0.98 * part)
        library.advance(arrays[0], arrays[1], arrays[2], len(v), ctypes.c_double(force), ctypes.c_double(FINE), round(fine / FINE),
                        ctypes.c_double(-1.0), *arrays[3:])  # fmt: skip
        if k * fine < 0.05:
            early = int(out[4])
        elif out[4] > early + count:
            count, speed = int(out[4]) - early, WHEEL * float(state[0])
    return count, speed


def release_table() -> str:
    """Releases of the pad, and the speed of the car at the last one, on the slope: in C and with the toolbox."""
    from studies.questions import brakes

    head = f"{'release on a slope':<28}" + "".join(f"{f'{time:g} s':>16}" for time in brakes.RELEASES)
    kinds: dict[str, Callable[[float], tuple[int, float]]] = {"in C": released, "toolbox": lambda time: brakes.creep_of(None, False, time)}
    lines = [head, "-" * len(head)]
    for word, kind in kinds.items():
        cells = [kind(time) for time in brakes.RELEASES]
        lines.append(f"{word:<28}" + "".join(f"{f'{count:d}, {speed:.2f}':>16}" for count, speed in cells))
    return "\n".join(lines)


def main() -> None:
    """Print the twelve cells, the five stops on the measured table and the release on a slope beside those of the toolbox."""
    from studies.command_line import parser_of
    from studies.questions import brakes

    parser_of(__doc__).parse_args()
    every = {row.label: row for row in brakes.contenders()}
    head = f"{'distance [m], in C / table':<28}" + "".join(f"{f'friction {word}':>22}" for word in brakes.OFF)
    print(f"{head}\n{'-' * len(head)}")
    for label in ROWS:
        cells = [
            f"{distance(label, factor):.2f} / {brakes.worst(every[label], WANTED, factor).distance:.2f}" for factor in brakes.OFF.values()
        ]
        print(f"{label:<28}" + "".join(f"{cell:>22}" for cell in cells), flush=True)
    print(f"\n{measured_table()}\n\n{release_table()}")


if __name__ == "__main__":
    main()
