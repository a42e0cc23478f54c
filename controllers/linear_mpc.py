"""Linear model predictive control of the top drive: a plan of torques on the string with its rock linearised at the set-point."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from controllers.predictive import Predictive, PredictiveLaw, riccati, steady, twist_row
from controllers.quadratic_program import QuadraticProgram
from controllers.string_model import StringModel, drilling_point, without_actuators
from toolbox import HybridSystem, Quantity, quantity
from toolbox.authoring import Declared, zero_order_hold


@dataclass(frozen=True, kw_only=True)
class LinearMPC(Predictive):
    """Linear model predictive control of the top drive, with the rock linearised at the set-point.

        x_(k+1) = A x_k + B u_k - E T
        min sum_(k=1)^(N-1) e_k' Q e_k + sum_(k=0)^(N-1) ((u_k - u_s) / torque_scale)^2 + ((u_k - u_(k-1)) / torque_step_scale)^2
            + (e_N, u_(N-1) - u_s)' P (...),      e_k = x_k - x_s

    - x are the states of the string, u the torques of the drive and N the `horizon`. In every sample the controller
      plans N torques and applies the first of them.
    - A, B and E are the matrices of the string, discretised with the sample time `period`.
    - A contains the slope of the rock torque at `reference`. T is the remaining torque of the rock: it is estimated and
      assumed constant over the horizon.
    - (x_s, u_s) is the steady state at `reference` under the estimated T. A constant unknown torque therefore leaves no
      steady error.
    - Q weights the squared deviations of top speed and bit speed, in units of `top_speed_scale` and `bit_speed_scale`.
    - P is the solution of the Riccati equation, the cost after the horizon. Without active limits the controller equals
      the regulator of this equation.

    The states are eliminated, so the quadratic program has `horizon` unknowns and constant matrices.

    `torque_process_noise` is the intensity with which T may vary. T varies little, because the slope of the rock is in
    A. With a value above the default the filter is faster, but it passes noise to the bit, which destabilises the bit
    at low speed. With a value below the default the filter reacts late to the release of a stuck bit.

    The base class `controllers.predictive.Predictive` describes torque limits, sensors, delay and the soft drive that
    takes over if no plan is found. The controller runs sampled only, with the sample time `period`.

    A stuck bit cannot trap the controller: the estimate of T follows the torque of the string, and the plan winds the
    string up further.

    Source: J. B. Rawlings, D. Q. Mayne, M. M. Diehl, Model Predictive Control, 2nd ed., Nob Hill 2017, chapters 1 and
    5.

    Examples
    --------
    >>> from controllers import LinearMPC
    >>> from toolbox import Sampled
    >>> law = LinearMPC(reference="60 rpm", horizon=20)
    >>> controller = Sampled(law, law.period)
    >>> print(f"{law.horizon} torques are planned every {controller.period} s, over {law.horizon * law.period:.1f} s")
    20 torques are planned every 0.1 s, over 2.0 s
    """

    torque_process_noise: Quantity = quantity(
        400.0, "N m s^-1/2", "standard deviation of the change of T, the bit torque beyond the slope of the rock, in one second", above=0
    )

    def design(self, plant: HybridSystem) -> PlannedLinear:
        """Return the controller for this plant as a callable (t, y) -> torque [N m], which is called once per sample.

        y is an array that begins with the measured signals, in the order of `measured_signals`. After them the set-point
        [rad/s] may follow, or the present torque [N m] and then the set-point. The callable remembers its estimates and its
        last plan from sample to sample.

        Parameters
        ----------
        plant
            The plant on which the controller is designed.
        """
        return PlannedLinear(self, without_actuators(plant))


class PlannedLinear(PredictiveLaw):
    """A designed `LinearMPC`: the unknowns are the torques in units of `torque_scale`, then the excess of speed and of twist."""

    def __init__(self, law: LinearMPC, plant: HybridSystem):
        model, _, _, A = drilling_point(plant, law.reference)
        super().__init__(law, plant, model, A)
        n, N, unit = A.shape[0], law.horizon, law.torque_scale
        step, drive = zero_order_hold(A, np.column_stack([model.B, -model.E]), law.period)
        P, self.gain, Q = riccati(step, drive[:, 0], law, model)
        # states of the plan as  x_k = free_k x_0 + forced_k U - loaded_k T
        free, loaded, forced = np.empty((N, n, n)), np.empty((N, n)), np.empty((N, n, N))
        a, b, c = np.eye(n), np.zeros(n), np.zeros((n, N))
        for k in range(N):
            a, b, c = step @ a, step @ b + drive[:, 1], step @ c
            c[:, k] += drive[:, 0] * unit
            free[k], loaded[k], forced[k] = a, b, c
        self.target = np.array(
            [np.append(*steady(A, model, *on)) for on in ((1.0, 0.0), (0.0, 1.0))]
        ).T  # (x_s, u_s) per reference and per T
        rows = _limits(law, model)
        slacks = len(rows) if law.soft_limits else 0
        H, width = np.zeros((N + slacks, N + slacks)), N + slacks
        moves = np.eye(N) - np.eye(N, k=-1)
        # what the program is given: theta = (x_0, last torque, T, reference)
        G = np.zeros((width, n + 3))
        start, last, load, wish = slice(0, n), n, n + 1, n + 2

        def deviation(k: int) -> np.ndarray:
            """x_k - x_s as rows of theta, for U = 0."""
            out = np.zeros((n, n + 3))
            out[:, start], out[:, load], out[:, wish] = free[k], loaded[k] - self.target[:n, 1], -self.target[:n, 0]
            return out

        for k in range(N - 1):
            H[:N, :N] += forced[k].T @ Q @ forced[k]
            G[:N] += forced[k].T @ Q @ deviation(k)
        H[:N, :N] += np.eye(N) + (unit / law.torque_step_scale) ** 2 * moves.T @ moves
        G[:N, load] -= self.target[n, 1] / unit
        G[:N, wish] -= self.target[n, 0] / unit
        G[0, last] -= unit / law.torque_step_scale**2
        # behind the horizon: (x_N - x_s, u_(N-1) - u_s)
        final = np.vstack([forced[-1], unit * np.eye(N)[-1]])
        off = np.vstack([deviation(N - 1), np.zeros((1, n + 3))])
        off[n, load], off[n, wish] = -self.target[n, 1], -self.target[n, 0]
        H[:N, :N] += final.T @ P @ final
        G[:N] += final.T @ P @ off
        for i in range(slacks):
            H[N + i, N + i] = law.violation_cost
        linear = np.append(np.zeros(N), np.full(slacks, law.violation_cost))
        # bounds of the unknowns, then of the rows: moves, speed, twist
        low = np.append(np.full(N, self.lowest / unit), np.zeros(slacks))
        high = np.append(np.full(N, self.highest / unit), np.full(slacks, np.inf))
        pieces, known = [], []
        if np.isfinite(self.rate):
            piece = np.zeros((N, width))
            piece[:, :N] = moves
            pieces.append(piece)
            offset = np.zeros((N, n + 3))
            offset[0, last] = -1.0 / unit
            known.append(offset)
            low, high = np.append(low, np.full(N, -self.rate / unit)), np.append(high, np.full(N, self.rate / unit))
        for i, (row, lowest, highest, size) in enumerate(rows):
            for side in (1, -1) if np.isfinite(lowest) and law.soft_limits else (1,):
                piece, offset = np.zeros((N, width)), np.zeros((N, n + 3))
                for k in range(N):
                    piece[k, :N] = row @ forced[k] / size
                    offset[k, start], offset[k, load] = row @ free[k] / size, row @ loaded[k] / size
                if law.soft_limits:
                    piece[:, N + i] = -side
                pieces.append(piece)
                known.append(offset)
                lower = lowest / size if not law.soft_limits or side < 0 else -np.inf
                upper = highest / size if side > 0 else np.inf
                low, high = np.append(low, np.full(N, lower)), np.append(high, np.full(N, upper))
        # unknowns w = R z with H = R' R: a program whose Hessian is 1 needs no factor from its solver, sample after sample
        self.back = np.linalg.inv(np.linalg.cholesky(H).T)
        self.program = QuadraticProgram(np.eye(width), np.vstack([np.eye(width), *pieces]) @ self.back, law.solver, warm=law.warm_start)
        # what theta adds to the gradient and takes from the bounds, in one product
        self.given = np.vstack([self.back.T @ G, np.zeros((width, n + 3)), *known])
        self.constant = np.append(self.back.T @ linear, np.zeros(low.size))
        none = np.full(width, np.inf)
        self.bounds = np.array([np.append(-none, low), np.append(none, high)])
        self.theta, self.vectors = np.empty(n + 3), self.bounds.copy()
        self.program.solve(self.constant[:width], *self.vectors)  # loads what is compiled, which no sample should wait for

    def __deepcopy__(self, memo: dict[int, Any]) -> PlannedLinear:
        """A copy for a run of its own, which shares what the design made and no sample changes."""
        twin = copy.copy(self)
        for name in (*self.memory_fields, "record", "program", "theta", "vectors"):
            setattr(twin, name, copy.deepcopy(getattr(self, name), memo))
        return twin

    def export_c(self, c: Path, h: Path, period: float) -> Declared:
        """Write the law as C; see `toolbox.export_c` and `controllers.linear_mpc_c`."""
        from controllers.linear_mpc_c import export

        return export(self, c, h, period)

    def plan(self, z: np.ndarray) -> tuple[float | None, str]:
        theta, width = self.theta, self.back.shape[0]
        theta[:-3] = z[:-1]
        theta[-3:] = self.last, z[-1], self.reference
        moved = self.given @ theta + self.constant
        np.subtract(self.bounds[:, width:], moved[width:], out=self.vectors[:, width:])
        answer = self.program.solve(moved[:width], *self.vectors)
        self.record.answer = answer
        self.record.programs += 1
        return (float(self.back[0] @ answer.z) * self.law.torque_scale, "") if answer.sound else (None, answer.reason)


def _limits(law: Predictive, model: StringModel) -> list[tuple[np.ndarray, float, float, float]]:
    """(row of x, lowest, highest, size) of the limits of top speed and twist that are given."""
    rows = []
    if law.highest_speed is not None:
        rows.append((model.top, -np.inf, law.highest_speed, law.top_speed_scale))
    if law.highest_twist is not None:
        rows.append((twist_row(model), -law.highest_twist, law.highest_twist, 1.0))
    return rows
