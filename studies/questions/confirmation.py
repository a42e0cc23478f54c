"""Do the set-points of the drive table stand in a simulation that shares nothing with the toolbox?

The string, its rock and the noise are those of `studies.protocol`, written once more in a file of C (`confirmation.c`: fixed steps, its own logic of
sticking); the stiff drive and the law that takes over are the C that `export_c` writes for a machine. Every run begins at rest, is driven into stick-slip
by the stiff drive for 200 s, and is then taken over at one of 8 phases of the cycle, with seeds of the noise that nothing else uses. Success is what the
protocol calls so.

At the set-point of the table, or one step of 0.1 rad/s above it, every run has to succeed. Below it the table says which run fails first: some run has to fail
here too, within 0.3 rad/s. Not to the digit, since the noise is another and the cycle is that of the rig itself.

    python -m studies confirmation [--only LABEL ...] [--groups NAME ...] [--step SECONDS]        (needs a C compiler, `cc`; five minutes)
"""

from __future__ import annotations

import argparse
import ctypes
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from models import wells
from studies.protocol import DELAY, GROUPS, LIMITS, PLANT, ROCK, STIFF
from studies.questions import drives
from toolbox import closed_loop, export_c
from toolbox.robustness.groups import Group, Machine
from toolbox.robustness.set_points import SETTLING, WAYS, Trial, at_set_point, set_point, verdict

NUMBERS = ("chain.inertia.0", "chain.inertia.1", "chain.stiffness.0", "bit.weight")
DECLARED = closed_loop(PLANT)
BEGUN = 200.0
"""Seconds under the stiff drive before the first takeover."""
STEP = 2e-3
"""Step of the method [s]."""
SHIFTED = 1000
"""What is added to the seeds of the protocol: noise that the table has not seen."""
CONFIRMED = {
    "impedance, tuned, lifting": {"declared": (3.6, 3.5), "robust": (3.8, 3.8), "corners": (4.0, 4.0)},
    "Z-torque, tuned, lifting": {"declared": (3.5, 3.5), "robust": (3.7, 3.7), "corners": (3.9, 3.9)},
    "LQG, between, lifting": {"declared": (2.9, 2.9), "robust": (3.7, 3.6), "corners": (3.9, 3.9)},
    "LQG, tuned": {"declared": (2.9, 2.9), "robust": (6.8, 3.6), "corners": (8.6, 3.9)},
}
"""Set-points [rad/s] of the drive table, direct and raised, by label and group."""
BELOW = (0.1, 0.2, 0.3)
"""How far below a set-point of the table [rad/s] a failure is looked for."""
ABOVE = 0.1
"""How far above it [rad/s] no run may fail, where one does at it: a step of the table."""


@dataclass(frozen=True)
class Compiled:
    """A law after the stiff drive, as machine code for one set-point [rad/s]."""

    law: Trial
    reference: float
    library: Any

    def numbers(
        self, rig: Machine, way: str, phase: float, noise: np.ndarray, step: float = STEP, judged: float = 80.0
    ) -> dict[str, float]:
        """What the protocol judges by: seconds stuck, means of speed, torque and its square, share of time at a limit.

        noise: standard normal numbers times its size [rad/s], at least one per sample.
        """
        period, every = self.law.cycle(self.reference).period, self.law.period
        given, last = set_point(self.reference, way, BEGUN + 2.0 * period + 1.0)
        times, values = given if isinstance(given, tuple) else ((0.0,), (given,))
        first, samples = round((last + SETTLING) / every), round((last + SETTLING + judged) / every)
        chain, rock = wells.JANSEN_2, ROCK
        numbers = {name: dict(rig.factors).get(name, 1.0) * float(DECLARED.number(name).value) for name in NUMBERS}
        found = np.zeros(5)
        arrays = [
            np.array([
                numbers["chain.inertia.0"], numbers["chain.inertia.1"], numbers["chain.stiffness.0"], chain.damping[0], chain.top_drag, chain.bit_drag,
                numbers["bit.weight"] * rock.radius, rock.friction.static, rock.friction.kinetic, rock.friction.decay,
            ]),
            np.zeros(3), noise, np.array(times, float), np.array(values, float), np.array(list(LIMITS.values())), found,
        ]  # fmt: skip
        p, x, noisy, nodes, heights, limits, out = (array.ctypes.data_as(ctypes.c_void_p) for array in arrays)
        taken = round((BEGUN + phase * period) / every)
        late, parts = round((DELAY + rig.late) / every), round(every / step)
        failed = self.library.confirmed(p, x, noisy, samples, nodes, heights, len(times), taken, late, parts, limits, first, out)
        if failed:
            raise RuntimeError("A step of a law failed.")
        return dict(zip(("stuck", "speed", "torque", "square", "limited"), found.tolist(), strict=True))


