"""The event loop: adaptive steps, guards, modes, samples and outputs, compiled once per machine.

The loop knows no model. It calls the machine code of `toolbox.compilation.kernel` through raw addresses, keeps one armed flag per guard, ends steps exactly
on events, and decides modes by forces alone. Everything it calls stands in this file, because numba's cache does not see edits elsewhere.

How an event is found: an armed guard that changes sign over a step, or whose minimum inside it proves to be negative, is located by stepping again from
the start of the step to the root of a cubic Hermite interpolant, with shrinking brackets. No dense output is involved, so
the accuracy at an event, like at an output time, is that of a step.

A sticking contact hides a force that varies in time from the states, and a long step could jump over its peak. Where that can be, the force is
integrated along as one more state, so that the error control sees it; `Work.excited` names the element of each such state.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from toolbox.compilation.numba_cache import cached, inlined

# --- status codes of `advance`
DONE, RECORDS_FULL, EVENTS_FULL, PAUSED, SAMPLE_DUE, ENDLESS, UNDERFLOW, INCONSISTENT = range(8)

# --- indices into `Work.ints`: sizes, addresses, counters; the last name of each list is its length
(N, NE, NG, FIELD, STEP, PROJECT, PROBE, BURDEN, IMPULSE, ORDER, TWO_ERRORS, FIRST_HELD, JUMP, OUTPUT, RECORDS, EVENTS, ACCEPTED, REJECTED,
 CLOSE, BUDGET, CULPRIT, STARTED, NODES, LOCATED, MERGED, COUPLED, IMPLICIT, INTS) = range(28)  # fmt: skip

# --- kinds of elements: friction and relays hold or slide; a rigid contact holds (mode 0) or is free (mode 1); a switch is in mode 0 or 1
FRICTION, RIGID, SWITCH = range(3)

# --- indices into `Work.reals`; ERROR_OLD is a binary logarithm
TIME, END, STEP_SIZE, RTOL, ERROR_OLD, STEP_OLD, POWER, LAST_EVENT, LONGEST, REALS = range(10)

# --- columns of `Work.samplers`, one row per sampled controller
ADDRESS, TAKEN, APPLIED, FIRST_STATE, STATES, FIRST_OUTPUT, OUTPUTS, NOISES, COLUMNS = range(9)

EPS = 2.220446049250313e-16


class Work(NamedTuple):
    """Arrays of one run. n states, ne elements, ng guards; arrays that machine code reads are float64.

    ints, reals: see the indices above;  x, k: state and its slope;  p, m: parameters and modes;  y, z: output of machine code;  s, q: spares;
    scale, noise: size of each state so far and round-off of its slope;  group, group_scale: states of one unit share a floor;
    g, g_low, g_high: guards then rates;  guard_scale, slot: size of each guard so far, in slip then in stick, and which counts;
    side, armed, fired: per guard;  zero, forced, before: per element;  excited: see above;
    kind, initial: kind of each element and mode at the start of a switch;  attached: the rigid contact that loads a friction, or -1;
    loader: the unilateral contact without which a friction has no load, or -1;
    held: elements that take part in an impact without sliding, then 1 for restitution;  bounced: rigid contacts that have just left again;
    rec_*: recorded nodes (time, state, modes, held parameters);  ev_*: events (time, element, modes before and after);
    jump_*: parameter changes at given times (row pointers into index and value);  out_t: output times;  samplers: see above, with
    period and delay in `clocks`, controller states and behind them the noise of the sample in `memory`, the key of each noise
    channel at its place in `keys`, computed outputs waiting in `queue` (controller, slot, output).
    """

    ints: np.ndarray
    reals: np.ndarray
    x: np.ndarray
    k: np.ndarray
    p: np.ndarray
    m: np.ndarray
    y: np.ndarray
    z: np.ndarray
    s: np.ndarray
    q: np.ndarray
    scale: np.ndarray
    noise: np.ndarray
    group: np.ndarray
    group_scale: np.ndarray
    g: np.ndarray
    g_low: np.ndarray
    g_high: np.ndarray
    guard_scale: np.ndarray
    slot: np.ndarray
    side: np.ndarray
    armed: np.ndarray
    fired: np.ndarray
    excited: np.ndarray
    zero: np.ndarray
    forced: np.ndarray
    before: np.ndarray
    kind: np.ndarray
    initial: np.ndarray
    attached: np.ndarray
    loader: np.ndarray
    held: np.ndarray
    bounced: np.ndarray
    rec_t: np.ndarray
    rec_x: np.ndarray
    rec_m: np.ndarray
    rec_p: np.ndarray
    ev_t: np.ndarray
    ev_i: np.ndarray
    ev_m: np.ndarray
    jump_t: np.ndarray
    jump_first: np.ndarray
    jump_index: np.ndarray
    jump_value: np.ndarray
    out_t: np.ndarray
    samplers: np.ndarray
    clocks: np.ndarray
    memory: np.ndarray
    keys: np.ndarray
    queue: np.ndarray


@intrinsic
def _call(typingctx, address, t, h, x, k, p, m, y):  # pragma: no cover - compiled
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


@intrinsic
def _borrowed(typingctx, array):  # pragma: no cover - compiled
    """The same array without its reference count: the caller keeps it alive, and the loop is spared an atomic operation per access."""

    def codegen(context, builder, sig, args):
        view = cgutils.create_struct_proxy(sig.args[0])(context, builder, value=args[0])
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        view.parent = cgutils.get_null_value(view.parent.type)
        return view._getvalue()

    return array(array), codegen


@inlined
def _borrowed_all(w):
    return Work(
        _borrowed(w.ints),
        _borrowed(w.reals),
        _borrowed(w.x),
        _borrowed(w.k),
        _borrowed(w.p),
        _borrowed(w.m),
        _borrowed(w.y),
        _borrowed(w.z),
        _borrowed(w.s),
        _borrowed(w.q),
        _borrowed(w.scale),
        _borrowed(w.noise),
        _borrowed(w.group),
        _borrowed(w.group_scale),
        _borrowed(w.g),
        _borrowed(w.g_low),
        _borrowed(w.g_high),
        _borrowed(w.guard_scale),
        _borrowed(w.slot),
        _borrowed(w.side),
        _borrowed(w.armed),
        _borrowed(w.fired),
        _borrowed(w.excited),
        _borrowed(w.zero),
        _borrowed(w.forced),
        _borrowed(w.before),
        _borrowed(w.kind),
        _borrowed(w.initial),
        _borrowed(w.attached),
        _borrowed(w.loader),
        _borrowed(w.held),
        _borrowed(w.bounced),
        _borrowed(w.rec_t),
        _borrowed(w.rec_x),
        _borrowed(w.rec_m),
        _borrowed(w.rec_p),
        _borrowed(w.ev_t),
        _borrowed(w.ev_i),
        _borrowed(w.ev_m),
        _borrowed(w.jump_t),
        _borrowed(w.jump_first),
        _borrowed(w.jump_index),
        _borrowed(w.jump_value),
        _borrowed(w.out_t),
        _borrowed(w.samplers),
        _borrowed(w.clocks),
        _borrowed(w.memory),
        _borrowed(w.keys),
        _borrowed(w.queue),
    )


@inlined
def _log2(x):
    """Binary logarithm of a positive number to one part in a hundred, which is all that step sizes need."""
    bits = np.float64(x).view(np.int64)
    fraction = np.int64((bits & 0xFFFFFFFFFFFFF) | 0x3FF0000000000000).view(np.float64) - 1.0
    return float((bits >> 52) - 1023) + fraction * (1.3465 - 0.3465 * fraction)


@inlined
def _exp2(x):
    """Two to the power of x, |x| < 1000, to one part in two hundred."""
    whole = math.floor(x)
    fraction = x - whole
    return np.int64((np.int64(whole) + 1023) << 52).view(np.float64) * (1.0 + fraction * (0.6565 + 0.3435 * fraction))


@inlined
def _scrambled(z):
    """The 64 bits of an unsigned integer scrambled: the finaliser of splitmix64."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@cached
