"""Many runs of one closed system at once: one scenario in each lane of a vector of doubles.

Every lane has its own time, step size, error, modes, parameters and events, found and stepped to exactly as in `toolbox.stepping.event_stepper`; a
lane whose scenario has ended takes the next one. What a scenario comes to does not depend on its neighbours, to the last bit.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from toolbox.compilation import work_layout
from toolbox.compilation.emitter import register_width
from toolbox.compilation.program import Program, program_of, solved_in_calls
from toolbox.compilation.runge_kutta import DOP853
from toolbox.errors import SceneError
from toolbox.lanes import layout
from toolbox.lanes.layout import ITEMS, BlockArrays, Results, Scenarios, lane_states
from toolbox.measuring.metrics import Metric
from toolbox.measuring.readings import Layout, Readings
from toolbox.modelling.two_directions import check_one_direction
from toolbox.simulation.carry_out import compiled_loop, formulas_of
from toolbox.simulation.methods import Explicit, TaylorSeries
from toolbox.simulation.run import Run
from toolbox.simulation.work_arrays import noise_keys, work_arrays

CHUNK = 512
"""Scenarios that a thread takes at once."""


@dataclass(frozen=True)
class Batch:
    """What n scenarios came to.

    states: at the end, shape (n, states);  modes: at the end, shape (n, elements);  statuses: shape (n,), 0 for a finished run, else the status of
    `toolbox.stepping.event_stepper` that ended it;  steps, refused, switches, merged, alone: numbers of steps, of refused steps, of changes of mode, of
    events merged, and of steps that the scalar loop took, shape (n,);  values: of the measures, shape (n, measures);  doubtful: where a step was too
    long for what a measured signal does in it, shape (n,);  negative: where a bound of friction that varies in time was negative, shape (n,), looked at
    where anything is measured;  event_times, event_elements, event_modes: the first switches of every scenario, shape (n, most_events), nan and -1
    behind the last.
    """

    states: np.ndarray
    modes: np.ndarray
    statuses: np.ndarray
    steps: np.ndarray
    refused: np.ndarray
    switches: np.ndarray
    merged: np.ndarray
    alone: np.ndarray
    values: np.ndarray
    doubtful: np.ndarray
    negative: np.ndarray
    event_times: np.ndarray
    event_elements: np.ndarray
    event_modes: np.ndarray


class Lanes:
    """A checked run (`toolbox.simulation.request.Request`) compiled for lanes: it gives the closed system, the inputs, the duration and the accuracy.

    measures: of `toolbox.measuring.metrics`, as accurate as the run;  width: number of lanes, a power of two. The steps are Taylor series where the run asks
    for them and no law is sampled, else explicit ones; `why` says where a plant has no series. Raises SceneError for laws in Python and for measures
    of what is not there.
    """

    def __init__(self, run: Run, metrics: Sequence[Metric] = (), width: int | None = None):
        from toolbox.compilation.notices import announced
        from toolbox.lanes import loop as lanes_loop
        from toolbox.lanes.kernel import block
        from toolbox.stepping.event_stepper import loop_of

        system = run.system
        if run.controllers:
            raise SceneError("Argument `run` must have no law in Python to be run in lanes.")
        if run.start.carried:
            raise SceneError("Argument `run` must not go on from an earlier run to be run in lanes.")
        check_one_direction(system.elements, "A block of lanes", "run it alone")
        for measure in metrics:
            measure.check(system, run.duration)
        self.loop, self.states, self.values = lanes_loop.run, system.x.numel(), system.values.size
        method = run.method if run.method.in_lanes and not system.updates else Explicit()
        stepped = dataclasses.replace(run, method=method, output_times=None)
        formulas = formulas_of(stepped)
        self.program = program_of(system, run.kinds, DOP853 if metrics and not system.updates and not formulas.interpolates else formulas)
        if self.program.formulas.series and not _by_series(self.program):
            self.program = program_of(system, run.kinds, DOP853)
        self.why = self.program.lacking(formulas, run.kinds)
        self.layout = Layout(self.program, metrics, run.duration)
        compiled_loop(stepped, self.program)
        self.work = work_arrays(stepped, self.program)
        width = width or host_width(self.program)
        late = tuple(clock.delay > 0.0 for clock in run.clocks)
        self.block = block(self.program, width, self.layout.signals, len(self.layout.windows), late)
        self.duration = run.duration
        self.held = self.work.p[self.program.held_slot : self.program.held_slot + system.held.numel()].copy()
        self.rows = np.array([self.block.rows[name] for name in ITEMS], np.int64)
        self.code = np.array([*self.block.code, loop_of(self.work).address], np.int64)
        announced("loop of lanes", lanes_loop.run)
        lanes_loop.run.ready()

    def run(
        self,
        parameters: np.ndarray,
        starts: np.ndarray,
        memories: np.ndarray | None = None,
        held: np.ndarray | None = None,
        *,
        seeds: np.ndarray | None = None,
        clocks: np.ndarray | None = None,
        most_events: int = 0,
        threads: int = 1,
    ) -> Batch:
        """Run n scenarios.

        parameters: values of the closed system, and behind them coefficients of inputs where they vary, in the layout of `Program`, one row per scenario;
        starts: states, shape (n, states);  memories, held: of the sampled laws and the signals they hold at the start, as in
        `toolbox.sweeps.batch.Task`, None for those of the run;  seeds: of the noise, as there;  clocks: sample times and delays, as there, none
        shorter, or longer on its way, than those of the run;  most_events: switches per scenario to be kept;
        threads: how many work at once, without the lock of Python. Values are not checked against their bounds. Raises SceneError for arrays of another shape.
        """
        from toolbox.lanes.samples import noise_table, queue_sizes

        n, ne = len(parameters), self.program.kernel.elements
        parameters, starts = np.ascontiguousarray(parameters, float), np.ascontiguousarray(starts, float)
        columns = parameters.shape[-1] if parameters.shape[-1] == self.program.first_held else self.values
        memories, held = (
            np.tile(own, (n, 1)) if given is None else np.ascontiguousarray(given, float)
            for given, own in ((memories, self.work.memory), (held, self.held))
        )
        for name, array, wanted in (
            ("parameters", parameters, columns),
            ("starts", starts, self.states),
            ("memories", memories, self.work.memory.size),
            ("held", held, self.held.size),
        ):
            if array.shape != (n, wanted):
                raise SceneError(f"Argument `{name}` must have shape ({n}, {wanted}), but it has {array.shape}.")
        readings = Readings.of(self.layout, (n,))
        found = Results(
            states=np.full((n, self.states), np.nan), modes=np.zeros((n, ne), np.int8), statuses=np.zeros(n, np.int64),
            counts=np.zeros((n, 5), np.int64), doubtful=np.zeros(n, np.bool_), **vars(readings),
            event_times=np.full((n, most_events), np.nan), event_elements=np.full((n, most_events), -1, np.int32),
            event_modes=np.zeros((n, most_events), np.int8),
        )  # fmt: skip
        windows = self.layout.windows
        courses, which = self.work.keys[None], np.zeros(n, np.int64)
        if seeds is not None and n:
            rows, which = np.unique(seeds, axis=0, return_inverse=True)
            courses = np.array([noise_keys(self.program.system.updates, row) for row in rows.tolist()])
        which = which.ravel()
        own = (
            np.tile(self.work.clocks[:, :2].ravel(), (n, 1))
            if clocks is None
            else np.ascontiguousarray(clocks[:, :, :2], float).reshape(n, -1)
        )
        noise, keys, first = (
            noise_table(self.work, courses, own[:, ::2].min(axis=0, initial=np.inf), self.duration),
            courses[which],
            float(courses.shape[1]) * which,
        )
        given = Scenarios(
            parameters, starts, memories, held, keys, first, own, windows, windows.ravel(), self.layout.asked, self.work.p.copy()
        )

        def chunk(first: int, last: int) -> None:
            made = self.block
            raw = np.zeros(made.size * made.width + 8)
            shift = (-raw.ctypes.data % 64) // 8
            block = raw[shift : shift + made.size * made.width].reshape(made.size, made.width)
            own_work = type(self.work)(*(array.copy() for array in self.work))._replace(out_t=np.empty(0))
            own_work.ints[work_layout.NODES] = 0
            reals = own_work.reals
            block[layout.STOP_ROW], block[layout.FLAG_ROW] = np.inf, layout.STOP
            block[layout.LONGEST_ROW], block[layout.END_ROW], block[layout.RTOL_ROW] = (
                reals[k] for k in (work_layout.LONGEST, work_layout.END, work_layout.RTOL)
            )
            waiting, due = (block[made.rows[name]].view(np.int64) for name in ("waiting", "due"))
            queue = np.zeros((own_work.queue.size, made.width))
            waiting[0], sizes = 1, queue_sizes(own_work.queue, noise)
            arrays = BlockArrays(self.code, np.array([first, last]), block, waiting, due, self.rows, sizes, noise, queue)
            self.loop(arrays, given, found, lane_states(own_work, made.width, self.layout.count), own_work)

        if threads == 1:
            chunk(0, n)
        else:
            with ThreadPoolExecutor(threads) as pool:
                list(pool.map(lambda first: chunk(first, min(first + CHUNK, n)), range(0, n, CHUNK)))
        found.statuses[(found.statuses == work_layout.DONE) & ~np.isfinite(found.states).all(axis=1)] = work_layout.NOT_FINITE
        steps, refused, switches, merged, alone = found.counts.T.copy()
        return Batch(
            found.states, found.modes, found.statuses, steps, refused, switches, merged, alone, self.layout.values(readings), found.doubtful,
            np.asarray(self.layout.negative(readings).any(axis=-1)), found.event_times, found.event_elements, found.event_modes,
        )  # fmt: skip


def has_series(run: Run) -> bool:
    """Whether the runs of a checked run like this one can step by Taylor series in lanes."""
    if run.system.updates:
        return False
    return _by_series(program_of(run.system, run.kinds, TaylorSeries().formulas(run.accuracy, run.system)))


def _by_series(program: Program) -> bool:
    """Whether lanes step a program by its series: not where forces are solved for in calls."""
    return program.formulas.series and not solved_in_calls(program.form)


def host_width(program: Program) -> int:
    """Return the number of lanes that suits this processor and a program: two vector registers, or a single register if many states or
    series coefficients fill all registers."""
    full = program.kernel.states >= 10 or program.formulas.series
    return register_width() * (1 if full else 2)
