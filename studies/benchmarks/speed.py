"""How fast is an answer whose error is at most one part in a million?

Every case is run by the toolbox, by its explicit formulas, by Taylor series and by the method that it chooses, by scipy
(`studies/benchmarks/reference.py`) and two of them by heyoka, each
at its fastest setting whose error stays below the target and that finds the same switches; the error is the largest difference of a state to a reference at
rtol 1e-12, over 401 times of the whole horizon, relative to the size of that state. Times of the toolbox and of heyoka are the least of turns that
alternate, those of scipy the least of three, on one core with caches warm; the ratio decides, not the time.

    python -m studies speed [--target 1e-6] [--only CASE ...]           (needs scipy; heyoka for the last columns)

With `--against TREE` this tree is compared with another checkout of the project. The two take turns, each in a process of its own with its own compiled code,
and what counts is the median over the turns of the ratio of their processor times, so that the load of the machine and its clock fall out.

    python -m studies speed --against TREE [--turns 9] [--only CASE ...]
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
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

HERE = Path(__file__).resolve().parents[2]
"""This tree."""

SLOWER = 0.03
"""Part by which this tree may be slower than another."""


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


def turn_of(tree: Path, code: Path, names: Sequence[str], accuracy: float) -> dict[str, Any]:
    """Return one turn of a tree (see `one_turn.turn`): by its own interpreter where it has one, with compiled code in a folder of its own."""
    own = [path for path in (tree / ".venv" / "bin" / "python", tree / ".venv" / "Scripts" / "python.exe") if path.exists()]
    script = f"import runpy; runpy.run_path({str(HERE / 'studies' / 'benchmarks' / 'one_turn.py')!r})['report']()"
    asked = [str(own[0]) if own else sys.executable, "-P", "-c", script, ",".join(names), ",".join(METHODS), str(accuracy)]
    surroundings = os.environ | {"PYTHONPATH": str(tree), "STICKSLIP_CACHE_DIR": str(code), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(asked, cwd=tree, env=surroundings, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"The cases do not run in {tree}:\n{done.stderr.strip()}")
    found = json.loads(done.stdout.splitlines()[-1])
    if Path(found["tree"]) != tree:
        raise SystemExit(f"The interpreter of {tree} runs the packages of {found['tree']}.")
    return found


@dataclass(frozen=True)
class Comparison:
    """Processor times of the cases [s] in this tree and another, by turn, shape (turns, cases), and the switches of each."""

    names: tuple[str, ...]
    ours: np.ndarray
    theirs: np.ndarray
    switches: tuple[tuple[int, int], ...]

    @property
    def ratios(self) -> np.ndarray:
        """Median over the turns of the ratio of this tree to the other, shape (cases,)."""
        return np.median(self.ours / self.theirs, axis=0)

    @property
    def overall(self) -> float:
        """Median over the turns of the geometric mean of the ratios of all cases."""
        return float(np.median(np.exp(np.log(self.ours / self.theirs).mean(axis=1))))

    @property
    def keeps(self) -> bool:
        """Whether this tree is at most 3 % slower over all cases."""
        return self.overall <= 1.0 + SLOWER

    def __str__(self) -> str:
        lines = [
            f"{'case and method':<20}{'other':>10}{'this':>10}{'ratio':>9}{'quartiles':>16}{'switches':>12}",
            f"{'':<20}{'[ms]':>10}{'[ms]':>10}",
        ]
        for i, name in enumerate(self.names):
            low, high = np.quantile(self.ours[:, i] / self.theirs[:, i], (0.25, 0.75))
            times = f"{1e3 * np.median(self.theirs[:, i]):10.3f}{1e3 * np.median(self.ours[:, i]):10.3f}"
            theirs, ours = self.switches[i]
            counted = str(ours) if ours == theirs else f"{theirs} / {ours}"
            lines.append(f"{name:<20}{times}{self.ratios[i]:9.3f}{f'{low:.3f} to {high:.3f}':>16}{counted:>12}")
        lines.append(f"{'all':<20}{'':>20}{self.overall:9.3f}")
        slower = [f"{name} ({ratio:.3f})" for name, ratio in zip(self.names, self.ratios, strict=True) if ratio > 1.0 + SLOWER]
        apart = [name for name, (theirs, ours) in zip(self.names, self.switches, strict=True) if theirs != ours]
        verdict = (
            f"This tree is {'within' if self.keeps else 'not within'} {100 * SLOWER:g} % of the other: {100 * (self.overall - 1.0):+.1f} %."
        )
        verdict += f" Slower by more than {100 * SLOWER:g} %: {', '.join(slower) or 'no case'}."
        return "\n".join([*lines, "", verdict + (f" Other switches: {', '.join(apart)}." if apart else "")])


def compared(other: Path, names: Sequence[str], turns: int, accuracy: float) -> Comparison:
    """Return the comparison of this tree with another over turns that alternate, behind one turn each that compiles."""
    with tempfile.TemporaryDirectory() as folder:
        trees = {"other": (other.resolve(), Path(folder) / "other"), "this": (HERE, Path(folder) / "this")}
        found: dict[str, list[dict[str, Any]]] = {name: [] for name in trees}
        for i in range(turns + 1):
            for name in list(trees)[:: 1 if i % 2 else -1]:
                found[name].append(turn_of(*trees[name], names, accuracy))
    if found["this"][0]["versions"] != found["other"][0]["versions"]:
        print(f"This tree runs with {found['this'][0]['versions']}, the other with {found['other'][0]['versions']}.")
    first = {name: each[0]["rows"] for name, each in found.items()}
    for name, rows in first.items():
        for row_name, one in rows.items():
            if "failure" in one:
                print(f"Left out: {row_name}, in {name} tree {one['failure']}")
    both = [name for name, one in first["this"].items() if "seconds" in one and "seconds" in first["other"].get(name, {})]
    if not both:
        raise SystemExit("No case runs in both trees.")
    ours, theirs = ([[one["rows"][name]["seconds"] for name in both] for one in found[tree][1:]] for tree in ("this", "other"))
    switches = [(first["other"][name]["switches"], first["this"][name]["switches"]) for name in both]
    return Comparison(tuple(both), np.array(ours), np.array(theirs), tuple(switches))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = parser_of(__doc__)
    known = cases()
    parser.add_argument("--target", type=float, default=TARGET, help=f"largest error ({TARGET:g})")
    parser.add_argument("--only", nargs="+", choices=list(known), default=list(known), metavar="CASE", help=f"some of: {', '.join(known)}")
    parser.add_argument("--against", type=Path, metavar="TREE", help="another checkout of the project, with which this one is compared")
    parser.add_argument("--turns", type=int, default=9, help="turns in which the two alternate (9)")
    given = parser.parse_args(arguments)
    if given.against is not None:
        if given.turns < 1 or not (given.against / "studies" / "benchmarks" / "cases.py").is_file():
            parser.error("`--turns` must be at least 1, and `--against` a checkout of the project with `studies/benchmarks/cases.py`.")
        comparison = compared(given.against, given.only, given.turns, given.target)
        print(comparison)
        sys.exit(not comparison.keeps)
    print(f"{'':<30}{'explicit formulas':^43}{'Taylor series':^27}{'chosen':^19}{'scipy':>10}{'heyoka':>9}{'chosen/':>9}")
    print(
        f"{'case':<30}{'error':>9}{'kernel':>9}{'call':>9}{'scipy/k':>8}{'/call':>8}{'error':>10}{'kernel':>9}{'scipy/k':>8}{'error':>10}{'kernel':>9}{'':>10}{'':>9}{'heyoka':>9}"
    )
    print(f"{'':<30}{'':>9}{'[ms]':>9}{'[ms]':>9}{'':>16}{'':>10}{'[ms]':>9}{'':>8}{'':>10}{'[ms]':>9}{'[ms]':>10}{'[ms]':>9}")
    for name in given.only:
        print(row(name, known[name], given.target), flush=True)


if __name__ == "__main__":
    main()
