"""Programs of nonlinear predictive laws from a rollout and its derivatives: states eliminated, compiled once per machine (see `controllers.nonlinear_mpc`).

What a law hands on together is one value: the `Plan` that is judged, the `Aim` that it is weighed against, the `Limits` of states, the `Commands` that a
drive can give, the `Program` to be filled, and the `Prediction` and `Motion` of a rollout.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from toolbox.authoring import advance_rollout, cached


class Plan(NamedTuple):
    """States X (N+1, n) and torques U (N, 1) of a plan, and what each stage weighs.

    free[k]: 1 where the bit turns at state k + 1; 0 where it is stuck, and the torque is not weighed against the steady torque; -1 for a stage that costs
    nothing but moves; 2 where it has stuck again, which costs `priority` more and has no slope.
    """

    X: np.ndarray
    U: np.ndarray
    free: np.ndarray


class Aim(NamedTuple):
    """What a plan is weighed against: the steady state x_s and its torque u_s, the last torque, and the weights.

    Q_rows r_i: a stage costs sum_i (r_i (x - x_s))^2 / 2;  P_rows: the end costs the same of (x - x_s, u - u_s);  unit: of the torques [N m];  move: change
    of the torque [N m] that counts as 1.
    """

    x_s: np.ndarray
    u_s: float
    last: float
    Q_rows: np.ndarray
    P_rows: np.ndarray
    unit: float
    move: float


class Limits(NamedTuple):
    """Rows of x between lowest and highest, from stage `first` on; that of the bit speed first, which a bit that has stuck again cannot keep."""

    rows: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    first: np.ndarray


class Commands(NamedTuple):
    """Lowest and highest torque [N m], and the largest change from sample to sample."""

    lowest: float
    highest: float
    rate: float


class Program(NamedTuple):
    """A quadratic program: matrix H and vector g, rows, and the bounds of the unknowns and then of the rows."""

    H: np.ndarray
    g: np.ndarray
    rows: np.ndarray
    low: np.ndarray
    high: np.ndarray


class Prediction(NamedTuple):
    """What `advance_rollout` needs of a `Rollout`, beside a motion."""

    addresses: np.ndarray
    interval: float
    steps: int
    inputs: np.ndarray
    columns: np.ndarray
    p: np.ndarray


class Motion(NamedTuple):
    """States X (N+1, n), modes M (N+1, contacts) and torques U (N, 1), of which the first state and modes are given; `none`: no derivatives."""

    X: np.ndarray
    M: np.ndarray
    none: np.ndarray
    U: np.ndarray


@cached(error_model="python")
def cost(plan, aim, bounds, priority):  # pragma: no cover - compiled
    """Cost of a plan along its own rollout, excess of limits included."""
    X, U, free = plan
    x_s, u_s, last, Q_rows, P_rows, unit, move = aim
    limits, lowest, highest, first = bounds
    N, n = U.shape[0], X.shape[1]
    total, before = 0.0, last
    for k in range(N):
        if free[k] == 2:
            total += priority
        if free[k] > 0:
            total += 0.5 * ((U[k, 0] - u_s) / unit) ** 2
        total += 0.5 * ((U[k, 0] - before) / move) ** 2
        before = U[k, 0]
        if free[k] < 0:
            continue
        if k < N - 1 or free[k] == 0:
            for i in range(Q_rows.shape[0]):
                part = 0.0
                for a in range(n):
                    part += Q_rows[i, a] * (X[k + 1, a] - x_s[a])
                total += 0.5 * part * part
        else:
            for i in range(P_rows.shape[0]):
                part = P_rows[i, n] * (U[k, 0] - u_s)
                for a in range(n):
                    part += P_rows[i, a] * (X[k + 1, a] - x_s[a])
                total += 0.5 * part * part
    for i in range(limits.shape[0]):
        excess = 0.0
        for k in range(first[i], N):
            value = 0.0
            for a in range(n):
                value += limits[i, a] * X[k + 1, a]
            if i > 0 or free[k] != 2:
                excess = max(excess, value - highest[i], lowest[i] - value)
        total += priority * (excess + 0.5 * excess * excess)
    return total


@cached(error_model="python")
def _advance_slopes(k, A, B, unit, S, W):  # pragma: no cover - compiled
    """Derivatives S (n, N) of the state by the torques (in units) from stage k to k + 1; W: room for them."""
    n = S.shape[0]
    for a in range(n):
        for j in range(k):
            part = 0.0
            for b in range(n):
                part += A[a, b] * S[b, j]
            W[a, j] = part
        W[a, k] = B[a, 0] * unit
    S[:, : k + 1] = W[:, : k + 1]


@cached(error_model="python")
def _limit_states(k, plan, bounds, S, program):  # pragma: no cover - compiled
    """Fill the rows and bounds of the limited states behind stage k, whose derivatives by the torques are S; a limit that does not hold yet is infinite."""
    X, U, free = plan
    limits, lowest, highest, first = bounds
    H, _, rows, low, high = program
    N, n, width = U.shape[0], X.shape[1], H.shape[0]
    for i in range(limits.shape[0]):
        value = 0.0
        for a in range(n):
            value += limits[i, a] * X[k + 1, a]
        for side in range(2):
            r = N + (2 * i + side) * N + k
            for j in range(k + 1):
                part = 0.0
                for a in range(n):
                    part += limits[i, a] * S[a, j]
                rows[r, j] = part
            holds = k >= first[i] and (i > 0 or free[k] != 2)
            if side == 0:
                high[width + r] = highest[i] - value if holds else np.inf
            else:
                low[width + r] = lowest[i] - value if holds else -np.inf


@cached(error_model="python")
def condense(plan, A, B, aim, bounds, rate, program):  # pragma: no cover - compiled
    """Fill a program with the change of the plan (in units) as unknown: rows for the moves first, then two sides of every limit.

    A, B: derivatives of the rollout. The part of H and g behind the N torques is left alone.
    """
    X, U, free = plan
    x_s, u_s, last, Q_rows, P_rows, unit, move = aim
    H, g, _, low, high = program
    N, n = U.shape[0], X.shape[1]
    width = H.shape[0]
    S, W = np.zeros((n, N)), np.zeros((n, N))
    line = np.empty(N)
    H[:N, :N] = 0.0
    g[:N] = 0.0
    weight = (unit / move) ** 2
    for k in range(N):
        if free[k] > 0:
            H[k, k] += 1.0
            g[k] += (U[k, 0] - u_s) / unit
        H[k, k] += weight
        jump = (U[k, 0] - (U[k - 1, 0] if k else last)) / unit
        g[k] += weight * jump
        if k:
            H[k - 1, k - 1] += weight
            H[k, k - 1] -= weight
            g[k - 1] -= weight * jump
        _advance_slopes(k, A[k], B[k], unit, S, W)
        final = k == N - 1 and free[k] > 0
        R = P_rows if final else Q_rows
        for i in range(R.shape[0] if free[k] >= 0 else 0):
            off = 0.0
            for a in range(n):
                off += R[i, a] * (X[k + 1, a] - x_s[a])
            for j in range(k + 1):
                part = 0.0
                for a in range(n):
                    part += R[i, a] * S[a, j]
                line[j] = part
            if final:
                line[k] += R[i, n] * unit
                off += R[i, n] * (U[k, 0] - u_s)
            for j in range(k + 1):
                g[j] += line[j] * off
                for c in range(j + 1):
                    H[j, c] += line[j] * line[c]
        _limit_states(k, plan, bounds, S, program)
        low[width + k] = -rate / unit - jump
        high[width + k] = rate / unit - jump
    for j in range(N):
        for c in range(j):
            H[c, j] = H[j, c]


@cached(error_model="python")
def kkt(H, A, g, low, high, z, y):  # pragma: no cover - compiled
    """(stationarity, violation, complementarity) of `controllers.quadratic_program.Residuals`."""
    n, m = z.size, A.shape[0]
    total = 0.0
    for i in range(n):
        total += z[i] + y[i]
    for i in range(m):
        total += y[n + i]
    if not np.isfinite(total):
        return np.inf, np.inf, np.inf
    pushed = y[:n].copy()
    violation, standing = 0.0, 0.0
    for i in range(n + m):
        value = 0.0
        if i < n:
            value = z[i]
        else:
            for a in range(n):
                value += A[i - n, a] * z[a]
            if y[i] != 0.0:
                for a in range(n):
                    pushed[a] += y[i] * A[i - n, a]
        reach = 1.0 + abs(value)
        violation = max(violation, (low[i] - value) / reach, (value - high[i]) / reach)
        distance = abs(high[i] - value if y[i] > 0.0 else value - low[i])
        standing = max(standing, abs(y[i]) * (distance / reach if np.isfinite(distance) else 1.0))  # a bound that is not there may not push
    size, off = 0.0, 0.0
    for i in range(n):
        curved = 0.0
        for a in range(n):
            curved += H[i, a] * z[a]
        size = max(size, abs(curved), abs(g[i]), abs(pushed[i]))
        off = max(off, abs(curved + g[i] + pushed[i]))
    return off / (1.0 + size), violation, standing / (1.0 + size)


@cached(error_model="python")
def wound_up(prediction, motion, row, reference, last, proportional, integral, commands):  # pragma: no cover - compiled
    """Fill the motion under a PI drive on the speed `row` x, started from the last torque."""
    addresses, interval, steps, inputs, columns, p = prediction
    X, M, none, U = motion
    lowest, highest, rate = commands
    offset = last - proportional * (reference - row @ X[0])
    before = last
    for k in range(U.shape[0]):
        error = reference - row @ X[k]
        offset += integral * interval * error
        wanted = offset + proportional * error
        command = min(max(min(max(wanted, before - rate), before + rate), lowest), highest)
        offset += command - wanted  # what is cut does not wind up
        U[k, 0] = command
        advance_rollout(addresses, interval, steps, inputs, columns, p, U[k : k + 1], X[k : k + 2], none, none, M[k : k + 2])
        before = command


@cached(error_model="python")
def regulated(prediction, motion, aim, gain, commands):  # pragma: no cover - compiled
    """Fill the motion under u_k = u_(k-1) - gain (x - x_s, u_(k-1) - u_s), cut to its limits."""
    addresses, interval, steps, inputs, columns, p = prediction
    X, M, none, U = motion
    x_s, u_s, last = aim.x_s, aim.u_s, aim.last
    lowest, highest, rate = commands
    n, before = X.shape[1], last
    for k in range(U.shape[0]):
        wanted = before - gain[n] * (before - u_s)
        for a in range(n):
            wanted -= gain[a] * (X[k, a] - x_s[a])
        before = min(max(min(max(wanted, before - rate), before + rate), lowest), highest)
        U[k, 0] = before
        advance_rollout(addresses, interval, steps, inputs, columns, p, U[k : k + 1], X[k : k + 2], none, none, M[k : k + 2])
