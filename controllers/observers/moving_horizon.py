"""Moving-horizon observer of a drill string: constrained least squares over the last samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from controllers.disturbance_filter import DisturbanceFilter, FilterModel
from controllers.quadratic_program import SOLVERS, QuadraticProgram
from controllers.string_model import StringModel, rock_table, string_model
from toolbox import HybridSystem, Quantity, SceneError, quantity
from toolbox.authoring import check_fields, whole
from toolbox.modelling import Observer, OptionalQuantity


@dataclass(frozen=True, kw_only=True)
class MovingHorizon(Observer):
    """Moving-horizon observer of the string: it fits the last samples under constraints on bit speed and bit torque.

        min |z_(k-N) - z-_(k-N)|^2_P + sum_(j=k-N)^(k-1) |w_j|^2_Q + sum_(j=k-N)^k |y_j - C z_j|^2_R   over z_(k-N), w
        z_(j+1) = F z_j + G u_j + w_j,   bit speed >= lowest_speed,   T >= lowest_torque at every j

    By default the constraints are that the bit does not turn backwards and that the rock does not drive the bit.

    k is the present sample and N the field `window`. z = (x, T) contains the states of the string and the torque of the
    rock, which is a random walk as in `Kalman`. y_j is the measured top speed, u_j the torque of the drive, w_j the
    process noise, and z-_(k-N) the prediction for the beginning of the window. |e|_P^2 = e' P^-1 e, with the
    covariances P, Q and R of these errors.

    - P is the covariance of the stationary Kalman filter (arrival cost). Without active limits the estimate therefore
      equals the estimate of the Kalman filter, for every window.
    - `lowest_speed` and `lowest_torque` are the limits. None removes a limit.
    - If a solution does not satisfy its KKT conditions, the correction of the Kalman filter is used instead of the
      solution, and the case is counted in `failures`.
    - Before the first sample the string is assumed at rest.

    Estimates: all states of the string by name, `top.speed` and `bit.speed` [rad/s], `top.load` and `bit.torque` [N m].
    `delay` is the time from a sample until its command reaches the plant [s]. Use the observer inside
    `ObserverBasedController`, sampled at `period`. It runs in Python, and the run keeps its estimates in
    `run.controllers[0].estimates`.

    Source: C. V. Rao, J. B. Rawlings, D. Q. Mayne, IEEE Trans. Autom. Control 48 (2003) 246-258.

    Examples
    --------
    >>> from controllers.observers import MovingHorizon
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> estimator = MovingHorizon(window=5).create_estimator(compose(wells.JANSEN_2, BitRock(weight="97 kN")))
    >>> print(f"{estimator.estimate([0.1])['top.speed']:.3f} rad/s after one measured top speed of 0.1 rad/s")
    0.056 rad/s after one measured top speed of 0.1 rad/s
    """

    measured_signals: ClassVar[tuple[str, ...]] = ("top.speed",)
    estimates: ClassVar[tuple[str, ...]] = ("top.speed", "bit.speed", "top.load", "bit.torque", "bit.friction_scale")

    window: int = 20
    period: Quantity = quantity(0.05, "s", "sample time", above=0, typical_range=(1e-4, 5.0))
    delay: Quantity = quantity(0.0, "s", "time until a command reaches the plant", at_least=0)
    speed_noise: Quantity = quantity(0.01, "rad/s", "standard deviation of the measured top speed", above=0)
    torque_process_noise: Quantity = quantity(
        8000.0, "N m s^-0.5", "standard deviation of the change of the bit torque in one second", above=0
    )
    drive_process_noise: Quantity = quantity(50.0, "N m s^0.5", "white noise of the drive's torque", at_least=0)
    lowest_speed: OptionalQuantity = quantity(0.0, "rad/s", "lowest bit speed")
    lowest_torque: OptionalQuantity = quantity(0.0, "N m", "lowest torque of the rock; 0 keeps the friction scale from being negative")
    solver: str = "daqp"

    def check(self):
        whole("window", self.window, 1)
        if self.solver not in SOLVERS:
            raise SceneError(f"Argument `solver` must be one of {', '.join(SOLVERS)}, but it is {self.solver!r}.")

    def create_estimator(self, plant: HybridSystem) -> HorizonFilter:
        """Return the estimator for a plant: an object that computes estimates from the measured signals of each sample.

        Parameters
        ----------
        plant
            The plant whose signals are estimated.
        """
        return HorizonFilter(self, plant)


class HorizonFilter(DisturbanceFilter):
    """A designed `MovingHorizon`: `estimate(y)` at a sample, then `predict(command)`."""

    memory_fields: ClassVar[tuple[str, ...]] = (*DisturbanceFilter.memory_fields, "measured", "pushed", "begun")

    def __init__(self, observer: MovingHorizon, plant: HybridSystem):
        check_fields(observer)
        self.model: StringModel = string_model(plant)
        model, N = self.model, observer.window
        super().__init__(FilterModel(
            model.A, model.B, model.E, model.top[None, :], observer.period, observer.delay, (observer.speed_noise,),
            observer.torque_process_noise, observer.drive_process_noise,
        ))  # fmt: skip
        self.period = observer.period
        self.table = rock_table(plant)
        self.failures = 0
        n = self.z.size
        first, later = _root(self.spread, self.unit), _root(self.walk, self.unit)
        width = first.shape[1] + N * later.shape[1]
        # z_j = free_j z- + (what the commands do) + forced_j (unknowns of unit variance)
        self.forced = np.zeros((N + 1, n, width))
        self.forced[0, :, : first.shape[1]] = first
        for j in range(N):
            self.forced[j + 1] = self.whole @ self.forced[j]
            begin = first.shape[1] + j * later.shape[1]
            self.forced[j + 1, :, begin : begin + later.shape[1]] += later
        self.seen = (self.rows / observer.speed_noise)[0]
        self.fit = self.seen @ self.forced  # (N + 1, width)
        limits = [(np.append(model.bit, 0.0), observer.lowest_speed)]
        torque = None if observer.lowest_torque is None else observer.lowest_torque / self.unit[-1]
        limits.append((np.eye(n)[-1] / self.unit[-1], torque))
        kept = [(row, low) for row, low in limits if low is not None]
        self.limits = np.array([row for row, _ in kept]).reshape(len(kept), n)
        self.lows = np.array([low for _, low in kept])
        # unknowns in which the Hessian is 1 (see `controllers.linear_mpc`)
        self.back = np.linalg.inv(np.linalg.cholesky(np.eye(width) + self.fit.T @ self.fit).T)
        rows = np.einsum("in,jnw->jiw", self.limits, self.forced).reshape(-1, width) @ self.back
        self.program = QuadraticProgram(np.eye(width), rows, observer.solver)
        self.free = np.full(width, np.inf)
        self.measured, self.pushed, self.begun = np.zeros(N + 1), np.zeros((N, n)), np.zeros((N + 1, n))

    def correct(self, y: np.ndarray) -> np.ndarray:
        N = self.pushed.shape[0]
        self.measured[:-1] = self.measured[1:]
        self.measured[-1] = y[0]
        self.begun[:-1] = self.begun[1:]
        self.begun[-1] = self.z
        motion = np.empty((N + 1, self.z.size))
        motion[0] = self.begun[0]
        for j in range(N):
            motion[j + 1] = self.whole @ motion[j] + self.pushed[j]
        missed = self.measured / np.sqrt(self.noise[0, 0]) - motion @ self.seen
        gradient = -self.back.T @ (self.fit.T @ missed)
        low = (self.lows - motion @ self.limits.T).ravel()
        answer = self.program.solve(gradient, np.append(-self.free, low), np.append(self.free, np.full(low.size, np.inf)))
        if answer.sound:
            self.z = motion[-1] + self.forced[-1] @ (self.back @ answer.z)
        else:
            self.failures += 1
            self.z = super().correct(y)
        return self.z

    def predict(self, command: float) -> None:
        before = self.z
        super().predict(command)
        self.pushed[:-1] = self.pushed[1:]
        self.pushed[-1] = self.z - self.whole @ before

    def estimate(self, y: np.ndarray) -> Mapping[str, float]:
        """The estimates at a sample with measurement y, by name."""
        z = self.correct(np.asarray(y, float))
        speed = float(self.model.bit @ z[:-1])
        found: dict[str, Any] = dict(zip(self.model.states, z[:-1].tolist(), strict=True))
        torque = float(z[-1])
        return found | {
            "top.speed": float(self.model.top @ z[:-1]),
            "bit.speed": speed,
            "top.load": float(self.model.load @ z[:-1]),
            "bit.torque": torque,
            "bit.friction_scale": torque / float(np.interp(abs(speed), *self.table)),
        }


def _root(covariance: np.ndarray, unit: np.ndarray) -> np.ndarray:
    """A matrix S with S S' = covariance, of as many columns as it has rank."""
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    kept = values > 1e-14 * values[-1]
    return unit[:, None] * vectors[:, kept] * np.sqrt(values[kept])
