"""The loop of a rollout, compiled once per machine; see `toolbox.prediction.rollout`."""

from __future__ import annotations

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from toolbox.compilation.numba_cache import cached

MOST_SWITCHES = 50
"""Switches in one interval after which the rest of it is taken without looking at guards."""

MOST_STEPS = 500
"""Steps beyond the planned ones that an interval may take; one of a bit that chatters takes some two for each of its switches."""


@intrinsic
def call(typingctx, address, t, h, x, k, p, m, y):  # pragma: no cover - compiled
    """Call void f(double, double, x, k, p, m, y) at a raw address; the arrays are passed by their data pointers."""
    signature = types.void(types.int64, types.float64, types.float64, x, k, p, m, y)

    def codegen(context, builder, sig, args):
        from llvmlite import ir

        pointer = ir.IntType(8).as_pointer()
        double = ir.DoubleType()
        data = [
            builder.bitcast(cgutils.create_struct_proxy(sig.args[i])(context, builder, value=args[i]).data, pointer) for i in range(3, 8)
        ]
        kind = ir.FunctionType(ir.VoidType(), [double, double] + [pointer] * 5)
        function = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(function, [args[1], args[2], *data])
        return context.get_dummy_value()

    return signature, codegen


@cached(forceinline=True)
def _released(z, x, m, i):  # pragma: no cover - compiled
    """Set contact i in motion where its guards `z` say that its bound cannot hold it."""
    if z[x.size + 2 * i] < 0.0:
        m[i] = -1.0
    elif z[x.size + 2 * i + 1] < 0.0:
        m[i] = 1.0


@cached(forceinline=True)
def _bearable_step(function, h, interval, x, k, p, m, y, count):  # pragma: no cover - compiled
    """Take a step of length h, halved until its first `count` numbers are finite; returns its length."""
    call(function, 0.0, h, x, k, p, m, y)
    while h > 1e-6 * interval:  # friction looked at far beyond zero slip may overflow
        total = 0.0
        for i in range(count):
            total += y[i]
        if np.isfinite(total):
            break
        h *= 0.5
        call(function, 0.0, h, x, k, p, m, y)
    return h


@cached(forceinline=True)
def _most_negative(y, n, ne, besides, level):  # pragma: no cover - compiled
    """The guard that is most negative after a step, and below -level, other than one; -1 for none."""
    found = -1
    for i in range(2 * ne):
        if i != besides and y[n + i] < -level and (found < 0 or y[n + i] < y[n + found]):
            found = i
    return found


@cached(forceinline=True)
def _first_crossing(addresses, guard, h, interval, x, k, p, m, y, z, ne):  # pragma: no cover - compiled
    """The step to the first crossing: regula falsi on the guard that is most negative, restarted where another one is negative there.

    Returns its length and the guard.
    """
    n = x.size
    for _ in range(2 * ne):
        low, high, g_high = 0.0, h, y[n + guard]
        call(addresses[2], 0.0, 0.0, x, k, p, m, z)
        g_low = max(z[n + guard], 0.0)
        tiny = 1e-12 * (abs(g_high) + abs(g_low))
        for _ in range(60):
            h = low + (high - low) * min(max(g_low / (g_low - g_high), 0.02), 0.98)
            call(addresses[0], 0.0, h, x, k, p, m, y)
            g = y[n + guard]
            if g >= 0.0:
                low, g_low = h, g
            else:
                high, g_high = h, g
            if abs(g) <= tiny or high - low <= 1e-13 * interval:
                break
        other = _most_negative(y, n, ne, guard, tiny)
        if other < 0:
            break
        guard = other
    return h, guard


@cached(forceinline=True)
def _carried(y, J, K, ne):  # pragma: no cover - compiled
    """Carry the derivatives J over a step, whose own derivatives stand in y behind states and guards."""
    n, nu = J.shape[0], J.shape[1] - J.shape[0]
    first = n + 2 * ne
    for a in range(n):
        for c in range(n + nu):
            total = y[first + n * n + a * nu + c - n] if c >= n else 0.0
            for b in range(n):
                total += y[first + a * n + b] * J[b, c]
            K[a, c] = total
    J[:, :] = K


