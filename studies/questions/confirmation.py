"""Do the set-points of the drive table stand in a simulation that shares nothing with the toolbox?

The string, its rock, the noise and the weight that varies are those of `studies.protocol`, written once more in a file of C (`confirmation.c`: fixed steps,
its own logic of sticking); the stiff drive and the law that takes over are the C that `export_c` writes for a machine. Every run begins at rest, is driven
into stick-slip by the stiff drive for 200 s, and is then taken over at one of the phases of the cycle, counted from there and not from a release, with seeds
of the noise and courses of the weight that nothing else uses. Success is what the protocol calls so.

At the set-point of the table (`docs/drives.csv`), or one step of 0.1 rad/s above it, every run has to succeed. Below it the table says which run fails first:
some run has to fail here too, within 0.3 rad/s. Not to the digit, since the noise is another and the cycle is that of the rig itself. The table moreover asks
for half an hour, these runs for 80 s, or 600 s under a weight that varies; predictive laws are left out.

A law that moves the weight asks a hoist to follow. That of the table does so 30 ms late and without a limit; `--hoist LATE RATE` gives it another delay and a
highest rate, and then the border is looked for up to 14 rad/s, in steps of 0.5. Printed beside the cells are the swing of the weight in the judged window and
its highest rate from the takeover on, both in parts of the weight.

    python -m studies confirmation [--only LABEL ...] [--groups NAME ...] [--ways WAY ...] [--hoist LATE RATE] [--step SECONDS]
        (needs a C compiler, `cc`; a minute for a law on all groups)
"""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from models import GaussianStribeck, wells
from studies.command_line import parser_of
from studies.protocol import DELAY, GROUPS, HIGHEST, LIMITS, PLANT, ROCK, ROCKS, STIFF
from studies.questions import drives
from toolbox import closed_loop, export_c
from toolbox.drilling.groups import Group, Machine, Varying
from toolbox.drilling.set_points import PROTOCOLS, SETTLING, Trial, set_point, verdict
from toolbox.robustness.starts import at_set_point

NUMBERS = ("chain.inertia.0", "chain.inertia.1", "chain.stiffness.0", "bit.weight", "bit.friction.decay")
DECLARED = closed_loop(PLANT)
BEGUN = 200.0
"""Seconds under the stiff drive before the first takeover."""
STEP = 2e-3
"""Step of the method [s]."""
SHIFTED = 1000
"""What is added to the seeds of the protocol: noise that the table has not seen."""
BELOW = (0.1, 0.2, 0.3)
"""How far below a set-point of the table [rad/s] a failure is looked for."""
ABOVE = 0.1
"""How far above it [rad/s] no run may fail, where one does at it: a step of the table."""
FREE = (0.0, math.inf)
"""A hoist that is as late as the torque [s more], at any rate [1/s]."""
COARSE = 0.5
"""Step [rad/s] in which the border is looked for with another hoist."""
TONES = 100


def confirmed() -> dict[str, dict[tuple[str, str], float]]:
    """{label: {(group, way): set-point [rad/s]}} of the cells of the drive table that hold a set-point and can be repeated here."""
    rows = drives.published()
    cells = {
        label: {cell: speed for cell, speed in rows[label].items() if not math.isnan(speed)}
        for label in drives.laws()
        if label in rows and not drives.predictive(label)
    }
    return {label: each for label, each in cells.items() if each}


def varied(how: Varying | None, samples: int, period: float, seed: Sequence[int]) -> np.ndarray:
    """The weight at every sample in parts of its mean: 1, a sine from a phase that is drawn, or noise as a sum of many sines of the spectrum of a first-order
    filter, with frequencies and phases that are drawn."""
    if how is None:
        return np.ones(samples)
    drawn, time = np.random.default_rng(seed), period * np.arange(samples)
    if not how.noise:
        return 1.0 + how.size * np.sin(2.0 * math.pi * (how.frequency * time + drawn.random()))
    # frequencies whose density is that of the filter, up to five times its corner
    tones = how.frequency * np.tan(math.atan(5.0) * (np.arange(TONES) + drawn.random(TONES)) / TONES)
    phases, wave = drawn.random(TONES), np.zeros(samples)
    for tone, phase in zip(tones, phases, strict=True):
        wave += np.sin(2.0 * math.pi * (tone * time + phase))
    return 1.0 + how.size * math.sqrt(2.0 / TONES) * wave


