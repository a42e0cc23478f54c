"""How fast is an answer whose error is at most one part in a million?

Every case is run by the toolbox and by scipy (`studies/reference.py`), each at its fastest setting whose error stays below the target; the error
is the largest difference of a state to a reference at rtol 1e-12, over 401 times of the whole horizon, relative to the size of
that state. All times are medians measured in this run on one core with caches warm; the ratio decides, not the time.

    python -m studies.speed            (needs scipy; heyoka for the last column)
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable

import numpy as np

from studies import reference
from studies.cases import Case, cases
from toolbox import simulate

TARGET = 1e-6
SETTINGS = [mantissa * 10.0**-power for power in range(4, 13) for mantissa in (1.0, 0.3)]


def scaled_error(states: np.ndarray, truth: np.ndarray) -> float:
    """Largest difference of any state, relative to the size of that state."""
    return float((np.abs(states - truth).max(axis=0) / np.abs(truth).max(axis=0)).max())


def median_time(call: Callable[[], object], repeats: int) -> float:
    """Median seconds of a call."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def measure(name: str, case: Case) -> dict[str, float | str | bool]:
    """Errors and times of one case."""
    grid = np.linspace(0.0, case.duration, 401)
    truth = case.reference(case.duration, rtol=1e-12 if name != "sampled" else 1e-11, output_times=grid)
    best = np.inf, 0.0, 0.0, None
    for accuracy in SETTINGS[:8]:
        run = simulate(case.plant, case.duration, accuracy=accuracy, **case.arguments)
        error = scaled_error(run.at(grid).states, truth.states)
        same = [(e.element, e.after) for e in run.events] == [(s.contact, s.after) for s in truth.switches]
        if error <= TARGET and same:
            seconds = statistics.median(simulate(case.plant, case.duration, accuracy=accuracy, **case.arguments).wall_time for _ in range(101))
            best = min(best, (seconds, accuracy, error, run), key=lambda entry: entry[0])
    kernel, accuracy, error, run = best
    same = run is not None
    whole = median_time(lambda: simulate(case.plant, case.duration, accuracy=accuracy, **case.arguments), 101)
    scipy = np.inf
    for rtol in SETTINGS[:14] if name != "sampled" else SETTINGS[:2]:
        theirs = case.reference(case.duration, rtol=rtol, output_times=grid)
        if scaled_error(theirs.states, truth.states) <= TARGET and len(theirs.switches) == len(truth.switches):
            seconds = statistics.median(case.reference(case.duration, rtol=rtol).wall_time for _ in range(3))
            if seconds < scipy:
                scipy, their_error = seconds, scaled_error(theirs.states, truth.states)
    row: dict[str, float | str | bool] = {
        "case": case.title, "accuracy": accuracy, "error": error, "same switches": same, "events": len(truth.switches),
        "kernel [ms]": 1e3 * kernel, "call [ms]": 1e3 * whole, "beyond [ms]": 1e3 * (whole - kernel),
        "scipy error": their_error, "scipy [ms]": 1e3 * scipy, "kernel ratio": scipy / kernel, "call ratio": scipy / whole,
    }  # fmt: skip
    return row


def heyoka_time(name: str, case: Case) -> tuple[float, float] | None:
    """Median seconds and error of heyoka at its fastest tolerance below the target, or None for cases it is not set up for."""
    make = {"belt": reference.heyoka_belt, "rig": reference.heyoka_rig}.get(name)
    if make is None:
        return None
    grid = np.linspace(0.0, case.duration, 401)
    truth = case.reference(case.duration, rtol=1e-12, output_times=grid)
    best = None
    for tolerance in SETTINGS[:14]:
        try:
            run = make(tolerance)
        except ImportError:
            return None
        theirs = run(case.duration, grid)
        error = scaled_error(theirs.states, truth.states)
        if error <= TARGET and len(theirs.switches) == len(truth.switches):
            seconds = statistics.median(run(case.duration).wall_time for _ in range(101))
            best = min(best or (np.inf, 0.0), (seconds, error))
    return best


def main() -> None:
    """Print the table."""
    print(f"{'case':<30}{'error':>9}{'same':>6}{'kernel':>9}{'call':>9}{'scipy':>9}{'kernel':>9}{'call':>8}{'heyoka':>9}{'kernel/':>9}")
    print(f"{'':<30}{'':>9}{'':>6}{'[ms]':>9}{'[ms]':>9}{'[ms]':>9}{'ratio':>9}{'ratio':>8}{'[ms]':>9}{'heyoka':>9}")
    for name, case in cases().items():
        row = measure(name, case)
        peer = heyoka_time(name, case)
        tail = f"{1e3 * peer[0]:9.3f}{row['kernel [ms]'] / (1e3 * peer[0]):9.2f}" if peer else f"{'-':>9}{'-':>9}"
        print(
            f"{row['case']:<30}{row['error']:9.1e}{'yes' if row['same switches'] else 'NO':>6}{row['kernel [ms]']:9.3f}{row['call [ms]']:9.3f}"
            f"{row['scipy [ms]']:9.1f}{row['kernel ratio']:9.0f}{row['call ratio']:8.0f}{tail}"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
