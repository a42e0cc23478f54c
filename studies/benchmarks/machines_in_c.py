"""What does a machine in C cost beside the compiled loop of the toolbox, and does it switch the same?

Every shipped scene of equations that explicit steps solve, its first case: switches in the same order, the largest distance of their times, steps of both
loops, processor time of the least disturbed of some runs, C by the compiled loop with equal steps, and the processor time that the C compiler takes. The C
is compiled with the flags of its CMakeLists.txt.

    python -m studies machines_in_c [SCENE ...] [--compiler clang]        (needs a C compiler; two minutes)
"""

from __future__ import annotations

import ctypes
import resource
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from models import BitRock, wells
from studies.command_line import parser_of
from toolbox import Scene, SceneError, compose, export_c, simulate, stepper
from toolbox.compilation import work_layout as layout
from toolbox.export import fmu_archive
from toolbox.export.machine_c import machine
from toolbox.simulation.work_arrays import work_arrays
from toolbox.stepping.event_stepper import run_on

COMPILER = shutil.which("gcc") or shutil.which("cc")
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2"]
FAST = ["-O3", "-ffp-contract=fast", "-fno-math-errno", "-fno-trapping-math", "-freciprocal-math", "-fno-signed-zeros", "-march=native"]
SCENES = Path("studies/scenes")
DONE, OVERRUN = 0, 3


class CompiledMachine:
    """An exported machine as a shared library, with the struct in a buffer."""

    def __init__(self, source: Path, flags: Sequence[str] = (), compiler: str | None = None):
        self.name, library, compiler = source.stem, source.with_suffix(".so"), compiler or _compiler()
        size = source.with_name("size.c")
        size.write_text(
            f'#include "{self.name}.h"\nint size_of_memory(void);\nint size_of_memory(void) {{ return sizeof({self.name}_machine); }}\n'
        )
        flags = flags or [*STRICT, fmu_archive.OPTIMISED]
        subprocess.run([compiler, *flags, "-shared", "-fPIC", str(source), str(size), "-lm", "-o", str(library)], check=True)
        self.library = ctypes.CDLL(str(library))
        self.size = self.library.size_of_memory()
        self.memory = ctypes.create_string_buffer(self.size)
        self.macros = dict(
            line.split()[1:3]
            for line in source.with_suffix(".h").read_text().splitlines()
            if line.startswith("#define") and len(line.split()) > 2
        )
        self.start()

    def start(self) -> None:
        """Begin anew."""
        self._function("start", None)(self.memory)

    def _function(self, word, result, *arguments):
        function = getattr(self.library, f"{self.name}_{word}")
        function.restype, function.argtypes = result, [ctypes.c_void_p, *arguments]
        return function

    def number(self, group, name):
        return int(self.macros[f"{self.name.upper()}_{group}_{name.replace('.', '_')}"])

    def set(self, group, name, value):
        return self._function("set", ctypes.c_int, ctypes.c_int, ctypes.c_double)(self.memory, self.number(group, name), value)

    def step(self, until):
        return self._function("step", ctypes.c_int, ctypes.c_double)(self.memory, until)

    def outputs(self):
        y = np.zeros(int(self.macros[f"{self.name.upper()}_OUTPUTS"]))
        self._function("outputs", None, ctypes.c_void_p)(self.memory, y.ctypes.data)
        return y

    def output(self, name):
        return self.outputs()[self.number("OUTPUT", name)]

    def events(self):
        """(time, element, before, after) of the last step."""
        count = self._function("events", ctypes.c_int)(self.memory)
        event = self._function("event", ctypes.c_double, ctypes.c_int, *[ctypes.c_void_p] * 3)
        names = self.library[f"{self.name}_element_name"], self.library[f"{self.name}_mode_name"]
        for each in names:
            each.restype = ctypes.c_char_p
        found = []
        for k in range(count):
            element, before, after = ctypes.c_int(), ctypes.c_int(), ctypes.c_int()
            t = event(self.memory, k, *(ctypes.byref(each) for each in (element, before, after)))
            found.append((t, names[0](element).decode(), *(names[1](element, mode).decode() for mode in (before, after))))
        return found

    def run(self, until, period=None):
        """Every event up to a time, in communication steps of a period."""
        found = []
        for k in range(1, 2 if period is None else round(until / period) + 1):
            status = OVERRUN
            while status == OVERRUN:
                status = self.step(until if period is None else min(k * period, until))
                found += self.events()
            assert status == DONE, status
        return found