@dataclass(frozen=True)
class Compiled:
    """A law after the stiff drive, as machine code for one set-point [rad/s]."""

    law: Trial
    reference: float
    library: Any

    def numbers(
        self,
        rig: Machine,
        way: str,
        phase: float,
        noise: np.ndarray,
        *,
        seed: Sequence[int] = (0,),
        step: float = STEP,
        judged: float = 80.0,
        hoist: tuple[float, float] = FREE,
    ) -> dict[str, float]:
        """What the protocol judges by: seconds stuck, means of speed, torque and its square, share of time at a limit; and how the weight was moved.

        noise: standard normal numbers times its size [rad/s], at least one per sample.  seed: of the weight that varies.  hoist: by how much its weight is
        later than the torque [s], and its highest rate in parts of the weight [1/s].
        """
        period, every = self.law.cycle(self.reference).period, self.law.period
        given, last = set_point(self.reference, way, BEGUN + 2.0 * period + 1.0)
        times, values = given if isinstance(given, tuple) else ((0.0,), (given,))
        first, samples = round((last + SETTLING) / every), round((last + SETTLING + judged) / every)
        chain, gaussian = wells.JANSEN_2, rig.plant is not None
        rock = ROCKS["Gaussian"] if gaussian else ROCK
        numbers = {name: dict(rig.parameter_factors).get(name, 1.0) * float(DECLARED.number(name).value) for name in NUMBERS}
        if isinstance(rock.friction, GaussianStribeck):
            numbers["bit.friction.decay"] = 1.0 / rock.friction.stribeck_speed
        found = np.zeros(7)
        arrays = [
            np.array([
                numbers["chain.inertia.0"], numbers["chain.inertia.1"], numbers["chain.stiffness.0"], chain.damping[0], chain.top_drag, chain.bit_drag,
                numbers["bit.weight"] * rock.radius, rock.friction.static, rock.friction.kinetic, numbers["bit.friction.decay"], 1.0 + gaussian,
            ]),
            np.zeros(3), noise, varied(rig.weight_variation, samples, every, seed), np.array(times, float), np.array(values, float),
            np.array([round(hoist[0] / every), hoist[1] * every]), np.array(list(LIMITS.values())), found,
        ]  # fmt: skip
        p, x, noisy, weight, nodes, heights, moved, limits, out = (array.ctypes.data_as(ctypes.c_void_p) for array in arrays)
        taken = round((BEGUN + phase * period) / every)
        late, parts = round((DELAY + rig.delay) / every), round(every / step)
        failed = self.library.confirmed(
            p, x, noisy, weight, samples, nodes, heights, len(times), taken, late, moved, parts, limits, first, out
        )
        if failed:
            raise RuntimeError("A step of a law failed.")
        return dict(zip(("stuck", "speed", "torque", "square", "limited", "swing", "rate"), found.tolist(), strict=True))


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


def runs(
    made: Compiled, group: Group, way: str, step: float = STEP, hoist: tuple[float, float] = FREE
) -> Iterator[tuple[str, dict[str, float]]]:
    """(why it fails, empty for a success, and what was measured) of one run of a group after the other."""
    for seed in group.seeds:
        for rig in group.machines:
            for phase in group.takeover_phases:
                drawn = [seed + SHIFTED, round(8 * phase)]
                noise = group.noise * np.random.default_rng(drawn).standard_normal(120_000)
                numbers = made.numbers(rig, way, phase, noise, seed=[*drawn, 1], step=step, judged=group.judged_time, hoist=hoist)
                why = verdict(numbers, made.reference, group.noise, rig.weight_variation is not None)
                yield f"{rig.name}, seed {seed + SHIFTED}, phase {phase:g}: {why}" if why else "", numbers


