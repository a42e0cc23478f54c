"""The picture of error against time."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Sequence
from typing import Any

from toolbox.figures.style import BAND, drawn_on

TRADE: Sequence[tuple[str, str, str, str]] = (
    ("#12355b", "o", "-", "full"),
    ("#6b6b6b", "s", "-", "full"),
    ("#e07a1f", "^", "--", "full"),
    ("#4f9d8f", "D", "--", "none"),
    ("black", "x", ":", "full"),
    ("#a23b72", "v", ":", "none"),
    ("0.45", "P", "-.", "full"),
    ("black", "*", "-.", "none"),
    ("#a23b72", "<", "-", "full"),
)
"""Colour, mark, line and filling of the curves of a trade."""


def work_precision(trade: Any, ax: Any = None) -> Any:
    """Seconds against error of a `toolbox.work_precision.WorkPrecision` on logarithmic axes; errors in the grey band are below what is known."""
    with drawn_on(ax, height=4.0, width=5.6) as ax:
        curves: dict[str, list[Any]] = {}
        several = len({point.plant for point in trade.points}) > 1
        for point in trade.points:
            if not point.failed:
                curves.setdefault(f"{point.method}, {point.plant}" if several else point.method, []).append(point)
        known = max(2.0 * trade.reference_error, 1e-16)
        for (label, points), (colour, mark, line, fill) in zip(curves.items(), itertools.cycle(TRADE), strict=False):
            good = [point for point in points if known < point.error < 1.0]
            style = {"color": colour, "marker": mark, "linestyle": line, "fillstyle": fill, "markersize": 4.5, "linewidth": 1.1}
            ax.loglog([point.error for point in good], [1e3 * point.seconds for point in good], label=label, **style)
        ax.set(xlabel="error of the states, in parts of their size", ylabel="time [ms]")
        low, high = ax.get_xlim()
        low = min(low, known / 3.0)
        ax.axvspan(low, known, color=BAND, lw=0, label="below what is known")
        ax.set_xlim(high, low)  # better to the right
        ax.legend(frameon=False)
        ax.set_title(textwrap.fill(trade.title, 80), loc="left", fontsize=9)
    return ax
