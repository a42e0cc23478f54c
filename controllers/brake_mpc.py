"""Model predictive control of a stop: the force of the pads planned ahead, below the force at which they groan."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from controllers.brake_law import BrakeLaw
from controllers.predictive import Record
from controllers.quadratic_program import SOLVERS, QuadraticProgram
from toolbox import HybridSystem, Quantity, SceneError, quantity
from toolbox.authoring import check_fields, whole
from toolbox.modelling import OptionalQuantity, Stateful


@dataclass(frozen=True, kw_only=True)
class BrakeMPC(BrakeLaw):
    """Model predictive control of a stop, below the force at which the pad groans.

    In each sample the controller plans `horizon` forces so that speed and angle of the disc follow the plan of the
    stop:

        n_(k+1) = n_k + alpha (u_k - n_k),   w_(k+1) = w_k - (2 r mu h / I) n_(k+1),   z_(k+1) = z_k + h (w_(k+1) - w_p)
        min sum_k ((w_k - w_p) / speed_scale)^2 + (z_k / angle_scale)^2 + ((u_k - u_(k-1)) / force_step_scale)^2 + violation_cost (excess + excess^2 / 2)
        n_k <= margin N(w_k) + excess,   lowest_force <= u_k <= highest_force,   |u_k - u_(k-1)| <= force_rate h

    - u is the command, n the force of one pad, w the speed of the disc, w_p the planned speed, z the error of the
      angle, and h the sample time `period`. r is the effective radius of the pads and I the inertia on the disc.
    - excess >= 0 is the force by which the plan violates the border of groan.
    - alpha = 1 - exp(-h / lag). The time constant `lag` of the actuator is read from the plant if it is not given.
    - mu = T / (2 r n) is the measured coefficient of friction, averaged over `filter_time`. T is the brake torque.
    - N(w) is the border of groan: the force of one pad above which the pad groans, at the disc speed w. A border N_0
      exp(q w) is convex in w. The program uses its tangents at the last prediction, which lie below the border. A
      border that is constant in pieces, for example from a friction table, is taken at the speed of the last
      prediction.

    The controller predicts the border. It therefore brakes harder than the plan before it must reduce the force. This
    increase of the force is as fast as `force_rate` allows, and so is the jerk of the car. A `jerk` or `car_jerk` limits
    it:

        |u_k - u_(k-1)| <= h I jerk / (2 r mu)        jerk = car_jerk / wheel_radius

    The forces u are in N, h in s, I in kg m2, `jerk` in rad/s3, r in m, `car_jerk` in m/s3, and the field `wheel_radius`
    of the `DiscBrake` in m. mu [1] is the measured friction. The limit always holds while the force falls. While the
    force rises, it holds from the sample on at which the force of the planned deceleration is reached for the first time.

    The plan of the stop and the limits of the command are described in the base class `controllers.brake_law.BrakeLaw`.

    A solution that does not satisfy its KKT conditions is rejected, and the controller continues with its last plan.
    `run.controllers[0].record` holds computing times and fallbacks. The controller runs sampled only, with the sample
    time `period`.

    Examples
    --------
    >>> from controllers import BrakeMPC
    >>> from models import DiscBrake
    >>> from toolbox import compose
    >>> planned = BrakeMPC(deceleration=2.5).design(compose(DiscBrake()))
    >>> print(f"{planned(0.0, [6.0, 0.0]):.0f} N at the first sample, from a disc speed of 6 rad/s and without brake torque")
    296 N at the first sample, from a disc speed of 6 rad/s and without brake torque
    """

    measured_signals: ClassVar[tuple[str, ...]] = ("disc.speed", "brake.torque")

    margin: OptionalQuantity = quantity(0.8, "1", "allowed force as a fraction of the border of groan", above=0)
    period: Quantity = quantity(
        0.03, "s", "sample time; 1.5 periods of the default pad, because steps at the period of the pad would excite it", above=0
    )
    horizon: int = 60
    speed_scale: Quantity = quantity(0.2, "rad/s", "scale of the deviation of the speed in the cost", above=0)
    angle_scale: Quantity = quantity(0.05, "rad", "scale of the deviation of the angle in the cost", above=0)
    force_step_scale: Quantity = quantity(100.0, "N", "scale of the change of the force per sample in the cost", above=0)
    violation_cost: Quantity = quantity(1e5, "1", "cost of passing the border of groan by 1000 N", above=0)
    filter_time: Quantity = quantity(0.1, "s", "time over which the friction is averaged", at_least=0)
    lag: OptionalQuantity = quantity(None, "s", "time constant of the actuator", at_least=0)
    solver: str = "daqp"

    def check(self):
        super().check()
        whole("horizon", self.horizon, 2)
        if self.solver not in SOLVERS:
            raise SceneError(f"Argument `solver` must be one of {', '.join(SOLVERS)}, but it is {self.solver!r}.")

    def design(self, plant: HybridSystem) -> PlannedStop:
        """Return the controller for this plant as a callable (t, y) -> force [N], which is called once per sample.

        y is the array (disc speed [rad/s], brake torque [N m]). The callable remembers its last plan and the averaged
        friction from sample to sample.

        Parameters
        ----------
        plant
            The plant on which the controller is designed.
        """
        check_fields(self)
        lag = self.lag
        if lag is None:
            lag = next((float(plant.parameter(name)) for name in ("disc.lag", "actuator.lag") if name in plant.parameters), 0.0)
        return PlannedStop(super().design(plant), lag)


UNIT = 1000.0
"""Unit of the forces in the program [N]."""


EARLIER = 0.8
"""Jerk along which the border falls in the program, as a fraction of the largest jerk: the force then stays below the border without the largest jerk."""


class PlannedStop(Stateful):
    """A designed `BrakeMPC`: a callable (t, y) -> force with a memory. The unknowns are the forces, then the excess over the border, in kN."""

    measured_signals = BrakeMPC.measured_signals
    actuated_signals = BrakeMPC.actuated_signals
    memory_fields: ClassVar[tuple[str, ...]] = (
        "samples", "last", "normal", "excess", "begin", "friction", "plan", "planned", "speeds", "applied",
    )  # fmt: skip

    @property
    def signal_limits(self) -> dict[str, tuple[float | None, float | None]]:
        """The limits of the force, for whoever draws it."""
        return self.law.signal_limits

    def __init__(self, law: BrakeMPC, lag: float):
        self.law: Any = law
        self.eased: Any = law if law.jerk is None else replace(law, jerk=EARLIER * law.jerk)
        self.dt = law.period
        N = law.horizon
        self.keep = float(np.exp(-law.period / lag)) if lag > 0.0 else 0.0
        power = np.arange(N)[:, None] - np.arange(N)
        self.free = self.keep ** np.arange(1, N + 1)
        self.forced = np.where(power >= 0, (1.0 - self.keep) * self.keep ** np.maximum(power, 0), 0.0)
        self.sum = np.tril(np.ones((N, N)))
        moves = np.eye(N) - np.eye(N, k=-1)
        self.curvature = (UNIT / law.force_step_scale) ** 2 * moves.T @ moves
        slack = self.slack = 0 if law.margin is None else 1
        self.rows = np.zeros((N * (1 + slack), N + slack))
        self.rows[:N, :N] = moves
        self.program = QuadraticProgram(np.eye(N + slack), self.rows, law.solver)
        self.samples, self.last, self.normal, self.excess, self.begin = 0, 0.0, 0.0, 0.0, 0.0
        self.friction = law.friction
        self.step = np.inf if law.force_rate is None else law.force_rate * law.period
        self.plan = np.zeros(N)
        self.planned, self.speeds, self.applied = False, np.zeros(N), False
        self.record = Record()

    def design(self, plant: HybridSystem) -> PlannedStop:
        """Itself: it is designed."""
        return self

    def __call__(self, t: float, y: Any) -> float:
        began = time.perf_counter()
        law, (speed, torque) = self.law, (float(value) for value in y)
        if not self.samples:
            self.begin = speed
        wish = np.maximum(self.begin - law.deceleration * law.period * (self.samples + np.arange(law.horizon + 1)), 0.0)
        command = self.last
        if speed > 0.0:
            self._learn(torque)
            reason = self._solved(speed, wish)
            if reason:
                self.record.fallbacks.append((float(t), reason))
                self.plan = np.append(self.plan[1:], self.plan[-1])
            command = self.within(float(self.plan[0]))
        self.excess += law.period * (speed - wish[0])
        self.normal += (1.0 - self.keep) * (command - self.normal)
        self.last = command
        self.applied = self.applied or command >= 0.999 * law.force_for(law.deceleration, self.friction)
        self.samples += 1
        self.record.seconds.append(time.perf_counter() - began)
        return command

    def moves(self) -> tuple[float, np.ndarray]:
        """Largest decrease and, for each planned sample, largest increase of the force [N], by its rate and by the jerk under the friction as averaged.

        Until the force of the planned deceleration is reached first, it increases at its rate.
        """
        law = self.law
        step = self.step if law.jerk is None else min(self.step, law.period * law.force_for(law.jerk, self.friction))
        if self.applied or step == self.step:
            return step, np.full(law.horizon, step)
        missing = law.force_for(law.deceleration, self.friction) - self.last
        risen = np.append(0.0, np.cumsum(np.full(law.horizon - 1, self.step)))
        return step, np.maximum(np.minimum(self.step, missing - risen), step)

    def within(self, force: float) -> float:
        """Return the force within its limits, exactly. A force below the lowest force rises at the highest rate."""
        law, (decrease, rises) = self.law, self.moves()
        force = min(max(force, law.lowest_force), law.highest_force)
        return min(max(force, self.last - decrease), self.last + float(rises[0]))

    def _learn(self, torque: float) -> None:
        law = self.law
        if self.normal >= 0.5 * law.lowest_force:
            seen = torque / (2.0 * law.radius * self.normal)
            seen = min(max(seen, 0.5 * law.friction), 2.0 * law.friction)
            self.friction += law.period / (law.period + law.filter_time) * (seen - self.friction)

    def _solved(self, speed: float, wish: np.ndarray) -> str:
        """Plan anew; why that failed, or nothing."""
        law, N, h = self.law, self.law.horizon, self.law.period
        fall = 2.0 * law.radius * self.friction * h / law.inertia
        start = self.normal * self.free
        S = -fall * UNIT * self.sum @ self.forced  # speeds = offset + S u
        offset = speed - fall * self.sum @ start
        error, total = offset - wish[1:], self.excess + h * (speed - wish[0])
        Z, angle = h * self.sum @ S, total + h * self.sum @ error
        H = np.zeros((N + self.slack, N + self.slack))
        g = np.zeros(N + self.slack)
        H[:N, :N] = S.T @ S / law.speed_scale**2 + Z.T @ Z / law.angle_scale**2 + self.curvature
        g[:N] = S.T @ error / law.speed_scale**2 + Z.T @ angle / law.angle_scale**2
        g[0] -= UNIT * self.last / law.force_step_scale**2
        low = np.full(N + self.slack, law.lowest_force / UNIT)
        high = np.full(N + self.slack, law.highest_force / UNIT)
        decrease, rises = self.moves()
        low[:N] = np.minimum(low[:N], (self.last + np.cumsum(rises)) / UNIT)  # a force still rising to its lowest value
        below, above = np.full(N, -decrease / UNIT), rises / UNIT
        below[0] += self.last / UNIT
        above[0] += self.last / UNIT
        if self.slack:
            low[N], high[N] = 0.0, np.inf
            H[N, N], g[N] = law.violation_cost, law.violation_cost
            around = np.maximum(np.append(self.speeds[1:], self.speeds[-1]) if self.planned else wish[1:], 0.0)
            border = self.eased.highest_eased(around) / UNIT
            growth = law.border_growth if law.border_forces is None else 0.0
            self.rows[N:, :N] = self.forced - (growth * border)[:, None] * S
            self.rows[N:, N] = -1.0
            below = np.append(below, np.full(N, -np.inf))
            above = np.append(above, border * (1.0 + growth * (offset - around)) - start / UNIT)
        self.program.update(H, self.rows)
        answer = self.program.solve(g, np.append(low, below), np.append(high, above))
        self.record.answer = answer
        self.record.programs += 1
        if not answer.sound:
            return answer.reason
        self.plan = UNIT * answer.z[:N]
        self.planned, self.speeds = True, offset + S @ answer.z[:N]
        return ""
