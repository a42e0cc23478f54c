"""Which gain of a sliding mode ends stick-slip without driving the collar against the borehole wall, and does the answer survive the way of starting?

Theory. The bit of a published string (160 kN, 88 rpm) sticks and slips under a stiff drive. A sliding mode ends that in a range of its weight lam of the speed
difference. But breaking the bit free it lets the bit run ahead, the faster the larger lam. Steady synchronous whirl reaches the wall at
sqrt(k_l/m gap/(gap + e)), here 20.2 rad/s; beyond it the collar strikes, friction turns its whirl backward, and rolling along the wall then lasts down to
a much lower speed, here 7.4 rad/s (`WhirlingCollar.contact_speed`, `rolling_speed`). The set-point lies between the two: at 9.2 rad/s the collar does what it
was last disturbed into, as the bit does between its borders. So a gain has no outcome by itself; a gain and a way of starting have.

Answer (the map of outcomes). A ramp of the set-point over 60 s lets the collar alone at every gain from 0.05 to 0.8 1/s, a step from rest only at 0.1
and 0.2 1/s. Inside existing stick-slip the collar strikes already, and at every gain it strikes on when the sliding mode takes over; what differs is
the end. At 0.02 to 0.1 and at 0.6 to 0.8 1/s the collar comes off the wall from all eight phases of the cycle. At 0.2 to 0.4 1/s it ends up rolling
backward along the wall for ever from half of them and more, while the bit turns as evenly as it can: the drive sees nothing. From 1 1/s on stick-slip
is back however it is started. A gain good for both whatever came before is 0.05 to 0.1 1/s, with the set-point ramped; a step from rest at 0.2 1/s,
which strikes nothing, says nothing about a drive that takes over at 0.2 1/s. How many impacts there are depends on every digit.

    python -m studies whirl [FOLDER]         map of outcomes and table, studies/figures/whirl.png and whirl_outcomes.png (four minutes)
    python -m studies whirl stiffness        what a stiff wall costs the explicit method
"""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from controllers import SlidingMode, StiffPI
from models import BitRock, Exponential, WhirlingCollar, wells, whirl_ratio
from studies.command_line import figure_folder
from toolbox import HybridSystem, compose, measure, plot, simulate, use_units
from toolbox.figures.style import name_axis
from toolbox.simulation.trajectory import Trajectory
from toolbox.steady_states.equilibria import state_values

WEIGHT, REFERENCE = 160_000.0, 88 * math.pi / 30  # [N], [rad/s]
DURATION, SETTLED = 160.0, 120.0  # [s]
PHASES = 8
RAMPS = (15.0, 60.0)  # [s]
WAYS = ("step from rest", *(f"ramp over {length:g} s" for length in RAMPS), *(f"inside, phase {k}/{PHASES}" for k in range(PHASES)))
"""Ways of starting: the set-point at once, the set-point ramped, and a takeover from the stiff drive at a phase of its stick-slip cycle."""

SHOWN = {WAYS[0]: 8.0, WAYS[2]: 56.0, WAYS[3]: 40.0}
"""Ways of starting that the figure shows, and when two seconds of their orbit begin [s]."""

OUTCOMES = ("never strikes", "strikes, comes off", "rolls on the wall", "stick-slip")
GAINS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.3, 1.6)  # [1/s]
ROCK = BitRock(weight=WEIGHT, radius=0.0239, friction=Exponential(static=2.5, kinetic=1.1, decay=0.4))
SLIDING = ROCK.radius * WEIGHT * ROCK.friction.kinetic
"""Torque on bit at high speed [N m]."""


def rig(weight: float = WEIGHT) -> HybridSystem:
    """The string with its collar under a weight on bit [N]."""
    return compose(dataclasses.replace(wells.UFRJ_2, collar_index=-1), dataclasses.replace(ROCK, weight=weight), WhirlingCollar())


@cache
def driven(gain: float | None, way: str = WAYS[0], weight: float = WEIGHT) -> Trajectory:
    """A run under a sliding mode of that gain [1/s], started in one of the ways, or under the stiff drive, from rest."""
    if gain is None:
        return simulate(rig(weight), DURATION, controller=StiffPI(reference=REFERENCE))
    law: Any = SlidingMode(reference=REFERENCE, surface_gain=gain, reaching_rate=1.0)
    if way.startswith("ramp"):
        length = RAMPS[WAYS.index(way) - 1]
        return simulate(rig(weight), DURATION, controller=law, inputs={"top.reference": ((0.0, length), (0.0, REFERENCE))})
    start = taken_over(WAYS.index(way) - 1 - len(RAMPS), weight) if way.startswith("inside") else None
    return simulate(rig(weight), DURATION, controller=law, start=start)


