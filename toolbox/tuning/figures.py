"""The picture of a tuning: its front, or the best so far over the number of trials."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from toolbox.figures.style import LINES, WIDTH, drawn_on


def tuning_diagram(
    names: Sequence[str], tried: np.ndarray, front: np.ndarray, given: np.ndarray, best: np.ndarray | None, ax: Any = None
) -> Any:
    """The first two objectives of every trial, with the Pareto front, the given law and the tuned one; of one objective the best so far over the trials.

    Parameters
    ----------
    names: of the objectives, with their units.
    tried: objectives of every trial in order, shape (trials, objectives); what is not finite is left out.
    front: objectives of the trials on the front, shape (k, objectives).
    given, best: objectives of the law as given and of the tuned one, shape (objectives,); None where no trial succeeded.
    ax: axes to draw into; None makes a figure.

    Returns
    -------
    The axes.
    """
    with drawn_on(ax, height=3.4, width=0.75 * WIDTH) as ax:
        values = np.where(np.isfinite(tried), tried, np.nan)
        if len(names) == 1:
            count = np.arange(1, len(values) + 1)
            ax.plot(count, values[:, 0], marker=".", markersize=3.5, color="0.7", linestyle="none", label="tried")
            ax.step(count, np.fmin.accumulate(values[:, 0]), where="post", label="best so far", **LINES[0])
            failed = count[np.isnan(values[:, 0])]
            if failed.size:
                ax.plot(
                    failed,
                    np.full(failed.size, 0.97),
                    "x",
                    transform=ax.get_xaxis_transform(),
                    markersize=3.5,
                    color="0.45",
                    label="no success",
                )
            ax.set_xlabel("points tried")
            ax.set_ylabel(names[0])
            ax.set_xlim(0, len(values) + 1)
        else:
            lost = int(np.isnan(values).any(axis=1).sum())
            told = f"tried; {lost} more without success" if lost else "tried"
            ax.plot(values[:, 0], values[:, 1], marker=".", markersize=3.5, color="0.7", linestyle="none", label=told, zorder=1)
            if len(names) == 2:
                ax.step(front[:, 0], front[:, 1], where="post", zorder=2, **LINES[0])
            ax.plot(
                front[:, 0], front[:, 1], marker="o", markersize=4.0, color=LINES[0]["color"], linestyle="none", label="front", zorder=3
            )
            if np.isfinite(given).all():
                ax.plot(
                    *given[:2],
                    marker="s",
                    markersize=6.5,
                    markerfacecolor="white",
                    color=LINES[1]["color"],
                    linestyle="none",
                    label="as given",
                    zorder=4,
                )
            if best is not None:
                ax.plot(
                    *best[:2], marker="*", markersize=11, markerfacecolor="white", color="black", linestyle="none", label="tuned", zorder=5
                )
                # what is tried far from the front says little about it
                seen = np.vstack([front, [given] if np.isfinite(given).all() else front[:1]])[:, :2]
                low, high = seen.min(axis=0), seen.max(axis=0)
                room = np.where(high > low, 0.15 * (high - low), 0.1 * np.maximum(np.abs(high), 1e-3))
                ax.set_xlim(low[0] - room[0], high[0] + room[0])
                ax.set_ylim(low[1] - room[1], high[1] + room[1])
            ax.set_xlabel(names[0])
            ax.set_ylabel(names[1])
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False, borderaxespad=0.2)
    return ax