def channel_key(seed, name):
    """The key of a noise channel from a seed and the number of its name."""
    return _scrambled(_scrambled(np.uint64(seed) + np.uint64(0x9E3779B97F4A7C15)) ^ np.uint64(name))


@cached
def normal(key, sample):
    """A standard normal number that is a function of a channel's key and the number of the sample alone (splitmix64, Box and Muller)."""
    counter = key + np.uint64(2 * sample + 1) * np.uint64(0x9E3779B97F4A7C15)
    radius = (float(_scrambled(counter) >> np.uint64(11)) + 0.5) * 2.0**-53
    angle = float(_scrambled(counter + np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(11)) * 2.0**-53
    return math.sqrt(-2.0 * math.log(radius)) * math.cos(2.0 * math.pi * angle)


@inlined
def _first_descent(a, da, b, db):
    """First fraction in (0, 1] at which the cubic Hermite interpolant, once positive, is no longer; 2 where there is none.

    a, b: values at 0 and 1;  da, db: slopes times the step.
    """
    c2 = 3.0 * (b - a) - 2.0 * da - db
    c3 = 2.0 * (a - b) + da + db
    # critical points of a + da s + c2 s^2 + c3 s^3 split (0, 1) into monotone pieces
    s1, s2 = 1.0, 1.0
    disc = c2 * c2 - 3.0 * c3 * da
    if disc > 0.0:
        q = -(c2 + math.copysign(math.sqrt(disc), c2))
        r1 = q / (3.0 * c3) if c3 != 0.0 else 2.0
        r2 = da / q if q != 0.0 else 2.0
        if r1 > r2:
            r1, r2 = r2, r1
        if 0.0 < r1 < 1.0:
            s1 = r1
        if 0.0 < r2 < 1.0:
            s2 = r2
            if s1 == 1.0:
                s1 = s2
                s2 = 1.0
    left, f_left = 0.0, a
    for piece in range(3):
        right = s1 if piece == 0 else (s2 if piece == 1 else 1.0)
        f_right = b if right == 1.0 else a + right * (da + right * (c2 + right * c3))
        if f_left > 0.0 and f_right <= 0.0:
            low, high = left, right
            s = left + (right - left) * f_left / (f_left - f_right)
            for _ in range(60):  # Newton, kept inside the bracket
                f = a + s * (da + s * (c2 + s * c3))
                if f > 0.0:
                    low = s
                else:
                    high = s
                slope = da + s * (2.0 * c2 + 3.0 * s * c3)
                following = s - f / slope
                if not low <= following <= high:
                    following = 0.5 * (low + high)
                moved = abs(following - s)
                s = following
                if moved < 1e-9:
                    break
            return s
        if right == 1.0:
            break
        left, f_left = right, f_right
    return 2.0


@inlined
def _size(w, j):
    """Size of guard j so far; a contact's first guard is a speed in slip and a force in stick, so each has a slot per kind of mode."""
    return w.guard_scale[w.slot[j]]


@inlined
def _close(w, j):
    """How near to zero a guard counts as zero: far below what the accuracy asked can see."""
    return min(max(1e-5 * w.reals[RTOL], 1e-13), 1e-9) * _size(w, j)


@inlined
def _flies(w, i):
    """Whether element i is a friction without load because its contact is open: it has no force, and its slip passes through zero unhindered."""
    return w.loader[i] >= 0 and w.m[w.loader[i]] == 1.0


@inlined
def _consistent(w, t, change, one):
    """Whether the modes of the elements marked in `zero` agree with the forces; with `change`, correct those that do not (only `one`, or all)."""
    ne = w.ints[NE]
    _call(w.ints[PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    consistent = True
    for j in range(ne):
        i = j if one < 0 else (j + one) % ne
        if not w.zero[i]:
            continue
        rate, force, static, pace = w.z[ne + i], w.z[2 * ne + i], w.z[3 * ne + i], w.z[4 * ne + i]
        if w.kind[i] == RIGID:  # pushes while closed (a multiplier below zero), and stays open where the gap grows
            if force <= 0.0 if w.m[i] == 0.0 else rate <= 1e-9 * abs(pace) * w.guard_scale[2 * i + w.ints[NG]]:
                continue  # released where its force is zero, it may seem to close by the round-off of that zero
            right = 1.0 - w.m[i]
        elif _flies(w, i):
            if w.m[i] != 0.0:
                continue
            right = -1.0 if force > 0.0 else 1.0
        elif w.m[i] == 0.0:
            # the last term for a bound that falls to zero, or an ulp below, with the normal force that makes it
            if abs(force) <= static * (1.0 + 1e-9) + 1e-12 * w.guard_scale[2 * i + w.ints[NG]]:
                continue
            right = -1.0 if force > 0.0 else 1.0
        else:
            # a contact released exactly at its limit starts with zero slip rate and must not fall back
            if w.m[i] * rate >= -1e-7 * abs(pace):
                continue
            right = 0.0
        if not change:
            return False
        consistent = False
        w.m[i] = right
        if one >= 0:
            return False
    return consistent


@inlined
def _decide(w, t):
    """Modes of the elements marked in `zero`, by force: stick where the bound allows it, else slip in the direction of the excess.

    Starts from the modes in m and changes all inconsistent elements at once; if that does not settle, one by one. With static friction above
    kinetic several sets can be consistent: what can stick beside the others does. Returns False where no consistent set is found.
    """
    ne = w.ints[NE]
    together = 20 + 4 * ne
    settled = False
    for attempt in range(together + 60 + 20 * ne):
        if _consistent(w, t, True, -1 if attempt < together else attempt % ne):
            settled = True
            break
    if settled and w.ints[COUPLED] == 1:
        for i in range(ne):
            if w.zero[i] and not w.forced[i] and w.m[i] != 0.0 and w.kind[i] == FRICTION:
                mode = w.m[i]
                w.m[i] = 0.0
                if not _consistent(w, t, False, -1):
                    w.m[i] = mode
    return settled


@inlined
def _project(w, t):
    """Set the slip of sticking elements to exactly zero, if there are any."""
    for i in range(w.ints[NE]):
        if w.m[i] == 0.0 and w.kind[i] != SWITCH:
            _call(w.ints[PROJECT], t, 0.0, w.x, w.k, w.p, w.m, w.z)
            for j in range(w.ints[N]):
                w.x[j] = w.z[j]
            return


@inlined
def _refresh(w):
    """Slopes, guards and armed flags at the current point."""
    n, ng = w.ints[N], w.ints[NG]
    _call(w.ints[FIELD], w.reals[TIME], 0.0, w.x, w.k, w.p, w.m, w.z)
    for i in range(n):
        w.k[i] = w.z[n + i]
        size = abs(w.x[i])
        if size > w.scale[i]:
            w.scale[i] = size
            if size > w.group_scale[w.group[i]]:
                w.group_scale[w.group[i]] = size
    for j in range(2 * ng):
        w.g[j] = w.z[2 * n + j]
    for j in range(ng):
        w.slot[j] = j + ng if j < 2 * w.ints[NE] and w.m[j // 2] == 0.0 else j
        size = abs(w.g[j])
        if size > _size(w, j):
            w.guard_scale[w.slot[j]] = size
        w.armed[j] = w.side[j] * w.g[j] > 1e-13 * _size(w, j)


@inlined
def _tolerance(w, i):
    return w.reals[RTOL] * max(w.scale[i], 1e-10 * w.group_scale[w.group[i]], 1e-14)


@inlined
def _nudge(w):
    """States and parameters with small relative changes, all different, in `s` and `q`: they show how large the terms are that cancel."""
    for i in range(w.ints[N]):
        w.s[i] = w.x[i] * (1.0 + 1e-7 * (1.0 - 0.3 * (i % 5)))
    for i in range(w.p.size):
        w.q[i] = w.p[i] * (1.0 + 1e-7 * (0.9 - 0.37 * (i % 7)))


@inlined
def _round_off(w):
    """Size of round-off in every slope, from what small changes do to it and from the forces that cancel in it."""
    _nudge(w)
    _call(w.ints[FIELD], w.reals[TIME] * (1.0 + 1e-7), 0.0, w.s, w.k, w.q, w.m, w.z)
    for i in range(w.ints[N]):
        w.noise[i] = 1e7 * abs(w.z[w.ints[N] + i] - w.k[i]) * 32.0 * EPS
    _call(w.ints[BURDEN], w.reals[TIME], 0.0, w.x, w.k, w.p, w.m, w.z)
    for i in range(w.ints[N]):
        w.noise[i] += w.z[i] * 32.0 * EPS


@inlined
def _first_step(w):
    """A first step size by Hairer's rule."""
    n, t = w.ints[N], w.reals[TIME]
    d0, d1, d2 = 0.0, 0.0, 0.0
    for i in range(n):
        tol = _tolerance(w, i)
        d0 += (w.x[i] / tol) ** 2
        d1 += (w.k[i] / tol) ** 2
    _round_off(w)
    h0 = 1e-6 if d0 < 1e-10 or d1 < 1e-10 else 0.01 * math.sqrt(d0 / d1)
    h0 = min(h0, w.reals[END] - t)
    for i in range(n):
        w.y[i] = w.x[i] + h0 * w.k[i]
    _call(w.ints[FIELD], t + h0, 0.0, w.y, w.k, w.p, w.m, w.z)
    for i in range(n):
        d2 += ((w.z[n + i] - w.k[i]) / _tolerance(w, i)) ** 2
    d1 = math.sqrt(d1 / n)
    d2 = math.sqrt(d2 / n) / h0 if h0 > 0.0 else 0.0
    top = max(d1, d2)
    h1 = (0.01 / top) ** (1.0 / w.ints[ORDER]) if top > 1e-15 else max(1e-6, h0 * 1e-3)
    # states that are still zero would make the rule absurdly careful; a step too long is only rejected
    h = max(min(100.0 * h0, h1), 1e-9 * w.reals[END])
    w.reals[STEP_SIZE] = h if h > 0.0 and math.isfinite(h) else 1e-9
    w.reals[STEP_OLD] = 0.0


@inlined
def _record(w, t, x):
    r = w.ints[RECORDS]
    w.rec_t[r] = t
    for i in range(w.rec_x.shape[1]):
        w.rec_x[r, i] = x[i]
    for i in range(w.ints[NE]):
        w.rec_m[r, i] = np.int8(w.m[i])
    first = w.ints[FIRST_HELD]
    for i in range(w.p.size - first):
        w.rec_p[r, i] = w.p[first + i]
    w.ints[RECORDS] = r + 1


@inlined
def _settle(w, t):
    """Decide modes at the current point, note what changed, and make slopes and guards current. False where no modes are consistent."""
    if not _decide(w, t):
        return False
    for i in range(w.ints[NE]):
        if w.m[i] != w.before[i] or w.bounced[i]:
            w.bounced[i] = False
            e = w.ints[EVENTS]
            w.ev_t[e] = t
            w.ev_i[e] = i
            w.ev_m[e, 0] = np.int8(w.before[i])
            w.ev_m[e, 1] = np.int8(w.m[i])
            w.ints[EVENTS] = e + 1
            w.ints[CULPRIT] = i
    _refresh(w)
    return True


@inlined
def _inputs_changed(w, t):
    """After a parameter jumped: elements whose slip jumped away from zero slide, the others are decided by force."""
    ne = w.ints[NE]
    _call(w.ints[PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    wrong = False
    for i in range(ne):
        w.before[i] = w.m[i]
        slip, force, static = w.z[i], w.z[2 * ne + i], w.z[3 * ne + i]
        w.zero[i], w.forced[i] = w.m[i] == 0.0 and w.kind[i] != SWITCH, False
        if w.kind[i] != FRICTION:  # an open contact, like a switch, is seen to by its guard
            wrong = wrong or (w.zero[i] and force > 1e-9 * static)
        elif w.m[i] == 0.0:
            if abs(slip) > 1e-9 * w.guard_scale[2 * i] and slip != 0.0:
                w.m[i] = math.copysign(1.0, slip)
                w.zero[i] = False
                wrong = True
            elif not abs(force) <= static * (1.0 + 1e-9):
                wrong = True
        elif w.m[i] * slip < 0.0:
            w.m[i] = -w.m[i]
            wrong = True
    if wrong:
        return _settle(w, t)
    _refresh(w)
    return True


@inlined
def _jumps(w, t):
    """Apply the parameter jumps due at time t; returns whether there were any."""
    changed = False
    while w.ints[JUMP] < w.jump_t.size and w.jump_t[w.ints[JUMP]] <= t:
        j = w.ints[JUMP]
        for q in range(w.jump_first[j], w.jump_first[j + 1]):
            w.p[w.jump_index[q]] = w.jump_value[q]
        w.ints[JUMP] = j + 1
        changed = True
    return changed


@inlined
def _samples(w, t):
    """Take all samples due at time t, then hold the outputs due. Returns (status, whether a held value was set)."""
    for c in range(w.samplers.shape[0]):
        s = w.samplers[c]
        if s[TAKEN] * w.clocks[c, 0] <= t and t < w.reals[END]:
            if s[ADDRESS] == 0:
                w.ints[CULPRIT] = c
                return SAMPLE_DUE, False
            states, outputs = s[STATES], s[OUTPUTS]
            memory = w.memory[s[FIRST_STATE] :]
            for i in range(states, states + s[NOISES]):
                memory[i] = normal(w.keys[s[FIRST_STATE] + i], s[TAKEN])
            _call(s[ADDRESS], t, 0.0, w.x, memory, w.p, w.m, w.z)
            for i in range(states):
                memory[i] = w.z[i]
            slot = s[TAKEN] % w.queue.shape[1]
            for i in range(outputs):
                w.queue[c, slot, i] = w.z[states + i]
            s[TAKEN] += 1
    changed = False
    for c in range(w.samplers.shape[0]):
        s = w.samplers[c]
        while s[APPLIED] < s[TAKEN] and s[APPLIED] * w.clocks[c, 0] + w.clocks[c, 1] <= t:
            slot = s[APPLIED] % w.queue.shape[1]
            for i in range(s[OUTPUTS]):
                w.p[s[FIRST_OUTPUT] + i] = w.queue[c, slot, i]
            s[APPLIED] += 1
            changed = True
    return DONE, changed


@inlined
def _next_stop(w):
    """The next instant at which a step must end: end of the run, parameter jump, sample or application of a delayed output."""
    stop = w.reals[END]
    if w.ints[JUMP] < w.jump_t.size:
        stop = min(stop, w.jump_t[w.ints[JUMP]])
    for c in range(w.samplers.shape[0]):
        s = w.samplers[c]
        stop = min(stop, s[TAKEN] * w.clocks[c, 0])
        if s[APPLIED] < s[TAKEN]:
            stop = min(stop, s[APPLIED] * w.clocks[c, 0] + w.clocks[c, 1])
    return stop


@inlined
def _error(w, h):
    """Scaled error of the step in `y`: root mean square over the states, in units of the local tolerance.

    A step may add its share of time to the global error (error per unit step): the phase error of a limit cycle adds up over the run. A step of an
    implicit method, which is much shorter only where fast modes die after an event, may add the share of the mean step so far. Hidden forces
    count only as far as guards are interpolated: by the estimate of lowest order, against a fraction of the bound.
    """
    hidden = w.excited.size
    n = w.ints[N] - hidden
    base = 2 * w.ints[N] + 2 * w.ints[NG]
    two = w.ints[TWO_ERRORS] == 1
    sum1, sum2 = 0.0, 0.0
    portion = h
    if w.ints[IMPLICIT] == 1:
        portion = max(h, w.reals[TIME] / (w.ints[ACCEPTED] + 1.0))
    share = max(w.reals[RTOL] * min(portion / w.reals[END], 0.1), 1e-14 if w.reals[RTOL] > 1e-14 else 2e-15)
    for i in range(n):
        size = max(w.scale[i], abs(w.y[i]), 1e-10 * w.group_scale[w.group[i]], 1e-14)
        if w.ints[IMPLICIT] == 1 and abs(w.y[i]) > w.scale[i]:  # nobody knows yet how large it will be
            size = max(size, 1e-4 * w.group_scale[w.group[i]])
        tol = 1.0 / (share * size + w.noise[i] * h)
        e = w.y[base + i] * tol
        sum1 += e * e
        if two:
            e = w.y[base + w.ints[N] + i] * tol
            sum2 += e * e
    if two:
        bottom = sum1 + 0.01 * sum2
        error = 0.0 if bottom == 0.0 else sum1 / math.sqrt(bottom * n)  # NaN stays NaN
    else:
        error = math.sqrt(sum1 / n)
    lowest = base + w.ints[N] if two else base
    for q in range(hidden):
        # where nothing has acted yet the force is taken to become what its rate makes of it in a thousandth of the run
        size = max(w.guard_scale[2 * w.excited[q] + w.ints[NG]], 1e-3 * w.reals[END] * abs(w.k[n + q]), 1e-300)
        error = max(error, abs(w.y[lowest + n + q]) / ((0.02 if two else 3e-4) * size))
    return error


@inlined
def _outputs_before(w, end, t_new):
    """Record the output times inside the step (t, t_new) by stepping to each of them."""
    t = w.reals[TIME]
    while w.ints[OUTPUT] < w.out_t.size and w.out_t[w.ints[OUTPUT]] < t_new:
        if w.ints[RECORDS] >= w.rec_t.size:
            return False
        target = w.out_t[w.ints[OUTPUT]]
        _call(w.ints[STEP], t, target - t, w.x, w.k, w.p, w.m, w.z)
        x = w.z
        for i in range(w.ints[NE]):
            if w.m[i] == 0.0 and w.kind[i] != SWITCH:
                for j in range(w.ints[N]):
                    w.s[j] = w.z[j]
                _call(w.ints[PROJECT], target, 0.0, w.s, w.k, w.p, w.m, w.z)
                break
        _record(w, target, x)
        w.ints[OUTPUT] += 1
    return True


@inlined
def _lowest(a, da, b, db):
    """Place and value of the minimum of the cubic Hermite interpolant between a falling start (da < 0) and a rising end (db > 0)."""
    c2 = 3.0 * (b - a) - 2.0 * da - db
    c3 = 2.0 * (a - b) + da + db
    root = math.sqrt(max(c2 * c2 - 3.0 * c3 * da, 0.0))
    s = -da / (c2 + root) if c2 + root > 0.0 else 0.5
    if not 0.0 < s < 1.0:
        s = 0.5
    return s, a + s * (da + s * (c2 + s * c3))


@inlined
def _dip(w, h, j):
    """Whether guard j, positive at both ends of the step h but falling at first and rising at last, dips below zero inside it.

    Steps to the interpolated minimum, closer and closer, until the guard is negative there (returns the fraction) or the interpolation has
    become sharper than its distance to zero (returns 2).
    """
    n, ng = w.ints[N], w.ints[NG]
    left, right = 0.0, 1.0
    a, da = w.side[j] * w.g[j], w.side[j] * w.g[ng + j] * h
    b, db = w.side[j] * w.g_high[j], w.side[j] * w.g_high[ng + j] * h
    for _ in range(12):
        width = right - left
        s, expected = _lowest(a, da * width, b, db * width)
        middle = left + s * width
        _call(w.ints[STEP], w.reals[TIME], middle * h, w.x, w.k, w.p, w.m, w.y)
        value, slope = w.side[j] * w.y[2 * n + j], w.side[j] * w.y[2 * n + ng + j] * h
        if value < 0.0:
            return middle
        doubt = abs(value - expected)
        if slope < 0.0:
            left, a, da = middle, value, slope
        else:
            right, b, db = middle, value, slope
        if not (da < 0.0 and db > 0.0):
            return 2.0
        _, lowest = _lowest(a, da * (right - left), b, db * (right - left))
        if lowest > doubt or right - left < 1e-7:
            return 2.0
    return 2.0


@inlined
def _candidate(w, h, low, high, width):
    """Earliest fraction of [low, high] (in parts of h) where some guard descends through zero, by Hermite interpolation; 2 where none does."""
    ng = w.ints[NG]
    best = 2.0
    for j in range(ng):
        a, b = w.side[j] * low[j], w.side[j] * high[j]
        if w.armed[j]:
            if not (b <= 0.0 or (low[ng + j] * w.side[j] < 0.0 and high[ng + j] * w.side[j] > 0.0)):
                continue
        elif b >= -1e-12 * _size(w, j):
            continue
        s = _first_descent(a, w.side[j] * low[ng + j] * width * h, b, w.side[j] * high[ng + j] * width * h)
        if s > 1.0 and b <= 0.0:
            s = 1.0
        if s < best:
            best = s
            w.ints[LOCATED] = j
    return best


@inlined
def _rise(w, h, j):
    """Where guard j, at zero now and negative after the step h, is positive in between: a fraction, or 0 where it only falls.

    A contact released exactly at its limit has no slip rate yet, so that neither the guard nor its slope tells which way it goes.
    """
    fraction = 0.5
    for _ in range(24):
        _call(w.ints[STEP], w.reals[TIME], fraction * h, w.x, w.k, w.p, w.m, w.y)
        if w.side[j] * w.y[2 * w.ints[N] + j] > 0.0:
            return fraction
        fraction *= 0.5 if fraction > 0.01 else 0.1
        if fraction < 1e-9:
            break
    return 0.0


@inlined
def _locate(w, h, low):
    """Step from the current point to the first event inside the step h, whose end guards are in `g_high`; its result is left in `y`.

    low: fraction of h before which nothing happens, with guards in `g_low`. Returns the size of the step, or -1 where the interpolated
    dip turns out not to reach zero.
    """
    ng, t = w.ints[NG], w.reals[TIME]
    n = w.ints[N]
    high, fraction = 1.0, 1.0
    for attempt in range(60):
        width = high - low
        s = _candidate(w, h, w.g_low, w.g_high, width)
        if s > 1.0:
            if high == 1.0:
                return -1.0
            _call(w.ints[STEP], t, high * h, w.x, w.k, w.p, w.m, w.y)  # below zero there, by what counts as round-off of a guard that starts at zero
            return high * h
        if attempt > 12:
            s = 0.5
        fraction = low + s * width
        if fraction <= low:
            fraction = low + 0.5 * width
        _call(w.ints[STEP], t, fraction * h, w.x, w.k, w.p, w.m, w.y)
        below, near = False, False
        for j in range(ng):
            value = w.side[j] * w.y[2 * n + j]
            if not w.armed[j] and j != w.ints[LOCATED] and value >= -1e-12 * _size(w, j):
                continue  # round-off of a guard that starts at zero
            if abs(value) <= _close(w, j) and w.side[j] * w.y[2 * n + ng + j] < 0.0:
                near = True
            elif value < 0.0:
                below = True
        if (near and not below) or width * h <= 4.0 * EPS * (abs(t) + h):
            return fraction * h
        if below:
            high = fraction
            for j in range(2 * ng):
                w.g_high[j] = w.y[2 * n + j]
        else:
            low = fraction
            for j in range(2 * ng):
                w.g_low[j] = w.y[2 * n + j]
    return fraction * h


@inlined
def _mark(w, again):
    """Mark the guards that fire now: the located one in any case, others if they are as near to zero and descending, unless it decides again.

    A slip that passes through zero in flight fires alone: it concerns no other element.
    """
    ng = w.ints[NG]
    first = w.ints[LOCATED] // 2 if w.ints[LOCATED] < 2 * w.ints[NE] else -1
    alone = first >= 0 and w.m[first] != 0.0 and _flies(w, first)
    for i in range(w.ints[NE]):
        w.before[i] = w.m[i]
        w.zero[i] = w.m[i] == 0.0 and w.kind[i] != SWITCH
    for j in range(ng):
        rate = w.side[j] * w.g[ng + j]
        # a kink that is at zero and stays there has not been crossed
        near = w.side[j] * w.g[j] <= 1e-9 * _size(w, j) and (rate < 0.0 or (rate == 0.0 and j < 2 * w.ints[NE]))
        flying = j < 2 * w.ints[NE] and w.m[j // 2] != 0.0 and _flies(w, j // 2)
        w.fired[j] = (near and not again and not alone and not flying) or j == w.ints[LOCATED]


@inlined
def _balanced(w, t):
    """Impulses in `y` of an impact of the held elements: unilateral ones that push, friction within its bound. Returns the energy they add.

    Friction holds at first; where its impulse exceeds the bound it slides the way it did, or against the impulse, and holds again where that turned it.
    """
    n, ne = w.ints[N], w.ints[NE]
    for _ in range(4 * ne + 8):
        _call(w.ints[IMPULSE], t, 0.0, w.x, w.held, w.p, w.m, w.y)
        settled = True
        for i in range(ne):
            impulse, before, after, bound = w.y[n + i], w.y[n + ne + i], w.y[n + 2 * ne + i], w.y[n + 3 * ne + i]
            if w.kind[i] == RIGID:
                if w.held[i] == 1.0 and impulse > 0.0:
                    w.held[i] = 0.0
                    settled = False
            elif w.held[i] == 1.0:
                if abs(impulse) > bound * (1.0 + 1e-9) and not w.forced[i]:
                    w.held[i] = 0.0
                    w.m[i] = math.copysign(1.0, before) if before != 0.0 else -math.copysign(1.0, impulse)
                    settled = False
            elif w.attached[i] >= 0 and w.held[w.attached[i]] == 1.0 and w.m[i] * after < 0.0:
                w.held[i], w.m[i], w.forced[i] = 1.0, 0.0, True
                settled = False
        if settled:
            break
    energy, size = 0.0, 0.0
    for i in range(ne):
        energy += 0.5 * w.y[n + i] * (w.y[n + ne + i] + w.y[n + 2 * ne + i])
        size += abs(w.y[n + i] * w.y[n + ne + i])
    return energy if energy > 1e-12 * size else 0.0


@inlined
def _strike(w, t):
    """The impact of the rigid contacts whose gap has just closed; they bounce, or close where the next flight would be too low to be resolved."""
    n, ne = w.ints[N], w.ints[NE]
    for elastic in range(1, -1, -1):
        w.held[ne] = float(elastic)
        for i in range(ne):
            w.forced[i] = False
            w.held[i] = 1.0 if w.kind[i] == RIGID and (w.before[i] == 0.0 or w.fired[2 * i]) else 0.0
            if w.kind[i] != SWITCH:
                w.m[i] = w.before[i]
        for i in range(ne):
            if w.attached[i] >= 0 and w.held[w.attached[i]] == 1.0:
                w.held[i] = 1.0
        if _balanced(w, t) == 0.0:
            break
    for i in range(n):
        w.x[i] = w.y[i]
    for i in range(ne):
        after = w.y[n + 2 * ne + i]
        if w.kind[i] == RIGID:
            if w.before[i] == 0.0:
                w.m[i] = 1.0 - w.held[i]
                w.zero[i] = w.held[i] == 1.0
            elif w.fired[2 * i]:
                w.zero[i] = not after < 0.0
                w.bounced[i] = not w.zero[i]
                w.m[i] = 0.0 if w.zero[i] else 1.0
        elif w.kind[i] == FRICTION:
            w.zero[i] = w.held[i] == 1.0 or abs(after) <= 1e-9 * w.guard_scale[2 * i]
            w.m[i] = 0.0 if w.zero[i] else math.copysign(1.0, after)
    _nudge(w)
    _call(w.ints[FIELD], t * (1.0 + 1e-7), 0.0, w.s, w.k, w.q, w.m, w.z)
    for i in range(ne):
        w.held[i] = w.z[2 * n + 2 * i]
    _call(w.ints[FIELD], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    for i in range(ne):  # round-off of the gap, whose terms may be far larger than itself
        w.held[i] = 64.0 * EPS * 1e7 * abs(w.held[i] - w.z[2 * n + 2 * i])
    _call(w.ints[PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    for i in range(ne):
        if w.bounced[i]:
            after, fall = w.z[i], w.z[ne + i]
            # a flight must also rise well above the depth at which the impact was located, or its end could not be told from its beginning
            if fall > 0.0 and 0.5 * after * after <= fall * max(1e-13 * _size(w, 2 * i), -10.0 * w.g[2 * i], w.held[i]):
                w.bounced[i], w.zero[i], w.m[i] = False, True, 0.0
    _project(w, t)


@inlined
def _fire(w, t):
    """Handle the marked guards: kinks change side, switches turn, elements are put at zero slip or released, and modes are decided."""
    ne, ng = w.ints[NE], w.ints[NG]
    kink, strike = False, False
    for j in range(2 * ne, ng):
        if w.fired[j]:
            w.side[j] = -w.side[j]
            kink = True
    for i in range(ne):
        w.forced[i] = False
        if w.kind[i] == SWITCH and w.fired[2 * i]:
            w.m[i] = 1.0 - w.m[i]
        strike = strike or (w.kind[i] == RIGID and w.before[i] != 0.0 and w.fired[2 * i])
    if strike:
        _strike(w, t)
    for i in range(ne):
        if w.kind[i] == FRICTION and w.before[i] != 0.0 and w.fired[2 * i] and not strike:
            if _flies(w, i):
                w.m[i] = -w.m[i]
                continue
            w.m[i] = 0.0  # its slip has been projected to zero already
            w.zero[i] = True
    for i in range(ne):
        if w.kind[i] == FRICTION and not strike:
            w.forced[i] = w.before[i] == 0.0 and w.fired[2 * i] != w.fired[2 * i + 1]
            if w.forced[i]:
                w.m[i] = -1.0 if w.fired[2 * i] else 1.0
        elif w.kind[i] == RIGID and w.before[i] == 0.0 and w.fired[2 * i] and not strike:
            w.m[i], w.forced[i] = 1.0, True
    events = w.ints[EVENTS]
    if not _settle(w, t):
        return False
    if w.ints[EVENTS] == events and not kink:
        w.ints[MERGED] += 1  # touched zero and went on, or left and came back faster than can be resolved
    return True


@inlined
def _begin(w):
    """Modes from the start state, then slopes, guards and the first step size. False where no modes are consistent.

    An element slides where its slip is not zero; at zero slip force decides. Rigid contacts are closed where their gap is, and does not close or open;
    switches turn until their guards agree.
    """
    n, ne, ng = w.ints[N], w.ints[NE], w.ints[NG]
    t = w.reals[TIME]
    for i in range(ne):
        w.m[i] = w.initial[i]
    # a slip, or a gap, is zero where it is no more than the round-off of its terms, which small relative changes show
    _nudge(w)
    rigid = False
    for i in range(ne):
        rigid = rigid or w.kind[i] == RIGID
    if rigid:
        _call(w.ints[FIELD], t, 0.0, w.s, w.k, w.q, w.m, w.z)
        for i in range(ne):
            w.held[i] = w.z[2 * n + 2 * i]
        _call(w.ints[FIELD], t, 0.0, w.x, w.k, w.p, w.m, w.z)
        for i in range(ne):
            gap = w.z[2 * n + 2 * i]
            close = abs(gap) <= 4.0 * EPS * 1e7 * abs(w.held[i] - gap)
            if w.kind[i] == RIGID and gap < 0.0 and not close:
                w.ints[CULPRIT] = i
                return False
            w.held[i] = 1.0 if close else 0.0
    _call(w.ints[PROBE], t, 0.0, w.s, w.k, w.q, w.m, w.y)
    _call(w.ints[PROBE], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    for i in range(ne):
        slip = w.z[i]
        if w.kind[i] == SWITCH:
            w.zero[i] = False
            continue
        w.zero[i] = abs(slip) <= 4.0 * EPS * 1e7 * abs(w.y[i] - slip)
        if w.kind[i] == RIGID:
            w.zero[i] = w.zero[i] and w.held[i] == 1.0
            w.m[i] = 0.0 if w.zero[i] else 1.0
            continue
        w.m[i] = 0.0 if w.zero[i] else math.copysign(1.0, slip)
    for _ in range(2 * ne):  # a switch may turn another
        _call(w.ints[FIELD], t, 0.0, w.x, w.k, w.p, w.m, w.z)
        turned = False
        for i in range(ne):
            g, rate = w.z[2 * n + 2 * i], w.z[2 * n + ng + 2 * i]
            if w.kind[i] == SWITCH and (g < 0.0 or (g == 0.0 and rate < 0.0)):
                w.m[i] = 1.0 - w.m[i]
                turned = True
        if not turned:
            break
    _project(w, t)
    if not _decide(w, t):
        return False
    _call(w.ints[FIELD], t, 0.0, w.x, w.k, w.p, w.m, w.z)
    for j in range(2 * ne, ng):
        g, rate = w.z[2 * n + j], w.z[2 * n + ng + j]
        w.side[j] = -1.0 if g < 0.0 or (g == 0.0 and rate < 0.0) else 1.0
    _refresh(w)
    return True


@cached
def advance(w):
    """Run until the end time, a full buffer, a sample of a Python controller, the step budget, or a failure; can be called again."""
    w = _borrowed_all(w)
    n, ng, ne = w.ints[N], w.ints[NG], w.ints[NE]
    every_node = w.ints[NODES] == 1
    budget = w.ints[ACCEPTED] + w.ints[REJECTED] + w.ints[BUDGET]
    power = w.reals[POWER]
    rejected = False
    if w.ints[STARTED] == 0 and not _begin(w):
        return INCONSISTENT
    while True:
        t = w.reals[TIME]
        if w.ints[RECORDS] + 4 > w.rec_t.size:
            return RECORDS_FULL
        if w.ints[EVENTS] + 2 * ne + 1 > w.ev_t.size:
            return EVENTS_FULL
        # --- everything due at this instant: events came first, then samples, then updates, then hold
        recorded = False
        for sampling in (False, True):  # a loop, so that the code for what follows a change is there once
            if sampling:
                status, changed = _samples(w, t)
                if status == SAMPLE_DUE:
                    return SAMPLE_DUE
            else:
                changed = _jumps(w, t)
            if not changed:
                continue
            if not _inputs_changed(w, t):
                return INCONSISTENT
            if not sampling:
                _first_step(w)
            if every_node:
                if sampling and w.ints[RECORDS] > 0 and w.rec_t[w.ints[RECORDS] - 1] == t:
                    w.ints[RECORDS] -= 1
                _record(w, t, w.x)
                recorded = True
        if w.ints[STARTED] == 0:
            w.ints[STARTED] = 1
            _first_step(w)
            if every_node and not recorded:
                _record(w, t, w.x)
        while w.ints[OUTPUT] < w.out_t.size and w.out_t[w.ints[OUTPUT]] <= t:
            _record(w, t, w.x)
            w.ints[OUTPUT] += 1
            if w.ints[RECORDS] + 4 > w.rec_t.size:
                return RECORDS_FULL
        if t >= w.reals[END]:
            if every_node and w.rec_t[w.ints[RECORDS] - 1] < t:
                _record(w, t, w.x)
            return DONE
        if w.ints[ACCEPTED] + w.ints[REJECTED] >= budget:
            return PAUSED

        # --- one step
        stop = _next_stop(w)
        h_wanted = min(w.reals[STEP_SIZE], w.reals[LONGEST])
        h, t_new = h_wanted, t + h_wanted
        if t_new >= stop or stop - t_new < 1e-3 * h:
            h, t_new = stop - t, stop
        if h < 1e-14 * abs(t) or h < 1e-300:
            if stop - t <= 1e-13 * abs(t):  # the next stop is closer than can be resolved
                w.reals[TIME] = stop
                continue
            return UNDERFLOW
        _call(w.ints[STEP], t, h, w.x, w.k, w.p, w.m, w.y)
        error = _error(w, h)
        end = 2 * n
        hit, suspicious = False, False
        node = t_new == stop and w.ints[JUMP] < w.jump_t.size and w.jump_t[w.ints[JUMP]] == stop
        # --- guards over the step; a step too long to be trusted may still show where an event cuts it short
        for j in range(ng if error < 1e4 else 0):
            a, b = w.side[j] * w.g[j], w.side[j] * w.y[end + j]
            if w.armed[j]:
                if node and b >= -1e-12 * _size(w, j) and b <= 0.0 and j < 2 * ne and w.m[j // 2] == 0.0 and w.kind[j // 2] == FRICTION:
                    continue  # at its bound where an input turns: what follows decides
                if b <= 0.0:
                    hit = True
                elif w.side[j] * w.g[ng + j] < 0.0 and w.side[j] * w.y[end + ng + j] > 0.0 and error <= 1.0:
                    slope = w.side[j] * w.y[end + ng + j] * h
                    suspicious = suspicious or _lowest(a, w.side[j] * w.g[ng + j] * h, b, slope)[1] <= 0.5 * max(a, b)
            elif b < -1e-12 * _size(w, j):
                hit = True
        if hit or suspicious:
            for j in range(2 * ng):
                w.g_high[j] = w.y[end + j]
        top = 1.0
        if suspicious:
            for j in range(ng):
                a, b = w.side[j] * w.g[j], w.side[j] * w.g_high[j]
                if not (w.armed[j] and b > 0.0 and w.side[j] * w.g[ng + j] < 0.0 and w.side[j] * w.g_high[ng + j] > 0.0):
                    continue
                slope = w.side[j] * w.g_high[ng + j] * h
                if _lowest(a, w.side[j] * w.g[ng + j] * h, b, slope)[1] <= 0.5 * max(a, b):
                    top = min(top, _dip(w, h, j))
            _call(w.ints[STEP], t, top * h, w.x, w.k, w.p, w.m, w.y)
            if top < 1.0:
                hit = True
                h = top * h
                t_new = t + h
                for j in range(2 * ng):
                    w.g_high[j] = w.y[end + j]
        event = False
        if hit:
            low = 0.0
            size = -1.0
            turned = False
            for j in range(2 * ng):
                w.g_low[j] = w.g[j]
            for j in range(ng):
                if w.armed[j] or w.side[j] * w.g_high[j] >= -1e-12 * _size(w, j):
                    continue
                rise = _rise(w, h, j)
                if rise == 0.0 and j >= 2 * ne:  # a kink that starts at zero is on the side it goes to, which changes nothing else
                    w.side[j] = -w.side[j]
                    turned = True
                    break
                if rise == 0.0:  # it goes the wrong way from its start: decide again here
                    w.ints[LOCATED] = j
                    size = 0.0
                    break
                crossed = False
                for i in range(ng):
                    crossed = crossed or (w.armed[i] and w.side[i] * w.y[end + i] <= 0.0)
                if crossed:  # another guard comes first
                    h = rise * h
                    t_new = t + h
                    low = 0.0
                    for i in range(2 * ng):
                        w.g_low[i], w.g_high[i] = w.g[i], w.y[end + i]
                elif low == 0.0 or rise < low:
                    low = rise
                    for i in range(2 * ng):
                        w.g_low[i] = w.y[end + i]
            if turned:
                continue
            if size < 0.0:
                size = _locate(w, h, low)
            if size >= 0.0:
                event = True
                error = _error(w, size) if size > 0.0 else 0.0
                t_new = t + size if size < h else t_new
                h = size
            elif error <= 1.0:
                _call(w.ints[STEP], t, h, w.x, w.k, w.p, w.m, w.y)
        if not error <= 1.0:
            w.ints[REJECTED] += 1
            shrink = 0.9 * error ** (-power) if error < 1e30 else 0.1
            w.reals[STEP_SIZE] = h * max(shrink, 0.1)
            if rejected:
                _round_off(w)
            rejected = True
            continue
        if not _outputs_before(w, t, t_new):
            return RECORDS_FULL
        w.ints[ACCEPTED] += 1
        if not event:
            size = _log2(max(error, 1e-10))
            growth = -power * size
            if w.reals[STEP_OLD] > 0.0:  # Gustafsson's prediction from the last two steps
                growth += min(0.0, _log2(h / w.reals[STEP_OLD]) + power * (w.reals[ERROR_OLD] - size))
            factor = min(1.0 if rejected else 10.0, max(0.2, 0.85 * _exp2(growth)))
            w.reals[ERROR_OLD], w.reals[STEP_OLD] = max(size, -13.3), h
            grown = h * factor
            w.reals[STEP_SIZE] = max(grown, h_wanted) if h < h_wanted else grown
        rejected = False
        refresh = w.ints[ACCEPTED] % 32 == 0

        # --- accept
        if h > 0.0:
            for i in range(n):
                w.x[i] = w.y[i]
                w.k[i] = w.y[n + i]
                size = abs(w.x[i])
                if size > w.scale[i]:
                    w.scale[i] = size
                    if size > w.group_scale[w.group[i]]:
                        w.group_scale[w.group[i]] = size
            for j in range(2 * ng):
                w.g[j] = w.y[end + j]
            for j in range(ng):
                size = abs(w.g[j])
                if size > _size(w, j):
                    w.guard_scale[w.slot[j]] = size
                if not w.armed[j] and w.side[j] * w.g[j] > 1e-13 * _size(w, j):
                    w.armed[j] = True
        w.reals[TIME] = t_new
        if event:  # slips that have just become zero are zero in the record, too
            _mark(w, h == 0.0)
            for i in range(ne):
                if w.kind[i] == FRICTION and w.m[i] != 0.0 and w.fired[2 * i] and not _flies(w, i):
                    w.m[i] = 0.0
            _project(w, t_new)
            for i in range(ne):
                w.m[i] = w.before[i]
        else:
            _project(w, t_new)
        if refresh:
            _round_off(w)
        if every_node and h > 0.0:
            _record(w, t_new, w.x)
        if event:
            if t_new - w.reals[LAST_EVENT] <= 1e-13 * max(abs(t_new), w.reals[END]):
                w.ints[CLOSE] += 1
                if w.ints[CLOSE] > 50 + 20 * ne:
                    return ENDLESS
            else:
                w.ints[CLOSE] = 0
            w.reals[LAST_EVENT] = t_new
            if not _fire(w, t_new):
                return INCONSISTENT
            if w.ints[IMPLICIT] == 1:  # slopes, which the fast modes rule, say less about the next step than the last one does
                w.reals[STEP_OLD] = 0.0
                _round_off(w)
            else:
                _first_step(w)
            if every_node:
                _record(w, t_new, w.x)


@cached
def evaluate(step, project, field, n, ne, ng, node_t, node_x, node_m, node_p, p, first_held, times, x_out):
    """States at `times` by one step from the last node at or before each of them; node_* as recorded, p the whole parameter vector."""
    x, k, m, new = np.zeros(n), np.zeros(n), np.zeros(max(ne, 1)), np.zeros(n)
    y = np.zeros(4 * n + 2 * ng)
    last = -1
    for q in range(times.size):
        r = np.searchsorted(node_t, times[q], side="right") - 1
        if r < 0:
            r = 0
        if r != last:
            for i in range(node_x.shape[1]):
                x[i] = node_x[r, i]
            for i in range(ne):
                m[i] = node_m[r, i]
            for i in range(node_p.shape[1]):
                p[first_held + i] = node_p[r, i]
            _call(field, node_t[r], 0.0, x, k, p, m, y)
            for i in range(n):
                k[i] = y[n + i]
            last = r
        h = times[q] - node_t[r]
        if h == 0.0:
            for i in range(x_out.shape[1]):
                x_out[q, i] = x[i]
            continue
        _call(step, node_t[r], h, x, k, p, m, y)
        for i in range(ne):
            if m[i] == 0.0:
                for j in range(n):
                    new[j] = y[j]
                _call(project, times[q], 0.0, new, k, p, m, y)
                break
        for i in range(x_out.shape[1]):
            x_out[q, i] = y[i]
