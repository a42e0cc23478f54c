"""What do a million calls of 1 ms cost on a test bench, and what is the most that one of them does?

A plant in C is stepped 1000 s on, 1 ms a call, as a real-time target does it: mean processor time of a call, the most steps of the engine and the most
switches in one call, calls that had to be made again because they had done all that one call may, and by how much the memory of the process grew after
the first thousand calls. At the end the same from Python, by `stepper`; and what a step of 10 ms costs alone and as one of 1000 copies in a vector environment.

    python -m studies million_calls [SCENE ...] [--calls 1000000]        (needs a C compiler)
"""

from __future__ import annotations

import resource
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from models import BitRock, wells
from studies.benchmarks.machines_in_c import COMPILER, FAST
from studies.command_line import parser_of
from toolbox import Scene, compose, export_c, stepper
from toolbox.modelling.closed_loop import ClosedLoop

SCENES = ("block_on_belt", "jansen_2", "bit_bounce", "creep_groan", "aarsnes_shor")

PROGRAM = """
#include <stdio.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <time.h>
#include "@.h"
static @_machine machine;
static long memory(void) {
  struct rusage used;
  getrusage(RUSAGE_SELF, &used);
  return used.ru_maxrss;
}
int main(int count, char **word) {
  const long calls = atol(word[count - 1]);
  long k, most_steps = 0, most_events = 0, again = 0, first = 0;
  clock_t begin = clock();
  @_start(&machine);
  for (k = 1; k <= calls; ++k) {
    const long before = (long)@_engine_steps(&machine);
    long events = 0, steps;
    int status;
    while ((status = @_step(&machine, 1e-3 * (double)k)) == 3) {
      ++again;
      events += @_events(&machine);
    }
    events += @_events(&machine);
    if (status != 0) {
      printf("%s at call %ld\\n", @_status_text(status), k);
      return 1;
    }
    steps = (long)@_engine_steps(&machine) - before;
    if (steps > most_steps) most_steps = steps;
    if (events > most_events) most_events = events;
    if (k == 1000) first = memory();
  }
  printf("%g %ld %ld %ld %ld\\n", (double)(clock() - begin) / CLOCKS_PER_SEC / (double)calls, most_steps, most_events, again, memory() - first);
  return 0;
}
"""


def in_c(loop: ClosedLoop, folder: Path, calls: int) -> tuple[float, int, int, int, int]:
    """(processor time of a call [s], most steps, most switches, calls made again, growth of memory [KiB]). Raises RuntimeError where the machine stops."""
    source, _ = export_c(loop, folder / "plant", part="loop")
    (source.parent / "bench.c").write_text(PROGRAM.replace("@", "plant"))
    program = source.parent / "bench"
    if COMPILER is None:
        raise RuntimeError("A C compiler is needed, but there is neither `gcc` nor `cc`.")
    subprocess.run([COMPILER, *FAST, str(source), str(source.parent / "bench.c"), "-lm", "-o", str(program)], check=True)
    done = subprocess.run([str(program), str(calls)], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stdout.strip())
    mean, *counts = done.stdout.split()
    steps, events, again, grown = map(int, counts)
    return float(mean), steps, events, again, grown


def in_python(loop: ClosedLoop, calls: int) -> tuple[float, int, int]:
    """(processor time of a call of `stepper` [s], most switches, growth of memory [KiB])."""
    machine = stepper(loop, 1e-3, outputs=loop.system.signals and next(iter(loop.system.signals)))
    most, first, begin = 0, 0, time.process_time()
    for k in range(calls):
        machine.step()
        most = max(most, len(machine.events))
        if k == 1000:
            first = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return (time.process_time() - begin) / calls, most, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - first


def of_environments(copies: int = 1000, steps: int = 30) -> list[float]:
    """Processor times [s] of a step of 10 ms of four inertias with one input: an environment alone; one of some copies, all torques the same or all new."""
    from toolbox.export.environment import environment
    from toolbox.export.vector_environment import vector_environment

    rig = compose(wells.NAVARRO_LOPEZ_4, BitRock(weight=97_000.0))
    ranges: dict[str, Any] = {
        "actions": {"top.torque": (0.0, 20e3)}, "observations": {"top.speed": (-50.0, 50.0), "bit.speed": (-50.0, 50.0)},
    }  # fmt: skip
    alone = environment(rig, 0.01, 1e6, reward=lambda signals, events: -signals["bit.speed"], **ranges)
    together = vector_environment(rig, copies, 0.01, 1e6, reward=lambda signals, switches: -signals["bit.speed"], **ranges)
    alone.reset(seed=1)
    together.reset(seed=1)
    torques = np.random.default_rng(1).uniform(0.0, 20e3, (steps, copies, 1))

    def of(step: Callable[[Any], Any], actions: Sequence[Any]) -> float:
        begin = time.process_time()
        for action in actions:
            step(action)
        return (time.process_time() - begin) / len(actions)

    return [
        min(of(alone.step, [[9000.0]] * 3000) for _ in range(4)),
        min(of(together.step, [torques[0]] * steps) for _ in range(4)) / copies,
        min(of(together.step, torques) for _ in range(4)) / copies,
    ]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = parser_of(__doc__)
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE", help="shipped scenes of equations; five without")
    parser.add_argument("--calls", type=int, default=1_000_000, help="calls of 1 ms")
    given = parser.parse_args(arguments)
    print(f"{'scene':<20}{'a call':>10}{'most steps':>12}{'switches':>10}{'again':>7}{'memory grew':>13}")
    for name in given.scenes:
        scene = Scene.load(Path("studies/scenes") / f"{name}.toml")
        loop = scene[scene.labels[0]]
        with tempfile.TemporaryDirectory() as folder:
            mean, steps, events, again, grown = in_c(loop, Path(folder), given.calls)
        print(f"{name:<20}{1e6 * mean:>7.2f} us{steps:>12}{events:>10}{again:>7}{grown:>9} KiB", flush=True)
    scene = Scene.load(Path("studies/scenes") / f"{given.scenes[0]}.toml")
    mean, events, grown = in_python(scene[scene.labels[0]], given.calls)
    print(f"{given.scenes[0]}, from Python: {1e6 * mean:.2f} us a call, at most {events} switches in one, memory grew by {grown} KiB")
    single, same, new = (1e6 * each for each in of_environments())
    print(
        f"A step of 10 ms of four inertias: {single:.1f} us as an environment; one of 1000 copies {same:.2f} us, {new:.2f} us where every torque is new"
    )


if __name__ == "__main__":
    main()
