"""Programs of nonlinear predictive laws from a rollout and its derivatives: states eliminated, as machine code (see `controllers.nonlinear_mpc`).

What a law hands on together is one value: the `Motion` of a rollout, the `Weights` that it is judged by, the `Program` to be filled, and a `Drive`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from toolbox.authoring import MOTION_KINDS, Compiled, advance_interval

(STEADY, LAST, UNIT, MOVE, PRIORITY, LOWEST, HIGHEST, RATE, VALUE, NUMBERS) = range(10)
"""Indices into `Weights.numbers`: the steady torque [N m] and the last one; unit of the torques, change that counts as 1; cost of an excess of limits; lowest
and highest torque, and the largest change from sample to sample; the cost that was found."""


class Weights(NamedTuple):
    """Cost and limits of a plan of N torques.

    numbers: see above;  x_s: the steady state;  gain: of the regulator on (x - x_s, u - u_s);  Q_rows r_i: a stage costs sum_i (r_i (x - x_s))^2 / 2;
    P_rows: the end costs the same of (x - x_s, u - u_s);
    rows: of x between `lowest` and `highest`, from stage `first` on; that of the bit speed first, which a bit that has stuck again cannot keep;
    free[k]: 1 where the bit turns at state k + 1; 0 where it is stuck, and the torque is not weighed against the steady torque; -1 for a stage that costs
    nothing but moves; 2 where it has stuck again, which costs the priority more and has no slope.
    """

    numbers: np.ndarray
    x_s: np.ndarray
    gain: np.ndarray
    Q_rows: np.ndarray
    P_rows: np.ndarray
    rows: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    first: np.ndarray
    free: np.ndarray


class Program(NamedTuple):
    """A quadratic program: matrix H and vector g, rows, and the bounds of the unknowns and then of the rows; S, W (n, N), line: room for slopes of a state."""

    H: np.ndarray
    g: np.ndarray
    rows: np.ndarray
    low: np.ndarray
    high: np.ndarray
    S: np.ndarray
    W: np.ndarray
    line: np.ndarray


class Drive(NamedTuple):
    """A PI drive on the speed `row` x; numbers: its set-point, proportional and integral gain."""

    row: np.ndarray
    numbers: np.ndarray


class Check(NamedTuple):
    """A program with an answer z, y. `found` holds the three residuals and then room for the force of the multipliers."""

    H: np.ndarray
    A: np.ndarray
    g: np.ndarray
    low: np.ndarray
    high: np.ndarray
    z: np.ndarray
    y: np.ndarray
    found: np.ndarray


def _kinds(fields: tuple[str, ...], tables: str, whole: str = "") -> dict[str, tuple[str, int]]:
    """{field: its dtype and dimensions}, of real vectors but for the tables and the whole numbers that are named."""
    return {name: ("int64" if name in whole.split() else "float64", 2 if name in tables.split() else 1) for name in fields}


WEIGHT_KINDS = _kinds(Weights._fields, "Q_rows P_rows rows", "first free")


def _cost(w, given):
    """Cost of a plan along its own rollout, excess of limits included."""
    N, n, u_s, priority = w.U.shape[0], w.x.size, given.numbers[STEADY], given.numbers[PRIORITY]
    total, before = 0.0, given.numbers[LAST]
    for k in range(N):
        if given.free[k] == 2:
            total += priority
        if given.free[k] > 0:
            total += 0.5 * ((w.U[k, 0] - u_s) / given.numbers[UNIT]) ** 2
        total += 0.5 * ((w.U[k, 0] - before) / given.numbers[MOVE]) ** 2
        before = w.U[k, 0]
        if given.free[k] < 0:
            continue
        if k < N - 1 or given.free[k] == 0:
            for i in range(given.Q_rows.shape[0]):
                part = 0.0
                for a in range(n):
                    part += given.Q_rows[i, a] * (w.X[k + 1, a] - given.x_s[a])
                total += 0.5 * part * part
        else:
            for i in range(given.P_rows.shape[0]):
                part = given.P_rows[i, n] * (w.U[k, 0] - u_s)
                for a in range(n):
                    part += given.P_rows[i, a] * (w.X[k + 1, a] - given.x_s[a])
                total += 0.5 * part * part
    for i in range(given.rows.shape[0]):
        excess = 0.0
        for k in range(given.first[i], N):
            value = 0.0
            for a in range(n):
                value += given.rows[i, a] * w.X[k + 1, a]
            if i > 0 or given.free[k] != 2:
                excess = max(excess, value - given.highest[i], given.lowest[i] - value)
        total += priority * (excess + 0.5 * excess * excess)
    given.numbers[VALUE] = total


def _advance_slopes(w, program, k, unit):
    """Derivatives S (n, N) of the state by the torques (in units) from stage k to k + 1."""
    n = w.x.size
    for a in range(n):
        for j in range(k):
            part = 0.0
            for b in range(n):
                part += w.A[k, a, b] * program.S[b, j]
            program.W[a, j] = part
        program.W[a, k] = w.B[k, a, 0] * unit
    for a in range(n):
        for j in range(k + 1):
            program.S[a, j] = program.W[a, j]


def _limit_states(w, given, program, k):
    """Fill the rows and bounds of the limited states behind stage k, whose derivatives by the torques are S; a limit that does not hold yet is infinite."""
    N, n, width = w.U.shape[0], w.x.size, program.H.shape[0]
    for i in range(given.rows.shape[0]):
        value = 0.0
        for a in range(n):
            value += given.rows[i, a] * w.X[k + 1, a]
        for side in range(2):
            r = N + (2 * i + side) * N + k
            for j in range(k + 1):
                part = 0.0
                for a in range(n):
                    part += given.rows[i, a] * program.S[a, j]
                program.rows[r, j] = part
            holds = k >= given.first[i] and (i > 0 or given.free[k] != 2)
            if side == 0:
                program.high[width + r] = given.highest[i] - value if holds else math.inf
            else:
                program.low[width + r] = given.lowest[i] - value if holds else -math.inf


def _condense(w, given, program):
    """Fill a program with the change of the plan (in units) as unknown: rows for the moves first, then two sides of every limit.

    The motion has its derivatives. The part of H and g behind the N torques is left alone.
    """
    N, n, width = w.U.shape[0], w.x.size, program.H.shape[0]
    u_s, unit, rate = given.numbers[STEADY], given.numbers[UNIT], given.numbers[RATE]
    for j in range(N):
        program.g[j] = 0.0
        for c in range(N):
            program.H[j, c] = 0.0
    weight = (unit / given.numbers[MOVE]) ** 2
    for k in range(N):
        if given.free[k] > 0:
            program.H[k, k] += 1.0
            program.g[k] += (w.U[k, 0] - u_s) / unit
        program.H[k, k] += weight
        jump = (w.U[k, 0] - (w.U[k - 1, 0] if k > 0 else given.numbers[LAST])) / unit
        program.g[k] += weight * jump
        if k > 0:
            program.H[k - 1, k - 1] += weight
            program.H[k, k - 1] -= weight
            program.g[k - 1] -= weight * jump
        _advance_slopes(w, program, k, unit)
        final = k == N - 1 and given.free[k] > 0
        for i in range(given.P_rows.shape[0] if final else (given.Q_rows.shape[0] if given.free[k] >= 0 else 0)):
            off = given.P_rows[i, n] * (w.U[k, 0] - u_s) if final else 0.0
            for a in range(n):
                off += (given.P_rows[i, a] if final else given.Q_rows[i, a]) * (w.X[k + 1, a] - given.x_s[a])
            for j in range(k + 1):
                part = 0.0
                for a in range(n):
                    part += (given.P_rows[i, a] if final else given.Q_rows[i, a]) * program.S[a, j]
                program.line[j] = part
            if final:
                program.line[k] += given.P_rows[i, n] * unit
            for j in range(k + 1):
                program.g[j] += program.line[j] * off
                for c in range(j + 1):
                    program.H[j, c] += program.line[j] * program.line[c]
        _limit_states(w, given, program, k)
        program.low[width + k] = -rate / unit - jump
        program.high[width + k] = rate / unit - jump
    for j in range(N):
        for c in range(j):
            program.H[c, j] = program.H[j, c]


def _kkt(w):
    """(stationarity, violation, complementarity) of `controllers.quadratic_program.Residuals`."""
    n, m = w.z.size, w.A.shape[0]
    total = 0.0
    for i in range(n):
        total += w.z[i] + w.y[i]
        w.found[3 + i] = w.y[i]
    for i in range(m):
        total += w.y[n + i]
    if not math.isfinite(total):
        for i in range(3):
            w.found[i] = math.inf
        return
    violation, standing = 0.0, 0.0
    for i in range(n + m):
        value = 0.0
        if i < n:
            value = w.z[i]
        else:
            for a in range(n):
                value += w.A[i - n, a] * w.z[a]
            if w.y[i] != 0.0:
                for a in range(n):
                    w.found[3 + a] += w.y[i] * w.A[i - n, a]
        reach = 1.0 + abs(value)
        violation = max(violation, (w.low[i] - value) / reach, (value - w.high[i]) / reach)
        distance = abs(w.high[i] - value if w.y[i] > 0.0 else value - w.low[i])
        standing = max(
            standing, abs(w.y[i]) * (distance / reach if math.isfinite(distance) else 1.0)
        )  # a bound that is not there may not push
    size, off = 0.0, 0.0
    for i in range(n):
        curved = 0.0
        for a in range(n):
            curved += w.H[i, a] * w.z[a]
        size = max(size, abs(curved), abs(w.g[i]), abs(w.found[3 + i]))
        off = max(off, abs(curved + w.g[i] + w.found[3 + i]))
    w.found[0], w.found[1], w.found[2] = off / (1.0 + size), violation, standing / (1.0 + size)


def _cut(given, wanted, before):
    """A torque within its limits, and within reach of the one before."""
    near = min(max(wanted, before - given.numbers[RATE]), before + given.numbers[RATE])
    return min(max(near, given.numbers[LOWEST]), given.numbers[HIGHEST])


def _wound_up(w, given, drive):
    """Fill the motion under a PI drive, started from the last torque."""
    reference, proportional, integral = drive.numbers[0], drive.numbers[1], drive.numbers[2]
    before, offset = given.numbers[LAST], given.numbers[LAST]
    for k in range(w.U.shape[0]):
        error = reference
        for a in range(w.x.size):
            error -= drive.row[a] * w.X[k, a]
        if k == 0:
            offset -= proportional * error
        offset += integral * w.interval[0] * error
        wanted = offset + proportional * error
        before = _cut(given, wanted, before)
        offset += before - wanted  # what is cut does not wind up
        w.U[k, 0] = before
        if not advance_interval(w, w.p, k):
            return


def _regulated(w, given):
    """Fill the motion under u_k = u_(k-1) - gain (x - x_s, u_(k-1) - u_s), cut to its limits."""
    n, before = w.x.size, given.numbers[LAST]
    for k in range(w.U.shape[0]):
        wanted = before - given.gain[n] * (before - given.numbers[STEADY])
        for a in range(n):
            wanted -= given.gain[a] * (w.X[k, a] - given.x_s[a])
        before = _cut(given, wanted, before)
        w.U[k, 0] = before
        if not advance_interval(w, w.p, k):
            return


cost = Compiled(_cost, MOTION_KINDS, WEIGHT_KINDS)
condense = Compiled(_condense, MOTION_KINDS, WEIGHT_KINDS, _kinds(Program._fields, "H rows S W"))
kkt = Compiled(_kkt, _kinds(Check._fields, "H A"))
wound_up = Compiled(_wound_up, MOTION_KINDS, WEIGHT_KINDS, _kinds(Drive._fields, ""))
regulated = Compiled(_regulated, MOTION_KINDS, WEIGHT_KINDS)
"""The functions of these names as machine code."""
