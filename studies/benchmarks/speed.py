"""How fast is an answer whose error is at most one part in a million?

Every case is run by the toolbox and by scipy (`studies/benchmarks/reference.py`), each at its fastest setting whose error stays below the target and
that finds the same switches; the error
is the largest difference of a state to a reference at rtol 1e-12, over 401 times of the whole horizon, relative to the size of
that state. All times are medians measured in this run on one core with caches warm; the ratio decides, not the time.

    python -m studies speed            (needs scipy; heyoka for the last column)
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from studies.benchmarks import reference
from studies.benchmarks.cases import Case, cases
from toolbox import Trajectory, simulate

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


@dataclass(frozen=True)
class Fastest:
    """The fastest setting of one program that stays below the target: seconds, its error, and the setting."""

    seconds: float
    error: float
    setting: float


def fastest(settings: Sequence[float], attempt: Callable[[float], tuple[float, bool]], seconds: Callable[[float], float]) -> Fastest | None:
    """Among the settings whose attempt (error, all switches found) meets the target the fastest one; None where none does."""
    found = []
    for setting in settings:
        error, complete = attempt(setting)
        if error <= TARGET and complete:
            found.append(Fastest(seconds(setting), error, setting))
    return min(found, key=lambda one: one.seconds, default=None)


def row(name: str, case: Case) -> str:
    """One line of the table: ours, scipy and, for two cases, heyoka against the same truth."""
    grid = np.linspace(0.0, case.duration, 401)
    truth = case.reference(case.duration, rtol=1e-12 if name != "sampled" else 1e-11, output_times=grid)
    switches = [(s.contact, s.after) for s in truth.switches]

    def ours(accuracy: float) -> Trajectory:
        return simulate(case.plant, case.duration, accuracy=accuracy, **case.arguments)

    def our_attempt(accuracy: float) -> tuple[float, bool]:
        run = ours(accuracy)
        return scaled_error(run.at(grid).states, truth.states), [(e.element, e.after) for e in run.events] == switches

    def their_attempt(run: Callable[..., reference.Reference], **setting: float) -> tuple[float, bool]:
        theirs = run(case.duration, output_times=grid, **setting)
        return scaled_error(theirs.states, truth.states), [(s.contact, s.after) for s in theirs.switches] == switches

    mine = fastest(SETTINGS[:8], our_attempt, lambda accuracy: statistics.median(ours(accuracy).wall_time for _ in range(101)))
    scipy = fastest(
        SETTINGS[:14] if name != "sampled" else SETTINGS[:2],
        lambda rtol: their_attempt(case.reference, rtol=rtol),
        lambda rtol: statistics.median(case.reference(case.duration, rtol=rtol).wall_time for _ in range(3)),
    )
    if mine is None or scipy is None:
        return f"{case.title:<30}  {'the toolbox' if mine is None else 'scipy'} finds no setting with an error <= {TARGET:g} and every switch"
    whole = median_time(lambda: ours(mine.setting), 101)
    line = (
        f"{case.title:<30}{mine.error:9.1e}{1e3 * mine.seconds:9.3f}{1e3 * whole:9.3f}{1e3 * scipy.seconds:9.1f}"
        f"{scipy.seconds / mine.seconds:9.0f}{scipy.seconds / whole:8.0f}"
    )
    make = {"belt": reference.heyoka_belt, "rig": reference.heyoka_rig}.get(name)
    try:
        compiled = {tolerance: make(tolerance) for tolerance in SETTINGS[:14]} if make else {}
    except ImportError:
        compiled = {}
    heyoka = fastest(
        list(compiled),
        lambda tolerance: their_attempt(compiled[tolerance]),
        lambda tolerance: statistics.median(compiled[tolerance](case.duration).wall_time for _ in range(101)),
    )
    return line + (f"{1e3 * heyoka.seconds:9.3f}{mine.seconds / heyoka.seconds:9.2f}" if heyoka else f"{'-':>9}{'-':>9}")


def main() -> None:
    """Print the table."""
    print(f"{'case':<30}{'error':>9}{'kernel':>9}{'call':>9}{'scipy':>9}{'kernel':>9}{'call':>8}{'heyoka':>9}{'kernel/':>9}")
    print(f"{'':<30}{'':>9}{'[ms]':>9}{'[ms]':>9}{'[ms]':>9}{'ratio':>9}{'ratio':>8}{'[ms]':>9}{'heyoka':>9}")
    for name, case in cases().items():
        print(row(name, case), flush=True)


if __name__ == "__main__":
    main()
