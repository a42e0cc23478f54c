"""A linear loop that is broken at its commands, continuous or from sample to sample, and when a law has none.

The commands v that the plant gets are its input, the commands w that the laws give its output, and L = -w / v is the loop transfer of negative feedback.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

STABLE = 1e-8
"""A pole this far beyond the border of stability still counts as on it: that of an angle that nobody measures."""


class NoDerivative(Exception):
    """A law without a derivative at steady running; its text says why. Never leaves this room."""


@dataclass(frozen=True)
class LinearLoop:
    """A loop opened at its commands: xi+ = A xi + B v, w = C xi + D v in samples of `period`, or xi' = ... if `period` is None.

    drives: names of the commands, in the order of v and w.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    actuated_signals: tuple[str, ...]
    period: float | None = None

    def transfer(self, frequency: np.ndarray) -> np.ndarray:
        """L(i w), or L(exp(i w period)), at frequencies w [rad/s], shape (len(frequency), commands, commands)."""
        w = np.asarray(frequency, float)
        point = 1j * w if self.period is None else np.exp(1j * w * self.period)
        inner = point[:, None, None] * np.eye(self.A.shape[0]) - self.A
        return -(self.C @ np.linalg.solve(inner, np.broadcast_to(self.B.astype(complex), (w.size, *self.B.shape))) + self.D)

    def poles(self, factor: complex | np.ndarray = 1.0) -> np.ndarray:
        """Poles of the closed loop with every command multiplied by a factor; of samples where `period` is a number."""
        k = np.diag(np.broadcast_to(np.asarray(factor), len(self.actuated_signals)))
        return np.linalg.eigvals(self.A + self.B @ k @ np.linalg.solve(np.eye(len(self.actuated_signals)) - self.D @ k, self.C)).astype(
            complex
        )

    def growth(self, factor: complex | np.ndarray = 1.0) -> float:
        """Largest real part of the poles [1/s], of log(z) / period for samples: positive where the loop is unstable."""
        poles = self.poles(factor)
        if self.period is None:
            return float(poles.real.max(initial=-np.inf))
        with np.errstate(divide="ignore"):
            return float(np.log(np.abs(poles)).max(initial=-np.inf)) / self.period

    @property
    def stable(self) -> bool:
        """Whether the closed loop is stable."""
        scale = 1.0 if self.period is None else 1.0 / self.period
        return self.growth() <= STABLE * scale

    def alone(self, i: int) -> LinearLoop:
        """The loop of one command with all the others closed."""
        others = [j for j in range(len(self.actuated_signals)) if j != i]
        inner = np.linalg.inv(np.eye(len(others)) - self.D[np.ix_(others, others)])
        closing_c, closing_d = inner @ self.C[others], inner @ self.D[others, i : i + 1]
        return LinearLoop(
            self.A + self.B[:, others] @ closing_c,
            self.B[:, [i]] + self.B[:, others] @ closing_d,
            self.C[[i]] + self.D[[i]][:, others] @ closing_c,
            self.D[[i]][:, [i]] + self.D[[i]][:, others] @ closing_d,
            (self.actuated_signals[i],),
            self.period,
        )


def zero_order_hold(A: np.ndarray, B: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Discretise x' = A x + B u for an input that is held constant over a period.

    Parameters
    ----------
    A
        System matrix, shape (n, n).
    B
        Input matrix, shape (n, m).
    period
        Sample time [s].

    Returns
    -------
    array, array
        exp(A period), shape (n, n), and the integral of exp(A s) B over s from 0 to the period, shape (n, m).

    Examples
    --------
    >>> import numpy as np
    >>> from toolbox.authoring import zero_order_hold
    >>> F, G = zero_order_hold(np.array([[-1.0]]), np.array([[1.0]]), period=0.5)
    >>> print(F.round(3), G.round(3))
    [[0.607]] [[0.393]]
    """
    from scipy.linalg import expm

    n, k = B.shape
    whole = np.zeros((n + k, n + k))
    whole[:n, :n], whole[:n, n:] = A, B
    found = expm(whole * period)
    return found[:n, :n], found[:n, n:]


def acts(loop: LinearLoop) -> None:
    """Raise NoDerivative if the commands respond to nothing, because a limit holds them."""
    if (
        not np.abs(
            loop.transfer(np.geomspace(1e-3, 1e2, 7) if loop.period is None else np.geomspace(1e-4, 1.0, 7) * np.pi / loop.period)
        ).max()
        > 0.0
    ):
        raise NoDerivative(f"a limit holds {', '.join(f'`{name}`' for name in loop.actuated_signals)} at steady running")


STEPS = 10.0 ** -np.arange(6.0, 14.0)
"""Steps in parts of the sizes of the unknowns, by which a function is asked whether it has a slope."""


def checked_smooth(value: Callable[[np.ndarray], np.ndarray], slope: np.ndarray, q: np.ndarray) -> None:
    """Raise NoDerivative if a function is not as smooth as its derivative says. The remainder of a smooth function falls with the square of
    the step.

    That of a kink falls with the step. What bends or jumps a little way off falls sooner, so that the steps become smaller until round-off hides the rest.
    """
    if not np.isfinite(slope).all():
        raise NoDerivative("the slope of the law is not finite at steady running")
    size, centre = _sizes(slope, q), value(q)
    noise = 1e-12 * (np.abs(centre) + np.abs(slope) @ np.abs(q)) + 1e-300
    for direction in np.random.default_rng(0).standard_normal((6, q.size)):
        left, line = _remainder(value, slope, q, centre, STEPS[0] * size * direction)
        bent = left > line + noise
        for part in STEPS[1:] if bent.any() else ():
            before, (left, line) = left, _remainder(value, slope, q, centre, part * size * direction)
            told = 0.1 * before > noise  # what a kink leaves of it is more than round-off
            bent = np.where(told, left > np.maximum(line + noise, 0.05 * before), bent)
        if bent.any():
            raise NoDerivative("the law has a kink or a jump at steady running")


def _remainder(
    value: Callable[[np.ndarray], np.ndarray], slope: np.ndarray, q: np.ndarray, centre: np.ndarray, step: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(how far a function is from its tangent after a step, how far from it counts as on it)."""
    return np.abs(value(q + step) - centre - slope @ step), 1e-2 * np.abs(slope) @ np.abs(step)


def _sizes(slope: np.ndarray, q: np.ndarray) -> np.ndarray:
    """What a change of each unknown is measured by: itself, and where it is zero, or nearly, what changes a value as much as all others make it."""
    rows, largest = np.abs(slope) @ np.abs(q), np.abs(q).max(initial=0.0) or 1.0
    with np.errstate(divide="ignore", invalid="ignore"):
        alike = np.where((slope != 0.0) & (rows[:, None] > 0.0), rows[:, None] / np.abs(slope), 0.0).max(axis=0, initial=0.0)
    alike = np.where(alike > 0.0, np.minimum(alike, 1e6 * largest), largest)  # a slope that is round-off tells no size
    return np.maximum(np.abs(q), 1e-3 * alike)
