"""What does a user wait for, beside the event loop?

Every row is measured in fresh processes with warm caches, as processor time of the whole process or of one call in it, the least of so many turns. Rows: the
first answer; a study with figures; keeping a run; both branches of an onset; a map; `run.error_estimate` of a sampled law beside its run; chains of 1000 and
3000 inertias that all rub, whose machine code is made anew, with the memory of the process. `python -m studies speed` measures the loop itself.

    python -m studies waiting [--only ROW ...] [--turns 3]
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass

from studies.command_line import parser_of

TIMED = """
import time
from studies.timing import timed
"""

FIRST = """
from models import BitRock, wells
from toolbox import compose, simulate
simulate(compose(wells.JANSEN_2, BitRock(weight=97_000.0)), 100.0, inputs={"top.torque": 10_000.0})
print(time.process_time())
"""

SAVE = """
from pathlib import Path
from studies.benchmarks.keeping import well
from toolbox import simulate
import tempfile
run = simulate(well(), 20.0)
with tempfile.TemporaryDirectory() as folder:
    print(timed(lambda: run.save(Path(folder) / "run.npz"))[1])
"""

ONSET = """
from controllers import PI, SoftTorque
from models import BitRock, TorsionalChain
from models.friction import Exponential
from toolbox import closed_loop, compose, onset, simulate
def string(n, rubbing=0):
    along = tuple(range(rubbing))
    friction = {"friction": Exponential(1.0, 0.65, 1.0), "friction_load": (4000.0 / n,) * rubbing, "friction_at": along} if rubbing else {}
    pipe = {"inertia": (2122.0, *(374.0 / (n - 1),) * (n - 1)), "stiffness": (473.0 * (n - 1),) * (n - 1), "damping": (23.2,) * (n - 1)}
    return compose(TorsionalChain(**pipe, top_drag=425.0, **friction), BitRock(weight=60_000.0 if rubbing else 97_347.0))
def report(plant, law):
    return str(onset(closed_loop(plant, law, element="bit"), "top.reference", (4.0, 16.0)))
"""

REPORT = "print(timed(lambda: report(string({string}), {law}))[1])"

MAP = """
from controllers import StiffPI
from models import BitRock, wells
from toolbox import closed_loop, compose, severity_map
loop = closed_loop(compose(wells.JANSEN_2, BitRock()), StiffPI())
over = {"top.reference": (4.0, 24.0), "bit.weight": (40_000.0, 160_000.0)}
print(timed(lambda: severity_map(loop, over, shape=(30, 30)))[1])
"""

ERROR = """
from controllers import PI
from models import BitRock, wells
from toolbox import compose, simulate
rig = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
runs = []
def run():
    runs.append(simulate(rig, 120.0, controller=PI(reference=12.0), sample_time=0.01))
alone = timed(run, 7)[1]
print(min(timed(lambda run=run: run.error_estimate)[1] for run in runs) / alone)
"""

CHAIN = """
import os, resource, tempfile
from studies.benchmarks.stiff import deviated
from toolbox import simulate
def run(n):
    return simulate(deviated(n, everywhere=True), 5.0, inputs={{"top.torque": 10_000.0}})
run(60)  # the event loop, which is compiled once for all machines
with tempfile.TemporaryDirectory() as empty:
    os.environ["STICKSLIP_CACHE_DIR"] = empty
    print(timed(lambda: run({n}))[1])
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""


def numbers(program: str, **environment: str) -> list[float]:
    """Numbers that a program prints in a process of its own."""
    command = [sys.executable, "-c", TIMED + program]
    result = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True, check=True)
    return [float(word) for word in result.stdout.split()]


@dataclass(frozen=True)
class Row:
    """A row of the table: what is waited for, the program that prints it, and the units of what it prints."""

    title: str
    program: str
    units: tuple[str, ...] = ("s",)

    def measured(self, turns: int) -> list[float]:
        """The least of so many turns, after one that fills the caches."""
        found = [numbers(self.program) for _ in range(1 + turns)][1:]
        return [min(each) for each in zip(*found, strict=True)]


@dataclass(frozen=True)
class Study:
    """The row of `stickslip study` of a scene with its figures: processor time of the process."""

    title: str
    scene: str
    units: tuple[str, ...] = ("s",)

    def measured(self, turns: int) -> list[float]:
        """The least of so many turns, after one that fills the caches."""
        found = []
        for _ in range(1 + turns):
            with tempfile.TemporaryDirectory() as folder:
                before = resource.getrusage(resource.RUSAGE_CHILDREN)
                subprocess.run([sys.executable, "-m", "toolbox", "study", self.scene, "--out", f"{folder}/out", "--quiet"], check=True)
                after = resource.getrusage(resource.RUSAGE_CHILDREN)
            found.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        return [min(found[1:])]


ROWS: dict[str, Row | Study] = {
    "first": Row("a process that imports and simulates", FIRST),
    "study": Study("`stickslip study` of jansen_2 with figures", "studies/scenes/jansen_2.toml"),
    "save": Row("`save` of 20 s, 49 inertias, 13 contacts", SAVE),
    **{
        f"onset {n} {name}": Row(f"onset, {n} inertias, {name}", ONSET + REPORT.format(string=n, law=law))
        for n in (2, 3, 4)
        for name, law in (("PI", "PI(900.0, 400.0)"), ("soft torque", "SoftTorque()"))
    },
    "onset 16": Row("onset, 16 inertias, 15 rub, PI", ONSET + REPORT.format(string="16, 15", law="PI(900.0, 400.0)")),
    "map": Row("map 30 x 30, both branches", MAP),
    "error": Row("`run.error_estimate` of a sampled PI / its run", ERROR, ("",)),
    "1000": Row("1000 inertias that rub, compile and 5 s", CHAIN.format(n=1000), ("s", "MB")),
    "3000": Row("3000 inertias that rub, compile and 5 s", CHAIN.format(n=3000), ("s", "MB")),
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = parser_of(__doc__)
    parser.add_argument("--only", nargs="+", choices=list(ROWS), default=list(ROWS), metavar="ROW", help=f"some of: {', '.join(ROWS)}")
    parser.add_argument("--turns", type=int, choices=range(1, 100), metavar="N", default=3, help="turns of which the least counts (3)")
    given = parser.parse_args(arguments)
    for name in given.only:
        row = ROWS[name]
        found = row.measured(given.turns)
        print(f"{row.title:<46}" + "".join(f"{each:9.2f} {unit:<2}" for each, unit in zip(found, row.units, strict=True)), flush=True)


if __name__ == "__main__":
    main()