def _compiler() -> str:
    if COMPILER is None:
        raise RuntimeError("A C compiler is needed, but there is neither `gcc` nor `cc`.")
    return COMPILER


def least(run: Callable[[], float]) -> float:
    """The least of some times that a function returns, for about a second."""
    first = run()
    return min([first, *(run() for _ in range(max(2, min(50, int(1.0 / max(first, 1e-5))))))])


def compiling() -> float:
    """Processor time of all finished child processes so far [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def row(name: str, folder: Path, compiler: str | None = None) -> tuple[str, float]:
    """(the line of a scene, time of C by that of the compiled loop)."""
    scene = Scene.load(SCENES / f"{name}.toml")
    loop = scene[scene.cases[0].label]
    reference = simulate(loop, method="explicit")
    source, _ = export_c(loop, folder / name, part="loop")
    began = compiling()
    found = CompiledMachine(source, FAST, compiler)
    took = compiling() - began
    made = machine(loop, name)
    duration = made.run.duration
    events = found.run(duration)
    same = [event[1:] for event in events] == [tuple(event)[1:] for event in reference.events]
    apart = max((abs(mine[0] - theirs.time) for mine, theirs in zip(events, reference.events, strict=False)), default=0.0)

    def in_c() -> float:
        found.start()
        first = time.process_time()
        while found.step(duration) == OVERRUN:
            pass
        return time.process_time() - first

    def in_python() -> float:
        work: Any = work_arrays(made.run, made.program)._replace(out_t=np.array([duration]))
        work.ints[layout.NODES], work.ints[layout.BUDGET] = 0, 10**9
        room = len(reference.events) + 1000 + 4 * made.program.kernel.elements
        work = work._replace(
            **{word: np.zeros((room, *getattr(work, word).shape[1:]), getattr(work, word).dtype) for word in ("ev_t", "ev_i", "ev_m")}
        )
        first = time.process_time()
        run_on(work)
        return time.process_time() - first

    times = least(in_c), least(in_python)
    words = f"{len(events)} same" if same else f"{len(events)} of {len(reference.events)}"
    seconds = f"{1e3 * times[0]:>11.3f} ms{times[0] / times[1]:>8.2f}{took:>8.1f} s"
    line = f"{name:<24}{words:>14}{apart:>11.1e}{seconds}{made.work['ints'][layout.N]:>8}{found.size / 1024:>9.0f} KiB"
    return line, times[0] / times[1]


def step_of_stepper(steps: int = 20_000) -> float:
    """Processor time [s] of a step of 10 ms of a string of four inertias with one input and three outputs."""
    rig = compose(wells.NAVARRO_LOPEZ_4, BitRock(weight=97_000.0))
    made = stepper(rig, 0.01, inputs="top.torque", outputs=("top.speed", "bit.speed", "bit.torque"), duration=0.01 * steps)

    def run() -> float:
        made.reset()
        first = time.process_time()
        for _ in range(steps):
            made.step(9000.0)
        return time.process_time() - first

    return least(run) / steps


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = parser_of(__doc__)
    every = sorted(path.stem for path in SCENES.glob("*.toml"))
    parser.add_argument("scenes", nargs="*", default=every, metavar="SCENE", help="some of the shipped scenes; all without")
    parser.add_argument("--compiler", default=COMPILER, help="of C; gcc or cc without")
    given = parser.parse_args(arguments)
    print(f"{'scene':<24}{'switches':>14}{'apart [s]':>11}{'C':>14}{'by loop':>8}{'cc':>10}{'states':>8}{'memory':>13}")
    ratios = []
    with tempfile.TemporaryDirectory() as folder:
        for name in given.scenes:
            try:
                line, ratio = row(name, Path(folder), given.compiler)
            except SceneError as error:
                print(f"{name:<24}  {str(error)[:110]}", flush=True)
                continue
            ratios.append(ratio)
            print(line, flush=True)
    print(f"A step of 10 ms from Python (`stepper`), four inertias, three outputs: {1e6 * step_of_stepper():.1f} us")
    if ratios:
        print(f"C by the compiled loop: median {np.median(ratios):.2f}, largest {max(ratios):.2f}")


if __name__ == "__main__":
    main()
