"""The runs of a sweep in chunks on threads, processes or any other executor, with what is finished on disk.

Why threads and not processes by default: the event loop runs without the lock of the interpreter, so that threads are as fast as processes, and need
not start (2.5 s each time), nor a script guarded by `__name__ == "__main__"`, nor a copy of the machine in every process. Laws and measures
in Python hold the lock: they run in processes.
"""

from __future__ import annotations

import concurrent.futures
import concurrent.futures.process
import contextlib
import dataclasses
import itertools
import multiprocessing
import os
import pickle
import queue
import signal
import sys
import threading
import time as clock
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from toolbox.errors import SceneError, SimulationError
from toolbox.files.interrupts import GATE, undivided
from toolbox.messages import progress_bar
from toolbox.simulation.carry_out import carry_out
from toolbox.simulation.methods import METHODS, Implicit, Method, TaylorSeries
from toolbox.simulation.run import Run
from toolbox.simulation.trajectory import Trajectory
from toolbox.sweeps.batch import FEWEST_LANES, Outcome, Task, finished, lanes_of, pays_in_lanes, single
from toolbox.sweeps.chunks import WAITING, Columns
from toolbox.sweeps.store import PAUSE, Store

WORK = 0.5
"""Seconds of work in one chunk, about."""

START = 5.0
"""Seconds of work below which processes for laws in Python are not worth starting."""


PATIENCE = 0.3
"""Seconds that runs which have begun are waited for when a sweep ends early."""

AHEAD = 4096
"""Chunks handed to an executor before the first is done: enough for any cluster, few enough for a sweep of any length to fit in memory."""


