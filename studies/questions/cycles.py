"""How far does stick-slip reach, and what lies between it and steady drilling? Cycles followed through the events of stick and slip.

1. A drill string under a stiff drive (Jansen's rig): steady drilling loses its stability at the Hopf speed, but stick-slip lives on far above it. Between
   the two stands an unstable cycle that never sticks; it meets the stick-slip cycle where the stick phase has shrunk to nothing, a fold with a corner. Its
   distance from steady drilling is the kick that the machine bears: a bit that is pushed beyond it ends in stick-slip.
2. Blocks on belts: the block of Thomsen and Fidlin passes from stick-slip through grazing into sliding oscillations and ends at its Hopf speed without
   a second state; that of Veraszto and Stepan has one, as the drill string does.
3. What do the numbers cost, and are they right? Multipliers against central differences of whole runs; times of this machine.

    python -m studies cycles [FOLDER]          (default studies/figures; writes cycles.png)
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from controllers import StiffPI
from models import BitRock, oscillators, wells
from studies.command_line import figure_folder
from studies.timing import timed
from toolbox import closed_loop, compose, follow, limit_cycle, plot, simulate, use_units
from toolbox.figures.style import name_axis
from toolbox.orbits import Branch, Cycle

RPM = math.pi / 30
RIG = compose(wells.JANSEN_2, BitRock(weight=97_347.0))
REFERENCE = 95 * RPM


def drilling() -> Cycle:
    """The stick-slip cycle of Jansen's rig at 95 rpm, as in studies/scenes/jansen_2.toml."""
    return limit_cycle(simulate(RIG, 120.0, controller=StiffPI(reference=REFERENCE), accuracy=1e-8))


def reach(cycle: Cycle, points: int = 250) -> Branch:
    """That cycle as the set-point changes, round the corner and down to the Hopf speed."""
    return follow(cycle, "stiffpi.reference", (2.0, 20.0), points=points)


def onwards(cycle: Cycle, points: int = 45) -> Branch:
    """The same branch the other way, to slow set-points, where the bit sticks for most of the time."""
    return follow(cycle, "stiffpi.reference", (2.0, 20.0), points=points, start_towards=2.0, step=0.04)


def differences(cycle: Cycle, by: float = 1e-6) -> np.ndarray:
    """Multipliers of that cycle from central differences of runs over a period, the largest first, without the trivial one."""
    columns = []
    for i in range(cycle.start.size):
        ends = []
        for sign in (1.0, -1.0):
            x = cycle.start.copy()
            x[i] += sign * by
            start = {"chain.twist": x[:1], "chain.speed": x[1:3], "stiffpi.angle": x[3]}
            ends.append(simulate(RIG, cycle.period, start=start, controller=StiffPI(reference=REFERENCE), accuracy=1e-13).states[-1])
        columns.append((ends[0] - ends[1]) / (2 * by))
    values = np.linalg.eigvals(np.array(columns).T)
    values = np.delete(values, int(np.argmin(np.abs(values - 1))))
    return values[np.argsort(-np.abs(values))]


def blocks() -> tuple[Branch, Branch]:
    """The branches of the blocks of Thomsen and Fidlin and of Veraszto and Stepan, as the belt changes its speed."""
    smooth = limit_cycle(
        closed_loop(compose(oscillators.THOMSEN_FIDLIN), parameters={"block.belt_speed": 0.31}, start={"block.position": 0.4}), 300.0
    )
    sharp = limit_cycle(
        closed_loop(compose(oscillators.VERASZTO_STEPAN), parameters={"block.belt_speed": 0.155}, start={"block.position": 0.002}), 10.0
    )
    return follow(smooth, "block.belt_speed", (0.3, 0.5), points=150), follow(sharp, "block.belt_speed", (0.15, 2.0), points=300)


def draw(string: Branch, slow: Branch, sliding: Branch, bistable: Branch) -> Any:
    """The three bifurcation diagrams; `slow` continues `string` to slow set-points."""
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 3, figsize=(11.0, 3.6), layout="constrained")
    slow.plot("bit.speed", ax=panels[0])
    string.plot("bit.speed", ax=panels[0])
    sliding.plot("block.speed", ax=panels[1])
    bistable.plot("block.speed", ax=panels[2])
    lines, words = panels[0].get_legend_handles_labels()
    once = dict(zip(words, lines, strict=True))
    panels[0].legend(once.values(), once.keys(), frameon=False)
    name_axis(panels[0].xaxis, "set-point", "rad/s")
    name_axis(panels[0].yaxis, "bit speed over a cycle, least and largest", "rad/s")
    for panel, title in zip(
        panels, ("Drill string, stiff drive", "Block of Thomsen and Fidlin", "Block of Veraszto and Stepan"), strict=True
    ):
        panel.set_title(title, loc="left", fontsize=9.0)
    for panel in panels[1:]:
        panel.set(xlabel="belt speed [m/s]", ylabel="block speed over a cycle, least and largest [m/s]")
        low, high = panel.get_xlim()
        panel.plot([low, high], [low, high], color="0.6", linewidth=0.8, linestyle=":", zorder=0, label="speed of the belt")
        panel.set_xlim(low, high)
        panel.legend(frameon=False, fontsize=8.0, loc="center left" if panel is panels[1] else "center right")
    return figure


def main() -> None:
    """Print the numbers and write the figure."""
    import matplotlib.pyplot as plt

    folder = figure_folder()
    settled = simulate(RIG, 120.0, controller=StiffPI(reference=REFERENCE), accuracy=1e-8)
    cycle = limit_cycle(settled)  # compiles
    times = []
    for _ in range(20):
        cycle, spent = timed(lambda: limit_cycle(settled), clock=time.perf_counter)
        times.append(spent)
    rough = limit_cycle(settled, accuracy=1e-12)
    print(cycle)
    print(
        f"period to {abs(rough.period - cycle.period):.0e} s of that at accuracy 1e-12; found in {1e3 * float(np.median(times)):.1f} ms (median of 20)"
    )
    print(f"multipliers differ from central differences by {np.abs(differences(cycle) - cycle.multipliers).max():.1e}")
    follow(cycle, "stiffpi.reference", (2.0, 20.0), points=3)  # compiles
    began, worked = time.perf_counter(), time.process_time()
    branch = reach(cycle, points=100)
    print(
        f"{len(branch.values)} points of its branch in {time.perf_counter() - began:.2f} s ({time.process_time() - worked:.2f} s of processor time)"
    )
    string = reach(cycle)
    print(string)
    fold, hopf = string.bifurcations
    print(
        f"stick-slip lives up to {fold.value / RPM:.2f} rpm, {fold.value / hopf.value:.2f} times the Hopf speed of {hopf.value / RPM:.2f} rpm"
    )
    sliding, bistable = blocks()
    print(sliding)
    print(bistable)
    with plt.rc_context(plot.PAPER), use_units("metric"):  # what drillers read: rpm
        draw(string, onwards(cycle), sliding, bistable).savefig(folder / "cycles.png")
        print(folder / "cycles.png")


if __name__ == "__main__":
    main()
