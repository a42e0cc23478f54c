"""The picture of a fit: what was measured, what the fitted plant does, and the residuals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from toolbox.calibration.panels import TIME, Panel
from toolbox.figures.style import BAND, LINES, PAPER, WIDTH, in_words, name_axis

COLUMNS = 2
"""Signals side by side."""


def fitted(panels: Sequence[Panel], display_units: Mapping[str, str]) -> Any:
    """Measured against model: one panel per signal, or the loop of friction over slip, and below each the residuals.

    Parameters
    ----------
    panels: what was measured, and what the fitted model makes of it.
    asked: {unit: unit that was typed}, of the axes.

    Returns
    -------
    The axes, shape (2, signals): above each other signal and residual, two signals side by side.
    """
    dots = {"marker": ".", "linestyle": "none", "color": "0.6", "markersize": 2.5, "rasterized": True}
    with plt.rc_context(PAPER):
        count = len(panels)
        rows, columns = -(-count // COLUMNS), min(count, COLUMNS)
        figure, grid = plt.subplots(2 * rows, columns, squeeze=False, figsize=(WIDTH, 0.4 + 3.4 * rows), height_ratios=(2.2, 1.0) * rows,
                                    layout="constrained")  # fmt: skip
        axes = np.stack([grid[::2].ravel(), grid[1::2].ravel()])
        for ax in axes[:, count:].ravel():
            ax.set_axis_off()
        axes = axes[:, :count]
        for (top, bottom), panel in zip(axes.T, panels, strict=True):
            bottom.sharex(top)  # and with no other panel, because recordings last differently long
            top.tick_params(labelbottom=False)
            x, measured, model, released = panel.x, panel.measured, panel.model, panel.released
            if panel.over != TIME:
                fine = {**dots, "color": LINES[0]["color"], "markersize": 1.8}
                top.plot(*panel.resting, **{**dots, "color": "0.85"}, label="measured, at rest")
                top.plot(x[~released], measured[~released], **dots, label="measured, slipping")
                top.plot(x[~released], model[~released], **fine, label="law, at the measured load")
                if released.any():
                    top.plot(x[released], measured[released], marker="^", linestyle="none", color=LINES[1]["color"], label="break-away")
            else:
                for k, (begin, end) in enumerate(panel.sticks):
                    for ax in (top, bottom):
                        ax.axvspan(
                            begin, end, facecolor=BAND, linewidth=0, zorder=0, label="the model sticks" if ax is top and k == 0 else None
                        )
                top.plot(x, measured, **dots, label="measured")
                top.plot(x, model, label="model", **{**LINES[0], "linewidth": 1.1})
                top.set_xlim(x[0], x[-1])
            bottom.set_xlabel(panel.over)
            bottom.plot(x, measured - model, **dots)
            bottom.axhline(0.0, color="0.2", linewidth=0.7)
            name_axis(top.yaxis, in_words(panel.name), panel.unit, display_units)
            name_axis(bottom.yaxis, "residual", panel.unit, display_units)
        named = {label: handle for ax in axes[0] for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
        handles, labels = list(named.values()), list(named)
        figure.legend(handles, labels, frameon=False, markerscale=3.0, loc="outside lower center", ncols=len(labels))
        figure.align_ylabels(axes)
    return axes


def friction_curve(found: Any) -> Any:
    """Friction against speed: points of the data, the law, and its interval; returns the axes.

    Parameters
    ----------
    found: an `Identification`.
    """
    speed_unit, force_unit = found.curve_units
    with plt.rc_context(PAPER):
        _, ax = plt.subplots(figsize=(WIDTH, 0.62 * WIDTH), layout="constrained")
        v, middle, low, high = found.curve
        for k, side in enumerate((v < 0.0, v > 0.0)):
            ax.fill_between(v[side], low[side], high[side], color=BAND, linewidth=0, zorder=0,
                            label=None if k or not side.any() else f"interval of {100 * found.confidence:g} %")  # fmt: skip
            ax.plot(v[side], middle[side], **LINES[0], label="law" if k else None)
        ax.plot(*found.points, marker="o", linestyle="none", color="0.45", markersize=2.5, label="data")
        ax.axhline(0.0, color="0.6", linewidth=0.6)
        name_axis(ax.xaxis, "speed", speed_unit, found.display_units)
        name_axis(ax.yaxis, "friction", force_unit, found.display_units)
        ax.legend(frameon=False)
    return ax


def recorded(recording: Any) -> Any:
    """Every channel of a recording over time, with the samples that were left out; returns the axes.

    Parameters
    ----------
    recording: a `Recording`.
    """
    with plt.rc_context(PAPER):
        count = len(recording.signals)
        _, axes = plt.subplots(count, 1, sharex=True, squeeze=False, figsize=(WIDTH, 0.6 + 1.3 * count), layout="constrained")
        apart = np.append(recording.gaps, False)
        for ax, (name, values) in zip(axes[:, 0], recording.signals.items(), strict=True):
            shown = np.where(apart, np.nan, values)  # no line over a gap
            ax.plot(recording.time, shown, **{**LINES[0], "linewidth": 0.9})
            low, high = np.nanmin(values), np.nanmax(values)
            margin = 0.2 * ((high - low) or 1.0)
            for flaw in recording.flaws:
                if flaw.channel == name:
                    at = np.clip(np.nan_to_num(flaw.values, nan=low - margin), low - margin, high + margin)
                    ax.plot(flaw.times, at, "x", color=LINES[1]["color"], markersize=3.5, label="left out")
            name_axis(ax.yaxis, in_words(name), recording.units.get(name, "1"), {})
            for flaw in recording.flaws:
                if flaw.kind == "gap" and flaw.channel == "time":
                    for begin, lasting in zip(flaw.times, flaw.values, strict=True):
                        ax.axvspan(begin, begin + lasting, color="0.88", linewidth=0)
        axes[-1, 0].set_xlabel(TIME)
    return axes[:, 0]