def taken_over(phase: int, weight: float = WEIGHT) -> dict[str, Any]:
    """The states of string and collar at a phase of the last whole stick-slip cycle under the stiff drive; its integral stays with it."""
    run = driven(None, WAYS[0], weight)
    begins = [first for first, _ in measure.stick_intervals(run, "bit", SETTLED)]
    samples = run.at(begins[-2] + phase / PHASES * (begins[-1] - begins[-2]))
    return {name: value for name, value in state_values(run.program.system, samples.states[0]).items() if not name.startswith("stiffpi.")}


def outcome(run: Trajectory) -> int:
    """What a run came to, an index of `OUTCOMES`."""
    if run.time_in("bit", "stick", after=SETTLED) > 0.0:
        return 3
    if run.time_in("wall", "closed", after=SETTLED) > 0.0:
        return 2
    return int(measure.contact(run, "wall").impacts > 0)


def outcomes(gains: Sequence[float] = GAINS, ways: Sequence[str] = WAYS) -> np.ndarray:
    """The outcome for every gain and way of starting, shape (gains, ways)."""
    return np.array([[outcome(driven(gain, way)) for way in ways] for gain in gains])


def row(run: Trajectory) -> dict[str, float]:
    """Severity and sticking of the bit after the transient; impacts, time and largest force of the wall, and the whirl at the end."""
    wall = measure.contact(run, "wall")
    return {
        "severity": measure.severity(run, "bit.speed", after=SETTLED),
        "stuck": run.time_in("bit", "stick", after=SETTLED),
        "peak": measure.extent(run, "bit.speed").maximum,
        "impacts": wall.impacts,
        "contact": wall.time,
        "force": wall.force,
        "late contact": run.time_in("wall", "closed", after=SETTLED),
        "whirl": whirl_ratio(run, SETTLED),
    }


def table(rows: dict[str, dict[str, float]]) -> str:
    """The rows as text."""
    collar = WhirlingCollar()
    lines = [
        f"Whirling collar, {WEIGHT / 1e3:g} kN on bit, {REFERENCE:.2f} rad/s, {DURATION:g} s; severity, sticking, late contact and whirl after {SETTLED:g} s.",
        f"Synchronous whirl reaches the wall at {collar.contact_speed(WEIGHT, SLIDING):.1f} rad/s; rolling backward (whirl "
        f"{collar.rolling_ratio():.2f}) lasts above {collar.rolling_speed(WEIGHT, SLIDING):.1f} rad/s.",
        "",
        f"{'drive':<28}{'severity':>9}{'stuck':>9}{'peak':>12}{'impacts':>9}{'contact':>10}{'force':>9}{'late contact':>14}{'whirl':>8}",
    ]
    for label, r in rows.items():
        lines.append(
            f"{label:<28}{r['severity']:9.2f}{r['stuck']:7.1f} s{r['peak']:6.1f} rad/s{r['impacts']:9.0f}{r['contact']:8.2f} s{r['force'] / 1e3:6.0f} kN"
            f"{r['late contact']:12.2f} s{r['whirl']:8.2f}"
        )
    return "\n".join(lines)


def map_text(found: np.ndarray, gains: Sequence[float] = GAINS, ways: Sequence[str] = WAYS) -> str:
    """The map of outcomes as text, one line per gain; the phases inside stick-slip counted."""
    plain = [k for k, way in enumerate(ways) if not way.startswith("inside")]
    within = [k for k, way in enumerate(ways) if way.startswith("inside")]
    lines = [f"{'gain':>10}" + "".join(f"{ways[k]:>22}" for k in plain) + f"    inside stick-slip, {len(within)} phases"]
    for gain, row in zip(gains, found, strict=True):
        counted = ", ".join(f"{(row[within] == k).sum()} {OUTCOMES[k]}" for k in range(4) if (row[within] == k).any())
        lines.append(f"{gain:>6g} 1/s" + "".join(f"{OUTCOMES[row[k]]:>22}" for k in plain) + f"    {counted}")
    return "\n".join(lines)


