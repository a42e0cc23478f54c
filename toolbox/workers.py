"""The runs of a sweep in chunks on threads, processes or any other executor, with finished chunks on disk."""

from __future__ import annotations

import concurrent.futures
import concurrent.futures.process
import dataclasses
import json
import math
import multiprocessing
import os
import pickle
import time as clock
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from toolbox.batch import FEWEST_LANES, Outcome, Task, finished, pays_in_lanes, single
from toolbox.errors import SceneError, SimulationError
from toolbox.files import replaced
from toolbox.simulate import carry_out
from toolbox.trajectory import Trajectory

WORK = 0.5
"""Seconds of work in one chunk, about."""

START = 5.0
"""Seconds of work below which processes for laws in Python are not worth starting."""

MANIFEST = "sweep.json"


def evaluated(
    task: Task,
    broken: Mapping[int, str],
    executor: concurrent.futures.Executor | None = None,
    out: str | Path | None = None,
    fingerprint: Mapping[str, str] | None = None,
    label: str = "sweep",
) -> tuple[np.ndarray, dict[int, str], float]:
    """(measures of all runs, errors, seconds) of a task cut into chunks; `broken` runs are not tried.

    out, fingerprint: a folder for finished chunks, and what it must have been made of to be continued.
    """
    began = clock.perf_counter()
    total = len(task.numbers)
    values = np.full((total, len(task.measures)), np.nan)
    errors = dict(broken)
    chunks: list[tuple[int, int]] | None = None
    cost = math.inf
    done: dict[tuple[int, int], tuple[np.ndarray, dict[int, str]]] = {}
    folder = Path(out) if out is not None else None
    method, lanes = task.run.method, False
    if folder is not None:
        chunks, method, lanes, done = _resumed(folder, fingerprint or {}, method)
    if chunks is None:
        method, lanes, cost = _probed(task)
        workers = os.cpu_count() or 1
        size = max(1, min(int(WORK / cost) if cost > 0 else total, -(-total // (4 * workers))))
        size = min(max(size, FEWEST_LANES), total) if lanes else size
        chunks = [(first, min(first + size, total)) for first in range(0, total, size)]
        if folder is not None:
            _begun(folder, fingerprint or {}, method, lanes, chunks)
    task = dataclasses.replace(task, run=dataclasses.replace(task.run, method=method), lanes=lanes)
    for (first, last), (rows, failed) in done.items():
        values[first:last] = rows
        errors |= failed
    left = [chunk for chunk in chunks if chunk not in done]
    if not left:
        return values, errors, 0.0

    def take(outcome: Outcome) -> None:
        last = outcome.first + len(outcome.values)
        for i in range(outcome.first, last):
            if i in broken:
                outcome.values[i - outcome.first] = np.nan
                outcome.errors[i] = broken[i]
        values[outcome.first : last] = outcome.values
        errors.update(outcome.errors)
        if folder is not None:
            _written(folder, outcome)

    own = executor is None
    pool = executor or _pool(task, cost * total)
    from tqdm import tqdm

    waiting: list[concurrent.futures.Future[Outcome]] = []
    try:
        with tqdm(
            total=total, initial=total - sum(b - a for a, b in left), unit="run", desc=label, delay=1.0, leave=False, disable=None
        ) as bar:
            waiting = [pool.submit(finished, task.part(slice(*chunk))) for chunk in left]
            for future in concurrent.futures.as_completed(waiting):
                outcome = future.result()
                take(outcome)
                bar.update(len(outcome.values))
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        if "pickle" not in str(error):
            raise
        raise SceneError(f"Laws and measures that travel to other processes must be importable, but one is not: {error}") from None
    except concurrent.futures.process.BrokenProcessPool:
        raise SceneError(
            'Laws and measures in Python must come from a module or a script whose own work stands under `if __name__ == "__main__":`, because '
            "they travel to other processes; or give an `executor` of threads."
        ) from None
    finally:
        for future in waiting:
            future.cancel()
        if own:
            pool.shutdown(wait=True, cancel_futures=True)
    return values, dict(sorted(errors.items())), clock.perf_counter() - began


def _pool(task: Task, seconds: float) -> concurrent.futures.Executor:
    """Threads for laws in machine code; processes for laws in Python, or one thread where that is done before processes have started."""
    workers = os.cpu_count() or 1
    if not task.run.laws or seconds < START:
        return concurrent.futures.ThreadPoolExecutor(1 if task.run.laws else workers)
    return concurrent.futures.ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))


def _probed(task: Task) -> tuple[str, bool, float]:
    """The method that the middle run asks for, whether runs like it pay in lanes, and the seconds that it takes alone."""
    middle = len(task.numbers) // 2
    method = task.run.method
    if method == "event":
        method = "explicit"
        if not task.run.laws:
            found: Trajectory | None
            try:
                found = carry_out(single(task, middle))
            except SimulationError as failure:
                found = failure.run
            if found is not None and found.run.method == "stiff":
                method = "stiff"
    alone = dataclasses.replace(task, run=dataclasses.replace(task.run, method=method)).part(slice(middle, middle + 1))
    steps = finished(alone).steps  # compiles
    return method, pays_in_lanes(dataclasses.replace(task, run=alone.run), steps), finished(alone).seconds


def folder_of(path: Path) -> None:
    """Make a folder with its parents; raises SceneError where that cannot be."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SceneError(f"Argument `out` must be a folder that can be written, but `{path}` cannot: {error.strerror}.") from None


def _begun(folder: Path, fingerprint: Mapping[str, str], method: str, lanes: bool, chunks: Sequence[tuple[int, int]]) -> None:
    folder_of(folder)
    with replaced(folder / MANIFEST) as file:
        file.write(json.dumps({"arguments": dict(fingerprint), "method": method, "lanes": lanes, "chunks": chunks}).encode())


def _resumed(
    folder: Path, fingerprint: Mapping[str, str], method: str
) -> tuple[list[tuple[int, int]] | None, str, bool, dict[tuple[int, int], tuple[np.ndarray, dict[int, str]]]]:
    """(chunks, method, whether in lanes, finished ones) of a sweep that was begun in this folder; (None, ...) where none was."""
    if not (folder / MANIFEST).is_file():
        if folder.exists() and (not folder.is_dir() or any(not path.name.startswith(f".{MANIFEST}.") for path in folder.iterdir())):
            raise SceneError(f"Argument `out` must be an empty or new folder, or that of a sweep to be continued, but `{folder}` is not.")
        return None, method, False, {}
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        before, chunks = manifest["arguments"], [(int(a), int(b)) for a, b in manifest["chunks"]]
        method, lanes = manifest["method"], bool(manifest["lanes"])
    except (OSError, ValueError, KeyError, TypeError):
        raise SceneError(f"Argument `out` must be the folder of a sweep, but `{folder / MANIFEST}` is damaged.") from None
    other = [word for word in fingerprint if before.get(word) != fingerprint[word]]
    if other:
        raise SceneError(
            f"Argument `out` must be a new folder, or that of the same sweep, but `{folder}` holds one with other {', '.join(f'`{word}`' for word in other)}."
        )
    done = {}
    for chunk in chunks:
        path = _path(folder, chunk[0])
        if path.is_file():
            with np.load(path, allow_pickle=False) as data:
                errors = {int(i): text for i, text in json.loads(str(data["errors"])).items()}
                done[chunk] = (data["values"], errors)
    for path in folder.glob(".runs_*"):  # what was being written when the sweep was killed
        path.unlink(missing_ok=True)
    return chunks, method, lanes, done


def _path(folder: Path, first: int) -> Path:
    return folder / f"runs_{first:08d}.npz"


def _written(folder: Path, outcome: Outcome) -> None:
    with replaced(_path(folder, outcome.first)) as file:
        np.savez(file, values=outcome.values, errors=np.array(json.dumps({str(i): text for i, text in outcome.errors.items()})))
