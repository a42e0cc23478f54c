"""Filter of a string whose rock is known by its law and not by its strength: linear while the bit may rest, extended by the law while it turns."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np

from controllers.disturbance_filter import DisturbanceFilter, FilterModel

SURPRISE = 4.0
"""Mean square of the innovations, in units of what the filter expects, beyond which the law of the rock is no longer believed."""
MEMORY = 1.0
"""How long [s] an error of the drive's torque lasts, as white noise stands for it."""
SETTLED = 5.0
"""Time [s] in which the mean of the commands follows them."""


class RockFilter(DisturbanceFilter):
    """`DisturbanceFilter`, with an extended Kalman filter of (x, s) beside it while the bit turns. The torque of the rock is s times the
    torque of its friction law.

        x' = A x + B u - E s T(w_bit),   s' = 0 but for wandering by `strength_process_noise` in a second

    A wandering torque is all that is known of a rock that may hold the bit, but it is too little for a turning bit near the speed at which the string loses its
    stability: a filter fast enough for the release passes so much noise that the drive swings. So the linear filter always runs, and says when
    the bit has turned for `lasting` samples. There the extended filter begins, with the estimate and covariance of the linear one, and narrows
    down; its states follow the hybrid prediction of the plant. It ends where its bit comes to rest, or where its innovations are larger than it can
    explain (their mean square over about ten samples above `SURPRISE`).

    What is not known of the drive, a part `drive_torque_error` of its inertia or torque, matters only while its torque moves. Both filters take it for
    white noise of the drive's torque with the intensity

        drive_process_noise^2 + (drive_torque_error (u - u_mean))^2 `MEMORY`,    u_mean' = (u - u_mean) / `SETTLED`

    so that they are careful while the command swings, and sharp in steady drilling; the gain of the linear filter follows its Riccati equation in time.

    model: what the filters know;  rollout: the prediction;  contact: which of its contacts is the bit;  bit: row of the bit speed;  rock: torque and
    slope at a speed > 0;  turning: estimated speed above which a bit turns.
    """

    memory_fields: ClassVar[tuple[str, ...]] = (
        *DisturbanceFilter.memory_fields, "spread_root", "mean", "turned", "surprise", "xi", "doubt_root", "sliding",
    )  # fmt: skip

    def __init__(
        self, model: FilterModel, *, drive_torque_error: float, strength_process_noise: float, rollout: Any, contact: int,
        bit: np.ndarray, rock: Callable[[float], tuple[float, float]], turning: float, lasting: int,
    ):  # fmt: skip
        super().__init__(model)
        A, B, E, C, period, drive_process_noise = model.A, model.B, model.E, model.C, model.period, model.drive_process_noise
        n = A.shape[0]
        self.drive_process_noise, self.drive_torque_error, self.mean = drive_process_noise, drive_torque_error, 0.0
        # what the drive's noise of intensity 1 adds in a period to the linear filter, beside the rest of `walk`
        self.pushed = self._pushed(A, B, E, period)
        self.still = self.walk - drive_process_noise**2 * self.pushed
        self.rollout, self.contact, self.bit, self.rock, self.turning, self.lasting = rollout, contact, bit, rock, turning, lasting
        self.seen = np.column_stack([C, np.zeros(C.shape[0])])
        self.period = period
        # noise of a period, as it reaches the states of the string alone
        self.wander = np.zeros((n + 1, n + 1))
        self.shaken = np.zeros((n + 1, n + 1))
        self.shaken[:n, :n] = np.outer(B, B) * period
        self.wander[n, n] = strength_process_noise**2 * period
        self.turned, self.surprise, self.sliding = 0, 0.0, False
        self.xi, self.doubt = np.zeros(n + 1), np.zeros((n + 1, n + 1))
        self.below = np.tril_indices(n + 1)

    @property
    def spread_root(self) -> np.ndarray:
        """The Cholesky factor of the covariance of the linear filter, row by row: other numbers in it are a covariance, too."""
        return self._root(self.spread)

    @spread_root.setter
    def spread_root(self, values: np.ndarray) -> None:
        self.spread = self._squared(values)

    @property
    def doubt_root(self) -> np.ndarray:
        """The same of the extended filter, 0 while that does not run."""
        return self._root(self.doubt) if self.sliding else np.zeros(self.below[0].size)

    @doubt_root.setter
    def doubt_root(self, values: np.ndarray) -> None:
        self.doubt = self._squared(values)

    def _root(self, covariance: np.ndarray) -> np.ndarray:
        """The Cholesky factor row by row, also of a covariance that is singular but for rounding, as one that a measurement has settled is."""
        sizes, axes = np.linalg.eigh(covariance)
        upper: np.ndarray = np.linalg.qr((axes * np.sqrt(np.maximum(sizes, 0.0))).T)[1]
        return (upper.T * np.where(np.diag(upper) < 0.0, -1.0, 1.0))[self.below]

    def _squared(self, values: np.ndarray) -> np.ndarray:
        root = np.zeros_like(self.spread)
        root[self.below] = values
        return root @ root.T

    @property
    def strength(self) -> float:
        """The factor s on the torque of the rock, while `sliding`."""
        return float(self.xi[-1])

    @staticmethod
    def _pushed(A: np.ndarray, B: np.ndarray, E: np.ndarray, period: float) -> np.ndarray:
        """Covariance of (x, T) after a period with white noise of intensity 1 in the drive's torque (C. F. Van Loan, 1978)."""
        from scipy.linalg import expm

        n = A.shape[0]
        F = np.block([[A, -E[:, None]], [np.zeros((1, n + 1))]])
        G = np.append(B, 0.0)
        both = expm(np.block([[-F, np.outer(G, G)], [np.zeros_like(F), F.T]]) * period)
        return both[n + 1 :, n + 1 :].T @ both[: n + 1, n + 1 :]

    def correct(self, y: np.ndarray) -> np.ndarray:
        seen = self.rows @ self.spread
        self.gain = np.linalg.solve(seen @ self.rows.T + self.noise, seen).T
        self.covariance = self.spread - self.gain @ seen
        z = super().correct(y)
        speed = float(self.bit @ z[:-1])
        self.turned = min(self.turned + 1, self.lasting) if speed > self.turning else 0
        if self.sliding:
            error = y - self.seen @ self.xi
            shared = self.doubt @ self.seen.T
            expected = self.seen @ shared + self.noise
            gain = np.linalg.solve(expected, shared.T).T
            self.surprise += 0.1 * (float(error @ np.linalg.solve(expected, error)) / error.size - self.surprise)
            self.xi = self.xi + gain @ error
            self.doubt = self.doubt - gain @ shared.T
            self.xi[-1] = min(max(self.xi[-1], 0.5), 2.0)
            if self.surprise > SURPRISE or float(self.bit @ self.xi[:-1]) < 0.5 * self.turning:
                self.sliding, self.turned = False, 0
        elif self.turned >= self.lasting:
            self._begin(speed)
        return self._seen() if self.sliding else z

    def _begin(self, speed: float) -> None:
        """Take over the estimate and covariance of the linear filter, T being s times the torque of the law."""
        torque, slope = self.rock(speed)
        s = float(np.clip(self.z[-1] / torque, 0.5, 2.0))
        turn = np.eye(self.z.size)
        turn[-1, -1] = 1.0 / torque
        turn[-1, :-1] = -s * slope / torque * self.bit
        self.xi = np.append(self.z[:-1], s)
        self.doubt = turn @ self.covariance @ turn.T
        self.surprise, self.sliding = 1.0, True

    def _seen(self, xi: np.ndarray | None = None) -> np.ndarray:
        """(x, T) of a state (x, s)."""
        xi = self.xi if xi is None else xi
        return np.append(xi[:-1], xi[-1] * self.rock(max(float(self.bit @ xi[:-1]), 0.0))[0])

    def _moved(self, xi: np.ndarray, command: float, duration: float) -> np.ndarray:
        self.rollout.scale[self.contact] = xi[-1]
        return np.append(self.rollout.states(xi[:-1], np.array([[command]]), duration)[0][1], xi[-1])

    def arrival(self) -> np.ndarray:
        if not self.sliding:
            return super().arrival()
        xi = self.xi
        if self.part:
            xi = self._moved(xi, self.waiting[0], self.part)
        for command in self.waiting[1:]:
            xi = self._moved(xi, command, self.period)
        return self._seen(xi)

    def predict(self, command: float) -> None:
        commands = self.waiting[0], (np.append(self.waiting[1:], command))[0]
        super().predict(command)
        self.mean += (command - self.mean) * min(1.0, self.period / SETTLED)
        unknown = self.drive_process_noise**2 + (self.drive_torque_error * (command - self.mean)) ** 2 * MEMORY
        spread = self.whole @ self.covariance @ self.whole.T + self.still + unknown * self.pushed
        self.spread = 0.5 * (spread + spread.T)
        if not self.sliding:
            return
        n, nudge = self.xi.size - 1, 1e-6
        for acting, duration in zip(commands, (self.part, self.period - self.part), strict=True):
            if not duration:
                continue
            more = self._moved(self.xi + nudge * np.eye(n + 1)[n], acting, duration)
            self.rollout.scale[self.contact] = self.xi[-1]
            X, A, _, _ = self.rollout.advance(self.xi[:-1], np.array([[acting]]), duration)
            step = np.eye(n + 1)
            step[:n, :n], step[:n, n] = A[0], (more[:n] - X[1]) / nudge
            self.xi = np.append(X[1], self.xi[-1])
            self.doubt = step @ self.doubt @ step.T + (self.wander + unknown * self.shaken) * (duration / self.period)
        self.doubt = 0.5 * (self.doubt + self.doubt.T)
