"""What does it cost that a law lifts its own set-point: in steps of it, in recoveries, below what it can hold, at steps of the weight, after a stall?

Every law of `inner_laws` acts inside `controllers.Lifting`, as it is and with the weight as a second actuator (`RELIEVING`), on the rig of `studies.protocol`,
at 4 and 6 rad/s, sampled every 10 ms, 30 ms late, with a noise of 0.01 rad/s on the top speed. Columns, each the worst of its runs:

up        highest top speed after the set-point is doubled in smooth running, in parts of the new one
down      seconds of stick after it is halved again
top       highest top speed after the takeover from a stiff drive inside stick-slip, at eight phases of its cycle, in parts of what is asked
calm      until the bit sticks for the last time [s]
back      until the top is at most 10 % above what is asked, for good [s]
flag      until the law gives up, at set-points of 2 and 3 rad/s, or those of `--below` [s]: the first flag; '-' where smooth running is held
lifted    share of half an hour there with the set-point more than 10 % above what is asked
x 1.3, x 1.5   seconds of stick in the last 100 of the 350 that follow a step of the weight by so much at 6 rad/s, and seconds until the last stick
weight off   mean share of the weight that is given up in the three minutes after a takeover, of laws that take weight off
stall     highest top speed from 15 s after the end of a minute in which the weight is four times as high and the bit stands, in parts of what is asked

With `--inside` another table in its place: the lowest set-points of the law inside alone and of the lifting law with the same gains, on groups of rigs, judged
as the rows of `python -m studies drives` are; a folder that holds cells of these spares them.

    python -m studies recovery [--out FOLDER] [--only LABEL ...] [--below SPEED ...] [--inside GROUP ...] [--jobs N]
        (some minutes of processor time; the table, recovery.csv, recovery.png; with --inside some minutes a law, beside_inside.csv and drives.jsonl)
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from controllers import PI, Lifting, SoftTorque
from studies import gains
from studies.command_line import folder, parser_of, write_rows
from studies.protocol import GROUPS, HIGHEST, LIMITS, LOWEST, PLANT, WEIGHT, trial
from studies.questions.drives import BETWEEN, GENTLE
from toolbox import Controller, Sampled, Trajectory, inputs, measure, plot, simulate, use_units
from toolbox.drilling.groups import Machine
from toolbox.drilling.lowest_set_point import Cells, borders
from toolbox.drilling.set_points import Trial
from toolbox.figures.style import name_axis
from toolbox.files.printing import columns
from toolbox.sweeps.executors import Workers

ASKED = (4.0, 6.0)
"""Set-points [rad/s]."""
BELOW = (2.0, 3.0)
"""Set-points that hardly any law holds [rad/s]."""
ABOVE = 1.1
"""Speeds above this part of what is asked are not at the set-point."""
PHASES = tuple(k / 8 for k in range(8))
SMOOTH, AT, OVER = 10.0, 150.0, 250.0
"""A set-point [rad/s] at which every law runs smoothly from rest; when the first thing happens, and the second [s]."""
STALL, AGAIN = 60.0, 15.0
"""Length of a stall, and from when after its end on the top speed counts [s]."""
HELD = 4.0
"""Factor of the weight in a stall: the torque at rest is more than the drive has."""
RELIEVING = {"first_factor": 1.3, "factor_step": 0.25, "raise_rate": 0.2, "weight_relief": 0.4}
"""Numbers of a lift that takes weight off as well: it is smaller and slower than one that does not."""
LIFTS = ", lifting"
"""What the labels of their rows and families end with in the drive table."""
RELIEF = ", weight off"
"""What the labels of these laws end with."""
SHOWN = ("impedance, tuned", f"impedance, tuned{RELIEF}")


def inner_laws() -> dict[str, Controller]:
    """The laws that are lifted, by label."""
    families = [name.removesuffix(LIFTS) for name in gains.known() if name.endswith(LIFTS)]
    tuned = {f"{name}, tuned": gains.tuned(f"{name}{LIFTS}").law for name in families}
    one = gains.FAMILIES["LQG, lifting"].of(gains.between("LQG", "LQG, lifting", BETWEEN)).law
    return {"soft torque": SoftTorque(**LIMITS), "PI": PI(**LIMITS), **tuned, "LQG, between": one}


def labels() -> list[str]:
    """All rows of the table."""
    return [f"{label}{end}" for end in ("", RELIEF) for label in inner_laws()]


def lifted(label: str, **numbers: Any) -> Trial:
    """How a law of `labels` is tried inside `Lifting`, with other numbers of it."""
    inner = label.removesuffix(RELIEF)
    given = {**(GENTLE if inner == "LQG, between" else {}), **(RELIEVING if label.endswith(RELIEF) else {})}
    return trial(label, Lifting(inner_laws()[inner], **{**given, **numbers}))


@dataclass(frozen=True)
class Recovery:
    """A line of the table: speeds in parts of what is asked, times [s], shares [1]; pairs are of the two set-points or steps."""

    label: str
    up: float
    down: float
    top: tuple[float, float]
    calm: tuple[float, float]
    back: tuple[float, float]
    flag: tuple[float, ...]
    lifted: tuple[float, ...]
    weight: tuple[float, float]
    held: tuple[float, float]
    stall: float
    relief: float


def smooth(
    law: Trial, reference: float, duration: float, display_units: Sequence[tuple[float, float]] = (), weight: Any = WEIGHT
) -> Trajectory:
    """A run from rest over a high set-point into smooth running at one; asked: (time, set-point) of steps."""
    times, speeds = [0.0, 80.0, 110.0], [SMOOTH, SMOOTH, reference]
    for time, speed in display_units:
        times, speeds = [*times, time, time], [*speeds, speeds[-1], speed]
    clock = Sampled(law.of(reference), law.period, law.clock.delay, noise={"top.speed": 0.01}, seed=7)
    return simulate(PLANT, duration, controller=clock, inputs={"top.reference": (times, speeds), law.place("bit.weight"): weight})


def highest(run: Trajectory, begin: float, end: float = np.inf) -> float:
    """Highest top speed between two times [rad/s]."""
    return float(run["top.speed"][(run.time > begin) & (run.time < end)].max())


def last_stick(run: Trajectory, after: float) -> float:
    """How long after a time the bit sticks for the last time [s]; 0 where it does not."""
    ends = [end for _, end in measure.stick_intervals(run, "bit", after=after)]
    return ends[-1] - after if ends else 0.0


def stepped(law: Trial, reference: float) -> tuple[float, float]:
    """(highest top speed over the set-point that is doubled, seconds of stick after it is halved)."""
    run = smooth(law, reference, 350.0, [(AT, 2.0 * reference), (OVER, reference)])
    return highest(run, AT, OVER) / (2.0 * reference), run.time_in("bit", "stick", after=OVER)


def recovered(law: Trial, reference: float, phase: float) -> tuple[float, float, float, float]:
    """(highest top speed over what is asked, time until the last stick, time until the top is no longer 10 % too fast, weight given up) of a takeover."""
    run, at = law.run(Machine("nominal"), reference, seed=7, phase=phase), law.takeover(reference, phase)
    fast = run.time[(run.time > at) & (run["top.speed"] > ABOVE * reference)]
    off = measure.extent(run, "takeover.lifting.relief", at).mean if getattr(law.clock.law, "weight_relief", None) else 0.0
    return highest(run, at) / reference, last_stick(run, at), float(fast[-1]) - at if fast.size else 0.0, off


def given_up(law: Trial, reference: float) -> tuple[float, float]:
    """(time of the first flag, share of half an hour that is lifted) from inside stick-slip; the first is nan where smooth running is held at the end."""
    at = law.takeover(reference)
    run = law.run(Machine("nominal"), reference, seed=7, duration=at + 1800.0)
    flags = run.time[run["takeover.lifting.gave_up"] > 0.0]
    fast, late = run["lifting.reference"] > ABOVE * reference, run.time > run.end - 300.0
    high = np.trapezoid(fast.astype(float), run.time) / 1800.0
    never = np.inf if fast[late].any() or run.time_in("bit", "stick", after=run.end - 300.0) > 0.0 else np.nan
    return float(flags[0]) - at if flags.size else never, float(high)


def weighed(law: Trial, factor: float) -> tuple[float, float]:
    """(seconds of stick in the last 100 s, time until the last stick) after a step of the weight at the higher set-point."""
    run = smooth(law, ASKED[1], AT + 350.0, weight=inputs.step(WEIGHT, factor * WEIGHT, AT))
    return run.time_in("bit", "stick", after=run.end - 100.0), last_stick(run, AT)


def stalled(law: Trial, reference: float) -> tuple[Trajectory, float]:
    """(run, highest top speed over what is asked from 15 s after the end of the stall)."""
    end = AT + STALL
    weight = ((0.0, AT, AT + 1.0, end, end + 1.0), (WEIGHT, WEIGHT, HELD * WEIGHT, HELD * WEIGHT, WEIGHT))
    run = smooth(law, reference, end + 200.0, weight=weight)
    return run, highest(run, end + AGAIN) / reference


def recovery(label: str, below: Sequence[float] = BELOW, **numbers: Any) -> Recovery:
    """The line of a law; below: set-points that it may not hold [rad/s];  numbers: of `Lifting`."""
    law = lifted(label, **numbers)
    up, down = np.max([stepped(law, reference) for reference in ASKED], axis=0)
    found = [np.max([recovered(law, reference, phase) for phase in PHASES], axis=0) for reference in ASKED]
    top, calm, back, off = zip(*np.array(found).tolist(), strict=True)
    flag, above = zip(*[given_up(law, reference) for reference in below], strict=True)
    stuck, held = zip(*[weighed(law, factor) for factor in (1.3, 1.5)], strict=True)
    stall = max(stalled(law, reference)[1] for reference in ASKED)
    return Recovery(label, float(up), float(down), top, calm, back, flag, above, stuck, held, stall, max(off))


def table(rows: Sequence[Recovery]) -> str:
    """The rows as text."""

    def pair(values: Sequence[float], form: str, factor: float = 1.0) -> str:
        return " / ".join("-" if np.isnan(value) else "never" if np.isinf(value) else f"{factor * value:{form}}" for value in values)

    lines: list[tuple[str, ...]] = [
        (
            "lifted law",
            "up",
            "down",
            "top",
            "calm [s]",
            "back [s]",
            "flag [s]",
            "lifted [%]",
            "x 1.3, 1.5 [s]",
            "last [s]",
            "stall",
            "weight off",
        )
    ]
    for each in rows:
        lines.append((
            each.label, f"{each.up:.2f}", f"{each.down:.1f}", pair(each.top, ".2f"), pair(each.calm, ".0f"), pair(each.back, ".0f"),
            pair(each.flag, ".0f"), pair(each.lifted, ".1f", 100.0), pair(each.weight, ".1f"), pair(each.held, ".0f"), f"{each.stall:.2f}",
            f"{100 * each.relief:.0f} %" if each.relief else "-",
        ))  # fmt: skip
    return "\n".join(columns(lines, left=(0,)))


@dataclass(frozen=True)
class Beside:
    """Lowest set-points [rad/s] of the law inside alone and of the lifting law around it, on a group of rigs, each kept for half an hour."""

    label: str
    group: str
    way: str
    inside: float
    lifting: float


def beside(label: str, names: Sequence[str], known: Path | None = None) -> list[Beside]:
    """What a lift with the same gains does to the lowest set-points of a law on some groups; known: file of cells, which those of the drive table may be."""
    inner, groups = inner_laws()[label.removesuffix(RELIEF)], [GROUPS[name] for name in names]
    row = label if label.endswith(RELIEF) else f"{label}{LIFTS}"
    alone, lifting = (
        borders(law, groups, cells=Cells(known), lower=LOWEST, higher=HIGHEST)
        for law in (trial(label, inner), trial(row, lifted(label).clock.law))
    )
    return [Beside(label, *key, held.lowest_set_point, lifting[key].lowest_set_point) for key, held in alone.items()]


def picture(path: Path, shown: Sequence[str] = SHOWN) -> None:
    """Top speeds over time at the lower set-point: a recovery from inside stick-slip, and what follows a stall; thin, the lifted set-points."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    asked = ASKED[0]
    with pyplot.rc_context(plot.PAPER), use_units("metric"):
        figure, axes = pyplot.subplots(1, 2, figsize=(10.0, 3.2), layout="constrained", sharey=True)
        for label, style in zip(shown, plot.LINES, strict=False):
            law = lifted(label)
            for ax, run, begin in (
                (axes[0], law.run(Machine("nominal"), asked, seed=7), law.takeover(asked)),
                (axes[1], stalled(law, asked)[0], AT),
            ):
                times = np.linspace(begin, min(begin + 160.0, run.end), 3000)
                ax.plot(times - begin, run.at(times)["top.speed"], label=label, **style)
                ax.plot(times - begin, run.at(times)["lifting.reference"], **{**style, "linewidth": 0.7})
        for ax, title in zip(axes, ("taken over in stick-slip", f"the bit held for {STALL:.0f} s"), strict=True):
            ax.axhline(asked, color="0.5", linewidth=0.8, linestyle=":")
            ax.set_xlabel("time [s]")
            ax.set_title(title, fontsize=9.0, loc="left")
        name_axis(axes[0].yaxis, "top speed", "rad/s")
        axes[0].legend(frameon=False, fontsize=8.0)
        figure.savefig(path, dpi=180)
        pyplot.close(figure)