def orbit(run: Trajectory, ax: Any, begin: float, end: float) -> None:
    """The path of the collar's centre in the hole, with the circle at which it meets the wall; contact is drawn thick."""
    times = np.union1d(run.time[(run.time >= begin) & (run.time <= end)], np.linspace(begin, end, 6001))
    samples = run.at(times)
    y, z = 1e3 * samples["collar.y"], 1e3 * samples["collar.z"]
    closed = samples.modes["wall"] == "closed"
    gap = 1e3 * WhirlingCollar().gap
    angle = np.linspace(0, 2 * np.pi, 361)
    ax.fill(np.concatenate([gap * np.cos(angle), 1.12 * gap * np.cos(angle[::-1])]), np.concatenate([gap * np.sin(angle), 1.12 * gap * np.sin(angle[::-1])]),
            facecolor="0.88", edgecolor="none", zorder=0)  # fmt: skip
    ax.plot(gap * np.cos(angle), gap * np.sin(angle), color="0.3", linewidth=0.8)
    ax.plot(y, z, **{**plot.LINES[0], "linewidth": 0.5})
    ax.plot(np.where(closed, y, np.nan), np.where(closed, z, np.nan), color=plot.LINES[0]["color"], linewidth=2.2)
    ax.set(xlabel="y [mm]", ylabel="z [mm]", xlim=(-1.13 * gap, 1.13 * gap), ylim=(-1.13 * gap, 1.13 * gap), aspect="equal")


def draw(runs: dict[str, tuple[Trajectory, float]]) -> Any:
    """Speeds and radius of each run, and two seconds of its orbit from the given time on, one column each; returns a matplotlib figure."""
    import matplotlib.pyplot as plt
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    end, collar = min(60.0, *(run.end for run, _ in runs.values())), WhirlingCollar()
    dashed = {"color": "0.3", "linewidth": 0.8, "linestyle": (0, (4, 2))}
    with plt.rc_context(plot.PAPER):
        figure, axes = plt.subplots(3, len(runs), figsize=(9.0, 6.6), layout="constrained", height_ratios=(1, 1, 1.7), squeeze=False)
        for k, (label, (run, first)) in enumerate(runs.items()):
            speed, radius, plane = axes[:, k]
            times = np.union1d(run.time[run.time <= end], np.linspace(0.0, end, 4001))
            samples = run.at(times)
            for begin, last in measure.stick_intervals(run, "bit"):
                speed.axvspan(begin, last, facecolor=plot.BAND, edgecolor="0.6", linewidth=0.5, zorder=0)
            speed.axhline(collar.contact_speed(WEIGHT, SLIDING), **dashed)
            speed.plot(times, samples["top.speed"], label="top drive", **plot.LINES[0])
            speed.plot(times, samples["bit.speed"], label="bit", **plot.LINES[1])
            speed.set(xlim=(0.0, end), ylim=(-0.5, 27.0))
            speed.set_title(label, loc="left", fontsize=9.0)
            speed.tick_params(labelbottom=False)
            name_axis(speed.yaxis, "speed" if k == 0 else "", "rad/s")
            if k:
                speed.set_ylabel("")
            radius.axvspan(first, first + 2.0, facecolor="0.75", zorder=0)
            radius.plot(times, 1e3 * samples["collar.radius"], **{**plot.LINES[0], "linewidth": 0.5})
            radius.axhline(1e3 * collar.gap, **dashed)
            radius.set(xlim=(0.0, end), ylim=(0.0, 26.0), xlabel="time [s]")
            orbit(run, plane, first, first + 2.0)
            plane.set_title(f"orbit from {first:g} s to {first + 2:g} s", loc="left", fontsize=9.0)
        axes[1, 0].set_ylabel("radius of centre [mm]")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        handles += [Patch(facecolor=plot.BAND, edgecolor="0.6", linewidth=0.5), Patch(facecolor="0.75"), Line2D([], [], **dashed)]
        labels += ["bit sticks", "time of the orbit below", "wall, and the speed at which whirl would reach it"]
        figure.legend(handles, labels, loc="outside upper center", ncols=5, frameon=False, fontsize=8.0)
    return figure