@dataclass(frozen=True)
class Manner:
    """Choice of the computation of a sweep, made once: the method, whether to use lanes, and the seconds of a single run."""

    method: Method
    lanes: bool
    cost: float

    @staticmethod
    def noted(notes: Mapping[str, Any], run: Run) -> Manner:
        """Return the choice from the `notes` of an earlier call for the same runs. The method keeps its own options."""
        method = notes["method"]
        return Manner(run.method if run.method.text == method else METHODS[method], notes["lanes"], notes["cost"])

    @property
    def notes(self) -> dict[str, Any]:
        """What a store keeps of it."""
        return {"method": self.method.text, "lanes": self.lanes, "cost": self.cost}

    def together(self, runs: int, lanes: int) -> int:
        """Runs in one chunk: about `WORK` of them, and enough chunks for all cores, but so many that their lanes are full."""
        cores = os.cpu_count() or 1
        size = min(int(WORK / self.cost) if self.cost > 0 else runs, -(-runs // (4 * cores)))
        fewest = min(FEWEST_LANES, lanes * -(-runs // (cores * lanes))) if self.lanes else 1
        return min(max(size, fewest), runs)


def evaluated(
    task: Task,
    broken: Mapping[int, str],
    executor: concurrent.futures.Executor | None = None,
    store: Store | None = None,
    manner: Manner | None = None,
) -> tuple[np.ndarray, dict[int, str], float]:
    """(measures of all runs, errors, seconds) of a task cut into chunks; `broken` runs count as failed, whatever they give.

    store: where finished runs are kept, and those of an earlier call are found;  manner: that of earlier runs of the same kind. Raises SceneError for laws that
    cannot travel, OSError where the disk is full.
    """
    began = clock.perf_counter()
    check_executor(executor)
    total = len(task.numbers)
    columns = Columns.empty(total, len(task.metrics)) if store is None else store.columns()
    manner = Manner.noted(store.settings, task.run) if store is not None and store.settings is not None else manner or probed(task, broken)
    task = dataclasses.replace(task, run=dataclasses.replace(task.run, method=manner.method), lanes=manner.lanes)
    lanes = lanes_of(task) if manner.lanes else 1
    size = manner.together(total, lanes)
    if store is not None and store.settings is None:
        store.begin(manner.notes, size)
    left = int((columns.status == WAITING).sum())
    if not left:
        return columns.values, columns.errors, 0.0
    chunks = _chunks(columns.status, store.ranges if store is not None else [(0, total)], size, lanes)

    def take(outcome: Outcome) -> None:
        first, last = outcome.first, outcome.first + len(outcome.values)
        columns.put(first, outcome.values, {**outcome.errors, **{i: broken[i] for i in range(first, last) if i in broken}})
        if store is not None:
            store.changed(first, last)

    waiting: set[concurrent.futures.Future[Outcome]] = set()
    arrived: queue.SimpleQueue[concurrent.futures.Future[Outcome]] = queue.SimpleQueue()
    pool = executor or _pool(task, manner.cost * left)

    def submit(chunk: tuple[int, int]) -> None:
        future = pool.submit(finished, task.part(slice(*chunk)))
        waiting.add(future)
        future.add_done_callback(arrived.put)

    try:
        with GATE.kept(), travelling(task.run, task.metrics), progress_bar(total, "sweep", done=total - left) as bar:
            for chunk in itertools.islice(chunks, AHEAD):
                submit(chunk)
            while waiting:
                future = _next(arrived)
                for chunk in itertools.islice(chunks, 1):
                    submit(chunk)
                waiting.discard(future)  # and its result with it
                outcome = future.result()
                with undivided():
                    take(outcome)
                if store is not None:
                    store.flush(columns, PAUSE)
                bar.update(len(outcome.values))
    except KeyboardInterrupt as interrupt:
        _kept(store, columns, waiting, take, pool if executor is None else None)
        done = int((columns.status != WAITING).sum())
        kept = f"are in `{store.path}`; the same call goes on from there" if store is not None else "are lost; with `out` they are kept"
        interrupt.add_note(f"{done} of {total} runs {kept}." if done else "no run was finished.")
        raise
    finally:
        _kept(store, columns, waiting, take, pool if executor is None else None)
    if store is not None:
        store.flush(columns)
    return columns.values, dict(sorted(columns.errors.items())), clock.perf_counter() - began


def _next(arrived: queue.SimpleQueue[concurrent.futures.Future[Outcome]]) -> concurrent.futures.Future[Outcome]:
    """What comes first; raises KeyboardInterrupt where the process is to end."""
    while True:
        GATE.check()
        with contextlib.suppress(queue.Empty):
            return arrived.get(timeout=0.1)


def check_executor(given: Any) -> None:
    """Raise SceneError unless the argument is None or an executor."""
    if given is not None and not isinstance(given, concurrent.futures.Executor):
        raise SceneError(f"Argument `executor` must be a concurrent.futures.Executor, such as a ProcessPoolExecutor, but it is {given!r}.")


@contextlib.contextmanager
def travelling(*sent: Any) -> Iterator[None]:
    """Raise SceneError, in words for the user, if the objects sent to other processes cannot be pickled."""
    try:
        yield
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        try:
            pickle.dumps(sent)
        except (pickle.PicklingError, AttributeError, TypeError):
            raise SceneError(
                f"Laws, measures and objectives that travel to other processes must be importable, but one is not: {error}"
            ) from None
        raise
    except concurrent.futures.process.BrokenProcessPool:
        GATE.check(patience=0.5)  # what came to the whole group ends this process, too, and may be told a moment later
        raise SceneError(
            'Laws, measures and objectives in Python must come from a module or a script whose own work stands under `if __name__ == "__main__":`, '
            "because they travel to other processes; or do without an `executor` of processes."
        ) from None


def _kept(
    store: Store | None,
    columns: Columns,
    waiting: set[concurrent.futures.Future[Outcome]],
    take: Any,
    own: concurrent.futures.Executor | None,
) -> None:
    """Begin nothing more, wait a moment for what runs, and write what has come in."""
    with undivided():
        running = [future for future in waiting if not future.cancel()]
        if own is not None:
            own.shutdown(wait=not running, cancel_futures=True)
        concurrent.futures.wait(running, PATIENCE)
        while waiting:
            future = waiting.pop()
            if future.done() and not future.cancelled() and future.exception() is None:
                take(future.result())
        if store is not None:
            with contextlib.suppress(OSError):  # what fails to be written has been said, or is written again
                store.flush(columns)


def _chunks(status: np.ndarray, ranges: list[tuple[int, int]], size: int, lanes: int) -> Iterator[tuple[int, int]]:
    """(first, behind the last) of runs that wait, about `size` of them each, none across the borders of the ranges.

    All but the last fill their lanes: runs that are equally long would leave most of them empty at the end of every chunk.
    """
    for first, last in ranges:
        edges = np.flatnonzero(np.diff(np.concatenate([[False], status[first:last] == WAITING, [False]])))
        for a, b in edges.reshape(-1, 2).tolist():
            even = np.linspace(0, b - a, max(1, round((b - a) / size)) + 1).astype(int)
            cuts = np.unique(np.minimum(a - even // -lanes * lanes, b)).tolist()
            yield from ((first + low, first + high) for low, high in itertools.pairwise(cuts))


def _pool(task: Task, seconds: float) -> concurrent.futures.Executor:
    """Threads for laws in machine code; processes for laws in Python, or one thread where that is done before processes have started."""
    cores = os.cpu_count() or 1
    if not task.run.controllers or seconds < START:
        return concurrent.futures.ThreadPoolExecutor(1 if task.run.controllers else cores)
    return Workers(cores)


QUIET = "ignore:resource_tracker:UserWarning"
"""Option of the processes that begin here: Python's own clearer of semaphores tells on stderr what an interrupted command leaves it, and clears it anyway."""


class Workers(concurrent.futures.ProcessPoolExecutor):
    """So many processes that work for this one: they do not hear Ctrl-C, from their first instruction on, and end with it, however it ends.

    Each has one thread of linear algebra, unless OPENBLAS_NUM_THREADS says another number. With more, OpenBLAS hands half of even a 6 x 6 triangular
    system to a thread that has to wait for a core where all are busy: 8 ms in place of 16 us, so that two searches side by side took twice their time.
    """

    def __init__(self, processes: int) -> None:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # what the processes inherit; this one has read its own
        if QUIET not in sys.warnoptions:
            sys.warnoptions.append(QUIET)
        super().__init__(processes, mp_context=multiprocessing.get_context("spawn"), initializer=bound)

    def submit(self, *arguments: Any, **named: Any) -> concurrent.futures.Future[Any]:
        """Submit a call with interrupts blocked. A process that starts meanwhile inherits the block."""
        if not hasattr(signal, "pthread_sigmask"):
            return super().submit(*arguments, **named)
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return super().submit(*arguments, **named)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def bound() -> None:
    """Begin a worker process. Ctrl-C reaches all processes of a terminal, so the worker ignores it; the parent decides, and the worker ends
    with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def follow() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def probed(task: Task, broken: Container[int] = ()) -> Manner:
    """The method that the middle run asks for, whether runs like it pay in lanes, and the seconds that it takes alone.

    Where the steps are to be chosen, runs in lanes step by Taylor series wherever the plant has them. broken: runs that are none, as their numbers contradict
    each other; where all are, nothing is tried.
    """
    runs = len(task.numbers)
    middle = min((i for i in range(runs) if i not in broken), key=lambda i: abs(i - runs // 2), default=None)
    method = task.run.method
    if method.watches_stiffness:
        method = method.unwatched(task.run.accuracy, task.run.system)
        if middle is not None and not task.run.controllers:
            found: Trajectory | None
            try:
                found = carry_out(single(task, middle))
            except SimulationError as failure:
                found = failure.run
            if found is not None and found.program.formulas.implicit:
                method = Implicit()
    if middle is None:
        return Manner(method, False, 0.0)
    alone = dataclasses.replace(task, run=dataclasses.replace(task.run, method=method)).part(slice(middle, middle + 1))
    steps = finished(alone).steps  # compiles
    lanes, seconds = pays_in_lanes(dataclasses.replace(task, run=alone.run), steps), finished(alone).seconds
    if lanes and method != task.run.method:
        from toolbox.lanes.lanes import has_series

        method = TaylorSeries() if has_series(alone.run) else method
    return Manner(method, lanes, seconds)
