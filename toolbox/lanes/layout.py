"""What the loop over blocks of lanes is given: why a lane waits, the rows of a block, and the arrays of scenarios, results and lanes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from toolbox.compilation.work_layout import NE, N, Work

GOES_ON, EVENT, ALONE, ROUND_OFF, STOP, SAMPLE = range(6)
"""Why a lane waits: an event has been stepped to; a step for the scalar loop; round-off to be measured again; an instant of the run's calendar; a sample."""
(TIME_ROW, WANTED_ROW, STOP_ROW, ERROR_OLD_ROW, STEP_OLD_ROW, REJECTED_ROW, SEARCHING_ROW, WHOLE_ROW, LOW_ROW, HIGH_ROW, FRACTION_ROW, TRIES_ROW,
 LONGEST_ROW, END_ROW, RTOL_ROW, ACCEPTED_ROW, REFUSED_ROW, FLAG_ROW, LOCATED_ROW, WAITING_ROW) = range(20)  # fmt: skip
"""Rows of a block with one number per lane, as `SCALARS` of `toolbox.lanes.trial_step` names them."""
X, K, P, M, G, SIDE, ARMED, GUARD_SCALE, SCALE, GROUP_SCALE = range(10)
NOISE, OTHER_SCALE, EDGES, MEASURED, DOUBT, CALENDAR, SAMPLES, MEMORY, COURSE, CLOCKS = range(10, 20)
ITEMS = ("x", "k", "p", "m", "g", "side", "armed", "guard_scale", "scale", "group_scale", "noise", "other_scale", "edges", "measured", "doubt",
         "calendar", "samples", "memory", "course", "clocks")  # fmt: skip
"""Items of a block whose first rows the loop is told, in this order."""
ENDLESS_FLAG = 9
"""Why a lane waits whose events do not end."""
GOING = -1
"""What stands for the status of a scenario that has none yet: it goes on in its lane."""
SLACK = 2e-13
"""Part of an instant by which a step may miss the edge of a window."""
MOST_STEPS = 20_000_000
"""Steps after which a scenario ends with the status PAUSED."""


PASS, SETTLE, OBSERVE, SAMPLING, SCALAR = range(5)
"""Addresses of the functions of a block (0 for none): the pass, the settling of events, the signals, the samples, and the scalar loop."""


class BlockArrays(NamedTuple):
    """The arrays of one block.

    code: the addresses `PASS` to `SCALAR`;  span: the first scenario, and the one behind the last;  block: shape (rows, lanes);  waiting, due: its rows of
    these names as integers;  rows: the first rows of `ITEMS`;  sizes, noise, queue: see `toolbox.lanes.samples`.
    """

    code: np.ndarray
    span: np.ndarray
    block: np.ndarray
    waiting: np.ndarray
    due: np.ndarray
    rows: np.ndarray
    sizes: np.ndarray
    noise: np.ndarray
    queue: np.ndarray


class Scenarios(NamedTuple):
    """Input of the loop over blocks: a row per scenario, and the values common to all scenarios.

    parameters, starts;  memories, held: of sampled laws;  keys: of their noise, and `courses`, the first row of it in the table of noise;
    clocks: (sample time, delay) of every law, one behind the other;
    windows: (begin, end) of each, whose inner edges the steps end on, and `edges`, the same in a row;
    asked: rows (element, mode, begin, end of the window);  rest: parameters of the scalar loop, of which those of a scenario are the first.
    """

    parameters: np.ndarray
    starts: np.ndarray
    memories: np.ndarray
    held: np.ndarray
    keys: np.ndarray
    courses: np.ndarray
    clocks: np.ndarray
    windows: np.ndarray
    edges: np.ndarray
    asked: np.ndarray
    rest: np.ndarray


class Results(NamedTuple):
    """Results of the scenarios, a row each.

    states, modes, statuses: at the end;  counts: steps, refused steps, switches, merged events, and steps that the scalar loop took;  lowest to switches: the
    arrays of a `toolbox.measuring.readings.Readings`;  doubtful: whether extrema are doubtful (see `toolbox.lanes.extrema`);  event_*: the first
    switches of every scenario, as many as there is room for.
    """

    states: np.ndarray
    modes: np.ndarray
    statuses: np.ndarray
    counts: np.ndarray
    doubtful: np.ndarray
    lowest: np.ndarray
    highest: np.ndarray
    integral: np.ndarray
    ends: np.ndarray
    spent: np.ndarray
    number: np.ndarray
    latest: np.ndarray
    switches: np.ndarray
    event_times: np.ndarray
    event_elements: np.ndarray
    event_modes: np.ndarray


class LaneStates(NamedTuple):
    """Memory of the loop for every lane, a row each.

    scenario: which it runs, -1 for none;  modes: before the next event;  last_event, close: time of the last event, and events that have followed one
    another at one instant;  jump: the next change of a parameter;  since: begin of the current stay of each element;  happened: whether an event waits.
    x_old, k_old, m_old, p_old: one step of the scalar loop begins with these;  signals: measured at three instants.
    """

    scenario: np.ndarray
    modes: np.ndarray
    last_event: np.ndarray
    close: np.ndarray
    jump: np.ndarray
    since: np.ndarray
    happened: np.ndarray
    x_old: np.ndarray
    k_old: np.ndarray
    m_old: np.ndarray
    p_old: np.ndarray
    signals: np.ndarray


def lane_states(work: Work, width: int, signals: int) -> LaneStates:
    """Lanes without a scenario, for the arrays of a scalar loop and so many signals."""
    n, ne = work.ints[N], work.ints[NE]
    return LaneStates(
        scenario=np.full(width, -1, np.int64), modes=np.zeros((width, ne)), last_event=np.zeros(width),
        close=np.zeros(width, np.int64), jump=np.zeros(width, np.int64), since=np.zeros((width, ne)), happened=np.zeros(width, np.bool_),
        x_old=np.zeros(n), k_old=np.zeros(work.k.size), m_old=np.zeros(max(ne, 1)), p_old=np.zeros(work.p.size), signals=np.zeros((3, signals)),
    )  # fmt: skip


def _kinds(fields: tuple[str, ...], **others: tuple[str, int]) -> dict[str, tuple[str, int]]:
    return dict.fromkeys(fields, ("float64", 2)) | others


BLOCK_KINDS = _kinds(
    BlockArrays._fields,
    code=("int64", 1),
    span=("int64", 1),
    waiting=("int64", 1),
    due=("int64", 1),
    rows=("int64", 1),
    sizes=("float64", 1),
)
SCENARIO_KINDS = _kinds(Scenarios._fields, keys=("uint64", 2), courses=("float64", 1), edges=("float64", 1), rest=("float64", 1))
RESULT_KINDS = _kinds(
    Results._fields, modes=("int8", 2), statuses=("int64", 1), counts=("int64", 2), doubtful=("bool", 1), lowest=("float64", 3),
    highest=("float64", 3), integral=("float64", 3), event_elements=("int32", 2), event_modes=("int8", 2),
)  # fmt: skip
LANE_KINDS = _kinds(
    LaneStates._fields, scenario=("int64", 1), last_event=("float64", 1), close=("int64", 1), jump=("int64", 1), happened=("bool", 1),
    x_old=("float64", 1), k_old=("float64", 1), m_old=("float64", 1), p_old=("float64", 1),
)  # fmt: skip
"""{field: (dtype, number of dimensions)} of the arrays that the loop over blocks is given."""