def draw_outcomes(found: np.ndarray, gains: Sequence[float] = GAINS, ways: Sequence[str] = WAYS) -> Any:
    """The map of outcomes over gain and way of starting, a grey and a letter for each; returns a matplotlib figure."""
    import matplotlib.pyplot as plt
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    greys, letters = ("white", "0.85", plot.LINES[1]["color"], "0.35"), ("", "s", "R", "S")
    with plt.rc_context(plot.PAPER):
        figure, ax = plt.subplots(figsize=(6.6, 4.0), layout="constrained")
        ax.imshow(found.T, cmap=ListedColormap(greys), vmin=0, vmax=3, aspect="auto", interpolation="nearest")
        for i, j in np.ndindex(*found.shape):
            ax.text(i, j, letters[found[i, j]], ha="center", va="center", fontsize=7.5, color="white" if found[i, j] == 3 else "black")
        ax.set_xticks(range(len(gains)), [f"{gain:g}" for gain in gains])
        ax.set_yticks(range(len(ways)), list(ways))
        ax.set_xticks(np.arange(len(gains) + 1) - 0.5, minor=True)
        ax.set_yticks(np.arange(len(ways) + 1) - 0.5, minor=True)
        ax.grid(which="minor", color="0.6", linewidth=0.5)
        ax.tick_params(which="both", length=0)
        ax.set_xlabel("gain of the sliding mode, weight lam of the surface [1/s]")
        words = [f"{letter}  {word}".strip() for letter, word in zip(letters, OUTCOMES, strict=True)]
        patches = [Patch(facecolor=grey, edgecolor="0.4", linewidth=0.5, label=word) for grey, word in zip(greys, words, strict=True)]
        figure.legend(handles=patches, loc="outside upper center", ncols=4, frameon=False, fontsize=8.0)
    return figure


def cost_of_a_stiff_wall() -> str:
    """Steps of the explicit method against the stiffness of the wall, on one collar that strikes at 24 rad/s."""
    from models import TorsionalChain

    flywheel = TorsionalChain(inertia=(1e9, 1e9), stiffness=(0.0,), damping=(0.0,), collar_index=-1)
    lines = [f"{'wall':<22}{'impacts':>8}{'steps':>8}{'steps/impact':>14}{'in contact':>12}{'time per step':>15}"]
    start = {"chain.speed": (24.0, 24.0)}
    for stiffness in (1e7, 1e8, 1e9, 1e10, 1e11):
        for damping in (1e3, 0.2 * math.sqrt(stiffness * WhirlingCollar().modal_mass)):
            collar = WhirlingCollar(weight=1e5, wall_stiffness=stiffness, wall_damping=damping)
            lines.append(_cost(f"{stiffness:.0e} N/m, {damping:.0e}", simulate(compose(flywheel, collar), 2.0, start=start)))
    for restitution in (0.9, 0.5):
        collar = WhirlingCollar(weight=1e5, restitution=restitution)
        lines.append(_cost(f"restitution {restitution:g}", simulate(compose(flywheel, collar), 2.0, start=start)))
    return "\n".join(lines)


def _cost(label: str, run: Trajectory) -> str:
    impacts, steps = measure.contact(run, "wall").impacts, sum(run.steps)
    closed = np.diff(run.time)[run.modes["wall"][:-1] == "closed"]
    inside = int(np.count_nonzero(closed > 0))
    return f"{label:<22}{impacts:8d}{steps:8d}{steps / max(impacts, 1):14.1f}{inside / max(impacts, 1):12.1f}{1e6 * run.wall_time / steps:12.2f} us"


def main() -> None:
    """Print the table and write the figures."""
    if sys.argv[1:] == ["stiffness"]:
        print(cost_of_a_stiff_wall())
        return
    folder = figure_folder()
    found = outcomes()
    print(map_text(found), end="\n\n")
    named = {"stiff PI": driven(None), **{f"0.2 1/s, {way}": driven(0.2, way) for way in WAYS}}
    print(table({label: row(run) for label, run in named.items()}))
    shown = {f"0.2 1/s, {way}": (driven(0.2, way), first) for way, first in SHOWN.items()}
    with use_units("metric"):  # what drillers read: rpm
        draw(shown).savefig(folder / "whirl.png")
    draw_outcomes(found).savefig(folder / "whirl_outcomes.png")
    print(f"Figures are in {folder}")


if __name__ == "__main__":
    main()
