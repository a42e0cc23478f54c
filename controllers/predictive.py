"""What predictive laws share: numbers, limits, the estimate they start from, the drive that stands in for them, and the record they keep."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from controllers.disturbance_filter import DisturbanceFilter, FilterModel
from controllers.quadratic_program import SOLVERS, Answer
from controllers.string_model import StringModel
from controllers.torque_limits import TorqueLimits
from controllers.watchdog import Watchdog
from toolbox import HybridSystem, Quantity, SceneError, quantity
from toolbox.authoring import check_fields, whole
from toolbox.modelling import OptionalQuantity, Quantities, Stateful

MOST_LATE = 1000
"""Commands on their way, in samples, that a law can remember."""


@dataclass(frozen=True, kw_only=True)
class Predictive(TorqueLimits):
    """Base class of predictive controllers of the top drive: plan the torques of `horizon` samples, apply the first one, and plan again.

    The cost of a plan is a sum of squared deviations, each in units of its scale (Bryson's rule): top speed and bit
    speed from the set-point, torque from the steady torque, and torque from one sample to the next. The Riccati
    solution is the cost after the horizon.

    Limits:

    - Limits of torque and torque rate are kept exactly.
    - Limits of speed and twist hold for the predicted string. With `soft_limits` they may be exceeded at a cost per
      unit (`violation_cost`) that no other gain can outweigh. Without `soft_limits` the program may have no solution.

    Estimation:

    - A stationary Kalman filter estimates the states of the string and the torque of the rock from the `sensors` with
      their noise. A constant unknown torque therefore leaves no steady error.
    - `drive_process_noise` represents unknown properties of the drive. Example: with an inertia that is 20 % wrong,
      commands that change by some kN m accelerate the top by a few hundred N m more or less than expected, for about a
      second. A filter with a small value (50 N m s^1/2) interprets this as motion of the bit, and the motor then swings
      between its limits while the bit is parked. `torque_step_scale` keeps the plan slower than the filter.

    Signals and timing:

    - The field `reference` is the operating point of the design and the default of the signal `top.reference` [rad/s].
      Every plan keeps its present value for the whole horizon.
    - `delay` is the time from a sample until its command reaches the plant. It may exceed the period.

    Fallback: every solution must satisfy the KKT conditions. An impedance drive takes over from the present torque if
    no solution does, or if `controllers.watchdog` finds that the string stands, or that the motor swings between its
    limits, for longer than `fallback_time`. `run.controllers[0].record` holds times and reasons of fallbacks and the
    computing time of each sample.

    Sampled only, with the sample time `period`.
    """

    sensors: tuple[str, ...] = ("top.speed",)
    sensor_noise: Quantities = quantity((0.01,), "1", "standard deviations of the measurement noise, in the units of the sensors", above=0)
    reference: Quantity = quantity(8.0, "rad/s", "set-point of the speed", above=0, typical_range=(0.05, 40.0))
    period: Quantity = quantity(0.1, "s", "sample time", above=0, typical_range=(1e-4, 5.0))
    delay: Quantity = quantity(0.0, "s", "time until a command reaches the plant", at_least=0)
    horizon: int = 40
    top_speed_scale: Quantity = quantity(8.0, "rad/s", "scale of the deviation of the top speed in the cost", above=0)
    bit_speed_scale: Quantity = quantity(2.0, "rad/s", "scale of the deviation of the bit speed in the cost", above=0)
    torque_scale: Quantity = quantity(20_000.0, "N m", "scale of the deviation of the torque in the cost", above=0)
    torque_step_scale: Quantity = quantity(20_000.0, "N m", "scale of the change of the torque per sample in the cost", above=0)
    highest_speed: OptionalQuantity = quantity(None, "rad/s", "highest top speed", above=0, typical_range=(0.05, 40.0))
    highest_twist: OptionalQuantity = quantity(None, "rad", "highest twist of the string in both directions", above=0)
    soft_limits: bool = True
    violation_cost: Quantity = quantity(1e3, "1", "cost of exceeding a limit of speed or twist by one scale", above=0)
    torque_process_noise: Quantity = quantity(
        2000.0, "N m s^-1/2", "standard deviation of the change of the bit torque in one second", above=0
    )
    drive_process_noise: Quantity = quantity(
        400.0, "N m s^1/2", "intensity of the white noise that represents errors of torque and inertia of the drive", at_least=0
    )
    fallback_time: Quantity = quantity(
        5.0, "s", "how long the string may stand, or the motor swing, before the soft drive takes over", above=0
    )
    solver: str = "daqp"
    warm_start: bool = True

    actuated_signals: ClassVar[tuple[str, ...]] = ("top.torque",)

    @property
    def measured_signals(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the measured signals: the sensors."""
        return self.sensors

    def check(self):
        super().check()
        whole("horizon", self.horizon, 1)
        if len(self.sensor_noise) != len(self.sensors) or not self.sensors:
            raise SceneError(
                f"Argument `sensor_noise` must have one entry for each of {', '.join(self.sensors)}, but it has {len(self.sensor_noise)}."
            )
        if not self.delay / self.period <= MOST_LATE:
            raise SceneError(f"Argument `delay` must be at most {MOST_LATE} periods of {self.period:g} s, but it is {self.delay:g} s.")
        if self.solver not in SOLVERS:
            raise SceneError(f"Argument `solver` must be one of {', '.join(SOLVERS)}, but it is {self.solver!r}.")


@dataclass
class Record:
    """Record of a predictive law: `fallbacks` (time [s], reason), `seconds` per sample, number of solved programs, and the last answer.

    print(record) gives the count of fallbacks and median, 99th percentile and maximum of the time per sample.
    """

    fallbacks: list[tuple[float, str]] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    programs: int = 0
    answer: Answer | None = None

    @property
    def median(self) -> float:
        """Median time of a sample [s]."""
        return float(np.median(self.seconds))

    @property
    def p99(self) -> float:
        """99th percentile of the time of a sample [s]."""
        return float(np.percentile(self.seconds, 99))

    @property
    def longest(self) -> float:
        """Longest time of a sample [s]."""
        return float(np.max(self.seconds))

    def __str__(self) -> str:
        if not self.seconds:
            return "no samples"
        when = f", first at {self.fallbacks[0][0]:g} s: {self.fallbacks[0][1]}" if self.fallbacks else ""
        return (
            f"{len(self.seconds)} samples, {len(self.fallbacks)} fallbacks{when}; per sample median {1e3 * self.median:.3g} ms, "
            f"p99 {1e3 * self.p99:.3g} ms, longest {1e3 * self.longest:.3g} ms"
        )


class SoftDrive(Stateful):
    """The drive that stands in: PI on the top speed with the impedance of the string, started from the torque that was.

        proportional = sqrt(k J_b),   integral = proportional sqrt(k / J_b) / 5

    The integral is slow, a fifth of the string's own frequency, so that the impedance stays where the string swings; see `controllers.ZTorque`.
    """

    memory_fields: ClassVar[tuple[str, ...]] = ("acts", "offset")

    def __init__(self, law: Predictive, plant: HybridSystem):
        try:
            inertia, stiffness = plant.parameter("chain.inertia"), plant.parameter("chain.stiffness")
        except SceneError as error:
            raise SceneError(f"{type(law).__name__} falls back on soft torque, which is designed on a chain of inertias: {error}") from None
        series, below = 1.0 / float(np.sum(1.0 / stiffness)), float(np.sum(inertia[1:]))
        self.proportional = float(np.sqrt(series * below))
        self.integral = self.proportional * float(np.sqrt(series / below)) / 5
        self.acts, self.offset = False, 0.0

    def torque(self, error: float, last: float, period: float) -> float:
        """Return the torque for a speed error [rad/s]. After `rest` the torque begins at `last` [N m]."""
        if not self.acts:
            self.acts, self.offset = True, last - self.proportional * error
        self.offset += self.integral * period * error
        return self.offset + self.proportional * error

    def rest(self) -> None:
        """Forget the integral: the predictive law acts again."""
        self.acts, self.offset = False, 0.0


class PredictiveLaw(Stateful):
    """A designed predictive law: a callable (t, y) -> torque with a memory. `plan` of a subclass makes the torques, or None with a reason.

    y: the sensors, then the torque that is held at the top and `top.reference`, which may be left out: no torque acts, and the set-point stays what it was. At
    the first sample under a torque the estimate begins at the string that turns steadily at its measured top speed under that torque.
    """

    measured_signals: tuple[str, ...]
    actuated_signals = ("top.torque",)
    memory_fields: ClassVar[tuple[str, ...]] = ("filter", "drive", "watchdog", "reference", "started")

    def __init__(self, law: Predictive, plant: HybridSystem, model: StringModel, A: np.ndarray):
        check_fields(law)
        self.law, self.measured_signals, self.dt = law, law.sensors, law.period
        self.model = model
        sensors = sensor_rows(plant, law.sensors)
        self.filter = DisturbanceFilter(
            FilterModel(
                A, model.B, model.E, sensors, law.period, law.delay, law.sensor_noise, law.torque_process_noise, law.drive_process_noise
            )
        )
        self.drive = SoftDrive(law, plant)
        self.watchdog = Watchdog(law.period, law.fallback_time, law.lowest_torque, law.highest_torque)
        self.reference = float(law.reference)
        self.defaults = {"top.torque": (0.0, "N m"), "top.reference": (self.reference, "rad/s")}
        self.steady_string = steady_string(A, model, sensors)
        self.top = sensor_rows(plant, ("top.speed",))[0]
        self.lowest = -np.inf if law.lowest_torque is None else law.lowest_torque
        self.highest = np.inf if law.highest_torque is None else law.highest_torque
        self.rate = np.inf if law.torque_rate is None else law.torque_rate * law.period
        self.started = False
        self.record = Record()

    def design(self, plant: HybridSystem) -> PredictiveLaw:
        """Itself: it is designed."""
        return self

    @property
    def last(self) -> float:
        """The last command [N m]."""
        return float(self.filter.waiting[-1])

    @property
    def signal_limits(self) -> dict[str, tuple[float | None, float | None]]:
        """The limits of the torque, for whoever draws it."""
        return self.law.signal_limits

    def plan(self, z: np.ndarray) -> tuple[float | None, str]:
        """Return the torque for the estimate z = (x, T) at the instant at which the torque will act, and the reason if there is none
        (None)."""
        raise NotImplementedError

    def begin(self, y: np.ndarray, torque: float) -> None:
        """Take over, at the first sample of the sensors, from a drive with this torque [N m]."""
        estimate = self.steady_string @ np.append(y, torque)
        self.filter.z, self.filter.waiting[:] = estimate, torque
        self.watchdog.speed, self.watchdog.load = float(self.top @ estimate[:-1]), float(self.model.load @ estimate[:-1])

    def __call__(self, t: float, y: Any) -> float:
        began = time.perf_counter()
        y = np.asarray(y, float)
        if y.size > len(self.measured_signals):
            self.reference = float(y[-1])
        if not self.started and y.size > len(self.measured_signals) + 1 and y[-2] != 0.0:
            self.begin(y[: len(self.measured_signals)], float(y[-2]))
        estimate = self.filter.correct(y[: len(self.measured_signals)])
        wanted, reason = self.plan(self.filter.arrival())
        reason = self.watchdog(float(self.top @ estimate[:-1]), float(self.model.load @ estimate[:-1]), self.last, self.reference) or reason
        if reason or wanted is None:
            self.record.fallbacks.append((float(t), reason))
            wanted = self.drive.torque(self.reference - float(self.top @ estimate[:-1]), self.last, self.law.period)
        else:
            self.drive.rest()
        command = self.within(wanted, self.last)
        self.filter.predict(command)
        self.started = True
        self.record.seconds.append(time.perf_counter() - began)
        return command

    def within(self, torque: float, last: float) -> float:
        """The torque inside its limits, exactly."""
        return float(min(max(min(max(torque, last - self.rate), last + self.rate), self.lowest), self.highest))


def sensor_rows(plant: HybridSystem, sensors: tuple[str, ...]) -> np.ndarray:
    """Return rows that map the states of the string to the sensors. SceneError is raised for a sensor that is unknown or not linear in the
    states."""
    rows = []
    for name in sensors:
        found = plant.state_index(name)
        if found is not None and found[1] is None:
            rows.append(np.eye(plant.x.numel())[found[0]])
            continue
        expression = plant.expression(name)
        slope = ca.jacobian(expression, plant.x)
        if expression.numel() != 1 or ca.depends_on(slope, plant.x) or ca.depends_on(expression, ca.vertcat(plant.u, plant.F, plant.t)):
            raise SceneError(f"A predictive law measures single signals that are linear in the states, but `{name}` is not one.")
        rows.append(np.array(ca.Function("row", [plant.p], [ca.densify(slope)])(plant.values)).ravel())
    return np.array(rows)


def twist_row(model: StringModel) -> np.ndarray:
    """The row that gives the twist of the whole string."""
    return np.array([float(name.startswith("chain.twist")) for name in model.states])


def riccati(A: np.ndarray, B: np.ndarray, law: Predictive, model: StringModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(P, K, Q) of the regulator on (x, last torque) in N m, whose input is the change of the torque.

    P: cost of what comes after the horizon, K: its gain, change = -K (x, last torque);  Q: cost of x in one sample.
    """
    from scipy.linalg import solve_discrete_are

    n = A.shape[0]
    F = np.block([[A, B[:, None]], [np.zeros((1, n)), np.ones((1, 1))]])
    G = np.append(B, 1.0)[:, None]
    Q = np.outer(model.top, model.top) / law.top_speed_scale**2 + np.outer(model.bit, model.bit) / law.bit_speed_scale**2
    effort = 1.0 / law.torque_scale**2
    cost = np.zeros((n + 1, n + 1))
    cost[:n, :n], cost[n, n] = Q, effort
    cross = np.zeros((n + 1, 1))
    cross[n, 0] = effort
    own = np.array([[effort + 1.0 / law.torque_step_scale**2]])
    unit = np.append(np.ones(n), law.torque_scale)  # torques in their size, for a well-scaled equation
    F, G = F * unit / unit[:, None], G * law.torque_scale / unit[:, None]
    cost, cross, own = cost * np.outer(unit, unit), cross * unit[:, None] * law.torque_scale, own * law.torque_scale**2
    P = solve_discrete_are(F, G, cost, own, s=cross)
    K = np.linalg.solve(own + G.T @ P @ G, G.T @ P @ F + cross.T)
    return P / np.outer(unit, unit), (law.torque_scale * K / unit).ravel(), Q


def steady(A: np.ndarray, model: StringModel, reference: float, torque: float) -> tuple[np.ndarray, float]:
    """(x, u) of the string turning at `reference` under the torque T on its bit: 0 = A x + B u - E T, top speed = reference."""
    n = A.shape[0]
    matrix = np.vstack([np.column_stack([A, model.B]), np.append(model.top, 0.0)])
    found = np.linalg.lstsq(matrix, np.append(model.E * torque, reference), rcond=1e-13)[0]
    return found[:n], float(found[n])


def steady_string(A: np.ndarray, model: StringModel, sensors: np.ndarray) -> np.ndarray:
    """Return the matrix that maps sensors and torque u to (x, T) of the steady string: 0 = A x + B u - E T, C x = y, by least squares."""
    n, m = A.shape[0], sensors.shape[0]
    size = np.append(np.ones(n), 1e4)  # torques in 10 kN m
    still = 1e3 * np.column_stack([A, -model.E])  # the balance counts before the noise of the sensors
    matrix = np.vstack([still, np.column_stack([sensors, np.zeros(m)])]) * size
    right = np.block([[np.zeros((n, m)), -1e3 * model.B[:, None]], [np.eye(m), np.zeros((m, 1))]])
    return size[:, None] * np.linalg.lstsq(matrix, right, rcond=1e-13)[0]