@cached(forceinline=True)
def _switched(addresses, guard, x, k, p, m, z, f, row, J, ne, derivatives):  # pragma: no cover - compiled
    """Switch the contact whose guard is zero, and carry the derivatives J over the event."""
    n, nu = J.shape[0], J.shape[1] - J.shape[0]
    e = guard // 2
    before = m[e]
    call(addresses[2], 0.0, 0.0, x, k, p, m, z)
    crossing = 0.0
    for i in range(n):
        f[i] = z[i]
        crossing += z[n + 2 * ne + guard * n + i] * z[i]
    if derivatives:
        for c in range(n + nu):
            row[c] = z[n + 2 * ne + 2 * ne * n + guard * nu + c - n] if c >= n else 0.0
            for b in range(n):
                row[c] += z[n + 2 * ne + guard * n + b] * J[b, c]
    if before == 0.0:
        m[e] = -1.0 if guard % 2 == 0 else 1.0
    else:
        m[e] = 0.0
        call(addresses[2], 0.0, 0.0, x, k, p, m, z)
        last = n + 2 * ne + 2 * ne * (n + nu)
        for i in range(n):
            x[i] = z[last + i]
        _released(z, x, m, e)
    if derivatives and crossing != 0.0:
        call(addresses[2], 0.0, 0.0, x, k, p, m, z)
        for a in range(n):
            for c in range(n + nu):
                J[a, c] += (z[a] - f[a]) * row[c] / crossing


@cached(error_model="python")
def advance(addresses, interval, steps, inputs, columns, p, U, X, A, B, M):  # pragma: no cover - compiled
    """Fill X, A, B and M (see `Rollout.advance`), whose first rows of X and M are given; no derivatives where A is empty.

    Where the states overflow, or no bearable number of steps leads to the end of an interval, what follows is nan.
    """
    n, nu, ne = X.shape[1], columns.size, M.shape[1]
    derivatives = A.shape[0] > 0
    size = n + 2 * ne + n * (n + nu)
    y, z = np.empty(max(size, n + 2 * ne + 2 * ne * (n + nu) + n)), np.empty(2 * n + 2 * ne + 2 * ne * (n + nu))
    k, m, x, f = inputs.copy(), np.zeros(max(ne, 1)), np.empty(n), np.empty(n)
    row = np.empty(n + nu)
    J, K = np.empty((n, n + nu)), np.empty((n, n + nu))
    function = addresses[1] if derivatives else addresses[0]
    for j in range(U.shape[0]):
        for i in range(nu):
            k[columns[i]] = U[j, i]
        for i in range(n):
            x[i] = X[j, i]
        for i in range(ne):
            m[i] = M[j, i]
        if derivatives:
            J[:, :] = 0.0
            for i in range(n):
                J[i, i] = 1.0
        # a contact at rest that its bound cannot hold moves at once
        if ne:
            call(addresses[2], 0.0, 0.0, x, k, p, m, z)
            for i in range(ne):
                if m[i] == 0.0:
                    _released(z, x, m, i)
        left, switches, taken = interval, 0, 0
        while left > 1e-12 * interval:
            taken += 1
            h = _bearable_step(function, min(interval / steps, left), interval, x, k, p, m, y, n + 2 * ne)
            if (h <= 1e-6 * interval and h < left) or taken > steps + MOST_STEPS:  # nothing finite comes of it, or not in time
                X[j + 1 :], M[j + 1 :] = np.nan, 0.0
                A[j:], B[j:] = np.nan, np.nan
                return
            guard = _most_negative(y, n, ne, -1, 0.0) if switches < MOST_SWITCHES else -1
            if guard >= 0:
                h, guard = _first_crossing(addresses, guard, h, interval, x, k, p, m, y, z, ne)
                if derivatives:
                    call(function, 0.0, h, x, k, p, m, y)
            if derivatives:
                _carried(y, J, K, ne)
            for i in range(n):
                x[i] = y[i]
            left -= h
            if guard >= 0:
                switches += 1
                _switched(addresses, guard, x, k, p, m, z, f, row, J, ne, derivatives)
        for i in range(n):
            X[j + 1, i] = x[i]
        for i in range(ne):
            M[j + 1, i] = m[i]
        if derivatives:
            A[j] = J[:, :n]
            B[j] = J[:, n:]
