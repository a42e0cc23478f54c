"""Many runs of one closed system at once: one scenario in each lane of a vector of doubles.

Every lane has its own time, step size, error, modes, parameters and events, found and stepped to exactly as in `toolbox.loop`; a lane whose scenario has
ended takes the next one.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from toolbox.errors import SceneError
from toolbox.program import program_of
from toolbox.runge_kutta import DOP853, DOPRI5
from toolbox.simulate import Run
from toolbox.work_arrays import work_arrays

CHUNK = 512
"""Scenarios that a thread takes at once."""


@dataclass(frozen=True)
class Batch:
    """What n scenarios came to.

    states: at the end, shape (n, states);  modes: at the end, shape (n, elements);  statuses: shape (n,), 0 for a finished run, else the status of
    `toolbox.loop` that ended it;  steps, refused, switches, merged, alone: numbers of steps, of refused steps, of changes of mode, of events merged, and
    of steps that the scalar loop took, shape (n,);  stuck: time [s] in mode 0 in the window, shape (n, elements);  last_stick: when mode 0 was left last [s],
    the end where it was not, nan where it never was;  minimum, maximum, mean: of the signals in the window, shape (n, signals);  event_times,
    event_elements, event_modes: the first switches of every scenario, shape (n, most_events), nan and -1 behind the last.
    """

    states: np.ndarray
    modes: np.ndarray
    statuses: np.ndarray
    steps: np.ndarray
    refused: np.ndarray
    switches: np.ndarray
    merged: np.ndarray
    alone: np.ndarray
    stuck: np.ndarray
    last_stick: np.ndarray
    minimum: np.ndarray
    maximum: np.ndarray
    mean: np.ndarray
    event_times: np.ndarray
    event_elements: np.ndarray
    event_modes: np.ndarray


def run_lanes(
    run: Run,
    parameters: np.ndarray,
    starts: np.ndarray,
    *,
    signals: Sequence[str] = (),
    after: float = 0.0,
    most_events: int = 0,
    threads: int = 1,
    width: int | None = None,
) -> Batch:
    """Run n scenarios of a checked run (`toolbox.simulate.checked_run`), which gives the closed system, the inputs, the duration and the accuracy.

    parameters: values of the closed system, one row per scenario, shape (n, `run.system.values.size`);  starts: states, shape (n, states);  signals:
    names of scalar signals to be measured, as accurate as the run;  after: begin of the window that is measured [s];  most_events: switches per scenario
    to be kept;  threads: how many work at once, without the interpreter's lock;  width: number of lanes, a power of two. The method is explicit, whatever
    the run says. Values are not checked against their bounds. Raises SceneError for sampled laws, vector signals, and arrays of another shape.
    """
    from toolbox import lanes_loop, loop
    from toolbox.lanes_kernel import block

    system = run.system
    if system.updates:
        raise SceneError("Argument `run` must have no sampled laws to be run in lanes.")
    n, own = len(parameters), system.x.numel()
    parameters, starts = np.ascontiguousarray(parameters, float), np.ascontiguousarray(starts, float)
    for name, array, columns in (("parameters", parameters, system.values.size), ("starts", starts, own)):
        if array.shape != (n, columns):
            raise SceneError(f"Argument `{name}` must have shape ({n}, {columns}), but it has {array.shape}.")
    program = program_of(system, run.kinds, DOPRI5 if run.accuracy > 1e-5 and not signals else DOP853)
    work = work_arrays(loop, dataclasses.replace(run, output_times=None), program)
    made = block(program, width or host_width(program.machine.states), tuple(signals))
    ne = program.machine.elements
    batch = Batch(
        states=np.full((n, own), np.nan),
        modes=np.zeros((n, ne), np.int8),
        statuses=np.zeros(n, np.int64),
        **dict.fromkeys(("steps", "refused", "switches", "merged", "alone"), np.zeros(0, np.int64)),
        stuck=np.zeros((n, ne)),
        last_stick=np.full((n, ne), np.nan),
        **dict.fromkeys(("minimum", "maximum", "mean"), np.zeros((0, 0))),
        event_times=np.full((n, most_events), np.nan),
        event_elements=np.full((n, most_events), -1, np.int32),
        event_modes=np.zeros((n, most_events), np.int8),
    )
    counts = np.zeros((n, 5), np.int64)
    measured = np.full((n, len(signals), 3), np.nan)
    rows = np.array([made.rows[name] for name in lanes_loop.ITEMS], np.int64)
    window = np.array([after, work.reals[loop.END]])
    scalar = lanes_loop.scalar_address(work)

    def chunk(first: int, last: int) -> None:
        raw = np.zeros(made.size * made.width + 8)
        shift = (-raw.ctypes.data % 64) // 8
        lanes = raw[shift : shift + made.size * made.width].reshape(made.size, made.width)
        own_work = type(work)(*(array.copy() for array in work))._replace(out_t=np.empty(0))
        own_work.ints[loop.NODES] = 0
        lanes_loop.run(
            made.address, made.settle, made.observe, scalar, lanes, lanes[made.rows["waiting"]].view(np.int64), rows, own_work,
            parameters, starts, first, last, window, batch.states, batch.modes, batch.statuses, counts, batch.stuck, batch.last_stick,
            measured, batch.event_times, batch.event_elements, batch.event_modes,
        )  # fmt: skip

    if threads == 1:
        chunk(0, n)
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(lambda first: chunk(first, min(first + CHUNK, n)), range(0, n, CHUNK)))
    names = ("steps", "refused", "switches", "merged", "alone")
    for name, column in zip(names, counts.T, strict=True):
        object.__setattr__(batch, name, column.copy())
    object.__setattr__(batch, "minimum", measured[:, :, 0].copy())
    object.__setattr__(batch, "maximum", measured[:, :, 1].copy())
    object.__setattr__(batch, "mean", measured[:, :, 2] / (window[1] - window[0]) if window[1] > window[0] else measured[:, :, 2] * np.nan)
    return batch


def host_width(states: int) -> int:
    """Lanes that suit this processor and a system of so many states: two vector registers, or one where many states fill them all."""
    import llvmlite.binding as llvm

    return (16 if states < 10 else 8) if llvm.get_host_cpu_features().get("avx512f") else (8 if states < 10 else 4)
