"""Which gain of a sliding mode ends stick-slip without driving the collar against the borehole wall?

Theory. The bit of a published string (160 kN, 88 rpm) sticks and slips under a stiff drive. A sliding mode ends that in a range of its weight lam of the speed
difference. But breaking the bit free it lets the bit run ahead, the faster the larger lam. Steady synchronous whirl reaches the wall at
sqrt(k_l/m gap/(gap + e)), here 20.2 rad/s; beyond it the collar strikes, friction turns its whirl backward, and rolling along the wall then lasts down to
a much lower speed, here 7.4 rad/s (`WhirlingCollar.contact_speed`, `rolling_speed`). So the bit may turn evenly and the collar suffer: a gain has to
be judged by both.

Answer (the table): 0.1 and 0.2 1/s are good for both. From 0.4 1/s the bit turns as evenly as before, but the collar strikes the wall tens or hundreds of
times; from about 1 1/s stick-slip is back. How many impacts there are depends on every digit, that there are many does not. At 165 kN and 0.4 1/s
the bit turns evenly while the collar rolls backward along the wall for ever.

    python -m studies whirl [FOLDER]         table, studies/figures/whirl.png and whirl_gain.png
    python -m studies whirl stiffness        what a stiff wall costs the explicit method
"""

from __future__ import annotations

import dataclasses
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np

from controllers import SlidingMode, StiffPI
from models import BitRock, Exponential, WhirlingCollar, wells, whirl_ratio
from toolbox import HybridSystem, compose, measure, plot, simulate
from toolbox.simulation.trajectory import Trajectory

WEIGHT, REFERENCE = 160_000.0, 88 * math.pi / 30  # [N], [rad/s]
DURATION, SETTLED = 120.0, 80.0  # [s]
GAINS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.3, 1.6)  # [1/s]
ROCK = BitRock(weight=WEIGHT, radius=0.0239, friction=Exponential(static=2.5, kinetic=1.1, decay=0.4))
SLIDING = ROCK.radius * WEIGHT * ROCK.friction.kinetic
"""Torque on bit at high speed [N m]."""
FIGURES = Path(__file__).parents[1] / "figures"


def rig(weight: float = WEIGHT) -> HybridSystem:
    """The string with its collar under a weight on bit [N]."""
    return compose(dataclasses.replace(wells.UFRJ_2, collar=-1), dataclasses.replace(ROCK, weight=weight), WhirlingCollar())


def driven(gain: float | None, weight: float = WEIGHT) -> Trajectory:
    """A run from rest under a sliding mode of that gain [1/s], or under the stiff drive."""
    law = StiffPI(reference=REFERENCE) if gain is None else SlidingMode(reference=REFERENCE, surface=gain, reaching=1.0)
    return simulate(rig(weight), DURATION, controller=law)


def row(run: Trajectory) -> dict[str, float]:
    """Severity and sticking of the bit after the transient; impacts, time and largest force of the wall, and the whirl at the end."""
    wall = measure.contact(run, "wall")
    return {
        "severity": measure.severity(run, after=SETTLED),
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
        f"{'drive':<24}{'severity':>9}{'stuck':>9}{'peak':>12}{'impacts':>9}{'contact':>10}{'force':>9}{'late contact':>14}{'whirl':>8}",
    ]
    for label, r in rows.items():
        lines.append(
            f"{label:<24}{r['severity']:9.2f}{r['stuck']:7.1f} s{r['peak']:6.1f} rad/s{r['impacts']:9.0f}{r['contact']:8.2f} s{r['force'] / 1e3:6.0f} kN"
            f"{r['late contact']:12.2f} s{r['whirl']:8.2f}"
        )
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
    ax.plot(np.where(closed, y, np.nan), np.where(closed, z, np.nan), color="black", linewidth=2.2)
    ax.set(xlabel="y [mm]", ylabel="z [mm]", xlim=(-1.13 * gap, 1.13 * gap), ylim=(-1.13 * gap, 1.13 * gap), aspect="equal")


