"""What do more contacts, kept modes and shorter steps of an elastic face buy, and what do they cost?

    python -m studies contacts            (needs the extra `fe`; some five minutes)

The cube of `studies elastic_sliders`: event-exact rows (11 contacts), and time stepping with the cone on 121 and 289 nodes. Errors of one number are
measured against the finest value of that number, all else equal: the force of the plate over the run, in parts of the largest, and the share that sticks.
Times are of one run each, and mean something only beside each other.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter
from typing import Any

import numpy as np

from studies.questions.elastic_sliders import Pull, face_problem, face_run, first_slips, measures, row_run
from toolbox import ContactRun

TIMES = np.linspace(0.01, 0.24, 231)


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """The result, and its time [s]."""
    begun = perf_counter()
    done = work()
    return done, perf_counter() - begun


def drag(run: ContactRun) -> np.ndarray:
    """The force of the plate at `TIMES` [N]."""
    return np.interp(TIMES, run.time, run.tangential[:, :, 0].sum(axis=1))


def share(run: ContactRun) -> np.ndarray:
    """The share that sticks at `TIMES`."""
    return run.share()[np.searchsorted(run.time, TIMES - 1e-12).clip(0, len(run.time) - 1)]


def against(runs: list[tuple[str, ContactRun, float]], exact: ContactRun) -> None:
    """Print errors and times of runs beside the last of them."""
    for label, run, spent in runs:
        force = np.abs(drag(run) - drag(exact)).max() / np.abs(drag(exact)).max()
        stuck = np.abs(share(run) - share(exact)).mean()
        lost = run.audit()
        print(
            f"{label:34}{force:10.1e}{stuck:10.4f}{lost['stepping'] / lost['size']:10.1e}{run.passes[1:].mean():8.2f}{spent:9.2f} s", flush=True
        )


def main() -> None:
    """Print the tables."""
    print("Rows with located events (11 contacts), by accuracy: last row lets go [s], difference to the rigid slider, events, time")
    rigid = Pull().rigid_time()
    row_run()  # compiles the model
    for accuracy in (1e-4, 1e-5, 1e-6):
        run = row_run(accuracy)
        spent = run.wall_time
        last = first_slips(run).max()
        print(f"{accuracy:10.0e}{last:14.6f}{last / rigid - 1:12.1e}{len(run.events):6d}{spent:9.2f} s", flush=True)
    head = f"{'':34}{'force':>10}{'share':>10}{'lost':>10}{'passes':>8}{'time':>11}"
    problem, made = timed(lambda: face_problem(10))
    print(f"\n121 nodes, by step (reduction {made:.1f} s)\n{head}")
    steps = [8e-3, 4e-3, 2e-3, 1e-3, 5e-4]
    runs = []
    for step in steps:
        run, spent = timed(lambda step=step: face_run(problem, step))  # type: ignore[misc]
        runs.append((f"step {1e3 * step:g} ms", run, spent))
    against(runs[:-1], runs[-1][1])
    print(f"\n121 nodes, by band, step 4 ms\n{head}")
    runs = []
    for band in (0.0, 50e3, 150e3):
        reduced = face_problem(10, band)
        run, spent = timed(lambda reduced=reduced: face_run(reduced, 4e-3))  # type: ignore[misc]
        runs.append((f"band {1e-3 * band:g} kHz, {reduced.size - 366} modes", run, spent))
    against(runs[:-1], runs[-1][1])
    print(f"\nNodes, step 4 ms\n{head}")
    runs = []
    for divisions in (2, 5, 10, 16):
        reduced = face_problem(divisions)
        run, spent = timed(lambda reduced=reduced: face_run(reduced, 4e-3))  # type: ignore[misc]
        runs.append((f"{reduced.contacts} nodes", run, spent))
    against(runs, runs[-1][1])
    for label, run, _ in runs:
        found = measures(run)
        print(f"{label:12}" + ", ".join(f"{word} {found[word]:.4g}" for word in ("share at 0.16 s", "share at 0.20 s", "no node sticks from [s]")))


if __name__ == "__main__":
    main()
