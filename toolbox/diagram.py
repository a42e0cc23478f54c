"""Pictures of analyses: severity over a parameter on both branches, Hopf curves, poles, what a drive reflects, a model fitted to data.

Every function draws into `ax` or makes a figure of its own, and returns the axes; the looks are those of `toolbox.plot`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np

from toolbox.errors import SceneError
from toolbox.plot import LINES, PAPER, WIDTH, _words

if TYPE_CHECKING:
    from toolbox.fit import Fit
    from toolbox.onset import Onset


def onset_diagram(found: Onset, ax: Any = None) -> Any:
    """Severity over the parameter: from smooth running and from inside stick-slip, the Hopf points, both borders, the bistable band, the working point."""
    with plt.rc_context(PAPER):
        if ax is None:
            _, ax = plt.subplots(figsize=(WIDTH, 3.0), layout="constrained")
        unit = "" if found.unit == "1" else f" [{found.unit}]"
        for low, high in found.bistable:
            ax.axvspan(low, high, color="0.90", linewidth=0, zorder=0, label="bistable")
        for point in found.hopf:
            ax.axvline(point.value, color="0.2", linewidth=1.0, linestyle=(0, (4, 2)), label="Hopf point", zorder=1)
        for border in found.ends:
            ax.axvline(border.value, color=LINES[1]["color"], linewidth=1.0, linestyle=(0, (1.2, 1.2)), label="stick-slip ends", zorder=1)
        if found.values[0] <= found.at <= found.values[-1]:
            ax.plot([found.at], [0.0], marker="^", color="black", markersize=7, linestyle="none", clip_on=False, zorder=4, label="working point",
                    transform=ax.get_xaxis_transform())  # fmt: skip
        branches = ((found.sticking, LINES[1], "s", "from stick-slip"), (found.smooth, LINES[0], "o", "from smooth running"))
        for branch, style, marker, label in branches:
            # a line across a border would show severities that nothing has
            x, y = [float(found.values[0])], [branch[0].severity]
            for value, before, after in zip(found.values[1:], branch, branch[1:], strict=False):
                jump = before.verdict != after.verdict
                x += [np.nan, float(value)] if jump else [float(value)]
                y += [np.nan, after.severity] if jump else [after.severity]
            look = {"marker": marker, "markersize": 4.0 if marker == "o" else 6.0}
            ax.plot(x, y, label=label, markerfacecolor="white" if marker == "s" else style["color"], zorder=3, **look, **style)
        ax.set_xlabel(_words(found.parameter) + unit)
        ax.set_ylabel(f"severity of {_words(found.signal)} [1]")
        ax.set_xlim(found.values[0], found.values[-1])
        ax.set_ylim(bottom=0.0)
        handles, labels = ax.get_legend_handles_labels()
        once = dict(zip(labels, handles, strict=True))
        ax.legend(once.values(), once.keys(), loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False, borderaxespad=0.2)
    return ax


def onset_panels(onsets: Mapping[str, Onset]) -> Any:
    """One onset diagram per controller, on common axes. Returns the axes; raises SceneError for none."""
    if not onsets:
        raise SceneError("Argument `onsets` must hold at least one onset, but it is empty.")
    with plt.rc_context(PAPER):
        _, axes = plt.subplots(
            len(onsets), 1, sharex=True, sharey=True, squeeze=False, figsize=(WIDTH, 0.9 + 1.7 * len(onsets)), layout="constrained"
        )
        panels = axes[:, 0]
        for i, (ax, (label, found)) in enumerate(zip(panels, onsets.items(), strict=True)):
            onset_diagram(found, ax=ax)
            legend = ax.get_legend()
            if i:
                legend.remove()
            ax.text(0.99, 0.94, label, transform=ax.transAxes, ha="right", va="top", fontsize=9.0)
            ax.set_ylabel("severity [1]")
            if i < len(onsets) - 1:
                ax.set_xlabel("")
    return panels


def locus_diagram(poles: np.ndarray, values: Sequence[float], ax: Any = None) -> Any:
    """Poles of `pole_locus` in the complex plane: the upper half, the first value a ring, the last a dot; left of the axis is stable."""
    with plt.rc_context(PAPER):
        if ax is None:
            _, ax = plt.subplots(figsize=(0.6 * WIDTH, 3.2), layout="constrained")
        poles = np.asarray(poles)
        for j in range(poles.shape[1]):
            column = np.where(poles[:, j].imag >= -1e-12, poles[:, j], np.nan)
            ax.plot(column.real, column.imag, **LINES[0])
            ax.plot(column.real[:1], column.imag[:1], marker="o", markerfacecolor="white", color=LINES[0]["color"], linestyle="none")
            ax.plot(column.real[-1:], column.imag[-1:], marker="o", color=LINES[0]["color"], linestyle="none")
        ax.axvline(0.0, color="0.2", linewidth=0.8)
        ax.set_xlabel("real part [1/s]")
        ax.set_ylabel("imaginary part [rad/s]")
        ax.set_title(f"poles from {values[0]:g} (ring) to {values[-1]:g} (dot)", loc="left", fontsize=9.0)
    return ax


def reflection_diagram(frequency: np.ndarray, reflections: Mapping[str, np.ndarray], ax: Any = None) -> Any:
    """|r| against frequency [Hz] for several drives, from `reflection` at `frequency` [rad/s]."""
    with plt.rc_context(PAPER):
        if ax is None:
            _, ax = plt.subplots(figsize=(WIDTH, 2.8), layout="constrained")
        for (label, r), style in zip(reflections.items(), (LINES[i % len(LINES)] for i in range(len(reflections))), strict=True):
            ax.semilogx(np.asarray(frequency) / (2 * np.pi), np.abs(r), label=label, **style)
        ax.set_xlabel("frequency [Hz]")
        ax.set_ylabel("reflected part |r| [1]")
        ax.set_ylim(bottom=0.0)
        ax.legend(frameon=False)
    return ax


def fitted(found: Fit) -> Any:
    """Measured against model: one panel per signal, or the loop of friction over slip, and below each what is left. Returns the axes, (2, signals)."""
    from toolbox.misfit import Loop

    misfit = found.misfit
    model = misfit.model(found.values)
    loop = isinstance(misfit, Loop)
    dots = {"marker": ".", "linestyle": "none", "color": "0.6", "markersize": 2.5, "rasterized": True}
    with plt.rc_context(PAPER):
        figure, axes = plt.subplots(2, len(misfit.outputs), squeeze=False, sharex="col", figsize=(WIDTH, 3.8), height_ratios=(2.2, 1.0),
                                    layout="constrained")  # fmt: skip
        for (top, bottom), name in zip(axes.T, misfit.outputs, strict=True):
            unit = misfit.plant.unit(name)
            time, measured = misfit.time[name], misfit.measured[name]
            if loop:
                element = misfit.plant.elements[misfit.place]
                x, slides = misfit.slip[misfit.rows], ~misfit.released
                resting = np.setdiff1d(np.arange(misfit.slip.size), misfit.rows)
                top.plot(misfit.slip[resting], misfit.recording.signals[name][resting], **{**dots, "color": "0.85"}, label="measured, at rest")
                top.plot(x[slides], measured[slides], **dots, label="measured, slipping")
                top.plot(x[slides], model[name][slides], **{**dots, "color": LINES[0]["color"], "markersize": 1.8}, label="law, at the measured load")
                if misfit.released.any():
                    top.plot(x[misfit.released], measured[misfit.released], marker="^", linestyle="none", color=LINES[1]["color"], label="break-away")
                bottom.set_xlabel(f"slip of {element.name} [{element.slip_unit}]")
            else:
                x = time
                top.plot(x, measured, **dots, label="measured")
                top.plot(x, model[name], label="model", **{**LINES[0], "linewidth": 1.1})
                bottom.set_xlabel("time [s]")
            bottom.plot(x, measured - model[name], **dots)
            bottom.axhline(0.0, color="0.2", linewidth=0.7)
            top.set_ylabel(f"{_words(name)} [{unit}]")
            bottom.set_ylabel(f"left [{unit}]")
            top.legend(frameon=False, markerscale=3.0, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.2)
        figure.align_ylabels(axes)
    return axes
