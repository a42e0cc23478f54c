"""Pictures of margins and of worst cases: Nyquist curve and disk, sensitivities over frequency, outcomes by model error.

Every function draws into given axes or makes a figure of its own, and returns the axes; the looks are those of `toolbox.plot`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from toolbox.figures.style import LINES, drawn_on
from toolbox.robustness.disk_margins import LoopMargins, frequencies
from toolbox.steady_states.linear_loop import LinearLoop

MARKS = ("o", "D", "^", "s", "v", "P", "X", "*")


def margins_diagram(loop: LinearLoop, rows: Sequence[LoopMargins], axes: Any = None) -> Any:
    """The loop of every command in the complex plane and its sensitivities |S| and |S - T| / 2. Returns both axes.

    The disk around the critical point -1 is what the disk margin keeps free: a factor f of the command moves -1 to -1 / f, and the disk holds these
    points for every f that the margin allows. rows: the margins of every command of the loop.
    """
    with drawn_on(axes, 1, 2, height=3.2) as axes:
        nyquist, bode = axes
        reach = 2.5
        for i, row in enumerate(rows):
            alone = loop.alone(i)
            w = frequencies(alone)
            gain = alone.transfer(w)[:, 0, 0]
            style = LINES[i % len(LINES)]
            nyquist.plot(gain.real, gain.imag, label=row.command.replace("_", " "), **style)
            nyquist.plot(gain.real, -gain.imag, **{**style, "linewidth": 0.5})
            if 0.0 < row.disk_margin < 2.0:
                low, high = row.disk_gains
                reach = max(reach, min(1.3 * high, 8.0))
                nyquist.add_patch(
                    plt.Circle(
                        (-(low + high) / 2, 0.0), (high - low) / 2, facecolor="0.88", edgecolor=style["color"], linewidth=0.8, zorder=0
                    )
                )
            with np.errstate(divide="ignore"):
                s = 1.0 / np.abs(1.0 + gain)
                disk = np.abs((1.0 - gain) / (1.0 + gain)) / 2.0
            last = " of " + row.command if len(rows) > 1 else ""
            bode.loglog(w, s, label=f"$|S|${last}", **style)
            bode.loglog(w, disk, label=f"$|S - T| / 2${last}", **{**style, "linestyle": (0, (1.2, 1.2))})
            if math.isfinite(row.disk_frequency) and row.disk_margin > 0.0:
                bode.plot([row.disk_frequency], [1.0 / row.disk_margin], marker="o", markersize=4.5, color=style["color"], linestyle="none")
                label = rf"$1 / \alpha$, $\alpha$ = {row.disk_margin:.3g}"
                bode.annotate(label, (row.disk_frequency, 1.0 / row.disk_margin), xytext=(6, 3), textcoords="offset points", fontsize=8.0)
        nyquist.plot([-1.0], [0.0], marker="+", color="black", markersize=8, markeredgewidth=1.2, linestyle="none", zorder=4)
        nyquist.axhline(0.0, color="0.7", linewidth=0.5, zorder=0)
        nyquist.axvline(0.0, color="0.7", linewidth=0.5, zorder=0)
        nyquist.set(
            xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="real part of $L$ [1]", ylabel="imaginary part of $L$ [1]"
        )
        nyquist.legend(frameon=False, loc="upper right")
        bode.axhline(1.0, color="0.7", linewidth=0.5, zorder=0)
        top = max((max(row.peak_sensitivity, 1.0 / row.disk_margin) for row in rows if row.disk_margin > 0.0), default=2.0)
        bode.set(ylim=(0.02, 2.5 * max(top, 1.0)), xlabel="frequency [rad/s]", ylabel="gain [1]")
        bode.legend(frameon=False, loc="lower right")
    return axes


def worst_case_diagram(rows: Sequence[tuple[str, float, float, bool]], axes: Any = None) -> Any:
    """Part of the time stuck and ripple of the command of every run, by model error. Returns both axes.

    rows: (error, stuck, ripple, whether it is a success) of every run; those that could not be finished have nan and are counted beside the error.
    """
    errors = list(dict.fromkeys(error for error, *_ in rows))
    with drawn_on(axes, 1, 2, height=0.9 + 0.24 * len(errors), sharey=True) as axes:
        place, good = np.array([errors.index(row[0]) for row in rows]), np.array([row[3] for row in rows])
        panels = (([row[1] for row in rows], "time stuck [%]"), ([row[2] for row in rows], "ripple of the command [%]"))
        for ax, (values, label) in zip(axes, panels, strict=True):
            x = 100.0 * np.array(values)
            ax.plot(x[good], place[good], marker="o", color=LINES[0]["color"], linestyle="none", markersize=4.5, label="succeeds")
            ax.plot(x[~good], place[~good], marker="X", color=LINES[1]["color"], linestyle="none", markersize=4.5, label="fails")
            ax.set_xlabel(label)
            ax.set_xlim(-0.03 * max(10.0, np.nanmax(x, initial=0.0)), 1.05 * max(10.0, np.nanmax(x, initial=0.0)))
            ax.grid(axis="y", color="0.9", linewidth=0.6)
        broken = [sum(math.isnan(row[1]) for row in rows if row[0] == error) for error in errors]
        names = [error + (f" ({count} not finished)" if count else "") for error, count in zip(errors, broken, strict=True)]
        axes[0].set_yticks(range(len(errors)), [name.replace(", ", ",\n") for name in names])
        axes[0].invert_yaxis()
        axes[1].legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
    return axes


def error_diagram(numbers: Sequence[str], found: Mapping[str, Sequence[float]], sizes: Mapping[str, float], ax: Any = None) -> Any:
    """Errors in parts of the range of each number: one line per number, a mark per kind of error, shaded what is safe. Returns the ax.

    found: {label: error in parts of the ranges, empty for none};  sizes: {label: size up to which an error is harmless, nan for unknown}.
    """
    with drawn_on(ax, height=1.3 + 0.34 * len(numbers)) as ax:
        for k, (label, size) in enumerate(sizes.items()):
            if size > 0.0:
                ax.axvspan(-min(size, 1.0), min(size, 1.0), color=("0.93", "0.82")[k % 2], zorder=0, label=label)
        for k, (label, error) in enumerate(found.items()):
            if len(error):
                color = LINES[k % len(LINES)]["color"]
                filled = color if k == 0 else "none"
                ax.plot(
                    list(error), range(len(numbers)), MARKS[k], color=color, markerfacecolor=filled, markersize=6.0 + 3.0 * k, linestyle="none", label=label
                )  # fmt: skip
        ax.axvline(0.0, color="0.4", linewidth=0.6, zorder=1)
        ax.set_yticks(range(len(numbers)), numbers)
        ax.set_ylim(len(numbers) - 0.5, -0.5)
        ax.set_xlim(-1.05, 1.05)
        ax.set_xlabel("error in parts of the range of each number [1]")
        ax.grid(axis="y", color="0.9", linewidth=0.6)
        ax.legend(frameon=False, fontsize=8.0, ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2, handletextpad=0.3)
    return ax
