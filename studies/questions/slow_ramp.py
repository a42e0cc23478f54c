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
from typing import Any

import numpy as np

from toolbox.authoring import cached

TORQUE, PI_LAW, SLIDING_LAW = 0, 1, 2


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
            kind, gains = SLIDING_LAW, [law.surface, law.reaching, law.width, law.inertia, law.drag]
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
    sticks = _ramped(
        string.inertia, string.stiffness, string.damping, string.top_drag, string.bit_drag, string.rock, string.law, string.gains, every, late,
        nodes, at, step, count,
    )  # fmt: skip
    return Ramp(nodes, at, count * step, sticks)


@cached(nogil=False, error_model="python")
def _torque(x, n, value, law, gains, k, c):  # type: ignore[no-untyped-def]
    if law == 0:
        return value
    top, bit, integral = x[n - 1], x[2 * n - 2], x[2 * n - 1]
    if law == 1:
        return gains[0] * (value - top) + gains[1] * integral
    lam, eta, width, inertia, drag = gains
    load = k[0] * x[0] + c[0] * (x[n - 1] - x[n])
    s = top - value + lam * integral
    return drag * top + load - inertia * lam * (top - value + top - bit) - inertia * eta * min(max(s / width, -1.0), 1.0)


@cached(nogil=False, error_model="python")
def _slopes(x, dx, inertia, k, c, top_drag, bit_drag, rock, law, value, torque, sign):  # type: ignore[no-untyped-def]
    """Rates into dx, and the torque that the bit bears without rock; x: twists (n - 1), speeds (n), integral; sign: of the slip, 0 in stick."""
    n = inertia.size
    above = torque
    for i in range(n):
        w = x[n - 1 + i]
        below = 0.0
        if i < n - 1:
            dx[i] = w - x[n + i]
            below = k[i] * x[i] + c[i] * dx[i]
        drag = top_drag * w if i == 0 else 0.0
        if i == n - 1:
            drag += bit_drag * w
        dx[n - 1 + i] = (above - below - drag) / inertia[i]
        above = below
    free = dx[2 * n - 2] * inertia[n - 1]
    if sign == 0.0:
        dx[2 * n - 2] = 0.0
    else:
        w = x[2 * n - 2]
        dx[2 * n - 2] = (free - sign * (rock[1] + (rock[0] - rock[1]) * math.exp(-rock[2] * abs(w)))) / inertia[n - 1]
    top, bit = x[n - 1], x[2 * n - 2]
    dx[2 * n - 1] = value - top if law == 1 else (top - value) + (top - bit) if law == 2 else 0.0
    return free


@cached(nogil=False, error_model="python")
def _advanced(x, h, v0, v1, inertia, k, c, top_drag, bit_drag, rock, law, gains, held, sampled, sign):  # type: ignore[no-untyped-def]
    """One step of the classical Runge-Kutta method in one mode."""
    n, size = inertia.size, x.size
    total, slope, y = np.zeros(size), np.empty(size), x.copy()
    for stage in range(4):
        value = v0 if stage == 0 else v1 if stage == 3 else 0.5 * (v0 + v1)
        torque = held if sampled else _torque(y, n, value, law, gains, k, c)
        _slopes(y, slope, inertia, k, c, top_drag, bit_drag, rock, law, value, torque, sign)
        if sampled:
            slope[2 * n - 1] = 0.0
        weight = 1.0 if stage in (0, 3) else 2.0
        for i in range(size):
            total[i] += weight * slope[i] / 6.0
            y[i] = x[i] + (h if stage == 2 else 0.5 * h) * slope[i]
    return x + h * total


@cached(nogil=False, error_model="python")
def _ramped(inertia, k, c, top_drag, bit_drag, rock, law, gains, every, late, nodes, values, h, count):  # type: ignore[no-untyped-def]
    n = inertia.size
    x, slope = np.zeros(2 * n), np.empty(2 * n)
    phases, found, since, sign = np.empty((200_000, 2)), 0, 0.0, 0.0
    held, coming, arrives = 0.0, 0.0, -1
    v1, piece = values[0], 0
    for step in range(count):
        t, v0 = step * h, v1
        while piece < nodes.size - 1 and nodes[piece + 1] <= t + h:
            piece += 1
        v1 = values[piece]
        if piece < nodes.size - 1:
            v1 += (values[piece + 1] - values[piece]) * (t + h - nodes[piece]) / (nodes[piece + 1] - nodes[piece])
        if every > 0 and step % every == 0:  # sample, update, hold: u_k = p e_k + i z_k, z_(k+1) = z_k + period e_k
            error = v0 - x[n - 1]
            coming, arrives = gains[0] * error + gains[1] * x[2 * n - 1], step + late
            x[2 * n - 1] += every * h * error
        if step == arrives:
            held = coming
        before = x[2 * n - 2]
        y = _advanced(x, h, v0, v1, inertia, k, c, top_drag, bit_drag, rock, law, gains, held, every > 0, sign)
        if sign != 0.0 and y[2 * n - 2] * sign <= 0.0:
            part = before / (before - y[2 * n - 2]) if before * sign > 0.0 else 0.0
            y = _advanced(x, part * h, v0, v1, inertia, k, c, top_drag, bit_drag, rock, law, gains, held, every > 0, sign)
            y[2 * n - 2] = 0.0
            torque = held if every > 0 else _torque(y, n, v1, law, gains, k, c)
            free = _slopes(y, slope, inertia, k, c, top_drag, bit_drag, rock, law, v1, torque, 0.0)
            sign = 0.0 if abs(free) <= rock[0] else math.copysign(1.0, free)
            since = t + part * h
            y = _advanced(y, (1.0 - part) * h, v0, v1, inertia, k, c, top_drag, bit_drag, rock, law, gains, held, every > 0, sign)
        if sign == 0.0:
            torque = held if every > 0 else _torque(y, n, v1, law, gains, k, c)
            free = _slopes(y, slope, inertia, k, c, top_drag, bit_drag, rock, law, v1, torque, 0.0)
            if abs(free) > rock[0]:
                sign = math.copysign(1.0, free)
                if found < phases.shape[0]:
                    phases[found, 0], phases[found, 1] = since, t + h
                    found += 1
        x = y
    if sign == 0.0 and found < phases.shape[0]:
        phases[found, 0], phases[found, 1] = since, count * h
        found += 1
    return phases[:found].copy()
