"""Stationary Kalman filter of a string whose bit torque is an unknown, wandering disturbance, at the samples of a law whose commands are held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from toolbox import SceneError
from toolbox.authoring import zero_order_hold
from toolbox.modelling import Stateful


@dataclass(frozen=True)
class FilterModel:
    """Model of a filter: x' = A x + B u - E T, y = C x at samples of `period` [s], with commands that take effect `delay` [s] later.

    noise: standard deviations of y;  torque_process_noise: wandering of T in a second;  drive_process_noise: white noise of the drive.
    """

    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    C: np.ndarray
    period: float
    delay: float
    noise: Sequence[float]
    torque_process_noise: float
    drive_process_noise: float


class DisturbanceFilter(Stateful):
    """Estimates z = (x, T) of x' = A x + B u - E T from y = C x, one sample after the other.

        z_k = z_k- + L (y_k - C z_k-),   z_(k+1)- = the motion from z_k under the commands that act until then

    A command takes effect `delay` after its sample; `waiting` holds those that have not yet taken effect for good, the oldest, which acts now, first. L is
    the stationary gain for measurement noise of the given standard deviations, a torque T that wanders by `torque_process_noise` in a second, and a drive
    with white noise of `drive_process_noise`. The error of z_k has the `covariance`, that of z_k- the `spread`; the motion of a period adds `walk`.
    Source: B. D. O. Anderson, J. B. Moore, Optimal Filtering, Prentice-Hall 1979.
    """

    memory_fields: ClassVar[tuple[str, ...]] = ("z", "waiting")

    def __init__(self, model: FilterModel):
        from scipy.linalg import expm, solve_discrete_are

        A, B, E, C, period, noise = model.A, model.B, model.E, model.C, model.period, model.noise
        torque_process_noise, drive_process_noise, n = model.torque_process_noise, model.drive_process_noise, A.shape[0]
        unit = np.append(np.ones(n), torque_process_noise)  # the torque in steps of a second, for a well-scaled equation
        F = np.block([[A, -E[:, None]], [np.zeros((1, n + 1))]]) * unit / unit[:, None]
        G = np.append(B, 0.0)[:, None]
        H = np.column_stack([C, np.zeros(C.shape[0])])
        Q = drive_process_noise**2 * G @ G.T
        Q[n, n] += 1.0
        both = expm(np.block([[-F, Q], [np.zeros_like(F), F.T]]) * period)  # C. F. Van Loan, IEEE Trans. Autom. Control 23 (1978) 395-404
        over = both[n + 1 :, n + 1 :].T
        walk = over @ both[: n + 1, n + 1 :]
        R = np.diag(np.asarray(noise, float) ** 2)
        if not (np.isfinite(R).all() and (R.diagonal() > 0.0).all()):
            raise SceneError(
                f"The standard deviations of measurement noise must have squares that are numbers > 0, but they are {noise!r}."
            )
        P = solve_discrete_are(over.T, H.T, 0.5 * (walk + walk.T), R)
        gain = np.linalg.solve(H @ P @ H.T + R, H @ P).T
        self.gain, self.covariance = unit[:, None] * gain, np.outer(unit, unit) * (P - gain @ H @ P)
        self.unit, self.spread, self.walk, self.noise = unit, np.outer(unit, unit) * P, np.outer(unit, unit) * walk, R
        self.rows = H
        self.periods, self.part = whole_periods(model.delay, period)
        F, scaled = F * unit[:, None] / unit, G
        self.first, first_drive = zero_order_hold(F, scaled, self.part)
        self.rest, rest_drive = zero_order_hold(F, scaled, period - self.part)
        self.whole, whole_drive = zero_order_hold(F, scaled, period)
        self.first_drive, self.rest_drive, self.whole_drive = first_drive.ravel(), rest_drive.ravel(), whole_drive.ravel()
        self.z = np.zeros(n + 1)
        self.waiting = np.zeros(self.periods + 1)

    def correct(self, y: np.ndarray) -> np.ndarray:
        """The estimate at a sample with measurement y; (x, T)."""
        self.z = self.z + self.gain @ (y - self.rows @ self.z)
        return self.z

    def arrival(self) -> np.ndarray:
        """Return the estimate at the instant at which the command of this sample arrives. Until then the waiting commands act."""
        z = self.first @ self.z + self.first_drive * self.waiting[0]
        for command in self.waiting[1:]:
            z = self.whole @ z + self.whole_drive * command
        return z

    def predict(self, command: float) -> None:
        """Go to the next sample with the command of this one."""
        z = self.first @ self.z + self.first_drive * self.waiting[0]
        self.waiting[:-1] = self.waiting[1:]
        self.waiting[-1] = command
        self.z = self.rest @ z + self.rest_drive * self.waiting[0]


def whole_periods(delay: float, period: float) -> tuple[int, float]:
    """(q, r) with delay = q period + r, 0 <= r < period."""
    whole = int(np.floor(delay / period + 1e-9))
    return whole, max(delay - whole * period, 0.0)
