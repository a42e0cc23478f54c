"""How fast is an answer whose error is at most one part in a million?

Every case is run by the toolbox, by its explicit formulas, by Taylor series and by the method that it chooses, by scipy
(`studies/benchmarks/reference.py`) and two of them by heyoka, each
at its fastest setting whose error stays below the target and that finds the same switches; the error is the largest difference of a state to a reference at
rtol 1e-12, over 401 times of the whole horizon, relative to the size of that state. Times of the toolbox and of heyoka are the least of turns that
alternate, those of scipy the least of three, on one core with caches warm; the ratio decides, not the time.

    python -m studies speed [--target 1e-6] [--only CASE ...]           (needs scipy; heyoka for the last columns)
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.benchmarks import reference
from studies.benchmarks.cases import Case, cases
from studies.command_line import parser_of
from studies.timing import least, timed
from toolbox import Trajectory, simulate

TARGET = 1e-6
SETTINGS = [mantissa * 10.0**-power for power in range(4, 13) for mantissa in (1.0, 0.6, 0.3)]
METHODS = ("explicit", "taylor", "event")
TURNS = 101
"""Turns in which ours and heyoka alternate."""


def scaled_error(states: np.ndarray, truth: np.ndarray) -> float:
    """Largest difference of any state, relative to the size of that state."""
    return float((np.abs(states - truth).max(axis=0) / np.abs(truth).max(axis=0)).max())


@dataclass(frozen=True)
class Fastest:
    """The fastest setting of one program that stays below the target: seconds, its error, and the setting."""

    seconds: float
    error: float
    setting: Any


def fastest(
    settings: Sequence[Any], attempt: Callable[[Any], tuple[float, bool]], seconds: Callable[[Any], float], target: float
) -> Fastest | None:
    """Among the settings whose attempt (error, all switches found) meets the target the fastest one; None where none does."""
    found = []
    for setting in settings:
        error, complete = attempt(setting)
        if error <= target and complete:
            found.append(Fastest(seconds(setting), error, setting))
    return min(found, key=lambda one: one.seconds, default=None)


def row(name: str, case: Case, target: float = TARGET) -> str:
    """One line of the table: both methods of the toolbox, scipy and, for two cases, heyoka against the same truth."""
    grid = np.linspace(0.0, case.duration, 401)
    truth = case.reference(case.duration, rtol=1e-12 if name != "sampled" else 1e-11, output_times=grid)
    switches = [(s.contact, s.after) for s in truth.switches]

    def ours(setting: tuple[str, float]) -> Trajectory:
        return simulate(case.loop, case.duration, method=setting[0], accuracy=setting[1])

    def our_attempt(setting: tuple[str, float]) -> tuple[float, bool]:
        run = ours(setting)
        return scaled_error(run.at(grid).states, truth.states), [(e.element, e.after) for e in run.events] == switches

    def their_attempt(run: Callable[..., reference.Reference], **setting: float) -> tuple[float, bool]:
        theirs = run(case.duration, output_times=grid, **setting)
        return scaled_error(theirs.states, truth.states), [(s.contact, s.after) for s in theirs.switches] == switches

    def our_least(setting: tuple[str, float]) -> float:
        return least([lambda: ours(setting).wall_time], 21)[0]

    mine = [fastest([(method, accuracy) for accuracy in SETTINGS[:15]], our_attempt, our_least, target) for method in METHODS]
    scipy = fastest(
        SETTINGS[:21:3] if name != "sampled" else SETTINGS[:3:2],
        lambda rtol: their_attempt(case.reference, rtol=rtol),
        lambda rtol: least([lambda: case.reference(case.duration, rtol=rtol).wall_time], 3)[0],
        target,
    )
    if mine[0] is None or scipy is None:
        return f"{case.title:<30}  {'the toolbox' if mine[0] is None else 'scipy'} finds no setting with an error <= {target:g} and every switch"
    make = {"belt": reference.heyoka_belt, "rig": reference.heyoka_rig}.get(name)
    try:
        compiled = {tolerance: make(tolerance) for tolerance in SETTINGS[:21]} if make else {}
    except ImportError:
        compiled = {}
    heyoka = fastest(
        list(compiled),
        lambda tolerance: their_attempt(compiled[tolerance]),
        lambda tolerance: least([lambda: compiled[tolerance](case.duration).wall_time], 21)[0],
        target,
    )
    explicit, taylor, typed = mine
    assert typed is not None  # whatever it takes, explicit formulas or series
    calls = [lambda: ours(explicit.setting).wall_time, lambda: timed(lambda: ours(explicit.setting), clock=time.perf_counter)[1]]
    calls += [(lambda: ours(taylor.setting).wall_time) if taylor else (lambda: np.nan)]
    calls += [(lambda: compiled[heyoka.setting](case.duration).wall_time) if heyoka else (lambda: np.nan)]
    calls += [lambda: ours(typed.setting).wall_time]
    kernel, whole, series, theirs, default = least(calls, TURNS)
    line = f"{case.title:<30}{explicit.error:9.1e}{1e3 * kernel:9.3f}{1e3 * whole:9.3f}{scipy.seconds / kernel:8.0f}{scipy.seconds / whole:8.0f}"
    line += f"{taylor.error:10.1e}{1e3 * series:9.3f}{scipy.seconds / series:8.0f}" if taylor else f"{'-':>10}{'-':>9}{'-':>8}"
    line += f"{typed.error:10.1e}{1e3 * default:9.3f}{1e3 * scipy.seconds:10.1f}"
    return line + (f"{1e3 * theirs:9.3f}{default / theirs:9.2f}" if heyoka else f"{'-':>9}{'-':>9}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = parser_of(__doc__)
    known = cases()
    parser.add_argument("--target", type=float, default=TARGET, help=f"largest error ({TARGET:g})")
    parser.add_argument("--only", nargs="+", choices=list(known), default=list(known), metavar="CASE", help=f"some of: {', '.join(known)}")
    given = parser.parse_args(arguments)
    print(f"{'':<30}{'explicit formulas':^43}{'Taylor series':^27}{'chosen':^19}{'scipy':>10}{'heyoka':>9}{'chosen/':>9}")
    print(
        f"{'case':<30}{'error':>9}{'kernel':>9}{'call':>9}{'scipy/k':>8}{'/call':>8}{'error':>10}{'kernel':>9}{'scipy/k':>8}{'error':>10}{'kernel':>9}{'':>10}{'':>9}{'heyoka':>9}"
    )
    print(f"{'':<30}{'':>9}{'[ms]':>9}{'[ms]':>9}{'':>16}{'':>10}{'[ms]':>9}{'':>8}{'':>10}{'[ms]':>9}{'[ms]':>10}{'[ms]':>9}")
    for name in given.only:
        print(row(name, known[name], given.target), flush=True)


if __name__ == "__main__":
    main()