def main() -> None:
    """Print the table, and with --out write it and its picture."""
    parser = parser_of(__doc__)
    parser.add_argument("--out", type=folder)
    parser.add_argument("--only", nargs="+", choices=labels(), default=labels(), metavar="LABEL")
    parser.add_argument(
        "--below", nargs="+", type=float, default=BELOW, metavar="SPEED", help="set-points that laws may not hold [rad/s] (2 3)"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument(
        "--inside", nargs="+", choices=list(GROUPS), metavar="GROUP", help="groups on which laws are held against those inside of them"
    )
    given = parser.parse_args()
    if given.inside:
        count, known = len(given.only), given.out / "drives.jsonl" if given.out else None
        with Workers(given.jobs) as workers:
            found = [each for several in workers.map(beside, given.only, [given.inside] * count, [known] * count) for each in several]
        heads = ("law", "group", "way", "inside alone [rad/s]", "lifting [rad/s]")
        lines = [(each.label, each.group, each.way, f"{each.inside:.1f}", f"{each.lifting:.1f}") for each in found]
        print("\n".join(columns([heads, *lines], left=(0, 1, 2))))
        if given.out:
            write_rows(found, given.out / "beside_inside.csv")
        return
    with Workers(given.jobs) as workers:
        rows = list(workers.map(recovery, given.only, [tuple(given.below)] * len(given.only)))
    print(table(rows))
    if given.out:
        write_rows(rows, given.out / "recovery.csv")
        picture(given.out / "recovery.png")
        print(f"\nThe table and its picture are in {given.out}")


if __name__ == "__main__":
    main()
