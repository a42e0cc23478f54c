"""A slow ramp through the border of stick-slip, by a simulation that shares nothing with the toolbox: fixed steps and its own logic of sticking.

A chain of inertias J_i on springs k_i with dampers c_i, drag c_r at the top and c_b at the bit, and rock at the bit:

    J_i w_i' = T_(i-1) - T_i - drag,     a_i' = w_i - w_(i+1),     T_i = k_i a_i + c_i (w_i - w_(i+1))
    T_rock = W R [mu_k + (mu_s - mu_k) exp(-gamma |w|)] sgn w in slip; in stick whatever holds the bit, up to W R mu_s

by the classical Runge-Kutta method of fourth order. A step in which the bit speed changes its sign is cut where the line between both ends is zero, and the
bit is held from there; it is let go at the end of the first step in which holding it takes more than the rock can give. One number moves: the torque
at the top, or the set-point of the drive, so slowly that the machine is on its branch at every instant; where the last stick phase ends is the border.

This is the measure of what `onset`, `severity_map` and `follow` find: see `studies.questions.onset`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from toolbox.authoring import Compiled

TORQUE, PI_LAW, SLIDING_LAW = 0, 1, 2
(LAW, EVERY, LATE, COUNT), (STEP, TOP_DRAG, BIT_DRAG) = range(4), range(3)
"""Indices into `Work.ints`: the kind of law, steps in a sample and in a delay, and all steps; and into `Work.numbers`."""


@dataclass(frozen=True)
class String:
    """The numbers of a chain, its rock and its drive, read from parts of the toolbox; law: one of the three kinds, gains: its numbers.

    sample_time, delay: of a sampled PI [s], 0 for one that acts all the time; both are rounded to whole steps.
    """

    inertia: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    top_drag: float
    bit_drag: float
    rock: np.ndarray
    law: int
    gains: np.ndarray
    sample_time: float = 0.0
    delay: float = 0.0

    @staticmethod
    def of(chain: Any, rock: Any, law: Any = None, sample_time: float = 0.0, delay: float = 0.0) -> String:
        """From a `TorsionalChain`, a `BitRock` with the exponential law, and a designed law: None (a torque), a PI or a `SlidingMode`."""
        if law is None:
            kind, gains = TORQUE, [0.0]
        elif hasattr(law, "proportional"):
            kind, gains = PI_LAW, [law.proportional, law.integral]
        else:
            kind, gains = SLIDING_LAW, [law.surface_gain, law.reaching_rate, law.boundary_layer, law.inertia, law.drag]
        load, f = rock.weight * rock.radius, rock.friction
        arrays = [np.array(part, float) for part in (chain.inertia, chain.stiffness, chain.damping)]
        numbers = np.array([load * f.static, load * f.kinetic, f.decay], float)
        return String(*arrays, chain.top_drag, chain.bit_drag, numbers, kind, np.array(gains, float), sample_time, delay)


@dataclass(frozen=True)
class Ramp:
    """What a ramp came to: its break points in time [s] and value, its end [s], and its stick phases: begin and end of each [s], shape (k, 2)."""

    times: np.ndarray
    values: np.ndarray
    end: float
    sticks: np.ndarray

    def value(self, time: float) -> float:
        """The number that moves, at a time."""
        return float(np.interp(time, self.times, self.values))

    @property
    def stands(self) -> bool:
        """Whether the bit stands still at the end, for longer than five of the cycles before."""
        return len(self.sticks) > 1 and self.sticks[-1, 1] >= self.end and self.end - self.sticks[-1, 0] > 5 * self._round

    @property
    def border(self) -> float:
        """Where the last stick phase ends, or begins where it lasts for good; nan where stick-slip never begins, or goes on to the end."""
        sticks = self.sticks[self.sticks[:, 1] > self.times[1]]
        if len(sticks) < 3:
            return math.nan
        first, last = sticks[-1]
        if self.stands:
            return self.value(first)
        return self.value(last) if self.end - last > 5 * self._round else math.nan

    @property
    def _round(self) -> float:
        return float(np.median(np.diff(self.sticks[-100:, 0])))


def ramp(
    string: String, values: Sequence[float], rates: Sequence[float], *, hold: float = 600.0, rest: float = 300.0, step: float = 2e-3
) -> Ramp:
    """A run from standstill at values[0], held there until stick-slip has settled, then led from value to value at its rate each, and held at the last.

    rates: absolute, per second, one per pair of values: fast to where the border is near, slow through it;  hold, rest: seconds at the first value and at
    the last;  step: of the method [s].
    """
    times = hold + np.concatenate([[0.0], np.cumsum(np.abs(np.diff(values)) / np.asarray(rates))])
    nodes, at = np.concatenate([[0.0], times]), np.concatenate([[values[0]], values]).astype(float)
    count = round((times[-1] + rest) / step)
    every, late = round(string.sample_time / step), round(string.delay / step)
    ints, numbers, states = (
        np.array([string.law, every, late, count]),
        np.array([step, string.top_drag, string.bit_drag]),
        2 * string.inertia.size,
    )
    work = Work(
        ints, numbers, string.inertia, string.stiffness, string.damping, string.rock, string.gains, nodes, at, np.empty((200_000, 2)),
        *np.zeros((5, states)),
    )  # fmt: skip
    found = ramped(work)
    return Ramp(nodes, at, count * step, work.phases[:found].copy())


class Work(NamedTuple):
    """A ramp under way.

    ints: see above;  numbers: step [s], drag at the top and at the bit;  inertia, k, c, rock, gains: as of `String`;  nodes, values: break points;
    phases: where the stick phases go;  x, y: twists (n - 1), speeds (n) and the integral now and a step later;  slope, stage, total: room for a step.
    """

    ints: np.ndarray
    numbers: np.ndarray
    inertia: np.ndarray
    k: np.ndarray
    c: np.ndarray
    rock: np.ndarray
    gains: np.ndarray
    nodes: np.ndarray
    values: np.ndarray
    phases: np.ndarray
    x: np.ndarray
    y: np.ndarray
    slope: np.ndarray
    stage: np.ndarray
    total: np.ndarray


def _torque(w, x, value):  # type: ignore[no-untyped-def]
    n, law = w.inertia.size, w.ints[LAW]
    if law == TORQUE:
        return value
    top, bit, integral = x[n - 1], x[2 * n - 2], x[2 * n - 1]
    if law == PI_LAW:
        return w.gains[0] * (value - top) + w.gains[1] * integral
    lam, eta, width, inertia, drag = w.gains[0], w.gains[1], w.gains[2], w.gains[3], w.gains[4]
    load = w.k[0] * x[0] + w.c[0] * (x[n - 1] - x[n])
    s = top - value + lam * integral
    return drag * top + load - inertia * lam * (top - value + top - bit) - inertia * eta * min(max(s / width, -1.0), 1.0)


def _slopes(w, x, value, torque, sign):  # type: ignore[no-untyped-def]
    """Rates into `slope`, and the torque that the bit bears without rock; sign: of the slip, 0 in stick."""
    n = w.inertia.size
    above = torque
    for i in range(n):
        speed, below = x[n - 1 + i], 0.0
        if i < n - 1:
            w.slope[i] = speed - x[n + i]
            below = w.k[i] * x[i] + w.c[i] * w.slope[i]
        drag = w.numbers[TOP_DRAG] * speed if i == 0 else 0.0
        if i == n - 1:
            drag += w.numbers[BIT_DRAG] * speed
        w.slope[n - 1 + i] = (above - below - drag) / w.inertia[i]
        above = below
    free = w.slope[2 * n - 2] * w.inertia[n - 1]
    top, bit = x[n - 1], x[2 * n - 2]
    if sign == 0.0:
        w.slope[2 * n - 2] = 0.0
    else:
        w.slope[2 * n - 2] = (free - sign * (w.rock[1] + (w.rock[0] - w.rock[1]) * math.exp(-w.rock[2] * abs(bit)))) / w.inertia[n - 1]
    law = w.ints[LAW]
    w.slope[2 * n - 1] = value - top if law == PI_LAW else ((top - value) + (top - bit) if law == SLIDING_LAW else 0.0)
    return free


def _advanced(w, x, h, v0, v1, held, sign):  # type: ignore[no-untyped-def]
    """One step of the classical Runge-Kutta method in one mode, from x to y."""
    sampled, size = w.ints[EVERY] > 0, w.x.size
    for i in range(size):
        w.total[i] = 0.0
        w.stage[i] = x[i]
    for stage in range(4):
        value = v0 if stage == 0 else (v1 if stage == 3 else 0.5 * (v0 + v1))
        _slopes(w, w.stage, value, held if sampled else _torque(w, w.stage, value), sign)
        if sampled:
            w.slope[size - 1] = 0.0
        weight = 1.0 if stage == 0 or stage == 3 else 2.0
        for i in range(size):
            w.total[i] += weight * w.slope[i] / 6.0
            w.stage[i] = x[i] + (h if stage == 2 else 0.5 * h) * w.slope[i]
    for i in range(size):
        w.y[i] = x[i] + h * w.total[i]


def _ramped(w):  # type: ignore[no-untyped-def]
    """Run the ramp; returns how many stick phases it had."""
    n, h, every = w.inertia.size, w.numbers[STEP], w.ints[EVERY]
    found, since, sign = 0, 0.0, 0.0
    held, coming, arrives = 0.0, 0.0, -1
    v1, piece = w.values[0], 0
    for step in range(w.ints[COUNT]):
        t, v0 = step * h, v1
        while piece < w.nodes.size - 1 and w.nodes[piece + 1] <= t + h:
            piece += 1
        v1 = w.values[piece]
        if piece < w.nodes.size - 1:
            v1 += (w.values[piece + 1] - w.values[piece]) * (t + h - w.nodes[piece]) / (w.nodes[piece + 1] - w.nodes[piece])
        if every > 0 and step % every == 0:  # sample, update, hold: u_k = p e_k + i z_k, z_(k+1) = z_k + period e_k
            error = v0 - w.x[n - 1]
            coming, arrives = w.gains[0] * error + w.gains[1] * w.x[2 * n - 1], step + w.ints[LATE]
            w.x[2 * n - 1] += every * h * error
        if step == arrives:
            held = coming
        before = w.x[2 * n - 2]
        _advanced(w, w.x, h, v0, v1, held, sign)
        if sign != 0.0 and w.y[2 * n - 2] * sign <= 0.0:
            part = before / (before - w.y[2 * n - 2]) if before * sign > 0.0 else 0.0
            _advanced(w, w.x, part * h, v0, v1, held, sign)
            w.y[2 * n - 2] = 0.0
            free = _slopes(w, w.y, v1, held if every > 0 else _torque(w, w.y, v1), 0.0)
            sign = 0.0 if abs(free) <= w.rock[0] else math.copysign(1.0, free)
            since = t + part * h
            _advanced(w, w.y, (1.0 - part) * h, v0, v1, held, sign)
        if sign == 0.0:
            free = _slopes(w, w.y, v1, held if every > 0 else _torque(w, w.y, v1), 0.0)
            if abs(free) > w.rock[0]:
                sign = math.copysign(1.0, free)
                if found < w.phases.shape[0]:
                    w.phases[found, 0], w.phases[found, 1] = since, t + h
                    found += 1
        for i in range(w.x.size):
            w.x[i] = w.y[i]
    if sign == 0.0 and found < w.phases.shape[0]:
        w.phases[found, 0], w.phases[found, 1] = since, w.ints[COUNT] * h
        found += 1
    return found


ramped = Compiled(_ramped, dict.fromkeys(Work._fields, ("float64", 1)) | {"ints": ("int64", 1), "phases": ("float64", 2)})
"""A ramp as machine code."""
