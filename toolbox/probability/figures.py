"""Pictures of chances. The looks are those of `toolbox.plot`."""

from __future__ import annotations

from typing import Any

import numpy as np

from toolbox.figures.style import LINES, drawn_on, in_words, name_axis
from toolbox.onsets.map_loop import NONE, SMOOTH
from toolbox.probability.bounds import clopper_pearson


def chance_diagram(found: Any, axes: Any = None) -> Any:
    """The chances over one number, as curves with their bounds, or over two, one panel per law with the line above which 95 % are free by the bound."""
    return _curves(found, axes) if len(found.names) == 1 else _panels(found, axes)


def _curves(found: Any, ax: Any) -> Any:
    with drawn_on(ax, height=3.0) as ax:
        for k, label in enumerate(found.labels):
            style = LINES[k % len(LINES)]
            low, high = found.bounds[label]
            ax.fill_between(found.axes[0], low, high, color=style["color"], alpha=0.2, linewidth=0)
            ax.plot(found.axes[0], found.chances[label], label=label, marker="o", markersize=2.5, **style)
        ax.axhline(0.05, color="0.5", linewidth=0.7, linestyle=":")
        ax.set(ylim=(-0.02, 1.02), ylabel="chance of stick-slip [1]")
        name_axis(ax.xaxis, in_words(found.names[0]), found.units[0], found.display_units)
        ax.figure.legend(
            loc="outside lower center", ncols=3, frameon=False
        )  # inside it hides curves: those of some laws go through every corner
        return ax


