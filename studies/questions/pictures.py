"""What does a drive change at the bit? The figure of the README.

The published four-inertia rig under 97.3 kN, once with a constant torque of 10 kN m, once with a drive matched to the string and sampled at 100 Hz, which
settles at nearly the same torque. Left: speeds of the top drive and the bit, grey where the bit sticks. Right: the last cycles of the constant torque in the
plane of the twist above the bit and its speed, with the segment on which it sticks.

    python -m studies pictures [PATH]            (default studies/figures/stick_slip.png)
"""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Any

from controllers import SoftTorque
from models import BitRock, wells
from toolbox import compose, measure, plot, simulate, use_units
from toolbox.figures.style import name_axis
from toolbox.simulation.trajectory import Trajectory

DURATION, SETTLED = 120.0, 80.0  # [s]
RPM = math.pi / 30.0
PATH = Path(__file__).parents[1] / "figures" / "stick_slip.png"


def runs() -> dict[str, Trajectory]:
    """The two runs of the figure by title."""
    rig = compose(wells.NAVARRO_LOPEZ_4, BitRock(weight="97.347 kN"))
    return {
        "constant torque, 10 kN m": simulate(rig, DURATION, inputs={"top.torque": "10 kN m"}),
        "soft torque at 100 Hz, set-point 45 rpm": simulate(rig, DURATION, controller=SoftTorque(reference="45 rpm"), sample_time="10 ms"),
    }


def draw(found: dict[str, Trajectory]) -> Any:
    """The figure of two runs; returns a matplotlib figure."""
    import matplotlib.pyplot as plt
    from matplotlib.patches import Patch

    with plt.rc_context(plot.PAPER):
        figure = plt.figure(figsize=(9.0, 4.0), layout="constrained")
        grid = figure.add_gridspec(2, 2, width_ratios=(2.1, 1.0), wspace=0.06, hspace=0.08)
        panels = [figure.add_subplot(grid[row, 0]) for row in range(2)]
        plane = figure.add_subplot(grid[:, 1])
    for panel, (title, run) in zip(panels, found.items(), strict=True):
        with plt.rc_context(plot.PAPER):
            for begin, end in measure.stick_intervals(run, "bit"):
                panel.axvspan(begin, end, facecolor=plot.BAND, edgecolor="0.6", linewidth=0.5, zorder=0)
            times = _times(run)
            samples = run.at(times)
            panel.plot(times, samples["top.speed"], label="top drive", **plot.LINES[0])
            panel.plot(times, samples["bit.speed"], label="bit", **plot.LINES[1])
            panel.set(xlim=(0.0, DURATION), ylim=(-4.0 * RPM, 100.0 * RPM))
            name_axis(panel.yaxis, "speed", "rad/s")
            panel.set_title(title, loc="left", fontsize=9.0, pad=4.0)
    panels[0].tick_params(labelbottom=False)
    panels[1].set_xlabel("time [s]", fontsize=9.0)
    curves = panels[1].get_legend_handles_labels()[0]
    panels[1].legend(handles=[*curves, Patch(facecolor=plot.BAND, edgecolor="0.6", linewidth=0.5, label="bit sticks")],
                     loc="upper right", ncols=3, frameon=False, fontsize=8.0)  # fmt: skip
    plot.phase_plane(next(iter(found.values())), "chain.twist.2", "bit.speed", "bit", ax=plane, after=SETTLED)
    plane.set_xlabel("twist above the bit [rev]")
    plane.set_title(f"constant torque, after {SETTLED:g} s", loc="left", fontsize=9.0, pad=4.0)
    legend = plane.get_legend()
    if legend is not None:
        legend.remove()
    plane.text(0.5, 0.07, "stick", transform=plane.transAxes, ha="center", fontsize=8.5)
    return figure


def _times(run: Trajectory) -> Any:
    """Every step and enough times between."""
    import numpy as np

    return np.union1d(run.time, np.linspace(0.0, run.end, 3001))


def main() -> None:
    """Write the figure."""
    import matplotlib

    matplotlib.use("Agg")
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else PATH
    path.parent.mkdir(parents=True, exist_ok=True)
    with use_units("metric"):  # what drillers read: rpm and turns
        draw(runs()).savefig(path)
    print(path)


if __name__ == "__main__":
    main()
