"""What is left of the borders of groan, and of the band of dither, on a machine that is a little different?

Groan. The rows of `studies.questions.brakes` that are silent there, with the same actuator and noise: the highest deceleration up to which no pad groans,
on the nominal machine, and where friction, stiffness of the caliper, or the inertia that it brakes is 20 % more or less, one at a time. Each at eight phases
of the roughness of the disc; the least of the eight counts. The laws are designed on the nominal machine. Found by bisection on a grid of 0.1 m/s2
between 0.5 and 3 m/s2 and confirmed at three decelerations below the answer, because a law may groan at a lower one.

Dither. A sine of the load at the frequency and depth that `studies.questions.dither` finds best. It begins inside the stick-slip cycle at eight phases of
it, on the nominal rig and where friction, stiffness, load, amplitude or frequency of the dither is 20 % more or less: the largest swing, in parts of
that without dither on the same rig, after 80 natural periods. The band: frequencies, in parts of the natural one, at which the swing stays below a half
at that depth; robust where it does so on every rig and at every phase.

Distance. For every law that eases and several margins: the longest stopping distance from 30 km/h at 2.5 m/s2 (13.9 m planned), nominal and over all errors,
at two phases; "groans" where a pad does.

What comes out: up to a margin of 0.8 the eased constant force, PI and sliding mode are silent on every machine at 2.5 m/s2, the PI up to 0.9; the MPC groans on
one of them at every margin, at 0.8 where the car is a fifth heavier. Bolder margins stop sooner on the nominal machine (sliding mode 15.36 m at 0.7,
14.79 m at 1).
Dither of Leine's block keeps the worst swing about a half (0.45 to 0.51) at 3.3 to 3.7 natural frequencies, whatever is 20 % off,
and that of the disc brake at none.

    python -m studies brake_margins [--out FOLDER]        (all tables and their csv)
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np

from controllers.dither import widest
from studies.command_line import folder, parser_of, write_rows
from studies.questions import brakes, dither
from toolbox import SimulationError, measure, simulate
from toolbox.inputs import sine

PHASES = tuple(k / 8 for k in range(8))
PART = 0.2
CONFIRMED = 3
LABELS = ("constant force, eased", "PI, eased", "sliding mode, eased", "MPC", "constant, phased dither, ideal actuator")


def _errors(names: Mapping[str, Sequence[str]]) -> dict[str, dict[str, float]]:
    """{words: factors of parameters} of one error at a time, both ways, after the nominal machine."""
    found: dict[str, dict[str, float]] = {"nominal": {}}
    for word, parameters in names.items():
        for sign in (-1.0, 1.0):
            found[f"{word} {100 * sign * PART:+.0f} %"] = dict.fromkeys(parameters, 1.0 + sign * PART)
    return found


# --- groan

STOPS = _errors({
    "friction": ("pad.friction.static", "pad.friction.kinetic"), "stiffness": ("disc.stiffness",), "inertia": ("disc.inertia",),
})  # fmt: skip


@dataclass(frozen=True)
class Border:
    """The last number of a grid that succeeds, nan where the first one fails, and what ends it: a failure, or `scan`, the end of the grid."""

    value: float
    ended: str

    def __str__(self) -> str:
        return (f"{self.value:.1f}" if self.value == self.value else f"< {brakes.LOWEST:g}") + f" {self.ended}"


def row_called(label: str) -> brakes.Contender:
    """The row of the brake study with that label."""
    return next(each for each in brakes.contenders() if each.label == label)


def stop_of(contender: brakes.Contender, deceleration: float, factors: Mapping[str, float], phase: float) -> brakes.Stop | None:
    """One stop, None where its run fails; the roughness of the disc begins at a phase."""
    plant = brakes.plant_of(contender)
    given = {name: factor * float(plant.parameter(name)) for name, factor in factors.items()}
    try:
        return brakes.stop_of(brakes.run_of(contender, deceleration, parameters=given, phase=phase))
    except SimulationError:
        return None


def stop_fails(contender: brakes.Contender, deceleration: float, factors: Mapping[str, float], phase: float) -> str:
    """What keeps one stop from being silent; empty where it is."""
    stop = stop_of(contender, deceleration, factors, phase)
    return "failed run" if stop is None else "groan" if stop.groans else ""


def highest(fails: Callable[[float], str], lowest: float, most: float, step: float) -> Border:
    """The highest number of a grid that does not fail, nor do `CONFIRMED` below it, and what fails next above; nan where the lowest does."""
    count = round((most - lowest) / step)
    known: dict[int, str] = {}

    def at(k: int) -> float:
        return round(lowest + k * step, 9)

    def holds(k: int) -> bool:
        if k not in known:
            known[k] = fails(at(k))
        return not known[k]

    if not holds(0):
        return Border(math.nan, known[0])
    good, bad = 0, count + 1
    while bad - good > 1:
        middle = count if bad == count + 1 and good == 0 else (good + bad) // 2  # the end of the grid first: most laws reach it
        if holds(middle):
            good = middle
        else:
            bad = middle
        if bad - good == 1:
            failing = [k for k in range(max(good - CONFIRMED, 1), good) if not holds(k)]
            if failing:
                good, bad = 0, failing[0]
    return Border(at(good), known.get(bad, "scan"))


@dataclass(frozen=True)
class Groan:
    """A line of the first table: highest silent deceleration [m/s2] and what ends it by error of the machine."""

    label: str
    highest: Mapping[str, Border]

    @property
    def robust(self) -> Border:
        """The least over all errors; nan where one is."""
        return min(self.highest.values(), key=lambda each: np.nan_to_num(each.value, nan=-1.0))


def groan(label: str) -> Groan:
    """The line of a law."""
    contender = row_called(label)
    found = {}
    for word, factors in STOPS.items():

        def fails(deceleration: float, factors: Mapping[str, float] = factors) -> str:
            return next((failed for phase in PHASES if (failed := stop_fails(contender, deceleration, factors, phase))), "")

        found[word] = highest(fails, brakes.LOWEST, brakes.HIGHEST, brakes.STEP)
    return Groan(label, found)


MARGINS = (0.6, 0.7, 0.8, 0.9, 1.0)
EASED = LABELS[:-1]


def longest(label: str, margin: float, machines: Mapping[str, Mapping[str, float]], phases: Sequence[float] = (0.0, 0.5)) -> float:
    """The longest stopping distance [m] of a law with a margin at 2.5 m/s2 on some machines; nan where a pad groans or the car does not stand."""
    contender = row_called(label)
    contender = replace(contender, law=partial(contender.law, margin=margin))
    found = 0.0
    for factors in machines.values():
        for phase in phases:
            stop = stop_of(contender, brakes.COMMON, factors, phase)
            if stop is None or stop.groans or not math.isfinite(stop.standstill):
                return math.nan
            found = max(found, stop.distance)
    return found


def distance_table() -> str:
    """The stopping distances at 2.5 m/s2 over the margin, nominal and over all errors, as text."""
    head = f"{'distance [m], margin':<26}" + "".join(f"{margin:>18g}" for margin in MARGINS)
    lines = [head, "-" * len(head)]
    for label in EASED:
        cells = []
        for margin in MARGINS:
            pair = [longest(label, margin, machines) for machines in ({"nominal": {}}, STOPS)]
            cells.append(" / ".join("groans" if math.isnan(each) else f"{each:.2f}" for each in pair))
        lines.append(f"{label:<26}" + "".join(f"{cell:>18}" for cell in cells))
    return "\n".join(lines)


# --- dither

NUMBERS = {
    "Leine's block": {"friction": ("belt.friction.static",), "stiffness": ("block.stiffness",)},
    "disc brake": {"friction": ("pad.friction.static", "pad.friction.kinetic"), "stiffness": ("disc.stiffness",)},
    "drill string": {"friction": ("bit.friction.static", "bit.friction.kinetic"), "stiffness": ("chain.stiffness.0",)},
}
OWN = ("load", "amplitude", "frequency")
"""Errors of the load and of the dither itself, which are no parameters of a rig."""
SETTLED, JUDGED = 60.0, 80.0
HALF = 0.5


def rigs(label: str) -> dict[str, dict[str, float]]:
    """{words: factors} of the errors of a rig and of its dither."""
    return _errors({**NUMBERS[label], **{word: (word,) for word in OWN}})


@cache
def _alone(label: str, factors: tuple[tuple[str, float], ...], load: float) -> tuple[Any, float, float]:
    """(run without dither, its swing, period of its cycle [s]) of a rig with errors; the swing is 0 where it is calm by itself."""
    rig = next(each for each in dither.RIGS if each.label == label)
    duration = (SETTLED + 20.0) / rig.natural
    given = {name: factor * float(np.ravel(rig.plant.parameter(name))[0]) for name, factor in factors}
    run = simulate(
        rig.plant, duration, parameters=given, inputs={**rig.run.get("inputs", {}), rig.load: load * rig.mean - rig.offset}, **_start(rig)
    )
    extent = measure.extent(run, rig.position, SETTLED / rig.natural)
    begins = [
        event.time
        for event in run.events
        if event.element == rig.contact and event.before == "stick" and event.time > SETTLED / rig.natural
    ]
    period = float(np.mean(np.diff(begins))) if len(begins) > 2 else 1.0 / rig.natural
    return run, extent.maximum - extent.minimum, period


def _start(rig: dither.Rig) -> dict[str, Any]:
    return {name: value for name, value in rig.run.items() if name != "inputs"}


def swing(label: str, frequency: float, depth: float, factors: Mapping[str, float], phase: float) -> float:
    """Swing under dither that begins at a phase of the cycle, in parts of that without; of that of the nominal rig, where this one is calm by itself."""
    rig = next(each for each in dither.RIGS if each.label == label)
    own = {word: factors.get(word, 1.0) for word in OWN}
    of_rig = tuple((name, factor) for name, factor in factors.items() if name not in OWN)
    before, alone, period = _alone(label, of_rig, own["load"])
    if alone < 1e-3 * rig.slip:
        alone = _alone(label, (), 1.0)[1]
    duration = JUDGED / rig.natural
    given = {name: factor * float(np.ravel(rig.plant.parameter(name))[0]) for name, factor in of_rig}
    mean = own["load"] * rig.mean
    wave = sine(mean - rig.offset, min(own["amplitude"] * depth, 1.0) * rig.mean * own["load"], own["frequency"] * frequency)
    begin = SETTLED / rig.natural + phase * period
    run = simulate(rig.plant, duration, start=before.at(begin), parameters=given, inputs={**rig.run.get("inputs", {}), rig.load: wave})
    extent = measure.extent(run, rig.position, duration / 2)
    return (extent.maximum - extent.minimum) / alone


@dataclass(frozen=True)
class Dithered:
    """A line of the second table: largest swing by error, and the bands [natural frequency], declared and robust; nan for none."""

    label: str
    frequency: float
    depth: float
    swing: Mapping[str, float]
    band: tuple[float, float]
    robust: tuple[float, float]


def dithered(label: str, ratios: Sequence[float] | np.ndarray = dither.RATIOS) -> Dithered:
    """The line of a rig."""
    rig = next(each for each in dither.RIGS if each.label == label)
    frequency, depth = dither.best(label)
    largest = {word: max(swing(label, frequency, depth, factors, phase) for phase in PHASES) for word, factors in rigs(label).items()}
    errors = {word: factors for word, factors in rigs(label).items() if not word.startswith("frequency")}
    declared = [all(swing(label, ratio * rig.natural, depth, {}, phase) < HALF for phase in PHASES) for ratio in ratios]
    robust = [
        fine and all(swing(label, ratio * rig.natural, depth, factors, phase) < HALF for factors in errors.values() for phase in PHASES)
        for ratio, fine in zip(ratios, declared, strict=True)
    ]
    return Dithered(label, frequency / rig.natural, depth, largest, widest(ratios, declared), widest(ratios, robust))


# --- tables


def groan_table(rows: Sequence[Groan]) -> str:
    """The first table as text."""
    words = list(rows[0].highest)
    head = f"{'silent up to [m/s2]':<40}" + "".join(f"{word:>17}" for word in words) + f"{'robust':>12}"

    lines = [f"{row.label:<40}" + "".join(f"{row.highest[word]!s:>17}" for word in words) + f"{row.robust!s:>12}" for row in rows]
    return "\n".join([head, "-" * len(head), *lines])


def dither_table(rows: Sequence[Dithered]) -> str:
    """The second table as text, a block for each rig."""
    lines = []
    for row in rows:
        bands = ["none" if low != low else f"{low:.2f} to {high:.2f}" for low, high in (row.band, row.robust)]
        lines.append(
            f"{row.label}: dither at {row.frequency:.2f} x natural, depth {row.depth:g}; swing below a half: declared {bands[0]}, robust {bands[1]}"
        )
        lines += [f"  {word:<18}{value:>8.3f}" for word, value in row.swing.items()]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Make both tables, and with --out their csv."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=folder, help="folder for groan.csv and dither_margins.csv")
    given = parser.parse_args(arguments)
    stops = [groan(label) for label in LABELS]
    print(groan_table(stops), flush=True)
    print(f"\n{distance_table()}", flush=True)
    cured = [dithered(rig.label) for rig in dither.RIGS]
    print(f"\n{dither_table(cured)}")
    if given.out:
        rows = [
            {"label": row.label, "error": word, "highest": each.value, "ended by": each.ended}
            for row in stops
            for word, each in row.highest.items()
        ]
        write_rows(rows, given.out / "groan.csv")
        swings = [{"label": row.label, "error": word, "swing": value} for row in cured for word, value in row.swing.items()]
        write_rows(swings, given.out / "dither_margins.csv")
        print(f"\nThe tables are in {given.out}")


if __name__ == "__main__":
    main()