def _panels(found: Any, axes: Any) -> Any:
    count, wide, made = len(found.labels), min(len(found.labels), 2), axes is None
    rows = -(-count // wide)
    with drawn_on(axes, rows, wide, height=2.9 * rows, sharex=True, sharey=True, squeeze=False) as axes:
        for spare in np.ravel(axes)[count:] if made else ():
            spare.set_visible(False)
        x, y = found.axes
        for ax, label in zip(np.ravel(axes), found.labels, strict=False):
            drawn = ax.pcolormesh(x, y, found.chances[label].T, cmap="cividis_r", vmin=0.0, vmax=1.0, shading="nearest")
            upper = found.bounds[label][1].T
            if min(upper.shape) > 1 and upper.min() <= 0.05 < upper.max():
                ax.contour(x, y, upper, levels=[0.05], colors="black", linewidths=1.4)
            ax.set_title(label, fontsize=9.0)
            name_axis(ax.xaxis, in_words(found.names[0]), found.units[0], found.display_units)
            name_axis(ax.yaxis, in_words(found.names[1]), found.units[1], found.display_units)
            ax.label_outer()
        figure = np.ravel(axes)[0].figure
        figure.colorbar(drawn, ax=axes).set_label("chance of stick-slip [1]")
        line = np.ravel(axes)[0].plot([], [], color="black", linewidth=1.4)
        figure.legend(line, ["free with 95 % by the bound"], loc="outside lower center", frameon=False)
        return axes


def corner_diagram(found: Any, axes: Any = None) -> Any:
    """The unknowns of a posterior one by one, as histograms on the diagonal, and in pairs below it."""
    count = len(found.names)
    with drawn_on(axes, count, count, height=max(2.2 * count, 2.6), squeeze=False, sharex="col") as axes:
        for i in range(count):
            for j in range(count):
                ax = axes[i][j]
                if j > i:
                    ax.set_visible(False)
                elif i == j:
                    ax.hist(found.samples[:, i], bins=24, color="0.75", edgecolor="0.4", linewidth=0.4)
                    ax.set(yticks=[])
                    ax.spines["left"].set_visible(False)
                else:
                    ax.plot(
                        found.samples[:, j],
                        found.samples[:, i],
                        linestyle="none",
                        marker=".",
                        markersize=2.5,
                        color=LINES[0]["color"],
                        alpha=0.5,
                    )
                    if j == 0:
                        name_axis(ax.yaxis, in_words(found.names[i]), found.units[i], found.display_units)
            name_axis(axes[count - 1][i].xaxis, in_words(found.names[i]), found.units[i], found.display_units)
    return axes


def prediction_diagram(found: Any, axes: Any = None) -> Any:
    """Bands on the traces with what was measured, one panel per signal."""
    with drawn_on(axes, len(found.units), 1, height=1.8 * len(found.units) + 0.8, sharex=True, squeeze=False) as axes:
        for ax, (name, unit) in zip(np.ravel(axes), found.units.items(), strict=True):
            colour = LINES[0]["color"]
            band = ax.fill_between(found.time, found.low[name], found.high[name], color=colour, alpha=0.3, linewidth=0)
            (middle,) = ax.plot(found.time, found.median[name], color=colour, linewidth=0.8)
            shown = [(band, f"{100 * found.confidence:g} % band"), (middle, "median")]
            if name in found.measured_values:
                (dots,) = ax.plot(
                    found.time, found.measured_values[name], linestyle="none", marker=".", markersize=1.8, color=LINES[1]["color"], zorder=1
                )
                shown.append((dots, "measured"))
            name_axis(ax.yaxis, in_words(name), unit, found.display_units)
        np.ravel(axes)[-1].set_xlabel("time [s]")
        np.ravel(axes)[0].figure.legend(*zip(*shown, strict=True), loc="outside lower center", ncols=3, frameon=False)
    return axes


def comparison_diagram(found: Any, axes: Any = None) -> Any:
    """By how much each model is behind the best one: in evidence, and in predicting what was left out."""
    with drawn_on(axes, 1, 2, height=0.4 * len(found.posteriors) + 1.2, sharey=True) as axes:
        labels = list(found.posteriors)
        best = max(each.log_evidence for each in found.posteriors.values())
        evidence = [(best - each.log_evidence, each.log_evidence_error) for each in found.posteriors.values()]
        scored = [found.behind(label) for label in labels] if next(iter(found.log_scores.values())).size else []
        for ax, pairs, words in zip(axes, (evidence, scored), ("evidence", "windows left out"), strict=True):
            for place, (behind, error) in enumerate(pairs):
                ax.errorbar(behind, place, xerr=1.96 * error, marker="o", color=LINES[0]["color"], capsize=2.5)
            ax.set_xlabel(f"behind the best in {words} [nats]")
            ax.axvline(0.0, color="0.6", linewidth=0.8, zorder=0)
        axes[0].set(yticks=range(len(labels)), yticklabels=labels, ylim=(len(labels) - 0.5, -0.5))
    return axes


def onset_diagram(found: Any, ax: Any = None) -> Any:
    """The part of the machines that are free over the set-point, with its bounds, and the part that does not lose smooth running."""
    with drawn_on(ax, height=3.2) as ax:
        for k, (label, borders) in enumerate(found.onset_values.items()):
            style = LINES[k % len(LINES)]
            at = np.unique(np.clip([*found.bounds, *borders[np.isfinite(borders)]], *found.bounds))
            free = (borders[None, :] <= at[:, None]).sum(axis=1)
            low, high = clopper_pearson(free, free, borders.size, found.confidence)
            ax.fill_between(at, low, high, color=style["color"], alpha=0.2, linewidth=0, step="post")
            ax.step(at, free / borders.size, where="post", label=label, color=style["color"], linewidth=1.3)
            smooth = np.sort(found.smooth_running_limits[label][np.isfinite(found.smooth_running_limits[label])])
            if smooth.size > borders.size / 2:
                parts = (np.arange(smooth.size) + 1 + borders.size - smooth.size) / borders.size
                ax.step(
                    smooth, parts, where="post", linestyle=":", color=style["color"], linewidth=1.0, label=f"{label}, smooth running stable"
                )
        ax.axhline(0.95, color="0.6", linewidth=0.8, zorder=0)
        ax.set(ylabel="part that is free [1]", ylim=(-0.02, 1.02), xlim=found.bounds)
        name_axis(ax.xaxis, in_words(found.name), found.unit, found.display_units)
        ax.figure.legend(loc="outside lower center", ncols=2, frameon=False)
    return ax


def basin_diagram(found: Any, ax: Any = None) -> Any:
    """The disturbances over the first two states, or over the one, by whether the working point comes back."""
    back = found.outcomes == SMOOTH
    with drawn_on(ax, height=3.6) as ax:
        flat = len(found.names) == 1
        for kept, words, marker, colour in (
            (back, "comes back", ".", "0.7"),
            (~back & (found.outcomes != NONE), "is tipped", "x", LINES[0]["color"]),
        ):
            y = np.full(int(kept.sum()), float(marker == ".")) if flat else found.starts[kept, 1]
            ax.plot(found.initial_states[kept, 0], y, linestyle="none", marker=marker, markersize=3, color=colour, label=words)
        ax.plot(found.equilibrium[0], 1.0 if flat else found.point[1], linestyle="none", marker="o", color="black", label="working point")
        if np.isfinite(found.smallest_disturbances).all():
            tip = (found.smallest_disturbances[0], 0.0 if flat else found.smallest[1])
            ax.plot(*tip, linestyle="none", marker="s", markerfacecolor="none", color="black", label="smallest that tips it")
        name_axis(ax.xaxis, in_words(found.names[0]), found.units[0], found.display_units)
        if flat:
            ax.set(yticks=[0, 1], yticklabels=["tipped", "back"], ylim=(-0.3, 1.3))
        else:
            name_axis(ax.yaxis, in_words(found.names[1]), found.units[1], found.display_units)
        ax.figure.legend(loc="outside lower center", ncols=4, frameon=False)
    return ax