@dataclass(frozen=True)
class Confirmed:
    """What becomes of a set-point of the table.

    failed: the runs that fail at it;  border: lowest set-point, from it on to a step above, or with another hoist as far as there are set-points, at which none
    does [rad/s], nan for none;  below: how far below the
    set-point a run fails first [rad/s], nan for none within `BELOW`;  why: that run;  swing, rate: of the weight, of the worst run at the set-point [1], [1/s].
    """

    failed: list[str]
    border: float
    below: float
    why: str
    swing: float
    rate: float


def row(label: str, group: str, way: str, step: float = STEP, hoist: tuple[float, float] = FREE) -> Confirmed:
    """What becomes of a set-point of the table."""
    law, speed = drives.laws()[label], confirmed()[label][group, way]
    with tempfile.TemporaryDirectory() as folder:

        def fails(reference: float) -> Iterator[str]:
            found = runs(machine(law, reference, _room(folder, reference)), GROUPS[group], way, step, hoist)
            return (why for why, _ in found if why)

        every = list(runs(machine(law, speed, _room(folder, speed)), GROUPS[group], way, step, hoist))
        failed = [why for why, _ in every if why]
        swing, rate = (max(numbers[name] for _, numbers in every) for name in ("swing", "rate"))
        steps = [ABOVE] if hoist == FREE else np.arange(COARSE, HIGHEST - speed, COARSE)
        higher = (round(speed + step, 6) for step in steps)
        border = speed if not failed else next((each for each in higher if not next(fails(each), "")), math.nan)
        for below in BELOW:
            why = next(fails(round(speed - below, 6)), "")
            if why:
                return Confirmed(failed, border, below, why, swing, rate)
    return Confirmed(failed, border, float("nan"), "", swing, rate)


def _room(folder: str, reference: float) -> Path:
    """A folder of its own for every machine: a library that is loaded once is not loaded anew from the same path."""
    path = Path(folder) / f"{reference:g}"
    path.mkdir()
    return path


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line per label, group and way."""
    cells = confirmed()
    parser = parser_of(__doc__)
    for option, names in (("--only", list(cells)), ("--groups", list(GROUPS)), ("--ways", list(PROTOCOLS))):
        parser.add_argument(option, nargs="+", choices=names, default=names, metavar="NAME", help=f"some of: {', '.join(names)}")
    parser.add_argument(
        "--hoist", nargs=2, type=float, default=FREE, metavar=("LATE", "RATE"), help="delay [s] and rate [1/s] of a weight that a law moves"
    )
    parser.add_argument("--step", type=float, default=STEP, help=f"step of the method [s] ({STEP:g})")
    given = parser.parse_args(arguments)
    wide = max(len(label) for label in given.only) + 2
    head = f"{'controller':<{wide}}{'rigs':<10}{'way':<8}{'set-point':>10}{'runs':>6}{'failed':>8}{'border':>8}   below"
    print(f"{head}\n{'-' * (len(head) + 40)}")
    for label in given.only:
        for (group, way), speed in cells[label].items():
            if group not in given.groups or way not in given.ways:
                continue
            found = row(label, group, way, given.step, tuple(given.hoist))
            said = f"-{found.below:g} rad/s: {found.why}" if found.why else f"nothing fails down to -{BELOW[-1]:g} rad/s"
            hoisted = f"; weight swings by {100 * found.swing:.2g} %, up to {100 * found.rate:.3g} %/s" if found.rate else ""
            print(
                f"{label:<{wide}}{group:<10}{way:<8}{speed:>10g}{GROUPS[group].runs:>6}{len(found.failed):>8}{found.border:>8g}   {said}{hoisted}",
                flush=True,
            )
            for each in found.failed[:3]:
                print(f"    {each}")


if __name__ == "__main__":
    main()
