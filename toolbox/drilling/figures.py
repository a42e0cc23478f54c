"""Pictures of answers about a drill string: windows and gains over depth, lowest set-points, verdicts of controllers, estimates of the bit.

Every function draws into given axes or makes a figure of its own, and returns the axes; the looks are those of `toolbox.plot`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from toolbox.drilling.torque_swing import SWINGS
from toolbox.figures.style import LINES, WIDTH, drawn_on, in_words, name_axis
from toolbox.logs.flaws import local_spacing
from toolbox.robustness.figures import MARKS


def window_diagram(
    labels: Sequence[str],
    titles: Sequence[str],
    along: np.ndarray,
    smooth: np.ndarray,
    free: np.ndarray,
    at: np.ndarray,
    ends: tuple[float, float],
    axes: Any = None,
) -> Any:
    """Draw the window of every depth: free, smooth only without a disturbance, and stick-slip. The axes are returned.

    labels: of the first and the second number;  titles: of the pictures;  along: values of the second number;  smooth, free: borders of the first one, shape
    (pictures, along), -inf for the whole range and inf for nowhere;  at: working points;  ends: of the range of the first number.
    """
    with drawn_on(axes, 1, len(titles), height=2.6, sharey=True, sharex=True, squeeze=False) as axes:
        axes = np.ravel(axes)
        low, high = ends
        for ax, title, lost, ended, point in zip(axes, titles, smooth, free, at, strict=False):
            stable, calm = (np.clip(each, low, high) for each in (lost, np.maximum(lost, ended)))
            ax.fill_betweenx(along, calm, high, color="0.93", label="free")
            ax.fill_betweenx(along, stable, calm, color="0.75", label="smooth only undisturbed")
            for each, label, style in (
                (lost, "smooth running is lost", {**LINES[1], "marker": "D", "markersize": 3.5}),
                (np.maximum(lost, ended), "stick-slip ends", {**LINES[0], "marker": "o", "markersize": 4.5}),
            ):
                ax.plot(np.where(np.isfinite(each), each, np.nan), along, label=label, **style)
            if np.isfinite(point).all():
                ax.plot(*point, marker="+", color="black", markersize=8, markeredgewidth=1.4, linestyle="none", label="working point")
            ax.set(title=title, xlabel=labels[0].replace(" [", "\n["), xlim=ends)
        axes[0].set_ylabel(labels[1])
        handles, words = axes[0].get_legend_handles_labels()
        axes[0].figure.legend(handles, words, frameon=False, fontsize=8.0, ncols=3, loc="outside lower center")
    return axes


def set_point_diagram(rows: Sequence[tuple[str, str, str, float, float]], highest: float, unit: str, ax: Any = None) -> Any:
    """Lowest set-points as marks, one line per law, one kind of mark per group, filled for a direct takeover. Returns the ax.

    rows: (law, group, way, set-point or nan for none, whose marks stand at the right, highest one where a higher one fails or nan), the last joined to the mark
    by a line;  highest: set-point up to which it was searched.
    """
    laws, groups = list(dict.fromkeys(row[0] for row in rows)), list(dict.fromkeys(row[1] for row in rows))
    with drawn_on(ax, height=1.1 + 0.42 * len(laws)) as ax:
        for law, group, way, speed, until in rows:
            k = groups.index(group)
            place = laws.index(law) + 0.7 * ((k + 0.5) / len(groups) - 0.5)
            color = LINES[k % len(LINES)]["color"]
            filled: Any = {"markerfacecolor": color if way == "takeover" else "white", "markeredgecolor": color}
            if math.isnan(speed):
                speed = (1.05 if way == "takeover" else 1.08) * highest
            elif not math.isnan(until):
                ax.plot([speed, until], [place, place], marker="|", markevery=[1], color=color, linewidth=0.8)
            ax.plot(speed, place, marker=MARKS[k % len(MARKS)], markersize=5.0, linestyle="none", clip_on=False, **filled)
        if any(math.isnan(row[3]) for row in rows):
            ax.text(1.065 * highest, -0.55, "none", fontsize=8.0, ha="center", va="bottom")
        for k, group in enumerate(groups):
            ax.plot(
                [], [], marker=MARKS[k % len(MARKS)], markersize=5.0, linestyle="none", color=LINES[k % len(LINES)]["color"], label=group
            )
        ax.set_yticks(range(len(laws)), laws)
        ax.set_ylim(len(laws) - 0.5, -0.5)
        ax.set_xlim(0.0, 1.02 * highest)
        ax.set_xlabel(f"lowest set-point [{unit}]: direct takeover filled, raised set-point open")
        ax.grid(axis="x", color="0.9", linewidth=0.6)
        ax.legend(
            frameon=False,
            fontsize=8.0,
            ncols=len(groups),
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            borderaxespad=0.2,
            handletextpad=0.1,
        )
    return ax


def answer_diagram(
    rows: Sequence[tuple[str, Mapping[str, float], float]], at: float, bounds: tuple[float, ...], unit: str, ax: Any = None
) -> Any:
    """Draw the lowest set-points of controllers as marks, a line per controller and a kind of mark per start, and the end of the
    controller's own stick-slip. The axes are returned.

    rows: (controller, {start: lowest set-point or nan}, end of the own stick-slip: nan without any, inf beyond the range);  at: the set-point of the scene.
    """
    low, high = bounds
    heads = list(dict.fromkeys(head for _, lowest, _ in rows for head in lowest))
    with drawn_on(ax, height=1.5 + 0.5 * len(rows)) as ax:
        for i, (_, lowest, end) in enumerate(rows):
            for k, head in enumerate(heads):
                value = lowest.get(head, math.nan)
                place, none = i + 0.6 * ((k + 0.5) / len(heads) - 0.5), math.isnan(value)
                color = LINES[k % len(LINES)]["color"]
                face: Any = {"markerfacecolor": "white" if none else color, "markeredgecolor": color}
                ax.plot(
                    high if none else value, place, marker=MARKS[k % len(MARKS)], markersize=6.0, linestyle="none", clip_on=False, **face
                )
            if not math.isnan(end):
                ax.plot([low, min(end, high)], [i + 0.4, i + 0.4], color="0.45", linewidth=2.5, solid_capstyle="butt")
        for k, head in enumerate(heads):
            ax.plot(
                [], [], marker=MARKS[k % len(MARKS)], markersize=6.0, linestyle="none", color=LINES[k % len(LINES)]["color"], label=head
            )
        ax.plot([], [], color="0.45", linewidth=2.5, label="its own stick-slip exists")
        ax.axvline(at, color="0.2", linewidth=0.8, linestyle="--", label="set-point of the scene")
        ax.set_yticks(range(len(rows)), [label for label, _, _ in rows])
        ax.set_ylim(len(rows) - 0.4, -0.5)
        ax.set_xlim(low, high)
        ax.set_xlabel(f"lowest set-point that holds [{unit}]; an open mark at the right: none holds")
        ax.grid(axis="x", color="0.9", linewidth=0.6)
        ax.legend(frameon=False, fontsize=8.0, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
    return ax


def verdict_diagram(heads: Sequence[str], rows: Sequence[tuple[str, Sequence[tuple[int, int]]]], ax: Any = None) -> Any:
    """How many runs hold, one row per controller and one column per start. Returns the ax.

    rows: (controller, (held, runs) of each start).
    """
    with drawn_on(ax, height=1.3 + 0.42 * len(rows)) as ax:
        for i, (_, counts) in enumerate(rows):
            for k, (held, runs) in enumerate(counts):
                share = held / runs if runs else math.nan
                color = "0.85" if math.isnan(share) else LINES[2]["color"] if share == 1.0 else LINES[1]["color"]
                ax.barh(i, 0.9 * (1.0 if math.isnan(share) else share), left=k, height=0.6, color=color)
                ax.barh(i, 0.9, left=k, height=0.6, color="none", edgecolor="0.4", linewidth=0.6)
                ax.text(k + 0.45, i, f"{held} of {runs}" if runs else "-", ha="center", va="center", fontsize=8.0)
        ax.set_yticks(range(len(rows)), [label for label, _ in rows])
        ax.set_xticks([k + 0.45 for k in range(len(heads))], heads, fontsize=8.0)
        ax.xaxis.tick_top()
        ax.set_ylim(len(rows) - 0.4, -0.6)
        ax.set_xlim(-0.05, len(heads))
        ax.set_xlabel("runs that come to smooth running")
        for side in ("left", "right", "top", "bottom"):
            ax.spines[side].set_visible(False)
        ax.tick_params(length=0.0)
    return ax


def schedule_diagram(
    labels: Sequence[str],
    depths: np.ndarray,
    gains: np.ndarray,
    found: Sequence[tuple[float, bool, float, bool]],
    axes: Any = None,
    unit: str = "m",
) -> Any:
    """Draw every gain over depth, and the disk margin at the checked depths. Depths with failed runs are marked. The axes are returned.

    Parameters
    ----------
    labels: of the gains, with their units.
    depths, gains: rows of the table, shape (depths, gains).
    found: (depth, whether the table has a row there, disk margin, whether every run succeeds).
    axes: one more axes than gains; None makes a figure.
    unit: of depths.

    Returns
    -------
    The axes.
    """
    with drawn_on(axes, len(labels) + 1, 1, height=1.2 + 1.3 * (len(labels) + 1), width=0.75 * WIDTH, sharex=True) as axes:
        axes = np.ravel(axes)
        for ax, label, column in zip(axes, labels, gains.T, strict=False):
            ax.plot(depths, column, marker="o", markersize=4.5, **LINES[0])
            ax.set_ylabel(label.replace(" [", "\n["))
        last = axes[-1]
        depth, margin = np.array([each[0] for each in found]), np.array([each[2] for each in found])
        rows, good = np.array([each[1] for each in found]), np.array([each[3] for each in found])
        last.plot(depth, margin, **{**LINES[0], "linewidth": 0.8})
        for where, fill, label in ((rows, LINES[0]["color"], "designed"), (~rows, "white", "interpolated")):
            last.plot(
                depth[where], margin[where], marker="o", markersize=4.5, color=LINES[0]["color"], markerfacecolor=fill, linestyle="none", clip_on=False,
                label=label,
            )  # fmt: skip
        if not good.all():
            bad = np.where(np.isfinite(margin[~good]), margin[~good], 0.0)
            last.plot(depth[~good], bad, marker="X", markersize=8.0, color=LINES[1]["color"], linestyle="none", label="runs fail")
        last.set(xlabel=f"depth [{unit}]", ylabel="disk margin\n[1]")
        last.set_ylim(bottom=0.0)
        last.legend(frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
    return axes


def estimate_diagram(found: Any, axes: Any = None) -> Any:
    """What is known over time, mean and band of 95 %, one panel each, without a line over a gap of the log; times of stick-slip are shaded."""
    known = [name for name, values in found.mean.items() if np.isfinite(values).any()]
    panels = [*known, *(["torque swing"] if np.isfinite(found.torque_swing).any() else [])] or ["nothing"]
    gaps = np.insert(np.diff(found.time) > local_spacing(found.time)[1], 0, False)
    with drawn_on(axes, len(panels), 1, height=1.4 * len(panels) + 0.6, sharex=True, squeeze=False) as axes:
        for ax, name in zip(np.ravel(axes), panels, strict=True):
            for begin, end in found.spells:
                ax.axvspan(begin, end, color="0.9", zorder=0)
            if name == "nothing":
                ax.set(xlim=found.time[[0, -1]], yticks=[])
                ax.text(0.5, 0.5, "too slow to see stick-slip", transform=ax.transAxes, ha="center", va="center")
                continue
            if name == "torque swing":
                ax.plot(found.time, np.where(gaps, np.nan, found.torque_swing), color=LINES[0]["color"], linewidth=0.9)
                ax.axhline(SWINGS, color="0.5", linewidth=0.8, linestyle="--")
                ax.set_ylabel("torque swing\nover mean")
                continue
            mean, wide = np.where(gaps, np.nan, found.mean[name]), 1.96 * found.deviation[name]
            ax.fill_between(found.time, mean - wide, mean + wide, color=LINES[0]["color"], alpha=0.25, linewidth=0)
            ax.plot(found.time, mean, color=LINES[0]["color"], linewidth=0.9)
            name_axis(
                ax.yaxis,
                "margin to loss\nof smooth running" if name == "onset_margin" else in_words(name),
                found.units[name],
                found.display_units,
            )
        np.ravel(axes)[-1].set_xlabel("time [s]")
        np.ravel(axes)[0].figure.legend(
            handles=[
                plt.Rectangle((0, 0), 1, 1, color=LINES[0]["color"], alpha=0.25, label="95 % band"),
                plt.Rectangle((0, 0), 1, 1, color="0.9", label="stick-slip"),
            ],
            loc="outside lower center",
            ncols=2,
            frameon=False,
        )
    return axes
