"""The layout of the arrays that the compiled loops share: status codes, indices, kinds of elements, and the arrays of one run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from toolbox.modelling.elements import FRICTION, RIGID, SWITCH  # noqa: F401

UNDECIDED = 9.0
"""Mode at the start of an element that begins as the states and forces say."""

# --- status codes of `advance`
(DONE, RECORDS_FULL, EVENTS_FULL, PAUSED, SAMPLE_DUE, ENDLESS, UNDERFLOW, INCONSISTENT, NEGATIVE_BOUND, NO_SERIES, GROWTH,
 NOT_FINITE, STATE_NOT_FINITE, STALLED) = range(14)  # fmt: skip


# --- indices into `Work.ints`: sizes, addresses, counters; the last name of each list is its length
(N, NE, NG, FIELD, STEP, PROJECT, PROBE, BURDEN, IMPULSE, ORDER, TWO_ERRORS, FIRST_HELD, JUMP, OUTPUT, RECORDS, EVENTS, ACCEPTED, REJECTED,
 CLOSE, BUDGET, CULPRIT, STARTED, NODES, LOCATED, MERGED, COUPLED, IMPLICIT, BOUNDS, SERIES, OPENED, LEVERS, LOOKED, INTS) = range(33)  # fmt: skip


FORMULAS = (FIELD, STEP, PROJECT, PROBE, BURDEN, IMPULSE, SERIES, ORDER, IMPLICIT, TWO_ERRORS)
"""What the formulas of a step set, other than sizes."""


SECOND = -2
"""`Work.loader` of the second direction of the friction before it: a switch, which is in mode 0 again when that friction comes to rest."""


OPPOSED = 2
"""`Work.lever` of a rigid contact that stands against another one, which takes over where this one lets go of a body without play."""


PASSES = -3
"""`Work.loader` of a friction on a prescribed motion, or of a relay of higher degree: its slip passes through zero, and no force of its own holds it."""


ONE_WAY = -4
"""`Work.loader` of a one-way clutch: it holds a slip, not a gap, so that it takes part in every impact."""


# --- indices into `Work.reals`; ERROR_OLD is a binary logarithm, FOLLOWED the longest implicit step that follows modes that grow, 0 where it is not known.
# LOOKED_AT is the time of the last look for progress, at which LOOKED steps had been taken.
# The loop returns at END; the run ends at LAST, beyond which no step looks; HORIZON is the time over which the accuracy is promised, of which a step may add
# its share to the error. In `simulate` the three are the same; who steps from one END to the next leaves the others as they are.
TIME, END, STEP_SIZE, RTOL, ERROR_OLD, STEP_OLD, POWER, LAST_EVENT, LONGEST, FOLLOWED, LAST, HORIZON, LOOKED_AT, REALS = range(14)


BY_CONTACT, BY_STATES, BY_NUMBERS = range(3)
"""What changes the bound of a friction, in `Work.bound`: the force of a contact that presses, which is seen to itself; states, time, held signals and other
frictions, so that a guard watches it; or nothing but numbers that a caller changes."""


UNTOLD = 1e-300
"""FOLLOWED where the elimination tells step by step whether a mode outgrows it [s]."""


# --- columns of `Work.samplers`, one row per sampled controller
ADDRESS, TAKEN, APPLIED, FIRST_STATE, STATES, FIRST_OUTPUT, OUTPUTS, NOISES, COLUMNS = range(9)


EPS = 2.220446049250313e-16


CUT_SHORT = 5.0
"""How many times as long the step wanted is at least where one that a stop cuts short says nothing of the next one."""


class Work(NamedTuple):
    """Arrays of one run. n states, ne elements, ng guards; arrays that machine code reads are float64.

    ints, reals: see the indices above;  x, k: state and its slope, which begins a table of coefficients where steps are Taylor series;  p, m:
    parameters and modes;  y, z: output of machine code;
    x_other, p_other, m_other: another point for machine code, such as one moved by round-off, one along a step, or modes that are tried; m_other holds
    slips before a jump too, and in an impact the elements that take part without sliding, then 1 for restitution;
    scale, noise: size of each state so far and round-off of its slope, and behind all slopes that of the guards;
    group, group_scale: states of one unit share a floor;
    g, g_low, g_high: guards then rates;  guard_scale, slot: size of each guard so far, in slip then in stick, and which counts;
    side, armed, fired: per guard;  zero, forced, before: per element;  excited: see above;
    kind, initial: kind of each element and its mode at the start, UNDECIDED where the states and forces decide;
    attached: the rigid contact that loads a friction, or -1;
    loader: the unilateral contact without which a friction has no load, -1, SECOND, PASSES or ONE_WAY;  bound: what changes each bound, see above;
    lever: 1 for a friction whose lever may vanish, OPPOSED or 0;
    struck: rigid contacts that have just been hit;
    rec_*: recorded nodes (time, state, modes, held parameters);  ev_*: events (time, element, modes before and after, and whether other modes were
    consistent, too); jump_*: parameter changes at given times (row pointers into index and value);  out_t: output times;  samplers: see above, with
    period, delay, jitter and probability of a missed sample in `clocks`, the keys of lateness and misses in `clock_keys`, controller states
    and behind them the noise of the sample in `memory`, the key of each noise channel at its place in `keys`, computed outputs waiting in `queue`
    (controller, slot, output).
    """

    ints: np.ndarray
    reals: np.ndarray
    x: np.ndarray
    k: np.ndarray
    p: np.ndarray
    m: np.ndarray
    y: np.ndarray
    z: np.ndarray
    x_other: np.ndarray
    p_other: np.ndarray
    m_other: np.ndarray
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
    lever: np.ndarray
    bound: np.ndarray
    struck: np.ndarray
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
    clock_keys: np.ndarray
    memory: np.ndarray
    keys: np.ndarray
    queue: np.ndarray


KINDS: dict[str, tuple[str, int]] = dict.fromkeys(Work._fields, ("float64", 1)) | {
    "ints": ("int64", 1), "group": ("int64", 1), "slot": ("int64", 1), "kind": ("int64", 1), "attached": ("int64", 1), "loader": ("int64", 1),
    "lever": ("int64", 1), "bound": ("int64", 1), "excited": ("int64", 1), "armed": ("bool", 1), "fired": ("bool", 1), "zero": ("bool", 1),
    "forced": ("bool", 1), "struck": ("bool", 1), "rec_x": ("float64", 2), "rec_m": ("int8", 2), "rec_p": ("float64", 2), "ev_i": ("int32", 1),
    "ev_m": ("int8", 2), "jump_first": ("int64", 1), "jump_index": ("int64", 1), "samplers": ("int64", 2), "clocks": ("float64", 2), "keys": ("uint64", 1),
    "clock_keys": ("uint64", 1), "queue": ("float64", 3),
}  # fmt: skip
"""{field of `Work`: (dtype, number of dimensions)}."""


class Between(NamedTuple):
    """Arrays for states between the nodes of a run: the nodes, what a step needs (x, k, m, a new x, y), and which states are wanted.

    ints: as in `Work`;  p: the whole parameter vector;  row, times: the node that each wanted time follows;  states: filled with them;  passed: ends of
    steps that are no nodes;  first: the first of them after each node.
    """

    ints: np.ndarray
    time: np.ndarray
    state: np.ndarray
    mode: np.ndarray
    held: np.ndarray
    x: np.ndarray
    k: np.ndarray
    m: np.ndarray
    new: np.ndarray
    y: np.ndarray
    p: np.ndarray
    row: np.ndarray
    times: np.ndarray
    states: np.ndarray
    passed: np.ndarray
    first: np.ndarray


BETWEEN_KINDS: dict[str, tuple[str, int]] = dict.fromkeys(Between._fields, ("float64", 1)) | {
    "ints": ("int64", 1), "state": ("float64", 2), "mode": ("int8", 2), "held": ("float64", 2), "row": ("int64", 1), "states": ("float64", 2),
    "first": ("int64", 1),
}  # fmt: skip
