"""Pictures of onsets and severity maps.

Every function draws into `ax` or makes a figure of its own, and returns the axes; the looks are those of `toolbox.plot`. What is drawn is declared here by
its attributes, so that results can draw themselves and pictures need not know them.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import matplotlib.pyplot as plt
import numpy as np

from toolbox.errors import SceneError
from toolbox.simulation.style import LINES, PAPER, WIDTH, in_words, name_axis, reading_of


class DrawnVerdict(Protocol):
    """Verdict and severity of one run."""

    @property
    def verdict(self) -> str: ...
    @property
    def severity(self) -> float: ...


class DrawnValue(Protocol):
    """A value of the parameter to be marked: a border or a Hopf point."""

    @property
    def value(self) -> float: ...


class DrawnOnset(Protocol):
    """What a diagram shows of a `toolbox.onsets.report.Onset`."""

    @property
    def parameter(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def signal(self) -> str: ...
    @property
    def values(self) -> np.ndarray: ...
    @property
    def smooth(self) -> Sequence[DrawnVerdict]: ...
    @property
    def sticking(self) -> Sequence[DrawnVerdict]: ...
    @property
    def hopf(self) -> Sequence[DrawnValue]: ...
    @property
    def ends(self) -> Sequence[DrawnValue]: ...
    @property
    def stalls(self) -> Sequence[DrawnValue]: ...
    @property
    def breakaways(self) -> Sequence[DrawnValue]: ...
    @property
    def bistable(self) -> Sequence[tuple[float, float]]: ...
    @property
    def at(self) -> float: ...
    def regimes(self, value: float) -> tuple[str, ...]: ...


class DrawnBranch(Protocol):
    """Severity and verdict of one branch of a map at every point of its grid."""

    @property
    def severity(self) -> np.ndarray: ...
    @property
    def verdict(self) -> np.ndarray: ...


class DrawnMap(Protocol):
    """What the panels show of a `toolbox.onsets.severity_map.SeverityMap`."""

    @property
    def names(self) -> tuple[str, str]: ...
    @property
    def units(self) -> tuple[str, str]: ...
    @property
    def axes(self) -> tuple[np.ndarray, np.ndarray]: ...
    @property
    def signal(self) -> str: ...
    @property
    def smooth(self) -> DrawnBranch: ...
    @property
    def sticking(self) -> DrawnBranch: ...
    @property
    def borders(self) -> dict[str, np.ndarray]: ...


def onset_diagram(found: DrawnOnset, ax: Any = None) -> Any:
    """Severity over the parameter: from smooth running and from inside stick-slip, the Hopf points, both borders, the bistable band, the working point."""
    with plt.rc_context(PAPER):
        if ax is None:
            _, ax = plt.subplots(figsize=(WIDTH, 3.0), layout="constrained")
        for low, high in found.bistable:
            ax.axvspan(low, high, color="0.90", linewidth=0, zorder=0, label="bistable")
        for point in found.hopf:
            ax.axvline(point.value, color="0.2", linewidth=1.0, linestyle=(0, (4, 2)), label="Hopf point", zorder=1)
        for border in found.ends:
            ax.axvline(border.value, color=LINES[1]["color"], linewidth=1.0, linestyle=(0, (1.2, 1.2)), label="stick-slip ends", zorder=1)
        for border in found.stalls:
            ax.axvline(border.value, color=LINES[1]["color"], linewidth=1.0, linestyle=(0, (5, 1.5, 1, 1.5)), label="stick-slip stalls", zorder=1)
        for border in found.breakaways:
            ax.axvline(border.value, color="0.45", linewidth=1.6, label="break-away", zorder=1)
        _standstill(found, ax)
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
        name_axis(ax.xaxis, in_words(found.parameter), found.unit)
        ax.set_ylabel(f"severity of {in_words(found.signal)} [1]")
        ax.set_xlim(found.values[0], found.values[-1])
        ax.set_ylim(bottom=0.0)
        handles, labels = ax.get_legend_handles_labels()
        once = dict(zip(labels, handles, strict=True))
        ax.legend(once.values(), once.keys(), loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False, borderaxespad=0.2)
    return ax


def _standstill(found: DrawnOnset, ax: Any) -> None:
    """A hatched strip along the axis where standstill lasts."""
    edges = sorted({float(found.values[0]), float(found.values[-1]), *(border.value for border in found.breakaways)})
    for low, high in itertools.pairwise(edges):
        if "standstill" in found.regimes((low + high) / 2):
            ax.axvspan(low, high, ymax=0.05, facecolor="none", edgecolor="0.45", hatch="////", linewidth=0, zorder=2, label="standstill")


def onset_panels(onsets: Mapping[str, DrawnOnset]) -> Any:
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


def severity_panels(found: DrawnMap, axes: Any = None) -> Any:
    """Severity over two numbers on both branches, with the linear border, the loss of smooth running and the end of stick-slip. Returns both axes.

    The grey tells the severity, and white where the machine runs smoothly; lines differ in their dashes as well.
    """
    from matplotlib.collections import LineCollection

    looks: dict[str, tuple[str, dict[str, Any]]] = {
        "smooth": ("smooth running is lost", {"colors": "#8fb4dc", "linestyles": "-", "linewidths": 3.2}),
        "linear": ("poles on the imaginary axis", {"colors": "black", "linestyles": (0, (1.2, 1.2)), "linewidths": 1.2}),
        "sticking": ("stick-slip ends", {"colors": LINES[1]["color"], "linestyles": (0, (5, 1.5)), "linewidths": 1.8}),
    }
    with plt.rc_context(PAPER):
        if axes is None:
            _, axes = plt.subplots(1, 2, figsize=(1.25 * WIDTH, 3.5), layout="constrained", sharex=True, sharey=True)
        (x, y), scales = found.axes, [_thousands(axis, unit) for axis, unit in zip(found.axes, found.units, strict=True)]
        values = np.concatenate([found.smooth.severity.ravel(), found.sticking.severity.ravel()])
        top = float(np.quantile(values[np.isfinite(values)], 0.99)) if np.isfinite(values).any() else 1.0
        shade = None
        for ax, branch, title in zip(axes, (found.smooth, found.sticking), ("from smooth running", "from inside stick-slip"), strict=True):
            ax.set_facecolor("#f3e3d3")
            shown = np.ma.masked_invalid(np.where(branch.verdict == -1, np.nan, branch.severity))
            shade = ax.pcolormesh(
                x / scales[0][0], y / scales[1][0], shown.T, cmap="Greys", vmin=0.0, vmax=1.25 * top, shading="nearest", rasterized=True
            )
            for name, (label, look) in looks.items():
                segments = found.borders[name] / [scales[0][0], scales[1][0]]
                ax.add_collection(LineCollection(lines_of(segments), label=label, zorder=3, **look))
            ax.set_title(title, loc="left", fontsize=9.0)
            ax.set(xlim=(x[0] / scales[0][0], x[-1] / scales[0][0]), ylim=(y[0] / scales[1][0], y[-1] / scales[1][0]))
            ax.set_xlabel(f"{in_words(found.names[0])} [{scales[0][1]}]")
        axes[0].set_ylabel(f"{in_words(found.names[1])} [{scales[1][1]}]")
        figure = axes[0].figure
        bar = figure.colorbar(
            shade, ax=list(axes), label=f"severity of {in_words(found.signal)} [1]", boundaries=np.linspace(0.0, top, 129), extend="max"
        )
        bar.set_ticks(list(np.arange(0.0, top + 1e-9, 0.5 if top > 1 else 0.1)))
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
    return axes


def _thousands(axis: np.ndarray, unit: str) -> tuple[float, str]:
    """(divisor, unit) in which an axis is read best."""
    factor, shown = reading_of(unit, float(np.abs(axis).max()))
    return 1.0 / factor, shown


def lines_of(segments: np.ndarray) -> list[np.ndarray]:
    """The lines that segments in order make, shape (points, 2) each, so that dashes run through."""
    starts = np.flatnonzero((segments[1:, 0] != segments[:-1, 1]).any(axis=1)) + 1
    return [np.vstack([line[:1, 0], line[:, 1]]) for line in np.split(segments, starts)] if len(segments) else []
