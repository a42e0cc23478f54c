"""Does the event loop agree with a reference that shares no code with it?

Random machines (`studies.benchmarks.rubbing_machines`) are run by the methods event, explicit and stiff, some of them side by side in lanes, at accuracies of
1e-5 to 1e-8, and compared with `studies.benchmarks.enumerated_modes` at 101 times. Every run is

    right       states agree within ten times the accuracy asked, relative to their size over the run; where the difference exceeds the accuracy and 1e-8,
                `run.error_estimate` is at least a hundredth of it
    foretold    they do not, but `run.error_estimate` said so, to a hundredth of it
    wrong       they do not, or `run.error_estimate` is silent
    refused     the run ends in an error, though the reference goes through
    hanging     it spends its budget of steps or seconds, or the second run of `run.error_estimate` does
    crash       an exception that is none of the toolbox's own, or a process that dies
    left out    the reference alone cannot say: two sets of modes agree with the forces at some event, or, asked where a run is not right, its results at
                1e-12 and 1e-10 disagree

    python -m studies fuzz --reference [--structures 300] [--draws 3] [--seed 1] [--jobs 2] [--first N] [--log FOLDER]

With `--log` what is found stays in a folder, and the same command goes on where it was stopped.
"""

from __future__ import annotations

import faulthandler
import json
import os
import subprocess
import sys
import tempfile
import time as clock
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from studies.benchmarks.enumerated_modes import LeftOut, Reference
from studies.benchmarks.rubbing_machines import KINDS, Trial, given, trial
from toolbox import Budget, ClosedLoop, HybridSystem, Sampled, SceneError, SimulationError, closed_loop, compose, simulate, sweep
from toolbox.errors import BudgetError
from toolbox.measuring import metrics
from toolbox.simulation.methods import METHODS

BUDGET = Budget(steps=500_000, seconds=30.0)
ACCURACIES = (1e-5, 1e-6, 1e-7, 1e-8)
AGREED = 1e-8
"""Relative difference of the two references from which on a trial is left out."""
SMALLEST = 1e-6
"""Size [m, m/s] of a state that moves at all, of machines whose parameters are all about 1."""
OWN = 1e-12
"""Difference [m, m/s] up to which the reference says nothing: a hundred times the absolute error of one of its steps, all that moves in it at rest."""
DEFECTS = ("wrong", "refused", "hanging", "crash")
LANES = 64
LONGEST = 600
"""Seconds for the trials of one machine, compilation and all, before its process is given up."""


def sure(one: Trial, times: np.ndarray, right: np.ndarray) -> bool:
    """Whether the reference at 1e-10 confirms its states at 1e-12."""
    try:
        return _apart(Reference(one, 1e-10).run(times), right) <= AGREED
    except LeftOut:
        return False


def _apart(states: np.ndarray, right: np.ndarray) -> float:
    """Largest difference of a state, relative to its size over the run; one that is round-off of the others, or of a machine at rest, counts with theirs."""
    size = np.abs(right).max(axis=0)
    difference = np.abs(states - right)
    return float(np.max(np.where(difference > OWN, difference, 0.0) / np.maximum(size, max(1e-10 * size.max(), SMALLEST))))


def loop_of(plant: HybridSystem, one: Trial) -> ClosedLoop:
    """The closed loop of a trial."""
    law = one.law and Sampled(one.law[0], one.law[1], delay=one.law[2])
    return closed_loop(plant, law or None, start=one.start, inputs=given(one.inputs))


def with_numbers_of(plant: HybridSystem, one: Trial) -> HybridSystem:
    """The plant of the first draw with the numbers of another one."""
    values = {
        name: getattr(one.machine, name.partition(".")[2]) for name in plant.parameters if hasattr(one.machine, name.partition(".")[2])
    }
    return plant.with_parameters({name: np.array(value) for name, value in values.items()})


def judged(plant: HybridSystem, one: Trial, right: np.ndarray, times: np.ndarray, **how: Any) -> dict[str, Any]:
    """The verdict on one run."""
    try:
        run = simulate(loop_of(plant, one), one.duration, output_times=times, **how)
    except BudgetError as failed:
        return {"end": "hanging", "words": str(failed)}
    except (SceneError, SimulationError) as failed:
        return {"end": "refused", "words": f"{type(failed).__name__}: {failed}"}
    except Exception as failed:
        return {"end": "crash", "words": f"{type(failed).__name__}: {failed}"}
    error, found = (
        _apart(run.states[:, : right.shape[1]][:, _order(run, right.shape[1])], right),
        {"steps": run.steps[0], "events": len(run.events)},
    )
    if error > max(how["accuracy"], 1e-8):
        began = clock.perf_counter()
        try:
            said = run.error_estimate
        except SimulationError as failed:
            return found | {"end": "hanging", "words": f"run.error_estimate: {failed}"}
        if clock.perf_counter() - began > BUDGET.seconds:
            return found | {"end": "hanging", "words": f"run.error_estimate took {clock.perf_counter() - began:.3g} s"}
        foretold = said >= error / 100
        end = ("right" if error <= 10 * how["accuracy"] else "foretold") if foretold else "wrong"
        return found | {"end": end, "error": error, "said": said}
    return found | {"end": "right", "error": error}


