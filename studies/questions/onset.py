"""Where does stick-slip begin under each drive, where does it end, and what lies between? Three independent answers for every law.

Plant: the two inertias of Jansen and van den Steen with the bit at 97.3 kN, as in `studies/scenes/jansen_2.toml`; what varies is the set-point.

1. Hopf speed, exact. Of a continuous law from its linearised loop. Of a sampled law its continuous form does not know; but steady drilling under it comes
   round with every sample: a cycle of one sample time, whose multipliers `follow` takes to the unit circle, a Neimark-Sacker point.
2. Both borders by simulation (`onset`): smooth drilling disturbed a little, and stick-slip carried on from run to run.
3. The cycles themselves (`follow`), for continuous laws: stable stick-slip, the point at which it stops being stable, and unstable cycles back to the
   Hopf speed. A stick-slip cycle of a sampled law comes round with the clock by chance only, and has none.

What comes out: sliding mode loses stick-slip in a smooth fold, the stiff drive where the stick phase shrinks to nothing (a corner, at which the branch turns),
soft torque by period doubling before either. The two borders of every law are so far apart that the Hopf speed alone says little.

How far `onset`, `severity_map` and `follow` lie apart, and from slow ramps of another simulation, is the question of `studies.questions.borders`.

    python -m studies onset [FOLDER]          (default studies/figures; writes onset.png; two minutes)
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from controllers import SlidingMode, SoftTorque, StiffPI
from models import BitRock, wells
from studies.command_line import figure_folder
from toolbox import ClosedLoop, closed_loop, compose, follow, limit_cycle, measure, onset, plot, simulate, use_units
from toolbox.figures.style import name_axis
from toolbox.onsets.results import Onset
from toolbox.orbits import Branch

RPM = math.pi / 30
RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
WORKING = 95 * RPM
RANGE = (2.0, 16.0)


@dataclass(frozen=True)
class Drive:
    """A law, its sample time [s] or None, and where it certainly sticks and slips and is certainly free [rad/s]."""

    label: str
    law: Any
    sample_time: float | None
    sticks: float
    free: float

    @property
    def reference(self) -> str:
        """The name of its set-point among the parameters."""
        return f"{type(self.law).__name__.lower()}.reference"

    def at(self, reference: float) -> ClosedLoop:
        """The loop with a set-point."""
        return closed_loop(RIG, dataclasses.replace(self.law, reference=reference), sample_time=self.sample_time)


DRIVES = (
    Drive("stiff PI", StiffPI(), None, 9.0, 14.0),
    Drive("soft torque", SoftTorque(), None, 6.0, 13.0),
    Drive("sliding mode", SlidingMode(), None, 6.0, 12.0),
    Drive("stiff PI, 100 Hz", StiffPI(), 0.01, 9.0, 14.0),
    Drive("soft torque, 10 Hz", SoftTorque(), 0.1, 6.0, 13.0),
    Drive("sliding mode, 100 Hz", SlidingMode(), 0.01, 6.0, 12.0),
)


@cache
def borders(drive: Drive) -> Onset:
    """Both borders by simulation, and the Hopf point of the continuous form."""
    return onset(drive.at(WORKING), "top.reference", RANGE, num_values=9)


@cache
def steady(drive: Drive) -> Branch:
    """Steady drilling under a sampled law, from a free set-point downward, as a cycle of one sample time."""
    begin = limit_cycle(drive.at(drive.free), 300.0, period=drive.sample_time)
    return follow(begin, drive.reference, RANGE, points=80, start_towards=RANGE[0], step=0.05)


def hopf(drive: Drive) -> float:
    """The set-point at which steady drilling loses its stability, exact [rad/s]."""
    if drive.sample_time is None:
        return borders(drive).hopf[0].value
    return next(point.value for point in steady(drive).bifurcations if point.kind == "Neimark-Sacker")


@cache
def cycles(drive: Drive, points: int = 300) -> Branch:
    """The stick-slip cycle of a continuous law as the set-point rises, past the end of stick-slip and back along unstable cycles."""
    return follow(
        limit_cycle(simulate(drive.at(drive.sticks), 300.0, accuracy=1e-9)), drive.reference, RANGE, points=points, start_towards=RANGE[1]
    )


@cache
def slow(drive: Drive) -> Branch:
    """The same cycle as the set-point falls."""
    return follow(cycles(drive).cycles[0], drive.reference, RANGE, points=60, start_towards=RANGE[0], step=0.04)


def rest_of(drive: Drive) -> Branch:
    """What `cycles` has not reached: the unstable cycles on towards the Hopf speed."""
    return follow(cycles(drive).cycles[-1], drive.reference, RANGE, points=300, start_towards=RANGE[0])


def lost(branch: Branch) -> tuple[str, float]:
    """How and where the first cycle of a branch stops being stable [rad/s]."""
    first = next(point for point in branch.bifurcations)
    return first.kind, first.value


def swept(drive: Drive, references: Sequence[float], start: Any, length: float = 250.0) -> np.ndarray:
    """Smallest and largest bit speed once settled, each run from the end of the one before with a bit 1 % slower, shape (references, 2)."""
    ends = []
    for reference in references:
        run = simulate(drive.at(float(reference)), length, start=start, accuracy=1e-7)
        found = measure.extent(run, "bit.speed", run.begin + 0.8 * length)
        ends.append((found.minimum, found.maximum))
        start = run.last.with_values({"chain.speed": run.last["chain.speed"] * (1.0, 0.99)})
    return np.array(ends)


def draw(grid: np.ndarray) -> Any:
    """Bifurcation diagrams: branches by continuation, sweeps up and down by simulation, Hopf points."""
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(2, 3, figsize=(11.4, 6.2), layout="constrained", sharex=True, sharey=True)
    dark, light = plot.LINES[0]["color"], plot.LINES[1]["color"]
    for panel, drive in zip(panels.ravel(), DRIVES, strict=True):
        border, critical = borders(drive), hopf(drive)
        panel.axvspan(critical, border.end, color="0.92", linewidth=0, zorder=0, label="both possible")
        stable = np.linspace(critical, RANGE[1], 2)
        panel.plot(stable, stable, color=dark, linewidth=1.4, label="steady drilling")
        panel.plot([RANGE[0], critical], [RANGE[0], critical], color=dark, linewidth=1.0, linestyle=(0, (4, 2)))
        if drive.sample_time is None:
            for branch in (slow(drive), cycles(drive), rest_of(drive)):
                values, ends, calm = np.array(branch.values), branch.extremes("bit.speed"), branch.stable
                for side in (0, 1):
                    panel.plot(values, np.where(calm, ends[:, side], np.nan), color=light, linewidth=1.6, label="stick-slip, stable")
                    panel.plot(
                        values,
                        np.where(calm, np.nan, ends[:, side]),
                        color=light,
                        linewidth=1.1,
                        linestyle=(0, (4, 2)),
                        label="cycle, unstable",
                    )
            kind, value = lost(cycles(drive))
            fastest = float(cycles(drive).bifurcations[0].cycle.extremes("bit.speed")[1])
            panel.plot([value], [fastest], "D", color="0.1", markersize=5, label="end of the stable cycle")
            panel.annotate(kind, (value, fastest), (7, 0), textcoords="offset points", va="center", fontsize=8.0)
        up = swept(drive, grid, {"chain.speed": (float(grid[0]), 0.0)})
        calm = simulate(drive.at(RANGE[1]), 300.0, start={"chain.speed": (RANGE[1], RANGE[1]), "chain.twist": 17.0}, accuracy=1e-9)
        down = swept(drive, grid[::-1], calm.last)
        for ends, values, marker, word in ((up, grid, "^", "sweep up"), (down, grid[::-1], "v", "sweep down")):
            for side in (0, 1):
                panel.plot(
                    values,
                    ends[:, side],
                    marker,
                    color="0.25",
                    markerfacecolor="none",
                    markersize=4.0,
                    linestyle="none",
                    label=word,
                    zorder=3,
                )
        panel.plot([critical], [critical], "o", color="0.1", markersize=5, zorder=4, label="Hopf point")
        panel.axvline(WORKING, color="0.6", linewidth=0.8, linestyle=":", label="working point, 95 rpm")
        panel.set_title(drive.label, loc="left", fontsize=9.0)
        panel.set(xlim=RANGE, ylim=(-0.8, 29.0))
    once = dict(zip(*reversed(panels[0, 0].get_legend_handles_labels()), strict=True))
    figure.legend(once.values(), once.keys(), frameon=False, fontsize=8.0, loc="outside upper center", ncols=5)
    for panel in panels[1]:
        name_axis(panel.xaxis, "set-point", "rad/s")
    for panel in panels[:, 0]:
        name_axis(panel.yaxis, "bit speed, least and largest", "rad/s")
    return figure


def main() -> None:
    """Print the table and write the figure."""
    import matplotlib.pyplot as plt

    folder = figure_folder()
    print(f"Set-points in rad/s, 97.3 kN on bit; margin of {WORKING:.2f} rad/s (95 rpm) to the end of stick-slip\n")
    print(f"{'drive':<22}{'Hopf, exact':>13}{'smooth lost':>18}{'stick-slip ends':>19}{'its cycle ends':>32}{'margin':>9}")
    for drive in DRIVES:
        found = borders(drive)
        loss, end = found.losses[0], found.ends[0]
        cycle = "-" if drive.sample_time is not None else "{1:.6f} ({0})".format(*lost(cycles(drive)))
        print(
            f"{drive.label:<22}{hopf(drive):>13.6f}{loss.value:>10.3f} +- {loss.tolerance:.3f}{end.value:>11.3f} +- {end.tolerance:.3f}"
            f"{cycle:>32}{100 * end.margin(WORKING):>+7.0f} %", flush=True)  # fmt: skip
    with plt.rc_context(plot.PAPER), use_units("metric"):  # what drillers read: rpm
        draw(np.linspace(*RANGE, 29)).savefig(folder / "onset.png", dpi=110)
        print(folder / "onset.png")


if __name__ == "__main__":
    main()
