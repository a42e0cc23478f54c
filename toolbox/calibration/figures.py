"""The picture of a fit: what was measured, what the fitted plant does, and the residuals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from toolbox.calibration.residuals import MeasuredLoop, Simulated
from toolbox.figures.style import LINES, PAPER, WIDTH, in_words, name_axis

COLUMNS = 2
"""Signals side by side."""


def fitted(misfit: MeasuredLoop | Simulated, values: np.ndarray, asked: Mapping[str, str]) -> Any:
    """Measured against model: one panel per signal, or the loop of friction over slip, and below each the residuals.

    Parameters
    ----------
    misfit: what was measured, and the model that was fitted to it.
    values: the fitted numbers, shape (numbers,).
    asked: {unit: unit that was typed}, of the axes.

    Returns
    -------
    The axes, shape (2, signals): above each other signal and residual, two signals side by side.
    """
    model = misfit.model(values)
    dots = {"marker": ".", "linestyle": "none", "color": "0.6", "markersize": 2.5, "rasterized": True}
    with plt.rc_context(PAPER):
        count = len(misfit.outputs)
        rows, columns = -(-count // COLUMNS), min(count, COLUMNS)
        figure, grid = plt.subplots(2 * rows, columns, squeeze=False, sharex="col", figsize=(WIDTH, 0.4 + 3.4 * rows), height_ratios=(2.2, 1.0) * rows,
                                    layout="constrained")  # fmt: skip
        axes = np.stack([grid[::2].ravel(), grid[1::2].ravel()])
        for ax in axes[:, count:].ravel():
            ax.set_axis_off()
        axes = axes[:, :count]
        for (top, bottom), name in zip(axes.T, misfit.outputs, strict=True):
            unit = misfit.plant.unit(name)
            time, measured = misfit.time[name], misfit.measured[name]
            if isinstance(misfit, MeasuredLoop):
                element = misfit.plant.elements[misfit.place]
                x, slides = misfit.slip[misfit.rows], ~misfit.released
                resting = np.setdiff1d(np.arange(misfit.slip.size), misfit.rows)
                top.plot(
                    misfit.slip[resting], misfit.recording.signals[name][resting], **{**dots, "color": "0.85"}, label="measured, at rest"
                )
                top.plot(x[slides], measured[slides], **dots, label="measured, slipping")
                top.plot(
                    x[slides],
                    model[name][slides],
                    **{**dots, "color": LINES[0]["color"], "markersize": 1.8},
                    label="law, at the measured load",
                )
                if misfit.released.any():
                    top.plot(
                        x[misfit.released],
                        measured[misfit.released],
                        marker="^",
                        linestyle="none",
                        color=LINES[1]["color"],
                        label="break-away",
                    )
                bottom.set_xlabel(f"slip of {element.name} [{element.slip_unit}]")
            else:
                x = time
                top.plot(x, measured, **dots, label="measured")
                top.plot(x, model[name], label="model", **{**LINES[0], "linewidth": 1.1})
                bottom.set_xlabel("time [s]")
            bottom.plot(x, measured - model[name], **dots)
            bottom.axhline(0.0, color="0.2", linewidth=0.7)
            name_axis(top.yaxis, in_words(name), unit, asked)
            name_axis(bottom.yaxis, "residual", unit, asked)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, frameon=False, markerscale=3.0, loc="outside lower center", ncols=len(labels))
        figure.align_ylabels(axes)
    return axes
