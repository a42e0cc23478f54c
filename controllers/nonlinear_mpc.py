"""Nonlinear model predictive control of the top drive, on the set-valued model of the rock.

Why not tanh: a prediction with a regularised law whose peak lies below the break-away torque believes in a release that does not come, parks the string
just below it, and its solver reports success for ever. Here the prediction either keeps the exact modes, with release and re-sticking where the
model has them, or regularises with the peak of the set-valued law. In both, a rock that holds more than the model allows raises the estimate of its
strength, and while the bit is predicted to be stuck the plan winds up the string at the set-point instead of resting at the steady torque.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from controllers.disturbance_filter import FilterModel
from controllers.predictive import Predictive, PredictiveLaw, Record, riccati, sensor_rows, steady, twist_row
from controllers.quadratic_program import QuadraticProgram
from controllers.rock_filter import RockFilter
from controllers.string_model import drilling_point, rock_table, string_model, without_actuators
from toolbox import HybridSystem, Quantity, SceneError, quantity
from toolbox.authoring import announced, time_left, whole, zero_order_hold
from toolbox.modelling import OptionalQuantity

if TYPE_CHECKING:
    from toolbox.authoring import Motion


@dataclass(frozen=True, kw_only=True)
class NonlinearMPC(Predictive):
    """Nonlinear model predictive control of the top drive, with a hybrid model that predicts stick and slip of the bit.

    In every sample a plan of torques is simulated with the model, linearised along the predicted motion, and improved
    by one quadratic program. With `iterations` > 1 this is repeated until the plan converges (SQP). The change of the
    plan is shortened until it lowers the cost of the simulated plan, so a quadratic program cannot make a plan worse.

    The initial plan is the plan of the last sample. If another plan is better, that plan is taken: the plan of a soft
    drive while the bit is at rest, or the plan of the linear regulator while the bit turns.

    Friction in the prediction:

    - `width` None: exact modes of the contact (mode-scheduled prediction).
    - `width` [rad/s]: friction regularised with this width. The peak equals the static friction of the set-valued law.
    - `width` with `match_static_peak=False`: the tanh regularisation of textbooks. Its peak is too low, so it predicts
      a release of the bit that does not come.

    Cost of the plan:

    - While the bit is at rest (estimated speed below `standstill_speed`), only the top speed is weighted until the
      predicted release. So the string is wound up.
    - While the bit turns, its speed is kept above `min_bit_speed_factor` times the set-point. Every sample in which the
      bit is predicted to stick again costs `violation_cost`.

    Strength of the rock, with `adapt_rock_strength`: a factor on the rock torque, between 0.5 and 2, is estimated.

    - After the bit has turned for three samples, `RockFilter` estimates the factor together with the states. The factor
      may vary by `strength_process_noise` in one second.
    - Before these three samples, the factor follows the torque that the linear filter estimates, with the time constant
      `rock_strength_time`.
    - At rest the factor follows from the largest torque that the rock has held, increased by the fraction
      `holding_torque_margin`.

    The base class `controllers.predictive.Predictive` describes torque limits, sensors, delay and the soft drive that
    takes over if no plan is found. The controller runs sampled only, with the sample time `period`.

    Range of validity: horizons of a few seconds. With much longer horizons the cost has local minima in which the bit
    sticks.

    Source: M. Diehl, H. G. Bock, J. P. Schlöder, SIAM J. Control Optim. 43 (2005) 1714-1736 (the iteration).

    Examples
    --------
    >>> from controllers import NonlinearMPC
    >>> from toolbox import Sampled
    >>> law = NonlinearMPC(reference="60 rpm", horizon=20)
    >>> controller = Sampled(law, law.period)
    >>> print(f"{law.horizon} torques are planned every {controller.period} s, over {law.horizon * law.period:.1f} s")
    20 torques are planned every 0.1 s, over 2.0 s
    """

    drive_process_noise: Quantity = quantity(50.0, "N m s^1/2", "intensity of the white noise of the drive torque", at_least=0)
    drive_torque_error: Quantity = quantity(0.2, "1", "relative error of the inertia or torque of the drive", at_least=0)
    width: OptionalQuantity = quantity(None, "rad/s", "width of regularised friction", above=0)
    match_static_peak: bool = True
    adapt_rock_strength: bool = True
    iterations: int = 1
    integration_steps: int = 4
    standstill_speed: Quantity = quantity(0.4, "rad/s", "estimated bit speed below which the bit is at rest", above=0)
    rock_strength_time: Quantity = quantity(
        1.0, "s", "time constant with which the estimate follows the strength of a sliding rock", above=0
    )
    strength_process_noise: Quantity = quantity(
        0.005, "s^-1/2", "standard deviation of the change of the rock strength in one second", above=0
    )
    min_bit_speed_factor: Quantity = quantity(0.4, "1", "lowest speed of a turning bit, as a fraction of the set-point", at_least=0)
    holding_torque_margin: Quantity = quantity(
        0.02, "1", "assumed strength of the rock at rest above the largest torque that it has held, as a fraction of this torque", above=0
    )

    def check(self):
        super().check()
        for name in ("iterations", "integration_steps"):
            whole(name, getattr(self, name), 1)
        if not self.soft_limits:
            raise SceneError(
                "Argument `soft_limits` must be True for a nonlinear law: its limits of speed and twist give way where they must."
            )

    def design(self, plant: HybridSystem) -> PlannedNonlinear:
        """Return the controller for this plant as a callable (t, y) -> torque [N m], which is called once per sample.

        y is an array that begins with the measured signals, in the order of `measured_signals`. After them the set-point
        [rad/s] may follow, or the present torque [N m] and then the set-point. The callable remembers its estimates and its
        last plan from sample to sample.

        Parameters
        ----------
        plant
            The plant on which the controller is designed.
        """
        return PlannedNonlinear(self, without_actuators(plant))


class PlannedNonlinear(PredictiveLaw):
    """A designed `NonlinearMPC`; `torques`, `states`, `modes` are the plan of the last sample, `value` its cost, `strength` the factor on the rock's torque."""

    memory_fields: ClassVar[tuple[str, ...]] = (*PredictiveLaw.memory_fields, "torques", "strength", "turning")

    def __init__(self, law: NonlinearMPC, plant: HybridSystem):
        from controllers import condensing
        from toolbox.authoring import Rollout, advance_rollout, regularised

        compiled = (advance_rollout, condensing.cost, condensing.condense, condensing.wound_up, condensing.regulated)
        announced("nonlinear predictive law", *compiled)
        model, _, _, A = drilling_point(plant, law.reference)
        super().__init__(law, plant, model, string_model(plant).A)
        self.settings = law
        n, N = A.shape[0], law.horizon
        step, drive = zero_order_hold(A, model.B[:, None], law.period)
        P, gain, _ = riccati(step, drive[:, 0], law, model)
        self.Q_rows = np.array([model.top / law.top_speed_scale, model.bit / law.bit_speed_scale])
        values, vectors = np.linalg.eigh(P)
        self.P_rows = np.ascontiguousarray((vectors * np.sqrt(np.maximum(values, 0.0))).T)
        self.speeds, self.torques_of_rock = rock_table(plant)
        free = string_model(plant).A
        self.target = np.array([np.append(*steady(free, model, *on)) for on in ((1.0, 0.0), (0.0, 1.0))]).T
        self.place = int(np.flatnonzero(model.bit)[0])
        steps = law.integration_steps
        if law.width is not None:
            # a Runge-Kutta step of order four is stable up to 2.78 over the steepest slope of the regularised rock
            steepest = 1.3 * self.torques_of_rock[0] / law.width * float(model.E @ model.bit)
            steps = max(steps, int(np.ceil(law.period * steepest / 2.0)))
        self.rollout = Rollout(
            plant, ("top.torque",), law.period, steps, None if law.width is None else regularised(law.width, law.match_static_peak)
        )
        self.contact = [element.name for element in plant.elements].index("bit")
        if law.adapt_rock_strength:
            sensors = sensor_rows(plant, law.sensors)
            self.filter = RockFilter(
                FilterModel(string_model(plant).A, model.B, model.E, sensors, law.period, law.delay, law.sensor_noise,
                            law.torque_process_noise, law.drive_process_noise),
                drive_torque_error=law.drive_torque_error, strength_process_noise=law.strength_process_noise, rollout=self.rollout,
                contact=self.contact, bit=model.bit, rock=self._rock_at, turning=2.0 * law.standstill_speed, lasting=3,
            )  # fmt: skip
        limits = [(model.bit / law.bit_speed_scale, law.min_bit_speed_factor * law.reference / law.bit_speed_scale, np.inf)]
        limits += (
            [(model.top / law.top_speed_scale, -np.inf, law.highest_speed / law.top_speed_scale)] if law.highest_speed is not None else []
        )
        limits += [(twist_row(model), -law.highest_twist, law.highest_twist)] if law.highest_twist is not None else []
        count = len(limits)
        rows, (low, high) = np.array([row for row, _, _ in limits]), np.array([bounds for _, *bounds in limits]).T.copy()
        numbers = np.array(
            [0.0, 0.0, law.torque_scale, law.torque_step_scale, law.violation_cost, self.lowest, self.highest, self.rate, np.inf]
        )
        self.weights = condensing.Weights(
            numbers,
            np.zeros(n),
            np.ascontiguousarray(gain),
            self.Q_rows,
            self.P_rows,
            rows,
            low,
            high,
            np.zeros(count, np.int64),
            np.ones(N, np.int64),
        )
        width, many = N + count, N + 2 * count * N
        H, sides = np.zeros((width, width)), np.zeros((many, width))
        sides[:N, :N] = np.eye(N) - np.eye(N, k=-1)
        for i in range(count):
            H[N + i, N + i] = law.violation_cost
            sides[N + 2 * i * N : N + (2 * i + 1) * N, N + i] = -1.0
            sides[N + (2 * i + 1) * N : N + (2 * i + 2) * N, N + i] = 1.0
        g, low, high = np.zeros(width), np.full(width + many, -np.inf), np.full(width + many, np.inf)
        g[N:], low[N:width] = law.violation_cost, 0.0
        self.filled = condensing.Program(H, g, sides, low, high, np.empty((n, N)), np.empty((n, N)), np.empty(N))
        self.program = QuadraticProgram(np.eye(width), sides, law.solver, warm=law.warm_start)
        self._clear()
        for speed in (0.0, *3 * (law.reference,)):  # loads what is compiled; a bit turns after three samples
            self.plan(speed * np.append(model.bit, 0.0))
        self._clear()

    def _clear(self) -> None:
        """The memory of a law that has not seen a sample."""
        N, n = self.law.horizon, self.top.size
        self.strength, self.resting, self.value, self.turning = 1.0, True, np.inf, 0
        self.rollout.scale[:] = 1.0
        self.torques, self.states, self.modes = np.zeros((N, 1)), np.zeros((N + 1, n)), np.zeros((N + 1, self.rollout.contacts))
        self.record = Record()
        self.drive.rest()

    def begin(self, y: np.ndarray, torque: float) -> None:
        super().begin(y, torque)
        if isinstance(self.filter, RockFilter):
            self.filter.mean = torque
        speed, load = float(self.filter.z[self.place]), float(self.filter.z[-1])
        if speed > self.settings.standstill_speed:
            self.turning, self.resting = 3, False
            if self.settings.adapt_rock_strength:
                self.strength = float(np.clip(load / self._rock_torque(speed), 0.5, 2.0))
                self.rollout.scale[self.contact] = self.strength

    def plan(self, z: np.ndarray) -> tuple[float | None, str]:
        from controllers.condensing import LAST, STEADY, Drive, condense, regulated, wound_up
        from toolbox.authoring import advance_rollout

        law, N, unit = self.settings, self.law.horizon, self.law.torque_scale
        x, load = z[:-1].copy(), float(z[-1])
        self.turning = min(self.turning + 1, 3) if abs(x[self.place]) >= law.standstill_speed else 0
        # an estimate passes noise: one large value is no release
        self.resting = resting = self.turning < (1 if "bit.speed" in law.sensors else 3)
        if law.adapt_rock_strength:
            self._learn(x[self.place], load, resting)
        if resting and law.width is None:
            x[self.place] = 0.0
        wish = self.target @ (self.reference, self.strength * self._rock_torque(self.reference))
        weights, filled, roll = self.weights, self.filled, self.rollout
        weights.lowest[0] = law.min_bit_speed_factor * self.reference / law.bit_speed_scale
        weights.x_s[:], weights.numbers[STEADY], weights.numbers[LAST] = wish[:-1], wish[-1], self.last
        plan, value = self._valued(roll.motion(x, np.append(self.torques[1:], self.torques[-1:], axis=0)))
        if not self.started:
            value = np.inf  # there is no last plan
        # a plan that owes nothing to the last one: a soft drive winds up a bit at rest, the regulator catches one that turns
        other = roll.motion(x, np.empty((N, 1)))
        if resting:
            wound_up(other, weights, Drive(self.top, np.array([self.reference, self.drive.proportional, self.drive.integral])))
        else:
            regulated(other, weights)
        found = self._cost(other)
        if found < value:
            plan, value = other, found
        for _ in range(law.iterations):
            U = plan.U
            slopes = roll.motion(x, U, derivatives=True)
            advance_rollout(slopes)
            condense(self._weighed(slopes), weights, filled)
            filled.low[:N], filled.high[:N] = (self.lowest - U[:, 0]) / unit, (self.highest - U[:, 0]) / unit
            self.program.update(filled.H, filled.rows)
            answer = self.program.solve(filled.g, filled.low, filled.high)
            self.record.answer = answer
            self.record.programs += 1
            if not answer.sound:
                return None, answer.reason
            change = answer.z[:N, None] * unit
            factor = 1.0
            while factor > 0.05:
                trial = self._valued(roll.motion(x, U + factor * change))
                if trial[1] < value:
                    break
                factor *= 0.5
            else:
                break
            plan, value = trial
            if float(np.abs(plan.U - U).max()) < 1e-6 * unit:
                break
        U, X, M = plan.U, plan.X, plan.M
        self.torques, self.states, self.modes, self.value = U, X, M, value
        return float(U[0, 0]), ""

    def _valued(self, motion: Motion) -> tuple[Motion, float]:
        """A motion with the states that its torques lead to, and its cost."""
        from toolbox.authoring import advance_rollout

        time_left()
        advance_rollout(motion)
        return motion, self._cost(motion)

    def _cost(self, motion: Motion) -> float:
        from controllers.condensing import VALUE, cost

        cost(self._weighed(motion), self.weights)
        value = float(self.weights.numbers[VALUE])
        return value if np.isfinite(value) else np.inf

    def _weighed(self, motion: Motion) -> Motion:
        """The same motion, behind the weights of its stages: a bit at rest is wound up first, and what follows its release comes later.

        The limit of the bit holds from the first stage at which it is fast enough, where a bit turns now.
        """
        law, X, free, first = self.settings, motion.X, self.weights.free, self.weights.first
        fast = X[1:, self.place] >= law.min_bit_speed_factor * self.reference
        first[0] = X.shape[0] - 1 if self.resting or not law.match_static_peak or not fast.any() else np.argmax(fast)
        free[:] = 1
        if law.match_static_peak:
            turns = motion.M[1:, self.contact] != 0.0 if law.width is None else np.abs(X[1:, self.place]) > law.standstill_speed
            if self.resting:
                free[:] = 0
                free[np.cumsum(turns) > 0] = -1
            else:
                free[~turns] = 2
        return motion

    def _rock_at(self, speed: float) -> tuple[float, float]:
        """Torque and slope of the declared rock at a speed >= 0."""
        near = np.interp((0.99 * speed, speed, 1.01 * speed + 1e-9), self.speeds, self.torques_of_rock)
        return float(near[1]), float(near[2] - near[0]) / (0.02 * speed + 1e-9)

    def _rock_torque(self, speed: float) -> float:
        return float(np.interp(abs(speed), self.speeds, self.torques_of_rock))

    def _learn(self, speed: float, load: float, resting: bool) -> None:
        """The strength of the rock from its estimated torque."""
        law = self.settings
        if isinstance(self.filter, RockFilter) and self.filter.sliding:
            self.strength = self.filter.strength
        elif resting:
            self.strength = max(self.strength, (1.0 + law.holding_torque_margin) * abs(load) / self.torques_of_rock[0])
        elif abs(speed) > 2.0 * law.standstill_speed:
            seen = np.sign(speed) * load / self._rock_torque(speed)
            self.strength += (seen - self.strength) * min(1.0, law.period / law.rock_strength_time)
        self.strength = float(np.clip(self.strength, 0.5, 2.0))
        self.rollout.scale[self.contact] = self.strength