def machine(law: Trial, reference: float, folder: Path) -> Compiled:
    """Export the stiff drive and the law, and compile them with the string; raises RuntimeError where there is no compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        raise RuntimeError("A C compiler is needed, but there is no `cc`.")
    for name, each in (("before", at_set_point(STIFF, reference)), ("law", law.of(reference))):
        export_c(closed_loop(PLANT, each, sample_time=law.period), folder / name)
    library = folder / "machine.so"
    sources = [str(Path(__file__).with_suffix(".c")), str(folder / "before.c"), str(folder / "law.c")]
    subprocess.run(
        [compiler, "-O2", "-ffp-contract=off", "-shared", "-fPIC", f"-I{folder}", *sources, "-lm", "-o", str(library)], check=True
    )
    return Compiled(law, reference, ctypes.CDLL(str(library)))


def failures(made: Compiled, group: Group, way: str, step: float = STEP) -> Iterator[str]:
    """Which runs of a group fail, and why."""
    for seed in group.seeds:
        for rig in group.machines:
            for phase in group.phases:
                noise = group.noise * np.random.default_rng([seed + SHIFTED, round(8 * phase)]).standard_normal(80_000)
                why = verdict(made.numbers(rig, way, phase, noise, step), made.reference, group.noise)
                if why:
                    yield f"{rig.name}, seed {seed + SHIFTED}, phase {phase:g}: {why}"


@dataclass(frozen=True)
class Confirmed:
    """What becomes of a set-point of the table.

    failed: the runs that fail at it;  border: lowest set-point, at it or a step above, at which none does [rad/s], nan for none;  below: how far below the
    set-point a run fails first [rad/s], nan for none within `BELOW`;  why: that run.
    """

    failed: list[str]
    border: float
    below: float
    why: str


def row(label: str, group: str, way: str, step: float = STEP) -> Confirmed:
    """What becomes of a set-point of the table."""
    law = drives.laws()[label]
    speed = CONFIRMED[label][group][WAYS.index(way)]
    with tempfile.TemporaryDirectory() as folder:

        def fails(reference: float) -> Iterator[str]:
            return failures(machine(law, reference, _room(folder, reference)), GROUPS[group], way, step)

        failed = list(fails(speed))
        above = round(speed + ABOVE, 6)
        border = speed if not failed else float("nan") if next(fails(above), "") else above
        for below in BELOW:
            why = next(fails(round(speed - below, 6)), "")
            if why:
                return Confirmed(failed, border, below, why)
    return Confirmed(failed, border, float("nan"), "")


def _room(folder: str, reference: float) -> Path:
    """A folder of its own for every machine: a library that is loaded once is not loaded anew from the same path."""
    path = Path(folder) / f"{reference:g}"
    path.mkdir()
    return path


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line per label, group and way."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--only", nargs="+", choices=list(CONFIRMED), default=list(CONFIRMED), metavar="LABEL", help=f"some of: {', '.join(CONFIRMED)}"
    )
    names = list(next(iter(CONFIRMED.values())))
    parser.add_argument("--groups", nargs="+", choices=names, default=names, metavar="NAME", help=f"some of: {', '.join(names)}")
    parser.add_argument("--step", type=float, default=STEP, help=f"step of the method [s] ({STEP:g})")
    given = parser.parse_args(arguments)
    head = f"{'controller':<28}{'rigs':<10}{'way':<8}{'set-point':>10}{'runs':>6}{'failed':>8}{'border':>8}   below"
    print(f"{head}\n{'-' * (len(head) + 40)}")
    for label in given.only:
        for group in given.groups:
            for i, way in enumerate(WAYS):
                found = row(label, group, way, given.step)
                said = f"-{found.below:g} rad/s: {found.why}" if found.why else f"nothing fails down to -{BELOW[-1]:g} rad/s"
                cells = f"{CONFIRMED[label][group][i]:>10g}{GROUPS[group].runs:>6}{len(found.failed):>8}{found.border:>8g}"
                print(f"{label:<28}{group:<10}{way:<8}{cells}   {said}", flush=True)
                for each in found.failed[:3]:
                    print(f"    {each}")


if __name__ == "__main__":
    main()
