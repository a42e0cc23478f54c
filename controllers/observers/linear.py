"""Linear observers of a drill string whose bit torque is an unknown disturbance.

    x_hat' = A x_hat + B u - E T_hat + L_x (w_top - w_top_hat),   T_hat' = L_T (w_top - w_top_hat)

x are twists and speeds of the string without its rock, T is the torque of the rock on the bit, known neither in size nor in law: a wandering
constant. The gain L is that of a Kalman filter, or places all poles at one bandwidth. Only the top speed and the torque command are read.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from controllers.bumpless import over
from controllers.string_model import StringModel, entries, string_model, with_entries
from toolbox import Equations, Quantity, SceneError, Update, quantity, state
from toolbox.halving import halved
from toolbox.modelling import Observer, OptionalQuantities

GROWN = 1e-6
"""What a mode may grow by in a sample: an undamped one loses or gains by round-off."""


@dataclass(frozen=True)
class StringObserver(Observer):
    """Base class of the observers of a string: the model with its disturbance, the estimates, and the integration of a sample.

        x_hat' = A x_hat + B u - E T_hat + L_x (w_top - w_top_hat),   T_hat' = L_T (w_top - w_top_hat)

    x are twists and speeds of the string without its rock. T is the torque of the rock, an unknown disturbance modelled
    as a random walk. Only the top speed and the torque command are measured.

    Estimates:

    - all states of the string by name, `top.speed` and `bit.speed` [rad/s], `top.load` and `bit.torque` [N m];
    - for a `BitRock` with exponential friction also `bit.friction_scale` [1]: the estimated rock torque as a multiple
      of the declared rock torque at the estimated speed. It is meaningful while the bit turns, and 0 if the declared
      torque is 0.

    A sample is one Runge-Kutta step of order four with constant measurement and command. Sample times that are too long
    for this step raise an error. For a Kalman filter the longest is about 2.8 J speed_noise sqrt(period) /
    drive_process_noise, with the inertia J of the drive.
    """

    measured_signals: ClassVar[tuple[str, ...]] = ("top.speed",)
    estimates: ClassVar[tuple[str, ...]] = ("top.speed", "bit.speed", "top.load", "bit.torque", "bit.friction_scale")

    states: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    model_indices: tuple[int, ...] = ()
    model: OptionalQuantities = quantity(
        None,
        "1",
        "rows of A, B', and the rows of top speed, bit speed and top load, where `model_indices` says (everywhere if empty); filled in by design",
    )
    gain: OptionalQuantities = quantity(None, "1", "L, the disturbance last; filled in by design")
    initial_state_map: OptionalQuantities = quantity(
        None, "1", "states per torque, then per top speed, of the string that turns steadily; filled in by design"
    )
    rock_friction: OptionalQuantities = quantity(
        None, "1", "torque of the rock at speed, its excess at rest [N m] and decay [s/rad]; filled in by design"
    )

    def gains(self, A: np.ndarray, B: np.ndarray, row: np.ndarray) -> np.ndarray:
        """The gain L for x' = A x, y = row x, with the disturbance as last state."""
        raise NotImplementedError

    def design(self, plant):
        """Return the observer with the model and gain of the plant; unchanged if it has a gain."""
        if self.gain is not None:
            return self
        model = string_model(plant)
        A, B, rows = with_disturbance(model)
        gain = self.gains(A, B, rows[0])
        try:
            size = plant.parameter("bit.weight") * plant.parameter("bit.radius")
            static, kinetic, decay = (plant.parameter(f"bit.friction.{name}") for name in ("static", "kinetic", "decay"))
            rock = (size * kinetic, size * (static - kinetic), decay)
        except SceneError:
            rock = None
        stacked = np.vstack([A, B, rows])
        places = entries(stacked)
        return replace(
            self, states=model.states, units=model.units, rock_friction=rock, model_indices=places, model=tuple(stacked.ravel()[list(places)].tolist()),
            gain=tuple(gain.ravel().tolist()), initial_state_map=tuple(steady_string(A, B, rows[0]).T.ravel().tolist()),
        )  # fmt: skip

    def begun(self, speed: Any, torque: Any) -> Any:
        """Return the state of a string that turns steadily at a top speed under a torque, for the start of the observer."""
        if self.initial_state_map is None:
            raise SceneError(f"{type(self).__name__} needs the plant it observes: call `design(plant)`.")
        n = len(self.initial_state_map) // 2
        return ca.vertcat(*self.initial_state_map[:n]) * torque + ca.vertcat(*self.initial_state_map[n:]) * speed

    def injection(self, error: Any) -> Any:
        """Return the factor of the gain, from the error w_top - w_top_hat."""
        return error

    def slope(self) -> float:
        """How much of the gain acts on a large difference of the measured and the estimated speed."""
        return 1.0

    def check_period(self, period):
        """Raise SceneError where samples are too far apart for the steps: estimates would swing ever more."""
        if self.gain is None or self.model is None:
            return
        n = len(self.gain)
        rows = np.zeros((n + 4, n))
        rows.ravel()[list(self.model_indices) or slice(None)] = self.model
        rates = np.linalg.eigvals(rows[:n] - self.slope() * np.outer(self.gain, rows[n + 1]))

        refuse_swinging(type(self).__name__, rates, period, "What trusts the measured speed less has slower poles.")

    def _stacked(self):
        """The number of states, and the rows of the model."""
        if self.gain is None or self.model is None:
            raise SceneError(f"{type(self).__name__} needs the plant it observes: call `design(plant)`.")
        n = len(self.gain)
        return n, with_entries((n + 4, n), self.model_indices, ca.vertcat(*self.model))

    def _equations(self, signal) -> tuple[Any, Any, dict[str, tuple[Any, str]]]:
        """State, its rate as a function of the state, and the estimates."""
        x = state("observer.state", "1", self._stacked()[0])
        speed, torque = signal("top.speed", "rad/s"), signal("top.torque", "N m")
        return x, self._rate(torque, speed), self.seen(x)

    def _rate(self, torque: Any, speed: Any = None) -> Any:
        """The rate as a function of the state, with a measured top speed or without."""
        n, stacked = self._stacked()
        A, B, L, top = stacked[:n, :], stacked[n, :].T, ca.vertcat(*(self.gain or ())), stacked[n + 1, :]

        def rate(z: Any) -> Any:
            free = A @ z + B * torque
            return free if speed is None else free + L * self.injection(speed - top @ z)

        return rate

    def moved(self, x: Any, torque: Any, duration: Any, speed: Any = None) -> Any:
        """The state after a duration [s] under a held torque [N m] and a measured top speed [rad/s], or with nothing measured."""
        return one_step(self._rate(torque, speed), x, duration)

    def seen(self, x: Any) -> dict[str, tuple[Any, str]]:
        """{signal: (estimate, unit)} of a state."""
        n, stacked = self._stacked()
        top, bit, load = (stacked[i, :] for i in range(n + 1, n + 4))
        estimates: dict[str, tuple[Any, str]] = {
            name: (x[i], unit) for i, (name, unit) in enumerate(zip(self.states, self.units, strict=True))
        }
        estimates |= {
            "top.speed": (top @ x, "rad/s"),
            "bit.speed": (bit @ x, "rad/s"),
            "top.load": (load @ x, "N m"),
            "bit.torque": (x[n - 1], "N m"),
        }
        if self.rock_friction is not None:
            at_speed, excess, decay = self.rock_friction
            estimates["bit.friction_scale"] = (over(x[n - 1], at_speed + excess * ca.exp(-decay * ca.fabs(bit @ x))), "1")
        return estimates

    def continuous(self, signal):
        x, rate, estimates = self._equations(signal)
        return Equations(flow={x: rate(x)}, outputs=estimates)

    def sampled(self, signal, period):
        x, rate, estimates = self._equations(signal)
        return Update({x: one_step(rate, x, period)}, estimates)