def draw(runs: dict[str, tuple[Trajectory, float]]) -> Any:
    """Speeds and radius of each run, and two seconds of its orbit from the given time on, one column each; returns a matplotlib figure."""
    import matplotlib.pyplot as plt

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
            speed.plot(times, samples["top.speed"], label="top drive", **plot.LINES[1])
            speed.plot(times, samples["bit.speed"], label="bit", **plot.LINES[0])
            speed.set(xlim=(0.0, end), ylim=(-0.5, 27.0))
            speed.set_title(label, loc="left", fontsize=9.0)
            speed.tick_params(labelbottom=False)
            radius.axvspan(first, first + 2.0, facecolor="0.75", zorder=0)
            radius.plot(times, 1e3 * samples["collar.radius"], **{**plot.LINES[0], "linewidth": 0.5})
            radius.axhline(1e3 * collar.gap, **dashed)
            radius.set(xlim=(0.0, end), ylim=(0.0, 26.0), xlabel="time [s]")
            orbit(run, plane, first, first + 2.0)
            plane.set_title(f"orbit from {first:g} s to {first + 2:g} s", loc="left", fontsize=9.0)
        axes[0, 0].set_ylabel("speed [rad/s]")
        axes[1, 0].set_ylabel("radius of centre [mm]")
        axes[0, 1].text(end, collar.contact_speed(WEIGHT, SLIDING) - 0.5, "whirl would reach the wall", ha="right", va="top", fontsize=7.5)
        axes[0, -1].legend(frameon=False, ncols=2, loc="upper right", fontsize=7.5, borderaxespad=0.0)
    return figure


def draw_gains(rows: dict[float, dict[str, float]], stiff: dict[str, float]) -> Any:
    """Severity of stick-slip and impacts on the wall against the gain; returns a matplotlib figure."""
    import matplotlib.pyplot as plt

    gains = list(rows)
    with plt.rc_context(plot.PAPER):
        figure, axes = plt.subplots(3, 1, figsize=(5.2, 5.2), layout="constrained", sharex=True)
        words = {"severity": "severity [1]", "impacts": "wall impacts [1]", "contact": "wall contact [s]"}
        for ax, (key, label) in zip(axes, words.items(), strict=True):
            ax.plot(gains, [rows[g][key] for g in gains], marker="o", markersize=4, **plot.LINES[0])
            ax.axhline(stiff[key], label="stiff drive", **plot.LINES[2])
            ax.set_ylabel(label)
            ax.axvspan(0.1, 0.2, facecolor=plot.BAND, zorder=0)
        axes[1].set_yscale("symlog", linthresh=1.0)
        axes[1].set_ylim(-0.2, 4e3)
        axes[0].legend(frameon=False, loc="center left", bbox_to_anchor=(0.0, 0.8))
        axes[0].text(0.141, 0.45, "good\nfor both", ha="center", fontsize=7.5)
        axes[-1].set(xscale="log", xlabel="gain of the sliding mode, weight lam of the surface [1/s]")
        axes[-1].set_xticks([0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 1.6], ["0.02", "0.05", "0.1", "0.2", "0.5", "1", "1.6"], minor=False)
        axes[-1].set_xticks([], minor=True)
    return figure


def cost_of_a_stiff_wall() -> str:
    """Steps of the explicit method against the stiffness of the wall, on one collar that strikes at 24 rad/s."""
    from models import TorsionalChain

    flywheel = TorsionalChain(inertia=(1e9, 1e9), stiffness=(0.0,), damping=(0.0,), collar=-1)
    lines = [f"{'wall':<22}{'impacts':>8}{'steps':>8}{'steps/impact':>14}{'in contact':>12}{'time per step':>15}"]
    start = {"chain.speed": (24.0, 24.0)}
    for stiffness in (1e7, 1e8, 1e9, 1e10, 1e11):
        for damping in (1e3, 0.2 * math.sqrt(stiffness * WhirlingCollar().mass)):
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
    import matplotlib

    if sys.argv[1:] == ["stiffness"]:
        print(cost_of_a_stiff_wall())
        return
    matplotlib.use("Agg")
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FIGURES
    folder.mkdir(parents=True, exist_ok=True)
    stiff = driven(None)
    runs = {gain: driven(gain) for gain in GAINS}
    rows = {gain: row(run) for gain, run in runs.items()}
    heavy = driven(0.4, 165_000.0)
    named = {"stiff PI": row(stiff)} | {f"gain {gain:g} 1/s": r for gain, r in rows.items()} | {"gain 0.4 1/s, 165 kN": row(heavy)}
    print(table(named))
    shown = {"stiff PI": (stiff, 45.0), "sliding mode, 0.2 1/s": (runs[0.2], 8.0), "sliding mode, 0.6 1/s": (runs[0.6], 8.3)}
    draw(shown).savefig(folder / "whirl.png")
    draw_gains(rows, named["stiff PI"]).savefig(folder / "whirl_gain.png")
    print(f"Figures are in {folder}")


if __name__ == "__main__":
    main()
