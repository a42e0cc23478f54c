"""What a sweep of a million runs costs, whether it survives a kill, and whether threads or processes do the work sooner.

python -m studies sweeps          a million runs of a block on a belt, streamed to disk, killed with SIGKILL, resumed and compared; then the pools

The block runs for 1 s, sticks and slips; mass and belt speed are random. Memory is the largest the process has held, on disk the files of the zarr store.
Pools: one thread, two, two processes that are there already, and the same with their start, on runs of two kinds: 120 s of a drill string under a
sampled law (4 ms each), and a tuning over four scenes.
"""

from __future__ import annotations

import concurrent.futures
import json
import multiprocessing
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time as clock
from pathlib import Path

import numpy as np

from controllers import PI, StiffPI
from models import BitRock, BlockOnBelt, wells
from studies.timing import timed
from toolbox import Sampled, Scene, closed_loop, compose, sweep, tune
from toolbox.measuring import metrics
from toolbox.scenes.cases import Case
from toolbox.sweeps import uniform

RUNS = 1_000_000


def million(runs: int, out: str | None) -> dict[str, float]:
    """Seconds, peak of memory [MB], files and their size [MB] of so many runs, and how many of them were done by this call."""
    design = uniform({"block.mass": (0.7, 1.3), "block.belt_speed": (0.1, 0.3)}, runs)
    asked = {"end": metrics.final("block.position"), "stuck": metrics.stuck_ratio("belt")}
    found = sweep(closed_loop(compose(BlockOnBelt()), start={"block.position": 0.5}), design, duration=1.0, metrics=asked, checkpoint=out)
    files = [path for path in Path(out).rglob("*") if path.is_file()] if out else []
    return {
        "seconds": found.seconds, "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, "files": len(files),
        "size": sum(path.stat().st_size for path in files) / 1e6, "failed": len(found.failures),
    }  # fmt: skip


def alone(runs: int, out: Path | None) -> subprocess.Popen[str]:
    """`million` in a process of its own."""
    command = [sys.executable, "-m", "studies.benchmarks.sweeps", "--alone", str(runs), *([str(out)] if out else [])]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2])


def line(title: str, process: subprocess.Popen[str]) -> None:
    """Print what a process has measured."""
    found = json.loads(process.communicate()[0])
    print(
        f"{title:<34}{found['seconds']:>9.1f}{found['memory']:>9.0f}{found['files']:>8}{found['size']:>9.1f}{found['failed']:>8}",
        flush=True,
    )


def killed(runs: int) -> None:
    """The table of sweeps in memory, on disk, and killed in the middle."""
    import xarray

    print(f"{'sweep of a block on a belt':<34}{'[s]':>9}{'[MB]':>9}{'files':>8}{'[MB]':>9}{'failed':>8}")
    with tempfile.TemporaryDirectory() as folder:
        whole, half = Path(folder) / "whole.zarr", Path(folder) / "half.zarr"
        line("10 000 runs, in memory", alone(10_000, None))
        line(f"{runs} runs, in memory", alone(runs, None))
        line(f"{runs} runs, on disk", alone(runs, whole))
        process = alone(runs, half)
        chunks = -(-runs // 16_384)
        while process.poll() is None and len(list((half / "status" / "c").glob("[0-9]*"))) < chunks // 3:
            clock.sleep(0.02)
        process.send_signal(signal.SIGKILL)
        process.wait()
        with xarray.open_zarr(half) as data:
            print(f"killed with {int((data['status'] == 1).sum())} runs on disk")
        line("the same call again", alone(runs, half))
        with xarray.open_zarr(whole) as first, xarray.open_zarr(half) as second:
            xarray.testing.assert_equal(first.load(), second.load())
        print("both stores are equal to the last bit")


def scenes() -> list[Scene]:
    """A drill string under four weights."""
    law = Case("drive", PI(reference=9.95, proportional=20e3, integral=2e3), sample_time=0.01)
    return [
        Scene(f"{weight / 1e3:.0f} kN", (wells.JANSEN_2, BitRock(weight=weight)), (law,), 120.0, "bit", "bit.speed", "top.torque", 60.0, reference=9.95)
        for weight in (80e3, 90e3, 100e3, 110e3)
    ]  # fmt: skip


def pools() -> None:
    """The table of executors: seconds, least of five, all in turn."""
    rig, weights = compose(wells.JANSEN_2, BitRock()), {"bit.weight": np.linspace(50e3, 110e3, 400)}
    four, bounds = scenes(), {"stiffpi.proportional": (300.0, 20e3), "stiffpi.integral": (50.0, 5e3)}
    tasks = {
        "sweep": lambda pool: sweep(closed_loop(rig, Sampled(StiffPI(), 0.01)), weights, duration=120.0, executor=pool),
        "tune": lambda pool: tune(four, "drive", "severity", bounds, runs=60, executor=pool),
    }
    spawn = multiprocessing.get_context("spawn")
    kinds = {
        "one thread": concurrent.futures.ThreadPoolExecutor(1), "two threads": concurrent.futures.ThreadPoolExecutor(2),
        "two processes": concurrent.futures.ProcessPoolExecutor(2, mp_context=spawn),
    }  # fmt: skip
    spent: dict[tuple[str, str], list[float]] = {}
    for _ in range(5):
        for task, work in tasks.items():
            for kind, pool in kinds.items():
                given = None if task == "tune" and "thread" in kind else pool
                if task == "tune" and kind == "two threads":
                    continue
                _, seconds = timed(lambda w=work, g=given: w(g), clock=clock.perf_counter)
                spent.setdefault((task, kind), []).append(seconds)
    for task, work in tasks.items():
        began = clock.perf_counter()
        with concurrent.futures.ProcessPoolExecutor(2, mp_context=spawn) as pool:
            work(pool)
        spent[task, "two processes, with their start"] = [clock.perf_counter() - began]
    print(f"\n{'pool':<34}{'sweep [s]':>10}{'tune [s]':>10}")
    for kind in (*kinds, "two processes, with their start"):
        cells = [f"{min(spent[task, kind]):>10.2f}" if (task, kind) in spent else f"{'-':>10}" for task in tasks]
        print(f"{kind:<34}{''.join(cells)}")
    for pool in kinds.values():
        pool.shutdown()


if __name__ == "__main__":
    if sys.argv[1:2] == ["--alone"]:
        print(json.dumps(million(int(sys.argv[2]), sys.argv[3] if len(sys.argv) > 3 else None)))
    else:
        os.environ.setdefault("PYTHONUNBUFFERED", "1")
        killed(RUNS)
        pools()