def one_step(rate: Any, x: Any, period: Any) -> Any:
    """A Runge-Kutta step of order four of x' = rate(x)."""
    a = rate(x)
    b = rate(x + period / 2 * a)
    c = rate(x + period / 2 * b)
    d = rate(x + period * c)
    return x + period / 6 * (a + 2 * b + 2 * c + d)


def refuse_swinging(law: str, rates: np.ndarray, period: float, remedy: str) -> None:
    """Raise SceneError if states with these poles [1/s] grow in Runge-Kutta steps of a period [s], although none of the poles grows."""

    def swings(time: float) -> bool:
        return bool((np.abs(one_step(lambda z: rates * z, np.ones(rates.size), time)) > 1.0 + GROWN).any())

    if swings(period):
        longest, _ = halved(swings, 0.0, period, 1e-3)
        raise SceneError(
            f"Argument `sample_time` must be at most {longest:.3g} s for {law} with these numbers, but it is {period:g} s: its fastest "
            f"pole is at {np.abs(rates).max():.3g} 1/s, and a sample is one Runge-Kutta step. {remedy}"
        )


def with_disturbance(model: StringModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B and the rows for top speed, bit speed and top load of the string with the torque of the rock as one more, constant state."""
    A = np.block([[model.A, -model.E[:, None]], [np.zeros((1, model.A.shape[0] + 1))]])
    rows = np.array([np.append(row, 0.0) for row in (model.top, model.bit, model.load)])
    return A, np.append(model.B, 0.0), rows


def steady_string(A: np.ndarray, B: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Columns z with A z + B u = 0 and row z = w for (u, w) = (1, 0) and (0, 1), z the states of the string and the torque of its rock."""
    n = A.shape[0]
    size = np.append(np.ones(n - 1), 1e4)  # torques in 10 kN m
    matrix = np.vstack([A * size, row * size])
    right = np.array([np.append(-B, 0.0), np.append(np.zeros(n), 1.0)]).T
    return size[:, None] * np.linalg.lstsq(matrix, right, rcond=1e-13)[0]


@dataclass(frozen=True)
class Kalman(StringObserver):
    """Stationary Kalman filter of the string, which estimates its states and the bit torque from the top speed and the torque of the drive.

    The gain is optimal for white noises of these intensities:

    - `speed_noise`: standard deviation of the measured top speed, at samples every `period`.
    - `torque_process_noise`: standard deviation of the change of the bit torque in one second. The bit torque is
      modelled as a random walk.
    - `drive_process_noise`: intensity of the white noise of the drive torque.

    `design` solves the Riccati equation (scipy).

    Estimates: all states of the string by name, `top.speed` and `bit.speed` [rad/s], `top.load` and `bit.torque` [N m].
    For a `BitRock` with exponential friction also `bit.friction_scale` [1]: the estimated rock torque as a multiple of
    the declared rock torque at the estimated speed.

    Source: R. E. Kalman, R. S. Bucy, J. Basic Eng. 83 (1961) 95-108.

    Examples
    --------
    >>> from controllers.observers import Kalman
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> kalman = Kalman().design(compose(wells.JANSEN_2, BitRock(weight="97 kN")))
    >>> print(dict(zip((*kalman.states, "bit.torque"), [round(gain, 1) for gain in kalman.gain])))
    {'chain.twist.0': -1166.9, 'chain.speed.0': 34.8, 'chain.speed.1': 6772.5, 'bit.torque': -8000000.0}
    """

    speed_noise: Quantity = quantity(0.01, "rad/s", "standard deviation of the measured top speed", above=0)
    period: Quantity = quantity(0.01, "s", "sample time of the measurement noise", above=0)
    torque_process_noise: Quantity = quantity(
        8000.0, "N m s^-0.5", "standard deviation of the change of the bit torque in one second", above=0
    )
    drive_process_noise: Quantity = quantity(50.0, "N m s^0.5", "white noise of the drive's torque", at_least=0)

    def gains(self, A, B, row):
        """Compute the gain L = P C' / R from the Riccati equation A P + P A' - P C' C P / R + Q = 0.

        A (n, n) and B (n,) are the matrices of the string with the bit torque as last state, and `row` (n,) is C, which
        gives the top speed. The result has the shape (n,).

        Parameters
        ----------
        A
            Matrix of the string with the bit torque as last state, shape (n, n).
        B
            Effect of the torque of the drive on these states, shape (n,).
        row
            Row that gives the top speed from these states, shape (n,).
        """
        from scipy.linalg import solve_continuous_are

        Q = self.drive_process_noise**2 * np.outer(B, B)
        Q[-1, -1] += self.torque_process_noise**2
        R = self.speed_noise**2 * self.period
        # scaled so that entries of speeds and torques are alike
        size = np.where(np.arange(A.shape[0]) == A.shape[0] - 1, self.torque_process_noise, 1.0)
        scaled = A * size[None, :] / size[:, None]
        P = solve_continuous_are(scaled.T, (row * size)[:, None], Q / np.outer(size, size), np.array([[R]]))
        return size * (P @ (row * size)) / R


@dataclass(frozen=True)
class DisturbanceObserver(StringObserver):
    """Disturbance observer of the string, which estimates its states and the bit torque from the top speed and the torque of the drive.

    All poles of the estimation error are at -bandwidth (Ackermann's formula). `bandwidth` is the only number to tune.
    With a larger bandwidth the estimate follows the rock sooner, but contains more noise.

    Estimates: all states of the string by name, `top.speed` and `bit.speed` [rad/s], `top.load` and `bit.torque` [N m].
    For a `BitRock` with exponential friction also `bit.friction_scale` [1]: the estimated rock torque as a multiple of
    the rock torque of the plant at the estimated speed.

    Source: textbook (pole placement: K. Ogata, Modern Control Engineering).

    Examples
    --------
    >>> from controllers.observers import DisturbanceObserver
    >>> from models import BitRock, wells
    >>> from toolbox import compose
    >>> observer = DisturbanceObserver(bandwidth=6.0).design(compose(wells.JANSEN_2, BitRock(weight="97 kN")))
    >>> print(dict(zip((*observer.states, "bit.torque"), [round(gain, 1) for gain in observer.gain])))
    {'chain.twist.0': -777.1, 'chain.speed.0': 23.6, 'chain.speed.1': 3351.9, 'bit.torque': -2174507.2}
    """

    bandwidth: Quantity = quantity(6.0, "rad/s", "distance of all poles from zero", above=0)

    def gains(self, A, B, row):
        """Compute the gain L with det(s - A + L C) = (s + bandwidth)^n.

        A (n, n) and B (n,) are the matrices of the string with the bit torque as last state, and `row` (n,) is C, which
        gives the top speed. The result has the shape (n,).

        Parameters
        ----------
        A
            Matrix of the string with the bit torque as last state, shape (n, n).
        B
            Effect of the torque of the drive on these states, shape (n,).
        row
            Row that gives the top speed from these states, shape (n,).
        """
        return placed(A, row, np.poly(np.full(A.shape[0], -self.bandwidth)))


def placed(A: np.ndarray, row: np.ndarray, polynomial: np.ndarray) -> np.ndarray:
    """Return the gain L that gives A - L row this characteristic polynomial (leading one first): L = p(A) O^-1 e_n, O the observability
    matrix."""
    n = A.shape[0]
    observability = np.array([row @ np.linalg.matrix_power(A, k) for k in range(n)])
    value = sum(coefficient * np.linalg.matrix_power(A, n - k) for k, coefficient in enumerate(polynomial))
    return value @ np.linalg.solve(observability, np.eye(n)[:, -1])
