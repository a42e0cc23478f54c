"""What does an answer cost before and beyond the event loop?

Measured in fresh processes: `from toolbox import compose, simulate` beside `import casadi, numpy`, `import toolbox`, the first answer with warm caches,
the first answer of a machine with empty caches (the event loop is compiled once), the overhead of a `simulate` call beyond its loop, the memory of
10 000 s of a drill string with an output every 0.1 s, and for chains of 10, 100 and 1000 elements with friction at the bit the time to compose and compile
them anew, the same with their machine code in the cache, and the memory of the process.

    python -m studies start_up
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile

FIRST_ANSWER = """
import time; began = time.perf_counter()
import toolbox; imported = time.perf_counter()
from models import BitRock, wells
rig = toolbox.compose(wells.JANSEN_2, BitRock(weight=97_000.0))
run = toolbox.simulate(rig, 100.0, inputs={"top.torque": 10_000.0})
print(imported - began, time.perf_counter() - began)
"""

OVERHEAD = """
import statistics, time
from controllers import PI
from models import BitRock, wells
from toolbox import compose, simulate
rig = compose(wells.JANSEN_2, BitRock(weight=97_000.0))
for arguments in ({"inputs": {"top.torque": 10_000.0}}, {"controller": PI(reference=8.0)}, {"controller": PI(reference=8.0), "sample_time": 0.01}):
    beyond = []
    for _ in range(200):
        began = time.perf_counter()
        run = simulate(rig, 20.0, **arguments)
        beyond.append(time.perf_counter() - began - run.wall_time)
    print(statistics.median(beyond))
"""

MEMORY = """
import resource, numpy as np
from models import BitRock, wells
from toolbox import compose, simulate
rig = compose(wells.JANSEN_2, BitRock(weight=97_000.0))
run = simulate(rig, 10_000.0, inputs={"top.torque": 10_000.0}, output_times=np.arange(0.0, 10_000.01, 0.1)[:100_001])
run["bit.speed"], run.modes["bit"]
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, run.wall_time, len(run.events))
"""


CHAIN = """
import resource, sys, time
from models import BitRock, TorsionalChain
from toolbox import compose, simulate
simulate(compose(TorsionalChain(), BitRock()), 0.0)
n = int(sys.argv[1])
began = time.perf_counter()
rig = compose(
    TorsionalChain(inertia=(2122.0,) + (374.0 / n,) * n, stiffness=(473.0 * n,) * n, damping=(23.2,) * n, top_drag=425.0), BitRock(weight=97_000.0)
)
composed = time.perf_counter()
simulate(rig, 0.0, inputs={"top.torque": 10_000.0})
print(composed - began, time.perf_counter() - composed, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""


def fresh(program: str, *arguments: str, **environment: str) -> list[list[float]]:
    """Numbers that a program prints in a process of its own, a list per line."""
    result = subprocess.run(
        [sys.executable, "-c", program, *arguments], env={**os.environ, **environment}, capture_output=True, text=True, check=True
    )
    return [[float(word) for word in line.split()] for line in result.stdout.splitlines()]


def import_times(repetitions: int = 25) -> tuple[float, float]:
    """Processor time [s] of a process that imports casadi and numpy, and of one that imports `compose` and `simulate`: the least of alternating ones."""
    programs = ("import casadi, numpy", "from toolbox import compose, simulate")
    # with byte code on disk for both, as after every installation: Python would compile the toolbox anew each time, and casadi, which is installed, not
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    least = dict.fromkeys(programs, float("inf"))
    for _ in range(1 + repetitions):
        for program in programs:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            subprocess.run([sys.executable, "-c", program], env=environment, check=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            least[program] = min(least[program], after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return least[programs[0]], least[programs[1]]


def main() -> None:
    """Print the figures."""
    below, own = import_times()
    print(f"import casadi, numpy                 {below:8.3f} s")
    print(f"  compose and simulate with them     {own:8.3f} s, {own / below:.2f} x")
    fresh(FIRST_ANSWER)
    warm = [fresh(FIRST_ANSWER)[0] for _ in range(5)]
    with tempfile.TemporaryDirectory() as empty:
        cold = fresh(FIRST_ANSWER, STICKSLIP_CACHE_DIR=empty)[0]
    beyond = fresh(OVERHEAD)
    ((memory, seconds, events),) = fresh(MEMORY)
    print(f"import toolbox                       {sorted(w[0] for w in warm)[2]:6.2f} s")
    print(f"first answer, caches warm            {sorted(w[1] for w in warm)[2]:6.2f} s")
    print(f"first answer, caches empty           {cold[1]:6.2f} s")
    for words, (value,) in zip(("open loop", "continuous PI", "sampled PI"), beyond, strict=True):
        print(f"call beyond the loop, {words:<14} {1e3 * value:6.3f} ms")
    print(f"memory of 10 000 s, 100 001 outputs  {memory:6.0f} MB  ({seconds:.2f} s, {events:.0f} events)")
    for elements in ("10", "100", "1000"):
        with tempfile.TemporaryDirectory() as empty:
            (new, again) = (fresh(CHAIN, elements, STICKSLIP_CACHE_DIR=empty)[0] for _ in range(2))
        print(f"{elements:>4} elements: compose {new[0]:.2f} s, compile {new[1]:.2f} s, from the cache {again[1]:.2f} s, {again[2]:.0f} MB")


if __name__ == "__main__":
    main()
