"""How much gain, phase and delay a linear loop bears, one command at a time and all at once.

    disk margin  alpha = 2 / max_w |S - T|,   S = 1 / (1 + L),  T = 1 - S          (skew 0)
    peak sensitivity  M_s = max_w |S|,   1 / M_s is the distance of the Nyquist curve from -1

Every factor f in the disk {(2 + d) / (2 - d): |d| < alpha}, which may be complex and change with frequency, leaves the loop stable: gains between
(2 - alpha) / (2 + alpha) and its inverse, phases below 2 arctan(alpha / 2), and both at once. A strictly proper loop has at most alpha = 2.
With several commands each gets a factor of its own: alpha is then the inverse of the structured singular value of (S - T) / 2, of which the bound by
diagonal scaling is given (exact for up to three commands), and of its largest singular value where the factors may also mix the commands. Source:
P. Seiler, A. Packard, P. Gahinet, An introduction to disk margins, IEEE Control Systems Magazine 40 (2020) 78-95, doi:10.1109/MCS.2020.3005277.

Why not python-control's `disk_margins`: it takes the smallest value on a grid of frequencies, which misses the peak of a lightly damped string, and needs
slycot for more than one command. Here peaks are refined; a test compares the two.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.halving import zero
from toolbox.steady_states.linear_loop import LinearLoop

MANY = 100
"""Periods of delay beyond which a part of a period more is a shift of phase and nothing else."""
POINTS = 800
"""Frequencies between the lowest and the highest, beside those around each pole."""

HUGE = 1e9
"""Size of a loop beyond which round-off decides where it crosses the axis, as near to two poles at zero."""


@dataclass(frozen=True)
class LoopMargins:
    """Margins of a command with all other commands closed; 0, with an infinite sensitivity, if the loop is unstable, nan if no linear loop
    exists.

    Attributes
    ----------
    command
        Its name.
    disk_margin, disk_frequency
        Disk margin alpha [1], and the frequency at which it is reached [rad/s].
    peak_sensitivity, peak_frequency
        Peak sensitivity M_s [1] and its frequency [rad/s].
    lowest_gain, highest_gain
        Factors of the command between which, from 1, the loop stays stable; 0 and infinity where there is no bound.
    phase_margin
        Phase margin in the worse direction [rad].
    delay_margin
        Additional delay at which the loop becomes unstable [s].
    """

    command: str
    disk_margin: float = math.nan
    disk_frequency: float = math.nan
    peak_sensitivity: float = math.nan
    peak_frequency: float = math.nan
    lowest_gain: float = math.nan
    highest_gain: float = math.nan
    phase_margin: float = math.nan
    delay_margin: float = math.nan

    @property
    def disk_gains(self) -> tuple[float, float]:
        """Gains that the disk guarantees together with its phases, (lowest, highest)."""
        a = self.disk_margin
        return (2 - a) / (2 + a) if a < 2 else 0.0, (2 + a) / (2 - a) if a < 2 else math.inf

    @property
    def disk_phase(self) -> float:
        """Phase that the disk guarantees, 2 arctan(alpha / 2) [rad]."""
        return 2.0 * math.atan(self.disk_margin / 2.0)


UNSTABLE: dict[str, Any] = {
    "disk_margin": 0.0, "peak_sensitivity": math.inf, "lowest_gain": 1.0, "highest_gain": 1.0, "phase_margin": 0.0, "delay_margin": 0.0,
}  # fmt: skip


def frequencies(loop: LinearLoop) -> np.ndarray:
    """Return increasing frequencies [rad/s] for the analysis of a loop: over all its time scales, and close around each of its poles."""
    poles = np.concatenate([loop.poles(0.0), loop.poles()])
    top = math.inf
    if loop.period is not None:
        poles = np.log(poles[np.abs(poles) > 1e-12]) / loop.period
        top = math.pi / loop.period
    size = np.abs(poles)
    size = size[size > 1e-9 * size.max(initial=1e-300)]
    if not size.size:
        size = np.ones(1)
    high = min(1e3 * size.max(), top)
    wide = np.geomspace(1e-3 * min(size.min(), high), high, POINTS)
    apart = np.concatenate([[1e-9], np.geomspace(1e-7, 0.3, 25)])  # on a pole without damping the loop has no value
    around = (size[:, None] * np.concatenate([1.0 - apart, 1.0 + apart])).ravel()
    found = np.unique(np.concatenate([wide, around, [top] if top < math.inf else []]))
    return found[(found > 0) & (found <= top)]


def peak(function: Callable[[np.ndarray], np.ndarray], grid: np.ndarray) -> tuple[float, float]:
    """Return the largest value of a function of frequencies and its frequency. The function is searched on the grid, then around its five
    highest peaks."""
    from scipy.optimize import minimize_scalar

    with np.errstate(divide="ignore", invalid="ignore"):
        values = function(grid)
    if not np.isfinite(values).all():
        return math.inf, float(grid[np.argmax(~np.isfinite(values))])
    k = int(np.argmax(values))
    best, where = float(values[k]), float(grid[k])
    inner = np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] >= values[2:])) + 1
    for i in sorted(inner, key=lambda i: -values[i])[:5]:
        low, high = math.log(grid[i - 1]), math.log(grid[i + 1])
        found = minimize_scalar(
            lambda s: -float(function(np.array([math.exp(s)]))[0]), bounds=(low, high), method="bounded", options={"xatol": 1e-12}
        )
        if -found.fun > best:
            best, where = -float(found.fun), math.exp(float(found.x))
    return best, where


def largest_disk(loop: LinearLoop, grid: np.ndarray) -> tuple[float, float]:
    """(1 / alpha, its frequency [rad/s]) of a stable loop of one command; grid: its `frequencies`."""

    def size(w: np.ndarray) -> np.ndarray:
        gain = loop.transfer(w)[:, 0, 0]
        return np.abs((1 - gain) / (1 + gain)) / 2

    found, far = peak(size, grid), -float(loop.D[0, 0])
    return found if loop.period is not None else max(found, (abs((1 - far) / (1 + far)) / 2, math.inf))


def loop_margins(loop: LinearLoop, delayed: Callable[[float], LinearLoop] | None = None) -> LoopMargins:
    """Return the margins of a loop with a single command. delayed: function that returns the loop with an additional delay [s], for sampled
    loops, in which a delay is more than a shift of phase."""
    if not loop.stable:
        return LoopMargins(loop.actuated_signals[0], **UNSTABLE)
    grid = frequencies(loop)

    def gain(w: np.ndarray) -> np.ndarray:
        return loop.transfer(w)[:, 0, 0]

    at, far = gain(grid), -float(loop.D[0, 0])
    disk, disk_at = largest_disk(loop, grid)
    sensitivity, sensitivity_at = peak(lambda w: 1 / np.abs(1 + gain(w)), grid)
    if loop.period is None:  # there the frequencies have no end
        sensitivity, sensitivity_at = max((sensitivity, sensitivity_at), (1 / abs(1 + far), math.inf))
    low, high = _gains(gain, grid, at, far if loop.period is None else None)
    phase, delay = _phase(gain, grid, at)
    if delayed is not None and math.isfinite(delay):
        delay = _delay(delayed, delay)
    return LoopMargins(loop.actuated_signals[0], 1 / disk, disk_at, sensitivity, sensitivity_at, low, high, phase, delay)


def _crossings(function: Callable[[np.ndarray], np.ndarray], grid: np.ndarray, values: np.ndarray) -> list[float]:
    """Frequencies at which a real function of frequencies changes its sign; values: those on the grid."""
    found = [float(w) for w in grid[values == 0.0]]
    for i in np.flatnonzero(values[:-1] * values[1:] < 0.0):
        found.append(zero(lambda w: float(function(np.array([w]))[0]), float(grid[i]), float(grid[i + 1]), 1e-14 * float(grid[i]), 1e-13))
    return sorted(found)


def _gains(gain: Callable[[np.ndarray], np.ndarray], grid: np.ndarray, at: np.ndarray, far: float | None) -> tuple[float, float]:
    """The factors nearest to 1, below and above, with which the Nyquist curve runs through -1; its two ends count where they are finite.

    far: the end of a continuous loop, at infinite frequency; None where the last frequency is the end.
    """
    crossing = gain(np.array(_crossings(lambda w: gain(w).imag, grid, at.imag))).real if (at.imag != 0).any() else np.empty(0)
    nearer, near = gain(grid[0] * np.array([1e-4, 1e-3]))
    ends = [at[-1].real if far is None else far]
    if abs(nearer - near) < 1e-3 * abs(near):  # what integrates grows without end instead
        ends.append(nearer.real)
    real = np.concatenate([crossing, ends])
    factors = -1.0 / real[(real < 0.0) & (real > -HUGE)]
    return float(max(factors[factors < 1.0], default=0.0)), float(min(factors[factors > 1.0], default=math.inf))


def _phase(gain: Callable[[np.ndarray], np.ndarray], grid: np.ndarray, at: np.ndarray) -> tuple[float, float]:
    """(phase margin [rad], delay margin [s] as that of a phase w delay) over the frequencies at which |L| = 1."""
    where = np.array(_crossings(lambda w: np.log(np.abs(gain(w))), grid, np.log(np.abs(at) + 1e-300)))
    if not where.size:
        return math.pi, math.inf
    lead = np.angle(-gain(where))
    return float(np.abs(lead).min()), float((np.mod(lead, 2 * math.pi) / where).min())


def _delay(delayed: Callable[[float], LinearLoop], guess: float) -> float:
    """The additional delay at which the poles of a sampled loop reach the unit circle, near a guess, which is as good where it is many periods."""
    if guess > MANY * (delayed(0.0).period or math.inf):
        return guess

    def growth(delay: float) -> float:
        return delayed(delay).growth()

    for part in (0.02, 0.1, 0.5):
        low, high = (1.0 - part) * guess, (1.0 + part) * guess
        if growth(low) < 0.0 < growth(high):
            return zero(growth, low, high, 1e-12 * guess, 1e-10)
    return guess


# ------------------------------------------------------------------------------------------------------------------------------- several commands
@dataclass(frozen=True)
class JointMargins:
    """Margins of all commands together.

    Attributes
    ----------
    disk_margin, disk_frequency
        Disk margin [1] where every command has a factor of its own in the disk, and its frequency [rad/s].
    unstructured_margin
        Disk margin [1] where the factors may also mix the commands, so that it is the smaller one.
    peak_sensitivity
        Largest singular value of the sensitivity S [1].
    """

    disk_margin: float
    disk_frequency: float
    unstructured_margin: float
    peak_sensitivity: float


def joint_margins(loop: LinearLoop) -> JointMargins:
    """Return the margins of all commands of a loop together; 0 if the loop is unstable."""
    if not loop.stable:
        return JointMargins(0.0, math.nan, 0.0, math.inf)
    grid, one = frequencies(loop), np.eye(len(loop.actuated_signals))

    def sensitivity(w: np.ndarray) -> np.ndarray:
        return np.linalg.inv(one + loop.transfer(w))

    def singular(w: np.ndarray) -> np.ndarray:
        return np.linalg.norm(sensitivity(w) - one / 2, 2, axis=(1, 2))

    def structured(w: np.ndarray) -> np.ndarray:
        return np.array([scaled_norm(each) for each in sensitivity(w) - one / 2])

    def largest(w: np.ndarray) -> np.ndarray:
        return np.linalg.norm(sensitivity(w), 2, axis=(1, 2))

    mu, where = peak(structured, grid)
    norm, top = peak(singular, grid)[0], peak(largest, grid)[0]
    if loop.period is None:
        far = np.linalg.inv(one - loop.D)
        mu, where = max((mu, where), (scaled_norm(far - one / 2), math.inf))
        norm, top = max(norm, float(np.linalg.norm(far - one / 2, 2))), max(top, float(np.linalg.norm(far, 2)))
    return JointMargins(1 / mu, where, 1 / norm, top)


def scaled_norm(matrix: np.ndarray) -> float:
    """min over positive diagonal D of the largest singular value of D M D^-1, an upper bound of the structured singular value for a factor per channel.

    It is exact for up to three channels (A. Packard, J. Doyle, Automatica 29 (1993) 71-109); convex in log D, which is balanced first.
    """
    if len(matrix) == 2:
        # D changes neither the diagonal nor the determinant: the smallest Frobenius norm, of equal entries, has the smallest singular value
        (a, b), (c, d) = matrix
        one, other = (1.0 if x == 0 else x / abs(x) for x in (b, c))
        size = math.sqrt(abs(b)) * math.sqrt(abs(c))
        return float(np.linalg.norm([[a, size * one], [size * other, d]], 2))
    from scipy.optimize import minimize

    scale = balancing(matrix)

    def norm(logs: np.ndarray) -> float:
        d = np.exp(np.append(logs, 0.0))
        return float(np.linalg.norm(d[:, None] * matrix / d, 2))

    begin = np.log(scale[:-1] / scale[-1])
    return float(min(norm(begin), minimize(norm, begin, method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-10}).fun))


def balancing(matrix: np.ndarray) -> np.ndarray:
    """The diagonal D of a scaling D M D^-1 whose rows and columns are of equal size, without the diagonal (E. Osborne, J. ACM 7 (1960) 338-345)."""
    size = matrix.shape[0]
    off = np.abs(matrix) ** 2 * (1 - np.eye(size))
    scale = np.ones(size)
    for _ in range(50):
        for i in range(size):
            row, column = scale[i] ** 2 * (off[i] / scale**2).sum(), (off[:, i] * scale**2).sum() / scale[i] ** 2
            if row > 0 and column > 0:
                scale[i] *= (column / row) ** 0.25
    return scale