def _order(run: Any, size: int) -> list[int]:
    """Columns of the positions, then of the speeds, in the states of a run."""
    places = run.program.system.states
    return [places[f"machine.{kind}{i}"][0] for kind in "xv" for i in range(size // 2)]


def judged_in_lanes(plant: HybridSystem, one: Trial, right: np.ndarray, accuracy: float) -> dict[str, Any]:
    """The verdict on a sweep over the damping of the first mass, whose first run is the trial."""
    rows = [{"machine.damping.0": one.machine.damping[0] + 1e-3 * k} for k in range(LANES)]
    names = [f"machine.{kind}{i}" for kind in "xv" for i in range(len(one.machine.mass))]
    try:
        found = sweep(loop_of(plant, one), rows, one.duration, accuracy=accuracy, metrics={name: metrics.final(name) for name in names})
    except (SceneError, SimulationError) as failed:
        return {"end": "refused", "words": f"{type(failed).__name__}: {failed}"}
    except Exception as failed:
        return {"end": "crash", "words": f"{type(failed).__name__}: {failed}"}
    if found.failures:
        return {"end": "refused", "words": str(next(iter(found.failures.values())))}
    last = np.array([found[name][0] for name in names])
    error = _apart(np.where(np.arange(len(right))[:, None] == len(right) - 1, last, right), right)
    return {"end": "right" if error <= max(10 * accuracy, 1e-7) else "wrong", "error": error}


def examine(seed: int, number: int, draws: int, say: Callable[..., None]) -> None:
    """All draws of one machine, by every method; `say` is told every verdict."""
    plant: HybridSystem | None = None
    for draw in range(draws):
        one = trial(seed, number, draw)
        times = np.linspace(0.0, one.duration, 101)
        try:
            right = Reference(one, 1e-12).run(times)
        except LeftOut as why:
            say(draw=draw, end="left out", words=str(why))
            continue
        try:
            plant = compose(one.machine) if plant is None else with_numbers_of(plant, one)
        except Exception as failed:
            say(draw=draw, end="crash", words=f"{type(failed).__name__}: {failed}")
            continue
        accuracy = ACCURACIES[(number + draw) % len(ACCURACIES)]
        methods = ["event"] + ["explicit"] * ((number + draw) % 4 == 1) + ["stiff"] * (number % 3 == 0)
        found = [
            {"method": method} | judged(plant, one, right, times, method=replace(METHODS[method], budget=BUDGET), accuracy=accuracy)
            for method in methods
        ]
        if number % 5 == 0 and draw == 0:
            found.append({"method": "lanes"} | judged_in_lanes(plant, one, right, accuracy))
        if any(verdict["end"] != "right" for verdict in found) and not sure(one, times, right):
            say(draw=draw, end="left out", words="two tolerances disagree")
            continue
        for verdict in found:
            say(draw=draw, accuracy=accuracy, **verdict)


# ------------------------------------------------------------------------------------------------------------------------------- processes
def lines_of(log: Path) -> Iterator[dict[str, Any]]:
    """What a log holds; the last line may have been cut by a kill."""
    if log.exists():
        for line in log.read_text(encoding="utf-8").splitlines():
            try:
                yield json.loads(line)
            except json.JSONDecodeError:
                continue


def work(seed: int, draws: int, numbers: range, log: Path) -> None:
    """The machines of one process, as far as its log does not hold them; what it finds is written line by line, each machine complete or not at all."""
    done = {line["number"] for line in lines_of(log) if line.get("end") == "done"}
    parent = os.getppid()
    with log.open("a", encoding="utf-8") as file:
        for number in numbers:
            if number in done:
                continue
            if os.getppid() != parent:  # the search was killed, and another one may write to this log
                return
            found: list[dict[str, Any]] = []
            file.write(json.dumps({"number": number, "begin": True}) + "\n")
            file.flush()
            faulthandler.dump_traceback_later(LONGEST, exit=True)
            examine(seed, number, draws, lambda **words: found.append({"number": number} | words))  # noqa: B023
            faulthandler.cancel_dump_traceback_later()
            file.write("".join(json.dumps(line) + "\n" for line in [*found, {"number": number, "end": "done"}]))
            file.flush()


def _started(seed: int, draws: int, numbers: range, log: Path) -> subprocess.Popen[bytes]:
    words = [str(word) for word in (seed, draws, numbers.start, numbers.stop, numbers.step, log)]
    command = [sys.executable, "-m", "studies.benchmarks.differential", *words]
    with log.with_suffix(".err").open("wb") as errors:
        return subprocess.Popen(command, env=os.environ | {"OMP_NUM_THREADS": "1"}, stderr=errors)


def main(structures: int, draws: int, seed: int, jobs: int, first: int, log: str | None) -> int:
    """Examine machines in processes of their own, with a line of progress, and print what was found; the number of defects."""
    with tempfile.TemporaryDirectory() as passing:
        folder = Path(log or passing) / f"{seed}-{draws}-{jobs}"
        folder.mkdir(parents=True, exist_ok=True)
        rows = {range(first + k, first + structures, jobs): folder / f"{first}-{k}.jsonl" for k in range(jobs)}
        running = {numbers: _started(seed, draws, numbers, path) for numbers, path in rows.items()}
        told: set[str] = set()
        began = clock.perf_counter()
        try:
            while running:
                clock.sleep(1.0)
                for numbers, process in list(running.items()):
                    if process.poll() is None:
                        continue
                    del running[numbers]
                    if process.returncode:  # it died at the machine that it had begun, and goes on after it
                        _give_up(rows[numbers])
                        running[numbers] = _started(seed, draws, numbers, rows[numbers])
                _tell(list(rows.values()), structures, told, clock.perf_counter() - began)
        finally:
            for process in running.values():
                process.terminate()
        return _report(list(rows.values()))


def _give_up(log: Path) -> None:
    """Note that the process died at the machine that its log shows begun."""
    begun = [line["number"] for line in lines_of(log) if "begin" in line]
    why = log.with_suffix(".err").read_text(encoding="utf-8", errors="replace")[-1200:]
    if not begun:
        raise RuntimeError(f"The process does not start: {why}")
    found = {"end": "crash", "words": f"the process died: {why}"}
    if "Timeout" in why and "enumerated_modes.py" in why:  # the watch over the whole trial found it in the reference
        found = {"end": "left out", "words": f"the reference takes more than {LONGEST} s"}
    with log.open("a", encoding="utf-8") as file:
        file.write(json.dumps({"number": begun[-1], "draw": 0, **found}) + "\n")
        file.write(json.dumps({"number": begun[-1], "end": "done"}) + "\n")


def _tell(logs: list[Path], structures: int, told: set[str], spent: float) -> None:
    """Print defects that are new, and how far the search is."""
    lines = [line for log in logs for line in lines_of(log)]
    for line in lines:
        words = json.dumps(line)
        if line.get("end") in DEFECTS and words not in told:
            told.add(words)
            print(f"  {KINDS[line['number'] % len(KINDS)]} {words}", flush=True)
    done = sum(line.get("end") == "done" for line in lines)
    if sys.stderr.isatty():
        print(f"\r{done} of {structures} machines in {spent:.0f} s", end="", file=sys.stderr, flush=True)


def _report(logs: list[Path]) -> int:
    """Print the counts; the number of defects."""
    found = {(line["number"], line.get("draw"), line.get("method")): line for log in logs for line in lines_of(log) if "end" in line}
    lines = list(found.values())  # a machine that was killed in the middle of writing is there twice
    machines = sum(line["end"] == "done" for line in lines)
    counts: Counter[str] = Counter(line["end"] for line in lines if line["end"] != "done")
    trials = len({(line["number"], line["draw"]) for line in lines if "draw" in line})
    print(f"\n{machines} machines, {trials} draws, {sum(counts.values()) - counts['left out']} runs")
    for kind, count in counts.most_common():
        share = f"  {100 * count / max(trials, 1):.2f} % of the draws" if kind == "left out" else ""
        print(f"  {kind:<10}{count:8d}{share}")
    for why, count in Counter(line["words"] for line in lines if line["end"] == "left out").most_common():
        print(f"  left out, {why:<40}{count:8d}")
    errors = [line["error"] / line["accuracy"] for line in lines if line["end"] == "right"]
    if errors:
        print(f"  error / accuracy of those that are right: median {np.median(errors):.2g}, 99 % {np.quantile(errors, 0.99):.2g}")
    return sum(counts[kind] for kind in DEFECTS)


if __name__ == "__main__":
    SEED, DRAWS, START, STOP, STRIDE = map(int, sys.argv[1:6])
    work(SEED, DRAWS, range(START, STOP, STRIDE), Path(sys.argv[6]))
